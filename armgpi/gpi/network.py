"""B-spline networks that adapt the tuning of a GPI controller on line (eqs. 22-23, Figure 3)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, PerJointInput, check_type
from armgpi.base.parameter import PerJoint, again, parameter, plain, with_parameters
from armgpi.control.bandwidth import error_scales
from armgpi.control.sizes import batches, common_batch
from armgpi.errors import ArrayError, NameNotFound, ParameterError
from armgpi.gpi.gains import GainStep, Poles, Quadratics, Tuning
from armgpi.gpi.splines import BSplineBasis
from armgpi.gpi.weights import Weights
from armgpi.registry import Context

#: Ends of omega_c's box that an experiment takes, in default bandwidths: 22 and 60 rad/s at 30 rad/s.
_CALM, _ALERT = 22.0 / 30.0, 2.0
#: Lowest and highest value of a tuning parameter; one number for one that does not adapt.
Box = PerJointInput | tuple[PerJointInput, PerJointInput]


class NetworkState(NamedTuple):
    """State of the networks.

    Attributes:
        weights: weights of the basis functions; for every adapted parameter one of each, arrays (..., n).
        activations: values of the basis functions at the last sample [-]; arrays (..., n).
        filtered: low-passed error [rad or m]; its distance from the error is the filtered derivative.
        tuning: the tuning used last.
    """

    weights: tuple[tuple[Array, ...], ...]
    activations: tuple[Array, ...]
    filtered: Array
    tuning: Tuning


@with_parameters
class Boxes(Quadratics):
    """Gains of which the natural frequency moves in a box."""

    omega_c: Box = again(
        "natural frequency; the lower end is the nominal value",
        kind="box",
        default=(22.0, 60.0),
        chosen="from 22/30 of the default bandwidth to twice it",
        slider=(1.0, 200.0),
    )
    zeta_c: Any = again(default=0.75)


@with_parameters
class BSplineNetwork(Boxes, Poles):
    """One network per joint and tuning parameter: y = nominal + a w, w learned at every sample.

    The activations a are B-spline functions of the tracking error and of its filtered derivative, both
    clipped to a range. The weights w start at zero, so a network that does not learn is
    :class:`FixedGains`; or they start at `weights`, which a search found. The functions are even in their
    inputs: by default two of third order for each.

    ``learning="magnitude"``: the weights follow w += l e_n a / (a a) (eq. 23). The aim of a parameter rises
    from the lower to the upper end of its box as the size of the error passes a dead zone; e_n is what y is
    short of the aim, less a leak that forgets, back to the initial weights. So a gain rises fast while the
    error is large and falls back slowly when it is not.
    Outputs are projected onto the box, and omega_c moves no faster than rate omega_c^2 per second, which
    is what one quadratic Lyapunov function can certify. While the torque is saturated, or a measurement is
    NaN, nothing is learned.

    With its defaults this is a gain schedule on the size of the error: in the normalised rule the
    activations cancel. :class:`armgpi.GainSchedule`, without basis functions and weights, does the same to
    2 % of tracking error and 12 % of torque variation (docs, theory: a gain schedule). Weights that were
    trained, or that differ over error and derivative, would be more.

    ``learning="signed"``: eq. 23 to the letter, e_n = e, without box, dead zone or rate limit.

    Attributes:
        learning: "magnitude" or "signed".
        size: number of basis functions.
        boxes: once prepared, the lower and upper end of every tuning parameter by its name.
    """

    config_name: ClassVar[str | None] = "network"
    derived: ClassVar[Mapping[str, str]] = {
        "_per_error": "one over the error from which a gain goes to its upper end [1/rad or 1/m]",
        "_per_derivative": "one over the range of the filtered derivative [s/rad or s/m]",
        "_leak": "share by which weights decay in a sample [-]",
        "_initial": "initial weights of the basis functions [rad/s or -]",
    }

    zeta_c: Box = again(kind="box", default=0.75)
    p_c: Box | None = again(kind="box", default=None, none="follows omega", slider=(1.0, 200.0))
    learning: str = parameter(
        "rule of learning; signed is eq. 23 to the letter",
        kind="choice",
        default="magnitude",
        choices=("magnitude", "signed"),
        structural=True,
    )
    learning_rate: PerJoint = parameter(
        "l of eq. 23, per sample; below 2 for magnitude, where normalised LMS is stable",
        default=0.2,
        least=0.0,
        per_joint=True,
        search=(0.01, 1.0),
        slider=(0.0, 1.0),
    )
    error_range: PerJoint = parameter(
        "error from which a gain goes to its upper end",
        unit="rad or m",
        default=1e-4,
        least=0.0,
        above=True,
        per_joint=True,
        chosen="one encoder count; one of 22 bits without encoder",
        log=True,
        search=(1e-6, 1e-2),
    )
    derivative_range: PerJoint = parameter(
        "end of the range of the error's filtered derivative",
        unit="rad/s or m/s",
        default=1.0,
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
        search=(0.01, 100.0),
    )
    dead_zone: PerJoint = parameter(
        "error that does not raise the gain, such as two encoder counts",
        unit="rad or m",
        default=2e-4,
        least=0.0,
        per_joint=True,
        chosen="two encoder counts; 0 without encoder",
        log=True,
        search=(1e-6, 1e-2),
    )
    leak: float = parameter(
        "rate at which the weights decay", unit="1/s", default=5.0, least=0.0, search=(0.1, 50.0)
    )
    rate: PerJoint = parameter(
        "largest rho, where abs(d omega/dt) <= rho omega^2",
        default=math.inf,
        unlimited="no limit",
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
        search=(0.01, 10.0),
    )
    common: bool = parameter(
        "one omega for all joints, whose rate can be certified: the largest that a joint needs",
        kind="flag",
        default=False,
        structural=True,
    )
    bandwidth: float = parameter(
        "bandwidth of the derivative's filter",
        unit="rad/s",
        default=60.0,
        least=0.0,
        above=True,
        log=True,
        search=(10.0, 500.0),
    )
    knots: Sequence[float] | None = parameter(
        "symmetric knots of the basis functions over inputs scaled to [-1, 1]",
        kind="numbers",
        default=None,
        none="two functions per input",
        structural=True,
    )
    order: int = parameter(
        "order of the basis functions", kind="integer", default=3, least=1, structural=True
    )
    weights: Any = parameter(
        "initial weights of the basis functions, to which the leak returns",
        kind="group",
        group=Weights,
        default=None,
        none="zero",
    )

    def __post_init__(self) -> None:
        """Check what does not depend on the joints, and make the basis functions.

        Raises:
            ParameterError: for a bad learning rule, rate or bandwidth.
            ArrayError: for bad knots.
        """
        super().__post_init__()
        self.check_parameters(only=lambda each: each.name in ("learning_rate", "rate"))
        if self.learning == "magnitude" and (self.learning_rate >= 2.0).any():
            worst = float(self.learning_rate.max())
            raise ParameterError("learning_rate", worst, "below 2, where normalised LMS is stable")
        knots = self.knots
        if knots is None:
            # Four functions on [-1, 1], folded into two even ones.
            knots = [-1, -1, -1, 0, 1, 1, 1]
            if self.order != 3:
                raise ParameterError("order", self.order, "3 with the default knots; give knots as well")
        self.basis = BSplineBasis(knots, self.order)
        in_order = self.basis.knots
        mirrored = -in_order[::-1]
        rounding = 1e-12 * in_order[-1]  # as numpy.linspace makes them
        if not np.allclose(in_order, mirrored, rtol=0.0, atol=rounding):
            raise ArrayError("knots", f"expected knots symmetric about 0, got {in_order}")
        self.basis = BSplineBasis(0.5 * (in_order + mirrored), self.order)
        self.size = 2 * ((self.basis.size + 1) // 2)
        if isinstance(self.weights, Mapping):
            names = set(map(str, self.weights))
            unknown = sorted(names - set(Tuning._fields))
            if unknown:
                raise NameNotFound("parameter of a network", unknown[0], Tuning._fields)
            self.keep("weights", Weights(**self.weights))
        check_type(self.weights, "weights", Weights | None, "Weights, or a mapping of tuning parameters")

    def prepare(self, joint_names: Sequence[str], dt: float) -> BSplineNetwork:
        """Return the networks as arrays over the joints; see :meth:`Gains.prepare`.

        Raises:
            ArrayError: when a value is not positive, a box is upside down or a shape does not fit.
            ParameterError: when the filter is too fast for the sample time.
        """
        fastest = float(np.max(self.bandwidth))
        if fastest * dt >= 1.0:
            raise ParameterError("bandwidth", fastest, f"below 1 / dt = {1.0 / dt:g} rad/s")
        highest = float(np.max(self.learning_rate))
        leak = float(np.max(self.leak))
        if self.learning == "magnitude" and highest + leak * dt >= 2.0:
            raise ParameterError("leak", leak, f"below {(2.0 - highest) / dt:g} 1/s at this dt")
        ready = object.__new__(BSplineNetwork)
        ready.__dict__.update(self.__dict__)
        ready.check_parameters(joint_names)
        if self.weights is not None:
            ready.keep("weights", self.weights.with_values())
            ready.weights.check_parameters(joint_names)
        ready._derive(dt)
        return ready

    def _derive(self, dt: float) -> None:
        """Work out what `step` needs.

        Raises:
            ArrayError: when there are weights for what does not adapt, or not one for each basis function.
        """
        boxes: dict[str, Any] = {"omega_c": self.omega_c, "zeta_c": self.zeta_c}
        boxes["p_c"] = self.omega_c if self.p_c is None else self.p_c
        self.boxes: Mapping[str, tuple[Array, Array]] = boxes
        self._lower = Tuning(*(boxes[name][0] for name in Tuning._fields))
        self._upper = Tuning(*(boxes[name][1] for name in Tuning._fields))
        self._adapted = tuple(
            name
            for name in Tuning._fields
            if _adapts(*boxes[name]) and not (name == "p_c" and self.p_c is None)
        )
        self._per_error = 1.0 / self.error_range
        self._per_derivative = 1.0 / self.derivative_range
        if self.common:
            self._check_common()
        limited = self.learning == "magnitude" and not np.all(np.isinf(self.rate))
        self._rate = self.rate if limited else None
        self._dt = dt
        # Share forgotten in a sample; what learns nothing forgets nothing.
        self._leak = np.where(self.learning_rate > 0.0, self.leak * dt, 0.0)
        initial = []
        for name in Tuning._fields:
            weights = getattr(self.weights, name, None)
            if name in self._adapted:
                initial.append(self._weights_of(name, weights))
            elif weights is not None:
                raise ArrayError("weights", f"{name} does not adapt: give it a box, or no weights")
        self._initial = tuple(initial)
        of_first_function = [weights[0] for weights in initial if weights is not None]
        self.batch = common_batch(*batches(self), *of_first_function)

    def _check_common(self) -> None:
        """Refuse what one omega for all joints is not defined for.

        Raises:
            ParameterError: for another rule of learning, a rate or box that differs between the joints, or
                another parameter that adapts.
        """
        if self.learning != "magnitude":
            raise ParameterError("learning", self.learning, "magnitude with one omega for all joints")
        if not np.isfinite(self.rate).all() or np.ptp(self.rate):
            raise ParameterError("rate", plain(self.rate), "one finite number with one omega for all joints")
        for name, ends in self.boxes.items():
            if any(np.ptp(end) for end in ends):
                raise ParameterError(name, plain(ends), "the same for all joints with one omega for them")
        if self._adapted != ("omega_c",) or self.p_c is not None:
            raise ParameterError("common", True, "omega_c alone to adapt, and p_c to follow it")

    def bandwidths(self) -> Array:
        """Return the values that a common omega takes [rad/s]: 1 / omega moves in steps of rate dt."""
        longest = 1.0 / float(self._lower.omega_c[0])  # time constants [s]
        shortest = 1.0 / float(self._upper.omega_c[0])
        step = self._dt * float(self.rate[0])
        count = math.floor((longest - shortest) / step + 1e-9)
        time_constants = longest - step * np.arange(count + 1)
        return np.asarray(1.0 / time_constants)

    def _weights_of(self, name: str, weights: Array | None) -> tuple[Array, ...] | None:
        """Return the initial weights of a parameter, one array (n,) or (batch, n) for each basis function."""
        if weights is None:
            return None
        if weights.shape[-1] != self.size:
            raise ArrayError(
                "weights",
                f"expected {self.size} numbers for {name}, one each, got {weights.shape[-1]}",
            )
        by_function = np.moveaxis(weights, -1, 0)
        return tuple(np.ascontiguousarray(weight) for weight in by_function)

    @classmethod
    def chosen(cls, context: Context) -> dict[str, Any]:
        """Return a box around the default bandwidth, and scales from encoders; see :meth:`Gains.chosen`."""
        omega = (context.omega_c * _CALM, context.omega_c * _ALERT)
        return {"omega_c": omega, **error_scales(context)}

    def nominal(self) -> Tuning:
        """Return the tuning where the error is small: the lower ends of the boxes, and what weights add."""
        if self.weights is None:
            return self._lower
        zero = np.zeros_like(self._lower.omega_c)
        return self._first(self.activations(zero, zero), zero)

    def init(self, e: Array) -> NetworkState:
        """Return the state before the first sample, nothing learned; see :meth:`Gains.init`."""
        zero = np.zeros_like(e)
        weights = []
        for initial in self._initial:
            if initial is None:
                weights.append((zero,) * self.size)
            else:
                weights.append(tuple(zero + w for w in initial))
        activations = self.activations(e, zero)
        return NetworkState(tuple(weights), activations, e, self._first(activations, zero))

    def _first(self, a: Sequence[Array], zero: Array) -> Tuning:
        """Return the tuning that the initial weights give at some activations, in the shape of `zero`."""
        tuning = {name: zero + low for name, low in self._lower._asdict().items()}
        for name, initial in zip(self._adapted, self._initial, strict=True):
            if initial is not None:
                tuning[name] = self._project(name, tuning[name] + _dot(a, initial))
        if self.p_c is None:
            tuning["p_c"] = tuning["omega_c"]
        return Tuning(**tuning)

    def _project(self, name: str, output: Array) -> Array:
        """Return the output of a network, inside its box where the rule has one."""
        if self.learning == "signed":
            return output
        low = getattr(self._lower, name)
        high = getattr(self._upper, name)
        inside: Array = np.minimum(np.maximum(output, low), high)
        return inside

    def step(self, e: Array, learn: Array, state: NetworkState) -> GainStep:
        """Return the tuning for the tracking error `e`; see :meth:`Gains.step`."""
        # A NaN measurement teaches nothing, and leaves no trace in the weights.
        sound = np.abs(e) < math.inf
        e = np.where(sound, e, 0.0)
        learn = np.where(sound, learn, 0.0)
        slope = self.bandwidth * (e - state.filtered)
        filtered = state.filtered + self._dt * slope
        a = self.activations(e, slope)
        power = _dot(a, a)
        magnitude = self.learning == "magnitude"
        if magnitude:
            beyond = np.maximum(np.abs(e) - self.dead_zone, 0.0)
            size = np.minimum(beyond * self._per_error, 1.0)
        tuning = {}
        weights = []
        for name, old, initial in zip(self._adapted, state.weights, self._initial, strict=True):
            low = getattr(self._lower, name)
            high = getattr(self._upper, name)
            raised = _dot(a, old)
            if magnitude:
                short = np.maximum((high - low) * size - raised, 0.0)
                learned = raised if initial is None else raised - _dot(a, initial)
                change = learn * (self.learning_rate * short - self._leak * learned)
            else:
                change = learn * (self.learning_rate * e)
            gain = change / power  # eq. 23
            weights.append(tuple([w + gain * x for w, x in zip(old, a, strict=True)]))
            output = low + (raised + change)  # eq. 22 with the new weights: a a cancels
            tuning[name] = self._project(name, output)
        whole = self._limit_rate(tuning, state.tuning)
        return GainStep(whole, NetworkState(tuple(weights), a, filtered, whole))

    def activations(self, e: Array, slope: Array) -> tuple[Array, ...]:
        """Return the basis functions of the error and of its derivative (eq. 22).

        Args:
            e: tracking error [rad or m], shape (n,) or (batch, n).
            slope: its filtered derivative [rad/s or m/s], same shape.

        Returns:
            The activations [-], those of the error first, each of the same shape.
        """
        of_error = self.basis.even(e * self._per_error)
        of_slope = self.basis.even(slope * self._per_derivative)
        return (*of_error, *of_slope)

    def signals(self, state: NetworkState) -> Mapping[str, Array]:
        """Return tuning, weights and activations under their names; see :meth:`Gains.signals`."""
        named: dict[str, Array] = dict(state.tuning._asdict())
        for i, activation in enumerate(state.activations):
            named[f"activation_{i + 1}"] = activation
        for name, weights in zip(self._adapted, state.weights, strict=True):
            for i, weight in enumerate(weights):
                named[f"{name}_weight_{i + 1}"] = weight
        return named

    def describe(self) -> Mapping[str, Any]:
        """Return the parameters as plain data."""
        boxes = {}
        for name, (low, high) in self.boxes.items():
            boxes[name] = [low.tolist(), high.tolist()]
        rate = None if self._rate is None else self._rate.tolist()
        return {**self.values(), **boxes, "rate": rate, "knots": self.basis.knots.tolist()}

    def _limit_rate(self, tuning: Mapping[str, Array], last: Tuning) -> Tuning:
        """Return a whole tuning, omega_c within its rate limit, what is not adapted as it was."""
        omega = tuning.get("omega_c", last.omega_c)
        if self.common:
            omega = self._common(omega, last.omega_c)
        elif self._rate is not None:
            most = self._dt * self._rate * last.omega_c * last.omega_c
            change = np.maximum(omega - last.omega_c, -most)
            omega = last.omega_c + np.minimum(change, most)
        p = omega if self.p_c is None else tuning.get("p_c", last.p_c)
        return Tuning(omega, tuning.get("zeta_c", last.zeta_c), p)

    def _common(self, omega: Array, last: Array) -> Array:
        """Return the next of :meth:`bandwidths`, one step at most towards what a joint asks for."""
        most = omega[..., :1]
        for joint in range(1, omega.shape[-1]):
            most = np.maximum(most, omega[..., joint : joint + 1])
        longest = 1.0 / self._lower.omega_c  # time constant [s]
        step = self._dt * self.rate
        place = np.rint((longest - 1.0 / last) / step)
        goal = np.floor((longest - 1.0 / most) / step + 1e-9)
        move = np.minimum(np.maximum(goal - place, -1.0), 1.0)
        following: Array = 1.0 / (longest - step * (place + move))
        return following


def _adapts(low: Array, high: Array) -> bool:
    """Tell whether a box leaves room; one whose ends were given for each rollout was declared to."""
    if low is high:
        return False
    is_per_rollout = low.ndim == 2 or high.ndim == 2
    return is_per_rollout or bool((high > low).any())


def _dot(a: Sequence[Array], w: Sequence[Array]) -> Array:
    """Return the sum of products of activations and weights."""
    total = a[0] * w[0]
    for activation, weight in zip(a[1:], w[1:], strict=True):
        total = total + activation * weight
    return total
