"""The dynamics of a law while it is traced: every use becomes a call of a generated function."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from inspect import signature
from typing import Any, NamedTuple, cast
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array
from armgpi.codegen.algebra import ca
from armgpi.codegen.emit import CallSite, Dialect, straight_line
from armgpi.codegen.model import SymbolicModel, varied_table, varying
from armgpi.codegen.symbols import NotElementwise, Scalar, Symbols, flat
from armgpi.loop.tool import Tool, most_apart
from armgpi.plants.environment import Environment
from armgpi.plants.friction import (
    MOST_STEPS,
    Braked,
    ImplicitFriction,
    Iterate,
    braked_velocity,
    first_iterate,
    is_apart,
    newton_step,
)
from armgpi.robot.dynamics import (
    CoupledDynamics,
    Dynamics,
    PinocchioDynamics,
    ScaledDynamics,
    StackedDynamics,
    VariedDynamics,
)
from armgpi.robot.equations import Friction
from armgpi.robot.frame_motion import Chain, FrameMotion

#: How far a generated model may be from Pinocchio's, relative to the largest entry.
_AGREEMENT = 1e-9
#: Random states at which the two are compared, for each arm.
_STATES = 8
#: Arms of a batch that are compared, at most: they share the expressions, so a few show what is wrong.
_ARMS = 16


#: Kernels of equal models that a process keeps at most: a page with sliders has some 60.
_KEPT = 512


@dataclass(frozen=True)
class Kernel:
    """A generated function of arrays.

    Attributes:
        name: its name in C.
        sizes: lengths of its arguments.
        size: length of its result.
        parameters: the symbols of what differs between rollouts, which it takes as well.
        inputs: the symbols of its arguments.
        outputs: its result.
        skip: index of the argument that makes the result zero when it is; None when none does.
    """

    name: str
    sizes: tuple[int, ...]
    size: int
    parameters: Sequence[Any]
    inputs: Sequence[Any]
    outputs: Sequence[Any]
    skip: int | None = None
    _written: dict[Dialect, list[str]] = field(default_factory=dict, compare=False)

    def lines(self, dialect: Dialect) -> list[str]:
        """Return the lines that work out y from x (arguments one after the other) and m (parameters)."""
        if dialect not in self._written:
            self._written[dialect] = self._body(dialect)
        return self._written[dialect]

    def _body(self, dialect: Dialect) -> list[str]:
        """Work out the lines."""
        return self._assign(self.outputs, [f"y[{i}]" for i in range(self.size)], dialect)

    def _assign(
        self, expressions: Sequence[Any], targets: Sequence[str], dialect: Dialect, state: Sequence[Any] = ()
    ) -> list[str]:
        """Return the lines that work out expressions and assign them to targets."""
        inputs = [(symbol, f"x[{i}]") for i, symbol in enumerate(self.inputs)]
        inputs += [(symbol, f"m[{i}]") for i, symbol in enumerate(self.parameters)]
        inputs += [(symbol, f"s[{i}]") for i, symbol in enumerate(state)]
        return straight_line(inputs, expressions, targets, dialect).lines


@dataclass(frozen=True, kw_only=True)
class Iteration(Kernel):
    """A kernel that repeats a step until it changes nothing any more, for each rollout by itself.

    Its result is the beginning of the state after the step with which a lane settled, and of a lane that has
    not settled `outputs`. So it does not depend on the rollouts beside it.

    Attributes:
        state: the symbols of what a step changes.
        begin: the state at first.
        following: the state after a step.
        moving: conditions of which one at least holds as long as the step has to be repeated.
        most: steps at most.
    """

    state: Sequence[Any]
    begin: Sequence[Any]
    following: Sequence[Any]
    moving: Sequence[Any]
    most: int

    def _body(self, dialect: Dialect) -> list[str]:
        """Work out the lines."""
        size = len(self.state)
        # What ends in a bracket takes a condition.
        targets = [*(f"z[{i}]" for i in range(size)), *["moving |= ("] * len(self.moving)]
        return [
            f"V states[2][{size}];",
            "{",
            *self._assign(self.begin, [f"states[0][{i}]" for i in range(size)], dialect),
            "}",
            "M running = v_not((M){0});",
            f"for (int step = 0; step < {self.most}; ++step) {{",
            "const V *restrict s = states[step & 1];",
            "V *restrict z = states[~step & 1];",
            "M moving = (M){0};",
            *self._assign([*self.following, *self.moving], targets, dialect, self.state),
            f"for (int i = 0; i < {self.size}; ++i) y[i] = v_select(running, z[i], y[i]);",
            "running = v_and(running, moving);",
            "if (!v_any(running)) return;",
            "}",
            f"const V *s = states[{self.most & 1}];",
            f"V z[{self.size}];",
            *self._assign(self.outputs, [f"z[{i}]" for i in range(self.size)], dialect, self.state),
            f"for (int i = 0; i < {self.size}; ++i) y[i] = v_select(running, z[i], y[i]);",
        ]


@dataclass(frozen=True)
class Call:
    """One use of a kernel.

    A kernel is a function of its own in C, and not part of the sample: forward dynamics are used four times a
    substep by Runge-Kutta, and written once.

    Attributes:
        kernel: which.
        arguments: CasADi expressions, one after the other.
        parameters: the symbols of what differs between rollouts, in the trace.
        results: the symbols of what it returns.
    """

    kernel: Kernel
    arguments: list[Any]
    parameters: list[Any]
    results: list[Any]


class Placed(NamedTuple):
    """Calls among the inputs and outputs of a straight line; see :func:`armgpi.codegen.emit.straight_line`.

    Attributes:
        inputs: the calls' results, and what they are in C.
        outputs: their arguments.
        targets: where those go.
        order: of each: its place in its array, as the first joint comes first.
        sites: the calls.
    """

    inputs: list[tuple[Any, str]]
    outputs: list[Any]
    targets: list[str]
    order: list[int]
    sites: list[CallSite]


def place_calls(
    calls: Sequence[Call],
    argument: Callable[[int, int, int], str],
    result: Callable[[int, int], str],
    lines: Callable[[int, Call], list[str]],
) -> Placed:
    """Return calls as a straight line takes them.

    Args:
        calls: the calls, in order.
        argument: entry j of argument k of call i in C, from (i, k, j).
        result: entry j of the result of call i, from (i, j).
        lines: what to write for a call, from (i, call).
    """
    placed = Placed([], [], [], [], [])
    for i, call in enumerate(calls):
        begin = len(placed.outputs)
        placed.outputs.extend(call.arguments)
        for k, size in enumerate(call.kernel.sizes):
            for j in range(size):
                placed.targets.append(argument(i, k, j))
                placed.order.append(j)
        arguments = begin, len(placed.outputs)
        results = [result(i, j) for j in range(call.kernel.size)]
        placed.inputs.extend(zip(call.results, results, strict=True))
        placed.sites.append(CallSite(arguments, results, lines(i, call)))
    return placed


class Arm:
    """The generated functions of one arm, or of arms of one structure, made when they are first asked for.

    Attributes:
        model: the equations of motion.
        scale: factor of all masses and inertias, a number or an array (batch, 1).
        kernels: the functions by name.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        """Generate from the models behind `dynamics`.

        Raises:
            NotElementwise: for dynamics that are not Pinocchio's, or arms that differ in their joints.
        """
        bases, self._rows, self.scale = _parts(dynamics)
        models, couplings = zip(*map(_unpack, bases), strict=True)
        ratio, offset = couplings[0]
        varied = varied_of(dynamics)
        for other_ratio, other_offset in couplings[1:]:
            if not (np.array_equal(ratio, other_ratio) and np.array_equal(offset, other_offset)):
                raise NotElementwise("its arms differ in how joints follow others")
        try:
            varies = None if varied is None else varying(models[0], varied)
            self.model = SymbolicModel(models, ratio, offset, varies)
        except ValueError as error:
            raise NotElementwise(str(error)) from None
        if varied is not None:
            models = tuple(varied.row(i).model for i in range(min(varied.batch, _ARMS)))
            couplings = couplings * len(models)
            self._checked = self.rows_of(dynamics)
        else:
            self._checked = self.model.table
        # Dynamics of its own to check against: those given are the key under which this arm is kept.
        pairs = zip(models, couplings, strict=True)
        self._bases = [_again(model, coupling) for model, coupling in pairs][:_ARMS]
        self.kernels: dict[str, Kernel] = {}

    @property
    def table(self) -> Array:
        """What differs between the rollouts it was made for, shape (rollouts, k): the kernels' parameters."""
        return self.model.table[self._rows]

    def rows_of(self, dynamics: Dynamics) -> Array:
        """Return the kernels' parameters in some dynamics of this arm, shape (rollouts, k)."""
        varied = varied_of(dynamics)
        if varied is None:
            return self.table
        return varied_table(varied.base.model, varied, self.model.table[0])

    def kernel(self, name: str) -> Kernel:
        """Return a kernel by the name of the method of :class:`armgpi.robot.dynamics.Dynamics`."""
        # When it is asked for: most loops use a few of them, and making and checking one takes time.
        if name not in self.kernels:
            self.kernels[name] = self._shared(name)
        return self.kernels[name]

    def _shared(self, name: str) -> Kernel:
        """Return a kernel, which equal models have in common."""
        if self.model.parameters:
            return self._build_kernel(name)
        key = name, self.model.fingerprint
        if (kernel := _made.get(key)) is None:
            if len(_made) >= _KEPT:
                _made.clear()
            kernel = _made[key] = self._build_kernel(name)
        # One of its own: by that who calls it is told from another arm of the same model.
        return replace(kernel)

    def _build_kernel(self, name: str) -> Kernel:
        model = self.model
        q, x, y = (_new_scalars(letter, model.n) for letter in "qxy")
        skip = None
        match name:
            case "forward":
                arguments, result = [q, x, y], model.forward(q, x, y)
            case "inverse":
                arguments, result = [q, x, y], model.inverse(q, x, y)
            case "inverse_where":
                on = Scalar(ca.SX.sym("on"))
                arguments, skip = [np.array([on], dtype=object), q, x, y], 0
                torque = model.inverse(q, x, y)
                result = np.array([on * value for value in torque], dtype=object)
            case "inertia_times":
                arguments, result = [q, x], model.inverse(q, None, x, weight=False)
            case "inertia_solve":
                # The saturation residual, which is zero in most samples.
                arguments, skip = [q, x], 1
                result = model.solve_inertia(q, x)
            case "nonlinear_effects":
                arguments, result = [q, x], model.inverse(q, x, None)
            case "gravity":
                arguments, result = [q], model.inverse(q, None, None)
            case _:
                arguments, result = [q], model.mass_matrix(q).ravel()
        kernel = Kernel(
            f"{name}_{model.digest}",
            sizes=tuple(map(len, arguments)),
            size=len(result),
            parameters=[symbol.sx for symbol in model.parameters],
            inputs=[symbol.sx for symbol in np.concatenate(arguments)],
            outputs=flat(Symbols(result)),
            skip=skip,
        )
        self._check(name, kernel)
        return kernel

    def _check(self, name: str, kernel: Kernel) -> None:
        """Refuse a kernel that is not Pinocchio's at random states."""
        # At each start, and not in tests alone: nobody has tested the URDF that a user brings.
        vectors = [ca.vertcat(*kernel.inputs), ca.vertcat(*kernel.parameters)]
        function = ca.Function("f", vectors, [ca.vertcat(*kernel.outputs)])
        random = np.random.default_rng(0)
        for base, values in zip(self._bases, self._checked, strict=False):
            for _ in range(_STATES):
                x = [random.normal(size=size) for size in kernel.sizes]
                theirs = np.ravel(getattr(base, name)(*x))
                ours = np.array(function(np.concatenate(x), values)).ravel()
                size = np.abs(theirs).max()
                if kernel.skip is None and name != "forward":
                    # Gravity's torque on a level arm is zero but for rounding: measure by another torque.
                    other = base.inverse(*random.normal(size=(3, len(x[-1]))))
                    size = max(size, 1e-3 * np.abs(other).max())
                wrong = float(np.abs(ours - theirs).max() / size)
                if not wrong <= _AGREEMENT:
                    raise NotElementwise(
                        f"its generated {name} differs from Pinocchio's by {wrong:.2g} relative"
                    )


