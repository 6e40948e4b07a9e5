"""Arms of the zoo under everything that a closed loop can have at once."""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from armgpi import (
    GPI,
    ArmgpiWarning,
    BSplineNetwork,
    Delayed,
    Encoder,
    Friction,
    Noisy,
    RigidBodyPlant,
    Robot,
    Saturated,
    Sine,
    config,
    default_omega,
)
from armgpi.base.arrays import Array
from armgpi.health import zoo

DT = 1e-3
BATCH = 16


class Case(NamedTuple):
    """A closed loop for `simulate`, and the encoder's count, None without one."""

    plant: Any
    controller: Any
    reference: Any
    step_size: Array | None


@cache
def arm(name: str) -> tuple[Robot, Any]:
    """Return an arm without its gripper, and the move that it makes when nothing is said."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)
        fingers = zoo.fingers(name)
        robot = Robot.load(name, lock=fingers)
        # Some URDFs give no effort, one gives too little to hold the arm up.
        weight = 3.0 * np.abs(robot.gravity(robot.random_positions(100))).max(axis=0)
        limits = np.maximum(np.where(robot.limits.effort > 0.0, robot.limits.effort, 10.0), weight)
        effort = dict(zip(robot.joint_names, limits.tolist(), strict=True))
        wanted = {"robot": {"name": name, "lock": fingers, "effort": effort}, "sample_time": DT}
        built = config.build(config.check(wanted, config.Origin(name)), config.Origin(name))
    return built.robot, built.reference


def experiment(name: str, encoder: bool = True, noise: bool = True) -> Case:
    """Return a batch of loops with network, saturation, encoder, delay, friction and noise."""
    robot, reference = arm(name)
    # In accelerations, so that it is as much for a wrist as for a shoulder.
    inertia = np.diag(robot.mass_matrix(reference.at(0.0).q))
    push = np.random.default_rng(0).uniform(0.0, 1.0, (BATCH, robot.n)) * inertia
    plant: Any = RigidBodyPlant(robot, Sine(push, 3.0), friction=Friction(0.5 * inertia, 0.5 * inertia))
    plant = Saturated(plant)
    if noise:
        plant = Noisy(plant, 2e-5, 1e-4, seed=1)
    step_size = None
    if encoder:
        plant = Encoder(plant, 16)
        step_size = plant.step_size
    omega = default_omega(DT, DT)
    network = BSplineNetwork((0.6 * omega, 1.2 * omega), (0.7, 0.8), rate=0.5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)
        return Case(Delayed(plant, 1), GPI(robot, DT, network, delay=DT), reference, step_size)
