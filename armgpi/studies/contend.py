"""Laws held against each other: one search and one number of candidates for all.

Each law is searched for the least tracking error at several budgets of torque variation. What counts is how
its choices do on moves, loads, inertia factors and torque steps that no search saw. Laws are compared with
those that measure and know the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from armgpi import config
from armgpi.base.escape import markdown_table
from armgpi.errors import NameNotFound
from armgpi.health.reality import describe_knowledge as described
from armgpi.health.zoo import fingers
from armgpi.plants.reality import Reality, Scenario, scales
from armgpi.robot.robot import Robot
from armgpi.studies.evaluation import Evaluator
from armgpi.studies.objective import Objective
from armgpi.studies.optimise import KEPT, Problem, Search
from armgpi.studies.space import Range, Space
from armgpi.studies.study import Identity, Study, part_name
from armgpi.studies.study import rows as kept_rows

#: Arms of the contest, and what torque variation is allowed [N m]; small arms get a share of it.
ARMS = ("ur5", "panda", "kinova", "anthropomorphic3")
BUDGETS = (150.0, 300.0, 600.0, 1200.0, 2400.0, 4800.0)
_SMALL, _SMALL_SHARE = 3.0, 1.0 / 16.0
#: Heaviest unknown load [kg], but no more than this share of the arm.
_LOAD, _LOAD_SHARE = 0.5, 0.15
#: Draws that are searched on and evaluated on; the latter begin far from the former.
FIT, HELD_OUT, _APART = 8, 24, 1 << 20
#: How many times the best one's error is as good.
WITHIN = 1.1


class Contender(NamedTuple):
    """A law in the contest.

    Attributes:
        section: of an experiment file.
        free: keys that are searched.
        gpi: whether it is of the GPI family.
    """

    section: dict[str, Any]
    free: Mapping[str, Range]
    gpi: bool


#: Label -> law.
CONTENDERS = {
    label: Contender(
        each["law"],
        {key: Range(**ends) for key, ends in each["free"].items()},
        each["law"]["type"] in ("gpi", "schedule", "network"),
    )
    for label, each in yaml.safe_load(Path(__file__).with_name("contenders.yaml").read_text("utf-8")).items()
}


class Setting(NamedTuple):
    """How large a contest is.

    Attributes:
        evaluations: candidates for each law, arm and seed.
        seeds: searches of each law and arm.
        fit: draws that are searched on.
        held_out: draws that are evaluated on.
        reality: what the arms are; see :class:`armgpi.Reality`.
    """

    evaluations: int = 481
    seeds: int = 2
    fit: int = FIT
    held_out: int = HELD_OUT
    reality: str = "bare"


#: A contest of minutes.
QUICK = Setting(evaluations=60, seeds=1, fit=2, held_out=2)


class Entry(NamedTuple):
    """What one search of one law on one arm found.

    Attributes:
        arm: its name.
        law: label.
        known: what the law measures and knows, in words.
        seed: of the search.
        untuned: objective and variation of its defaults on the held-out draws; None where they fail.
        budgets: budget -> what was chosen for it: objective and variation on the held-out draws, the
            objective on those searched, and the numbers.
    """

    arm: str
    law: str
    known: str
    seed: int
    untuned: list[float] | None
    budgets: dict[str, dict[str, Any]]


def budgets(robot: Robot) -> tuple[float, ...]:
    """Return the budgets of torque variation of an arm [N m]."""
    share = _SMALL_SHARE if scales(robot).gravity.max() < _SMALL else 1.0
    return tuple(share * budget for budget in BUDGETS)


def draws(robot: Robot, count: int, first: int, kind: str = "bare") -> list[Scenario]:
    """Return scenarios of an arm: 16 bits, one sample late, unknown load, wrong inertia, torque step.

    Arms of other realities than `bare` have rotors, friction in all draws, and encoders at the motors.
    """
    mass = scales(robot).mass
    reality = Reality(
        kind,
        friction_share=1.0,
        motor_share=1.0,
        sample_time=np.array([1e-3]),
        delay=(1.0, 1.0),
        encoder_bits=(16.0, 16.0),
        payload=(0.0, min(_LOAD / mass, _LOAD_SHARE)),
        inertia_scale=(0.8, 1.2),
        effort_share=0.0,
        step_share=1.0,
        speed=(2.0, 4.0),
        duration=(1.0, 2.5),
        t_final=5.0,
    )
    return [reality.draw(robot, first + index) for index in range(count)]


def enter(folder: Path, setting: Setting, accept_code: bool = False) -> Study:
    """Make a folder that of a contest, or find that it is; see :meth:`Study.enter`.

    More seeds and arms may come later: parts are named after them, and after the bytes of the arm.
    """
    asked = {"method": "contend", **setting._replace(seeds=0)._asdict()}
    return Study.enter(folder, Identity(asked), accept_code=accept_code)


def run(
    study: Study,
    arms: Sequence[str],
    laws: Sequence[str],
    setting: Setting,
    told: Callable[[str], None] = lambda text: None,
) -> list[Entry]:
    """Run a contest, or go on with it, and return its entries.

    Raises:
        NameNotFound: for a law that there is not.
        RolloutError: when a part cannot be read or written.
        ArmgpiError: when an arm cannot be loaded.
    """
    for law in laws:
        if law not in CONTENDERS:
            raise NameNotFound("contender", law, CONTENDERS)
    return [
        entry
        for seed in range(setting.seeds)
        for arm in arms
        for law in laws
        for entry in _entries(study, arm, law, seed, setting, told)
    ]


def _entries(
    study: Study, arm: str, law: str, seed: int, setting: Setting, told: Callable[[str], None]
) -> list[Entry]:
    """Return the entry of a search, read from the folder where it is there."""
    name = part_name(arm, law, seed)

    def run() -> list[Entry]:
        search = Search(problem(arm, law, seed, setting))
        search.run(part=lambda generation, *rest: study.part(f"{name}/{generation}", *rest))
        given = search.judge_start()
        untuned = [given.objective, given.means["total_variation"]] if given.sound else None
        chosen = {
            f"{each.budget:g}": {
                "held_out": each.held_out.objective,
                "variation": each.held_out.means["total_variation"],
                "fit": each.row.objective,
                "values": search.problem.space.values(each.row.x).tolist(),
            }
            for each in search.validate()
        }
        best = (f"{each['held_out']:.3g}" for each in chosen.values())
        told(f"{arm}, {law}, seed {seed}: {' / '.join(best) or 'nothing holds'}")
        return [Entry(arm, law, described(CONTENDERS[law].section), seed, untuned, chosen)]

    return kept_rows(study.part, name, Entry, run)


def problem(arm: str, law: str, seed: int, setting: Setting) -> Problem:
    """Return what is searched for one law on one arm."""
    robot = Robot.load(arm, fingers(arm))
    contender = CONTENDERS[law]
    searched, held_out = (
        draws(robot, count, first, setting.reality)
        for count, first in ((setting.fit, 0), (setting.held_out, _APART))
    )
    made = config.controller(contender.section, searched[0].context)
    return Problem(
        Space(contender.section, made, contender.free),
        Objective("itae"),
        Evaluator(searched, KEPT),
        Evaluator(held_out, KEPT),
        budgets=budgets(robot),
        evaluations=setting.evaluations,
        population=8,
        seed=seed,
    )


def medians(entries: Iterable[Entry], arm: str) -> dict[str, dict[str, float]]:
    """Return law -> budget -> median over seeds of the error on held-out draws; infinite where most fail."""
    found: dict[str, dict[str, list[float]]] = {}
    for entry in entries:
        if entry.arm == arm:
            for budget in budgets_of(arm):
                value = entry.budgets.get(budget, {}).get("held_out", math.inf)
                found.setdefault(entry.law, {}).setdefault(budget, []).append(value)
    return {
        law: {budget: float(np.median(values)) for budget, values in row.items()}
        for law, row in found.items()
    }


@lru_cache(maxsize=64)
def budgets_of(arm: str) -> list[str]:
    """Return the budgets of an arm as the entries have them."""
    return [f"{budget:g}" for budget in budgets(Robot.load(arm, fingers(arm)))]


def classes(entries: Iterable[Entry]) -> dict[str, list[str]]:
    """Return the laws by what they measure and know, both in the order of the contest."""
    known = {entry.law: entry.known for entry in entries}
    ordered = [law for law in CONTENDERS if law in known]
    return {group: [law for law in ordered if known[law] == group] for group in dict.fromkeys(known.values())}


def markdown(entries: Sequence[Entry]) -> str:
    """Return the contest as Markdown: a table for each arm, laws by what they know, the best in bold."""
    parts = []
    for arm in dict.fromkeys(entry.arm for entry in entries):
        rows = medians(entries, arm)
        names = budgets_of(arm)
        head = (
            f"{arm}: controller (numbers), variation up to [N m]",
            *names,
            "default (variation)",
        )
        lines: list[tuple[str, ...]] = []
        for group, laws in classes(entries).items():
            here = [law for law in laws if law in rows]
            lines.append((f"*{group}*", *("",) * (len(head) - 1)))
            best = {name: min((rows[law][name] for law in here), default=math.inf) for name in names}
            for law in here:
                cells = [_cell(rows[law][name], best[name]) for name in names]
                lines.append((f"{law} ({numbers(law)})", *cells, _untuned_cell(entries, arm, law)))
        parts.append(markdown_table(head, lines))
    return "\n".join(parts)


def numbers(law: str) -> int:
    """Return how many numbers of a law are searched: a box has two ends."""
    section, free = CONTENDERS[law].section, CONTENDERS[law].free
    return sum(2 if isinstance(section.get(key), dict) else 1 for key in free)


def _cell(value: float, best: float) -> str:
    """Return an error; bold where it is the best of its class, or as good."""
    if not math.isfinite(value):
        return "-"
    return f"**{value:.3g}**" if value <= WITHIN * best else f"{value:.3g}"


def _untuned_cell(entries: Iterable[Entry], arm: str, law: str) -> str:
    """Return what the defaults of a law are on the held-out draws."""
    found = next((each.untuned for each in entries if (each.arm, each.law) == (arm, law)), None)
    return "-" if found is None else f"{found[0]:.3g} ({found[1]:.3g})"


def verdict(entries: Sequence[Entry]) -> str:
    """Return, class by class, how much the best GPI's error is over the best other law's, at each budget."""
    head = ("class", "arm", *(f"budget {i + 1}" for i in range(len(BUDGETS))))
    lines = []
    for group, laws in classes(entries).items():
        ours = [law for law in laws if CONTENDERS[law].gpi]
        theirs = [law for law in laws if not CONTENDERS[law].gpi]
        if not ours or not theirs:
            continue
        for arm in dict.fromkeys(entry.arm for entry in entries):
            rows = medians(entries, arm)
            cells = [ratio(_least(rows, ours, x), _least(rows, theirs, x)) for x in budgets_of(arm)]
            lines.append((group, arm, *cells))
    return markdown_table(head, lines)


def _least(rows: Mapping[str, Mapping[str, float]], laws: Iterable[str], budget: str) -> float:
    """Return the least error of some laws at a budget, infinity where none of them has one."""
    return min((rows[law][budget] for law in laws if law in rows), default=math.inf)


def ratio(one: float, other: float) -> str:
    """Return a quotient of errors, or which side has none."""
    if math.isinf(one) and math.isinf(other):
        return "neither"
    if math.isinf(other):
        return "GPI alone"
    return "others alone" if math.isinf(one) else f"{one / other:.2f}"
