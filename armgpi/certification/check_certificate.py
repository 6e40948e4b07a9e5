"""Check certificates of armgpi in exact arithmetic, with the standard library alone.

    python check_certificate.py FILE...

From the numbers of an arm it works out what a sample adds, verifies the matrix inequality, and from its
solution every bound that is claimed; docs/proof.md says why they follow. It prints what it verified. Whether
the numbers are those of the arm is not its business: a seal shows slips, not fraud.

How to read it: :func:`coefficients` and :func:`loop` are the controller, :func:`sample` is "One sample" of
docs/proof.md, :func:`inequality` and :func:`holds` are "The matrix inequality", :func:`bounds` is "What is
claimed". What follows after them reads a file and prints. Brackets refer to docs/proof.md: [P5] is its
equation P5, [What is claimed] a section of it. All numbers are rationals; where a root or an exponential is
needed, something larger is taken.
"""

import hashlib
import json
import os
import re
import stat
import sys
from fractions import Fraction
from functools import lru_cache
from math import comb, isqrt
from typing import NamedTuple

FORMAT = "armgpi certificate 2"
#: Most bytes of a file.
BYTES = 2_000_000
#: Most joints of an arm.
JOINTS = 64
#: Most bandwidths times the third power of the inequality's size: what a check may cost.
WORK = 20_000_000
#: A number in a file: a decimal text of bounded length.
NUMBER = re.compile(r"-?[0-9]{1,40}(\.[0-9]{1,60})?(e[+-]?[0-9]{1,3})?")
#: Whole numbers of the law, and their ends.
WHOLE = {"integrators": (1, 3), "rolloff": (0, 2), "delay": (0, 20)}
#: Other numbers of the law; from `zeta` on they are its poles.
LAW = ("sample_time", "rate", "zeta", "pole_ratio", "rolloff_ratio", "second_ratio", "second_zeta")
#: Numbers of the arm that are one number each.
SINGLE = ("delta_low", "delta_high", "sigma", "kappa_v", "kappa_e", "kappa_g", "kappa_f", "sigma_error")
#: Numbers of the arm, and how deep their lists are: 1 for a number for each joint.
NUMBERS = dict.fromkeys((*SINGLE, "kappa_error", "jump", "count_time"), 0)
NUMBERS.update(inverse=1, hold=1, reach=1)
#: Limits, a number for each joint.
LIMITS = ("effort", "lower", "upper", "radius", "speed", "velocity", "acceleration")
#: Of these alone ends may be negative.
SIGNED = ("lower", "upper")
#: Sizes of what acts on the arm, for each claim.
INPUTS = ("torque", "shift", "count", "reference", "zone", "spread")
CLAIMS = {
    "gain": "an error per torque with the reference at rest, once settled",
    "stated": "the errors under all that was stated, once settled",
    "start": "the same from a start with the torque that holds the arm with another load of the range",
    "jump": "the same after the load jumped once, at any time",
}
SECTIONS = {"format", "robot", "assumptions", "limits", "law", "numbers", "status", "inputs", "shares"}
#: Numbers of a solution besides P and alpha: multipliers t of what a sample adds, and a of the inputs.
MULTIPLIERS = {"t": 6, "a": 5}
#: Matrices are rounded to whole multiples of 1 / SCALE before they are factored.
SCALE = 2**128
#: Roots are rounded up to whole multiples of 1 / ROOT_SCALE.
ROOT_SCALE = 2**80


class Refused(ValueError):
    """What a file says is no certificate."""


#: What reading a file of any content may end in.
ERRORS = Refused, OSError, AttributeError, LookupError, TypeError, ValueError, ArithmeticError, RecursionError


# ---- Polynomials and matrices ----


def times(p, q):
    """Return the product of two polynomials, lists of coefficients from the constant one on."""
    product = [0] * (len(p) + len(q) - 1)
    for i, x in enumerate(p):
        for j, y in enumerate(q):
            product[i + j] += x * y
    return product


def plus(p, q):
    """Return the sum of two polynomials."""
    size = max(len(p), len(q))
    p = p + [0] * (size - len(p))
    q = q + [0] * (size - len(q))
    return [x + y for x, y in zip(p, q)]


def value(p, x):
    """Return the value of a polynomial at x."""
    return sum(coefficient * x**power for power, coefficient in enumerate(p))


def transposed(matrix):
    """Return the transpose of a matrix, which is a list of rows."""
    return [list(column) for column in zip(*matrix)]


def matrix_product(left, right):
    """Return the product of two matrices."""
    columns = transposed(right)
    return [[sum(x * y for x, y in zip(row, column)) for column in columns] for row in left]


