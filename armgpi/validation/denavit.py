"""An arm from a table of Denavit and Hartenberg parameters: its URDF, and a model to fill in.

Both conventions: in the *standard* one (Paul; Spong; Siciliano) joint i turns about z of frame i-1, and
T = Rz(theta) Tz(d) Tx(a) Rx(alpha); in the *modified* one (Craig) it turns about z of frame i, and
T = Rx(alpha) Tx(a) Rz(theta) Tz(d) with the alpha and a that Craig writes with the index i-1. Centres of mass
and inertias are in the frame of their link, frame i, the inertia about the centre of mass.
"""

from __future__ import annotations

import ast
import csv
import math
import re
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from armgpi.base import files
from armgpi.base.arrays import Array
from armgpi.errors import NameNotFound, ParameterError
from armgpi.validation.template import MOST_JOINTS, Template, equations_to_fill_in

#: Conventions of a table.
CONVENTIONS = ("standard", "modified")
#: Bytes of a table that is read, at most.
_MOST_BYTES = 100_000
#: Columns that a table has to have, and those that it may have.
_NEEDED = ("a", "alpha", "d", "theta", "mass", "cx", "cy", "cz", "ixx", "iyy", "izz")
_OPTIONAL = ("ixy", "ixz", "iyz", "type", "joint")
#: Columns of angles in degrees -> what they stand for.
_DEGREES = {"alpha_deg": "alpha", "theta_deg": "theta"}
#: Columns that are no numbers.
_WORDS = ("type", "joint")
#: A name that a joint may have.
_NAME = re.compile(r"[A-Za-z_][\w.-]*")
#: Gravity [m/s²], how much more torque than that which holds the arm its motors have, and the least [N m].
_GRAVITY, _SPARE, _LEAST_EFFORT = 9.81, 3.0, 1.0
#: Range of a joint that turns [rad] and of one that slides [m], each way, and largest speeds.
_TURN, _SLIDE, _SPEED = 3.1, 1.0, 6.0


class Row(NamedTuple):
    """A joint and its link.

    Attributes:
        a: distance along x [m].
        alpha: angle about x [rad].
        d: distance along z [m]; of a joint that slides where its position is zero.
        theta: angle about z [rad]; of a joint that turns where its position is zero.
        mass: of the link [kg].
        com: centre of mass in the link's frame [m], shape (3,).
        inertia: about the centre of mass, along the axes of that frame [kg m²], shape (3, 3).
        slides: whether the joint is prismatic.
        name: of the joint; q1, q2 and so on where it has none.
    """

    a: float
    alpha: float
    d: float
    theta: float
    mass: float
    com: Array
    inertia: Array
    slides: bool
    name: str


def read_table(path: str | PathLike[str]) -> list[Row]:
    """Return the rows of a table in a CSV file with a header.

    Args:
        path: of the file. Its columns are a, alpha, d, theta, mass, cx, cy, cz, ixx, iyy, izz in SI units, in
            any order, and, where wanted, ixy, ixz, iyz, type (R or P) and joint (its name). Angles may be
            written as pi/2; of columns named alpha_deg and theta_deg they are in degrees.

    Raises:
        ParameterError: when it cannot be read, or a number is none.
        NameNotFound: when a column is missing or unknown.
    """
    try:
        text = files.read_text(path, _MOST_BYTES)
    except (OSError, UnicodeError, ValueError) as error:
        expected = f"a CSV file that can be read: {files.reason(error)}"
        raise ParameterError("dh", str(path), expected) from None
    lines = [line for line in text.lstrip("\ufeff").splitlines() if line.strip() and line.lstrip()[0] != "#"]
    table = csv.reader(lines, skipinitialspace=True)
    header = [name.strip().lower() for name in next(table, [])]
    if len(header) == 1 and ";" in header[0]:
        raise ParameterError(
            "dh", header[0], "a table with commas between its cells, and points in its numbers"
        )
    for name in header:
        if name not in (*_NEEDED, *_OPTIONAL, *_DEGREES):
            raise NameNotFound("column", name, (*_NEEDED, *_OPTIONAL, *_DEGREES))
    meant = [_DEGREES.get(name, name) for name in header]
    for name in _NEEDED:
        if name not in meant:
            raise NameNotFound("column", name, header, f"{Path(path).name} needs {', '.join(_NEEDED)}")
    if len(set(meant)) < len(meant):
        raise ParameterError("dh", ", ".join(header), "every column once")
    rows = [_row(k, _cells(k, header, cells)) for k, cells in enumerate(table, 1)]
    if not 1 <= len(rows) <= MOST_JOINTS:
        raise ParameterError("dh", len(rows), f"1 to {MOST_JOINTS} rows, one for each joint")
    names = [row.name for row in rows]
    if len(set(names)) < len(names):
        raise ParameterError("dh, joint", ", ".join(names), "a name of its own for every joint")
    return rows


