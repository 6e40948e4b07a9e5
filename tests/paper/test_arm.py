"""The arm derived by hand, against Pinocchio on its URDF, Lagrange's equation and the printed page.

Pinocchio is used directly, on the shipped URDF, so that these tests depend on nothing of armgpi but
the module under test. Tolerances: torques, energies and inertias are sums of some ten terms of size
up to 100 in SI units, each rounded to 1.1e-16 of itself: 1e-12 leaves a digit or two of room.
"""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import pinocchio as pin
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from armgpi import Robot
from armgpi.errors import ArmgpiError, ArrayError, ParameterError, ReachError
from armgpi.paper.arm import REACH_TOLERANCE, ArmParameters, PaperArm
from armgpi.paper.parts import PaperInverse

Array = npt.NDArray[np.float64]
Elbow = Literal["up", "down"]

URDF = Path(__file__).parents[2] / "urdf" / "anthropomorphic3.urdf"
ROUNDING = 1e-12
STATES = 2000
ARM = PaperArm()
TABLE_1 = ARM.parameters
SHOULDER = np.array([0.0, 0.0, TABLE_1.d1])
INNER, OUTER = TABLE_1.l3 - TABLE_1.l2, TABLE_1.l3 + TABLE_1.l2  # [m] from the shoulder
ELBOWS: tuple[Elbow, ...] = ("up", "down")

angles = st.floats(-np.pi, np.pi)
configurations = st.tuples(angles, angles, angles).map(np.array)
elbows = st.sampled_from(ELBOWS)


@st.composite
def reachable_points(draw: st.DrawFn, margin: float = 0.0) -> Array:
    """Points of the workspace, at least `margin` [m] away from its two spheres."""
    azimuth = draw(st.floats(-np.pi, np.pi))
    elevation = draw(st.floats(-np.pi / 2, np.pi / 2))
    return from_shoulder(draw(st.floats(INNER + margin, OUTER - margin)), azimuth, elevation)


def from_shoulder(radius: float, azimuth: float, elevation: float) -> Array:
    """Return the point at these spherical coordinates about the shoulder."""
    level = np.cos(elevation)
    direction = [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]
    return SHOULDER + radius * np.array(direction)


class Oracle:
    """Pinocchio on the URDF, one state at a time."""

    def __init__(self) -> None:
        self.model = pin.buildModelFromUrdf(str(URDF))
        self.data = self.model.createData()

    def mass_matrix(self, q: Array) -> Array:
        return pin.crba(self.model, self.data, q).copy()

    def gravity(self, q: Array) -> Array:
        return pin.computeGeneralizedGravity(self.model, self.data, q).copy()

    def nonlinear_effects(self, q: Array, v: Array) -> Array:
        return pin.nonLinearEffects(self.model, self.data, q, v).copy()

    def coriolis_matrix(self, q: Array, v: Array) -> Array:
        return pin.computeCoriolisMatrix(self.model, self.data, q, v).copy()

    def forward_dynamics(self, q: Array, v: Array, tau: Array) -> Array:
        return pin.aba(self.model, self.data, q, v, tau).copy()

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        return pin.rnea(self.model, self.data, q, v, a).copy()

    def tool(self, q: Array) -> Array:
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.model.getFrameId("tool")].translation.copy()

    def kinetic_energy(self, q: Array, v: Array) -> float:
        return float(pin.computeKineticEnergy(self.model, self.data, q, v))

    def potential_energy(self, q: Array) -> float:
        return float(pin.computePotentialEnergy(self.model, self.data, q))

    def over(self, name: str, *states: Array) -> Array:
        """Evaluate a method on every row of its arguments."""
        return np.array([getattr(self, name)(*rows) for rows in zip(*states, strict=True)])


@pytest.fixture(scope="module")
def oracle() -> Oracle:
    """Pinocchio on the shipped URDF."""
    return Oracle()


@pytest.fixture(scope="module")
def states() -> tuple[Array, Array, Array]:
    """Random q over all angles, v and a: three arrays of shape (STATES, 3)."""
    rng = np.random.default_rng(20220907)
    q = rng.uniform(-np.pi, np.pi, (STATES, 3))
    return q, rng.uniform(-5.0, 5.0, (STATES, 3)), rng.uniform(-20.0, 20.0, (STATES, 3))


