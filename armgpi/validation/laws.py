"""What holds for every arm: laws that a model must obey, with or without a reference.

Derivatives are central differences of order four, good to some 1e-11, so a law is held to 1e-7.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.validation.models import States
from armgpi.validation.samples import SAFETY, Sampled, rows_of, slopes, torque_of
from armgpi.validation.tree import christoffel
from armgpi.validation.worker import Worker

#: How far, relative, a law may be off: the digits of the differences, and four more for cancellation in D.
TOLERANCE = 1e-7
#: Step of the difference quotients [rad or m]: its fourth power and the rounding error divided by it are both
#: some 1e-12.
STEP = 1e-3
#: Coriolis torques and slopes count as no smaller than this share of what they are derived from: below it
#: the difference quotients have lost the digits that the law is about.
FLOOR = 1e-3
#: Configurations at which derivatives are taken; each takes four calls per joint.
_ROWS = 12


class Law(NamedTuple):
    """A law and whether a model obeys it.

    Attributes:
        name: short name.
        verdict: "holds", "fails", or "note" for something to know that is no mistake.
        error: largest violation, relative; NaN when it was not measured.
        text: what was found, for the report.
    """

    name: str
    verdict: str
    error: float
    text: str


class Derived(NamedTuple):
    """What a model's own functions say about each other, arrays over the first configurations.

    Attributes:
        H: products of velocities that follow from its mass matrix, (rows, n, n, n), or None.
        G: slope of its potential energy, (rows, n), or None.
        slope: derivatives of its mass matrix, (rows, n, n, n), or None.
    """

    H: Array | None
    G: Array | None
    slope: Array | None


def derive(worker: Worker, states: States, sampled: Mapping[str, Sampled]) -> Derived:
    """Differentiate a model's mass matrix and potential energy."""
    slope = G = None
    if "mass_matrix" in sampled:
        slope = slopes(worker, "mass_matrix", _first(worker, "mass_matrix", states, sampled), STEP)
    if "potential_energy" in sampled:
        G = slopes(worker, "potential_energy", _first(worker, "potential_energy", states, sampled), STEP)
    return Derived(None if slope is None else christoffel(slope), G, slope)


def _first(worker: Worker, name: str, states: States, sampled: Mapping[str, Sampled]) -> Array:
    """Return the configurations at which a function is differentiated: fewer where it is slow."""
    rows = min(_ROWS, rows_of(sampled))
    each = worker.takes.get(name, 0.0) * 4 * states.q.shape[1]
    if each * rows > 20.0:
        rows = max(2, int(20.0 / each))
    return states.q[:rows]


def check(
    worker: Worker,
    states: States,
    sampled: Mapping[str, Sampled],
    own: Derived,
    viscous: Array | None = None,
) -> list[Law]:
    """Return every law that can be checked with the functions that a model has.

    Args:
        worker: the model.
        states: at which it was sampled.
        sampled: its samples.
        own: what follows from its own functions.
        viscous: viscous friction that its inverse and forward dynamics contain; None for none.
    """
    laws: list[Law] = []
    if "mass_matrix" in sampled:
        laws += _mass_matrix(sampled["mass_matrix"].values)
    laws += _velocities(states, sampled, own)
    laws += _energies(states, sampled, own)
    laws += _consistency(states, sampled, viscous)
    if "forward_kinematics" in sampled and "jacobian" in sampled:
        laws.append(_kinematics(worker, states, sampled))
    return laws


def _law(name: str, away: float, size: float, good: str, bad: str, noise: float = 0.0) -> Law:
    """Return a law from its largest violation, the size of what is compared, and its rounding error."""
    error = away / size if size > 0.0 else (0.0 if away == 0.0 else math.inf)
    holds = error <= TOLERANCE or away <= SAFETY * noise
    return Law(name, "holds" if holds else "fails", error, good if holds else bad)


def _lost(sampled: Mapping[str, Sampled], name: str) -> float:
    """Return the rounding error that a model's function leaves in its slope."""
    # Of 18 values, divided by 12 steps, the worst case adds up to 1.5 times the noise.
    return 2.0 * sampled[name].noise / STEP


def _floor(sampled: Mapping[str, Sampled], name: str) -> float:
    """Return how small what is derived from a function may count at least."""
    return FLOOR * float(np.abs(sampled[name].values).max())


def _coriolis(sampled: Mapping[str, Sampled]) -> Sampled | None:
    """Return a model's Coriolis torque, or else its matrix."""
    return sampled.get("coriolis_torque", sampled.get("coriolis_matrix"))


def _mass_matrix(D: Array) -> list[Law]:
    """Return the laws of D."""
    T = np.swapaxes(D, -1, -2)
    away = np.abs(D - T)
    row, i, j = np.unravel_index(int(np.argmax(away)), away.shape)
    bad = f"D[{i + 1},{j + 1}] = {D[row, i, j]:.6g}, but D[{j + 1},{i + 1}] = {D[row, j, i]:.6g}"
    symmetric = _law("D symmetric", float(away.max()), float(np.abs(D).max()), "D = D'", bad)
    smallest = np.linalg.eigvalsh(0.5 * (D + T))[:, 0]
    worst = int(np.argmin(smallest))
    positive = smallest[worst] > 0.0
    text = f"smallest eigenvalue {smallest[worst]:.4g}"
    error = 0.0 if positive else float(-smallest[worst] / max(float(np.abs(D).max()), 1e-300))
    return [symmetric, Law("D positive definite", "holds" if positive else "fails", error, text)]


