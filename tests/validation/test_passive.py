"""Forward dynamics that do not read every torque: right ones are right, and wrong ones end in a report."""

from __future__ import annotations

from pathlib import Path

import byhand
import pytest
import textbooks

from armgpi import Robot, validate
from armgpi.errors import NameNotFound, ParameterError

PENDUBOT = """
import numpy as np

m1, m2, l1, c1, c2, I1, I2, g = 1.5, 1.0, 0.4, 0.2, 0.15, 0.02, 0.05, 9.81


def forward_dynamics(q, v, tau):
    k = m2 * l1 * c2 * np.cos(q[1])
    d = I2 + m2 * c2**2
    D = np.array([[I1 + m1 * c1**2 + m2 * l1**2 + d + 2 * k, d + k], [d + k, d]])
    h = m2 * l1 * c2 * np.sin(q[1])
    b = m2 * g * c2 * np.cos(q[0] + q[1])
    rest = np.array([-h * v[1] * (2 * v[0] + v[1]), h * v[0] ** 2])
    rest += np.array([(m1 * c1 + m2 * l1) * g * np.cos(q[0]) + b, b])
    return np.linalg.solve(D, np.array([TORQUES]) - rest)
"""


def pendubot() -> Robot:
    """Return the robot of the model above."""
    turn, ball = textbooks._turn, textbooks._round
    joints = [
        turn("0 -1 0", (0, 0, 0), 1.5, (0.2, 0, 0), ball(0.02)),
        turn("0 -1 0", (0.4, 0, 0), 1.0, (0.15, 0, 0), ball(0.05)),
    ]
    return Robot.from_xml(textbooks.written("pendubot", joints))


@pytest.mark.parametrize("torques", ["tau[0], 0.0", "0.0, tau[1]"])
def test_accelerations_of_a_right_model_agree_for_other_numbers_too(torques: str, tmp_path: Path) -> None:
    path = tmp_path / "pendubot.py"
    path.write_text(PENDUBOT.replace("TORQUES", torques))
    report = validate(path, pendubot())
    assert report.agrees, report


def test_a_point_mass_that_may_be_without_mass_is_no_error(tmp_path: Path) -> None:
    mistake = next(byhand.mistakes("beamball"))
    path = tmp_path / "beamball.py"
    path.write_text(mistake.source)
    report = validate(path, byhand.robot("beamball"))
    assert not report.agrees
    assert report.causes


@pytest.mark.parametrize("torques", ["tau[0], 0.3 * tau[1]", "tau.item(), 0.0"])
def test_a_joint_that_is_said_to_have_no_motor_has_no_torque(torques: str, tmp_path: Path) -> None:
    """The torque of another joint may be read, or be no argument at all."""
    path = tmp_path / "pendubot.py"
    path.write_text(PENDUBOT.replace("TORQUES", torques))
    arm = pendubot()
    report = validate(path, arm, passive=arm.joint_names[1])
    assert report.agrees, report
    assert "forward_dynamics is compared with tau2 = 0 (passive joints)" in report.notes
    path.write_text(path.read_text().replace("(2 * v[0] + v[1])", "(v[0] + v[1])"))
    wrong = validate(path, arm, passive=[arm.joint_names[1]])
    assert not wrong.agrees
    assert wrong.causes[0].line is not None


@pytest.mark.parametrize(
    ("torques", "passive"), [("0.0, tau[0]", 0), ("0.0, tau", 0), ("tau, 0.0", 1), ("0.0, tau[1]", 0)]
)
def test_the_torque_of_the_one_motor_may_be_a_number_or_the_first_entry(
    torques: str, passive: int, tmp_path: Path
) -> None:
    path = tmp_path / "acrobot.py"
    path.write_text(PENDUBOT.replace("TORQUES", torques))
    arm = pendubot()
    report = validate(path, arm, passive=arm.joint_names[passive])
    assert report.agrees, report
    assert not report.left_out, report  # its torque was compared


def test_joints_without_a_motor_are_some_of_the_robots(tmp_path: Path) -> None:
    path = tmp_path / "pendubot.py"
    path.write_text(PENDUBOT.replace("TORQUES", "tau[0], 0.0"))
    arm = pendubot()
    with pytest.raises(NameNotFound, match="elbow"):
        validate(path, arm, passive="elbow")
    with pytest.raises(ParameterError, match="passive"):
        validate(path, arm, passive=list(arm.joint_names))
    with pytest.raises(ParameterError, match="robot"):
        validate(path, passive="q1")


def test_a_wrong_sign_is_named_before_a_rate_that_gives_the_same(tmp_path: Path) -> None:
    """2 (v1 + v2) v2 - v2² is 2 v1 v2 + v2²."""
    path = tmp_path / "pendubot.py"
    right = "-h * v[1] * (2 * v[0] + v[1])"
    text = PENDUBOT.replace("TORQUES", "tau[0], tau[1]")
    path.write_text(text.replace(right, "-h * (2 * v[0] * v[1] - v[1] ** 2)"))
    (cause,) = validate(path, pendubot()).causes
    assert "(the sign)" in cause.text


def test_a_model_without_forward_dynamics_is_told_that_passive_joints_change_nothing(tmp_path: Path) -> None:
    path = tmp_path / "weight.py"
    path.write_text(
        "import math\n\ndef gravity(q):\n    b = 9.81 * 0.15 * math.cos(q[0] + q[1])\n"
        "    return [(1.5 * 0.2 + 0.4) * 9.81 * math.cos(q[0]) + b, b]\n"
    )
    report = validate(path, pendubot(), passive="q2")
    assert report.agrees
    assert any("--passive changed nothing" in note for note in report.notes)
