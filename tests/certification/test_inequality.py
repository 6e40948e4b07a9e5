"""Each bound of docs/proof.md against the quantity that it bounds, where a claim allows the arm to be."""

from __future__ import annotations

from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import FOLLOWS, robots

from armgpi import Robot, certify
from armgpi.base.arrays import Array
from armgpi.certification import check_certificate, quantities
from armgpi.certification.quantities import Points, Setting
from armgpi.certification.solve import _ALPHAS, _lyapunov, _matrix, _Problem, _split, _svec, solve

checker: Any = check_certificate  # generic over number types, so without annotations
SEEDS = st.integers(0, 2**32 - 1)


class Drawn(NamedTuple):
    """Numbers at one configuration, and an arm with a load between the ends that moves there."""

    numbers: dict[str, float]
    setting: Setting
    arm: Robot
    star: Array
    q: Array
    r: Array
    e: Array

    def length(self, x: Array) -> float:
        return float(np.sqrt(x @ self.arm.mass_matrix(self.q) @ x))

    def force(self, x: Array) -> float:
        return float(np.sqrt(x @ np.linalg.solve(self.arm.mass_matrix(self.q), x)))


def draw(
    robot: Robot,
    load: float,
    share: float,
    seed: int,
    feedforward: str = "gravity",
    box: Any = (-1.0, 1.0),
    uncertain: bool = False,
) -> Drawn:
    """Return what a claim allows: corners of the speeds are as likely as what is between."""
    rng, n = np.random.default_rng(seed), robot.n
    heavy, arm = (robot.with_payload(robot.tip, x) for x in (load, share * load))
    arms: tuple[Robot, ...] = (robot, heavy)
    if uncertain:  # of all bodies and rotors, the controller's in the middle
        scale, rotors = np.array([0.7, 1.4]), np.array([0.3, 0.05])

        def mixed(x: float) -> Robot:
            weights = np.array([1.0 - x, x])
            return robot.scaled_inertia(float(weights @ scale)).with_armature(float(weights @ rotors))

        heavy, arm = mixed(0.5), mixed(share)
        arms = (mixed(0.0), mixed(1.0), heavy)
    star = rng.uniform(*box, n)
    q = star + 0.02 * rng.uniform(-1.0, 1.0, n)
    speed, viscous = rng.uniform(0.1, 1.0, n), rng.uniform(0.0, 5.0, n)
    rest = np.zeros(n)
    setting = Setting(
        arms, heavy, robot, star, star, rest + 0.02, speed, feedforward, viscous=viscous
    )._replace(velocity=speed, torque=speed, friction=rest, acceleration=rest, encoder=rest, zone=rest)
    between = star + np.linspace(0.0, 1.0, 5)[:, None] * (q - star)
    at = Points(np.repeat(star[None], 5, 0), np.repeat(q[None], 5, 0), between)
    functions = quantities.functions(setting)
    numbers = {
        name: max(float(function(setting, each, at).max()) for each in setting.arms)
        for name, function in functions.items()
    }
    found = {name: quantities.Number(0.0) for name in quantities.Numbers._fields}
    found.update(
        {name.lstrip("-"): quantities.Number(abs(x)) for name, x in numbers.items() if "." not in name}
    )
    raised: Any = quantities.between_ends(setting, quantities.Numbers(**found))
    numbers.update({name: getattr(raised, name).value for name in ("sigma_error", "kappa_error", "shift")})
    r = speed * np.clip(rng.uniform(-2.0, 2.0, n), -1.0, 1.0)
    return Drawn(numbers, setting, arm, star, q, r, rng.standard_normal(n))


