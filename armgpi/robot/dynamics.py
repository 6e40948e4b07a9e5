"""The kernels: Pinocchio on one state or on a batch of them, without checks.

:class:`Dynamics` is what a control loop calls every sample. Arrays are (n,) or (batch, n), C-contiguous,
native float64 and trusted; :class:`armgpi.robot.robot.Robot` has the same functions with checks.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from armgpi.base.arrays import Array

if not hasattr(pin, "aba"):  # PyPI's `pinocchio` is a plug-in for nose
    raise ImportError(f"{pin.__file__} is another package named pinocchio; armgpi needs the one of `pin`")

#: Below this many states one thread is faster than waking others.
_SERIAL_BELOW = 16
#: Looked up once: these are called five times a sample. WORLD is the convention of the batch kernels.
_aba, _rnea, _WORLD = pin.aba, pin.rnea, pin.Convention.WORLD


class _Fork:
    """Whether this process was forked: then OpenMP has no threads here, and libgomp waits for them."""

    def __init__(self) -> None:
        """Begin in a process that was not."""
        self.happened = False

    def note(self) -> None:
        """Note that this process was forked."""
        self.happened = True


_fork = _Fork()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_fork.note)


class Dynamics(Protocol):
    """What a controller or plant needs of a robot's equations of motion, D(q) a + C(q, v) v + G(q) = tau.

    Arrays are C-contiguous float64, one state (n,) or a batch (batch, n), and are not checked. Friction is
    not part of the equations.
    """

    def forward(self, q: Array, v: Array, tau: Array) -> Array:
        """Return the acceleration D(q)^-1 (tau - C(q, v) v - G(q)).

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            v: velocities [rad/s or m/s], same shape.
            tau: torques [N m or N], same shape.

        Returns:
            Accelerations [rad/s^2 or m/s^2], same shape.
        """

    def inverse(self, q: Array, v: Array, a: Array) -> Array:
        """Return the torque D(q) a + C(q, v) v + G(q).

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            v: velocities [rad/s or m/s], same shape.
            a: accelerations [rad/s^2 or m/s^2], same shape.

        Returns:
            Torques [N m or N], same shape.
        """

    def inverse_where(self, on: Array, q: Array, v: Array, a: Array) -> Array:
        """Return `on` times the torque of :meth:`inverse`, without work where `on` is all zero.

        Args:
            on: 1 where the torque is asked for, 0 elsewhere, shape (1,) or (batch, 1).
            q: positions [rad or m], shape (n,) or (batch, n).
            v: velocities [rad/s or m/s], same shape.
            a: accelerations [rad/s^2 or m/s^2], same shape.

        Returns:
            Torques [N m or N], same shape.
        """

    def inertia_times(self, q: Array, a: Array) -> Array:
        """Return D(q) a.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            a: accelerations [rad/s^2 or m/s^2], same shape.

        Returns:
            Torques [N m or N], same shape.
        """

    def inertia_solve(self, q: Array, tau: Array) -> Array:
        """Return D(q)^-1 tau; zero where tau is, then perhaps `tau` itself.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            tau: torques [N m or N], same shape.

        Returns:
            Accelerations [rad/s^2 or m/s^2], same shape.
        """

    def nonlinear_effects(self, q: Array, v: Array) -> Array:
        """Return C(q, v) v + G(q).

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            v: velocities [rad/s or m/s], same shape.

        Returns:
            Torques [N m or N], same shape.
        """

    def gravity(self, q: Array) -> Array:
        """Return G(q).

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).

        Returns:
            Torques [N m or N], same shape.
        """

    def mass_matrix(self, q: Array) -> Array:
        """Return the inertia matrix D(q).

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).

        Returns:
            D [kg m^2, kg m or kg], shape (n, n) or (batch, n, n), symmetric.
        """


class Workspace(threading.local):
    """Pinocchio's working memory for one model; every thread has its own, made at its first use.

    A pickle or copy of it has the model alone.

    Attributes:
        model: the `pin.Model`, not to be changed.
        data: its `pin.Data`.
    """

    def __init__(self, model: pin.Model) -> None:
        """Make the memory for `model`; Python calls this again in every further thread."""
        self.model = model
        self.data = model.createData()
        self._pool: Any = None

    def pool(self, threads: int) -> Any:
        """Return the `pin.ModelPool` that batch kernels of so many threads work in."""
        if self._pool is None:
            self._pool = pin.ModelPool(self.model, threads)
        return self._pool

    def __reduce__(self) -> tuple[type[Workspace], tuple[Any]]:
        """Return how to make it anew: `pin.Data` cannot be pickled, and belongs to one thread."""
        return Workspace, (self.model,)


class _ByInverse:
    """What inverse dynamics give."""

    def inverse_where(self: Any, on: Array, q: Array, v: Array, a: Array) -> Array:
        """Return `on` times the torque; see :meth:`Dynamics.inverse_where`."""
        return on * self.inverse(q, v, a) if np.count_nonzero(on) else np.zeros_like(q)

    def nonlinear_effects(self: Any, q: Array, v: Array) -> Array:
        """Return C(q, v) v + G(q); see :meth:`Dynamics.nonlinear_effects`."""
        tau: Array = self.inverse(q, v, np.zeros_like(q))
        return tau

    def gravity(self: Any, q: Array) -> Array:
        """Return G(q); see :meth:`Dynamics.gravity`."""
        tau: Array = self.inverse(q, np.zeros_like(q), np.zeros_like(q))
        return tau


class PinocchioDynamics(_ByInverse):
    """Kernels of one Pinocchio model.

    Batches go through Pinocchio's parallel versions, which agree with the single ones bit by bit (in
    its WORLD convention). D(q) a is inverse dynamics without gravity and velocity, which never builds D.

    Attributes:
        model: the `pin.Model`, not to be changed.
    """

    def __init__(self, model: pin.Model) -> None:
        """Take over a `pin.Model` (nq = nv) that nobody else may change."""
        self.model = model
        self._workspace = Workspace(model)
        # The same masses in free fall: with v = 0, inverse dynamics is D(q) a alone.
        free = model.copy()
        free.gravity = pin.Motion.Zero()
        self._free = free
        self._free_workspace = Workspace(free)
        self._rest = np.zeros(model.nv)
        self._threads = thread_count()

    def forward(self, q: Array, v: Array, tau: Array) -> Array:
        """Return the acceleration; see :meth:`Dynamics.forward`.

        By the articulated-body algorithm (Featherstone 2008, ch. 7).
        """
        if q.ndim == 1:
            a: Array = _aba(self.model, self._workspace.data, q, v, tau, _WORLD)
            return a
        return self._parallel(pin.abaInParallel, self._workspace, q, v, tau)

    def inverse(self, q: Array, v: Array, a: Array) -> Array:
        """Return the torque; see :meth:`Dynamics.inverse`.

        By the recursive Newton-Euler algorithm (Featherstone 2008, ch. 5).
        """
        if q.ndim == 1:
            tau: Array = _rnea(self.model, self._workspace.data, q, v, a)
            return tau
        return self._parallel(pin.rneaInParallel, self._workspace, q, v, a)

    def nonlinear_effects(self, q: Array, v: Array) -> Array:
        """Return C(q, v) v + G(q); see :meth:`Dynamics.nonlinear_effects`."""
        return self.inverse(q, v, self._rest if q.ndim == 1 else np.zeros_like(q))

    def gravity(self, q: Array) -> Array:
        """Return G(q); see :meth:`Dynamics.gravity`."""
        rest = self._rest if q.ndim == 1 else np.zeros_like(q)
        return self.inverse(q, rest, rest)

    def inertia_times(self, q: Array, a: Array) -> Array:
        """Return D(q) a; see :meth:`Dynamics.inertia_times`.

        By the Newton-Euler recursion without gravity and at rest.
        """
        if q.ndim == 1:
            tau: Array = _rnea(self._free, self._free_workspace.data, q, self._rest, a)
            return tau
        return self._parallel(pin.rneaInParallel, self._free_workspace, q, np.zeros_like(q), a)

    def inertia_solve(self, q: Array, tau: Array) -> Array:
        """Return D(q)^-1 tau; see :meth:`Dynamics.inertia_solve`.

        By the articulated-body algorithm without gravity and at rest. The result is exactly zero where tau
        is, and costs nothing when all of tau is zero.
        """
        if not np.count_nonzero(tau):
            return tau
        if q.ndim == 1:
            a: Array = _aba(self._free, self._free_workspace.data, q, self._rest, tau, _WORLD)
            return a
        rows = np.flatnonzero(tau.any(axis=-1))
        q, tau_rows = q[rows], tau[rows]
        a = np.zeros_like(tau)
        a[rows] = self._parallel(pin.abaInParallel, self._free_workspace, q, np.zeros_like(q), tau_rows)
        return a

    def mass_matrix(self, q: Array) -> Array:
        """Return D(q); see :meth:`Dynamics.mass_matrix`.

        By the composite-rigid-body algorithm (Featherstone 2008, ch. 6).
        """
        if q.ndim == 1:
            matrix: Array = np.array(pin.crba(self.model, self._workspace.data, q))
            return matrix
        data = self._workspace.data
        return np.array([pin.crba(self.model, data, row) for row in q]).reshape(*q.shape, q.shape[-1])

    def _parallel(self, kernel: Any, workspace: Workspace, q: Array, v: Array, x: Array) -> Array:
        """Run a batch kernel; Pinocchio wants (n, batch), which a transposed row-major array is."""
        out = np.empty(q.shape)
        threads = 1 if len(q) < _SERIAL_BELOW or _fork.happened else self._threads
        kernel(threads, workspace.pool(self._threads), q.T, v.T, x.T, out.T)
        return out


class _Rows(threading.local):
    """A model and its working memory, into which one row after another is put; each thread has its own."""

    def __init__(self, model: pin.Model) -> None:
        self.model = model.copy()
        self.data = self.model.createData()


class VariedDynamics(_ByInverse):
    """One arm with another load, rotor inertia or gravity in each row of a batch.

    What varies is what was declared to, whatever the numbers are: generated code has it as an input.

    Attributes:
        base: the dynamics of the arm without what varies.
        batch: number of rows.
        joint: index of the `pin.Model`'s joint whose body carries the load.
        load: mass [kg] and centre of mass in that body's axes [m], shape (batch, 4), or None.
        armature: rotor inertia of all coordinates [kg m^2 or kg], shape (batch, nv), or None.
        gravity_vector: acceleration of free fall [m/s^2], shape (batch, 3), or None.
    """

    def __init__(
        self,
        base: PinocchioDynamics,
        batch: int,
        joint: int = 0,
        load: Array | None = None,
        armature: Array | None = None,
        gravity: Array | None = None,
    ) -> None:
        """Vary `base`; the arrays are trusted."""
        self.base, self.batch, self.joint = base, batch, joint
        self.load, self.armature, self.gravity_vector = load, armature, gravity
        self._begin()

    def forward(self, q: Array, v: Array, tau: Array) -> Array:
        """Return the acceleration; see :meth:`Dynamics.forward`."""
        return self._each(lambda model, data, *x: _aba(model, data, *x, _WORLD), False, q, v, tau)

    def inverse(self, q: Array, v: Array, a: Array) -> Array:
        """Return the torque; see :meth:`Dynamics.inverse`."""
        return self._each(_rnea, False, q, v, a)

    def inertia_times(self, q: Array, a: Array) -> Array:
        """Return D(q) a; see :meth:`Dynamics.inertia_times`."""
        return self._each(_rnea, True, q, np.zeros_like(q), a)

    def inertia_solve(self, q: Array, tau: Array) -> Array:
        """Return D(q)^-1 tau; see :meth:`Dynamics.inertia_solve`."""
        if not np.count_nonzero(tau):
            return tau
        rest = np.zeros_like(q)
        solved = self._each(lambda model, data, *x: _aba(model, data, *x, _WORLD), True, q, rest, tau)
        solved[~tau.any(axis=-1)] = 0.0
        return solved

    def mass_matrix(self, q: Array) -> Array:
        """Return D(q); see :meth:`Dynamics.mass_matrix`."""
        return self._each(pin.crba, False, q)

    def row(self, i: int) -> PinocchioDynamics:
        """Return the dynamics of one row."""
        model = self.base.model.copy()
        self._put(model, i, False)
        return PinocchioDynamics(model)

    def __getstate__(self) -> dict[str, Any]:
        """Return what is not made anew: working memory belongs to one thread of one process."""
        return {key: value for key, value in vars(self).items() if not key.startswith("_")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take over what was pickled."""
        vars(self).update(state)
        self._begin()

    def _begin(self) -> None:
        """Make what belongs to one process."""
        self._rows, self._free_rows = _Rows(self.base.model), _Rows(self.base.model)
        self._inertias: list[Any] = []

    def _each(self, kernel: Any, free: bool, *arguments: Array) -> Array:
        """Call a kernel row by row, in free fall where that is asked for."""
        rows = self._free_rows if free else self._rows
        model, data = rows.model, rows.data
        shape = arguments[0].shape if kernel is not pin.crba else (*arguments[0].shape, model.nv)
        found = np.empty(shape)
        for i, row in enumerate(zip(*arguments, strict=True)):
            self._put(model, i, free)
            found[i] = kernel(model, data, *row)
        return found

    def _put(self, model: pin.Model, i: int, free: bool) -> None:
        """Give a model the numbers of row i."""
        if self.load is not None:
            if not self._inertias:
                own, point = self.base.model.inertias[self.joint], np.zeros((3, 3))
                self._inertias = [own + pin.Inertia(float(x[0]), x[1:], point) for x in self.load]
            model.inertias[self.joint] = self._inertias[i]
        if self.armature is not None:
            model.armature = self.armature[i]
        if free:
            model.gravity = pin.Motion.Zero()
        elif self.gravity_vector is not None:
            model.gravity = pin.Motion(self.gravity_vector[i], np.zeros(3))


