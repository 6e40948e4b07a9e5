"""The functions of exported C that change springs and a force limit while they act, and hand guiding."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from string import Template
from typing import Any, NamedTuple

import numpy as np

from armgpi.control.force_limited import ForceLimited
from armgpi.control.impedance import CartesianImpedance, Impedance
from armgpi.gpi.law import GPI
from armgpi.hardware.export.law import Law
from armgpi.hardware.export.layout import comma_lines

_LIMIT = """\
/* Number of limits of them: {meaning}. */
#define ARMGPI_SPRING_LIMITS ({count}U)
"""
_OF_LIMITS = ("limit_macro", "limit_note", "limit_prototype", "limit_function", "limit_method")
_LIMIT_NOTE = " *   limit       above 0 [{unit}]\n"
_LIMIT_PROTOTYPE = (
    "uint32_t armgpi_spring_limit(armgpi_state_t *state, const armgpi_real_t limit[ARMGPI_SPRING_LIMITS]);\n"
)


_LIMIT_METHOD = """\
    def spring_limit(self, values):
        \"\"\"Go to another limit of the springs, above 0 [{unit}]; False for what is refused.\"\"\"
        return bool(_C.armgpi_spring_limit(self._state, _vector(values, {count})))

"""


class ComplianceCode(NamedTuple):
    """What changes springs or a force limit; all empty for a controller that has none.

    Attributes:
        header: what the header in C declares.
        source: what the source in C defines.
        methods: of the class in Python.
    """

    header: str
    source: str
    methods: str

    def joined(self, other: ComplianceCode) -> ComplianceCode:
        """Return this code, and then another one's."""
        return ComplianceCode(*map(operator.add, self, other))


def springs_of(controller: Any) -> Impedance | None:
    """Return the impedance controller that another one is put around; None where there is none."""
    while not isinstance(controller, Impedance):
        if (controller := getattr(controller, "law", None)) is None:
            return None
    return controller


def limited_by(controller: Any) -> GPI | ForceLimited | None:
    """Return the controller with a force limit that another one is put around; None where there is none."""
    while controller is not None:
        if isinstance(controller, ForceLimited):
            return controller
        if isinstance(controller, GPI):
            return controller if controller.force_limit is not None else None
        controller = getattr(controller, "law", None)
    return None


def compliance_code(law: Law, literal: Callable[[float], str], read: Callable[[str], str]) -> ComplianceCode:
    """Return the functions for a controller's springs and for its force limit.

    Args:
        law: the controller as expressions.
        literal: makes C of a number.
        read: returns the text of a template.
    """
    return _springs_code(law, literal, read).joined(_limit_code(law, literal, read))


def _limit_code(law: Law, literal: Callable[[float], str], read: Callable[[str], str]) -> ComplianceCode:
    """Return the function for a force limit."""
    limited = limited_by(law.controller.law)
    if limited is None:
        return ComplianceCode("", "", "")
    [goal] = [part for part in law.state if part.path.endswith("limit.force_goal")]
    fill = {"least": literal(limited.least_limit), "zero": literal(0.0), "goal": goal.name}
    return _filled("force_limit", fill, read)


def _filled(templates: str, fill: Mapping[str, str], read: Callable[[str], str]) -> ComplianceCode:
    """Return the templates of this name, filled in."""
    texts = (Template(read(f"{templates}.{ending}")).substitute(fill) for ending in ("h", "c", "py"))
    return ComplianceCode(*texts)


def _springs_code(law: Law, literal: Callable[[float], str], read: Callable[[str], str]) -> ComplianceCode:
    """Return the functions for a controller's springs.

    Args:
        law: the controller as expressions.
        literal: makes C of a number.
        read: returns the text of a template.
    """
    springs = springs_of(law.controller.law)
    if springs is None:
        return ComplianceCode("", "", "")
    names = {part.path.rpartition(".")[2]: part for part in law.state if part.path.startswith("law.")}
    goal = names["goal"]
    limits = len(names["limit_goal"].symbols) if "limit_goal" in names else 0
    at_tool = isinstance(springs, CartesianImpedance)
    most = np.broadcast_to(springs._most, (len(goal.symbols),)).tolist()
    fill = {
        "kind": "x, y, z of the tool and rotations about them" if at_tool else "the joints",
        "unit": "N/m, and N m/rad of rotations" if at_tool else "N m/rad, N/m of sliding joints",
        "springs": str(len(most)),
        "state": goal.name.removesuffix("goal"),
        "most": comma_lines(f"    {literal(x)}" for x in most),
        "zero": literal(0.0),
        "one": literal(1.0),
        **dict.fromkeys(_OF_LIMITS, ""),
    }
    if limits:
        meaning = "their force" if at_tool else "the torque of each joint's"
        unit = "N" if at_tool else "N m, N of sliding joints"
        fill |= {
            "limit_macro": _LIMIT.format(meaning=meaning, count=limits),
            "limit_note": _LIMIT_NOTE.format(unit=unit),
            "limit_prototype": _LIMIT_PROTOTYPE,
            "limit_function": Template(read("springs_limit.c")).substitute(fill),
            "limit_method": _LIMIT_METHOD.format(unit=unit, count=limits),
        }
    return _filled("springs", fill, read)
