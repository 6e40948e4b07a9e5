"""Subset simulation: how probable failures are that are too rare to be met at random (Au and Beck 2001).

Each level is a set of points that all come nearer to a failure than a bound, which a tenth of the level
before came to; the probability is the product of these shares. Points are standard normal numbers, which a
study turns into what it draws. Chains move them by conditional sampling with steps that adapt (Papaioannou et
al. 2015).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr
from scipy.stats import norm as normal

from armgpi.base.arrays import Array
from armgpi.base.escape import counted
from armgpi.base.intervals import LEVEL, Estimate, clopper_pearson
from armgpi.base.verdict import Verdict, judge
from armgpi.config import ExperimentConfig
from armgpi.errors import ConfigError, ParameterError
from armgpi.studies.distributions import draw_key
from armgpi.studies.results import WORST
from armgpi.studies.sample import Sweep
from armgpi.studies.study import Study

#: Share of a level from which the next one starts, and so one over the length of a chain.
_SHARE = 0.1
_LENGTH = 10
#: Share of right levels that the plain check finds right: it says something of those alone that are far off.
_CHECKED = 0.99
#: Levels at most: what is rarer than 1e-16 is not told from what never happens.
_LEVELS = 16
#: Part of the chains that other points must begin at least.
_FEW = 0.1
#: Share of accepted moves that the steps adapt to, and the first step.
_ACCEPTED, _STEP = 0.44, 0.6
#: Seeds of random sensors are drawn below this.
_SEEDS = 2**31
#: Fewest points of a level: a chain starts from each tenth one.
FEWEST = 100

#: In how many runs the interval held where the probability is known: lower 95 % ends of the worst case, and
#: of a failure behind a flat margin, by tools/coverage.py (1000 runs each; docs/sweep.md has the table).
HELD, HELD_UNSEEN = 0.963, 0.875

#: Seeds of rollouts, (k,).
Seeds = npt.NDArray[np.int64]
#: How near points come to a failure, from points (k, d) and seeds (k,): failed is above 1, shape (k,).
Margin = Callable[[Array, Seeds], Array]


class Rare(NamedTuple):
    """What subset simulation found.

    Attributes:
        probability: of failure, with an interval of 95 % that takes the logarithm as normal.
        deviation: estimated standard deviation of the probability over itself.
        bounds: of the margin, level by level; the last is 1, a failure.
        shares: of each level's points that reach its bound.
        accepted: share of moves that were accepted, level by level from the second on.
        points: number of all points.
    """

    probability: Estimate
    deviation: float
    bounds: list[float]
    shares: list[float]
    accepted: list[float]
    points: int


def first(margin: Margin, dimensions: int, count: int, random: np.random.Generator) -> Array:
    """Return the first level: points drawn at random.

    Returns:
        Points, seeds and margins, shape (count, dimensions + 2).
    """
    points = random.standard_normal((count, dimensions))
    return _table(margin, points, random.integers(_SEEDS, size=count))


def following(margin: Margin, level: Array, random: np.random.Generator, before: float = -np.inf) -> Array:
    """Return the level after one: chains from the tenth that is nearest to a failure.

    Args:
        margin: of points.
        level: from :func:`first` or this function.
        random: draws who begins a chain, and the moves.
        before: bound of the level before it.

    Returns:
        The same form as `level`; rows of a chain are a tenth of the rows apart.
    """
    bound, _ = _level_bound(level, before)
    chains = round(_SHARE * len(level))
    # Drawn among all that reach the bound: where margins tie these are more than a tenth, and the largest of
    # them are no fair sample. Fewer begin several chains each.
    reached = np.flatnonzero(level[:, -1] >= bound)
    begin = random.choice(reached, chains, replace=len(reached) < chains)
    now = level[begin]
    spread = np.clip(now[:, :-2].std(axis=0), 1e-6, None)
    rows = [now]
    step = _STEP
    for move in range(1, _LENGTH):
        size = np.minimum(1.0, step * spread)
        # Reversible with respect to the standard normal: a move is refused for its margin alone. A seed is
        # one more number, drawn anew.
        points = now[:, :-2]
        moved = np.sqrt(1.0 - size**2) * points + size * random.standard_normal(points.shape)
        proposed = _table(margin, moved, random.integers(_SEEDS, size=chains))
        is_accepted = proposed[:, -1] >= bound
        now = np.where(is_accepted[:, None], proposed, now)
        step *= math.exp((is_accepted.mean() - _ACCEPTED) / math.sqrt(move))
        rows.append(now)
    return np.vstack(rows)


def estimate(levels: list[Array]) -> Rare:
    """Return what levels say, the last of which reaches failures."""
    bounds, shares = zip(*bounds_of(levels), strict=True)
    # Of each level the relative standard deviation of its share, and how many moves of its chains were taken.
    deviations: list[float] = []
    accepted: list[float] = []
    for place, level in enumerate(levels):
        share = shares[place]
        reached = level[:, -1] >= bounds[place]
        correlation = 0.0
        if place > 0:  # the first level has independent points, no chains
            chains = reached.reshape(_LENGTH, -1).astype(float)
            correlation = _correlation(chains, share)
            points = level[:, :-2].reshape(_LENGTH, chains.shape[1], -1)
            moved = (np.diff(points, axis=0) != 0.0).any(axis=-1)
            accepted.append(float(moved.mean()))
        independent = (1.0 - share) / (share * len(level))
        deviations.append(math.sqrt(independent * (1.0 + correlation)))
    # Levels begin with points of the one before: taken as wholly correlated, which is the widest there is.
    # How often the interval holds is measured by tools/coverage.py.
    spread = sum(deviations) ** 2
    p = math.prod(shares)
    # The logarithm of p is taken for normal, with the variance log(1 + spread).
    quantile = float(normal.ppf(0.5 + 0.5 * LEVEL))
    factor = math.exp(quantile * math.sqrt(math.log1p(spread)))
    probability = Estimate(p, p / factor, min(1.0, p * factor))
    runs = sum(map(len, levels))
    return Rare(probability, math.sqrt(spread), list(bounds), list(shares), accepted, runs)


def _table(margin: Margin, points: Array, seeds: Seeds) -> Array:
    """Return points with their seeds and margins."""
    margins = margin(points, seeds)
    # 1 is the bound of failure, not a margin.
    margins = np.where(margins == 1.0, np.nextafter(1.0, 0.0), margins)
    margins = np.where(np.isnan(margins), np.inf, margins)
    return np.column_stack([points, seeds, margins])


def bounds_of(levels: list[Array]) -> list[tuple[float, float]]:
    """Return bound and share of every level; a bound that does not rise is the last."""
    bounds: list[tuple[float, float]] = []
    before = -np.inf
    for level in levels:
        bound, share = _level_bound(level, before)
        bounds.append((bound, share))
        before = bound
    return bounds


def _level_bound(level: Array, before: float = -np.inf) -> tuple[float, float]:
    """Return the bound that a tenth of a level reaches, 1 where as many fail, and what share reaches it.

    Where so many tie that it would be the bound before, it is the next value that enough points have; there
    is none where the level cannot rise.
    """
    margins = -np.sort(-level[:, -1])
    chains = round(_SHARE * len(level))
    if margins[chains - 1] > 1.0:
        return 1.0, float((margins > 1.0).mean())
    bound = 0.5 * float(margins[chains - 1] + margins[chains])
    if bound <= before:
        higher = margins[margins > before]
        if len(higher) < _FEW * chains:
            return before, 1.0
        if higher[-1] > 1.0:
            return 1.0, float((margins > 1.0).mean())
        bound = float(higher[-1])
    return bound, float((margins >= bound).mean())


def _correlation(chains: Array, share: float) -> float:
    """Return by how much the chains' correlation adds to the variance; chains of shape (length, chains)."""
    length, variance = len(chains), share * (1.0 - share)
    if variance <= 0.0:
        return 0.0
    total = 0.0
    for lag in range(1, length):
        together = float((chains[lag:] * chains[:-lag]).mean()) - share**2
        total += 2.0 * (1.0 - lag / length) * together / variance
    return max(0.0, total)


