"""The paper's 3-DOF anthropomorphic arm, by hand: kinematics and dynamics from eqs. 1 to 11.

Written from the printed equations alone, without Pinocchio, so that the two can be compared. Joint
1 turns about +Z, joints 2 and 3 about -Y (section 2.1 says Y, but in eq. 1 positive angles lift the
arm), and at q = 0 the arm lies along +X.

Every method takes arrays whose last axis runs over the joints (or over x, y, z); any leading axes
are batch, and those of several arguments broadcast. All units are SI: m, rad, s, kg, N m, J.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

from armgpi.base.arrays import Array, ArrayLike, as_float_array
from armgpi.errors import ArrayError, ParameterError, ReachError

#: A point outside the workspace by no more than this counts as on its boundary: rounding [m].
REACH_TOLERANCE = 1e-12

_ELBOW_SIGNS = {"up": -1.0, "down": 1.0}  # sign of q3


@dataclass(frozen=True)
class ArmParameters:
    """Lengths, masses and inertias of the arm; the defaults are Table 1.

    Inertias are about each link's centre of mass. The default link 2 is no rigid body: eq. 9 takes
    its yaw inertia as constant, which needs Ixx = Izz, and Iy2 > 2 Iz2 then violates the triangle
    inequality.

    Attributes:
        m1: mass of link 1 [kg].
        m2: mass of link 2 [kg].
        m3: mass of link 3 and the end effector [kg].
        d1: height of the axis of q2 above the base [m].
        l2: length of link 2, from the axis of q2 to the axis of q3 [m].
        lc2: distance from the axis of q2 to the centre of mass of link 2 [m].
        l3: length of link 3, from the axis of q3 to the tool [m].
        lc3: distance from the axis of q3 to the centre of mass of link 3 [m].
        Iz1: yaw inertia of link 1 [kg m^2].
        Iy2: pitch inertia of link 2 [kg m^2].
        Iz2: yaw inertia of link 2 [kg m^2].
        Iy3: pitch inertia of link 3 [kg m^2].
        Iz3: yaw inertia of link 3 [kg m^2].
        g: acceleration of gravity, downwards [m/s^2].

    Raises:
        ParameterError: when a value is not finite, or one other than g is not positive.
    """

    m1: float = 0.73
    m2: float = 0.85
    m3: float = 0.51
    d1: float = 0.14
    l2: float = 0.20
    lc2: float = 0.10
    l3: float = 0.30
    lc3: float = 0.20
    Iz1: float = 0.0015
    Iy2: float = 0.0054
    Iz2: float = 0.0013
    Iy3: float = 0.0031
    Iz3: float = 0.0032
    g: float = 9.81

    def __post_init__(self) -> None:
        """Refuse values that no arm has."""
        for field in fields(self):
            value = getattr(self, field.name)
            if not np.isfinite(value):
                raise ParameterError(field.name, value, "finite")
            if field.name != "g" and value <= 0.0:
                raise ParameterError(field.name, value, "positive")


@dataclass(frozen=True)
class PaperArm:
    """The arm of section 2: eqs. 1, 2 and 5 to 11 as methods.

    Attributes:
        parameters: lengths, masses and inertias; Table 1 by default.
    """

    parameters: ArmParameters = ArmParameters()

    def forward_kinematics(self, q: ArrayLike) -> Array:
        """Return where the tool is (eq. 1).

        Args:
            q: joint angles [rad], shape (..., 3).

        Returns:
            Position x, y, z of the tool in the base frame [m], shape (..., 3).

        Raises:
            ArrayError: when q is not a finite float64 array of shape (..., 3).
        """
        p = self.parameters
        q1, q2, q3 = _columns(_vectors(q, "q"))
        reach = p.l2 * np.cos(q2) + p.l3 * np.cos(q2 + q3)
        x = np.cos(q1) * reach  # Eq. 1
        y = np.sin(q1) * reach
        z = p.d1 + p.l2 * np.sin(q2) + p.l3 * np.sin(q2 + q3)
        return np.stack([x, y, z], axis=-1)

    def inverse_kinematics(self, xyz: ArrayLike, elbow: Literal["up", "down"] = "up") -> Array:
        """Return joint angles that put the tool at a point (eq. 2, corrected).

        The arm always faces the point: q1 is the azimuth of the point, and 0 for a point on the
        axis of q1. Angles are not wrapped and joint limits are not checked: q2 lies within ±3π/2,
        q3 within ±π.

        Args:
            xyz: tool position in the base frame [m], shape (..., 3).
            elbow: "up" holds the elbow above the line from shoulder to tool (q3 <= 0), "down" below
                it (q3 >= 0, the + sign of the printed equation).

        Returns:
            Joint angles [rad], shape (..., 3).

        Raises:
            ReachError: when a point is out of reach; it carries the worst point and its distance
                from the nearest reachable one. A distance within `REACH_TOLERANCE` is rounding.
            ArrayError: when xyz is not a finite float64 array of shape (..., 3).
            ParameterError: when elbow is neither "up" nor "down".
        """
        if elbow not in _ELBOW_SIGNS:
            raise ParameterError("elbow", elbow, "'up' or 'down'")
        points = _vectors(xyz, "xyz")
        p = self.parameters
        x, y, z = _columns(points)
        r, h = np.hypot(x, y), z - p.d1  # the shoulder's vertical plane
        self._check_reach(points, np.hypot(r, h))

        # Cosine and sine of q3, by the law of cosines.
        cosine = (r**2 + h**2 - p.l2**2 - p.l3**2) / (2.0 * p.l2 * p.l3)
        cosine = np.clip(cosine, -1.0, 1.0)
        sine = _ELBOW_SIGNS[elbow] * np.sqrt((1.0 - cosine) * (1.0 + cosine))
        # Eq. 2 prints arctan, which loses the quadrant, and lets q3 alone choose the sign of the
        # root. The quadrant needs arctan2; the elbow is one choice, so q2 and q3 share one sign.
        q1 = np.arctan2(y, x + 0.0)  # + 0.0: the azimuth of x = -0.0, y = 0 is 0 as well, not pi
        q2 = np.arctan2(h, r) - np.arctan2(p.l3 * sine, p.l2 + p.l3 * cosine)
        q3 = np.arctan2(sine, cosine)
        return np.stack([q1, q2, q3], axis=-1)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Return the inertia matrix D (eq. 9).

        Args:
            q: joint angles [rad], shape (..., 3).

        Returns:
            D(q) [kg m^2], shape (..., 3, 3), symmetric and positive definite.

        Raises:
            ArrayError: when q is not a finite float64 array of shape (..., 3).
        """
        p = self.parameters
        q = _vectors(q, "q")
        _, q2, q3 = _columns(q)
        coupling = p.m3 * p.l2 * p.lc3
        d = np.zeros((*q.shape, 3))
        # Eq. 9; it prints D times the accelerations, and names that product D.
        d[..., 0, 0] = (
            p.Iz1
            + p.Iz2
            + p.Iz3
            + p.m2 / 2.0 * p.lc2**2 * (1.0 + np.cos(2.0 * q2))
            + coupling * (np.cos(2.0 * q2 + q3) + np.cos(q3))
            + p.m3 / 2.0 * p.l2**2 * (1.0 + np.cos(2.0 * q2))
            + p.m3 / 2.0 * p.lc3**2 * (1.0 + np.cos(2.0 * q2 + 2.0 * q3))
        )
        d[..., 1, 1] = (
            p.Iy2 + p.Iy3 + p.m2 * p.lc2**2 + 2.0 * coupling * np.cos(q3) + p.m3 * (p.l2**2 + p.lc3**2)
        )
        d[..., 1, 2] = p.Iy3 + coupling * np.cos(q3) + p.m3 * p.lc3**2
        d[..., 2, 1] = d[..., 1, 2]
        d[..., 2, 2] = p.Iy3 + p.m3 * p.lc3**2
        return d

    def coriolis_matrix(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return the Coriolis and centripetal matrix C as printed (eq. 10).

        Physics determines only the product C v, and that is right. This C is not the one of the
        Christoffel symbols: dD/dt - 2 C is not skew-symmetric, so a passivity argument that needs
        it must use another factorisation of the same torque.

        Args:
            q: joint angles [rad], shape (..., 3).
            v: joint velocities [rad/s], shape (..., 3).

        Returns:
            C(q, v) [N m s/rad], shape (..., 3, 3).

        Raises:
            ArrayError: when q or v is not a finite float64 array of shape (..., 3), or their batch
                axes do not broadcast.
        """
        p = self.parameters
        q, v = _broadcast(q=q, v=v)
        _, q2, q3 = _columns(q)
        v1, v2, v3 = _columns(v)
        coupling = p.m3 * p.l2 * p.lc3
        sin22 = np.sin(2.0 * q2)
        sin223 = np.sin(2.0 * q2 + q3)
        sin2233 = np.sin(2.0 * q2 + 2.0 * q3)
        # -d(d11)/dq2, which c12 and c21 share, and -d(d11)/dq3, which c13 and c31 share.
        fall2 = p.m2 * p.lc2**2 * sin22 + p.m3 * (
            p.l2**2 * sin22 + 2.0 * p.l2 * p.lc3 * sin223 + p.lc3**2 * sin2233
        )
        fall3 = p.m3 * p.lc3 * (p.l2 * (sin223 + np.sin(q3)) + p.lc3 * sin2233)
        c = np.zeros((*q.shape, 3))
        c[..., 0, 1] = -fall2 * v1  # Eq. 10
        c[..., 0, 2] = -fall3 * v1
        c[..., 1, 0] = fall2 / 2.0 * v1
        c[..., 1, 1] = -2.0 * coupling * np.sin(q3) * v3
        c[..., 1, 2] = -coupling * np.sin(q3) * v3
        c[..., 2, 0] = fall3 / 2.0 * v1  # the printed grouping, m3/2 over both terms, is right
        c[..., 2, 1] = coupling * np.sin(q3) * v2
        return c

    def coriolis_torque(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return the Coriolis and centripetal torque C(q, v) v (eqs. 7 and 10).

        Args:
            q: joint angles [rad], shape (..., 3).
            v: joint velocities [rad/s], shape (..., 3).

        Returns:
            Torque [N m], shape (..., 3).

        Raises:
            ArrayError: when q or v is not a finite float64 array of shape (..., 3), or their batch
                axes do not broadcast.
        """
        q, v = _broadcast(q=q, v=v)
        return _times(self.coriolis_matrix(q, v), v)

    def gravity(self, q: ArrayLike) -> Array:
        """Return the torque that holds the arm against gravity (eq. 11).

        Args:
            q: joint angles [rad], shape (..., 3).

        Returns:
            G(q) [N m], shape (..., 3).

        Raises:
            ArrayError: when q is not a finite float64 array of shape (..., 3).
        """
        p = self.parameters
        q = _vectors(q, "q")
        _, q2, q3 = _columns(q)
        torque = np.zeros(q.shape)
        # Eq. 11, with g inside; eq. 8 prints it once more outside.
        torque[..., 2] = p.m3 * p.lc3 * np.cos(q2 + q3) * p.g
        torque[..., 1] = (p.m2 * p.lc2 + p.m3 * p.l2) * np.cos(q2) * p.g + torque[..., 2]
        return torque

    def kinetic_energy(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return the kinetic energy (eq. 5, K2 corrected), equal to v' D(q) v / 2.

        Args:
            q: joint angles [rad], shape (..., 3).
            v: joint velocities [rad/s], shape (..., 3).

        Returns:
            K(q, v) [J], shape (...).

        Raises:
            ArrayError: when q or v is not a finite float64 array of shape (..., 3), or their batch
                axes do not broadcast.
        """
        p = self.parameters
        q, v = _broadcast(q=q, v=v)
        _, q2, q3 = _columns(q)
        v1, v2, v3 = _columns(v)
        k1 = 0.5 * p.Iz1 * v1**2
        # K2 prints (1 - sin q2)^2 where 1 - sin^2 q2 = cos^2 q2 holds; eq. 9 has the right one.
        k2 = (
            0.5 * p.m2 * p.lc2**2 * (np.cos(q2) ** 2 * v1**2 + v2**2)
            + 0.5 * p.Iz2 * v1**2
            + 0.5 * p.Iy2 * v2**2
        )
        k3 = (
            0.5
            * p.m3
            * (
                (
                    p.l2**2
                    + p.l2**2 * np.cos(2.0 * q2)
                    + 2.0 * p.l2 * p.lc3 * np.cos(2.0 * q2 + q3)
                    + 2.0 * p.l2 * p.lc3 * np.cos(q3)
                    + p.lc3**2 * np.cos(2.0 * q2 + 2.0 * q3)
                    + p.lc3**2
                )
                * v1**2
                / 2.0
                + (p.l2**2 + 2.0 * p.l2 * p.lc3 * np.cos(q3) + p.lc3**2) * v2**2
                + (2.0 * p.l2 * p.lc3 * np.cos(q3) + 2.0 * p.lc3**2) * v2 * v3
                + p.lc3**2 * v3**2
            )
            + 0.5 * p.Iz3 * v1**2
            + 0.5 * p.Iy3 * (v2 + v3) ** 2
        )
        return np.asarray(k1 + k2 + k3)  # Eq. 5

    def potential_energy(self, q: ArrayLike) -> Array:
        """Return the potential energy above the base plane (eq. 6).

        Args:
            q: joint angles [rad], shape (..., 3).

        Returns:
            V(q) [J], shape (...).

        Raises:
            ArrayError: when q is not a finite float64 array of shape (..., 3).
        """
        p = self.parameters
        _, q2, q3 = _columns(_vectors(q, "q"))
        v1 = p.m1 * p.g * p.d1
        v2 = p.m2 * p.g * (p.d1 + p.lc2 * np.sin(q2))
        v3 = p.m3 * p.g * (p.d1 + p.l2 * np.sin(q2) + p.lc3 * np.sin(q2 + q3))
        return np.asarray(v1 + v2 + v3)  # Eq. 6

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Return the torque that gives an acceleration (eqs. 7 and 8, without disturbance).

        Args:
            q: joint angles [rad], shape (..., 3).
            v: joint velocities [rad/s], shape (..., 3).
            a: joint accelerations [rad/s^2], shape (..., 3).

        Returns:
            Torque tau = D a + C v + G [N m], shape (..., 3).

        Raises:
            ArrayError: when an argument is not a finite float64 array of shape (..., 3), or the
                batch axes do not broadcast.
        """
        q, v, a = _broadcast(q=q, v=v, a=a)
        inertial = _times(self.mass_matrix(q), a)
        return inertial + self.coriolis_torque(q, v) + self.gravity(q)  # Eq. 8

    def forward_dynamics(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> Array:
        """Return the acceleration that a torque causes (eqs. 7 and 8, solved for it).

        Args:
            q: joint angles [rad], shape (..., 3).
            v: joint velocities [rad/s], shape (..., 3).
            tau: joint torque less the load torque, tau - tau_d in the paper [N m], shape (..., 3).

        Returns:
            Joint acceleration [rad/s^2], shape (..., 3).

        Raises:
            ArrayError: when an argument is not a finite float64 array of shape (..., 3), or the
                batch axes do not broadcast.
        """
        q, v, tau = _broadcast(q=q, v=v, tau=tau)
        surplus = tau - self.coriolis_torque(q, v) - self.gravity(q)
        a = np.linalg.solve(self.mass_matrix(q), surplus[..., np.newaxis])[..., 0]  # Eq. 8
        return np.asarray(a, dtype=np.float64)

    def _check_reach(self, points: Array, radius: Array) -> None:
        """Raise a ReachError for the point, if any, that lies furthest outside the workspace."""
        p = self.parameters
        inner, outer = abs(p.l2 - p.l3), p.l2 + p.l3
        distance = np.maximum(radius - outer, inner - radius)  # negative inside
        if (distance <= REACH_TOLERANCE).all():
            return
        worst = np.unravel_index(np.argmax(distance), distance.shape)
        x, y, z = points[worst].tolist()
        raise ReachError(
            point=(x, y, z),
            distance=float(distance[worst]),
            message=(
                f"point ({x:.6g}, {y:.6g}, {z:.6g}) m is {distance[worst]:.3g} m out of reach: it "
                f"is {radius[worst]:.6g} m from the shoulder at (0, 0, {p.d1:.6g}) m, and the tool "
                f"reaches from {inner:.6g} to {outer:.6g} m"
            ),
        )


def _vectors(value: ArrayLike, name: str) -> Array:
    """Check that an argument is a float64 array of shape (..., 3)."""
    array = as_float_array(value, name)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ArrayError(name, f"expected shape (3,) or (..., 3), got {array.shape}")
    return array


def _columns(array: Array) -> tuple[Array, Array, Array]:
    """Split the last axis, of length 3."""
    return array[..., 0], array[..., 1], array[..., 2]


def _broadcast(**arguments: ArrayLike) -> list[Array]:
    """Check arguments of shape (..., 3), by name, and broadcast their batch axes."""
    arrays = [_vectors(value, name) for name, value in arguments.items()]
    try:
        return list(np.broadcast_arrays(*arrays))
    except ValueError:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in zip(arguments, arrays, strict=True))
        raise ArrayError("/".join(arguments), f"batch axes do not broadcast: {shapes}") from None


def _times(matrix: Array, vector: Array) -> Array:
    """Multiply (..., 3, 3) matrices with (..., 3) vectors."""
    return (matrix @ vector[..., np.newaxis])[..., 0]
