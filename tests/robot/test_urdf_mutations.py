"""Whatever is done to a good URDF, it ends in one of our errors or in dynamics that are numbers.

`tools/fuzz_urdf.py` does the same ten thousands of times, in processes of their own.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from strategies import urdf_texts

from armgpi import health, robots
from armgpi.errors import ArmgpiError

NUMBERS = (
    *("nan", "inf", "-1e308", "1e400", "1e308", "1e20", "1e-200", "5e-324", "0", "-0", "-1", "57.3"),
    *("", " ", "1,5", "${m}", "0x10", "1_0", "1 2", "heavy", "٢"),
)
NAMES = ("", " ", "universe", "root_joint", "关节", "\n", "../..", "a" * 5000)
TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar", "ball", "")
KNOWN = [robots.locate(name)[0].read_text("utf-8") for name in ("anthropomorphic3", "panda", "so101")]


def child(draw: st.DrawFn, root: Element) -> tuple[Element, Element]:
    """Return an element and one of its children."""
    parents = [element for element in root.iter() if len(element)]
    if not parents:
        root.append(Element("link", name="l"))
        parents = [root]
    parent = draw(st.sampled_from(parents))
    return parent, draw(st.sampled_from(list(parent)))


def attribute(draw: st.DrawFn, root: Element, names: bool) -> tuple[Element, str]:
    """Return an element and the key of one of its attributes, one that names something or not."""
    found = [
        (e, k) for e in root.iter() for k in e.attrib if (k in ("name", "link", "joint", "filename")) == names
    ]
    return draw(st.sampled_from(found or [(root, "name")]))


def delete(draw: st.DrawFn, root: Element) -> None:
    parent, element = child(draw, root)
    parent.remove(element)


def repeat(draw: st.DrawFn, root: Element) -> None:
    parent, element = child(draw, root)
    parent.append(copy.deepcopy(element))


def swap(draw: st.DrawFn, root: Element) -> None:
    (one, a), (two, b) = child(draw, root), child(draw, root)
    if b not in a.iter() and a not in b.iter():
        i, j = list(one).index(a), list(two).index(b)
        one[i], two[j] = b, a


def corrupt(draw: st.DrawFn, root: Element) -> None:
    element, key = attribute(draw, root, names=False)
    words = element.get(key, "").split() or [""]
    words[draw(st.integers(0, len(words) - 1))] = draw(
        st.sampled_from(NUMBERS) | st.floats(allow_nan=False).map(repr)
    )
    element.set(key, " ".join(words))


def rename(draw: st.DrawFn, root: Element) -> None:
    element, key = attribute(draw, root, names=True)
    other, its = attribute(draw, root, names=True)
    element.set(key, draw(st.sampled_from([other.get(its, ""), *NAMES])))


def retype(draw: st.DrawFn, root: Element) -> None:
    joints = root.findall("joint")
    if joints:
        draw(st.sampled_from(joints)).set("type", draw(st.sampled_from(TYPES)))


def forget(draw: st.DrawFn, root: Element) -> None:
    element, key = attribute(draw, root, names=draw(st.booleans()))
    element.attrib.pop(key, None)


def follow(draw: st.DrawFn, root: Element) -> None:
    joints = root.findall("joint")
    if joints:
        leader = draw(st.sampled_from(joints)).get("name", "")
        ratio = draw(st.sampled_from(NUMBERS))
        draw(st.sampled_from(joints)).append(Element("mimic", joint=leader, multiplier=ratio))


MUTATIONS: tuple[Callable[[st.DrawFn, Element], None], ...] = (
    *(delete, repeat, swap, corrupt, corrupt, corrupt, rename, retype, forget, follow),
)


@st.composite
def mutated(draw: st.DrawFn) -> str:
    """Good URDFs with up to four things done to them."""
    root = ElementTree.fromstring(draw(st.sampled_from(KNOWN) | urdf_texts(max_joints=4)))
    for mutation in draw(st.lists(st.sampled_from(MUTATIONS), min_size=1, max_size=4)):
        mutation(draw, root)
    return ElementTree.tostring(root, encoding="unicode")


def inspected(path: Path, mimic: Any) -> health.HealthReport | None:
    """Return the report of a file, None when it is refused, which takes one line."""
    message = ""
    try:
        return health.inspect(path, mimic=mimic)
    except ArmgpiError as error:
        message = str(error)
    assert len(message.splitlines()) == 1
    return None


@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(mutated(), st.sampled_from(["lock", "follow"]))
def test_a_mutated_urdf_is_refused_or_its_dynamics_are_numbers(tmp_path: Path, text: str, mimic: Any) -> None:
    path = tmp_path / "mutated.urdf"
    path.write_text(text, encoding="utf-8")
    report = inspected(path, mimic)
    if report is None:
        return
    robot = report.robot
    q = np.vstack([robot.middle(), robot.random_positions(3)])
    zero = np.zeros_like(q)
    for result in (robot.mass_matrix(q), robot.gravity(q), robot.forward_dynamics(q, zero, zero)):
        assert np.isfinite(result).all()
    report.as_dict()


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_bytes_that_change_never_crash(tmp_path: Path, data: st.DataObject) -> None:
    content = bytearray(KNOWN[0].encode())
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(content) - 1))
        end = data.draw(st.integers(start, min(len(content), start + 60)))
        content[start:end] = data.draw(st.binary(max_size=20) | st.just(bytes(content[start:end]) * 2))
        if not content:
            return
    path = tmp_path / "bytes.urdf"
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        inspected(path, "lock")
