"""Soundness and tightness: what is certified is above the worst that an adversary finds, and not far."""

from __future__ import annotations

import numpy as np

import armgpi
from armgpi.certification.adversary import attack, worst
from armgpi.certification.asked import ask


def test_no_torque_that_switches_at_the_worst_times_leads_beyond_the_certificate() -> None:
    robot = armgpi.Robot.load("anthropomorphic3")
    made = armgpi.certify(robot, payload=(0.0, 0.25), speed=0.2)
    asked = ask(robot, 1e-3, payload=(0.0, 0.25), speed=0.2)
    cases = worst(asked, count=40)
    ratios = made.per_torque / [case.error for case in cases]
    assert (ratios >= 1.0).all()
    assert (ratios <= 3.0).all()
    # The whole simulated arm does what the frozen one says, for a torque within what is certified.
    size = 0.5 * float(made.data["inputs"]["gain"]["torque"]) / np.sqrt(robot.n)
    found = attack(asked, 0, cases[0], size)
    assert 0.9 * cases[0].error <= found <= made.per_torque[0]
