"""A wrench at the tool from torques and positions: found where friction lets it, inside its interval."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

import armgpi
from armgpi.errors import NameNotFound, ParameterError, RolloutError
from armgpi.viewing import plots

DT = 1e-3
HOMES = {
    "ur5": np.array([0.0, -1.2, 1.6, -1.97, -1.5708, 0.0]),
    "panda": np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.75, 0.8]),
}


def arm_of(name: str) -> armgpi.Robot:
    fingers = ["panda_finger_joint1", "panda_finger_joint2"] if name == "panda" else ()
    return armgpi.Robot.load(name, lock=fingers).with_armature(0.4)


def pressed(name: str, share: float, force: Any, move: float = 0.0) -> tuple[armgpi.Robot, xr.Dataset]:
    """Return an arm whose friction is a share of its effort, and a run in which a hand pushes."""
    bare = arm_of(name)
    level = armgpi.Friction(0.0 * bare.limits.effort, share * bare.limits.effort)
    hand = armgpi.ToolForce(force, onset=0.3)
    plant = armgpi.Encoder(armgpi.RigidBodyPlant(bare, (), level, environment=[hand]), 17)
    home = HOMES[name]
    law = armgpi.GPI.auto(bare, DT, bits=17, drives="stiff")
    run = armgpi.simulate(plant, law, armgpi.Bezier(home, home + move, 1.5), 1.5, backend="auto")
    return bare.with_friction(*level), run


@pytest.mark.parametrize("name", HOMES)
def test_without_friction_the_force_is_found(name: str) -> None:
    force = np.array([10.0, -20.0, 15.0])
    arm, run = pressed(name, 0.0, force)
    # A model that has no friction is not one of an arm without any: this one is said to have nearly none.
    known = arm.with_friction(coulomb=1e-6)
    found = armgpi.tool_wrench(run, known)
    np.testing.assert_allclose(found["estimated_force"].values[-300:].mean(axis=0), force, atol=0.6)
    assert np.abs(found["estimated_moment"].values[-300:].mean(axis=0)).max() < 0.2
    before = found["estimated_force"].values[50:290]
    assert np.abs(before).max() < 1.0


@pytest.mark.parametrize("move", [0.0, 0.3])
@pytest.mark.parametrize("name", HOMES)
def test_the_interval_contains_the_force_at_rest_and_in_motion(name: str, move: float) -> None:
    force = np.array([12.0, -8.0, 10.0])
    arm, run = pressed(name, 0.02, force, move)
    found = armgpi.tool_wrench(run, arm.with_friction(arm.friction.viscous, 0.9 * arm.friction.coulomb))
    low, high = (found[f"estimated_force_{end}"].values[-400:] for end in ("low", "high"))
    # Counts of the encoders are differenced twice: their noise is not part of the interval.
    inside = (low - 1.0 <= force) & (force <= high + 1.0)
    assert inside.mean() > 0.99
    # It says how little is known: friction of 2 % of the effort is some N at the tool.
    assert (high - low).max() > 2.0


def test_a_hand_below_friction_is_not_told_from_none() -> None:
    arm, run = pressed("ur5", 0.05, [0.0, 0.0, 3.0])
    found = armgpi.tool_wrench(run, arm)
    last = found.isel(time=-1)
    assert (last["estimated_force_low"].values <= 0.0).all()
    assert (last["estimated_force_high"].values >= [0.0, 0.0, 3.0]).all()


def test_sample_by_sample_is_the_whole_run_and_batches_are_their_rows() -> None:
    arm, run = pressed("ur5", 0.02, [5.0, 5.0, 5.0])
    short = run.isel(time=slice(0, 40))
    found = armgpi.tool_wrench(short, arm, uncertain_mass=0.5)
    estimator = armgpi.WrenchEstimator(arm, DT, uncertain_mass=0.5)
    q, tau = short["q_measured"].values, short["tau"].values
    state = estimator.init(q[0])
    for k in range(1, 40):
        wrench, state = estimator.step(q[k], tau[k - 1], state)
    np.testing.assert_allclose(found["estimated_force"].values[-1], wrench.force, atol=1e-12)
    np.testing.assert_allclose(
        wrench.force_high[2] - wrench.force[2],
        armgpi.WrenchEstimator(arm, DT).wrench(state).force_high[2] - wrench.force[2] + 0.5 * 9.81,
        atol=1e-9,
    )
    both = xr.concat([short, short], dim="rollout")
    twice = armgpi.tool_wrench(both, arm)["estimated_force"]
    assert twice.sizes["rollout"] == 2
    once = armgpi.tool_wrench(short, arm)["estimated_force"]
    np.testing.assert_allclose(
        twice.isel(rollout=1).transpose("time", "axis").values, once.values, atol=1e-12
    )


def test_it_is_drawn_with_its_band() -> None:
    arm, run = pressed("ur5", 0.02, [0.0, 0.0, 20.0])
    figure = plots.tool(armgpi.tool_wrench(run, arm))
    axes = figure.axes[-1]
    assert any(line.get_label() == "estimated" for line in axes.get_lines())
    assert len(axes.collections) == 1


def test_bad_input_is_refused() -> None:
    arm, run = pressed("ur5", 0.0, [0.0, 0.0, 1.0])
    with pytest.raises(RolloutError, match="no tau"):
        armgpi.tool_wrench(run.drop_vars("tau"), arm)
    with pytest.raises(ParameterError, match="a robot with the joints"):
        armgpi.tool_wrench(run, arm_of("panda"))
    with pytest.raises(NameNotFound):
        armgpi.tool_wrench(run, arm, frame="nowhere")
    with pytest.raises(ParameterError, match="friction_within"):
        armgpi.WrenchEstimator(arm, DT, friction_within=0.5)
