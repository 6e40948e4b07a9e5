"""Measures what is asked of the way to the arm, bound by bound: rows for docs/faults.md (`make faults`)."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import arm
import fuzz_step
import numpy as np
import verify

from armgpi import (
    GPI,
    Bezier,
    ClosedLoop,
    Encoder,
    MuJoCoPlant,
    RigidBodyPlant,
    Robot,
    Saturated,
    Supervised,
    prepare,
    robots,
    simulate,
)
from armgpi.codegen import build
from armgpi.codegen.source import source, trace_used
from armgpi.codegen.trace import tracing
from armgpi.errors import ArmgpiError
from armgpi.hardware.realtime import Injected, run
from armgpi.health import zoo

DT = 1e-3
ARMS = arm.ROBOTS
#: Samples of a wall-clock run, and of a fuzzer.
SAMPLES, FUZZED = 8000, 1_000_000
#: Samples of a run that is timed; of 64 rollouts a fifth.
SAMPLED = 50_000
PLANTS: tuple[Callable[[Robot], Any], ...] = (RigidBodyPlant, MuJoCoPlant)


class Row(NamedTuple):
    """A bound, what was measured, and whether it is kept; None where it could not be measured."""

    bound: str
    measured: str
    kept: bool | None

    def __str__(self) -> str:
        """Return it as a row of a table."""
        verdict = {True: "kept", False: "**not kept**", None: "not measured"}[self.kept]
        return f"| {self.bound} | {self.measured} | {verdict} |"


def rows() -> Iterator[Row]:
    """Yield the rows, each after it was measured."""
    for measure in (losses, killed, scheduling, second_simulator, cost, fuzzed, instructions, proofs):
        yield measure()


def looped(name: str, seconds: float = 1.6, **options: Any) -> tuple[Any, Any]:
    """Return an arm's loop in two ends, and the same loop without faults: 0.5 rad in 1.2 s, 18 bits."""
    robot = Robot.load(name, lock=list(ARMS[name]))
    start = robot.middle()
    move = Bezier(start, start + 0.5, duration=1.2, t_start=0.2)
    parts = (Encoder(Saturated(RigidBodyPlant(robot)), 18), GPI(robot, DT), move)
    return run(*parts, seconds, **options), lambda: simulate(*parts, seconds, progress=False)


def losses() -> Row:
    """Errors at a fifth of lost datagrams, and at an outage, against the simulation's."""
    worst = {}
    faults = {"20 % loss": Injected(loss=0.2), "outage of 20 ms": Injected(outage=(0.8, 0.02))}
    for what, injected in faults.items():
        ratios = []
        for name in ARMS:
            outcome, without = looped(name, injected=injected, clock="simulated")
            ratios.append(outcome.report(without())["error_ratio"]["peak"])
        worst[what] = max(ratios)
    said = ", ".join(f"{what}: {ratio:.3f}" for what, ratio in worst.items())
    bound = "error at 20 % loss and at a 20 ms outage: 1.05 of the simulation's"
    return Row(bound, f"{said} (worst of the arms)", max(worst.values()) <= 1.05)


def killed() -> Row:
    """When the watchdog acts after the controller was killed in motion, and how far the arm goes."""
    late, far = 0, 0.0
    for name in ARMS:
        outcome, _ = looped(name, injected=Injected(kill=0.8), clock="simulated", seconds=2.0)
        late = max(late, outcome.fired[0] - round(0.8 / DT) + 1)
        far = max(far, outcome.travel)
    bound = "controller killed: watchdog within 12 samples, travel 0.1 rad"
    return Row(bound, f"sample {late}, {far:.3f} rad (worst of the arms)", late <= 12 and far <= 0.1)


def scheduling() -> Row:
    """Samples without a torque in time under both ways of scheduling, in turns, on this machine."""
    bound = "misses under SCHED_FIFO: a fifth of those under SCHED_OTHER"
    missed = {"fifo": 0, "other": 0}
    try:
        for _ in range(2):
            for policy in missed:
                missed[policy] += looped("ur5", SAMPLES / 2 * DT, policy=policy)[0].missed
    except ArmgpiError as error:
        return Row(bound, str(error), None)
    measured = f"{missed['fifo']} against {missed['other']}, of {SAMPLES} (UR5)"
    return Row(bound, measured, missed["fifo"] <= 0.2 * missed["other"])


def second_simulator() -> Row:
    """Distance between closed loops of MuJoCo and of armgpi, of every arm with motors."""
    apart: dict[str, float] = {}
    refused = []
    for name in robots.names():
        try:
            robot = Robot.load(name, lock=zoo.fingers(name))
            # Where a torque is cut or not decides between two loops, not between two simulators.
            robot = robot.with_limits(effort=np.maximum(robot.limits.effort, 500.0))
            start = robot.middle()
            law, move = GPI(robot, DT), Bezier(start, start + 0.3, 0.4)
            q = [simulate(plant(robot), law, move, 0.5, progress=False).q.values for plant in PLANTS]
        except ArmgpiError:
            refused.append(name)
            continue
        apart[name] = float(np.abs(q[0] - q[1]).max())
    name = max(apart, key=lambda key: apart[key])
    measured = f"{apart[name]:.1e} rad ({name}, of {len(apart)} arms; {len(refused)} more are refused)"
    return Row("MuJoCo with RK4 against armgpi, ideal sensors: 1e-12 rad", measured, apart[name] <= 1e-12)