def growth(x):
    """Return at least e^x for x below 1, and 0 beyond, which no check accepts.

    The series of e^-x is below it after a negative term, so its inverse is above e^x.
    """
    return 1 / (1 - x + x * x / 2 - x**3 / 6) if x < 1 else 0


def root(x):
    """Return at least the square root of x."""
    return Fraction(isqrt(int(x * ROOT_SCALE**2)) + 1, ROOT_SCALE)


def pivots(matrix):
    """Return the pivots (L D L^T) of a symmetric matrix until one is not positive.

    All are positive only if the matrix is positive definite: what is factored is the matrix rounded, and made
    less by more than the rounding. An entry is rounded by less than 1 / SCALE, a row of n entries by less
    than n / SCALE, so 2 n / SCALE from the diagonal outweighs it (Gershgorin).
    """
    size = len(matrix)
    rounded = []
    for i, row in enumerate(matrix):
        numerators = [int(entry * SCALE) for entry in row]
        numerators[i] -= 2 * size
        rounded.append([Fraction(numerator, SCALE) for numerator in numerators])
    found = [rounded[0][0]]
    while found[-1] > 0 and len(rounded) > 1:
        first, pivot = rounded[0], found[-1]
        remaining = []
        for row in rounded[1:]:
            factor = row[0] / pivot
            remaining.append([x - factor * y for x, y in zip(row[1:], first[1:])])
        rounded = remaining
        found.append(rounded[0][0])
    return found


def is_positive_definite(matrix):
    """Tell whether a symmetric matrix is positive definite, surely where the answer is yes."""
    return min(pivots(matrix)) > 0


# ---- The controller ----


def trapezoidal(f):
    """Return f_0 / s^k + ... + f_(k - 1) / s by the trapezoidal rule, as polynomials in theta.

    There 1 / s is theta (1/2 + p) with p = 1 / (z - 1). A power of p is a state of a chain of sums; each
    takes its neighbour times theta, so the power q of p leaves a factor theta^(q - 1) to its chain.

    Returns:
        what is there at once, without p; and what enters each state of the chain, p^1 to p^k.
    """
    k = len(f)
    half = Fraction(1, 2)
    at_once = [0]
    for i in range(1, k + 1):
        at_once.append(half**i * f[k - i])
    chain = []
    for power in range(1, k + 1):
        entering = [0]
        for order in range(power, k + 1):  # of f_(k - order) / s^order, the part with p^power
            entering.append(comb(order, power) * half ** (order - power) * f[k - order])
        chain.append(entering)
    return at_once, chain


def partial_fractions(m, r, numerator, denominator):
    """Return g, direct and F of N / (s^m D) = g_0 / s^m + ... + g_(m - 1) / s + direct + F / D."""
    g = []

    def product(power):  # the coefficient of s^power in g D
        total = 0
        for i, x in enumerate(g):
            if 0 <= power - i < len(denominator):
                total += x * denominator[power - i]
        return total

    for power in range(m):
        g.append((numerator[power] - product(power)) / denominator[0])
    direct = 0 if r else numerator[m + 1]
    proper = []
    for j in range(1 + r):
        proper.append(numerator[m + j] - direct * denominator[j] - product(m + j))
    return g, direct, proper


@lru_cache(maxsize=8)
def coefficients(m, r, zeta, pole, far, second, damping):
    """Return the coefficients of the discrete controller: polynomials in theta, over the first of them.

    In units of the bandwidth a channel's closed loop is s^2 s^m D(s) + N(s) with the poles that were stated,
    and the controller v = -N(s) / (s^m D(s)) e; it has m integrators and a filter with 1 + r states.

    Returns:
        what all others are divided by; what takes the error into v at once; what takes it into each
        integrator and into each state of the filter; and what each state of the filter loses to the first.
    """
    poles = times([1, 2 * zeta, 1], [second**2, 2 * damping * second, 1])
    for _ in range(m - 1):
        poles = times(poles, [pole, 1])
    for _ in range(r):
        poles = times(poles, [far, 1])
    numerator = [*poles[: m + 2], 0]
    denominator = poles[m + 2 :]
    g, direct, proper = partial_fractions(m, r, numerator, denominator)
    integral_at_once, integrators = trapezoidal(g)
    filter_at_once, filtered = trapezoidal(proper)
    # The filter is F / s^(1 + r) over 1 + D_0 / s^(1 + r) + ... + D_r / s, which has a part at once too.
    own_at_once, leaks = trapezoidal(denominator[: 1 + r])
    scale = plus([1], own_at_once)
    over = times(scale, scale)
    # v at once is that of the integrators and of what is direct, and the filter's over its own part.
    without_filter = times(plus([direct], integral_at_once), scale)
    at_once = times(plus(without_filter, filter_at_once), scale)
    law = [over, [-x for x in at_once]]
    for entering in integrators:
        law.append(times(entering, over))
    for entering, leak in zip(filtered, leaks):
        back = [-x for x in times(filter_at_once, leak)]
        law.append(plus(times(entering, scale), back))
    for leak in leaks:
        law.append(times(leak, scale))
    return law


