"""What logs leave open: draws are those of the normal distribution where these are arms, and always arms."""

from __future__ import annotations

import base64
import json
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from armgpi import Robot
from armgpi.errors import UrdfError
from armgpi.identification.posterior import Posterior, parts, read_posterior, with_parameters
from armgpi.identification.weak_form import BODY, COLUMNS, COULOMB, ROTOR, VISCOUS
from armgpi.robot.identified import FORMAT

Numbers = npt.NDArray[np.float64]
ARM = Robot.load("anthropomorphic3")
SIZE = len(COLUMNS) * ARM.n


def truth() -> Numbers:
    """Return unknowns of an arm well inside of what is physical: balls of 2 kg at 0.1 m."""
    table = np.zeros((ARM.n, len(COLUMNS)))
    mass, place, ball = 2.0, np.array([0.1, 0.0, 0.0]), 0.05
    moments = ball * np.eye(3) + mass * (place @ place * np.eye(3) - np.outer(place, place))
    table[:, 0] = mass
    table[:, 1:4] = mass * place
    table[:, 4:10] = moments[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]  # xx, xy, yy, xz, yz, zz
    table[:, [ROTOR, COULOMB, VISCOUS]] = 0.5
    return table.ravel()


def pseudo_inertia(
    body: Numbers,
) -> Numbers:
    """Return the matrix whose positive semidefiniteness is physical consistency (Wensing et al. 2018)."""
    mass, first = body[0], body[1:4]
    xx, xy, yy, xz, yz, zz = body[4:10]
    moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    second = 0.5 * np.trace(moments) * np.eye(3) - moments
    return np.block([[second, first[:, None]], [first[None], np.array([[mass]])]])


def rotor_bounds(low: float, high: float) -> tuple[Numbers, Numbers]:
    """Return lower and upper bounds of the unknowns that bound the rotors alone."""
    lower, upper = np.full(SIZE, -np.inf), np.full(SIZE, np.inf)
    lower[ROTOR :: len(COLUMNS)], upper[ROTOR :: len(COLUMNS)] = low, high
    return lower, upper


def coupled() -> Numbers:
    """Return a covariance in which a heavier rotor goes with a lighter link, as logs leave it open."""
    factor = 1e-3 * np.eye(SIZE)
    for joint in range(ARM.n):
        place = joint * len(COLUMNS)
        factor[place + ROTOR, place + ROTOR] = 0.3
        factor[place + 9, place + ROTOR] = -0.01
        factor[place + ROTOR, ROTOR] += 0.1
    return np.asarray(factor @ factor.T)


def test_rotors_and_links_are_drawn_within_bounds_as_by_rejection() -> None:
    """The slow twin draws without bounds until the rotors of all joints are within them."""
    lower, upper = rotor_bounds(0.4, 0.9)
    rng = np.random.default_rng(11)
    posterior = Posterior.of(truth(), np.ones(SIZE), coupled(), (lower, upper))
    drawn = posterior.unknowns(rng.normal(size=(500, SIZE)))
    assert (drawn >= lower).all()
    assert (drawn <= upper).all()
    free = rng.multivariate_normal(truth(), coupled(), size=60_000)
    kept = free[((free >= lower) & (free <= upper)).all(axis=1)]
    assert 3000 < len(kept) < 30_000
    rotor = np.arange(ARM.n) * len(COLUMNS) + ROTOR
    shown = np.concatenate([rotor, rotor - ROTOR + 9])
    for place in shown:
        assert stats.ks_2samp(drawn[:, place], kept[:, place]).pvalue > 1e-3
    one, other = np.corrcoef(drawn[:, shown].T), np.corrcoef(kept[:, shown].T)
    assert one == pytest.approx(other, abs=0.15)
    # The link follows its rotor: that of a rotor clipped alone would stay.
    assert kept[:, rotor[0] - ROTOR + 9].mean() < truth()[9] - 1e-3


def test_a_draw_depends_on_its_own_numbers_alone() -> None:
    posterior = Posterior.of(truth(), np.ones(SIZE), coupled(), rotor_bounds(0.4, 0.9))
    normal = np.random.default_rng(12).normal(size=(4, SIZE))
    together = posterior.unknowns(normal)
    for row, drawn in zip(normal, together, strict=True):
        np.testing.assert_array_equal(posterior.unknowns(row[None])[0], drawn)
    unbounded = Posterior.of(truth(), np.ones(SIZE), coupled())
    for row, drawn in zip(normal, unbounded.unknowns(normal), strict=True):
        np.testing.assert_array_equal(unbounded.unknowns(row[None])[0], drawn)
    assert np.ptp(together[:, ROTOR]) > 0.01


