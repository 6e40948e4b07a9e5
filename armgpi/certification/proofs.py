"""The numbers of an arm, proved: branch and bound over cells of configurations.

Each number is the largest norm of ``D(q)^-1/2 X(q) D(q)^-1/2``, or a length in the metric of D(q), with D and
X matrices of trigonometric polynomials. "At most x" is then a linear matrix inequality of D and X, so where
it holds at the corners of a hull of both (:mod:`armgpi.certification.trigonometric`), it holds in the whole
cell. The cell whose bound is the largest is halved, along the joint in which the values bend most, until all
are near the largest value that was seen or the time is over: what is known of all cells then is the bound.

The arithmetic is that of double precision; every bound is raised by :data:`OUTWARD` of itself, which is far
more than rounding does to it (tested).
"""

from __future__ import annotations

import heapq
import itertools
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array
from armgpi.certification.quantities import (
    MARGIN,
    TINY,
    Number,
    Numbers,
    Progress,
    Setting,
    at_ends,
    between_ends,
    corners,
    norms,
)
from armgpi.certification.trigonometric import Cell, Polynomial, pieces, polynomials_of, stack_polynomials

#: Share by which every bound is raised.
OUTWARD = 1e-6
#: How far above the largest value that was seen a bound is that uses the metric of a cell's center.
_LOOSE = 0.5
#: How many times the largest value that was seen a bound may be: with a looser one little is certified.
_WORTH = 8.0
#: Share of a joint's width in the choice of what to split, where nothing else tells.
_EVEN = 1e-6


class Model(NamedTuple):
    """D and G of a true arm, D of the nominal model and G of that of the feedforward."""

    D: Polynomial
    G: Polynomial
    D_nominal: Polynomial
    G_known: Polynomial


class Bounds(NamedTuple):
    """What is known of some members of a quantity in a cell.

    Attributes:
        upper: at most this there; infinite for nothing, shape (members,).
        seen: the largest values where they exceed what was asked about, or less, shape (members,).
        joint: along which to halve the cell; None for where the values bend most.
    """

    upper: Array
    seen: Array
    joint: int | None = None