class Loop(NamedTuple):
    """A channel over a sample [The matrix inequality], but for what the motors do.

    Its states are e, e' / omega, the integrators' over powers of omega, the filter's, and the errors of the
    last samples, as many as the delay has.

    Attributes:
        units: unit vectors of the states.
        A: the next state is A times the state.
        K: the controller asks for the acceleration omega^2 K times the state.
        late: which state is the error that the controller has.
    """

    units: list[list[int]]
    A: list[list[Fraction]]
    K: list[Fraction]
    late: int


def loop(c, omega):
    """Return a channel over a sample at a bandwidth."""
    m = c["integrators"]
    r = c["rolloff"]
    d = c["delay"]
    theta = omega * c["sample_time"]
    law = coefficients(m, r, *(c[name] for name in LAW[2:]))
    over, direct, *others = (value(polynomial, theta) for polynomial in law)
    entering = others[: m + 1 + r]
    leaks = others[m + 1 + r :]
    n = 3 + m + r + d
    integrators = range(2, 2 + m)
    filters = range(2 + m, n - d)
    lags = range(n - d, n)
    units = [[int(i == j) for j in range(n)] for i in range(n)]
    late = n - 1 if d else 0
    A = [list(row) for row in units]
    A[0][1] = theta
    for states in (integrators, filters):
        for i in states:
            A[i][late] += entering[i - 2] / over
            if i + 1 in states:
                A[i][i + 1] += theta
    for i in filters:
        A[i][filters[0]] -= leaks[i - filters[0]] / over
    for i in lags:
        A[i] = units[0 if i == lags[0] else i - 1]
    K = [0] * n
    K[integrators[0]] = K[filters[0]] = -1
    K[late] = direct / over
    return Loop(units, A, K, late)


# ---- One sample ----


class Sample(NamedTuple):
    """What a sample adds [P3 to P5].

    Attributes:
        growths: f, by which D changes over a sample at most, and by which it does while measurements are
            late.
        rest: rho of [P5]; what bounds the rest R is divided by it.
        ends: of the eigenvalues of D_k^-1 D^ [P3], the channels' delta.
        gains: of the bound of rho R [P5], the factors of what the controller asks for, of e', of the late
            error, and of the error's change while it is late.
        sizes: of the inputs: the rest's part in e', that in e, the change of v*, the encoder's count, the
            dead zone.
        torque: f w, with what an encoder's count does through the controller.
        noise: what a count makes the controller ask for at once.
    """

    growths: tuple[Fraction, ...]
    rest: Fraction
    ends: tuple[Fraction, ...]
    gains: tuple[Fraction, ...]
    sizes: tuple[Fraction, ...]
    torque: Fraction
    noise: Fraction


def sample(c):
    """Return what a sample adds."""
    h, d = c["sample_time"], c["delay"]
    kappa_e, kappa_g, kappa_f = c["kappa_e"], c["kappa_g"], c["kappa_f"]
    slowest, fastest = min(c["omega"]), max(c["omega"])
    # The Coriolis torque of the error is there twice for the reference's speed, where that moves, and once
    # for its own [The error's equation].
    moves = bool(c["reference"])
    sigma = moves * c["sigma"] + c["spread"] * c["sigma_error"]
    kappa = moves * 2 * c["kappa_v"] + c["spread"] * c["kappa_error"]
    f = growth(sigma * h)
    # The eigenvalues of D_k^-1 D^ [P3].
    wide = growth(sigma * d * h + c["sigma"] * c["count_time"])
    low, high = 0, 0
    if wide:
        low = c["delta_low"] / wide
        high = c["delta_high"] * wide
    # rho R, term by term [P5].
    rest = 1 - f * ((kappa + kappa_f) * h + kappa_g * h * h / 2)
    of_asked = high * (f - rest)
    of_speed = (f - rest) * kappa_f + f * (kappa + h * kappa_g)
    of_late_error = f * kappa_e
    of_change = f * kappa_g if d else 0
    # A count enters what the controller asks for at once: by K's entry of the late error.
    noise = 0
    for omega in c["omega"]:
        channel = loop(c, omega)
        noise = max(noise, abs(channel.K[channel.late]) * fastest**2 * c["count"])
    # What is measured is a count beside the arm, and behind a reference that moves on.
    of_count = (kappa_e + kappa_g) * c["count"]
    hidden = of_count + kappa_g * (d + 1) * h * c["reference"]
    torque = f * (c["torque"] + hidden) + of_asked * noise
    size = torque / rest / slowest**2 if rest else 0
    return Sample(
        growths=(f, wide),
        rest=rest,
        ends=(low, high),
        gains=(of_asked, of_speed, of_late_error, of_change),
        sizes=(size, size * fastest * h / 2, c["shift"] / slowest**3, c["count"], c["zone"]),
        torque=torque,
        noise=noise,
    )


