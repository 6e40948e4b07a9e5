"""What a run of the suite samples of a corpus; `make search` tries all of it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def sample(cases: Iterable[Any], every: int = 2) -> list[Any]:
    """Return cases for `parametrize`, of which all but each second, say, wait for `make search`."""
    return [case if i % every == 0 else for_search(case) for i, case in enumerate(cases)]


def for_search(*values: Any) -> Any:
    """Return a case that `make search` alone tries."""
    return pytest.param(*values, marks=pytest.mark.search)