def _new_scalars(letter: str, count: int) -> Any:
    """Return an array of so many new symbols, called by a letter and a number."""
    return np.array([Scalar(ca.SX.sym(f"{letter}{i}")) for i in range(count)], dtype=object)


#: Kernels by the name of the method and the fingerprint of the model, of models without parameters.
_made: dict[tuple[str, str], Kernel] = {}


class TracedDynamics:
    """Equations of motion that note what they are asked for.

    Attributes:
        calls: every use so far, in order; shared by all dynamics of a trace.
    """

    def __init__(self, arm: Arm, calls: list[Call], parameters: list[Any]) -> None:
        """Trace the uses of an arm whose parameters have these symbols."""
        self.arm = arm
        self.calls = calls
        self._parameters = parameters

    def forward(self, q: Any, v: Any, tau: Any) -> Symbols:
        """Return the acceleration."""
        return self._call("forward", q, v, tau)

    def inverse(self, q: Any, v: Any, a: Any) -> Symbols:
        """Return the torque."""
        return self._call("inverse", q, v, a)

    def inverse_where(self, on: Any, q: Any, v: Any, a: Any) -> Symbols:
        """Return the torque where it is asked for."""
        return self._call("inverse_where", on, q, v, a)

    def inertia_times(self, q: Any, a: Any) -> Symbols:
        """Return D(q) a."""
        return self._call("inertia_times", q, a)

    def inertia_solve(self, q: Any, tau: Any) -> Symbols:
        """Return D(q)^-1 tau; zero, and no call, of what is zero: a law without torque limits cuts none."""
        if all(ca.SX(x).is_zero() for x in flat(tau)):
            return Symbols(np.zeros(self.arm.model.n).astype(object))
        return self._call("inertia_solve", q, tau)

    def nonlinear_effects(self, q: Any, v: Any) -> Symbols:
        """Return C(q, v) v + G(q)."""
        return self._call("nonlinear_effects", q, v)

    def gravity(self, q: Any) -> Symbols:
        """Return G(q)."""
        return self._call("gravity", q)

    def mass_matrix(self, q: Any) -> Symbols:
        """Return D(q)."""
        n = self.arm.model.n
        return self._call("mass_matrix", q).reshape(n, n)

    def _call(self, name: str, *arguments: Any) -> Symbols:
        """Note a call and return the symbols of its result."""
        return _note_call(self.calls, self.arm.kernel(name), self._parameters, *arguments)


