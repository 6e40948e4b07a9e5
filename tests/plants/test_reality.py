"""Draws of a reality: a function of seed and index, distributed as declared, physically consistent."""

from __future__ import annotations

import json
import math
import runpy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from machines import swing
from scipy import linalg, stats

from armgpi import GPI, PIDInversion, Reality, Robot, Supervisor, config, robots, simulate
from armgpi.base.intervals import clopper_pearson, wilson
from armgpi.base.parameter import parameters
from armgpi.errors import ArmgpiError, ConfigError, ParameterError
from armgpi.health import reality as health
from armgpi.plants.reality import Gears, Numbers, Scenario, batches, scales, stack_draws
from armgpi.references.bezier import PEAK_VELOCITY
from armgpi.robot import rotors

ARM = Robot.load("anthropomorphic3")
TOOL = runpy.run_path(str(Path(__file__).parents[2] / "tools" / "reality.py"))
#: Draws for tests of distributions, and the level of significance: some twenty are made.
MANY, LEVEL = 3000, 1e-4
KINDS = parameters(Reality)["name"].choices


@cache
def numbers(seed: int) -> list[Numbers]:
    """Return the numbers of many draws, none of which share a sample time but by chance."""
    reality = Reality.geared(seed, block=1)
    return [reality.numbers(3, index) for index in range(MANY)]


def drawn(reality: Reality, name: str) -> np.ndarray:
    """Return one of the numbers of many draws."""
    return np.array([getattr(each, name) for each in numbers(reality.seed)])


def test_the_same_seed_and_index_are_the_same_draw_and_others_are_not() -> None:
    for name in KINDS:
        first, again = Reality(name, 3).draw(ARM, 7), Reality(name, 3).draw(ARM, 7)
        for a, b in zip(first.numbers, again.numbers, strict=True):
            np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(first.move.goal, again.move.goal)
        np.testing.assert_array_equal(first.arm.mass_matrix(first.q0), again.arm.mass_matrix(first.q0))
        for other in (Reality(name, 3).draw(ARM, 8), Reality(name, 4).draw(ARM, 7)):
            assert not np.array_equal(first.q0, other.q0)
            assert first.numbers.inertia_scale != other.numbers.inertia_scale


@pytest.mark.parametrize("name", ["rotor_inertia", "payload", "inertia_scale"])
def test_what_is_uniform_passes_kolmogorov_and_smirnov(name: str) -> None:
    reality = Reality.geared(seed=1)
    low, high = getattr(reality, name)
    values = drawn(reality, name).ravel()
    assert low <= values.min() <= values.max() <= high
    assert stats.kstest(values, "uniform", (low, high - low)).pvalue > LEVEL


@pytest.mark.parametrize(
    ("name", "share"),
    [("coulomb", "friction_share"), ("torque_step", "step_share"), ("effort", "effort_share")],
)
def test_what_is_there_in_a_share_of_the_draws_is_uniform_where_it_is(name: str, share: str) -> None:
    reality = Reality.geared(seed=1)
    low, high = getattr(reality, name)
    values = drawn(reality, name).reshape(MANY, -1)
    there = np.isfinite(values).all(axis=1) & (values != 0.0).all(axis=1)
    assert stats.binomtest(int(there.sum()), MANY, getattr(reality, share)).pvalue > LEVEL
    assert stats.kstest(values[there].ravel(), "uniform", (low, high - low)).pvalue > LEVEL


def test_whole_numbers_and_choices_come_equally_often() -> None:
    reality = Reality.geared(seed=1)
    for name, values in (
        ("sample_time", reality.sample_time),
        ("delay", [1, 2, 3]),
        ("encoder_bits", range(12, 21)),
    ):
        found = drawn(reality, name)
        counts = [int((found == value).sum()) for value in values]
        assert sum(counts) == MANY
        assert stats.chisquare(counts).pvalue > LEVEL
    known = drawn(reality, "effort_known")[np.isfinite(drawn(reality, "effort"))]
    assert stats.binomtest(int(known.sum()), len(known), reality.effort_known).pvalue > LEVEL


