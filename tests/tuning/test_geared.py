"""The rule for gears that twist: what it bears, what it says, and that a run has what an export writes."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest

from armgpi import GPI, FixedGains, Robot, RobotBatch, certify, config
from armgpi.errors import ParameterError
from armgpi.plants.elastic import ElasticPlant
from armgpi.robot import rotors
from armgpi.robot.kinematics import random_configurations
from armgpi.tuning import geared, two_mass, verdict
from armgpi.tuning.two_mass import ArmLoop, Gears

#: Rotors [kg m^2] and gears [N m/rad] of typical size, assumed.
PANDA = Robot.load("panda", ["panda_finger_joint1", "panda_finger_joint2"])
UR5 = Robot.load("ur5")
ROTORS = {PANDA: [0.6, 0.6, 0.46, 0.46, 0.2, 0.2, 0.2], UR5: [1.2, 1.2, 0.8, 0.2, 0.2, 0.2]}
GEARS = {PANDA: [14e3] * 4 + [8e3] * 3, UR5: [20e3, 20e3, 15e3, 5e3, 5e3, 5e3]}
DT = 1e-3


def rule(robot: Robot, drives: str | None = None, late: int = 1) -> GPI:
    return GPI.auto(robot, DT, delay=late * DT, bits=16, drives=drives)


def told(robot: Robot, factor: float, side: str) -> Robot:
    arm = robot.with_armature(ROTORS[robot])
    every = zip(arm.joint_names, GEARS[robot], strict=True)
    return arm.with_drives({j: {"stiffness": factor * K, "encoder_side": side} for j, K in every})


@pytest.mark.parametrize("known", [True, False], ids=["rotors told", "rotors believed"])
@pytest.mark.parametrize("arm", [PANDA, UR5], ids=["panda", "ur5"])
def test_believed_gears_make_a_law_that_bears_what_gears_usually_are(arm: Robot, known: bool) -> None:
    rotor, stiffness = np.array(ROTORS[arm]), np.array(GEARS[arm])
    law = rule(arm.with_armature(rotor) if known else arm)
    held = 0
    for q in random_configurations(arm, 8, seed=0):
        linear = two_mass.law(law, q)
        for factor, side, damping in itertools.product((0.5, 1.0, 2.0), ("motor", "link"), (0.05, 0.01)):
            gears = Gears(rotor, factor * stiffness, damping, 500.0, side)
            held += ArmLoop(arm, q, gears, DT, 1).growth(linear) < 1.0
    assert held == 96


@pytest.mark.parametrize("arm", [PANDA, UR5], ids=["panda", "ur5"])
def test_it_bears_rotors_that_nobody_guessed(arm: Robot) -> None:
    law, rng, held = rule(arm), np.random.default_rng(200), 0
    linear = [(q, two_mass.law(law, q)) for q in random_configurations(arm, 8, seed=0)]
    for _ in range(20):
        gears = Gears(np.exp(rng.uniform(math.log(0.1), math.log(1.2), arm.n)))
        held += all(ArmLoop(arm, q, gears, DT, 1).growth(own) < 1.0 for q, own in linear)
    assert held >= 18


def test_a_specified_stiffness_may_be_off_by_three_tenths_either_way() -> None:
    arm = told(UR5, 1.0, "link")
    assert not geared.is_assumed(arm)
    low, high = geared._stiffness_ends(arm)
    np.testing.assert_allclose(low, 0.7 * np.array(GEARS[UR5]))
    np.testing.assert_allclose(high, 1.3 * np.array(GEARS[UR5]))


def test_a_specified_stiffness_behind_the_link_is_as_fast_as_its_sensitivity_allows() -> None:
    arm = told(UR5, 1.0, "link")
    law = rule(arm)
    judged = [case for case in geared.cases(arm, DT, 1) if case.judged]
    peak = max(case.arm.sensitivity(two_mass.law(law, case.q)) for case in judged)
    assert peak <= geared.SENSITIVITIES[0] + 0.01  # noise makes single joints slower than the rest
    omega = law.gains.nominal().omega_c.max()
    faster = law.with_values(gains=FixedGains(1.2 * omega))
    assert any(case.arm.sensitivity(two_mass.law(faster, case.q)) > 2.4 for case in judged)
    assert (law.rolloff, law.rotor_factor) == (1, 1.0)


def test_each_joint_is_as_fast_as_all_loops_bear() -> None:
    arm = told(PANDA, 1.0, "motor")
    law = GPI.auto(arm, DT, delay=DT, second_zeta=0.7)  # else another rule has it
    omega, most = law.gains.nominal().omega_c, geared.SENSITIVITIES[0]
    loops = geared.Loops(geared.cases(arm, DT, 1), law.robot, arm, law.member, DT)
    assert loops.holds(omega, most)
    assert omega.max() > 2.0 * omega.min()
    for joint in range(arm.n):
        assert not loops.holds(omega * np.where(np.arange(arm.n) == joint, 2.0, 1.0), most)


def test_a_late_loop_bears_gears_that_are_softer_than_believed() -> None:
    law = GPI.auto(UR5, 4e-3, delay=4e-3, bits=16)
    arm, rolled = law.bias_robot, law.with_values(rolloff=1, rolloff_ratio=8.0)
    assert law.rolloff == 0
    held = np.zeros(2, dtype=int)
    for share, lowest in ((1.0, 6.0), (1.0, 10.0), (0.5, 20.0)):  # of the rotors, resonance [Hz]
        stiffness = arm.drives.value("stiffness")
        gears = Gears(share * arm.armature, stiffness, 0.03)
        links = UR5.mass_matrix(UR5.middle())
        factor = (lowest / rotors.lowest_mode(links, gears.rotor, stiffness)) ** 2
        for q in random_configurations(UR5, 4, seed=0):
            loop = ArmLoop(UR5, q, gears._replace(stiffness=factor * stiffness), 4e-3, 1)
            held += [loop.growth(two_mass.law(each, q)) < 1.0 for each in (law, rolled)]
    assert held[0] == 12
    assert held[1] < 8


def test_no_loop_is_so_slow_that_the_arm_falls_under_its_load() -> None:
    for late in (2, 3):
        law = GPI.auto(PANDA, 4e-3, delay=late * 4e-3, bits=20)
        assert law.gains.nominal().omega_c.min() == pytest.approx(geared.SLOWEST)


def test_behind_encoders_at_the_link_believed_gears_may_be_as_soft_as_any() -> None:
    robot = rotors.assume_gears(UR5).with_drives({j: {"encoder_side": "link"} for j in UR5.joint_names})
    law, q = rule(robot), UR5.middle()
    stiffness = robot.drives.value("stiffness") * (geared.SOFTEST / geared.resonance(robot)) ** 2
    gears = Gears(robot.armature, stiffness, 0.03, 500.0, "link")
    links = UR5.mass_matrix(q) - np.diag(UR5.armature)
    assert rotors.lowest_mode(links, gears.rotor, gears.stiffness) == pytest.approx(5.0, rel=1e-9)
    assert ArmLoop(UR5, q, gears, DT, 1).growth(two_mass.law(law, q)) < 1.0


@pytest.mark.parametrize("late", [1, 3])
def test_gears_told_stiff_change_nothing(late: int) -> None:
    stiff = rule(told(UR5, 1e3, "motor"), late=late)
    # The same encoders: behind the gear their counts are finer.
    at_motor = {joint: {"encoder_side": "motor"} for joint in UR5.joint_names}
    rigid = rule(UR5.with_armature(ROTORS[UR5]).with_drives(at_motor), "stiff", late)
    assert stiff.values()["rolloff_ratio"] == rigid.values()["rolloff_ratio"]
    assert (stiff.feedforward, stiff.rotor_factor) == (rigid.feedforward, 1.0)
    np.testing.assert_array_equal(stiff.gains.nominal(), rigid.gains.nominal())


def test_a_batch_of_stiff_and_soft_gears_is_refused() -> None:
    stiff, stiffer, soft = (told(UR5, factor, "motor") for factor in (1e3, 2e3, 1.0))
    law = GPI.auto(RobotBatch([stiffer, stiff]), DT, delay=DT, bits=16)
    alone = rule(stiff)
    assert (law.feedforward, law.rotor_factor) == (alone.feedforward, alone.rotor_factor)
    np.testing.assert_allclose(law.gains.nominal().omega_c[1], alone.gains.nominal().omega_c)
    with pytest.raises(ParameterError, match=r"for stiff joints.*: arms 0; for encoders at the motors"):
        GPI.auto(RobotBatch([stiff, soft]), DT, delay=DT, bits=16)


def test_heavier_rotors_are_those_of_the_feedback_alone() -> None:
    arm = UR5.with_armature(ROTORS[UR5])
    law = GPI(arm, DT, rotor_factor=3.0, feedforward="computed")
    np.testing.assert_allclose(law.robot.armature, 3.0 * arm.armature)
    assert law.bias_robot is arm
    again = law.with_values(start="zero")
    np.testing.assert_array_equal(again.robot.armature, law.robot.armature)
    varied = UR5.varied(
        rotor_inertia=np.array([ROTORS[UR5], 2.0 * arm.armature]), payload=np.array([0.5, 0.0])
    )
    q = UR5.middle()
    for batch in (varied, RobotBatch(varied.robots)):
        both = GPI(batch, DT, rotor_factor=3.0).robot.mass_matrix(np.stack([q, q]))
        for i, one in enumerate(varied.robots):
            np.testing.assert_allclose(
                both[i], GPI(one, DT, rotor_factor=3.0).robot.mass_matrix(q), rtol=1e-12
            )


def test_a_batch_has_the_rule_of_each() -> None:
    arms = [rotors.assume_gears(UR5), rotors.assume_gears(UR5.with_armature(ROTORS[UR5]))]
    both = GPI.auto(RobotBatch(arms), DT, delay=DT, bits=16).gains.nominal().omega_c
    np.testing.assert_allclose(both, [rule(arm).gains.nominal().omega_c for arm in arms], rtol=1e-4)


def test_one_joint_has_its_closed_form() -> None:
    # (M^-1 + J^-1) K
    mode = rotors.lowest_mode(np.diag([2.0]), np.array([0.5]), np.array([1e4]))
    assert mode == pytest.approx(math.sqrt((1 / 2.0 + 1 / 0.5) * 1e4) / (2.0 * math.pi), rel=1e-12)


def test_ms_of_an_arm_without_gears_is_that_of_one_joint() -> None:
    arm = UR5.with_armature(ROTORS[UR5]).with_gravity((0.0, 0.0, 0.0))
    law = GPI(arm, DT, integrators=1, gains=FixedGains(20.0))
    q = arm.middle()
    seen = ArmLoop(arm, q, Gears(arm.armature, current=None), DT, 1).sensitivity(two_mass.law(law, q))
    own = two_mass.joint_laws(law._law, law._law.coefficients(law.gains.nominal(), DT), arm.n)
    w = np.geomspace(1e-3, math.pi, 20_000)
    z = np.exp(1j * w)
    pick = [i * arm.n for i in range(len(own.A) // arm.n)]
    A, B, C = own.A[np.ix_(pick, pick)], own.B[pick, 0], own.C[0, pick]
    answer = np.array([C @ np.linalg.solve(x * np.eye(len(A)) - A, B) for x in z]) + own.D[0, 0]
    plant = 0.5 * DT**2 * (z + 1.0) / (z - 1.0) ** 2 / z  # a double integrator, held and one sample late
    assert seen == pytest.approx(np.abs(1.0 / (1.0 - plant * answer)).max(), rel=5e-3)


def test_the_delay_margin_is_where_the_loop_begins_to_swing() -> None:
    law = rule(rotors.assume_rotors(UR5))
    for case in geared.rigid_cases(law.bias_robot, DT, 1):
        linear = two_mass.law(law, case.q)
        samples = case.arm.delay_margin(linear) / DT
        assert (
            case.arm.growth(linear, math.floor(samples - 0.1))
            < 1.0
            < case.arm.growth(linear, math.ceil(samples + 0.1))
        )


def test_a_run_has_the_law_and_the_drives_that_an_export_writes() -> None:
    data: dict[str, Any] = {
        "robot": {"name": "ur5", "drives": "elastic"},
        "plant": {"encoder_bits": 16, "delay": 1},
        "controllers": [{"type": "gpi_auto"}],
        "t_final": 0.5,
    }
    made = config.build(config.check(data, config.Origin()))
    law: Any = made.controllers["gpi_auto"]
    direct = rule(rotors.assume_gears(UR5))
    np.testing.assert_array_equal(law.gains.nominal(), direct.gains.nominal())
    assert (law.rotor_factor, law.feedforward, law.rolloff) == (3.0, "computed", 0)
    np.testing.assert_array_equal(law.robot.armature, direct.robot.armature)
    inner: Any = made.plant
    while not isinstance(inner, ElasticPlant):
        inner = inner.plant
    np.testing.assert_allclose(inner.gear_stiffness, made.robot.drives.value("stiffness"))
    again = config.build(config.check(made.config.plain(), config.Origin()))
    np.testing.assert_array_equal(again.robot.drives.value("stiffness"), made.robot.drives.value("stiffness"))
    assert again.config.plant.engine == "elastic"
    data["plant"]["engine"] = "armgpi"
    assert config.build(config.check(data, config.Origin())).config.plant.engine == "armgpi"


@pytest.mark.filterwarnings("ignore:.*5 % of the moving mass")
def test_a_law_with_heavier_rotors_gets_no_certificate() -> None:
    arm = UR5.with_armature(ROTORS[UR5])
    with pytest.raises(ParameterError, match="rotor_factor"):
        certify(arm, box=0.1, dt=DT, speed=0.1, integrators=1, rotor_factor=3.0)


def test_it_says_what_limits_a_law_and_what_gears_lose_it() -> None:
    soft = verdict.verdict(rule(rotors.assume_gears(UR5)), rotors.assume_gears(UR5), 16)
    assert soft.limits[1:] == ("gears",) * 5
    assert soft.limits[0] == "noise"
    assert "limited by joint elasticity and encoder counts" in soft.describe()
    stiff = verdict.verdict(rule(UR5, "stiff"), rotors.assume_rotors(UR5), 16)
    assert not math.isfinite(stiff.resonance)
    assert "stiff joints are assumed: a resonance below" in stiff.describe()
    arm = rotors.assume_gears(UR5)
    factor = (1.05 * stiff.borne / stiff.usual) ** 2
    for times, bears in ((factor, True), (0.7 * factor, False)):
        gears = Gears(
            arm.armature, times * arm.drives.value("stiffness"), geared.DAMPINGS[0], two_mass.CURRENT_LOOP
        )
        peaks = [
            ArmLoop(arm, case.q, gears, DT, 1).sensitivity(two_mass.law(rule(UR5, "stiff"), case.q))
            for case in geared.rigid_cases(arm, DT, 1)
        ]
        assert (max(peaks) <= geared.RIGID_SENSITIVITY) == bears
    late = verdict.verdict(
        GPI.auto(UR5, 4e-3, delay=12e-3, bits=None, drives="stiff"), rotors.assume_rotors(UR5)
    )
    assert set(late.limits) <= {"delay", "load"}


def test_coarse_encoders_make_no_joint_slower_than_an_arm_bears() -> None:
    law = GPI.auto(UR5, DT, delay=DT, bits=10)
    assert law.gains.nominal().omega_c.min() >= geared.SLOWEST


def test_a_rotor_whose_interval_reaches_zero_is_as_light_as_a_believed_one() -> None:
    rotor = dict(zip(UR5.joint_names, ROTORS[UR5], strict=True))
    lowest = (dict.fromkeys(rotor, 0.0), {name: x / rotors.SCATTER for name, x in rotor.items()})
    arms = [told(UR5, 1.0, "motor") for _ in lowest]
    arms = [
        arm.with_drives(arm.drives.with_value("rotor_inertia", rotor, low, rotor, "identified"))
        for arm, low in zip(arms, lowest, strict=True)
    ]
    assert rule(arms[0]).gains.nominal().omega_c == pytest.approx(
        rule(arms[1]).gains.nominal().omega_c, rel=1e-6
    )


@pytest.mark.filterwarnings("ignore:.*is too fast for dt")
def test_instability_is_blamed_on_the_stiffness_only_where_there_is_one() -> None:
    bare = rotors.without_rotors(UR5)
    fast = GPI(bare, DT, delay=DT, gains=FixedGains(500.0))
    found = verdict.verdict(fast, bare, 16)
    assert found.loops == (4, 4)
    assert "not stable even with stiff joints (4 of 4 loops are unstable: lower" in found.describe()
    assert "damping" not in found.describe()
    known = told(UR5, 1.0, "motor")
    known = known.with_drives({joint: {"damping": 1.0} for joint in known.joint_names})
    found = verdict.verdict(GPI(known, DT, delay=DT, gains=FixedGains(500.0)), known, 16)
    assert found.loops[0] > 0
    assert math.isnan(found.damping)
    assert "with the damping that is known (" in found.describe()
    assert "usual are" not in found.describe()


def test_a_growth_that_is_no_number_is_not_stable(monkeypatch: pytest.MonkeyPatch) -> None:
    law = rule(UR5, "stiff")
    monkeypatch.setattr(ArmLoop, "growth", lambda *_: math.nan)
    found = verdict._verdict(law, UR5, 16)
    assert found.loops == (4, 4)
    assert found.sensitivity == math.inf


def test_what_limits_each_joint_is_named_once() -> None:
    found = verdict.Verdict(("gears", "noise", "gears"), 2.0, 0.01, 20.0, float("nan"), float("nan"))
    assert found.explain("abc") == "limits by joint: joint elasticity (a, c), encoder counts (b)"


def test_what_limits_the_accuracy_of_each_joint_is_named_with_its_size() -> None:
    found = verdict.Accuracy(*np.array([[2e-3, 1e-4, 1e-4], [1e-3, 4e-3, 0.0], [1e-4, 1e-4, 3e-4]]))
    said = found.explain("abc", [False, False, True])
    assert said == (
        "largest error by joint: a 2 mrad (disturbance of a tenth of the usual effort, such as friction that "
        "the model lacks); b 4 mrad (deflection under gravity that motor encoders do not measure); c 0.3 mm "
        "(errors that are not integrated at rest)"
    )
    large = verdict.Accuracy(np.array([0.123, 0.0]), np.zeros(2), np.zeros(2))
    assert "a 120 mrad, b 0 mrad (" in large.explain("ab", [False, False])


def test_a_light_rotor_counts_as_a_hundredth_of_the_links_alone() -> None:
    arm = Robot.load("anthropomorphic3").with_armature(0.0)
    links = np.diag(arm.mass_matrix(arm.middle()))
    np.testing.assert_allclose(geared._rotor(arm.with_armature(5e-3 * links)), 1e-2 * links, rtol=1e-12)
    np.testing.assert_allclose(geared._rotor(arm.with_armature(2e-2 * links)), 2e-2 * links, rtol=1e-12)
