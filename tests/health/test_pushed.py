"""A push: displacement of a joint spring against the closed form, and what the default controller does."""

from __future__ import annotations

import math
import warnings
from typing import Any, ClassVar

import numpy as np
import pytest

import armgpi
from armgpi.base.parameter import with_parameters
from armgpi.control.controller import Controller, ControlStep, FullState
from armgpi.errors import ParameterError
from armgpi.health.pushed import _judge, describe, pushed, roomy

Q = np.array([0.0, -1.2, 1.5, -1.87, -1.57, 0.3])
#: Joint stiffness [N m/rad] and damping [N m s/rad] of a controller without integrators.
STIFFNESS, DAMPING = 2000.0, 400.0


@with_parameters
class JointSpring(Controller):
    """Gravity compensation with a spring and a damper at every joint."""

    measurement_type: ClassVar[type[FullState]] = FullState
    knows: ClassVar[Any] = "model"

    def init(self, measurement: Any, target: Any) -> None:
        return None

    def step(self, measurement: Any, target: Any, state: None) -> ControlStep:
        q, v = measurement
        tau = self.robot.dynamics.gravity(q) + STIFFNESS * (target.q - q) - DAMPING * v
        return ControlStep(tau, None)


def test_a_joint_spring_gives_way_by_the_closed_form() -> None:
    arm = armgpi.Robot.load("ur5").with_armature(0.5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", armgpi.ArmgpiWarning)
        found = pushed(arm, 10.0, JointSpring(arm, dt=1e-3), bits=None, q=Q)
        stiffness = armgpi.assume_drives(arm).drives.value("stiffness")
    jacobian = arm.frame_jacobian(arm.tip, Q)[:3]
    # Springs of controller and gears in series, seen at the tool: J (1/K + 1/gear) J' f.
    softness = jacobian @ np.diag(1.0 / STIFFNESS + 1.0 / stiffness) @ jacobian.T
    for i, each in enumerate(found):
        expected = 10.0 * np.linalg.norm(softness[:, i])
        assert each.displacement == pytest.approx(expected, rel=0.05)
        assert each.stiffness == pytest.approx(10.0 / each.displacement)
        assert np.isnan(each.back)  # a spring does not come back while it is pushed


def test_a_push_is_judged_by_its_largest_distance_and_its_return() -> None:
    times = np.arange(0.0, 2.2, 1e-3)
    after = np.maximum(times - 0.2, 0.0)
    tool = np.zeros((len(times), 3))
    tool[:, 1] = 0.05 * after * np.exp(-after / 0.1)  # largest at 0.1 s: 5 mm / e
    judged = _judge("y", 20.0, tool, times)
    assert judged.displacement == pytest.approx(0.005 / math.e, rel=1e-3)
    assert judged.damping == pytest.approx(20.0 / 0.05, rel=0.02)
    # x exp(1 - x) = 0.1 at x = 4.8897.
    assert judged.back == pytest.approx(0.48897, abs=2e-3)


def test_the_default_controller_brings_the_tool_back() -> None:
    arm = armgpi.Robot.load("ur5")
    found = pushed(arm, 20.0)
    assert [each.axis for each in found] == ["x", "y", "z"]
    assert all(0.002 < each.displacement < 0.1 and each.back < 2.0 for each in found)
    assert "N s/m" in describe(found, 20.0)
    assert arm.outside(roomy(arm)) is None


def test_a_push_of_no_force_is_refused() -> None:
    with pytest.raises(ParameterError, match="force"):
        pushed(armgpi.Robot.load("ur5"), 0.0)
