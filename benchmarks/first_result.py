"""Time to the first result of the compiled backend in a fresh process, its code cached or not.

python benchmarks/first_result.py [--quick]
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping

import _arms
import _page
import numpy as np
from _timing import spread, table

#: Robot -> seconds allowed from a cold cache, and when cached.
GOALS = {"panda": (5.0, 0.2)}
#: Lengths of runs among which `auto` chooses [s].
LENGTHS = (0.2, 1.0, 8.0, 40.0)
#: What `auto` may take over the faster one of the two, for looking whether the code is there.
AUTO = 1.25
#: What is run in turn -> its back end: the first one fills the cache.
_RUNS = {"cold": "compiled", "cached": "compiled", "NumPy": "numpy"}
#: What the fresh process does: it prints the seconds before the call and those of it.
_PROGRAM = """
import resource, sys

def spent():  # processor time of this process and of those that it waited for, such as the compiler
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in both)

import armgpi, xarray
name, lock = sys.argv[1], [x for x in sys.argv[2].split(",") if x]
robot = armgpi.Robot.load(name, lock=lock)
q0 = robot.middle()
plant = armgpi.RigidBodyPlant(robot)
controller = armgpi.GPI(robot, 1e-3, armgpi.BSplineNetwork())
reference = armgpi.Bezier(q0, q0 + 0.5, duration=1.0)
loaded = spent()
backend, length = sys.argv[3], float(sys.argv[4])
rollout = armgpi.simulate(plant, controller, reference, length, progress=False, backend=backend)
done = spent()
assert int(rollout["status"]) == 0 and abs(rollout["q"] - rollout["q_ref"]).max() < 0.01
print(loaded, done - loaded)
"""


def main() -> None:
    page = _page.begin(__file__, "Time to the first result")
    rounds = 1 if page.quick else 5
    _page.say(
        f"Seconds, {rounds} fresh processes each: a single run of 1 s at 1 kHz, GPI with networks. Cold: the "
        "code is generated and compiled; cached: loaded. The call is `armgpi.simulate`, importing CasADi "
        "included; before it: imports, loading the robot."
    )
    rows: list[list[object]] = []
    goals: list[list[object]] = []
    for name, lock in _arms.ROBOTS.items():
        taken = _times(name, lock, rounds)
        page.figures[name] = {key: times.tolist() for key, times in taken.items()}
        for key, times in taken.items():
            rows.append([f"{name}, {key}", *(spread(column) for column in times.T)])
        for key, bound in zip(("cold", "cached"), GOALS.get(name, ()), strict=False):
            call = spread(taken[key][:, 1])
            kept = "yes" if call.median <= bound else "no"
            goals.append([f"{name}, {key}: the call", f"{bound:g} s", f"{call} s", kept])
        if name in GOALS:
            share = spread(taken["cached"][:, 1] / taken["NumPy"][:, 1])
            goals.append([f"{name}: cached over NumPy", "1", share, "yes" if share.median <= 1.0 else "no"])
    print()
    print(table(["", "before the call", "the call", "all, on the wall"], rows))
    print("\n## What `auto` chooses\n")
    _page.say("The call alone, for runs of Panda of several lengths.")
    lock, rows = _arms.ROBOTS["panda"], []
    for length in LENGTHS:
        taken = _times("panda", lock, rounds, length, {"cold auto": "auto", **_RUNS, "auto": "auto"})
        page.figures[f"panda, {length:g} s"] = {key: times.tolist() for key, times in taken.items()}
        calls = {key: times[:, 1] for key, times in taken.items()}
        for auto, compiled in (("cold auto", "cold"), ("auto", "cached")):
            share = spread(calls[auto] / np.minimum(calls[compiled], calls["NumPy"]))
            what = f"panda, {length:g} s, {compiled}"
            rows.append([what, *(spread(calls[key]) for key in (compiled, "NumPy", auto))])
            kept = "yes" if share.median <= AUTO else "no"
            goals.append([f"{what}: auto over the faster one", f"{AUTO:g}", share, kept])
    print()
    print(table(["", "compiled", "NumPy", "auto"], rows))
    print("\n## Goals\n")
    print(table(["", "at most", "found", "met"], goals))
    page.write()


def _times(
    name: str,
    lock: tuple[str, ...],
    rounds: int,
    length: float = 1.0,
    runs: Mapping[str, str] = _RUNS,
) -> dict[str, np.ndarray]:
    """Return seconds before the call, of it and of all, (rounds, 3), of runs in this order with one cache."""
    taken: dict[str, list[tuple[float, float, float]]] = {key: [] for key in runs}
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as cache, tempfile.TemporaryDirectory() as other:
            for key, backend in runs.items():
                place = other if key.startswith("cold ") else cache
                taken[key].append(_once(name, lock, backend, place, length))
    return {key: np.array(rows) for key, rows in taken.items()}


def _once(
    name: str, lock: tuple[str, ...], backend: str, cache: str, length: float
) -> tuple[float, float, float]:
    """Run the program in a process of its own."""
    begun = time.perf_counter()
    said = subprocess.run(
        [sys.executable, "-c", _PROGRAM, name, ",".join(lock), backend, str(length)],
        env={**os.environ, "ARMGPI_CACHE": cache, "OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    before, call = map(float, said.stdout.split())
    return before, call, time.perf_counter() - begun


if __name__ == "__main__":
    main()