def _cells(joint: int, header: list[str], cells: list[str]) -> dict[str, str]:
    """Return the cells of a row by the names of their columns.

    Raises:
        ParameterError: when there are more or fewer than columns.
    """
    if len(cells) < len(header) or any(cell.strip() for cell in cells[len(header) :]):
        # The numbers behind a comma that is forgotten, or too much, would be taken for others.
        expected = f"one cell for each of its {len(header)} columns"
        raise ParameterError(f"row {joint} of the table", f"{len(cells)} cells", expected)
    return dict(zip(header, cells, strict=False))


def _row(joint: int, cells: dict[str, str]) -> Row:
    """Return a row of a table.

    Raises:
        ParameterError: when a number is none, or no body has such a mass and inertia.
    """
    x = _numbers_of(joint, cells)
    kind = cells.get("type", "").strip().lower() or "r"
    if kind[0] not in "rp":
        raise ParameterError(f"row {joint}, type", kind, "R (turns) or P (slides)")
    inertia = np.array(
        [
            [x["ixx"], x["ixy"], x["ixz"]],
            [x["ixy"], x["iyy"], x["iyz"]],
            [x["ixz"], x["iyz"], x["izz"]],
        ]
    )
    if x["mass"] < 0.0:
        raise ParameterError(f"row {joint}, mass", x["mass"], "at least 0 kg")
    if np.linalg.eigvalsh(inertia)[0] < -1e-12:
        raise ParameterError(f"row {joint}, inertia", inertia.tolist(), "no negative principal moment")
    com = np.array([x["cx"], x["cy"], x["cz"]])
    own = _name(joint, cells.get("joint", "").strip())
    return Row(x["a"], x["alpha"], x["d"], x["theta"], x["mass"], com, inertia, kind[0] == "p", own)


def _numbers_of(joint: int, cells: dict[str, str]) -> dict[str, float]:
    """Return the numbers of a row by the names of their columns, angles in radians.

    Raises:
        ParameterError: when one is no number, or an angle can only be in degrees.
    """
    x = {}
    for name in (*_NEEDED, *_OPTIONAL):
        if name not in _WORDS:
            x[name] = _number(joint, name, cells.get(name) or "0")
    for column, angle in _DEGREES.items():
        if column in cells:
            x[angle] = math.radians(_number(joint, column, cells[column] or "0"))
    for angle in _DEGREES.values():
        if abs(x[angle]) > 2.0 * math.pi + 1e-9:
            expected = f"an angle in radians, at most 2 pi; degrees stand in a column named {angle}_deg"
            raise ParameterError(f"row {joint}, {angle}", x[angle], expected)
    return x


def _name(joint: int, text: str) -> str:
    """Return the name of a joint: its own, or q and its number where there is none, or its number alone.

    Raises:
        ParameterError: for what is no name.
    """
    if text in ("", str(joint)):
        return f"q{joint}"
    if not _NAME.fullmatch(text):
        raise ParameterError(f"row {joint}, joint", text, "a name of letters, digits, '_', '-' and '.'")
    return text


def _number(joint: int, name: str, text: str) -> float:
    """Return a number that may be written with pi: "0.5", "-pi/2".

    Raises:
        ParameterError: for anything else.
    """
    try:
        value = _value(ast.parse(text.strip(), mode="eval").body)
    except (SyntaxError, ValueError, ArithmeticError, RecursionError, MemoryError):
        value = math.nan
    if not math.isfinite(value):
        raise ParameterError(f"row {joint}, {name}", text, "a number in SI units, such as 0.5 or pi/2")
    return value


def _value(node: ast.expr) -> float:
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            return float(value)
        case ast.Name(id="pi"):
            return math.pi
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_value(operand)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _value(operand)
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            return _value(left) * _value(right)
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            return _value(left) / _value(right)
    raise ValueError


def from_table(rows: list[Row], convention: str = "standard") -> Template:
    """Return the URDF of an arm, and a model of it whose equations are to be filled in.

    Args:
        rows: of its table, from the base to the tip.
        convention: "standard" or "modified".

    Raises:
        NameNotFound: for another convention.
    """
    if convention not in CONVENTIONS:
        raise NameNotFound("convention", convention, CONVENTIONS)
    return Template(_urdf(rows, convention), _model(rows, convention))


def transform(row: Row, convention: str) -> pin.SE3:
    """Return the pose of a link's frame in the one before, where the joint is at zero."""
    about_x = pin.SE3(pin.rpy.rpyToMatrix(row.alpha, 0.0, 0.0), np.array([row.a, 0.0, 0.0]))
    about_z = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, row.theta), np.array([0.0, 0.0, row.d]))
    return about_z * about_x if convention == "standard" else about_x * about_z


