"""B-spline networks that adapt the tuning of a GPI controller on line (eqs. 22-23, Figure 3)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import (
    Array,
    PerJointInput,
    as_float_array,
    check_number,
    not_negative,
    per_joint,
    positive,
)
from armgpi.control.controller import common_batch
from armgpi.control.gains import Gains, GainStep, Tuning
from armgpi.control.splines import BSplineBasis
from armgpi.errors import ArrayError, ParameterError

#: Lowest and highest value of a tuning parameter; one number for one that does not adapt.
Box = PerJointInput | tuple[PerJointInput, PerJointInput]


class NetworkState(NamedTuple):
    """State of the networks.

    Attributes:
        weights: for every adapted parameter its weights, as many as basis functions, each (..., n).
        activations: values of the basis functions at the last sample, each (..., n).
        filtered: low-passed error, whose distance from the error is the filtered derivative [rad].
        tuning: the tuning used last.
    """

    weights: tuple[tuple[Array, ...], ...]
    activations: tuple[Array, ...]
    filtered: Array
    tuning: Tuning


class BSplineNetwork(Gains):
    """One network per joint and tuning parameter: y = nominal + a w, w learned at every sample.

    The activations a are B-spline functions of the tracking error and of its filtered derivative, both
    clipped to a range. The weights w start at zero, so a network that does not learn is
    :class:`FixedGains`. The functions are even in their inputs: by default two of third order for each.

    ``learning="magnitude"``: the weights follow w += l e_n a / (a a) (eq. 23). The aim of a parameter rises
    from the lower to the upper end of its box as the size of the error passes a dead zone; e_n is what y is
    short of the aim, less a leak that forgets. So a gain rises fast while the error is large and falls back
    slowly when it is not.
    Outputs are projected onto the box, and omega_c moves no faster than rate omega_c^2 per second, which
    is what one quadratic Lyapunov function can certify. While the torque is cut, or a measurement is no
    number, nothing is learned.

    ``learning="signed"``: eq. 23 to the letter, e_n = e, without box, dead zone or rate limit.

    Attributes:
        learning: "magnitude" or "signed".
        size: number of basis functions.
        boxes: once prepared, the lower and upper end of every tuning parameter by its name.
    """

    boxes: Mapping[str, tuple[Array, Array]]

    def __init__(
        self,
        omega_c: Box = (22.0, 60.0),
        zeta_c: Box = 0.75,
        p_c: Box | None = None,
        learning: str = "magnitude",
        learning_rate: PerJointInput = 0.2,
        error_range: PerJointInput = 1e-4,
        derivative_range: PerJointInput = 1.0,
        dead_zone: PerJointInput = 2e-4,
        leak: float = 5.0,
        rate: PerJointInput = math.inf,
        bandwidth: float = 60.0,
        knots: Sequence[float] | None = None,
        order: int = 3,
    ) -> None:
        """Define the networks; per-joint quantities are numbers or arrays (n,) or (batch, n).

        Args:
            omega_c: box of the natural frequency [rad/s]; its lower end is the nominal value.
            zeta_c: box of the damping ratio, or one value.
            p_c: box of the real pole [rad/s], or one value; follows omega_c when not given.
            learning: "magnitude" or "signed".
            learning_rate: l of eq. 23, per sample; in [0, 2) for "magnitude", where normalised LMS is stable.
            error_range: error at which the aim reaches the upper end; end of the input's range [rad or m].
            derivative_range: end of the range of the error's filtered derivative [rad/s or m/s].
            dead_zone: error that raises no gain, such as two encoder steps [rad or m].
            leak: how fast what was learned is forgotten [1/s].
            rate: rho in the limit |d omega/dt| <= rho omega^2; infinite for none.
            bandwidth: of the derivative's filter [rad/s].
            knots: symmetric knots over inputs scaled to [-1, 1]; when not given, two functions per input.
            order: order of the functions.

        Raises:
            ParameterError: for a bad learning rule, rate or bandwidth.
            ArrayError: for bad knots.
        """
        if learning not in ("magnitude", "signed"):
            raise ParameterError("learning", learning, "one of magnitude, signed")
        rates = as_float_array(learning_rate, "learning_rate")
        if (rates < 0.0).any():
            raise ParameterError("learning_rate", float(rates.min()), "zero or positive")
        if learning == "magnitude" and (rates >= 2.0).any():
            raise ParameterError(
                "learning_rate", float(rates.max()), "below 2, where normalised LMS is stable"
            )
        self.learning_rate = learning_rate
        self.leak = check_number(leak, "leak", "zero or positive [1/s]")
        self.rate = None if np.ndim(rate) == 0 and rate == math.inf else rate
        if self.rate is not None and not (as_float_array(self.rate, "rate") > 0.0).all():
            raise ParameterError("rate", rate, "positive")
        self.bandwidth = check_number(bandwidth, "bandwidth", "positive [rad/s]", open_=True)
        self.omega_c, self.zeta_c, self.p_c = omega_c, zeta_c, p_c
        self.learning = learning
        self.error_range, self.derivative_range, self.dead_zone = error_range, derivative_range, dead_zone
        if knots is None:
            # Four functions on [-1, 1], folded into two even ones.
            knots = [-1, -1, -1, 0, 1, 1, 1]
            if order != 3:
                raise ParameterError("order", order, "3 with the default knots; give knots as well")
        self.basis = BSplineBasis(knots, order)
        mirrored = -self.basis.knots[::-1]
        if np.allclose(self.basis.knots, mirrored, rtol=0.0, atol=1e-12 * self.basis.knots[-1]):
            # But for rounding, as numpy.linspace makes them.
            self.basis = BSplineBasis(0.5 * (self.basis.knots + mirrored), order)
        else:
            raise ArrayError("knots", f"expected knots symmetric about 0, got {self.basis.knots}")
        self.size = 2 * ((self.basis.size + 1) // 2)

    def prepare(self, joint_names: Sequence[str], dt: float) -> BSplineNetwork:
        """Return the networks as arrays over the joints.

        Raises:
            ArrayError: when a value is not positive, a box is upside down or a shape does not fit.
            ParameterError: when the filter is too fast for the sample time.
        """
        if self.bandwidth * dt >= 1.0:
            raise ParameterError("bandwidth", self.bandwidth, f"below 1 / dt = {1.0 / dt:g} rad/s")
        highest = float(np.max(self.learning_rate))
        if self.learning == "magnitude" and highest + self.leak * dt >= 2.0:
            raise ParameterError("leak", self.leak, f"below {(2.0 - highest) / dt:g} 1/s at this dt")
        ready = object.__new__(BSplineNetwork)
        ready.__dict__.update(self.__dict__)
        names = joint_names
        boxes = {name: _box(getattr(self, name), name, names) for name in ("omega_c", "zeta_c")}
        boxes["p_c"] = boxes["omega_c"] if self.p_c is None else _box(self.p_c, "p_c", names)
        ready.boxes = boxes
        ready._lower = Tuning(*(boxes[name][0] for name in Tuning._fields))
        ready._upper = Tuning(*(boxes[name][1] for name in Tuning._fields))
        ready._adapted = tuple(
            name
            for name in Tuning._fields
            if (boxes[name][1] > boxes[name][0]).any() and not (name == "p_c" and self.p_c is None)
        )
        ready._error_range, ready._derivative_range = (
            per_joint(getattr(self, name), name, names, "positive", positive)
            for name in ("error_range", "derivative_range")
        )
        ready._per_error, ready._per_derivative = 1.0 / ready._error_range, 1.0 / ready._derivative_range
        ready._dead_zone, ready._learning_rate = (
            per_joint(getattr(self, name), name, names, "zero or positive", not_negative)
            for name in ("dead_zone", "learning_rate")
        )
        ready._rate = None
        if self.learning == "magnitude" and self.rate is not None:
            ready._rate = per_joint(self.rate, "rate", names, "positive", positive)
        ready._dt = dt
        # Share forgotten in a sample; what learns nothing forgets nothing.
        ready._leak = np.where(ready._learning_rate > 0.0, self.leak * dt, 0.0)
        ready.batch = common_batch(
            *ready._lower,
            *ready._upper,
            ready._error_range,
            ready._derivative_range,
            ready._dead_zone,
            ready._learning_rate,
            *(() if ready._rate is None else (ready._rate,)),
        )
        return ready

    def nominal(self) -> Tuning:
        """Return the tuning where the error is small: the lower ends of the boxes."""
        return self._lower

    def init(self, e: Array) -> NetworkState:
        """Return the state before the first sample: nothing learned."""
        zero = np.zeros_like(e)
        weights = ((zero,) * self.size,) * len(self._adapted)
        activations = self.activations(e, zero)
        return NetworkState(weights, activations, e, Tuning(*(zero + low for low in self._lower)))

    def step(self, e: Array, learn: Array, state: NetworkState) -> GainStep:
        """Return the tuning for the tracking error `e`; see :meth:`Gains.step`."""
        # A measurement that is no number teaches nothing, and leaves no trace in the weights.
        sound = np.abs(e) < math.inf
        e, learn = np.where(sound, e, 0.0), np.where(sound, learn, 0.0)
        slope = self.bandwidth * (e - state.filtered)
        filtered = state.filtered + self._dt * slope
        a = self.activations(e, slope)
        power = _dot(a, a)
        magnitude = self.learning == "magnitude"
        if magnitude:
            size = np.minimum(np.maximum(np.abs(e) - self._dead_zone, 0.0) * self._per_error, 1.0)
        tuning, weights = {}, []
        for name, old in zip(self._adapted, state.weights, strict=True):
            low, high = getattr(self._lower, name), getattr(self._upper, name)
            raised = _dot(a, old)
            if magnitude:
                short = np.maximum((high - low) * size - raised, 0.0)
                change = learn * (self._learning_rate * short - self._leak * raised)
            else:
                change = learn * (self._learning_rate * e)
            gain = change / power  # eq. 23
            weights.append(tuple([w + gain * x for w, x in zip(old, a, strict=True)]))
            output = low + (raised + change)  # eq. 22 with the new weights: a a cancels
            tuning[name] = np.minimum(np.maximum(output, low), high) if magnitude else output
        whole = self._limited(tuning, state.tuning)
        return GainStep(whole, NetworkState(tuple(weights), a, filtered, whole))

    def activations(self, e: Array, slope: Array) -> tuple[Array, ...]:
        """Return the basis functions of the error [rad] and of its filtered derivative [rad/s]."""
        return (*self.basis.even(e * self._per_error), *self.basis.even(slope * self._per_derivative))

    def signals(self, state: NetworkState) -> Mapping[str, Array]:
        """Return tuning, weights and activations under their names."""
        named: dict[str, Array] = dict(state.tuning._asdict())
        named.update({f"activation_{i + 1}": a for i, a in enumerate(state.activations)})
        for name, weights in zip(self._adapted, state.weights, strict=True):
            named.update({f"{name}_weight_{i + 1}": weight for i, weight in enumerate(weights)})
        return named

    def describe(self) -> Mapping[str, Any]:
        """Return the parameters as plain data."""
        boxes = {
            name: [low.tolist(), high.tolist()]
            for name, low, high in zip(Tuning._fields, self._lower, self._upper, strict=True)
        }
        return {
            **boxes,
            "learning": self.learning,
            "learning_rate": self._learning_rate.tolist(),
            "leak": self.leak,
            "rate": None if self._rate is None else self._rate.tolist(),
            "bandwidth": self.bandwidth,
            "error_range": self._error_range.tolist(),
            "derivative_range": self._derivative_range.tolist(),
            "dead_zone": self._dead_zone.tolist(),
            "knots": self.basis.knots.tolist(),
            "order": self.basis.order,
        }

    def _limited(self, tuning: Mapping[str, Array], last: Tuning) -> Tuning:
        """Return a whole tuning, omega_c within its rate limit, what is not adapted as it was."""
        omega = tuning.get("omega_c", last.omega_c)
        if self._rate is not None:
            most = self._dt * self._rate * last.omega_c * last.omega_c
            omega = last.omega_c + np.minimum(np.maximum(omega - last.omega_c, -most), most)
        p = omega if self.p_c is None else tuning.get("p_c", last.p_c)
        return Tuning(omega, tuning.get("zeta_c", last.zeta_c), p)

    _lower: Tuning
    _upper: Tuning
    _adapted: tuple[str, ...]
    _error_range: Array
    _derivative_range: Array
    _dead_zone: Array
    _per_error: Array
    _per_derivative: Array
    _learning_rate: Array
    _rate: Array | None
    _dt: float
    _leak: Array


def _box(value: Any, name: str, joint_names: Sequence[str]) -> tuple[Array, Array]:
    """Return the lower and upper end of a parameter's box."""
    ends = value if isinstance(value, tuple) else (value, value)
    if len(ends) != 2:
        raise ParameterError(name, value, "a number or (lower, upper)")
    low, high = (per_joint(end, name, joint_names, "positive", positive) for end in ends)
    if (low > high).any():
        raise ArrayError(name, f"expected lower <= upper, got {low.tolist()} above {high.tolist()}")
    return low, high


def _dot(a: Sequence[Array], w: Sequence[Array]) -> Array:
    """Return the sum of products of activations and weights."""
    total = a[0] * w[0]
    for x, weight in zip(a[1:], w[1:], strict=True):
        total = total + x * weight
    return total
