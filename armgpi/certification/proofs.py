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
    searched = at_ends(setting, progress=progress)
    prover = _Prover(setting, tolerance, budget, progress)
    of_motion = prover.of_motion(searched)
    numbers = between_ends(setting, searched._replace(**of_motion))
    of_torques = prover.of_torques(numbers)
    of_inputs = prover.of_inputs(numbers)
    return numbers._replace(**of_torques, **of_inputs)


class _Prover:
    """What the numbers of one setting are proved with."""

    def __init__(
        self, setting: Setting, tolerance: float, budget: float, progress: Progress = lambda _: None
    ) -> None:
        self.setting = setting
        self.tolerance = tolerance
        self.budget = budget
        self.progress = progress
        self.proofs = 0
        self.star = (setting.upper - setting.lower) / 2
        self.around = self.star + setting.radius
        center = (setting.lower + setting.upper) / 2
        robots = [*setting.arms, setting.nominal, setting.known]
        *arms, nominal, known = polynomials_of(robots, center)
        D_nominal, _ = nominal
        _, G_known = known
        self.models = [Model(*arm, D_nominal, G_known) for arm in arms]

    def each(
        self,
        found: Sequence[Number],
        quantities: Sequence[Quantity],
        half: Array | None = None,
        tolerance: float | None = None,
    ) -> tuple[Number, ...]:
        """Return bounds where they are proved in time, or else what a search found."""
        searched = [number.value for number in found]
        near = np.maximum(searched, TINY) / (1.0 + MARGIN)
        half = self.around if half is None else half
        tolerance = self.tolerance if tolerance is None else tolerance
        self.proofs += 1
        said = f"proof {self.proofs}: {{:.0f}} of {self.budget:g} s at most"

        def spent(seconds: float) -> None:
            self.progress(said.format(seconds))

        bounds = largest(quantities, half, near, tolerance, self.budget, spent)
        numbers = []
        for bound, number in zip(bounds, found, strict=True):
            proved = Number((1.0 + OUTWARD) * float(bound), "proved")
            numbers.append(proved if np.isfinite(bound) else number)
        return tuple(numbers)

    def number(
        self, found: Number, quantity: Callable[[Model], Quantity], tolerance: float | None = None
    ) -> Number:
        """Return a bound on a number of all true arms; see :meth:`each`."""
        quantities = [quantity(model) for model in self.models]
        (number,) = self.each([found], quantities, tolerance=tolerance)
        return number

    def of_motion(self, made: Numbers) -> dict[str, Any]:
        """Return what the matrix inequality takes: delta, what motion and gravity add, and D^-1."""
        v = corners(self.setting.speed)
        first = self.models[-1]
        low = Number(1.0, "proved")
        # Loads add to D, so the nominal model with the heaviest one is at least the true D.
        if not np.array_equal(first.D.coefficients, first.D_nominal.coefficients):
            searched = _reciprocal(made.delta_low)
            above = self.number(searched, lambda m: Norm(m.D_nominal, _one(m.D)))
            low = _reciprocal(above)
        sigma = self.number(made.sigma, lambda m: Norm(m.D, _slopes(m.D), v))
        inverse = self.inverse(made.inverse)
        high = self.number(made.delta_high, lambda m: Norm(m.D, _one(m.D_nominal)))
        kappa_v = self.number(made.kappa_v, lambda m: Norm(m.D, _christoffel(m.D), v))
        kappa_e = self.stiffness(made.kappa_e, sigma, lambda m: m.G)
        kappa_f = self.rubbing(made.kappa_f)
        kappa_g = self.number(made.kappa_g, lambda m: Norm(m.D, _one(_gradient(m.G))))
        sigma_error = self.number(made.sigma_error, lambda m: Unfolded(m.D, _slopes(m.D)), _LOOSE)
        kappa_error = self.number(made.kappa_error, lambda m: Unfolded(m.D, _christoffel(m.D)), _LOOSE)
        return {
            "delta_low": low,
            "delta_high": high,
            "sigma": sigma,
            "kappa_v": kappa_v,
            "kappa_e": kappa_e,
            "kappa_f": kappa_f,
            "kappa_g": kappa_g,
            "inverse": inverse,
            "sigma_error": sigma_error,
            "kappa_error": kappa_error,
        }

    def inverse(self, searched: Sequence[Number]) -> tuple[Number, ...]:
        """Return bounds on the diagonal of D^-1: the squared lengths of unit vectors in its metric."""
        lengths = [number._replace(value=math.sqrt(number.value)) for number in searched]
        axes = [Lengths(model.D, _axes(model.D), together=False) for model in self.models]
        tolerance = math.sqrt(1.0 + self.tolerance) - 1.0
        bounds = self.each(lengths, axes, tolerance=tolerance)
        return tuple(number._replace(value=number.value**2) for number in bounds)

    def rubbing(self, found: Number) -> Number:
        """Return a bound on what viscous friction adds."""
        if not self.setting.viscous.any():
            return found
        F = np.diag(self.setting.viscous)[None]
        return self.number(found, lambda m: Norm(m.D, _constant(m.D, F)))

    def grown(self, sigma: Number) -> float:
        """Return by what factor D grows at most between the arm and its reference."""
        seconds = float(np.max(self.setting.radius / self.setting.speed))
        return math.exp(seconds * sigma.value)

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
        seconds = float(np.max(self.setting.radius / self.setting.speed))
        share = math.exp(-2.0 * seconds * sigma.value)
        quantities = []
        for model in self.models:
            held = self._residual(model)
            quantities.append(Stiffness(model, held, torque(model), self.setting.radius, share))
        (number,) = self.each([found], quantities, self.star)
        return number

    def of_torques(self, found: Numbers) -> dict[str, Any]:
        """Return what the motors must give, and what a jump of the load does, from what is proved of D."""
        low = found.delta_low
        high = found.delta_high
        n = len(self.star)
        nominal = self.models[0].D_nominal
        light = self._residual(self.models[0])
        heavy = self._residual(self.models[-1])
        changed = light._replace(coefficients=heavy.coefficients - light.coefficients)
        # The length of v* in the metric of D^, and of its change between the loads.
        jump = self._length_at_rest(nominal, changed)
        length_light = self._length_at_rest(nominal, light)
        length_heavy = self._length_at_rest(nominal, heavy)
        lengths = (jump, length_light, length_heavy)
        if any(number.status != "proved" for number in lengths):
            return {}  # what a search found
        length = max(length_light.value, length_heavy.value)
        largest_v = length * np.sqrt([number.value / low.value for number in found.inverse])
        # Torques that hold the arm: gravity, and by how much D^ v* changes within the radius.
        every_joint = np.eye(n)
        gravity = [Sizes(model.G, every_joint, together=False) for model in self.models]
        held = self.each(found.hold, gravity, self.star)
        slopes = most(_slopes(nominal), self.around)
        more = np.einsum("k,kij,j->i", self.setting.radius, slopes, largest_v)
        hold = []
        for torque, change in zip(held, more, strict=True):
            proved_of = (torque, low, length_light, length_heavy, *found.inverse)
            hold.append(_from(torque.value + float(change), *proved_of))
        # Torques per acceleration: the diagonal of D^, whose squares are bounded.
        diagonal = nominal.map_values(lambda c: c[:, range(n), range(n)])
        searched = [number._replace(value=number.value**2) for number in found.reach]
        squares = self.each(searched, [Sizes(diagonal, every_joint, together=False)])
        reach = []
        for square in squares:
            size = math.sqrt(square.value) * math.sqrt(high.value)
            reach.append(_from(size, square, high))
        jumped = found.jump
        lightest, heaviest = self.setting.arms[0], self.setting.arms[-1]
        if lightest is not heaviest:
            # D is that of the arm, D^ that of the reference.
            longer = math.sqrt(self.grown(found.sigma) / low.value)
            jumped = _from(jump.value * longer, jump, low, found.sigma)
        return {"jump": jumped, "hold": tuple(hold), "reach": tuple(reach)}

    def _length_at_rest(self, nominal: Polynomial, torque: Polynomial) -> Number:
        """Return a bound on the length of D^^-1 torque in the metric of D^, at references."""
        quantity = Lengths(nominal, _one(torque))
        (length,) = self.each([Number(0.0)], [quantity], self.star)
        return length

    def of_inputs(self, found: Numbers) -> dict[str, Any]:
        """Return how large what disturbs is."""
        setting = self.setting
        low = found.delta_low
        bounds = {}
        for name in ("torque", "friction"):
            if getattr(setting, name).any():
                bounds[name] = self._force(getattr(found, name), corners(getattr(setting, name)))
        for name in ("velocity", "acceleration", "encoder", "zone"):
            if getattr(setting, name).any():
                bounds[name] = self._motion(getattr(found, name), corners(getattr(setting, name)))
        if setting.velocity.any():
            stiffness = found.kappa_e
            if setting.feedforward != "none":
                stiffness = self.stiffness(found.kappa_e, found.sigma, self._residual)
            moved = bounds["velocity"]
            size = stiffness.value * moved.value * self.grown(found.sigma) / low.value
            bounds["shift"] = _from(size, stiffness, moved, low, found.sigma)
        return bounds

    def _force(self, searched: Number, torques: Array) -> Number:
        """Return a bound on the lengths of torques (c, n) in the metric of D^-1."""
        return self.number(searched, lambda m: Lengths(m.D, _constant(m.D, torques)))

    def _motion(self, searched: Number, vectors: Array) -> Number:
        """Return a bound on the lengths of velocities or accelerations (c, n) in the metric of D."""
        products = vectors[:, :, None] * vectors[:, None]
        weights = products.reshape(len(vectors), -1)
        square = searched._replace(value=searched.value**2)
        square = self.number(square, lambda m: Sizes(m.D, weights))
        return square._replace(value=math.sqrt(square.value))

    def _residual(self, model: Model) -> Polynomial:
        """Return D^ v*: what the feedforward holds, v* does not."""
        if self.setting.feedforward == "none":
            return model.G
        missing = model.G.coefficients - model.G_known.coefficients
        return model.G._replace(coefficients=missing)


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
        self.seen = np.array(near)
        self.waiting: list[_Waiting] = []
        self._share = 1.0 + tolerance
        self._arrived = itertools.count()

    def look(self, quantity: Quantity, cell: Cell, which: npt.NDArray[np.intp]) -> None:
        """Bound some members of a quantity in a cell."""
        at = quantity.places(which)
        known = quantity.bounds(cell, which, self._share * self.seen[at])
        np.maximum.at(self.seen, at, known.seen)
        upper = np.where(np.isnan(known.upper), np.inf, known.upper)  # NaN proves nothing
        shares = upper / (self._share * self.seen[at])
        left = shares > 1.0
        if left.any():
            waiting = _Waiting(
                share=-float(shares.max()),
                order=next(self._arrived),
                quantity=quantity,
                cell=cell,
                which=which[left],
                upper=upper[left],
                joint=known.joint,
            )
            heapq.heappush(self.waiting, waiting)

    def halve(self) -> None:
        """Bound what waits first in the halves of its cell."""
        _, _, quantity, cell, which, upper, joint = heapq.heappop(self.waiting)
        enough = self._share * self.seen[quantity.places(which)]
        left = which[upper > enough]
        if not len(left):
            return
        if joint is None:
            joint = _most_curved_joint(cell)
        for half in cell.halves(joint):
            self.look(quantity, half, left)

    def bounds(self) -> Array:
        """Return bounds on all members."""
        most = self._share * self.seen
        for waiting in self.waiting:
            places = waiting.quantity.places(waiting.which)
            np.maximum.at(most, places, waiting.upper)
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
    largest_sizes = np.zeros(polynomial.shape)
    for cell in pieces([polynomial], half, 0.0 * half):
        (hull,) = _flat(cell)
        (beyond,) = cell.piece.beyond
        sizes = np.abs(hull).max(axis=0) + beyond
        largest_sizes = np.maximum(largest_sizes, sizes)
    return largest_sizes


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
    grids = np.meshgrid(*axes, indexing="ij")
    place = np.stack([grid.ravel() for grid in grids])  # -1 and 1 at the ends, 0 at the apex
    third = place.shape[1] / 3.0
    enters = np.array(sizes)[:, None] > 1
    differences = place / (2.0 * third)
    second_differences = enters * np.where(place, -0.5, 1.0) / third
    return differences, second_differences


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
        L = np.linalg.cholesky(D - np.diag(less))
        return np.asarray(np.linalg.inv(L))
    except np.linalg.LinAlgError:
        return None


