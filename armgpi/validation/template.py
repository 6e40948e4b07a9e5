"""An arm to begin with: the URDF of a planar arm, and a model of it whose equations are to be filled in."""

from __future__ import annotations

from typing import NamedTuple

from armgpi.base.arrays import check_whole

#: Joints of a planar arm that is written, at most: a model by hand of more is rare.
MOST_JOINTS = 7
#: Gravity [m/s²], and how much more torque than that which holds the arm its motors have.
_GRAVITY, _SPARE = 9.81, 3.0


class Template(NamedTuple):
    """An arm to begin with.

    Attributes:
        urdf: text of the URDF.
        model: text of the Python file with the model to fill in; NAME stands for the file's name.
    """

    urdf: str
    model: str

    def model_for(self, name: str) -> str:
        """Return the text of the model for files of a name."""
        return self.model.replace("NAME", name)


class _Link(NamedTuple):
    """A rod: mass [kg], length, distance of its centre of mass [m], inertia about that [kg m²]."""

    m: float
    l: float  # noqa: E741 (the letter of the field)
    lc: float
    I: float  # noqa: E741


def planar(joints: int) -> Template:
    """Return an arm of parallel joints in a vertical plane, level where all angles are zero.

    Args:
        joints: how many, from 1 to 7.

    Raises:
        ParameterError: for another number.
    """
    joints = check_whole(joints, "planar", 1, MOST_JOINTS)
    links = [_link(k) for k in range(joints)]
    return Template(_urdf(links), _model(links))


def _link(k: int) -> _Link:
    """Return a link with numbers that are not in simple ratios: these hide no mistake."""
    m, l = round(2.1 * 0.7**k, 3), round(0.41 * 0.83**k, 3)  # noqa: E741
    return _Link(m, l, round(0.46 * l, 4), round(m * l**2 / 11.0, 5))


def _urdf(links: list[_Link]) -> str:
    count = len(links)
    lines = [f'<robot name="planar{count}">', '  <link name="base"/>']
    for k, link in enumerate(links, start=1):
        reach = sum(each.l for each in links[k - 1 :])
        effort = round(_SPARE * _GRAVITY * reach * sum(each.m for each in links[k - 1 :]), 1)
        moments = f'ixx="{link.I / 20.0:.6g}" iyy="{link.I}" izz="{link.I}" ixy="0" ixz="0" iyz="0"'
        at = links[k - 2].l if k > 1 else 0
        lines += [
            f'  <link name="link{k}">',
            f'    <inertial><origin xyz="{link.lc} 0 0"/><mass value="{link.m}"/>',
            f"      <inertia {moments}/></inertial>",
            "  </link>",
            f'  <joint name="q{k}" type="revolute">',
            f'    <parent link="{f"link{k - 1}" if k > 1 else "base"}"/><child link="link{k}"/>',
            f'    <origin xyz="{at} 0 0"/><axis xyz="0 -1 0"/>',
            f'    <limit lower="-3.1" upper="3.1" effort="{effort}" velocity="6"/>',
            "  </joint>",
        ]
    lines += [
        '  <link name="tool"/>',
        '  <joint name="tip" type="fixed">',
        f'    <parent link="link{count}"/><child link="tool"/><origin xyz="{links[-1].l} 0 0"/>',
        "  </joint>",
        "</robot>",
    ]
    return "\n".join(lines) + "\n"


def _model(links: list[_Link]) -> str:
    n = len(links)
    names = "NAME"
    numbers = [
        f"# {meaning}\n"
        f"{', '.join(f'{field}{k}' for k in range(1, n + 1))} = {', '.join(f'{x!r}' for x in values)}"
        for field, meaning, values in (
            ("m", "masses [kg]", [link.m for link in links]),
            ("l", "lengths [m]", [link.l for link in links]),
            ("lc", "distances of the centres of mass from the joints [m]", [link.lc for link in links]),
            ("I", "inertias about the centres of mass [kg m²]", [link.I for link in links]),
        )
    ]
    joints = "one joint" if n == 1 else f"{n} joints"
    first = f"D[0, 0] = I1 + m1 * lc1**2{' + ...' if n > 1 else ''}"
    angle = " + ".join(f"q[{k}]" for k in range(n))
    last = f"G[{n - 1}] = m{n} * g * lc{n} * np.cos({angle})"
    return f'''"""Planar arm of {joints} in a vertical plane; fill in D, C v and G, and compare them:

armgpi validate {names}.py --robot {names}.urdf

Each angle is measured from the link before; at zero all links are horizontal. The command prints what is
missing in each entry as a formula.
"""

import numpy as np

{chr(10).join(numbers)}
g = {_GRAVITY}  # [m/s²]


{equations_to_fill_in(n, first, last)}'''


def equations_to_fill_in(n: int, inertia: str = "", gravity: str = "") -> str:
    """Return the equations of motion of a model, all zero.

    Args:
        n: number of joints.
        inertia: an entry of D to begin with, as a comment; empty for none.
        gravity: an entry of G, likewise.
    """
    inertia_line = f"    # {inertia}\n" if inertia else ""
    gravity_line = f"    # {gravity}\n" if gravity else ""
    return f"""def mass_matrix(q):
    D = np.zeros(({n}, {n}))
{inertia_line}    return D


def coriolis_torque(q, v):
    h = np.zeros({n})
    return h


def gravity(q):
    G = np.zeros({n})
{gravity_line}    return G
"""
