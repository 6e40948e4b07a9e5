"""Measure the structure of the code: packages, imports between them, functions, comments, docstrings, pages.

Usage:
    python tools/structure.py [ROOT]    print the numbers of the repository at ROOT (this one by default)
    python tools/structure.py --check   print the functions that are too long, and fail if there are any
    python tools/structure.py --words   print the words of prose of each page, and of all

Here a package is what is right below ``armgpi``, a module alone too. An arrow is an import of one by another,
lazy ones and those for types included. Lines of code carry neither a docstring nor a comment alone. A line
with Any has it in an annotation. Words of prose are outside fences, directives, tables, displayed formulas
and addresses; code in a line is one word.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import NamedTuple

PROJECT = "armgpi"
MAX_LINES = 60  # of a function, its docstring not counted
MAX_COMPLEXITY = 10  # as in pyproject.toml, [tool.ruff.lint.mccabe]

# What is no prose -> what stands for it in the count.
NO_PROSE = {
    r"(?ms)^ *(`{3,}).*?^ *\1`*$": "",  # fences
    r"(?s)\$\$.*?\$\$|<!--.*?-->": "",
    r"(?m)^ *(\||:{3,}|:[\w-]+:).*$": "",  # tables, directives, their options
    r"(`+)[^`]+\1": "code",
    r"\$[^$]+\$": "formula",
    r"!?\[([^\]]*)\]\([^)]*\)": r"\1",  # a link without its address
}

# Functions that may be longer, each with its reason.
LONG: dict[str, str] = {}

_NO_CODE = {tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
Function = ast.FunctionDef | ast.AsyncFunctionDef
Documented = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


class Measured(NamedTuple):
    """A function: where it is, how long without its docstring, how complex."""

    name: str
    lines: int
    complexity: int


class Module(NamedTuple):
    """What is measured of a file."""

    package: str
    lines: int
    code: int
    comments: int
    docstrings: list[int]
    functions: list[Measured]
    imports: set[str]
    with_any: int


def docstring_lines(node: Documented) -> set[int]:
    """Return the line numbers that the docstring of a module, class or function takes."""
    first = node.body[0] if node.body else None
    if ast.get_docstring(node, clean=False) is None or first is None:
        return set()
    return set(range(first.lineno, (first.end_lineno or first.lineno) + 1))


def complexity(body: list[ast.stmt]) -> int:
    """Count branch points as ruff's C901 does: neither comprehensions nor `and` and `or`."""
    total = 0
    for node in body:
        if isinstance(node, ast.If | ast.For | ast.AsyncFor | ast.While | Function):
            total += 1
        elif isinstance(node, ast.Try):
            total += len(node.handlers) + bool(node.orelse)
            total += sum(complexity(handler.body) for handler in node.handlers)
        elif isinstance(node, ast.Match):
            total += sum(not _catches_all(case) for case in node.cases)
            total += sum(complexity(case.body) for case in node.cases)
        for name in ("body", "orelse", "finalbody"):
            total += complexity(getattr(node, name, []))
    return total


def _catches_all(case: ast.match_case) -> bool:
    """Tell whether a case is `case _` or a bare name."""
    return case.guard is None and isinstance(case.pattern, ast.MatchAs) and case.pattern.pattern is None


def public_docstrings(body: list[ast.stmt]) -> Iterator[int]:
    """Return the lengths of the docstrings of public functions, classes and methods."""
    for node in body:
        if isinstance(node, ast.ClassDef | Function) and not node.name.startswith("_"):
            if ast.get_docstring(node):
                yield len(docstring_lines(node))
            if isinstance(node, ast.ClassDef):
                yield from public_docstrings(node.body)


def imported(tree: ast.Module, parts: tuple[str, ...], is_package: bool) -> Iterator[str]:
    """Return the packages that a module imports, anywhere in it."""
    for node in ast.walk(tree):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = parts[: len(parts) - node.level + is_package] if node.level else ()
            base = ".".join([*above, *filter(None, [node.module])])
            names = [f"{base}.{alias.name}" for alias in node.names] if base == PROJECT else [base]
        for name in names:
            top, _, rest = name.partition(".")
            if top == PROJECT and rest:
                yield rest.split(".")[0]


def annotations(nodes: list[ast.AST]) -> Iterator[ast.expr]:
    """Yield the annotations of variables, parameters and returned values."""
    for node in nodes:
        written: ast.expr | None = None
        if isinstance(node, ast.AnnAssign | ast.arg):
            written = node.annotation
        elif isinstance(node, Function):
            written = node.returns
        if written is not None:
            yield written


def lines_with_any(nodes: list[ast.AST]) -> set[int]:
    """Return the lines on which an annotation has Any."""
    lines = set()
    for annotation in annotations(nodes):
        for node in ast.walk(annotation):
            if isinstance(node, ast.Name) and node.id == "Any":
                lines.add(node.lineno)
    return lines


