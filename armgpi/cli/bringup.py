"""The command that writes the stages of a bring-up, and judges their logs."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from armgpi.base.verdict import Verdict
from armgpi.base.verdict import judge as judged
from armgpi.cli.parsing import refusal, stoppable
from armgpi.cli.terminal import say

if TYPE_CHECKING:
    from armgpi.hardware.realtime.judge import Verdict as Seen
    from armgpi.hardware.realtime.stages import Folder

#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "what <FILE | check LOG...>": "Experiment file of the arm; or 'check' and the logs of stages, named "
    "after the stages.",
    "out --out -o FOLDER": "Folder for the stages.",
    "floor METRES": "Height above which all links stay while the arm is excited [m].",
}


@stoppable
def bringup(
    what: list[str],
    out: Path = Path("bringup"),
    floor: float | None = None,
    allow_part: bool = False,
    as_json: bool = False,
) -> None:
    """Write the commissioning stages from a dry run to full speed, with their limits, or check their logs.

    \b
    armgpi bringup my_arm.yaml -o bringup
    armgpi loop bringup/10-dry.yaml --dry-run --clock simulated --log bringup/10-dry.armlog
    armgpi bringup check bringup/*.armlog
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.hardware.realtime import judge, stages

    if what[0] == "check":
        logs = [Path(each) for each in what[1:]]
        if not logs or len({log.parent for log in logs}) > 1:
            raise refusal("check", "expected logs of one folder, such as bringup/*.armlog")
        folder = stages.read(logs[0].parent)
        seen = judge.judge(folder, logs)
        verdict = _verdict(seen, allow_part)
        if as_json:
            say(json.dumps({**seen.plain(), "verdict": verdict.plain()}))
        else:
            _print(seen, folder, verdict)
        sys.exit(verdict.exit_code)
    from armgpi import config

    if len(what) > 1:
        raise refusal("", f"expected one experiment file, or check and logs, got {what[1]!r} as well")
    loaded = config.read(Path(what[0]))
    folder = stages.write(loaded, config.build(*loaded), out, floor)
    say(
        f"{len(folder.stages)} stages in {out}; keep a hand on the emergency stop, and everybody out "
        "of reach of the arm"
    )
    _say_next(folder, 0)


def _say_next(folder: Folder, place: int) -> None:
    """Print how a stage is run."""
    stage = folder.stages[place]
    file = folder.path / stage.name
    match stage.kind:
        case "dry":
            ways = (f"{joint} {x:+.2g}" for joint, x in zip(stage.joints, stage.way, strict=True))
            does = (
                "no torque is sent; move each joint by hand, one after another, and back again: "
                f"{', '.join(ways)}"
            )
        case "pulse" | "joint":
            does = (
                f"{stage.joints[0]} goes {stage.way[0]:+.2g} rad or m and back; the other joints "
                "hold their positions"
            )
        case "excite":
            does = "the whole arm moves slowly, to be identified"
        case "slow":
            does = "the motion of the experiment file, four times slower"
        case _:
            does = "the motion of the experiment file, without stage limits"
    say(f"next: {stage.name}: {does}")
    dry = " --dry-run" if stage.kind == "dry" else ""
    say(f"  armgpi loop {file}.yaml{dry} --clock simulated --log {file}.armlog   (a simulated arm)")
    say(f"  armgpi export --config {file}.yaml --target ... -o {file}   (its README: how to run it)")
    say(f"  armgpi bringup check {folder.path}/*.armlog")


def _verdict(seen: Seen, allow_part: bool) -> Verdict:
    """Return the verdict; what no stage that is still to come tests is left out."""
    from armgpi.hardware.realtime.judge import QUESTIONS

    if seen.findings:
        return judged(False, "STOP: correct this before you run the next stage")
    left_out = []
    if seen.following is None:
        for question, joints in seen.untested.items():
            if joints:
                of = "" if joints == ("",) else f" ({', '.join(joints)})"
                left_out.append(f"{QUESTIONS[question]}{of}")
    return judged(True, "no fault was found in what was tested", left_out, accepted=allow_part)


def _print(verdict: Seen, folder: Folder, judgement: Verdict) -> None:
    """Print a verdict: what is wrong or fine, what was tested, what was not, and what comes next."""
    from armgpi.hardware.realtime.judge import QUESTIONS

    colours = {"good": "green", "fair": "yellow", "bad": "red"}
    say(judgement.line, fg=colours[judgement.page_class])
    for each in verdict.findings:
        say(f"  {each}")
    count = len(folder.stages[0].joints)
    for title, found in (("tested", verdict.passed), ("not tested", verdict.untested)):
        for question, joints in found.items():
            if joints:
                of = "" if joints == ("",) or len(joints) == count else f": {', '.join(joints)}"
                say(f"  {title:11} {QUESTIONS[question]}{of}")
    if verdict.following is not None:
        _say_next(folder, folder.stages.index(verdict.following))
    elif not verdict.findings:
        say("all stages are done")
