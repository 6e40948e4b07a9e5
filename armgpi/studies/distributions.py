"""What a number of a sweep is drawn from."""

from __future__ import annotations

import hashlib
import math
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc

from armgpi.base.arrays import Array
from armgpi.base.parameter import Parameter
from armgpi.config.section import Section
from armgpi.errors import ParameterError

#: Kinds of distributions, by their names in experiment files.
KINDS = ("uniform", "log_uniform", "normal", "choices", "factor")
#: How chunks draw: every number by itself, or points that fill the space evenly (Sobol 1967, scrambled).
SAMPLINGS = ("random", "sobol")
#: A normal distribution ends so many standard deviations from its mean: beyond are 6 in 100,000.
_TAILS = 4.0
#: Widest range of which all whole numbers are taken.
_MOST_WHOLE = 1000
#: SciPy has Sobol points of no more dimensions.
_MOST_DIMENSIONS = 21201


class Distribution(NamedTuple):
    """A distribution of one number.

    Attributes:
        kind: one of :data:`KINDS`.
        numbers: lower and upper end, mean and standard deviation, the choices, or the largest factor.
        joints: how many numbers are drawn for a rollout: one, or one for every joint.
        nominal: what a factor multiplies: one value, or one for every joint.
    """

    kind: str
    numbers: tuple[float, ...]
    joints: int = 1
    nominal: tuple[float, ...] = (1.0,)

    @property
    def ends(self) -> tuple[float, float]:
        """The lowest and the highest number that can be drawn."""
        if self.kind == "normal":
            mean, deviation = self.numbers
            return mean - _TAILS * deviation, mean + _TAILS * deviation
        if self.kind == "factor":
            (factor,) = self.numbers
            return min(self.nominal) / factor, max(self.nominal) * factor
        return min(self.numbers), max(self.numbers)

    def of(self, u: Array) -> Array:
        """Return the numbers of which a share `u` (0 to 1) of the distribution is below."""
        if self.kind == "choices":
            count = len(self.numbers)
            places = np.minimum((u * count).astype(int), count - 1)
            return np.asarray(np.array(self.numbers)[places])
        if self.kind == "factor":
            (factor,) = self.numbers
            power = 2.0 * u - 1.0
            return np.asarray(np.array(self.nominal) * factor**power)
        low, high = self.numbers
        if self.kind == "uniform":
            return np.asarray(low + (high - low) * u)
        if self.kind == "log_uniform":
            span = math.log(high) - math.log(low)
            return np.asarray(np.exp(math.log(low) + span * u))
        mean, deviation = self.numbers
        lowest, highest = self.ends
        return np.asarray(np.clip(mean + deviation * ndtri(u), lowest, highest))


def distribution(
    name: str, given: Section, declared: Parameter, joints: int, value: Any = None
) -> Distribution:
    """Return the distribution that an experiment file gives a parameter.

    Args:
        name: of the parameter.
        given: the section: one of :data:`KINDS`, and `each`; with none of them the declared range.
        declared: the parameter.
        joints: number of joints.
        value: what the parameter is in the experiment, which a factor multiplies.

    Raises:
        ParameterError: when it is none, or leaves the parameter's bounds.
    """
    kind, numbers = _kind_and_numbers(name, given, declared, value)
    if declared.kind == "integer" and kind == "uniform":
        lowest, highest = numbers[0], numbers[-1]
        if 0.0 <= highest - lowest <= _MOST_WHOLE:
            kind = "choices"
            numbers = tuple(range(math.ceil(lowest), math.floor(highest) + 1))
    if kind != "choices":
        _check_numbers(name, kind, numbers)
    if given.each == "joint" and not declared.per_joint:
        raise ParameterError(
            name, "each: joint", "one value for each rollout; it cannot differ between joints"
        )
    drawn = joints if given.each == "joint" else 1
    nominal = _nominal(name, value, drawn) if kind == "factor" else (1.0,)
    checked = Distribution(kind, numbers, drawn, nominal)
    _check_bounds(name, checked, declared)
    return checked


def _kind_and_numbers(
    name: str, given: Section, declared: Parameter, value: Any
) -> tuple[str, tuple[float, ...]]:
    """Return which distribution a section gives, and its numbers; with none the declared range."""
    known = {}
    for kind in KINDS:
        numbers = getattr(given, kind)
        if numbers is not None:
            known[kind] = (numbers,) if kind == "factor" else tuple(numbers)
    if not known:
        ends = declared.range(value)
        if ends is None:
            raise ParameterError(name, value, "a distribution, such as {uniform: [1, 2]}")
        by_factors = declared.log and ends[0] > 0.0
        return "log_uniform" if by_factors else "uniform", ends
    if len(known) != 1:
        raise ParameterError(name, ", ".join(known), f"one of {', '.join(KINDS)}")
    return next(iter(known.items()))


