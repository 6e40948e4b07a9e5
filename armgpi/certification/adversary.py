"""The worst that a search finds, to hold against a certificate: torques that switch at the worst times.

At a frozen configuration the loop is linear, and the worst course of a bounded torque is known: it switches
with the sign of the impulse response, whose sum of sizes is the error that it leads to. The search is for
the configuration and the load.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.certification import check_certificate
from armgpi.certification.quantities import resting, slopes
from armgpi.certification.request import Asked, law_of
from armgpi.robot.robot import Robot

checker: Any = check_certificate  # generic over number types, so without annotations


#: How many configurations are drawn for one that is looked at.
_LOOKED = 50


class Worst(NamedTuple):
    """The worst case that was found of one joint.

    Attributes:
        error: over the size of a torque on that joint [rad/(N m)].
        q: configuration [rad or m], shape (n,).
        arm: the true arm with its load.
        response: of the joint's error to its torque in one sample [rad/(N m)], shape (samples,).
    """

    error: float
    q: Array
    arm: Robot
    response: Array


def worst(asked: Asked, count: int = 100, samples: int = 1000, seed: int = 0) -> list[Worst]:
    """Return the worst case of each joint over configurations and corners of the box, at both loads.

    Args:
        asked: what a certificate is for.
        count: of configurations: half of them where a joint is light, which is where a torque moves it most.
        samples: of the responses.
        seed: of what is drawn.
    """
    setting = asked.setting
    n = asked.robot.n
    rng = np.random.default_rng(seed)
    share = rng.random((_LOOKED * count, n))
    at_corner = rng.random((len(share), 1)) < 0.3
    share = np.where(at_corner, np.rint(share), share)
    drawn = setting.lower + share * (setting.upper - setting.lower)
    of_each_joint = -(-count // (2 * n))
    worst_cases: dict[int, Worst] = {}
    for arm in setting.arms:
        inverse = np.linalg.inv(arm.mass_matrix(drawn))
        mobility = np.diagonal(inverse, axis1=1, axis2=2)
        lightest = np.argsort(-mobility, axis=0)[:of_each_joint].ravel()
        for q in np.concatenate([drawn[: count // 2], drawn[lightest]]):
            responses = impulses(asked, arm, q, samples)
            errors = np.abs(responses).sum(axis=1)
            for j, error in enumerate(errors):
                if j not in worst_cases or error > worst_cases[j].error:
                    worst_cases[j] = Worst(float(error), q, arm, responses[j])
    return [worst_cases[j] for j in range(n)]


def impulses(asked: Asked, arm: Robot, q: Array, samples: int) -> Array:
    """Return each joint's response to its own torque of one sample [rad/(N m)], (n, samples).

    The arm is frozen at q: linear there, and its inertia stays.

    Args:
        asked: what a certificate is for.
        arm: the true arm with its load.
        q: configuration [rad or m], (n,).
        samples: of the responses.
    """
    closed_loop, push = _frozen_loop(asked, arm, q)
    inverse = np.linalg.inv(arm.mass_matrix(q))
    state = np.kron(push[:, None], inverse)
    out = np.empty((arm.n, samples))
    for k in range(samples):
        out[:, k] = np.diagonal(state[: arm.n])  # the errors come first
        state = closed_loop @ state
    return out


def _frozen_loop(asked: Asked, arm: Robot, q: Array) -> tuple[Array, Array]:
    """Return the matrix of one sample of the whole loop, and what an acceleration adds to a joint's state.

    A joint's state is its error, its speed, the integrators, the roll-off's filters and the delayed errors.
    The loop's states are those of all joints: first every error, then every speed, and so on.

    Args:
        asked: what a certificate is for.
        arm: the true arm with its load.
        q: configuration [rad or m], (n,).
    """
    law = law_of(asked)
    n = arm.n
    setting = asked.setting
    exact = checker.exact(law)
    omega = float(exact["omega"][0])
    h = float(exact["sample_time"])
    channel = checker.loop(exact, exact["omega"][0])
    A = np.array(channel.A, dtype=float)
    K = np.array(channel.K, dtype=float)
    # The checker's states are in units of 1/omega for each derivative; from here on they are in SI units.
    integrators = range(2, 2 + law["integrators"])
    filters = range(2, 3 + law["rolloff"])
    lags = [0] * asked.delay
    powers = np.array([0, 1, *integrators, *filters, *lags], dtype=float)
    scale = omega**powers
    A = scale[:, None] * A / scale
    K = omega**2 * K / scale
    # Gravity changes with where the arm is, what holds the arm with the position that was measured.
    at = q[None]
    v = resting(setting, arm, at)
    v_of_steps = np.repeat(v, 4 * n, axis=0)  # for the four steps of each slope

    def holding(x: Array) -> Array:
        return setting.nominal.inertia_times(x, v_of_steps)

    gravity_slope = slopes(arm.gravity, at)[0].T
    holding_slope = slopes(holding, at)[0].T
    inverse = np.linalg.inv(arm.mass_matrix(q))
    order = len(A)
    units = np.eye(order)
    position = units[0]
    measured = units[order - 1] if asked.delay else position
    push = np.zeros(order)
    push[:2] = 0.5 * h * h, h
    accelerations = np.kron(K, inverse @ setting.nominal.mass_matrix(q))
    held = np.kron(measured, inverse @ holding_slope)
    accelerations += held - np.kron(position, inverse @ gravity_slope)
    every_joint = np.eye(n)
    closed_loop = np.kron(A, every_joint) + np.kron(push[:, None], every_joint) @ accelerations
    return closed_loop, push
