"""More tables of a benchmark of controllers, from its folder.

Run `armgpi benchmark controllers --out contest; python tools/contest.py contest`.

Prints two tables: the rule for arms that nobody tuned beside rivals that are tuned for its torque variation,
and what numbers found on one arm are on the others. Takes the arms and laws of the contest; what is missing
of it is run.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from armgpi import Robot, config
from armgpi.base.arrays import Array
from armgpi.base.escape import markdown_table
from armgpi.health.zoo import fingers
from armgpi.studies.contend import (
    _APART,
    ARMS,
    BUDGETS,
    CONTENDERS,
    QUICK,
    Entry,
    Setting,
    budgets_of,
    draws,
    enter,
    problem,
    ratio,
    run,
)
from armgpi.studies.evaluation import Evaluator
from armgpi.studies.optimise import KEPT, Search
from armgpi.studies.space import Space
from armgpi.studies.study import Study, part_name

#: What the rule for arms that nobody tuned is held against, tuned for the torque variation that it has.
RIVALS = ("ADRC, order 3", "ADRC, order 4")


class Untuned(NamedTuple):
    """The rule for arms that nobody tuned on one arm, and rivals that are tuned for its torque variation.

    Attributes:
        arm: its name.
        objective: of the rule on the held-out draws.
        variation: of torque, likewise [N m].
        rivals: law -> objective and variation on the held-out draws, median of the seeds; infinite where no
            candidate holds.
    """

    arm: str
    objective: float
    variation: float
    rivals: dict[str, list[float]]


def untuned(study: Study, arm: str, setting: Setting) -> Untuned:
    """Return what the rule is on an arm, and what its rivals are; read from the study where it is there."""

    def run() -> Array:
        robot, section = Robot.load(arm, fingers(arm)), {"type": "gpi_auto"}
        spent, judged = (
            Evaluator(draws(robot, count, first), KEPT)(section, [{}])
            for count, first in ((setting.fit, 0), (setting.held_out, _APART))
        )
        budget = float(spent.values["total_variation"].mean())
        own = [float(judged.values[name].mean()) for name in ("itae", "total_variation")]
        return np.array([own, *(_rival(arm, law, setting, budget) for law in RIVALS)])

    (objective, variation), *rivals = study.part(
        part_name(arm, "gpi_auto", setting.seeds), (1 + len(RIVALS), 2), run
    ).tolist()
    return Untuned(arm, objective, variation, dict(zip(RIVALS, rivals, strict=True)))


def _rival(arm: str, law: str, setting: Setting, budget: float) -> list[float]:
    """Return objective and variation of a law that is tuned for a budget, the median of the seeds."""
    rows = []
    for seed in range(setting.seeds):
        whole = problem(arm, law, seed, setting)
        # As many candidates as each budget of a contest has.
        search = Search(
            whole._replace(budgets=(budget,), evaluations=setting.evaluations // len(BUDGETS) + 1)
        )
        search.run()
        rows.append([(x.held_out.objective, x.held_out.means["total_variation"]) for x in search.validate()])
    values = np.array([row[0] if row else (math.inf, math.inf) for row in rows])
    return [float(x) for x in np.median(values, axis=0)]


def untuned_table(found: Sequence[Untuned]) -> str:
    """Return, as Markdown, the rule beside laws that are tuned for its variation, with quotients of error."""
    head = ("error at torque variation [N m]", "gpi_auto", *RIVALS, "untuned over the best ADRC")
    lines = []
    for each in found:
        best = min(each.rivals[law][0] for law in RIVALS if not CONTENDERS[law].gpi)
        pairs = ([each.objective, each.variation], *(each.rivals[law] for law in RIVALS))
        cells = [f"{error:.3g} at {spent:.3g}" for error, spent in pairs]
        lines.append((each.arm, *cells, ratio(each.objective, best)))
    return markdown_table(head, lines)


#: Laws whose numbers are tried on the other arms; the first one is what they are compared with.
TRANSFERRED = (
    *("GPI, roll-off", "GPI, schedule, roll-off", "GPI, network, roll-off", "GPI, trained network, roll-off"),
    *("GPI, printed controller", "ADRC, order 3"),
)


class Transferred(NamedTuple):
    """Numbers found on one arm, on another.

    Attributes:
        law: label.
        source: arm that they were found on.
        target: arm that they were tried on.
        budget: place of the budget that they were found for.
        objective: on the held-out draws of the target; infinite where it diverged.
        variation: of torque, likewise.
    """

    law: str
    source: str
    target: str
    budget: int
    objective: float
    variation: float


def transferred(entries: Sequence[Entry], setting: Setting) -> list[Transferred]:
    """Return what numbers found on one arm are on the held-out draws of the others."""
    arms = list(dict.fromkeys(entry.arm for entry in entries))
    found = []
    for target in arms if len(arms) > 1 else ():
        robot = Robot.load(target, fingers(target))
        evaluator = Evaluator(draws(robot, setting.held_out, _APART), KEPT)
        for law in TRANSFERRED:
            others = [entry for entry in entries if entry.law == law and entry.arm != target]
            found += _tried(evaluator, target, law, others)
    return found


def _tried(evaluator: Evaluator, target: str, law: str, others: Sequence[Entry]) -> list[Transferred]:
    """Return what the numbers of some entries are on an arm."""
    tried = [
        (entry.arm, budgets_of(entry.arm).index(budget), each["values"])
        for entry in others
        for budget, each in entry.budgets.items()
    ]
    if not tried:
        return []
    section = CONTENDERS[law].section
    space = Space(section, config.controller(section, evaluator.draws[0].context), CONTENDERS[law].free)
    done = evaluator(section, [space.keys_of(values) for _, _, values in tried])
    objective, variation = (
        np.where(done.failed, math.inf, done.values[name]).mean(axis=1)
        for name in ("itae", "total_variation")
    )
    return [
        Transferred(law, source, target, place, float(objective[i]), float(variation[i]))
        for i, (source, place, _) in enumerate(tried)
    ]


def transfer_table(found: Sequence[Transferred]) -> str:
    """Return, as Markdown, what laws are on arms that their numbers were not found on, over the first law.

    Quotients of error and of torque variation, geometric means over pairs of arms and seeds, and how many
    failed.
    """
    head = ("numbers of another arm", *(f"budget {i + 1}" for i in range(len(BUDGETS))), "failed")
    lines = []
    for law in TRANSFERRED:
        own = [each for each in found if each.law == law]
        if not own:
            continue
        cells = [_quotients(found, law, place) for place in range(len(BUDGETS))]
        failed = sum(not math.isfinite(each.objective) for each in own)
        lines.append((law, *cells, f"{failed} of {len(own)}"))
    return markdown_table(head, lines)


def _quotients(found: Sequence[Transferred], law: str, place: int) -> str:
    """Return the quotients of a law over the first one at a budget: error, and torque variation."""
    pairs: dict[tuple[str, str], dict[str, list[Transferred]]] = {}
    for each in found:
        if each.budget == place and each.law in (law, TRANSFERRED[0]) and math.isfinite(each.objective):
            pairs.setdefault((each.source, each.target), {}).setdefault(each.law, []).append(each)
    both = [pair for pair in pairs.values() if law in pair and TRANSFERRED[0] in pair]
    if not both:
        return "-"
    error, variation = (
        math.exp(np.mean([_log(pair[law], name) - _log(pair[TRANSFERRED[0]], name) for pair in both]))
        for name in ("objective", "variation")
    )
    return f"{error:.2f} at {variation:.2f}"


def _log(found: Sequence[Transferred], name: str) -> float:
    """Return the mean logarithm of a value."""
    return float(np.mean([math.log(getattr(each, name)) for each in found]))


def main(arguments: list[str] | None = None) -> int:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="of the contest")
    parser.add_argument("--arms", nargs="+", default=list(ARMS))
    parser.add_argument("--laws", nargs="+", default=list(CONTENDERS))
    parser.add_argument("--evaluations", type=int, default=Setting().evaluations)
    parser.add_argument("--seeds", type=int, default=Setting().seeds)
    parser.add_argument("--quick", action="store_true", help="a contest that was quick")
    parser.add_argument("--accept-code", action="store_true", help="of a contest that other code has run")
    given = parser.parse_args(arguments)
    setting = QUICK if given.quick else Setting(given.evaluations, given.seeds)
    study = enter(given.folder, setting, given.accept_code)
    entries = run(study, given.arms, given.laws, setting, print)
    print(untuned_table([untuned(study, arm, setting) for arm in given.arms]))
    print(transfer_table(transferred(entries, setting)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