def test_quantities_and_draws_are_independent() -> None:
    reality = Reality.geared(seed=1)
    columns = [drawn(reality, name).reshape(MANY, -1)[:, 0] for name in ("rotor_inertia", "inertia_scale")]
    columns += [drawn(reality, "payload"), drawn(reality, "rotor_inertia")[:, 1]]
    columns += [np.roll(columns[0], 1), drawn(Reality.geared(seed=2), "payload")]
    correlation = np.corrcoef(columns) - np.eye(len(columns))
    # Of independent columns it is normal with a deviation of 1 / sqrt(MANY).
    assert np.abs(correlation).max() < 4.5 / math.sqrt(MANY)


def test_changing_one_distribution_leaves_the_others_as_they_were_drawn() -> None:
    plain, heavy = (Reality.geared(5, payload=payload).numbers(3, 9) for payload in ((0.0, 0.05), (0.2, 0.3)))
    assert 0.2 <= heavy.payload <= 0.3
    for name, value in plain._asdict().items():
        if name != "payload":
            np.testing.assert_array_equal(value, getattr(heavy, name))


@pytest.mark.parametrize("kind", ["geared", "elastic", "owned"])
def test_draws_of_a_block_run_as_one_batch_and_are_what_they_are_alone(kind: str) -> None:
    reality = Reality(kind, seed=2, block=4, t_final=3.0)
    draws = [reality.draw(ARM, index) for index in range(8)]
    groups = batches(draws)
    assert sorted(draw.index for group in groups for draw in group) == list(range(8))
    group = groups[0]
    assert len(group) >= 4
    whole = stack_draws(group)
    law = {"type": "gpi"}
    run = simulate(whole.plant, config.controller(law, whole.context), whole.reference, 0.2)
    for row, draw in enumerate(group):
        alone = simulate(draw.plant, config.controller(law, draw.context), draw.reference, 0.2)
        np.testing.assert_allclose(run["q"].values[row], alone["q"].values, rtol=0.0, atol=1e-9)


def test_there_is_no_friction_without_rotor_inertia() -> None:
    for index in range(20):
        draw = Reality.bare().draw(ARM, index)
        assert draw.friction is None
        assert not draw.arm.armature.any()
        draw = Reality.geared().draw(ARM, index)
        assert draw.friction is not None
        assert (draw.arm.armature[(draw.friction.coulomb > 0.0) | (draw.friction.viscous > 0.0)] > 0.0).all()
    with pytest.raises(ParameterError, match="rotor_share must be positive"):
        Reality.geared(rotor_share=0.0)


def test_rotors_have_the_scatter_of_published_drives_about_what_is_assumed() -> None:
    reality = Reality("undriven", seed=1, block=1)
    ratios = np.array([reality.numbers(3, index).rotor_inertia for index in range(MANY)])
    common, each = reality.rotor_common, reality.rotor_each
    assert np.abs(np.log(ratios)).max() <= math.log(common * each)
    # Of two joints of an arm the common factor cancels: a difference of two uniform numbers is triangular.
    apart = np.log(ratios[:, 0] / ratios[:, 1]) / math.log(each)
    assert stats.kstest(apart, "triang", (0.5, -2.0, 4.0)).pvalue > LEVEL
    # Published drives that are held out are within it.
    tool = runpy.run_path(str(Path(__file__).parents[2] / "tools" / "rotors.py"))
    held_out = [tool["spin_up"](x) / rotors.SPIN_UP for x in tool["PUBLISHED"] if x.part == "held-out"]
    assert np.abs(np.log(held_out)).max() <= math.log(common * each)


def gears_of(draw: Scenario) -> Gears:
    """Return the gears of a draw that has any."""
    assert draw.gears is not None
    return draw.gears


