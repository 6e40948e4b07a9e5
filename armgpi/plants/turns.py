"""Encoders that know the angle within a turn only, and the counting of turns after them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array
from armgpi.control.controller import FullState
from armgpi.plants.plant import Plant, StatefulWrapper, Wrapped, Wrapper

_TURN = 2.0 * math.pi


class SingleTurn(Wrapper):
    """Positions of continuous joints as an encoder without a turn counter gives them, in [-pi, pi).

    A controller measures jumps of a turn then; put :class:`Unwrapped` around it. Other joints and velocities
    are as they are.
    """

    def measure(self, state: Any) -> FullState:
        """Return the measurement, continuous joints inside one turn; see :meth:`Plant.measure`."""
        q, v = self.plant.measure(state)
        wrapped = (q + math.pi) % _TURN - math.pi
        return FullState(np.where(_continuous(self.plant), wrapped, q), v)


class Unwrapped(StatefulWrapper):
    """Positions of continuous joints with their turns counted.

    Between two samples a joint is taken to have moved less than half a turn. The turns at time 0 are taken
    from the true positions. Other joints and velocities are as they are.
    """

    def start(self, plant: Any, q: Array) -> Array:
        """Return the measured positions, their turns known; see :meth:`StatefulWrapper.start`."""
        return self._near(self.plant.measure(plant).q, q)

    def follow(self, plant: Any, own: Array, dt: float) -> Array:
        """Return the measured positions nearest to the last ones; see :meth:`StatefulWrapper.follow`."""
        return self._near(self.plant.measure(plant).q, own)

    def measure(self, state: Wrapped) -> FullState:
        """Return the measurement with its turns; see :meth:`Plant.measure`."""
        return FullState(state.own, self.plant.measure(state.plant).v)

    def _near(self, measured: Array, last: Array) -> Array:
        """Return measured positions, continuous joints moved by whole turns to be nearest to `last`."""
        turns = np.round((last - measured) / _TURN)
        return np.where(_continuous(self.plant), measured + _TURN * turns, measured)


def _continuous(plant: Plant) -> npt.NDArray[np.bool_]:
    """Return which joints turn without end, shape (n,)."""
    return np.array([kind == "continuous" for kind in plant.robot.joint_types])
