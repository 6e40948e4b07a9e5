"""Prepared loops: what a run, a varied rollout and metrics cost beside the bare loop, on one thread.

python benchmarks/prepared.py [--quick]
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

from collections.abc import Callable
from typing import Any

import _arms
import _page
import numpy as np
from _timing import Contender, spread, table, take_turns

import armgpi

DT = 1e-3
#: Rollouts and steps of a generation, and steps of a rollout of the long sweep.
BATCH, STEPS, LONG = 4096, 1000, 2000


def main() -> None:
    page = _page.begin(
        __file__, "Prepared loops", "stiff joints, no rotors, 16-bit encoders, a sample of delay"
    )
    rounds, batch = (3, 512) if page.quick else (7, BATCH)
    _page.say(
        f"{rounds} rounds, one thread. The bare loop records the first and the last sample alone. Batches "
        f"have {batch} rollouts."
    )
    rows: list[list[object]] = []
    for name in ("panda", "anthropomorphic3"):
        rows += _robot(name, batch, rounds)
    print(table(["", "goal", "found", "met"], rows))
    page.write()


def _robot(name: str, batch: int, rounds: int) -> list[list[object]]:
    """Time one robot, its controller with networks, and return the rows of the table."""
    robot = armgpi.Robot.load(name, lock=_arms.ROBOTS[name])
    plant = armgpi.Delayed(armgpi.Encoder(armgpi.RigidBodyPlant(robot, armgpi.Step(0.1, 0.1)), 16), 1)
    law = armgpi.GPI(robot, DT, armgpi.BSplineNetwork())
    move = armgpi.Bezier(robot.middle(), robot.middle() + 0.2, 0.5)
    random = np.random.default_rng(0)
    values = {
        "plant.payload.mass": random.uniform(0.0, 0.2, batch),
        "plant.loads.0.onset": random.uniform(0.0, 0.5, batch),
        "controller.leak": random.uniform(1.0, 5.0, batch),
        "controller.omega": (random.uniform(15.0, 20.0, batch), random.uniform(30.0, 40.0, batch)),
    }
    few = {key: _first(value, 8) for key, value in values.items()}

    def loop(steps: int, record: str) -> Any:
        every = {} if record == "metrics" else {"record_every": steps}
        return armgpi.prepare(plant, law, move, steps * DT, record=record, backend="compiled", **every)

    def run(steps: int, record: str, given: dict[str, Any]) -> Callable[[], Any]:
        made = loop(steps, record)
        made.run(given)
        return lambda: made.run(given)

    nothing = run(1, "metrics", values)
    contenders = {
        "small": Contender(run(1, "metrics", few), 1),
        "start": Contender(nothing, 1),
        "start of bare": Contender(run(1, "all", values), 1),
        "bare": Contender(run(STEPS, "all", values), 1),
        "metrics": Contender(run(STEPS, "metrics", values), 1),
        "long": Contender(run(LONG, "metrics", values), 1),
        "vary": Contender(lambda: robot.varied(payload=values["plant.payload.mass"]), 1),
    }
    taken = take_turns(contenders, rounds)
    alone = taken["bare"].times - taken["start of bare"].times
    adding = taken["metrics"].times - taken["start"].times
    result = nothing()
    n, kept = robot.n, sum(name not in ("status", "t_end") for name in result.data_vars)
    bytes_ = sum(result[x].nbytes for x in result.data_vars) / batch
    found = [
        ("start of a run of 8 rollouts [ms]", 5.0, spread(1e-3 * taken["small"].times)),
        (
            f"varied robots, over their rollouts of {STEPS} steps",
            0.05,
            spread(taken["vary"].times / alone),
        ),
        ("metrics alone over the bare loop, both without their starts", 1.1, spread(adding / alone)),
        (
            f"start of a generation of {batch} x {STEPS} over its time",
            0.1,
            spread(taken["start"].times / taken["metrics"].times),
        ),
        (
            f"all varied, metrics kept, {LONG} steps, over the bare loop's time for as many",
            1.3,
            spread(taken["long"].times / (LONG / STEPS * alone)),
        ),
        (
            f"memory of a result [bytes a rollout], {kept} metrics",
            64.0 + 8.0 * kept * n,
            spread(np.array([bytes_])),
        ),
    ]
    return [
        [f"{name}: {what}", f"at most {most:g}", value, "yes" if value.median <= most else "no"]
        for what, most, value in found
    ]


def _first(value: Any, count: int) -> Any:
    """Return the values of the first rollouts."""
    return tuple(part[:count] for part in value) if isinstance(value, tuple) else value[:count]


if __name__ == "__main__":
    main()
