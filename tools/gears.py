"""What laws bear of gears that twist, in the linear sampled loop (armgpi.tuning.two_mass).

Usage:
    python tools/gears.py                 # Panda and UR5 with gears of which the law is told nothing
    python tools/gears.py --structures    # other structures of the law on the same cases
    python tools/gears.py --held-out      # the same rule on arms that had no part in choosing it
    python tools/gears.py --told          # stiffness, damping and side of the encoder told
    python tools/gears.py --rotors        # bare files on arms with rotors drawn joint by joint
    python tools/gears.py --rollouts      # moves on the elastic plant, with a load that nobody tells
    python tools/gears.py --stops         # the same moves under a supervisor, a law for rigid gears
    python tools/gears.py --picture       # docs/images/gears.png

A case is one of 8 configurations, stiffness times 0.5, 1, 2, encoder at motor or link, gear damping 5 or 1 %:
96 an arm. Ms is of all joints; the peak error is of the worst joint after a step of 10 % of each
joint's largest gravity torque, all at once, at the nominal stiffness with encoders at the motors.
"""

from __future__ import annotations

import argparse
import itertools
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armgpi import (
    GPI,
    Bezier,
    Delayed,
    ElasticPlant,
    Encoder,
    FixedGains,
    RigidBodyPlant,
    Robot,
    Saturated,
    Supervisor,
    simulate,
)
from armgpi.base.arrays import Array
from armgpi.config.schema import PlantSection
from armgpi.control.linear_arm import Law, Sampled, open_loop
from armgpi.errors import ArmgpiWarning
from armgpi.robot import rotors
from armgpi.robot.kinematics import random_configurations
from armgpi.supervisor import Reason, complete_settings
from armgpi.tuning import geared, two_mass
from armgpi.viewing.style import look

DT, BITS, LATE = 1e-3, 16, 1
#: Rotors [kg m^2] and stiffness [N m/rad] of typical size: assumed, not identified.
ARMS = {
    "panda": ([0.6, 0.6, 0.46, 0.46, 0.2, 0.2, 0.2], [14e3, 14e3, 14e3, 14e3, 8e3, 8e3, 8e3]),
    "ur5": ([1.2, 1.2, 0.8, 0.2, 0.2, 0.2], [20e3, 20e3, 15e3, 5e3, 5e3, 5e3]),
}
#: Times the stiffness in the cases.
TIMES = (0.5, 1.0, 2.0)
#: Arms that had no part in choosing the rule, and draws of their drives: rotors as believed times a factor of
#: up to 2.5 for all and 1.5 joint by joint, gears that twist by 4 to 16 mrad at the torque limit, times 1.3
#: likewise.
HELD_OUT, DRAWS = ("ur3", "ur10", "kinova", "xarm7", "z1", "baxter_left_arm", "tiago_arm", "so101"), 3
#: Structures: factor of the rotors in the feedback, share of its inertia, roll-off and omega [rad/s].
STRUCTURES = (
    (1.0, 1.0, None, 8.0), (1.0, 0.5, None, 12.0), (1.0, 0.35, None, 17.0), (1.0, 0.25, None, 20.0),
    (1.0, 1.0, 4.0, 5.0), (2.0, 1.0, None, 7.5), (3.0, 1.0, None, 7.0), (3.0, 1.0, 4.0, 4.0),
    (5.0, 1.0, None, 6.0), (10.0, 1.0, None, 5.0),
)  # fmt: skip


class Judged(NamedTuple):
    """What was seen of a law: stable cases, all cases, Ms of each, and the peak error [rad]."""

    stable: int
    cases: int
    sensitivity: Array
    peak: float

    def __str__(self) -> str:
        """Return it in a line."""
        half, most, largest = np.quantile(self.sensitivity, [0.5, 0.9, 1.0], method="nearest")
        peak = f", peak error {1e3 * self.peak:.1f} mrad" if np.isfinite(self.peak) else ""
        ms = f"Ms {half:.2f} (median) {most:.1f} (90 %) {largest:.1f} (largest)"
        return f"{self.stable} of {self.cases}, {ms}{peak}"


