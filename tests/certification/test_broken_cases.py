"""Two arms whose claims were exceeded, one that rotates fast and one that rubs: refused, or within claims."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from soundness import observe

import armgpi
from armgpi.certification.certificate import certificate
from armgpi.certification.quantities import search_numbers
from armgpi.certification.request import NOTHING, ask
from armgpi.certification.solve import solve

LINK = """<link name="{0}"><inertial><mass value="{1}"/>
<inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{1}" type="{2}"><parent link="{0}"/><child link="{1}"/><axis xyz="{3}"/>
<limit lower="{4}" upper="{5}" effort="1e6" velocity="20"/><dynamics damping="{6}"/></joint>"""


def turntable(damping: float = 0.0) -> armgpi.Robot:
    """Return a slide of 0.4 to 0.8 m on a turntable, masses of 1 and 2 kg at the axes."""
    links = "<link name='base'/>" + LINK.format("table", 1.0) + LINK.format("slide", 2.0)
    turns = JOINT.format("base", "table", "revolute", "0 0 1", -100, 100, damping)
    slides = JOINT.format("table", "slide", "prismatic", "1 0 0", 0.4, 0.8, 0)
    return armgpi.Robot.from_xml(f"<robot name='turntable'>{links}{turns}{slides}</robot>")


def certified(robot: armgpi.Robot, **options: Any) -> tuple[Any, armgpi.Certificate]:
    gains = armgpi.FixedGains(10.0)
    given = {"gains": gains, "radius": [0.05, 0.02], "box": {"lower": [-0.5, 0.45], "upper": [0.5, 0.75]}}
    asked = ask(robot, 1e-3, **{**given, **options})
    return asked, certificate(asked, search_numbers(asked.setting))


@pytest.mark.parametrize("speed", [6.0, 8.0])
def test_an_arm_that_rotates_so_fast_that_its_loop_is_unstable_is_refused(speed: float) -> None:
    """The error's Coriolis torque is there twice: from 0.59 omega on the loop is unstable."""
    asked, made = certified(turntable(), speed=[speed, 0.01], acceleration=0.1)
    assert not made.certified
    assert set(made.data["solutions"]) == {"gain"}  # with the reference at rest
    assert "Reference: moving" in str(made)
    assert (observe(asked, made, 500).gain <= 1.0).all()
    facts = [made.data[key] for key in ("limits", "law", "numbers")]
    push = {**NOTHING, "torque": "1"}
    assert solve(*facts, push) is not None
    assert solve(*facts, {**push, "reference": "1"}) is None  # whatever disturbs


def test_damping_so_large_that_the_loop_is_unstable_is_refused() -> None:
    """From 6.5 omega of damping over inertia on."""
    made = certified(turntable(300.0), speed=0.05, friction=True)[1]
    assert not made.certified
    assert not made.data["solutions"]


def test_less_damping_is_certified_and_no_rollout_exceeds_the_claim() -> None:
    robot = turntable(5.0)
    asked, made = certified(robot, speed=0.05, friction=True, torque=[0.01, 0.0])
    assert made.certified, made.reasons
    assert made.check() == []
    assert float(made.data["numbers"]["kappa_f"]) > 5.0
    loads = [
        armgpi.Step([0.01, 0.0]),
        *(armgpi.Step([(-1) ** k * 0.02, 0.0], onset=0.3 * k) for k in range(1, 6)),
    ]
    plant = armgpi.RigidBodyPlant(robot, loads=loads, friction="urdf")
    rollout = armgpi.simulate(plant, asked.controller, armgpi.Hold(np.array([0.0, 0.6])), 2.0)
    seen = np.abs(rollout["q"].values - rollout["q_ref"].values).max(axis=0)
    assert (seen <= made.error).all()
    assert seen[0] >= 0.1 * made.error[0]
