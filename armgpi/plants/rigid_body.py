"""A rigid arm under torque, gravity, loads and friction, integrated by Runge-Kutta."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, new
from armgpi.base.parameter import parameter, with_parameters
from armgpi.plants.arm import Arm
from armgpi.plants.friction import STICK_VELOCITY
from armgpi.plants.plant import PlantState


class _StepSizes(NamedTuple):
    """Multiples of a step size as 0-d arrays, which NumPy multiplies faster than Python numbers."""

    h: Array
    half: Array
    sixth: Array
    square: Array


@lru_cache(maxsize=8)
def _step_sizes(h: float) -> _StepSizes:
    """Return h, h / 2, h / 6 and h^2 / 6."""
    return _StepSizes(*map(np.array, (h, 0.5 * h, h / 6.0, h * h / 6.0)))


@with_parameters
class RigidBodyPlant(Arm):
    """An arm by Pinocchio: D(q) a + C(q, v) v + G(q) = tau - tau_d - friction.

    The torque is held over the sample. Without friction each substep is one classical Runge-Kutta step
    (order 4), its stages at their own times seeing the loads. Friction, which may be far stiffer than
    the sample time, follows implicitly (order 1, stable for every coefficient).

    Attributes:
        stick_velocity: speed below which Coulomb friction is smoothed [rad/s or m/s].
    """

    config_name: ClassVar[str | None] = "armgpi"
    feels: ClassVar[tuple[str, ...]] = ("loads", "friction", "environment")

    stick_velocity: float = parameter(
        "speed below which Coulomb friction is smoothed",
        unit="rad/s or m/s",
        default=STICK_VELOCITY,
        least=0.0,
        above=True,
        in_file=False,
        structural=True,
    )

    def step(self, tau: Array, state: PlantState, dt: float) -> PlantState:
        """Return the state after `tau` was held for `dt`; see :meth:`Plant.step`."""
        k, q, v, _ = state
        h = dt / self.substeps
        advance = self._without_friction if self.friction is None else self._with_friction
        for i in range(self.substeps):
            touched = partial(self.contact_torque, k=k, dt=dt)
            q, v = advance(q, v, *self.acting_torques(tau, k, i, dt), h, touched, i)
        return new(PlantState, (k + 1, q, v, tau))

    def _without_friction(
        self,
        q: Array,
        v: Array,
        begin: Array,
        middle: Array,
        end: Array,
        h: float,
        touched: Callable[..., Any],
        i: int,
    ) -> tuple[Array, Array]:
        """Return q and v after one classical Runge-Kutta step of q' = v, v' = D^-1 (tau - C v - G).

        Args:
            q: positions [rad or m], (n,) or (batch, n).
            v: velocities [rad/s or m/s], likewise.
            begin: torque at the beginning of the step [N m or N], likewise.
            middle: in its middle.
            end: at its end.
            h: its length [s].
            touched: gives the torque of what the tool touches, from positions, velocities and `substep`.
            i: number of the substep.
        """
        dynamics = self.robot.dynamics

        def forward(q: Array, v: Array, tau: Array, share: float) -> Array:
            if self._surroundings is None:
                return dynamics.forward(q, v, tau)
            return dynamics.forward(q, v, tau + touched(q, v, substep=i + share))

        whole, half, sixth, square = _step_sizes(h)
        # Written out for second-order equations: the same stages with half the array operations.
        way = half * v
        a1 = forward(q, v, begin, 0.0)
        gain1 = half * a1
        q2 = q + way
        a2 = forward(q2, v + gain1, middle, 0.5)
        gain2 = half * a2
        a3 = forward(q2 + half * gain1, v + gain2, middle, 0.5)
        ahead = q2 + way
        a4 = forward(ahead + whole * gain2, v + whole * a3, end, 1.0)
        inner = a2 + a3
        first = a1 + inner
        return ahead + square * first, v + sixth * (first + inner + a4)

    def _with_friction(
        self,
        q: Array,
        v: Array,
        begin: Array,
        middle: Array,
        end: Array,
        h: float,
        touched: Callable[..., Any],
        i: int,
    ) -> tuple[Array, Array]:
        """Take a Runge-Kutta step without friction, then the friction that acts over it, implicitly.

        Where friction is in balance with the torque, the balance is exact.
        """
        q_free, v_free = self._without_friction(q, v, begin, middle, end, h, touched, i)
        new = self.velocity_after_friction(q, v_free, h, self.stick_velocity, v)
        return q_free + 0.5 * h * (new - v_free), new
