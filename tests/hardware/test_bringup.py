"""The stages of a bring-up: what they allow, and what their logs are judged to say."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from armgpi import GPI, ElasticPlant, Hold, MotorFault, RigidBodyPlant, Robot, Supervised, config, simulate
from armgpi.base.verdict import judge as judge_verdict
from armgpi.cli import app
from armgpi.cli.bringup import _print
from armgpi.errors import ConfigError, RolloutError
from armgpi.hardware.export.code import generate
from armgpi.hardware.export.files import _readme
from armgpi.hardware.realtime import run, stages
from armgpi.hardware.realtime.judge import QUESTIONS, _arrays, _of_echo, _of_stage, _of_ways, _Seen, judge
from armgpi.hardware.realtime.stages import CAPS, Folder, Stage
from armgpi.identification.logs import read_log
from armgpi.loop import log as logs
from armgpi.plants.plant import inside
from armgpi.supervisor.state import Reason

ARM = """
robot: {name: anthropomorphic3, rotor_inertia: 0.02}
plant: {encoder_bits: 17}
controllers: [{type: gpi_auto}]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    path = tmp_path_factory.mktemp("arm")
    (path / "arm.yaml").write_text(ARM)
    loaded = config.read(path / "arm.yaml")
    return stages.write(loaded, config.build(*loaded), path / "bringup")


def kinds(folder: Folder, kind: str) -> list[Stage]:
    return [stage for stage in folder.stages if stage.kind == kind]


def recorded(
    folder: Folder, stage: Stage, turned: int | None = None, seconds: float = np.inf
) -> tuple[Path, Any]:
    """The log of a stage on a simulated arm, one of whose motors may turn the other way, and its rollout."""
    experiment = folder.experiment(stage)
    ((plant, controller),) = experiment.runs.values()
    if turned is not None:
        plant = MotorFault(plant, onset=0.0, gain=np.where(np.arange(3) == turned, -1.0, 1.0))
    given = {"clock": "simulated", "supervisor": experiment.supervisor, "dry_run": stage.kind == "dry"}
    outcome = run(plant, controller, experiment.reference, min(seconds, experiment.t_final), **given)
    assert outcome.log is not None
    return logs.write(outcome.log, folder.path / f"{stage.name}.armlog"), outcome


@pytest.fixture(scope="module")
def dry(folder: Folder) -> Any:
    """The rollout and log of the dry run; whoever changes rows takes a copy."""
    return recorded(folder, folder.stages[0])[1]


def test_each_stage_has_a_file_with_caps_that_grow(folder: Folder) -> None:
    assert [each.kind for each in folder.stages] == [
        *("dry", *["pulse"] * 3, *["joint"] * 3, "excite", "slow", "full")
    ]
    assert stages.read(folder.path) == folder
    before = np.zeros(3)
    for stage in (kinds(folder, kind)[0] for kind in ("pulse", "joint", "excite")):
        experiment = folder.experiment(stage)
        supervised = Supervised(next(iter(experiment.controllers.values())), experiment.supervisor)
        own = supervised.bounds
        assert (own.cap > before).all()
        assert (own.cap < experiment.robot.limits.effort).all()
        t = np.arange(0.0, experiment.t_final, 1e-3)
        speed = np.abs(experiment.reference.at(t).v).max(axis=0)
        assert (speed < own.speed / supervised.dt).all()  # the motion leaves room below its own cap
        before = own.cap


def test_friction_that_the_file_tells_stops_no_sound_arm(tmp_path: Path) -> None:
    text = ARM.replace("rotor_inertia: 0.02", "rotor_inertia: 0.02, friction: {coulomb: 1.0}")
    (tmp_path / "arm.yaml").write_text(text.replace("plant: {", "plant: {friction: urdf, "))
    loaded = config.read(tmp_path / "arm.yaml")
    folder = stages.write(loaded, config.build(*loaded), tmp_path / "bringup")
    stage = kinds(folder, "pulse")[2]
    path, outcome = recorded(folder, stage)
    assert np.abs(outcome.rollout["tau"].values[:, 2]).max() > 1.0  # friction was overcome
    assert not judge(folder, [path]).findings


