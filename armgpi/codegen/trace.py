"""A closed loop traced: one sample of it as expressions, from the functions that NumPy runs.

The loop's parts are copied, with symbols in place of their arrays: the state, the parameters (an array
(n,) is shared by all rollouts, one of (batch, n) has a row for each), the target and the time. Then one
sample is taken.
"""

from __future__ import annotations

import contextlib
import copy
import traceback
import types
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import parameters
from armgpi.codegen.algebra import ca
from armgpi.codegen.effects import SideEffects
from armgpi.codegen.kernels import (
    Arm,
    Call,
    TracedDynamics,
    TracedEnvironment,
    TracedFriction,
    TracedTool,
    arm_of,
)
from armgpi.codegen.state import flatten, leaves_like, numbers, unflatten
from armgpi.codegen.symbols import NotElementwise, Scalar, Symbols, flat, is_bool
from armgpi.control.controller import ControlStep
from armgpi.errors import BackendError
from armgpi.gpi.splines import BSplineBasis
from armgpi.gpi.weights import Weights
from armgpi.loop.running import TOTALS, Running
from armgpi.loop.tool import Tool
from armgpi.plants.arm import LoadTable
from armgpi.plants.environment import Environment
from armgpi.plants.friction import ImplicitFriction
from armgpi.plants.loads import Load
from armgpi.plants.plant import inside
from armgpi.references.reference import Reference, Target
from armgpi.robot.batch import AnyRobot, RobotBatch
from armgpi.robot.dynamics import Dynamics, ScaledDynamics
from armgpi.robot.robot import Robot
from armgpi.supervisor import Supervised

#: What is taken as it is: it does not change.
_PLAIN = (
    *(str, bytes, int, float, complex, type(None), type, range, slice, frozenset, Enum, np.generic, np.ufunc),
    *(np.dtype, types.FunctionType, types.BuiltinFunctionType, types.ModuleType),
)
#: The same, what takes symbols as it takes numbers, and what the networks keep in arrays of joints as well.
_AS_IT_IS = (BSplineBasis, Weights, Arm, *_PLAIN)
#: Folders of what generates code: no place in a user's law.
_GENERATORS = tuple(
    str(Path(__file__).parents[1] / name) for name in ("codegen", "hardware/export", "view/play")
)
#: References of more operations than this are worked out by NumPy, as a table: compilers take long over them,
#: and where rollouts share a reference every lane would work out the same.
_LONG_REFERENCE = 3000
#: What a robot's dynamics can do, by which they are known: users may bring their own.
_DYNAMICS = ("forward", "inertia_times", "nonlinear_effects")


class Draws(NamedTuple):
    """Random numbers, uniform in (0, 1), that one sample uses: one for every joint.

    Attributes:
        seed: the seed, or its place among those of the run.
        stream: which of several independent sets of numbers.
        offset: samples ahead of the one now.
        symbols: the symbols of these numbers.
    """

    seed: int | Seed
    stream: int
    offset: int
    symbols: list[Any]


class Seed(NamedTuple):
    """A seed that a part declares: a number of the run, as others are.

    Attributes:
        place: which of the run's.
    """

    place: int


class Counter(Scalar):
    """The number of samples taken, plus a whole number; it can draw random numbers.

    Attributes:
        offset: the whole number.
    """

    __slots__ = ("draws", "offset", "symbol")

    def __init__(self, symbol: Any, offset: int, draws: list[Draws]) -> None:
        """Count from a symbol on."""
        super().__init__(symbol + offset)
        self.symbol, self.offset, self.draws = symbol, offset, draws

    def __add__(self, other: Any) -> Any:
        """Return a later sample's number, or a sum."""
        if isinstance(other, int):
            return Counter(self.symbol, self.offset + other, self.draws)
        return Scalar(self.sx) + other

    def uniform(self, seed: int | Seed, shape: tuple[int, ...], stream: int) -> Symbols:
        """Return symbols of random numbers; see :func:`armgpi.plants.noise.uniform`."""
        # What is asked for twice is drawn once.
        for known in self.draws:
            same = (known.seed, known.stream, known.offset) == (seed, stream, self.offset)
            if same and len(known.symbols) == shape[-1]:
                return Symbols(np.array([Scalar(s) for s in known.symbols], dtype=object))
        drawn = Symbols.new(f"u{len(self.draws)}", shape)
        self.draws.append(Draws(seed, stream, self.offset, flat(drawn)))
        return drawn


