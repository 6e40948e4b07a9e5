"""Options for the parameters that controllers, sensors and actuators declare.

``--help`` waits for no heavy import, so the declarations (:mod:`armgpi.parameter`) are read from the source
of their modules, which are not run. A test holds what is read against the classes themselves.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import typer

from armgpi import registry
from armgpi.cli.layout import EVERYTHING, Command
from armgpi.cli.parsing import per_joint, refusal

#: Where a context keeps the options that were given.
_META = "armgpi.declared"
#: Where it keeps whether a declared option may be among its words.
_WANTED = "armgpi.wanted"
#: What declares a parameter, and what it says unasked: nothing of one that a base class declares.
_DECLARING: dict[str, dict[str, Any]] = {"parameter": {"kind": "number"}, "again": {}}
#: Kinds of parameters that have an option.
_KINDS = ("number", "integer", "choice", "group")


class Option(NamedTuple):
    """An option for a declared parameter.

    Attributes:
        flag: its name, with dashes.
        key: of the experiment file, in the sections of its owners, or in `plant`.
        owners: controllers that have it; empty for a sensor or actuator.
        facts: what was declared, by the names of :class:`armgpi.parameter.Parameter`.
    """

    flag: str
    key: str
    owners: tuple[str, ...]
    facts: dict[str, Any]

    @property
    def help(self) -> str:
        """What --help says."""
        text, unit = self.facts["text"], self.facts.get("unit", "")
        said = f"{text[0].upper()}{text[1:]}{f' [{unit}]' if unit else ''}"
        if "choices" in self.facts:
            said += f": {' or '.join(self.facts['choices'])}"
        if self.owners:
            said += f"; for {', '.join(self.owners)}"
        words = next(
            (self.facts[key] for key in ("chosen", "none", "unlimited") if self.facts.get(key)), None
        )
        default = self.facts.get("default") if words is None else words
        return f"{said}." + (f" Default: {default}." if default is not None and self.owners else "")

    @property
    def metavar(self) -> str:
        """What --help shows in place of its value."""
        if self.facts["kind"] == "group":
            return ",".join(name.upper() for name in self.facts["members"])
        if self.facts["kind"] == "choice":
            return "NAME"
        return "NUMBERS" if self.facts.get("per_joint") else "NUMBER"

    def value(self, text: str) -> Any:
        """Return what was typed as an experiment file has it.

        Raises:
            ConfigError: when it has another form.
        """
        kind = self.facts["kind"]
        if kind == "choice":
            return text
        numbers = per_joint(text, self.flag)
        if kind == "group":
            members = self.facts["members"]
            if not isinstance(numbers, list) or len(numbers) != len(members):
                raise refusal(self.flag, f"expected {self.metavar} such as '0,0.5', got {text!r}")
            return dict(zip(members, numbers, strict=True))
        return whole(numbers) if kind == "integer" else numbers


class DeclaredCommand(Command):
    """A command with an option for every declared parameter; they are looked for when they are needed."""

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        """Read the command line; declared options are looked for where a word is one, or is to become one."""
        ctx.meta[EVERYTHING] = "--help-all" in args
        args = ["--help" if word == "--help-all" else word for word in args]
        own = {flag for each in self.params for flag in (*each.opts, *each.secondary_opts)}
        typed = {word.partition("=")[0] for word in args if word.startswith("--")}
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


def given(context: typer.Context) -> list[tuple[Option, Any]]:
    """Return the options that a command was given, with their values."""
    typed = context.meta.get(_META)
    if not typed:
        return []
    return [(each, each.value(typed[each.flag])) for each in options() if each.flag in typed]


@cache
def options() -> tuple[Option, ...]:
    """Return the options for all declared parameters that have one."""
    classes = _classes()
    found: dict[str, Option] = {}
    for name, made in classes.items():
        key = made.config_name
        own = [facts for facts in _fields(classes, name).values() if facts.get("in_file", True)]
        if key and _is_a(classes, name, "Wrapper") and len(own) == 1:
            found[key] = Option(_flag(key), key, (), own[0])
    for owner, parameters in sorted(_controllers(classes)):
        for name, facts in parameters.items():
            if facts["kind"] not in _KINDS or not facts.get("in_file", True):
                continue
            key = facts.get("key", name)
            if facts["kind"] == "group":
                below = _fields(classes, facts["group"])
                facts["members"] = [name for name, part in below.items() if part["kind"] == "number"]
                if not facts["members"]:  # tables: for files alone
                    continue
            owners = (*(found[key].owners if key in found else ()), owner)
            found[key] = Option(_flag(key), key, owners, facts)
    found |= {f"plant.{each.key}": each for each in _of_arms(classes, found)}
    return tuple(found.values())


def _of_arms(classes: dict[str, _Class], others: dict[str, Option]) -> Iterator[Option]:
    """Yield the options of the parameters of plants; one that a controller has as well begins with plant."""
    for name, made in classes.items():
        if made.config_name and _is_a(classes, name, "Arm"):
            for part, facts in _fields(classes, name).items():
                if facts["kind"] in _KINDS and facts.get("in_file", True):
                    key = facts.get("key", part)
                    yield Option(_flag(f"plant-{key}" if key in others else key), key, (), facts)


@cache
def names() -> dict[str, str]:
    """Return what help shows for {controllers}, {plants} and {paths}."""
    classes = _classes()
    paths = (each.config_name for name, each in classes.items() if _is_a(classes, name, "Path"))
    plants = (each.config_name for name, each in classes.items() if _is_a(classes, name, "Arm"))
    controllers = {name for name, _ in _controllers(classes)}
    return {
        "controllers": ", ".join(sorted(controllers)),
        "plants": ", ".join(sorted(name for name in plants if name)),
        "paths": ", ".join(sorted(name for name in paths if name)),
    }


class _Class(NamedTuple):
    bases: list[str]
    config_name: str | None
    fields: dict[str, dict[str, Any]]


@cache
def _classes() -> dict[str, _Class]:
    """Return the classes with declared parameters that the modules of the registry define, by their names."""
    found = {}
    for module in registry.modules():
        try:
            spec = find_spec(module)
        except Exception:  # the package of a plugin: the registry names it, when it is loaded
            spec = None
        text = Path(spec.origin).read_text(encoding="utf-8") if spec and spec.origin else ""
        if "config_name" not in text and "with_parameters" not in text:
            continue
        for node in ast.parse(text).body:
            if isinstance(node, ast.ClassDef):
                bases = [ast.unparse(base).rpartition(".")[2] for base in node.bases]
                fields = dict(_declared(node))
                name = fields.pop("config_name", {}).get("default")
                found[node.name] = _Class(bases, name, fields)
    return found


def _declared(node: ast.ClassDef) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the parameters that a class declares, and its name in files."""
    for each in node.body:
        if not isinstance(each, ast.AnnAssign | ast.Assign) or each.value is None:
            continue
        target = each.target if isinstance(each, ast.AnnAssign) else each.targets[0]
        name = target.id if isinstance(target, ast.Name) else ""
        if name == "config_name":
            yield name, {"default": _literal(each.value)}
        elif isinstance(each.value, ast.Call) and (said := getattr(each.value.func, "id", "")) in _DECLARING:
            facts = {word.arg: _literal(word.value) for word in each.value.keywords if word.arg}
            if each.value.args:
                facts["text"] = _literal(each.value.args[0])
            yield name, {**_DECLARING[said], **facts}


