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
from typing import Any, NamedTuple

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
#: Angles of a robot's geometry are multiples of this [deg], and at least so large.
_ANGLES, _LEAST_ANGLE = 15.0, 30.0
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
        return np.asarray(self.mass + self.first @ place + self.moments @ moments_of_point(place))

    def of_coordinate(self, place: Array, k: int) -> Array:
        """Return the derivative of that by a coordinate of the place."""
        return np.asarray(self.first[:, k] + self.moments @ slope_of_moments(place, k))


def moments_of_point(place: Array) -> Array:
    """Return Ixx, Iyy, Izz, Ixy, Ixz, Iyz of a mass of one at a place, about the origin [m²], (6,)."""
    tensor = float(place @ place) * np.eye(3) - np.outer(place, place)
    return np.asarray(tensor[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)])


def slope_of_moments(place: Array, k: int) -> Array:
    """Return the derivative of `moments_of_point` by a coordinate [m], (6,), which is exact for any step."""
    step = np.eye(3)[k]
    ahead, behind = (moments_of_point(place + way * step) for way in (1.0, -1.0))
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
        return bool(np.linalg.norm(rest) <= share * np.linalg.norm(column) + least)

    def of(self, column: Array, stated: Sequence[float]) -> set[int | None]:
        """Return the links whose numbers of one unit give a derivative, with None if those of all give it.

        A link whose mass is none of those that the model states may be joined of several bodies there.
        """
        masses = [j for j, unit in enumerate(self.units) if unit == "kg"]
        whole = {self.links[j] for j in masses if np.isclose(self.values[j], stated, rtol=1e-6).any()}
        rests = [
            (link, column - basis @ (basis.T @ column))
            for (unit, link), basis in self.bases.items()
            if not (unit.startswith(JOINED) and link in whole) and not unit.startswith(TURNED)
        ]
        return {link for link, rest in rests if self.same(rest, column)}

    def alike(self, value: float, share: float = 1.0) -> list[int]:
        """Return which of the robot's numbers are a share of a value, up to the sign, and are felt."""
        near = np.abs(np.abs(self.values) - share * abs(value)) <= 1e-6 * abs(value)
        felt = np.abs(self.columns).max(axis=0) * np.abs(self.values) > 1e-7
        return [int(j) for j in np.flatnonzero(near & felt)]

    def standing(self, column: Array, value: float, used: Container[int] = ()) -> dict[int, float]:
        """Return the robot's numbers that a model's is, others than those used, and their changes by it.

        All of them change by the same share as it does. A length may move one more, as far as it grows: what
        is counted from its end, as in the frames of Denavit and Hartenberg.
        """
        alike = [*self.alike(value), *self.alike(value, 0.5)]  # the centre of mass at half of a length
        alike = [j for j in alike if j not in used]
        for size in range(1, min(len(alike), _ALIKE) + 1):
            for chosen in itertools.combinations(alike, size):
                if len(units := {self.units[j] for j in chosen}) > 1:
                    continue
                rates = {j: float(self.values[j]) / value for j in chosen}
                rest = column - self.columns[:, chosen] @ self.values[list(chosen)]
                if self.same(rest, column):
                    return rates
                if scaled := self._with_inertias(rest, column, units, value):
                    return {**rates, **scaled}
                if units == {"m"} and (moved := self._one_more(rest, column, value, chosen)):
                    return {**rates, **moved}
        return {}

    def _with_inertias(self, rest: Array, column: Array, units: set[str], value: float) -> dict[int, float]:
        """Return the inertias that follow from a mass or a length, as m a²/12, and their changes by it."""
        power = {"kg": 1.0, "m": 2.0}.get(min(units))
        if power is None:
            return {}
        moments: dict[int, list[int]] = {}
        for j, unit in enumerate(self.units):
            if unit == "kg m²" and self.values[j]:
                moments.setdefault(self.links[j], []).append(j)
        groups = [of_link for of_link in moments.values() if np.abs(self.columns[:, of_link]).max() > 1e-9]
        if not groups:
            return {}
        matrix = np.stack([self.columns[:, of_link] @ self.values[of_link] for of_link in groups], axis=-1)
        shares = np.linalg.lstsq(matrix, rest, rcond=1e-12)[0]
        whole = np.isclose(shares, power, rtol=1e-4) | (np.abs(shares) < 1e-4)
        if not whole.all() or not self.same(rest - matrix @ (power * np.round(shares / power)), column):
            return {}
        moved = [of_link for of_link, share in zip(groups, shares, strict=True) if share > 0.5]
        return {j: power * float(self.values[j]) / value for of_link in moved for j in of_link}

    def explained_with_inertias(self, column: Array, value: float) -> bool:
        """Tell whether numbers of that value, and any inertias, give a derivative: a cylinder's length."""
        inertias = [j for j, unit in enumerate(self.units) if unit == "kg m²"]
        basis = span([self.columns[:, j] for j in inertias]) if inertias else np.zeros((len(column), 0))
        alike = [*self.alike(value), *self.alike(value, 0.5)]
        for size in range(min(len(alike), _ALIKE) + 1):
            for chosen in itertools.combinations(alike, size):
                if len({self.units[j] for j in chosen}) > 1:
                    continue
                rest = column - self.columns[:, chosen] @ self.values[list(chosen)]
                if self.same(rest - basis @ (basis.T @ rest), column):
                    return True
        return False

    def link_of_part(self, column: Array, value: float, stated: Sequence[float]) -> int | None:
        """Return the link of which a number is of a part: a load, or a lever of one, that the robot joins.

        The derivative then is exactly that by a mass at a place, or by its place, where the places are those
        of the model's other numbers along the axes. None where it is nothing like that.
        """
        sizes = [*dict.fromkeys(abs(x) for x in stated if x)]
        for body in self.bodies:
            along = [way * size * axis for size in sizes for axis in np.eye(3) for way in (1.0, -1.0)]
            for place in (*body.places, *along):
                if self.same(column - value * body.of_point(place), column):
                    return body.link
            for k, way in itertools.product(range(3), (1.0, -1.0)):
                lever = body.of_coordinate(way * abs(value) * np.eye(3)[k], k) * way * abs(value)
                if any(self.same(column - mass * lever, column) for mass in sizes):
                    return body.link
        return None

    def link_turned(self, column: Array) -> int | None:
        """Return the link of which a derivative is that by a turn of all behind it, None without one."""
        for (unit, link), basis in self.bases.items():
            if unit.startswith(TURNED) and self.same(column - basis @ (basis.T @ column), column):
                return link
        return None

    def nearest(self, column: Array, value: float, used: Container[int]) -> dict[int, float]:
        """Return the robot's numbers that come nearest to a model's, and how they change with it.

        A mistake has the number in a wrong place: what it is has to be guessed by the other places, so that
        as many values as possible move as they should. There may be none.
        """

        def missed(moved: Array) -> int:
            return int(np.count_nonzero(np.abs(column - moved) > least))

        least = max(1e-5 * float(np.abs(column).max()), self.noise)
        best, found = missed(np.zeros_like(column)), dict[int, float]()
        alike = [j for j in self.alike(value) if j not in used]
        for size in range(1, min(len(alike), _ALIKE) + 1):
            for chosen in itertools.combinations(alike, size):
                if len({self.units[j] for j in chosen}) > 1:
                    continue
                left = missed(self.columns[:, chosen] @ self.values[list(chosen)])
                if left < best:
                    best, found = left, {j: float(self.values[j]) / value for j in chosen}
        return found

    def _one_more(
        self, rest: Array, column: Array, value: float, chosen: tuple[int, ...]
    ) -> dict[int, float]:
        """Return the one length that moves as well, and which way."""
        for j, way in itertools.product(range(len(self.units)), (1.0, -1.0)):
            length = self.units[j] == "m" and j not in chosen
            if length and self.same(rest - way * value * self.columns[:, j], column):
                return {j: way}
        return {}


