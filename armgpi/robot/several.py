"""Robots of several rollouts: one for each, or one with other numbers in each."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from armgpi.base.arrays import SMALLEST, Array, as_sized_array, check_type, frozen, is_listing
from armgpi.base.parameter import plain
from armgpi.errors import ArrayError, NameNotFound, ParameterError
from armgpi.robot.changes import CHANGES, change
from armgpi.robot.drives import Drives
from armgpi.robot.dynamics import stack_dynamics
from armgpi.robot.edits import Edits
from armgpi.robot.equations import Equations, Friction, Limits


class RobotBatch(Equations):
    """One robot per rollout: the same joints, other masses, payloads or limits.

    Row i of every array argument belongs to ``robots[i]``. It goes where a :class:`Robot` goes in a plant
    or a controller.

    Attributes:
        robots: the robots.
        batch: their number.
        limits: arrays of shape (batch, n).
    """

    robots: tuple[Any, ...]
    batch: int

    def __init__(self, robots: Sequence[Any]) -> None:
        """Stack robots with equal joint names.

        Raises:
            ParameterError: when there are none or their joints differ.
        """
        if not is_listing(robots) or not len(robots) or not all(isinstance(r, Edits) for r in robots):
            raise ParameterError("robots", robots, "a sequence of at least one Robot")
        first = robots[0]
        for robot in robots:
            if robot.joint_names != first.joint_names:
                raise ParameterError(
                    "robots", robot, f"robots with the joints {', '.join(first.joint_names)}"
                )
        limits = np.stack([robot.limits for robot in robots], axis=1)
        friction = np.stack([robot.friction for robot in robots], axis=1)
        vars(self).update(
            robots=tuple(robots),
            name=first.name,
            joint_names=first.joint_names,
            joint_types=first.joint_types,
            batch=len(robots),
            limits=Limits(*map(frozen, limits)),
            friction=Friction(*map(frozen, friction)),
            dynamics=stack_dynamics([robot.dynamics for robot in robots]),
        )

    @property
    def first(self) -> Any:
        """The robot of the first rollout."""
        return self.robots[0]

    @property
    def drives(self) -> Drives:
        """What is known of the drives of the first robot."""
        found: Drives = self.robots[0].drives
        return found

    @property
    def armature(self) -> Array:
        """Rotor inertia reflected to every joint [kg m^2 or kg], shape (batch, n)."""
        return np.stack([robot.armature for robot in self.robots])

    @property
    def provenance(self) -> dict[str, Any]:
        """Where the models came from."""
        return {"robots": [robot.provenance for robot in self.robots]}

    def scaled_inertia(self, factor: float) -> RobotBatch:
        """Return the robots with every mass and inertia scaled; see :meth:`armgpi.Robot.scaled_inertia`."""
        return RobotBatch([robot.scaled_inertia(factor) for robot in self.robots])

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"RobotBatch({self.batch} x {self.name!r}, n={self.n})"


class VariedRobots(RobotBatch):
    """One robot with other numbers in each rollout; :meth:`armgpi.Robot.varied` makes it.

    What varies is what was declared: a payload of 0 or a scale of 1 is a value like others. Everything is
    worked out for all rollouts at once.

    Attributes:
        base: the robot that varies.
        variation: name -> array (batch, ...) of what was declared to vary, and the frame of the load.
        limits: arrays of shape (n,), `effort` of (batch, n) where it varies.
        friction: arrays of shape (n,), or (batch, n) where they vary.
    """

    base: Any
    variation: Mapping[str, Any]

    def __init__(self, base: Any, frame: str | None = None, **given: Any) -> None:
        """Vary a robot; arguments and errors as :meth:`armgpi.Robot.varied`."""
        check_type(base, "base", Edits, "a Robot")
        arrays = {name: _rows(name, value, base) for name, value in given.items() if value is not None}
        if not arrays:
            raise ParameterError("varied", list(given), "at least one quantity that varies")
        variation: dict[str, Any] = {}
        if "payload" in arrays:
            variation["frame"] = frame = base.tip if frame is None else frame
        elif "com" in arrays or frame is not None:
            raise ParameterError("com" if "com" in arrays else "frame", frame, "given with a payload")
        batch = common_batch({name: len(array) for name, array in arrays.items()})
        arrays = {name: frozen(np.broadcast_to(x, (batch, *x.shape[1:]))) for name, x in arrays.items()}
        viscous, coulomb = base.friction
        vars(self).update(
            base=base,
            variation=arrays | variation,
            name=base.name,
            joint_names=base.joint_names,
            joint_types=base.joint_types,
            batch=batch,
            limits=base.limits._replace(effort=arrays.get("effort", base.limits.effort)),
            friction=Friction(arrays.get("viscous", viscous), arrays.get("coulomb", coulomb)),
            dynamics=base._varied_dynamics(batch, frame, arrays),
        )

    @cached_property
    def robots(self) -> tuple[Any, ...]:  # type: ignore[override]
        """A robot for each rollout, made when it is asked for; rollouts that are alike share one."""
        numbers = np.hstack(
            [x.reshape(self.batch, -1) for key, x in self.variation.items() if key != "frame"]
        )
        keys = [row.tobytes() for row in numbers]
        made = {key: self._robot(i) for key, i in {key: i for i, key in enumerate(keys)}.items()}
        return tuple(made[key] for key in keys)

    @cached_property
    def first(self) -> Any:
        """The robot of the first rollout, made without those of the others."""
        return self._robot(0)

    @property
    def drives(self) -> Drives:
        """What is known of the drives of the robot that varies."""
        found: Drives = self.base.drives
        return found

    @property
    def armature(self) -> Array:
        """Rotor inertia reflected to every joint [kg m^2 or kg], (n,), or (batch, n) where it varies."""
        own = self.base.armature
        if "inertia_scale" in self.variation:
            own = self.variation["inertia_scale"][:, None] * own
        return np.asarray(self.variation.get("rotor_inertia", own))

    @property
    def provenance(self) -> dict[str, Any]:
        """Where the model came from, and what varies."""
        varied = {key: plain(value) for key, value in self.variation.items()}
        return {"robots": [self.base.provenance], "varied": varied}

    def scaled_inertia(self, factor: float) -> RobotBatch:
        """Return the robots with every mass and inertia scaled; see :meth:`armgpi.Robot.scaled_inertia`."""
        own = self.robots
        return RobotBatch([robot.scaled_inertia(factor) for robot in own])

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"{self.base!r}.varied({', '.join(self.variation)}), {self.batch} rollouts"

    def _robot(self, i: int) -> Any:
        """Return the robot of one rollout."""
        varied = self.variation.items()
        return change(self.base, {key: x if key == "frame" else x[i] for key, x in varied})


def _rows(name: str, value: Any, robot: Edits) -> Array:
    """Return what varies as an array with a row for each rollout, or with one row that fits any number.

    Args:
        name: the quantity, a key of `CHANGES`.
        value: one number, or one for each rollout, (batch,) or (batch, 1), the same for all joints; or all
            values, (batch, n) for a quantity per joint. (n,) is one number for each of n rollouts. A vector
            is (3,) or (batch, 3).
        robot: the robot that varies.

    Returns:
        (rows,), (rows, n) or (rows, 3).

    Raises:
        NameNotFound: for a quantity that cannot vary.
        ArrayError: for another shape, or a value that is too small; it says what is expected.
    """
    if name not in CHANGES:
        raise NameNotFound("quantity that varies", name, tuple(CHANGES))
    declared = CHANGES[name]
    of_joints = (robot.n,) if declared.per_joint else ()
    tail = (3,) if declared.kind == "vector" else of_joints
    least, bound = declared.least, "zero or positive"
    if declared.above:
        least, bound = SMALLEST, "positive"
    array = as_sized_array(value, name, infinite=name == "effort")
    count = math.prod(tail)
    if declared.kind == "vector":
        array = np.atleast_2d(array)
    elif array.ndim < 2 or array.shape[1:] == (1,):  # one number, or one for each rollout
        array = np.repeat(array.reshape(-1, 1), count, axis=1)
    if array.shape[1:] != (count,) or not len(array):
        whole = str(("batch", *tail)).replace("'", "")
        raise ArrayError(name, f"expected shape {whole}, a row for each rollout; got {np.shape(value)}")
    if (array < least).any():
        raise ArrayError(name, f"expected {bound} values, got {array.min():g}")
    return array.reshape(len(array), *tail)


def common_batch(rows: Mapping[str, int]) -> int:
    """Return the number of rollouts of several quantities, of which those with one row fit any.

    Raises:
        ArrayError: when two differ; it names them.
    """
    name = max(rows, key=lambda each: rows[each])
    for other, count in rows.items():
        if count not in (1, rows[name]):
            expected = f"expected a row for each of {rows[name]} rollouts, as {name} has"
            raise ArrayError(other, f"{expected}; got {count} rows")
    return rows[name]
