"""A URDF for a model that has none: the chain and the parameters that fit it best.

Which axes the joints have is tried, the lengths are found by nonlinear and the inertial parameters by
linear least squares. Then each link becomes a body that can exist: its pseudo-inertia is L L' (Rucker and
Wensing 2022), so mass, principal inertias and the triangle inequality come out right by construction.
"""

from __future__ import annotations

import itertools
import time
from collections import ChainMap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from typing import Any, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.optimize import least_squares

from armgpi.base.arrays import Array, check_type
from armgpi.errors import ModelError, Remedy
from armgpi.robot.robot import Robot
from armgpi.validation import check, laws, samples
from armgpi.validation.hypotheses import MOMENTS
from armgpi.validation.models import ARGUMENTS, States
from armgpi.validation.tree import Body, Quantities, Tree, evaluate, from_robot
from armgpi.validation.worker import Worker

#: Longer chains have too many axes to try: six directions per joint.
MOST_JOINTS = 4
#: Configurations that the fit uses: D and G of four joints give 14 equations at each, for 40 parameters.
_ROWS = 8
#: Time of the processor in which axes are tried [s]: beyond that a user gives a chain.
SEARCH = 5.0
#: A fit is exact when the rest is below this share.
EXACT = 1e-6
#: Largest position of a joint at which a model is sampled [rad or m].
_LARGEST = 1.5
#: A value that changes less than this share does not change.
_SAME = 1e-9
#: Starts of a search for lengths, and their spread about the lengths that are tried [m].
_STARTS = 2
_SPREAD = 0.3
#: Rows and columns of the pseudo-inertia's factor below its diagonal.
_BELOW = ([1, 2, 2, 3, 3, 3], [0, 0, 1, 0, 1, 2])
#: Parameters of a body to begin with: logarithms of the factor's diagonal, and zeros below it.
_BODY = (np.log(0.1),) * 3 + (0.0,) * 7
_XYZ = "xyz"


class Suggestion(NamedTuple):
    """A URDF for a model.

    Attributes:
        urdf: its text.
        rest: largest difference that is left, relative to the largest value of D or G.
        text: how well it fits, for the reader.
    """

    urdf: str
    rest: float
    text: str


def suggest_urdf(
    model: Any,
    robot: Robot | str | PathLike[str] | None = None,
    *,
    joints: int | None = None,
    time_limit: float = 5.0,
    isolate: bool = False,
) -> Suggestion:
    """Return a URDF skeleton whose inertia matrix and gravity are those of a model.

    With a robot, its chain is kept and only masses, centres of mass and inertias are fitted. Without one,
    axes along x, y and z at the zero configuration are tried, and lengths are fitted too. Gravity points
    along -z. What no joint feels (such as the place of a mass along a vertical axis) is chosen small.

    Args:
        model: as in :func:`armgpi.validate`; it needs a mass matrix or what contains one.
        robot: the chain, if there is one.
        joints: number of joints, when it cannot be found by trying.
        time_limit: as in :func:`armgpi.validate` [s].
        isolate: as in :func:`armgpi.validate`.

    Raises:
        ParameterError: when another argument is not as it should be.
        ModelError: when the model cannot be used, tells of no mass matrix, or has more than four joints and
            no robot is given.
    """
    time_limit = check.check_time_limit(time_limit)
    check_type(isolate, "isolate", bool, "True or False")
    arm = check.load_robot(robot)
    with Worker(model, check.name_of(model), time_limit, isolate=isolate) as worker:
        n = arm.n if arm is not None else check.count_joints(worker, joints)
        largest = np.full(n, _LARGEST)
        prismatic = np.zeros(n, dtype=bool)
        states = check.random_states(-largest, largest, prismatic, 1).first(_ROWS)
        target = _sample_target(worker, states)
        turning = _turning(worker, states) if arm is None else []
    fit = _Fit(states.q[: len(target["D"])], target)
    if arm is not None:
        tree, rest = fit.with_bodies(from_robot(arm))
        best = "no rigid bodies on this chain give the model: the best ones are"
    elif n > MOST_JOINTS:
        text = f"has {n} joints; without a robot at most {MOST_JOINTS} can be tried"
        raise ModelError(worker.name, "", text).suggesting(Remedy("robot"))
    else:
        tree, rest = _search_chain(fit, n, turning, target)
        best = "no chain with axes along x, y, z was found that is the model: the best one is"
    text = f"fits {' and '.join(fit.inertial)} to {rest:.2g}, every link is a possible rigid body"
    if rest > EXACT:
        text = f"{best} {rest:.2g} off"
    return Suggestion(_urdf_text(tree, text, "F" in target), rest, text)