def _velocities(states: States, sampled: Mapping[str, Sampled], own: Derived) -> list[Law]:
    """Return the laws of the Coriolis torque and matrix."""
    laws: list[Law] = []
    if own.H is None or own.slope is None:
        return laws
    rows = len(own.H)
    for name, word in {"coriolis_torque": "C v", "coriolis_matrix": "C(q, v) v"}.items():
        if name not in sampled:
            continue
        H = sampled[name].quantities["H"][:rows]
        size = max(float(np.abs(own.H).max()), _floor(sampled, "mass_matrix"))
        away = float(np.abs(H - own.H).max())
        bad = f"{word} is not the torque that D's Christoffel symbols give"
        good = f"{word} is what D's Christoffel symbols give"
        laws.append(_law(f"{word} from D", away, size, good, bad, _lost(sampled, "mass_matrix")))
    if "coriolis_matrix" in sampled:
        C, v = sampled["coriolis_matrix"].values[:rows], states.v[:rows]
        rate = np.einsum("Nijk,Nk->Nij", own.slope, v)
        N = rate - 2.0 * C
        size = max(float(np.abs(C).max()), float(np.abs(rate).max()), _floor(sampled, "mass_matrix"))
        law = _law(
            "Ḋ - 2C skew",
            float(np.abs(N + np.swapaxes(N, -1, -2)).max()),
            size,
            "Ḋ - 2C is skew-symmetric",
            "Ḋ - 2C is not skew-symmetric",
            _lost(sampled, "mass_matrix") * float(np.abs(v).sum(axis=1).max()),
        )
        if law.verdict == "fails" and laws[0].verdict == "holds":
            text = "C v is right, but C is not the matrix of the Christoffel symbols: Ḋ - 2C is not skew"
            law = law._replace(verdict="note", text=text)
        laws.append(law)
        if "coriolis_torque" in sampled:
            both = min(len(sampled[x].values) for x in ("coriolis_matrix", "coriolis_torque"))
            Cv = torque_of(sampled["coriolis_matrix"].values[:both], states.v[:both])
            h = sampled["coriolis_torque"].values[:both]
            good, bad = (
                "coriolis_matrix times v is coriolis_torque",
                "coriolis_matrix times v is another torque",
            )
            size = max(float(np.abs(h).max()), _floor(sampled, "mass_matrix"))
            noise = sampled["coriolis_torque"].noise + 4.0 * sampled["coriolis_matrix"].noise
            laws.append(_law("C v one torque", float(np.abs(Cv - h).max()), size, good, bad, noise))
    return laws


def _energies(states: States, sampled: Mapping[str, Sampled], own: Derived) -> list[Law]:
    """Return the laws of energy and power."""
    laws: list[Law] = []
    if own.G is not None and "gravity" in sampled:
        G = sampled["gravity"].values[: len(own.G)]
        apart = np.abs(G - own.G)
        worst = int(np.argmax(apart.max(axis=0)))
        size = max(float(np.abs(G).max()), float(np.abs(own.G).max()))
        size = max(size, _floor(sampled, "potential_energy"))
        bad = f"the slope of V by q{worst + 1} is not G[{worst + 1}]"
        noise = sampled["gravity"].noise + _lost(sampled, "potential_energy")
        laws.append(_law("dV/dq = G", float(apart.max()), size, "G is the slope of V", bad, noise))
    if "kinetic_energy" in sampled and "mass_matrix" in sampled:
        rows = min(len(sampled[x].values) for x in ("kinetic_energy", "mass_matrix"))
        K, D = sampled["kinetic_energy"].values[:rows], sampled["mass_matrix"].values[:rows]
        v = states.v[:rows]
        away = float(np.abs(K - 0.5 * np.einsum("Ni,Nij,Nj->N", v, D, v)).max())
        bad = "K is not ½ v'Dv with the model's own D"
        squares = float(np.square(np.abs(v).sum(axis=1)).max())
        noise = sampled["kinetic_energy"].noise + squares * sampled["mass_matrix"].noise
        laws.append(_law("K = ½ v'Dv", away, float(np.abs(K).max()), "K is ½ v'Dv", bad, noise))
    torque = _coriolis(sampled)
    if torque is not None and own.slope is not None:
        rows = len(own.slope)
        v = states.v[:rows]
        h = torque_of(torque.values[:rows], v)
        rate = 0.5 * np.einsum("Nijk,Ni,Nj,Nk->N", own.slope, v, v, v)
        power = np.einsum("Ni,Ni->N", h, v)
        # Each of the torques does work; only their sum has to be the change of K.
        size = max(float(np.abs(rate).max()), float(np.abs(h * v).max()), _floor(sampled, "mass_matrix"))
        bad = "v'C v is not ½ v'Ḋv: the Coriolis torque feeds or drains energy"
        good = "K changes by the power of the torques"
        cubes = float(np.abs(v).sum(axis=1).max() ** 3)
        noise = cubes * (torque.noise + _lost(sampled, "mass_matrix"))
        laws.append(_law("dK/dt = power", float(np.abs(power - rate).max()), size, good, bad, noise))
    return laws