def _new_arguments(*sizes: int) -> tuple[Any, ...]:
    """Return arrays of new symbols, x0_, x1_ and so on."""
    return tuple(Symbols.new(f"x{k}_", (size,)) for k, size in enumerate(sizes))


def _note_call(calls: list[Call], kernel: Kernel, parameters: list[Any], *arguments: Any) -> Symbols:
    """Note a call of a kernel and return the symbols of its result."""
    expressions = []
    for size, argument in zip(kernel.sizes, arguments, strict=True):
        expressions += flat(np.broadcast_to(argument, (size,)))
    results = Symbols.new(f"call{len(calls)}", (kernel.size,))
    calls.append(Call(kernel, expressions, parameters, flat(results)))
    return results


class TracedFriction:
    """Friction that notes what it is asked for: its Newton steps are one loop in C, whatever calls it."""

    def __init__(self, friction: ImplicitFriction, calls: list[Call]) -> None:
        """Note the uses among other calls."""
        self._friction = friction
        self._calls = calls

    def __call__(self, v_free: Any, *others: Any) -> Symbols:
        """Return the velocity; see :class:`armgpi.plants.friction.ImplicitFriction`."""
        width = v_free.shape[-1]
        *numbers, inertia = others[:_BESIDE]
        arm = others[_BESIDE:]
        kernel = _friction_kernel(self._friction.sticks, self._friction.braking, width, inertia.shape[-1])
        return _note_call(self._calls, kernel, [], v_free, *numbers, inertia.reshape(inertia.size), *arm)


