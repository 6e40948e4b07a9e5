"""The two-mass fit of a multisine: its mode and inertia by closed forms."""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy import linalg

import armgpi
from armgpi.control.linear_arm import gravity_stiffness
from armgpi.errors import ArmgpiWarning
from armgpi.identification import resonance

Numbers = npt.NDArray[np.float64]
#: Lines at which the torques of a turn are compared.
LINES = resonance.LINES[:12]


@cache
def robot() -> armgpi.Robot:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)
        return armgpi.assume_drives(armgpi.Robot.load("anthropomorphic3").with_armature([0.3, 0.2, 0.1]))


def fit(side: str, seed: int = 0) -> Any:
    """Return the fit of random answers of every joint, before it was searched."""
    rng, n, lines = np.random.default_rng(seed), robot().n, len(LINES)
    turns = []
    for joint in range(n):
        tau = rng.normal(size=(4, lines)) + 1j * rng.normal(size=(4, lines))
        answer = 1e-3 * (rng.normal(size=(4, lines, n)) + 1j * rng.normal(size=(4, lines, n)))
        noise = 1e-4 * np.abs(rng.normal(size=(lines, 1 + n)))
        turns.append(resonance._Turn(joint, LINES, rng.normal(size=n), tau, answer, noise))
    found = resonance._Fit.__new__(resonance._Fit)
    found.robot, found.turns, found.side = robot(), turns, side
    found.links = [robot().mass_matrix(turn.q) - np.diag(robot().armature) for turn in turns]
    found.steep = [gravity_stiffness(robot(), turn.q) for turn in turns]
    found.s = np.asarray(2j * np.pi * LINES, dtype=np.complex128)
    stiffness = np.log(np.array([9e3, 6e3, 2e3]))
    zeros = np.zeros(n)
    means = [stiffness, zeros + 1.0, np.log(robot().armature), zeros + 0.3, zeros, zeros + 1e-3]
    found.mean = np.concatenate(means)
    found.std = np.full(6 * n, 0.7)
    found.std[5 * n :] = 1e-3
    found.x = 0.1 * rng.normal(size=6 * n)
    found.noise = [found._noise(found.x, index) for index in range(n)]
    return found


@pytest.mark.parametrize("side", ["motor", "link"])
def test_the_mode_is_the_lowest_of_two_masses_at_every_joint(side: str) -> None:
    """The twin: links and free motors as one system of 2 n masses, by its generalised eigenvalues."""
    found, n = fit(side), robot().n
    values = (found.mean + found.std * found.x).reshape(6, n)
    stiffness, _, rotor, _, share = np.exp(values[:5])
    bare = robot().mass_matrix(robot().middle()) - np.diag(robot().armature)
    links = np.outer(share, share) * bare
    masses = linalg.block_diag(links, np.diag(rotor))
    spring = np.diag(stiffness)
    springs = np.block([[spring, -spring], [-spring, spring]])
    squares = np.sort(linalg.eigvalsh(springs, masses))
    slowest = np.sqrt(squares[n]) / (2.0 * np.pi)  # n motions have no spring: links with their motors
    assert found._mode(found.x) == pytest.approx(slowest, rel=1e-6)


def test_the_sum_of_rotor_and_link_is_compared_with_that_of_the_file() -> None:
    found, n = fit("motor"), robot().n
    off, _ = found._sum(np.zeros(6 * n))
    bare = np.diag(robot().mass_matrix(robot().middle())) - robot().armature
    shares = np.exp(2.0 * found.mean.reshape(6, n)[4])
    expected = np.log((robot().armature + shares * bare) / (robot().armature + bare))
    assert off * resonance._TOTAL == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("side", ["motor", "link"])
def test_gears_have_the_numbers_of_the_unknowns_and_wider_ones_where_less_is_known(side: str) -> None:
    found = fit(side)
    gears = found.gears()
    n = robot().n
    assert gears.stiffness == pytest.approx(np.exp(found.mean[:n] + found.std[:n] * found.x[:n]))
    assert gears.mode[1] < gears.mode[0] < gears.mode[2]
    assert gears.mode[0] ** 2 == pytest.approx(gears.mode[1] * gears.mode[2])
    assert (gears.std <= found.std[: 3 * n].reshape(3, n)).all()
    for index in range(n):
        left, scale = found._compare(found.x, index)
        assert gears.misfit[index] == pytest.approx(np.sqrt((left**2).sum() / (scale**2).sum()))
