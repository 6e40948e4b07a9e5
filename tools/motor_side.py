"""How the automatic controllers for encoders at the motor and for an unknown side compare, arm by arm.

    python tools/motor_side.py [--seed 55] [ARM ...]
    python tools/motor_side.py --torque-step [ARM ...]
    python tools/motor_side.py --late [ARM ...]
    python tools/motor_side.py --filters [ARM ...]
    python tools/motor_side.py --others [ARM ...]
    python tools/motor_side.py --bandwidths [ARM ...]

Stability is that of the sampled linear loop (eigenvalues) at configurations that no rule looks at: with the
assumed stiffness times 0.5, 1 and 2, at damping ratios of 5 and 1 %, and in the corners with the true rotors
0.4 to 1.6 times the assumed ones. The push is a step of 10 % of the largest gravity torque on each joint, on
``ElasticPlant`` with 16-bit encoders at the motors: the largest error of a link. ITAE and torque variation
are those of a move of 0.5 rad in 2 s with 0.5 kg that the controller does not know, means over the stiffness
times 0.5, 1 and 2.

With ``--others``: the first table for light arms, one of 80 kg (a UR10 whose masses and efforts are scaled)
and a SCARA with a slide, at 1 and 8 ms, one sample late.

With ``--filters``: the first table with lower and higher filters of the derivative than the rule's.

With ``--late``: loops at 1 to 4 ms that are one to three samples late, by the damping ratio of the joints:
which controller is taken, how fast its slowest joint is, and how many linear loops are stable.

With ``--bandwidths``: the controller for an unknown side at 1, 2 and 4 ms, one sample late, as it is and
with a roll-off at eight times the bandwidth: how fast its slowest joint is, how far a push moves a link, and
with the same bandwidth in all joints the lowest one at which a loop of the assumed rotors is unstable, at 1 %
of damping and with the stiffness times 0.5, 1 and 2, by the side of the encoders, with the frequency of the
mode.

With ``--torque-step``: the largest change of torque in a sample that the controllers ask for, of all joints,
and what is left where a supervisor limits it to 1 N m per ms, as libfranka does. The robot carries its own
weight, as those that libfranka controls do. Largest and final errors are those of the links.
"""

from __future__ import annotations

import argparse
import itertools
import math
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from first_rule import worst_mode

import armgpi
from armgpi.control.pid_positions import PIDPositions
from armgpi.health.zoo import fingers
from armgpi.loop import metrics
from armgpi.robot.kinematics import random_configurations
from armgpi.tuning import collocated, rule, two_mass

ARMS = ("panda", "ur5", "ur10", "ur3", "kinova", "xarm7", "z1")
#: Arms of ``--others``: three below 4 kg, one of 80 kg, and one with a slide.
OTHERS = ("so101", "romeo_left_arm", "g1_left_arm", "ur10_80kg", "scara")
OTHER_LOOPS = ((1e-3, 1), (8e-3, 1))
#: Mass of what moves of the heavy arm [kg].
HEAVY = 80.0
LOCKED = {"panda": ["panda_finger_joint1", "panda_finger_joint2"], "z1": ["jointGripper"]}
STIFFNESS = (0.5, 1.0, 2.0)
DAMPING = (0.05, 0.01)
ROTORS = (0.4, 1.0, 1.6)
#: Sample time [s] and samples of delay.
LOOPS = ((1e-3, 1), (2e-3, 1), (1e-3, 3))
BITS = 16
PAYLOAD = 0.5  # [kg]
#: The payload of a light arm, as a share of the mass of what moves.
LIGHTEST_SHARE = 0.15
#: Highest filter frequencies that are tried [rad/s]; the rule has 1000.
FILTERS = (250.0, 500.0, 1000.0, 2000.0)
#: Loops that are late: sample time [s] and samples.
LATE_LOOPS = ((1e-3, 2), (1e-3, 3), (2e-3, 1), (2e-3, 2), (2e-3, 3), (4e-3, 1), (4e-3, 2), (4e-3, 3))
#: Of the bandwidths: sample times [s], a sample late, roll-offs over the bandwidth [-], and the bandwidths
#: that are tried in all joints [rad/s].
BANDWIDTH_TIMES = (1e-3, 2e-3, 4e-3)
ROLLOFF_RATIOS = (None, 8.0)
BANDWIDTHS = (4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0, 15.0, 20.0, 25.0, 30.0)
#: Of the torque's step: bits of the encoders, gear ratios, and the rate that libfranka takes [N m/s].
STEP_BITS = (16, 18, 20)
GEAR_RATIOS = (30, 100, 160)
TORQUE_RATE = 1000.0
#: Starts beside the reference [rad]; torque pulses of 50 ms, as shares of the torque limit.
OFFSETS = (0.01, 0.03, 0.1, 0.19)
PULSES = (0.1, 0.5)


