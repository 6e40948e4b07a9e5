"""Chirps: the side of the encoders and the rotors, from one second for each joint."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import Answer

import armgpi
from armgpi import config
from armgpi.errors import ParameterError, UnfitLog
from armgpi.identification import chirp
from armgpi.identification.chirp import CHIRP, HIGHEST, LOWEST, TURN, find_side
from armgpi.identification.logs import Grid, Log
from armgpi.robot.drives import Drives

DT = 1e-3


def arm() -> armgpi.Robot:
    robot = armgpi.Robot.load("anthropomorphic3").with_limits(effort=40.0, velocity=3.0)
    return robot.with_drives(
        {
            name: {"rotor_inertia": {"value": J, "low": 0.4 * J, "high": 2.5 * J, "source": "assumed"}}
            for name, J in zip(robot.joint_names, (0.4, 0.3, 0.15), strict=True)
        }
    )


def logged(side: str, bits: int = 18, stiffness: float = 1.0, seconds: float | None = None) -> Log:
    """Return the log of chirps of an arm whose rotors are 1.4 times the assumed ones."""
    known = armgpi.assume_drives(arm(), "elastic")
    reference = chirp.chirp(known).reference
    real = known.with_armature(1.4 * known.armature)
    real = real.with_drives({j: {"encoder_side": side, "gear_ratio": 100.0} for j in real.joint_names})
    gears = stiffness * known.drives.value("stiffness")
    plant: Any = armgpi.ElasticPlant(real, gear_stiffness=gears, encoder_side=side)
    plant = armgpi.Delayed(armgpi.Encoder(plant, bits), 1)
    controller = armgpi.GPI.auto(known, DT, delay=DT, bits=16)
    run = armgpi.simulate(plant, controller, reference, seconds or reference.t_end, progress=False)
    return Log(run["time"].values, run["q_measured"].values, run["tau_command"].values, "log", "motor")


def test_the_motion_is_a_chirp_of_each_joint_in_its_turn_within_its_limits() -> None:
    robot = arm()
    motion = chirp.chirp(robot)
    times = np.arange(0.0, motion.reference.t_end, 5e-4)
    target = motion.reference.at(times)
    moving = np.abs(target.q - target.q[0]) > 1e-9
    for j in range(robot.n):
        own = (times > j * TURN) & (times < (j + 1) * TURN)
        assert not moving[~own, j].any()
        assert moving[own, j].any()
        # Crossings of zero are half turns of the phase: between the ends of the chirp's frequencies.
        a = target.a[own, j]
        loud = np.abs(a) > 0.2 * np.abs(a).max()
        half_turns = np.diff(np.flatnonzero(np.diff(np.sign(a[loud]))))
        mean = (HIGHEST - LOWEST) / np.log(HIGHEST / LOWEST) * CHIRP
        assert len(half_turns) == pytest.approx(2.0 * mean, rel=0.25)
    assert (motion.share < 1.0).all()
    assert (motion.effort < 1.0).all()
    assert np.ptp(target.q, axis=0).max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("side", ["motor", "link"])
def test_the_side_and_the_rotors_are_found(side: str) -> None:
    known = armgpi.assume_drives(arm(), "elastic")
    found = find_side(known, logged(side))
    assert found.side == side
    drives = found.add_to(known.drives)
    assert drives.value("encoder_side").tolist() == [side] * 3
    assert set(drives.sources("encoder_side")) == {"identified"}
    if side == "link":
        assert not found.identified.any()
        assert set(drives.sources("rotor_inertia")) == {"assumed"}
        return
    assert found.identified.all()
    true = 1.4 * known.armature
    assert (found.low <= true).all()
    assert (true <= found.high).all()
    assert found.rotor == pytest.approx(true, rel=0.25)
    assert found.late == pytest.approx(1.5 * DT, abs=0.3 * DT)  # a sample, and the hold of half a one
    assert found.counts == pytest.approx(2.0 * np.pi / 2**18 / 100.0, rel=1e-6)


@pytest.mark.slow
def test_of_an_encoder_that_is_too_coarse_the_side_is_not_known() -> None:
    found = find_side(arm(), logged("link", bits=9))
    assert found.side == ""
    assert found.add_to(Drives(arm().joint_names)) == Drives(arm().joint_names)
    verdict = chirp.judge_side(found, arm().joint_names)
    assert verdict.outcome == "not judged"
    assert verdict.exit_code == 3


@pytest.mark.slow
def test_a_log_that_ends_early_has_the_joints_before_and_says_so() -> None:
    robot = arm()
    found = find_side(robot, logged("motor", seconds=2.0 * TURN))
    assert np.isfinite(found.evidence).tolist() == [True, True, False]
    verdict = chirp.judge_side(found, robot.joint_names)
    assert verdict.outcome != "holds"
    assert verdict.left_out == ("q3: no chirp in the log",)
    assert chirp.judge_side(found, robot.joint_names, accepted=True).exit_code == 0


def test_counts_are_those_of_the_log_and_not_of_positions_between_its_samples() -> None:
    known, count = armgpi.assume_drives(arm(), "elastic"), 1.5e-3
    reference = chirp.chirp(known).reference
    rng = np.random.default_rng(0)
    t = np.arange(0.0, reference.t_end, DT)
    t += 0.05 * DT * rng.uniform(-1.0, 1.0, len(t))
    target = reference.at(t)
    tau = np.diag(known.mass_matrix(known.middle())) * target.a
    found = find_side(known, Log(t, np.round(target.q / count) * count, tau, "log", "motor"))
    assert found.counts == pytest.approx([0.0, count, count], rel=1e-6)  # the first moves by less than half
    assert found.side == ""
    said = chirp.describe(found, known)
    assert said.count("smallest step of its position 0.0015 rad") == 2
    assert said.count("its position never changed") == 1
    assert "encoder count" not in said.partition("automatic controller")[0]


def test_a_gap_within_a_tenth_of_a_second_before_a_chirp_leaves_that_joint_out() -> None:
    known = arm()
    t = DT * np.arange(round(known.n * TURN / DT))
    own = t[:, None] - TURN * np.arange(known.n) - 0.5
    wave = np.where((own > 0.0) & (own < CHIRP), np.sin(2.0 * np.pi * (10.0 + 30.0 * own) * own), 0.0)
    whole = Grid(DT, np.cumsum(np.cumsum(wave, axis=0), axis=0) * DT**2, wave, np.zeros(len(t), dtype=bool))

    def joints(seconds: float) -> list[int]:
        """Return the joints that are seen with a gap so long before the chirp of the second one."""
        begin, bad = chirp._begin(known, whole), whole.bad.copy()
        assert begin is not None
        bad[begin + round((TURN + 0.5 - seconds) / DT)] = True
        found = chirp._responses(known, whole._replace(bad=bad), np.full(known.n, 1e-12), [])
        return [each.joint for each in found]

    assert joints(0.05) == [0, 2]
    assert joints(0.15) == [0, 1, 2]


def test_of_joints_without_a_chirp_the_side_stays_what_it_was() -> None:
    names, three = ("a", "b", "c"), np.full(3, 0.1)
    evidence, own = np.array([60.0, np.nan, 0.0]), np.array([True, False, False])
    found = chirp.Side("motor", evidence, three, three, three, own, 1e-3, three)
    drives = found.add_to(Drives(names).with_value("encoder_side", {"b": "link"}))
    assert drives.value("encoder_side").tolist() == ["motor", "link", "motor"]
    assert drives.sources("encoder_side") == ("identified", "specified", "identified")


def test_what_is_no_log_of_chirps_is_refused_in_a_line() -> None:
    robot = arm()
    t = np.arange(0.0, 8.0, DT)
    q = 0.2 * np.sin(t[:, None] + np.arange(3))
    slow = Log(t, q, 5.0 * np.cos(3.0 * t[:, None] + np.arange(3)), "log", "motor")
    with pytest.raises(UnfitLog, match="shows no joint's chirp: expected the motion of armgpi excite --side"):
        find_side(robot, slow)
    with pytest.raises(ParameterError, match="sensors behind the gears do not feel the rotors"):
        find_side(robot, slow._replace(torque="joint"))
    for share in (0.0, -1.0, 1.5, float("nan")):
        with pytest.raises(ParameterError, match="share"):
            chirp.chirp(robot, share)
    with pytest.raises(ParameterError, match="both sides of a direct drive are one"):
        chirp.chirp(armgpi.Robot.load("anthropomorphic3"))
    weak = robot.with_limits(effort=[40.0, 1e-3, 40.0])
    with pytest.raises(ParameterError, match="q2 holds where it is shaken"):
        chirp.chirp(weak)


@pytest.mark.parametrize(
    "option",
    [
        "--resonance=other.csv",
        "--validate=other.csv",
        "--experiment=experiment.yaml",
        "--load=other.csv",
        "--load-mass=1.0",
        "--report=page.html",
        "--no-gravity",
        "--anyway",
    ],
)
def test_options_that_chirps_alone_do_not_use_are_refused(cli: Callable[..., Answer], option: str) -> None:
    done = cli("identify", "--side", "chirp.csv", "--robot", "ur5", option)
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert f"{option.partition('=')[0]} must be left out without LOG" in done.err


def test_chirps_alone_need_no_solver(cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "clarabel", None)
    done = cli("identify", "--side", "chirp.csv", "--robot", "ur5")
    assert done.code == 2
    assert "chirp.csv: No such file" in done.err
    assert "clarabel" not in done.err


def test_the_folder_of_an_identified_arm_is_left_alone(cli: Callable[..., Answer], tmp_path: Any) -> None:
    folder = tmp_path / "identified"
    folder.mkdir()
    (folder / "identification.json").write_text("{}", encoding="utf-8")
    done = cli("identify", "--side", "chirp.csv", "--robot", "ur5", "--out", folder)
    assert done.code == 2
    assert "--out" in done.err
    assert "a folder without an identified arm" in done.err
    assert len(done.err.splitlines()) == 1
    assert [path.name for path in folder.iterdir()] == ["identification.json"]


@pytest.mark.parametrize("kind", ["--side", "--resonance"])
def test_a_motion_of_fixed_time_takes_no_seconds(cli: Callable[..., Answer], kind: str) -> None:
    done = cli("excite", "ur5", kind, "--seconds", 5)
    assert done.code == 2
    assert f"--seconds must be left out with {kind}" in done.err


def test_the_next_command_is_for_the_same_arm(cli: Callable[..., Answer], tmp_path: Path) -> None:
    folder = tmp_path / "two words"
    done = cli("excite", "ur5", "--side", "--lock", "wrist_3_joint", "-o", folder)
    command = re.search(r"armgpi identify --side LOG --robot (.*);", done.out)
    assert command is not None
    (robot,) = shlex.split(command[1])
    assert config.build(*config.read(Path(robot))).robot.n == 5


def test_the_torque_of_chirps_is_said_for_the_rotors_that_it_is_computed_with(
    cli: Callable[..., Answer], tmp_path: Any
) -> None:
    done = cli("excite", "ur5", "--side", "-o", tmp_path)
    assert done.code == 0
    assert "for the assumed rotor inertia: shoulder_pan_joint" in done.out
    known = armgpi.assume_drives(armgpi.Robot.load("ur5"), "elastic")
    motion = chirp.chirp(known)
    for j in range(known.n):  # in its own turn; the others' chirps move it by their coupling
        target = motion.reference.at(np.arange(j * TURN, (j + 1) * TURN, 5e-4))
        tau = np.abs(known.inverse_dynamics(target.q, target.v, target.a)[:, j]).max()
        # Peaks of gravity and of acceleration are added, so it is above, and by little.
        assert 0.98 < motion.effort[j] * known.limits.effort[j] / tau < 1.25


def test_a_log_may_end_with_the_first_chirp() -> None:
    """Where an arm rests for two turns first, the others' chirps are missing; the first is where it is."""
    known = arm()
    t = DT * np.arange(round(3 * TURN / DT) + 2)  # torques are looked at by second differences
    own = t - 2 * TURN - 0.5
    wave = np.zeros((len(t), known.n))
    wave[:, 0] = np.where((own > 0.0) & (own < CHIRP), np.sin(2.0 * np.pi * (10.0 + 30.0 * own) * own), 0.0)
    grid = Grid(DT, np.cumsum(np.cumsum(wave, axis=0), axis=0) * DT**2, wave, np.zeros(len(t), dtype=bool))
    assert chirp._begin(known, grid) == round(2 * TURN / DT)
