"""A file without known names is told what it has, and the line that wraps it."""

from __future__ import annotations

from pathlib import Path

import pytest

from armgpi import validate
from armgpi.errors import ModelError

_TUPLE = """
import numpy as np


def dynamics(th1, th2, w1, w2):
    m1, m2, l1, l2, g = 2.3, 1.4, 0.71, 0.52, 9.81
    d22 = m2 * l2**2 / 3
    k = m2 * l1 * l2 / 2 * np.cos(th2)
    M = np.array([[m1 * l1**2 / 3 + d22 + m2 * l1**2 + 2 * k, d22 + k], [d22 + k, d22]])
    h = m2 * l1 * l2 / 2 * np.sin(th2)
    a = (m1 / 2 + m2) * g * l1
    b = m2 * g * l2 / 2 * np.cos(th1 + th2)
    return M, np.array([-h * (2 * w1 * w2 + w2**2), h * w1**2]), np.array([a * np.cos(th1) + b, b])
"""


def test_a_file_without_known_names_is_told_what_it_has_and_the_line_that_wraps_it(tmp_path: Path) -> None:
    path = tmp_path / "scalars.py"
    path.write_text(_TUPLE, encoding="utf-8")
    with pytest.raises(ModelError) as refused:
        validate(path)
    assert "it has dynamics(th1, th2, w1, w2)" in str(refused.value)
    line = str(refused.value).partition("to wrap it: ")[2]
    path.write_text(f"{_TUPLE}\n{line}\n", encoding="utf-8")
    report = validate(path, joints=2)
    assert report.agrees
    laws = {law.name: law.verdict for law in report.laws}
    assert laws["D positive definite"] == "holds"
    assert laws["C v from D"] == "holds"


def test_a_function_of_arrays_is_wrapped_by_its_shapes(tmp_path: Path) -> None:
    path = tmp_path / "arrays.py"
    path.write_text(
        "import numpy as np\ndef rne(q, qd, qdd): return q[0] + qd + q[2] * qdd[:3]\n", encoding="utf-8"
    )
    with pytest.raises(ModelError, match=r"inverse_dynamics = lambda q, v, a: rne\(q, v, a\)"):
        validate(path)