def _literal(node: ast.expr) -> Any:
    """Return the value of an expression, or the name that it is; None for any other."""
    if isinstance(node, ast.Name):
        return node.id
    try:
        return ast.literal_eval(node)
    except ValueError:
        return None


def _fields(classes: dict[str, _Class], name: str) -> dict[str, dict[str, Any]]:
    """Return the parameters of a class with those of the classes that it comes from."""
    if name not in classes:
        return {}
    found: dict[str, dict[str, Any]] = {}
    for fields in (*(_fields(classes, base) for base in reversed(classes[name].bases)), classes[name].fields):
        for key, facts in fields.items():
            found[key] = facts if "text" in facts and "kind" in facts else {**found[key], **facts}
    return found


def _is_a(classes: dict[str, _Class], name: str, base: str) -> bool:
    """Tell whether a class comes from another one."""
    return name in classes and any(each == base or _is_a(classes, each, base) for each in classes[name].bases)


def _controllers(classes: dict[str, _Class]) -> Iterator[tuple[str, dict[str, dict[str, Any]]]]:
    """Yield controllers by their names in files, with their parameters."""
    for name, each in classes.items():
        if not _is_a(classes, name, "Controller"):
            continue
        own = _fields(classes, name)
        if each.config_name:
            yield each.config_name, own
        for part in each.fields.values():
            if part["kind"] == "variant":
                variants = (other for other in classes if _is_a(classes, other, part["group"]))
                for variant in variants:
                    if classes[variant].config_name:
                        yield str(classes[variant].config_name), {**_fields(classes, variant), **own}


def _flag(key: str) -> str:
    return f"--{key.replace('_', '-')}"


def _click_options(wanted: Iterable[Option]) -> list[Any]:
    """Return options as the library of the command line has them: by way of a command that is not used."""

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