class CoupledDynamics(_ByInverse):
    """Equations of motion of joints that others follow: all coordinates are ``ratio @ q + offset``.

    The ratio J is constant, so the equations are those of the whole model projected on the free joints:
    D = J' D_whole J, and a torque is J' of the whole model's.

    Attributes:
        whole: dynamics of all m coordinates.
        ratio: J, shape (m, n).
        offset: shape (m,).
    """

    def __init__(self, whole: PinocchioDynamics | VariedDynamics, ratio: Array, offset: Array) -> None:
        """Project the `whole` model of m coordinates by `ratio` (m, n) and `offset` (m,)."""
        self.whole, self.ratio, self.offset = whole, ratio, offset

    def forward(self, q: Array, v: Array, tau: Array) -> Array:
        """Return the acceleration, by solving with D(q); see :meth:`Dynamics.forward`."""
        return self._solve(q, tau - self.nonlinear_effects(q, v))

    def inverse(self, q: Array, v: Array, a: Array) -> Array:
        """Return the torque, by the whole model's recursion; see :meth:`Dynamics.inverse`."""
        tau = self.whole.inverse(self._all(q), *self._rates(v, a))
        return np.ascontiguousarray(tau @ self.ratio)

    def inertia_times(self, q: Array, a: Array) -> Array:
        """Return D(q) a; see :meth:`Dynamics.inertia_times`."""
        return np.ascontiguousarray(self.whole.inertia_times(self._all(q), *self._rates(a)) @ self.ratio)

    def inertia_solve(self, q: Array, tau: Array) -> Array:
        """Return D(q)^-1 tau; see :meth:`Dynamics.inertia_solve`."""
        return self._solve(q, tau) if np.count_nonzero(tau) else tau

    def mass_matrix(self, q: Array) -> Array:
        """Return D(q); see :meth:`Dynamics.mass_matrix`."""
        matrix: Array = self.ratio.T @ self.whole.mass_matrix(self._all(q)) @ self.ratio
        return matrix

    def _all(self, q: Array) -> Array:
        """Return all coordinates of the whole model."""
        return np.ascontiguousarray(q @ self.ratio.T + self.offset)

    def _rates(self, *rates: Array) -> list[Array]:
        """Return velocities or accelerations of all coordinates."""
        return [np.ascontiguousarray(rate @ self.ratio.T) for rate in rates]

    def _solve(self, q: Array, tau: Array) -> Array:
        """Return D(q)^-1 tau by a dense solve, n being small."""
        x = np.linalg.solve(self.mass_matrix(q), tau[..., np.newaxis])[..., 0]
        return np.ascontiguousarray(x, dtype=np.float64)


