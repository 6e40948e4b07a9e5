"""The scenario used everywhere as ours: 40 s of the paper's arm, against its figures and a slow twin.

The paper gives neither horizon nor configuration, moves or gains. Ours: brakes released at q = 0, hold
to 1 s, to (0.8, 0.4, -0.4) rad by 4 s, hold, back between 12 and 15 s, hold to 40 s; eqs. 29-31; 1 kHz;
ideal sensors; omega_c = p_c = 20 rad/s, zeta_c = 1, started from zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from armgpi import (
    GPI,
    FixedGains,
    RigidBodyPlant,
    Robot,
    Sine,
    Status,
    Waypoints,
    config,
    metrics,
    simulate,
)
from armgpi.config import experiment
from armgpi.paper.arm import PaperArm

DEMO = Path(__file__).parents[2] / "examples" / "demo.yaml"
ARM = PaperArm()
DT = 1e-3
OMEGA = 20.0
COSINE = math.pi / 2


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """Return a rollout of the demo that starts from zero torque, as the figures below were measured."""
    path = tmp_path_factory.mktemp("demo") / "demo.yaml"
    text = DEMO.read_text(encoding="utf-8")
    path.write_text(text.replace("omega: 20\n", "omega: 20\n    start: zero\n"), encoding="utf-8")
    built = config.build(*config.read(path))
    controller = built.controllers["GPI"]
    assert isinstance(controller, GPI)
    assert controller.start == "zero"
    return experiment.run(built, "GPI")


def test_the_demo_is_the_scenario() -> None:
    built = config.build(*config.read(DEMO))
    controller = built.controllers["GPI"]
    assert isinstance(controller, GPI)
    assert controller.dt == DT
    for value, of in zip(controller.gains.nominal(), (OMEGA, 1.0, OMEGA), strict=True):
        np.testing.assert_array_equal(value, [of] * 3)
    assert built.t_final == 40.0
    # Where the reference stands and where it moves.
    t = np.array([0.0, 1.0, 4.0, 12.0, 15.0, 40.0])
    there, zero = [0.8, 0.4, -0.4], [0.0, 0.0, 0.0]
    np.testing.assert_allclose(built.reference.at(t).q, [zero, zero, there, there, zero, zero], atol=1e-15)
    for begin, end in ((1.0, 4.0), (12.0, 15.0)):
        assert (built.reference.at(np.linspace(begin, end, 9)[1:-1]).v != 0.0).all()
    # Eqs. 29-31, as printed.
    t = np.array([9.0, 12.0, 17.0, 30.0])
    printed = np.stack(
        [
            np.where(t >= 10, 0.7 * np.cos(0.1 * t), 0.0),
            np.where(t >= 15, 0.3 * np.cos(0.1 * t) + 0.2 * np.sin(0.5 * t), 0.0),
            np.where(t >= 20, 0.2 * np.sin(0.1 * t) + 0.1 * np.sin(0.5 * t), 0.0),
        ],
        axis=-1,
    )
    np.testing.assert_allclose(built.plant.disturbance(t), printed, atol=1e-15)


def test_the_scenario_has_its_known_itae_and_isci(demo: xr.Dataset) -> None:
    assert demo["status"] == Status.FINISHED
    # Measured with a prototype of other code; 2 % also covers the digits that these figures have.
    np.testing.assert_allclose(metrics.itae(demo), [0.018, 0.146, 0.300], rtol=0.02)
    np.testing.assert_allclose(metrics.isci(demo), [7.5, 285.4, 40.8], rtol=0.02)


def test_isci_is_near_what_the_paper_publishes(demo: xr.Dataset) -> None:
    # Table 2, the proposal. With moves and gains that are ours, some 10 to 15 % is what can be expected: most
    # of it is the torque that holds the arm for 40 s.
    np.testing.assert_allclose(metrics.isci(demo), [8.02, 322.76, 39.51], rtol=0.15)


# The slow twin: the same loop in plain Python from the paper's formulas, sharing no code with the package but
# the hand-derived arm.


def blend(x: float) -> float:
    """Eq. 27 with the signs that make it go from 0 to 1."""
    x = min(max(x, 0.0), 1.0)
    return x**5 * (252 - 1050 * x + 1800 * x**2 - 1575 * x**3 + 700 * x**4 - 126 * x**5)


def reference(t: float) -> np.ndarray:
    return np.array([0.8, 0.4, -0.4]) * (blend((t - 0.3) / 1.0) - blend((t - 1.5) / 0.7))


# Eqs. 29-31 with earlier onsets, off the grid of samples so that no rounding decides on which side one falls.
ONSETS = (0.4003, 0.6003, 0.8003)


def disturbance(t: float) -> np.ndarray:
    return np.array(
        [
            0.7 * math.cos(0.1 * t) if t > ONSETS[0] else 0.0,
            0.3 * math.cos(0.1 * t) + 0.2 * math.sin(0.5 * t) if t > ONSETS[1] else 0.0,
            0.2 * math.sin(0.1 * t) + 0.1 * math.sin(0.5 * t) if t > ONSETS[2] else 0.0,
        ]
    )


def printed_law() -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Eqs. 14, 17, 19 and 24: four integrals, each by the trapezoidal rule, from zero."""
    quadratic = [1.0, 2.0 * OMEGA, OMEGA**2]
    _, b4, b3, b2, b1, b0 = np.polymul(np.polymul(quadratic, quadratic), [1.0, OMEGA])
    past = {name: (np.zeros(3), np.zeros(3)) for name in ("e", "int_e", "int2_e", "v")}

    def integral(name: str, now: np.ndarray) -> np.ndarray:
        total, before = past[name]
        total = total + DT / 2 * (before + now)
        past[name] = (total, now)
        return total

    def law(q: np.ndarray, target: np.ndarray) -> np.ndarray:
        e = q - target
        int_e = integral("e", e)
        int2_e = integral("int_e", int_e)
        int3_e = integral("int2_e", int2_e)
        # v stands on both sides: v = -b4 (half of dt v + what was integrated before) - ...
        total, before = past["v"]
        known = b4 * (total + DT / 2 * before) + b3 * e + b2 * int_e + b1 * int2_e + b0 * int3_e
        v = -known / (1.0 + DT / 2 * b4)
        integral("v", v)
        return ARM.mass_matrix(q) @ v

    return law


