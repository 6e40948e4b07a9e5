"""Draw functions by a seed, each with one of its lines marked, to ask a reader about.

python tools/reading.py --seed 7 --count 30 [FOLDER ...]

Whoever has not read the code is asked two questions of each: what does it do, and what would break if the
marked line were changed as it says? Only functions of at least five statements count, as the others say what
they do by their names. The same seed draws the same functions of the same code.
"""

from __future__ import annotations

import argparse
import ast
import random
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

#: A function of fewer statements than this is not drawn.
LEAST_STATEMENTS = 5
#: And none of more lines than this: a reader is asked about one screen.
MOST_LINES = 70


class Drawn(NamedTuple):
    """A function and the line that is asked about.

    Attributes:
        path: its file.
        name: of the function, after that of its class.
        first: number of its first line, from 1.
        last: number of its last line.
        marked: number of the line that is asked about.
    """

    path: Path
    name: str
    first: int
    last: int
    marked: int


def functions(folder: Path) -> Iterator[tuple[Path, str, ast.FunctionDef]]:
    """Yield file, name and syntax of the functions below a folder, in the order of their files and lines."""
    for path in sorted(folder.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        owners: list[tuple[str, ast.AST]] = [("", tree)]
        while owners:
            owner, node = owners.pop(0)
            for child in ast.iter_child_nodes(node):
                if isinstance(child, ast.ClassDef):
                    owners.append((f"{child.name}.", child))
                elif isinstance(child, ast.FunctionDef):
                    yield path, f"{owner}{child.name}", child


def asked_about(function: ast.FunctionDef) -> list[ast.stmt]:
    """Return the statements of a function that a question can be about: simple ones, no docstring."""
    kinds = (ast.Assign, ast.AugAssign, ast.Return, ast.Expr)
    docstring = function.body[0] if ast.get_docstring(function) is not None else None
    return [node for node in ast.walk(function) if isinstance(node, kinds) and node is not docstring]


def draw(folders: list[Path], seed: int, count: int) -> list[Drawn]:
    """Return functions drawn at random from all those of the folders, each with a line of it."""
    found = []
    for folder in folders:
        for path, name, function in functions(folder):
            statements = [node for node in ast.walk(function) if isinstance(node, ast.stmt)]
            length = (function.end_lineno or 0) - function.lineno + 1
            # The function itself and its docstring are statements as well.
            if len(statements) - 2 >= LEAST_STATEMENTS and length <= MOST_LINES and asked_about(function):
                found.append((path, name, function))
    drawing = random.Random(seed)
    drawn = []
    for path, name, function in drawing.sample(found, min(count, len(found))):
        line = drawing.choice(asked_about(function)).lineno
        drawn.append(Drawn(path, name, function.lineno, function.end_lineno or function.lineno, line))
    return drawn


def main() -> None:
    """Print the functions that a seed draws."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path, default=[Path("armgpi")])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=30)
    given = parser.parse_args()
    for number, each in enumerate(draw(given.folders, given.seed, given.count), start=1):
        print(f"## {number}. {each.name} ({each.path}:{each.first})\n")
        lines = each.path.read_text(encoding="utf-8").splitlines()
        for at in range(each.first, each.last + 1):
            print(f"{'>>' if at == each.marked else '  '} {lines[at - 1]}")
        print()


if __name__ == "__main__":
    main()