# ---- The matrix inequality ----


def sources_of(c, known, channel, s):
    """Return the sources, the terms of the rest R [P5] but for f w: t_s, kappa_s and y_s of [P7], each.

    They are in units in which the state is: what the controller asks for is over omega^2, e' over omega, the
    errors are as they are; omega is at least the slowest.
    """
    units, K, late = channel.units, channel.K, channel.late
    slowest = min(c["omega"])
    change = [x - y for x, y in zip(units[0], units[late])]
    # What R depends on, and by which power of omega it is in other units than the acceleration.
    parts = [(K, 0), (units[1], 1), (units[late], 2), (change, 2)]
    sources = []
    for multiplier, gain, (row, power) in zip(s["t"], known.gains, parts):
        if gain:
            kappa = gain / known.rest / slowest**power
            sources.append((multiplier, kappa, row))
    return sources


class Acting(NamedTuple):
    """What acts in a sample: by how much a unit of each moves the channel's states.

    Attributes:
        held: an acceleration that is held; it moves e by half of theta^2 and e' / omega by theta.
        asked: what the controller asks for, over omega^2.
        at_speed: what is added to e' over the sample.
        at_place: what is added to e.
        at_hold: what the torque that holds the arm moves by.
        noise: an error that is measured wrongly; it enters what the controller asks for, and its states.
        zone: one that a dead zone hides, which does not enter the integrators.
    """

    held: list[Fraction]
    asked: list[Fraction]
    at_speed: list[Fraction]
    at_place: list[Fraction]
    at_hold: list[Fraction]
    noise: list[Fraction]
    zone: list[Fraction]


def acting_of(c, channel, theta, delta):
    """Return what acts in a sample of a channel, whose eigenvalue of D_k^-1 D^ is delta."""
    units, A, K, late = channel
    m, n = c["integrators"], len(A)
    order = n - c["delay"]  # states of arm and controller
    held = [theta * theta / 2, theta] + [0] * (n - 2)
    asked = [delta * x for x in held]
    noise = [x * K[late] for x in asked]
    for i in range(2, order):
        noise[i] = A[i][late]
    zone = [0] * n
    for i in range(2, 2 + m):
        zone[i] = A[i][late]
    at_speed, at_place, at_hold = ([theta * x for x in units[i]] for i in (1, 0, 2))
    return Acting(held, asked, at_speed, at_place, at_hold, noise, zone)


def inequality(c, known, omega, turn, delta, s):
    """Return the matrix of [P7] that has to be positive definite, affine in P, t and a.

    With x the channel's state, and z, w what the sources, friction and the inputs do in it, it is

        (1 - theta alpha) P - theta sum_s t_s kappa_s^2 y_s y_s^T  on x x,
        theta t, theta a                                       on z z and w w,

    less f Z^T P Z, where Z takes x, z and w to the next state.

    Args:
        c: what all claims rest on, and the sizes of the inputs.
        known: what a sample adds.
        omega: the bandwidth.
        turn: the bandwidth over the next one, in whose units the next state is.
        delta: the eigenvalue of D_k^-1 D^.
        s: the solution.
    """
    channel = loop(c, omega)
    A, K, P = channel.A, channel.K, s["P"]
    m, n = c["integrators"], len(A)
    order = n - c["delay"]  # states of arm and controller
    theta = omega * c["sample_time"]
    sources = sources_of(c, known, channel, s)
    acting = acting_of(c, channel, theta, delta)

    # Each with the multiplier of its square.
    columns = [(acting.at_speed, multiplier) for multiplier, _, _ in sources]
    columns.append((acting.at_place, s["t"][4]))
    friction = n + len(columns)
    if c["kappa_f"]:
        columns.append((acting.held, s["t"][5]))
    for column, multiplier, size in zip(acting[2:], s["a"], known.sizes):  # the inputs, in their order
        if size:
            columns.append((column, multiplier))

    # Z: the next state, in units of the next bandwidth: e' is over omega, the integrators' states are over
    # omega^2 and higher powers, and so are the filter's.
    of_integrators = range(2, 2 + m)
    of_filter = range(2, order - m)
    powers = [0, 1, *of_integrators, *of_filter, *[0] * c["delay"]]
    Z = []
    for i, power in enumerate(powers):
        row = [x + acting.asked[i] * y for x, y in zip(A[i], K)]
        row += [column[i] for column, _ in columns]
        Z.append([x * turn**power for x in row])

    # -f Z^T P Z, and what is on z z and w w.
    f = known.growths[0]
    quadratic = matrix_product(transposed(Z), matrix_product(P, Z))
    X = [[-f * x for x in row] for row in quadratic]
    for i, (_, multiplier) in enumerate(columns):
        X[n + i][n + i] += theta * multiplier
    if c["kappa_f"]:  # friction takes energy [P6]
        X[1][friction] += s["t"][5] * c["sample_time"] * c["kappa_f"] / 2
        X[friction][1] = X[1][friction]
    # What the rest does to e is at most theta / 2 of what it does to e', and is split over the sources.
    in_place = s["t"][4] * len(sources) * theta * theta / 4
    for i in range(n):
        for j in range(n):
            taken = sum((t + in_place) * kappa * kappa * y[i] * y[j] for t, kappa, y in sources)
            X[i][j] += P[i][j] * (1 - theta * s["alpha"]) - theta * taken
    return X


