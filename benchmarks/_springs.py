"""Springs: the stiffness that is obtained, beside true velocities, on elastic joints, and at 3,000 N/m."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import _page
import numpy as np
from _compliant import (
    ARMS,
    BITS,
    DT,
    ROTORS,
    SEEDS,
    Hand,
    directions,
    friction_at_tool,
    friction_of,
    loop,
    place,
    spread,
    tool_of,
)
from _timing import table

import armgpi
from armgpi.base.arrays import Array
from armgpi.control.controller import ControlStep, FullState
from armgpi.errors import ParameterError
from armgpi.robot.kinematics import random_configurations

#: Springs [N/m], rotational stiffness over them [m^2], a push [N], how far it moves the tool at most [m], and
#: the share of the torque that motors have beside gravity which it takes at most [-].
STIFFNESS, TURNING, PUSH, MOVED, SPARE = (300.0, 3000.0), 0.06, 25.0, 0.02, 0.7
#: Pushes of each arm, with friction half of them; when they begin and the run ends [s]: after 4 s a slow mode
#: of UR3 was still 3 % off.
PUSHES, ONSET, LENGTH = 16, 0.1, 9.0
#: Another filter of the velocity that is compared with the usual one [rad/s].
FASTER = 500.0
#: Coulomb friction of those with friction, a share of the effort.
FRICTION = 0.03
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
#: The stiff spring [N/m], its filters [rad/s] and smoothing of friction [rad/s], share of the friction known.
STIFF, FILTERS, SMOOTH, KNOWN = 3000.0, (60.0, 120.0, 250.0, 500.0), (0.01, 0.02, 0.05, 0.1, 0.2, 0.4), 0.8
#: The filter whose points have their smoothing written beside them in the picture [rad/s].
NAMED = 500.0
#: What a Panda's motors may step [N m per ms], and the circle that is wanted [mm].
STEP, CIRCLE = 1.0, 3.0
#: Where the picture of the two goes.
PICTURE = Path(__file__).resolve().parents[1] / "docs" / "images" / "stiff_spring.png"


class TrueVelocity(armgpi.CartesianImpedance):
    """The same controller with measured velocities in place of the filtered difference."""

    measurement_type: ClassVar[Any] = FullState
    config_name: ClassVar[str | None] = None

    def step(self, measurement: Any, target: Any, state: Any) -> ControlStep:
        """Return torque and next state."""
        q = measurement.q
        state = self._moved(q, target, state)._replace(rate=measurement.v - target.v)
        return ControlStep(self._torque(q, target, state), state)


def stiffness_of(linear: float) -> list[float]:
    """Return the six stiffnesses of a spring [N/m], [N m/rad]."""
    return [linear] * 3 + [TURNING * linear] * 3


class Pushed(NamedTuple):
    """Pushes against a spring, one number a push.

    Attributes:
        frees: stiffness obtained over that asked for, without friction.
        rubbed: the same with friction.
        held: how far friction keeps it from force over stiffness, over friction at the tool over stiffness.
        path: of the tool [m], (pushes, samples, 3).
    """

    frees: Array
    rubbed: Array
    held: Array
    path: Array


def springs(quick: bool) -> None:
    """Print the stiffness obtained."""
    _page.say(
        f"Springs of CartesianImpedance on stiff joints after a push of {PUSH:g} N "
        f"(less where that is more than {1e3 * MOVED:g} mm, or than {100 * SPARE:g} % of what motors can "
        f"hold beside gravity), {PUSHES // 2} directions without "
        f"friction and as many with Coulomb friction of {100 * FRICTION:g} % of the effort that is not "
        f"specified; rotors within {100 * ROTORS:g} %, {BITS[0]} to {BITS[1]} bits, one sample late. "
        "Stiffness: largest error of that obtained without "
        "friction; goal 3 %. Held: how far the tool is from force over stiffness, over friction at the tool "
        "over stiffness; goal 1. From true velocity: largest distance at any time from the run with true "
        "velocities, over the largest way; goal 2 % without friction, with the usual filter and with one of "
        f"{FASTER:g} rad/s. Median and worst."
    )
    rows = []
    faster = partial(armgpi.CartesianImpedance, velocity_filter=FASTER)
    for name in ARMS[:1] if quick else ARMS:
        for linear in STIFFNESS:
            own = _pushed(name, linear, armgpi.CartesianImpedance, None)
            true = _pushed(name, linear, TrueVelocity, "true")
            half = PUSHES // 2
            share = _apart(own, true)
            with_faster = _apart(_pushed(name, linear, faster, None), true)
            rows.append(
                [
                    name,
                    f"{linear:g}",
                    f"{100.0 * np.abs(own.frees - 1.0).max():.2g} %",
                    spread(own.held, ".2g"),
                    spread(share[:half], ".2g"),
                    spread(with_faster[:half], ".2g"),
                    spread(share[half:], ".2g"),
                ]
            )
    heads = ["arm", "spring [N/m]", "stiffness", "held", "from true velocity [%]"]
    print(table([*heads, f"at {FASTER:g} rad/s [%]", "with friction [%]"], rows))


def _apart(own: Pushed, true: Pushed) -> Array:
    """Return the largest distances of paths over the largest way of the second [%], (pushes,)."""
    apart = np.linalg.norm(own.path - true.path, axis=-1).max(axis=1)
    way = np.linalg.norm(true.path - true.path[:, :1], axis=-1).max(axis=1)
    return np.asarray(100.0 * apart / way)


def _most_held(robot: armgpi.Robot, q: Array) -> float:
    """Return the force in any direction that motors hold at the tool beside gravity [N]."""
    levers = np.linalg.norm(robot.frame_jacobian(robot.tip, q)[:3], axis=0)
    spare = robot.limits.effort - np.abs(robot.gravity(q))
    return float((spare / np.maximum(levers, 1e-9)).min())


def _pushed(name: str, linear: float, kind: Any, velocity: str | None) -> Pushed:
    """Return what pushes do to a spring."""
    where = place(name)
    robot = where.robot
    law = kind(robot, DT, stiffness=stiffness_of(linear), delay=DT)
    half, push = PUSHES // 2, min(PUSH, MOVED * linear, SPARE * _most_held(robot, where.q))
    along = np.tile(directions(half, 3), (2, 1))
    random = np.random.default_rng(SEEDS[name])
    shares = np.repeat([0.0, FRICTION], half)
    hand = "plant.environment.0"
    given = {f"{hand}.{axis}": push * along[:, i] for i, axis in enumerate("xyz")}
    given[f"{hand}.onset"] = np.full(PUSHES, ONSET)
    given[f"{hand}.end"] = np.full(PUSHES, 10.0)
    given["plant.coulomb"] = shares[:, None] * robot.limits.effort
    given["plant.rotor_inertia"] = robot.armature * random.uniform(
        1.0 - ROTORS, 1.0 + ROTORS, (PUSHES, robot.n)
    )
    if velocity is None:
        bits = random.integers(BITS[0], BITS[1] + 1, (PUSHES, 1))
        given["plant.encoder_bits"] = np.tile(bits, (1, robot.n))
    start = np.tile(where.q, (PUSHES, 1))
    made = loop(robot, law, armgpi.Hold(start), LENGTH, [Hand()], 5, velocity=velocity)
    path = tool_of(robot, made.run(given)).position
    moved = ((path[:, -1] - path[:, 0]) * along).sum(axis=1)
    obtained = push / linear / moved
    held = []
    for direction, distance in zip(along[half:], moved[half:], strict=True):
        rubbed = friction_at_tool(robot, where.q, FRICTION * robot.limits.effort, direction) / linear
        held.append(abs(push / linear - float(distance)) / rubbed)
    return Pushed(obtained[:half], obtained[half:], np.array(held), path)


def elastic(quick: bool) -> None:
    """Print what comes to rest on elastic joints."""
    _page.say(
        "Springs on elastic joints without friction after a push of 10 N along each axis and 1 N m about "
        "each, four configurations of each arm, 18 bits, one sample late, damping of the joints of 1 and "
        "5 %, not known to the controller. At 500 N/m it does not know the side of the encoders; at the "
        "largest stiffness that it allows, which differs by side, it does. At rest: slower than "
        f"{REST:g} rad/s 2.3 s after the push."
    )
    rows = []
    for name, locked in ELASTIC[:1] if quick else ELASTIC:
        robot = armgpi.assume_drives(armgpi.Robot.load(name, lock=locked))
        law = armgpi.CartesianImpedance(robot, DT, stiffness=stiffness_of(500.0), delay=DT)
        both = np.concatenate([_rested(robot, law, side) for side in ("motor", "link")])
        row = [name, f"{law.velocity_filter:g}", _calm(both)]
        for side in ("motor", "link"):
            sided = robot.with_drives(robot.drives.with_value("encoder_side", side))
            largest = _largest(sided)
            row += [f"{largest.stiffness[0]:.3g}", f"{largest.velocity_filter:g}"]
            row.append(_calm(_rested(robot, largest, side)))
        rows.append(row)
    heads = ["arm", "filter [rad/s]", "500 N/m"]
    for side in ("motor", "link"):
        heads += [f"{side}, largest [N/m]", "its filter", "at it"]
    print(table(heads, rows))


def _largest(robot: armgpi.Robot) -> armgpi.CartesianImpedance:
    """Return the stiffest spring that a controller takes, within 1 %: by halving its interval."""
    low, high = 100.0, 1e6
    law = armgpi.CartesianImpedance(robot, DT, stiffness=stiffness_of(low), delay=DT)
    while high > 1.01 * low:
        middle = math.sqrt(low * high)
        try:
            law = armgpi.CartesianImpedance(robot, DT, stiffness=stiffness_of(middle), delay=DT)
            low = middle
        except ParameterError:
            high = middle
    return law


def _rested(robot: armgpi.Robot, law: Any, side: str) -> Array:
    """Return the largest speeds [rad/s] 2.3 s after a push."""
    known = random_configurations(robot, 200, seed=5)
    agility = np.linalg.svd(robot.frame_jacobian(robot.tip, known), compute_uv=False)[:, -1]
    q = known[np.argsort(-agility)[[0, 5, 20, 60]]]
    gear, rotor = robot.drives.value("stiffness"), robot.armature
    own = np.median(np.diagonal(robot.mass_matrix(q), axis1=1, axis2=2), axis=0)
    link = np.maximum(own - rotor, 0.05 * own)
    push = armgpi.ToolForce([10.0, 10.0, 10.0], [1.0, 1.0, 1.0], onset=0.05, end=0.15)
    plain = 2.0 * np.sqrt(gear * rotor * link / (rotor + link))
    ratios = np.repeat([0.05, 0.01], len(q))
    starts = np.tile(q, (2, 1))
    arm = armgpi.ElasticPlant(
        robot, gear_stiffness=gear, gear_damping=0.05 * plain, encoder_side=side, environment=[push]
    )
    plant = armgpi.Delayed(armgpi.Encoder(arm, 18), 1)
    made = armgpi.prepare(
        plant, law, armgpi.Hold(starts), 2.5, record=("v",), record_every=5, backend="compiled"
    )
    rollout = made.run({"plant.gear_damping": ratios[:, None] * plain})
    return np.asarray(np.abs(rollout["v"].values[:, -10:]).max(axis=(1, 2)))


def _calm(speeds: Array) -> str:
    """Return how many came to rest."""
    return f"{int((speeds < REST).sum())} of {len(speeds)}, {speeds.max():.2g} rad/s"


class Point(NamedTuple):
    """A spring of 3,000 N/m: its filter and smoothing, the circle [mm] and the torque step [N m]."""

    arm: str
    bandwidth: float
    smoothing: float
    circle: float
    step: float


def front(quick: bool) -> None:
    """Print and draw the circle against the torque step of a stiff spring."""
    _page.say(
        f"A spring of {STIFF:g} N/m, Coulomb friction of {100 * FRICTION:g} % of the effort fed forward, "
        f"known {100 * (1 - KNOWN):.0f} % too low: largest error on the circle of 240 mm in 3 s and largest "
        f"torque step in 1 ms by the filter of the velocity and the smoothing of the friction, 17 bits, one "
        "sample late. "
        f"Best: the least error with at most {STEP:g} N m. Goal: {CIRCLE:g} mm with at most {STEP:g} N m."
    )
    points: list[Point] = []
    rows = []
    for name in ("panda", *ARMS)[: 2 if quick else 4]:
        found = [point for bandwidth in FILTERS for point in _stiff(name, bandwidth)]
        points += found
        least = min(found, key=lambda point: point.circle)
        gentle = min(found, key=lambda point: (point.step > STEP, point.circle))
        usual = next(point for point in found if (point.bandwidth, point.smoothing) == (250.0, 0.05))
        rows.append([name, _text(usual), _text(least), _text(gentle) if gentle.step <= STEP else "none"])
    print(table(["arm", "as by default", "least error", f"at most {STEP:g} N m"], rows))
    if not quick:
        _draw(points)


def _text(point: Point) -> str:
    """Return a point as text."""
    return f"{point.circle:.3g} mm, {point.step:.2g} N m ({point.bandwidth:g}, {point.smoothing:g} rad/s)"


def _stiff(name: str, bandwidth: float) -> list[Point]:
    """Return the points of a filter on an arm."""
    where = place(name)
    robot = where.robot
    level = friction_of(robot, FRICTION)
    known = robot.with_friction(level.viscous, KNOWN * level.coulomb)
    try:
        law = armgpi.CartesianImpedance(
            known,
            DT,
            stiffness=stiffness_of(STIFF),
            delay=DT,
            friction_feedforward=True,
            velocity_filter=bandwidth,
        )
    except ParameterError:
        return []
    arm = armgpi.RigidBodyPlant(robot, (), level)
    plant = armgpi.Delayed(armgpi.Encoder(arm, 17), 1)
    made = armgpi.prepare(
        plant, law, where.circle, 3.3, record=("q", "q_ref", "tau"), record_every=1, backend="compiled"
    )
    start = np.tile(where.circle.at(0.0).q, (len(SMOOTH), 1))
    rollout = made.run({"controller.friction_smoothing": np.array(SMOOTH)}, q0=start)
    motion = tool_of(robot, rollout).position
    wished = robot.frame_pose(robot.tip, where.circle.at(rollout["time"].values).q).translation
    errors = 1e3 * np.linalg.norm(motion - wished, axis=-1).max(axis=1)
    steps = np.abs(np.diff(rollout["tau"].values[:, 5:-1], axis=1)).max(axis=(1, 2))
    return [
        Point(name, bandwidth, smoothing, float(error), float(step))
        for smoothing, error, step in zip(SMOOTH, errors, steps, strict=True)
    ]


def _draw(points: list[Point]) -> None:
    """Draw the circle against the torque step for docs/compliance.md."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 3.8), layout="constrained")
    panels = figure.subplots(1, 2)
    for axes, name in zip(panels, ("panda", "xarm7"), strict=True):
        for bandwidth, marker, dashes in zip(FILTERS, "osD^", ("-", "--", "-.", ":"), strict=True):
            own = [p for p in points if (p.arm, p.bandwidth) == (name, bandwidth)]
            look = {"marker": marker, "linestyle": dashes, "markersize": 4, "linewidth": 1}
            label = f"velocity filter {bandwidth:g} rad/s"
            axes.plot([p.step for p in own], [p.circle for p in own], label=label, **look)
            for point in own if bandwidth == NAMED else ():
                if point.smoothing == SMOOTH[1]:  # its point is next to that of the first
                    continue
                at = (point.step, point.circle)
                axes.annotate(f"{point.smoothing:g}", at, (5, 2), textcoords="offset points", fontsize=7)
        axes.axhline(CIRCLE, color="0.5", linewidth=0.8)
        axes.axvline(STEP, color="0.5", linewidth=0.8)
        axes.set(title=name, xlabel="largest torque step in 1 ms [N m]", ylabel="largest error [mm]")
        axes.set(xlim=(0.0, 2.3), ylim=(0.0, 4.5))
    figure.legend(*panels[0].get_legend_handles_labels(), fontsize=7, loc="outside lower center", ncols=4)
    figure.savefig(PICTURE, dpi=150)
