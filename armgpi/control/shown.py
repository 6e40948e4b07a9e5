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
        rows = []
        headings = ["joint"]
        columns: list[Any] = [self.robot.joint_names]
        for name, number in self._shown_numbers().items():
            if isinstance(number.value, list) and len(number.value) == self.robot.n:
                headings.append(number.heading(name))
                columns.append([_short(value) for value in number.value])
            else:
                rows.append((name, _short(number.value), number.unit, number.text))
        limits = np.asarray(self.robot.limits.effort, dtype=float)
        if limits.shape == (self.robot.n,):  # the arms of a batch may differ
            headings.append("effort limit [N m or N]")
            columns.append([_short(limit) for limit in limits.tolist()])
        title = f"{type(self).__name__} of {self.robot.name}, dt = {self.dt:g} s"
        joints = zip(*columns, strict=True)
        if not rows:
            return html_table(title, headings, joints)
        of_arm = html_table(title, ("parameter", "value", "unit", "meaning"), rows)
        return of_arm + html_table("Joint by joint", headings, joints)

    def _numbers(self) -> dict[str, str]:
        """Return tunings, gains, and other parameters that are not at their defaults, as short texts."""
        return {name: _short(number.value) for name, number in self._shown_numbers().items()}

    def _shown_numbers(self) -> dict[str, _Number]:
        """Return tunings, gains, and other parameters that are not at their defaults."""
        shown: dict[str, _Number] = {}
        for name, declared in parameters(type(self)).items():
            value = plain(getattr(self, name))
            if name in ("dt", "effort"):
                continue
            if isinstance(value, list) and not _is_plain(value):
                continue
            if isinstance(value, Mapping):
                shown |= _tuning_numbers(value, type(getattr(self, name)))
                continue
            is_default = _short(value) == _short(plain(declared.default))
            if not is_default or (declared.per_joint and np.any(value)):
                shown[name] = _Number(value, declared.unit, declared.text)
        return shown


class _Number(NamedTuple):
    """A value that is shown, with its unit and what it is."""

    value: Any
    unit: str
    text: str

    def heading(self, name: str) -> str:
        """Return the heading of its column."""
        return f"{name} [{self.unit}]" if self.unit else name


def _tuning_numbers(values: Mapping[str, Any], kind: type) -> dict[str, _Number]:
    """Return the numbers of a tuning, with the units of its class."""
    numbers = {}
    declared = parameters(kind)
    for name, value in values.items():
        parameter = declared.get(name)
        if parameter is None:
            numbers[name] = _Number(value, "", "")
        else:
            numbers[name] = _Number(value, parameter.unit, parameter.text)
    return numbers


def _is_plain(value: list[Any]) -> bool:
    """Tell whether a list has numbers and texts alone."""
    return all(isinstance(x, int | float | str) or x is None for x in value)


def _short(value: Any) -> str:
    """Return a value as a short text; equal numbers of all joints as one."""
    if isinstance(value, list) and value and all(number == value[0] for number in value):
        value = value[0]
    if isinstance(value, list):
        texts = ", ".join(map(_short, value))
        return f"[{texts}]"
    return f"{value:.4g}" if isinstance(value, float) else show_value(value)