@dataclass
class Values:
    """The numbers that a run puts in for the symbols of a trace.

    Loops that differ in these alone have one trace and the same C.

    Attributes:
        start: of the state at the start, shape (s, rollouts); (s, 1) for a single one.
        shared: of parameters that all rollouts share.
        own: of those that each rollout has its own of, each of shape (rollouts,) or (1,).
        seeds: of random numbers: that of rollout 0, or those of all rollouts (rollouts,).
    """

    start: Array = field(default_factory=lambda: np.empty((0, 0)))
    shared: list[float] = field(default_factory=list)
    own: list[Array] = field(default_factory=list)
    seeds: list[Any] = field(default_factory=list)


@dataclass
class Trace:
    """One sample of a closed loop as expressions.

    Attributes:
        n: number of joints.
        state: symbols of the state.
        after: expressions of the state after the sample.
        joints: the joint that each part of the state belongs to.
        calls: uses of the dynamics, in order.
        shared: symbols of parameters that all rollouts share.
        own: symbols of those that each rollout has its own of.
        values: the numbers of state and parameters.
        table: symbols of what a table gives for every sample.
        draws: random numbers used.
        k: symbol of the sample's number.
        recorded: name -> n expressions.
        user_defined: whether there are laws among it that do not come with armgpi.
        sums: symbols of what is added up over the samples, where that is all that a run keeps.
        seen: name -> n symbols of what is added to them.
        summed: expressions of the sums after a sample.
        early: expressions of them before the last seconds; a symbol of `sums` where nothing changes.
        summed_calls: uses of kernels in `summed`, in order.
        early_calls: those in `early`.
        places: of the parameters, shared and own, among all that the loop has.
        usual: the same sample where its controller's usual step will do; see :meth:`Supervised.usual`.
        holds: of that one: all that has to hold before it is taken, and all after it.
    """

    n: int
    state: list[Any] = field(default_factory=list)
    after: list[Any] = field(default_factory=list)
    joints: list[int] = field(default_factory=list)
    calls: list[Call] = field(default_factory=list)
    shared: list[Any] = field(default_factory=list)
    own: list[Any] = field(default_factory=list)
    values: Values = field(default_factory=Values)
    table: list[Any] = field(default_factory=list)
    draws: list[Draws] = field(default_factory=list)
    k: Any = None
    recorded: dict[str, list[Any]] = field(default_factory=dict)
    user_defined: bool = False
    sums: list[Any] = field(default_factory=list)
    seen: dict[str, list[Any]] = field(default_factory=dict)
    summed: list[Any] = field(default_factory=list)
    early: list[Any] = field(default_factory=list)
    summed_calls: list[Call] = field(default_factory=list)
    early_calls: list[Call] = field(default_factory=list)
    places: tuple[list[int], list[int]] = ([], [])
    usual: Trace | None = None
    holds: list[list[Any]] = field(default_factory=list)


