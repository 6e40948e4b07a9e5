"""What is known of a robot before it is used: findings, a second reading, the zoo of arms.

Takes a robot and the experiment that it is for.
Gives findings and a report.
"""

from armgpi.health.findings import LEVELS, Finding, check
from armgpi.health.report import HealthReport, inspect, with_payload

__all__ = ["LEVELS", "Finding", "HealthReport", "check", "inspect", "with_payload"]


def __dir__() -> list[str]:
    """Return the public names, without what is imported here."""
    return __all__
