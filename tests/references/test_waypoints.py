"""Waypoints: Bezier moves and holds in a row, against an obvious twin that looks up the leg it is in."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from armgpi import Bezier, Hold, Waypoints
from armgpi.errors import ArmgpiError, ArrayError, ParameterError

Array = npt.NDArray[np.float64]

#: A plan: configurations of two joints, durations of the moves, holds at the configurations.
Plan = tuple[list[Array], list[float], list[float]]

configurations = st.tuples(*[st.floats(-3.0, 3.0)] * 2).map(np.array)


@st.composite
def plans(draw: st.DrawFn) -> Plan:
    """One to five configurations, holds that may be empty."""
    points = draw(st.lists(configurations, min_size=1, max_size=5))
    durations = [draw(st.floats(0.1, 3.0)) for _ in points[1:]]
    return points, durations, [draw(st.floats(0.0, 2.0)) for _ in points]


def twin(plan: Plan, t: float) -> tuple[Array, ...]:
    """Return q, v, a at t, leg by leg."""
    points, durations, holds = plan
    begin = holds[0]
    for leg, duration in enumerate(durations):
        if t < begin:
            break
        if t < begin + duration:
            return tuple(Bezier(points[leg], points[leg + 1], duration, begin).at(t))
        begin += duration + holds[leg + 1]
    else:
        leg = len(durations)
    return points[leg], np.zeros(2), np.zeros(2)


@given(plans(), st.lists(st.floats(-1.0, 25.0), min_size=1, max_size=20))
def test_it_is_one_move_and_hold_after_the_other(plan: Plan, times: list[float]) -> None:
    waypoints = Waypoints(*plan)
    for t in times:
        # The blend ends within 1e-13 of 1, ways are up to 6 rad long; v is up to 160, a up to 7000.
        for part, expected, size in zip(waypoints.at(t), twin(plan, t), (6.0, 160.0, 7e3), strict=True):
            np.testing.assert_allclose(part, expected, rtol=0.0, atol=2e-13 * size)


@given(plans(), st.lists(st.floats(-1.0, 25.0), min_size=1, max_size=20))
@example(
    ([np.zeros(2)] * 3 + [np.array([0.0, 1.0]), np.zeros(2)], [1.0, 1.0, 0.99999, 1.0], [0.0] * 5), [0.0]
)
def test_a_single_time_has_the_bits_of_an_array_of_times(plan: Plan, times: list[float]) -> None:
    waypoints = Waypoints(*plan)
    exactly = [*times, *(float(move.t_start) for move in waypoints.moves), waypoints.t_end]
    together = waypoints.at(np.array(exactly))
    for part in range(3):
        np.testing.assert_array_equal(together[part], [waypoints.at(t)[part] for t in exactly])


@given(plans())
def test_it_stands_at_every_posture_for_its_hold(plan: Plan) -> None:
    points, durations, holds = plan
    waypoints = Waypoints(points, durations, holds)
    arrival = 0.0
    for i, point in enumerate(points):
        for t in (arrival, arrival + 0.5 * holds[i], arrival + holds[i]):
            # The blend ends within 1e-13 of 1 (see its own test), ways are up to 6 rad long.
            np.testing.assert_allclose(waypoints.at(t).q, point, rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(waypoints.at(t).v, 0.0, atol=1e-9)  # t is rounded, so almost there
        arrival += holds[i] + (durations[i] if i < len(durations) else 0.0)
    assert waypoints.t_end == pytest.approx(arrival)


@given(plans())
def test_position_velocity_and_acceleration_are_continuous(plan: Plan) -> None:
    points, durations, holds = plan
    waypoints = Waypoints(points, durations, holds)
    t = np.linspace(-0.1, waypoints.t_end + 0.1, 2001)
    dt = t[1] - t[0]
    if durations:
        # Over a step nothing changes by more than its derivative's peak allows: 2.602, 11.06, 110 D / T^k.
        reach = max(np.abs(b - a).max() for a, b in pairwise(points))
        T = min(durations)
        for part, peak in zip(waypoints.at(t), (2.7 / T, 11.1 / T**2, 111.0 / T**3), strict=True):
            assert np.abs(np.diff(part, axis=0)).max() <= peak * reach * dt + 1e-9


def test_one_number_stands_for_every_move_and_hold() -> None:
    points = [[0.0], [1.0], [-1.0]]
    assert Waypoints(points, 2.0, 0.5).t_end == pytest.approx(3 * 0.5 + 2 * 2.0)
    assert Waypoints(points, np.int64(2), np.float64(0.5)).t_end == pytest.approx(5.5)
    assert Waypoints(np.array(points), [1.0, 2.0]).t_end == pytest.approx(3.0)


def test_without_durations_the_moves_are_as_short_as_the_limits_allow() -> None:
    limits = {"velocity_limit": [1.0, 2.0], "acceleration_limit": 4.0}
    points = [[0.0, 0.0], [1.0, 0.5], [1.0, -2.0]]
    waypoints = Waypoints(points, **limits)
    alone = [Bezier(a, b, **limits).duration for a, b in pairwise(points)]
    assert [move.duration for move in waypoints.moves] == alone
    target = waypoints.at(np.linspace(0.0, waypoints.t_end, 20_001))
    assert (np.abs(target.v) <= np.array([1.0, 2.0]) * (1.0 + 1e-9)).all()
    assert np.abs(target.a).max() <= 4.0 * (1.0 + 1e-9)


@pytest.mark.parametrize("shapes", [[(2,)] * 3, [(4, 2)] * 3, [(2,), (2,), (4, 2)], [(4, 2), (2,), (2,)]])
def test_times_come_before_rollouts_and_joints(shapes: list[tuple[int, ...]]) -> None:
    points = [np.random.default_rng(i).normal(size=shape) for i, shape in enumerate(shapes)]
    waypoints = Waypoints(points, durations=1.0, holds=0.25)
    times = np.linspace(-0.5, 4.0, 10)
    shape = np.broadcast_shapes(*shapes)
    assert {np.shape(part) for part in waypoints.at(0.7)} == {shape}
    together = waypoints.at(times)
    for part in range(3):
        assert together[part].shape == (10, *shape)
        np.testing.assert_array_equal(together[part], [waypoints.at(float(t))[part] for t in times])


def test_rollouts_of_a_batch_go_their_own_ways() -> None:
    points = np.random.default_rng(0).normal(size=(3, 4, 2))
    together = Waypoints(points, durations=[1.0, 2.0], holds=0.5)
    times = np.linspace(0.0, 5.0, 23)
    for row in range(4):
        alone = Waypoints(points[:, row], durations=[1.0, 2.0], holds=0.5)
        np.testing.assert_array_equal(np.array(together.at(times))[:, :, row], alone.at(times))


@pytest.mark.parametrize("q", [[0.3, -0.2], [[0.3, -0.2], [1.0, 2.0]]])
def test_a_hold_is_a_single_posture_forever(q: Any) -> None:
    for reference in (Hold(q), Waypoints([q])):
        np.testing.assert_array_equal(reference.at(7.0), [q, np.zeros_like(q), np.zeros_like(q)])
        assert reference.at(np.zeros(5)).q.shape == (5, *np.shape(q))


@pytest.mark.parametrize(
    ("arguments", "error", "named"),
    [
        ({"points": []}, ParameterError, "points"),
        ({"durations": [1.0]}, ParameterError, "durations"),
        ({"durations": [1.0, 2.0, 3.0]}, ParameterError, "durations"),
        ({"durations": 0.0}, ParameterError, "duration"),
        ({"durations": [1.0, -1.0]}, ParameterError, "duration"),
        ({"durations": [1.0, None]}, ArmgpiError, "duration"),
        ({"durations": None}, ParameterError, "duration"),
        ({"holds": [1.0]}, ParameterError, "holds"),
        ({"holds": -0.5}, ParameterError, "holds"),
        ({"holds": [0.0, math.nan, 0.0]}, ParameterError, "holds"),
        ({"holds": "long"}, ParameterError, "holds"),
        ({"points": [[0.0], [1.0], [1.0, 2.0]]}, ArrayError, "goal|points"),
        ({"points": [[0.0], [math.nan], [1.0]]}, ArrayError, "goal|points"),
        ({"points": [[[0.0]] * 2, [1.0], [[1.0]] * 3]}, ArrayError, "goal|points"),
    ],
)
def test_a_bad_argument_is_named(arguments: dict[str, Any], error: type[ArmgpiError], named: str) -> None:
    with pytest.raises(error, match=named):
        Waypoints(**{"points": [[0.0], [1.0], [2.0]], "durations": 1.0, **arguments})