def runge_kutta(q: np.ndarray, v: np.ndarray, tau: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
    """One classical step of q' = v, v' = D^-1 (tau - tau_d - C v - G)."""

    def slope(x: np.ndarray, time: float) -> np.ndarray:
        return np.concatenate([x[3:], ARM.forward_dynamics(x[:3], x[3:], tau - disturbance(time))])

    x = np.concatenate([q, v])
    k1 = slope(x, t)
    k2 = slope(x + DT / 2 * k1, t + DT / 2)
    k3 = slope(x + DT / 2 * k2, t + DT / 2)
    k4 = slope(x + DT * k3, t + DT)
    x = x + DT / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x[:3], x[3:]


@pytest.fixture(scope="module")
def twin() -> dict[str, np.ndarray]:
    law = printed_law()
    q, v = np.zeros(3), np.zeros(3)
    rows: dict[str, list[np.ndarray]] = {"q": [], "v": [], "tau": []}
    for k in range(2000):
        tau = law(q, reference(k * DT))
        for name, value in (("q", q), ("v", v), ("tau", tau)):
            rows[name].append(value)
        q, v = runge_kutta(q, v, tau, k * DT)
    return {name: np.array(values) for name, values in rows.items()}


@pytest.mark.parametrize("realisation", ["bumpless", "paper"])
def test_the_loop_is_the_papers_equations(realisation: str, twin: dict[str, np.ndarray]) -> None:
    robot = Robot.load("anthropomorphic3")
    loads = [
        Sine([0.7, 0.0, 0.0], 0.1, COSINE, onset=ONSETS[0]),
        Sine([0.0, 0.3, 0.0], 0.1, COSINE, onset=ONSETS[1]),
        Sine([0.0, 0.2, 0.0], 0.5, onset=ONSETS[1]),
        Sine([0.0, 0.0, 0.2], 0.1, onset=ONSETS[2]),
        Sine([0.0, 0.0, 0.1], 0.5, onset=ONSETS[2]),
    ]
    moves = Waypoints([[0.0] * 3, [0.8, 0.4, -0.4], [0.0] * 3], durations=[1.0, 0.7], holds=[0.3, 0.2, 0.0])
    controller = GPI(robot, DT, FixedGains(OMEGA), realisation=realisation, start="zero")
    rollout = simulate(RigidBodyPlant(robot, loads), controller, moves, 2.0)
    # Two ways to the same numbers: what differs is rounding, which the gains (up to 3.2e6 / s^5) amplify.
    np.testing.assert_allclose(rollout["q"][:-1], twin["q"], rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(rollout["v"][:-1], twin["v"], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(rollout["tau"][:-1], twin["tau"], rtol=0.0, atol=1e-8)
    # And it was a run worth comparing: brakes released, a move, three onsets.
    assert np.abs(twin["q"]).max() > 0.8
    assert np.abs(twin["q"] - [reference(k * DT) for k in range(2000)]).max() > 0.05