def _urdf(rows: list[Row], convention: str) -> str:
    """Return the text of a URDF.

    The frame of a link in it is the one about whose z its joint moves, moved with the joint: in the
    standard convention the link's own frame of the table is one transform further.
    """
    lines = [f'<robot name="dh{len(rows)}">', '  <link name="base"/>']
    before = pin.SE3.Identity()
    for k, row in enumerate(rows, start=1):
        pose = transform(row, convention)
        origin, frame = (before, pose) if convention == "standard" else (pose, pin.SE3.Identity())
        before = pose
        com = frame * row.com
        effort = _effort(rows[k - 1 :])
        moments = " ".join(
            f'i{"xyz"[i]}{"xyz"[j]}="{float(row.inertia[i, j])!r}"' for i in range(3) for j in range(i, 3)
        )
        parent = f"link{k - 1}" if k > 1 else "base"
        kind, reach = ("prismatic", _SLIDE) if row.slides else ("revolute", _TURN)
        lines += [
            f'  <link name="link{k}">',
            f"    <inertial>{_origin(pin.SE3(frame.rotation, com))}",
            f'      <mass value="{row.mass!r}"/><inertia {moments}/></inertial>',
            "  </link>",
            f'  <joint name="{row.name}" type="{kind}">',
            f'    <parent link="{parent}"/><child link="link{k}"/>',
            f'    {_origin(origin)}<axis xyz="0 0 1"/>',
            f'    <limit lower="-{reach}" upper="{reach}" effort="{effort}" velocity="{_SPEED}"/>',
            "  </joint>",
        ]
    taken = {row.name for row in rows}
    fixed = next(name for name in ("tip", *(f"tip{k}" for k in range(len(rows)))) if name not in taken)
    tip = before if convention == "standard" else pin.SE3.Identity()
    lines += [
        '  <link name="tool"/>',
        f'  <joint name="{fixed}" type="fixed">',
        f'    <parent link="link{len(rows)}"/><child link="tool"/>{_origin(tip)}',
        "  </joint>",
        "</robot>",
    ]
    return "\n".join(lines) + "\n"


def _origin(pose: pin.SE3) -> str:
    """Return the pose of a frame as an element of a URDF, with all digits that it has."""
    xyz = " ".join(f"{x:.17g}" for x in pose.translation + 0.0)
    rpy = " ".join(f"{x:.17g}" for x in pin.rpy.matrixToRpy(pose.rotation) + 0.0)
    return f'<origin xyz="{xyz}" rpy="{rpy}"/>'


def _effort(rows: list[Row]) -> float:
    """Return the torque or force limit of a joint that carries some links: enough to hold them anywhere."""
    mass = sum(row.mass for row in rows)
    reach = sum(math.hypot(row.a, row.d) + float(np.linalg.norm(row.com)) for row in rows)
    lever = 1.0 if rows[0].slides else reach
    return round(max(_SPARE * _GRAVITY * mass * lever, _LEAST_EFFORT), 1)


def _listed(values: list[float]) -> str:
    """Return numbers as a list of Python."""
    return f"[{', '.join(repr(float(x) + 0.0) for x in values)}]"  # all digits, as the URDF has them


def _numbers(rows: list[Row]) -> str:
    """Return the numbers of a table as assignments of Python."""
    numbers = [
        ("a", "[m]", _listed([row.a for row in rows])),
        ("alpha", "[rad]", _listed([row.alpha for row in rows])),
        ("d", "[m]", _listed([row.d for row in rows])),
        ("theta", "[rad]", _listed([row.theta for row in rows])),
        ("slides", "joints that slide", repr([row.slides for row in rows])),
        ("m", "masses [kg]", _listed([row.mass for row in rows])),
    ]
    lines = [f"{name} = {text}  # {meaning}" for name, meaning, text in numbers]
    lines += [
        "# centres of mass, and inertias about them, in the frames of the links [m], [kg m²]",
        "com = [",
    ]
    lines += [f"    {_listed(row.com.tolist())}," for row in rows]
    lines += ["]", "inertia = ["]
    lines += [f"    [{', '.join(map(_listed, row.inertia.tolist()))}]," for row in rows]
    return "\n".join([*lines, "]"])


def _model(rows: list[Row], convention: str) -> str:
    n = len(rows)
    joints = "one joint" if n == 1 else f"{n} joints"
    product = "turn_z @ turn_x" if convention == "standard" else "turn_x @ turn_z"
    return f'''"""Arm of {joints} by Denavit and Hartenberg ({convention} convention); fill in D, C v and G:

armgpi validate NAME.py --robot NAME.urdf

Gravity points against z of the base. What an entry lacks is said as a formula.
"""

import numpy as np

{_numbers(rows)}
g = {_GRAVITY}  # [m/s²]


def transform(k, q):
    """Return the pose of the frame of link k in the one before ({convention} convention), k from 0."""
    angle, along = (theta[k], d[k] + q[k]) if slides[k] else (theta[k] + q[k], d[k])
    c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha[k]), np.sin(alpha[k])
    turn_z = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, along], [0, 0, 0, 1]])
    turn_x = np.array([[1, 0, 0, a[k]], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1]])
    return {product}


def forward_kinematics(q):
    pose = np.eye(4)
    for k in range({n}):
        pose = pose @ transform(k, q)
    return pose


{equations_to_fill_in(n)}'''
