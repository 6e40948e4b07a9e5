"""How often the supervisor's defaults stop healthy arms, and how many of those that fail.

Usage:
    python tools/alarms.py --seed 1 --realities mild wide late slow
    python tools/alarms.py --seed 1 --arms held-out --laws gpi_auto computed_torque --out alarms.json
    python tools/alarms.py --seed 1 --speed 0.5   with SPEED, which is no default
    python tools/alarms.py --seed 1 --realities elastic undriven     as gears of arms twist

Each draw of a reality runs twice, without and with a supervisor. It is healthy where the motors can follow
the reference, and the arm, without one, was not lost (armgpi.health.reality), does not swing for good at
rest, and kept within its position limits and the supervisor's margin: a stop is a false alarm then.
Intervals are those of Clopper and Pearson, of 95 %. Draws of one arm are alike: for a new arm they are
somewhat too narrow.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import xarray as xr
import yaml

from armgpi import Reality, Supervisor
from armgpi.base.intervals import clopper_pearson
from armgpi.base.parameter import parameters
from armgpi.errors import ArmgpiError
from armgpi.health import reality as health
from armgpi.plants.reality import Scenario
from armgpi.supervisor import Reason

sys.path.append(str(Path(__file__).resolve().parent))
from reality import arms as arms_of

#: As they are drawn for every other test of the laws; with good encoders and small loads; late; slow moves;
#: and the kinds of arms that people have.
REALITIES: dict[str, dict[str, Any]] = {
    "wide": {},
    "mild": {"encoder_bits": (16, 20), "payload": (0.0, 0.1)},
    "late": {"delay": (3, 6)},
    "slow": {
        **{"encoder_bits": (16, 20), "payload": (0.0, 0.1)},
        **{"speed": (4.0, 40.0), "duration": (2.5, 10.0), "t_final": 14.0},
    },
    **{kind: {"name": kind} for kind in ("undriven", "elastic", "owned")},
    # The same arms and moves, once with a controller that knows that the encoders are at the motors.
    "motor_unknown": {"name": "owned", "side_known": 0.0},
    "motor_known": {"name": "owned", "side_known": 1.0},
}
SAMPLE_TIMES = (1e-3, 2e-3, 4e-3)
#: Draws of an arm in a row that share sample time and delay: each such pair is compiled.
BLOCK = 64


class Run(NamedTuple):
    """What came of a draw: sample time [s], time of its fault [s], its reason and joint ("" for none).

    It is `able` when the motors can follow the reference, and `held` when all was well unsupervised.
    It `swings` where, unsupervised, it does so at rest, and goes on.
    """

    reality: str
    law: str
    arm: str
    draw: int
    dt: float
    delay: int
    bits: int
    able: bool
    held: bool
    swings: bool
    reason: str
    joint: str
    time: float

    @property
    def healthy(self) -> bool:
        """Whether nothing is wrong with it."""
        return self.able and self.held and not self.swings

    @property
    def stopped(self) -> bool:
        """Whether the supervisor stopped it."""
        return bool(self.reason)


def runs(
    drawn: Reality, reality: str, name: str, law: str, count: int, supervisor: Supervisor, drives: str | None
) -> list[Run]:
    """Return what came of draws of an arm; see :func:`health.draws` for what the law believes.

    Raises:
        ArmgpiError: when the arm or the law cannot be had.
    """
    section = yaml.safe_load(law)
    section = section if isinstance(section, dict) else {"type": section}
    draws, found = health.draws(drawn, name, count, drives), []
    for group, (free, watched) in health.rollouts(draws, section, supervisors=(None, supervisor)):
        for row, draw in enumerate(group):
            outcome, one = health.outcome(free.isel(rollout=row), draw, name), watched.isel(rollout=row)
            reason = Reason(int(one.fault))
            said = (reason.name, str(one.joint.values[int(one.fault_joint)])) if reason else ("", "")
            held = not outcome.failed and inside(free.isel(rollout=row), draw)
            known = (draw.dt, draw.delay, draw.encoder_bits, outcome.feasible, held, outcome.swinging)
            found.append(Run(reality, law, name, draw.index, *known, *said, float(one.t_fault)))
    return found


def inside(rollout: xr.Dataset, draw: Scenario) -> bool:
    """Tell whether an arm stayed within its position limits and the margin: beyond is no false alarm."""
    lower, upper, *_ = draw.robot.limits
    margin = parameters(Supervisor)["position_margin"].default
    q = rollout["q"].values
    return bool(((q >= lower - margin) & (q <= upper + margin)).all())


def table(found: Iterable[Run], groups: Mapping[str, Callable[[Run], Any]]) -> str:
    """Return healthy draws and false alarms by each of some properties, as Markdown."""
    lines = ["| | healthy | false alarms [%] | reasons |", "|---|---|---|---|"]
    rows = list(found)
    for heading, key in {"all": lambda run: "", **groups}.items():
        for value in sorted({key(run) for run in rows}):
            those = [run for run in rows if key(run) == value]
            lines.append(f"| {heading} {value} | {len(those)} | {share(those)} | {reasons(those)} |")
    return "\n".join(lines) + "\n"


def share(those: list[Run]) -> str:
    """Return the share that was stopped, with its interval."""
    return health.share([run.stopped for run in those], clopper_pearson)


def reasons(those: Iterable[Run]) -> str:
    """Return why they were stopped, the most frequent reason first."""
    counted = Counter(run.reason for run in those if run.stopped)
    return ", ".join(f"{reason} {count}" for reason, count in counted.most_common())


def report(found: list[Run]) -> str:
    """Return both halves: false alarms, and what was stopped of the draws that failed."""
    healthy = [run for run in found if run.healthy]
    parts = [
        f"{len(found)} draws, {len(healthy)} healthy.\n",
        table(
            healthy,
            {
                "reality": lambda run: run.reality,
                "law": lambda run: run.law,
                "arm": lambda run: run.arm,
                "sample time [ms]": lambda run: round(1e3 * run.dt, 6),
                "delay [samples]": lambda run: run.delay,
                "bits": lambda run: run.bits,
            },
        ),
    ]
    for run in healthy:
        if run.stopped:
            where = f"{run.arm} draw {run.draw}, {run.joint}, {run.time:.3f} s"
            sampled = f"{1e3 * run.dt:g} ms, {run.delay} late, {run.bits} bits"
            parts.append(f"- {run.reason}: {run.reality}, {run.law}, {where}; {sampled}")
    parts.append("\n| not healthy | draws | stopped [%] | reasons |\n|---|---|---|---|")
    for text, those in (
        ("lost, or out of its limits", [run for run in found if not run.held]),
        ("held, and swings for good", [run for run in found if run.held and run.able and run.swings]),
        ("held, though not feasible", [run for run in found if run.held and not run.able]),
    ):
        parts.append(f"| {text} | {len(those)} | {share(those)} | {reasons(those)} |")
    return "\n".join(parts) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Run what is asked for; 1 when no arm could be run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--per-arm", type=int, default=BLOCK, help="draws of each arm")
    parser.add_argument("--realities", nargs="+", default=["wide"], choices=tuple(REALITIES))
    parser.add_argument("--arms", nargs="+", default=["fit"], help="fit, held-out, or names of arms")
    parser.add_argument("--laws", nargs="+", default=["gpi_auto"], help="types of controllers, or sections")
    parser.add_argument("--drives", choices=("stiff", "elastic"), help="what laws believe")
    parser.add_argument("--sample-times", type=float, nargs="+", default=SAMPLE_TIMES, help="[s]")
    parser.add_argument("--speed", type=float, help="share for SPEED; no check when not given")
    parser.add_argument("--out", type=Path, help="write all runs as JSON")
    given = parser.parse_args(arguments)
    supervisor = Supervisor(speed=given.speed)
    names = arms_of(given.arms[0]) if given.arms[0] in ("fit", "held-out") else given.arms
    found: list[Run] = []
    failed = {}
    for reality in given.realities:
        loops = {"block": BLOCK, "sample_time": tuple(given.sample_times)}
        drawn = Reality(seed=given.seed, **loops, **REALITIES[reality])
        for law in given.laws:
            for name in names:
                try:
                    found += runs(drawn, reality, name, law, given.per_arm, supervisor, given.drives)
                except ArmgpiError as error:
                    failed[f"{name}, {law}"] = str(error)
            print(f"{reality}, {law}: {time.process_time():.0f} s of CPU", file=sys.stderr, flush=True)
    print(report(found))
    for name, reason in failed.items():
        print(f"not run: {name}: {reason}")
    if given.out:
        given.out.write_text(json.dumps([run._asdict() for run in found], indent=1) + "\n", encoding="utf-8")
    return 0 if found else 1


if __name__ == "__main__":
    sys.exit(main())
