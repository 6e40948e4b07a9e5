"""A search and what it found: proposed, run, judged, generation by generation, and validated."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.errors import ParameterError, RolloutError
from armgpi.studies.evaluation import Evaluator
from armgpi.studies.objective import Judged, Objective
from armgpi.studies.optimisers import METHODS, Optimiser
from armgpi.studies.space import Space
from armgpi.studies.study import Part, unkept

#: Metrics that are kept of every candidate besides those of the objective.
KEPT = ("itae", "total_variation", "peak_error")
#: After so many candidates without one that runs anywhere, there is nothing to search.
_HOPELESS = 40
#: Candidates that are validated at most, for each budget: the best ones.
_VALIDATED = 6


class Row(NamedTuple):
    """One candidate.

    Attributes:
        generation: in which it was proposed; 0 is the section as it was given.
        search: which budget it was proposed for, from 0.
        x: its place in the cube, (d,).
        objective: over all scenarios; infinite where one failed.
        failed: share of scenarios that failed.
        violation: mean of what constraints were broken by.
        means: metric -> mean over the scenarios.
    """

    generation: int
    search: int
    x: Array
    objective: float
    failed: float
    violation: float
    means: dict[str, float]

    @property
    def sound(self) -> bool:
        """Whether it failed nowhere and broke no constraint."""
        return self.failed == 0.0 and self.violation == 0.0 and math.isfinite(self.objective)


class Validated(NamedTuple):
    """A candidate on both sets of scenarios.

    Attributes:
        budget: that it was chosen for; infinite without one.
        row: what it was in the search.
        held_out: what it is on scenarios that the search never saw.
    """

    budget: float
    row: Row
    held_out: Row


class Problem(NamedTuple):
    """What is searched.

    Attributes:
        space: of candidates.
        objective: what is wanted.
        search: runs candidates on the scenarios to search on.
        held_out: runs them on the others.
        against: metric that budgets bound.
        budgets: the bounds; (inf,) for none.
        method: what proposes.
        evaluations: how many candidates are tried.
        population: in a generation, for each budget; None for the method's own number.
        seed: of the search.
        slides: whether all joints of the arm are prismatic, for the units of tables.
    """

    space: Space
    objective: Objective
    search: Evaluator
    held_out: Evaluator
    against: str = "total_variation"
    budgets: tuple[float, ...] = (math.inf,)
    method: str = "cma"
    evaluations: int = 200
    population: int | None = None
    seed: int = 0
    slides: bool = False

    @property
    def names(self) -> list[str]:
        """Metrics that are worked out."""
        return sorted({*self.objective.names, self.against, *KEPT})

    @property
    def width(self) -> int:
        """How many numbers a candidate has."""
        return len(self.space.names)


class Search:
    """A search in progress.

    Attributes:
        problem: what is searched.
        rows: all candidates so far, the section as it was given first.
        fresh: how many of them were run here, and not kept by a study.
    """

    def __init__(self, problem: Problem) -> None:
        """Begin, nothing tried yet.

        Raises:
            MissingPackage: when the optimiser's library is not installed.
        """
        self.problem = problem
        start = problem.space.start
        sequence = np.random.SeedSequence(problem.seed)
        seeds = sequence.generate_state(len(problem.budgets), np.uint64)
        method = METHODS[problem.method]
        self._searches: list[Optimiser] = []
        for seed in seeds:
            seed_of_63_bits = int(seed) >> 1
            self._searches.append(method(start, seed_of_63_bits, problem.population))
        self.rows: list[Row] = []
        self.fresh = 0

    @property
    def is_done(self) -> bool:
        """Whether all evaluations are used."""
        return len(self.rows) >= self.problem.evaluations

    def run(self, told: Callable[[Search], None] = lambda search: None, part: Part = unkept) -> None:
        """Search to the end.

        Args:
            told: is called with the search after each generation that was not kept.
            part: of a study, which keeps each generation: it is not run again.

        Raises:
            RolloutError: when what was kept is not what this search proposes.
            ParameterError: when no candidate has an objective.
        """
        start = self.problem.space.start
        while not self.is_done:
            generation = self.rows[-1].generation + 1 if self.rows else 0
            proposed = [start[None]]
            if generation:
                proposed = [search.ask() for search in self._searches]
            fresh_before = self.fresh
            new = self._generation(generation, proposed, part)
            if generation:
                self._tell(new, [len(places) for places in proposed])
            self.rows += new
            self._check_that_some_ran()
            if self.fresh > fresh_before:
                told(self)

    def _check_that_some_ran(self) -> None:
        """Refuse to go on where no candidate of many has a value.

        Raises:
            ParameterError: when none has.
        """
        tried = len(self.rows)
        if tried < _HOPELESS and not self.is_done:
            return
        if all(row.failed == 1.0 for row in self.rows):
            expected = f"something that has a value: none of {tried} candidates had one in any scenario"
            raise ParameterError("objective", self.problem.objective.expression.text, expected)

    def _generation(self, generation: int, proposed: Sequence[Array], part: Part) -> list[Row]:
        """Return the candidates of a generation, run or kept.

        Raises:
            RolloutError: when those that were kept are not those proposed.
        """
        places = np.concatenate(proposed)
        searches: list[int] = []  # which search proposed each candidate
        for search, candidates in enumerate(proposed):
            searches += [search] * len(candidates)
        shape = (len(places), 3 + len(self.problem.names) + self.problem.width)

        def run() -> Array:
            self.fresh += len(places)
            return self._numbers(self.problem.search, places)

        table = part(f"generations/{generation:06d}", shape, run)
        if not np.array_equal(table[:, -self.problem.width :], places):
            raise RolloutError(
                "the folder's generations are not those of this search: another version of armgpi or of its "
                "optimiser wrote them; choose another folder"
            )
        return [self._row(row, generation, search) for row, search in zip(table, searches, strict=True)]

    def _numbers(self, evaluator: Evaluator, places: Array) -> Array:
        """Return what candidates are on some scenarios: worth, means of metrics, and their places last."""
        space = self.problem.space
        values, failed = evaluator(space.section, [space.keys(x) for x in places])
        means = [values[name].mean(axis=1) for name in self.problem.names]
        worth = self.problem.objective.judge(values, failed)
        return np.column_stack([*worth, *means, places])

    def _row(self, numbers: Array, generation: int = 0, search: int = 0) -> Row:
        """Return a candidate from its numbers."""
        objective, failed, violation, *means = numbers[: -self.problem.width].tolist()
        by_name = dict(zip(self.problem.names, means, strict=True))
        return Row(generation, search, numbers[-self.problem.width :], objective, failed, violation, by_name)

    def judge(self, evaluator: Evaluator, places: Sequence[Array] | Array) -> list[Row]:
        """Return what candidates are on some scenarios."""
        return [self._row(row) for row in self._numbers(evaluator, np.array(places))]

    def _tell(self, new: list[Row], counts: Sequence[int]) -> None:
        """Tell each search what its candidates are worth, and the best one that another has found."""
        everyone = [*self.rows, *new]
        begin = 0
        for index, search in enumerate(self._searches):
            budget = self.problem.budgets[index]
            proposed = new[begin : begin + counts[index]]
            begin += counts[index]
            search.tell(self._scores(proposed, budget))
            best = everyone[int(np.argmin(self._scores(everyone, budget)))]
            if best.search != index and best.generation:
                search.inject(best.x)

    def _scores(self, rows: Sequence[Row], budget: float) -> Array:
        """Return what is minimised, under a budget."""
        columns = (np.array([getattr(row, name) for row in rows]) for name in Judged._fields)
        spent = np.array([row.means[self.problem.against] for row in rows])
        with np.errstate(all="ignore"):
            beyond = np.fmax((spent - budget) / budget, 0.0)  # and 0 of an infinite budget
        return Judged(*columns).scores(beyond)

    def rank(self, budget: float = math.inf) -> list[Row]:
        """Return the candidates that fail nowhere and keep a budget, best first, each once."""
        unique: dict[bytes, Row] = {}
        for row in reversed(self.rows):
            if row.sound and row.means[self.problem.against] <= budget:
                unique[row.x.tobytes()] = row  # the first one of a place stays
        return sorted(unique.values(), key=lambda row: row.objective)

    def validate(self) -> list[Validated]:
        """Return, for every budget, the best candidate that holds on the scenarios it never saw.

        A candidate that fails there is never the best. Budgets without one are left out.
        """
        best_of = {budget: self.rank(budget)[:_VALIDATED] for budget in self.problem.budgets}
        places: dict[bytes, Array] = {}
        for rows in best_of.values():
            places |= {row.x.tobytes(): row.x for row in rows}
        if not places:
            return []
        judged = self.judge(self.problem.held_out, [*places.values()])
        held_out = dict(zip(places, judged, strict=True))
        validated = []
        for budget, rows in best_of.items():
            holding = [row for row in rows if held_out[row.x.tobytes()].sound]
            if holding:
                best = holding[0]
                validated.append(Validated(budget, best, held_out[best.x.tobytes()]))
        return validated

    def judge_start(self) -> Row:
        """Return what the section as it was given is on the held-out scenarios."""
        return self.judge(self.problem.held_out, [self.problem.space.start])[0]
