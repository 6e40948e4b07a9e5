"""The log that comes with an exported controller: what it is given in a simulation, and what it answers."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, check_choice, check_number
from armgpi.codegen.state import flatten, unflatten
from armgpi.control.controller import Controller, Measurement
from armgpi.errors import BackendError, MissingPackage, RolloutError
from armgpi.loop.backends import runner
from armgpi.loop.closed_loop import ClosedLoop
from armgpi.loop.log import INPUTS, ArmLog, of_samples
from armgpi.loop.rollout import Recording
from armgpi.loop.runner import DIVERGENCE, NumPyRun, drive, in_control
from armgpi.plants.plant import Plant
from armgpi.references.reference import Reference, Target
from armgpi.supervisor import SIGNALS, Supervised

#: Samples of a log at most.
MOST_SAMPLES = 100_000
#: Half of what a sample takes by NumPy [s], in which generated code has to be there: a supervised loop with
#: elastic joints takes twice as long to trace and compile as is reckoned for each joint.
_SAMPLE = 8e-5
#: Samples of a stretch in which Python's controller repeats what generated code did: as many as there are
#: stretches in some seconds, which it goes through at once.
_STRETCH = 64
#: How far the two may be apart, as a share of the largest number of a kind.
_AGREEMENT = 1e-9


class _Listed(Reference):
    """A reference that generated code reads from NumPy's targets, so that both give the same bits."""

    def __init__(self, reference: Reference) -> None:
        self._reference = reference

    def at(self, t: float | Array) -> Target:
        """Return the target at time(s) `t`."""
        return self._reference.at(t)


class _Found(NamedTuple):
    """What a simulation found.

    Attributes:
        inputs: what the controller was given, name -> (samples, n).
        tau: what it answered in Python [N m or N], (samples, n).
        error: distance of the true positions from the reference [rad or m], (samples, n).
        v: true velocities [rad/s or m/s], (samples, n).
        reports: status, reason and index of the joint, (samples, 3); None without a supervisor.
    """

    inputs: dict[str, Array]
    tau: Array
    error: Array
    v: Array
    reports: Array | None


def record(
    plant: Plant, controller: Controller, reference: Reference, t_final: float, backend: str = "numpy"
) -> ArmLog:
    """Simulate a closed loop for `t_final` [s], 100,000 samples at most, and return its log.

    Of an arm that was out of control the log ends before, and its header says when (`diverged` [s]).

    Args:
        plant: what moves.
        controller: what moves it, for a single rollout.
        reference: where to.
        t_final: how long [s].
        backend: "numpy"; "auto" for generated code where it is there sooner. Then Python's controller
            repeats every sample: torques of the log are Python's in either case. What the controller does not
            measure is not in it.

    Raises:
        RolloutError: when the arm is out of control at the first sample.
        ParameterError: when an argument is not as it should be.
    """
    check_choice(backend, "backend", ("numpy", "auto"))
    loop = ClosedLoop(plant, controller, reference)
    t_final = check_number(t_final, "t_final", "a positive time [s]", open_=True)
    state = loop.init()
    steps = max(1, min(round(t_final / loop.dt), MOST_SAMPLES))
    with np.errstate(all="ignore"):
        found = _by_code(loop, state, steps) if backend == "auto" else None
        found = found or _by_numpy(loop, state, steps)
    # By what was asked for: actuators may make a finite torque of an infinite one, the exported code never.
    good = in_control(found.error, found.v, found.tau, DIVERGENCE)
    count = steps if good.all() else int(np.argmin(good))
    if not count:
        raise RolloutError(
            f"{controller.robot.name}: the first sample is out of control, there is nothing to log"
        )
    known = {"diverged": count * loop.dt} if count < steps else {}
    reports = None if found.reports is None else found.reports[:count]
    inputs = {name: values[:count] for name, values in found.inputs.items()}
    return of_samples(controller.robot.joint_names, loop.dt, inputs, found.tau[:count], reports, **known)


