"""The command that says what the log of an arm is, and replays it."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armgpi.base.escape import counted
from armgpi.cli import pictures
from armgpi.cli.parsing import FAILED, OK, refusal, stoppable
from armgpi.cli.terminal import say

if TYPE_CHECKING:
    from armgpi.loop.log import ArmLog, Replay
    from armgpi.robot.robot import Robot

#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "file <FILE>": "A log (.armlog) of hardware, of armgpi loop or of an export.",
    "replay EXPERIMENT": "Replay the log with the controller of this experiment file or of this folder "
    "of an export, and compare the torques.",
    "csv FILE": "Write the samples as a table.",
    "plot FILE": "Draw the estimated force on the tool with its interval; with --replay, whose robot it is.",
}
#: Torques of one law in Python, and in C on another machine, differ by roundings: this share of the largest.
_SAME = 1e-9


@stoppable
def log(
    file: Path,
    replay: Path | None = None,
    csv: Path | None = None,
    plot: Path | None = None,
    as_json: bool = False,
) -> None:
    """Summarise a log of an arm: duration, late samples, why it ended; or replay it through the controller.

    \b
    armgpi log motion.armlog
    armgpi log motion.armlog --replay controller --plot force.png
    armgpi report motion.armlog --robot my.urdf
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.base import files
    from armgpi.loop.log import read
    from armgpi.loop.log import replay as compare

    if plot is not None and csv is not None and plot.resolve() == csv.resolve():
        raise refusal("--csv", f"is the same file as --plot, {plot}; name another one")
    if plot is not None:
        if replay is None:
            raise refusal("--plot", "requires --replay FOLDER: the force is estimated by its robot")
        pictures.check(plot=plot)
    there = read(file)
    if plot is not None and len(there.samples) < 2:
        raise refusal("--plot", f"needs a log of two samples at least, {file} has {len(there.samples)}")
    law = None if replay is None else _law(replay)
    played = None if law is None else compare(there, law)
    facts, found = _facts(there, played), None
    if law is not None and len(there.samples) > 1:
        found = _estimated(there, law.robot)
        facts["wrench"] = _wrench(found)
    if csv is not None:
        files.write(csv, _table(there))
    if plot is not None and found is not None:
        from armgpi.viewing import plots

        plots.save(plots.wrench(found), plot)
    say(json.dumps(facts)) if as_json else _print(file, facts)
    for written in (csv, plot):
        if written is not None:
            say(f"wrote {written}", err=True)
    sys.exit(FAILED if played is not None and not facts["replay"]["same"] else OK)


def _law(path: Path) -> Any:
    """Return the supervised controller of an experiment file, or of the one in a folder."""
    from armgpi import config
    from armgpi.supervisor import Supervised

    file = path / "experiment.yaml" if path.is_dir() else path
    loaded = config.read(file)
    experiment = config.build(loaded.config, loaded.origin)
    law = next(iter(experiment.controllers.values()))
    return law if isinstance(law, Supervised) else Supervised(law, experiment.supervisor)


def _facts(there: ArmLog, played: Replay | None) -> dict[str, Any]:
    """Return the summary of a log as plain data."""
    import numpy as np

    rows, joints = there.samples, there.header["joints"]
    missed = np.maximum(rows["elapsed"].astype(np.int64) - 1, 0)
    known = np.isfinite(rows["applied"]).all(axis=1)
    facts: dict[str, Any] = {
        "made_by": there.header.get("made_by"),
        "robot": there.header.get("robot"),
        "joints": joints,
        "dt": there.header["dt"],
        "inputs": there.header["inputs"],
        "samples": len(rows),
        "seconds": float(there.t[-1] - there.t[0]) if len(rows) else 0.0,
        "starts": int(len(there.rows) - len(rows)),
        "missed": int(missed.sum()),
        "most_missed": int(missed.max(initial=0)),
        "applied_known": int(known.sum()),
        "fault": there.fault,
    }
    if len(rows):
        with np.errstate(invalid="ignore"):
            error = np.nan_to_num(np.abs(rows["q_measured"] - rows["q_ref"])).max(axis=0)
        facts["error"] = dict(zip(joints, error.tolist(), strict=True))
        facts["torque"] = dict(zip(joints, np.abs(there.tau).max(axis=0).tolist(), strict=True))
    if played is not None:
        largest = max(facts.get("torque", {}).values(), default=0.0)
        facts["replay"] = {
            "samples": played.samples,
            "difference": dict(zip(joints, played.difference.tolist(), strict=True)),
            "first": played.first,
            "status": played.status,
            "same": bool(played.difference.max() <= _SAME * largest) and played.status is None,
        }
    return facts