def test_a_hand_holds_the_links_of_an_arm_whose_gears_twist(tmp_path: Path) -> None:
    text = "robot: {name: z1, lock: [jointGripper]}\nplant: {encoder_bits: 18, payload: {mass: 0.5}}\n"
    (tmp_path / "z1.yaml").write_text(text + "controllers: [{type: gpi_auto}]\n")
    loaded = config.read(tmp_path / "z1.yaml")
    folder = stages.write(loaded, config.build(*loaded), tmp_path / "bringup")
    first, slow, full = (folder.experiment(folder.stages[k]) for k in (0, -2, -1))
    loads = [each.config.plant.payload for each in (first, slow, full)]
    assert loads[:2] == [None, None]  # what nobody told the model comes with the full speed
    assert loads[2] is not None
    ((plant, controller),) = first.runs.values()
    assert isinstance(inside(plant), ElasticPlant)
    given: Any = {"clock": "simulated", "supervisor": first.supervisor, "dry_run": True}
    log = run(plant, controller, first.reference, 0.3, **given).log
    assert log is not None
    assert log.fault is None
    away = log.samples["q_measured"] - first.reference.at(log.t).q
    assert np.abs(away).max() < 2.0 * np.pi / 2**18


def test_an_arm_without_rotors_is_no_wrong_arm(tmp_path: Path) -> None:
    pytest.importorskip("casadi", reason="casadi writes the C of the loop")
    (tmp_path / "arm.yaml").write_text(ARM.replace(", rotor_inertia: 0.02", ""))
    loaded = config.read(tmp_path / "arm.yaml")
    folder = stages.write(loaded, config.build(*loaded), tmp_path / "bringup")
    (stage,) = kinds(folder, "excite")
    experiment = folder.experiment(stage)
    ((plant, controller),) = experiment.runs.values()
    given: Any = {"supervisor": experiment.supervisor, "progress": False, "backend": "compiled"}
    rollout = simulate(plant, controller, experiment.reference, experiment.t_final, **given)
    t, names = rollout["time"].values[:-1], folder.stages[0].joints
    at = experiment.reference.at(t)
    rows = {"q_measured": rollout["q_measured"].values[:-1], "q_ref": at.q, "v_ref": at.v, "a_ref": at.a}
    log = logs.of_samples(names, controller.dt, rows, rollout["tau_command"].values[:-1])
    path = logs.write(log, folder.path / f"{stage.name}.armlog")
    verdict = judge(folder, [path])
    assert not verdict.findings
    assert verdict.passed["model"] == names
    file = path.with_suffix(".yaml")  # that names rotors which are not there
    file.write_text(file.read_text().replace("anthropomorphic3", "anthropomorphic3\n  rotor_inertia: 0.2"))
    verdict = judge(folder, [path])
    assert {(each.question, each.joint) for each in verdict.findings} == {("model", name) for name in names}
    assert not verdict.passed["model"]


def test_the_readme_of_an_exported_stage_says_how_it_is_run(folder: Folder) -> None:
    for stage in (kinds(folder, "pulse")[0], folder.stages[-1]):
        experiment = folder.experiment(stage)
        supervised = Supervised(next(iter(experiment.controllers.values())), experiment.supervisor)
        text = _readme(generate(supervised, "double"), 0, 0, None, "bare")
        assert ("**This is a stage of a bring-up**" in text) == (stage.kind == "pulse")


def test_a_dry_run_tells_positions_and_never_what_only_a_torque_tells(folder: Folder, dry: Any) -> None:
    outcome, path = dry, logs.write(dry.log, folder.path / f"{folder.stages[0].name}.armlog")
    assert outcome.log.fault is None
    verdict = judge(folder, [path])
    assert not verdict.findings
    names = folder.stages[0].joints
    assert all(verdict.passed[key] == names for key in ("order", "sign", "unit", "zero", "weight"))
    torques = ("command order", "command sign", "command unit", "lag", "model", "carried")
    assert all(verdict.untested[key] == names for key in torques)
    assert verdict.following == folder.stages[1]
    assert set(QUESTIONS) == set(verdict.passed)


def test_a_simulated_robot_that_carries_its_weight_reports_it_in_a_dry_run(folder: Folder) -> None:
    robot = Robot.load("anthropomorphic3")
    there = np.array([0.1, 0.4, -0.5])
    free, seconds = robot.with_gravity((0.0, 0.0, 0.0)), 0.05
    given: Any = {"clock": "simulated", "dry_run": True}
    for arm in (robot, free):
        log = run(RigidBodyPlant(arm), GPI(arm, 1e-3), Hold(there), seconds, **given).log
        assert log is not None
        np.testing.assert_allclose(
            log.samples["applied"][1:], robot.gravity(there) + np.zeros((49, 3)), atol=1e-9
        )


