"""A URDF for a model that has none: the chain and the parameters that fit it best.

Which axes the joints have is tried, the lengths are found by nonlinear and the inertial parameters by
linear least squares. Then each link becomes a body that can exist: its pseudo-inertia is L L' (Rucker and
Wensing 2022), so mass, principal inertias and the triangle inequality come out right by construction.
"""

from __future__ import annotations

import itertools
import time
from collections import ChainMap
from collections.abc import Iterator, Mapping, Sequence
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
        lower, upper = np.full(n, -1.5), np.full(n, 1.5)
        states = check.random_states(lower, upper, np.zeros(n, dtype=bool), 1).first(_ROWS)
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
    found = ChainMap(*(one.quantities for one in sampled.values()))
    target = {quantity: found[quantity] for quantity in ("D", "G", "F") if quantity in found}
    if "D" not in target:
        raise ModelError(worker.name, "", "tells of no mass matrix, so no URDF can be suggested")
    if target.get("F", np.zeros((1, 3))).shape[1] != 3:
        del target["F"]  # in a plane, of which the axes are not known
    if "G" not in target and "potential_energy" in sampled:
        rows = states.q[: len(target["D"])]
        target["G"] = samples.slopes(worker, "potential_energy", rows, laws.STEP)
    return target


def _turning(worker: Worker, states: States) -> list[bool | None]:
    """Return for every joint whether it turns: the model repeats after 2 pi; None when it never changes."""
    found: list[bool | None] = []
    for e in np.eye(states.q.shape[1]):
        same, changes = True, False
        for name in worker.functions:
            others = [getattr(states, letter)[:3] for letter in ARGUMENTS[name][1:]]
            here, far, near = (
                samples.call(worker, name, states.q[:3] + step * e, *others)
                for step in (0.0, 2.0 * np.pi, 0.7)
            )
            size = max(float(np.abs(here).max()), 1e-12)
            same = same and float(np.abs(far - here).max()) < 1e-9 * size
            changes = changes or float(np.abs(near - here).max()) > 1e-9 * size
        found.append(same if changes else None)
    return found


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
    # The weight that each joint carries where it never changes, NaN where it does or is not known.
    weights = np.full(n, np.nan)
    if "G" in target:
        sizes = np.abs(target["G"]).max(axis=0)
        weights[:] = np.where(np.ptp(target["G"], axis=0) < 1e-9 * max(1.0, sizes.max()), sizes, np.nan)
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
        first = [x for x in first if ("z" in x) == (weights[0] <= 1e-9)]
    ordered = sorted(
        itertools.product(first, *[letters] * (n - 1)), key=lambda axes: "".join(axes).count("-")
    )
    for axes, kinds in itertools.product(ordered, itertools.product(*kinds_of)):
        yield _chain(axes, kinds)


def _chain(axes: tuple[str, ...], kinds: tuple[bool, ...]) -> Tree:
    """Return a chain with some axes, and joints that slide or turn, all of them at one point."""
    n = len(axes)
    return Tree(
        tuple(f"q{i + 1}" for i in range(n)),
        tuple(f"link{i + 1}" for i in range(n)),
        tuple(range(-1, n - 1)),
        (np.eye(3),) * n,
        (np.zeros(3),) * n,
        tuple((-1.0 if "-" in a else 1.0) * np.eye(3)[_XYZ.index(a[-1])] for a in axes),
        kinds,
        (Body(1.0, np.zeros(3), 0.01 * np.eye(3)),) * n,
        np.zeros(n),
        np.array([0.0, 0.0, -9.81]),
        n - 1,
        np.eye(3),
        np.zeros(3),
    )


