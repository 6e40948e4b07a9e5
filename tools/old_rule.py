"""Write what the automatic tuning of another version of armgpi chooses, for tools/first_rule.py.

Runs in a worktree of that version, whose packages are those of this one:

    git worktree add /tmp/old 24301f33
    python tools/first_rule.py --requests requests.json
    cd /tmp/old && PYTHONPATH=/tmp/old python ROOT/tools/old_rule.py requests.json old.json
    python tools/first_rule.py --old old.json
"""

from __future__ import annotations

import json
import math
import sys
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

import armgpi


def plain(value: Any) -> Any:
    """Return a value of a controller as JSON has it."""
    return value.tolist() if isinstance(value, np.ndarray) else value


def chosen(request: dict[str, Any], robots: dict[str, Any]) -> dict[str, Any]:
    """Return what the rule of that version chooses for an arm."""
    name = request["arm"]
    if name not in robots:
        robot = armgpi.Robot.load(name, request["locked"])
        assume = getattr(armgpi, "assume_drives", None) or armgpi.believe_drives
        robots[name] = assume(robot)
    robot = robots[name]
    if request["effort"] is not None:
        effort = [math.inf if limit is None else limit for limit in request["effort"]]
        robot = robot.with_limits(effort=np.array(effort))
    nominal = robot.scaled_inertia(request["inertia_scale"])
    if request.get("drives"):
        nominal = nominal.with_drives(request["drives"])
    try:
        rule = import_module("armgpi.tuning.rule")
    except ModuleNotFoundError:
        rule = import_module("armgpi.gpi.untuned")
    found = rule.apply_rule(nominal, request["dt"], request["delay"], request["bits"])
    found = dict(found if isinstance(found, dict) else found.values)
    loads = found.pop("payload", None)
    values = {key: plain(value) for key, value in found.items()}
    if loads is not None:
        values["payload"] = [float(np.max(loads.heaviest)), plain(np.asarray(loads.com))]
    return {"arm": name, "index": request["index"], "values": values}


def main() -> None:
    """Write the file."""
    warnings.simplefilter("ignore")
    requests, out = map(Path, sys.argv[1:])
    robots: dict[str, Any] = {}
    rows = [chosen(request, robots) for request in json.loads(requests.read_text("utf-8"))]
    out.write_text(json.dumps(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
