"""Load thousands of broken URDFs and see that none crashes, hangs or gives dynamics that are no numbers.

Good URDFs are mutated: elements deleted, repeated, swapped and moved, names and numbers corrupted, bytes
changed. Each must end in one of our errors or in a robot with finite D(q), G(q) and accelerations.

Usage: python tools/fuzz_urdf.py [--count 20000] [--seed 0] [--keep FOLDER]

Mutations are tried in processes of their own, with 2 GiB of memory, and each with 10 s of processor time, so
that a busy machine finds nothing, and 200 s at most; one that dies is counted as a crash. Exit code 1 when
anything went wrong; the files are then in FOLDER.
"""

from __future__ import annotations

import argparse
import collections
import copy
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Literal
from xml.etree import ElementTree

import numpy as np

from armgpi import health, robots
from armgpi.errors import ArmgpiError

SEEDS = ("anthropomorphic3", "panda", "ur5", "so101", "kinova", "z1", "double_pendulum", "finger_edu")
CHUNK = 500
#: What the process of a mutation may take [bytes].
MEMORY = 2 * 1024**3
#: What a mutation may take of processor time, and of time [s].
SECONDS = 10
SECONDS_ON_THE_CLOCK = 200
NUMBERS = (
    *("nan", "inf", "-inf", "1e400", "1e308", "-1e308", "1e200", "1e20", "1e9", "1e-9", "1e-200", "1e-320"),
    *("0", "-0", "-1", "1", "", " ", "1,5", "${m}", "0x10", "1_0", "1 2", "1 2 3 4", "heavy", "٢", "true"),
)
NAMES = ("", " ", "a" * 10_000, "关节🤖", "../../etc", "<b>", "universe", "root_joint", "\n", "a b", "None")
TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar", "ball", "", "REVOLUTE")


def mutated(text: str, rng: random.Random) -> bytes:
    """Return a URDF with one to four things wrong."""
    root = ElementTree.fromstring(text)
    for _ in range(rng.randint(1, 4)):
        rng.choice(MUTATIONS)(root, rng)
    data = ElementTree.tostring(root)
    if rng.random() < 0.15:
        data = scrambled(data, rng)
    return data


def pick(root: ElementTree.Element, rng: random.Random) -> tuple[ElementTree.Element, int]:
    """Return an element that has children, and the index of one."""
    parents = [element for element in root.iter() if len(element)]
    if not parents:
        root.append(ElementTree.Element("link"))
        parents = [root]
    parent = rng.choice(parents)
    return parent, rng.randrange(len(parent))


def delete(root: ElementTree.Element, rng: random.Random) -> None:
    """Take an element away."""
    parent, index = pick(root, rng)
    del parent[index]


def repeat(root: ElementTree.Element, rng: random.Random) -> None:
    """Put an element there twice, the second one with another number perhaps."""
    parent, index = pick(root, rng)
    parent.insert(rng.randrange(len(parent) + 1), copy.deepcopy(parent[index]))


def swap(root: ElementTree.Element, rng: random.Random) -> None:
    """Exchange two elements."""
    (one, i), (two, j) = pick(root, rng), pick(root, rng)
    first, second = one[i], two[j]
    if first is second or second in first.iter() or first in second.iter():
        return
    one[i], two[j] = second, first


def move(root: ElementTree.Element, rng: random.Random) -> None:
    """Put an element elsewhere."""
    parent, index = pick(root, rng)
    element = parent[index]
    homes = [home for home in root.iter() if home not in element.iter()]
    del parent[index]
    rng.choice(homes).append(element)


def attributes(root: ElementTree.Element, *keys: str) -> list[tuple[ElementTree.Element, str]]:
    """Return elements and the attributes of theirs that are among the keys; all when none is given."""
    return [(e, key) for e in root.iter() for key in e.attrib if not keys or key in keys]