class _Fit:
    """Least squares of chains to a model's D, G and tool positions.

    Attributes:
        inertial: the quantities that depend on masses: "D", and "G" where the model has it.
    """

    def __init__(self, q: Array, target: dict[str, Array]) -> None:
        """Keep the samples, each quantity divided by its size."""
        self._q = q
        self._sizes = {quantity: max(float(np.abs(x).max()), 1e-12) for quantity, x in target.items()}
        self._target = target
        self.inertial = [quantity for quantity in ("D", "G") if quantity in target]

    def distance(self, tree: Tree) -> float:
        """Return how far the best inertial parameters, possible or not, leave a chain from the model."""
        rest = np.abs(self._rest(tree)).max()
        if "F" in self._target:
            position = evaluate(tree, self._q, "F")["F"]
            rest = max(rest, np.abs(position - self._target["F"]).max() / self._sizes["F"])
        return float(rest)

    def with_lengths(self, tree: Tree) -> Tree:
        """Return a chain with the lengths that fit best."""
        if "F" in self._target:
            tree = self._from_positions(tree)
            if np.abs(evaluate(tree, self._q, "F")["F"] - self._target["F"]).max() > 1e-7 * self._sizes["F"]:
                return tree
        if tree.n == 1 or np.abs(self._rest(tree)).max() < EXACT:
            return tree

        def place(x: Array) -> Tree:
            return replace(tree, positions=(tree.positions[0], *x.reshape(-1, 3)))

        # From zero the slope by a length may vanish, so start beside it, twice.
        rng, best = np.random.default_rng(0), tree
        for _ in range(2):
            start = np.ravel(tree.positions[1:]) + rng.normal(scale=0.3, size=3 * (tree.n - 1))
            found = least_squares(
                lambda x: np.append(self._rest(place(x)), 1e-7 * x),  # what nothing feels becomes zero
                start,
                max_nfev=40,
                xtol=1e-14,
                ftol=1e-14,
            )
            best = min(best, place(found.x), key=lambda t: float(np.abs(self._rest(t)).max()))
            if np.abs(self._rest(best)).max() < EXACT:
                break
        # A length of a micrometre is rounding, and the reader wants to see a zero.
        positions = np.array(best.positions)
        return replace(best, positions=tuple(np.where(np.abs(positions) < 1e-6, 0.0, positions)))

    def with_bodies(self, tree: Tree) -> tuple[Tree, float]:
        """Return a chain with possible bodies that fit best, and how far it is off."""
        n = tree.n

        def set_bodies(x: Array) -> Tree:
            return replace(tree, bodies=tuple(_body(part) for part in x.reshape(n, 10)))

        def rest(x: Array) -> Array:
            quantities = evaluate(set_bodies(x), self._q, self.inertial)
            return np.concatenate(
                [((quantities[p] - self._target[p]) / self._sizes[p]).ravel() for p in self.inertial]
            )

        start = np.tile([np.log(0.1), np.log(0.1), np.log(0.1), 0, 0, 0, 0, 0, 0, 0.0], n)
        # A weak pull keeps what no joint feels where it was.
        pull = 1e-5
        for _ in range(2):
            found = least_squares(
                lambda x, s=start, w=pull: np.append(rest(x), w * (x - s)), start, max_nfev=400
            )
            start, pull = found.x, 1e-9
        return set_bodies(start), float(np.abs(rest(start)).max())

    def _from_positions(self, tree: Tree) -> Tree:
        """Return a chain with the lengths that put its tool where the model has it: they are linear in it."""
        blank = replace(tree, positions=tuple(np.zeros(3) for _ in range(tree.n)), tool_position=np.zeros(3))
        fixed = evaluate(blank, self._q, "F")["F"]
        columns = []
        for j in range(tree.n + 1):
            for unit in np.eye(3):
                one = (
                    replace(blank, tool_position=unit)
                    if j == tree.n
                    else blank.with_item("positions", j, unit)
                )
                columns.append((evaluate(one, self._q, "F")["F"] - fixed).ravel())
        x = np.linalg.lstsq(np.stack(columns, axis=-1), (self._target["F"] - fixed).ravel(), rcond=1e-10)[0]
        # Least squares leaves lengths that no position depends on at some 1e-17.
        x = np.where(np.abs(x) < 1e-9, 0.0, x).reshape(-1, 3)
        return replace(tree, positions=tuple(x[:-1]), tool_position=x[-1])

    def _rest(self, tree: Tree) -> Array:
        """Return what is left of D and G with the best inertial parameters."""
        parts = [
            np.concatenate([(quantities[p] / self._sizes[p]).ravel() for p in self.inertial])
            for i in range(tree.n)
            for quantities in _regressor(tree, i, self._q, self.inertial)
        ]
        A = np.stack(parts, axis=-1)
        b = np.concatenate([(self._target[p] / self._sizes[p]).ravel() for p in self.inertial])
        return np.asarray(A @ np.linalg.lstsq(A, b, rcond=1e-9)[0] - b)


