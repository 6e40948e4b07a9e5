"""The second opinion agrees where it should, and says so where it does not."""

from __future__ import annotations

from pathlib import Path

import pytest

from armgpi import Robot
from armgpi.cli import app
from armgpi.errors import ArmgpiError
from armgpi.health.crosscheck import CrossCheckUnavailable, cross_check

FOLDER = Path(__file__).parents[1] / "fixtures" / "urdf_cases"


@pytest.mark.parametrize("name", ["anthropomorphic3", "kinova", "so101", "talos_right_arm"])
def test_yourdfpy_sees_the_same_arm(name: str) -> None:
    robot = Robot.load(name)
    check = cross_check(robot)
    assert check.differences == ()
    assert max(check.position, check.rotation) < 1e-13


def test_with_mimics_it_sees_the_same_whether_they_are_locked_or_follow() -> None:
    with pytest.warns(UserWarning, match="mimics"):
        locked = cross_check(Robot.load("panda"))
    followed = cross_check(Robot.load("panda", mimic="follow"))
    assert locked.differences == followed.differences == ()
    assert followed.links == locked.links + 1  # the finger that is locked here and follows there


def test_what_the_two_read_differently_is_named(tmp_path: Path) -> None:
    # A prismatic axis that is no unit vector: yourdfpy moves by q times it, URDF says it is a direction.
    path = tmp_path / "arm.urdf"
    text = (FOLDER / "54_prismatic.urdf").read_text(encoding="utf-8")
    head, _, tail = text.rpartition('xyz="0 1 0"')
    path.write_text(f'{head}xyz="0 2 0"{tail}', encoding="utf-8")
    (line,) = cross_check(Robot.load(path)).differences
    assert "link 'l2'" in line


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('<robot name="', '<robot label="', "KeyError"),  # a name, which no dynamics need
        ("<robot ", '<robot xmlns="http://www.ros.org" ', "finds no link"),
    ],
)
def test_what_yourdfpy_alone_cannot_read_does_not_take_the_report(
    old: str, new: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "arm.urdf"
    text = (FOLDER / "00_good.urdf").read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(CrossCheckUnavailable, match=said):
        cross_check(Robot.load(path))
    with pytest.raises(SystemExit) as end:  # what was asked for was not judged
        app(["inspect", str(path), "--cross-check"], standalone_mode=False)
    assert end.value.code == 3
    assert (
        f"warning: file: yourdfpy {'cannot' if said == 'KeyError' else 'finds no'}" in capsys.readouterr().out
    )


def test_what_the_file_says_of_its_encoding_does_not_stop_the_second_reading(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    text = (FOLDER / "00_good.urdf").read_text(encoding="utf-8")
    body = text[text.index("<robot") :]
    path.write_text(f'<?xml version="1.0" encoding="US-ASCII"?><!-- µ -->{body}', encoding="utf-8")
    assert cross_check(Robot.load(path)).differences == ()


def test_a_file_that_changed_meanwhile_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    text = (FOLDER / "00_good.urdf").read_text(encoding="utf-8")
    path.write_text(text, encoding="utf-8")
    robot = Robot.load(path)
    path.write_text(text.replace("0.2", "0.3"), encoding="utf-8")
    with pytest.raises(ArmgpiError, match="has changed"):
        cross_check(robot)
    with pytest.raises(ArmgpiError, match="cannot be read"):
        cross_check(Robot.from_xml(text))
