"""The two realisations of C(s), through the controller: on a level sled of 1 kg the force is v itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from machines import sled
from scipy import signal

from armgpi import GPI, FixedGains, Gains, Measurement, Target, Tuning
from armgpi.gpi.family import Member
from armgpi.gpi.gains import GainStep
from armgpi.gpi.realisation import Bumpless, Resting

Array = npt.NDArray[np.float64]

REALISATIONS = ("bumpless", "paper")
SLED, LIFT = sled(), sled(axis="0 0 1")
ORIGIN = Target(*np.zeros((3, 1)))
DT = 1e-3

both = pytest.mark.parametrize("realisation", REALISATIONS)
factors = st.floats(0.2, 5.0)


@st.composite
def tunings(draw: st.DrawFn) -> tuple[float, float, float]:
    """omega_c, zeta_c, p_c of loops that a millisecond suits."""
    omega = draw(st.floats(2.0, 60.0))
    return omega, draw(st.floats(0.3, 2.0)), omega * draw(factors)


def printed_law(tuning: tuple[float, float, float]) -> tuple[Array, Array]:
    """Return numerator and denominator of C(s), eqs. 14 and 17, with the polynomial of eq. 24."""
    w, z, p = tuning
    pair = [1.0, 2.0 * z * w, w * w]
    _, b4, *numerator = np.polymul(np.polymul(pair, pair), [1.0, p])
    return np.array(numerator), np.array([1.0, b4, 0.0, 0.0])


def law(realisation: str, gains: Gains, **options: Any) -> GPI:
    """Return the controller whose force is v."""
    options = {"start": "zero", **options}
    return GPI(options.pop("robot", SLED), DT, gains, realisation=realisation, effort=1e15, **options)


def sample(controller: GPI, e: float, state: Any) -> tuple[float, Any]:
    """Return v for the error `e`, and the next state."""
    v, state = controller.step(Measurement(np.array([e])), ORIGIN, state)
    return float(v[0]), state


def response(controller: GPI, errors: Array) -> Array:
    """Return v for a sequence of errors."""
    state = controller.init(Measurement(errors[:1]), ORIGIN)
    out = np.empty_like(errors)
    for k, e in enumerate(errors):
        out[k], state = sample(controller, e, state)
    return out


def state_space(controller: GPI) -> tuple[Array, Array, Array, float]:
    """Return A, B, C, D of the sampled law from e to v, found by trying unit states and a unit error."""
    rest = controller.init(Measurement(np.zeros(1)), ORIGIN)
    order = len(rest.law)

    def try_out(x: Array, e: float) -> Array:
        state = rest._replace(law=type(rest.law)(*x[:, None]))
        v, state = sample(controller, e, state)
        return np.append(np.ravel(state.law), v)

    columns = [try_out(unit, 0.0) for unit in np.eye(order)] + [try_out(np.zeros(order), 1.0)]
    whole = np.array(columns).T
    return whole[:-1, :-1], whole[:-1, -1], whole[-1, :-1], float(whole[-1, -1])


@both
@given(tuning=tunings(), angle=st.floats(0.05, 3.0), size=st.floats(1.05, 3.0))
def test_the_law_is_the_printed_one_by_the_trapezoidal_rule(
    realisation: str, tuning: tuple[float, float, float], angle: float, size: float
) -> None:
    A, B, C, D = state_space(law(realisation, FixedGains(*tuning)))
    z = size * np.exp(1j * angle)
    sampled = C @ np.linalg.solve(z * np.eye(len(A)) - A, B) + D
    s = 2.0 / DT * (z - 1.0) / (z + 1.0)  # Tustin
    numerator, denominator = printed_law(tuning)
    # The integrals of the printed form, up to 1 / (z - 1)^3, are larger than their sum: some digits go.
    np.testing.assert_allclose(sampled, -np.polyval(numerator, s) / np.polyval(denominator, s), rtol=1e-10)


@given(tunings())
def test_the_bumpless_law_has_the_poles_of_c_and_the_printed_one_an_integrator_more(
    tuning: tuple[float, float, float],
) -> None:
    half = 0.5 * DT * printed_law(tuning)[1][1]
    filtered = (1.0 - half) / (1.0 + half)
    for realisation, poles in (
        ("bumpless", [filtered, 1.0, 1.0]),
        ("paper", [filtered, 1.0, 1.0, 1.0]),
    ):
        A, *_ = state_space(law(realisation, FixedGains(*tuning)))
        z = np.array([0.3, -0.8, 2.0])[:, None, None]
        # Equal characteristic polynomials (repeated eigenvalues themselves lose half the digits).
        characteristic = np.linalg.det(z * np.eye(len(A)) - A)
        np.testing.assert_allclose(characteristic, np.prod(z - poles, axis=-1)[:, 0], rtol=1e-9)


@both
@pytest.mark.parametrize("tuning", [(5.0, 1.0, 5.0), (20.0, 0.7, 40.0), (60.0, 1.0, 60.0)])
@pytest.mark.parametrize("start", ["zero", "hold"])
def test_random_errors_are_answered_as_scipy_answers_them(
    realisation: str, tuning: tuple[float, float, float], start: str
) -> None:
    errors = np.random.default_rng(1).normal(0.0, 1e-2, 400)
    A, B, C, D, dt = signal.cont2discrete(signal.tf2ss(*printed_law(tuning)), DT, "bilinear")
    _, filtered, _ = signal.dlsim((A, B, C, D, dt), errors)
    weight = 9.81 if start == "hold" else 0.0
    v = response(law(realisation, FixedGains(*tuning), robot=LIFT, start=start), errors)
    expected = weight - filtered[:, 0]
    # The double integrator adds up the rounding of 400 samples, in SciPy as here.
    np.testing.assert_allclose(v, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())


@both
def test_without_an_error_the_start_is_held_whatever_the_gains(realisation: str) -> None:
    for tuning in ((5.0, 1.0, 5.0), (40.0, 0.7, 10.0)):
        held = response(law(realisation, FixedGains(*tuning), robot=LIFT, start="hold"), np.zeros(1000))
        # The printed form holds by two integrals that grow and cancel, rounded at every sample.
        np.testing.assert_allclose(held, 9.81, rtol=0.0 if realisation == "bumpless" else 1e-12)


class Scheduled(Gains):
    """Gains that jump from one tuning to another at a sample: what adaptation does, at its worst."""

    def __init__(self, before: Tuning, after: Tuning, at: int) -> None:
        self.before, self.after, self.at = before, after, at

    def prepare(self, joint_names: Any, dt: float) -> Scheduled:
        return self

    def init(self, e: Array) -> int:
        return 0

    def step(self, e: Array, learn: Array, state: int) -> GainStep:
        return GainStep(self.before if state < self.at else self.after, state + 1)

    def nominal(self) -> Tuning:
        return self.before


@st.composite
def arrays(draw: st.DrawFn) -> Tuning:
    """A tuning as a controller on one joint keeps it."""
    return Tuning(*(np.array([x]) for x in draw(tunings())))


@given(before=arrays(), after=arrays())
def test_a_change_of_gains_at_rest_changes_nothing_in_the_bumpless_law(before: Tuning, after: Tuning) -> None:
    controller = law("bumpless", Scheduled(before, after, at=20), robot=LIFT, start="hold")
    np.testing.assert_array_equal(response(controller, np.zeros(40)), 9.81)


@given(before=arrays(), after=arrays(), seed=st.integers(0, 1000))
def test_gains_that_change_while_the_error_is_zero_move_no_torque_at_that_sample(
    before: Tuning, after: Tuning, seed: int
) -> None:
    # The error passes through zero at sample 30 on a lively way; only a filtered derivative is in motion.
    errors = np.random.default_rng(seed).normal(0.0, 1e-2, 31)
    errors[30] = 0.0
    kept = response(law("bumpless", FixedGains(*before)), errors)
    changed = response(law("bumpless", Scheduled(before, after, at=30)), errors)
    np.testing.assert_array_equal(changed, kept)


def test_a_change_of_gains_at_rest_makes_the_printed_law_jump() -> None:
    slow, fast = (Tuning(*np.array([[w], [1.0], [w]])) for w in (20.0, 25.0))
    controller = law("paper", Scheduled(slow, fast, at=1000), robot=LIFT, start="hold")
    v = response(controller, np.zeros(1001))
    assert abs(v[1000] - v[999]) > 100.0  # [m/s^2], of the 9.81 that are wanted


def a_day(realisation: str) -> tuple[Array, Array]:
    """Return v (k,) and the inner states (k, states), once a minute over 24 hours, of a push that varies.

    The plant is a double integrator stepped exactly, sampled once a second; the loop is as slow.
    """
    dt, hours = 1.0, 24
    controller = GPI(SLED, dt, FixedGains(0.06), realisation=realisation, effort=1e9, start="zero")
    state = controller.init(Measurement(np.zeros(1)), ORIGIN)
    q, speed, rows, forces = 0.0, 0.0, [], []
    for k in range(hours * 3600):
        v, state = sample(controller, q, state)
        a = v + 1.0 + 0.1 * np.sin(2.0 * np.pi * k / 3600.0)
        q, speed = q + speed * dt + 0.5 * dt * dt * a, speed + dt * a
        if k % 60 == 59:
            forces.append(v)
            rows.append(np.ravel(state.law))
    return np.array(forces), np.array(rows)


def test_over_a_day_the_printed_integrals_grow_without_bound_and_the_bumpless_states_do_not() -> None:
    v_paper, printed = a_day("paper")
    v_bumpless, bumpless = a_day("bumpless")
    half = len(printed) // 2
    size = {"paper": np.abs(printed), "bumpless": np.abs(bumpless)}
    hour = 60
    # int v and int3 e are the first and the last state: they grow with the time, hour by hour.
    for integral in (size["paper"][:, 0], size["paper"][:, -1]):
        assert integral[-1] == pytest.approx(2.0 * integral[half - 1], rel=1e-2)  # straight lines
        assert integral[-1] > 20.0 * integral[hour]
    # What the push needs after an hour is all that the bumpless states ever hold.
    assert (size["bumpless"][hour:].max(axis=0) < 1.01 * size["bumpless"][hour : 2 * hour].max(axis=0)).all()
    # The same v for a push of 1 m/s^2, with fewer digits as the integrals grow (3e-13, then 1e-11).
    np.testing.assert_allclose(v_paper[:hour], v_bumpless[:hour], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(v_paper, v_bumpless, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("integrators", [1, 2, 3])
@pytest.mark.parametrize("rolloff", [0, 1, 2])
def test_while_the_reference_rests_integrals_of_integrals_alone_decay(integrators: int, rolloff: int) -> None:
    """The first integrator holds the arm: it keeps all that it has, and the others a share."""
    realisation = Bumpless(Member(integrators, rolloff, 3.0, 1.5, 1.2))
    c = realisation.coefficients(Tuning(*(x * np.ones(1) for x in (20.0, 0.8, 20.0))), DT)
    rng = np.random.default_rng(integrators)
    start = realisation.init(np.zeros(1), c)
    state = type(start)(*rng.normal(size=(len(start), 1)))
    chain, none = np.ravel(state[:integrators]), np.zeros(1)
    after = realisation.update(none, none, None, state, c, Resting(none, np.array([0.7])))
    left = np.array([chain[0], *(0.7 * chain[1:])])
    wanted = left + DT * np.append(left[1:], 0.0)
    np.testing.assert_allclose(np.ravel(after[:integrators]), wanted, rtol=1e-12)
    # With all that it has, and the error itself, it is the update of a reference that moves.
    e = np.array([0.3])
    rests = realisation.update(e, none, None, state, c, Resting(e, np.ones(1)))
    np.testing.assert_allclose(rests, realisation.update(e, none, None, state, c), rtol=1e-12)


@pytest.mark.parametrize("integrators", [1, 2, 3])
@pytest.mark.parametrize("rolloff", [0, 1, 2])
def test_a_filter_that_has_settled_stays_under_a_constant_error(integrators: int, rolloff: int) -> None:
    member = Member(integrators, rolloff, 3.0, 1.5, 1.2)
    realisation = Bumpless(member)
    e, hold = np.array([0.01, -0.02]), np.array([3.0, -1.0])
    c = realisation.coefficients(Tuning(*(x * np.ones(2) for x in (20.0, 0.8, 20.0))), DT)
    state = realisation.settled(e, realisation.init(hold, c), c)
    np.testing.assert_array_equal(state[:integrators], realisation.init(hold, c)[:integrators])
    after = realisation.update(e, realisation.output(e, state, c), None, state, c)
    filters = np.array(state[integrators:])
    np.testing.assert_allclose(after[integrators:], filters, rtol=1e-9)
    # Where it came from nothing, it gets there by itself.
    slow = realisation.init(hold, c)
    for _ in range(3000):
        slow = realisation.update(e, realisation.output(e, slow, c), None, slow, c)
    np.testing.assert_allclose(slow[integrators:], filters, rtol=1e-9)


@pytest.mark.parametrize("integrators", [1, 2, 3])
@pytest.mark.parametrize("rolloff", [0, 1, 2])
def test_an_arm_at_rest_beside_its_reference_is_held_first_and_then_moved(
    integrators: int, rolloff: int
) -> None:
    """The first v is that of no error; of a double integrator the error then dies away."""
    member = Member(integrators, rolloff, 3.0, 1.5, 1.2)
    realisation = Bumpless(member)
    hold = np.array([3.0, -1.0])
    c = realisation.coefficients(Tuning(*(x * np.ones(2) for x in (20.0, 0.8, 20.0))), DT)
    e = start = np.array([0.1, -0.2])
    state, velocity = realisation.at_rest(e, realisation.init(hold, c), c), np.zeros(2)
    np.testing.assert_allclose(realisation.output(e, state, c), hold, rtol=1e-12)
    for _ in range(4000):
        v = realisation.output(e, state, c)
        state = realisation.update(e, v, None, state, c)
        velocity = velocity + DT * (v - hold)
        e = e + DT * velocity
    assert np.abs(e / start).max() < 1e-3


def test_with_one_integrator_a_start_is_the_step_of_an_integral_controller() -> None:
    """In continuous time e = e0 (1 - y), y the unit step response of g (s + f) / p(s), by SciPy."""
    omega, zeta, dt = 20.0, 0.8, 1e-5
    realisation = Bumpless(Member(1, 0))
    c = realisation.coefficients(Tuning(*(np.array(x) for x in (omega, zeta, omega))), dt)
    polynomial = np.polymul(*[[1.0, 2.0 * zeta * omega, omega**2]] * 2)
    # s^2 + C(s) = p(s) / (s (s + f)): f is the third power's coefficient, and the integral's gain p(0) / f.
    f = polynomial[1]
    e, velocity, errors = np.array(0.1), np.array(0.0), []
    state = realisation.at_rest(e, realisation.init(np.array(0.0), c), c)
    time = np.arange(40000) * dt
    for _ in time:
        v = realisation.output(e, state, c)
        state = realisation.update(e, v, None, state, c)
        errors.append(float(e))
        velocity = velocity + dt * v
        e = e + dt * velocity
    _, step = signal.step(([polynomial[4] / f, polynomial[4]], polynomial), T=time)
    np.testing.assert_allclose(errors, 0.1 * (1.0 - step), atol=1e-5)