def is_angle(value: float) -> bool:
    """Tell whether a number may be an angle of a robot's geometry, in degrees or radians: 90, -1.5708."""
    for degrees in (abs(value), abs(float(np.rad2deg(value)))):
        nearest = _ANGLES * round(degrees / _ANGLES)
        if nearest >= _LEAST_ANGLE and abs(degrees - nearest) <= 1e-3:
            return True
    return False


def states_angles(source: str) -> bool:
    """Tell whether a source states a number that may be an angle of the robot's geometry."""
    return any(is_angle(float(ast.literal_eval(node))) for _, node in numbers(ast.parse(source)))


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
    matrix = matrix / np.maximum(np.linalg.norm(matrix, axis=0), 1e-12)
    left, sizes, _ = np.linalg.svd(matrix, full_matrices=False)
    return np.asarray(left[:, sizes > 1e-6])


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
    checked = _Checked(known, [float(ast.literal_eval(places[0])) for _, places in named])
    words = set(re.findall(r"\w+", text))

    def is_new(name: str) -> bool:
        return re.findall(r"\w+", name)[-1] in words

    # The sort is stable: the others in their order.
    for k, (name, places) in sorted(enumerate(named[:_MOST]), key=lambda one: not is_new(one[1][0])):
        if not whole and checked.wrong + checked.other > 0 and not is_new(name):
            break
        value = checked.stated[k]
        if value == 0.0 or name in ("n", "N"):
            continue
        moved = [[(node, value * (1.0 + s * STEP)) for node in places] for s in (1.0, -1.0)]
        ends = [values(with_numbers(source, changes)) for changes in moved]
        if ends[0] is not None and ends[1] is not None:
            checked.add(k, name, (ends[0] - ends[1]) / (2.0 * STEP))
    if whole:
        checked.guess()
    sure = len(named) <= _MOST and not _bare(tree, named) and not _unseen(tree) and checked.is_sure()
    names = tuple(dict.fromkeys([*checked.odd, *checked.mixed()]))
    return Check(checked.wrong, checked.other, checked.seen, sure, checked.standing, names)


