"""Tables of text: lines are bounded."""

from __future__ import annotations

import io

import pytest

from armgpi.base import columns


def test_a_line_of_a_table_is_as_long_as_is_said_and_no_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(columns, "_LONGEST", 10)
    assert list(columns._lines(io.StringIO("123456789\n\nab\n"))) == ["123456789\n", "ab\n"]
    with pytest.raises(ValueError, match="line 2 has more than 10 characters"):
        list(columns._lines(io.StringIO("1\n0123456789\n")))