@pytest.mark.parametrize(
    ("change", "question"),
    [
        (lambda q: q * [1.0, -1.0, 1.0], "sign"),
        (lambda q: q[:, [0, 2, 1]], "order"),
        (np.degrees, "unit"),
        (lambda q: q * [1.0, 2.0, 1.0], "unit"),
        (lambda q: q + np.array([0.0, 0.3, 0.0]), "zero"),
        (lambda q: q + [0.0, 0.0, 1.0] * q[:, 1:2], "order"),
    ],
)
def test_a_dry_run_tells_what_is_wrong_with_positions(
    folder: Folder, dry: Any, change: Any, question: str
) -> None:
    rows = dry.log.rows.copy()
    start = rows["q_measured"][0].copy()
    rows["q_measured"] = start + change(rows["q_measured"] - start)
    path = logs.write(dry.log._replace(rows=rows), folder.path / f"{folder.stages[0].name}.armlog")
    verdict = judge(folder, [path])
    finding = verdict.findings[0]
    assert finding.question == question
    assert finding.joint not in verdict.passed[question]


def test_a_mounting_is_tested_where_a_tilted_base_would_show(
    folder: Folder, dry: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = folder.path / f"{folder.stages[0].name}.armlog"
    robot, rows = folder.experiment(folder.stages[0]).robot, dry.log.rows.copy()
    tilts = [(a * np.sin(np.radians(20.0)), b * np.sin(np.radians(20.0))) for a, b in ((1, 0), (0, 1))]

    def found(weight: Any) -> Any:
        rows["applied"] = weight.gravity(rows["q_measured"])
        logs.write(dry.log._replace(rows=rows), path)
        return judge(folder, [path])

    down = -np.cos(np.radians(20.0))
    shown = [bool(found(robot.with_gravity(9.81 * np.array([*xy, down]))).findings) for xy in tilts]
    verdict = found(robot)
    assert verdict.passed["weight"] == folder.stages[0].joints
    assert bool(verdict.passed["mounting"]) == all(shown)
    # Where that weight is wrong in one joint, the mounting holds for none.
    monkeypatch.setattr("armgpi.hardware.realtime.judge._tells_mounting", lambda *_: True)
    assert found(robot).passed["mounting"] == folder.stages[0].joints
    upside_down = found(robot.with_gravity((0.0, 0.0, 9.81)))
    assert upside_down.findings
    assert not upside_down.passed["mounting"]


def test_friction_that_a_robot_may_bear_is_that_of_where_it_begins(
    folder: Folder, dry: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a dry run and in a stage: later the arm may have moved, by hand or by its torques."""
    places = []

    def seen(robot: Robot, q: Any) -> Any:
        places.append(np.array(q))
        return stages.moving_torque(robot, q)

    monkeypatch.setattr("armgpi.hardware.realtime.judge.moving_torque", seen)
    joint = kinds(folder, "joint")[0]
    for stage, log in ((folder.stages[0], dry.log), (joint, recorded(folder, joint)[1].log)):
        rows = log.rows.copy()
        rows["q_measured"][1] = rows["q_measured"][0] + 1e-6
        if stage.kind == "dry":  # as a robot does that carries its own weight
            rows["applied"] = folder.experiment(stage).robot.gravity(rows["q_measured"])
        changed = log._replace(rows=rows)
        path = logs.write(changed, folder.path / f"{stage.name}.armlog")
        places.clear()
        judge(folder, [path])
        assert places
        for place in places:
            np.testing.assert_array_equal(place, changed.samples["q_measured"][0])


def test_a_log_is_identified_from_memory_as_from_its_file(folder: Folder, dry: Any, tmp_path: Path) -> None:
    path = logs.write(dry.log, tmp_path / "dry.armlog")
    robot = folder.experiment(folder.stages[0]).robot
    for one, other in zip(read_log(dry.log, robot)[:3], read_log(path, robot)[:3], strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_motor_that_turns_the_other_way_is_found_by_its_pulse(folder: Folder) -> None:
    stage = kinds(folder, "pulse")[1]
    path, good = recorded(folder, stage)
    assert good.log.fault is None
    verdict = judge(folder, [path])
    assert not verdict.findings
    assert verdict.passed["command sign"] == stage.joints
    path, _ = recorded(folder, stage, turned=1, seconds=1.0)
    (finding,) = judge(folder, [path]).findings
    # The arm falls by the torque that should carry it: that is seen before it moves.
    assert (finding.question, finding.joint) == ("carried", "q2")


def test_the_commands_write_stages_and_judge_a_log(folder: Folder, dry: Any, tmp_path: Path) -> None:
    (tmp_path / "arm.yaml").write_text(ARM)
    runner = CliRunner()
    done = runner.invoke(app, ["bringup", str(tmp_path / "arm.yaml"), "-o", str(tmp_path / "b")])
    assert done.exit_code == 0
    assert "next: 10-dry" in done.output
    path = logs.write(dry.log, folder.path / f"{folder.stages[0].name}.armlog")
    done = runner.invoke(app, ["bringup", "check", str(path)])
    assert done.exit_code == 0
    assert "not tested  a torque moves its joint the way it points" in done.output
    rows = dry.log.rows.copy()
    rows["q_measured"] *= -1.0
    logs.write(dry.log._replace(rows=rows), path)
    assert runner.invoke(app, ["bringup", "check", str(path)]).exit_code == 1
    index = yaml.safe_load((folder.path / stages.INDEX).read_text())
    assert len(index["stages"]) == len(folder.stages)


def test_what_is_no_bring_up_is_said(folder: Folder, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="is a log of no stage"):
        folder.stage(Path("motion.armlog"))
    (tmp_path / stages.INDEX).write_text("format: 1\nstages: [1]\n")
    with pytest.raises(ConfigError, match="no list that"):
        stages.read(tmp_path)
    assert {"pulse", "joint", "excite", "slow"} == set(CAPS)


def test_a_torque_that_is_off_in_one_joint_is_no_other_scale_of_the_weight(folder: Folder, dry: Any) -> None:
    """The first joint carries no weight: what it reports beside it leaves the sum over all joints at 1."""
    rows = dry.log.rows.copy()
    weight = folder.experiment(folder.stages[0]).robot.gravity(rows["q_measured"])
    path = folder.path / f"{folder.stages[0].name}.armlog"
    for applied, said in ((weight + np.array([20.0, 0.0, 0.0]), False), (2.0 * weight, True)):
        rows["applied"] = applied
        logs.write(dry.log._replace(rows=rows), path)
        findings = [each for each in judge(folder, [path]).findings if each.question == "weight"]
        assert findings
        assert all(("times the gravity torque" in each.seen) is said for each in findings)


def test_ten_samples_are_the_least_that_a_stage_is_judged_by() -> None:
    robot = Robot.load("anthropomorphic3")
    arrays = ("q_measured", "q_ref", "tau")
    kind = [(name, float, 3) for name in arrays] + [(name, int) for name in ("applied", "reason", "joint")]

    def log(count: int) -> Any:
        header = {"joints": list(robot.joint_names)}
        return SimpleNamespace(
            samples=np.zeros(count, kind), header=header, t=1e-3 * np.arange(count), source="stage.log"
        )

    assert len(_arrays(log(10), robot).q) == 10
    with pytest.raises(RolloutError, match="has 9 samples"):
        _arrays(log(9), robot)


def test_a_joint_answers_by_how_far_it_goes_from_its_first_sample() -> None:
    """It goes 0.06 rad from where it began, half of them in a sample: 0.1 rad were asked for."""
    robot = Robot.load("anthropomorphic3")
    t, zeros = np.arange(5) * 0.1, np.zeros((5, 3))
    q, q_ref = zeros.copy(), zeros.copy()
    q[1:, 1], q_ref[1:, 1] = (0.03, 0.06, 0.06, 0.06), 0.1
    seen = _Seen(robot.joint_names, t, q, q_ref, zeros, zeros, zeros, 0, 0, 5)
    stage: Any = SimpleNamespace(joints=("q2",))
    assert not list(_of_stage(seen, stage, robot, robot, {}))
    q[1:, 1] = (0.02, 0.04, 0.04, 0.04)
    (found,) = _of_stage(seen, stage, robot, robot, {})
    assert (found.question, found.joint) == ("command order", "q2")
    assert found.seen == "moved 0.04 where its reference moved 0.1"


@pytest.mark.parametrize(
    ("columns", "factors", "said"),
    [
        ([0, 1, 2], [1.0, 1.0, 1.0], []),
        ([0, 1, 2], [1.0, -1.0, 1.0], [("command sign", "q2", "-1 times the torque that was sent")]),
        ([0, 1, 2], [1.0, 1.0, 30.0], [("command unit", "q3", "30 times the torque that was sent")]),
        (
            [1, 0, 2],
            [1.0, 1.0, 1.0],
            [
                ("command order", "q1", "the one that q2 reports"),
                ("command order", "q2", "the one that q1 reports"),
            ],
        ),
    ],
)
def test_a_torque_that_a_robot_was_given_is_told_by_order_sign_and_unit(
    columns: list[int], factors: list[float], said: list[tuple[str, str, str]]
) -> None:
    robot = Robot.load("anthropomorphic3")
    t = np.arange(60) * 0.01
    tau = np.stack([40.0 * np.sin(3.0 * t), 60.0 * np.cos(2.0 * t), 20.0 * np.sin(7.0 * t + 1.0)], axis=1)
    applied = np.roll(tau, 1, axis=0)[:, columns] * factors  # of the sample before
    zeros = 0.0 * tau
    seen = _Seen(robot.joint_names, t, zeros, zeros, tau, zeros, applied, 0, 0, len(t))
    found = [(each.question, each.joint, each.seen) for each in _of_echo(seen, robot)]
    assert len(found) == len(said)
    for own, wanted in zip(found, said, strict=True):
        assert own[:2] == wanted[:2]
        assert own[2].endswith(wanted[2])


def test_caps_are_wider_by_the_friction_that_is_specified(tmp_path: Path) -> None:
    """What holds and moves the model does not have it, so a joint that rubs may take so much more."""
    caps = []
    for name, friction in (("without", ""), ("with", ", friction: {coulomb: [0.3, 0.2, 0.1]}")):
        path = tmp_path / name
        path.mkdir()
        (path / "arm.yaml").write_text(ARM.replace("0.02}", f"0.02{friction}}}"))
        loaded = config.read(path / "arm.yaml")
        written = stages.write(loaded, config.build(*loaded), path / "bringup")
        stage = kinds(written, "joint")[0]
        own = written.experiment(stage).supervisor
        assert own is not None
        caps.append(np.asarray(own.torque_cap))
    np.testing.assert_allclose(caps[1] - caps[0], [0.3, 0.2, 0.1], atol=2e-3)  # files round


def test_what_was_tested_of_some_joints_is_said_with_their_names(
    folder: Folder, capsys: pytest.CaptureFixture[str]
) -> None:
    every = folder.stages[0].joints
    passed = {"command order": every, "command sign": every[:1], "mounting": ()}
    seen: Any = SimpleNamespace(findings=(), passed=passed, untested={"carried": every[1:]}, following=None)
    _print(seen, folder, judge_verdict(True, "the stage is fine", []))
    said = capsys.readouterr().out
    assert said.count("tested") == 3
    assert f"{QUESTIONS['command order']}\n" in said
    assert f"{QUESTIONS['command sign']}: {every[0]}\n" in said
    assert f"{QUESTIONS['carried']}: {', '.join(every[1:])}\n" in said


def test_a_joint_moved_the_other_way_has_its_sign_named_and_one_that_is_where_it_began_has_not() -> None:
    """Where all joints were farthest one may be back at its start: 0 has no sign."""
    names, way = ("first", "second"), np.array([0.1, -0.1])

    def found(first: float) -> list[tuple[str, str | None]]:
        peaks = np.array([[first, 0.0], [0.0, -0.1]])
        return [(each.question, each.joint) for each in _of_ways(names, way, peaks, np.array([0.1, 0.1]))]

    assert found(-0.1) == [("sign", "first")]
    assert found(0.1) == []
    assert found(0.0) == []


def test_a_stopped_stage_tells_how_far_its_joint_was_from_where_it_began() -> None:
    robot = Robot.load("anthropomorphic3")
    q_ref = np.ones((5, 3))
    q_ref[1:, 1] += 0.1
    q = np.ones((5, 3))
    q[2:, 1] += 0.06
    dev = np.zeros((5, 3))
    dev[2:, 1] = 3.0
    zeros = np.zeros((5, 3))
    reason, t = int(Reason.RESPONSE), 0.1 * np.arange(5)
    seen = _Seen(robot.joint_names, t, q, q_ref, zeros, dev, zeros, reason, 1, 3)
    stage: Any = SimpleNamespace(joints=("q2",), way=(0.1,))
    (found,) = _of_stage(seen, stage, robot, robot, {})
    assert found.joint == "q2"
    assert "the torque differs by +3 N m or N from the model's, the position by +0.06" in found.seen
