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
from armgpi.viewing.play.loops import BITS, PARTS, SCALE, Listing, Tape, movable, tape_of

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
        structure = Inventory(self._traced, self._traced.init()).name
        digests = []
        for arms_of_places in self._arms.values():
            for arms in arms_of_places:
                digests += [arm.model.digest for arm in arms.values()]
        return f"{structure} {digests}" if structure else ""

    def trace(self) -> tuple[Trace, Sample]:
        """Return one sample of the loop, and what a page knows of its code."""
        loop = self._traced
        with tracing():
            trace = trace_used(loop, loop.init(), True, contacts=True)
        recorded = trace.recorded
        shown = [*_RECORDED, *(name for name in recorded if name.startswith("contacts."))]
        trace.recorded = {name: recorded[name] for name in shown if name in recorded}
        owners: dict[int, tuple[str, str]] = {}
        for side in self._arms:
            for name, arm in _arms_of(loop, side).items():
                for method, kernel in arm.kernels.items():
                    owners[id(kernel)] = (name, method)
        calls = []
        for call in trace.calls:
            kernel_name = call.kernel.name
            owner, method = owners.get(id(call.kernel), ("", kernel_name))
            if not owner and not kernel_name.startswith(("friction_", "contact")):
                raise BackendError(
                    f"{kernel_name}: the arm that it belongs to, and so its payload, is unknown"
                )
            calls.append((owner, method))
        return trace, Sample(layout(trace), calls)

    def kernels(self, sample: Sample) -> Iterator[Kernel]:
        """Yield the equations of motion of all places of the sliders."""
        for owner, method in dict.fromkeys(sample.calls):
            for arms in self._arms[_side(owner)] if owner else ():
                yield arms[owner].kernel(method)

    def variant(self, sample: Sample) -> Data:
        """Return what a page knows of it: its code, its numbers at first, and what its controls do."""
        tape = tape_of(self.loop, self._listed)
        matters = self._numbers_that_matter(sample, tape)
        changed = {name: self._changes(name) & matters for name in self.controls}
        moves = []
        still = set()  # controls that move nothing
        for name, flags in changed.items():
            if flags.any() and self._anywhere(name):
                moves.append(self._move(name, np.flatnonzero(flags).tolist()))
            if not flags.any() and not self.controls[name].arm:
                still.add(name)
        tables: list[Table] = []
        for half in (slice(0, self.shared), slice(self.shared, None)):
            for names, places in self._groups(changed, half):
                tables += self._tables(names, places, still)
        seeds = self._listed.values.seeds
        draws = []
        for of_loop, seed, stream, ahead in sample.layout.draws:
            value = seeds[seed] if of_loop else seed
            draws.append((str(value % 2**64), stream, ahead))
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

    def _numbers_that_matter(self, sample: Sample, tape: Tape | None) -> Array:
        """Return which numbers a page needs: what its code reads, and what its tape starts from."""
        matters = np.ones(len(self.first), dtype=bool)
        matters[: self.shared] = np.isin(np.arange(self.shared), sample.layout.shared)
        if tape is None:
            return matters
        # What is worked out of the tuning follows it, and the tuning matters where it is asked for.
        asked_for: set[int] = set()
        for operation, *operands in tape.steps:
            if operation in "+-*/":
                asked_for.update(operands)
        for step, (operation, *operands) in enumerate(tape.steps):
            if operation == "place" and step in asked_for:
                matters[operands[0]] = True
        for _, place in tape.outputs:
            matters[place] = False
        return matters

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
        ungrouped: dict[str, set[int]] = {}
        for name, flags in changed.items():
            if flags[half].any() and not self._anywhere(name):
                ungrouped[name] = set((half.start + np.flatnonzero(flags[half])).tolist())
        while ungrouped:
            name = next(iter(ungrouped))
            names, places = [name], ungrouped.pop(name)
            while touching := [name for name, others in ungrouped.items() if others & places]:
                names += touching
                for name in touching:
                    places |= ungrouped.pop(name)
            yield names, sorted(places)

    def _rows(self, moved: Mapping[str, Sequence[Any]]) -> Array:
        """Return the numbers of the loop at some places of controls, a row for each."""
        moved_parts = {self.controls[name].part for name in moved}
        parts = [part for part in PARTS if part in moved_parts]  # in their order: they have arrays in common
        ways = {way: places for way, places in self._ways.items() if way[0] in parts}
        # Forms have parts in common, and controllers that measure the same start alike.
        same_start = b""
        if parts == ["controller"]:
            same_start = self.first[self.shared :].tobytes()
            ways["start"] = slice(self.shared, None)
        base_parts = [id(getattr(self._base, part)) for part in parts]
        cache_key = (*moved, *base_parts, same_start)
        count = len(next(iter(moved.values())))
        numbers = np.tile(self.first, (count, 1))

        cached_rows = self.pool.rows.get(cache_key, {})
        if len(moved) == 1 and all(way in cached_rows for way in ways):
            for way, places in ways.items():
                numbers[:, places] = cached_rows[way]
            return numbers

        for rows in self._rows_of_one_loop(moved, count):
            listed = self._listing_at(moved, rows, parts)
            start = listed.start
            listed.arrays["start"] = start
            has_same_form = start.shape[1] == len(self.first) - self.shared
            if not has_same_form or not all(way in listed.arrays for way in ways):
                raise ArmgpiError(f"{', '.join(moved)}: changes the form of the loop")
            for way, places in ways.items():
                array = listed.arrays[way]
                numbers[rows, places] = array.reshape(-1, array.shape[-1]) if array.ndim > 1 else array
            numbers[rows, self.shared :] = start
        starts_alike = (numbers[:, self.shared :] == self.first[self.shared :]).all()
        if same_start or starts_alike:
            self.pool.rows[cache_key] = {way: numbers[:, places] for way, places in ways.items()}
        return numbers

    def _rows_of_one_loop(self, moved: Mapping[str, Sequence[Any]], count: int) -> list[list[int]]:
        """Return the places, by their numbers, that one loop can take as its rollouts.

        Loads and rotors have equations of motion of their own, and so a loop; springs are made anew.
        """
        rebuilding = [values for name, values in moved.items() if self._needs_a_loop(name)]
        groups: dict[str, list[int]] = {}
        for row in range(count):
            values_there = repr([values[row] for values in rebuilding])
            groups.setdefault(values_there, []).append(row)
        return list(groups.values())

    def _listing_at(self, moved: Mapping[str, Sequence[Any]], rows: list[int], parts: list[str]) -> Listing:
        """Return the numbers of some parts at places that one loop takes as its rollouts."""
        rebuilding = {}
        varying = {}
        for name, values in moved.items():
            if self._needs_a_loop(name):
                rebuilding[name] = values[rows[0]]
            else:
                varying[name] = [values[row] for row in rows]
        loop = self._loop(rebuilding) if rebuilding else self._base
        movable_numbers = {name: varying.pop(name) for name in (SCALE, BITS) if name in varying}
        if varying:
            checked = check_values(variables(loop), dict(self._door(loop, varying)))
            loop = with_values(loop, spread_rows(checked, len(rows)), len(rows))
        return Listing(movable(loop, movable_numbers), parts)

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
        move = Move(name, at=[], joint=[], factor=[], constant=[])
        for place in places:
            probes = [(np.ravel(value), row[place]) for value, row in zip(values, rows, strict=True)]
            way = _way(probes, constants)
            if way is None:
                raise ArmgpiError(f"{name}: moves a number that is neither its value nor that less another")
            move.at.append(place)
            move.joint.append(way.joint)
            move.factor.append(way.factor)
            move.constant.append(way.constant)
        return move

    def _tables(self, names: list[str], places: list[int], still: set[str]) -> Iterator[Table]:
        """Yield tables of the numbers that some controls move together; who finds no room in one stays."""
        # Of a scaled nominal model and one with a load there is one at a time; see Control.excludes.
        pairs = []
        for name in names:
            excluded = self.controls[name].excludes
            if excluded in names:
                pairs.append((name, excluded))

        def number_of_places(name: str) -> int:
            return len(self.controls[name].values)

        for unless in pairs or ((),):
            group = [name for name in names if name not in unless[1:]]
            while len(group) > 1 and math.prod(map(number_of_places, group)) > _MOST:
                # The start of an arm with a state of its own depends on more than a table can hold.
                longest = max(group, key=number_of_places)
                group.remove(longest)
                still.add(longest)
            axes = [self.controls[name].values for name in group]
            rows = self._probed[group[0]]
            if len(group) > 1:
                values_at_places = zip(*itertools.product(*axes), strict=True)
                rows = self._rows(dict(zip(group, values_at_places, strict=True)))
            yield Table(tuple(group), places, rows[:, places], unless)

    def _list_arms(self, side: str) -> list[dict[str, Arm]]:
        """Return the arms of the plant or of the controller, at all places of what changes them."""
        names = [name for name, control in self.controls.items() if control.arm == side]
        section = self.config["controllers"]
        if side == "plant":
            section = {**self.config["plant"], "friction": None}
        key = repr([side, names, self.config["robot"], section])
        if key not in self.pool.arms:
            axes = [self.controls[name].values for name in names]
            arms = []
            for values in itertools.product(*axes):
                loop = self._loop(dict(zip(names, values, strict=True)))
                arms.append(_arms_of(loop, side))
            self.pool.arms[key] = arms
        return self.pool.arms[key]

    def _kernels(self, sample: Sample) -> Iterator[Table]:
        """Yield which kernels the calls are of: those of arms that controls change, and others."""
        kernel_index = self.pool.names.index
        sides: dict[str, list[dict[str, Arm]]] = {**self._arms, "": [{}]}
        for side, arms in sides.items():
            calls = {i: call for i, call in enumerate(sample.calls) if _side(call[0]) == side}
            names: tuple[str, ...] = ()
            if side:
                names = tuple(name for name, control in self.controls.items() if control.arm == side)
            kernels_at_places = []
            for arm in arms:
                kernels = []
                for owner, method in calls.values():
                    name = f"{method}_{arm[owner].model.digest}" if owner else method
                    kernels.append(kernel_index(name))
                kernels_at_places.append(kernels)
            yield Table(names, list(calls), np.array(kernels_at_places, dtype=np.float64))


