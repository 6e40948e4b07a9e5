"""Mass properties that a link's own shapes contradict are found; those of solid bodies give no finding."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgpi.health import checks_shapes
from armgpi.health.findings import Finding
from armgpi.robot import urdf, urdf_model
from armgpi.robot.meshes import MeshFinder
from armgpi.robot.repairs import ABOUT_CENTRE, PRODUCTS, UNITS, Repairs


class Arm:
    """What the check reads of a subject."""

    def __init__(self, text: str, folder: Path | None = None, repair: str = "") -> None:
        self.document = urdf.parse(text, "arm", repair)
        links = {}
        for name, link in self.document.links.items():
            links[name] = urdf_model.convert(link, Repairs("arm", self.document.wanted))
        self.document = replace(self.document, links=links)
        self.moved = self.document.moved_links()
        self.finder = MeshFinder(None if folder is None else folder / "arm.urdf")


def box(edges: tuple[float, float, float], density: float) -> dict[str, list[float]]:
    """Return mass, centre and moments of a solid box whose end is at the joint."""
    x, y, z = edges
    mass = density * x * y * z
    moments = [mass / 12 * (a * a + b * b) for a, b in ((y, z), (x, z), (x, y))]
    return {"edges": [x, y, z], "mass": [mass], "centre": [0.0, 0.0, z / 2], "moments": moments}


def find(
    links: list[dict[str, list[float]]], shape: str = "", folder: Path | None = None, repair: str = ""
) -> list[Finding]:
    """Return the findings of an arm of boxes, or of other shapes with the same masses."""
    text = '<robot name="boxes"><link name="base"/>'
    for k, link in enumerate(links):
        x, y, z = link["edges"]
        cx, cy, cz = link["centre"]
        ixx, iyy, izz = link["moments"]
        parent = f"l{k - 1}" if k else "base"
        drawn = shape.format(k) or f'<box size="{x!r} {y!r} {z!r}"/>'
        text += (
            f'<joint name="j{k}" type="continuous"><parent link="{parent}"/><child link="l{k}"/></joint>'
            f'<link name="l{k}"><inertial><origin xyz="{cx!r} {cy!r} {cz!r}"/>'
            f'<mass value="{link["mass"][0]!r}"/>'
            f'<inertia ixx="{ixx!r}" ixy="0" ixz="0" iyy="{iyy!r}" iyz="0" izz="{izz!r}"/></inertial>'
            f'<visual><origin xyz="0 0 {z / 2!r}"/><geometry>{drawn}</geometry></visual></link>'
        )
    return list(checks_shapes.against_shapes(Arm(text + "</robot>", folder, repair)))


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
        ("centre", 1000.0, "centres of mass are in mm"),
        ("mass", 1000.0, "masses are in g"),
        ("mass", 25.0, "kg/m^3"),
        ("mass", 5.0, "thin rod"),
        ("moments", 0.15, "thin rod"),
        ("moments", 1e6, "inertias are in kg mm^2"),
        ("moments", 1e9, "inertias are in g mm^2"),
        ("moments", 30.0, "its shapes end"),
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
    found = find(links)
    assert found[0].where == "link 'l0'"
    assert found[0].message.startswith("has the same mass and inertia as 'l1', 'l2', whose shapes are others")


def test_a_centre_of_mass_of_another_frame_is_not_said_to_be_in_millimetres() -> None:
    """A BarrettHand has 0.34 m in a finger of 0.1 m: divided by 1,000, any such place is inside."""
    links = arm()
    links[1]["centre"] = [3.0 * number for number in links[1]["centre"]]
    (found,) = find(links)
    assert "outside its own shapes" in found.message


def test_wrists_of_one_kind_may_share_their_inertial() -> None:
    """Wrist 1 and 2 of a UR10e do, by its maker; their shapes differ by a sixth."""
    links = [*arm(), box((0.09, 0.12, 0.10), 1900.0)]
    twin = dict(links[3], edges=[0.09, 0.12, 0.115])
    assert not find([*links, twin])
    for edges in (
        [0.09, 0.12, 0.16],
        [0.11, 0.15, 0.125],
    ):  # longer by 60 %; all edges by 25 %, so twice as large
        twin["edges"] = edges
        assert any("the same mass and inertia" in finding.message for finding in find([*links, twin]))


def slip(kind: str) -> list[dict[str, list[float]]]:
    """Return the arm with a slip in each link that a repair undoes."""
    links = arm()
    for link in links:
        unit = UNITS[kind]
        link["mass"] = [number / unit.mass for number in link["mass"]]
        link["centre"] = [number / unit.centre for number in link["centre"]]
        link["moments"] = [number / unit.inertia for number in link["moments"]]
        if kind == ABOUT_CENTRE:  # the parallel axes are as far as the centre is along z
            added = link["mass"][0] * link["centre"][2] ** 2
            x, y, z = link["moments"]
            link["moments"] = [x + added, y + added, z]
    return links


@pytest.mark.parametrize("kind", [kind for kind in UNITS if kind != PRODUCTS])
def test_the_repair_that_a_slip_in_all_links_proposes_leaves_no_finding(kind: str) -> None:
    found = find(slip(kind))
    assert {finding.where for finding in found} >= {"link 'l1'", "link 'l2'"}
    remedies = {finding.remedies[0].value for finding in found}
    assert remedies == ({f"{kind}:l1", f"{kind}:l2"} if len(found) == 2 else {kind})
    assert not find(slip(kind), repair=",".join(map(str, remedies)))


def save_meshes(folder: Path, unit: float = 1.0) -> None:
    """Write the arm's boxes as meshes, named by their place in it."""
    trimesh = pytest.importorskip("trimesh")
    for k, link in enumerate(arm()):
        trimesh.creation.box(extents=np.array(link["edges"]) / unit).export(folder / f"{k}.stl")


