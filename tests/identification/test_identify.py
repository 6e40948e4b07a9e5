"""Identification: a log of an arm that is known gives that arm, physical, with intervals, and as files."""

from __future__ import annotations

import base64
import copy
import json
import math
import re
import runpy
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from commands import Answer

import armgpi
from armgpi import config
from armgpi.config import arms
from armgpi.config.experiment import portable
from armgpi.control.linear_arm import gravity_stiffness
from armgpi.errors import ArmgpiError, ParameterError, UnfitLog
from armgpi.identification import arm as identification
from armgpi.identification import check, resonance
from armgpi.identification.arm import Identified, Validation, identify, mean_inertia
from armgpi.identification.chirp import Side
from armgpi.identification.estimate import Block, Prior, expect, extend_positive, fit
from armgpi.identification.excitation import FIRST_SHARE, excite
from armgpi.identification.logs import Log, read_log, resample
from armgpi.identification.posterior import read_posterior, with_parameters
from armgpi.identification.resonance import LINES, TURN, _noise_at, find_gears
from armgpi.identification.samples import check_samples
from armgpi.identification.text import (
    say_causes,
    say_drift,
    say_findings,
    say_gears,
    say_load,
    say_residuals,
    say_simulation,
)
from armgpi.identification.weak_form import COLUMNS, MOST_LAG, ROTOR, WeakForm, bump
from armgpi.identification.writing import edit_urdf, experiment_files, write_identified
from armgpi.loop import logs
from armgpi.plants.plant import inside
from armgpi.robot import identified, robots, rotors
from armgpi.robot.drives import Drives
from armgpi.robot.meshes import MeshFinder
from armgpi.studies import setup
from armgpi.studies.sample import Sweep
from armgpi.tuning.two_mass import Gears, damping_at_one

LATE = 2


@cache
def file() -> armgpi.Robot:
    return armgpi.Robot.load("anthropomorphic3")


@cache
def arm() -> armgpi.Robot:
    """Return what is really there: other rotors, friction, and a load that the file does not have."""
    other = file().with_armature([0.3, 0.2, 0.1]).with_payload(file().tip, 0.3, (0.02, 0.0, 0.01))
    return other.with_friction(viscous=[0.4, 0.3, 0.2], coulomb=[0.5, 0.4, 0.3])


@cache
def log(seed: int = 3, carried: float = 0.0) -> Log:
    """Return a log of it: exact torques along a motion, positions of 16 bits that are late."""
    dt, excitation = 2e-3, excite(file(), 12.0, 0.6, seed=seed, floor=None)
    t = np.arange(0.0, 12.0, dt)
    other = arm().with_payload(arm().tip, carried, (0.0, 0.03, 0.05)) if carried else arm()
    z = excitation.reference.at(t + 0.5 * dt)
    friction = other.friction.viscous * z.v + other.friction.coulomb * z.v / np.sqrt(z.v**2 + 1e-6)
    tau = other.inverse_dynamics(z.q, z.v, z.a) + other.armature * 0.0 + friction
    count = 2.0 * np.pi / 2**16
    q = np.round(excitation.reference.at(t - LATE * dt).q / count) * count
    return Log(t, q, tau)


@cache
def found() -> Identified:
    return identify(log(), file())


def test_the_arm_that_made_the_log_is_found() -> None:
    z = excite(file(), 10.0, 0.6, seed=9, floor=None).reference.at(np.linspace(0.5, 9.5, 100))
    true, own = (each.inverse_dynamics(z.q, z.v, z.a) for each in (arm(), found().robot))
    assert np.sqrt(((own - true) ** 2).mean(axis=0) / (true**2).mean(axis=0)).max() < 0.01
    assert found().robot.friction.viscous == pytest.approx(arm().friction.viscous, rel=0.05)
    assert found().robot.friction.coulomb == pytest.approx(arm().friction.coulomb, rel=0.05)
    assert found().lag == pytest.approx(LATE * 2e-3, abs=0.2 * 2e-3)


def test_a_validation_is_of_torques_at_the_time_of_the_positions() -> None:
    late = Log(log(9).t[15:], log(9).q[15:], log(9).tau[:-15])  # as in logs of real arms: torques come later
    moved = identify(Log(log().t[15:], log().q[15:], log().tau[:-15]), file())
    assert moved.lag == pytest.approx((LATE - 15) * 2e-3, abs=1e-3)
    assert moved.validate(late).identified.max() < 0.015


def test_a_later_log_of_an_arm_that_has_changed_says_so() -> None:
    warm = log(9)._replace(tau=log(9).tau + 0.5 * np.sign(np.gradient(log(9).q, axis=0)) * [0.0, 0.0, 1.0])
    assert any("drifted" in line and "q3;" in line for line in say_drift(found(), found().validate(warm)))
    assert say_drift(found(), found().validate(log(9))) == []


def test_friction_that_grows_with_the_load_or_towards_rest_is_found_where_it_is() -> None:
    z = excite(file(), 12.0, 0.6, seed=3, floor=None).reference.at(log().t + 1e-3)
    sign = z.v / np.sqrt(z.v**2 + 1e-6)
    more = 0.1 * sign * np.abs(arm().gravity(z.q)) * [0.0, 1.0, 0.0]
    more += sign * np.exp(-((z.v / 0.05) ** 2)) * [0.5, 0.0, 0.0]
    result = identify(log()._replace(tau=log().tau + more), file())
    rows = {(row.joint, row.quantity): row for row in result.table()}
    assert rows["q2", "load"].value == pytest.approx(0.1, rel=0.1)
    assert rows["q1", "stribeck"].value == pytest.approx(0.5, rel=0.2)
    assert result.robot.friction.coulomb == pytest.approx(arm().friction.coulomb, rel=0.1)
    assert any("q2: its friction grows with its load" in line for line in say_findings(result))
    assert not {"load", "stribeck"} & {row.quantity for row in found().table()}


def test_a_lag_of_each_joint_and_other_frictions_are_not_taken_where_noise_alone_is_left() -> None:
    """Each of them explains a little of any noise; who takes what explains nothing finds it everywhere."""
    rng = np.random.default_rng(5)
    noise = 0.02 * log().tau.std(axis=0) * rng.normal(size=log().tau.shape)
    result = identify(log()._replace(tau=log().tau + noise), file())
    assert np.ptp(result.lag) == 0.0
    assert not {"load", "stribeck"} & {row.quantity for row in result.table()}


def test_what_cannot_be_told_apart_is_told_as_a_sum() -> None:
    (base,) = (row for row in found().table() if (row.joint, row.quantity) == ("q1", "rotor"))
    both = found().sums()[0]
    assert both.data_share > 0.9
    assert both.upper - both.lower < 0.5 * (base.upper - base.lower)
    assert 0.0 < both.lower < both.value < both.upper
    assert both.value - both.lower == pytest.approx(both.upper - both.value)


def test_every_arm_that_is_found_or_drawn_is_physical() -> None:
    for robot in (found().robot, *found().sample(8).robots):
        for body in list(robot.pinocchio_model().inertias)[1:]:
            assert np.linalg.eigvalsh(body.toPseudoInertia().toMatrix())[0] > 0.0
        assert (robot.armature > 0.0).all()
        assert (robot.friction.coulomb >= 0.0).all()
    low, high = found().delta(count=8)
    assert 0.9 < low <= 1.0 <= high < 1.1


def test_a_log_without_noise_of_the_arm_of_the_file_is_no_log_of_one_that_rests() -> None:
    dt, motion = 2e-3, excite(file(), 12.0, 0.6, seed=3, floor=None).reference
    t = np.arange(0.0, 12.0, dt)
    z, between = motion.at(t), motion.at(t + 0.5 * dt)
    same = identify(Log(t, z.q, file().inverse_dynamics(between.q, between.v, between.a)), file())
    own, true = (each.inverse_dynamics(z.q, z.v, z.a) for each in (same.robot, file()))
    assert np.abs(own - true).max() < 1e-3 * np.abs(true).max()


def test_without_data_the_file_stays() -> None:
    prior = Prior(np.array([1.0, 2.0]), np.array([0.5, 0.5]), (), ())
    nothing = Block(np.zeros((3, 1, 2)), np.zeros((3, 1)), np.ones((3, 1), dtype=bool), np.arange(3))
    result = fit([nothing], prior, physical=False)
    assert result.free.tolist() == [0.0, 0.0]
    assert result.learned == pytest.approx([0.0, 0.0])


def test_an_arm_of_which_the_file_tells_no_mass_is_found(tmp_path: Path) -> None:
    path = tmp_path / "bare.urdf"
    path.write_bytes(_without_inertials(robots.locate("anthropomorphic3")[0].read_bytes()))
    with pytest.raises(ArmgpiError, match="armgpi identify, with --repair assume-bodies"):
        armgpi.Robot.load(path, repair="all")
    result = identify(log(), armgpi.Robot.load(path, repair="assume-bodies"))
    z = excite(file(), 10.0, 0.6, seed=9, floor=None).reference.at(np.linspace(0.5, 9.5, 100))
    true, own = (each.inverse_dynamics(z.q, z.v, z.a) for each in (arm(), result.robot))
    assert np.sqrt(((own - true) ** 2).mean(axis=0) / (true**2).mean(axis=0)).max() < 0.01
    assert any("the file has no masses" in line for line in say_findings(result))
    write_identified(result, tmp_path / "found")
    q, again = file().random_positions(5), armgpi.Robot.load(tmp_path / "found")
    assert again.mass_matrix(q) == pytest.approx(result.robot.mass_matrix(q), abs=1e-12)


def test_rotors_that_the_file_does_not_tell_are_those_that_a_law_believes() -> None:
    expected = expect(file()).mean.reshape(file().n, len(COLUMNS))[:, ROTOR]
    np.testing.assert_array_equal(expected, rotors.typical_inertia(file()))
    told = expect(arm()).mean.reshape(file().n, len(COLUMNS))[:, ROTOR]
    np.testing.assert_array_equal(told, arm().armature)


def test_a_load_is_found_from_two_logs_together() -> None:
    load = found().load(log(seed=4, carried=0.2))
    assert load.mass == pytest.approx(0.2, rel=0.03)
    assert load.com == pytest.approx([0.0, 0.03, 0.05], abs=5e-3)


def test_the_test_functions_end_smoothly() -> None:
    for derivative in range(3):
        assert bump(np.array([-0.1, 0.0, 1.0, 1.1]), derivative) == pytest.approx([0.0] * 4, abs=1e-12)


def test_written_and_loaded_again_it_is_the_same_arm(tmp_path: Path) -> None:
    write_identified(found(), tmp_path, found().validate(log(seed=9)))
    again = armgpi.Robot.load(tmp_path / "anthropomorphic3.urdf")
    again = again.with_drives(Drives.read(tmp_path / "drives.yaml"))
    q = file().random_positions(20)
    assert again.mass_matrix(q) == pytest.approx(found().robot.mass_matrix(q), abs=1e-12)
    assert again.friction.coulomb == pytest.approx(found().robot.friction.coulomb, rel=1e-12)
    data = json.loads((tmp_path / "identification.json").read_text(encoding="utf-8"))
    assert data["validation"]["identified"]["q1"] < 0.02 < data["validation"]["file"]["q1"]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "The model leaves" in page
    for name in ("identification.json", "drives.yaml"):  # a text file ends with its last line
        assert (tmp_path / name).read_bytes().endswith(b"\n")


@cache
def folder() -> Path:
    """Return where it was written; the caller leaves it as it is."""
    path = Path(tempfile.mkdtemp())
    write_identified(found(), path)
    return path


