"""The zoo: what its rows say is what a run says."""

from __future__ import annotations

import math

import numpy as np

from armgpi import (
    GPI,
    Delayed,
    Encoder,
    FixedGains,
    RigidBodyPlant,
    Robot,
    Saturated,
    default_move,
    metrics,
    simulate,
)
from armgpi.health import zoo

ARM = "anthropomorphic3"


def test_a_row_is_the_worst_joint_of_a_run_of_its_own() -> None:
    empty, loaded = zoo.run(ARM)
    assert (empty.name, empty.n, empty.loaded, loaded.loaded) == (ARM, 3, False, True)
    assert empty.end == loaded.end == "finished"
    assert empty.payload == loaded.payload == 0.5
    robot = Robot.load(ARM)
    heavy = robot.with_payload(robot.tip, 0.5)
    reference = default_move(robot)
    for row, arm in ((empty, robot), (loaded, heavy)):
        plant = Delayed(Encoder(Saturated(RigidBodyPlant(arm)), 16), 1)
        errors = (row.metrics["peak_error"], row.metrics["final_error"])
        for scale, peak, final in zip(zoo.SCALES, *errors, strict=True):
            controller = GPI(heavy.scaled_inertia(scale), 1e-3, FixedGains(row.omega_c), delay=1e-3)
            rollout = simulate(plant, controller, reference, zoo.HORIZON, progress=False)
            np.testing.assert_allclose(float(metrics.peak_error(rollout).max()), peak, rtol=1e-9)
            np.testing.assert_allclose(float(metrics.final_error(rollout).max()), final, atol=1e-9)


def test_an_arm_that_cannot_be_run_says_why() -> None:
    row, *others = zoo.run("no such robot")
    assert not others
    assert "no such robot" in row.end
    assert math.isnan(row.omega_c)
    table = zoo.markdown([row])
    assert "nan" not in table
