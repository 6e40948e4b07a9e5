"""How the --help of a command is laid out: options in groups, as wide as the terminal."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import Any

from typer.core import TyperCommand

from armgpi.base.escape import in_si
from armgpi.cli.parsing import OFFERED, TYPED, refusal

#: Group -> its options, of whatever command. Declared parameters bring a group of their own.
_OPTIONS = {
    "Robot": (
        *("--lock", "--keep", "--mimic", "--repair", "--package-dir", "--effort", "--rotor-inertia"),
        *("--drives", "--robot", "--gravity"),
    ),
    "Motion": ("--to", "--from", "--path", "--trajectory", "--direction", "--duration", "--t-final"),
    "Controllers": ("--controller", "--controllers", "--inertia-scale", "--supervised"),
    "Plant": ("--plant", "--payload", "--friction", "--ideal", "--encoder-bits", "--delay", "--dt", "--seed"),
    "Wire": (
        *("--clock", "--policy", "--exported", "--loss", "--outage", "--stall", "--kill", "--watchdog"),
        "--reaction",
    ),
    "Output": (
        *("--out", "--json", "--table", "--plot", "--view", "--html", "--report"),
        "--interactive",
        *("--title", "--frame", "--port", "--open", "--backend"),
    ),
}
#: What --help shows of a command that has all of these options and more, which are in --help-all.
_FIRST = {
    *("--config", "--to", "--path", "--controller", "--controllers", "--payload", "--encoder-bits"),
    *("--delay", "--t-final", "--set", "--out", "--report", "--view", "--help"),
}
#: Where a context keeps whether --help-all was asked for; a command without that shows all at once.
EVERYTHING = "armgpi.everything"
_GROUP_OF = {flag: group for group, flags in _OPTIONS.items() for flag in flags}
_OTHERS = "Options"
#: Widest help: longer lines are hard to read.
WIDEST = 120
#: What Typer writes for the type of a value -> what --help shows.
_VALUES = {"<int>": "NUMBER", "<int range>": "NUMBER", "<float>": "NUMBER", "<str>": "NAME"}


class Command(TyperCommand):
    """A command whose help has its options in groups."""

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        """Read the command line."""
        OFFERED.clear()
        TYPED.clear()
        params = self.get_params(ctx)
        read_as_typed(params)
        refuse_single_dash(params, args)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run the command; messages propose its options."""
        for each in self.get_params(ctx):
            OFFERED.update(each.opts)
            source = ctx.get_parameter_source(each.name)
            if source is not None and source.name == "COMMANDLINE":
                TYPED.update(dict.fromkeys(each.opts, each.opts[0]))
        return super().invoke(ctx)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the words of the line of usage: an argument that is required has no brackets."""
        return [_usage(piece) for piece in super().collect_usage_pieces(ctx)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments, then a section for every group of options."""
        groups: dict[str, list[tuple[str, str]]] = {}
        short = not ctx.meta.get(EVERYTHING, True)
        params = self.get_params(ctx)
        for each in params:
            # What a beginner needs.
            first = each.param_type_name == "argument" or not _FIRST.isdisjoint(each.opts)
            row = each.get_help_record(ctx)
            if row is not None and (first or not short):
                groups.setdefault(_group(each), []).append((_shown(each, row[0]), row[1]))
        if short:
            more = f"Show all {len(params)} arguments and options and exit."
            groups.setdefault(_OTHERS, []).append(("--help-all", more))
        order = ["Arguments", *_OPTIONS]
        for name in [*filter(groups.__contains__, order), *(name for name in groups if name not in order)]:
            with formatter.section(name):
                formatter.write_dl(groups[name])


def refuse_single_dash(params: list[Any], args: list[str]) -> None:
    """Refuse an option whose name has one dash: `-omega 30` would be `-o mega` and a word too many."""
    names = {flag for each in params for flag in each.opts if flag.startswith("--")}
    for word in args:
        if word == "--":
            return
        if word.startswith("-") and f"-{word.partition('=')[0]}" in names:
            raise refusal(word.partition("=")[0], f"names of options have two dashes: -{word}")


def read_as_typed(params: list[Any]) -> None:
    """Let arguments and options take text, paths, and nothing where nothing is given, as they are.

    Typer would import Pydantic for that, which takes half as long as Pinocchio.
    """
    for each in params:
        vars(each)["process_value"] = partial(_read, each)


def _read(parameter: Any, ctx: Any, value: Any) -> Any:
    """Return the value of an argument or option."""
    several = parameter.multiple or parameter.nargs == -1
    kind = getattr(getattr(parameter, "type_descriptor", None), "annotation", None)  # none in older Typer
    if kind is None or (parameter.required if value is None else several or kind not in (str, Path)):
        return _read_by_typer(parameter, ctx, value)
    if value is None:
        value = () if several else None
    elif kind is Path:
        value = Path(value)
    return value if parameter.callback is None else parameter.callback(ctx, parameter, value)


def _read_by_typer(parameter: Any, ctx: Any, value: Any) -> Any:
    """Return a value as Typer reads it; a refusal says what was typed, and how it is written in SI units."""
    try:
        return type(parameter).process_value(parameter, ctx, value)
    except Exception as error:
        if hasattr(error, "format_message") and isinstance(value, str):
            said = vars(error)["message"].rstrip(".")
            hint = "" if "integer" in said else in_si(value)
            vars(error)["message"] = f"{said}, got {value!r}{'; ' if hint else ''}{hint}"
        raise


def _usage(piece: str) -> str:
    """Return a word of the line of usage as man pages have it: {FILE} is FILE, [[LOG]...]... is [LOG...]."""
    required = re.fullmatch(r"\{(.*)\}(?:\.\.\.)?", piece)
    if required is not None:
        return required[1]
    several = re.fullmatch(r"\[\[?([^\[\]]*?)(?:\.\.\.)?\]?(?:\.\.\.)?\]\.\.\.", piece)
    return piece if several is None else f"[{several[1]}...]"


def _shown(parameter: Any, names: str) -> str:
    """Return the left column of an argument or option, with a word in place of Typer's type of its value."""
    if parameter.param_type_name == "argument":
        return re.sub(r" <[^<>]*>$", "", names).replace("[ROBOT]...", "ROBOT...")
    for kind, word in _VALUES.items():
        names = names.replace(kind, word)
    return names


def _group(parameter: Any) -> str:
    """Return the group of an argument or option."""
    if parameter.param_type_name == "argument":
        return "Arguments"
    own = getattr(parameter, "rich_help_panel", None)
    return own or next((_GROUP_OF[flag] for flag in parameter.opts if flag in _GROUP_OF), _OTHERS)
