"""Time of a step of the exported controller, against what it is made of, and against Python.

python benchmarks/export.py [--quick]
"""

from __future__ import annotations

import ctypes
import re
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import _arms
import _page
import _timing
import numpy as np
from _arms import DT, Arm, require
from _generated import Kernels, aligned
from _peer import Array
from _timing import Contender, ratio, spread, table, take_turns

import armgpi
from armgpi.codegen import build
from armgpi.control.controller import Measurement
from armgpi.references.reference import Target

#: Torque against Python's, relative to the largest: double, float.
CLOSE = {"double": 1e-9, "float": 1e-2}
#: Samples over which they are compared.
CHECKED = 2000
GOAL = 1.0  # [us] per step of Panda, double
#: As the Makefile of an export compiles.
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared")
#: Replays a log: rows of positions and targets in, rows of torques out.
_REPLAY = """
void bench_replay(const armgpi_real_t *q, const armgpi_real_t *q_ref, armgpi_real_t *tau, long samples)
{
    static armgpi_state_t state;
    (void)armgpi_init(&state, q, q_ref);
    for (long k = 0; k < samples; ++k)
        (void)armgpi_step(&state, q + k * ARMGPI_N, q_ref + k * ARMGPI_N, tau + k * ARMGPI_N);
}
"""


def main() -> None:
    page = _page.begin(__file__, "Export")
    if not hasattr(armgpi, "export_controller"):
        print("\nThis armgpi exports no controllers: nothing to measure.")
        return
    rounds, samples = (3, 2000) if page.quick else (15, 40_000)
    _page.say(
        f"Nanoseconds per step, {rounds} rounds; × is how many times longer than the exported step in "
        f"double. A log of {samples} samples at {1.0 / DT:g} Hz is replayed in a loop in C; torques agree "
        "with the log's to 1e-9 of the largest (double), or 1e-2 (float). State: bytes of the struct."
    )
    goals: list[list[object]] = []
    for networks in (True, False):
        print(f"\n## GPI with {'networks' if networks else 'fixed gains'}")
        for name in _arms.ROBOTS:
            arm = Arm(name, networks)
            taken, sizes = _robot(page, arm, networks, rounds, samples)
            rows = [
                [label, spread(1e3 * one.times), ratio(one, taken["double"]), sizes.get(label, "")]
                for label, one in taken.items()
            ]
            print(f"\n### {arm.title}\n")
            print(table(["", "time", "×", "state"], rows))
            if name == "panda":
                time = spread(taken["double"].times)
                kept = "yes" if time.median <= GOAL else "no"
                word = "networks" if networks else "fixed gains"
                goals.append([f"{name}, {word}: a step in double", f"{GOAL:g} µs", f"{time} µs", kept])
    print("\n## Goals\n")
    print(table(["", "at most", "found", "met"], goals))
    _page.say(
        "Floor: D(q) v alone, generated, one state at a time. NumPy: `controller.step` called from "
        "Python. Exported, from Python: an `ExportedController`, so ctypes and copies included."
    )
    page.write()


def _robot(
    page: _page.Page, arm: Arm, networks: bool, rounds: int, samples: int
) -> tuple[dict[str, _timing.Samples], dict[str, int]]:
    """Time all who take a step; return their times, and the bytes of the states."""
    log = arm.simulate("compiled", samples)
    q, tau = (log[name].values[:samples] for name in ("q_measured", "tau_command"))
    q_ref = log["q_ref"].values[:samples]
    kernels = Kernels(arm.robot, 1, ["inertia_times"])
    at, to = kernels.packed(np.hstack([q, q])), aligned(q.size)
    contenders = {
        "floor: D(q) v alone": Contender(partial(kernels.call, "inertia_times", at, to, 1), samples)
    }
    sizes = {}
    for real in ("double", "float"):
        library, sizes[real] = _compiled(arm, real)
        contenders[real] = _replay(library, real, q, q_ref, tau)
    few = min(samples, 1000)
    exported = armgpi.ExportedController.of(arm.controller)
    for label, controller in (("exported, from Python", exported), ("NumPy", arm.controller)):
        contenders[label] = Contender(partial(_python, controller, q[:few], q_ref[:few]), few)
    taken = take_turns(contenders, rounds)
    page.figures[f"{arm.name}, {'networks' if networks else 'fixed'}"] = {
        "times": _timing.plain(taken),
        "state": sizes,
    }
    return taken, sizes


def _compiled(arm: Arm, real: str) -> tuple[ctypes.CDLL, int]:
    """Export a controller, compile it with a loop over a log; return the library and the state's bytes."""
    with tempfile.TemporaryDirectory() as folder:
        armgpi.export_controller(arm.controller, folder, real=real, measure=False)
        header, source = ((Path(folder) / f"armgpi_controller.{end}").read_text() for end in "hc")
    size = "\nconst unsigned long bench_state_bytes = sizeof(armgpi_state_t);\n"
    whole = re.sub(r'#include "armgpi_controller.h"', lambda _: header, source) + size + _REPLAY
    library = build.library(whole, FLAGS)
    return library, int(ctypes.c_ulong.in_dll(library, "bench_state_bytes").value)


def _replay(library: ctypes.CDLL, real: str, q: Array, q_ref: Array, tau: Array) -> Contender:
    """Return a replay of a log in C."""
    kind: Any = np.float64 if real == "double" else np.float32
    arrays = [np.ascontiguousarray(x, dtype=kind) for x in (q, q_ref)]
    found = np.empty(q.shape, dtype=kind)

    def run() -> None:
        pointers = [ctypes.c_void_p(x.ctypes.data) for x in (*arrays, found)]
        library.bench_replay(*pointers, ctypes.c_long(len(q)))

    def check(_: None) -> None:
        # In float what a replay adds up drifts from the log: the law has no feedback there.
        wrong = float(np.abs(found - tau)[:CHECKED].max() / np.abs(tau).max())
        require(f"exported, {real}: torque", wrong, CLOSE[real])

    return Contender(run, len(q), check)


def _python(controller: Any, q: Array, q_ref: Array) -> None:
    """Replay a log in Python."""
    rest = np.zeros(q.shape[1])
    state = controller.init(Measurement(q[0]), Target(q_ref[0], rest, rest))
    for measured, target in zip(q, q_ref, strict=True):
        _, state = controller.step(Measurement(measured), Target(target, rest, rest), state)


if __name__ == "__main__":
    main()
