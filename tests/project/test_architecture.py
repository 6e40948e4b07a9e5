"""The page on the architecture names every module there is, and no other, in the order of the layers."""

from __future__ import annotations

import ast
import re
import runpy
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def section(heading: str) -> str:
    """Return what stands below a heading, up to the next one of its level."""
    return PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


def groups() -> dict[tuple[str, ...], list[str]]:
    """Return the packages of each layer in the list of modules, and the files below them."""
    assert "\n{{ modules_list }}\n" in section("Every module")
    made = runpy.run_path(str(ROOT / "docs" / "conf.py"))["myst_substitutions"]["modules_list"]
    parts = f"\n**`__init__`**\n{made}".split("\n**")[1:]
    return {
        tuple(re.findall(r"`(\w+)`", part.partition("\n")[0])): re.findall(
            r"^- `(armgpi/[\w/]+\.py)`: \S", part, re.M
        )
        for part in parts
    }


def test_the_page_names_every_module_once_below_its_package() -> None:
    named = [file for files in groups().values() for file in files]
    there = {path.relative_to(ROOT).as_posix() for path in (ROOT / "armgpi").rglob("*.py")}
    assert sorted(named) == sorted(there)
    for packages, files in groups().items():
        for file in files:
            assert Path(file).parts[1].removesuffix(".py") in packages


def test_packages_stand_in_the_order_of_their_layers() -> None:
    # tomllib is in Python 3.11 and later alone.
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    layers = ast.literal_eval(text.partition("\nlayers = ")[2].partition("]\n")[0] + "]")
    assert list(groups())[1:] == [tuple(re.split(" [:|] ", layer)) for layer in reversed(layers)]


def test_every_room_says_what_it_takes_and_gives() -> None:
    table = runpy.run_path(str(ROOT / "docs" / "conf.py"))["myst_substitutions"]["rooms_table"]
    rooms = {path.parent.name for path in (ROOT / "armgpi").glob("*/__init__.py")}
    assert set(re.findall(r"(?m)^\| `(\w+)` \| [^|]+ \| [^|]+ \| [^|]+ \|$", table)) == rooms


def test_the_files_to_begin_with_are_five_short_ones() -> None:
    files = re.findall(r"^\| `(armgpi/\S+)`", section("Five files to begin with"), re.M)
    assert len(files) == 5
    for file in files:
        assert len((ROOT / file).read_text(encoding="utf-8").splitlines()) < 250


def test_every_file_that_the_page_names_exists() -> None:
    for path in re.findall(r"`((?:armgpi|tests|docs)/[\w/.]*)`", PAGE):
        assert (ROOT / path).exists(), path