def scara() -> str:
    """Return the URDF of a SCARA: two vertical axes, a slide that carries its weight, and a wrist."""
    # Mass [kg], length or height [m], effort [N m or N], velocity [rad/s or m/s] of each joint.
    rows = (
        ("shoulder", "revolute", 8.0, 0.35, 200.0, 4.0),
        ("elbow", "revolute", 6.0, 0.30, 100.0, 6.0),
        ("slide", "prismatic", 1.5, 0.0, 120.0, 1.0),
        ("wrist", "revolute", 0.4, 0.0, 10.0, 15.0),
    )
    links, joints, reach = ['<link name="base"/>'], [], 0.0
    parent = "base"
    for name, kind, mass, length, effort, velocity in rows:
        tensor = mass * max(length, 0.08) ** 2 / 12.0
        links.append(
            f'<link name="{name}_link"><inertial><origin xyz="{0.5 * length} 0 0"/><mass value="{mass}"/>'
            f'<inertia ixx="{0.3 * tensor}" iyy="{tensor}" izz="{tensor}" ixy="0" ixz="0" iyz="0"/>'
            "</inertial></link>"
        )
        lower, upper = (-0.15, 0.15) if kind == "prismatic" else (-2.5, 2.5)
        joints.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{name}_link"/>'
            f'<origin xyz="{reach} 0 0"/><axis xyz="0 0 1"/>'
            f'<limit lower="{lower}" upper="{upper}" effort="{effort}" velocity="{velocity}"/></joint>'
        )
        parent, reach = f"{name}_link", length
    return '<robot name="scara">' + "".join((*links, *joints)) + "</robot>"


def bare(name: str) -> armgpi.Robot:
    """Return an arm as its URDF has it."""
    if name == "scara":
        return armgpi.Robot.from_xml(scara())
    if name == "ur10_80kg":
        robot = armgpi.Robot.load("ur10")
        factor = HEAVY / robot.moving_mass
        return robot.scaled_inertia(factor).with_limits(effort=factor * robot.limits.effort)
    known = armgpi.robots.names()
    lock = fingers(name) if name in OTHERS else LOCKED.get(name, [])
    return armgpi.Robot.load(name, lock=lock if name in known else [])


def load(name: str, side: str) -> armgpi.Robot:
    """Return an arm with assumed drives, its encoders where they are said to be."""
    robot = bare(name)
    robot = armgpi.assume_drives(robot)
    if side:
        robot = robot.with_drives({joint: {"encoder_side": side} for joint in robot.joint_names})
    return robot


def stable(
    robot: armgpi.Robot,
    law: Any,
    late: int,
    seed: int,
    rotors: tuple[float, ...],
    damping: tuple[float, ...] = DAMPING,
) -> tuple[int, int]:
    """Return how many of the loops are stable, and how many there are."""
    stiffness = robot.drives.value("stiffness")
    found = []
    places = random_configurations(robot, 6 if len(rotors) == 1 else 4, seed=seed)
    for q, factor, ratio, rotor in itertools.product(places, STIFFNESS, damping, rotors):
        gears = two_mass.Gears(
            rotor * robot.armature, factor * stiffness, ratio, two_mass.CURRENT_LOOP, "motor"
        )
        loop = two_mass.ArmLoop(robot, q, gears, law.dt, late)
        found.append(loop.growth(two_mass.law(law, q)) < 1.0)
    return sum(found), len(found)


