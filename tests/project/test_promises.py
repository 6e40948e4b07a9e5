"""Every promise of the documentation names tests that there are, and no promise is without one."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROMISES = [
    " ".join(part.split())
    for part in re.findall(r"(?ms)^- (.*?)(?=^- |^## |\Z)", (ROOT / "docs" / "promises.md").read_text())
]


@pytest.mark.parametrize("promise", PROMISES)
def test_a_promise_is_held_by_tests_that_there_are(promise: str) -> None:
    named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", promise)
    assert named
    for file, name in named:
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_there_are_promises() -> None:
    assert len(PROMISES) >= 13
