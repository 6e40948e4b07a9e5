"""Arms with their dynamics derived by hand, and mistakes planted in them.

The planar arm and the SCARA are textbook formulas, written out here; the spatial arm and the Stanford-like
one are what `armgpi.derive` makes, which uses no Pinocchio; the paper's arm is its printed equations. A
mistake is planted by changing formulas, coordinates or numbers, never with the code that finds it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi import Robot, derive
from armgpi.paper.arm import ArmParameters, PaperArm

Array = npt.NDArray[np.float64]
Model = dict[str, Callable[..., Any]]
G = 9.81


class Case(NamedTuple):
    """A planted mistake: functions that must differ, an entry to be named, and the cause as a pattern."""

    name: str
    model: Any
    functions: tuple[str, ...]
    entry: str
    cause: str


class Arm(NamedTuple):
    """A robot and a right model of it."""

    robot: Robot
    model: Model


def _link(name: str, mass: float, com: Sequence[float], moments: Sequence[float]) -> str:
    x, y, z = moments
    return (
        f'<link name="{name}"><inertial><origin xyz="{com[0]!r} {com[1]!r} {com[2]!r}"/>'
        f'<mass value="{mass!r}"/>'
        f'<inertia ixx="{x!r}" iyy="{y!r}" izz="{z!r}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def _robot(name: str, joints: Sequence[tuple[str, Sequence[float], str]], links: Sequence[str]) -> Robot:
    parts, parent = [f'<robot name="{name}"><link name="base"/>'], "base"
    for i, ((kind, xyz, axis), text) in enumerate(zip(joints, links, strict=True), start=1):
        bounds = 'lower="0.05" upper="0.6"' if kind == "prismatic" else 'lower="-3" upper="3"'
        parts.append(
            f'{text}<joint name="q{i}" type="{kind}"><parent link="{parent}"/><child link="link{i}"/>'
            f'<origin xyz="{xyz[0]!r} {xyz[1]!r} {xyz[2]!r}"/><axis xyz="{axis}"/>'
            f'<limit {bounds} effort="50" velocity="5"/></joint>'
        )
        parent = f"link{i}"
    return Robot.from_xml("".join(parts) + "</robot>")


def _draw(seed: int, count: int) -> tuple[list[float], list[float], list[float], list[list[float]]]:
    """Masses, lengths, centres of mass and moments of inertia of possible bodies, as short decimals."""
    rng = np.random.default_rng(seed)
    m = [float(x) for x in rng.uniform(0.3, 3.0, count).round(3)]
    lengths = [float(x) for x in rng.uniform(0.15, 0.6, count).round(3)]
    lc = [float(x) for x in rng.uniform(0.05, 0.3, count).round(3)]
    moments = []
    for mass in m:
        x, y, z = mass * rng.uniform(0.03, 0.2, 3) ** 2
        moments.append([float(round(v, 6)) for v in (y + z, x + z, x + y)])
    return m, lengths, lc, moments


def planar(seed: int = 0, **wrong: float) -> Arm:
    """Return two links in a vertical plane, positive angles lift; `wrong` numbers are the model's alone."""
    m, lengths, lc, moments = _draw(seed, 2)
    robot = _robot(
        "planar",
        [("revolute", (0.0, 0.0, 0.0), "0 -1 0"), ("revolute", (lengths[0], 0.0, 0.0), "0 -1 0")],
        [_link(f"link{i + 1}", m[i], (lc[i], 0.0, 0.0), moments[i]) for i in range(2)],
    )
    p = {"m1": m[0], "m2": m[1], "l1": lengths[0], "lc1": lc[0], "lc2": lc[1], "g": G}
    p |= {"I1": moments[0][1], "I2": moments[1][1]}
    return Arm(robot, planar_model({**p, **wrong}))