def cost() -> Row:
    """What a supervisor adds to the time of a sample of generated loops; see benchmarks/supervisor.py."""
    times: dict[int, list[float]] = {1: [], 64: []}
    counts = []
    for name, locked in ARMS.items():
        robot = Robot.load(name, lock=list(locked))
        law, plant = GPI(robot, DT), Saturated(RigidBodyPlant(robot))
        laws = law, Supervised(law)
        for batch, found in times.items():
            start = robot.middle() if batch == 1 else np.tile(robot.middle(), (batch, 1))
            samples = 16, SAMPLED if batch == 1 else SAMPLED // 5
            runs = [[_moving(plant, x, start, n) for n in samples] for x in laws]
            taken = [[_timed(long) - _timed(short) for short, long in runs] for _ in range(27)]
            alone, supervised = np.array(taken[2:]).T
            found.append(float(np.median(supervised / alone)) - 1.0)
        alone, supervised = (counted(ClosedLoop(plant, x, Bezier(start, start + 0.2, 1.0))) for x in laws)
        counts.append(supervised / alone - 1.0)
    said = [
        f"{what} +{100 * min(shares):.1f} to {100 * max(shares):.1f} %"
        for what, shares in (("64 rollouts", times[64]), ("one", times[1]), ("instructions", counts))
    ]
    kept = max(*times[1], *times[64]) <= 0.1
    return Row("supervisor's cost: 10 % of a compiled sample", "; ".join(said), kept)


def counted(loop: ClosedLoop) -> int:
    """Return how many instructions a sample of a loop takes, without a fault and with no torque cut."""
    with tracing():
        text = source(trace_used(loop, loop.init(), False), build.widest())
    with tempfile.TemporaryDirectory(prefix="armgpi-count-") as made:
        path = Path(made, "loop.c")
        path.write_text(text)
        subprocess.run(["gcc", *build.FLAGS, "-o", f"{made}/loop.so", path, "-lm"], check=True)
        show = ["objdump", "-d", "--no-show-raw-insn", f"{made}/loop.so"]
        said = subprocess.run(show, capture_output=True, text=True, check=True).stdout
    functions = dict(re.findall(r"<([a-z]\w*)[^>]*>:\n((?:.+\n)+)", said))
    body = functions["usual" if "usual" in functions else "sample"]
    called = re.findall(r"call\s+\w+ <(\w+)", body)
    # Straight lines: what is there is taken, but D(q)^-1 of a torque cut, and what is written once.
    once = re.search(r"if \(!kept\) \{\n([^}]*)\}", text)
    kernels = [functions[name] for name in called if name in functions and "inertia_solve" not in name]
    lines = sum(part.count("\n") for part in (body, *kernels))
    return lines - (once[1].count("\n") if once else 0)


def fuzzed() -> Row:
    """Steps with any bits under the sanitizers."""
    bound = "fuzz of a step under sanitizers: 1e6 each, torque finite, within its limits"
    if shutil.which("gcc") is None:
        return Row(bound, "gcc is not installed", None)
    kinds = [(name, real) for name in ARMS for real in ("double", "float")]
    wrong = [f"{name}, {real}" for name, real in kinds if fuzz_step.fuzzed(name, real, FUZZED)[0]]
    return Row(bound, f"{len(kinds)} times {FUZZED:,} steps, {len(wrong)} wrong", not wrong)


def instructions() -> Row:
    """Instructions of the longest step against the typical one, on a Cortex-M7."""
    bound = "`make arm`: float with the bits of x86, worst / typical instructions 1.6"
    if any(shutil.which(tool) is None for tool in arm.TOOLS):
        return Row(bound, "its tools are not installed", None)
    found = {(name, real): arm.compared(name, real) for name in ARMS for real in ("float", "double")}
    ratios = {
        name: max(f.worst / f.typical for (other, _), f in found.items() if other == name) for name in ARMS
    }
    same = all(found[name, "float"].same for name in ARMS)
    said = ", ".join(f"{name} {ratio:.2f}" for name, ratio in ratios.items())
    return Row(bound, f"{'same' if same else 'OTHER'} bits; {said}", same and max(ratios.values()) <= 1.6)


def proofs() -> Row:
    """What Frama-C proves of a step."""
    bound = "`make verify`: no alarm, all torque bounds proved (the paper's arm, UR5)"
    if shutil.which("frama-c") is None:
        return Row(bound, "frama-c is not installed", None)
    proved = [name for name in ("anthropomorphic3", "ur5") if verify.verified(name)]
    return Row(bound, f"proved without an alarm: {', '.join(proved) or 'none'}", len(proved) == 2)


def _moving(plant: Any, law: Any, start: Any, samples: int) -> Callable[[], Any]:
    """Return a run of generated code in which an arm moves all the time."""
    move, kept = Bezier(start, start + 0.2, samples * DT), {"record_every": samples, "backend": "compiled"}
    return prepare(plant, law, move, samples * DT, **kept).run


def _timed(work: Callable[[], Any]) -> float:
    begin = time.process_time()
    work()
    return time.process_time() - begin