def test_what_is_known_of_an_arm_that_somebody_has() -> None:
    arm = Robot.load("ur5")
    believed = rotors.assume_rotors(arm)
    for index in range(8):
        draws = {kind: Reality(kind, 4).draw(arm, index) for kind in ("undriven", "elastic", "owned")}
        for kind, draw in draws.items():
            true = draw.numbers.rotor_inertia * believed.armature
            np.testing.assert_allclose(draw.arm.armature, true, rtol=1e-12)
            knows = true if kind == "elastic" else believed.armature
            np.testing.assert_allclose(draw.model.armature, knows, rtol=1e-12)
            (source,) = set(draw.model.drives.sources("rotor_inertia"))
            assert source == ("specified" if kind == "elastic" else "assumed")
            side = [gears_of(draw).side if kind == "elastic" else ""] * 6
            assert draw.model.drives.value("encoder_side").tolist() == side
            assert set(draw.model.drives.sources("stiffness")) == {"assumed"}
        assert gears_of(draws["owned"]).side == "motor"
        # As geared ones, but for what is theirs alone.
        geared = Reality("geared", 4).draw(arm, index)
        np.testing.assert_array_equal(draws["owned"].friction, geared.friction)
        np.testing.assert_array_equal(draws["owned"].torque_step, geared.torque_step)


def test_the_lowest_mode_of_an_arm_with_gears_is_the_one_drawn() -> None:
    for index in range(8):
        draw = Reality("elastic", 5).draw(ARM, index)
        K, J = np.diag(gears_of(draw).stiffness), np.diag(draw.arm.armature)
        links = draw.arm.mass_matrix(ARM.middle()) - J
        nil = np.zeros((3, 3))
        stiffness, mass = np.block([[K, -K], [-K, K]]), np.block([[links, nil], [nil, J]])
        square = linalg.eigh(stiffness, mass, eigvals_only=True)
        # Three modes of an arm whose motors are free are no oscillation.
        assert np.sqrt(square[3]) / (2.0 * math.pi) == pytest.approx(draw.numbers.mode, rel=1e-9)
        assert 5.0 <= draw.numbers.mode <= 25.0


def test_an_arm_is_held_where_a_law_with_the_truth_has_little_sensitivity() -> None:
    slow = {"sample_time": [0.004], "delay": (3, 3)}
    assert not health.ideal_law_holds(Reality("elastic", 1, mode=(1.0, 1.0), **slow).draw(ARM, 0))
    fast = {"sample_time": [0.001], "delay": (1, 1), "gear_damping": (0.05, 0.05)}
    assert health.ideal_law_holds(Reality("elastic", 1, mode=(25.0, 25.0), **fast).draw(ARM, 0))
    assert health.ideal_law_holds(Reality("geared", 1, **slow).draw(ARM, 0))


def test_what_dies_out_or_returns_once_is_no_swinging() -> None:
    time, band = np.arange(2000) * 1e-3, np.full(2, 5e-4)

    def seen(motion: np.ndarray) -> bool:
        return health.swings(np.stack([np.zeros_like(motion), motion], axis=1), band)

    for frequency in (1.5, 3.0, 30.0):
        wave = np.sin(2.0 * math.pi * frequency * time)
        assert seen(1e-3 * wave)
        assert seen(1e-3 * np.exp(0.5 * time) * wave)
        assert not seen(1e-3 * np.exp(-1.0 * time) * wave)  # half of a mode of 5 Hz with 3 % of damping
        assert not seen(1e-4 * wave)  # too small
    assert not seen(0.05 * np.exp(-1.5 * time))  # a slow return
    assert not seen(0.01 * (time - 1.0) ** 2)  # one that turns


def test_a_law_that_believes_gears_has_the_same_draws() -> None:
    reality = Reality("owned", 3)
    for one, other in zip(
        *(health.draws(reality, "ur5", 3, drives) for drives in ("stiff", None)), strict=True
    ):
        for name in ("armature", "limits"):
            np.testing.assert_array_equal(getattr(one.arm, name), getattr(other.arm, name))
        np.testing.assert_array_equal(one.gears.stiffness, other.gears.stiffness)
        np.testing.assert_array_equal(one.move.goal, other.move.goal)
        assert not one.model.drives.sources("stiffness")[0]
        assert other.model.drives.sources("stiffness")[0] == "assumed"


