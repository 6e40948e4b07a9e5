"""Two discrete realisations of the GPI law, the paper's and one without its hidden mode.

Both hold v = -C(s) e with C(s) = (beta3 s^3 + beta2 s^2 + beta1 s + beta0) / (s^2 (s + beta4)), the law of
eqs. 14 and 17, and both replace every integral by the trapezoidal rule, so under constant gains they are
the same filter. They differ in their states, and therefore under gains that change.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import namedtuple
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, cast

import numpy as np

from armgpi.base.arrays import Array, new
from armgpi.gpi.family import PRINTED, Member, partial_fractions
from armgpi.gpi.gains import Tuning, betas


class Resting(NamedTuple):
    """What integrates less while the reference rests, so that friction does not make the arm hunt.

    Attributes:
        e: the error that the integrators are fed with [rad or m].
        kept: share of every integrator but the first that is left after a sample [-].
    """

    e: Array
    kept: Array


class Realisation(ABC):
    """A discrete v = -C(s) e: elementwise, no branch on values.

    An integrator of x by the trapezoidal rule is kept as the sum s of dt x over past samples; its value
    now is s + dt x / 2. So the output needs the error now and the state, and the state is updated last,
    when it is known what was applied.
    """

    @abstractmethod
    def coefficients(self, tuning: Tuning, dt: float) -> Any:
        """Return what the other methods need of the tuning and the sample time [s]."""

    @abstractmethod
    def init(self, hold: Array, c: Any) -> Any:
        """Return the state that, while the error is zero, keeps v = `hold` [rad/s^2]."""

    def settled(self, e: Array, state: Any, c: Any) -> Any:
        """Return a state whose filter has settled on an error, so that its derivative does not kick.

        Args:
            e: error that is taken to have stood for long [rad or m].
            state: of the integrators.
            c: the coefficients.

        Raises:
            NotImplementedError: for a realisation without a filter of its own.
        """
        raise NotImplementedError

    def at_rest(self, e: Array, state: Any, c: Any) -> Any:
        """Return a state for an arm that is at rest beside its reference: its first v is that of no error.

        The filter has settled, and the first integrator starts with what balances the error's proportional
        part. So the torque starts from what holds the arm and grows with the integral of the error, as of a
        controller whose proportional part sees the way from the start alone.

        Args:
            e: error at the start [rad or m].
            state: from :meth:`init`.
            c: the coefficients.

        Raises:
            NotImplementedError: for a realisation without a filter of its own.
        """
        raise NotImplementedError

    @abstractmethod
    def output(self, e: Array, state: Any, c: Any) -> Array:
        """Return v [rad/s^2 or m/s^2] for the error `e` [rad or m]."""

    @abstractmethod
    def update(
        self, e: Array, v: Array, a: Array | None, state: Any, c: Any, resting: Resting | None = None
    ) -> Any:
        """Return the next state.

        Args:
            e: error [rad or m].
            v: what was asked for [rad/s^2 or m/s^2].
            a: v + a is what was applied (anti-windup); None means v.
            state: the state before.
            c: the coefficients.
            resting: what the integrators are given instead of the error, for the bumpless realisation.
        """


#: What the states mean, and the coefficients.
_STATES = {
    "lam": "settles on the disturbance acceleration [rad/s^2]",
    "chi": "settles on its slope [rad/s^3]",
    "psi": "settles on its curvature [rad/s^4]",
    "eta": "filtered derivative of the error, times its gain [rad/s^2]",
    "eta_2": "second state of the filter [rad/s^3]",
    "eta_3": "third state of the filter [rad/s^4]",
}
_COEFFICIENTS = {
    "direct": "from the error into the virtual acceleration [1/s^2]",
    **{
        name: f"from the error into {name}, in a sample [{unit}]"
        for names, unit in (
            (("lam", "eta"), "1/s^2"),
            (("chi", "eta_2"), "1/s^3"),
            (("psi", "eta_3"), "1/s^4"),
        )
        for name in names
    },
    "decay": "of eta over a sample [-]",
    "leak_2": "from eta into eta_2, in a sample [1/s]",
    "leak_3": "from eta into eta_3, in a sample [1/s^2]",
    "dt": "sample time [s]",
    "back_lam": "anti-windup of lam [-]",
    "back_chi": "anti-windup of chi [1/s]",
    "back_psi": "anti-windup of psi [1/s^2]",
}


def _record(
    kind: str, integrators: int, filtered: int, fields: Sequence[str], meanings: Mapping[str, str]
) -> type[Any]:
    """Return a NamedTuple for one member of the family, which pickle finds by its name."""
    name = f"{kind}{integrators}{filtered - 1}"
    made = cast(Any, namedtuple(name, fields))
    made.derived = {field: meanings[field] for field in fields}
    globals()[name] = made
    return cast(type[Any], made)


class _Records(NamedTuple):
    state: type[Any]
    coefficients: type[Any]


def _records(integrators: int, filtered: int) -> _Records:
    """Return the types of the state and of the coefficients with so many integrators and filter states."""
    chain, filters = ("lam", "chi", "psi")[:integrators], ("eta", "eta_2", "eta_3")[:filtered]
    leaks = ("decay", "leak_2", "leak_3")[:filtered]
    fields = ("direct", *chain, *filters, *leaks, "dt", *(f"back_{name}" for name in chain))
    return _Records(
        _record("BumplessState", integrators, filtered, (*chain, *filters), _STATES),
        _record("BumplessCoefficients", integrators, filtered, fields, _COEFFICIENTS),
    )


_RECORDS = {(m, r): _records(m, 1 + r) for m in (1, 2, 3) for r in (0, 1, 2)}

#: Anti-windup: while the torque is cut, the integrators follow what is applied with the polynomial
#: (s + omega_c)^(m - 1) (s + 2 omega_c); its coefficients below the leading one, without powers of omega_c.
_BACK = {1: (2.0,), 2: (3.0, 2.0), 3: (4.0, 5.0, 2.0)}


class Bumpless(Realisation):
    """Partial fractions of C(s) with the gains inside the integrals, for any member of the family.

        v = -(direct e + lam + eta)
        lam' = g_1 e + chi          lam settles on the disturbance acceleration [rad/s^2], whatever the gains
        chi' = g_2 e + psi          chi on its slope [rad/s^3], psi on its curvature [rad/s^4]
        psi' = g_3 e
        eta = F(s) / D(s) e         a filtered derivative

    There are as many of lam, chi, psi as integrators, and as many states of the filter as D has poles (eta,
    eta_2, eta_3). The filter is in observer form: the states enter v by a factor of 1, the error enters the
    states by the gains. So while e = 0, changing a gain changes nothing, and no root of D is needed.

    Attributes:
        member: of the family.
    """

    def __init__(self, member: Member = PRINTED) -> None:
        """Realise a member of the family, the printed law when not given."""
        self.member = member
        self._state, self._coefficients = _RECORDS[member.integrators, member.rolloff]
        self._printed = member.integrators == 2 and not member.rolloff and member.equal

    def coefficients(self, tuning: Tuning, dt: float) -> Any:
        """Return the coefficients of the trapezoidal rule; see :meth:`Realisation.coefficients`.

        An integral is (dt / 2) (z + 1) / (z - 1). Both blocks are kept as chains in 1 / (z - 1).

        Args:
            tuning: of a joint or of several, in arrays that broadcast with the error.
            dt: sample time [s].

        Returns:
            A NamedTuple of the member's own type, whose fields' meanings are in its `derived`.
        """
        if self._printed:
            return new(self._coefficients, _printed_coefficients(tuning, dt))
        terms = partial_fractions(tuning, self.member)
        half = 0.5 * dt
        chain = terms.integrals[::-1]
        direct = _at_once(chain, half)
        if terms.direct is not None:
            direct = terms.direct + direct
        drive = [dt * x for x in _delta(chain, half)]
        passed, filter_drive, leak = _filter(terms.numerator, terms.denominator, half)
        back = []
        power = np.array(dt)  # dt omega_c^k, k = 1, 2, ... below
        for factor in _BACK[self.member.integrators]:
            power = power * tuning.omega_c
            back.append(factor * power)
        values = (-(direct + passed), *drive, *filter_drive, *leak, np.array(dt), *back)
        return new(self._coefficients, values)

    def init(self, hold: Array, c: Any) -> Any:
        """Return the state at rest; see :meth:`Realisation.init`."""
        zero = np.zeros_like(hold)
        return new(self._state, (zero - hold, *[zero] * (self.member.integrators + self.member.rolloff)))

    def settled(self, e: Array, state: Any, c: Any) -> Any:
        """Return a state whose filter has settled on an error; see :meth:`Realisation.settled`."""
        m = self.member.integrators
        order = 1 + self.member.rolloff
        drive = c[1 + m : 1 + m + order]
        leak = c[1 + m + order : 1 + m + 2 * order]
        eta = drive[-1] * e / (1.0 - leak[0] if order == 1 else leak[-1])
        filters = [eta]
        # Each state stays where it is: the next one balances what it loses and what the error adds.
        for k in range(order - 1):
            lost = (1.0 - leak[0]) * eta if k == 0 else leak[k] * eta
            filters.append((lost - drive[k] * e) / c.dt)
        return new(self._state, (*state[:m], *filters))

    def at_rest(self, e: Array, state: Any, c: Any) -> Any:
        """Return a state whose first v is that of no error; see :meth:`Realisation.at_rest`."""
        settled = self.settled(e, state, c)
        return settled._replace(lam=settled.lam + c.direct * e - settled.eta)

    def output(self, e: Array, state: Any, c: Any) -> Array:
        """Return v; see :meth:`Realisation.output`."""
        v: Array = c.direct * e - state.lam - state.eta
        return v

    def update(
        self, e: Array, v: Array, a: Array | None, state: Any, c: Any, resting: Resting | None = None
    ) -> Any:
        """Return the next state; see :meth:`Realisation.update`."""
        if self._printed and resting is None:
            return new(self._state, _printed_update(e, a, state, c))
        m, order = self.member.integrators, len(state)
        drive, leak, dt = c[1 : 1 + order], c[1 + order : -1 - m], c.dt
        chain, filters = state[:m], state[m:]
        eta = filters[0]
        kept = (leak[0] * eta, *[x - gain * eta for x, gain in zip(filters[1:], leak[1:], strict=True)])
        if resting is None:
            chain = _fed(chain, chain, drive[:m], e, dt)
        else:
            left = (chain[0], *[resting.kept * x for x in chain[1:]])
            chain = _fed(left, left, drive[:m], resting.e, dt)
        if a is not None:
            chain = [x - gain * a for x, gain in zip(chain, c[-m:], strict=True)]
        return new(self._state, (*chain, *_fed(kept, filters, drive[m:], e, dt)))


def _printed_coefficients(tuning: Tuning, dt: float) -> tuple[Array, ...]:
    """Return the coefficients of the printed law, unrolled: every NumPy sample with networks needs them.

    The same operations in the same order as for every member, so the same bits, in a third of the time.
    """
    beta0, beta1, beta2, beta3, beta4 = betas(tuning)
    c = beta0 / beta4
    b = (beta1 - c) / beta4
    d = beta2 - beta3 * beta4 - b
    half = 0.5 * dt
    shrunk = half * beta4
    decay = (1.0 - shrunk) / (1.0 + shrunk)
    filtered = half * d / (1.0 + shrunk)
    back = dt * tuning.omega_c
    direct = -(beta3 + half * (b + half * c) + filtered)
    drive = (dt * (b + dt * c), dt * c, (1.0 + decay) * filtered)
    return direct, *drive, decay, np.array(dt), 3.0 * back, 2.0 * back * tuning.omega_c


def _printed_update(e: Array, a: Array | None, state: Any, c: Any) -> tuple[Array, Array, Array]:
    """Return lam, chi and eta of the printed law after a sample, unrolled: every NumPy sample does this."""
    lam, chi, eta = state
    lam = lam + c.dt * chi + c.lam * e
    chi = chi + c.chi * e
    if a is not None:
        lam = lam - c.back_lam * a
        chi = chi - c.back_chi * a
    return lam, chi, c.decay * eta + c.eta * e


def _fed(
    kept: Sequence[Array], old: Sequence[Array], drive: Sequence[Array], e: Array, dt: Array
) -> list[Array]:
    """Return a chain's next states: what each kept, `dt` times the next one before, and of the error."""
    fed = [x + dt * above + gain * e for x, above, gain in zip(kept, old[1:], drive, strict=False)]
    return [*fed, kept[-1] + drive[-1] * e]


