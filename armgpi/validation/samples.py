"""A model's functions sampled, and taken apart into the quantities of the equations of motion.

At a fixed configuration the Coriolis torque is a polynomial in the velocities, so its products v_j v_k are
found from a few velocities without any fitting; D is found from an inverse dynamics, an energy or a
forward dynamics in the same way. The names of the quantities are those of :mod:`armgpi.validation.tree`, and
"B" (N, n, n), what is linear in v, and "Z" (N, n), what is left at rest: both must be zero in a Coriolis
torque. "A" (N, n) are the accelerations of a forward dynamics that does not read every torque.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.errors import ModelError
from armgpi.validation.models import ARGUMENTS, States
from armgpi.validation.tree import Quantities
from armgpi.validation.worker import Worker

#: Configurations, and how few at least where calls are slow. Nothing agrees at forty of them by chance, and
#: sums of up to eight harmonics are found from them.
CONFIGURATIONS, FEWEST = 40, 6
#: How long all the sampling of one function may take [s]; slow models get fewer configurations.
BUDGET = 20.0
#: Of that what the processor may take [s], and the configurations down to which it counts.
COMPUTING, FEW = 2.0, 16
#: What the processor may take for all functions [s]: beyond it, `FEWEST` configurations are taken.
SAMPLING = 8.0
#: Two calls at the same state differ by no more than this, relative: threads may sum in another order.
REPEATABLE = 1e-12
#: The model's arithmetic is looked at over steps of this size [rad or m], along this many configurations.
_STEP, _ROUGH = 1e-5, 3
#: Rounding is at most this, relative (a few digits of float32); anything rougher is the model's formula.
ROUNDING = 1e-6
#: What is computed may be off by so many times its rounding, seen from one step to the next: the few steps
#: do not show the worst.
SAFETY = 20.0


class Sampled(NamedTuple):
    """One function of a model, sampled.

    Attributes:
        function: its name.
        values: what it gave at the states, (N, ...).
        quantities: what it says about the equations of motion.
        quadratic: largest part [N m or N] that is no polynomial of degree two in v.
        noise: rounding error of the values: float32, or a table of ten digits, is no mistake.
        states: at which it was sampled.
    """

    function: str
    values: Array
    quantities: Quantities
    quadratic: float = 0.0
    noise: float = 0.0
    states: States | None = None

    @property
    def digits(self) -> float:
        """How good the model's arithmetic is, relative to its largest value."""
        return self.noise / max(float(np.abs(self.values).max()), 1e-300)


def sample(worker: Worker, states: States) -> dict[str, Sampled]:
    """Sample every function that a model has.

    Raises:
        ModelError: when a call goes wrong, gives another shape, NaN or infinity, or other values at the
            second time.
    """
    names = [name for name in ARGUMENTS if name in worker.functions]
    found: dict[str, Sampled] = {}
    start = worker.seconds
    for k, name in enumerate(names):
        left = max(SAMPLING - (worker.seconds - start), 0.0)
        found[name] = _sample(worker, name, states, left / (len(names) - k))
    return found


def glance(
    worker: Worker, states: States, noise: Mapping[str, float], names: Iterable[str] = ARGUMENTS
) -> dict[str, Sampled]:
    """Sample functions once: not whether they repeat themselves, nor how they round.

    Args:
        worker: the model.
        states: few of them.
        noise: rounding error of each function's values, as it was seen before.
        names: of the functions, of which those are sampled that the model has.

    Raises:
        ModelError: as :func:`sample`.
    """
    found: dict[str, Sampled] = {}
    for name in (name for name in names if name in worker.functions):
        arguments = [getattr(states, letter) for letter in ARGUMENTS[name]]
        values = call(worker, name, *arguments)
        its_quantities, rest = _quantities(worker, name, states, values)
        found[name] = Sampled(name, values, its_quantities, rest, noise.get(name, 0.0), states)
    return found


def passive_joints(worker: Worker, states: States) -> tuple[int, ...]:
    """Return the joints whose torque a forward dynamics does not read, as in an Acrobot.

    Raises:
        ModelError: as :func:`sample`.
    """
    name = "forward_dynamics"
    if name not in worker.functions:
        return ()
    few = states.first(2)
    values = call(worker, name, few.q, few.v, few.tau)
    changed = [call(worker, name, few.q, few.v, few.tau + e) for e in np.eye(few.q.shape[1])]
    return tuple(joint for joint, other in enumerate(changed) if np.array_equal(values, other))


def rows_of(sampled: Mapping[str, Sampled]) -> int:
    """Return at how many states all functions were sampled."""
    return min(len(s.values) for s in sampled.values())


def quantities(worker: Worker, name: str, states: States) -> Quantities:
    """Return the quantities that a function tells of at some states.

    Raises:
        ModelError: as :func:`sample`.
    """
    values = call(worker, name, *(getattr(states, letter) for letter in ARGUMENTS[name]))
    return _quantities(worker, name, states, values)[0]


