"""Time to the first result of the compiled backend in a fresh process, its code cached or not.

python benchmarks/first_result.py [--quick]
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time

import _arms
import _page
import numpy as np
from _timing import spread, table

#: Robot -> seconds allowed from a cold cache, and when cached.
GOALS = {"panda": (5.0, 0.2)}
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
rollout = armgpi.simulate(plant, controller, reference, 1.0, progress=False, backend=sys.argv[3])
done = spent()
assert int(rollout["status"]) == 0 and abs(rollout["q"] - rollout["q_ref"]).max() < 0.01
print(loaded, done - loaded)
"""


def main() -> None:
    page = _page.begin(__file__, "Time to the first result")
    rounds = 1 if page.quick else 5
    _page.say(
        f"Seconds, median (least..greatest) of {rounds} fresh processes each: a single run of 1 s at 1 kHz, "
        "GPI with networks. Cold: nothing in the cache, so the code is generated and compiled. Cached: "
        "generated again, found by its hash and loaded. The call is `armgpi.simulate`, importing CasADi "
        "included; before it come Python's own start, importing armgpi and xarray, in which every result is, "
        "and loading the robot. Both are processor time, the compiler's included, so that other processes "
        "hardly matter; the whole process is by the clock on the wall."
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
    print()
    print(table(["", "before the call", "the call", "all, on the wall"], rows))
    print("\n## What was asked for\n")
    print(table(["", "at most", "found", "kept"], goals))
    page.write()


def _times(name: str, lock: tuple[str, ...], rounds: int) -> dict[str, np.ndarray]:
    """Return seconds before the call, of it and of all, (rounds, 3), cold, cached and by NumPy."""
    taken: dict[str, list[tuple[float, float, float]]] = {"cold": [], "cached": [], "NumPy": []}
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as cache:
            for key, rows in taken.items():
                rows.append(_once(name, lock, "numpy" if key == "NumPy" else "compiled", cache))
    return {key: np.array(rows) for key, rows in taken.items()}


def _once(name: str, lock: tuple[str, ...], backend: str, cache: str) -> tuple[float, float, float]:
    """Run the program in a process of its own."""
    begun = time.perf_counter()
    said = subprocess.run(
        [sys.executable, "-c", _PROGRAM, name, ",".join(lock), backend],
        env={**os.environ, "ARMGPI_CACHE": cache, "OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    before, call = map(float, said.stdout.split())
    return before, call, time.perf_counter() - begun


if __name__ == "__main__":
    main()
