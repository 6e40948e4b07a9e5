"""Functions of a robot's configuration as trigonometric polynomials, and hulls of their values in cells.

Every entry of D(q) is a trigonometric polynomial of degree two at most in each revolute joint, and a
polynomial of degree two at most in each prismatic one; G(q) is of degree one. So samples on a grid of five
(three) values per joint give its coefficients.

In a piece of 0.2 rad each way, sin 2x and cos 2x are affine in sin x and cos x, but for 0.002: what is left
out is bounded. The rest is affine in the point (cos x, sin x) of each joint alone, and that point is in
a triangle: the two ends of its arc, and where the tangents at the ends meet. So all values in a cell are
within the hull of those at the corners of a product of triangles. What is linear in a cell makes that hull no
larger than need be, so its excess falls with the square of the width.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array
from armgpi.errors import ParameterError
from armgpi.robot.robot import Robot

#: Most samples of a grid: eight revolute joints.
_MOST = 5**8
#: Share by which a polynomial may differ from what it was made from, at configurations off the grid.
_EQUAL = 1e-11
#: Most that a joint may leave out of the first polynomial, as a share of its size.
_LEFT_OUT = 3e-4


#: Half of what a joint turns in a piece, at most [rad], and half of an arc of which tangents are taken.
_WIDEST, _TANGENTS = 0.7, 1.4


class Polynomial(NamedTuple):
    """A function of configurations with values of some shape.

    It is a sum of products of functions of one joint's distance x from a center each: 1, cos x, sin x, cos 2x
    and sin 2x of a revolute joint; 1, x and x^2 of a prismatic one; 1 of a joint that does not enter.

    Attributes:
        center: [rad or m], shape (n,).
        prismatic: which joints are, shape (n,).
        coefficients: of the products, shape (*functions of each joint, *shape).
    """

    center: Array
    prismatic: npt.NDArray[np.bool_]
    coefficients: Array

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of a value."""
        return self.coefficients.shape[len(self.center) :]

    def at(self, q: Array) -> Array:
        """Return values at configurations (k, n), shape (k, *shape)."""
        distance = q - self.center
        values = np.broadcast_to(self.coefficients, (len(q), *self.coefficients.shape))
        for joint, slides in enumerate(self.prismatic):
            terms = values.shape[1]
            weights = _functions(distance[:, joint], slides)[:terms]
            values = np.einsum("fk,kf...->k...", weights, values)
        return np.asarray(values)

    def derivative(self, joint: int) -> Polynomial:
        """Return the partial derivative by a joint."""
        matrix = np.zeros((5, 5))
        if self.prismatic[joint]:
            matrix[0, 1] = 1.0  # of x
            matrix[1, 2] = 2.0  # of x^2
        else:
            matrix[1, 2] = 1.0  # of sin x
            matrix[2, 1] = -1.0  # of cos x
            matrix[3, 4] = 2.0  # of sin 2x
            matrix[4, 3] = -2.0  # of cos 2x
        size = self.coefficients.shape[joint]
        return self._replace(coefficients=_along(self.coefficients, joint, matrix[:size, :size]))

    def map_values(self, function: Callable[[Array], Array]) -> Polynomial:
        """Return the polynomial whose values a linear function makes of these; it takes (k, *shape)."""
        terms = self.coefficients.shape[: len(self.center)]
        values = function(self.coefficients.reshape(-1, *self.shape))
        return self._replace(coefficients=values.reshape(*terms, *values.shape[1:]))


class Cell(NamedTuple):
    """A box of configurations within a piece, and the values that polynomials have in it.

    Attributes:
        piece: of which it is a part.
        center: its distance from the piece's [rad or m], shape (n,).
        half: half of its widths, shape (n,).
    """

    piece: Piece
    center: Array
    half: Array

    def hull(self) -> list[Array]:
        """Return values of each polynomial, shape (*3 or 1 for each joint, *shape): theirs are in the hull.

        The first and the last one of each joint are those at the ends.
        """
        return self._values(_corners)

    def middle(self) -> list[Array]:
        """Return the values of each polynomial at the center, but for what is beyond, shape `shape`."""

        def at_center(x: float, _: float, slides: bool) -> Array:
            return _functions(x, slides)[None, :3]

        first = (0,) * len(self.half)
        return [values[first] for values in self._values(at_center)]

    def halves(self, joint: int) -> list[Cell]:
        """Return the two halves of a cell along a joint."""
        step = np.zeros_like(self.half)
        step[joint] = self.half[joint] / 2
        half = self.half - step
        above = self._replace(center=self.center + step, half=half)
        below = self._replace(center=self.center - step, half=half)
        return [above, below]

    def _values(self, functions: Callable[[float, float, bool], Array]) -> list[Array]:
        """Return sums of the piece's coefficients, weighted by functions of each joint."""
        table = self.piece.table
        for joint, slides in enumerate(self.piece.prismatic):
            if table.shape[joint] > 1:
                weights = functions(self.center[joint], self.half[joint], slides)
                table = _along(table, joint, weights)
        return self.piece.split(table)