@dataclass(frozen=True, kw_only=True)
class Guarded(Kernel):
    """A kernel that works out its last result first, and the others only where that is positive in a lane.

    Attributes:
        state: the symbols of what the first part works out, the last result first.
        begin: what they are.
    """

    state: Sequence[Any]
    begin: Sequence[Any]

    def _body(self, dialect: Dialect) -> list[str]:
        """Work out the lines."""
        count = self.size - 1
        return [
            f"V s[{len(self.state)}];",
            "{",
            *self._assign(self.begin, [f"s[{i}]" for i in range(len(self.state))], dialect),
            "}",
            f"y[{count}] = s[0];",
            f"for (int i = 0; i < {count}; ++i) y[i] = v_set(0.0);",
            "if (!v_any(v_lt(v_set(0.0), s[0]))) return;",
            *self._assign(self.outputs, [f"y[{i}]" for i in range(count)], dialect, self.state),
        ]


class TracedEnvironment:
    """What an arm touches, that notes its uses: each contact is one function in C.

    A contact that acts behind a surface alone is worked out where a rollout of a lane is behind it. How far
    it is at the first stage of a sample says where the next stages need not look.
    """

    def __init__(self, environment: Environment, calls: list[Call]) -> None:
        """Note the uses of an environment, whose numbers are symbols, among other calls."""
        self._environment = environment
        self._calls = calls
        self._kernels: dict[int, Kernel] = {}
        self._first: dict[int, tuple[Any, Any]] = {}

    def torque(self, q: Any, v: Any, t: Any) -> Any:
        """Return the joint torque of all contacts; see :meth:`Environment.torque`."""
        n = q.shape[-1]
        time = Symbols(np.array([t], dtype=object))
        total: Any = 0.0
        for i, contact in enumerate(self._environment.contacts):
            numbers = [x for part in vars(contact).values() if isinstance(part, Symbols) for x in flat(part)]
            given = Symbols(np.array([Scalar(x) for x in numbers], dtype=object))
            if i not in self._kernels:
                self._kernels[i] = self._kernel(i, n, numbers)
            kernel = self._kernels[i]
            if kernel.skip is None:
                total = total + _note_call(self._calls, kernel, [], q, v, time, given)
                continue
            found = _note_call(self._calls, kernel, [], q, v, time, self._reached(i, q), given)
            self._first.setdefault(i, (q, found[n:]))
            total = total + found[:n]
        return total

    def touched(self, q: Any, v: Any, t: Any) -> Any:
        """Return every contact with its wrench; see :meth:`Environment.touched`."""
        return self._environment.touched(q, v, t)

    def _reached(self, i: int, q: Any) -> Any:
        """Return what is positive where a contact may act: how deep its point is at most."""
        levers = self._environment.motions[i].lever_bounds()
        if i not in self._first or levers is None:
            return np.ones(1)
        first, depth = self._first[i]
        way: Any = _ROUNDING
        for joint in range(q.shape[-1]):
            way = way + float(levers[joint]) * abs(q[joint : joint + 1] - first[joint : joint + 1])
        return np.maximum(depth + way, 0.0)

    def _kernel(self, i: int, n: int, numbers: list[Any]) -> Kernel:
        """Return the kernel of a contact: its joint torque, and its depth where it has one."""
        contact, points = self._environment.contacts[i], self._environment.motions[i]
        q, v, t, reached = _new_arguments(n, n, 1, 1)
        name = f"contact{i}_{points.digest}"
        chain = points.chain(q)
        depth = contact.depth_at(chain.position)
        if depth is None:
            motion = points.at(q, v)
            torque = motion.torque(q, *contact.wrench(motion, t))
            inputs = [*flat(q), *flat(v), *flat(t), *numbers]
            return Kernel(name, (n, n, 1, len(numbers)), n, (), inputs, flat(torque))
        depth = np.broadcast_to(depth, (1,))
        parts = [depth, chain.rotation, chain.position, *chain.axes, *chain.origins]
        state = [Symbols.new(f"s{k}_", np.shape(part)) for k, part in enumerate(parts)]
        _, rotation, position, *levers = cast(Any, state)
        joints = len(chain.axes)
        motion = points.moving(Chain(rotation, position, levers[:joints], levers[joints:]), q, v)
        torque = motion.torque(q, *contact.wrench(motion, t))
        return Guarded(
            name,
            (n, n, 1, 1, len(numbers)),
            n + 1,
            (),
            [*flat(q), *flat(v), *flat(t), *flat(reached), *numbers],
            flat(np.broadcast_to(torque, (n,))),
            skip=3,
            state=[x for part in state for x in flat(part.reshape(-1))],
            begin=[x for part in parts for x in flat(part.reshape(-1))],
        )


