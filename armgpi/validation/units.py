"""Does a repair hold for other numbers, and has it right units? No declarations: the robot's numbers say it.

A mass of the model is a mass of the robot: if it is another one, some robot with other masses, and the same
lengths and inertias, moves as the model says. So the derivative of all that a right model gives by one of its
numbers is a sum of the robot's derivatives by numbers of one unit. In a repair that agrees at the numbers of
the file alone, such as ``m2`` for ``m2 * l1 ** 2`` where a length is 1, that by the length is none.
"""

from __future__ import annotations

import ast
import itertools
import re
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeGuard

import numpy as np

from armgpi.base.arrays import Array

#: Step of a derivative, of the number itself; what it leaves out is far below what counts as the same, and so
#: is what the rounding of finite differences leaves.
STEP = 1e-3
#: A derivative is such a sum up to this, relative.
_SAME = 1e-5
#: The same of accelerations, where the step of a number leaves more.
_SAME_CURVED = 1e-3
#: Numbers of a model that are looked at, at most.
_MOST = 30
#: Numbers of the robot that one of the model may be, at most: Ixx, Iyy and Izz of two links.
_ALIKE = 6
#: A name with a number in it: m1, lc2, I_3.
_FAMILY = re.compile(r"(.*?)_?(\d+)$")
#: Before the unit of what a link's number is where the model takes it apart: a motor sits at its end.
JOINED = "joined "
#: Before the name of a frame of a link, of derivatives by how all behind it is turned and moved.
TURNED = "turned "
#: Angles of a robot's geometry are multiples of this [deg].
_ANGLES = 15.0
#: They are at least so large [deg].
_LEAST_ANGLE = 30.0
#: They are known up to this [deg].
_SAME_ANGLE = 1e-3
#: Where Ixx, Iyy, Izz, Ixy, Ixz, Iyz stand in an inertia tensor.
_ROWS = (0, 1, 2, 0, 0, 1)
_COLUMNS = (0, 1, 2, 1, 2, 2)
#: Both directions of each axis, with its number.
_AXES = tuple((k, sign * np.eye(3)[k]) for k in range(3) for sign in (1.0, -1.0))
#: Coefficients that a formula may have, without a name.
USUAL = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 9.81, 9.8, 9.80665)


class BodySlopes(NamedTuple):
    """Derivatives of what an arm gives by a body of a link, in which it is linear.

    Attributes:
        link: the link, from 0.
        mass: by a mass at the origin of the joint's frame, (values,).
        first: by the first moments, (values, 3).
        moments: by Ixx, Iyy, Izz, Ixy, Ixz, Iyz about that origin, (values, 6).
        places: where a mass may be, without a number of its own [m], each (3,).
    """

    link: int
    mass: Array
    first: Array
    moments: Array
    places: tuple[Array, ...]

    def of_point(self, place: Array) -> Array:
        """Return the derivative by a mass at a place [m], (values,)."""
        of_moments = self.moments @ moments_of_point(place)
        return np.asarray(self.mass + self.first @ place + of_moments)

    def of_coordinate(self, place: Array, k: int) -> Array:
        """Return the derivative of that by a coordinate of the place."""
        of_moments = self.moments @ slope_of_moments(place, k)
        return np.asarray(self.first[:, k] + of_moments)


def moments_of_point(place: Array) -> Array:
    """Return Ixx, Iyy, Izz, Ixy, Ixz, Iyz of a mass of one at a place, about the origin [m²], (6,)."""
    distance_squared = float(place @ place)
    tensor = distance_squared * np.eye(3) - np.outer(place, place)
    return np.asarray(tensor[_ROWS, _COLUMNS])


def slope_of_moments(place: Array, k: int) -> Array:
    """Return the derivative of `moments_of_point` by a coordinate [m], (6,), which is exact for any step."""
    step = np.eye(3)[k]
    ahead = moments_of_point(place + step)
    behind = moments_of_point(place - step)
    return np.asarray(0.5 * (ahead - behind))


