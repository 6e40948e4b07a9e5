"""Rollouts as datasets that answer the names of other libraries."""

from __future__ import annotations

from typing import Any

import xarray as xr

from armgpi.base.hints import ROLLOUT, missing


class MissingVariable(KeyError):
    """A variable that a rollout does not have; unlike a `KeyError` it is shown as its sentence, unquoted."""

    def __str__(self) -> str:
        """Return the sentence."""
        return str(self.args[0])


class Rollout(xr.Dataset):  # type: ignore[no-untyped-call]  # of its base
    """What a run recorded: an ``xarray.Dataset`` that says what to write for a variable that it has not."""

    __slots__ = ()

    def __getattr__(self, name: str) -> Any:
        """Return a variable, as xarray does.

        Raises:
            AttributeError: where there is none of this name; it names the nearest one.
        """
        try:
            return super().__getattr__(name)
        except AttributeError:
            if name.startswith("_"):
                raise
        # With an object of its own, Python would add a second hint to this one.
        raise AttributeError(missing("a rollout", name, ROLLOUT, self._names()), name=name, obj=None)

    def __getitem__(self, key: Any) -> Any:
        """Return a variable, or several, or a part, as xarray does.

        Raises:
            KeyError: where there is no variable of a name, alone or in a list; it names the nearest one.
        """
        try:
            return super().__getitem__(key)
        except KeyError:
            absent = self._first_missing(key)
            if absent is None:
                raise
        raise MissingVariable(missing("a rollout", absent, ROLLOUT, self._names(), "variable"))

    def _first_missing(self, key: Any) -> str | None:
        """Return the first name that is no variable, of a name or a list of them; None for other keys."""
        names = [key] if isinstance(key, str) else key
        if not isinstance(names, list):
            return None
        for name in names:
            if isinstance(name, str) and name not in self.variables:
                return name
        return None

    def _names(self) -> list[str]:
        """Return the names of variables and coordinates."""
        return sorted(map(str, self.variables))


def hinted(dataset: xr.Dataset) -> Rollout:
    """Return a dataset as a rollout; its values are shared, not copied."""
    rollout = Rollout(dataset.variables, attrs=dataset.attrs).set_coords(list(dataset.coords))
    rollout.encoding = dataset.encoding
    return rollout
