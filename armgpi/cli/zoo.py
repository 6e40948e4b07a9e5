"""The command that runs every arm."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from armgpi.cli import options as opt
from armgpi.cli.derive import write
from armgpi.cli.parsing import FAILED, refusal, stoppable
from armgpi.cli.terminal import say
from armgpi.escape import json_data


@stoppable
def zoo(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[ROBOT]...", help="Which ones; all by default.", show_default=False),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="Write the table to a Markdown file.")
    ] = None,
    report: opt.Report = None,
    as_json: opt.Json = False,
    reality: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Instead, draw drives, sensors, loads and moves of this reality: geared, elastic, owned ...",
            show_default=False,
        ),
    ] = None,
    tune: Annotated[
        int | None,
        typer.Option(
            metavar="NUMBER",
            min=9,
            help="Instead, tune each arm with so many candidates, beside the rule for untuned arms.",
            show_default=False,
        ),
    ] = None,
    count: Annotated[
        int,
        typer.Option(min=1, max=4096, help="Draws of each arm, with --reality; held-out ones, with --tune."),
    ] = 16,
    seed: Annotated[int, typer.Option(help="Of the draws, and of the search.")] = 0,
) -> None:
    """Run every arm that can be loaded with default gains, empty and loaded, and print one table.

    \b
    armgpi zoo ur5 panda
    armgpi zoo --out zoo.md
    armgpi zoo ur5 panda --reality geared --count 16
    armgpi zoo ur5 panda --tune 97
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.robot import robots

    for name in names or ():
        robots.locate(name)
    if tune is not None and reality is not None:
        raise refusal("--tune", "an arm is tuned on geared drives; leave --reality out")
    arms = names or list(robots.names())
    if reality is not None:
        shown = _run_draws(arms, reality, seed, count)
    else:
        shown = _nominal(arms) if tune is None else _tune_arms(arms, tune, seed, count)
    if out is not None:
        write(out, shown.table, "--out")
    if report is not None:
        write(report, _page(shown), "--report")
    if as_json:
        say(json.dumps(json_data([row._asdict() for row in shown.rows])))
    else:
        say(shown.table, lines=True)
    for remark in shown.remarks:
        say(remark, err=True)
    if shown.bad:
        sys.exit(FAILED)


def _page(shown: _Shown) -> str:
    """Return the table as a page."""
    from armgpi.viz import page

    kind = "bad" if shown.bad else "good"
    summary = f"<p class={kind}>{'Some have diverged.' if shown.bad else 'None has diverged.'}</p>"
    arms = {"Arms": page.from_markdown(shown.table, "arms")}
    return page.document("Every arm", summary + page.bullets(shown.remarks), arms)


class _Shown(NamedTuple):
    """Rows, their table, what is to be said besides, and whether the command failed."""

    rows: list[Any]
    table: str
    remarks: list[str]
    bad: bool


def _nominal(names: list[str]) -> _Shown:
    """Return the rows of arms as their URDFs have them."""
    from armgpi.health.zoo import markdown, run

    rows, _ = _each(names, run)
    return _Shown(rows, markdown(rows), [], any(row.end.startswith("diverged") for row in rows))


def _each(names: list[str], run: Callable[[str], list[Any]]) -> tuple[list[Any], list[str]]:
    """Return the rows of arms, one after the other, and which arms could not be run."""
    from armgpi.errors import ArmgpiError, BackendError

    rows, remarks = [], []
    for name in names:
        say(name, err=True)
        try:
            rows += run(name)
        except BackendError:  # none can be run
            raise
        except ArmgpiError as error:
            remarks.append(f"{name} was not run: {error}")
    return rows, remarks


def _run_draws(names: list[str], reality: str, seed: int, count: int) -> _Shown:
    """Return what comes of draws of a reality, tuned by nobody: lost arms are its result, not a failure."""
    from armgpi.errors import ParameterError
    from armgpi.health.reality import draws, markdown, outcomes
    from armgpi.plants.reality import Reality

    try:
        drawn = Reality(reality, seed)
    except ParameterError as error:
        raise refusal(f"--{'reality' if error.name == 'name' else error.name}", str(error)) from None
    law = {"type": "untuned"}
    found, remarks = _each(names, lambda name: outcomes(draws(drawn, name, count), name, law))
    by_arm = {name: [each for each in found if each.arm == name] for name in names}
    table = markdown({**{name: each for name, each in by_arm.items() if each}, "all": found}, "robot")
    return _Shown(found, table, remarks, not found)


def _tune_arms(names: list[str], evaluations: int, seed: int, count: int) -> _Shown:
    """Tune arms and return them beside the rule."""
    from armgpi.studies.zoo import MOST, markdown, run

    if seed < 0:
        raise refusal("--seed", f"expected 0 or more, got {seed}")
    if count > MOST:
        raise refusal("--count", f"expected at most {MOST} held-out draws, got {count}")
    rows, remarks = _each(names, lambda name: [run(name, evaluations, count, seed)])
    return _Shown(rows, markdown(rows), remarks, not rows)
