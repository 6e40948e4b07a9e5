"""Arm and controller as processes. How well they keep up is the machine's; what they do is ours."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from commands import Answer

from armgpi import GPI, Bezier, Encoder, RigidBodyPlant, Robot
from armgpi.control.controller import ControlStep
from armgpi.errors import BackendError
from armgpi.hardware.realtime import Injected, run
from armgpi.loop.rollout import Status

ARM = Robot.load("anthropomorphic3")
START = ARM.middle()
PARTS = (Encoder(RigidBodyPlant(ARM), 18), GPI(ARM, 2e-3), Bezier(START, START + 0.1, duration=0.3))


def test_two_processes_run_to_the_end() -> None:
    seen: list[dict[str, Any]] = []
    outcome = run(*PARTS, 0.5, policy="other", watch=seen.append)
    assert len(outcome.answered) == 250
    assert int(outcome.rollout["status"]) == Status.FINISHED
    assert outcome.granted["arm"]["policy"] == "other"
    assert np.isfinite(outcome.lateness).all()
    assert (outcome.lateness >= 0.0).all()
    assert sum(outcome.report()["histogram"]["counts"]) == 250
    assert seen
    assert len(seen[-1]["q"]) == 3


def test_a_controller_that_is_killed_is_given_up() -> None:
    outcome = run(*PARTS, 0.5, policy="other", injected=Injected(kill=0.2))
    assert outcome.fired
    assert outcome.latched
    assert not outcome.answered[100:].any()


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def test_an_interrupt_while_a_page_is_told_ends_the_loop_with_a_report() -> None:
    usual = signal.signal(signal.SIGTERM, _interrupt)  # SIGINT is ignored in the background
    try:
        outcome = run(*PARTS, 20.0, policy="other", watch=lambda _: signal.raise_signal(signal.SIGTERM))
    finally:
        signal.signal(signal.SIGTERM, usual)
    assert int(outcome.rollout["status"]) == Status.INTERRUPTED
    assert 0 < len(outcome.answered) < 10_000


class _Broken(GPI):
    """A controller that breaks in its own process."""

    def step(self, measurement: Any, target: Any, state: Any) -> ControlStep:
        raise RuntimeError("out of order")


def test_what_breaks_in_a_process_is_told_here() -> None:
    with pytest.raises(BackendError, match="out of order"):
        run(PARTS[0], _Broken(ARM, 2e-3), PARTS[2], 0.2, policy="other")


def test_what_cannot_be_sent_is_refused() -> None:
    class Local(GPI):
        pass

    with pytest.raises(BackendError, match="cannot be sent to another process"):
        run(PARTS[0], Local(ARM, 2e-3), PARTS[2], 0.2, policy="other")


@pytest.fixture
def loop(cli: Callable[..., Answer]) -> Callable[..., Answer]:
    """Call `armgpi loop` in this process."""
    return partial(cli, "loop", "anthropomorphic3", "--t-final", "0.3")


def test_the_command_prints_a_report(loop: Callable[..., Answer]) -> None:
    done = loop("--clock", "simulated", "--loss", "0.2", "--json")
    assert done.code == 0, done.err
    report = json.loads(done.out)
    assert report["samples"] == 300
    assert report["missed"] > 50
    assert set(report["error_ratio"]) == {"peak", "rms"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--outage", "1"), "--outage"),
        (("--loss", "2"), "loss"),
        (("--clock", "atomic"), "clock"),
        (("--plant", "both"), "--plant"),
    ],
)
def test_bad_options_are_named(options: tuple[str, ...], message: str, loop: Callable[..., Answer]) -> None:
    done = loop(*options)
    assert done.code == 2
    assert message in done.err


@pytest.mark.parametrize("injected", [("--kill", "0.05"), ("--stall", "0.05,0.2")])
def test_a_controller_that_is_given_up_or_faults_is_a_failure(
    injected: tuple[str, str], loop: Callable[..., Answer]
) -> None:
    done = loop("--clock", "simulated", *injected)
    assert done.code == 1, done.err
    assert "given up" in done.out


def test_sigterm_to_all_processes_ends_the_loop_with_a_report() -> None:
    command = [sys.executable, "-m", "armgpi.cli", "loop", "anthropomorphic3", "--t-final", "60", "--json"]
    running = subprocess.Popen(
        [*command, "--policy", "other", "--view"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert running.stderr is not None
    while "http" not in (line := running.stderr.readline()):
        assert running.poll() is None
    with urllib.request.urlopen(line.split()[0] + "live", timeout=200) as told:
        while not told.readline().startswith(b"data:"):  # now both processes run
            pass
    os.killpg(running.pid, signal.SIGTERM)
    out, err = running.communicate(timeout=200)
    assert running.returncode == 143, err
    assert 0 < json.loads(out)["samples"] < 60_000


def test_what_mujoco_does_otherwise_is_said(loop: Callable[..., Answer]) -> None:
    pytest.importorskip("mujoco")
    done = loop("--clock", "simulated", "--plant", "mujoco")
    assert done.code == 0, done.err
    assert "note: MuJoCo: the bodies of" in done.err
    assert "have an inertia that MuJoCo refuses" in done.err


def test_a_controller_that_is_killed_answers_every_sample_before_that_one_and_none_after() -> None:
    outcome = run(*PARTS, 0.5, clock="simulated", injected=Injected(kill=0.2))
    assert outcome.answered[:100].all()
    assert not outcome.answered[100:].any()
