"""Controllers tuned alike on elastic arms, encoders at the motors: six arms, three seeds.

    python benchmarks/contest.py [--out FILE] [--arms ARM ...] [--rivals NAME ...] [--evaluations N]
    python benchmarks/contest.py --table FILE

Each controller has the same number of candidates, scenarios and seeds, and all its numbers are free:
damping, filter, and where it has one a schedule, by which it is faster where the error is large. A search
finds the least ITAE at each budget of torque variation on FIT scenarios of the uncertainty model `elastic`:
friction, wrong rotors and inertia, an unknown load, a torque step, encoders of 16 bits behind a gear, one
sample late at 1 kHz. Tables have what the choices come to on HELD_OUT other scenarios, the median of the
seeds. All measure positions alone; what they know of the model is in the table. It may be stopped: what is in
FILE is not run again.

A proportional position loop around a proportional-integral velocity loop, as drives have it (`cascade`), is
a PID with D(q) replaced by a constant inertia; with D(q) it is `cascade_model`. `slotineli_regressor` adapts
the mass of each body by the arm's regressor, and friction. They are in benchmarks/_rivals.py.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
import time
import warnings
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import _rivals  # noqa: F401 (its controllers have to be there before experiment files are read)
import numpy as np

from armgpi import Robot, config
from armgpi.base.escape import markdown_table
from armgpi.health.zoo import fingers
from armgpi.plants.reality import scales
from armgpi.studies.contend import draws
from armgpi.studies.evaluation import Evaluator
from armgpi.studies.objective import Objective
from armgpi.studies.optimise import KEPT, Problem, Search
from armgpi.studies.space import Range, Space

ARMS = ("ur5", "panda", "z1", "kinova", "xarm7", "ur10")
SEEDS = 3
#: Mean torque variation that is allowed, over the sum of the joints' largest gravity torques [-].
BUDGETS = (0.7, 1.0, 2.0)
#: Scenarios that are searched on and judged on; the latter begin far from the former.
FIT, HELD_OUT, APART = 3, 8, 1 << 20
EVALUATIONS, POPULATION = 127, 6
#: How many times the best one's error is as good.
WITHIN = 1.1


class Rival(NamedTuple):
    """A controller: its section of an experiment file, what is searched, and what it knows of the model."""

    section: dict[str, Any]
    free: tuple[str, ...]
    knows: str
    gpi: bool = False


_SPLIT = {"integrators": 1, "omega": 20.0, "zeta": 0.7, "second_ratio": 4.0, "second_zeta": 5.0}
_FEEDBACK = {"link_factor": 0.5, "rotor_factor": 1.5}
_SPLIT_FREE = ("omega", "zeta", "second_ratio", "second_zeta", "link_factor", "rotor_factor")
_SCHEDULE = ("attack", "error_range", "dead_zone")
_SLOW = {"omega_c": 8.0, "omega_o": 40.0}
RIVALS = {
    "GPI, derivative filter apart": Rival(
        {"type": "gpi", "feedforward": "computed", **_SPLIT, **_FEEDBACK}, _SPLIT_FREE, "model", True
    ),
    "GPI, the same, schedule": Rival(
        {
            **{"type": "schedule", "feedforward": "computed", **_SPLIT, **_FEEDBACK},
            "omega": {"lower": 15.0, "upper": 25.0},
        },
        (*_SPLIT_FREE, *_SCHEDULE),
        "model",
        True,
    ),
    "computed torque, observer, schedule": Rival(
        {"type": "ctdob", **_SLOW, "zeta": 1.0, "rise": 1.5},
        ("omega_c", "omega_o", "zeta", "rise", *_SCHEDULE),
        "model",
    ),
    "PID + inversion, positions": Rival(
        {"type": "pid_positions", "kp": 200.0, "ki": 600.0, "kd": 25.0, "filter": 400.0},
        ("kp", "ki", "kd", "filter"),
        "model",
    ),
    "cascade with D(q), schedule": Rival(
        {"type": "cascade_model", "kp": 8.0, "ki": 60.0, "kd": 20.0, "filter": 400.0},
        ("kp", "ki", "kd", "filter", "rise", *_SCHEDULE),
        "model",
    ),
    "cascade, constant inertia, schedule": Rival(
        {"type": "cascade", "kp": 8.0, "ki": 60.0, "kd": 20.0, "filter": 400.0},
        ("kp", "ki", "kd", "filter", "rise", *_SCHEDULE),
        "model",
    ),
    "super-twisting": Rival(
        {"type": "supertwisting", **_SLOW}, ("omega_c", "omega_o", "slope", "layer"), "model"
    ),
    "Slotine-Li, regressor": Rival(
        {"type": "slotineli_regressor", **_SLOW},
        ("omega_c", "omega_o", "adaptation", "damping", "layer"),
        "model",
    ),
    "GPI, inertia alone": Rival(
        {"type": "gpi", "feedforward": "none", **_SPLIT, **_FEEDBACK}, _SPLIT_FREE, "inertia", True
    ),
    "ADRC, order 3, schedule": Rival(
        {"type": "adrc", "order": 3, **_SLOW, "zeta": 1.0, "rise": 1.5},
        ("omega_c", "omega_o", "zeta", "rise", *_SCHEDULE),
        "inertia",
    ),
}


def budgets_of(robot: Robot) -> tuple[float, ...]:
    """Return the budgets of torque variation of an arm [N m]."""
    weight = float(scales(robot).gravity.sum())
    return tuple(share * weight for share in BUDGETS)


class Scenarios(NamedTuple):
    """The scenarios of an arm: searched on, and judged on."""

    searched: Evaluator
    judged: Evaluator

    @classmethod
    def of(cls, robot: Robot) -> Scenarios:
        """Return those of an arm."""
        both = ((FIT, 0), (HELD_OUT, APART))
        return cls(*(Evaluator(draws(robot, count, first, "elastic"), KEPT) for count, first in both))


def searched(robot: Robot, scenarios: Scenarios, rival: Rival, seed: int, evaluations: int) -> list[float]:
    """Return the error of a rival on the scenarios to judge by at each budget; infinite where it has none."""
    made = config.controller(rival.section, scenarios.searched.draws[0].context)
    budgets = budgets_of(robot)
    problem = Problem(
        Space(rival.section, made, {key: Range() for key in rival.free}),
        Objective("itae"),
        scenarios.searched,
        scenarios.judged,
        budgets=budgets,
        evaluations=evaluations,
        population=POPULATION,
        seed=seed,
    )
    search = Search(problem)
    search.run()
    found = {each.budget: each.held_out.objective for each in search.validate()}
    return [found.get(budget, math.inf) for budget in budgets]


def run(given: argparse.Namespace) -> list[dict[str, Any]]:
    """Run what is not in the file yet, and return all rows."""
    rows = json.loads(given.out.read_text("utf-8")) if given.out.exists() else []
    arms: dict[str, tuple[Robot, Scenarios]] = {}
    # All arms before the next seed: what is stopped has as many of each.
    for seed, arm, name in itertools.product(range(given.seeds), given.arms, given.rivals):
        mark = {"arm": arm, "rival": name, "seed": seed, "evaluations": given.evaluations}
        if any(all(row[key] == value for key, value in mark.items()) for row in rows):
            continue
        if arm not in arms:
            robot = Robot.load(arm, fingers(arm))
            arms[arm] = robot, Scenarios.of(robot)
        robot, scenarios = arms[arm]
        begun = time.process_time()
        errors = searched(robot, scenarios, RIVALS[name], seed, given.evaluations)
        spent = time.process_time() - begun
        rows.append({**mark, "budgets": budgets_of(robot), "errors": errors, "seconds": spent})
        given.out.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        print(f"{arm}, {name}, {seed}: {errors} in {spent:.1f} s", file=sys.stderr, flush=True)
    return list(rows)


def medians(rows: list[dict[str, Any]], arm: str) -> dict[str, list[float]]:
    """Return rival -> the median over the seeds of its error at each budget."""
    found: dict[str, list[list[float]]] = {}
    for row in rows:
        if row["arm"] == arm:
            found.setdefault(row["rival"], []).append(row["errors"])
    return {name: np.median(np.array(errors), axis=0).tolist() for name, errors in found.items()}


def complete(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows of the seeds that all controllers of an arm have."""
    names: dict[str, set[str]] = {}
    counts: Counter[tuple[str, int]] = Counter()
    for row in rows:
        names.setdefault(row["arm"], set()).add(row["rival"])
        counts[row["arm"], row["seed"]] += 1
    return [row for row in rows if counts[row["arm"], row["seed"]] == len(names[row["arm"]])]


