"""The equations of motion of an arm, D(q) a + C(q, v) v + G(q) = tau, with their arguments checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple, NoReturn, TypeVar, cast

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array, ArrayLike, as_joint_array, check_type
from armgpi.errors import ArrayError, LimitError, ParameterError, Remedy
from armgpi.robot.drives import Drives
from armgpi.robot.dynamics import Dynamics

#: A quantity of every joint: a number, shape (n,), or joint name -> value.
PerJoint = ArrayLike | Mapping[str, float]
#: By how much a value may be beyond a bound by rounding, relative to the value, or to 1 where that is less.
_ROUNDING = 1e-9
#: Travel that an encoder of a prismatic joint without limits divides [m].
_ENCODER_TRAVEL = 1.0
#: Gear ratio behind an encoder at the motor where the drives do not say one: that of most harmonic drives.
ASSUMED_GEAR_RATIO = 100.0
#: Resolution of encoders of which nothing is said [bits]: set by hand, arms have 12 to 20.
ASSUMED_BITS = 16

_Same = TypeVar("_Same", bound="Equations")


class Limits(NamedTuple):
    """Limits of every joint, arrays of shape (n,), read-only; infinite where the URDF has none.

    Attributes:
        lower: lowest position [rad or m].
        upper: highest position [rad or m].
        velocity: highest speed [rad/s or m/s].
        effort: highest torque or force [N m or N].
    """

    lower: Array
    upper: Array
    velocity: Array
    effort: Array


class Friction(NamedTuple):
    """Joint friction as the URDF's ``<dynamics>`` gives it, arrays of shape (n,), read-only.

    Attributes:
        viscous: viscous coefficient [N m s/rad or N s/m].
        coulomb: Coulomb torque or force [N m or N].
    """

    viscous: Array
    coulomb: Array


def add_smooth_friction(torque: Array, v: Array, viscous: Array, coulomb: Array, smoothing: float) -> Array:
    """Return a torque with friction at a velocity, whose sign is smoothed [N m or N].

    The smoothed sign is 0 at rest: nobody knows which way friction points there.

    Args:
        torque: what it is added to [N m or N], (n,) or (batch, n).
        v: velocity [rad/s or m/s], likewise.
        viscous: viscous coefficient [N m s/rad or N s/m], likewise.
        coulomb: Coulomb torque or force [N m or N], likewise.
        smoothing: speed below which the sign is smoothed [rad/s or m/s].
    """
    return torque + viscous * v + coulomb * (v / np.sqrt(v * v + smoothing * smoothing))


class Outside(NamedTuple):
    """The first of some positions that is outside the joint limits.

    Attributes:
        place: index into the array of positions.
        joint: name of the joint.
        value: the position [rad or m].
        lower: lowest position [rad or m].
        upper: highest position [rad or m].
    """

    place: tuple[int, ...]
    joint: str
    value: float
    lower: float
    upper: float


class Overload(NamedTuple):
    """The joint, of those at some configurations, whose motor is the farthest from holding the arm.

    Attributes:
        place: index into the array of positions.
        joint: name of the joint.
        torque: torque or force that holds the arm there [N m or N].
        effort: effort limit of the joint [N m or N].
    """

    place: tuple[int, ...]
    joint: str
    torque: float
    effort: float


class Equations:
    """The equations of motion with their arguments checked; what a robot and a batch of them have in common.

    Positions are in rad or m, one state (n,) or a batch of states (batch, n). Frozen: an attribute cannot be
    assigned.

    Attributes:
        name: name of the robot.
        joint_names: names of the n joints, in the order of every array.
        joint_types: "revolute", "continuous" or "prismatic", for every joint.
        limits: position, velocity and effort limits.
        friction: joint friction that the URDF states; the equations of motion here leave it out.
        dynamics: the same equations without checks, for loops of one's own.
        batch: number of robots, one per row of a batch; None for a single robot.
    """

    name: str
    joint_names: tuple[str, ...]
    joint_types: tuple[str, ...]
    limits: Limits
    friction: Friction
    dynamics: Dynamics
    batch: int | None = None

    @property
    def n(self) -> int:
        """Number of joints, coordinates and velocities."""
        return len(self.joint_names)

    @property
    def prismatic(self) -> npt.NDArray[np.bool_]:
        """Which joints are prismatic, shape (n,): their units are m and N, not rad and N m."""
        return np.array([kind == "prismatic" for kind in self.joint_types])

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Return the inertia matrix D(q), by CRBA.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).

        Returns:
            D, shape (n, n) or (batch, n, n), symmetric and positive definite.

        Raises:
            ArrayError: when `q` has another shape or dtype or is not finite.
        """
        (q_,) = self._states(q=q)
        return self.dynamics.mass_matrix(q_)

    def gravity(self, q: ArrayLike) -> Array:
        """Return the gravity torque G(q), which holds the arm at rest.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).

        Returns:
            Torques [N m or N], same shape.

        Raises:
            ArrayError: when `q` has another shape or dtype or is not finite.
        """
        (q_,) = self._states(q=q)
        return self.dynamics.gravity(q_)

    def nonlinear_effects(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return C(q, v) v + G(q): Coriolis, centripetal and gravity torque.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            v: velocities [rad/s or m/s], same shape.

        Returns:
            Torques [N m or N], same shape.

        Raises:
            ArrayError: when an argument has another shape or dtype or is not finite.
        """
        q_, v_ = self._states(q=q, v=v)
        return self.dynamics.nonlinear_effects(q_, v_)

    def forward_dynamics(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> Array:
        """Return the acceleration D(q)^-1 (tau - C(q, v) v - G(q)), by ABA.

        Friction of the URDF is not part of it; a plant adds that (see ``armgpi.RigidBodyPlant``).

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            v: velocities [rad/s or m/s], same shape.
            tau: torques [N m or N], same shape.

        Returns:
            Accelerations [rad/s^2 or m/s^2], same shape.

        Raises:
            ArrayError: when an argument has another shape or dtype or is not finite.
        """
        q_, v_, tau_ = self._states(q=q, v=v, tau=tau)
        return self.dynamics.forward(q_, v_, tau_)

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Return the torque D(q) a + C(q, v) v + G(q), by RNEA.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            v: velocities [rad/s or m/s], same shape.
            a: accelerations [rad/s^2 or m/s^2], same shape.

        Returns:
            Torques [N m or N], same shape.

        Raises:
            ArrayError: when an argument has another shape or dtype or is not finite.
        """
        q_, v_, a_ = self._states(q=q, v=v, a=a)
        return self.dynamics.inverse(q_, v_, a_)

    def inertia_times(self, q: ArrayLike, a: ArrayLike) -> Array:
        """Return D(q) a without building D.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            a: accelerations [rad/s^2 or m/s^2], same shape.

        Returns:
            Torques [N m or N], same shape.

        Raises:
            ArrayError: when an argument has another shape or dtype or is not finite.
        """
        q_, a_ = self._states(q=q, a=a)
        return self.dynamics.inertia_times(q_, a_)

    def inertia_solve(self, q: ArrayLike, tau: ArrayLike) -> Array:
        """Return D(q)^-1 tau without building D.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            tau: torques [N m or N], same shape.

        Returns:
            Accelerations [rad/s^2 or m/s^2], same shape.

        Raises:
            ArrayError: when an argument has another shape or dtype or is not finite.
        """
        q_, tau_ = self._states(q=q, tau=tau)
        return self.dynamics.inertia_solve(q_, tau_).copy()

    def check_position(self, q: ArrayLike, what: str) -> Array:
        """Return positions as an array, refusing those outside the joint limits.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            what: what they are, for the message ("the start").

        Raises:
            ArrayError: when the shape or dtype is wrong or a value is not finite.
            LimitError: when a position is outside its joint's limits by more than rounding.
        """
        check_type(what, "what", str, "text")
        (positions,) = self._states(**{what: q})
        outside = self.outside(positions)
        if outside is not None:
            degrees = abs(outside.value) > 2.0 * math.pi and not self.prismatic[outside.place[-1]]
            remedy = (
                f"give rad: {outside.value:g} deg is {math.radians(outside.value):.4g}" if degrees else ""
            )
            raise LimitError(what, *outside[1:], remedy)
        return positions

    def outside(self, q: Array) -> Outside | None:
        """Return the first position that is outside the joint limits by more than rounding, if there is one.

        Args:
            q: positions [rad or m], shape (..., n), which broadcasts against the limits; not checked.

        Returns:
            Index, joint, value and limits of that position; None when all are inside.
        """
        slack = _ROUNDING * np.maximum(1.0, np.abs(q))
        lower, upper = self.limits.lower, self.limits.upper
        beyond = np.asarray((q < lower - slack) | (q > upper + slack))
        if not beyond.any():
            return None
        index = tuple(int(i) for i in np.argwhere(beyond)[0])
        value, low, high = (float(np.broadcast_to(x, beyond.shape)[index]) for x in (q, lower, upper))
        return Outside(index, self.joint_names[index[-1]], value, low, high)

    def holding_share(self, q: ArrayLike) -> Array:
        """Return the share of the effort limits that it takes to hold the arm at rest, ``|G(q)| / effort``.

        Above 1 the motor of that joint cannot hold the arm. 0 where gravity asks for nothing, infinite where
        it asks for something and the effort limit is 0.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).

        Returns:
            Shares, shape as `q`.

        Raises:
            ArrayError: when `q` has another shape or dtype or is not finite.
        """
        holding = np.abs(self.gravity(q))
        effort = np.broadcast_to(self.limits.effort, holding.shape)
        weak = np.where(holding > 0.0, math.inf, 0.0)
        with np.errstate(over="ignore"):  # of efforts such as 1e-310: infinite as well
            return np.divide(holding, effort, out=weak, where=effort > 0.0)

    def check_holding(self, q: ArrayLike, what: str) -> None:
        """Refuse configurations at which gravity exceeds a joint's effort limit: nothing holds the arm there.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            what: what they are, for the message ("the start").

        Raises:
            ArrayError: when `q` is not as it should be.
            LimitError: when a joint cannot hold the arm.
        """
        beyond = self.overloaded(q)
        if beyond is None:
            return
        _, joint, torque, effort = beyond
        enough = enough_efforts(self, q, joint)
        raise LimitError(
            f"the torque that holds the arm at {what}",
            joint,
            torque,
            -effort,
            effort,
            "start at another configuration, or raise the effort limit with "
            f"robot.with_limits(effort={enough})",
        ).suggesting(Remedy("effort", (*enough,), max(enough.values())))

    def overloaded(self, q: ArrayLike) -> Overload | None:
        """Return where gravity exceeds an effort limit the most, by more than rounding, if it does anywhere.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).

        Raises:
            ArrayError: when `q` has another shape or dtype or is not finite.
        """
        share = self.holding_share(q)
        if not (share > 1.0 + _ROUNDING).any():
            return None
        place = tuple(int(i) for i in np.unravel_index(int(share.argmax()), share.shape))
        torque, effort = self.gravity(q), np.broadcast_to(self.limits.effort, share.shape)
        return Overload(place, self.joint_names[place[-1]], float(torque[place]), float(effort[place]))

    def encoder_count(self, bits: float | Array) -> Array:
        """Return one count of an absolute encoder at every joint.

        It is a turn / 2^bits; for a prismatic joint its travel / 2^bits, or 1 m / 2^bits without limits.
        An encoder that is specified to sit at the motor (`encoder_side` of the drives) is finer by the gear
        ratio: that of the drives, or 100 where they have none, which is usual for harmonic drives. Of a
        slide's motor the ratio has to be known [rad/m].

        Args:
            bits: resolution [bits], a number or an array that broadcasts against (n,); not checked.

        Returns:
            Counts [rad or m], shape (n,) or (batch, n).
        """
        travel = self.limits.upper - self.limits.lower
        travel = np.where(np.isfinite(travel) & (travel > 0.0), travel, _ENCODER_TRAVEL)
        at_joint = np.where(self.prismatic, travel, 2.0 * math.pi)
        drives: Drives = cast(Any, self).drives
        ratio = drives.value("gear_ratio", math.nan)
        known = np.where(self.prismatic, ratio, np.where(np.isnan(ratio), ASSUMED_GEAR_RATIO, ratio))
        geared = (drives.value("encoder_side") == "motor") & np.isfinite(known)
        return np.asarray(np.where(geared, 2.0 * math.pi / known, at_joint) / 2.0**bits)

    def middle(self) -> Array:
        """Return the middle of the joint ranges [rad or m], shape (n,) or (batch, n).

        It is 0, or the limit nearest to it, for a joint that lacks a limit.
        """
        lower, upper = self.limits.lower, self.limits.upper
        bounded = np.isfinite(lower) & np.isfinite(upper)
        nearest_zero = np.clip(0.0, lower, upper)
        centre = 0.5 * (np.where(bounded, lower, 0.0) + np.where(bounded, upper, 0.0))
        return np.where(bounded, np.clip(centre, lower, upper), nearest_zero)

    def wrap(self, q: ArrayLike, near: ArrayLike | None = None) -> Array:
        """Return positions with every continuous joint moved by whole turns to within half a turn of `near`.

        Nothing here wraps by itself: a continuous joint is an unbounded angle, and a goal of 6 pi is three
        turns away. This is the choice of the short way.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            near: positions, same shape; zero when not given.

        Returns:
            Positions [rad or m], shape as `q`.

        Raises:
            ArrayError: when an argument has another shape or dtype or is not finite.
        """
        arguments = {"q": q} if near is None else {"q": q, "near": near}
        q_, *given = self._states(**arguments)
        centre = given[0] if given else np.zeros_like(q_)
        continuous = np.array([kind == "continuous" for kind in self.joint_types])
        turns = np.round((q_ - centre) / (2.0 * math.pi))
        return np.where(continuous, q_ - 2.0 * math.pi * turns, q_)

    def _states(self, **arguments: ArrayLike) -> tuple[Array, ...]:
        """Check state-like arguments and give them one shape; a single state fits any batch."""
        arrays = [as_joint_array(value, name, self.joint_names) for name, value in arguments.items()]
        shapes = [array.shape for array in arrays]
        if self.batch is not None:
            shapes.append((self.batch, self.n))
        try:
            shape = np.broadcast_shapes(*shapes)
        except ValueError:
            names = ", ".join(arguments)
            raise ArrayError(names, f"shapes do not match: {', '.join(map(str, shapes))}") from None
        if self.batch is not None and shape != (self.batch, self.n):
            raise ArrayError(", ".join(arguments), f"expected {self.batch} rows, got shape {shape}")
        return tuple(np.ascontiguousarray(np.broadcast_to(array, shape)) for array in arrays)

    def _with_attributes(self: _Same, **attributes: Any) -> _Same:
        """Return a copy with other attributes, which are not checked; all else is shared."""
        made = object.__new__(type(self))
        vars(made).update({**vars(self), **attributes})
        return made

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse to assign an attribute."""
        self._refuse(name, value)

    def __delattr__(self, name: str) -> None:
        """Refuse to delete an attribute."""
        self._refuse(name, None)

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        """Take the state of a pickle or copy; its arrays lost their protection on the way."""
        vars(self).update(state)
        for array in (*self.limits, *self.friction, *(state.get("coupling") or ())):
            array.setflags(write=False)

    def _refuse(self, name: str, value: object) -> NoReturn:
        expected = (
            f"left as it is: a {type(self).__name__} never changes, its with_... methods return another"
        )
        raise ParameterError(name, value, expected)


def enough_efforts(arm: Equations, q: ArrayLike, first: str) -> dict[str, float]:
    """Return effort limits that hold an arm, of each joint that cannot hold it, half as large again.

    Args:
        arm: one arm.
        q: positions [rad or m], shape (n,) or (batch, n).
        first: joint that comes first.
    """
    holding = np.abs(arm.gravity(q)).reshape(-1, arm.n).max(axis=0)
    weak = np.any((arm.holding_share(q) > 1.0 + _ROUNDING).reshape(-1, arm.n), axis=0)
    enough = {
        name: float(f"{1.5 * torque:.3g}")
        for name, torque, is_weak in zip(arm.joint_names, holding, weak.tolist(), strict=True)
        if is_weak
    }
    return {first: enough.pop(first), **enough}