class Tracer:
    """Copies objects with symbols in place of their arrays.

    One copy is made of each object, so that what was one thing still is. Robots keep their numbers, but for
    those that differ between rollouts, and get traced dynamics.

    Attributes:
        trace: where symbols, values and calls are noted.
        declared: whether numbers that a class declares, and that may vary by rollout, become symbols as well.
        anew: whether those of a part that was given other values do, where they are no arrays.
        place: names of attributes, keys and places that lead to what is looked at.
    """

    declared = False
    anew = True
    place: tuple[Any, ...] = ()

    def __init__(self, trace: Trace, rollouts: int) -> None:
        """Note symbols, values and calls in `trace`, of a loop of so many rollouts."""
        self.trace = trace
        self._rollouts = rollouts
        self._copies: dict[int, Any] = {}
        self._kept: list[tuple[Any, Any, Any]] = []  # what ids in _copies belong to, copies and their content
        self._parameters: dict[int, list[Any]] = {}  # symbols of what differs between arms
        self._side_effects = SideEffects()

    def __call__(self, value: Any, numbers: bool = False) -> Any:
        """Return the copy of a value; with `numbers`, floats become symbols as well."""
        if id(value) in self._copies:
            return self._copies[id(value)]
        if isinstance(value, np.ndarray):
            return self._note(value, self.array(value))
        if numbers and isinstance(value, float):
            return self.array(np.array(value))
        if isinstance(value, _AS_IT_IS):
            return self._plain(value)
        if isinstance(value, tuple | list | dict):
            return self._note(value, self._container(value, numbers))
        return self._part(value, numbers)

    def _plain(self, value: Any) -> Any:
        """Return what does not change as it is."""
        self._side_effects.watch(value)
        return value

    def _below(self, step: Any, value: Any, numbers: bool) -> Any:
        """Return the copy of what is a step further."""
        before, self.place = self.place, (*self.place, step)
        made = self(value, numbers)
        self.place = before
        return made

    def _container(self, value: Any, numbers: bool) -> Any:
        """Return a container of copies."""
        if isinstance(value, dict):
            return {key: self._below(key, item, numbers) for key, item in value.items()}
        items = [self._below(i, item, numbers) for i, item in enumerate(value)]
        return items if isinstance(value, list) else tuple.__new__(type(value), items)

    def _part(self, value: Any, numbers: bool) -> Any:
        """Return the copy of a robot, a method, dynamics, or of an object that is its attributes."""
        if isinstance(value, Robot | RobotBatch):
            return self._robot(value)
        if isinstance(value, types.MethodType):
            self._side_effects.watch(value.__func__)
            return types.MethodType(value.__func__, self(value.__self__, numbers))
        if all(callable(getattr(value, name, None)) for name in _DYNAMICS):
            return self._note(value, self._dynamics(value))
        if isinstance(value, LoadTable):
            return self._note(value, self._loads(self(value.plant, numbers), value.substeps))
        if isinstance(value, ImplicitFriction):
            return self._note(value, self._friction(value))
        if isinstance(value, Environment):
            return self._environment(value, numbers)
        if isinstance(value, Tool):
            return self._tool(value, numbers)
        kind: Any = type(value)
        # What has a __new__ of its own, as arrays or files, has something that is not in __dict__.
        if kind.__new__ is object.__new__ and hasattr(value, "__dict__"):
            # Numbers of loads and references are inputs of the code: another push compiles nothing.
            return self._object(value, numbers or isinstance(value, Load | Reference))
        # It may hold anything: random numbers, a queue, a file.
        raise NotElementwise(f"it holds a {type(value).__name__}")

    def _loads(self, plant: Any, substeps: int) -> Any:
        """Return disturbance torques as expressions."""
        return _TracedLoads(plant, substeps)

    def _friction(self, friction: ImplicitFriction) -> Any:
        """Return friction that notes its uses."""
        return TracedFriction(friction, self.trace.calls)

    def _environment(self, environment: Environment, numbers: bool) -> Any:
        """Return what an arm touches, that notes its uses."""
        made = self._object(environment, numbers)
        return self._note(environment, TracedEnvironment(made, self.trace.calls))

    def _tool(self, tool: Tool, numbers: bool) -> Any:
        """Return what works out what the tool does, that notes its uses."""
        made = self._object(tool, numbers)
        return self._note(tool, TracedTool(made, self.trace.summed_calls))

    def kind(self, values: Array) -> str:
        """Return what an array is: "shared" by rollouts, each rollout's "own", or part of the "structure"."""
        rows = values.ndim == 2 and len(values) in (1, self._rollouts)
        # Integers and matrices are structure: indices, knots, selections. They stay numbers.
        if values.dtype != np.float64 or (values.ndim > 1 and not rows):
            return "structure"
        return "own" if rows else "shared"

    def array(self, values: Array) -> Any:
        """Return symbols for an array of numbers: shared, or of each rollout its own."""
        kind = self.kind(values)
        if kind == "structure":
            return values
        symbols = Symbols.new(f"p{len(self.trace.shared)}_{len(self.trace.own)}", values.shape[-1:])
        if kind == "own":
            self._own(flat(symbols), values)
        else:
            self.trace.shared += flat(symbols)
            self.trace.values.shared += values.ravel().tolist()
        return symbols

    def _own(self, symbols: list[Any], rows: Array) -> None:
        """Note symbols of what each rollout has its own of, with its values (rollouts, k)."""
        self.trace.own += symbols
        self.trace.values.own += list(rows.T)

    def _object(self, value: Any, numbers: bool) -> Any:
        """Return a copy of an object with copies of its attributes."""
        made = object.__new__(type(value))
        # Before its attributes are copied: one of them may lead back here.
        self._copies[id(value)] = self._repeat_of(made)
        ours = type(value).__module__.startswith("armgpi.")
        self.trace.user_defined |= not ours
        if not ours:
            self._side_effects.watch_random()
        self._kind_of(value)
        varies = _varying(cast(Any, type(value))) if self.declared else _NOTHING
        for name, attribute in vars(value).items():
            if name in _unused_attributes(value):
                continue
            if not ours and getattr(attribute, "shape", ()) == (self._rollouts,) * 2 == (self.trace.n,) * 2:
                raise NotElementwise(
                    f"{type(value).__name__}.{name} may be a matrix or have a row for each rollout"
                )
            if varies.get(name) == "seed":
                seeds = self.trace.values.seeds
                seeds.append(attribute)
                object.__setattr__(made, name, Seed(len(seeds) - 1))
            else:
                # Those of a part as it was made stay literals, of which CasADi makes sums with others.
                given_anew = self.anew and name in varies and vars(value).get("remade", False)
                object.__setattr__(made, name, self._below(name, attribute, numbers or given_anew))
        return self._note(value, made)

    def _repeat_of(self, made: Any) -> Any:
        """Return what replaces an object that is met again."""
        return made

    def _kind_of(self, value: Any) -> None:
        """Note the class of an object."""
        self._side_effects.watch(type(value))

    def _robot(self, robot: AnyRobot) -> Any:
        """Return a robot with traced dynamics."""
        dynamics = self(robot.dynamics)
        limits, friction = (
            type(values)(*(self(a) if a.ndim == 2 else a for a in values))
            for values in (robot.limits, robot.friction)
        )
        made = robot._with_attributes(dynamics=dynamics, limits=limits, friction=friction)
        return self._note(robot, made)

    def _dynamics(self, dynamics: Dynamics) -> Any:
        """Return traced dynamics; those of one base share their kernels."""
        # A factor on all masses is a parameter, so 0.8 and 1.2 of an arm share their code.
        base = dynamics.base if isinstance(dynamics, ScaledDynamics) else dynamics
        arm = arm_of(base)
        if id(base) not in self._parameters:
            symbols = flat(Symbols.new(f"m{len(self._parameters)}", arm.table.shape[1:]))
            self._parameters[id(base)] = symbols
            self._own(symbols, arm.rows_of(base))
        scale = dynamics.scale if isinstance(dynamics, ScaledDynamics) else arm.scale
        made: Any = TracedDynamics(arm, self.trace.calls, self._parameters[id(base)])
        if isinstance(scale, float):
            return made if scale == 1.0 else _Scaled(made, self.array(np.array(scale)))
        return _Scaled(made, self.array(scale))

    def _note(self, value: Any, made: Any) -> Any:
        """Remember the copy of a value, and return it."""
        self._copies[id(value)] = made
        self._kept.append((value, made, _content(made)))
        return made

    @contextmanager
    def undo_writes(self) -> Iterator[None]:
        """Call laws with symbols: what they write to outside of themselves is put back.

        Raises:
            NotElementwise: when they remember anything but in their state.
        """
        try:
            yield
            for value, made, before in self._kept:
                now = _content(made)
                changed = [key for key in now.keys() | before.keys() if now.get(key) is not before.get(key)]
                if changed:
                    of = "" if isinstance(value, list | np.ndarray) else f" ({', '.join(map(str, changed))})"
                    raise NotElementwise(
                        f"a {type(value).__name__} in it{of} changes; what changes belongs into the state"
                    )
            if changes := self._side_effects.changes():
                raise NotElementwise(
                    f"outside of it {', '.join(changes)} changes; what changes belongs into the state"
                )
        finally:
            self._side_effects.restore()


