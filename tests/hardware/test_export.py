"""Exported C: what compilers, sanitizers and Python say of it."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import machines
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sampling import for_search
from strategies import robots_and_states

import armgpi
from armgpi import (
    GPI,
    BSplineNetwork,
    Controller,
    ControlStep,
    Encoder,
    ExportedController,
    FixedGains,
    FullState,
    Measurement,
    PIDInversion,
    RigidBodyPlant,
    Robot,
    Saturated,
    Supervisor,
    Target,
    Waypoints,
    export_controller,
    simulate,
)
from armgpi.control.adrc import ADRC
from armgpi.control.ctdob import ComputedTorqueDOB
from armgpi.control.impedance import CartesianImpedance, JointImpedance
from armgpi.errors import BackendError, ParameterError, RolloutError
from armgpi.gpi.gains import GainStep, Tuning
from armgpi.gpi.schedule import GainSchedule
from armgpi.hardware.export import files
from armgpi.loop import log as logs
from armgpi.loop.log import INPUTS, ArmLog, Event, LogWriter
from armgpi.plants.loads import paper_disturbances

pytest.importorskip("casadi", reason="casadi writes the C")
from armgpi.codegen import build
from armgpi.hardware.export.code import Code, generate
from armgpi.hardware.export.files import record

FUZZ = (Path(__file__).parent / "fuzz.c").read_text()
#: What the issue asks for, and what an audit would.
STRICT = (
    *("-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-Wdouble-promotion"),
    *("-Wshadow", "-Wfloat-equal", "-Wmissing-prototypes", "-Wsign-conversion"),
    *("-fno-builtin-memset", "-fno-builtin-memcpy"),
)
SANITIZERS = ("-g", "-O1", "-std=gnu99", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
#: Functions of math.h; GCC makes one call of a sine and a cosine of the same number.
MATHS = {
    f"{name}{ending}"
    for name in ("sin", "cos", "sincos", "atan", "fabs", "sqrt", "exp", "log", "floor", "rint")
    for ending in ("", "f")
}

try:
    build.compiler()
    COMPILER = True
except BackendError:
    COMPILER = False
compiled = pytest.mark.skipif(not COMPILER, reason="there is no C compiler")
# Of the C that Python and `make` compile; what compilers say of it is asked of them by their names.
pytestmark = pytest.mark.usefixtures("compile_quickly")


def need(program: str) -> str:
    """The path of a program, or a skipped test."""
    found = shutil.which(program)
    if found is None:
        pytest.skip(f"{program} is not installed")
    return found


def undefined(folder: Path) -> set[str]:
    """What an object file leaves to others."""
    listed = subprocess.run(
        ["nm", "-u", "armgpi_controller.o"], cwd=folder, capture_output=True, text=True, check=True
    )
    return set(re.findall(r"U (\w+)", listed.stdout))


def paper_arm() -> Robot:
    return Robot.load("anthropomorphic3")


ARM = paper_arm()
Q = np.array([0.1, 0.4, -0.5])
REST = np.zeros(3)


def network(**options: Any) -> BSplineNetwork:
    return BSplineNetwork((20.0, 40.0), rate=2.0, dead_zone=1e-4, **options)


class Own(Controller):
    """A law of a user's, whose state is two numbers, and which needs no velocities."""

    def init(self, measurement: Measurement, target: Target) -> Any:
        return (0.0, measurement.q)

    def step(self, measurement: Measurement, target: Target, state: Any) -> ControlStep:
        count, last = state
        slope = (measurement.q - last) / self.dt
        tau = self.robot.dynamics.gravity(measurement.q) - 20.0 * (measurement.q - target.q) - slope
        tau = tau * np.where(count < 3.0, 0.5, 1.0) + np.round(np.sin(slope)) + np.sign(slope)
        return ControlStep(self.limited(tau), (count + 1.0, measurement.q))


