"""Options of the command line laid over an experiment file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from armgpi import config as configuration
from armgpi.cli.parsing import locks, per_joint, refusal, split
from armgpi.config import Loaded, Origin
from armgpi.paper import scenarios


def settings(options: dict[str, Any], compare: bool) -> Loaded:
    """Return the configuration of a file and the options that override it."""
    data: dict[str, Any] = {}
    origin = Origin("command line")
    if options["config"] is not None:
        config, origin = configuration.read(_file(options["config"]))
        data = config.model_dump(exclude_unset=True)
    sources: dict[str, str] = {}  # dotted key -> the option that set it

    def override(option: str, value: Any, *path: str | int) -> None:
        """Put an option's value into the data and remember whose it is."""
        section: Any = data
        for step in path[:-1]:
            section = section[step] if isinstance(step, int) else section.setdefault(step, {})
        section[path[-1]] = value
        sources[".".join(map(str, path))] = option

    def given(name: str) -> bool:
        return options[name] not in (None, [])

    if given("robot"):
        data["robot"] = {}
        override("ROBOT", options["robot"], "robot", "name")
    if "robot" not in data:
        raise refusal("", "name a robot, or give an experiment file with --config")
    if given("lock"):
        override("--lock", locks(options["lock"]), "robot", "lock")
    if given("keep"):
        override("--keep", split(options["keep"]), "robot", "keep")
    if given("mimic"):
        override("--mimic", options["mimic"], "robot", "mimic")
    if given("effort"):
        override("--effort", per_joint(",".join(options["effort"]), "--effort"), "robot", "effort")
    if given("payload"):
        override("--payload", options["payload"], "plant", "payload", "mass")
    if given("friction"):
        override("--friction", "urdf" if options["friction"] else "none", "plant", "friction")
    for name in ("encoder_bits", "delay"):
        if given(name):
            override(f"--{name.replace('_', '-')}", options[name], "plant", name)
    for name, key in (("dt", "sample_time"), ("t_final", "t_final"), ("seed", "seed")):
        if given(name):
            override(f"--{name.replace('_', '-')}", options[name], key)
    origin = _choose_controllers(options, compare, data, origin, sources)
    for index, section in enumerate(data["controllers"]):
        if given("omega") and section["type"] == "gpi":
            override("--omega", per_joint(options["omega"], "--omega"), "controllers", index, "omega")
        if given("inertia_scale"):
            override("--inertia-scale", options["inertia_scale"], "controllers", index, "inertia_scale")
        if given("payload_range") and section["type"] != "pid":
            span = _span(options["payload_range"])
            override("--payload-range", span, "controllers", index, "payload_range")
    for option, name in (("--omega", "omega"), ("--payload-range", "payload_range")):
        if given(name) and option not in sources.values():
            raise refusal(option, "is for gpi, which is not among the controllers")
    if given("path"):
        if given("to") or given("start"):
            raise refusal("--path", "cannot stand beside --to or --from")
        data["reference"] = {}
        override("--path", {"type": options["path"]}, "reference", "path")
    if given("direction"):
        if "path" not in (data.get("reference") or {}):
            raise refusal("--direction", "goes with a path")
        override("--direction", per_joint(options["direction"], "--direction"), "reference", "direction")
    if given("to"):
        begin = per_joint(options["start"], "--from") if given("start") else {}
        data["reference"] = {"points": [begin, {}], "holds": [1.0, 0.0]}
        override("--from", begin, "reference", "points", 0)
        override("--to", per_joint(options["to"], "--to"), "reference", "points", 1)
    elif given("start"):
        raise refusal("--from", "goes with --to")
    if given("duration"):
        override("--duration", options["duration"], "reference", "durations")
    # The longest keys first: of "controllers.0.omega" and "controllers.0", the first says more.
    origin = origin._replace(options=dict(sorted(sources.items(), key=lambda item: -len(item[0]))))
    return Loaded(configuration.check(data, origin), origin)


def _span(text: str) -> dict[str, float]:
    """Read '0,0.5'."""
    numbers = per_joint(text, "--payload-range")
    if not isinstance(numbers, list) or len(numbers) != 2:
        raise refusal("--payload-range", f"expected two masses such as '0,0.5', got {text!r}")
    return {"lightest": numbers[0], "heaviest": numbers[1]}


def _file(path: Path) -> Path:
    """Return an experiment file: a file, or else a scenario of the paper by its name."""
    return scenarios.locate(str(path)) if not path.exists() and str(path) in scenarios.names() else path


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
        standard = [{"type": "gpi"}, {"type": "pid"}]
        data["controllers"] = (listed or standard) if compare else (listed or standard)[:1]
        return origin
    names = [name.strip() for name in wanted.split(",")]
    if not compare and len(names) > 1:
        raise refusal(option, f"armgpi run takes one; use armgpi compare for {wanted!r}")
    chosen: list[dict[str, Any]] = []
    lines = {path: line for path, line in origin.lines.items() if path[0] != "controllers"}
    for name in names:
        # By label, by type, and as a new one, in this order.
        numbers = [i for i, section in enumerate(listed) if section.get("label") == name]
        numbers = numbers or [i for i, section in enumerate(listed) if section["type"] == name]
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