MESH = '<mesh filename="{}.stl"/>'


def test_meshes_count_as_their_hulls(tmp_path: Path) -> None:
    save_meshes(tmp_path)
    assert not find(arm(), MESH, tmp_path)
    links = arm()
    links[1]["centre"] = [0.0, 0.0, -0.205]
    (finding,) = find(links, MESH, tmp_path)
    assert finding.where == "link 'l1'"
    assert finding.value == pytest.approx(0.205, rel=1e-6)


def test_a_mesh_in_millimetres_with_its_scale_is_as_large(tmp_path: Path) -> None:
    save_meshes(tmp_path, 1e-3)
    links = arm()
    links[2]["mass"] = [1000.0 * links[2]["mass"][0]]
    (finding,) = find(links, '<mesh filename="{}.stl" scale="1e-3 1e-3 1e-3"/>', tmp_path)
    assert finding.remedies[0].value == "grams:l2"


def test_damaged_missing_and_large_meshes_give_no_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    links = arm()
    links[1]["mass"] = [1e4]
    save_meshes(tmp_path)
    assert find(links, MESH, tmp_path)
    monkeypatch.setattr(checks_shapes, "_MOST_MESHES", 100)
    assert not find(links, MESH, tmp_path)
    monkeypatch.undo()
    for k in range(3):
        (tmp_path / f"{k}.stl").write_bytes(b"solid nothing\n")
    assert not find(links, MESH, tmp_path)


@pytest.mark.parametrize("shape", ['<sphere radius="0.001"/>', '<mesh filename="missing.stl"/>'])
def test_placeholders_and_meshes_give_no_verdict(shape: str, tmp_path: Path) -> None:
    links = arm()
    links[1]["mass"] = [1e4]
    assert not find(links, shape, tmp_path)


def leaning(rng: np.random.Generator, sign: float, turned: bool = False) -> str:
    """Return an arm of five boxes that lean, with inertias as they are or with products of the other sign.

    An inertial frame may be turned against its link's.
    """
    text = '<robot name="leaning"><link name="base"/>'
    for k in range(5):
        edges = rng.uniform([0.05, 0.05, 0.25], [0.08, 0.1, 0.4])
        rpy = rng.uniform(0.3, 0.6, 3) * rng.choice([-1.0, 1.0], 3)
        frame = rng.uniform(-0.2, 0.2, 3) if turned else np.zeros(3)
        mass = 2600.0 * np.prod(edges)
        axes = pin.rpy.rpyToMatrix(frame).T @ pin.rpy.rpyToMatrix(rpy)
        tensor = axes @ np.diag(mass / 12.0 * (np.sum(edges**2) - edges**2)) @ axes.T
        moments = (
            "".join(
                f'i{"xyz"[i]}{"xyz"[j]}="{tensor[i, j] * (1.0 if i == j else sign)!r}" '
                for i in range(3)
                for j in range(i, 3)
            )
            .replace("np.float64(", "")
            .replace(")", "")
        )
        words = [" ".join(map(str, each)) for each in (frame, rpy, edges)]
        text += (
            f'<joint name="j{k}" type="continuous"><parent link="{f"l{k - 1}" if k else "base"}"/>'
            f'<child link="l{k}"/></joint><link name="l{k}"><inertial><origin rpy="{words[0]}"/>'
            f'<mass value="{mass}"/><inertia {moments}/></inertial>'
            f'<visual><origin rpy="{words[1]}"/><geometry><box size="{words[2]}"/></geometry></visual></link>'
        )
    return text + "</robot>"


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_products_of_the_other_sign_are_found_where_shapes_show_it(seed: int, turned: bool) -> None:
    right = leaning(np.random.default_rng(seed), 1.0, turned)
    slipped = leaning(np.random.default_rng(seed), -1.0, turned)
    assert not list(checks_shapes.against_shapes(Arm(right)))
    found = list(checks_shapes.against_shapes(Arm(slipped)))
    assert {finding.remedies[0].value for finding in found} == {"products-sign"}
    assert not list(checks_shapes.against_shapes(Arm(slipped, repair="products-sign")))