CONTROLLERS: dict[str, Callable[[], Controller]] = {
    "fixed gains": lambda: GPI(paper_arm(), 1e-3),
    "paper realisation": lambda: GPI(paper_arm(), 1e-3, FixedGains(18.0, 0.8, 12.0), "paper"),
    "network": lambda: GPI(paper_arm(), 1e-3, network()),
    "network, weights": lambda: GPI(
        paper_arm(), 1e-3, network(weights={"omega_c": [[3.0, 9.0, 1.0, 20.0]] * 2 + [[0.0, 5.0, 2.0, 8.0]]})
    ),
    "network to the letter": lambda: GPI(paper_arm(), 1e-3, network(learning="signed", learning_rate=0.01)),
    "every parameter adapts": lambda: GPI(
        paper_arm(), 1e-3, BSplineNetwork((20.0, 30.0), (0.7, 1.0), (10.0, 30.0))
    ),
    "payload": lambda: GPI(paper_arm(), 1e-3, payload=(0.0, 0.05)),
    "roll-off": lambda: GPI(paper_arm(), 1e-3, rolloff=1, rolloff_ratio=[3.0, 4.0, 5.0]),
    "three integrators, roll-off 2, network": lambda: GPI(
        paper_arm(), 1e-3, network(), integrators=3, rolloff=2, rolloff_ratio=8.0, second_ratio=1.5
    ),
    "gravity ahead": lambda: GPI(paper_arm(), 1e-3, feedforward="gravity"),
    "model ahead, network": lambda: GPI(paper_arm(), 1e-3, network(), feedforward="model"),
    "computed torque": lambda: GPI(paper_arm(), 1e-3, feedforward="computed"),
    "friction ahead": lambda: GPI(paper_arm().with_friction(0.1, 0.2), 1e-3, friction_feedforward=True),
    "quiet at rest": lambda: GPI(paper_arm(), 1e-3, rolloff=1, rest_dead_zone=1e-4, rest_leak=50.0),
    "from zero": lambda: GPI(paper_arm(), 1e-3, start="zero"),
    "wrong inertia": lambda: GPI(paper_arm().scaled_inertia(0.8), 1e-3),
    "pid": lambda: PIDInversion(paper_arm(), 1e-3),
    "pid, wrong inertia": lambda: PIDInversion(paper_arm().scaled_inertia(0.8), 1e-3, bias_robot=paper_arm()),
    "a rail": lambda: GPI(machines.sled(bounds='lower="-1" upper="1"'), 1e-3),
    "no limits": lambda: GPI(machines.swing(2).with_limits(effort=np.inf, velocity=np.inf), 1e-3),
    "adrc": lambda: ADRC(paper_arm(), 1e-3),
    "ctdob": lambda: ComputedTorqueDOB(paper_arm().scaled_inertia(0.8), 1e-3, bias_robot=paper_arm()),
    "schedule": lambda: GPI(paper_arm(), 1e-3, GainSchedule()),
    "own": lambda: Own(paper_arm(), 1e-3),
    "tool as a spring": lambda: CartesianImpedance(paper_arm(), 1e-3, force_limit=2.0),
    "joints as springs": lambda: JointImpedance(paper_arm(), 1e-3, 5.0, torque_limit=1.0),
    "force limit": lambda: GPI(paper_arm().with_friction(0.1, 0.02), 1e-3, force_limit=2.0),
}
every = pytest.mark.parametrize("name", CONTROLLERS)
#: Whose C has a statement that the others' has not; `make search` looks at all.
UNLIKE = (
    *("paper realisation", "network", "every parameter adapts", "three integrators, roll-off 2, network"),
    *("model ahead, network", "friction ahead", "quiet at rest", "schedule", "pid", "adrc", "ctdob", "own"),
    *("tool as a spring", "force limit"),
    *("a rail", "no limits"),
)


def moves(robot: Robot, seconds: float = 1.0) -> Waypoints:
    """There and back, from the middle of the joint ranges."""
    middle = robot.middle()
    room = robot.limits.upper - robot.limits.lower
    there = middle + np.minimum(0.2, 0.25 * np.where(np.isfinite(room), room, 1.0))
    return Waypoints([middle, there, middle], durations=seconds, holds=[0.1, 0.2, 0.1])


def logged(controller: Controller, seconds: float = 1.0) -> ArmLog:
    robot: Any = controller.robot
    plant = Encoder(Saturated(RigidBodyPlant(robot)), 18)
    return record(plant, controller, moves(robot, seconds), 2.0 * seconds + 0.4)


# What compilers say.


def write(code: Code, folder: Path) -> None:
    """Write generated code, and C that compiles where the size of its state is as it is said to be."""
    (folder / "armgpi_controller.h").write_text(code.header)
    (folder / "armgpi_controller.c").write_text(code.source)
    right = f"typedef char right[sizeof(armgpi_state_t) == {code.state_bytes}U ? 1 : -1];"
    (folder / "size.c").write_text(f'#include "armgpi_controller.h"\n{right}\n')


@pytest.mark.slow
@compiled
@pytest.mark.parametrize(
    ("name", "real"),
    [
        (name, real) if real == "double" and name in UNLIKE else for_search(name, real)
        for name in CONTROLLERS
        for real in ("double", "float")
    ],
)
def test_compiles_without_a_warning_needs_math_h_alone_and_has_the_size_that_it_says(
    name: str, real: str, tmp_path: Path
) -> None:
    # What a supervisor leaves out is the same code for every law, and levels of optimisation are below.
    both = name in ("network", "pid")
    others = [Supervisor(on_fault="zero", frozen_samples=0, jump=0.0)] if both else []
    level = "-O2" if both or real == "float" else "-O1"
    for supervisor in (Supervisor(), *(others if real == "double" else ())):
        code = generate(CONTROLLERS[name](), real, supervisor)
        write(code, tmp_path)
        assert "malloc" not in code.source
        checked = [
            ("gcc", level, "-c", "armgpi_controller.c"),
            ("clang", "-fsyntax-only", "armgpi_controller.c"),
        ]
        for compiler, *rest in (*checked, ("cc", "-fsyntax-only", "size.c")):
            if shutil.which(compiler) is not None:
                command = [compiler, *(STRICT if rest[-1] != "size.c" else ("-std=c99",)), *rest]
                done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
                assert done.returncode == 0, done.stderr
        if shutil.which("gcc") and shutil.which("nm"):
            assert undefined(tmp_path) <= MATHS


@pytest.mark.slow
@compiled
@pytest.mark.parametrize("name", ["network", "pid", "own", "schedule"])
def test_single_precision_compiles_without_a_warning_and_has_the_size_that_it_says(
    name: str, tmp_path: Path
) -> None:
    write(generate(CONTROLLERS[name](), "float", Supervisor(on_fault="zero", frozen_samples=0)), tmp_path)
    compiler = need("gcc")
    for flags, file in ((STRICT, "armgpi_controller.c"), (("-std=c99",), "size.c")):
        subprocess.run([compiler, *flags, "-fsyntax-only", file], cwd=tmp_path, check=True)


@compiled
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("level", ["-O0", "-Os", "-O3"])
def test_no_optimisation_makes_it_need_more(compiler: str, level: str, tmp_path: Path) -> None:
    need(compiler)
    need("nm")
    write(generate(CONTROLLERS["network"]()), tmp_path)
    command = [compiler, *STRICT, level, "-c", "armgpi_controller.c"]
    subprocess.run(command, cwd=tmp_path, check=True)
    assert undefined(tmp_path) <= MATHS


