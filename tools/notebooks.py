"""Write the notebooks of examples/ as pages with their outputs: docs/notebooks/*.md and their pictures.

The notebooks have no outputs of their own, which would get old; `python tools/notebooks.py` runs them anew.
"""

from __future__ import annotations

import json
import re
import sys
import warnings
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
PAGES = ROOT / "docs" / "notebooks"
#: Longest HTML that a page holds [characters]: tables, and no page with an animation.
LONGEST = 20_000
#: What is said in place of a page that is too large.
INSTEAD = "*In the notebook, a page with tables, plots and the animation opens here.*"


class Cell(NamedTuple):
    """A cell of a notebook; `picture` and `caption` of its metadata describe the picture that it draws."""

    kind: str
    source: str
    picture: str
    caption: str


def cells_of(notebook: Path) -> list[Cell]:
    """Return the cells of a notebook."""
    cells = []
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        said = cell["metadata"]
        source = "".join(cell["source"])
        cells.append(Cell(cell["cell_type"], source, said.get("picture", ""), said.get("caption", "")))
    return cells


def output(shell: Any, cell: Cell, picture: Path) -> str:
    """Run a cell and return what it shows as Markdown.

    Args:
        shell: of IPython.
        cell: what is run, and how its picture is described.
        picture: where a picture goes.
    """
    from IPython.utils.capture import capture_output

    with capture_output() as captured:
        done = shell.run_cell(cell.source)
    done.raise_error()
    parts = (
        [f"```text\n{captured.stdout.rstrip()}\n```"]
        if captured.stdout.strip() and done.result is None
        else []
    )
    if done.result is None:
        return "\n\n".join(parts)
    shown = shell.display_formatter.format(done.result)[0]
    if "image/png" in shown:
        if not (cell.picture and cell.caption):
            sys.exit(
                f"{picture.stem}: its metadata needs a picture (what is drawn) and a caption (what is seen)"
            )
        picture.parent.mkdir(parents=True, exist_ok=True)
        picture.write_bytes(shown["image/png"])
        return f"![{cell.picture}](../images/notebooks/{picture.name})\n\n*{cell.caption}*"
    if "text/markdown" in shown:
        return re.sub("^###", "##", str(shown["text/markdown"]), flags=re.MULTILINE)
    if "text/html" in shown:
        html = str(shown["text/html"])
        return (
            INSTEAD if len(html) > LONGEST else "\n".join(line for line in html.splitlines() if line.strip())
        )
    return f"```text\n{shown['text/plain']}\n```"


def page(notebook: Path) -> str:
    """Run a notebook and return its page."""
    from IPython.core.interactiveshell import InteractiveShell

    shell = InteractiveShell.instance()
    shell.reset()
    parts = [f"<!-- By tools/notebooks.py from examples/notebooks/{notebook.name}. -->"]
    for number, cell in enumerate(cells_of(notebook)):
        if cell.kind != "code":
            parts.append(cell.source)
            continue
        parts.append(f"```{{code-block}} python\n{cell.source}\n```")
        picture = ROOT / "docs" / "images" / "notebooks" / f"{notebook.stem}_{number}.png"
        parts.append(output(shell, cell, picture))
    return "\n\n".join(part for part in parts if part) + "\n"


def main() -> None:
    """Write the pages of all notebooks, or of those named."""
    warnings.simplefilter("ignore")
    PAGES.mkdir(exist_ok=True)
    for notebook in NOTEBOOKS:
        if not sys.argv[1:] or notebook.stem in sys.argv[1:]:
            (PAGES / f"{notebook.stem}.md").write_text(page(notebook), encoding="utf-8")
            print(notebook.stem)


if __name__ == "__main__":
    main()
