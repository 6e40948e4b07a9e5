"""Which planted bugs the tests find: `python tools/mutants.py --count 60 --seed 1`.

Each mutant is one change of one module, in a copy of the tree: a sign, an index, off by one, a dropped term,
a matrix that is not transposed, two factors of a matrix product swapped; as many of each package, or all of
the modules that are named. First the tests run once and tell which of them reach which lines (`--reach FILE`
keeps that for as long as the lines stay, and takes in new tests). Then each mutant meets those of its line,
of its own module first, until one fails, in a fork of the process that has collected the tests; who survives
there, in a process of its own as well. What they take is counted in processor time, so a busy machine finds
nothing. `--planted` takes the five that once survived the whole suite. What survives may be a change of no
result.

`--nearest` judges each mutant in one fresh process, by the six test files nearest to it (the same names of
modules, packages and functions), at first by the tests that name its function, until one fails: no test has
to run first, and nothing that was worked out before the bug was planted is left. Such a process is a fork of
one that has the libraries of other makers and nothing of armgpi. It says which mutants are compiled to the
same byte code, and which tests needed more time than `--seconds`. `--again FILE` takes the mutants of a
table that was printed before, found by their text where lines have moved, so what lived once can meet the
tests that were written for it: those that its row names, or else the nearest.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import functools
import gc
import importlib
import inspect
import itertools
import json
import os
import pkgutil
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, FrameType, FunctionType
from typing import Any, NamedTuple

import pytest

#: The modules that are in no package.
TOP = "."
#: Every folder of modules: drawings, pages and command lines too, whose numbers are results as well.
PACKAGES = (*sorted(p.parent.name for p in Path(__file__).parents[1].glob("armgpi/*/__init__.py")), TOP)
#: The tests of the modules that are in no package.
BASE = "base"
#: What pytest takes at most to begin, and to collect the files of some tests [s].
_STARTS = 60.0
#: How pytest runs the tests of these packages.
PYTEST = ("-n", "0", "-p", "no:cacheprovider", "-o", "timeout=0", "-m", "not slow and not search")


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
        text = self.path.read_bytes()
        first, last = (text[:place].count(b"\n") + 1 for place in (self.begin, self.end))
        return range(first, last + 1)

    def __str__(self) -> str:
        """Return where it is and what it changes."""
        return f"{self.path}:{self.lines[0]} | {self.kind} | {self.change}"

    @property
    def change(self) -> str:
        """Return what is there and what takes its place."""
        old = self.path.read_bytes()[self.begin : self.end].decode()
        return f"`{' '.join(old.split())}` -> `{' '.join(self.new.split())}`"


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
        "armgpi/base/intervals.py",
        "high = int(binom.ppf(1.0 - tail, n, share))",
        "high = int(binom.ppf(1.0 - tail, n, share)) - 1",
    ),
    (
        "armgpi/loop/running.py",
        "np.where(k > 0.0, 1.0, 0.5), np.ones",
        "np.where(k > 0.0, 1.0, 1.0), np.ones",
    ),
    ("armgpi/base/files.py", "            _sync(partial)\n", "            pass\n"),
)


def planted() -> Iterator[Mutant]:
    """Yield the mutants that once survived."""
    for name, old, new in PLANTED:
        text = Path(name).read_bytes()
        if text.count(old.encode()) != 1:
            raise LookupError(f"{name}: {old!r} is not there once")
        begin = text.index(old.encode())
        yield Mutant(Path(name), begin, begin + len(old.encode()), new, "planted")


def mutants_of(path: Path) -> Iterator[Mutant]:
    """Yield every mutant of a module."""
    text = path.read_bytes()
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
    """Return all mutants of a package, or of the modules that are in none."""
    folder = Path("armgpi", package)
    modules = sorted(folder.glob("*.py") if package == TOP else folder.rglob("*.py"))
    return [each for path in modules for each in mutants_of(path)]


def draw(count: int, seed: int) -> list[Mutant]:
    """Return random mutants, as many of each package; the first ones have those that are left over."""
    rng = random.Random(seed)
    each, more = divmod(count, len(PACKAGES))
    drawn = []
    for index, name in enumerate(PACKAGES):
        drawn += rng.sample(every_mutant(name), each + (index < more))
    return drawn


def again(file: Path) -> dict[Mutant, list[str]]:
    """Return the mutants of a printed table, and the tests that their rows name.

    Of each it is the one with its text that is nearest to its line.

    Rows whose text a module no longer has are printed, and left out.
    """
    found = {}
    for row in re.finditer(r"(armgpi/\S+\.py):(\d+) \| ([^|]+) \| (`.*)", file.read_text()):
        path, line, kind, rest = Path(row[1]), int(row[2]), row[3], row[4]
        alike = [each for each in mutants_of(path) if each.kind == kind and rest.startswith(each.change)]
        if not alike:
            print(f"the module no longer has this text: {row[0]}", file=sys.stderr)
            continue
        mutant = min(alike, key=lambda each: abs(each.lines[0] - line))
        found[mutant] = re.findall(r"tests/[^\s|]+", rest)
    return found


# By the nearest tests: one fresh process for each mutant.

#: How many test files a mutant meets.
_NEAREST = 6
#: What tests import of other makers; who is not installed is left out.
_LIBRARIES = (
    *("numpy", "scipy.linalg", "scipy.optimize", "scipy.signal", "scipy.spatial", "scipy.stats"),
    *("pinocchio", "xarray", "h5netcdf", "yaml", "mujoco", "click", "matplotlib"),
)
#: A file of tests counts as near from here on: the test file of a module that uses the mutant's.
_NEAR = 2


def nearest(mutant: Mutant, tests: dict[Path, str]) -> tuple[list[str], list[str]]:
    """Return the tests that are nearest to a mutant, of all tests' texts.

    Returns:
        the functions of tests that name the function or class of the mutant; and whole files.
    """
    stem = mutant.path.stem
    package = mutant.path.parts[1] if len(mutant.path.parts) > 2 else BASE
    around = set()
    for node in ast.walk(ast.parse(mutant.path.read_bytes())):
        if not isinstance(node, ast.FunctionDef | ast.ClassDef):
            continue
        if node.lineno <= mutant.lines[0] <= (node.end_lineno or 0) and not node.name.startswith("__"):
            around.add(node.name)
    words = [re.compile(rf"\b{re.escape(name)}\b") for name in around - {"step", "init", "of"}]
    module = re.compile(rf"\b{package}(\.\w+)*\.{re.escape(stem)}\b|import .*\b{re.escape(stem)}\b")
    users = {f"test_{path.stem}" for path, text in sources().items() if module.search(text)}

    def score(path: Path) -> int:
        own = 8 if path.stem == f"test_{stem}" else 5 if path.stem.startswith(f"test_{stem}") else 0
        same = 3 if package in path.parts else 1 if "laws" in path.parts else 0
        says = 4 * sum(bool(word.search(tests[path])) for word in words)
        uses = (4 if module.search(tests[path]) else 0) + (2 if path.stem in users else 0)
        return own + same + says + uses

    ranked = sorted(tests, key=lambda path: (-score(path), len(tests[path]), str(path)))
    files = [path for path in ranked if score(path) >= _NEAR][:_NEAREST]
    named = []
    for path in files:
        for node in ast.parse(tests[path]).body:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                text = ast.get_source_segment(tests[path], node) or ""
                if any(word.search(text) for word in words):
                    named.append(f"{path}::{node.name}")
    return named, [str(path) for path in files]


@functools.cache
def sources() -> dict[Path, str]:
    """Return the text of each module."""
    return {path: path.read_text() for path in sorted(Path("armgpi").rglob("*.py"))}


def load_libraries() -> None:
    """Import what tests need of other makers, once: each mutant's process is a fork of this one.

    Nothing of armgpi is among it, so each process imports the mutant's module anew.
    """
    for name in _LIBRARIES:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    if any(name.partition(".")[0] == "armgpi" for name in sys.modules):
        raise RuntimeError("a library has imported armgpi: processes would have it without the mutant")
    gc.freeze()  # a fork shares its memory with this process


def first_failure(tests: list[str], seconds: float, slow: bool) -> str:
    """Run tests in a fork and return the first that failed; "" where none did, "?" where the time was over.

    Args:
        tests: as pytest takes them.
        seconds: of processor time at most.
        slow: whether the slow ones are among them.

    Raises:
        RuntimeError: where pytest could not run them.
    """
    if not tests:
        return ""
    options = [*PYTEST, "-m", ""] if slow else PYTEST
    with tempfile.TemporaryFile("w+") as said:
        child = os.fork()
        if child == 0:
            try:
                os.setsid()
                os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
                for stream in (1, 2):
                    os.dup2(said.fileno(), stream)
                limit = int(seconds)
                resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
                signal.alarm(20 * limit)  # who waits for ever takes no processor time
                os._exit(int(pytest.main([*options, "-x", "-q", "--no-header", "--tb=no", *tests])))
            finally:
                os._exit(2)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)  # what it started
        said.seek(0)
        text = said.read()
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", text, re.MULTILINE)
    if failed:
        return failed[1]
    if code in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
        return ""
    if code < 0:
        return "?"
    raise RuntimeError(text)


def judge_by_nearest(chosen: list[Mutant], seconds: float, asked: dict[Mutant, list[str]]) -> None:
    """Print which mutants tests find, each in a fresh process.

    Args:
        chosen: the mutants.
        seconds: of processor time that the tests of one may take: who needs more has found nothing.
        asked: tests that a mutant meets in place of those that are nearest to it.
    """
    tests = {path: path.read_text() for path in sorted(Path("tests").rglob("test_*.py"))}
    load_libraries()
    print("| mutant | kind | change | by | |\n|---|---|---|---|---|", flush=True)
    counts = Counter[str]()
    for mutant in chosen:
        if computes_the_same(mutant):
            said, outcome = "", "the same byte code"
        else:
            named, files = nearest(mutant, tests)
            by_row = asked.get(mutant, [])
            # One after the other: to collect whole files may take longer than to run a single test.
            stages = [by_row] if by_row else [named, files]
            with planted_in_file(mutant):
                runs = [first_failure(stages[0], seconds, bool(by_row))]
                if runs[0] in ("", "?") and len(stages) > 1:
                    runs.append(first_failure(stages[1], seconds, slow=False))
            failed = next((run for run in runs if run not in ("", "?")), "")
            outcome = "found" if failed else "NOT FOUND IN TIME" if "?" in runs else "SURVIVES"
            said = failed or " ".join(by_row or files)
        counts[outcome] += 1
        print(f"| {mutant} | {said} | {outcome} |", flush=True)
    print(f"{len(chosen)} mutants: " + ", ".join(f"{count} {outcome}" for outcome, count in counts.items()))


def computes_the_same(mutant: Mutant) -> bool:
    """Tell whether a module with the mutant is compiled to the same byte code."""
    whole = mutant.path.read_bytes()
    changed = whole[: mutant.begin] + mutant.new.encode() + whole[mutant.end :]
    return [body(code) for code in codes(whole)] == [body(code) for code in codes(changed)]


#: The times of planted files differ by whole seconds: Python takes what it compiled for a file of that time.
_PLANTED_AT = itertools.count(2_000_000_000)


@contextlib.contextmanager
def planted_in_file(mutant: Mutant) -> Iterator[bytes]:
    """Have a module's file with the mutant for a while; yield its text."""
    place = mutant.path.resolve()
    whole, when = place.read_bytes(), place.stat()
    text = whole[: mutant.begin] + mutant.new.encode() + whole[mutant.end :]
    place.write_bytes(text)
    os.utime(place, 2 * (next(_PLANTED_AT),))
    try:
        yield text
    finally:
        place.write_bytes(whole)
        os.utime(place, (when.st_atime, when.st_mtime))


