"""Functions of a robot's configuration as trigonometric polynomials, which bound their own derivatives.

Every entry of D(q) is a trigonometric polynomial of degree two at most in each revolute joint, and a
polynomial of degree two at most in each prismatic one; G(q) is of degree one. So samples on a grid of five
(three) values per joint give its coefficients, and sums of their magnitudes bound derivatives everywhere.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.arrays import Array
from armgpi.errors import ParameterError
from armgpi.robot.robot import Robot

#: Most samples of a grid: eight revolute joints.
_MOST = 5**8
#: Coefficients below this share of the largest sum are rounding; what is dropped is far below the share
#: by which :mod:`armgpi.certification.proofs` rounds outward.
_DROPPED = 1e-14
#: Share by which a polynomial may differ from what it was made from, at configurations off the grid.
_EQUAL = 1e-11
_Complex = npt.NDArray[np.complex128]


class Polynomial(NamedTuple):
    """A function of configurations with values of some shape: the real part of a sum.

    Each term is ``coefficient * exp(1j * frequencies @ q) * prod(q ** powers)``.

    Attributes:
        frequencies: of the revolute joints, zero for the others, shape (terms, n).
        powers: of the prismatic joints, zero for the others, shape (terms, n).
        coefficients: complex, shape (terms, *shape).
    """

    frequencies: Array
    powers: Array
    coefficients: _Complex

    def at(self, q: Array) -> Array:
        """Return values at configurations (k, n), shape (k, *shape)."""
        waves = np.exp(1j * (q @ self.frequencies.T)) * np.prod(q[:, None] ** self.powers, axis=2)
        return np.asarray(np.tensordot(waves, self.coefficients, axes=1).real)

    def bound(self, reach: Array, joint: int) -> Array:
        """Return bounds on the magnitude of the partial derivative by a joint, everywhere, shape `shape`.

        Args:
            reach: largest ``|q|`` of the prismatic joints [m], shape (n,).
            joint: which one.
        """
        derivative = self.derivative(joint)
        most = np.prod(np.where(self.powers > 0, reach**self.powers, 1.0), axis=1)
        return np.asarray(np.tensordot(most, np.abs(derivative.coefficients), axes=1))

    def derivative(self, joint: int) -> Polynomial:
        """Return the partial derivative by a joint, with the same terms."""
        shape = (-1, *(1 for _ in self.coefficients.shape[1:]))
        coefficients = 1j * self.frequencies[:, joint].reshape(shape) * self.coefficients
        slides = np.flatnonzero(self.powers[:, joint])
        if len(slides):
            terms = np.concatenate([self.frequencies, self.powers], axis=1)
            row = {tuple(term): i for i, term in enumerate(terms.tolist())}
            lower = terms[slides]
            lower[:, self.powers.shape[1] + joint] -= 1
            coefficients[[row[tuple(term)] for term in lower.tolist()]] += (
                self.powers[slides, joint].reshape(shape) * self.coefficients[slides]
            )
        return self._replace(coefficients=coefficients)

    def mapped(self, function: Callable[[_Complex], _Complex]) -> Polynomial:
        """Return the polynomial with the coefficients that a linear function makes of these."""
        return Polynomial(self.frequencies, self.powers, function(self.coefficients))


class Expansion(NamedTuple):
    """What a polynomial is near some configurations.

    Attributes:
        value: shape (k, *shape).
        slopes: first derivatives, shape (k, n, *shape).
        seconds: second ones, in the order of :attr:`Expandable.pairs`, shape (k, pairs, *shape).
    """

    value: Array
    slopes: Array
    seconds: Array


class _Part(NamedTuple):
    """Columns of an expansion that have the same terms: which terms and columns, and the different ones."""

    terms: npt.NDArray[np.intp]
    columns: npt.NDArray[np.intp]
    table: Array
    back: npt.NDArray[np.intp]


class Expandable:
    """A polynomial whose expansions are quickly had, with bounds on what is beyond them.

    Attributes:
        pairs: joints (i, j), i <= j, by which second derivatives are not zero everywhere.
        thirds: bounds on the magnitudes of third derivatives, shape (n, n, n, *shape).
    """

    def __init__(self, polynomial: Polynomial, reach: Array) -> None:
        """Take a polynomial; `reach` is the largest ``|q|`` of prismatic joints [m], shape (n,)."""
        self.joints, self.shape = len(reach), polynomial.coefficients.shape[1:]
        first = [polynomial.derivative(j) for j in range(self.joints)]
        second = {
            (i, j): first[i].derivative(j)
            for i, j in itertools.combinations_with_replacement(range(self.joints), 2)
        }
        self.pairs = [pair for pair, each in second.items() if each.coefficients.any()]
        self.thirds = np.zeros((self.joints,) * 3 + self.shape)
        for (i, j), k in itertools.product(self.pairs, range(self.joints)):
            self.thirds[i, j, k] = self.thirds[j, i, k] = second[i, j].bound(reach, k)
        # Real values: a wave and its mirror image are one cosine and one sine.
        frequencies = polynomial.frequencies
        leading = np.array([next((x for x in row if x), 0) for row in frequencies])
        kept = leading >= 0
        self._frequencies, self._powers = frequencies[kept].T.astype(float), polynomial.powers[kept]
        columns = [polynomial, *first, *(second[pair] for pair in self.pairs)]
        table = np.stack([each.coefficients.reshape(len(kept), -1) for each in columns], axis=1)
        table = (np.where(leading == 0, 1.0, 2.0)[:, None, None] * table)[kept].reshape(kept.sum(), -1)
        self._columns = table.shape[1]
        self._parts = self._sparse(table)

    def _sparse(self, table: _Complex) -> list[_Part]:
        """Return the columns that are not zero, those of the same terms together: few have all of them."""
        groups: dict[bytes, list[int]] = {}
        for column, used in enumerate((table != 0.0).T):
            if used.any():
                groups.setdefault(self._joints_of(used).tobytes(), []).append(column)
        parts = []
        for columns in groups.values():
            some = table[:, columns]
            terms = np.flatnonzero((some != 0.0).any(axis=1))
            # A symmetric matrix has every column twice.
            unique, back = np.unique(some[terms], axis=1, return_inverse=True)
            waves = np.concatenate([unique.real, -unique.imag])
            parts.append(_Part(terms, np.asarray(columns), waves, np.ravel(back)))
        return parts

    def _joints_of(self, used: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        """Return by which joints some terms differ."""
        turns = self._frequencies[:, used].any(axis=1)
        return np.asarray(turns | self._powers[used].any(axis=0))

    def at(self, q: Array) -> Expansion:
        """Return the expansions at configurations (k, n)."""
        phase = q @ self._frequencies
        cosines, sines = np.cos(phase), np.sin(phase)
        for joint in np.flatnonzero(self._powers.any(axis=0)):
            scale = q[:, [joint]] ** self._powers[:, joint]
            cosines, sines = cosines * scale, sines * scale
        values = np.zeros((len(q), self._columns))
        for part in self._parts:
            waves = np.concatenate([cosines[:, part.terms], sines[:, part.terms]], axis=1)
            values[:, part.columns] = (waves @ part.table)[:, part.back]
        values = values.reshape(len(q), -1, *self.shape)
        return Expansion(values[:, 0], values[:, 1 : 1 + self.joints], values[:, 1 + self.joints :])


def stacked(polynomials: Sequence[Polynomial]) -> Polynomial:
    """Return polynomials of the same terms as one, with a first axis for which."""
    first = polynomials[0]
    coefficients = np.stack([each.coefficients for each in polynomials], axis=1)
    return Polynomial(first.frequencies, first.powers, coefficients)


def polynomials_of(robots: Sequence[Robot]) -> list[tuple[Polynomial, Polynomial]]:
    """Return D and G of robots with the same joints, all with the same terms.

    Raises:
        ParameterError: when there are too many joints, or a robot's D or G is no such polynomial (a joint
            that follows another turns by a multiple of it).
    """
    robot = robots[0]
    n = robot.n
    grids = [
        np.array([-1.0, 0.0, 1.0]) if slides else 2 * np.pi * np.arange(5) / 5 for slides in robot.prismatic
    ]
    count = math.prod(map(len, grids))
    if count > _MOST:
        raise ParameterError("robot", robot.name, f"at most 8 joints for a proof, not {n}; lock some")
    q = np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, n)
    samples = np.concatenate(
        [
            np.concatenate([each.mass_matrix(q), each.gravity(q)[..., None]], axis=-1)[:, None]
            for each in robots
        ],
        axis=1,
    )
    values: _Complex = samples.reshape(*map(len, grids), *samples.shape[1:]).astype(complex)
    inverse = np.linalg.inv(np.vander([-1.0, 0.0, 1.0], 3, increasing=True))
    for joint, slides in enumerate(robot.prismatic):
        if slides:
            values = np.moveaxis(np.tensordot(inverse, values, axes=(1, joint)), 0, joint)
        else:
            values = np.fft.fft(values, axis=joint) / 5
    terms = np.array(
        list(itertools.product(*([0, 1, 2] if s else [0, 1, 2, -2, -1] for s in robot.prismatic)))
    )
    values = values.reshape(len(terms), *samples.shape[1:])
    large = np.abs(values) > _DROPPED * _scale(np.abs(values).sum(axis=0))
    constant = ~terms.any(axis=1)
    # With sliding joints all: a derivative has the terms of lower powers.
    kept = large.reshape(len(terms), -1).any(axis=1) | constant | robot.prismatic.any()
    terms, values = terms[kept], values[kept]
    whole = Polynomial(np.where(robot.prismatic, 0, terms), np.where(robot.prismatic, terms, 0), values)
    _check(robots, whole)
    return [
        (whole.mapped(lambda c, i=i: c[:, i, :, :n]), whole.mapped(lambda c, i=i: c[:, i, :, n]))  # type: ignore[misc]
        for i in range(len(robots))
    ]


def _scale(size: Array) -> Array:
    """Return how large entries of D and G are as parts of their matrix or vector, (robots, n, n + 1)."""
    D, G = size[..., :-1], size[..., -1:]
    diagonal = np.sqrt(np.diagonal(D, axis1=-2, axis2=-1))
    whole = diagonal[..., :, None] * diagonal[..., None, :]
    return np.asarray(
        np.concatenate([whole, np.broadcast_to(G.max(axis=1, keepdims=True), G.shape)], axis=-1)
    )


def _check(robots: Sequence[Robot], whole: Polynomial) -> None:
    """Hold the polynomials against what they were made from, off the grid."""
    q = np.random.default_rng(0).uniform(-3.0, 3.0, (32, robots[0].n))
    values = whole.at(q)
    for i, robot in enumerate(robots):
        D, G = robot.mass_matrix(q), robot.gravity(q)
        for made, given in ((values[:, i, :, :-1], D), (values[:, i, :, -1], G)):
            if np.abs(made - given).max() > _EQUAL * max(np.abs(given).max(), 1e-30):
                expected = "a robot in which no joint follows another, for a proof; lock those that do"
                raise ParameterError("robot", robot.name, expected)
