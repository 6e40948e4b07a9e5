"""What the README and the pages say is so: code runs and prints what is shown, names exist, lists are whole.

A page is played from top to bottom in a folder of its own: a Python block is run (one namespace per page), a
YAML block whose first line is `# NAME.yaml` becomes that file, and the `$ armgpi` and `$ make demo` lines of
a console block are called. Where output is shown, after the command or in a text block after a Python one,
it must be the output. Numbers agree within 1 % or one of their last decimal, as digits beyond that depend on
the machine, and rounding errors (below 1e-9) with each other.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import math
import re
import runpy
import shlex
import sys
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest
import typer
from sampling import for_search

import armgpi
from armgpi import config
from armgpi.base.parameter import parameters
from armgpi.cli import app, declared, main
from armgpi.config import schema
from armgpi.config.section import Section
from armgpi.hardware.export.interfaces import TARGETS
from armgpi.loop.backends import BACKENDS
from armgpi.plants.arm import Arm
from armgpi.plants.loads import Load
from armgpi.plants.plant import Wrapper
from armgpi.references.paths import Path as ToolPath
from armgpi.registry import classes_of

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
LINKING = [*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]
NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|[-+]?\.\d+")
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """A fenced block and the number of its first line."""

    language: str
    text: str
    line: int


def blocks(page: Path) -> list[Block]:
    """Return the fenced blocks of a page that name a language."""
    text = page.read_text(encoding="utf-8")
    return [Block(m[1], m[2], text.count("\n", 0, m.start(2)) + 1) for m in FENCE.finditer(text)]


def agree(shown: str, printed: str) -> bool:
    """Tell whether two outputs have the same words and, as far as they are shown, the same numbers."""

    def words(text: str) -> list[str]:
        # Rules of tables are as long as their numbers are wide.
        return re.sub(r"[\s─━│┃┏┳┓┡╇┩├┼┤└┴┘]+", " ", NUMBER.sub("#", text)).split()

    def same(a: str, b: str) -> bool:
        fixed = re.fullmatch(r"[-+]?\d*\.(\d+)", a)
        last = 1.01 * 10.0 ** -len(fixed[1]) if fixed else 1e-9
        return math.isclose(float(a), float(b), rel_tol=1e-2, abs_tol=last)

    pairs = zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=False)
    return words(shown) == words(printed) and all(same(a, b) for a, b in pairs)


def check(shown: str, printed: str, place: str) -> None:
    """Fail with what was printed when it is not what the page shows."""
    assert agree(shown, printed), f"{place} shows\n{shown}\nbut it prints\n{printed}"


def called(command: str, place: str) -> str:
    """Return what a command of ours prints in this folder, warnings included; it must succeed."""
    absent: tuple[str, ...] = ()
    find_spec = importlib.util.find_spec
    if command == "make demo":  # as in the Makefile
        file = shlex.quote(str(ROOT / "examples" / "demo.yaml"))
        command = f"armgpi compare --config {file} --report report.html"
        absent = ("casadi",)  # `make demo` installs the extra `viz` alone
    if not command.startswith("armgpi "):
        return ""
    output = io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", shlex.split(command.split("  #")[0]))
        patch.setenv("COLUMNS", "120")
        patch.setattr(sys, "stdout", output)
        patch.setattr(sys, "stderr", output)
        patch.setattr(
            importlib.util, "find_spec", lambda name, *of: None if name in absent else find_spec(name, *of)
        )
        with pytest.raises(SystemExit) as end:
            main()
    assert not end.value.code, f"{place}: {command}\n{output.getvalue()}"
    printed = output.getvalue().replace(f"{ROOT}/", "")
    return "\n".join(line for line in printed.splitlines() if not line.startswith("wrote "))


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [for_search(page) if page.stem in ("own_arm", "path", "viewing") else page for page in PAGES],
    ids=lambda page: page.stem,
)
def test_code_of_a_page_runs_and_prints_what_the_page_shows(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(armgpi.metrics, "ALL", dict(armgpi.metrics.ALL))  # what a page declares stays there
    namespace: dict[str, object] = {"__name__": "__main__"}
    printed = ""
    for block in blocks(page):
        place = f"{page.name}:{block.line}"
        if block.language == "python":
            code = compile("\n" * (block.line - 1) + block.text, str(page), "exec", dont_inherit=True)
            with contextlib.redirect_stdout(io.StringIO()) as output:
                exec(code, namespace)
            printed = output.getvalue()
        elif block.language == "text":
            check(block.text, printed, place)
        elif block.language == "yaml" and (name := re.match(r"# (\S+\.yaml)\n", block.text)):
            (tmp_path / name[1]).write_text(block.text, encoding="utf-8")
        elif block.language == "console":
            for entry in re.split(r"^\$ ", block.text.replace("\\\n", " "), flags=re.MULTILINE)[1:]:
                command, _, shown = entry.partition("\n")
                result = called(command, place)
                if shown.strip():
                    check(shown, result, place)


def test_the_tutorial_is_shorter_than_its_output() -> None:
    page = ROOT / "docs" / "tutorial.md"
    shown = [
        block.text.replace("\\\n", "").partition("\n")[2] if block.language == "console" else block.text
        for block in blocks(page)
        if block.language in ("console", "text")
    ]
    output = sum(text.count("\n") for text in shown)
    assert len(page.read_text(encoding="utf-8").splitlines()) - output < output


def anchors(page: Path) -> set[str]:
    """Return the names by which links reach the headings of a page, and the places that have a name."""
    text = page.read_text(encoding="utf-8")
    found = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    headings = {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in found}
    return headings | set(re.findall(r"^\(([\w-]+)\)=$", text, re.MULTILINE))


@pytest.mark.parametrize("page", LINKING, ids=lambda page: page.stem)
def test_tests_and_files_that_a_page_names_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for file, name in re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", text):
        source = (ROOT / file).read_text(encoding="utf-8")
        assert not name or f"def {name}(" in source, f"{page.name}: {file} has no {name}"
    for target, anchor in re.findall(r"\]\((?!https?://)([^)#\s]*)#?([^)\s]*)\)", text):
        place = page.parent / target if target else page
        place = ROOT / "CONTRIBUTING.md" if place.name == "contributing.md" else place  # which includes it
        assert place.exists(), f"{page.name} links to {target}"
        assert not anchor or anchor in anchors(place), f"{page.name} links to {target}#{anchor}"


def test_every_public_name_is_in_the_reference() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs" / "reference").glob("*.md"))
    named = set(re.findall(r"armgpi\.(\w+)", text))
    assert set(dir(armgpi)) - {"__version__"} <= named


@cache
def tables() -> dict[str, str]:
    """Return the tables that the build makes from declarations, by the names that pages have for them."""
    made: dict[str, str] = runpy.run_path(str(ROOT / "docs" / "conf.py"))["myst_substitutions"]
    return made


def page_of_the_command_line() -> str:
    """Return the page with its tables."""
    text = (ROOT / "docs" / "cli.md").read_text(encoding="utf-8")
    for name, table in tables().items():
        text = text.replace(f"{{{{ {name} }}}}", table)
    return text


def test_every_table_that_the_build_makes_is_in_a_page_and_none_is_missing() -> None:
    texts = [page.read_text(encoding="utf-8") for page in PAGES]
    assert set(tables()) == {name for text in texts for name in re.findall(r"\{\{ (\w+) \}\}", text)}


def test_every_command_and_option_is_in_the_page_of_the_command_line() -> None:
    text = page_of_the_command_line()
    for declared_option in declared.options():
        assert f"`{declared_option.flag}`" in text
    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        assert f"armgpi {name}" in text
        for parameter in command.params:
            for option in parameter.opts:
                assert not option.startswith("-") or f"`{option}" in text, f"{name} {option}"


def test_every_declared_parameter_is_in_a_table_with_its_sentence() -> None:
    text = page_of_the_command_line()
    declared_ones = [each for kind in schema.KINDS.values() for each in kind.parameters.values()]
    for base in (Load, Wrapper, ToolPath):
        for cls in classes_of(base).values():
            if cls.__module__.startswith("armgpi."):  # not what a page declared before, in this process
                declared_ones += [each for each in parameters(cls).values() if each.in_file]
    assert len(declared_ones) > 40
    for each in declared_ones:
        assert f"| {each.text}" in text, each.text


def test_every_key_of_the_experiment_file_is_in_the_page_of_the_command_line() -> None:
    text = page_of_the_command_line()
    sections: dict[str, type[Section]] = {"": config.ExperimentConfig, **schema.SECTIONS}
    assert len(sections) > 10
    for name, section in sections.items():
        for key in section.keys:
            assert f"`{key}`" in text or f".{key}`" in text or f"{{{key}:" in text or f" {key}:" in text, (
                f"{name}: {key}"
            )


def test_the_page_of_faults_has_the_words_of_its_head() -> None:
    """`make faults` writes the page from the head: what was edited in one of the two would be undone."""
    head = (ROOT / "tools" / "faults.head.md").read_text(encoding="utf-8")
    text = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
    blocks = re.split(r"^(?:ARMS|BOUNDS|BEYOND|NAMED|OPEN|MATRIX)$", head, flags=re.MULTILINE)
    assert len(blocks) == 7
    words = [re.escape(block).replace("COUNT", r"\d+") for block in blocks]
    rows = r"\|.*(?:\n\|.*)*"  # a table
    assert re.fullmatch(rows.join(words), text)


def test_the_citation_has_the_version() -> None:
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {armgpi.__version__}\n" in text


def test_the_page_of_what_is_supported_names_every_target_back_end_plant_and_python() -> None:
    text = (ROOT / "docs" / "support.md").read_text(encoding="utf-8")
    versions = re.findall(r"Python :: (3\.\d+)", (ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    engines = [name for name, cls in classes_of(Arm).items() if cls.__module__.startswith("armgpi.")]
    assert len(versions) > 2
    assert len(engines) > 2
    for name in (*TARGETS, *BACKENDS, *engines):
        assert f"`{name}`" in text, name
    for version in versions:
        assert version in text, version
