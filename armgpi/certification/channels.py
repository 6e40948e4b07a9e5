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
    h = controller.dt
    n = controller.robot.n
    law = Bumpless(controller.member)
    gains = (np.broadcast_to(gain, (n,)) for gain in controller.gains.nominal())
    coefficients = law.coefficients(Tuning(*gains), h)
    none = np.zeros(n)
    one = np.ones(n)
    at_rest = law.init(none, coefficients)
    size = 2 + len(at_rest) + delay
    own = slice(2, 2 + len(at_rest))
    late = size - 1 if delay else 0  # which state is the error that the law has

    def states(values: Any) -> Array:
        """Return the states (n, m) of loops whose law has some, all others 0."""
        found = np.zeros((n, size))
        found[:, own] = np.stack(values, axis=-1)
        return found

    A = np.zeros((n, size, size))
    A[:, 0, 0] = 1.0
    A[:, 0, 1] = h
    A[:, 1, 1] = 1.0
    asked = []
    for j, name in enumerate(at_rest._fields):
        unit = at_rest._replace(**{name: one})
        A[:, :, 2 + j] = states(law.update(none, none, None, unit, coefficients))
        asked.append(law.output(none, unit, coefficients))
    measured = states(law.update(one, none, None, at_rest, coefficients))
    A[:, :, late] += measured
    for i in range(delay):
        before = size - delay + i - 1 if i else 0
        A[:, size - delay + i, before] = 1.0
    asks = states(asked)
    direct = law.output(one, at_rest, coefficients)
    asks[:, late] += direct
    push = np.zeros(size)
    push[:2] = 0.5 * h * h, h
    held = states(law.init(one, coefficients))
    not_integrated = Resting(one, one)
    integrated = states(law.update(none, none, None, at_rest, coefficients, not_integrated))
    return Loops(A, push, asks, measured, direct, held, integrated)


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
    h = controller.dt
    loops = sampled_loops(controller, delay)
    push = gain[:, None] * loops.push
    A = loops.open + push[:, :, None] * loops.asks[:, None, :]
    if np.abs(np.linalg.eigvals(A)).max() >= 1.0:
        return None
    n, size, _ = A.shape
    e_and_speed = np.broadcast_to(np.eye(2, size), (n, 2, size))  # an acceleration within a sample moves both
    measured = loops.measured + push * loops.direct[:, None]
    others = np.stack([measured, loops.held, loops.integrated], axis=1)
    inputs = np.concatenate([e_and_speed, others], axis=1)
    outputs = np.concatenate([e_and_speed, loops.asks[:, None]], axis=1)
    responses = _responses(A, inputs.swapaxes(1, 2), outputs, h)
    of_measured = responses.sums[..., 2]
    of_measured[:, 2] += np.abs(loops.direct)  # what is hidden now reaches the torque at once
    # Where all joints ask alike, the torques of a disturbance do not pass through D^ and D^-1.
    later = responses.later
    course = _swept(later[..., 0], later[..., 1], h)
    asked = later[:, 2]
    mean = asked.mean(axis=1, keepdims=True)
    beside = asked - mean
    alike = _swept(mean[..., 0], mean[..., 1], h)
    apart = _swept(beside[..., 0], beside[..., 1], h)
    passed = np.cumsum(course[:, 2], axis=0)
    is_nearly_all = (passed >= (1.0 - _FORGOTTEN) * passed[-1]).all(axis=1)
    last = int(np.argmax(is_nearly_all))
    within_memory = slice(last + 1)
    own = apart[within_memory].sum(axis=0) + responses.pushed[:, 2] - passed[last]
    return Channel(
        rest=responses.pushed.T,
        measured=of_measured.T,
        shift=responses.sums[..., 3].T,
        zone=responses.sums[..., 4].T,
        start=responses.peaks.T,
        course=course,
        shared=float(alike[within_memory].sum()),
        own=own,
        memory=h * (last + 1.0),
    )


class _Responses(NamedTuple):
    """Impulse responses of n loops: of e, e' and what is asked for.

    Attributes:
        pushed: their sums for an acceleration of at most 1, (n, 3).
        sums: sums of sizes after a unit of each input, (n, 3, inputs).
        peaks: largest sizes after a unit of input 3, (n, 3).
        later: outputs in each sample after a change of position and of speed, (samples, 3, n, 2).
    """

    pushed: Array
    sums: Array
    peaks: Array
    later: Array


def _responses(A: Array, inputs: Array, outputs: Array, h: float) -> _Responses:
    """Return sums and peaks of the impulse responses of loops.

    An acceleration z(t) in a sample, s before its end, moves the position by s and the speed by 1. So each
    later output moves by at most the integral of ``|a s + b|`` over the sample for ``|z| <= 1``.

    Args:
        A: the loops' states after a sample, (n, m, m).
        inputs: what a unit of each input does to the states, (n, m, inputs).
        outputs: rows by which outputs depend on the states, (n, 3, m).
        h: sample time [s].

    Raises:
        ParameterError: when a loop is so slow that its response has no end.
    """
    n, size, count = inputs.shape
    states = inputs.copy()
    rows = outputs.copy()  # by which outputs so many samples later depend on the states
    sums = np.zeros((n, 3, count))
    peaks = np.zeros((n, 3))
    weights = np.zeros((n, 3, size))
    every = []
    for k in range(_LONGEST):
        response = outputs @ states
        every.append(response[..., :2])
        sums += np.abs(response)
        peaks = np.maximum(peaks, np.abs(response[..., 3]))
        weights += np.abs(rows)
        states = A @ states
        rows = rows @ A
        if k % 64 != 63:
            continue
        power = np.linalg.matrix_power(A, k + 1)
        norm = np.abs(power).sum(axis=2).max(axis=1)
        if (norm < _SMALL).all():
            # All that comes later, as a geometric series of what has come.
            series = norm / (1.0 - norm)
            tail = weights.sum(axis=2)[..., None] * series[:, None, None]
            largest_inputs = np.abs(inputs).max(axis=1)[:, None, :]
            beyond = tail * largest_inputs
            outputs_later = np.array(every)
            swept = _swept(outputs_later[..., 0], outputs_later[..., 1], h)
            pushed = swept.sum(axis=0)
            pushed += h * (beyond[..., 0] + beyond[..., 1])
            return _Responses(pushed, sums + beyond, peaks, outputs_later.swapaxes(1, 2))
    raise ParameterError("controller", "its loop", "a loop of each joint that forgets within 200,000 samples")


def _swept(a: Array, b: Array, h: float) -> Array:
    """Return the integral of ``|a s + b|`` over s from 0 to h."""
    end = a * h + b
    slope = np.where(a == 0.0, 1.0, a)
    two_triangles = (b * b + end * end) / (2.0 * np.abs(slope))
    trapezoid = np.abs(0.5 * h * (b + end))
    changes_sign = b * end < 0.0
    return np.where(changes_sign, two_triangles, trapezoid)
