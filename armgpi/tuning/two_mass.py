"""The sampled loop of an arm with rotors and gears, linear about a configuration.

The model is that of ``armgpi.control.linear_arm``, with all joints elastic or none; here are the controllers
that close its loop, and how far from instability they are.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.control.linear_arm import (
    Law,
    LinearArm,
    Sampled,
    closed,
    critical_damping,
    gravity_stiffness,
    sampled,
)
from armgpi.robot.robot import Robot

#: Bandwidth of a current loop of which nothing is known [Hz]; 300 to 1000 are usual.
CURRENT_LOOP = 500.0
#: Lowest frequency of a response [rad/s], and how many there are at least.
_LOWEST, _POINTS = 0.7, 50
#: Damping ratio below which a pole of the plant has frequencies of its own around it [-]...
_SHARP = 0.3
#: ... at so many times its width.
_AROUND = np.array([-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0])
#: The last frequency over that of half the samples, where the response of a sampled loop ends.
_HIGHEST = 0.999 * np.pi
#: Energy of a joint in a mode, over that of the joint with most, from which on it takes part in it: at half,
#: xArm 7 is unstable in one of 20 corners that were not looked at.
_SWINGING = 0.25


class Gears(NamedTuple):
    """Drives at the joints of an arm.

    Attributes:
        rotor: inertia of the rotors [kg m^2 or kg], (n,).
        stiffness: of the gears [N m/rad or N/m], (n,); None for rigid ones.
        damping: of the gears, as a ratio of each joint's own mode [-], a number or (n,).
        current: bandwidth of the current loop [Hz]; None for one that is at once.
        side: where the encoder sits: "motor" or "link", for all joints or one each.
    """

    rotor: Array
    stiffness: Array | None = None
    damping: Any = 0.05
    current: float | None = CURRENT_LOOP
    side: Any = "motor"


def plant(robot: Robot, q: Array, gears: Gears, dt: float) -> Sampled:
    """Return an arm about rest at q over a sample.

    Args:
        robot: its links; rotors of its own count for nothing.
        q: configuration [rad or m], (n,).
        gears: its drives.
        dt: sample time [s].
    """
    links, steep = _links(robot, tuple(q.tolist()))
    if gears.stiffness is None:
        none, no_joint = np.zeros(0), np.zeros(0, dtype=np.intp)
        rigid = links + np.diag(gears.rotor)
        arm = LinearArm(rigid, steep, no_joint, none, none, none, gears.current)
    else:
        damping = gears.damping * damping_at_one(links, gears)
        every = np.arange(robot.n)
        arm = LinearArm(links, steep, every, gears.rotor, gears.stiffness, damping, gears.current)
    return sampled(arm, dt, np.broadcast_to(np.asarray(gears.side) == "motor", robot.n))


@lru_cache(maxsize=32)
def _links(robot: Robot, q: tuple[float, ...]) -> tuple[Array, Array]:
    """Return the inertia matrix without rotors, and dG/dq: many drives are looked at in one place."""
    place = np.array(q)
    links = robot.mass_matrix(place) - np.diag(robot.armature)
    return links, gravity_stiffness(robot, place)


def damping_at_one(links: Array, gears: Gears) -> Array:
    """Return the damping of each gear at a ratio of 1 of the joint's own mode [N m s/rad or N s/m], (n,).

    Args:
        links: inertia matrix without rotors [kg m^2], (n, n).
        gears: the drives.
    """
    return critical_damping(np.diag(links), gears.rotor, np.asarray(gears.stiffness))


def law(controller: Any, q: Array) -> Law:
    """Return a GPI controller with fixed gains, linear about rest at q.

    Its torque is linear in the error of the measured positions, to which a feedforward that is taken at these
    adds dG/dq: there `bias_robot` and `robot` of the controller count, not the arm that it moves.
    """
    steep = None
    if controller.feedforward == "computed":
        steep = gravity_stiffness(controller.bias_robot, q)
    of_joints = joint_laws(controller._law, controller._nominal, controller.robot.n)
    return around(of_joints, controller.robot.mass_matrix(q), steep)


def joint_laws(realisation: Any, coefficients: Any, n: int) -> Law:
    """Return the realisation of n joints, from errors to accelerations v.

    A step of the realisation is linear and acts on each joint alone, so that its matrices are what it makes
    of unit states and unit errors.
    """
    at_rest = realisation.init(np.zeros(n), coefficients)
    states = len(at_rest)
    size = states * n
    unit = np.eye(size + n)
    error = unit[:, size:]
    columns = [unit[:, i * n : (i + 1) * n] for i in range(states)]
    state = type(at_rest)(*columns)
    v = realisation.output(error, state, coefficients)
    following = realisation.update(error, v, None, state, coefficients)
    ahead = np.concatenate(following, axis=1)
    return Law(A=ahead[:size].T, B=ahead[size:].T, C=v[:size].T, D=v[size:].T)


def around(own: Law, inertia: Array, steep: Array | None = None) -> Law:
    """Return a law of torques from one of accelerations.

    Args:
        own: from :func:`joint_laws`.
        inertia: of the nominal model [kg m^2], (n, n).
        steep: dG/dq of the nominal model where the feedforward is taken at the measured position, (n, n).
    """
    direct = inertia @ own.D
    if steep is not None:
        direct = direct + steep
    return Law(own.A, own.B, inertia @ own.C, direct)


class ArmLoop:
    """An arm about rest, sampled and late, to be closed by many laws.

    Attributes:
        dt: sample time [s].
        plant: without lateness.
    """

    def __init__(self, robot: Robot, q: Array, gears: Gears, dt: float, delay: int = 0) -> None:
        """Work out the plant.

        Args:
            robot: its links; rotors of its own count for nothing.
            q: configuration [rad or m], (n,).
            gears: its drives.
            dt: sample time [s].
            delay: samples by which measurements are late.
        """
        self.dt = dt
        self.plant = plant(robot, q, gears, dt)
        self._delay = delay
        links, _ = _links(robot, tuple(q.tolist()))
        self._inertia = links + np.diag(gears.rotor)
        self._rotor = gears.rotor
        self._n = robot.n
        self._response: tuple[Any, Any] | None = None

    def growth(self, of_law: Law, later: int = 0) -> float:
        """Return the largest eigenvalue of the closed loop over a sample; below 1 it is stable.

        Args:
            of_law: what closes it.
            later: samples by which measurements are later.
        """
        turn = closed(self.plant, of_law, self._delay + later)
        return float(np.abs(np.linalg.eigvals(turn)).max())

    def swinging(self, of_law: Law) -> Array:
        """Return which joints swing in the mode that grows fastest, (n,) of bool; none of a stable loop.

        Those whose energy is at least a quarter of that of the joint with most of it; gears are elastic.

        Args:
            of_law: what closes it.
        """
        values, vectors = np.linalg.eig(closed(self.plant, of_law, self._delay))
        fastest = int(np.argmax(np.abs(values)))
        if np.abs(values[fastest]) < 1.0:
            return np.zeros(self._n, dtype=bool)
        positions = np.abs(vectors[: 2 * self._n, fastest])
        of_link, of_motor = positions.reshape(2, self._n)
        links = np.diag(self._inertia) - self._rotor
        energy = links * of_link**2 + self._rotor * of_motor**2
        swing = energy >= _SWINGING * energy.max()
        return np.asarray(swing if swing.any() else ~swing)  # of numbers that are none, all

    def sensitivity(self, of_law: Law) -> float:
        """Return Ms [-], infinite where the loop is unstable.

        It is the largest singular value of (1 - P K)^-1 over the frequencies, of errors weighted with the
        root of the inertia matrix: then an arm without gears has that of one of its joints.
        """
        if not self.growth(of_law) < 1.0:
            return float("inf")
        z, P = self._respond()
        K = law_response(of_law, z)
        root = np.linalg.cholesky(self._inertia)
        weighted = root.T @ P @ K @ np.linalg.inv(root.T)
        singular = np.linalg.svd(np.eye(self._n) - weighted, compute_uv=False)
        smallest = singular[:, -1].min()
        return float(1.0 / smallest)

    def delay_margin(self, of_law: Law) -> float:
        """Return by how much later measurements may be until the stable loop swings [s]; infinite for ever.

        An eigenvalue of P K of size 1 at w is turned to 1 by a delay of its angle over w.
        """
        z, P = self._respond()
        order = np.argsort(np.angle(z))
        turn = np.angle(z)[order]
        values = np.linalg.eigvals(P @ law_response(of_law, z))[order]
        by_size = np.argsort(np.abs(values), axis=1)
        values = np.take_along_axis(values, by_size, axis=1)
        size = np.log(np.abs(values))
        # Between two frequencies an eigenvalue passes the size of 1: where, is linear in its logarithm.
        crosses = size[:-1] * size[1:] < 0.0
        difference = np.where(crosses, size[:-1] - size[1:], 1.0)
        share = np.where(crosses, size[:-1] / difference, 0.0)
        crossing = turn[:-1, None] + share * np.diff(turn)[:, None]
        nearer = np.where(share < 0.5, values[:-1], values[1:])
        angle = np.angle(nearer) % (2.0 * np.pi)
        margins = np.where(crosses, angle / crossing, np.inf)
        return float(margins.min()) * self.dt

    def _respond(self) -> tuple[Any, Any]:
        """Return frequencies, as points on the unit circle, and the plant's response there.

        Those around the plant's poles of little damping are as many as it takes to find a narrow peak.
        """
        if self._response is not None:
            return self._response
        A, B, C = self.plant
        poles = np.linalg.eigvals(A)
        turn = np.abs(np.angle(poles))
        decay = np.abs(np.log(np.abs(poles) + 1e-300))
        width = decay / np.maximum(turn, 1e-9)
        is_oscillation = (turn > 1e-2) & (turn < np.pi)
        is_sharp = is_oscillation & (width < _SHARP)
        steps = 1.0 + width[is_sharp, None] * _AROUND
        near = (turn[is_sharp, None] * steps).ravel()
        lowest = _LOWEST * self.dt
        everywhere = np.geomspace(lowest, _HIGHEST, _POINTS)
        frequencies = np.clip(np.concatenate([everywhere, near]), lowest, _HIGHEST)
        z = np.exp(1j * frequencies)
        resolvent = z[:, None, None] * np.eye(len(A)) - A
        P = C @ np.linalg.solve(resolvent, _each(B, z))
        transport = (z**-self._delay)[:, None, None]
        self._response = z, P * transport
        return self._response


def law_response(of_law: Law, z: Array) -> Array:
    """Return the response of a law at points on the unit circle, from errors to torques, (len(z), n, n)."""
    A, B, C, D = of_law
    resolvent = z[:, None, None] * np.eye(len(A)) - A
    states = np.linalg.solve(resolvent, _each(B, z))
    return np.asarray(C @ states + D)


def _each(B: Array, z: Array) -> Array:
    """Return a matrix for each frequency."""
    shape = (len(z), *B.shape)
    return np.broadcast_to(B.astype(complex), shape)