def holds(c, s):
    """Tell whether [P7] holds; omega is one of a list, and goes to a neighbour at most."""
    known = sample(c)
    f, wide = known.growths
    if f < 1 or wide < 1 or not 0 < known.rest <= 1:
        return False  # a sample adds too much for any claim
    if s["alpha"] <= 0 or {name: len(s[name]) for name in MULTIPLIERS} != MULTIPLIERS:
        return False
    if min([*s["t"], *s["a"]]) < 0:
        return False
    P, omegas = s["P"], c["omega"]
    if len(P) != len(loop(c, omegas[0]).A) or transposed(P) != P or not is_positive_definite(P):
        return False
    for i, omega in enumerate(omegas):
        for after in omegas[max(i - 1, 0) : i + 2]:
            for delta in known.ends:
                if not is_positive_definite(inequality(c, known, omega, omega / after, delta, s)):
                    return False
    return True


# ---- What is claimed ----


class Motion(NamedTuple):
    """Bounds in the metric of D while V is below a level.

    Attributes:
        e: of the error.
        v: of e'.
        a: of e''.
        asked: of what the controller asks for.
    """

    e: Fraction
    v: Fraction
    a: Fraction
    asked: Fraction


class Reach:
    """What a level of V, the root of x^T P x, allows."""

    def __init__(self, c, known, P):
        """Work out how large each part of the state is where V is 1."""
        self.c, self.known, self.P = c, known, P
        fastest = max(c["omega"])
        units, _, _, late = loop(c, c["omega"][0])
        self.e = self.largest(units[0])
        self.v = self.largest(units[1]) * fastest
        self.late_error = self.largest(units[late])
        self.asked = max(self.largest(loop(c, omega).K) for omega in c["omega"]) * fastest**2

    def largest(self, row):
        """Return at least the largest value of a row times x where x^T P x is 1 at most.

        It is the root of y^T P^-1 y, minus the last pivot of P bordered by y.
        """
        bordered = [[*entries, y] for entries, y in zip(self.P, row)]
        bordered.append([*row, 0])
        return root(-pivots(bordered)[-1])

    def motion(self, level, before=0):
        """Return the motion at a level, after a part of a sample with another acceleration `before`."""
        h, known = self.c["sample_time"], self.known
        e = level * self.e
        v = level * self.v
        late_error = level * self.late_error
        asked = level * self.asked
        if before:
            e = e + h * v + h * h / 2 * before
            v = v + h * before
        # R [P5], and with it the acceleration B = delta_hi U + kappa_f E' + R [P4].
        of_asked, of_speed, of_late_error, of_change = known.gains
        added = of_asked * asked + of_speed * v
        added += of_late_error * late_error + of_change * (e + late_error)
        rest = (known.torque + added) / known.rest
        _, high = known.ends
        a = high * (asked + known.noise) + self.c["kappa_f"] * v + rest
        return Motion(e, v, a, asked)