def test_a_folder_is_the_robot_that_was_identified(tmp_path: Path) -> None:
    again = armgpi.Robot.load(folder())
    q = file().random_positions(20)
    assert again.mass_matrix(q) == pytest.approx(found().robot.mass_matrix(q), abs=1e-12)
    assert again.drives.plain() == found().drives.plain()
    section = {"name": str(folder()), "drives": {"q1": {"viscous": 9.0}}}
    experiment = config.build(config.check({"robot": section}, config.Origin()))
    assert experiment.robot.mass_matrix(q) == pytest.approx(again.mass_matrix(q), abs=0.0)
    assert experiment.robot.friction.viscous == pytest.approx([9.0, *again.friction.viscous[1:]])
    text, copies = portable(config.check({"robot": section}, config.Origin()))
    for name, content in {**copies, "experiment.yaml": text.encode()}.items():
        (tmp_path / name).write_bytes(content)
    alone = config.build(*config.read(tmp_path / "experiment.yaml"))
    assert alone.robot.mass_matrix(q) == pytest.approx(again.mass_matrix(q), abs=0.0)
    assert alone.robot.friction.viscous == pytest.approx(experiment.robot.friction.viscous)


def test_a_search_takes_the_drives_of_the_folder(tmp_path: Path) -> None:
    path = tmp_path / "tune.yaml"
    path.write_text(f"robot: {{name: {folder()}}}\ntune: {{scenarios: 1, held_out: 1}}\n", encoding="utf-8")
    assert setup.read(path).experiment.robot.drives.plain() == found().drives.plain()


