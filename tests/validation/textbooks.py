"""Arms as textbooks and students write them, each with its robot; what `validate` is measured on.

`corpus/` has one model per file, written by hand. The numbers in it are replaced by random ones, and the
robot is made of the same numbers. SEEN arms were used while the diagnosis was written: whatever `validate`
missed in them may have changed it. UNSEEN arms only measure it: nothing may be mended because of them.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armgpi import Robot

FOLDER = Path(__file__).parent / "corpus"
SEEN = (
    "cart_pole",
    "rr_textbook",
    "furuta",
    "rr_energies",
    "scara",
    "rrp_sympy",
    "rrr_christoffel",
    "rpr_inverse",
    "dh3_jacobian",
    "ne3_base",
    "pendubot",
    "acrobot",
    "rp_polar",
    "rr_forward",
    "ppp_gantry",
    "rr_sympy",
    "rrr_planar",
    "rrr_class",
    "prr_jacobian",
    "ne4",
    "rr_recursive",
    "rrr_numeric",
    "scara_tau",
    "rrp_points",
    "cart_hanging",
    "prr_lagrange",
)
#: Written and committed before anything was tried on them.
UNSEEN = (
    "rr_regressor",
    "rrr_screws",
    "rpp_cylinder",
    "ne3_roll",
    "rr_kane",
    "rrrr_chain",
    "rrpr_matlab",
    "rr_complex",
    "rp_lagrange",
    "rr_elbow",
    "rrp_newton",
    "rr_uicker",
    "rrr_spatial",
    "rrp_spherical",
)

Numbers = Mapping[str, float]
Vector = tuple[float, float, float]
NONE = (0.0, 0.0, 0.0)


class Joint(NamedTuple):
    """A joint and what it carries: moments of inertia along axes turned by `turned` (roll, pitch, yaw)."""

    kind: str
    axis: str
    xyz: Vector
    mass: float
    com: Vector
    moments: Vector
    rpy: Vector = NONE
    turned: Vector = NONE


def _round(i: float) -> Vector:
    return (i, i, i)


def _turn(axis: str, xyz: Vector, mass: float, com: Vector, moments: Vector, **more: Vector) -> Joint:
    return Joint("revolute", axis, xyz, mass, com, moments, **more)


def _slide(axis: str, xyz: Vector, mass: float, com: Vector, moments: Vector) -> Joint:
    return Joint("prismatic", axis, xyz, mass, com, moments)


UP, LIFT, DIP = "0 0 1", "0 -1 0", "0 1 0"


def _lifting(p: Numbers) -> list[Joint]:
    return [
        _turn(LIFT, NONE, p["m1"], (p["lc1"], 0, 0), _round(p["I1"])),
        _turn(LIFT, (p["l1"], 0, 0), p["m2"], (p["lc2"], 0, 0), _round(p["I2"])),
    ]


def _hanging(p: Numbers) -> list[Joint]:
    return [
        _turn(DIP, NONE, p["m1"], (0, 0, -p["lc1"]), _round(p["I1"])),
        _turn(DIP, (0, 0, -p["l1"]), p["m2"], (0, 0, -p["lc2"]), _round(p["I2"])),
    ]


def _rp_polar(p: Numbers) -> list[Joint]:
    return [
        _turn(LIFT, NONE, p["m1"], (p["lc1"], 0, 0), _round(p["I1"])),
        _slide("1 0 0", NONE, p["m2"], NONE, _round(p["I2"])),
    ]


def _rp_lagrange(p: Numbers) -> list[Joint]:
    return [
        _turn(LIFT, NONE, p["m1"], (p["lc1"], 0, 0), _round(p["I1"])),
        _slide("1 0 0", NONE, p["m2"], (-p["lc2"], 0, 0), _round(p["I2"])),
    ]


def _rrp_newton(p: Numbers) -> list[Joint]:
    return _scara({**p, "lc1": p["r1"], "lc2": p["r2"]})


def _ppp_gantry(p: Numbers) -> list[Joint]:
    axes = ("1 0 0", "0 1 0", "0 0 1")
    return [_slide(axis, NONE, p[f"m{i + 1}"], NONE, _round(0.01)) for i, axis in enumerate(axes)]


def _scara(p: Numbers) -> list[Joint]:
    return [
        _turn(UP, NONE, p["m1"], (p["lc1"], 0, 0), _round(p["I1"])),
        _turn(UP, (p["l1"], 0, 0), p["m2"], (p["lc2"], 0, 0), _round(p["I2"])),
        _slide("0 0 -1", (p["l2"], 0, 0), p["m3"], NONE, _round(p["I3"])),
    ]


def _rrp_sympy(p: Numbers) -> list[Joint]:
    return [
        _turn(UP, NONE, 1.0, NONE, _round(p["I1"])),
        _turn(LIFT, (0, 0, p["h1"]), p["m2"], (p["lc2"], 0, 0), _round(p["I2"])),
        _slide("1 0 0", NONE, p["m3"], (-p["lc3"], 0, 0), _round(p["I3"])),
    ]


def _rrr_christoffel(p: Numbers) -> list[Joint]:
    return [
        _turn(UP, NONE, 1.0, NONE, _round(p["I1"])),
        _turn(LIFT, NONE, p["m2"], (p["lc2"], 0, 0), (p["Ix2"], p["Iy2"], p["Iy2"])),
        _turn(LIFT, (p["l2"], 0, 0), p["m3"], (p["lc3"], 0, 0), (p["Ix3"], p["Iy3"], p["Iy3"])),
    ]


def _dh3_jacobian(p: Numbers) -> list[Joint]:
    a, b, c, quarter = p["Ia"], p["Ib"], p["Ic"], (pi / 2, 0.0, 0.0)
    return [
        _turn(UP, NONE, p["m1"], (0, 0, p["d1"] + p["x1"]), (a, b, c), turned=quarter),
        _turn(UP, (0, 0, p["d1"]), p["m2"], (p["a2"] + p["x2"], 0, 0), (b, c, a), rpy=quarter),
        _turn(UP, (p["a2"], 0, 0), p["m3"], (p["a3"] + p["x3"], 0, 0), (b, a, c)),
    ]


def _ne4(p: Numbers) -> list[Joint]:
    a, b, c, quarter = p["Ia"], p["Ib"], p["Ic"], (pi / 2, 0.0, 0.0)
    return [
        _turn(UP, NONE, p["m1"], (0, 0, p["d1"] + p["y1"]), (a, b, c), turned=quarter),
        _turn(UP, (0, 0, p["d1"]), p["m2"], (p["a2"] + p["x2"], 0, 0), (b, c, a), rpy=quarter),
        _turn(UP, (p["a2"], 0, 0), p["m3"], (p["a3"] + p["x3"], 0, 0), (b, a, c), turned=quarter),
        _turn(UP, (p["a3"], 0, 0), p["m4"], (0, 0, p["d4"] + p["z4"]), (a, c, b), rpy=quarter),
    ]


def _cart_pole(p: Numbers) -> list[Joint]:
    return [
        _slide("1 0 0", NONE, p["M"], NONE, _round(0.01)),
        _turn(LIFT, NONE, p["m"], (0, 0, p["r"]), _round(p["J"])),
    ]


def _furuta(p: Numbers) -> list[Joint]:
    return [
        _turn(UP, NONE, p["m1"], (p["lc1"], 0, 0), _round(p["J1"])),
        _turn("1 0 0", (p["L1"], 0, 0), p["m2"], (0, 0, -p["lc2"]), (p["J2"], p["J2"], 0.0)),
    ]


def _rrr_class(p: Numbers) -> list[Joint]:
    return [
        _turn(UP, NONE, 1.0, NONE, _round(p["I1"])),
        _turn(DIP, (p["l1"], 0, 0), p["m2"], (p["lc2"], 0, 0), _round(p["I2"])),
        _turn(DIP, (p["l2"], 0, 0), p["m3"], (p["lc3"], 0, 0), _round(p["I3"])),
    ]


def _prr_jacobian(p: Numbers) -> list[Joint]:
    return [
        _slide(UP, NONE, p["m1"], NONE, _round(0.01)),
        _turn(UP, NONE, p["m2"], (p["lc2"], 0, 0), _round(p["I2"])),
        _turn(UP, (p["l2"], 0, 0), p["m3"], (p["lc3"], 0, 0), _round(p["I3"])),
    ]


def _ne3_base(p: Numbers) -> list[Joint]:
    a, b, c = p["Ia"], p["Ib"], p["Ic"]
    return [
        _turn(UP, NONE, p["m1"], (p["c1"], 0, 0), (a, b, c)),
        _turn(DIP, (0, 0, p["h1"]), p["m2"], (p["c2"], 0, 0), (b, c, a)),
        _turn(DIP, (p["l2"], 0, 0), p["m3"], (p["c3"], 0, 0), (a, c, b)),
    ]


def _rpr_inverse(p: Numbers) -> list[Joint]:
    return [
        _turn(LIFT, NONE, p["m1"], (p["lc1"], 0, 0), _round(p["I1"])),
        _slide("1 0 0", NONE, p["m2"], (-p["lc2"], 0, 0), _round(p["I2"])),
        _turn(LIFT, NONE, p["m3"], (p["lc3"], 0, 0), _round(p["I3"])),
    ]


def _rrr_planar(p: Numbers) -> list[Joint]:
    return [
        *_lifting(p),
        _turn(LIFT, (p["l2"], 0, 0), p["m3"], (p["lc3"], 0, 0), _round(p["I3"])),
    ]


def _rrr_screws(p: Numbers) -> list[Joint]:
    a, b, c = p["Ia"], p["Ib"], p["Ic"]
    return [
        _turn(UP, NONE, p["m1"], NONE, (a, b, c)),
        _turn(LIFT, (0, 0, p["h1"]), p["m2"], (p["c2"], 0, 0), (b, c, a)),
        _turn(LIFT, (p["l2"], 0, 0), p["m3"], (p["c3"], 0, 0), (a, c, b)),
    ]


def _rpp_cylinder(p: Numbers) -> list[Joint]:
    return [
        _turn(UP, NONE, 1.0, NONE, _round(p["I1"])),
        _slide(UP, NONE, p["m2"], NONE, _round(p["I2"])),
        _slide("1 0 0", (0, p["e3"], 0), p["m3"], (-p["lc3"], 0, 0), _round(p["I3"])),
    ]


def _ne3_roll(p: Numbers) -> list[Joint]:
    a, b, c = p["Ia"], p["Ib"], p["Ic"]
    return [
        _turn(UP, NONE, p["m1"], (p["x1"], 0, 0), (a, b, c)),
        _turn(DIP, (0, 0, p["h1"]), p["m2"], (p["x2"], 0, 0), (b, c, a)),
        _turn("1 0 0", (p["l2"], 0, 0), p["m3"], (p["x3"], p["y3"], 0), (a, c, b)),
    ]


def _rr_kane(p: Numbers) -> list[Joint]:
    # The load m3 is a point at the end of the arm.
    m2, m3 = p["m2"], p["m3"]
    com = (m2 * p["lc2"] + m3 * p["l2"]) / (m2 + m3)
    spread = m2 * (p["lc2"] - com) ** 2 + m3 * (p["l2"] - com) ** 2
    moments = (p["Ix2"], p["Iy2"] + spread, p["Iz2"] + spread)
    return [
        _turn(UP, NONE, 1.0, NONE, _round(p["I1"])),
        _turn(LIFT, (p["l1"], 0, 0), m2 + m3, (com, 0, 0), moments),
    ]


def _rrrr_chain(p: Numbers) -> list[Joint]:
    joints, x = [], 0.0
    for k in (1, 2, 3, 4):
        joints.append(_turn(LIFT, (x, 0, 0), p[f"m{k}"], (p[f"lc{k}"], 0, 0), _round(p[f"I{k}"])))
        x = p.get(f"l{k}", 0.0)
    return joints


def _prr_lagrange(p: Numbers) -> list[Joint]:
    back = "0 -1 0"
    return [
        _slide("1 0 0", NONE, p["m1"], NONE, _round(0.01)),
        _turn(back, NONE, p["m2"], (0, 0, -p["lc2"]), _round(p["I2"])),
        _turn(back, (0, 0, -p["l2"]), p["m3"], (0, 0, -p["lc3"]), _round(p["I3"])),
    ]


def _rrpr_matlab(p: Numbers) -> list[Joint]:
    return [
        _turn(UP, NONE, p["m1"], (p["r1"], 0, 0), _round(p["I1"])),
        _turn(UP, (p["a1"], 0, 0), p["m2"], (p["r2"], 0, 0), _round(p["I2"])),
        _slide("0 0 -1", (p["a2"], 0, 0), p["m3"], NONE, _round(p["I3"])),
        _turn(UP, NONE, p["m4"], NONE, _round(p["I4"])),
    ]


def _rr_complex(p: Numbers) -> list[Joint]:
    return [
        _turn(UP, NONE, p["m1"], (p["lc1"], 0, 0), _round(p["J1"])),
        _turn("1 0 0", (p["L1"], 0, 0), p["m2"], (0, 0, -p["lc2"]), (p["J2"], p["J2"], 0.0)),
    ]


#: Arm -> its joints, and where its tool is on the last link.
ARMS: dict[str, tuple[Callable[[Numbers], list[Joint]], Callable[[Numbers], Vector]]] = {
    "rr_textbook": (_lifting, lambda _: NONE),
    "acrobot": (_hanging, lambda _: NONE),
    "pendubot": (_lifting, lambda _: NONE),
    "rp_polar": (_rp_polar, lambda _: NONE),
    "ppp_gantry": (_ppp_gantry, lambda p: (0, 0, -p["l3"])),
    "scara": (_scara, lambda _: NONE),
    "rrp_sympy": (_rrp_sympy, lambda _: NONE),
    "rrr_christoffel": (_rrr_christoffel, lambda _: NONE),
    "dh3_jacobian": (_dh3_jacobian, lambda p: (p["a3"], 0, 0)),
    "ne4": (_ne4, lambda _: NONE),
    "cart_pole": (_cart_pole, lambda _: NONE),
    "furuta": (_furuta, lambda _: NONE),
    "rr_energies": (_lifting, lambda _: NONE),
    "rr_forward": (_hanging, lambda _: NONE),
    "rrr_class": (_rrr_class, lambda _: NONE),
    "prr_jacobian": (_prr_jacobian, lambda _: NONE),
    "ne3_base": (_ne3_base, lambda _: NONE),
    "rr_sympy": (_lifting, lambda _: NONE),
    "rpr_inverse": (_rpr_inverse, lambda _: NONE),
    "rrr_planar": (_rrr_planar, lambda _: NONE),
    "rr_recursive": (_lifting, lambda _: NONE),
    "rrr_numeric": (_rrr_planar, lambda _: NONE),
    "scara_tau": (_scara, lambda _: NONE),
    "rrp_points": (_rrp_sympy, lambda _: NONE),
    "cart_hanging": (_cart_pole, lambda _: NONE),
    "rr_regressor": (_lifting, lambda _: NONE),
    "rrr_screws": (_rrr_screws, lambda _: NONE),
    "rpp_cylinder": (_rpp_cylinder, lambda _: NONE),
    "ne3_roll": (_ne3_roll, lambda _: NONE),
    "rr_kane": (_rr_kane, lambda _: NONE),
    "rrrr_chain": (_rrrr_chain, lambda _: NONE),
    "prr_lagrange": (_prr_lagrange, lambda _: NONE),
    "rrpr_matlab": (_rrpr_matlab, lambda _: NONE),
    "rr_complex": (_rr_complex, lambda _: NONE),
    "rp_lagrange": (_rp_lagrange, lambda _: NONE),
    "rr_elbow": (_lifting, lambda _: NONE),
    "rrp_newton": (_rrp_newton, lambda _: NONE),
    "rr_uicker": (_lifting, lambda _: NONE),
    "rrr_spatial": (_rrr_christoffel, lambda _: NONE),
    "rrp_spherical": (_rrp_sympy, lambda _: NONE),
}


def text(name: str, seed: int | None = None) -> str:
    """Return the model's source, with random numbers for a seed."""
    source = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
    return source if seed is None else renumbered(source, seed)


