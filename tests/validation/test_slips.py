"""Slips that are no single expression: overwritten names, and one slip at all analogous places."""

from __future__ import annotations

from pathlib import Path

import pytest
import textbooks

from armgpi import Robot, validate
from armgpi.validation import slips

RIGHT = """
import numpy as np

I1, I2x, I2, I3x, I3 = 0.06, 0.002, 0.03, 0.001, 0.01
m2, m3, l2, c2, c3 = 2.0, 1.0, 0.4, 0.2, 0.1


def mass_matrix(q):
    s, c = np.sin(q[1]), np.cos(q[1])
    near = c2 * c
    far = l2 * c + c3 * np.cos(q[1] + q[2])
    spin = I2x * s**2 + I2 * c**2 + I3x * np.sin(q[1] + q[2]) ** 2 + I3 * np.cos(q[1] + q[2]) ** 2
    k = m3 * l2 * c3 * np.cos(q[2])
    d23 = I3 + m3 * c3**2 + k
    d22 = I2 + m2 * c2**2 + m3 * l2**2 + k + d23
    d33 = I3 + m3 * c3**2
    return np.array([[I1 + spin + m2 * near**2 + m3 * far**2, 0, 0], [0, d22, d23], [0, d23, d33]])
"""
SWAPPED = "spin = I2x * c**2 + I2 * s**2 + I3x * np.cos(q[1] + q[2]) ** 2 + I3 * np.sin(q[1] + q[2]) ** 2"


def arm() -> Robot:
    """Return the robot of the model above: a yaw, a shoulder and an elbow."""
    turn, ball = textbooks._turn, textbooks._round
    joints = [
        turn("0 0 1", (0, 0, 0), 3.0, (0, 0, 0), ball(0.06)),
        turn("0 -1 0", (0, 0, 0.3), 2.0, (0.2, 0, 0), (0.002, 0.03, 0.03)),
        turn("0 -1 0", (0.4, 0, 0), 1.0, (0.1, 0, 0), (0.001, 0.01, 0.01)),
    ]
    return Robot.from_xml(textbooks.written("arm", joints))


@pytest.mark.parametrize(
    ("old", "new", "kind"),
    [
        ("    spin = ", "    near = far\n    spin = ", "overwritten"),
        (RIGHT[RIGHT.index("spin = ") : RIGHT.index("    k = ")], f"{SWAPPED}\n", "everywhere"),
    ],
)
def test_a_slip_is_named_and_repaired(old: str, new: str, kind: str, tmp_path: Path) -> None:
    path = tmp_path / "model.py"
    path.write_text(RIGHT)
    assert validate(path, arm()).agrees
    path.write_text(RIGHT.replace(old, new, 1))
    report = validate(path, arm())
    assert [cause.kind for cause in report.causes] == [kind]
    assert report.causes[0].confirmed
    assert report.repaired is not None
    path.write_text(report.repaired)
    assert validate(path, arm()).agrees


def test_names_that_are_read_between_are_not_overwritten() -> None:
    found = slips.overwritten(
        "a = 1\nb = a\na = 2\nfor k in range(3):\n    a = k\na = 3\na = a + 1\n"
        "c = 1\nif a:\n    c = 2\nc = 3\n"
    )
    assert [slip.text for slip in found] == []
    (only,) = slips.overwritten("x = 1\ny = 2\nx = 3\n")
    assert only.text.startswith("line 3: x = 3 overwrites x of line 1")


def test_a_slip_is_made_at_all_places_that_differ_by_digits() -> None:
    source = "def f():\n    return m1 * lc1 + m2 * lc2 + l1 * l2\n"
    texts = {slip.text for slip in slips.everywhere(source)}
    assert "line 2: a square of lc1 and the like is missing, at 2 places" in texts
    assert "line 2: lc1 and the like should be l1 and the like, at 2 places" in texts


def test_sines_and_cosines_are_swapped_with_the_names_that_hold_them() -> None:
    source = "def f(x):\n    s, c = np.sin(x), np.cos(x)\n    y = a * c**2 + np.cos(2 * x)\n    return y\n"
    changed = [slip for slip in slips.everywhere(source) if slip.text.startswith("line 3:")]
    assert [place[1:] for place in changed[0].places] == [("np.cos", "np.sin"), ("c", "s")]