def test_the_folder_of_an_identified_arm_is_a_study(
    cli: Callable[..., Answer], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is searched for the arm of `armgpi run`, from any working directory."""
    monkeypatch.chdir(folder().parent)
    study = setup.read(Path(folder().name))
    assert study.experiment.config.plant.engine == "elastic"
    assert study.experiment.robot.drives.plain()["q1"]["rotor_inertia"]["source"] == "identified"
    answer = cli("tune", folder().name, "--out", str(tmp_path / "s"), "--evaluations", "2")
    assert answer.code == 0
    assert (tmp_path / "s" / "best.yaml").is_file()


def test_laws_of_the_file_and_of_the_folder_run_on_the_arm_that_was_identified(
    cli: Callable[..., Answer], tmp_path: Path
) -> None:
    found = cli("compare", folder(), "--t-final", 0.5, "--out", tmp_path / "a")
    assert re.match(r"identified has [0-9.e-]+ of the error of file \(ITAE\)\n", found.out)
    built = config.build(*config.read(tmp_path / "a" / "experiment.yaml"))
    laws = {label: law.robot for label, law in built.controllers.items()}
    assert (laws["file"].armature == 0.0).all()  # as the file tells
    assert (laws["identified"].armature >= built.plant.robot.armature).all()
    arm_there: Any = inside(built.plant)
    assert arm_there.friction.viscous == pytest.approx(armgpi.Robot.load(folder()).friction.viscous)
    q, section = file().random_positions(5), {"type": "pid", "nominal": "anthropomorphic3"}
    wanted = {"robot": {"name": str(folder())}, "controllers": [section]}
    other = config.build(config.check(wanted, config.Origin()))
    assert other.controllers["pid"].robot.mass_matrix(q) == pytest.approx(file().mass_matrix(q), abs=1e-12)
    assert other.robot.mass_matrix(q) == pytest.approx(armgpi.Robot.load(folder()).mass_matrix(q), abs=1e-12)


@pytest.mark.parametrize(
    ("nominal", "said"),
    [
        ("nowhere.urdf", "nowhere.urdf"),
        ("ur5", "expected joints q1, q2, q3"),
        (None, "folder of an identified"),
    ],
)
def test_a_nominal_model_that_is_none_of_the_arm_is_refused(nominal: str | None, said: str) -> None:
    section = {"type": "gpi", "nominal": nominal or str(folder())}
    wanted = {"robot": {"name": "anthropomorphic3"}, "controllers": [section]}
    with pytest.raises(ArmgpiError, match=f"controllers.0.nominal: .*{said}") as caught:
        config.build(config.check(wanted, config.Origin()))
    assert "\n" not in str(caught.value)


def test_draws_from_the_file_alone_are_those_of_the_fit() -> None:
    posterior = read_posterior(folder() / identified.NAME, armgpi.Robot.load(folder()))
    covariance = found()._fit.covariance[: len(posterior.mean), : len(posterior.mean)]
    # In units of the prior; the inverse in the covariance is symmetric to its rounding alone.
    assert posterior.root @ posterior.root.T == pytest.approx(covariance, abs=1e-8)
    q = file().random_positions(5)
    own, read = (each.robots for each in (found().sample(4), posterior.sample(file(), 4)))
    for one, other in zip(own, read, strict=True):
        assert other.mass_matrix(q) == pytest.approx(one.mass_matrix(q), abs=1e-9)


def sweep_of(vary: str = "{identification: {}}", robot: str = "", plant: str = "{friction: urdf}") -> Sweep:
    text = f"robot: {{name: {robot or folder()}}}\nplant: {plant}\nt_final: 0.2\nvary: {vary}\n"
    return Sweep.of(*config.parse(text, "sweep.yaml"))


def test_a_sweep_of_the_folder_has_the_world_of_a_run(cli: Callable[..., Answer], tmp_path: Path) -> None:
    run = cli("run", folder())
    swept = cli("sweep", folder(), "--rollouts", 2, "--out", tmp_path / "swept")
    (world,) = (line for line in run.err.splitlines() if line.startswith("world:"))
    (other,) = (line for line in swept.err.splitlines() if line.startswith("world:"))
    assert world.partition(". Values")[0] == other


def test_a_sweep_draws_the_arms_that_were_left_open_and_each_runs_alone() -> None:
    sweep = sweep_of("{identification: {}, plant.payload.mass: {uniform: [0.0, 0.3]}}")
    drawn = sweep.numbers(0, 4)
    assert sweep.numbers(0, 2).tolist() == drawn[:2].tolist()
    rollouts = sweep.table(drawn, np.arange(4))
    theta = found().posterior.unknowns(drawn[:, :-1])
    for row, unknown, peak in zip(drawn, theta, rollouts["peak_error"], strict=True):
        alone = config.build(sweep.config_of(dict(zip(sweep.drawn_names, row, strict=True))))
        q, arm_there = file().random_positions(3), inside(alone.plant)
        wanted = with_parameters(file(), unknown).with_payload(file().tip, row[-1])
        assert alone.plant.robot.mass_matrix(q) == pytest.approx(wanted.mass_matrix(q), abs=1e-9)
        assert vars(arm_there)["friction"].coulomb == pytest.approx(wanted.friction.coulomb)
        run = armgpi.simulate(alone.plant, alone.controllers["gpi"], alone.reference, 0.2)
        assert armgpi.metrics.peak_error(run).values == pytest.approx(peak, rel=1e-6, abs=1e-9)


def test_rotors_that_logs_leave_open_are_drawn_within_what_is_known_of_them() -> None:
    """A rotor at zero, which no motor has, came out of one draw in ten."""
    own = copy.copy(found())
    own._fit = own._fit._replace(covariance=np.eye(len(own.theta)))
    posterior = own.posterior
    joints = posterior.lower[ROTOR :: len(COLUMNS)], posterior.upper[ROTOR :: len(COLUMNS)]
    drawn = np.array([each.armature for each in posterior.sample(file(), 40).robots])
    assert (drawn >= joints[0]).all()
    assert (drawn <= joints[1]).all()
    assert np.ptp(drawn, axis=0).min() > 0.1 * file().armature.max()
    expected = own._prior.mean[ROTOR : len(COLUMNS) * file().n : len(COLUMNS)]
    for value, low, high, middle in zip(own.robot.armature, *joints, expected, strict=True):
        assert low == (pytest.approx(middle / rotors.SCATTER) if value > middle / rotors.SCATTER else -np.inf)
        assert high == (pytest.approx(middle * rotors.SCATTER) if value < middle * rotors.SCATTER else np.inf)


@pytest.mark.parametrize("rotor", [None, 0.0, 0.2])
def test_rotors_and_friction_of_hidden_motors_are_drawn_within_their_drives(rotor: float | None) -> None:
    """Assumed rotors have an interval, specified ones a value, which may be none."""
    given = Drives(file().joint_names)
    given = given if rotor is None else given.with_value("rotor_inertia", rotor)
    own = armgpi.identify(log(), file().with_drives(given), torque="joint")
    drives = own.drives
    arms = own.sample(40).robots
    for name, drawn in (
        ("rotor_inertia", [each.armature for each in arms]),
        ("coulomb", [each.friction.coulomb for each in arms]),
        ("viscous", [each.friction.viscous for each in arms]),
    ):
        for joint, values in zip(file().joint_names, np.transpose(drawn), strict=True):
            known = drives.data[name][joint]
            assert values.min() >= known.low - 1e-6
            assert values.max() <= known.high + 1e-6
            assert np.ptp(values) >= 0.3 * (known.high - known.low)


@pytest.mark.parametrize(
    ("vary", "robot", "said"),
    [
        ("{identification: {}}", "anthropomorphic3", "armgpi identify"),
        ("{identification: {normal: [0, 1]}}", "", "distribution is that of the identification"),
        ("{identification: {}, plant.coulomb: {uniform: [0, 1]}}", "", "draws it as well"),
    ],
)
def test_what_cannot_be_drawn_from_an_identification_is_refused(vary: str, robot: str, said: str) -> None:
    with pytest.raises(ArmgpiError, match=f"vary.*{said}") as caught:
        sweep_of(vary, robot)
    assert "\n" not in str(caught.value)


def test_bodies_of_a_plant_are_those_of_its_joints() -> None:
    robot = armgpi.Robot.load("anthropomorphic3")
    body = (2.0 * robot.pinocchio_model().inertias[3].toDynamicParameters()).tolist()
    wanted = {"robot": {"name": "anthropomorphic3"}, "plant": {"bodies": {"q3": body}}}
    built = config.build(config.check(wanted, config.Origin()))
    there: Any = built.plant.robot
    assert there.total_mass - robot.total_mass == pytest.approx(0.5 * body[0])
    wanted["plant"] = {"bodies": {"q9": body}}
    with pytest.raises(ArmgpiError, match=r"plant.bodies: .*q9.*did you mean"):
        config.build(config.check(wanted, config.Origin()))


NANS = base64.b64encode(np.full(42, np.nan).tobytes()).decode()
#: What is done to identification.json -> what is said of it.
DAMAGED = {
    "no JSON": (lambda text: text[:100], "cannot be read"),
    "a list": (lambda text: "[1]", "of no format, expected 2"),
    "another version": (lambda text: text.replace('"format": 2', '"format": 3'), "of format 3, expected 2"),
    "another arm": (lambda text: text.replace('"q1"', '"q9"'), "expected q1, q2, q3"),
    "another hash": (lambda text: text.replace('"sha256": "', '"sha256": "0'), "was changed since"),
    "a path": (lambda text: text.replace('"drives.yaml"', '"../drives.yaml"'), "the name of a file"),
    "NaN": (
        lambda text: re.sub(r'"mean": "[^"]*"', f'"mean": "{NANS}"', text),
        "posterior.mean: expected 42",
    ),
    "text": (lambda text: re.sub(r'"root": "[^"]*"', '"root": "?"', text), "posterior.root: expected 903"),
    "negative": (
        lambda text: re.sub(r'"scale": "[^"]*"', f'"scale": "{"AAAAAAAA" * 56}"', text),
        "posterior.scale: expected positive",
    ),
    "locked": (lambda text: text.replace('"lock": {}', '"lock": {"q1": NaN}'), "arm.lock: expected"),
    "repairs": (lambda text: text.replace('"repair": []', '"repair": [3]'), "arm.repair: expected"),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_folder_ends_in_one_line(name: str, tmp_path: Path) -> None:
    damage, said = DAMAGED[name]
    for each in folder().iterdir():
        (tmp_path / each.name).write_bytes(each.read_bytes())
    path = tmp_path / identified.NAME
    text = path.read_text(encoding="utf-8")
    path.write_text(damage(text), encoding="utf-8")
    assert path.read_text(encoding="utf-8") != text
    with pytest.raises(ArmgpiError, match=said) as caught:
        read_posterior(identified.read(path).path, file())
    assert "\n" not in str(caught.value)


def test_all_but_the_inertials_is_byte_for_byte_the_same() -> None:
    path, _ = robots.locate("panda")
    robot = armgpi.Robot.load("panda", lock=("panda_finger_joint1", "panda_finger_joint2"))
    bodies = [2.0 * body.toDynamicParameters() for body in list(robot.pinocchio_model().inertias)[1:]]
    edited = edit_urdf(robot.with_bodies(bodies))
    assert _without_inertials(edited.content) == _without_inertials(path.read_bytes())
    assert edited.emptied == ()
    light = [0.05 * body for body in bodies]
    assert "panda_hand" in edit_urdf(robot.with_bodies(light)).emptied


def _without_inertials(content: bytes) -> bytes:
    parts = content.split(b"<inertial>")
    return parts[0] + b"".join(part.partition(b"</inertial>")[2] for part in parts[1:])


def test_times_that_are_not_uniform_keep_the_torques_integral() -> None:
    given = log()
    t = given.t + 3e-4 * np.sin(np.arange(len(given.t)))
    grid = resample(given._replace(t=t))
    assert not grid.bad.any()
    assert grid.tau.sum(axis=0) * grid.dt == pytest.approx(
        (given.tau[:-1] * np.diff(t)[:, None]).sum(0), abs=0.1
    )
    gap = resample(Log(np.append(t[:2000], t[2000:] + 1.0), given.q, given.tau))
    assert gap.bad.sum() * gap.dt == pytest.approx(1.0, abs=0.01)


#: What is wrong with a log -> how, and what is said of it.
BAD = {
    "NaN": (lambda x: x._replace(q=np.where(x.t[:, None] > 5.0, np.nan, x.q)), "finite"),
    "degrees": (lambda x: x._replace(q=np.rad2deg(x.q)), "not degrees"),
    "N mm": (lambda x: x._replace(tau=1000.0 * x.tau), "its limit"),
    "swapped": (lambda x: x._replace(tau=x.tau[:, [1, 0, 2]]), "'q1' fits the motion of 'q2', and that"),
    "swapped elbows": (lambda x: x._replace(tau=x.tau[:, [0, 2, 1]]), "'q2' fits the motion of 'q3', and t"),
    "positions swapped": (lambda x: x._replace(q=x.q[:, [0, 2, 1]]), "columns of these two are swapped"),
    "in a circle": (lambda x: x._replace(tau=x.tau[:, [2, 0, 1]]), "'q1' that of 'q3', 'q2' that of 'q1'"),
    "reversed": (lambda x: x._replace(tau=x.tau * [1.0, 1.0, -1.0]), "reversed sign|follow from its motion"),
    "slow": (lambda x: x._replace(t=100.0 * x.t), "log faster"),
    "still": (lambda x: x._replace(q=np.full_like(x.q, 0.1)), "is it the right column. Else move the joint"),
    "short": (lambda x: Log(x.t[:500], x.q[:500], x.tau[:500]), "log longer"),
    "hardly any": (lambda x: Log(x.t[:150], x.q[:150], x.tau[:150]), "log longer"),
    "clipped": (lambda x: x._replace(tau=np.clip(x.tau, -1.0, 1.0)), "clipped|sensor saturates"),
    "zero torque": (lambda x: x._replace(tau=0.0 * x.tau), "zero throughout"),
    "no weight": (
        lambda x: x._replace(tau=x.tau - arm().gravity(x.q)),
        "gravity torque|follow from its motion",
    ),
    "too few columns": (lambda x: x._replace(q=x.q[:, :2]), "a column for each joint"),
    "times back": (lambda x: x._replace(t=x.t[::-1]), "increasing times"),
    "no log": (lambda x: 3, "must be a Log"),
    "no file": (lambda x: "nowhere.csv", "No such file"),
    "infinite": (lambda x: x._replace(tau=np.where(x.t[:, None] > 5.0, np.inf, x.tau)), "finite"),
    "kN m": (lambda x: x._replace(tau=1e-3 * x.tau), "times what the file expects: in N m"),
    "in ms": (lambda x: x._replace(t=1e3 * x.t), "log faster"),
    "in ms, every fourth": (lambda x: Log(1e3 * x.t[::4], x.q[::4], x.tau[::4]), "log faster"),
    "times of another clock": (lambda x: x._replace(t=4.0 * x.t), "times in s"),
    "10 Hz": (lambda x: Log(x.t[::50], x.q[::50], x.tau[::50]), "log faster"),
    "gaps": (
        lambda x: Log(*(part[np.arange(len(x.t)) // 100 % 2 == 0] for part in x[:3])),
        "a second that has no gap: log longer",
    ),
    "one rests": (lambda x: x._replace(q=np.where([False, True, False], 0.3, x.q)), "q2: .*throughout"),
    "slow joint": (
        lambda x: x._replace(q=x.q * np.array([1.0, 0.003, 1.0])),
        "q2: its speed is .*move it faster",
    ),
    "late": (lambda x: x._replace(tau=np.roll(x.tau, 50, axis=0)), "50 ms apart: give both the same clock"),
    "another zero": (
        lambda x: x._replace(q=x.q + np.array([0.0, 1.5, 0.0])),
        "gravity torque|follow from its motion",
    ),
    "swapped columns": (
        lambda x: x._replace(q=x.q[:, [1, 0, 2]], tau=x.tau[:, [1, 0, 2]]),
        "q1: no arm of this kind .*in this order",
    ),
    "turned round": (lambda x: x._replace(tau=-x.tau), "q1: .*reversed sign.*q3: .*reversed sign"),
    "random": (
        lambda x: x._replace(tau=np.random.default_rng(0).normal(size=x.tau.shape)),
        "follow from its motion",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_log_ends_in_one_line(name: str) -> None:
    change, said = BAD[name]
    with pytest.raises(ArmgpiError, match=said) as caught:
        identify(change(log()), file())
    assert "\n" not in str(caught.value)


#: What is wrong with a file -> its text, and what is said of it.
FILES = {
    "empty": ("", "has no rows"),
    "no time": ("q_q1,q_q2,q_q3,tau_q1,tau_q2,tau_q3\n1,2,3,4,5,6\n", "time"),
    "no torque": ("time,q_q1,q_q2,q_q3\n1,2,3,4\n", "tau_q1"),
    "text": ("time,q_q1\n1,fast\n", "no CSV file of numbers"),
    "ragged": ("time,q_q1\n1,2\n3\n", "no CSV file of numbers"),
    "semicolons": ("time;q_q1\n1;2\n", "no CSV file of numbers"),
}


@pytest.mark.parametrize("name", FILES)
def test_a_bad_file_ends_in_one_line(name: str, tmp_path: Path) -> None:
    text, said = FILES[name]
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ArmgpiError, match=said) as caught:
        identify(tmp_path / "log.csv", file())
    assert "\n" not in str(caught.value)


def test_a_log_of_an_arm_that_adds_the_weight_itself_is_taken() -> None:
    given = log()
    free = given._replace(tau=given.tau - arm().gravity(given.q))
    result = identify(free, file(), gravity=False, check_first=False)
    assert result.residuals.max() < 0.05


def test_currents_with_their_torque_constants_are_torques() -> None:
    constants = np.array([10.0, 8.0, 0.5])
    result = identify(log()._replace(tau=log().tau / constants), file(), current=constants)
    assert result.theta == pytest.approx(found().theta, rel=1e-6, abs=1e-9)
    with pytest.raises(ArmgpiError, match=r"current.*q3"):
        identify(log(), file(), current={"q1": 1.0, "q2": 1.0})


def test_a_motion_for_an_identified_arm_finds_it_from_anywhere(
    cli: Callable[..., Answer], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder().parent)
    assert cli("excite", folder().name, "--seconds", 4, "-o", tmp_path).code == 0
    monkeypatch.chdir(tmp_path)
    built = config.build(*config.read(Path("experiment.yaml")))
    assert built.robot.armature == pytest.approx(found().robot.armature)
    drives = tmp_path / "side.yaml"
    drives.write_text("{q1: {encoder_side: link}, q2: {encoder_side: link}, q3: {encoder_side: link}}")
    assert cli("excite", "anthropomorphic3", "--drives", drives, "--seconds", 4, "-o", tmp_path).code == 0
    built = config.build(*config.read(Path("experiment.yaml")))
    assert built.robot.drives.value("encoder_side").tolist() == ["link"] * 3


@pytest.mark.parametrize(
    ("options", "joints", "locked"),
    [
        (["--lock", "q3=0.2"], ["q1", "q2"], {"q3": 0.2}),
        (["--lock", "q3,q2=-0.3"], ["q1"], {"q3": 0.0, "q2": -0.3}),
        (["--keep", "q1,q2"], ["q1", "q2"], {"q3": 0.0}),
    ],
)
def test_a_motion_of_an_arm_with_locked_joints_runs_on_that_arm(
    cli: Callable[..., Answer],
    tmp_path: Path,
    options: list[str],
    joints: list[str],
    locked: dict[str, float],
) -> None:
    done = cli("excite", "anthropomorphic3", *options, "--seconds", 4, "--no-floor", "-o", tmp_path)
    assert done.code == 0, done.err
    built = config.build(*config.read(tmp_path / "experiment.yaml"))
    assert built.robot.joint_names == tuple(joints)
    assert built.robot.provenance["locked"] == locked


def test_a_first_motion_is_stopped_where_the_arm_leaves_it(
    cli: Callable[..., Answer], tmp_path: Path
) -> None:
    assert cli("excite", "anthropomorphic3", "--first", "--seconds", 4, "-o", tmp_path).code == 0
    wanted = config.read(tmp_path / "experiment.yaml").config
    supervisor = config.build(wanted).supervisor
    assert supervisor is not None
    assert np.asarray(supervisor.following).tolist() == [0.1] * 3


def test_a_good_log_passes_the_check() -> None:
    assert [each for each in found().findings if each.severity == "error"] == []


def test_a_joint_with_another_zero_is_no_body_of_the_file() -> None:
    robot = armgpi.Robot.load("ur5")
    motion, t = excite(robot, 8.0, 0.6, seed=3).reference, np.arange(0.0, 8.0, 4e-3)
    z, other = motion.at(t + 2e-3), robot.with_armature([1.0, 1.0, 0.6, 0.2, 0.15, 0.1])
    tau = other.inverse_dynamics(z.q, z.v, z.a) + 2.0 * z.v / np.sqrt(z.v**2 + 1e-6)
    given = Log(t, motion.at(t).q, tau + 0.01 * np.random.default_rng(0).normal(size=tau.shape))
    assert identify(given, robot).findings == ()
    turned = given._replace(q=given.q + np.array([0.0, 0.0, np.pi / 2.0, 0.0, 0.0, 0.0]))
    said = " ".join(map(str, identify(turned, robot, check_first=False).findings))
    assert "elbow_joint: its body came out unlike the file's" in said


def test_a_check_that_fails_can_be_overridden() -> None:
    short = Log(*(x[:1400] for x in log()[:3]))
    with pytest.raises(UnfitLog):
        identify(short, file())
    assert identify(short, file(), check_first=False).residuals.max() < 0.1


@pytest.mark.parametrize("name", ["anthropomorphic3", "ur5"])
def test_an_excitation_is_inside_the_limits_for_rotors_within_four_times(name: str) -> None:
    robot = armgpi.Robot.load(name)
    motion = excite(robot, 10.0)
    motion.reference.check(robot)
    assert motion.share.max() < 0.75
    assert motion.effort.max() < 1.02
    for end in (0.0, 10.0):
        assert motion.reference.at(end).v == pytest.approx(np.zeros(robot.n), abs=1e-9)


def test_an_excitation_above_a_floor_stays_there() -> None:
    robot = armgpi.Robot.load("ur5")
    assert excite(robot, 5.0, 0.6, floor=-2.0).reference.t_end == pytest.approx(5.0)
    with pytest.raises(ArmgpiError, match="floor"):
        excite(robot, 5.0, 0.6, floor=5.0)


_TOOLS = Path(__file__).parents[2] / "tools"


def test_the_reader_of_public_logs_takes_their_columns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(_TOOLS))  # tools share modules
    tool = runpy.run_path(str(_TOOLS / "ur10e.py"))
    t = np.cumsum(np.random.default_rng(0).choice([0.002, 0.012], 500)) + 798.0
    moves = (t > t[100]) & (t <= t[400])
    q = np.where(moves, np.sin(t - t[100]), 0.0)[:, None] * np.ones(6)
    currents = np.arange(6.0) + t[:, None]
    table = np.hstack([t[:, None], q, 0.0 * q, currents, 0.0 * currents, 0.0 * currents])
    path = tmp_path / "a" / "log.csv"
    path.parent.mkdir()
    np.savetxt(path, table, delimiter=",", fmt="%.6f")
    read = tool["read"](tool["find"](tmp_path, "log.csv"))
    assert 300 <= len(read.t) <= 304
    assert read.t[0] == 0.0
    start = int(np.argmin(np.abs(currents[:, 0] - read.tau[0, 0])))
    assert 98 <= start <= 101
    assert read.q == pytest.approx(q[start : start + len(read.q)], abs=1e-5)
    assert read.tau == pytest.approx(currents[start : start + len(read.q)], abs=1e-5)
    with pytest.raises(SystemExit, match="clone github"):
        tool["find"](tmp_path, "other.csv")


def test_further_public_logs_are_read_as_their_makers_describe_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Motor 6 of a TX40 turns with joint 5 as well; an xMate has its lengths from a table."""
    monkeypatch.syspath_prepend(str(_TOOLS))
    tool = runpy.run_path(str(_TOOLS / "public_logs.py"))
    place = tmp_path / "examples" / "staubli_TX40"
    (place / "data").mkdir(parents=True)
    (place / "urdf").mkdir()
    rows = [[0.0, -0.5 * np.pi, 0.0, 0.225], [0.32, 0.0, 0.0, 0.0]]
    link = (
        '<link name="{0}"><inertial><mass value="1"/><inertia ixx="0.000" ixy="0.000" ixz="0.000" '
        'iyy="0.000" iyz="0.000" izz="0.000"/></inertial></link>'
    )
    parts = ['<robot name="tx40"><link name="l0"/>']
    for k in range(6):
        parts.append(link.format(f"l{k + 1}"))
        parts.append(
            f'<joint name="joint_{k + 1}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
            f'<origin xyz="0.1 0 {rows[1][0]}" rpy="{1.3 * (k % 2)} 0 0"/><axis xyz="0 0 1"/>'
            '<limit lower="-3" upper="3" effort="10" velocity="5"/></joint>'
        )
    (place / "urdf" / "tx40_mdh_modified.urdf").write_text("".join([*parts, "</robot>"]))
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 6))
    motors = q * tool["TX40_RATIOS"]
    motors[:, 5] += 32.0 * q[:, 4]
    currents = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 6))
    for name, numbers in (("pos_read_data", motors), ("curr_data", currents)):
        np.savetxt(place / "data" / f"{name}.csv", numbers, delimiter=",", header="a", fmt="%.12g")
    read = tool["tx40"](tmp_path)
    assert read.log.q - [0.0, -0.5 * np.pi, 0.5 * np.pi, 0.0, 0.0, 0.0] == pytest.approx(q, abs=1e-9)
    # Power of the motors is that of the joints.
    v = np.random.default_rng(2).uniform(-1.0, 1.0, 6)
    speeds = v * tool["TX40_RATIOS"] + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 32.0 * v[4]])
    assert read.log.tau @ v == pytest.approx(currents @ speeds)
    place = tmp_path / "filtering" / "data" / "excit"
    place.mkdir(parents=True)
    for name in ("ang", "torque"):
        np.savetxt(place / f"excit_{name}_record.txt", np.zeros((5, 7)))
    robot = tool["xmate"](tmp_path).robot
    model = robot.pinocchio_model()
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.zeros(7))
    tip = data.oMf[model.getFrameId("link7")].translation
    assert tip == pytest.approx([0.0, 0.0, sum(tool["XMATE_D"])], abs=1e-12)
    with pytest.raises(SystemExit, match="is not there"):
        tool["tiago"](tmp_path)


