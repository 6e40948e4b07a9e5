"""A rigid arm under torque, gravity, loads and friction, integrated by Runge-Kutta."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import ClassVar, NamedTuple, cast

import numpy as np

from armgpi.arrays import Array, new
from armgpi.parameter import parameter, with_parameters
from armgpi.plants.arm import Arm
from armgpi.plants.plant import PlantState
from armgpi.robot.equations import Friction

#: Newton steps for Coulomb friction: 1e-9 of it is left after 16 for all of 12,000 random arms.
_NEWTON_STEPS = 16
#: Speed below which Coulomb friction is smoothed [rad/s or m/s], where nobody says another.
STICK_VELOCITY = 1e-3


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

    stick_velocity: float = parameter(
        "speed below which Coulomb friction is smoothed",
        unit="rad/s or m/s",
        default=STICK_VELOCITY,
        least=0.0,
        above=True,
        in_file=False,
        structural=True,
    )

    def __post_init__(self) -> None:
        """Check what is given, and choose how to step; see :class:`armgpi.plants.arm.Arm`."""
        super().__post_init__()
        # What differs by rollout was declared to vary, whatever it is.
        coulomb = np.zeros(0) if self.friction is None else self.friction.coulomb
        self._sticks = coulomb.ndim == 2 or bool(coulomb.any())
        self._brake = ImplicitFriction(self._sticks)
        self._substep = self._without_friction if self.friction is None else self._with_friction

    def step(self, tau: Array, state: PlantState, dt: float) -> PlantState:
        """Return the state after `tau` was held for `dt`; see :meth:`Plant.step`."""
        k, q, v, _ = state
        h = dt / self.substeps
        for i in range(self.substeps):
            begin = middle = end = tau
            if self._table is not None:
                begin, middle, end = (tau - load for load in self._table.at(k, i, dt))
            q, v = self._substep(q, v, begin, middle, end, h)
        return new(PlantState, (k + 1, q, v, tau))

    def _without_friction(
        self, q: Array, v: Array, begin: Array, middle: Array, end: Array, h: float
    ) -> tuple[Array, Array]:
        """Return q and v after one classical Runge-Kutta step of q' = v, v' = D^-1 (tau - C v - G).

        The three torques are what acts at the beginning, in the middle and at the end of the step.
        """
        forward = self.robot.dynamics.forward
        whole, half, sixth, square = _step_sizes(h)
        # Written out for second-order equations: the same stages with half the array operations.
        way = half * v
        a1 = forward(q, v, begin)
        gain1 = half * a1
        q2 = q + way
        a2 = forward(q2, v + gain1, middle)
        gain2 = half * a2
        a3 = forward(q2 + half * gain1, v + gain2, middle)
        ahead = q2 + way
        a4 = forward(ahead + whole * gain2, v + whole * a3, end)
        inner = a2 + a3
        first = a1 + inner
        return ahead + square * first, v + sixth * (first + inner + a4)

    def _with_friction(
        self, q: Array, v: Array, begin: Array, middle: Array, end: Array, h: float
    ) -> tuple[Array, Array]:
        """Take a Runge-Kutta step without friction, then the friction that acts over it, implicitly.

        Where friction is in balance with the torque, the balance is exact.
        """
        assert self.friction is not None
        q_free, v_free = self._without_friction(q, v, begin, middle, end, h)
        inertia = self.robot.dynamics.mass_matrix(q)
        viscous, coulomb = self.friction
        new = self._brake(inertia, v_free, viscous, coulomb, h, self.stick_velocity)
        return q_free + 0.5 * h * (new - v_free), new


class ImplicitFriction:
    """The velocity that friction leaves of an arm's after a substep; a function of its own in generated C.

    Attributes:
        sticks: whether there is Coulomb friction.
    """

    def __init__(self, sticks: bool) -> None:
        """Note whether there is Coulomb friction."""
        self.sticks = sticks

    def __call__(
        self, inertia: Array, v_free: Array, viscous: Array, coulomb: Array, h: float, stick: float
    ) -> Array:
        """Return the velocity, from D(q) and the velocity without friction, after `h`."""
        momentum = np.matmul(inertia, v_free[..., None])
        diagonal = np.arange(v_free.shape[-1])

        def brake(resistance: Array, push: Array) -> Array:
            """Solve (D + h diag(resistance)) v = D v_free - h push."""
            matrix = inertia.copy()
            matrix[..., diagonal, diagonal] += h * resistance
            return solve(matrix, momentum - h * push[..., None])

        return after_friction(brake, v_free, Friction(viscous, coulomb), stick, self.sticks)


def after_friction(
    braked: Callable[[Array, Array], Array], v_free: Array, friction: Friction, stick: float, sticks: bool
) -> Array:
    """Return the velocity v that friction leaves of v_free.

    The torque of friction is -(f_v v + f_c v / |v|), with |v| smoothed to sqrt(v^2 + stick^2). It solves by
    Newton's method on v and on the share of Coulomb friction in use together (Chan, Golub, Mulet 1999),
    which unlike Newton's method on v alone converges from v_free, in some ten steps. Each step is one
    linear equation per rollout, however the others fare.

    Args:
        braked: the velocity under the torque -(resistance v + push), from (resistance, push).
        v_free: velocities without friction [rad/s or m/s].
        friction: its coefficients.
        stick: speed below which Coulomb friction is smoothed [rad/s or m/s].
        sticks: whether there is Coulomb friction.
    """
    viscous, coulomb = friction
    v, share = v_free, np.zeros_like(v_free)
    for _ in range(_NEWTON_STEPS if sticks else 0):
        speed = np.sqrt(v * v + stick * stick)
        sign = v / speed
        slope = (1.0 - share * sign) / speed
        ahead = braked(viscous + coulomb * slope, coulomb * (sign - slope * v))
        share = np.minimum(np.maximum(sign + slope * (ahead - v), -1.0), 1.0)
        v = ahead
    # With friction at the speed found, a step of this form can only take energy, whatever is left to solve.
    return braked(viscous + coulomb / np.sqrt(v * v + stick * stick), np.zeros_like(v))


def solve(matrix: Array, column: Array) -> Array:
    """Solve for one column per matrix; where a rollout has diverged the answer is NaN, not an exception."""
    try:
        return cast(Array, np.linalg.solve(matrix, column)[..., 0])
    except np.linalg.LinAlgError:
        finite = np.asarray(np.isfinite(matrix).all(axis=(-2, -1)))[..., None, None]
        safe = np.where(finite, matrix, np.eye(matrix.shape[-1]))
        return np.where(finite, np.linalg.solve(safe, column), np.nan)[..., 0]
