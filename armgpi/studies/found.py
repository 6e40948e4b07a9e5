"""What a search found, as files: tables, a report, and the experiment with the best numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from armgpi import files
from armgpi.config import experiment as experiments
from armgpi.errors import RolloutError
from armgpi.escape import csv_table, markdown_table
from armgpi.loop import metrics
from armgpi.studies.optimise import Row, Search, Validated
from armgpi.studies.setup import Wanted, best_file
from armgpi.studies.study import Study

STUDY = "study.yaml"


def enter(folder: Path, wanted: Wanted, resume: bool, accept_code: bool = False) -> Study:
    """Make a folder that of a search, or go on in it.

    Raises:
        RolloutError: when it holds another study, one of other code, this one and is not to be resumed, or
            cannot be written to.
    """
    tune = yaml.safe_dump({"tune": wanted.tune.plain()}, sort_keys=False, allow_unicode=True)
    asked = replace(wanted.identity, text=wanted.identity.text + tune)
    study = Study.enter(folder, asked, STUDY, accept_code)
    if study.there and study.begun and not resume:
        raise RolloutError(f"{folder}: holds this study already; resume it, or choose another folder")
    return study


def finish(
    folder: Path, wanted: Wanted, search: Search, found: Sequence[Validated], given: Row
) -> list[Path]:
    """Write what was found.

    Returns:
        The paths of the files.
    """
    contents: dict[str, str | bytes] = {
        "front.csv": front_table(search, found),
        "gains.csv": gains_table(search, found),
        "evaluations.csv": evaluations_table(search),
        "report.md": report(search, found, given),
    }
    for each in found:
        text, copied = experiments.portable(best_file(wanted, each.row.x).config)
        contents |= {f"{_column(each.budget)}.yaml": text, **copied}
    if found:  # the one in the middle of the front
        contents["best.yaml"] = contents[f"{_column(found[len(found) // 2].budget)}.yaml"]
    return [files.write(folder / name, content) for name, content in contents.items()]


def front(search: Search) -> list[Row]:
    """Return the candidates of the search that no other beats in both costs, by what they spend."""
    against = search.problem.against
    found: list[Row] = []
    for row in sorted(search.rank(), key=lambda row: (row.means[against], row.objective)):
        if not found or row.objective < found[-1].objective:
            found.append(row)
    return found


def front_table(search: Search, found: Sequence[Validated]) -> str:
    """Return the front as CSV; what was validated has its values on the held-out scenarios as well."""
    problem, against = search.problem, search.problem.against
    held = {each.row.x.tobytes(): each.held_out for each in found}
    head = ["objective", against, "held_out_objective", f"held_out_{against}", *problem.space.names]
    rows: list[list[Any]] = []
    every = {row.x.tobytes(): row for row in (*front(search), *(each.row for each in found))}
    for row in sorted(every.values(), key=lambda row: row.means[against]):
        other = held.get(row.x.tobytes())
        seen = ["", ""] if other is None else [other.objective, other.means[against]]
        rows.append([row.objective, row.means[against], *seen, *problem.space.values(row.x).tolist()])
    return csv_table(head, rows)


def gains_table(search: Search, found: Sequence[Validated]) -> str:
    """Return what was searched, number by number and joint by joint, against what it was before."""
    space = search.problem.space
    head = ["number", "joint", "default", *(_column(each.budget) for each in found), "low", "high"]
    starts = [each.start for each in space.dimensions]
    columns = np.transpose([starts, *(space.values(each.row.x) for each in found)]).tolist()
    rows = []
    for each, values in zip(space.dimensions, columns, strict=True):
        joint = "all" if each.joint is None else space.joints[each.joint]
        rows.append([each.name, joint, *values, float(each.low), float(each.high)])
    return csv_table(head, rows)


def _column(budget: float) -> str:
    """Return what the best of a budget is called in tables and file names."""
    return "best" if math.isinf(budget) else f"best-{budget:g}"


def evaluations_table(search: Search) -> str:
    """Return every candidate as CSV, with the best objective so far for every budget."""
    names, space = search.problem.names, search.problem.space
    best = map(_column, search.problem.budgets)
    head = ["generation", "search", "objective", "failed", "violation", *names, *space.names]
    rows = []
    for row, so_far in zip(search.rows, convergence(search).T, strict=True):
        numbers = (row.objective, row.failed, row.violation, *(row.means[name] for name in names))
        values = (*numbers, *space.values(row.x), *row.x, *so_far)
        rows.append([row.generation, row.search, *map(float, values)])
    return csv_table([*head, *(f"x {name}" for name in space.names), *best], rows)


def convergence(search: Search) -> Any:
    """Return the best objective after each candidate for every budget, (budgets, candidates)."""
    against = search.problem.against
    values = [
        [row.objective if row.sound and row.means[against] <= budget else math.inf for row in search.rows]
        for budget in search.problem.budgets
    ]
    return np.minimum.accumulate(np.array(values), axis=1)


def report(search: Search, found: Sequence[Validated], given: Row) -> str:
    """Return what was found as Markdown."""
    problem, against = search.problem, search.problem.against
    fit, held = len(problem.search.draws), len(problem.held_out.draws)
    head = (
        *("", f"{problem.objective.expression.text}, {fit} scenarios", f"{against}, {fit} scenarios"),
        *(f"the same, {held} held out", f"{against}, held out"),
    )
    lines = [("default", *_cells(search.rows[0], given, against))]
    for each in found:
        name = "best" if math.isinf(each.budget) else f"best, {against} up to {each.budget:g}"
        lines.append((name, *_cells(each.row, each.held_out, against)))
    missing = len(problem.budgets) - len(found)
    remark = ""
    if missing and math.isinf(problem.budgets[0]):
        where = "held-out scenarios" if search.rank() else "scenarios that were searched on"
        remark = f"\nNo candidate holds on the {where}: there is no best one.\n"
    elif missing:
        remark = f"\nFor {missing} of the budgets no candidate holds.\n"
    return f"{len(search.rows)} candidates.\n\n{markdown_table(head, lines)}{remark}"


def as_data(search: Search, found: Sequence[Validated], given: Row) -> dict[str, Any]:
    """Return the same as plain data: the default and what was found, searched on and held out."""

    def plain(row: Row) -> dict[str, Any]:
        return {**row._asdict(), "x": row.x.tolist()}

    rows = [
        {"budget": each.budget, "searched": plain(each.row), "held_out": plain(each.held_out)}
        for each in found
    ]
    default = {"searched": plain(search.rows[0]), "held_out": plain(given)}
    return {"candidates": len(search.rows), "default": default, "found": rows}


def _cells(row: Row, held_out: Row, against: str) -> list[str]:
    """Return the values of a candidate on both sets of scenarios."""
    cells = []
    for each in (row, held_out):
        worth = metrics.short(each.objective) + ("" if each.sound else " (breaks a constraint)")
        if each.failed:
            worth = f"fails in {100.0 * each.failed:.0f} %"
        cells += [worth, metrics.short(each.means[against])]
    return cells
