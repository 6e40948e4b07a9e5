"""The linear model of an arm about rest, with elastic joints: links, springs, motors, current loop, sampling.

With S that selects the elastic joints, x = (q, theta) of links and their motors obeys

    M q'' + S' [K (S q - theta) + B (S q' - theta')] + G_q q = torque of the stiff joints
    J theta''  -  [K (S q - theta) + B (S q' - theta')]      = torque of the elastic joints,

where M holds the inertia of the links and of the rotors of stiff joints, and G_q is the gradient of gravity.
Torques are held over a sample and pass a current loop of first order; measurements are late by whole samples.
The design of GPI controllers and the limits of impedance controllers are both worked out on this model.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array
from armgpi.robot.robot import Robot

#: Step of the differences of gravity [rad or m].
_STEP = 1e-5
#: Terms of the series of e^A [-]: at norms up to a quarter the next term is below 1e-17.
_TERMS = 13


class LinearArm(NamedTuple):
    """An arm about rest, in continuous time.

    Attributes:
        inertia: M [kg m^2 or kg], (n, n): of the links, and on its diagonal of the rotors of stiff joints.
        gravity: G_q = dG/dq [N m/rad or N/m], (n, n).
        elastic: the joints between whose motor and link there is a spring, by their places, (m,).
        rotor: J of these [kg m^2 or kg], (m,).
        stiffness: K of these [N m/rad or N/m], (m,).
        damping: B of these [N m s/rad or N s/m], (m,).
        current: bandwidth of the current loop [Hz]; None for torques without one.
    """

    inertia: Array
    gravity: Array
    elastic: npt.NDArray[np.intp]
    rotor: Array
    stiffness: Array
    damping: Array
    current: float | None


class Sampled(NamedTuple):
    """An arm about rest over a sample: x' = A x + B tau, measured = C x.

    The state x has positions of links and motors, their velocities, and the currents where they have a loop.
    """

    A: Array
    B: Array
    C: Array


class Law(NamedTuple):
    """A controller about rest: state' = A state + B e, torque = C state + D e."""

    A: Array
    B: Array
    C: Array
    D: Array


def sampled(arm: LinearArm, dt: float, at_motor: npt.NDArray[np.bool_]) -> Sampled:
    """Return what an arm does in a sample whose torque is held.

    Args:
        arm: its linear model.
        dt: sample time [s].
        at_motor: which joints are measured at their motors, (n,); of a stiff joint it changes nothing.
    """
    n, m = len(arm.inertia), len(arm.elastic)
    positions = n + m
    size = 2 * positions + (0 if arm.current is None else n)
    velocities = slice(positions, 2 * positions)
    inverse_mass = np.zeros((positions, positions))
    inverse_mass[:n, :n] = np.linalg.inv(arm.inertia)
    inverse_mass[n:, n:] = np.diag(1.0 / arm.rotor)
    deflection = np.zeros((m, positions))  # of the springs, S q - theta
    deflection[np.arange(m), arm.elastic] = 1.0
    deflection[:, n:] = -np.eye(m)
    stiffness = deflection.T @ (arm.stiffness[:, None] * deflection)
    stiffness[:n, :n] += arm.gravity
    damping = deflection.T @ (arm.damping[:, None] * deflection)
    # A torque acts on the link of a stiff joint, and on the motor of an elastic one.
    acts_on = np.zeros((positions, n))
    acts_on[:n] = np.eye(n)
    acts_on[arm.elastic, arm.elastic] = 0.0
    acts_on[n + np.arange(m), arm.elastic] = 1.0

    # The held torque is a part of the state that does not change within the sample.
    rates = np.zeros((size + n, size + n))
    rates[:positions, velocities] = np.eye(positions)
    rates[velocities, :positions] = -inverse_mass @ stiffness
    rates[velocities, velocities] = -inverse_mass @ damping
    # After the velocities: the currents where they have a loop, else the held torque itself.
    rates[velocities, 2 * positions : 2 * positions + n] = inverse_mass @ acts_on
    if arm.current is not None:
        bandwidth = 2.0 * np.pi * arm.current  # [1/s]
        rates[2 * positions : size, 2 * positions : size] = -bandwidth * np.eye(n)
        rates[2 * positions : size, size:] = bandwidth * np.eye(n)
    transition = exponential(dt * rates)
    return Sampled(transition[:size, :size], transition[:size, size:], measured(arm.elastic, at_motor, size))


