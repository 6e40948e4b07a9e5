"""Compare automatic controllers on the same drawn arms: today's, with and without the side, and an older one.

    python tools/first_rule.py --arms ur5 panda --per-arm 48 --seed 31337
    python tools/first_rule.py --requests requests.json; see tools/old_rule.py
    python tools/first_rule.py --old old.json --out outcomes.json
    python tools/first_rule.py --variants '{rest_dead_zone: 1.0e-3}' '{PROPORTIONAL: 2.5, INTEGRAL: 25.0}'
    python tools/first_rule.py --loops --arms z1 --variants '{given: {rolloff: 1, rolloff_ratio: 8.0}}'

Variants change parameters of the controller, or, in capitals, numbers of armgpi/tuning/collocated.py. Five
words have a meaning of their own:

    rotors: specified    the rule knows the rotors of the drawn arm
    gear: assumed        the rule assumes a gear ratio of 100 where the arm has no gear (`--kind joint`)
    soft: true           the controller for an unknown side, in place of that for encoders at the motors
    given: {...}         parameters that are specified before the rule chooses the others
    gains: {...}         no rule: all joints with the same w, filter, link_factor, rotor_factor, proportional
                         and integral (armgpi/tuning/collocated.py)

With ``--loops`` a line of each draw comes first: its delay, the median stiffness and the lightest rotor of
its joints over the assumed ones, and by controller how fast the slowest or fastest growing mode of the true
arm's sampled loop decays [1/s] (negative: grows), its frequency [Hz], and what the run came to.

Draws are those of the uncertainty model `owned` with encoders of 15 to 18 bits at the motors, whose side the
first controller knows. All controllers have the same encoders, and all assume a gear ratio of 100. Draws
count where the motors can follow; others are not run. ITAE is that of the links, and that of what encoders at
the motors see: without what gravity lets the links sink by. The tables have Wilson's intervals of 95 %, and
ratios draw by draw: geometric means by arm, then over the arms, with an interval by resampling the draws of
each arm. A controller is on the front where no other one has both less hunting and fewer final errors above
0.5 mrad.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

import armgpi
from armgpi import Robot
from armgpi.base.escape import markdown_table
from armgpi.control.linear_arm import Law, Sampled, closed
from armgpi.errors import ParameterError
from armgpi.gpi.gains import FixedGains
from armgpi.gpi.payload import LoadRange
from armgpi.health import reality as health
from armgpi.health.zoo import fingers
from armgpi.loop.prepared import prepare
from armgpi.plants.reality import Reality, Scenario, batches, stack_draws
from armgpi.robot import rotors
from armgpi.tuning import collocated, rule, two_mass

#: Arms of docs/drives_measured.md; romeo's has 2.4 kg.
ARMS = ("ur5", "ur10", "panda", "z1", "g1_left_arm", "romeo_left_arm")
#: Gear ratio that controllers assume.
ASSUMED_RATIO = 100.0
#: Final error [rad or m] below which an arm is where it should be.
SMALL_ERROR = 5e-4
#: Resamplings of an interval.
_RESAMPLED = 2000
#: Limits between classes of the delay T [s].
LIMITS = (5e-3, 8e-3)


class Kind(NamedTuple):
    """What is drawn: name of the uncertainty model, and changes of its parameters."""

    name: str
    changes: Mapping[str, Any]

    def reality(self, seed: int, dts: Sequence[float], delays: Sequence[float]) -> Reality:
        """Return the uncertainty model, with sample times [s] and a range of delays [samples]."""
        both = {"sample_time": np.array(dts), "delay": tuple(delays)}
        return Reality(self.name, seed, block=12, **both, **self.changes)


KINDS = {
    "owned": Kind("owned", {"side_known": 1.0, "encoder_bits": (15.0, 18.0)}),
    "undriven": Kind("undriven", {"side_known": 1.0, "motor_share": 1.0, "encoder_bits": (15.0, 18.0)}),
    "link": Kind("elastic", {"motor_share": 0.0}),
    "joint": Kind("owned", {"side_known": 1.0, "encoder_bits": (12.0, 20.0), "gear_ratio": (1.0, 1.0)}),
}


class Rest(NamedTuple):
    """How a draw ends, beside its outcome.

    Attributes:
        outcome: of the draw.
        itae_seen: ITAE of what encoders at the motors see [rad s^2].
        final_seen: largest error at the end, likewise [rad or m].
        moved: largest motion of a joint at the end [rad or m].
    """

    outcome: health.Outcome
    itae_seen: float
    final_seen: float
    moved: float


Chooser = Callable[[Scenario], dict[str, Any]]


class Variant(NamedTuple):
    """A change of the automatic controller; see the head of this file.

    Attributes:
        numbers: of armgpi/tuning/collocated.py, in capitals.
        given: parameters that are specified before the rule chooses the others.
        changed: parameters that are changed after it chose.
        gains: the same feedback of all joints, in place of a rule.
        soft: whether it is the controller for an unknown side.
        rotors: "specified" where the rule knows the rotors of the drawn arm.
        gear: "assumed" where the rule is not told that the drawn arm has no gear.
    """

    numbers: Mapping[str, Any]
    given: Mapping[str, Any]
    changed: Mapping[str, Any]
    gains: Mapping[str, float]
    soft: bool
    rotors: str
    gear: str

    @classmethod
    def of(cls, changes: Mapping[str, Any]) -> Variant:
        """Return the variant with some changes, as they are written on the command line."""
        own = {"given": {}, "gains": {}, "soft": False, "rotors": "assumed", "gear": "specified"}
        own.update({key: value for key, value in changes.items() if key in own})
        numbers = {key: value for key, value in changes.items() if key.isupper()}
        changed = {key: value for key, value in changes.items() if key not in own and key not in numbers}
        return cls(numbers, own["given"], changed, own["gains"], own["soft"], own["rotors"], own["gear"])

    def values(self, draw: Scenario) -> dict[str, Any]:
        """Return the parameters of the controller of a draw."""
        robot = draw.nominal if self.gear == "assumed" else as_known(draw)
        if self.rotors == "specified":
            rows = zip(robot.joint_names, draw.arm.armature.tolist(), strict=True)
            robot = robot.with_drives({joint: {"rotor_inertia": rotor} for joint, rotor in rows})
        if self.gains:
            return {**same_gains(robot, **self.gains), **self.changed}
        asked = rule._Asked(robot, draw.dt, draw.delay * draw.dt, draw.encoder_bits, self.given)
        kept = {key: vars(collocated)[key] for key in self.numbers}
        vars(collocated).update(self.numbers)
        try:
            chosen = rule._choose_soft(asked) if self.soft else rule._chosen(asked)[0]
        finally:
            vars(collocated).update(kept)
        return {**chosen, **self.given, **self.changed}


def same_gains(
    robot: Robot,
    w: float,
    filter: float,
    link_factor: float,
    rotor_factor: float,
    proportional: float,
    integral: float,
) -> dict[str, Any]:
    """Return a controller for encoders at the motors with the same numbers in all joints.

    Args:
        robot: the arm.
        w: velocity gain [rad/s].
        filter: highest filter frequency [rad/s].
        link_factor: share of the links' inertia in the feedback [-].
        rotor_factor: share of the rotors' inertia [-].
        proportional: divisor of the proportional gain [-].
        integral: divisor of the integral gain [-].
    """
    shape = (link_factor, rotor_factor, proportional, integral)
    same = collocated.Collocated(np.full(robot.n, w), np.full(robot.n, filter), (), *shape)
    return rule._at_motor(same, friction_feedforward=False)


def known(changes: Mapping[str, Any]) -> Chooser:
    """Return today's rule, with what a variant changes."""
    return Variant.of(changes).values


