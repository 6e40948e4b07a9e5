"""What has no generated code runs by NumPy, with one line that says why; nothing runs wrong in silence."""

from __future__ import annotations

import collections
import os
import random
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from loops import compiled

from armgpi import (
    GPI,
    ArmgpiWarning,
    Bezier,
    Controller,
    ControlStep,
    RigidBodyPlant,
    Robot,
    Status,
    Step,
    simulate,
)
from armgpi.codegen import build
from armgpi.codegen import run as generated
from armgpi.errors import ArrayError, ParameterError
from armgpi.loop import prepared as module
from armgpi.plants.plant import Wrapper
from armgpi.references.reference import Reference, Target

DT = 1e-3
ARM = Robot.load("anthropomorphic3")
MOVE = Bezier([0.0, 0.1, 0.0], [0.2, 0.3, 0.1], 0.05)
ROWS = np.random.default_rng(0).uniform(-0.01, 0.01, (3, 3))


class State(NamedTuple):
    """State of a user's law."""

    last: Any


class Law(Controller):
    """A user's law: a function of the error, in place of an elementwise one."""

    def __init__(self, law: Callable[..., Any], **attributes: Any) -> None:
        super().__init__(ARM, DT)
        self.law = law
        vars(self).update(attributes)

    def init(self, measurement: Any, target: Any) -> State:
        return State(measurement.q - target.q)

    def step(self, measurement: Any, target: Any, state: State) -> ControlStep:
        e = measurement.q - target.q
        tau = self.robot.dynamics.inverse(measurement.q, np.zeros_like(e), -1000.0 * self.law(self, e))
        return ControlStep(self.limited(tau), State(e))


def falls_back(controller: Any, reason: str, plant: Any = None, make: Any = None, **options: Any) -> None:
    """Check that a loop runs by NumPy with one warning, which gives the reason, and as by NumPy alone."""
    make = make or (lambda: controller)
    plant = plant or RigidBodyPlant(ARM)
    expected = simulate(plant, make(), MOVE, 0.03, **options)
    with pytest.warns(ArmgpiWarning) as caught:
        run = simulate(plant, make(), MOVE, 0.03, backend="compiled", **options)
    assert len(caught) == 1
    text = str(caught[0].message)
    assert text.startswith("running by NumPy: ")
    assert reason in text
    assert "BackendError" not in text
    assert "\n" not in text
    np.testing.assert_array_equal(run["q"], expected["q"])
    # Who did not ask for generated code is not told.
    with warnings.catch_warnings(), pytest.MonkeyPatch.context() as patch:
        warnings.simplefilter("error")
        patch.setattr(module, "_WORTH", 0.0)
        quiet = simulate(plant, make(), MOVE, 0.03, backend="auto", **options)
    np.testing.assert_array_equal(quiet["q"], expected["q"])


def counts(self: Any, e: Any) -> Any:
    self.count += 1
    return e * min(self.count, 10)


def integrates(self: Any, e: Any) -> Any:
    self.integral = self.integral + 1e-3 * e
    return e + self.integral


def integrates_in_place(self: Any, e: Any) -> Any:
    self.integral += 1e-3 * e
    return e + self.integral


def remembers(self: Any, e: Any) -> Any:
    self.memory.append(e)
    return e + 0.1 * self.memory[-2 if len(self.memory) > 1 else -1]


def keeps(self: Any, e: Any) -> Any:
    last, self.kept["last"] = self.kept.get("last", e), e
    return e + 0.1 * last


OUTSIDE: dict[str, Any] = {}


def keeps_outside(self: Any, e: Any) -> Any:
    last, OUTSIDE["last"] = OUTSIDE.get("last", e), e
    return e + 0.1 * last


def counts_calls(self: Any, e: Any, calls: list[int] = []) -> Any:  # noqa: B006 (what users do)
    calls.append(0)
    return e * (1.0 if len(calls) < 10 else 0.1)


