"""The numbers of an arm, proved: branch and bound over cells of configurations.

Each number is the largest norm, or eigenvalue, of ``D(q)^-1/2 X(q) D(q)^-1/2``, with X one of a few matrices
that are linear in trigonometric polynomials (:mod:`armgpi.certification.trigonometric`). In a cell it is
bounded by its value at the center, first and second derivatives there, and bounds on third derivatives
everywhere. Cells with large bounds are split until the largest bound is near the largest value that was seen.

For any number x, and Z = X - x D, the largest eigenvalue of D^-1 X is at most x where Z is negative all over
the cell, and at most ``x + z / (1 - d)`` otherwise: z bounds the largest one of D_c^-1 Z, D_c is D at the
center, and D is at least (1 - d) D_c in the cell. With x a little above the maximum, cells are soon small
enough. For a norm, Z is ``[[-x D, X], [X^T, -x D]]``.

The arithmetic is that of double precision; every bound is raised by :data:`OUTWARD` of itself, which is far
more than rounding does to it (tested).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.arrays import Array
from armgpi.certification.quantities import MARGIN, Number, Numbers, Setting, corners, norms, searched
from armgpi.certification.trigonometric import Expandable, Expansion, Polynomial, polynomials_of, stacked

#: Share by which every bound is raised.
OUTWARD = 1e-6
#: Numbers below this are as good as zero.
_TINY = 1e-9
#: Cells that are looked at together.
_TOGETHER = 128
#: Share of a joint's width in the choice of what to split, where nothing else tells.
_EVEN = 1e-6


class Cells(NamedTuple):
    """Boxes of configurations.

    Attributes:
        center: [rad or m], shape (k, n).
        half: half of their widths, shape (k, n).
    """

    center: Array
    half: Array


class Values(NamedTuple):
    """What is known of a quantity in cells.

    Attributes:
        seen: largest value at the centers, shape (k,).
        upper: bound in each cell, infinite where there is none, shape (k,).
        shares: what each joint's width adds to the bound, shape (k, n).
    """

    seen: Array
    upper: Array
    shares: Array


class Bound(NamedTuple):
    """What branch and bound gives.

    Attributes:
        upper: proved; infinite when no bound was found in time.
        seen: the largest value that was seen.
        cells: how many were looked at.
    """

    upper: float
    seen: float
    cells: int


#: (cells, a number near the maximum) -> what is known.
Quantity = Callable[[Cells, float], Values]


class Model(NamedTuple):
    """D and G of a true arm and of the nominal model, and how far sliding joints may be from zero."""

    D: Polynomial
    G: Polynomial
    D_nominal: Polynomial
    G_nominal: Polynomial
    reach: Array


def proved(setting: Setting, tolerance: float = 0.1, budget: float = 30.0) -> Numbers:
    """Return the numbers of an arm, each proved where that takes no longer than a budget, or else searched.

    Args:
        setting: what they are taken over.
        tolerance: how far above the largest value seen a bound may be, as a share.
        budget: time for each number [s]; a bound of up to twice the searched number is taken when it is over.

    Raises:
        ParameterError: when D and G are no trigonometric polynomials of degree two.
    """
    made = searched(setting)
    prover = _Prover(setting, tolerance, budget)
    found = made._replace(**prover.of_motion(made))
    return found._replace(**prover.of_torques(found), **prover.of_inputs(found))


class _Prover:
    """What the numbers of one setting are proved with."""

    def __init__(self, setting: Setting, tolerance: float, budget: float) -> None:
        self.setting, self.tolerance, self.budget = setting, tolerance, budget
        half = (setting.upper - setting.lower) / 2
        self.star = Cells(((setting.lower + setting.upper) / 2)[None], half[None])
        self.around = self.star._replace(half=self.star.half + setting.radius)
        *arms, nominal = polynomials_of([*setting.arms, setting.nominal])
        reach = np.abs(self.around.center[0]) + self.around.half[0]
        self.models = [Model(*arm, *nominal, reach) for arm in arms]

    def number(
        self,
        found: Number,
        quantity: Callable[[Model], Quantity],
        cells: Cells | None = None,
        loose: float = 2.0,
    ) -> Number:
        """Return a bound where it is proved and at most `loose` times what a search found, or else that."""
        most = max(found.value, _TINY)
        made, where = [quantity(each) for each in self.models], self.around if cells is None else cells
        bound = largest(made, where, most / (1.0 + MARGIN), self.tolerance, self.budget)
        proven = bound.upper <= loose * most
        return Number((1.0 + OUTWARD) * bound.upper, "proved") if proven else found

    def root(self, found: Number, quantity: Callable[[Model], Quantity]) -> Number:
        """Return the bound on a number whose square is the largest value of a quantity."""
        square = self.number(Number(found.value**2), quantity, loose=4.0)
        return square._replace(value=math.sqrt(square.value))

    def of_motion(self, made: Numbers) -> dict[str, Any]:
        """Return what the matrix inequality takes: delta, what motion and gravity add, and D^-1."""
        setting, v = self.setting, corners(self.setting.speed)

        def inverted(number: Number) -> Number:
            return number._replace(value=1.0 / number.value)

        low = Number(1.0, "proved")
        first = self.models[-1]
        # Loads add to D, so the nominal model with the heaviest one is at least the true D.
        if not np.array_equal(first.D.coefficients, first.D_nominal.coefficients):
            low = inverted(
                self.number(inverted(made.delta_low), lambda m: Eigenvalue(m.D_nominal, m.D, m.reach))
            )
        return {
            "delta_low": low,
            "delta_high": self.number(made.delta_high, lambda m: Eigenvalue(m.D, m.D_nominal, m.reach)),
            "sigma": self.number(made.sigma, lambda m: Norm(m.D, _slopes(m.D), m.reach, v)),
            "kappa_v": self.number(made.kappa_v, lambda m: Norm(m.D, _christoffel(m.D), m.reach, v)),
            "kappa_e": self.number(made.kappa_e, lambda m: Stiffness(m, setting, m.G), self.star),
            "kappa_g": self.number(made.kappa_g, lambda m: Norm(m.D, _one(_gradient(m.G)), m.reach)),
            "inverse": tuple(
                self.number(each, lambda m, j=j: Eigenvalue(m.D, _unit(m.D, j), m.reach))  # type: ignore[misc]
                for j, each in enumerate(made.inverse)
            ),
            "sigma_error": self.number(
                made.sigma_error, lambda m: Unfolded(m.D, _slopes(m.D), m.reach), loose=3.0
            ),
            "kappa_error": self.number(
                made.kappa_error, lambda m: Unfolded(m.D, _christoffel(m.D), m.reach), loose=3.0
            ),
        }

    def of_torques(self, found: Numbers) -> dict[str, Any]:
        """Return what the motors must give, and what a jump of the load does, from what is proved of D."""
        low, high, reach = found.delta_low, found.delta_high, self.models[0].reach
        nominal = self.models[0].D_nominal
        light, heavy = (self._held(m) for m in (self.models[0], self.models[-1]))
        changed = light._replace(coefficients=heavy.coefficients - light.coefficients)
        at = [self.setting.lower[None], self.setting.upper[None]]
        # The length of v* in the metric of D^, and of its change between the loads.
        jump, *lengths = (
            self._length_of(nominal, each, np.concatenate(at)) for each in (changed, light, heavy)
        )
        length = max(each.value for each in lengths)
        largest_v = length * np.sqrt([each.value / low.value for each in found.inverse])
        hold, reaches = [], []
        for j in range(len(reach)):
            moves = nominal.mapped(lambda c, j=j: c[:, j])  # type: ignore[misc]
            steps = np.stack([moves.bound(reach, k) for k in range(len(reach))])
            held = self.number(found.hold[j], lambda m, j=j: _scalar(m.G, reach, j), self.star)  # type: ignore[misc]
            more = held.value + float(self.setting.radius @ steps @ largest_v)
            hold.append(_from(more, held, low, *lengths, *found.inverse))
            square = self.squared(found.reach[j], lambda m, j=j: _scalar(m.D_nominal, reach, j, j))  # type: ignore[misc]
            reaches.append(_from(square.value * math.sqrt(high.value), square, high))
        jumps = self.setting.arms[0] is not self.setting.arms[-1]
        jumped = _from(jump.value / math.sqrt(low.value), jump, low) if jumps else found.jump
        return {"jump": jumped, "hold": tuple(hold), "reach": tuple(reaches)}

    def of_inputs(self, found: Numbers) -> dict[str, Any]:
        """Return how large what disturbs is."""
        setting, low, high = self.setting, found.delta_low, found.delta_high
        made = {}
        for name in ("torque", "friction"):
            if (bound := getattr(setting, name)).any():
                ends = corners(bound)
                made[name] = self.number(
                    getattr(found, name),
                    lambda m, v=ends: Norm(*_bordered(m.D, _axes(m.D)), m.reach, v),  # type: ignore[misc]
                )
        for name in ("velocity", "acceleration", "encoder"):
            if (bound := getattr(setting, name)).any():
                ends = corners(bound)
                squares = (ends[:, :, None] * ends[:, None]).reshape(len(ends), -1)
                made[name] = self.squared(
                    getattr(found, name),
                    lambda m, v=squares: _scalar(m.D, m.reach, weights=v),  # type: ignore[misc]
                    4.0 * 4.0,
                )
        if setting.velocity.any():
            stiffness = found.kappa_e
            if setting.feedforward != "none":
                stiffness = self.number(
                    found.kappa_e, lambda m: Stiffness(m, setting, self._held(m)), self.star, 9.0
                )
            moved = made["velocity"]
            made["shift"] = _from(stiffness.value * moved.value / low.value, stiffness, moved, low)
        if setting.acceleration.any() and setting.feedforward == "model":
            # D(q) - D^(q) at the arm, and by how much D^ changes between there and the reference.
            v, far = (
                corners(setting.radius),
                Number(float(np.max(setting.radius / setting.speed)) * found.sigma.value),
            )
            rate = self.number(far, lambda m: Norm(m.D, _slopes(m.D_nominal), m.reach, v), loose=math.inf)
            share = max(high.value - 1.0, 1.0 - low.value) + high.value * math.expm1(rate.value / low.value)
            moved = made["acceleration"]
            made["acceleration"] = _from(share * moved.value, moved, low, high, rate)
        return made

    def squared(self, found: Number, quantity: Callable[[Model], Quantity], loose: float = 4.0) -> Number:
        """Return the bound on a number whose square is the largest value of a quantity."""
        square = self.number(found._replace(value=found.value**2), quantity, loose=loose)
        return square._replace(value=math.sqrt(square.value))

    def _held(self, model: Model) -> Polynomial:
        """Return D^ v*: what the feedforward holds, v* does not."""
        if self.setting.feedforward == "none":
            return model.G
        return model.G._replace(coefficients=model.G.coefficients - model.G_nominal.coefficients)

    def _length_of(self, D: Polynomial, held: Polynomial, ends: Array) -> Number:
        """Return a bound on the length of a torque in the metric of D^-1; `ends` are two configurations."""
        torque, inverse = held.at(ends), np.linalg.inv(D.at(ends))
        near = math.sqrt(float(np.einsum("ka,kab,kb->k", torque, inverse, torque).max()))
        bordered = _bordered(D, _one(held))
        return self.number(Number(near), lambda m: Norm(*bordered, m.reach), self.star, math.inf)


def _from(value: float, *used: Number) -> Number:
    """Return a number that follows from others."""
    proven = all(each.status == "proved" for each in used)
    return Number((1.0 + OUTWARD) * value, "proved" if proven else "searched")


def largest(quantities: list[Quantity], cells: Cells, near: float, tolerance: float, budget: float) -> Bound:
    """Return a bound on the largest of some quantities over cells.

    Args:
        quantities: what is bounded.
        cells: where.
        near: about the maximum.
        tolerance: how far above the largest value seen the bound may be, as a share.
        budget: time [s].
    """
    end = time.monotonic() + budget
    seen, upper, looked = 0.0, 0.0, 0
    waiting = [(np.inf, cells)]
    while waiting:
        bound = max(each[0] for each in waiting)
        if time.monotonic() > end:
            return Bound(max(upper, bound), seen, looked)
        waiting.sort(key=lambda each: each[0])
        some = waiting.pop()[1]
        enough = (1.0 + tolerance) * max(seen, near)
        values = _worst([quantity(some, enough) for quantity in quantities])
        looked += len(some.center)
        seen = max(seen, float(values.seen.max()))
        done = values.upper <= enough
        upper = max(upper, float(values.upper[done].max(initial=0.0)))
        waiting += _split(some, values, np.asarray(~done))
    return Bound(upper, seen, looked)


def _worst(each: list[Values]) -> Values:
    """Return the largest of several quantities in the same cells."""
    shares = np.max([values.shares for values in each], axis=0)
    return Values(np.max([v.seen for v in each], axis=0), np.max([v.upper for v in each], axis=0), shares)


def _split(cells: Cells, values: Values, which: npt.NDArray[np.bool_]) -> list[tuple[float, Cells]]:
    """Return halves of some cells in portions, each with the largest bound in it."""
    order = np.flatnonzero(which)
    order = order[np.argsort(-values.upper[order], kind="stable")]
    portions = []
    for rows in np.array_split(order, -(-2 * len(order) // _TOGETHER)) if len(order) else []:
        center, half = cells.center[rows], cells.half[rows].copy()
        across = np.arange(len(rows)), np.argmax(values.shares[rows], axis=1)
        half[across] /= 2
        step = np.zeros_like(half)
        step[across] = half[across]
        halves = Cells(np.concatenate([center - step, center + step]), np.concatenate([half, half]))
        portions.append((float(values.upper[rows].max()), halves))
    return portions


class _Metric:
    """What a cell has of D: the root of its inverse at the center, slopes, and how much less it may be."""

    def __init__(self, D: Expandable, cells: Cells, half: Array) -> None:
        """Take D(q) at the centers; `half` is how far q is from there."""
        self.cells, self.half = cells, half
        expansion = D.at(cells.center)
        self.root = np.linalg.inv(np.linalg.cholesky(expansion.value))
        self.slopes = self.normal(expansion.slopes)
        self.sizes = _sizes(self.slopes)
        self.beyond = self.beyond_of(D, expansion)
        self.loss = np.sum(half * self.sizes + self.beyond, axis=1)

    def normal(self, X: Array) -> Array:
        """Return L^-1 X L^-T with D = L L^T at the center; X of shape (k, ..., n, n)."""
        root = self.root.reshape(len(self.root), *(1 for _ in X.shape[3:]), *self.root.shape[1:])
        return np.asarray(root @ X @ root.swapaxes(-1, -2))

    def spread(self, bound: Array) -> Array:
        """Return bounds on the norms of L^-1 E L^-T for all ``|E| <= bound``, shape (k, ...)."""
        root = np.abs(self.root).reshape(len(self.root), *(1 for _ in bound.shape[3:]), *self.root.shape[1:])
        return np.asarray(np.sqrt(np.sum((root @ bound @ root.swapaxes(-1, -2)) ** 2, axis=(-2, -1))))

    def beyond_of(self, X: Expandable, expansion: Expansion) -> Array:
        """Return bounds on the norm of what is beyond first order, by joints; shape (k, joints, ...)."""
        half = self.half
        flat = self.spread(_cubes(X.thirds, half))
        found = np.repeat(flat[:, None] / half.shape[1], half.shape[1], axis=1)
        sizes = np.sqrt(np.sum(self.normal(expansion.seconds) ** 2, axis=(-2, -1)))
        pad = (1,) * (flat.ndim - 1)
        for (i, j), size in zip(X.pairs, np.moveaxis(sizes, 1, 0), strict=True):
            part = 0.5 * (half[:, i] * half[:, j]).reshape(-1, *pad) * size
            found[:, i] += part
            found[:, j] += part if i != j else 0.0
        return found

    def values(self, seen: Array, near: float, parts: Array, shares: Array | None = None) -> Values:
        """Return what is known; eigenvalues of D_c^-1 Z are at most seen - near and the sum of `parts`."""
        lost: npt.NDArray[np.bool_] = np.asarray(
            ~np.isfinite(parts).all(axis=1)
        )  # a cell in which v* may be anything
        shares = np.where(lost[:, None], self.cells.half * self.sizes, parts if shares is None else shares)
        excess = np.where(lost, np.inf, seen - near + parts.sum(axis=1))
        with np.errstate(divide="ignore", invalid="ignore"):
            upper = near + excess / (1.0 - self.loss)
        # Where Z is negative all over the cell, X is at most near D whatever D is.
        upper = np.where(excess <= 0.0, near, np.where(self.loss < 1.0, upper, np.inf))
        return Values(seen, upper, shares + _EVEN * self.cells.half)


class Eigenvalue:
    """The largest eigenvalue of D^-1 X, with X a symmetric matrix."""

    def __init__(self, D: Polynomial, X: Polynomial, reach: Array) -> None:
        """Take D and X; `reach` is the largest distance of sliding joints from zero."""
        self.D, self.X = Expandable(D, reach), Expandable(X, reach)

    def __call__(self, cells: Cells, near: float) -> Values:
        """Return what is known in cells."""
        metric, X = _Metric(self.D, cells, cells.half), self.X.at(cells.center)
        seen = np.asarray(np.linalg.eigvalsh(metric.normal(X.value))[:, -1])
        steps = cells.half * _sizes(metric.normal(X.slopes) - near * metric.slopes)
        return metric.values(seen, near, steps + metric.beyond_of(self.X, X) + near * metric.beyond)


class Norm:
    """The largest norm of D^-1/2 X D^-1/2, with X the sum of some matrices times given weights."""

    def __init__(self, D: Polynomial, X: Polynomial, reach: Array, weights: Array | None = None) -> None:
        """Take D, matrices X (m, n, n) and weights of them (w, m): all ones when not given."""
        self.D, self.X = Expandable(D, reach), Expandable(X, reach)
        self.weights = np.ones((1, X.coefficients.shape[1])) if weights is None else weights

    def __call__(self, cells: Cells, near: float) -> Values:
        """Return what is known in cells."""
        metric, X = _Metric(self.D, cells, cells.half), self.X.at(cells.center)
        seen = norms(self._weighted(metric.normal(X.value)))
        slopes = _sizes(self._weighted(metric.normal(X.slopes)))
        parts = cells.half[:, :, None] * slopes + metric.beyond_of(self.X, X) @ np.abs(self.weights).T
        parts += near * (cells.half * metric.sizes + metric.beyond)[:, :, None]
        worst = np.argmax(seen + parts.sum(axis=1), axis=1)
        # That of the worst weights, whose own center may be lower.
        rows = np.arange(len(worst))
        values = metric.values(seen[rows, worst], near, parts[rows, :, worst])
        return values._replace(seen=seen.max(axis=1))

    def _weighted(self, X: Array) -> Array:
        """Return the sums of matrices (k, ..., m, n, n) with all weights, shape (k, ..., w, n, n)."""
        return np.asarray(np.einsum("...mab,wm->...wab", X, self.weights))


class Unfolded:
    """At least the largest norm of the sum of u_k X_k over velocities u of length 1, all in the metric of D.

    It is the norm of all n matrices beside each other, for velocities along axes of length 1.
    """

    def __init__(self, D: Polynomial, X: Polynomial, reach: Array) -> None:
        """Take D and matrices X (n, n, n), one for each joint's velocity."""
        self.D, self.X = Expandable(D, reach), Expandable(X, reach)

    def __call__(self, cells: Cells, near: float) -> Values:
        """Return what is known in cells."""
        metric, X = _Metric(self.D, cells, cells.half), self.X.at(cells.center)
        seen = self._beside(metric, X.value[:, None])[:, 0]
        parts = cells.half * self._beside(metric, X.slopes)
        parts += np.einsum("kjm,km->kj", metric.beyond_of(self.X, X), np.linalg.norm(metric.root, axis=1))
        lost = metric.loss >= 1.0
        with np.errstate(invalid="ignore"):  # each of the three is as long in the metric elsewhere
            upper = np.where(lost, np.inf, (seen + parts.sum(axis=1)) / (1.0 - metric.loss) ** 1.5)
        shares = parts + 1.5 * near * (cells.half * metric.sizes + metric.beyond)
        return Values(seen, upper, shares + _EVEN * cells.half)

    @staticmethod
    def _beside(metric: _Metric, X: Array) -> Array:
        """Return the norms of matrices (k, j, n, n, n) beside each other."""
        along = np.einsum("kjmab,kum->kjuab", metric.normal(X), metric.root)
        squares = np.einsum("kjuab,kjucb->kjac", along, along)
        return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(squares)[..., -1], 0.0)))