class Mode(NamedTuple):
    """The mode of a sampled loop that decays slowest, or grows fastest.

    Attributes:
        decay: its rate [1/s]; negative where it grows.
        frequency: of it [Hz].
    """

    decay: float
    frequency: float


def worst_mode(plant: Sampled, of_law: Law, delay: int, dt: float) -> Mode:
    """Return the mode of a sampled loop that decays slowest, or grows fastest.

    Args:
        plant: the arm about rest.
        of_law: what closes its loop.
        delay: samples by which measurements are late.
        dt: sample time [s].
    """
    eigenvalues = np.linalg.eigvals(closed(plant, of_law, delay))
    largest = eigenvalues[np.argmax(np.abs(eigenvalues))]
    rate = -math.log(abs(largest)) / dt
    return Mode(rate, abs(float(np.angle(largest))) / (2.0 * math.pi * dt))


def true_mode(draw: Scenario, values: Mapping[str, Any]) -> Mode:
    """Return the worst mode of the loop of the true arm, linear about the start and the goal of its move."""
    law = controller([draw], [values])
    drives = draw.gears
    if drives is None:
        raise ParameterError("draw", draw.index, "an arm with elastic joints")
    rotor = draw.arm.armature
    found = []
    for q in (draw.move.start, draw.move.goal):
        links = draw.arm.mass_matrix(q) - np.diag(rotor)
        full = two_mass.damping_at_one(links, two_mass.Gears(rotor, drives.stiffness))
        current = float(np.min(drives.current))
        gears = two_mass.Gears(rotor, drives.stiffness, drives.damping / full, current, drives.side)
        plant = two_mass.plant(draw.arm, q, gears, draw.dt)
        found.append(worst_mode(plant, two_mass.law(law, q), draw.delay, draw.dt))
    return min(found)


