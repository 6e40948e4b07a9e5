"""Count the linear cases of arms with gears that twist in which a law holds (armgpi.control.two_mass).

Usage:
    python tools/gears.py            # Panda and UR5, 8 configurations, 96 cases each; some minutes
"""

from __future__ import annotations

import argparse

import numpy as np

from armgpi import GPI, FixedGains, Robot
from armgpi.control.two_mass import Gears, growth, law, loop, plant
from armgpi.robot.kinematics import random_configurations

DT = 1e-3
#: Rotors [kg m^2] and stiffness [N m/rad] of typical size: assumed, not identified.
ARMS = {
    "panda": ([0.6, 0.6, 0.46, 0.46, 0.2, 0.2, 0.2], [14e3, 14e3, 14e3, 14e3, 8e3, 8e3, 8e3]),
    "ur5": ([1.2, 1.2, 0.8, 0.2, 0.2, 0.2], [20e3, 20e3, 15e3, 5e3, 5e3, 5e3]),
}
#: Share of the inertia in the feedback, and bandwidth [rad/s].
LAWS = ((1.0, 8.0), (0.5, 14.0), (0.35, 14.0), (0.35, 17.0), (0.35, 20.0), (0.25, 20.0))


def count(name: str, seed: int) -> None:
    """Print in how many cases of an arm each law is stable."""
    whole = Robot.load(name)
    fingers = [joint for joint in whole.joint_names if "finger" in joint]
    rotor, stiffness = map(np.array, ARMS[name])
    arm = (Robot.load(name, lock=fingers) if fingers else whole).with_armature(rotor)
    configurations = random_configurations(arm, 8, seed=seed)
    for share, omega in LAWS:
        gpi = GPI(
            arm.scaled_inertia(share),
            DT,
            delay=DT,
            bias_robot=arm,
            feedforward="computed",
            integrators=1,
            gains=FixedGains(omega, 1.0, omega),
        )
        stable = [
            growth(loop(plant(arm, q, Gears(rotor, x * stiffness, damping, 500.0, side), DT), law(gpi, q), 1))
            < 1
            for q in configurations
            for x in (0.5, 1.0, 2.0)
            for side in ("motor", "link")
            for damping in (0.05, 0.01)
        ]
        print(f"{name}: share {share:g}, {omega:g} rad/s: {sum(stable)} of {len(stable)}", flush=True)


def main() -> None:
    """Print all counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="of the configurations")
    seed = parser.parse_args().seed
    for name in ARMS:
        count(name, seed)


if __name__ == "__main__":
    main()