def _side(owner: str) -> str:
    """Return the part whose arm it is, empty for none."""
    return owner if owner in ("plant", "") else "controller"


def _arms_of(loop: ClosedLoop, side: str) -> dict[str, Arm]:
    """Return the arm of the plant, or those that the controller has by their names there."""
    robots: dict[str, Any] = {"plant": loop.plant.robot}
    if side != "plant":
        robots = {name: part for name, part in vars(loop.controller).items() if isinstance(part, Robot)}
    arms = {}
    for name, robot in robots.items():
        dynamics = robot.dynamics
        arms[name] = arm_of(getattr(dynamics, "base", dynamics))
    return arms


class _Way(NamedTuple):
    """How a number follows a value: factor times that of a joint (-1: of all alike), plus a constant."""

    joint: int
    factor: float
    constant: float


def _way(probes: list[tuple[Array, float]], constants: list[float]) -> _Way | None:
    """Return how a number follows a value; None where it does not.

    Args:
        probes: values of a control, one for each joint or one for all, each with the number there.
        constants: what may be added or taken away, the first that fits.
    """
    count = len(probes[0][0])
    signed_constants = [signed for constant in constants for signed in (constant, -constant)]
    for joint, factor, constant in itertools.product(range(count), (1.0, -1.0), signed_constants):
        if all(factor * value[joint] + constant == number for value, number in probes):
            return _Way(joint if count > 1 else -1, factor, constant)
    return None