class Piece(NamedTuple):
    """Polynomials in a box of configurations, of degree one in each revolute joint.

    Attributes:
        prismatic: which joints are, shape (n,).
        table: coefficients of all polynomials beside each other, of products of 1, cos x and sin x, or of
            1, x and x^2, of distances from the center.
        beyond: bounds on what that leaves out of each polynomial, of their shapes.
    """

    prismatic: npt.NDArray[np.bool_]
    table: Array
    beyond: list[Array]

    def split(self, table: Array) -> list[Array]:
        """Return the columns of each polynomial, in its shape."""
        ends = np.cumsum([bound.size for bound in self.beyond])[:-1]
        columns = np.split(table, ends, axis=-1)
        split = []
        for part, bound in zip(columns, self.beyond, strict=True):
            split.append(part.reshape(*table.shape[:-1], *bound.shape))
        return split


def pieces(polynomials: Sequence[Polynomial], half: Array, margin: Array) -> Iterator[Cell]:
    """Yield the box around the center of some polynomials as cells, each the whole of a piece.

    Args:
        polynomials: of the same joints and center; little is left out of the first one.
        half: half of the widths of the box [rad or m], shape (n,).
        margin: by how much cells may be made larger on each side [rad or m], shape (n,).
    """
    first = polynomials[0]
    terms = first.coefficients.shape[: len(half)]
    columns = [each.coefficients.reshape(*terms, -1) for each in polynomials]
    table = np.concatenate(columns, axis=-1)
    ends = np.cumsum([math.prod(each.shape) for each in polynomials])[:-1]
    cut = _Cut(first, half, margin, table)
    nothing_beyond = np.zeros(table.shape[-1])
    for plain, beyond in cut.visit(0, cut.table, cut.sups, nothing_beyond):
        left_out = []
        for part, polynomial in zip(np.split(beyond, ends), polynomials, strict=True):
            left_out.append(part.reshape(polynomial.shape))
        piece = Piece(first.prismatic, plain, left_out)
        yield Cell(piece, np.zeros(len(half)), cut.widths)


class _Cut:
    """How a box is cut into pieces.

    Attributes:
        table: coefficients of the functions of :func:`_local`, for the whole box.
        sups: the largest values of these functions, of each joint.
        counts: into how many parts each joint's range is cut; 0 where nothing is left out.
        widths: half the widths of the parts [rad or m], shape (n,).
    """

    def __init__(self, first: Polynomial, half: Array, margin: Array, table: Array) -> None:
        """Take coefficients of all polynomials; of the first one little is left out."""
        self.prismatic = first.prismatic
        self.half = half
        self.margin = margin
        self.sups: list[Array] = []
        self._back = []
        for joint, size in enumerate(table.shape[:-1]):
            widest = half[joint] + margin[joint]
            basis, largest = _local(0.0, widest, first.prismatic[joint])
            table = _along(table, joint, basis[:size, :size])
            self.sups.append(largest[:size])
            self._back.append(np.linalg.inv(basis))
        self.table = table
        scale = _scale(first)
        self.counts: list[int] = []
        for joint, size in enumerate(table.shape[:-1]):
            is_cut = size == 5  # sin 2x and cos 2x enter
            self.counts.append(self._count_parts(joint, scale) if is_cut else 0)
        self.widths = half / np.maximum(self.counts, 1)

    def _count_parts(self, j: int, scale: Array) -> int:
        """Return into how many parts a joint's range has to be cut."""
        count = max(1, math.ceil(float(self.half[j]) / _WIDEST))
        # Parts that are narrower than the margin leave out no less.
        while self.half[j] > count * self.margin[j]:
            beyond = next(self._parts(j, count, self.table, self.sups))[2]
            if (beyond[: len(scale)] <= _LEFT_OUT * scale).all():
                break
            count += 1
        return count

    def _parts(
        self, j: int, count: int, table: Array, sups: list[Array]
    ) -> Iterator[tuple[Array, list[Array], Array]]:
        """Yield a table in each part of a joint's range, the maxima there, and bounds on what is left out."""
        for k in range(count):
            center = (2 * k + 1) * self.half[j] / count - self.half[j]
            widest = self.half[j] / count + self.margin[j]
            local, largest = _local(center, widest, False)
            in_part = _along(table, j, local @ self._back[j])
            kept, left_out = np.split(in_part, [3], axis=j)
            before, after = sups[:j], sups[j + 1 :]
            beyond = np.abs(left_out)
            for sup in (*before, largest[3:], *after):
                beyond = np.tensordot(sup, beyond, axes=1)
            yield kept, [*before, largest[:3], *after], beyond

    def visit(self, j: int, table: Array, sups: list[Array], beyond: Array) -> Iterator[tuple[Array, Array]]:
        """Yield the tables of all pieces, cut along the joints from j on, and what is left out of each."""
        if j == len(self.counts):
            yield self._as_plain(table), beyond
        elif not self.counts[j]:
            yield from self.visit(j + 1, table, sups, beyond)
        else:
            for part, sups_there, left_out in self._parts(j, self.counts[j], table, sups):
                yield from self.visit(j + 1, part, sups_there, beyond + left_out)

    def _as_plain(self, table: Array) -> Array:
        """Return coefficients of 1, cos x and sin x for those of 1, sin x and cos x less its middle."""
        for joint, slides in enumerate(self.prismatic):
            if slides or table.shape[joint] == 1:
                continue
            middle = _middle(float(self.widths[joint] + self.margin[joint]))
            matrix = np.array(
                [
                    [1.0, 0.0, -middle],  # 1
                    [0.0, 0.0, 1.0],  # cos x
                    [0.0, 1.0, 0.0],  # sin x
                ]
            )
            table = _along(table, joint, matrix)
        return table


