"""Laws held against each other: one search and one number of candidates for all.

Each law is searched for the least tracking error at several budgets of torque variation. What counts is how
its choices do on moves, loads, inertia factors and torque steps that no search saw. Laws are compared with
those that measure and know the same.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from armgpi import config, files
from armgpi.config import experiment as experiments
from armgpi.config.identity import Identity, claim, code, seal, unseal
from armgpi.errors import NameNotFound, RolloutError
from armgpi.health.reality import known as described
from armgpi.health.zoo import fingers
from armgpi.plants.reality import Draw, Reality, scales
from armgpi.robot import robots
from armgpi.robot.robot import Robot
from armgpi.search.evaluation import Evaluator
from armgpi.search.objective import Objective
from armgpi.search.space import Range, Space
from armgpi.search.study import KEPT, Problem, Study, kept_rows

#: Arms of the contest, and what torque variation is allowed [N m]; small arms get a share of it.
ARMS = ("ur5", "panda", "kinova", "anthropomorphic3")
BUDGETS = (150.0, 300.0, 600.0, 1200.0, 2400.0, 4800.0)
_SMALL, _SMALL_SHARE = 3.0, 1.0 / 16.0
#: Heaviest unknown load [kg], but no more than this share of the arm.
_LOAD, _LOAD_SHARE = 0.5, 0.15
#: Draws that are searched on and judged on; the latter begin far from the former.
FIT, HELD_OUT, _APART = 8, 24, 1 << 20
#: How many times the best one's error is as good.
WITHIN = 1.1


_Kept = TypeVar("_Kept")


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


def _law(section: dict[str, Any], *free: str, **ranges: Range) -> Contender:
    searched = {key: Range() for key in free} | ranges
    return Contender(section, searched, section["type"] in ("gpi", "schedule", "network"))


_POLES = ("omega", "zeta", "p")
_ROLLED = (*_POLES, "rolloff_ratio")
_SCHEDULE = ("omega", "zeta", "attack", "error_range", "dead_zone")
_NETWORK = ("omega", "zeta", "learning_rate", "error_range", "derivative_range", "dead_zone")
_TRAINED = ("omega", "zeta", "error_range", "derivative_range", "weights.omega")
_OBSERVER = ("omega_c", "omega_o")
#: Poles as far apart as an observer's are from those of its controller, so that ADRC is among the members.
_FAR = {"second_ratio": Range(0.2, 50.0), "rolloff_ratio": Range(1.0, 50.0)}
#: Where the searches begin: the defaults at 1 ms and one sample of delay, all poles at 30 rad/s, or two
#: at half of that and the others at twice, as an observer has; gains that adapt from 20 to 60 rad/s.
_EQUAL = {"omega": 30.0, "zeta": 1.0, "p": 30.0}
_SPREAD = {"omega": 15.0, "zeta": 1.0, "p": 60.0, "second_ratio": 4.0, "rolloff": 1, "rolloff_ratio": 4.0}
_BOX = {"omega": {"lower": 20.0, "upper": 60.0}, "error_range": 1e-4, "dead_zone": 2e-4}
_SPLIT = {"omega_c": 15.0, "omega_o": 60.0}

#: Label -> law. All get the same number of candidates, however many numbers they have.
CONTENDERS: dict[str, Contender] = {
    "GPI, printed law": _law({"type": "gpi", **_EQUAL}, *_POLES),
    "GPI, roll-off": _law({"type": "gpi", "rolloff": 1, **_EQUAL}, *_ROLLED),
    "GPI, roll-off, two quadratics": _law({"type": "gpi", **_SPREAD}, *_POLES, **_FAR),
    "GPI, roll-off, one integrator": _law(
        {"type": "gpi", "integrators": 1, **_SPREAD}, "omega", "zeta", **_FAR
    ),
    "GPI, schedule": _law({"type": "schedule", **_BOX}, *_SCHEDULE),
    "GPI, schedule, roll-off": _law({"type": "schedule", **_BOX, "rolloff": 1}, *_SCHEDULE, "rolloff_ratio"),
    "GPI, network": _law({"type": "network", **_BOX}, *_NETWORK),
    "GPI, network, roll-off": _law({"type": "network", **_BOX, "rolloff": 1}, *_NETWORK, "rolloff_ratio"),
    "GPI, trained network, roll-off": _law(
        {"type": "network", **_BOX, "learning_rate": 0.0, "rolloff": 1}, *_TRAINED, "rolloff_ratio"
    ),
    "ADRC, order 3": _law({"type": "adrc", "order": 3, **_SPLIT}, *_OBSERVER),
    "ADRC, order 4": _law({"type": "adrc", "order": 4, **_SPLIT}, *_OBSERVER),
    "GPI, roll-off, gravity": _law(
        {"type": "gpi", "rolloff": 1, "feedforward": "gravity", **_EQUAL}, *_ROLLED
    ),
    "GPI, roll-off, model": _law({"type": "gpi", "rolloff": 1, "feedforward": "model", **_EQUAL}, *_ROLLED),
    "GPI, roll-off, two quadratics, computed": _law(
        {"type": "gpi", "feedforward": "computed", **_SPREAD}, *_POLES, **_FAR
    ),
    "GPI, roll-off, one integrator, computed": _law(
        {"type": "gpi", "integrators": 1, "feedforward": "computed", **_SPREAD}, "omega", "zeta", **_FAR
    ),
    "GPI, schedule, roll-off, computed": _law(
        {"type": "schedule", "feedforward": "computed", **_BOX, "rolloff": 1}, *_SCHEDULE, "rolloff_ratio"
    ),
    "computed torque, observer": _law({"type": "ctdob", **_SPLIT}, *_OBSERVER),
    "PID + inversion, positions": _law({"type": "pid_positions"}, "kp", "ki", "kd", "filter"),
    "super-twisting": _law({"type": "supertwisting", **_SPLIT}, *_OBSERVER, "slope", "layer"),
    "Slotine-Li": _law({"type": "slotineli", **_SPLIT}, *_OBSERVER, "adaptation", "layer"),
    "PID + inversion, exact velocities": _law({"type": "pid"}, "kp", "ki", "kd"),
}


#: What the rule for arms that nobody tuned is held against, tuned for the torque variation that it has.
RIVALS = ("ADRC, order 3", "ADRC, order 4")


class Setting(NamedTuple):
    """How large a contest is.

    Attributes:
        evaluations: candidates for each law, arm and seed.
        seeds: searches of each law and arm.
        fit: draws that are searched on.
        held_out: draws that are judged on.
    """

    evaluations: int = 481
    seeds: int = 2
    fit: int = FIT
    held_out: int = HELD_OUT


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
        names: of the numbers.
    """

    arm: str
    law: str
    known: str
    seed: int
    untuned: list[float] | None
    budgets: dict[str, dict[str, Any]]
    names: list[str]