def _normal(root: Array, X: Array) -> Array:
    """Return L^-1 X L^-T, matrices (k, n, n) for X of shape (k, ..., n, n)."""
    more_axes = (1,) * (X.ndim - 3)
    root = root.reshape(len(root), *more_axes, *root.shape[1:])
    return np.asarray(root @ X @ root.swapaxes(-1, -2))


def _error(root: Array, beyond: Array) -> Array:
    """Return bounds on the norms of L^-1 E L^-T for all ``|E| <= beyond``, shape (k,)."""
    sizes = np.abs(root)
    turned = sizes @ beyond @ sizes.swapaxes(-1, -2)
    return np.asarray(np.linalg.norm(turned, axis=(-2, -1)))


def _sizes(X: Array) -> Array:
    """Return bounds on :func:`norms`, at most n^(1/8) times them and in a tenth of the time."""
    squares = X.swapaxes(-1, -2) @ X
    fourth = squares @ squares
    eighth = np.sum(fourth**2, axis=(-2, -1))
    return np.asarray(eighth**0.125)


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
        D, X = _flat(cell)
        less, beyond = cell.piece.beyond
        weights = self.weights[which]
        root = _roots(D, less)
        if root is None:
            return _nothing(len(which))
        values = np.tensordot(weights, _normal(root, X), axes=(1, 1))
        beyond_sums = np.tensordot(np.abs(weights), beyond, axes=1)
        error = _error(root, np.max(beyond_sums, axis=0))
        upper = _sizes(values) + error
        far = upper > x[:, None]
        upper[far] = norms(values[far]) + np.broadcast_to(error, upper.shape)[far]
        exact = np.where(far, upper, 0.0)
        seen = exact[:, _ends(cell)].max(axis=1)
        return Bounds(upper.max(axis=1), seen)