def measured(elastic: npt.NDArray[np.intp], at_motor: npt.NDArray[np.bool_], size: int) -> Array:
    """Return C, what the encoders see of a state, (n, size).

    Args:
        elastic: places of the elastic joints, (m,).
        at_motor: which joints are measured at their motors, (n,).
        size: of the state.
    """
    n = len(at_motor)
    seen = np.zeros((n, size))
    seen[:, :n] = np.eye(n)
    for motor, joint in enumerate(elastic):
        if at_motor[joint]:
            seen[joint, joint] = 0.0
            seen[joint, n + motor] = 1.0
    return seen


def closed(arm: Sampled, law: Law, delay: int) -> Array:
    """Return the matrix of the closed loop over a sample; all may have leading axes of batches.

    Args:
        arm: over a sample.
        law: what closes the loop.
        delay: samples by which measurements are late.
    """
    whole, entry, answer = open_loop(arm, law, delay)
    return whole + entry @ answer


def open_loop(arm: Sampled, law: Law, delay: int) -> tuple[Array, Array, Array]:
    """Return A, B, C from a torque at the arm to the torque that the law answers; see :func:`closed`.

    The state is that of the arm, the measurements that are on their way, and that of the law.
    """
    states, n, law_states = arm.A.shape[-1], arm.B.shape[-1], law.A.shape[-1]
    batch = np.broadcast_shapes(arm.A.shape[:-2], law.D.shape[:-2])
    size = states + delay * n + law_states
    own = slice(states + delay * n, size)  # the state of the law
    whole = np.zeros((*batch, size, size))
    entry = np.zeros((*batch, size, n))
    whole[..., :states, :states] = arm.A
    entry[..., :states, :] = arm.B
    arriving = np.zeros((n, size))  # what is handed on by a sample, and at last what the law sees
    arriving[:, :states] = arm.C
    for i in range(delay):
        waiting = slice(states + i * n, states + (i + 1) * n)
        whole[..., waiting, :] = arriving
        arriving = np.zeros((n, size))
        arriving[:, waiting] = np.eye(n)
    whole[..., own, :] = law.B @ arriving
    whole[..., own, own] += law.A
    answer = np.broadcast_to(law.D @ arriving, (*batch, n, size)).copy()
    answer[..., own] += law.C
    return whole, entry, answer


def exponential(A: Array) -> Array:
    """Return e^A by its series and squarings, for (k, k); SciPy's takes a second to import."""
    norm = float(np.abs(A).sum(axis=1).max())
    halvings = max(0, math.ceil(math.log2(max(norm, 1e-300))) + 2)
    small = A / 2.0**halvings
    term = total = np.eye(len(A))
    for i in range(1, _TERMS):
        term = term @ small / i
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total


def critical_damping(link: Array, rotor: Array, stiffness: Array) -> Array:
    """Return the damping at a ratio of 1 of a link and a rotor on a spring [N m s/rad or N s/m].

    Args:
        link: inertia of the link alone [kg m^2 or kg].
        rotor: inertia of the rotor, likewise.
        stiffness: of the spring between them [N m/rad or N/m].
    """
    return np.asarray(2.0 * np.sqrt(stiffness * link * rotor / (link + rotor)))


def gravity_stiffness(robot: Robot, q: Array) -> Array:
    """Return dG/dq by central differences [N m/rad or N/m], (n, n)."""
    steps = _STEP * np.eye(robot.n)
    return np.asarray((robot.gravity(q + steps) - robot.gravity(q - steps)).T / (2.0 * _STEP))