def push(robot: armgpi.Robot, law: Any, late: int) -> float:
    """Return the largest error [rad] of a link after a step of 10 % of the largest gravity torque."""
    gravity = np.abs(robot.gravity(random_configurations(robot, 50, seed=0))).max(axis=0)
    plant: Any = armgpi.ElasticPlant(robot, armgpi.Step(0.1 * gravity, 0.5))
    plant = armgpi.Delayed(armgpi.Encoder(plant, BITS), late)
    rollout = armgpi.simulate(plant, law, armgpi.Hold(robot.middle()), 2.5, backend="auto")
    if int(rollout["status"]) != armgpi.Status.FINISHED:
        return math.inf
    q = rollout["q"].values
    before = q[round(0.45 / law.dt)]
    return float(np.abs(q[round(0.5 / law.dt) :] - before).max())


def move(robot: armgpi.Robot, law: Any, late: int) -> tuple[float, float]:
    """Return ITAE [rad s^2] and torque variation [N m], means over the stiffness."""
    reach = np.where(robot.prismatic, 0.1, 0.5)
    start = robot.middle()
    goal = np.clip(start + reach, robot.limits.lower, robot.limits.upper)
    rows = []
    for factor in STIFFNESS:
        arm = robot.with_payload(robot.tip, min(PAYLOAD, LIGHTEST_SHARE * robot.moving_mass))
        plant: Any = armgpi.ElasticPlant(arm, gear_stiffness=factor * robot.drives.value("stiffness"))
        plant = armgpi.Delayed(armgpi.Encoder(plant, BITS), late)
        rollout = armgpi.simulate(plant, law, armgpi.Bezier(start, goal, 2.0), 4.0, backend="auto")
        found = metrics.summary(rollout)
        rows.append([float(found["itae"].sum()), float(found["total_variation"].sum())])
    itae, variation = np.mean(rows, axis=0)
    return float(itae), float(variation)


def late_loops(name: str, seed: int) -> None:
    """Print what becomes of an arm's loops that are late."""
    arm = load(name, "motor")
    for dt, late in LATE_LOOPS:
        law = armgpi.GPI.auto(arm, dt, delay=late * dt, bits=BITS)
        kind = "motor" if law.link_factor != 1.0 else "side unknown"
        slowest = float(np.min(law.gains.nominal().omega_c))
        cells = []
        for rotors, damping in itertools.product(((1.0,), ROTORS), DAMPING):
            cells.append("{} of {}".format(*stable(arm, law, late, seed, rotors, (damping,))))
        total = 1e3 * collocated.delay_of(dt, late)
        said = f"| {name} | {1e3 * dt:g} ms, {late} late | {total:.3g} | {kind} | {slowest:.3g} | "
        print(said + " | ".join(cells) + " |", flush=True)


def filters(name: str, seed: int) -> None:
    """Print what an arm's controller comes to with other filters."""
    arm, (dt, late) = load(name, "motor"), LOOPS[0]
    chosen = collocated.HIGHEST_FILTER
    for highest in FILTERS:
        vars(collocated)["HIGHEST_FILTER"] = highest
        law = armgpi.GPI.auto(arm, dt, delay=late * dt, bits=BITS)
        held = "{} of {}".format(*stable(arm, law, late, seed, ROTORS))
        itae, variation = move(arm, law, late)
        peak, slowest = 1e3 * push(arm, law, late), float(np.min(law.gains.nominal().omega_c))
        said = (
            f"| {name} | {highest:g} | {slowest:.3g} | {held} | {peak:.3g} | {itae:.3g} | {variation:.4g} |"
        )
        print(said, flush=True)
    vars(collocated)["HIGHEST_FILTER"] = chosen


def first_unstable(robot: armgpi.Robot, dt: float, values: dict[str, Any], side: str, seed: int) -> str:
    """Return the lowest of some bandwidths at which a loop is unstable [rad/s], and the mode there [Hz].

    Args:
        robot: the arm with assumed drives.
        dt: sample time [s]; measurements are one sample late.
        values: what the rule chose for it; the bandwidth is replaced.
        side: where the encoders sit.
        seed: of the configurations.
    """
    stiffness = robot.drives.value("stiffness")
    places = random_configurations(robot, 4, seed=seed)
    structure = {name: value for name, value in values.items() if name not in ("omega_c", "zeta_c")}
    for omega in BANDWIDTHS:
        gains = armgpi.FixedGains(omega * np.ones(robot.n), values.get("zeta_c", 1.0))
        law = armgpi.GPI(robot, dt, delay=dt, gains=gains, bias_robot=robot, **structure)
        for q, factor in itertools.product(places, STIFFNESS):
            gears = two_mass.Gears(
                robot.armature, factor * stiffness, DAMPING[-1], two_mass.CURRENT_LOOP, side
            )
            plant = two_mass.plant(robot, q, gears, dt)
            mode = worst_mode(plant, two_mass.law(law, q), 1, dt)
            if not mode.decay > 0.0:
                return f"{omega:g}, {mode.frequency:.0f} Hz"
    return f"none to {BANDWIDTHS[-1]:g}"


