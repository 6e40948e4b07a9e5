"""Values of an experiment file as constructors take them, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from armgpi.base.arrays import Array, quantity
from armgpi.base.parameter import REQUIRED, Parameter, Parametrised, parameters
from armgpi.config.place import Place
from armgpi.config.section import Section
from armgpi.errors import ArrayError, NameNotFound
from armgpi.robot.robot import Robot


def as_section(value: Any) -> Any:
    """Return a chosen value as an experiment file has it: one number where all are the same."""
    if isinstance(value, tuple):
        return {"lower": as_section(value[0]), "upper": as_section(value[1])}
    if isinstance(value, str | int):
        return value
    if isinstance(value, Parametrised):
        return value.values()
    array = np.asarray(value, dtype=np.float64)
    return float(array.flat[0]) if (array == array.flat[0]).all() else array.tolist()


def given_values(
    section: Section,
    declared: Mapping[str, Parameter],
    robot: Robot,
    place: Place,
    chosen: Mapping[str, Any] | None = None,
    others: float | None = None,
) -> dict[str, Any]:
    """Return what a section gives of declared parameters, by their names, as constructors take it.

    Args:
        section: of the file.
        declared: the parameters.
        robot: the arm.
        place: of the section.
        chosen: defaults that were worked out for this experiment.
        others: what joints get that a mapping leaves out and that have no default.
    """
    found: dict[str, Any] = {}
    for name, each in declared.items():
        value = getattr(section, each.file_key, None) if each.in_file else None
        if value is None:
            continue
        default = (chosen or {}).get(name, found.get(each.follows, each.default))
        if default is REQUIRED or default is None or isinstance(default, tuple):
            default = others
        found[name] = value_of(each, value, robot, place.at(each.file_key), default)
    return found


def value_of(declared: Parameter, value: Any, robot: Robot, place: Place, default: Any) -> Any:
    """Return one value as constructors take it."""
    if declared.kind == "group":
        assert declared.group is not None
        with place.error_context():
            return declared.group(**given_values(value, parameters(declared.group), robot, place))
    if isinstance(value, Section):  # a box
        lower, upper = (
            per_joint(getattr(value, end), robot, place.at(end), None) for end in ("lower", "upper")
        )
        if np.any(lower > upper):
            raise place.error(f"expected lower <= upper, got {lower.tolist()} above {upper.tolist()}")
        return lower, upper
    if declared.kind == "table":
        with place.error_context():
            return declared.check_value(value, robot.joint_names)
    return per_joint(value, robot, place, default) if declared.per_joint else value


def per_joint(
    value: float | list[float] | Mapping[str, float],
    robot: Robot,
    place: Place,
    default: Array | float | None,
) -> Array:
    """Return a per-joint quantity as an array (n,); see :func:`armgpi.base.arrays.quantity`."""
    name = str(place.path[-1])
    try:
        return quantity(value, name, robot.joint_names, default)
    except NameNotFound as error:
        raise place.at(str(error.name)).error(str(error)) from None
    except ArrayError as error:
        raise place.error(str(error).removeprefix(f"{name}: ")) from None
