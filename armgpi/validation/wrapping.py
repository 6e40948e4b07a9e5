"""A line that wraps a file's own functions, where it has none of the names that are compared.

Its functions are tried with one number for each argument, then with arrays. What they give says by its shape
what it probably is: a square matrix is D, then C; a vector C v, then G.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

#: Numbers of joints that are tried.
_JOINTS = range(1, 8)
#: Functions that a message lists, and a value for every argument that is tried.
_LISTED, _VALUE = 6, 0.3
#: What an array or matrix is, in the order in which they are returned.
_MATRICES, _VECTORS = ("mass_matrix", "coriolis_matrix"), ("coriolis_torque", "gravity")


class _Way(NamedTuple):
    """How a function is called: for so many joints, with so many sets of them, scalars or arrays."""

    joints: int
    sets: int
    scalars: bool


def what_it_has(names: Mapping[str, Any]) -> str:
    """Return which functions a model has, and the lines that wrap one of them; "" where it has none."""
    own = {name: value for name, value in names.items() if _is_own(name, value, names)}
    if not own:
        return ""
    listed = ", ".join(f"{name}{_arguments(function)}" for name, function in list(own.items())[:_LISTED])
    lines = next(filter(None, (_wrapped(name, function) for name, function in own.items())), [])
    text = f"; it has {listed}"
    return f"{text}; append this line to wrap it: {'; '.join(lines)}" if lines else text


def _is_own(name: str, value: Any, names: Mapping[str, Any]) -> bool:
    """Tell whether something is a function that the file itself has."""
    module = names.get("__name__")
    return inspect.isfunction(value) and name[:1] != "_" and value.__module__ == module


def _arguments(function: Callable[..., Any]) -> str:
    return f"({', '.join(inspect.signature(function).parameters)})"


def _wrapped(name: str, function: Callable[..., Any]) -> list[str]:
    """Return the lines that make known functions of one, none where it is not seen how."""
    parameters = inspect.signature(function).parameters.values()
    needed = [x for x in parameters if x.default is x.empty and x.kind is x.POSITIONAL_OR_KEYWORD]
    for way in _ways(len(needed)):
        with suppress(Exception):  # it is called otherwise
            found = _lines(name, way, function(*_values(way)))
            if found:
                return found
    return []


def _ways(count: int) -> Iterator[_Way]:
    """Yield the ways in which a function of so many arguments may be called."""
    for sets in (2, 1, 3):
        if count % sets == 0 and count // sets in _JOINTS and count > sets:
            yield _Way(count // sets, sets, True)
    if count in (1, 2, 3):
        yield from (_Way(n, count, False) for n in _JOINTS)


def _values(way: _Way) -> list[Any]:
    if way.scalars:
        return [_VALUE] * (way.joints * way.sets)
    return [np.full(way.joints, _VALUE) for _ in range(way.sets)]


def _lines(name: str, way: _Way, answer: Any) -> list[str]:
    """Return the lines of what a function gave, by its shapes."""
    parts = list(answer) if isinstance(answer, tuple) else [answer]
    shapes = [np.asarray(part, dtype=float).shape for part in parts]
    whole = not isinstance(answer, tuple)
    n, found = way.joints, list[str]()
    matrices, vectors = iter(_MATRICES), iter(_VECTORS if way.sets > 1 else _VECTORS[1:])
    for k, shape in enumerate(shapes):
        place = "" if whole else f"[{k}]"
        if whole and shape in ((n,), (n, 1)) and way.sets == 3:
            return [f"inverse_dynamics = lambda q, v, a: {name}({_given(way, 'qva')})"]
        if shape == (n, n) and n > 1:
            known = next(matrices, None)
        elif shape in ((n,), (n, 1), (1, n)):
            known = next(vectors, None)
        else:
            known = None
        if known is not None:
            moves = known.startswith("coriolis") and way.sets > 1
            letters = ["q", "v", "0*v"] if moves else ["q", "0*q", "0*q"]
            head = "q, v" if moves else "q"
            found.append(f"{known} = lambda {head}: {name}({_given(way, letters)}){place}")
    return found


def _given(way: _Way, letters: Sequence[str]) -> str:
    """Return the arguments: "*q, *v" for scalars, "q, v" for arrays."""
    shown = [f"({x})" if way.scalars and "0" in x else x for x in letters[: way.sets]]
    return ", ".join(f"*{x}" if way.scalars else x for x in shown)
