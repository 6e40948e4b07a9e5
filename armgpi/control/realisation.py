"""Two discrete realisations of the GPI law, the paper's and one without its hidden mode.

Both hold v = -C(s) e with C(s) = (beta3 s^3 + beta2 s^2 + beta1 s + beta0) / (s^2 (s + beta4)), the law of
eqs. 14 and 17, and both replace every integral by the trapezoidal rule, so under constant gains they are
the same filter. They differ in their states, and therefore under gains that change.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import Array
from armgpi.control.gains import Tuning, betas


class LawStep(NamedTuple):
    """Result of one step of the law.

    Attributes:
        v: virtual acceleration asked for [rad/s^2 or m/s^2].
        state: the next state.
    """

    v: Array
    state: Any


class Realisation(ABC):
    """A discrete v = -C(s) e: elementwise, no branch on values."""

    @abstractmethod
    def coefficients(self, tuning: Tuning, dt: float) -> Any:
        """Return what the other methods need of the tuning and the sample time [s]."""

    @abstractmethod
    def init(self, e: Array, hold: Array, c: Any) -> Any:
        """Return the state that, while the error is zero, keeps v = `hold` [rad/s^2]."""

    @abstractmethod
    def output(self, e: Array, state: Any, c: Any) -> LawStep:
        """Return v for the error `e` [rad or m] and the state that has taken it in."""

    @abstractmethod
    def correct(self, a: Array, state: Any, c: Any) -> Any:
        """Return the state that knows that v + `a` was applied instead of v (anti-windup)."""


class BumplessState(NamedTuple):
    """State of the bumpless realisation.

    Attributes:
        e: the last error [rad].
        lam: settles on the disturbance acceleration, whatever the gains [rad/s^2].
        chi: settles on its slope [rad/s^3].
        eta: filtered derivative of the error, times its gain [rad/s^2].
    """

    e: Array
    lam: Array
    chi: Array
    eta: Array


class _BumplessCoefficients(NamedTuple):
    proportional: Array  # -beta3
    b: Array  # from the sum of two errors into lam, by itself and by way of chi
    c: Array  # the like into chi
    d: Array  # the like into eta
    decay: Array  # of eta over a sample
    dt: Array  # sample time [s]
    to_lam: Array  # anti-windup gains, times the sample time
    to_chi: Array


class Bumpless(Realisation):
    """Partial fractions of C(s) with the gains inside the integrals.

        v = -(beta3 e + lam + eta)
        lam' = b e + chi            b = (beta1 - beta0 / beta4) / beta4
        chi' = c e                  c = beta0 / beta4
        eta' = -beta4 eta + d e     d = (-beta3 beta4^3 + beta2 beta4^2 - beta1 beta4 + beta0) / beta4^2

    Three bounded states for a third-order C(s); while e = 0, changing a gain changes nothing.
    """

    def coefficients(self, tuning: Tuning, dt: float) -> _BumplessCoefficients:
        """Return the coefficients of the trapezoidal rule; see :meth:`Realisation.coefficients`."""
        beta0, beta1, beta2, beta3, beta4 = betas(tuning)
        half = 0.5 * dt
        stiff = 1.0 / (1.0 + half * beta4)
        omega = tuning.omega_c
        return _BumplessCoefficients(
            proportional=-beta3,
            b=half * (beta1 - beta0 / beta4) / beta4 + half * half * beta0 / beta4,
            c=half * beta0 / beta4,
            d=half * stiff * (((-beta3 * beta4 + beta2) * beta4 - beta1) * beta4 + beta0) / (beta4 * beta4),
            decay=stiff * (1.0 - half * beta4),
            dt=np.array(dt),
            # Back-calculation on both integrators: on lam alone it diverges for fast loops.
            to_lam=3.0 * dt * omega,
            to_chi=2.0 * dt * omega * omega,
        )

    def init(self, e: Array, hold: Array, c: _BumplessCoefficients) -> BumplessState:
        """Return the state at rest; see :meth:`Realisation.init`."""
        zero = np.zeros_like(e + hold)
        # The mirrored error makes the first trapezoid, which lies before the start, empty.
        return BumplessState(e=-e, lam=zero - hold, chi=zero, eta=zero)

    def output(self, e: Array, state: BumplessState, c: _BumplessCoefficients) -> LawStep:
        """Return v and the next state; see :meth:`Realisation.output`."""
        both = e + state.e
        # lam' = b e + chi by the trapezoidal rule, with the new chi put in.
        lam = state.lam + c.dt * state.chi + c.b * both
        chi = state.chi + c.c * both
        eta = c.decay * state.eta + c.d * both
        return LawStep(c.proportional * e - lam - eta, BumplessState(e, lam, chi, eta))

    def correct(self, a: Array, state: BumplessState, c: _BumplessCoefficients) -> BumplessState:
        """Return the corrected state; see :meth:`Realisation.correct`."""
        e, lam, chi, eta = state
        return BumplessState(e, lam - c.to_lam * a, chi - c.to_chi * a, eta)


class PaperState(NamedTuple):
    """State of the printed realisation: the integrals of eqs. 14 and 17.

    Attributes:
        e: the last error [rad].
        v: the last applied virtual acceleration [rad/s^2].
        int_v: integral of v, the reconstructed velocity error [rad/s].
        int_e: integral of e [rad s].
        int2_e: second integral of e [rad s^2].
        int3_e: third integral of e [rad s^3].
    """

    e: Array
    v: Array
    int_v: Array
    int_e: Array
    int2_e: Array
    int3_e: Array


class _PaperCoefficients(NamedTuple):
    beta0: Array
    beta1: Array
    beta2: Array
    beta3: Array
    beta4: Array
    half: float  # half a sample [s]
    solve: Array  # 1 / (1 + half beta4): v stands on both sides of the trapezoidal rule


class Paper(Realisation):
    """The law as printed: v = -beta4 int(v) - beta3 e - beta2 int(e) - beta1 int2(e) - beta0 int3(e).

    Four integrators for a third-order C(s): the hidden mode lets int(v) and int3(e) grow without bound,
    cancelling each other in v. Under gains that change they no longer cancel.
    """

    def coefficients(self, tuning: Tuning, dt: float) -> _PaperCoefficients:
        """Return the coefficients of the trapezoidal rule; see :meth:`Realisation.coefficients`."""
        half = 0.5 * dt
        gains = betas(tuning)
        return _PaperCoefficients(*gains, half=half, solve=1.0 / (1.0 + half * gains.beta4))

    def init(self, e: Array, hold: Array, c: _PaperCoefficients) -> PaperState:
        """Return the state at rest; see :meth:`Realisation.init`."""
        zero = np.zeros_like(e + hold)
        # With int2_e at this value int3_e grows so that it cancels int_v, and v stays at `hold`.
        return PaperState(
            e=-e,
            v=c.beta3 * e - hold,
            int_v=hold * (c.beta1 / c.beta0 - 1.0 / c.beta4),
            int_e=zero,
            int2_e=-hold * c.beta4 / c.beta0,
            int3_e=2.0 * c.half * hold * c.beta4 / c.beta0,
        )

    def output(self, e: Array, state: PaperState, c: _PaperCoefficients) -> LawStep:
        """Return v and the next state; see :meth:`Realisation.output`."""
        int_e = state.int_e + c.half * (state.e + e)
        int2_e = state.int2_e + c.half * (state.int_e + int_e)
        int3_e = state.int3_e + c.half * (state.int2_e + int2_e)
        int_v = state.int_v + c.half * state.v
        v = -c.solve * (  # eq. 17
            c.beta4 * int_v + c.beta3 * e + c.beta2 * int_e + c.beta1 * int2_e + c.beta0 * int3_e
        )
        return LawStep(v, PaperState(e, v, int_v + c.half * v, int_e, int2_e, int3_e))

    def correct(self, a: Array, state: PaperState, c: _PaperCoefficients) -> PaperState:
        """Return the state whose reconstructor (eq. 14) integrates what was applied."""
        return state._replace(v=state.v + a, int_v=state.int_v + c.half * a)


REALISATIONS: dict[str, Realisation] = {"bumpless": Bumpless(), "paper": Paper()}