def derivative(function: Any, q: Array, direction: Array, step: float = 1e-3) -> Array:
    """Differentiate along a direction, centrally, to fourth order.

    The functions are trigonometric polynomials of frequency 2 at most, of size about 1 to 10. With
    |direction| about 1 the truncation error is below h^4/30 * 2^5 * 10 = 1e-11, the rounding error
    near 1e-16 * 10 / h = 1e-12. The tests allow 1e-9.
    """
    h = step * direction
    near = function(q + h) - function(q - h)
    far = function(q + 2.0 * h) - function(q - 2.0 * h)
    return np.asarray((8.0 * near - far) / (12.0 * step))


SLOPE = 1e-9  # tolerance of what goes through `derivative`


# --- The printed dynamics are those of the URDF ---------------------------------------------------


def test_urdf_carries_table_1(oracle: Oracle) -> None:
    turret, upper, fore = oracle.model.inertias.tolist()[1:]
    p = TABLE_1
    assert [link.mass for link in (turret, upper, fore)] == [p.m1, p.m2, p.m3]
    # Pinocchio merges link 1 with the base's fixed part: the lever is a sum, right to one bit.
    np.testing.assert_allclose(turret.lever, [0.0, 0.0, p.d1], rtol=0, atol=1e-16)
    np.testing.assert_array_equal(upper.lever, [p.lc2, 0.0, 0.0])
    np.testing.assert_array_equal(fore.lever, [p.lc3, 0.0, 0.0])
    assert turret.inertia[2, 2] == p.Iz1
    np.testing.assert_array_equal(upper.inertia, np.diag([p.Iz2, p.Iy2, p.Iz2]))
    np.testing.assert_array_equal(fore.inertia, np.diag([p.Iz3, p.Iy3, p.Iz3]))
    np.testing.assert_array_equal(oracle.model.gravity.linear, [0.0, 0.0, -p.g])


def test_urdf_names_the_joints_and_the_tool_as_the_paper_does(oracle: Oracle) -> None:
    assert list(oracle.model.names) == ["universe", "q1", "q2", "q3"]
    assert oracle.model.existFrame("tool")


def test_urdf_joint_limits_hold_both_elbows_of_the_laser_path(oracle: Oracle) -> None:
    for elbow in ELBOWS:
        q = ARM.inverse_kinematics(laser_path(), elbow)
        assert (q > oracle.model.lowerPositionLimit).all()
        assert (q < oracle.model.upperPositionLimit).all()


def test_urdf_effort_limits_hold_the_arm_level_with_disturbance_and_to_spare(
    oracle: Oracle,
) -> None:
    disturbance = np.array([0.7, 0.5, 0.3])  # bounds of eqs. 29 to 31 [N m]
    assert (oracle.model.effortLimit > 5.0 * (ARM.gravity(np.zeros(3)) + disturbance)).all()


def test_tool_position_of_eq_1_is_that_of_the_urdf(oracle: Oracle, states: Any) -> None:
    q, _, _ = states
    expected = oracle.over("tool", q)
    np.testing.assert_allclose(ARM.forward_kinematics(q), expected, rtol=0, atol=ROUNDING)


def test_inertia_matrix_of_eq_9_is_that_of_the_urdf(oracle: Oracle, states: Any) -> None:
    q, _, _ = states
    expected = oracle.over("mass_matrix", q)
    np.testing.assert_allclose(ARM.mass_matrix(q), expected, rtol=0, atol=ROUNDING)


def test_gravity_torque_of_eq_11_is_that_of_the_urdf(oracle: Oracle, states: Any) -> None:
    q, _, _ = states
    expected = oracle.over("gravity", q)
    np.testing.assert_allclose(ARM.gravity(q), expected, rtol=0, atol=ROUNDING)