def _sample_target(worker: Worker, states: States) -> dict[str, Array]:
    """Return a model's D, and its G and tool positions where it has them."""
    sampled = samples.sample(worker, states)
    quantities = ChainMap(*(of_function.quantities for of_function in sampled.values()))
    target = {letter: quantities[letter] for letter in ("D", "G", "F") if letter in quantities}
    if "D" not in target:
        raise ModelError(worker.name, "", "tells of no mass matrix, so no URDF can be suggested")
    if "F" in target and target["F"].shape[1] != 3:
        del target["F"]  # in a plane, of which the axes are not known
    if "G" not in target and "potential_energy" in sampled:
        rows = states.q[: len(target["D"])]
        target["G"] = samples.slopes(worker, "potential_energy", rows, laws.STEP)
    return target


def _turning(worker: Worker, states: States) -> list[bool | None]:
    """Return for every joint whether it turns: the model repeats after 2 pi; None when it never changes."""
    turning: list[bool | None] = []
    for axis in np.eye(states.q.shape[1]):
        repeats, changes = True, False
        for name in worker.functions:
            here, turned, moved = (
                _call_at(worker, name, states, step * axis) for step in (0.0, 2.0 * np.pi, 0.7)
            )
            least = _SAME * max(float(np.abs(here).max()), 1e-12)
            repeats = repeats and float(np.abs(turned - here).max()) < least
            changes = changes or float(np.abs(moved - here).max()) > least
        turning.append(repeats if changes else None)
    return turning


def _call_at(worker: Worker, name: str, states: States, step: Array) -> Array:
    """Return what a function gives at three states with other positions."""
    others = [getattr(states, letter)[:3] for letter in ARGUMENTS[name][1:]]
    return samples.call(worker, name, states.q[:3] + step, *others)


def _search_chain(
    fit: _Fit, n: int, turning: list[bool | None], target: Mapping[str, Array]
) -> tuple[Tree, float]:
    """Return the first chain that gives the model exactly, else the best one found in the time there is."""
    end = time.process_time() + SEARCH
    best: tuple[Tree, float] | None = None
    for chain in _chains(n, turning, target):
        tree = fit.with_lengths(chain)
        # Possible bodies take a nonlinear fit: only where any bodies would do.
        if fit.distance(tree) < EXACT:
            tree, rest = fit.with_bodies(tree)
        else:
            rest = max(fit.distance(tree), EXACT * 1.01)
        if best is None or rest < best[1]:
            best = tree, rest
        if rest < EXACT or time.process_time() > end:
            break
    assert best is not None
    return best if best[1] < EXACT else fit.with_bodies(best[0])


def _chains(n: int, turning: list[bool | None], target: Mapping[str, Array]) -> Iterator[Tree]:
    """Yield chains with axes along x, y and z, those with fewer minus signs first.

    Without tool positions, x and y are alike for the first joint, and so are its two directions.
    """
    weights = _constant_weights(n, target)
    kinds_of = []
    for turns, weight in zip(turning, weights.tolist(), strict=True):
        if turns is not None:
            kinds_of.append([not turns])
        elif weight > 1e-9:
            kinds_of.append([True])  # a weight that never changes slides along the vertical
        else:
            kinds_of.append([False, True])  # nothing depends on it: either will do
    letters = ["z", "y", "x", "-z", "-y", "-x"]
    first = letters if "F" in target else ["z", "y"]
    if turning[0] and "G" in target:  # no weight to carry: it turns about the vertical
        vertical = bool(weights[0] <= 1e-9)
        first = [letter for letter in first if ("z" in letter) == vertical]
    axes_of_joints = itertools.product(first, *[letters] * (n - 1))
    for axes in sorted(axes_of_joints, key=lambda axes: "".join(axes).count("-")):
        for kinds in itertools.product(*kinds_of):
            yield _chain(axes, kinds)


