"""The fault matrix of every target, and all bounds: docs/faults.md and docs/faults.csv (`make faults`).

Usage:
    python tools/faults.py                the matrix; the rows of tools/bounds.py are kept as they are
    python tools/faults.py --bounds       those as well
    python tools/faults.py --target fci   one target; rows of the others are kept as they are
    python tools/faults.py --side motor   encoders known to be at the motors, beside the page: nothing is
                                          written; an arm's rows are printed when they are there
    python tools/faults.py --page         nothing is measured: the page anew from docs/faults.csv
    python tools/faults.py --stops 3 --fault 'a joint blocked'
                                          when arms stop and rest, over 3 s after the fault, with the side of
                                          the encoders unknown and known; nothing is written

Each fault happens in the middle of a move of all joints, at 0.75 rad/s for the fastest, with 18-bit encoders,
in each joint in turn: one batch for each arm, and for measurements as late as is usual and as at most.
Everything after it is simulated for a second, without brakes and without friction. The law is the export's,
which believes that gears twist; those of the arm are stiff, or do, with encoders at the motors.
The arm's watchdog is that of `armgpi loop`.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import sys
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import bounds
import numpy as np
import targets
from bounds import Row

from armgpi import (
    GPI,
    Bezier,
    Delayed,
    ElasticPlant,
    Encoder,
    Friction,
    Hold,
    Measurement,
    Pulse,
    RigidBodyPlant,
    Robot,
    Saturated,
    Supervised,
    config,
    simulate,
)
from armgpi.base.parameter import parameters
from armgpi.hardware.export.interfaces import TARGETS
from armgpi.hardware.realtime.datagram import TORQUE, Datagram
from armgpi.hardware.realtime.ends import ArmEnd, Watchdog
from armgpi.supervisor import Reason, State, Supervisor

DOCS = Path(__file__).parents[1] / "docs"
SECONDS, SPEED, BITS = 1.0, 0.75, 18
#: Slower than this is at rest [rad/s].
REST = 0.02
#: Within which an arm has to rest after a fault in motion [s, rad].
SOON, NEAR = 0.5, 0.1
#: Coefficient of viscous friction of a joint that is blocked [N m s/rad].
BLOCKED = 1e6
#: Sample times where a target leaves them open [s].
SAMPLE_TIMES = {"ros2_control": (1e-3, 4e-3)}


class Sample(NamedTuple):
    """What a fault may change, `t` seconds after it began; (rollouts, n). `hit` are the joints it is of."""

    t: float
    hit: Any
    q: Any
    r: Any
    first_q: Any
    first_r: Any


class Fault(NamedTuple):
    """A fault, by what it changes: what is measured, the reference, the torque that acts, or the arm.

    Attributes:
        name: in words.
        q: what is measured of joints that are hit; None for what is.
        r: their reference, likewise.
        tau: torque that acts: of time, torque asked for, and effort limits.
        each: whether it happens to one joint, to each in turn; else to all at once.
        away: how long no sample comes [s].
        blocked: whether the joints do not move.
        payload: at the tip [kg].
        rest: whether the arm is at rest before.
        open: whether nothing is measured then that a loop could be closed with.
    """

    name: str
    q: Callable[[Sample], Any] | None = None
    r: Callable[[Sample], Any] | None = None
    tau: Callable[[float, Any, Any], Any] | None = None
    each: bool = True
    away: float = 0.0
    blocked: bool = False
    payload: float = 0.0
    rest: bool = False
    open: bool = False


def once(s: Sample, value: Any, until: float = 1e-9) -> Any:
    """Return a value for the first samples, and what is measured then."""
    return value if s.t < until else s.q


FAULTS = (
    Fault("reference NaN", r=lambda s: s.r * np.nan),
    Fault("reference infinite, once", r=lambda s: s.r + (np.inf if s.t == 0.0 else 0.0)),
    Fault("reference jumps by 0.3 rad", r=lambda s: s.r + 0.3),
    Fault("reference of all joints jumps by 0.3 rad", r=lambda s: s.r + 0.3, each=False),
    Fault("reference stops dead", r=lambda s: s.first_r, each=False),
    Fault("one sample NaN", q=lambda s: once(s, s.q * np.nan)),
    Fault("10 ms NaN", q=lambda s: once(s, s.q * np.nan, 0.01)),
    Fault("a joint NaN for good", q=lambda s: s.q * np.nan, open=True),
    Fault("all NaN for good", q=lambda s: s.q * np.nan, each=False, open=True),
    Fault("one sample 1e6 rad", q=lambda s: once(s, s.q + 1e6)),
    Fault("a spike of 1 rad", q=lambda s: once(s, s.q + 1.0)),
    Fault("an encoder off by 0.5 rad for good", q=lambda s: s.q + 0.5, open=True),
    Fault("a joint frozen", q=lambda s: s.first_q, open=True),
    Fault("all joints frozen", q=lambda s: s.first_q, each=False, open=True),
    Fault("an encoder 5 % wrong from here on", q=lambda s: s.first_q + 1.05 * (s.q - s.first_q)),
    Fault("an encoder counts backwards", q=lambda s: 2.0 * s.first_q - s.q, open=True),
    *(Fault(f"samples missed for {1e3 * t:.0f} ms", each=False, away=t) for t in (0.005, 0.02, 0.05)),
    Fault("a joint blocked", blocked=True),
    Fault("a push of half its effort for 50 ms", tau=lambda t, tau, top: tau + 0.5 * top * (t < 0.05)),
    Fault("the same push of all joints", tau=lambda t, tau, top: tau + 0.5 * top * (t < 0.05), each=False),
    Fault("a motor dead", tau=lambda t, tau, top: 0.0 * tau),
    Fault("a motor at half its torque", tau=lambda t, tau, top: 0.5 * tau),
    Fault("a motor turns the other way", tau=lambda t, tau, top: -tau),
    Fault("0.5 kg picked up unnoticed", payload=0.5, each=False),
    Fault("at rest: all NaN for good", q=lambda s: s.q * np.nan, each=False, rest=True, open=True),
    Fault("at rest: reference NaN", r=lambda s: s.r * np.nan, rest=True),
    Fault("at rest: a joint frozen", q=lambda s: s.first_q, rest=True),
    Fault("at rest: an encoder off by 0.5 rad", q=lambda s: s.q + 0.5, rest=True, open=True),
)


class Case(NamedTuple):
    """An arm as a target has it, with stiff or elastic joints."""

    target: str
    arm: str
    dt: float
    gravity: str
    elastic: bool
    side: str = ""

    def __str__(self) -> str:
        """Return it in words."""
        return f"{self.arm}, {1e3 * self.dt:g} ms, {'elastic' if self.elastic else 'rigid'}"


def cases(target: str) -> Iterator[Case]:
    """Yield what a target is tried with; the paper's arm has no gears, and no elastic twin."""
    expected = TARGETS[target]
    carried = ("robot",) if "gravity" in expected.adds else ("robot", "arm")
    times = (expected.dt,) if expected.dt else SAMPLE_TIMES.get(target, (1e-3,))
    for arm, dt, gravity, elastic in itertools.product(targets.ARMS[target], times, carried, (False, True)):
        if not (elastic and arm == "anthropomorphic3"):
            yield Case(target, arm, dt, gravity, elastic)