def read(path: Path, root: Path) -> Module:
    """Measure a file."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    nodes = list(ast.walk(tree))
    docstrings = set().union(*(docstring_lines(node) for node in nodes if isinstance(node, Documented)))
    code: set[int] = set()
    comments: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            comments.add(token.start[0])
        elif token.type not in _NO_CODE:
            code.update(range(token.start[0], token.end[0] + 1))
    place = path.relative_to(root)
    parts = place.with_suffix("").parts
    return Module(
        package=parts[1] if len(parts) > 1 else "",
        lines=len(text.splitlines()),
        code=len(code - docstrings),
        comments=len(comments),
        docstrings=list(public_docstrings(tree.body)),
        functions=[
            Measured(
                f"{place}:{node.name}",
                (node.end_lineno or 0) - node.lineno + 1 - len(docstring_lines(node)),
                1 + complexity(node.body),
            )
            for node in nodes
            if isinstance(node, Function)
        ],
        imports=set(imported(tree, parts, path.name == "__init__.py")),
        with_any=len(lines_with_any(nodes)),
    )


def circles(arrows: dict[str, set[str]]) -> list[list[str]]:
    """Return the groups of packages that import each other, directly or through others."""
    reached = {package: set(others) for package, others in arrows.items()}
    for middle in arrows:
        for package in arrows:
            if middle in reached[package]:
                reached[package] |= reached[middle]
    groups = {
        tuple(sorted(other for other in reached[package] if package in reached[other]))
        for package in arrows
        if package in reached[package]
    }
    return [list(group) for group in sorted(groups)]


def too_long(modules: list[Module]) -> list[Measured]:
    """Return the functions over the limit that are not excepted."""
    functions = (function for module in modules for function in module.functions)
    return [f for f in functions if f.lines > MAX_LINES and f.name not in LONG]


def prose(text: str) -> int:
    """Count the words of prose of a page in Markdown."""
    for pattern, instead in NO_PROSE.items():
        text = re.sub(pattern, instead, text)
    return sum(bool(re.search(r"\w", word)) for word in text.split())


def show_words(root: Path) -> None:
    """Print the words of each page, the longest first, and of all; the changelog apart."""
    pages = [root / "README.md", root / "CONTRIBUTING.md", *(root / "docs").rglob("*.md")]
    words = {page.relative_to(root).as_posix(): prose(page.read_text(encoding="utf-8")) for page in pages}
    for page in sorted(words, key=lambda page: -words[page]):
        print(f"{words[page]:7,} {page}")
    changelog = prose((root / "CHANGELOG.md").read_text(encoding="utf-8"))
    print(f"{sum(words.values()):7,} in all, and {changelog:,} in CHANGELOG.md")


def show(modules: list[Module], tests: list[Module]) -> None:
    """Print everything."""
    packages: dict[str, list[Module]] = {}
    for module in modules:
        packages.setdefault(module.package, []).append(module)
    del packages["__init__"]  # the public names, once
    arrows = {
        package: {name for module in inside for name in module.imports if name in packages} - {package}
        for package, inside in packages.items()
    }
    head = f"{'package':14}{'modules':>8}{'lines':>8}{'code':>8}{'Any':>6}{'comments':>10}{'docstring':>11}"
    print(f"{head}   imports")
    for package, inside in sorted(packages.items()):
        _row(package, inside, ", ".join(sorted(arrows[package])))
    _row("all", modules, f"{sum(map(len, arrows.values()))} arrows between {len(arrows)} packages")
    for group in circles(arrows):
        print(f"circle: {', '.join(group)}")

    functions = [function for module in modules for function in module.functions]
    lengths = [function.lines for function in functions]
    print(f"functions: {len(functions)}; lines: median {median(lengths):g}, most {max(lengths)}")
    complex_ones = [f for f in functions if f.complexity > MAX_COMPLEXITY]
    share = len(complex_ones) / len(functions)
    print(f"functions of complexity over {MAX_COMPLEXITY}: {len(complex_ones)} ({share:.1%})")
    for function in sorted(complex_ones, key=lambda f: -f.complexity):
        print(f"  {function.complexity:4} {function.name}")
    long_ones = [f for f in functions if f.lines > MAX_LINES]
    print(f"functions over {MAX_LINES} lines: {len(long_ones)}")
    for function in sorted(long_ones, key=lambda f: -f.lines):
        print(f"  {function.lines:4} {function.name}" + (" (excepted)" if function.name in LONG else ""))
    code, tested = sum(m.code for m in modules), sum(m.code for m in tests)
    print(f"code lines of the tests: {tested}, {tested / code:.2f} per code line")


def _row(name: str, modules: list[Module], note: str) -> None:
    """Print a package's sums; comments as a share of the code, docstrings as their median of lines."""
    lines, code, comments = (sum(column) for column in zip(*(m[1:4] for m in modules), strict=True))
    docstrings = [length for module in modules for length in module.docstrings]
    typical = f"{median(docstrings):g}" if docstrings else "-"
    share = f"{comments / code:.1%}" if code else "-"
    with_any = sum(module.with_any for module in modules)
    print(f"{name:14}{len(modules):8}{lines:8}{code:8}{with_any:6}{share:>10}{typical:>11}   {note}")


def main() -> None:
    """Print the numbers, or check the lengths."""
    parser = argparse.ArgumentParser(description="Measure the structure of the code.")
    parser.add_argument("root", nargs="?", type=Path, default=Path(__file__).resolve().parent.parent)
    parser.add_argument("--check", action="store_true", help="only look for functions that are too long")
    parser.add_argument("--words", action="store_true", help="count the words of prose of the pages instead")
    arguments = parser.parse_args()
    root: Path = arguments.root
    if arguments.words:
        return show_words(root)
    modules = [read(path, root) for path in sorted((root / PROJECT).rglob("*.py"))]
    if arguments.check:
        found = too_long(modules)
        for function in found:
            print(f"{function.name} has {function.lines} lines, more than {MAX_LINES}: part it")
        stale = sorted(LONG.keys() - {f.name for m in modules for f in m.functions if f.lines > MAX_LINES})
        for name in stale:
            print(f"{name} is not too long (any more): strike it from LONG in tools/structure.py")
        sys.exit(bool(found or stale))
    show(modules, [read(path, root) for path in sorted((root / "tests").rglob("*.py"))])


if __name__ == "__main__":
    main()
