"""Every engine of experiment files has the loads and the friction of the file, or refuses them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import yaml

import armgpi
from armgpi.base.arrays import Array
from armgpi.base.parameter import with_parameters
from armgpi.config import build, parse
from armgpi.errors import ParameterError
from armgpi.plants.arm import Arm
from armgpi.plants.plant import inside
from armgpi.registry import classes_of


def motion_after(engine: str, **section: Any) -> Array:
    """Return position and velocity of a joint that turned upright, without torque, after 50 ms."""
    if engine == "mujoco":
        pytest.importorskip("mujoco", reason="an engine of its own")
    friction = {"viscous": 0.5, "coulomb": 0.1}
    robot = {"name": "anthropomorphic3", "rotor_inertia": 0.1, "friction": friction}
    needed = {"gear_stiffness": 2e3} if engine == "elastic" else {}
    data = {"robot": robot, "plant": {"engine": engine, **needed, **section}}
    plant: Any = inside(build(*parse(yaml.safe_dump(data), "file.yaml")).plant)
    q, v = np.array([0.0, 0.4, -0.4]), np.array([1.0, 0.0, 0.0])
    state = plant.init(q, v)
    for _ in range(50):
        state = plant.step(plant.robot.gravity(q), state, 1e-3)
    true = plant.true_state(state)
    return np.array([true.q[0], true.v[0]])


@pytest.mark.parametrize("engine", sorted(classes_of(Arm)))
def test_loads_oppose_the_motors_and_friction_slows(engine: str) -> None:
    free = motion_after(engine)
    load = {"type": "step", "amplitude": {"q1": 0.2}, "onset": 0.01}
    assert (motion_after(engine, loads=[load]) < free).all()
    assert (motion_after(engine, friction="urdf") < free).all()


@pytest.mark.parametrize("given", [{"loads": armgpi.Step(np.ones(3))}, {"friction": "urdf"}])
def test_an_arm_that_does_not_say_that_it_has_them_refuses_them(given: dict[str, Any]) -> None:
    @with_parameters
    class Careless(Arm):
        def step(self, tau: Array, state: Any, dt: float) -> Any:
            return state

    robot = armgpi.Robot.load("anthropomorphic3")
    Careless(robot)
    with pytest.raises(ParameterError, match=f"{next(iter(given))}.*Careless does not name it in `feels`"):
        Careless(robot, **given)