def number(root: ElementTree.Element, rng: random.Random) -> None:
    """Corrupt or scale one number."""
    found = [(e, k) for e, k in attributes(root) if k not in ("name", "link", "type", "joint", "filename")]
    if not found:
        return
    element, key = rng.choice(found)
    words = element.get(key, "").split() or ["0"]
    index = rng.randrange(len(words))
    if rng.random() < 0.5:
        words[index] = rng.choice(NUMBERS)
    else:
        try:
            words[index] = repr(
                float(words[index]) * rng.choice((-1, 10, 1000, 1e-3, 57.3)) ** rng.randint(1, 8)
            )
        except (ValueError, OverflowError):
            words[index] = rng.choice(NUMBERS)
    element.set(key, " ".join(words))


def name(root: ElementTree.Element, rng: random.Random) -> None:
    """Give something another's name, or a strange one."""
    found = attributes(root, "name", "link", "joint", "filename")
    if found:
        element, key = rng.choice(found)
        other, its = rng.choice(found)
        element.set(key, other.get(its, "") if rng.random() < 0.6 else rng.choice(NAMES))


def kind(root: ElementTree.Element, rng: random.Random) -> None:
    """Give a joint another type."""
    joints = root.findall("joint")
    if joints:
        rng.choice(joints).set("type", rng.choice(TYPES))


def tag(root: ElementTree.Element, rng: random.Random) -> None:
    """Give an element another tag."""
    tags = [*sorted({element.tag for element in root.iter()}), "xacro:if", "limits", "robot"]
    parent, index = pick(root, rng)
    parent[index].tag = rng.choice(tags)


def attribute(root: ElementTree.Element, rng: random.Random) -> None:
    """Take an attribute away, or add a mimic."""
    found = attributes(root)
    if found and rng.random() < 0.7:
        element, key = rng.choice(found)
        del element.attrib[key]
        return
    joints = root.findall("joint")
    if joints:
        leader = rng.choice(joints).get("name", "")
        ratio = rng.choice(NUMBERS)
        ElementTree.SubElement(rng.choice(joints), "mimic", joint=leader, multiplier=ratio)


def scrambled(data: bytes, rng: random.Random) -> bytes:
    """Change, cut or repeat some bytes."""
    array = bytearray(data)
    for _ in range(rng.randint(1, 5)):
        place = rng.randrange(len(array) or 1)
        end = min(len(array), place + rng.randint(1, 40))
        what = rng.randrange(4)
        if what == 0:
            array[place : place + 1] = [rng.randrange(256)]
        elif what == 1:
            del array[place:end]
        elif what == 2:
            array[place:place] = array[place:end]
        else:
            array = array[: max(1, place)]
    return bytes(array)


def mendable(root: ElementTree.Element, rng: random.Random) -> None:
    """Do what a repair undoes: commas between numbers, or a mass of 0."""
    vectors = attributes(root, "xyz", "rpy")
    masses = list(root.iter("mass"))
    if vectors and rng.random() < 0.5:
        element, key = rng.choice(vectors)
        element.set(key, rng.choice((", ", ",")).join(element.get(key, "").split()))
    elif masses:
        rng.choice(masses).set("value", "0")


MUTATIONS = (delete, repeat, swap, move, number, number, number, name, kind, tag, attribute, mendable)


def cases(seed: int, start: int, count: int) -> Iterator[tuple[int, bytes]]:
    """Give mutations by number: the same seed and number give the same file."""
    texts = [robots.locate(name)[0].read_text(encoding="utf-8") for name in SEEDS]
    for index in range(start, start + count):
        rng = random.Random(f"{seed}/{index}")
        yield index, mutated(rng.choice(texts), rng)


