"""How a controller prints its numbers: in a line, and as tables in notebooks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.escape import html_table
from armgpi.base.hints import CONTROLLER
from armgpi.base.parameter import Parametrised, parameters, plain
from armgpi.errors import show_value

if TYPE_CHECKING:
    from armgpi.robot.batch import AnyRobot


class Shown(Parametrised):
    """Something with a robot and a sample time that prints its numbers."""

    _hints: ClassVar[Mapping[str, str]] = CONTROLLER

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
        """Return its numbers as tables, for notebooks: of the arm, and joint by joint with the limits."""
        rows, columns = [], []
        for name, number in self._found().items():
            if isinstance(number.value, list) and len(number.value) == self.robot.n:
                columns.append((number.heading(name), [_short(x) for x in number.value]))
            else:
                rows.append((name, _short(number.value), number.unit, number.text))
        limits = np.asarray(self.robot.limits.effort, dtype=float)
        if limits.shape == (self.robot.n,):  # the arms of a batch may differ
            columns.append(("effort limit [N m or N]", [_short(float(x)) for x in limits]))
        title = f"{type(self).__name__} of {self.robot.name}, dt = {self.dt:g} s"
        head = ("joint", *(heading for heading, _ in columns))
        joints = zip(self.robot.joint_names, *(values for _, values in columns), strict=True)
        whole = html_table(title, ("parameter", "value", "unit", "meaning"), rows) if rows else ""
        return whole + html_table("Joint by joint" if rows else title, head, joints)

    def _numbers(self) -> dict[str, str]:
        """Return tunings, gains, and other parameters that are not at their defaults, as short texts."""
        return {name: _short(number.value) for name, number in self._found().items()}

    def _found(self) -> dict[str, _Number]:
        """Return tunings, gains, and other parameters that are not at their defaults."""
        found: dict[str, _Number] = {}
        for name, declared in parameters(type(self)).items():
            value = plain(getattr(self, name))
            if name in ("dt", "effort") or (isinstance(value, list) and not _is_plain(value)):
                continue
            if isinstance(value, Mapping):  # a tuning: its own numbers
                own = parameters(type(getattr(self, name)))
                for key, part in value.items():
                    of = own.get(key)
                    found[key] = _Number(part, of.unit if of else "", of.text if of else "")
            elif _short(value) != _short(plain(declared.default)) or (declared.per_joint and np.any(value)):
                found[name] = _Number(value, declared.unit, declared.text)
        return found


class _Number(NamedTuple):
    """A value that is shown, with its unit and what it is."""

    value: Any
    unit: str
    text: str

    def heading(self, name: str) -> str:
        """Return the heading of its column."""
        return f"{name} [{self.unit}]" if self.unit else name


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
