"""Every arm that can be loaded under default gains: what to expect of an arm without tuning for."""

from __future__ import annotations

import math
import warnings
from typing import NamedTuple

import xarray as xr

from armgpi import config
from armgpi.base.escape import markdown_table
from armgpi.errors import ArmgpiError, ArmgpiWarning
from armgpi.gpi.gains import FixedGains
from armgpi.gpi.law import GPI
from armgpi.gpi.payload import largest_payload, payload_range
from armgpi.loop import metrics
from armgpi.loop.rollout import describe_end
from armgpi.loop.simulation import simulate
from armgpi.plants.actuators import Saturated
from armgpi.plants.rigid_body import RigidBodyPlant
from armgpi.plants.sensors import Delayed, Encoder
from armgpi.robot import grippers
from armgpi.robot.batch import RobotBatch
from armgpi.robot.robot import Robot

#: What every arm is run with.
SCALES, DT, DELAY, BITS, HORIZON = (0.8, 1.0, 1.2), 1e-3, 1, 16, 8.0
#: Significant digits in the table.
_DIGITS = 2
#: Largest load that is tried [kg], and the share of what the motors hold that is.
_MOST, _SHARE = 0.5, 0.5


class Row(NamedTuple):
    """One arm, empty or loaded; the worst of its joints and of the factors on D(q).

    Attributes:
        name: of the robot.
        n: number of joints, grippers locked; 0 when it could not be loaded.
        payload: load at the tip of the controller's nominal model [kg].
        loaded: whether the arm carries it.
        omega_c: default bandwidth [rad/s].
        metrics: name -> value of the arm for each of the factors, of all metrics that the zoo shows.
        end: "finished", or why not.
    """

    name: str
    n: int
    payload: float
    loaded: bool
    omega_c: float
    metrics: dict[str, tuple[float, ...]]
    end: str


def run(name: str) -> list[Row]:
    """Return the rows of an arm: empty and loaded, or one that says why it cannot be run."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ArmgpiWarning)
            return _run(name)
    except ArmgpiError as error:
        nothing = {metric.name: (math.nan,) * len(SCALES) for metric in metrics.shown_in("zoo")}
        return [Row(name, 0, math.nan, False, math.nan, nothing, str(error))]


def _run(name: str) -> list[Row]:
    """Run an arm."""
    wanted = {
        "robot": {"name": name, "lock": fingers(name)},
        "ideal": True,
        "sample_time": DT,
        "t_final": HORIZON,
    }
    experiment = config.build(config.check(wanted, config.Origin(name)), config.Origin(name))
    robot = experiment.robot
    robot.check_holding(experiment.reference.at(0.0).q, "the start")
    most = largest_payload(robot, dt=DT, delay=DELAY * DT)
    load = min(_MOST, most.nominal, _SHARE * most.effort)
    span = payload_range(robot, 0.0, load, dt=DT, delay=DELAY * DT)
    nominal = RobotBatch([span.nominal.scaled_inertia(scale) for scale in SCALES] * 2)
    arms = RobotBatch([robot] * len(SCALES) + [span.nominal] * len(SCALES))
    controller = GPI(nominal, DT, FixedGains(span.omega_c), delay=DELAY * DT)
    plant = Delayed(Encoder(Saturated(RigidBodyPlant(arms)), BITS), DELAY)
    rollout = simulate(plant, controller, experiment.reference, HORIZON, progress=False)
    count = len(SCALES)
    return [
        _row(name, robot, load, loaded, span.omega_c, rollout.isel(rollout=rows))
        for loaded, rows in ((False, slice(0, count)), (True, slice(count, 2 * count)))
        if load > 0.0 or not loaded
    ]


def _row(name: str, robot: Robot, load: float, loaded: bool, omega_c: float, rollout: xr.Dataset) -> Row:
    """Return what came out of three rollouts."""
    ends = describe_end(rollout)
    bad = [f"{end} (D x {scale:g})" for end, scale in zip(ends, SCALES, strict=True) if end != "finished"]
    excess = float(metrics.limit_excess(rollout).max())
    if not bad and excess > 0.0:
        bad = [f"finished, outside its limits by {excess:.2g}"]
    values = {
        metric.name: tuple(metric.of_arm(metric(rollout).values).tolist())
        for metric in metrics.shown_in("zoo")
    }
    return Row(name, robot.n, load, loaded, omega_c, values, "; ".join(bad) or "finished")


def fingers(name: str) -> list[str]:
    """Return the joints of an arm's grippers that are not locked by its name alone."""
    with warnings.catch_warnings():  # of fingers that are not locked, which is what is asked for
        warnings.simplefilter("ignore", ArmgpiWarning)
        return grippers.moving(Robot.load(name))


def markdown(rows: list[Row]) -> str:
    """Return rows as a Markdown table; factors on D(q) that agree in a metric share one value."""
    shown = metrics.shown_in("zoo")
    factors = " / ".join(map("{:g}".format, SCALES))
    columns = [f"{m.heading}{f' [{m.unit}]' if any(m.unit) else ''}, D × {factors}" for m in shown]
    header = ("robot", "n", "nominal load [kg]", "loaded", "ω_c [rad/s]", *columns, "end")
    lines = []
    for row in rows:
        load, omega_c = metrics.short(row.payload, _DIGITS), metrics.short(row.omega_c, _DIGITS)
        texts = [[metric.text(value, _DIGITS) for value in row.metrics[metric.name]] for metric in shown]
        cells = (each[0] if len(set(each)) == 1 else " / ".join(each) for each in texts)
        lines.append(
            (row.name, str(row.n or "-"), load, "yes" if row.loaded else "no", omega_c, *cells, row.end)
        )
    return markdown_table(header, lines)
