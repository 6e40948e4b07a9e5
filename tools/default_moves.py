"""Default moves of all arms: conditioning, height, effort and collisions, beside those from the middle.

python tools/default_moves.py [ROBOT ...]

Conditioning is computed here once more, from other random configurations than the search for a move uses.
"""

from __future__ import annotations

import sys
import warnings

import numpy as np
import pinocchio as pin

import armgpi
from armgpi.base.arrays import Array
from armgpi.config import default_move
from armgpi.robot.clearance import Clearance, usual_floor
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot

#: Configurations by which conditioning and height are scaled, their seed, and those of a way.
SAMPLES, SEED, POINTS = 400, 11, 41


def conditioning(robot: Robot, q: Array) -> float:
    """Return the smallest singular value on a way over its median at random configurations."""
    samples = random_configurations(robot, SAMPLES, SEED)
    turning = ~robot.prismatic
    J = robot.frame_jacobian(robot.tip, samples)
    length = float(np.linalg.norm(J[:, :3] * turning, axis=1).max()) or 1.0
    least = np.inf
    for rows in (3, 6)[: 1 + (robot.n >= 6)]:
        scale = np.where(np.arange(rows) < 3, 1.0 / length, 1.0)[:, None] * np.where(turning, 1.0, length)
        median, values = (
            np.linalg.svd(robot.frame_jacobian(robot.tip, x)[:, :rows] * scale, compute_uv=False)
            for x in (samples, q)
        )
        usual = np.median(median, axis=0)
        rank = int((usual > 1e-6 * usual.max()).sum())
        least = min(least, float(values[:, rank - 1].min() / usual[rank - 1]))
    return least


def height(robot: Robot, q: Array) -> float:
    """Return the largest height of the centre of mass on a way, as a share of its range."""
    model = robot.pinocchio_model()
    data = model.createData()

    def energies(rows: Array) -> Array:
        if robot.coupling is not None:
            rows = rows @ robot.coupling.ratio.T + robot.coupling.offset
        return np.array([pin.computePotentialEnergy(model, data, row) for row in rows])

    samples = energies(random_configurations(robot, SAMPLES, SEED))
    span = float(np.ptp(samples))
    return 0.0 if span < 1e-9 else float((energies(q).max() - samples.min()) / span)


def row(robot: Robot, old: bool) -> str:
    """Return what there is to say of a move in a line."""
    start, goal = default_move.ends(robot, old)
    q = start + np.linspace(0.0, 1.0, POINTS)[:, None] * (goal - start)
    clear = Clearance(robot, floor=usual_floor(robot))
    hit = clear.first_hit(q)
    touched = "no shapes" if not clear.checked else "clear" if hit is None else f"{hit.first}, {hit.second}"
    share = float(robot.holding_share(q).max())
    return f"{conditioning(robot, q):12.2f} {height(robot, q):8.2f} {share:8.2f}  {touched}"


def main() -> None:
    """Print two lines for each arm: from the middle of the joint ranges, and the default move."""
    warnings.simplefilter("ignore", armgpi.ArmgpiWarning)
    print(f"{'arm':28}{'move':>8} conditioning   height   effort  collision")
    for name in sys.argv[1:] or armgpi.robots.names():
        robot = Robot.load(name)
        for which, old in (("middle", True), ("default", False)):
            print(f"{name:28}{which:>8} {row(robot, old)}", flush=True)


if __name__ == "__main__":
    main()
