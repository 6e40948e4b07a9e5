"""What the commands share: exit codes, refusals, and values written as text."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar, cast

import typer

from armgpi.base.escape import in_si
from armgpi.cli.terminal import say
from armgpi.errors import ConfigError, ParameterError, Remedy

_Command = TypeVar("_Command", bound=Callable[..., Any])

#: INCOMPLETE: something that was supplied or asked for was not judged (:mod:`armgpi.base.verdict`).
OK, FAILED, BAD_INPUT, INCOMPLETE, INTERRUPTED = 0, 1, 2, 3, 130

#: Kind of a remedy -> the option that does it, and how its value is shown where none is proposed.
OPTIONS = {
    "config": ("--config", "FILE"),
    "effort": ("--effort", "JOINT=EFFORT"),
    "friction": ("--friction", "none"),
    "joints": ("--joints", "NUMBER"),
    "keep": ("--keep", "JOINT,JOINT,..."),
    "lock": ("--lock", "JOINT,JOINT,..."),
    "mimic": ("--mimic", "follow"),
    "omega": ("--controller gpi --omega", "BANDWIDTH"),  # the automatic one chooses its own
    "package_dir": ("--package-dir", "FOLDER"),
    "port": ("--port", "PORT"),
    "repair": ("--repair", "NAME"),
    "robot": ("--robot", "ROBOT"),
    "rotor_inertia": ("--rotor-inertia", "JOINT=INERTIA"),
    "start": ("--from", "POSITIONS"),
    "time_limit": ("--time-limit", "SECONDS"),
}

#: The options of the command that runs.
OFFERED: set[str] = set()
#: Names of the options that were typed -> the first name of each.
TYPED: dict[str, str] = {}
#: Options that are keys of an experiment file as well, of which a command may offer the file alone.
_KEYS = {
    **{f"--{key}": f"robot.{key}" for key in ("lock", "keep", "mimic", "repair", "effort")},
    **{"--rotor-inertia": "robot.rotor_inertia", "--drives": "robot.drives", "--gravity": "robot.gravity"},
    **{"--friction": "plant.friction", "--omega": "controllers.0.omega"},
}


def stoppable(command: _Command) -> _Command:
    """Make a command say so and exit with 130 on Ctrl-C, which Typer would take for an abort of its own."""

    @wraps(command)
    def run(*arguments: Any, **options: Any) -> Any:
        try:
            return command(*arguments, **options)
        except KeyboardInterrupt:
            say("interrupted", err=True, fg="yellow")
            raise typer.Exit(INTERRUPTED) from None

    return cast(_Command, run)


def as_option(remedy: Remedy) -> str:
    """Return the option that does what a remedy proposes, with its value ("--effort q2=10")."""
    name, placeholder = OPTIONS[remedy.kind]
    value = f"{remedy.value:g}" if isinstance(remedy.value, float) else remedy.value
    joints = ",".join(joint if value is None else f"{joint}={value}" for joint in remedy.joints)
    proposed = joints or value
    return f"{name} {shlex.quote(proposed) if proposed else placeholder}".rstrip()


def with_options(error: BaseException) -> str:
    """Return the text of an error with the options that help, its own or those of the error it came from."""
    cause: BaseException | None = error
    while cause is not None and not getattr(cause, "remedies", ()):
        cause = cause.__cause__
    text = in_options(_of_option(error))
    remedies = getattr(cause, "remedies", ())
    if "--config" not in OFFERED:
        remedies = [remedy for remedy in remedies if remedy.kind != "config"]
    options = [in_options(as_option(remedy)) for remedy in remedies]
    options = [option for option in options if re.split(r"(?:=|: )[\d.]+", option)[0] not in text]
    return f"{text} ({' or '.join(options)})" if options else text


def _of_option(error: BaseException) -> str:
    """Return the text of an error; it names the option where the value of one was wrong."""
    if isinstance(error, ParameterError) and (option := TYPED.get(f"--{error.name.replace('_', '-')}")):
        return str(refusal_of(option, error))
    return str(error)


#: Calls in Python that messages propose, and the options that do the same.
_CALLS: tuple[tuple[str, Any], ...] = (
    (r"lock=\[('?)([^'\]]*)\1\]", r"--lock \2"),
    (r"keep=\[\.\.\.\]", "--keep NAME"),
    (r"(mimic|repair)='([^']*)'", r"--\1 \2"),
    (r"robot\.with_gravity\(\(0, 0, 0\)\)", "--gravity robot"),
    (r"make both of armgpi\.assume_drives\(robot\)", "--drives elastic"),
    (
        r"robot\.with_limits\(effort=\{([^}]*)\}\)",
        lambda call: "--effort " + call[1].replace("'", "").replace(": ", "=").replace(", ", ","),
    ),
    (r"robot\.with_armature\(\.\.\.\)", "--rotor-inertia JOINT=NUMBER"),
)


def in_options(text: str) -> str:
    """Return a message with options in the place of calls in Python."""
    for call, option in _CALLS:
        text = re.sub(call, option, text)
    return re.sub(r"(--[a-z-]+)(?: ([\w=.,+-]*[\w=]))?", _as_key, text)


def _as_key(proposed: re.Match[str]) -> str:
    """Return an option that is proposed, or the key of the experiment file where the command has none."""
    option, value = proposed.groups()
    if not OFFERED or option in OFFERED or option not in _KEYS:
        return proposed[0]
    if value and "=" in value:
        value = f"{{{value.replace('=', ': ').replace(',', ', ')}}}"
    elif option in ("--lock", "--keep", "--repair"):
        value = f"[{(value or 'NAME').replace(',', ', ')}]"
    return f"{_KEYS[option]}: {value or '...'} in the experiment file"


def refusal(option: str, message: str) -> ConfigError:
    """Return the error for options that cannot be used."""
    return ConfigError("command line", option, message)


def refusal_of(option: str, error: ParameterError) -> ConfigError:
    """Return the error for an option in place of that of the parameter, of another name, which it is for."""
    return refusal(option, str(error).removeprefix(f"{error.name} "))


def is_experiment(robot: str) -> bool:
    """Tell whether what stands in the place of a robot is an experiment file."""
    return robot.lower().endswith((".yaml", ".yml"))


def split(items: list[str]) -> list[str]:
    """Return the parts of texts with commas in them."""
    return [part.strip() for item in items for part in item.split(",") if part.strip()]


def per_joint(text: str, option: str) -> Any:
    """Read 'j1=1,j2=2', '1,2,3' or '1'."""
    parts = split([text])
    try:
        if parts and all("=" in part for part in parts):
            return _by_joint(parts, option)
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if not numbers:
        expected = "numbers such as 'j1=0.8,j2=-0.4' or '0.8,-0.4'"
        hint = next(filter(None, (in_si(part.rpartition("=")[2]) for part in parts)), "")
        raise refusal(option, f"expected {expected}, got {text!r}{'; ' if hint else ''}{hint}")
    return numbers[0] if len(numbers) == 1 else numbers


def _by_joint(parts: list[str], option: str) -> dict[str, float]:
    """Read 'j1=1' and others, each joint once."""
    numbers: dict[str, float] = {}
    for part in parts:
        joint, value = (x.strip() for x in part.split("=", 1))
        if joint in numbers:
            raise refusal(option, f"joint {joint!r} is a duplicate key")
        numbers[joint] = float(value)
    return numbers


def locks(items: list[str]) -> dict[str, float | None]:
    """Read joint names, some with a value to lock at."""
    locks: dict[str, float | None] = {}
    for part in split(items):
        name, equals, value = (x.strip() for x in part.partition("="))
        try:
            locks[name] = float(value) if equals else None
        except ValueError:
            hint = f"; {said}" if (said := in_si(value)) else ""
            raise refusal("--lock", f"expected 'name' or 'name=value', got {part!r}{hint}") from None
    return locks


def known_backend(name: str) -> str:
    """Return the name of a backend, refusing one that there is not."""
    from armgpi.loop.backends import BACKENDS

    if name not in BACKENDS:
        raise refusal("--backend", f"{name!r} is none of {', '.join(BACKENDS)}")
    return name


def known_target(name: str) -> str:
    """Return the name of a target of an export, refusing one that there is not."""
    from armgpi.hardware.export.interfaces import TARGETS

    if name not in TARGETS:
        raise refusal("--target", f"must be one of {', '.join(TARGETS)}, got {name!r}")
    return name
