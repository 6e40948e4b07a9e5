"""Dry (Coulomb) friction in a model's inverse dynamics, with viscous friction beside it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from armgpi.base.arrays import Array
from armgpi.validation.diagnose import Cause
from armgpi.validation.repair import Compared
from armgpi.validation.samples import Sampled

#: Torque below which there is none [N m or N].
_LEAST = 1e-9


def coulomb_friction(compared: Compared, sampled: Mapping[str, Sampled]) -> list[Cause]:
    """Return dry friction as the one cause of all that differs; none where it does not explain it.

    The torque that a model has beside the robot's is F sign(v) + b v of each joint's own velocity.

    Args:
        compared: the model beside the robot.
        sampled: its samples.
    """
    problem = compared.problem
    differing = problem.elements_of(~problem.agreeing)
    name = "inverse_dynamics"
    if not differing or {element.function for element in differing} != {name}:
        return []
    values, states = sampled[name].values, compared.states.first(len(sampled[name].values))
    rest = values - problem.values(name, states)
    least = max(float(np.abs(values).max()) * problem.rtol, _LEAST)
    dry, viscous = np.zeros(problem.tree.n), np.zeros(problem.tree.n)
    for joint, v in enumerate(states.v.T):
        basis = np.stack([np.sign(v), v], axis=-1)
        dry[joint], viscous[joint] = np.linalg.lstsq(basis, rest[:, joint], rcond=None)[0]
        if np.abs(basis @ [dry[joint], viscous[joint]] - rest[:, joint]).max() > 10.0 * least:
            return []
    if not (dry > least).any() or (dry < -10.0 * least).any() or (viscous < -10.0 * least).any():
        return []
    joints = problem.tree.joint_names
    parts = [f"dry friction {_listed(joints, dry, least)} times the sign of v"]
    if (viscous > 10.0 * least).any():
        parts.append(f"viscous friction {_listed(joints, viscous, 10.0 * least)}")
    text = (
        f"friction: the torque has {' and '.join(parts)}; dry friction cannot be compared: "
        "leave it out of the model, and specify it as friction of the robot"
    )
    return [Cause("friction", text, "model", differing, structural=False)]


def _listed(joints: tuple[str, ...], values: Array, least: float) -> str:
    """Return the joints that have some friction with its values: "j1=0.4,j2=0.2"."""
    return ",".join(f"{joint}={x:.6g}" for joint, x in zip(joints, values, strict=True) if x > least)
