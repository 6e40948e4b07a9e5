"""Laws of the equations of motion D(q) a + C(q, v) v + G(q) = tau that hold for every robot.

Tolerances: every quantity is a sum of products, each rounded to eps = 2.2e-16 of itself, so a torque
is right to a few eps of the largest torques that enter it (`scale`). The worst seen over some thousand
robots was 10 eps of it; `ROUNDING` leaves a factor of ten. Central differences have an error of their
own, the step squared times the next derivative, which is stated where they are used.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import (
    ANGLES,
    BODIES,
    Array,
    State,
    decimals,
    link,
    robots,
    robots_and_states,
    states,
    triples,
    urdf_texts,
    words,
)

from armgpi import Robot

ROUNDING = 100 * np.finfo(np.float64).eps
#: Step of central differences. They are wrong by step^2 times a third derivative and by eps / step, 2e-11;
#: the worst seen was 4e-12 of the sizes that are given with them.
STEP = 1e-5
SLOPE = 1e-9

every_robot = settings(max_examples=50)


def scale(robot: Robot, state: State) -> float:
    """Return the size of the torques that are added up [N m or N]: inertia, weight, and what v makes."""
    inertia = np.abs(robot.mass_matrix(state.q)).sum() * np.abs(state.a).max()
    bias = np.abs(robot.nonlinear_effects(state.q, state.v)).max()
    return float(inertia + bias + robot.total_mass * 9.81)


def close(actual: Array, expected: Array, size: float) -> None:
    """Check that two arrays are equal up to rounding of numbers of this size."""
    np.testing.assert_allclose(actual, expected, rtol=0, atol=ROUNDING * size)


def rows_of(state: State, count: int) -> State:
    """Return a batch of `count` states around one; its first row is the state itself."""
    rng = np.random.default_rng(0)
    shifts = rng.uniform(-1.0, 1.0, (count, 1))
    shifts[0] = 0.0
    return State(*(x + shifts for x in state))


# --- The inertia matrix and what goes with it ----------------------------------------------------


@every_robot
@given(robots_and_states())
def test_the_inertia_matrix_is_symmetric_and_positive_definite(case: tuple[Robot, State]) -> None:
    robot, (q, _, _) = case
    D = robot.mass_matrix(q)
    np.testing.assert_array_equal(D, D.T)
    assert np.linalg.eigvalsh(D)[0] > 0.0


@every_robot
@given(robots_and_states())
def test_forward_dynamics_undoes_inverse_dynamics(case: tuple[Robot, State]) -> None:
    robot, state = case
    q, v, a = state
    back = robot.forward_dynamics(q, v, robot.inverse_dynamics(q, v, a))
    # What is left over, as a torque: D divides by its smallest eigenvalue, and this undoes that.
    D = robot.mass_matrix(q)
    close(D @ (back - a), np.zeros(robot.n), scale(robot, state))
    close(back, a, scale(robot, state) / np.linalg.eigvalsh(D)[0])


@every_robot
@given(robots_and_states())
def test_the_torque_is_inertia_times_acceleration_plus_the_rest(case: tuple[Robot, State]) -> None:
    robot, state = case
    q, v, a = state
    D, size = robot.mass_matrix(q), scale(robot, state)
    close(robot.inertia_times(q, a), D @ a, size)
    torque = D @ a + robot.nonlinear_effects(q, v)
    close(robot.inverse_dynamics(q, v, a), torque, size)
    close(D @ robot.inertia_solve(q, torque), torque, size)
    close(robot.gravity(q), robot.nonlinear_effects(q, np.zeros(robot.n)), size)


@every_robot
@given(robots_and_states(max_joints=5))
def test_coriolis_torque_is_that_of_the_christoffel_symbols(case: tuple[Robot, State]) -> None:
    robot, state = case
    q, v, _ = state
    # dD[k] = dD/dq_k; C v = dD/dt v - d(v' D v / 2)/dq, Lagrange's equation for the kinetic energy.
    dD = np.stack([slope(robot.mass_matrix, q, axis) for axis in np.eye(robot.n)])
    expected = np.einsum("kij,k,j->i", dD, v, v) - np.einsum("kij,i,j->k", dD, v, v) / 2.0
    torque = robot.nonlinear_effects(q, v) - robot.gravity(q)
    size = np.abs(robot.mass_matrix(q)).sum() * (1.0 + np.square(v).sum()) + robot.total_mass * 9.81
    np.testing.assert_allclose(torque, expected, rtol=0, atol=SLOPE * size)


@every_robot
@given(robots_and_states())
def test_coriolis_torque_is_quadratic_in_the_velocity_and_gravity_linear_in_g(
    case: tuple[Robot, State],
) -> None:
    robot, state = case
    q, v, _ = state
    size = scale(robot, state)
    floating = robot.with_gravity([0.0, 0.0, 0.0])
    close(floating.gravity(q), np.zeros(robot.n), 0.0)
    close(floating.nonlinear_effects(q, 2.0 * v), 4.0 * floating.nonlinear_effects(q, v), 4.0 * size)
    close(robot.nonlinear_effects(q, v), floating.nonlinear_effects(q, v) + robot.gravity(q), size)
    close(robot.with_gravity([0.0, 0.0, 19.62]).gravity(q), -2.0 * robot.gravity(q), size)


# --- Many states at once -------------------------------------------------------------------------


@every_robot
@given(robots_and_states(), st.sampled_from([1, 3, 40]))
def test_a_batch_equals_its_rows_one_by_one_bit_by_bit(case: tuple[Robot, State], count: int) -> None:
    robot, state = case
    q, v, a = rows_of(state, count)
    a[count // 2] = 0.0  # inertia_solve skips such rows
    frame = f"link{robot.n}"
    for name, arguments in {
        "mass_matrix": (q,),
        "gravity": (q,),
        "nonlinear_effects": (q, v),
        "forward_dynamics": (q, v, a),
        "inverse_dynamics": (q, v, a),
        "inertia_times": (q, a),
        "inertia_solve": (q, a),
    }.items():
        method = getattr(robot, name)
        one_by_one = np.stack([method(*rows) for rows in zip(*arguments, strict=True)])
        np.testing.assert_array_equal(method(*arguments), one_by_one, err_msg=name)
    poses, alone = robot.frame_pose(frame, q), [robot.frame_pose(frame, row) for row in q]
    np.testing.assert_array_equal(poses.rotation, [pose.rotation for pose in alone])
    np.testing.assert_array_equal(poses.translation, [pose.translation for pose in alone])
    jacobians = [robot.frame_jacobian(frame, row) for row in q]
    np.testing.assert_array_equal(robot.frame_jacobian(frame, q), jacobians)


@every_robot
@given(robots_and_states(), decimals(-6.0, 6.0, digits=0))
def test_nothing_is_infinite_or_nan_however_fast_the_arm(case: tuple[Robot, State], exponent: float) -> None:
    robot, (q, v, a) = case
    v, a = 10.0**exponent * v, 10.0**exponent * a
    tau = robot.inverse_dynamics(q, v, a)
    for result in (
        tau,
        robot.mass_matrix(q),
        robot.forward_dynamics(q, v, tau),
        robot.inertia_solve(q, tau),
        *robot.frame_pose("link1", q),
        robot.frame_jacobian("link1", q),
    ):
        assert np.isfinite(result).all()


# --- Turns ---------------------------------------------------------------------------------------


@every_robot
@given(robots_and_states(types=["continuous", "prismatic"]), st.integers(-2, 2))
def test_a_continuous_joint_is_one_angle_and_a_turn_changes_nothing(
    case: tuple[Robot, State], turns: int
) -> None:
    robot, state = case
    q, v, a = state
    model = robot.pinocchio_model()
    assert model.nq == model.nv == robot.n == len(robot.joint_names)
    continuous = np.array([kind == "continuous" for kind in robot.joint_types])
    assert (np.isinf(robot.limits.lower) & np.isinf(robot.limits.upper) == continuous).all()

    turned = q + 2.0 * np.pi * turns * continuous
    # The angle itself is rounded, to eps of its up to 12 rad and two turns.
    size = 25.0 * scale(robot, state)
    close(robot.mass_matrix(turned), robot.mass_matrix(q), size)
    close(robot.inverse_dynamics(turned, v, a), robot.inverse_dynamics(q, v, a), size)
    pose, same = (robot.frame_pose(f"link{robot.n}", x) for x in (q, turned))
    close(same.rotation, pose.rotation, 25.0)
    close(same.translation, pose.translation, 25.0 * robot.n)


# --- Frames --------------------------------------------------------------------------------------


@every_robot
@given(robots_and_states(), st.data())
def test_the_jacobian_is_the_derivative_of_the_pose(case: tuple[Robot, State], data: st.DataObject) -> None:
    robot, (q, v, _) = case
    frame = data.draw(st.sampled_from(robot.frame_names))
    ahead, behind = (robot.frame_pose(frame, q + h * v) for h in (STEP, -STEP))
    linear = (ahead.translation - behind.translation) / (2.0 * STEP)
    angular = pin.log3(ahead.rotation @ behind.rotation.T) / (2.0 * STEP)
    J = robot.frame_jacobian(frame, q)
    # Third derivatives are cubes of speeds: of the arm's turning, and that times its reach.
    size = (1.0 + np.abs(v).sum()) ** 3
    np.testing.assert_allclose(J @ v, [*linear, *angular], rtol=0, atol=SLOPE * size)


# --- Robots made from robots ---------------------------------------------------------------------


@every_robot
@given(urdf_texts(min_joints=2), st.data())
def test_a_locked_joint_is_a_joint_held_still(text: str, data: st.DataObject) -> None:
    full = Robot.from_xml(text)
    q, v, a = state = data.draw(states(full))
    some = st.sets(st.sampled_from(full.joint_names), min_size=1, max_size=full.n - 1)
    held = sorted(data.draw(some))
    at = [full.joint_names.index(name) for name in held]
    v[at] = a[at] = 0.0
    robot = Robot.from_xml(text, lock=dict(zip(held, q[at], strict=True)))

    assert set(robot.joint_names) == set(full.joint_names) - set(held)
    free = [full.joint_names.index(name) for name in robot.joint_names]
    size = scale(full, state)
    close(robot.mass_matrix(q[free]), full.mass_matrix(q)[np.ix_(free, free)], size)
    close(robot.gravity(q[free]), full.gravity(q)[free], size)
    torque = full.inverse_dynamics(q, v, a)
    close(robot.inverse_dynamics(q[free], v[free], a[free]), torque[free], size)
    # And the torque that holds the joints still in the full arm is a reaction in the locked one.
    back = robot.forward_dynamics(q[free], v[free], torque[free])
    close(robot.mass_matrix(q[free]) @ (back - a[free]), np.zeros(robot.n), size)

    assert np.isclose(robot.total_mass, full.total_mass, rtol=ROUNDING)
    for frame in full.frame_names:
        pose, same = full.frame_pose(frame, q), robot.frame_pose(frame, q[free])
        close(same.rotation, pose.rotation, 1.0)
        close(same.translation, pose.translation, 1.0 + np.abs(pose.translation).max())


@every_robot
@given(urdf_texts(), BODIES, ANGLES, st.data())
def test_a_payload_is_a_link_with_that_mass_on_a_fixed_joint(
    text: str, body: dict[str, Array], rpy: Array, data: st.DataObject
) -> None:
    carrier = data.draw(st.sampled_from(Robot.from_xml(text).joint_names)).replace("joint", "link")
    weld = (
        f'<joint name="weld" type="fixed"><parent link="{carrier}"/><child link="plate"/>'
        f'<origin xyz="{words(data.draw(triples(0.5)))}" rpy="{words(rpy)}"/></joint></robot>'
    )
    empty = Robot.from_xml(text.replace("</robot>", '<link name="plate"/>' + weld))
    welded = Robot.from_xml(text.replace("</robot>", link("plate", **body) + weld))
    x, y, z = body["mass"] * np.square(body["spread"])
    turn = pin.rpy.rpyToMatrix(body["rpy"])
    inertia = turn @ np.diag([y + z, z + x, x + y]) @ turn.T
    loaded = empty.with_payload("plate", body["mass"], body["com"], inertia)

    q, v, a = state = data.draw(states(welded))
    size = scale(welded, state)
    close(loaded.mass_matrix(q), welded.mass_matrix(q), size)
    close(loaded.inverse_dynamics(q, v, a), welded.inverse_dynamics(q, v, a), size)
    assert np.isclose(loaded.total_mass, welded.total_mass, rtol=ROUNDING)


@every_robot
@given(robots_and_states(), decimals(0.1, 10.0), triples(0.5))
def test_the_weight_of_a_point_mass_reaches_the_joints_through_the_jacobian(
    case: tuple[Robot, State], mass: float, com: Array
) -> None:
    robot, state = case
    q, frame = state.q, f"link{robot.n}"
    loaded = robot.with_payload(frame, mass, com)
    J = robot.frame_jacobian(frame, q)
    arm = robot.frame_pose(frame, q).rotation @ com
    at_com = J[:3] + np.cross(J[3:], arm, axis=0)
    expected = robot.gravity(q) + at_com.T @ [0.0, 0.0, 9.81 * mass]
    close(loaded.gravity(q), expected, scale(loaded, state))


@every_robot
@given(robots_and_states(), st.data())
def test_armature_adds_to_the_diagonal_of_the_inertia_matrix_and_to_nothing_else(
    case: tuple[Robot, State], data: st.DataObject
) -> None:
    robot, state = case
    q, v, a = state
    armature = np.array([data.draw(decimals(0.0, 2.0)) for _ in robot.joint_names])
    geared = robot.with_armature(armature)
    size = scale(geared, state)
    close(geared.mass_matrix(q), robot.mass_matrix(q) + np.diag(armature), size)
    np.testing.assert_array_equal(geared.nonlinear_effects(q, v), robot.nonlinear_effects(q, v))
    close(geared.inertia_times(q, a), robot.inertia_times(q, a) + armature * a, size)
    # The articulated-body algorithm has to know it as well.
    D, back = geared.mass_matrix(q), geared.forward_dynamics(q, v, geared.inverse_dynamics(q, v, a))
    close(D @ (back - a), np.zeros(robot.n), size)


@every_robot
@given(robots(), decimals(0.1, 3.0), st.data())
def test_scaled_inertia_scales_every_torque_and_leaves_the_motion_to_a_scaled_torque_alone(
    robot: Robot, factor: float, data: st.DataObject
) -> None:
    robot = robot.with_armature(data.draw(decimals(0.0, 1.0)))
    q, v, a = state = data.draw(states(robot))
    scaled = robot.scaled_inertia(factor)
    size = (1.0 + factor) * scale(robot, state)
    close(scaled.mass_matrix(q), factor * robot.mass_matrix(q), size)
    close(scaled.nonlinear_effects(q, v), factor * robot.nonlinear_effects(q, v), size)
    close(scaled.inverse_dynamics(q, v, a), factor * robot.inverse_dynamics(q, v, a), size)
    assert np.isclose(scaled.total_mass, factor * robot.total_mass, rtol=ROUNDING)
    tau = robot.inverse_dynamics(q, v, a)
    moved = scaled.forward_dynamics(q, v, factor * tau)
    close(scaled.mass_matrix(q) @ (moved - a), np.zeros(robot.n), size)


def slope(function, q: Array, direction: Array) -> Array:  # type: ignore[no-untyped-def]
    """Return the derivative of a function along a direction, by central differences."""
    return (function(q + STEP * direction) - function(q - STEP * direction)) / (2.0 * STEP)