def _scale(polynomial: Polynomial) -> Array:
    """Return how large the entries are: of a matrix by its diagonal, which is positive, of others at most."""
    joints = len(polynomial.center)
    if len(polynomial.shape) == 2:
        mean = polynomial.coefficients[(0,) * joints]
        size = np.sqrt(np.abs(np.diagonal(mean)))
        return np.asarray(np.outer(size, size)).ravel()
    every_joint = tuple(range(joints))
    most = np.abs(polynomial.coefficients).sum(axis=every_joint)
    return np.full(most.size, most.max())


def _functions(x: Array | float, slides: bool) -> Array:
    """Return the functions of a joint at distances from its center, shape (functions, ...)."""
    x = np.asarray(x)
    one = np.ones_like(x)
    if slides:
        return np.stack([one, x, x * x])
    return np.stack([one, np.cos(x), np.sin(x), np.cos(2 * x), np.sin(2 * x)])


def _corners(x: float, half: float, slides: bool) -> Array:
    """Return 1 and a corner of a joint's triangle in each row: an end, where tangents meet, the other end."""
    low_end = _functions(x - half, slides)[:3]
    high_end = _functions(x + half, slides)[:3]
    if slides:
        apex = np.array([1.0, x, x * x - half * half])
    elif half > _TANGENTS:  # they meet too far away, or behind: a triangle around the whole circle
        third = math.pi / 1.5
        angles = x + third * np.array([-1.0, 0.0, 1.0])
        on_circle = _functions(angles, slides)[:3].T
        return np.asarray(on_circle * [1.0, 2.0, 2.0])
    else:
        apex = np.array([1.0, math.cos(x) / math.cos(half), math.sin(x) / math.cos(half)])
    return np.array([low_end, apex, high_end])


def _middle(half: float) -> float:
    """Return the middle of the values of cos x for x within half a width."""
    return 0.5 * (1.0 + math.cos(min(half, math.pi)))


def _local(center: float, half: float, slides: bool) -> tuple[Array, Array]:
    """Return what makes coefficients of 1, sin t, cos t - m, r and s of those of a joint, and their maxima.

    t is the distance from a center, at most `half`; r and s are what is left of sin 2t and cos 2t.
    """
    if slides:
        return np.eye(3), half ** np.arange(3.0)
    half = min(half, math.pi)
    m = _middle(half)
    away = 0.5 * (1.0 - math.cos(half))  # of cos t from m, at most
    near = 0.25 * (1.0 + 3.0 * math.cos(half))  # b below
    # sin 2t - 2 b sin t is largest at an end or where its derivative 4 c^2 - 2 b c - 2 is zero, c = cos t.
    discriminant = math.sqrt(near * near + 8.0)
    candidates = [half]
    for sign in (1.0, -1.0):
        c = 0.25 * (near + sign * discriminant)
        if -1.0 <= c <= 1.0 and math.acos(c) <= half:
            candidates.append(math.acos(c))
    r = max(abs(math.sin(2 * t) - 2.0 * near * math.sin(t)) for t in candidates)
    largest_sine = math.sin(min(half, math.pi / 2))
    sup = np.array([1.0, largest_sine, away, r, away * away])
    # In terms of 1, sin t, cos t - m, r and s: cos 2t = 2 (m + x)^2 - 1 with x = cos t - m, and 2 x^2 is
    # away^2 but for away^2.
    cosine = np.array([m, 0.0, 1.0, 0.0, 0.0])
    sine = np.array([0.0, 1.0, 0.0, 0.0, 0.0])
    double_cosine = np.array([2 * m * m - 1 + away * away, 0.0, 4 * m, 0.0, 1.0])
    double_sine = np.array([0.0, 2.0 * near, 0.0, 1.0, 0.0])
    # The joint's functions are those of center + t.
    C, S = math.cos(center), math.sin(center)
    C2, S2 = math.cos(2 * center), math.sin(2 * center)
    columns = [
        np.eye(5)[0],
        C * cosine - S * sine,
        S * cosine + C * sine,
        C2 * double_cosine - S2 * double_sine,
        S2 * double_cosine + C2 * double_sine,
    ]
    return np.stack(columns, axis=1), sup


