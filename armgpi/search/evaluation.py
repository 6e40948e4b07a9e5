"""A generation of candidates on scenarios, as one batch of rollouts."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import Array
from armgpi.config import controller, controller_of_parts
from armgpi.errors import ArmgpiError, ArmgpiWarning
from armgpi.loop import metrics
from armgpi.loop.rollout import Status
from armgpi.loop.simulation import simulate
from armgpi.plants.reality import Draw, Together, batches, together

#: Most numbers that one recorded quantity of a batch may have: 48 MB.
_MOST = 6_000_000


class Evaluated(NamedTuple):
    """What came out of candidates on scenarios.

    Attributes:
        values: metric -> one number for the arm, (candidates, scenarios); infinite where it diverged.
        failed: where it diverged, likewise.
    """

    values: dict[str, Array]
    failed: Any


class Evaluator:
    """Runs candidates on draws of a reality: the same ones for all of them (common random numbers).

    Attributes:
        draws: the scenarios.
        names: of the metrics that it works out.
    """

    def __init__(self, draws: Sequence[Draw], names: Sequence[str], backend: str = "compiled") -> None:
        """Keep the draws.

        Args:
            draws: of one arm.
            names: of metrics.
            backend: as for :func:`armgpi.simulate`.
        """
        self.draws, self.names, self.backend = list(draws), list(names), backend
        groups = batches(self.draws)
        places = {draw.index: place for place, draw in enumerate(self.draws)}
        self._groups = [([places[draw.index] for draw in group], group) for group in groups]
        self._once = [together(group) for group in groups]
        self._tiled: dict[tuple[int, int], Together] = {}

    def __call__(self, sections: Sequence[Mapping[str, Any]]) -> Evaluated:
        """Run controllers on all scenarios.

        Args:
            sections: one per candidate, plain data that differ in numbers alone.

        Raises:
            ArmgpiError: when not one of them can be made.
        """
        sound = self._sound(sections)
        shape = (len(sections), len(self.draws))
        values = {name: np.full(shape, np.inf) for name in self.names}
        failed = np.ones(shape, dtype=bool)
        for place, (columns, group) in enumerate(self._groups):
            steps = round(group[0].t_final / group[0].dt)
            most = max(1, _MOST // (steps * len(group) * group[0].arm.n))
            for first in range(0, len(sound), most):
                rows = sound[first : first + most]
                cells = np.ix_(rows, columns)
                found, lost = self._run(place, [sections[row] for row in rows])
                failed[cells] = lost
                for name in self.names:
                    values[name][cells] = found[name]
        return Evaluated(values, failed)

    def _sound(self, sections: Sequence[Mapping[str, Any]]) -> list[int]:
        """Return which sections describe a controller.

        Raises:
            ArmgpiError: of the first one, when none does.
        """
        found, first = [], None
        for index, section in enumerate(sections):
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", ArmgpiWarning)
                    for once in self._once:
                        controller(section, once.context)
                found.append(index)
            except ArmgpiError as error:
                first = first or error
        if first is not None and not found:
            raise first
        return found

    def _run(self, place: int, sections: list[Mapping[str, Any]]) -> tuple[dict[str, Array], Array]:
        """Return metrics of controllers on a group of scenarios, and where they diverged."""
        group, count = self._groups[place][1], len(sections)
        if (place, count) not in self._tiled:
            self._tiled[place, count] = together(group * count)
        all_of_it = self._tiled[place, count]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ArmgpiWarning)
            law = controller_of_parts(sections, self._once[place].context, all_of_it.context)
            rollout = simulate(
                all_of_it.plant,
                law,
                all_of_it.reference,
                all_of_it.t_final,
                progress=False,
                backend=self.backend,
            )
        if "rollout" not in rollout.dims:
            rollout = rollout.expand_dims("rollout")
        if (rollout["status"] == Status.INTERRUPTED).any():
            raise KeyboardInterrupt
        shape = (count, len(group))
        known = metrics.declared()
        found = {
            name: known[name].of_arm(known[name](rollout).transpose("rollout", "joint").values).reshape(shape)
            for name in self.names
        }
        return found, (rollout["status"].values == Status.DIVERGED).reshape(shape)