# Which tests reach what, and which fail: this file is a plugin of pytest, which collects the tests once.


class Reach:
    """Who comes by the lines that are asked for, test by test, and what each takes."""

    def __init__(self, file: Path, lines: dict[str, set[int]]) -> None:
        self.file, self.lines = file, {str(Path(name).resolve()): each for name, each in lines.items()}
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
                self.hits.add(f"{Path(code.co_filename).relative_to(Path.cwd())}:{frame.f_lineno}")
            return follow if left else None

        return follow

    def of(self, items: list[pytest.Item]) -> None:
        """Run tests, and write down what each took, whether it failed and what it reached."""
        threading.settrace(self.enter)
        for item, following in zip(items, [*items[1:], None], strict=True):
            self.hits.clear()
            self.left.clear()
            sys.settrace(self.enter)  # a test may have taken it away
            begun, failed = sum(os.times()[:4]), item.session.testsfailed
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            took = sum(os.times()[:4]) - begun
            row = [item.nodeid, took, item.session.testsfailed > failed, sorted(self.hits)]
            with self.file.open("a") as file:
                print(json.dumps(row), file=file)


def aside(work: Callable[[], object], seconds: float) -> bool:
    """Do work in a fork, silently, in so much processor time at most; tell whether it says so in time."""
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        try:
            os.setsid()
            silent = os.open(os.devnull, os.O_RDWR)
            for each in range(3):
                os.dup2(silent, each)
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds)))
            signal.alarm(int(10.0 * seconds))  # who waits for ever takes no processor time
            os._exit(0 if work() else 1)
        finally:
            os._exit(2)
    _, status = os.waitpid(child, 0)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)  # what it started
    if os.waitstatus_to_exitcode(status) == 2:
        raise RuntimeError("it could not be done")
    return status == 0