def _constant_weights(n: int, target: Mapping[str, Array]) -> Array:
    """Return the weight that each joint carries where it never changes; NaN where it does or is not known."""
    if "G" not in target:
        return np.full(n, np.nan)
    sizes = np.abs(target["G"]).max(axis=0)
    changes = np.ptp(target["G"], axis=0)
    is_constant = changes < _SAME * max(1.0, sizes.max())
    return np.where(is_constant, sizes, np.nan)


def _chain(axes: tuple[str, ...], kinds: tuple[bool, ...]) -> Tree:
    """Return a chain with some axes, and joints that slide or turn, all of them at one point."""
    n = len(axes)
    directions = []
    for axis in axes:
        sign = -1.0 if axis.startswith("-") else 1.0
        directions.append(sign * np.eye(3)[_XYZ.index(axis[-1])])
    body = Body(mass=1.0, com=np.zeros(3), inertia=0.01 * np.eye(3))
    return Tree(
        joint_names=tuple(f"q{i + 1}" for i in range(n)),
        link_names=tuple(f"link{i + 1}" for i in range(n)),
        parents=tuple(range(-1, n - 1)),
        rotations=(np.eye(3),) * n,
        positions=(np.zeros(3),) * n,
        axes=tuple(directions),
        prismatic=kinds,
        bodies=(body,) * n,
        armature=np.zeros(n),
        gravity=np.array([0.0, 0.0, -9.81]),
        tool_parent=n - 1,
        tool_rotation=np.eye(3),
        tool_position=np.zeros(3),
    )


