"""The filter of the weak form against SciPy's, and against its closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from armgpi.identification.filters import forth_and_back, low_pass


@pytest.mark.parametrize(("cutoff", "rate"), [(30.0, 1000.0), (30.0, 200.0), (8.0, 40.0), (0.5, 2000.0)])
def test_it_is_the_filter_of_scipy(cutoff: float, rate: float) -> None:
    rng = np.random.default_rng(3)
    values = np.cumsum(rng.normal(size=(700, 4)), axis=0) + 100.0 * rng.normal(size=4)
    ours = forth_and_back(low_pass(cutoff, rate), values, 150)
    theirs = signal.sosfiltfilt(signal.butter(4, cutoff, fs=rate, output="sos"), values, axis=0, padlen=150)
    assert ours.shape == values.shape
    assert np.abs(ours - theirs).max() < 1e-8 * np.abs(values).max()


def test_a_constant_and_a_line_pass_as_they_are() -> None:
    t = np.arange(600)[:, None] * np.array([[0.0, 0.01, -2.0]]) + np.array([[3.0, 0.0, 7.0]])
    assert forth_and_back(low_pass(30.0, 500.0), t, 500) == pytest.approx(t, abs=1e-9)


def test_a_sine_passes_by_the_square_of_the_gain_and_is_not_late() -> None:
    """Forth and back: 1 / (1 + (tan(pi f / r) / tan(pi c / r))^8), the square of the gain of four poles."""
    rate, cutoff, frequency = 1000.0, 30.0, 34.0
    t = np.arange(0.0, 4.0, 1.0 / rate)
    wave = np.sin(2.0 * np.pi * frequency * t)
    found = forth_and_back(low_pass(cutoff, rate), wave[:, None], 900)[:, 0]
    ratio = np.tan(np.pi * frequency / rate) / np.tan(np.pi * cutoff / rate)
    middle = slice(1000, 3000)
    assert found[middle] == pytest.approx(wave[middle] / (1.0 + ratio**8), abs=1e-6)
