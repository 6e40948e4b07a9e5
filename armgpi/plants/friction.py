"""Friction of joints after a step without: implicit, so that it is stable for every coefficient."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, cast

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array
from armgpi.robot.equations import Friction

#: Newton steps for Coulomb friction at most: 1e-9 of it is left after 16 for all of 12,000 random arms.
MOST_STEPS = 16
#: A rollout is settled when no velocity changed by more than this share of itself and of the stick velocity.
#: Newton's method is quadratic there, so that what is left is below the rounding of the equation.
_SETTLED = 1e-10
#: Speed below which Coulomb friction is smoothed [rad/s or m/s], where nobody says another.
STICK_VELOCITY = 1e-3

#: The velocity (d,) or (batch, d) under the torque -(resistance v + push), from (resistance, push).
Braked = Callable[[Array, Array], Array]


class Iterate(NamedTuple):
    """A step of Newton's method.

    Attributes:
        v: velocities [rad/s or m/s], (d,) or (batch, d).
        share: share of Coulomb friction in use, -1 to 1, likewise.
    """

    v: Array
    share: Array


def brake_rigid(h: float, v_free: Array, inertia: Array) -> Braked:
    """Return what solves (D + h diag(resistance)) v = D v_free - h push for v.

    Args:
        h: length of the step [s].
        v_free: velocities without friction [rad/s or m/s], (n,) or (batch, n).
        inertia: D(q) [kg m^2 or kg], (n, n) or (batch, n, n).
    """
    momentum = np.matmul(inertia, v_free[..., None])
    diagonal = np.arange(v_free.shape[-1])

    def braked(resistance: Array, push: Array) -> Array:
        matrix = inertia.copy()
        matrix[..., diagonal, diagonal] += h * resistance
        return solve(matrix, momentum - h * push[..., None])

    return braked


class ImplicitFriction:
    """The velocity that friction leaves of an arm's after a substep; a function of its own in generated C.

    Attributes:
        sticks: whether there is Coulomb friction.
        braking: makes :data:`Braked` from the length of the step, the velocities without friction, and what
            else it takes of the arm.
    """

    def __init__(self, sticks: bool, braking: Callable[..., Braked] = brake_rigid) -> None:
        """Note whether there is Coulomb friction, and the arm's equation."""
        self.sticks = sticks
        self.braking = braking

    def __call__(
        self, v_free: Array, viscous: Array, coulomb: Array, h: float, stick: float, *arm: Array
    ) -> Array:
        """Return the velocity that friction leaves of `v_free` after `h`.

        The torque of friction is -(f_v v + f_c v / |v|), with |v| smoothed to sqrt(v^2 + stick^2).

        Args:
            v_free: velocities without friction [rad/s or m/s], (d,) or (batch, d).
            viscous: f_v [N m s/rad or N s/m], likewise.
            coulomb: f_c [N m or N], likewise.
            h: length of the step [s].
            stick: speed below which Coulomb friction is smoothed [rad/s or m/s].
            arm: what `braking` takes besides.
        """
        braked = self.braking(h, v_free, *arm)
        friction = Friction(viscous, coulomb)
        iterate = first_iterate(v_free)
        running = np.ones((*v_free.shape[:-1], 1), dtype=bool)
        for _ in range(MOST_STEPS if self.sticks else 0):
            following = newton_step(braked, iterate, friction, stick)
            moved = is_moving(following, iterate, stick).any(axis=-1, keepdims=True)
            # A rollout that has settled keeps its numbers, so that they do not depend on its neighbours.
            v = np.where(running, following.v, iterate.v)
            share = np.where(running, following.share, iterate.share)
            iterate = Iterate(v, share)
            running = running & moved
            if not running.any():
                break
        return braked_velocity(braked, iterate, friction, stick)


def first_iterate(v_free: Array) -> Iterate:
    """Return where Newton's method begins: no friction."""
    return Iterate(v_free, np.zeros_like(v_free))


def newton_step(braked: Braked, iterate: Iterate, friction: Friction, stick: float) -> Iterate:
    """Return the next step of Newton's method.

    It works on v and on the share of Coulomb friction in use together (Chan, Golub, Mulet 1999), which
    unlike Newton's method on v alone converges from v_free, mostly in five steps. Each step is one linear
    equation per rollout.

    Args:
        braked: the arm's equation.
        iterate: the last step.
        friction: the coefficients.
        stick: speed below which Coulomb friction is smoothed [rad/s or m/s].
    """
    viscous, coulomb = friction
    v, share = iterate
    speed = np.sqrt(v * v + stick * stick)
    sign = v / speed
    slope = (1.0 - share * sign) / speed
    resistance = viscous + coulomb * slope
    push = coulomb * (sign - slope * v)
    ahead = braked(resistance, push)
    share_ahead = sign + slope * (ahead - v)
    return Iterate(ahead, np.minimum(np.maximum(share_ahead, -1.0), 1.0))


def is_moving(following: Iterate, iterate: Iterate, stick: float) -> npt.NDArray[np.bool_]:
    """Tell for each joint whether a step of Newton's method changed its velocity."""
    rounding = _SETTLED * (abs(following.v) + stick)
    moving: npt.NDArray[np.bool_] = abs(following.v - iterate.v) > rounding
    return moving


def braked_velocity(braked: Braked, iterate: Iterate, friction: Friction, stick: float) -> Array:
    """Return the velocity with friction at the speed found.

    A step of this form can only take energy, whatever is left to solve.
    """
    v = iterate.v
    speed = np.sqrt(v * v + stick * stick)
    return braked(friction.viscous + friction.coulomb / speed, np.zeros_like(v))


def solve(matrix: Array, column: Array) -> Array:
    """Solve for one column per matrix; where a rollout has diverged the answer is NaN, not an exception."""
    try:
        return cast(Array, np.linalg.solve(matrix, column)[..., 0])
    except np.linalg.LinAlgError:
        finite = np.asarray(np.isfinite(matrix).all(axis=(-2, -1)))[..., None, None]
        safe = np.where(finite, matrix, np.eye(matrix.shape[-1]))
        return np.where(finite, np.linalg.solve(safe, column), np.nan)[..., 0]
