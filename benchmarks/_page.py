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

#: Script -> the sentence that its page begins with: what a reader finds there.
PURPOSE = {
    "batch": (
        "This page says how long one sample of one rollout takes when many rollouts run at once, "
        "and how many times as long other programs take."
    ),
    "compliance": (
        "This page has what impedance controllers and force limits reach in simulation: springs, "
        "walls, hands and rivals, each against a goal."
    ),
    "derive": (
        "This page says how long `armgpi derive` takes to derive D, C and G in closed form, arm by arm."
    ),
    "elastic": (
        "This page says how many times as long a batch with elastic joints takes as one with stiff joints."
    ),
    "export": (
        "This page says how long one step of an exported controller takes in C, and how many "
        "times as long it takes in Python."
    ),
    "first_result": (
        "This page says how many seconds pass until a first simulated run is done, with and "
        "without code in the cache."
    ),
    "float32": (
        "This page says how many times as fast a batch would be in float32 as in float64, and how far its "
        "results would be off."
    ),
    "growth": (
        "This page says how the time of a compiled run grows with joints, rollouts, samples and "
        "what is recorded."
    ),
    "inverse_kinematics": (
        "This page says how many poses `armgpi.inverse_kinematics` solves, and how long a pose takes."
    ),
    "kernels": (
        "This page says how long forward dynamics, inverse dynamics and the inertia matrix take "
        "in generated code, and in other libraries."
    ),
    "prepared": "This page says how long a prepared loop takes to start again, and what metrics cost.",
    "realistic": (
        "This page says how many times as long the loop of `armgpi run` takes as the simplest "
        "one, and which part of it costs how much."
    ),
    "recording": (
        "This page says how many times as long a run takes that keeps its trajectories, by what it keeps."
    ),
    "references": "This page says what it costs that each rollout of a batch has a reference of its own.",
    "single": (
        "This page says how long one sample of a single run takes, and how many times as long "
        "other programs take."
    ),
    "start": "This page says how much processor time each command takes from its start to its end.",
    "supervisor": "This page says how many times as long a simulated run takes under a supervisor.",
    "sweep": "This page says how long a sweep of a million rollouts takes, compared with a bare loop.",
    "tool": (
        "This page has how closely the tool follows a circle and noisy streams of poses, and what "
        "a sample of that costs."
    ),
    "validate": "This page says how long `armgpi validate` takes for right and wrong models.",
}


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
    print(f"# {title}\n\n{PURPOSE[name]}")
    given = (f" --part {part}" if part else "") + (" --quick" if quick else "")
    print(f"\n`python benchmarks/{name}.py{given}`\n")
    print(f"World: {world}.\n")
    print(_timing.machine_table(facts))
    if quick:
        print("\nQuick: too few rounds to judge by.")
    return Page(name, quick, {**facts, "world": world}, {}, part)
