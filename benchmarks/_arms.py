"""The arms that are measured, their closed loops, and what a run has to be before its time counts."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
import xarray as xr
from _peer import Array, Law, Trajectory

import armgpi  # before Pinocchio: it sets OMP_WAIT_POLICY, which OpenMP reads when it is loaded

# isort: split
import _pinocchio
import pinocchio as pin
from _generated import Kernels, aligned

from armgpi.codegen import build

#: The peers that need not be there; None where they are not.
mujoco: Any = import_module("_mujoco") if find_spec("mujoco") else None
drake: Any = import_module("_drake") if find_spec("pydrake") else None
dynibo: Any = import_module("_dynibo") if find_spec("dynibo") else None

DT = 1e-3  # [s]
OMEGA = 20.0  # [rad/s]
MOVE = 0.5  # [rad], every joint
T_MOVE = 1.0  # [s]
#: Robot -> joints held at zero. MuJoCo and Drake refuse the first: its link 2 breaks the triangle inequality.
ROBOTS: dict[str, tuple[str, ...]] = {
    "anthropomorphic3": (),
    "ur5": (),
    "panda": ("panda_finger_joint1", "panda_finger_joint2"),
}
PEER_ROBOTS = ("ur5", "panda")

#: Error of a run that ends a second or more after its move [rad].
SETTLED = 1e-6
#: Error of a run that may end in the middle of the move [rad].
ON_TRACK = 0.02
#: Same equations, integrator and hold: only rounding differs, and the loop forgets it [rad].
SAME = 1e-10
#: The Euler method is about half a step off, and the arm moves at up to 1.3 rad/s [rad].
EULER = 1e-3
#: A Runge-Kutta method of order 3 in place of 4 [rad].
ORDER_3 = 1e-6
#: Under the same torques without feedback, for 0.2 s, differences grow with the arm's dynamics [rad].
REPLAYED = 1e-9
#: The Euler method under the same torques, without feedback that would hold it, for 0.2 s [rad].
EULER_REPLAYED = 5e-3
#: Share of the effort limit that is no saturation.
UNSATURATED = 0.99
#: Kernels against Pinocchio's, relative to the largest entry.
KERNEL = 1e-9


class Arm:
    """A robot in a closed loop of GPI, and its kernels alone."""

    def __init__(self, name: str, networks: bool = False) -> None:
        """Load the robot."""
        self.name = name
        os.environ["OMP_NUM_THREADS"] = "2"  # read when a robot is made: its pools are for so many
        self.robot = armgpi.Robot.load(name, lock=ROBOTS[name])
        self.n = self.robot.n
        self.title = f"{name} (n = {self.n})"
        self.plant = armgpi.RigidBodyPlant(self.robot)
        # Networks answer a larger error at the start by more torque than the arm has.
        self._spread = 1e-4 if networks else 2e-3
        gains = armgpi.BSplineNetwork() if networks else armgpi.FixedGains(omega_c=OMEGA)
        self.controller = armgpi.GPI(self.robot, DT, gains)
        self.q0 = self.robot.middle()
        self.reference = armgpi.Bezier(self.q0, self.q0 + MOVE, duration=T_MOVE)
        self.effort = self.robot.limits.effort
        self.model = self.robot.pinocchio_model()
        rows = self.starts(16)
        self.robot.dynamics.forward(rows, rows, rows)
        self.robot.dynamics.inertia_times(rows, rows)

    @property
    def urdf(self) -> str:
        """The XML that it was read from."""
        path, _ = armgpi.robots.locate(self.name)
        return path.read_text()

    def starts(self, batch: int) -> Array:
        """Return starting positions near the reference's, shape (batch, n)."""
        return self.q0 + np.random.default_rng(1).uniform(-self._spread, self._spread, (batch, self.n))

    def targets(self, steps: int) -> Array:
        """Return the reference at every sample, shape (steps, n)."""
        return self.reference.at(DT * np.arange(steps)).q

    def law(self, q: Array) -> Law:
        """Return the peers' controller, which begins with the torque that holds the arm at `q`."""
        dynamics = self.robot.dynamics
        return Law(OMEGA, DT, dynamics.inertia_solve(q, dynamics.gravity(q)))

    def simulate(
        self, backend: str, steps: int, q0: Array | None = None, threads: int = 1, every: int = 1
    ) -> xr.Dataset:
        """Run armgpi's loop, from the reference's start or a batch of others, on so many threads."""
        self.use(threads)
        return armgpi.simulate(
            self.plant,
            self.controller,
            self.reference,
            steps * DT,
            q0=q0,
            record_every=every,
            progress=False,
            backend=backend,
        )

    def use(self, threads: int) -> None:
        """Have both backends work on so many threads."""
        os.environ["OMP_NUM_THREADS"] = str(threads)
        self.robot.dynamics._threads = threads

    def floor(self, batch: int, threads: int = 1) -> Any:
        """Return a function of a number of steps that runs the generated kernels of a batch, nothing else."""
        lanes = 1 if batch == 1 else build.widest()
        kernels = Kernels(self.robot, lanes, ("forward", "inertia_times"))
        share = -(-batch // (threads * lanes)) * lanes
        q = np.resize(self.starts(batch), (share, self.n))
        rooms = [
            (kernels.packed(np.hstack([q, 0 * q + 0.1, 0 * q])), aligned(q.size)) for _ in range(threads)
        ]
        pool = ThreadPoolExecutor(threads) if threads > 1 else None

        def run(steps: int) -> None:
            if pool is None:
                kernels.call("step", *rooms[0], steps)
            else:
                list(pool.map(lambda room: kernels.call("step", *room, steps), rooms))
            require(f"{self.name}: kernels", float(np.abs(rooms[0][1]).max()), 1e9)

        return run

    def pinocchio_floor(self, batch: int, threads: int = 1) -> Any:
        """Return the same for Pinocchio's kernels: one by one from Python, or in parallel for a batch."""
        model, free = self.model, _pinocchio.without_gravity(self.model)
        world = pin.Convention.WORLD
        if batch == 1:
            data, free_data = model.createData(), free.createData()
            q, v, x, rest = self.q0 + 0.1, np.full(self.n, 0.1), np.ones(self.n), np.zeros(self.n)
            rnea, aba = pin.rnea, pin.aba

            def one(steps: int) -> None:
                for _ in range(steps):
                    rnea(free, free_data, q, rest, x)
                    aba(model, data, q, v, x, world)
                    aba(model, data, q, v, x, world)
                    aba(model, data, q, v, x, world)
                    aba(model, data, q, v, x, world)

            return one
        models, frees = pin.ModelPool(model, threads), pin.ModelPool(free, threads)
        rows = self.starts(batch)
        v, x, rest, out = (
            np.full_like(rows, 0.1),
            np.ones_like(rows),
            np.zeros_like(rows),
            np.empty_like(rows),
        )

        def many(steps: int) -> None:
            for _ in range(steps):
                pin.rneaInParallel(threads, frees, rows.T, rest.T, x.T, out.T)
                for _ in range(4):
                    pin.abaInParallel(threads, models, rows.T, v.T, x.T, out.T)

        return many


class Check:
    """What a peer's run has to be, and how far it was from armgpi's.

    Attributes:
        apart: largest distance of its positions from armgpi's [rad], over all checked runs.
    """

    def __init__(self, what: str, arm: Arm, expected: xr.Dataset, bound: float, settled: float) -> None:
        """Hold runs against armgpi's."""
        self.apart = 0.0
        self._what, self._bound, self._settled = what, bound, settled
        self._effort = arm.effort
        self._q = expected["q"].transpose("time", ..., "joint").values
        self._goal = expected["q_ref"].transpose("time", ..., "joint").values

    def __call__(self, run: Trajectory) -> None:
        """Check a run against armgpi's, sample by sample, and against the reference at its end."""
        mine = np.concatenate([run.q, run.q_end[None]])
        apart = float(np.max(np.abs(mine - self._q[: len(mine)])))
        require(f"{self._what}: distance from armgpi [rad]", apart, self._bound)
        error = float(np.max(np.abs(run.q_end - self._goal[len(run.q)])))
        require(f"{self._what}: error at the end [rad]", error, self._settled)
        use = float(np.max(np.abs(run.tau) / self._effort))
        require(f"{self._what}: share of the effort limit", use, UNSATURATED)
        self.apart = max(self.apart, apart)


def require(what: str, value: float, bound: float) -> None:
    """Refuse a value that is NaN or above its bound."""
    if not value <= bound:
        raise RuntimeError(f"{what} is {value:.3g}, expected at most {bound:.3g}: the figures do not count")


def check_rollout(rollout: xr.Dataset, what: str, settled: float) -> None:
    """Check that a run of armgpi finished, never saturated and ended on its reference."""
    if (rollout["status"] != armgpi.Status.FINISHED).any():
        raise RuntimeError(f"{what}: a rollout did not finish")
    error = np.abs(rollout["q"] - rollout["q_ref"]).isel(time=-1)
    require(f"{what}: error at the end [rad]", float(error.max(skipna=False)), settled)
    use = np.abs(rollout["tau_command"]) / rollout["effort"]
    require(f"{what}: share of the effort limit", float(use.max(skipna=False)), UNSATURATED)