def check(case: Drawn) -> None:
    """Compare every term of the error's equation with its bound."""
    numbers, arm, q, r, e = case.numbers, case.arm, case.q, case.r, case.e
    D, speed = arm.mass_matrix(q), case.length(case.e)

    def torque(v: Array) -> Array:
        return arm.nonlinear_effects(q, v) - arm.gravity(q)

    # Twice along the reference, once for the error's own speed.
    extra = case.force(torque(r + e) - torque(r))
    tiny = 1e-9 * (1.0 + case.force(torque(r + e)))
    assert extra <= (2.0 * numbers["kappa_v"] + speed * numbers["kappa_error"]) * speed + tiny
    assert case.force(torque(r)) <= numbers["kappa_v"] * case.length(r) + tiny
    step = 1e-5
    rate = (arm.mass_matrix(q + step * (r + e)) - arm.mass_matrix(q - step * (r + e))) / (2.0 * step)
    root = np.linalg.inv(np.linalg.cholesky(D))
    grows = np.abs(np.linalg.eigvalsh(root @ rate @ root.T)).max()
    assert grows <= (numbers["sigma"] + speed * numbers["sigma_error"]) * (1.0 + 1e-6) + 1e-4
    z = -np.linalg.solve(D, case.setting.viscous * e)
    size = case.length(z) ** 2
    assert size + numbers["kappa_f"] * (z @ D @ e) <= 1e-9 * (size + 1.0)
    model, known = case.setting.nominal, case.setting.known
    delta = np.linalg.eigvalsh(root @ model.mass_matrix(q) @ root.T)
    assert -numbers["-delta_low"] <= delta.min() * (1.0 + 1e-9)
    assert delta.max() <= numbers["delta_high"] * (1.0 + 1e-9)

    def held(at: Array) -> Array:
        return model.inertia_solve(at, arm.gravity(at) - known.gravity(at))

    v = held(case.star)
    stiff = arm.gravity(q) - model.inertia_times(q, v)
    stiff = stiff - arm.gravity(case.star) + model.inertia_times(case.star, v)
    away = case.length(q - case.star)
    rounding = 1e-9 * (1.0 + case.force(arm.gravity(q)) + case.force(model.inertia_times(q, v)))
    assert case.force(stiff) <= 1.01 * numbers["kappa_e"] * away + rounding
    fall = case.force(arm.gravity(q) - arm.gravity(case.star))
    assert fall <= 1.01 * numbers["kappa_g"] * away + rounding
    change = (held(case.star + step * r) - held(case.star - step * r)) / (2.0 * step)
    assert case.length(change) <= numbers["shift"] * (1.0 + 1e-5) + 1e-4 * (1.0 + case.length(v))
    assert case.force(case.setting.torque) <= numbers["torque"] * (1.0 + 1e-9)
    inverse = np.diagonal(np.linalg.inv(D))
    for j in range(arm.n):
        assert inverse[j] <= numbers[f"inverse.{j}"] * (1.0 + 1e-9)


@settings(max_examples=25)
@given(robots(max_joints=5), st.floats(0.0, 3.0), st.floats(0.0, 1.0), SEEDS)
def test_no_term_of_any_arm_exceeds_its_bound(robot: Robot, load: float, share: float, seed: int) -> None:
    check(draw(robot, load, share, seed))


@settings(max_examples=15)
@given(robots(max_joints=4), st.floats(0.0, 1.0), SEEDS)
def test_nor_of_one_between_others(robot: Robot, share: float, seed: int) -> None:
    check(draw(robot, 0.0, share, seed, uncertain=True))


@settings(max_examples=2)
@given(robots(min_joints=9, max_joints=10), st.floats(0.0, 3.0), st.floats(0.0, 1.0), SEEDS)
def test_nor_of_one_with_many_joints(robot: Robot, load: float, share: float, seed: int) -> None:
    """All 2^(n - 1) corners of the speeds are taken, not some."""
    check(draw(robot, load, share, seed))


@pytest.mark.parametrize("seed", range(5))
def test_nor_of_one_whose_joint_follows_another(seed: int) -> None:
    check(draw(Robot.from_xml(FOLLOWS, mimic="follow"), 1.0, 0.4, seed))


