"""Drawn configurations refute a number that is too small, and none that a search or a proof found."""

from __future__ import annotations

import copy

import numpy as np
import pytest

import armgpi
from armgpi.certification.certificate import seal
from armgpi.certification.refute import again, refute
from armgpi.certification.request import law_of


@pytest.fixture(scope="module")
def robot() -> armgpi.Robot:
    return armgpi.Robot.load("anthropomorphic3").with_armature(0.05)


@pytest.fixture(scope="module")
def made(robot: armgpi.Robot) -> armgpi.Certificate:
    stated = {"torque": 0.005, "acceleration": 0.2, "bits": 20, "radius": 0.05}
    return armgpi.certify(
        robot, payload=(0.0, 0.25), speed=0.2, start="held", feedforward="gravity", **stated
    )


def test_no_configuration_refutes_what_was_found(robot: armgpi.Robot, made: armgpi.Certificate) -> None:
    assert refute(made, robot, count=2000) == []


@pytest.mark.parametrize("name", ["delta_high", "sigma", "kappa_v", "kappa_e", "kappa_g", "sigma_error"])
def test_a_planted_wrong_number_is_refuted(robot: armgpi.Robot, made: armgpi.Certificate, name: str) -> None:
    data = copy.deepcopy(made.data)
    best = 1.0 if name == "delta_high" else 0.0
    share = 0.6 if name == "sigma_error" else 0.8  # what is added for loads between the ends hides less
    data["numbers"][name] = repr(best + share * (float(data["numbers"][name]) - best))
    data["seal"] = seal(data)  # whoever seals anew is found out here alone
    found = refute(armgpi.Certificate(data), robot, count=2000)
    assert [each.name for each in found] == [name]
    assert found[0].found > found[0].claimed == float(data["numbers"][name])
    assert len(found[0].q) == robot.n


def test_rounding_refutes_no_torque_that_is_zero(robot: armgpi.Robot, made: armgpi.Certificate) -> None:
    """The first joint's axis is vertical: gravity needs no torque there, and computes as some 1e-15 N m."""
    data = copy.deepcopy(made.data)
    data["numbers"]["hold"][0] = "0"
    data["seal"] = seal(data)
    assert refute(armgpi.Certificate(data), robot, count=500) == []


def test_planted_wrong_sizes_of_what_disturbs_are_refuted(
    robot: armgpi.Robot, made: armgpi.Certificate
) -> None:
    data = copy.deepcopy(made.data)
    data["numbers"]["inverse"][2] = repr(0.7 * float(data["numbers"]["inverse"][2]))
    data["shares"]["disturbance"] *= 0.7
    data["inputs"]["stated"]["reference"] = repr(0.7 * float(data["inputs"]["stated"]["reference"]))
    data["seal"] = seal(data)
    found = {each.name for each in refute(armgpi.Certificate(data), robot, count=2000)}
    assert found == {"inverse.2", "torque", "velocity"}


def test_sizes_below_their_shares_and_limits_of_another_arm_are_refused(
    robot: armgpi.Robot, made: armgpi.Certificate
) -> None:
    for section, key, expected in (("inputs", "torque", "shares"), ("limits", "effort", "limits")):
        data = copy.deepcopy(made.data)
        if section == "inputs":
            data["inputs"]["stated"][key] = repr(0.9 * float(data["inputs"]["stated"][key]))
        else:
            data["limits"][key][0] = "1e6"
        data["seal"] = seal(data)
        with pytest.raises(armgpi.errors.ParameterError, match=expected):
            refute(armgpi.Certificate(data), robot, count=1)


@pytest.mark.parametrize(
    ("found", "said"), [(None, "no seal"), ("0" * 64, "a seal that is not that of its content")]
)
def test_a_file_whose_seal_is_missing_or_broken_is_said_to_be(
    robot: armgpi.Robot, made: armgpi.Certificate, found: str | None, said: str
) -> None:
    data = copy.deepcopy(made.data)
    data["seal"] = found
    if found is None:
        del data["seal"]
    with pytest.warns(armgpi.errors.ArmgpiWarning, match=said):
        refute(armgpi.Certificate(data), robot, count=1)


def test_loads_that_are_drawn_are_between_the_ends(
    robot: armgpi.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded = armgpi.certify(robot, payload=(0.2, 0.25), speed=0.2, start="held")
    masses: list[float] = []
    with_payload = armgpi.Robot.with_payload

    def noting(self: armgpi.Robot, frame: str, mass: float, com: object) -> armgpi.Robot:
        masses.append(mass)
        return with_payload(self, frame, mass, com)

    monkeypatch.setattr(armgpi.Robot, "with_payload", noting)
    for seed in range(8):
        refute(loaded, robot, count=1, seed=seed)
    drawn = set(masses) - {0.2, 0.25, 1.0}  # the ends, and a kilogram to measure with
    assert len(drawn) == 8
    assert 0.2 < min(drawn) < max(drawn) < 0.25


def test_it_says_how_far_it_is(robot: armgpi.Robot, made: armgpi.Certificate) -> None:
    said: list[str] = []
    refute(made, robot, count=501, progress=said.append)
    assert said == ["0 of 501 configurations", "500 of 501 configurations"]


def test_what_was_asked_for_is_read_from_the_file(robot: armgpi.Robot, made: armgpi.Certificate) -> None:
    asked = again(made, robot)
    assert asked.loads == (0.0, 0.25)
    assert asked.bits == 20
    np.testing.assert_array_equal(asked.setting.torque, 0.005)
    assert law_of(asked) == made.data["law"]


def test_another_robot_is_refused(made: armgpi.Certificate) -> None:
    with pytest.raises(armgpi.errors.ParameterError, match="armature"):
        refute(made, armgpi.Robot.load("anthropomorphic3"))
    with pytest.raises(armgpi.errors.ParameterError, match="joints"):
        refute(made, armgpi.Robot.load("ur5"))