class _Checked:
    """The numbers of a model that were looked at, and what they are in the robot; see :class:`Check`."""

    def __init__(self, known: Slopes, stated: list[float]) -> None:
        """Take the robot's derivatives, and all numbers that the model states."""
        self.known, self.stated = known, stated
        self.wrong = self.other = self.seen = 0
        self.standing: dict[int, dict[int, float]] = {}
        self.odd: list[str] = []
        self._linked = True  # whether each is of a link
        self._joined = False  # whether some are of parts that the robot joins
        self._left: dict[int, Array] = {}  # derivatives by numbers that are none of the robot's alone
        #: The robot's numbers that are used, those of which half is, and the model's that nothing depends on.
        self._used, self._halves, self._unused = set[int](), set[int](), list[float]()
        #: Inertias that follow from masses and lengths, and from which number.
        self._scaled: dict[int, str] = {}
        self._families: dict[str, list[tuple[int, int]]] = {}
        self._units: dict[str, set[str]] = {}

    def add(self, k: int, name: str, column: Array) -> None:
        """Take the derivative of all that the model gives by a number."""
        known, value = self.known, self.stated[k]
        if np.abs(column).max() < max(1e-7, known.noise):  # nothing depends on it
            self._unused.append(value)
            return
        self.seen += 1
        whole = known.alike(value)
        if chosen := known.standing(column, value, self._used):
            self.standing[k] = chosen
            own = {*chosen} & {*whole, *known.alike(value, 0.5)}
            links: set[int] = {known.links[j] for j in own}
            self._used |= own
            self._scaled |= {j: name for j in {*chosen} - own if known.units[j] == "kg m²"}
            self._halves |= own - {*whole}
        elif (part := known.link_of_part(column, value, self.stated)) is not None:
            # The robot has one body there, of which no number alone is this one: nothing is varied with it.
            self._joined = True
            links = {part}
        elif not whole and is_angle(value) and (turned := known.link_turned(column)) is not None:
            # The twist of a row of Denavit and Hartenberg: no number of the robot alone, and it stays.
            links = {turned}
        else:
            self._left[k] = column
            found = known.of(column, self.stated)
            self.wrong += not found
            self.other += bool(whole)
            if whole and not found and not known.explained_with_inertias(column, value):
                self.odd.append(name)
            links = {link for link in found if link is not None}
            self._linked = self._linked and bool(links)
        family = _FAMILY.match(name.strip("'"))
        letter, place = (family[1], int(family[2])) if family else (name, k)
        self._families.setdefault(letter, []).append((place, min(links, default=0)))
        self._units.setdefault(letter, set()).update(known.units[j] for j in self.standing.get(k, ()))

    def guess(self) -> None:
        """Take each number that is none of the robot's alone for those of its value that are nearest."""
        for k, column in self._left.items():
            self.standing[k] = self.known.nearest(column, self.stated[k], self._used)
            self._used |= {*self.standing[k]}

    def mixed(self) -> list[str]:
        """Return the numbers with which an inertia moves that is a number of its own as well."""
        return [name for j, name in self._scaled.items() if j in self._used]

    def is_sure(self) -> bool:
        """Tell whether each is of one link, families are in the links' order, and none may be forgotten."""
        # A number that is read nowhere may be what stands at half of another one: lc1, and l1 / 2.
        left = self._used - self._halves
        # A list of numbers of several units is one of all parameters, in any order.
        families = [rows for letter, rows in self._families.items() if len(self._units[letter]) < 2]
        in_order = [[link for _, link in sorted(rows)] for rows in families]
        return (
            self._linked
            and not self._joined
            and not self.mixed()
            and not any(set(self.known.alike(x)) - left for x in self._unused)
            and all(links == sorted(links) for links in in_order)
        )


