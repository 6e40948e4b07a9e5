"""The reference arm taken apart, so that one thing in it can be changed and the equations seen again.

A :class:`Tree` holds placements, axes and inertias of a robot as plain values; :func:`evaluate` gives the
quantities of its equations of motion at many configurations at once:

    D(q) a + h(q, v) + G(q) = tau,   h_i = sum_jk H_ijk v_j v_k,   H symmetric in j and k (Christoffel).

Names of quantities, with N configurations: "D" (N, n, n) [kg m^2], "H" (N, n, n, n), "G" (N, n) [N m], "V"
(N,) potential energy less that at the first configuration [J], "F" (N, 3) position of the tool [m], "J"
(N, 6, n) its Jacobian along the base axes, linear rows first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from armgpi.base.arrays import Array
from armgpi.robot.robot import Robot

Quantities = dict[str, Array]

#: Two axes are the same when the cosine between them differs from one by less than rounding makes.
PARALLEL = 1e-9


class Body(NamedTuple):
    """What moves with one joint, all its fixed links together, in the joint's frame.

    Attributes:
        mass: [kg].
        com: centre of mass [m], shape (3,).
        inertia: about the centre of mass [kg m^2], shape (3, 3).
    """

    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True)
class Tree:
    """A fixed-base arm as plain values; joint i turns or slides body i.

    Attributes:
        joint_names: names of the n joints.
        link_names: name of the link that each joint carries.
        parents: for every joint the joint that carries it, -1 for the base.
        rotations: rotation of every joint frame in its parent's, each (3, 3).
        positions: origin of every joint frame in its parent's [m], each (3,).
        axes: axis of every joint in its own frame, each (3,).
        prismatic: whether each joint slides.
        bodies: what each joint carries.
        armature: rotor inertia [kg m^2 or kg], shape (n,).
        gravity: acceleration of gravity in the base frame [m/s^2], shape (3,).
        tool_parent: joint that carries the tool frame, -1 for the base.
        tool_rotation: rotation of the tool frame in that joint's, (3, 3).
        tool_position: its origin there [m], (3,).
        viscous: viscous friction in the dynamics [N m s/rad or N s/m], shape (n,); None for none.
    """

    joint_names: tuple[str, ...]
    link_names: tuple[str, ...]
    parents: tuple[int, ...]
    rotations: tuple[Array, ...]
    positions: tuple[Array, ...]
    axes: tuple[Array, ...]
    prismatic: tuple[bool, ...]
    bodies: tuple[Body, ...]
    armature: Array
    gravity: Array
    tool_parent: int
    tool_rotation: Array
    tool_position: Array
    viscous: Array | None = None

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.parents)

    def with_body(self, i: int, **changes: Any) -> Tree:
        """Return the tree with another body i."""
        bodies = list(self.bodies)
        bodies[i] = bodies[i]._replace(**changes)
        return replace(self, bodies=tuple(bodies))

    def with_item(self, field: str, i: int, value: Any) -> Tree:
        """Return the tree with another item i of one of its tuples."""
        items = list(getattr(self, field))
        items[i] = value
        changes: dict[str, Any] = {field: tuple(items)}
        return replace(self, **changes)

    def next_joint(self, i: int) -> Array | None:
        """Return where the next joint (or else the tool) stands in the frame of joint i [m]."""
        children = [j for j, parent in enumerate(self.parents) if parent == i]
        if children:
            return self.positions[children[0]]  # of a fork any one: lc for l is a mistake of serial arms
        return self.tool_position if self.tool_parent == i and self.tool_position.any() else None

    def model(self) -> Any:
        """Return the `pin.Model`."""
        model = pin.Model()
        for i in range(self.n):
            kind = pin.JointModelPrismaticUnaligned if self.prismatic[i] else pin.JointModelRevoluteUnaligned
            placement = pin.SE3(self.rotations[i], self.positions[i])
            joint = model.addJoint(self.parents[i] + 1, kind(self.axes[i]), placement, f"j{i}")
            # By its parts: made at once it refuses what no rigid body has, and mistakes may have that.
            inertia = pin.Inertia.Zero()
            inertia.mass, inertia.lever, inertia.inertia = self.bodies[i]
            model.inertias[joint] = inertia
        tool = pin.SE3(self.tool_rotation, self.tool_position)
        model.addFrame(pin.Frame("tool", self.tool_parent + 1, tool, pin.FrameType.OP_FRAME))
        model.armature = self.armature
        model.gravity = pin.Motion(self.gravity, np.zeros(3))
        return model


def from_robot(robot: Robot, frame: str | None = None) -> Tree:
    """Return the tree of a robot.

    Args:
        robot: the robot.
        frame: name of the tool frame; the robot's tip when not given.

    Raises:
        NameNotFound: when there is no such frame.
    """
    model = robot.pinocchio_model()
    data = model.createData()
    axes = []
    for i in range(1, model.njoints):
        column = pin.computeJointJacobian(model, data, np.zeros(model.nq), i).reshape(6, -1)[:, i - 1]
        axes.append(np.round(column[:3] + column[3:], 15))  # one of them is zero; x is x, not x + 1e-17
    tip = robot.tip if frame is None else frame
    robot.frame_pose(tip, np.zeros(robot.n))  # refuses a name that is not there, which Pinocchio does not
    tool = model.frames[model.getFrameId(tip)]
    links = [
        next(
            (f.name for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint == i), f"link {i}"
        )
        for i in range(1, model.njoints)
    ]
    return Tree(
        joint_names=robot.joint_names,
        link_names=tuple(links),
        parents=tuple(int(p) - 1 for p in list(model.parents)[1:]),
        rotations=tuple(np.array(m.rotation) for m in list(model.jointPlacements)[1:]),
        positions=tuple(np.array(m.translation) for m in list(model.jointPlacements)[1:]),
        axes=tuple(axes),
        prismatic=tuple(robot.prismatic.tolist()),
        bodies=tuple(
            Body(float(y.mass), np.array(y.lever), np.array(y.inertia)) for y in list(model.inertias)[1:]
        ),
        armature=np.array(model.armature),
        gravity=np.array(model.gravity.linear),
        tool_parent=int(tool.parentJoint) - 1,
        tool_rotation=np.array(tool.placement.rotation),
        tool_position=np.array(tool.placement.translation),
    )


class Affine(NamedTuple):
    """Coordinates that a model may use in place of the robot's: q_robot = A q + b, v_robot = L v.

    Attributes:
        A: matrix of the positions, (n, n).
        b: offset of the positions [rad or m], (n,).
        L: matrix of velocities and torques, (n, n): A itself for another choice of coordinates, the
            identity where only the angles inside of the formulas are other ones.
    """

    A: Array
    b: Array
    L: Array


def parallel_pairs(tree: Tree) -> list[tuple[int, int, int]]:
    """Return the turning joints with a parallel one before: joint, that one, and 1 or -1 for its sense."""
    pairs = []
    for i in range(tree.n):
        if tree.prismatic[i]:
            continue
        R, k = tree.rotations[i], tree.parents[i]
        # A sliding joint between two parallel ones turns nothing.
        while k >= 0 and tree.prismatic[k]:
            R, k = tree.rotations[k] @ R, tree.parents[k]
        if k >= 0:
            along = float(tree.axes[k] @ (R @ tree.axes[i]))
            if abs(abs(along) - 1.0) < PARALLEL:
                pairs.append((i, k, round(along)))
    return pairs


def absolute_angles(tree: Tree, pairs: list[tuple[int, int, int]] | None = None) -> Array:
    """Return B of q = B q_absolute, (n, n): each of these joints counted from the base."""
    B = np.eye(tree.n)
    for i, k, sign in parallel_pairs(tree) if pairs is None else pairs:
        B[i, k] = -sign  # q of the robot is the absolute angle less that of the joint before
    return B


def evaluate(tree: Tree, q: Array, want: Iterable[str], affine: Affine | None = None) -> Quantities:
    """Return quantities of the equations of motion at the configurations `q`, shape (N, n).

    Args:
        tree: the arm.
        q: configurations [rad or m]; those of the model when `affine` is given.
        want: names of quantities; others than the above are left out.
        affine: coordinates of the model.
    """
    n = tree.n
    x = q if affine is None else q @ affine.A.T + affine.b
    model = tree.model()
    data = model.createData()
    eye, tool = np.eye(n), model.nframes - 1
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

    def coriolis(row: Array) -> Array:
        # C is linear in v, and Pinocchio's is that of the Christoffel symbols: C(q, e_k) is H[:, :, k].
        return np.stack([pin.computeCoriolisMatrix(model, data, row, e).copy() for e in eye], axis=-1)

    def position(row: Array) -> Array:
        pin.framesForwardKinematics(model, data, row)
        return np.array(data.oMf[tool].translation)

    def jacobian(row: Array) -> Array:
        return np.array(pin.computeFrameJacobian(model, data, row, tool, axes)).reshape(6, n)

    one: dict[str, Callable[[Array], Array]] = {
        "D": lambda row: np.array(pin.crba(model, data, row)).reshape(n, n),
        "H": coriolis,
        "G": lambda row: np.array(pin.computeGeneralizedGravity(model, data, row)).reshape(n),
        "V": lambda row: np.array(pin.computePotentialEnergy(model, data, row)),
        "F": position,
        "J": jacobian,
    }
    quantities = {name: np.stack([one[name](row) for row in x]) for name in want if name in one}
    if "V" in quantities:  # its zero is anyone's choice
        quantities["V"] = quantities["V"] - quantities["V"][0]
    if affine is not None:
        quantities = _in_coordinates(quantities, affine.L)
    return quantities


def _in_coordinates(quantities: Quantities, L: Array) -> Quantities:
    """Return quantities that belong to the velocities v_robot = L v."""
    # Power is the same in both: torques go with L', so D becomes L' D L.
    formula = {"D": "ai,Nab,bj->Nij", "H": "ai,bj,ck,Nabc->Nijk", "G": "ai,Na->Ni", "J": "Nra,ai->Nri"}
    factors: dict[str, Callable[[Array], tuple[Any, ...]]] = {
        "D": lambda x: (L, x, L),
        "H": lambda x: (L, L, L, x),
        "G": lambda x: (L, x),
        "J": lambda x: (x, L),
    }
    return {
        name: np.einsum(formula[name], *factors[name](x), optimize=True) if name in formula else x
        for name, x in quantities.items()
    }


def christoffel(slope: Array) -> Array:
    """Return H from the slopes of D: slope[..., i, j, k] is the derivative of D_ij by q_k.

    H_ijk = (dD_ij/dq_k + dD_ik/dq_j - dD_jk/dq_i) / 2 (Siciliano et al. 2009, eq. 7.45).
    """
    by_j = np.swapaxes(slope, -1, -2)
    by_i = np.moveaxis(slope, -1, -3)
    return np.asarray(0.5 * (slope + by_j - by_i))
