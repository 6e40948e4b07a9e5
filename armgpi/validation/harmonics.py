"""Functions of the configuration as formulas: a sum of few harmonics, found from samples.

Every entry of D, every coefficient of a product of velocities and every gravity torque of an arm is a
trigonometric polynomial of degree two in each angle and a polynomial of degree two in each sliding joint.
Few of its terms are there, so matching pursuit finds them from some dozens of configurations.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array

#: More terms than this are no explanation: nobody finds a mistake in them.
MOST_TERMS = 8
#: More joints than this make too many candidates: 5^n / 2 pairs of a cosine and a sine.
MOST_JOINTS = 4
#: Share of a coefficient that a model has -> what is wrong with it.
_USUAL_SHARES = {
    -1.0: "its sign",
    0.5: "a factor 2 is missing",
    2.0: "a factor 1/2 is missing",
}


class Harmonic(NamedTuple):
    """One term of a trigonometric sum.

    Attributes:
        factor: its coefficient.
        function: its function of the configuration, "cos(q2 + q3)", or "" for a constant.
    """

    factor: float
    function: str


def expand(
    q: Array,
    y: Array,
    prismatic: tuple[bool, ...],
    tolerance: float,
    joints: tuple[int, ...] | None = None,
) -> list[Harmonic] | None:
    """Return the few terms that make up `y` at the configurations `q`, None when there are too many.

    Args:
        q: configurations, shape (N, n).
        y: values, shape (N,).
        prismatic: whether each joint slides.
        tolerance: how exact the sum has to be.
        joints: those that it may depend on, from 0; all when not given.
    """
    chosen_joints = range(q.shape[1]) if joints is None else joints
    if len(chosen_joints) > MOST_JOINTS:
        return None
    if np.abs(y).max() <= tolerance:
        return []
    turning = [i for i in chosen_joints if not prismatic[i]]
    sliding = [i for i in chosen_joints if prismatic[i]]
    words, columns = _candidates(q, sliding, turning)
    sizes = np.linalg.norm(columns, axis=0)
    sizes[sizes == 0.0] = 1.0
    chosen: list[int] = []
    difference: Array = y
    weights: Array = np.zeros(0)
    # Two values more than terms, so that a sum that fits is not one that fits anything.
    while len(chosen) < min(MOST_TERMS, len(y) - 2):
        alignment = np.abs(difference @ columns) / sizes
        chosen.append(int(np.argmax(alignment)))
        solution, *_ = np.linalg.lstsq(columns[:, chosen], y, rcond=None)
        weights = np.asarray(solution, dtype=np.float64)
        difference = np.asarray(y - columns[:, chosen] @ weights)
        if np.abs(difference).max() <= tolerance:
            return _needed_terms([words[c] for c in chosen], weights)
    return None


def _candidates(q: Array, sliding: list[int], turning: list[int]) -> tuple[list[str], Array]:
    """Return the functions that a sum may have, and their values, (N, count)."""
    words = []
    columns = []
    waves = list(_waves(q, turning))
    for power, scale in _powers(q, sliding):
        for wave, values in waves:
            words.append(f"{power} {wave}".strip())
            columns.append(scale * values)
    return words, np.stack(columns, axis=-1)


def _needed_terms(words: Sequence[str], weights: Array) -> list[Harmonic]:
    """Return the terms of a sum without those that were chosen early and are not needed after all."""
    least = 1e-9 * np.abs(weights).max()
    terms = [Harmonic(float(weight), word) for weight, word in zip(weights, words, strict=True)]
    return [term for term in terms if abs(term.factor) > least]


def trigonometry(q: Array, difference: Array, prismatic: tuple[bool, ...], tolerance: float) -> list[str]:
    """Return which slips of trigonometry a difference may be, the positive ones first."""
    positive: list[str] = []
    negative: list[str] = []
    for text, shape in _slips(q, prismatic):
        share = float(difference @ shape) / float(shape @ shape)
        if np.abs(difference - share * shape).max() <= tolerance:
            slips = negative if share < 0.0 else positive
            slips.append(f"{text} (times {share:.6g})")
    return [*positive, *negative]


def slip(
    q: Array,
    mine: Array,
    theirs: Array,
    prismatic: tuple[bool, ...],
    tolerance: float,
) -> str | None:
    """Return which one term of a sum is wrong, None when it is more than one.

    Args:
        q: configurations, shape (N, n).
        mine: values of the model, shape (N,).
        theirs: those of the robot.
        prismatic: whether each joint slides.
        tolerance: how exact the sum has to be, in the unit of the values.
    """
    sums: list[dict[str, float]] = []
    for values in (mine - theirs, theirs, mine):
        terms = expand(q, values, prismatic, tolerance)
        if terms is None:
            return None
        sums.append({term.function: term.factor for term in terms})
    difference, right, wrong = sums
    if len(difference) == 1:
        (word,) = difference
        return _wrong_term(word, wrong.get(word), right.get(word))
    # One term taken away and the same added elsewhere: its function is wrong.
    if len(difference) == 2:
        return _wrong_function(difference, right)
    return None


def _wrong_function(difference: Mapping[str, float], right: Mapping[str, float]) -> str | None:
    """Return which function should be which one; None where the two terms are not of the same size."""
    (first, a), (second, b) = difference.items()
    if abs(a + b) > 1e-7 * abs(a):
        return None
    is_first_missing = a * right.get(first, 0.0) < 0.0
    belongs, stands = (first, second) if is_first_missing else (second, first)
    if belongs not in right:
        return None
    return f"{stands or 'a constant'} should be {belongs or 'a constant'}"


def _wrong_term(word: str, mine: float | None, right: float | None) -> str:
    """Return what is wrong with one term of a sum, from its coefficients in the model and in the robot."""
    if right is None:
        return f"the term {formula([Harmonic(mine or 0.0, word)])} is too much"
    if mine is None:
        return f"the term {formula([Harmonic(right, word)])} is missing"
    name = f"coefficient of {word}" if word else "constant"
    text = f"the {name} is {mine:.6g}, the robot's is {right:.6g}"
    for share, cause in _USUAL_SHARES.items():
        if abs(mine / right - share) < 1e-7:
            return f"{text}: {cause}"
    return text


def _slips(q: Array, prismatic: tuple[bool, ...]) -> Iterator[tuple[str, Array]]:
    """Yield usual slips of trigonometry and what they add, up to a factor."""
    turning = [i for i, slides in enumerate(prismatic) if not slides]
    angles = {f"q{i + 1}": q[:, i] for i in turning}
    for i, j in itertools.combinations(turning, 2):
        angles[f"(q{i + 1} + q{j + 1})"] = q[:, i] + q[:, j]
    for x, value in angles.items():
        c, s = np.cos(value), np.sin(value)
        yield f"(1 - sin {x})² replaces 1 - sin² {x} = cos² {x}", (1.0 - s) ** 2 - c**2
        yield f"(1 + sin {x})² replaces 1 - sin² {x} = cos² {x}", (1.0 + s) ** 2 - c**2
        yield f"(1 - cos {x})² replaces 1 - cos² {x} = sin² {x}", (1.0 - c) ** 2 - s**2
        yield f"sin {x} replaces sin² {x}", s - s**2
        yield f"cos {x} replaces cos² {x}", c - c**2
        yield f"sin² {x} replaces sin {x}", s**2 - s
        yield f"cos² {x} replaces cos {x}", c**2 - c
        yield f"sin(2 {x}) replaces 2 sin {x}", np.sin(2.0 * value) - 2.0 * s
        yield f"cos² {x} should be sin² {x}", c**2 - s**2
        yield f"sin² {x} should be cos² {x}", s**2 - c**2
        yield f"{x} replaces sin {x} (small angles)", value - s
        yield f"1 replaces cos {x} (small angles)", 1.0 - c
        yield f"1 - {x}²/2 replaces cos {x} (small angles)", 1.0 - 0.5 * value**2 - c


def formula(terms: list[Harmonic]) -> str:
    """Return a sum as text: "0.17 - 0.34 sin(q2)"."""
    ordered = sorted(terms, key=lambda term: (len(term.function), term.function))
    texts = [(factor, f"{abs(factor):.6g} {function}".strip()) for factor, function in ordered]
    return _sum(texts) or "0"


def _sum(terms: Iterable[tuple[float, str]]) -> str:
    """Return terms with their signs as a sum: "-a + b"."""
    text = " ".join(f"{'-' if sign < 0.0 else '+'} {term}" for sign, term in terms)
    return re.sub(r"^\+ |(?<=^-) ", "", text)


def code(text: str) -> str:
    """Return what :func:`formula` gave as an expression of Python."""
    return re.sub(r"(?<=[\w)]) (?=\w)", "*", text.replace("²", "**2"))


def _powers(q: Array, sliding: list[int]) -> Iterator[tuple[str, Array]]:
    """Yield the products of sliding positions: D is of degree two in all lengths together."""
    for powers in itertools.product(range(3), repeat=len(sliding)):
        if sum(powers) > 2:
            continue
        texts, columns = [], []
        for i, power in zip(sliding, powers, strict=True):
            columns.append(q[:, i] ** power)
            if power:
                texts.append(f"q{i + 1}" if power == 1 else f"q{i + 1}²")
        yield " ".join(texts), np.prod(columns, axis=0)


def _waves(q: Array, turning: list[int]) -> Iterator[tuple[str, Array]]:
    """Yield cosines and sines of multiples of the angles, and "", 1 for the cosine of nothing."""
    for multiples in itertools.product(range(-2, 3), repeat=len(turning)):
        leading = next(filter(None, multiples), 0)
        if leading < 0:
            continue  # the same as its opposite, up to a sign
        angle = q[:, turning] @ np.array(multiples, dtype=float)
        if leading == 0:
            yield "", np.cos(angle)
            continue
        text = _angle_text(turning, multiples)
        yield f"cos({text})", np.cos(angle)
        yield f"sin({text})", np.sin(angle)


def _angle_text(joints: Sequence[int], multiples: Sequence[int]) -> str:
    """Return a sum of angles: "q1 - 2 q3"."""
    terms = []
    for joint, multiple in zip(joints, multiples, strict=True):
        if multiple:
            factor = "" if abs(multiple) == 1 else f"{abs(multiple)} "
            terms.append((multiple, f"{factor}q{joint + 1}"))
    return _sum(terms)
