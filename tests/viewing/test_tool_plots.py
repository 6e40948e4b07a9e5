"""Plots of velocities, of the tool and of forces show what the rollout has."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import armgpi
from armgpi.errors import RolloutError
from armgpi.viewing import plots, report

Q0 = np.array([0.0, -1.2, 1.5, -1.87, -1.57, 0.3])


@pytest.fixture(scope="module")
def touched() -> xr.Dataset:
    arm = armgpi.Robot.load("ur5").with_armature(0.5)
    push = armgpi.ToolForce(force=[10.0, 0.0, 0.0], onset=0.1)
    plant = armgpi.RigidBodyPlant(arm, environment=[push])
    return armgpi.simulate(plant, armgpi.GPI(arm, dt=1e-3), armgpi.Bezier(Q0, Q0 + 0.15, 0.2), 0.25)


def test_velocities_are_drawn_with_their_reference(touched: xr.Dataset) -> None:
    figure = plots.velocities(touched, ["wrist_1_joint"])
    (axes,) = figure.axes
    drawn = [line.get_ydata() for line in axes.get_lines()]
    joint = touched.sel(joint="wrist_1_joint")
    for name in ("v", "v_ref"):
        assert any(np.array_equal(line, joint[name].values) for line in drawn)
    assert axes.get_ylabel() == "velocity [rad/s]"
    with pytest.raises(RolloutError, match="no velocities"):
        plots.velocities(touched.drop_vars("v"))


def test_rates_of_torque_are_the_changes_from_sample_to_sample(touched: xr.Dataset) -> None:
    figure = plots.torque_rates(touched, ["wrist_1_joint"])
    (axes,) = figure.axes
    (line,) = (each for each in axes.get_lines() if len(each.get_xdata()) > 2)
    tau, time = touched["tau"].sel(joint="wrist_1_joint").values, touched["time"].values
    np.testing.assert_allclose(np.asarray(line.get_ydata()), np.diff(tau) / np.diff(time))
    np.testing.assert_array_equal(line.get_xdata(), time[1:])
    assert axes.get_ylabel() == "torque rate [N m/s]"
    assert len(plots.torque_rates(touched.isel(time=[0])).axes) == touched.sizes["joint"]


def test_the_tool_has_a_panel_for_error_angle_and_force(touched: xr.Dataset) -> None:
    figure = plots.tool(touched)
    error, angle, force = (np.asarray(axes.get_lines()[0].get_ydata(), dtype=float) for axes in figure.axes)
    np.testing.assert_allclose(error.max(), float(armgpi.metrics.tool_error(touched)[0]))
    np.testing.assert_allclose(angle.max(), float(armgpi.metrics.tool_angle(touched)[0]), rtol=1e-6)
    assert (force.min(), force.max()) == (0.0, 10.0)
    assert len(plots.tool(touched.drop_vars(["contact_force", "contact_point"])).axes) == 2
    with pytest.raises(RolloutError, match="no tool"):
        plots.tool(touched.drop_vars("tool"))


def test_the_report_has_them_too(touched: xr.Dataset) -> None:
    page = report.build(touched)
    for words in (
        "Velocity",
        "Torque rate",
        "Tool error",
        "Tool angle",
        "Force",
        "metrics of the tool",
        "peak force",
    ):
        assert words in page


def test_the_report_has_an_estimated_force_between_its_least_and_most(touched: xr.Dataset) -> None:
    robot = armgpi.Robot.load("ur5").with_armature(0.5)
    known = robot.with_friction([1.0] * 6, [1.0] * 6)
    estimated = armgpi.tool_wrench(touched, known)
    assert "Estimated force" in report.build(estimated)
    assert "Estimated force" not in report.build(touched)
    value, least, most = report._estimated_force(estimated)
    # The box of the intervals contains the estimate, and so its length is between.
    assert (least <= value + 1e-9).all()
    assert (value <= most + 1e-9).all()
    assert float((most - least).max()) > 0.1


def test_the_estimated_force_is_drawn_axis_by_axis(touched: xr.Dataset) -> None:
    estimated = armgpi.tool_wrench(touched, armgpi.Robot.load("ur5").with_armature(0.5))
    with pytest.raises(armgpi.errors.RolloutError, match="tool_wrench"):
        plots.wrench(touched)
    if "rollout" in estimated["estimated_force"].dims:
        with pytest.raises(armgpi.errors.RolloutError, match="choose one"):
            plots.wrench(estimated)
        estimated = estimated.isel(rollout=0)
    figure = plots.wrench(estimated)
    assert len(figure.axes) == 3
    for axes, axis in zip(figure.axes, "xyz", strict=True):
        drawn = np.asarray(axes.lines[0].get_ydata())
        np.testing.assert_array_equal(drawn, estimated["estimated_force"].sel(axis=axis).values)
