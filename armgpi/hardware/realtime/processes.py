"""The two processes of a loop in wall-clock time, and the real-time means that the system grants them."""

from __future__ import annotations

import ctypes
import gc
import multiprocessing
import os
import pickle
import select
import signal
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import numpy as np

from armgpi.base import interrupts
from armgpi.base.arrays import Array
from armgpi.control.controller import FullState, Measurement
from armgpi.errors import ArmgpiError, BackendError
from armgpi.hardware.realtime.datagram import END, LONGEST, TORQUE, Datagram, unpack
from armgpi.hardware.realtime.ends import ArmEnd, ControllerEnd, supervise
from armgpi.hardware.realtime.injected import Schedule
from armgpi.hardware.realtime.outcome import Samples, histogram
from armgpi.loop.log import ArmLog
from armgpi.supervisor import FaultReport

POLICIES = ("auto", "fifo", "other")
#: Real-time priorities of arm and controller: the arm does not wait for a controller.
_ARM, _CONTROLLER = 80, 70
#: Share of a sample in which an answer has to come; what is left is for moving the arm on.
_ANSWER = 0.85
#: How long the start of a process may take [s], and how often the first sample is sent again.
_START, _AGAIN = 60.0, 0.05
#: How often somebody who watches is told [s].
_WATCHED = 0.2
_MCL_CURRENT, _MCL_FUTURE = 1, 2


class Taken(NamedTuple):
    """What the processes bring back; see :class:`armgpi.hardware.realtime.outcome.Outcome`."""

    samples: Samples
    filled: int
    fired: list[int]
    latched: bool
    granted: dict[str, Any]
    steps: Array
    fault: FaultReport | None
    log: ArmLog | None


def wall(
    arm: Callable[[], ArmEnd],
    control: tuple[Any, ...],
    schedule: Schedule,
    policy: str,
    watch: Callable[[dict[str, Any]], None] | None,
) -> Taken:
    """Run both processes to the end of the schedule, or until Ctrl-C.

    Args:
        arm: makes the arm's end.
        control: controller, reference, supervisor, whether it runs as exported C, where the arm is, and
            whether it is a dry run.
        schedule: what goes wrong.
        policy: how they are scheduled.
        watch: is called some times a second.

    Raises:
        ArmgpiError: when a process cannot do its work.
    """
    context = multiprocessing.get_context("spawn")
    pipes = [context.Pipe() for _ in range(2)]
    children: list[Any] = [
        context.Process(
            target=_controller_process, args=(pipes[0][1], *control, policy, len(schedule.lost)), daemon=True
        ),
        context.Process(
            target=_arm_process, args=(pipes[1][1], arm, schedule, policy, watch is not None), daemon=True
        ),
    ]
    (to_controller, _), (to_arm, _) = pipes
    try:
        for child, pipe in zip(children, pipes, strict=True):
            try:
                child.start()  # its arguments are pickled
            except (pickle.PicklingError, AttributeError, TypeError) as error:
                raise BackendError(
                    f"a part of the loop cannot be sent to another process ({error}): define its class in a "
                    'module, or take clock="simulated"'
                ) from None
            pipe[1].close()
        kind, address = _message(to_controller, children[0], _START)
        if kind != "ready":
            raise BackendError(f"the process said {kind!r}, expected 'ready'")
        to_arm.send((address, children[0].pid))
        return _await_end(to_arm, to_controller, children, watch)
    finally:
        for child in children:
            if child.pid is not None:
                child.kill()
                child.join()


def _await_end(
    to_arm: Connection,
    to_controller: Connection,
    children: list[Any],
    watch: Callable[[dict[str, Any]], None] | None,
) -> Taken:
    """Wait for the end, and return what both processes have to tell."""
    kind = ""
    value: Any = None
    while kind != "done":
        try:
            to_arm.poll(None)
            with interrupts.hold():  # a message half read, or a page half told, is lost
                kind, value = _message(to_arm, children[1])
                if kind == "watch" and watch is not None:
                    watch(value)
        except KeyboardInterrupt:
            with suppress(OSError):  # it may have ended by itself
                to_arm.send("stop")
    samples, fired, latched, granted_arm = value
    told: dict[str, Any] = {"filled": 0, "steps": np.empty(0), "granted": None, "fault": None, "log": None}
    with suppress(EOFError, OSError):  # a controller that was killed tells nothing
        if to_controller.poll(2.0):
            told = to_controller.recv()[1]
    granted = {"arm": granted_arm, "controller": told["granted"]}
    return Taken(samples, told["filled"], fired, latched, granted, told["steps"], told["fault"], told["log"])