class Outcome(NamedTuple):
    """What became of an arm after a fault in a joint (-1: all), `late` samples late.

    Times are from the fault on [s], then positions [rad] and velocities [rad/s] of the links. `wanted` is
    where the move would be, `rate` the highest rate of the torques sent [N m/s].
    """

    case: Case
    fault: Fault
    joint: int
    late: int
    times: Any
    q: Any
    v: Any
    wanted: Any
    status: str
    reason: str
    noticed: float
    rate: float

    def travel(self, seconds: float = SOON) -> float:
        """Return how far a joint went from where it was, or from its move, whichever is nearer [rad]."""
        nearer = np.minimum(*(np.abs(self.q - other) for other in (self.q[0], self.wanted)))
        far = float(nearer[self.times <= seconds].max())
        return far if np.isfinite(far) else np.inf  # the arm was lost

    @property
    def peak(self) -> float:
        """Highest speed [rad/s]."""
        fast = float(np.abs(self.v).max())
        return fast if np.isfinite(fast) else np.inf

    @property
    def rest(self) -> float:
        """Time from which on the arm is at rest [s]; infinite when it is not."""
        return self.slower_from(REST)

    def slower_from(self, speed: float) -> float:
        """Return the time from which on no joint is faster than some speed [rad/s]; infinite for none [s]."""
        moving = np.flatnonzero(~(np.abs(self.v).max(axis=1) <= speed))
        last = moving[-1] + 1 if moving.size else 0
        return float(self.times[last]) if last < len(self.times) else np.inf

    def rests_after_stop(self, speed: float) -> bool:
        """Tell whether the arm goes on, or no joint is faster than a speed [rad/s] soon after its stop."""
        return self.goes_on or self.slower_from(speed) <= self.noticed + SOON

    @property
    def goes_on(self) -> bool:
        """Whether it was no fault to the supervisor: the arm goes on with its move."""
        return self.status == "run"

    @property
    def kept(self) -> bool:
        """Whether it rested soon and near; an arm that goes on need be near alone."""
        return self.travel() <= NEAR and (self.goes_on or self.rest <= SOON)


