"""Errors: one root, data in the leaves, and texts that say what was found, expected and to be done."""

from __future__ import annotations

import inspect

import pytest
import typer.main

from armgpi import cli, errors
from armgpi.cli.parsing import OPTIONS, as_option, with_options
from armgpi.errors import (
    ArmgpiError,
    ConfigError,
    EffortError,
    LimitError,
    NameNotFound,
    ReachError,
    Remedy,
    UrdfError,
)

CLASSES = [
    cls
    for _, cls in inspect.getmembers(errors, inspect.isclass)
    if cls.__module__ == errors.__name__ and issubclass(cls, BaseException)
]


def test_every_error_has_the_one_root_and_every_warning_the_other() -> None:
    for cls in CLASSES:
        assert issubclass(cls, ArmgpiError) != issubclass(cls, errors.ArmgpiWarning), cls
    assert not issubclass(ArmgpiError, ValueError)  # `except ValueError` hides no refusal of ours


@pytest.mark.parametrize(
    ("typo", "offered"),
    [
        ("elbo", "did you mean 'elbow'?"),
        ("ELBOW", "did you mean 'elbow'?"),
        ("wrist_1x", "did you mean 'wrist_1' or 'wrist_2'?"),
    ],
)
def test_near_names_are_offered(typo: str, offered: str) -> None:
    error = NameNotFound("joint", typo, ["wrist_1", "wrist_2", "elbow"], "see the URDF")
    assert str(error).startswith(f"there is no joint named {typo!r}; {offered}")
    assert "(known: wrist_1, wrist_2, elbow)" in str(error)
    assert str(error).endswith("; see the URDF")


def test_without_near_names_none_is_offered_and_long_lists_are_cut() -> None:
    text = str(NameNotFound("joint", "xyz", [f"q{i}" for i in range(200)]))
    assert "did you mean" not in text
    assert "q19, ... 180 more" in text
    assert "q20" not in text
    assert "known" not in str(NameNotFound("joint", "xyz", []))


def test_names_that_go_on_from_what_was_typed_are_offered_first() -> None:
    text = str(NameNotFound("robot", "G1", ["z1", "g1_left_arm", "g1_right_arm"]))
    assert "did you mean 'g1_left_arm' or 'g1_right_arm'?" in text


def test_leaves_carry_their_numbers() -> None:
    limit = LimitError("the start", "elbow", 4.0, -1.0, 2.0, "start inside")
    assert (limit.joint, limit.value, limit.lower, limit.upper) == ("elbow", 4.0, -1.0, 2.0)
    assert str(limit) == "the start of joint 'elbow' is 4, outside [-1, 2]; start inside"

    effort = EffortError("elbow", 0.0)
    assert (effort.joint, effort.effort) == ("elbow", 0.0)
    assert "with_limits(effort={'elbow': 10.0})" in str(effort)
    several = EffortError("elbow", 0.0, ["wrist", "hand"])
    assert "(nor have wrist, hand more)" in str(several)
    assert "with_limits(effort={'elbow': 10.0, 'wrist': 10.0, 'hand': 10.0}), or lock them" in str(several)

    every = EffortError("elbow", 0.0, ["wrist"], movable=False)  # to lock them leaves no joint
    assert "lock" not in str(every)
    assert every.remedies == (Remedy("effort", ("elbow", "wrist"), 10.0),)

    reach = ReachError([1, 2, 3], 0.5, "too far")
    assert (reach.point, reach.distance, str(reach)) == ((1.0, 2.0, 3.0), 0.5, "too far")

    urdf = UrdfError("arm.urdf", "has no mass", "fore")
    assert (urdf.source, urdf.element, str(urdf)) == ("arm.urdf", "fore", "arm.urdf: has no mass")


@pytest.mark.parametrize(
    ("key", "line", "text"),
    [
        ("plant.dt", 7, "run.yaml:7: plant.dt: must be positive"),
        ("plant.dt", None, "run.yaml: plant.dt: must be positive"),
        ("", None, "run.yaml: must be positive"),
    ],
)
def test_an_error_of_a_file_points_at_its_line_and_key(key: str, line: int | None, text: str) -> None:
    error = ConfigError("run.yaml", key, "must be positive", line)
    assert str(error) == text
    assert (error.source, error.key, error.line) == ("run.yaml", key, line)


# --- What would help -----------------------------------------------------------------------------


def test_an_error_carries_what_would_help_as_data() -> None:
    assert ArmgpiError("no").remedies == ()
    error = UrdfError("arm.urdf", "moves nothing", "q2").suggesting(Remedy("lock", ("q2",)))
    assert isinstance(error, UrdfError)
    assert error.remedies == (Remedy("lock", ("q2",)),)
    assert EffortError("q2", 0.0).remedies == (Remedy("effort", ("q2",), 10.0), Remedy("lock", ("q2",)))


@pytest.mark.parametrize(
    ("remedy", "text"),
    [
        (Remedy("effort", ("q2",), 10.0), "--effort q2=10"),
        (Remedy("effort", ("q2", "q3"), 2.5), "--effort q2=2.5,q3=2.5"),
        (Remedy("effort"), "--effort JOINT=EFFORT"),
        (Remedy("lock", ("q2", "q3")), "--lock q2,q3"),
        (Remedy("lock", ("q2",), 0.0), "--lock q2=0"),
        (Remedy("mimic", value="follow"), "--mimic follow"),
        (Remedy("omega", value=30.0), "--controller gpi --omega 30"),
        (Remedy("friction"), "--friction none"),
    ],
)
def test_the_command_line_offers_a_remedy_as_its_option(
    remedy: Remedy, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("armgpi.cli.parsing.OFFERED", set())  # of no command
    assert as_option(remedy) == text
    assert with_options(ArmgpiError("no").suggesting(remedy, Remedy("port"))) == f"no ({text} or --port PORT)"


def test_an_error_made_from_another_one_offers_what_helps_that_one() -> None:
    error = ConfigError("run.yaml", "robot.name", "no")
    error.__cause__ = ArmgpiError("no").suggesting(Remedy("robot"))
    assert with_options(error) == "run.yaml: robot.name: no (--robot ROBOT)"
    assert with_options(ConfigError("run.yaml", "robot.name", "no")) == "run.yaml: robot.name: no"


def test_every_option_that_is_offered_exists() -> None:
    commands = typer.main.get_group(cli.app).commands.values()
    parameters = [each for command in commands for each in command.get_params(typer.Context(command))]
    known = {option for parameter in parameters for option in parameter.opts}
    assert {word for name, _ in OPTIONS.values() for word in name.split() if word[0] == "-"} <= known