class Quantity(ABC):
    """What is bounded: several members, of which each has a bound, or all together one.

    Attributes:
        polynomials: what its values are made of, the metric first.
        members: how many there are.
        together: whether they share a bound.
    """

    polynomials: tuple[Polynomial, ...]
    members: int = 1
    together: bool = True

    @property
    def margin(self) -> Array:
        """By how much larger than a cell is what is looked at [rad or m], shape (n,)."""
        return np.zeros(len(self.polynomials[0].center))

    def places(self, which: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
        """Return where the bounds on some members are."""
        return np.zeros(len(which), int) if self.together else which

    @abstractmethod
    def bounds(self, cell: Cell, which: npt.NDArray[np.intp], x: Array) -> Bounds:
        """Return bounds on some members in a cell, exact where they exceed x."""


def prove_numbers(
    setting: Setting, tolerance: float = 0.1, budget: float = 30.0, progress: Progress = lambda _: None
) -> Numbers:
    """Return the numbers of an arm, each proved, or searched where a budget leads to no bound of use.

    Args:
        setting: what they are taken over.
        tolerance: how near to the largest value seen a bound is near enough, as a share.
        budget: processor time for each number [s]; more makes bounds tighter until all are near enough.
        progress: called with what is being done.

    Raises:
        ParameterError: when D and G are no trigonometric polynomials of degree two.
    """
    made = at_ends(setting, progress=progress)
    prover = _Prover(setting, tolerance, budget, progress)
    found = between_ends(setting, made._replace(**prover.of_motion(made)))
    return found._replace(**prover.of_torques(found), **prover.of_inputs(found))


class _Prover:
    """What the numbers of one setting are proved with."""

    def __init__(
        self, setting: Setting, tolerance: float, budget: float, progress: Progress = lambda _: None
    ) -> None:
        self.setting, self.tolerance, self.budget = setting, tolerance, budget
        self.progress, self.proofs = progress, 0
        self.star = (setting.upper - setting.lower) / 2
        self.around = self.star + setting.radius
        center = (setting.lower + setting.upper) / 2
        *arms, nominal, known = polynomials_of([*setting.arms, setting.nominal, setting.known], center)
        self.models = [Model(*arm, nominal[0], known[1]) for arm in arms]

    def each(
        self,
        found: Sequence[Number],
        quantities: Sequence[Quantity],
        half: Array | None = None,
        tolerance: float | None = None,
    ) -> tuple[Number, ...]:
        """Return bounds where they are proved in time, or else what a search found."""
        near = np.maximum([each.value for each in found], TINY) / (1.0 + MARGIN)
        half = self.around if half is None else half
        tolerance = self.tolerance if tolerance is None else tolerance
        self.proofs += 1
        said = f"proof {self.proofs}: {{:.0f}} of {self.budget:g} s at most"

        def spent(seconds: float) -> None:
            self.progress(said.format(seconds))

        bounds = largest(quantities, half, near, tolerance, self.budget, spent)
        return tuple(
            Number((1.0 + OUTWARD) * float(bound), "proved") if np.isfinite(bound) else number
            for bound, number in zip(bounds, found, strict=True)
        )

    def number(
        self, found: Number, quantity: Callable[[Model], Quantity], tolerance: float | None = None
    ) -> Number:
        """Return a bound on a number of all true arms; see :meth:`each`."""
        return self.each([found], [quantity(m) for m in self.models], tolerance=tolerance)[0]

    def of_motion(self, made: Numbers) -> dict[str, Any]:
        """Return what the matrix inequality takes: delta, what motion and gravity add, and D^-1."""
        v, first = corners(self.setting.speed), self.models[-1]
        low = Number(1.0, "proved")
        # Loads add to D, so the nominal model with the heaviest one is at least the true D.
        if not np.array_equal(first.D.coefficients, first.D_nominal.coefficients):
            above = self.number(_reciprocal(made.delta_low), lambda m: Norm(m.D_nominal, _one(m.D)))
            low = _reciprocal(above)
        sigma = self.number(made.sigma, lambda m: Norm(m.D, _slopes(m.D), v))
        axes = [x._replace(value=math.sqrt(x.value)) for x in made.inverse]
        made_of = [Lengths(m.D, _axes(m.D), together=False) for m in self.models]
        lengths = self.each(axes, made_of, tolerance=math.sqrt(1.0 + self.tolerance) - 1.0)
        return {
            "delta_low": low,
            "delta_high": self.number(made.delta_high, lambda m: Norm(m.D, _one(m.D_nominal))),
            "sigma": sigma,
            "kappa_v": self.number(made.kappa_v, lambda m: Norm(m.D, _christoffel(m.D), v)),
            "kappa_e": self.stiffness(made.kappa_e, sigma, lambda m: m.G),
            "kappa_f": self.rubbing(made.kappa_f),
            "kappa_g": self.number(made.kappa_g, lambda m: Norm(m.D, _one(_gradient(m.G)))),
            "inverse": tuple(x._replace(value=x.value**2) for x in lengths),
            "sigma_error": self.number(made.sigma_error, lambda m: Unfolded(m.D, _slopes(m.D)), _LOOSE),
            "kappa_error": self.number(made.kappa_error, lambda m: Unfolded(m.D, _christoffel(m.D)), _LOOSE),
        }

    def rubbing(self, found: Number) -> Number:
        """Return a bound on what viscous friction adds."""
        if not self.setting.viscous.any():
            return found
        F = np.diag(self.setting.viscous)[None]
        return self.number(found, lambda m: Norm(m.D, _constant(m.D, F)))

    def grown(self, sigma: Number) -> float:
        """Return by what factor D grows at most between the arm and its reference."""
        return math.exp(float(np.max(self.setting.radius / self.setting.speed)) * sigma.value)

    def stiffness(self, found: Number, sigma: Number, torque: Callable[[Model], Polynomial]) -> Number:
        """Return an upper bound on how a torque and D^ v* change with the position; see :class:`Stiffness`.

        Args:
            found: the number that a search found, which is returned where sigma is not proved.
            sigma: the largest rate at which D changes at the stated speed [1/s].
            torque: the torque of a model, such as its gravity.
        """
        if sigma.status != "proved":
            return found
        # The share of D that is left at least after twice the radius, as D shrinks no faster than by sigma.
        share = math.exp(-2.0 * float(np.max(self.setting.radius / self.setting.speed)) * sigma.value)
        made = [Stiffness(m, self._residual(m), torque(m), self.setting.radius, share) for m in self.models]
        return self.each([found], made, self.star)[0]

    def of_torques(self, found: Numbers) -> dict[str, Any]:
        """Return what the motors must give, and what a jump of the load does, from what is proved of D."""
        low, high, n = found.delta_low, found.delta_high, len(self.star)
        nominal = self.models[0].D_nominal
        light = self._residual(self.models[0])
        heavy = self._residual(self.models[-1])
        changed = light._replace(coefficients=heavy.coefficients - light.coefficients)
        # The length of v* in the metric of D^, and of its change between the loads.
        jump, length_light, length_heavy = (
            self.each([Number(0.0)], [Lengths(nominal, _one(each))], self.star)[0]
            for each in (changed, light, heavy)
        )
        if any(each.status != "proved" for each in (jump, length_light, length_heavy)):
            return {}  # what a search found
        length = max(length_light.value, length_heavy.value)
        largest_v = length * np.sqrt([each.value / low.value for each in found.inverse])
        # Torques that hold the arm: gravity, and by how much D^ v* changes within the radius.
        gravity = [Sizes(m.G, np.eye(n), together=False) for m in self.models]
        held = self.each(found.hold, gravity, self.star)
        slopes = most(_slopes(nominal), self.around)
        more = np.einsum("k,kij,j->i", self.setting.radius, slopes, largest_v)
        hold = []
        for torque, change in zip(held, more, strict=True):
            proved_of = (torque, low, length_light, length_heavy, *found.inverse)
            hold.append(_from(torque.value + float(change), *proved_of))
        # Torques per acceleration: the diagonal of D^, whose squares are bounded.
        diagonal = nominal.map_values(lambda c: c[:, range(n), range(n)])
        begin = [x._replace(value=x.value**2) for x in found.reach]
        squares = self.each(begin, [Sizes(diagonal, np.eye(n), together=False)])
        reach = [_from(math.sqrt(x.value) * math.sqrt(high.value), x, high) for x in squares]
        jumped = found.jump
        if self.setting.arms[0] is not self.setting.arms[-1]:
            # D is that of the arm, D^ that of the reference.
            size = jump.value * math.sqrt(self.grown(found.sigma) / low.value)
            jumped = _from(size, jump, low, found.sigma)
        return {"jump": jumped, "hold": tuple(hold), "reach": tuple(reach)}

    def of_inputs(self, found: Numbers) -> dict[str, Any]:
        """Return how large what disturbs is."""
        setting, low = self.setting, found.delta_low
        made = {}
        for name in ("torque", "friction"):
            if (bound := getattr(setting, name)).any():
                ends = corners(bound)
                made[name] = self.number(
                    getattr(found, name),
                    lambda m, v=ends: Lengths(m.D, _constant(m.D, v)),  # type: ignore[misc]
                )
        for name in ("velocity", "acceleration", "encoder", "zone"):
            if (bound := getattr(setting, name)).any():
                ends = corners(bound)
                squares = (ends[:, :, None] * ends[:, None]).reshape(len(ends), -1)
                square = getattr(found, name)
                square = self.number(
                    square._replace(value=square.value**2),
                    lambda m, v=squares: Sizes(m.D, v),  # type: ignore[misc]
                )
                made[name] = square._replace(value=math.sqrt(square.value))
        if setting.velocity.any():
            stiffness = found.kappa_e
            if setting.feedforward != "none":
                stiffness = self.stiffness(found.kappa_e, found.sigma, self._residual)
            moved = made["velocity"]
            size = stiffness.value * moved.value * self.grown(found.sigma) / low.value
            made["shift"] = _from(size, stiffness, moved, low, found.sigma)
        return made

    def _residual(self, model: Model) -> Polynomial:
        """Return D^ v*: what the feedforward holds, v* does not."""
        if self.setting.feedforward == "none":
            return model.G
        return model.G._replace(coefficients=model.G.coefficients - model.G_known.coefficients)


def _reciprocal(number: Number) -> Number:
    """Return one over a number."""
    return number._replace(value=1.0 / number.value)


def _from(value: float, *used: Number) -> Number:
    """Return a number that follows from others."""
    proven = all(each.status == "proved" for each in used)
    return Number((1.0 + OUTWARD) * value, "proved" if proven else "searched")


class _Waiting(NamedTuple):
    """A cell that is to be halved, in the order of a heap: the one with the loosest bound is the first.

    Attributes:
        share: minus the largest bound over what is wanted.
        order: of arrival.
        quantity: that is bounded.
        cell: in which.
        which: members of the quantity.
        upper: their bounds in it.
        joint: along which to halve it; None for where the values bend most.
    """

    share: float
    order: int
    quantity: Quantity
    cell: Cell
    which: npt.NDArray[np.intp]
    upper: Array
    joint: int | None


class _Search:
    """Branch and bound of the best first: at any time the bounds of all that waits are bounds of the whole.

    Attributes:
        seen: about the maxima, or less.
        waiting: cells with bounds that are not as near to them as wanted, a heap.
    """

    def __init__(self, near: Array, tolerance: float) -> None:
        self.seen, self.waiting = np.array(near), list[_Waiting]()
        self._share, self._arrived = 1.0 + tolerance, itertools.count()

    def look(self, quantity: Quantity, cell: Cell, which: npt.NDArray[np.intp]) -> None:
        """Bound some members of a quantity in a cell."""
        at = quantity.places(which)
        known = quantity.bounds(cell, which, self._share * self.seen[at])
        np.maximum.at(self.seen, at, known.seen)
        upper = np.where(np.isnan(known.upper), np.inf, known.upper)  # NaN proves nothing
        shares = upper / (self._share * self.seen[at])
        if (left := shares > 1.0).any():
            order = -float(shares.max()), next(self._arrived)
            heapq.heappush(
                self.waiting, _Waiting(*order, quantity, cell, which[left], upper[left], known.joint)
            )

    def halve(self) -> None:
        """Bound what waits first in the halves of its cell."""
        _, _, quantity, cell, which, upper, joint = heapq.heappop(self.waiting)
        left = which[upper > self._share * self.seen[quantity.places(which)]]
        if len(left):
            for half in cell.halves(_most_curved_joint(cell) if joint is None else joint):
                self.look(quantity, half, left)

    def bounds(self) -> Array:
        """Return bounds on all members."""
        most = self._share * self.seen
        for each in self.waiting:
            np.maximum.at(most, each.quantity.places(each.which), each.upper)
        return most


def largest(
    quantities: Sequence[Quantity],
    half: Array,
    near: Array,
    tolerance: float,
    budget: float,
    spent: Callable[[float], None] = lambda _: None,
) -> Array:
    """Return bounds on the largest values of a quantity's members, of all quantities together.

    Args:
        quantities: what is bounded, with the same members each.
        half: half the widths of the box around the center of their polynomials [rad or m], shape (n,).
        near: about the maxima, or less; shape (members,), or (1,) for members together.
        tolerance: how far above the largest value seen a bound need not be, as a share.
        budget: processor time [s]; bounds are looser when it is over, or infinite.
        spent: called with how much of it is.
    """
    end = time.process_time() + budget
    search = _Search(near, tolerance)
    for quantity in quantities:
        for whole in pieces(quantity.polynomials, half, quantity.margin):
            if time.process_time() > end:
                return np.full(len(near), np.inf)
            search.look(quantity, whole, np.arange(quantity.members))
    while search.waiting and (left := end - time.process_time()) > 0.0:
        spent(budget - left)
        search.halve()
    bounds = search.bounds()
    return np.where(bounds > _WORTH * search.seen, np.inf, bounds)


def most(polynomial: Polynomial, half: Array) -> Array:
    """Return bounds on the magnitudes of a polynomial in a box, of its shape."""
    found = np.zeros(polynomial.shape)
    for cell in pieces([polynomial], half, 0.0 * half):
        (hull,) = _flat(cell)
        found = np.maximum(found, np.abs(hull).max(axis=0) + cell.piece.beyond[0])
    return found


def _flat(cell: Cell) -> list[Array]:
    """Return the hulls of a cell, the corners one after the other: (corners, *shape)."""
    joints = len(cell.half)
    return [each.reshape(-1, *each.shape[joints:]) for each in cell.hull()]


def _ends(cell: Cell) -> npt.NDArray[np.bool_]:
    """Return which corners of the hull are configurations: those with an end for each joint."""
    ends = np.zeros(cell.piece.table.shape[:-1], bool)
    ends[tuple(slice(None, None, 2) for _ in cell.half)] = True
    return ends.ravel()


def _weights(cell: Cell) -> tuple[Array, Array]:
    """Return weights of the hull's corners for how values change along each joint, shape (n, corners) each.

    They give half the difference of the means at its ends, and that of the apex and both.
    """
    sizes = cell.piece.table.shape[:-1]
    axes = [np.linspace(-1.0, 1.0, size) if size > 1 else np.zeros(1) for size in sizes]
    place = np.stack([each.ravel() for each in np.meshgrid(*axes, indexing="ij")])
    each = place.shape[1] / 3.0
    enters = np.array(sizes)[:, None] > 1
    return place / (2.0 * each), enters * np.where(place, -0.5, 1.0) / each


def _most_curved_joint(cell: Cell) -> int:
    """Return the joint along which the values in a cell bend most: the one that a cell is cut along.

    How much they bend is their second difference along the joint, the middle less both ends, as a share of
    the largest value of its kind. Of joints along which nothing bends it is the one with the widest range.
    """
    _, second_difference = _weights(cell)
    bends = _EVEN * cell.half
    for values in _flat(cell):
        size = np.abs(values).max(axis=0)
        size = np.maximum(size, max(1e-3 * size.max(), TINY))
        shares = (values / size).reshape(len(values), -1)
        bends = bends + np.linalg.norm(second_difference @ shares, axis=1)
    return int(np.argmax(bends))


def _roots(D: Array, beyond: Array) -> Array | None:
    """Return L^-1 of matrices D = L L^T less what may be beyond them; None where they are not positive."""
    size = np.sqrt(np.abs(np.diagonal(D[0])))
    less = np.sum(beyond * size[:, None] / size, axis=1)
    try:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(D - np.diag(less))))
    except np.linalg.LinAlgError:
        return None


