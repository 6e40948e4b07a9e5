"""From a MuJoCo model (MJCF) to a `pin.Model`: read by Pinocchio, and held against MuJoCo's own reading.

What an arm of rigid bodies cannot have is refused with the reason: constraints, tendons, springs.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from armgpi.arrays import Array
from armgpi.errors import UrdfError, import_extra

#: By how much the two readings may differ, of the largest number: MuJoCo keeps some poses to 1e-9.
_SAME = 1e-6
#: Configurations at which they are compared.
_LOOKS = 5


def is_mjcf(text: str) -> bool:
    """Tell whether the text of a file is that of a MuJoCo model."""
    return "<mujoco" in text and "<robot" not in text


def model_of(path: Path) -> Any:
    """Return the `pin.Model` of an MJCF file, with effort limits from its actuators.

    Raises:
        MissingPackage: when MuJoCo is not installed.
        UrdfError: when it cannot be read, has what a rigid arm has not, or is read differently by the two.
    """
    mujoco = import_extra("mujoco", "mujoco")
    try:
        theirs = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, TypeError) as error:  # TypeError for a name that is no text
        raise UrdfError(path, f"MuJoCo cannot read it: {' '.join(str(error).split())}") from None
    _refuse_more_than_an_arm(theirs, path)
    try:
        made = pin.buildModelFromMJCF(str(path))
    except Exception as error:  # whatever Pinocchio's parser raises
        raise UrdfError(path, f"Pinocchio cannot read it: {' '.join(str(error).split())}") from None
    model = made[0] if isinstance(made, tuple) else made
    joints = [theirs.joint(j).name for j in range(theirs.njnt)]
    if sorted(joints) != sorted(str(name) for name in list(model.names)[1:]):
        raise UrdfError(path, f"Pinocchio and MuJoCo find other joints in it: give each of {joints} a name")
    rows = [int(model.joints[model.getJointId(name)].idx_v) for name in joints]
    model.effortLimit = _efforts(mujoco, theirs, rows)
    if theirs.nq == model.nq == theirs.njnt:
        _check_same(mujoco, theirs, model, rows, path)
    return model


def _refuse_more_than_an_arm(theirs: Any, path: Path) -> None:
    """Refuse what equations of rigid bodies on a tree of joints do not have."""
    stiff = [theirs.joint(j).name for j in range(theirs.njnt) if np.any(theirs.jnt_stiffness[j])]
    more = {
        f"{theirs.neq} equality constraints, which close loops or couple joints": theirs.neq,
        f"{theirs.ntendon} tendons": theirs.ntendon,
        f"springs at {', '.join(stiff)}": len(stiff),
        "bodies whose gravity is compensated (gravcomp)": np.any(theirs.body_gravcomp),
    }
    found = [what for what, count in more.items() if count]
    if found:
        said = f"has {' and '.join(found)}; armgpi simulates a tree of rigid bodies alone: take them out"
        raise UrdfError(path, said)


def _efforts(mujoco: Any, theirs: Any, rows: list[int]) -> Array:
    """Return the largest torque that the actuators of each joint give [N m or N]; infinite without any."""
    efforts = np.zeros(theirs.nv)
    joint_of = int(mujoco.mjtTrn.mjTRN_JOINT)
    for a in range(theirs.nu):
        if int(theirs.actuator_trntype[a]) != joint_of:
            continue
        limit = np.inf
        if theirs.actuator_forcelimited[a]:
            limit = np.abs(theirs.actuator_forcerange[a]).max()
        elif theirs.actuator_ctrllimited[a] and not np.any(theirs.actuator_biasprm[a]):
            limit = np.abs(theirs.actuator_ctrlrange[a]).max() * abs(theirs.actuator_gainprm[a, 0])
        joint = int(theirs.actuator_trnid[a, 0])
        efforts[rows[joint]] += abs(theirs.actuator_gear[a, 0]) * limit
    for j, row in enumerate(rows):
        if theirs.jnt_actfrclimited[j]:
            most = np.abs(theirs.jnt_actfrcrange[j]).max()
            efforts[row] = min(efforts[row] or np.inf, most)
    return np.where(efforts > 0.0, efforts, np.inf)  # a joint without an actuator has no limit that is known


def _check_same(mujoco: Any, theirs: Any, model: Any, rows: list[int], path: Path) -> None:
    """Refuse a file whose torques the two compute differently: gravity, and acceleration from rest."""
    rng, data, own = np.random.default_rng(0), mujoco.MjData(theirs), model.createData()
    for _ in range(_LOOKS):
        q, a = rng.uniform(-1.0, 1.0, (2, theirs.nv))
        data.qpos[:], data.qvel[:], data.qacc[:] = q, 0.0, a
        mujoco.mj_inverse(theirs, data)
        # The contacts and limits that MuJoCo simulates are no part of the arm.
        expected = np.asarray(data.qfrc_inverse + data.qfrc_constraint)
        ordered, moved = np.zeros(theirs.nv), np.zeros(theirs.nv)
        ordered[rows], moved[rows] = q, a
        found = pin.rnea(model, own, ordered, np.zeros(theirs.nv), moved)[rows]
        worst = int(np.abs(found - expected).argmax())
        if not np.abs(found - expected).max() <= _SAME * max(1.0, np.abs(expected).max()):
            said = (
                f"Pinocchio and MuJoCo compute other torques for joint {theirs.joint(worst).name!r} "
                f"({found[worst]:.6g} and {expected[worst]:.6g}): give a URDF"
            )
            raise UrdfError(path, said, theirs.joint(worst).name)
