"""How every control reaches the numbers of one form of the loop.

Each control is moved while all else stays, and what changes among the loop's numbers is looked at. A number
that is the value itself, or the value less a constant, is found as such; any other goes into a table over the
slider's places. What the state at the start depends on by several controls together becomes one table over
all of them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import Array
from armgpi.codegen.kernels import Arm, Kernel, arm_of
from armgpi.codegen.source import recorded_names, trace_used
from armgpi.codegen.trace import Seed, Trace, columns, tracing
from armgpi.errors import ArmgpiError, BackendError
from armgpi.gpi.gains import Tuning
from armgpi.loop.closed_loop import ClosedLoop
from armgpi.robot.robot import Robot
from armgpi.view.play.controls import Control
from armgpi.view.play.loops import EXACT, Numbers, Tape, movable, numbers

#: What a page records, if there is such a thing.
_RECORDED = ("q", "v", "q_ref", "v_ref", "q_measured", "tau_command", "tau", Tuning._fields[0])
#: Most entries of a table over several controls.
_MOST = 6000

#: Makes the loop of an experiment as plain data.
Make = Callable[[dict[str, Any]], ClosedLoop]


class Move(NamedTuple):
    """Numbers that follow one control.

    Attributes:
        control: its id.
        to: "shared" or "start".
        at: places of the numbers.
        joint: of each, the joint whose value it follows; -1 where all joints have one.
        factor: of each, 1 or -1.
        constant: of each, what is added to factor times the value.
    """

    control: str
    to: str
    at: list[int]
    joint: list[int]
    factor: list[float]
    constant: list[float]


class Table(NamedTuple):
    """Numbers that depend on controls by a table over the places of their sliders.

    Attributes:
        controls: their ids.
        to: "shared" or "start".
        at: places of the numbers.
        values: shape (places of the first control, ..., numbers).
    """

    controls: tuple[str, ...]
    to: str
    at: list[int]
    values: Array


class Kernels(NamedTuple):
    """Equations of motion that depend on controls.

    Attributes:
        controls: their ids.
        calls: which calls of the sample use them.
        which: shape (places of the first control, ..., calls): indices of kernels.
    """

    controls: tuple[str, ...]
    calls: list[int]
    which: Any


class Variant(NamedTuple):
    """One form of the loop.

    Attributes:
        form: id of a choice -> its value.
        trace: one sample of it.
        names: what is recorded.
        shared: the numbers of the loop at first, all of them.
        used: places of those that the sample uses.
        tape: how some are worked out of others; None where none are.
        start: those of its state.
        draws: random numbers: seed, stream and samples ahead of each.
        moves: numbers that follow one control.
        tables: numbers that depend on controls in another way.
        arms: equations of motion that depend on controls.
        unmoved: ids of controls that change nothing here.
    """

    form: dict[str, Any]
    trace: Trace
    names: list[str]
    shared: Array
    used: list[int]
    tape: Tape | None
    start: Array
    draws: list[tuple[int, int, int]]
    moves: list[Move]
    tables: list[Table]
    arms: list[Kernels]
    unmoved: list[str]


class Pool:
    """All kernels of a page, each once.

    Attributes:
        kernels: in the order of their indices.
        tables: by what they depend on; friction is none of it for states at the start.
    """

    def __init__(self) -> None:
        """Begin without kernels."""
        self.kernels: list[Kernel] = []
        self.tables: dict[str, Table] = {}
        self._places: dict[str, int] = {}

    def place(self, kernel: Kernel) -> int:
        """Return the index of a kernel."""
        if kernel.name not in self._places:
            self._places[kernel.name] = len(self.kernels)
            self.kernels.append(kernel)
        return self._places[kernel.name]

    def place_of(self, arm: Arm, method: str) -> int:
        """Return the index of a kernel of an arm, which is made where no equal arm's is there yet."""
        index = self._places.get(f"{method}_{arm.model.digest}")
        return self.place(arm.kernel(method)) if index is None else index


def trace_form(
    form: dict[str, Any], config: dict[str, Any], controls: Sequence[Control], make: Make, pool: Pool
) -> Variant:
    """Return a form of the loop with all that its controls do.

    Args:
        form: id of a choice -> its value.
        config: an experiment of this form, as plain data.
        controls: those that it has.
        make: makes the loop.
        pool: where kernels go.
    """
    return _Prober(form, config, controls, make, pool).variant()


