"""Compliant controllers on arms that nothing was tuned for: a push, a circle and a wall.

python benchmarks/compliance.py [--quick]
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import warnings
from typing import Any, NamedTuple

import _page
import numpy as np
from _timing import table
from tool import Place, _place

import armgpi
from armgpi.control.controller import ControlStep, FullState
from armgpi.control.impedance import rotation_between
from armgpi.robot.frame_motion import FrameMotion
from armgpi.robot.kinematics import random_configurations

ARMS = ("ur10", "xarm7")
DT = 1e-3
#: Arms with elastic joints, with what is locked.
ELASTIC = (
    ("ur3", ()),
    ("ur5", ()),
    ("ur10", ()),
    ("kinova", ()),
    ("xarm7", ()),
    ("panda", ("panda_finger_joint1", "panda_finger_joint2")),
)
#: Speed that counts as rest [rad/s].
REST = 0.05
#: Stiffness of all [N/m, N m/rad], push [N], wall [N/m], and how far the target is behind it [m].
STIFFNESS, TURNING, PUSH, WALL, BEHIND = 500.0, 30.0, 20.0, 1e4, 0.03
#: Coulomb friction as a share of the effort, of which no controller but one knows.
FRICTION = 0.03
#: Bandwidth of differenced velocities [rad/s].
DIFFERENCED = 250.0


class Spring(armgpi.Controller):
    """libfranka's example: -K e - D J v with D = 2 sqrt(K), and the model's torque but for D(q) a*."""

    measurement_type = FullState

    def __init__(self, robot: armgpi.Robot, dt: float) -> None:
        super().__init__(robot, dt)
        self.motion = FrameMotion(robot, robot.tip)

    def init(self, measurement: Any, target: Any) -> None:
        """Return no state."""

    def force(self, motion: Any, wished: Any) -> Any:
        """Return force and moment at the tool."""
        damping, turning = 2.0 * np.sqrt(STIFFNESS), 2.0 * np.sqrt(TURNING)
        force = -STIFFNESS * (motion.position - wished.position) - damping * motion.velocity
        moment = -TURNING * rotation_between(motion.rotation, wished.rotation) - turning * motion.rate
        return force, moment

    def step(self, measurement: Any, target: Any, state: Any) -> ControlStep:
        """Return torque and state."""
        q, v = measurement
        motion = self.motion.at(q, v)
        tau = self.robot.dynamics.nonlinear_effects(q, v) + motion.torque(
            q, *self.force(motion, self.motion.pose(target.q))
        )
        return ControlStep(self.limited(tau), None)


class JointPD(armgpi.Controller):
    """-Kp e - Kd (v - v*) + G(q), as under Pink: 20 rad/s with each joint's inertia."""

    measurement_type = FullState

    def __init__(self, robot: armgpi.Robot, dt: float) -> None:
        super().__init__(robot, dt)
        self.gain = 400.0 * np.diagonal(robot.mass_matrix(robot.middle())).copy()
        self.rate_gain = 2.0 * self.gain / 20.0

    def init(self, measurement: Any, target: Any) -> None:
        """Return no state."""

    def step(self, measurement: Any, target: Any, state: Any) -> ControlStep:
        """Return torque and state."""
        q, v = measurement
        tau = self.robot.dynamics.gravity(q) - self.gain * (q - target.q) - self.rate_gain * (v - target.v)
        return ControlStep(self.limited(tau), None)


class Way(NamedTuple):
    """A controller, and what it measures."""

    name: str
    make: Any
    velocity: str


def main() -> None:
    warnings.simplefilter("ignore", armgpi.ArmgpiWarning)
    page = _page.begin(
        __file__, "Compliance", "realistic: rotors, stiffness, friction and encoders of the tables"
    )
    names = ARMS[:1] if page.quick else ARMS
    places = [_place(name) for name in names]
    stiff = [STIFFNESS] * 3 + [TURNING] * 3
    ways = [
        Way(
            "CartesianImpedance",
            lambda r, k: armgpi.CartesianImpedance(r, DT, stiffness=stiff, delay=DT),
            "-",
        ),
        Way(
            "the same, friction 20 % too low fed forward",
            lambda r, k: armgpi.CartesianImpedance(
                k, DT, stiffness=stiff, delay=DT, friction_feedforward=True
            ),
            "-",
        ),
        Way("libfranka's example", lambda r, k: Spring(r, DT), "true"),
        Way("libfranka's example", lambda r, k: Spring(r, DT), "differenced"),
        Way("joint PD with gravity", lambda r, k: JointPD(r, DT), "true"),
        Way("joint PD with gravity", lambda r, k: JointPD(r, DT), "differenced"),
        Way("GPI.auto", lambda r, k: armgpi.GPI.auto(r, DT, delay=DT, bits=17, drives="stiff"), "-"),
        Way(
            "GPI.auto, friction 20 % too low, force_limit 10 N",
            lambda r, k: armgpi.GPI.auto(k, DT, delay=DT, bits=17, drives="stiff", force_limit=10.0),
            "-",
        ),
    ]
    _page.say(
        f"{' and '.join(names)} in this order, stiff joints, rotors as assumed, Coulomb friction of "
        f"{100 * FRICTION:g} % of the effort, 17 bits, one sample late. Springs of {STIFFNESS:g} N/m and "
        f"{TURNING:g} N m/rad. Push: {PUSH:g} N over the displacement. Circle: 240 mm in 3 s, largest error. "
        f"Wall of {WALL / 1e3:g} kN/m, the target {1e3 * BEHIND:g} mm behind it: force at the peak, and at "
        "the end. Torque step: largest change in 1 ms on the circle. Nothing knows the friction where it is "
        "not named."
    )
    rows = [[way.name, way.velocity, *_row(way, places)] for way in ways]
    heads = ["push without friction [N/m]", "circle [mm]", "wall [N]", "torque step [N m]"]
    print(table(["controller", "velocity", *heads], rows))
    _page.say(
        f"On elastic joints without friction, a spring of {STIFFNESS:g} N/m after a push of 10 N along each "
        "axis and 1 N m about each, four configurations of each arm, encoders at motor and link, 1 and 5 % "
        "of damping of the joints, neither known to the controller. At rest: slower than "
        f"{REST:g} rad/s 2.3 s after the push."
    )
    rows = [_elastic(*each) for each in (ELASTIC[:1] if page.quick else ELASTIC)]
    print(table(["arm", "filter [rad/s]", "at rest again", "largest speed then [rad/s]"], rows))
    page.write()


