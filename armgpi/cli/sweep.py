"""The command that runs an experiment many times with other numbers."""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armgpi.base import files
from armgpi.base.escape import counted, json_data
from armgpi.base.verdict import Verdict, judge
from armgpi.cli.parsing import refusal, stoppable
from armgpi.cli.terminal import progress, say
from armgpi.errors import require_extra

# What takes long to import is imported by the command, so that --help answers at once.
if TYPE_CHECKING:
    from armgpi.config import Loaded
    from armgpi.studies.sample import Sweep
    from armgpi.studies.study import Study

#: Most rollouts of a sweep.
_MOST = 10**9
#: Most rows of the table of what failures depend on.
_MOST_ROWS = 8


#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "file <FILE>": (
        "Experiment file with `vary:` or an uncertainty model (`reality:`); or the folder "
        "of an identified arm."
    ),
    "out --out -o FOLDER": "Folder for chunks and results, one for each study.",
    "rollouts NUMBER": "Number of rollouts, such as 1e6.",
    "sampling": "random, or sobol: points that fill the space evenly.",
    "rare": "Estimate rare failures by subset simulation, with --rollouts in each level.",
    "cluster ADDRESS": "A Dask scheduler, such as tcp://host:8786.",
}


@stoppable
def sweep(
    file: Path,
    out: Path = Path("swept"),
    rollouts: str = "1000",
    sampling: str = "random",
    rare: bool = False,
    workers: Annotated[int, typer.Option(min=1, help="Dask workers on this machine; 1 for none.")] = 1,
    cluster: str | None = None,
    report: Path | None = None,
    accept_code: bool = False,
    allow_part: bool = False,
    as_json: bool = False,
) -> None:
    """Run an experiment many times with random values and estimate how often it fails, with intervals.

    A sweep that was stopped goes on where it was when it is started again.

    \b
    armgpi sweep study.yaml --rollouts 10000 --out study
    armgpi sweep study.yaml --rollouts 1e6 --out study --workers 2 --report study.html
    armgpi sweep study.yaml --rollouts 2000 --out study --rare
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.config.building import summary
    from armgpi.studies.sample import Sweep

    require_extra("casadi", "compiled")
    if report is not None:
        require_extra("trimesh", "viz")
    if workers > 1 or cluster is not None:
        require_extra("dask", "cluster")
        require_extra("distributed", "cluster")
    count = _count(rollouts)
    asked = Sweep.of(*_read(file), sampling)
    study = asked.enter(out, accept_code)
    say(summary(asked.experiment), err=True)
    if rare:
        others = {"--workers": workers > 1, "--cluster": cluster is not None, "--report": report is not None}
        for option in (name for name, given in others.items() if given):
            raise refusal(option, "--rare has its levels one after the other in this process, and no page")
        sys.exit(_rare(asked, study, count, as_json).exit_code)
    sys.exit(_run_sweep(asked, study, count, workers, cluster, report, as_json, allow_part).exit_code)


def _read(file: Path) -> Loaded:
    """Return an experiment file, or one that draws arms from the folder of an identified arm."""
    from armgpi.config import Loaded, Origin, check, read
    from armgpi.config.arms import IDENTIFICATION
    from armgpi.robot.robots import find_identified

    if find_identified(file) is None:
        return read(file)
    # The arm and controller that `armgpi run` has of the same folder.
    data = {"robot": str(file), "ideal": False, "vary": {IDENTIFICATION: {}}}
    origin = Origin(str(file))
    return Loaded(check(data, origin), origin)


def _run_sweep(
    sweep: Sweep,
    study: Study,
    count: int,
    workers: int,
    cluster: str | None,
    report: Path | None,
    as_json: bool,
    allow_part: bool,
) -> Verdict:
    """Run and print a sweep, and return its verdict: for part where chunks were not run."""
    from armgpi.studies import results

    if not _run_chunks(sweep, study, count, workers, cluster):
        verdict = Verdict("not judged", f"none of {counted(count, 'rollout')} was run")
        say(verdict.line, err=True, fg="red")
        return verdict
    rollouts = results.collect(sweep, study, count)
    ran = rollouts.sizes["rollout"]
    left_out = []
    if ran < count:
        left_out.append(f"{counted(count - ran, 'rollout')} of broken chunks")
    were = "was" if count == 1 else "were"
    verdict = judge(True, f"{ran} of {counted(count, 'rollout')} {were} run", left_out, accepted=allow_part)
    summary = results.summary(sweep, rollouts)
    written = results.write(sweep, rollouts, summary, study.folder)
    if as_json:
        say(json.dumps(json_data({**summary, "verdict": verdict.plain()})))
    else:
        if left_out:
            say(verdict.line, fg="yellow")
        _print(sweep, summary, results.sentences(summary))
    if report is not None:
        from armgpi.studies import page
        from armgpi.viewing.report import write

        unseen = verdict.line if left_out else ""
        written.append(write(page.html(sweep, rollouts, summary, unseen), report))
    say(f"wrote {counted(len(written), 'file')} to {study.folder}", err=True)
    if report is None and not as_json:
        say(f"Next: add --report {study.folder.name}.html for distributions and the worst rollout", err=True)
    return verdict


def _run_chunks(sweep: Sweep, study: Study, count: int, workers: int, cluster: str | None) -> bool:
    """Run the chunks of a sweep that its study does not have, and tell whether it has any of them then.

    Chunks that could not be run or written are named on stderr, once for each reason.
    """
    from armgpi.studies import workers as running
    from armgpi.studies.sample import chunk_name

    chunks = [(i, sweep.rows(i, count)) for i in range(math.ceil(count / sweep.size))]
    missing = [(i, rows) for i, rows in chunks if not study.has(chunk_name(i, rows))]
    to_run = sum(rows for _, rows in missing)
    run = 0
    begun = time.monotonic()
    with progress() as told:

        def count_rows(rows: int) -> None:
            nonlocal run
            run += rows
            rate = run / max(time.monotonic() - begun, 1e-9)
            seconds_left = (to_run - run) / rate
            told(f"{count - to_run + run} of {count}, {rate:.3g}/s, {seconds_left:.0f} s left")

        broken = running.run(study.folder, missing, count_rows, workers, cluster)  # chunk -> reason
    for i, rows in chunks:
        if i not in broken and not study.has(chunk_name(i, rows)):
            broken[i] = f"no worker has written it to {study.folder}"
    for reason in dict.fromkeys(broken.values()):
        first, *others = [chunk for chunk, its_reason in broken.items() if its_reason == reason]
        which = f"chunk {first} and {len(others)} others are" if others else f"chunk {first} is"
        say(f"{which} broken: {reason}", err=True, fg="yellow")
    return len(broken) < len(chunks)


def _rare(sweep: Sweep, study: Study, count: int, as_json: bool) -> Verdict:
    """Say how probable failures are that are too rare to occur in random rollouts, and return the verdict."""
    from armgpi.studies import rare
    from armgpi.studies.results import write_worst

    found, last, check = rare.simulate(
        sweep, study, count, lambda rows: say(f"a level of {counted(rows, 'rollout')}", err=True)
    )
    summary = rare.summary(sweep, found, last, check)
    verdict = rare.judge_levels(summary)
    if as_json:
        say(json.dumps(json_data({**summary, "verdict": verdict.plain()})))
    else:
        if verdict.exit_code:
            say(verdict.line, fg="yellow")
        for sentence in rare.sentences(summary):
            say(sentence)
    written = [files.write(study.folder / "rare.json", json.dumps(summary, indent=2) + "\n")]
    written += write_worst(study.folder / "rare", rare.worst(sweep, last))
    say(f"wrote {counted(len(written), 'file')} to {study.folder}", err=True)
    return verdict


def _count(text: str) -> int:
    """Return the number of rollouts."""
    try:
        count = float(text)
    except ValueError:
        count = 0.0
    if not 1.0 <= count <= _MOST or count != round(count):
        raise refusal("--rollouts", f"expected a whole number from 1 to {_MOST:.0e}, got {text!r}")
    return int(count)


def _print(sweep: Sweep, summary: dict[str, Any], sentences: list[str]) -> None:
    """Print the results of a sweep: failures, quantiles of metrics, and what failures depend on."""
    from armgpi.studies.results import failure_words

    say(f"{sweep.label} on {sweep.robot.name}, {counted(summary['rollouts'], 'rollout')}")
    say(f"failed means: {failure_words(sweep)}")
    for sentence in sentences:
        say(sentence)
    _print_quantiles(sweep, summary["quantiles"])
    _print_dependence(sweep, summary["failure by quantity"])
    for pair in summary["failure by two of them"][:1]:
        most = max(pair["parts"], key=lambda part: part["lower"])
        at = [_part(*ends) for ends in zip(most["from"], most["to"], strict=True)]
        say(f"Both together: {' and '.join(pair['of'])} fail most at {' and '.join(at)}: {_percent(most)}")


def _print_quantiles(sweep: Sweep, quantiles: dict[str, Any]) -> None:
    """Print the quantiles of the metrics with their intervals."""
    from rich.table import Table

    from armgpi.cli.terminal import console, widen
    from armgpi.loop import metrics
    from armgpi.loop.units import NEWTON
    from armgpi.studies.results import heading, quantile_words

    table = Table(title="Quantiles over all rollouts (95 % intervals)")
    table.add_column("metric")
    heads: list[str] = []
    for each in metrics.shown_in("terminal"):
        values = quantiles.get(each.name)
        if values is None:
            continue
        if each.unit == NEWTON and not any(x["value"] for x in values.values()):
            continue  # nothing touched anything
        if not heads:
            heads = [f"{100 * float(share):g} %" for share in values]
            for head in heads:
                table.add_column(head, no_wrap=True)
        table.add_row(heading(sweep, each.name), *(quantile_words(x) for x in values.values()))
    if heads:
        screen = console()
        widen(screen, table)
        screen.print(table)


def _print_dependence(sweep: Sweep, by_number: dict[str, Any]) -> None:
    """Print in which part of each range fewest and most rollouts failed, for those where it differs most."""
    from rich.table import Table

    from armgpi.cli.terminal import console, widen
    from armgpi.studies.results import drawn_heading

    rows = []
    for name, parts in by_number.items():
        low, high = min(parts, key=_value), max(parts, key=_value)
        if _value(high) > _value(low):
            rows.append((_value(high) - _value(low), name, low, high))
    if not rows:
        return
    rows.sort(key=lambda row: row[0], reverse=True)
    table = Table(title="Share of rollouts that failed, by what was varied (95 % intervals)")
    for heading in ("varied", "fails least", "at", "fails most", "at"):
        table.add_column(heading, no_wrap=True)
    for _, name, low, high in rows[:_MOST_ROWS]:
        table.add_row(
            drawn_heading(sweep, name),
            _percent(low),
            _part(low["from"], low["to"]),
            _percent(high),
            _part(high["from"], high["to"]),
        )
    screen = console()
    widen(screen, table)
    screen.print(table)
    if (more := len(rows) - _MOST_ROWS) > 0:
        say(f"{more} more, on which failures depend less, are in summary.json")


def _value(part: dict[str, Any]) -> float:
    return float(part["value"] or 0.0)


def _part(low: float, high: float) -> str:
    return f"{low:.3g}" + ("" if high == low else f"..{high:.3g}")


def _percent(part: dict[str, Any]) -> str:
    low, high = (f"{100.0 * part[end]:.3g}" for end in ("lower", "upper"))
    return f"{100.0 * part['value']:.3g} % ({low} to {high} %)"
