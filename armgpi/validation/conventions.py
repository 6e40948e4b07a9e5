"""Conventions that a model may have and the robot has not: other names, other coordinates.

A model in coordinates q_model = A q + b has the torques A⁻ᵀ tau. Its functions are seen in the robot's
coordinates, so that everything else need not know of it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from difflib import get_close_matches
from functools import wraps
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from armgpi.base.arrays import Array, check_type
from armgpi.errors import NameNotFound, ParameterError
from armgpi.validation.tree import Tree, absolute_angles

#: Other names that functions may have; what is called C or coriolis may give the torque too.
SHORT = {
    **dict.fromkeys(("M", "D", "inertia_matrix"), "mass_matrix"),
    **dict.fromkeys(("C", "coriolis"), "coriolis_matrix"),
    **dict.fromkeys(("G", "gravity_vector", "gravity_torque"), "gravity"),
}
#: Parts of names that people give to functions -> the function that is probably meant, in words.
_MEANT = {
    "kinetic": "kinetic_energy",
    "potential": "potential_energy",
    "mass": "mass_matrix",
    "inertia": "mass_matrix",
    "coriolis": "coriolis_matrix",
    "centrifugal": "coriolis_matrix",
    "centripetal": "coriolis_matrix",
    "grav": "gravity",
    "jac": "jacobian",
    "inverse_dyn": "inverse_dynamics",
    "rnea": "inverse_dynamics",
    "forward_dyn": "forward_dynamics",
    "aba": "forward_dynamics",
    "forward_kin": "forward_kinematics",
    "fkin": "forward_kinematics",
}
#: Function -> what it is in words.
_IN_WORDS = {
    "mass_matrix": "the inertia matrix",
    "coriolis_matrix": "the Coriolis matrix",
    "gravity": "the gravity torque",
}
#: What a model may have its first level axis counted from.
VERTICALS = ("up", "down")


#: Functions whose values are other ones in other coordinates, by what they give.
_CONVERTED_MATRICES = ("mass_matrix", "coriolis_matrix")
_CONVERTED_TORQUES = ("coriolis_torque", "gravity", "inverse_dynamics")
_CONVERTED = (*_CONVERTED_MATRICES, *_CONVERTED_TORQUES, "forward_dynamics", "jacobian")


class Convention(NamedTuple):
    """How a model differs from the robot without being wrong.

    Attributes:
        names: what the model calls its functions -> what they are.
        A: matrix of the model's coordinates, (n, n); None where they are the robot's.
        b: offset of the model's coordinates [rad or m], (n,).
        mapped: those of the names that the user gave.
        n: number of joints of the robot; None without one.
        passive: joints without a motor, whose torque is zero or no argument of its forward dynamics.
    """

    names: Mapping[str, str]
    A: Array | None = None
    b: Array | None = None
    mapped: tuple[str, ...] = ()
    n: int | None = None
    passive: tuple[int, ...] = ()

    def convert(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function of the model as one of the robot's coordinates."""
        if name == "forward_dynamics" and self.passive:
            function = _without_motors(function, self.passive)
        if self.A is None or self.b is None:
            return function
        A, b = self.A, self.b
        back = np.asarray(np.linalg.inv(A))

        @wraps(function)
        def call(q: Array, *rest: Array) -> Any:
            others = [A @ x for x in rest]
            if name == "forward_dynamics":
                others[-1] = back.T @ rest[-1]
            value = function(A @ q + b, *others)
            if name not in _CONVERTED:
                return value
            array = np.asarray(value, dtype=np.float64)
            if name in _CONVERTED_MATRICES:
                return A.T @ array @ A
            if name in _CONVERTED_TORQUES:
                return A.T @ array.ravel()
            if name == "forward_dynamics":
                return back @ array.ravel()
            return array @ A

        return call


def near_function(name: str, known: Mapping[str, tuple[str, ...]]) -> str | None:
    """Return the known function that an unknown name probably means; None where none is near.

    Args:
        name: what the model calls its function.
        known: functions that are compared, by name.
    """
    folded = name.casefold()
    for fragment, function in _MEANT.items():
        if fragment in folded:
            return function
    folded_names = {known_name.casefold(): known_name for known_name in known}
    near = get_close_matches(folded, folded_names, n=1, cutoff=0.6)
    return folded_names[near[0]] if near else None


def propose_map(name: str, known: Mapping[str, tuple[str, ...]], taken: Collection[str] = ()) -> str:
    """Return why a function was not compared, with an option to paste where a known name is near.

    Args:
        name: what the model calls it.
        known: functions that are compared, by name.
        taken: those that the model has under their own names; a second one cannot be mapped to them.
    """
    if name in known:
        return f"takes other arguments than ({', '.join(known[name])})"
    function = near_function(name, known)
    if function is None:
        return f"unknown function name. What is it? --map {name}=FUNCTION"
    if function in taken:
        return f"unknown function name; the model has a {function} already"
    words = _IN_WORDS.get(function, f"the model's {function}")
    return f"unknown function name. Is it {words}? --map {name}={function}"


