"""The published tables are copied as printed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from armgpi.paper import published

PAPER = Path(__file__).parents[3] / "shared" / "paper" / "galvan-perez-2022.md"


def number(text: str) -> float:
    """Read 3.01 or $2.60 \\times 10^{-3}$."""
    found = re.fullmatch(r"\$?([\d.]+)(?: \\times 10\^\{(-?\d+)\})?\$?", text.strip())
    assert found
    return float(f"{found[1]}e{found[2] or 0}")


@pytest.mark.skipif(not PAPER.exists(), reason="the paper's text is not part of this repository")
@pytest.mark.parametrize("table", published.TABLES, ids=lambda table: f"Table {table.number}")
def test_the_tables_are_those_of_the_paper(table: published.Table) -> None:
    text = PAPER.read_text(encoding="utf-8").split(f"**Table {table.number}.**")[1]
    rows = [line.split("\t") for line in text.splitlines() if line.startswith("$q_")][:3]
    columns = list(zip(*([number(cell) for cell in row[1:]] for row in rows), strict=True))
    assert columns == [table.pid.itae, table.pid.isci, table.proposal.itae, table.proposal.isci]


def test_table_4_is_minus_20_percent() -> None:
    assert [(table.number, table.inertia_scale) for table in published.TABLES] == [
        (2, 1.0),
        (3, 1.2),
        (4, 0.8),
    ]


@pytest.mark.parametrize(
    ("ours", "theirs", "status"),
    [
        (1.0, 2.0, "better"),
        (2.0, 2.0, "better"),
        (2.1, 2.0, "same order"),
        (19.9, 2.0, "same order"),
        (20.0, 2.0, "worse"),
        (None, 2.0, "diverged"),
        (1.0, None, "not stated"),
    ],
)
def test_a_status_says_how_a_figure_compares(ours: float | None, theirs: float | None, status: str) -> None:
    assert published.status(ours, theirs) == status
