"""A search and what it found: proposed, run, judged, kept in a folder after each generation, validated."""

from __future__ import annotations

import csv
import hashlib
import io
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import Array
from armgpi.errors import ParameterError, RolloutError
from armgpi.search.evaluation import Evaluator
from armgpi.search.objective import Judged, Objective
from armgpi.search.optimisers import make
from armgpi.search.space import Space

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

    @property
    def names(self) -> list[str]:
        """Metrics that are worked out."""
        return sorted({*self.objective.names, self.against, *KEPT})

    @property
    def width(self) -> int:
        """How many numbers a candidate has."""
        return len(self.space.names)


class Study:
    """A search in progress.

    Attributes:
        problem: what is searched.
        rows: all candidates so far, the section as it was given first.
    """

    def __init__(self, problem: Problem) -> None:
        """Begin, nothing tried yet.

        Raises:
            MissingPackage: when the optimiser's library is not installed.
        """
        self.problem = problem
        start = problem.space.start
        seeds = np.random.SeedSequence(problem.seed).generate_state(len(problem.budgets), np.uint64)
        self._searches = [make(problem.method, start, int(seed) >> 1, problem.population) for seed in seeds]
        self.rows: list[Row] = []

    @property
    def done(self) -> bool:
        """Whether all evaluations are used."""
        return len(self.rows) >= self.problem.evaluations

    def run(self, told: Callable[[Study], None] = lambda study: None, kept: Sequence[Row] = ()) -> None:
        """Search to the end.

        Args:
            told: is given the study after each generation.
            kept: candidates of a search that was stopped, whole generations: they are not run again.

        Raises:
            RolloutError: when what was kept is not what this search proposes.
            ParameterError: when no candidate has an objective.
        """
        waiting = list(kept)
        while not self.done:
            generation = self.rows[-1].generation + 1 if self.rows else 0
            asked = (
                [search.ask() for search in self._searches]
                if generation
                else [self.problem.space.start[None]]
            )
            known, waiting = waiting[: sum(map(len, asked))], waiting[sum(map(len, asked)) :]
            new = self._replayed(asked, known) if known else self._ran(generation, asked)
            if generation:
                self._tell(new, [len(part) for part in asked])
            self.rows += new
            enough = self.done or len(self.rows) >= _HOPELESS
            if enough and all(row.failed == 1.0 for row in self.rows):
                said = (
                    f"something that has a value: none of {len(self.rows)} candidates had one in any scenario"
                )
                raise ParameterError("objective", self.problem.objective.expression.text, said)
            if not known:
                told(self)

    def _ran(self, generation: int, asked: Sequence[Array]) -> list[Row]:
        """Run the candidates of a generation."""
        places = np.concatenate(asked)
        found = self.judged(self.problem.search, places)
        which = np.repeat(np.arange(len(asked)), [len(part) for part in asked])
        return [
            row._replace(generation=generation, search=int(search))
            for row, search in zip(found, which, strict=True)
        ]

    def judged(self, evaluator: Evaluator, places: Sequence[Array] | Array) -> list[Row]:
        """Return what candidates are on some scenarios."""
        space, objective = self.problem.space, self.problem.objective
        found = evaluator(space.section, [space.keys(x) for x in places])
        judged = objective.judge(found.values, found.failed)
        means = {name: values.mean(axis=1) for name, values in found.values.items()}
        return [
            Row(
                0,
                0,
                np.asarray(x),
                float(judged.objective[i]),
                float(judged.failed[i]),
                float(judged.violation[i]),
                {name: float(mean[i]) for name, mean in means.items()},
            )
            for i, x in enumerate(places)
        ]

    def _replayed(self, asked: Sequence[Array], known: list[Row]) -> list[Row]:
        """Return the candidates of a generation that was run before."""
        places = np.concatenate(asked)
        if len(known) != len(places) or not np.array_equal(places, [row.x for row in known]):
            raise RolloutError(
                "the folder's evaluations are not those of this search: another version of armgpi or of its "
                "optimiser wrote them; choose another folder"
            )
        return known

    def _tell(self, new: list[Row], counts: Sequence[int]) -> None:
        """Tell each search what its candidates are worth, and the best one that another has found."""
        begin = 0
        for index, (search, count) in enumerate(zip(self._searches, counts, strict=True)):
            own, begin = new[begin : begin + count], begin + count
            search.tell(self._scores(own, self.problem.budgets[index]))
            if len(self._searches) > 1:
                everyone = [*self.rows, *new]
                scores = self._scores(everyone, self.problem.budgets[index])
                best = int(np.argmin(scores))
                if everyone[best].search != index and everyone[best].generation:
                    search.inject(everyone[best].x)

    def _scores(self, rows: Sequence[Row], budget: float) -> Array:
        """Return what is minimised, under a budget."""
        columns = (np.array([getattr(row, name) for row in rows]) for name in Judged._fields)
        spent = np.array([row.means[self.problem.against] for row in rows])
        with np.errstate(all="ignore"):
            beyond = np.where(spent > budget, (spent - budget) / budget, 0.0)
        return Judged(*columns).scores(beyond)

    def ranked(self, budget: float = math.inf) -> list[Row]:
        """Return the candidates that fail nowhere and keep a budget, best first, each once."""
        sound = [row for row in self.rows if row.sound and row.means[self.problem.against] <= budget]
        unique = {row.x.tobytes(): row for row in reversed(sound)}
        return sorted(unique.values(), key=lambda row: row.objective)

    def validated(self) -> list[Validated]:
        """Return, for every budget, the best candidate that holds on the scenarios it never saw.

        A candidate that fails there is never the best. Budgets without one are left out.
        """
        chosen = {budget: self.ranked(budget)[:_VALIDATED] for budget in self.problem.budgets}
        unique = {row.x.tobytes(): row for rows in chosen.values() for row in rows}
        if not unique:
            return []
        judged = self.judged(self.problem.held_out, [row.x for row in unique.values()])
        held = dict(zip(unique, judged, strict=True))
        found = []
        for budget, rows in chosen.items():
            holding = [row for row in rows if held[row.x.tobytes()].sound]
            if holding:
                found.append(Validated(budget, holding[0], held[holding[0].x.tobytes()]))
        return found

    def given(self) -> Row:
        """Return what the section as it was given is on the held-out scenarios."""
        return self.judged(self.problem.held_out, [self.problem.space.start])[0]

    def table(self, key: str = "") -> str:
        """Return all candidates as CSV, exact: what :func:`rows_of` reads.

        Args:
            key: of what they are part of. Each row ends with a hash of the key and of all up to it: no row of
                another study, and none that was changed, passes for one of this.
        """
        names = self.problem.names
        places = [f"x {name}" for name in self.problem.space.names]
        head = ("generation", "search", "objective", "failed", "violation")
        lines: list[list[Any]] = [[*head, *names, *self.problem.space.names, *places]]
        for row in self.rows:
            numbers = (row.objective, row.failed, row.violation, *(row.means[name] for name in names))
            values = (*numbers, *self.problem.space.values(row.x), *row.x)
            lines.append([row.generation, row.search, *(repr(float(value)) for value in values)])
        text = io.StringIO()
        for line, chained in zip(lines, _chain(lines, key), strict=True):
            csv.writer(text, lineterminator="\n").writerow([*line, chained])
        return text.getvalue()


