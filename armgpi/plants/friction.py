"""Friction of joints after a step without: implicit, so that it is stable for every coefficient."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, cast

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array
from armgpi.robot.equations import Friction

#: Newton steps for Coulomb friction at most: of 16,000 random arms, stiff and elastic, none took over 14.
MOST_STEPS = 16
#: A rollout is settled when the torque of friction in a step's equation is that of the velocities found, but
#: for this share of Coulomb friction at each joint.
_SETTLED = 1e-10
#: Speed below which Coulomb friction is smoothed [rad/s or m/s], where nobody says another.
STICK_VELOCITY = 1e-3

#: The velocity (d,) or (batch, d) under the torque -(resistance v + push), from (resistance, push).
Braked = Callable[[Array, Array], Array]


class Iterate(NamedTuple):
    """A step of Newton's method, each of shape (d,) or (batch, d).

    Attributes:
        v: velocities [rad/s or m/s].
        sign: share of Coulomb friction that acts at these velocities, -1 to 1.
        slope: how that share changes with the velocity in the next step [s/rad or s/m].
        share: the share that acted in the equation which gave these velocities.
    """

    v: Array
    sign: Array
    slope: Array
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
        sticks: whether there is Coulomb friction, for the joints; or for links and for motors.
        braking: makes :data:`Braked` from the length of the step, the velocities without friction, and what
            else it takes of the arm.
    """

    def __init__(self, sticks: tuple[bool, ...], braking: Callable[..., Braked] = brake_rigid) -> None:
        """Note where there is Coulomb friction, and the arm's equation."""
        self.sticks = sticks
        self.braking = braking

    def __call__(
        self,
        v_free: Array,
        before: Array,
        viscous: Array,
        coulomb: Array,
        h: float,
        stick: float,
        *arm: Array,
    ) -> Array:
        """Return the velocity that friction leaves of `v_free` after `h`.

        The torque of friction is -(f_v v + f_c v / |v|), with |v| smoothed to sqrt(v^2 + stick^2).

        Args:
            v_free: velocities without friction [rad/s or m/s], (d,) or (batch, d).
            before: velocities before the step, likewise: the search begins there, and ends as well anywhere
                else, but later.
            viscous: f_v [N m s/rad or N s/m], likewise.
            coulomb: f_c [N m or N], likewise.
            h: length of the step [s].
            stick: speed below which Coulomb friction is smoothed [rad/s or m/s].
            arm: what `braking` takes besides.
        """
        braked = self.braking(h, v_free, *arm)
        if not any(self.sticks):
            return braked(viscous, np.zeros_like(v_free))
        friction = Friction(viscous, coulomb)
        iterate = first_iterate(before, stick)
        left = np.zeros_like(v_free)
        running = np.ones((*v_free.shape[:-1], 1), dtype=bool)
        for _ in range(MOST_STEPS):
            iterate = newton_step(braked, iterate, friction, stick)
            # A rollout that has settled keeps its numbers, so that they do not depend on its neighbours.
            left = np.where(running, iterate.v, left)
            running = running & is_apart(iterate, coulomb).any(axis=-1, keepdims=True)
            if not running.any():
                return left
        return np.where(running, braked_velocity(braked, iterate, friction, stick), left)


def first_iterate(before: Array, stick: float) -> Iterate:
    """Return where Newton's method begins: the velocities before the step, with their friction.

    They are nearer to those after it than the velocities without friction: friction of a joint that moves
    changes little in a step, and so do the velocities of a joint that is held.
    """
    speed = np.sqrt(before * before + stick * stick)
    sign = before / speed
    return Iterate(before, sign, (1.0 - sign * sign) / speed, sign)


def newton_step(braked: Braked, iterate: Iterate, friction: Friction, stick: float) -> Iterate:
    """Return the next step of Newton's method.

    It works on v and on the share of Coulomb friction in use together (Chan, Golub, Mulet 1999), which
    unlike Newton's method on v alone converges from any velocity, mostly in two steps from that before. Each
    step is one linear equation per rollout.

    Args:
        braked: the arm's equation.
        iterate: the last step.
        friction: the coefficients.
        stick: speed below which Coulomb friction is smoothed [rad/s or m/s].
    """
    viscous, coulomb = friction
    v, sign, slope, _ = iterate
    ahead = braked(viscous + coulomb * slope, coulomb * (sign - slope * v))
    share = sign + slope * (ahead - v)
    bounded = np.minimum(np.maximum(share, -1.0), 1.0)
    speed = np.sqrt(ahead * ahead + stick * stick)
    sign_ahead = ahead / speed
    return Iterate(ahead, sign_ahead, (1.0 - bounded * sign_ahead) / speed, share)


def is_apart(iterate: Iterate, coulomb: Array) -> npt.NDArray[np.bool_]:
    """Tell for each joint whether the friction that acted is another than that of the velocity found."""
    apart: npt.NDArray[np.bool_] = abs(iterate.sign - iterate.share) > _SETTLED
    return np.logical_and(apart, coulomb > 0.0)


def braked_velocity(braked: Braked, iterate: Iterate, friction: Friction, stick: float) -> Array:
    """Return the velocity with friction at the speed found, for a rollout that has not settled.

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
