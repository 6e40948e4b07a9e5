"""The tool on arms that nothing was tuned for: a circle, noisy streams of poses, and what a wall costs.

python benchmarks/tool.py [--quick]
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import _page
import numpy as np
import pinocchio as pin
from _timing import table

import armgpi
from armgpi.codegen.following import sample_streams
from armgpi.plants.sensors import Delayed, Encoder
from armgpi.references.paths import Circle, Eased
from armgpi.robot.kinematics import random_configurations

#: Arms that are not in any test of streams or of the rule's circle.
ARMS = ("ur10", "xarm7", "z1", "baxter_left_arm", "tiago_pro_left_arm", "ur3")
DT = 1e-3
#: The circle [m, s], and how much longer the arm is watched [s].
DIAMETER, PERIOD, MORE = 0.24, 3.0, 0.7
#: Poses of a stream: rate [Hz], noise [m], jitter [s], length [s], and a gap [s].
RATE, NOISE, JITTER, LENGTH, GAP = 30.0, 1e-3, 8e-3, 4.0, (2.0, 2.2)
#: A jump of a stream [m], and how near counts as there [m].
JUMP, NEAR = 0.2, 2e-3
#: Time from no torque to the largest [s], of which jerk limits are made.
RISE = 0.087
#: Rms distance that is wanted at a lag of 80 ms [mm].
GOAL = 1.5
#: Where the picture of the trade goes.
PICTURE = Path(__file__).resolve().parents[1] / "docs" / "images" / "streams.png"
#: Rollouts and samples of the batches with and without a wall.
BATCH, STEPS = 512, 500


class Place(NamedTuple):
    """Where an arm has room."""

    robot: armgpi.Robot
    q: np.ndarray
    position: np.ndarray
    rotation: np.ndarray
    circle: armgpi.CartesianReference


class Trade(NamedTuple):
    """Medians of a way to follow streams."""

    share: float  # of the arm's jerk limit
    feedforward: bool
    lag: float  # [ms]
    rms: float  # [mm]
    step: float  # share of the torque rate


def main() -> None:
    warnings.simplefilter("ignore", armgpi.ArmgpiWarning)
    page = _page.begin(
        __file__, "The tool", "realistic: rotors, stiffness, friction and encoders of the tables"
    )
    names = ARMS[:2] if page.quick else ARMS
    places = [_place(name) for name in names]
    draws = 1 if page.quick else 3
    _page.say(
        f"Circle of {1e3 * DIAMETER:.0f} mm in {PERIOD:g} s by the automatic controller, largest error of "
        f"the links' tool, {draws} scenarios for each arm: rotors within 30 %, Coulomb friction of 0 to 5 % "
        "of the effort that is not specified to the controller, 16 to 20 bits, delay of 1 to 3 samples."
    )
    rows = [row for elastic in (False, True) for row in _circles(places, draws, elastic)]
    print(table(["joints", "tool error, median and worst [mm]", "tool angle [deg]", "goal, median"], rows))
    gap = 1e3 * (GAP[1] - GAP[0])
    _page.say(
        f"Streams at {RATE:g} Hz with {1e3 * NOISE:g} mm of noise, {1e3 * JITTER:g} ms of jitter and a gap "
        f"of {gap:.0f} ms, {draws} an arm: rms distance of the follower's tool from the pose meant so long "
        "before. Goal: 1.5 mm at a lag of at most 80 ms, or 2.6 mm at 30 ms. Limits: the largest share that "
        "was used of speed, acceleration and jerk. Torque step: largest change of the feedforward in 1 ms, "
        f"as a share of the torque rate, which is the effort in {1e3 * RISE:.0f} ms; goal: at most 1."
    )
    rows = []
    trade: list[Trade] = []
    for share in (0.5, 1.0, 2.0):
        for feedforward in (False, True):
            row, point = _streams(places, draws, share, feedforward)
            rows.append(row)
            trade.append(point)
    heads = [
        "jerk limit",
        "rms, median and worst [mm]",
        "lag [ms]",
        "limits",
        "torque step, median and worst",
    ]
    print(table(["mode", *heads], rows))
    _page.say(f"A jump of {1e3 * JUMP:.0f} mm: time until the tool is within {1e3 * NEAR:g} mm of the pose.")
    print(table(["arm", "by the stream [s]", "by the follower to its configuration [s]"], _jumps(places)))
    step, whole, generated, apart = _times(places[0])
    wall = _wall(places[0])
    _page.say("Cost.")
    rows = [
        ["a sample of Follower.step, in Python", "at most 60 us", f"{step:.0f} us"],
        ["a sample of Setpoints, inverse kinematics of its poses included", "", f"{whole:.0f} us"],
        ["the same in C, as it is exported", "at most 1.5 us", f"{generated:.2f} us"],
        ["largest difference of its positions from Python's", "1e-9 rad", f"{apart:.1g} rad"],
        [f"{BATCH} compiled rollouts with a wall, over those without", "at most 1.3", f"{wall:.2f}"],
    ]
    print(table(["", "goal", "found"], rows))
    page.write()
    if not page.quick:
        _draw(trade)


def _draw(trade: list[Trade]) -> None:
    """Draw the trade of jerk against lag and distance for docs/streams.md."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.5, 3.4), layout="constrained")
    axes = figure.add_subplot()
    named = (
        (False, "o", "-", "poses alone (the default)"),
        (True, "s", "--", "with the poses' speed (feedforward)"),
    )
    for feedforward, marker, line, label in named:
        points = [point for point in trade if point.feedforward == feedforward]
        axes.plot([p.lag for p in points], [p.rms for p in points], marker + line, color="black", label=label)
        for point in points:
            text = f"{point.share:g} × the jerk limit; torque step {point.step:.2g}"
            axes.annotate(text, (point.lag, point.rms), (6, 2), textcoords="offset points", fontsize=7)
    axes.set(xlabel="lag behind the stream [ms]", ylabel="rms distance from the stream's path [mm]")
    axes.set(xlim=(20.0, 140.0), ylim=(0.0, 14.0))
    axes.axhline(GOAL, color="0.5", linewidth=0.8, linestyle=":")
    axes.annotate("goal at 80 ms", (139.0, GOAL), (0, -9), textcoords="offset points", ha="right", fontsize=7)
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(PICTURE, dpi=150)