def _at_once(f: Sequence[Array], half: float) -> Array:
    """Return f_0 half^k + f_1 half^(k - 1) + ... + f_(k - 1) half."""
    total = half * f[0]
    for x in f[1:]:
        total = half * (x + total)
    return total


def _beyond(f: Sequence[Array], half: float) -> Array | float:
    """Return what a chain of more than one state adds to the coefficients of its first."""
    k = len(f)
    return sum((2.0 * (k - 1 - i) * half ** (k - i)) * x for i, x in enumerate(f[:-1]))


def _delta(f: Sequence[Array], half: float) -> list[Array]:
    """Return a numerator f over s^k in powers of (z - 1) / dt, the powers k - 1 to 0 in this order.

    With s = g / (1 + half g) it is f_0 (1 + half g)^k + f_1 g (1 + half g)^(k - 1) + ...
    """
    k = len(f)

    def coefficient(j: int) -> Array:
        return sum(((math.comb(k - i, j - i) * half ** (j - i)) * f[i] for i in range(j - 1, -1, -1)), f[j])

    return [coefficient(j) for j in range(k - 1, -1, -1)]


class _Filter(NamedTuple):
    passed: Array  # from the error into the output at once
    drive: tuple[Array, ...]  # from the error into each state
    leak: tuple[Array, ...]  # from the first state: what it keeps, and what it takes from the others


