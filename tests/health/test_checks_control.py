"""Checks of dynamics on a pendulum, whose torques and inertias are known in closed form."""

from __future__ import annotations

from pathlib import Path

import pytest

from armgpi import Robot
from armgpi.health.findings import Finding
from armgpi.health.report import find_problems
from armgpi.robot import rotors

MASS = 2.0  # [kg]
LENGTH = 0.3  # from the joint to the centre of mass [m]
INERTIA = 0.01 + MASS * LENGTH**2  # about the joint [kg m²]
WEIGHT = MASS * 9.81 * LENGTH  # torque that holds it level [N m]


def pendulum(folder: Path, centre: str, effort: float = 100.0, damping: float = 0.0) -> Path:
    """Write a pendulum about y; `centre` is its centre of mass at zero [m]."""
    path = folder / "pendulum.urdf"
    path.write_text(
        f"""<robot name="pendulum"><link name="base"/>
<link name="rod"><inertial><origin xyz="{centre}"/><mass value="{MASS}"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<dynamics damping="{damping}"/><limit lower="-3.1" upper="3.1" effort="{effort}" velocity="5"/></joint>
</robot>""",
        encoding="utf-8",
    )
    return path


def found(kind: str, path: Path, rotor_inertia: float | None = None) -> list[Finding]:
    """Return the findings of a kind."""
    problems = find_problems(path, rotor_inertia=rotor_inertia)
    return [finding for finding in problems if finding.kind == kind]


def number_of(finding: Finding) -> float:
    """Return what a finding is about as a number."""
    assert isinstance(finding.value, float)
    return finding.value


def test_a_level_pendulum_that_its_motor_cannot_hold_is_an_error(tmp_path: Path) -> None:
    (finding,) = found("gravity", pendulum(tmp_path, f"{LENGTH} 0 0", effort=0.9 * WEIGHT))
    assert finding.level == "error"
    assert finding.value == pytest.approx(WEIGHT, rel=1e-12)
    assert finding.bound == pytest.approx(0.9 * WEIGHT, rel=1e-6)


def test_a_hanging_one_is_a_warning_with_the_torque_of_the_level_one(tmp_path: Path) -> None:
    (finding,) = found("gravity", pendulum(tmp_path, f"0 0 {-LENGTH}", effort=0.9 * WEIGHT))
    assert finding.level == "warning"
    assert 0.99 * WEIGHT <= number_of(finding) <= WEIGHT * (1.0 + 1e-12)


def test_a_motor_that_holds_it_anywhere_is_no_finding(tmp_path: Path) -> None:
    assert not found("gravity", pendulum(tmp_path, f"{LENGTH} 0 0", effort=1.01 * WEIGHT))


def test_without_a_rotor_the_inertia_ratio_is_that_of_the_usual_one(tmp_path: Path) -> None:
    path = pendulum(tmp_path, f"{LENGTH} 0 0")
    usual = float(rotors.typical_inertia(Robot.load(path))[0])
    (finding,) = found("armature", path, rotor_inertia=0.0)
    assert finding.level == "warning"
    assert finding.value == pytest.approx(INERTIA / (INERTIA + usual), rel=1e-9)


def test_damping_acts_at_its_share_of_the_inertia_with_the_rotor(tmp_path: Path) -> None:
    rotor = 0.11
    path = pendulum(tmp_path, f"{LENGTH} 0 0", damping=400.0)
    values = [number_of(finding) for finding in found("friction", path, rotor_inertia=rotor)]
    assert 400.0 / (INERTIA + rotor) == pytest.approx(max(values), rel=1e-9)