LAWS: dict[str, tuple[Callable[..., Any], str, Callable[[], Any]]] = {
    "if": (lambda self, e: e if (e > 0.0).any() else 2.0 * e, "it decides by the values of symbols", dict),
    "if one": (lambda self, e: e if e[..., 0].ravel()[0] > 0.0 else 2.0 * e, "on symbols", dict),
    "and": (lambda self, e: e if np.all(e > 0.0) and e is not None else 2.0 * e, "np.all", dict),
    "count_nonzero": (lambda self, e: e if np.count_nonzero(e) else e + 1.0, "np.count_nonzero", dict),
    "sort": (lambda self, e: np.sort(e), "np.sort", dict),
    "ufunc": (lambda self, e: np.arctan2(e, 1.0), "np.arctan2", dict),
    "reduce": (lambda self, e: e + np.add.reduce(e, axis=-1, keepdims=True), "np.add", dict),
    "array": (lambda self, e: np.asarray(e) * 1.0, "makes an array of numbers", dict),
    "float": (lambda self, e: e * float(np.float64(1.0) + 0.0 * e.flat[0]), "on symbols", dict),
    "method": (lambda self, e: e + 0.1 * e.mean(), "mean", dict),
    "power": (lambda self, e: np.abs(e) ** 0.5 * np.sign(e), "power 0.5", dict),
    "raises": (lambda self, e: [e][1 if type(e) is not np.ndarray else 0], "IndexError on symbols", dict),
    "random": (
        lambda self, e: e * (1.0 + 1e-3 * self.random.normal()),
        "holds a Generator",
        lambda: {"random": np.random.default_rng(0)},
    ),
    "random of Python": (
        lambda self, e: e * (1.0 + 1e-3 * self.random.random()),
        "holds a Random",
        lambda: {"random": random.Random(0)},
    ),
    "queue": (remembers, "holds a deque", lambda: {"memory": collections.deque()}),
    "list": (remembers, "a list in it changes; what changes belongs into the state", lambda: {"memory": []}),
    "dictionary": (keeps, "a dict in it (last) changes", lambda: {"kept": {}}),
    "counter": (counts, "a Law in it (count) changes", lambda: {"count": 0}),
    "integral": (integrates, "a Law in it (integral) changes", lambda: {"integral": np.zeros(3)}),
    "global": (keeps_outside, "outside of it OUTSIDE changes", lambda: OUTSIDE.clear() or {}),  # type: ignore[func-returns-value]
    "default": (
        counts_calls,
        "outside of it counts_calls changes",
        lambda: counts_calls.__defaults__[0].clear() or {},  # type: ignore[index]
    ),
    "random of all": (
        lambda self, e: e * (1.0 if np.random.random() < 0.9 else 2.0),  # noqa: NPY002
        "outside of it np.random changes",
        lambda: np.random.seed(0) or {},  # noqa: NPY002
    ),
    "decimals": (lambda self, e: np.round(e, 6), "it rounds to 6 decimals", dict),
    "bits of numbers": (lambda self, e: e * (np.where(e > 1e-3, 2, 0) & 1), "bits of numbers", dict),
    "sum of booleans": (lambda self, e: e * ((e > 1e-3) + (e > 2e-3)), "arithmetic on booleans", dict),
    "single": (lambda self, e: np.add(e, 1e-3, dtype=np.float32), "np.add", dict),
    "whole": (lambda self, e: e + np.zeros_like(e, dtype=int), "another type", dict),
    "integral in place": (integrates_in_place, "changes", lambda: {"integral": np.zeros(3)}),
}


@pytest.mark.parametrize("name", LAWS)
def test_laws_that_have_no_code(name: str) -> None:
    law, reason, attributes = LAWS[name]
    falls_back(None, reason, make=lambda: Law(law, **attributes()))


def test_matrices_are_no_rows() -> None:
    K = np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.2], [0.1, 0.0, 1.0]])
    law = Law(lambda self, e: e @ self.K.T, K=K)
    for options in ({}, {"q0": MOVE.start + ROWS[:2]}):
        expected = simulate(RigidBodyPlant(ARM), law, MOVE, 0.03, **options)
        got = compiled(RigidBodyPlant(ARM), law, MOVE, 0.03, **options)
        np.testing.assert_allclose(got["q"], expected["q"], rtol=0, atol=1e-12)
    # With as many rollouts as joints it may be either.
    falls_back(law, "Law.K may be a matrix or have a row for each rollout", q0=MOVE.start + ROWS)


def test_dynamics_of_a_users_own() -> None:
    class Own:
        def __init__(self, base: Any) -> None:
            self.base = base

        def __getattr__(self, name: str) -> Any:
            return getattr(self.base, name)

    robot = ARM._with_attributes(dynamics=Own(ARM.dynamics))
    falls_back(GPI(ARM, DT), "its dynamics are Own, not Pinocchio's", plant=RigidBodyPlant(robot))


