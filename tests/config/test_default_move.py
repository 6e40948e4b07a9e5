"""The default move: well-conditioned, held by the motors, clear; the same in files, commands and Python."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import Answer

import armgpi
from armgpi import Robot, config, robots
from armgpi.config import building, default_move
from armgpi.robot import usual
from armgpi.robot.collisions import self_collisions

Cli = Callable[..., Answer]

#: Arms that are singular or in collision in the middle of their ranges, or on the way from there.
SINGULAR = [
    "anthropomorphic3",
    "twodof",
    "ur5",
    "ur10",
    "finger_edu",
    "talos_left_arm",
    "tiago_dual_left_arm",
]


def load(name: str) -> Robot:
    """Return an arm without the warnings of its gripper."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", armgpi.ArmgpiWarning)
        return Robot.load(name)


def way_of(robot: Robot) -> Any:
    """Return the configurations of the default move, (k, n)."""
    move = armgpi.default_move(robot)
    return move.at(np.linspace(0.0, move.t_end, 60)).q


def smallest_singular_values(robot: Robot, q: Any) -> Any:
    """Return the smallest that is not 0 everywhere, of the tool's position, or of its pose, (k,)."""
    rows = 3 if robot.n < 6 else 6
    J = robot.frame_jacobian(robot.tip, q)[:, :rows]
    rank = np.linalg.matrix_rank(robot.frame_jacobian(robot.tip, robot.random_positions(1, 7))[0, :rows])
    return np.linalg.svd(J, compute_uv=False)[:, rank - 1]


@pytest.mark.parametrize("name", SINGULAR)
def test_the_move_keeps_away_from_singular_configurations(name: str) -> None:
    robot = load(name)
    usual_ones = np.median(smallest_singular_values(robot, robot.random_positions(400, 3)))
    q = way_of(robot)
    # A quarter of a median over other samples, in other units: a fifth is safe, and the middle has far less.
    assert smallest_singular_values(robot, q).min() > 0.2 * usual_ones
    assert robot.outside(q) is None
    assert robot.holding_share(q).max() <= 0.9 + 1e-9


@pytest.mark.parametrize("name", ["anthropomorphic3", "ur5", "twodof"])
def test_the_middle_of_these_is_singular(name: str) -> None:
    robot = load(name)
    assert smallest_singular_values(robot, robot.middle()[None])[0] < 1e-6


@pytest.mark.parametrize("name", ["ur5", "ur10", "panda", "tiago_dual_left_arm"])
def test_the_move_touches_neither_the_arm_nor_its_floor(name: str) -> None:
    robot = load(name)
    q = way_of(robot)
    # The first row says which shapes overlap by their design, so the free middle of the ranges goes first.
    assert self_collisions(robot, np.vstack([robot.middle(), q])) == []
    if name.startswith("ur"):  # stands on the floor; the elbow and all beyond it have to stay above it
        for frame in ("wrist_1_link", "wrist_3_link", "tool0"):
            assert robot.frame_pose(frame, q).translation[:, 2].min() > 0.0


def test_an_arm_that_is_well_conditioned_in_the_middle_starts_there() -> None:
    robot = load("panda")
    start, goal = default_move.ends(robot)
    assert start == pytest.approx(robot.middle())
    assert goal - start == pytest.approx(np.minimum(0.5, 0.5 * (robot.limits.upper - robot.middle())))


def test_a_pendulum_that_can_only_stand_upright_moves_all_the_same() -> None:
    robot = load("double_pendulum_continuous")
    start, goal = default_move.ends(robot)
    assert np.abs(goal - start).max() == pytest.approx(0.5)