def simulate(
    sweep: Sweep, study: Study, count: int, told: Callable[[int], None] = lambda rows: None
) -> tuple[Rare, Array, Array]:
    """Run subset simulation of a study, level by level; levels that are in the folder are not run again.

    Args:
        sweep: with `vary`, and bounds of failure above 0.
        study: its folder.
        count: points of a level, made a multiple of 10.
        told: is called with the points of each level.

    Returns:
        What was found, the last level, and as many points drawn at random, which belong to no level.

    Raises:
        ConfigError: when the study draws from an uncertainty model, or a bound of failure is not above 0.
        ParameterError: when there are too few points, or failures do not depend on what is drawn.
        RolloutError: when a level cannot be written or read.
    """
    if sweep.config.reality is not None:
        raise ConfigError(
            "", "reality", "rare failures are those of `vary`: two scenarios have none between them"
        )
    for name, most in sweep.failure.items():
        if most <= 0.0:
            raise ConfigError("", f"failure.{name}", f"a bound above 0 for rare failures, not {most:g}")
    if count < FEWEST:
        raise ParameterError("rollouts", count, f"at least {FEWEST} in each level")
    count = -(-count // _LENGTH) * _LENGTH

    def margin(points: Array, seeds: Seeds) -> Array:
        """Return how near points come to a failure: the largest metric over its bound."""
        table = sweep.table(sweep.drawn_at(ndtr(points)), seeds)
        shares = [table[name].max(axis=1) / most for name, most in sweep.failure.items()]
        largest = np.max(shares, axis=0)
        # Failed is what the study says, however a division rounds: 1 or less is no failure, more is one.
        of_failed = np.maximum(largest, np.nextafter(1.0, 2.0))
        of_others = np.minimum(largest, 1.0)
        return np.asarray(np.where(sweep.fails(table), of_failed, of_others))

    key = draw_key(sweep.config.seed, *sweep.streams, f"rare {count}")  # none of its chunks has it

    def keep_level(place: int, level: Callable[[np.random.Generator], Array]) -> Array:
        generator = np.random.Philox(key=key, counter=place << 192)
        random = np.random.Generator(generator)
        shape = (count, sweep.width + 2)
        return study.part(f"rare/{count}-{place:02d}", shape, lambda: level(random))

    levels = climb(margin, sweep.width, count, keep_level, told)
    bound, _ = bounds_of(levels)[-1]
    if bound < 1.0:
        expected = "bounds that random rollouts come nearer to: the levels do not rise"
        if len(levels) == _LEVELS:
            expected = f"bounds that can be reached: the nearest comes to {bound:.3g} of one"
        raise ParameterError("failure", dict(sweep.failure), expected)
    check = keep_level(_LEVELS, partial(first, margin, sweep.width, count))
    told(count)
    return estimate(levels), levels[-1], check


def climb(
    margin: Margin,
    dimensions: int,
    count: int,
    kept: Callable[[int, Callable[[np.random.Generator], Array]], Array],
    told: Callable[[int], None] = lambda rows: None,
) -> list[Array]:
    """Return the levels up to failures, or up to one that cannot rise.

    Args:
        margin: of points.
        dimensions: of a point.
        count: points of a level, a multiple of 10.
        kept: gives the level of a number: what was kept, or what the function makes with random numbers.
        told: is called with the points of each level.
    """
    level = kept(0, partial(first, margin, dimensions, count))
    levels = [level]
    before = -np.inf
    while True:
        told(count)
        bound, _ = _level_bound(level, before)
        if bound == 1.0 or bound <= before or len(levels) == _LEVELS:
            return levels
        level = kept(len(levels), partial(following, margin, level, before=before))
        levels.append(level)
        before = bound


def summary(sweep: Sweep, found: Rare, last: Array, check: Array) -> dict[str, Any]:
    """Return what was found as plain data, with where failures are: quantiles of what was drawn.

    `check` is points drawn at random, of which so many reach the bound of the second level as the levels say,
    unless the chains went astray.
    """
    second = min(1, len(found.bounds) - 1)
    bound = found.bounds[second]
    reached = int((check[:, -1] >= bound).sum())
    failed = last[last[:, -1] > 1.0]
    drawn = sweep.drawn_at(ndtr(failed[:, :-2]))
    shares = (0.05, 0.5, 0.95)
    places = {}
    for name, column in zip(sweep.drawn_names, drawn.T, strict=True):
        quantiles = np.quantile(column, shares).tolist()
        places[name] = dict(zip(map(str, shares), quantiles, strict=True))
    levels = []
    for level_bound, share in zip(found.bounds, found.shares, strict=True):
        levels.append({"bound": level_bound, "share": share})
    return {
        "study": sweep.identity.digest,
        "controller": sweep.label,
        "failure": {"diverged": None, **sweep.failure},
        "rollouts": found.points,
        "probability of failure": found.probability._asdict(),
        "coefficient of variation": found.deviation,
        "such intervals hold in at least": {"of known cases": HELD, "behind a flat margin": HELD_UNSEEN},
        "levels": levels,
        "accepted": found.accepted,
        "plain check": {
            "rollouts": len(check),
            "bound": bound,
            "by the levels": math.prod(found.shares[: second + 1]),
            **clopper_pearson(reached, len(check), _CHECKED)._asdict(),
        },
        "unseen is more probable than": 3.0 / (len(check) + len(last)),
        "failures are at": places,
    }


def sentences(said: Mapping[str, Any]) -> list[str]:
    """Return what was found, in words."""
    p, levels = said["probability of failure"], said["levels"]
    lines = [
        f"fails with a probability of {p['value']:.3g} ({p['lower']:.3g} to {p['upper']:.3g}, 95 %): "
        f"{counted(said['rollouts'], 'rollout')} in {counted(len(levels), 'level')}",
        f"such intervals held in at least {100 * HELD:g} % of runs where the probability is known; in "
        f"{100 * HELD_UNSEEN:g} % where the margin gives no sign of a second way to fail",
        _describe_check(said["plain check"]),
        f"failures with nothing near them are seen where they are more probable than "
        f"{said['unseen is more probable than']:.2g}: a second way to fail, rarer than that, is missed",
    ]
    for name, at in said["failures are at"].items():
        lines.append(
            f"{name} in failures: {at['0.5']:.3g} ({at['0.05']:.3g} to {at['0.95']:.3g}, 90 % of them)"
        )
    return lines


def judge_levels(said: Mapping[str, Any]) -> Verdict:
    """Return the verdict of a summary: an estimate that random rollouts contradict is not judged."""
    if _confirms(said["plain check"]):
        return judge(True, f"a probability of failure of {said['probability of failure']['value']:.3g}")
    return Verdict(
        "not judged",
        "the probability of failure: other random rollouts contradict the levels, so the estimate below is "
        "not valid. Use more rollouts in each level: --rollouts",
    )


def _confirms(check: Mapping[str, Any]) -> bool:
    """Tell whether random rollouts reach the second level as often as the levels say."""
    return bool(check["lower"] <= check["by the levels"] <= check["upper"])


def _describe_check(check: Mapping[str, Any]) -> str:
    """Return in words whether random rollouts reach the second level as often as the levels say."""
    return (
        f"{check['value']:.2g} of {check['rollouts']} other random rollouts reach the second level "
        f"({check['lower']:.2g} to {check['upper']:.2g}, 99 %), {check['by the levels']:.2g} by the levels"
        + ("" if _confirms(check) else ": THE LEVELS ARE WRONG, more points a level may help")
    )


def worst(sweep: Sweep, last: Array, count: int = WORST) -> list[ExperimentConfig]:
    """Return the worst rollouts of the last level as experiments, each once."""
    _, places = np.unique(last[:, :-1], axis=0, return_index=True)
    worst_first = sorted(places, key=lambda i: (-last[i, -1], i))
    configs = []
    for i in worst_first[:count]:
        point, seed = last[i : i + 1, :-2], int(last[i, -2])
        numbers = sweep.drawn_at(ndtr(point))[0].tolist()
        row = dict(zip(sweep.drawn_names, numbers, strict=True))
        configs.append(sweep.config_of(row, seed=seed))
    return configs
