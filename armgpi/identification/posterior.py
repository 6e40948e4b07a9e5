"""What logs leave open of an arm, as one normal distribution: draws are made from its file alone."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import LARGEST, Array, check_whole
from armgpi.errors import UrdfError
from armgpi.identification import estimate
from armgpi.identification.estimate import Prior
from armgpi.identification.weak_form import BODY, COLUMNS, COULOMB, ROTOR, VISCOUS
from armgpi.robot.batch import RobotBatch
from armgpi.robot.equations import Friction
from armgpi.robot.identified import read_data
from armgpi.robot.robot import Robot


class Posterior(NamedTuple):
    """A normal distribution of the unknowns of the joints, as COLUMNS has them; p is 14 n.

    Attributes:
        mean: the estimate, in SI units, (p,).
        scale: standard deviations of the prior, (p,); positive.
        root: lower triangle whose product with its transpose is the covariance, in units of `scale`, (p, p).
    """

    mean: Array
    scale: Array
    root: Array

    @classmethod
    def of(cls, mean: Array, scale: Array, covariance: Array) -> Posterior:
        """Return the posterior with a covariance in units of the prior's standard deviations, (p, p)."""
        values, vectors = np.linalg.eigh(covariance)
        # A factor by QR is there where rounding leaves no Cholesky factor.
        upper: Array = np.linalg.qr((vectors * np.sqrt(np.maximum(values, 0.0))).T, mode="r")  # type: ignore[assignment]
        return cls(mean, scale, (upper * np.where(np.diag(upper) < 0.0, -1.0, 1.0)[:, None]).T)

    def unknowns(self, normal: Array) -> Array:
        """Return the physical unknowns that are nearest to some points of the distribution, (count, p).

        Args:
            normal: standard normal numbers, (count, p).

        Raises:
            MissingPackage: when Clarabel is not installed.
        """
        places = range(0, len(self.mean), len(COLUMNS))
        positive = [place + k for place in places for k in (ROTOR, COULOMB, VISCOUS)]
        prior = Prior(self.mean, self.scale, tuple(places), tuple(positive))
        draws = [estimate.project(self.root @ each, self.root, prior) for each in normal]
        return self.mean + self.scale * np.array(draws)

    def sample(self, robot: Robot, count: int = 64, seed: int = 0) -> RobotBatch:
        """Return arms drawn, each physical.

        Args:
            robot: the arm, whose bodies, rotors and friction are replaced.
            count: how many.
            seed: the same seed gives the same arms.
        """
        count, seed = check_whole(count, "count", 1), check_whole(seed, "seed", 0)
        normal = np.random.default_rng(seed).normal(size=(count, len(self.mean)))
        return RobotBatch([with_parameters(robot, theta) for theta in self.unknowns(normal)])

    def plain(self) -> dict[str, Any]:
        """Return the distribution as plain data: float64, little-endian, Base64; of the root the triangle."""
        parts = {"mean": self.mean, "scale": self.scale, "root": self.root[np.tril_indices(len(self.mean))]}
        return {key: base64.b64encode(x.astype("<f8").tobytes()).decode() for key, x in parts.items()}


def read_posterior(path: Path, robot: Robot) -> Posterior:
    """Return the posterior of a folder.

    Args:
        path: of its ``identification.json``, or of a copy of that.
        robot: the arm in it.

    Raises:
        UrdfError: when it is damaged, or of an arm with other joints.
    """
    said = read_data(path).get("posterior")
    said = said if isinstance(said, dict) else {}
    if said.get("joints") != list(robot.joint_names):
        wanted = ", ".join(robot.joint_names)
        raise UrdfError(path, f"posterior.joints: expected {wanted}; load the folder as it is")
    p = len(COLUMNS) * robot.n
    mean, scale, triangle = (
        _numbers(path, said, key, size)
        for key, size in (("mean", p), ("scale", p), ("root", p * (p + 1) // 2))
    )
    if not (scale > 0.0).all():
        raise UrdfError(path, "posterior.scale: expected positive numbers; identify again")
    root = np.zeros((p, p))
    root[np.tril_indices(p)] = triangle
    return Posterior(mean, scale, root)


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
    rotors, viscous, coulomb = np.maximum(table[:, [ROTOR, VISCOUS, COULOMB]], 0.0).T
    return table[:, : len(BODY)], rotors, Friction(viscous, coulomb)
