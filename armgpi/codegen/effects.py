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
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from armgpi.codegen.symbols import NotElementwise

# Why this is worth a module: a law that counts its calls in a global gives one number while it is traced, and
# the generated code would have that number in it for ever. It would run wrong without a word.

#: Most things that are checked: of what reaches more than this, the rest is not checked. A law that hides
#: what it changes behind so many is found by the comparison with NumPy instead (codegen/run.py).
_MOST = 10_000
_MISSING = object()


class _Place(NamedTuple):
    """Something that may change: its name, how to read it, its value before and how to restore it."""

    name: str
    look: Callable[[], Any]
    before: Any
    restore: Callable[[], object]

    @property
    def has_changed(self) -> bool:
        now, before = self.look(), self.before
        # Things must be the same ones, not equal ones: == of arrays or symbols is no bool.
        if isinstance(before, list):
            return len(now) != len(before) or not all(map(operator.is_, now, before))
        return bool(now != before)


class SideEffects:
    """What laws reach outside of themselves, as it was when :meth:`watch` was called."""

    def __init__(self) -> None:
        """Watch nothing yet."""
        self._places: list[_Place] = []
        self._seen: dict[int, Any] = {}  # with the things themselves, as an id may be used again
        self._watches_random = False

    def watch_random(self) -> None:
        """Watch the random numbers of Python and NumPy: for a law of a user's, as threads draw them too."""
        if self._watches_random:
            return
        self._watches_random = True
        self._random("random", random.getstate, random.setstate)
        self._random("np.random", np.random.get_state, np.random.set_state)

    def watch(self, value: Any) -> None:
        """Watch all that a function or a class reaches.

        Without recursion, as chains of objects may be longer than Python's stack.

        Raises:
            NotElementwise: when that is an iterator, whose place cannot be read.
        """
        waiting = [(value, "")]
        while waiting and len(self._seen) < _MOST:
            value, name = waiting.pop()
            if id(value) in self._seen:
                continue
            self._seen[id(value)] = value
            for kinds, follow in _WAYS:
                if isinstance(value, kinds):
                    waiting += follow(self, value, name)
                    break
            else:
                if _is_users(type(value).__module__) and hasattr(value, "__dict__"):
                    waiting += [*self._dict(vars(value), name), (type(value), name)]

    def changes(self) -> list[str]:
        """Return the names of what is not as it was."""
        return [place.name for place in self._places if place.has_changed]

    def restore(self) -> None:
        """Make everything as it was."""
        # Only what changed: putting back what is the same could call a user's setter.
        for place in self._places:
            if place.has_changed:
                place.restore()

    def _tuple(self, value: tuple[Any, ...], name: str) -> Iterable[tuple[Any, str]]:
        """Return what is in a tuple, which does not change itself."""
        return [(item, name) for item in value]

    def _list(self, value: Any, name: str) -> Iterable[tuple[Any, str]]:
        """Watch a list or a deque."""
        self._container(name, value, value.extend, lambda: list(value))
        return [(item, name) for item in value]

    def _set(self, value: set[Any], name: str) -> Iterable[tuple[Any, str]]:
        """Watch a set, whose elements do not change, as they have hashes."""
        self._container(name, value, value.update, value.copy)
        return ()

    def _iterator(self, value: Iterator[Any], name: str) -> Iterable[tuple[Any, str]]:
        """Refuse an iterator: its place cannot be read without moving it on."""
        raise NotElementwise(f"it reaches an iterator ({name})")

    def _function(self, function: types.FunctionType, name: str) -> Iterator[tuple[Any, str]]:
        """Watch the globals that a user's function names, its closure, its defaults and its attributes."""
        if not _is_users(function.__module__):
            return
        # Only what is named can be reached, and a module has thousands of names that are not.
        names = set(_names(function.__code__))
        for used in names:
            yield from self._slot(function.__globals__, used)
            module = function.__globals__.get(used)
            if isinstance(module, types.ModuleType) and _is_users(module.__name__):
                for attribute in names & vars(module).keys():
                    yield from self._slot(vars(module), attribute)
        for free, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
            yield from self._cell(cell, free)
        yield function.__defaults__, function.__name__
        yield function.__kwdefaults__, function.__name__
        yield from self._dict(vars(function), function.__name__)

    def _class(self, kind: type, name: str) -> Iterator[tuple[Any, str]]:
        """Watch the attributes of a user's class and of those that it comes from."""
        if not _is_users(kind.__module__):
            return
        for attribute, item in list(vars(kind).items()):
            if not attribute.startswith("__"):
                self._attribute(kind, attribute)
            # What is behind a static or class method, or a property.
            item = getattr(item, "__func__", getattr(item, "fget", item))
            yield item, f"{kind.__name__}.{attribute}"
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
        """Watch what one name refers to."""

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
        # Keys as well as values: one may be replaced by an equal one that is another thing.
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

    def _array(self, value: Any, name: str) -> Iterable[tuple[Any, str]]:
        """Watch an array."""
        old = value.copy()
        # By its bytes, as NaN is not equal to itself.
        look = value.tobytes if value.dtype != object else lambda: list(value.flat)
        self._note(name, look, lambda _: np.copyto(value, old))
        return ()

    def _python_random(self, value: random.Random, name: str) -> Iterable[tuple[Any, str]]:
        """Watch one of Python's generators of random numbers."""
        self._random(name, value.getstate, value.setstate)
        return ()

    def _generator(self, value: np.random.Generator, name: str) -> Iterable[tuple[Any, str]]:
        """Watch one of NumPy's."""
        bits = value.bit_generator
        self._random(name, lambda: bits.state, lambda old: setattr(bits, "state", old))
        return ()

    def _random_state(self, value: np.random.RandomState, name: str) -> Iterable[tuple[Any, str]]:
        """Watch one of NumPy's older ones."""
        self._random(name, value.get_state, value.set_state)
        return ()

    def _random(self, name: str, get: Callable[[], Any], put: Callable[[Any], object]) -> None:
        """Watch a source of random numbers."""
        # Pickled, as its state may be arrays in tuples, which have no one == for all of it.
        self._note(name, lambda: pickle.dumps(get()), lambda old: put(pickle.loads(old)))

    def _note(self, name: str, look: Callable[[], Any], put: Callable[[Any], object]) -> None:
        before = look()
        self._places.append(_Place(name, look, before, lambda: put(before)))


#: How each kind of thing is watched; the first that fits.
_WAYS: tuple[tuple[Any, Callable[[SideEffects, Any, str], Iterable[tuple[Any, str]]]], ...] = (
    (types.FunctionType, SideEffects._function),
    (type, SideEffects._class),
    (tuple, SideEffects._tuple),
    ((list, deque), SideEffects._list),
    (set, SideEffects._set),
    (dict, SideEffects._dict),
    (np.ndarray, SideEffects._array),
    (random.Random, SideEffects._python_random),
    (np.random.Generator, SideEffects._generator),
    (np.random.RandomState, SideEffects._random_state),
    (Iterator, SideEffects._iterator),
)


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
    # Packages keep caches in globals, which change when they are used and mean nothing.
    return "site-packages" not in (getattr(sys.modules.get(module or ""), "__file__", None) or "")
