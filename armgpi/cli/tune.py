"""The command that searches for gains."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from armgpi.base.escape import json_data
from armgpi.cli.parsing import FAILED, known_backend, refusal, stoppable
from armgpi.cli.terminal import say
from armgpi.cli.written import show

if TYPE_CHECKING:
    from armgpi.studies.optimise import Search


#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "file <FILE>": "Experiment file (YAML) with a section `tune`; or the folder of an identified arm.",
    "out --out -o FOLDER": "Folder for the study and its result.",
    "resume": "Continue the study in the folder.",
    "evaluations NUMBER": "Number of candidates that are tried; by default that of the file.",
    "seed NUMBER": "Seed of the search; by default that of the file.",
    "backend NAME": "numpy, compiled or auto.",
}


@stoppable
def tune(
    file: Path,
    out: Path = Path("tuned"),
    resume: bool = False,
    evaluations: int | None = None,
    seed: int | None = None,
    backend: str = "compiled",
    accept_code: bool = False,
    report: Path | None = None,
    as_json: bool = False,
) -> None:
    """Search for a controller's parameters, and validate them on scenarios that the search never used.

    \b
    armgpi tune study.yaml --out study
    armgpi tune study.yaml --out study --resume
    armgpi tune identified/ --out study
    armgpi compare --config study/best.yaml
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.config.building import summary
    from armgpi.studies import found as results
    from armgpi.studies import setup
    from armgpi.studies.optimise import Search

    given = {"evaluations": evaluations, "seed": seed}
    changes = {key: value for key, value in given.items() if value is not None}
    wanted = setup.read(file, changes, known_backend(backend))
    if resume and not (out / results.STUDY).exists():
        raise refusal("--resume", f"{out} holds no study")
    say(summary(wanted.experiment), err=True)
    study, search = results.enter(out, wanted, resume, accept_code), Search(wanted.problem)
    begun = time.monotonic()

    def say_progress(search: Search) -> None:
        done, total = len(search.rows), max(search.problem.evaluations, len(search.rows))
        best = min((row.objective for row in search.rows if row.sound), default=float("inf"))
        rate = search.fresh / max(time.monotonic() - begun, 1e-9)
        left = (total - done) / rate
        say(f"{done} of {total} candidates, best {best:.4g}, {rate:.3g} per s, {left:.0f} s left", err=True)

    search.run(say_progress, study.part)
    found, default = search.validate(), search.judge_start()
    paths = results.finish(out, wanted, search, found, default)
    text = results.report(search, found, default)
    data = json_data(results.as_data(search, found, default)) if as_json else None
    picture = out / "study.png", lambda pictures: pictures.study_picture(search, found, default)
    show(f"Search on {file.name}", text, data, paths, report, picture)
    if found and not as_json:
        say(f"Next: armgpi compare --config {out / 'best.yaml'}", err=True)
    if not found:
        sys.exit(FAILED)