def test_gaps_of_a_log_are_said_and_left_out() -> None:
    other = arm()
    t = np.arange(0.0, 8.0, 2e-3)
    move = excite(other, 8.0, 0.5, floor=None, collisions=False).reference.at(t)
    tau = other.inverse_dynamics(move.q, move.v, move.a)
    there = (t < 3.0) | (t >= 3.5)
    found = identify(Log(t[there], move.q[there], tau[there], "log"), other, check_first=False)
    (said,) = (each for each in found.findings if "missing" in each.message)
    assert "1 gap, 0.5 s in all, the longest 0.5 s at 3 s" in said.message
    whole = identify(Log(t, move.q, tau, "log"), other, check_first=False)
    assert not any("missing" in each.message for each in whole.findings)


def test_the_folder_of_an_arm_from_a_text_keeps_its_limits(tmp_path: Path) -> None:
    own = armgpi.Robot.from_xml(robots.locate("anthropomorphic3")[0].read_text(encoding="utf-8"))
    write_identified(identify(log(), own), tmp_path)
    again = armgpi.Robot.load(tmp_path)
    assert np.isfinite(own.limits.effort).all()
    for end in ("lower", "upper", "velocity", "effort"):
        np.testing.assert_array_equal(getattr(again.limits, end), getattr(own.limits, end))


def test_meshes_of_an_identified_arm_are_those_beside_its_first_file(tmp_path: Path) -> None:
    source = tmp_path / "robot" / "urdf" / "arm.urdf"
    mesh = tmp_path / "robot" / "meshes" / "a.stl"
    for path in (source, mesh):
        path.parent.mkdir(parents=True)
    mesh.write_bytes(b"solid a")
    source.write_text(robots.locate("anthropomorphic3")[0].read_text(encoding="utf-8"), encoding="utf-8")
    first, second = tmp_path / "first", tmp_path / "second"
    write_identified(identify(log(), armgpi.Robot.load(source)), first)
    write_identified(identify(log(), armgpi.Robot.load(first)), second)
    for folder in (first, second):
        urdf = folder / "arm.urdf"
        assert identified.original_of(urdf) == source
        assert MeshFinder(urdf).find("../meshes/a.stl").path == mesh
        assert MeshFinder(urdf).find("package://robot/meshes/a.stl").path == mesh
    source.write_text(source.read_text(encoding="utf-8") + " ", encoding="utf-8")
    assert identified.original_of(first / "arm.urdf") is None
    assert MeshFinder(first / "arm.urdf").find("../meshes/a.stl").path is None


def test_the_interval_of_a_rotor_that_the_log_leaves_open_ends_at_what_a_motor_has() -> None:
    """A controller for a rotor of zero would be one for an arm that is not there."""
    rows = [row for row in found().table() if row.quantity == "rotor"]
    for row in rows:
        inside = row.expected / rotors.SCATTER < row.value < row.expected * rotors.SCATTER
        assert row.lower >= row.expected / rotors.SCATTER or not inside
        assert row.upper <= row.expected * rotors.SCATTER or not inside
        assert row.lower <= row.value <= row.upper


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda t, q, tau: (t, np.where([True, False, False], np.rad2deg(q), q), tau), "rad, not degrees"),
        (
            lambda t, q, tau: (t, np.clip(q, *np.quantile(q, [0.1, 0.9], axis=0)), tau),
            "its sensor saturates, or it runs against its stop; move it less",
        ),
        (
            lambda t, q, tau: (t, q, np.minimum(tau, 0.8 * tau.max(axis=0))),
            "its sensor saturates; move slower",
        ),
        (lambda t, q, tau: (t, q, tau * [1.0, 0.0, 1.0] + [0.0, 5.0, 0.0]), "is 5 throughout"),
        (lambda t, q, tau: (t, q, tau * [1.0, 0.0, 1.0]), "its torque is zero throughout"),
        (lambda t, q, tau: (t, q * [1.0, 0.0, 1.0] + [0.0, 0.3, 0.0], tau), "position is 0.3 throughout: is"),
        (lambda t, q, tau: (1000.0 * t, q, tau), r"are its times in ms\? Then call the column 'time \[ms\]'"),
        (lambda t, q, tau: (np.where(t < 6.0, t, t - 3.0), q, tau), "got 3 after 5.998 .sample 3001.: cut"),
        (lambda t, q, tau: (t[:200], q[:200], tau[:200]), "is 0.4 s long"),
        (
            lambda t, q, tau: (t, np.where([False, True, False], np.repeat(q[::50], 50, axis=0), q), tau),
            "q2: its position is a new one every 50 samples only, each 0.1 s",
        ),
    ],
)
def test_a_spoilt_log_is_named_with_what_to_do(spoil: Callable[..., Any], said: str) -> None:
    t, q, tau = spoil(
        log().t, log().q, log().tau + 1e-3 * np.random.default_rng(0).normal(size=log().tau.shape)
    )
    with pytest.raises(ArmgpiError, match=said):
        identify(Log(t, q, tau), file())


@pytest.mark.parametrize("late", [0.0, 1e-4])
def test_encoders_and_torques_in_coarse_counts_are_not_said_to_saturate(late: float) -> None:
    """Joints turn slowly: the last count lasts long, and the one before came in a single step."""
    count, rng = 2.0 * np.pi / 2**12, np.random.default_rng(1)
    t = log().t + late * rng.uniform(size=len(log().t))
    q = np.stack([0.1 * np.sin(w * t) for w in (0.7, 1.1, 1.9)], axis=1)
    tau = np.stack([6.0 * np.sin(w * t) for w in (0.5, 0.9, 1.3)], axis=1)
    coarse = Log(t, np.round(q / count) * count, np.round(tau / 0.05) * 0.05)
    there = read_log(coarse, file())
    said = [each.message for each in check_samples(file(), there, resample(there))]
    assert not [message for message in said if "saturates" in message]


@pytest.mark.parametrize("late", [0.0, 1e-4])
@pytest.mark.parametrize("share", [0.04, 0.15])
def test_a_coarse_encoder_that_saturates_on_a_slow_joint_is_found(share: float, late: float) -> None:
    """The joint would have turned three counts or more further; its times may be irregular."""
    count, rng = 2.0 * np.pi / 2**12, np.random.default_rng(1)
    t = log().t + late * rng.uniform(size=len(log().t))
    q = np.stack([0.5 * np.sin(w * t) for w in (0.7, 1.1, 1.9)], axis=1)
    q[:, 1] = np.minimum(q[:, 1], np.quantile(q[:, 1], 1.0 - share))
    coarse = Log(t, np.round(q / count) * count, log().tau)
    said = [str(each) for each in check_samples(file(), coarse, resample(coarse))]
    saturated = [message for message in said if "saturates" in message]
    assert len(saturated) == 1
    assert saturated[0].startswith(f"{file().joint_names[1]}: its position stops at")


def test_a_joint_that_comes_to_rest_at_its_ends_does_not_saturate() -> None:
    """Moves from rest to rest, each as abrupt as counts of 12 bits show it, and a second of rest between."""
    count, t = 2.0 * np.pi / 2**12, np.arange(0.0, 20.0, 2e-3)
    path = armgpi.Bezier(np.zeros(1), np.ones(1), velocity_limit=np.array([1.0]))
    moved = path.at(np.mod(t, 4.0)).q[:, 0]
    forth = np.where(np.mod(np.floor(t / 4.0), 2.0) == 0.0, moved, 1.0 - moved)
    q = np.round(np.stack([forth, 0.05 * forth, np.sin(t)], axis=1) / count) * count
    quiet = Log(t, q, np.random.default_rng(0).normal(size=q.shape))
    said = [str(each) for each in check_samples(file(), quiet, resample(quiet))]
    assert not [message for message in said if "saturates" in message]


