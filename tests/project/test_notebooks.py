"""What notebooks show: tables of what there is, in which no text of a file is HTML; and ours run."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from commands import fork_script
from sampling import for_search

from armgpi import GPI, Hold, RigidBodyPlant, Robot, simulate, validate
from armgpi.base.escape import html_table
from armgpi.hardware.realtime import run
from armgpi.health import inspect
from armgpi.paper.arm import PaperArm

ARM = Robot.load("anthropomorphic3")


class _Tags(HTMLParser):
    """Counts tags, and keeps the text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.open.append(tag)
        self.tags.add(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += f" {data}"


@pytest.mark.parametrize(
    ("shown", "words"),
    [
        (ARM, ("anthropomorphic3", "q1", "revolute")),
        (inspect("anthropomorphic3"), ("anthropomorphic3", "level", "what to do")),
        (validate(PaperArm(), ARM), ("agrees", "largest error")),
        (
            run(RigidBodyPlant(ARM), GPI(ARM, 1e-3), Hold(ARM.middle()), 0.01, clock="simulated"),
            ("samples", "10"),
        ),
    ],
    ids=["robot", "health", "validation", "loop"],
)
def test_it_is_a_table_that_is_well_formed(shown: Any, words: tuple[str, ...]) -> None:
    page = _Tags(shown._repr_html_())
    assert not page.open
    assert page.tags <= {"table", "caption", "b", "thead", "tbody", "tr", "th", "td"}
    assert all(word in page.text for word in words)


def test_names_from_files_are_text() -> None:
    page = _Tags(html_table("<script>x</script>", ["a\x1b[2J"], [["<img src=x>"]]))
    assert not {"script", "img"} & page.tags
    assert "<script>x</script>" in page.text
    assert "\x1b" not in page.text


def test_a_rollout_is_a_pandas_frame() -> None:
    pandas = pytest.importorskip("pandas")
    rollout = simulate(RigidBodyPlant(ARM), GPI(ARM, 1e-3), Hold(ARM.middle()), 0.01, progress=False)
    frame = rollout[["q", "tau"]].to_dataframe()
    assert isinstance(frame, pandas.DataFrame)
    assert len(frame) == 11 * 3
    assert frame.loc[(0.0, "q2"), "q"] == ARM.middle()[1]


NOTEBOOKS = sorted((Path(__file__).parents[2] / "examples" / "notebooks").glob("*.ipynb"))
#: Runs the cells of a notebook as a kernel does, its motions of 10 s and 4 s shortened, and prints the kinds
#: of what each shows.
RUNS = """
import json, sys
from IPython.core.interactiveshell import InteractiveShell
shell = InteractiveShell.instance()
for cell in json.load(open(sys.argv[1], encoding="utf-8"))["cells"]:
    if cell["cell_type"] == "code":
        source = "".join(cell["source"])
        for usual, seconds in zip(("10.0", "4.0)"), sys.argv[2:]):
            source = source.replace(usual, seconds)
        done = shell.run_cell(source)
        done.raise_error()
        shown = {} if done.result is None else shell.display_formatter.format(done.result)[0]
        print("SHOWN", *shown)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "shows", "seconds"),
    [
        ("1_from_urdf_to_controller", ["text/html", "text/html", "image/png", "text/html", "text/html"], ()),
        ("2_the_papers_tables", ["text/markdown", "image/png"], ()),
        ("3_validate_a_model", ["text/html", "text/html"], ()),
        ("4_identify_an_arm", ["text/html"], ("5.0", "1.0)")),
        ("5_compliance", ["image/png"] * 4, ()),
        for_search("4_identify_an_arm", ["text/html"], ()),
    ],
)
def test_a_notebook_runs_and_shows_what_it_makes(
    name: str, shows: list[str], seconds: tuple[str, ...], tmp_path: Path
) -> None:
    pytest.importorskip("IPython")
    path = next(path for path in NOTEBOOKS if path.stem == name)
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        assert not cell.get("outputs")  # they would get old
    done = fork_script(RUNS, path, *seconds, folder=tmp_path)
    assert done.code == 0, done.out + done.err
    kinds = [line.split()[1:] for line in done.out.splitlines() if line.startswith("SHOWN")]
    best = [next((kind for kind in each if kind != "text/plain"), "") for each in kinds]
    assert [kind for kind in best if kind] == shows


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_page_of_a_notebook_has_its_cells_with_outputs(notebook: Path) -> None:
    """`python tools/notebooks.py` writes the pages anew."""
    page = (notebook.parents[2] / "docs" / "notebooks" / f"{notebook.stem}.md").read_text(encoding="utf-8")
    place = 0
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        shown = f"```{{code-block}} python\n{source}\n```" if cell["cell_type"] == "code" else source
        assert shown in page[place:]
        place = page.index(shown, place) + len(shown)
    assert "<table>" in page or "![" in page
    for picture, caption in re.findall(r"!\[[^]]*\]\(\.\./images/([^)]*)\)\n*(.*)", page):
        assert caption.startswith("*")  # what is seen in it
        assert (notebook.parents[2] / "docs" / "images" / picture).is_file()


def test_there_are_five_notebooks() -> None:
    assert len(NOTEBOOKS) == 5