LONG = """<robot name='long'><link name='base'/>
<link name='table'><inertial><mass value='1'/>
<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link>
<link name='slide'><inertial><mass value='2'/>
<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link>
<joint name='turns' type='revolute'><parent link='base'/><child link='table'/><axis xyz='0 0 1'/>
<limit lower='-1' upper='1' effort='1000' velocity='1'/></joint>
<joint name='slides' type='prismatic'><parent link='table'/><child link='slide'/><axis xyz='1 0 0'/>
<limit lower='1' upper='11' effort='1000' velocity='1'/></joint></robot>"""


@pytest.mark.parametrize("seed", range(5))
def test_nor_of_one_that_slides_by_ten_meters(seed: int) -> None:
    check(draw(Robot.from_xml(LONG), 1.0, 0.4, seed, box=([-1.0, 1.0], [1.0, 11.0])))


def test_all_of_a_long_slide_is_kept_and_printed() -> None:
    made = certify(Robot.from_xml(LONG), payload=(0.0, 0.1), speed=0.01, start="held")
    assert made.data["limits"]["lower"] == ["-1.0", "1.0"]
    assert made.data["limits"]["upper"] == ["1.0", "11.0"]
    (said,) = (line for line in str(made).splitlines() if "box" in line)
    assert "1 to 11" in said, said
    assert made.certified, made.reasons
    assert made.check() == []


def test_corners_are_all_up_to_twelve_joints() -> None:
    assert len(np.unique(quantities.corners(np.ones(9)), axis=0)) == 2**8
    assert len(np.unique(quantities.corners(np.ones(12)), axis=0)) == 2**11


