"""What every benchmark does around its measurements: options, the head of its page, its file of figures."""

from __future__ import annotations

import argparse
import json
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import _timing

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "build" / "benchmarks"
PACKAGES = ("armgpi", "casadi", "pin", "numpy", "mujoco", "drake", "dynibo")
#: World of plants that are made in Python, of which nothing is assumed.
EXPLICIT = "ideal: stiff joints, no rotors, no friction, exact positions, but for what a table names"


class Page(NamedTuple):
    """A benchmark under way.

    Attributes:
        name: of the script.
        quick: whether it is only a look.
        facts: what the machine is.
        figures: what was measured, for the file.
        part: the only one that is measured; empty for all.
    """

    name: str
    quick: bool
    facts: dict[str, Any]
    figures: dict[str, Any]
    part: str = ""

    def write(self) -> None:
        """Write the figures to build/benchmarks/."""
        FOLDER.mkdir(parents=True, exist_ok=True)
        whole = {"machine": self.facts, "quick": self.quick, **self.figures}
        (FOLDER / f"{self.name}.json").write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")


def say(text: str) -> None:
    """Print a paragraph."""
    print("\n" + textwrap.fill(text, 105, break_long_words=False, break_on_hyphens=False))


def begin(file: str, title: str, world: str = EXPLICIT, parts: Sequence[str] = ()) -> Page:
    """Read the options and print the head of the page.

    Args:
        file: of the script.
        title: of the page.
        world: what is assumed of the arms that are simulated.
        parts: names of its parts, where they can be measured one by one.
    """
    parser = argparse.ArgumentParser(description=title)
    parser.add_argument("--quick", action="store_true", help="a look, not to judge by")
    if parts:
        parser.add_argument("--part", choices=parts, default="", help="measure this part alone")
    options = parser.parse_args()
    quick, part = options.quick, getattr(options, "part", "")
    name = Path(file).stem
    facts = _timing.machine(PACKAGES)
    print(f"# {title}")
    given = (f" --part {part}" if part else "") + (" --quick" if quick else "")
    print(f"\n`python benchmarks/{name}.py{given}`\n")
    print(f"World: {world}.\n")
    print(_timing.machine_table(facts))
    if quick:
        print("\nQuick: too few rounds to judge by.")
    return Page(name, quick, {**facts, "world": world}, {}, part)