class Lengths(Quantity):
    """The largest lengths of some vectors in the metric of D^-1."""

    def __init__(self, D: Polynomial, vectors: Polynomial, together: bool = True) -> None:
        """Take D, and vectors (m, n)."""
        self.polynomials = (D, vectors)
        self.members = vectors.shape[0]
        self.together = together

    def bounds(self, cell: Cell, which: npt.NDArray[np.intp], x: Array) -> Bounds:
        """Return what is known of some vectors in a cell."""
        D, vectors = _flat(cell)
        less, beyond = cell.piece.beyond
        root = _roots(D, less)
        if root is None:
            return _nothing(len(which))
        turned = root @ vectors[:, which].swapaxes(1, 2)
        turned_beyond = np.abs(root) @ beyond[which].T
        upper = np.linalg.norm(turned, axis=1).T
        upper += np.linalg.norm(turned_beyond, axis=1).T
        seen = upper[:, _ends(cell)].max(axis=1)
        return Bounds(upper.max(axis=1), seen)


class Sizes(Quantity):
    """The largest magnitudes of weighted sums of the entries of a polynomial."""

    def __init__(self, P: Polynomial, weights: Array, together: bool = True) -> None:
        """Take a polynomial, and weights of its entries (w, entries)."""
        self.polynomials = (P,)
        self.weights = weights
        self.members = len(weights)
        self.together = together

    def bounds(self, cell: Cell, which: npt.NDArray[np.intp], x: Array) -> Bounds:
        """Return what is known of some sums in a cell."""
        (entries,) = _flat(cell)
        (beyond,) = cell.piece.beyond
        weights = self.weights[which]
        upper = np.abs(weights @ entries.reshape(len(entries), -1).T)
        upper += np.abs(weights) @ beyond.reshape(-1, 1)
        seen = upper[:, _ends(cell)].max(axis=1)
        return Bounds(upper.max(axis=1), seen)


