"""What experiment files and the command line can name: classes with a ``config_name``.

They are found by importing the modules of the packages below, and those that installed distributions list as
entry points of the group ``armgpi.plugins``. So a new controller, sensor, load or path is one new module.
Plugins may declare metrics and checks of URDFs as well.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import Field
from functools import cache
from importlib import import_module, metadata
from typing import TYPE_CHECKING, Any, NamedTuple

from armgpi.errors import ConfigError

if TYPE_CHECKING:
    from armgpi.robot.robot import Robot

#: Packages all of whose modules are looked through, and single modules.
PACKAGES = ("armgpi.control", "armgpi.gpi", "armgpi.plants", "armgpi.references", "armgpi.tuning")
MODULES = ("armgpi.paper.parts",)
GROUP = "armgpi.plugins"


class Context(NamedTuple):
    """What an experiment is besides the part that is made: for the defaults that depend on it.

    Attributes:
        robot: the arm as its URDF has it.
        dt: sample time [s].
        seed: of all random numbers.
        delay: by which measurements are late [s].
        bits: resolution of the encoders, a number or (n,); None for exact positions.
        nominal: nominal model of a controller; `robot` but for a scaled inertia.
        omega_c: default bandwidth of a controller [rad/s].
        given: parameters of the controller that the experiment sets.
        rated: whether a supervisor limits the rate of the torque.
        error_context: makes errors inside of it name the key of a parameter.
    """

    robot: Robot
    dt: float
    seed: int = 0
    delay: float = 0.0
    bits: Any = None
    nominal: Any = None
    omega_c: float = 0.0
    given: Mapping[str, Any] = {}
    rated: bool = False
    error_context: Callable[[str], AbstractContextManager[None]] = lambda name: nullcontext()


def modules() -> list[str]:
    """Return the names of all modules in which such classes may be."""
    found = [
        f"{package}.{each.name}"
        for package in PACKAGES
        for each in pkgutil.iter_modules(import_module(package).__path__)
    ]
    return [*found, *MODULES, *plugins()]


@cache
def plugins() -> tuple[str, ...]:
    """Return the names of the modules that installed distributions list."""
    return tuple(sorted({each.value.partition(":")[0] for each in metadata.entry_points(group=GROUP)}))


@cache
def load_plugins() -> None:
    """Import the modules that installed distributions list.

    Raises:
        ConfigError: when one cannot be imported.
    """
    for name in plugins():
        try:
            import_module(name)
        except Exception as error:  # whatever a stranger's module does
            said = f"cannot be imported: {type(error).__name__}: {error}; mend it, or uninstall it"
            raise ConfigError(f"plugin {name!r}", "", said) from error


@cache
def load() -> None:
    """Import all modules in which such classes may be.

    Raises:
        ConfigError: when a plugin cannot be imported.
    """
    load_plugins()
    for name in modules():
        import_module(name)


def classes_of(base: type) -> dict[str, Any]:
    """Return the classes that come from `base` and have a name, by their names.

    Raises:
        ConfigError: when two of them have the same name, or one declares parameters and has no constructor.
    """
    found: dict[str, type] = {}
    for each in subclasses(base):
        name = vars(each).get("config_name")
        if name is None:
            continue
        if any(isinstance(value, Field) for value in vars(each).values()):
            said = "declares parameters, but has no @with_parameters before it"
            raise ConfigError(f"{each.__module__}.{each.__qualname__}", "", said)
        if name in found and found[name] is not each:
            other = f"{found[name].__module__}.{found[name].__qualname__}"
            message = f"config_name {name!r} is that of {other} as well; choose another one"
            raise ConfigError(f"{each.__module__}.{each.__qualname__}", "", message)
        found[name] = each
    return dict(sorted(found.items()))


def subclasses(base: type) -> Iterator[Any]:
    """Yield all classes that come from `base`."""
    load()
    direct: list[Any] = base.__subclasses__()
    for each in direct:
        yield each
        yield from subclasses(each)
