"""The zoo with and without tuning: what is told of an arm is what its rollouts say, on draws of its own."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armgpi import GPI, Robot
from armgpi.errors import RolloutError
from armgpi.gpi.payload import DELAY_SHARE
from armgpi.health import reality as health
from armgpi.plants.reality import Reality, batches
from armgpi.studies.evaluation import Evaluator

ARM = "anthropomorphic3"
TOOLS = Path(__file__).parents[2] / "tools"
ZOO = runpy.run_path(str(TOOLS / "tuned_zoo.py"))


def test_an_arm_is_judged_on_draws_that_no_search_saw(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[list[Any]] = []
    monkeypatch.setitem(ZOO["run"].__globals__, "Evaluator", _noting(seen))
    row = ZOO["run"](ARM, 9, 4, seed=3)
    searched, judged = seen
    assert (len(searched), len(judged)) == (2, 4)
    assert not {draw.index for draw in searched} & {draw.index for draw in judged}
    assert all(health.demand(draw) <= 1.0 for draw in (*searched, *judged))
    found = [each for draw in judged for each in health.outcomes([draw], ARM, ZOO["RULE"])]
    assert row.rule.failed == np.mean([each.failed for each in found])
    assert row.rule.hunting == np.mean([each.hunting for each in found])
    assert row.rule.peak == pytest.approx(np.median([each.peak for each in found]), rel=1e-6)
    assert row.rule.itae == pytest.approx(np.median([each.itae for each in found]), rel=1e-6)
    assert row.tuned is not None
    assert set(row.values) == {*(f"omega q{i}" for i in (1, 2, 3)), "zeta", "rolloff_ratio"}
    assert f"| {ARM} | 3 |" in ZOO["markdown"]([row])
    assert "none holds" in ZOO["markdown"]([row._replace(tuned=None)])


@pytest.mark.filterwarnings("ignore::armgpi.ArmgpiWarning")
def test_arms_whose_controllers_differ_in_structure_are_searched_as_each_runs_alone() -> None:
    """All of a batch got one structure, which was that of none of some of them."""
    # Behind a small gear ratio encoders of 9 bits are too coarse for the controller of motor encoders.
    coarse: dict[str, Any] = {"encoder_bits": (9.0, 16.0), "gear_ratio": (30.0, 30.0), "sample_time": [1e-3]}
    reality = Reality("owned", seed=5, side_known=1.0, **coarse)
    draws = [reality.draw(Robot.load("ur5"), index) for index in (6, 7)]  # 9 and 15 bits
    section = {"type": "gpi_auto"}
    parts = list(health.alike(batches(draws), section))
    assert len(parts) > len(batches(draws))  # both structures are in one batch
    together = Evaluator(draws, ["itae"])(section, [{}])
    for column, draw in enumerate(draws):
        alone = Evaluator([draw], ["itae"])(section, [{}])
        assert together.values["itae"][0, column] == pytest.approx(alone.values["itae"][0, 0], rel=1e-9)


def _noting(seen: list[list[Any]]) -> Any:
    class Noting(Evaluator):
        def __init__(self, draws: Any, names: Any) -> None:
            seen.append(list(draws))
            super().__init__(draws, names)

    return Noting


def test_motors_that_can_follow_too_few_draws_are_told() -> None:
    weak = Robot.load(ARM).with_limits(effort=1e-3)
    with pytest.raises(RolloutError, match="can follow 0 of 16 draws"):
        ZOO["_feasible"](Reality.geared(effort_share=0.0), weak, 0, 2)


def test_it_goes_on_where_it_was(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [ARM, "--evaluations", "9", "--count", "2", "--out", str(tmp_path)]
    assert not ZOO["main"](words)
    table, parts = capsys.readouterr().out, [*tmp_path.glob("*.chunk")]
    assert f"| {ARM} | 3 |" in table
    before = [part.stat().st_mtime_ns for part in parts]
    assert len(before) == 1
    assert not ZOO["main"](words)
    assert capsys.readouterr().out == table
    assert [part.stat().st_mtime_ns for part in parts] == before


def test_the_fitted_rule_is_the_rule_with_other_numbers() -> None:
    tool = runpy.run_path(str(TOOLS / "rule.py"))
    late = {"dt": 4e-3, "delay": 4e-3, "bits": 40}  # so fine that the delay alone limits
    before = GPI.auto(Robot.load(ARM), **late)
    today = tool["Rule"]()
    with tool["rule"]({**today.keys(today.start), "DELAY_SHARE": 0.5}) as section:
        slower = GPI.auto(Robot.load(ARM), **late)
    after = GPI.auto(Robot.load(ARM), **late)
    assert section == {"type": "gpi_auto", "zeta": 1.0}
    omega = [law.gains.nominal().omega_c for law in (before, slower, after)]
    np.testing.assert_allclose(omega[1], omega[0] * 0.5 / DELAY_SHARE)
    np.testing.assert_array_equal(omega[2], omega[0])