def gradient(worker: Worker, states: States, sampled: Mapping[str, Sampled]) -> list[Law]:
    """Return whether G of a model without V is the slope of some potential energy: dG/dq is symmetric."""
    if "gravity" not in sampled or "potential_energy" in sampled or states.q.shape[1] < 2:
        return []
    slope = slopes(worker, "gravity", _first(worker, "gravity", states, sampled), STEP)
    away = np.abs(slope - np.swapaxes(slope, -1, -2))
    _, i, j = np.unravel_index(int(np.argmax(away)), away.shape)
    size = max(float(np.abs(slope).max()), _floor(sampled, "gravity"))
    bad = f"the slope of G[{i + 1}] by q{j + 1} is not that of G[{j + 1}] by q{i + 1}: no V has it"
    good = "G is the slope of a potential energy"
    return [_law("dG/dq symmetric", float(away.max()), size, good, bad, _lost(sampled, "gravity"))]


#: Function -> the others of a model without which no structural property judges it.
_JUDGED_WITH: dict[str, tuple[str, ...]] = {
    "coriolis_matrix": ("mass_matrix",),
    "coriolis_torque": ("mass_matrix",),
    "kinetic_energy": ("mass_matrix",),
    "potential_energy": ("gravity",),
    "inverse_dynamics": ("mass_matrix", "coriolis_torque", "gravity"),
    "forward_dynamics": ("mass_matrix", "coriolis_torque", "gravity"),
    "forward_kinematics": ("jacobian",),
    "jacobian": ("forward_kinematics",),
}


def unjudged(sampled: Mapping[str, Sampled]) -> list[str]:
    """Return the functions that no structural property judges, each with what is missing for one."""
    there = {"coriolis_torque" if name == "coriolis_matrix" else name for name in sampled}
    found = []
    for name in sampled:
        missing = [one for one in _JUDGED_WITH.get(name, ()) if one not in there]
        if missing:
            found.append(f"{name}: no structural property judges it without {' and '.join(missing)}")
    one_joint = "gravity" in sampled and sampled["gravity"].values.shape[-1] < 2
    if one_joint and "potential_energy" not in sampled:
        found.append("gravity: no structural property judges it without potential_energy")
    return found


def _consistency(states: States, sampled: Mapping[str, Sampled], viscous: Array | None) -> list[Law]:
    """Return whether the dynamics are made of the model's own terms, and invert each other."""
    laws: list[Law] = []
    mass, torque, weight = sampled.get("mass_matrix"), _coriolis(sampled), sampled.get("gravity")
    if mass is None or torque is None or weight is None:
        return laws
    dynamics = {name: sampled[name] for name in ("inverse_dynamics", "forward_dynamics") if name in sampled}
    rows = min(len(s.values) for s in (mass, torque, weight, *dynamics.values()))
    D, G, v = mass.values[:rows], weight.values[:rows], states.v[:rows]
    h = torque_of(torque.values[:rows], v) + (0.0 if viscous is None else viscous * v)
    for name, one in dynamics.items():
        value = one.values[:rows]
        a = states.a[:rows] if name == "inverse_dynamics" else value
        tau = np.einsum("Nij,Nj->Ni", D, a) + h + G
        given = value if name == "inverse_dynamics" else states.tau[:rows]
        bad = f"{name} is not made of the model's own D, C v and G"
        size = float(np.abs(tau).max())
        moved = float(np.abs(a).sum(axis=1).max())
        noise = moved * (mass.noise + one.digits * size)
        noise += float(np.abs(v).sum(axis=1).max()) * torque.noise + weight.noise
        away, good = float(np.abs(tau - given).max()), f"{name} is D a + C v + G"
        laws.append(_law(f"{name} = D, C, G", away, size, good, bad, noise))
    return laws


def _kinematics(worker: Worker, states: States, sampled: Mapping[str, Sampled]) -> Law:
    """Return whether the Jacobian is the derivative of the kinematics."""
    q = _first(worker, "forward_kinematics", states, sampled)
    slope = slopes(worker, "forward_kinematics", q, STEP)
    J = sampled["jacobian"].values[: len(q)]
    rows = min(slope.shape[1], J.shape[1])  # positions only: FK may be planar, J have angular rows
    away = np.abs(J[:, :rows] - slope[:, :rows])
    worst = int(np.argmax(away.max(axis=(0, 1))))
    bad = f"the derivative of the position by q{worst + 1} is not column {worst + 1} of the Jacobian"
    size = max(float(np.abs(slope).max()), _floor(sampled, "forward_kinematics"))
    noise = sampled["jacobian"].noise + _lost(sampled, "forward_kinematics")
    return _law("FK and Jacobian", float(away.max()), size, "J is the derivative of FK", bad, noise)