class Slopes(NamedTuple):
    """Derivatives of what an arm gives by its numbers.

    Attributes:
        names: the functions whose values are stacked, each in units of its largest value.
        sizes: these largest values.
        bases: orthonormal columns that span the derivatives by numbers of one unit and link (None: of all).
        values: the robot's numbers.
        units: their units.
        links: the links that they belong to, from 0; gravity's is -1.
        columns: the derivatives by them, (values, count).
        noise: what the rounding of a model's values leaves of a derivative: of finite differences, say.
        curved: whether the values are fractions of the numbers: accelerations, of which D is not known.
        bodies: the derivatives by what the links' bodies are made of.
    """

    names: tuple[str, ...]
    sizes: tuple[float, ...]
    bases: Mapping[tuple[str, int | None], Array]
    values: Array
    units: tuple[str, ...]
    links: tuple[int, ...]
    columns: Array
    noise: float = 0.0
    curved: bool = False
    bodies: tuple[BodySlopes, ...] = ()

    def same(self, rest: Array, column: Array) -> bool:
        """Tell whether what is left of a derivative is nothing."""
        least = self.noise * np.sqrt(len(column))
        share = _SAME_CURVED if self.curved else _SAME
        bound = share * np.linalg.norm(column) + least
        return bool(np.linalg.norm(rest) <= bound)

    def of(self, column: Array, stated: Sequence[float]) -> set[int | None]:
        """Return the links whose numbers of one unit give a derivative, with None if those of all give it.

        A link whose mass is none of those that the model states may be joined of several bodies there.
        """
        whole_links = set[int]()
        for link, unit, value in zip(self.links, self.units, self.values, strict=True):
            if unit == "kg" and np.isclose(value, stated, rtol=1e-6).any():
                whole_links.add(link)
        links = set[int | None]()
        for (unit, of_link), basis in self.bases.items():
            if unit.startswith(JOINED) and of_link in whole_links:
                continue
            if not unit.startswith(TURNED) and self._is_spanned(column, basis):
                links.add(of_link)
        return links

    def _is_spanned(self, column: Array, basis: Array) -> bool:
        """Tell whether a derivative is a sum of orthonormal columns."""
        return self.same(column - basis @ (basis.T @ column), column)

    def alike(self, value: float, share: float = 1.0) -> list[int]:
        """Return which of the robot's numbers are a share of a value, up to the sign, and are felt."""
        sizes = np.abs(self.values)
        near = np.abs(sizes - share * abs(value)) <= 1e-6 * abs(value)
        felt = np.abs(self.columns).max(axis=0) * sizes > 1e-7
        return [int(j) for j in np.flatnonzero(near & felt)]

    def _alike_or_half(self, value: float) -> list[int]:
        """Return those that are a value, then those that are half of it, as the centre of mass of a rod."""
        return [*self.alike(value), *self.alike(value, 0.5)]

    def _of_one_unit(self, numbers: Sequence[int], least: int = 1) -> Iterator[tuple[int, ...]]:
        """Yield choices of at least so many of the robot's numbers, of one unit, smaller ones first."""
        for size in range(least, min(len(numbers), _ALIKE) + 1):
            for chosen in itertools.combinations(numbers, size):
                if len({self.units[j] for j in chosen}) <= 1:
                    yield chosen

    def _moved(self, chosen: Sequence[int]) -> Array:
        """Return the derivative by the share by which some of the robot's numbers change, (values,)."""
        return np.asarray(self.columns[:, chosen] @ self.values[list(chosen)])

    def _rates(self, chosen: Sequence[int], value: float, power: float = 1.0) -> dict[int, float]:
        """Return how the robot's numbers change with a model's number of that value, as a power of it."""
        return {j: power * float(self.values[j]) / value for j in chosen}

    def standing(self, column: Array, value: float, used: Container[int] = ()) -> dict[int, float]:
        """Return the robot's numbers that a model's is, others than those used, and their changes by it.

        All of them change by the same share as it does. A length may move one more, as far as it grows: what
        is counted from its end, as in the frames of Denavit and Hartenberg.
        """
        alike = [j for j in self._alike_or_half(value) if j not in used]
        for chosen in self._of_one_unit(alike):
            unit = self.units[chosen[0]]
            rates = self._rates(chosen, value)
            rest = column - self._moved(chosen)
            if self.same(rest, column):
                return rates
            if scaled := self._with_inertias(rest, column, unit, value):
                return {**rates, **scaled}
            if unit == "m" and (moved := self._one_more(rest, column, value, chosen)):
                return {**rates, **moved}
        return {}

    def _with_inertias(self, rest: Array, column: Array, unit: str, value: float) -> dict[int, float]:
        """Return the inertias that follow from a mass or a length, as m a²/12, and their changes by it."""
        power = {"kg": 1.0, "m": 2.0}.get(unit)
        if power is None:
            return {}
        groups = [inertias for inertias in self._inertias_of_links() if self._are_felt(inertias)]
        if not groups:
            return {}
        matrix = np.stack([self._moved(inertias) for inertias in groups], axis=-1)
        shares = np.linalg.lstsq(matrix, rest, rcond=1e-12)[0]
        is_moved = np.isclose(shares, power, rtol=1e-4)
        is_still = np.abs(shares) < 1e-4
        if not (is_moved | is_still).all():
            return {}
        exact_shares = power * np.round(shares / power)
        if not self.same(rest - matrix @ exact_shares, column):
            return {}
        rates: dict[int, float] = {}
        for inertias, share in zip(groups, shares, strict=True):
            if share > 0.5:
                rates |= self._rates(inertias, value, power)
        return rates

    def _inertias_of_links(self) -> list[list[int]]:
        """Return which of the robot's numbers are the inertias of each link that are not zero."""
        of_links: dict[int, list[int]] = {}
        for j, unit in enumerate(self.units):
            if unit == "kg m²" and self.values[j]:
                of_links.setdefault(self.links[j], []).append(j)
        return [*of_links.values()]

    def _are_felt(self, chosen: Sequence[int]) -> bool:
        """Tell whether anything depends on one of the robot's numbers."""
        return bool(np.abs(self.columns[:, chosen]).max() > 1e-9)

    def explained_with_inertias(self, column: Array, value: float) -> bool:
        """Tell whether numbers of that value, and any inertias, give a derivative: a cylinder's length."""
        columns = [self.columns[:, j] for j, unit in enumerate(self.units) if unit == "kg m²"]
        basis = span(columns) if columns else np.zeros((len(column), 0))
        for chosen in self._of_one_unit(self._alike_or_half(value), least=0):
            rest = column - self._moved(chosen)
            if self.same(rest - basis @ (basis.T @ rest), column):
                return True
        return False

    def link_of_part(self, column: Array, value: float, stated: Sequence[float]) -> int | None:
        """Return the link of which a number is of a part: a load, or a lever of one, that the robot joins.

        The derivative then is exactly that by a mass at a place, or by its place, where the places are those
        of the model's other numbers along the axes. None where it is nothing like that.
        """
        sizes = [*dict.fromkeys(abs(x) for x in stated if x)]
        on_axes = [size * axis for size in sizes for _, axis in _AXES]
        for body in self.bodies:
            for place in (*body.places, *on_axes):
                if self.same(column - value * body.of_point(place), column):
                    return body.link
            for k, axis in _AXES:
                lever = abs(value) * axis
                by_lever = body.of_coordinate(lever, k) * lever[k]
                if any(self.same(column - mass * by_lever, column) for mass in sizes):
                    return body.link
        return None

    def link_turned(self, column: Array) -> int | None:
        """Return the link of which a derivative is that by a turn of all behind it, None without one."""
        for (unit, link), basis in self.bases.items():
            if unit.startswith(TURNED) and self._is_spanned(column, basis):
                return link
        return None

    def nearest(self, column: Array, value: float, used: Container[int]) -> dict[int, float]:
        """Return the robot's numbers that come nearest to a model's, and how they change with it.

        A mistake has the number in a wrong place: what it is has to be guessed by the other places, so that
        as many values as possible move as they should. There may be none.
        """
        largest = float(np.abs(column).max())
        least = max(1e-5 * largest, self.noise)

        def missed(moved: Array) -> int:
            return int(np.count_nonzero(np.abs(column - moved) > least))

        fewest_missed = missed(np.zeros_like(column))
        rates: dict[int, float] = {}
        alike = [j for j in self.alike(value) if j not in used]
        for chosen in self._of_one_unit(alike):
            count = missed(self._moved(chosen))
            if count < fewest_missed:
                fewest_missed = count
                rates = self._rates(chosen, value)
        return rates

    def _one_more(
        self, rest: Array, column: Array, value: float, chosen: tuple[int, ...]
    ) -> dict[int, float]:
        """Return the one length that moves as well, and which way."""
        for j, unit in enumerate(self.units):
            if unit != "m" or j in chosen:
                continue
            for direction in (1.0, -1.0):
                moved = direction * value * self.columns[:, j]
                if self.same(rest - moved, column):
                    return {j: direction}
        return {}


