"""Certificates against the whole arm in compiled loops: nothing that moves exceeds what is certified."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sampling import for_search
from soundness import Adversary, Observed, bred, observe

import armgpi
from armgpi.certification.adversary import worst
from armgpi.certification.certificate import certificate
from armgpi.certification.quantities import search_numbers
from armgpi.certification.request import Asked, ask
from armgpi.health.zoo import fingers


@pytest.mark.parametrize(
    "options",
    [
        {"torque": 0.001, "acceleration": 0.2},
        for_search({"torque": 0.001, "acceleration": 0.2, "delay": 1, "bits": 20}),
        for_search({"integrators": 1, "rolloff": 1, "rolloff_ratio": 6.0}),
        for_search({"torque": 0.001, "jump": True, "payload": (0.0, 0.1), "delay": 1}),
        {"torque": 0.001, "jump": True, "payload": (0.0, 0.1), "feedforward": "gravity"},
    ],
)
def test_no_rollout_exceeds_a_certificate(options: dict[str, Any]) -> None:
    """`python tools/certificates.py --rollouts 10000` does it for every arm of the zoo: over 1e6 rollouts."""
    robot = armgpi.Robot.load("anthropomorphic3").with_armature(0.02)
    asked = ask(
        robot, 1e-3, **{"payload": (0.0, 0.25), "speed": 0.2, "start": "held", "radius": 0.05, **options}
    )
    made = certificate(asked, search_numbers(asked.setting))
    assert made.certified, made.reasons
    seen = observe(asked, made, 1500)
    assert seen.rollouts == 1500 * len(made.data["solutions"])
    assert (seen.gain <= 1.0).all()
    assert (seen.gain >= 0.2).all()  # the adversary is one
    if "stated" in made.data["solutions"]:
        assert (seen.stated <= 1.0).all()
    if "jump" in options:
        assert (seen.jump <= 1.0).all()
        assert seen.jump.max() >= 0.05  # the load does jump


@pytest.mark.slow
def test_no_rollout_of_the_untuned_law_exceeds_its_certificate() -> None:
    """From the right load's start and from the other one's; its dead zone is in the claims."""
    robot = armgpi.Robot.load("anthropomorphic3").with_armature(0.1)
    asked = ask(robot, 1e-3, speed=0.2, radius=0.2, controller="gpi_auto", torque=0.001, gains=None)
    made = certificate(asked, search_numbers(asked.setting))
    assert float(made.data["law"]["omega"][0]) == pytest.approx(55.3, abs=0.1)  # the rule's, not GPI's
    assert made.certified, made.reasons
    assert made.check() == []
    seen = observe(asked, made, 1000)
    for ratios in (seen.gain, seen.stated, seen.start):
        assert 0.0 < ratios.max() <= 1.0
    assert seen.gain.max() >= 0.2  # the others are made of the dead zone for the most part
    assert "one omega: automatic tuning gives the joints" in str(made)
    with pytest.raises(armgpi.errors.ParameterError, match="lightest payload of 0"):
        ask(robot, 1e-3, speed=0.2, controller="gpi_auto", payload=(0.05, 0.1))


def test_what_the_rule_chooses_for_elastic_joints_is_refused_by_the_name_of_the_controller() -> None:
    """Nobody gave its `rotor_factor`."""
    rigid = armgpi.Robot.load("anthropomorphic3")
    own = {"rotor_inertia": 0.1, "stiffness": 3000.0}
    elastic = rigid.with_drives(dict.fromkeys(rigid.joint_names, own))
    with pytest.raises(armgpi.errors.ParameterError, match=r"controller must be gpi: .*rotor_factor"):
        ask(elastic, 1e-3, speed=0.2, controller="gpi_auto")


def test_each_generation_keeps_the_best_and_is_better() -> None:
    """Genes of 1 are best here: half of them at first, nearly all of them after some generations."""
    rng = np.random.default_rng(0)
    genes = rng.random((200, 30))
    for _ in range(60):
        fitness = genes.sum(axis=1)
        following = bred(genes, fitness, 200, rng)
        assert following.sum(axis=1).max() >= fitness.max()
        genes = following
    assert genes.min() >= 0.0
    assert genes.max() <= 1.0
    assert genes.mean() > 0.9


@pytest.fixture(scope="module")
def jumping() -> tuple[Asked, armgpi.Certificate]:
    robot = armgpi.Robot.load("anthropomorphic3").with_armature(0.02)
    given = {"payload": (0.0, 0.02), "speed": 0.2, "radius": 0.05, "torque": 0.001, "jump": True}
    asked = ask(robot, 1e-3, acceleration=0.2, **given)
    return asked, certificate(asked, search_numbers(asked.setting))


@pytest.mark.search
def test_evolution_finds_more_than_drawing_and_exceeds_no_claim(
    jumping: tuple[Asked, armgpi.Certificate],
) -> None:
    asked, made = jumping
    assert set(made.data["solutions"]) == set(Observed._fields[1:])
    drawn, evolved = (observe(asked, made, 1000, claims=["jump"], generations=each) for each in (1, 10))
    assert drawn.rollouts == evolved.rollouts == 1000
    assert 1.05 * drawn.jump.max() < evolved.jump.max() <= 1.0


@pytest.mark.parametrize("claim", Observed._fields[1:])
def test_an_adversary_does_nothing_that_a_claim_does_not_allow(
    jumping: tuple[Asked, armgpi.Certificate], claim: str
) -> None:
    asked, made = jumping
    setting, rng = asked.setting, np.random.default_rng(0)
    adversary = Adversary(asked, made, claim)
    q = setting.lower + rng.random((50, 3)) * (setting.upper - setting.lower)
    reference = adversary.reference(q, rng.random((50, adversary.widths[3])))
    target = reference.at(np.linspace(0.0, 1.0, 201))
    tiny = 1e-9
    assert (target.q >= setting.lower - tiny).all()
    assert (target.q <= setting.upper + tiny).all()
    moves = float(claim != "gain")
    assert (np.abs(target.v) <= moves * setting.velocity + tiny).all()
    assert (np.abs(target.a) <= moves * setting.acceleration + tiny).all()
    np.testing.assert_allclose(np.gradient(target.q, 0.005, axis=0)[1:-1], target.v[1:-1], atol=1e-3)
    loads = rng.random((2, 50))
    arm, before, controller = adversary.loads(*loads)
    for robots in (arm, before):
        assert (robots.variation["payload"] >= 0.0).all()
        assert (robots.variation["payload"] <= 0.02).all()
    same = np.array_equal(arm.variation["payload"], before.variation["payload"])
    assert same == (claim in ("gain", "stated"))
    levels = rng.uniform(-1.0, 1.0, (50, 8, 3))
    tau = adversary.torques(levels, reference.start, arm)
    if claim == "gain":
        near = reference.start + adversary.claimed * rng.uniform(-1.0, 1.0, (50, 3))
        inverse = np.linalg.inv(arm.mass_matrix(near))
        length = np.sqrt(np.einsum("kpa,kab,kpb->kp", tau, inverse, tau))
        assert (length <= float(made.data["inputs"]["gain"]["torque"])).all()
    else:
        assert (np.abs(tau) <= 0.001).all()
    if claim == "jump":
        moved = adversary.excited(reference, before, controller, rng.uniform(-1.0, 1.0, (50, 2, 3)))
        stated = np.array(made.data["solutions"]["jump"]["claims"]["errors"], dtype=float)
        assert (np.abs(moved["q0"] - reference.start) <= stated).all()


ARMS: list[tuple[str, float, dict[str, Any]]] = [
    ("anthropomorphic3", 0.02, {"payload": (0.0, 0.02)}),
    ("anthropomorphic3", 0.1, {"payload": (0.0, 0.5), "radius": 0.2}),
    ("anthropomorphic3", 0.02, {"payload": (0.0, 0.02), "delay": 1, "bits": 20}),
    ("anthropomorphic3", 0.02, {"payload": (0.0, 0.02), "feedforward": "gravity"}),
    ("anthropomorphic3", 0.02, {"payload": (0.0, 0.02), "feedforward": "model"}),
    ("so100", 0.1, {"payload": (0.0, 0.1)}),
    ("ur5", 0.1, {"payload": (0.0, 0.5)}),
    ("panda", 0.2, {"payload": (0.0, 0.02)}),
]


@pytest.mark.search
@pytest.mark.parametrize(("name", "inertia", "options"), ARMS)
def test_no_evolved_adversary_exceeds_a_claim(name: str, inertia: float, options: dict[str, Any]) -> None:
    """Over references that move, torques, loads and starts: 30,000 rollouts of each claim."""
    robot = armgpi.Robot.load(name, lock=fingers(name))
    robot = robot.with_armature(robot.armature + inertia)
    given = {"speed": 0.2, "acceleration": 0.2, "radius": 0.05, "torque": 0.001, "jump": True}
    asked = ask(robot, 1e-3, **{**given, **options})
    made = certificate(asked, search_numbers(asked.setting))
    assert {"gain", "stated", "start"} <= set(made.data["solutions"]), made.reasons
    seen = observe(asked, made, 30_000, generations=30)
    for claim in made.data["solutions"]:
        assert (getattr(seen, claim) <= 1.0).all()


@pytest.mark.parametrize(("name", "load", "inertia"), [("anthropomorphic3", 0.25, 0.0), ("ur5", 3.0, 0.0)])
def test_a_certificate_is_within_a_factor_of_the_worst_found(name: str, load: float, inertia: float) -> None:
    robot = armgpi.Robot.load(name)
    asked = ask(robot, 1e-3, payload=(0.0, load), speed=0.2, start="held")
    made = certificate(asked, search_numbers(asked.setting))
    ratios = made.per_torque / [case.error for case in worst(asked, count=60)]
    assert (ratios >= 1.0).all()
    assert (ratios <= 2.5).all()


def common(rate: float, **options: Any) -> armgpi.BSplineNetwork:
    return armgpi.BSplineNetwork(
        **{"omega_c": (24.0, 30.0), "zeta_c": 1.0, "common": True, "rate": rate, **options}
    )


def test_a_common_omega_moves_over_the_certified_values_one_step_in_a_sample() -> None:
    robot = armgpi.Robot.load("anthropomorphic3")
    gains = common(0.05, error_range=1e-5, dead_zone=0.0)
    controller = armgpi.GPI(robot, 1e-3, gains=gains)
    prepared: Any = controller.gains
    values = prepared.bandwidths()
    np.testing.assert_allclose(np.diff(1.0 / values), -0.05e-3, rtol=1e-9)
    assert values[0] == 24.0
    assert 30.0 - 0.05 < values[-1] <= 30.0 + 1e-9
    pushed = armgpi.RigidBodyPlant(robot, loads=[armgpi.Step(0.5, onset=0.1, end=0.5)])
    runs = [
        armgpi.simulate(pushed, controller, armgpi.Hold(robot.middle()), 1.0, backend=backend, signals=True)
        for backend in ("numpy", "compiled")
    ]
    for run in runs:
        omega = run["omega_c"].values
        assert (omega == omega[:, :1]).all()
        places = np.searchsorted(values, omega[:, 0] * (1.0 - 1e-9))
        np.testing.assert_allclose(values[places], omega[:, 0], rtol=1e-12)
        assert np.abs(np.diff(places)).max() == 1
        assert places.max() > 10
    np.testing.assert_allclose(runs[0]["q"], runs[1]["q"], atol=1e-9)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"rate": np.inf}, "rate"),
        ({"omega_c": ([24.0, 25.0, 24.0], 30.0)}, "omega_c"),
        ({"zeta_c": (0.7, 1.0)}, "common"),
        ({"p_c": 20.0}, "common"),
        ({"learning": "signed"}, "learning"),
    ],
)
def test_a_common_omega_that_is_not_defined_is_refused(options: dict[str, Any], name: str) -> None:
    robot = armgpi.Robot.load("anthropomorphic3")
    with pytest.raises(armgpi.errors.ParameterError, match=name):
        armgpi.GPI(robot, 1e-3, gains=common(**{"rate": 0.05, **options}))


def test_the_rate_of_a_common_omega_comes_from_the_certificate() -> None:
    robot = armgpi.Robot.load("anthropomorphic3").with_armature(0.1)
    given = common(1.0, omega_c=(29.8, 30.0))  # far too fast
    made = armgpi.certify(robot, payload=(0.0, 0.1), speed=0.2, start="held", gains=given, rate="auto")
    assert made.certified, made.reasons
    assert made.check() == []
    found: Any = made.gains
    assert 0.005 < float(found.rate) <= 0.12
    assert len(made.data["law"]["omega"]) > 1
    asked = ask(robot, 1e-3, payload=(0.0, 0.1), speed=0.2, start="held", gains=found)
    assert (observe(asked, made, 2000).gain <= 1.0).all()
    fixed: Any = {"gains": armgpi.FixedGains(30.0), "rate": "auto"}
    with pytest.raises(armgpi.errors.ParameterError, match="rate"):
        armgpi.certify(robot, speed=0.2, **fixed)
