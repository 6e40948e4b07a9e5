"""The commands about the paper: reproduce and scenarios."""

from __future__ import annotations

from pathlib import Path

from armgpi.cli.parsing import known_backend, stoppable
from armgpi.cli.terminal import say

#: What the paper simulates, in the words of the other commands.
WORLD = (
    "world: ideal: stiff joints, no rotors, no friction, exact positions (and velocities, of controllers "
    "that measure them), no delay; the controllers as printed in the paper, and tuned"
)
#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "out --out -o FOLDER": "Folder for tables and figures.",
    "quick": "A step of 1e-3 s and no side studies: under half a minute.",
    "name <NAME>": "Scenario to print; without it, all are listed.",
}


@stoppable
def reproduce(
    out: Path = Path("reproduction"),
    quick: bool = False,
    backend: str = "auto",
    report: Path | None = None,
) -> None:
    """Repeat the paper's experiments: Tables 2-4 and Figures 5-13, compared with the published values.

    \b
    armgpi reproduce
    armgpi reproduce --quick --out quick
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.cli import pictures
    from armgpi.paper.reproduction import reproduce as run

    pictures.check(report=report)
    done = run(
        out,
        quick=quick,
        done=lambda name: say(f"done: {name}", err=True),
        backend=known_backend(backend),
    )
    say(WORLD, err=True)
    say(done.summary, lines=True)
    say(f"wrote {len(done.files)} files to {out}, {out / 'reproduction.md'} first", err=True)
    if report is not None:
        from armgpi.viewing import report as reports

        page = reports.build(
            reports.merge_rollouts(done.contenders), title="The paper's scenario 5.3, reproduced"
        )
        say(f"wrote {reports.write(page, report)}", err=True)


def scenarios(
    name: str | None = None,
) -> None:
    """List the paper's scenarios, or print one as an experiment file to edit.

    \b
    armgpi compare --config scenario-5.3
    armgpi scenarios scenario-5.3 > mine.yaml
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.paper.scenarios import locate, names

    if name is not None:
        say(locate(name).read_text(encoding="utf-8"), lines=True)
        return
    for each in names():
        say(each)