def _normal(root: Array, X: Array) -> Array:
    """Return L^-1 X L^-T, matrices (k, n, n) for X of shape (k, ..., n, n)."""
    root = root.reshape(len(root), *(1 for _ in X.shape[3:]), *root.shape[1:])
    return np.asarray(root @ X @ root.swapaxes(-1, -2))


def _error(root: Array, beyond: Array) -> Array:
    """Return bounds on the norms of L^-1 E L^-T for all ``|E| <= beyond``, shape (k,)."""
    away = np.abs(root)
    return np.asarray(np.linalg.norm(away @ beyond @ away.swapaxes(-1, -2), axis=(-2, -1)))


def _sizes(X: Array) -> Array:
    """Return bounds on :func:`norms`, at most n^(1/8) times them and in a tenth of the time."""
    squares = X.swapaxes(-1, -2) @ X
    return np.asarray(np.sum((squares @ squares) ** 2, axis=(-2, -1)) ** 0.125)


def _nothing(count: int) -> Bounds:
    """Return what is known where D is not positive at all corners."""
    return Bounds(np.full(count, np.inf), np.zeros(count))


class Norm(Quantity):
    """The largest norm of D^-1/2 X D^-1/2, with X the sum of some matrices times given weights."""

    def __init__(self, D: Polynomial, X: Polynomial, weights: Array | None = None) -> None:
        """Take D, matrices X (m, n, n) and weights of them (w, m): all ones when not given."""
        self.polynomials = (D, X)
        self.weights = np.ones((1, X.shape[0])) if weights is None else weights
        self.members = len(self.weights)

    def bounds(self, cell: Cell, which: npt.NDArray[np.intp], x: Array) -> Bounds:
        """Return what is known of some weights in a cell."""
        (D, X), (less, beyond), weights = _flat(cell), cell.piece.beyond, self.weights[which]
        root = _roots(D, less)
        if root is None:
            return _nothing(len(which))
        values = np.tensordot(weights, _normal(root, X), axes=(1, 1))
        error = _error(root, np.max(np.tensordot(np.abs(weights), beyond, axes=1), axis=0))
        upper = _sizes(values) + error
        far = upper > x[:, None]
        upper[far] = norms(values[far]) + np.broadcast_to(error, upper.shape)[far]
        seen = np.where(far, upper, 0.0)[:, _ends(cell)].max(axis=1)
        return Bounds(upper.max(axis=1), seen)