def _by_numpy(loop: ClosedLoop, state: Any, steps: int) -> _Found:
    """Return what a simulation by NumPy finds."""
    recording = Recording.new(loop.true_state(state).q.shape, steps, loop.dt, every=1)
    drive(NumPyRun(loop, state, recording, inputs=True), steps)
    found = {name: values[:steps] for name, values in recording.variables.items()}
    reports = None
    if isinstance(loop.controller, Supervised):
        reports = np.stack([found[name][:, 0] for name in SIGNALS[:3]], axis=1)
    inputs = {name: found[name] for name in INPUTS}
    return _Found(inputs, found["tau_command"], found["q"] - found["q_ref"], found["v"], reports)


def _by_code(loop: ClosedLoop, state: Any, steps: int) -> _Found | None:
    """Return what a simulation by generated code finds, with the torques of Python's controller.

    None where there is no such code, it is there too late, or Python does not find the same.
    """
    if loop.controller.measurement_type is not Measurement:
        return None  # generated code records no measured velocities
    if not all(isinstance(value, np.ndarray) for _, value in flatten(state.controller)):
        return None
    listed = ClosedLoop(loop.plant, loop.controller, _Listed(loop.reference))
    recording = Recording.new(loop.true_state(state).q.shape, steps, loop.dt, every=1)
    patience = steps * _SAMPLE
    try:
        code = runner("compiled", loop.plant.robot.n, patience)
        run = code(listed, state, recording, DIVERGENCE, patience=patience)
    except (BackendError, MissingPackage):
        return None
    starts = []
    while run.done < steps and recording.running.any():
        starts.append(run.state[1])
        run.take(min(_STRETCH, steps - run.done))
    if not recording.running.all():
        return None  # it records nothing of a sample that is out of control
    starts.append(run.state[1])
    run.finish()
    target = loop.targets(np.arange(steps) * np.float64(loop.dt))
    seen = {name: values[:steps] for name, values in recording.variables.items()}
    try:
        tau, reports, ends = _repeat(loop.controller, starts, seen["q_measured"], target)
    except Exception:  # a user's law may raise anything where it gets several rows
        return None
    if not (_alike(tau, seen["tau_command"]) and all(map(_alike, ends, _stacked(starts[1:])))):
        return None
    inputs = {"q_measured": seen["q_measured"]} | {f"{name}_ref": x for name, x in target._asdict().items()}
    return _Found(inputs, tau, seen["q"] - target.q, seen["v"], reports)


def _repeat(
    controller: Controller, starts: list[Any], q_measured: Array, target: Target
) -> tuple[Array, Array | None, list[Array]]:
    """Return torques and reports of Python's controller, all stretches at once, and its states after each.

    Args:
        controller: in Python.
        starts: its states where the stretches begin, and after the last one.
        q_measured: what it is given in every sample (samples, n).
        target: likewise.
    """
    steps, n = q_measured.shape
    begin = np.arange(len(starts) - 1) * _STRETCH
    state = unflatten(starts[0], _stacked(starts[:-1]))
    tau = np.empty((steps, n))
    reports = np.empty((steps, 3)) if isinstance(controller, Supervised) else None
    ends = _stacked(starts[1:])
    for i in range(_STRETCH):
        there = begin + i < steps  # the last stretch may be shorter: it goes on with its last sample
        k = np.minimum(begin + i, steps - 1)
        asked, state = controller.step(
            Measurement(q_measured[k]), Target(*(part[k] for part in target)), state
        )
        tau[k[there]] = np.broadcast_to(asked, (len(k), n))[there]
        if reports is not None:
            said = controller.reported(state)
            for column, name in enumerate(SIGNALS[:3]):
                reports[k[there], column] = np.broadcast_to(said[name], (len(k), n))[there, 0]
        last = begin + i == np.minimum(begin + _STRETCH, steps) - 1
        for end, (_, value) in zip(ends, flatten(state), strict=True):
            end[last] = value[last]
    return tau, reports, ends


def _stacked(states: list[Any]) -> list[Array]:
    """Return the leaves of several states, each an array (states, ...)."""
    return [
        np.stack(parts) for parts in zip(*([x for _, x in flatten(each)] for each in states), strict=True)
    ]


def _alike(found: Array, other: Array) -> bool:
    """Tell whether numbers of one kind are the same but for rounding."""
    largest = np.abs(other).max(initial=1e-300)
    return bool((np.abs(found - other) <= _AGREEMENT * largest).all())