@pytest.mark.parametrize(
    ("integrators", "rolloff", "delay", "rubs"),
    [(1, 0, 0, 0.0), (2, 1, 0, 0.3), (1, 2, 3, 0.0), (3, 0, 1, 0.2)],
)
def test_the_checker_adds_up_what_a_sample_does(
    integrators: int, rolloff: int, delay: int, rubs: float
) -> None:
    """Written again in floating point, as a form in states and disturbances and by the exponential."""
    rng = np.random.default_rng(integrators + 10 * delay)
    m, h = integrators, 2e-3
    names = [*("kappa_v", "kappa_e", "kappa_g", "sigma", "sigma_error", "kappa_error")]
    names += ["torque", "shift", "count", "reference", "zone", "spread", "jump"]
    c: dict[str, Any] = dict(zip(names, rng.uniform(0.3, 0.9, len(names)).tolist(), strict=True))
    c |= {"integrators": m, "rolloff": rolloff, "delay": delay, "sample_time": h, "omega": [9.0, 10.0, 13.0]}
    c |= {"zeta": 0.8, "pole_ratio": 1.2, "rolloff_ratio": 6.0, "second_ratio": 0.9, "second_zeta": 1.1}
    c |= {"kappa_f": rubs, "delta_low": 0.7, "delta_high": 1.3, "count_time": 3e-3}
    c |= {"inverse": [2.0, 3.0], "velocity": [0.1, 0.3], "hold": [4.0, 5.0], "reach": [0.5, 0.6]}
    late = -1 if delay else 0
    slow, fast = min(c["omega"]), max(c["omega"])
    laws = {omega: [np.array(x, dtype=float) for x in checker.loop(c, omega)[1:3]] for omega in c["omega"]}
    sigma = c["sigma"] + c["spread"] * c["sigma_error"]
    kv = 2.0 * c["kappa_v"] + c["spread"] * c["kappa_error"]
    f, wide = np.exp(sigma * h), np.exp(sigma * delay * h + c["sigma"] * c["count_time"])
    rest = 1.0 - f * ((kv + rubs) * h + c["kappa_g"] * h**2 / 2.0)
    ends, late_gravity = (
        np.array([c["delta_low"] / wide, c["delta_high"] * wide]),
        c["kappa_g"] if delay else 0.0,
    )
    over = f * (kv + h * c["kappa_g"])
    gains = np.array([ends[1] * (f - rest), (f - rest) * rubs + over, f * c["kappa_e"], f * late_gravity])
    noise = max(abs(K[late]) for _, K in laws.values()) * fast**2 * c["count"]
    w = (
        c["torque"]
        + (c["kappa_e"] + c["kappa_g"]) * c["count"]
        + c["kappa_g"] * (delay + 1) * h * c["reference"]
    )
    w = f * w + gains[0] * noise
    size = w / rest / slow**2
    sizes = np.array([size, size * fast * h / 2.0, c["shift"] / slow**3, c["count"], c["zone"]])
    known = checker.sample(c)
    said = [*known[0], known[1], *known[2], *known[3], *known[4], *known[5:]]
    np.testing.assert_allclose(said, [f, wide, rest, *ends, *gains, *sizes, w, noise], rtol=1e-8)

    n, omega, turn, delta = len(laws[10.0][0]), 10.0, 10.0 / 13.0, 1.1
    (A, K), theta, order = laws[omega], omega * h, n - delay
    root = rng.normal(size=(n, n))
    s = {
        "P": root @ root.T + np.eye(n),
        "alpha": 0.3,
        "t": rng.uniform(0.5, 2.0, 6).tolist(),
        "a": [1.0, 2.0, 3.0, 4.0, 5.0],
    }
    X = np.array(checker.inequality(c, known, omega, turn, delta, s), dtype=float)
    e, v, past, lag = np.eye(n)[0], np.eye(n)[1], np.eye(n)[late], np.eye(n)[0] - np.eye(n)[late]
    sources = [
        (gain / rest / slow**power, row, weight)
        for gain, power, row, weight in zip(gains, (0, 1, 2, 2), (K, v, past, lag), s["t"], strict=False)
        if gain > 0.0
    ]
    held = theta**2 / 2.0 * e + theta * v
    inside = (np.arange(n) > 1) & (np.arange(n) < order)
    count = A[:, late] * inside + delta * held * K[late]
    zone = A[:, late] * inside * (np.arange(n) < 2 + m)
    acts = [theta * v, theta * e, theta * np.eye(n)[2], count, zone]
    powers = np.array([0, 1, *range(2, 2 + m), *range(2, 3 + rolloff), *[0] * delay])
    for _ in range(4):
        x, u = rng.normal(size=n), rng.normal(size=len(X) - n)
        after, left, rest_of = A @ x + delta * held * (K @ x), list(u), 0.0
        for gain, row, weight in sources:
            own = left.pop(0)
            after = after + theta * v * own
            rest_of += (
                theta * weight * own**2
                - theta * (weight + s["t"][4] * len(sources) * theta**2 / 4.0) * (gain * (row @ x)) ** 2
            )
        own = left.pop(0)  # what the disturbed acceleration does to the position within a sample
        after, rest_of = after + theta * e * own, rest_of + theta * s["t"][4] * own**2
        if rubs:
            own = left.pop(0)
            after, rest_of = (
                after + held * own,
                rest_of + theta * s["t"][5] * own**2 + s["t"][5] * h * rubs * x[1] * own,
            )
        for act, weight, own in zip(acts, s["a"], left, strict=True):
            after, rest_of = after + act * own, rest_of + theta * weight * own**2
        after = after * turn**powers
        form = x @ s["P"] @ x * (1.0 - theta * s["alpha"]) - f * after @ s["P"] @ after + rest_of
        z = np.concatenate([x, u])
        assert z @ X @ z == pytest.approx(form, rel=1e-7)

    inverse = np.linalg.inv(s["P"])
    most = [np.sqrt(y @ inverse @ y) for y in (e, v * fast, past)]
    most.append(max(np.sqrt(own @ inverse @ own) for _, own in laws.values()) * fast**2)
    level = np.sqrt((np.array(s["a"]) * sizes**2).sum() / s["alpha"])
    other = np.sqrt(s["P"][2, 2]) / slow**2

    def move(level: float, before: float = 0.0) -> tuple[float, float, float, float]:
        far, speed, delayed, asked = level * np.array(most)
        far, speed = far + h * speed * (before > 0.0) + h**2 / 2.0 * before, speed + h * before
        pushed = gains @ [asked, speed, delayed, far + delayed]
        return far, speed, ends[1] * (asked + noise) + rubs * speed + (w + pushed) / rest, asked

    for claim in ("stated", "start", "jump"):
        own = level
        if claim == "start":
            own = max(
                level, other * (c["jump"] + (c["kappa_e"] + c["kappa_g"]) * c["count"] / c["delta_low"])
            )
        far, speed, quick, asked = move(own)
        if claim == "jump":
            ratio = np.sqrt(c["delta_high"] / c["delta_low"])
            own, first = ratio * level + other * c["jump"], f * ratio * quick
            quick = max(first, f * move(own, first)[2])
            own += (np.sqrt(s["P"][0, 0]) * h / 2.0 + np.sqrt(s["P"][1, 1]) / slow) * h * 2.0 * quick
            far, speed, last, asked = move(own)
            quick = max(quick, last)
        far, speed = far + h * speed + h**2 / 2.0 * quick, np.sqrt(f) * (speed + h * quick)
        errors = np.sqrt(f * np.array(c["inverse"])) * far + delay * h * np.array(c["velocity"])
        torques = np.array(c["hold"]) + np.sqrt(wide) * np.array(c["reach"]) * (asked + noise)
        found = checker.bounds(c, s | {"P": s["P"].tolist()}, claim)
        np.testing.assert_allclose(
            [*found["errors"], *found["speed"], *found["torques"]], [*errors, speed, *torques], rtol=1e-7
        )