def _bare(tree: ast.AST, named: Sequence[tuple[str, Sequence[ast.Constant]]]) -> bool:
    """Tell whether a source has numbers without a name that are no usual coefficients."""
    known = {node for _, places in named for node in places}
    found = (x for x in ast.walk(tree) if isinstance(x, ast.Constant) and type(x.value) is float)
    return any(x not in known and x.value not in USUAL for x in found)


#: Calls whose arguments are the numbers themselves; a name with a capital is a class, such as a record.
_HOLDERS = ("array", "asarray", "diag", "list", "tuple")
#: Calls that make numbers of which none stands in the source.
_MAKERS = ("ones", "full", "linspace", "repeat", "tile", "loadtxt", "genfromtxt", "load", "eye")


def numbers(tree: ast.AST) -> Iterator[tuple[str, ast.Constant]]:
    """Yield numbers of a source that have a name: assigned, items, arguments, defaults, entries of arrays."""
    pairs: list[tuple[str, Any]] = []
    functions = [x for x in ast.walk(tree) if isinstance(x, ast.FunctionDef)]
    local = {x for function in functions for x in ast.walk(function)}
    for node in ast.walk(tree):
        match node:
            case ast.Assign(targets=[target], value=value):
                choosing = node in local and not isinstance(value, ast.Constant)
                given = _returned(value, functions)
                pairs += _leaves(target, given) if given else _selected(_leaves(target, value), choosing)
            case ast.AnnAssign(target=target, value=ast.expr() as value):
                pairs += _leaves(target, value)
            case ast.Dict(keys=keys, values=values):
                for key, item in zip(keys, values, strict=True):
                    pairs += _leaves(key, item) if key is not None else []
            case ast.Call(func=function, keywords=words):
                pairs += _of_keywords(function, words)
            case ast.arguments():
                pairs += _of_defaults(node)
    seen = set[ast.Constant]()  # several functions may unpack the same numbers
    for text, x in pairs:
        inner = getattr(x, "operand", x)  # -0.3
        if isinstance(inner, ast.Constant) and type(inner.value) in (int, float) and inner not in seen:
            seen.add(inner)
            yield text, inner


def _returned(value: ast.expr, functions: Sequence[ast.FunctionDef]) -> ast.Tuple | None:
    """Return what a call without arguments gives where that is all that its function says: several values."""
    match value:
        case ast.Call(func=ast.Name(id=name), args=[], keywords=[]):
            called = next((one for one in functions if one.name == name), None)
            statements = [] if called is None else [x for x in called.body if not isinstance(x, ast.Expr)]
            match statements:
                case [ast.Return(value=ast.Tuple() as returned)]:
                    return returned
    return None


def grouped_numbers(tree: ast.AST) -> list[tuple[str, tuple[ast.Constant, ...]]]:
    """Return the numbers of a source, each with where it stands: defaults of several functions are one."""
    defaults: dict[tuple[str, float], list[ast.Constant]] = {}
    of_functions = {x for node in ast.walk(tree) if isinstance(node, ast.arguments) for x in _defaults(node)}
    found: list[tuple[str, list[ast.Constant]]] = []
    for name, node in numbers(tree):
        key = (name, float(ast.literal_eval(node)))
        if node in of_functions and key in defaults:
            defaults[key].append(node)
            continue
        places = [node]
        found.append((name, places))
        if node in of_functions:
            defaults[key] = places
    return [(name, tuple(places)) for name, places in found]


