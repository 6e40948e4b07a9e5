"""What every test of `validate` shares."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from armgpi.validation import course


@pytest.fixture(autouse=True)
def search_failures(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """Allow four times the processor time, as the machine may be busy; a search that fails fails the test.

    What failed is yielded: a test that expects it takes it out.
    """
    failures: list[str] = []

    class Watched(course.Course):
        def left_out(self) -> tuple[str, ...]:
            failures.extend(self.failures)
            return super().left_out()

    monkeypatch.setattr(course, "TOTAL", 4.0 * course.TOTAL)
    monkeypatch.setattr("armgpi.validation.check.Course", Watched)
    yield failures
    assert not failures, failures
