"""The family of the GPI law: closed forms against polynomials, the realisation against SciPy, ADRC in it."""

from __future__ import annotations

import math
import pickle
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from armgpi import Tuning
from armgpi.errors import ArrayError, ParameterError
from armgpi.gpi.family import Member, characteristic, partial_fractions, transfer_function
from armgpi.gpi.gains import betas
from armgpi.gpi.realisation import Bumpless

Array = npt.NDArray[np.float64]

KINDS = [(m, r) for m in (1, 2, 3) for r in (0, 1, 2)]
DT = 1e-3
every = pytest.mark.parametrize("kind", KINDS, ids="{0[0]} integrators, roll-off {0[1]}".format)
ratios, dampings = st.floats(0.5, 10.0), st.floats(0.3, 2.0)


@st.composite
def tunings(draw: st.DrawFn) -> Tuning:
    """Loops that a millisecond suits."""
    omega = draw(st.floats(2.0, 60.0))
    return Tuning(*map(np.float64, (omega, draw(st.floats(0.3, 2.0)), omega * draw(st.floats(0.2, 5.0)))))


def tuned(omega: float, zeta: float = 1.0, p: float | None = None) -> Tuning:
    """A tuning of one joint."""
    return Tuning(*map(np.array, (omega, zeta, omega if p is None else p)))


def members(kind: tuple[int, int]) -> st.SearchStrategy[Member]:
    """Members with so many integrators and roll-off, with and without a second quadratic."""
    return st.builds(
        Member, st.just(kind[0]), st.just(kind[1]), ratios, st.none() | ratios, st.none() | dampings
    )


def desired(tuning: Tuning, member: Member) -> npt.NDArray[Any]:
    """Return the characteristic polynomial multiplied out by NumPy, highest power first."""
    w, z, p = map(float, tuning)
    w2 = w if member.second_ratio is None else float(member.second_ratio) * w
    z2 = z if member.second_zeta is None else float(member.second_zeta)
    product = np.polymul([1.0, 2.0 * z * w, w * w], [1.0, 2.0 * z2 * w2, w2 * w2])
    for pole in [p] * (member.integrators - 1) + [float(member.rolloff_ratio) * w] * member.rolloff:
        product = np.polymul(product, [1.0, pole])
    return product


def filter_of(tuning: Tuning, member: Member) -> tuple[Array, Array]:
    """Return numerator and denominator of C(s), highest power first, by dividing the polynomial."""
    whole = desired(tuning, member)
    size = member.integrators + 2
    return whole[-size:], np.append(whole[:-size], np.zeros(member.integrators))


def response(law: Bumpless, coefficients: list[Any], errors: Array, hold: float = 0.0) -> tuple[Array, Any]:
    """Return v for errors under coefficients that may differ from sample to sample, and the last state."""
    state = law.init(np.array(hold), coefficients[0])
    out = np.empty_like(errors)
    for k, e in enumerate(errors):
        c = coefficients[k % len(coefficients)]
        out[k] = law.output(e, state, c)
        state = law.update(e, out[k], None, state, c)
    return out, state


# Closed forms


@every
@settings(max_examples=20)
@given(data=st.data(), tuning=tunings())
def test_the_two_ends_of_the_polynomial_are_the_controller(
    kind: tuple[int, int], data: st.DataObject, tuning: Tuning
) -> None:
    member = data.draw(members(kind))
    numerator, denominator = transfer_function(tuning, member)
    assert (len(numerator), len(denominator)) == (kind[0] + 2, kind[1] + 1)
    loop = np.polyadd([1.0, *denominator[::-1], *[0.0] * (kind[0] + 2)], numerator[::-1])
    # Sums of positive terms: no digits cancel.
    np.testing.assert_allclose(loop, desired(tuning, member), rtol=1e-13)
    np.testing.assert_array_equal(loop[:0:-1], characteristic(tuning, member))


@every
def test_the_poles_of_the_closed_loop_are_where_they_were_placed(kind: tuple[int, int]) -> None:
    tuning, member = tuned(20.0, 0.6, 35.0), Member(*kind, 4.5, 2.5, 0.7)
    expected = [
        20.0 * np.exp(1j * (math.pi - math.acos(0.6))),
        50.0 * np.exp(1j * (math.pi - math.acos(0.7))),
    ]
    found = np.roots([1.0, *characteristic(tuning, member)[::-1]])
    for pole in expected + [-35.0] * (kind[0] > 1) + [-90.0] * (kind[1] > 0):
        # A double root loses half of the digits.
        assert np.abs(found - pole).min() < 1e-5 * abs(pole)