def is_angle(value: float) -> bool:
    """Tell whether a number may be an angle of a robot's geometry, in degrees or radians: 90, -1.5708."""
    for degrees in (abs(value), abs(float(np.rad2deg(value)))):
        nearest = _ANGLES * round(degrees / _ANGLES)
        if nearest >= _LEAST_ANGLE and abs(degrees - nearest) <= _SAME_ANGLE:
            return True
    return False


def states_angles(source: str) -> bool:
    """Tell whether a source states a number that may be an angle of the robot's geometry."""
    values = (float(ast.literal_eval(node)) for _, node in numbers(ast.parse(source)))
    return any(map(is_angle, values))


class Check(NamedTuple):
    """What a model's numbers are in the robot.

    Attributes:
        wrong: how many mean nothing in the robot.
        other: how many are not what is as large in the robot.
        seen: how many were looked at.
        sure: whether each is of one link, families such as m1, m2 are in the links' order, and all are used.
        standing: place among the numbers -> the robot's numbers that it is, and how they change with it.
    """

    wrong: int
    other: int
    seen: int
    sure: bool
    standing: Mapping[int, Mapping[int, float]]
    names: tuple[str, ...] = ()  # of the numbers that mean nothing in the robot, whatever follows from them


def span(columns: Sequence[Array]) -> Array:
    """Return orthonormal columns of what some columns span."""
    matrix = np.stack(columns, axis=-1)
    lengths = np.linalg.norm(matrix, axis=0)
    matrix = matrix / np.maximum(lengths, 1e-12)
    directions, sizes, _ = np.linalg.svd(matrix, full_matrices=False)
    return np.asarray(directions[:, sizes > 1e-6])