class Lengths(Quantity):
    """The largest lengths of some vectors in the metric of D^-1."""

    def __init__(self, D: Polynomial, vectors: Polynomial, together: bool = True) -> None:
        """Take D, and vectors (m, n)."""
        self.polynomials, self.members, self.together = (D, vectors), vectors.shape[0], together

    def bounds(self, cell: Cell, which: npt.NDArray[np.intp], x: Array) -> Bounds:
        """Return what is known of some vectors in a cell."""
        (D, vectors), (less, beyond) = _flat(cell), cell.piece.beyond
        root = _roots(D, less)
        if root is None:
            return _nothing(len(which))
        turned = root @ vectors[:, which].swapaxes(1, 2)
        upper = np.linalg.norm(turned, axis=1).T
        upper += np.linalg.norm(np.abs(root) @ beyond[which].T, axis=1).T
        return Bounds(upper.max(axis=1), upper[:, _ends(cell)].max(axis=1))


class Sizes(Quantity):
    """The largest magnitudes of weighted sums of the entries of a polynomial."""

    def __init__(self, P: Polynomial, weights: Array, together: bool = True) -> None:
        """Take a polynomial, and weights of its entries (w, entries)."""
        self.polynomials, self.weights = (P,), weights
        self.members, self.together = len(weights), together

    def bounds(self, cell: Cell, which: npt.NDArray[np.intp], x: Array) -> Bounds:
        """Return what is known of some sums in a cell."""
        (entries,), weights = _flat(cell), self.weights[which]
        upper = np.abs(weights @ entries.reshape(len(entries), -1).T)
        upper += np.abs(weights) @ cell.piece.beyond[0].reshape(-1, 1)
        return Bounds(upper.max(axis=1), upper[:, _ends(cell)].max(axis=1))


