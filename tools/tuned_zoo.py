"""The zoo with and without tuning: every arm under the rule for untuned arms, and under what `tune` finds.

Usage:
    python tools/tuned_zoo.py --out tuned           # all arms; goes on where it was stopped
    python tools/tuned_zoo.py ur5 panda

An arm is tuned as one is that stands in a laboratory: at one sample time, delay and encoder, on draws of the
geared reality that its motors can follow. A search begins at the rule's numbers, wants less ITAE and no
hunting, and may spend no more torque variation than the rule does. Both are judged on other draws.
"""

from __future__ import annotations

import argparse
import math
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armgpi import config
from armgpi.base.escape import markdown_table
from armgpi.errors import ArmgpiError, ArmgpiWarning, RolloutError
from armgpi.health import reality as health
from armgpi.health.zoo import BITS, DELAY, DT, fingers
from armgpi.loop import metrics
from armgpi.plants.reality import Reality, Scenario
from armgpi.robot import robots
from armgpi.robot.robot import Robot
from armgpi.studies.evaluation import Evaluator
from armgpi.studies.objective import Objective
from armgpi.studies.optimise import KEPT, Problem, Search
from armgpi.studies.space import Range, Space
from armgpi.studies.study import BadPart, Identity, NoRoom, Study, part_name, rows

#: The rule, and by which factor bandwidths may leave its own: searches of a hundred candidates begin nearby.
RULE = {"type": "gpi_auto"}
_FACTOR = 2.0
#: What it wants: beyond the band of an arm at rest a milliradian costs as much as e times the ITAE.
WANTED = f"log(itae) + 1000*max(hunting_amplitude, {health.HUNTING})"
#: What is worked out of every rollout.
_NAMES = (*KEPT, "hunting_amplitude")
#: Held-out draws begin so many after those that are searched on; so many are drawn to find one that motors
#: can follow.
_APART, _TRIES = 1 << 11, 8


class Judged(NamedTuple):
    """What came out of held-out draws.

    Attributes:
        failed: share that failed [-].
        hunting: share that moves at rest [-].
        peak: median of the largest error [rad or m]; infinite where most diverge.
        itae: median of the sum of the joints' ITAE [rad s^2 or m s^2], likewise.
        variation: median torque variation [N m or N], likewise.
    """

    failed: float
    hunting: float
    peak: float
    itae: float
    variation: float

    @classmethod
    def of(cls, found: Sequence[health.Outcome]) -> Judged:
        """Return what came out of draws."""
        shares = (float(np.mean([getattr(x, name) for x in found])) for name in ("failed", "hunting"))
        costs = ("peak", "itae", "variation")
        return cls(*shares, *(float(np.median([getattr(x, name) for x in found])) for name in costs))


class Row(NamedTuple):
    """One arm.

    Attributes:
        arm: its name.
        n: number of joints, grippers locked.
        rule: what it is under the rule.
        tuned: what it is tuned; None where no candidate holds on the held-out draws.
        values: the numbers that were found, by name.
    """

    arm: str
    n: int
    rule: Judged
    tuned: Judged | None
    values: dict[str, float]


def as_row(arm: str, n: int, rule: list[float], tuned: list[float] | None, values: dict[str, float]) -> Row:
    """Return a row from plain data; see :class:`Row`."""
    return Row(arm, n, Judged(*rule), None if tuned is None else Judged(*tuned), values)


