"""Options for the parameters that controllers, sensors and actuators declare.

``--help`` waits for no heavy import: what it says of them stands in ``declared.json``, which ``make format``
writes from the classes. Where the registry has other modules, a plugin or a new one, the classes are asked.
"""

from __future__ import annotations

import inspect
import json
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from armgpi import registry
from armgpi.cli.layout import EVERYTHING, Command
from armgpi.cli.parsing import per_joint, refusal
from armgpi.errors import ConfigError

if TYPE_CHECKING:
    from armgpi.base.parameter import Parameter

#: Where a context keeps the options that were given.
_META = "armgpi.declared"
#: Where it keeps whether a declared option may be among its words.
_WANTED = "armgpi.wanted"
#: Kinds of parameters that have an option.
_KINDS = ("number", "integer", "choice", "text", "group")


class Option(NamedTuple):
    """An option for a declared parameter.

    Attributes:
        flag: its name, with dashes.
        key: of the experiment file, in the sections of its owners, or in `plant`.
        owners: controllers that have it; empty for a sensor or actuator.
        kind: of the parameter.
        metavar: what --help shows in place of its value.
        help: what --help says.
    """

    flag: str
    key: str
    owners: tuple[str, ...]
    kind: str
    metavar: str
    help: str

    def value(self, text: str) -> Any:
        """Return what was typed as an experiment file has it.

        Raises:
            ConfigError: when it has another form.
        """
        if self.kind in ("choice", "text"):
            return text
        if self.kind == "group":
            members = self.metavar.lower().split(",")
            try:
                numbers = [float(part) for part in text.split(",")]
            except ValueError:
                numbers = []
            if len(numbers) != len(members):
                raise refusal(self.flag, f"expected {self.metavar} such as '0,0.5', got {text!r}")
            return dict(zip(members, numbers, strict=True))
        numbers = per_joint(text, self.flag)
        return whole(numbers) if self.kind == "integer" else numbers


class DeclaredCommand(Command):
    """A command with an option for every declared parameter; they are looked for when they are needed."""

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        """Read the command line; declared options are looked for where a word is one, or is to become one."""
        ctx.meta[EVERYTHING] = "--help-all" in args
        args = ["--help" if word == "--help-all" else word for word in args]
        own = {flag for each in self.params for flag in (*each.opts, *each.secondary_opts)}
        typed = {word.partition("=")[0] for word in args if word.startswith("--")}
        typed |= {f"-{word}" for word in args if re.match(r"-[a-z]{2}", word)}  # a dash was forgotten
        ctx.meta[_WANTED] = ctx.resilient_parsing or not typed <= own  # the former for completion
        return super().parse_args(ctx, args)

    def get_params(self, ctx: Any) -> list[Any]:
        """Return its own options and those, --help last."""
        params: list[Any] = super().get_params(ctx)
        if not ctx.meta.get(_WANTED, True):
            return params
        *own, help_option = params
        for each in own:
            each.help = each.help and each.help.format(**names())
        taken = {name for each in own for name in each.opts}
        return [*own, *_click_options(each for each in options() if each.flag not in taken), help_option]


def values_of(context: typer.Context) -> list[tuple[Option, Any]]:
    """Return the options that a command was given, with their values."""
    typed = context.meta.get(_META)
    if not typed:
        return []
    return [(each, each.value(typed[each.flag])) for each in options() if each.flag in typed]


class Declared(NamedTuple):
    """What --help says of what is declared.

    Attributes:
        modules: those of the registry, which it was read from.
        names: of controllers, plants and paths, in words.
        options: for parameters.
    """

    modules: list[str]
    names: dict[str, str]
    options: list[Option]


def options() -> list[Option]:
    """Return the options for all declared parameters that have one."""
    return _read_declared().options


def names() -> dict[str, str]:
    """Return what help shows for {controllers}, {plants} and {paths}."""
    return _read_declared().names


@cache
def _read_declared() -> Declared:
    """Return what was written down, where it is of the modules that there are; else what the classes say."""
    kept = Declared(**json.loads(files("armgpi.cli").joinpath("declared.json").read_text(encoding="utf-8")))
    kept = kept._replace(options=[Option(*row) for row in kept.options])
    if kept.modules == registry.modules():
        return kept
    try:
        return read_classes()
    except ConfigError:  # a plugin that cannot be imported: whoever runs something is told
        return kept


def read_classes() -> Declared:
    """Return what the classes of the registry declare.

    Raises:
        ConfigError: when a plugin cannot be imported.
    """
    from armgpi.config.schema import KINDS
    from armgpi.plants.arm import Arm
    from armgpi.references.paths import Path

    kinds = {"controllers": KINDS, "plants": registry.classes_of(Arm), "paths": registry.classes_of(Path)}
    found = {key: ", ".join(sorted(every)) for key, every in kinds.items()}
    return Declared(registry.modules(), found, _read_options())


