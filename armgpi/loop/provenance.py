"""What a rollout was made from, as in the rollout's attribute ``provenance``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

from armgpi.base.escape import json_data
from armgpi.base.version import VERSION
from armgpi.errors import RolloutError

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Provenance:
    """What a rollout was made from; of several rollouts that were joined, of each by its label.

    Attributes:
        data: plain data: "plant", "controller", "reference" (what each says of itself), "measurement",
            "knows", "backend", "divergence" [rad or m], "t_final" [s] and "versions"; of joined rollouts a
            label -> that.
    """

    data: Mapping[str, Any]

    @classmethod
    def from_rollout(cls, rollout: xr.Dataset) -> Provenance:
        """Read a rollout's; errors as :meth:`from_attributes`."""
        return cls.from_attributes(rollout.attrs)

    @classmethod
    def from_attributes(cls, attributes: Mapping[Any, Any]) -> Provenance:
        """Read that of a rollout from its attributes.

        Raises:
            RolloutError: when there is none, or it is no JSON.
        """
        unknown = "the rollout does not record how it was made: its provenance is"
        try:
            data = json.loads(attributes["provenance"])
        except (KeyError, TypeError, ValueError):
            raise RolloutError(f"{unknown} no JSON") from None
        if not isinstance(data, dict) or not data:
            raise RolloutError(f"{unknown} empty")
        return cls(data)

    @classmethod
    def join(cls, parts: Mapping[str, Provenance]) -> Provenance:
        """Return that of several rollouts, by label."""
        return cls({label: part.data for label, part in parts.items()})

    def to_json(self, indent: int | None = None) -> str:
        """Return it as JSON; numbers that JSON lacks become text: "inf", "-inf", "nan"."""
        # What is indented is for people: names stay as they are written.
        options: dict[str, Any] = {"indent": indent, "ensure_ascii": indent is None}
        options |= {"sort_keys": True, "allow_nan": False}
        try:  # large batches have long lists, and hardly ever a number that JSON lacks
            return json.dumps(self.data, **options)
        except ValueError:
            return json.dumps(json_data(self.data, as_text=True), **options)

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of rollouts that were joined; none for a rollout, or a batch, of its own."""
        # A single one has numbers and words beside its parts.
        joined = all(isinstance(part, Mapping) for part in self.data.values())
        return tuple(self.data) if joined else ()

    def of(self, label: str) -> Provenance:
        """Return what the rollout of a label was made from; those of a batch were made from the same."""
        return Provenance(self.data[label]) if label in self.labels else self

    @property
    def first(self) -> Provenance:
        """What the first rollout was made from."""
        return self.of(self.labels[0]) if self.labels else self

    def at(self, *path: str | int, default: Any = None) -> Any:
        """Return what is at a path of keys; the default when there is nothing, or data is damaged."""
        found: Any = self.data
        for key in path:
            try:
                found = found[key]
            except (KeyError, IndexError, TypeError):
                return default
        return found

    @property
    def measurement(self) -> str:
        """Name of what the controller measured: "Measurement" or "FullState".

        Raises:
            RolloutError: when it does not say.
        """
        name = self.at("measurement")
        if not isinstance(name, str):
            raise RolloutError("the rollout does not record how it was made (its provenance is damaged)")
        return name

    @property
    def knows(self) -> str:
        """What the controller knew of its nominal model: see :class:`armgpi.Controller`; empty if unknown."""
        return str(self.at("knows", default=""))

    @property
    def robot(self) -> Mapping[str, Any]:
        """Where the plant's robot came from (its `Robot.provenance`), the first of several; {} if unknown."""
        made = self.at("plant", "robot")
        made = self.at("plant", "robot", "robots", 0, default=made)
        return made if isinstance(made, Mapping) else {}

    @property
    def reference(self) -> Mapping[str, Any]:
        """What the reference says of itself; {} if unknown."""
        return self._part("reference")

    @property
    def controller(self) -> Mapping[str, Any]:
        """What the controller says of itself; {} if unknown."""
        return self._part("controller")

    @property
    def versions(self) -> Mapping[str, str]:
        """Packages that its numbers depend on, with their versions; {} if unknown."""
        return self._part("versions")

    @property
    def backend(self) -> str:
        """Name of what ran it: "numpy" or "compiled"; "unknown" if it does not say."""
        return str(self.at("backend", default="unknown"))

    def _part(self, name: str) -> Mapping[str, Any]:
        part = self.at(name)
        return part if isinstance(part, Mapping) else {}


@lru_cache(maxsize=4)
def versions(*more: str) -> dict[str, str]:
    """Return the versions of what a rollout's numbers depend on, and of more packages."""
    found = {"armgpi": VERSION}
    for package in ("pin", "numpy", *more):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return found
