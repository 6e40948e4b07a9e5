"""A search: what is free, wanted and proposed, and that a stopped one ends as one that never stopped."""

from __future__ import annotations

import csv
import math
import sys
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.colors import to_hex

from armgpi import ArmgpiWarning, Reality, Robot, config, metrics, simulate
from armgpi.base.parameter import Parameter
from armgpi.config.schema import KINDS
from armgpi.errors import MissingPackage, NameNotFound, ParameterError, RolloutError
from armgpi.plants.reality import stack_draws
from armgpi.studies import contend, found, pictures
from armgpi.studies import space as spaces
from armgpi.studies.evaluation import Evaluated, Evaluator, by_rollout, with_keys
from armgpi.studies.objective import Constraint, Expression, Judged, Objective
from armgpi.studies.optimise import KEPT, Problem, Row, Search, Validated
from armgpi.studies.optimisers import CMA, METHODS, Swarm
from armgpi.studies.space import Dimension, Range, Space, _begin, _ends, numbers
from armgpi.studies.study import Identity, Study

ARM = Robot.load("anthropomorphic3")
REALITY = Reality.geared(
    sample_time=[1e-3], delay=(1.0, 1.0), payload=(0.0, 0.02), duration=(0.15, 0.3), t_final=0.6
)
DRAWS = [REALITY.draw(ARM, index) for index in range(3)]
places = st.floats(0.0, 1.0)


def space(section: dict[str, Any], free: Mapping[str, Range] | None = None) -> Space:
    return Space(section, config.controller(section, DRAWS[0].context), free)


# What is free.


def test_a_section_keeps_its_values_at_the_start() -> None:
    section = {"type": "gpi", "omega": [20.0, 25.0, 30.0], "zeta": 0.8, "p": 15.0}
    free = {"omega": Range(per_joint=True), "zeta": Range(), "p": Range()}
    again = space(section, free).with_values(space(section, free).start)
    np.testing.assert_allclose(again["omega"], section["omega"])
    assert again["zeta"] == pytest.approx(0.8)
    assert again["p"] == pytest.approx(15.0)


@given(st.lists(places, min_size=2, max_size=2))
def test_a_box_has_its_lower_end_below_its_upper_one(x: list[float]) -> None:
    made = space({"type": "network", "omega": {"lower": 20.0, "upper": 60.0}}, {"omega": Range(5.0, 100.0)})
    box = made.with_values(np.array(x))["omega"]
    assert 5.0 * (1 - 1e-12) <= box["lower"] <= box["upper"] <= 100.0 * (1 + 1e-12)


def test_a_number_that_nothing_tells_begins_in_the_middle_and_one_dimension_is_searched_too() -> None:
    robot: Any = SimpleNamespace(robot=SimpleNamespace(n=3))
    by_factors = Parameter("x", least=0.0, log=True)
    assert _begin(Parameter("x"), None, 2.0, 8.0, robot) == 5.0
    assert _begin(by_factors, None, 2.0, 8.0, robot) == 4.0
    with pytest.raises(ParameterError, match="varied by factors"):
        _ends("x", by_factors, Range(0.0, 1.0), None)
    search = CMA(np.array([0.3]), seed=1, population=4)
    search.ask()
    search.tell(np.arange(4.0))
    search.inject(np.array([0.7]))
    assert search.ask().shape == (4, 1)


def test_a_search_keeps_its_whole_file_and_tells_the_default_as_its_first_candidate(tmp_path: Path) -> None:
    wanted: Any = SimpleNamespace(
        identity=Identity({"a": 1}, text="robot: ur5\n"), tune=SimpleNamespace(plain=lambda: {"budget": 3})
    )
    found.enter(tmp_path / "study", wanted, resume=False)
    assert (tmp_path / "study" / found.STUDY).read_text().endswith("robot: ur5\ntune:\n  budget: 3\n")
    rows: list[Any] = [
        SimpleNamespace(_asdict=lambda k=k: {"number": k}, x=np.full(2, float(k))) for k in range(3)
    ]
    told = found.as_data(cast(Any, SimpleNamespace(rows=rows)), [], rows[2])
    assert told["default"]["searched"] == {"number": 0, "x": [0.0, 0.0]}
    assert (told["default"]["held_out"]["number"], told["candidates"]) == (2, 3)


def test_a_contest_has_the_draws_from_its_first_one_on() -> None:
    one = [np.concatenate(draw.move[:2]) for draw in contend.draws(ARM, 3, first=5)]
    np.testing.assert_array_equal(
        one[1:], [np.concatenate(draw.move[:2]) for draw in contend.draws(ARM, 2, first=6)]
    )


