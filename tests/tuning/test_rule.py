"""The rule for arms that nobody tuned: what it promises of margins and noise, and where it is taken."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from armgpi import (
    GPI,
    Bezier,
    ClosedLoop,
    Delayed,
    Encoder,
    FixedGains,
    RigidBodyPlant,
    Robot,
    RobotBatch,
    config,
    metrics,
    simulate,
)
from armgpi.codegen.trace import Inventory, tracing
from armgpi.errors import ArmgpiError, ArmgpiWarning, EffortError, ParameterError, PayloadError
from armgpi.gpi import advice
from armgpi.gpi.family import Member
from armgpi.gpi.gains import Tuning
from armgpi.gpi.margins import count_noise, crossovers, delay_margin, open_loop
from armgpi.gpi.payload import DELAY_SHARE, LoadRange, most_inertia, plausible_load
from armgpi.registry import Context
from armgpi.robot import rotors
from armgpi.robot.batch import VariedRobots
from armgpi.tuning import rule

ARM = Robot.load("anthropomorphic3")
MEMBER = Member(rule.INTEGRATORS, rule.ROLLOFF, rule.RATIO)


def tuning(omega: float) -> Tuning:
    return Tuning(*map(np.array, (omega, 1.0, omega)))


@pytest.mark.parametrize(("dt", "delay"), [(5e-4, 0.0), (1e-3, 1e-3), (4e-3, 4e-3), (4e-3, 12e-3)])
def test_a_joint_is_as_fast_as_stiffness_and_delay_margin_allow(dt: float, delay: float) -> None:
    law = GPI.auto(ARM, dt, delay=delay, bits=None)
    (omega,) = set(law.gains.nominal().omega_c)
    late = dt == 4e-3  # then lateness limits, and the roll-off is farther out
    assert set(law.rolloff_ratio) == {rule.LATE_RATIO if late else rule.RATIO}
    loop = open_loop(tuning(omega), Member(1, 1, law.rolloff_ratio[0]))
    used = (
        crossovers(loop).max() / rule.CROSSOVER,
        (1.5 * dt + delay) / delay_margin(loop) / DELAY_SHARE,
    )
    assert max(used) == pytest.approx(1.0)
    assert law.margins().delay == pytest.approx(delay_margin(loop))


def test_drives_are_assumed_of_one_arm_and_not_of_a_batch() -> None:
    varied = ARM.varied(payload=np.array([0.0, 0.01]))
    for batch in (varied, RobotBatch([ARM, ARM])):
        for drives in ("nonsense", "elastic"):
            with pytest.raises(
                ParameterError, match=r"drives must be None for a batch: .*armgpi\.assume_drives"
            ):
                GPI.auto(batch, 1e-3, drives=drives)


def test_no_gains_given_are_those_of_the_rule() -> None:
    chosen, none = (GPI.auto(ARM, 1e-3, **given) for given in ({}, {"gains": None}))
    np.testing.assert_array_equal(none.gains.nominal().omega_c, chosen.gains.nominal().omega_c)


@pytest.mark.filterwarnings("ignore:sample time, delay and encoders leave")  # 12 bits are coarse
@pytest.mark.parametrize("bits", [12, 16, 20])
def test_counts_make_no_more_noise_than_is_allowed(bits: int) -> None:
    law = GPI.auto(ARM, 1e-3, delay=1e-3, bits=bits)
    count = 2.0 * math.pi / 2**bits / math.sqrt(12.0)
    noise = [count * count_noise(tuning(omega), 1e-3, MEMBER).step for omega in law.gains.nominal().omega_c]
    shares = most_inertia(ARM) * noise / rule.usual_effort(ARM)[:, np.newaxis]
    assert shares.max() < 1.1 * rule.TORQUE_SHARE  # the noise is no exact cube of the bandwidth
    free = GPI.auto(ARM, 1e-3, delay=1e-3, bits=None).gains.nominal().omega_c
    assert (law.gains.nominal().omega_c <= free).all()
    assert shares.max() > 0.9 * rule.TORQUE_SHARE or (law.gains.nominal().omega_c == free).all()


def test_what_is_given_stays() -> None:
    law = GPI.auto(ARM, 1e-3, bits=16, gains=FixedGains(12.0), integrators=2, feedforward="none")
    assert (law.integrators, law.rolloff, law.feedforward) == (2, rule.ROLLOFF, "none")
    assert set(law.gains.nominal().omega_c) == {12.0}
    loaded = GPI.auto(ARM, 1e-3, bits=16, payload=(0.0, 0.2))
    assert loaded.payload.heaviest == 0.2
    assert (loaded.gains.nominal().omega_c <= loaded.payload.omega_c).all()
    assert not GPI.auto(ARM, 1e-3).friction_feedforward
    assert GPI.auto(ARM.with_friction(coulomb=0.1), 1e-3).friction_feedforward


def test_a_batch_has_the_rule_of_each() -> None:
    arms = [ARM, ARM.scaled_inertia(2.0)]
    both = GPI.auto(RobotBatch(arms), 1e-3, delay=1e-3, bits=14).gains.nominal().omega_c
    each = [GPI.auto(arm, 1e-3, delay=1e-3, bits=14).gains.nominal().omega_c for arm in arms]
    np.testing.assert_allclose(both, each, rtol=1e-12)


def test_an_experiment_takes_it_behind_real_sensors_and_keeps_what_it_chose() -> None:
    ideal = {"robot": {"name": "anthropomorphic3"}}
    real: dict[str, Any] = {**ideal, "plant": {"encoder_bits": 16, "delay": 1}}
    (section,) = config.check(ideal, config.Origin()).controllers
    assert section.type == "gpi"
    built = config.build(config.check(real, config.Origin()))
    law = built.controllers["gpi_auto"]
    assert isinstance(law, GPI)
    direct = GPI.auto(ARM, 1e-3, delay=1e-3, bits=16)
    np.testing.assert_array_equal(law.gains.nominal(), direct.gains.nominal())
    assert (law.integrators, law.rolloff, law.feedforward, law.knows) == (1, 1, "model", "model")
    (section,) = built.config.controllers
    assert (section.integrators, section.feedforward) == (1, "model")
    again = config.build(built.config).controllers["gpi_auto"]
    np.testing.assert_array_equal(law.gains.nominal(), again.gains.nominal())  # type: ignore[attr-defined]
    own = {"type": "gpi_auto", "omega": 9.0, "rolloff": 0}
    chosen = config.build(config.check({**real, "controllers": [own]}, config.Origin())).controllers[
        "gpi_auto"
    ]
    assert (chosen.rolloff, chosen.integrators) == (0, 1)  # type: ignore[attr-defined]
    assert set(chosen.gains.nominal().omega_c) == {9.0}  # type: ignore[attr-defined]


def test_one_count_moves_the_torque_by_what_is_said() -> None:
    law = GPI.auto(ARM, 1e-3, bits=16)
    torque = law.count_torque(16)
    omega = law.gains.nominal().omega_c
    own = [count_noise(tuning(w), 1e-3, MEMBER).at_once * 2.0 * math.pi / 2**16 for w in omega]
    np.testing.assert_allclose(torque, (most_inertia(law.robot) * own).max(axis=1), rtol=1e-12)
    with pytest.raises(ParameterError, match="a single Robot"):
        GPI.auto(RobotBatch([ARM, ARM]), 1e-3).count_torque(16)


@pytest.mark.filterwarnings("ignore:.*5 % of the moving mass")
@pytest.mark.parametrize("late", [1e-3, 12e-3])
def test_the_nominal_load_is_what_the_loop_has_delay_margin_to_spare_for(late: float) -> None:
    arm = rotors.assume_rotors(Robot.load("kinova"))
    law = GPI.auto(arm, 1e-3, delay=late, bits=16)
    load = plausible_load(arm)
    empty = law.payload.delta[1]
    if late == 1e-3:  # as far above 1 empty as below it with the load that is likely
        assert empty * load.with_nominal(law.payload.heaviest) == pytest.approx(1.0)
    else:  # there is nothing to spare
        assert law.payload.heaviest == pytest.approx(0.0, abs=1e-9)
    assert 1.0 <= empty <= 1.0 / math.sqrt(load.delta) + 1e-12
    tunings = [tuning(omega) for omega in law.gains.nominal().omega_c]
    own = Member(1, 1, law.rolloff_ratio[0])
    assert all(delay_margin(open_loop(each, own, empty)) > 1.5e-3 + late for each in tunings)
    assert law.bias_robot is arm  # the feedforward knows of no load
    arms = RobotBatch([arm, arm.scaled_inertia(2.0)])
    both = GPI.auto(arms, 1e-3, delay=late, bits=16)
    one = GPI.auto(arms.robots[1], 1e-3, delay=late, bits=16)
    q = arm.middle()
    np.testing.assert_allclose(
        both.robot.robots[1].mass_matrix(q),
        one.robot.mass_matrix(q),
        rtol=1e-9,
        atol=1e-12,
    )


def test_what_will_go_wrong_is_said() -> None:
    with pytest.warns(ArmgpiWarning, match="joint 'q1'.*use a shorter sample time"):
        GPI.auto(ARM, 1e-2, delay=3e-2)
    light = Robot.load("hextilt_arm").with_armature(1e-9)
    GPI.auto(light, 1e-3)  # of a load that nobody told nothing is said unasked: tests fail on warnings
    (found,) = advice.light_model(light)
    assert "5 % of the moving mass" in found.message
    fast = {"gains": FixedGains(30.0), "rolloff": 0}
    with pytest.warns(
        ArmgpiWarning, match="one encoder count changes the torque of joint 'q2' by .* % of its"
    ):
        GPI.auto(ARM.with_limits(effort=1.0), 1e-3, bits=10, **fast)
    section = {"type": "gpi", "omega": 30.0}
    context = Context(ARM.with_limits(effort=1.0), 1e-3, bits=np.full(3, 10.0), nominal=ARM)
    with pytest.warns(ArmgpiWarning, match="one encoder count"):
        config.controller(section, context._replace(nominal=context.robot))


def test_encoders_of_which_nothing_is_said_have_16_bits() -> None:
    made, told = (GPI.auto(ARM, 1e-3, **given) for given in ({}, {"bits": 16}))
    run: Any = config.controller({"type": "gpi_auto"}, Context(ARM, 1e-3, nominal=ARM))
    for law in (made, run):
        assert (law.gains.nominal().omega_c == told.gains.nominal().omega_c).all()


@pytest.mark.parametrize(
    ("given", "error", "named"),
    [
        ({"dt": 0.0}, ParameterError, "dt"),
        ({"delay": -1.0}, ParameterError, "delay"),
        ({"bits": 0}, ParameterError, "bits"),
        ({"bits": "many"}, ArmgpiError, "bits"),
        ({"robot": 3}, ParameterError, "robot"),
        ({"payload": 1.0}, ParameterError, "payload"),
        ({"payload": (0.0, 50.0)}, PayloadError, "no bandwidth is stable"),
        ({"integrators": 4}, ParameterError, "integrators"),
        ({"robot": ARM.with_limits(effort={"q2": 0.0}), "bits": 16}, EffortError, "q2"),
    ],
)
def test_what_cannot_be_is_refused(given: dict[str, Any], error: type[ArmgpiError], named: str) -> None:
    with pytest.raises(error, match=named):
        GPI.auto(**{"robot": ARM, "dt": 1e-3, **given})


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*specified to have no rotor")
@pytest.mark.parametrize("inertia", ["none", "believed", "0.1", "0.3"])
def test_a_panda_behind_16_bits_and_a_sample_of_delay_moves_quietly_and_well(inertia: str) -> None:
    file = Robot.load("panda", ["panda_finger_joint1", "panda_finger_joint2"])
    told = float(inertia.replace("none", "0")) if inertia != "believed" else None
    panda = rotors.assume_rotors(file) if told is None else file.with_armature(told)
    q0 = panda.middle()
    real = RigidBodyPlant(panda.with_payload("panda_hand", 0.25))
    law = GPI.auto(panda, 1e-3, delay=1e-3, bits=16, drives="stiff")
    plant = Delayed(Encoder(real, 16), 1)
    rollout = simulate(plant, law, Bezier(q0, q0 + 0.5, 3.0), 8.0, progress=False, backend="compiled")
    # [N m] per ms, what libfranka takes; 4.0 for the printed law
    assert np.abs(np.diff(rollout["tau"].values, axis=0)).max() < 1.0
    assert float(metrics.itae(rollout).sum()) < 0.0103
    assert float(metrics.peak_error(rollout).max()) < 0.002


def test_the_rule_s_numbers_decide_no_code(monkeypatch: pytest.MonkeyPatch) -> None:
    from armgpi.plants.reality import Reality, stack_draws

    draws = [Reality.geared(5).draw(ARM, i) for i in range(3)]
    whole = stack_draws(draws)

    def structure() -> Any:
        law = config.controller({"type": "gpi_auto"}, whole.context)
        loop = ClosedLoop(whole.plant, law, whole.reference)
        with tracing():
            return Inventory(loop, loop.init()).structure

    before = structure()
    for name, value in {"CROSSOVER": 35.0, "TORQUE_SHARE": 0.002, "REST_ZONE": 1e-3, "RATIO": 5.0}.items():
        monkeypatch.setattr(rule, name, value)
    assert structure() == before


def test_nominal_loads_of_varied_robots_are_those_of_each() -> None:
    varied = ARM.varied(inertia_scale=np.array([0.8, 1.0, 0.8]), rotor_inertia=np.array([0.1, 0.0, 0.1]))
    loads = LoadRange(heaviest=np.array([[0.2], [0.0], [0.2]]), com=(0.0, 0.0, 0.05))
    found = loads.choose(varied, 1e-3, 1e-3)
    assert isinstance(found.nominal, VariedRobots)
    for i, robot in enumerate(varied.robots):
        one = LoadRange(heaviest=(0.2, 0.0, 0.2)[i], com=(0.0, 0.0, 0.05)).choose(robot, 1e-3, 1e-3)
        q = ARM.random_positions(3, seed=i)
        np.testing.assert_allclose(found.nominal.mass_matrix(q)[i], one.nominal.mass_matrix(q[i]), rtol=1e-12)
        assert found.omega_c[i, 0] == pytest.approx(one.omega_c)  # type: ignore[index]
    first, _, third = varied.robots
    assert first is third