def planar_model(p: Mapping[str, float]) -> Model:
    """Return the textbook formulas of a planar arm (Siciliano et al. 2009, sec. 7.3.2)."""
    m1, m2, l1, lc1, lc2, I1, I2, g = (p[k] for k in ("m1", "m2", "l1", "lc1", "lc2", "I1", "I2", "g"))

    def mass_matrix(q: Array) -> Array:
        c2 = np.cos(q[1])
        d22 = I2 + m2 * lc2**2
        d12 = d22 + m2 * l1 * lc2 * c2
        d11 = I1 + m1 * lc1**2 + I2 + m2 * (l1**2 + lc2**2 + 2.0 * l1 * lc2 * c2)
        return np.array([[d11, d12], [d12, d22]])

    def coriolis_torque(q: Array, v: Array) -> Array:
        h = -m2 * l1 * lc2 * np.sin(q[1])
        return np.array([h * (2.0 * v[0] * v[1] + v[1] ** 2), -h * v[0] ** 2])

    def gravity(q: Array) -> Array:
        g2 = m2 * lc2 * g * np.cos(q[0] + q[1])
        return np.array([(m1 * lc1 + m2 * l1) * g * np.cos(q[0]) + g2, g2])

    return {"mass_matrix": mass_matrix, "coriolis_torque": coriolis_torque, "gravity": gravity}


def scara(seed: int = 0) -> Arm:
    """Return two links in the level plane and a quill that slides down."""
    m, lengths, lc, moments = _draw(seed, 3)
    robot = _robot(
        "scara",
        [
            ("revolute", (0.0, 0.0, 0.3), "0 0 1"),
            ("revolute", (lengths[0], 0.0, 0.0), "0 0 1"),
            ("prismatic", (lengths[1], 0.0, 0.0), "0 0 -1"),
        ],
        [
            _link(f"link{i + 1}", m[i], (lc[i], 0.0, 0.0) if i < 2 else (0.0, 0.0, -lc[2]), moments[i])
            for i in range(3)
        ],
    )
    (m1, m2, m3), (l1, l2, _), (lc1, lc2, _) = m, lengths, lc
    I1, I2, I3 = (x[2] for x in moments)

    def mass_matrix(q: Array) -> Array:
        c2 = np.cos(q[1])
        d22 = I2 + I3 + m2 * lc2**2 + m3 * l2**2
        d12 = d22 + (m2 * lc2 + m3 * l2) * l1 * c2
        d11 = I1 + m1 * lc1**2 + (m2 + m3) * l1**2 + d22 + 2.0 * (m2 * lc2 + m3 * l2) * l1 * c2
        return np.array([[d11, d12, 0.0], [d12, d22, 0.0], [0.0, 0.0, m3]])

    def coriolis_torque(q: Array, v: Array) -> Array:
        h = (m2 * lc2 + m3 * l2) * l1 * np.sin(q[1])
        return np.array([-h * (2.0 * v[0] * v[1] + v[1] ** 2), h * v[0] ** 2, 0.0])

    def gravity(q: Array) -> Array:
        return np.array([0.0, 0.0, -m3 * G])

    return Arm(robot, {"mass_matrix": mass_matrix, "coriolis_torque": coriolis_torque, "gravity": gravity})


def spatial(seed: int = 0) -> Arm:
    """Return a turning base, shoulder and elbow, with offsets."""
    m, lengths, lc, moments = _draw(seed, 3)
    robot = _robot(
        "spatial",
        [
            ("revolute", (0.0, 0.0, 0.3), "0 0 1"),
            ("revolute", (0.07, 0.0, 0.1), "0 1 0"),
            ("revolute", (lengths[1], 0.05, 0.0), "0 1 0"),
        ],
        [_link(f"link{i + 1}", m[i], (lc[i], 0.0, 0.0), moments[i]) for i in range(3)],
    )
    return Arm(robot, derived(robot))


def stanford(seed: int = 0) -> Arm:
    """Return a turning base, a shoulder beside it and a boom that slides."""
    m, lengths, lc, moments = _draw(seed, 3)
    coms = [(0.0, lc[0], 0.0), (0.0, 0.0, lc[1]), (0.0, 0.0, lc[2])]
    robot = _robot(
        "stanford",
        [
            ("revolute", (0.0, 0.0, 0.3), "0 0 1"),
            ("revolute", (0.0, lengths[0], 0.0), "0 1 0"),
            ("prismatic", (0.0, 0.0, 0.1), "0 0 1"),
        ],
        [_link(f"link{i + 1}", m[i], coms[i], moments[i]) for i in range(3)],
    )
    return Arm(robot, derived(robot))