def _defaults(arguments: ast.arguments) -> list[ast.expr]:
    """Return the default values of a function, without their signs."""
    values = [*arguments.defaults, *(x for x in arguments.kw_defaults if x is not None)]
    return [getattr(x, "operand", x) for x in values]


def _of_defaults(arguments: ast.arguments) -> list[tuple[str, Any]]:
    """Return the default values of a function with their names."""
    named = [*arguments.posonlyargs, *arguments.args]
    named = [*named[len(named) - len(arguments.defaults) :], *arguments.kwonlyargs]
    defaults = [*arguments.defaults, *arguments.kw_defaults]
    return [(one.arg, value) for one, value in zip(named, defaults, strict=True)]


def _of_keywords(function: ast.expr, words: list[ast.keyword]) -> list[tuple[str, Any]]:
    """Return the numbers that a call is given by name; lists in other calls are shapes or axes."""
    keeps = _is_holder(function) or ast.unparse(function) == "dict"
    named = [(word.arg, word.value) for word in words if word.arg is not None]
    leaves = [_leaves(ast.Name(name), value) if keeps else [(name, value)] for name, value in named]
    return [leaf for of_word in leaves for leaf in of_word]


def _selected(leaves: list[tuple[str, Any]], of_function: bool) -> list[tuple[str, Any]]:
    """Return constants without those of the arrays of ones that a function makes, which choose and add."""
    if not of_function:
        return leaves
    return [leaf for leaf in leaves if getattr(leaf[1], "value", None) not in (0, 1)]


def _leaves(target: ast.expr, value: ast.expr) -> list[tuple[str, Any]]:
    """Return the constants that a target is given, each with its name."""
    match target, value:
        case ast.Tuple(elts=names), ast.Tuple(elts=values) if len(names) == len(values):
            return [one for a, b in zip(names, values, strict=True) for one in _leaves(a, b)]
        case ast.Tuple() | ast.Subscript(), _:
            return []
        case _, ast.List(elts=values) | ast.Tuple(elts=values):
            return [one for entry in _without_directions(values) for one in _leaves(target, entry)]
        case _, ast.Call(func=function, args=arguments) if _is_holder(function):
            return [one for entry in arguments for one in _leaves(target, entry)]
    return [(ast.unparse(target), value)]


def _without_directions(values: list[ast.expr]) -> list[ast.expr]:
    """Return the entries of a list; of a unit vector, or of a row of a rotation, no ones and zeros."""
    constants = [getattr(x, "operand", x) for x in values]
    numbers_alone = all(isinstance(x, ast.Constant) and x.value for x in constants)
    if numbers_alone:
        return values
    return [
        value
        for value, x in zip(values, constants, strict=True)
        if not isinstance(x, ast.Constant) or x.value not in (0, 1)
    ]


def _is_holder(function: ast.expr) -> bool:
    """Tell whether a call only keeps its arguments: an array, or a record of a class."""
    name = ast.unparse(function).split(".")[-1]
    return name in _HOLDERS or name[:1].isupper()


def _unseen(tree: ast.Module) -> bool:
    """Tell whether names are given numbers that are not seen: several at once, or from a call alone."""
    functions = [x for x in tree.body if isinstance(x, ast.FunctionDef)]
    own = {x.name for x in functions}
    for node in ast.walk(tree):
        if any(map(_is_worked_out, _given(node))):
            return True
        if not isinstance(node, ast.Assign) or _returned(node.value, functions):
            continue
        inner = getattr(node.value, "operand", node.value)
        if len(node.targets) > 1 and isinstance(inner, ast.Constant) and inner.value:
            return True
        calls = (
            [x for x in ast.walk(node.value) if isinstance(x, ast.Call)]
            if _is_independent(node.value)
            else []
        )
        called = {ast.unparse(call.func).split(".")[-1] for call in calls}
        if called & ({*_MAKERS} | own):
            return True
    return False