class LoopTracer(Tracer):
    """Traces a loop whose numbers are all inputs of the code, so that another run compiles nothing."""

    declared = True


class Inventory(LoopTracer):
    """Goes through a loop as :class:`LoopTracer` does, and lists its numbers and what it is made of.

    Two loops of one structure have the same trace, and their numbers are in the same order.

    Attributes:
        structure: classes, names, texts, flags and sizes: what decides the trace, in order.
    """

    def __init__(self, loop: Any, state: Any, running: Running | None = None) -> None:
        """List what is in a loop (:class:`armgpi.ClosedLoop`) that starts at a state, and in what adds up.

        Raises:
            NotElementwise: when it holds what no trace can be made of.
        """
        robot = loop.plant.robot
        rollouts = loop.true_state(state).q.shape[:-1]
        super().__init__(Trace(robot.n), *rollouts or (1,))
        self.structure: list[Any] = [len(rollouts), loop.dt]
        parts = tuple(state[1:])
        for path, value in numbers(parts):
            own = _one_shape(value, rollouts)
            self.structure.append((path, type(value), value if isinstance(value, int) else own))
        self.trace.values.start = columns(parts, rollouts)
        self._below("plant", loop.plant, False)
        self._below("controller", loop.controller, False)
        if loop.reference.symbolic:
            self._below("reference", loop.reference, False)
        else:
            self.structure.append(("table", np.ndim(loop.reference.at(0.0).q)))
        if running is not None:
            self(running)

    @property
    def values(self) -> Values:
        """The numbers."""
        return self.trace.values

    @property
    def name(self) -> str:
        """The structure as text, the same in every process; empty where something in it has none."""
        try:
            return "" if self.user_defined else _text(self.structure)
        except TypeError:
            return ""

    @property
    def user_defined(self) -> bool:
        """Whether there are laws in it that do not come with armgpi."""
        return self.trace.user_defined

    def __call__(self, value: Any, numbers: bool = False) -> Any:
        """List a value, once."""
        if id(value) in self._copies:
            self.structure.append(self._copies[id(value)])
            return value
        return super().__call__(value, numbers)

    def array(self, values: Array) -> Any:
        """List an array."""
        kind = self.kind(values)
        self.structure.append((kind, values.shape[-1:]))
        if kind == "structure":
            self.structure.append((values.dtype.str, values.shape, values.tobytes()))
        elif kind == "own":
            self.trace.values.own += list(values.T)
        else:
            self.trace.values.shared += values.ravel().tolist()
        return values

    def _plain(self, value: Any) -> Any:
        if isinstance(value, BSplineBasis):
            self.structure.append((value.order, value.knots.tobytes()))
        elif isinstance(value, Weights):
            self.structure.append(Weights)  # their numbers are in arrays of the networks
        elif isinstance(value, slice | range):
            self.structure.append(repr(value))
        else:
            module = getattr(value, "__module__", None)
            if isinstance(value, types.FunctionType) and not str(module).startswith("armgpi."):
                self.trace.user_defined = True
            self.structure.append((type(value), value))
        return value

    def _container(self, value: Any, numbers: bool) -> Any:
        self.structure.append((type(value), tuple(value) if isinstance(value, dict) else len(value)))
        for step, item in value.items() if isinstance(value, dict) else enumerate(value):
            self._below(step, item, numbers)
        return value

    def _part(self, value: Any, numbers: bool) -> Any:
        self.structure.append(type(value))
        if isinstance(value, types.MethodType):
            self.structure.append(value.__func__)
            self(value.__self__, numbers)
            return value
        return super()._part(value, numbers)

    def _robot(self, robot: AnyRobot) -> Any:
        self.structure += [robot.joint_names, robot.joint_types]
        self(robot.dynamics)
        for values in (robot.limits, robot.friction):
            for array in values:
                if array.ndim == 2:
                    self(array)
                else:
                    self.structure.append(array.tobytes())
        return self._note(robot, robot)

    def _dynamics(self, dynamics: Dynamics) -> Any:
        base = dynamics.base if isinstance(dynamics, ScaledDynamics) else dynamics
        arm = arm_of(base)
        self.structure.append(arm.model.fingerprint)
        if id(base) not in self._parameters:
            self._parameters[id(base)] = []
            self.trace.values.own += list(arm.rows_of(base).T)
            self.structure.append(len(self._parameters))
        else:
            self.structure.append(list(self._parameters).index(id(base)))
        scale = dynamics.scale if isinstance(dynamics, ScaledDynamics) else arm.scale
        if isinstance(scale, float):
            self.structure.append(scale == 1.0)
            return None if scale == 1.0 else self.array(np.array(scale))
        return self.array(scale)

    def _loads(self, plant: Any, substeps: int) -> Any:
        self.structure.append(substeps)
        return plant

    def _friction(self, friction: ImplicitFriction) -> Any:
        self.structure += [friction.sticks, friction.braking.__name__]
        return friction

    def _environment(self, environment: Environment, numbers: bool) -> Any:
        return self._object(environment, numbers)

    def _tool(self, tool: Tool, numbers: bool) -> Any:
        return self._object(tool, numbers)

    def _kind_of(self, value: Any) -> None:
        names = [name for name in vars(value) if name not in _unused_attributes(value)]
        self.structure.append((type(value), vars(value).get("remade", False), *names))

    def _repeat_of(self, made: Any) -> Any:
        return ("again", len(self._copies))

    def _note(self, value: Any, made: Any) -> Any:
        # The thing itself is kept, as an id may be used again.
        self._copies.setdefault(id(value), self._repeat_of(made))
        self._kept.append((value, None, None))
        return value