class TracedTool(Tool):
    """A tool that notes its uses: its kinematics are one function in C.

    They are worked out where the errors of the joints are so large in a lane that the tool may be farther off
    than ever before.
    """

    def __init__(self, tool: Tool, calls: list[Call]) -> None:
        """Note the uses of a tool among other calls."""
        vars(self).update(vars(tool))
        self._calls = calls
        self._kernels: dict[int, Kernel] = {}

    def apart(self, motion: FrameMotion, q: Any, q_ref: Any, largest: Any) -> tuple[Any, Any]:
        """Return offset and turn, 0 where neither can be the largest; see :meth:`Tool.apart`."""
        n = q.shape[-1]
        if n not in self._kernels:
            now, wished, asked = _new_arguments(n, n, 1)
            offset, turn = super().apart(motion, now, wished, None)
            self._kernels[n] = Kernel(
                f"tool_{motion.digest}",
                sizes=(n, n, 1),
                size=2,
                parameters=(),
                inputs=[*flat(now), *flat(wished), *flat(asked)],
                outputs=[*flat(offset), *flat(turn)],
                skip=2,
            )
        most = most_apart(motion, q, q_ref)
        needed: Any = np.ones(1)
        if most is not None and largest is not None:
            is_farther = (most[0] > largest[0]) | (most[1] > largest[1])
            needed = np.where(is_farther, 1.0, 0.0)
        found = _note_call(self._calls, self._kernels[n], [], q, q_ref, needed)
        return found[0:1], found[1:2]


