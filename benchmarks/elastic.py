"""An arm whose gears twist: what its plant costs beside the rigid one, compiled, on one thread.

python benchmarks/elastic.py [--quick]
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

from functools import partial

import _arms
import _page
import numpy as np
from _timing import Contender, Spread, spread, table, take_turns

import armgpi
from armgpi.plants.arm import Arm
from armgpi.plants.elastic import ElasticPlant

DT, BATCH, STEPS = 1e-3, 512, 500
#: The most that the plant may cost in rigid ones.
GOAL = 2.5
#: Rotors [kg m^2], stiffness of gears [N m/rad], friction of motors [N m s/rad, N m]: of typical size.
ROTOR, STIFFNESS, FRICTION = 0.3, 1e4, (2.0, 1.0)


def main() -> None:
    page = _page.begin(__file__, "Elastic joints", "rotors and friction, stiff and elastic joints")
    rounds, batch = (3, 64) if page.quick else (7, BATCH)
    _page.say(
        f"Time of {STEPS} steps of {batch} rollouts with GPI, over that of the rigid plant with the same "
        f"rotors: {rounds} rounds, one thread, without the start."
    )
    rows = []
    for name in ("panda", "anthropomorphic3"):
        for rubs in (False, True):
            found = _ratio(name, batch, rounds, rubs)
            kept = "yes" if found.median <= GOAL else "no"
            rows.append(
                [f"{name}, {'with' if rubs else 'without'} friction", f"at most {GOAL:g}", found, kept]
            )
    print(table(["", "goal", "found", "met"], rows))
    page.write()


def _ratio(name: str, batch: int, rounds: int, rubs: bool) -> Spread:
    """Return the time of the elastic plant over that of the rigid one."""
    robot = armgpi.Robot.load(name, lock=_arms.ROBOTS[name]).with_armature(ROTOR)
    friction = armgpi.Friction(*(np.full(robot.n, x) for x in FRICTION)) if rubs else None
    plants: dict[str, Arm] = {
        "rigid": armgpi.RigidBodyPlant(robot, (), friction),
        "elastic": ElasticPlant(robot, (), friction, gear_stiffness=STIFFNESS),
    }
    omega = {"controller.omega": np.linspace(8.0, 10.0, batch)}
    move = armgpi.Bezier(robot.middle(), robot.middle() + 0.2, 0.5)
    contenders = {}
    for kind, plant in plants.items():
        for steps in (1, STEPS):
            law = armgpi.GPI(robot, DT, gains=armgpi.FixedGains(9.0, 1.0, 9.0))
            loop = armgpi.prepare(plant, law, move, steps * DT, record="metrics", backend="compiled")
            contenders[f"{kind} {steps}"] = Contender(partial(loop.run, omega), 1)
    taken = take_turns(contenders, rounds)
    alone = {kind: taken[f"{kind} {STEPS}"].times - taken[f"{kind} 1"].times for kind in plants}
    return spread(alone["elastic"] / alone["rigid"])


if __name__ == "__main__":
    main()