@pytest.mark.parametrize("rate", [40.0, 100.0, 1000.0])
@pytest.mark.parametrize("bits", [None, 8, 12, 20])
def test_a_single_move_from_rest_to_rest_does_not_saturate(rate: float, bits: int | None) -> None:
    """The last joint of a log that moves joints one by one, then rests; a parabola fits such an end badly."""
    t = np.arange(0.0, 15.0, 1.0 / rate)
    path = armgpi.Bezier(np.zeros(1), np.ones(1), velocity_limit=np.array([1.5]))
    starts = np.array([1.0, 4.0, 7.0])
    q = np.stack([0.7 * path.at(np.maximum(t - start, 0.0)).q[:, 0] for start in starts], axis=1)
    if bits is not None:
        count = 2.0 * np.pi / 2**bits
        q = np.round(q / count) * count
    quiet = Log(t, q, np.random.default_rng(0).normal(size=q.shape))
    said = [str(each) for each in check_samples(file(), quiet, resample(quiet))]
    assert not [message for message in said if "saturates" in message]


@pytest.mark.parametrize("bits", [8, 10, 12])
def test_trips_to_and_fro_of_few_counts_do_not_saturate(bits: int) -> None:
    """Eight changes of a coarse encoder are most of the trip, and show nothing of its end."""
    t, count = np.arange(0.0, 15.0, 1.0 / 60.0), 2.0 * np.pi / 2**bits
    trips = np.stack(
        [0.5 - 0.5 * np.cos(np.pi * np.clip(np.mod(t, 2.4) / T, 0.0, 1.0)) for T in (0.8, 1.2, 2.0)]
    )
    forth = np.where(np.mod(np.floor(t / 2.4), 2.0) == 0.0, trips, 1.0 - trips).T
    q = np.round(np.array([0.4, 0.25, 1.1]) * forth / count) * count
    quiet = Log(t, q, np.random.default_rng(0).normal(size=q.shape))
    said = [str(each) for each in check_samples(file(), quiet, resample(quiet))]
    assert not [message for message in said if "saturates" in message]


def test_a_known_arm_is_identified_from_what_is_published_of_its_drives() -> None:
    """An SO-100 with its makers' servos: by its URDF's efforts, rotors would be 16 times as heavy.

    Encoders have 12 bits, as the servos' have.
    """
    bare, count = armgpi.Robot.load("so100"), 2.0 * np.pi / 2**12
    servo = rotors.with_published(bare)
    t = np.arange(0.0, 20.0, 2e-3)
    z = excite(bare, 20.0, 0.7, seed=1, floor=None, collisions=False).reference.at(t)
    friction = servo.friction.viscous * z.v + servo.friction.coulomb * z.v / np.sqrt(z.v**2 + 1e-6)
    tau = servo.inverse_dynamics(z.q, z.v, z.a) + friction
    found_arm = identify(Log(t, np.round(z.q / count) * count, tau), bare)
    assert np.abs(mean_inertia(found_arm.robot) / mean_inertia(servo) - 1.0).max() < 0.15
    assert not found_arm.hidden.any()
    assert found_arm.robot.drives.sources("gear_ratio")[0] == "published"


def test_what_a_log_fails_by_is_a_line_of_three_reasons() -> None:
    error = UnfitLog(["a", "b", "c", "d", "e"])
    assert str(error).endswith("a; b; c; and 2 more")
    assert len(error.reasons) == 5
    assert str(UnfitLog(["a", "b", "c"])).endswith("a; b; c")


