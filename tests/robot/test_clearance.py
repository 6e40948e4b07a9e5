"""An arm that stays clear of itself, a floor and a box, against distances in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_collisions import arm

from armgpi import Robot
from armgpi.base.arrays import Array
from armgpi.errors import ParameterError
from armgpi.identification.excitation import excite
from armgpi.identification.resonance import shake
from armgpi.robot.clearance import Clearance, usual_floor
from armgpi.robot.collisions import read_shapes

#: Radius of a ball at the end of each link [m].
RADIUS = 0.2


def balls(q: Array) -> Array:
    """Return the centres of the balls of base and links [m], (k, 4, 2)."""
    angles = np.cumsum(np.atleast_2d(q), axis=1)
    steps = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return np.concatenate([np.zeros((len(steps), 1, 2)), np.cumsum(steps, axis=1)], axis=1)


def gaps(q: Array) -> Array:
    """Return the least gap between balls of links that are no neighbours [m], (k,)."""
    places = balls(q)
    pairs = ((0, 2), (0, 3), (1, 3))
    return (
        np.asarray(np.min([np.linalg.norm(places[:, i] - places[:, j], axis=1) for i, j in pairs], axis=0))
        - 2 * RADIUS
    )


def test_a_margin_is_the_gap_between_shapes(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    clear = Clearance(robot, margin=0.1)
    assert clear.checked
    assert clear.overlapping == ()
    q = np.random.default_rng(0).uniform(-3.0, 3.0, (300, 3))
    seen = np.array([clear.first_hit(row) is not None for row in q])
    gap = gaps(q)
    sure = np.abs(gap - 0.1) > 1e-3
    assert (seen == (gap < 0.1))[sure].all()
    assert 30 < seen.sum() < 270


def test_nothing_moves_farther_than_the_margin_between_the_rows_that_are_looked_at(tmp_path: Path) -> None:
    clear = Clearance(arm(tmp_path), margin=0.05)
    t = np.linspace(0.0, 1.0, 5001)[:, None]
    q = np.hstack([2.0 * np.sin(6.0 * t), np.cos(9.0 * t), -1.5 * t])
    rows = clear.dense(q)
    assert len(rows) < 1500
    moved = np.abs(np.diff(balls(q[rows]), axis=0)).max()
    assert moved < 0.05 + np.abs(np.diff(balls(q), axis=0)).sum(axis=-1).max()


def test_a_motion_to_identify_from_keeps_the_margin(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    for seed in range(3):
        motion = excite(robot, 6.0, 0.7, seed)
        q = motion.reference.at(np.arange(0.0, 6.0, 1e-3)).q
        assert motion.clearance.checked
        assert gaps(q).min() > 0.5 * motion.clearance.margin
        free = excite(robot, 6.0, 0.7, seed, collisions=False).reference.at(np.arange(0.0, 6.0, 1e-3)).q
        if gaps(free).min() > 0.1:
            assert free == pytest.approx(q)


def test_a_box_is_kept_out_of_by_the_shapes(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    box = np.array([[1.0, 1.0, -0.5], [2.0, 2.0, 0.5]])
    motion = excite(robot, 6.0, 0.5, 1, box=box, margin=0.05)
    places = balls(motion.reference.at(np.arange(0.0, 6.0, 5e-3)).q)
    outside = np.linalg.norm(np.maximum(np.maximum(box[0, :2] - places, places - box[1, :2]), 0.0), axis=-1)
    assert outside.min() > RADIUS
    with pytest.raises(ParameterError, match="box"):
        excite(robot, 6.0, box=[[-9, -9, -9], [9, 9, 9]])
    with pytest.raises(ParameterError, match="differ in x, y and z"):
        excite(robot, 6.0, box=[[0, 0, 0], [1, 1, 0]])


def test_an_arm_that_stands_has_a_floor_and_a_pendulum_none() -> None:
    for name, floor in (("ur5", 0.0), ("kinova", 0.0), ("double_pendulum", None), ("talos_left_arm", None)):
        seen = usual_floor(Robot.load(name))
        assert seen == (floor if floor is None else pytest.approx(floor, abs=5e-3))
    baxter = usual_floor(Robot.load("baxter_left_arm"))
    assert baxter is not None
    assert -1.0 < baxter < -0.9  # the foot of its pedestal


def test_an_arm_without_shapes_says_that_it_was_not_checked() -> None:
    motion = excite(Robot.load("anthropomorphic3"), 5.0)
    assert not motion.clearance.checked
    assert (
        "NOT CHECKED: collision of the arm with itself. It has no collision shapes"
        in motion.clearance.describe()
    )
    assert "as was specified" in excite(Robot.load("ur5"), 5.0, collisions=False).clearance.describe()


def test_a_mesh_that_is_not_found_is_named(tmp_path: Path) -> None:
    (tmp_path / "package").mkdir()
    robot = arm(tmp_path / "package", '<mesh filename="nowhere.stl"/>')
    clear = Clearance(robot)
    assert clear.missing == ("a", "b", "c")
    assert "their collision shape is invalid or its mesh was not found: a, b, c" in clear.describe()


@pytest.mark.parametrize("name", ["so101", "tiago_arm"])
def test_links_that_a_joint_connects_are_no_pair(name: str) -> None:
    robot = Robot.load(name)
    shapes, model = read_shapes(robot).model, robot.pinocchio_model()
    for pair in shapes.collisionPairs:
        first, second = sorted(int(shapes.geometryObjects[i].parentJoint) for i in (pair.first, pair.second))
        assert first != second
        assert int(model.parents[second]) != first


def test_an_arm_is_shaken_where_it_collides_with_nothing(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    wall = Clearance(robot, 0.05, box=np.array([[1.5, -0.5, -0.5], [4.0, 0.5, 0.5]]))
    assert wall.first_hit(robot.middle()) is not None
    q = np.asarray(shake(robot, seed=1, clearance=wall).reference.q)
    assert wall.first_hit(q[::20]) is None
    assert np.abs(q - q[0]).max() < 0.2


def test_a_joint_that_follows_is_where_its_ratio_and_its_offset_say(tmp_path: Path) -> None:
    (tmp_path / "free").mkdir()
    (tmp_path / "led").mkdir()
    free = arm(tmp_path / "free")
    text = (
        (tmp_path / "free/arm.urdf")
        .read_text()
        .replace('<parent link="b"/>', '<mimic joint="j1" multiplier="1" offset="0.7"/><parent link="b"/>')
    )
    (tmp_path / "led/arm.urdf").write_text(text)
    led = Robot.load(tmp_path / "led/arm.urdf", mimic="follow")
    q = np.random.default_rng(1).uniform(-3.0, 3.0, (200, 2))
    q = q[np.abs(q[:, 1] + 0.7) < 3.0]
    whole = np.column_stack([q, q[:, 1] + 0.7])
    ours, theirs = Clearance(led, margin=0.1), Clearance(free, margin=0.1)
    found = [ours.first_hit(row) is None for row in q]
    assert found == [theirs.first_hit(row) is None for row in whole]
    assert 10 < sum(found) < len(q) - 10
    without = np.column_stack([q, q[:, 1]])  # the offset changes what collides
    assert found != [theirs.first_hit(row) is None for row in without]