def test_what_gravity_twists_unseen_loses_no_arm() -> None:
    draw = Reality("owned", 3).draw(ARM, 1)
    still = np.tile(draw.q0, (5, 1))
    low = health.sunk(draw, still)
    np.testing.assert_allclose(low, draw.arm.gravity(still) / gears_of(draw).stiffness)
    assert not health.sunk(Reality("geared", 3).draw(ARM, 1), still).any()


def test_a_draw_is_the_arm_with_what_was_drawn() -> None:
    reality, scale = Reality.geared(seed=3), scales(ARM)
    for index in range(10):
        draw = reality.draw(ARM, index)
        rotor = 0.5 * scale.inertia + 0.02 * scale.inertia.max()
        np.testing.assert_allclose(draw.model.armature, rotor)
        np.testing.assert_allclose(draw.arm.armature, draw.numbers.rotor_inertia * rotor)
        load = draw.arm.total_mass - ARM.total_mass
        assert load == pytest.approx(draw.numbers.payload * scale.mass, abs=1e-12)
        q = draw.q0
        expected = draw.numbers.inertia_scale * draw.model.mass_matrix(q)
        np.testing.assert_allclose(draw.nominal.mass_matrix(q), expected)
        assert draw.effort_known == np.array_equal(draw.nominal.limits.effort, draw.effort)
        way = q + np.linspace(0.0, 1.0, 21)[:, None] * (draw.move.goal - q)
        held = np.abs(draw.arm.gravity(way)).max(axis=0)
        assert (held <= reality.gravity_share * scale.effort * (1.0 + 1e-9)).all()
        assert (held <= draw.effort).all()
        least = reality.effort_gravity * held + reality.effort_spare * scale.effort
        own = np.maximum(least, draw.numbers.effort * scale.effort)
        np.testing.assert_allclose(draw.effort, np.minimum(own, ARM.limits.effort), rtol=1e-9)
        ARM.check_position(draw.move.goal, "the goal")


def test_a_move_is_the_first_of_those_drawn_on_which_the_arm_is_held() -> None:
    arm = ARM.with_limits(lower=[0.2, -1.8, -2.7], velocity={"q2": math.inf, "q3": 0.0})
    kept = []
    for share, index in ((0.6, 0), (0.1, 1), (0.1, 2), (0.01, 3), (0.01, 4)):
        reality, scale = Reality.geared(7, gravity_share=share), scales(arm)
        found, held = reality._move(arm, scale, index)
        start, way = (reality._random(index, x, 192).reshape(64, 3) for x in ("configuration", "direction"))
        moves = []
        for u, direction, size in zip(start, way, reality._uniform(index, "distance", 64), strict=True):
            middle = [1.75, 0.45, 0.0]
            low = [max(x, m - math.pi) for x, m in zip(arm.limits.lower, middle, strict=True)]
            high = [min(x, m + math.pi) for x, m in zip(arm.limits.upper, middle, strict=True)]
            begin = np.array([a + (b - a) * x for a, b, x in zip(low, high, u, strict=True)])
            goal = np.clip(begin + size * (2.0 * direction - 1.0), arm.limits.lower, arm.limits.upper)
            gravity = np.max([abs(arm.gravity(begin + s / 20 * (goal - begin))) for s in range(21)], axis=0)
            moves.append((max(gravity / scale.effort), begin, goal, gravity))
        first = next((each for each in moves if each[0] <= share), min(moves, key=lambda each: each[0]))
        kept.append(next((k for k, each in enumerate(moves) if each[0] <= share), None))
        np.testing.assert_allclose([found.start, found.goal, held], first[1:])
        shortest = max(PEAK_VELOCITY * abs(first[2] - first[1]) / [10.0, 1.0, 1.0])
        wanted = np.clip(shortest * reality._uniform(index, "speed")[0], 0.15, 2.5)
        assert (found.duration, found.begin) == pytest.approx((wanted, 0.3))
    assert set(kept) > {None, 0}  # of some the first is not held, of some none


