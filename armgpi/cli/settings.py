"""Options of the command line laid over an experiment file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from armgpi import config as configuration
from armgpi.base import renamed
from armgpi.base.renamed import current_name
from armgpi.cli.declared import Option, whole
from armgpi.cli.options import robot_given
from armgpi.cli.parsing import is_experiment, per_joint, refusal
from armgpi.config import Loaded, Origin, keys
from armgpi.errors import ConfigError
from armgpi.paper import scenarios
from armgpi.robot import robots
from armgpi.robot.repairs import SUPPOSE


class _Overlay:
    """Options put over the data of an experiment file.

    Attributes:
        options: what was typed, by the names of the commands' arguments.
        data: the experiment file as plain data, changed in place.
        sources: dotted key -> the option that set it.
    """

    def __init__(self, options: dict[str, Any], data: dict[str, Any]) -> None:
        self.options, self.data = options, data
        self.sources: dict[str, str] = {}

    def is_given(self, name: str) -> bool:
        """Tell whether an option was typed."""
        return self.options[name] not in (None, [])

    def put(self, option: str, value: Any, *path: str | int) -> None:
        """Put an option's value into the data and remember whose it is."""
        keys.put(self.data, path, value)
        self.sources[".".join(map(str, path))] = option

    def take(self, name: str, *path: str | int, read: Callable[[Any], Any] = lambda value: value) -> None:
        """Put an option that may have been typed; what it is called follows from its name."""
        if self.is_given(name):
            self.put(f"--{name.replace('_', '-')}", read(self.options[name]), *path)


def settings(options: dict[str, Any], compare: bool) -> Loaded:
    """Return the configuration of a file and the options that override it."""
    options = with_file(options)
    data, origin = _read(options)
    over = _Overlay(options, data)
    _arm(over)
    _world(over)
    over.take("dt", "sample_time")
    over.take("t_final", "t_final")
    over.take("seed", "seed")
    if options["supervised"] and data.get("supervisor") is None:
        over.put("--supervised", {}, "supervisor")
    for name in ("on_fault", "frozen", "jump"):  # of `armgpi export`
        if options.get(name) is not None:
            over.take(name, "supervisor", name)
    if options.get("torque_rate") is not None:
        rate = per_joint(options["torque_rate"], "--torque-rate")
        over.put("--torque-rate", rate, "supervisor", "torque_rate")
    origin = _choose_controllers(options, compare, data, origin, over.sources)
    for index in range(len(data["controllers"])):
        over.take("inertia_scale", "controllers", index, "inertia_scale")
    for option, value in options["declared"]:
        _set_declared(over, option, value)
    _reference(over)
    for text in options.get("settings") or ():
        _set(over, text)
    # The longest keys first: of "controllers.0.omega" and "controllers.0", the first says more.
    origin = origin._replace(options=dict(sorted(over.sources.items(), key=lambda item: -len(item[0]))))
    return Loaded(configuration.check(data, origin), origin)


def with_file(options: dict[str, Any]) -> dict[str, Any]:
    """Return options in which an experiment file in the place of the robot is that of --config."""
    robot = options["robot"]
    if robot is None or not is_experiment(robot):
        return options
    if options["config"] is not None:
        raise refusal("--config", f"{robot} is an experiment file already; give one of the two")
    return {**options, "robot": None, "config": Path(robot)}


def _read(options: dict[str, Any]) -> tuple[dict[str, Any], Origin]:
    """Return the data of the experiment file, and where it came from."""
    if options["config"] is None:
        return {}, Origin("command line")
    path = options["config"]
    if not path.exists() and str(path) in scenarios.names():  # of the paper
        path = scenarios.locate(str(path))
    config, origin = configuration.read(path)
    data = config.plain(given=True)
    if ("controllers",) not in origin.lines:
        del data["controllers"]  # which is the standard one depends on the options, too
    return data, origin


def _arm(over: _Overlay) -> None:
    """Put the options about the arm and its plant, sensors and actuators."""
    if over.is_given("robot"):
        over.data["robot"] = {}
        over.put("ROBOT", over.options["robot"], "robot", "name")
    if "robot" not in over.data:
        raise refusal("", "name a robot, or give an experiment file with --config")
    over.take("gravity", "robot", "gravity")
    for key, value in robot_given(over.options).items():
        over.put(f"--{key.replace('_', '-')}", value, "robot", key)
    over.take("plant", "plant", "engine")
    over.take("payload", "plant", "payload", "mass")
    over.take("friction", "plant", "friction")
    for option, value in over.options["declared"]:
        if not option.owners:
            over.put(option.flag, value, "plant", option.key)


def _world(over: _Overlay) -> None:
    """Put the world: of a file it is its own, unless --ideal is typed; of an arm by name that of the arm."""
    if over.options.get("ideal"):
        over.put("--ideal", True, "ideal")
    elif over.options["config"] is None:
        over.data["ideal"] = robots.is_textbook(over.data["robot"]["name"])


def _set_declared(over: _Overlay, option: Option, value: Any) -> None:
    """Put the option of a declared parameter of the controllers that have it."""
    if not option.owners:
        return  # of a sensor or actuator
    having = [i for i, section in enumerate(over.data["controllers"]) if section["type"] in option.owners]
    if not having:
        raise refusal(
            option.flag, f"is for {' and '.join(option.owners)}, which is not among the controllers"
        )
    for index in having:
        over.put(option.flag, value, "controllers", index, option.key)


