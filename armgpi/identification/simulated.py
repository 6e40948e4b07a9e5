"""A second opinion: the identified arm simulated with the experiment that a log is of."""

from __future__ import annotations

from os import PathLike

import numpy as np

from armgpi import config
from armgpi.base.arrays import Array, check_path
from armgpi.errors import ParameterError
from armgpi.identification.logs import Grid
from armgpi.loop.simulation import simulate
from armgpi.robot.robot import Robot

#: A log whose positions are farther from an experiment's reference is of another one [rad or m].
_APART = 0.5


def simulate_experiment(path: str | PathLike[str], robot: Robot, late: float, grid: Grid) -> Array:
    """Return the torques that an arm takes in an experiment, at the times of a log of it, (k, n).

    The file's first controller moves a plant with the arm's bodies, rotors and friction, and its gears where
    they were measured; simulator, encoders and limits are the file's. Infinite where the arm fails, NaN
    after the experiment's end.

    Args:
        path: of the experiment file.
        robot: the arm; the constant torques of its drives (`offset`) act as well.
        late: time by which measured positions lag behind torques [s].
        grid: the log; it begins when the experiment does.

    Raises:
        ConfigError: for a file that is no experiment, or is one of drawn arms.
        ParameterError: when the log is of another experiment.
    """
    path = check_path(path, "experiment")
    said, origin = config.read(path)
    if said.reality is not None:
        raise origin.error(("reality",), "expected none: of drawn arms no single one was logged")
    experiment = config.build(said, origin)
    names, dt = robot.joint_names, said.sample_time
    if experiment.robot.joint_names != names:
        raise origin.error(("robot", "name"), f"expected joints {', '.join(names)}, as the log has")
    edges = np.asarray(grid.dt * np.arange(len(grid.q) + 1), dtype=np.float64)
    off = np.abs(grid.q - experiment.reference.at(edges[:-1]).q)
    when, joint = np.unravel_index(off.argmax(), off.shape)
    if off[when, joint] > _APART:
        seen = f"{names[joint]} is {off[when, joint]:.3g} off its reference after {edges[when]:.3g} s"
        raise ParameterError("experiment", str(path), f"that of the first log, begun with it ({seen})")
    bodies = [body.toDynamicParameters().tolist() for body in list(robot.pinocchio_model().inertias)[1:]]
    data = experiment.config.plain()
    for key in ("payload", "inertia_scale", "rotor_inertia", "viscous", "coulomb"):
        data["plant"].pop(key, None)
    data["plant"] |= {
        "bodies": dict(zip(names, bodies, strict=True)),
        "drives": robot.drives.plain(),
        "friction": "urdf",
        "loads": [],
        "delay": max(round(late / dt), 0),
    }
    run = simulate(
        config.build(config.check(data, origin), origin).plant,
        next(iter(experiment.controllers.values())),
        experiment.reference,
        min(experiment.t_final, float(edges[-1])),
        progress=False,
        backend="auto",
        supervisor=experiment.supervisor,
    )
    tau = run["tau_command"].transpose("time", "joint").values
    if not np.isfinite(tau).all():
        return np.full_like(grid.tau, np.inf)
    tau = np.clip(tau, -robot.limits.effort, robot.limits.effort)
    impulse = dt * np.vstack([np.zeros(robot.n), np.cumsum(tau, axis=0)])
    ends = dt * np.arange(len(impulse))
    at = np.stack([np.interp(edges, ends, each, right=np.nan) for each in impulse.T], axis=-1)
    return np.asarray(np.diff(at, axis=0) / grid.dt)