def arm(name: str) -> Robot:
    """Return an arm without fingers."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)
        whole = Robot.load(name)
        fingers = [joint for joint in whole.joint_names if "finger" in joint]
        return Robot.load(name, lock=fingers) if fingers else whole


def untuned(robot: Robot, bits: int | None = BITS, **given: Any) -> GPI:
    """Return what the rule makes."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)
        return GPI.auto(robot, DT, delay=LATE * DT, bits=bits, **given)


def peak(plant: Sampled, law: Law, torque: Array) -> float:
    """Return the largest error after a step of torque within 1.5 s [rad]."""
    A, B, C = open_loop(plant, law, LATE)
    x, largest = np.zeros(len(A)), 0.0
    closed, n = A + B @ C, len(plant.A)
    for _ in range(round(1.5 / DT)):
        x = closed @ x + B @ torque
        largest = max(largest, float(np.abs(plant.C @ x[:n]).max()))
    return largest


def cases(
    robot: Robot, rotor: Array, stiffness: Array | None, seed: int, times: Iterable[float]
) -> Iterator[tuple[Array, two_mass.ArmLoop, bool]]:
    """Yield configuration and arm of each case, and whether its peak error is taken."""
    for q in random_configurations(robot, 8, seed=seed):
        for factor, side, damping in itertools.product(times, ("motor", "link"), (0.05, 0.01)):
            scaled = None if stiffness is None else factor * stiffness
            gears = two_mass.Gears(rotor, scaled, damping, 500.0, side)
            peaks = (factor, side, damping) == (1.0, "motor", 0.05)
            yield q, two_mass.ArmLoop(robot, q, gears, DT, LATE), peaks


def stable(
    law: GPI,
    robot: Robot,
    rotor: Array,
    stiffness: Array | None,
    seed: int,
    times: Iterable[float] = TIMES,
) -> list[bool]:
    """Return in which cases a law is stable."""
    every = cases(robot, rotor, stiffness, seed, times)
    return [loop.growth(two_mass.law(law, q)) < 1.0 for q, loop, _ in every]


def judge(
    law: GPI, robot: Robot, rotor: Array, stiffness: Array, seed: int, times: Iterable[float] = TIMES
) -> Judged:
    """Return how a law does on an arm with some drives."""
    torque = 0.1 * np.abs(robot.gravity(random_configurations(robot, 50, seed=0))).max(axis=0)
    found, largest = [], 0.0
    for q, loop, peaks in cases(robot, rotor, stiffness, seed, times):
        linear = two_mass.law(law, q)
        found.append(loop.sensitivity(linear))
        if peaks:
            largest = max(largest, peak(loop.plant, linear, torque) if np.isfinite(found[-1]) else np.inf)
    return Judged(int(np.isfinite(found).sum()), len(found), np.array(found), largest)


def structures(seed: int) -> None:
    """Print what other structures of the law do with rotors known."""
    for name, (rotor, stiffness) in ARMS.items():
        robot = arm(name).with_armature(rotor)
        for factor, share, rolloff, omega in STRUCTURES:
            law = GPI(
                robot.scaled_inertia(share), DT, delay=LATE * DT, bias_robot=robot, feedforward="computed",
                integrators=1, rotor_factor=factor, gains=FixedGains(omega, 1.0, omega),
                **({} if rolloff is None else {"rolloff": 1, "rolloff_ratio": rolloff}),
            )  # fmt: skip
            said = f"rotors x {factor:g}, share {share:g}, roll-off {rolloff or 'none'}, {omega:g} rad/s"
            print(
                f"{name}: {said}: {judge(law, robot, np.array(rotor), np.array(stiffness), seed)}", flush=True
            )


