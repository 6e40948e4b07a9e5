"""Laws where no symmetry hides an error: loads off the axis, turned frames, rotors, starts off target."""

from __future__ import annotations

import os
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import trapezoid

from armgpi import (
    GPI,
    Delayed,
    Encoder,
    Hold,
    InverseSolution,
    Noisy,
    Reality,
    RigidBodyPlant,
    Robot,
    Step,
    load,
    save,
    simulate,
)
from armgpi.base import files
from armgpi.certification import check_certificate
from armgpi.errors import ArrayError, EffortError, ParameterError, UrdfError
from armgpi.loop import metrics
from armgpi.loop.prepared import prepare
from armgpi.robot import dynamics
from armgpi.robot.batch import check_powered
from armgpi.robot.kinematics import (
    TrackingInverse,
    _damped_step,
    _nearest_turns,
    _wide,
    inverse_kinematics,
)
from armgpi.robot.rotors import typical_inertia

UR5 = Robot.load("ur5")
Q = np.array([0.3, -1.1, 0.9, -0.4, 0.7, 0.5])
COM = np.array([0.08, -0.05, 0.11])


def test_the_weight_of_a_load_off_the_axis_of_a_turned_frame_is_that_of_its_jacobian() -> None:
    turned = UR5.frame_pose("tool0", Q).rotation
    assert not np.allclose(turned, UR5.frame_pose(UR5.joint_names[-1], Q).rotation)
    J, arm = UR5.frame_jacobian("tool0", Q), turned @ COM
    weight = (J[:3] + np.cross(J[3:], arm, axis=0)).T @ [0.0, 0.0, 9.81 * 2.0]
    loaded = UR5.with_payload("tool0", 2.0, COM)
    np.testing.assert_allclose(loaded.gravity(Q), UR5.gravity(Q) + weight, rtol=1e-12, atol=1e-12)


def test_a_load_that_varies_is_the_load_that_is_given_off_the_axis_of_a_turned_frame() -> None:
    both = UR5.varied(payload=[0.5, 2.0], com=[COM, -COM], frame="tool0")
    q, a = np.tile(Q, (2, 1)), np.tile(np.linspace(-1.0, 2.0, 6), (2, 1))
    for i, (mass, com) in enumerate(((0.5, COM), (2.0, -COM))):
        one = UR5.with_payload("tool0", mass, com)
        np.testing.assert_allclose(both.gravity(q)[i], one.gravity(Q), rtol=1e-12, atol=1e-12)
        expected = one.inverse_dynamics(Q, 0.5 * a[0], a[0])
        found = both.inverse_dynamics(q, 0.5 * a, a)[i]
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)