def _message(pipe: Connection, child: Any, patience: float | None = None) -> tuple[str, Any]:
    """Return the next message of a process; its error is raised here."""
    try:
        if patience is not None and not pipe.poll(patience):
            raise BackendError(f"a process of the loop did not start within {patience:g} s")
        kind, value = pipe.recv()
    except (EOFError, OSError):
        child.join(1.0)
        raise BackendError(
            f"a process of the loop ended early (exit code {child.exitcode}); a script must call run under "
            'if __name__ == "__main__", as each process imports it'
        ) from None
    if kind == "error":
        raise value if isinstance(value, ArmgpiError) else BackendError(str(value))
    return kind, value


def _arm_process(
    pipe: Connection, make: Callable[[], ArmEnd], schedule: Schedule, policy: str, watched: bool
) -> None:
    """Run the arm's end of the loop in this process until it is over or stopped."""
    _leave_signals()
    try:
        arm = make()
        arm.plant.step(arm.command, arm.state, arm.dt)  # what is made at its first use is made now
        wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        wire.bind(("127.0.0.1", 0))
        address, pid = pipe.recv()
        granted = _real_time(policy, _ARM)
        samples = _Wall(arm, wire, address, pid, schedule, pipe, watched).run()
        pipe.send(("done", (samples, arm.fired, arm.latched, granted)))
    except Exception as error:
        pipe.send(("error", error if isinstance(error, ArmgpiError) else repr(error)))


class _Wall:
    """The arm's loop in wall-clock time: the arm moves on, whether or not somebody answers."""

    def __init__(
        self,
        arm: ArmEnd,
        wire: socket.socket,
        address: tuple[str, int],
        pid: int,
        schedule: Schedule,
        pipe: Connection,
        watched: bool,
    ) -> None:
        self.arm, self.wire, self.address, self.pid, self.schedule = arm, wire, address, pid, schedule
        self.pipe, self.watched = pipe, watched
        self.n = len(arm.command)
        self.samples = Samples(len(schedule.lost), self.n)

    def run(self) -> Samples:
        """Go through all samples, each at its own time, and return them."""
        arm, steps, dt = self.arm, len(self.schedule.lost), self.arm.dt
        self._meet()
        begin = time.monotonic() + 2.0 * dt
        told = begin
        while arm.k < steps:
            due = begin + arm.k * dt
            # Always to a time of the clock, never for a time: errors do not add up.
            if (wait := due - time.monotonic()) > 0.0:
                time.sleep(wait)
            late = time.monotonic() - due
            self.samples.lateness[arm.k] = late
            self._sample(due, asleep=late >= dt)
            if self.watched and due > told + _WATCHED:
                told = due
                watched = {
                    "t": arm.k * dt,
                    "q": self.samples.rows["q"][arm.k - 1].tolist(),
                    "tau": self.samples.rows["tau"][arm.k - 1].tolist(),
                    "missed": int((~self.samples.answered[: arm.k]).sum()),
                    "samples": arm.k,
                    "silent": arm.silent,
                    "fired": len(arm.fired),
                    "latched": arm.latched,
                    "histogram": histogram(self.samples.lateness[: arm.k]),
                }
                self.pipe.send(("watch", watched))
            if arm.k % 64 == 0 and self.pipe.poll():
                break  # the parent says stop
        self.samples.finish(arm)
        self.wire.sendto(Datagram(END, arm.k, 0.0, np.zeros(self.n)).pack(), self.address)
        return self.samples

    def _meet(self) -> None:
        """Send the first sample until it is answered: before that the arm stands on its brakes."""
        sample = self.arm.sample().pack()
        end = time.monotonic() + _START
        while time.monotonic() < end:
            self.wire.sendto(sample, self.address)
            if (answer := self._answer(time.monotonic() + _AGAIN)) is not None:
                self.arm.command = answer.values
                return
        raise BackendError(f"the controller does not answer within {_START:g} s")

    def _sample(self, due: float, asleep: bool) -> None:
        """Take a sample; one that was slept through is neither sent nor answered."""
        arm, k = self.arm, self.arm.k
        done = self.schedule.signals.get(k)
        if done is not None:
            number = {"stop": signal.SIGSTOP, "continue": signal.SIGCONT, "kill": signal.SIGKILL}[done]
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)
        sample, answer = arm.sample(), None
        if not asleep:
            lost_sample, lost_answer = self.schedule.lost[k]
            if not lost_sample:
                self.wire.sendto(sample.pack(), self.address)
            answer = self._answer(due + _ANSWER * arm.dt)
            if lost_answer:
                answer = None
        self.samples.take(arm, sample, answer)

    def _answer(self, until: float) -> Datagram | None:
        """Return the newest torque that comes until then; at once when it is that of this sample."""
        newest: Datagram | None = None
        while (left := until - time.monotonic()) > 0.0 and select.select([self.wire], [], [], left)[0]:
            found = unpack(self.wire.recv(LONGEST), self.n)
            if (
                found is not None
                and found.kind == TORQUE
                and (newest is None or found.number > newest.number)
            ):
                newest = found
            if newest is not None and newest.number == self.arm.k:
                break
        return newest


