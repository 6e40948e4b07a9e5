"""Print how well the rule for rotors that no file tells (armgpi.robot.rotors) meets the published drives.

Usage:
    python tools/rotors.py
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armgpi.robot.rotors import SCATTER, SPIN_UP


class Rotor(NamedTuple):
    """A published drive, all as seen at the joint.

    Attributes:
        robot: which robot or servo.
        joint: which of its joints, from 1.
        wrist: whether it is one of the last three joints of an arm.
        effort: torque limit [N m].
        velocity: velocity limit [rad/s].
        inertia: of the rotor, gear ratio squared [kg m^2].
        part: "fit" or "held-out"; "set by hand" for values of simulation models, which nothing uses.
    """

    robot: str
    joint: int
    wrist: bool
    effort: float
    velocity: float
    inertia: float
    part: str


def _arm(robot: str, part: str, effort: str, velocity: str, inertia: str, wrists: int = 3) -> list[Rotor]:
    """Return the joints of an arm from lists in text."""
    columns = ([float(x) for x in column.split()] for column in (effort, velocity, inertia))
    rows = list(zip(*columns, strict=True))
    return [Rotor(robot, i + 1, i >= len(rows) - wrists, e, v, J, part) for i, (e, v, J) in enumerate(rows)]


#: Identified or manufacturers' own values, half of the robots to fit and half held out, and some that
#: simulation models were given by hand. Looked up in public files: Franka's reflected inertias of the FR3
#: (README of Drake's franka_description); eRob, MX and STS3215 as models of their users have them (a rotor
#: and a gear ratio, or a pendulum's identification: Rhoban/bam), XL330 likewise; Schunk LWA 4P
#: (AndreaGiusti/OTFCtrlModRob, identified). As cited, not looked up again: UR10e, identified from the
#: currents of shamilmamedov/dynamic_calibration (its first three joints cannot be told from their links);
#: Puma 560, measured (Armstrong, Khatib, Burdick 1986); KUKA LWR 4+, identified (Jubien, Gautier, Janot
#: 2014); limits of both and of some servos; the values set by hand.
PUBLISHED = (
    *_arm("Franka FR3", "fit", "87 87 87 87 12 12 12", "2.62 2.62 2.62 2.62 5.26 4.18 5.26",
          "0.606 0.606 0.462 0.462 0.206 0.206 0.206"),
    *_arm("UR10e", "fit", "56 56 56", "3.14 3.14 3.14", "0.42 0.43 0.46"),
    *_arm("eRob 70, 80", "fit", "12 23 30 36 44 56 70", "6.28 6.28 3.93 2.62 6.28 3.93 2.62",
          "0.117 0.0653 0.167 0.376 0.112 0.288 0.647", 0),
    *_arm("Dynamixel MX-106, MX-64", "fit", "8.4 6.0", "4.7 6.6", "0.025 0.012", 0),
    *_arm("Puma 560", "held-out", "97.6 186 89.4 24.2 20.1 21.3", "1.43 1.29 2.13 3.98 4.21 3.98",
          "1.14 4.71 0.83 0.2 0.18 0.19"),
    *_arm("Schunk LWA 4P", "held-out", "75.5 75.5 75.5 75.5 20 20", "1.26 1.26 1.26 1.26 1.26 1.26",
          "1.34 1.34 1.34 1.34 0.17 0.17"),
    *_arm("Feetech STS3215, Dynamixel XL330", "held-out", "2.94 0.6", "6.3 10.9", "0.028 0.0022", 0),
    *_arm("KUKA LWR 4+", "held-out", "176 176 100 100 100 38 38", "1.92 1.92 2.23 2.23 3.56 3.21 3.21",
          "3.19 3.05 1.98 2.05 0.79 0.39 0.39"),
    *_arm("Panda of mujoco_menagerie", "set by hand", "87 87 87 87 12 12 12",
          "2.17 2.17 2.17 2.17 2.61 2.61 2.61",
          "0.1 0.1 0.1 0.1 0.1 0.1 0.1"),
    *_arm("UR5e of mujoco_menagerie", "set by hand", "150 150 150 28 28 28", "3.14 3.14 3.14 3.14 3.14 3.14",
          "0.1 0.1 0.1 0.1 0.1 0.1"),
)  # fmt: skip


def spin_up(rotor: Rotor) -> float:
    """Return in what time a published drive turns its own rotor to its velocity limit [s]."""
    return rotor.inertia * rotor.velocity / rotor.effort


def mean_spin_up(part: str = "fit") -> float:
    """Return the geometric mean of that time over the robots of a part, each with the same weight [s]."""
    robots = {rotor.robot for rotor in PUBLISHED if rotor.part == part}
    each = [np.mean([math.log(spin_up(x)) for x in PUBLISHED if x.robot == name]) for name in sorted(robots)]
    return math.exp(float(np.mean(each)))


def row(name: str, rotors: list[Rotor]) -> str:
    """Return a row of the table: how far published inertias are from what is believed of them."""
    ratio = np.array([spin_up(each) for each in rotors]) / SPIN_UP
    within = [float(np.mean(np.maximum(ratio, 1.0 / ratio) <= factor)) for factor in (2.0, SCATTER, 4.0)]
    shares = " | ".join(f"{100.0 * share:.0f} %" for share in within)
    return f"| {name} | {len(ratio)} | {ratio.min():.2f} to {ratio.max():.2f} | {shares} |"


def main() -> None:
    """Print the fitted time and the table."""
    print(f"spin-up: {1e3 * mean_spin_up():.1f} ms fitted, {1e3 * SPIN_UP:.1f} ms used\n")
    print(f"| drives | joints | true / believed | within 2 | within {SCATTER:g} | within 4 |")
    print("|---|---|---|---|---|---|")
    for part in ("fit", "held-out", "set by hand"):
        own = [each for each in PUBLISHED if each.part == part]
        print(row(f"**{part}**", own))
        for name in dict.fromkeys(each.robot for each in own):
            print(row(name, [each for each in own if each.robot == name]))
        if wrists := [each for each in own if each.wrist]:
            print(row(f"wrists, {part}", wrists))


if __name__ == "__main__":
    main()
