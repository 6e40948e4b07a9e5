"""One reference per rollout."""

from __future__ import annotations

import numpy as np
import pytest

from armgpi import GPI, FixedGains, Hold, ReferenceBatch, RigidBodyPlant, Robot, Waypoints, simulate
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
