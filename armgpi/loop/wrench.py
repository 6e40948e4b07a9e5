"""The wrench at the tool over a whole rollout or log, from its torques and measured positions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armgpi.control.wrench import BANDWIDTH, ToolWrench, WrenchEstimator
from armgpi.errors import ParameterError, RolloutError
from armgpi.robot.robot import Robot

if TYPE_CHECKING:
    import xarray as xr

#: What is added to a rollout -> the field of the estimate, its name and unit.
VARIABLES = {
    "estimated_force": ("force", "estimated force on the tool", "N"),
    "estimated_force_low": ("force_low", "lower end of its interval", "N"),
    "estimated_force_high": ("force_high", "upper end of its interval", "N"),
    "estimated_moment": ("moment", "estimated moment on the tool", "N m"),
    "estimated_moment_low": ("moment_low", "lower end of its interval", "N m"),
    "estimated_moment_high": ("moment_high", "upper end of its interval", "N m"),
}


def tool_wrench(
    rollout: xr.Dataset,
    robot: Robot,
    frame: str | None = None,
    bandwidth: float = BANDWIDTH,
    friction_within: float | None = None,
    uncertain_mass: float = 0.0,
) -> xr.Dataset:
    """Return a rollout with the wrench at the tool, estimated from torques and measured positions.

    It has the new variables ``estimated_force``, ``estimated_moment`` and the ends of their intervals
    (``_low``, ``_high``) over ``axis``, in the base frame: what acts on the tool. The intervals are honest
    about friction: at rest a hand below the level of friction cannot be distinguished from none.

    Args:
        rollout: of every sample, of a run or of a log (:func:`armgpi.loop.log.to_rollout`).
        robot: the model: masses, friction and the payload that it contains.
        frame: the frame that is the tool; the tip when not given.
        bandwidth: of the filters [rad/s].
        friction_within: factor within which Coulomb friction is known; 1.2 when not given.
        uncertain_mass: mass at the tool that the model may lack, or have too much [kg].

    Raises:
        RolloutError: when the rollout has no torques or measured positions.
        ParameterError: when the joints are others, or a number is not as it should be.
        NameNotFound: when there is no such frame.
    """
    variables = getattr(rollout, "variables", ())
    missing = [name for name in ("q_measured", "tau", "time") if name not in variables]
    if missing or rollout.sizes["time"] < 2:
        raise RolloutError(f"the rollout has no {' and no '.join(missing) or 'two samples'}")
    names = [str(joint) for joint in rollout["joint"].values]
    if not isinstance(robot, Robot) or names != list(robot.joint_names):
        raise ParameterError("robot", robot, f"a robot with the joints {', '.join(names)}")
    dt = float(np.median(np.diff(rollout["time"].values)))
    estimator = WrenchEstimator(robot, dt, frame, bandwidth, friction_within, uncertain_mass)
    positions = rollout["q_measured"].transpose("time", ..., "joint")
    torques = rollout["tau"].transpose("time", ..., "joint")
    estimates = _estimate(estimator, positions.values, torques.values)
    *dims, _ = positions.dims
    estimated: dict[str, Any] = {}
    for name, (field, meaning, unit) in VARIABLES.items():
        attributes = {"long_name": meaning, "units": unit}
        estimated[name] = ((*dims, "axis"), getattr(estimates, field), attributes)
    if "axis" not in rollout.coords:
        rollout = rollout.assign_coords(axis=["x", "y", "z"])
    return rollout.assign(estimated)


def _estimate(estimator: WrenchEstimator, q: Any, tau: Any) -> ToolWrench:
    """Return the estimates of all samples; NaN from where a rollout ended."""
    state = estimator.init(np.nan_to_num(q[0]))
    wrenches = [estimator.wrench(state)]
    for torque_before, position in zip(tau[:-1], q[1:], strict=True):
        step = estimator.step(np.nan_to_num(position), np.nan_to_num(torque_before), state)
        has_ended = ~np.isfinite(position).all(axis=-1, keepdims=True)
        wrenches.append(ToolWrench(*(np.where(has_ended, np.nan, column) for column in step.wrench)))
        state = step.state
    return ToolWrench(*map(np.stack, zip(*wrenches, strict=True)))
