"""Two discrete realisations of the GPI law, the paper's and one without its hidden mode.

Both hold v = -C(s) e with C(s) = (beta3 s^3 + beta2 s^2 + beta1 s + beta0) / (s^2 (s + beta4)), the law of
eqs. 14 and 17, and both replace every integral by the trapezoidal rule, so under constant gains they are
the same filter. They differ in their states, and therefore under gains that change.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import Array, new
from armgpi.control.gains import Tuning, betas


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

    @abstractmethod
    def output(self, e: Array, state: Any, c: Any) -> Array:
        """Return v [rad/s^2 or m/s^2] for the error `e` [rad or m]."""

    @abstractmethod
    def update(self, e: Array, v: Array, a: Array | None, state: Any, c: Any) -> Any:
        """Return the next state, after v was asked for and v + `a` applied (anti-windup); None means v."""


class BumplessState(NamedTuple):
    """State of the bumpless realisation.

    Attributes:
        lam: settles on the disturbance acceleration, whatever the gains [rad/s^2].
        chi: settles on its slope [rad/s^3].
        eta: filtered derivative of the error, times its gain [rad/s^2].
    """

    lam: Array
    chi: Array
    eta: Array


class _BumplessCoefficients(NamedTuple):
    direct: Array  # from the error into v
    lam: Array  # from the error into lam, by itself and by way of chi
    chi: Array
    eta: Array
    decay: Array  # of eta over a sample
    dt: Array  # sample time [s]
    back_lam: Array  # anti-windup, times the sample time
    back_chi: Array


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
        c = beta0 / beta4
        b = (beta1 - c) / beta4
        d = beta2 - beta3 * beta4 - b
        half = 0.5 * dt
        shrunk = half * beta4
        decay = (1.0 - shrunk) / (1.0 + shrunk)
        filtered = half * d / (1.0 + shrunk)
        back = dt * tuning.omega_c
        return _BumplessCoefficients(
            direct=-(beta3 + half * (b + half * c) + filtered),
            lam=dt * (b + dt * c),
            chi=dt * c,
            eta=(1.0 + decay) * filtered,
            decay=decay,
            dt=np.array(dt),
            # Back-calculation on both integrators: on lam alone it diverges for fast loops.
            back_lam=3.0 * back,
            back_chi=2.0 * back * tuning.omega_c,
        )

    def init(self, hold: Array, c: _BumplessCoefficients) -> BumplessState:
        """Return the state at rest; see :meth:`Realisation.init`."""
        zero = np.zeros_like(hold)
        return BumplessState(lam=zero - hold, chi=zero, eta=zero)

    def output(self, e: Array, state: BumplessState, c: _BumplessCoefficients) -> Array:
        """Return v; see :meth:`Realisation.output`."""
        return c.direct * e - state.lam - state.eta

    def update(
        self, e: Array, v: Array, a: Array | None, state: BumplessState, c: _BumplessCoefficients
    ) -> BumplessState:
        """Return the next state; see :meth:`Realisation.update`."""
        lam, chi, eta = state
        lam = lam + c.dt * chi + c.lam * e
        chi = chi + c.chi * e
        eta = c.decay * eta + c.eta * e
        if a is not None:
            lam = lam - c.back_lam * a
            chi = chi - c.back_chi * a
        return new(BumplessState, (lam, chi, eta))


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
    beta0: Array
    beta1: Array
    beta2: Array
    beta3: Array
    beta4: Array
    dt: float  # sample time [s]
    half: float  # half of it [s]
    solve: Array  # -1 / (1 + half beta4): v stands on both sides of eq. 17


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
        self, e: Array, v: Array, a: Array | None, state: PaperState, c: _PaperCoefficients
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
