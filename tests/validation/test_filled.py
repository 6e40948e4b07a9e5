"""A script from MATLAB: functions fill arrays of the module, page by page; angles in degrees in a table."""

from __future__ import annotations

import ast
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import textbooks

from armgpi import Robot, validate
from armgpi.validation import alternatives, edits, slopes, units
from armgpi.validation.models import States
from armgpi.validation.problem import Problem
from armgpi.validation.tree import from_robot

SOURCE = """
import numpy as np

n = 2
# a, alpha [deg], d
DH = np.array([[0.1, 90, 0.3], [0.35, 0, 0]])
m = np.array([3.1, 2.2])
rc = np.array([[-0.06, -0.17], [-0.11, 0.02], [0.0, 0.0]])
I = np.array([0.05, 0.021])
R = np.zeros((3, 3, n + 1))
o = np.zeros((3, n + 1))
z = np.zeros((3, n + 1))
pc = np.zeros((3, n))
R[:, :, 0] = np.eye(3)
z[:, 0] = [0, 0, 1]


def update(q):
    for i in range(n):
        c, s, alpha = np.cos(q[i]), np.sin(q[i]), np.deg2rad(DH[i, 1])
        ca, sa = np.cos(alpha), np.sin(alpha)
        A = np.array([[c, -s * ca, s * sa], [s, c * ca, -c * sa], [0, sa, ca]])
        R[:, :, i + 1] = R[:, :, i] @ A
        o[:, i + 1] = o[:, i] + R[:, :, i] @ np.array([DH[i, 0] * c, DH[i, 0] * s, DH[i, 2]])
        z[:, i + 1] = R[:, 2, i + 1]
        pc[:, i] = o[:, i + 1] + R[:, :, i + 1] @ rc[:, i]


def mass_matrix(q):
    update(q)
    D = np.zeros((n, n))
    for i in range(n):
        Jv, Jw = np.zeros((3, n)), np.zeros((3, n))
        for j in range(i + 1):
            Jv[:, j] = np.cross(z[:, j], pc[:, i] - o[:, j])
            Jw[:, j] = z[:, j]
        D += m[i] * Jv.T @ Jv + I[i] * Jw.T @ Jw
    return D


def gravity(q):
    update(q)
    G = np.zeros(n)
    for i in range(n):
        for j in range(i + 1):
            G[j] += 9.81 * m[i] * np.cross(z[:, j], pc[:, i] - o[:, j])[2]
    return G
"""


def arm() -> Robot:
    """Return the robot of `SOURCE`; its frames are those of a URDF, at the joints."""
    joints = [
        textbooks._turn("0 0 1", (0, 0, 0), 3.1, (0.04, 0, 0.19), (0.05,) * 3),
        textbooks._turn("0 -1 0", (0.1, 0, 0.3), 2.2, (0.18, 0, 0.02), (0.021,) * 3),
    ]
    return Robot.from_xml(textbooks.written("two", joints))


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("pc[:, i] = o[:, i + 1]", "pc[:, i] = o[:, i]"),
        ("z[:, i + 1] = R[:, 2, i + 1]", "z[:, i + 1] = R[:, 1, i + 1]"),
        ("-c * sa", "c * sa"),
    ],
)
def test_a_mistake_among_arrays_that_functions_fill_is_named(right: str, wrong: str, tmp_path: Path) -> None:
    path = tmp_path / "filled.py"
    path.write_text(SOURCE.replace(right, wrong, 1), encoding="utf-8")
    report = validate(path, arm())
    assert report.repaired == SOURCE


def test_an_angle_that_is_read_in_degrees_is_named(tmp_path: Path) -> None:
    path = tmp_path / "filled.py"
    path.write_text(SOURCE.replace("np.deg2rad(DH[i, 1])", "DH[i, 1]"), encoding="utf-8")
    report = validate(path, arm())
    assert report.causes[0].kind == "degrees"
    assert "degrees and radians" in report.causes[0].text


def test_the_right_model_agrees_for_other_numbers_too(tmp_path: Path) -> None:
    path = tmp_path / "filled.py"
    path.write_text(SOURCE, encoding="utf-8")
    assert validate(path, arm()).judge().exit_code == 0


def test_arrays_that_functions_fill_are_no_constants() -> None:
    tree = ast.parse(SOURCE)
    assert alternatives.filled_by_functions(tree) == {"R", "o", "z", "pc"}
    read = alternatives._numbers_read(
        tree, tree, {"z": np.ones((3, 3)), "m": np.ones(2), "R": np.ones(3)}, ()
    )
    assert not any(text.startswith(("z", "R", "m")) for text in read)  # m[i] is another one at every pass


def test_what_a_change_writes_into_arrays_of_a_module_is_undone() -> None:
    module = ModuleType("model")
    array, listed, kept = np.zeros(3), [1.0], {"a": 1.0}
    vars(module).update(array=array, listed=listed, kept=kept, other=np.ones(2))
    state = edits._State(module, [])
    array[1] = 2.0
    listed.append(3.0)
    kept["b"] = 4.0
    state.forget_what_stays(())
    state.restore()
    assert array.tolist() == [0.0, 0.0, 0.0]
    assert listed == [1.0]
    assert kept == {"a": 1.0}
    assert {name for name, _, _ in state._kept.values()} == {"array", "listed", "kept"}


def test_an_angle_of_the_geometry_is_known_by_its_derivative() -> None:
    """The derivative by the twist of the first row, by differences, is that by a turn of the first link."""
    rng = np.random.default_rng(3057)
    tree = from_robot(arm())
    q = rng.uniform(-1.0, 1.0, size=(8, 2))
    states = States(q, *(rng.normal(size=q.shape) for _ in range(3)))
    sampled = {"mass_matrix": _stand_in(q)}
    problem = Problem(tree, q, sampled, 1e-9)
    known = slopes.slopes(problem, states, ["mass_matrix"], has_angles=True)

    def values(twist: float) -> np.ndarray:
        space: dict[str, object] = {}
        exec(SOURCE.replace("[0.1, 90, 0.3]", f"[0.1, {twist}, 0.3]"), space)
        return np.concatenate([space["mass_matrix"](x).ravel() for x in q]) / known.sizes[0]  # type: ignore[operator]

    step = 90.0 * units.STEP
    column = (values(90.0 + step) - values(90.0 - step)) / (2.0 * units.STEP)
    assert np.abs(column).max() > 0.1
    assert known.link_turned(column) in (0, 1)  # behind the first joint, or before the second: the same
    assert known.link_turned(column + 0.01 * rng.normal(size=column.shape)) is None
    assert [units.is_angle(x) for x in (90.0, -np.pi / 2, 30.0, 1.0, 9.81, 12.3)] == [True] * 3 + [False] * 3


def _stand_in(q: np.ndarray) -> object:
    from armgpi.validation.samples import Sampled

    D = np.zeros((len(q), 2, 2))
    return Sampled("mass_matrix", D, {"D": D})