class _Fit:
    """Least squares of chains to a model's D, G and tool positions.

    Attributes:
        inertial: the quantities that depend on masses: "D", and "G" where the model has it.
    """

    def __init__(self, q: Array, target: dict[str, Array]) -> None:
        """Keep the samples, each quantity divided by its size."""
        self._q = q
        self._sizes: dict[str, float] = {}
        for quantity, x in target.items():
            self._sizes[quantity] = max(float(np.abs(x).max()), 1e-12)
        self._target = target
        self.inertial = [quantity for quantity in ("D", "G") if quantity in target]

    def distance(self, tree: Tree) -> float:
        """Return how far the best inertial parameters, possible or not, leave a chain from the model."""
        distance = self._inertial_distance(tree)
        if "F" in self._target:
            distance = max(distance, self._position_distance(tree) / self._sizes["F"])
        return distance

    def _inertial_distance(self, tree: Tree) -> float:
        """Return how far the best inertial parameters leave D and G from the model's, of their sizes."""
        return float(np.abs(self._rest(tree)).max())

    def _position_distance(self, tree: Tree) -> float:
        """Return how far the tool is from where the model has it, at most [m]."""
        position = evaluate(tree, self._q, "F")["F"]
        return float(np.abs(position - self._target["F"]).max())

    def with_lengths(self, tree: Tree) -> Tree:
        """Return a chain with the lengths that fit best."""
        if "F" in self._target:
            tree = self._from_positions(tree)
            if self._position_distance(tree) > 1e-7 * self._sizes["F"]:
                return tree
        if tree.n == 1 or self._inertial_distance(tree) < EXACT:
            return tree

        def with_positions(x: Array) -> Tree:
            return replace(tree, positions=(tree.positions[0], *x.reshape(-1, 3)))

        def residual(x: Array) -> Array:
            pull = 1e-7 * x  # what nothing feels becomes zero
            return np.append(self._rest(with_positions(x)), pull)

        # From zero the slope by a length may vanish, so start beside it, twice.
        rng = np.random.default_rng(0)
        best = tree
        for _ in range(_STARTS):
            beside = rng.normal(scale=_SPREAD, size=3 * (tree.n - 1))
            start = np.ravel(tree.positions[1:]) + beside
            solution = least_squares(residual, start, max_nfev=40, xtol=1e-14, ftol=1e-14)
            best = min(best, with_positions(solution.x), key=self._inertial_distance)
            if self._inertial_distance(best) < EXACT:
                break
        # A length of a micrometre is rounding, and the reader wants to see a zero.
        return replace(best, positions=tuple(_without_rounding(np.array(best.positions), 1e-6)))

    def with_bodies(self, tree: Tree) -> tuple[Tree, float]:
        """Return a chain with possible bodies that fit best, and how far it is off."""
        n = tree.n

        def set_bodies(x: Array) -> Tree:
            bodies = [_body(parameters) for parameters in x.reshape(n, 10)]
            return replace(tree, bodies=tuple(bodies))

        def difference(x: Array) -> Array:
            quantities = evaluate(set_bodies(x), self._q, self.inertial)
            return self._scaled({p: quantities[p] - self._target[p] for p in self.inertial})

        x = np.tile(_BODY, n)
        # A weak pull keeps what no joint feels where it was.
        for pull in (1e-5, 1e-9):
            x = _pulled_least_squares(difference, x, pull)
        return set_bodies(x), float(np.abs(difference(x)).max())

    def _from_positions(self, tree: Tree) -> Tree:
        """Return a chain with the lengths that put its tool where the model has it: they are linear in it."""
        zeros = (np.zeros(3),) * tree.n
        blank = replace(tree, positions=zeros, tool_position=np.zeros(3))
        fixed = evaluate(blank, self._q, "F")["F"]
        moved = [blank.with_item("positions", j, axis) for j in range(tree.n) for axis in np.eye(3)]
        moved += [replace(blank, tool_position=axis) for axis in np.eye(3)]
        columns = []
        for tree_with_length in moved:
            position = evaluate(tree_with_length, self._q, "F")["F"]
            columns.append((position - fixed).ravel())
        matrix = np.stack(columns, axis=-1)
        solution, *_ = np.linalg.lstsq(matrix, (self._target["F"] - fixed).ravel(), rcond=1e-10)
        x = np.asarray(solution, dtype=np.float64)
        # Least squares leaves lengths that no position depends on at some 1e-17.
        *positions, tool_position = _without_rounding(x, 1e-9).reshape(-1, 3)
        return replace(tree, positions=tuple(positions), tool_position=tool_position)

    def _rest(self, tree: Tree) -> Array:
        """Return what is left of D and G with the best inertial parameters."""
        columns = []
        for i in range(tree.n):
            slopes_of_body = _regressor(tree, i, self._q, self.inertial)
            columns += [self._scaled(slopes) for slopes in slopes_of_body]
        A = np.stack(columns, axis=-1)
        b = self._scaled(self._target)
        x = np.linalg.lstsq(A, b, rcond=1e-9)[0]
        return np.asarray(A @ x - b)

    def _scaled(self, quantities: Mapping[str, Array]) -> Array:
        """Return D and G one after the other, each divided by its size."""
        return np.concatenate([(quantities[p] / self._sizes[p]).ravel() for p in self.inertial])


def _pulled_least_squares(residual: Callable[[Array], Array], start: Array, pull: float) -> Array:
    """Return what makes a residual small, and is not far from the start where nothing depends on it."""

    def pulled(x: Array) -> Array:
        return np.append(residual(x), pull * (x - start))

    return np.asarray(least_squares(pulled, start, max_nfev=400).x)


def _without_rounding(x: Array, least: float) -> Array:
    """Return an array with zeros in place of what is smaller than the least."""
    return np.where(np.abs(x) < least, 0.0, x)


