"""Run a loop between an arm and a controller: in wall-clock time, or in one process by a simulated clock."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import repeat
from typing import Any

import numpy as np

from armgpi.base.arrays import ArrayLike, check_choice, check_type
from armgpi.control.controller import Controller, FullState
from armgpi.errors import ParameterError
from armgpi.hardware.realtime import processes
from armgpi.hardware.realtime.datagram import unpack
from armgpi.hardware.realtime.ends import ArmEnd, ControllerEnd, Watchdog, supervise
from armgpi.hardware.realtime.injected import Injected, Schedule
from armgpi.hardware.realtime.outcome import Outcome, Samples, collect
from armgpi.loop.closed_loop import ClosedLoop
from armgpi.loop.prepared import whole_steps
from armgpi.plants.plant import Plant
from armgpi.references.reference import Reference
from armgpi.robot.robot import Robot
from armgpi.supervisor import Supervisor

CLOCKS = ("wall", "simulated")


def run(
    plant: Plant,
    controller: Controller,
    reference: Reference,
    t_final: float,
    *,
    q0: ArrayLike | None = None,
    injected: Injected | None = None,
    watchdog: Watchdog | None = None,
    model: Robot | None = None,
    clock: str = "wall",
    policy: str = "auto",
    exported: bool = False,
    supervisor: Supervisor | None = None,
    dry_run: bool = False,
    watch: Callable[[dict[str, Any]], None] | None = None,
) -> Outcome:
    """Run a loop over UDP between two processes, the arm in wall-clock time, and return what came out.

    Args:
        plant: the arm, of a single rollout.
        controller: what controls it; its sample time is the loop's.
        reference: where to; both ends know it.
        t_final: how long [s], rounded to whole samples.
        q0: where encoders say that it starts [rad or m], (n,); the reference's start when not given.
        injected: what goes wrong; nothing when not given.
        watchdog: what the arm does when its controller is silent.
        model: by which the watchdog knows gravity and inertia; the plant's robot when not given.
        clock: "wall", or "simulated": in this process, without a wire, the same at every run.
        policy: of both processes: "fifo" (real time), "other", or "auto", real time where it is allowed.
        exported: run the controller as exported C.
        supervisor: what the controller takes for a fault, see :mod:`armgpi.supervisor`; when not
            given its defaults, but that 40 ms of samples may be missed.
        dry_run: send nothing. Who moves the arm, by hand or by its own controller, follows the reference; law
            and supervisor get what is measured, and take where the arm is for their reference.
        watch: is given what happens some times a second, as plain data; by the wall clock alone.

    Raises:
        ArmgpiError: when an argument is not as it should be, or a process cannot do its work.
    """
    loop = ClosedLoop(plant, controller, reference)
    start = plant.robot.check_position(reference.at(0.0).q if q0 is None else q0, "the start q0")
    if loop.true_state(loop.init(start)).q.ndim != 1:
        raise ParameterError("plant", plant, "a plant, controller, reference and start of a single rollout")
    check_choice(clock, "clock", CLOCKS)
    check_choice(policy, "policy", processes.POLICIES)
    check_type(exported, "exported", bool, "True or False")
    check_type(dry_run, "dry_run", bool, "True or False")
    check_type(supervisor, "supervisor", Supervisor | None, "a Supervisor")
    injected, watchdog = injected or Injected(), watchdog or Watchdog()
    check_type(injected, "injected", Injected, "an Injected")
    check_type(watchdog, "watchdog", Watchdog, "a Watchdog")
    model = plant.robot if model is None and isinstance(plant.robot, Robot) else model
    if not isinstance(model, Robot):
        raise ParameterError("model", model, "a Robot")
    steps = whole_steps(t_final, loop.dt)
    velocity = controller.measurement_type is FullState
    guide = reference if dry_run else None
    arm = partial(ArmEnd, plant, model, loop.dt, watchdog, start, np.zeros_like(start), velocity, guide)
    schedule = injected.prepare(steps, loop.dt)
    if clock == "wall":
        control = (controller, reference, supervisor, exported, start, dry_run)
        taken = processes.wall(arm, control, schedule, policy, watch)
    else:
        end = ControllerEnd(supervise(controller, supervisor, exported), reference, steps, dry_run)
        taken = _simulate(arm(), end, schedule)
    made_from = {"clock": clock, "injected": injected.describe(), "exported": exported, "dry_run": dry_run}
    described = {**loop.describe(), "t_final": steps * loop.dt, "backend": f"two ends, {clock} clock"}
    rollout = collect(taken.samples, plant, reference, loop.dt, described | made_from)
    count = taken.samples.count
    return Outcome(
        rollout,
        taken.samples.answered[:count],
        taken.samples.lateness[:count],
        *taken[1:],
        made_from | {"policy": policy, "watchdog_parameters": watchdog.values()},
    )


def _simulate(arm: ArmEnd, end: ControllerEnd, schedule: Schedule) -> processes.Taken:
    """Run both ends in turn; what they say goes through datagrams all the same."""
    steps, n = len(schedule.lost), len(arm.command)
    samples = Samples(steps, n)
    first = end.receive(arm.sample())
    assert first is not None
    arm.command = first.values
    waiting: list[bytes] = []
    for k in range(steps):
        sample, answer = arm.sample(), None
        if not schedule.lost[k, 0]:
            waiting.append(sample.pack())
        if k < schedule.killed and not schedule.stalled[k]:
            for received in filter(None, map(unpack, waiting, repeat(n))):
                answer = end.receive(received) or answer
            waiting.clear()
        samples.take(arm, sample, None if schedule.lost[k, 1] or answer is None else unpack(answer.pack(), n))
    samples.finish(arm)
    return processes.Taken(
        samples, end.filled, arm.fired, arm.latched, {}, np.empty(0), end.fault, end.writer.log()
    )
