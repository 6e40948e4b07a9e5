"""Run the controller made from an identified folder on arms that the log leaves possible.

Shared by the tools that read public logs. Each arm has the fitted bodies and friction; its rotors are drawn
within their interval, log-uniformly, and where joints are elastic so is its stiffness. The folder is written
and loaded again, as a user's is, and both controllers get the drives that `armgpi run` assumes.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import armgpi
from armgpi.base.arrays import Array
from armgpi.base.intervals import wilson
from armgpi.health.reality import has_failed, torques_of
from armgpi.identification.arm import Identified
from armgpi.identification.writing import write_identified

#: Largest share of the speed limits [-] and largest acceleration [rad/s^2] of a move, time after it [s], and
#: half of the range in which its ends are drawn [rad].
SPEED, ACCELERATION, AFTER, REACH = 0.6, 4.0, 1.0, 1.2
#: Most moves that are looked at for each one that the motors can follow.
TRIED = 40
#: Resolution of the encoders at the joint, if nobody says another [bits].
BITS = 18


class Outcome(NamedTuple):
    """What a controller makes of a move.

    Attributes:
        failed: whether the arm diverged, or left 0.5 rad.
        itae: integral of time times error over all joints [rad s^2].
    """

    failed: bool
    itae: float


def moves_of(robot: armgpi.Robot, arms: list[armgpi.Robot], seed: int) -> list[armgpi.Bezier]:
    """Return a move for each arm, from rest to rest, that its motors can follow.

    Raises:
        SystemExit: where none of many is.
    """
    rng, middle, found = np.random.default_rng(seed), robot.middle(), []
    speed = SPEED * np.minimum(robot.limits.velocity, 10.0)
    for arm in arms:
        for _ in range(TRIED):
            ends = middle + rng.uniform(-REACH, REACH, (2, robot.n))
            path = armgpi.Bezier(*ends, velocity_limit=speed, acceleration_limit=ACCELERATION)
            at = path.at(np.linspace(0.0, path.duration, 100))
            if np.all(np.abs(torques_of(arm, at, arm.friction)) < robot.limits.effort):
                found.append(path)
                break
        else:
            raise SystemExit(f"none of {TRIED} moves is within the torque limits")
    return found


def draw_arms(folder: armgpi.Robot, count: int, seed: int) -> list[armgpi.Robot]:
    """Return arms with the bodies and friction of a folder and drives within their intervals."""
    rng, arms = np.random.default_rng(seed), []
    drives = armgpi.assume_drives(folder).drives
    for _ in range(count):
        drawn = drives
        for name in ("rotor_inertia", "stiffness"):
            value, (low, high) = drives.value(name), drives.interval(name)
            low, high = (np.where(np.isfinite(end) & (end > 0.0), end, value) for end in (low, high))
            share = rng.uniform(size=folder.n)
            with np.errstate(divide="ignore", invalid="ignore"):
                each = np.exp(np.log(low) + share * (np.log(high) - np.log(low)))
            each = np.where(np.isfinite(each), each, value)
            known = dict(zip(folder.joint_names, each.tolist(), strict=True))
            drawn = drawn.with_value(name, {k: x for k, x in known.items() if np.isfinite(x)})
        arms.append(folder.with_drives(drawn))
    return arms


def run(arm: armgpi.Robot, nominal: armgpi.Robot, path: Any, dt: float, elastic: bool) -> Outcome:
    """Return what the controller for a nominal model makes of a move of an arm."""
    law = armgpi.GPI.auto(nominal, dt, delay=dt, bits=BITS, drives="elastic" if elastic else "stiff")
    plant: Any = armgpi.RigidBodyPlant(arm, friction="urdf")
    if elastic:
        plant = armgpi.ElasticPlant(arm, friction="urdf")
    plant = armgpi.Delayed(armgpi.Encoder(armgpi.Saturated(plant, arm.limits.effort), BITS), 1)
    rollout = armgpi.simulate(plant, law, path, path.duration + AFTER, progress=False, backend="auto")
    error = np.abs(rollout["q"].values - rollout["q_ref"].values)
    error[~np.isfinite(error)] = np.inf
    area = float((error * rollout["time"].values[:, None]).sum()) * dt
    return Outcome(has_failed(error, rollout["time"].values), area)


def control(found: Identified, count: int, *, dt: float = 1e-3, seed: int = 1, elastic: bool = False) -> None:
    """Print how many moves the controller from the folder failed, and its error over that for the truth."""
    with tempfile.TemporaryDirectory() as place:
        write_identified(found, Path(place))
        folder = armgpi.Robot.load(place)
    if not elastic:
        stiff = dict.fromkeys(folder.joint_names, 1e9)
        folder = folder.with_drives(folder.drives.with_value("stiffness", stiff))
    arms = draw_arms(folder, count, seed)
    ours, best = [], []
    for arm, path in zip(arms, moves_of(folder, arms, seed), strict=True):
        ours.append(run(arm, folder, path, dt, elastic))
        best.append(run(arm, arm, path, dt, elastic))
    failed, lost = (sum(each.failed for each in outcomes) for outcomes in (ours, best))
    ratio: Array = np.array([a.itae / b.itae for a, b in zip(ours, best, strict=True) if not b.failed])
    share, joints = wilson(failed, count), "elastic" if elastic else "stiff"
    print(
        f"{joints} joints: {failed} of {count} failed ({100.0 * share.lower:.2g} to "
        f"{100.0 * share.upper:.2g} %, 95 %), the controller for the truth {lost}; error "
        f"(ITAE) over that of the controller for the truth {np.median(ratio):.3g} in the median, "
        f"{np.quantile(ratio, 0.9):.3g} at 90 %, {ratio.max():.3g} at most",
        flush=True,
    )
