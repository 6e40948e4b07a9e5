"""What a user's law can reach besides its arguments and attributes, and whether it writes there.

That is: globals, closures, defaults of arguments, attributes of functions and of classes, and the random
numbers that everybody shares. What changes there while a law is called with symbols is found and put back.
"""

from __future__ import annotations

import operator
import pickle
import random
import sys
import types
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from armgpi.codegen.symbols import NotElementwise

#: Things looked at, at most: what reaches more than this is not looked through to its end.
_MOST = 10_000
_MISSING = object()


class _Place(NamedTuple):
    """Something that may change: its name, how to look at it, how it was and how to make it so again."""

    name: str
    look: Callable[[], Any]
    before: Any
    restore: Callable[[], object]

    @property
    def changed(self) -> bool:
        now, before = self.look(), self.before
        if isinstance(before, list):  # of things, which must be the same ones
            return len(now) != len(before) or not all(map(operator.is_, now, before))
        return bool(now != before)


class SideEffects:
    """What laws reach outside of themselves, as it was when :meth:`watch` was called."""

    def __init__(self) -> None:
        """Watch the random numbers of Python and NumPy."""
        self._places: list[_Place] = []
        self._seen: dict[int, Any] = {}  # with the things themselves, as an id may be used again
        self._random("random", random.getstate, random.setstate)
        self._random("np.random", np.random.get_state, np.random.set_state)

    def watch(self, value: Any) -> None:
        """Watch all that a function or a class reaches.

        Raises:
            NotElementwise: when that is an iterator, of which nobody can tell where it stands.
        """
        waiting = [(value, "")]
        while waiting and len(self._seen) < _MOST:
            value, name = waiting.pop()
            if id(value) not in self._seen:
                self._seen[id(value)] = value
                waiting += self._reached(value, name)

    def changes(self) -> list[str]:
        """Return the names of what is not as it was."""
        return [place.name for place in self._places if place.changed]

    def restore(self) -> None:
        """Make everything as it was."""
        for place in self._places:
            if place.changed:
                place.restore()

    def _reached(self, value: Any, name: str) -> Iterator[tuple[Any, str]]:
        """Watch one thing, and yield with their names those that it leads to."""
        if isinstance(value, types.FunctionType):
            if _is_users(value.__module__):
                yield from self._function(value)
        elif isinstance(value, type):
            if _is_users(value.__module__):
                yield from self._class(value)
        elif isinstance(value, tuple):
            yield from ((item, name) for item in value)
        elif isinstance(value, list | deque):
            self._container(name, value, value.extend, lambda: list(value))
            yield from ((item, name) for item in value)
        elif isinstance(value, set):
            self._container(name, value, value.update, value.copy)
        elif isinstance(value, dict):
            yield from self._dict(value, name)
        elif isinstance(value, np.ndarray):
            self._array(value, name)
        elif isinstance(value, random.Random):
            self._random(name, value.getstate, value.setstate)
        elif isinstance(value, np.random.Generator):
            bits = value.bit_generator
            self._random(name, lambda: bits.state, lambda old: setattr(bits, "state", old))
        elif isinstance(value, np.random.RandomState):
            self._random(name, value.get_state, value.set_state)
        elif isinstance(value, Iterator):
            raise NotElementwise(f"it reaches an iterator ({name})")
        elif _is_users(type(value).__module__) and hasattr(value, "__dict__"):
            yield from self._dict(vars(value), name)
            yield type(value), name

    def _function(self, function: types.FunctionType) -> Iterator[tuple[Any, str]]:
        """Watch the globals that a function names, its closure, its defaults and its attributes."""
        names = set(_names(function.__code__))
        for name in names:
            yield from self._slot(function.__globals__, name)
            module = function.__globals__.get(name)
            if isinstance(module, types.ModuleType) and _is_users(module.__name__):
                for attribute in names & vars(module).keys():
                    yield from self._slot(vars(module), attribute)
        for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
            yield from self._cell(cell, name)
        yield function.__defaults__, function.__name__
        yield function.__kwdefaults__, function.__name__
        yield from self._dict(vars(function), function.__name__)

    def _class(self, kind: type) -> Iterator[tuple[Any, str]]:
        """Watch the attributes of a class and of those that it comes from."""
        for name, item in list(vars(kind).items()):
            if not name.startswith("__"):
                self._attribute(kind, name)
            item = getattr(item, "__func__", getattr(item, "fget", item))
            yield item, f"{kind.__name__}.{name}"
        yield kind.__bases__, kind.__name__

    def _attribute(self, kind: type, name: str) -> None:
        """Watch one attribute of a class."""
        self._note(
            f"{kind.__name__}.{name}", lambda: [vars(kind).get(name)], lambda old: setattr(kind, name, old[0])
        )

    def _cell(self, cell: types.CellType, name: str) -> Iterator[tuple[Any, str]]:
        """Watch a variable of a closure."""
        content = _content(cell)
        if content:
            self._note(name, lambda: _content(cell), lambda old: setattr(cell, "cell_contents", old[0]))
            yield content[0], name

    def _slot(self, names: dict[str, Any], name: str) -> Iterator[tuple[Any, str]]:
        """Watch what one name stands for."""

        def put(old: list[Any]) -> None:
            if old[0] is _MISSING:
                names.pop(name, None)
            else:
                names[name] = old[0]

        self._note(name, lambda: [names.get(name, _MISSING)], put)
        if name in names:
            yield names[name], name

    def _dict(self, value: dict[Any, Any], name: str) -> Iterator[tuple[Any, str]]:
        """Watch a dictionary."""
        old = dict(value)
        self._container(name, value, lambda _: value.update(old), lambda: [*value, *value.values()])
        yield from ((item, name) for item in old.values())

    def _container(
        self, name: str, value: Any, fill: Callable[[Any], object], look: Callable[[], Any]
    ) -> None:
        """Watch a container, which is emptied and filled to restore it."""

        def put(old: Any) -> None:
            value.clear()
            fill(old)

        self._note(name, look, put)

    def _array(self, value: Any, name: str) -> None:
        """Watch an array."""
        old = value.copy()
        if value.dtype == object:
            self._note(name, lambda: list(value.flat), lambda _: np.copyto(value, old))
        else:
            self._note(name, value.tobytes, lambda _: np.copyto(value, old))

    def _random(self, name: str, get: Callable[[], Any], put: Callable[[Any], object]) -> None:
        """Watch a source of random numbers."""
        self._note(name, lambda: pickle.dumps(get()), lambda old: put(pickle.loads(old)))

    def _note(self, name: str, look: Callable[[], Any], put: Callable[[Any], object]) -> None:
        before = look()
        self._places.append(_Place(name, look, before, lambda: put(before)))


def _content(cell: types.CellType) -> list[Any]:
    """Return what a variable of a closure holds, in a list; an empty one for nothing."""
    try:
        return [cell.cell_contents]
    except ValueError:
        return []


def _names(code: types.CodeType) -> Iterator[str]:
    """Yield the names that a function uses, and those of the functions in it."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _names(constant)


def _is_users(module: str | None) -> bool:
    """Tell whether a module is a user's own: neither armgpi's, nor Python's, nor of an installed package."""
    root = (module or "").partition(".")[0]
    if not root or root == "armgpi" or root == "builtins" or root in sys.stdlib_module_names:
        return False
    return "site-packages" not in (getattr(sys.modules.get(module or ""), "__file__", None) or "")
