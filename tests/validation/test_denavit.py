"""An arm from a table of Denavit and Hartenberg: its URDF moves as the table says, in both conventions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from commands import Answer

from armgpi import Robot, validate
from armgpi.errors import ArmgpiError, ParameterError
from armgpi.validation import denavit

HEADER = "a, alpha, d, theta, mass, cx, cy, cz, ixx, iyy, izz, ixy, ixz, iyz, type"
TABLE = f"""# three joints
{HEADER}
0.07, pi/2, 0.34, 0, 3.1, -0.05, -0.02, 0.01, 0.022, 0.02, 0.014, 0.001, 0, 0.0005, R
0.38, 0, 0.05, -pi/2, 2.1, -0.18, 0.01, 0.02, 0.004, 0.03, 0.031, 0, 0.0002, 0, R
0.02, -0.4, 0.1, 0.3, 1.2, 0.03, 0, -0.11, 0.0015, 0.011, 0.01, 0, 0, 0, P
"""


def rows(tmp_path: Path, text: str = TABLE) -> list[denavit.Row]:
    """Return the rows of a table."""
    path = tmp_path / "arm.csv"
    path.write_text(text)
    return denavit.read_table(path)


def poses(table: list[denavit.Row], convention: str, q: np.ndarray) -> list[np.ndarray]:
    """Return the frames of the links by the textbook's matrices."""
    found, pose = [], np.eye(4)
    for row, x in zip(table, q, strict=True):
        theta, d = (row.theta, row.d + x) if row.slides else (row.theta + x, row.d)
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(row.alpha), np.sin(row.alpha)
        if convention == "standard":  # Siciliano et al., (2.52)
            step = [
                [c, -s * ca, s * sa, row.a * c],
                [s, c * ca, -c * sa, row.a * s],
                [0, sa, ca, d],
                [0, 0, 0, 1],
            ]
        else:  # Craig, (3.6)
            step = [
                [c, -s, 0, row.a],
                [s * ca, c * ca, -sa, -sa * d],
                [s * sa, c * sa, ca, ca * d],
                [0, 0, 0, 1],
            ]
        pose = pose @ np.array(step)
        found.append(pose)
    return found


def energy(table: list[denavit.Row], convention: str, q: np.ndarray, v: np.ndarray) -> tuple[float, float]:
    """Return kinetic energy, by differences of the poses, and potential energy."""
    h, kinetic, potential = 1e-6, 0.0, 0.0
    before, here, after = (poses(table, convention, q + k * h * v) for k in (-1, 0, 1))
    for row, one, T, two in zip(table, before, here, after, strict=True):
        rate = (two - one) / (2.0 * h)
        speed = rate[:3, :3] @ row.com + rate[:3, 3]
        spin = T[:3, :3].T @ rate[:3, :3]
        w = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        kinetic += 0.5 * row.mass * speed @ speed + 0.5 * w @ row.inertia @ w
        potential += 9.81 * row.mass * (T[:3, :3] @ row.com + T[:3, 3])[2]
    return float(kinetic), float(potential)


@pytest.mark.parametrize("convention", denavit.CONVENTIONS)
def test_the_urdf_has_the_energies_and_the_tip_of_the_table(convention: str, tmp_path: Path) -> None:
    table = rows(tmp_path)
    made = denavit.from_table(table, convention)
    arm = Robot.from_xml(made.urdf)
    model = pin.buildModelFromXML(made.urdf)
    data = model.createData()
    start = energy(table, convention, np.zeros(3), np.zeros(3))[1]
    own_start = pin.computePotentialEnergy(model, data, np.zeros(3))
    rng = np.random.default_rng(3)
    for _ in range(5):
        q, v = rng.uniform(-1, 1, 3), rng.normal(size=3)
        kinetic, potential = energy(table, convention, q, v)
        assert pin.computeKineticEnergy(model, data, q, v) == pytest.approx(kinetic, rel=1e-7)
        own = pin.computePotentialEnergy(model, data, q)
        assert own - own_start == pytest.approx(potential - start, abs=1e-9)
        pin.framesForwardKinematics(model, data, q)
        tip = data.oMf[model.getFrameId("tool")].homogeneous
        np.testing.assert_allclose(tip, poses(table, convention, q)[-1], atol=1e-12)
        assert (np.abs(arm.gravity(q)) < arm.limits.effort).all()


@pytest.mark.parametrize("convention", denavit.CONVENTIONS)
def test_the_model_to_fill_in_has_the_kinematics_and_lacks_the_rest(convention: str, tmp_path: Path) -> None:
    made = denavit.from_table(rows(tmp_path), convention)
    path = tmp_path / "arm.py"
    path.write_text(made.model_for("arm"))
    report = validate(path, Robot.from_xml(made.urdf))
    agreeing = {one.function for one in report.functions if one.agrees}
    assert agreeing == {"forward_kinematics"}


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("pi/2", "open('x')"),
        ("pi/2", "1/0"),
        ("pi/2", "nan"),
        ("3.1,", "-3.1,"),
        ("0.022,", "-0.022,"),
        (", R\n", ", X\n"),
        ("alpha,", "alfa,"),
        ("alpha, ", ""),
        ("a, alpha", "a, a"),
        (TABLE[TABLE.index("0.07") :], ""),
        ("0.07, pi/2, 0.34, 0, 3.1", "0.07"),
    ],
)
def test_bad_tables_are_refused(old: str, new: str, tmp_path: Path) -> None:
    assert old in TABLE
    with pytest.raises(ArmgpiError):
        rows(tmp_path, TABLE.replace(old, new, 1))


