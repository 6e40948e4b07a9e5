"""A file of drives: what the motors and gears of a robot are, which its URDF leaves out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from armgpi.config.schema import NotNegative, Positive, Section
from armgpi.errors import ConfigError

_MAX_BYTES = 1_000_000


class Drive(Section):
    """The drive of one joint.

    Attributes:
        gear_ratio: turns of the motor for one of the joint (rad/m for a prismatic joint).
        motor_inertia: of the rotor itself [kg m^2].
        viscous: viscous friction at the joint [N m s/rad or N s/m].
        coulomb: Coulomb friction at the joint [N m or N].
    """

    gear_ratio: Positive = 1.0
    motor_inertia: NotNegative | None = None
    viscous: NotNegative | None = None
    coulomb: NotNegative | None = None


def given(path: Path | None, rotor_inertia: Any = None) -> dict[str, Any]:
    """Return what a file of drives says, as :func:`read`, under a rotor inertia that was given besides."""
    found = {} if path is None else read(path)
    if isinstance(rotor_inertia, dict):
        rotor_inertia = {**found.get("rotor_inertia", {}), **rotor_inertia}
    return found if rotor_inertia is None else {**found, "rotor_inertia": rotor_inertia}


def read(path: Path) -> dict[str, Any]:
    """Return what a file of drives (YAML or JSON: joint -> its drive) says, as keys of the section `robot`.

    Raises:
        ConfigError: when it cannot be read, or a value is not as it should be.
    """
    import yaml

    try:
        with path.open("rb") as stream:
            data = yaml.safe_load(stream.read(_MAX_BYTES))
        drives = TypeAdapter(dict[str, Drive]).validate_python(data)
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigError(str(path), ".".join(map(str, first["loc"])), first["msg"]) from None
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise ConfigError(str(path), "", f"cannot be read: {error}") from None
    inertia = {
        joint: drive.gear_ratio**2 * drive.motor_inertia
        for joint, drive in drives.items()
        if drive.motor_inertia is not None
    }
    friction = {
        key: {joint: value for joint, drive in drives.items() if (value := getattr(drive, key)) is not None}
        for key in ("viscous", "coulomb")
    }
    found: dict[str, Any] = {"rotor_inertia": inertia, "friction": {k: v for k, v in friction.items() if v}}
    return {key: value for key, value in found.items() if value}