def outcome(path: Path, rng: np.random.Generator) -> str:
    """Return how a file ends: "refused", "errors", "repaired" or "loaded"; raises what is no error of ours.

    A file whose refusal names repairs must load with them.
    """
    mimic: Literal["lock", "follow"] = "follow" if rng.random() < 0.3 else "lock"
    repair: list[str] = []
    try:
        report = health.inspect(path, mimic=mimic)
    except ArmgpiError as error:
        if "\n" in str(error):
            raise AssertionError(f"an error of several lines: {error}") from error
        repair = [str(remedy.value) for remedy in error.remedies if remedy.kind == "repair"]
        if not repair:
            return "refused"
        report = health.inspect(path, mimic=mimic, repair=",".join(repair))
    robot = report.robot
    q = np.vstack([robot.middle(), robot.random_positions(5)])
    for result in (
        robot.mass_matrix(q),
        robot.gravity(q),
        robot.forward_dynamics(q, np.zeros_like(q), np.zeros_like(q)),
    ):
        if not np.isfinite(result).all():
            raise AssertionError("dynamics that are no numbers")
    if repair:
        return "repaired"
    return "errors" if report.has_errors else "loaded"


def too_slow(number: int, frame: FrameType | None) -> None:
    """End a mutation that takes too long."""
    raise TimeoutError(f"too slow ({signal.Signals(number).name})")


def work(seed: int, start: int, count: int, folder: Path) -> None:
    """Try some mutations; each line of the output is a number and how it ended."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    warnings.simplefilter("error", RuntimeWarning)
    signal.signal(signal.SIGALRM, too_slow)
    signal.signal(signal.SIGPROF, too_slow)
    path = folder / f"case{os.getpid()}.urdf"
    rng = np.random.default_rng(seed)
    for index, data in cases(seed, start, count):
        print(index, "begun", flush=True)
        path.write_bytes(data)
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        signal.alarm(SECONDS_ON_THE_CLOCK)
        try:
            result = outcome(path, rng)
        except Exception as error:
            traceback.print_exc()
            result = f"failed:{type(error).__name__}"
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.alarm(0)
        print(index, result, flush=True)
    path.unlink()


def chunk(
    seed: int, start: int, count: int, folder: str, ends: collections.Counter[str], bad: list[tuple[int, str]]
) -> int:
    """Try some mutations in a process of their own, note how they ended, and return where to go on."""
    command = [sys.executable, __file__, "--seed", str(seed), "--folder", folder]
    done = subprocess.run(
        [*command, "--work", str(start), str(count)], capture_output=True, text=True, check=False
    )
    last = (start, "begun")
    for line in done.stdout.splitlines():
        index, _, result = line.partition(" ")
        last = (int(index), result)
        if result != "begun":
            ends[result] += 1
            if result.startswith("failed"):
                bad.append(last)
    if last[1] == "begun":
        ends["crashed"] += 1
        bad.append((last[0], f"crashed ({done.returncode})"))
    if done.returncode or any(result.startswith("failed") for _, result in bad[-5:]):
        sys.stderr.write(done.stderr[-3000:])
    return last[0] + 1


def main() -> int:
    """Try all mutations, print how they ended, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, default=None, help="folder for the files that went wrong")
    parser.add_argument("--work", type=int, nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work is not None:
        start, count = options.work
        work(options.seed, start, count, options.folder)
        return 0
    began = time.monotonic()
    ends: collections.Counter[str] = collections.Counter()
    bad: list[tuple[int, str]] = []
    with tempfile.TemporaryDirectory() as folder:
        start = 0
        while start < options.count:
            count = min(CHUNK, options.count - start)
            start = chunk(options.seed, start, count, folder, ends, bad)
            print(f"{start} of {options.count}: {dict(ends)}", file=sys.stderr, flush=True)
    if bad and options.keep is not None:
        options.keep.mkdir(parents=True, exist_ok=True)
        for index, _ in bad:
            ((_, data),) = cases(options.seed, index, 1)
            (options.keep / f"{options.seed}_{index}.urdf").write_bytes(data)
    print(f"{sum(ends.values())} mutations in {time.monotonic() - began:.0f} s: {dict(ends)}")
    for index, result in bad:
        print(f"  {index}: {result}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
