"""A bound on the force that a GPI controller presses with, without a force sensor."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import armgpi
from armgpi import config
from armgpi.certification.request import _check_linear
from armgpi.control.force_limit import ForceLimit
from armgpi.errors import ArmgpiWarning, NameNotFound, ParameterError

DT = 1e-3
HOME = np.array([0.0, -1.2, 1.6, -1.97, -1.5708, 0.0])
ARM = armgpi.Robot.load("ur5").with_armature(0.4).with_friction(coulomb=1.0)
DOWN = ARM.frame_pose(ARM.tip, HOME)
BEYOND = armgpi.inverse_kinematics(
    ARM, ARM.tip, DOWN.translation - [0.0, 0.0, 0.05], DOWN.rotation, near=HOME
).q


def controller(**given: Any) -> armgpi.GPI:
    return armgpi.GPI(ARM, DT, delay=DT, feedforward="model", friction_feedforward=True, **given)


def pressing(law: armgpi.GPI, friction: Any) -> Any:
    """Press 30 mm into a wall of 10 kN/m."""
    wall = armgpi.Wall(
        normal=[0.0, 0.0, 1.0], distance=float(DOWN.translation[2]) - 0.02, stiffness=1e4, damping=20.0
    )
    arm = armgpi.RigidBodyPlant(ARM, (), friction, environment=[wall])
    plant = armgpi.Delayed(armgpi.Encoder(arm, 17), 1)
    return armgpi.simulate(plant, law, armgpi.Bezier(HOME, BEYOND, 1.5), 3.0, backend="auto")


def test_a_static_wrench_is_found_from_its_torque_and_shortened() -> None:
    limit = ForceLimit(ARM, None, 10.0, 2.0, np.zeros(6))
    jacobian = ARM.frame_jacobian(ARM.tip, HOME)
    random = np.random.default_rng(0)
    for _ in range(10):
        wrench = np.concatenate([30.0 * random.normal(size=3), 4.0 * random.normal(size=3)])
        torque = jacobian.T @ wrench
        left = np.linalg.solve(jacobian.T, torque - limit.excess(HOME, torque))
        for part, most in ((slice(0, 3), 10.0), (slice(3, 6), 2.0)):
            size = float(np.linalg.norm(wrench[part]))
            np.testing.assert_allclose(left[part], wrench[part] * min(1.0, most / size), rtol=0.03, atol=0.3)


def test_a_limit_that_never_acts_changes_no_bit() -> None:
    plant = armgpi.RigidBodyPlant(ARM, (), "urdf")
    # A move at which the motors saturate is faster beside its reference than any usual speed limit.
    for duration, speed in ((1.0, None), (0.1, 1e3)):
        move = armgpi.Bezier(HOME, HOME + 0.1, duration)
        free, bounded = (
            armgpi.simulate(plant, controller(**given), move, 0.15, backend="numpy")
            for given in ({}, {"force_limit": 1e4, "speed_limit": speed})
        )
        np.testing.assert_array_equal(free["tau"], bounded["tau"])


@pytest.mark.parametrize("limit", [10.0, 30.0])
def test_behind_a_wall_it_presses_with_the_limit_and_friction(limit: float) -> None:
    law = controller(force_limit=limit)
    rollout = pressing(law, "urdf")
    assert law._force is not None
    jacobian = ARM.frame_jacobian(ARM.tip, BEYOND)
    friction = float(np.abs(np.linalg.inv(jacobian.T)[2]) @ np.ones(6))
    end = float(armgpi.metrics.final_force(rollout)[0])
    assert 0.7 * limit < end < 1.1 * (limit + friction)
    # Without the limit it presses until it is there.
    assert float(armgpi.metrics.final_force(pressing(controller(), "urdf"))[0]) > 4.0 * limit


def test_generated_code_and_batches_do_what_python_does() -> None:
    law = controller(force_limit=8.0)
    wall = armgpi.Wall(
        normal=[0.0, 0.0, 1.0], distance=float(DOWN.translation[2]) - 1e-3, stiffness=1e4, damping=20.0
    )
    plant = armgpi.Encoder(armgpi.RigidBodyPlant(ARM, (), "urdf", environment=[wall]), 17)
    move = armgpi.Bezier(HOME, BEYOND, 0.2)
    starts = np.stack([HOME, HOME + 1e-3])
    starts[1, 1] -= 0.01
    known = armgpi.simulate(plant, law, move, 0.2, q0=starts, backend="numpy")
    assert known["contact_force"].values.any()
    made = armgpi.simulate(plant, law, move, 0.2, q0=starts, backend="compiled")
    np.testing.assert_allclose(made["tau"].values, known["tau"].values, rtol=1e-8, atol=1e-8)
    alone = armgpi.simulate(plant, law, move, 0.05, q0=starts[1], backend="numpy")
    np.testing.assert_allclose(known["tau"].values[1, :50], alone["tau"].values[:50], rtol=1e-9, atol=1e-9)


def test_it_is_in_experiment_files() -> None:
    wanted = {"robot": {"name": "ur5"}, "controllers": [{"type": "gpi_auto", "force_limit": 30.0}]}
    with (
        pytest.warns(ArmgpiWarning, match=r"no Coulomb friction.*N at the tool"),
        # The side of its encoders is not known, and its joints may be elastic.
        pytest.warns(ArmgpiWarning, match=r"speed limit of 0\.25 m/s does not hold.*encoder_side"),
    ):
        experiment = config.build(config.check(wanted, config.Origin("x")), config.Origin("x"))
    (law,) = experiment.controllers.values()
    assert isinstance(law, armgpi.GPI)
    assert law.force_limit == 30.0


def test_bad_input_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"force_limit.*more than 19\.6 N, the weight"):
        armgpi.GPI(ARM, DT, payload=(0.0, 2.0), force_limit=15.0)
    with pytest.raises(ParameterError, match="moment_limit"):
        controller(moment_limit=2.0)
    with pytest.raises(NameNotFound):
        controller(force_limit=10.0, force_frame="nowhere")
    with pytest.raises(ParameterError, match="force_limit"):
        controller(force_limit=0.0)
    with pytest.raises(ParameterError, match=r"force_limit.*none where there is to be a certificate"):
        _check_linear(armgpi.GPI(ARM, DT, force_limit=30.0))


def test_without_effort_limits_the_warning_has_no_number_that_is_none() -> None:
    arm = armgpi.Robot.load("anthropomorphic3")
    with pytest.warns(ArmgpiWarning, match="force limit") as said:
        armgpi.GPI(arm.with_limits(effort=np.inf), 1e-3, force_limit=20.0)
    assert not any("nan" in str(warning.message) for warning in said)
    assert all(issubclass(warning.category, ArmgpiWarning) for warning in said)


def test_a_batch_of_loads_makes_one_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = armgpi.Robot.load("anthropomorphic3").with_friction(0.1, 0.2)
    batch = arm.varied(payload=np.linspace(0.0, 0.1, 20))
    made: list[int] = []
    single = type(batch)._robot

    def counted(robots: Any, i: int) -> Any:
        made.append(i)
        return single(robots, i)

    monkeypatch.setattr(type(batch), "_robot", counted)
    armgpi.GPI(batch, 1e-3, force_limit=20.0)
    assert set(made) <= {0}
