"""What each error says, word by word and number by number, and what it keeps of what was given."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from armgpi import errors
from armgpi.errors import Remedy

#: Error -> what it says, and what its attributes are.
SAID: tuple[tuple[errors.ArmgpiError, str, dict[str, Any]], ...] = (
    (
        errors.ArrayError("tau", "expected shape (3,)"),
        "tau: expected shape (3,)",
        {"name": "tau"},
    ),
    (
        errors.ParameterError("delay", -1.5, "0 or more [s]"),
        "delay must be 0 or more [s], got -1.5",
        {"name": "delay", "value": -1.5},
    ),
    (
        errors.NameNotFound("joint", "elbo", ["wrist", "elbow"], "see robot.joint_names"),
        "there is no joint named 'elbo'; did you mean 'elbow'? (known: wrist, elbow); see robot.joint_names",
        {"kind": "joint", "name": "elbo", "valid": ("wrist", "elbow")},
    ),
    (
        errors.UrdfError("a.urdf", "has no <link>", "base"),
        "a.urdf: has no <link>",
        {"source": "a.urdf", "element": "base"},
    ),
    (
        errors.LimitError("position", "q2", 4.0, -1.5, 2.5, "move it less"),
        "position of joint 'q2' is 4, outside [-1.5, 2.5]; move it less",
        {"joint": "q2", "value": 4.0, "lower": -1.5, "upper": 2.5},
    ),
    (
        errors.UnfitLog(["one", "two", "three"]),
        "no arm can be identified from the log: one; two; three",
        {"reasons": ("one", "two", "three")},
    ),
    (
        errors.UnfitLog(["one", "two", "three", "four"]),
        "no arm can be identified from the log: one; two; three; and 1 more",
        {"reasons": ("one", "two", "three", "four")},
    ),
    (
        errors.UnfitLog(["one"]),
        "no arm can be identified from the log: one",
        {"reasons": ("one",)},
    ),
    (
        errors.UnreadableTrajectory("a.csv", "has no column t"),
        "a.csv: has no column t",
        {"source": "a.csv"},
    ),
    (
        errors.EffortError("q1", 0.0, enough=7.0),
        "joint 'q1' has effort limit 0, so no controller can move it; give it one with "
        "robot.with_limits(effort={'q1': 7.0}), or lock it",
        {"joint": "q1", "effort": 0.0, "remedies": (Remedy("effort", ("q1",), 7.0), Remedy("lock", ("q1",)))},
    ),
    (
        errors.EffortError("q1", 0.5, ["q2", "q3"], movable=False),
        "joint 'q1' has effort limit 0.5, so no controller can move it (nor have q2, q3 more); give them "
        "some with robot.with_limits(effort={'q1': 10.0, 'q2': 10.0, 'q3': 10.0})",
        {"remedies": (Remedy("effort", ("q1", "q2", "q3"), 10.0),)},
    ),
    (
        errors.ReachError((1.0, 2.0, 3.0), 0.25, "it is 0.25 m too far"),
        "it is 0.25 m too far",
        {"point": (1.0, 2.0, 3.0), "distance": 0.25},
    ),
    (
        errors.PayloadError("ur5", "tool0", (0.5, 8.0), 3.0, 4.0, 5.0, 6.0, 7.0),
        "no bandwidth is stable for 0.5 to 8 kg at 'tool0' of 'ur5': a nominal model with 8 kg has 3 times "
        "too much inertia when the arm carries 0.5 kg, which leaves omega_c = 4 rad/s, below 5; use 0.5 to "
        "6 kg or 7 to 8 kg, a shorter sample time, or specify rotor inertia that the URDF does not contain "
        "(robot.with_armature)",
        {"asked": (0.5, 8.0), "delta": 3.0, "omega_c": 4.0, "heaviest": 6.0, "lightest": 7.0},
    ),
    (
        errors.ConfigError("a.yaml", "plant.delay", "expected a number", 3),
        "a.yaml:3: plant.delay: expected a number",
        {"source": "a.yaml", "key": "plant.delay", "line": 3},
    ),
    (
        errors.ConfigError("a.yaml", "", "is empty"),
        "a.yaml: is empty",
        {"key": "", "line": None},
    ),
    (
        errors.ModelError("arm.py", "gravity", "returned nothing"),
        "arm.py: gravity: returned nothing",
        {"model": "arm.py", "function": "gravity"},
    ),
    (
        errors.ModelError("arm.py", "", "has no function"),
        "arm.py: has no function",
        {"function": ""},
    ),
    (
        errors.MissingPackage("mujoco", "mujoco"),
        "needs the package 'mujoco': pip install mujoco",
        {"package": "mujoco", "extra": "mujoco"},
    ),
)


@pytest.mark.parametrize("case", range(len(SAID)))
def test_an_error_says_what_it_was_given(case: int) -> None:
    error, said, kept = SAID[case]
    assert str(error) == said
    assert {name: getattr(error, name) for name in kept} == kept


def test_twenty_names_are_listed_and_the_others_counted() -> None:
    for count, end in ((20, "n19)"), (21, "n19, ... 1 more)"), (23, "n19, ... 3 more)")):
        error = errors.NameNotFound("robot", "x", [f"n{k}" for k in range(count)])
        assert str(error).endswith(end)


def test_names_with_commas_are_told_apart() -> None:
    error = errors.NameNotFound("file", "x", ["a, b", "c"])
    assert str(error) == "there is no file named 'x' (known: a, b; c)"


def test_three_near_names_are_proposed_longer_ones_first() -> None:
    names = ["arm_left", "arm_right", "arm_top", "arm_low", "army"]
    said = str(errors.NameNotFound("robot", "ARM", names))
    assert "did you mean 'arm_left' or 'arm_right' or 'arm_top'?" in said


def test_what_cannot_be_shown_is_named_by_its_type() -> None:
    def fail(self: object) -> str:
        raise ValueError

    shown = type("Odd", (SimpleNamespace,), {"__repr__": fail})()
    assert str(errors.ParameterError("x", shown, "a number")) == "x must be a number, got a Odd"
    lines = type("Long", (SimpleNamespace,), {"__repr__": lambda self: "a\n  b"})()
    assert str(errors.ParameterError("x", lines, "a number")) == "x must be a number, got a b"


def test_a_finding_has_its_place_and_its_repair() -> None:
    finding = errors.Finding("warning", "joint 'q1'", "is odd", repair="mend it")
    assert str(finding) == "joint 'q1': is odd -> mend it"
    assert str(finding._replace(repair="")) == "joint 'q1': is odd"
