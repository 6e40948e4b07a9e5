"""What the commands share: exit codes, refusals, and values written as text."""

from __future__ import annotations

from typing import Any

from armgpi.errors import ConfigError

OK, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


def refusal(option: str, message: str) -> ConfigError:
    """Return the error for options that cannot be used."""
    return ConfigError("command line", option, message)


def split(items: list[str]) -> list[str]:
    """Return the parts of texts with commas in them."""
    return [part.strip() for item in items for part in item.split(",") if part.strip()]


def per_joint(text: str, option: str) -> Any:
    """Read 'j1=1,j2=2', '1,2,3' or '1'."""
    parts = split([text])
    try:
        if parts and all("=" in part for part in parts):
            pairs = [part.split("=", 1) for part in parts]
            joints = [name.strip() for name, _ in pairs]
            for joint in joints:
                if joints.count(joint) > 1:
                    raise refusal(option, f"joint {joint!r} stands twice")
            return {joint: float(value) for joint, (_, value) in zip(joints, pairs, strict=True)}
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if not numbers:
        expected = "numbers such as 'j1=0.8,j2=-0.4' or '0.8,-0.4'"
        raise refusal(option, f"expected {expected}, got {text!r}")
    return numbers[0] if len(numbers) == 1 else numbers


def locks(items: list[str]) -> dict[str, float | None]:
    """Read joint names, some with a value to lock at."""
    locks: dict[str, float | None] = {}
    for part in split(items):
        name, equals, value = (x.strip() for x in part.partition("="))
        try:
            locks[name] = float(value) if equals else None
        except ValueError:
            raise refusal("--lock", f"expected 'name' or 'name=value', got {part!r}") from None
    return locks
