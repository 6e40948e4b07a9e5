"""What is asked about locked and kept joints is either done or refused by name."""

from __future__ import annotations

from typing import Any

import pytest

from armgpi import Robot, RobotBatch
from armgpi.errors import ArmgpiError, NameNotFound, ParameterError, UrdfError

LINK = (
    '<link name="{0}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
)
LINK += "</inertial></link>"
JOINT = '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="0 0 1"/>'
JOINT += '<limit lower="-1" upper="1" effort="9" velocity="9"/>{3}</joint>'


def pair(extra: str = "") -> str:
    links = "".join(LINK.format(name) for name in ("base", "one", "two"))
    return f'<robot name="pair">{links}{JOINT.format("j1", "base", "one", "")}' + (
        f"{JOINT.format('j2', 'one', 'two', extra)}</robot>"
    )


@pytest.mark.parametrize(
    ("arguments", "error", "named"),
    [
        ({"lock": ["j1"], "keep": ["j1", "j2"]}, ParameterError, "j1"),
        ({"lock": 5}, ParameterError, "lock"),
        ({"keep": 5}, ParameterError, "keep"),
        ({"lock": ["j3"]}, NameNotFound, "j3"),
        ({"lock": ["j1", "j2"]}, UrdfError, "no moving joint"),
    ],
)
def test_what_cannot_be_locked_or_kept_is_named(
    arguments: dict[str, Any], error: type[ArmgpiError], named: str
) -> None:
    with pytest.raises(error, match=named):
        Robot.from_xml(pair(), **arguments)


def test_a_mimic_of_a_joint_that_does_not_exist_is_refused() -> None:
    with pytest.raises(UrdfError, match=r"j2.*mimics 'nobody'"):
        Robot.from_xml(pair('<mimic joint="nobody"/>'))


def test_xml_nested_without_end_is_refused() -> None:
    deep = "<a>" * 50_000 + "</a>" * 50_000
    with pytest.raises(UrdfError, match="nested"):
        Robot.from_xml(pair().replace("</robot>", deep + "</robot>"))


def test_a_batch_needs_a_sequence_of_robots() -> None:
    robot = Robot.from_xml(pair())
    for bad in ([], robot, (r for r in [robot]), [robot, "robot"]):
        with pytest.raises(ParameterError, match="robots"):
            RobotBatch(bad)