@pytest.mark.parametrize("rank", [SIZE, SIZE // 2, 1])
def test_the_root_of_a_covariance_is_a_lower_triangle_whatever_its_rank(rank: int) -> None:
    factor = np.random.default_rng(3).normal(size=(SIZE, rank))
    covariance = factor @ factor.T
    posterior = Posterior.of(truth(), np.ones(SIZE), covariance)
    assert np.array_equal(posterior.root, np.tril(posterior.root))
    assert (np.diag(posterior.root) >= 0.0).all()
    assert posterior.root @ posterior.root.T == pytest.approx(
        covariance, abs=1e-12 * np.abs(covariance).max()
    )


def test_draws_well_inside_of_what_is_physical_are_those_of_the_normal_distribution() -> None:
    """Nothing has to be projected: mean + scale root z, in closed form."""
    rng = np.random.default_rng(4)
    factor = 1e-3 * rng.normal(size=(SIZE, SIZE)) / np.sqrt(SIZE)
    scale = np.linspace(0.5, 2.0, SIZE)
    posterior = Posterior.of(truth(), scale, factor @ factor.T)
    normal = rng.normal(size=(20, SIZE))
    expected = truth() + scale * (normal @ posterior.root.T)
    assert posterior.unknowns(normal) == pytest.approx(expected, rel=1e-6, abs=1e-7)


def test_every_draw_is_an_arm_however_wide_the_distribution() -> None:
    posterior = Posterior.of(truth(), np.ones(SIZE), 4.0 * np.eye(SIZE))
    draws = posterior.unknowns(np.random.default_rng(5).normal(size=(10, SIZE)))
    for table in draws.reshape(len(draws), ARM.n, len(COLUMNS)):
        assert (table[:, [ROTOR, COULOMB, VISCOUS]] >= -1e-9).all()
        for row in table:
            eigenvalues = np.linalg.eigvalsh(pseudo_inertia(row[: len(BODY)]))
            assert eigenvalues.min() >= -1e-6 * eigenvalues.max()


def test_arms_drawn_have_the_unknowns_that_were_drawn() -> None:
    posterior = Posterior.of(truth(), np.ones(SIZE), 1e-6 * np.eye(SIZE))
    drawn = posterior.sample(ARM, 3, seed=7)
    normal = np.random.default_rng(7).normal(size=(3, SIZE))
    for arm, theta in zip(drawn.robots, posterior.unknowns(normal), strict=True):
        bodies, rotors, friction = parts(theta)
        assert arm.armature == pytest.approx(rotors)
        assert arm.friction.coulomb == pytest.approx(friction.coulomb)
        assert arm.friction.viscous == pytest.approx(friction.viscous)
        inertias = arm.pinocchio_model().inertias[1:]
        assert [x.toDynamicParameters() for x in inertias] == pytest.approx(bodies, rel=1e-9, abs=1e-12)
        assert arm.mass_matrix(arm.middle()) == pytest.approx(
            with_parameters(ARM, theta).mass_matrix(arm.middle())
        )


def test_a_posterior_that_was_written_is_read_to_the_bit(tmp_path: Path) -> None:
    factor = np.random.default_rng(6).normal(size=(SIZE, SIZE))
    lower, upper = rotor_bounds(0.1, 0.7)
    posterior = Posterior.of(truth(), np.linspace(0.1, 1.0, SIZE), factor @ factor.T, (lower, upper))
    path = tmp_path / "identification.json"
    data = {**posterior.plain(), "joints": list(ARM.joint_names)}
    path.write_text(json.dumps({"format": FORMAT, "posterior": data}), encoding="utf-8")
    for read, written in zip(read_posterior(path, ARM), posterior, strict=True):
        assert np.array_equal(read, written)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("joints", ["other"], "posterior.joints"),
        ("mean", "no Base64", "posterior.mean"),
        ("root", base64.b64encode(bytes(8)).decode(), "posterior.root"),
        ("scale", base64.b64encode(np.full(SIZE, np.nan).tobytes()).decode(), "posterior.scale"),
        ("scale", base64.b64encode(np.zeros(SIZE).tobytes()).decode(), "posterior.scale: expected positive"),
        ("lower", [0.0], f"posterior.lower: expected {SIZE} finite numbers or null"),
        ("upper", None, "posterior.upper: expected"),
        ("upper", [True] * SIZE, "posterior.upper: expected"),
        ("upper", [-1e3] * SIZE, "posterior.lower: expected bounds below"),
    ],
)
def test_a_damaged_posterior_is_refused_by_its_key(
    key: str, value: object, said: str, tmp_path: Path
) -> None:
    bounds = np.full(SIZE, -1e2), np.full(SIZE, 1e2)
    posterior = Posterior.of(truth(), np.ones(SIZE), np.eye(SIZE), bounds)
    data = {**posterior.plain(), "joints": list(ARM.joint_names), key: value}
    path = tmp_path / "identification.json"
    path.write_text(json.dumps({"format": FORMAT, "posterior": data}), encoding="utf-8")
    with pytest.raises(UrdfError, match=said):
        read_posterior(path, ARM)
