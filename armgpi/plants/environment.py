"""What the tool of an arm touches: forces on it, walls and springs, as data.

Each is a wrench at a point of a frame, which depends on where the point is and on how it moves, so a plant
asks for it at every stage of its integrator: a wall whose force is held over a whole sample has no damping.
Wrenches are in the base frame. A number may differ by rollout, shape (batch, 1).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import Parametrised, Vector, parameter, plain, with_parameters
from armgpi.errors import ParameterError
from armgpi.plants.loads import check_times
from armgpi.registry import Context
from armgpi.robot.batch import AnyRobot, VariedRobots
from armgpi.robot.frame_motion import FrameMotion, Motion
from armgpi.robot.robot import Robot

#: Speed below which the friction of a surface is smoothed [m/s].
_SLIDING = 1e-3


class Wrench(NamedTuple):
    """A force and a moment on a point of the arm, in the base frame.

    Attributes:
        force: [N], (..., 3).
        moment: [N m], likewise.
    """

    force: Array
    moment: Array


@with_parameters
class Contact(Parametrised, ABC):
    """Something outside of the arm that acts on one point of it.

    Attributes:
        frame: the link or joint that it acts on; None for the tip of an arm that has one.
        point: where, in the axes of that frame [m].
        config_name: its `type` in experiment files; None for one that has none there.
    """

    config_name: ClassVar[str | None] = None

    frame: str | None = parameter(
        "frame that it acts on", kind="text", default=None, none="the tip", kw_only=True
    )
    point: Vector = parameter(
        "point in the frame's axes", unit="m", kind="vector", default=(0.0, 0.0, 0.0), kw_only=True
    )

    @classmethod
    def configured(cls, given: Mapping[str, Any], context: Context) -> Contact:
        """Return the contact of an entry of an experiment file.

        Args:
            given: parameters by their names, in their units.
            context: what else the experiment is.
        """
        return cls(**given)

    @abstractmethod
    def wrench(self, motion: Motion, t: Array) -> Wrench:
        """Return what acts on the point.

        Args:
            motion: where the point is and how it moves.
            t: time [s], a number or (..., 1).
        """

    def depth_at(self, position: Array) -> Array | None:
        """Return a depth [m], (..., 1), below 0 where nothing acts; None for what acts everywhere.

        Between two points it differs by their distance at most, so generated code knows from one depth where
        it need not look.

        Args:
            position: of the point [m], (..., 3).
        """
        return None

    def describe(self) -> dict[str, Any]:
        """Return the contact as plain data."""
        values = {f.name: plain(getattr(self, f.name)) for f in fields(self)}
        return {"type": type(self).__name__, **values}


@with_parameters
class ToolForce(Contact):
    """A constant force and moment, from an onset until an end: a hand that pushes, or a cable that pulls.

    Attributes:
        force: in the base frame [N].
        moment: in the base frame [N m].
        onset: when it begins [s].
        end: when it is over [s].
    """

    config_name: ClassVar[str | None] = "force"

    force: Vector = parameter("force in the base frame", unit="N", kind="vector", default=(0.0, 0.0, 0.0))
    moment: Vector = parameter("moment in the base frame", unit="N m", kind="vector", default=(0.0, 0.0, 0.0))
    onset: float = parameter("time at which it begins", unit="s", default=0.0)
    end: float = parameter("time at which it is over", unit="s", default=math.inf, unlimited="never")

    def __post_init__(self) -> None:
        """Check the values, and that the end comes after the onset."""
        super().__post_init__()
        check_times(self.onset, self.end)

    def wrench(self, motion: Motion, t: Array) -> Wrench:
        """Return the force and moment; see :meth:`Contact.wrench`."""
        now = t + 0.0 * motion.position[..., 0:1]
        acts = np.where((now >= self.onset) & (now < self.end), 1.0, 0.0)
        return Wrench(acts * self.force, acts * self.moment)


@with_parameters
class Wall(Contact):
    """A plane {x: normal · x = distance} with a force on a point that is behind it.

    The force along the normal is stiffness times depth plus damping times approach, and never pulls (Kelvin
    and Voigt). Coulomb friction of the surface acts against the sliding.

    Attributes:
        normal: direction from the wall to the free side, of any length but 0.
        distance: of the plane from the base's origin, along the normal [m].
        stiffness: [N/m].
        damping: [N s/m].
        friction: Coulomb coefficient of the surface [-].
    """

    config_name: ClassVar[str | None] = "wall"

    normal: Vector = parameter("direction from the wall to the free side", kind="vector")
    distance: float = parameter("distance of the plane from the base, along the normal", unit="m")
    stiffness: float = parameter("stiffness", unit="N/m", default=1e4, least=0.0, above=True, log=True)
    damping: float = parameter("damping", unit="N s/m", default=0.0, least=0.0)
    friction: float = parameter("Coulomb friction of the surface", default=0.0, least=0.0)

    def __post_init__(self) -> None:
        """Check the values, and make the normal one of length 1."""
        super().__post_init__()
        length = float(np.linalg.norm(self.normal))
        if not length > 0.0:
            raise ParameterError("normal", plain(self.normal), "a direction, not of length 0")
        self._normal = np.asarray(self.normal) / length

    def depth(self, position: Array) -> Array:
        """Return how far a position (..., 3) is behind the plane [m], (..., 1); negative before it."""
        along = (position * self._normal)[..., 0:1] + (position * self._normal)[..., 1:2]
        depth: Array = self.distance - (along + (position * self._normal)[..., 2:3])
        return depth

    def depth_at(self, position: Array) -> Array:
        """Return how far a position is behind the plane; see :meth:`Contact.depth_at`."""
        return self.depth(position)

    def wrench(self, motion: Motion, t: Array) -> Wrench:
        """Return the force of the wall; see :meth:`Contact.wrench`."""
        depth = self.depth(motion.position)
        parts = motion.velocity * self._normal
        away = parts[..., 0:1] + parts[..., 1:2] + parts[..., 2:3]
        pressed = np.maximum(self.stiffness * depth - self.damping * away, 0.0)
        pressed = np.where(depth > 0.0, pressed, 0.0)
        sliding = motion.velocity - away * self._normal
        squares = sliding * sliding
        square = squares[..., 0:1] + squares[..., 1:2] + squares[..., 2:3]
        rubbing = self.friction * pressed / np.sqrt(square + _SLIDING * _SLIDING)
        return Wrench(pressed * self._normal - rubbing * sliding, 0.0 * motion.position)


@with_parameters
class Spring(Contact):
    """A spring and damper from a point in space to the point of the arm, equal in all directions.

    Attributes:
        anchor: the point in space at which it is at rest, in the base frame [m].
        stiffness: [N/m].
        damping: [N s/m].
    """

    config_name: ClassVar[str | None] = "spring"

    anchor: Vector = parameter("point in space at which it is at rest", unit="m", kind="vector")
    stiffness: float = parameter("stiffness", unit="N/m", default=1e3, least=0.0, log=True)
    damping: float = parameter("damping", unit="N s/m", default=0.0, least=0.0)

    def wrench(self, motion: Motion, t: Array) -> Wrench:
        """Return the force of the spring; see :meth:`Contact.wrench`."""
        force = self.stiffness * (self.anchor - motion.position) - self.damping * motion.velocity
        return Wrench(force, 0.0 * motion.position)


class Touched(NamedTuple):
    """A contact at a time.

    Attributes:
        motion: where its point is and how it moves.
        wrench: what it does to the arm.
    """

    motion: Motion
    wrench: Wrench


class Environment:
    """All contacts of an arm.

    Attributes:
        contacts: the contacts.
        motions: the kinematics of the point of each.
    """

    def __init__(self, robot: AnyRobot, contacts: Sequence[Contact]) -> None:
        """Find the points on the arm.

        Args:
            robot: the arm; arms of a batch differ in what they carry, not in their kinematics.
            contacts: what acts on it.

        Raises:
            ParameterError: for what is no contact, or arms whose points are not in the same place.
            NameNotFound: for a frame that the arm has not.
        """
        for contact in contacts:
            if not isinstance(contact, Contact):
                raise ParameterError("environment", contact, "contacts such as ToolForce, Wall or Spring")
        self.contacts = tuple(contacts)
        arms: Sequence[Robot]
        if isinstance(robot, Robot):
            arms = [robot]
        elif isinstance(robot, VariedRobots):
            arms = [robot.first]  # masses vary, not where frames are
        else:
            arms = robot.robots
        frames = [contact.frame or arms[0].tip for contact in self.contacts]
        self.motions = tuple(
            FrameMotion(arms[0], frame, contact.point)
            for frame, contact in zip(frames, self.contacts, strict=True)
        )
        probe = arms[0].middle()
        for arm in arms[1:]:
            for frame in set(frames):
                here, there = arms[0].frame_pose(frame, probe), arm.frame_pose(frame, probe)
                if not np.allclose(here.translation, there.translation, atol=1e-9):
                    raise ParameterError("environment", frame, "a frame in the same place on all arms")

    def torque(self, q: Array, v: Array, t: Array) -> Array:
        """Return the joint torque [N m or N] of all contacts, shape of `q`.

        Args:
            q: positions [rad or m], (n,) or (batch, n).
            v: velocities [rad/s or m/s], likewise.
            t: time [s], a number.
        """
        total: Any = 0.0
        for motion, wrench in self.touched(q, v, t):
            total = total + motion.torque(q, *wrench)
        torque: Array = total
        return torque

    def touched(self, q: Array, v: Array, t: Any) -> list[Touched]:
        """Return every contact with its wrench.

        Args:
            q: positions [rad or m], (..., n).
            v: velocities [rad/s or m/s], likewise.
            t: time [s], a number or (..., 1).
        """
        found = []
        for contact, points in zip(self.contacts, self.motions, strict=True):
            motion = points.at(q, v)
            found.append(Touched(motion, contact.wrench(motion, t)))
        return found

    def check_start(self, q: Array) -> None:
        """Refuse an arm that starts inside of a wall.

        Args:
            q: positions at the start [rad or m], (n,) or (batch, n).

        Raises:
            ParameterError: naming the wall, with how deep the point is.
        """
        for i, (contact, points) in enumerate(zip(self.contacts, self.motions, strict=True)):
            if isinstance(contact, Wall):
                deepest = float(np.max(contact.depth(points.at(q, np.zeros_like(q)).position)))
                if deepest > 0.0:
                    raise ParameterError(
                        f"environment.{i}.distance",
                        plain(contact.distance),
                        f"a wall that {points.frame!r} starts before; it starts {deepest:.4g} m behind it",
                    )