def _beside(X: Array) -> Array:
    """Return at least the norms of sums of X_k u_k over vectors u of length 1, X of shape (m, n, n, n).

    It is the norm of the matrices beside each other, shape (m,).
    """
    wide = X.swapaxes(1, 2).reshape(*X.shape[:2], -1)
    return np.asarray(np.sqrt(np.linalg.eigvalsh(wide @ wide.swapaxes(1, 2))[:, -1]))


def _in_all(X: Array, *along: Array) -> Array:
    """Return a table with a matrix applied along each of its last axes."""
    for axis, matrix in zip(range(-len(along), 0), along, strict=True):
        X = np.moveaxis(np.moveaxis(X, axis, -1) @ matrix.T, -1, axis)
    return X


class Unfolded(Quantity):
    """At least the largest norm of the sum of u_k X_k over velocities u of length 1, all in the metric of D.

    The velocities are those of length 1 in the metric of the cell's center, made longer.
    """

    def __init__(self, D: Polynomial, X: Polynomial) -> None:
        """Take D and matrices X (n, n, n), one for each joint's velocity."""
        self.polynomials = (D, X)

    def bounds(self, cell: Cell, which: npt.NDArray[np.intp], x: Array) -> Bounds:
        """Return what is known in a cell."""
        (D, X), (less, beyond), (middle, there) = _flat(cell), cell.piece.beyond, cell.middle()
        root, center = _roots(D, less), _roots(middle[None], less)
        if root is None or center is None:
            return _nothing(1)
        one = np.eye(len(less))
        upper = _beside(_normal(root, _in_all(X, center[0], one, one)))
        for each, length in zip(beyond, np.linalg.norm(center[0], axis=0), strict=True):
            upper += length * _error(root, each)
        # D is at least this share of D at the center.
        inverses = np.asarray(root @ np.linalg.cholesky(middle))  # the squared norm is that of (L L^T)^-1 D
        share = 1.0 / norms(inverses).max() ** 2
        seen = _beside(_in_all(there[None], *[center[0]] * 3))
        return Bounds(np.array([upper.max() / math.sqrt(share)]), seen)


