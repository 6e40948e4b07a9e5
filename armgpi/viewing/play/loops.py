"""Loops whose numbers can all be moved, and the numbers of one.

A loop is changed so that what is a constant of its code becomes a number: the nominal model has a factor
even where it is 1, the delay is chosen among samples kept, measurements may be lost with probability 0. Each
of these is exact: the torque has the same bits.

Gains that a controller works out once of its tuning stay numbers of the loop. How they come from the tuning
is noted as a tape: the sums, products and quotients in NumPy's order, which a page does again.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from armgpi.base.arrays import Array
from armgpi.codegen.trace import Inventory, Trace, columns
from armgpi.control.force_limit import ForceLimit
from armgpi.gpi.gains import Tuning
from armgpi.gpi.law import GPI
from armgpi.loop.closed_loop import ClosedLoop
from armgpi.plants.plant import Plant, Wrapper
from armgpi.plants.sensors import Delayed, DropOut, Encoder
from armgpi.robot.dynamics import ScaledDynamics

#: Controls of what is a number of a movable loop alone.
SCALE, BITS = "controllers.0.inertia_scale", "plant.encoder_bits"
#: Parts of a loop, in the order of its trace.
PARTS = ("plant", "controller", "reference")
#: What a page can work out.
_OPERATIONS = {np.add: "+", np.subtract: "-", np.multiply: "*", np.divide: "/"}
#: Numbers of what the tool touches that a page moves; where a wall is stays, as it is drawn there.
_OF_CONTACTS = ("stiffness", "damping", "friction")
#: Longest delay of a page [samples].
LONGEST = 20
#: A count of encoders without counts: a power of two, by which rounding rounds nothing that matters.
EXACT = 2.0**-500


def movable(loop: ClosedLoop, rows: Mapping[str, Sequence[Any]] | None = None) -> ClosedLoop:
    """Return a loop of which everything that a page moves is a number; its results have the same bits.

    Args:
        loop: the loop.
        rows: what each of several rollouts has of the nominal model's factor, and of encoder bits, None for
            exact positions, by the ids of their controls.
    """
    rows = rows or {}
    made = copy.copy(loop)
    made.batch = next((len(values) for values in rows.values()), loop.batch)
    made.plant = _add_sensors(loop.plant, rows, made.batch)
    made.controller = _with_controller_numbers(loop.controller, rows)
    return made


def _with_controller_numbers(given: Any, rows: Mapping[str, Sequence[Any]]) -> Any:
    """Return a controller with a factor of its nominal model, and a force limit, that are numbers."""
    controller = copy.copy(given)
    law = getattr(given, "law", given)  # it may have a force limit around it
    if law is not given:
        object.__setattr__(controller, "law", _with_controller_numbers(law, rows))
    # The nominal model for inertia and the one for what is fed forward; one may carry a load that the other
    # does not, and then they are two.
    for name, own in (("robot", "_dynamics"), ("bias_robot", "_bias")):
        robot = getattr(given, name, None)
        if robot is None:
            continue
        dynamics = robot.dynamics
        if not isinstance(dynamics, ScaledDynamics):
            dynamics = ScaledDynamics(dynamics, 1.0)
        scale = np.array(dynamics.scale)
        if SCALE in rows and (name == "robot" or vars(law)["_as_given"].get(name) is None):
            scale = np.array(rows[SCALE])[:, None]
        scaled = ScaledDynamics(dynamics.base, scale)
        object.__setattr__(controller, name, robot._with_attributes(dynamics=scaled))
        if hasattr(controller, own):
            object.__setattr__(controller, own, scaled)
    if hasattr(controller, "_known"):
        object.__setattr__(controller, "_known", controller.bias_robot.dynamics)
    for name, limit in vars(given).items():
        if isinstance(limit, ForceLimit):
            numbers = {key: np.atleast_1d(getattr(limit, key)) for key in ("force", "moment")}
            object.__setattr__(controller, name, _with(limit, **numbers))
    return controller


def _add_sensors(plant: Plant, rows: Mapping[str, Sequence[Any]], batch: int | None) -> Plant:
    """Return a plant with a delay and drop-outs that are numbers; all rollouts draw what the first does."""
    late: Any = 0
    lost: Any = 0.0
    seed = 0
    chain: list[Wrapper] = []
    made: Plant = plant
    while isinstance(made, Wrapper):
        chain.append(made)
        made = made.plant
    made = _with_contact_numbers(made)
    for wrapper in reversed(chain):
        if isinstance(wrapper, Delayed):
            late = wrapper.samples
        elif isinstance(wrapper, DropOut):
            lost, seed = wrapper.probability, wrapper.seed
        else:
            made = _with(wrapper, plant=made)
            if batch is not None and hasattr(made, "seed"):
                made = _with(made, seed=np.full((batch, 1), made.seed % 2**64, dtype=np.uint64))
            if isinstance(wrapper, Encoder) and BITS in rows:
                bits = np.array(rows[BITS], dtype=float)[:, None]  # None is NaN
                made = _with(made, step_size=np.nan_to_num(wrapper.robot.encoder_count(bits), nan=EXACT))

    none = np.zeros(plant.robot.n)
    made = _with(DropOut(made, 0.5, seed), probability=lost + none)
    queue: Plant = _with(Delayed(made, 0, longest=LONGEST), samples=late + none)
    return queue


def _with_contact_numbers(arm: Any) -> Any:
    """Return the arm of a plant, with numbers of what it touches as arrays, which are no constants."""
    surroundings = getattr(arm, "_surroundings", None)
    if surroundings is None:
        return arm
    contacts = []
    for contact in surroundings.contacts:
        own = {name: np.atleast_1d(vars(contact)[name]) for name in _OF_CONTACTS if name in vars(contact)}
        contacts.append(_with(contact, **own))
    touched = tuple(contacts)
    return _with(arm, environment=touched, _surroundings=_with(surroundings, contacts=touched))


def _with(thing: Any, **attributes: Any) -> Any:
    """Return a copy of something with other attributes."""
    made = copy.copy(thing)
    for name, value in attributes.items():
        object.__setattr__(made, name, value)
    return made


class Tape(NamedTuple):
    """Numbers that are worked out of others, one operation after the other.

    Attributes:
        steps: "place" and that of a number that is given, "number" and a constant, or an operation ("+", "-",
            "*", "/") and the steps of its two operands.
        outputs: a step, and the place of the number that its result is.
    """

    steps: list[tuple[Any, ...]]
    outputs: list[tuple[int, int]]


class Listing(Inventory):
    """Lists the numbers of a loop in the order of its trace.

    Attributes:
        arrays: what they are in, by the way to it.
        start: those of the state at the start, shape (rollouts or 1, s).
    """

    anew = False  # a loop by the door has the numbers of one that was made with them

    def __init__(self, loop: ClosedLoop, parts: Sequence[str] = PARTS) -> None:
        """List the numbers of parts of a loop, and those that it starts with."""
        self.arrays: dict[Any, Array] = {}
        state = loop.init()
        self.start = columns(state[1:], loop.true_state(state).q.shape[:-1]).T
        super(Inventory, self).__init__(Trace(loop.plant.robot.n), 1)
        self.structure = []
        for part in parts:
            if part != "reference" or loop.reference.symbolic:
                self._below(part, getattr(loop, part), False)

    def array(self, values: Array) -> Any:
        """List an array."""
        self.arrays[self.place] = values
        return super().array(values)

    def places(self) -> dict[Any, range]:
        """Return where the numbers of each array are among those that all rollouts share."""
        found, end = {}, 0
        for way, array in self.arrays.items():
            if self.kind(array) == "shared":
                found[way] = range(end, end := end + array.size)
        return found


class _Taped(NDArrayOperatorsMixin):
    """A number that notes what is done with it."""

    def __init__(self, steps: list[tuple[Any, ...]], *step: Any) -> None:
        self.steps, self.at = steps, len(steps)
        steps.append(step)

    def __array_ufunc__(self, ufunc: Any, method: str, *operands: Any) -> _Taped:
        if ufunc is np.negative:
            ufunc, operands = np.multiply, (-1.0, *operands)
        numbers = (x if isinstance(x, _Taped) else _Taped(self.steps, "number", float(x)) for x in operands)
        at = [number.at for number in numbers]
        return _Taped(self.steps, _OPERATIONS[ufunc], *at)


def tape_of(loop: ClosedLoop, listed: Listing) -> Tape | None:
    """Return how the gains of a loop's controller come from its tuning; None where they do not."""
    controller = loop.controller
    if not isinstance(controller, GPI) or controller.gains.adaptive:
        return None
    where = {id(listed.arrays[way]): places for way, places in listed.places().items()}
    tape = Tape([], [])

    def note(values: Any) -> Any:
        """Return an array of numbers that note what is done with them."""
        if not isinstance(values, np.ndarray):
            return values
        return np.array([_Taped(tape.steps, "place", at) for at in where[id(values)]], dtype=object)

    law: Any = copy.copy(controller._law)
    if (member := getattr(law, "member", None)) is not None:
        ratios = {name: note(value) for name, value in vars(member).items() if isinstance(value, np.ndarray)}
        law.member = _with(member, **ratios)
    found = law.coefficients(Tuning(*map(note, controller.gains.nominal())), controller.dt)
    for values, own in zip(found, controller._nominal, strict=True):
        if isinstance(own, np.ndarray):
            entries = np.broadcast_to(np.asarray(values, dtype=object), own.shape).ravel()
            named = zip(entries, where[id(own)], strict=True)
            tape.outputs.extend((x.at, place) for x, place in named if isinstance(x, _Taped))
    return tape