def check(
    source: str,
    values: Callable[[str], Array | None],
    known: Slopes,
    text: str = "",
    whole: bool = False,
) -> Check:
    """Return what the numbers of a source are in the robot.

    Args:
        source: a model that agrees with the robot.
        values: gives what a changed source gives, as in `known`; None when it does not work.
        known: the robot's derivatives.
        text: what was changed: the numbers named in it are looked at first, the others where these are right.
        whole: look at all numbers, also where one is found to be none of the robot's.
    """
    tree = ast.parse(source)
    named = grouped_numbers(tree)
    stated = [float(ast.literal_eval(places[0])) for _, places in named]
    checked = _Checked(known, stated)
    changed_words = set(re.findall(r"\w+", text))

    def is_unchanged(k: int) -> bool:
        name = named[k][0]
        return re.findall(r"\w+", name)[-1] not in changed_words

    # The sort is stable: the others in their order.
    for k in sorted(range(min(len(named), _MOST)), key=is_unchanged):
        if not whole and checked.wrong + checked.other > 0 and is_unchanged(k):
            break
        name, places = named[k]
        if stated[k] == 0.0 or name in ("n", "N"):
            continue
        slope = _central_difference(source, places, stated[k], values)
        if slope is not None:
            checked.add(k, name, slope)
    if whole:
        checked.guess()
    all_seen = len(named) <= _MOST and not _bare(tree, named) and not _unseen(tree)
    return Check(
        wrong=checked.wrong,
        other=checked.other,
        seen=checked.seen,
        sure=all_seen and checked.is_sure(),
        standing=checked.standing,
        names=tuple(dict.fromkeys([*checked.odd, *checked.mixed()])),
    )


def _central_difference(
    source: str, places: Sequence[ast.Constant], value: float, values: Callable[[str], Array | None]
) -> Array | None:
    """Return the derivative by the share by which a number changes; None where a source does not work."""

    def at(changed: float) -> Array | None:
        return values(with_numbers(source, [(node, changed) for node in places]))

    ahead = at(value * (1.0 + STEP))
    behind = at(value * (1.0 - STEP))
    if ahead is None or behind is None:
        return None
    return np.asarray((ahead - behind) / (2.0 * STEP))