class _Solved(NamedTuple):
    """Where e with D^ e = r is in a cell: a sum of -1 to 1 times each of some vectors, and of one in a ball.

    Attributes:
        along: the vectors, one for each joint, shape (n, n).
        ball: the ball's radius.
        length: a bound on the length of e.
    """

    along: Array
    ball: float
    length: float

    @classmethod
    def of(cls, odd: Array, base: Array, nominal: Array, r: Array, loose: Array, beyond: Array) -> _Solved:
        """Take the hull's odd weights, and values of D^, with roots, and of r, with what is beyond them."""
        most, inner = norms(base).max(), float(np.linalg.norm(beyond))
        length = most * (np.linalg.norm(base @ r[..., None], axis=(1, 2)).max() + most * inner)
        along = odd @ r
        inner += np.linalg.norm(r - np.sign(odd.T) @ along, axis=1).max()
        # e = r + (1 - D^) e
        away, error = np.eye(len(beyond)) - nominal, float(np.linalg.norm(loose))
        loss = _sizes(away).max() + error
        turned = np.linalg.norm(away @ along.T, axis=1).sum(axis=1).max()
        turned += error * np.linalg.norm(along, axis=1).sum() + loss * (inner + loss * length)
        return cls(along, inner + min(loss * length, turned), length)


class _InMetrics(NamedTuple):
    """Values of the polynomials of :class:`Stiffness` in a cell, or what is beyond, in the metrics there.

    Values have the corners of the hull and then the cell's center as their first axis; what is beyond has
    none.

    Attributes:
        D: the arm's inertia.
        nominal: D^, the model's inertia.
        held: what D^ v* is.
        torque: gradient of the torque.
        held_slope: gradient of `held`.
        rates: dD^/dq_j, with j in between.
        M: the same, as d(D^ e_k)/dq.
        moves: partial derivatives of D.
    """

    D: Array
    nominal: Array
    held: Array
    torque: Array
    held_slope: Array
    rates: Array
    M: Array
    moves: Array

    def corners(self) -> _InMetrics:
        """Return the values at the corners."""
        return _InMetrics(*(values[:-1] for values in self))

    def center(self) -> _InMetrics:
        """Return the values at the center."""
        return _InMetrics(*(values[-1] for values in self))