def _regressor(tree: Tree, i: int, q: Array, want: Sequence[str]) -> Iterator[Quantities]:
    """Yield the derivatives of quantities by the ten inertial parameters of body i."""
    empty = tree
    for k in range(tree.n):
        empty = empty.with_body(k, mass=0.0, com=np.zeros(3), inertia=np.zeros((3, 3)))
    empty = replace(empty, armature=np.zeros(tree.n))
    point = empty.with_body(i, mass=1.0)
    yield evaluate(point, q, want)
    for axis in np.eye(3):
        # A unit point at +axis less one at -axis is twice the first moment.
        ahead, behind = (evaluate(point.with_body(i, com=s * axis), q, want) for s in (1.0, -1.0))
        yield {name: 0.5 * (ahead[name] - behind[name]) for name in ahead}
    for r, c in MOMENTS:
        unit = np.zeros((3, 3))
        unit[r, c] = unit[c, r] = 1.0
        yield evaluate(empty.with_body(i, inertia=unit), q, want)


def _body(x: Array) -> Body:
    """Return a possible body from any ten numbers: pseudo-inertia L L' with L lower triangular."""
    L = np.zeros((4, 4))
    # Exponentials keep the diagonal positive, so that J is positive definite for any numbers.
    L[np.diag_indices(4)] = np.exp(np.array([x[0], x[1], x[2], x[3]]))
    L[1, 0], L[2, 0], L[2, 1], L[3, 0], L[3, 1], L[3, 2] = x[4:]
    J = L @ L.T
    mass = float(J[3, 3])
    com = J[:3, 3] / mass
    spread = J[:3, :3] - mass * np.outer(com, com)
    return Body(mass, com, np.trace(spread) * np.eye(3) - spread)


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
        name, joint = quoteattr(tree.link_names[i]), quoteattr(tree.joint_names[i])
        parent = quoteattr(tree.link_names[tree.parents[i]] if tree.parents[i] >= 0 else "base")
        body, tensor = tree.bodies[i], tree.bodies[i].inertia
        kind = "prismatic" if tree.prismatic[i] else "revolute"
        moments = " ".join(
            f'i{_XYZ[r]}{_XYZ[c]}="{tensor[r, c]:.12g}"' for r in range(3) for c in range(r, 3)
        )
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
        last = quoteattr(tree.link_names[tree.tool_parent] if tree.tool_parent >= 0 else "base")
        lines += [
            '  <link name="suggested_tool"/>',
            '  <joint name="suggested_tool_joint" type="fixed">',
            f"    <parent link={last}/>",
            '    <child link="suggested_tool"/>',
            f'    <origin xyz="{_row(tree.tool_position)}" rpy="{_row(_rpy(tree.tool_rotation))}"/>',
            "  </joint>",
        ]
    return "\n".join([*lines, "</robot>", ""])


def _row(x: Array) -> str:
    return " ".join(f"{value:.12g}" for value in np.where(np.abs(x) < 1e-12, 0.0, x))


def _rpy(R: Array) -> Array:
    """Return roll, pitch and yaw of a rotation."""
    import pinocchio as pin

    return np.array(pin.rpy.matrixToRpy(R))
