"""How every control reaches the numbers of one form of the loop.

A loop is given all places of a slider at once, one for each rollout, by the door that sweeps use; the numbers
that then differ between rollouts are those that the slider moves, and their values a table over its places.
Numbers that several sliders move have one over all of their places. What has no places, as a goal that may be
anywhere, is looked at in two, and is the value itself, or the value less a constant.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.codegen.kernels import Arm, Kernel, arm_of
from armgpi.codegen.source import Layout, layout, trace_used
from armgpi.codegen.trace import Inventory, Trace, tracing
from armgpi.errors import ArmgpiError, BackendError
from armgpi.gpi.gains import Tuning
from armgpi.loop.closed_loop import ClosedLoop
from armgpi.loop.variables import check_values, spread_rows, variables, with_values
from armgpi.robot.robot import Robot
from armgpi.viewing.play.controls import Control
from armgpi.viewing.play.loops import BITS, PARTS, SCALE, Listing, movable, tape_of

#: What a page records, if there is such a thing.
_RECORDED = ("q", "v", "q_ref", "v_ref", "q_measured", "tau_command", "tau", Tuning._fields[0])
#: Most entries of a table over several controls.
_MOST = 6000

#: An experiment, or something else, as plain data; makes the loop of one.
Data = dict[str, Any]
Make = Callable[[Data], ClosedLoop]


class Move(NamedTuple):
    """Numbers that follow one control.

    Attributes:
        control: its id.
        at: places of the numbers.
        joint: of each, the joint whose value it follows; -1 where all joints have one.
        factor: of each, 1 or -1.
        constant: of each, what is added to factor times the value.
    """

    control: str
    at: list[int]
    joint: list[int]
    factor: list[float]
    constant: list[float]


class Table(NamedTuple):
    """Numbers, or kernels, that depend on controls by a table over the places of their sliders.

    Attributes:
        controls: their ids.
        at: places of the numbers, or the calls of a sample.
        values: of all at the first places of the sliders, then at the next one of the last slider, and so on.
        unless: ids of one of its controls and of another one: where that one is moved, and not this one,
            another table counts; empty for none.
    """

    controls: tuple[str, ...]
    at: list[int]
    values: Array
    unless: tuple[str, ...] = ()


class Sample(NamedTuple):
    """The generated code of one form, without its kernels.

    Attributes:
        layout: of its numbers.
        calls: of each call of a kernel, whose arm it is of and what it works out; of another "" and its name.
    """

    layout: Layout
    calls: list[tuple[str, str]]


@dataclass
class Pool:
    """What the forms of a page have in common.

    Attributes:
        names: of the kernels, in the order of their indices.
        arms: whose equations of motion they are, by the sections of the experiment that decide it.
        rows: numbers at all places of a control, of its part and of the start, by what decides them.
    """

    names: list[str] = field(default_factory=list)
    arms: dict[str, list[dict[str, Arm]]] = field(default_factory=dict)
    rows: dict[Any, dict[Any, Array]] = field(default_factory=dict)


class Prober:
    """One form of the loop, and what its controls do."""

    def __init__(self, form: Data, config: Data, controls: Sequence[Control], make: Make, pool: Pool) -> None:
        """Look at a form (id of a choice -> its value) of an experiment, and at the controls that it has."""
        self.form, self.config, self.make, self.pool = form, config, make, pool
        self.controls = {control.id: control for control in controls}
        self._base = self._loop({})
        self._probed: dict[str, Array] = {}
        self._arms = {side: self._list_arms(side) for side in ("plant", "controller")}
        # What a load makes two models of has one without: which call is whose a trace with a load tells.
        self._traced = movable(self._loop({c.id: c.values[-1] for c in controls if c.arm == "controller"}))
        self.loop = movable(self._base)
        self._listed = Listing(self.loop)
        self._ways = {way: slice(x.start, x.stop) for way, x in self._listed.places().items()}
        self.first = np.concatenate([self._listed.values.shared, self._listed.start[0]])
        self.shared = len(self._listed.values.shared)

    @property
    def name(self) -> str:
        """The structure of its code as text; empty where something in it has none."""
        own = Inventory(self._traced, self._traced.init()).name
        arms = [arm.model.digest for arms in self._arms.values() for each in arms for arm in each.values()]
        return f"{own} {arms}" if own else ""

    def trace(self) -> tuple[Trace, Sample]:
        """Return one sample of the loop, and what a page knows of its code."""
        loop = self._traced
        with tracing():
            found = trace_used(loop, loop.init(), True, contacts=True)
        recorded = found.recorded
        shown = [*_RECORDED, *(name for name in recorded if name.startswith("contacts."))]
        found.recorded = {name: recorded[name] for name in shown if name in recorded}
        owners = {
            id(kernel): (name, method)
            for side in self._arms
            for name, arm in _arms_of(loop, side).items()
            for method, kernel in arm.kernels.items()
        }
        calls = []
        for call in found.calls:
            owner = owners.get(id(call.kernel), ("", call.kernel.name))
            if not owner[0] and not call.kernel.name.startswith(("friction_", "contact")):
                raise BackendError(
                    f"{call.kernel.name}: the arm that it belongs to, and so its payload, is unknown"
                )
            calls.append(owner)
        return found, Sample(layout(found), calls)

    def kernels(self, sample: Sample) -> Iterator[Kernel]:
        """Yield the equations of motion of all places of the sliders."""
        for owner, method in dict.fromkeys(sample.calls):
            for arms in self._arms[_side(owner)] if owner else ():
                yield arms[owner].kernel(method)

    def variant(self, sample: Sample) -> Data:
        """Return what a page knows of it: its code, its numbers at first, and what its controls do."""
        tape = tape_of(self.loop, self._listed)
        matters = np.ones(len(self.first), dtype=bool)
        matters[: self.shared] = np.isin(np.arange(self.shared), sample.layout.shared)
        if tape is not None:
            # What is worked out of the tuning follows it, and the tuning matters where it is asked for.
            asked = {at for operation, *steps in tape.steps if operation in "+-*/" for at in steps}
            matters[[step[1] for at, step in enumerate(tape.steps) if step[0] == "place" and at in asked]] = 1
            matters[[place for _, place in tape.outputs]] = False
        changed = {name: self._changes(name) & matters for name in self.controls}
        moves = [
            self._move(name, np.flatnonzero(places).tolist())
            for name, places in changed.items()
            if places.any() and self._anywhere(name)
        ]
        still = {name for name, places in changed.items() if not places.any() and not self.controls[name].arm}
        tables = [
            table
            for half in (slice(0, self.shared), slice(self.shared, None))
            for names, places in self._groups(changed, half)
            for table in self._tables(names, places, still)
        ]
        seeds = self._listed.values.seeds
        draws = [
            (str((seeds[seed] if own else seed) % 2**64), stream, ahead)
            for own, seed, stream, ahead in sample.layout.draws
        ]
        return {
            "form": self.form,
            "layout": sample.layout,
            "numbers": self.first,
            "shared": self.shared,  # the others are of the state
            "tape": tape,
            "draws": draws,
            "moves": moves,
            "tables": tables,
            "arms": list(self._kernels(sample)),
            "unmoved": sorted(still),
        }

    def _loop(self, moved: Mapping[str, Any]) -> ClosedLoop:
        """Return the loop of an experiment in which some controls are moved."""
        config = json.loads(json.dumps(self.config))  # some five times as fast as deepcopy
        for name, value in moved.items():
            self.controls[name].put(config, value)
        return self.make(config)

    def _anywhere(self, name: str) -> bool:
        """Tell whether a control is looked at in two places alone: it may be anywhere, or ends a box."""
        control = self.controls[name]
        return bool(control.joints) or control.group == "pushes" or control.path[-1] in ("lower", "upper")

    def _values(self, name: str) -> Sequence[Any]:
        """Return all places of a control, or two of what is looked at in two alone."""
        control = self.controls[name]
        if control.joints:
            low, high = np.clip(np.array(control.joints), -7.3, 7.1).T
            shares = np.linspace(0.31, 0.47, len(low))
            return [low + share * (high - low) for share in (shares, 1.0 - shares)]
        if not self._anywhere(name):
            return control.values
        # An upper end stays above the lower one.
        size = -control.value if control.path[-1] == "lower" else control.value
        return [control.value + share * size for share in (0.031, 0.047)] if size else (0.31, 0.47)

    def _needs_a_loop(self, name: str) -> bool:
        """Tell whether a loop is made anew at each place of a control."""
        return bool(self.controls[name].arm) or self.controls[name].rebuilds

    def _changes(self, name: str) -> Any:
        """Return which numbers a control changes."""
        with suppress(ArmgpiError):  # it decides the form of the loop
            self._probed[name] = self._rows({name: self._values(name)})
        return (self._probed.get(name, self.first[None]) != self.first).any(axis=0)

    def _groups(self, changed: Mapping[str, Any], half: slice) -> Iterator[tuple[list[str], list[int]]]:
        """Yield controls that change some of the same numbers, each with all that one of them changes."""
        left = {
            name: set((half.start + np.flatnonzero(flags[half])).tolist())
            for name, flags in changed.items()
            if flags[half].any() and not self._anywhere(name)
        }
        while left:
            name = next(iter(left))
            names, places = [name], left.pop(name)
            while more := [name for name, others in left.items() if others & places]:
                names += more
                places = places.union(*map(left.pop, more))
            yield names, sorted(places)

    def _rows(self, moved: Mapping[str, Sequence[Any]]) -> Array:
        """Return the numbers of the loop at some places of controls, a row for each."""
        own_parts = {self.controls[name].part for name in moved}
        parts = [part for part in PARTS if part in own_parts]  # in their order, as they have arrays in common
        ways = {way: places for way, places in self._ways.items() if way[0] in parts}
        # Forms have parts in common, and controllers that measure the same start alike.
        alike = b""
        if parts == ["controller"]:
            alike, ways["start"] = self.first[self.shared :].tobytes(), slice(self.shared, None)
        key = (*moved, *(id(getattr(self._base, part)) for part in parts), alike)
        count = len(next(iter(moved.values())))
        found = np.tile(self.first, (count, 1))
        if len(moved) == 1 and ways.keys() <= (known := self.pool.rows.get(key, {})).keys():
            for way, places in ways.items():
                found[:, places] = known[way]
            return found
        # Loads and rotors have equations of motion of their own, and so a loop; springs are made anew.
        alone = {name: values for name, values in moved.items() if self._needs_a_loop(name)}
        groups: dict[str, list[int]] = {}
        for i in range(count):
            groups.setdefault(repr([values[i] for values in alone.values()]), []).append(i)
        for rows in groups.values():
            first = {name: values[rows[0]] for name, values in alone.items()}
            loop = self._loop(first) if alone else self._base
            own = {name: [values[i] for i in rows] for name, values in moved.items() if name not in alone}
            numbers = {name: own.pop(name) for name in (SCALE, BITS) if name in own}
            if own:
                checked = check_values(variables(loop), dict(self._door(loop, own)))
                loop = with_values(loop, spread_rows(checked, len(rows)), len(rows))
            listed = Listing(movable(loop, numbers), parts)
            listed.arrays["start"] = start = listed.start
            if start.shape[1] != len(self.first) - self.shared or not ways.keys() <= listed.arrays.keys():
                raise ArmgpiError(f"{', '.join(moved)}: changes the form of the loop")
            for way, places in ways.items():
                array = listed.arrays[way]
                found[rows, places] = array.reshape(-1, array.shape[-1]) if array.ndim > 1 else array
            found[rows, self.shared :] = start
        if alike or (found[:, self.shared :] == self.first[self.shared :]).all():
            self.pool.rows[key] = {way: found[:, places] for way, places in ways.items()}
        return found

    def _door(self, loop: ClosedLoop, moved: Mapping[str, Sequence[Any]]) -> Iterator[tuple[str, Any]]:
        """Yield names of a loop's variables and their values, which some places of controls are."""
        single = "goal" in loop.reference.variables()
        for name, values in moved.items():
            first, *_, last = path = self.controls[name].path
            if name == "reference.durations":
                for i, times in enumerate(zip(*values, strict=True)):
                    yield "reference.duration" if single else f"{name}.{i}", np.array(times)
            elif first == "reference" and single:
                yield "reference.goal", np.array(values)
            elif last in ("lower", "upper"):
                ends = {**self.config["controllers"][0][path[2]], last: np.array(values)}
                yield f"controller.{path[2]}", (ends["lower"], ends["upper"])
            else:
                own = name.replace("controllers.0", "controller").replace("robot.friction", "plant")
                yield own, np.array(values, dtype=np.float64)

    def _move(self, name: str, places: list[int]) -> Move:
        """Return how numbers follow a control's value.

        Raises:
            ArmgpiError: when one is not that value but for a constant.
        """
        values, rows = self._values(name), self._probed[name]
        points = self.config["reference"]["points"] or []
        constants = [0.0, *sorted({float(x) for point in points for x in point})]
        found: list[tuple[int, int, float, float]] = []
        for place in places:
            probes = [(np.ravel(value), row[place]) for value, row in zip(values, rows, strict=True)]
            if (way := _way(probes, constants)) is None:
                raise ArmgpiError(f"{name}: moves a number that is neither its value nor that less another")
            found.append((place, *way))
        return Move(name, *map(list, zip(*found, strict=True)))

    def _tables(self, names: list[str], places: list[int], still: set[str]) -> Iterator[Table]:
        """Yield tables of the numbers that some controls move together; who finds no room in one stays."""
        # Of a scaled nominal model and one with a load there is one at a time; see Control.excludes.
        pairs = [(name, other) for name in names if (other := self.controls[name].excludes) in names]
        for unless in pairs or ((),):
            group = [name for name in names if name not in unless[1:]]
            while len(group) > 1 and math.prod(len(self.controls[name].values) for name in group) > _MOST:
                # The start of an arm with a state of its own depends on more than a table can hold.
                group.remove(most := max(group, key=lambda name: len(self.controls[name].values)))
                still.add(most)
            axes = [self.controls[name].values for name in group]
            rows = self._probed[group[0]]
            if len(group) > 1:
                rows = self._rows(dict(zip(group, zip(*itertools.product(*axes), strict=True), strict=True)))
            yield Table(tuple(group), places, rows[:, places], unless)

    def _list_arms(self, side: str) -> list[dict[str, Arm]]:
        """Return the arms of the plant or of the controller, at all places of what changes them."""
        names = [name for name, control in self.controls.items() if control.arm == side]
        own = {**self.config["plant"], "friction": None} if side == "plant" else self.config["controllers"]
        key = repr([side, names, self.config["robot"], own])
        if key not in self.pool.arms:
            axes = [self.controls[name].values for name in names]
            loops = (self._loop(dict(zip(names, values, strict=True))) for values in itertools.product(*axes))
            self.pool.arms[key] = [_arms_of(loop, side) for loop in loops]
        return self.pool.arms[key]

    def _kernels(self, sample: Sample) -> Iterator[Table]:
        """Yield which kernels the calls are of: those of arms that controls change, and others."""
        place = self.pool.names.index
        sides: dict[str, list[dict[str, Arm]]] = {**self._arms, "": [{}]}
        for side, arms in sides.items():
            own = {i: each for i, each in enumerate(sample.calls) if _side(each[0]) == side}
            names = tuple(name for name, control in self.controls.items() if control.arm == side != "")
            which = [
                [
                    place(f"{method}_{arm[owner].model.digest}" if owner else method)
                    for owner, method in own.values()
                ]
                for arm in arms
            ]
            yield Table(names, list(own), np.array(which, dtype=np.float64))


def _side(owner: str) -> str:
    """Return the part whose arm it is, empty for none."""
    return owner if owner in ("plant", "") else "controller"


def _arms_of(loop: ClosedLoop, side: str) -> dict[str, Arm]:
    """Return the arm of the plant, or those that the controller has by their names there."""
    robots: dict[str, Any] = {"plant": loop.plant.robot}
    if side != "plant":
        robots = {name: part for name, part in vars(loop.controller).items() if isinstance(part, Robot)}
    arms = {name: robot.dynamics for name, robot in robots.items()}
    return {name: arm_of(getattr(each, "base", each)) for name, each in arms.items()}


def _way(probes: list[tuple[Array, float]], constants: list[float]) -> tuple[int, float, float] | None:
    """Return joint, factor and constant by which a number follows a value; None where it does not."""
    count = len(probes[0][0])
    for joint in range(count):
        for factor in (1.0, -1.0):
            for constant in constants:
                for c in (constant, -constant):
                    if all(factor * value[joint] + c == x for value, x in probes):
                        return (joint if count > 1 else -1), factor, c
    return None
