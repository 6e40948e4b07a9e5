"""Python's compare, report and view: what the commands of these names do, from rollouts in memory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armgpi
from armgpi.errors import ParameterError
from armgpi.viewing import page

ARM = armgpi.Robot.load("anthropomorphic3")
PLANT = armgpi.RigidBodyPlant(ARM)
MOVE = armgpi.Bezier(ARM.middle(), ARM.middle() + 0.1, 0.05)


def compared() -> Any:
    return armgpi.compare(PLANT, {"one": armgpi.GPI(ARM, 1e-3), "two": armgpi.GPI(ARM, 1e-3)}, MOVE, 0.06)


def test_a_comparison_has_what_simulate_gives_and_prints_a_table() -> None:
    found = compared()
    alone = armgpi.simulate(PLANT, armgpi.GPI(ARM, 1e-3), MOVE, 0.06)
    np.testing.assert_array_equal(found.rollouts["two"]["q"], alone["q"])
    head, *rows = repr(found).splitlines()
    assert head.startswith("controller")
    assert [row.split()[0] for row in rows] == ["one", "two"]
    assert f"{float(armgpi.metrics.itae(alone).sum()):.4g}" in rows[0]
    assert "<table>" in found._repr_html_()


def test_equal_classes_of_a_list_get_labels_of_their_own() -> None:
    found = armgpi.compare(PLANT, [armgpi.GPI(ARM, 1e-3), armgpi.GPI(ARM, 1e-3)], MOVE, 0.01)
    assert [*found.rollouts] == ["GPI", "GPI'"]


@pytest.mark.parametrize("controllers", [{}, [], None, {1: armgpi.GPI(ARM, 1e-3)}])
def test_no_controllers_are_refused(controllers: Any) -> None:
    with pytest.raises(ParameterError, match="controllers"):
        armgpi.compare(PLANT, controllers, MOVE, 0.01)


def test_a_report_of_a_comparison_names_each_controller(tmp_path: Path) -> None:
    html = armgpi.report(compared(), tmp_path / "report.html").read_text(encoding="utf-8")
    assert "one" in html
    assert "two" in html
    with pytest.raises(ParameterError, match=r"ends in \.html"):
        armgpi.report(compared(), tmp_path / "report.pdf")
    with pytest.raises(ParameterError, match="rollouts"):
        armgpi.report({}, tmp_path / "report.html")


def test_view_takes_robots_and_rollouts(tmp_path: Path) -> None:
    view: Any = armgpi.view
    for shown in (ARM, [ARM, ARM], compared().rollouts["one"], compared()):
        made = view(shown, tmp_path / "page.html")
        assert isinstance(made, page.Page)
        assert len(repr(made)) < 120  # an interpreter prints a line, not the page
    with pytest.raises(ParameterError, match="shown"):
        view("ur5")


def test_a_run_without_an_end_lasts_two_seconds_after_the_motion() -> None:
    rollout = armgpi.simulate(PLANT, armgpi.GPI(ARM, 1e-3), MOVE)
    assert float(rollout["time"][-1]) == pytest.approx(2.05, abs=2e-3)

    class Endless(armgpi.Reference):
        def at(self, t: Any) -> armgpi.Target:
            return MOVE.at(t)

    with pytest.raises(ParameterError, match="t_final"):
        armgpi.simulate(PLANT, armgpi.GPI(ARM, 1e-3), Endless())


def test_a_controller_prints_its_numbers() -> None:
    assert repr(armgpi.PIDInversion(ARM, 1e-3, kp=[1.0, 2.0, 3.0])) == (
        "PIDInversion('anthropomorphic3', dt=0.001, kp=[1, 2, 3], ki=500, kd=40)"
    )
    assert "omega_c=25" in repr(armgpi.GPI(ARM, 1e-3, armgpi.FixedGains(25.0)))
    assert "omega_c" in armgpi.GPI(ARM, 1e-3)._repr_html_()


def test_in_notebooks_a_controller_has_its_numbers_joint_by_joint_with_units_and_limits() -> None:
    page = armgpi.GPI(ARM, 1e-3, armgpi.FixedGains([20.0, 30.0, 25.0]))._repr_html_()
    assert "omega_c [rad/s]" in page
    assert "effort limit [N m or N]" in page
    for name, effort in zip(ARM.joint_names, ARM.limits.effort, strict=True):
        assert f"<td>{name}</td>" in page
        assert f"<td>{effort:.4g}</td>" in page
    batch = armgpi.GPI(armgpi.RobotBatch([ARM, ARM]), 1e-3)._repr_html_()
    assert "effort limit" not in batch  # the arms may differ


def test_a_supervised_controller_prints_both() -> None:
    supervised = armgpi.Supervised(armgpi.GPI(ARM, 1e-3), armgpi.Supervisor(jump=3.0))
    assert repr(supervised).startswith("Supervised(GPI('anthropomorphic3'")
    assert repr(supervised).endswith(", jump=3.0)")
    page = supervised._repr_html_()
    assert "omega_c" in page
    assert "reference_jump" in page


def test_a_plant_prints_what_is_around_it_and_inside() -> None:
    plant = armgpi.Delayed(armgpi.Encoder(armgpi.RigidBodyPlant(ARM, armgpi.Step(1.0)), bits=16), samples=1)
    assert repr(plant) == (
        "Delayed(Encoder(RigidBodyPlant('anthropomorphic3', n=3, loads: Step), bits=16), samples=1)"
    )