def bandwidths(name: str, seed: int) -> None:
    """Print how fast an arm's controller for an unknown side may be, with and without a roll-off."""
    robot = load(name, "")
    for dt, ratio in itertools.product(BANDWIDTH_TIMES, ROLLOFF_RATIOS):
        given = {} if ratio is None else {"rolloff": 1, "rolloff_ratio": ratio}
        law = armgpi.GPI.auto(robot, dt, delay=dt, bits=BITS, **given)
        values = {**rule.apply_rule(robot, dt, dt, BITS, given).values, **given}
        cells = [f"{float(np.min(law.gains.nominal().omega_c)):.3g}", f"{1e3 * push(robot, law, 1):.3g}"]
        cells += [first_unstable(robot, dt, values, side, seed) for side in ("motor", "link")]
        shape = "none" if ratio is None else f"{ratio:g}"
        print(f"| {name} | {1e3 * dt:g} ms | {shape} | " + " | ".join(cells) + " |", flush=True)


class Motion(NamedTuple):
    """What an arm is to do: its reference, loads, and how far from the reference it starts [rad]."""

    name: str
    reference: Any
    loads: Any = ()
    offset: float = 0.0


def motions(robot: armgpi.Robot, gravity: Any) -> list[Motion]:
    """Return the motions over which torques are looked at."""
    middle = robot.middle()
    hold = armgpi.Hold(middle)
    goal = np.clip(middle + 0.5, robot.limits.lower, robot.limits.upper)
    found = [
        Motion("rest", hold),
        Motion("move of 0.5 rad in 2 s", armgpi.Bezier(middle, goal, 2.0)),
        Motion("push of 10 % of gravity", hold, armgpi.Step(0.1 * gravity, 0.5)),
    ]
    for share in PULSES:
        pulse = armgpi.Pulse(-share * robot.limits.effort, onset=0.5, duration=0.05)
        found.append(Motion(f"pulse of {share:.0%} of the limits, 50 ms".replace("%", " %"), hold, pulse))
    found += [Motion(f"start {1e3 * offset:g} mrad beside", hold, offset=offset) for offset in OFFSETS]
    return found


def torque_steps(name: str, dt: float, late: int) -> None:
    """Print the largest steps of torque of an arm under both controllers."""
    gravity = load(name, "")
    heaviest = np.abs(gravity.gravity(random_configurations(gravity, 50, seed=0))).max(axis=0)
    supervisor = armgpi.Supervisor(torque_rate=TORQUE_RATE)
    for side, motion in itertools.product(("", "motor"), motions(gravity, heaviest)):
        rows: dict[bool, list[tuple[float, float, float]]] = {False: [], True: []}
        for bits, ratio in itertools.product(STEP_BITS, GEAR_RATIOS):
            robot = load(name, side).with_gravity((0.0, 0.0, 0.0))
            robot = robot.with_drives({joint: {"gear_ratio": ratio} for joint in robot.joint_names})
            law = armgpi.GPI.auto(robot, dt, delay=late * dt, bits=bits, start="rest")
            for factor, limited in itertools.product(STIFFNESS, rows):
                plant: Any = armgpi.ElasticPlant(
                    robot, motion.loads, gear_stiffness=factor * robot.drives.value("stiffness")
                )
                plant = armgpi.Delayed(armgpi.Encoder(armgpi.Saturated(plant), bits), late)
                start = robot.middle() - motion.offset
                under = {"q0": start, "supervisor": supervisor if limited else None, "backend": "auto"}
                rollout = armgpi.simulate(plant, law, motion.reference, 2.5, **under)
                rows[limited].append(step_and_errors(rollout))
        asked, (left, worst, final) = np.max(rows[False], axis=0), np.max(rows[True], axis=0)
        said = f"| {name} | {1e3 * dt:g} ms, {late} late | {side or 'side unknown'} | {motion.name} | "
        said += (
            f"{asked[0]:.2g} | {left:.3g} | {1e3 * asked[1]:.3g} | {1e3 * worst:.3g} | {1e3 * final:.2g} |"
        )
        print(said, flush=True)


