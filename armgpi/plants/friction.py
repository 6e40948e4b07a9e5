"""Friction of joints after a step without: implicit, so that it is stable for every coefficient."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np

from armgpi.arrays import Array
from armgpi.robot.equations import Friction

#: Newton steps for Coulomb friction: 1e-9 of it is left after 16 for all of 12,000 random arms.
_NEWTON_STEPS = 16
#: Speed below which Coulomb friction is smoothed [rad/s or m/s], where nobody says another.
STICK_VELOCITY = 1e-3


class ImplicitFriction:
    """The velocity that friction leaves of an arm's after a substep; a function of its own in generated C.

    Attributes:
        sticks: whether there is Coulomb friction.
    """

    def __init__(self, sticks: bool) -> None:
        """Note whether there is Coulomb friction."""
        self.sticks = sticks

    def __call__(
        self, inertia: Array, v_free: Array, viscous: Array, coulomb: Array, h: float, stick: float
    ) -> Array:
        """Return the velocity, from D(q) and the velocity without friction, after `h`."""
        momentum = np.matmul(inertia, v_free[..., None])
        diagonal = np.arange(v_free.shape[-1])

        def brake(resistance: Array, push: Array) -> Array:
            """Solve (D + h diag(resistance)) v = D v_free - h push."""
            matrix = inertia.copy()
            matrix[..., diagonal, diagonal] += h * resistance
            return solve(matrix, momentum - h * push[..., None])

        return after_friction(brake, v_free, Friction(viscous, coulomb), stick, self.sticks)


def after_friction(
    braked: Callable[[Array, Array], Array], v_free: Array, friction: Friction, stick: float, sticks: bool
) -> Array:
    """Return the velocity v that friction leaves of v_free.

    The torque of friction is -(f_v v + f_c v / |v|), with |v| smoothed to sqrt(v^2 + stick^2). It solves by
    Newton's method on v and on the share of Coulomb friction in use together (Chan, Golub, Mulet 1999),
    which unlike Newton's method on v alone converges from v_free, in some ten steps. Each step is one
    linear equation per rollout, however the others fare.

    Args:
        braked: the velocity under the torque -(resistance v + push), from (resistance, push).
        v_free: velocities without friction [rad/s or m/s].
        friction: its coefficients.
        stick: speed below which Coulomb friction is smoothed [rad/s or m/s].
        sticks: whether there is Coulomb friction.
    """
    viscous, coulomb = friction
    v, share = v_free, np.zeros_like(v_free)
    for _ in range(_NEWTON_STEPS if sticks else 0):
        speed = np.sqrt(v * v + stick * stick)
        sign = v / speed
        slope = (1.0 - share * sign) / speed
        ahead = braked(viscous + coulomb * slope, coulomb * (sign - slope * v))
        share = np.minimum(np.maximum(sign + slope * (ahead - v), -1.0), 1.0)
        v = ahead
    # With friction at the speed found, a step of this form can only take energy, whatever is left to solve.
    return braked(viscous + coulomb / np.sqrt(v * v + stick * stick), np.zeros_like(v))


def solve(matrix: Array, column: Array) -> Array:
    """Solve for one column per matrix; where a rollout has diverged the answer is NaN, not an exception."""
    try:
        return cast(Array, np.linalg.solve(matrix, column)[..., 0])
    except np.linalg.LinAlgError:
        finite = np.asarray(np.isfinite(matrix).all(axis=(-2, -1)))[..., None, None]
        safe = np.where(finite, matrix, np.eye(matrix.shape[-1]))
        return np.where(finite, np.linalg.solve(safe, column), np.nan)[..., 0]
