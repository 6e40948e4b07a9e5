"""Every example runs as it stands: headless, from any folder, to its end, and says something."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from commands import fork_script

FOLDER = Path(__file__).parents[2] / "examples"
EXAMPLES = sorted(path.name for path in FOLDER.glob("*.py"))
#: PEP 723: what a script needs, in a form that tools can read.
HEADER = re.compile(
    r'# /// script\n# requires-python = ">=3\.10"\n'
    r'# dependencies = \["armgpi(\[(robots|viz|compiled)\])?"(, "[a-z-]+")*\]\n'
    r'# \[tool\.uv\.sources\]\n# armgpi = \{ path = "\.\." \} [^\n]*\n# ///\n"""'
)


def test_there_are_examples() -> None:
    assert len(EXAMPLES) >= 8


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs_to_its_end_and_says_something(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    done = fork_script((FOLDER / name).read_text(encoding="utf-8"), folder=tmp_path, warn="error")
    assert done.code == 0, done.err
    assert done.err == ""
    assert len(done.out.splitlines()) >= 4
    assert not re.search(r"\b(nan|inf)\b", done.out)
    assert list(tmp_path.iterdir()) == []  # and leaves nothing behind


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_is_short_and_says_what_it_needs(name: str) -> None:
    text = (FOLDER / name).read_text()
    assert len(text.splitlines()) <= 100
    assert HEADER.match(text)


def test_the_table_of_examples_is_whole() -> None:
    listed = re.findall(r"(?m)^\| \[(\S+\.py)\]\((\S+)\)", (FOLDER / "README.md").read_text())
    assert [name for name, _ in listed] == [link for _, link in listed] == EXAMPLES
