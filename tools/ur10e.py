"""Identify a real UR10e from public logs, and print how much of its torques is left unexplained.

The logs are those of github.com/shamilmamedov/dynamic_calibration, which has no licence, so nothing of it is
here: clone it yourself, and name the folder.

    git clone https://github.com/shamilmamedov/dynamic_calibration
    python tools/ur10e.py dynamic_calibration

Currents become torques by the drive gains that are named there (De Luca). Rows without motion are cut.

``--load`` identifies the known load of two pairs of logs, without and with it, by the constants as they are
and by those that the known load of the other pair gives.

``--control MOVES`` runs random moves under `gpi_auto` laws on the arm that the whole log gives: laws for the
file without rotors, for the rotors of the rule, for the first 20 s, and for that arm itself.

``--drawn MOVES`` runs the controller made from the identified folder on arms whose rotors are drawn within
their interval; see tools/identified_control.py.
"""

from __future__ import annotations

import argparse
import math
import warnings
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import identified_control
import numpy as np

import armgpi
from armgpi.health.reality import has_failed, torques_of
from armgpi.identification.arm import Identified, Load, identify
from armgpi.identification.logs import Log

#: Torque at the joint for a current [N m/A].
GAINS = (14.87, 13.26, 11.13, 10.62, 11.03, 11.47)
#: Columns of a file: time [s], positions [rad], velocities, currents [A], and what is commanded.
POSITIONS, CURRENTS = slice(1, 7), slice(13, 19)
#: The log that is identified from, those that judge, and slow moves from point to point.
TRAIN, HELD_OUT, SLOW = (
    "ur-20_02_12-50sec_12harm",
    ("ur-20_02_12-40sec_12harm", "ur-20_02_10-30sec_12harm", "ur-20_02_05-20sec_8harm"),
    "ur-20_01_17-ptp_10_points",
)
#: Pairs of logs without and with a load of this mass [kg], as the scripts there say.
PAIRS, LOAD = (
    (
        ("ur-20_02_19_14harm50sec", "ur-20_02_19_14harm50secLoad"),
        ("ur-20_02_19_15harm50sec", "ur-20_02_19_15harm50secLoad"),
    ),
    2.805,
)
#: Sample time of the law [s], log that it is made from [s], and the seed of its moves.
DT, PART, SEED = 2e-3, 20.0, 1
#: Largest step of the times in a file [s].
_JUMP = 1.0
#: Slower than this the arm rests [rad/s].
_STILL = 0.01


def read(path: Path) -> Log:
    """Return a log from where the arm begins to move until it rests; currents in place of torques."""
    lines = path.read_text(encoding="ascii").splitlines()
    whole = [line for line in lines if line.count(",") == lines[0].count(",")]  # one ends in the middle
    table = np.loadtxt(whole, delimiter=",")
    jumps = np.flatnonzero(np.abs(np.diff(table[:, 0])) > _JUMP) + 1  # the file is damaged there
    table = max(np.split(table, jumps), key=len)
    keep = np.append(True, np.diff(table[:, 0]) > 0.0)
    t, q = table[keep, 0], table[keep, POSITIONS]
    moves = np.flatnonzero(np.abs(np.gradient(q, t, axis=0)).max(axis=1) > _STILL)
    part = slice(int(moves[0]), int(moves[-1]) + 1)
    return Log(t[part] - t[part][0], q[part], table[keep, CURRENTS][part], path.stem)


def find(folder: Path, name: str) -> Path:
    """Return a file by its name, wherever it is in a folder."""
    for path in sorted(folder.rglob(name)):
        return path
    raise SystemExit(f"{folder}: has no {name}; clone github.com/shamilmamedov/dynamic_calibration")


def cut(log: Log, seconds: float) -> Log:
    """Return the beginning of a log."""
    count = int(np.searchsorted(log.t, seconds))
    return Log(*(part[:count] for part in log[:3]), log.source)


def control(file: armgpi.Robot, part: armgpi.Robot, truth: armgpi.Robot, moves: int, drives: str) -> None:
    """Print what laws for several models make of moves that the motors can follow, from rest to rest."""
    rng, speed = np.random.default_rng(SEED), file.limits.velocity
    ends = rng.uniform(-2.0, 2.0, (8 * moves, 2, file.n)) + file.middle()
    paths = [armgpi.Bezier(*each, velocity_limit=0.6 * speed, acceleration_limit=4.0) for each in ends]
    paths = [path for path in paths if _torque_share(truth, path) < 1.0][:moves]
    seconds = max(path.duration for path in paths) + 1.5
    plant = armgpi.RigidBodyPlant(armgpi.RobotBatch([truth] * len(paths)), friction="urdf")
    real = armgpi.Delayed(armgpi.Encoder(armgpi.Saturated(plant, file.limits.effort), 16), 1)
    itae, lost = {}, {}
    laws = {"file": (file, "none"), "rule": (file, drives), "20 s": (part, drives), "50 s": (truth, drives)}
    for label, (model, believed) in laws.items():
        law = armgpi.GPI.auto(model, DT, delay=DT, bits=16, drives=believed)
        run = armgpi.simulate(real, law, armgpi.ReferenceBatch(paths), seconds, progress=False)
        error = np.abs(run["q"].values - run["q_ref"].values)
        error[~np.isfinite(error)] = np.inf
        lost[label] = sum(has_failed(each, run["time"].values) for each in error)
        itae[label] = (error * run["time"].values[:, None]).sum(axis=(1, 2))
    print(f"{len(paths)} moves: lost, ITAE over that of the law for the whole log's arm (median)")
    for label, each in itae.items():
        print(f"{label}: {lost[label]} lost, {np.median(each / itae['50 s']):.3g}")


