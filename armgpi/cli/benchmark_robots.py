"""The benchmark of robots: every arm that can be loaded."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armgpi.base import files
from armgpi.base.escape import json_data
from armgpi.cli.parsing import FAILED, refusal, stoppable
from armgpi.cli.terminal import say
from armgpi.cli.written import show

if TYPE_CHECKING:
    from armgpi.plants.reality import Reality
    from armgpi.studies.study import Part


#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "names <[ROBOT]...>": "Robots; by default all that can be loaded by name.",
    "out --out -o FOLDER": "Folder for the study of the arms and its table.",
    "reality NAME": "Instead, randomise drives, sensors, payloads and moves by this uncertainty model: "
    "geared, elastic, owned ...",
    "seed": "Seed of the randomised arms.",
}


@stoppable
def benchmark_robots(
    names: list[str] | None = None,
    out: Path | None = None,
    accept_code: bool = False,
    report: Path | None = None,
    as_json: bool = False,
    reality: str | None = None,
    count: Annotated[
        int, typer.Option(min=1, max=4096, help="Randomised arms of each robot, with --reality.")
    ] = 16,
    seed: int = 0,
) -> None:
    """Run every arm that can be loaded with default gains, empty and loaded, and print one table.

    With --out a benchmark that was stopped goes on where it was.

    \b
    armgpi benchmark robots ur5 panda
    armgpi benchmark robots --out robots
    armgpi benchmark robots ur5 panda --reality geared --count 16
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.health import reality as realities
    from armgpi.health import zoo as nominal
    from armgpi.robot import robots
    from armgpi.studies.study import Identity, Study, unkept

    for name in names or ():
        robots.locate(name)
    names = names or list(robots.names())
    drawn = None if reality is None else _reality(reality, seed)
    part: Part = unkept
    if out is not None:
        asked = {"method": "zoo", "reality": reality, "count": count, "seed": seed}
        part = Study.enter(out, Identity(asked), accept_code=accept_code).part
    if drawn is None:
        rows, remarks = _run_arms(part, names, nominal.Row, nominal.run)
        table, failed = nominal.markdown(rows), any(row.end.startswith("diverged") for row in rows)
    else:  # tuned by nobody: lost arms are the result, not a failure

        def run(name: str) -> list[Any]:
            return realities.outcomes(realities.draws(drawn, name, count), name, {"type": "gpi_auto"})

        rows, remarks = _run_arms(part, names, realities.Outcome, run)
        by_arm = {arm: list(own) for arm, own in groupby(rows, lambda row: row.arm)}
        table, failed = realities.markdown({**by_arm, "all": rows}, "robot"), not rows
    text = "\n\n".join([table, *remarks])
    data = json_data([row._asdict() for row in rows]) if as_json else None
    say(_world(reality), err=True)
    show("Every arm", text, data, [] if out is None else [files.write(out / "zoo.md", text)], report)
    if failed:
        sys.exit(FAILED)


def _world(reality: str | None) -> str:
    """Return the world of the arms, in the words of the other commands."""
    from armgpi.health.zoo import BITS, DELAY

    if reality is not None:
        return f"world: arms of the uncertainty model {reality}; controller gpi_auto"
    return (
        f"world: ideal but for its sensors: stiff joints, no rotors, no friction, {BITS}-bit encoders, delay "
        f"{DELAY} sample{'s' * (DELAY != 1)}; controller gpi"
    )


def _reality(name: str, seed: int) -> Reality:
    """Return an uncertainty model by its name."""
    from armgpi.errors import ParameterError
    from armgpi.plants.reality import Reality

    try:
        return Reality(name, seed)
    except ParameterError as error:
        raise refusal(f"--{'reality' if error.name == 'name' else error.name}", str(error)) from None


def _run_arms(
    part: Part, names: list[str], kind: Callable[..., Any], run: Callable[[str], list[Any]]
) -> tuple[list[Any], list[str]]:
    """Return the rows of arms, one after the other, and which arms could not be run."""
    from armgpi.errors import ArmgpiError, BackendError
    from armgpi.studies.study import BadPart, NoRoom, part_name, rows

    found, remarks = [], []
    for name in names:
        say(name, err=True)
        try:
            found += rows(part, part_name(name), kind, partial(run, name))
        except (BackendError, BadPart, NoRoom):  # none can be run or kept
            raise
        except ArmgpiError as error:
            remarks.append(f"{name} was not run: {error}")
            say(remarks[-1], err=True)
    return found, remarks