def bounds(c, s, claim=""):
    """Return at least the errors, the speeds of the error and the torques, at all times [What is claimed]."""
    known = sample(c)
    f, wide = known.growths
    h = c["sample_time"]
    P = s["P"]
    slowest = min(c["omega"])
    reach = Reach(c, known, P)
    # The root of V, settled [P8].
    energy = sum(a * size * size for a, size in zip(s["a"], known.sizes))
    level = root(energy / s["alpha"])
    # What a wrong torque to hold the arm, an acceleration, is in it [P9].
    of_hold = root(P[2][2]) / slowest**2
    if claim == "start":
        hidden = (c["kappa_e"] + c["kappa_g"]) * c["count"] / c["delta_low"]
        level = max(level, of_hold * (c["jump"] + hidden))
    motion = reach.motion(level)
    fastest = motion.a
    if claim == "jump":  # at any time in a sample: till then one arm's acceleration, then the other's
        ratio = root(c["delta_high"] / c["delta_low"])
        level = ratio * level + of_hold * c["jump"]
        old = f * ratio * motion.a
        new = f * reach.motion(level, old).a
        fastest = max(old, new)
        apart = (root(P[0][0]) * h / 2 + root(P[1][1]) / slowest) * h * 2 * fastest
        motion = reach.motion(level + apart)
        fastest = max(fastest, motion.a)
    # Between samples [P10]; a late reference has moved on.
    e = motion.e + h * motion.v + h * h / 2 * fastest
    v = root(f) * (motion.v + h * fastest)
    errors = []
    for inverse, speed in zip(c["inverse"], c["velocity"]):
        errors.append(root(f * inverse) * e + c["delay"] * h * speed)
    # The torques [P11].
    asked = root(wide) * (motion.asked + known.noise)
    torques = [hold + reached * asked for hold, reached in zip(c["hold"], c["reach"])]
    return {"errors": errors, "speed": [v], "torques": torques}


# ---- Reading a certificate ----


def exact(x):
    """Return JSON with every text of a number as the rational that it is."""
    if isinstance(x, dict):
        return {key: exact(part) for key, part in x.items()}
    if isinstance(x, list):
        return [exact(part) for part in x]
    return Fraction(x) if isinstance(x, str) else x


def numbers(data, where, depth=0):
    """Return a number, or lists of them so deep, that are texts of bounded length."""
    if depth:
        if not isinstance(data, list) or not data:
            raise Refused(f"{where} has to be a list of numbers")
        return [numbers(x, where, depth - 1) for x in data]
    if not isinstance(data, str) or not NUMBER.fullmatch(data):
        raise Refused(f"{where} has to be a number as a text of bounded length")
    return Fraction(data)


def section(data, where, keys):
    """Return a mapping that has these keys and no others."""
    if not isinstance(data, dict):
        raise Refused(f"{where} has to be a mapping with {', '.join(sorted(keys))}")
    missing = sorted(set(keys) - set(data))
    if missing:
        raise Refused(f"{where} has no {', '.join(missing)}")
    unknown = sorted(set(data) - set(keys))
    if unknown:
        raise Refused(f"{where} has {', '.join(unknown)[:200]}, which no certificate has there")
    return data


def require(condition, expected):
    """Refuse a certificate whose numbers are not what the proof takes them for."""
    if not condition:
        raise Refused(f"expected {expected}")


def facts(data):
    """Return what all claims rest on as exact numbers, each within what the proof takes it for."""
    law = section(data["law"], "law", (*WHOLE, "omega", *LAW))
    robot = data["robot"]
    n = len(numbers(section(data["numbers"], "numbers", NUMBERS)["inverse"], "inverse", 1))
    found = {}
    for key, (low, high) in WHOLE.items():
        if type(law[key]) is not int or not low <= law[key] <= high:
            raise Refused(f"law.{key} has to be {low} to {high}")
        found[key] = law[key]
    for key in LAW:
        found[key] = numbers(law[key], f"law.{key}")
    found["omega"] = numbers(law["omega"], "omega", 1)
    for key, depth in NUMBERS.items():
        found[key] = numbers(data["numbers"][key], key, depth)
    limits = section(data["limits"], "limits", LIMITS)
    for key in LIMITS:
        found[key] = numbers(limits[key], f"limits.{key}", 1)

    listed = isinstance(robot, dict) and isinstance(robot.get("joints"), list)
    sizes = {len(found[key]) for key in ("hold", "reach", *LIMITS)}
    require(
        listed and len(robot["joints"]) == n and n <= JOINTS and sizes == {n}, "one number for each joint"
    )
    omega = found["omega"]
    # More than the inequality has rows and columns: three states, five sources and friction, five inputs.
    largest = 12 + sum(law[key] for key in WHOLE)
    require(len(omega) * largest**3 <= WORK, "fewer bandwidths")
    require(omega == sorted(set(omega)) and omega[0] > 0, "positive bandwidths that grow")
    require(all(found[key] > 0 for key in LAW if key != "rate"), "a positive law and sample time")
    require(0 < found["delta_low"] <= found["delta_high"], "delta between positive ends")
    ordered = all(low <= high for low, high in zip(found["lower"], found["upper"]))
    require(ordered, "lower ends below the upper ones")
    for key, given in found.items():
        if key not in SIGNED:
            require(min(given if isinstance(given, list) else [given]) >= 0, "no negative number")
    return found


