"""Whether motions of `armgpi excite` collide with the arm itself or its floor, by a slower look.

For each arm and seed the motion is sampled every 5 ms. The arm's own links are compared by their meshes as
they are (:func:`armgpi.robot.collisions.self_collisions`: no hulls, no margin, every pair but neighbours);
pairs that `excite` names as overlapping by design do not count. The floor is compared with the lowest
vertex of each mesh. `--unsafe` looks at motions that nothing keeps clear.

    python tools/safe_motions.py --seeds 10
"""

from __future__ import annotations

import argparse
import time
import warnings
from typing import Any

import numpy as np
import pinocchio as pin

import armgpi
from armgpi.base.arrays import Array
from armgpi.errors import ArmgpiError
from armgpi.identification.excitation import Excitation, excite
from armgpi.robot.clearance import Clearance, usual_floor
from armgpi.robot.collisions import read_shapes, self_collisions

#: The arms: one of each make, alone and on a robot.
ARMS = (
    *("ur5", "ur10", "ur3", "ur5_gripper", "panda", "kinova", "xarm7", "z1", "so100", "so101"),
    *("g1_left_arm", "baxter_left_arm", "pr2_right_arm", "tiago_arm", "tiago_pro_left_arm", "icub_left_arm"),
    *("romeo_left_arm", "talos_left_arm_7", "alex_right_arm", "centauro_left_arm"),
)
#: Sampling of the second look [s], and depth below the floor that counts [m].
STEP, DEPTH = 5e-3, 1e-6


def lowest(shape: Any, pose: Any) -> float:
    """Return the height of the lowest point of a shape at a pose [m]."""
    up, height = np.asarray(pose.rotation)[2], float(pose.translation[2])
    geometry = shape.geometry
    match type(geometry).__name__:
        case "Sphere":
            return height - float(geometry.radius)
        case "Box":
            return height - float(np.abs(up) @ geometry.halfSide)
        case "Cylinder":
            return height - float(np.hypot(up[0], up[1]) * geometry.radius + abs(up[2]) * geometry.halfLength)
        case _:
            return height + float((np.array(geometry.vertices()) @ up).min())


def touches_floor(robot: armgpi.Robot, q: Array, floor: float) -> bool:
    """Tell whether a shape beyond the first joint is below a floor at a configuration, (k, n)."""
    shapes, model = read_shapes(robot).model, robot.pinocchio_model()
    data, placed = model.createData(), shapes.createData()
    rows = q if robot.coupling is None else q @ robot.coupling.ratio.T + robot.coupling.offset
    for row in rows:
        pin.updateGeometryPlacements(model, data, shapes, placed, row)
        for shape, pose in zip(shapes.geometryObjects, placed.oMg, strict=True):
            if shape.parentJoint > 1 and lowest(shape, pose) < floor - DEPTH:
                return True
    return False


def collides(
    robot: armgpi.Robot, motion: Excitation, known: Clearance, floor: float | None
) -> tuple[bool, bool]:
    """Return whether a motion brings two links together, and whether one below the floor."""
    reference = motion.reference
    q = reference.at(np.arange(0.0, reference.t_end, STEP)).q
    pairs = {frozenset(pair) for pair in known.overlapping}
    found = self_collisions(robot, np.vstack([robot.middle(), q])) or []
    own = any(frozenset((each.first, each.second)) not in pairs for each in found)
    return own, floor is not None and touches_floor(robot, q, floor)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", nargs="+", default=ARMS)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--unsafe", action="store_true", help="motions that nothing keeps clear")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    options: dict[str, Any] = {"floor": None, "collisions": False} if given.unsafe else {}
    print("| arm | floor [m] | margin [mm] | with itself | the floor | speed [%] | time [s] |")
    print("|---|---|---|---|---|---|---|")
    sums = np.zeros(3, dtype=int)
    for name in given.arms:
        robot = armgpi.Robot.load(name)
        floor, counts, speeds, seconds, none = usual_floor(robot), np.zeros(2, dtype=int), [], [], 0
        known = Clearance(robot, floor=floor)
        for seed in range(given.seeds):
            begin = time.process_time()
            try:
                motion = excite(robot, 20.0, seed=seed, **options)
            except ArmgpiError:
                none += 1
                continue
            seconds.append(time.process_time() - begin)
            speeds.append(float(np.median(motion.share)))
            counts += collides(robot, motion, known, floor)
        sums += [len(speeds), *counts]
        height = "none" if floor is None else f"{floor:.2f}"
        done = f"{len(speeds)}" if not none else f"{len(speeds)} ({none} without a motion)"
        print(
            f"| {name} | {height} | {1e3 * known.margin:.0f} | {counts[0]} of {done} | {counts[1]} | "
            f"{100 * np.median(speeds):.0f} | {np.median(seconds):.1f} |",
            flush=True,
        )
    print(f"| **all** | | | **{sums[1]} of {sums[0]}** | **{sums[2]}** | | |")


if __name__ == "__main__":
    main()
