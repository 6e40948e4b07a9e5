"""A generation of candidates on scenarios, as one run of a prepared loop."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import Array
from armgpi.config import controller, keys
from armgpi.errors import ArmgpiError, ArmgpiWarning
from armgpi.health.reality import in_rows, prepare_draws
from armgpi.loop import metrics
from armgpi.loop.prepared import PreparedLoop
from armgpi.loop.rollout import Status
from armgpi.plants.reality import Scenario, batches, stack_draws


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

    def __init__(self, draws: Sequence[Scenario], names: Sequence[str], backend: str = "compiled") -> None:
        """Keep the draws.

        Args:
            draws: of one arm.
            names: of metrics.
            backend: as for :func:`armgpi.prepare`.
        """
        self.draws, self.names, self.backend = list(draws), list(names), backend
        places = {draw.index: place for place, draw in enumerate(self.draws)}
        groups = batches(self.draws)
        self._groups = [([places[draw.index] for draw in group], group) for group in groups]
        # Sections are prepared once for each number of candidates: what varies is given anew.
        self._loops: dict[Any, PreparedLoop] = {}

    def __call__(self, section: Mapping[str, Any], candidates: Sequence[Mapping[str, Any]]) -> Evaluated:
        """Run controllers on all scenarios.

        Args:
            section: of a controller, plain data.
            candidates: values of some of its keys, the same keys in all; those of groups have a dot.

        Raises:
            ArmgpiError: when not one of them can be made.
        """
        sound = self._sound(section, candidates)
        shape = (len(candidates), len(self.draws))
        values = {name: np.full(shape, np.inf) for name in self.names}
        failed = np.ones(shape, dtype=bool)
        for place, (columns, _) in enumerate(self._groups):
            cells = np.ix_(sound, columns)
            found, failed[cells] = self._run(place, section, [candidates[row] for row in sound])
            for name in self.names:
                values[name][cells] = found[name]
        return Evaluated(values, failed)

    def _sound(self, section: Mapping[str, Any], candidates: Sequence[Mapping[str, Any]]) -> list[int]:
        """Return which candidates describe a controller.

        Raises:
            ArmgpiError: of the first one, when none does.
        """
        found, first = [], None
        for index, candidate in enumerate(candidates):
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", ArmgpiWarning)
                    for _, group in self._groups:
                        controller(with_keys(section, candidate), stack_draws(group[:1]).context)
                found.append(index)
            except ArmgpiError as error:
                first = first or error
        if first is not None and not found:
            raise first
        return found

    def _run(
        self, place: int, section: Mapping[str, Any], candidates: Sequence[Mapping[str, Any]]
    ) -> tuple[dict[str, Array], Array]:
        """Return metrics of candidates on a group of scenarios, and where they diverged."""
        group, count = self._groups[place][1], len(candidates)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ArmgpiWarning)
            key = (place, count, repr(section), tuple(candidates[0]))
            if key not in self._loops:
                # What some keys are given as decides what there is to vary: a box, weights.
                law = with_keys(section, candidates[0])
                self._loops[key] = prepare_draws(group * count, law, record="metrics", backend=self.backend)
            loop = self._loops[key]
            rollout = in_rows(loop.run(by_rollout(candidates, len(group), loop)))
        known, shape = metrics.declared(), (count, len(group))
        found = {
            name: known[name].of_arm(rollout[name].transpose("rollout", "joint").values).reshape(shape)
            for name in self.names
        }
        return found, (rollout["status"].values == Status.DIVERGED).reshape(shape)


def with_keys(section: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a section with other values of some keys; those of groups have a dot."""
    made = copy.deepcopy(dict(section))
    for key, value in values.items():
        keys.put(made, keys.path_of(key), value)
    return made


def by_rollout(candidates: Sequence[Mapping[str, Any]], scenarios: int, loop: PreparedLoop) -> dict[str, Any]:
    """Return values of a prepared loop: those of each candidate on all scenarios, one after the other."""
    n = loop.loop.plant.robot.n

    def rows(values: Sequence[Any], rank: int) -> Any:
        if isinstance(values[0], Mapping):
            return tuple(rows([value[end] for value in values], rank) for end in ("lower", "upper"))
        array = np.array(values, dtype=np.float64)
        if array.ndim < rank and rank == 3:  # weights that all joints share
            array = np.broadcast_to(array[:, None], (len(values), n, array.shape[-1]))
        return np.repeat(array, scenarios, axis=0)

    found = {}
    for key in candidates[0]:
        name = f"controller.{key}"
        rank = 3 if loop.parameters[name].declared.kind == "table" else 1
        found[name] = rows([candidate[key] for candidate in candidates], rank)
    return found
