"""What float32 in place of float64 would give in a batch: time, and how far results are apart, for all arms.

python benchmarks/float32.py [--quick]
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import sys
import time
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from typing import Any, NamedTuple

import _float
import _page
import numpy as np
from _timing import table

import armgpi
from armgpi import config as configuration
from armgpi.robot import robots

#: Rollouts of an arm, their samples, and every which of these is compared.
ROLLOUTS, SAMPLES, EVERY = 256, 2000, 10
#: How far starts are apart [rad].
APART = 1e-3
#: A start that is moved as float32 rounds it, relative.
ROUNDED = 2.0**-24
#: Numbers at once: 256 bits of float64.
LANES = 4
#: Arms that differ from others of the list by a gripper, limits of positions or a mirror.
ALIKE = ("_gripper", "_limited", "_right_arm")
QUICK = ("ur5", "panda", "so100")


class Run(NamedTuple):
    """A batch of rollouts.

    Attributes:
        result: what it recorded.
        best: least processor time of a rollout and sample [us].
    """

    result: Any
    best: float


class Apart(NamedTuple):
    """How far two batches are apart where both run.

    Attributes:
        q: largest distance of positions [rad or m].
        peak: largest change of a rollout's largest tracking error, relative.
        torque: largest difference of torques, as a share of the torque limit.
        ended: rollouts of which one diverged and the other did not.
    """

    q: float
    peak: float
    torque: float
    ended: int


def main() -> None:
    page = _page.begin(__file__, "Float32 in batches", "that of `armgpi run ARM`")
    names = QUICK if page.quick else [name for name in robots.names() if not name.endswith(ALIKE)]
    _page.say(
        f"{ROLLOUTS} rollouts of {SAMPLES} samples on one thread, starts {APART:g} rad apart, 256 bits at "
        f"once: {LANES} numbers of float64, {_float.LANES} of float32. Microseconds of processor time a "
        "rollout-step, the least of three runs in turns. Apart: largest difference of float32 from float64 "
        f"over all rollouts, joints and each {EVERY}th sample [rad or m]. Moved: the same of two runs in "
        "float64, one with starts moved as float32 rounds them. Error: largest change of a rollout's largest "
        "tracking error. Torque: largest difference as a share of the limit. Ended: rollouts that diverged "
        "in one of the two alone."
    )
    rows: list[list[object]] = []
    refused = []
    for name in names:
        try:
            row, figures = _row(name)
        except (armgpi.ArmgpiError, ValueError) as error:
            refused.append(f"{name}: {error}")
            continue
        print(*row, file=sys.stderr, flush=True)
        rows.append(row)
        page.figures[name] = figures
    print()
    heads = [
        "arm",
        "joints",
        "friction",
        "float64",
        "float32",
        "×",
        "apart",
        "moved",
        "error",
        "torque",
        "ended",
    ]
    print(table(heads, rows))
    for line in refused:
        _page.say(f"Not measured: {line}")
    page.write()


def _row(name: str) -> tuple[list[object], dict[str, Any]]:
    """Return the row of an arm, and its figures."""
    origin = configuration.Origin("benchmark")
    made = configuration.build(configuration.check({"robot": {"name": name}, "ideal": False}, origin), origin)
    (law,) = made.controllers.values()
    q0 = made.reference.at(0.0).q + APART * np.linspace(-1.0, 1.0, ROLLOUTS)[:, None]

    def loop(lanes: int) -> Callable[..., Any]:
        os.environ["ARMGPI_LANES"] = str(lanes)
        return armgpi.prepare(
            made.plant,
            law,
            made.reference,
            SAMPLES * law.dt,
            record=("q", "q_ref", "tau"),
            record_every=EVERY,
            dtype="float32",
            backend="compiled",
        ).run

    wide, narrow = _timed(loop, q0)
    os.environ["ARMGPI_LANES"] = str(LANES)
    moved = loop(LANES)(q0=q0 * (1.0 + ROUNDED))
    effort = np.broadcast_to(law.effort, made.plant.robot.n)
    by_float = _apart(wide.result, narrow.result, effort)
    by_start = _apart(wide.result, moved, effort)
    ratio = wide.best / narrow.best
    row: list[object] = [
        name,
        made.plant.robot.n,
        _rubs(made.plant),
        f"{wide.best:.3f}",
        f"{narrow.best:.3f}",
        f"{ratio:.2f}",
    ]
    row += [f"{by_float.q:.1e}", f"{by_start.q:.1e}", f"{by_float.peak:.1%}", f"{by_float.torque:.1%}"]
    row.append(by_float.ended)
    figures = {
        "float64": wide.best,
        "float32": narrow.best,
        **by_float._asdict(),
        "moved": by_start._asdict(),
    }
    return row, figures


def _rubs(plant: armgpi.Plant) -> str:
    """Return whether the joints have friction."""
    friction = armgpi.plants.plant.inside(plant).friction
    return "yes" if friction is not None and (friction.viscous.any() or friction.coulomb.any()) else ""


def _timed(loop: Callable[[int], Callable[..., Any]], q0: Any) -> tuple[Run, Run]:
    """Return the runs in float64 and in float32, timed in turns."""
    kinds = ((LANES, nullcontext), (_float.LANES, _float.in_floats))
    runs: list[Callable[[], Any]] = []
    found: list[Any] = []
    for lanes, context in kinds:
        with context():
            runs.append(partial(loop(lanes), q0=q0))
            found.append(runs[-1]())  # compiled before it is timed
    best = [np.inf, np.inf]
    for _ in range(3):
        for i, (lanes, context) in enumerate(kinds):
            os.environ["ARMGPI_LANES"] = str(lanes)
            with context():
                begun = time.process_time()
                runs[i]()
                best[i] = min(best[i], time.process_time() - begun)
    unit = 1e6 / (ROLLOUTS * SAMPLES)
    return Run(found[0], best[0] * unit), Run(found[1], best[1] * unit)


def _apart(first: Any, second: Any, effort: Any) -> Apart:
    """Return how far two batches are apart."""
    q, other = (np.asarray(x["q"], dtype=float) for x in (first, second))
    runs, others = (np.isfinite(x).all(axis=(1, 2)) for x in (q, other))
    both = runs & others
    if not both.any():
        raise ValueError("every rollout diverges")
    peaks = [_peak(x)[both] for x in (first, second)]
    torque = np.abs(np.asarray(first["tau"], dtype=float) - np.asarray(second["tau"], dtype=float))[both]
    return Apart(
        float(np.abs(q - other)[both].max()),
        float(np.abs(peaks[1] / peaks[0] - 1.0).max()),
        float((torque / effort).max()),
        int((runs != others).sum()),
    )


def _peak(result: Any) -> Any:
    """Return the largest tracking error of each rollout [rad or m]."""
    return np.abs(np.asarray(result["q"], dtype=float) - np.asarray(result["q_ref"])).max(axis=(1, 2))


if __name__ == "__main__":
    main()