def _place(name: str) -> Place:
    """Return a configuration around which an arm has room for the circle."""
    robot = armgpi.Robot.load(name)
    robot = robot.with_armature(armgpi.assume_drives(robot).armature)
    known = random_configurations(robot, 300, seed=0)
    jacobians = robot.frame_jacobian(robot.tip, known)
    lower, upper = robot.limits.lower, robot.limits.upper
    margin = np.minimum(known - lower, upper - known).min(axis=1)
    order = np.argsort(-np.linalg.svd(jacobians, compute_uv=False)[:, -1] * margin)
    for q in known[order]:
        pose = robot.frame_pose(robot.tip, q)
        path = Eased(Circle(centre=pose.translation, radius=0.5 * DIAMETER, period=PERIOD), 0.5)
        try:
            inverse = armgpi.TrackingInverse(robot, robot.tip, rotation=pose.rotation, near=q)
            circle = armgpi.CartesianReference(robot, robot.tip, path, inverse)
            speed = np.abs(circle.at(np.linspace(0.0, PERIOD + MORE, 80)).v) / robot.limits.velocity
        except armgpi.ArmgpiError:
            continue
        if speed.max() < 0.8:
            return Place(robot, q, pose.translation, pose.rotation, circle)
    raise SystemExit(f"{name} has no room for the circle")


def _circles(places: list[Place], draws: int, elastic: bool) -> list[list[Any]]:
    """Return the rows of the circle."""
    errors = []
    angles = []
    failed = 0
    for place in places:
        for draw in range(draws):
            random = np.random.default_rng([draw, len(place.robot.name)])
            robot = place.robot
            real = robot.with_armature(robot.armature * random.uniform(0.7, 1.3, robot.n))
            bits, delay = int(random.integers(16, 21)), int(random.integers(1, 4))
            friction = armgpi.Friction(np.zeros(robot.n), random.uniform(0.0, 0.05) * robot.limits.effort)
            arm: Any = armgpi.RigidBodyPlant(real, (), friction)
            if elastic:
                stiffness = armgpi.assume_drives(robot).drives.value("stiffness")
                arm = armgpi.ElasticPlant(real, (), friction, gear_stiffness=stiffness)
            plant = Delayed(Encoder(arm, bits), delay)
            drives = "elastic" if elastic else "stiff"
            law = armgpi.GPI.auto(robot, DT, delay=delay * DT, bits=bits, drives=drives)
            q0 = place.circle.at(0.0).q
            rollout = armgpi.simulate(plant, law, place.circle, PERIOD + MORE, q0=q0, backend="auto")
            error = float(armgpi.metrics.tool_error(rollout)[0])
            failed += not np.isfinite(error)
            errors.append(error)
            angles.append(float(armgpi.metrics.tool_angle(rollout)[0]))
    kind = "elastic" if elastic else "stiff"
    count = f", {failed} of {len(errors)} failed" if failed else f", {len(errors)} runs"
    goal = "" if elastic else "1.5 mm, 0.2 deg"
    return [[kind + count, _both(errors), _both(angles), goal]]


