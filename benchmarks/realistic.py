"""The loop that `armgpi run` simulates for an arm beside the rigid one: elastic joints, friction, supervisor.

python benchmarks/realistic.py [--quick]
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from unittest import mock

import _arms
import _page
import numpy as np
from _timing import Contender, Samples, Spread, ratio, spread, table, take_turns

import armgpi
from armgpi import config as configuration

ARMS = ("ur5", "panda")
#: Friction of every joint [N m s/rad, N m]: of no arm of the two is any in its file.
FRICTION = {"viscous": 0.5, "coulomb": 1.0}
#: Rollouts -> samples of each; and samples of a run that is there to be taken off.
SAMPLES, FEW = {1: 20_000, 256: 2_000}, 16
#: Processes that time the loops, each with copies of their code: where its pages lie in memory changes a loop
#: by up to 1.5 times, and a file stays where it is from process to process.
PLACES = 7
#: Rollouts of which the start is timed.
MANY = 4096
#: What the realistic loop may cost in rigid ones, and friction on stiff joints in none.
REALISTIC, RUBBING = 1.6, 1.25
#: What a first compiled run may take, in times of importing NumPy and Pinocchio; a rollout's start [us].
FIRST, START = 12.0, 2.0
#: What one sample of controller and reference may take in Python [us], and of how many the time is taken.
PYTHON, CALLS = 40.0, 2000
#: How far starts are apart [rad].
APART = 1e-3
RIGID, RUBS, TWISTS, COUNTS, WATCHED = (
    "stiff joints, fixed gains",
    "and friction",
    "elastic joints with friction",
    "and encoders, a delayed sample, automatic tuning",
    "and a supervisor: the realistic loop",
)
#: What is built in a fresh process, of which the time counts: see :func:`_first`.
PROGRAM = """
import resource, sys
import numpy, pinocchio
def spent():  # processor time of this process and of those that it waited for, such as the compiler
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in both)
begun = spent()
import armgpi
from armgpi import config
from armgpi.config import experiment
origin = config.Origin("benchmark")
made = config.build(config.check(DATA, origin), origin)
found = experiment.record_all(made, backend="compiled")
assert all(each.recording.status[0] == 0 for each in found.values())
print(begun, spent() - begun)
"""


def main() -> None:
    page = _page.begin(__file__, "The realistic loop", "that of each row, built up from stiff joints")
    rounds, places = (3, 1) if page.quick else (3, PLACES)
    arms = ARMS[:1] if page.quick else ARMS
    _page.say(
        f"Nanoseconds of processor time per sample and rollout, beyond a run of {FEW} samples, {rounds} "
        f"rounds in each of {places} processes, whose compiled code is at another place of memory; × is how "
        "many times as long as the first row. Nothing but metrics is recorded."
    )
    goals: list[list[object]] = []
    for name in arms:
        print(f"\n## {name}\n")
        rows: list[list[object]] = []
        for rollouts, samples in SAMPLES.items():
            taken = _steps_at_places(name, rollouts, samples, rounds, places)
            for kind, times in taken.items():
                rows.append([kind, rollouts, spread(1e3 * times.times), ratio(times, taken[RIGID])])
            page.figures[f"{name}, {rollouts}"] = {kind: each.times.tolist() for kind, each in taken.items()}
        print(table(["loop", "rollouts", "ns", "×"], rows))
        goals += _goals(name, taken)
    print("\n## Starts\n")
    _page.say(
        "A first compiled run of the realistic loop, nothing kept, in imports of NumPy and Pinocchio. "
        f"The start of one of {MANY} rollouts in a prepared loop, with one sample. A sample of the automatic "
        "controller and the default reference, called from Python one by one."
    )
    for name in arms:
        first = _first(name, 1 if page.quick else 3)
        goals.append([f"{name}: first compiled run", f"{FIRST:g}", first, _kept(first, FIRST)])
        begin = _start(name, rounds)
        goals.append([f"{name}: start of a rollout [µs]", f"{START:g}", begin, _kept(begin, START)])
        one = _python(name, rounds)
        goals.append([f"{name}: a sample in Python [µs]", f"{PYTHON:g}", one, _kept(one, PYTHON)])
    print("\n## Goals\n")
    print(table(["", "at most", "found", "met"], goals))
    page.write()


def _goals(name: str, taken: Mapping[str, Samples]) -> list[list[object]]:
    """Return the rows of what is asked of the loops of an arm."""
    whole, rubs = ratio(taken[WATCHED], taken[RIGID]), ratio(taken[RUBS], taken[RIGID])
    return [
        [f"{name}: the realistic loop over stiff joints", f"{REALISTIC:g}", whole, _kept(whole, REALISTIC)],
        [f"{name}: friction on stiff joints over none", f"{RUBBING:g}", rubs, _kept(rubs, RUBBING)],
    ]


def _kept(found: Spread, goal: float) -> str:
    """Return whether a goal was reached."""
    return "yes" if found.median <= goal else "no"


def _steps_at_places(name: str, rollouts: int, samples: int, rounds: int, places: int) -> dict[str, Samples]:
    """Return the times of a sample of every loop, those of all processes one after the other."""
    found: dict[str, list[Samples]] = {kind: [] for kind in (RIGID, RUBS, TWISTS, COUNTS, WATCHED)}
    with tempfile.TemporaryDirectory() as folder:
        first = Path(folder) / "0"
        first.mkdir()
        for place in range(places):
            cache = Path(folder) / str(place)
            if cache != first:
                shutil.copytree(first, cache)
            environment = mock.patch.dict(os.environ, ARMGPI_CACHE=str(cache))
            with environment, ProcessPoolExecutor(1, get_context("spawn")) as pool:
                for kind, times in pool.submit(_steps, name, rollouts, samples, rounds).result().items():
                    found[kind].append(times)
    return {kind: Samples(*map(np.concatenate, zip(*every, strict=True))) for kind, every in found.items()}


def _steps(name: str, rollouts: int, samples: int, rounds: int) -> dict[str, Samples]:
    """Return the times of a sample of every loop, without the start of a run."""
    contenders = {}
    for kind in (RIGID, RUBS, TWISTS, COUNTS, WATCHED):
        for count in (FEW, samples):
            contenders[f"{kind} {count}"] = Contender(_loop(name, kind, rollouts, count), count * rollouts)
    taken = take_turns(contenders, rounds)
    return {
        kind: _net(taken[f"{kind} {FEW}"], taken[f"{kind} {samples}"], samples)
        for kind in (RIGID, RUBS, TWISTS, COUNTS, WATCHED)
    }


def _net(few: Samples, many: Samples, samples: int) -> Samples:
    """Return times of the samples alone."""
    return Samples((many.times * samples - few.times * FEW) / (samples - FEW), many.cores)


def _data(name: str) -> dict[str, Any]:
    """Return the experiment of an arm as `armgpi run` has it, with friction and a supervisor."""
    robot = {"name": name, "lock": list(_arms.ROBOTS[name])[:1], "friction": FRICTION}
    return {"robot": robot, "ideal": False, "plant": {"friction": "urdf"}, "supervisor": {}}


def _loop(name: str, kind: str, rollouts: int, samples: int) -> Callable[[], Any]:
    """Return a run of a loop that was made before, as fast as it gets."""
    origin = configuration.Origin("benchmark")
    made = configuration.build(configuration.check(_data(name), origin), origin)
    (automatic,), robot = made.controllers.values(), made.plant.robot
    inner = armgpi.plants.plant.inside(made.plant)
    fixed = armgpi.GPI(robot, automatic.dt, gains=armgpi.FixedGains(9.0, 1.0, 9.0))
    plant, law = {
        RIGID: (armgpi.RigidBodyPlant(robot), fixed),
        RUBS: (armgpi.RigidBodyPlant(robot, (), inner.friction), fixed),
        TWISTS: (inner, fixed),
        COUNTS: (made.plant, automatic),
        WATCHED: (made.plant, armgpi.Supervised(automatic, made.supervisor)),
    }[kind]
    reference, seconds = made.reference, samples * automatic.dt
    loop = armgpi.prepare(plant, law, reference, seconds, record="metrics", backend="compiled")
    start = reference.at(0.0).q
    q0 = start if rollouts == 1 else start + APART * np.linspace(-1.0, 1.0, rollouts)[:, None]
    run = partial(loop.run, q0=q0)
    for _ in range(
        max(1, 100_000 // samples) if rollouts == 1 else 1
    ):  # past code that is made for a short run
        run()
    return run


def _first(name: str, rounds: int) -> Spread:
    """Return what a first compiled run takes, in times of importing NumPy and Pinocchio."""
    found = []
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as cache:
            said = subprocess.run(
                [sys.executable, "-c", PROGRAM.replace("DATA", repr(_data(name)))],
                env={**os.environ, "ARMGPI_CACHE": cache, "PYTHONDONTWRITEBYTECODE": ""},
                stdout=subprocess.PIPE,
                text=True,
                check=True,
            )
        imports, rest = map(float, said.stdout.split())
        found.append(rest / imports)
    return spread(np.array(found))


def _start(name: str, rounds: int) -> Spread:
    """Return what the start of a rollout takes in a run of many [us]."""
    run = _loop(name, WATCHED, MANY, 1)
    found = []
    for _ in range(rounds):
        begun = resource.getrusage(resource.RUSAGE_SELF)
        run()
        ended = resource.getrusage(resource.RUSAGE_SELF)
        found.append((ended.ru_utime + ended.ru_stime - begun.ru_utime - begun.ru_stime) / MANY * 1e6)
    return spread(np.array(found))


def _python(name: str, rounds: int) -> Spread:
    """Return what a sample of the default controller and reference takes in Python [us]."""
    origin = configuration.Origin("benchmark")
    made = configuration.build(configuration.check(_data(name), origin), origin)
    (law,) = made.controllers.values()
    found = []
    for _ in range(rounds):
        target = made.reference.at(0.0)
        measured = armgpi.Measurement(target.q)
        state, begun = law.init(measured, target), resource.getrusage(resource.RUSAGE_SELF)
        for k in range(CALLS):
            target = made.reference.at(k * law.dt)
            state = law.step(measured, target, state).state
        ended = resource.getrusage(resource.RUSAGE_SELF)
        found.append((ended.ru_utime + ended.ru_stime - begun.ru_utime - begun.ru_stime) / CALLS * 1e6)
    return spread(np.array(found))


if __name__ == "__main__":
    main()