def _estimated(there: ArmLog, robot: Robot) -> Any:
    """Return a log as a rollout with the force on the tool that its torques tell."""
    from armgpi.loop.log import to_rollout
    from armgpi.loop.wrench import tool_wrench

    return tool_wrench(to_rollout(there, robot), robot)


def _wrench(found: Any) -> dict[str, Any]:
    """Return the estimated force of a rollout where it was largest and at the end."""
    import numpy as np

    names = ("estimated_force", "estimated_force_low", "estimated_force_high")
    force, low, high = (found[name].values for name in names)
    largest = int(np.argmax(np.linalg.norm(force, axis=-1)))
    return {
        word: {
            "time": float(found["time"].values[at]),
            "force": force[at].tolist(),
            "low": low[at].tolist(),
            "high": high[at].tolist(),
        }
        for word, at in (("largest", largest), ("last", len(force) - 1))
    }


def _print_wrench(wrench: dict[str, Any]) -> None:
    """Print the force on the tool, axis by axis with its interval."""
    for word, each in wrench.items():
        axes = zip("xyz", each["force"], each["low"], each["high"], strict=True)
        parts = ", ".join(f"{axis} {force:.3g} ({low:.3g} to {high:.3g})" for axis, force, low, high in axes)
        say(f"  {word + ' force':15} {parts} N on the tool at {each['time']:.4g} s, estimated")


def _print(file: Path, facts: dict[str, Any]) -> None:
    """Print the summary of a log."""
    from armgpi.supervisor.reasons import remedy

    of = f" of {facts['robot']}" if facts["robot"] else ""
    say(
        f"{file}: {counted(facts['samples'], 'sample')}{of}, {facts['seconds']:.4g} s at "
        f"{1.0 / facts['dt']:.6g} Hz, {counted(len(facts['joints']), 'joint')}"
    )
    say(f"  written by      {facts['made_by'] or 'not recorded'}")
    missed = f"{counted(facts['missed'], 'sample')}, at most {facts['most_missed']} in a row"
    late = missed if facts["missed"] else "none"
    say(f"  missed          {late}")
    recorded = f"recorded in {counted(facts['applied_known'], 'sample')}"
    said = recorded if facts["applied_known"] else "not recorded"
    say(f"  torque applied  {said}")
    say(f"  fault           {facts['fault'] or 'none'}")
    if facts["fault"]:
        say(f"                  {remedy(facts['fault'].split()[2])}")
    for name, values in (("largest error", facts.get("error")), ("largest torque", facts.get("torque"))):
        if values:
            joint = max(values, key=values.__getitem__)
            say(f"  {name:15} {values[joint]:.4g} ({joint})")
    if "wrench" in facts:
        _print_wrench(facts["wrench"])
    if (played := facts.get("replay")) is None:
        return
    if played["first"] is None:
        say(f"  replay          the same torques to the bit in {counted(played['samples'], 'sample')}")
    else:
        joint = max(played["difference"], key=played["difference"].__getitem__)
        say(
            f"  replay          at most {played['difference'][joint]:.3g} N m or N apart ({joint}), "
            f"first in sample {played['first']}"
        )
    if played["status"] is not None:
        say(f"                  the status or reason differs from sample {played['status']} on")


def _table(there: ArmLog) -> str:
    """Return the samples as CSV: time, then each quantity joint by joint, as `armgpi identify` reads it."""
    import numpy as np

    rows, joints = there.samples, there.header["joints"]
    short = {"q_measured": "q", "v_measured": "v"}
    names = [*there.header["inputs"], "tau"]
    names += ["applied"] if np.isfinite(rows["applied"]).all() else []
    titles = ["time", *(f"{short.get(name, name)}_{joint}" for name in names for joint in joints)]
    values = np.concatenate([there.t[:, None], *(rows[name] for name in names)], axis=1)
    return "\n".join([",".join(titles), *(",".join(map(repr, row)) for row in values.tolist())]) + "\n"
