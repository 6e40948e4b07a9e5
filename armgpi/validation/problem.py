"""A model beside the reference, element by element: entries of D, products of velocities, joints of G.

Every element is a column of samples over the configurations. A hypothesis gives such columns too, and so it
is seen which elements it explains.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array
from armgpi.validation.hypotheses import Hypothesis
from armgpi.validation.models import States
from armgpi.validation.samples import SAFETY, Sampled, rows_of
from armgpi.validation.tree import Quantities, Tree, evaluate

Mask = npt.NDArray[np.bool_]

#: An element may be this much smaller than the largest of its quantity before its error counts less: a moment
#: of inertia of a wrist counts beside that of the shoulder, the rounding of a zero does not.
SMALL = 1e-4
#: Configurations at which hypotheses are tried first: most are wrong, and show it there.
SCREEN = 10
#: Functions that are a quantity themselves, and quantities that functions need.
_DIRECT = {
    "mass_matrix": "D",
    "gravity": "G",
    "potential_energy": "V",
    "forward_kinematics": "F",
    "jacobian": "J",
}
_NEEDED = {**{name: (quantity,) for name, quantity in _DIRECT.items()}, "kinetic_energy": ("D",)}
#: Functions whose elements are differences of larger numbers, and so rounded more.
_DIFFERENCES = ("inverse_dynamics", "kinetic_energy", "coriolis_torque", "coriolis_matrix")


class Element(NamedTuple):
    """One scalar of one function.

    Attributes:
        function: the function.
        quantity: "D", "H", "G", "V", "F", "J", "B", "Z" or "A"; "whole" for all that a function gives.
        place: its indices, from 0.
    """

    function: str
    quantity: str
    place: tuple[int, ...]

    @property
    def label(self) -> str:
        """What it is called: "D[1,2]", "q̇1 q̇2 in τ1", "G[2]"."""
        one = [i + 1 for i in self.place]
        if self.quantity == "H":
            i, j, k = one
            product = f"q̇{j}²" if j == k else f"q̇{j} q̇{k}"
            return f"{product} in τ{i}"
        if self.quantity == "B":
            return f"q̇{one[1]} (linear) in τ{one[0]}"
        if self.quantity == "Z":
            return f"torque at rest of τ{one[0]}"
        if self.quantity == "A":
            return f"q̈{one[0]}"
        if self.quantity in ("V", "whole"):
            return self.quantity
        if self.quantity == "F":
            return "xyz"[self.place[0]]
        if self.quantity == "J":
            row = ("ẋ", "ẏ", "ż", "ωx", "ωy", "ωz")[self.place[0]]
            return f"J[{row},{one[1]}]"
        return f"{self.quantity}[{','.join(map(str, one))}]"


class Problem:
    """The samples of a model beside those of the reference.

    Attributes:
        tree: the reference.
        q: the configurations, (N, n).
        elements: what the columns are.
        user: the model's samples, (N, E).
        reference: the reference's, (N, E).
        tolerance: how far each element may be off, (E,).
        functions: for every column its function.
        rtol: relative error up to which two values agree.
        noise: rounding error of each function's values.
    """

    def __init__(self, tree: Tree, q: Array, sampled: Mapping[str, Sampled], rtol: float) -> None:
        """Lay out the elements of all sampled functions."""
        rows = rows_of(sampled)
        self.tree, self.q, self.rtol = tree, q[:rows], rtol
        self.noise = {name: s.noise for name, s in sampled.items()}
        self._sampled = {name: {k: x[:rows] for k, x in s.quantities.items()} for name, s in sampled.items()}
        # D and G also where no function has them: the tolerances are relative to them.
        found = {"D", "G"}.union(*self._sampled.values())
        self._moving = sampled["forward_dynamics"].states if "A" in found else None
        self.want = sorted(found | {"H"} if "A" in found else found)
        reference = evaluate(tree, self.q, self.want)
        self.axes = self._plane(reference)
        self.elements = [
            Element(function, quantity, index)
            for function, quantities in self._sampled.items()
            for quantity, array in quantities.items()
            for index in _indices(quantity, array)
        ]
        self.functions = np.array([element.function for element in self.elements])
        self.user = self.user_columns(self._sampled, rows)
        self._reference_quantities = reference
        self.reference = self.columns(reference)
        self.tolerance = self._tolerances(reference, sampled, rtol)

    def has_layout_of(self, sampled: Mapping[str, Sampled]) -> bool:
        """Tell whether other samples of some functions have quantities of the same shapes."""
        return all(
            {k: x.shape[1:] for k, x in other.quantities.items()}
            == {k: x.shape[1:] for k, x in self._sampled[name].items()}
            for name, other in sampled.items()
        )

    def columns(self, quantities: Quantities) -> Array:
        """Return the columns of the quantities of an arm, (rows, E); NaN where a quantity is not given."""
        quantities = self.in_tool_coordinates(quantities)
        rows = len(next(iter(quantities.values())))
        n = self.tree.n
        # No arm has these: its Coriolis torque is quadratic in v.
        quantities = {"B": np.zeros((rows, n, n)), "Z": np.zeros((rows, n)), **quantities}
        if self._moving is not None and {"D", "H", "G"} <= {*quantities}:
            quantities["A"] = function_of("forward_dynamics", quantities, self._moving, self.tree.viscous)
        out = np.full((rows, len(self.elements)), np.nan)
        for column, element in enumerate(self.elements):
            if element.quantity in quantities:
                out[:, column] = _column(quantities[element.quantity], element)
            if element.quantity == "B" and self._has_friction(element):
                out[:, column] += self.tree.viscous[element.place[0]]  # type: ignore[index]
        return out

    def _has_friction(self, element: Element) -> bool:
        """Tell whether an element that is linear in v has viscous friction of the reference."""
        i, j = element.place
        return self.tree.viscous is not None and i == j and element.function.endswith("dynamics")

    def values(self, name: str, s: States) -> Array:
        """Return what a function of a model should give at some states, (N, ...)."""
        quantities = self.in_tool_coordinates(evaluate(self.tree, s.q, _NEEDED.get(name, ("D", "H", "G"))))
        return function_of(name, quantities, s, self.tree.viscous)

    def hypothesis(
        self, hypothesis: Hypothesis, rows: int | None = None, want: Iterable[str] | None = None
    ) -> Array:
        """Return the columns of a hypothesis, (rows, E): at few configurations, or of few quantities."""
        # The same arm: nothing has to be evaluated again, which saves most of the time.
        if hypothesis.post is not None and hypothesis.tree is None and hypothesis.affine is None:
            names = self.want if want is None else want
            quantities = {k: x[:rows] for k, x in self._reference_quantities.items() if k in names}
            return self.columns({**quantities, **hypothesis.post(quantities)})
        return self.columns(
            hypothesis.quantities(self.tree, self.q[:rows], self.want if want is None else want)
        )

    def fits(self, columns: Array) -> Mask:
        """Return which elements of the model agree with some columns."""
        away = np.abs(self.user[: len(columns)] - columns).max(axis=0)
        # Written so that NaN does not fit.
        return np.asarray(away <= self.tolerance)

    def explains(self, hypothesis: Hypothesis) -> Mask:
        """Return which elements a hypothesis explains: at few configurations first, then at all."""
        few = self.fits(self.hypothesis(hypothesis, SCREEN))
        if not (few & ~self.agreeing).any():
            return few & self.agreeing
        return few & self.fits(self.hypothesis(hypothesis))

    @property
    def is_passive(self) -> bool:
        """Whether a forward dynamics does not read every torque, so that it has no D to compare."""
        return self._moving is not None

    @property
    def agreeing(self) -> Mask:
        """Which elements agree with the reference."""
        return self.fits(self.reference)

    def user_columns(self, quantities: Mapping[str, Quantities], rows: int) -> Array:
        """Return columns from quantities of the model's functions; NaN for functions that are not there.

        Args:
            quantities: function -> quantity -> its values at `rows` configurations, (rows, ...).
            rows: how many configurations there are.

        Returns:
            A column for each element of the problem, (rows, elements).
        """
        out = np.full((rows, len(self.elements)), np.nan)
        for column, element in enumerate(self.elements):
            if element.quantity in quantities.get(element.function, {}):
                array = quantities[element.function][element.quantity]
                out[:, column] = _column(array, element)
        return out

    def agrees_with(self, quantities: Quantities, mask: Mask) -> Mask:
        """Return which elements of `mask` agree with other quantities, to the digits of a numerical slope."""
        out = np.zeros(len(self.elements), dtype=np.bool_)
        for column in np.flatnonzero(mask):
            element = self.elements[column]
            other = _column(quantities[element.quantity], element)[: len(self.q)]
            away = np.abs(self.user[: len(other), column] - other).max()
            size = max(np.abs(quantities[element.quantity]).max(), 1e-300)
            out[column] = away <= max(self.tolerance[column], 1e-8 * size)
        return out

    def of_function(self, name: str) -> Mask:
        """Return which elements belong to a function."""
        return np.asarray(self.functions == name)

    def elements_of(self, mask: Mask) -> tuple[Element, ...]:
        """Return the elements of a mask."""
        return tuple(self.elements[column] for column in np.flatnonzero(mask))

    def quantity(self, *quantities: str) -> Mask:
        """Return which elements belong to some quantities."""
        return np.array([element.quantity in quantities for element in self.elements], dtype=np.bool_)

    def _plane(self, reference: Quantities) -> tuple[int, ...]:
        """Return which coordinates a kinematics in the plane means: those that it fits best."""
        for quantity in ("F", "J"):
            for quantities in self._sampled.values():
                if quantity in quantities and quantities[quantity].shape[1] == 2:
                    pairs = [(0, 1), (0, 2), (1, 2)]
                    away = [
                        np.abs(quantities[quantity] - reference[quantity][:, pair]).max() for pair in pairs
                    ]
                    return pairs[int(np.argmin(away))]
        return (0, 1, 2)

    def in_tool_coordinates(self, quantities: Quantities) -> Quantities:
        """Return the quantities with the coordinates of the tool that the model has."""
        changed = dict(quantities)
        for quantity in ("F", "J"):
            for own in self._sampled.values():
                if quantity in own and quantity in changed:
                    count = own[quantity].shape[1]
                    rows = list(self.axes) if count == 2 else list(range(count))
                    changed[quantity] = changed[quantity][:, rows]
        return changed

    def _tolerances(self, reference: Quantities, sampled: Mapping[str, Sampled], rtol: float) -> Array:
        """Return how far each element may be off."""
        # What an arm of this weight, reach and inertia would have, where an entry of the reference vanishes.
        weight = 9.81 * sum(body.mass for body in self.tree.bodies)
        reach = sum(float(np.linalg.norm(p)) for p in (*self.tree.positions, self.tree.tool_position))
        inertia = float(np.abs(reference["D"]).max())
        natural = {"D": inertia, "H": inertia, "B": inertia, "F": reach, "J": 1.0}
        natural |= dict.fromkeys(("G", "Z", "V"), 1e-3 * weight)  # a lever of a millimetre
        natural["A"] = 1.0
        condition = float(np.linalg.cond(reference["D"]).max())
        out = np.empty(len(self.elements))
        for column, element in enumerate(self.elements):
            function, quantity, _ = element
            own = sampled[function]
            whole = max(natural[quantity], float(np.abs(reference.get(quantity, np.zeros(1))).max()))
            size = max(float(np.abs(self.reference[:, column]).max()), SMALL * whole)
            largest = float(np.abs(own.values).max())
            out[column] = rtol * size + SAFETY * own.noise
            if function in _DIFFERENCES:
                out[column] += 1e-14 * largest
            elif quantity == "A":
                out[column] += 1e-15 * condition * float(np.abs(self.reference[:, column]).max())
            elif function == "forward_dynamics":
                # A unit torque hardly moves a heavy arm: what is lost in its response, D enlarges twice.
                rounding = max(1e-16, SAFETY * own.digits)
                lost = rounding * inertia * inertia * largest * (1.0 if quantity == "D" else largest)
                out[column] += 1e-15 * condition * (whole + weight) + lost
        return out


def function_of(name: str, p: Quantities, s: States, viscous: Array | None = None) -> Array:
    """Return what a function of a model gives, from the quantities of an arm in its first states.

    Args:
        name: the function.
        p: quantities of the arm, as many as the function needs.
        s: states; the arm may be in the first of these alone.
        viscous: viscous friction of the joints, in inverse and forward dynamics.
    """
    if name in _DIRECT:
        return p[_DIRECT[name]]
    rows = len(p["D"])
    v, tau, a = s.v[:rows], s.tau[:rows], s.a[:rows]
    if name == "kinetic_energy":
        return np.asarray(0.5 * np.einsum("Ni,Nij,Nj->N", v, p["D"], v))
    torque = np.einsum("Nijk,Nj,Nk->Ni", p["H"], v, v)
    if not name.endswith("dynamics"):
        return np.asarray(torque)
    torque = torque + p["G"] + (0.0 if viscous is None else viscous * v)
    if name == "inverse_dynamics":
        return np.asarray(np.einsum("Nij,Nj->Ni", p["D"], a) + torque)
    try:
        return np.asarray(np.linalg.solve(p["D"], (tau - torque)[..., np.newaxis])[..., 0])
    except np.linalg.LinAlgError:  # a part of an arm
        return np.full(v.shape, np.nan)


def _indices(quantity: str, array: Array) -> list[tuple[int, ...]]:
    """Return the indices of the elements of a quantity; a symmetric D has one of each pair."""
    shape = array.shape[1:]
    if quantity == "H":
        return [(i, j, k) for i, j, k in np.ndindex(*shape) if j <= k]  # v_j v_k is v_k v_j
    if quantity == "D":
        size = float(np.abs(array).max())
        if np.abs(array - np.swapaxes(array, -1, -2)).max() <= 1e-12 * size:
            return [(i, j) for i, j in np.ndindex(*shape) if i <= j]
    return list(np.ndindex(*shape))


def _column(array: Array, element: Element) -> Array:
    """Return the samples of an element; a product of two velocities stands twice in H."""
    column: Array = array[(slice(None), *element.place)]  # type: ignore[arg-type]
    twice = element.quantity == "H" and element.place[1] != element.place[2]
    return 2.0 * column if twice else column