def solution(data, name, n):
    """Return a solution as exact numbers, with its claims."""
    given = section(data, name, ("P", "alpha", *MULTIPLIERS, "claims"))
    claims = section(given["claims"], f"{name}.claims", ("errors", "speed", "torques"))
    found = {
        "P": numbers(given["P"], f"{name}.P", 2),
        "alpha": numbers(given["alpha"], f"{name}.alpha"),
        **{key: numbers(given[key], f"{name}.{key}", 1) for key in MULTIPLIERS},
    }
    square = all(len(row) == len(found["P"]) for row in found["P"])
    if not square or {key: len(found[key]) for key in MULTIPLIERS} != MULTIPLIERS:
        raise Refused(f"{name}: expected 6 numbers t, 5 numbers a and a square P")
    found["claims"] = {key: numbers(claims[key], f"{name}.claims.{key}", 1) for key in claims}
    sizes = {key: len(claimed) for key, claimed in found["claims"].items()}
    if sizes != {"errors": n, "speed": 1, "torques": n}:
        raise Refused(f"{name}.claims: expected an error and a torque for each joint, and one speed")
    return found


def check(certificate):
    """Return what is wrong with a certificate, a line each; nothing for one that holds."""
    try:
        return verify(certificate)
    except ERRORS as error:
        return [str(error) or type(error).__name__]


def verify(data):
    """Return what is wrong with a certificate whose parts are as they should be."""
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise Refused(f"the format is not {FORMAT!r}")
    section(data, "a certificate", SECTIONS | {"solutions", "seal"})
    sealed = {key: x for key, x in data.items() if key not in ("solutions", "seal")}
    if hashlib.sha256(json.dumps(sealed, sort_keys=True).encode()).hexdigest() != data["seal"]:
        raise Refused("the seal is broken")
    common = facts(data)
    solutions = data["solutions"]
    if not isinstance(solutions, dict) or not solutions or not set(solutions) <= set(CLAIMS):
        raise Refused(f"claims nothing, or more than {', '.join(CLAIMS)}")
    wrong = []
    for name, inputs in section(data["inputs"], "inputs", solutions).items():
        s = solution(solutions[name], name, len(common["inverse"]))
        c = {**common, **input_sizes(name, inputs, common)}
        wrong += wrong_in_claim(name, c, s)
    return wrong


def input_sizes(name, inputs, common):
    """Return the sizes of a claim's inputs as exact numbers."""
    given = section(inputs, f"inputs.{name}", INPUTS)
    sizes = {key: numbers(given[key], f"inputs.{name}.{key}") for key in INPUTS}
    # The proof of `gain` has a reference at rest, that of the others one that moves as it was stated.
    moves_as_stated = name == "gain" or any(common["velocity"]) == bool(sizes["reference"])
    if min(sizes.values()) < 0 or not moves_as_stated:
        raise Refused(f"inputs.{name}: negative, or at rest where the reference moves")
    return sizes


def wrong_in_claim(name, c, s):
    """Return what is wrong with a claim, a line each."""
    if not holds(c, s):
        return [f"{name}: the matrix inequality does not hold"]
    allowed = {"errors": c["radius"], "speed": [c["spread"]], "torques": c["effort"]}
    wrong = []
    for what, proved in bounds(c, s, name).items():
        claimed = s["claims"][what]
        if any(x > min(y, z) for x, y, z in zip(proved, allowed[what], claimed)):
            wrong.append(f"{name}: {what} are larger than claimed or allowed")
    return wrong


# ---- What is printed ----


def unclaimed(data):
    """Return what a file says that was asked for and that no claim of it is about, a phrase each."""
    robot, limits, solutions = data["robot"], data["limits"], data["solutions"]
    moves = any(Fraction(x) for x in limits["velocity"] + limits["acceleration"])
    pushed = any(Fraction(x) for x in robot.get("torque") or ())
    stated = moves or pushed or robot.get("friction") or robot.get("bits")
    jumps = bool(Fraction(data["numbers"]["jump"]))
    missing = []
    if stated and "stated" not in solutions:
        missing.append("everything that was stated")
    if jumps and robot.get("start") == "wrong-load" and "start" not in solutions:
        missing.append("a start with the torque of another load")
    if jumps and robot.get("jump") and "jump" not in solutions:
        missing.append("a jump of the load")
    return missing