class ScaledDynamics:
    """A robot whose masses and inertias are all multiplied by one factor: D, C and G scale with it.

    Rollouts that differ by the factor alone share one call of the kernels of `base`.

    Attributes:
        base: the dynamics that are scaled.
        scale: the factor [-], a number or one per rollout, shape (batch, 1).
    """

    def __init__(self, base: Dynamics, scale: float | Array) -> None:
        """Scale `base` by a number, or by one per rollout: an array (batch, 1)."""
        self.base = base
        self.scale = scale

    def forward(self, q: Array, v: Array, tau: Array) -> Array:
        """Return the acceleration; see :meth:`Dynamics.forward`."""
        return self.base.forward(q, v, tau / self.scale)

    def inverse(self, q: Array, v: Array, a: Array) -> Array:
        """Return the torque; see :meth:`Dynamics.inverse`."""
        return self.scale * self.base.inverse(q, v, a)

    def inverse_where(self, on: Array, q: Array, v: Array, a: Array) -> Array:
        """Return `on` times the torque; see :meth:`Dynamics.inverse_where`."""
        return self.scale * self.base.inverse_where(on, q, v, a)

    def inertia_times(self, q: Array, a: Array) -> Array:
        """Return D(q) a; see :meth:`Dynamics.inertia_times`."""
        return self.scale * self.base.inertia_times(q, a)

    def inertia_solve(self, q: Array, tau: Array) -> Array:
        """Return D(q)^-1 tau; see :meth:`Dynamics.inertia_solve`."""
        if not np.count_nonzero(tau):
            return tau
        return self.base.inertia_solve(q, tau / self.scale)

    def nonlinear_effects(self, q: Array, v: Array) -> Array:
        """Return C(q, v) v + G(q); see :meth:`Dynamics.nonlinear_effects`."""
        return self.scale * self.base.nonlinear_effects(q, v)

    def gravity(self, q: Array) -> Array:
        """Return G(q); see :meth:`Dynamics.gravity`."""
        return self.scale * self.base.gravity(q)

    def mass_matrix(self, q: Array) -> Array:
        """Return D(q); see :meth:`Dynamics.mass_matrix`."""
        scale = self.scale if isinstance(self.scale, float) else self.scale[..., np.newaxis]
        return scale * self.base.mass_matrix(q)


