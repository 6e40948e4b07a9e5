"""Options of the command line laid over an experiment file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from armgpi import config as configuration
from armgpi.base import renamed
from armgpi.base.renamed import current_name
from armgpi.cli.declared import Option, whole
from armgpi.cli.options import Asked, Experiment, SupervisorOptions, robot_given
from armgpi.cli.parsing import is_experiment, per_joint, refusal
from armgpi.config import Loaded, Origin, keys
from armgpi.errors import ConfigError
from armgpi.paper import scenarios
from armgpi.robot import robots
from armgpi.robot.repairs import SUPPOSE


class _Overlay:
    """Options put over the data of an experiment file.

    Attributes:
        data: the experiment file as plain data, changed in place.
        sources: dotted key -> the option that set it.
    """

    def __init__(self, data: dict[str, Any]) -> None:
        self.data = data
        self.sources: dict[str, str] = {}

    def put(self, option: str, value: Any, *path: str | int) -> None:
        """Put an option's value into the data and remember whose it is."""
        keys.put(self.data, path, value)
        self.sources[".".join(map(str, path))] = option

    def put_typed(self, option: str, value: Any, *path: str | int) -> None:
        """Put the value of an option that may have been left out."""
        if value is not None:
            self.put(option, value, *path)


def settings(asked: Asked, compare: bool) -> Loaded:
    """Return the configuration of a file and the options that override it.

    Raises:
        ConfigError: when an option or a key of the file is wrong; it names the one that is.
    """
    asked = with_file(asked)
    options = asked.options
    data, origin = _read(options)
    over = _Overlay(data)
    _arm(over, asked)
    _world(over, options)
    over.put_typed("--dt", options.dt, "sample_time")
    over.put_typed("--t-final", options.t_final, "t_final")
    over.put_typed("--seed", options.seed, "seed")
    if options.supervised and data.get("supervisor") is None:
        over.put("--supervised", {}, "supervisor")
    _supervisor(over, asked.supervisor)
    origin = _choose_controllers(asked.controllers, compare, data, origin, over.sources)
    for index in range(len(data["controllers"])):
        over.put_typed("--inertia-scale", options.inertia_scale, "controllers", index, "inertia_scale")
    for option, value in asked.declared:
        _set_declared(over, option, value)
    _reference(over, options)
    for text in options.settings or ():
        _set(over, text)
    origin = origin._replace(options=over.sources)
    return Loaded(configuration.check(data, origin), origin)


def with_file(asked: Asked) -> Asked:
    """Return what was typed, in which an experiment file in the place of the robot is that of --config."""
    if asked.robot is None or not is_experiment(asked.robot):
        return asked
    if asked.options.config is not None:
        raise refusal("--config", f"{asked.robot} is an experiment file already; give one of the two")
    options = replace(asked.options, config=Path(asked.robot))
    return replace(asked, robot=None, options=options)


def _read(options: Experiment) -> tuple[dict[str, Any], Origin]:
    """Return the data of the experiment file, and where it came from."""
    path = options.config
    if path is None:
        return {}, Origin("command line")
    if not path.exists() and str(path) in scenarios.names():  # of the paper
        path = scenarios.locate(str(path))
    config, origin = configuration.read(path)
    data = config.plain(given=True)
    if ("controllers",) not in origin.lines:
        del data["controllers"]  # which is the standard one depends on the options, too
    return data, origin


def _arm(over: _Overlay, asked: Asked) -> None:
    """Put the options about the arm and its plant, sensors and actuators."""
    options = asked.options
    if asked.robot is not None:
        over.data["robot"] = {}
        over.put("ROBOT", asked.robot, "robot", "name")
    if "robot" not in over.data:
        raise refusal("", "name a robot, or give an experiment file with --config")
    over.put_typed("--gravity", options.gravity, "robot", "gravity")
    for key, value in robot_given(options).items():
        over.put(f"--{key.replace('_', '-')}", value, "robot", key)
    over.put_typed("--plant", options.plant, "plant", "engine")
    over.put_typed("--payload", options.payload, "plant", "payload", "mass")
    over.put_typed("--friction", options.friction, "plant", "friction")
    for option, value in asked.declared:
        if not option.owners:
            over.put(option.flag, value, "plant", option.key)


def _world(over: _Overlay, options: Experiment) -> None:
    """Put the world: of a file it is its own, unless --ideal is typed; of an arm by name that of the arm."""
    if options.ideal:
        over.put("--ideal", True, "ideal")
    elif options.config is None:
        over.data["ideal"] = robots.is_textbook(over.data["robot"]["name"])


def _supervisor(over: _Overlay, options: SupervisorOptions) -> None:
    """Put the options of the supervisor."""
    over.put_typed("--on-fault", options.on_fault, "supervisor", "on_fault")
    over.put_typed("--frozen", options.frozen, "supervisor", "frozen")
    over.put_typed("--jump", options.jump, "supervisor", "jump")
    if options.torque_rate is not None:
        rate = per_joint(options.torque_rate, "--torque-rate")
        over.put("--torque-rate", rate, "supervisor", "torque_rate")


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


def _reference(over: _Overlay, options: Experiment) -> None:
    """Put the options about where to."""
    data = over.data
    if options.trajectory is not None:
        if (options.to, options.start, options.path) != (None, None, None):
            raise refusal("--trajectory", "is mutually exclusive with --to, --from and --path")
        data["reference"] = {}
        over.put("--trajectory", str(options.trajectory), "reference", "file")
    if options.path is not None:
        if (options.to, options.start) != (None, None):
            raise refusal("--path", "is mutually exclusive with --to and --from")
        data["reference"] = {}
        over.put("--path", {"type": options.path}, "reference", "path")
    if options.direction is not None:
        if "path" not in (data.get("reference") or {}):
            raise refusal("--direction", "requires a path")
        over.put("--direction", per_joint(options.direction, "--direction"), "reference", "direction")
    if options.to is not None:
        begin = {} if options.start is None else per_joint(options.start, "--from")
        data["reference"] = {"points": [begin, {}], "holds": [1.0, 0.0]}
        over.put("--from", begin, "reference", "points", 0)
        over.put("--to", per_joint(options.to, "--to"), "reference", "points", 1)
    elif options.start is not None:
        raise refusal("--from", "requires --to")
    over.put_typed("--duration", options.duration, "reference", "durations")


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
    wanted: str | None,
    compare: bool,
    data: dict[str, Any],
    origin: Any,
    sources: dict[str, str],
) -> Any:
    """Leave in `data` the controllers asked for, and return an origin that still knows their lines."""
    listed = data.get("controllers", [])
    option = "--controllers" if compare else "--controller"
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
