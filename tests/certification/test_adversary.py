"""Soundness and tightness: what is certified is above the worst that an adversary finds, and not far."""

from __future__ import annotations

import numpy as np
import pytest
from soundness import attack

import armgpi
from armgpi.certification.adversary import worst
from armgpi.certification.request import ask
from armgpi.health.zoo import fingers


def test_no_torque_that_switches_at_the_worst_times_leads_beyond_the_certificate() -> None:
    robot = armgpi.Robot.load("anthropomorphic3")
    made = armgpi.certify(robot, payload=(0.0, 0.25), speed=0.2, start="held")
    asked = ask(robot, 1e-3, payload=(0.0, 0.25), speed=0.2, start="held")
    cases = worst(asked, count=40)
    ratios = made.per_torque / [case.error for case in cases]
    assert (ratios >= 1.0).all()
    assert (ratios <= 3.0).all()
    # The whole simulated arm does what the frozen one says, for a torque within what is certified.
    size = 0.5 * float(made.data["inputs"]["gain"]["torque"]) / np.sqrt(robot.n)
    found = attack(asked, 0, cases[0], size)
    assert 0.9 * cases[0].error <= found <= made.per_torque[0]


@pytest.mark.search
@pytest.mark.parametrize("inertia", [0.0, 0.1])
@pytest.mark.parametrize("name", ["anthropomorphic3", "ur3", "ur5", "ur10", "kinova", "panda", "xarm7", "z1"])
def test_no_certificate_of_the_zoo_is_below_the_worst_of_many_configurations(
    name: str, inertia: float
) -> None:
    """Of each arm 2,000 configurations at both ends of the loads, each with its exact worst torque."""
    robot = armgpi.Robot.load(name, lock=fingers(name))
    robot = robot.with_armature(robot.armature + inertia)
    options = {"payload": (0.0, 0.25), "speed": 0.2}
    try:
        made = armgpi.certify(robot, **options)
    except armgpi.errors.PayloadError:
        pytest.skip("no bandwidth serves these loads")
    if "gain" not in made.data["solutions"]:
        pytest.skip(made.reasons[0])
    cases = worst(ask(robot, 1e-3, **options), count=1000)
    assert (made.per_torque >= [case.error for case in cases]).all()
