"""Which planted bugs the tests of a module find: `python tools/mutants.py --count 60 --seed 1`.

Each mutant is one change of one module, in a copy of the tree: a sign, an index, off by one, a dropped term,
two factors of a matrix product swapped. The laws and the tests of the module run. `--planted` takes the five
that once survived the whole suite. Prints which were found; what survives may be a change of no result.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("robot", "plants", "loop", "studies", "certification")
#: Where else the tests of a package or module are.
ELSEWHERE = {"studies": ("tests/test_sweep.py", "tests/search"), "intervals": ("tests/test_sweep.py",)}
#: Longest time that the tests of a mutant may take [s]: who never ends is found.
PATIENCE = 600.0


class Mutant(NamedTuple):
    """One change of a module: the place, what is there, and what takes its place."""

    path: Path
    begin: int
    end: int
    new: str
    kind: str

    def __str__(self) -> str:
        """Return where it is and what it changes."""
        text = (ROOT / self.path).read_bytes()
        line, old = text[: self.begin].count(b"\n") + 1, text[self.begin : self.end].decode()
        return (
            f"{self.path}:{line} | {self.kind} | `{' '.join(old.split())}` -> `{' '.join(self.new.split())}`"
        )


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
        "np.where(k > 0.0, 1.0, 0.5), k > 0.0",
        "np.where(k > 0.0, 1.0, 1.0), k > 0.0",
    ),
    ("armgpi/files.py", "            _sync(partial)\n", "            pass\n"),
)


def planted() -> Iterator[Mutant]:
    """Yield the mutants that once survived."""
    for name, old, new in PLANTED:
        text = (ROOT / name).read_bytes()
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
            yield Mutant(path, begin, end, f"({ast.unparse(new)})", kind)


def _changes(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
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


def tests_of(path: Path) -> list[str]:
    """Return the tests of a module: of its name, the laws that no symmetry hides, and of its package."""
    package, stem = path.parent.name, path.stem
    laws = ROOT / "tests" / "laws" / "test_broken_symmetries.py"
    named = [*ROOT.glob(f"tests/**/test_{stem}.py"), laws, *ROOT.glob(f"tests/test_{package}*.py")]
    if (ROOT / "tests" / package).is_dir():
        named += (ROOT / "tests" / package).glob("test_*.py")
    found = [str(each.relative_to(ROOT)) for each in named]
    return list(dict.fromkeys([*found, *ELSEWHERE.get(package, ()), *ELSEWHERE.get(stem, ())]))


def survives(mutant: Mutant, tree: Path) -> bool:
    """Tell whether the tests of a mutant's module pass with it."""
    place = tree / mutant.path
    whole = place.read_bytes()
    place.write_bytes(whole[: mutant.begin] + mutant.new.encode() + whole[mutant.end :])
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "0", "-p", "no:cacheprovider"]
    try:
        done = subprocess.run(
            [*command, *tests_of(mutant.path)],
            cwd=tree,
            env={**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            timeout=PATIENCE,
            check=False,
        )
        return done.returncode == 0
    except subprocess.TimeoutExpired:
        return False
    finally:
        place.write_bytes(whole)


def main() -> None:
    """Run mutants and print those that survive."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--skip", type=int, default=0, help="so many of them, which were run before")
    parser.add_argument("--planted", action="store_true")
    asked = parser.parse_args()
    chosen = list(planted())
    if not asked.planted:
        modules = [path for name in PACKAGES for path in sorted((ROOT / "armgpi" / name).rglob("*.py"))]
        modules.append(ROOT / "armgpi" / "intervals.py")
        every = [each for path in modules for each in mutants_of(path.relative_to(ROOT))]
        chosen = random.Random(asked.seed).sample(every, min(asked.count, len(every)))
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        ignored = shutil.ignore_patterns(".git", ".venv", "build", "__pycache__", ".*_cache")
        shutil.copytree(ROOT, tree, ignore=ignored)
        print("| mutant | kind | change | |\n|---|---|---|---|")
        survivors = 0
        for mutant in chosen[asked.skip :]:
            alive = survives(mutant, tree)
            survivors += alive
            print(f"| {mutant} | {'SURVIVES' if alive else 'found'} |", flush=True)
    print(f"{survivors} of {len(chosen[asked.skip :])} survive")


if __name__ == "__main__":
    main()
