"""Fit the rule for arms that nobody tuned with the search of `armgpi tune`, and judge it on other arms.

Usage:
    python tools/rule.py --out fitted               # goes on where it was stopped
    python tools/rule.py --judge fitted/rule.json   # the rule's numbers and these, on both halves of the arms

All candidates meet the same draws of the arms to fit. What is least is the mean of log(ITAE) over the draws
that the motors can follow, plus WEIGHTS times the shares of draws that are lost, hunt, swing or chatter. The
best ones are validated on other draws of the same arms; the arms that are held out decide nothing.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from armgpi import Reality
from armgpi.base import files
from armgpi.base.arrays import Array
from armgpi.errors import ArmgpiError
from armgpi.gpi import payload
from armgpi.health import reality as health
from armgpi.plants.reality import Scenario
from armgpi.studies.evaluation import Evaluated
from armgpi.studies.objective import Judged
from armgpi.studies.optimise import KEPT, Problem, Search
from armgpi.studies.space import Dimension, Space
from armgpi.studies.study import Identity, Study
from armgpi.tuning import rule as arm_rule

sys.path.append(str(Path(__file__).resolve().parent))
from reality import arms as arms_of

#: The halves of the arms.
PARTS = ("fit", "held-out")
#: What a share of draws costs, in natural logarithms of the ITAE.
WEIGHTS = {"failed": 10.0, "hunting": 2.0, "swinging": 1.0, "chatter": 2.0}
#: The ITAE of a rollout that diverged [rad s^2].
_DIVERGED = 10.0


class Constant(NamedTuple):
    """A number of the rule: the modules that have it, and from where to where it is searched."""

    modules: tuple[ModuleType, ...]
    low: float
    high: float


#: Not among them is the crossover frequency beyond which arms are not stiff: the arms of a reality are.
CONSTANTS = {
    "DELAY_SHARE": Constant((arm_rule, payload), 0.5, 0.97),
    "RATIO": Constant((arm_rule,), 2.0, 12.0),
    "LATE_RATIO": Constant((arm_rule,), 2.0, 20.0),
    "TORQUE_SHARE": Constant((arm_rule,), 0.0015, 0.03),
    "REST_ZONE": Constant((arm_rule,), 3e-5, 3e-3),
    "_PLAUSIBLE": Constant((payload,), 0.005, 0.2),
    "zeta": Constant((), 0.6, 1.8),
}


class Rule(Space):
    """The numbers of the rule as a cube; what is no constant is a key of the controller's section."""

    def __init__(self) -> None:
        """Begin at today's numbers."""
        today = {
            name: getattr(each.modules[0], name) if each.modules else 1.0 for name, each in CONSTANTS.items()
        }
        self.section = {"type": "gpi_auto"}
        self.dimensions = [
            Dimension(name, "", None, None, each.low, each.high, True, today[name])
            for name, each in CONSTANTS.items()
        ]
        self.names, self.joints = list(CONSTANTS), ()


@contextmanager
def rule(numbers: Mapping[str, float]) -> Iterator[dict[str, Any]]:
    """Give the rule other numbers for a while; yields the controller's section."""
    inside = [(module, name) for name in numbers for module in CONSTANTS[name].modules]
    before = [getattr(module, name) for module, name in inside]
    for module, name in inside:
        setattr(module, name, numbers[name])
    try:
        rest = {name: value for name, value in numbers.items() if not CONSTANTS[name].modules}
        yield {"type": "gpi_auto", **rest}
    finally:
        for (module, name), value in zip(inside, before, strict=True):
            setattr(module, name, value)


class Arms:
    """Runs candidates on draws of arms; an evaluator of a :class:`Search`."""

    def __init__(self, names: Sequence[str], reality: Reality, every: int) -> None:
        """Draw so many of every arm that has motors."""
        self.by_arm: dict[str, list[Scenario]] = {}
        for name in names:
            try:
                drawn = health.draws(reality, name, every)
                _ = drawn[0].plant  # of an arm without motors there is none
                self.by_arm[name] = drawn
            except ArmgpiError as error:
                print(f"not run: {name}: {error}", file=sys.stderr)
        self.draws = [draw for found in self.by_arm.values() for draw in found]

    def outcomes(self, numbers: Mapping[str, float]) -> list[health.Outcome]:
        """Return what the rule with these numbers makes of the draws."""
        with rule(numbers) as section:
            return [x for name, own in self.by_arm.items() for x in health.outcomes(own, name, section)]

    def __call__(self, section: Mapping[str, Any], candidates: Sequence[Mapping[str, float]]) -> Evaluated:
        """Return what came out of candidates; see :class:`armgpi.studies.evaluation.Evaluator`."""
        found = [self.outcomes(each) for each in candidates]
        values = {
            name: np.array([[float(getattr(x, name)) for x in row] for row in found])
            for name in (*WEIGHTS, "peak", "itae", "feasible")
        }
        values |= dict.fromkeys(KEPT, values["itae"])
        return Evaluated(values, np.zeros(values["itae"].shape, dtype=bool))


