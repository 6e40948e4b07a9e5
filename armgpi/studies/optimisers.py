"""What proposes candidates in the cube [0, 1]^d: an evolution strategy, and a swarm as in the paper's field.

Each has a generator of its own, so that the same seed proposes the same candidates, whatever else draws
random numbers. What was proposed and told is all of their state: replaying it resumes a search bit by bit.
"""

from __future__ import annotations

import warnings
from typing import Any, Protocol

import numpy as np

from armgpi.base.arrays import Array
from armgpi.errors import import_extra

#: First step size, as a share of the range.
_STEP = 0.25
#: Distance of its start from the ends of a range, as a share of it.
_MARGIN = 0.02
#: Share of its velocity that a particle keeps [-]: Clerc and Kennedy, 2002.
_INERTIA = 0.7298
#: Its attractions to the best places, likewise.
_PULL = 1.49618
#: Score of what has none: the libraries take neither NaN nor infinity.
_NO_SCORE = 1e300


class Optimiser(Protocol):
    """A search that is asked and told by turns."""

    def ask(self) -> Array:
        """Return candidates, shape (k, d), in [0, 1]."""

    def tell(self, scores: Array) -> None:
        """Take the scores of the candidates asked for last: finite, less is better."""

    def inject(self, x: Array) -> None:
        """Take a good candidate from elsewhere into the next ones."""


class CMA:
    """Evolution strategy with covariance matrix adaptation, by the library `cma` (N. Hansen).

    It begins anew with twice the candidates, at a random place, where it has converged.
    """

    def __init__(self, start: Array, seed: int, population: int | None = None) -> None:
        """Begin at a place.

        Raises:
            MissingPackage: when the library is not installed.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of plotting, which is not used
            self._library = import_extra("cma", "tune")
        self._random = np.random.default_rng(seed)
        self._population = population
        self._restart(np.asarray(start, dtype=np.float64))

    def _restart(self, start: Array) -> None:
        """Begin at a place with what is now the number of candidates."""
        # One dimension is none to the library: a second one that nothing depends on stands beside it.
        self._d = len(start)
        x = start if self._d > 1 else np.append(start, 0.5)
        # Without `randn` its constructor seeds NumPy's global generator.
        options = {
            "bounds": [0.0, 1.0],
            "randn": lambda *shape: self._random.standard_normal(shape),
            "seed": np.nan,
            "verbose": -9,
            "verb_log": 0,
        }
        if self._population is not None:
            options["popsize"] = self._population
        inside = np.clip(x, _MARGIN, 1.0 - _MARGIN)
        self._strategy = self._library.CMAEvolutionStrategy(inside, _STEP, options)
        self._population = self._strategy.popsize
        self._asked: list[Any] = []

    def ask(self) -> Array:
        """Return candidates; see :meth:`Optimiser.ask`."""
        if self._strategy.stop():
            assert self._population is not None
            self._population *= 2
            self._restart(self._random.uniform(size=self._d))
        self._asked = self._strategy.ask()
        places = np.array(self._asked)[:, : self._d]
        return np.asarray(np.clip(places, 0.0, 1.0))

    def tell(self, scores: Array) -> None:
        """Take scores; see :meth:`Optimiser.tell`."""
        finite_scores = np.where(np.isfinite(scores), scores, _NO_SCORE)
        self._strategy.tell(self._asked, finite_scores.tolist())

    def inject(self, x: Array) -> None:
        """Take a candidate; see :meth:`Optimiser.inject`."""
        candidate = x if self._d > 1 else np.append(x, 0.5)
        self._strategy.inject([candidate], force=True)


class Swarm:
    """Particle swarm: each is drawn to the best place of its own and to that of all."""

    def __init__(self, start: Array, seed: int, population: int | None = None) -> None:
        """Begin around a place."""
        self._random = np.random.default_rng(seed)
        count = population or 10 + len(start)
        self._x = self._random.uniform(size=(count, len(start)))
        self._x[0] = start
        others = self._random.uniform(size=self._x.shape)
        self._v = 0.25 * (others - self._x)
        self._best = self._x.copy()
        self._scores = np.full(count, np.inf)

    def ask(self) -> Array:
        """Return candidates; see :meth:`Optimiser.ask`."""
        if np.isfinite(self._scores).any():
            leader = self._best[int(np.argmin(self._scores))]
            to_best, to_leader = self._random.uniform(size=(2, *self._x.shape))
            to_own_best = to_best * (self._best - self._x)
            to_best_of_all = to_leader * (leader - self._x)
            self._v = _INERTIA * self._v + _PULL * (to_own_best + to_best_of_all)
            moved = self._x + self._v
            self._x = np.clip(moved, 0.0, 1.0)
            is_inside = moved == self._x
            self._v = np.where(is_inside, self._v, -0.5 * self._v)  # else it bounces back
        return self._x.copy()

    def tell(self, scores: Array) -> None:
        """Take scores; see :meth:`Optimiser.tell`."""
        better = scores < self._scores
        self._best = np.where(better[:, None], self._x, self._best)
        self._scores = np.where(better, scores, self._scores)

    def inject(self, x: Array) -> None:
        """Put a candidate in the place of the worst one; see :meth:`Optimiser.inject`."""
        worst = int(np.argmax(self._scores))
        self._best[worst] = self._x[worst] = x
        self._scores[worst] = np.inf


class Parzen:
    """Tree-structured Parzen estimators (Bergstra et al. 2011), by the library Optuna."""

    def __init__(self, start: Array, seed: int, population: int | None = None) -> None:
        """Begin at a place.

        Raises:
            MissingPackage: when the library is not installed.
        """
        optuna = import_extra("optuna", "optuna")
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of `constant_liar`, without which a generation is one place
            sampler = optuna.samplers.TPESampler(seed=seed % 2**32, constant_liar=True)
        self._study = optuna.create_study(sampler=sampler)
        unit = optuna.distributions.FloatDistribution(0.0, 1.0)
        self._ranges: dict[str, Any] = {f"x{i}": unit for i in range(len(start))}
        self._count = population or 10 + len(start)
        self._asked: list[Any] = []
        self.inject(start)

    def ask(self) -> Array:
        """Return candidates; see :meth:`Optimiser.ask`."""
        self._asked = [self._study.ask(self._ranges) for _ in range(self._count)]
        places = np.empty((self._count, len(self._ranges)))
        for row, trial in zip(places, self._asked, strict=True):
            row[:] = [trial.params[name] for name in self._ranges]
        return places

    def tell(self, scores: Array) -> None:
        """Take scores; see :meth:`Optimiser.tell`."""
        for trial, score in zip(self._asked, scores, strict=True):
            is_number = score == score
            finite_score = min(float(score), _NO_SCORE) if is_number else _NO_SCORE
            self._study.tell(trial, finite_score)

    def inject(self, x: Array) -> None:
        """Take a candidate; see :meth:`Optimiser.inject`."""
        parameters = {name: float(place) for name, place in zip(self._ranges, x, strict=True)}
        self._study.enqueue_trial(parameters)


#: Name in files -> what proposes.
METHODS: dict[str, type[CMA] | type[Swarm] | type[Parzen]] = {
    "cma": CMA,
    "pso": Swarm,
    "optuna": Parzen,
}
#: Name in files -> module and extra of its library.
LIBRARIES = {"cma": ("cma", "tune"), "optuna": ("optuna", "optuna")}