def loops_table(
    draws: Sequence[Scenario], kinds: Mapping[str, Chooser], found: Mapping[str, Sequence[Rest]]
) -> str:
    """Return, as Markdown, the draws of an arm one by one: what each is, and what each controller does."""
    head = ["draw", "T [ms]", "stiffness", "lightest rotor"]
    for label in kinds:
        head += [f"{label}: decay [1/s], frequency [Hz]", "run"]
    lines = []
    for k, draw in enumerate(draws):
        known_arm = as_known(draw)
        stiffness, rotor = math.inf, draw.arm.armature / known_arm.armature
        if draw.gears is not None:
            stiffness = float(np.median(draw.gears.stiffness / known_arm.drives.value("stiffness")))
        cells = [str(draw.index), f"{1e3 * health.loop_lag(draw):.2f}", f"{stiffness:.3g}"]
        cells.append(f"{rotor.min():.2f}")
        for label, choose in kinds.items():
            mode = "-" if draw.gears is None else "{:.1f}, {:.1f}".format(*true_mode(draw, choose(draw)))
            each = found[label][k]
            said = [word for word in ("failed", "hunting", "chatter") if getattr(each.outcome, word)]
            cells += [mode, ", ".join((*said, f"ITAE seen {each.itae_seen:.3g}"))]
        lines.append(cells)
    return markdown_table(head, lines)


def as_known(draw: Scenario) -> Robot:
    """Return the nominal model, with the gear ratio where an encoder's counts are those at the joint."""
    robot = draw.nominal
    if draw.numbers.gear_ratio != 1.0:
        return robot
    return robot.with_drives({joint: {"gear_ratio": 1.0} for joint in robot.joint_names})


def bare(draw: Scenario, name: str) -> Robot:
    """Return the nominal model of a draw whose side nobody knows."""
    robot = rotors.assume_drives(Robot.load(name, fingers(name)))
    return robot.with_limits(effort=draw.model.limits.effort).scaled_inertia(draw.numbers.inertia_scale)


def bits_at_joint(draw: Scenario) -> float:
    """Return the bits at the joint that the controller takes the encoders to have."""
    at_motor = draw.gears is not None and draw.gears.side == "motor" and draw.numbers.side_known
    geared = at_motor and draw.numbers.gear_ratio > 1.0
    return draw.encoder_bits + (math.log2(ASSUMED_RATIO) if geared else 0.0)


def unknown(names: Mapping[int, str]) -> Chooser:
    """Return today's rule for a side that is not known."""

    def choose(draw: Scenario) -> dict[str, Any]:
        robot = bare(draw, names[draw.index])
        asked = rule._Asked(robot, draw.dt, draw.delay * draw.dt, bits_at_joint(draw), {})
        values, _ = rule._chosen(asked)
        return values

    return choose


def stiff(names: Mapping[int, str]) -> Chooser:
    """Return today's rule for joints that are specified to be stiff."""

    def choose(draw: Scenario) -> dict[str, Any]:
        name = names[draw.index]
        robot = rotors.assume_drives(Robot.load(name, fingers(name)), "stiff")
        robot = robot.with_limits(effort=draw.model.limits.effort).scaled_inertia(draw.numbers.inertia_scale)
        asked = rule._Asked(robot, draw.dt, draw.delay * draw.dt, bits_at_joint(draw), {})
        values, _ = rule._chosen(asked)
        return values

    return choose