def test_degrees_stand_in_columns_of_their_own_name(tmp_path: Path) -> None:
    own = rows(tmp_path)
    text = TABLE.replace("alpha,", "alpha_deg,", 1).replace("theta,", "theta_deg,", 1)
    text = text.replace("pi/2, 0.34, 0", "90, 0.34, 0").replace("0, 0.05, -pi/2", "0, 0.05, -90")
    about_x, about_z = (float(np.degrees(angle)) for angle in (-0.4, 0.3))
    text = text.replace("-0.4, 0.1, 0.3", f"{about_x!r}, 0.1, {about_z!r}")
    for one, other in zip(own, rows(tmp_path, text), strict=True):
        assert (one.alpha, one.theta) == pytest.approx((other.alpha, other.theta), abs=1e-15)
    with pytest.raises(ParameterError, match="alpha_deg"):
        rows(tmp_path, TABLE.replace("pi/2", "90", 1))


def test_joints_may_have_names(tmp_path: Path) -> None:
    lines = TABLE.splitlines()
    body = [f"{name}, {line}" for name, line in zip(("shoulder", "2", ""), lines[2:], strict=True)]
    text = "\n".join([f"joint, {lines[1]}", *body])
    assert [row.name for row in rows(tmp_path, text)] == ["shoulder", "q2", "q3"]
    arm = Robot.from_xml(denavit.from_table(rows(tmp_path, text)).urdf)
    assert arm.joint_names == ("shoulder", "q2", "q3")
    for bad in ("q2", "<joint>", "a b"):
        with pytest.raises(ParameterError, match="joint"):
            rows(tmp_path, text.replace("shoulder", bad))


def test_files_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "none.csv"):
        with pytest.raises(ParameterError):
            denavit.read_table(path)
    (tmp_path / "bytes.csv").write_bytes(b"\xff\xfe\x00a")
    with pytest.raises(ArmgpiError):
        denavit.read_table(tmp_path / "bytes.csv")


def test_the_command_writes_both_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Callable[..., Answer]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.csv").write_text(TABLE)
    said = cli("new", "--dh", "arm.csv", "--dh-convention", "modified")
    assert said.code == 0, said
    assert "modified" in said.out
    assert (tmp_path / "arm.urdf").exists()
    assert "armgpi validate arm.py" in (tmp_path / "arm.py").read_text()
    for arguments in (
        ["new", "--dh", "arm.csv"],  # exists
        ["new", "--dh", "none.csv"],
        ["new", "--dh", "arm.csv", "--force", "--planar", "2"],
        ["new", "--dh", "arm.csv", "--force", "--dh-convention", "craig"],
        ["new", "panda", "--dh", "arm.csv"],
        ["new", "panda", "--dh-convention", "modified"],
    ):
        refused = cli(*arguments)
        assert (refused.code, refused.err.count("\n")) == (2, 1), arguments


@pytest.mark.parametrize("convention", denavit.CONVENTIONS)
def test_the_kinematics_of_a_new_model_agree_to_the_last_digit(convention: str, tmp_path: Path) -> None:
    """A quarter turn of twelve digits leaves a height of 1e-12 where there is none."""
    header = "a, alpha_deg, d, theta_deg, mass, cx, cy, cz, ixx, iyy, izz"
    made = denavit.from_table(
        rows(tmp_path, f"{header}\n0.07, 90, 0.3, 0, 1, 0, 0, 0, 0.1, 0.1, 0.1\n"), convention
    )
    path = tmp_path / "model.py"
    path.write_text(made.model)
    kinematics = validate(path, Robot.from_xml(made.urdf)).functions[-1]
    assert kinematics.function == "forward_kinematics"
    assert kinematics.agrees


def test_a_joint_may_have_the_name_of_the_tip(tmp_path: Path) -> None:
    header = "a, alpha, d, theta, mass, cx, cy, cz, ixx, iyy, izz, joint"
    table = rows(tmp_path, f"{header}\n0.07, 0, 0.3, 0, 1, 0, 0, 0, 0.1, 0.1, 0.1, tip\n")
    assert Robot.from_xml(denavit.from_table(table).urdf).joint_names == ("tip",)


@pytest.mark.parametrize(
    "row", ["0.07, 0, 0.3, 0, 1, 0, 0, 0, 0.1, 0.1", "0, 0, 0.3, 0, 1, 0, 0, 0, 1, 1, 1, 5"]
)
def test_a_row_has_a_cell_for_every_column(row: str, tmp_path: Path) -> None:
    header = "a, alpha, d, theta, mass, cx, cy, cz, ixx, iyy, izz"
    with pytest.raises(ParameterError, match=r"row 1 .*11 columns"):
        rows(tmp_path, f"{header}\n{row}\n")
    with pytest.raises(ParameterError, match="commas"):
        rows(tmp_path, header.replace(",", ";"))