def _nominal(name: str, value: Any, drawn: int) -> tuple[float, ...]:
    """Return the values that a factor multiplies, one for each number that is drawn.

    Raises:
        ParameterError: where there is none, or one is not positive; where joints have different values and
            share a factor.
    """
    if value is None:
        expected = "a value (of all joints, where it is one of each) to multiply by the factor"
        raise ParameterError(name, None, f"{expected}; or {{log_uniform: [1, 2]}}")
    values = np.ravel(np.asarray(value, dtype=np.float64))
    if not (values > 0.0).all():
        raise ParameterError(name, float(values.min()), "a positive value to multiply by the factor")
    if drawn == 1 and len(set(values.tolist())) > 1:
        raise ParameterError(name, "a factor", "`each: joint` as well, since its joints have other values")
    if drawn == 1:
        values = values[:1]
    return tuple(np.broadcast_to(values, (drawn,)).tolist())


def _check_numbers(name: str, kind: str, numbers: tuple[float, ...]) -> None:
    """Refuse numbers that a distribution between two ends, a normal one or a factor cannot have."""
    if kind == "factor":
        if numbers[0] < 1.0:
            raise ParameterError(name, numbers[0], "a factor of at least 1: from 1/factor to factor times")
        return
    if len(numbers) != 2:
        raise ParameterError(name, numbers, "two numbers")
    if kind == "normal":
        if numbers[1] <= 0.0:
            raise ParameterError(name, numbers, "[mean, standard deviation], the second positive")
    elif numbers[0] > numbers[1]:
        raise ParameterError(name, numbers, "[lowest, highest]")
    elif kind == "log_uniform" and numbers[0] <= 0.0:
        raise ParameterError(name, numbers, "positive numbers for log_uniform")


def _check_bounds(name: str, found: Distribution, declared: Parameter) -> None:
    """Refuse a distribution that leaves the bounds of its parameter."""
    values = np.array(found.numbers if found.kind == "choices" else found.ends)
    # Bounds alone: whole numbers are a matter of the choices.
    inside = declared.inside(values)
    if declared.kind == "integer" and found.kind != "choices":
        raise ParameterError(name, found.kind, "choices, or a range of at most 1000: it is a whole number")
    if not inside.all():
        wrong = float(values[~inside][0])
        tails = f" ({_TAILS:g} standard deviations from the mean)" if found.kind == "normal" else ""
        raise ParameterError(name, wrong, f"{declared.bounds}; the distribution reaches {wrong:g}{tails}")


def shares(sampling: str, seed: int, first: int, rows: int, names: Sequence[str]) -> Array:
    """Return points in the unit cube for some rollouts, a pure function of the arguments.

    What a number of a rollout is depends on the seed, the rollout and the number's own name: other arms,
    versions and further numbers that vary meet the same draws. Sobol points belong together: theirs depend
    on all names.

    Args:
        sampling: one of :data:`SAMPLINGS`.
        seed: of the study.
        first: place of the first rollout among all, a multiple of 4 as the sizes of chunks are.
        rows: number of rollouts.
        names: of the numbers of a rollout.

    Returns:
        Shape (rows, numbers), inside (0, 1).

    Raises:
        ParameterError: when there are no Sobol points of so many dimensions.
    """
    if not names:
        return np.empty((rows, 0))
    if sampling == "random":
        # A counter-based generator, which makes four numbers a count: rollout i does not need those before.
        columns = []
        for name in names:
            generator = np.random.Philox(key=draw_key(seed, name), counter=first // 4)
            columns.append(np.random.Generator(generator).random(rows))
        points = np.column_stack(columns)
    else:
        if len(names) > _MOST_DIMENSIONS:
            raise ParameterError(
                "sampling", sampling, f"random: Sobol points have {_MOST_DIMENSIONS} dimensions"
            )
        random = np.random.default_rng(draw_key(seed, *names))
        sobol = qmc.Sobol(len(names), scramble=True, seed=random)
        if first:  # SciPy has no way of going nowhere
            sobol.fast_forward(first)
        with warnings.catch_warnings():  # that a part of 2^k points is less even: it is a part of them
            warnings.simplefilter("ignore", UserWarning)
            points = sobol.random(rows)
    return np.asarray(np.maximum(points, 2.0**-53))  # they are below 1 already


def draw_key(seed: int, *names: str) -> int:
    """Return the key of random numbers with some names, 128 bits."""
    text = "\0".join([str(seed), *names])
    return int(hashlib.sha256(text.encode()).hexdigest()[:32], 16)