@pytest.mark.parametrize("per_joint", [False, True])
def test_weights_are_numbers_to_search(per_joint: bool) -> None:
    made = space({"type": "network"}, {"weights.omega": Range(per_joint=per_joint)})
    assert len(made.names) == (12 if per_joint else 4)
    section = made.with_values(np.linspace(0.0, 1.0, len(made.names)))
    table = np.array(section["weights"]["omega"])
    assert table.shape == ((3, 4) if per_joint else (4,))
    np.testing.assert_allclose(table.ravel(), np.linspace(-40.0, 40.0, table.size))
    config.controller(section, DRAWS[0].context)


def test_numbers_are_called_by_key_end_place_and_joint_and_begin_at_the_mean_of_what_they_stand_for() -> None:
    section: dict[str, Any] = {
        "type": "network",
        "zeta": [0.7, 0.9, 1.4],
        "omega": {"lower": [5.0, 20.0, 40.0], "upper": 50.0},
        "weights": {"omega": [[1.0, -2.0, 3.0, 90.0], [5.0, 0.0, 1.0, 2.0], [0.0, 8.0, -90.0, 4.0]]},
    }
    table = np.clip(section["weights"]["omega"], -40.0, 40.0)
    made = space(section, dict.fromkeys(("zeta", "omega", "weights.omega"), Range()))
    assert made.names == ["zeta", "omega.lower", "omega.upper", *(f"weights.omega.{k}" for k in (1, 2, 3, 4))]
    wanted = [np.prod([0.7, 0.9, 1.4]) ** (1 / 3), 4000.0 ** (1 / 3), 50.0, *table.mean(axis=0)]
    np.testing.assert_allclose([each.start for each in made.dimensions], wanted)
    own = space(section, dict.fromkeys(("zeta", "weights.omega"), Range(per_joint=True)))
    assert own.names[:4] == [*(f"zeta {name}" for name in ARM.joint_names), "weights.omega.1 q1"]
    np.testing.assert_allclose([each.start for each in own.dimensions], [0.7, 0.9, 1.4, *table.ravel()])
    np.testing.assert_allclose(own.with_values(own.start)["weights"]["omega"], table)


@pytest.mark.parametrize("name", sorted(KINDS))
def test_whatever_is_free_makes_a_controller(name: str) -> None:
    random = np.random.default_rng(1)
    made = space({"type": name})
    assert made.dimensions
    for x in (np.zeros(len(made.names)), np.ones(len(made.names)), random.uniform(size=len(made.names))):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ArmgpiWarning)  # of loops too fast for their delay
            config.controller(made.with_values(x), DRAWS[0].context)


@pytest.mark.parametrize(
    ("free", "error", "named"),
    [
        ({"omega": Range(low=-1.0)}, ParameterError, "positive"),
        ({"omega": Range(low=50.0, high=20.0)}, ParameterError, "lowest"),
        ({"omega": Range(low=20.0, high=20.0)}, ParameterError, "lowest"),
        ({"omgea": Range()}, NameNotFound, "omega"),
        ({"realisation": Range()}, NameNotFound, "realisation"),
        ({}, ParameterError, "omega"),
    ],
)
def test_what_cannot_be_searched_is_named(free: Any, error: type[Exception], named: str) -> None:
    with pytest.raises(error, match=named):
        space({"type": "gpi"}, free)


def test_what_has_no_effect_is_not_free_by_default() -> None:
    assert "rolloff_ratio" not in space({"type": "gpi"}).names
    assert "rolloff_ratio" in space({"type": "gpi", "rolloff": 1}).names
    assert "link_factor" not in space({"type": "gpi"}).names
    known = numbers(config.controller({"type": "gpi"}, DRAWS[0].context))
    assert {"second_ratio", "second_zeta", "link_factor", "rotor_factor"} <= set(known)


# What is wanted.

positive = st.floats(1e-3, 1e3)


