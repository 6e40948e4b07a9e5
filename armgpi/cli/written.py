"""What commands share of their results: where they are written, and how they are shown."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from importlib import util
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armgpi.base import files
from armgpi.cli.parsing import refusal
from armgpi.cli.terminal import say, say_markdown
from armgpi.errors import RolloutError

if TYPE_CHECKING:
    from armgpi.config import Experiment


def import_xarray() -> None:
    """Import xarray such that it finds neither Dask nor Arrow, of which this process has no arrays.

    It would import all of Dask, which takes three times as long as Pinocchio, to ask of arrays whether they
    are Dask's; and pandas all of Arrow, for tables that are not made here.
    """
    loaded: dict[str, Any] = sys.modules
    hidden = {"dask", "pyarrow"} - set(loaded)
    if "xarray" in loaded or "pandas" in loaded:
        return
    find = util.find_spec
    vars(util)["find_spec"] = lambda name, package=None: None if name in hidden else find(name, package)
    loaded.update(dict.fromkeys(hidden))  # an import of them fails
    try:
        import xarray as xr

        xr.Dataset({"asked": ("once", [0.0])})
    finally:
        for name in hidden:
            del loaded[name]
        vars(util)["find_spec"] = find


def check_out(folder: Path | None, config: Path | None, force: bool, experiment: Experiment) -> None:
    """Refuse a folder for results that cannot be used: better before a long run than after it.

    Args:
        folder: of --out; None for none.
        config: experiment file that is run, which must not be overwritten; None for none.
        force: whether another experiment's results are.
        experiment: whose results go there.
    """
    from armgpi.config import experiment as experiments

    if folder is None:
        return
    if config is not None and (folder / "experiment.yaml").resolve() == config.resolve():
        raise refusal("--out", f"would overwrite {config}; choose another folder")
    experiments.prepare(folder)
    if not force and experiments.is_another(experiment, folder):
        raise refusal("--out", f"{folder} holds another experiment; choose another folder, or add --force")


def write(path: Path, text: str, option: str) -> None:
    """Write a file, or say why not."""
    try:
        files.write(path, text)
    except RolloutError as error:
        raise refusal(option, str(error)) from None
    say(f"wrote {path}", err=True)


def show(
    title: str,
    text: str,
    data: Any,
    paths: list[Path],
    report: Path | None,
    picture: tuple[Path, Callable[[Any], bytes]] | None = None,
) -> None:
    """Print tables, or data in their place; write a picture and a page where they are asked for.

    Args:
        title: of the page.
        text: the tables, as Markdown.
        data: printed as JSON in place of them, where there are some.
        paths: what was written before.
        report: of the page.
        picture: where it goes, and what returns it, given :mod:`armgpi.studies.pictures`.
    """
    drawn = b""
    if picture is not None and util.find_spec("matplotlib") is not None:
        from armgpi.studies import pictures

        drawn = picture[1](pictures)
        paths = [*paths, files.write(picture[0], drawn)]
    elif picture is not None:
        say("no picture was drawn: it needs the package 'matplotlib' (pip install matplotlib)", err=True)
    if data is None:
        say_markdown(text)
    else:
        say(json.dumps(data), lines=True)
    if report is not None:
        from armgpi.viewing import page

        sections = {"Result": page.from_markdown(text, "result")}
        if drawn:
            sections["Pictures"] = page.picture(drawn, title)
        paths = [*paths, files.write(report, page.document(title, "", sections))]
    for path in paths:
        say(f"wrote {path}", err=True)
