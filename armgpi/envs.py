"""A Gymnasium environment of an arm that follows a reference: what learning adds to a controller.

It needs Gymnasium: ``pip install gymnasium``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from armgpi.base.arrays import Array, check_number
from armgpi.control.controller import Controller
from armgpi.errors import MissingPackage, ParameterError
from armgpi.loop.closed_loop import ClosedLoop
from armgpi.loop.runner import DIVERGENCE
from armgpi.plants.plant import Plant
from armgpi.references.reference import Reference

try:
    import gymnasium
except ImportError:
    raise MissingPackage("gymnasium", "envs") from None


class ArmEnv(gymnasium.Env[Array, Array]):
    """An arm that a controller leads along a reference, with torques that the agent adds.

    An action is in [-1, 1] for every joint: the share of `authority` times its effort limit. An observation
    is measured positions, then positions and velocities of the reference, shape (3 n,). The reward of a step
    is minus the mean absolute error times the sample time, so the return is minus the joints' mean IAE. An
    episode is terminated when the arm diverges, and truncated at `t_final`. ``info`` has the torque, the
    error, and the controller's own share.

    Attributes:
        loop: the closed loop of this episode.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 (as Gymnasium has it)

    def __init__(
        self,
        plant: Plant | Callable[[np.random.Generator], Plant],
        controller: Controller,
        reference: Reference | Callable[[np.random.Generator], Reference],
        t_final: float,
        *,
        authority: float = 0.2,
    ) -> None:
        """Define the environment.

        Args:
            plant: the arm, or a function that draws one for every episode.
            controller: leads it; its torque is what the agent adds to.
            reference: what is asked for, or a function that draws it.
            t_final: how long an episode lasts [s].
            authority: share of the effort limits that the agent has.

        Raises:
            ParameterError: for a batch, a number out of range, or joints without effort limits.
        """
        self._plant, self._controller, self._reference = plant, controller, reference
        self._draw(np.random.default_rng(0))
        effort = np.asarray(self.loop.plant.robot.limits.effort)
        if self.loop.batch is not None or not (np.isfinite(effort) & (effort < 1e300)).all():
            raise ParameterError("plant", plant, "a single arm whose joints have effort limits")
        self._span = effort * check_number(authority, "authority", "a share from 0 to 1", 0.0, 1.0)
        self._steps = round(check_number(t_final, "t_final", "a time [s]", controller.dt) / controller.dt)
        n = len(effort)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (n,), np.float64)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (3 * n,), np.float64)

    def _draw(self, rng: np.random.Generator) -> None:
        """Make the loop of an episode."""
        plant = self._plant if isinstance(self._plant, Plant) else self._plant(rng)
        reference = self._reference if isinstance(self._reference, Reference) else self._reference(rng)
        self.loop = ClosedLoop(plant, self._controller, reference)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode at the reference, or at ``options["q0"]``; return observation and info."""
        super().reset(seed=seed)
        self._draw(self.np_random)
        self._state = self.loop.init((options or {}).get("q0"))
        return self._observation(), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Take one sample; return observation, reward, terminated, truncated and info."""
        loop, state = self.loop, self._state
        _, own, controller = loop.asked(state.plant, state.controller, loop.reference.at(state.k * loop.dt))
        tau = own + self._span * np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)
        plant = loop.plant.step(tau, state.plant, loop.dt)
        self._state = state._replace(k=state.k + 1, plant=plant, controller=controller)
        error = loop.true_state(self._state).q - loop.reference.at(self._state.k * loop.dt).q
        lost = not np.abs(error).max() < DIVERGENCE
        reward = -float(np.abs(error).mean() * loop.dt) if not lost else -DIVERGENCE
        info = {"tau": tau, "own": own, "error": error}
        return self._observation(), reward, lost, self._state.k >= self._steps, info

    def _observation(self) -> Array:
        target = self.loop.reference.at(self._state.k * self.loop.dt)
        q = self.loop.plant.measure(self._state.plant).q
        return np.concatenate([np.nan_to_num(q), target.q, target.v])


def __dir__() -> list[str]:
    """Return the public names, without what is imported here."""
    return ["ArmEnv"]