def _text(value: Any) -> str:
    """Return what decides a trace as text, the same in every process.

    Raises:
        TypeError: for what has no such text.
    """
    if isinstance(value, tuple | list):
        return f"({','.join(map(_text, value))})"
    if isinstance(value, frozenset):
        return f"{{{','.join(sorted(map(_text, value)))}}}"
    if isinstance(value, types.FunctionType) and value.__closure__ is None:
        return f"{value.__module__}.{value.__qualname__}:{value.__code__.co_firstlineno}"
    if isinstance(value, type | types.BuiltinFunctionType):
        return f"{value.__module__}.{value.__qualname__}"
    if isinstance(value, types.ModuleType | np.ufunc):
        return value.__name__
    plain = (str, bytes, int, float, complex, type(None), range, slice, np.generic, np.dtype)
    if isinstance(value, plain):
        return repr(value)
    raise TypeError(f"a {type(value).__name__} has no text of its own")


_NOTHING: Mapping[str, str] = {}
#: How an object was made, which nothing in a law looks at.
_UNUSED = ("_as_given", "remade")
#: The loads that a controller of ours was made for: what they decided is in its nominal model and gains.
_DECIDED = (*_UNUSED, "payload")


def _unused_attributes(value: Any) -> tuple[str, ...]:
    """Return the attributes of an object that are no part of what it computes."""
    return _DECIDED if type(value).__module__.startswith("armgpi.") else _UNUSED


