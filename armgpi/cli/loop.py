"""The command that runs arm and controller as two processes over UDP."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from armgpi.base.escape import counted
from armgpi.cli import options as opt
from armgpi.cli.declared import values_of
from armgpi.cli.parsing import FAILED, INTERRUPTED, OK, per_joint, refusal, refusal_of, stoppable
from armgpi.cli.terminal import print_held, say

if TYPE_CHECKING:
    from armgpi.config import Experiment
    from armgpi.hardware.realtime import Injected, Outcome, Watchdog

#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "clock NAME": "'wall': two processes in wall-clock time (default); 'simulated': one, always the same.",
    "policy NAME": "Scheduling: 'fifo' (real time), 'other', or 'auto': real time where it is allowed "
    "(default).",
    "exported": "Run the controller as exported C.",
    "loss SHARE": "Share of datagrams that are dropped; none by default.",
    "outage BEGIN,LENGTH": "Interval in which all datagrams are dropped: begin,length [s].",
    "stall BEGIN,LENGTH": "Interval in which the controller is stopped: begin,length [s].",
    "kill SECONDS": "Time at which the controller is killed [s].",
    "watchdog SAMPLES": "Samples without a torque that the arm tolerates; 12 by default.",
    "reaction NAME": "What the arm does without a torque: 'damping' (default), 'gravity', 'hold' the "
    "last torque, 'zero'.",
    "dry_run": (
        "Send no torque: the arm is moved along the reference by hand, and controller and "
        "supervisor only compute."
    ),
    "log FILE": "Write the controller's log (.armlog) there.",
    "view": "Serve a page that shows the arm while it moves.",
}


@stoppable
@opt.add_options
def loop(
    context: typer.Context,
    robot: str | None = None,
    controller: str | None = None,
    clock: str = "wall",
    policy: str = "auto",
    exported: bool = False,
    loss: float = 0.0,
    outage: str | None = None,
    stall: str | None = None,
    kill: float | None = None,
    watchdog: int = 12,
    reaction: str = "damping",
    dry_run: bool = False,
    log: Path | None = None,
    view: bool = False,
    out: Path | None = None,
    force: bool = False,
    report: Path | None = None,
    explain: bool = False,
    as_json: bool = False,
    *,
    options: opt.Experiment,
) -> None:
    """Run arm and controller as two processes over UDP, in wall-clock time, with faults.

    \b
    armgpi loop ur5 --loss 0.2
    armgpi loop panda --kill 2 --policy fifo --out results
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.cli import pictures
    from armgpi.cli.arms import note_differences, note_drives
    from armgpi.cli.settings import settings
    from armgpi.cli.written import check_out
    from armgpi.config import build
    from armgpi.config import experiment as experiments
    from armgpi.hardware.realtime import run

    asked = opt.Asked(robot=robot, controllers=controller, declared=values_of(context), options=options)
    experiment = build(*settings(asked, compare=False))
    check_out(out, options.config, force, experiment)
    pictures.check(view=view, report=report)
    label = _only_label(experiment)
    _check_choices(clock, policy)
    injected = _injected(loss, outage, stall, kill, experiment.config.seed)
    how: dict[str, Any] = {"clock": clock, "policy": policy, "exported": exported, "dry_run": dry_run}
    how["watchdog"] = _watchdog(watchdog, reaction)
    note_drives(experiment, explain, options)
    note_differences(experiment)
    print_held()
    with ExitStack() as stack:
        outcome = run(
            *experiment.runs[label],
            experiment.reference,
            experiment.t_final,
            injected=injected,
            model=experiment.robot,
            supervisor=experiment.supervisor,
            **how,
            watch=_watcher(experiment, stack) if view else None,
        )
    found = outcome.report(None if dry_run else experiments.run(experiment, label, progress=False))
    for path in _write_files(experiment, outcome, found, out, report, log):
        say(f"wrote {path}", err=True)
    say(json.dumps(found)) if as_json else _print(label, outcome, found)
    sys.exit(_code(outcome))


def _check_choices(clock: str, policy: str) -> None:
    """Refuse a clock or a scheduling that there is not."""
    from armgpi.base.arrays import check_choice
    from armgpi.hardware.realtime.processes import POLICIES
    from armgpi.hardware.realtime.running import CLOCKS

    check_choice(clock, "clock", CLOCKS)
    check_choice(policy, "policy", POLICIES)


def _injected(loss: float, outage: str | None, stall: str | None, kill: float | None, seed: int) -> Injected:
    """Return the faults that the options of these names describe."""
    from armgpi.hardware.realtime import Injected

    return Injected(loss, _stretch(outage, "--outage"), _stretch(stall, "--stall"), kill, seed)


def _watchdog(samples: int, reaction: str) -> Watchdog:
    """Return what the arm does without a torque; its parameter `samples` is the option --watchdog."""
    from armgpi.errors import ParameterError
    from armgpi.hardware.realtime import Watchdog

    try:
        return Watchdog(samples, reaction)
    except ParameterError as error:
        if error.name != "samples":
            raise
        raise refusal_of("--watchdog", error) from None