def stored(name: str, rows: Sequence[Mapping[str, Any]]) -> Chooser:
    """Return what another version chose for the draws of an arm."""
    by_index = {row["index"]: row["values"] for row in rows if row["arm"] == name}

    def choose(draw: Scenario) -> dict[str, Any]:
        values = dict(by_index[draw.index])
        values["omega_c"] = np.array(values["omega_c"])
        loads = values.pop("payload", None)
        if loads is not None:
            values["payload"] = LoadRange(heaviest=loads[0], com=tuple(loads[1]))
        return values

    return choose


def structure_of(values: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return what draws of one batch have to have in common."""
    return tuple(sorted((k, v) for k, v in values.items() if isinstance(v, (int, str, bool, float))))


def controller(draws: Sequence[Scenario], chosen: Sequence[Mapping[str, Any]]) -> armgpi.GPI:
    """Return one controller of draws that run together."""
    context = stack_draws(draws).context
    own: dict[str, Any] = {}
    single = len(draws) == 1
    for name, first in chosen[0].items():
        each = [values[name] for values in chosen]
        if isinstance(first, LoadRange):
            heaviest = [load.heaviest for load in each]
            most: Any = heaviest[0] if single else np.array([[x] for x in heaviest])
            own[name] = LoadRange(heaviest=most, com=first.com)
        elif isinstance(first, np.ndarray):
            own[name] = first if single else np.stack(each)
        else:
            own[name] = first
    gains = FixedGains(own.pop("omega_c"), own.pop("zeta_c", 1.0))
    fed: Any = None if own.get("feedforward", "none") == "none" else context.robot
    return armgpi.GPI(context.nominal, context.dt, delay=context.delay, gains=gains, bias_robot=fed, **own)


def run(name: str, draws: Sequence[Scenario], choose: Chooser) -> list[Rest]:
    """Return what a controller comes to on draws of an arm."""
    found = {}
    for group in batches(draws):
        parts: dict[Any, list[tuple[Scenario, dict[str, Any]]]] = {}
        for draw in group:
            values = choose(draw)
            parts.setdefault(structure_of(values), []).append((draw, values))
        for part in parts.values():
            here = [draw for draw, _ in part]
            law = controller(here, [values for _, values in part])
            every = stack_draws(here)
            loop = prepare(every.plant, law, every.reference, every.t_final, backend="compiled")
            rollout = health.in_rows(loop.run(progress=False))
            for row, draw in enumerate(here):
                found[draw.index] = at_rest(rollout.isel(rollout=row), draw, name)
    return [found[draw.index] for draw in draws]


def at_rest(rollout: Any, draw: Scenario, name: str) -> Rest:
    """Return what came of one rollout."""
    outcome = health.outcome(rollout, draw, name)
    outcome = outcome._replace(lag=health.loop_lag(draw), sample_time=draw.dt, delay=draw.delay)
    if not math.isfinite(outcome.itae):
        return Rest(outcome, math.inf, math.inf, math.inf)
    seen = np.abs((rollout["q"] - rollout["q_ref"]).values + health.sunk(draw, rollout["q_ref"].values))
    time = rollout["time"].values
    end = time > time[-1] - health.END
    itae = float((time[:, None] * seen).sum() * draw.dt)
    moved = float(np.ptp(rollout["q"].values[end], axis=0).max())
    return Rest(outcome, itae, float(seen[-1].max()), moved)


def ratio(found: Sequence[Rest], reference: Sequence[Rest], column: str) -> str:
    """Return a column over a reference: geometric means by arm, then over arms, with an interval."""
    logs: dict[str, list[float]] = {}
    for each, other in zip(found, reference, strict=True):
        if each.outcome.failed or other.outcome.failed:
            continue
        pair = [x.itae_seen if column == "itae_seen" else getattr(x.outcome, column) for x in (each, other)]
        logs.setdefault(each.outcome.arm, []).append(math.log(pair[0] / pair[1]))
    if not logs:
        return "-"
    rows = [np.array(values) for values in logs.values()]
    rng = np.random.default_rng(0)
    means = [np.mean([rng.choice(row, row.size).mean() for row in rows]) for _ in range(_RESAMPLED)]
    low, high = np.exp(np.quantile(means, (0.025, 0.975)))
    return f"{math.exp(np.mean([row.mean() for row in rows])):.2f} ({low:.2f} to {high:.2f})"


HEAD = (
    "controller",
    "draws",
    "failed [%]",
    "hunting [%]",
    "chatter [%]",
    "final error, median [mrad]",
    "within 0.5 mrad [%]",
    "ITAE of links",
    "ITAE seen",
    "variation",
    "on the front",
)


def on_front(rows: Sequence[Sequence[Rest]]) -> list[bool]:
    """Tell of each controller whether no other one has both less hunting and fewer large final errors."""
    counts = []
    for every in rows:
        hunting = sum(x.outcome.hunting for x in every)
        large = sum(not x.final_seen <= SMALL_ERROR for x in every)
        counts.append((hunting, large))
    found = []
    for own in counts:
        better = [x for x in counts if x != own and x[0] <= own[0] and x[1] <= own[1]]
        found.append(not better)
    return found


def classes(limits: Sequence[float]) -> dict[str, tuple[float, float]]:
    """Return the classes of the delay T between some limits [s], by their names in the tables."""
    edges = (0.0, *limits, math.inf)
    found = {}
    for least, most in itertools.pairwise(edges):
        found[f"T {1e3 * least:g} to {1e3 * most:g} ms"] = (least, most)
    return found


def table(found: Mapping[str, Sequence[Rest]], least: float, most: float) -> str:
    """Return, as Markdown, controllers on the draws of a class of delays, over the first one."""
    first = next(iter(found.values()))
    here = [k for k, x in enumerate(first) if least <= x.outcome.lag < most]
    if not here:
        return "no draws\n"
    reference = [first[k] for k in here]
    lines = []
    front = on_front([[every[k] for k in here] for every in found.values()])
    for (label, every), is_best in zip(found.items(), front, strict=True):
        rows = [every[k] for k in here]
        shares = [
            health.share([getattr(x.outcome, key) for x in rows]) for key in ("failed", "hunting", "chatter")
        ]
        final = f"{1e3 * np.median([x.final_seen for x in rows]):.2g}"
        small = health.share([x.final_seen <= SMALL_ERROR for x in rows])
        ratios = [ratio(rows, reference, column) for column in ("itae", "itae_seen", "variation")]
        lines.append((label, str(len(rows)), *shares, final, small, *ratios, "yes" if is_best else ""))
    return markdown_table(HEAD, lines)


def by_arm(found: Mapping[str, Sequence[Rest]], least: float, most: float) -> str:
    """Return, as Markdown, the same arm by arm: counts and ratios."""
    first = next(iter(found.values()))
    lines = []
    for name in dict.fromkeys(x.outcome.arm for x in first):
        for label, every in found.items():
            pairs = [
                (x, y)
                for x, y in zip(every, first, strict=True)
                if x.outcome.arm == name and least <= x.outcome.lag < most
            ]
            if not pairs:
                continue
            rows, reference = zip(*pairs, strict=True)
            counts = [
                str(sum(getattr(x.outcome, key) for x in rows)) for key in ("failed", "hunting", "chatter")
            ]
            ratios = [ratio(rows, reference, column) for column in ("itae", "itae_seen")]
            median = f"{np.median([x.outcome.itae for x in rows]):.3g}"
            lines.append((name, label, str(len(rows)), *counts, median, *ratios))
    head = (
        "arm",
        "controller",
        "draws",
        "failed",
        "hunting",
        "chatter",
        "median ITAE",
        "ITAE of links",
        "seen",
    )
    return markdown_table(head, lines)


def able_draws(reality: Reality, name: str, count: int, most: float) -> list[Scenario]:
    """Return the draws of an arm that its motors can follow, with delays below one [s]."""
    drawn = [draw for draw in health.draws(reality, name, count) if health.loop_lag(draw) < most]
    return [draw for draw in drawn if health.demand(draw) <= 1.0]


def specified(draw: Scenario) -> dict[str, dict[str, Any]]:
    """Return joint -> rotor inertia and side of the encoder, where the controller has the rotors."""
    robot = draw.nominal
    if set(robot.drives.sources("rotor_inertia")) != {"specified"}:
        return {}
    rows = zip(robot.joint_names, robot.armature.tolist(), robot.drives.value("encoder_side"), strict=True)
    return {joint: {"rotor_inertia": rotor, "encoder_side": str(side)} for joint, rotor, side in rows if side}


def requests(names: Sequence[str], draws: Mapping[str, Sequence[Scenario]]) -> list[dict[str, Any]]:
    """Return what the rule of another version has to know of each draw."""
    rows = []
    for name in names:
        for draw in draws[name]:
            effort = [x if math.isfinite(x) else None for x in draw.model.limits.effort.tolist()]
            rows.append(
                {
                    "arm": name,
                    "index": draw.index,
                    "locked": list(fingers(name)),
                    "effort": effort,
                    "inertia_scale": draw.numbers.inertia_scale,
                    "dt": draw.dt,
                    "delay": draw.delay * draw.dt,
                    "bits": bits_at_joint(draw),
                    "drives": specified(draw),
                }
            )
    return rows


def options() -> argparse.Namespace:
    """Return what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", nargs="+", default=list(ARMS))
    parser.add_argument("--per-arm", type=int, default=48)
    parser.add_argument("--seed", type=int, default=31337)
    parser.add_argument("--kind", default="owned", choices=tuple(KINDS))
    parser.add_argument("--sample-times", type=float, nargs="+", default=[5e-4, 1e-3, 2e-3], help="[s]")
    parser.add_argument("--delays", type=float, nargs=2, default=[1.0, 3.0], help="least and most samples")
    parser.add_argument("--most-delay", type=float, default=8e-3, help="delays T below it alone [s]")
    parser.add_argument("--limits", type=float, nargs="+", default=LIMITS, help="between classes of T [s]")
    parser.add_argument("--requests", type=Path, help="write what another version's rule needs, and end")
    parser.add_argument("--old", type=Path, help="what another version chose for these draws")
    parser.add_argument("--stiff", action="store_true", help="the controller for stiff joints as well")
    parser.add_argument("--alone", action="store_true", help="without the controller for an unknown side")
    parser.add_argument("--variants", type=yaml.safe_load, nargs="+", default=[], help="changed parameters")
    parser.add_argument("--loops", action="store_true", help="draws one by one, with the true arm's loop")
    parser.add_argument("--out", type=Path, help="write outcomes as JSON")
    return parser.parse_args()


def choosers(given: argparse.Namespace, name: str, draws: Sequence[Scenario]) -> dict[str, Chooser]:
    """Return what is compared on the draws of an arm, the reference first, by its label in the tables."""
    names = {draw.index: name for draw in draws}
    kinds: dict[str, Chooser] = {}
    if given.old:
        kinds["older version"] = stored(name, json.loads(given.old.read_text("utf-8")))
    if not given.alone:
        kinds["side unknown"] = unknown(names)
    kinds["automatic"] = known({})
    if given.stiff:
        kinds["stiff joints"] = stiff(names)
    for change in given.variants:
        kinds[json.dumps(change)] = known(change)
    return kinds


def main() -> None:
    """Print the tables."""
    given = options()
    warnings.simplefilter("ignore")
    reality = KINDS[given.kind].reality(given.seed, given.sample_times, given.delays)
    draws = {name: able_draws(reality, name, given.per_arm, given.most_delay) for name in given.arms}
    if given.requests:
        given.requests.write_text(json.dumps(requests(given.arms, draws)), encoding="utf-8")
        return
    found: dict[str, list[Rest]] = {}
    for name in given.arms:
        kinds = choosers(given, name, draws[name])
        of_arm = {}
        for label, choose in kinds.items():
            print(f"{name}, {label}", file=sys.stderr, flush=True)
            of_arm[label] = run(name, draws[name], choose)
            found.setdefault(label, []).extend(of_arm[label])
        if given.loops:
            print(f"\n{name}\n\n{loops_table(draws[name], kinds, of_arm)}", flush=True)
    for label, (least, most) in classes(given.limits).items():
        print(f"\n{label}\n\n{table(found, least, most)}\n{by_arm(found, least, most)}", flush=True)
    if given.out:
        rows = {
            label: [
                {**x.outcome._asdict(), **{k: v for k, v in x._asdict().items() if k != "outcome"}}
                for x in each
            ]
            for label, each in found.items()
        }
        given.out.write_text(
            json.dumps({"arguments": vars(given), "outcomes": rows}, default=str) + "\n", "utf-8"
        )


if __name__ == "__main__":
    main()
