"""How often the intervals of rare events hold, on functions whose probability is known.

Each case runs many times; a row says how often the interval of 95 % held the true probability, and the lower
end of the 95 % interval (Clopper-Pearson) of that share. `--count` is points a level, `--runs` repetitions.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable

import numpy as np
from scipy.stats import chi2, norm

from armgpi.base.arrays import Array
from armgpi.base.intervals import clopper_pearson
from armgpi.studies import rare


def _plane(points: Array) -> Array:
    return np.asarray(points.sum(axis=1) / math.sqrt(points.shape[1]))


def _modes(points: Array) -> Array:
    return np.maximum(points[:, 0] / 3.5, -points[:, 1] / 3.6)


#: Name -> margin of points, dimensions, and the probability that the margin is above 1.
CASES = {
    "plane, 3 sigma": (lambda x: _plane(x) / 3.0, 2, norm.sf(3.0)),
    "plane, 4.75 sigma": (lambda x: _plane(x) / 4.75, 10, norm.sf(4.75)),
    "sphere, 2": (lambda x: np.linalg.norm(x, axis=1) / 4.5, 2, chi2.sf(4.5**2, 2)),
    "sphere, 6": (lambda x: np.linalg.norm(x, axis=1) / 5.5, 6, chi2.sf(5.5**2, 6)),
    "corner": (lambda x: x.min(axis=1) / 2.5, 2, norm.sf(2.5) ** 2),
    "corner, 3": (lambda x: x.min(axis=1) / 2.0, 3, norm.sf(2.0) ** 3),
    "two tails": (lambda x: np.abs(x[:, 0]) / 4.0, 3, 2.0 * norm.sf(4.0)),
    "two modes": (_modes, 2, 1.0 - norm.cdf(3.5) * norm.cdf(3.6)),
    "steps of 0.5 sigma": (lambda x: np.floor(2.0 * x[:, 0]) / 7.9, 2, norm.sf(4.0)),
    "steps of 1 sigma": (lambda x: np.floor(x[:, 0]) / 3.9, 2, norm.sf(4.0)),
    "steps of a plane": (lambda x: np.floor(4.0 * _plane(x)) / 15.9, 6, norm.sf(4.0)),
    "behind a flat margin": (lambda x: np.maximum(_plane(x) / 4.0, 1.01 * (x[:, 1] > 3.0)), 3, None),
}


def _levels(margin: Callable[[Array], Array], dimensions: int, count: int, seed: int) -> list[Array]:
    """Return the levels of one run."""
    random = np.random.default_rng(seed)
    return rare.climb(lambda points, seeds: margin(points), dimensions, count, lambda _, level: level(random))


def held(name: str, count: int, runs: int) -> tuple[int, int, float]:
    """Return in how many of the runs the interval held, how many ended, and the mean over the true value."""
    margin, dimensions, true = CASES[name]
    if true is None:  # a second way to fail that nothing leads to
        random = np.random.default_rng(0)
        true = float((margin(random.standard_normal((10**7, dimensions))) > 1.0).mean())
    within, found = 0, []
    for seed in range(runs):
        levels = _levels(margin, dimensions, count, seed)
        if rare.bounds_of(levels)[-1][0] == 1.0:
            p = rare.estimate(levels).probability
            within += p.lower <= true <= p.upper
            found.append(p.value)
    return within, len(found), float(np.mean(found)) / true if found else math.nan


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--case", action="append", choices=CASES)
    asked = parser.parse_args()
    print("| case | mean over true | interval holds in | at least | did not end |\n|---|---|---|---|---|")
    for name in asked.case or CASES:
        within, ended, mean = held(name, asked.count, asked.runs)
        share = clopper_pearson(within, ended)
        print(
            f"| {name} | {mean:.2f} | {100 * share.value:.1f} % | {100 * share.lower:.1f} % "
            f"| {asked.runs - ended} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
