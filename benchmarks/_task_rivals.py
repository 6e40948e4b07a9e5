"""Rivals in task space, tuned alike: libfranka's example, operational space, a joint PD under Pink."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from functools import partial
from importlib.util import find_spec
from typing import Any, ClassVar, NamedTuple

import _page
import numpy as np
import pinocchio as pin
from _compliant import DT, Surface, loop, place, tool_of
from _springs import TURNING, stiffness_of
from _timing import table

import armgpi
from armgpi.base.arrays import Array
from armgpi.base.parameter import parameter, with_parameters
from armgpi.control.controller import ControlStep, FullState
from armgpi.control.impedance import rotation_between
from armgpi.errors import ParameterError
from armgpi.robot.equations import add_smooth_friction
from armgpi.robot.frame_motion import FrameMotion

#: The arm that all are tuned on, and those on which they are judged, which nothing here was tuned on.
TUNED, JUDGED = "ur5", ("xarm7", "ur10")
#: Friction of the arm as a share of the effort, the share of it that all know, and its smoothing [rad/s].
FRICTION, KNOWN, SMOOTH = 0.03, 0.8, 0.05
#: Wall [N/m], how deep the target is behind it [m], and the run [s].
WALL, BEHIND, LENGTH = 1e4, 0.03, 2.6
#: What a choice may press with at the end [N], and step [N m per ms].
FORCE, STEP = 30.0, 2.0
#: Damping of J D^-1 J', lengths in those of the arm, and of what the tool does not see [1/s].
_SINGULAR, _POSTURE = 1e-4, 5.0
#: Steps of Pink's inverse kinematics [s].
PINK_STEP = 0.01


@with_parameters
class Rival(armgpi.Controller):
    """What the rivals share: measured velocities, and friction fed forward at the reference.

    Attributes:
        gain: stiffness [N/m] or natural frequency [rad/s].
        ratio: damping ratio [-].
    """

    measurement_type: ClassVar[Any] = FullState
    gain: float = parameter("stiffness or natural frequency", default=10.0, least=0.0)
    ratio: float = parameter("damping ratio", default=1.0, least=0.0)

    def __post_init__(self) -> None:
        """Find the tool."""
        super().__post_init__()
        self._motion = FrameMotion(self.robot, self.robot.tip)
        self._viscous, self._coulomb = self.robot.friction
        self._own = np.diagonal(self.robot.mass_matrix(self.robot.middle())).copy()
        self._length = self._motion.reach(self.robot)

    def init(self, measurement: Any, target: Any) -> None:
        """Return no state."""

    def step(self, measurement: Any, target: Any, state: Any) -> ControlStep:
        """Return torque and state."""
        q, v = measurement
        wanted = type(target)(*(part + np.zeros_like(q) for part in target))
        tau = self.torque(q, v, wanted)
        tau = add_smooth_friction(tau, wanted.v, self._viscous, self._coulomb, SMOOTH)
        return ControlStep(self.limited(tau), None)

    def torque(self, q: Array, v: Array, target: Any) -> Array:
        """Return the torque [N m] but for friction."""
        raise NotImplementedError


class Libfranka(Rival):
    """libfranka's cartesian_impedance_control: -K e - D J v with D = 2 sqrt(K), and Coriolis torque."""

    config_name: ClassVar[str | None] = None

    def torque(self, q: Array, v: Array, target: Any) -> Array:
        """Return the torque [N m] but for friction."""
        motion, wished = self._motion.at(q, v), self._motion.pose(target.q)
        linear, angular = self.gain, TURNING * self.gain
        force = (
            -linear * (motion.position - wished.position)
            - 2.0 * self.ratio * np.sqrt(linear) * motion.velocity
        )
        turned = rotation_between(motion.rotation, wished.rotation)
        moment = -angular * turned - 2.0 * self.ratio * np.sqrt(angular) * motion.rate
        tau: Array = self.robot.dynamics.nonlinear_effects(q, v) + motion.torque(q, force, moment)
        return tau


class OperationalSpace(Rival):
    """Khatib's: J' L (a* - 2 z w (x' - x*') - w^2 (x - x*)), L = (J D^-1 J')^-1; joints damped beside."""

    config_name: ClassVar[str | None] = None

    def torque(self, q: Array, v: Array, target: Any) -> Array:
        """Return the torque [N m] but for friction."""
        dynamics = self.robot.dynamics
        motion, wished = self._motion.at(q, v), self._motion.at(target.q, target.v)
        ahead = np.concatenate([wished.velocity - motion.velocity, wished.rate - motion.rate], axis=-1)
        offset = np.concatenate(
            [
                wished.position - motion.position,
                -rotation_between(motion.rotation, wished.rotation),
            ],
            axis=-1,
        )
        # The twist's derivative along the reference, with its Coriolis part left out: J a*.
        along = self._motion.at(target.q, target.a)
        wanted = np.concatenate([along.velocity, along.rate], axis=-1)
        wanted = wanted + 2.0 * self.ratio * self.gain * ahead + self.gain * self.gain * offset
        scale = np.array([1.0 / self._length] * 3 + [1.0] * 3)
        jacobian = motion.damped_jacobian(self._length)
        columns = [dynamics.inertia_solve(q, jacobian.transposed[..., i] + 0.0 * q) for i in range(6)]
        mobility = np.matmul(jacobian.matrix, np.stack(columns, axis=-1)) + _SINGULAR * np.eye(6)
        still = -_POSTURE * v
        seen = np.matmul(jacobian.matrix, still[..., None])[..., 0]
        wrench = np.linalg.solve(mobility, (scale * wanted - seen)[..., None])
        tau = np.matmul(jacobian.transposed, wrench)[..., 0] + dynamics.inertia_times(q, still)
        whole: Array = tau + dynamics.nonlinear_effects(q, v)
        return whole


