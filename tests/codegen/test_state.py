"""State trees: what is taken apart can be put together again, whatever its form."""

from __future__ import annotations

from collections import namedtuple
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgpi.codegen.state import children, flatten, leaves_like, map_leaves, numbers, unflatten
from armgpi.codegen.symbols import NotElementwise


def named(parts: list[Any]) -> Any:
    """Return a named tuple of a type of its own."""
    return namedtuple("Node", [f"f{i}" for i in range(len(parts))])(*parts)


LEAVES = st.one_of(
    st.integers(), st.floats(allow_nan=False), st.lists(st.floats(), max_size=3).map(np.array), st.text()
)
TREES = st.recursive(
    st.one_of(LEAVES, st.none()),
    lambda parts: st.lists(parts, max_size=4).flatmap(lambda x: st.sampled_from([tuple(x), named(x)])),
    max_leaves=12,
)


def same(one: Any, other: Any) -> bool:
    """Tell whether two trees have the same types of nodes and the very same leaves."""
    if isinstance(one, tuple):
        alike = type(one) is type(other) and len(one) == len(other)
        return alike and all(same(a, b) for a, b in zip(one, other, strict=True))
    return one is other


@given(TREES)
def test_a_tree_is_its_form_and_its_leaves(tree: Any) -> None:
    assert same(unflatten(tree, [leaf.value for leaf in flatten(tree)]), tree)
    assert same(map_leaves(lambda leaf: leaf, tree), tree)


@given(TREES)
def test_a_path_leads_to_its_leaf_and_no_two_are_the_same(tree: Any) -> None:
    found = flatten(tree)
    assert len({leaf.path for leaf in found}) == len(found)
    for path, value in found:
        node = tree
        for step in path.split(".") if path else []:
            node = dict(children(node))[step]
        assert node is value


@given(TREES)
def test_leaves_are_replaced_in_their_order(tree: Any) -> None:
    count = len(flatten(tree))
    changed = unflatten(tree, range(count))
    assert leaves_like(changed, tree) == list(range(count))
    assert [leaf.path for leaf in flatten(changed)] == [leaf.path for leaf in flatten(tree)]


@given(TREES)
def test_too_few_and_too_many_leaves_are_refused(tree: Any) -> None:
    count = len(flatten(tree))
    with pytest.raises(ValueError, match="more leaves"):
        unflatten(tree, range(count + 1))
    if count:
        with pytest.raises(ValueError, match="fewer leaves"):
            unflatten(tree, range(count - 1))


@given(TREES)
def test_another_form_is_refused(tree: Any) -> None:
    for other in ((tree,), (tree, None), None if tree is not None else 0.0):
        with pytest.raises(NotElementwise, match="another form"):
            leaves_like(other, tree)


def test_what_is_no_number_of_float64_is_refused() -> None:
    good = (np.zeros(3), (0.5, None), 7)
    assert [leaf.path for leaf in numbers(good)] == ["0", "1.0", "2"]
    for bad, words in (
        (np.zeros(3, dtype=np.float32), "an array of float32"),
        (np.zeros(3, dtype=int), "an array of int64"),
        (True, "a bool"),
        ("text", "a str"),
        ([0.0], "a list"),
    ):
        with pytest.raises(NotElementwise, match=words):
            numbers((good, bad))
