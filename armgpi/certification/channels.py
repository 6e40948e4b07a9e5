"""What the sampled loops of joints make of bounded inputs at most: L1 norms of their impulse responses."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.errors import ParameterError
from armgpi.gpi.gains import Tuning
from armgpi.gpi.law import GPI
from armgpi.gpi.realisation import Bumpless, Resting

#: Samples of a response at most, and norm of the loop's power at which its tail is a geometric series.
_LONGEST, _SMALL = 200_000, 1e-6
#: Share of a response that comes after its memory.
_FORGOTTEN = 0.01


class Channel(NamedTuple):
    """What a joint's loop makes of inputs at most: of error, its speed, and what the law asks for.

    Attributes:
        rest: per unit of an acceleration arbitrary in time [s^2, s, -], shape (3, n).
        measured: per unit of a bounded error of measurement [-, 1/s, 1/s^2], shape (3, n).
        shift: per unit by which what holds the arm changes in each sample [s^2, s, -], shape (3, n).
        zone: per unit of an error that is not integrated [-, 1/s, 1/s^2], shape (3, n).
        start: per unit of an acceleration by which the first torque is wrong [s^2, s, -], shape (3, n).
        course: what `rest` is the sum of: per unit of an acceleration in one sample, so many samples later,
            (samples, 3, n).
        shared: what is asked for per unit of `rest`, within the memory, by the mean of all joints' loops [-].
        own: what a joint's loop asks for besides, or later [-], shape (n,).
        memory: for how long [s].
    """

    rest: Array
    measured: Array
    shift: Array
    zone: Array
    start: Array
    course: Array
    shared: float
    own: Array
    memory: float


class Loops(NamedTuple):
    """The joints' sampled loops but for the acceleration that they ask for.

    Their states are e, e', those of the law, and the errors of the last samples.

    Attributes:
        open: states after a sample without any acceleration, shape (n, m, m).
        push: states after a sample of an acceleration of 1, (m,).
        asks: what the law asks for, (n, m).
        measured: what an error of measurement does to the states, (n, m).
        direct: what it does to what is asked for, (n,).
        held: the states of a law that asks for -1 at rest, (n, m).
        integrated: what an error does to the integrators alone, (n, m).
    """

    open: Array
    push: Array
    asks: Array
    measured: Array
    direct: Array
    held: Array
    integrated: Array


def sampled_loops(controller: GPI, delay: int) -> Loops:
    """Return the loops of a controller whose measurements are late by some samples."""
    h, n = controller.dt, controller.robot.n
    law = Bumpless(controller.member)
    c = law.coefficients(Tuning(*(np.broadcast_to(x, (n,)) for x in controller.gains.nominal())), h)
    none, one = np.zeros(n), np.ones(n)
    rest = law.init(none, c)
    units = [rest._replace(**{name: one}) for name in rest._fields]
    size = 2 + len(rest) + delay
    own, late = slice(2, 2 + len(rest)), size - 1 if delay else 0

    def states(values: Any) -> Array:
        x = np.zeros((n, size))
        x[:, own] = np.stack(values, axis=-1)
        return x

    A = np.zeros((n, size, size))
    A[:, 0, 0] = A[:, 1, 1] = 1.0
    A[:, 0, 1] = h
    for j, unit in enumerate(units):
        A[:, :, 2 + j] = states(law.update(none, none, None, unit, c))
    measured = states(law.update(one, none, None, rest, c))
    A[:, :, late] += measured
    for i in range(delay):
        A[:, size - delay + i, size - delay + i - 1 if i else 0] = 1.0
    asks, direct = states([law.output(none, unit, c) for unit in units]), law.output(one, rest, c)
    asks[:, late] += direct
    push = np.zeros(size)
    push[:2] = 0.5 * h * h, h
    integrated = states(law.update(none, none, None, rest, c, Resting(one, one)))
    return Loops(A, push, asks, measured, direct, states(law.init(one, c)), integrated)


def channel(controller: GPI, delay: int, gain: Array) -> Channel | None:
    """Return what the sampled loops of all joints, ``e'' = gain u``, make of bounded inputs at most.

    Args:
        controller: whose law it is.
        delay: samples by which measurements are late.
        gain: of each joint's loop, (n,).

    Returns:
        The sums; None where a loop is unstable.

    Raises:
        ParameterError: when a loop is so slow that its response has no end.
    """
    loops = sampled_loops(controller, delay)
    push = gain[:, None] * loops.push
    A = loops.open + push[:, :, None] * loops.asks[:, None, :]
    if np.abs(np.linalg.eigvals(A)).max() >= 1.0:
        return None
    units = np.broadcast_to(np.eye(2, A.shape[1]), (len(A), 2, A.shape[1]))  # an acceleration within a sample
    measured = loops.measured + push * loops.direct[:, None]
    inputs = np.concatenate([units, np.stack([measured, loops.held, loops.integrated], axis=1)], axis=1)
    outputs = np.concatenate([units, loops.asks[:, None]], axis=1)
    h = controller.dt
    pushed, sums, peaks, later = _responses(A, inputs.swapaxes(1, 2), outputs, h)
    count = sums[..., 2]
    count[:, 2] += np.abs(loops.direct)  # what is hidden now reaches the torque at once
    each = [np.moveaxis(x, 1, 0) for x in (pushed, count, sums[..., 3], sums[..., 4], peaks)]
    # Where all joints ask alike, the torques of a disturbance do not pass through D^ and D^-1.
    course = _swept(later[..., 0], later[..., 1], h)
    asked = later[:, 2]
    mean = asked.mean(axis=1, keepdims=True)
    alike, apart = (_swept(x[..., 0], x[..., 1], h) for x in (mean, asked - mean))
    passed = np.cumsum(course[:, 2], axis=0)
    last = int(np.argmax((passed >= (1.0 - _FORGOTTEN) * passed[-1]).all(axis=1)))
    own = apart[: last + 1].sum(axis=0) + pushed[:, 2] - passed[last]
    rest, seen, shift, zone, start = each
    shared = float(alike[: last + 1].sum())
    return Channel(rest, seen, shift, zone, start, course, shared, own, h * (last + 1.0))


def _responses(A: Array, inputs: Array, outputs: Array, h: float) -> tuple[Array, Array, Array, Array]:
    """Return sums and peaks of impulse responses: for accelerations, for inputs 2 to 4, peaks of input 3.

    And the outputs in each sample after a change of position and of speed, (samples, 3, n, 2).

    An acceleration z(t) in a sample, s before its end, moves the position by s and the speed by 1. So each
    later output moves by at most the integral of ``|a s + b|`` over the sample for ``|z| <= 1``.
    """
    n, size, _ = A.shape
    x = inputs.copy()
    sums, peaks = np.zeros((n, 3, inputs.shape[2])), np.zeros((n, 3))
    power = np.broadcast_to(np.eye(size), (n, size, size))
    weights, rows = np.zeros((n, 3, size)), outputs.copy()
    every = []
    for k in range(_LONGEST):
        y = outputs @ x
        every.append(y[..., :2])
        sums += np.abs(y)
        peaks = np.maximum(peaks, np.abs(y[..., 3]))
        weights += np.abs(rows)
        x, rows = A @ x, rows @ A
        if k % 64 == 63:
            power = np.linalg.matrix_power(A, k + 1)
            norm = np.abs(power).sum(axis=2).max(axis=1)
            if (norm < _SMALL).all():
                # All that comes later, as a geometric series of what has come.
                tail = weights.sum(axis=2)[..., None] * (norm / (1.0 - norm))[:, None, None]
                ends = np.abs(inputs).max(axis=1)[:, None, :]
                later = tail * ends
                outputs_later = np.array(every)
                pushed = _swept(outputs_later[..., 0], outputs_later[..., 1], h).sum(axis=0)
                pushed += h * (later[..., 0] + later[..., 1])
                return pushed, sums + later, peaks, outputs_later.swapaxes(1, 2)
    raise ParameterError("controller", "its loop", "a loop of each joint that forgets within 200,000 samples")


def _swept(a: Array, b: Array, h: float) -> Array:
    """Return the integral of ``|a s + b|`` over s from 0 to h."""
    end = a * h + b
    steep = np.where(a == 0.0, 1.0, a)
    crossing = (b * b + end * end) / (2.0 * np.abs(steep))
    return np.where(b * end < 0.0, crossing, np.abs(0.5 * h * (b + end)))
