"""How the cost of a run grows: with joints, rollouts, samples, references, recording, lanes and threads.

python benchmarks/growth.py [--quick]
"""

from __future__ import annotations

import os
from functools import cache
from typing import Any

import _page
import numpy as np
from _timing import Contender, plain, spread, table, take_turns

import armgpi
from armgpi.loop.rollout import SAMPLED
from armgpi.robot.dynamics import cores

DT = 1e-3
#: What each row departs from.
BASE = {
    "joints": 7, "rollouts": 1024, "samples": 200, "references": 1, "recorded": 0, "lanes": 4, "threads": 1,
    "elastic": 0,
}  # fmt: skip
AXES: dict[str, tuple[int, ...]] = {
    "joints": (2, 7, 20, 40),
    "rollouts": (1, 64, 4096, 65_536, 1_000_000),
    "samples": (50, 500, 5000),
    "references": (1, 1024),
    "recorded": (0, 1, 2, len(SAMPLED)),
    "lanes": (4, 8),
    "threads": (1, 2),
    "elastic": (0, 1),
}
#: Samples where there are many rollouts.
FEW = 20
#: What takes too long to look at quickly.
QUICK = {"joints": (2, 7), "rollouts": (1, 64, 1024), "samples": (50, 500)}


def main() -> None:
    page = _page.begin(
        __file__, "How cost grows", "assumed rotors; stiff joints, elastic where a row says so"
    )
    rounds = 2 if page.quick else 5
    _page.say(
        f"Microseconds per rollout-step of compiled loops, {rounds} rounds in turns. All else is "
        f"{', '.join(f'{value} {name}' for name, value in BASE.items())}; rollouts have {FEW} samples. "
        "Slope: of a run's time over the quantity, both logarithmic. Bytes: of the result, per rollout."
    )
    rows: list[list[object]] = []
    for axis, values in ({**AXES, **QUICK} if page.quick else AXES).items():
        rows += _grow(
            page, axis, [value for value in values if axis != "threads" or value <= cores()], rounds
        )
    print()
    print(table(["quantity", "value", "microseconds", "bytes", "slope"], rows))
    page.write()


def _grow(page: Any, axis: str, values: list[int], rounds: int) -> list[list[object]]:
    """Return rows of a quantity."""
    contenders, sizes = {}, {}
    for value in values:
        few = {"samples": FEW} if axis == "rollouts" else {}
        contenders[str(value)], sizes[str(value)] = _contender(**{**BASE, **few, axis: value})
    samples = take_turns(contenders, rounds)
    page.figures[axis] = {**plain(samples), "bytes": sizes}
    rows: list[list[object]] = []
    before = None
    for label, taken in samples.items():
        whole = float(np.median(taken.times)) * contenders[label].units
        slope = ""
        if before is not None and before[0] > 0:
            slope = f"{np.log(whole / before[1]) / np.log(int(label) / before[0]):.2f}"
        rows.append([axis, label, spread(taken.times), f"{sizes[label]:.0f}", slope])
        before = (int(label), whole)
    return rows


def _contender(
    joints: int,
    rollouts: int,
    samples: int,
    references: int,
    recorded: int,
    lanes: int,
    threads: int,
    elastic: int,
) -> tuple[Contender, float]:
    """Return a prepared run, and the bytes per rollout of its result."""
    robot = _chain(joints)
    rest, law = np.full(joints, 0.1), armgpi.GPI(robot, DT)
    goals = rest + 0.002 * np.random.default_rng(0).standard_normal((rollouts, joints))
    duration = 0.9 * samples * DT
    reference: Any = armgpi.Bezier(np.broadcast_to(rest, goals.shape), goals, duration)
    if references > 1:
        reference = armgpi.ReferenceBatch([armgpi.Bezier(rest, goal, duration) for goal in goals])
    plant: Any = armgpi.ElasticPlant(robot) if elastic else armgpi.RigidBodyPlant(robot)
    record: Any = SAMPLED[:recorded] if recorded else "metrics"
    os.environ["ARMGPI_LANES"] = str(lanes)
    loop = armgpi.prepare(plant, law, reference, samples * DT, record=record, backend="compiled")

    def run() -> Any:
        os.environ["ARMGPI_LANES"], os.environ["OMP_NUM_THREADS"] = str(lanes), str(threads)
        return loop.run()

    return Contender(run, rollouts * samples, _check, threads), run().nbytes / rollouts


def _check(result: Any) -> None:
    """Refuse a run that diverged."""
    values = result["peak_error"] if "peak_error" in result else result["q"]
    assert float(np.abs(values).max()) < 1.0


@cache
def _chain(joints: int) -> armgpi.Robot:
    """Return an arm whose joints turn about y and z in turns, with rotors and gears."""
    links = "".join(
        f'<link name="l{i}"><inertial><origin xyz="0 0 0.05"/><mass value="0.5"/><inertia ixx="0.002" '
        'iyy="0.002" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for i in range(joints + 1)
    )
    turns = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/><origin '
        f'xyz="0 0 0.1"/><axis xyz="{("0 1 0", "0 0 1")[i % 2]}"/><limit lower="-3" upper="3" '
        'effort="1000" velocity="10"/></joint>'
        for i in range(joints)
    )
    robot = armgpi.Robot.from_xml(f'<robot name="chain{joints}">{links}{turns}</robot>')
    return armgpi.assume_drives(robot)


if __name__ == "__main__":
    main()