def _without_motors(function: Callable[..., Any], passive: tuple[int, ...]) -> Callable[..., Any]:
    """Return a forward dynamics of all torques, from one in which some are zero, or no argument at all.

    Those of the motors alone are an array, or a number where there is one motor.
    """

    @wraps(function)
    def call(q: Array, v: Array, tau: Array) -> Any:
        all_torques = tau.copy()
        all_torques[[*passive]] = 0.0
        of_motors = np.delete(tau, passive)
        forms: list[Any] = [all_torques, of_motors]
        if len(of_motors) == 1:
            forms.append(float(of_motors[0]))
        values, errors = [], []
        for torques in forms:
            try:
                value = function(q, v, torques)
            except (IndexError, TypeError, ValueError) as error:
                errors.append(error)
                continue
            if np.size(value) != len(q):
                continue
            values.append(value)
            if torques is not all_torques:
                return value
            # A first entry that is a passive joint's may be meant as that of the first motor.
            if not np.array_equal(value, function(q, v, np.zeros_like(all_torques))):
                return value
        if not values and errors:
            raise errors[0]
        return values[0] if values else value

    return call


def declare_convention(
    tree: Tree | None,
    names: Mapping[str, str],
    absolute: bool,
    from_vertical: str | None,
    known: tuple[str, ...],
    passive: str | Sequence[str] = (),
) -> Convention:
    """Return the convention that a user declares.

    Args:
        tree: the reference; None without one.
        names: what the model calls its functions -> what they are.
        absolute: its angles are counted from the base.
        from_vertical: "up" or "down" when its first level axis is counted from there.
        known: names of the functions that there are.
        passive: joints without a motor.

    Raises:
        NameNotFound: when a function or a joint is named that there is not.
        ParameterError: when one of them is not possible.
    """
    _check_names(names, known)
    known_as = {**SHORT, **names}
    mapped = tuple(names)
    without_motor = _places(tree, passive)
    if not absolute and from_vertical is None:
        return Convention(known_as, mapped=mapped, n=tree.n if tree else None, passive=without_motor)
    if tree is None:
        raise ParameterError("robot", None, "given, as `absolute` and `from_vertical` are about its joints")
    A = np.eye(tree.n)
    b = np.zeros(tree.n)
    if absolute:
        B = absolute_angles(tree)
        if np.array_equal(B, A):
            raise ParameterError("absolute", True, f"False, as no two joints of {tree.n} are parallel")
        A = np.asarray(np.linalg.inv(B))
    if from_vertical is not None:
        joint, turn = _quarter(tree, from_vertical)
        b = -turn * A[:, joint]
    return Convention(known_as, A, b, mapped, tree.n, without_motor)


def _places(tree: Tree | None, passive: str | Sequence[str]) -> tuple[int, ...]:
    """Return the places of the joints without a motor.

    Raises:
        NameNotFound: when there is no such joint.
        ParameterError: without a robot, for no names, or where no joint is left.
    """
    names = (passive,) if isinstance(passive, str) else passive
    check_type(names, "passive", list | tuple, "names of joints")
    if not names:
        return ()
    if tree is None:
        raise ParameterError("robot", None, "given, as `passive` is about its joints")
    for name in names:
        if not isinstance(name, str) or name not in tree.joint_names:
            raise NameNotFound("joint", name, tree.joint_names)
    places = {tree.joint_names.index(name) for name in names}
    if len(places) == tree.n:
        raise ParameterError("passive", list(names), "fewer joints than there are: some joint has a motor")
    return tuple(sorted(places))


def _check_names(names: Mapping[str, str], known: tuple[str, ...]) -> None:
    """Refuse names of functions that there are not, and two for one function."""
    for mine, name in names.items():
        if name not in known:
            raise NameNotFound(
                "function that is compared",
                name,
                known,
                f"the name in the model comes first; got {mine}={name}",
            )
    for twice, count in Counter(names.values()).items():
        if count > 1:
            both = ", ".join(f"{mine}={name}" for mine, name in names.items() if name == twice)
            raise ParameterError("names", both, f"one function for {twice}: only one is compared")


def _quarter(tree: Tree, way: str) -> tuple[int, float]:
    """Return the first joint with a level axis, and by how much it turns its link to the vertical [rad]."""
    if way not in VERTICALS:
        raise ParameterError("from_vertical", way, " or ".join(map(repr, VERTICALS)))
    R = np.eye(3)
    for i in range(tree.n):
        R = R @ tree.rotations[i]
        axis = R @ tree.axes[i]
        if tree.prismatic[i] or abs(axis[2]) >= 1e-6:
            continue
        link = tree.next_joint(i)
        if link is None or not link.any():
            link = tree.bodies[i].com
        length = float(np.linalg.norm(link))
        for turn in (np.pi / 2, -np.pi / 2, 0.0, np.pi):
            turned = R @ pin.exp3(turn * tree.axes[i]) @ link
            height = float(turned[2])
            if abs(height) > 0.99 * length and (height > 0.0) == (way == "up"):
                return i, float(turn)
        break
    raise ParameterError(
        "from_vertical", way, "None: no joint with a level axis has a link that can stand upright"
    )
