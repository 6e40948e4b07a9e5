"""Print how well one second of chirp for each joint tells the side of the encoders and the rotors.

Each arm is drawn: bodies, rotors and friction as in tools/identification.py, a lowest mode of 8 to 40 Hz, and
encoders of 14 to 19 bits at the link or, behind a gear ratio of 30 to 160, at the motor; 1 or 2 ms, 0 to 2
samples late. The controller is the automatic one for the bare file; a joint that is off by 0.1 rad
ends the log, as in the experiment of ``armgpi excite --side``. Things were chosen on seeds 100 and 200.

Usage:
    python tools/side.py --arms ur5 panda --count 8 --seed 7000
"""

from __future__ import annotations

import argparse
import warnings
from typing import Any, NamedTuple

import numpy as np
from identification import TorqueNoise, fingers, truth

import armgpi
from armgpi.base.arrays import Array
from armgpi.errors import UnfitLog
from armgpi.identification.chirp import Side, chirp, find_side
from armgpi.identification.logs import Log
from armgpi.plants.reality import scales
from armgpi.robot.rotors import lowest_mode

#: Sides in turn, error at which a log ends [rad], lowest modes [Hz], bits, gear ratios, sample times [s].
SIDES = ("link", "motor")
MOST_ERROR = 0.1
MODES, BITS, RATIOS, SAMPLE_TIMES = (8.0, 40.0), (14, 20), (30.0, 160.0), (1e-3, 1e-3, 2e-3)


class Outcome(NamedTuple):
    """What was found of one arm.

    Attributes:
        arm: its name.
        side: the true one.
        mode: lowest mode [Hz].
        bits: of the encoders.
        dt: sample time [s].
        samples: of delay.
        found: what the log says; None where it shows no chirp.
        rotor: true inertia of the rotors, (n,).
        moved: largest displacement of a joint [rad].
    """

    arm: str
    side: str
    mode: float
    bits: int
    dt: float
    samples: int
    found: Side | None
    rotor: Array
    moved: float


def measure(name: str, index: int, seed: int) -> Outcome:
    """Return what the chirps of a drawn arm say."""
    robot = armgpi.Robot.load(name, lock=fingers(name))
    drawn, side = truth(robot, seed + index), SIDES[index % 2]
    rng = np.random.default_rng([seed + index, *name.encode()])
    mode = float(MODES[0] * (MODES[1] / MODES[0]) ** rng.uniform())
    links = drawn.mass_matrix(drawn.middle()) - np.diag(drawn.armature)
    stiffness = drawn.armature * np.exp(rng.uniform(-0.5, 0.5, drawn.n))
    stiffness *= (mode / lowest_mode(links, drawn.armature, stiffness)) ** 2
    bits, ratio = int(rng.integers(*BITS)), float(rng.uniform(*RATIOS))
    dt, samples = float(rng.choice(SAMPLE_TIMES)), int(rng.integers(0, 3))
    arm = drawn.with_drives({j: {"encoder_side": side, "gear_ratio": ratio} for j in drawn.joint_names})
    plant: Any = armgpi.ElasticPlant(arm, gear_stiffness=stiffness, friction=arm.friction, encoder_side=side)
    plant = TorqueNoise(plant, std=0.005 * scales(robot).effort, seed=seed + index)
    plant = armgpi.Delayed(armgpi.Encoder(armgpi.Saturated(plant, robot.limits.effort), bits), samples)
    known = armgpi.assume_drives(robot)
    reference = chirp(known).reference
    controller = armgpi.GPI.auto(known, dt, delay=samples * dt, bits=16)
    run = armgpi.simulate(plant, controller, reference, reference.t_end, progress=False, backend="compiled")
    q, tau = run["q_measured"].values, run["tau_command"].values
    there = (np.abs(q - run["q_ref"].values) < MOST_ERROR).all(axis=1)
    end = len(q) if there.all() else max(int(np.argmin(there)), 20)
    limit = robot.limits.effort
    log = Log(run["time"].values[:end], q[:end], np.clip(tau[:end], -limit, limit), "truth", "motor")
    found: Side | None
    try:
        found = find_side(known, log)
    except UnfitLog:
        found = None
    moved = float(np.abs(q[:end] - q[0]).max())
    return Outcome(name, side, mode, bits, dt, samples, found, drawn.armature, moved)


def describe(each: Outcome) -> str:
    """Return a row of one arm."""
    said = "no chirp" if each.found is None else each.found.side or "not known"
    off = ""
    if each.found is not None and each.found.identified.any():
        own = each.found.identified
        errors = np.abs(np.log(each.found.rotor / each.rotor))[own]
        inside = ((each.found.low <= each.rotor) & (each.rotor <= each.found.high))[own]
        off = f"{100.0 * np.expm1(np.median(errors)):.0f}, {int(inside.sum())} of {int(own.sum())}"
    return (
        f"| {each.arm} | {each.side} | {each.mode:.3g} | {each.bits} | {1e3 * each.dt:g}, {each.samples} | "
        f"{said} | {off} | {1e3 * each.moved:.0f} |"
    )


def main() -> None:
    """Print a row for each arm, and the sums."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", nargs="+", default=["ur5", "panda"])
    parser.add_argument("--count", type=int, default=8, help="arms of each kind")
    parser.add_argument("--seed", type=int, default=7000)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    print("| arm | side | mode [Hz] | bits | ms, samples | said | rotors off [%], inside | moved [mrad] |")
    print("|---|---|---|---|---|---|---|---|")
    every = []
    for name in given.arms:
        for index in range(given.count):
            every.append(measure(name, index, given.seed))
            print(describe(every[-1]), flush=True)
    for side in SIDES:
        said = [each.found.side if each.found else "" for each in every if each.side == side]
        print(
            f"{len(said)} at the {side}: said motor {said.count('motor')}, link {said.count('link')}, "
            f"not known {said.count('')}"
        )
    ratios, inside = [], []
    for each in every:
        if each.found is not None and each.found.side == each.side:
            own = each.found.identified
            ratios.append(np.abs(np.log(each.found.rotor / each.rotor))[own])
            inside.append(((each.found.low <= each.rotor) & (each.rotor <= each.found.high))[own])
    off = np.expm1(np.concatenate(ratios))
    print(
        f"{len(off)} rotors: off by {100 * np.median(off):.0f} % in the median, "
        f"{100 * np.quantile(off, 0.95):.0f} % at 95 %; "
        f"{100 * np.concatenate(inside).mean():.0f} % of the intervals hold"
    )


if __name__ == "__main__":
    main()