@given(positive, positive)
def test_an_expression_is_its_arithmetic(a: float, b: float) -> None:
    values = {"itae": np.array([[a]]), "total_variation": np.array([[b]])}
    text = "itae + 0.5*variation - max(itae, 2)/sqrt(total_variation)**2"
    assert Expression(text)(values)[0, 0] == pytest.approx(a + 0.5 * b - max(a, 2.0) / math.sqrt(b) ** 2)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("itae + chatter", NameNotFound),
        ("__import__('os')", ParameterError),
        ("itae.real", ParameterError),
        ("itae if itae else 1", ParameterError),
        ("itae +", ParameterError),
        ("max(itae)", ParameterError),
        ("itae + 1" + 400 * "0", ParameterError),
        ("itae + 1e300", ParameterError),
        ("itae + " + "1" * 494, ParameterError),
        ("(" * 600 + "itae" + ")" * 600, ParameterError),
        (3.0, ParameterError),
    ],
)
def test_what_is_no_arithmetic_on_metrics_is_refused(text: Any, error: type[Exception]) -> None:
    with pytest.raises(error):
        Expression(text)


def test_the_longest_expression_is_one_of_500_characters() -> None:
    assert Expression("itae" + 492 * " " + "+  2")({"itae": np.ones(1)}) == 3.0


@pytest.mark.parametrize("text", ["itae + 1/0", "9.0**9999 * itae", "0**(0 - 1) + itae", "itae * (-8)**0.5"])
def test_arithmetic_without_a_value_is_no_exception_and_no_value(text: str) -> None:
    assert not np.isfinite(Expression(text)({"itae": np.ones((1, 1))})).any()


@pytest.mark.parametrize("text", ["itae", "itae == 1", "1 < itae < 2", "itae <= sum(1)", None])
def test_what_is_no_bound_is_refused(text: Any) -> None:
    with pytest.raises(ParameterError):
        Constraint(text)


def test_objectives_over_scenarios_are_means_and_tails() -> None:
    each = np.array([[4.0, 1.0, 3.0, 2.0]])
    found = {
        over: Objective("itae", over, 0.5).judge({"itae": each}, each > 9.0).objective[0]
        for over in ("mean", "median", "worst", "cvar")
    }
    assert found == {"mean": 2.5, "median": 2.5, "worst": 4.0, "cvar": 3.5}
    # Of 30 scenarios a tenth are 3, though 0.1 * 30 is a little more by its rounding; of 31 they are 4.
    for scenarios, worst in ((30, 3), (31, 4)):
        rows = np.arange(1.0, scenarios + 1.0)[None]
        judged = Objective("itae", "cvar", 0.1).judge({"itae": rows}, rows < 0.0)
        assert judged.objective[0] == rows[0, -worst:].mean()


def test_candidates_rank_by_failures_then_by_what_they_break_then_by_their_objective() -> None:
    objective = Objective("itae", constraints=["peak_error <= 0.1"])
    values = {
        "itae": np.array([[9.0, 9.0], [1.0, 1.0], [1.0, 1.0], [0.1, np.inf], [np.nan, 1.0], [2.0, 2.0]]),
        "peak_error": np.array([[0.1, 0.1], [0.2, 0.1], [0.9, 0.9], [0.1, np.inf], [0.1, 0.1], [0.1, 0.0]]),
    }
    judged = objective.judge(values, np.isinf(values["itae"]))
    order = np.argsort(judged.scores(), kind="stable")
    assert order[:4].tolist() == [5, 0, 1, 2]
    assert judged.feasible.tolist() == [True, False, False, False, False, True]
    assert np.isfinite(judged.scores()).all()


def test_what_breaks_a_bound_or_a_budget_costs_by_how_much_of_it_that_is() -> None:
    for text in ("peak_error <= 0.1", "0.1 >= peak_error"):
        broken = Constraint(text).violation({"peak_error": np.array([[0.15, 0.05, np.nan]])})
        np.testing.assert_allclose(broken, [[0.5, 0.0, np.inf]])
    both = dict.fromkeys(("itae", "peak_error"), np.array([np.inf, 2.0]))
    assert Constraint("itae <= peak_error").violation(both).tolist() == [0.0, 0.0]
    judged = Judged(np.array([2.0, 3.0, np.inf, 4.0]), np.array([0, 0, 0.25, 0]), np.array([0, 0.5, 0, 0]))
    scores = judged.scores(np.array([0.0, 0.0, 0.0, 0.75]))
    np.testing.assert_allclose(scores, [2.0, 1.5e12, 251e12, 1.75e12])
    rows = [Row(0, 0, np.zeros(2), 5.0, 0.0, 0.0, {"total_variation": x}) for x in (100.0, 150.0)]
    np.testing.assert_allclose(Search(problem())._scores(rows, 100.0), [5.0, 1.5e12])