@every
@settings(max_examples=20)
@given(data=st.data(), tuning=tunings(), angle=st.floats(0.1, 3.0), size=st.floats(0.2, 5.0))
def test_the_partial_fractions_add_up_to_the_controller(
    kind: tuple[int, int], data: st.DataObject, tuning: Tuning, angle: float, size: float
) -> None:
    member = data.draw(members(kind))
    direct, integrals, numerator, denominator = partial_fractions(tuning, member)
    s = size * tuning.omega_c * np.exp(1j * angle)
    terms = [g / s ** (i + 1) for i, g in enumerate(integrals)]
    terms.append(np.polyval(numerator[::-1], s) / np.polyval([1.0, *denominator[::-1]], s))
    if direct is not None:
        terms.append(direct)
    above, below = filter_of(tuning, member)
    expected = np.polyval(above, s) / np.polyval(below, s)
    np.testing.assert_allclose(sum(terms), expected, rtol=0.0, atol=1e-12 * np.abs(terms).max())
    assert (direct is None) == (kind[1] > 0)


@given(tunings())
def test_two_integrators_without_roll_off_are_the_printed_law_to_the_bit(tuning: Tuning) -> None:
    beta = betas(tuning)
    numerator, denominator = transfer_function(tuning)
    assert (*numerator, *denominator) == beta
    c = beta.beta0 / beta.beta4
    b = (beta.beta1 - c) / beta.beta4
    d = beta.beta2 - beta.beta3 * beta.beta4 - b
    assert partial_fractions(tuning) == (beta.beta3, (b, c), (d,), (beta.beta4,))
    # The coefficients of the sampled law as they stood before there was a family.
    half = 0.5 * DT
    shrunk = half * beta.beta4
    decay, filtered = (1.0 - shrunk) / (1.0 + shrunk), half * d / (1.0 + shrunk)
    back = DT * tuning.omega_c
    expected = {
        "direct": -(beta.beta3 + half * (b + half * c) + filtered),
        "lam": DT * (b + DT * c),
        "chi": DT * c,
        "eta": (1.0 + decay) * filtered,
        "decay": decay,
        "dt": DT,
        "back_lam": 3.0 * back,
        "back_chi": 2.0 * back * tuning.omega_c,
    }
    assert Bumpless().coefficients(tuning, DT)._asdict() == expected


@given(tuning=tunings(), e=st.floats(-1.0, 1.0), a=st.none() | st.floats(-1e3, 1e3), seed=st.integers(0, 99))
def test_a_sample_of_the_printed_law_is_what_it_was_to_the_bit(
    tuning: Tuning, e: float, a: float | None, seed: int
) -> None:
    law = Bumpless()
    c = law.coefficients(tuning, DT)
    state = type(law.init(np.array(0.0), c))(*np.random.default_rng(seed).normal(0.0, 10.0, 3))
    lam, chi, eta = state
    assert law.output(e, state, c) == c.direct * e - lam - eta
    expected = [lam + c.dt * chi + c.lam * e, chi + c.chi * e, c.decay * eta + c.eta * e]
    if a is not None:
        expected[0] -= c.back_lam * a
        expected[1] -= c.back_chi * a
    assert list(law.update(e, 0.0, a, state, c)) == expected


@pytest.mark.parametrize("integrators", [1, 2, 3])
@pytest.mark.parametrize("rolloff", [1, 2])
def test_a_far_roll_off_pole_is_a_roll_off_less_one(integrators: int, rolloff: int) -> None:
    tuning, s = tuned(20.0, 0.8, 30.0), 1j * np.logspace(0.0, 3.0, 50)

    def law(member: Member) -> Array:
        above, below = transfer_function(tuning, member)
        return np.polyval(above[::-1], s) / (s**integrators * np.polyval([1.0, *below[::-1]], s))

    # The other pole of a roll-off of two stays: at the same place it would be two far ones.
    near = law(Member(integrators, 0))
    errors = [np.abs(law(Member(integrators, rolloff, k)) / near - 1.0).max() for k in (1e5, 1e6)]
    assert errors[1] < 1e-3
    assert errors[0] == pytest.approx(10.0 * errors[1], rel=0.01)  # of order omega / p_f


