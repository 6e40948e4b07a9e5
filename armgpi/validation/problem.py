"""A model beside the reference, element by element: entries of D, products of velocities, joints of G.

Every element is a column of samples over the configurations. A hypothesis gives such columns too, and so it
is seen which elements it explains.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.arrays import Array
from armgpi.validation.hypotheses import Hypothesis
from armgpi.validation.samples import SAFETY, Sampled
from armgpi.validation.tree import Pieces, Tree, evaluate

Mask = npt.NDArray[np.bool_]

#: An element may be this much smaller than the largest of its piece before its error counts less.
SMALL = 1e-4
#: Configurations at which hypotheses are tried first.
SCREEN = 10
_DIGITS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
#: Piece -> function that gives it straight away.
SOURCE = {"D": "mass_matrix", "H": "coriolis_torque", "G": "gravity", "V": "potential_energy"}


class Element(NamedTuple):
    """One scalar of one function.

    Attributes:
        term: the function.
        piece: "D", "H", "G", "V", "F", "J", "B" or "Z".
        place: its indices, from 0.
    """

    term: str
    piece: str
    place: tuple[int, ...]

    @property
    def label(self) -> str:
        """What it is called: "D[1,2]", "q̇1 q̇2 in τ1", "G[2]"."""
        one = [i + 1 for i in self.place]
        if self.piece == "H":
            i, j, k = one
            product = f"q̇{j}²" if j == k else f"q̇{j} q̇{k}"
            return f"{product} in τ{i}"
        if self.piece == "B":
            return f"q̇{one[1]} (linear) in τ{one[0]}"
        if self.piece == "Z":
            return f"torque at rest of τ{one[0]}"
        if self.piece == "V":
            return "V"
        if self.piece == "F":
            return "xyz"[self.place[0]]
        if self.piece == "J":
            row = ("ẋ", "ẏ", "ż", "ωx", "ωy", "ωz")[self.place[0]]
            return f"J[{row},{one[1]}]"
        return f"{self.piece}[{','.join(map(str, one))}]"

    @property
    def joints(self) -> tuple[int, ...]:
        """Indices of the joints that it concerns, from 0."""
        if self.piece in ("V", "F"):
            return ()
        return self.place[1:] if self.piece == "J" else self.place


class Problem:
    """The samples of a model beside those of the reference.

    Attributes:
        tree: the reference.
        q: the configurations, (N, n).
        elements: what the columns are.
        user: the model's samples, (N, E).
        reference: the reference's, (N, E).
        tolerance: how far each element may be off, (E,).
        terms: for every column its function.
    """

    def __init__(self, tree: Tree, q: Array, sampled: Mapping[str, Sampled], rtol: float) -> None:
        """Lay out the elements of all sampled functions."""
        rows = min(len(s.values) for s in sampled.values())
        self.tree, self.q = tree, q[:rows]
        self.rtol = rtol
        self._sampled = {name: {k: x[:rows] for k, x in s.pieces.items()} for name, s in sampled.items()}
        self.want = sorted({piece for pieces in self._sampled.values() for piece in pieces} | {"D", "G"})
        reference = evaluate(tree, self.q, self.want)
        self.axes = self._plane(reference)
        self.elements = [
            Element(term, piece, index)
            for term, pieces in self._sampled.items()
            for piece, array in pieces.items()
            for index in _indices(piece, array)
        ]
        self.terms = np.array([element.term for element in self.elements])
        self.user = np.stack([_column(self._sampled[e.term][e.piece], e) for e in self.elements], axis=-1)
        self._reference_pieces = reference
        self.reference = self.columns(reference)
        self.tolerance = self._tolerances(reference, sampled)

    def columns(self, pieces: Pieces) -> Array:
        """Return the columns of the pieces of an arm, (rows, E); NaN where a piece is not given."""
        pieces = self.seen(pieces)
        rows = len(next(iter(pieces.values())))
        n = self.tree.n
        pieces = {"B": np.zeros((rows, n, n)), "Z": np.zeros((rows, n)), **pieces}
        out = np.full((rows, len(self.elements)), np.nan)
        for column, element in enumerate(self.elements):
            if element.piece in pieces:
                out[:, column] = _column(pieces[element.piece], element)
        return out

    def hypothesis(
        self, hypothesis: Hypothesis, rows: int | None = None, want: Iterable[str] | None = None
    ) -> Array:
        """Return the columns of a hypothesis, at the first configurations and of some pieces if so wished."""
        if hypothesis.post is not None and hypothesis.tree is None and hypothesis.affine is None:
            names = self.want if want is None else want
            pieces = {k: x[:rows] for k, x in self._reference_pieces.items() if k in names}
            return self.columns({**pieces, **hypothesis.post(pieces)})
        return self.columns(hypothesis.pieces(self.tree, self.q[:rows], self.want if want is None else want))

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
    def agreeing(self) -> Mask:
        """Which elements agree with the reference."""
        return self.fits(self.reference)

    def user_columns(self, pieces: Mapping[str, Pieces], rows: int) -> Array:
        """Return columns from pieces of the model's functions; NaN for functions that are not there."""
        out = np.full((rows, len(self.elements)), np.nan)
        for column, element in enumerate(self.elements):
            if element.piece in pieces.get(element.term, {}):
                array = pieces[element.term][element.piece]
                out[:, column] = _column(array, element)
        return out

    def agrees_with(self, pieces: Pieces, mask: Mask) -> Mask:
        """Return which elements of `mask` are what some pieces say, to the digits of a numerical slope."""
        out = np.zeros(len(self.elements), dtype=np.bool_)
        for column in np.flatnonzero(mask):
            element = self.elements[column]
            other = _column(pieces[element.piece], element)[: len(self.q)]
            away = np.abs(self.user[: len(other), column] - other).max()
            size = max(np.abs(pieces[element.piece]).max(), 1e-300)
            out[column] = away <= max(self.tolerance[column], 1e-8 * size)
        return out

    def term(self, name: str) -> Mask:
        """Return which elements belong to a function."""
        return np.asarray(self.terms == name)

    def piece(self, *pieces: str) -> Mask:
        """Return which elements belong to some pieces."""
        return np.array([element.piece in pieces for element in self.elements], dtype=np.bool_)

    def _plane(self, reference: Pieces) -> tuple[int, ...]:
        """Return which coordinates a kinematics in the plane means: those that it fits best."""
        for piece in ("F", "J"):
            for pieces in self._sampled.values():
                if piece in pieces and pieces[piece].shape[1] == 2:
                    pairs = [(0, 1), (0, 2), (1, 2)]
                    away = [np.abs(pieces[piece] - reference[piece][:, pair]).max() for pair in pairs]
                    return pairs[int(np.argmin(away))]
        return (0, 1, 2)

    def seen(self, pieces: Pieces) -> Pieces:
        """Return the pieces with the coordinates of the tool that the model has."""
        changed = dict(pieces)
        for piece in ("F", "J"):
            for own in self._sampled.values():
                if piece in own and piece in changed:
                    count = own[piece].shape[1]
                    rows = list(self.axes) if count == 2 else list(range(count))
                    changed[piece] = changed[piece][:, rows]
        return changed

    def _tolerances(self, reference: Pieces, sampled: Mapping[str, Sampled]) -> Array:
        """Return how far each element may be off."""
        weight = 9.81 * sum(body.mass for body in self.tree.bodies)
        reach = sum(float(np.linalg.norm(p)) for p in (*self.tree.positions, self.tree.tool_position))
        inertia = float(np.abs(reference["D"]).max())
        natural = {"D": inertia, "H": inertia, "B": inertia, "F": reach, "J": 1.0}
        natural |= dict.fromkeys(("G", "Z", "V"), 1e-3 * weight)
        condition = float(np.linalg.cond(reference["D"]).max())
        out = np.empty(len(self.elements))
        for column, element in enumerate(self.elements):
            whole = max(
                natural[element.piece], float(np.abs(reference.get(element.piece, np.zeros(1))).max())
            )
            size = max(float(np.abs(self.reference[:, column]).max()), SMALL * whole)
            out[column] = self.rtol * size + SAFETY * sampled[element.term].noise
            if element.term in ("inverse_dynamics", "kinetic_energy", "coriolis_torque", "coriolis_matrix"):
                # Differences of larger numbers.
                out[column] += 1e-14 * float(np.abs(sampled[element.term].values).max())
            elif element.term == "forward_dynamics":
                # A unit torque hardly moves a heavy arm: what is lost in its response, D enlarges twice.
                fastest = float(np.abs(sampled[element.term].values).max())
                rounding = max(1e-16, SAFETY * sampled[element.term].digits)
                lost = rounding * inertia * inertia * fastest * (1.0 if element.piece == "D" else fastest)
                out[column] += 1e-15 * condition * (whole + weight) + lost
        return out


def _indices(piece: str, array: Array) -> list[tuple[int, ...]]:
    """Return the indices of the elements of a piece; a symmetric D has one of each pair."""
    shape = array.shape[1:]
    if piece == "H":
        return [(i, j, k) for i, j, k in np.ndindex(*shape) if j <= k]
    if piece == "D":
        size = float(np.abs(array).max())
        if np.abs(array - np.swapaxes(array, -1, -2)).max() <= 1e-12 * size:
            return [(i, j) for i, j in np.ndindex(*shape) if i <= j]
    return list(np.ndindex(*shape))


def _column(array: Array, element: Element) -> Array:
    """Return the samples of an element; a product of two velocities stands twice in H."""
    column: Array = array[(slice(None), *element.place)]  # type: ignore[arg-type]
    twice = element.piece == "H" and element.place[1] != element.place[2]
    return 2.0 * column if twice else column
