"""Soundness and tightness: what is certified is above the worst that an adversary finds, and not far."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from soundness import Course, attack

import armgpi
from armgpi.certification import adversary
from armgpi.certification.adversary import impulses, worst
from armgpi.certification.channels import sampled_loops
from armgpi.certification.request import ask
from armgpi.health.zoo import fingers
from armgpi.plants.sensors import Delayed
from armgpi.references.waypoints import Hold


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


@pytest.mark.parametrize(("delay", "integrators", "rolloff"), [(0, 1, 1), (2, 2, 0), (1, 1, 2)])
def test_responses_are_those_of_the_joints_laws_on_an_arm_that_is_frozen(
    delay: int, integrators: int, rolloff: int
) -> None:
    robot = armgpi.Robot.load("anthropomorphic3").with_armature(0.02)
    robot = robot.with_payload(robot.tip, 0.1, (0.05, -0.02, 0.03))
    options: dict[str, Any] = {"integrators": integrators, "rolloff": rolloff, "delay": delay}
    asked = ask(robot, 2e-3, payload=(0.0, 0.2), speed=0.2, **options)
    arm, q, step = asked.setting.arms[0], np.array([0.3, 0.7, -0.9]), 1e-5
    found = impulses(asked, arm, q, 300)
    loops = sampled_loops(asked.controller, delay)
    nominal, inverse = asked.setting.nominal, np.linalg.inv(arm.mass_matrix(q))
    v = np.linalg.solve(nominal.mass_matrix(q), arm.gravity(q))

    def slope(force: Any) -> Any:
        return np.transpose([(force(q + x) - force(q - x)) / (2.0 * step) for x in step * np.eye(3)])

    weight = slope(arm.gravity)  # where the arm is
    held = slope(lambda x: nominal.mass_matrix(x) @ v)  # where the controller sees it
    for j in range(3):
        x, answers = inverse[:, j, None] * loops.push, []
        for _ in range(300):
            answers.append(x[j, 0])
            asks, seen = np.einsum("im,im->i", loops.asks, x), x[:, -1 if delay else 0]
            torque = nominal.mass_matrix(q) @ asks + held @ seen - weight @ x[:, 0]
            x = np.einsum("imk,ik->im", loops.open, x) + (inverse @ torque)[:, None] * loops.push
        np.testing.assert_allclose(found[j], answers, rtol=1e-5, atol=1e-7 * np.abs(answers).max())


def test_a_late_controller_does_not_make_gravity_late() -> None:
    """The simulated arm, pushed a little either way, answers as the frozen one says: gravity acts at once."""
    robot, q = armgpi.Robot.load("anthropomorphic3").with_armature(0.02), np.array([0.3, 0.7, -0.9])
    h, delay, size = 2e-3, 6, 1e-2
    asked = ask(robot, h, payload=(0.0, 0.2), speed=0.2, delay=delay)
    arm, rest = asked.setting.arms[0], round(6.0 / h)
    found = impulses(asked, arm, q, 280)[1]
    moved = []
    for torque in (-size, size):
        course = np.zeros((rest + 300, 3))
        course[rest, 1] = torque
        plant = Delayed(armgpi.RigidBodyPlant(arm, loads=[Course(course, h)]), delay)
        rollout = armgpi.simulate(plant, asked.controller, Hold(q), h * len(course), progress=False)
        moved.append(rollout["q"].values[rest + 1 : rest + 281, 1])
    answers = (moved[0] - moved[1]) / (2.0 * size)  # a load takes from the motor's torque
    np.testing.assert_allclose(found, answers, atol=0.01 * np.abs(answers).max())


def test_the_worst_is_the_largest_of_a_whole_box_and_where_joints_are_light(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = armgpi.Robot.load("anthropomorphic3")
    asked = ask(robot, 1e-3, payload=(0.0, 0.25), speed=0.2)
    lower, upper = np.array([0.5, -1.5, 0.2]), np.array([2.0, -0.3, 0.9])
    asked = asked._replace(setting=asked.setting._replace(lower=lower, upper=upper))
    looked: list[Any] = []

    def response(_: Any, arm: Any, q: Any, samples: int) -> Any:
        looked.append((arm, q))
        return -np.outer(q + robot.n * len(looked) % 7, np.ones(samples))

    monkeypatch.setattr(adversary, "impulses", response)
    cases = worst(asked, count=60, samples=4)
    for j, case in enumerate(cases):
        sizes = [4.0 * abs(q[j] + robot.n * (k + 1) % 7) for k, (_, q) in enumerate(looked)]
        assert case.error == pytest.approx(max(sizes))
        assert (case.arm, case.q.tolist()) in [
            (arm, q.tolist()) for (arm, q), x in zip(looked, sizes, strict=True) if x == max(sizes)
        ]
        assert np.abs(case.response).sum() == pytest.approx(case.error)
    assert len(looked) == 2 * (30 + 3 * 10)
    every = np.array([q for _, q in looked])
    np.testing.assert_allclose([every.min(axis=0), every.max(axis=0)], [lower, upper])
    assert (np.median(every[:30], axis=0) > lower + 0.2 * (upper - lower)).all()
    assert (np.median(every[:30], axis=0) < upper - 0.2 * (upper - lower)).all()
    for arm, first in zip(asked.setting.arms, (0, 60), strict=True):
        light = [np.diag(np.linalg.inv(arm.mass_matrix(q))) for q in every[first : first + 60]]
        for j in range(3):
            assert min(x[j] for x in light[30 + j :: 3]) >= max(x[j] for x in light[:30])


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
        pytest.skip("no bandwidth is stable these loads")
    if "gain" not in made.data["solutions"]:
        pytest.skip(made.reasons[0])
    cases = worst(ask(robot, 1e-3, **options), count=1000)
    assert (made.per_torque >= [case.error for case in cases]).all()