@lru_cache(maxsize=256)
def _varying(kind: type) -> Mapping[str, str]:
    """Return the numbers that a class declares and that may vary by rollout, name -> kind."""
    return {name: each.kind for name, each in parameters(kind).items() if each.varies}


def _content(made: Any) -> dict[Any, Any]:
    """Return what is in a copy, by place or name: the things themselves, as an id may be used again."""
    if isinstance(made, Symbols):
        return dict(enumerate(made.x.ravel()))
    if isinstance(made, list):
        return dict(enumerate(made))
    return dict(made if isinstance(made, dict) else getattr(made, "__dict__", {}))


class _Scaled(ScaledDynamics):
    """A scaled robot without the check whether a torque is zero, which generated code does itself."""

    def inertia_solve(self, q: Any, tau: Any) -> Any:
        """Return D(q)^-1 tau."""
        return self.base.inertia_solve(q, tau / self.scale)


class _TracedLoads:
    """Disturbance torques at the stage times, as expressions: what the plant's table is."""

    def __init__(self, plant: Any, substeps: int) -> None:
        self._plant, self._substeps = plant, substeps

    def at(self, k: Any, substep: int, dt: float) -> tuple[Any, ...]:
        """Return the torque at the beginning, middle and end of a substep of sample `k`."""
        stages = []
        for stage in LoadTable.STAGES.tolist():
            t = Symbols(np.array(dt * (Scalar(k.sx) + (substep + stage) / self._substeps), dtype=object))
            stages.append(sum((load.torque(t) for load in self._plant.loads), np.zeros(self._plant.robot.n)))
        return tuple(stages)


@contextmanager
def tracing() -> Iterator[None]:
    """Make one kind of refusal, with its place, of whatever a law does to symbols.

    Raises:
        NotElementwise: for any exception but of memory or a compiler; a user's law may do anything to what is
            no array.
    """
    try:
        yield
    except (MemoryError, BackendError):
        raise
    except Exception as error:
        # The innermost line outside of the generator and of packages is the one in the user's law.
        words = " ".join(str(error).split()) or "no reason given"
        said = words if isinstance(error, NotElementwise) else f"{type(error).__name__} on symbols: {words}"
        places = [
            f"{Path(frame.filename).name}, line {frame.lineno}"
            for frame in traceback.extract_tb(error.__traceback__)
            if not frame.filename.startswith(_GENERATORS)
            and "site-packages" not in frame.filename
            and frame.filename != contextlib.__file__
        ]
        raise NotElementwise(f"{said}, in {places[-1]}" if places else said) from error


def check_repeatable(text: str, again: Callable[[], str]) -> None:
    """Refuse a law of which a second trace is another one.

    Args:
        text: its C.
        again: traces it once more, and returns its C.

    Raises:
        NotElementwise: when the two differ.
    """
    if again() != text:
        raise NotElementwise("it gives something else each time that it is asked (random numbers?)")


