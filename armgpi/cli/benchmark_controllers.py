"""The benchmark of controllers: all tuned alike, and evaluated on scenarios that none has seen."""

from __future__ import annotations

from pathlib import Path

from armgpi.base.escape import json_data
from armgpi.cli.parsing import refusal, split, stoppable
from armgpi.cli.terminal import say
from armgpi.cli.written import show
from armgpi.errors import require_extra

#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "arms <[ROBOT]...>": "Robots; by default ur5, panda, kinova and the paper's arm.",
    "out --out -o FOLDER": "Folder for the comparison and its tables.",
    "laws --controllers --law NAMES": "Controllers to compare; may be repeated. All by default.",
    "evaluations": "Candidates for each controller, arm and seed.",
    "seeds": "Searches for each controller and arm.",
    "reality NAME": "Uncertainty model of the arms: bare, geared or elastic.",
    "quick": "A small comparison, which takes minutes for one arm.",
}


@stoppable
def benchmark_controllers(
    arms: list[str] | None = None,
    out: Path = Path("contest"),
    laws: list[str] | None = None,
    evaluations: int = 481,
    seeds: int = 2,
    reality: str = "bare",
    quick: bool = False,
    accept_code: bool = False,
    report: Path | None = None,
    as_json: bool = False,
) -> None:
    """Tune all controllers alike for several limits of torque variation, and evaluate them on new scenarios.

    A benchmark that was stopped goes on where it was.

    \b
    armgpi benchmark controllers --out contest
    armgpi benchmark controllers anthropomorphic3 --quick --out quick
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.base import files
    from armgpi.robot import robots
    from armgpi.studies import contend as contests

    require_extra("cma", "tune")
    names = list(dict.fromkeys(split(arms or list(contests.ARMS))))
    for name in names:
        robots.locate(name)
    if not 2 <= evaluations <= 1_000_000:
        raise refusal("--evaluations", f"must be from 2 to 1000000, got {evaluations}")
    if not 1 <= seeds <= 1000:
        raise refusal("--seeds", f"must be from 1 to 1000, got {seeds}")
    if reality not in ("bare", "geared", "elastic"):
        raise refusal("--reality", f"must be bare, geared or elastic, got {reality!r}")
    setting = contests.QUICK if quick else contests.Setting(evaluations, seeds)
    setting = setting._replace(reality=reality)
    chosen = laws or list(contests.CONTENDERS)
    study = contests.enter(out, setting, accept_code)
    entries = contests.run(study, names, chosen, setting, lambda text: say(text, err=True))
    text = f"{contests.markdown(entries)}\n{contests.verdict(entries)}"
    paths = [files.write(out / "contest.md", text)]
    data = json_data([entry._asdict() for entry in entries]) if as_json else None
    picture = out / "contest.png", lambda pictures: pictures.contest_picture(entries)
    say(f"world: arms of the uncertainty model {reality}, the same for every controller", err=True)
    show("Comparison of tuned controllers", text, data, paths, report, picture)
