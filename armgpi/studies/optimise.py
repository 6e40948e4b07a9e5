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
from armgpi.studies.optimisers import METHODS
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
        seeds = np.random.SeedSequence(problem.seed).generate_state(len(problem.budgets), np.uint64)
        method = METHODS[problem.method]
        self._searches = [method(start, int(seed) >> 1, problem.population) for seed in seeds]
        self.rows: list[Row] = []
        self.fresh = 0

    @property
    def is_done(self) -> bool:
        """Whether all evaluations are used."""
        return len(self.rows) >= self.problem.evaluations

    def run(self, told: Callable[[Search], None] = lambda search: None, part: Part = unkept) -> None:
        """Search to the end.

        Args:
            told: is given the search after each generation that was not kept.
            part: of a study, which keeps each generation: it is not run again.

        Raises:
            RolloutError: when what was kept is not what this search proposes.
            ParameterError: when no candidate has an objective.
        """
        start = self.problem.space.start
        while not self.is_done:
            generation = self.rows[-1].generation + 1 if self.rows else 0
            asked = [search.ask() for search in self._searches] if generation else [start[None]]
            before = self.fresh
            new = self._generation(generation, asked, part)
            if generation:
                self._tell(new, [len(places) for places in asked])
            self.rows += new
            enough = self.is_done or len(self.rows) >= _HOPELESS
            if enough and all(row.failed == 1.0 for row in self.rows):
                said = (
                    f"something that has a value: none of {len(self.rows)} candidates had one in any scenario"
                )
                raise ParameterError("objective", self.problem.objective.expression.text, said)
            if self.fresh > before:
                told(self)

    def _generation(self, generation: int, asked: Sequence[Array], part: Part) -> list[Row]:
        """Return the candidates of a generation, run or kept.

        Raises:
            RolloutError: when those that were kept are not those asked for.
        """
        places = np.concatenate(asked)
        which = np.repeat(np.arange(len(asked)), [len(each) for each in asked])
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
        candidates = zip(table, which.tolist(), strict=True)
        return [self._row(each, generation, search) for each, search in candidates]

    def _numbers(self, evaluator: Evaluator, places: Array) -> Array:
        """Return what candidates are on some scenarios: worth, means of metrics, and their places last."""
        space = self.problem.space
        found = evaluator(space.section, [space.keys(x) for x in places])
        means = [found.values[name].mean(axis=1) for name in self.problem.names]
        return np.column_stack([*self.problem.objective.judge(found.values, found.failed), *means, places])

    def _row(self, numbers: Array, generation: int = 0, search: int = 0) -> Row:
        """Return a candidate from its numbers."""
        objective, failed, violation, *means = numbers[: -self.problem.width].tolist()
        by_name = dict(zip(self.problem.names, means, strict=True))
        return Row(generation, search, numbers[-self.problem.width :], objective, failed, violation, by_name)

    def judge(self, evaluator: Evaluator, places: Sequence[Array] | Array) -> list[Row]:
        """Return what candidates are on some scenarios."""
        return [self._row(each) for each in self._numbers(evaluator, np.array(places))]

    def _tell(self, new: list[Row], counts: Sequence[int]) -> None:
        """Tell each search what its candidates are worth, and the best one that another has found."""
        begin = 0
        for index, (search, count) in enumerate(zip(self._searches, counts, strict=True)):
            own, begin = new[begin : begin + count], begin + count
            search.tell(self._scores(own, self.problem.budgets[index]))
            everyone = [*self.rows, *new]
            best = everyone[int(np.argmin(self._scores(everyone, self.problem.budgets[index])))]
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
        sound = [row for row in self.rows if row.sound and row.means[self.problem.against] <= budget]
        unique = {row.x.tobytes(): row for row in reversed(sound)}
        return sorted(unique.values(), key=lambda row: row.objective)

    def validate(self) -> list[Validated]:
        """Return, for every budget, the best candidate that holds on the scenarios it never saw.

        A candidate that fails there is never the best. Budgets without one are left out.
        """
        chosen = {budget: self.rank(budget)[:_VALIDATED] for budget in self.problem.budgets}
        unique = {row.x.tobytes(): row for rows in chosen.values() for row in rows}
        if not unique:
            return []
        judged = self.judge(self.problem.held_out, [row.x for row in unique.values()])
        held = dict(zip(unique, judged, strict=True))
        found = []
        for budget, rows in chosen.items():
            holding = [row for row in rows if held[row.x.tobytes()].sound]
            if holding:
                found.append(Validated(budget, holding[0], held[holding[0].x.tobytes()]))
        return found

    def judge_start(self) -> Row:
        """Return what the section as it was given is on the held-out scenarios."""
        return self.judge(self.problem.held_out, [self.problem.space.start])[0]
