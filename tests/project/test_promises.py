"""Every promise of the documentation names tests that there are, and no promise is without one."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "promises.md").read_text(encoding="utf-8")
#: Items of the lists: a promise, and the numbers of its tests.
PROMISES = re.findall(r"(?ms)^- ((?:(?!^- ).)+?) \*Tests? ([\d, to]+)\.\*", PAGE)
TESTS = dict(re.findall(r"(?m)^ *(\d+) (tests/\S+)$", PAGE))


def numbers(text: str) -> list[str]:
    """Return the numbers that `1, 3 to 5` has."""
    found = (re.split(" to ", part) for part in text.split(", "))
    return [str(each) for first, *last in found for each in range(int(first), int((last or [first])[0]) + 1)]


@pytest.mark.parametrize(("promise", "held_by"), PROMISES)
def test_a_promise_is_held_by_tests_that_there_are(promise: str, held_by: str) -> None:
    for number in numbers(held_by):
        file, name = TESTS[number].split("::")
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, promise


def test_every_test_is_of_a_promise_and_there_are_promises() -> None:
    assert {number for _, held_by in PROMISES for number in numbers(held_by)} == set(TESTS)
    assert len(PROMISES) >= 26