def _elastic(name: str, locked: tuple[str, ...]) -> list[str]:
    """Return the row of an arm with elastic joints."""
    robot = armgpi.assume_drives(armgpi.Robot.load(name, lock=locked))
    law = armgpi.CartesianImpedance(robot, DT, stiffness=[STIFFNESS] * 3 + [TURNING] * 3, delay=DT)
    known = random_configurations(robot, 200, seed=5)
    agility = np.linalg.svd(robot.frame_jacobian(robot.tip, known), compute_uv=False)[:, -1]
    q = known[np.argsort(-agility)[[0, 5, 20, 60]]]
    gear, rotor = robot.drives.value("stiffness"), robot.armature
    own = np.median(np.diagonal(robot.mass_matrix(q), axis1=1, axis2=2), axis=0)
    link = np.maximum(own - rotor, 0.05 * own)
    push = armgpi.ToolForce([10.0, 10.0, 10.0], [1.0, 1.0, 1.0], onset=0.05, end=0.15)
    speeds: list[float] = []
    for side in ("motor", "link"):
        for ratio in (0.05, 0.01):
            damping = 2.0 * ratio * np.sqrt(gear * rotor * link / (rotor + link))
            elastic = armgpi.ElasticPlant(
                robot, gear_stiffness=gear, gear_damping=damping, encoder_side=side, environment=[push]
            )
            plant = armgpi.Delayed(armgpi.Encoder(elastic, 18), 1)
            rollout = armgpi.simulate(plant, law, armgpi.Hold(q), 2.5, q0=q, backend="compiled")
            speeds += np.abs(rollout["v"].values[:, -50:]).max(axis=(1, 2)).tolist()
    calm = sum(speed < REST for speed in speeds)
    return [name, f"{law.velocity_filter:g}", f"{calm} of {len(speeds)}", f"{max(speeds):.2g}"]


def _row(way: Way, places: list[Place]) -> list[str]:
    """Return what a controller does on all arms, as text."""
    found = [_measure(way, place) for place in places]
    return [", ".join(column) for column in zip(*found, strict=True)]


def _measure(way: Way, place: Place) -> tuple[str, ...]:
    """Return the numbers of a controller on an arm."""
    robot, q = place.robot, place.q
    level = armgpi.Friction(0.02 * robot.limits.effort, FRICTION * robot.limits.effort)
    law = way.make(robot, robot.with_friction(level.viscous, 0.8 * level.coulomb))
    # The push is measured without friction, whose dead band is some N.
    push = armgpi.ToolForce(force=[0.0, PUSH, 0.0], onset=0.1)
    pushed = _run(way, robot, law, armgpi.Hold(q), 2.5, None, push)
    tool = pushed["tool"].values
    moved = float(tool[-1, 1] - tool[0, 1])
    circle = _run(way, robot, law, place.circle, 3.3, level, None, place.circle.at(0.0).q)
    normal = np.array([0.0, 0.0, 1.0])
    behind = place.position - 2.0 * BEHIND * normal
    goal = armgpi.inverse_kinematics(robot, robot.tip, behind, place.rotation, near=q).q
    distance = float(place.position[2]) - BEHIND
    wall = armgpi.Wall(normal=normal, distance=distance, stiffness=WALL, damping=2.0)
    pressed = _run(way, robot, law, armgpi.Bezier(q, goal, 1.5), 3.0, level, wall)
    force = np.linalg.norm(pressed["contact_force"].values[:, 0], axis=-1)
    step = float(np.abs(np.diff(circle["tau"].values[5:], axis=0)).max())
    return (
        f"{PUSH / moved:.0f}" if abs(moved) > 1e-3 else "stiff",
        f"{float(armgpi.metrics.tool_error(circle)[0]):.3g}",
        f"{force.max():.0f} then {force[-300:].mean():.0f}",
        f"{step:.2g}",
    )


def _run(
    way: Way, robot: Any, law: Any, move: Any, seconds: float, friction: Any, contact: Any, q0: Any = None
) -> Any:
    """Simulate an arm with encoders, one sample late."""
    touched = () if contact is None else (contact,)
    plant: Any = armgpi.Encoder(armgpi.RigidBodyPlant(robot, (), friction, environment=touched), 17)
    if way.velocity == "true":
        plant = armgpi.RigidBodyPlant(robot, (), friction, environment=touched)
    elif way.velocity == "differenced":
        plant = armgpi.Differentiated(plant, bandwidth=DIFFERENCED)
    return armgpi.simulate(armgpi.Delayed(plant, 1), law, move, seconds, q0=q0, backend="compiled")


if __name__ == "__main__":
    main()