@pytest.mark.parametrize("log", [True, False])
def test_a_number_is_at_its_place_between_its_ends(log: bool) -> None:
    number = Dimension("omega", "", None, None, 2.0, 18.0, log, 3.0)
    assert [number.value(x) for x in (-1.0, 0.0, 0.5, 1.0, 2.0)] == pytest.approx(
        [2.0, 2.0, 6.0 if log else 10.0, 18.0, 18.0]
    )
    assert [number.place(x) for x in (1.0, 2.0, 6.0 if log else 10.0, 18.0, 99.0)] == pytest.approx(
        [0.0, 0.0, 0.5, 1.0, 1.0]
    )


# What proposes.


def test_a_swarm_is_drawn_to_its_own_best_places_and_that_of_all() -> None:
    swarm, rng = Swarm(np.array([0.9, 0.1]), seed=6, population=3), np.random.default_rng(6)
    x = rng.uniform(size=(3, 2))
    x[0] = 0.9, 0.1
    v = 0.25 * (rng.uniform(size=(3, 2)) - x)
    best, least = x.copy(), np.full(3, np.inf)
    for _turn in range(6):
        np.testing.assert_allclose(swarm.ask(), x)
        scores = np.ceil(4.0 * ((x - [0.3, 1.2]) ** 2).sum(axis=1))  # of as good places the first one stays
        swarm.tell(scores)
        for i in range(3):
            if scores[i] < least[i]:
                best[i], least[i] = x[i], scores[i]
        own, common = rng.uniform(size=(2, 3, 2))
        for i, j in np.ndindex(3, 2):
            pull = own[i, j] * (best[i, j] - x[i, j]) + common[i, j] * (best[least.argmin(), j] - x[i, j])
            v[i, j] = 0.7298 * v[i, j] + 1.49618 * pull
            x[i, j] += v[i, j]
            if not 0.0 <= x[i, j] <= 1.0:  # back from the wall at half the speed
                x[i, j], v[i, j] = np.clip(x[i, j], 0.0, 1.0), -0.5 * v[i, j]
    assert [len(METHODS[name](np.full(3, 0.5), 0).ask()) for name in ("pso", "cma")] == [13, 7]
    swarm.inject(np.array([0.5, 0.5]))
    assert swarm._x[least.argmax()].tolist() == [0.5, 0.5]


@pytest.mark.parametrize("method", ["cma", "pso"])
def test_a_search_finds_the_least_of_a_bowl_and_leaves_other_generators_alone(method: str) -> None:
    aim = np.array([0.2, 0.7, 0.5])
    np.random.seed(3)  # noqa: NPY002 (the global generator is what must not change)
    state: Any = np.random.get_state
    before = state()[1].copy()
    searches = [METHODS[method](np.full(3, 0.9), seed=1) for _ in range(2)]
    for _ in range(60):
        x, again = (search.ask() for search in searches)
        np.testing.assert_array_equal(x, again)
        assert ((x >= 0.0) & (x <= 1.0)).all()
        for search in searches:
            search.tell(((x - aim) ** 2).sum(axis=1))
    np.testing.assert_allclose(x[np.argmin(((x - aim) ** 2).sum(axis=1))], aim, atol=1e-2)
    np.testing.assert_array_equal(state()[1], before)


def test_optuna_begins_where_it_is_told_and_comes_near_the_least() -> None:
    pytest.importorskip("optuna")
    aim, start = np.array([0.2, 0.7]), np.full(2, 0.9)
    state: Any = np.random.get_state
    before = state()[1].copy()
    searches = [METHODS["optuna"](start, seed=2**40 + 1, population=8) for _ in range(2)]
    best = math.inf
    for generation in range(10):
        x, again = (search.ask() for search in searches)
        np.testing.assert_array_equal(x, again)
        assert ((x >= 0.0) & (x <= 1.0)).all()
        if not generation:
            np.testing.assert_array_equal(x[0], start)
            assert len(METHODS["optuna"](start, seed=0).ask()) == 12
        scores = ((x - aim) ** 2).sum(axis=1)
        best = min(best, float(scores.min()))
        for search in searches:
            search.tell(np.where(x[:, 0] > 0.95, math.nan, scores))
    assert best < 0.01  # 80 uniform draws come within this with 0.92, of which the mean best is 0.004
    np.testing.assert_array_equal(state()[1], before)


