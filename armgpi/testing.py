"""For the tests of your own models: the report of a validation as an assertion."""

from __future__ import annotations

from os import PathLike
from typing import Any

from armgpi.robot.robot import Robot
from armgpi.validation.check import validate
from armgpi.validation.report import DynamicsReport


def assert_dynamics(model: Any, robot: Robot | str | PathLike[str], **options: Any) -> DynamicsReport:
    """Assert that hand-derived dynamics agree with a robot's, for a test suite.

    Args:
        model: as in :func:`armgpi.validate`.
        robot: the reference.
        options: as in :func:`armgpi.validate`.

    Returns:
        The report.

    Raises:
        AssertionError: when they do not agree; its text is the report.
        ArmgpiError: as :func:`armgpi.validate`.
    """
    __tracebackhide__ = True
    report = validate(model, robot, **options)
    if not report.agrees:
        raise AssertionError(f"\n{report}")
    return report