def trace(
    loop: Any, state: Any, signals: bool, running: Running | None = None, contacts: bool = False
) -> Trace:
    """Return one sample of a closed loop as expressions.

    Args:
        loop: an :class:`armgpi.ClosedLoop`.
        state: its state at the start.
        signals: whether the controller's inner signals are recorded.
        running: what adds up samples, where that is all that a run keeps.
        contacts: whether forces of contacts and where they act are recorded, see :func:`contact_names`.

    Raises:
        NotElementwise: when the loop does what has no expression.
    """
    result = _one_sample(loop, state, signals, running, contacts=contacts)
    if isinstance(loop.controller, Supervised):
        result.usual = _one_sample(loop, state, signals, running, usual=True, contacts=contacts)
    return result


class _Usual:
    """A supervised controller whose step is the usual one."""

    def __init__(self, controller: Supervised, holds: list[list[Any]]) -> None:
        self._controller, self._holds = controller, holds

    def __getattr__(self, name: str) -> Any:
        """Return what the controller has."""
        return getattr(self._controller, name)

    def step(self, measurement: Any, target: Target, state: Any) -> ControlStep:
        """Return torque and next state, and note what has to hold."""
        before, after, made = self._controller.usual(measurement, target, state)
        self._holds += [_conditions(flat(before)[0]), _conditions(flat(after)[0])]
        return made


def _conditions(x: Any) -> list[Any]:
    """Return what a condition asks for, one by one."""
    return [y for i in range(2) for y in _conditions(x.dep(i))] if x.is_op(ca.OP_AND) else [x]


def _one_sample(
    loop: Any, state: Any, signals: bool, running: Any, usual: bool = False, contacts: bool = False
) -> Trace:
    """Return a sample of a loop as expressions."""
    n = loop.plant.robot.n
    result = Trace(n, k=ca.SX.sym("k"))
    rollouts = loop.true_state(state).q.shape[:-1]
    tracer = LoopTracer(result, *rollouts or (1,))

    def place(value: Any) -> Any:
        """Return symbols for a leaf of the state."""
        if isinstance(value, int):
            # Counts stay integers: the random numbers of a sample are drawn by its number, to the last bit.
            return Counter(result.k, value, result.draws)
        symbols = Symbols.new(f"s{len(result.state)}", _one_shape(value, rollouts))
        result.state.extend(flat(symbols))
        result.joints.extend(i % n for i in range(symbols.size))
        return symbols

    parts = tuple(state[1:])  # of plant and controller: the loop's own count is k
    before = unflatten(parts, [place(leaf.value) for leaf in numbers(parts)])
    result.values.start = columns(parts, rollouts)
    with tracer.undo_writes():
        result.recorded = _trace_sample(loop, before, tracer, result, signals, usual)
        if contacts:
            result.recorded.update(_touched(loop, before, tracer, result))
    if running is not None:
        _add_up(tracer(running), result)
    return result


def _add_up(running: Any, result: Trace) -> None:
    """Note how the sums change with a sample."""
    before = tuple(Symbols.new(name, (result.n,)) for name in TOTALS)
    result.sums = [x for part in before for x in flat(part)]
    seen = {name: Symbols.new(f"seen_{name}", (result.n,)) for name in ("q", "q_ref", "tau", "v")}
    result.seen = {name: flat(part) for name, part in seen.items()}
    k = Symbols(np.array(Scalar(result.k), dtype=object))

    def added(late: bool) -> list[Any]:
        after = running.add(k, seen["q"], seen["q_ref"], seen["tau"], before, late, v=seen["v"])
        return [x for part in after for x in flat(np.broadcast_to(part, (result.n,)))]

    # Uses of kernels are noted in one list.
    result.early = added(False)
    result.early_calls = result.summed_calls[:]
    result.summed_calls.clear()
    result.summed = added(True)


def columns(state: Any, rollouts: tuple[int, ...]) -> Array:
    """Return the numbers of a state in the order of its symbols, shape (s, rollouts or 1)."""
    width = rollouts or (1,)
    rows = [np.empty((0, *width))]
    for _, value in flatten(state):
        if isinstance(value, np.ndarray | float):
            shape = _one_shape(value, rollouts)
            rows.append(np.broadcast_to(value, (*rollouts, *shape)).reshape(*width, -1).T)
    return np.concatenate(rows)


def _one_shape(value: Any, rollouts: tuple[int, ...]) -> tuple[int, ...]:
    """Return the shape that a leaf has in one rollout: it is an array for all of them, or a row for each."""
    shape: tuple[int, ...] = np.shape(value)
    return shape[1:] if rollouts and len(shape) > 1 else shape


