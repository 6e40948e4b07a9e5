"""One reference per rollout: thousands of one kind are followed as one with arrays."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, as_times, is_listing
from armgpi.errors import ArrayError, ParameterError
from armgpi.references.bezier import Bezier
from armgpi.references.recorded import Recorded
from armgpi.references.reference import Reference, Target
from armgpi.references.waypoints import Hold, Waypoints


class ReferenceBatch(Reference):
    """One reference per rollout, each for a single arm.

    References of one kind (:class:`Hold`, :class:`Bezier`, :class:`Waypoints` with as many points,
    :class:`Recorded` at the same times) are evaluated together and cost what one with arrays does. Others
    are evaluated one by one.

    Attributes:
        references: the references.
    """

    def __init__(self, references: Sequence[Reference]) -> None:
        """Stack references: the i-th is followed by rollout i.

        Raises:
            ParameterError: when there are none.
            ArrayError: when one is for several rollouts, or for another number of joints.
        """
        listed = is_listing(references) and len(references) > 0
        if not listed or not all(isinstance(part, Reference) for part in references):
            raise ParameterError("references", references, "a sequence of at least one Reference")
        shapes = [reference.at(0.0).q.shape for reference in references]
        if len(shapes[0]) != 1 or len(set(shapes)) > 1:
            raise ArrayError(
                "references", f"expected one configuration of the same joints each, got {shapes}"
            )
        self.references = tuple(references)
        self._n = shapes[0][0]

    def __getstate__(self) -> dict[str, Any]:
        """Return the references: what is made of them is made anew."""
        return {"references": self.references, "_n": self._n}

    @cached_property
    def _stacks(self) -> _Stacks:
        """As few references as follow all of these; what several rollouts follow is there once."""
        kinds: dict[Any, dict[int, Reference]] = {}
        for reference in self.references:
            kinds.setdefault(_kind(reference), {})[id(reference)] = reference
        parts: list[Reference] = []
        rows: dict[int, int] = {}
        for alike in kinds.values():
            members = list(alike.values())
            parts.append(_join(members) if len(members) > 1 else members[0])
            for identity in alike:
                rows[identity] = len(rows)
        counts = [len(alike) for alike in kinds.values()]
        row_of_rollout = [rows[id(reference)] for reference in self.references]
        return _Stacks(parts, counts, np.array(row_of_rollout))

    def as_arrays(self) -> Reference:
        """Return one reference with arrays that is the same, where there is one; itself otherwise."""
        parts, _, rows = self._stacks
        in_order = np.array_equal(rows, np.arange(len(rows)))
        if len(parts) != 1 or not in_order:
            return self
        has_all_rows = parts[0].at(0.0).q.shape == (len(rows), self._n)
        return parts[0] if has_all_rows else self

    def at(self, t: float | Array) -> Target:
        """Return the targets at `t` [s], (batch, n) or (k, batch, n); see :meth:`Reference.at`."""
        parts, counts, rows = self._stacks
        times = as_times(t)
        # Of each part with all that it follows as rows, then a row for each rollout.
        q, v, a = [], [], []
        for reference, count in zip(parts, counts, strict=True):
            shape = (*np.shape(times), count, self._n)
            target = reference.at(times)
            q.append(np.reshape(target.q, shape))
            v.append(np.reshape(target.v, shape))
            a.append(np.reshape(target.a, shape))
        stacked = (np.concatenate(values, axis=-2) for values in (q, v, a))
        return Target(*(values[..., rows, :] for values in stacked))

    def describe(self) -> dict[str, Any]:
        """Return the references as plain data."""
        return {"type": "ReferenceBatch", "references": [part.describe() for part in self.references]}


class _Stacks(NamedTuple):
    """References that together follow all of a batch.

    Attributes:
        parts: each for one or several rollouts, m: its targets are (n,), (m, n) or (m n).
        counts: the m of each.
        rows: which of their rollouts each rollout of the batch is, shape (batch,).
    """

    parts: list[Reference]
    counts: list[int]
    rows: Array


def _kind(reference: Reference) -> Any:
    """Return what is equal for references that :func:`_join` joins; a subclass is a kind of its own."""
    if type(reference) in (Hold, Bezier, Waypoints):
        return type(reference), *reference.variables()
    if type(reference) is Recorded:
        return Recorded, reference.times.tobytes()
    return id(reference)


def _join(references: list[Any]) -> Any:
    """Return one reference for the rollouts of several of one kind."""
    first = references[0]
    if isinstance(first, Recorded):
        return first.widen(references[1:])
    variables = [reference.variables() for reference in references]
    columns = {}
    for name in variables[0]:
        column = np.array([values[name] for values in variables], dtype=float)
        columns[name] = column if column.ndim == 2 else column[:, None]
    return first.with_values(**columns)
