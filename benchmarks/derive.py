"""How long it takes to derive closed-form dynamics, and how close they are to Pinocchio's.

    python benchmarks/derive.py

Every robot that can be loaded by name is derived: whole when it has at most four joints, else its first
four. A time is printed only after D and C v + G agree with Pinocchio to 1e-10 of their largest values.
"""

from __future__ import annotations

import time
import warnings

import _page
import _timing
import numpy as np
from _timing import table

from armgpi import Robot, derive, robots

BOUND = 1e-10
STATES = 20


def away(robot: Robot, text: str) -> float:
    """Return the largest relative difference from Pinocchio at random states."""
    space: dict[str, object] = {}
    exec(text, space)
    rng = np.random.default_rng(0)
    worst = 0.0
    for _ in range(STATES):
        q, v = rng.uniform(-1.5, 1.5, robot.n), rng.normal(size=robot.n)
        D, bias = robot.mass_matrix(q), robot.nonlinear_effects(q, v)
        own = space["coriolis_matrix"](q, v) @ v + space["gravity"](q)  # type: ignore[operator]
        worst = max(worst, np.abs(space["mass_matrix"](q) - D).max() / np.abs(D).max())  # type: ignore[operator]
        worst = max(worst, np.abs(own - bias).max() / max(np.abs(bias).max(), 1e-3 * np.abs(D).max()))
    return float(worst)


def main() -> None:
    rows = []
    for name in robots.names():
        robot = Robot.load(name)
        whole = robot.n <= 4
        if not whole:
            robot = Robot.load(name, keep=robot.joint_names[:4])
        start = time.process_time()
        text = derive(robot).python()
        took = time.process_time() - start
        error = away(robot, text)
        if error > BOUND:
            raise SystemExit(f"{name}: off by {error:.2g}")
        part = "whole" if whole else "first 4 joints"
        rows.append((name, robot.n, part, f"{took:.2f}", f"{error:.1e}", len(text.splitlines())))
    print(f"# Closed forms\n\n{_page.PURPOSE['derive']}\n")
    facts = _timing.machine(("armgpi", "sympy", "pin", "numpy"))
    print(f"`python benchmarks/derive.py`\n\n{_timing.machine_table(facts)}")
    print(
        "\nDerived, written as Python and compared with Pinocchio, with symbols for all masses, lengths and"
        "\ninertias. Slow are those whose URDF has rounded angles or full inertia tensors. Apart: largest"
        f"\nrelative difference of D and C v + G from Pinocchio's at {STATES} random states.\n"
    )
    print(table(("robot", "joints", "", "seconds", "apart", "lines"), rows))


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main()
