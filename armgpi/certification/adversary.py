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
    setting, n = asked.setting, asked.robot.n
    rng = np.random.default_rng(seed)
    share = rng.random((_LOOKED * count, n))
    share = np.where(rng.random((len(share), 1)) < 0.3, np.rint(share), share)
    drawn = setting.lower + share * (setting.upper - setting.lower)
    found: list[Worst | None] = [None] * n
    for arm in setting.arms:
        light = np.diagonal(np.linalg.inv(arm.mass_matrix(drawn)), axis1=1, axis2=2)
        lightest = np.argsort(-light, axis=0)[: -(-count // (2 * n))].ravel()
        for q in np.concatenate([drawn[: count // 2], drawn[lightest]]):
            responses = impulses(asked, arm, q, samples)
            for j, error in enumerate(np.abs(responses).sum(axis=1)):
                best = found[j]
                if best is None or error > best.error:
                    found[j] = Worst(float(error), q, arm, responses[j])
    return [each for each in found if each is not None]


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
    state = np.kron(push[:, None], np.linalg.inv(arm.mass_matrix(q)))
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
    law, n, setting = law_of(asked), arm.n, asked.setting
    exact = checker.exact(law)
    omega, h = float(exact["omega"][0]), float(exact["sample_time"])
    A, Y = (np.array(x, dtype=float) for x in checker.loop(exact, exact["omega"][0])[1:3])
    # The checker's states are in units of 1/omega for each derivative; from here on they are in SI units.
    integrators = range(2, 2 + law["integrators"])
    filters = range(2, 3 + law["rolloff"])
    scale = omega ** np.array([0, 1, *integrators, *filters, *[0] * asked.delay], dtype=float)
    A = scale[:, None] * A / scale
    Y = omega**2 * Y / scale
    # Gravity changes with where the arm is, what holds the arm with the position that was measured.
    at = q[None]
    v = np.repeat(resting(setting, arm, at), 4 * n, axis=0)  # for the four steps of each slope
    gravity = slopes(arm.gravity, at)[0].T
    holding = slopes(lambda x: setting.nominal.inertia_times(x, v), at)[0].T
    inverse = np.linalg.inv(arm.mass_matrix(q))
    order = len(A)
    position, measured = np.eye(order)[0], np.eye(order)[order - 1 if asked.delay else 0]
    push = np.zeros(order)
    push[:2] = 0.5 * h * h, h
    accelerations = np.kron(Y, inverse @ setting.nominal.mass_matrix(q))
    accelerations += np.kron(measured, inverse @ holding) - np.kron(position, inverse @ gravity)
    closed_loop = np.kron(A, np.eye(n)) + np.kron(push[:, None], np.eye(n)) @ accelerations
    return closed_loop, push