def renumbered(source: str, seed: int) -> str:
    """Return a source with random numbers for its symbols, the same for every source with these symbols."""
    lines = source.splitlines(keepends=True)
    for symbol, node in sorted(_named(source), key=lambda one: -one[1].lineno * 1000 - one[1].col_offset):
        if symbol not in ("g", "n"):
            k = node.lineno - 1
            new = _draw(np.random.default_rng([seed, *symbol.encode()]), symbol)
            lines[k] = lines[k][: node.col_offset] + repr(new) + lines[k][node.end_col_offset :]
    return "".join(lines)


def _named(source: str) -> list[tuple[str, ast.expr]]:
    """Return the symbols that a source gives numbers, and where those stand."""
    found: list[tuple[str, ast.expr]] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            found.append((node.targets[0].id, node.value))
        elif isinstance(node, ast.Dict):
            items = zip(node.keys, node.values, strict=True)
            found += [(str(k.value), v) for k, v in items if isinstance(k, ast.Constant)]
    return [(symbol, value) for symbol, value in found if _is_number(value)]


def _is_number(node: ast.expr) -> bool:
    inner = node.operand if isinstance(node, ast.UnaryOp) else node
    return isinstance(inner, ast.Constant) and isinstance(inner.value, float)


def _draw(rng: np.random.Generator, symbol: str) -> float:
    """Return a number of the kind that a symbol's first letter says, of four digits at most."""
    if symbol[0] in "mM":
        return round(float(rng.uniform(0.3, 3.0)), 3)
    if symbol[0] in "IJ":
        return round(float(rng.uniform(0.01, 0.0199)), 5)
    if symbol[0] in "xyz":
        return -round(float(rng.uniform(0.03, 0.2)), 4)
    return round(float(rng.uniform(0.05, 0.6)), 4)