def test_a_plant_of_a_users_own() -> None:
    class Sticky(Wrapper):
        def step(self, tau: Any, state: Any, dt: float) -> Any:
            return self.plant.step(tau if np.abs(tau).max() > 1e-3 else 0.0 * tau, state, dt)

    falls_back(GPI(ARM, DT), "this loop has no generated code: ", plant=Sticky(RigidBodyPlant(ARM)))


def test_a_load_of_a_users_own() -> None:
    class Late(Step):
        def torque(self, t: Any) -> Any:
            return super().torque(t) if np.max(t) > 0.01 else 0.0 * super().torque(t)

    plant = RigidBodyPlant(ARM, Late(1.0))
    falls_back(GPI(ARM, DT), "np.max", plant=plant)


def test_a_state_of_another_form() -> None:
    class Growing(Law):
        def step(self, measurement: Any, target: Any, state: Any) -> ControlStep:
            tau, _ = super().step(measurement, target, state)
            return ControlStep(tau, (*state, measurement.q)[-3:])

    class Words(Law):
        def init(self, measurement: Any, target: Any) -> Any:
            return "words"

    falls_back(Growing(lambda self, e: e), "another form after a sample")
    falls_back(Words(lambda self, e: e), "its state holds a str")


@pytest.fixture
def fresh(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Forget compilers and libraries."""
    monkeypatch.setattr(build, "_loaded", {})
    monkeypatch.setattr(generated, "_generated", collections.OrderedDict())
    monkeypatch.setenv("ARMGPI_CACHE", str(tmp_path / "cache"))
    build.probe.cache_clear()


@pytest.mark.usefixtures("fresh")
@pytest.mark.parametrize("cc", ["/nonexistent", "false", "true", "sh -c 'exit 1'", " ", "'"])
def test_a_compiler_that_is_none(monkeypatch: pytest.MonkeyPatch, cc: str) -> None:
    monkeypatch.setenv("CC", cc)
    falls_back(GPI(ARM, DT), "CC names" if cc != "true" else "true failed: it said nothing")


@pytest.mark.usefixtures("fresh")
def test_no_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(build, "find_spec", lambda name: None)  # nor that of the package ziglang
    falls_back(
        GPI(ARM, DT), "no C compiler: none of cc, gcc and clang is there; install GCC or Clang, set CC"
    )


@pytest.mark.usefixtures("fresh")
@pytest.mark.parametrize(
    "script", ["echo 'fatal error: no space' >&2; exit 1", "exit 0", "kill -9 $$", "sleep 60"]
)
def test_a_compiler_that_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    path = tmp_path / "broken-cc"
    path.write_text(f'#!/bin/sh\n[ "$1" = --version ] && echo broken && exit 0\n{script}\n')
    path.chmod(0o755)
    monkeypatch.setenv("CC", str(path))
    monkeypatch.setattr(build, "_PATIENCE", 0.2)
    falls_back(GPI(ARM, DT), "broken-cc")


@pytest.mark.usefixtures("fresh")
def test_a_compiler_with_options(monkeypatch: pytest.MonkeyPatch) -> None:
    name = next(name for name in ("cc", "gcc", "clang") if build.probe((name,), os.environ["PATH"]))
    monkeypatch.setenv("CC", f"{name} -DUNUSED=1")
    compiled(RigidBodyPlant(ARM), GPI(ARM, DT), MOVE, 0.01)


def test_casadi_that_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [
        name for name in sys.modules if name.startswith(("casadi", "armgpi.codegen.", "armgpi.codegen."))
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "casadi", None)
    falls_back(GPI(ARM, DT), "casadi is not installed (pip install casadi)")


@pytest.mark.parametrize("backend", ["nonsense", "", "Compiled", None, 1, ["numpy"]])
def test_a_backend_that_is_none(backend: Any) -> None:
    with pytest.raises(ParameterError, match="one of numpy, compiled, auto"):
        simulate(RigidBodyPlant(ARM), GPI(ARM, DT), MOVE, 0.01, backend=backend)


def test_short_runs_are_not_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "library", lambda *_: pytest.fail("compiled"))
    arguments = (RigidBodyPlant(ARM), GPI(ARM, DT), MOVE, 0.01)
    np.testing.assert_array_equal(simulate(*arguments, backend="auto")["q"], simulate(*arguments)["q"])


def test_the_environment_is_left_as_it_was() -> None:
    before = dict(os.environ)
    compiled(RigidBodyPlant(ARM), GPI(ARM, DT), MOVE, 0.01)
    assert dict(os.environ) == before


def test_a_law_that_mixes_rollouts() -> None:
    # Traced for one rollout, e.mean() is over its joints; NumPy takes the mean of all rollouts.
    mixes = lambda self, e: e + np.sum(e)  # noqa: E731
    rows = Bezier(ROWS, ROWS + 0.1, 0.05)
    expected = simulate(RigidBodyPlant(ARM), Law(mixes), rows, 0.03, q0=ROWS + 0.01)
    with pytest.warns(ArmgpiWarning, match="sample 0 of it differs from NumPy's by"):
        run = simulate(RigidBodyPlant(ARM), Law(mixes), rows, 0.03, q0=ROWS + 0.01, backend="compiled")
    np.testing.assert_array_equal(run["q"], expected["q"])


def test_what_numpy_takes_over_is_blank_where_nothing_happened() -> None:
    # Refused by its first samples, then diverged: all that comes after is NaN.
    mixes = lambda self, e: -(e + np.sum(e))  # noqa: E731
    rows = Bezier(ROWS, ROWS + 0.1, 0.05)
    runs = []
    for backend in ("numpy", "compiled"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ArmgpiWarning)
            runs.append(
                simulate(
                    RigidBodyPlant(ARM),
                    Law(mixes),
                    rows,
                    3.0,
                    q0=ROWS + 0.01,
                    backend=backend,
                    divergence=0.1,
                )
            )
    assert (runs[0]["status"] == Status.DIVERGED).all()
    for name in ("q", "tau", "q_ref"):
        np.testing.assert_array_equal(runs[1][name], runs[0][name])


def test_a_law_that_mixes_rollouts_only_once_they_err() -> None:
    # At rest all errors are zero, and so is what differs.
    mixes = lambda self, e: e + np.where(np.abs(e) > 1e-2, np.sum(e), 0.0)  # noqa: E731
    q0 = np.broadcast_to(MOVE.start, (2, 3))
    falls_back(Law(mixes), "differs from NumPy's by", q0=q0)


def test_remainders_are_of_the_exact_quotient() -> None:
    law = Law(lambda self, e: e + 1e-3 * ((0.0 * e + 1.0) % 0.1) + 1e-3 * np.fmod(50.0 * e, 0.3))
    expected = simulate(RigidBodyPlant(ARM), law, MOVE, 0.03)
    got = compiled(RigidBodyPlant(ARM), law, MOVE, 0.03)
    np.testing.assert_allclose(got["q"], expected["q"], rtol=0, atol=1e-12)


class Given(Reference):
    """A reference that changes what a good one gives."""

    def __init__(self, change: Callable[[Target, Any], Any]) -> None:
        self.change = change

    def at(self, t: Any) -> Any:
        return self.change(MOVE.at(t), t)


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda r, t: Target(*(x.astype(np.int64) for x in r)), "q of '<i8'"),
        (lambda r, t: Target(*(x.astype(np.float32) for x in r)), "q of '<f4'"),
        (lambda r, t: Target(*(x.astype(">f8") for x in r)), "q of '>f8'"),
        (lambda r, t: r._replace(a=r.a.tolist()), "a of 'list'"),
        (lambda r, t: tuple(r), "got a tuple"),
        (lambda r, t: r._replace(v=np.zeros(3)) if np.ndim(t) else r, "of one shape"),
        (lambda r, t: Target(*(x[:1] for x in r)) if np.ndim(t) else r, "21 times|2001 times"),
        (lambda r, t: Target(*(x[..., :2] for x in r)), r"n = 3, got \(2,\)"),
    ],
)
def test_a_reference_that_gives_no_floats(change: Any, said: str, backend: str) -> None:
    with pytest.raises(ArrayError, match=said) as refused:
        simulate(RigidBodyPlant(ARM), GPI(ARM, DT), Given(change), 0.02, q0=[0.0, 0.1, 0.0], backend=backend)
    assert "\n" not in str(refused.value)


def test_a_reference_that_remembers_how_often_it_was_asked() -> None:
    asked: list[Any] = []

    def drifts(target: Target, t: Any) -> Target:
        asked.append(t)
        return target._replace(q=target.q + 1e-5 * len(asked))

    with pytest.warns(ArmgpiWarning, match="running by NumPy: .*Given gives something else each time"):
        simulate(RigidBodyPlant(ARM), GPI(ARM, DT), Given(drifts), 0.02, backend="compiled")