def _only_label(experiment: Experiment) -> str:
    """Return the label of the one run that an experiment has."""
    label, *others = experiment.runs
    if others:
        raise refusal("--plant", "armgpi loop takes one plant")
    return label


def _write_files(
    experiment: Experiment,
    outcome: Outcome,
    found: dict[str, Any],
    out: Path | None,
    report: Path | None,
    log: Path | None,
) -> list[Path]:
    """Write what was asked for, and return the files."""
    from armgpi.config import dump, world
    from armgpi.config import experiment as experiments
    from armgpi.loop.log import pack, write

    paths: list[Path] = []
    if log is not None and outcome.log is not None:
        paths.append(write(outcome.log, log))
    if out is not None:
        files: dict[str, str | bytes] = {"loop.json": json.dumps(found, indent=2) + "\n"}
        if outcome.log is not None:
            files["loop.armlog"] = pack(outcome.log)
        paths += experiments.save(outcome.rollout, experiment, out, files)
    if report is not None:
        from armgpi.viewing import report as reports

        page = reports.build(
            outcome.rollout,
            experiment.robot,
            configuration=dump(experiment.config),
            world=world.describe(experiment.config, experiment.robot),
        )
        paths.append(reports.write(page, report))
    return paths


def _code(outcome: Outcome) -> int:
    """Return the exit code: also a controller that stopped the arm, or was given up, has failed."""
    from armgpi.loop.rollout import Status

    status = Status(int(outcome.rollout["status"]))
    if status == Status.INTERRUPTED:
        return INTERRUPTED
    stopped = outcome.latched or (outcome.fault is not None and outcome.fault.reason != "none")
    return FAILED if stopped or status == Status.DIVERGED else OK


def _watcher(experiment: Experiment, stack: ExitStack) -> Callable[[dict[str, Any]], None]:
    """Serve a page on which the arm moves as it does, with how late it wakes, and return what moves it."""
    from armgpi.hardware.realtime.outcome import EDGES
    from armgpi.viewing import meshcat

    robot = experiment.robot
    server = stack.enter_context(meshcat.Server(meshcat.robot_page(robot, live=True)))
    say(f"{server.url}  (until the run ends)", err=True)
    names = [f"{low} to {high} us late" for low, high in zip(EDGES, [*EDGES[1:], "more"], strict=True)]

    def watch(state: dict[str, Any]) -> None:
        texts = {
            "time": f"{state['t']:.1f} s",
            "samples without a torque in time": f"{state['missed']} of {state['samples']}",
            "watchdog": "reports the controller as failed"
            if state["latched"]
            else f"acted {state['fired']} times",
        }
        server.show(state["q"], robot, texts, dict(zip(names, state["histogram"], strict=True)))

    return watch


def _stretch(text: str | None, option: str) -> tuple[float, float] | None:
    """Read begin and length of a time."""
    if text is None:
        return None
    numbers = per_joint(text, option)
    if not isinstance(numbers, list) or len(numbers) != 2:
        raise refusal(option, f"expected begin and length such as '2,0.02' [s], got {text!r}")
    return numbers[0], numbers[1]


def _print(label: str, outcome: Outcome, found: dict[str, Any]) -> None:
    """Print how the two kept up."""
    from armgpi.supervisor.reasons import remedy

    say(
        f"{label}: {counted(found['samples'], 'sample')}, {found['missed']} without a torque in time, "
        f"{found['filled']} filled"
    )
    for who, granted in found["granted"].items():
        if granted is not None:
            memory = "memory locked" if granted["memory_locked"] else "memory not locked"
            say(f"{who}: scheduling {granted['policy']}, {memory}")
    for name, times in (
        ("arm woke late by", found["lateness_us"]),
        ("controller took", found["controller_us"]),
    ):
        if times is not None:
            say(f"{name} [us]: " + ", ".join(f"{key} {value:g}" for key, value in times.items()))
    if found["lateness_us"] is not None:
        _print_histogram(found["histogram"])
    for name, ratio in found.get("error_ratio", {}).items():
        times_simulated = "" if ratio is None else f", {ratio:.3f} of the simulated"
        say(f"{name} error {found['error'][name]:.4g}{times_simulated}")
    if found["supervisor"] is not None:
        status, reason = found["supervisor"]["status"], found["supervisor"]["reason"]
        say(f"supervisor: {status}, fault: {reason} {remedy(reason)}".rstrip())
    watchdog = found["watchdog"]
    if watchdog["fired"]:
        dt = outcome.rollout["time"].values[1]
        times = ", ".join(f"{k * dt:.4g}" for k in watchdog["fired"][:5])
        say(f"watchdog: {len(watchdog['fired'])} times, at {times} s")
    if watchdog["travel"] is not None:
        say(f"the controller was given up; the arm moved by {watchdog['travel']:.4g} since the last torque")


def _print_histogram(histogram: dict[str, Any]) -> None:
    """Print a bar for each stretch of lateness that occurred."""
    edges, counts = histogram["edges_us"], histogram["counts"]
    most = max(counts)
    for low, high, count in zip(edges, [*edges[1:], None], counts, strict=True):
        if count:
            upto = "up" if high is None else f"{high}"
            say(f"  {low:>6} .. {upto:<6} {count:>8}  {'#' * max(1, round(40 * count / most))}")
