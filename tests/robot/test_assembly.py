"""A model that is built joint by joint is what Pinocchio makes of the text of the same URDF.

Of known robots bit by bit; of drawn ones up to the rounding of rotated tensors, which Eigen sums in another
order.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from strategies import urdf_texts

from armgpi import Robot, robots
from armgpi.health import zoo
from armgpi.robot import chains, grippers, reading, urdf, urdf_model
from armgpi.robot.urdf import Urdf

_MJCF = """<mujoco><worldbody><body><joint name="turn" axis="0 1 0"/><geom size="0.1" mass="1"/>
<body pos="0 0 1"><joint name="bend" axis="0 1 0"/><geom size="0.1" mass="1"/></body></body>
</worldbody></mujoco>"""
#: By how much tensors may differ by rounding, of their largest element.
_ROUNDING = 1e-14


def both(document: Urdf, **how: Any) -> tuple[Any, Any]:
    """Return a model that is built, and what Pinocchio reads of its text."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        built = urdf_model.build(document, **how)
    return built.model, pin.buildModelFromXML(built.assembly.urdf())


def assert_is_what_pinocchio_reads(document: Urdf, **how: Any) -> None:
    """Compare all that two models have: joints, frames, places, inertias, limits."""
    model, expected = both(document, **how)
    assert [frame.name for frame in model.frames] == [frame.name for frame in expected.frames]
    assert model == expected


@pytest.mark.parametrize("name", robots.names())
def test_a_known_robot_is_what_pinocchio_reads(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        locked = Robot.load(name).provenance["locked"]
    assert_is_what_pinocchio_reads(reading.read(robots.locate(name)[0]), lock=locked)


@given(urdf_texts())
def test_any_robot_is_what_pinocchio_reads(text: str) -> None:
    model, expected = both(urdf.parse(text, "drawn"))
    assert list(model.names) == list(expected.names)
    assert list(model.parents) == list(expected.parents)
    assert [joint.shortname() for joint in model.joints] == [joint.shortname() for joint in expected.joints]
    for mine, theirs in zip(model.frames, expected.frames, strict=True):
        assert (mine.name, mine.type, mine.parentJoint, mine.parentFrame) == (
            theirs.name,
            theirs.type,
            theirs.parentJoint,
            theirs.parentFrame,
        )
        np.testing.assert_allclose(
            mine.placement.homogeneous, theirs.placement.homogeneous, rtol=0.0, atol=_ROUNDING
        )
    for mine, theirs in zip(model.inertias, expected.inertias, strict=True):
        numbers = theirs.toDynamicParameters()
        atol = _ROUNDING * np.abs(numbers).max()
        np.testing.assert_allclose(mine.toDynamicParameters(), numbers, rtol=0.0, atol=atol)


def test_locked_joints_are_fixed_at_their_values() -> None:
    document = reading.read(robots.locate("panda")[0])
    lock = {"panda_joint2": 0.4, "panda_joint6": 1.9, "panda_finger_joint1": 0.02, "panda_finger_joint2": 0.0}
    assert_is_what_pinocchio_reads(document, lock=lock)


def test_grippers_and_chains_are_asked_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked: list[str] = []

    def noting(module: Any, name: str) -> None:
        function = getattr(module, name)

        def noted(*given: Any) -> Any:
            asked.append(f"{module.__name__.rpartition('.')[2]}.{name}")
            return function(*given)

        monkeypatch.setattr(module, name, noted)

    noting(grippers, "find")
    noting(chains, "of_arms")
    loads: list[Callable[[], object]] = [
        lambda: Robot.load("ur5", lock=["wrist_3_joint"]),
        lambda: Robot.from_pinocchio(pin.buildSampleModelManipulator()),
        lambda: zoo.fingers("panda"),
    ]
    if find_spec("mujoco") is not None:
        path = tmp_path / "arm.xml"
        path.write_text(_MJCF, encoding="utf-8")
        loads += [lambda: Robot.load(path), lambda: Robot.from_mjcf(path)]
    for load in loads:
        asked.clear()
        load()
        assert sorted(asked) == ["chains.of_arms", "grippers.find"]


@pytest.mark.parametrize("name", ["panda", "z1", "so100", "kinova", "ur5_gripper"])
def test_fingers_that_move_are_those_of_the_file(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        robot = Robot.load(name)
    found = grippers.find(reading.read(robots.locate(name)[0]), set(robot.provenance["locked"]))
    joints = [joint for gripper in found for joint in gripper.joints]
    assert zoo.fingers(name) == [joint for joint in joints if joint in robot.joint_names]


def test_nothing_is_written_to_be_parsed_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither Pinocchio nor we read a text that was made of what had been read."""
    sample = pin.buildSampleModelManipulator()
    expected = Robot.load("ur5").mass_matrix(np.zeros(6))

    def refuse(*_: Any) -> Any:
        raise AssertionError("a text was parsed")

    monkeypatch.setattr(pin, "buildModelFromXML", refuse)
    monkeypatch.setattr("armgpi.robot.assembly.tostring", refuse)
    np.testing.assert_array_equal(Robot.load("ur5").mass_matrix(np.zeros(6)), expected)
    monkeypatch.setattr(urdf, "parse", refuse)
    assert Robot.from_pinocchio(sample).n == 6