def test_a_factor_scales_links_and_rotors_alike() -> None:
    geared = UR5.with_armature([2.0, 2.0, 1.0, 0.3, 0.3, 0.2])
    scaled = geared.scaled_inertia(1.7)
    np.testing.assert_allclose(scaled.mass_matrix(Q), 1.7 * geared.mass_matrix(Q), rtol=1e-12, atol=1e-14)
    # A further change begins from the scaled model, not from the scaled dynamics.
    changed = scaled.with_payload("tool0", 0.0)
    np.testing.assert_allclose(changed.mass_matrix(Q), 1.7 * geared.mass_matrix(Q), rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(scaled.inertia_times(Q, Q), 1.7 * geared.mass_matrix(Q) @ Q, rtol=1e-12)
    a = scaled.forward_dynamics(Q, 0.1 * Q, 1.7 * np.arange(6.0))
    expected = geared.forward_dynamics(Q, 0.1 * Q, np.arange(6.0))
    np.testing.assert_allclose(a, expected, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_integrals_of_an_error_that_begins_off_the_reference_count_the_first_sample_half(
    backend: str,
) -> None:
    arm = Robot.load("anthropomorphic3")
    parts = RigidBodyPlant(arm), GPI(arm, 1e-3), Hold(np.zeros(3)), 0.02
    start = {"q0": np.array([0.2, -0.1, 0.05])}
    whole = prepare(*parts, backend=backend).run(**start)
    error = (whole["q"] - whole["q_ref"]).values
    assert abs(error[0]).min() > 0.04
    summed = prepare(*parts, record="metrics", backend=backend).run(**start)
    for name, values in (("iae", abs(error)), ("ise", error**2)):
        expected = trapezoid(values, dx=1e-3, axis=0)
        np.testing.assert_allclose(summed[name].values, expected, rtol=1e-9, err_msg=name)


def test_a_file_is_on_the_disk_before_it_takes_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[tuple[str, int]] = []
    sync, replace = os.fsync, os.replace

    def synced(opened: int) -> None:
        calls.append(("sync", os.fstat(opened).st_ino))
        sync(opened)

    def replaced(source: Any, target: Any) -> None:
        calls.append(("replace", os.stat(source).st_ino))
        replace(source, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", replaced)
    target = files.write(tmp_path / "file", b"new")
    number, folder = target.stat().st_ino, tmp_path.stat().st_ino
    # The file, then its name, then the folder that has the name.
    assert calls == [("sync", number), ("replace", number), ("sync", folder)]


def test_a_move_at_full_speed_takes_the_fastest_joint_to_its_limit() -> None:
    reality = Reality.bare(speed=(1.0, 1.0), duration=(1e-3, 1e3), distance=(0.3, 0.9), t_final=1e4)
    for index in range(4):
        draw = reality.draw(UR5, index)
        move = draw.reference.at(np.linspace(0.0, 20.0, 200_001))
        shares = np.abs(move.v).max(axis=0) / UR5.limits.velocity
        assert shares.max() == pytest.approx(1.0, rel=1e-3)


def test_free_joints_are_drawn_home_and_the_frame_goes_where_it_should() -> None:
    inverse = TrackingInverse(UR5, "tool0", rate=0.7)
    velocity, home = np.array([0.1, -0.2, 0.05]), Q + 0.3 * np.sin(np.arange(6.0))
    flow = inverse.flow(Q[None], velocity[None], home)[0]
    J = UR5.frame_jacobian("tool0", Q)[:3]
    np.testing.assert_allclose(J @ flow, velocity, atol=1e-9)
    free = np.eye(6) - np.linalg.pinv(J) @ J
    np.testing.assert_allclose(free @ flow, 0.7 * free @ (home - Q), atol=1e-9)


def test_a_joint_without_a_speed_is_believed_to_have_a_rotor_like_any_other() -> None:
    still = UR5.with_limits(velocity=[0.0, 3.0, 3.0, 3.0, 3.0, 3.0])
    assert np.isfinite(typical_inertia(still)).all()
    np.testing.assert_array_equal(
        typical_inertia(still)[1:], typical_inertia(UR5.with_limits(velocity=3.0))[1:]
    )


def test_whatever_disturbs_more_adds_more_to_a_sample_of_a_certificate() -> None:
    one, none = Fraction(1), Fraction(0)
    law = {"integrators": 2, "rolloff": 1, "delay": 1, "omega": [30 * one]}
    ratios = dict.fromkeys(
        ("zeta", "pole_ratio", "second_ratio", "second_zeta", "delta_low", "delta_high"), one
    )
    numbers = dict.fromkeys(("sigma", "kappa_v", "kappa_f", "sigma_error", "kappa_error", "shift"), none)
    rest = {"rolloff_ratio": 4 * one, "sample_time": one / 1000, "rate": none, "spread": none, "zone": none}
    known = {**law, **ratios, **numbers, **rest, "count_time": none, "reference": none}
    known |= {"kappa_e": 2 * one, "kappa_g": 16 * one, "torque": one / 10, "count": one / 1000}
    before = check_certificate.sample(known)
    # Stiffness and gravity act on an error of one count, beside what the law makes of the count.
    added = float(known["torque"] + (known["kappa_e"] + known["kappa_g"]) * known["count"])
    growth, gain = float(before[0][0]), float(before[3][0])
    assert float(before[5]) == pytest.approx(growth * added + gain * float(before[6]), rel=1e-12)
    for name in ("kappa_e", "kappa_g", "torque", "count"):
        assert check_certificate.sample({**known, name: 2 * known[name]})[5] > before[5], name
    # Friction's weight is that of its torque and, times the energy it takes, of that and the error's speed.
    known["kappa_f"], n = 3 * one, len(check_certificate.loop(known, 30 * one)[1])
    weights = {"P": [[none] * n] * n, "t": [one] * 6, "a": [one] * 5, "alpha": one}
    lighter = {**weights, "t": [*[one] * 5, none]}
    both = (
        check_certificate.inequality(known, check_certificate.sample(known), 30 * one, one, one, each)
        for each in (weights, lighter)
    )
    apart = np.subtract(*(np.array(each, dtype=float) for each in both))
    (own,) = np.flatnonzero(np.diag(apart))
    expected = np.zeros_like(apart)
    expected[own, own], expected[1, own], expected[own, 1] = 0.03, 1e-3 * 3 / 2, 1e-3 * 3 / 2
    np.testing.assert_allclose(apart, expected, rtol=1e-12)


def test_positions_are_drawn_to_either_side_of_the_middle() -> None:
    for arm in (UR5, UR5.with_limits(lower=[-40.0] * 6, upper=[60.0] * 6)):
        drawn, middle = arm.random_positions(2000), arm.middle()
        half = np.minimum(0.5 * (arm.limits.upper - arm.limits.lower), 4.0 * np.pi / 2.0)
        np.testing.assert_allclose(drawn.min(axis=0), middle - half, atol=0.05 * half.max())
        np.testing.assert_allclose(drawn.max(axis=0), middle + half, atol=0.05 * half.max())


def test_an_angle_is_moved_by_the_full_turns_that_bring_it_nearest_inside_its_limits() -> None:
    arm, rng = UR5.with_limits(lower=[-7.0] * 6, upper=[5.0] * 6), np.random.default_rng(0)
    turns = 2.0 * np.pi * np.arange(-9, 10)[:, None, None]
    q, home = rng.uniform(-25.0, 25.0, (200, 6)), rng.uniform(-9.0, 9.0, (200, 6))
    every = q + turns
    far = np.where((every < -7.0) | (every > 5.0), np.inf, abs(every - home))
    expected = np.take_along_axis(every, far.argmin(axis=0)[None], axis=0)[0]
    found = _nearest_turns(arm, q, home)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    # A limit belongs to the range: an angle a turn above it goes there; one turn holds every angle.
    for way in (-1.0, 1.0):
        end = np.where(way < 0, arm.limits.lower, arm.limits.upper)
        np.testing.assert_allclose(_nearest_turns(arm, end - 2.0 * np.pi * way, end), end, atol=1e-12)
    lower, upper = _wide(UR5.with_limits(lower=[-np.pi] * 6, upper=[3.1, *[np.pi] * 5]))
    assert np.isinf([lower, upper]).tolist() == [[False, *[True] * 5]] * 2


def test_bodies_are_those_of_the_joints_that_move_them() -> None:
    own = np.array([body.toDynamicParameters() for body in UR5._model.inertias[1:]])
    np.testing.assert_allclose(UR5.with_bodies(own).gravity(Q), UR5.gravity(Q), rtol=1e-12, atol=1e-12)
    own[2, 0] = 0.0
    with pytest.raises(ParameterError, match=f"mass of {UR5.joint_names[2]}"):
        UR5.with_bodies(own)


def test_moves_begin_to_either_side_of_the_middle_and_go_either_way() -> None:
    reality, middle = Reality.bare(), UR5.middle()
    starts, goals = np.array([reality.draw(UR5, index).move[:2] for index in range(24)]).swapaxes(0, 1)
    for there, where in ((middle, starts), (starts, goals)):
        assert (where < there - 0.3).any(axis=0).all()
        assert (where > there + 0.3).any(axis=0).all()


@pytest.mark.parametrize("rows", [2, 3, 5])
def test_a_damped_step_is_the_least_squares_of_what_is_missing_and_of_the_step(rows: int) -> None:
    rng = np.random.default_rng(rows)
    J, e, damping = rng.normal(size=(4, rows, 3)), 0.01 * rng.normal(size=(4, rows)), rng.uniform(0.1, 2.0, 4)
    free = np.zeros((4, 3), dtype=bool)
    for i, found in enumerate(_damped_step(e, J, damping, free, free)):
        stacked = np.vstack([J[i], np.sqrt(damping[i]) * np.eye(3)])
        expected = np.linalg.lstsq(stacked, np.append(e[i], np.zeros(3)), rcond=None)[0]
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_of_searches_that_failed_the_one_is_told_that_is_nearest_in_place_and_angle() -> None:
    inverse = TrackingInverse(UR5, "tool0", rotation=np.eye(3))
    places, angles = np.array([0.1, 0.2, 0.3]), np.array([2.0, 0.01, 1.0])
    none = np.zeros(3, dtype=bool)
    error = inverse._out_of_reach(COM, InverseSolution(np.tile(Q, (3, 1)), places, angles, none, 0 * angles))
    assert error.distance == 0.2
    assert "by 0.2 m and 0.01 rad" in str(error)


def test_rows_of_a_rotation_are_measured_against_each_other() -> None:
    c = np.sqrt(0.5)
    turned = np.array([[c, -c, 0.0], [c, c, 0.0], [0.0, 0.0, 1.0]]) * [1.2, 1.0, 1.0]  # rows: 1.22, 0.22
    with pytest.raises(ArrayError, match=r"got one 0\.22 from orthonormal"):
        inverse_kinematics(UR5, "tool0", COM, turned)


def test_all_joints_without_a_torque_are_named_in_their_row_of_a_batch() -> None:
    with pytest.raises(EffortError, match=rf"'{UR5.joint_names[1]}'.*\(nor have {UR5.joint_names[4]} more\)"):
        check_powered(UR5, np.array([[1.0] * 6, [1.0, 0.0, 1.0, 1.0, 0.0, 1.0], [0.0] * 6]))


def test_ends_may_meet() -> None:
    held = UR5.with_limits(lower=Q, upper=Q).limits
    np.testing.assert_array_equal(held.lower, held.upper)


def test_a_joint_that_nothing_drives_has_no_limit_of_torque_that_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ball = '<geom type="sphere" size="0.1" mass="1" pos="0.2 0 0"/>'
    (tmp_path / "arm.xml").write_text(
        f'<mujoco><worldbody><body name="one"><joint name="a" axis="0 0 1" range="-10 10"/>{ball}'
        f'<body name="two" pos="0 0 1"><joint name="b" axis="0 1 0"/>{ball}</body></body></worldbody>'
        '<actuator><motor joint="a" ctrllimited="true" ctrlrange="-5 5" gear="2"/></actuator></mujoco>'
    )
    arm = Robot.load(tmp_path / "arm.xml")  # though MuJoCo's limits push where the two are compared
    np.testing.assert_array_equal(arm.limits.effort, [10.0, np.inf])
    np.testing.assert_allclose(arm.limits.upper, [np.pi / 18.0, np.inf])
    real = dynamics._rnea
    monkeypatch.setattr(dynamics, "_rnea", lambda *given: real(*given) + np.array([0.5, 0.0]))
    with pytest.raises(UrdfError, match="differ from MuJoCo's at joint 'a'"):  # though that of b is larger
        Robot.load(tmp_path / "arm.xml")


def test_a_load_that_sets_in_with_a_sample_is_felt_from_that_sample_on() -> None:
    push = np.array([3.0, -2.0, 1.0])
    arm = Robot.load("anthropomorphic3")
    with_, without = RigidBodyPlant(arm, Step(push, onset=2e-3), substeps=2), RigidBodyPlant(arm, substeps=2)
    states = [plant.init(0.1 * push, 0.0 * push) for plant in (with_, without)]
    for felt in (False, False, True):
        states = [plant.step(push, x, 1e-3) for plant, x in zip((with_, without), states, strict=True)]
        assert (states[0].v != states[1].v).any() == felt


def test_positions_are_drawn_between_zeros_of_either_sign() -> None:
    held = UR5.with_limits(lower=[0.0, *[-1.0] * 5], upper=[-0.0, *[1.0] * 5])
    np.testing.assert_array_equal(held.random_positions(5)[:, 0], 0.0)


def test_an_arm_of_one_joint_is_like_any_other(tmp_path: Path) -> None:
    """Whatever takes the second of something has none here."""
    arm = Robot.load("ur5", lock=list(UR5.joint_names[1:]))
    plant = Noisy(Delayed(Encoder(RigidBodyPlant(arm), bits=[14]), 1), std_q=1e-5)
    assert plant.describe()["io"][0] == {"type": "Encoder", "bits": 14}
    rollout = simulate(plant, GPI(arm, 1e-3), Hold([0.3]), t_final=0.2, backend="numpy")
    save(rollout, tmp_path / "one.nc")
    assert load(tmp_path / "one.nc").equals(rollout)
    assert np.isfinite(metrics.summary(rollout)["itae"]).all()