def order(mutant: Mutant, rows: list[list[Any]], seconds: float) -> tuple[list[str], float]:
    """Return the tests that meet a mutant, and their time [s].

    Those that come by its lines, of its own module and package first; then others of its module, and of the
    files of those: what one computed, others may look at.
    """
    own, met = {f"{mutant.path}:{line}" for line in mutant.lines}, {x for *_, hits in rows for x in hits}
    if not own & met:  # numbers that are there from the start: whoever comes by anything of the module
        own = {hit for hit in met if hit.startswith(f"{mutant.path}:")}
    took, total, reaching = dict[str, float](), dict[str, float](), set[str]()
    for name, time, failed, hits in rows:
        file = name.split("::")[0]
        if not failed:
            took[name] = time
        if not failed and own.intersection(hits):
            reaching.add(name)
            total[file] = total.get(file, 0.0) + time

    def distance(name: str) -> tuple[bool, bool, bool, float, str, float]:
        file = Path(name.split("::")[0])
        near = mutant.path.parent.name in file.parts or file.parent.name == "laws"
        other = file.stem != f"test_{mutant.path.stem}"
        return name not in reaching, other, not near, total.get(str(file), 0.0), str(file), took[name]

    found, spent = [], 0.0
    for name in sorted(took, key=distance):
        file = name.split("::")[0]
        if (file in total or Path(file).stem == f"test_{mutant.path.stem}") and spent + took[name] <= seconds:
            found.append(name)
            spent += took[name]
    return found, spent