def budgets(robot: Robot) -> tuple[float, ...]:
    """Return the budgets of torque variation of an arm [N m]."""
    share = _SMALL_SHARE if scales(robot).gravity.max() < _SMALL else 1.0
    return tuple(share * budget for budget in BUDGETS)


def draws(robot: Robot, count: int, first: int) -> list[Draw]:
    """Return scenarios of an arm: 16 bits, one sample late, unknown load, wrong inertia, torque step."""
    mass = scales(robot).mass
    reality = Reality.bare(
        sample_time=[1e-3],
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


def run(
    folder: Path,
    arms: Sequence[str],
    laws: Sequence[str],
    setting: Setting,
    told: Callable[[str], None] = lambda text: None,
    accept_code: bool = False,
) -> list[Entry]:
    """Run a contest, or go on with the one of a folder, and return its entries.

    Raises:
        NameNotFound: for a law that there is not.
        RolloutError: when the folder holds another contest, one of other code, or cannot be written to.
        ArmgpiError: when an arm cannot be loaded.
    """
    for law in laws:
        if law not in CONTENDERS:
            raise NameNotFound("contender", law, CONTENDERS)
    experiments.prepare(folder)
    # More seeds and arms may come later: each entry has the bytes of its arm in its key.
    claim(folder, Identity(_asked(setting), code()), "", accept_code)
    return [
        _entry(folder, arm, law, seed, setting, told)
        for seed in range(setting.seeds)
        for arm in arms
        for law in laws
    ]


def _entry(
    folder: Path, arm: str, law: str, seed: int, setting: Setting, told: Callable[[str], None]
) -> Entry:
    """Return one entry, read from the folder where it is there."""
    name = f"{arm} {law} {seed}".replace(" ", "_").replace(",", "").replace("+", "plus")
    done, table = folder / f"{name}.json", folder / f"{name}.csv"
    if done.exists():
        return _read(done, Entry, _key(arm, setting))
    study = Study(problem(arm, law, seed, setting))
    key = _key(arm, setting)
    kept = kept_rows(table, study.problem, key)
    study.run(lambda study: _keep(table, study, key), kept)
    entry = _judged(arm, law, seed, study)
    files.write(done, seal(entry._asdict(), key))
    best = [each["held_out"] for each in entry.budgets.values()]
    told(f"{arm}, {law}, seed {seed}: {' / '.join(f'{value:.3g}' for value in best) or 'nothing holds'}")
    return entry


def _asked(setting: Setting) -> dict[str, Any]:
    """Return what a contest is, as plain data."""
    return {"method": "contend", **setting._replace(seeds=0)._asdict()}


def _key(arm: str, setting: Setting) -> str:
    """Return what the entries of an arm are part of: the contest, and the bytes of the arm."""
    content = robots.locate(arm)[0].read_bytes()
    return f"{json.dumps(_asked(setting))} {hashlib.sha256(content).hexdigest()}"


def _read(path: Path, kind: Callable[..., _Kept], key: str) -> _Kept:
    """Return what was kept in a file.

    Raises:
        RolloutError: when it cannot be read.
    """
    try:
        return kind(**unseal(path, key))
    except TypeError as error:
        raise RolloutError(f"{path}: cannot be read: {error}; remove it") from None


def _keep(table: Path, study: Study, key: str) -> None:
    """Keep all candidates so far."""
    files.write(table, study.table(key))


def problem(arm: str, law: str, seed: int, setting: Setting) -> Problem:
    """Return what is searched for one law on one arm."""
    robot = Robot.load(arm, fingers(arm))
    contender = CONTENDERS[law]
    searched, held_out = draws(robot, setting.fit, 0), draws(robot, setting.held_out, _APART)
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


def untuned(folder: Path, arm: str, setting: Setting) -> Untuned:
    """Return what the rule is on an arm, and what its rivals are; read from the folder where it is there.

    Raises:
        RolloutError: when the folder's file cannot be read or written.
        ArmgpiError: when the arm cannot be loaded.
    """
    done = folder / f"{arm}_untuned_{setting.seeds}.json"
    if done.exists():
        return _read(done, Untuned, _key(arm, setting))
    robot = Robot.load(arm, fingers(arm))
    section = {"type": "untuned"}
    spent, judged = (
        Evaluator(draws(robot, count, first), KEPT)(section, [{}])
        for count, first in ((setting.fit, 0), (setting.held_out, _APART))
    )
    budget = float(spent.values["total_variation"].mean())
    rivals = {law: _rival(arm, law, setting, budget) for law in RIVALS}
    objective, variation = (float(judged.values[name].mean()) for name in ("itae", "total_variation"))
    found = Untuned(arm, objective, variation, rivals)
    files.write(done, seal(found._asdict(), _key(arm, setting)))
    return found


def _rival(arm: str, law: str, setting: Setting, budget: float) -> list[float]:
    """Return objective and variation of a law that is tuned for a budget, the median of the seeds."""
    rows = []
    for seed in range(setting.seeds):
        whole = problem(arm, law, seed, setting)
        # As many candidates as each budget of a contest has.
        study = Study(whole._replace(budgets=(budget,), evaluations=setting.evaluations // len(BUDGETS) + 1))
        study.run()
        rows.append([(x.held_out.objective, x.held_out.means["total_variation"]) for x in study.validated()])
    values = np.array([row[0] if row else (math.inf, math.inf) for row in rows])
    return [float(x) for x in np.median(values, axis=0)]


def untuned_table(found: Sequence[Untuned]) -> str:
    """Return, as Markdown, the rule beside laws that are tuned for its variation, with quotients of error."""
    head = ("error at torque variation [N m]", "untuned", *RIVALS, "untuned over the best ADRC")
    lines = [head, ("---",) * len(head)]
    for each in found:
        best = min(each.rivals[law][0] for law in RIVALS if not CONTENDERS[law].gpi)
        pairs = ([each.objective, each.variation], *(each.rivals[law] for law in RIVALS))
        cells = [f"{error:.3g} at {spent:.3g}" for error, spent in pairs]
        lines.append((each.arm, *cells, _ratio(each.objective, best)))
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def _judged(arm: str, law: str, seed: int, study: Study) -> Entry:
    """Return what a study found."""
    given = study.given()
    found = {
        f"{each.budget:g}": {
            "held_out": each.held_out.objective,
            "variation": each.held_out.means["total_variation"],
            "fit": each.row.objective,
            "values": study.problem.space.values(each.row.x).tolist(),
        }
        for each in study.validated()
    }
    untuned = [given.objective, given.means["total_variation"]] if given.sound else None
    section = CONTENDERS[law].section
    return Entry(arm, law, described(section), seed, untuned, found, study.problem.space.names)


def medians(entries: Iterable[Entry], arm: str) -> dict[str, dict[str, float]]:
    """Return law -> budget -> median over seeds of the error on held-out draws; infinite where most fail."""
    found: dict[str, dict[str, list[float]]] = {}
    for entry in entries:
        if entry.arm == arm:
            for budget in _budgets_of(arm):
                value = entry.budgets.get(budget, {}).get("held_out", math.inf)
                found.setdefault(entry.law, {}).setdefault(budget, []).append(value)
    return {
        law: {budget: float(np.median(values)) for budget, values in row.items()}
        for law, row in found.items()
    }


def _budgets_of(arm: str) -> list[str]:
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
        names = _budgets_of(arm)
        head = (f"{arm}: torque variation up to [N m]", *names, "where its search begins (variation)")
        lines = [head, ("---",) * len(head)]
        for group, laws in classes(entries).items():
            here = [law for law in laws if law in rows]
            lines.append((f"*{group}*", *("",) * (len(head) - 1)))
            best = {name: min((rows[law][name] for law in here), default=math.inf) for name in names}
            for law in here:
                cells = [_cell(rows[law][name], best[name]) for name in names]
                lines.append((law, *cells, _untuned(entries, arm, law)))
        parts.append("\n".join("| " + " | ".join(line) + " |" for line in lines))
    return "\n\n".join(parts) + "\n"


def _cell(value: float, best: float) -> str:
    """Return an error; bold where it is the best of its class, or as good."""
    if not math.isfinite(value):
        return "-"
    return f"**{value:.3g}**" if value <= WITHIN * best else f"{value:.3g}"


def _untuned(entries: Iterable[Entry], arm: str, law: str) -> str:
    """Return what the defaults of a law are on the held-out draws."""
    found = next((each.untuned for each in entries if (each.arm, each.law) == (arm, law)), None)
    return "-" if found is None else f"{found[0]:.3g} ({found[1]:.3g})"


def verdict(entries: Sequence[Entry]) -> str:
    """Return, class by class, how much the best GPI's error is over the best other law's, at each budget."""
    head = ("class", "arm", *(f"budget {i + 1}" for i in range(len(BUDGETS))))
    lines = [head, ("---",) * len(head)]
    for group, laws in classes(entries).items():
        ours = [law for law in laws if CONTENDERS[law].gpi]
        theirs = [law for law in laws if not CONTENDERS[law].gpi]
        if not ours or not theirs:
            continue
        for arm in dict.fromkeys(entry.arm for entry in entries):
            rows = medians(entries, arm)
            cells = []
            for name in _budgets_of(arm):
                one, other = (
                    min((rows[law][name] for law in side if law in rows), default=math.inf)
                    for side in (ours, theirs)
                )
                cells.append(_ratio(one, other))
            lines.append((group, arm, *cells))
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def _ratio(one: float, other: float) -> str:
    """Return a quotient of errors, or which side has none."""
    if math.isinf(one) and math.isinf(other):
        return "neither"
    if math.isinf(other):
        return "GPI alone"
    return "others alone" if math.isinf(one) else f"{one / other:.2f}"


#: Laws whose numbers are tried on the other arms; the first one is what they are compared with.
TRANSFERRED = (
    *("GPI, roll-off", "GPI, schedule, roll-off", "GPI, network, roll-off", "GPI, trained network, roll-off"),
    *("GPI, printed law", "ADRC, order 3"),
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
        (entry.arm, _budgets_of(entry.arm).index(budget), each["values"])
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
    lines = [head, ("---",) * len(head)]
    for law in TRANSFERRED:
        own = [each for each in found if each.law == law]
        if not own:
            continue
        cells = [_quotients(found, law, place) for place in range(len(BUDGETS))]
        failed = sum(not math.isfinite(each.objective) for each in own)
        lines.append((law, *cells, f"{failed} of {len(own)}"))
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


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
