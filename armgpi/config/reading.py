"""From YAML to a checked configuration; an error names the file, the line and the key."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from armgpi.base import files
from armgpi.config.schema import FORMAT, REFERENCE_FILES, ExperimentConfig
from armgpi.config.section import Path_, Section, Wrong
from armgpi.errors import ConfigError
from armgpi.robot import identified, robots

#: Largest size of an experiment file [bytes].
_MAX_BYTES = 1_000_000

_Model = TypeVar("_Model", bound=Section)


class Origin(NamedTuple):
    """Where a configuration came from, for messages.

    Attributes:
        source: the file, or "command line".
        lines: path of a key -> its line in the file.
        options: dotted key -> the option of the command line that set it.
    """

    source: str = "experiment"
    lines: Mapping[Path_, int] = {}
    options: Mapping[str, str] = {}

    def error(self, path: Path_, message: str) -> ConfigError:
        """Return an error about the key at `path`, naming the line or option it came from."""
        key = ".".join(map(str, path))
        # Of "controllers.0.omega" and "controllers.0", the longest says most.
        set_by = [name for name in self.options if key == name or key.startswith(f"{name}.")]
        if set_by:
            return ConfigError("command line", self.options[max(set_by, key=len)], message)
        # A missing key has no line: name that of the section it is missing from.
        known = (self.lines.get(path[:length]) for length in range(len(path), 0, -1))
        return ConfigError(self.source, key, message, next((line for line in known if line), None))


class Loaded(NamedTuple):
    """A checked configuration and where it came from: what :func:`build` takes."""

    config: ExperimentConfig
    origin: Origin


def read(path: Path) -> Loaded:
    """Read and check an experiment file.

    Raises:
        ConfigError: when it cannot be read or is not as it should be; it names line and key.
    """
    config, origin = parse(_text(path), str(path))
    return Loaded(beside(config, path), origin)


def read_data(path: Path) -> tuple[dict[str, Any], Origin]:
    """Read a file as plain data, for who checks it: an experiment with more in it.

    Raises:
        ConfigError: when it cannot be read, or is no YAML mapping.
    """
    return _data(_text(path), str(path))


def beside(config: ExperimentConfig, path: Path) -> ExperimentConfig:
    """Return a configuration whose robot and trajectory are found beside the file that it was read from."""

    def beside_it(given: str) -> str:
        name = Path(given)
        folder = (path.parent / name / identified.NAME).is_file()
        file = (name.suffix or len(name.parts) > 1) and (path.parent / name).is_file()
        return str(path.parent / name) if folder or file else given

    robot = config.robot.replace(name=beside_it(config.robot.name))
    if robot.posterior is not None:
        robot = robot.replace(posterior=beside_it(robot.posterior))
    config = config.replace(robot=robot)
    if any(each.nominal for each in config.controllers):
        names = [each.nominal and beside_it(each.nominal) for each in config.controllers]
        config = with_nominals(config, names)
    for key in REFERENCE_FILES:
        file = getattr(config.reference, key)
        if file is not None and (path.parent / file).is_file():
            config = config.replace(reference=config.reference.replace(**{key: str(path.parent / file)}))
    return config


def with_nominals(config: ExperimentConfig, names: Iterable[str | None]) -> ExperimentConfig:
    """Return a configuration with other files for the nominal models of its controllers."""
    pairs = zip(config.controllers, names, strict=True)
    return config.replace(controllers=[each.replace(nominal=name) for each, name in pairs])


def _text(path: Path) -> str:
    """Return the text of a file; errors as :func:`read`."""
    try:
        return files.read_text(path, _MAX_BYTES)
    except FileNotFoundError:
        raise ConfigError(path, "", f"there is no such file; {_how_to_write_one(path)}") from None
    except files.NotRegular as error:
        inside = path / "experiment.yaml"
        file = str(inside) if inside.is_file() else "the YAML file itself"
        raise ConfigError(path, "", f"is {error.kind}; expected {file}") from None
    except files.TooLarge:
        raise ConfigError(path, "", f"is larger than {_MAX_BYTES} bytes") from None
    except UnicodeDecodeError:
        raise ConfigError(path, "", "is not UTF-8 text") from None
    except (OSError, ValueError) as error:
        raise ConfigError(path, "", f"cannot be read: {files.reason(error)}") from None


def _how_to_write_one(path: Path) -> str:
    """Return how an experiment file is written; for a robot, where its name stands in place of a file."""
    name = str(path)
    if name in robots.names():
        return f"expected an experiment file, and `armgpi new {name} --out {name}.yaml` writes one"
    return "`armgpi new ROBOT` writes an experiment file"


def parse(text: str, source: str) -> Loaded:
    """Check the text of an experiment file; errors as :func:`read`."""
    data, origin = _data(text, source)
    return Loaded(check(data, origin), origin)


def _data(text: str, source: str) -> tuple[dict[str, Any], Origin]:
    """Return the text of a file as plain data, and where its keys are; errors as :func:`read`."""
    from armgpi.base.yaml_text import (
        parse_text,  # here: YAML takes long to import, and most runs have no file
    )

    if text.lstrip("\ufeff \n").startswith("<"):
        raise ConfigError(
            source, "", "is XML and no experiment file; `armgpi new URDF` writes one for a robot"
        )
    data, lines = parse_text(text, source)
    return data, Origin(source, lines)


def check(data: Mapping[Any, Any], origin: Origin) -> ExperimentConfig:
    """Check plain data of an experiment.

    Raises:
        ConfigError: when something in it is not as it should be; it names the key.
    """
    # A section of which every key is commented out is null: as if it were not there. `tune` is a search's.
    data = {key: value for key, value in data.items() if value is not None and key != "tune"}
    if isinstance(data.get("robot"), str):
        data["robot"] = {"name": data["robot"]}
    data.setdefault("controllers", [{"type": standard_law(data)}])
    return check_section(ExperimentConfig, data, origin)


def check_section(model: type[_Model], data: Mapping[Any, Any], origin: Origin, *under: str) -> _Model:
    """Check plain data of any section.

    Args:
        model: of the section.
        data: the data.
        origin: where it came from.
        *under: keys of the file that it was below.

    Raises:
        ConfigError: when something in it is not as it should be; it names the key.
    """
    try:
        return model.read(data)
    except Wrong as error:
        raise origin.error((*under, *error.path), error.message) from None


def standard_law(data: Mapping[Any, Any]) -> str:
    """Return which controller an experiment has that names none, by its plain data.

    It is the law of the paper where positions are exact and at once, and what suits an arm without tuning
    where encoders count or measurements are late. Where the key `ideal` names the world, it alone chooses.
    """
    if data.get("ideal") is not None:
        return "gpi" if data["ideal"] is True else "gpi_auto"
    plant = data.get("plant")
    real = isinstance(plant, Mapping) and (plant.get("encoder_bits") is not None or plant.get("delay"))
    return "gpi_auto" if real or data.get("reality") is not None else "gpi"


def dump(config: ExperimentConfig, full: bool = True) -> str:
    """Return a configuration as YAML, every default written out, or what its file says alone."""
    import yaml

    data = {"format": FORMAT, **config.plain(given=not full)}
    text: str = yaml.safe_dump(data, sort_keys=False, allow_unicode=True)
    return text