def call(worker: Worker, function: str, *arguments: Array, shape: tuple[int, ...] | None = None) -> Array:
    """Return a function's values at rows of states, shape (rows, ...).

    Args:
        worker: the model.
        function: the name of its function.
        arguments: arrays of shape (rows, n).
        shape: shape to insist on; that of `expected_shapes` when not given.

    Raises:
        ModelError: as :func:`sample`.
    """
    n = arguments[0].shape[1]
    rows = list(zip(*arguments, strict=True))
    answers = worker.call(function, rows)
    return np.stack([_check_value(worker, function, answer, n, shape) for answer in answers])


def expected_shapes(function: str, n: int) -> tuple[tuple[int, ...], ...]:
    """Return the shapes that a function may return for n joints; the first is the one used on."""
    if function in ("mass_matrix", "coriolis_matrix"):
        return ((n, n),)
    if function in ("kinetic_energy", "potential_energy"):
        return ((), (1,), (1, 1))
    if function == "forward_kinematics":
        return ((3,), (2,), (4, 4), (3, 1), (2, 1), (1, 3), (1, 2))
    if function == "jacobian":
        return ((3, n), (6, n), (2, n))
    return ((n,), (n, 1), (1, n))


def _check_value(worker: Worker, function: str, value: Array, n: int, shape: tuple[int, ...] | None) -> Array:
    """Return a value in its plain shape, refusing other shapes, NaN and infinity."""
    allowed = (shape,) if shape is not None else expected_shapes(function, n)
    if value.shape not in allowed:
        wanted = " or ".join(str(s) for s in allowed[:3])
        joints = f"{n} joint{'s' if n > 1 else ''}"
        raise ModelError(
            worker.name, function, f"returns shape {value.shape}, expected {wanted} for {joints}"
        )
    if not np.isfinite(value).all():
        kind = "NaN" if np.isnan(value).any() else "infinity"
        raise ModelError(worker.name, function, f"returns {kind}: {np.array2string(value, precision=4)}")
    if function == "forward_kinematics":
        return value[:3, 3] if value.shape == (4, 4) else value.reshape(-1)
    return value.reshape(allowed[0] if math.prod(allowed[0]) == value.size else value.shape)