def _filter(f: Sequence[Array], d: Sequence[Array], half: float) -> _Filter:
    """Return F(s) / D(s) by the trapezoidal rule as a chain in observer form."""
    shrunk = _at_once(d, half)
    # A sum for each division: generated code would share a reciprocal, whose products round otherwise.
    passed = _at_once(f, half) / (1.0 + shrunk)
    decay = (1.0 - shrunk - _beyond(d, half)) / (1.0 + shrunk)
    scale = 1.0 + shrunk
    drive = (1.0 + decay) * passed + _beyond(f, half) / scale
    dt = 2.0 * half
    leaks = [dt * (x / scale) for x in _delta(d, half)[1:]]
    drives = [dt * (x / scale) - passed * y for x, y in zip(_delta(f, half)[1:], leaks, strict=True)]
    return _Filter(passed, (drive, *drives), (decay, *leaks))


class PaperState(NamedTuple):
    """State of the printed realisation: the integrals of eqs. 14 and 17, up to the last sample.

    Attributes:
        int_v: integral of v, the reconstructed velocity error [rad/s].
        int_e: integral of e [rad s].
        int2_e: second integral of e [rad s^2].
        int3_e: third integral of e [rad s^3].
    """

    int_v: Array
    int_e: Array
    int2_e: Array
    int3_e: Array