def table(rows: list[dict[str, Any]]) -> str:
    """Return, as Markdown, errors arm by arm, and how GPI compares in each cell."""
    parts, cells = [], []
    rows = complete(rows)
    for arm in dict.fromkeys(row["arm"] for row in rows):
        errors = medians(rows, arm)
        budgets = next(row["budgets"] for row in rows if row["arm"] == arm)
        seeds = len({row["seed"] for row in rows if row["arm"] == arm})
        head = (
            f"{arm} (seeds: {seeds}): variation up to [N m]",
            "knows",
            *(f"{x:.0f}" for x in budgets),
        )
        lines = []
        ratios: dict[str, list[str]] = {}
        for knows in ("model", "inertia"):
            here = {name: values for name, values in errors.items() if RIVALS[name].knows == knows}
            for name, values in here.items():
                best = [min(other[k] for other in here.values()) for k in range(len(budgets))]
                marked = [
                    "-" if math.isinf(x) else f"**{x:.3g}**" if x <= WITHIN * y else f"{x:.3g}"
                    for x, y in zip(values, best, strict=True)
                ]
                lines.append((name, knows, *marked))
            for k in range(len(budgets)):
                ours = min((v[k] for name, v in here.items() if RIVALS[name].gpi), default=math.inf)
                theirs = min((v[k] for name, v in here.items() if not RIVALS[name].gpi), default=math.inf)
                ratios.setdefault(knows, []).append(compared(ours, theirs))
                cells.append((ours, theirs))
        lines += [(f"*best GPI over best other, {knows}*", "", *each) for knows, each in ratios.items()]
        parts.append(markdown_table(head, lines))
    sound = [(ours, theirs) for ours, theirs in cells if min(ours, theirs) < math.inf]
    first = sum(ours <= theirs for ours, theirs in sound)
    within = sum(ours <= WITHIN * theirs for ours, theirs in sound)
    parts.append(f"GPI is first in {first} of {len(sound)} cells, first or within 10 % in {within}.")
    return "\n".join(parts)


def compared(ours: float, theirs: float) -> str:
    """Return a quotient of errors, or who has none."""
    if math.isinf(ours) or math.isinf(theirs):
        return "neither" if ours == theirs else "others alone" if math.isinf(ours) else "GPI alone"
    return f"{ours / theirs:.2f}"


def main() -> None:
    """Run the contest, and print its tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("contest.json"), help="what was found")
    parser.add_argument("--table", type=Path, help="print the tables of a file, and run nothing")
    parser.add_argument("--arms", nargs="+", default=list(ARMS))
    parser.add_argument("--rivals", nargs="+", default=list(RIVALS), choices=list(RIVALS))
    parser.add_argument("--evaluations", type=int, default=EVALUATIONS, help="candidates of each search")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    if given.table:
        print(table(json.loads(given.table.read_text("utf-8"))))
        return
    print(table(run(given)))


if __name__ == "__main__":
    main()