@every
@settings(max_examples=20)
@given(tuning=tunings(), ratio=ratios)
def test_an_equal_second_quadratic_is_none(kind: tuple[int, int], tuning: Tuning, ratio: float) -> None:
    same = characteristic(tuning, Member(*kind, ratio, 1.0, float(tuning.zeta_c)))
    np.testing.assert_allclose(same, characteristic(tuning, Member(*kind, ratio)), rtol=1e-13)


@every
@settings(max_examples=20)
@given(data=st.data(), tuning=tunings())
def test_the_filter_of_the_controller_is_stable(
    kind: tuple[int, int], data: st.DataObject, tuning: Tuning
) -> None:
    _, denominator = transfer_function(tuning, data.draw(members(kind)))
    assert np.roots([1.0, *denominator[::-1]]).real.max() < 0.0


@every
def test_many_tunings_are_those_of_each(kind: tuple[int, int]) -> None:
    omega, zeta = np.array([[5.0, 10.0], [20.0, 40.0]]), np.array([0.7, 1.2])
    ratio, second = np.array([[2.0], [5.0]]), np.array([1.5, 3.0])
    law = Bumpless(Member(*kind, ratio, second, 0.8))
    together = law.coefficients(Tuning(omega, zeta, 0.5 * omega), DT)
    for i, j in np.ndindex(2, 2):
        alone = Bumpless(Member(*kind, float(ratio[i, 0]), float(second[j]), 0.8)).coefficients(
            Tuning(omega[i, j], zeta[j], 0.5 * omega[i, j]), DT
        )
        for name, value in alone._asdict().items():
            np.testing.assert_array_equal(np.broadcast_to(getattr(together, name), (2, 2))[i, j], value)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"integrators": 0}, "integrators"),
        ({"integrators": 4}, "integrators"),
        ({"integrators": 2.0}, "integrators"),
        ({"rolloff": 3}, "rolloff"),
        ({"rolloff": -1}, "rolloff"),
        ({"rolloff_ratio": 0.0}, "rolloff_ratio"),
        ({"second_zeta": -1.0}, "second_zeta"),
        ({"second_ratio": 0.0}, "second_ratio"),
    ],
)
def test_what_is_not_in_the_family_is_refused(options: dict[str, Any], named: str) -> None:
    with pytest.raises(ParameterError, match=named):
        Member(**options)


def test_a_ratio_that_is_no_number_is_refused() -> None:
    with pytest.raises(ArrayError, match="rolloff_ratio"):
        Member(2, 1, math.nan)


# Realisation


@every
@pytest.mark.parametrize("tuning", [(5.0, 1.0, 5.0), (20.0, 0.7, 40.0), (60.0, 1.0, 60.0)])
@pytest.mark.parametrize("second", [(), (2.0, 0.6)], ids=["equal", "second"])
def test_random_errors_are_answered_as_scipy_answers_them(
    kind: tuple[int, int], tuning: tuple[float, float, float], second: tuple[float, ...]
) -> None:
    member = Member(*kind, 3.0, *second)
    law = Bumpless(member)
    errors = np.random.default_rng(1).normal(0.0, 1e-2, 400)
    A, B, C, D, dt = signal.cont2discrete(signal.tf2ss(*filter_of(Tuning(*tuning), member)), DT, "bilinear")
    _, expected, _ = signal.dlsim((A, B, C, D, dt), errors)
    v, _ = response(law, [law.coefficients(Tuning(*map(np.array, tuning)), DT)], errors)
    # Integrators add up the rounding of 400 samples, in SciPy as here.
    np.testing.assert_allclose(v, -expected[:, 0], rtol=0.0, atol=1e-12 * np.abs(expected).max())


@every
@settings(max_examples=20)
@given(data=st.data(), before=tunings(), after=tunings())
def test_while_the_error_is_zero_gains_change_no_state_and_no_output(
    kind: tuple[int, int], data: st.DataObject, before: Tuning, after: Tuning
) -> None:
    law = Bumpless(data.draw(members(kind)))
    changing = [law.coefficients(tuning, DT) for tuning in (before, after)]
    v, state = response(law, changing, np.zeros(20), hold=9.81)
    np.testing.assert_array_equal(v, 9.81)
    assert list(state) == [-9.81] + [0.0] * sum(kind)