class Wanted:
    """What the fit minimises; an objective of a :class:`Search`."""

    names = ("itae", *WEIGHTS)

    def judge(self, values: Mapping[str, Array], failed: Array) -> Judged:
        """Return what candidates are worth; what motors cannot follow counts nowhere."""
        counts = values["feasible"]
        itae = np.minimum(values["itae"], _DIVERGED)
        cost = np.log(itae) + sum(weight * values[name] for name, weight in WEIGHTS.items())
        zero = np.zeros(len(counts))
        return Judged((counts * cost).sum(axis=1) / counts.sum(axis=1), zero, zero)


def fit(folder: Path, evaluations: int, every: int, seed: int) -> dict[str, float]:
    """Return the numbers that are best on draws of the arms to fit that the search did not see."""
    names = arms_of("fit")
    space = Rule()
    search = Search(
        Problem(
            space,
            Wanted(),  # type: ignore[arg-type]
            Arms(names, Reality.geared(seed, block=every), every),  # type: ignore[arg-type]
            Arms(names, Reality.geared(seed + 1), 8),  # type: ignore[arg-type]
            evaluations=evaluations,
            population=8,
            seed=seed,
        )
    )
    script = Path(__file__).read_text(encoding="utf-8")
    asked = {"method": "rule", "script": script, "evaluations": evaluations, "every": every, "seed": seed}
    study, begun = Study.enter(folder, Identity(asked)), time.monotonic()

    def told(search: Search) -> None:
        best = min(search.rows, key=lambda row: row.objective)
        at = dict(zip(space.names, space.values(best.x).round(5).tolist(), strict=True))
        print(f"{len(search.rows)}: {best.objective:.4f} {at}, {time.monotonic() - begun:.0f} s", flush=True)

    search.run(told, study.part)
    given, chosen = search.judge_start(), search.rank()[:6]
    held = search.judge(search.problem.held_out, [row.x for row in chosen])
    best = min(held, key=lambda row: row.objective)
    print(f"other draws of these arms: {given.objective:.4f} today, {best.objective:.4f} the best one")
    return {name: float(f"{value:.3g}") for name, value in space.keys(best.x).items()}


def judged(numbers: Mapping[str, float], part: str, reality: Reality, every: int) -> str:
    """Return, as Markdown, what the rule is with today's numbers and with others on the same draws."""
    arms = Arms(arms_of(part), reality, every)
    found = {f"{part}, today": arms.outcomes({}), f"{part}, fitted": arms.outcomes(numbers)}
    pairs = [
        (a, b) for a, b in zip(*found.values(), strict=True) if a.feasible and not (a.failed or b.failed)
    ]
    found |= {f"{label}, feasible": [x for x in rows if x.feasible] for label, rows in found.items()}
    logs = np.array([[math.log(b.itae / a.itae), math.log(b.peak / a.peak)] for a, b in pairs])
    mean, error = np.exp(logs.mean(axis=0)), 1.96 * logs.std(axis=0) / math.sqrt(len(logs))
    compared = (
        f"{name} {mean[i]:.3f} (x / {math.exp(error[i]):.3f})" for i, name in enumerate(("ITAE", "peak"))
    )
    table = health.markdown(found, "arms and numbers")
    return f"{table}\nFitted over today, geometric mean of feasible draws: {', '.join(compared)}\n"


def main(arguments: list[str] | None = None) -> int:
    """Fit, or judge what was fitted."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("rule"), help="folder of the fit")
    parser.add_argument("--evaluations", type=int, default=120, help="candidates")
    parser.add_argument("--every", type=int, default=6, help="draws of each arm that are searched on")
    parser.add_argument("--seed", type=int, default=15)
    parser.add_argument("--judge", type=Path, metavar="FILE", help="numbers to judge in place of fitting")
    parser.add_argument("--parts", nargs="+", default=PARTS, choices=PARTS, help="arms to judge on")
    parser.add_argument("--count", type=int, default=16, help="draws of each arm to judge on")
    given = parser.parse_args(arguments)
    if given.judge is None:
        given.out.mkdir(parents=True, exist_ok=True)
        found = fit(given.out, given.evaluations, given.every, given.seed)
        files.write(given.out / "rule.json", json.dumps(found, indent=1) + "\n")
        print(found)
        return 0
    numbers = json.loads(given.judge.read_text(encoding="utf-8"))
    for part in given.parts:
        seed = 2026 if part == "held-out" else given.seed + 2
        print(judged(numbers, part, Reality.geared(seed), given.count))
    return 0


if __name__ == "__main__":
    sys.exit(main())
