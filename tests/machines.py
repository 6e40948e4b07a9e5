"""Small machines whose motion has a closed form, for tests that need one."""

from __future__ import annotations

from armgpi import Robot


def sled(
    mass: float = 1.0,
    damping: float = 0.0,
    friction: float = 0.0,
    axis: str = "1 0 0",
    bounds: str = 'lower="-1e6" upper="1e6"',
) -> Robot:
    """A mass on a rail, level unless its axis is "0 0 1": mass times acceleration is force."""
    return Robot.from_xml(
        f'<robot name="sled"><link name="base"/>{_link("body", mass)}'
        f'<joint name="x" type="prismatic"><parent link="base"/><child link="body"/>'
        f'<axis xyz="{axis}"/><limit {bounds} effort="1e9" velocity="1e3"/>'
        f'<dynamics damping="{damping}" friction="{friction}"/></joint></robot>'
    )


def swing(count: int = 1, axis: str = "0 -1 0") -> Robot:
    """`count` equal links of 1 kg and 1 m in a plane: pendulums, or with axis "0 0 1" a level arm.

    At q = 0 they stretch along +X; positive angles about -Y lift them.
    """
    parts = ['<robot name="swing"><link name="link0"/>']
    for i in range(1, count + 1):
        parts.append(_link(f"link{i}", 1.0, "0.5 0 0"))
        parts.append(
            f'<joint name="joint{i}" type="continuous"><parent link="link{i - 1}"/>'
            f'<child link="link{i}"/><origin xyz="{float(i > 1)} 0 0"/><axis xyz="{axis}"/>'
            '<limit effort="1e9" velocity="1e3"/></joint>'
        )
    return Robot.from_xml("".join(parts) + "</robot>")


def _link(name: str, mass: float, com: str = "0 0 0") -> str:
    """A thin rod along X, 1 m long."""
    across = mass / 12.0
    return (
        f'<link name="{name}"><inertial><origin xyz="{com}"/><mass value="{mass}"/>'
        f'<inertia ixx="{across * 1e-2}" iyy="{across}" izz="{across}" '
        'ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