def _both(values: list[float]) -> str:
    """Return median and worst as text."""
    return f"{np.median(values):.3g}, {np.max(values):.3g}"


def _meant(place: Place, phase: float) -> Callable[[float], tuple[np.ndarray, np.ndarray]]:
    """Return the pose that an operator means at a time."""

    def pose(t: float) -> tuple[np.ndarray, np.ndarray]:
        x = min(max(t, 0.0), 1.0)
        ease = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        aside = np.array([0.06 * np.sin(1.3 * t), 0.12 * np.sin(1.9 * t + phase), -0.06 * np.sin(1.1 * t)])
        turn = ease * np.array([0.15 * np.sin(1.1 * t), 0.2 * np.sin(0.9 * t), 0.25 * np.sin(1.3 * t)])
        return place.position + ease * aside, pin.exp3(turn) @ place.rotation

    return pose


def _limits(robot: armgpi.Robot, share: float) -> armgpi.FollowLimits:
    """Return the arm's limits, with a share of the jerk."""
    limits = armgpi.FollowLimits.of(robot, robot.limits.effort / RISE)
    return limits._replace(jerk=share * np.asarray(limits.jerk))


def _streams(places: list[Place], draws: int, share: float, feedforward: bool) -> tuple[list[Any], Trade]:
    """Return the row of a way to follow streams, and its point in the picture."""
    distances = []
    lags = []
    steps = []
    used = 0.0
    grid = np.arange(round(LENGTH / DT)) * DT
    for place in places:
        for draw in range(draws):
            random = np.random.default_rng([draw, 7])
            meant = _meant(place, random.uniform(0.0, 1.0))
            times = []
            poses = []
            for i in range(round(LENGTH * RATE)):
                t = i / RATE
                if GAP[0] <= t < GAP[1]:
                    continue
                position, rotation = meant(t)
                turn = pin.exp3(3e-3 * random.normal(size=3))
                times.append(t + random.uniform(0.0, JITTER))
                poses.append(pin.SE3(turn @ rotation, position + NOISE * random.normal(size=3)))
            limits = _limits(place.robot, share)
            stream = armgpi.Setpoints(
                place.robot, place.robot.tip, times, poses, limits, start=place.q, feedforward=feedforward
            )
            target = stream.at(grid)
            rms, lag = _behind(place, meant, target.q, grid)
            distances.append(rms)
            lags.append(lag)
            jerk = np.abs(np.diff(target.a, axis=0)) / DT
            used = max(
                used,
                float((np.abs(target.v) / limits.velocity).max()),
                float((np.abs(target.a) / limits.acceleration).max()),
                float((jerk / limits.jerk).max()),
            )
            torque = place.robot.inverse_dynamics(*target)
            change = np.abs(np.diff(torque[5:], axis=0)) / DT
            steps.append(float((change / (place.robot.limits.effort / RISE)).max()))
    mode = "with the poses' speed" if feedforward else "without"
    row = [mode, f"{share:g} of the arm's", _both(distances), _both(lags), f"{used:.3f}", _both(steps)]
    medians = (float(np.median(x)) for x in (lags, distances, steps))
    return row, Trade(share, feedforward, *medians)