def test_an_optimiser_takes_one_number_and_converges_more_than_once() -> None:
    search = METHODS["cma"](np.array([0.5]), seed=0)
    sizes = set()
    for _ in range(300):
        x = search.ask()
        sizes.add(len(x))
        assert x.shape[1:] == (1,)
        search.tell(np.where(x[:, 0] > 0.9, math.nan, abs(x[:, 0] - 0.25)))
    assert len(sizes) > 1


@pytest.mark.parametrize(("method", "library"), [("cma", "cma"), ("optuna", "optuna")])
def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch, method: str, library: str) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(MissingPackage, match=f"pip install {library}"):
        METHODS[method](np.array([0.5]), seed=0)


# What a study does, on rollouts that cost nothing.


class Bowl:
    """Scenarios in which error and torque variation are known: faster is better, and costs."""

    def __init__(self, fragile: bool = False) -> None:
        self.draws = DRAWS
        self.fragile = fragile

    def __call__(self, section: Any, candidates: Sequence[Mapping[str, Any]]) -> Evaluated:
        omega = np.array([[float(each["omega"])] * 3 for each in candidates])
        zeta = np.array([[float(each["zeta"])] * 3 for each in candidates])
        itae = 10.0 / omega + (zeta - 0.8) ** 2 + np.array([0.0, 0.1, 0.2])
        failed = (omega > 100.0) if self.fragile else np.zeros(omega.shape, dtype=bool)
        values = {"itae": itae, "total_variation": omega**2, "peak_error": itae}
        return Evaluated({name: np.where(failed, np.inf, x) for name, x in values.items()}, failed)


def problem(**options: Any) -> Problem:
    made = space({"type": "gpi", "omega": 20.0}, {"omega": Range(5.0, 200.0), "zeta": Range()})
    bowls: Any = (Bowl(), Bowl(fragile=True))
    return Problem(made, Objective("itae"), *bowls, **{"evaluations": 120, "seed": 4, **options})


def test_a_candidate_that_fails_where_nobody_looked_is_never_the_best() -> None:
    search = Search(problem())
    search.run()
    assert search.problem.space.values(search.rank()[0].x)[0] > 100.0
    found = search.validate()
    assert all(search.problem.space.values(each.row.x)[0] <= 100.0 for each in found)


def test_the_best_is_the_first_that_holds_where_nobody_looked() -> None:
    search = Search(problem())
    omega, zeta = search.problem.space.dimensions
    places = np.array([[omega.place(x), zeta.place(0.8)] for x in (150.0, 120.0, 90.0, 80.0)])
    search.rows = search.judge(search.problem.search, places)
    (found,) = search.validate()
    assert found.row is search.rows[2]
    np.testing.assert_array_equal(found.held_out.x, found.row.x)
    assert found.held_out.objective == pytest.approx(10.0 / 90.0 + 0.1)


