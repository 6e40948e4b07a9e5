"""Pickles and copies of controllers, plants, references and loops: they run on as the originals do."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import armgpi
from armgpi.gpi.gains import FixedGains
from armgpi.plants.plant import Plant
from armgpi.references.paths import Lissajous

ARM = armgpi.Robot.load("anthropomorphic3")
DT = 1e-3
START = np.array([0.0, 0.4, -0.4])
POINT = ARM.frame_pose("tool", [0.0, 0.8, -1.4]).translation
MOVE = armgpi.Bezier(START, START + 0.2, duration=0.3)

CONTROLLERS: dict[str, armgpi.Controller] = {
    "GPI": armgpi.GPI(ARM, DT),
    "paper": armgpi.GPI(ARM, DT, realisation="paper", gains=FixedGains(20.0)),
    "network": armgpi.GPI(ARM, DT, gains=armgpi.BSplineNetwork(weights={"omega_c": [1.0, 2.0, 3.0, 4.0]})),
    "PID": armgpi.PIDInversion(ARM, DT),
    "batch": armgpi.GPI(armgpi.RobotBatch([ARM, ARM.scaled_inertia(1.2)]), DT),
}
PLANTS: dict[str, Callable[[Plant], Plant]] = {
    "rigid body": lambda plant: plant,
    "Saturated": armgpi.Saturated,
    "RateLimited": lambda plant: armgpi.RateLimited(plant, 100.0),
    "Encoder": armgpi.Encoder,
    "Noisy": lambda plant: armgpi.Noisy(plant, 1e-4),
    "Delayed": armgpi.Delayed,
    "Differentiated": armgpi.Differentiated,
    "DropOut": lambda plant: armgpi.DropOut(plant, 0.1),
    "SingleTurn": lambda plant: armgpi.Unwrapped(armgpi.SingleTurn(plant)),
}
REFERENCES: dict[str, Callable[[], armgpi.Reference]] = {
    "Bezier": lambda: MOVE,
    "Waypoints": lambda: armgpi.Waypoints([START, START + 0.2, START], [0.2, 0.2]),
    "Hold": lambda: armgpi.Hold(START),
    "batch": lambda: armgpi.ReferenceBatch([MOVE, armgpi.Hold(START)]),
    "Cartesian": lambda: armgpi.CartesianReference(
        ARM, "tool", Lissajous(POINT, [0.02] * 3, [1.0, 2.0, 3.0]), armgpi.TrackingInverse(ARM, "tool")
    ),
}
COPIES: dict[str, Callable[[Any], Any]] = {
    "pickle": lambda thing: pickle.loads(pickle.dumps(thing)),
    "deepcopy": copy.deepcopy,
}


def goes_on_alike(loop: armgpi.ClosedLoop, way: str) -> None:
    """Check that a copy of a loop and its state, made before and in the middle of a run, gives the same."""
    state = loop.init()
    early, state_early = COPIES[way]((loop, state))
    for _ in range(20):
        state, state_early = loop.step(state).state, early.step(state_early).state
    late, state_late = COPIES[way]((loop, state))
    for _ in range(20):
        steps = [loop.step(state), early.step(state_early), late.step(state_late)]
        for step in steps[1:]:
            np.testing.assert_array_equal(step.tau, steps[0].tau)
            np.testing.assert_array_equal(step.measured.q, steps[0].measured.q)
        state, state_early, state_late = (step.state for step in steps)


@pytest.mark.parametrize("way", COPIES)
@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_copy_of_a_controller_goes_on_as_it_does(name: str, way: str) -> None:
    goes_on_alike(armgpi.ClosedLoop(armgpi.RigidBodyPlant(ARM), CONTROLLERS[name], MOVE), way)


@pytest.mark.parametrize("way", COPIES)
@pytest.mark.parametrize("name", PLANTS)
def test_a_copy_of_a_plant_goes_on_as_it_does(name: str, way: str) -> None:
    plant = PLANTS[name](armgpi.RigidBodyPlant(ARM, armgpi.Sine(0.5, 3.0)))
    goes_on_alike(armgpi.ClosedLoop(plant, CONTROLLERS["GPI"], MOVE), way)


@pytest.mark.parametrize("way", COPIES)
@pytest.mark.parametrize("name", REFERENCES)
def test_a_copy_of_a_reference_says_the_same(name: str, way: str) -> None:
    reference = REFERENCES[name]()
    times = np.linspace(0.0, 0.4, 9)
    before = COPIES[way](reference)
    expected = reference.at(times)
    after = COPIES[way](reference)
    for other in (before, after):
        for part, right in zip(other.at(times), expected, strict=True):
            np.testing.assert_array_equal(part, right)