def step_and_errors(rollout: Any) -> tuple[float, float, float]:
    """Return the largest step of torque [N m], largest and final error [rad]; infinite where it failed."""
    if int(rollout["status"]) != armgpi.Status.FINISHED:
        return math.inf, math.inf, math.inf
    error = np.abs(rollout["q"].values - rollout["q_ref"].values)
    step = np.abs(np.diff(rollout["tau_command"].values, axis=0)).max()
    return float(step), float(error.max()), float(error[-1].max())


def options() -> argparse.Namespace:
    """Return what is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("arms", nargs="*")
    parser.add_argument("--seed", type=int, default=55)
    parser.add_argument("--filters", action="store_true", help="other filters of the derivative")
    parser.add_argument(
        "--others", action="store_true", help="light arms, a heavy one and a SCARA; 1 and 8 ms"
    )
    parser.add_argument("--late", action="store_true", help="late loops instead")
    parser.add_argument("--bandwidths", action="store_true", help="the controller for an unknown side")
    parser.add_argument("--torque-step", action="store_true", help="steps of torque instead")
    wished = parser.parse_args()
    wished.arms = wished.arms or (OTHERS if wished.others else ARMS)
    return wished


#: Heads of the tables of one kind of loop each, and what prints the rows of an arm.
TABLES: dict[str, tuple[tuple[str, ...], Callable[[str, int], None]]] = {
    "filters": (
        (
            "arm",
            "f [rad/s]",
            "slowest omega [rad/s]",
            "rotors x 0.4-1.6",
            "push [mrad]",
            "ITAE",
            "variation",
        ),
        filters,
    ),
    "late": (
        (
            "arm",
            "loop",
            "T [ms]",
            "controller",
            "slowest omega [rad/s]",
            "5 %",
            "1 %",
            "rotors, 5 %",
            "rotors, 1 %",
        ),
        late_loops,
    ),
    "bandwidths": (
        (
            "arm",
            "loop",
            "roll-off",
            "slowest omega [rad/s]",
            "push [mrad]",
            "unstable from, motor",
            "unstable from, link",
        ),
        bandwidths,
    ),
}


def main() -> None:
    """Print the table."""
    wished = options()
    warnings.simplefilter("ignore")
    for kind, (heads, rows) in TABLES.items():
        if getattr(wished, kind):
            print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
            for name in wished.arms:
                rows(name, wished.seed)
            return
    if wished.torque_step:
        print("| arm | loop | controller | motion | asked | limited | error | error, limited | final |")
        print("|---|---|---|---|---|---|---|---|---|")
        for name, (dt, late) in itertools.product(wished.arms, ((1e-3, 0), (1e-3, 1))):
            torque_steps(name, dt, late)
        return
    print("| arm | loop | controller | stable | rotors x 0.4-1.6 | push [mrad] | ITAE | variation [N m] |")
    print("|---|---|---|---|---|---|---|---|")
    for name, (dt, late) in itertools.product(wished.arms, OTHER_LOOPS if wished.others else LOOPS):
        arm = load(name, "motor")
        laws: dict[str, Any] = {
            "side unknown": armgpi.GPI.auto(load(name, ""), dt, delay=late * dt, bits=BITS),
            "motor": armgpi.GPI.auto(arm, dt, delay=late * dt, bits=BITS),
            "PID of positions": PIDPositions(arm, dt),
        }
        for kind, law in laws.items():
            linear = ["-", "-"]
            if isinstance(law, armgpi.GPI):
                linear = [
                    "{} of {}".format(*stable(arm, law, late, wished.seed, each)) for each in ((1.0,), ROTORS)
                ]
            peak = 1e3 * push(arm, law, late)
            itae, variation = move(arm, law, late)
            print(
                f"| {name} | {1e3 * dt:g} ms, {late} late | {kind} | {linear[0]} | {linear[1]} | {peak:.3g} "
                f"| {itae:.3g} | {variation:.4g} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
