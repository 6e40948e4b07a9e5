"""References of each rollout: what a `ReferenceBatch` costs beside one reference with arrays, on one thread.

python benchmarks/references.py [--quick]
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

from collections.abc import Callable
from typing import Any

import _page
import numpy as np
from _timing import Contender, plain, ratio, spread, table, take_turns

import armgpi

DT, STEPS = 1e-3, 200
#: What one reference of its own may cost a rollout-step, beside one reference with arrays.
GOAL = 1.2
ARRAYS = "one Bezier with arrays"


def main() -> None:
    page = _page.begin(__file__, "References of each rollout")
    rounds, batches = (3, (64, 1024)) if page.quick else (7, (64, 1024, 16_384, 100_000))
    _page.say(
        f"Microseconds of processor time per rollout-step of UR5, {STEPS} samples, nothing recorded, "
        f"{rounds} rounds; × is how many times longer than {ARRAYS}."
    )
    rows: list[list[object]] = []
    for batch in batches:
        samples = take_turns(_contenders(batch), rounds)
        page.figures[str(batch)] = plain(samples)
        for label, taken in samples.items():
            rows.append([batch, label, spread(taken.times), ratio(taken, samples[ARRAYS])])
    print()
    print(table(["rollouts", "reference", "microseconds", "×"], rows))
    print(f"\nGoal: each Bezier or Waypoints of its own at most {GOAL:g} times.")
    page.write()


def _contenders(batch: int) -> dict[str, Contender]:
    """Return runs of the same moves, asked for in different ways."""
    robot = armgpi.Robot.load("ur5")
    goals = robot.middle() + 0.01 * np.random.default_rng(0).standard_normal((batch, robot.n))
    rest = robot.middle()
    times = np.linspace(0.0, 0.15, 9)
    moves = [armgpi.Bezier(rest, goal, 0.15) for goal in goals]
    ways = [armgpi.Waypoints([rest, goal], 0.15) for goal in goals]
    references: dict[str, armgpi.Reference] = {
        ARRAYS: armgpi.Bezier(np.broadcast_to(rest, goals.shape), goals, 0.15),
        "a Bezier each": armgpi.ReferenceBatch(moves),
        "Waypoints each": armgpi.ReferenceBatch(ways),
        "half of each": armgpi.ReferenceBatch([*moves[: batch // 2], *ways[batch // 2 :]]),
    }
    if batch <= 1024:  # a spline takes long to make
        recordings = [armgpi.Recorded(times, move.at(times).q) for move in moves]
        references["a recording each"] = armgpi.ReferenceBatch(recordings)
    run = {label: _run(robot, reference) for label, reference in references.items()}
    return {label: Contender(one, batch * STEPS, _check) for label, one in run.items()}


def _run(robot: armgpi.Robot, reference: armgpi.Reference) -> Callable[[], Any]:
    """Return a prepared run."""
    law = armgpi.GPI(robot, DT)
    plant = armgpi.RigidBodyPlant(robot)
    loop = armgpi.prepare(plant, law, reference, STEPS * DT, record="metrics", backend="compiled")
    loop.run()
    return loop.run


def _check(result: Any) -> None:
    """Refuse a run that is not near its reference."""
    assert float(np.abs(result["peak_error"]).max()) < 0.5


if __name__ == "__main__":
    main()
