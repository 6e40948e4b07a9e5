"""Fit the numbers of the rule for untuned arms (armgpi/control/untuned.py) by the search of `armgpi tune`.

Usage:
    python tools/fit_rule.py --draws 57 --evaluations 80 --judged 114

It searches on draws of the geared reality over the arms to fit on, for the least of 3 x lost + hunting +
chatter (as shares of the draws) + 0.3 x the mean logarithm of the ITAE over that of the rule as it is, cut
at a tenth and at ten times. Both are then judged on other draws of these arms and of those held out.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping

import numpy as np

from armgpi import Reality
from armgpi.arrays import Array
from armgpi.control import untuned
from armgpi.errors import ArmgpiError
from armgpi.health import reality as health
from armgpi.plants.reality import Draw
from armgpi.search.optimisers import make

#: Number of the rule -> from where to where it is searched, by factors.
RANGES = {
    "CROSSOVER": (35.0, 140.0),
    "DELAY_SHARE": (0.4, 1.0),
    "TORQUE_SHARE": (0.002, 0.03),
    "RATIO": (2.0, 8.0),
    "REST_ZONE": (1e-5, 2e-3),
}
LAW = {"type": "untuned"}
SEARCHED, JUDGED = 11, 12


def main() -> None:
    """Search, then judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=57, help="draws to search on")
    parser.add_argument("--evaluations", type=int, default=80, help="rules that are tried")
    parser.add_argument("--judged", type=int, default=114, help="other draws that the result is judged on")
    given = parser.parse_args()
    now = {name: float(getattr(untuned, name)) for name in RANGES}
    drawn = _drawn("fit", SEARCHED, given.draws)
    before = _outcomes(drawn, now)
    search = make("cma", np.array([_place(name, now[name]) for name in RANGES]), seed=0)
    best, found, count = _score(before, before), now, 1
    print(f"as it is: {best:.4f}  {_words(now)}", flush=True)
    while count < given.evaluations:
        asked = search.ask()
        rules = [dict(zip(RANGES, map(_value, RANGES, x), strict=True)) for x in asked]
        scores = np.array([_score(_outcomes(drawn, rule), before) for rule in rules])
        search.tell(scores)
        count += len(rules)
        if scores.min() < best:
            best, found = float(scores.min()), rules[int(np.argmin(scores))]
        print(f"{count}: {best:.4f}  {_words(found)}", flush=True)
    for part in ("fit", "held-out"):
        others = _drawn(part, JUDGED, given.judged)
        table = {name: _outcomes(others, rule) for name, rule in (("as it is", now), ("fitted", found))}
        new, old = (_score(table[name], table["as it is"]) for name in ("fitted", "as it is"))
        print(
            f"\n{part}, other draws: score {new:.4f} against {old:.4f}\n\n{health.markdown(table)}",
            flush=True,
        )


def _drawn(part: str, seed: int, count: int) -> dict[str, list[Draw]]:
    """Return draws of each arm of a part that can be loaded."""
    names, found = health.arms(part), {}
    for place, name in enumerate(names):
        each = (count + len(names) - 1 - place) // len(names)
        try:
            found[name] = health.draws(Reality.geared(seed), name, each) if each else []
        except ArmgpiError as error:
            print(f"not run: {name}: {error}", file=sys.stderr)
    return found


def _outcomes(drawn: Mapping[str, list[Draw]], rule: Mapping[str, float]) -> list[health.Outcome]:
    """Return what a rule makes of draws."""
    for name, value in rule.items():
        setattr(untuned, name, value)
    return [each for name, draws in drawn.items() if draws for each in health.outcomes(draws, name, LAW)]


def _score(found: list[health.Outcome], before: list[health.Outcome]) -> float:
    """Return what is minimised."""
    bad = [3.0 * each.lost + each.hunting + each.chatter for each in found]
    ratios = [
        min(max(math.log(a.itae / b.itae), -math.log(10.0)), math.log(10.0))
        if math.isfinite(a.itae)
        else math.log(10.0)
        for a, b in zip(found, before, strict=True)
        if math.isfinite(b.itae)
    ]
    return float(np.mean(bad) + 0.3 * np.mean(ratios))


def _place(name: str, value: float) -> float:
    low, high = RANGES[name]
    return math.log(value / low) / math.log(high / low)


def _value(name: str, place: Array) -> float:
    low, high = RANGES[name]
    return float(low * (high / low) ** place)


def _words(rule: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.3g}" for name, value in rule.items())


if __name__ == "__main__":
    main()
