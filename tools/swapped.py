"""How surely swapped columns of two joints are found, on logs of simulated and real arms.

For each pair of joints of a log: the logarithm of the power that both torques leave unexplained in their
order, over that with the pair exchanged. The largest one over all pairs is printed, which `armgpi identify`
compares with `OTHER_ORDER`, and how many swapped pairs are found. With a pair swapped the logarithm has the
other sign. No log was chosen by it. Then the same for positions, of which the whole motion is another one:
the logarithms of all joints are summed, for the first ten seconds.

    python tools/swapped.py --arms ur5 z1 panda so100 xarm7 ur3 kinova --seed 41
    python tools/swapped.py --public FOLDER  # with the clones that tools/public_logs.py and others name
"""

from __future__ import annotations

import argparse
import itertools
import warnings
from collections.abc import Iterator
from pathlib import Path

import identification
import numpy as np
import panda_log
import public_logs
import ur10e

import armgpi
from armgpi.health.zoo import fingers
from armgpi.identification.check import (
    OTHER_ORDER,
    explained_in_order,
    find_order,
    match_motions,
    terms_of,
    unexplained,
)
from armgpi.identification.estimate import expect
from armgpi.identification.excitation import FIRST_SHARE, excite
from armgpi.identification.logs import Log, resample
from armgpi.identification.weak_form import WeakForm


def simulated(name: str, seed: int) -> Iterator[tuple[str, armgpi.Robot, Log]]:
    """Give a slow and a fast log of a random arm."""
    robot = armgpi.Robot.load(name, lock=fingers(name))
    for share in (FIRST_SHARE, 0.7):
        reference = excite(robot, 12.0, share, seed, **identification.FREE).reference
        (log,) = identification.record(robot, [identification.truth(robot, seed)], reference, 12.0)
        yield f"{name}, {share:.0%}", robot, log


def public(folder: Path) -> Iterator[tuple[str, armgpi.Robot, Log]]:
    """Give the public logs whose clones are in a folder."""
    ur = folder / "dynamic_calibration"
    if ur.is_dir():
        log = ur10e.read(ur10e.find(ur, f"{ur10e.TRAIN}.csv"))
        robot = armgpi.Robot.load(ur10e.find(ur, "ur10e.urdf"))
        yield "UR10e", robot, log._replace(tau=log.tau * ur10e.GAINS)
    panda = folder / "FrankaEmikaPandaDynModel"
    if panda.is_dir():
        yield "Panda", armgpi.Robot.load("panda", lock=panda_log.FINGERS), panda_log.read(panda)
    others = {
        "figaroh-examples": public_logs.tx40,
        "Dynamic_Parameter_Identification_for_Rokae_xMate": public_logs.xmate,
    }
    for name, read in others.items():
        if (folder / name).is_dir():
            given = read(folder / name)
            yield given.robot.name, given.robot, given.log


def judge(robot: armgpi.Robot, log: Log) -> tuple[float, int, int]:
    """Return the largest logarithm over pairs of joints, and how many swaps are found, of how many."""
    form, n = WeakForm(robot.pinocchio_model(), resample(log)), robot.n
    match = match_motions(terms_of(expect(robot), form, n), form.torque(np.zeros(n))[0])
    left, largest, found = unexplained(match), -np.inf, 0
    pairs = list(itertools.combinations(range(n), 2))
    for i, j in pairs:
        own, other = left[i, i] + left[j, j], left[i, j] + left[j, i]
        largest = max(largest, float(own - other))
        order = np.arange(n)
        order[[i, j]] = j, i
        found += bool((find_order(match[order]) == order).all())
    if (find_order(match) != np.arange(n)).any():
        raise SystemExit("the order of a log as it is was not taken for right")
    return largest, found, len(pairs)


def judge_positions(robot: armgpi.Robot, log: Log) -> tuple[float, int]:
    """Return the largest logarithm over pairs whose positions are exchanged, and how many are found."""
    form, prior = WeakForm(robot.pinocchio_model(), resample(log)), expect(robot)
    unchanged = list(range(robot.n))
    right = explained_in_order(prior, form, unchanged)
    gains = []
    for i, j in itertools.combinations(unchanged, 2):
        order = unchanged.copy()
        order[i], order[j] = j, i
        exchanged = explained_in_order(prior, form, order)
        gains.append(float(unexplained(right).sum() - unexplained(exchanged).sum()))
    seen = sum(gain < -OTHER_ORDER for gain in gains) if (right >= 0.5).all() else 0
    return max(gains), seen


def main() -> None:
    """Print a row for each log."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", nargs="*", default=[], help="names of arms that are simulated")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--public", type=Path, help="folder with clones of the public logs")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    logs = itertools.chain.from_iterable(simulated(name, given.seed + k) for k, name in enumerate(given.arms))
    if given.public is not None:
        logs = itertools.chain(logs, public(given.public))
    for label, robot, log in logs:
        largest, found, count = judge(robot, log)
        of_positions, seen = judge_positions(robot, log)
        print(
            f"| {label} | {largest:.2g} | {found} of {count} | {of_positions:.2g} | {seen} of {count} |",
            flush=True,
        )
    print(f"another order is taken from {OTHER_ORDER:g} on")


if __name__ == "__main__":
    main()