def _controller_process(
    pipe: Connection,
    law: Any,
    reference: Any,
    supervisor: Any,
    exported: bool,
    q: Array,
    dry: bool,
    policy: str,
    samples: int,
) -> None:
    """Run the controller's end of the loop in this process until it is over or stopped."""
    _leave_signals()
    try:
        controller: Any = supervise(law, supervisor, exported)
        # What is made at its first use is made now.
        zero = np.zeros_like(q)
        measured = FullState(q, zero) if controller.measurement_type is FullState else Measurement(q)
        state = controller.init(measured, reference.at(0.0))
        for _ in range(3):
            state = controller.step(measured, reference.at(0.0), state).state
        end = ControllerEnd(controller, reference, samples, dry)
        wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        wire.bind(("127.0.0.1", 0))
        granted = _real_time(policy, _CONTROLLER)
        pipe.send(("ready", wire.getsockname()))
        took = _answering(end, wire, len(q), pipe)
        told = {"filled": end.filled, "steps": np.array(took), "granted": granted, "fault": end.fault}
        told["log"] = end.writer.log()
        pipe.send(("done", told))
    except Exception as error:
        with suppress(OSError):
            pipe.send(("error", error if isinstance(error, ArmgpiError) else repr(error)))


def _answering(end: ControllerEnd, wire: socket.socket, n: int, pipe: Connection) -> list[float]:
    """Answer samples until the arm says that it is over; return how long each took [s]."""
    took: list[float] = []
    heard: list[Any] = [wire, pipe]
    while True:
        if pipe in select.select(heard, [], [])[0]:  # the parent is gone
            return took
        data, sender = wire.recvfrom(LONGEST)
        begin = time.monotonic()
        sample = unpack(data, n)
        if sample is None:
            continue
        if sample.kind == END:
            return took
        answer = end.receive(sample)
        # Of samples that wait already, only the last answer counts.
        if answer is not None and not select.select([wire], [], [], 0.0)[0]:
            wire.sendto(answer.pack(), sender)
        took.append(time.monotonic() - begin)


def _leave_signals() -> None:
    """Ignore what a group of processes is sent: the parent hears it too, and ends the loop."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)


def _real_time(policy: str, priority: int) -> dict[str, Any]:
    """Ask for locked memory and for real-time scheduling, and return what was granted."""
    gc.collect()
    gc.disable()
    granted = {"policy": "other", "memory_locked": False, "priority": 0}
    if policy == "other" or sys.platform != "linux":
        if policy == "fifo":
            raise BackendError("real-time scheduling (policy fifo) is for Linux; take policy auto or other")
        return granted
    libc = ctypes.CDLL(None, use_errno=True)
    granted["memory_locked"] = libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        if policy == "fifo":
            raise BackendError(
                f"SCHED_FIFO is not allowed ({error.strerror}): run as root, grant CAP_SYS_NICE or an rtprio "
                "limit (/etc/security/limits.conf), or take policy auto"
            ) from None
        return granted
    return {**granted, "policy": "fifo", "priority": priority}