def rule(seed: int) -> None:
    """Print what the rule does where the stiffness is believed, and rotors known or believed."""
    for name, (rotor, stiffness) in ARMS.items():
        bare = arm(name)
        robot = bare.with_armature(rotor)
        for known, told in (("rotors told", robot), ("rotors believed", bare)):
            law = untuned(told)
            omega = law.gains.nominal().omega_c
            seen = judge(law, robot, np.array(rotor), np.array(stiffness), seed)
            print(f"{name}, {known}: {omega.min():.1f} to {omega.max():.1f} rad/s: {seen}", flush=True)


def drawn(robot: Robot, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return rotors and stiffness of an arm held out."""

    def about(factor: float, *shape: int) -> Any:
        return np.exp(rng.uniform(-np.log(factor), np.log(factor), shape))

    rotor = rotors.typical_inertia(robot) * about(2.5) * about(1.5, robot.n)
    return rotor, rotors.motor_torque(robot) / (8e-3 * about(2.0)) * about(1.3, robot.n)


def held_out(seed: int) -> None:
    """Print the same of arms that had no part in choosing the rule."""
    rng = np.random.default_rng(100 + seed)
    for name, i in itertools.product(HELD_OUT, range(DRAWS)):
        bare = arm(name)
        rotor, stiffness = drawn(bare, rng)
        robot = bare.with_armature(rotor)
        for known, told in (("told", robot), ("believed", bare)):
            seen = judge(untuned(told), robot, rotor, stiffness, seed, (1.0,))
            print(f"{name} {i}, rotors {known}: {seen}", flush=True)


def told(seed: int) -> None:
    """Print, with all of the gear told, what share the rule has of each case's own best bandwidth."""
    for name, (rotor, stiffness) in ARMS.items():
        shares = []
        for factor, side, damping in itertools.product((0.5, 1.0, 2.0), ("motor", "link"), (0.05, 0.01)):
            robot = arm(name).with_armature(rotor)
            gears = two_mass.Gears(np.array(rotor), factor * np.array(stiffness), damping, 500.0, side)
            middle = robot.mass_matrix(robot.middle()) - np.diag(rotor)
            absolute = damping * two_mass.damping_at_one(middle, gears)
            known = zip(robot.joint_names, gears.stiffness.tolist(), absolute.tolist(), strict=True)
            data = {
                j: {"stiffness": K, "damping": B, "current_bandwidth": 500.0, "encoder_side": side}
                for j, K, B in known
            }
            law = untuned(robot.with_drives(data), bits=None)  # which would make single joints slower
            configurations = random_configurations(robot, 8, seed=seed)
            cases = [
                geared.Case(q, two_mass.ArmLoop(robot, q, gears, DT, LATE), True) for q in configurations
            ]
            omega = float(law.gains.nominal().omega_c.min())
            best = geared.Loops(cases, law.robot, robot, law.member, DT).fastest(
                80.0, geared.SENSITIVITIES[0]
            )
            most = max(case.arm.sensitivity(two_mass.law(law, case.q)) for case in cases)
            shares.append(omega / best if best else np.inf)
            print(
                f"{name}, stiffness x {factor:g}, {side}, {100 * damping:g} %: from {omega:.1f} rad/s on, "
                f"Ms {most:.2f}; at most {best:.1f} rad/s at Ms 2.5", flush=True,
            )  # fmt: skip
        print(f"{name}: at least 0.75 of the best in {np.sum(np.array(shares) >= 0.75)} of {len(shares)}")


def draws(seed: int) -> None:
    """Print in how many draws of rotors a law for the bare file is stable at all configurations."""
    for name, (_, stiffness) in ARMS.items():
        bare, rng, rigid, soft = arm(name), np.random.default_rng(200 + seed), 0, 0
        law = untuned(bare)
        for _ in range(20):
            rotor = np.exp(rng.uniform(np.log(0.1), np.log(1.2), bare.n))
            robot = bare.with_armature(rotor)
            rigid += all(stable(law, robot, rotor, None, seed, (1.0,)))
            soft += all(stable(law, robot, rotor, np.array(stiffness), seed))
        print(
            f"{name}: 20 draws of rotors, 0.1 to 1.2 kg m^2: rigid gears {rigid}, all 96 cases {soft}",
            flush=True,
        )


def elastic(robot: Robot, stiffness: Array, side: str) -> ElasticPlant:
    """Return an arm with 0.25 kg that nobody tells, damping of 2 % and current loops of 500 Hz."""
    gears, middle = two_mass.Gears(robot.armature, stiffness), robot.mass_matrix(robot.middle())
    damping = 0.02 * two_mass.damping_at_one(middle - np.diag(robot.armature), gears)
    return ElasticPlant(
        robot.with_payload(robot.tip, 0.25),
        gear_stiffness=stiffness,
        gear_damping=damping,
        current_bandwidth=500.0,
        encoder_side=side,
    )


def stops(seed: int) -> None:
    """Print how laws for rigid gears are stopped on the elastic plant: reason, travel, when at rest."""
    for name, (rotor, stiffness) in ARMS.items():
        robot = arm(name).with_armature(rotor)
        law, start = untuned(robot, drives="stiff"), robot.middle()
        given = complete_settings(Supervisor(), PlantSection(encoder_bits=BITS, delay=LATE), law)
        for side, factor in itertools.product(("motor", "link"), TIMES):
            plant = Saturated(elastic(robot, factor * np.array(stiffness), side))
            late, move = Delayed(Encoder(plant, BITS), LATE), Bezier(start, start + 0.5, 3.0)
            seen = simulate(late, law, move, 6.0, progress=False, backend="compiled", supervisor=given)
            said = f"{name}, {side}, stiffness x {factor:g}: "
            if not int(seen["fault"]):
                print(said + "runs", flush=True)
                continue
            q = seen["q"].values[round(float(seen["t_fault"]) / DT) :]
            travel = np.abs(q - q[0]).max(axis=1)
            speed = np.abs(np.diff(q, axis=0)).max(axis=1) / DT
            rest = DT * (1 + np.flatnonzero(speed > 0.1)[-1])
            reason, when = Reason(int(seen["fault"])).name, float(seen["t_fault"])
            said += f"{reason} at {when:.2f} s, travel in half a second {travel[:500].max():.2f}, in all "
            said += f"{np.nanmax(travel):.2f} rad, after a second {speed[800:1000].max():.2f} rad/s"
            print(f"{said}, below 0.1 rad/s from {rest:.2f} s on", flush=True)


def rollouts(seed: int) -> None:
    """Print how moves of 0.5 rad end on the elastic plant: 0.25 kg untold, damping 2 %, currents 500 Hz."""
    for name, (rotors_told, stiffness_told) in ARMS.items():
        rotor, stiffness, bare = np.array(rotors_told), np.array(stiffness_told), arm(name)
        robot = bare.with_armature(rotor)
        start = robot.middle()
        laws = {
            "fast, rotors told": untuned(robot, drives="stiff"),
            "soft, rotors told": untuned(robot),
            "soft, bare file": untuned(bare),
        }
        for which, law in laws.items():
            peaks, swings, steps = [], [], []
            for side, factor in itertools.product(("motor", "link"), TIMES):
                plant = elastic(robot, factor * stiffness, side)
                move = Bezier(start, start + 0.5, 3.0)
                late = Delayed(Encoder(plant, BITS), LATE)
                seen = simulate(late, law, move, 6.0, progress=False, backend="compiled")
                peaks.append(np.abs((seen["q_measured"] - seen["q_ref"]).values).max())
                swings.append(np.ptp(seen["q"].values[-1000:], axis=0).max())
                steps.append(np.abs(np.diff(seen["tau"].values, axis=0)).max())
            held = np.sum(np.array(swings) < 1e-3)
            print(
                f"{name}, {which}: {held} of 6 come to rest, peak error {1e3 * min(peaks):.2g} to "
                f"{1e3 * max(peaks):.2g} mrad, torque steps of up to {max(steps):.2g} N m",
                flush=True,
            )


def largest_error(plant: Any, law: GPI) -> tuple[Array, Array]:
    """Return times [s] and the largest error of a move with 16 bits and a sample of delay [rad]."""
    start = plant.robot.middle()
    late = Delayed(Encoder(plant, BITS), LATE)
    rollout = simulate(late, law, Bezier(start, start + 0.5, 1.5), 3.0, progress=False, backend="compiled")
    error = np.abs((rollout["q"] - rollout["q_ref"]).values).max(axis=-1)
    return rollout["time"].values, np.maximum(error, 1e-6)


def picture(seed: int) -> None:
    """Draw what rotors and elastic joints do to a controller, on UR5."""
    import matplotlib.pyplot as plt

    rotor, stiffness = map(np.array, ARMS["ur5"])
    bare = arm("ur5")
    robot = bare.with_armature(rotor)
    laws = {
        "designed without rotors": untuned(bare, drives="none"),
        "for stiff joints (rotors assumed)": untuned(bare, drives="stiff"),
        "for elastic joints (rotors and stiffness assumed)": untuned(bare),
    }
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(13.0, 3.8), layout="constrained")
    elastic = ElasticPlant(robot, gear_stiffness=stiffness, current_bandwidth=500.0)
    factors, q = np.geomspace(0.1, 300.0, 40), robot.middle()
    links = robot.mass_matrix(q) - np.diag(rotor)
    for i, (name, law) in enumerate(laws.items()):
        color, dashes = look(i)  # colours and dashes: to be told apart in grey too
        line = {"color": color, "linestyle": dashes, "label": name}
        left.semilogy(*largest_error(RigidBodyPlant(robot), law), **line)
        if i == 0:
            continue
        linear = two_mass.law(law, q)
        for side, marker in (("motor", ""), ("link", "o")):
            every = [two_mass.Gears(rotor, factor * stiffness, 0.03, 500.0, side) for factor in factors]
            modes = [rotors.lowest_mode(links, rotor, gears.stiffness) for gears in every]
            peaks = [two_mass.ArmLoop(robot, q, gears, DT, LATE).sensitivity(linear) for gears in every]
            words = f"for {'stiff' if i == 1 else 'elastic'} joints, encoders at the {side}s"
            middle.loglog(modes, peaks, **{**line, "label": words}, marker=marker, markersize=3, markevery=2)
        right.semilogy(*largest_error(elastic, law), **line)
    left.set(title="Arm with rotors, stiff joints", xlabel="time [s]", ylabel="largest error [rad]")
    middle.set(
        title="Peak sensitivity: a line ends where unstable",
        xlabel="lowest resonance [Hz]",
        ylabel="Ms (usual: 1.2 to 2)",
        ylim=(1.0, 20.0),
    )
    right.set(
        title="Arm with elastic joints",
        xlabel="time [s]",
        ylabel="largest error [rad]",
    )
    for axes in (left, middle):
        axes.legend(fontsize=7)
    for axes in (left, right):
        axes.set_ylim(1e-5, 10.0)
    path = Path(__file__).resolve().parent.parent / "docs" / "images" / "gears.png"
    figure.savefig(path, dpi=110)
    print(f"wrote {path}")


def main() -> None:
    """Print what is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=0, help="of the configurations and draws")
    which = parser.add_mutually_exclusive_group()
    for each in (structures, held_out, told, draws, rollouts, stops, picture):
        flag = "rotors" if each is draws else each.__name__.replace("_", "-")
        which.add_argument(f"--{flag}", dest="run", action="store_const", const=each, default=rule)
    given = parser.parse_args()
    given.run(given.seed)


if __name__ == "__main__":
    main()