def _regressor(tree: Tree, i: int, q: Array, want: Sequence[str]) -> Iterator[Quantities]:
    """Yield the derivatives of quantities by the ten inertial parameters of body i."""
    nothing = Body(mass=0.0, com=np.zeros(3), inertia=np.zeros((3, 3)))
    empty = replace(tree, bodies=(nothing,) * tree.n, armature=np.zeros(tree.n))
    point = empty.with_body(i, mass=1.0)
    yield evaluate(point, q, want)
    for axis in np.eye(3):
        # A unit point at +axis less one at -axis is twice the first moment.
        ahead = evaluate(point.with_body(i, com=axis), q, want)
        behind = evaluate(point.with_body(i, com=-axis), q, want)
        yield {name: 0.5 * (ahead[name] - behind[name]) for name in ahead}
    for r, c in MOMENTS:
        unit = np.zeros((3, 3))
        unit[r, c] = unit[c, r] = 1.0
        yield evaluate(empty.with_body(i, inertia=unit), q, want)


def _body(x: Array) -> Body:
    """Return a possible body from any ten numbers: pseudo-inertia L L' with L lower triangular."""
    L = np.zeros((4, 4))
    # Exponentials keep the diagonal positive, so that J is positive definite for any numbers.
    L[np.diag_indices(4)] = np.exp(x[:4])
    L[_BELOW] = x[4:]
    J = L @ L.T
    mass = float(J[3, 3])
    com = J[:3, 3] / mass
    spread = J[:3, :3] - mass * np.outer(com, com)
    inertia = np.trace(spread) * np.eye(3) - spread
    return Body(mass, com, inertia)


def _urdf_text(tree: Tree, text: str, tool: bool) -> str:
    """Return a tree as URDF."""
    lines = [
        "<!--",
        f"  Suggested by armgpi validate, not measured: {text.replace('--', '- -')}.",
        "  Limits are placeholders.",
        "-->",
        '<robot name="suggested">',
        '  <link name="base"/>',
    ]
    for i in range(tree.n):
        name = quoteattr(tree.link_names[i])
        joint = quoteattr(tree.joint_names[i])
        parent = _quoted_link(tree, tree.parents[i])
        body = tree.bodies[i]
        kind = "prismatic" if tree.prismatic[i] else "revolute"
        moments = _inertia_attributes(body.inertia)
        lines += [
            f"  <link name={name}>",
            "    <inertial>",
            f'      <origin xyz="{_row(body.com)}"/>',
            f'      <mass value="{body.mass:.12g}"/>',
            f"      <inertia {moments}/>",
            "    </inertial>",
            "  </link>",
            f'  <joint name={joint} type="{kind}">',
            f"    <parent link={parent}/>",
            f"    <child link={name}/>",
            f'    <origin xyz="{_row(tree.positions[i])}" rpy="{_row(_rpy(tree.rotations[i]))}"/>',
            f'    <axis xyz="{_row(tree.axes[i])}"/>',
            '    <limit lower="-3.14159" upper="3.14159" effort="100" velocity="10"/>',
            "  </joint>",
        ]
    if tool or tree.tool_position.any():
        last = _quoted_link(tree, tree.tool_parent)
        lines += [
            '  <link name="suggested_tool"/>',
            '  <joint name="suggested_tool_joint" type="fixed">',
            f"    <parent link={last}/>",
            '    <child link="suggested_tool"/>',
            f'    <origin xyz="{_row(tree.tool_position)}" rpy="{_row(_rpy(tree.tool_rotation))}"/>',
            "  </joint>",
        ]
    return "\n".join([*lines, "</robot>", ""])


def _quoted_link(tree: Tree, i: int) -> str:
    """Return the quoted name of a link; of the base where there is none before."""
    return quoteattr(tree.link_names[i] if i >= 0 else "base")


def _inertia_attributes(tensor: Array) -> str:
    """Return ixx="...", ixy="..." and so on."""
    attributes = []
    for r, c in itertools.combinations_with_replacement(range(3), 2):
        attributes.append(f'i{_XYZ[r]}{_XYZ[c]}="{tensor[r, c]:.12g}"')
    return " ".join(attributes)


def _row(x: Array) -> str:
    return " ".join(f"{value:.12g}" for value in _without_rounding(x, 1e-12))


def _rpy(R: Array) -> Array:
    """Return roll, pitch and yaw of a rotation."""
    import pinocchio as pin

    return np.array(pin.rpy.matrixToRpy(R))
