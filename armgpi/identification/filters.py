"""A Butterworth filter of the fourth order, forth and back: SciPy's takes a second to import."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from armgpi.base.arrays import Array

#: Angles of the poles of the two sections in the left half plane, from the real axis [rad].
_ANGLES = (math.pi / 8.0, 3.0 * math.pi / 8.0)


class Section(NamedTuple):
    """A section of the second order, y[k] = b0 x[k] + b1 x[k-1] + b2 x[k-2] - a1 y[k-1] - a2 y[k-2].

    Attributes:
        b: coefficients of the input, (3,).
        a: coefficients of the output before, (2,).
    """

    b: tuple[float, float, float]
    a: tuple[float, float]


def low_pass(cutoff: float, rate: float) -> tuple[Section, ...]:
    """Return the sections of a low-pass filter, by the bilinear transform; each passes a constant as it is.

    Args:
        cutoff: where it passes 1 / sqrt(2) [Hz], below half of the rate.
        rate: of the samples [Hz].
    """
    warped = math.tan(math.pi * cutoff / rate)
    sections = []
    for angle in _ANGLES:
        damping = 2.0 * math.cos(angle) * warped
        scale = 1.0 / (1.0 + damping + warped**2)
        gain = scale * warped**2
        first = 2.0 * scale * (warped**2 - 1.0)
        second = scale * (1.0 - damping + warped**2)
        sections.append(Section((gain, 2.0 * gain, gain), (first, second)))
    return tuple(sections)


def forth_and_back(sections: tuple[Section, ...], values: Array, pad: int) -> Array:
    """Return values (samples, n) filtered forth and back: nothing is late.

    They are continued at both ends by their point reflection. Each pass begins at rest at its first value.

    Args:
        sections: of the filter.
        values: (samples, n).
        pad: samples of the continuation, less than there are.
    """
    begin = 2.0 * values[:1] - values[pad:0:-1]
    end = 2.0 * values[-1:] - values[-2 : -pad - 2 : -1]
    longer = np.concatenate([begin, values, end])
    there = _filtered(sections, longer)
    back = _filtered(sections, there[::-1])[::-1]
    return back[pad : len(back) - pad]


def _filtered(sections: tuple[Section, ...], values: Array) -> Array:
    """Return values (samples, n) behind the filter, which was at rest at the first of them before."""
    filtered = values - values[:1]
    for section in sections:
        driven = section.b[0] * filtered
        driven[1:] += section.b[1] * filtered[:-1]
        driven[2:] += section.b[2] * filtered[:-2]
        bands = np.ones((3, len(values)))
        bands[1], bands[2] = section.a
        # The recursion forward, as the matrix is a unit lower triangle: a general solver would exchange rows.
        filtered, _ = lapack.dtbtrs(bands, driven, uplo="L", diag="U", overwrite_b=True)
    return np.asarray(filtered + values[:1])
