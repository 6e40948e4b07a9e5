"""Joints that follow another exactly: the equations of motion of a constrained arm, against closed forms."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armgpi import GPI, Bezier, RigidBodyPlant, Robot, RobotBatch, metrics, simulate
from armgpi.errors import ParameterError, UrdfError
from armgpi.robot import usual

BODY = (
    '<inertial><origin xyz="{com}"/><mass value="{mass}"/>'
    '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.015"/></inertial>'
)


def joint(name: str, parent: str, kind: str, axis: str, extra: str = "", limit: str = "") -> str:
    """Return a joint and the link `L_<name>` that it carries."""
    limit = limit or 'lower="-5" upper="5" effort="50" velocity="9"'
    body = BODY.format(com="0.1 0.02 -0.05", mass=1.5 if "2" in name else 2.0)
    return (
        f'<link name="L_{name}">{body}</link><joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="L_{name}"/><origin xyz="0.3 0 0.1"/><axis xyz="{axis}"/><limit {limit}/>'
        f'<dynamics damping="0.5" friction="0.25"/>{extra}</joint>'
    )


def mimic(leader: str, ratio: float, offset: float = 0.0) -> str:
    return f'<mimic joint="{leader}" multiplier="{ratio}" offset="{offset}"/>'


def robot_text(*parts: str) -> str:
    return f'<robot name="r"><link name="base"/>{"".join(parts)}</robot>'


RAILS = robot_text(
    joint("x1", "base", "prismatic", "0 0 1"),
    joint("x2", "base", "prismatic", "0 0 1", mimic("x1", -2.0, 0.1)),
)
#: An arm whose second joint follows its first, and a third that follows the second: a chain of them.
LINKAGE = robot_text(
    joint("a", "base", "revolute", "0 1 0"),
    joint("f2", "L_a", "revolute", "0 1 0", mimic("a", -1.0, 0.3)),
    joint("c", "L_f2", "revolute", "0 0 1"),
    joint("g2", "L_c", "prismatic", "1 0 0", mimic("f2", 0.5, -0.1)),
)


def test_two_coupled_rails_weigh_and_resist_as_levers_do() -> None:
    rails = Robot.from_xml(RAILS, mimic="follow")
    assert rails.joint_names == ("x1",)
    q = np.array([0.4])
    # Virtual work: x2 = -2 x1 + 0.1.
    np.testing.assert_allclose(rails.mass_matrix(q), [[2.0 + 4.0 * 1.5]], rtol=1e-14)
    np.testing.assert_allclose(rails.gravity(q), [9.81 * (2.0 - 2.0 * 1.5)], rtol=1e-14)
    np.testing.assert_allclose(rails.forward_dynamics(q, [0.0], [8.0]), [(8.0 + 9.81) / 8.0], rtol=1e-13)
    np.testing.assert_allclose(rails.frame_pose("L_x2", q).translation[2], 0.1 - 0.8 + 0.1, rtol=1e-14)
    np.testing.assert_allclose(rails.frame_jacobian("L_x2", q)[2], [-2.0], rtol=1e-14)
    np.testing.assert_allclose(rails.friction.viscous, [0.5 + 4.0 * 0.5])
    np.testing.assert_allclose(rails.friction.coulomb, [0.25 + 2.0 * 0.25])
    assert rails.total_mass == 3.5


def test_energies_of_coupled_rails_are_those_of_their_heights() -> None:
    rails = Robot.from_xml(RAILS, mimic="follow")
    low, high = usual._Judge(rails)._energies(np.array([[0.1], [0.4]]))
    # x2 = -2 x1 + 0.1, with 2 kg on the first rail and 1.5 kg on the second.
    assert high - low == pytest.approx(9.81 * 0.3 * (2.0 - 2.0 * 1.5))
    judge, data = usual._Judge(rails), rails.pinocchio_model()
    whole = pin.computePotentialEnergy(data, data.createData(), np.array([0.1, -2.0 * 0.1 + 0.1]))
    assert judge._energies(np.array([[0.1]]))[0] == pytest.approx(whole)


def test_ranges_of_leader_and_follower_may_meet_in_a_point() -> None:
    limits = 'lower="-1.9" upper="-1.9" effort="1" velocity="3"'
    meets = joint("x2", "base", "prismatic", "0 0 1", mimic("x1", -2.0, 0.1), limits)
    rails = Robot.from_xml(robot_text(joint("x1", "base", "prismatic", "0 0 1"), meets), mimic="follow")
    np.testing.assert_allclose([rails.limits.lower, rails.limits.upper], 1.0)


def test_the_followers_range_and_speed_bound_the_leader() -> None:
    tight = joint(
        "x2",
        "base",
        "prismatic",
        "0 0 1",
        mimic("x1", -2.0, 0.1),
        'lower="-1.9" upper="0.5" effort="1" velocity="3"',
    )
    rails = Robot.from_xml(robot_text(joint("x1", "base", "prismatic", "0 0 1"), tight), mimic="follow")
    np.testing.assert_allclose(np.ravel(rails.limits), [-0.2, 1.0, 1.5, 50.0], rtol=1e-14)
    never = tight.replace('lower="-1.9" upper="0.5"', 'lower="90" upper="91"')
    with pytest.raises(UrdfError, match="'x2' follows 'x1', and no position"):
        Robot.from_xml(robot_text(joint("x1", "base", "prismatic", "0 0 1"), never), mimic="follow")


STATES = st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=2).map(np.array)


@settings(max_examples=30)
@given(STATES, STATES, STATES)
def test_equations_of_motion_are_those_of_a_constrained_arm(q: Any, v: Any, tau: Any) -> None:
    """Against the Lagrangian by hand: T = v'Mv/2 of the free arm under the constraint, and multipliers."""
    arm, free = Robot.from_xml(LINKAGE, mimic="follow"), Robot.from_xml(_free(LINKAGE))
    assert arm.joint_names == ("a", "c")
    J = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [-0.5, 0.0]])
    whole, speed = J @ q + [0.0, 0.3, 0.0, 0.05], J @ v
    # The constrained arm: M a + b = S tau + A' lambda with A a = 0, as one linear system.
    A = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, -0.5, 0.0, 1.0]])
    M, bias = free.mass_matrix(whole), free.nonlinear_effects(whole, speed)
    torque = np.array([tau[0], 0.0, tau[1], 0.0])
    system = np.block([[M, A.T], [A, np.zeros((2, 2))]])
    a = np.linalg.solve(system, np.concatenate([torque - bias, np.zeros(2)]))[[0, 2]]
    got = arm.forward_dynamics(q, v, tau)
    np.testing.assert_allclose(got, a, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(arm.inverse_dynamics(q, v, got), tau, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(arm.inertia_times(q, v), arm.mass_matrix(q) @ v, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(arm.inertia_solve(q, arm.inertia_times(q, v)), v, rtol=1e-9, atol=1e-12)
    for ours, theirs in zip(arm.frame_pose("L_g2", q), free.frame_pose("L_g2", whole), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-14)
    np.testing.assert_allclose(
        arm.frame_jacobian("L_g2", q), free.frame_jacobian("L_g2", whole) @ J, rtol=0, atol=1e-14
    )
    np.testing.assert_allclose(
        arm.frame_drift("L_g2", q, v), free.frame_drift("L_g2", whole, speed), rtol=0, atol=1e-12
    )


def _free(text: str) -> str:
    """Return the URDF without its mimics."""
    return re.sub("<mimic[^>]*/>", "", text)


def test_a_batch_is_its_rows() -> None:
    arm = Robot.from_xml(LINKAGE, mimic="follow")
    q, v, tau = np.random.default_rng(0).normal(size=(3, 5, 2))
    rows = [arm.forward_dynamics(*row) for row in zip(q, v, tau, strict=True)]
    np.testing.assert_allclose(arm.forward_dynamics(q, v, tau), rows, rtol=1e-12)
    both = RobotBatch([arm, arm.scaled_inertia(2.0)])
    np.testing.assert_allclose(both.mass_matrix(q[0])[1], 2.0 * arm.mass_matrix(q[0]), rtol=1e-14)


def test_changes_keep_the_coupling() -> None:
    arm = Robot.from_xml(LINKAGE, mimic="follow")
    q = np.array([0.4, -0.3])
    geared = arm.with_armature({"a": 0.1})
    np.testing.assert_allclose(geared.mass_matrix(q) - arm.mass_matrix(q), np.diag([0.1, 0.0]), atol=1e-15)
    np.testing.assert_array_equal(geared.armature, [0.1, 0.0])
    loaded = arm.with_payload("L_g2", 0.5)
    J = arm.frame_jacobian("L_g2", q)[:3]
    np.testing.assert_allclose(loaded.mass_matrix(q) - arm.mass_matrix(q), 0.5 * J.T @ J, atol=1e-14)
    assert arm.with_limits(effort=3.0).joint_names == ("a", "c")


def test_energy_is_kept_without_torque_and_friction() -> None:
    arm = Robot.from_xml(LINKAGE, mimic="follow")
    plant, q, v, dt = RigidBodyPlant(arm), np.array([0.4, -0.3]), np.array([1.0, 2.0]), 1e-3
    masses = {"L_a": 2.0, "L_f2": 1.5, "L_c": 2.0, "L_g2": 1.5}

    def energy(q: Any, v: Any) -> float:
        height = 0.0
        for link, mass in masses.items():
            pose = arm.frame_pose(link, q)
            height += mass * (pose.translation + pose.rotation @ [0.1, 0.02, -0.05])[2]
        return float(0.5 * v @ arm.mass_matrix(q) @ v + 9.81 * height)

    begin, state = energy(q, v), plant.init(q, v)
    for _ in range(500):
        state = plant.step(np.zeros(2), state, dt)
    # Runge-Kutta of order 4: an error of some dt^4 over half a second.
    assert energy(state.q, state.v) == pytest.approx(begin, abs=1e-8)


def test_a_panda_whose_fingers_follow_is_controlled() -> None:
    panda = Robot.load("panda", mimic="follow")
    assert panda.n == 8
    q0 = panda.middle()
    reference = Bezier(q0, q0 + np.array([0.2] * 7 + [0.01]), duration=0.5)
    rollout = simulate(RigidBodyPlant(panda), GPI(panda, dt=1e-3), reference, t_final=1.0)
    assert float(metrics.peak_error(rollout).max()) < 0.01
    fingers = [panda.frame_pose(f"panda_{side}finger", q0) for side in ("left", "right")]
    hand = panda.frame_pose("panda_hand", q0)
    left, right = (hand.rotation.T @ (f.translation - hand.translation) for f in fingers)
    np.testing.assert_allclose(left, right * [1, -1, 1], atol=1e-12)


def test_with_its_leader_locked_or_dropped_a_follower_stands_still() -> None:
    arm = Robot.from_xml(LINKAGE, lock={"a": 0.7}, mimic="follow")
    assert arm.joint_names == ("c",)
    assert arm.coupling is None
    assert arm.provenance["locked"] == pytest.approx({"a": 0.7, "f2": -0.4, "g2": -0.3})
    kept = Robot.from_xml(LINKAGE, keep=["a"], mimic="follow")
    assert kept.joint_names == ("a",)
    assert set(kept.provenance["locked"]) == {"c"}


@pytest.mark.parametrize(
    ("extra", "said"),
    [
        (mimic("f2", 1.0), "'f2' mimics itself"),
        (mimic("g2", 1.0), "mimics itself"),
        (mimic("nobody", 1.0), "mimics 'nobody', which does not exist"),
        (mimic("a", 1e9), "no gear has"),
        (mimic("a", 1e-300), "no gear has"),
    ],
)
@pytest.mark.parametrize("how", ["lock", "follow"])
def test_a_mimic_that_cannot_be_is_refused(extra: str, said: str, how: Any) -> None:
    with pytest.raises(UrdfError, match=said):
        Robot.from_xml(LINKAGE.replace(mimic("a", -1.0, 0.3), extra), mimic=how)


def test_what_to_do_with_mimics_is_one_of_two() -> None:
    with pytest.raises(ParameterError, match="one of lock, follow"):
        Robot.load(Path("anthropomorphic3"), mimic="free")
