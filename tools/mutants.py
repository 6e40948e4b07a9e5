"""Which planted bugs the tests find: `python tools/mutants.py --count 60 --seed 1`.

Each mutant is one change of one module, in a copy of the tree: a sign, an index, off by one, a dropped term,
a matrix that is not transposed, two factors of a matrix product swapped; as many of each package. First the
tests run once and tell which of them reach which lines (`--reach FILE` keeps that, for other seeds too); then
each mutant meets those of its line, of its own module first, until one fails. What tests take is counted in
processor time, so a busy machine finds nothing. `--planted` takes the five that once survived the whole
suite. What survives may be a change of no result.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, NamedTuple

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("robot", "plants", "loop", "studies", "certification")
#: Folders of their tests.
FOLDERS = ("laws", *PACKAGES)
#: Processor time that the tests of one mutant take at most without it [s].
SECONDS = 40.0


class Mutant(NamedTuple):
    """One change of a module: the place, what is there, and what takes its place."""

    path: Path
    begin: int
    end: int
    new: str
    kind: str

    @property
    def lines(self) -> range:
        """Return the lines of what is changed."""
        text = (ROOT / self.path).read_bytes()
        first, last = (text[:place].count(b"\n") + 1 for place in (self.begin, self.end))
        return range(first, last + 1)

    def __str__(self) -> str:
        """Return where it is and what it changes."""
        old = (ROOT / self.path).read_bytes()[self.begin : self.end].decode()
        change = f"`{' '.join(old.split())}` -> `{' '.join(self.new.split())}`"
        return f"{self.path}:{self.lines[0]} | {self.kind} | {change}"


#: What survived the whole suite on 2026-11-22: file, text that is there once, and what takes its place.
PLANTED = (
    (
        "armgpi/robot/edits.py",
        "element.placement.act(pin.Inertia(mass, centre, tensor))",
        "pin.Inertia(mass, element.placement.translation + centre, tensor)",
    ),
    (
        "armgpi/robot/edits.py",
        "model.armature = factor * model.armature",
        "model.armature = 1.0 * model.armature",
    ),
    (
        "armgpi/intervals.py",
        "high = int(binom.ppf(1.0 - tail, n, share))",
        "high = int(binom.ppf(1.0 - tail, n, share)) - 1",
    ),
    (
        "armgpi/loop/running.py",
        "np.where(k > 0.0, 1.0, 0.5), np.ones",
        "np.where(k > 0.0, 1.0, 1.0), np.ones",
    ),
    ("armgpi/files.py", "            _sync(partial)\n", "            pass\n"),
)


def planted() -> Iterator[Mutant]:
    """Yield the mutants that once survived."""
    for name, old, new in PLANTED:
        text = (ROOT / name).read_bytes()
        if text.count(old.encode()) != 1:
            raise LookupError(f"{name}: {old!r} is not there once")
        begin = text.index(old.encode())
        yield Mutant(Path(name), begin, begin + len(old.encode()), new, "planted")


def mutants_of(path: Path) -> Iterator[Mutant]:
    """Yield every mutant of a module."""
    text = (ROOT / path).read_bytes()
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    for node in ast.walk(ast.parse(text)):
        for kind, new in _changes(node):
            begin = starts[node.lineno - 1] + node.col_offset  # type: ignore[attr-defined]
            end = starts[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]
            if _is(text[begin:end], node):
                yield Mutant(path, begin, end, f"({ast.unparse(new)})", kind)


def _is(text: bytes, node: ast.AST) -> bool:
    """Tell whether a text is an expression: places inside f-strings are wrong before Python 3.12."""
    try:
        return ast.unparse(ast.parse(b"(" + text + b")", mode="eval")) == ast.unparse(node)
    except (SyntaxError, ValueError):
        return False


def _changes(node: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    """Yield what an expression is changed to."""
    if isinstance(node, ast.BinOp):
        swapped = {ast.Add: ast.Sub(), ast.Sub: ast.Add()}.get(type(node.op))
        if swapped is not None:
            yield "sign", ast.BinOp(node.left, swapped, node.right)
            yield "dropped term", node.left
        if isinstance(node.op, ast.MatMult):
            yield "swapped", ast.BinOp(node.right, node.op, node.left)
    elif isinstance(node, ast.Compare) and len(node.ops) == 1:
        other = {ast.Lt: ast.LtE(), ast.LtE: ast.Lt(), ast.Gt: ast.GtE(), ast.GtE: ast.Gt()}.get(
            type(node.ops[0])
        )
        if other is not None:
            yield "off by one", ast.Compare(node.left, [other], node.comparators)
    elif isinstance(node, ast.Subscript) and isinstance(getattr(node.slice, "value", None), int):
        yield "index", ast.Subscript(node.value, ast.Constant(vars(node.slice)["value"] + 1), node.ctx)
    elif isinstance(node, ast.Attribute) and node.attr == "T":
        yield "frame", node.value


def every_mutant(package: str) -> list[Mutant]:
    """Return all mutants of a package, and of intervals.py among those of studies."""
    modules = sorted((ROOT / "armgpi" / package).rglob("*.py"))
    modules += [ROOT / "armgpi" / "intervals.py"] if package == "studies" else []
    return [each for path in modules for each in mutants_of(path.relative_to(ROOT))]


def draw(count: int, seed: int) -> list[Mutant]:
    """Return random mutants, as many of each package."""
    rng = random.Random(seed)
    return [each for name in PACKAGES for each in rng.sample(every_mutant(name), count // len(PACKAGES))]


# Which tests reach what: this file is a plugin of pytest, too.


class Reach:
    """Who comes by the lines that are asked for, test by test, and what each takes."""

    def __init__(self, root: Path, file: Path, lines: dict[str, list[int]]) -> None:
        self.root, self.file = root, file
        self.lines = {str(root / name): frozenset(each) for name, each in lines.items()}
        self.left: dict[CodeType, set[int]] = {}  # what the present test has not come by
        self.hits: set[str] = set()

    def enter(self, frame: FrameType, event: str, _: Any) -> Any:
        """Follow a call into a function that has such a line."""
        code = frame.f_code
        lines = self.lines.get(code.co_filename)
        if lines is None:
            return None
        left = self.left.get(code)
        if left is None:
            left = self.left[code] = {line for *_, line in code.co_lines() if line in lines}
        if not left:
            return None

        def follow(frame: FrameType, event: str, _: Any) -> Any:
            if event == "line" and frame.f_lineno in left:
                left.discard(frame.f_lineno)
                self.hits.add(f"{Path(code.co_filename).relative_to(self.root)}:{frame.f_lineno}")
            return follow if left else None

        return follow

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Write down what a test reached."""
        self.hits.clear()
        self.left.clear()
        sys.settrace(self.enter)  # a test may have taken it away
        begun = sum(os.times()[:4])
        self.failed = False
        yield
        row = [item.nodeid, sum(os.times()[:4]) - begun, self.failed, sorted(self.hits)]
        with self.file.open("a") as file:
            print(json.dumps(row), file=file)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Remember what failed by itself."""
        self.failed = self.failed or report.failed


def pytest_configure(config: pytest.Config) -> None:
    """Follow every call from here on, where lines are asked for."""
    if "ARMGPI_REACH" in os.environ:
        file = Path(os.environ["ARMGPI_REACH"])
        reach = Reach(config.rootpath, file, json.loads(file.read_text().splitlines()[0]))
        config.pluginmanager.register(reach)
        threading.settrace(reach.enter)
        sys.settrace(reach.enter)


def run(tree: Path, *arguments: str, seconds: float, **environment: str) -> int:
    """Run pytest in a tree and return how it ended; above so much processor time it is killed."""

    def bound() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds)))

    paths = os.pathsep.join([str(tree), str(tree / "tools")])
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", "-o", "timeout=0"]
    try:
        return subprocess.run(
            [*command, *arguments],
            cwd=tree,
            env={**os.environ, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1", **environment},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            preexec_fn=bound,
            timeout=20.0 * seconds,  # who waits for ever takes no processor time
            check=False,
        ).returncode
    except subprocess.TimeoutExpired:
        return -1


def reach(tree: Path, file: Path) -> list[list[Any]]:
    """Return the tests, what each takes, whether it fails, and which lines of mutants it comes by."""
    if not file.exists():
        lines: dict[str, set[int]] = {}
        for mutant in (*planted(), *(each for name in PACKAGES for each in every_mutant(name))):
            lines.setdefault(str(mutant.path), set()).update(mutant.lines)
        file.write_text(json.dumps({name: sorted(each) for name, each in sorted(lines.items())}) + "\n")
        tests = [f"tests/{name}" for name in FOLDERS]
        options = ("-p", "mutants", "-m", "not slow and not search")
        run(tree, *options, *tests, seconds=7200.0, ARMGPI_REACH=str(file))
    return [json.loads(line) for line in file.read_text().splitlines()[1:]]


def order(mutant: Mutant, rows: list[list[Any]]) -> tuple[list[str], float]:
    """Return the tests that reach a mutant, of its own module and package first, and their time [s]."""
    own = {f"{mutant.path}:{line}" for line in mutant.lines}
    reaching = [(name, took) for name, took, failed, hits in rows if not failed and own.intersection(hits)]
    total: dict[str, float] = {}
    for name, took in reaching:
        total[name.split("::")[0]] = total.get(name.split("::")[0], 0.0) + took

    def distance(row: tuple[str, float]) -> tuple[bool, bool, float, str, float]:
        file = Path(row[0].split("::")[0])
        near = mutant.path.parent.name in file.parts or file.parent.name == "laws"
        return file.stem != f"test_{mutant.path.stem}", not near, total[str(file)], str(file), row[1]

    found, seconds = [], 0.0
    for name, took in sorted(reaching, key=distance):
        if seconds + took <= SECONDS:
            found.append(name)
            seconds += took
    return found, seconds


def survives(mutant: Mutant, tests: tuple[list[str], float], tree: Path) -> bool:
    """Tell whether the tests that reach a mutant pass with it."""
    place = tree / mutant.path
    whole = place.read_bytes()
    place.write_bytes(whole[: mutant.begin] + mutant.new.encode() + whole[mutant.end :])
    try:
        return not tests[0] or run(tree, "-x", *tests[0], seconds=60.0 + 5.0 * tests[1]) == 0
    finally:
        place.write_bytes(whole)


def main() -> None:
    """Run mutants and print those that survive."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, nargs="+", default=[0])
    parser.add_argument("--skip", type=int, default=0, help="so many of them, which were run before")
    parser.add_argument("--reach", type=Path, help="where it is kept which tests reach what")
    parser.add_argument("--planted", action="store_true")
    asked = parser.parse_args()
    chosen = list(planted()) if asked.planted else [m for seed in asked.seed for m in draw(asked.count, seed)]
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder).resolve() / "tree"
        ignored = shutil.ignore_patterns(".git", ".venv", "build", "__pycache__", ".*_cache")
        shutil.copytree(ROOT, tree, ignore=ignored)
        rows = reach(tree, (asked.reach or Path(folder, "reach")).resolve())
        print("| mutant | kind | change | tests | |\n|---|---|---|---|---|")
        survivors = 0
        for mutant in chosen[asked.skip :]:
            tests = order(mutant, rows)
            alive = survives(mutant, tests, tree)
            survivors += alive
            print(f"| {mutant} | {len(tests[0])} | {'SURVIVES' if alive else 'found'} |", flush=True)
    print(f"{survivors} of {len(chosen[asked.skip :])} survive")


if __name__ == "__main__":
    main()
