"""What alternatives of an expression are where it stands, all of them seen in one run of the model.

To try an alternative takes a run of the model. Many need none: they raise, leave the value of the expression,
or have that of another alternative. One run in which every alternative of one expression is computed tells
which; those of the same values at every pass give the same.
"""

from __future__ import annotations

import ast
import time
from collections.abc import Hashable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.validation.edits import Block, Editor, Pick, code_of

#: An expression of fewer alternatives is not looked at: to try them takes no longer.
_FEWEST = 4
#: To look at all may take this share of the time of trying each: an expression may be passed a hundred times.
_WORTH = 0.2
#: What an alternative is that raises, and one of which nothing is known.
RAISES, UNKNOWN = "raises", None


class Seen(NamedTuple):
    """What one run of a function has shown of an expression.

    Attributes:
        own: what the expression itself was, at every pass; None when it cannot be told.
        others: for each alternative what it was at every pass, or `RAISES`, or `UNKNOWN`.
    """

    own: Hashable
    others: tuple[Hashable, ...]


class Probes:
    """What the alternatives of a source are, looked at where they stand and kept."""

    def __init__(self, editor: Editor, start: Mapping[str, Array]) -> None:
        """Take a source with its switches, and what its functions give at the first states."""
        self._editor, self._start = editor, start
        self._seen: dict[tuple[int, int, str, int], Seen | None] = {}
        self._seconds: dict[str, float] = {}  # that one run of a function takes

    def of(self, pick: Pick, name: str, rows: int) -> tuple[Hashable, Hashable]:
        """Return what an expression and an alternative are while a function runs at the first states.

        Args:
            pick: the alternative.
            name: the function.
            rows: at how many states.

        Returns:
            Of both a value that is equal for what gives the same; `UNKNOWN` where that cannot be told, and
            `RAISES` for an alternative that raises.
        """
        if pick.values is not None or pick.call is not None:
            return UNKNOWN, UNKNOWN
        place = (id(pick.block), pick.site, name, rows)
        if place not in self._seen:
            self._seen[place] = self._look(pick.block, pick.site, name, rows)
        seen = self._seen[place]
        if seen is None or pick.choice >= len(seen.others):
            return UNKNOWN, UNKNOWN
        return seen.own, seen.others[pick.choice]

    def _look(self, block: Block, k: int, name: str, rows: int) -> Seen | None:
        """Run a function once with every alternative of an expression; None where that tells nothing."""
        site = block.sites[k]
        count = len(site.choices) - site.fitted - site.whole
        if count < _FEWEST or site.span is not None or site.statement:
            return None
        late = time.process_time() + _WORTH * count * rows * self._seconds_of(name)
        looking = _Looking(block, site.node, [node for _, node in site.choices[:count]], late)
        with self._editor.looking(block, k, looking):
            after = self._editor.outputs([name], rows)
        if after is None or not np.array_equal(self._start[name][:rows], after[name]):
            return None  # to compute an alternative has changed something
        return looking.seen()

    def _seconds_of(self, name: str) -> float:
        """Return how long one run of a function takes [s]."""
        if name not in self._seconds:
            start = time.process_time()
            self._editor.outputs([name], 1)
            self._seconds[name] = time.process_time() - start
        return self._seconds[name]


class _Looking:
    """Computes all alternatives of an expression where it stands, and gives what the expression is."""

    def __init__(self, block: Block, own: ast.expr, others: Sequence[ast.expr], late: float) -> None:
        self._namespace, self._late = block.namespace, late
        self._was_late = False
        self._own = code_of(own)
        self._codes = {k: code for k, node in enumerate(others) if (code := code_of(node)) is not None}
        self._raising: set[int] = set()
        self._own_values: list[Hashable] = []
        self._values: dict[int, list[Hashable]] = {k: [] for k in self._codes}
        self._count = len(others)
        self._is_running = False

    def __call__(self, names: dict[str, Any]) -> Any:
        """Return what the expression is, given the local variables."""
        # As globals: what is inside of an expression, such as a generator, sees no locals of `eval`.
        space = {**self._namespace, **names}
        assert self._own is not None
        value = eval(self._own, space)
        self._was_late = self._was_late or time.process_time() > self._late
        if (
            self._is_running or self._was_late
        ):  # an alternative calls the function in which the expression stands
            return value
        self._is_running = True
        try:
            self._own_values.append(_key(value))
            for k, code in self._codes.items():
                if k in self._raising:
                    continue
                try:
                    self._values[k].append(_key(eval(code, space)))
                except Exception:
                    self._raising.add(k)
        finally:
            self._is_running = False
        return value

    def seen(self) -> Seen:
        """Return what was seen."""
        others: list[Hashable] = []
        for k in range(self._count):
            if k in self._raising:
                others.append(RAISES)
            elif self._was_late:
                others.append(UNKNOWN)
            else:
                others.append(_joined(self._values.get(k, [UNKNOWN])))
        return Seen(_joined(self._own_values), tuple(others))


def _joined(values: Sequence[Hashable]) -> Hashable:
    """Return the values of all passes as one, `UNKNOWN` where one of them is."""
    return UNKNOWN if any(value is UNKNOWN for value in values) else tuple(values)


def _key(value: Any) -> Hashable:
    """Return what is equal for equal numbers, arrays and texts, and for lists of them; else `UNKNOWN`."""
    if isinstance(value, np.ndarray):
        return UNKNOWN if value.dtype.kind == "O" else (value.shape, value.dtype.char, value.tobytes())
    if isinstance(value, np.number):
        value = value.item()  # of NumPy, == with a tuple is no truth value
    if isinstance(value, int | float | complex | str):
        return value
    if isinstance(value, tuple | list):
        keys = tuple(map(_key, value))
        return UNKNOWN if any(key is UNKNOWN for key in keys) else (type(value).__name__, keys)
    return UNKNOWN
