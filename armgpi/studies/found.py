"""What a search found, as files: tables, a report, and the experiment with the best numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from armgpi.base import files
from armgpi.base.arrays import Array
from armgpi.base.escape import csv_table, markdown_table
from armgpi.config import experiment as experiments
from armgpi.errors import RolloutError
from armgpi.loop import metrics
from armgpi.studies.objective import heading
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
        raise RolloutError(
            f"{folder}: holds this study already; --resume it, or choose another folder: --out FOLDER"
        )
    return study


def finish(folder: Path, wanted: Wanted, search: Search, best: Sequence[Validated], given: Row) -> list[Path]:
    """Write what was found.

    Args:
        folder: of the study.
        wanted: what the search was asked for.
        search: the search, ended.
        best: the best candidate of each budget, on the held-out scenarios too.
        given: the controller of the file on the held-out scenarios.

    Returns:
        The paths of the files.
    """
    contents: dict[str, str | bytes] = {
        "front.csv": front_table(search, best),
        "gains.csv": gains_table(search, best),
        "evaluations.csv": evaluations_table(search),
        "report.md": report(search, best, given),
    }
    for validated in best:
        text, copied = experiments.portable(best_file(wanted, validated.row.x).config)
        contents[f"{_column(validated.budget)}.yaml"] = text
        contents.update(copied)
    if best:
        middle_of_front = best[len(best) // 2]
        contents["best.yaml"] = contents[f"{_column(middle_of_front.budget)}.yaml"]
    return [files.write(folder / name, content) for name, content in contents.items()]


def front(search: Search) -> list[Row]:
    """Return the candidates of the search that no other beats in both costs, by what they spend."""
    against = search.problem.against
    by_spending = sorted(search.rank(), key=lambda row: (row.means[against], row.objective))
    unbeaten: list[Row] = []
    for row in by_spending:
        if not unbeaten or row.objective < unbeaten[-1].objective:
            unbeaten.append(row)
    return unbeaten


def front_table(search: Search, best: Sequence[Validated]) -> str:
    """Return the front as CSV; what was validated has its values on the held-out scenarios as well."""
    problem, against = search.problem, search.problem.against
    head = ["objective", against, "held_out_objective", f"held_out_{against}", *problem.space.names]
    held_out = {validated.row.x.tobytes(): validated.held_out for validated in best}
    candidates = {row.x.tobytes(): row for row in front(search)}
    for validated in best:
        candidates[validated.row.x.tobytes()] = validated.row
    rows: list[list[Any]] = []
    for row in sorted(candidates.values(), key=lambda row: row.means[against]):
        on_others = held_out.get(row.x.tobytes())
        validated_costs: list[Any] = ["", ""]
        if on_others is not None:
            validated_costs = [on_others.objective, on_others.means[against]]
        numbers = problem.space.values(row.x).tolist()
        rows.append([row.objective, row.means[against], *validated_costs, *numbers])
    return csv_table(head, rows)


def gains_table(search: Search, best: Sequence[Validated]) -> str:
    """Return what was searched, number by number and joint by joint, against what it was before."""
    space = search.problem.space
    head = ["number", "joint", "default"]
    columns = [np.array([dimension.start for dimension in space.dimensions])]
    for validated in best:
        head.append(_column(validated.budget))
        columns.append(space.values(validated.row.x))
    rows = []
    for dimension, values in zip(space.dimensions, np.transpose(columns).tolist(), strict=True):
        joint = "all" if dimension.joint is None else space.joints[dimension.joint]
        low, high = float(dimension.low), float(dimension.high)
        rows.append([dimension.name, joint, *values, low, high])
    return csv_table([*head, "low", "high"], rows)


def _column(budget: float) -> str:
    """Return what the best of a budget is called in tables and file names."""
    return "best" if math.isinf(budget) else f"best-{budget:g}"


def evaluations_table(search: Search) -> str:
    """Return every candidate as CSV, with the best objective so far for every budget."""
    metric_names, space = search.problem.names, search.problem.space
    head = ["generation", "search", "objective", "failed", "violation", *metric_names, *space.names]
    head += [f"x {name}" for name in space.names]
    head += [_column(budget) for budget in search.problem.budgets]
    rows = []
    for row, best_so_far in zip(search.rows, convergence(search).T, strict=True):
        numbers = [row.objective, row.failed, row.violation]
        numbers += [row.means[name] for name in metric_names]
        numbers += [*space.values(row.x), *row.x, *best_so_far]
        rows.append([row.generation, row.search, *(float(number) for number in numbers)])
    return csv_table(head, rows)


def convergence(search: Search) -> Array:
    """Return the best objective after each candidate for every budget, (budgets, candidates)."""
    against = search.problem.against
    shape = (len(search.problem.budgets), len(search.rows))
    objectives = np.full(shape, np.inf)
    for i, budget in enumerate(search.problem.budgets):
        for k, row in enumerate(search.rows):
            if row.sound and row.means[against] <= budget:
                objectives[i, k] = row.objective
    return np.minimum.accumulate(objectives, axis=1)


def report(search: Search, best: Sequence[Validated], given: Row) -> str:
    """Return what was found as Markdown."""
    problem, against = search.problem, search.problem.against
    searched_on, held_out = len(problem.search.draws), len(problem.held_out.draws)
    slides = problem.slides
    objective = heading(problem.objective.expression.text, slides)
    spent = heading(against, slides)
    what, _, unit = spent.rstrip("]").partition(" [")
    head = (
        "",
        f"{objective}, {searched_on} tuning scenarios",
        f"{spent}, tuning",
        f"{objective}, {held_out} held-out scenarios",
        f"{spent}, held out",
    )
    lines = [("default", *_cells(search.rows[0], given, against))]
    for validated in best:
        name = "best" if math.isinf(validated.budget) else f"best, {what} up to {validated.budget:g} {unit}"
        lines.append((name, *_cells(validated.row, validated.held_out, against)))
    return f"{len(search.rows)} candidates.\n\n{markdown_table(head, lines)}{_without_best(search, best)}"


def _without_best(search: Search, best: Sequence[Validated]) -> str:
    """Return a remark about budgets that no candidate holds for; empty where each has one."""
    budgets = search.problem.budgets
    missing = len(budgets) - len(best)
    if not missing:
        return ""
    if math.isinf(budgets[0]):
        where = "held-out scenarios" if search.rank() else "tuning scenarios"
        return f"\nNo candidate holds on the {where}: there is no best one.\n"
    return f"\nFor {missing} of the budgets no candidate holds.\n"


def as_data(search: Search, best: Sequence[Validated], given: Row) -> dict[str, Any]:
    """Return the same as plain data: the default and what was found, searched on and held out."""
    rows = []
    for validated in best:
        row = {
            "budget": validated.budget,
            "searched": _plain(validated.row),
            "held_out": _plain(validated.held_out),
        }
        rows.append(row)
    default = {"searched": _plain(search.rows[0]), "held_out": _plain(given)}
    return {"candidates": len(search.rows), "default": default, "found": rows}


def _plain(row: Row) -> dict[str, Any]:
    """Return a candidate as plain data."""
    return {**row._asdict(), "x": row.x.tolist()}


def _cells(row: Row, held_out: Row, against: str) -> list[str]:
    """Return the values of a candidate on both sets of scenarios."""
    cells = []
    for outcome in (row, held_out):
        worth = metrics.short(outcome.objective)
        if not outcome.sound:
            worth += " (breaks a constraint)"
        if outcome.failed:
            worth = f"fails in {100.0 * outcome.failed:.0f} %"
        cells += [worth, metrics.short(outcome.means[against])]
    return cells
