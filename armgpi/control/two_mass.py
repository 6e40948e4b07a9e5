"""The sampled loop of an arm with rotors and gears, linear about a configuration.

It is M q'' + B (q' - theta') + K (q - theta) + G_q q = 0 and J theta'' + B (theta' - q') + K (theta - q) =
tau, with a current loop of first order, torque held over a sample, measurements late by whole samples, and
the law.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import Array
from armgpi.robot.robot import Robot

#: Step of the differences [rad or m].
_STEP = 1e-5


class Gears(NamedTuple):
    """Drives at the joints of an arm.

    Attributes:
        rotor: inertia of the rotors [kg m^2 or kg], (n,).
        stiffness: of the gears [N m/rad or N/m], (n,); None for rigid ones.
        damping: of the gears, as a ratio of each joint's own mode [-].
        current: bandwidth of the current loop [Hz]; None for one that is at once.
        side: where the encoder sits: "motor" or "link".
    """

    rotor: Array
    stiffness: Array | None = None
    damping: float = 0.05
    current: float | None = 500.0
    side: str = "motor"


def plant(robot: Robot, q: Array, gears: Gears, dt: float) -> tuple[Array, Array, Array]:
    """Return A, B and C of an arm over a sample, about rest at q: x' = A x + B tau, measured = C x.

    Args:
        robot: its links; rotors of its own count for nothing.
        q: configuration [rad or m], (n,).
        gears: its drives.
        dt: sample time [s].
    """
    from scipy.linalg import expm

    n, one, nil = robot.n, np.eye(robot.n), np.zeros((robot.n, robot.n))
    links = robot.mass_matrix(q) - np.diag(robot.armature)
    steep = gravity_stiffness(robot, q)
    rotor = np.diag(gears.rotor)
    if gears.stiffness is None:
        inverse = np.linalg.inv(links + rotor)
        A = np.block([[nil, one], [-inverse @ steep, nil]])
        B = np.vstack([nil, inverse])
        C = np.hstack([one, nil])
    else:
        mass = np.diag(links)
        ratio = 2.0 * gears.damping * np.sqrt(gears.stiffness * mass * gears.rotor / (mass + gears.rotor))
        K, D = np.diag(gears.stiffness), np.diag(ratio)
        stiff, damp = np.block([[K + steep, -K], [-K, K]]), np.block([[D, -D], [-D, D]])
        inverse = np.linalg.inv(np.block([[links, nil], [nil, rotor]]))
        A = np.block([[np.zeros((2 * n, 2 * n)), np.eye(2 * n)], [-inverse @ stiff, -inverse @ damp]])
        B = np.vstack([np.zeros((2 * n, n)), inverse[:, n:]])
        C = np.hstack([nil, one, nil, nil] if gears.side == "motor" else [one, nil, nil, nil])
    if gears.current is not None:
        rate, k = 2.0 * np.pi * gears.current, len(A)
        A = np.block([[A, B], [np.zeros((n, k)), -rate * one]])
        B, C = np.vstack([np.zeros((k, n)), rate * one]), np.hstack([C, nil])
    k = len(A)
    whole = expm(dt * np.block([[A, B], [np.zeros((n, k + n))]]))
    return whole[:k, :k], whole[:k, k:], C


def gravity_stiffness(robot: Robot, q: Array) -> Array:
    """Return dG/dq by central differences, (n, n)."""
    steps = _STEP * np.eye(robot.n)
    return np.asarray((robot.gravity(q + steps) - robot.gravity(q - steps)).T / (2.0 * _STEP))


class _Law(NamedTuple):
    """A law about rest: state' = A state + B e, torque = C state + D e."""

    A: Array
    B: Array
    C: Array
    D: Array


def law(controller: Any, q: Array) -> _Law:
    """Return a GPI controller with fixed gains, linear about rest at q."""
    n, realisation, c = controller.robot.n, controller._law, controller._nominal  # its own parts
    first = realisation.init(np.zeros(n), c)
    size = len(first) * n
    unit = np.eye(size + n)
    e = unit[:, size:]
    state = type(first)(*(unit[:, i * n : (i + 1) * n] for i in range(len(first))))
    v = realisation.output(e, state, c)
    ahead = np.concatenate(realisation.update(e, v, None, state, c), axis=1)
    tau = v @ controller.robot.mass_matrix(q)
    if controller.feedforward == "computed":
        tau = tau + e @ gravity_stiffness(controller.bias_robot, q).T
    return _Law(ahead[:size].T, ahead[size:].T, tau[:size].T, tau[size:].T)


def loop(of_plant: tuple[Array, Array, Array], of_law: _Law, delay: int) -> tuple[Array, Array, Array, Array]:
    """Return the open loop from a torque at the plant to the torque that the law answers, A, B, C, D."""
    A, B, C = of_plant
    k, n, s = len(A), B.shape[1], len(of_law.A)
    size = k + delay * n + s
    whole, entry = np.zeros((size, size)), np.zeros((size, n))
    whole[:k, :k], entry[:k] = A, B
    late = np.zeros((n, size))  # what the law sees
    late[:, :k] = C
    for i in range(delay):
        row = slice(k + i * n, k + (i + 1) * n)
        whole[row] = late
        late = np.zeros((n, size))
        late[:, row] = np.eye(n)
    whole[k + delay * n :] = of_law.B @ late
    whole[k + delay * n :, k + delay * n :] += of_law.A
    out = of_law.D @ late
    out[:, k + delay * n :] += of_law.C
    return whole, entry, out, np.zeros((n, n))


def growth(open_loop: tuple[Array, Array, Array, Array]) -> float:
    """Return the largest eigenvalue of the closed loop over a sample; below 1 it is stable."""
    A, B, C, _ = open_loop
    return float(np.abs(np.linalg.eigvals(A + B @ C)).max())


def sensitivity(open_loop: tuple[Array, Array, Array, Array], dt: float, points: int = 300) -> float:
    """Return Ms, the largest singular value of (1 - L)^-1 over the frequencies; infinite where unstable."""
    A, B, C, _ = open_loop
    if growth(open_loop) >= 1.0:
        return float("inf")
    z = np.exp(1j * np.geomspace(0.3 * dt, np.pi, points))
    solved = np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, B.astype(complex))
    S = np.linalg.inv(np.eye(B.shape[1]) - C @ solved)
    return float(np.linalg.svd(S, compute_uv=False).max())
