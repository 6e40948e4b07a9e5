"""The worlds: what they assume, that given keys win, and that old files keep their meaning."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from commands import Answer

from armgpi import Robot, config, robots
from armgpi.cli import pictures
from armgpi.config import building, references
from armgpi.identification import arm as identification
from armgpi.identification import writing
from armgpi.plants.plant import inside
from armgpi.references.waypoints import Waypoints

#: A pendulum with friction on its joint, and a motor that bears it.
ARM = """<robot name="rough"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 -0.2"/>
<mass value="2"/><inertia ixx="0.03" iyy="0.03" izz="0.003" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="40" velocity="3"/>
<dynamics damping="0.7" friction="1.3"/></joint></robot>"""


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "rough.urdf"
    path.write_text(ARM, encoding="utf-8")
    return path


def built(arm: Path, **more: Any) -> building.Experiment:
    given = {"robot": {"name": str(arm)}, **more}
    return building.build(config.check(given, config.Origin("test")))


def friction_of(experiment: building.Experiment) -> Any:
    return vars(inside(experiment.plant))["friction"]


def test_friction_of_the_urdf_acts_in_the_realistic_plant_and_is_fed_forward(arm: Path) -> None:
    found = built(arm, ideal=False)
    np.testing.assert_array_equal(np.ravel(friction_of(found)), [0.7, 1.3])
    (section,) = found.config.controllers
    assert section.friction_feedforward is True
    assert (found.config.plant.encoder_bits, found.config.plant.delay) == (16, 1)
    assert found.robot.friction.viscous == Robot.load(arm).friction.viscous


@pytest.mark.parametrize("more", [{}, {"ideal": True}, {"ideal": False, "plant": {"friction": "none"}}])
def test_old_files_the_ideal_world_and_a_given_key_have_none(arm: Path, more: dict[str, Any]) -> None:
    assert friction_of(built(arm, **more)) is None


def test_old_files_and_the_ideal_world_have_exact_positions_and_the_printed_controller(arm: Path) -> None:
    for more in ({}, {"ideal": True}):
        found = built(arm, **more)
        assert found.config.plant.encoder_bits is None
        assert [each.type for each in found.config.controllers] == ["gpi"]
        assert not found.robot.armature.any()


def test_given_keys_win_over_the_realistic_world(arm: Path) -> None:
    found = built(arm, ideal=False, plant={"encoder_bits": 12, "delay": 3}, controllers=[{"type": "pid"}])
    assert (found.config.plant.encoder_bits, found.config.plant.delay) == (12, 3)
    assert [each.type for each in found.config.controllers] == ["pid"]
    line = building.summary(found)
    assert "12-bit encoders, delay 3 samples" in line
    assert "(assumed)" not in line
    assert "viscous up to 0.7, Coulomb up to 1.3" in line


def test_an_experiment_that_is_written_out_is_the_same_one(arm: Path) -> None:
    found = built(arm, ideal=False)
    again = building.build(*config.parse(config.dump(found.config), "written"))
    assert again.config.plant == found.config.plant
    np.testing.assert_array_equal(np.ravel(friction_of(again)), np.ravel(friction_of(found)))


def test_only_our_own_arms_are_ideal() -> None:
    assert robots.is_textbook("anthropomorphic3")
    assert not robots.is_textbook("ur5")
    assert not robots.is_textbook("rough.urdf")


#: Command -> how it is called with an experiment file.
COMMANDS = {
    "run": ("--t-final", 0.1),
    "compare": ("--t-final", 0.1),
    "inspect": (),
    "certify": ("--allow-part",),
    "bound": (),
    "export": ("-o", "out"),
    "loop": ("--t-final", 0.1),
    "play": ("-o", "page.html"),
    "sweep": ("--rollouts", 4, "--out", "swept"),
    "tune": ("--evaluations", 2, "--out", "tuned"),
}


#: Commands without a move.
STILL = {"inspect", "certify", "identify"}
#: Commands that need a section of an experiment file.
STUDIES = {"sweep": "vary: {plant.delay: {choices: [1, 1]}}\n", "tune": "tune: {scenarios: 1, held_out: 1}\n"}


def named(kind: str, arm: Path, cli: Callable[..., Answer]) -> dict[str, object]:
    """Return what each command is given in the place of a robot, for an arm of a kind."""
    name = {"name": "finger_edu", "urdf": arm, "file": "arm.yaml"}[kind]
    given: dict[str, object] = dict.fromkeys([*COMMANDS, "identify"], name)
    if kind == "file":
        assert cli("new", arm, "-o", "arm.yaml").code == 0
    for command, section in STUDIES.items():
        text = f"robot: {{name: {name}}}\nideal: false\n{section}"
        if kind == "file":
            own = Path("arm.yaml").read_text(encoding="utf-8")
            text = own if command == "sweep" else own + section
        given[command] = Path(f"{command}.yaml")
        Path(f"{command}.yaml").write_text(text, encoding="utf-8")
    return given


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["name", "urdf", "file"])
def test_eleven_commands_have_the_same_arm_line_and_move(
    kind: str, arm: Path, tmp_path: Path, cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch
) -> None:
    if kind == "name" and "finger_edu" not in robots.names():
        pytest.skip("the robots extra is not installed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(pictures, "page_to_play_with", lambda experiment, frame: experiment.robot.name)
    monkeypatch.setattr(identification, "identify", lambda *_, **__: SimpleNamespace())
    monkeypatch.setattr(writing, "write_identified", lambda *_: sys.exit(0))
    moves: list[str] = []

    def record(points: Any, durations: Any, holds: Any) -> Waypoints:
        moves.append(str([np.round([*map(np.ravel, points)], 12).tolist(), durations, holds]))
        return Waypoints(points, durations, holds)

    monkeypatch.setattr(references, "Waypoints", record)
    said, moved = {}, {}
    for command, robot in named(kind, arm, cli).items():
        moves.clear()
        first = ("log.csv", "--robot") if command == "identify" else ()
        answer = cli(command, *first, robot, *COMMANDS.get(command, ()))
        (said[command],) = [line for line in answer.err.splitlines() if line.startswith("world:")]
        moved[command] = set(moves)
    compared = said.pop("compare")
    arm_alone, _ = said["inspect"].split("; controller ")
    assert compared.startswith(arm_alone)
    assert {line.removesuffix(". Values: --explain") for line in said.values()} == {said["inspect"]}
    assert "elastic joints, rotors assumed" in said["run"]
    assert len(moved["run"]) == 1
    for command in moved.keys() - STILL:
        assert moved[command] == moved["run"], command


@pytest.mark.parametrize("command", ["certify", "bound"])
def test_a_command_that_cannot_judge_the_arm_says_which_it_judges(
    command: str, arm: Path, cli: Callable[..., Answer]
) -> None:
    answer = cli(command, arm)
    (line,) = [line for line in answer.err.splitlines() if line.startswith("evaluated instead:")]
    assert "stiff joints, no rotors" in line
    textbook = cli(command, "anthropomorphic3", *(("--payload", "0:0.1") if command == "certify" else ()))
    assert "evaluated instead" not in textbook.err


def test_an_option_that_names_sensors_leaves_the_world(arm: Path, cli: Callable[..., Answer]) -> None:
    lines = set()
    for options in ((), ("--encoder-bits", 16), ("--delay", 1)):
        answer = cli("run", arm, "--t-final", 0.1, *options)
        (line,) = [each for each in answer.err.splitlines() if each.startswith("world:")]
        lines.add(line.replace(" (assumed)", ""))
    assert len(lines) == 1