def loads(folder: Path, robot: armgpi.Robot) -> None:
    """Print the load of each pair of logs, by the torque constants as they are and by the other pair's."""
    pairs = [[read(find(folder, f"{name}.csv")) for name in pair] for pair in PAIRS]
    arms = [identify(bare, robot, current=GAINS, torque="motor") for bare, _ in pairs]
    found = [arm.load(carried) for arm, (_, carried) in zip(arms, pairs, strict=True)]
    for (bare, carried), own, other in zip(pairs, found, reversed(found), strict=True):
        wide = 1.96 * own.mass_std
        print(
            f"{bare.source}: load {own.mass:.3f} ± {wide:.2f} kg ({100.0 * wide / own.mass:.1f} %) by the "
            f"constants as they are; {LOAD} kg are there"
        )
        constants = tuple(LOAD / other.mass * np.array(GAINS))
        known = identify(bare, robot, current=constants, torque="motor").load(carried, scale_known=True)
        print(
            f"  {known.mass:.3f} ± {1.96 * known.mass_std:.3f} kg by those of the other pair, "
            f"{100.0 * (known.mass / LOAD - 1.0):+.2f} %"
        )
    # The load is the same in both, so that the ratio is 1 but for the scatter of the two estimates.
    scatter = [known_scale(load) / load.mass for load in found]
    ratio, wide = found[0].mass / found[1].mass, 196.0 * np.hypot(*scatter)
    print(
        f"the two loads are as {ratio:.4f} to 1, ± {wide:.1f} % by their intervals without that of the "
        "constants: no closer can one pair tell the constants of another"
    )


def known_scale(load: Load) -> float:
    """Return the standard deviation of a mass without that of the common factor of the constants [kg]."""
    return math.sqrt(load.mass_std**2 - (load.scale / 1.96 * load.mass) ** 2)


def _torque_share(arm: armgpi.Robot, path: armgpi.Bezier) -> float:
    """Return the largest share of a motor's torque that a move takes."""
    tau = torques_of(arm, path.at(np.linspace(0.0, path.duration, 100)), arm.friction)
    return float(np.max(np.abs(tau) / arm.limits.effort))


def row(label: str, shares: Sequence[float]) -> str:
    """Return residuals over torques as a row of a table [%]."""
    cells = (f"{100.0 * x:.2g}" for x in (*shares, float(np.nanmean(shares))))
    return f"| {label} | {' | '.join(cells)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="the clone")
    parser.add_argument("--seconds", type=float, nargs="+", default=[20.0, 30.0, 50.0])
    parser.add_argument("--control", type=int, default=0, metavar="MOVES", help="random moves that are run")
    parser.add_argument("--drawn", type=int, default=0, metavar="MOVES", help="moves of arms that are drawn")
    parser.add_argument("--elastic", action="store_true", help="and these have elastic joints")
    parser.add_argument("--drives", default="stiff", help="what laws believe: stiff gears, or 'elastic'")
    parser.add_argument(
        "--load", action="store_true", help="identify the known load of two pairs of logs alone"
    )
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    robot = armgpi.Robot.load(find(given.folder, "ur10e.urdf"))
    if given.load:
        loads(given.folder, robot)
        return
    train = read(find(given.folder, f"{TRAIN}.csv"))
    judges = {name: read(find(given.folder, f"{name}.csv")) for name in (*HELD_OUT, SLOW)}

    @cache
    def fit(seconds: float) -> Identified:
        return identify(cut(train, seconds), robot, current=GAINS, torque="motor")

    print(f"| residual over torque [%] | {' | '.join(robot.joint_names)} | mean |")
    print("|---|" + "---|" * (robot.n + 1))
    for seconds in given.seconds:
        found = fit(seconds)
        checked = {name: found.validate(log) for name, log in judges.items()}
        seen = [checked[name] for name in HELD_OUT]
        if seconds == given.seconds[0]:
            print(row("file, held-out logs", np.mean([x.file for x in seen], axis=0)))
        print(row(f"{seconds:g} s, held-out logs", np.mean([x.identified for x in seen], axis=0)))
        last = found
    print(row("the same, slow point to point", checked[SLOW].identified))
    for bare, _ in PAIRS:  # of another day
        print(row(f"the same, {bare}", last.validate(read(find(given.folder, f"{bare}.csv"))).identified))
    print(f"lag of each joint [ms]: {np.round(1e3 * last.lag, 1).tolist()}")
    print(f"width of the sign of friction [rad/s]: {last.width.tolist()}")
    if given.control:
        control(robot, fit(PART).robot, last.robot, given.control, given.drives)
    if given.drawn:
        identified_control.control(last, given.drawn, dt=DT, elastic=given.elastic)


if __name__ == "__main__":
    main()
