"""What recording costs, beside the same prepared batch that keeps its first and last sample alone.

python benchmarks/recording.py [--quick]
"""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import _page
from _arms import DT, Arm
from _timing import Contender, plain, ratio, spread, table, take_turns

import armgpi
from armgpi.loop.rollout import SAMPLED

#: What keeping all may cost beside keeping nothing, how far its rounds may be apart, and two threads' gain.
GOAL, APART, GAIN = 1.5, 1.3, 1.7
NOTHING = "first and last sample"


def main() -> None:
    page = _page.begin(__file__, "Recording")
    rounds, units = (3, 400_000) if page.quick else (9, 1_600_000)
    arm = Arm("panda")
    _page.say(
        f"Microseconds per rollout-step of {arm.title}, fixed gains, prepared, {rounds} rounds in turns; × "
        f"is over what keeps the {NOTHING}. All is {8 * arm.n * len(SAMPLED)} bytes a rollout-step. Fresh "
        "memory: a loop for each run."
    )
    rows: list[list[object]] = []
    for threads in (1, 2):
        for batch in (256, 4096):
            samples = take_turns(_contenders(arm, batch, units // batch, threads), rounds)
            page.figures[f"{batch}, {threads}"] = plain(samples)
            for label, taken in samples.items():
                rows.append([threads, batch, label, spread(taken.times), ratio(taken, samples[NOTHING])])
    print()
    print(table(["threads", "rollouts", "kept", "microseconds", "×"], rows))
    print(
        f"\nGoals: all at most {GOAL:g} times, rounds within {APART:g}, two threads {GAIN:g} times as fast."
    )
    page.write()


def _contenders(arm: Arm, batch: int, steps: int, threads: int) -> dict[str, Contender]:
    """Return runs that keep more or less."""
    parts = arm.plant, arm.controller, arm.reference
    q0 = arm.starts(batch)

    def prepare(**kept: Any) -> armgpi.PreparedLoop:
        return armgpi.prepare(*parts, steps * DT, backend="compiled", **kept)

    def run(loop: armgpi.PreparedLoop | None, file: Path | None = None) -> None:
        arm.use(threads)
        (loop or prepare()).run(q0=q0, file=file).close()

    runs = {
        NOTHING: partial(run, prepare(record_every=steps)),
        "all": partial(run, prepare()),
        "all, float32": partial(run, prepare(dtype="float32")),
        "q and tau": partial(run, prepare(record=("q", "tau"))),
        "every 10th": partial(run, prepare(record_every=10)),
        "all, fresh memory": partial(run, None),
        "all, to a file": partial(run, prepare(), Path(tempfile.mkdtemp()) / "run.nc"),
    }
    return {label: Contender(each, batch * steps, threads=threads) for label, each in runs.items()}


if __name__ == "__main__":
    main()