@pytest.mark.slow
def test_commands_files_and_python_have_the_same_move(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    expected = [point.tolist() for point in (default_move.ends(load("ur5")))]
    assert cli("new", "ur5", "-o", "arm.yaml").code == 0
    file = config.build(*config.read(Path("arm.yaml")))
    assert file.config.reference.points[:2] == expected
    assert cli("run", "ur5", "--t-final", 0.05, "--out", "out").code == 0
    run = config.build(*config.read(Path("out/experiment.yaml")))
    assert run.config.reference.points[:2] == expected
    assert cli("export", "ur5", "-o", "exported").code == 0
    exported = next(Path("exported").rglob("experiment.yaml"))
    assert config.build(*config.read(exported)).config.reference.points[:2] == expected
    assert armgpi.default_move(load("ur5")).at(0.0).q.tolist() == expected[0]


def test_a_goal_alone_starts_where_the_default_move_does(cli: Cli, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert cli("run", "ur5", "--to", "wrist_3_joint=0.2", "--t-final", 0.05, "--out", out).code == 0
    points = config.build(*config.read(out / "experiment.yaml")).config.reference.points
    start = default_move.ends(load("ur5")).start
    assert points[0] == start.tolist()
    assert points[1] == [*start[:-1].tolist(), 0.2]


def test_a_file_without_the_key_ideal_keeps_its_old_move() -> None:
    robot = load("ur5")
    built = building.build(config.check({"robot": {"name": "ur5"}}, config.Origin("old")))
    assert built.config.reference.points[0] == robot.middle().tolist()
    assert built.config.reference.points[1] == (robot.middle() + 0.5).tolist()


def test_what_is_kept_of_a_move_has_the_same_bits() -> None:
    robot = load("ur5")
    np.testing.assert_array_equal(default_move.ends(robot), usual.usual_ends(robot))


def balls(path: Path, extra: str = "") -> Robot:
    """Return a planar arm of three links of 1 m, with a ball at the end, and something at its base."""
    ball = '<collision><origin xyz="1 0 0"/><geometry><sphere radius="0.15"/></geometry></collision>'
    body = (
        '<inertial><origin xyz="0.5 0 0"/><mass value="1"/>'
        '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    text = f'<link name="base">{extra}</link>'
    for k, (parent, name) in enumerate(zip(("base", "a", "b"), "abc", strict=True)):
        shape = ball if name == "c" else ""
        text += (
            f'<link name="{name}">{body}{shape}</link>'
            f'<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="{name}"/>'
            f'<origin xyz="{float(k > 0)} 0 0"/><axis xyz="0 0 1"/>'
            '<limit lower="-3" upper="3" effort="50" velocity="3"/></joint>'
        )
    path.write_text(f'<robot name="balls">{text}</robot>')
    return Robot.load(path)


def _least_distance(ends: usual.Ends, x: float, y: float) -> float:
    """Return how near the end of the arm comes to a point on its way [m]."""
    angles = np.cumsum(np.linspace(*ends, 21), axis=1)
    return float(np.hypot(np.cos(angles).sum(axis=1) - x, np.sin(angles).sum(axis=1) - y).min())


def test_a_ball_where_the_kept_move_goes_makes_it_another_one(tmp_path: Path) -> None:
    """Shapes change no mass: by the masses alone the old move was kept, on the disk as well."""
    path = tmp_path / "arm.urdf"
    before = default_move.ends(balls(path))
    angles = np.cumsum(before.goal)
    x, y = np.cos(angles).sum(), np.sin(angles).sum()
    shape = f'<origin xyz="{x} {y} 0"/><geometry><sphere radius="0.15"/></geometry>'
    changed = balls(path, f"<collision>{shape}</collision>")
    after = default_move.ends(changed)
    assert _least_distance(before, x, y) < 0.3  # the sum of the radii
    assert _least_distance(after, x, y) > 0.3


@pytest.mark.slow
@pytest.mark.parametrize("name", robots.names())
def test_every_arm_has_a_well_conditioned_move_or_none_at_all(name: str) -> None:
    """Arms whose motors hold them nowhere, or that have no room, start in the middle."""
    robot = load(name)
    judge = usual._Judge(robot)
    ends = default_move.ends(robot)
    way = np.linspace(*ends, 21)
    if name.startswith("double_pendulum"):
        assert ends.start == pytest.approx(robot.middle())
        return
    assert judge.conditioning(way).min() >= 0.25
    assert judge.height(way).max() <= 0.95
    most = max(0.9, float(robot.holding_share(robot.middle()).max()))
    assert robot.holding_share(way).max() <= most + 1e-9


def test_a_slower_move_asks_motors_for_what_holding_leaves_of_them() -> None:
    """The torque that moves goes with 1 / duration^2; the worst joint has four fifths of what is left."""
    robot = load("ur5")
    # The shoulder, which carries the arm, is the worst: up against its weight, or down with it.
    start, goal = np.array([0.0, -1.3, 0.9, 0.2, 0.4, 0.0]), np.array([0.1, -0.2, 0.7, 0.2, 0.4, 0.0])
    way = armgpi.Bezier(start, goal, 1.0).at(np.linspace(0.0, 1.0, 41))
    weak = robot.with_limits(effort=1.05 * np.abs(robot.gravity(way.q)).max(axis=0) + 2.0)
    duration = default_move.gentle_duration(weak, start, goal)
    strong = default_move.gentle_duration(robot, start, goal)
    assert strong < duration < 4.0 * strong
    shares = []
    for x in np.linspace(0.0, duration, 41):
        q, v, a = armgpi.Bezier(start, goal, duration).at(x)
        holding = weak.gravity(q)
        moving = weak.inverse_dynamics(q, v, a) - holding
        for j in range(6):
            left = (
                weak.limits.effort[j] - holding[j] if moving[j] > 0.0 else weak.limits.effort[j] + holding[j]
            )
            shares.append(abs(moving[j]) / left)
    assert max(shares) == pytest.approx(0.8)