def paper() -> Arm:
    """Return the paper's arm."""
    arm = PaperArm()
    return Arm(
        Robot.load("anthropomorphic3"),
        {name: getattr(arm, name) for name in ("mass_matrix", "coriolis_torque", "gravity")},
    )


def derived(robot: Robot, change: Callable[[str], str] = str) -> Model:
    """Return the functions of a derived module, its text changed beforehand."""
    space: dict[str, Any] = {}
    exec(change(derive(robot).python()), space)
    return {
        "mass_matrix": space["mass_matrix"],
        "coriolis_torque": lambda q, v: space["coriolis_matrix"](q, v) @ v,
        "gravity": space["gravity"],
    }


def in_coordinates(model: Model, A: Any, b: Any, L: Any) -> Model:
    """Return a model in coordinates with q_right = A q + b and v_right = L v."""
    A, b, L = np.array(A, float), np.array(b, float), np.array(L, float)
    return {
        "mass_matrix": lambda q: L.T @ model["mass_matrix"](A @ q + b) @ L,
        "coriolis_torque": lambda q, v: L.T @ model["coriolis_torque"](A @ q + b, L @ v),
        "gravity": lambda q: L.T @ model["gravity"](A @ q + b),
    }


def plus(model: Model, function: str, change: Callable[..., Any]) -> Model:
    """Return a model with something added to one of its functions."""
    before = model[function]
    return {**model, function: lambda *x: np.asarray(before(*x), float) + np.asarray(change(*x), float)}


ALL = ("mass_matrix", "coriolis_torque", "gravity")


def cases() -> list[Case]:
    """Return the battery."""
    return [*_planar_cases(), *_scara_cases(), *_spatial_cases(), *_stanford_cases(), *_paper_cases()]


ARMS: dict[str, Callable[[], Arm]] = {
    "planar": lambda: planar(1),
    "scara": lambda: scara(1),
    "spatial": lambda: spatial(1),
    "stanford": lambda: stanford(1),
    "paper": paper,
}


def _planar_cases() -> list[Case]:
    _, right = planar(1)
    m, lengths, lc, moments = _draw(1, 2)
    eye, flip, zero = np.eye(2), np.diag([1.0, -1.0]), np.zeros(2)
    relative = np.array([[1.0, 0.0], [-1.0, 1.0]])  # from absolute angles
    h = m[1] * lengths[0] * lc[1]
    steiner = moments[1][1] - m[1] * lc[1] ** 2
    half = plus(
        right, "coriolis_torque", lambda q, v: [h * np.sin(q[1]) * v[0] * v[1], 0.0]
    )  # h (v1 v2 + v2²) in place of h (2 v1 v2 + v2²)
    coupling = plus(right, "mass_matrix", lambda q: [[0.0, -h * np.cos(q[1])], [-h * np.cos(q[1]), 0.0]])
    slope = plus(right, "gravity", lambda q: [0.0, -m[1] * lc[1] * G * (np.cos(q[0] + q[1]) - np.cos(q[1]))])
    return [
        Case(
            "planar: sign of joint 2",
            in_coordinates(right, flip, zero, flip),
            ALL,
            "",
            r"joint 2 turns the other way",
        ),
        Case(
            "planar: q1 from the vertical",
            in_coordinates(right, eye, [np.pi / 2, 0], eye),
            ("gravity",),
            "G[1]",
            r"q1 \+ 90°|direction of gravity",
        ),
        Case(
            "planar: absolute angles",
            in_coordinates(right, relative, zero, relative),
            ALL,
            "",
            r"absolute angles",
        ),
        Case("planar: degrees", in_coordinates(right, np.pi / 180 * eye, zero, eye), ALL, "", r"degrees"),
        Case("planar: order", in_coordinates(right, eye[::-1], zero, eye[::-1]), ALL, "", r"another order"),
        Case("planar: factor 2 in q̇1 q̇2", half, ("coriolis_torque",), "q̇1 q̇2 in τ1", r"factor 2 is missing"),
        Case(
            "planar: coupling missing",
            coupling,
            ("mass_matrix",),
            "D[1,2]",
            r"terms m l lc of link 2.* missing",
        ),
        Case("planar: q1 missing in G2", slope, ("gravity",), "G[2]", r"absolute angles|q1 is left out"),
        Case(
            "planar: parallel axis",
            planar(1, I2=steiner).model,
            ("mass_matrix",),
            "D[2,2]",
            r"link 2: the parallel-axis",
        ),
        Case(
            "planar: length",
            planar(1, l1=1.2 * lengths[0]).model,
            ALL,
            "",
            r"l1 is|length from joint 1 to joint 2",
        ),
        Case(
            "planar: gravity on the moon",
            planar(1, g=1.62).model,
            ("gravity",),
            "",
            r"strength of gravity: 1.62",
        ),
    ]