class _Checked:
    """The numbers of a model that were looked at, and what they are in the robot; see :class:`Check`."""

    def __init__(self, known: Slopes, stated: list[float]) -> None:
        """Take the robot's derivatives, and all numbers that the model states."""
        self.known = known
        self.stated = stated
        self.wrong = 0
        self.other = 0
        self.seen = 0
        self.standing: dict[int, dict[int, float]] = {}
        self.odd: list[str] = []
        self._linked = True  # whether each is of a link
        self._joined = False  # whether some are of parts that the robot joins
        self._unexplained: dict[int, Array] = {}  # derivatives by numbers that are none of the robot's alone
        self._used = set[int]()  # the robot's numbers that the model's are
        self._halves = set[int]()  # those of these of which the model states the double
        self._unused: list[float] = []  # the model's numbers that nothing depends on
        #: Inertias that follow from masses and lengths, and from which number.
        self._scaled: dict[int, str] = {}
        #: Letter of a family -> the places of its numbers in it, each with its link.
        self._families: dict[str, list[tuple[int, int]]] = {}
        #: Letter of a family -> the units of the robot's numbers that its numbers are.
        self._units: dict[str, set[str]] = {}

    def add(self, k: int, name: str, column: Array) -> None:
        """Take the derivative of all that the model gives by a number."""
        known, value = self.known, self.stated[k]
        if np.abs(column).max() < max(1e-7, known.noise):  # nothing depends on it
            self._unused.append(value)
            return
        self.seen += 1
        rates = known.standing(column, value, self._used)
        if rates:
            self.standing[k] = rates
            links = self._links_of_standing(name, value, rates)
        elif (part := known.link_of_part(column, value, self.stated)) is not None:
            # The robot has one body there, of which no number alone is this one: nothing is varied with it.
            self._joined = True
            links = {part}
        elif (turned := self._link_turned(value, column)) is not None:
            # The twist of a row of Denavit and Hartenberg: no number of the robot alone, and it stays.
            links = {turned}
        else:
            links = self._links_of_unexplained(k, name, column)
        family = _FAMILY.match(name.strip("'"))
        letter = family[1] if family else name
        place = int(family[2]) if family else k
        self._families.setdefault(letter, []).append((place, min(links, default=0)))
        units = self._units.setdefault(letter, set())
        units.update(known.units[j] for j in rates)

    def _link_turned(self, value: float, column: Array) -> int | None:
        """Return the link that an angle turns; None for what is no angle, or is a number of the robot."""
        if self.known.alike(value) or not is_angle(value):
            return None
        return self.known.link_turned(column)

    def _links_of_standing(self, name: str, value: float, rates: Mapping[int, float]) -> set[int]:
        """Keep what follows from a number that is some of the robot's, and return their links."""
        whole = set(self.known.alike(value))
        halves = set(self.known.alike(value, 0.5))
        stated = {*rates} & (whole | halves)
        self._used |= stated
        self._halves |= stated - whole
        for j in {*rates} - stated:
            if self.known.units[j] == "kg m²":
                self._scaled[j] = name
        return {self.known.links[j] for j in stated}

    def _links_of_unexplained(self, k: int, name: str, column: Array) -> set[int]:
        """Count a number that is none of the robot's alone, and return the links whose numbers explain it."""
        known, value = self.known, self.stated[k]
        self._unexplained[k] = column
        links_or_all = known.of(column, self.stated)
        alike = known.alike(value)
        self.wrong += not links_or_all
        self.other += bool(alike)
        if alike and not links_or_all and not known.explained_with_inertias(column, value):
            self.odd.append(name)
        links = {link for link in links_or_all if link is not None}
        self._linked = self._linked and bool(links)
        return links

    def guess(self) -> None:
        """Take each number that is none of the robot's alone for those of its value that are nearest."""
        for k, column in self._unexplained.items():
            rates = self.known.nearest(column, self.stated[k], self._used)
            self.standing[k] = rates
            self._used |= {*rates}

    def mixed(self) -> list[str]:
        """Return the numbers with which an inertia moves that is a number of its own as well."""
        return [name for j, name in self._scaled.items() if j in self._used]

    def is_sure(self) -> bool:
        """Tell whether each is of one link, families are in the links' order, and none may be forgotten."""
        # A number that is read nowhere may be what stands at half of another one: lc1, and l1 / 2.
        used = self._used - self._halves
        may_be_forgotten = any(set(self.known.alike(value)) - used for value in self._unused)
        return (
            self._linked
            and not self._joined
            and not self.mixed()
            and not may_be_forgotten
            and self._are_families_in_order()
        )

    def _are_families_in_order(self) -> bool:
        """Tell whether the numbers of each family, m1, m2 and so on, are of the links in their order."""
        for letter, numbers_of_family in self._families.items():
            # A list of numbers of several units is one of all parameters, in any order.
            if len(self._units[letter]) > 1:
                continue
            links = [link for _, link in sorted(numbers_of_family)]
            if links != sorted(links):
                return False
        return True


def _bare(tree: ast.AST, named: Sequence[tuple[str, Sequence[ast.Constant]]]) -> bool:
    """Tell whether a source has numbers without a name that are no usual coefficients."""
    with_name = {node for _, places in named for node in places}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Constant) or type(node.value) is not float:
            continue
        if node not in with_name and node.value not in USUAL:
            return True
    return False