def test_a_file_without_names_is_told_from_one_with_them(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("0.0,1.0,2.0\n0.1,1.0,2.0\n")
    with pytest.raises(ArmgpiError, match="has numbers in its first line, expected names: time, q_JOINT"):
        read_log(path, file())
    path.write_text("time,q_a,tau_a\n0,1,2\n0.1,1\n")
    with pytest.raises(ArmgpiError, match=r"cut it there|columns") as error:
        read_log(path, file())
    assert "usecols" not in str(error.value)


@cache
def shaken(side: str, stiffness: float, bits: int = 18) -> tuple[Log, float]:
    """Return an answer to the multisine in closed form, one sample late, and the lowest mode [Hz]."""
    other, n, dt, rng = arm(), 3, 2e-3, np.random.default_rng(0)
    t, s = np.arange(0.0, 3 * TURN, dt), 2j * np.pi * LINES[:, None, None]
    K = stiffness * other.armature
    drives = Gears(other.armature, K)
    links = other.mass_matrix(other.middle()) - np.diag(other.armature)
    gear = np.diag(K) + s * np.diag(0.04 * damping_at_one(links, drives))
    stiff = links * s**2 + gravity_stiffness(other, other.middle()) + gear
    whole = np.block([[stiff, -gear], [-gear, np.diag(other.armature) * s**2 + 0.3 * s * np.eye(n) + gear]])
    answers = np.linalg.inv(whole)[:, n * (side == "motor") :, n:][:, :n]
    q, tau = np.tile(other.middle(), (len(t), 1)), np.tile(other.gravity(other.middle()), (len(t), 1))
    for j in range(n):
        own = (t >= j * TURN) & (t < (j + 1) * TURN)
        torque = 3.0 * np.exp(2j * np.pi * rng.uniform(size=len(LINES)))
        waves = np.exp(2j * np.pi * LINES * t[own, None])
        tau[own, j] += (waves * np.exp(1j * np.pi * LINES * dt) @ torque).real
        q[own] += (waves * np.exp(-2j * np.pi * LINES * dt) @ (answers[..., j] * torque[:, None])).real
    count = 2.0 * np.pi / 2**bits
    return Log(t, np.round(q / count) * count, tau), rotors.lowest_mode(links, drives.rotor, drives.stiffness)


@pytest.mark.parametrize(("side", "stiffness"), [("motor", 3e3), ("link", 8e3)])
def test_the_first_mode_is_found_from_a_multisine(side: str, stiffness: float) -> None:
    given, mode = shaken(side, stiffness)
    gears = find_gears(arm(), given, np.full(3, 2e-3))
    assert gears.side == side
    assert gears.mode[0] == pytest.approx(mode, rel=0.02)
    assert gears.mode[1] < mode < gears.mode[2]
    # A log that begins after the turn of the first joint says nothing of its gear.
    late = given.t > TURN
    part = find_gears(arm(), Log(*(x[late] for x in given[:3])), np.full(3, 2e-3))
    assert part.measured.tolist() == [False, True, True]
    other = copy.copy(found())
    other.gears = part
    assert say_gears(other)[1].endswith("so the first mode may be lower: q1")
    assert part.stiffness[1:] == pytest.approx(stiffness * arm().armature[1:], rel=0.1)


@pytest.mark.parametrize("side", ["motor", "link"])
def test_the_derivative_of_the_torques_left_is_that_of_their_differences(
    side: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resonance, "_WEIGHINGS", 0)  # nothing is searched
    given = shaken(side, 3e3)[0]
    turns = list(resonance._turns(resample(given)))
    fit_of_turns = resonance._Fit(rotors.assume_gears(arm()), turns, side, np.full(3, 2e-3), True)
    x, h = 0.3 * np.random.default_rng(1).normal(size=len(fit_of_turns.x)), 1e-6
    slopes = fit_of_turns._slopes(x)
    for k in range(len(x)):
        step = h * (np.arange(len(x)) == k)
        difference = (fit_of_turns._residuals(x + step) - fit_of_turns._residuals(x - step)) / (2.0 * h)
        assert slopes[:, k] == pytest.approx(difference, abs=1e-6 * max(np.abs(slopes[:, k]).max(), 1.0))


def test_the_time_that_is_expected_has_half_a_sample_for_which_torques_are_held() -> None:
    given, _ = shaken("link", 8e3)
    known = arm().with_drives({joint: {"encoder_side": "link"} for joint in arm().joint_names})
    half = 0.5 * float(given.t[1] - given.t[0])
    turns = list(resonance._turns(resample(given)))
    fit = resonance._Fit(rotors.assume_gears(known), turns, "link", np.full(3, 2e-3 + half), True)
    gears = find_gears(known, given, np.full(3, 2e-3))
    np.testing.assert_allclose(gears.stiffness, fit.gears().stiffness, rtol=1e-10)


def test_noise_of_a_residual_is_that_of_sensors_of_the_model_and_of_what_does_not_fit() -> None:
    given = shaken("link", 8e3)[0]
    turns = list(resonance._turns(resample(given)))
    fit = resonance._Fit(rotors.assume_gears(arm()), turns, "link", np.full(3, 3e-3), True)
    for index, turn in enumerate(turns):
        rest, torque = fit._rest(fit.x, index), np.abs(turn.tau.mean(axis=0))
        variance = rest.noise**2 / 2.0 + (0.05 * torque) ** 2 + resonance._ROBUST * np.abs(rest.left) * torque
        np.testing.assert_allclose(fit._noise(fit.x, index), np.sqrt(variance), rtol=1e-12)


def test_encoders_of_few_counts_and_lags_of_gears_spoil_no_first_mode() -> None:
    given, mode = shaken("link", 3e3, 11)
    gears = find_gears(arm(), given, np.array([2e-3, 12e-3, 9e-3]))
    assert gears.side == "link"
    assert gears.mode[0] == pytest.approx(mode, rel=0.02)
    assert gears.mode[1] < mode < gears.mode[2]


def test_a_log_of_100_hz_shows_a_first_mode_by_the_lines_below_half_of_that() -> None:
    given, mode = shaken("link", 3e3)
    gears = find_gears(arm(), Log(*(x[::5] for x in given[:3])), np.full(3, 2e-3))
    assert gears.side == "link"
    assert gears.mode[0] == pytest.approx(mode, rel=0.05)
    assert gears.mode[1] < mode < gears.mode[2]


def test_noise_at_the_lines_is_that_of_white_noise_between_them() -> None:
    std, count = np.array([0.1, 3.0]), 2000
    noise = _noise_at(LINES, std * np.random.default_rng(0).normal(size=(400, count, 2)))
    assert noise == pytest.approx(np.tile(2.0 * std / math.sqrt(count), (len(LINES), 1)), rel=0.05)


def test_a_log_without_a_multisine_says_what_is_expected() -> None:
    with pytest.raises(UnfitLog, match="excite --resonance"):
        found().with_resonance(Log(*(x[:1400] for x in log()[:3])))
    with pytest.raises(UnfitLog, match="excite --resonance"):
        found().with_resonance(Log(*(x[:100] for x in log()[:3])))
    with pytest.raises(UnfitLog, match="excite --resonance"):  # 10 Hz: no line is below half of it
        find_gears(arm(), Log(*(x[::50] for x in shaken("link", 3e3)[0][:3])), np.full(3, 2e-3))


def slow_log_of(side: str, stiffness: float) -> tuple[Log, armgpi.Robot, armgpi.Robot]:
    """Return a slow log of an elastic arm, the arm as its file has it with the side, and as it is."""
    given = armgpi.Robot.load("z1")
    known = given.with_drives(given.drives.with_value("encoder_side", side))
    rotors = expect(given).mean.reshape(given.n, -1)[:, ROTOR]
    real = given.with_armature(1.2 * rotors).with_friction(viscous=0.5, coulomb=0.5)
    K = stiffness * rotors / rotors[0]
    plant: Any = armgpi.ElasticPlant(real, gear_stiffness=K, friction=real.friction, encoder_side=side)
    law = armgpi.GPI.auto(
        armgpi.assume_drives(known), 2e-3, delay=2e-3, bits=16, gains=armgpi.FixedGains(5.0)
    )
    motion = excite(given, 10.0, 0.3, seed=3, floor=None, collisions=False).reference
    run = armgpi.simulate(armgpi.Encoder(plant, 16), law, motion, 10.0, progress=False)
    return Log(run["time"].values, run["q_measured"].values, run["tau_command"].values), known, real


def test_friction_that_changes_its_sign_sharply_is_not_taken_for_elastic_joints() -> None:
    """Slow sines of a stiff arm: what its friction leaves is fitted by compliances too, but badly."""
    rng = np.random.default_rng(4)
    arm = armgpi.Robot.load("ur5")
    rotors = np.array([1.2, 0.9, 1.3, 0.2, 0.25, 0.2])  # [kg m^2]
    coulomb = arm.limits.effort * [0.02, 0.02, 0.02, 0.05, 0.05, 0.05]  # [N m]
    length = 40.0  # [s]
    t = np.arange(0.0, length, 0.002)
    size = rng.normal(size=(5, arm.n))
    size *= 0.8 / np.abs(size).sum(axis=0)
    w = 2.0 * np.pi * np.arange(1, 6) / length
    sines, cosines = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    q = arm.middle() + (1.0 - cosines) @ size
    v, a = (sines * w) @ size, (cosines * w**2) @ size
    tau = arm.with_armature(rotors).inverse_dynamics(q, v, a)
    tau += 0.5 * coulomb * v + coulomb * np.tanh(v / 0.003)
    tau += 0.001 * arm.limits.effort * rng.normal(size=tau.shape)
    count = 2.0 * np.pi / 2**16  # [rad]
    result = identify(Log(t, count * np.round(q / count), tau, "sines"), arm)
    assert result.twist is None
    assert result.robot.armature == pytest.approx(rotors, rel=0.25)


@pytest.mark.parametrize("side", ["link", "motor"])
def test_a_slow_log_of_soft_joints_is_fitted_with_elastic_ones_and_that_is_said(side: str) -> None:
    slow, known, real = slow_log_of(side, 500.0)
    stiff = known.with_drives(known.drives.with_value("stiffness", 1e9))
    off = []
    for robot in (stiff, known):
        result = identify(slow, robot, check_first=False)
        off.append(np.abs(mean_inertia(result.robot) / mean_inertia(real) - 1.0).max())
    assert off[1] < 0.5 * off[0]
    assert off[1] < 0.05
    assert result.twist is not None
    assert result.twist.side == side
    assert any("joints are elastic" in line for line in say_findings(result))
    assert "stiffness" in {row.quantity for row in result.table()}
    assert set(result.drives.sources("stiffness")) == {"assumed"}
    judged = result.validate(slow)  # the same torques, without the slopes by what is known
    assert np.median(judged.identified) == pytest.approx(np.median(result.residuals), rel=0.3)


def test_stiff_joints_are_fitted_as_stiff_ones() -> None:
    assert found().twist is None
    assert not any(row.quantity == "stiffness" for row in found().table())


@pytest.mark.parametrize("chirps_first", [True, False])
def test_chirps_decide_the_side_and_the_multisine_follows(
    chirps_first: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    given, _ = shaken("motor", 3e3)
    monkeypatch.setattr(identification, "find_side", lambda robot, log: chirped("link"))
    both = (
        found().with_side(given).with_resonance(given)
        if chirps_first
        else found().with_resonance(given).with_side(given)
    )
    assert both.gears is not None
    assert both.gears.side == "link"
    assert both.robot.drives.value("encoder_side").tolist() == ["link"] * 3


def chirped(side: str, identified: bool = True) -> Side:
    """Return what chirps of this arm might say: of the third joint there was none in the log."""
    own = np.array([identified, identified, False])
    evidence = np.array([50.0, 40.0, math.nan])
    rotor = np.array([0.33, 0.22, 0.11])
    return Side(side, evidence, rotor, 0.8 * rotor, 1.2 * rotor, own, 3e-3, np.full(3, 1e-5))


def test_the_side_and_what_was_simulated_stay_with_gears_of_a_multisine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(identification, "find_side", lambda robot, log: chirped("motor"))
    given, _ = shaken("motor", 3e3)
    other = copy.copy(found())
    other.simulated = np.full(3, 0.01)
    both = other.with_side(given).with_resonance(given)
    assert both.side is not None
    assert both.side.side == "motor"
    assert both.simulated is other.simulated
    assert both.gears is not None
    assert found().side is None
    assert found().gears is None


def test_the_robot_has_the_side_that_chirps_show(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(identification, "find_side", lambda robot, log: chirped("motor"))
    result = found().with_side(log())
    assert result.robot.drives == result.drives
    assert result.robot.drives.value("encoder_side").tolist() == ["motor", "motor", ""]
    assert found().robot.drives.value("encoder_side").tolist() == ["", "", ""]
    seen: list[armgpi.Robot] = []

    def simulate(path: Any, robot: armgpi.Robot, late: float, grid: Any) -> np.ndarray[Any, Any]:
        seen.append(robot)
        return np.asarray(grid.tau)

    monkeypatch.setattr(identification, "simulate_experiment", simulate)
    result.with_experiment("experiment.yaml")
    assert seen == [result.robot]


def test_chirps_of_torques_without_rotors_are_refused() -> None:
    slow = Log(log().t, log().q, log().tau)
    behind = identify(log(), file(), torque="joint")
    with pytest.raises(ParameterError, match="sensors behind the gears do not feel the rotors"):
        behind.with_side(slow)
    with pytest.raises(ParameterError, match="logs of one kind of torque"):
        behind.with_side(slow._replace(torque="motor"))
    hidden = copy.copy(found())
    hidden._data = copy.copy(found()._data)
    hidden._data.hidden = np.ones(3, dtype=bool)
    with pytest.raises(ParameterError, match="there is no joint's rotor"):
        hidden.with_side(slow)
    with pytest.raises(UnfitLog, match="excite --side"):
        found().with_side(slow)


def table(names: str, q_factor: float = 1.0) -> str:
    """Return a log as CSV under some names."""
    rows = np.column_stack([log().t, q_factor * log().q, log().tau])[::2]
    return "\n".join([names, *(",".join(f"{x:.9g}" for x in row) for row in rows)])


@pytest.mark.parametrize(
    ("names", "factor", "columns"),
    [
        (
            "time [s],q_q1 [deg],q_q2 [deg],q_q3 [deg],tau_q1 [N m],tau_q2 [N·m],tau_q3 [Nm]",
            np.rad2deg(1.0),
            None,
        ),
        ("t,position_q1,position_q2,position_q3,effort_q1,effort_q2,effort_q3", 1.0, None),
        ("clock,a1,a2,a3,m_q1,m_q2,m_q3", 1.0, {"time": "clock", "q": "aNUMBER", "tau": "m_JOINT"}),
    ],
)
def test_columns_have_names_and_units(
    names: str, factor: float, columns: dict[str, str] | None, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(table(names, factor), encoding="utf-8")
    read = read_log(path, file(), columns=columns)
    assert read.q == pytest.approx(log().q[::2], abs=1e-7)
    assert read.tau == pytest.approx(log().tau[::2], abs=1e-6)


def test_joint_states_are_a_log(tmp_path: Path) -> None:
    rollout = armgpi.simulate(
        armgpi.RigidBodyPlant(file()),
        armgpi.GPI(file(), 2e-3),
        armgpi.Hold(file().middle()),
        0.1,
        progress=False,
    )
    logs.write(rollout, tmp_path / "log.mcap")
    read, same = read_log(tmp_path / "log.mcap", file()), read_log(rollout, file())
    assert read.q == pytest.approx(same.q)
    assert read.tau == pytest.approx(same.tau)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_motor_that_turns_with_two_joints_is_found(sign: float) -> None:
    given, motion = log(), excite(file(), 12.0, 0.6, seed=3, floor=None).reference
    z = motion.at(given.t + 1e-3)
    v, a = (x[:, 2] + sign * x[:, 1] for x in (z.v, z.a))

    def torque(v: Any, a: Any) -> Any:
        return 0.1 * a + 0.2 * v + 0.3 * v / np.sqrt(v**2 + 1e-6)

    tau = given.tau.copy()
    tau[:, 1] += sign * torque(v, a)
    tau[:, 2] += torque(v, a) - torque(z.v[:, 2], z.a[:, 2])
    result = identify(given._replace(tau=tau), file())
    rows = {row.quantity: row.value for row in result.table() if " with q2" in row.quantity}
    assert rows == pytest.approx(
        {"rotor with q2": 0.1, "viscous with q2": 0.2, "coulomb with q2": 0.3}, rel=0.15
    )
    assert any("its motor turns with q2" in line for line in say_findings(result))


def test_an_excitation_keeps_out_of_a_box() -> None:
    robot = armgpi.Robot.load("ur5")
    box = [[0.1, -1.0, -1.0], [1.0, 1.0, 1.0]]
    motion = excite(robot, 5.0, 0.3, box=box).reference
    model = robot.pinocchio_model()
    data, tip = model.createData(), model.getFrameId(robot.tip)
    for q in motion.q[::20]:
        pin.framesForwardKinematics(model, data, q)
        assert not (np.array(box)[0] < data.oMf[tip].translation).all() or data.oMf[tip].translation[2] > 1.0
    with pytest.raises(ArmgpiError, match="box"):
        excite(robot, 4.0, 0.3, box=[[-2.0] * 3, [2.0] * 3])
    with pytest.raises(ArmgpiError, match="two opposite corners"):
        excite(robot, 4.0, box=[0.0, 1.0])


def test_an_arm_that_needs_more_than_the_share_to_hold_itself_gets_more() -> None:
    assert (
        excite(
            armgpi.Robot.load("panda", lock=["panda_finger_joint1", "panda_finger_joint2"]), 4.0, 0.12
        ).share.max()
        < 0.13
    )


def test_two_joints_that_are_hardly_explained_may_have_swapped_columns() -> None:
    said = " ".join(say_residuals(file(), np.array([0.46, 0.21, 0.01]), held_out=True))
    assert "So much of q1 and q2 is unexplained that their columns may be swapped" in said
    for one in ([0.46, 0.02, 0.01], [0.1, 0.1, 0.1], [0.46, np.nan, np.nan]):
        assert "swapped" not in " ".join(say_residuals(file(), np.array(one), held_out=True))


def test_a_residual_is_named_by_what_it_follows() -> None:
    times, rng = np.arange(0.0, 20.0, 0.1), np.random.default_rng(0)
    q = np.stack([np.sin(times), np.sin(1.3 * times), rng.normal(size=200)], axis=-1)
    v = np.stack([np.cos(times), 1.3 * np.cos(1.3 * times), rng.normal(size=200)], axis=-1)
    tau = rng.normal(size=(200, 3))
    rest = np.stack([np.sin(9.0 * q[:, 0]), np.exp(-((v[:, 1] / 0.1) ** 2)), rng.normal(size=200)], axis=-1)
    judged = Validation("log", np.full(3, 0.2), np.full(3, 0.5), times, q, v, tau + rest, tau)
    causes = say_causes(file(), judged)
    assert "position" in causes["q1"]
    assert "it sticks" in causes["q2"]
    assert "q3" not in causes
    assert "q2: 20 % is unexplained: it sticks" in " ".join(
        say_residuals(file(), judged.identified, True, causes)
    )


def test_irregular_times_and_torques_of_another_time_at_each_joint_are_taken(tmp_path: Path) -> None:
    """A log as a UR10e's: some 110 Hz, times from anywhere, torques that lag positions joint by joint."""
    rng, motion = np.random.default_rng(0), excite(file(), 20.0, 0.6, seed=3).reference
    t = np.cumsum(rng.choice([0.002, 0.008, 0.012], 2600))
    t, lags = t[t < 19.9], [0.008, 0.016, 0.024]
    tau = np.empty((len(t), 3))
    for j, lag in enumerate(lags):
        z = motion.at(t - lag)
        friction = arm().friction.viscous * z.v + arm().friction.coulomb * z.v / np.sqrt(z.v**2 + 1e-6)
        tau[:, j] = (arm().inverse_dynamics(*z) + friction)[:, j]
    tau += 0.005 * np.abs(tau).max(axis=0) * rng.normal(size=tau.shape)
    head = "time,q_q1,q_q2,q_q3,tau_q1,tau_q2,tau_q3"
    path = tmp_path / "real.csv"
    np.savetxt(path, np.column_stack([t + 798.0, motion.at(t).q, tau]), "%.6f", ",", header=head, comments="")
    result = identify(path, file())
    z = excite(file(), 10.0, 0.6, seed=9, floor=None).reference.at(np.linspace(0.5, 9.5, 100))
    true, own = (each.inverse_dynamics(z.q, z.v, z.a) for each in (arm(), result.robot))
    assert np.sqrt(((own - true) ** 2).mean(axis=0) / (true**2).mean(axis=0)).max() < 0.02
    assert np.diff(-result.lag) == pytest.approx(np.diff(lags), abs=2e-3)
    assert result.robot.friction.coulomb == pytest.approx(arm().friction.coulomb, rel=0.1)


def record_experiment(folder: Path) -> tuple[Path, Log]:
    """Return an experiment, and the log of an arm that has another rotor and friction than its file says."""
    near, motion = file().with_armature([0.2, 0.15, 0.08]), excite(file(), 6.0, 0.6, seed=3)
    files = experiment_files(near, "anthropomorphic3", motion, {})
    # Exact positions: counts of an encoder would be in the torques of both, each in its own way.
    text = files["experiment.yaml"].replace("ideal: false", "ideal: true")
    text = text.replace("gpi_auto", "gpi\n  omega: 10.0") + "sample_time: 0.004\nplant: "
    plant = {"rotor_inertia": [0.3, 0.2, 0.1], "coulomb": 0.5, "viscous": 0.4}
    known = {"engine": "armgpi", "delay": 1}
    for name, own in (("real", {**known, **plant}), ("file", known)):
        (folder / f"{name}.yaml").write_text(text + json.dumps(own), encoding="utf-8")
    (folder / "reference.csv").write_text(files["reference.csv"], encoding="utf-8")
    real = config.build(*config.read(folder / "real.yaml"))
    run = armgpi.simulate(real.plant, real.controllers["gpi"], real.reference, 6.0, progress=False)
    return folder / "file.yaml", read_log(run, file())


def test_an_arm_simulated_with_its_experiment_agrees_with_the_weak_form_or_that_is_said(
    tmp_path: Path,
) -> None:
    path, given = record_experiment(tmp_path)
    same = identify(given, file()).with_experiment(path)
    assert same.simulated is not None
    assert same.simulated.max() < 0.01
    (said,) = say_simulation(same)
    assert "by the weak form" in said
    sign = np.sign(np.gradient(given.q, axis=0))
    loaded = given._replace(tau=given.tau + 0.2 * sign * np.abs(file().gravity(given.q)) * [0.0, 1.0, 0.0])
    other = identify(loaded, file(), check_first=False).with_experiment(path)
    assert say_simulation(other)[1:] == ["misfit: farther off by simulation than by the weak form: q2"]
    with pytest.raises(ArmgpiError, match="off its reference after") as caught:
        found().with_experiment(path)
    assert "\n" not in str(caught.value)


#: Rotors of a real arm whose file has none [kg m^2], and the friction behind a torque sensor [N m].
REAL_ROTORS, RUBBING = np.array([1.2, 1.4, 0.8, 0.15, 0.12, 0.1]), 0.4


@cache
def real_log(torque: str) -> Log:
    """Return a log of an UR5 with rotors: torques of its motors, or of sensors behind its gears."""
    robot = armgpi.Robot.load("ur5")
    motion, t = excite(robot, 10.0, 0.6, seed=3).reference, np.arange(0.0, 10.0, 4e-3)
    z = motion.at(t + 2e-3)
    other = robot.with_armature(REAL_ROTORS) if torque == "motor" else robot
    tau = other.inverse_dynamics(z.q, z.v, z.a) + RUBBING * z.v / np.sqrt(z.v**2 + 1e-6)
    noise = 0.02 * np.random.default_rng(0).normal(size=tau.shape)
    return Log(t, motion.at(t).q, tau + noise, "real")


def test_rotors_are_in_torques_of_motors() -> None:
    result = identify(real_log("motor"), armgpi.Robot.load("ur5"))
    assert not result.hidden.any()
    assert set(result.drives.sources("rotor_inertia")[1:]) == {"identified"}
    assert result.robot.armature[1:] == pytest.approx(REAL_ROTORS[1:], rel=0.05)


@pytest.mark.parametrize("said", [None, "joint"])
def test_torques_of_joints_have_no_rotors_and_these_stay_assumed(said: str | None, tmp_path: Path) -> None:
    robot = armgpi.Robot.load("ur5")
    result = identify(real_log("joint"), robot, torque=said)
    assumed = rotors.assume_rotors(robot)
    assert result.torque == "joint"
    assert result.hidden.all()
    assert result.robot.armature == pytest.approx(assumed.armature)
    for name in ("rotor_inertia", "coulomb", "viscous"):
        assert set(result.drives.sources(name)) == {"assumed"}
    for own, end in zip(
        result.drives.interval("rotor_inertia"), assumed.drives.interval("rotor_inertia"), strict=True
    ):
        assert own == pytest.approx(end)
    # The bodies are those of the truth, since they have to carry no rotor: gravity and D(q) of the links.
    q = robot.middle() + 0.5
    links, true = (arm.mass_matrix(q) - np.diag(arm.armature) for arm in (result.robot, robot))
    assert np.abs(links - true).max() < 0.03 * np.abs(true).max()
    assert any("taken as those of sensors" in str(each) for each in result.findings) == (said is None)
    assert any("sensors behind the gears" in line for line in say_findings(result))
    write_identified(result, tmp_path / "found")
    again = armgpi.Robot.load(tmp_path / "found")
    assert set(again.drives.sources("rotor_inertia")) == {"assumed"}
    assert again.armature == pytest.approx(assumed.armature)
    data = json.loads((tmp_path / "found" / "identification.json").read_text(encoding="utf-8"))
    assert data["torque"] == "joint"
    # Draws of what the log leaves open have rotors about the assumed ones, not four times them.
    drawn = np.array([arm.armature for arm in result.sample(16).robots]) / assumed.armature
    assert (drawn > 0.0).all()
    assert drawn.max() < 3.5


def test_a_rotor_that_no_motor_has_is_a_finding_and_stays_assumed() -> None:
    result = identify(real_log("joint")._replace(torque="motor"), armgpi.Robot.load("ur5"))
    light = [str(each) for each in result.findings if "not plausible for a motor" in str(each)]
    assert len(light) >= 3
    sources = result.drives.sources("rotor_inertia")
    for name, source in zip(result.robot.joint_names, sources, strict=True):
        if any(line.startswith(name) for line in light):
            assert source == "assumed"


def test_friction_far_above_the_file_is_no_other_unit_and_another_unit_is() -> None:
    """Wrists take tens of times what their bodies explain: logs of a real UR10e were refused for it."""
    robot, given = armgpi.Robot.load("ur5"), real_log("motor")
    v = np.gradient(given.q, given.t, axis=0)
    rubbed = given._replace(tau=given.tau + 5.0 * v / np.sqrt(v**2 + 1e-4))
    body = robot.inverse_dynamics(given.q, v, np.gradient(v, given.t, axis=0))[:, 5]
    assert np.sqrt((rubbed.tau[:, 5] ** 2).mean() / (body**2).mean()) > 30.0
    assert not [each for each in identify(rubbed, robot).findings if "N m or N" in str(each)]
    with pytest.raises(UnfitLog, match="in N m or N, at the joint"):
        identify(given._replace(tau=1e3 * given.tau), robot.with_limits(effort=np.full(6, 1e6)))


def test_a_log_says_what_its_torques_are(tmp_path: Path) -> None:
    names = file().joint_names
    for form, torque in (
        ("tau_{}", ""),
        ("tau_joint_{}", "joint"),
        ("tau_motor_{}", "motor"),
        ("current_{}", "motor"),
    ):
        head = ",".join(["time", *(f"q_{x}" for x in names), *(form.format(x) for x in names)])
        rows = np.hstack([log().t[:50, None], log().q[:50], log().tau[:50]])
        np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=head, comments="")
        read = read_log(tmp_path / "log.csv", file())
        assert read.torque == torque
        assert read.currents == (form == "current_{}")
    with pytest.raises(
        ArmgpiError, match=r"torque constants at the joints .* columns of .*log.csv are currents"
    ):
        identify(tmp_path / "log.csv", file())  # of which the last one was
    amperes = tmp_path / "amperes.csv"
    amperes.write_text((tmp_path / "log.csv").read_text().replace("current_q1", "current_q1 [A]"))
    assert read_log(amperes, file()).currents
    with pytest.raises(ArmgpiError, match="motor"):
        read_log(log()._replace(torque="wrist"), file())
    with pytest.raises(ArmgpiError, match="motor"):
        identify(log(), file(), torque="wrist")
    with pytest.raises(ArmgpiError, match="one kind of torque"):
        identify([log()._replace(torque="motor"), log(9)._replace(torque="joint")], file())


def test_a_load_of_currents_is_within_the_torque_constants_until_a_known_load_tells_them(
    cli: Callable[..., Answer], tmp_path: Path
) -> None:
    """Constants that are all 10 % too large make everything 10 % heavier; one known load takes that back."""
    paths = {}
    for name, each in (("free", log()), ("carried", log(9, 0.3))):
        head = ",".join(
            ["time", *(f"q_{x}" for x in file().joint_names), *(f"current_{x}" for x in file().joint_names)]
        )
        paths[name] = tmp_path / f"{name}.csv"
        rows = np.hstack([each.t[:, None], each.q, each.tau / 10.0])
        np.savetxt(paths[name], rows, delimiter=",", header=head, comments="")
    load = identify(paths["free"], file(), current=11.0).load(paths["carried"])
    assert load.mass == pytest.approx(0.33, rel=0.02)
    assert load.scale == 0.1
    assert abs(load.mass - 0.3) < 1.96 * load.mass_std < 0.12 * load.mass
    assert "of the torque constants" in say_load(load)
    options = ("--robot", file().name, "--current", 11, "--load", paths["carried"], "-o", tmp_path / "found")
    answer = cli("identify", paths["free"], *options, "--load-mass", 0.3)
    assert "load: 0.3 ±" in answer.out
    assert "of the torque constants" not in answer.out
    assert "0.91 times those specified" in answer.err or "0.909 times those specified" in answer.err
    said = cli("identify", paths["free"], "--robot", file().name, "--load-mass", 0.3, "-o", tmp_path / "x")
    assert said.code == 2
    assert "--load LOG" in said.err


def test_lags_that_no_delay_has_are_a_finding_and_not_given_to_a_controller() -> None:
    moved = [np.roll(log().tau[:, j], shift) for j, shift in enumerate((0, 12, 0))]
    result = identify(log()._replace(tau=np.stack(moved, axis=1)), file())
    assert np.ptp(result.lag) > 0.015
    assert any("look like that" in str(each) for each in result.findings)
    assert result.late < 0.006
    assert found().late == pytest.approx(LATE * 2e-3 + 1e-3, abs=2e-3)
    assert not [each for each in found().findings if "no delay" in str(each)]


def test_offsets_live_in_the_folder(tmp_path: Path) -> None:
    robot = armgpi.Robot.load("anthropomorphic3")
    real = robot.with_armature([0.3, 0.2, 0.1]).with_friction(viscous=0.4, coulomb=0.5)
    offset = np.array([0.0, 1.0, -0.6])
    plant = armgpi.RigidBodyPlant(real, friction="urdf", loads=[armgpi.Step(offset)])
    controller = armgpi.GPI.auto(robot.with_armature(0.15), 2e-3)
    log = armgpi.simulate(plant, controller, excite(robot, 10.0).reference, 10.0, progress=False)
    found = armgpi.identify(log, robot)
    write_identified(found, tmp_path)
    again = armgpi.Robot.load(tmp_path)
    assert again.drives.value("offset") == pytest.approx(offset, abs=5e-3)
    assert again.drives.sources("offset") == ("identified",) * 3
    # Loaded again, the arm takes the torques that the fit left: nothing is lost.
    said, origin = config.parse(f"format: 1\nrobot: {{name: {tmp_path}}}\nideal: false\n", "some.yaml")
    (load,) = inside(config.build(said, origin).plant).loads  # type: ignore[attr-defined]
    assert load.amplitude == pytest.approx(again.drives.value("offset"), rel=1e-9)


def test_what_cannot_be_negative_stands_behind_what_was_there() -> None:
    prior = Prior(np.zeros(5), np.ones(5), (), (1,))
    more = extend_positive(prior, np.array([2.0, 3.0]), np.array([0.1, 0.2]))
    assert more.positive == (1, 5, 6)
    np.testing.assert_array_equal(more.mean[5:], [2.0, 3.0])
    np.testing.assert_array_equal(more.std[5:], [0.1, 0.2])


@pytest.mark.parametrize("share", [-1.0, 0.3, 1.0])
def test_torques_that_lag_either_way_are_summed_under_the_whole_test_function(share: float) -> None:
    dt, count = 0.01, 20
    tau = np.random.default_rng(1).normal(size=(60, 2))
    form: Any = object.__new__(WeakForm)
    form._grid, form._count = SimpleNamespace(dt=dt, tau=tau), count
    form.starts, lag = np.array([10, 25]), share * MOST_LAG * np.ones(2)
    value, _ = form.torque(lag)
    for found, start in zip(value, form.starts, strict=True):
        u = ((np.arange(60) - start + 0.5) * dt + lag[0]) / (count * dt)  # of all samples; it is 0 outside
        np.testing.assert_allclose(found, bump(u) @ tau * dt, rtol=1e-9)


def test_the_experiment_of_a_motion_has_the_world_of_a_run(
    cli: Callable[..., Answer], tmp_path: Path
) -> None:
    """One truth on the arm: assumed drives, encoders and delay of `armgpi run ARM`, whatever the motion."""
    cli("excite", "ur5", "--seconds", 4, "--share", 0.2, "-o", tmp_path / "first")
    worlds = []
    for name in ("ur5", tmp_path / "first" / "experiment.yaml"):
        run = cli("inspect", name)
        worlds += [line for line in run.err.splitlines() if line.startswith("world:")]
    assert worlds[0] == worlds[1]
    assert "realistic" in worlds[0]
    assert "rotors assumed" in worlds[0]


def test_a_motion_without_drives_uses_no_published_ones(cli: Callable[..., Answer], tmp_path: Path) -> None:
    with_drives = cli("excite", "so101", "--seconds", 4, "--no-floor", "-o", tmp_path / "with")
    without = cli(
        "excite", "so101", "--drives", "none", "--seconds", 4, "--no-floor", "-o", tmp_path / "without"
    )
    assert "Published for this arm" in with_drives.err
    assert "Published" not in without.err
    assert "no rotor inertia but what the file contains" in without.out
    experiment = (tmp_path / "without" / "experiment.yaml").read_text(encoding="utf-8")
    assert "drives: none" in experiment
    assert "rotor_inertia" not in experiment
    _, arm_there = arms.resolve(*config.read(tmp_path / "without" / "experiment.yaml"))
    assert not arm_there.armature.any()


def test_a_motion_of_an_experiment_file_has_its_arm(cli: Callable[..., Answer], tmp_path: Path) -> None:
    path = tmp_path / "arm.yaml"
    arm_there = "{name: anthropomorphic3, rotor_inertia: [0.2, 0.1, 0.05], friction: {coulomb: 0.3}}"
    path.write_text(f"format: 1\nrobot: {arm_there}\n", encoding="utf-8")
    cli("excite", path, "--seconds", 4, "--share", 0.2, "-o", tmp_path / "motion")
    loaded = config.build(*config.read(tmp_path / "motion" / "experiment.yaml"))
    assert loaded.robot.armature == pytest.approx([0.2, 0.1, 0.05])
    assert loaded.robot.friction.coulomb == pytest.approx([0.3] * 3)


def test_the_noise_of_a_residual_is_what_adds_to_it() -> None:
    """Squares add: noise of two real parts, what is not linear, and part of what does not fit at all."""
    rng = np.random.default_rng(2)
    noise, left = rng.uniform(0.1, 0.2, 4), rng.normal(size=4) + 1j * rng.normal(size=4)
    tau = rng.normal(size=(3, 4)) + 1j * rng.normal(size=(3, 4))
    rest = SimpleNamespace(noise=noise, left=left)
    fit: Any = SimpleNamespace(_rest=lambda x, index: rest, turns=[SimpleNamespace(tau=tau)])
    for line, found in enumerate(resonance._Fit._noise(fit, np.zeros(1), 0)):
        torque = abs(sum(tau[period, line] for period in range(3)) / 3)
        squares = 0.5 * noise[line] ** 2 + 0.05**2 * torque**2
        robust = resonance._ROBUST * abs(left[line]) * torque
        assert found == pytest.approx((squares + robust) ** 0.5)


@cache
def carrying(payload: float) -> Log:
    """Return a log of a UR5 whose bodies are those of its file, with a payload away from its flange."""
    robot = armgpi.Robot.load("ur5")
    t = np.arange(0.0, 10.0, 2e-3)
    z = excite(robot, 10.0, 0.5, seed=4, floor=None).reference.at(t)
    there = robot.with_payload(robot.tip, payload, (0.0, 0.08, 0.1)) if payload else robot
    tau = (
        there.inverse_dynamics(z.q, z.v, z.a)
        + rotors.typical_inertia(robot) * z.a
        + 2.0 * np.tanh(z.v / 5e-3)
    )
    return Log(t, z.q, tau)


def said_of(result: Identified) -> str:
    return "\n".join(str(each) for each in result.findings)


def test_each_joint_of_a_first_motion_is_faster_than_a_log_has_to_be() -> None:
    """The first series of this seed leaves joint 4 of an xArm7 at 0.026 rad/s, and 0.04 are asked for."""
    motion = excite(armgpi.Robot.load("xarm7"), 20.0, FIRST_SHARE, 0).reference
    speed = np.abs(motion.at(np.arange(0.0, 20.0, 0.01)).v).max(axis=0)
    assert speed.min() > 0.055


@pytest.mark.parametrize("pair", [(1, 2), (0, 4), (3, 5)])
def test_positions_of_two_joints_that_are_swapped_are_named(pair: tuple[int, int]) -> None:
    """The torques of some pairs follow from the wrong positions as well, and the fit explained them."""
    log, robot = carrying(0.0), armgpi.Robot.load("ur5")
    order = np.arange(robot.n)
    order[list(pair)] = pair[::-1]
    first, second = (robot.joint_names[joint] for joint in pair)
    with pytest.raises(UnfitLog, match=f"positions of '{first}' and '{second}' exchanged") as caught:
        identify(log._replace(q=log.q[:, order]), robot)
    assert "\n" not in str(caught.value)
    found = identify(log._replace(q=log.q[:, order]), robot, check_first=False)
    assert any(f"'{first}' and '{second}' exchanged" in str(finding) for finding in found.findings)


def test_a_payload_is_neither_refused_nor_taken_for_another_robot() -> None:
    """The rated payload turns the weight of wrist_1 and wrist_2 round: it is in the last link alone."""
    result = identify(carrying(5.0), armgpi.Robot.load("ur5"))
    assert result.link_distance < 0.3 * check.ANOTHER_ROBOT
    assert "another robot" not in said_of(result)
    assert result.robot.pinocchio_model().inertias[6].mass > 2.0


def test_the_body_with_the_tip_may_carry_a_tool_and_a_finger_behind_it_not() -> None:
    found = check.check_bodies(("shoulder", "wrist", "finger"), np.array([0.1, 3.0, 3.0]), carrying=1)
    wrist, finger = (str(each) for each in found)
    assert "wrist" in wrist
    assert "a tool or a payload" in wrist
    assert "finger" in finger
    assert "is it this robot" in finger


def joint_terms() -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return the terms of a joint under its weight, (k, 5), moments of a load, (k, 4), and its friction."""
    t = np.linspace(0.0, 20.0, 400)
    q, v, a = np.sin(t) + 0.4 * np.sin(2.3 * t), np.cos(t) + 0.92 * np.cos(2.3 * t), -np.sin(t)
    friction = np.tanh(20.0 * v)
    terms = np.column_stack([np.sin(q), a, friction, v, np.ones_like(t)])
    load = np.column_stack([0.0 * q, np.sin(q), np.cos(q), 0.0 * q])
    return terms, load, friction


@pytest.mark.parametrize(
    ("weight", "severity", "said"),
    [
        (-1.5, "warning", "a payload on the last link"),
        (0.0, "error", "does not contain the gravity torque"),
        (1.0, "", ""),
    ],
)
def test_a_weight_turned_round_is_a_payload_and_a_missing_one_is_refused(
    weight: float, severity: str, said: str
) -> None:
    terms, load, friction = joint_terms()
    torque = weight * terms[:, 0] + 0.3 * friction + 0.2 * terms[:, 1]
    found = list(check._of_scale("joint", terms, torque, 100.0, load, True))
    assert [each.severity for each in found] == ([severity] if severity else [])
    assert all(said in each.message for each in found)


@pytest.mark.parametrize(("sign", "said"), [(1.0, ""), (-1.0, "reversed sign")])
def test_a_payload_is_no_reversed_sign_and_a_reversed_log_is(sign: float, said: str) -> None:
    """All of a reversed torque has the other sign; a payload turns its weight round and no friction."""
    terms, load, friction = joint_terms()
    torque = 1.0 * terms[:, 0] + 0.6 * friction + 0.3 * terms[:, 1]
    torque = -torque if sign < 0.0 else torque - 2.5 * terms[:, 0]
    own, _ = check._explain(terms, torque)
    found = check._misfit(
        armgpi.Robot.load("anthropomorphic3"), 0, terms, torque, load[:, 1:], np.eye(3) * own, False
    )
    assert said in found
    assert bool(found) == bool(said)


def test_a_log_of_another_robot_is_said_to_be_one() -> None:
    """An arm with links of 1.4 times the length, and 2.5 times the mass, whose joints have the same names."""
    robot = armgpi.Robot.load("ur5")
    result = identify(carrying(0.0), armgpi.Robot.load("ur10"), check_first=False)
    assert result.link_distance > check.ANOTHER_ROBOT
    (said,) = (each for each in result.findings if "another robot" in each.message)
    assert said.severity == "warning"
    ratio = float(np.nanmin(result.inertia_ratios))
    assert f"{ratio:.2g} times the inertia" in said.message
    right = identify(carrying(0.0), robot)
    assert right.link_distance < 0.1 * check.ANOTHER_ROBOT
    assert right.inertia_ratios[:3] == pytest.approx([1.0, 1.0, 1.0], rel=0.05)


def test_reversed_torques_are_still_refused_beside_what_a_payload_explains() -> None:
    given = carrying(0.0)
    with pytest.raises(UnfitLog, match="reversed sign"):
        identify(given._replace(tau=-given.tau), armgpi.Robot.load("ur5"))


def test_a_robot_that_carries_its_own_weight_is_still_refused() -> None:
    given, robot = carrying(0.0), armgpi.Robot.load("ur5")
    with pytest.raises(UnfitLog, match="does not contain the gravity torque"):
        identify(given._replace(tau=given.tau - robot.gravity(given.q)), robot)
