"""What a model's source calls the robot's numbers: by their values; equal ones by letters and digits."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from armgpi.validation.hypotheses import Names
from armgpi.validation.summands import numbers_of
from armgpi.validation.tree import Tree
from armgpi.validation.units import numbers

#: Two numbers are the same up to this, relative.
_SAME = 1e-9
#: First letters of usual names -> kind of number; other letters may be anything.
_LETTERS = {
    "m": "m",
    "M": "m",
    "I": "I",
    "J": "I",
    "l": "l",
    "L": "l",
    "a": "l",
    "r": "l",
    "c": "l",
    "g": "g",
}
#: Names of distances of centres of mass.
_CENTRE = re.compile(r"[lL]_?[cC]|[cCrRdsS]")
#: Longest name that stands in a formula.
_LONGEST = 12


class UserName(NamedTuple):
    """What a model calls one of the robot's numbers.

    Attributes:
        name: its name.
        sign: -1 where the model has the number with the other sign.
    """

    name: str
    sign: float


def users_names(source: str | None, tree: Tree) -> dict[str, UserName]:
    """Return what a source calls the robot's numbers, those that can be told apart alone."""
    if source is None:
        return {}
    try:
        named = list(_named(ast.parse(source)))
    except SyntaxError:
        return {}
    own = numbers_of(tree)
    found = {}
    for name, value in own.items():
        fitting = {user for user, x in named if abs(abs(x) - abs(value)) <= _SAME * abs(value)}
        fitting = {user for user in fitting if _LETTERS.get(user[0], _kind(name)) == _kind(name)}
        if len(fitting) > 1 and _kind(name) == "l":
            fitting = {user for user in fitting if bool(_CENTRE.match(user)) == (name[0] == "c")}
        if len(fitting) > 1:
            fitting = {user for user in fitting if _digit(user) == _expected_digit(name)}
        alike = {
            other
            for other, x in own.items()
            if other != name and abs(abs(x) - abs(value)) <= _SAME * abs(value)
        }
        twins = {other for other in alike if _kind(other) == _kind(name) and _digit(other) != _digit(name)}
        if len(fitting) != 1:
            continue
        (user,) = fitting
        if twins and _digit(user) != _expected_digit(name):
            continue  # it may be the other link's
        values = {x for other, x in named if other == user}
        if len(values) == 1:
            found[name] = UserName(user, -1.0 if value * min(values) < 0.0 else 1.0)
    return found


def _named(tree: ast.AST) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a source whose names can stand in a formula."""
    for text, node in numbers(tree):
        name = text.strip("'\"").rpartition(".")[2]
        if name.isidentifier() and len(name) <= _LONGEST and not re.fullmatch(r"[qv]\d*", name):
            yield name, float(ast.literal_eval(node))


def _kind(name: str) -> str:
    return "l" if name[0] == "c" else name[0]


def _digit(name: str) -> str:
    match = re.search(r"\d+", name)
    return match[0] if match else ""


def _expected_digit(name: str) -> str:
    """Return the digit that a usual name has: the length of link 1 leads to joint 2."""
    digit = _digit(name)
    return str(int(digit) - 1) if name[0] == "l" and digit else digit


def describe(names: Mapping[str, UserName], used: set[str], tree: Tree) -> list[str]:
    """Return what the robot's numbers in some formulas are that have no name of the user's."""
    links = Names(tree)
    own = numbers_of(tree)
    lines = []
    for name, value in own.items():
        if name not in used or name in names or name == "g":
            continue
        k = int(_digit(name)) - 1
        place = name.lstrip("mIrcl").lstrip("0123456789")
        what = {
            "m": (f"mass of {links.link(k)}", "kg"),
            "c": (f"{place} of the centre of mass of {links.link(k)}", "m"),
            "l": (f"{place} of the way to {links.joint(k)}", "m"),
            "I": (f"inertia {place} of {links.link(k)} about its centre of mass", "kg m²"),
        }[name[0]]
        if name.startswith("Ir"):
            what = (f"rotor inertia of {links.joint(k)}", "kg m²")
        lines.append(f"{name} = {value:.6g} {what[1]}: {what[0]}")
    return lines
