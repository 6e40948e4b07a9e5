"""An arm to begin with: the URDF of a planar arm, a model to fill in, and what it lacks as formulas."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from commands import Answer

from armgpi import Robot, validate
from armgpi.errors import ParameterError
from armgpi.validation import template

FILLED = {
    "    # D[0, 0] = I1 + m1 * lc1**2 + ...\n": """    k = m2 * l1 * lc2 * np.cos(q[1])
    D[1, 1] = I2 + m2 * lc2**2
    D[0, 1] = D[1, 0] = D[1, 1] + k
    D[0, 0] = I1 + m1 * lc1**2 + m2 * l1**2 + D[1, 1] + 2 * k
""",
    "    h = np.zeros(2)\n": """    k = m2 * l1 * lc2 * np.sin(q[1])
    h = np.array([-k * v[1] * (2 * v[0] + v[1]), k * v[0] ** 2])
""",
    "    # G[1] = m2 * g * lc2": "    G[1] = m2 * g * lc2",
    "    return G\n": "    G[0] = (m1 * lc1 + m2 * l1) * g * np.cos(q[0]) + G[1]\n    return G\n",
}


def test_a_model_to_fill_in_says_what_it_lacks_and_agrees_once_it_is_filled_in(tmp_path: Path) -> None:
    made = template.planar(2)
    arm, path = Robot.from_xml(made.urdf), tmp_path / "planar2.py"
    path.write_text(made.model_for("planar2"), encoding="utf-8")
    lacking = {one.label: one.text for one in validate(path, arm).differences}
    assert lacking["D[2,2]"] == "missing: all of it, m2*lc2**2 + I2"
    assert lacking["q̇1² in τ2"] == "missing: m2*l1*lc2*sin(q2)"
    text = path.read_text(encoding="utf-8")
    for old, new in FILLED.items():
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    assert validate(path, arm).agrees


@pytest.mark.parametrize("joints", [1, 7])
def test_planar_arms_hold_themselves(joints: int) -> None:
    arm = Robot.from_xml(template.planar(joints).urdf)
    assert arm.n == joints
    level = np.zeros(joints)
    assert (np.abs(arm.gravity(level)) < arm.limits.effort).all()


def test_another_number_of_joints_is_refused() -> None:
    for joints in (0, 8):
        with pytest.raises(ParameterError, match="planar"):
            template.planar(joints)


def test_the_command_writes_both_files_and_replaces_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Callable[..., Answer]
) -> None:
    monkeypatch.chdir(tmp_path)
    said = cli("new", "--planar", "3")
    assert said.code == 0, said
    assert (tmp_path / "planar3.urdf").exists()
    assert "planar3.urdf" in (tmp_path / "planar3.py").read_text(encoding="utf-8")
    assert cli("new", "--planar", "3").code == 2
    assert cli("new", "--planar", "3", "--force", "--out", "arm.urdf").code == 0
    assert (tmp_path / "arm.py").exists()
    for arguments in (["new"], ["new", "panda", "--planar", "2"], ["new", "--planar", "0"]):
        refused = cli(*arguments)
        assert refused.code == 2
        assert refused.err.count("\n") == 1
    lost = cli("new", "--planar", "2", "--payload", "3", "--target", "ros2_control", "--lock", "a")
    assert (lost.code, lost.err.count("\n")) == (2, 1)
    assert "--payload, --target, --lock" in lost.err
    assert not (tmp_path / "planar2.urdf").exists()
