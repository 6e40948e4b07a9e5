"""One reference per rollout: what each gives alone, whatever stands beside it."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from armgpi import (
    GPI,
    Bezier,
    FixedGains,
    Hold,
    Recorded,
    Reference,
    ReferenceBatch,
    RigidBodyPlant,
    Robot,
    Target,
    Waypoints,
    simulate,
)
from armgpi.base.arrays import Array
from armgpi.errors import ArrayError, ParameterError

ARM = Robot.load("anthropomorphic3")
ONE = Waypoints([np.zeros(3), np.array([0.3, 0.2, -0.1])], durations=0.2)
TWO = Hold([0.1, 0.2, 0.3])


def test_every_rollout_follows_its_own() -> None:
    controller = GPI(ARM, 1e-3, FixedGains(25.0))
    both = simulate(RigidBodyPlant(ARM), controller, ReferenceBatch([ONE, TWO]), 0.3)
    for row, reference in enumerate((ONE, TWO)):
        alone = simulate(RigidBodyPlant(ARM), controller, reference, 0.3)
        np.testing.assert_array_equal(both["q_ref"].isel(rollout=row), alone["q_ref"])
        np.testing.assert_array_equal(both["q"].isel(rollout=row), alone["q"])


def test_times_come_first() -> None:
    batch = ReferenceBatch([ONE, TWO])
    assert batch.at(0.1).q.shape == (2, 3)
    assert batch.at(np.array([0.0, 0.1, 0.2])).a.shape == (3, 2, 3)
    assert [part["type"] for part in batch.describe()["references"]] == ["Waypoints", "Hold"]


def test_what_does_not_go_together_is_refused() -> None:
    with pytest.raises(ParameterError, match="references"):
        ReferenceBatch([])
    with pytest.raises(ArrayError, match="references"):
        ReferenceBatch([ONE, Hold([0.0, 1.0])])
    with pytest.raises(ArrayError, match="references"):
        ReferenceBatch([Hold(np.zeros((2, 3)))])


class Backwards(Bezier):
    """A user's own move: from the goal to the start."""

    def at(self, t: float | Array) -> Target:
        """Return the target of the move with its ends exchanged."""
        return Bezier(self.goal, self.start, self.duration, self.t_start).at(t)


class Counted(Hold):
    """A user's own reference, which counts how often it is asked."""

    calls = 0

    def at(self, t: float | Array) -> Target:
        """Return the configuration, with one q for each time."""
        type(self).calls += 1
        return super().at(t)


def _references() -> list[Reference]:
    """Return references of every kind in no order, some there twice, none like another."""
    draw = np.random.default_rng(5).standard_normal
    times = np.linspace(0.0, 0.4, 7)
    each: list[Reference] = []
    for i in range(5):
        each.append(Bezier(draw(3), draw(3), 0.1 + 0.03 * i, t_start=0.01 * i))
        each.append(Hold(draw(3)))
        each.append(Waypoints([draw(3), draw(3), draw(3)], [0.1, 0.2], [0.0, 0.05 * i, 0.0]))
        each.append(Waypoints([draw(3), draw(3)], velocity_limit=2.0 + i))
        each.append(Recorded(times, draw((7, 3)), t_start=0.05))
        each.append(Recorded(times * (1.0 + i), draw((7, 3))))
        each.append(Backwards(draw(3), draw(3), 0.2))
    return [*each, each[0], each[4], each[1]]


@pytest.mark.parametrize("t", [0.17, np.linspace(-0.1, 0.7, 23)])
def test_each_gives_what_it_gives_alone(t: Any) -> None:
    references = _references()
    batch = ReferenceBatch(references)
    for again in (batch, pickle.loads(pickle.dumps(batch))):
        target = again.at(t)
        for row, reference in enumerate(references):
            for ours, alone in zip(target, reference.at(t), strict=True):
                np.testing.assert_array_equal(ours[..., row, :], alone)


@pytest.mark.parametrize("kind", ["bezier", "hold", "waypoints"])
def test_one_kind_is_followed_as_one_with_arrays(kind: str) -> None:
    draw = np.random.default_rng(6).standard_normal
    alike = {
        "bezier": lambda: Bezier(0.1 * draw(3), 0.1 * draw(3), 0.2),
        "hold": lambda: Hold(0.1 * draw(3)),
        "waypoints": lambda: Waypoints([0.1 * draw(3), 0.1 * draw(3)], 0.2),
    }[kind]
    references = [alike() for _ in range(6)]
    one = ReferenceBatch(references).as_arrays()
    assert type(one) is type(references[0])
    assert one.symbolic
    controller = GPI(ARM, 1e-3, FixedGains(25.0))
    both = simulate(RigidBodyPlant(ARM), controller, ReferenceBatch(references), 0.05, backend="compiled")
    for row, reference in enumerate(references):
        alone = simulate(RigidBodyPlant(ARM), controller, reference, 0.05)
        np.testing.assert_allclose(both["q_ref"].isel(rollout=row), alone["q_ref"], rtol=0.0, atol=1e-15)


def test_generated_code_asks_the_others_for_many_samples_at_once() -> None:
    """Each call costs; 300 samples took 150 calls a reference where a table of targets is slow to fill."""
    references = [Counted(0.01 * np.array([i, 1.0, 2.0])) for i in range(40)]
    Counted.calls = 0
    simulate(
        RigidBodyPlant(ARM),
        GPI(ARM, 1e-3, FixedGains(25.0)),
        ReferenceBatch(references),
        0.3,
        backend="compiled",
    )
    assert Counted.calls < 40 * 45
