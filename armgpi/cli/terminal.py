"""What the commands print: through here, so that text from files does nothing but be read."""

from __future__ import annotations

import os
import re
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Timer
from time import monotonic
from typing import TYPE_CHECKING, Any

import typer

from armgpi.base.escape import printable

if TYPE_CHECKING:
    from rich.console import Console


#: Lines for stderr that wait until a command prints something else; an error in between drops them.
_HELD: list[str] = []


def hold(text: str) -> None:
    """Print a line to stderr before whatever is printed next, or at the end, but never before an error.

    A command says which arm and controller it judges as soon as it knows them. Where it then fails, its error
    is the only line.
    """
    _HELD.append(text)


@contextmanager
def lines_held() -> Iterator[None]:
    """Let lines wait within a command: its end prints those that still do, an error drops them."""
    try:
        yield
    except (typer.Exit, SystemExit):
        print_held()
        raise
    except BaseException:
        _HELD.clear()
        raise
    print_held()


def print_held() -> None:
    """Print the lines that wait."""
    held = _HELD.copy()
    _HELD.clear()
    for line in held:
        typer.secho(printable(line), err=True)


def say(text: object, *, err: bool = False, fg: str | None = None, lines: bool = False) -> None:
    """Print a line.

    Args:
        text: the line.
        err: to stderr in place of stdout.
        fg: its colour, on a terminal.
        lines: whether it is several lines, of which the last may be ended already.
    """
    print_held()
    line = printable(text, lines=lines)
    typer.secho(line, err=err, fg=fg, nl=not (lines and line.endswith("\n")))


def say_data(text: str) -> None:
    """Print the content of a file: as it is to a file or a pipe, safe to look at on a terminal."""
    print_held()
    if sys.stdout.isatty():
        say(text, lines=True)
    else:
        typer.echo(text, nl=not text.endswith("\n"))


#: Seconds after which a pipe gets its first line of progress, and between two lines.
_FIRST_LINE, _NEXT_LINE = 5.0, 30.0
#: Seconds of work that does not say how far it is after which it says what it does.
_SILENT_AT_MOST = 10.0
#: Seconds of a long task after which lines that were held are printed, when refusals are unlikely.
_HELD_AT_MOST = 1.0


@contextmanager
def progress(task: str = "") -> Iterator[Callable[[str], None]]:
    """Give a function that shows on stderr how far a long task is.

    On a terminal it rewrites one line, which is gone at the end. In a pipe, where a task takes long, it
    writes a line now and then.

    Args:
        task: what is being done, the beginning of each line.
    """
    on_terminal = sys.stderr is not None and sys.stderr.isatty()
    begun = monotonic()
    due = begun + _FIRST_LINE

    def show(text: str) -> None:
        nonlocal due
        if text and monotonic() >= begun + _HELD_AT_MOST:
            print_held()
        line = f"{task}: {text}" if task and text else text
        if on_terminal:
            typer.secho(f"\r{printable(line):<40}" + ("" if line else "\r"), err=True, nl=False)
        elif line and monotonic() >= due:
            due = monotonic() + _NEXT_LINE
            say(line, err=True)

    try:
        yield show
    finally:
        show("")


@contextmanager
def working(task: str) -> Iterator[None]:
    """Print what is being done once it takes long, for work that does not say how far it is.

    Args:
        task: what is being done.
    """
    timer = Timer(_SILENT_AT_MOST, lambda: say(f"{task} ...", err=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def console(**options: Any) -> Console:
    """Return a console for tables, whose text is not interpreted; in a pipe it is 120 wide."""
    from rich.console import Console
    from rich.text import Text

    class Plain(Console):
        """A console that shows text from files, lines of ours as lines."""

        def render_str(self, text: str, **options: Any) -> Text:
            """Return text as it may be shown."""
            return super().render_str(printable(text, lines=True), **options)

    print_held()
    options.setdefault("width", None if sys.stdout.isatty() or "COLUMNS" in os.environ else 120)
    return Plain(markup=False, emoji=False, highlight=False, **options)


def print_wrapped(screen: Console, line: str, style: str = "") -> None:
    """Print a line; what does not fit into the width goes on below it, indented."""
    indent = " " * (len(line) - len(line.lstrip()) + 2)
    text = textwrap.fill(
        line, screen.width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
    screen.print(text, style=style, soft_wrap=True)


def say_markdown(text: str) -> None:
    """Print Markdown: its tables as tables, all else line by line."""
    from rich.table import Table

    rows: list[list[str]] = []
    for line in [*text.splitlines(), ""]:
        if line.startswith("|"):
            # A row begins and ends with a bar; one that is escaped belongs to a cell.
            cells = re.split(r"(?<!\\)\|", line.strip())[1:]
            if cells and not cells[-1]:
                cells.pop()
            rows.append([cell.strip().replace(r"\|", "|") for cell in cells])
            continue
        if rows:
            table = Table()
            for place, head in enumerate(rows[0]):
                table.add_column(head, justify="right" if place else "left")
            for row in rows[2:]:
                table.add_row(*row)
            screen = console()
            widen(screen, table)
            screen.print(table)
            rows = []
        if line:
            say(line)


def widen(console: Console, table: Any) -> None:
    """Make a console as wide as a table is: however narrow the terminal, numbers stay whole."""
    console.width = max(console.width, natural_width(console, table))


def natural_width(console: Console, table: Any) -> int:
    """Return how wide a table is where there is room enough."""
    from rich.measure import Measurement

    return Measurement.get(console, console.options.update(max_width=10_000), table).maximum
