"""Bayesian least squares with the file as a wide prior, made physical, with intervals."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy import linalg, sparse

from armgpi.base.arrays import Array
from armgpi.errors import ParameterError, import_extra
from armgpi.identification.weak_form import BODY, COLUMNS, COULOMB, OFFSET, ROTOR, VISCOUS
from armgpi.plants.reality import scales
from armgpi.robot.repairs import SUPPOSE, made_in
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import told_none, typical_inertia, with_published

#: Standard deviations that a maker's file has, chosen wide. Mass: a share of the link's, and of the arm's for
#: the last one, which may carry something. Rotor: a share, so that four times either way is within. Friction
#: and offset: shares of the gravity torque. Supposed masses are within four times either way.
_SUPPOSED = 3.0
_MASS = 0.5
_CARRIED = 0.1
_ROTOR = 3.0
_FRICTION = 0.3
_OFFSET = 0.05
#: Least gravity torque that friction is taken to be in shares of, over that of the largest joint.
_RUBS = 0.3
#: Least radius of gyration [m].
_RADIUS = 0.03
#: Reach of what the last link may carry [m].
_REACH = 0.1
#: Least mass of a link that is expected, as a share of the arm's.
_LEAST_MASS = 0.01
#: Standard deviation of the lag [s].
_LAG = 0.02
#: Torque [N m or N] and residual, as a share of a joint's torque, that count as zero: less is rounding,
#: and weights by it would hide the prior behind a rounding of their own.
_LEAST_TORQUE = 1e-9
_EXACT = 1e-5
#: Reweightings of the joints.
_REWEIGHTINGS = 4
#: Torque over residual that the first one begins with.
_TRUST = 1e3
#: Test functions over which moments are correlated besides what overlaps: misfit lasts longer than noise.
_CORRELATED = 6
#: Factor on that covariance for misfit that is not in the residuals: chosen so that 95 % intervals hold for
#: panda and ur5 (tools/identification.py, seed 100; docs/identify.md has other seeds and arms).
_UNSEEN = 2.0
#: So many moments count as one beside the prior: neighbours overlap, and misfit lasts longer than noise and
#: repeats. Without it gravity got worse than the file's where an arm on soft gears had moved little.
_ALIKE = 10.0
#: Share of the overlapping moments that are independent, for the degrees of freedom.
_INDEPENDENT = 0.5
#: Least eigenvalue of a pseudo-inertia in the solver's scale.
_MARGIN = 1e-5
#: Least rotor as a share of the expected one.
_LEAST_ROTOR = 1e-3
#: Friction below this, in standard deviations of what is expected, is none.
_NO_FRICTION = 1e-9
#: Rows and columns of the second moments of a body, in the order of :data:`BODY`.
_MOMENTS = (
    (0, 0),
    (0, 1),
    (1, 1),
    (0, 2),
    (1, 2),
    (2, 2),
)
#: Half width of a 95 % interval in standard deviations.
HALF_95 = 1.96
#: What the solver says of a point that it found, the second to less accuracy.
_SOLVED = ("Solved", "AlmostSolved")


class Prior(NamedTuple):
    """What is expected of the unknowns before the log; arrays of shape (p,).

    Attributes:
        mean: expected values.
        std: standard deviations.
        bodies: number of pseudo-inertias; the unknowns begin with ten columns of each, at `body_places`.
        body_places: index of the first of the ten parameters of each body.
        positive: indices of what cannot be negative.
    """

    mean: Array
    std: Array
    body_places: tuple[int, ...]
    positive: tuple[int, ...]


class Block(NamedTuple):
    """The regression of one log.

    Attributes:
        rows: (k, n, p).
        torque: (k, n).
        valid: which moments are used, (k, n).
        phase: of the excitation, in test functions; those of equal phase repeat, shape (k,).
    """

    rows: Array
    torque: Array
    valid: npt.NDArray[np.bool_]
    phase: npt.NDArray[np.intp]


class Fit(NamedTuple):
    """What a regression gives, in units of the prior's standard deviations around its mean.

    Attributes:
        free: the most likely unknowns, physical or not, (p,).
        physical: the most likely of those that are physical, (p,).
        information: of data and prior, (p, p).
        covariance: of the free unknowns, (p, p).
        learned: share of each unknown that the data decide, (p,).
        residuals: of each block, (k, n); NaN where a moment is not used.
        weights: of the joints, over their residuals [1/(N m s)], (n,).
    """

    free: Array
    physical: Array
    information: Array
    covariance: Array
    learned: Array
    residuals: list[Array]
    weights: Array


def expect(robot: Robot) -> Prior:
    """Return what a URDF says of an arm, with how far a maker's file may be wrong.

    Rotors and friction are those published for the arm, where the URDF contains none.
    """
    robot = with_published(robot)
    n, size = robot.n, scales(robot)
    mean, std = np.zeros((2, n, len(COLUMNS)))
    for i, expected in enumerate(_expected_bodies(robot, size.mass)):
        mean[i, : len(BODY)], std[i, : len(BODY)] = expected
    mean[:, ROTOR] = np.where(robot.armature > 0.0, robot.armature, typical_inertia(robot))
    std[:, ROTOR] = _ROTOR * mean[:, ROTOR]
    mean[:, VISCOUS], mean[:, COULOMB] = robot.friction
    # Gears rub at joints that carry no weight, too.
    carried_torque = np.maximum(size.gravity, _RUBS * size.gravity.max())
    friction = _FRICTION * carried_torque
    std[:, VISCOUS] = std[:, COULOMB] = friction
    std[:, VISCOUS] += mean[:, VISCOUS]
    std[:, COULOMB] += mean[:, COULOMB]
    mean[:, OFFSET] = robot.drives.value("offset", 0.0)
    std[:, OFFSET] = _OFFSET * size.gravity
    places = [i * len(COLUMNS) for i in range(n)]
    positive = [place + k for place in places for k in (ROTOR, COULOMB, VISCOUS)]
    return Prior(mean.ravel(), std.ravel(), tuple(places), tuple(positive))


def _expected_bodies(robot: Robot, arm_mass: float) -> Iterator[tuple[Array, Array]]:
    """Give the ten parameters of each body and their standard deviations, each (10,).

    Args:
        robot: the arm.
        arm_mass: its mass [kg].
    """
    model = robot.pinocchio_model()
    width = _SUPPOSED if is_supposed(robot) else _MASS
    tip = model.frames[model.getFrameId(robot.tip, pin.FrameType.BODY)]
    for joint in range(1, robot.n + 1):
        body = model.inertias[joint]
        is_last = joint == int(tip.parentJoint)
        carried = _CARRIED * arm_mass if is_last else 0.0
        mass = width * max(body.mass, _LEAST_MASS * arm_mass) + carried
        second_moments = body.toPseudoInertia().toMatrix()[:3, :3]
        square = float(np.trace(second_moments)) / max(body.mass, 1e-9)
        radius = math.sqrt(max(square, _RADIUS**2)) + (_REACH if carried else 0.0)
        std = np.repeat([mass, mass * radius, mass * radius**2], [1, 3, 6])
        yield body.toDynamicParameters(), std


def planned_rotors(robot: Robot) -> Array:
    """Return the rotor inertia that a motion is planned with [kg m^2 or kg], (n,).

    It is what is expected of the arm, and none where the user specified that there is none.
    """
    mean = expect(robot).mean.reshape(robot.n, len(COLUMNS))
    rotors = mean[:, ROTOR].copy()
    rotors[np.isin(robot.joint_names, told_none(robot))] = 0.0
    return rotors


def is_supposed(robot: Robot) -> bool:
    """Tell whether the file of an arm has no masses."""
    return any(name.startswith(SUPPOSE) for name in made_in(robot.provenance))


def extend(prior: Prior, std: Array, body: bool = False) -> Prior:
    """Return a prior with more unknowns around zero, of which the first ten may be those of a body."""
    places = (*prior.body_places, len(prior.mean)) if body else prior.body_places
    mean = np.append(prior.mean, np.zeros(len(std)))
    return prior._replace(mean=mean, std=np.append(prior.std, std), body_places=places)


def extend_positive(prior: Prior, mean: Array, std: Array) -> Prior:
    """Return a prior with more unknowns that cannot be negative."""
    places = range(len(prior.mean), len(prior.mean) + len(mean))
    return prior._replace(
        mean=np.append(prior.mean, mean),
        std=np.append(prior.std, std),
        positive=(*prior.positive, *places),
    )


def lag_std(count: int) -> Array:
    """Return the standard deviations of lags [s]."""
    return np.full(count, _LAG)


def fit(blocks: Sequence[Block], prior: Prior, physical: bool = True) -> Fit:
    """Return the regression of logs together.

    Joints are weighted by their residuals. The covariance is that of scores summed over equal phases of the
    excitation: what repeats from period to period is misfit, which does not average out.

    Raises:
        MissingPackage: when Clarabel is not installed.
        ParameterError: for logs whose information is not positive definite to rounding.
    """
    data = _Scaled.of(blocks, prior)
    unknowns = len(prior.mean)
    moments = np.maximum(sum(block.valid.sum(axis=0) for block in blocks), 1)
    torques = [np.where(block.valid, block.torque, 0.0) for block in blocks]
    least = np.maximum(_EXACT * _rms_of_joints(torques, moments), _LEAST_TORQUE)
    # At first as if all torque were explained: from the other side, what the prior left would stay.
    weights = 1.0 / np.maximum(_rms_of_joints(data.torques, moments) / _TRUST, least)
    for _ in range(_REWEIGHTINGS):
        information = np.tensordot(weights**2, data.grams, 1) + np.eye(unknowns)
        factor = _factor(information)
        free = linalg.cho_solve(factor, weights**2 @ data.rights)
        residuals = data.residuals(free)
        sizes = math.sqrt(_ALIKE) * _rms_of_joints(residuals, moments)
        weights = 1.0 / np.maximum(sizes, least)
    inverse = linalg.cho_solve(factor, np.eye(unknowns))
    learned = 1.0 - np.diag(inverse)
    phases = [block.phase for block in blocks]
    scores = data.score_covariance(residuals, weights, phases)
    independent = _INDEPENDENT * float(moments.sum())
    free_moments = max(independent - float(learned.sum()), 0.1 * independent)
    spread = _UNSEEN * scores * independent / free_moments
    covariance = inverse @ (spread + np.eye(unknowns)) @ inverse
    shown = []
    for block, residual in zip(blocks, residuals, strict=True):
        shown.append(np.where(block.valid, residual, np.nan))
    nearest = free
    if physical:
        # The information is U' U, so that the columns of the inverse of U are alike in its metric.
        upper, _ = factor
        root = linalg.solve_triangular(upper, np.eye(unknowns), lower=False)
        nearest = project(free, root, prior)
    return Fit(free, nearest, information, covariance, learned, shown, weights)


class _Scaled(NamedTuple):
    """The regressions of some logs, in units of the prior around its mean.

    Attributes:
        rows: of each log, (k, n, p); zero where a moment is not used.
        torques: what is left of its torques by the prior's mean, (k, n), likewise.
        grams: sums of the products of the rows of each joint, (n, p, p).
        rights: sums of the products of its rows and torques, (n, p).
    """

    rows: list[Array]
    torques: list[Array]
    grams: Array
    rights: Array

    @classmethod
    def of(cls, blocks: Sequence[Block], prior: Prior) -> _Scaled:
        """Return those of regressions in SI units."""
        rows, torques = [], []
        for block in blocks:
            rows.append(np.where(block.valid[..., None], block.rows * prior.std, 0.0))
            torques.append(np.where(block.valid, block.torque - block.rows @ prior.mean, 0.0))
        grams: Any = 0.0
        rights: Any = 0.0
        for of_log, torque in zip(rows, torques, strict=True):
            grams = grams + np.einsum("kip,kiq->ipq", of_log, of_log, optimize=True)
            rights = rights + np.einsum("kip,ki->ip", of_log, torque)
        return cls(rows, torques, grams, rights)

    def residuals(self, unknowns: Array) -> list[Array]:
        """Return what unknowns (p,) leave of the torques of each log, (k, n)."""
        return [torque - rows @ unknowns for rows, torque in zip(self.rows, self.torques, strict=True)]

    def score_covariance(
        self, residuals: Sequence[Array], weights: Array, phases: Sequence[npt.NDArray[np.intp]]
    ) -> Array:
        """Return the covariance of the sum of scores, for weights of the joints, (p, p)."""
        total: Any = 0.0
        for rows, left, phase in zip(self.rows, residuals, phases, strict=True):
            scores = np.einsum("kip,i,ki->kp", rows, weights**2, left, optimize=True)
            total = total + _score_covariance(scores, phase)
        return np.asarray(total)


def _rms_of_joints(values: Sequence[Array], moments: Array) -> Array:
    """Return the root mean square of each joint over logs, (n,), where so many moments are used."""
    squares = sum((of_log**2).sum(axis=0) for of_log in values)
    return np.asarray(np.sqrt(squares / moments))


def _factor(information: Array) -> Any:
    """Return the Cholesky factor of an information matrix.

    Raises:
        ParameterError: when it is not positive definite to rounding.
    """
    try:
        return linalg.cho_factor(information)
    except linalg.LinAlgError:
        wanted = "logs of an arm that moves enough to tell its unknowns apart (armgpi excite)"
        raise ParameterError("logs", "one motion", wanted) from None


def _score_covariance(scores: Array, phase: npt.NDArray[np.intp]) -> Array:
    """Return the covariance of a sum of scores (k, p), correlated over some test functions."""
    period = int(phase.max()) + 1
    summed = np.zeros((period, scores.shape[1]))
    np.add.at(summed, phase, scores)
    reach = min(_CORRELATED, max(period // 2 - 1, 0))
    total = summed.T @ summed
    for shift in range(1, reach + 1):
        weight = 1.0 - shift / (reach + 1.0)
        crossed = summed[shift:].T @ summed[:-shift] * weight
        total += crossed + crossed.T
    return np.asarray(total)


def project(free: Array, root: Array, prior: Prior, bounds: tuple[Array, Array] | None = None) -> Array:
    """Return the physical unknowns ``free + root y`` with the shortest y, (p,).

    Physical: every pseudo-inertia positive definite, rotors positive, friction not negative. A log tells some
    combinations of the unknowns to 1e-6 of what is expected, and nothing of others. In coordinates y, in
    which all are alike, a solver finds the nearest point; in those of the unknowns it stops far from it.

    Args:
        free: unknowns, physical or not, in units of the prior's standard deviations, (p,).
        root: a matrix whose product with its transpose is the inverse of the metric's information, (p, p).
        prior: which of them are bodies, and which cannot be negative.
        bounds: lower and upper ones of the unknowns, in the same units, each (p,); infinite where there are
            none. None for none at all.

    Raises:
        MissingPackage: when Clarabel is not installed.
        ParameterError: when the solver finds none.
    """
    clarabel = import_extra("clarabel", "certify")
    rows, right, cones = _constraints(clarabel, prior)
    if bounds is not None:
        more, ends = _bound_rows(*bounds)
        rows, right = np.vstack([more, rows]), np.concatenate([ends, right])
        cones = [clarabel.NonnegativeConeT(len(ends)), *cones]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    size = root.shape[1]
    solver = clarabel.DefaultSolver(
        sparse.identity(size, format="csc"),
        np.zeros(size),
        sparse.csc_matrix(rows @ root),
        right - rows @ free,
        cones,
        settings,
    )
    solution = solver.solve()
    if str(solution.status) not in _SOLVED:
        expected = "logs that a physical arm explains; check their units, the order of joints and the file"
        raise ParameterError("logs", f"no physical arm near them ({solution.status})", expected)
    nearest = free + root @ np.array(solution.x)
    # The solver stops short of a bound by its accuracy: friction of that size is none.
    friction = [i for i in prior.positive if i % len(COLUMNS) != ROTOR]
    none = -prior.mean[friction] / prior.std[friction]
    is_none = nearest[friction] - none < _NO_FRICTION
    nearest[friction] = np.where(is_none, none, nearest[friction])
    return np.asarray(nearest)


def _constraints(clarabel: Any, prior: Prior) -> tuple[Array, Array, list[Any]]:
    """Return A, b and the cones K of b - A x in K, for x in units of the prior."""
    mean = prior.mean
    positive = np.array(prior.positive, dtype=np.intp)
    own_rows = np.zeros((len(positive), len(mean)))
    own_rows[np.arange(len(positive)), positive] = -prior.std[positive]
    is_rotor = positive % len(COLUMNS) == ROTOR
    least = np.where(is_rotor, _LEAST_ROTOR * mean[positive], 0.0)
    rows, right = [own_rows], [mean[positive] - least]
    cones = [clarabel.NonnegativeConeT(len(positive))]
    for place in prior.body_places:
        block, constant = _pseudo_constraints(prior, place)
        rows.append(block)
        right.append(constant)
        cones.append(clarabel.PSDTriangleConeT(4))
    return np.vstack(rows), np.concatenate(right), cones


def _pseudo_constraints(prior: Prior, place: int) -> tuple[Array, Array]:
    """Return A (10, p) and b (10,) of a body whose ten parameters begin at a place.

    The pseudo-inertia is scaled by what is expected of the body, and its upper triangle is column by column.
    """
    body = slice(place, place + len(BODY))
    mean, std = prior.mean[body], prior.std[body]
    mass = std[0]
    length = math.sqrt(std[4] / mass)
    scaling = np.diag([1.0 / length] * 3 + [1.0]) / math.sqrt(mass)
    scaled = scaling @ _pseudo_basis() @ scaling
    triangle = [(row, column) for column in range(4) for row in range(column + 1)]
    rows = np.zeros((len(triangle), len(prior.mean)))
    constants = np.zeros(len(triangle))
    for k, (row, column) in enumerate(triangle):
        is_diagonal = row == column
        entries = scaled[:, row, column] * (1.0 if is_diagonal else math.sqrt(2.0))
        rows[k, body] = -entries * std
        constants[k] = entries @ mean - (_MARGIN if is_diagonal else 0.0)
    return rows, constants


def _bound_rows(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Return A and b of ``A x <= b`` for the bounds that are finite."""
    one_each = np.eye(len(lower))
    below, above = np.isfinite(lower), np.isfinite(upper)
    rows = np.vstack([-one_each[below], one_each[above]])
    return rows, np.concatenate([-lower[below], upper[above]])


def _pseudo_basis() -> Array:
    """Return the pseudo-inertia of each of the ten parameters of a body, shape (10, 4, 4)."""
    basis = np.zeros((len(BODY), 4, 4))
    basis[0, 3, 3] = 1.0
    for k in range(3):
        basis[1 + k, 3, k] = 1.0
        basis[1 + k, k, 3] = 1.0
    for place, (i, j) in enumerate(_MOMENTS, start=4):
        if i == j:
            basis[place, :3, :3] += 0.5 * np.eye(3)
            basis[place, i, i] -= 1.0
        else:
            basis[place, i, j] = -1.0
            basis[place, j, i] = -1.0
    return basis
