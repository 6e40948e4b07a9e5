"""State trees: what a controller or a plant carries from sample to sample, walked in one place.

A node is a tuple, named or not, and None is a node without leaves; all else is a leaf. Leaves come depth
first in the order of the fields, so what one walk lays out in memory another finds again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from armgpi.codegen.symbols import NotElementwise


class Leaf(NamedTuple):
    """A leaf of a state tree.

    Attributes:
        path: names of fields, or places in a plain tuple, with dots between them; "" for a tree of one leaf.
        value: what is there.
    """

    path: str
    value: Any


def children(node: tuple[Any, ...]) -> Iterator[tuple[str, Any]]:
    """Yield the parts of a tuple, each with the name of its field, or its place where it has none."""
    return zip(getattr(node, "_fields", map(str, range(len(node)))), node, strict=True)


def join(path: str, step: str) -> str:
    """Return a path with one more step."""
    return f"{path}.{step}" if path else step


def flatten(tree: Any, path: str = "") -> list[Leaf]:
    """Return the leaves of a tree; their paths begin with `path`."""
    if tree is None:
        return []
    if not isinstance(tree, tuple):
        return [Leaf(path, tree)]
    return [leaf for step, part in children(tree) for leaf in flatten(part, join(path, step))]


def unflatten(like: Any, leaves: Iterable[Any]) -> Any:
    """Return a tree of the form and the types of `like` with other leaves.

    Raises:
        ValueError: when there are more or fewer leaves than in `like`.
    """
    waiting = iter(leaves)
    end = object()

    def fill(node: Any) -> Any:
        if node is None:
            return None
        if isinstance(node, tuple):
            # A state's own __new__ may check numbers, and these may be symbols.
            return tuple.__new__(type(node), [fill(part) for part in node])
        if (leaf := next(waiting, end)) is end:
            raise ValueError("fewer leaves than the tree has")
        return leaf

    tree = fill(like)
    if next(waiting, end) is not end:
        raise ValueError("more leaves than the tree has")
    return tree


def map_leaves(function: Callable[[Any], Any], tree: Any) -> Any:
    """Return a tree of the same form whose leaves are what `function` makes of them, first leaf first."""
    return unflatten(tree, [function(leaf.value) for leaf in flatten(tree)])


def numbers(tree: Any) -> list[Leaf]:
    """Return the leaves of a state before a sample: float64 arrays, floats and counts (int).

    Raises:
        NotElementwise: when one is something else. Other types have other sums, quotients and bits than C's
            double.
    """
    leaves = flatten(tree)
    for _, value in leaves:
        if isinstance(value, np.ndarray):
            if value.dtype != np.float64:
                raise NotElementwise(f"its state holds an array of {value.dtype}")
        elif not isinstance(value, float | int) or isinstance(value, bool):
            raise NotElementwise(f"its state holds a {type(value).__name__}")
    return leaves


def leaves_like(tree: Any, like: Any) -> list[Any]:
    """Return the leaves of a state after a sample, which must have the form that it had before.

    Raises:
        NotElementwise: when it has another.
    """
    # By places, not by types: a law may return a plain tuple for its own named one.
    if _form(tree) != _form(like):
        raise NotElementwise("its state has another form after a sample than before")
    return [leaf.value for leaf in flatten(tree)]


def _form(tree: Any) -> Any:
    """Return a tree with True in place of its leaves and plain tuples for nodes, which can be compared."""
    if isinstance(tree, tuple):
        return tuple(map(_form, tree))
    return None if tree is None else True
