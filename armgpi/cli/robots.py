"""The command that lists robots."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from armgpi.base.escape import counted, json_data
from armgpi.cli.parsing import FAILED, as_option
from armgpi.cli.terminal import console as console_of
from armgpi.cli.terminal import say

if TYPE_CHECKING:
    from armgpi.health.findings import Finding

#: Kind of a finding -> what to say of it in a few words.
_REMARKS = {
    "effort": "effort limit 0: --effort",
    "gravity": "gravity beyond effort",
    "limits": "no range",
    "degrees": "degrees?",
    "velocity": "speed limits?",
    "triangle": "an inertia no body has",
    "friction": "strong damping",
    "condition": "ill-conditioned",
    "neutral": "0 outside limits",
}


#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "check": "Load each: joints, mass, reach, limits and remarks; seconds.",
}


def robots(
    check: bool = False,
    as_json: bool = False,
) -> None:
    """List the robots that can be loaded by name.

    \b
    armgpi robots
    armgpi robots --check
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.robot.robots import EXAMPLE_ROBOT_DATA, description_names, is_textbook, names

    found = names()
    rows = [_row(name) if check else _known_facts(name) for name in found]
    if as_json:
        say(json.dumps(rows))
    elif check:
        _show(rows)
    else:
        for row in rows:
            world = ["simulated as ideal: stiff joints, exact positions"] if is_textbook(row["name"]) else []
            say("  ".join((row["name"].ljust(max(map(len, found))), *row["remarks"], *world)).rstrip())
    if not set(EXAMPLE_ROBOT_DATA) & set(found):
        say("more robots come with: pip install example-robot-data", err=True)
    described = description_names()
    if described:
        text = f"and {len(described)} names of robot_descriptions, fetched at first use: {described[0]}, ..."
        say(text, err=True)
    failed = [row["name"] for row in rows if check and row["n"] is None]
    if failed:
        say(f"{counted(len(failed), 'robot')} cannot be loaded: {', '.join(failed)}", err=True)
        sys.exit(FAILED)


def _known_facts(name: str) -> dict[str, Any]:
    """Return what is known of a robot before it is loaded."""
    from armgpi.robot.robots import EXAMPLE_ROBOT_DATA, locate

    known = EXAMPLE_ROBOT_DATA.get(name)
    told = [] if known is None else [known.remark, "an arm of a larger robot" if known.keep else ""]
    return {"name": name, "remarks": list(filter(None, told)), "source": str(locate(name)[0])}


def _row(name: str) -> dict[str, Any]:
    """Return the row of a robot."""
    from armgpi.errors import ArmgpiError
    from armgpi.health import report as health
    from armgpi.robot.robots import EXAMPLE_ROBOT_DATA

    try:
        report = health.inspect(name)
    except ArmgpiError as error:  # data of another version
        return {"name": name, "n": None, "remarks": [str(error)]}
    known = EXAMPLE_ROBOT_DATA.get(name)
    facts, joints = report.facts, report.as_dict()["joints"]
    return {
        "name": name,
        "n": facts["n"],
        "mass": round(facts["moving_mass"], 6),
        "reach": round(facts["reach"], 6),
        "effort": _range(joint["effort"] for joint in joints),
        "velocity": _range(joint["velocity"] for joint in joints),
        "continuous": [joint["name"] for joint in joints if joint["type"] == "continuous"],
        "locked": list(facts["locked"]),
        "remarks": [*_remarks(report.findings), *filter(None, [known.remark if known else ""])],
        "source": facts["source"],
    }


def _range(values: Iterable[float | None]) -> list[float | None]:
    """Return the smallest and largest of some limits; None for one that is infinite."""
    numbers = [math.inf if value is None else value for value in values]
    return list(json_data((min(numbers), max(numbers))))


def _remarks(findings: Iterable[Finding]) -> list[str]:
    """Return the findings in a few words each."""
    remarks: dict[str, None] = {}
    for finding in findings:
        if finding.kind == "gripper":
            remarks[f"gripper: {as_option(finding.remedies[0])}"] = None
        elif finding.kind in _REMARKS and (finding.level != "info" or finding.kind == "neutral"):
            remarks[_REMARKS[finding.kind]] = None
    return list(remarks)


def _show(rows: list[dict[str, Any]]) -> None:
    """Print a table."""
    from rich.table import Table

    console = console_of()
    table = Table(box=None, pad_edge=False)
    table.add_column("name", no_wrap=True)
    for heading in ("n", "kg", "reach m", "effort N m, N", "speed rad/s, m/s"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("remarks", overflow="fold")
    for row in rows:
        if row["n"] is None:
            table.add_row(row["name"], "-", "-", "-", "-", "-", row["remarks"][0])
            continue
        table.add_row(
            row["name"],
            str(row["n"]),
            f"{row['mass']:.3g}",
            f"{row['reach']:.2f}",
            _words(row["effort"]),
            _words(row["velocity"]),
            "; ".join(row["remarks"]),
        )
    console.print(table)


def _words(limits: list[float | None]) -> str:
    """Return a range of limits in words."""
    low, high = ("-" if x is None else f"{x:.3g}" for x in limits)
    return low if low == high else f"{low}..{high}"
