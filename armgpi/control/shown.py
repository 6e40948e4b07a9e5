"""How a controller prints its numbers: in a line, and as a table in notebooks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from armgpi.errors import show_value
from armgpi.escape import html_table
from armgpi.parameter import Parametrised, parameters, plain

if TYPE_CHECKING:
    from armgpi.robot.batch import AnyRobot


class Shown(Parametrised):
    """Something with a robot and a sample time that prints its numbers."""

    if TYPE_CHECKING:

        @property
        def robot(self) -> AnyRobot:
            """The nominal model."""

        @property
        def dt(self) -> float:
            """The sample time [s]."""

    def __repr__(self) -> str:
        """Return the robot, the sample time and the numbers of the controller in a line."""
        numbers = "".join(f", {name}={value}" for name, value in self._numbers().items())
        return f"{type(self).__name__}({self.robot.name!r}, dt={self.dt:g}{numbers})"

    def _repr_html_(self) -> str:
        """Return its numbers as a table, for notebooks."""
        head = ("parameter", "value")
        title = f"{type(self).__name__} of {self.robot.name}, dt = {self.dt:g} s"
        return html_table(title, head, self._numbers().items())

    def _numbers(self) -> dict[str, str]:
        """Return tunings, gains, and other parameters that are not at their defaults, as short texts."""
        found = {}
        for name, declared in parameters(type(self)).items():
            value = plain(getattr(self, name))
            if name in ("dt", "effort") or (isinstance(value, list) and not _is_plain(value)):
                continue
            if isinstance(value, Mapping):  # a tuning: its own numbers
                found.update({key: _short(part) for key, part in value.items()})
            elif _short(value) != _short(plain(declared.default)) or (declared.per_joint and np.any(value)):
                found[name] = _short(value)
        return found


def _is_plain(value: list[Any]) -> bool:
    """Tell whether a list has numbers and texts alone."""
    return all(isinstance(x, int | float | str) or x is None for x in value)


def _short(value: Any) -> str:
    """Return a value as a short text; equal numbers of all joints as one."""
    if isinstance(value, list) and value and all(x == value[0] for x in value):
        value = value[0]
    if isinstance(value, list):
        return f"[{', '.join(_short(x) for x in value)}]"
    return f"{value:.4g}" if isinstance(value, float) else show_value(value)
