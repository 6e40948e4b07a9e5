"""Bounds along a path, and the worst that is found beside them: `python tools/path_bounds.py` (docs/path.md).

Arms with known rotors follow one move; torques of any course up to a size act on all joints. The worst course
at a frozen configuration switches with the signs of the impulse responses. It runs in the simulation of the
whole arm, such that its peak comes where the arm then is.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import armgpi
from armgpi.base.arrays import Array
from armgpi.certification.channels import sampled_loops
from armgpi.certification.path import PathBound, Wish, bound_path
from armgpi.certification.quantities import slopes
from armgpi.gpi.gains import FixedGains
from armgpi.references.bezier import PEAK_VELOCITY
from armgpi.robot.robot import Robot

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests" / "certification"))
from soundness import Course

#: Arms, with what is locked of them.
ARMS = {"ur5": (), "panda": ("panda_finger_joint1", "panda_finger_joint2")}
#: Speed of the fastest joint on the way [rad/s], how far each joint goes [rad], and when it begins [s].
SPEED, WAY, BEGIN = 0.2, 0.5, 0.2
#: Samples of a response.
SAMPLES = 1000


def responses(wish: Wish, arm: Robot, q: Array) -> Array:
    """Return each joint's response to each torque of one sample, the arm frozen at q: (samples, n, n)."""
    controller: Any = wish.controller
    loops, n = sampled_loops(controller, wish.delay), arm.n
    inverse = np.linalg.inv(arm.mass_matrix(q))
    gain = inverse @ controller.robot.mass_matrix(q)
    stiffness = inverse @ slopes(arm.gravity, q[None])[0].T
    x = loops.push[None, :, None] * inverse[:, None, :]
    found = np.empty((SAMPLES, n, n))
    for k in range(SAMPLES):
        found[k] = x[:, 0]
        asked = gain @ np.einsum("im,imj->ij", loops.asks, x)
        pushed = asked - stiffness @ x[:, 0] if controller.feedforward == "none" else asked
        x = loops.open @ x + loops.push[None, :, None] * pushed[:, None, :]
    return found


def attack(made: PathBound, at: int) -> Array:
    """Return each joint's largest error in simulations of the torques that are the worst for it, (n,)."""
    wish = made.wish
    h, n = wish.controller.dt, wish.controller.robot.n
    worst = np.zeros(n)
    q = wish.reference.at(at * h).q
    for arm in wish.arms:
        seen = responses(wish, arm, q)
        for joint in range(n):
            course = np.zeros((at, n))
            last = min(SAMPLES, at)
            course[at - last :] = wish.torque * np.sign(seen[:last, joint][::-1])
            for sign in (1.0, -1.0):
                plant: Any = armgpi.RigidBodyPlant(
                    arm, loads=[Course(sign * course, h)], friction="urdf" if wish.friction else None
                )
                if wish.hidden.any():
                    plant = armgpi.Encoder(plant, 16)
                if wish.delay:
                    plant = armgpi.Delayed(plant, wish.delay)
                run = armgpi.simulate(plant, wish.controller, wish.reference, h * (at + 200), progress=False)
                error = np.abs(run["q"].values - run["q_ref"].values)[1:]
                worst = np.maximum(worst, error.max(axis=0))
    return worst


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--arms", nargs="+", default=list(ARMS))
    parser.add_argument("--rotors", nargs="+", type=float, default=[0.1, 0.3, 0.5])
    parser.add_argument("--torque", type=float, default=0.5)
    parser.add_argument("--share", type=float, default=0.0, help="of the efforts, added to it as torque")
    parser.add_argument("--speed", type=float, default=SPEED, help="of the fastest joint [rad/s]")
    parser.add_argument(
        "--friction", type=float, default=0.0, help="Coulomb friction as a share of the effort"
    )
    parser.add_argument("--within", type=float, help="it is fed forward, and known within this share")
    parser.add_argument("--laws", nargs="+", default=["none", "model", "gpi_auto"])
    parser.add_argument("--moments", type=int, default=3, help="of the move at which the worst is looked for")
    given = parser.parse_args()
    print(
        "| arm | rotors [kg m²] | law | bound [mrad] | tool [mm] | worst found [mrad] | ratio | "
        "bears [N m] | [N] | s |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for name in given.arms:
        for rotors in given.rotors:
            for law in given.laws:
                row(name, rotors, law, given)
    return 0


def row(name: str, rotors: float, law: str, given: Any) -> None:
    """Print one row."""
    robot = armgpi.Robot.load(name, lock=ARMS[name]).with_armature(rotors)
    if given.friction:
        robot = robot.with_friction(0.0, given.friction * robot.limits.effort)
    options: dict[str, Any] = {"delay": 1e-3, "friction_feedforward": given.within is not None}
    arms = [robot]
    if given.within is not None:
        arms = [
            robot.with_friction(0.0, x * robot.friction.coulomb) for x in (1 - given.within, 1 + given.within)
        ]
    if law == "gpi_auto":
        controller = armgpi.GPI.auto(robot, 1e-3, bits=16, drives="stiff", **options)
    else:
        controller = armgpi.GPI(robot, 1e-3, gains=FixedGains(30.0), feedforward=law, **options)
    start = robot.middle()
    duration = WAY * PEAK_VELOCITY / given.speed
    reference = armgpi.Bezier(start, start + WAY, duration=duration, t_start=BEGIN)
    end = BEGIN + duration
    begun = time.process_time()
    made = bound_path(
        controller,
        reference,
        end + 0.5,
        torque=given.torque + given.share * robot.limits.effort,
        arms=None if law == "gpi_auto" and not given.friction else arms,
        friction=bool(given.friction),
        bits=16,
    )
    took = time.process_time() - begun
    head = f"| {name} | {rotors:g} | {law} |"
    if not made.holds:
        print(f"{head} - | - | - | - | - | - | {took:.1f} | {'; '.join(made.reasons)}", flush=True)
        return
    moments = np.linspace(min(1.2, 0.4 * end), end, given.moments)
    worst = np.max([attack(made, round(t / controller.dt)) for t in moments], axis=0)
    ratio = made.error / worst
    print(
        f"{head} {1e3 * made.error.min():.2g} to {1e3 * made.error.max():.2g} | {1e3 * made.tool:.2g} | "
        f"{1e3 * worst.min():.2g} to {1e3 * worst.max():.2g} | {ratio.min():.2f} to {ratio.max():.2f} | "
        f"{made.tolerated_torque:.2g} | {made.tolerated_force:.2g} | {took:.1f} |",
        flush=True,
    )


if __name__ == "__main__":
    sys.exit(main())