def _read_options() -> list[Option]:
    """Return the options of sensors and actuators, of controllers, and of plants."""
    from armgpi.base.parameter import parameters
    from armgpi.config.schema import KINDS, SENSORS
    from armgpi.plants.arm import Arm
    from armgpi.plants.plant import Wrapper

    found: dict[str, Option] = {}
    owners: defaultdict[str, tuple[str, ...]] = defaultdict(tuple)
    for name, wrapper in registry.classes_of(Wrapper).items():
        own = [each for each in parameters(wrapper).values() if each.in_file]
        if len(own) == 1:
            found[name] = _option(_flag(name), name, (), own[0])
    for owner, kind in KINDS.items():
        for key, each in _having(kind.parameters):
            # One that a sensor has as well begins with controller, one that a controller has with plant.
            name = f"controller.{key}" if key in SENSORS else key
            owners[name] += (owner,)
            found[name] = _option(_flag(name), key, owners[name], each)
    for arm in registry.classes_of(Arm).values():
        for key, each in _having(parameters(arm)):
            found[f"plant.{key}"] = _option(_flag(f"plant.{key}" if key in found else key), key, (), each)
    return list(found.values())


def _having(declared: Mapping[str, Parameter]) -> Iterator[tuple[str, Parameter]]:
    """Yield the parameters that have an option, by their keys in a file; tables are for files alone."""
    for each in declared.values():
        if each.in_file and each.kind in _KINDS and (each.kind != "group" or _members(each)):
            yield each.file_key, each


def _members(group: Parameter) -> list[str]:
    """Return the numbers of a group."""
    from armgpi.base.parameter import parameters

    below = parameters(group.group).items() if group.group else ()
    return [name for name, part in below if part.kind == "number"]


def _option(flag: str, key: str, owners: tuple[str, ...], each: Parameter) -> Option:
    """Return the option of a parameter."""
    from armgpi.base.parameter import REQUIRED

    numbers = "NUMBERS" if each.per_joint else "NUMBER"
    metavars = {"group": ",".join(_members(each)).upper(), "choice": "NAME", "text": "NAME"}
    said = f"{each.text[0].upper()}{each.text[1:]}{f' [{each.unit}]' if each.unit else ''}"
    if each.choices:
        said += f": {' or '.join(each.choices)}"
    text = f"{said}; for {_named(owners)}." if owners else f"{said}."
    default = each.chosen or each.none or each.unlimited or each.default
    if owners and default not in (None, REQUIRED):
        text += f" Default: {default}."
    return Option(flag, key, owners, each.kind, metavars.get(each.kind, numbers), text)


def _named(owners: tuple[str, ...]) -> str:
    """Return the controllers that have an option: all, all but a few, or their names."""
    from armgpi.config.schema import KINDS

    others = [name for name in KINDS if name not in owners]
    if not others:
        return "all controllers"
    return f"all controllers but {' and '.join(others)}" if len(others) < 3 else ", ".join(owners)


def _flag(key: str) -> str:
    return f"--{key.replace('_', '-').replace('.', '-')}"


def _click_options(wanted: Iterable[Option]) -> list[Any]:
    """Return options as the library of the command line has them: by way of a command that is not used.

    Typer takes defaults from the signature and types from the annotations, so that command has both. Values
    stay texts here: :meth:`Option.value` converts them.
    """

    def command(**_: Any) -> None: ...

    arguments = [
        inspect.Parameter(
            f"declared_{each.flag.strip('-').replace('-', '_')}",
            inspect.Parameter.KEYWORD_ONLY,
            default=typer.Option(
                None,
                each.flag,
                metavar=each.metavar,
                help=each.help,
                show_default=False,
                expose_value=False,
                callback=_keep,
                rich_help_panel="Controllers" if each.owners else "Plant",
            ),
            annotation=str | None,
        )
        for each in wanted
    ]
    vars(command)["__signature__"] = inspect.Signature(arguments)
    command.__annotations__ = {each.name: each.annotation for each in arguments}
    app = typer.Typer(add_completion=False)
    app.command(add_help_option=False)(command)
    made: Any = typer.main.get_command(app)
    return list(made.params)


def _keep(context: typer.Context, parameter: typer.CallbackParam, value: str | None) -> None:
    """Keep what was typed."""
    if value is not None:
        context.meta.setdefault(_META, {})[parameter.opts[0]] = value


def whole(value: Any) -> Any:
    """Return numbers as ints where they are whole."""
    if isinstance(value, dict):
        return {key: whole(number) for key, number in value.items()}
    if isinstance(value, list):
        return [whole(number) for number in value]
    return int(value) if float(value).is_integer() else value