def assert_same(ours: Search, others: Search) -> None:
    for one, other in zip(ours.rows, others.rows, strict=True):
        np.testing.assert_array_equal(one.x, other.x)
        assert one._replace(x=other.x) == other


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("budgets", [(math.inf,), (400.0, 2500.0)])
def test_a_search_that_was_stopped_ends_as_one_that_was_not(
    method: str, budgets: Any, tmp_path: Path
) -> None:
    count = 40 if method == "optuna" else 120  # which takes 5 ms a candidate
    whole = Search(problem(method=method, budgets=budgets, evaluations=count))
    whole.run()
    last = whole.rows[-1].generation
    study, told = Study.enter(tmp_path, Identity({}, {})), list[int]()
    for stop in (0, 1, last // 2, last):
        for generation in range(stop + 1, last + 1):
            study.place(f"generations/{generation:06d}").unlink(missing_ok=True)
        told.clear()
        again = Search(problem(method=method, budgets=budgets, evaluations=count))
        again.run(lambda search: told.append(search.rows[-1].generation), study.part)
        assert_same(again, whole)
        assert told == [*range(stop + 1 if stop else 0, last + 1)]  # those that were kept are not told
        assert again.fresh == sum(row.generation > stop or stop == 0 for row in whole.rows)


def test_budgets_are_kept_and_a_larger_one_is_never_worse() -> None:
    search = Search(problem(budgets=(400.0, 2500.0, 8000.0), evaluations=300))
    search.run()
    found = search.validate()
    assert [each.budget for each in found] == [400.0, 2500.0, 8000.0]
    assert all(each.row.means["total_variation"] <= each.budget for each in found)
    errors = [each.row.objective for each in found]
    assert errors == sorted(errors, reverse=True)
    # The least error at a budget is known: omega is its root.
    np.testing.assert_allclose(errors, 10.0 / np.sqrt([400.0, 2500.0, 8000.0]) + 0.1, rtol=0.05)


def test_what_another_search_kept_is_refused(tmp_path: Path) -> None:
    study = Study.enter(tmp_path, Identity({}, {}))
    Search(problem()).run(part=study.part)
    with pytest.raises(RolloutError, match="not those of this search"):
        Search(problem(seed=5)).run(part=study.part)
    place = study.place("generations/000001")
    whole = place.read_bytes()
    flipped = whole[:-1] + bytes([whole[-1] ^ 1])
    for damaged in (b"", whole[:-8], whole + bytes(8), flipped, whole.replace(b"000001", b"000002")):
        place.write_bytes(damaged)
        with pytest.raises(RolloutError, match="is damaged"):
            Search(problem()).run(part=study.part)


def test_an_objective_without_a_value_anywhere_is_named() -> None:
    hopeless = problem(population=13)._replace(objective=Objective("sqrt(-itae)"))
    for evaluations, tried in ((120, 40), (9, 14), (14, 14)):
        with pytest.raises(ParameterError, match=rf"none of {tried} candidates .*sqrt"):
            Search(hopeless._replace(evaluations=evaluations)).run()


# What is told of it.


def search_with_rows(budgets: tuple[float, ...], *more: tuple[float, float, float, float]) -> Search:
    """Return a search with candidates of these objectives, variations, failures and violations."""
    search = Search(problem(budgets=budgets))
    rows = [(5.0, 300.0, 0.0, 0.0), (3.0, 400.0, 0.0, 0.0), (3.0, 900.0, 0.0, 0.0), (2.0, 2500.0, 0.0, 0.0)]
    rows += ((1.0, 350.0, 0.0, 0.2), (math.inf, 200.0, 0.25, 0.0), (4.0, 400.0, 0.0, 0.0), *more)
    search.rows = [
        Row(
            min(k, 1),
            k % 2,
            np.array([k / 10.0, 1.0 - k / 10.0]),
            a,
            c,
            d,
            {**dict.fromkeys(KEPT, a), "total_variation": b},
        )
        for k, (a, b, c, d) in enumerate(rows)
    ]
    return search


def test_tables_of_a_search_are_what_its_rows_say() -> None:
    search = search_with_rows((400.0, 2500.0, 250.0))
    rows, space = search.rows, search.problem.space
    own = [Validated(400.0, rows[1], rows[2]), Validated(2500.0, rows[3], rows[0])]
    tables = (found.front_table(search, own), found.gains_table(search, own), found.evaluations_table(search))
    front, gains, tried = ([*csv.DictReader(text.splitlines())] for text in tables)
    # Of those that are sound: whom nobody equals in one cost and beats in the other.
    costs = [(row.objective, row.means["total_variation"]) for row in rows if row.sound]
    unbeaten = [a for a in costs if not any(b != a and b[0] <= a[0] and b[1] <= a[1] for b in costs)]
    assert [(float(x["objective"]), float(x["total_variation"])) for x in front] == unbeaten
    assert [x["held_out_objective"] for x in front] == ["", "3.0", "5.0"]
    assert [x["held_out_total_variation"] for x in front] == ["", "900.0", "300.0"]
    for k, number in enumerate(space.dimensions):
        wanted = [
            number.start,
            number.value(rows[1].x[k]),
            number.value(rows[3].x[k]),
            number.low,
            number.high,
        ]
        assert [
            float(gains[k][x]) for x in ("default", "best-400", "best-2500", "low", "high")
        ] == pytest.approx(wanted)
    for k, (row, line) in enumerate(zip(rows, tried, strict=True), start=1):
        for budget in search.problem.budgets:
            kept = [x.objective for x in rows[:k] if x.sound and x.means["total_variation"] <= budget]
            assert float(line[f"best-{budget:g}"]) == min(kept, default=math.inf)
        assert [float(line[f"x {name}"]) for name in space.names] == pytest.approx(row.x)
        assert (int(line["search"]), float(line["failed"])) == (row.search, row.failed)
    assert [row.objective for row in search.rank(400.0)] == [3.0, 4.0, 5.0]  # the budget itself is kept
    text = found.report(search, own, rows[2])
    assert "| default | 5 | 300 | 3 | 900 |" in text
    assert "| best, variation up to 400 N m | 3 | 400 | 3 | 900 |" in text
    assert text.endswith("\nFor 1 of the budgets no candidate holds.\n")
    assert "no candidate" not in found.report(search, [*own, own[0]], rows[2])
    assert "| best | 1 (breaks a constraint) | 350 | fails in 25 % | 200 |" in found.report(
        search_with_rows((math.inf,)), [Validated(math.inf, rows[4], rows[5])], rows[0]
    )
    assert "holds on the held-out" in found.report(search_with_rows((math.inf,)), [], rows[0])


def test_a_picture_of_a_search_shows_its_rows_each_kind_in_a_colour_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(pictures, "png", drawn.append)
    search = search_with_rows((400.0, 2500.0))
    own = [
        Validated(400.0, search.rows[1], search.rows[2]),
        Validated(2500.0, search.rows[3], search.rows[0]),
    ]
    for each, taken in ((search, own), (search_with_rows((math.inf,), (0.0, 3000.0, 0.0, 0.0)), own[:1])):
        pictures.study_picture(each, taken, search.rows[6])
    (left, middle, right), (one, other, _) = (figure.axes for figure in drawn)
    for line, best in zip(left.lines, found.convergence(search), strict=True):
        np.testing.assert_array_equal(line.get_xdata(), np.arange(1, 8))
        np.testing.assert_array_equal(line.get_ydata(), np.where(np.isinf(best), np.nan, best))
    assert left.get_legend() is not None
    assert one.get_legend() is None
    assert (middle.get_yscale(), other.get_yscale(), other.get_xscale()) == ("log", "linear", "log")
    ends = {each.get_label(): each.get_offsets().tolist() for each in middle.collections}
    assert ends["best, held out"] == [[900.0, 3.0], [300.0, 5.0]]
    assert ends["default, held out"] == [[400.0, 4.0]]
    assert middle.lines[0].get_xydata().tolist() == [[300.0, 5.0], [400.0, 3.0], [2500.0, 2.0]]
    colours = [to_hex(each.get_facecolor()[0]) for each in middle.collections]
    assert len({*colours, to_hex(middle.lines[0].get_color())}) == 4
    assert to_hex(right.collections[0].get_facecolor()[0]) == colours[2]


def test_tables_of_a_contest_have_medians_classes_and_the_best_of_each(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    inertia = "positions only, uses the inertia matrix"
    whole = "positions only, uses model feedforward (D, C, G)"
    given: list[tuple[str, str, list[float] | None, list[list[float]]]] = [
        ("super-twisting", whole, None, [[math.inf, 4.0, 2.0, 2.0, 2.0, 2.0]]),
        (
            "ADRC, order 3",
            inertia,
            [3.0, 200.0],
            [[1.1, 4.0, 3.0, 2.0, 1.0, 1.0], [1.1, math.inf, 9.0, 2.0, 1.0, 3.0]],
        ),
        ("GPI, printed controller", inertia, [7.0, 50.0], [[1.0, 3.0, 4.0, math.inf, 2.0, math.inf]]),
    ]
    names = contend.budgets_of("anthropomorphic3")
    entries = [
        contend.Entry(
            "anthropomorphic3",
            law,
            known,
            seed,
            untuned,
            {x: {"held_out": y} for x, y in zip(names, row, strict=True) if y < math.inf},
        )
        for law, known, untuned, rows in given
        for seed, row in enumerate(rows)
    ]
    table = [[x.strip() for x in line.split("|")[1:-1]] for line in contend.markdown(entries).splitlines()]
    assert table[0] == [
        "anthropomorphic3: controller (numbers), variation up to [N m]",
        *names,
        "default (variation)",
    ]
    assert {len(line) for line in table} == {8}
    assert table[2:] == [
        [f"*{whole}*", *[""] * 7],
        ["super-twisting (4)", "-", *["**4**", *["**2**"] * 4], "-"],
        [f"*{inertia}*", *[""] * 7],
        ["GPI, printed controller (3)", "**1**", "**3**", "**4**", "-", "2", "-", "7 (50)"],
        ["ADRC, order 3 (2)", "**1.1**", "-", "6", "**2**", "**1**", "**2**", "3 (200)"],
    ]
    assert (
        contend.verdict(entries).splitlines()[0]
        == "| class | arm | " + " | ".join(f"budget {k}" for k in range(1, 7)) + " |"
    )
    ratios = ["0.91", "GPI alone", "0.67", "others alone", "2.00", "others alone"]
    assert contend.verdict(entries).splitlines()[2:] == [
        "| " + " | ".join([inertia, "anthropomorphic3", *ratios]) + " |"
    ]
    drawn: list[Any] = []
    monkeypatch.setattr(pictures, "png", drawn.append)
    pictures.contest_picture(entries)
    (panel,) = drawn[0].axes  # the class of a single law has none
    assert panel.get_title() == "anthropomorphic3: uses the inertia matrix"
    curves = {line.get_label(): line.get_ydata() for line in panel.lines}
    np.testing.assert_array_equal(curves["ADRC, order 3"], [1.1, np.nan, 6.0, 2.0, 1.0, 2.0])
    np.testing.assert_array_equal(curves["GPI, printed controller"], [1.0, 3.0, 4.0, np.nan, 2.0, np.nan])
    for least, first in ((3.0, 150.0), (2.99, 9.375)):  # the budgets of a small arm are a sixteenth
        monkeypatch.setattr(contend, "scales", lambda _, x=least: SimpleNamespace(gravity=np.array([1.0, x])))
        assert contend.budgets(ARM)[0] == first


# What candidates are, on real rollouts.


@pytest.mark.parametrize("each", [False, True])
def test_values_of_candidates_stand_once_for_each_scenario(each: bool) -> None:
    rng = np.random.default_rng(0)
    table = rng.normal(size=(3, 3, 4) if each else (3, 4))
    candidates = [
        {
            "omega": {"lower": [1.0 + k, 2.0, 3.0], "upper": [9.0, 8.0, 7.0 + k]},
            "leak": 0.5 * k,
            "weights.omega": table[k].tolist(),
        }
        for k in range(3)
    ]
    kinds = {"omega": "box", "leak": "number", "weights.omega": "table"}
    known = {
        f"controller.{key}": SimpleNamespace(declared=SimpleNamespace(kind=x)) for key, x in kinds.items()
    }
    loop: Any = SimpleNamespace(loop=SimpleNamespace(plant=SimpleNamespace(robot=ARM)), parameters=known)
    given = by_rollout(candidates, 2, loop)
    for row in range(6):  # two scenarios of the first candidate, then of the second
        own = candidates[row // 2]
        np.testing.assert_array_equal(
            [end[row] for end in given["controller.omega"]], [*own["omega"].values()]
        )
        assert given["controller.leak"][row] == own["leak"]
        whole = np.broadcast_to(own["weights.omega"], (3, 4))
        np.testing.assert_array_equal(given["controller.weights.omega"][row], whole)


def test_a_generation_is_its_candidates_one_by_one() -> None:
    section = {"type": "network", "rolloff": 1}
    candidates: list[dict[str, Any]] = [
        {
            "omega": {"lower": low, "upper": 50.0},
            "zeta": [0.8, 0.9, low / 25.0],
            "leak": low,
            "weights.omega": [w] * 4,
        }
        for low, w in ((20.0, 0.0), (25.0, 5.0))
    ]
    found = Evaluator(DRAWS, ["itae", "total_variation"], "numpy")(section, candidates)
    for row, candidate in enumerate(candidates):
        for column, draw in enumerate(DRAWS):
            alone = stack_draws([draw])
            law = config.controller(with_keys(section, candidate), alone.context)
            rollout = simulate(alone.plant, law, alone.reference, alone.t_final)
            for name in ("itae", "total_variation"):
                assert found.values[name][row, column] == pytest.approx(
                    float(metrics.ALL[name](rollout).sum()), rel=1e-9
                )


def test_a_candidate_that_cannot_be_made_fails_alone() -> None:
    section, candidates = {"type": "schedule"}, [{"leak": leak} for leak in (5.0, 1e4)]
    found = Evaluator(DRAWS, ["itae"], "numpy")(section, candidates)
    assert found.failed.tolist() == [[False] * 3, [True] * 3]
    with pytest.raises(Exception, match="leak"):
        Evaluator(DRAWS, ["itae"], "numpy")(section, candidates[1:])


def test_a_box_of_two_ends_begins_at_each_of_them() -> None:
    """Its lower numbers begin at the lower end, its upper ones at the upper; one end alone is one number."""
    declared = Parameter("a bandwidth")
    asked = Range()
    low, high = np.full(3, 10.0), np.full(3, 40.0)
    found = spaces._dimensions("omega", declared, (low, high), 0.0, 100.0, asked)
    assert [(each.end, each.start) for each in found] == [("lower", 10.0), ("upper", 40.0)]
    found = spaces._dimensions("omega", declared, (low, low), 0.0, 100.0, asked)
    assert [(each.end, each.start) for each in found] == [("", 10.0)]