def _chain(lines: Iterable[Sequence[Any]], key: str) -> Iterator[str]:
    """Yield the last cell of each line: of the first its name, of others the hash of all until there."""
    sums = hashlib.sha256(key.encode())
    for place, line in enumerate(lines):
        sums.update(",".join(map(str, line)).encode() + b"\n")
        yield sums.hexdigest()[:16] if place else "hash"


def kept_rows(path: Path, problem: Problem, key: str) -> list[Row]:
    """Return the candidates of a file; none where there is no file.

    Raises:
        RolloutError: when it is damaged, or of something else.
    """
    try:
        if not path.exists():
            return []
        # As many rows of as many cells as there may be: a generation more than asked for.
        if path.stat().st_size > (problem.evaluations + 100_000) * 32 * (
            8 + len(problem.names) + 2 * problem.width
        ):
            raise RolloutError(f"{path}: is too large for what was asked; remove it")
        return rows_of(path.read_text(encoding="utf-8"), problem, key)
    except (OSError, ValueError) as error:
        raise RolloutError(f"{path}: cannot be read: {error}") from None


def rows_of(text: str, problem: Problem, key: str = "") -> list[Row]:
    """Return candidates from :meth:`Study.table`.

    Raises:
        RolloutError: when it is no such table.
    """
    names, d = problem.names, problem.width
    try:
        lines = list(csv.reader(io.StringIO(text)))
        body = [line[:-1] for line in lines]
        if [line[-1] for line in lines] != list(_chain(body, key)):
            raise ValueError
        head, *body = body
        if head[5:] != [*names, *problem.space.names, *(f"x {name}" for name in problem.space.names)]:
            raise ValueError
        found = []
        for line in body:
            numbers = [float(cell) for cell in line[2:]]
            if len(numbers) != 3 + len(names) + 2 * d:
                raise ValueError
            means = dict(zip(names, numbers[3:], strict=False))
            x = np.array(numbers[len(numbers) - d :])
            objective, failed, violation = numbers[:3]
            found.append(Row(int(line[0]), int(line[1]), x, objective, failed, violation, means))
    except (ValueError, IndexError, csv.Error):
        raise RolloutError("the folder's evaluations.csv is not that of this search, or is damaged") from None
    return found