def _reference(over: _Overlay) -> None:
    """Put the options about where to."""
    options, data = over.options, over.data
    if over.is_given("trajectory"):
        if over.is_given("to") or over.is_given("start") or over.is_given("path"):
            raise refusal("--trajectory", "is mutually exclusive with --to, --from and --path")
        data["reference"] = {}
        over.put("--trajectory", str(options["trajectory"]), "reference", "file")
    if over.is_given("path"):
        if over.is_given("to") or over.is_given("start"):
            raise refusal("--path", "is mutually exclusive with --to and --from")
        data["reference"] = {}
        over.put("--path", {"type": options["path"]}, "reference", "path")
    if over.is_given("direction"):
        if "path" not in (data.get("reference") or {}):
            raise refusal("--direction", "requires a path")
        over.take("direction", "reference", "direction", read=lambda text: per_joint(text, "--direction"))
    if over.is_given("to"):
        begin = per_joint(options["start"], "--from") if over.is_given("start") else {}
        data["reference"] = {"points": [begin, {}], "holds": [1.0, 0.0]}
        over.put("--from", begin, "reference", "points", 0)
        over.put("--to", per_joint(options["to"], "--to"), "reference", "points", 1)
    elif over.is_given("start"):
        raise refusal("--from", "requires --to")
    over.take("duration", "reference", "durations")


def _set(over: _Overlay, text: str) -> None:
    """Put the value of any key, KEY=VALUE; `controller` means every controller."""
    name, equals, value = (part.strip() for part in text.partition("="))
    part, _, rest = name.partition(".")
    if not (equals and name and value):
        raise refusal("--set", f"expected KEY=VALUE such as plant.delay=2, got {text!r}")
    count = len(over.data["controllers"])
    tops = [("controllers", i) for i in range(count)] if part == "controller" else [(part,)]
    for top in tops:
        try:
            over.put(f"--set {name}", _value(value), *top, *(keys.path_of(rest) if rest else ()))
        except (LookupError, TypeError):
            raise refusal("--set", f"the experiment has no {name!r}") from None


def _value(text: str) -> Any:
    """Return what was typed as an experiment file has it: numbers, a word, null, a list in brackets."""
    if text[0] in "[{":
        from armgpi.base.yaml_text import parse_text

        return parse_text(f"value: {text}", "command line: --set")[0]["value"]
    if text in (words := {"true": True, "false": False, "null": None}):
        return words[text]
    try:
        return whole(per_joint(text, "--set"))
    except ConfigError:
        return text


def _standard(data: dict[str, Any], compare: bool) -> list[dict[str, Any]]:
    """Return the controllers of who names none; of an identified arm those of it and of its file.

    Then the arm has its friction, too, if nothing else was said.
    """
    found = robots.find_identified(data["robot"]["name"]) if compare else None
    if found is not None and not any(name.startswith((SUPPOSE, *renamed.REPAIRS)) for name in found.repair):
        data["plant"] = {"friction": "urdf", **(data.get("plant") or {})}
        of_file = {"type": "gpi_auto", "label": "file", "nominal": str(found.before)}
        return [of_file, {"type": "gpi_auto", "label": "identified"}]
    kind = configuration.standard_law(data)
    # A rival that measures positions alone comes first; behind exact sensors all measure the same.
    kinds = [kind, "pid_positions", "pid"] if kind == "gpi_auto" else [kind, "pid"]
    return [{"type": each} for each in kinds]


def _choose_controllers(
    options: dict[str, Any],
    compare: bool,
    data: dict[str, Any],
    origin: Any,
    sources: dict[str, str],
) -> Any:
    """Leave in `data` the controllers asked for, and return an origin that still knows their lines."""
    listed = data.get("controllers", [])
    option = "--controllers" if compare else "--controller"
    wanted = options["controllers"]
    if wanted is None:
        data["controllers"] = listed or _standard(data, compare)
        if not compare:
            del data["controllers"][1:]
        return origin
    names = [name.strip() for name in wanted.split(",")]
    if not compare and len(names) > 1:
        raise refusal(option, f"armgpi run takes one; use armgpi compare for {wanted!r}")
    chosen: list[dict[str, Any]] = []
    lines = {path: line for path, line in origin.lines.items() if path[0] != "controllers"}
    for name in names:
        # By label, by type, and as a new one, in this order.
        numbers = [i for i, section in enumerate(listed) if section.get("label") == name]
        if not numbers:
            name = current_name(name, renamed.CONTROLLERS)
            types = [renamed.CONTROLLERS.get(section["type"], section["type"]) for section in listed]
            numbers = [i for i, kind in enumerate(types) if kind == name]
        for number in numbers if compare else numbers[:1]:
            for path, line in origin.lines.items():
                if path[:2] == ("controllers", number):
                    lines[("controllers", len(chosen), *path[2:])] = line
            chosen.append(listed[number])
        if not numbers:
            sources[f"controllers.{len(chosen)}"] = option
            chosen.append({"type": name})
    data["controllers"] = chosen
    return origin._replace(lines=lines)
