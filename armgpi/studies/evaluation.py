"""A generation of candidates on scenarios, as one run of a prepared loop."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.config import controller, keys
from armgpi.errors import ArmgpiError, ArmgpiWarning
from armgpi.health.reality import alike, in_rows, prepare_draws
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
        self.draws = list(draws)
        self.names = list(names)
        self.backend = backend
        self._places = {draw.index: place for place, draw in enumerate(self.draws)}
        self._groups = batches(self.draws)
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
        # Under the automatic controller those that have the same structure alone run together.
        groups = alike(self._groups, with_keys(section, candidates[sound[0]])) if sound else ()
        sound_candidates = [candidates[row] for row in sound]
        for group in groups:
            columns = [self._places[draw.index] for draw in group]
            cells = np.ix_(sound, columns)
            values_of_group, failed[cells] = self._run(group, section, sound_candidates)
            for name in self.names:
                values[name][cells] = values_of_group[name]
        return Evaluated(values, failed)

    def _sound(self, section: Mapping[str, Any], candidates: Sequence[Mapping[str, Any]]) -> list[int]:
        """Return which candidates describe a controller.

        Raises:
            ArmgpiError: of the first one, when none does.
        """
        sound: list[int] = []
        first_error: ArmgpiError | None = None
        for index, candidate in enumerate(candidates):
            try:
                self._make(with_keys(section, candidate))
            except ArmgpiError as error:
                first_error = first_error or error
            else:
                sound.append(index)
        if first_error is not None and not sound:
            raise first_error
        return sound

    def _make(self, section: Mapping[str, Any]) -> None:
        """Make a controller for the first scenario of each group, to see whether it can be made.

        Raises:
            ArmgpiError: when it cannot.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ArmgpiWarning)
            for group in self._groups:
                controller(section, stack_draws(group[:1]).context)

    def _run(
        self,
        group: Sequence[Scenario],
        section: Mapping[str, Any],
        candidates: Sequence[Mapping[str, Any]],
    ) -> tuple[dict[str, Array], Array]:
        """Return metrics of candidates on a group of scenarios, and where they diverged."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ArmgpiWarning)
            loop = self._loop(group, section, candidates)
            values_by_rollout = by_rollout(candidates, len(group), loop)
            rollout = in_rows(loop.run(values_by_rollout))
        shape = (len(candidates), len(group))
        declared = metrics.declared()
        values = {}
        for name in self.names:
            of_joints = rollout[name].transpose("rollout", "joint").values
            values[name] = declared[name].of_arm(of_joints).reshape(shape)
        diverged = rollout["status"].values == Status.DIVERGED
        return values, diverged.reshape(shape)

    def _loop(
        self,
        group: Sequence[Scenario],
        section: Mapping[str, Any],
        candidates: Sequence[Mapping[str, Any]],
    ) -> PreparedLoop:
        """Return the prepared loop of a group of scenarios for so many candidates; each is prepared once."""
        count = len(candidates)
        draws = tuple(draw.index for draw in group)
        key = (draws, count, repr(section), tuple(candidates[0]))
        if key not in self._loops:
            # What some keys are given as decides what there is to vary: a box, weights.
            law = with_keys(section, candidates[0])
            draws_of_rows = [*group] * count
            self._loops[key] = prepare_draws(draws_of_rows, law, record="metrics", backend=self.backend)
        return self._loops[key]


def with_keys(section: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a section with other values of some keys; those of groups have a dot."""
    changed = copy.deepcopy(dict(section))
    for key, value in values.items():
        keys.put(changed, keys.path_of(key), value)
    return changed


def by_rollout(candidates: Sequence[Mapping[str, Any]], scenarios: int, loop: PreparedLoop) -> dict[str, Any]:
    """Return values of a prepared loop: those of each candidate on all scenarios, one after the other."""
    joints = loop.loop.plant.robot.n
    values = {}
    for key in candidates[0]:
        name = f"controller.{key}"
        is_table = loop.parameters[name].declared.kind == "table"
        of_candidates = [candidate[key] for candidate in candidates]
        values[name] = _rows(of_candidates, scenarios, joints, is_table)
    return values


def _rows(values: Sequence[Any], scenarios: int, joints: int, is_table: bool) -> Any:
    """Return a key's values of all candidates, a row for each rollout; a pair of them for a box."""
    if isinstance(values[0], Mapping):
        lower = [value["lower"] for value in values]
        upper = [value["upper"] for value in values]
        return tuple(_rows(end, scenarios, joints, is_table) for end in (lower, upper))
    array = np.array(values, dtype=np.float64)
    if is_table and array.ndim < 3:  # weights that all joints share
        array = np.broadcast_to(array[:, None], (len(values), joints, array.shape[-1]))
    return np.repeat(array, scenarios, axis=0)