def codes(text: bytes) -> Iterator[CodeType]:
    """Yield a module's functions, the inner ones as well, in their order."""
    todo = [compile(text, "module", "exec", dont_inherit=True)]
    while todo:
        code = todo.pop()
        yield code
        todo += [each for each in code.co_consts if isinstance(each, CodeType)]


def body(code: CodeType) -> tuple[object, ...]:
    """Return what a function computes, without the functions in it."""
    return code.co_code, code.co_names, [x for x in code.co_consts if not isinstance(x, CodeType)]


def take(old: bytes, new: bytes, functions: list[FunctionType]) -> bool:
    """Have the functions of an imported module compute what its new text says; tell whether they do."""
    try:
        change = dict(zip(codes(old), codes(new), strict=True))
        for function in functions:
            function.__code__ = change[function.__code__]
    except (ValueError, KeyError):  # a function less, or a variable less of the function around it
        return False
    return any(body(a) != body(b) for a, b in change.items() if a.co_flags & inspect.CO_OPTIMIZED)


class Judge:
    """Runs mutants and prints those that survive, in place of pytest's own loop."""

    def __init__(self, chosen: list[Mutant], file: Path, seconds: float) -> None:
        self.chosen, self.file, self.seconds = chosen, file, seconds
        self.functions: dict[str, list[FunctionType]] = {}

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Print the table."""
        for module in pkgutil.walk_packages(["armgpi"], "armgpi."):
            with contextlib.suppress(Exception):  # what needs an optional package
                importlib.import_module(module.name)
        gc.unfreeze()  # what the tests have frozen, as all that is imported, is not listed
        for function in gc.get_objects():
            if isinstance(function, FunctionType):
                self.functions.setdefault(function.__code__.co_filename, []).append(function)
        gc.freeze()  # a fork then shares its memory with this process
        # One folder for all, where what is compiled is kept.
        session.config._tmp_path_factory.getbasetemp()  # type: ignore[attr-defined]
        items = {item.nodeid: item for item in session.items}
        known = self.rows()
        if new := [item for name, item in items.items() if name not in {row[0] for row in known}]:
            lines: dict[str, set[int]] = {}
            for mutant in (*planted(), *(each for name in PACKAGES for each in every_mutant(name))):
                lines.setdefault(str(mutant.path), set()).update(mutant.lines)
            aside(lambda: Reach(self.file, lines).of(new), 7200.0)
        rows = [row for row in self.rows() if row[0] in items]
        print("| mutant | kind | change | tests | |\n|---|---|---|---|---|")
        survivors = 0
        for mutant in self.chosen:
            names, seconds = order(mutant, rows, self.seconds)
            alive = self.survives(mutant, [items[name] for name in names], 10.0 + 3.0 * seconds)
            survivors += alive
            print(f"| {mutant} | {len(names)} | {'SURVIVES' if alive else 'found'} |", flush=True)
        print(f"{survivors} of {len(self.chosen)} survive")
        return True

    def rows(self) -> list[list[Any]]:
        """Return what is known of tests."""
        return [json.loads(line) for line in self.file.read_text().splitlines()] if self.file.exists() else []

    def survives(self, mutant: Mutant, items: list[pytest.Item], seconds: float) -> bool:
        """Tell whether tests pass with a mutant, in their own processes too."""
        place, whole = mutant.path.resolve(), mutant.path.read_bytes()

        def passes_alone() -> bool:
            command = [sys.executable, "-m", "pytest", *PYTEST, "-x", *(item.nodeid for item in items)]
            return subprocess.run(command, check=False).returncode == 0

        def passes(text: bytes) -> bool:
            if not take(whole, text, self.functions.get(str(place), [])):
                return passes_alone()
            for item, following in zip(items, [*items[1:], None], strict=True):
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
                if item.session.testsfailed:
                    return False
            return True

        with planted_in_file(mutant) as text:
            # What a module of tests worked out, or a cache kept, when tests were collected is without the
            # mutant in a fork: who survives there meets the same tests in a process of its own.
            survives_here = not items or aside(lambda: passes(text), seconds)
            return survives_here and (not items or aside(passes_alone, seconds + _STARTS))


def main() -> None:
    """Run mutants and print those that survive."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, nargs="+", default=[0])
    parser.add_argument("--skip", type=int, default=0, help="so many of them, which were run before")
    parser.add_argument("--reach", type=Path, help="where it is kept which tests reach what")
    parser.add_argument("--seconds", type=float, default=40.0, help="of processor time without it for each")
    parser.add_argument("--planted", action="store_true")
    parser.add_argument("--nearest", action="store_true", help="in fresh processes, by the nearest tests")
    parser.add_argument("--again", type=Path, help="the mutants of this table, which was printed before")
    parser.add_argument("modules", type=Path, nargs="*", help="all mutants of these, instead")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        tree, kept = Path(folder).resolve() / "tree", (asked.reach or Path(folder, "reach")).resolve()
        compiled = () if asked.nearest else ("__pycache__",)  # valid where the times of files are kept
        ignored = shutil.ignore_patterns(".git", ".venv", "build", *compiled, ".*_cache")
        shutil.copytree(Path(__file__).resolve().parent.parent, tree, ignore=ignored)
        table, first = asked.again and asked.again.resolve(), dict[Mutant, list[str]]()
        os.chdir(tree)
        if asked.planted:
            chosen = list(planted())
        elif table:
            first = again(table)
            chosen = list(first)
        elif asked.modules:
            chosen = [each for path in asked.modules for each in mutants_of(path)]
        else:
            chosen = [each for seed in asked.seed for each in draw(asked.count, seed)]
        sys.path.insert(0, str(tree))
        os.environ["PYTHONPATH"] = str(tree)
        if asked.nearest:
            judge_by_nearest(chosen[asked.skip :], asked.seconds, first)
            return
        sys.dont_write_bytecode = True
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
        few = {each.path.parts[1] for each in chosen} if asked.modules and kept.exists() else PACKAGES
        rooms = [BASE if name == TOP else name for name in PACKAGES if name in few or name == TOP]
        tests = [f"tests/{name}" for name in ("laws", *rooms)]
        judge = Judge(chosen[asked.skip :], kept, asked.seconds)
        sys.exit(pytest.main([*PYTEST, "-q", "-s", f"--basetemp={folder}/tests", *tests], plugins=[judge]))


if __name__ == "__main__":
    main()
