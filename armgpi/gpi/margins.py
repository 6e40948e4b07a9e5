"""What one joint's loop tolerates: margins of L(s) = N(s) / (s^(m + 2) D(s)), from roots of polynomials.

The plant is the double integrator e'' = delta v; delta is by how much the nominal inertia is too large.
Continuous time, but for :func:`count_noise`. One joint at a time: numbers, not arrays.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.control.bandwidth import PHASE, default_bandwidth
from armgpi.gpi.family import PRINTED, Member, transfer_function
from armgpi.gpi.gains import Tuning
from armgpi.gpi.realisation import Bumpless

#: What the printed law tolerates of omega_c (1.5 dt + delay); see :func:`tolerated_phase`.
PRINTED_PHASE = 0.3564136508074215
#: Loops slower than this follow worse than by a tenth of a radian: gravity moves an arm as fast [rad/s].
SLOWEST_DEFAULT = 15.0
#: A root is real where its imaginary part is a smaller share of it.
_REAL = 1e-8
#: Powers of a loop's matrix that are smaller add nothing to a covariance.
_NO_POWER = 1e-40
#: Real numbers; NumPy makes no difference between its floats in what it does to polynomials.
Array = npt.NDArray[Any]


class Loop(NamedTuple):
    """An open loop L(s) = numerator / denominator that is stable when closed.

    Attributes:
        numerator: coefficients over s / omega, from the highest power down.
        denominator: coefficients over s / omega, from the highest power down.
        omega: the unit of frequency [rad/s].
    """

    numerator: Array
    denominator: Array
    omega: float


class Interval(NamedTuple):
    """An interval of delta, the factor by which the nominal inertia is too large [-].

    Attributes:
        lower: lower end.
        upper: upper end, infinite where nothing bounds it.
    """

    lower: float
    upper: float


class Margins(NamedTuple):
    """What the loops of all joints tolerate.

    Attributes:
        phase: least phase margin [rad].
        delay: least delay margin [s].
        delta: by which constant factors the nominal inertia may be too large.
    """

    phase: float
    delay: float
    delta: Interval


class Noise(NamedTuple):
    """What the counts of an encoder make of v, for white noise of 1 rad on each position.

    Attributes:
        at_once: the step of v after a step of the position by 1 rad [1/s^2].
        deviation: standard deviation of v [1/s^2].
        step: standard deviation of the difference between two samples of v [1/s^2].
    """

    at_once: float
    deviation: float
    step: float


def open_loop(tuning: Tuning, member: Member = PRINTED, delta: float = 1.0) -> Loop:
    """Return L(s) = delta C(s) / s^2 of one joint.

    Args:
        tuning: of the joint, numbers.
        member: of the family.
        delta: factor by which the nominal inertia is too large [-]; the other functions count from it.
    """
    return _loop(_coefficients(tuning, member).ravel(), member.integrators, delta)


def loops(tuning: Tuning, member: Member = PRINTED, delta: float = 1.0) -> list[Loop]:
    """Return the open loops of all joints, each of those that are alike once.

    Args:
        tuning: arrays that broadcast.
        member: of the family.
        delta: factor by which the nominal inertia is too large [-].
    """
    rows = _coefficients(tuning, member)
    listed = rows.reshape(-1, rows.shape[-1]).tolist()
    # Not np.unique: it imports masked arrays, which takes as long as Pinocchio.
    distinct = sorted(set(map(tuple, listed)))
    return [_loop(np.array(row), member.integrators, delta) for row in distinct]


def crossovers(loop: Loop) -> Array:
    """Return the frequencies where ``|L| = 1`` [rad/s]."""
    # |N|^2 = |D|^2, polynomials in the square of the frequency.
    difference = np.polyadd(_square(loop.denominator), -_square(loop.numerator))
    return loop.omega * np.sqrt(_positive(difference))


def phase_margin(loop: Loop) -> float:
    """Return the least phase lag that makes the loop oscillate [rad]."""
    w = crossovers(loop) / loop.omega
    return float(np.min(_phase(loop, w)))


def delay_margin(loop: Loop) -> float:
    """Return the least delay that makes the loop oscillate [s]."""
    w = crossovers(loop) / loop.omega
    return float(np.min(_phase(loop, w) / w)) / loop.omega


def delay_margins(tuning: Tuning, member: Member = PRINTED, delta: float = 1.0) -> Array:
    """Return :func:`delay_margin` of every joint [s]; zero where the loop is not stable.

    NaN where the poles are so far apart that floats do not tell.

    Args:
        tuning: arrays that broadcast.
        member: of the family.
        delta: factor by which the nominal inertia is too large.
    """
    with np.errstate(all="ignore"):
        rows = _coefficients(tuning, member)
        flat = rows.reshape(-1, rows.shape[-1]).tolist()
        margins = [_delay_margin(tuple(row), member.integrators, delta) for row in flat]
    return np.array(margins).reshape(rows.shape[:-1])


@lru_cache(maxsize=1024)  # joints and rollouts are often alike, and arms are asked for more than once
def _delay_margin(row: tuple[float, ...], integrators: int, delta: float) -> float:
    """Return the delay margin of one joint [s] from its coefficients."""
    loop = _loop(np.array(row), integrators, delta)
    try:
        return delay_margin(loop) if _stable(loop.denominator, loop.numerator) else 0.0
    except ValueError:  # no crossover is found, or roots of polynomials that are not finite
        return math.nan


def tolerated_phase(member: Member = PRINTED, delta: float = 1.0) -> float:
    """Return omega_c times delay [-] that the slowest joint of a member tolerates; zero where it is unstable.

    Args:
        member: of the family, with zeta_c = 1 and p_c = omega_c.
        delta: factor by which the nominal inertia is too large.
    """
    one = np.ones(1)
    return float(np.min(delay_margins(Tuning(one, one, one), member, delta)))


def default_omega(dt: float, delay: float = 0.0, highest: float = 30.0, member: Member = PRINTED) -> float:
    """Return a bandwidth omega_c [rad/s] that suits any robot without tuning.

    A hold of dt and the computation take 1.5 dt, transport takes `delay`; the printed controller tolerates
    0.356 / omega_c of them in all (zeta_c = 1, p_c = omega_c), of which this uses less than a third. It uses
    the same share of what another order tolerates. The cap keeps encoder steps from becoming torque noise.

    Args:
        dt: sample time [s].
        delay: transport delay in the loop [s].
        highest: cap [rad/s]; infinite for none.
        member: of the family.

    Raises:
        ParameterError: when a number is out of its range.
    """
    share = 1.0 if member.printed else tolerated_phase(member) / PRINTED_PHASE
    return default_bandwidth(dt, delay, highest, share * PHASE)


def worst_margins(tuning: Tuning, member: Member = PRINTED) -> Margins:
    """Return the least margins of all joints.

    Args:
        tuning: arrays that broadcast.
        member: of the family.
    """
    loops_of_joints = loops(tuning, member)
    phase = min(phase_margin(loop) for loop in loops_of_joints)
    delay = min(delay_margin(loop) for loop in loops_of_joints)
    intervals = [gain_interval(loop) for loop in loops_of_joints]
    lower = max(interval.lower for interval in intervals)
    upper = min(interval.upper for interval in intervals)
    return Margins(phase, delay, Interval(lower, upper))


def peak_sensitivity(loop: Loop) -> float:
    """Return the largest ``|1 / (1 + L)|``."""
    closed = np.polyadd(loop.denominator, loop.numerator)
    above, below = _square(loop.denominator), _square(closed)
    u = _stationary(above, below)
    squared = np.polyval(above, u) / np.polyval(below, u)  # |1 / (1 + L)|^2
    return math.sqrt(np.max(squared))


def gain_interval(loop: Loop, sigma: float = 0.0) -> Interval:
    """Return the constant delta around 1 that keep the loop stable.

    Args:
        loop: from :func:`open_loop`.
        sigma: rate [1/s] at which a quadratic Lyapunov function has to fall at least.

    Returns:
        The interval; an empty one (`upper` = `lower`) when the loop is not that fast at 1.
    """
    numerator, denominator = _shift_polynomials(loop, sigma)
    if not _stable(denominator, numerator):
        return Interval(1.0, 1.0)
    # A pole crosses the imaginary axis where L(j w) is real, at delta = -1 / L.
    squares = _positive(_cross(denominator, numerator)[1])
    s = 1j * np.sqrt(np.append(squares, 0.0))
    inverse = np.polyval(denominator, s) / np.polyval(numerator, s)
    critical = -inverse.real
    return Interval(
        float(max(critical[critical < 1.0], default=-math.inf)),
        float(min(critical[critical > 1.0], default=math.inf)),
    )


def sector(loop: Loop, lowest: float = 1.0, sigma: float = 0.0) -> Interval:
    """Return the delta that may change with time in any way, from `lowest` on (circle criterion).

    With G(j w) = 1 / L = X + j Y one quadratic Lyapunov function serves all of them if and only if
    (X + lower) (X + upper) + Y^2 > 0 at every frequency.

    Args:
        loop: from :func:`open_loop`.
        lowest: lower end of the interval.
        sigma: rate [1/s] at which the Lyapunov function has to fall at least.

    Returns:
        The interval; an empty one (`upper` = `lower`) when the loop is not that fast at its lower end.
    """
    numerator, denominator = _shift_polynomials(loop, sigma)
    if not _stable(denominator, lowest * numerator):
        return Interval(lowest, lowest)
    real = _cross(denominator, numerator)[0]
    above = -np.polyadd(_square(denominator), lowest * real)
    below = np.polyadd(real, lowest * _square(numerator))
    # upper < -(|G|^2 + lower X) / (X + lower) wherever X + lower < 0.
    u = _stationary(above, below)
    u = u[np.polyval(below, u) < 0.0]
    bounds = np.polyval(above, u) / np.polyval(below, u)
    return Interval(lowest, float(min(bounds, default=math.inf)))


def count_noise(tuning: Tuning, dt: float, member: Member = PRINTED) -> Noise:
    """Return what encoder counts make of v in the sampled loop at rest, exact for white noise.

    Args:
        tuning: of one joint.
        dt: sample time [s].
        member: of the family.
    """
    law = Bumpless(member)
    c = law.coefficients(tuning, dt)
    order = member.integrators + member.rolloff + 1
    size = order + 2  # position, velocity, the law's state
    # One sample from every unit state and from a unit of noise: columns of the loop's matrices.
    q, speed, *states = np.eye(size, size + 1)
    state = type(law.init(np.array(0.0), c))(*states)
    e = q + np.eye(size + 1)[-1]
    v = law.output(e, state, c)
    next_position = q + dt * speed + 0.5 * dt * dt * v
    next_speed = speed + dt * v
    next_state = law.update(e, v, None, state, c)
    rows = np.array([next_position, next_speed, *next_state])
    A = rows[:, :-1]
    B = rows[:, -1:]
    C = v[:-1]
    D = float(v[-1])
    if np.abs(np.linalg.eigvals(A)).max() >= 1.0:
        return Noise(abs(D), math.inf, math.inf)
    # Covariance of the state, the sum of A^k B B' A'^k: twice as many terms each time.
    P = B @ B.T
    power = A
    while np.abs(power).max() > _NO_POWER:
        P = P + power @ P @ power.T
        power = power @ power
    variance = float(C @ P @ C) + D * D
    covariance = float(C @ A @ P @ C) + D * float(C @ B[:, 0])  # of neighbouring samples
    return Noise(abs(D), math.sqrt(variance), math.sqrt(2.0 * (variance - covariance)))


def _coefficients(tuning: Tuning, member: Member) -> Array:
    """Return omega_c and, in units of it, the coefficients of N and D from the lowest power up: (..., k)."""
    omega = tuning.omega_c
    # At 30 rad/s the coefficients would spread over ten decades.
    unit = Tuning(np.ones_like(omega), tuning.zeta_c, tuning.p_c / omega)
    numerator, denominator = transfer_function(unit, member)
    return np.stack(np.broadcast_arrays(omega, *numerator, *denominator), axis=-1)


def _loop(row: Array, integrators: int, delta: float) -> Loop:
    """Return a loop from its coefficients."""
    omega, *coefficients = row
    count = integrators + 2  # coefficients of N; those of D follow, but for its leading 1
    numerator = coefficients[:count]
    denominator = coefficients[count:]
    zeros = [0.0] * count  # of s^integrators in C(s), and of s^2
    below = np.array([1.0, *reversed(denominator), *zeros])
    return Loop(delta * np.array(numerator[::-1]), below, float(omega))


def _phase(loop: Loop, w: Array) -> Array:
    """Return by how much L(j w) is ahead of -1, in [0, 2 pi)."""
    s = 1j * w
    value = np.polyval(loop.numerator, s) / np.polyval(loop.denominator, s)
    ahead = math.pi + np.angle(value)
    return np.asarray(ahead % (2.0 * math.pi))


def _parts(p: Array) -> tuple[Array, Array]:
    """Return even and odd part: p(j w) = even(w^2) + j w odd(w^2)."""
    low = np.append(p[::-1], 0.0)  # so that neither part is empty
    even = low[0::2]
    odd = low[1::2]
    signs = (-1.0) ** np.arange(len(low))
    even = even * signs[: len(even)]
    odd = odd * signs[: len(odd)]
    return even[::-1], odd[::-1]


def _cross(p: Array, q: Array) -> tuple[Array, Array]:
    """Return p(j w) conj(q(j w)) as real part and imaginary part / w, polynomials in w^2."""
    even_p, odd_p = _parts(p)
    even_q, odd_q = _parts(q)
    odd_squared = np.append(np.convolve(odd_p, odd_q), 0.0)  # times w^2
    real = np.polyadd(np.convolve(even_p, even_q), odd_squared)
    imaginary = np.polysub(np.convolve(odd_p, even_q), np.convolve(even_p, odd_q))
    return real, imaginary


def _square(p: Array) -> Array:
    """Return |p(j w)|^2 as a polynomial in w^2."""
    return _cross(p, p)[0]


def _product(p: Array, q: Array) -> Array:
    """Return the product of two polynomials, in the type that NumPy's stubs lose."""
    return np.asarray(np.polymul(p, q))


