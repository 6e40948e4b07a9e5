"""What the rule chose for an arm is kept, in the process and on the disk, by a digest of what it depends on.

That is the arm as it is known, sample time, delay, encoders, what was given, and the code and constants of
this package: with any other of these it is worked out anew. Of the arms of a batch nothing is kept on the
disk.
"""

from __future__ import annotations

import hashlib
import json
import platform
import sys
import threading
from collections.abc import Callable, Mapping
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.cache import keep_result, read_result
from armgpi.gpi.family import Member
from armgpi.gpi.payload import LoadRange
from armgpi.robot.kinematics import middle_and_random
from armgpi.robot.robot import Robot

#: Rooms whose code decides what is chosen.
_ROOMS = ("tuning", "gpi", "robot", "control")
#: Modules whose constants do: tools and tests change some of them.
_MODULES = (
    *(f"tuning.{name}" for name in ("rule", "verdict", "collocated", "geared", "two_mass")),
    *(f"gpi.{name}" for name in ("payload", "margins", "family", "advice")),
)
#: Configurations at which D(q) and G(q) stand for an arm besides its parts.
_PROBED = 4
#: Results that a process keeps at most.
_MOST = 1024

_in_process: dict[str, Any] = {}
_lock = threading.Lock()


class _NotPlainError(TypeError):
    """Something that has no plain text."""


def remember(kind: str, parts: Mapping[str, Any], compute: Callable[[], Any], on_disk: bool = True) -> Any:
    """Return what is kept of a kind of result for some parts, or compute and keep it.

    Args:
        kind: of the result.
        parts: what it depends on; robots, numbers, arrays, words, loads and mappings of these.
        compute: works it out: mappings, tuples and lists of numbers, words, arrays and loads.
        on_disk: whether it is kept on the disk as well; of the arms of a batch it is not.

    Returns:
        The same, with the same bits; tuples are lists.
    """
    try:
        content = [kind, _written(parts), _package(), _constants()]
        text = json.dumps(content)
    except _NotPlainError:
        return compute()
    key = hashlib.sha256(text.encode()).hexdigest()[:32]
    plain = _in_process.get(key)
    if plain is None:
        plain = read_result(key) if on_disk else None
        if plain is None or _read(plain) is None:
            plain = _written(compute())
            if on_disk:
                keep_result(key, plain)
        _keep(key, plain)
    # Not read from what is kept: another thread may have dropped it already.
    return _read(plain)


def _keep(key: str, plain: Any) -> None:
    """Keep a result in the process, in place of the oldest one where there are too many."""
    with _lock:
        if key not in _in_process and len(_in_process) >= _MOST:
            _in_process.pop(next(iter(_in_process)))
        _in_process[key] = plain


def forget() -> None:
    """Forget what this process keeps."""
    with _lock:
        _in_process.clear()


def _written(value: Any) -> Any:
    """Return plain data from which the same value can be read, bit by bit.

    Raises:
        _NotPlainError: for anything else.
    """
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return {"array": value.tolist(), "kind": value.dtype.str}
    if type(value) is LoadRange:
        names = ("heaviest", "lightest", "frame", "com")
        return {"load": _written({name: getattr(value, name) for name in names})}
    if isinstance(value, Robot):
        return {"robot": _digest(value)}
    if isinstance(value, Mapping):
        rows = [[str(name), _written(entry)] for name, entry in value.items()]
        return {"mapping": rows}
    if isinstance(value, (tuple, list)):
        return [_written(entry) for entry in value]
    raise _NotPlainError


def _read(plain: Any) -> Any:
    """Return the value of plain data; None for what is none of ours."""
    if isinstance(plain, list):
        return [_read(entry) for entry in plain]
    if not isinstance(plain, dict):
        return plain
    match plain:
        case {"array": values, "kind": str(kind)}:
            return np.array(values, dtype=kind)
        case {"load": own}:
            return LoadRange(**_read(own))
        case {"mapping": rows}:
            return {name: _read(entry) for name, entry in rows}
    return None


@lru_cache(maxsize=64)
def _digest(robot: Robot) -> str:
    """Return a digest of what is known of an arm, whatever it was read from."""
    places = middle_and_random(robot, _PROBED, seed=5)
    model = robot.pinocchio_model()
    data: dict[str, dict[str, list[Any]]] = {}
    for quantity, rows in robot.drives.data.items():
        data[quantity] = {
            joint: [datum.value, datum.low, datum.high, datum.source] for joint, datum in rows.items()
        }
    words = {
        "name": robot.name,
        "joints": [list(robot.joint_names), list(robot.joint_types), robot.tip],
        "friction": [[str(change) for change in robot.provenance.get("changes", ())]],
        "drives": data,
        "frames": [[frame.name, frame.parentJoint] for frame in model.frames],
    }
    text = json.dumps(words, sort_keys=True, default=str)
    content = hashlib.sha256(text.encode())
    for array in _numbers(robot, model, places):
        numbers = np.ascontiguousarray(array, dtype=float)
        content.update(numbers.tobytes() + b"|")
    return content.hexdigest()


def _numbers(robot: Robot, model: Any, places: Array) -> list[Array]:
    """Return the numbers of an arm."""
    bodies = [np.array([body.mass, *body.lever, *body.inertia.ravel()]) for body in model.inertias]
    joints = [np.asarray(placement.homogeneous).ravel() for placement in model.jointPlacements]
    frames = [np.asarray(frame.placement.homogeneous).ravel() for frame in model.frames]
    return [
        *bodies,
        *joints,
        *frames,
        np.asarray(model.gravity.linear),
        robot.armature,
        *robot.limits,
        *robot.friction,
        robot.mass_matrix(places),
        robot.gravity(places),
    ]


@lru_cache(maxsize=1)
def _package() -> str:
    """Return a digest of the code that decides what is chosen, and of what it computes with."""
    of_pinocchio = import_module("pinocchio").__version__
    versions = [sys.version, platform.machine(), np.__version__, of_pinocchio]
    content = hashlib.sha256(" ".join(versions).encode())
    root = Path(__file__).parents[1]
    for folder in (root, *(root / room for room in _ROOMS)):
        for path in sorted(folder.glob("*.py")):
            content.update(f"{path.relative_to(root)}\0".encode() + path.read_bytes())
    return content.hexdigest()


def _constants() -> str:
    """Return the constants of the rule, as they are now."""
    lines = []
    for module in _MODULES:
        for name, value in vars(import_module(f"armgpi.{module}")).items():
            if name.lstrip("_").isupper() and not isinstance(value, Member):
                lines.append(f"{module}.{name}={value!r}")
    return "\n".join(lines)
