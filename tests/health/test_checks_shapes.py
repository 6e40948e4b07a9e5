"""Mass properties that a link's own shapes contradict are found; those of solid bodies give no finding."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgpi.health import checks_shapes
from armgpi.health.findings import Finding
from armgpi.robot import urdf


class Arm:
    """What the check reads of a subject."""

    def __init__(self, text: str) -> None:
        self.document = urdf.parse(text, "arm")
        self.moved = self.document.moved_links()


def box(edges: tuple[float, float, float], density: float) -> dict[str, list[float]]:
    """Return mass, centre and moments of a solid box whose end is at the joint."""
    x, y, z = edges
    mass = density * x * y * z
    moments = [mass / 12 * (a * a + b * b) for a, b in ((y, z), (x, z), (x, y))]
    return {"edges": [x, y, z], "mass": [mass], "centre": [0.0, 0.0, z / 2], "moments": moments}


def find(links: list[dict[str, list[float]]], shape: str = "") -> list[Finding]:
    """Return the findings of an arm of boxes, or of other shapes with the same masses."""
    text = '<robot name="boxes"><link name="base"/>'
    for k, link in enumerate(links):
        x, y, z = link["edges"]
        cx, cy, cz = link["centre"]
        ixx, iyy, izz = link["moments"]
        parent = f"l{k - 1}" if k else "base"
        drawn = shape or f'<box size="{x!r} {y!r} {z!r}"/>'
        text += (
            f'<joint name="j{k}" type="continuous"><parent link="{parent}"/><child link="l{k}"/></joint>'
            f'<link name="l{k}"><inertial><origin xyz="{cx!r} {cy!r} {cz!r}"/>'
            f'<mass value="{link["mass"][0]!r}"/>'
            f'<inertia ixx="{ixx!r}" ixy="0" ixz="0" iyy="{iyy!r}" iyz="0" izz="{izz!r}"/></inertial>'
            f'<visual><origin xyz="0 0 {z / 2!r}"/><geometry>{drawn}</geometry></visual></link>'
        )
    return list(checks_shapes.against_shapes(Arm(text + "</robot>")))


def arm() -> list[dict[str, list[float]]]:
    """Return three solid boxes of one metal."""
    return [box(edges, 2600.0) for edges in ((0.2, 0.16, 0.11), (0.07, 0.09, 0.41), (0.06, 0.05, 0.23))]


length = st.floats(0.03, 1.0)
edges_of_boxes = st.tuples(length, length, length)


@given(
    st.lists(st.tuples(st.tuples(length, length, length), st.floats(300.0, 8000.0)), min_size=1, max_size=4)
)
def test_solid_bodies_give_no_finding(bodies: list[tuple[tuple[float, float, float], float]]) -> None:
    assert not find([box(edges, density) for edges, density in bodies])


@pytest.mark.parametrize(
    ("key", "factor", "said"),
    [
        ("centre", -1.0, "outside its own shapes"),
        ("centre", 1000.0, "outside its own shapes"),
        ("mass", 1000.0, "kg/m^3"),
        ("mass", 5.0, "thin rod"),
        ("moments", 0.15, "thin rod"),
        ("moments", 1e6, "its shapes end"),
        ("moments", 1e-3, "thin rod"),
    ],
)
def test_a_slip_in_one_link_is_found_there(key: str, factor: float, said: str) -> None:
    links = arm()
    links[1][key] = [factor * number for number in links[1][key]]
    found = find(links)
    assert {finding.where for finding in found} == {"link 'l1'"}
    assert any(said in finding.message for finding in found)


def test_one_inertial_copied_to_all_is_found() -> None:
    links = arm()
    for link in links:
        link.update({key: links[1][key] for key in ("mass", "centre", "moments")})
    assert "link 'l0'" in {finding.where for finding in find(links)}  # the others are as long as it


@pytest.mark.parametrize("shape", ['<sphere radius="0.001"/>', '<mesh filename="a.stl"/>'])
def test_placeholders_and_meshes_give_no_verdict(shape: str, tmp_path: Path) -> None:
    links = arm()
    links[1]["mass"] = [1e4]
    assert not find(links, shape)