def test_coriolis_torque_of_eq_10_is_that_of_the_urdf(oracle: Oracle, states: Any) -> None:
    q, v, _ = states
    expected = oracle.over("nonlinear_effects", q, v) - oracle.over("gravity", q)
    np.testing.assert_allclose(ARM.coriolis_torque(q, v), expected, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(
        ARM.coriolis_torque(q, v) + ARM.gravity(q),
        oracle.over("nonlinear_effects", q, v),
        rtol=0,
        atol=ROUNDING,
    )


def test_energies_of_eqs_5_and_6_are_those_of_the_urdf(oracle: Oracle, states: Any) -> None:
    q, v, _ = states
    kinetic, potential = oracle.over("kinetic_energy", q, v), oracle.over("potential_energy", q)
    np.testing.assert_allclose(ARM.kinetic_energy(q, v), kinetic, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(ARM.potential_energy(q), potential, rtol=0, atol=ROUNDING)


def test_inverse_dynamics_of_eq_8_is_that_of_the_urdf(oracle: Oracle, states: Any) -> None:
    q, v, a = states
    expected = oracle.over("inverse_dynamics", q, v, a)
    np.testing.assert_allclose(ARM.inverse_dynamics(q, v, a), expected, rtol=0, atol=ROUNDING)


def test_forward_dynamics_is_that_of_the_urdf_and_undoes_the_inverse(oracle: Oracle, states: Any) -> None:
    q, v, a = states
    tau = ARM.inverse_dynamics(q, v, a)
    solved = ARM.forward_dynamics(q, v, tau)
    # Solving with D divides by its smallest eigenvalue, above 2e-3, and so loses three digits.
    np.testing.assert_allclose(solved, a, rtol=0, atol=1e3 * ROUNDING)
    expected = oracle.over("forward_dynamics", q, v, tau)
    np.testing.assert_allclose(solved, expected, rtol=0, atol=1e3 * ROUNDING)


# --- Laws of mechanics that need no second implementation -----------------------------------------


def test_kinetic_energy_is_half_v_d_v(states: Any) -> None:
    q, v, _ = states
    expected = np.einsum("ni,nij,nj->n", v, ARM.mass_matrix(q), v) / 2.0
    np.testing.assert_allclose(ARM.kinetic_energy(q, v), expected, rtol=0, atol=ROUNDING)


@given(configurations)
def test_inertia_matrix_is_symmetric_and_positive_definite(q: Array) -> None:
    d = ARM.mass_matrix(q)
    np.testing.assert_array_equal(d, d.T)
    assert np.linalg.eigvalsh(d).min() > 1e-3  # [kg m^2]


def test_gravity_torque_is_the_slope_of_the_potential_energy(states: Any) -> None:
    q, _, _ = states
    slope = np.stack([derivative(ARM.potential_energy, q, axis) for axis in np.eye(3)], axis=-1)
    np.testing.assert_allclose(ARM.gravity(q), slope, rtol=0, atol=SLOPE)


def test_coriolis_torque_is_what_lagrange_equation_3_demands(states: Any) -> None:
    q, v, _ = states
    v = v / 5.0  # of size 1, as `derivative` wants it
    momentum_drift = np.einsum("nij,nj->ni", derivative(ARM.mass_matrix, q, v), v)

    def kinetic(configuration: Array) -> Array:
        return ARM.kinetic_energy(configuration, v)

    slope = np.stack([derivative(kinetic, q, axis) for axis in np.eye(3)], axis=-1)
    np.testing.assert_allclose(ARM.coriolis_torque(q, v), momentum_drift - slope, rtol=0, atol=SLOPE)


def test_printed_coriolis_matrix_is_not_christoffel_but_its_torque_is_right(
    oracle: Oracle, states: Any
) -> None:
    q, v, _ = states
    printed, christoffel = ARM.coriolis_matrix(q, v), oracle.over("coriolis_matrix", q, v)
    assert np.abs(printed - christoffel).max() > 0.1  # [N m s/rad]
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", printed, v),
        np.einsum("nij,nj->ni", christoffel, v),
        rtol=0,
        atol=ROUNDING,
    )


def test_d_dot_minus_2c_is_skew_for_christoffel_and_not_for_the_printed_c(
    oracle: Oracle, states: Any
) -> None:
    q, v, _ = states
    v = v / 5.0  # of size 1, as `derivative` wants it
    d_dot = derivative(ARM.mass_matrix, q, v)

    def symmetric_part(c: Array) -> Array:
        n = d_dot - 2.0 * c
        return (n + np.swapaxes(n, -1, -2)) / 2.0

    assert np.abs(symmetric_part(oracle.over("coriolis_matrix", q, v))).max() < SLOPE
    printed = symmetric_part(ARM.coriolis_matrix(q, v))
    assert np.abs(printed).max() > 0.05  # [N m s/rad]
    # What energy conservation needs holds all the same: v' (dD/dt - 2 C) v = 0.
    assert np.abs(np.einsum("ni,nij,nj->n", v, printed, v)).max() < SLOPE


def test_power_of_the_joint_torques_is_the_rate_of_the_energy(states: Any) -> None:
    q, v, a = states
    v, a = v / 5.0, a / 20.0  # of size 1, as `derivative` wants them
    power = np.sum(v * ARM.inverse_dynamics(q, v, a), axis=-1)

    def energy(state: Array) -> Array:
        configuration, velocity = state[:, :3], state[:, 3:]
        return ARM.kinetic_energy(configuration, velocity) + ARM.potential_energy(configuration)

    rate = derivative(energy, np.hstack([q, v]), np.hstack([v, a]))
    np.testing.assert_allclose(power, rate, rtol=0, atol=SLOPE)


@given(configurations, st.floats(-np.pi, np.pi))
def test_dynamics_do_not_depend_on_the_azimuth(q: Array, turn: float) -> None:
    turned, v, a = np.array([turn, q[1], q[2]]), [1.0, -2.0, 3.0], [4.0, 5.0, -6.0]
    tau = ARM.inverse_dynamics(q, v, a)
    np.testing.assert_array_equal(ARM.inverse_dynamics(turned, v, a), tau)


# --- Inverse kinematics ---------------------------------------------------------------------------


@given(reachable_points(), elbows)
def test_inverse_kinematics_puts_the_tool_at_any_reachable_point(point: Array, elbow: Elbow) -> None:
    tool = ARM.forward_kinematics(ARM.inverse_kinematics(point, elbow))
    # Sine and cosine of q3 come from one number, so even next to the singular spheres, where angles
    # are ill-conditioned, their errors cancel in the position: only rounding of 1 m is left.
    np.testing.assert_allclose(tool, point, rtol=0, atol=1e-14)


@given(reachable_points(margin=1e-3))
def test_elbow_up_and_elbow_down_are_two_postures_on_either_side_of_the_line(point: Array) -> None:
    up, down = ARM.inverse_kinematics(point, "up"), ARM.inverse_kinematics(point, "down")
    assert up[0] == down[0]
    assert up[2] == -down[2] < 0.0
    # The two shoulder angles lie symmetrically about the direction of the tool, up above down.
    rise = np.arctan2(point[2] - TABLE_1.d1, np.hypot(point[0], point[1]))
    assert up[1] > rise > down[1]
    assert up[1] + down[1] == pytest.approx(2.0 * rise, abs=1e-14)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(0.01, 3.1), elbows)
