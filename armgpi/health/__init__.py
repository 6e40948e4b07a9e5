"""What is to be said of a robot before it is used: findings, a second reading, the zoo of arms."""

from armgpi.health.report import LEVELS, Finding, HealthReport, inspect, with_payload

__all__ = ["LEVELS", "Finding", "HealthReport", "inspect", "with_payload"]
