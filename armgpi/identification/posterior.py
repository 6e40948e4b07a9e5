"""What logs leave open of an arm, as one normal distribution: draws are made from its file alone."""

from __future__ import annotations

import base64
import binascii
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import LARGEST, Array, check_whole
from armgpi.errors import UrdfError
from armgpi.identification import estimate
from armgpi.identification.estimate import Prior
from armgpi.identification.truncated import combine, draw_truncated
from armgpi.identification.weak_form import BODY, COLUMNS, COULOMB, ROTOR, VISCOUS
from armgpi.robot.batch import RobotBatch
from armgpi.robot.equations import Friction
from armgpi.robot.identified import is_number, read_data
from armgpi.robot.robot import Robot

#: Standard deviation, over that of the prior, below which an unknown is known exactly.
_EXACT = 1e-9


class Posterior(NamedTuple):
    """A normal distribution of the unknowns of the joints within bounds; p is 14 n, see COLUMNS.

    A rotor that a log cannot tell from its link is known to be that of a motor that somebody builds. So the
    distribution is truncated, all unknowns together: a rotor that is bounded from below bounds its link from
    above.

    Attributes:
        mean: the estimate, in SI units, (p,).
        scale: standard deviations of the prior, (p,); positive.
        root: lower triangle whose product with its transpose is the covariance, in units of `scale`, (p, p).
        lower: bounds from below of the unknowns, in SI units, (p,); minus infinity where there is none.
        upper: bounds from above, (p,), likewise; above `lower`.
    """

    mean: Array
    scale: Array
    root: Array
    lower: Array
    upper: Array

    @classmethod
    def of(
        cls,
        mean: Array,
        scale: Array,
        covariance: Array,
        bounds: tuple[Array, Array] | None = None,
    ) -> Posterior:
        """Return the posterior of a covariance.

        Args:
            mean: the estimate, in SI units, (p,).
            scale: standard deviations of the prior, (p,); positive.
            covariance: in units of `scale`, (p, p).
            bounds: lower and upper bounds of the unknowns, each (p,); None for none.
        """
        endless = np.full(len(mean), np.inf)
        lower, upper = (-endless, endless) if bounds is None else bounds
        values, vectors = np.linalg.eigh(covariance)
        root = _triangle(vectors * np.sqrt(np.maximum(values, 0.0)))
        root[np.diag(covariance) == 0.0] = 0.0  # the square root of a rounding is none
        return cls(mean, scale, root, lower, upper)

    def unknowns(self, normal: Array) -> Array:
        """Return the physical unknowns that are nearest to some points of the distribution, (count, p).

        The points are those of the normal distribution truncated to the bounds. Each depends on its own
        standard normal numbers alone. Where nothing is bounded it is ``mean + scale root z``.

        Args:
            normal: standard normal numbers, (count, p).

        Raises:
            MissingPackage: when Clarabel is not installed.
        """
        places = range(0, len(self.mean), len(COLUMNS))
        positive = [place + k for place in places for k in (ROTOR, COULOMB, VISCOUS)]
        # A number that is known exactly has no room for a solver to move it.
        positive = [place for place in positive if self._is_open[place]]
        prior = Prior(self.mean, self.scale, tuple(places), tuple(positive))
        bounds = self._scaled_bounds
        draws = [estimate.project(point, self.root, prior, bounds) for point in self._points(normal)]
        unknowns = self.mean + self.scale * np.array(draws)
        # The solver stops short of a bound by its accuracy.
        return np.clip(unknowns, self.lower, self.upper)

    @property
    def _scaled_bounds(self) -> tuple[Array, Array]:
        """Bounds around the mean in units of `scale`, each (p,)."""
        lower = (self.lower - self.mean) / self.scale
        upper = (self.upper - self.mean) / self.scale
        return lower, upper

    @property
    def _is_open(self) -> npt.NDArray[np.bool_]:
        """Which unknowns are not known exactly, (p,)."""
        std = np.linalg.norm(self.root, axis=1)
        return np.asarray(std > _EXACT, dtype=np.bool_)

    def _points(self, normal: Array) -> Array:
        """Return points of the distribution around its mean in units of `scale`, physical or not, (count, p).

        The bounded unknowns come first in a triangle of their own. They are drawn within their bounds, and
        the others follow them as the covariance says.
        """
        bounded = np.isfinite(self.lower) | np.isfinite(self.upper)
        bounded &= self._is_open
        if not bounded.any():
            return combine(normal, self.root)
        order = np.argsort(~bounded, kind="stable")
        count = int(bounded.sum())
        root = _triangle(self.root[order])
        lower, upper = self._scaled_bounds
        low, high = lower[order[:count]], upper[order[:count]]
        drawn = normal[:, order].copy()
        own_root = root[:count, :count]
        drawn[:, :count] = draw_truncated(own_root, low, high, drawn[:, :count])
        points = np.empty_like(drawn)
        points[:, order] = combine(drawn, root)
        return points

    def sample(self, robot: Robot, count: int = 64, seed: int = 0) -> RobotBatch:
        """Return arms drawn, each physical.

        Args:
            robot: the arm, whose bodies, rotors and friction are replaced.
            count: how many.
            seed: the same seed gives the same arms.
        """
        count, seed = check_whole(count, "count", 1), check_whole(seed, "seed", 0)
        rng = np.random.default_rng(seed)
        normal = rng.normal(size=(count, len(self.mean)))
        arms = [with_parameters(robot, theta) for theta in self.unknowns(normal)]
        return RobotBatch(arms)

    def plain(self) -> dict[str, Any]:
        """Return the distribution as plain data: float64, little-endian, Base64; of the root the triangle.

        Bounds are lists, with null where there is none.
        """
        triangle = self.root[np.tril_indices(len(self.mean))]
        numbers = {"mean": self.mean, "scale": self.scale, "root": triangle}
        plain: dict[str, Any] = {}
        for key, values in numbers.items():
            content = values.astype("<f8").tobytes()
            plain[key] = base64.b64encode(content).decode()
        for key, bound in (("lower", self.lower), ("upper", self.upper)):
            plain[key] = [x if math.isfinite(x) else None for x in bound.tolist()]
        return plain