#: What a depth may be off by rounding [m].
_ROUNDING = 1e-9

#: Arguments besides `v_free`: before, viscous, coulomb, h, stick and inertia. Vectors of the arm follow.
_BESIDE = 6


@lru_cache(maxsize=32)
def _friction_kernel(sticks: tuple[bool, ...], braking: Callable[..., Braked], width: int, n: int) -> Kernel:
    """Return the kernel of friction.

    Args:
        sticks: whether there is Coulomb friction, for one stretch of the velocities after the other.
        braking: the arm's equation.
        width: velocities that there are: of the joints, or of links and motors.
        n: number of joints.
    """
    vectors = len(signature(braking).parameters) - 3  # besides h, v_free and the inertia
    sizes = (width, width, width, width, 1, 1, n * n, *[n] * vectors)
    given = _new_arguments(*sizes)
    v_free, before, viscous, coulomb, h, stick, inertia, *arm = given
    braked = braking(h, v_free, inertia.reshape(n, n), *arm)
    symbols = [x for part in given for x in flat(part)]
    name = f"friction_{braking.__name__}_{width}_{''.join(str(int(each)) for each in sticks)}"
    if not any(sticks):
        after = braked(cast(Any, viscous), np.zeros(width))
        return Kernel(name, sizes, width, (), symbols, flat(after))
    sticking = np.repeat(sticks, width // len(sticks))
    where = sticking.nonzero()[0]
    friction = Friction(cast(Any, viscous), np.where(sticking, cast(Any, coulomb), 0.0))
    smooth: Any = stick
    now = Iterate(*(cast(Any, Symbols.new(f"s{i}_", (width,))) for i in range(4)))
    following = newton_step(braked, now, friction, smooth)

    def changing(iterate: Iterate) -> list[Any]:
        """Return what a step needs of the one before: where there is no Coulomb friction, nothing."""
        signs, slopes = flat(iterate.sign), flat(iterate.slope)
        return [*flat(iterate.v), *(signs[i] for i in where), *(slopes[i] for i in where)]

    apart = flat(is_apart(following, friction.coulomb))
    return Iteration(
        name,
        sizes,
        width,
        (),
        symbols,
        flat(braked_velocity(braked, now, friction, smooth)),
        state=changing(now),
        begin=changing(first_iterate(cast(Any, before), smooth)),
        following=changing(following),
        moving=[apart[i] for i in where],
        most=MOST_STEPS,
    )


# Kept for as long as the robot is: a second controller or another run for it generates nothing. Rollouts of
# one robot that vary in the same quantities have one arm, whatever the numbers are.
_arms: WeakKeyDictionary[Dynamics, dict[Any, Arm]] = WeakKeyDictionary()


def arm_of(dynamics: Dynamics) -> Arm:
    """Return the generated functions of some dynamics, the same ones each time."""
    varied = varied_of(dynamics)
    key: Dynamics = dynamics
    structure: tuple[int, ...] = ()
    if varied is not None:
        key = varied.base
        structure = (dynamics is varied, *varying(varied.base.model, varied).nonzero()[0].tolist())
    arms = _arms.setdefault(key, {})
    if structure not in arms:
        arms[structure] = Arm(dynamics)
    return arms[structure]


def varied_of(dynamics: Dynamics) -> VariedDynamics | None:
    """Return what varies in dynamics that are not scaled; None where nothing was declared to."""
    whole = dynamics.whole if isinstance(dynamics, CoupledDynamics) else dynamics
    return whole if isinstance(whole, VariedDynamics) else None


def _parts(dynamics: Dynamics) -> tuple[list[Dynamics], npt.NDArray[np.int64], float | Array]:
    """Return the different dynamics behind some, which of them each rollout has, and the factor on them."""
    if isinstance(dynamics, ScaledDynamics):
        return [dynamics.base], np.zeros(1, dtype=np.int64), dynamics.scale
    if not isinstance(dynamics, StackedDynamics):
        return [dynamics], np.zeros(1, dtype=np.int64), 1.0
    # Rollouts with one and the same arm share its row of the table.
    batch = sum(len(rows) for _, rows in dynamics.groups)
    which, scale = np.zeros(batch, dtype=np.int64), np.ones((batch, 1))
    bases = []
    for i, (part, rows) in enumerate(dynamics.groups):
        (base,), _, factor = _parts(part)
        bases.append(base)
        which[rows] = i
        scale[rows] = factor
    return bases, which, 1.0 if (scale == 1.0).all() else scale


def _unpack(dynamics: Dynamics) -> tuple[Any, tuple[Array | None, Array | None]]:
    """Return the `pin.Model` behind dynamics, and how its joints follow others."""
    if isinstance(dynamics, PinocchioDynamics):
        return dynamics.model, (None, None)
    if isinstance(dynamics, VariedDynamics):
        return dynamics.base.model, (None, None)
    if isinstance(dynamics, CoupledDynamics):
        return _unpack(dynamics.whole)[0], (dynamics.ratio, dynamics.offset)
    raise NotElementwise(f"its dynamics are {type(dynamics).__name__}, not Pinocchio's")


def _again(model: Any, coupling: tuple[Array | None, Array | None]) -> Dynamics:
    """Return new dynamics of a model."""
    whole, (ratio, offset) = PinocchioDynamics(model), coupling
    return whole if ratio is None or offset is None else CoupledDynamics(whole, ratio, offset)