#: Calls whose arguments are the numbers themselves; a name with a capital is a class, such as a record.
_HOLDERS = ("array", "asarray", "diag", "list", "tuple")
#: Calls that make numbers of which none stands in the source.
_MAKERS = (
    "ones",
    "full",
    "linspace",
    "repeat",
    "tile",
    "loadtxt",
    "genfromtxt",
    "load",
    "eye",
)
#: What a name of a module may have as its number.
_NUMBERS = (int, float, np.floating, np.integer)
#: A name, and what it is given; None where a function has no default.
Named = tuple[str, ast.expr | None]


def numbers(tree: ast.AST) -> Iterator[tuple[str, ast.Constant]]:
    """Yield numbers of a source that have a name: assigned, items, arguments, defaults, entries of arrays."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    in_functions = {node for function in functions for node in ast.walk(function)}
    named: list[Named] = []
    for node in ast.walk(tree):
        named += _named_by(node, functions, node in in_functions)
    yielded = set[ast.Constant]()  # several functions may unpack the same numbers
    for name, value in named:
        number = _without_sign(value)
        if _is_number(number) and number not in yielded:
            yielded.add(number)
            yield name, number


def _named_by(node: ast.AST, functions: Sequence[ast.FunctionDef], in_function: bool) -> list[Named]:
    """Return what a statement, a mapping, a call or a function's arguments give a name, numbers or not."""
    match node:
        case ast.Assign(targets=[target], value=value):
            returned = _returned(value, functions)
            if returned:
                return _leaves(target, returned)
            choosing = in_function and not isinstance(value, ast.Constant)
            return _selected(_leaves(target, value), choosing)
        case ast.AnnAssign(target=target, value=ast.expr() as value):
            return _leaves(target, value)
        case ast.Dict(keys=keys, values=values):
            named: list[Named] = []
            for key, item in zip(keys, values, strict=True):
                named += _leaves(key, item) if key is not None else []
            return named
        case ast.Call(func=function, keywords=words):
            return _of_keywords(function, words)
        case ast.arguments():
            return _of_defaults(node)
    return []


def _without_sign(value: ast.expr | None) -> ast.expr | None:
    """Return what a sign stands before: the number 0.3 of -0.3."""
    return value.operand if isinstance(value, ast.UnaryOp) else value


def _is_number(value: ast.expr | None) -> TypeGuard[ast.Constant]:
    """Tell whether an expression is a number; True and False are none."""
    return isinstance(value, ast.Constant) and type(value.value) in (int, float)


def _returned(value: ast.expr, functions: Sequence[ast.FunctionDef]) -> ast.Tuple | None:
    """Return what a call without arguments gives where that is all that its function says: several values."""
    match value:
        case ast.Call(func=ast.Name(id=name), args=[], keywords=[]):
            called = next((function for function in functions if function.name == name), None)
        case _:
            return None
    if called is None:
        return None
    match [statement for statement in called.body if not isinstance(statement, ast.Expr)]:
        case [ast.Return(value=ast.Tuple() as returned)]:
            return returned
    return None


def grouped_numbers(tree: ast.AST) -> list[tuple[str, tuple[ast.Constant, ...]]]:
    """Return the numbers of a source, each with where it stands: defaults of several functions are one."""
    of_functions = set[ast.expr | None]()
    for node in ast.walk(tree):
        if isinstance(node, ast.arguments):
            of_functions.update(_defaults(node))
    places_of_defaults: dict[tuple[str, float], list[ast.Constant]] = {}
    grouped: list[tuple[str, list[ast.Constant]]] = []
    for name, number in numbers(tree):
        key = (name, float(ast.literal_eval(number)))
        is_default = number in of_functions
        if is_default and key in places_of_defaults:
            places_of_defaults[key].append(number)
            continue
        places = [number]
        grouped.append((name, places))
        if is_default:
            places_of_defaults[key] = places
    return [(name, tuple(places)) for name, places in grouped]


def _defaults(arguments: ast.arguments) -> list[ast.expr | None]:
    """Return the default values of a function, without their signs."""
    defaults = [*arguments.defaults, *arguments.kw_defaults]
    return [_without_sign(value) for value in defaults if value is not None]