def test_gears_are_as_stiff_and_as_damped_as_their_rotors_and_the_mode_say() -> None:
    draw = Reality("elastic", 5).draw(ARM, 3)
    found, drawn_, rotor = gears_of(draw), draw.numbers, draw.arm.armature / draw.numbers.rotor_inertia
    links = np.diag(draw.arm.mass_matrix(ARM.middle())) - draw.arm.armature
    share = found.stiffness / (drawn_.stiffness_share * rotor)
    np.testing.assert_allclose(share, share[0])
    both = 1.0 / (1.0 / links + 1.0 / draw.arm.armature)
    np.testing.assert_allclose(found.damping, 2.0 * drawn_.gear_damping * np.sqrt(found.stiffness * both))
    np.testing.assert_allclose(found.cogging, drawn_.cogging * scales(ARM).gravity)
    np.testing.assert_array_equal(found.current, drawn_.current)


def test_rotor_inertia_of_the_urdf_is_the_nominal_one() -> None:
    arm = ARM.with_armature([0.1, 0.0, 0.2])
    model = Reality.geared().draw(arm, 0).model
    assert model.armature[0] == 0.1
    assert model.armature[1] > 0.0
    assert model.armature[2] == 0.2


def test_an_arm_without_gravity_has_scales_as_well() -> None:
    level = swing(2, axis="0 0 1")
    scale = scales(level)
    assert (scale.gravity > 0.0).all()
    assert (scale.effort > 0.0).all()
    draw = Reality.geared().draw(level, 0)
    assert np.isfinite(draw.effort).all() or not np.isfinite(level.limits.effort).all()


def test_an_arm_without_torque_limits_is_drawn_as_one_whose_limits_are_never_reached() -> None:
    free, strong = ARM.with_limits(effort=math.inf), ARM.with_limits(effort=1e6)
    rows = []
    for arm in (free, strong):
        group = batches([Reality.geared(seed=5, block=8, t_final=3.0).draw(arm, i) for i in range(8)])[0]
        assert {math.isinf(draw.numbers.effort) for draw in group} == {True, False}
        whole = stack_draws(group)
        rows.append(
            simulate(whole.plant, config.controller({"type": "gpi"}, whole.context), whole.reference, 0.2)
        )
    np.testing.assert_array_equal(rows[0]["q"], rows[1]["q"])


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"payload": (0.1, 0.0)}, "payload"),
        ({"payload": (-0.1, 0.0)}, "payload"),
        ({"payload": 0.1}, "payload"),
        ({"payload": (0.0, 0.1, 0.2)}, "payload"),
        ({"payload": (0.0, math.nan)}, "payload"),
        ({"delay": (1, 2.5)}, "delay"),
        ({"encoder_bits": (0, 12)}, "encoder_bits"),
        ({"sample_time": []}, "sample_time"),
        ({"sample_time": [1e-3, 0.0]}, "sample_time"),
        ({"friction_share": 1.5}, "friction_share"),
        ({"t_final": 1.0}, "t_final"),
        ({"seed": -1}, "seed"),
        ({"name": "perfect"}, "name"),
    ],
)
def test_a_distribution_that_is_none_is_refused_by_its_name(changes: dict[str, object], named: str) -> None:
    with pytest.raises(ArmgpiError, match=named):
        Reality(**changes)


def test_bad_draws_are_refused() -> None:
    for index in (-1, 0.5, True, 2**60):
        with pytest.raises(ParameterError, match="index"):
            Reality.geared().draw(ARM, index)
    with pytest.raises(ParameterError, match="robot"):
        Reality.geared().draw("panda", 0)
    one, other = Reality.geared(), Reality.geared(sample_time=[0.01])
    with pytest.raises(ParameterError, match="draws"):
        stack_draws([one.draw(ARM, 0), other.draw(ARM, 0)])