def _behind(place: Place, meant: Any, q: np.ndarray, grid: np.ndarray) -> tuple[float, float]:
    """Return the least rms distance [mm] from the pose meant some time before, and that time [ms]."""
    there = place.robot.frame_pose(place.robot.tip, q[::10]).translation
    times = grid[::10]
    best = (np.inf, 0.0)
    for lag in np.arange(0.0, 0.25, 0.005):
        kept = (times > 1.2 + lag) & ((times < GAP[0] - 0.05) | (times > GAP[1] + 0.5))
        wished = np.array([meant(t - lag)[0] for t in times[kept]])
        rms = float(np.sqrt(np.mean(np.sum((there[kept] - wished) ** 2, axis=-1))))
        best = min(best, (1e3 * rms, 1e3 * lag))
    return best


def _jumps(places: list[Place]) -> list[list[Any]]:
    """Return the rows of the jump."""
    rows = []
    grid = np.arange(3000) * DT
    for place in places:
        robot, limits = place.robot, _limits(place.robot, 1.0)
        base = np.array([place.position[0], place.position[1], 0.0])
        goal = place.position - JUMP * base / np.linalg.norm(base)  # towards the base, where there is room
        poses = [pin.SE3(place.rotation, place.position), pin.SE3(place.rotation, goal)]
        stream = armgpi.Setpoints(robot, robot.tip, [0.0, 0.2], poses, limits, start=place.q)
        away = robot.frame_pose(robot.tip, stream.at(grid).q).translation - goal
        state = stream.follower.init(place.q)
        end = stream.at(2.9).q
        direct = []
        for _ in grid:
            state = stream.follower.step(end, state)
            direct.append(state.q)
        alone = robot.frame_pose(robot.tip, np.array(direct)).translation - goal
        rows.append([robot.name, _last(away, 0.2), _last(alone, 0.0)])
    return rows


def _last(away: np.ndarray, begin: float) -> str:
    """Return when a tool stays near its goal, counted from a time [s]."""
    far = np.flatnonzero(np.linalg.norm(away, axis=-1) > NEAR)
    if len(far) == len(away) or far[-1] == len(away) - 1:
        return "not within 2.8 s"
    return f"{(far[-1] + 1) * DT - begin:.2f}"


def _times(place: Place) -> tuple[float, float, float, float]:
    """Return the times of a step and of a sample in Python and C [us], and what the two differ by [rad]."""
    follower = armgpi.Follower(_limits(place.robot, 1.0), DT)
    state, goal = follower.init(place.q), place.q + 0.2
    begin = time.process_time()
    for _ in range(5000):
        state = follower.step(goal, state)
    step = (time.process_time() - begin) / 5000
    meant = _meant(place, 0.0)
    times = np.arange(0.0, LENGTH, 1.0 / RATE)
    poses = [pin.SE3(rotation, position) for position, rotation in map(meant, times)]
    stream = armgpi.Setpoints(place.robot, place.robot.tip, times, poses, start=place.q)
    grid = np.arange(round(LENGTH / DT)) * DT
    begin = time.process_time()
    python = stream.at(grid)
    whole = time.process_time() - begin
    spent = []
    for _ in range(10):
        again = armgpi.Setpoints(place.robot, place.robot.tip, times, poses, start=place.q)
        begin = time.process_time()
        sample_streams(again, LENGTH)
        spent.append(time.process_time() - begin)
    apart = float(np.abs(again.at(grid).q - python.q).max())
    return 1e6 * step, 1e6 * whole / len(grid), 1e6 * min(spent) / len(grid), apart


def _wall(place: Place) -> float:
    """Return the time of a batch with a wall over that of one without, the least of some."""
    robot = place.robot
    below = float(place.position[2]) - 0.1
    wall = armgpi.Wall(normal=[0.0, 0.0, 1.0], distance=below, stiffness=1e4, damping=100.0, friction=0.3)
    move = armgpi.Bezier(place.q, place.q + 0.1, 0.4)
    loops = []
    for environment in ((), (wall,)):
        plant = armgpi.RigidBodyPlant(robot, environment=environment)
        law = armgpi.GPI(robot, DT)
        loops.append(armgpi.prepare(plant, law, move, STEPS * DT, record=("q",), backend="compiled"))
    start = np.tile(place.q, (BATCH, 1))
    spent = np.full((2, 9), np.inf)
    for turn in range(9):
        for i, loop in enumerate(loops):
            begin = time.perf_counter()
            loop.run(q0=start)
            spent[i, turn] = time.perf_counter() - begin
    return float(spent[1].min() / spent[0].min())


if __name__ == "__main__":
    main()