def _sample(worker: Worker, name: str, states: States, seconds: float) -> Sampled:
    """Sample one function at the states and at what its quantities need.

    Args:
        worker: the model.
        name: the function.
        states: all of them; a slow function is sampled at the first ones.
        seconds: time of the processor that is left for it [s], where `FEW` configurations take longer.
    """
    arguments = [getattr(states, letter) for letter in ARGUMENTS[name]]
    call(worker, name, *(x[:1] for x in arguments))  # to see how long it takes
    n = states.q.shape[1]
    # Calls for a function of q; of q and v; of q, v and a: even and odd parts of every product.
    per_configuration = {1: 2, 2: 2 + n * (n + 5) // 2, 3: 3 + n * (n + 7) // 2}[len(arguments)]
    rows = len(states.q)
    each = worker.takes.get(name, 0.0)
    if each * per_configuration * rows > BUDGET:
        rows = max(FEWEST, int(BUDGET / (each * per_configuration)))
    computing = worker.uses.get(name, 0.0) * per_configuration
    if computing * rows > COMPUTING:
        rows = min(rows, max(FEW, int(COMPUTING / computing)))
    if computing * rows > seconds:
        rows = min(rows, max(FEWEST, int(seconds / computing)))
    few = states.first(rows)
    of_rows = [x[:rows] for x in arguments]
    values = call(worker, name, *of_rows)
    found, rest = _quantities(worker, name, few, values)
    again = call(worker, name, *of_rows)
    away = float(np.abs(again - values).max())
    largest = float(np.abs(values).max())
    if away > REPEATABLE * max(1e-300, largest):
        text = f"is not deterministic: two calls at the same state differ by {away:.3g}"
        raise ModelError(worker.name, name, text)
    # A slow model gets no benefit of the doubt.
    noise = _noise(worker, name, few) if each * 5 * _ROUGH < BUDGET else 0.0
    if noise > ROUNDING * largest:
        noise = 0.0  # that is no rounding but the model's formula
    return Sampled(name, values, found, rest, noise, few)


def _noise(worker: Worker, name: str, s: States) -> float:
    """Return how rough a function is: fourth differences over tiny steps, which smooth functions lack."""
    rows = s.first(_ROUGH)
    along = _STEP * rows.v / np.linalg.norm(rows.v, axis=1, keepdims=True)
    others = [getattr(rows, letter) for letter in ARGUMENTS[name][1:]]
    values = [call(worker, name, rows.q + k * along, *others) for k in range(5)]
    weights = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
    fourth_differences = np.tensordot(weights, np.stack(values), 1)
    return float(np.abs(fourth_differences).max() / np.linalg.norm(weights))


#: Functions that are a quantity themselves.
_DIRECT = {"mass_matrix": "D", "gravity": "G", "forward_kinematics": "F", "jacobian": "J"}


def _quantities(worker: Worker, name: str, s: States, values: Array) -> tuple[Quantities, float]:
    """Return the quantities that a function contains, and how far it is from quadratic in v."""
    if name in _DIRECT:
        return {_DIRECT[name]: values}, 0.0
    if name == "potential_energy":
        return {"V": values - values[0]}, 0.0
    if name == "kinetic_energy":
        D = 2.0 * _polar(lambda v: call(worker, name, s.q, v)[:, np.newaxis], s.q.shape)[:, 0]
        away = values - 0.5 * np.einsum("Ni,Nij,Nj->N", s.v, D, s.v)
        return {"D": D}, float(np.abs(away).max())
    if name in ("coriolis_torque", "coriolis_matrix"):
        at_v = torque_of(values, s.v)
        return _velocity_quantities(lambda v: torque_of(call(worker, name, s.q, v), v), s, at_v)
    rest = np.zeros_like(s.q)
    # At rest, without an acceleration or torque, and then with a unit one of every joint.
    still = call(worker, name, s.q, rest, rest)
    D = np.stack([call(worker, name, s.q, rest, e) - still for e in _units(s.q)], axis=-1)
    if name == "inverse_dynamics":
        G, at_v = still, values - still - np.einsum("Nij,Nj->Ni", D, s.a)

        def torque(v: Array) -> Array:
            return call(worker, name, s.q, v, rest) - G

    else:
        try:
            D = np.asarray(np.linalg.inv(D), dtype=np.float64)
        except np.linalg.LinAlgError:
            return {"A": values}, 0.0  # some torque moves nothing, so there is no D to compare
        G = -np.einsum("Nij,Nj->Ni", D, still)
        at_v = s.tau - np.einsum("Nij,Nj->Ni", D, values) - G

        def torque(v: Array) -> Array:
            return np.asarray(-np.einsum("Nij,Nj->Ni", D, call(worker, name, s.q, v, rest)) - G)

    found, away = _velocity_quantities(torque, s, at_v)
    return {"D": D, "G": G, **found}, away


def torque_of(values: Array, v: Array) -> Array:
    """Return C v, shape (N, n), from C (N, n, n) or from itself."""
    return np.einsum("Nij,Nj->Ni", values, v) if values.ndim == 3 else values


def _units(q: Array) -> list[Array]:
    """Return for every joint the rows of its unit vector."""
    return [np.broadcast_to(e, q.shape) for e in np.eye(q.shape[1])]


def _velocity_quantities(
    function: Callable[[Array], Array], s: States, at_v: Array
) -> tuple[Quantities, float]:
    """Return H, B and Z of a torque that depends on v, and how far it is from such a polynomial."""
    known: dict[bytes, Array] = {}

    def at(v: Array) -> Array:
        key = v.tobytes()
        if key not in known:
            known[key] = function(v)
        return known[key]

    Z = at(np.zeros_like(s.q))
    # Even and odd parts in v: the products of velocities, and what is linear (friction).
    H = _polar(lambda v: 0.5 * (at(v) + at(-v)) - Z, s.q.shape)
    odd_parts = [0.5 * (at(e) - at(-e)) for e in _units(s.q)]
    B = np.stack(odd_parts, axis=-1)
    linear = np.einsum("Nij,Nj->Ni", B, s.v)
    quadratic = np.einsum("Nijk,Nj,Nk->Ni", H, s.v, s.v)
    away = at_v - Z - linear - quadratic
    return {"H": H, "B": B, "Z": Z}, float(np.abs(away).max())


def _polar(form: Callable[[Array], Array], shape: tuple[int, ...]) -> Array:
    """Return the symmetric matrices of a quadratic form (N, m) of velocities: (N, m, n, n)."""
    n = shape[1]
    units = [np.broadcast_to(e, shape) for e in np.eye(n)]
    # Polarisation: f(e_j + e_k) - f(e_j) - f(e_k) is twice the entry j, k.
    own = [form(e) for e in units]
    H = np.empty((*own[0].shape, n, n))
    for j in range(n):
        H[..., j, j] = own[j]
        for k in range(j):
            together = form(units[j] + units[k])
            H[..., j, k] = 0.5 * (together - own[j] - own[k])
            H[..., k, j] = H[..., j, k]
    return H


def slopes(worker: Worker, function: str, q: Array, step: float) -> Array:
    """Return derivatives of a function of q alone, by central differences of order four, (N, ..., n).

    Raises:
        ModelError: as :func:`sample`.
    """

    def at(offset: Array) -> Array:
        return call(worker, function, q + offset)

    columns = []
    for e in np.eye(q.shape[1]):
        near, far = (at(step * k * e) - at(-step * k * e) for k in (1, 2))
        columns.append((8.0 * near - far) / (12.0 * step))
    return np.stack(columns, axis=-1)