def test_inverse_kinematics_returns_the_posture_that_made_the_point(
    q1: float, q2: float, bend: float, elbow: Elbow
) -> None:
    q = np.array([q1, q2, -bend if elbow == "up" else bend])
    point = ARM.forward_kinematics(q)
    facing = TABLE_1.l2 * np.cos(q2) + TABLE_1.l3 * np.cos(q2 + q[2])
    assume(facing > 1e-3)  # else the arm leans back over its axis, and another q1 faces the point
    # cos q3 determines q3 up to eps / sin(0.01), and x, y determine q1 up to eps / 1e-3 [m].
    np.testing.assert_allclose(ARM.inverse_kinematics(point, elbow), q, rtol=0, atol=1e-11)


@pytest.mark.parametrize("radius", [INNER, OUTER])
@given(azimuth=angles, elevation=st.floats(-np.pi / 2, np.pi / 2), elbow=elbows)
def test_the_singular_spheres_belong_to_the_workspace(
    radius: float, azimuth: float, elevation: float, elbow: Elbow
) -> None:
    point = from_shoulder(radius, azimuth, elevation)
    tool = ARM.forward_kinematics(ARM.inverse_kinematics(point, elbow))
    np.testing.assert_allclose(tool, point, rtol=0, atol=1e-14)