def test_the_checker_has_the_pivots_of_a_matrix_up_to_the_first_that_is_not_positive() -> None:
    root = np.random.default_rng(2).normal(size=(5, 5))
    whole = root @ root.T
    wanted = np.diag(np.linalg.cholesky(whole)) ** 2
    np.testing.assert_allclose(np.array(checker.pivots(whole.tolist()), dtype=float), wanted, rtol=1e-9)
    whole[3, 3] -= wanted[3] + 0.25
    found = np.array(checker.pivots(whole.tolist()), dtype=float)
    np.testing.assert_allclose(found, [*wanted[:3], -0.25], rtol=1e-9)
    # What is made less by rounding is less than every number that is lost.
    third = [[Fraction(1, 3), Fraction(1, 7)], [Fraction(1, 7), Fraction(1, 2)]]
    exact = Fraction(1, 2) - Fraction(1, 7) ** 2 / Fraction(1, 3)
    assert Fraction(1, 2**129) < exact - checker.pivots(third)[1] < Fraction(1, 2**120)


def facts(omega: list[float], kappa: float = 0.05) -> dict[str, Any]:
    """Return what a certificate rests on, as floats."""
    small = ("kappa_v", "kappa_e", "kappa_g", "kappa_f", "sigma", "sigma_error", "kappa_error", "spread")
    c: dict[str, Any] = {"integrators": 1, "rolloff": 1, "delay": 1, "sample_time": 2e-3, "omega": omega}
    c |= {"zeta": 0.8, "pole_ratio": 1.2, "rolloff_ratio": 8.0, "second_ratio": 0.9, "second_zeta": 1.1}
    c |= {
        "delta_low": 0.9,
        "delta_high": 1.1,
        "count_time": 3e-3,
        "torque": 0.7,
        "shift": 0.02,
        "count": 1e-3,
    }
    return c | {"reference": 0.1, "zone": 1e-3} | dict.fromkeys(small, kappa)