class Stiffness(Quantity):
    """The largest norm of D^-1/2 K D^-1/2 with K = d(torque - D^ v*)/dq and v* = D^^-1 held at a reference.

    D is taken at one configuration near the reference, K at another one. With v* = v + e, r = held - D^ v,
    M = dD^/dq and N = M at a cell's center: D^ e = r, so M e = N r + W e with W = M - N D^, which is zero at
    the center in coordinates in which D^ is 1 there. So ``K = torque' - M v - N r - W e`` is in the hull of
    its values for any e, and the last term is of second order.
    """

    def __init__(
        self, model: Model, held: Polynomial, torque: Polynomial, radius: Array, share: float
    ) -> None:
        """Take the models, what v* holds, the torque, and how far from the reference D and K may be.

        D is at least a share of D at a place within twice that radius.
        """
        # d(D^ e_k)/dq for every joint k.
        moves = _slopes(model.D_nominal).map_values(lambda c: c.transpose(0, 3, 2, 1))
        gradients = _gradient(torque), _gradient(held)
        self.polynomials = (model.D, model.D_nominal, held, *gradients, moves, _slopes(model.D))
        self.radius, self.share = radius, share

    @property
    def margin(self) -> Array:
        """How far D and K may be from the reference."""
        return self.radius

    def bounds(self, cell: Cell, which: npt.NDArray[np.intp], x: Array) -> Bounds:
        """Return what is known in a cell of references."""
        known = self._in_metrics(cell)
        if known is None:
            return _nothing(1)
        values, beyond = known
        at, center = values.corners(), values.center()
        base = _roots(at.nominal, beyond.nominal)
        if base is None:
            return _nothing(1)
        odd, even = _weights(cell)
        # v and N as in the docstring of the class; v* = v + e, with D^ e = r.
        v, N = center.held, center.M
        r = at.held - at.nominal @ v
        r_more = beyond.held + beyond.nominal @ np.abs(v)
        e = _Solved.of(odd, base, at.nominal, r, beyond.nominal, r_more)
        # torque' - M v - N r
        K = at.torque - np.tensordot(v, at.M, axes=(0, 1)) - np.tensordot(r, N, axes=1)
        K_more = beyond.torque + np.tensordot(np.abs(v), beyond.M, axes=1)
        K_more += np.tensordot(r_more, np.abs(N), axes=1)
        # M - N D^
        W = at.M - np.tensordot(at.nominal, N, axes=1)
        W_more = np.linalg.norm(beyond.M + np.tensordot(beyond.nominal, np.abs(N), axes=1))
        more = float(np.linalg.norm(K_more)) + e.length * float(W_more)
        slopes = at.held_slope, at.rates
        slopes_more = beyond.held_slope, beyond.rates
        more += self._apart(N, v, e.length, slopes, slopes_more)
        upper = self._upper(_roots(self.share * at.D, self.share * beyond.D), K, W, e, more, x[0])
        if upper > x[0]:
            root = self._apart_root(at.D, beyond.D, values.moves, beyond.moves)
            upper = min(upper, self._upper(root, K, W, e, more, x[0]))
        seen = norms((center.torque - np.tensordot(v, N, axes=1))[None])
        # The cell is cut along the joint that adds most to what is of second order.
        along_joints = np.tensordot(np.tensordot(odd, W, axes=1), e.along, axes=(1, 1))
        pairs = np.linalg.norm(along_joints, axis=(1, 2))
        bends = np.linalg.norm(np.tensordot(even, K, axes=1), axis=(1, 2))
        bends = bends + np.linalg.norm(np.tensordot(even, seen * at.D, axes=1), axis=(1, 2))
        bends = bends + pairs.sum(axis=0) + pairs.sum(axis=1) + _EVEN * cell.half
        return Bounds(np.array([upper]), seen, int(np.argmax(bends)))

    @staticmethod
    def _upper(root: Array | None, K: Array, W: Array, e: _Solved, more: float, x: float) -> float:
        """Return a bound on the norm of K - W e and `more`, in a metric with these roots at the corners."""
        if root is None:
            return np.inf
        wide, K = _normal(root, W), _normal(root, K)
        rest = _sizes(np.tensordot(e.along, wide, axes=(1, 1))).sum(axis=0)
        rest += e.ball * _beside(wide) + more * norms(root) ** 2
        upper = _sizes(K) + rest
        far = upper > x
        upper[far] = norms(K[far]) + rest[far]
        return float(upper.max())

    def _apart_root(self, D: Array, less: Array, rates: Array, beyond: Array) -> Array | None:
        """Return the roots of D less what it may lose from K's configuration to its own; None for a lot."""
        there, away = rates[-1], 2.0 * self.radius
        more = away @ (_sizes(rates - there).max(axis=0) + np.linalg.norm(beyond, axis=(1, 2)))
        if 2.0 * more > 1.0 - self.share:
            return None
        values, vectors = np.linalg.eigh(there)
        lost = np.einsum("j,jab,jb,jcb->ac", away, vectors, np.abs(values), vectors)
        return _roots(D - lost - more * np.eye(len(lost)), less)

    def _in_metrics(self, cell: Cell) -> tuple[_InMetrics, _InMetrics] | None:
        """Return values at the corners and the center, and what is beyond them, in the metrics at the center.

        None where an inertia matrix at the center may not be positive definite.
        """
        wide = cell._replace(half=cell.half + self.radius)
        values = []
        for hull, middle in zip(_flat(wide), cell.middle(), strict=True):
            values.append(np.concatenate([hull, middle[None]]))
        beyond = [*cell.piece.beyond]
        center = _roots(values[0][-1:], beyond[0])
        base = _roots(values[1][-1:], beyond[1])
        if center is None or base is None:
            return None
        for each in values, beyond:
            each.insert(5, np.moveaxis(each[5], -3, -1))  # M once more, as dD^/dq_j
        # Of each axis the root of D (C), that of D^ (B), or none.
        C, B, one = center[0], base[0], np.eye(len(cell.half))
        metrics = [
            (C, C),  # D
            (B, B),  # nominal
            (B,),  # held
            (C, C),  # torque
            (B, one),  # held_slope
            (B, one, B),  # rates
            (B, C, C),  # M
            (one, C, C),  # moves
        ]
        inside = [_in_all(x, *roots) for x, roots in zip(values, metrics, strict=True)]
        outside = [_in_all(x, *map(np.abs, roots)) for x, roots in zip(beyond, metrics, strict=True)]
        return _InMetrics(*inside), _InMetrics(*outside)

    def _apart(
        self, N: Array, v: Array, length: float, values: Sequence[Array], beyond: Sequence[Array]
    ) -> float:
        """Return a bound on ``N D^^-1 d(held - D^ v*)``, by what the reference is away from K's place.

        Args:
            N: M at the center, (n, n, n).
            v: what is held there, (n,).
            length: of e, at most.
            values: `held_slope` and `rates` at the corners.
            beyond: the same, of what is beyond them.
        """
        slope, rates = values
        slope_more, rates_more = beyond
        changes = (slope - rates @ v).swapaxes(1, 2)
        turns = _sizes(np.tensordot(changes, N, axes=1)).max(axis=0)
        more = np.linalg.norm(slope_more + rates_more @ np.abs(v), axis=0)
        most_rates = _sizes(rates.swapaxes(1, 2)).max(axis=0) + np.linalg.norm(rates_more, axis=(0, 2))
        more += length * most_rates
        return float((turns + _beside(N[None])[0] * more) @ self.radius)