def run(name: str, evaluations: int, held_out: int, seed: int = 0) -> Row:
    """Tune an arm and return it beside the rule.

    Args:
        name: of the arm.
        evaluations: candidates.
        held_out: draws to judge on; half as many are searched on.
        seed: of the draws and of the search.

    Raises:
        BackendError: when the optimiser's library is not installed.
        RolloutError: when motors can follow too few draws.
        ArmgpiError: when the arm cannot be loaded.
    """
    robot = Robot.load(name, fingers(name))
    delay, bits = (float(DELAY),) * 2, (float(BITS),) * 2
    reality = Reality.geared(seed, sample_time=[DT], delay=delay, encoder_bits=bits, effort_share=0.0)
    first = health.first_index(name)
    searched, judged = (
        Evaluator(_feasible(reality, robot, begin, number), _NAMES)
        for begin, number in ((first, max(held_out // 2, 1)), (first + _APART, held_out))
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)
        made = config.controller(RULE, searched.draws[0].context)
    omega = made.gains.nominal().omega_c  # type: ignore[attr-defined]
    near = Range(float(omega.min()) / _FACTOR, float(omega.max()) * _FACTOR, per_joint=True)
    space = Space(RULE, made, {"omega": near, "zeta": Range(0.5, 2.0), "rolloff_ratio": Range(2.0, 16.0)})
    # As much as the rule spends, whose numbers differ a little from draw to draw, or where the search begins.
    spent = searched(RULE, [{}]), searched(RULE, [space.keys(space.start)])
    budget = max(float(each.values["total_variation"].mean()) for each in spent)
    asked: Any = {"budgets": (budget,), "evaluations": evaluations, "population": 8, "seed": seed}
    search = Search(Problem(space, Objective(WANTED), searched, judged, **asked))
    search.run()
    found = search.validate()

    def judge(section: dict[str, Any]) -> Judged:
        return Judged.of(health.outcomes(judged.draws, name, section))

    values: dict[str, Any] = {}
    tuned = None
    if found:
        x = found[0].row.x
        values = dict(zip(space.names, space.values(x).tolist(), strict=True))
        tuned = judge(space.with_values(x))
    return Row(name, robot.n, judge(RULE), tuned, values)


def _feasible(reality: Reality, robot: Robot, first: int, number: int) -> list[Scenario]:
    """Return the first draws that motors can follow.

    Raises:
        RolloutError: when there are too few.
    """
    found: list[Scenario] = []
    for tried in range(_TRIES * number):
        draw = reality.draw(robot, first + tried)
        if health.demand(draw) <= 1.0:
            found.append(draw)
        if len(found) == number:
            return found
    raise RolloutError(f"{robot.name}: its motors can follow {len(found)} of {_TRIES * number} draws alone")


def markdown(rows: Sequence[Row]) -> str:
    """Return rows as a Markdown table, and geometric means of what tuning changes."""
    said = ("ITAE", "peak", "torque variation", "hunting [%]", "failed [%]")
    head = ("robot", "n", *(f"{name}, automatic → tuned" for name in said), "ITAE, tuned over automatic")
    lines = [(row.arm, str(row.n), *_cells(row.rule, row.tuned), _ratio(row, "itae")) for row in rows]
    both = [row for row in rows if row.tuned is not None]
    table = markdown_table(head, lines)
    if not both:
        return table
    means = (
        f"{name} {math.exp(np.mean([math.log(_quotient(row, name)) for row in both])):.2f}"
        for name in ("itae", "peak", "variation")
    )
    shares = (
        f"{name} {100.0 * np.mean([getattr(x, name) for x in side]):.1f} %"
        for side in ([row.rule for row in both], [row.tuned for row in both])
        for name in ("hunting", "failed")
    )
    return (
        f"{table}\nTuned over rule, geometric mean of {len(both)} arms: {', '.join(means)}. "
        "Rule: {}, {}; tuned: {}, {}.\n".format(*shares)
    )


def _quotient(row: Row, name: str) -> float:
    """Return a median of the tuned arm over that under the rule."""
    return float(getattr(row.tuned, name) / getattr(row.rule, name))


def _ratio(row: Row, name: str) -> str:
    """Return the same as text."""
    return "none holds" if row.tuned is None else f"{_quotient(row, name):.2f}"


def _cells(rule: Judged, tuned: Judged | None) -> list[str]:
    """Return both values of every column."""
    told = [_column_values(rule), ["-"] * 5 if tuned is None else _column_values(tuned)]
    return [" → ".join(pair) for pair in zip(*told, strict=True)]


def _column_values(judged: Judged) -> list[str]:
    """Return the values of a column each."""
    sizes = [metrics.short(x, 3) for x in (judged.itae, judged.peak, judged.variation)]
    return [*sizes, *(f"{100.0 * x:.0f}" for x in (judged.hunting, judged.failed))]


def main(arguments: list[str] | None = None) -> int:
    """Tune arms and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("arms", nargs="*", help="all by default")
    parser.add_argument("--evaluations", type=int, default=97, help="candidates for each arm")
    parser.add_argument("--count", type=int, default=16, help="held-out draws of each arm")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("tuned"), help="folder of the searches")
    given = parser.parse_args(arguments)
    numbers = [given.evaluations, given.count, given.seed]
    asked = {"script": Path(__file__).read_text(encoding="utf-8"), "numbers": numbers}
    study, found = Study.enter(given.out, Identity(asked)), []
    for arm in given.arms or robots.names():
        try:
            found += rows(study.part, part_name(arm), as_row, lambda name=arm: [run(name, *numbers)])
        except (BadPart, NoRoom):  # none can be kept
            raise
        except ArmgpiError as error:
            print(f"not run: {arm}: {error}", file=sys.stderr)
    print(markdown(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
