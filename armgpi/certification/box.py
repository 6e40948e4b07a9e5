"""Where a certificate holds: boxes of configurations, from numbers, mappings or a task file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, quantity
from armgpi.base.yaml_text import read_yaml
from armgpi.errors import ConfigError, NameNotFound, ParameterError
from armgpi.robot.robot import Robot

#: Characters of a task file that are read: a line for each of a hundred joints is a hundredth of it.
_MOST = 1_000_000
#: Keys of a task file and what they mean.
KEYS = {
    "around": "configuration in the middle [rad or m]; the middle of the joint ranges when not given",
    "by": "half the width of the box [rad or m]",
    "lower": "lower end of the box [rad or m]",
    "upper": "upper end of the box [rad or m]",
}


class Box(NamedTuple):
    """Configurations between two ends.

    Attributes:
        lower: lower end [rad or m], shape (n,).
        upper: upper end [rad or m], shape (n,).
    """

    lower: Array
    upper: Array


def box_of(robot: Robot, given: Any) -> Box:
    """Return a box of configurations; what is not given is the joint's range, a turn at most.

    Args:
        robot: the arm.
        given: None for the joint ranges; a number by which to leave their middle; or a mapping with
            `around` and `by`, or with `lower` and `upper`, each one number, a list, or by joint name.

    Raises:
        ParameterError: for ends that are the wrong way round.
        ArrayError: for what is not a number for each joint.
        NameNotFound: for a key or a joint that there is not.
    """
    middle = robot.middle()
    most = np.where(robot.prismatic, math.inf, math.pi)
    whole = Box(np.maximum(robot.limits.lower, middle - most), np.minimum(robot.limits.upper, middle + most))
    if given is None:
        return whole
    wanted = dict(given) if isinstance(given, Mapping) else {"by": given}
    if unknown := [key for key in wanted if key not in KEYS]:
        raise NameNotFound("key of a box", unknown[0], KEYS)
    around, ends = wanted.keys() & {"around", "by"}, wanted.keys() & {"lower", "upper"}
    if around and ends:
        raise ParameterError("box", given, "either around and by, or lower and upper")

    def values(key: str, default: Array) -> Array:
        value = wanted.get(key)
        return default if value is None else quantity(value, f"box.{key}", robot.joint_names, default)

    if around:
        center, half = values("around", middle), values("by", 0.5 * (whole.upper - whole.lower))
        found = Box(center - half, center + half)
    else:
        found = Box(values("lower", whole.lower), values("upper", whole.upper))
    for name, low, high in zip(robot.joint_names, *found, strict=True):
        if not math.isfinite(high - low):
            raise ParameterError(
                "box", [low, high], f"two ends for joint {name!r}, which slides without limit"
            )
        if not low <= high:
            raise ParameterError("box", [low, high], f"a lower end below the upper one for joint {name!r}")
    return found


def read_box(path: Path) -> Any:
    """Return a box as a task file (YAML) has it; :func:`box_of` checks it.

    Raises:
        ConfigError: when the file cannot be read, or is not a mapping or number.
    """
    data = read_yaml(path, _MOST)
    data = data.get("box", data) if isinstance(data, Mapping) else data
    if not isinstance(data, Mapping | int | float) or isinstance(data, bool):
        raise ConfigError(path, "box", f"expected a number or {', '.join(KEYS)}, got {data!r}")
    return data
