"""Which logs are taken for those of another robot: the right arm, with payloads, and others of its kind.

For each log: the distance of the links but the last from the file's (`Identified.link_distance`), which
`armgpi identify` compares with `ANOTHER_ROBOT`.

    python tools/another_robot.py --seed 50
    python tools/another_robot.py --seed 290 --arms baxter_left_arm tiago_arm talos_left_arm_7
    python tools/another_robot.py --public FOLDER  # with the clones that tools/public_logs.py and others name
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from pathlib import Path

import identification
import numpy as np
import public_logs
import swapped

import armgpi
from armgpi.errors import ArmgpiError
from armgpi.health.zoo import fingers
from armgpi.identification.arm import identify
from armgpi.identification.check import ANOTHER_ROBOT
from armgpi.identification.excitation import excite
from armgpi.identification.logs import Log

#: Arms with the same number of joints, each of which is named for the logs of the others.
KINDS = (("ur3", "ur5", "ur10", "z1", "kinova"), ("panda", "xarm7"))
#: Payloads up to the rated one [kg].
PAYLOADS = {"ur3": 3.0, "ur5": 5.0, "ur10": 10.0, "z1": 2.0, "kinova": 2.0, "panda": 3.0, "xarm7": 3.5}
#: That of an arm that is not listed [kg].
PAYLOAD = 1.0
#: Length of a log [s], and share of the limits that it takes.
SECONDS, SHARE = 12.0, 0.5


def load(name: str) -> armgpi.Robot:
    """Return an arm without its fingers."""
    return armgpi.Robot.load(name, lock=fingers(name))


def record(name: str, seed: int, payload: float) -> Log:
    """Return a log of a random arm of a name, with a payload at its tip."""
    robot, rng = load(name), np.random.default_rng(seed)
    arm = identification.truth(robot, seed)
    if payload:
        arm = arm.with_payload(robot.tip, payload, rng.uniform(-0.1, 0.1, 3), 0.0025 * payload * np.eye(3))
    reference = excite(robot, SECONDS, SHARE, seed, **identification.FREE).reference
    (log,) = identification.record(robot, [arm], reference, SECONDS)
    return log


def simulated(seed: int, kinds: tuple[tuple[str, ...], ...]) -> Iterator[tuple[str, armgpi.Robot, Log, bool]]:
    """Give logs of every arm with and without a payload, and as every other arm of its kind."""
    for kind in kinds:
        for number, name in enumerate(kind):
            rated = PAYLOADS.get(name, PAYLOAD)
            for payload in (0.0, 0.5 * rated, rated):
                log = record(name, seed + number, payload)
                yield f"{name}, {payload:g} kg", load(name), log, False
                if payload:
                    continue
                for other in kind:
                    if other != name:
                        yield f"{name} as {other}", load(other), log, True


def public(folder: Path) -> Iterator[tuple[str, armgpi.Robot, Log, bool]]:
    """Give the first 20 s of the public logs, and those of the UR10s as other arms of six joints."""
    logs = list(swapped.public(folder))
    bag = folder / "inverse-dynamics-solver"
    if bag.is_dir():
        real = public_logs.ur10(bag)
        logs.append(("UR10", real.robot, real.log))
    for label, robot, log in logs:
        part = log.t < log.t[0] + 20.0
        log = log._replace(t=log.t[part], q=log.q[part], tau=log.tau[part])
        yield label, robot, log, False
        kind = next((names for names in KINDS if load(names[0]).n == robot.n), ())
        for other in kind:
            if other.lower() != label.lower() and other != robot.name:
                yield f"{label} as {other}", load(other), log, True


def main() -> None:
    """Print a row for each log."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=50)
    parser.add_argument("--public", type=Path, help="folder with clones of the public logs")
    parser.add_argument("--arms", nargs="+", help="arms that are taken for each other, in place of KINDS")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    if given.public and not given.public.is_dir():
        parser.error(
            f"{given.public}: is no folder; the first lines of tools/public_logs.py say what to clone"
        )
    # Whether it is another arm -> logs that are said to be of one, or refused, and all logs.
    counts = {True: [0, 0], False: [0, 0]}
    kinds = (tuple(given.arms),) if given.arms else KINDS
    cases = public(given.public) if given.public else simulated(given.seed, kinds)
    for label, robot, log, another in cases:
        refused = ""
        try:
            found = identify(log, robot)
        except ArmgpiError as error:
            refused = f"refused: {error!s:.120}"
            try:
                found = identify(log, robot, check_first=False)
            except ArmgpiError as second:
                print(f"| {label} | | refused: {second} |", flush=True)
                counts[another][0] += 1
                counts[another][1] += 1
                continue
        said = found.link_distance > ANOTHER_ROBOT
        counts[another][0] += said or bool(refused)
        counts[another][1] += 1
        print(
            f"| {label} | {found.link_distance:.2g} | {'another robot' if said else ''} {refused} |",
            flush=True,
        )
    for another, (count, of) in counts.items():
        print(f"{'other' if another else 'right'} arms: {count} of {of} said to be another robot, or refused")


if __name__ == "__main__":
    main()
