"""What an impedance controller may be asked for: what its constructor takes, and less in a later loop."""

from __future__ import annotations

import numpy as np
import pytest

from armgpi import CartesianImpedance, Robot, assume_drives, health
from armgpi.errors import ParameterError
from armgpi.health.compliance import Compliance, compliance_of

ARM = Robot.load("anthropomorphic3")


def test_what_an_impedance_controller_may_be_asked_for_is_said_before_one_is_made() -> None:
    fast, slow = (health.inspect("ur5", dt=dt, delay=1) for dt in (1e-3, 8e-3))
    said = fast.facts["compliance"]
    arm = assume_drives(Robot.load("ur5"))
    largest = [said["stiffness"]] * 3 + [0.06 * said["stiffness"]] * 3
    CartesianImpedance(arm, 1e-3, stiffness=[0.97 * x for x in largest], delay=1e-3)
    with pytest.raises(ParameterError, match="at most"):
        CartesianImpedance(arm, 1e-3, stiffness=[1.03 * x for x in largest], delay=1e-3)
    assert "compliance" not in {each.kind for each in fast.findings}
    (finding,) = (each for each in slow.findings if each.kind == "compliance")
    assert finding.value == pytest.approx(slow.facts["compliance"]["stiffness"])
    assert isinstance(finding.value, float)
    assert finding.value < 500.0


@pytest.mark.parametrize("delay", [0.0, 2e-3, 8e-3])
def test_a_later_loop_may_be_asked_for_less(delay: float) -> None:
    """More delay or a longer sample time never allows a stiffer spring, nor a stiffer wall."""
    here, later, slower = (
        compliance_of(ARM, dt, late) for dt, late in ((1e-3, delay), (1e-3, delay + 2e-3), (2e-3, delay))
    )
    assert here is not None
    for other in (later, slower):
        assert other is not None
        assert other.stiffness <= here.stiffness
        assert other.asked <= here.asked
        # A softer spring tolerates a stiffer wall.
        if other.asked == here.asked:
            assert other.wall <= here.wall


def test_the_largest_stiffness_is_where_the_constructor_begins_to_refuse() -> None:
    """A second opinion: by bisection of the controller itself."""
    found = compliance_of(ARM, 1e-3, 2e-3)
    assert found is not None
    lowest, highest = 1.0, 1e6

    def is_allowed(stiffness: float) -> bool:
        try:
            springs = np.repeat([stiffness, 0.06 * stiffness], 3)
            CartesianImpedance(ARM, 1e-3, stiffness=springs, delay=2e-3)
        except ParameterError:
            return False
        return True

    assert is_allowed(lowest)
    assert not is_allowed(highest)
    for _ in range(12):
        middle = float(np.sqrt(lowest * highest))
        lowest, highest = (middle, highest) if is_allowed(middle) else (lowest, middle)
    assert found.stiffness == pytest.approx(lowest, rel=0.02)


def test_a_wall_that_a_tool_hardly_moves_against_has_no_stiffest_one() -> None:
    """4.3e11 kN/m was the median of an arm of two joints, whose tool moves in two directions alone."""
    found = Compliance(1e5, 1e5, 4.3e5, 4.3e14, 500.0, "")
    assert "is 430 kN/m in the worst direction, any in the median" in found.describe()[1]