class _Prober:
    """Moves controls and looks at numbers."""

    def __init__(
        self,
        form: dict[str, Any],
        config: dict[str, Any],
        controls: Sequence[Control],
        make: Make,
        pool: Pool,
    ) -> None:
        self.form, self.config, self.make, self.pool = form, config, make, pool
        self.controls = {control.id: control for control in controls}
        self.loop = self._loop({})
        with tracing():
            self.trace = trace_used(self.loop, self.loop.init(), True)
        recorded = self.trace.recorded
        self.trace.recorded = {name: recorded[name] for name in _RECORDED if name in recorded}
        self.first = first = numbers(self.loop)
        self.used = list(self.trace.places[0])
        self._known: dict[str, Numbers] = {}
        self._matters = {
            "shared": np.isin(np.arange(len(first.shared)), self.used),
            "start": np.ones(len(first.start), dtype=bool),
        }
        if first.tape is not None:
            # What is worked out of the tuning follows it, and the tuning matters where it is asked for.
            asked = {place for _, *operands in first.tape.steps for place in operands}
            for i, place in enumerate(first.tape.inputs):
                self._matters["shared"][place] |= i in asked
            for _, place in first.tape.outputs:
                self._matters["shared"][place] = False

    def variant(self) -> Variant:
        """Return what was found."""
        moves: list[Move] = []
        tables: list[Table] = []
        unmoved, together = [], []
        arms = self._arms()
        for name, control in self.controls.items():
            changed = self._changed_numbers(control)
            if not control.arm and not any(changed.values()):
                unmoved.append(name)
            if rest := self._moves(control, "shared", changed["shared"], moves):
                tables.append(self._table((name,), "shared", rest))
            if self._moves(control, "start", changed["start"], moves):
                together.append(name)
        # Of a scaled nominal model and one with a load there is one at a time; see Control.excludes.
        apart = [name for name in together if self.controls[name].excludes in together]
        common = [name for name in together if name not in apart]
        for group in [[*common, name] for name in apart] or ([common] if common else []):
            while self._entries(group) > _MOST:
                # The start of an arm with a state of its own depends on more than a table can hold.
                group.remove(most := max(group, key=lambda name: len(self.controls[name].values)))
                unmoved += [most] if most not in unmoved else []
            changes = (self._changed_numbers(self.controls[name])["start"] for name in group)
            places = sorted(set(itertools.chain(*changes)))
            same = {key: value for key, value in self.form.items() if key != "plant.friction"}
            key = repr((same, group, places))
            if key not in self.pool.tables:
                self.pool.tables[key] = self._table(tuple(group), "start", places)
            tables.append(self.pool.tables[key])
        return Variant(
            form=self.form,
            trace=self.trace,
            names=recorded_names(self.trace),
            shared=self.first.shared,
            used=self.used,
            tape=self.first.tape,
            start=self.first.start,
            draws=list(self._draws()),
            moves=moves,
            tables=tables,
            arms=arms,
            unmoved=unmoved,
        )

    def _draws(self) -> Iterator[tuple[int, int, int]]:
        """Yield seed, stream and samples ahead of the random numbers."""
        for draw in self.trace.draws:
            seed = self.first.seeds[draw.seed.place] if isinstance(draw.seed, Seed) else draw.seed
            yield seed % 2**64, draw.stream, draw.offset

    def _loop(self, moved: Mapping[str, Any]) -> ClosedLoop:
        """Return the loop with some controls moved."""
        config = _copy_data(self.config)
        for name, value in moved.items():
            self.controls[name].put(config, value)
        return movable(self.make(config))

    def _numbers(self, moved: Mapping[str, Any]) -> Numbers:
        """Return the numbers of the loop with some controls moved."""
        key = repr(sorted(moved.items()))
        if key not in self._known:
            found = numbers(self._loop(moved), tape=False)
            if len(found.shared) != len(self.first.shared) or found.start.shape != self.first.start.shape:
                raise ArmgpiError(f"{', '.join(moved)}: changes the form of the loop")
            self._known[key] = found
        return self._known[key]

    def _changed_numbers(self, control: Control) -> dict[str, list[int]]:
        """Return which numbers a control changes."""
        changed = {to: np.zeros_like(flags) for to, flags in self._matters.items()}
        for value in self._probes(control):
            found = self._numbers({control.id: value})
            for to, flags in changed.items():
                flags |= getattr(found, to) != getattr(self.first, to)
        return {to: np.flatnonzero(flags & self._matters[to]).tolist() for to, flags in changed.items()}

    def _probes(self, control: Control) -> list[Any]:
        """Return values by which to see what a control does."""
        if control.joints:
            low, high = np.clip(np.array(control.joints), -7.3, 7.1).T
            shares = np.linspace(0.31, 0.47, len(low))
            return [(low + share * (high - low)).tolist() for share in (shares, 1.0 - shares)]
        values = [value for value in control.values if value is not None]
        if control.excludes or control.id == "plant.encoder_bits":  # whose nearest places may round alike
            return values
        # Near what it is at first: an upper end must stay above the lower one.
        stop = next((i for i, value in enumerate(values) if value == control.value), 0)
        steps = (1, 2, 3) if stop + 3 < len(values) else (-1, -2, -3)
        return [values[stop + step] for step in steps if -len(values) <= stop + step < len(values)]

    def _moves(self, control: Control, to: str, places: list[int], moves: list[Move]) -> list[int]:
        """Note the numbers that are a control's value but for a constant; return the others."""
        if not places:
            return []
        probes = [(value, getattr(self._numbers({control.id: value}), to)) for value in self._probes(control)]
        found, rest = Move(control.id, to, [], [], [], []), []
        for place in places:
            if (way := _way([(np.ravel(v), x[place]) for v, x in probes], self._constants())) is None:
                rest.append(place)
                continue
            lists: Any = (found.at, found.joint, found.factor, found.constant)
            for entries, value in zip(lists, (place, *way), strict=True):
                entries.append(value)
        if found.at:
            moves.append(found)
        return rest

    def _constants(self) -> list[float]:
        """Return what may be added to a value: coordinates of the moves."""
        points = self.config["reference"]["points"] or []
        return [0.0, *sorted({float(x) for point in points for x in point})]

    def _table(self, names: tuple[str, ...], to: str, places: Sequence[int]) -> Table:
        """Return numbers at all places of the sliders of some controls."""
        axes = [self.controls[name].values for name in names]
        if not all(axes) or self._entries(names) > _MOST:
            raise ArmgpiError(f"{' and '.join(names)}: too many values together for a page")
        key = ""
        if to == "shared":
            # One that is the same at both ends and at the probes is the same: another form has made it.
            probes = axes[0][0], axes[0][-1], *self._probes(self.controls[names[0]])
            asked = [{names[0]: value} for value in probes]
            key = repr([(each, self._numbers_at(each, to)[list(places)].tolist()) for each in asked])
            if key in self.pool.tables:
                return self.pool.tables[key]._replace(at=list(places))
        rows = [
            self._numbers_at(dict(zip(names, values, strict=True)), to)[list(places)]
            for values in itertools.product(*axes)
        ]
        table = Table(names, to, list(places), np.array(rows).reshape(*map(len, axes), len(places)))
        if key:
            self.pool.tables[key] = table
        return table

    def _entries(self, names: Sequence[str]) -> int:
        """Return how many values some controls have together."""
        return math.prod(len(self.controls[name].values) for name in names)

    def _numbers_at(self, moved: Mapping[str, Any], to: str) -> Array:
        """Return numbers, of encoders that are exact too."""
        exact = "plant.encoder_bits" in moved and moved["plant.encoder_bits"] is None
        if to == "start":
            return self._loop_start(moved)
        moved = {**moved, "plant.encoder_bits": 16} if exact else moved
        found: Array = getattr(self._numbers(moved), to).copy()
        if exact:
            found[self._changed_numbers(self.controls["plant.encoder_bits"])[to]] = EXACT
        return found

    def _loop_start(self, moved: Mapping[str, Any]) -> Array:
        """Return the numbers of the state at the start alone."""
        return columns(self._loop(moved).init()[1:], ())[:, 0]

    def _arms(self) -> list[Kernels]:
        """Return the equations of motion that controls change."""
        controls = {
            side: tuple(name for name, control in self.controls.items() if control.arm == side)
            for side in ("plant", "nominal")
        }
        traced = self.trace.calls
        loop = self.loop
        if controls["nominal"]:
            # What a load makes two models of has one without: which call is whose a trace with a load tells.
            loop = self._loop({name: self.controls[name].values[-1] for name in controls["nominal"]})
            with tracing():
                traced = trace_used(loop, loop.init(), True).calls
        owners = {
            id(kernel): (name, method)
            for name, arm in _arms_of(loop).items()
            for method, kernel in arm.kernels.items()
        }
        calls: dict[str, dict[int, tuple[str, str]]] = {"plant": {}, "nominal": {}}
        fixed = {}
        for i, call in enumerate(traced):
            if (owner := owners.get(id(call.kernel))) is not None:
                calls["plant" if owner[0] == "plant" else "nominal"][i] = owner
            elif controls["nominal"] and not call.kernel.name.startswith("friction_"):
                raise BackendError(f"{call.kernel.name}: whose arm it is of, and so its load, is not known")
            else:
                fixed[i] = self.pool.place(call.kernel)
        found = [Kernels((), list(fixed), np.array(list(fixed.values()), dtype=int))]
        for side, own in calls.items():
            names = controls[side]
            axes = [self.controls[name].values for name in names]
            which = []
            for values in itertools.product(*axes):
                arms = _arms_of(self._loop(dict(zip(names, values, strict=True))))
                which.append([self.pool.place_of(arms[name], method) for name, method in own.values()])
            found.append(Kernels(names, list(own), np.array(which).reshape(*map(len, axes), len(own))))
        return found


def _arms_of(loop: ClosedLoop) -> dict[str, Arm]:
    """Return the arms of a loop: the plant's, and those that its controller has by their names there."""
    robots = {name: part for name, part in vars(loop.controller).items() if isinstance(part, Robot)}
    arms = {name: robot.dynamics for name, robot in {**robots, "plant": loop.plant.robot}.items()}
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


def _copy_data(config: Any) -> Any:
    """Return a copy of plain data."""
    if isinstance(config, dict):
        return {key: _copy_data(value) for key, value in config.items()}
    return [_copy_data(value) for value in config] if isinstance(config, list) else config