@pytest.mark.parametrize("count", [1, 2, 7])
def test_what_the_solver_gets_is_what_the_checker_checks(count: int) -> None:
    omegas = np.linspace(9.0, 12.0, count).tolist()
    c, rng = facts(omegas), np.random.default_rng(count)
    problem = _Problem.from_facts(c)
    assert problem is not None
    x = rng.normal(size=len(problem.basis))
    n = problem.n
    P, t, a = _split(x, n, problem.used)
    np.testing.assert_array_equal(P, P.T)
    np.testing.assert_array_equal(np.concatenate([P[np.tril_indices(n)], t, a]), x)
    known = checker.sample(c)
    chosen = sorted({*range(count)} if count < 3 else {0, 1, 3, 5, 6})
    steps = [(i, j) for i in chosen for j in range(max(i - 1, 0), min(i + 2, count))]
    s = {"P": P.tolist(), "alpha": 0.0, "t": t.tolist(), "a": a.tolist()}
    wanted = [
        np.array(checker.inequality(c, known, omegas[i], omegas[i] / omegas[j], delta, s))
        / (2e-3 * omegas[i])
        for i, j in steps
        for delta in known[2]
    ]
    np.testing.assert_allclose(np.tensordot(x, problem.basis, 1), wanted, rtol=1e-7, atol=1e-9)
    X, Y = (m + m.T for m in rng.normal(size=(2, n, n)))
    assert _svec(X) @ _svec(Y) == pytest.approx(np.trace(X @ Y))
    np.testing.assert_allclose(_matrix(_svec(X)), X)
    # The same matrix whatever the coordinates: where it is positive, and by which rate of decay less.
    for scale, alpha in ((1.0, 0.0), (0.2, 0.3), (-1.0, 0.1)):
        values = scale * x
        values[: n * (n + 1) // 2] = np.eye(n)[np.tril_indices(n)]
        less = np.zeros_like(wanted[0])
        less[:n, :n] = alpha * np.eye(n)
        least = min(np.linalg.eigvalsh(each - less)[0] for each in np.tensordot(values, problem.basis, 1))
        assert np.sign(problem.violation(values, alpha)) == -np.sign(least)


def test_what_is_solved_is_the_best_that_holds_at_any_rate_of_decay() -> None:
    c = facts([10.0]) | {"rolloff": 0, "delay": 0, "kappa_f": 0.0}
    problem = _Problem.from_facts(c)
    assert problem is not None
    A, K = (np.array(x) for x in checker.loop(c, 10.0)[1:3])
    delta = np.sqrt(np.prod(checker.sample(c)[2]))
    closed = A + delta * np.outer([0.5 * 0.02**2, 0.02, *[0.0] * (len(A) - 2)], K)
    first = _lyapunov(c, delta)
    np.testing.assert_allclose(first - closed.T @ first @ closed, 0.02 * np.eye(len(A)), atol=1e-9)
    rng, tried = np.random.default_rng(4), {}
    for alpha in _ALPHAS:
        x = problem.attempt(alpha)
        if x is None:
            continue
        P, _, a = _split(x, problem.n, problem.used)
        tried[alpha] = np.linalg.inv(P)[0, 0] * (a[problem.used.a] @ problem.sizes**2) / alpha
        assert problem.error_bound(x, alpha) == pytest.approx(tried[alpha])
        for _ in range(20):  # nothing near it holds and has a smaller bound
            near = x * (1.0 + 1e-3 * rng.normal(size=len(x)))
            assert (
                problem.violation(near, alpha) > 0.0
                or problem.error_bound(near, alpha) > 0.999 * tried[alpha]
            )
    exact = {key: [*map(Fraction, x)] if isinstance(x, list) else x for key, x in c.items()}
    found = solve({key: Fraction(x) if isinstance(x, float) else x for key, x in exact.items()})
    assert found is not None
    assert tried[float(found.alpha)] == min(tried.values())
    assert len(tried) > 3
