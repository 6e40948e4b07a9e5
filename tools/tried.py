"""Which robots of a folder load, and why others are refused: `python tools/tried.py FOLDER [FOLDER ...]`.

Each URDF, MJCF and xacro below the folders is loaded, in a process of its own with a limit of time. Joints
that a refusal asks to lock, as those of a free base, are locked. Prints a table by folder, and the reasons.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import sys
import warnings
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from armgpi import Robot
from armgpi.base import files
from armgpi.errors import ArmgpiError

#: How long a file may take [s], and how large it may be [bytes].
PATIENCE, MOST = 60, 32 * 2**20
#: Endings of what may be a robot.
ENDINGS = (".urdf", ".xacro", ".xml", ".mjcf")


class Tried(NamedTuple):
    """What became of a file: its format, and how it ended."""

    path: Path
    form: str
    end: str


def form_of(path: Path) -> str:
    """Return the format of a file of a robot; "" for another file."""
    try:
        text = files.read_text(path, MOST)
    except (OSError, ValueError):
        return ""
    if "<mujoco" in text and re.search(r"<(body|include|worldbody)", text):
        return "MJCF"
    if "<robot" not in text:
        return ""
    return "xacro" if path.suffix == ".xacro" or ".xacro" in path.suffixes else "URDF"


def load(path: Path) -> str:
    """Return how a file ends: "loads", with what, or why it is refused."""
    how: dict[str, list[str]] = {}
    for _ in range(8):
        try:
            robot = Robot.load(path, **how)
        except ArmgpiError as error:
            locks = [
                name
                for remedy in getattr(error, "remedies", ())
                if remedy.kind == "lock"
                for name in remedy.joints
            ]
            if locks and not set(locks) & set(how.get("lock", [])):
                how["lock"] = [*how.get("lock", []), *locks]
                continue
            return f"refused: {str(error).replace(str(path) + ': ', '')}"
        locked = f", {len(how['lock'])} joints locked as it asks" if how else ""
        return f"loads: {robot.n} joints{locked}"
    return "refused: one joint after the other has to be locked"


def within(path: Path) -> str:
    """Return how a file ends, loaded in a fork that has so long."""
    reader, writer = os.pipe()
    if not (child := os.fork()):
        warnings.simplefilter("ignore")
        signal.alarm(PATIENCE)
        said = "traceback"
        try:
            said = load(path)
        except BaseException as error:
            said = f"TRACEBACK: {type(error).__name__}: {error}"
        os.write(writer, said.encode(errors="replace")[:4000])
        os._exit(0)
    os.close(writer)
    status = os.waitpid(child, 0)[1]
    with open(reader, encoding="utf-8", errors="replace") as stream:
        said = " ".join(stream.read().split())
    return said or f"ended by {status}"


def shorten(end: str) -> str:
    """Return why a file is refused without what differs between files."""
    end = re.sub(r"/\S*/", "", end)
    end = re.sub(r"'[^']*'(, '[^']*')*", "'...'", end)
    return re.sub(r"\d+", "N", end)[:110]


def main() -> int:
    """Print a table of the files, and what they were refused for; return 1 after a traceback."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--each", action="store_true", help="list each file")
    chosen = parser.parse_args()
    bad = 0
    print("| folder | format | files | load | refused |\n|---|---|---|---|---|")
    reasons: Counter[tuple[str, str, str]] = Counter()
    for folder in chosen.folders:
        found: dict[str, list[Tried]] = {}
        for path in sorted(each for each in folder.rglob("*") if each.suffix in ENDINGS and each.is_file()):
            if form := form_of(path):
                tried = Tried(path, form, within(path))
                found.setdefault(form, []).append(tried)
                bad += not tried.end.startswith(("loads", "refused"))
                if chosen.each:
                    print(f"{path.relative_to(folder)}: {tried.end}", file=sys.stderr, flush=True)
        for form, all_of_it in sorted(found.items()):
            good = [tried for tried in all_of_it if tried.end.startswith("loads")]
            for tried in all_of_it:
                if tried not in good:
                    reasons[folder.name, form, shorten(tried.end)] += 1
            count = len(all_of_it)
            print(f"| {folder.name} | {form} | {count} | {len(good)} | {count - len(good)} |", flush=True)
    print("\n| folder | format | files | refused because |\n|---|---|---|---|")
    for (name, form, reason), count in reasons.most_common():
        print(f"| {name} | {form} | {count} | {reason.partition(': ')[2] or reason} |")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