class Stiffness:
    """The largest norm of D^-1/2 K D^-1/2 with K = d(G - D^ v*)/dq and v* = D^^-1 G at a reference.

    D is taken at one configuration near the reference, K at another one.
    """

    def __init__(self, model: Model, setting: Setting, torque: Polynomial) -> None:
        """Take the models, and G or another torque, within `setting.radius` of the reference."""
        self.radius = setting.radius
        held = model.G.coefficients
        if setting.feedforward != "none":  # what the feedforward holds, v* does not
            held = held - model.G_nominal.coefficients
        resting = model.G._replace(coefficients=held)
        # dG/dq, and d(D^ e_k)/dq for every joint k.
        nominal = _slopes(model.D_nominal).mapped(lambda c: c.transpose(0, 3, 2, 1))
        gradient = _one(_gradient(torque))
        whole = np.concatenate([gradient.coefficients, -nominal.coefficients], axis=1)
        reach = model.reach
        self.D, self.D_nominal = Expandable(model.D, reach), Expandable(model.D_nominal, reach)
        self.K = Expandable(nominal._replace(coefficients=whole), reach)
        self.held = Expandable(resting, reach)
        self.seconds = _seconds(resting, reach), _seconds(model.D_nominal, reach)

    def __call__(self, cells: Cells, near: float) -> Values:
        """Return what is known in cells of references."""
        half, wide = cells.half, cells.half + self.radius
        metric = _Metric(self.D, cells, wide)
        v, slope, rest = self._resting(cells)
        weights = np.concatenate([np.ones((len(v), 1)), v], axis=1)
        K = self.K.at(cells.center)
        bases, slopes = metric.normal(K.value), metric.normal(K.slopes)
        seen = norms(np.einsum("km,kmab->kab", weights, bases))
        apart = np.einsum("km,kjmab->kjab", weights, slopes)
        together = apart + np.einsum("kjm,kmab->kjab", slope, bases[:, 1:])
        sizes = _sizes(together)
        parts = half * sizes + self.radius * _sizes(apart)
        # Second order: K in q, v* in q*, and the product of both.
        beyond = metric.beyond_of(self.K, K)
        change = np.einsum("kj,kjm->km", half, np.abs(slope)) + rest
        parts += np.einsum("km,kjm->kj", np.abs(weights), beyond)
        parts += np.einsum(
            "km,kjm->kj", change, beyond[:, :, 1:] + wide[:, :, None] * _sizes(slopes[:, :, 1:])
        )
        parts += np.einsum("km,km->k", rest, _sizes(bases[:, 1:]))[:, None] / half.shape[1]
        parts += near * (wide * metric.sizes + metric.beyond)
        # What the radius adds, no split makes less.
        share = (
            half * (sizes + near * metric.sizes)
            + np.divide(half, wide, where=wide > 0.0, out=0 * wide) * beyond[:, :, 0]
        )
        return metric.values(seen, near, parts, share)

    def _resting(self, cells: Cells) -> tuple[Array, Array, Array]:
        """Return v* at the centers, its slopes (k, joints, n), and bounds on what is beyond them."""
        half, D, held = cells.half, self.D_nominal.at(cells.center), self.held.at(cells.center)
        metric = _Metric(self.D_nominal, cells, half)
        inverse = np.linalg.inv(D.value)
        v = np.einsum("kab,kb->ka", inverse, held.value)
        # D^ (v* - v) = held - D^ v =: r, which is zero at the center.
        r_slopes = held.slopes - np.einsum("kjab,kb->kja", D.slopes, v)
        slopes = np.einsum("kab,kjb->kja", inverse, r_slopes)
        r_rest = _rest(self.seconds[0], half)
        r_rest = r_rest + np.einsum("kab,kb->ka", _rest(self.seconds[1], half), np.abs(v))
        rest = np.einsum("kab,kb->ka", np.abs(inverse), r_rest)
        # What D^ in the cell adds to D^ at the center, in its metric.
        r = np.einsum("kj,kja->ka", half, np.abs(r_slopes)) + r_rest
        size = np.linalg.norm(np.einsum("kab,kb->ka", np.abs(metric.root), r), axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            more = np.where(metric.loss < 1.0, metric.loss / (1.0 - metric.loss) * size, np.inf)
        rest = rest + np.sqrt(np.diagonal(inverse, axis1=1, axis2=2)) * more[:, None]
        return v, slopes, rest


def _one(P: Polynomial) -> Polynomial:
    """Return a polynomial as the only one of several."""
    return P.mapped(lambda c: c[:, None])


def _slopes(D: Polynomial) -> Polynomial:
    """Return the partial derivatives of D, shape (n, n, n), the joint first."""
    return stacked([D.derivative(j) for j in range(D.frequencies.shape[1])])


def _christoffel(D: Polynomial) -> Polynomial:
    """Return the matrices C_k of C(q, v) = sum of v_k C_k, shape (n, n, n)."""

    def combined(S: Any) -> Any:
        return 0.5 * (S + S.transpose(0, 3, 2, 1) - S.transpose(0, 3, 1, 2))

    return _slopes(D).mapped(combined)


def _gradient(G: Polynomial) -> Polynomial:
    """Return dG_i/dq_j, shape (n, n)."""
    return stacked([G.derivative(j) for j in range(G.frequencies.shape[1])]).mapped(
        lambda c: c.transpose(0, 2, 1)
    )


def _bordered(D: Polynomial, vectors: Polynomial) -> tuple[Polynomial, Polynomial]:
    """Return diag(D, 1) and [[0, g], [g^T, 0]] for vectors g (m, n): its norm is the length of g."""
    terms, m, n = vectors.coefficients.shape
    metric, beside = np.zeros((terms, n + 1, n + 1), complex), np.zeros((terms, m, n + 1, n + 1), complex)
    metric[:, :n, :n], metric[0, n, n] = D.coefficients, 1.0
    beside[:, :, :n, n] = beside[:, :, n, :n] = vectors.coefficients
    return D._replace(coefficients=metric), D._replace(coefficients=beside)


def _axes(D: Polynomial) -> Polynomial:
    """Return the n constant unit vectors, (n, n)."""
    coefficients = np.zeros_like(D.coefficients)
    coefficients[0] = np.eye(coefficients.shape[-1])
    return D._replace(coefficients=coefficients)


def _scalar(P: Polynomial, reach: Array, *index: int, weights: Array | None = None) -> Norm:
    """Return the magnitude of an entry of P, or of a weighted sum of all of them."""
    entry: Any = (slice(None), *index)
    entries = P.coefficients[entry].reshape(len(P.coefficients), -1, 1, 1)
    one = np.zeros((len(entries), 1, 1), complex)
    one[0] = 1.0
    return Norm(P._replace(coefficients=one), P._replace(coefficients=entries), reach, weights)


def _unit(D: Polynomial, joint: int) -> Polynomial:
    """Return the constant matrix whose only entry that is not zero, on the diagonal, is one."""
    coefficients = np.zeros_like(D.coefficients)
    coefficients[0, joint, joint] = 1.0
    return D._replace(coefficients=coefficients)


def _seconds(P: Polynomial, reach: Array) -> Array:
    """Return bounds on all second derivatives, shape (n, n, *shape)."""
    joints = range(len(reach))
    return np.stack([np.stack([P.derivative(i).bound(reach, j) for j in joints]) for i in joints])


def _rest(second: Array, half: Array) -> Array:
    """Return bounds on what is beyond first order in boxes, shape (k, *shape)."""
    return np.asarray(0.5 * np.einsum("ij...,ki,kj->k...", second, half, half, optimize=True))


def _cubes(third: Array, half: Array) -> Array:
    """Return bounds on what is beyond second order in boxes, shape (k, *shape)."""
    some = np.einsum("hij...,kh->kij...", third, half)
    some = np.einsum("kij...,ki->kj...", some, half)
    return np.asarray(np.einsum("kj...,kj->k...", some, half) / 6.0)


def _sizes(X: Array) -> Array:
    """Return bounds on :func:`norms`, at most n^(1/8) times them and in a tenth of the time."""
    squares = X.swapaxes(-1, -2) @ X
    return np.asarray(np.sum((squares @ squares) ** 2, axis=(-2, -1)) ** 0.125)