def _triangle(factor: Array) -> Array:
    """Return the lower triangle L, its diagonal not negative, with L L' = F F' of a square factor F.

    A factor by QR is there where rounding leaves no Cholesky factor.
    """
    upper: Array = np.linalg.qr(factor.T, mode="r")  # type: ignore[assignment]
    signs = np.where(np.diag(upper) < 0.0, -1.0, 1.0)
    return (upper * signs[:, None]).T


def read_posterior(path: Path, robot: Robot) -> Posterior:
    """Return the posterior of a folder.

    Args:
        path: of its ``identification.json``, or of a copy of that.
        robot: the arm in it.

    Raises:
        UrdfError: when it is damaged, or of an arm with other joints.
    """
    data = read_data(path).get("posterior")
    data = data if isinstance(data, dict) else {}
    if data.get("joints") != list(robot.joint_names):
        joints = ", ".join(robot.joint_names)
        raise UrdfError(path, f"posterior.joints: expected {joints}; load the folder as it is")
    p = len(COLUMNS) * robot.n
    mean = _numbers(path, data, "mean", p)
    scale = _numbers(path, data, "scale", p)
    triangle = _numbers(path, data, "root", p * (p + 1) // 2)
    if not (scale > 0.0).all():
        raise UrdfError(path, "posterior.scale: expected positive numbers; identify again")
    root = np.zeros((p, p))
    root[np.tril_indices(p)] = triangle
    lower = _bounds(path, data, "lower", p, -math.inf)
    upper = _bounds(path, data, "upper", p, math.inf)
    if not (lower < upper).all():
        raise UrdfError(
            path, "posterior.lower: expected bounds below those of posterior.upper; identify again"
        )
    return Posterior(mean, scale, root, lower, upper)


def _bounds(path: Path, said: Mapping[str, Any], key: str, size: int, endless: float) -> Array:
    """Return bounds of a file, `endless` where it has null."""
    values = said.get(key)
    valid = isinstance(values, list) and len(values) == size
    if not valid or not all(x is None or is_number(x) for x in values or ()):
        raise UrdfError(path, f"posterior.{key}: expected {size} finite numbers or null; identify again")
    return np.array([endless if x is None else float(x) for x in values or ()])


def _numbers(path: Path, said: Mapping[str, Any], key: str, size: int) -> Array:
    """Return numbers of a file."""
    try:
        content = base64.b64decode(said.get(key) or "", validate=True)
        numbers = np.frombuffer(content, "<f8").astype(np.float64)
    except (TypeError, ValueError, binascii.Error):
        numbers = np.empty(0)
    if len(numbers) != size or not (np.abs(numbers) < LARGEST).all():
        expected = f"{size} finite numbers, little-endian float64 in Base64"
        raise UrdfError(path, f"posterior.{key}: expected {expected}; identify again")
    return numbers


def with_parameters(robot: Robot, theta: Array) -> Robot:
    """Return a robot with other bodies, rotors and friction; unknowns as COLUMNS has them, (14 n,)."""
    bodies, rotors, friction = parts(theta)
    return robot.with_bodies(bodies).with_armature(rotors).with_friction(*friction)


def parts(theta: Array) -> tuple[Array, Array, Friction]:
    """Return bodies (n, 10), rotors (n,) and friction of the unknowns (14 n,)."""
    table = theta.reshape(-1, len(COLUMNS))
    drives = table[:, [ROTOR, VISCOUS, COULOMB]]
    rotors, viscous, coulomb = np.maximum(drives, 0.0).T
    return table[:, : len(BODY)], rotors, Friction(viscous, coulomb)
