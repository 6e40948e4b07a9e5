"""One key of an experiment file, while objects are made from it: errors name it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from armgpi.config.reading import Origin
from armgpi.config.section import Path_
from armgpi.errors import ArmgpiError, ConfigError


class Place(NamedTuple):
    """One key of a configuration, while objects are made from it."""

    origin: Origin
    path: Path_ = ()

    def at(self, *steps: str | int) -> Place:
        """Return a place below this one."""
        return Place(self.origin, (*self.path, *steps))

    def error(self, message: str) -> ConfigError:
        """Return an error about this key."""
        return self.origin.error(self.path, message)

    @contextmanager
    def error_context(self) -> Iterator[None]:
        """Turn an error of ours that happens inside into one that names this key."""
        try:
            yield
        except ConfigError:
            raise
        except ArmgpiError as error:
            raise self.error(str(error)) from error
