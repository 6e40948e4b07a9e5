"""Loops whose numbers can all be moved, and the numbers of one.

A loop is changed so that what is a constant of its code becomes a number: the nominal model has a factor
even where it is 1, the delay is chosen among samples kept, measurements may be lost with probability 0. Each
of these is exact: the torque has the same bits.

Gains that a controller works out once of its tuning stay numbers of the loop. How they come from the tuning
is noted as a tape: the sums, products and quotients in NumPy's order, which a page does again.
"""

from __future__ import annotations

import copy
from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import Array
from armgpi.codegen.trace import Inventory
from armgpi.gpi.gains import Tuning
from armgpi.gpi.law import GPI
from armgpi.loop.closed_loop import ClosedLoop
from armgpi.plants.plant import Plant, Wrapper
from armgpi.plants.sensors import Delayed, DropOut
from armgpi.robot.dynamics import ScaledDynamics

#: Longest delay of a page [samples].
LONGEST = 20
#: A count of encoders without counts: a power of two, by which rounding rounds nothing that matters.
EXACT = 2.0**-500


def movable(loop: ClosedLoop) -> ClosedLoop:
    """Return a loop of which everything that a page moves is a number; its results have the same bits."""
    made = copy.copy(loop)
    made.plant = _add_sensors(loop.plant)
    made.controller = controller = copy.copy(loop.controller)
    # The nominal model for inertia and the one for what is fed forward; one may carry a load that the other
    # does not, and then they are two.
    for name, own in (("robot", "_dynamics"), ("bias_robot", "_bias")):
        robot = getattr(loop.controller, name, None)
        if robot is None:
            continue
        dynamics = robot.dynamics
        if not isinstance(dynamics, ScaledDynamics):
            dynamics = ScaledDynamics(dynamics, 1.0)
        scaled = ScaledDynamics(dynamics.base, np.array(dynamics.scale))
        object.__setattr__(controller, name, robot._with_attributes(dynamics=scaled))
        if hasattr(controller, own):
            object.__setattr__(controller, own, scaled)
    return made


def _add_sensors(plant: Plant) -> Plant:
    """Return a plant with a delay and drop-outs that are numbers."""
    late, lost, seed = 0, 0.0, 0
    chain: list[Wrapper] = []
    made: Plant = plant
    while isinstance(made, Wrapper):
        chain.append(made)
        made = made.plant
    for wrapper in reversed(chain):
        if isinstance(wrapper, Delayed):
            late = wrapper.samples
        elif isinstance(wrapper, DropOut):
            lost, seed = wrapper.probability, wrapper.seed
        else:
            made = _with(wrapper, plant=made)
    n = plant.robot.n
    made = _with(DropOut(made, 0.5, seed), probability=np.full(n, float(lost)))
    queue: Plant = _with(Delayed(made, 0, longest=LONGEST), samples=np.full(n, float(late)))
    return queue


def _with(thing: Any, **attributes: Any) -> Any:
    """Return a copy of something with other attributes."""
    made = copy.copy(thing)
    for name, value in attributes.items():
        object.__setattr__(made, name, value)
    return made


class Tape(NamedTuple):
    """Numbers that are worked out of others, one operation after the other.

    Attributes:
        inputs: places of the numbers that are given.
        constants: numbers that are always the same; they come after the inputs.
        steps: operation ("+", "-", "*", "/") and places of its two operands: inputs, constants, then results.
        outputs: place among all these, and of the number that it becomes.
    """

    inputs: list[int]
    constants: list[float]
    steps: list[tuple[str, int, int]]
    outputs: list[tuple[int, int]]


class Numbers(NamedTuple):
    """The numbers of a loop.

    Attributes:
        shared: of its parts.
        start: of the state at the start.
        seeds: of random numbers.
        tape: how some of them are worked out of others; None where none are.
    """

    shared: Array
    start: Array
    seeds: list[int]
    tape: Tape | None