@cache
def experiment_of(target: str, arm: str, dt: float, gravity: str, side: str) -> Any:
    """Return the experiment that `armgpi export --target` writes the controller of."""
    data = targets.described(target, arm, BITS, gravity, dt, side)
    origin = config.Origin(target)
    return config.build(config.check(data, origin), origin)


def suited(supervisor: Supervisor, given: dict[str, Any]) -> Supervisor:
    """Return a supervisor with other bounds."""
    return Supervisor(**{name: getattr(supervisor, name) for name in parameters(Supervisor)} | given)


def plant_of(case: Case, robot: Robot, late: Any, **given: Any) -> Any:
    """Return the arm with sensors; `given` is its friction."""
    zero = np.zeros((len(late), robot.n)) if given else 0.0
    if case.elastic:
        arm: Any = ElasticPlant(
            *(robot, (), Friction(zero, zero)), substeps=round(case.dt / 1e-3), link_coulomb=zero, **given
        )
    else:
        arm = RigidBodyPlant(robot, friction=Friction(given["link_viscous"], zero) if given else None)
    return Delayed(Encoder(Saturated(arm), bits=BITS), late)


def move_of(robot: Robot, rest: bool, dt: float) -> tuple[Bezier, int]:
    """Return a move, and the sample of its fastest moment."""
    middle = robot.middle()
    if rest:
        return Bezier(middle, middle, 1.0), round(0.2 / dt)
    step = np.minimum(0.4, 0.4 * (robot.limits.upper - middle))
    peak = float(np.abs(Bezier(middle, middle + step, 1.0).at(np.array([0.5])).v).max())
    duration = peak / SPEED
    return Bezier(middle, middle + step, duration), round(0.5 * duration / dt)


def happened(case: Case, faults: list[Fault], seconds: float = SECONDS, **given: Any) -> list[Outcome]:
    """Let faults that share the arm and the samples missed happen in a batch: in each joint, at each delay.

    Args:
        case: the arm.
        faults: with the same `away`, `blocked`, `payload` and `rest`.
        seconds: that are simulated after them [s].
        **given: bounds of the supervisor that differ from the export's.
    """
    experiment = experiment_of(*case[:4], case.side)
    robot, dt, one = experiment.robot, case.dt, faults[0]
    law = next(iter(experiment.controllers.values()))
    supervised = Supervised(law, suited(experiment.supervisor, given))
    rows = [
        (fault, joint, late)
        for late in sorted(set(TARGETS[case.target].delays))
        for fault in faults
        for joint in (range(robot.n) if fault.each else (-1,))
    ]
    late = np.array([[float(row[2])] for row in rows])
    joints = np.array([[row[1]] for row in rows])
    hit = (joints < 0) | (joints == np.arange(robot.n))
    of_fault = [np.array([row[0] is fault for row in rows]) for fault in faults]
    healthy = plant_of(case, robot, late)
    broken = plant_of(case, robot.with_payload(robot.tip, one.payload) if one.payload else robot, late)
    if one.blocked:
        broken = plant_of(case, robot, late, link_viscous=BLOCKED * hit)
    reference, begin = move_of(robot, one.rest, dt)
    shape = (len(rows), robot.n)
    q = np.array(np.broadcast_to(reference.at(0.0).q, shape))
    arm = ArmEnd(healthy, robot, dt, Watchdog(), q, np.zeros(shape), velocity=False)
    state = supervised.init(Measurement(arm.sample().values), reference.at(0.0))
    truths: list[Any] = []
    first: Any = None
    sent, missed, rate = np.zeros(shape), 0, np.zeros(len(rows))
    noticed = np.full(len(rows), np.inf)
    for k in range(begin + round(seconds / dt)):
        t, target = (k - begin) * dt, reference.at(k * dt)
        seen, wanted = arm.sample().values, np.broadcast_to(target.q, shape)
        if k == begin:
            arm.plant, first = broken, (seen, wanted)
        if k >= begin:
            truth = arm.plant.true_state(arm.state)
            truths.append((truth.q, truth.v, target.q))
            if t < one.away - 1e-9:
                missed += 1
                arm.advance(None)
                continue
            sample = Sample(t, hit, seen, wanted, *first)
            for fault, its in zip(faults, of_fault, strict=True):
                its = its[:, None] & hit
                seen = seen if fault.q is None else np.where(its, fault.q(sample), seen)
                wanted = wanted if fault.r is None else np.where(its, fault.r(sample), wanted)
        tau, state = supervised.advance(Measurement(seen), target._replace(q=wanted), state, 1 + missed)
        rate, sent, missed = np.maximum(rate, np.abs(tau - sent).max(axis=1) / dt), tau, 0
        acting = tau
        if k >= begin:
            found = state.supervisor.reason[:, 0] > 0.0
            noticed = np.where(found & (noticed == np.inf), t, noticed)
            for fault, its in zip(faults, of_fault, strict=True):
                if fault.tau is not None:
                    acting = np.where(its[:, None] & hit, fault.tau(t, tau, robot.limits.effort), acting)
        arm.advance(Datagram(TORQUE, k, k * dt, acting))
    q, v = (np.array([truth[i] for truth in truths]) for i in (0, 1))
    wanted = np.array([truth[2] for truth in truths])
    watch = state.supervisor
    return [
        Outcome(
            *(case, *row, np.arange(len(q)) * dt, q[:, i], v[:, i], wanted),
            State(int(watch.status[i, 0])).name.lower(),
            Reason(int(watch.reason[i, 0])).name.lower(),
            *(float(noticed[i]), float(rate[i])),
        )
        for i, row in enumerate(rows)
    ]