@pytest.mark.parametrize("outward", [-1.0, 1.0])
def test_only_what_may_be_rounding_counts_as_on_the_singular_sphere(outward: float) -> None:
    radius = OUTER if outward > 0.0 else INNER

    def point(tolerances: float) -> Array:
        return from_shoulder(radius + outward * tolerances * REACH_TOLERANCE, 0.3, 0.0)

    tool = ARM.forward_kinematics(ARM.inverse_kinematics(point(0.5)))
    np.testing.assert_allclose(tool, point(0.5), rtol=0, atol=REACH_TOLERANCE)
    with pytest.raises(ReachError):
        ARM.inverse_kinematics(point(2.0))


@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_a_point_on_the_axis_of_q1_is_reached_with_q1_zero(zero: float) -> None:
    point = np.array([zero, zero, TABLE_1.d1 + 0.35])
    q = ARM.inverse_kinematics(point)
    assert q[0] == 0.0
    np.testing.assert_allclose(ARM.forward_kinematics(q), point, rtol=0, atol=1e-14)


@given(
    st.one_of(st.floats(0.0, INNER - 1e-6), st.floats(OUTER + 1e-6, 100.0)),
    angles,
    st.floats(-np.pi / 2, np.pi / 2),
    elbows,
)
def test_a_point_out_of_reach_is_refused_with_its_distance(
    radius: float, azimuth: float, elevation: float, elbow: Elbow
) -> None:
    point = from_shoulder(radius, azimuth, elevation)
    with pytest.raises(ReachError, match="out of reach") as caught:
        ARM.inverse_kinematics(point, elbow)
    assert caught.value.point == tuple(point)
    missing = max(radius - OUTER, INNER - radius)
    assert caught.value.distance == pytest.approx(missing, abs=1e-13)  # 1e-16 of 100 m, and room
    assert isinstance(caught.value, ArmgpiError)


def test_of_many_points_the_one_furthest_out_of_reach_is_named() -> None:
    points = np.array([[[0.3, 0.0, 0.2], [0.0, 0.0, 0.15]], [[0.0, 0.9, 0.14], [0.6, 0.0, 0.14]]])
    with pytest.raises(ReachError, match=r"\(0, 0\.9, 0\.14\) m is 0\.4 m out of reach") as caught:
        ARM.inverse_kinematics(points)
    assert caught.value.point == (0.0, 0.9, 0.14)
    assert caught.value.distance == pytest.approx(0.4, abs=1e-15)


# --- Errata: the printed form fails where the corrected one holds ---------------------------------


def printed_inverse_kinematics(xyz: Array, sign: float) -> Array:
    """Eq. 2 as printed: arctan throughout, the free sign in q3 only."""
    p = TABLE_1
    x, y, z = xyz[..., 0], xyz[..., 1], xyz[..., 2]
    h = z - p.d1
    cosine = (x**2 + y**2 + h**2 - p.l2**2 - p.l3**2) / (2.0 * p.l2 * p.l3)
    root = np.sqrt(1.0 - cosine**2)
    q1 = np.arctan(y / x)
    q2 = np.arctan(h / np.sqrt(x**2 + y**2)) - np.arctan(p.l3 * root / (p.l2 + p.l3 * cosine))
    q3 = np.arctan(sign * root / cosine)
    return np.stack([q1, q2, q3], axis=-1)


def laser_path() -> Array:
    """Points of the paper's own laser path (eq. 28), shape (200, 3)."""
    t = np.linspace(0.0, 2.0 * np.pi, 200)
    wave = np.pi + t
    x = 0.08 + 0.15 * t / 4.0
    y = -0.15 + 0.05 * np.cos(wave) * np.sin(wave)
    return np.stack([x, y, 0.4 - 0.1 * np.cos(wave) ** 2], axis=-1)


def misses(q: Array, xyz: Array) -> Array:
    """Return how far the tool is from where it should be [m]."""
    return np.asarray(np.linalg.norm(ARM.forward_kinematics(q) - xyz, axis=-1))