def _scara_cases() -> list[Case]:
    _, right = scara(1)
    eye, zero = np.eye(3), np.zeros(3)
    down = np.diag([1.0, 1.0, -1.0])
    m = _draw(1, 3)[0]
    unsymmetric = plus(
        right, "mass_matrix", lambda q: [[0, -right["mass_matrix"](q)[0, 1], 0], [0] * 3, [0] * 3]
    )
    sign = plus(right, "coriolis_torque", lambda q, v: [0.0, -2.0 * right["coriolis_torque"](q, v)[1], 0.0])
    doubled = plus(right, "mass_matrix", lambda q: [[0] * 3, [0] * 3, [0, 0, -0.5 * m[2]]])
    return [
        Case(
            "scara: quill upwards",
            in_coordinates(right, down, zero, down),
            ("gravity",),
            "G[3]",
            r"sign of gravity|joint 3 slides the other way",
        ),
        Case(
            "scara: gravity forgotten",
            {**right, "gravity": np.zeros_like},
            ("gravity",),
            "G[3]",
            r"gravity is missing",
        ),
        Case("scara: D12 missing", unsymmetric, ("mass_matrix",), "D[1,2]", r"missing"),
        Case("scara: sign of q̇1²", sign, ("coriolis_torque",), "q̇1² in τ2", r"sign"),
        Case("scara: half a mass", doubled, ("mass_matrix",), "D[3,3]", r"factor 2"),
        Case(
            "scara: sin for cos",
            in_coordinates(right, eye, [0, -np.pi / 2, 0], eye),
            ("mass_matrix",),
            "D[1,2]",
            r"q2 - 90°",
        ),
        Case(
            "scara: no products",
            {**right, "coriolis_torque": lambda q, v: 0 * v},
            ("coriolis_torque",),
            "q̇1² in τ2",
            r"Coriolis torque is zero|missing",
        ),
    ]


def _spatial_cases() -> list[Case]:
    robot, right = spatial(1)
    m, lengths, lc, moments = _draw(1, 3)
    eye, zero = np.eye(3), np.zeros(3)

    def values(**new: float) -> Model:
        lines = "".join(f'parameters["{name}"] = {value!r}\n' for name, value in new.items())
        return derived(robot, lambda text: text + lines)

    flip = np.diag([1.0, 1.0, -1.0])
    term = m[1] * lc[1] ** 2
    rate = derive(robot).python()
    space: dict[str, Any] = {}
    exec(rate, space)
    transposed = {**right, "coriolis_torque": lambda q, v: space["coriolis_matrix"](q, v).T @ v}
    return [
        Case(
            "spatial: sign of joint 3",
            in_coordinates(right, flip, zero, flip),
            ALL,
            "",
            r"joint 3 turns the other way",
        ),
        Case("spatial: mass of link 3", values(m3=1.3 * m[2]), ALL, "", r"m3 is|mass of link 3"),
        Case("spatial: centre of mass", values(c2x=1.4 * lc[1]), ALL, "", r"c2x is|centre of mass of link 2"),
        Case(
            "spatial: inertia about the joint",
            values(I2yy=moments[1][1] + term, I2zz=moments[1][2] + term),
            ("mass_matrix",),
            "D[2,2]",
            r"link 2: inertia about the joint",
        ),
        Case(
            "spatial: l for lc",
            values(c2x=lengths[1]),
            ALL,
            "",
            r"c2x is|centre of mass of link 2 along x.*which is the length to joint 3",
        ),
        Case("spatial: C transposed", transposed, ("coriolis_torque",), "", r"transposed"),
        Case(
            "spatial: q2 and q3 mixed up",
            in_coordinates(right, eye[[0, 2, 1]], zero, eye),
            ALL,
            "",
            r"mixed up",
        ),
        Case(
            "spatial: point masses",
            values(**{f"I{i}{a}{a}": 1e-300 for i in (1, 2, 3) for a in "xyz"}),
            ("mass_matrix",),
            "",
            r"point mass",
        ),
    ]