def test_the_repair_of_products_gives_the_tensors_as_they_were() -> None:
    right = Arm(leaning(np.random.default_rng(3), 1.0, True))
    repaired = Arm(leaning(np.random.default_rng(3), -1.0, True), repair="products-sign")
    for name, link in right.document.links.items():
        assert repaired.document.links[name].inertia == pytest.approx(link.inertia)


def test_few_products_and_those_of_one_link_alone_give_no_finding() -> None:
    """A hull is not the inside of a link: where the others have their right sign, one link shows nothing."""
    text = leaning(np.random.default_rng(0), 1.0)
    other = leaning(np.random.default_rng(0), -1.0)
    one = re.findall(r'<link name="l2">.*?</link>', other)[0]
    assert not list(checks_shapes.against_shapes(Arm(re.sub(r'<link name="l2">.*?</link>', one, text))))


def test_shapes_that_hold_few_centres_of_mass_are_said_to_be_stand_ins() -> None:
    """Discs at the joints, as of some models of Jaco: no density of theirs is one of the arm."""
    links = [box((0.05, 0.05, length), 2600.0) for length in (0.3, 0.35, 0.28, 0.4, 0.2)]
    disc = '<cylinder radius="0.025" length="0.01"/>'
    for link in links:
        link["edges"] = [0.05, 0.05, 0.0]  # the shape is at the joint
    found = find(links, disc)
    assert not found  # one shape for every link is a placeholder
    drawn = '<cylinder radius="0.025" length="0.01{}"/>'
    (finding,) = [each for each in find(links, drawn) if "gyration" not in each.message]
    assert finding.where == "robot"
    assert "5 of 5 links" in finding.message
    assert "stand-ins" in finding.message


def test_two_centres_outside_of_four_are_named_each() -> None:
    links = [*arm(), box((0.05, 0.07, 0.2), 2600.0)]
    for link in links[1:3]:
        link["centre"] = [0.0, 0.0, -link["centre"][2]]
    assert [finding.where for finding in find(links)] == ["link 'l1'", "link 'l2'"]


def test_centres_of_mass_in_the_frame_of_the_base_are_no_millimetres() -> None:
    """Doosan's arms: each centre is as high as the link stands, and one of them fits in millimetres."""
    heights = np.cumsum([0.3, 0.25, 0.28, 0.3, 0.22])
    links = [box((0.09 + 0.01 * k, 0.1, 0.24), 2600.0) for k in range(5)]
    for link, height in zip(links, heights, strict=True):
        link["centre"] = [0.0, 0.0, float(height) + 0.3]
    links[4]["edges"] = [0.05, 0.05, 0.1]
    links[4]["mass"], links[4]["moments"] = box((0.05, 0.05, 0.1), 2600.0)["mass"], [1e-3, 1e-3, 3e-4]
    (finding,) = find(links)
    assert finding.where == "robot"
    assert "another frame" in finding.message


@pytest.mark.parametrize("links", [3, 5])
def test_shapes_in_millimetres_are_named_and_no_mass_is_blamed_for_them(links: int) -> None:
    """One link's, or those of all: with masses and centres in SI units."""
    solids = [box((0.1, 0.08, 0.3 - 0.04 * k), 2700.0) for k in range(links)]
    for slips in ((1,), range(links)):
        told = [
            {**solid, "edges": [1e3 * x for x in solid["edges"]]} if k in slips else solid
            for k, solid in enumerate(solids)
        ]
        found = find(told)
        assert [each.where for each in found] == [f"link 'l{k}'" for k in slips]
        assert all("m long" in each.message and 'scale="0.001' in (each.repair or "") for each in found)


def test_a_long_boom_is_no_slip() -> None:
    assert find([box((0.6, 0.5, z), 300.0) for z in (0.8, 9.0, 6.0)]) == []


def test_a_whole_file_in_grams_and_millimetres_is_no_arm_of_stand_ins() -> None:
    """Masses in g, centres in mm and inertias in g mm^2, as CAD gives them: one repair undoes all three."""
    links = arm()
    for link in links:
        link["mass"] = [1e3 * number for number in link["mass"]]
        link["centre"] = [1e3 * number for number in link["centre"]]
        link["moments"] = [1e9 * number for number in link["moments"]]
    found = find(links)
    assert [finding.where for finding in found] == ["link 'l0'", "link 'l1'", "link 'l2'"]
    said = "masses are in g, centres of mass are in mm and inertias are in g mm^2"
    assert all(said in finding.message for finding in found)
    assert {finding.remedies[0].value for finding in found} == {"grams,centre-mm,inertia-g-mm"}
    assert not find(links, repair="grams,centre-mm,inertia-g-mm")


@pytest.mark.parametrize("key", ["mass", "centre", "moments"])
def test_three_units_are_not_proposed_where_one_of_them_does_not_fit(key: str) -> None:
    links = arm()
    for link in links:
        for name, factor in (("mass", 1e3), ("centre", 1e3), ("moments", 1e9)):
            link[name] = [factor * number * (60.0 if name == key else 1.0) for number in link[name]]
    assert not [finding for finding in find(links) if finding.remedies]