def _one(P: Polynomial) -> Polynomial:
    """Return a polynomial as the only one of several."""
    return P.map_values(lambda c: c[:, None])


def _slopes(D: Polynomial) -> Polynomial:
    """Return the partial derivatives of D, shape (n, n, n), the joint first."""
    return stack_polynomials([D.derivative(j) for j in range(len(D.center))])


def _christoffel(D: Polynomial) -> Polynomial:
    """Return the matrices C_k of C(q, v) = sum of v_k C_k, shape (n, n, n)."""

    def combine(S: Array) -> Array:
        return np.asarray(0.5 * (S + S.transpose(0, 3, 2, 1) - S.transpose(0, 3, 1, 2)))

    return _slopes(D).map_values(combine)


def _gradient(G: Polynomial) -> Polynomial:
    """Return dG_i/dq_j, shape (n, n)."""
    slopes = stack_polynomials([G.derivative(j) for j in range(len(G.center))])
    return slopes.map_values(lambda c: c.transpose(0, 2, 1))


def _constant(like: Polynomial, value: Array) -> Polynomial:
    """Return a polynomial that is a value everywhere."""
    terms = like.coefficients.shape[: len(like.center)]
    coefficients = np.zeros((*terms, *value.shape))
    coefficients[(0,) * len(terms)] = value
    return like._replace(coefficients=coefficients)


def _axes(D: Polynomial) -> Polynomial:
    """Return the n constant unit vectors, (n, n)."""
    return _constant(D, np.eye(len(D.center)))