class JointPD(Rival):
    """-Kp (q - q*) - Kd (v - v*) with each joint's inertia, and C and G at the reference.

    What Pink plans sample by sample has steps in its acceleration, so D(q) a* is left out.
    """

    config_name: ClassVar[str | None] = None

    def torque(self, q: Array, v: Array, target: Any) -> Array:
        """Return the torque [N m] but for friction."""
        known = self.robot.dynamics.inverse(target.q, target.v, 0.0 * target.a)
        pulled = self.gain * self.gain * (q - target.q) + 2.0 * self.ratio * self.gain * (v - target.v)
        tau: Array = known - self._own * pulled
        return tau


class Way(NamedTuple):
    """A controller, what is chosen of it, and what it measures.

    Attributes:
        name: in the table.
        make: from the arm as it is known and a structural choice to a controller.
        structures: those choices, each tuned in a batch of its own.
        candidates: parameter of the loop -> values that are tried, all combinations.
        velocity: "true", "differenced" or None.
        pink: whether Pink plans the circle.
    """

    name: str
    make: Any
    structures: tuple[Any, ...]
    candidates: Mapping[str, tuple[float, ...]]
    velocity: str | None
    pink: bool = False


class Choice(NamedTuple):
    """What was chosen: a structure and the numbers of the loop; and what it came to."""

    structure: Any
    numbers: dict[str, float]
    circle: float
    end: float
    peak: float
    step: float


_RATIOS = {"controller.ratio": (0.5, 0.7, 1.0, 1.4)}
_SPRINGS = {"controller.gain": (300.0, 600.0, 1200.0, 2400.0, 4800.0, 9600.0), **_RATIOS}
_PULLS = {"controller.gain": (5.0, 8.0, 12.0, 18.0, 27.0, 40.0), **_RATIOS}
_OURS = {
    "controller.force_limit": (10.0, 20.0, 30.0),
    "controller.friction_smoothing": (0.02, 0.05, 0.1, 0.2),
}


def _spring(known: armgpi.Robot, linear: float) -> Any:
    """Return our spring."""
    return armgpi.CartesianImpedance(
        known, DT, stiffness=stiffness_of(linear), delay=DT, friction_feedforward=True, force_limit=20.0
    )


def _limited(known: armgpi.Robot, limit: float) -> Any:
    """Return our controller with integrators under a force limit."""
    return armgpi.GPI.auto(known, DT, delay=DT, bits=17, drives="stiff", force_limit=limit)


def _rival(kind: Any, known: armgpi.Robot, _: Any) -> Any:
    """Return a rival."""
    return kind(known, DT)


def ways() -> list[Way]:
    """Return all controllers."""
    found = [
        Way("CartesianImpedance", _spring, (1000.0, 3000.0), _OURS, None),
        Way("GPI.auto, force_limit", _limited, (10.0, 20.0), {}, None),
    ]
    kinds = [
        ("libfranka's example", Libfranka, _SPRINGS, False),
        ("operational space", OperationalSpace, _PULLS, False),
    ]
    under = "joint PD under Pink" if find_spec("pink") else "joint PD under differential kinematics"
    kinds.append((under, JointPD, _PULLS, find_spec("pink") is not None))
    for name, kind, candidates, pink in kinds:
        make = partial(_rival, kind)
        found += [Way(name, make, (None,), candidates, how, pink) for how in ("true", "differenced")]
    return found


def rivals(quick: bool, only: tuple[int, ...] = ()) -> None:
    """Print the table of rivals."""
    judged = JUDGED[:1] if quick else JUDGED
    _page.say(
        f"Each was tuned on {TUNED}: of at most 24 combinations of its numbers the one with the least "
        f"error on the circle of 240 mm in 3 s that ends with at most {FORCE:g} N at a wall of "
        f"{WALL / 1e3:g} kN/m, target {1e3 * BEHIND:g} mm behind it, and steps the torque by at most "
        f"{STEP:g} N m in 1 ms (the least of these where none does). "
        f"Judged on {' and '.join(judged)}, in this order. Stiff joints, Coulomb friction of "
        f"{100 * FRICTION:g} % of the effort, fed forward by all, known {100 * (1 - KNOWN):.0f} % too low, "
        "17 bits, one sample late. Velocities are true ones, or differenced with 250 rad/s."
    )
    rows = []
    for i, way in enumerate(ways()):
        if not only or i in only:
            rows.append(_row(way, judged))
    heads = [
        "controller",
        "velocity",
        "chosen",
        "circle [mm]",
        "wall, peak then end [N]",
        "torque step [N m]",
    ]
    print(table(heads, rows))