@every
@settings(max_examples=20)
@given(data=st.data(), before=tunings(), after=tunings(), seed=st.integers(0, 1000))
def test_gains_that_change_while_the_error_passes_zero_move_no_torque_at_that_sample(
    kind: tuple[int, int], data: st.DataObject, before: Tuning, after: Tuning, seed: int
) -> None:
    law = Bumpless(data.draw(members(kind)))
    errors = np.random.default_rng(seed).normal(0.0, 1e-2, 30)
    old, changed = (law.coefficients(tuning, DT) for tuning in (before, after))
    _, state = response(law, [old], errors)
    assert law.output(np.array(0.0), state, old) == law.output(np.array(0.0), state, changed)


@every
def test_integrators_settle_on_the_disturbance_and_its_slopes_whatever_the_gains(
    kind: tuple[int, int],
) -> None:
    # zeta = 3 + 2 t + t^2 as far as there are integrators for it; the plant is stepped exactly.
    law, dt, count = Bumpless(Member(*kind, 4.0)), 1e-3, 3000
    ramp = np.polynomial.Polynomial([3.0, 2.0, 1.0][: kind[0]])
    slopes = [ramp.deriv(i)(count * dt) for i in range(kind[0])]
    for omega in (15.0, 25.0):
        c = law.coefficients(tuned(omega), dt)
        q, speed, state = np.array(0.0), np.array(0.0), law.init(np.array(0.0), c)
        for k in range(count):
            v = law.output(q, state, c)
            state = law.update(q, v, None, state, c)
            a = v + ramp(k * dt)
            q, speed = q + dt * speed + 0.5 * dt * dt * a, speed + dt * a
        # A sample late, and half of one for the trapezoidal rule.
        np.testing.assert_allclose(state[: kind[0]], slopes, rtol=2e-3)
        assert abs(q) < 1e-9


@every
def test_over_hours_no_state_drifts(kind: tuple[int, int]) -> None:
    # A sample a second, a loop as slow, and a push that comes and goes every hour.
    law, dt = Bumpless(Member(*kind, 2.0)), 1.0
    c = law.coefficients(tuned(0.04), dt)
    q, speed, state, rows = np.array(0.0), np.array(0.0), law.init(np.array(0.0), c), []
    for k in range(8 * 3600):
        v = law.output(q, state, c)
        state = law.update(q, v, None, state, c)
        a = v + 1.0 + 0.1 * math.sin(2.0 * math.pi * k / 3600.0)
        q, speed = q + speed * dt + 0.5 * dt * dt * a, speed + dt * a
        if k % 60 == 59:
            rows.append(np.abs(state))
    sizes = np.array(rows)
    assert (sizes[60:].max(axis=0) < 1.01 * sizes[60:120].max(axis=0)).all()


def step_response(law: Bumpless, c: Any, most: float) -> Array:
    """Return the error of a joint with limited |v| after a step of 1 rad, over 3 s."""
    q, speed, state, path = np.array(-1.0), np.array(0.0), law.init(np.array(0.0), c), []
    for _ in range(3000):
        v = law.output(q, state, c)
        applied = np.clip(v, -most, most)
        state = law.update(q, v, applied - v, state, c)
        q, speed = q + DT * speed + 0.5 * DT * DT * applied, speed + DT * applied
        path.append(float(q))
    return np.array(path)


@every
@pytest.mark.parametrize("share", [0.03, 0.1])
def test_a_saturated_joint_arrives_and_without_anti_windup_it_does_not(
    kind: tuple[int, int], share: float
) -> None:
    omega = 20.0
    law = Bumpless(Member(*kind, 4.0))
    c = law.coefficients(tuned(omega), DT)
    most = share * omega**2  # beta3 is ten times omega^2
    path = step_response(law, c, most)
    assert path.max() < 0.06
    assert np.abs(path[1500:]).max() < 0.02
    none = c._replace(**{f"back_{name}": np.array(0.0) for name in ("lam", "chi", "psi")[: kind[0]]})
    assert step_response(law, none, most).max() > 0.3