def least(case: Case) -> tuple[float, float]:
    """Return how far a joint whose motor is dead travels where the others stop, and under the best law [rad].

    Of the worst joint. Nothing but gravity, and the other joints, changes its share of momentum, (D v)_j. To
    first order, D and gravity as they are when the motor dies: where the others end d_k away, it ends
    ((D v)_j t - G_j t^2 / 2 - sum of D_jk d_k) / D_jj away. Each of them ends near where it was, or near its
    move: a law that lets all joints travel by T moves this one by T times the sum of |D_jk| / D_jj at most.
    """
    robot = experiment_of(*case[:4], case.side).robot
    reference, begin = move_of(robot, False, case.dt)
    now, later = reference.at(begin * case.dt), reference.at(begin * case.dt + SOON)
    inertia, gravity, ahead = robot.mass_matrix(now.q), robot.gravity(now.q), later.q - now.q
    found = []
    for j, row in enumerate(inertia):
        others = np.arange(robot.n) != j
        free = row @ now.v * SOON - 0.5 * gravity[j] * SOON**2
        misses = []
        for on_its_way in np.ndindex(*(2,) * (robot.n - 1)):
            there = (free - row[others] @ (on_its_way * ahead[others])) / row[j]
            misses.append(min(abs(there), abs(there - ahead[j])))
        found.append((misses[0], min(misses) / (1.0 + np.abs(row[others]).sum() / row[j])))
    return tuple(map(max, zip(*found, strict=True)))  # type: ignore[return-value]


def pushed(case: Case) -> tuple[float, float]:
    """Return how far the push of one joint moves it under the law, were there torque enough [rad].

    And how far one whose law knows all of the arm, but sees the push no sooner than its measurements come:
    pushed so long, and pushed back as long. Both of the worst joint.
    """
    robot, small, late = (
        experiment_of(*case[:4], case.side).robot,
        1e-4,
        TARGETS[case.target].delays[0],
    )
    reference, begin = move_of(robot, False, case.dt)
    q = reference.at(begin * case.dt).q
    torque = 0.5 * np.diag(robot.limits.effort)
    arm = RigidBodyPlant(robot, Pulse(-small * torque, onset=0.1, duration=0.05))
    law = GPI.auto(robot, case.dt, bits=BITS, delay=late * case.dt, rest_dead_zone=0.0)
    rollout = simulate(Delayed(arm, late), law, Hold(q), 0.1 + SOON, progress=False)
    at_once = np.abs(np.linalg.solve(robot.mass_matrix(q), torque)).max() * (case.dt * (1 + late)) ** 2
    return float(np.abs(rollout.q - q).max()) / small, float(at_once)