class _PaperCoefficients(NamedTuple):
    """Coefficients of the printed realisation.

    Attributes:
        beta0: gain of eq. 25 [1/s^5].
        beta1: gain of eq. 25 [1/s^4].
        beta2: gain of eq. 25 [1/s^3].
        beta3: gain of eq. 25 [1/s^2].
        beta4: gain of eq. 25 [1/s].
        dt: sample time [s].
        half: half of it [s].
        solve: -1 / (1 + half beta4): v stands on both sides of eq. 17 [-].
    """

    beta0: Array
    beta1: Array
    beta2: Array
    beta3: Array
    beta4: Array
    dt: float
    half: float
    solve: Array


class Paper(Realisation):
    """The law as printed: v = -beta4 int(v) - beta3 e - beta2 int(e) - beta1 int2(e) - beta0 int3(e).

    Four integrators for a third-order C(s): the hidden mode lets int(v) and int3(e) grow without bound,
    cancelling each other in v. Under gains that change they no longer cancel.
    """

    def coefficients(self, tuning: Tuning, dt: float) -> _PaperCoefficients:
        """Return the coefficients of the trapezoidal rule; see :meth:`Realisation.coefficients`."""
        half = 0.5 * dt
        gains = betas(tuning)
        return _PaperCoefficients(*gains, dt=dt, half=half, solve=-1.0 / (1.0 + half * gains.beta4))

    def init(self, hold: Array, c: _PaperCoefficients) -> PaperState:
        """Return the state at rest; see :meth:`Realisation.init`."""
        zero = np.zeros_like(hold)
        # A constant int2_e makes int3_e grow so that it cancels int_v, and v stays at `hold`.
        return PaperState(
            int_v=hold * (c.beta1 / c.beta0 - 1.0 / c.beta4),
            int_e=zero,
            int2_e=-hold * c.beta4 / c.beta0,
            int3_e=zero,
        )

    def output(self, e: Array, state: PaperState, c: _PaperCoefficients) -> Array:
        """Return v; see :meth:`Realisation.output`."""
        int_e = state.int_e + c.half * e
        int2_e = state.int2_e + c.half * int_e
        int3_e = state.int3_e + c.half * int2_e
        return c.solve * (  # eq. 17
            c.beta4 * state.int_v + c.beta3 * e + c.beta2 * int_e + c.beta1 * int2_e + c.beta0 * int3_e
        )

    def update(
        self,
        e: Array,
        v: Array,
        a: Array | None,
        state: PaperState,
        c: _PaperCoefficients,
        resting: Resting | None = None,
    ) -> PaperState:
        """Return the next state, whose reconstructor (eq. 14) integrates what was applied."""
        int_e = state.int_e + c.half * e
        int2_e = state.int2_e + c.half * int_e
        return PaperState(
            int_v=state.int_v + c.dt * (v if a is None else v + a),
            int_e=state.int_e + c.dt * e,
            int2_e=state.int2_e + c.dt * int_e,
            int3_e=state.int3_e + c.dt * int2_e,
        )


REALISATIONS: dict[str, Realisation] = {"bumpless": Bumpless(), "paper": Paper()}