def _along(table: Array, axis: int, matrix: Array) -> Array:
    """Return a matrix times a table along an axis."""
    shape = table.shape
    flat = table.reshape(math.prod(shape[:axis]), shape[axis], -1)
    return np.asarray((matrix @ flat).reshape(*shape[:axis], len(matrix), *shape[axis + 1 :]))


def stack_polynomials(polynomials: Sequence[Polynomial]) -> Polynomial:
    """Return polynomials as one, with a first axis of its values for which."""
    first = polynomials[0]
    joints = len(first.center)
    return first._replace(coefficients=np.stack([each.coefficients for each in polynomials], axis=joints))


def polynomials_of(robots: Sequence[Robot], center: Array) -> list[tuple[Polynomial, Polynomial]]:
    """Return D and G of robots with the same joints.

    Args:
        robots: whose they are.
        center: of the polynomials [rad or m], shape (n,).

    Raises:
        ParameterError: when there are too many joints, or a robot's D or G is no such polynomial (a joint
            that follows another turns by a multiple of it).
    """
    robot = robots[0]
    grids = _grids(robots)
    q = center + np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, robot.n)
    found = []
    for each in robots:
        gravity = each.gravity(q)[..., None]
        table = np.concatenate([each.mass_matrix(q), gravity], axis=-1)
        table = table.reshape(*map(len, grids), robot.n, robot.n + 1)
        for joint, (grid, slides) in enumerate(zip(grids, robot.prismatic, strict=True)):
            functions = _functions(grid, slides)[: len(grid)]
            interpolating = np.asarray(np.linalg.inv(functions.T), float)
            table = _along(table, joint, interpolating)
        whole = Polynomial(center, robot.prismatic, table)
        _check(each, whole)
        D = whole.map_values(lambda c: c[..., :-1])
        G = whole.map_values(lambda c: c[..., -1])
        found.append((D, G))
    return found


def _grids(robots: Sequence[Robot]) -> list[Array]:
    """Return the distances of each joint from its center at which D and G are sampled [rad or m].

    Raises:
        ParameterError: when they are too many samples.
    """
    robot = robots[0]
    grids = []
    for slides in robot.prismatic:
        circle = 2 * np.pi * np.arange(5) / 5
        grids.append(np.array([-1.0, 0.0, 1.0]) if slides else circle)
    if math.prod(map(len, grids)) > _MOST:
        raise ParameterError("robot", robot.name, f"at most 8 joints for a proof, not {robot.n}; lock some")
    for joint, enters in enumerate(_entering(robots)):
        if not enters:
            grids[joint] = grids[joint][:1]
    return grids


def _entering(robots: Sequence[Robot]) -> list[bool]:
    """Return by which joints D and G of some robots change."""
    n = robots[0].n
    rng = np.random.default_rng(1)
    q = rng.uniform(-3.0, 3.0, (16, n))
    found = []
    for j in range(n):
        elsewhere = rng.uniform(-3.0, 3.0, q.shape)
        moved = np.where(np.arange(n) == j, elsewhere, q)
        found.append(any(_differs(robot, q, moved) for robot in robots))
    return found


def _differs(robot: Robot, q: Array, moved: Array) -> bool:
    """Tell whether D or G of a robot differ between configurations (k, n) by more than rounding."""
    for function in (robot.mass_matrix, robot.gravity):
        before = function(q)
        change = np.abs(before - function(moved)).max()
        if change > _EQUAL * np.abs(before).max():
            return True
    return False


def _check(robot: Robot, whole: Polynomial) -> None:
    """Hold a polynomial against what it was made from, off the grid."""
    q = np.random.default_rng(0).uniform(-3.0, 3.0, (32, robot.n))
    values = whole.at(q)
    pairs = (
        (values[..., :-1], robot.mass_matrix(q)),
        (values[..., -1], robot.gravity(q)),
    )
    for polynomial, function in pairs:
        scale = max(np.abs(function).max(), 1e-30)
        if np.abs(polynomial - function).max() > _EQUAL * scale:
            expected = "a robot in which no joint follows another, for a proof; lock those that do"
            raise ParameterError("robot", robot.name, expected)