def _of_defaults(arguments: ast.arguments) -> list[Named]:
    """Return the default values of a function with their names."""
    positional = [*arguments.posonlyargs, *arguments.args]
    first = len(positional) - len(arguments.defaults)
    with_default = [*positional[first:], *arguments.kwonlyargs]
    defaults = [*arguments.defaults, *arguments.kw_defaults]
    return [(argument.arg, value) for argument, value in zip(with_default, defaults, strict=True)]


def _of_keywords(function: ast.expr, words: list[ast.keyword]) -> list[Named]:
    """Return the numbers that a call is given by name; lists in other calls are shapes or axes."""
    keeps = _is_holder(function) or ast.unparse(function) == "dict"
    named: list[Named] = []
    for word in words:
        if word.arg is None:  # **others
            continue
        if keeps:
            named += _leaves(ast.Name(word.arg), word.value)
        else:
            named.append((word.arg, word.value))
    return named


def _selected(leaves: list[Named], of_function: bool) -> list[Named]:
    """Return constants without those of the arrays of ones that a function makes, which choose and add."""
    if not of_function:
        return leaves
    return [(name, value) for name, value in leaves if getattr(value, "value", None) not in (0, 1)]


def _leaves(target: ast.expr, value: ast.expr) -> list[Named]:
    """Return the constants that a target is given, each with its name."""
    pairs: list[tuple[ast.expr, ast.expr]]
    match target, value:
        case ast.Tuple(elts=targets), ast.Tuple(elts=values) if len(targets) == len(values):
            pairs = list(zip(targets, values, strict=True))
        case ast.Tuple() | ast.Subscript(), _:
            pairs = []
        case _, ast.List(elts=values) | ast.Tuple(elts=values):
            pairs = [(target, entry) for entry in _without_directions(values)]
        case _, ast.Call(func=function, args=arguments) if _is_holder(function):
            pairs = [(target, entry) for entry in arguments]
        case _:
            return [(ast.unparse(target), value)]
    leaves: list[Named] = []
    for of_target, entry in pairs:
        leaves += _leaves(of_target, entry)
    return leaves


def _without_directions(values: list[ast.expr]) -> list[ast.expr]:
    """Return the entries of a list; of a unit vector, or of a row of a rotation, no ones and zeros."""
    constants = [_without_sign(value) for value in values]
    if all(isinstance(x, ast.Constant) and x.value for x in constants):
        return values
    entries = []
    for value, constant in zip(values, constants, strict=True):
        if not isinstance(constant, ast.Constant) or constant.value not in (0, 1):
            entries.append(value)
    return entries


def _is_holder(function: ast.expr) -> bool:
    """Tell whether a call only keeps its arguments: an array, or a record of a class."""
    name = ast.unparse(function).split(".")[-1]
    return name in _HOLDERS or name[:1].isupper()


def _unseen(tree: ast.Module) -> bool:
    """Tell whether names are given numbers that are not seen: several at once, or from a call alone."""
    functions = [statement for statement in tree.body if isinstance(statement, ast.FunctionDef)]
    making = {*_MAKERS, *(function.name for function in functions)}
    for node in ast.walk(tree):
        if any(map(_is_worked_out, _given(node))):
            return True
        if not isinstance(node, ast.Assign) or _returned(node.value, functions):
            continue
        constant = _without_sign(node.value)
        if len(node.targets) > 1 and isinstance(constant, ast.Constant) and constant.value:
            return True
        if _is_independent(node.value) and making & _called_names(node.value):
            return True
    return False


def _called_names(value: ast.expr) -> set[str]:
    """Return the names of the functions that an expression calls, without those of their modules."""
    calls = (node for node in ast.walk(value) if isinstance(node, ast.Call))
    return {ast.unparse(call.func).split(".")[-1] for call in calls}


def _given(node: ast.AST) -> Sequence[ast.expr | None]:
    """Return what a statement gives to names, a mapping to its keys, or a function to its arguments."""
    match node:
        case ast.Assign(value=ast.Tuple(elts=values)):
            return values
        case ast.Dict(values=values):
            return values
        case ast.Assign(value=value) | ast.AnnAssign(value=value):
            return [value]
        case ast.arguments():
            return [*node.defaults, *node.kw_defaults]
    return []


def _is_worked_out(value: ast.expr | None) -> bool:
    """Tell whether a value is numbers alone that are put together, as 1 / 12, and no usual coefficient."""
    if not isinstance(value, ast.BinOp):
        return False
    arithmetic = ast.BinOp | ast.UnaryOp | ast.Constant | ast.operator | ast.unaryop
    if not all(isinstance(node, arithmetic) for node in ast.walk(value)):
        return False
    above, below = _constant(value.left), _constant(value.right)
    if not isinstance(value.op, ast.Div) or above is None or below is None:
        return True
    return below == 0 or above / below not in USUAL


