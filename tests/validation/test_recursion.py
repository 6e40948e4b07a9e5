"""A recursion by Newton and Euler tells where it first goes astray, whatever its frames are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import textbooks
from mutants import same

from armgpi import errors, validate
from armgpi.validation import recursion
from armgpi.validation.report import DynamicsReport
from armgpi.validation.tree import from_robot

TOLD = {
    "ne3_base": """    return {
        "omega": [w1, w2, w3],
        "alpha": [b1, b2, b3],
        "a_c": [f1 / m1, f2 / m2, f3 / m3],
        "f": [f1 + f2 + f3, f2 + f3, f3],
        "n": [n1, n2, n3],
        "torque": np.array([n1 @ UP, n2 @ y, n3 @ y]),
    }
""",
    "ne4": """    centres = np.array(pushes) / np.array(MASSES)[:, None]
    return {"w": speeds, "dw": rates, "dc": centres, "torque": tau}
""",
}
#: Arm, what the right source has, what the mistaken one has instead, and what first differs.
ASTRAY = [
    ("ne3_base", "a[1] * y + np.cross(w1, v[1] * y)", "a[1] * y", "angular acceleration of link 2"),
    ("ne3_base", "w2 + v[2] * y\n", "w2 - v[2] * y\n", "angular velocity of link 3"),
    ("ne3_base", "np.cross(b1, r1)", "np.cross(b1, s1)", "acceleration of the centre of mass of link 1"),
    ("ne3_base", "+ np.cross(w2, I2 @ w2)", "", "moment from the link before of link 2"),
    ("ne4", "w = R[i].T @ (w", "w = R[i] @ (w", "acceleration of the centre of mass of link 1"),
]


def told(arm: str) -> str:
    """Return a right model whose recursion tells what it has on its way."""
    head, body = textbooks.text(arm).split("def inverse_dynamics(q, v, a):")
    body = "".join(line for line in body.splitlines(keepends=True) if not line.startswith("    return"))
    result = 'def inverse_dynamics(q, v, a):\n    return recursion(q, v, a)["torque"]\n'
    return f"{head}def recursion(q, v, a):{body}{TOLD[arm]}\n\n{result}"


def astray(arm: str, source: str) -> list[str]:
    """Return what differs on the way of a recursion, at eight random states."""
    space: dict[str, Any] = {}
    exec(source, space)
    tree = from_robot(textbooks.robot(arm, textbooks.text(arm)))
    q, v, a = np.random.default_rng(1).normal(size=(3, 8, tree.n))
    seen = np.stack([recursion.lengths(space["recursion"](*state)) for state in zip(q, v, a, strict=True)])
    robot = recursion.reference(tree, q, v, a, seen)
    return [f"{one.quantity} of link {one.link}" for one in recursion.differences(seen, robot)]


def checked(folder: Path, arm: str, source: str) -> DynamicsReport:
    path = folder / f"{arm}.py"
    path.write_text(source, encoding="utf-8")
    return validate(path, textbooks.robot(arm, textbooks.text(arm)))


@pytest.mark.parametrize("arm", TOLD)
def test_a_right_recursion_agrees_along_any_axes(arm: str) -> None:
    assert astray(arm, told(arm)) == []


@pytest.mark.parametrize(("arm", "old", "new", "first"), ASTRAY)
def test_the_first_quantity_that_differs_is_told(arm: str, old: str, new: str, first: str) -> None:
    right = told(arm)
    assert old in right
    assert astray(arm, right.replace(old, new, 1))[0] == first


def test_a_recursion_with_a_mistake_is_repaired(tmp_path: Path) -> None:
    arm, old, new, first = ASTRAY[0]
    right = told(arm)
    report = checked(tmp_path, arm, right.replace(old, new, 1))
    assert f"first to differ in the recursion: {first}: " in str(report)
    assert report.repaired is not None
    assert same(report.repaired, right)


def test_gravity_may_be_a_force_and_a_moment_about_another_point_of_the_axis() -> None:
    source = told("ne3_base").replace(
        '"a_c": [f1 / m1, f2 / m2, f3 / m3]', '"a_c": [x - p0 for x in centres]'
    )
    source = source.replace("    return {", "    centres = [f1 / m1, f2 / m2, f3 / m3]\n    return {")
    source = source.replace('"n": [n1,', '"n": [n1 + np.cross(0.3 * UP, f1 + f2 + f3),')
    assert astray("ne3_base", source) == []


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("[1.0]", "must return a mapping with some of omega, alpha, a_c, f, n"),
        ('{"omega": [1.0, 2.0]}', "omega has the shape (2,), expected one vector of 3 per link"),
        ('{"omega": [[0.0] * 3] * 3, "f": [[0.0] * 3]}', "different numbers of links"),
        ('{"omega": [[0.0] * 3] * 2}', "returns shape (5, 2)"),
    ],
)
def test_a_recursion_that_is_none_is_refused(value: str, message: str, tmp_path: Path) -> None:
    source = f"{textbooks.text('ne3_base')}\n\ndef recursion(q, v, a):\n    return {value}\n"
    with pytest.raises(errors.ModelError) as caught:
        checked(tmp_path, "ne3_base", source.replace("g = 9.81", "g = 9.5"))
    assert message in str(caught.value)


def test_a_recursion_alone_is_not_enough(tmp_path: Path) -> None:
    with pytest.raises(errors.ModelError, match="has a recursion alone"):
        checked(tmp_path, "ne3_base", "def recursion(q, v, a):\n    return {}\n")