def _beside(X: Array) -> Array:
    """Return at least the norms of sums of X_k u_k over vectors u of length 1, X of shape (m, n, n, n).

    It is the norm of the matrices beside each other, shape (m,).
    """
    wide = X.swapaxes(1, 2).reshape(*X.shape[:2], -1)
    squares = np.linalg.eigvalsh(wide @ wide.swapaxes(1, 2))[:, -1]
    return np.asarray(np.sqrt(squares))


def _in_all(X: Array, *along: Array) -> Array:
    """Return a table with a matrix applied along each of its last axes."""
    for axis, matrix in zip(range(-len(along), 0), along, strict=True):
        last = np.moveaxis(X, axis, -1) @ matrix.T
        X = np.moveaxis(last, -1, axis)
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
        D, X = _flat(cell)
        less, beyond = cell.piece.beyond
        D_center, X_center = cell.middle()
        root = _roots(D, less)
        center_roots = _roots(D_center[None], less)
        if root is None or center_roots is None:
            return _nothing(1)
        center = center_roots[0]
        one = np.eye(len(less))
        upper = _beside(_normal(root, _in_all(X, center, one, one)))
        lengths = np.linalg.norm(center, axis=0)
        for beyond_joint, length in zip(beyond, lengths, strict=True):
            upper += length * _error(root, beyond_joint)
        # D is at least this share of D at the center.
        inverses = np.asarray(root @ np.linalg.cholesky(D_center))  # squared norm: that of (L L^T)^-1 D
        share = 1.0 / norms(inverses).max() ** 2
        seen = _beside(_in_all(X_center[None], center, center, center))
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
        largest_root = norms(base).max()
        inner = float(np.linalg.norm(beyond))
        solved = np.linalg.norm(base @ r[..., None], axis=(1, 2)).max()
        length = largest_root * (solved + largest_root * inner)
        along = odd @ r
        left = r - np.sign(odd.T) @ along
        inner += np.linalg.norm(left, axis=1).max()
        # e = r + (1 - D^) e
        away = np.eye(len(beyond)) - nominal
        error = float(np.linalg.norm(loose))
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
        M_v = np.tensordot(v, at.M, axes=(0, 1))
        N_r = np.tensordot(r, N, axes=1)
        K = at.torque - M_v - N_r
        K_more = beyond.torque + np.tensordot(np.abs(v), beyond.M, axes=1)
        K_more += np.tensordot(r_more, np.abs(N), axes=1)
        # M - N D^
        W = at.M - np.tensordot(at.nominal, N, axes=1)
        beyond_W = beyond.M + np.tensordot(beyond.nominal, np.abs(N), axes=1)
        W_more = np.linalg.norm(beyond_W)
        more = float(np.linalg.norm(K_more)) + e.length * float(W_more)
        slopes = at.held_slope, at.rates
        slopes_more = beyond.held_slope, beyond.rates
        more += self._apart(N, v, e.length, slopes, slopes_more)
        least_root = _roots(self.share * at.D, self.share * beyond.D)
        upper = self._upper(least_root, K, W, e, more, x[0])
        if upper > x[0]:
            root = self._apart_root(at.D, beyond.D, values.moves, beyond.moves)
            upper = min(upper, self._upper(root, K, W, e, more, x[0]))
        K_center = center.torque - np.tensordot(v, N, axes=1)
        seen = norms(K_center[None])
        # The cell is cut along the joint that adds most to what is of second order.
        W_along = np.tensordot(odd, W, axes=1)
        along_joints = np.tensordot(W_along, e.along, axes=(1, 1))
        pairs = np.linalg.norm(along_joints, axis=(1, 2))
        K_bends = np.tensordot(even, K, axes=1)
        D_bends = np.tensordot(even, seen * at.D, axes=1)
        bends = np.linalg.norm(K_bends, axis=(1, 2))
        bends = bends + np.linalg.norm(D_bends, axis=(1, 2))
        bends = bends + pairs.sum(axis=0) + pairs.sum(axis=1) + _EVEN * cell.half
        return Bounds(np.array([upper]), seen, int(np.argmax(bends)))

    @staticmethod
    def _upper(root: Array | None, K: Array, W: Array, e: _Solved, more: float, x: float) -> float:
        """Return a bound on the norm of K - W e and `more`, in a metric with these roots at the corners."""
        if root is None:
            return np.inf
        K = _normal(root, K)
        W = _normal(root, W)
        W_e = np.tensordot(e.along, W, axes=(1, 1))
        rest = _sizes(W_e).sum(axis=0)
        rest += e.ball * _beside(W) + more * norms(root) ** 2
        upper = _sizes(K) + rest
        far = upper > x
        upper[far] = norms(K[far]) + rest[far]
        return float(upper.max())

    def _apart_root(self, D: Array, less: Array, rates: Array, beyond: Array) -> Array | None:
        """Return the roots of D less what it may lose from K's configuration to its own; None for a lot."""
        there = rates[-1]
        away = 2.0 * self.radius
        change = _sizes(rates - there).max(axis=0)
        more = away @ (change + np.linalg.norm(beyond, axis=(1, 2)))
        if 2.0 * more > 1.0 - self.share:
            return None
        values, vectors = np.linalg.eigh(there)
        lost = np.einsum("j,jab,jb,jcb->ac", away, vectors, np.abs(values), vectors)
        left = D - lost - more * np.eye(len(lost))
        return _roots(left, less)

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
        C = center[0]
        B = base[0]
        one = np.eye(len(cell.half))
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
        inside = []
        outside = []
        for value, more, roots in zip(values, beyond, metrics, strict=True):
            inside.append(_in_all(value, *roots))
            outside.append(_in_all(more, *map(np.abs, roots)))
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
        beyond_changes = slope_more + rates_more @ np.abs(v)
        more = np.linalg.norm(beyond_changes, axis=0)
        most_rates = _sizes(rates.swapaxes(1, 2)).max(axis=0)
        most_rates = most_rates + np.linalg.norm(rates_more, axis=(0, 2))
        more += length * most_rates
        N_size = _beside(N[None])[0]
        return float((turns + N_size * more) @ self.radius)


