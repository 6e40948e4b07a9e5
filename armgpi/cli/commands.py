"""The list of all commands; the module of each is imported when it is asked for.

So ``armgpi --help`` waits for none of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import typer
from typer.core import TyperGroup

from armgpi.base.renamed import COMMANDS, current_name
from armgpi.cli.layout import WIDEST, Command, read_as_typed
from armgpi.cli.options import with_rows


class Entry(NamedTuple):
    """A command as the list of all shows it.

    Attributes:
        group: in --help.
        name: of the command, of one word or two.
        function: its name in the module.
        module: in which that is, below ``armgpi.cli``.
        declares: whether it has an option for every declared parameter.
    """

    group: str
    name: str
    function: str
    module: str
    declares: bool

    @property
    def summary(self) -> str:
        """The first line of its help, which is read without an import."""
        source = Path(__file__).with_name(f"{self.module}.py").read_text(encoding="utf-8")
        return source.partition(f"\ndef {self.function}(")[2].split('"""', 2)[1].partition("\n")[0]


#: Group of --help -> functions of commands; an underscore is between the words of a command. After a colon
#: the module of the function where that has another name, and * where there is an option for every declared
#: parameter.
_TABLE = {
    "Simulate": "run:experiment* compare:experiment* sweep play* tune benchmark_controllers benchmark_robots",
    "Robots": "robots new schema inspect view expand",
    "Results": "report:view",
    "Hand-derived dynamics": "validate derive",
    "Certificates": "certify bound",
    "Hardware": "excite:identify identify export* loop* bringup log",
    "The paper": "reproduce:paper scenarios:paper",
    "Installation": "doctor",
}


ENTRIES = {
    name.replace("_", " "): Entry(group, name.replace("_", " "), name, module or name, each.endswith("*"))
    for group, names in _TABLE.items()
    for each in names.split()
    for name, _, module in [each.rstrip("*").partition(":")]
}


class _Loaded(Mapping[str, Any]):
    """The commands by name; each is imported when it is asked for."""

    def __getitem__(self, name: str) -> Any:
        """Return a command; that of an old name with a warning."""
        return _build_command(ENTRIES[current_name(name, COMMANDS)])

    def __iter__(self) -> Iterator[str]:
        """Yield the names."""
        return iter(ENTRIES)

    def __len__(self) -> int:
        """Return how many there are."""
        return len(ENTRIES)


@cache
def _build_command(entry: Entry) -> Any:
    """Return a command as the library of the command line has it: the only one of an app of its own."""
    module = import_module(f"armgpi.cli.{entry.module}")
    function = with_rows(getattr(module, entry.function), getattr(module, "ROWS", {}))
    kind: type[Command] = Command
    if entry.declares:
        from armgpi.cli.declared import DeclaredCommand

        kind = DeclaredCommand
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    settings = {"max_content_width": WIDEST}
    app.command(entry.name, cls=kind, context_settings=settings, rich_help_panel=entry.group)(function)
    return typer.main.get_command(app)


class Commands(TyperGroup):
    """The commands in groups, each with its whole summary."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        """Make the group."""
        settings = options.pop("context_settings", None) or {}
        settings.setdefault("max_content_width", WIDEST)
        super().__init__(*arguments, context_settings=settings, **options)
        vars(self)["commands"] = _Loaded()

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        """Read the command line."""
        read_as_typed(self.get_params(ctx))
        return super().parse_args(ctx, args)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that the first word names, or the first two."""
        if " ".join(args[:2]) in ENTRIES:
            args = [" ".join(args[:2]), *args[2:]]
        elif longer := [name for name in ENTRIES if name.startswith(f"{args[0]} ")]:
            ctx.fail(
                f"armgpi {args[0]} needs another word: {' or '.join(f'armgpi {name}' for name in longer)}"
            )
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a section for every group of commands."""
        widest = max(map(len, ENTRIES))
        groups: dict[str, list[tuple[str, str]]] = {}
        for name, entry in ENTRIES.items():
            groups.setdefault(entry.group, []).append((name.ljust(widest), entry.summary))
        for group, rows in groups.items():
            with formatter.section(group):
                formatter.write_dl(rows)
