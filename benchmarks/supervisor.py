"""What a supervisor costs in a sample of generated loops, the arm's motion included, on one thread.

python benchmarks/supervisor.py [--quick]
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

from collections.abc import Callable

import _arms
import _page
import numpy as np
from _timing import Contender, Samples, ratio, spread, table, take_turns

import armgpi

GOAL = 1.1
KINDS = ("without", "with")
#: Rollouts -> samples of each.
SAMPLES = {1: 50_000, 64: 10_000}
#: Samples of a run that is there to be taken off: what a run costs besides its samples.
FEW = 16


def main() -> None:
    page = _page.begin(__file__, "Supervisor")
    rounds = 3 if page.quick else 25
    _page.say(
        f"Nanoseconds of processor time per sample and rollout, beyond a run of {FEW} samples, {rounds} "
        f"rounds; × is how many times longer with a supervisor, goal at most {GOAL:g}."
    )
    rows = []
    for name in _arms.ROBOTS:
        for batch, samples in SAMPLES.items():
            taken = take_turns(
                {
                    f"{kind} {count}": Contender(_loop(name, batch, count, kind == "with"), count * batch)
                    for kind in KINDS
                    for count in (FEW, samples)
                },
                rounds,
            )
            alone, supervised = (
                _net(taken[f"{kind} {FEW}"], taken[f"{kind} {samples}"], samples) for kind in KINDS
            )
            times = [spread(1e3 * one.times) for one in (alone, supervised)]
            rows.append([name, batch, *times, ratio(supervised, alone)])
    print(table(["arm", "rollouts", "controller and arm", "with a supervisor", "×"], rows))
    page.write()


def _net(few: Samples, many: Samples, samples: int) -> Samples:
    """Return times of the samples alone."""
    times = (many.times * samples - few.times * FEW) / (samples - FEW)
    return Samples(times, many.cores)


def _loop(name: str, batch: int, samples: int, supervised: bool) -> Callable[[], object]:
    """Return a run of a loop that was made before."""
    robot = armgpi.Robot.load(name, lock=_arms.ROBOTS[name])
    start = robot.middle() if batch == 1 else np.tile(robot.middle(), (batch, 1))
    law: armgpi.Controller = armgpi.GPI(robot, _arms.DT)
    made = armgpi.prepare(
        armgpi.Saturated(armgpi.RigidBodyPlant(robot)),
        armgpi.Supervised(law) if supervised else law,
        armgpi.Bezier(start, start + 0.2, samples * _arms.DT),
        samples * _arms.DT,
        record_every=samples,
        backend="compiled",
    )
    made.run()
    return made.run


if __name__ == "__main__":
    main()