def _row(way: Way, judged: tuple[str, ...]) -> list[str]:
    """Return the row of a controller."""
    found = [each for structure in way.structures for each in _tried(way, TUNED, structure, way.candidates)]

    def worth(each: Choice) -> tuple[bool, float]:
        kept = each.end <= FORCE and each.step <= STEP and np.isfinite(each.circle)
        return not kept, each.circle if kept else each.end / FORCE + each.step / STEP

    best = min(found, key=worth)
    alone = {name: (value,) for name, value in best.numbers.items()}
    seen = [_tried(way, name, best.structure, alone)[0] for name in judged]
    numbers = [f"{name.rpartition('.')[2]} {value:g}" for name, value in best.numbers.items()]
    if best.structure is not None:
        numbers.insert(0, f"{best.structure:g} {'N/m' if way.make is _spring else 'N'}")
    return [
        way.name,
        way.velocity or "-",
        ", ".join(numbers) + (" (none kept both)" if worth(best)[0] else ""),
        ", ".join(f"{each.circle:.3g}" for each in seen),
        ", ".join(f"{each.peak:.0f} then {each.end:.0f}" for each in seen),
        ", ".join(f"{each.step:.2g}" for each in seen),
    ]


def _tried(way: Way, name: str, structure: Any, candidates: Mapping[str, tuple[float, ...]]) -> list[Choice]:
    """Return what all combinations of numbers come to on an arm."""
    where = place(name)
    robot = where.robot
    known = robot.with_friction(0.02 * robot.limits.effort, KNOWN * FRICTION * robot.limits.effort)
    try:
        law = way.make(known, structure)
    except ParameterError:
        return []
    combinations = list(itertools.product(*candidates.values())) or [()]
    given = {
        key: np.array(column) for key, column in zip(candidates, zip(*combinations, strict=True), strict=True)
    }
    count = len(combinations)
    given["plant.coulomb"] = np.tile(FRICTION * robot.limits.effort, (count, 1))
    given["plant.viscous"] = np.tile(0.02 * robot.limits.effort, (count, 1))
    record = ("q", "q_ref", "tau")
    move = _planned(where) if way.pink else where.circle
    start = np.tile(where.circle.at(0.0).q, (count, 1))
    made = loop(robot, law, move, 3.3, [Surface()], 1, velocity=way.velocity, record=record)
    circle = made.run(given, q0=start)
    path = tool_of(robot, circle).position
    meant = robot.frame_pose(robot.tip, where.circle.at(circle["time"].values).q).translation
    errors = 1e3 * np.linalg.norm(path - meant, axis=-1).max(axis=1)
    steps = np.abs(np.diff(circle["tau"].values[:, 5:-1], axis=1)).max(axis=(1, 2))
    normal = np.array([0.0, 0.0, 1.0])
    behind = where.position - 2.0 * BEHIND * normal
    goal = armgpi.inverse_kinematics(robot, robot.tip, behind, where.rotation, near=where.q).q
    distance = float(where.position[2]) - BEHIND
    surface = Surface(distance=distance, stiffness=WALL, damping=20.0)
    press = armgpi.Bezier(where.q, goal, 1.5)
    made = loop(robot, law, press, LENGTH, [surface], 2, velocity=way.velocity, record=("q", "q_ref"))
    pressed = tool_of(robot, made.run(given, q0=np.tile(where.q, (count, 1)))).position
    force = WALL * np.maximum(distance - pressed[..., 2], 0.0)
    return [
        Choice(
            structure,
            dict(zip(candidates, combination, strict=True)),
            float(np.nan_to_num(errors[i], nan=np.inf)),
            float(np.nan_to_num(force[i, -150:].mean(), nan=np.inf)),
            float(np.nan_to_num(force[i].max(), nan=np.inf)),
            float(np.nan_to_num(steps[i], nan=np.inf)),
        )
        for i, combination in enumerate(combinations)
    ]


def _planned(where: Any) -> Any:
    """Return the circle as Pink plans it."""
    import pink
    from pink.tasks import FrameTask, PostureTask

    robot = where.robot
    start = where.circle.at(0.0).q
    model = robot.pinocchio_model()
    configuration = pink.Configuration(model, model.createData(), start)
    tool, posture = FrameTask(robot.tip, position_cost=1.0, orientation_cost=0.2), PostureTask(cost=1e-3)
    posture.set_target(start)
    times = np.arange(0.0, 4.0, PINK_STEP)  # it is at rest after the last one, at once
    path = [start]
    for t in times[1:]:
        meant = robot.frame_pose(robot.tip, where.circle.at(t).q)
        tool.set_target(pin.SE3(meant.rotation, meant.translation))
        velocity = pink.solve_ik(configuration, [tool, posture], PINK_STEP, solver="proxqp")
        configuration.integrate_inplace(velocity, PINK_STEP)
        path.append(configuration.q.copy())
    return armgpi.Recorded(times, np.array(path), source="Pink")
