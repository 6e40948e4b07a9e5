"""Rotor inertia that a URDF gives: in a transmission, as Drake reads it, or in ros2_control."""

from __future__ import annotations

import math
from collections.abc import Iterator
from xml.etree.ElementTree import Element

from armgpi.errors import UrdfError
from armgpi.robot.markup import GEAR_RATIO, ROTOR_INERTIA


def rotor_inertias(root: Element, source: str) -> dict[str, float]:
    """Return the rotor inertia seen at every joint for which a URDF gives one [kg m^2 or kg].

    It is the gear ratio squared times the rotor's own inertia; the ratio is 1 where none is given.

    Args:
        root: the XML.
        source: where it is from, for messages.

    Raises:
        UrdfError: for a rotor inertia or gear ratio that is no finite number, or negative inertia.
    """
    found: dict[str, float] = {}
    for element in (*root.iter("transmission"), *root.findall("ros2_control")):
        for joint in element.findall("joint"):
            # A transmission is that of its joint; ros2_control lists many.
            own = element if element.tag == "transmission" else joint
            inertia = _number(own, ROTOR_INERTIA, source)
            if inertia is not None:  # gear ratios alone, which many files have, say nothing
                ratio = _number(own, GEAR_RATIO, source)
                found[joint.get("name", "")] = inertia * (1.0 if ratio is None else ratio) ** 2
    for name, value in found.items():
        if not 0.0 <= value < math.inf:
            raise UrdfError(source, f"the rotor inertia of joint {name!r} is {value:g}", name)
    return found


def _number(element: Element, names: tuple[str, ...], source: str) -> float | None:
    """Return the first number below an element that has one of some names; None for none."""
    for name, text in _values(element):
        if name in names and text:
            try:
                return float(text)
            except ValueError:
                raise UrdfError(source, f"<{name}> is {text!r}, expected a number", name) from None
    return None


def _values(element: Element) -> Iterator[tuple[str, str]]:
    """Yield the names and texts of all elements below one."""
    for below in element.iter():
        name = below.tag.rpartition("}")[2].rpartition(":")[2] if isinstance(below.tag, str) else ""
        if name == "param":
            name = below.get("name", "")
        yield name, (below.get("value") or below.text or "").strip()