def _one(P: Polynomial) -> Polynomial:
    """Return a polynomial as the only one of several."""
    return P.map_values(lambda c: c[:, None])


def _slopes(D: Polynomial) -> Polynomial:
    """Return the partial derivatives of D, shape (n, n, n), the joint first."""
    joints = range(len(D.center))
    return stack_polynomials([D.derivative(j) for j in joints])


def _christoffel(D: Polynomial) -> Polynomial:
    """Return the matrices C_k of C(q, v) = sum of v_k C_k, shape (n, n, n)."""

    def combine(S: Array) -> Array:
        along = S.transpose(0, 3, 2, 1)
        across = S.transpose(0, 3, 1, 2)
        return np.asarray(0.5 * (S + along - across))

    return _slopes(D).map_values(combine)


def _gradient(G: Polynomial) -> Polynomial:
    """Return dG_i/dq_j, shape (n, n)."""
    return _slopes(G).map_values(lambda c: c.transpose(0, 2, 1))


def _constant(like: Polynomial, value: Array) -> Polynomial:
    """Return a polynomial that is a value everywhere."""
    terms = like.coefficients.shape[: len(like.center)]
    coefficients = np.zeros((*terms, *value.shape))
    coefficients[(0,) * len(terms)] = value
    return like._replace(coefficients=coefficients)


def _axes(D: Polynomial) -> Polynomial:
    """Return the n constant unit vectors, (n, n)."""
    return _constant(D, np.eye(len(D.center)))
