"""Tensors in another order, triangles alone, and what an identification gives: a stated way in for each."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from armgpi import Robot, health
from armgpi.errors import UrdfError
from armgpi.robot import tensors
from armgpi.robot.tensors import as_matrix, is_rigid, only_reading

#: Right files beside the repository, where they are.
CASES = Path(__file__).parents[3] / "shared" / "cases" / "urdf"
KEYS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
BODY = """<robot name="arm"><link name="base"/><link name="body"><inertial><origin xyz="0.1 0 0"/>
<mass value="2"/><inertia {}/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="body"/><axis xyz="{} {} {}"/>
<limit lower="-1" upper="1" effort="50" velocity="3"/>{}</joint></robot>"""


def arm(inertia: dict[str, float], axis: tuple[int, int, int] = (0, 1, 0), more: str = "") -> str:
    """Return an arm of one joint whose body has an inertia."""
    return BODY.format(" ".join(f'{key}="{value!r}"' for key, value in inertia.items()), *axis, more)


def rods(seed: int, count: int = 40) -> list[np.ndarray]:
    """Return tensors of slender bodies, each of point masses."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        points = rng.normal(size=(12, 3)) * np.array([0.02, 0.02, 0.3])[rng.permutation(3)]
        found.append(sum(np.eye(3) * (p @ p) - np.outer(p, p) for p in points))
    return found


ORDERS: dict[str, tuple[str, ...]] = {
    "MuJoCo": ("xx", "yy", "zz", "xy", "xz", "yz"),
    "Pinocchio": ("xx", "xy", "yy", "xz", "yz", "zz"),
    "nine": ("xx", "xy", "xz", "yx", "yy", "yz"),
}


@pytest.mark.parametrize("order", ORDERS)
def test_a_tensor_in_another_order_is_read_as_it_was_or_not_at_all(order: str) -> None:
    read = 0
    for tensor in rods(3):
        values = tuple(float(tensor["xyz".index(key[0]), "xyz".index(key[1])]) for key in ORDERS[order])
        reading = only_reading(values)
        if reading is None:
            continue
        found = as_matrix(reading.values)
        if order == "nine":  # the last moment is lost: any that is possible
            assert found[2, 2] <= tensor[2, 2] * (1.0 + 1e-9)
            found[2, 2] = tensor[2, 2]
        read += np.allclose(found, tensor, rtol=1e-12)
        assert is_rigid(reading.values)
    assert read >= 20


@pytest.mark.parametrize("tensor", rods(4, 10))
def test_urdfs_own_order_is_never_changed(tensor: np.ndarray) -> None:
    values = (tensor[0, 0], tensor[0, 1], tensor[0, 2], tensor[1, 1], tensor[1, 2], tensor[2, 2])
    assert only_reading(values) is None


def test_the_lost_moment_is_the_least_possible() -> None:
    """Of diag(a, b, z): z is at least a - b (triangle inequality)."""
    lost = tensors._least_moment(3.0, 0.0, 0.0, 2.0, 0.0)
    assert lost == pytest.approx(1.0, rel=1e-9)


ROD = {"ixx": 0.04, "ixy": 0.0, "ixz": 0.002, "iyy": 0.0, "iyz": 0.04, "izz": 0.001}


def test_the_refusal_names_the_reading_and_with_it_the_arm_has_that_inertia() -> None:
    with pytest.raises(UrdfError, match="along the rows") as caught:
        Robot.from_xml(arm(ROD))
    (remedy,) = caught.value.remedies
    assert remedy.value == "reorder-inertia:body"
    for repair in (remedy.value, "reorder-inertia", "all"):
        robot = Robot.from_xml(arm(ROD), repair=repair)
        # About y: iyy of the reading, and m x^2 of the centre of mass.
        assert robot.mass_matrix(np.zeros(1))[0, 0] == pytest.approx(0.04 + 2 * 0.1**2, rel=1e-12)


def test_an_identified_tensor_is_accepted_by_its_own_name_alone() -> None:
    inertia = {**dict.fromkeys(KEYS, 0.0), "ixx": -0.01, "iyy": 0.03, "izz": 0.02}
    for repair in ((), "all"):
        with pytest.raises(UrdfError, match="not positive") as caught:
            Robot.from_xml(arm(inertia), repair=repair)
        assert caught.value.remedies[0].value == "accept-inertia:body"
    robot = Robot.from_xml(arm(inertia), repair="accept-inertia:body")
    assert robot.mass_matrix(np.zeros(1))[0, 0] == pytest.approx(0.03 + 0.02, rel=1e-12)
    assert "not guaranteed" in robot.provenance["repairs"][0]["after"]
    # What D(q) shows to be impossible is refused whatever is accepted.
    with pytest.raises(UrdfError):
        Robot.from_xml(arm({**inertia, "ixx": -1.0}, (1, 0, 0)), repair="accept-inertia")


