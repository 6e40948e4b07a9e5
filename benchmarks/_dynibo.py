"""dynibo's equations of motion from Python: a library in Rust."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import dynibo
import numpy as np
from _peer import Array, bare_urdf

#: Its gravity, which cannot be set [m/s^2].
GRAVITY = (0.0, 0.0, -9.80665)


def load(urdf: str, fixed: Sequence[str], count: int) -> Any:
    """Return a robot of a URDF: bodies and joints only, on a base that does not move."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "robot.urdf")
        path.write_text(bare_urdf(urdf, fixed), encoding="utf-8")
        robot = dynibo.Robot.from_urdf(str(path))
    if robot.joint_count != count:
        raise RuntimeError(f"dynibo's robot has {robot.joint_count} joints, expected {count}")
    return robot


def forward(robot: Any, q: Array, v: Array, tau: Array) -> Array:
    """Return accelerations, a call for each state."""
    out, step = np.empty_like(q), robot.forward_dynamics
    for row in zip(q, v, tau, out, strict=True):
        step(*row[:3], out=row[3])
    return out


def inverse(robot: Any, q: Array, v: Array, a: Array) -> Array:
    """Return torques, a call for each state."""
    out, step = np.empty_like(q), robot.inverse_dynamics
    for row in zip(q, v, a, out, strict=True):
        step(*row[:3], out=row[3])
    return out


def inertia_times(robot: Any, q: Array, x: Array) -> Array:
    """Return D(q) x by the mass matrix, as it has no other way."""
    n = q.shape[1]
    matrix, step = np.empty(n * n), robot.mass_matrix
    square = matrix.reshape(n, n)
    out = np.empty_like(q)
    for at, of, to in zip(q, x, out, strict=True):
        step(at, out=matrix)
        np.matmul(square, of, out=to)
    return out