def stack_dynamics(parts: Sequence[Dynamics]) -> Dynamics:
    """Return the dynamics of a batch, with one part per row.

    Args:
        parts: dynamics of the n joints of every rollout; row i of every array belongs to `parts[i]`.

    Returns:
        Dynamics of arrays (batch, n). Rows whose dynamics are the same or differ by a factor share one call.
    """
    scaled = [part if isinstance(part, ScaledDynamics) else ScaledDynamics(part, 1.0) for part in parts]
    rows: dict[int, list[int]] = {}
    for row, part in enumerate(scaled):
        rows.setdefault(id(part.base), []).append(row)
    groups: list[tuple[Dynamics, Array]] = []
    for group in rows.values():
        base = scaled[group[0]].base
        scale = np.array([[scaled[row].scale] for row in group])
        groups.append((base if (scale == 1.0).all() else ScaledDynamics(base, scale), np.array(group)))
    return groups[0][0] if len(groups) == 1 else StackedDynamics(groups)


class StackedDynamics(_ByInverse):
    """One robot per row of the batch, equal ones in groups, so that each is called once per batch.

    Attributes:
        groups: the different dynamics, each with the numbers of its rows, shape (rows,).
    """

    def __init__(self, groups: Sequence[tuple[Dynamics, Array]]) -> None:
        """Take the parts, each with the rows that belong to it."""
        self.groups = groups

    def forward(self, q: Array, v: Array, tau: Array) -> Array:
        """Return the acceleration of every row; see :meth:`Dynamics.forward`."""
        return self._scatter("forward", q, v, tau)

    def inverse(self, q: Array, v: Array, a: Array) -> Array:
        """Return the torque of every row; see :meth:`Dynamics.inverse`."""
        return self._scatter("inverse", q, v, a)

    def inertia_times(self, q: Array, a: Array) -> Array:
        """Return D(q) a of every row; see :meth:`Dynamics.inertia_times`."""
        return self._scatter("inertia_times", q, a)

    def inertia_solve(self, q: Array, tau: Array) -> Array:
        """Return D(q)^-1 tau of every row; see :meth:`Dynamics.inertia_solve`."""
        return self._scatter("inertia_solve", q, tau)

    def nonlinear_effects(self, q: Array, v: Array) -> Array:
        """Return C(q, v) v + G(q) of every row; see :meth:`Dynamics.nonlinear_effects`."""
        return self._scatter("nonlinear_effects", q, v)

    def gravity(self, q: Array) -> Array:
        """Return G(q) of every row; see :meth:`Dynamics.gravity`."""
        return self._scatter("gravity", q)

    def mass_matrix(self, q: Array) -> Array:
        """Return D(q) of every row; see :meth:`Dynamics.mass_matrix`."""
        return self._scatter("mass_matrix", q)

    def _scatter(self, name: str, *arguments: Array) -> Array:
        """Call the kernel `name` of every part on its rows and put the results back in order."""
        results = [(rows, getattr(part, name)(*(x[rows] for x in arguments))) for part, rows in self.groups]
        out = np.empty((len(arguments[0]), *results[0][1].shape[1:]))
        for rows, result in results:
            out[rows] = result
        return out


def thread_count() -> int:
    """Return the number of threads for batch kernels: the cores we may use, or OMP_NUM_THREADS."""
    asked = os.environ.get("OMP_NUM_THREADS", "")
    if asked.isdigit() and int(asked) > 0:
        return int(asked)
    return cores()


def cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return max(1, len(os.sched_getaffinity(0)))
    return max(1, os.cpu_count() or 1)
