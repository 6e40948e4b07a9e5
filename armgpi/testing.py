"""For the tests of your own models: the report of a validation as an assertion."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from os import PathLike
from typing import Any

from armgpi.errors import ArmgpiWarning, ParameterError
from armgpi.robot.robot import Robot
from armgpi.validation.check import validate
from armgpi.validation.models import ARGUMENTS
from armgpi.validation.report import DynamicsReport


def assert_dynamics(
    model: Any, robot: Robot | str | PathLike[str], *, require: Iterable[str] = (), **options: Any
) -> DynamicsReport:
    """Assert that hand-derived dynamics agree with a robot's, for a test suite.

    Functions of a state that the model has and nothing compares are named in a warning, which pytest lists.

    Args:
        model: as in :func:`armgpi.validate`.
        robot: the reference.
        require: functions that have to be compared: ``("mass_matrix", "gravity")``.
        options: as in :func:`armgpi.validate`.

    Returns:
        The report.

    Raises:
        AssertionError: when they do not agree; its text is the report. Or when one that is required was not
            compared.
        ArmgpiError: as :func:`armgpi.validate`.
    """
    __tracebackhide__ = True
    required = (require,) if isinstance(require, str) else tuple(require)
    for name in required:
        if name not in ARGUMENTS:
            raise ParameterError("require", name, f"names of {', '.join(ARGUMENTS)}")
    report = validate(model, robot, **options)
    if not report.agrees:
        raise AssertionError(f"\n{report}")
    compared = [one.function for one in report.functions]
    if lacking := [name for name in required if name not in compared]:
        raise AssertionError(f"not compared: {', '.join(lacking)}; compared: {', '.join(compared)}")
    if report.uncompared:
        text = f"{report.model}: not compared: {', '.join(report.uncompared)}"
        warnings.warn(text, ArmgpiWarning, stacklevel=2)
    return report


def __dir__() -> list[str]:
    """Return the public names, without what is imported here."""
    return ["assert_dynamics"]
