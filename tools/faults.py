"""The fault matrix: faults on three arms, gravity by arm and by robot, as docs/faults.md: `make faults`.

Each fault happens in the middle of a move of all joints, at 0.75 rad/s for the fastest, with 18-bit encoders.
Everything after it is simulated for a second, without brakes and without friction.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armgpi import GPI, Bezier, ClosedLoop, Encoder, Measurement, RigidBodyPlant, Robot, Saturated, Supervised
from armgpi.control.supervisor import FaultReport, Supervisor

DOCS = Path(__file__).parents[1] / "docs"
DT, SECONDS, SPEED, BITS = 1e-3, 1.0, 0.75, 18
#: Slower than this is at rest [rad/s].
REST = 0.02
ARMS = {
    "anthropomorphic3": (),
    "ur5": (),
    "panda": ("panda_finger_joint1", "panda_finger_joint2"),
}


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
    Fault("a motor turns the other way", torque=lambda k, tau, effort: one(tau, -tau[1])),
    Fault("0.5 kg picked up unnoticed", payload=0.5),
    Fault("at rest: all NaN for good", lambda s: s._replace(q=s.q * np.nan), rest=True),
    Fault("at rest: reference NaN", lambda s: s._replace(q_ref=s.q_ref * np.nan), rest=True),
    Fault("at rest: a joint frozen", joint(lambda s: s.first.q[1]), rest=True),
    Fault("at rest: an encoder off by 0.5 rad", joint(lambda s: s.q[1] + 0.5), rest=True),
)


class Outcome(NamedTuple):
    """What became of an arm: times from the fault on [s], positions [rad], velocities [rad/s]."""

    times: Any
    q: Any
    v: Any
    report: FaultReport
    noticed: float

    def travel(self, seconds: float = 0.5) -> float:
        """Return the farthest that a joint went [rad]."""
        return float(np.abs(self.q[self.times <= seconds] - self.q[0]).max())

    @property
    def rest(self) -> float:
        """Time from which on the arm is at rest [s]; infinite when it is not."""
        moving = np.flatnonzero(np.abs(self.v).max(axis=1) > REST)
        last = moving[-1] + 1 if moving.size else 0
        return float(self.times[last]) if last < len(self.times) else np.inf


def robot_of(name: str, gravity: str) -> Robot:
    """Return an arm, without gravity where the robot compensates it."""
    robot = Robot.load(name, lock=list(ARMS[name]))
    return robot.with_gravity((0.0, 0.0, 0.0)) if gravity == "robot" else robot


def happened(name: str, gravity: str, fault: Fault, on_fault: str = "brake") -> Outcome:
    """Let a fault happen and return what became of the arm."""
    robot = robot_of(name, gravity)
    reference, begin = move_of(robot, fault.rest)
    plant = Encoder(Saturated(RigidBodyPlant(robot)), bits=BITS)
    after = plant
    if fault.payload:
        after = Encoder(Saturated(RigidBodyPlant(robot.with_payload(robot.tip, fault.payload))), bits=BITS)
    count = robot.encoder_count(BITS)
    supervised = Supervised(GPI(robot, DT), Supervisor(on_fault=on_fault, resolution=count))
    _, arm, state = ClosedLoop(plant, supervised, reference).init()
    rows: list[Any] = []
    first, tau, missed, noticed = None, np.zeros(robot.n), 0, np.inf
    for k in range(begin + round(SECONDS / DT)):
        target, measured = reference.at(k * DT), plant.measure(arm)
        sample = Sample(k - begin, measured.q, target.q, first)
        if k >= begin:
            first = sample if first is None else first
            sample = fault.sample(sample._replace(first=first))
        missed = missed + 1 if not sample.called else missed
        if sample.called:
            given = Measurement(sample.q), target._replace(q=sample.q_ref)
            tau, state = supervised.advance(*given, state, 1 + missed)
            missed = 0
        truth = plant.true_state(arm)
        acting = tau
        if k >= begin:
            rows.append((truth.q, truth.v))
            acting = fault.torque(k - begin, tau, robot.limits.effort)
            if noticed == np.inf and supervised.report(state).reason != "none":
                noticed = (k - begin) * DT
        arm = (after if k >= begin else plant).step(acting, arm, DT)
        if k >= begin and fault.blocked:
            stuck = plant.true_state(arm)
            arm = plant.init(one(stuck.q, rows[0][0][1]), one(stuck.v, 0.0))
    q, v = (np.array(part) for part in zip(*rows, strict=True))
    return Outcome(np.arange(len(q)) * DT, q, v, supervised.report(state), noticed)


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


def page(matrix: dict[tuple[str, str, str], Outcome], torques: dict[tuple[str, str, str], Outcome]) -> str:
    """Return the page."""
    parts = [Path(__file__).with_suffix(".head.md").read_text(encoding="utf-8").rstrip("\n")]
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


def picture(matrix: dict[tuple[str, str, str], Outcome], path: Path) -> None:
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


def main() -> None:
    """Run all and write page and picture."""
    matrix, torques = {}, {}
    for name in ARMS:
        for gravity in ("arm", "robot"):
            for fault in FAULTS:
                matrix[name, gravity, fault.name] = happened(name, gravity, fault)
            lost = next(fault for fault in FAULTS if fault.name == "all NaN for good")
            for kind in ("brake", "hold", "zero"):
                torques[name, gravity, kind] = happened(name, gravity, lost, kind)
            print(f"{name}, gravity by the {gravity}: done", flush=True)
    (DOCS / "faults.md").write_text(page(matrix, torques), encoding="utf-8")
    picture(matrix, DOCS / "images" / "faults.png")


if __name__ == "__main__":
    main()