def outcomes_of(case: Case) -> list[Outcome]:
    """Return the outcomes of all faults of an arm; those that leave the loop alike run together."""
    groups: dict[Any, list[Fault]] = {}
    for fault in FAULTS:
        groups.setdefault((fault.away, fault.blocked, fault.payload, fault.rest), []).append(fault)
    found: list[Outcome] = []
    for faults in groups.values():
        found += happened(case, faults)
    spent = f"{time.process_time():.0f} s of CPU"
    print(f"{case.target}, {case}, {case.gravity}: {spent}", file=sys.stderr, flush=True)
    return found


def measure(chosen: list[str]) -> list[Outcome]:
    """Return all outcomes of some targets."""
    found: list[Outcome] = []
    for target in chosen:
        for case in cases(target):
            found += outcomes_of(case)
    return found


def with_side(chosen: list[str], side: str, times: list[float]) -> Iterator[Case]:
    """Yield the arms with gears of some targets, their encoders at a side; no times [s] are all."""
    for target in chosen:
        for case in cases(target):
            is_asked = not times or case.dt in times
            if is_asked and case.arm != "anthropomorphic3":  # it has no gears
                yield case._replace(side=side)


#: What no controller stops at once: the least possible is told beside.
NAMED = ("a motor dead", "a motor turns the other way", *(f.name for f in FAULTS if "push" in f.name))


class Worst(NamedTuple):
    """What became of an arm after a fault: a row of docs/faults.csv, of what went farthest.

    Attributes:
        case: the arm.
        fault: its name.
        kept: joints and delays within both bounds, or going on within that of travel.
        near: within that of travel.
        rested: at rest in time, or going on.
        of: all of them.
        joint: that went farthest; "all" where all are hit.
        late: samples that its measurements are late.
        status: of the supervisor in the end.
        reason: of its stop.
        noticed: when it stopped [s].
        travel: how far that joint went [rad].
        peak: highest speed, of all joints and delays [rad/s].
        rest: when the last of them rested [s].
        rate: highest rate of torque [N m/s].
    """

    case: Case
    fault: str
    kept: int
    near: int
    rested: int
    of: int
    joint: str
    late: int
    status: str
    reason: str
    noticed: float
    travel: float
    peak: float
    rest: float
    rate: float

    @property
    def excepted(self) -> bool:
        """Whether it has no bound: motors, pushes, and nothing measured that holds the arm's weight."""
        lost = self.case.gravity == "arm" and FAULT[self.fault].open
        return self.fault in NAMED or lost

    @property
    def where(self) -> str:
        """Which joint of which arm it is."""
        return f"{self.case}, {self.joint}"


FAULT = {fault.name: fault for fault in FAULTS}
#: Columns of the table for :class:`Case` and what is counted.
HEADS = ("target", "arm", "dt", "gravity", "gears", "fault", "kept", "near", "rested", "of", "joint", "late")
HEADS += ("status", "reason", "noticed", "travel", "peak_speed", "rest", "torque_rate")


def worst_of(found: list[Outcome]) -> Iterator[Worst]:
    """Yield the worst of every arm and fault."""
    groups: dict[Any, list[Outcome]] = {}
    for each in found:
        groups.setdefault((each.case, each.fault.name), []).append(each)
    for (case, fault), mine in groups.items():
        x = max(mine, key=Outcome.travel)
        names = experiment_of(*case[:4], case.side).robot.joint_names
        counts = [sum(y.kept for y in mine), sum(y.travel() <= NEAR for y in mine)]
        counts += [sum(y.goes_on or y.rest <= SOON for y in mine), len(mine)]
        most = (max(y.peak for y in mine), max(y.rest for y in mine), max(y.rate for y in mine))
        yield Worst(
            *(case, fault, *counts, "all" if x.joint < 0 else names[x.joint], x.late, x.status, x.reason),
            *(x.noticed, x.travel(), *most),
        )


def write_table(rows: list[Worst], path: Path) -> None:
    """Write the rows as CSV."""
    with path.open("w", encoding="utf-8", newline="") as file:
        write = csv.writer(file, lineterminator="\n")
        write.writerow(HEADS)
        for row in rows:
            case, numbers = row.case, (f"{x:.4g}" for x in row[10:])
            write.writerow([*case[:4], gears(case), *row[1:10], *numbers])


