"""A controller's law as expressions: its own `init` and `step`, called once with symbols."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.codegen.algebra import ca
from armgpi.codegen.kernels import Call
from armgpi.codegen.state import children, flatten, join, leaves_like, numbers, unflatten
from armgpi.codegen.symbols import NotElementwise, Symbols, flat
from armgpi.codegen.trace import Trace, Tracer, state_part, tracing
from armgpi.control.controller import Controller, FullState, Measurement
from armgpi.errors import ParameterError
from armgpi.loop.log import INPUTS
from armgpi.references.reference import Target
from armgpi.robot.robot import Robot
from armgpi.supervisor import Supervised

#: Words of C99, and names that the templates use: none may be that of an array of the controller.
_RESERVED = frozenset(
    re.findall(
        r"\w+",
        """
        auto break case char const continue default do double else enum extern float for goto if inline int
        long register restrict return short signed sizeof static struct switch typedef union unsigned void
        volatile while status reason fault_joint layout MISSED COUNTED JOINT_NAMES REAL_MAX NAN INFINITY
        HUGE_VAL EOF NULL
        """,
    )
)


class Table(NamedTuple):
    """A constant array of the controller, or a part of its state.

    Attributes:
        name: its name in C.
        path: where it is in Python.
        shape: its shape, () for a number.
        symbols: the symbols of its entries.
        values: its entries; of a part of the state, none.
    """

    name: str
    path: str
    shape: tuple[int, ...]
    symbols: list[Any]
    values: list[float]


class Routine(NamedTuple):
    """What one function of the law works out.

    Attributes:
        calls: its uses of the dynamics, in order.
        outputs: expressions: of the torque (of `step`), then of the state.
    """

    calls: list[Call]
    outputs: list[Any]


class Law(NamedTuple):
    """A controller as expressions.

    Attributes:
        controller: the controller under its supervisor.
        inputs: name -> n symbols, for what it is given of :data:`INPUTS`.
        tables: its constants.
        state: the parts of its state.
        init: works out the state before the first sample.
        step: works out torque and next state.
        user_defined: whether there are laws among it that do not come with armgpi.
        first: the state of a controller at rest: an example of it.
        whole: paths of the parts of its state that are whole numbers, an int in Python.
    """

    controller: Supervised
    inputs: dict[str, list[Any]]
    tables: list[Table]
    state: list[Table]
    init: Routine
    step: Routine
    user_defined: bool
    first: Any
    whole: list[str]

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.controller.robot.n


def trace_controller(controller: Supervised) -> Law:
    """Return a controller's law as expressions.

    Raises:
        ParameterError: when it is not a controller for a single rollout.
        NotElementwise: when it does what has no C.
    """
    if controller.batch is not None or not isinstance(controller.robot, Robot):
        size = "several" if controller.batch is None else controller.batch
        raise ParameterError(
            "controller", controller, f"for a single rollout; this one has parameters for {size} of them"
        )
    trace = Trace(controller.robot.n)
    with tracing():
        tracer = _ControllerTracer(trace, controller)
        with tracer.undo_writes():
            return _trace_law(controller, trace, tracer)


def _trace_law(controller: Supervised, trace: Trace, tracer: _ControllerTracer) -> Law:
    """Call `init` and `step` with symbols."""
    n = controller.robot.n
    law: Any = tracer(controller)
    # All of them, whatever the law uses: what it does not is no argument in C.
    inputs: dict[str, Any] = {name: Symbols.new(name, (n,)) for name in INPUTS}
    target = Target(inputs["q_ref"], inputs["v_ref"], inputs["a_ref"])
    measures_velocity = controller.measurement_type is FullState
    measured: Any = Measurement(inputs["q_measured"])
    if measures_velocity:
        measured = FullState(inputs["q_measured"], inputs["v_measured"])

    def take_calls() -> list[Call]:
        """Return the calls so far and forget them."""
        calls = trace.calls[:]
        del trace.calls[:]
        return calls

    # The form of the state comes from numbers: symbols do not say what is a constant of the law.
    middle = np.ascontiguousarray(controller.robot.middle())
    rest = np.zeros(n)
    seen: Any = FullState(middle, rest) if measures_velocity else Measurement(middle)
    first = controller.init(seen, Target(middle, rest, rest))
    state = numbers(first)
    started = _match_state(law.init(measured, target), first)
    init = Routine(take_calls(), started)

    parts: list[Table] = []
    given: list[Symbols] = []
    names = _Names()
    for path, value in state:
        shape = np.shape(value)
        symbols = Symbols.new(f"s{len(parts)}", shape)
        given.append(symbols)
        parts.append(Table(names(_short(path), str.lower), path, shape, flat(symbols), []))
    tau, after = law.step(measured, target, unflatten(first, given))
    step = Routine([], [*flat(np.broadcast_to(tau, (n,))), *_match_state(after, first)])
    step.calls.extend(take_calls())

    # What no step reads is not kept: C takes no shorter way, and so need not know whether it might.
    read = _used(step)
    keep = [any(x.element_hash() in read for x in part.symbols) for part in parts]
    entries = [kept for kept, part in zip(keep, parts, strict=True) for _ in part.symbols]
    init.outputs[:] = [x for x, kept in zip(init.outputs, entries, strict=True) if kept]
    step.outputs[n:] = [x for x, kept in zip(step.outputs[n:], entries, strict=True) if kept]
    state = [leaf for leaf, kept in zip(state, keep, strict=True) if kept]
    parts = [part for part, kept in zip(parts, keep, strict=True) if kept]

    arguments = {name: flat(x) for name, x in inputs.items()}
    used = _used(init, step)
    # The supervision needs positions and their reference, used by the law or not.
    wanted = {"q_measured", "q_ref", *(("v_measured",) if measures_velocity else ())}
    kept = {
        name: row
        for name, row in arguments.items()
        if name in wanted or used & {x.element_hash() for x in row}
    }
    tables = [table for table in tracer.tables if used & {x.element_hash() for x in table.symbols}]
    whole = [part.path for part, (_, value) in zip(parts, state, strict=True) if isinstance(value, int)]
    return Law(controller, kept, tables, parts, init, step, trace.user_defined, first, whole)


class _ControllerTracer(Tracer):
    """Notes under which name each array of a controller is known."""

    def __init__(self, trace: Trace, controller: Controller) -> None:
        """Look for arrays in a controller."""
        super().__init__(trace, 1)
        self.tables: list[Table] = []
        # Found before anything is traced: a tracer has values, not where they are kept.
        self._paths: dict[int, str] = {}
        self._find(controller, "", set())
        self._names = _Names()

    def array(self, values: Array) -> Any:
        """Return symbols for an array of numbers."""
        if values.ndim > 2 and values.dtype == np.float64:
            return values  # placements of a frame, which are part of the code
        if values.ndim > 1 and values.dtype == np.float64:
            raise NotElementwise(f"it has an array of shape {values.shape}, not one number per joint")
        symbols = super().array(values)
        if isinstance(symbols, Symbols):
            # The one array that is made on the way is the factor of a robot with scaled inertia.
            path = self._paths.get(id(values), "inertia_scale")
            entries = [float(x) for x in np.ravel(values)]
            self.tables.append(
                Table(self._names(_short(path), str.upper), path, values.shape, flat(symbols), entries)
            )
        return symbols

    def _find(self, value: Any, path: str, seen: set[int]) -> None:
        """Note the paths of all arrays below a value, the first one that leads to each."""
        if isinstance(value, np.ndarray):
            self._paths.setdefault(id(value), path)
            return
        if id(value) in seen or isinstance(value, str | bytes | Robot | type):
            return
        seen.add(id(value))
        if isinstance(value, tuple):
            items: Iterator[tuple[Any, Any]] = children(value)
        elif isinstance(value, list):
            items = enumerate(value)
        elif isinstance(value, dict):
            items = iter(value.items())
        else:
            items = iter(getattr(value, "__dict__", {}).items())
        for key, item in items:
            self._find(item, join(path, str(key)), seen)


def _short(path: str) -> str:
    """Return a path without the supervisor around the law; a state that is one array has a name as well."""
    return "value" if path == "law" else path.removeprefix("law.")


class _Names:
    """Makes C names of Python paths, each but once."""

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def __call__(self, path: str, case: Callable[[str], str]) -> str:
        """Return a new C name for a path of attributes, another one each time that it is called.

        Args:
            path: such as `law.filter._gain`.
            case: what writes a name in capitals or small letters.
        """
        steps = [step.strip("_") for step in path.split(".")]
        name = case(re.sub(r"\W", "_", "_".join(step for step in steps if step), flags=re.ASCII))
        if not name[:1].isalpha() or name in _RESERVED:
            name = case(f"law_{name}")
        unique, count = name, 2
        while unique in self._taken:
            unique, count = f"{name}_{count}", count + 1
        self._taken.add(unique)
        return unique


def _match_state(state: Any, like: Any) -> list[Any]:
    """Return the expressions of a state, which must have the parts of another."""
    found = zip(leaves_like(state, like), flatten(like), strict=True)
    return [x for part, leaf in found for x in flat(state_part(part, np.shape(leaf.value)))]


def _used(*routines: Routine) -> set[int]:
    """Return the hashes of the symbols that routines use."""
    expressions = [
        x
        for routine in routines
        for x in (*routine.outputs, *(a for call in routine.calls for a in call.arguments))
    ]
    return {symbol.element_hash() for symbol in ca.symvar(ca.SX(ca.vertcat(*expressions)))}