def _trace_sample(
    loop: Any, before: Any, tracer: Tracer, result: Trace, signals: bool, usual: bool
) -> dict[str, list[Any]]:
    """Take one sample with symbols: note the state after it, and return what is recorded."""
    n = result.n
    looked = copy.copy(loop)  # the loop's own code takes the sample, with traced parts in it
    looked.plant, looked.controller = tracer(loop.plant), tracer(loop.controller)
    if usual:
        looked.controller = _Usual(looked.controller, result.holds)
    target = _target(loop, tracer, result)
    plant, controller, measured, tau = looked._sample(*before, target)
    # Torque is known only after the step: saturation and rate limits are part of it.
    truth, moved = looked.plant.true_state(before[0]), looked.plant.true_state(plant)
    result.after = _after((plant, controller), before)
    recorded = {
        "q": truth.q,
        "v": truth.v,
        "q_measured": measured.q,
        "tau_command": tau,
        "tau": moved.tau,
        "q_ref": target.q,
        "v_ref": target.v,
    }
    said = looked.controller.signals if signals else looked.controller.reported
    recorded.update(said(controller))
    return {name: flat(np.broadcast_to(x, (n,))) for name, x in recorded.items()}


def contact_names(contacts: int, n: int) -> list[str]:
    """Return the names under which contacts are recorded.

    What is recorded has n numbers under a name. The numbers of contacts, force [N] and position [m] in the
    base frame of one after the other, are cut into as many names as they need; the last one ends in zeros.

    Args:
        contacts: their number.
        n: number of joints.
    """
    return [f"contacts.{i}" for i in range(-(-6 * contacts // n))]


def _touched(loop: Any, before: Any, tracer: Tracer, result: Trace) -> dict[str, list[Any]]:
    """Return what contacts do at a sample; see :func:`contact_names`."""
    plant = tracer(loop.plant)
    surroundings = getattr(inside(plant), "_surroundings", None)
    if surroundings is None:
        return {}
    truth = plant.true_state(before[0])
    time = Symbols(np.array(Scalar(result.k), dtype=object)) * loop.dt
    numbers: list[Any] = []
    touched = surroundings.touched(truth.q, truth.v, time)
    for each in touched:
        numbers += flat(np.broadcast_to(each.wrench.force, (3,)))
        numbers += flat(np.broadcast_to(each.motion.position, (3,)))
    names = contact_names(len(touched), result.n)
    numbers += [ca.SX(0.0)] * (len(names) * result.n - len(numbers))
    return {name: numbers[i * result.n : (i + 1) * result.n] for i, name in enumerate(names)}


def state_part(after: Any, shape: tuple[int, ...]) -> Any:
    """Return a part of the state after a sample in the shape that it had before.

    Raises:
        NotElementwise: when it is no longer of numbers.
    """
    # NumPy would carry on with bools or integers, whose sums and quotients are others.
    booleans = isinstance(after, Symbols) and any(map(is_bool, after.x.ravel()))
    if booleans or (isinstance(after, np.ndarray | bool) and np.asarray(after).dtype != np.float64):
        raise NotElementwise("its state is of float64 before a sample and of another type after it")
    return np.broadcast_to(after, shape)


def _target(loop: Any, tracer: Tracer, result: Trace) -> Target:
    """Return the target as expressions of the time, or as symbols of a table where it has none."""
    if loop.reference.symbolic:
        t = Symbols(np.array(Scalar(result.k * float(loop.dt)), dtype=object))
        target = tracer(loop.reference).at(t)
        if ca.n_nodes(ca.SX(ca.vertcat(*(x for part in target for x in flat(part))))) < _LONG_REFERENCE:
            return Target(*(np.broadcast_to(part, (result.n,)) for part in target))
    parts: list[Any] = [Symbols.new(name, (result.n,)) for name in Target._fields]
    result.table = [x for part in parts for x in flat(part)]
    return Target(*parts)


def _after(after: Any, before: Any) -> list[Any]:
    """Return the expressions of a state after a sample, in the order of the state's symbols."""
    expressions: list[Any] = []
    for now, old in zip(leaves_like(after, before), flatten(before), strict=True):
        if isinstance(old.value, Symbols):
            expressions += flat(state_part(now, old.value.shape))
        elif not isinstance(now, Counter) or now.offset != old.value.offset + 1:
            raise NotElementwise("its state counts by other than one a sample")
    return expressions
