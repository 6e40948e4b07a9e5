"""The published tables are copied as printed."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from armgpi import GPI, FixedGains, RigidBodyPlant, Robot, Waypoints, metrics, simulate
from armgpi.paper import published
from armgpi.plants.loads import Sine, paper_disturbances

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


@pytest.fixture(scope="module")
def fixed() -> dict[float, np.ndarray]:
    """ITAE of the joints under the paper's loads, ideal sensors and fixed gains; factor on D(q) -> (3,)."""
    arm, goal = Robot.load("anthropomorphic3"), np.array([0.8, 0.4, -0.4])
    move = Waypoints([0 * goal, goal, 0 * goal], durations=3.0, holds=[1.0, 8.0, 25.0])
    found = {}
    for scale in (1.0, 0.8):
        gpi = GPI(arm.scaled_inertia(scale), 5e-3, FixedGains(20.0))
        run = simulate(RigidBodyPlant(arm, paper_disturbances()), gpi, move, 40.0)
        found[scale] = metrics.itae(run).values
    return found


def test_the_proposal_of_table_4_grows_as_no_stable_loop_does(fixed: dict[float, np.ndarray]) -> None:
    two, _, four = (table.proposal for table in published.TABLES)
    growth = np.array(four.itae) / np.array(two.itae)
    np.testing.assert_allclose(growth, [60.0, 31.0, 3.7], rtol=0.01)
    assert four.isci[0] / two.isci[0] == pytest.approx(4.43, abs=0.01)
    assert (fixed[0.8] / fixed[1.0] < 1.5).all()


def test_the_last_joint_is_the_worst_under_the_papers_loads(fixed: dict[float, np.ndarray]) -> None:
    for table in published.TABLES:
        assert list(table.proposal.itae) == sorted(table.proposal.itae, reverse=True)
    for itae in fixed.values():
        assert list(itae) == sorted(itae)


def test_the_vibrating_torques_are_slower_than_a_tenth_of_a_hertz() -> None:
    frequencies = {load.omega / (2.0 * np.pi) for load in paper_disturbances() if isinstance(load, Sine)}
    np.testing.assert_allclose(sorted(frequencies), [0.016, 0.080], atol=5e-4)