def _given(node: ast.AST) -> list[Any]:
    """Return what a statement gives to names, a mapping to its keys, or a function to its arguments."""
    match node:
        case ast.Assign(value=ast.Tuple(elts=values)) | ast.Dict(values=values):
            return values
        case ast.Assign(value=value) | ast.AnnAssign(value=value):
            return [value]
        case ast.arguments():
            return [*node.defaults, *node.kw_defaults]
    return []


def _is_worked_out(value: Any) -> bool:
    """Tell whether a value is numbers alone that are put together, as 1 / 12, and no usual coefficient."""
    parts = ast.BinOp | ast.UnaryOp | ast.Constant | ast.operator | ast.unaryop
    if not isinstance(value, ast.BinOp) or not all(isinstance(x, parts) for x in ast.walk(value)):
        return False
    match value:
        case ast.BinOp(
            ast.Constant(int() | float() as above), ast.Div(), ast.Constant(int() | float() as below)
        ):
            return below == 0 or above / below not in USUAL
    return True


def _is_independent(value: ast.expr) -> bool:
    """Tell whether a value depends on constants alone."""
    if any(map(_is_worked_out, value.elts if isinstance(value, ast.Tuple) else [value])):
        return not any(isinstance(x, ast.Name) for x in ast.walk(value))
    called = {x.func for x in ast.walk(value) if isinstance(x, ast.Call)}
    owners = {x.value for x in called if isinstance(x, ast.Attribute)}
    names = {x for x in ast.walk(value) if isinstance(x, ast.Name | ast.Attribute)}
    return bool(called) and not names - called - owners


def spell_out(source: str, namespace: Mapping[str, Any]) -> str:
    """Return a source with a number of its own for every name that a module gives one.

    ``m1 = m2 = 1.0`` and ``m1, m2 = np.ones(2)`` become two numbers each, so that each can be varied.

    Args:
        source: of the module.
        namespace: what running it gave.
    """
    spelled = source
    body = ast.parse(source).body
    functions = [x for x in body if isinstance(x, ast.FunctionDef)]
    statements = [x for x in body if isinstance(x, ast.Assign) and not _returned(x.value, functions)]
    for node in reversed(statements):
        text = _spelled(node, namespace)
        if text:
            lines = [line.encode() for line in spelled.splitlines(keepends=True)]
            first, last = node.lineno - 1, (node.end_lineno or node.lineno) - 1
            head, tail = lines[first][: node.col_offset], lines[last][node.end_col_offset :]
            spelled = b"".join([*lines[:first], head + text.encode() + tail, *lines[last + 1 :]]).decode()
    return spelled


def _spelled(node: ast.Assign, namespace: Mapping[str, Any]) -> str:
    """Return an assignment with a literal for every name; empty where it is not one of constants alone."""
    constant = isinstance(getattr(node.value, "operand", node.value), ast.Constant)
    if not (constant and len(node.targets) > 1) and not _is_independent(node.value):
        return ""
    names = [name for target in node.targets for name in getattr(target, "elts", [target])]
    parts = []
    for name in names:
        value = namespace.get(name.id) if isinstance(name, ast.Name) else None
        if isinstance(value, bool) or not isinstance(value, int | float | np.floating | np.integer):
            return ""
        parts.append(f"{name.id} = {float(value)!r}")
    return "; ".join(parts)


def readings(source: str) -> dict[str, float]:
    """Return how the numbers of a source are read in it, and what they are."""
    tree = ast.parse(source)
    values = {name.strip("'").split(".")[-1]: float(ast.literal_eval(x)) for name, x in numbers(tree)}
    found = {}
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Load()) | ast.Attribute(attr=name, ctx=ast.Load()):
                pass
            case ast.Subscript(slice=ast.Constant(value=str() as name), ctx=ast.Load()):
                pass
            case _:
                continue
        if name in values:
            found[ast.unparse(node)] = values[name]
    return found


def with_numbers(source: str, changes: Sequence[tuple[ast.Constant, float]]) -> str:
    """Return a source with other numbers in place of some."""
    lines = [line.encode() for line in source.splitlines(keepends=True)]
    for node, value in sorted(changes, key=lambda one: (-one[0].lineno, -one[0].col_offset)):
        line = lines[node.lineno - 1]
        lines[node.lineno - 1] = (
            line[: node.col_offset] + repr(float(value)).encode() + line[node.end_col_offset :]
        )
    return b"".join(lines).decode()
