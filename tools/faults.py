"""The fault matrix, on three arms, and all bounds: docs/faults.md (`make faults`).

Each fault happens in the middle of a move of all joints, at 0.75 rad/s for the fastest, with 18-bit encoders.
Everything after it is simulated for a second, without brakes and without friction. The arms have the rotors
that the law believes, and stiff gears. The arm's watchdog is that of `armgpi loop`.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import bounds
import numpy as np
from bounds import Row

from armgpi import (
    GPI,
    Bezier,
    Encoder,
    ExportedController,
    Hold,
    Measurement,
    Pulse,
    RigidBodyPlant,
    Robot,
    Saturated,
    believe_drives,
    simulate,
)
from armgpi.control.supervisor import FaultReport, Supervisor
from armgpi.realtime.datagram import TORQUE, Datagram
from armgpi.realtime.ends import ArmEnd, Watchdog

DOCS = Path(__file__).parents[1] / "docs"
DT, SECONDS, SPEED, BITS = 1e-3, 1.0, 0.75, 18
#: Slower than this is at rest [rad/s].
REST = 0.02
ARMS = bounds.ARMS
#: Rate under which every fault happens once more [N m/s], and for how long [s].
RATE, BRIEFLY = 300.0, 0.2


class Sample(NamedTuple):
    """What a fault may change, `k` samples after it began: what is given to a step, and when it is called."""

    k: int
    q: Any
    q_ref: Any
    first: Any
    called: bool = True


class Fault(NamedTuple):
    """A fault, by what it changes: a sample, the torque that acts, or the arm."""

    name: str
    sample: Callable[[Sample], Sample] = lambda s: s
    torque: Callable[[int, Any, Any], Any] = lambda k, tau, effort: tau
    blocked: bool = False
    payload: float = 0.0
    rest: bool = False


def one(values: Any, value: float) -> Any:
    """Return positions with another one of the second joint."""
    changed = values.copy()
    changed[1] = value
    return changed


def joint(change: Callable[[Sample], float]) -> Callable[[Sample], Sample]:
    """Return a change of the measurement of the second joint."""
    return lambda s: s._replace(q=one(s.q, change(s)))


def away(length: int) -> Callable[[Sample], Sample]:
    """Return that no sample comes for a time."""
    return lambda s: s._replace(called=s.k >= length)


FAULTS = (
    Fault("reference NaN", lambda s: s._replace(q_ref=s.q_ref * np.nan)),
    Fault("reference infinite, once", lambda s: s._replace(q_ref=s.q_ref + np.inf) if s.k == 0 else s),
    Fault("reference jumps by 0.3 rad", lambda s: s._replace(q_ref=s.q_ref + 0.3)),
    Fault("reference stops dead", lambda s: s._replace(q_ref=s.first.q_ref)),
    Fault("one sample NaN", lambda s: s._replace(q=s.q * np.nan) if s.k == 0 else s),
    Fault("10 samples NaN", lambda s: s._replace(q=s.q * np.nan) if s.k < 10 else s),
    Fault("a joint NaN for good", joint(lambda s: np.nan)),
    Fault("all NaN for good", lambda s: s._replace(q=s.q * np.nan)),
    Fault("one sample 1e6 rad", lambda s: s._replace(q=one(s.q, 1e6)) if s.k == 0 else s),
    Fault("a spike of 1 rad", lambda s: s._replace(q=one(s.q, s.q[1] + 1.0)) if s.k == 0 else s),
    Fault("an encoder off by 0.5 rad for good", joint(lambda s: s.q[1] + 0.5)),
    Fault("a joint frozen", joint(lambda s: s.first.q[1])),
    Fault("all joints frozen", lambda s: s._replace(q=s.first.q)),
    Fault(
        "an encoder 5 % wrong from here on", joint(lambda s: s.first.q[1] + 1.05 * (s.q[1] - s.first.q[1]))
    ),
    Fault("an encoder counts backwards", joint(lambda s: 2.0 * s.first.q[1] - s.q[1])),
    Fault("samples missed for 5 ms", away(5)),
    Fault("samples missed for 20 ms", away(20)),
    Fault("samples missed for 50 ms", away(50)),
    Fault("a joint blocked", blocked=True),
    Fault("a push of half the effort for 50 ms", torque=lambda k, tau, effort: tau + 0.5 * effort * (k < 50)),
    Fault("a motor dead", torque=lambda k, tau, effort: one(tau, 0.0)),
    Fault("a motor at half its torque", torque=lambda k, tau, effort: one(tau, 0.5 * tau[1])),
    Fault("a motor turns the other way", torque=lambda k, tau, effort: one(tau, -tau[1])),
    Fault("0.5 kg picked up unnoticed", payload=0.5),
    Fault("at rest: all NaN for good", lambda s: s._replace(q=s.q * np.nan), rest=True),
    Fault("at rest: reference NaN", lambda s: s._replace(q_ref=s.q_ref * np.nan), rest=True),
    Fault("at rest: a joint frozen", joint(lambda s: s.first.q[1]), rest=True),
    Fault("at rest: an encoder off by 0.5 rad", joint(lambda s: s.q[1] + 0.5), rest=True),
)


class Outcome(NamedTuple):
    """What became of an arm: times from the fault on [s], positions [rad], velocities [rad/s].

    `wanted` is where its move would be, and `steepest` the largest change of torque in a sample [N m].
    """

    times: Any
    q: Any
    v: Any
    wanted: Any
    report: FaultReport
    noticed: float
    steepest: float

    def travel(self, seconds: float = 0.5) -> float:
        """Return how far a joint went from where it was, and from its move, whichever is nearer [rad]."""
        away = [np.abs(self.q - other).max(axis=1) for other in (self.q[0], self.wanted)]
        return float(np.minimum(*away)[self.times <= seconds].max())

    @property
    def rest(self) -> float:
        """Time from which on the arm is at rest [s]; infinite when it is not."""
        moving = np.flatnonzero(np.abs(self.v).max(axis=1) > REST)
        last = moving[-1] + 1 if moving.size else 0
        return float(self.times[last]) if last < len(self.times) else np.inf


@cache
def exported(name: str, gravity: str, given: tuple[tuple[str, Any], ...]) -> ExportedController:
    """Return the controller as exported C, which takes a tenth of the time of Python."""
    robot = robot_of(name, gravity)
    supervisor = Supervisor(resolution=robot.encoder_count(BITS), **dict(given))
    return ExportedController.of(GPI.untuned(robot, DT, bits=BITS), supervisor=supervisor)


@cache
def robot_of(name: str, gravity: str) -> Robot:
    """Return an arm with rotors of stiff gears, as its law believes, without gravity if the robot has it."""
    robot = believe_drives(Robot.load(name, lock=list(ARMS[name])), "believed")
    return robot.with_gravity((0.0, 0.0, 0.0)) if gravity == "robot" else robot


def happened(name: str, gravity: str, fault: Fault, seconds: float = SECONDS, **given: Any) -> Outcome:
    """Let a fault happen under a supervisor with such bounds, and return what became of the arm."""
    robot = robot_of(name, gravity)
    reference, begin = move_of(robot, fault.rest)
    plant = Encoder(Saturated(RigidBodyPlant(robot)), bits=BITS)
    loaded = robot.with_payload(robot.tip, fault.payload) if fault.payload else robot
    supervised = exported(name, gravity, tuple(given.items()))
    q = reference.at(0.0).q
    arm = ArmEnd(plant, robot, DT, Watchdog(), q, np.zeros(robot.n), velocity=False)
    state = supervised.init(Measurement(arm.sample().values), reference.at(0.0))
    rows: list[Any] = []
    first, tau, missed, noticed, steepest = None, np.zeros(robot.n), 0, np.inf, 0.0
    for k in range(begin + round(seconds / DT)):
        target = reference.at(k * DT)
        sample = Sample(k - begin, arm.sample().values, target.q, first)
        if k == begin:
            arm.plant = Encoder(Saturated(RigidBodyPlant(loaded)), bits=BITS)
        if k >= begin:
            truth = plant.true_state(arm.state)
            rows.append((truth.q, truth.v, target.q))
            first = sample if first is None else first
            sample = fault.sample(sample._replace(first=first))
        if not sample.called:
            missed += 1
            arm.advance(None)
            continue
        before = tau
        seen = Measurement(sample.q), target._replace(q=sample.q_ref)
        tau, state = supervised.advance(*seen, state, 1 + missed)
        steepest, missed = max(steepest, float(np.abs(tau - before).max()) / (1 + missed)), 0
        if k >= begin and noticed == np.inf and supervised.report(state).reason != "none":
            noticed = (k - begin) * DT
        acting = fault.torque(k - begin, tau, robot.limits.effort) if k >= begin else tau
        arm.advance(Datagram(TORQUE, k, k * DT, acting))
        if k >= begin and fault.blocked:
            stuck = plant.true_state(arm.state)
            arm.state = plant.init(one(stuck.q, rows[0][0][1]), one(stuck.v, 0.0))
    columns = (np.array(part) for part in zip(*rows, strict=True))
    return Outcome(np.arange(len(rows)) * DT, *columns, supervised.report(state), noticed, steepest)


def move_of(robot: Robot, rest: bool) -> tuple[Bezier, int]:
    """Return a move, and the sample of its fastest moment."""
    middle = robot.middle()
    if rest:
        return Bezier(middle, middle, 1.0), 200
    step = np.minimum(0.4, 0.4 * (robot.limits.upper - middle))
    peak = float(np.abs(Bezier(middle, middle + step, 1.0).at(np.array([0.5])).v).max())
    duration = peak / SPEED
    return Bezier(middle, middle + step, duration), round(0.5 * duration / DT)


def cell(found: Outcome) -> str:
    """Return what the table says of an outcome."""
    state = found.report.status.upper()
    if found.report.reason != "none":
        state += f" ({found.report.reason.upper()}, {1e3 * found.noticed:.0f} ms)"
    rest = f"{found.rest:.2f} s" if np.isfinite(found.rest) else "moves"
    return f"{state} | {found.travel():.3f} | {np.abs(found.v).max():.2f} | {rest}"


Matrix = dict[tuple[str, str, str], Outcome]


def own_bounds(matrix: Matrix, rated: list[Outcome]) -> list[Row]:
    """Return the bounds that the matrix shows, and what happened under a rate of torque."""
    nan = [found for (_, _, fault), found in matrix.items() if fault == "reference NaN"]
    slowest, farthest = max(x.rest for x in nan), max(x.travel() for x in nan)
    rows = [
        Row(
            "NaN reference at 0.75 rad/s: at rest within 0.5 s and 0.05 rad",
            f"{slowest:.2f} s, {farthest:.3f} rad (worst of arms and gravities)",
            slowest <= 0.5 and farthest <= 0.05,
        )
    ]
    for rest, limit in ((True, 0.01), (False, 0.05)):
        names = [fault.name for fault in FAULTS if fault.rest == rest]
        worst = {name: max(matrix[each, "robot", name].travel() for each in ARMS) for name in names}
        over = {name: x for name, x in worst.items() if x > limit}
        said = f"{len(worst) - len(over)} of {len(worst)} faults"
        said += "".join(f"; {name} {x:.3f}" for name, x in over.items())
        where = "at rest" if rest else "in motion"
        rows.append(Row(f"gravity by the robot, {where}: {limit} rad after any single fault", said, not over))
    steepest = max(found.steepest for found in rated) / (RATE * DT)
    said = f"at most {steepest:.4f} of the rate ({len(rated)} starts and faults)"
    rows.append(Row("torque never over its rate, in any state", said, steepest <= 1.0 + 1e-9))
    blocked = max(found.noticed for (_, _, fault), found in matrix.items() if fault == "a joint blocked")
    rows.append(Row("a blocked joint is a fault within 1 s", f"{1e3 * blocked:.0f} ms", blocked <= 1.0))
    return rows


def least(name: str, seconds: float = 0.5) -> tuple[float, float]:
    """Return how far a joint whose motor is dead travels where the others stop, and under the best law [rad].

    Without gravity and friction nothing but the other joints changes its share of momentum, (D v)_j. To first
    order, D as it is when the motor dies: where the others end d_k away, it ends
    ((D v)_j t - sum of D_jk d_k) / D_jj away. Each of them ends near where it was, or near its move: a law
    that lets all joints travel by T moves this one by T times the sum of |D_jk| / D_jj at most.
    """
    robot = robot_of(name, "robot")
    reference, begin = move_of(robot, rest=False)
    now, later = reference.at(begin * DT), reference.at(begin * DT + seconds)
    row, ahead, others = robot.mass_matrix(now.q)[1], later.q - now.q, np.arange(robot.n) != 1
    misses = []
    for on_its_way in np.ndindex(*(2,) * (robot.n - 1)):
        moved = row[others] @ (on_its_way * ahead[others])
        there = (row @ now.v * seconds - moved) / row[1]
        misses.append(min(abs(there), abs(there - ahead[1])))
    return misses[0], min(misses) / (1.0 + np.abs(row[others]).sum() / row[1])


def pushed(name: str) -> tuple[float, float]:
    """Return how far the push moves a joint that follows the rule's law, were there torque enough [rad].

    And how far one whose law knows all of the arm, but sees the push no sooner than a sample after it began:
    pushed for a sample, and pushed back for another.
    """
    robot, small = robot_of(name, "robot"), 1e-4
    reference, begin = move_of(robot, rest=False)
    q = reference.at(begin * DT).q
    torque = 0.5 * robot.limits.effort
    plant = RigidBodyPlant(robot, Pulse(-small * torque, onset=0.1, duration=0.05))
    law = GPI.untuned(robot, DT, bits=BITS, rest_dead_zone=0.0)
    rollout = simulate(plant, law, Hold(q), 0.3, progress=False)
    at_once = np.abs(np.linalg.solve(robot.mass_matrix(q), torque)).max() * DT**2
    return float(np.abs(rollout.q - q).max()) / small, float(at_once)


def page(matrix: Matrix, torques: Matrix, kept: list[Row]) -> str:
    """Return the page."""
    head = Path(__file__).with_suffix(".head.md").read_text(encoding="utf-8").rstrip("\n")
    table = "\n".join(["| bound | measured | |", "|---|---|---|", *map(str, kept)])
    known = {name: least(name) for name in ARMS}
    stopped, best = (", ".join(f"{name} {each[k]:.3f}" for name, each in known.items()) for k in (0, 1))
    pushes = {name: pushed(name) for name in ARMS}
    head = head.replace("LINEAR", ", ".join(f"{name} {far:.3f}" for name, (far, _) in pushes.items()))
    head = head.replace("AT_ONCE", f"{max(far for _, far in pushes.values()):.3f}")
    parts = [head.replace("BOUNDS", table).replace("LEAST", best).replace("STOPPED", stopped)]
    heads = "| fault | after a second | travel [rad] | peak speed [rad/s] | at rest after |"
    heads += "\n|---|---|---|---|---|"
    for name in ARMS:
        for gravity in ("arm", "robot"):
            rows = [f"| {fault.name} | {cell(matrix[name, gravity, fault.name])} |" for fault in FAULTS]
            parts += [f"### {name}, gravity by the {gravity}", "\n".join([heads, *rows])]
    rows = ["| arm | gravity by | brake | hold | zero |\n|---|---|---|---|---|"]
    for name in ARMS:
        for gravity in ("arm", "robot"):
            cells = [torques[name, gravity, kind] for kind in ("brake", "hold", "zero")]
            texts = " | ".join(f"{x.travel(0.1):.3f}, {x.travel(0.5):.3f}" for x in cells)
            rows.append(f"| {name} | {gravity} | {texts} |")
    said = (
        "All measurements are NaN for good, at 0.75 rad/s. Travel in 0.1 s and in 0.5 s [rad]; brakes should "
        "have gripped by then."
    )
    parts += ["## Open loop: brake, hold or zero", said, "\n".join(rows)]
    return "\n\n".join(parts) + "\n"


def picture(matrix: Matrix, path: Path) -> None:
    """Draw the four worst of them: by travel in half a second, each fault once."""
    import matplotlib.pyplot as plt

    ranked = sorted(matrix.items(), key=lambda item: -item[1].travel())
    worst = list({key[2]: (key, found) for key, found in reversed(ranked)}.values())[::-1]
    worst = sorted(worst, key=lambda item: -item[1].travel())[:4]
    figure, axes = plt.subplots(2, 2, figsize=(9.0, 5.5), layout="constrained")
    for axis, ((name, gravity, fault), found) in zip(axes.flat, worst, strict=True):
        axis.plot(found.times, found.q - found.q[0])
        axis.axvline(found.noticed, color="0.6", linestyle="--") if np.isfinite(found.noticed) else None
        axis.set_title(
            f"{fault}\n{name}, gravity by the {gravity}: {found.report.status.upper()}", fontsize=9
        )
        axis.set(xlabel="time since the fault [s]", ylabel="travel [rad]")
    figure.savefig(path, dpi=110)


#: What is simulated: arm, gravity, number of the fault, seconds, and bounds of the supervisor.
Task = tuple[str, str, int, float, dict[str, Any]]


def done(task: Task) -> Outcome:
    """Return what became of one task, in a process of its own."""
    name, gravity, number, seconds, given = task
    return happened(name, gravity, FAULTS[number], seconds, **given)


def main() -> None:
    """Run all and write page and picture."""
    kinds = [(name, gravity) for name in ARMS for gravity in ("arm", "robot")]
    lost = next(i for i, fault in enumerate(FAULTS) if fault.name == "all NaN for good")
    tasks: dict[Any, Task] = {}
    for name, gravity in kinds:
        for i, fault in enumerate(FAULTS):
            tasks[name, gravity, fault.name] = (name, gravity, i, SECONDS, {})
        for kind in ("brake", "hold", "zero"):
            tasks["open", name, gravity, kind] = (name, gravity, lost, SECONDS, {"on_fault": kind})
    for name in ARMS:
        for i in range(len(FAULTS)):
            tasks["rate", name, i] = (name, "arm", i, BRIEFLY, {"torque_rate": RATE})
    with ProcessPoolExecutor() as pool:
        found = dict(zip(tasks, pool.map(done, tasks.values()), strict=True))
    matrix: Matrix = {key: x for key, x in found.items() if len(key) == 3 and key[0] != "rate"}
    torques: Matrix = {key[1:]: x for key, x in found.items() if key[0] == "open"}
    kept = own_bounds(matrix, [x for key, x in found.items() if key[0] == "rate"])
    print(*kept, sep="\n", flush=True)
    for row in bounds.rows():
        kept.append(row)
        print(row, flush=True)
    (DOCS / "faults.md").write_text(page(matrix, torques, kept), encoding="utf-8")
    picture(matrix, DOCS / "images" / "faults.png")


if __name__ == "__main__":
    main()