def read_table(path: Path) -> list[Worst]:
    """Return the rows of a table."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))[1:]
    return [
        Worst(
            *(Case(x[0], x[1], float(x[2]), x[3], x[4] == "elastic"), x[5], *map(int, x[6:10]), x[10]),
            *(int(x[11]), *x[12:14], *map(float, x[14:])),
        )
        for x in rows
    ]


def own_bounds(rows: list[Worst]) -> Iterator[Row]:
    """Yield the bounds that the matrix shows."""
    for target, those in by(rows, lambda row: row.case.target).items():
        bounded = [row for row in those if not row.excepted]
        for kind, moving in by(bounded, lambda row: gears(row.case)).items():
            moving = [row for row in moving if not FAULT[row.fault].rest]
            far = max(moving, key=lambda row: row.travel)
            kept, near, _, of = (sum(row[i] for row in moving) for i in range(2, 6))
            said = f"{kept} of {of}; {near} within {NEAR} rad, farthest {far.travel:.3f} rad"
            yield Row(f"`{target}`, {kind}: {SOON} s, {NEAR} rad after faults in motion", said, kept == of)
        far = max((row for row in bounded if FAULT[row.fault].rest), key=lambda row: row.travel)
        said = f"{far.travel:.4f} rad ({far.fault}: {far.where})"
        yield Row(f"`{target}`: 0.01 rad after faults at rest", said, far.travel <= 0.01)
        rate = TARGETS[target].rate
        if rate is not None:
            most = max(row.rate for row in those) / rate
            said = f"at most {most:.6f} of it, {sum(row.of for row in those)} faults"
            yield Row(f"`{target}`: torque never over its rate", said, most <= 1.0 + 1e-9)


def gears(case: Case) -> str:
    """Return how its gears are."""
    return "elastic" if case.elastic else "rigid"


def by(rows: list[Worst], key: Callable[[Worst], Any]) -> dict[Any, list[Worst]]:
    """Return rows by a property, in the order of its values."""
    return {name: [row for row in rows if key(row) == name] for name in dict.fromkeys(map(key, rows))}


def matrix(rows: list[Worst]) -> Iterator[str]:
    """Yield the lines of a table: a fault in a row, a target and who carries the weight in a column."""
    columns = by(rows, lambda row: (row.case.target, row.case.gravity))
    yield (
        "| fault | " + " | ".join(f"`{target}`, {gravity}" for target, gravity in columns) + " | noticed as |"
    )
    yield "|---|" + "---|" * (len(columns) + 1)
    for fault, mine in by(rows, lambda row: row.fault).items():
        cells = [cell([row for row in mine if row in column]) for column in columns.values()]
        found = [row for row in mine if row.reason != "none"]
        seen = ", ".join(dict.fromkeys(row.reason.upper() for row in found))
        late = max((row.noticed for row in found), default=0.0)
        yield f"| {fault} | {' | '.join(cells)} | {f'{seen}, {1e3 * late:.0f} ms' if seen else 'no fault'} |"


def cell(mine: list[Worst]) -> str:
    """Return travel and rest of the worst, and how many are kept where not all are."""
    kept, of = sum(row.kept for row in mine), sum(row.of for row in mine)
    last = max(row.rest for row in mine)
    said = f"{max(row.travel for row in mine):.3f}, " + (f"{last:.2f}" if np.isfinite(last) else "moves")
    if kept == of:
        return said
    return f"({said}: {kept}/{of})" if all(row.excepted for row in mine) else f"**{said}**: {kept}/{of}"


def beyond(rows: list[Worst]) -> Iterator[str]:
    """Yield the lines of a table of what is not kept: faults that an arm takes alike, the farthest first."""
    yield "| target | arm, joint | gravity | fault | kept | travel [rad] | at rest after | ends as |"
    yield "|---|---|---|---|---|---|---|---|"
    late = [row for row in rows if row.kept < row.of and not row.excepted and not FAULT[row.fault].rest]
    alike: dict[tuple[str, str], list[str]] = {}
    for row in sorted(late, key=lambda row: -row.travel):
        rest = f"{row.rest:.2f} s" if np.isfinite(row.rest) else "moves"
        ends = row.status.upper() + (f" ({row.reason.upper()})" if row.reason != "none" else "")
        found = f"{row.kept} of {row.of} | {row.travel:.3f} | {rest} | {ends}"
        arm = f"`{row.case.target}` | {row.where} | {row.case.gravity}"
        alike.setdefault((arm, found), []).append(row.fault)
    for (arm, found), faults in alike.items():
        yield f"| {arm} | {'; '.join(faults)} | {found} |"


def limits_table(rows: list[Worst]) -> str:
    """Return travel after the named faults beside the least that is possible, the worst of both gears."""
    lines = [
        "| target | arm | gravity by | motor dead | known at once | no controller below | turned motor | "
        "push | push by the controller | seen at once |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for case, mine in by(rows, lambda row: row.case._replace(elastic=False)).items():
        travels = (max(row.travel for row in mine if row.fault == name) for name in NAMED[:3])
        (stopped, best), (linear, at_once) = least(case), pushed(case)
        dead, turned, push = travels
        numbers = (dead, stopped, best, turned, push, linear, at_once)
        cells = " | ".join(f"{x:.3f}" for x in numbers)
        arm = f"{case.arm}, {1e3 * case.dt:g} ms"
        lines.append(f"| `{case.target}` | {arm} | {case.gravity} | {cells} |")
    return "\n".join(lines)


def open_loop() -> str:
    """Return what brake, hold and zero do of arms that nothing else carries, all measurements being lost."""
    lost = [fault for fault in FAULTS if fault.name == "all NaN for good"]
    lines = ["| target | arm | gravity by | brake | hold | zero |", "|---|---|---|---|---|---|"]
    for case in itertools.chain(*map(cases, targets.ARMS)):
        if case.elastic or case.gravity == "robot":
            continue
        cells = []
        for kind in ("brake", "hold", "zero"):
            outcomes = happened(case, lost, on_fault=kind)
            cells.append(", ".join(f"{max(x.travel(t) for x in outcomes):.3f}" for t in (0.1, SOON)))
        lines.append(f"| `{case.target}` | {case} | {case.gravity} | {' | '.join(cells)} |")
    return "\n".join(lines)


def carried() -> list[str]:
    """Return the rows of tools/bounds.py that the page has."""
    lines = (DOCS / "faults.md").read_text(encoding="utf-8").splitlines()
    begin = lines.index("| bound | measured | |")
    rows = itertools.takewhile(lambda line: line.startswith("|"), lines[begin + 2 :])
    return [row for row in rows if not row.startswith(("| `fci`", "| `ur`", "| `ros2_control`", "| `bare`"))]


def arms_table(rows: list[Worst]) -> str:
    """Return the arms of each target, and which of its cases are not measured."""
    lines = ["| target | arms | samples late | not measured |", "|---|---|---|---|"]
    for target in dict.fromkeys(row.case.target for row in rows):
        own = [row.case for row in rows if row.case.target == target]
        arms = " and ".join(dict.fromkeys(f"{case.arm} at {1e3 * case.dt:g} ms" for case in own))
        late = " or ".join(map(str, sorted(set(TARGETS[target].delays))))
        without = "; ".join(
            f"{case}, gravity by the {case.gravity}" for case in cases(target) if case not in own
        )
        lines.append(f"| `{target}` | {arms} | {late} | {without} |")
    return "\n".join(lines)


def page(rows: list[Worst], kept: list[str]) -> str:
    """Return the page."""
    head = Path(__file__).with_suffix(".head.md").read_text(encoding="utf-8")
    table = "\n".join(["| bound | measured | |", "|---|---|---|", *map(str, own_bounds(rows)), *kept])
    head = head.replace("BOUNDS", table).replace("NAMED", limits_table(rows)).replace("OPEN", open_loop())
    for name, lines in (("MATRIX", matrix(rows)), ("BEYOND", beyond(rows))):
        head = head.replace(name, "\n".join(lines))
    return head.replace("ARMS", arms_table(rows)).replace("COUNT", str(len(FAULTS)))


def against(rows: list[Worst], page: list[Worst]) -> Iterator[str]:
    """Yield the rows of a table: outcomes of arms with a known side beside those of the page."""
    known = {(row.case._replace(side=""), row.fault): row for row in page}
    for case, mine in by(rows, lambda row: row.case).items():
        pairs = [(known.get((case._replace(side=""), row.fault)), row) for row in mine]
        both = [(before, row) for before, row in pairs if before is not None]
        worse = ", ".join(
            f"{row.fault} ({before.kept} to {row.kept} of {row.of}, "
            f"{before.travel:.3f} to {row.travel:.3f} rad)"
            for before, row in both
            if row.kept < before.kept
        )
        for side, own in (("unknown", [x for x, _ in both]), (case.side, [x for _, x in both])):
            of = sum(row.of for row in own)
            counts = [f"{sum(row[k] for row in own)} of {of}" for k in (2, 3, 4)]
            said = (worse or "none") if side == case.side else ""
            yield f"| `{case.target}`, {case}, {case.gravity} | {side} | {' | '.join(counts)} | {said} |"


#: Speed [rad/s] below which a joint without brakes and friction that nothing measures is slow as well.
DRIFT = 0.05


def stops(chosen: list[str], side: str, faults: list[Fault], seconds: float) -> Iterator[str]:
    """Yield the lines of a table: when arms stop and rest after faults, by the side of their encoders."""
    yield (
        "| target's arms | fault | side | 0.1 rad | goes on | stops, median [s] "
        f"| at rest 0.5 s after the fault | 0.5 s after the stop | the same, below {DRIFT:g} rad/s |"
    )
    yield "|---|---|---|---:|---:|---:|---:|---:|---:|"
    for target, elastic in itertools.product(chosen, (False, True)):
        mine = [case for case in cases(target) if case.elastic is elastic and case.arm != "anthropomorphic3"]
        for fault, known in itertools.product(faults, ("", side)):
            found = [x for case in mine for x in happened(case._replace(side=known), [fault], seconds)]
            noticed = [x.noticed for x in found if not x.goes_on]
            counts = (
                sum(x.travel() <= NEAR for x in found),
                sum(x.goes_on for x in found),
                f"{np.median(noticed):.3f}" if noticed else "-",
                sum(x.goes_on or x.rest <= SOON for x in found),
                sum(x.rests_after_stop(REST) for x in found),
                sum(x.rests_after_stop(DRIFT) for x in found),
            )
            joints = "elastic" if elastic else "stiff"
            what = f"`{target}`, {joints} ({len(found)}) | {fault.name} | {known or 'unknown'}"
            yield f"| {what} | {' | '.join(map(str, counts))} |"


def main() -> None:
    """Run what is asked for, and write page and table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--target", choices=targets.ARMS, help="this one alone")
    parser.add_argument("--page", action="store_true", help="measure nothing")
    parser.add_argument("--bounds", action="store_true", help="measure the rows of tools/bounds.py as well")
    parser.add_argument(
        "--side", choices=("motor", "link"), help="encoders known to be there; nothing is written"
    )
    parser.add_argument(
        "--sample-times", type=float, nargs="+", default=[], help="with --side: these alone [s]"
    )
    parser.add_argument("--stops", type=float, help="seconds after faults: when arms stop and rest [s]")
    parser.add_argument("--fault", nargs="+", choices=FAULT, default=list(FAULT), help="these alone")
    given = parser.parse_args()
    if given.stops:
        chosen = [given.target] if given.target else list(targets.ARMS)
        faults = [FAULT[name] for name in given.fault]
        for line in stops(chosen, given.side or "motor", faults, given.stops):
            print(line, flush=True)
        return
    if given.side:
        chosen = [given.target] if given.target else list(targets.ARMS)
        page_rows = read_table(DOCS / "faults.csv")
        print(
            "| arm, gravity compensated by | side | kept | 0.1 rad | at rest in time | worse of the faults |"
        )
        print("|---|---|---:|---:|---:|---|", flush=True)
        for case in with_side(chosen, given.side, given.sample_times):
            print(*against(list(worst_of(outcomes_of(case))), page_rows), sep="\n", flush=True)
        return
    chosen = [] if given.page else [given.target] if given.target else list(targets.ARMS)
    rows = list(worst_of(measure(chosen)))
    if len(chosen) < len(targets.ARMS):
        rows += [row for row in read_table(DOCS / "faults.csv") if row.case.target not in chosen]
    rows.sort(key=lambda row: list(targets.ARMS).index(row.case.target))
    print(*own_bounds(rows), sep="\n", flush=True)
    write_table(rows, DOCS / "faults.csv")
    kept = [str(row) for row in bounds.rows()] if given.bounds else carried()
    (DOCS / "faults.md").write_text(page(rows, kept), encoding="utf-8")


if __name__ == "__main__":
    main()