@every
def test_states_have_names_and_pickle(kind: tuple[int, int]) -> None:
    law = Bumpless(Member(*kind))
    state = law.init(np.array(1.0), None)
    assert state._fields == (*("lam", "chi", "psi")[: kind[0]], *("eta", "eta_2", "eta_3")[: 1 + kind[1]])
    assert pickle.loads(pickle.dumps(state)) == state
    assert type(state).__name__.endswith(f"{kind[0]}{kind[1]}")  # m integrators, r poles


# Neighbours


def adrc(omega_c: float, omega_o: float, order: int) -> tuple[Array, Array]:
    """Return the filter from y to -u of linear ADRC for y'' = u + f, with an observer of that order.

    The observer z' = A z + b u + l (y - z_1) holds y, y', f (and f' for order 4); l places
    (s + omega_o)^order. u = -omega_c^2 z_1 - 2 omega_c z_2 - z_3 (Gao 2003).
    """
    A = np.eye(order, k=1)
    b = np.eye(order)[:, 1:2]
    gains = np.poly(np.full(order, -omega_o))[1:, None]
    k = np.zeros((1, order))
    k[0, :3] = omega_c**2, 2.0 * omega_c, 1.0
    closed = A - gains @ np.eye(order)[:1] - b @ k
    numerator, denominator = signal.ss2tf(closed, gains, k, np.zeros((1, 1)))
    return numerator[0], denominator


@pytest.mark.parametrize(("order", "integrators"), [(3, 1), (4, 2)])
@pytest.mark.parametrize(("omega_c", "omega_o"), [(10.0, 30.0), (20.0, 60.0), (25.0, 25.0)])
def test_linear_adrc_is_a_member_with_roll_off_one(
    order: int, integrators: int, omega_c: float, omega_o: float
) -> None:
    ratio = omega_o / omega_c
    member = Member(integrators, 1, ratio, ratio)
    above, below = transfer_function(tuned(omega_c, 1.0, omega_o), member)
    numerator, denominator = adrc(omega_c, omega_o, order)
    # ss2tf takes differences of characteristic polynomials: digits relative to the largest coefficient.
    scale = omega_o ** np.arange(len(denominator))
    got = np.append([1.0, *below[::-1]], np.zeros(integrators))
    np.testing.assert_allclose(got / scale, denominator / scale, atol=1e-11)
    np.testing.assert_allclose(
        np.append(np.zeros(len(denominator) - len(above)), above[::-1]) / (scale * omega_o),
        numerator / (scale * omega_o),
        atol=1e-10,
    )


@given(tunings())
def test_one_integrator_without_roll_off_is_a_pid_with_a_filtered_derivative(tuning: Tuning) -> None:
    direct, (ki,), (f,), (corner,) = partial_fractions(tuning, Member(1, 0))
    assert direct is not None
    kp, kd = direct + f / corner, -f / corner**2
    s = 1j * tuning.omega_c
    pid = kp + ki / s + kd * s * corner / (s + corner)
    above, below = filter_of(tuning, Member(1, 0))
    np.testing.assert_allclose(pid, np.polyval(above, s) / np.polyval(below, s), rtol=1e-12)
    assert kd > 0.0


@settings(max_examples=50)
@given(
    st.floats(1.0, 100.0), st.floats(0.3, 2.0), st.floats(0.2, 5.0), st.integers(0, 2**32 - 1), st.booleans()
)
def test_the_printed_law_unrolled_has_the_bits_of_its_member(
    omega: float, zeta: float, ratio: float, seed: int, saturated: bool
) -> None:
    unrolled, general = Bumpless(), Bumpless()
    general._printed = False
    tuning = Tuning(*(np.full(3, x) for x in (omega, zeta, ratio * omega)))
    c, d = (law.coefficients(tuning, 1e-3) for law in (unrolled, general))
    np.testing.assert_array_equal(np.broadcast_arrays(*c), np.broadcast_arrays(*d))
    random = np.random.default_rng(seed)
    e, *state = random.normal(size=(4, 3))
    a = random.normal(size=3) if saturated else None
    begun = unrolled.init(np.zeros(3), c)._replace(lam=state[0], chi=state[1], eta=state[2])
    one, two = unrolled.update(e, e, a, begun, c), general.update(e, e, a, begun, d)
    np.testing.assert_array_equal(one, two)