def test_printed_eq_2_holds_in_front_with_the_elbow_down_and_bent_by_less_than_90_degrees() -> None:
    q = np.array([[0.4, 0.3, 0.8], [-1.2, -0.2, 1.4]])
    point = ARM.forward_kinematics(q)
    np.testing.assert_allclose(printed_inverse_kinematics(point, +1.0), q, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("q", "lost"),
    [
        ([2.5, 0.3, 0.8], "the quadrant of q1, behind the robot"),
        ([0.4, 0.3, 1.8], "the quadrant of q3, elbow bent beyond 90 degrees"),
        ([0.4, -0.9, 2.6], "the quadrants of q2 and q3, cos q3 < -l2/l3"),
    ],
)
def test_printed_arctan_of_eq_2_loses_the_quadrant_where_arctan2_keeps_it(q: list[float], lost: str) -> None:
    point = ARM.forward_kinematics(q)
    assert misses(printed_inverse_kinematics(point, +1.0), point) > 0.1, lost  # [m]
    np.testing.assert_allclose(ARM.inverse_kinematics(point, "down"), q, rtol=0, atol=1e-14)


def test_printed_sign_of_eq_2_in_q3_alone_misses_the_point_where_a_shared_one_reaches_it() -> None:
    q = np.array([0.4, 0.9, -0.8])  # elbow up, all quadrants the first
    point = ARM.forward_kinematics(q)
    assert misses(printed_inverse_kinematics(point, -1.0), point) > 0.1  # [m]
    np.testing.assert_allclose(ARM.inverse_kinematics(point, "up"), q, rtol=0, atol=1e-14)


@pytest.mark.parametrize("sign", [+1.0, -1.0])
def test_printed_eq_2_cannot_follow_the_papers_own_laser_path(sign: float) -> None:
    path = laser_path()
    assert misses(printed_inverse_kinematics(path, sign), path).max() > 0.1  # [m]
    for elbow in ELBOWS:
        q = ARM.inverse_kinematics(path, elbow)
        assert misses(q, path).max() < 1e-14
        # And the branch does not jump: a 200th of the path turns no joint by more than a tenth.
        assert np.abs(np.diff(q, axis=0)).max() < 0.1  # [rad]


def test_printed_k2_of_eq_5_disagrees_with_eq_9_and_cos_squared_agrees(states: Any) -> None:
    q, v, _ = states
    p, sin2 = TABLE_1, np.sin(q[:, 1])

    def k2(factor: Array) -> Array:
        moving = p.m2 * p.lc2**2 * (factor * v[:, 0] ** 2 + v[:, 1] ** 2)
        return np.asarray(moving + p.Iz2 * v[:, 0] ** 2 + p.Iy2 * v[:, 1] ** 2) / 2.0

    # Without the mass and inertia of link 2 what is left of v' D v / 2 is K1 + K3.
    tiny = 1e-300
    others = PaperArm(replace(p, m2=tiny, Iy2=tiny, Iz2=tiny)).mass_matrix(q)
    link2 = np.einsum("ni,nij,nj->n", v, ARM.mass_matrix(q) - others, v) / 2.0
    assert np.abs(k2((1.0 - sin2) ** 2) - link2).max() > 0.1  # [J]
    np.testing.assert_allclose(k2(1.0 - sin2**2), link2, rtol=0, atol=ROUNDING)


def test_g_inside_eq_11_and_again_in_eq_8_is_once_too_often(oracle: Oracle) -> None:
    level = np.zeros(3)
    expected = oracle.gravity(level)
    np.testing.assert_allclose(ARM.gravity(level), expected, rtol=0, atol=ROUNDING)
    twice = ARM.gravity(level) * TABLE_1.g
    assert twice[1] > 9.0 * expected[1]


def test_turning_about_plus_y_as_section_2_1_says_would_lower_the_arm_that_eq_1_lifts() -> None:
    configuration = np.array([0.0, 0.5, 0.0])
    level, raised = ARM.forward_kinematics(np.zeros(3)), ARM.forward_kinematics(configuration)
    about_plus_y = SHOULDER + pin.utils.rotate("y", 0.5) @ (level - SHOULDER)
    about_minus_y = SHOULDER + pin.utils.rotate("y", -0.5) @ (level - SHOULDER)
    assert about_plus_y[2] < TABLE_1.d1 < raised[2]
    np.testing.assert_allclose(raised, about_minus_y, rtol=0, atol=1e-15)