def numbers(source: str) -> dict[str, float]:
    """Return the numbers that a model's source gives its symbols."""
    return {symbol: float(ast.literal_eval(node)) for symbol, node in _named(source)}


def robot(name: str, source: str) -> Robot:
    """Return the robot that a right model describes."""
    return Robot.from_xml(urdf(name, source))


def urdf(name: str, source: str) -> str:
    """Return the same as text."""
    p = numbers(source)
    build, tool = ARMS[name]
    return written(name, build(p), tool(p))


def written(name: str, joints: list[Joint], tool: Vector = NONE) -> str:
    """Return the URDF of some joints."""
    parts, parent = [f'<robot name="{name}"><link name="base"/>'], "base"
    for i, j in enumerate(joints, start=1):
        x, y, z = j.moments
        bounds = 'lower="0.05" upper="0.6"' if j.kind == "prismatic" else 'lower="-3" upper="3"'
        parts.append(
            f'<link name="link{i}"><inertial><origin xyz="{_of(j.com)}" rpy="{_of(j.turned)}"/>'
            f'<mass value="{j.mass!r}"/>'
            f'<inertia ixx="{x!r}" iyy="{y!r}" izz="{z!r}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="q{i}" type="{j.kind}"><parent link="{parent}"/><child link="link{i}"/>'
            f'<origin xyz="{_of(j.xyz)}" rpy="{_of(j.rpy)}"/><axis xyz="{j.axis}"/>'
            f'<limit {bounds} effort="50" velocity="5"/></joint>'
        )
        parent = f"link{i}"
    parts.append(
        f'<link name="tool"/><joint name="grip" type="fixed"><parent link="{parent}"/><child link="tool"/>'
        f'<origin xyz="{_of(tool)}"/></joint></robot>'
    )
    return "".join(parts)


def joints(source: str) -> int:
    """Return how many joints the arm has that a source describes, known by its first line."""
    name = next(name for name in ARMS if text(name).splitlines()[0] == source.splitlines()[0])
    return len(ARMS[name][0](numbers(text(name))))


def _of(vector: Any) -> str:
    return " ".join(repr(float(x)) for x in vector)