def _slope(p: Array) -> Array:
    """Return the derivative of a polynomial."""
    return p[:-1] * np.arange(len(p) - 1, 0, -1)


def _positive(p: Array) -> Array:
    """Return the positive real roots of a polynomial."""
    roots = np.roots(p)
    is_real = np.abs(roots.imag) < _REAL * np.abs(roots)
    return np.asarray(roots.real[is_real & (roots.real > 0.0)])


def _stationary(above: Array, below: Array) -> Array:
    """Return u = w^2 >= 0 among which above(u) / below(u) has its largest and smallest values."""
    # (a / b)' = (a' b - a b') / b^2.
    slope = _product(_slope(above), below) - _product(above, _slope(below))
    # Real parts of all roots: what is no stationary point is just one frequency more.
    u = np.roots(slope).real
    return np.array([*u[u > 0.0], 0.0, 1e9])


def _stable(denominator: Array, numerator: Array) -> bool:
    """Tell whether the closed loop decays."""
    poles = np.roots(np.polyadd(denominator, numerator))
    return bool(poles.real.max() < 0.0)


def _shift_polynomials(loop: Loop, sigma: float) -> tuple[Array, Array]:
    """Return numerator and denominator at s - sigma / 2: what decays faster than that decays there."""
    shifted = np.poly1d([1.0, -0.5 * sigma / loop.omega])
    numerator = np.poly1d(loop.numerator)(shifted)
    denominator = np.poly1d(loop.denominator)(shifted)
    return numerator.coeffs, denominator.coeffs
