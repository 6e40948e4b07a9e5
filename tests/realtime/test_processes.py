"""Arm and controller as processes. How well they keep up is the machine's; what they do is ours."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from armgpi import GPI, Bezier, Encoder, RigidBodyPlant, Robot
from armgpi.control.controller import ControlStep
from armgpi.errors import BackendError
from armgpi.loop.rollout import Status
from armgpi.realtime import Injected, run

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


def loop(*options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "armgpi.cli", "loop", "anthropomorphic3", "--t-final", "0.3", *options]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_the_command_prints_a_report() -> None:
    done = loop("--clock", "simulated", "--loss", "0.2", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
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
def test_bad_options_are_named(options: tuple[str, ...], message: str) -> None:
    done = loop(*options)
    assert done.returncode == 2
    assert message in done.stderr
