"""Hypothesis strategies of robots: any serial chain or small tree that a URDF can describe.

`urdf_texts()` makes the text, `robots()` loads it, `states(robot)` makes positions, velocities and
accelerations for it; `robots_and_states()` is both. Numbers are short decimals, so that a failing
example can be read and typed. Every link is a possible rigid body.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from hypothesis import strategies as st

from armgpi import Robot

Array = npt.NDArray[np.float64]

TYPES = ("revolute", "continuous", "prismatic")
SHAPES = ("chain", "tree")


class State(NamedTuple):
    """Positions, velocities and accelerations, each of shape (n,)."""

    q: Array
    v: Array
    a: Array


#: An elbow that follows its shoulder three times as far.
FOLLOWS = """<robot name="geared">
<link name="base"/>
<link name="upper"><inertial><origin xyz="0.3 0 0"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.3 0 0"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="50" velocity="2"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.5 0 0"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="6"/>
<mimic joint="shoulder" multiplier="3"/></joint>
</robot>"""


def decimals(lowest: float, highest: float, digits: int = 2) -> st.SearchStrategy[float]:
    """Numbers of a few decimals, which shrink towards zero or the bound nearest to it."""
    scale = 10**digits
    return st.integers(round(lowest * scale), round(highest * scale)).map(lambda i: i / scale)


def triples(bound: float) -> st.SearchStrategy[Array]:
    """Three numbers between -bound and bound."""
    return st.tuples(*[decimals(-bound, bound)] * 3).map(np.array)


# Made once: making a strategy takes longer than drawing from it.
ANGLES = triples(3.14)  # [rad] roll, pitch, yaw
AXES = st.tuples(*[st.integers(-3, 3)] * 3).filter(any).map(lambda xyz: np.array(xyz) / np.linalg.norm(xyz))
BODIES = st.fixed_dictionaries(
    {
        "mass": decimals(0.1, 5.0, digits=1),  # [kg]
        "com": triples(0.3),  # [m]
        "rpy": ANGLES,
        "spread": st.tuples(*[decimals(0.03, 0.2)] * 3),  # [m] standard deviation of mass, per axis
    }
)
JOINTS = st.fixed_dictionaries(
    {
        "xyz": triples(0.4),  # [m]
        "rpy": ANGLES,
        "axis": AXES,
        "lower": decimals(-3.0, 0.0),  # [rad or m]
        "upper": decimals(0.1, 3.0),
        "effort": decimals(1.0, 200.0, digits=0),  # [N m or N]
    }
)
VELOCITIES = decimals(-3.0, 3.0)  # [rad/s or m/s]
ACCELERATIONS = decimals(-10.0, 10.0)  # [rad/s^2 or m/s^2]


@st.composite
def urdf_texts(
    draw: st.DrawFn,
    min_joints: int = 1,
    max_joints: int = 8,
    types: Sequence[str] = TYPES,
    shapes: Sequence[str] = SHAPES,
) -> str:
    """URDFs of so many moving joints joint1, joint2, ... of the given types.

    Joint i carries link i; `base` is the root, with a mass. In a chain, joint i + 1 stands on
    link i; in a tree on any earlier link.
    """
    count = draw(st.integers(min_joints, max_joints))
    shape = draw(st.sampled_from(shapes))
    parts = [link("base", **draw(BODIES))]
    for i in range(1, count + 1):
        parent = i - 1 if shape == "chain" else draw(st.integers(0, i - 1))
        kind = draw(st.sampled_from(types))
        parts.append(link(f"link{i}", **draw(BODIES)))
        parts.append(_joint(i, f"link{parent}" if parent else "base", kind, **draw(JOINTS)))
    return f'<robot name="{shape}{count}">\n{"".join(parts)}</robot>'


def robots(**options: Any) -> st.SearchStrategy[Robot]:
    """Robots loaded from :func:`urdf_texts`, which takes the options."""
    return urdf_texts(**options).map(Robot.from_xml)


@st.composite
def states(draw: st.DrawFn, robot: Robot) -> State:
    """States of a robot: inside its position limits, or within two turns where it has none."""
    lower, upper = np.maximum(robot.limits.lower, -12.0), np.minimum(robot.limits.upper, 12.0)
    q = [draw(decimals(low, high)) for low, high in zip(lower, upper, strict=True)]
    v = [draw(VELOCITIES) for _ in q]
    a = [draw(ACCELERATIONS) for _ in q]
    return State(np.clip(q, lower, upper), np.array(v), np.array(a))


def robots_and_states(**options: Any) -> st.SearchStrategy[tuple[Robot, State]]:
    """A robot from :func:`robots`, which takes the options, and one of its states."""
    return robots(**options).flatmap(lambda robot: st.tuples(st.just(robot), states(robot)))


def link(name: str, mass: float, com: Array, rpy: Array, spread: Sequence[float]) -> str:
    """Return a link that is a possible rigid body.

    Moments built from the spread of the mass along three axes satisfy the triangle inequality.
    """
    x, y, z = (mass * s**2 for s in spread)
    return (
        f'<link name="{name}"><inertial><origin xyz="{words(com)}" rpy="{words(rpy)}"/>'
        f'<mass value="{mass}"/><inertia ixx="{y + z}" iyy="{z + x}" izz="{x + y}" '
        'ixy="0" ixz="0" iyz="0"/></inertial></link>\n'
    )


def _joint(
    i: int,
    parent: str,
    kind: str,
    xyz: Array,
    rpy: Array,
    axis: Array,
    lower: float,
    upper: float,
    effort: float,
) -> str:
    """Return joint i, which carries link i."""
    bounds = "" if kind == "continuous" else f'lower="{lower}" upper="{upper}" '
    return (
        f'<joint name="joint{i}" type="{kind}"><parent link="{parent}"/><child link="link{i}"/>'
        f'<origin xyz="{words(xyz)}" rpy="{words(rpy)}"/><axis xyz="{words(axis)}"/>'
        f'<limit {bounds}effort="{effort}" velocity="10"/></joint>\n'
    )


def words(numbers: Array) -> str:
    """Join numbers as URDF attributes want them, to the last digit."""
    return " ".join(map(repr, numbers.tolist()))