def _stanford_cases() -> list[Case]:
    _, right = stanford(1)
    moments = _draw(1, 3)[3]
    eye, zero = np.eye(3), np.zeros(3)
    flip = np.diag([1.0, -1.0, 1.0])
    pull = plus(right, "gravity", lambda q: [0.0, 0.0, -2.0 * right["gravity"](q)[2]])
    slide = plus(
        right, "coriolis_torque", lambda q, v: [0.0, 0.0, -right["coriolis_torque"](q, [0, v[1], 0])[2]]
    )
    shifted = in_coordinates(right, eye, [0.0, 0.0, 0.1], eye)
    missing = plus(right, "mass_matrix", lambda q: -moments[2][1] * np.diag([0.0, 1.0, 0.0]))
    return [
        Case(
            "stanford: sign of joint 2",
            in_coordinates(right, flip, zero, flip),
            ("mass_matrix",),
            "",
            r"joint 2 turns the other way",
        ),
        Case("stanford: sign of G3", pull, ("gravity",), "G[3]", r"sign"),
        Case("stanford: centrifugal force", slide, ("coriolis_torque",), "q̇2² in τ3", r"missing"),
        Case(
            "stanford: slide from elsewhere",
            shifted,
            ALL,
            "",
            r"offset added to q3: 0\.1|length from joint 2 to joint 3.* 0\.2",
        ),
        Case(
            "stanford: link 3 does not turn",
            missing,
            ("mass_matrix",),
            "D[2,2]",
            r"inertia about the centre of mass of link 3|rotation of link 3",
        ),
        Case(
            "stanford: sign of gravity",
            {**right, "gravity": lambda q: -right["gravity"](q)},
            ("gravity",),
            "",
            r"sign of gravity",
        ),
    ]


def _paper_cases() -> list[Case]:
    arm, p = PaperArm(), ArmParameters()
    _, right = paper()

    class Printed(PaperArm):
        """The paper's arm with K2 as printed."""

        def kinetic_energy(self, q: Any, v: Any) -> Any:
            s, c = np.sin(q[1]), np.cos(q[1])
            return super().kinetic_energy(q, v) + 0.5 * p.m2 * p.lc2**2 * ((1 - s) ** 2 - c**2) * v[0] ** 2

    twice = {**right, "gravity": lambda q: G * arm.gravity(q)}
    fall = plus(
        right, "coriolis_torque", lambda q, v: [0, 0, -2 * p.m3 * p.l2 * p.lc3 * np.sin(q[2]) * v[1] ** 2]
    )
    eye = np.eye(3)
    return [
        Case("paper: K2 as printed", Printed(), ("kinetic_energy",), "D[1,1]", r"\(1 - sin q2\)²"),
        Case(
            "paper: lc2",
            PaperArm(ArmParameters(lc2=0.12)),
            ("gravity",),
            "G[2]",
            r"link 2 along x: 0\.12 m in the model, 0\.1 m",
        ),
        Case("paper: g twice", twice, ("gravity",), "G[2]", r"strength of gravity: 96\.2"),
        Case("paper: sign of q̇2² in τ3", fall, ("coriolis_torque",), "q̇2² in τ3", r"sign"),
        Case(
            "paper: elbow from the vertical",
            in_coordinates(right, eye, [0, 0, np.pi / 2], eye),
            ALL,
            "",
            r"q3 \+ 90°",
        ),
    ]
