"""Everything the paper shows, run again: Tables 2-4, Figures 5-13, and what the paper does not say.

``runs.py`` has the rollouts, ``tables.py`` and ``figures.py`` what is made of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import NamedTuple

import xarray as xr

from armgpi.base.files import write_set
from armgpi.config.experiment import prepare
from armgpi.paper import published
from armgpi.paper.reproduction import figures, runs, tables
from armgpi.paper.reproduction.tables import Sheet

__all__ = ["Reproduction", "reproduce"]

_TOP = """# The paper, reproduced

Galvan-Perez et al., *Neural Adaptive Robust Motion-Tracking Control for Robotic Manipulator Systems*,
Actuators 2022, 11, 255. Ideal sensors at a sample time of {dt:g} s, real ones at 1 ms, {horizon:g} s.

The tuned PID + inversion has three equal poles. With ideal sensors they are where the networks' bandwidth
ends. With real ones they are at {pole:g} rad/s, with velocities from differences through a filter of
{bandwidth:g} rad/s{chosen}.

Of the {cells} published cells of the proposal, ours (GPI, networks, ideal sensors) is {words}.
{others}
"""

_CHOSEN = ": the best of {} candidates, as long as the torque varies no more than the networks'"


class Reproduction(NamedTuple):
    """What came out.

    Attributes:
        sheets: the tables.
        summary: in words, as Markdown.
        files: what was written.
        contenders: the rollouts of scenario 5.3 with ideal sensors and a right model, by name.
    """

    sheets: list[Sheet]
    summary: str
    files: list[Path]
    contenders: dict[str, xr.Dataset]


def reproduce(
    folder: Path,
    quick: bool = False,
    done: Callable[[str], None] = lambda name: None,
    backend: str = "auto",
) -> Reproduction:
    """Run everything and write tables (Markdown, CSV, LaTeX) and figures (PNG, SVG).

    Args:
        folder: where to, made if needed.
        quick: a sample time of 1e-3 s in place of the paper's 1e-4 s, lower bandwidths for it; no
            sensitivity, no ablation, no sweep of the literal law, and PNG figures alone.
        done: called with the name of each batch when it is done.
        backend: as for :func:`armgpi.simulate`.

    Raises:
        RolloutError: when the folder or a file cannot be written.
    """
    prepare(folder)
    runs.choose(backend)
    found = _run_all(runs.QUICK if quick else runs.FULL, quick, done)
    sheets, words = _sheets(found)
    endings = ("png",) if quick else ("png", "svg")
    pictures = figures.write(found.ideal_gpi, found.ideal_pid, found.ablation, folder, endings)
    files = [*_write(folder, sheets, words, pictures), *pictures]
    contenders = {
        "PID + inversion": runs.select(found.ideal_pid, runs.NEAR_PID, 1.0),
        "GPI + networks": runs.select(found.ideal_gpi, runs.NETWORK, 1.0),
    }
    return Reproduction(sheets, words, files, contenders)


class _Found(NamedTuple):
    """The batches, by what they are."""

    setting: runs.Setting
    tuned: runs.Poles
    ideal_gpi: xr.Dataset
    ideal_literal: xr.Dataset
    ideal_pid: xr.Dataset
    real_gpi: xr.Dataset
    real_literal: xr.Dataset
    real_pid: xr.Dataset
    sensitivity: xr.Dataset | None
    ablation: xr.Dataset | None
    sweep: dict[str, xr.Dataset]


def _run_all(setting: runs.Setting, quick: bool, done: Callable[[str], None]) -> _Found:
    """Run the batches, one after the other."""

    def run(name: str, job: Callable[..., xr.Dataset], *arguments: object) -> xr.Dataset:
        found = job(*arguments)
        done(name)
        return found

    ideal_gpi = run("GPI, ideal sensors", runs.ideal_gpi, setting)
    real_gpi = run("GPI, real sensors", runs.real_gpi, setting)
    tuned = runs.Poles(setting.candidates[0][0], setting.candidates[1][0])
    if not quick:
        tuned = runs.best_candidate(run("PID + inversion, candidates", runs.candidates, setting), real_gpi)
    realisations = () if quick else ("paper", "bumpless")
    return _Found(
        setting,
        tuned,
        ideal_gpi,
        run("as printed, ideal sensors", runs.ideal_literal, setting),
        run("PID + inversion, ideal sensors", runs.ideal_pid, setting),
        real_gpi,
        run("as printed, real sensors", runs.real_literal),
        run("PID + inversion, real sensors", runs.real_pid, tuned),
        None if quick else run("sensitivity", runs.sensitivity),
        None if quick else run("ablation", runs.ablation),
        {name: run(f"literal law, {name}", runs.sweep, name) for name in realisations},
    )


def _sheets(found: _Found) -> tuple[list[Sheet], str]:
    """Return the tables, and what they say in words."""
    ideal = (found.ideal_literal, found.ideal_gpi, found.ideal_pid)
    real = (found.real_literal, found.real_gpi, found.real_pid)
    contenders = tables.contenders([*product(["ideal"], ideal), *product(["real"], real)])
    holding = runs.holding_cost()
    sheets = [
        tables.comparison(table, sensors, contenders, holding)
        for sensors, table in product(("ideal", "real"), published.TABLES)
    ]
    statuses = tables.statuses(contenders)
    horizon = float(found.real_gpi["time"][-1])
    counts = tables.count_statuses(statuses, runs.NETWORK, "ideal")
    others = tables.not_better(statuses, runs.NETWORK, "ideal", holding)
    count = math.prod(map(len, found.setting.candidates))
    words = _TOP.format(
        dt=found.setting.dt,
        horizon=horizon,
        pole=found.tuned.pole,
        bandwidth=found.tuned.bandwidth,
        chosen=_CHOSEN.format(count) if count > 1 else "",
        cells=sum(counts.values()),
        words=", ".join(f"{status} in {count}" for status, count in counts.items()),
        others="\n".join(f"- {text}" for text in others),
    )
    if found.ablation is not None:
        words += "\n" + "\n".join(f"- {text}" for text in tables.ablation_in_words(found.ablation)) + "\n"
        sheets.append(tables.ablation(found.ablation))
    if found.sweep:
        sheets.append(tables.sweep(found.sweep))
    if found.sensitivity is not None:
        sheets.append(tables.sensitivity(found.sensitivity, horizon))
    return [*sheets, statuses], words


def _write(folder: Path, sheets: list[Sheet], words: str, pictures: list[Path]) -> list[Path]:
    """Write the tables, and the hashes of all files; return what was written."""
    texts = {"reproduction.md": "\n".join([words, *(sheet.markdown() for sheet in sheets)])}
    for sheet in sheets:
        texts[f"{sheet.name}.md"] = sheet.markdown()
        texts[f"{sheet.name}.csv"] = sheet.csv()
        texts[f"{sheet.name}.tex"] = sheet.latex()
    return write_set(folder, texts, [path.name for path in pictures])