# --- The inertia of link 2 ------------------------------------------------------------------------


def excess_over_triangle(inertia: Array) -> float:
    """Return the largest principal moment less the sum of the two others [kg m^2]."""
    moments = np.linalg.eigvalsh(inertia)
    return float(moments[2] - moments[1] - moments[0])


def test_link_2_and_no_other_violates_the_triangle_inequality(oracle: Oracle) -> None:
    turret, upper, fore = (link.inertia for link in oracle.model.inertias.tolist()[1:])
    assert excess_over_triangle(turret) < 0.0
    assert excess_over_triangle(upper) == pytest.approx(0.0054 - 2 * 0.0013, abs=1e-15)
    assert excess_over_triangle(fore) < 0.0


def test_constant_yaw_inertia_needs_ixx_equal_to_izz(oracle: Oracle) -> None:
    q = np.array([0.3, 0.9, -0.4])
    model = oracle.model.copy()
    link, moments = model.inertias[2], np.array([0.0041, TABLE_1.Iy2, TABLE_1.Iz2])
    model.inertias[2] = pin.Inertia(link.mass, link.lever, np.diag(moments))
    yaw = pin.crba(model, model.createData(), q)[0, 0] - ARM.mass_matrix(q)[0, 0]
    # A body of a legal inertia, Ixx = Iy2 - Iz2, turns with Ixx sin^2 q2 + Izz cos^2 q2 instead.
    assert yaw == pytest.approx((moments[0] - moments[2]) * np.sin(q[1]) ** 2, abs=ROUNDING)
    assert excess_over_triangle(np.diag(moments)) == pytest.approx(0.0, abs=1e-15)


def test_mujoco_refuses_link_2_unless_told_to_repair_it_and_then_it_is_another_body() -> None:
    mujoco = pytest.importorskip("mujoco")
    urdf = URDF.read_text(encoding="utf-8")
    with pytest.raises(ValueError, match=r"inertia must satisfy A \+ B >= C(.|\n)*link2"):
        mujoco.MjModel.from_xml_string(urdf)

    order = '<mujoco><compiler balanceinertia="true"/></mujoco>'
    model = mujoco.MjModel.from_xml_string(urdf.replace("</robot>", order + "</robot>"))
    printed = [TABLE_1.Iz2, TABLE_1.Iy2, TABLE_1.Iz2]
    assert np.abs(model.body("link2").inertia - printed).min() > 1e-3  # [kg m^2]


def test_mujoco_agrees_with_the_equations_once_link_2_is_a_possible_body() -> None:
    mujoco = pytest.importorskip("mujoco")
    flat = replace(TABLE_1, Iy2=2.0 * TABLE_1.Iz2)  # the flattest body with the printed yaw inertia
    urdf = URDF.read_text(encoding="utf-8")
    changed = urdf.replace(f'iyy="{TABLE_1.Iy2}"', f'iyy="{flat.Iy2}"')
    assert changed != urdf
    model = mujoco.MjModel.from_xml_string(changed)
    data = mujoco.MjData(model)
    q, v, tau = np.array([[0.7, 0.5, -1.1], [0.3, -0.8, 1.7], [0.4, 2.5, 0.6]])
    data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, v, tau
    mujoco.mj_forward(model, data)
    # Through D^-1, as above; MuJoCo also keeps inertias as principal moments and rotations.
    expected = PaperArm(flat).forward_dynamics(q, v, tau)
    np.testing.assert_allclose(data.qacc, expected, rtol=0, atol=1e3 * ROUNDING)


# --- Arrays and parameters ------------------------------------------------------------------------