def text(x):
    """Return plain data on one line, without what moves a terminal."""
    return json.dumps(x)[:400]


def listed(given):
    """Return numbers that were checked, which are texts, without their quotes."""
    return ", ".join(str(x) for x in given)[:400]


def describe(data):
    """Return what was verified, and what was taken from the file as it is, a line each."""
    count = len(data["law"]["omega"])
    verified = [
        f"the matrix inequality at {count} bandwidth{'s'[: count - 1]} and both ends of delta, exactly",
        "every bound below follows from it and from the numbers of the arm, exactly",
        "the seal fits what it seals: no slip, which is no signature",
    ]
    for name, s in data["solutions"].items():
        size = f"torques up to {listed([data['inputs'][name]['torque']])} in the metric of D^-1"
        errors = listed(s["claims"]["errors"])
        verified.append(f"claim {name!r}: {errors} rad or m at most: {CLAIMS[name]}; {size}")
        verified.append(f"  with torques: {listed(s['claims']['torques'])} N m or N at most")
    lines = ["  VERIFIED here:"]
    lines += [f"    {row}" for row in verified]
    lines.append("  TAKEN FROM THE FILE, not verified:")
    lines += [f"    {row}" for row in taken(data)]
    return lines


def taken(data):
    """Return what a certificate says and its checker cannot know, a line each."""
    robot, law, limits = data["robot"], data["law"], data["limits"]
    moves = any(Fraction(x) for x in limits["velocity"])
    arm = [robot.get(key) for key in ("name", "sha256", "armature", "locked")]
    proved = sorted(key for key, x in data["status"].items() if x == "proved")
    searched = sorted(key for key, x in data["status"].items() if x != "proved")
    rows = [
        ("the numbers of the arm", sorted(data["numbers"]), "are those of this arm in this box"),
        ("of these said to be proved", proved, ""),
        ("of these said to be estimated numerically", searched, ""),
        ("arm", arm, "that it is rigid, and has this URDF"),
        ("loads [kg]", robot.get("loads"), "and all between"),
        ("joints", robot["joints"], ""),
        ("box, lower ends [rad or m]", limits["lower"], "the arm stays in it"),
        ("box, upper ends [rad or m]", limits["upper"], ""),
    ]
    if moves:
        rows.append(("reference", limits["velocity"], "[rad/s or m/s]"))
        rows.append(("its acceleration", limits["acceleration"], "[rad/s^2 or m/s^2]"))
    else:
        rows.append(("reference", "at rest", ""))
    rows.append(("start", robot.get("start"), ""))
    lines = [f"{name}: {text(said)} {more}".rstrip() for name, said, more in rows]
    member = f"{law['integrators']} integrators, roll-off {law['rolloff']}, {law['delay']} samples late"
    ends = text([law["omega"][0], law["omega"][-1]])
    lines.append(f"the controller that runs: {member}, omega [rad/s] {ends}, {law['sample_time']} s")
    return lines


def unique(pairs):
    """Return a JSON object none of whose keys is there twice."""
    if len(dict(pairs)) < len(pairs):
        raise Refused("a key is there twice")
    return dict(pairs)


def read(file):
    """Return a file's JSON; only of a regular file of bounded size."""
    if not stat.S_ISREG(os.stat(file).st_mode) or os.stat(file).st_size > BYTES:
        raise Refused(f"is no regular file of at most {BYTES} bytes")
    with open(file, encoding="utf-8") as stream:
        return json.load(stream, object_pairs_hook=unique)


def judge(file):
    """Return what is said of a file, and its exit code."""
    try:
        data = read(file)
        wrong, missing = verify(data), unclaimed(data)
        if wrong:
            return "DOES NOT HOLD: " + "; ".join(wrong), 1
        if missing:
            head = f"HOLDS FOR PART: asked for and not claimed: {'; '.join(missing)}"
            return "\n".join([head, *describe(data)]), 3
        return "\n".join(["HOLDS:", *describe(data)]), 0
    except ERRORS as error:
        return f"IS NO CERTIFICATE: {text(str(error))}", 2


def main(files):
    """Print what holds of some files.

    Returns 1 where a claim does not hold, 2 where a file is no certificate, 3 where all claims hold but
    something that was asked for has none.
    """
    codes = set() if files else {2}
    for file in files:
        said, code = judge(file)
        codes.add(code)
        print(file, said)
    return next(code for code in (2, 1, 3, 0) if code in codes)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
