"""Values put at the keys of an experiment as plain data: by commands, searches, sweeps and pages alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from armgpi.base.parameter import Parameter
from armgpi.config.section import Section
from armgpi.robot.drives import QUANTITIES

#: Kinds of parameters that are no numbers.
_WORDS = ("flag", "text", "choice")
#: A way to a key: names of sections, and places in lists.
Path = Sequence[str | int]


def path_of(name: str) -> tuple[str | int, ...]:
    """Return the way to a key from its name with dots, such as plant.loads.0.onset."""
    return tuple(int(step) if step.isdigit() else step for step in name.split("."))


def find(config: Section, name: str) -> tuple[Parameter, Any]:
    """Return what is known of a number of an experiment, by its name, and what it is; None where nothing is.

    Args:
        config: the experiment; `controller` is its first one.
        name: with dots, such as robot.effort, plant.noise.position or reference.path.radius.

    Returns:
        What is known of it, and its value; where the file names joints, by their names in the file's order.

    Raises:
        LookupError: when it has no such number.
    """
    here: Any = config
    declared = Parameter("", name=name)
    for step in path_of(name.replace("controller.", "controllers.0.", 1)):
        is_absent_section = isinstance(here, type) and issubclass(here, Section)
        if isinstance(here, Section) or is_absent_section:
            key = here.keys[str(step)]
            value = vars(here).get(str(step)) if isinstance(here, Section) else None
            if value is None:  # of a section that is not there its class says what it may have
                value = getattr(key.form, "__self__", None)
            here = value
            declared = key.declared or declared
        elif isinstance(here, list):
            here = here[int(step)]
            declared = replace(declared, kind="number", per_joint=False)
        elif isinstance(here, Mapping):
            here = here[step]
            declared = QUANTITIES.get(str(step), replace(declared, per_joint=False))
        else:
            raise LookupError(name)
    is_several = isinstance(here, Mapping) or (
        isinstance(here, list) and declared.kind in ("number", "integer")
    )
    if is_several and not declared.per_joint:
        raise LookupError(name)
    if isinstance(here, type | Section | str | bool) or declared.kind in _WORDS:
        raise LookupError(name)
    return declared, here


def put(data: Any, path: Path, value: Any) -> None:
    """Put a value at a key; a section that is not there, or null, is made.

    Args:
        data: the experiment, or a section of it, as plain data; it is changed.
        path: the way to the key.
        value: what is put there; a whole number stays one where there is one already.

    Raises:
        LookupError: when there is no such place in a list.
        TypeError: when a number or text on the way has no keys.
    """
    *way, last = path
    for step in way:
        may_be_missing = isinstance(data, dict) and isinstance(step, str)
        if may_be_missing and data.get(step) is None:
            data[step] = {}
        data = data[step]
    before = data.get(last) if isinstance(data, dict) else data[last]
    if type(before) is int and isinstance(value, float) and value.is_integer():
        value = int(value)
    data[last] = value