FILE = """
robot: {name: anthropomorphic3}
reality: {name: geared, seed: 3, index: 7, payload: [0.01, 0.02]}
controllers: [{type: gpi}, {type: pid}]
"""


def test_a_draw_goes_through_an_experiment_file_and_back() -> None:
    first = config.build(*config.parse(FILE, "x"))
    draw = Reality.geared(3, payload=(0.01, 0.02)).draw(ARM, 7)
    assert first.config.sample_time == draw.dt
    assert first.t_final == draw.t_final
    text = config.dump(first.config)
    second = config.build(*config.parse(text, "y"))
    assert config.dump(second.config) == text
    law = config.controller({"type": "gpi"}, draw.context)
    runs = [
        simulate(made.plant, made.controllers["gpi"], made.reference, 0.5, progress=False)
        for made in (first, second)
    ]
    runs.append(simulate(draw.plant, law, draw.reference, 0.5, progress=False))
    for run in runs[1:]:
        np.testing.assert_array_equal(run["q"], runs[0]["q"])
        np.testing.assert_array_equal(run["tau"], runs[0]["tau"])
    pid = first.controllers["pid"]
    assert isinstance(pid, PIDInversion)
    np.testing.assert_array_equal(pid.bias_robot.gravity(draw.q0), draw.model.gravity(draw.q0))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("reality: {name: rusty}", "reality.name"),
        ("reality: {index: -1}", "reality.index"),
        ("reality: {payload: [0.2, 0.1]}", "payload must be"),
        ("reality: {payload: [0.2]}", "reality.payload"),
        ("reality: {weather: 1}", "reality.weather"),
        ("reality: {}\nplant: {delay: 1}", "mutually exclusive"),
    ],
)
def test_a_section_that_is_wrong_is_refused_by_its_key(line: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        config.build(*config.parse(f"robot: {{name: anthropomorphic3}}\n{line}\n", "x"))


def test_what_a_file_says_itself_goes_before_the_draw() -> None:
    text = FILE + "sample_time: 0.01\nt_final: 1.5\nreference: {points: [[0, 0, 0]]}\n"
    made = config.build(*config.parse(text, "x"))
    assert made.controllers["gpi"].dt == 0.01
    assert made.t_final == 1.5
    np.testing.assert_array_equal(made.reference.at(1.0).q, 0.0)


def test_outcomes_are_what_their_definitions_say() -> None:
    draw = Reality.geared(seed=3).draw(ARM, 7)
    still = simulate(draw.plant, GPI(draw.nominal, draw.dt), draw.reference, draw.t_final, progress=False)
    still["q"] = still["q_ref"].copy()
    still["tau"] = 0.0 * still["tau"]
    end = still["time"] > draw.t_final - health.END
    assert health.outcome(still, draw)[2:5] == (False, False, False)
    beyond = still["q_ref"] + xr_pulse(still, 0.51, ~end)
    assert health.outcome(still.assign(q=beyond), draw).failed
    late = still["q_ref"] + xr_pulse(still, 0.11, end)
    assert health.outcome(still.assign(q=late), draw).failed
    count = float(ARM.encoder_count(draw.encoder_bits)[0])
    sway = max(5e-4, 4.0 * count)
    for size, expected in ((0.4, False), (0.6, True)):
        swaying = still["q_ref"] + size * sway * alternating(still)
        assert health.outcome(still.assign(q=swaying), draw).hunting is expected
    # To and fro until the end, or until the last second.
    wave: Any = 3.0 * sway * np.sin(2.0 * np.pi * still["time"] / 0.43)
    assert health.outcome(still.assign(q=still["q_ref"] + wave), draw).swinging
    dying = wave.where(still["time"] <= draw.t_final - 0.5 * health.SWING, 0.0)
    assert not health.outcome(still.assign(q=still["q_ref"] + dying), draw).swinging
    for size, expected in ((0.45, False), (0.55, True)):
        torque = size * health.CHATTER * draw.scale * alternating(still).values[:, None]
        found = health.outcome(still.assign(tau=still["tau"] + torque), draw)
        assert found.chatter is expected
        assert not found.failed


def alternating(run):  # type: ignore[no-untyped-def]
    """Return +1 and -1 by turns over a rollout's samples."""
    return 0.0 * run["time"] + (-1.0) ** np.arange(run.sizes["time"])


def xr_pulse(run, size, where):  # type: ignore[no-untyped-def]
    """Return a deviation of one sample where something holds."""
    at = np.flatnonzero(where.values)[0]
    return 0.0 * run["time"] + size * (np.arange(run.sizes["time"]) == at)


def test_intervals_hold_the_share_at_both_ends_too() -> None:
    for total in (1, 5, 100):
        for count in range(total + 1):
            share, low, high = wilson(count, total)
            assert 0.0 <= low <= share <= high <= 1.0
            assert high - low > 0.0
    # Wilson's closed form at 3 of 10, z = 1.96.
    z = float(stats.norm.ppf(0.975))
    centre, width = (0.3 + z * z / 20.0), z * math.sqrt(0.3 * 0.7 / 10.0 + z * z / 400.0)
    expected = np.array([centre - width, centre + width]) / (1.0 + z * z / 10.0)
    np.testing.assert_allclose(wilson(3, 10)[1:], expected, rtol=1e-12)
    # Clopper and Pearson's by the beta distribution.
    ends = stats.beta.ppf(0.025, 3, 8), stats.beta.ppf(0.975, 4, 7)
    np.testing.assert_allclose(clopper_pearson(3, 10)[1:], ends, rtol=1e-9)


def test_rollouts_of_draws_are_supervised_by_what_suits_each_encoder_and_the_delay() -> None:
    reality = Reality.geared(2, sample_time=[4e-3], encoder_bits=(12, 20), t_final=2.8)
    found = [reality.draw(ARM, index) for index in (0, 1)]
    assert len({draw.encoder_bits for draw in found}) == 2
    ((group, (free, watched)),) = health.rollouts(found, {"type": "gpi_auto"}, "numpy", (None, Supervisor()))
    assert [each.index for each in group] == [0, 1]
    assert "fault" not in free
    given = json.loads(watched.attrs["provenance"])["controller"]["supervisor"]
    np.testing.assert_array_equal(given["resolution"], [ARM.encoder_count(x.encoder_bits) for x in found])
    assert given["frozen_samples"] == 13 + found[0].delay
    assert given["response"] == 0.004 + 4e-3 * found[0].delay


def test_every_arm_is_either_for_fitting_or_held_out_and_families_stay_together() -> None:
    fit, held_out = set(TOOL["arms"]("fit")), set(TOOL["arms"]("held-out"))
    assert not fit & held_out
    assert fit | held_out == set(robots.EXAMPLE_ROBOT_DATA)
    for names in TOOL["families"]().values():
        assert set(names) <= fit or set(names) <= held_out
    for together_ in (("kinova", "anymal_kinova_arm"), ("z1", "b1_z1_arm"), ("ur3", "ur10_limited")):
        assert set(together_) <= fit or set(together_) <= held_out
    assert 0.4 < len(fit) / len(robots.EXAMPLE_ROBOT_DATA) < 0.6
    with pytest.raises(ParameterError, match="held-out"):
        TOOL["arms"]("some")


def test_experiments_say_which_arms_they_could_not_run() -> None:
    done = TOOL["experiments"](
        Reality.geared(t_final=3.0, sample_time=[0.004]),
        ["anthropomorphic3", "no such robot"],
        {"gpi": {"type": "gpi"}},
        4,
        backend="numpy",
    )
    assert [each.index for each in done.found["gpi"]] == [
        health.first_index("anthropomorphic3") + i for i in range(2)
    ]
    assert list(done.failed) == ["no such robot"]
    table = health.markdown(done.found)
    assert "| gpi | 2 |" in table
    assert "nan" not in table


def test_what_is_said_of_a_draw_beforehand_is_torque_that_is_known_to_lack_and_what_the_law_warns_of() -> (
    None
):
    said_of = TOOL["said_of"]
    law = {"type": "gpi_auto"}
    calm = Reality.bare(0, encoder_bits=(20, 20), sample_time=[1e-3], effort_share=0.0, speed=(4.0, 4.0))
    coarse = calm.with_values(encoder_bits=(10, 10))
    assert said_of(calm.draw(ARM, 0), law) == (False, False)
    weak = calm.draw(ARM, 0)
    half = weak.model.with_limits(effort=0.5 * np.abs(weak.model.gravity(weak.q0)).max())
    assert said_of(weak._replace(model=half), law).torque
    assert said_of(coarse.draw(ARM, 0), law).controller


def test_counts_of_a_known_motor_side_are_finer_by_the_drawn_gear_ratio() -> None:
    known, unknown = (Reality("owned", seed=2, block=4, side_known=share) for share in (1.0, 0.0))
    draws = [known.draw(ARM, index) for index in range(4)]
    plain = [unknown.draw(ARM, index) for index in range(4)]
    ratio = draws[0].numbers.gear_ratio
    assert known.gear_ratio[0] <= ratio <= known.gear_ratio[1]
    turn = 2.0 * math.pi / 2.0**16
    assert draws[0].arm.encoder_count(16) == pytest.approx(turn / ratio, rel=1e-12)
    assert draws[0].model.encoder_count(16) == pytest.approx(turn / 100.0, rel=1e-12)
    assert plain[0].arm.encoder_count(16) == pytest.approx(turn, rel=1e-12)
    assert len(batches(draws)) == 1
    single, batch = draws[3].plant, stack_draws(draws).plant
    np.testing.assert_array_equal(batch.plant.step_size[3], single.plant.step_size)  # type: ignore[attr-defined]
    np.testing.assert_array_equal(plain[0].move.goal, draws[0].move.goal)  # other draws stay as they were


def test_itae_ratios_are_geometric_means_of_draws_that_the_motors_can_follow() -> None:
    one = health.Outcome("arm", 0, False, False, False, False, 0.1, 1.0, 1.0, 0.5)
    first = [one, one._replace(index=1), one._replace(index=2, demand=2.0)]
    found = [one._replace(itae=0.5), one._replace(index=1, itae=2.0), first[2]._replace(itae=9.0)]
    assert health.itae_ratios(found, first) == pytest.approx({"arm": 1.0}, rel=1e-12)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::armgpi.ArmgpiWarning")
def test_draws_run_with_the_controller_that_each_has_alone() -> None:
    """A batch has one structure: one arm that cannot have the motor-side controller takes it from nobody."""
    if "ur5" not in robots.names():
        pytest.skip("the robots extra is not installed")
    law = {"type": "gpi_auto"}
    reality = Reality("owned", seed=5, side_known=1.0)
    draws = [reality.draw(Robot.load("ur5"), index) for index in range(8)]
    factors = {}
    for group in health.alike(batches(draws), law):
        together: Any = config.controller(law, stack_draws(group).context)
        for draw in group:
            factors[draw.index] = float(np.ravel(together.link_factor)[0])
    for draw in draws:
        alone: Any = config.controller(law, stack_draws([draw]).context)
        assert factors[draw.index] == float(np.ravel(alone.link_factor)[0])
    assert set(factors.values()) == {1.0, 0.4}  # both kinds are among them


def test_the_draws_of_an_arm_follow_one_another() -> None:
    drawn = health.draws(Reality("owned", 3), "anthropomorphic3", 3)
    first = health.first_index("anthropomorphic3")
    assert [each.index for each in drawn] == [first, first + 1, first + 2]
    assert not np.array_equal(drawn[0].move.goal, drawn[1].move.goal)