class _Listing(Inventory):
    """Lists the numbers of a loop, and where each array's are."""

    def __init__(self, loop: ClosedLoop, state: Any) -> None:
        self.where: dict[int, range] = {}
        super().__init__(loop, state)

    def array(self, values: Array) -> Any:
        """List an array."""
        first = len(self.values.shared)
        listed = super().array(values)
        self.where[id(values)] = range(first, len(self.values.shared))
        return listed


def numbers(loop: ClosedLoop, tape: bool = True) -> Numbers:
    """Return the numbers of a loop, as prepared loops list them; with or without the tape."""
    listed = _Listing(loop, loop.init())
    found = listed.values
    noted = _tape(loop, listed.where) if tape else None
    return Numbers(np.array(found.shared), found.start[:, 0], found.seeds, noted)


class _Taped:
    """A number that notes what is done with it."""

    def __init__(self, steps: list[Any]) -> None:
        self.steps = steps

    def _note(self, operation: str, a: Any, b: Any) -> _Taped:
        made = _Taped(self.steps)
        self.steps.append((operation, a, b, made))
        return made

    def __add__(self, other: Any) -> _Taped:
        return self._note("+", self, other)

    def __radd__(self, other: Any) -> _Taped:
        return self._note("+", other, self)

    def __sub__(self, other: Any) -> _Taped:
        return self._note("-", self, other)

    def __rsub__(self, other: Any) -> _Taped:
        return self._note("-", other, self)

    def __mul__(self, other: Any) -> _Taped:
        return self._note("*", self, other)

    def __rmul__(self, other: Any) -> _Taped:
        return self._note("*", other, self)

    def __truediv__(self, other: Any) -> _Taped:
        return self._note("/", self, other)

    def __rtruediv__(self, other: Any) -> _Taped:
        return self._note("/", other, self)

    def __neg__(self) -> _Taped:
        return self._note("*", -1.0, self)


def _tape(loop: ClosedLoop, where: dict[int, range]) -> Tape | None:
    """Return how the gains of a controller come from its tuning; `where` has the places of its arrays."""
    controller = loop.controller
    if not isinstance(controller, GPI) or controller.gains.adaptive:
        return None
    steps: list[Any] = []
    given: list[tuple[int, _Taped]] = []

    def tape(values: Any) -> Any:
        """Return an array of numbers that note what is done with them."""
        if not isinstance(values, np.ndarray):
            return values
        made = [_Taped(steps) for _ in range(values.size)]
        given.extend(zip(where[id(values)], made, strict=True))
        return np.array(made, dtype=object)

    law: Any = copy.copy(controller._law)
    if (member := getattr(law, "member", None)) is not None:
        ratios = {name: tape(value) for name, value in vars(member).items() if isinstance(value, np.ndarray)}
        law.member = _with(member, **ratios)
    found = law.coefficients(Tuning(*map(tape, controller.gains.nominal())), controller.dt)
    operands = (x for step in steps for x in step[1:3] if not isinstance(x, _Taped))
    constants = list(dict.fromkeys(map(float, operands)))
    first = len(given)
    at = {value: first + i for i, value in enumerate(constants)}
    places = {id(number): i for i, (_, number) in enumerate(given)}
    made = []
    for operation, a, b, result in steps:
        made.append((operation, *(places[id(x)] if isinstance(x, _Taped) else at[float(x)] for x in (a, b))))
        places[id(result)] = first + len(constants) + len(made) - 1
    outputs = []
    for values, own in zip(found, controller._nominal, strict=True):
        if isinstance(own, np.ndarray):
            entries = np.broadcast_to(np.asarray(values, dtype=object), own.shape).ravel()
            named = zip(entries, where[id(own)], strict=True)
            outputs += [(places[id(x)], place) for x, place in named if id(x) in places]
    return Tape([place for place, _ in given], constants, made, outputs)