def test_leading_axes_are_batch_and_every_row_is_what_it_would_be_alone(states: Any) -> None:
    q, v, a = (array[:10].reshape(2, 5, 3) for array in states)
    point = ARM.forward_kinematics(q)
    calls: dict[str, tuple[Array, ...]] = {
        "forward_kinematics": (q,),
        "inverse_kinematics": (point,),
        "mass_matrix": (q,),
        "coriolis_matrix": (q, v),
        "coriolis_torque": (q, v),
        "gravity": (q,),
        "kinetic_energy": (q, v),
        "potential_energy": (q,),
        "inverse_dynamics": (q, v, a),
        "forward_dynamics": (q, v, a),
    }
    for name, arguments in calls.items():
        method = getattr(ARM, name)
        batch = method(*arguments)
        assert batch.shape[:2] == (2, 5), name
        assert batch.dtype == np.float64, name
        for i, j in np.ndindex(2, 5):
            alone = method(*(argument[i, j] for argument in arguments))
            assert alone.shape == batch.shape[2:], name
            # NumPy may take another kernel for another length: the last bits can differ.
            np.testing.assert_allclose(batch[i, j], alone, rtol=1e-12, atol=1e-13, err_msg=name)


def test_batch_axes_of_several_arguments_broadcast(states: Any) -> None:
    q, v, a = states[0][0], states[1][:4], states[2][:5, np.newaxis]
    tau = ARM.inverse_dynamics(q, v, a)
    assert tau.shape == (5, 4, 3)
    np.testing.assert_allclose(
        ARM.forward_dynamics(q, v, tau), np.broadcast_to(a, tau.shape), rtol=0, atol=1e3 * ROUNDING
    )


def test_an_empty_batch_gives_an_empty_result() -> None:
    none = np.zeros((0, 3))
    assert ARM.forward_dynamics(none, none, none).shape == (0, 3)
    assert ARM.inverse_kinematics(none).shape == (0, 3)


def test_arguments_are_left_as_they_were(states: Any) -> None:
    q, v, a = (array[:3].copy() for array in states)
    before = [q.copy(), v.copy(), a.copy()]
    for array in (q, v, a):
        array.setflags(write=False)
    ARM.inverse_dynamics(q, v, a)
    ARM.forward_dynamics(q, v, a)
    for array, old in zip((q, v, a), before, strict=True):
        np.testing.assert_array_equal(array, old)


@pytest.mark.parametrize(
    ("method", "arguments", "name"),
    [
        ("mass_matrix", ([0.0, 0.0],), "q"),
        ("gravity", (0.0,), "q"),
        ("coriolis_matrix", ([0.0, 0.0, 0.0], [0.0, np.nan, 0.0]), "v"),
        ("forward_dynamics", (np.zeros((2, 3)), np.zeros((3, 3)), np.zeros(3)), "q/v/tau"),
        ("inverse_kinematics", ([0.3, 0.1],), "xyz"),
        ("inverse_kinematics", ([0.3, 0.1, np.nan],), "xyz"),
    ],
)
def test_arrays_of_wrong_shape_or_content_are_refused_by_name(
    method: str, arguments: tuple[Any, ...], name: str
) -> None:
    with pytest.raises(ArrayError) as caught:
        getattr(ARM, method)(*arguments)
    assert caught.value.name == name


def test_an_elbow_that_is_neither_up_nor_down_is_refused() -> None:
    with pytest.raises(ParameterError, match="elbow must be 'up' or 'down', got 'left'"):
        ARM.inverse_kinematics([0.3, 0.0, 0.2], "left")


@pytest.mark.parametrize("name", [field.name for field in fields(ArmParameters)])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_parameters_that_no_arm_has_are_refused_by_name(name: str, value: float) -> None:
    if name == "g" and np.isfinite(value):  # weightless or upside down is fine
        upside_down = PaperArm(replace(TABLE_1, g=value)).gravity(np.zeros(3))
        np.testing.assert_allclose(upside_down, value / TABLE_1.g * ARM.gravity(np.zeros(3)), rtol=1e-15)
        return
    with pytest.raises(ParameterError) as caught:
        replace(TABLE_1, **{name: value})
    assert caught.value.name == name


def test_the_papers_inverse_fits_its_own_arm_and_no_other() -> None:
    arm = Robot.load("anthropomorphic3")
    tip = arm.tip
    assert PaperInverse.fits(arm, tip)
    assert not PaperInverse.fits(arm, arm.joint_names[1])
    assert not PaperInverse.fits(Robot.load("finger_edu"), Robot.load("finger_edu").tip)
    assert not PaperInverse.fits(Robot.load("ur5"), Robot.load("ur5").tip)