def test_negative_friction_is_taken_as_none_by_its_own_name_alone() -> None:
    inertia = {**dict.fromkeys(KEYS, 0.0), "ixx": 0.02, "iyy": 0.02, "izz": 0.02}
    text = arm(inertia, more='<dynamics damping="0.5" friction="-0.2"/>')
    for repair in ((), "all"):
        with pytest.raises(UrdfError, match=re.escape("negative friction: -0.2")) as caught:
            Robot.from_xml(text, repair=repair)
        assert caught.value.remedies[0].value == "no-friction:turn"
    robot = Robot.from_xml(text, repair="no-friction:turn")
    assert robot.friction.coulomb.tolist() == [0.0]
    assert robot.friction.viscous.tolist() == [0.5]


def test_a_lower_triangle_alone_is_mirrored() -> None:
    upper = {"ixx": 0.02, "ixy": 0.001, "ixz": 0.002, "iyy": 0.03, "iyz": 0.003, "izz": 0.025}
    names = {"ixy": "iyx", "ixz": "izx", "iyz": "izy"}
    lower = {names.get(key, key): value for key, value in upper.items()}
    with pytest.raises(UrdfError, match="has iyx and no ixy") as caught:
        Robot.from_xml(arm(lower))
    assert caught.value.remedies[0].value == "mirror-inertia:body"
    axis = (1, 1, 1)
    robot, same = Robot.from_xml(arm(lower, axis), repair="all"), Robot.from_xml(arm(upper, axis))
    np.testing.assert_array_equal(robot.mass_matrix(np.zeros(1)), same.mass_matrix(np.zeros(1)))


@pytest.mark.parametrize(
    ("soft", "named"), [("-0.9 0.8", True), ("-1 1", False), ("0 0", False), ("-0.9995 0.9995", False)]
)
def test_narrower_soft_limits_are_named(soft: str, named: bool, tmp_path: Path) -> None:
    lower, upper = soft.split()
    more = f'<safety_controller k_velocity="1" soft_lower_limit="{lower}" soft_upper_limit="{upper}"/>'
    inertia = {**dict.fromkeys(KEYS, 0.0), "ixx": 0.02, "iyy": 0.02, "izz": 0.02}
    path = tmp_path / "arm.urdf"
    path.write_text(arm(inertia, more=more))
    found = [one for one in health.inspect(path).findings if "soft limits" in one.message]
    assert bool(found) is named
    if named:
        assert "-0.9..0.8 inside its limits -1..1" in found[0].message


def test_inspect_names_all_that_would_do(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(arm(ROD, more='<dynamics damping="-0.5" friction="-0.2"/>'))
    with pytest.raises(UrdfError) as caught:
        health.inspect(path)
    repair = str(caught.value.remedies[-1].value)
    assert repair == "no-friction:turn,reorder-inertia:body"
    report = health.inspect(path, repair=repair)
    assert not [one for one in report.findings if "triangle" in one.message]


@pytest.mark.parametrize("tensor", rods(6, 12))
def test_the_upper_triangle_cut_to_six_is_read_as_the_nine_are(tensor: np.ndarray) -> None:
    """Zeros stand below the diagonal: a, b, c, 0, e, f of the first six places."""
    xx, xy, xz, yy, yz = tensor[0, 0], tensor[0, 1], tensor[0, 2], tensor[1, 1], tensor[1, 2]
    whole, upper = only_reading((xx, xy, xz, xy, yy, yz)), only_reading((xx, xy, xz, 0.0, yy, yz))
    assert upper is not None
    assert "least possible" in upper.order
    assert upper.values[:5] == (xx, xy, xz, yy, yz)
    if whole is not None:
        assert whole.values == upper.values


def test_inspect_names_a_tensor_that_is_written_twice_and_differs(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    same = {"ixx": 0.02, "ixy": 0.001, "ixz": 0.0, "iyy": 0.03, "iyz": 0.0, "izz": 0.025, "iyx": 0.001}
    path.write_text(arm(same))
    assert not [one for one in health.inspect(path).findings if one.kind == "inertia"]
    path.write_text(arm({**same, "iyx": 0.0, "izx": 0.002}))
    found = [one for one in health.inspect(path).findings if one.kind == "inertia"]
    assert {one.level for one in found} == {"info"}  # what is used is what URDF has
    assert [one.message[:31] for one in found] == [
        "has ixy 0.001 and iyx 0, which ",
        "has ixz 0 and izx 0.002, which ",
    ]


def test_no_rounding_of_eigenvalues_is_printed(tmp_path: Path) -> None:
    """Six equal numbers, a placeholder, have the moments 0, 0 and their sum."""
    path = tmp_path / "arm.urdf"
    path.write_text(arm(dict.fromkeys(KEYS, 1e-2)))
    (found,) = [one for one in health.inspect(path).findings if one.kind == "triangle"]
    assert "the sum of the others, 0 kg m^2" in found.message


@pytest.mark.parametrize("name", ["right", "rotated", "extra", "spaces", "products_sign"])
def test_a_right_file_has_no_warning(name: str) -> None:
    """Tensors in principal axes, attributes that URDF does not have, odd names are no slips."""
    path = CASES / f"{name}.urdf"
    if not path.is_file():
        pytest.skip("the cases are not part of this repository")
    assert not [one for one in health.inspect(path).findings if one.level != "info"]
