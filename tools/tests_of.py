"""Find the tests of a class, a function or a module by its name.

Usage: python tools/tests_of.py NAME [NAME ...]

Prints the tests that use the name, as pytest takes them: `tests/gpi/test_gains.py::test_name`. Where none
does, as for a class that a function returns, it prints the files that import from its module or are called
as it is; where there are none, those of its room.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DEFINITIONS = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


@cache
def syntax_tree(path: Path) -> ast.Module:
    """Return the syntax tree of a source."""
    return ast.parse(path.read_text(encoding="utf-8"))


def test_files() -> list[Path]:
    """Return all files of tests."""
    return sorted((ROOT / "tests").rglob("test_*.py"))


def modules_with(name: str) -> list[Path]:
    """Return the modules of armgpi that are called so, or define a class or a function of that name."""
    modules = []
    for path in sorted((ROOT / "armgpi").rglob("*.py")):
        if name == path.stem:
            modules.append(path)
        elif name in path.read_text(encoding="utf-8"):
            statements = syntax_tree(path).body
            if name in {node.name for node in statements if isinstance(node, DEFINITIONS)}:
                modules.append(path)
    return modules


def tests_that_use(name: str) -> list[str]:
    """Return the tests in which a name stands."""
    tests = []
    for path in test_files():
        if name not in path.read_text(encoding="utf-8"):
            continue
        file = path.relative_to(ROOT).as_posix()
        definitions = [node for node in syntax_tree(path).body if isinstance(node, DEFINITIONS)]
        tests += [f"{file}::{node.name}" for node in definitions if is_test(node) and uses(node, name)]
    return tests


def is_test(node: DEFINITIONS) -> bool:
    """Tell whether pytest collects a function or a class."""
    return node.name.lower().startswith("test")


def uses(tree: ast.AST, name: str) -> bool:
    """Tell whether a name, an attribute or an argument of that name stands in a source."""
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=used) | ast.Attribute(attr=used) | ast.arg(arg=used) if used == name:
                return True
    return False


def files_about(module: Path) -> list[Path]:
    """Return the files of tests that import from a module, or are called as it is; else those of its room."""
    parts = module.relative_to(ROOT).with_suffix("").parts
    dotted = ".".join(parts)
    package = ".".join(parts[:-1])
    files = []
    for path in test_files():
        text = path.read_text(encoding="utf-8")
        imports = f"from {dotted} import" in text or f"from {package} import {parts[-1]}" in text
        if imports or path.stem == f"test_{parts[-1]}":
            files.append(path)
    if files:
        return files
    room = parts[1] if len(parts) > 2 else "base"
    return sorted((ROOT / "tests" / room).rglob("test_*.py"))


def tests_of(name: str) -> list[str]:
    """Return the tests of a name, as pytest takes them; none where armgpi has no such name."""
    modules = modules_with(name)
    if not modules:
        return []
    tests = tests_that_use(name)
    if tests:
        return tests
    files = {path for module in modules for path in files_about(module)}
    return [path.relative_to(ROOT).as_posix() for path in sorted(files)]


def main(names: Sequence[str]) -> int:
    """Print the tests of some names; return the exit code."""
    if not names:
        print(__doc__, file=sys.stderr)
        return 2
    for name in names:
        tests = tests_of(name)
        if not tests:
            print(f"armgpi has no class, function or module {name!r}", file=sys.stderr)
            return 2
        print(*tests, sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