def _constant(value: ast.expr) -> float | None:
    """Return the value of a number; None for any other expression."""
    match value:
        case ast.Constant(int() | float() as number):
            return number
    return None


def _is_independent(value: ast.expr) -> bool:
    """Tell whether a value depends on constants alone."""
    entries = value.elts if isinstance(value, ast.Tuple) else [value]
    nodes = [*ast.walk(value)]
    if any(map(_is_worked_out, entries)):
        return not any(isinstance(node, ast.Name) for node in nodes)
    functions = {node.func for node in nodes if isinstance(node, ast.Call)}
    modules = {function.value for function in functions if isinstance(function, ast.Attribute)}
    names = {node for node in nodes if isinstance(node, ast.Name | ast.Attribute)}
    return bool(functions) and not names - functions - modules


def spell_out(source: str, namespace: Mapping[str, Any]) -> str:
    """Return a source with a number of its own for every name that a module gives one.

    ``m1 = m2 = 1.0`` and ``m1, m2 = np.ones(2)`` become two numbers each, so that each can be varied.

    Args:
        source: of the module.
        namespace: what running it gave.
    """
    spelled = source
    body = ast.parse(source).body
    functions = [statement for statement in body if isinstance(statement, ast.FunctionDef)]
    for node in reversed(body):  # so that what stands before keeps its place
        if not isinstance(node, ast.Assign) or _returned(node.value, functions):
            continue
        text = _spelled(node, namespace)
        if text:
            spelled = _with_statement(spelled, node, text)
    return spelled


def _with_statement(source: str, node: ast.Assign, text: str) -> str:
    """Return a source with another text in place of a statement; columns of the tree count bytes."""
    lines = [line.encode() for line in source.splitlines(keepends=True)]
    first = node.lineno - 1
    last = (node.end_lineno or node.lineno) - 1
    before = lines[first][: node.col_offset]
    after = lines[last][node.end_col_offset :]
    lines[first : last + 1] = [before + text.encode() + after]
    return b"".join(lines).decode()


def _spelled(node: ast.Assign, namespace: Mapping[str, Any]) -> str:
    """Return an assignment with a literal for every name; empty where it is not one of constants alone."""
    is_shared = len(node.targets) > 1 and isinstance(_without_sign(node.value), ast.Constant)
    if not is_shared and not _is_independent(node.value):
        return ""
    assignments = []
    for target in node.targets:
        for name in getattr(target, "elts", [target]):
            value = namespace.get(name.id) if isinstance(name, ast.Name) else None
            if isinstance(value, bool) or not isinstance(value, _NUMBERS):
                return ""
            assignments.append(f"{name.id} = {float(value)!r}")
    return "; ".join(assignments)


def readings(source: str) -> dict[str, float]:
    """Return how the numbers of a source are read in it, and what they are."""
    tree = ast.parse(source)
    values: dict[str, float] = {}
    for name, number in numbers(tree):
        values[name.strip("'").split(".")[-1]] = float(ast.literal_eval(number))
    value_of: dict[str, float] = {}
    for node in ast.walk(tree):
        read_name = _read_name(node)
        if read_name in values:
            value_of[ast.unparse(node)] = values[read_name]
    return value_of


def _read_name(node: ast.AST) -> str:
    """Return the name, the attribute or the key that an expression reads; "" where it reads none."""
    match node:
        case ast.Name(id=name, ctx=ast.Load()):
            return name
        case ast.Attribute(attr=name, ctx=ast.Load()):
            return name
        case ast.Subscript(slice=ast.Constant(value=str() as name), ctx=ast.Load()):
            return name
    return ""


def with_numbers(source: str, changes: Sequence[tuple[ast.Constant, float]]) -> str:
    """Return a source with other numbers in place of some."""
    lines = [line.encode() for line in source.splitlines(keepends=True)]
    # From the end, so that what stands before keeps its place; columns count bytes.
    for node, value in sorted(changes, key=lambda change: _place(change[0]), reverse=True):
        line = lines[node.lineno - 1]
        before = line[: node.col_offset]
        after = line[node.end_col_offset :]
        lines[node.lineno - 1] = before + repr(float(value)).encode() + after
    return b"".join(lines).decode()


def _place(node: ast.expr) -> tuple[int, int]:
    return node.lineno, node.col_offset