@compiled
@pytest.mark.parametrize(
    ("name", "real", "action", "rate"),
    [
        ("network", "double", "hold", None),
        ("pid", "float", "zero", 200.0),
        for_search("own", "float", "hold", None),
        ("fixed gains", "double", "brake", 100.0),
    ],
)
def test_samples_of_any_bits_give_torque_within_limits_and_rate_under_the_sanitizers(
    name: str, real: str, action: str, rate: float | None, tmp_path: Path
) -> None:
    compiler = need("gcc")
    code = generate(CONTROLLERS[name](), real, Supervisor(on_fault=action, jump=50.0, torque_rate=rate))
    count = len(code.law.inputs)
    arrays = ", ".join(f"in[{i}]" for i in range(count))
    write(code, tmp_path)
    fuzz = (
        f"#define ARGUMENTS {count}\n#define STEP(state, tau) armgpi_step(state, {arrays}, tau)\n"
        f"#define INIT(state) (void)armgpi_reset(state, {arrays})\n"
        f"#define MOST {1e30 if rate is None else 1.0001e-3 * rate!r}\n"
    )
    (tmp_path / "fuzz.c").write_text(fuzz + FUZZ)
    command = [compiler, *SANITIZERS, "-o", "fuzz", "fuzz.c", "armgpi_controller.c", "-lm"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    if "cannot find" in done.stderr:
        pytest.skip(f"{compiler} has no sanitizers here")
    assert done.returncode == 0, done.stderr
    done = subprocess.run(["./fuzz"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
@compiled
@pytest.mark.parametrize("name", ["network", "pid"])
def test_the_folder_builds_and_replays_and_is_clean_under_sanitizers_and_valgrind(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CC", raising=False)
    controller = CONTROLLERS[name]()
    log = logged(controller, 0.2)
    done = export_controller(controller, tmp_path, log, measure=False)
    assert done.measured is None
    assert "no C compiler" in (tmp_path / "README.md").read_text()
    make = need("make")
    for target in ("all", "strict", "sanitize") if name == "network" else ("all",):
        ran = subprocess.run([make, target], cwd=tmp_path, capture_output=True, text=True, check=False)
        if "cannot find" in ran.stderr:
            continue  # no sanitizers here
        assert ran.returncode == 0, ran.stdout + ran.stderr
    if name != "network":
        return
    valgrind = need("valgrind")
    ran = subprocess.run(
        [valgrind, "-q", "--error-exitcode=9", "--leak-check=full", "./replay"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert f"samples {len(log.tau)}" in ran.stdout
    # What the replay says is what it does: another torque is found.
    there = logs.read(tmp_path / "log.armlog")
    rows = there.rows.copy()
    rows["tau"][20] += 1e-9
    logs.write(there._replace(rows=rows), tmp_path / "other.armlog")
    ran = subprocess.run(
        ["./replay", "other.armlog"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 1
    for bad in ("none.armlog", "main.c"):
        assert subprocess.run(["./replay", bad], cwd=tmp_path, capture_output=True).returncode == 2


# What Python says.


@compiled
@pytest.mark.parametrize("name", [name if name in UNLIKE else for_search(name) for name in CONTROLLERS])
def test_equals_python_step_by_step(name: str) -> None:
    controller = CONTROLLERS[name]()
    log = logged(controller, 0.5)
    exported = ExportedController.of(controller)
    scale = np.where(np.isfinite(controller.effort), controller.effort, np.abs(log.tau).max(axis=0))
    tau = replayed(exported, log)
    paper = (
        getattr(controller, "realisation", "") == "paper"
    )  # its states grow, and their roundings with them
    assert (np.abs(tau - log.tau) / scale).max() < (1e-11 if paper else 1e-12)


def replayed(exported: ExportedController, log: ArmLog) -> Any:
    """The torques that exported code answers a log with."""
    state, taus = None, []
    for row in log.samples:
        target = Target(row["q_ref"], row["v_ref"], row["a_ref"])
        seen: Any = Measurement(row["q_measured"])
        if exported.measurement_type is FullState:
            seen = FullState(row["q_measured"], row["v_measured"])
        state = exported.init(seen, target) if state is None else state
        tau, state = exported.step(seen, target, state)
        taus.append(tau)
    assert exported.report(state).status == "run"
    return np.array(taus)


@pytest.mark.slow
@compiled
@pytest.mark.parametrize(("realisation", "seconds"), [("bumpless", 20.0), ("paper", 10.0)])
def test_equals_python_over_a_long_log_of_disturbed_motion(
    realisation: str, seconds: float, tmp_path: Path
) -> None:
    # The printed law stands no gains that change.
    gains = network() if realisation == "bumpless" else FixedGains(20.0)
    controller = GPI(ARM, 1e-3, gains, realisation)
    plant = Encoder(Saturated(RigidBodyPlant(ARM, paper_disturbances())), 18)
    # What was measured may come from generated code; the torques are those of Python.
    rollout = simulate(plant, controller, moves(ARM, 9.0), seconds, backend="compiled")
    measured, q_ref, v_ref = (rollout[name].values[:-1] for name in ("q_measured", "q_ref", "v_ref"))
    state = controller.init(Measurement(measured[0]), Target(q_ref[0], REST, REST))
    taus = []
    for q, goal in zip(measured, q_ref, strict=True):
        tau, state = controller.step(Measurement(q), Target(goal, REST, REST), state)
        taus.append(tau)
    writer = LogWriter(ARM.joint_names, 1e-3, INPUTS, len(taus) + 1)
    for k, (q, goal, v, tau) in enumerate(zip(measured, q_ref, v_ref, taus, strict=False)):
        given = FullState(q, q), Target(goal, v, v)
        if k == 0:
            writer.take(0, *given, REST, event=Event.INIT, elapsed=0)
        writer.take(k, *given, tau)
    log = writer.log()
    assert len(log.tau) == round(1000 * seconds)
    done = export_controller(controller, tmp_path, log)
    assert done.measured is not None
    assert done.measured.agrees
    assert done.measured.difference < (1e-12 if realisation == "bumpless" else 1e-10)


@pytest.mark.slow
@compiled
@settings(max_examples=6)
@given(robots_and_states(max_joints=5), st.sampled_from(["bumpless", "paper"]))
def test_equals_python_for_any_arm(case: Any, realisation: str) -> None:
    robot, state = case
    controller = GPI(robot, 1e-3, realisation=realisation)
    exported = ExportedController.of(controller, supervisor=Supervisor(jump=0.0))
    target = Target(state.q + 1e-3, state.v, state.a)
    own = controller.init(Measurement(state.q), target)
    theirs = exported.init(Measurement(state.q), target)
    for k in range(5):
        seen = Measurement(state.q + 1e-4 * k * state.v)
        tau, own = controller.step(seen, target, own)
        found, theirs = exported.step(seen, target, theirs)
        np.testing.assert_allclose(found, tau, rtol=0.0, atol=1e-11 * np.max(np.asarray(controller.effort)))


@compiled
def test_joints_that_follow_others_are_exported_as_well() -> None:
    robot = Robot.load("panda", mimic="follow") if "panda" in armgpi.robots.names() else None
    if robot is None:
        pytest.skip("the robots extra is not installed")
    controller = GPI(robot, 1e-3)
    log = logged(controller, 1.0)
    least = np.min(np.asarray(controller.effort))
    np.testing.assert_allclose(replayed(ExportedController.of(controller), log), log.tau, atol=1e-12 * least)


@compiled
@pytest.mark.parametrize("name", ["network", "pid", "own"])
def test_runs_in_a_simulation_like_any_controller(name: str) -> None:
    controller = CONTROLLERS[name]()
    robot: Any = controller.robot
    plant = Encoder(
        Saturated(RigidBodyPlant(robot, [armgpi.Sine(np.ones(3), np.array([9.0, 8.0, 7.0]))])), 16
    )
    exported = ExportedController.of(controller)
    ours, theirs = (simulate(plant, c, moves(robot), 1.0) for c in (controller, exported))
    np.testing.assert_allclose(theirs["q"], ours["q"], atol=1e-10)
    assert exported.describe()["controller"] == "ExportedController"
    # A run can be branched and resumed: the state that went in is as it was.
    seen: Any = (
        FullState(robot.middle(), np.zeros(3))
        if exported.measurement_type is FullState
        else Measurement(robot.middle())
    )
    target = Target(Q + 0.1, REST, REST)
    state = exported.init(seen, target)
    before = state.copy()
    first, second = exported.step(seen, target, state), exported.step(seen, target, state)
    np.testing.assert_array_equal(state, before)
    np.testing.assert_array_equal(first.tau, second.tau)
    np.testing.assert_array_equal(first.state, second.state)


@compiled
def test_single_precision_tracks_as_well_in_a_closed_loop() -> None:
    controller = CONTROLLERS["network"]()
    robot: Any = controller.robot
    plant = Encoder(Saturated(RigidBodyPlant(robot)), 16)
    single = ExportedController.of(controller, "float")
    ours, theirs = (simulate(plant, c, moves(robot, 2.0), 4.0) for c in (controller, single))
    count = 2.0 * np.pi / 2**16
    # Apart by encoder counts: single precision has 2^24 numbers in an octave.
    assert float(np.abs(theirs["q"] - ours["q"]).max()) < 3.0 * count
    assert single.real == "float"
    assert single.state_bytes < 0.6 * ExportedController.of(controller).state_bytes


# Faults.


@cache
def exported_under(supervisor: Supervisor | None, real: str = "double") -> ExportedController:
    """The law of the paper's arm, compiled once for each supervisor."""
    return ExportedController.of(GPI(ARM, 1e-3), real, supervisor)


def started(supervisor: Supervisor | None = None) -> tuple[ExportedController, Any]:
    """A controller after a quiet sample."""
    exported = exported_under(supervisor)
    state = exported.init(Measurement(Q), Target(Q, REST, REST))
    return exported, exported.step(Measurement(Q), Target(Q, REST, REST), state).state


def after(exported: ExportedController, state: Any, q: Any = Q, q_ref: Any = Q) -> ControlStep:
    return exported.step(Measurement(np.asarray(q)), Target(np.asarray(q_ref), REST, REST), state)


@compiled
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("action", ["hold", "zero"])
def test_a_number_that_is_none_stops_the_arm_until_it_is_reset(bad: float, action: str) -> None:
    exported, state = started(Supervisor(on_fault=action, missed=5))
    for q, q_ref, reason in (([0.1, bad, 0.0], Q, "not_finite"), (Q, [0.1, bad, 0.0], "reference")):
        tau, faulty = after(exported, state, q, q_ref)
        assert exported.report(faulty) == ("stopping" if q is not Q else "hold", reason, "q2")
        np.testing.assert_allclose(tau, ARM.gravity(Q), atol=1e-12)
        for _ in range(3):  # nothing leads out of it by itself; the loop is closed again
            tau, faulty = after(exported, faulty)
            assert exported.report(faulty) == ("hold", reason, "q2")
            np.testing.assert_allclose(tau, ARM.gravity(Q), atol=1e-12)
        again = exported.init(Measurement(Q), Target(Q, REST, REST))
        np.testing.assert_array_equal(after(exported, again).tau, after(exported, started()[1]).tau)
    # Without a measurement for so many samples the loop is opened for good.
    for _ in range(6):
        tau, state = after(exported, state, [0.1, bad, 0.0])
    expected = ARM.gravity(Q) if action == "hold" else REST
    for _ in range(3):
        assert exported.report(state) == ("fault", "not_finite", "q2")
        np.testing.assert_allclose(tau, expected, atol=1e-12)
        tau, state = after(exported, state)


@compiled
def test_without_a_good_configuration_there_is_no_holding_torque() -> None:
    exported, _ = started()
    state = exported.init(Measurement(Q * np.nan), Target(Q, REST, REST))
    assert exported.report(state) == ("fault", "not_finite", "q1")
    np.testing.assert_array_equal(after(exported, state).tau, REST)
    never = np.zeros_like(state)
    assert exported.report(never) == ("init", "none", None)
    tau, state = after(exported, never)
    assert exported.report(state)[:2] == ("fault", "before_init")
    np.testing.assert_array_equal(tau, REST)


@compiled
def test_holding_torque_is_cut_to_the_limits() -> None:
    weak = GPI(ARM.with_limits(effort=0.5), 1e-3)
    exported = ExportedController.of(weak)
    state = exported.init(Measurement(Q), Target(Q, REST, REST))
    tau, _ = after(exported, state, [np.nan] * 3)
    np.testing.assert_allclose(tau, np.clip(ARM.gravity(Q), -0.5, 0.5), atol=1e-12)


@compiled
def test_a_jump_is_what_the_joint_cannot_do_in_a_sample() -> None:
    most = 2.0 * 1e-3 * ARM.limits.velocity + 2.0 * 2.0 * np.pi / 2**16
    for j, name in enumerate(ARM.joint_names):
        exported, state = started()
        step = np.eye(3)[j] * most[j]
        assert exported.report(after(exported, state, Q + 0.999 * step).state).status == "run"
        assert exported.report(after(exported, state, Q - 1.001 * step).state) == ("stopping", "jump", name)
    exported, state = started(Supervisor(jump=0.0, following=2.0))
    assert exported.report(after(exported, state, Q + 1.0).state).status == "run"


@compiled
def test_a_joint_without_a_velocity_limit_does_not_jump() -> None:
    free = GPI(ARM.with_limits(velocity=[0.0, np.inf, 1.0]), 1e-3)
    exported = ExportedController.of(free, supervisor=Supervisor(following=1.0))
    state = exported.init(Measurement(Q), Target(Q, REST, REST))
    assert exported.report(after(exported, state, Q + np.array([0.5, 0.5, 0.0])).state).status == "run"
    assert exported.report(after(exported, state, Q + np.array([0.0, 0.0, 0.5])).state).reason == "jump"


@compiled
def test_an_arm_that_rightly_stands_still_is_no_frozen_sensor() -> None:
    exported, state = started()
    tau = None
    for _ in range(5000):  # not a count in 5 s, and nothing asks for one
        tau, state = after(exported, state)
    assert exported.report(state).status == "run"
    np.testing.assert_allclose(tau, ARM.gravity(Q), atol=1e-9)


@compiled
def test_coarse_encoders_of_an_arm_at_rest_and_in_motion_are_not_frozen() -> None:
    plant = Encoder(Saturated(RigidBodyPlant(ARM.with_payload("tool", 0.1))), 10)
    counts = Supervisor(resolution=2.0 * np.pi / 2**10)
    exported = ExportedController.of(GPI(ARM, 1e-3, FixedGains(12.0)), supervisor=counts)
    reference = Waypoints([Q, Q + np.array([0.5, 0.0, 0.3]), Q], durations=[2.0, 4.0], holds=[2.0, 2.0, 2.0])
    loop = armgpi.ClosedLoop(plant, exported, reference)
    state = loop.init()
    for k in range(12_000):
        state = loop.step(state).state
        assert exported.report(state.controller).status == "run"
        if k % 100 == 0:
            assert np.abs(loop.true_state(state).q - reference.at(1e-3 * (k + 1)).q).max() < 0.1


@compiled
def test_a_sensor_that_freezes_in_motion_is_found_after_so_many_samples() -> None:
    exported, state = started(Supervisor(frozen_samples=20, sticking=0.0))
    travel = 16.0 * 2.0 * np.pi / 2**16
    q_ref, taken = Q.copy(), 0
    while exported.report(state).status == "run":
        q_ref = q_ref + np.array([0.0, 1e-4, 0.0])
        taken += 1
        state = after(exported, state, Q, q_ref).state
    assert exported.report(state) == ("fault", "frozen", "q2")
    assert taken == int(travel / 1e-4) + 20
    # Switched off, the law goes on.
    exported, state = started(Supervisor(frozen_samples=0))
    for k in range(200):
        state = after(exported, state, Q, Q + 1e-4 * k).state
    assert exported.report(state).status == "run"


@compiled
def test_a_sensor_that_freezes_beside_its_goal_is_found_by_the_torque_that_grows() -> None:
    exported, state = started()
    off = Q + np.array([0.0, 0.0, 1e-4])
    state = after(exported, state, off).state
    taus: list[Any] = []
    while exported.report(state).status == "run" and len(taus) < 20_000:
        tau, state = after(exported, state, off)
        taus.append(tau)
    assert exported.report(state) == ("fault", "frozen", "q3")
    assert np.abs(taus[-2] - taus[0])[2] > 0.5 * ARM.limits.effort[2]
    assert len(taus) < 20_000


STOPS = [Supervisor(on_fault=action, jump=jump) for action, jump in (("brake", 0), ("hold", 2), ("zero", 2))]


@compiled
@pytest.mark.parametrize("real", ["double", "float"])
@settings(max_examples=60)
@given(data=st.data())
def test_whatever_comes_torque_is_finite_and_within_limits(real: str, data: st.DataObject) -> None:
    exported = exported_under(data.draw(st.sampled_from(STOPS)), real)
    anything = st.floats(width=64) | st.sampled_from([0.1, 0.4, -0.5, 0.101])
    triples = st.lists(anything, min_size=3, max_size=3).map(np.array)
    with np.errstate(over="ignore"):
        state = exported.init(Measurement(Q), Target(Q, REST, REST))
        for _ in range(6):
            tau, state = after(exported, state, data.draw(triples), data.draw(triples))
            assert (np.abs(tau) <= ARM.limits.effort).all()


# Bad input.


class Branches(GPI):
    """Decides by the value of a measurement."""

    def step(self, measurement: Measurement, target: Target, state: Any) -> ControlStep:
        if (measurement.q > 1.0).any():
            return ControlStep(np.zeros(3), state)
        return super().step(measurement, target, state)


class Listed(GPI):
    """Uses what symbols do not have."""

    measurement_type: ClassVar = Measurement

    def step(self, measurement: Measurement, target: Target, state: Any) -> ControlStep:
        return ControlStep(np.array(measurement.q.tolist()), state)


class Sentence(GPI):
    """Has a state that is no number."""

    def init(self, measurement: Measurement, target: Target) -> Any:
        return "a text"


class Dice(FixedGains):
    """Gains that draw random numbers of their own."""

    adaptive = True

    def prepare(self, joint_names: Any, dt: float) -> Dice:
        made = object.__new__(Dice)
        vars(made).update(vars(super().prepare(joint_names, dt)))
        return made

    def step(self, e: Any, learn: Any, state: None) -> GainStep:
        omega, zeta, p = self.nominal()
        return GainStep(Tuning(omega * (1.0 + 0.01 * np.random.random()), zeta, p), None)  # noqa: NPY002


@pytest.mark.parametrize(
    ("make", "error", "said"),
    [
        (
            lambda: GPI(ARM, 1e-3, Dice(20.0)),
            BackendError,
            "GPI cannot be written as C: outside of it np.random changes",
        ),
        (lambda: GPI(ARM, 1e-3, FixedGains(np.full((4, 3), 20.0))), ParameterError, "single rollout.*4"),
        (lambda: Branches(ARM, 1e-3), BackendError, "Branches cannot be written as C: it decides"),
        (lambda: Listed(ARM, 1e-3), BackendError, "Listed cannot be written as C: .*tolist"),
        (lambda: Sentence(ARM, 1e-3), BackendError, "its state holds a str"),
        (lambda: "gpi", ParameterError, "controller must be a Controller"),
    ],
)
def test_what_cannot_be_exported_is_refused_in_one_line(
    make: Any, error: Any, said: str, tmp_path: Path
) -> None:
    with pytest.raises(error, match=said) as refused:
        export_controller(make(), tmp_path / "new")
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("supervisor", "real", "said"),
    [
        ({"on_fault": "stop"}, "double", "on_fault must be one of brake, hold, zero"),
        ({"frozen_samples": -1}, "double", "frozen_samples"),
        ({"frozen_samples": 2**40}, "double", "frozen_samples"),
        ({"jump": -1.0}, "double", "jump"),
        ({"jump": np.nan}, "double", "jump"),
        ({"torque_rate": 0.0}, "double", "torque_rate"),
        ({"following": -0.5}, "double", "following"),
        ({"missed": 1.5}, "double", "missed"),
        ({"resolution": [1.0, 2.0]}, "double", "resolution"),
        ({}, "half", "real must be one of double, float"),
    ],
)
def test_settings_that_cannot_be_are_refused(supervisor: dict[str, Any], real: str, said: str) -> None:
    with pytest.raises(armgpi.ArmgpiError, match=said):
        generate(GPI(ARM, 1e-3), real, Supervisor(**supervisor))


def test_a_folder_that_cannot_be_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(RolloutError, match="cannot be written to"):
            export_controller(GPI(ARM, 1e-3), folder)


@compiled
def test_what_was_exported_is_read_from_its_folder(tmp_path: Path) -> None:
    done = export_controller(GPI(ARM, 1e-3), tmp_path, real="float")
    assert done.measured is not None
    assert done.measured.agrees
    exported = ExportedController(ARM, tmp_path)
    assert exported.dt == 1e-3
    np.testing.assert_array_equal(exported.effort, ARM.limits.effort)
    with pytest.raises(ParameterError, match="one with the joints q1, q2, q3"):
        ExportedController(machines.swing(), tmp_path)
    with pytest.raises(ParameterError, match="one rollout"):
        simulate(RigidBodyPlant(ARM), exported, armgpi.Hold(np.tile(Q, (2, 1))), 0.01)
    with pytest.raises(BackendError, match="cannot be read"):
        ExportedController(ARM, tmp_path / "none")
    (tmp_path / "armgpi_controller.c").write_text("int main(void) { return 0; }")
    with pytest.raises(BackendError, match="no exported controller"):
        ExportedController(ARM, tmp_path)
    (tmp_path / "armgpi_controller.c").write_text("this is no C")
    with pytest.raises(BackendError, match="failed"):
        ExportedController(ARM, tmp_path)


@compiled
def test_generated_code_of_a_whole_loop_is_not_made_of_exported_code() -> None:
    exported = ExportedController.of(GPI(ARM, 1e-3))
    with pytest.warns(armgpi.ArmgpiWarning, match="running by NumPy"):
        rollout = simulate(RigidBodyPlant(ARM), exported, armgpi.Hold(Q), 0.01, backend="compiled")
    assert int(rollout["status"]) == armgpi.Status.FINISHED


def test_names_of_joints_can_be_anything(tmp_path: Path) -> None:
    xml = Path(armgpi.__file__).parents[1] / "urdf" / "anthropomorphic3.urdf"
    text = xml.read_text()
    for old, new in (("q1", "a */ b"), ("q2", "schulter ü"), ("q3", "a __ b??/")):
        text = text.replace(f'name="{old}"', f'name="{new}"')
    robot = Robot.from_xml(text)
    done = export_controller(GPI(robot, 1e-3), tmp_path)
    header = done.files[0].read_text()
    assert len(set(re.findall(r"ARMGPI_JOINT_(\w+) =", header))) == 3
    if COMPILER:
        assert done.measured is not None
        assert done.measured.agrees
        assert ExportedController(robot, tmp_path).report(np.zeros(99, dtype=np.uint64)).status == "init"


def test_names_of_joints_in_c_are_all_different() -> None:
    from armgpi.hardware.export.names import identifiers

    assert len(set(identifiers(["a_2", "a", "A", "a-2", ""]))) == 5


def test_what_is_not_a_number_is_not_cut_to_the_limit() -> None:
    # inf - inf, from numbers that are all finite: no torque, and a state that would stay so for good.
    controller = GPI(Robot.load("anthropomorphic3"), 1e-3)
    exported = ExportedController.of(controller, supervisor=Supervisor(jump=0.0, frozen_samples=0))
    q = exported.robot.middle()
    target = Target(q, np.zeros(3), np.zeros(3))
    state = exported.init(Measurement(q), target)
    tau, state = exported.step(
        Measurement(np.full(3, 1.7e308)), target._replace(q=np.full(3, -1.7e308)), state
    )
    assert np.isfinite(tau).all()
    assert exported.report(state)[:2] == ("stopping", "not_finite")
    tau, state = after(exported, state, q, q)
    assert np.isfinite(tau).all()
    assert exported.report(state).status == "hold"


# Names.


BOTH = """
#include "left_arm.h"
#include "RIGHT.h"
#include "armgpi_controller.h"
int main(%s)
{
    static left_arm_state_t left;
    static RIGHT_state_t right;
    static armgpi_state_t plain;
    static const double q[ARMGPI_N] = {0.1, 0.4, -0.5};
    static const double q_ref[ARMGPI_N] = {0.2, 0.5, -0.6};
    static const float rail[RIGHT_N] = {0.0F}, rail_ref[RIGHT_N] = {0.1F};
    double tau[2][LEFT_ARM_N];
    float push[RIGHT_N];

    (void)left_arm_init(&left, q, q_ref);
    (void)armgpi_init(&plain, q, q_ref);
    (void)RIGHT_init(&right, rail, rail);
    (void)left_arm_step(&left, q, q_ref, tau[0]);
    (void)armgpi_step(&plain, q, q_ref, tau[1]);
    (void)RIGHT_step(&right, rail, rail_ref, push);
    return ((left.status == LEFT_ARM_STATUS_RUN) && (right.status == RIGHT_STATUS_RUN) &&
        (left_arm_info.n == 3U) && (right.fault_joint == 0U) && (push[RIGHT_JOINT_SLIDE] > 0.0F) &&
        (tau[0][0] >= tau[1][0]) && (tau[0][0] <= tau[1][0]) && (LEFT_ARM_DT < 1.0)) ? 0 : 1;
}
"""


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with three controllers by names of their own, compiled, and the text of a program of them."""
    folder, rail = tmp_path_factory.mktemp("three"), CONTROLLERS["a rail"]()
    for controller, name, real in (
        (GPI(ARM, 1e-3), "left_arm", "double"),
        (rail, "RIGHT", "float"),
        (GPI(ARM, 1e-3), None, "double"),
    ):
        file = export_controller(controller, folder, name=name, real=real, measure=False).files[1].name
        subprocess.run([need("cc"), *STRICT, "-c", file, "-o", f"{file}.o"], cwd=folder, check=True)
    joint = f"RIGHT_JOINT_{rail.robot.joint_names[0].upper()}"
    (folder / "both.txt").write_text(BOTH.replace("RIGHT_JOINT_SLIDE", joint))
    return folder


@compiled
@pytest.mark.parametrize(("compiler", "standard"), [("cc", "c99"), ("g++", "c++11"), ("clang++", "c++17")])
def test_controllers_by_other_names_go_into_one_program(
    compiler: str, standard: str, three: Path, tmp_path: Path
) -> None:
    language, none = ("c++", "") if "+" in compiler else ("c", "void")
    (tmp_path / "both.txt").write_text((three / "both.txt").read_text() % none)
    flags = ["-Wall", "-Wextra", "-pedantic", "-Werror", f"-std={standard}", f"-I{three}"]
    sources = ["-x", language, "both.txt", "-x", "none", *map(str, three.glob("*.o"))]
    subprocess.run([need(compiler), *flags, *sources, "-o", "both", "-lm"], cwd=tmp_path, check=True)
    assert subprocess.run([str(tmp_path / "both")], check=False).returncode == 0


@compiled
def test_a_folder_of_another_name_replays_and_runs(tmp_path: Path) -> None:
    text = (Path(armgpi.__file__).parents[1] / "urdf" / "anthropomorphic3.urdf").read_text()
    robot = Robot.from_xml(text.replace('name="q1"', 'name="armgpi_q1"'))
    done = export_controller(GPI(robot, 1e-3), tmp_path, name="arm2")
    assert done.measured is not None
    assert done.measured.agrees
    assert done.measured.stack is None or done.measured.stack > 0
    names = [path.name for path in done.files]
    assert names[:6] == ["arm2.h", "arm2.c", "main.c", "Makefile", "arm2_log.h", "arm2_log.c"]
    assert names[6:10] == ["README.md", "CMakeLists.txt", "arm2_controller.hpp", "arm2_controller.py"]
    assert names[10:] == [
        "arm2_move.h",
        "arm2_move.c",
        "test_faults.c",
        "arm2_follow.h",
        "arm2_follow.c",
        "log.armlog",
        "motion.csv",
        "SHA256SUMS",
    ]
    texts = {path.name: path.read_text() for path in done.files if path.suffix != ".armlog"}
    left = {name: re.findall(r"\w*armgpi_\w*", text, re.IGNORECASE) for name, text in texts.items()}
    assert set(left["arm2.c"]) == {"armgpi_q1"}
    own = ("main.c", "Makefile", "arm2_move.h", "arm2_move.c", "arm2_log.h", "arm2_log.c", "arm2_follow.h")
    assert not [word for name in own for word in left[name]]
    subprocess.run([need("make"), "-s", "all", "strict"], cwd=tmp_path, check=True, capture_output=True)
    exported = ExportedController(robot, tmp_path, "arm2")
    seen, target = Measurement(Q), Target(Q + 0.1, REST, REST)
    plain = ExportedController.of(GPI(robot, 1e-3))
    np.testing.assert_array_equal(
        exported.step(seen, target, exported.init(seen, target)).tau,
        plain.step(seen, target, plain.init(seen, target)).tau,
    )
    with pytest.raises(BackendError, match=r"armgpi_controller.h: cannot be read"):
        ExportedController(robot, tmp_path)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("", "a C identifier"),
        ("2nd", "a C identifier"),
        ("left-arm", "a C identifier"),
        ("_left", "a C identifier"),
        ("l\u00e4nk", "a C identifier"),
        ("left arm\n", "a C identifier"),
        ("a" * 32, "a C identifier"),
        (3, "a C identifier"),
        ("main", "other files main.h"),
        ("Math", "other files Math.h"),
        ("law", "law_(init|step) is used"),
        ("armgpi", "is used in the C"),
    ],
)
def test_names_that_cannot_be_are_refused(name: Any, said: str, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=said) as refused:
        export_controller(GPI(ARM, 1e-3), tmp_path / "new", name=name, measure=False)
    assert "\n" not in str(refused.value).replace("left arm\n", "")
    assert not (tmp_path / "new").exists()


class Counts(Own):
    """As its parent, but counts in whole numbers."""

    def init(self, measurement: Measurement, target: Target) -> Any:
        return (0, measurement.q)

    def step(self, measurement: Measurement, target: Target, state: Any) -> ControlStep:
        tau, (_, last) = super().step(measurement, target, (1.0 * state[0], state[1]))
        return ControlStep(tau, (state[0] + 1, last))


@compiled
def test_whole_numbers_are_not_counted_in_single_precision(tmp_path: Path) -> None:
    with pytest.raises(BackendError, match=r"an int, '0', and a float counts no further than 16,777,216"):
        export_controller(Counts(ARM, 1e-3), tmp_path, real="float")
    done = export_controller(Counts(ARM, 1e-3), tmp_path, logged(Counts(ARM, 1e-3), 0.1))
    assert done.measured is not None
    assert done.measured.agrees


@pytest.mark.parametrize("following", [0.1, 1.25, 2.5])
def test_no_whole_number_has_the_suffix_of_a_float(following: float, tmp_path: Path) -> None:
    """`10F` is no number in C: a position far away that is a whole number was written so."""
    controller = armgpi.Supervised(GPI(ARM, 1e-3), armgpi.Supervisor(following=following))
    export_controller(controller, tmp_path, measure=False, real="float")
    for source in tmp_path.glob("*.c"):
        assert not re.findall(r"(?<![\w.])(?<!e[-+])\d+F\b", source.read_text(encoding="utf-8")), source.name


def test_a_program_that_cannot_be_run_is_named(tmp_path: Path) -> None:
    with pytest.raises(BackendError, match=r"^no-such-program cannot be run: .*No such file"):
        files._run(["no-such-program", "second"], tmp_path)


def test_functions_of_the_arm_are_called_by_what_they_compute() -> None:
    """A reader of the C finds `arm_gravity`, with no digest of the model in its name, and what it does."""
    source = generate(GPI(ARM, 1e-3, feedforward="model")).source
    functions = dict(re.findall(r"/\* (Work out [^\n]*) \*/\nstatic void (arm_\w*)\(", source))
    assert functions == {
        "Work out the gravity torque x at q.": "arm_gravity",
        "Work out y = D(q)^-1 x, by the factors L D L' of the inertia matrix.": "arm_inertia_solve",
        "Work out y = D(q) x, with the inertia matrix D, by the recursion of Newton and Euler.": (
            "arm_inertia_times"
        ),
        "Work out the torque z for velocities x and accelerations y.": "arm_inverse",
        "Work out w[0] times the torque z for velocities x and accelerations y.": "arm_inverse_where",
    }
