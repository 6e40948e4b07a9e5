"""Inverse kinematics of arms nobody tuned for: share of poses solved, time per pose.

    python benchmarks/inverse_kinematics.py [--quick] [--json FILE]

Poses are those of random configurations inside the joint limits, so every one can be reached. They are solved
one by one, as a user would who has one, and all in one call. Then points beyond the reach: all must say so. A
solution counts when forward kinematics says so, not when the solver does. Times are processor times.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import _page
import _timing
import numpy as np
import numpy.typing as npt
from _timing import table

import armgpi

Array = npt.NDArray[np.float64]

#: Robot -> joints held, frame.
ARMS: dict[str, tuple[list[str], str]] = {
    "ur5": ([], "ee_link"),
    "panda": (["panda_finger_joint1", "panda_finger_joint2"], "panda_hand_tcp"),
    "kinova": ([], "j2s6s200_end_effector"),
}
TOLERANCE = 1e-9  # [m, rad]
AXIS = np.array([0.0, 0.0, 1.0])


def random_configurations(robot: armgpi.Robot, count: int) -> Array:
    """Random configurations inside the limits, within half a turn where there are none."""
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    return np.random.default_rng(2022).uniform(lower, upper, (count, robot.n))


def solved(robot: armgpi.Robot, frame: str, asked: dict[str, Array], q: Array) -> npt.NDArray[np.bool_]:
    """Tell which configurations are inside the limits and put the frame where it shall be."""
    pose = robot.frame_pose(frame, q)
    good = ((q >= robot.limits.lower) & (q <= robot.limits.upper)).all(axis=-1)
    good &= np.linalg.norm(pose.translation - asked["position"], axis=-1) <= 1.01 * TOLERANCE
    if "rotation" in asked:
        good &= np.abs(pose.rotation - asked["rotation"]).max(axis=(-1, -2)) <= 1.01 * TOLERANCE
    if "direction" in asked:
        good &= np.abs(pose.rotation @ AXIS - asked["direction"]).max(axis=-1) <= 1.01 * TOLERANCE
    return good


def measured(robot: armgpi.Robot, frame: str, asked: dict[str, Array]) -> dict[str, Any]:
    """Solve poses one by one and together; return shares and times [s]."""
    count = len(asked["position"])
    times, alone = [], []
    for i in range(count):
        begin = time.process_time()
        found = armgpi.inverse_kinematics(robot, frame, **{key: value[i] for key, value in asked.items()})
        times.append(time.process_time() - begin)
        alone.append(found.q)
    begin = time.process_time()
    together = armgpi.inverse_kinematics(robot, frame, **asked)
    batch = (time.process_time() - begin) / count
    good = solved(robot, frame, asked, together.q)
    if not np.array_equal(good, together.reached):
        raise RuntimeError(f"{robot.name}: `reached` is not what forward kinematics says")
    return {
        "solved": float(solved(robot, frame, asked, np.stack(alone)).mean()),
        "solved together": float(good.mean()),
        "median": float(np.median(times)),
        "90 %": float(np.quantile(times, 0.9)),
        "together": batch,
        "iterations": float(np.median(together.iterations)),
    }


def main() -> None:
    """Measure, print tables, write the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="100 poses instead of 1,000")
    parser.add_argument("--json", type=Path, help="file for the figures")
    options = parser.parse_args()
    count = 100 if options.quick else 1000
    figures: dict[str, Any] = {}
    rows, beyond = [], []
    for name, (lock, frame) in ARMS.items():
        robot = armgpi.Robot.load(name, lock=lock)
        pose = robot.frame_pose(frame, random_configurations(robot, count))
        tasks = {
            "position": {},
            "position, axis": {"direction": pose.rotation @ AXIS},
            "position, rotation": {"rotation": pose.rotation},
        }
        for task, more in tasks.items():
            figure = measured(robot, frame, {"position": pose.translation, **more})
            figures[f"{name}: {task}"] = figure
            rows.append(
                [
                    f"{name} (n = {robot.n})",
                    task,
                    f"{100.0 * figure['solved']:.1f} %",
                    f"{figure['iterations']:.0f}",
                    f"{1e3 * figure['median']:.2f}",
                    f"{1e3 * figure['90 %']:.2f}",
                    f"{1e3 * figure['together']:.2f}",
                ]
            )
        reach = np.linalg.norm(pose.translation, axis=-1).max()
        away = pose.translation / np.linalg.norm(pose.translation, axis=-1, keepdims=True)
        begin = time.process_time()
        far = armgpi.inverse_kinematics(robot, frame, 2.0 * reach * away[: count // 10])
        spent = (time.process_time() - begin) / len(far.q)
        beyond.append([name, f"{100.0 * np.mean(~far.reached):.1f} %", f"{1e3 * spent:.1f}"])
        figures[f"{name}: beyond"] = {"refused": float(np.mean(~far.reached)), "together": spent}
    print(f"# Inverse kinematics\n\n{_page.PURPOSE['inverse_kinematics']}\n")
    facts = _timing.machine(("armgpi", "pin", "numpy"))
    print(f"`python benchmarks/inverse_kinematics.py`\n\n{_timing.machine_table(facts)}")
    print(
        "\nProcessor time of one thread, random configurations. One by one, most of it is NumPy's overhead"
        "\nfor arrays of one row."
    )
    print(f"\n## {count} poses per arm that can be reached, to 1e-9 m and rad\n")
    head = ["arm", "asked", "solved", "iterations", "median, ms", "90 %, ms", "in one call, ms"]
    print(table(head, rows))
    print(f"\n## {count // 10} points at twice the reach\n")
    print(table(["arm", "said to be out of reach", "ms per pose"], beyond))
    if options.json:
        options.json.write_text(json.dumps(figures, indent=2), encoding="utf-8")


if __name__ == "__main__":
    main()
