"""The two ends of a loop, without clock and wire: the arm with its watchdog, and the controller."""

from __future__ import annotations

from typing import Any

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import Parametrised, parameter, with_parameters
from armgpi.control.controller import Controller, FullState, Measurement
from armgpi.hardware.export.controller import ExportedController
from armgpi.hardware.export.targets import compensates_gravity
from armgpi.hardware.realtime.datagram import SAMPLE, TORQUE, Datagram
from armgpi.loop.log import INPUTS, Event, LogWriter
from armgpi.plants.plant import Plant
from armgpi.references.reference import Reference, Target
from armgpi.robot.robot import Robot
from armgpi.supervisor import FaultReport, Reason, State, Supervised, Supervisor

#: What the arm's watchdog does.
REACTIONS = ("damping", "gravity", "hold", "zero")
#: Gravity of an arm that stands upright [m/s^2].
UPRIGHT = (0.0, 0.0, -9.81)
#: Time for which samples may be missed [s], and their number, at least and at most.
_SILENCE, _FEWEST_MISSED, _MOST_MISSED = 0.04, 20, 1000


@with_parameters
class Watchdog(Parametrised):
    """What an arm does by itself when its controller is silent."""

    samples: int = parameter(
        "samples without a torque, after which it acts", kind="integer", default=12, least=1, most=10**6
    )
    reaction: str = parameter(
        "what it does: damping (gravity torque and a brake by the inertia matrix), gravity, hold (the last "
        "torque), zero",
        kind="choice",
        default="damping",
        choices=REACTIONS,
    )
    damping: float = parameter("of damping: rate at which speeds decay", unit="1/s", default=60.0, least=0.0)
    ramp: float = parameter(
        "of damping: time in which it takes over from the last torque, so that a short silence costs little",
        unit="s",
        default=0.05,
        least=0.0,
    )
    latch: float = parameter(
        "silence after which it does not listen to a controller any more", unit="s", default=0.1, least=0.0
    )


class ArmEnd:
    """The arm's end: a plant that counts samples, and its watchdog.

    Attributes:
        plant: what moves.
        model: the model by which its watchdog knows gravity and inertia.
        dt: sample time [s].
        watchdog: what it does in silence.
        k: number of samples taken.
        state: the plant's state.
        answered: number of the last sample that was answered; -1 before.
        silent: samples in a row without a new torque.
        fired: samples at which the watchdog began to act.
        latched: whether it does not listen any more.
        applied: torque of the last sample [N m or N], (n,).
        guide: in a dry run, where the arm is moved by hand, or by itself; None where the controller moves it.
    """

    def __init__(
        self,
        plant: Plant,
        model: Robot,
        dt: float,
        watchdog: Watchdog,
        q: Array,
        v: Array,
        velocity: bool,
        guide: Reference | None = None,
    ) -> None:
        """Begin at q and v; `velocity` says whether velocities are sent as well."""
        self.guide = guide
        # A robot that carries its weight by itself reports that all the same.
        arm: Any = plant.robot
        reports = guide is not None and compensates_gravity(arm)
        self._weight = arm.with_gravity(UPRIGHT) if reports else None
        self.plant, self.model, self.dt, self.watchdog = plant, model, dt, watchdog
        self.velocity = velocity
        self.k, self.answered, self.silent = 0, -1, 0
        self.state = plant.init(q, v)
        self.fired: list[int] = []
        self.latched = False
        self.command = np.zeros_like(q)
        self.applied: Array = np.zeros_like(q)

    def sample(self) -> Datagram:
        """Return what is sent at this sample."""
        measured = self.plant.measure(self.state)
        values = np.stack([measured.q, measured.v]) if self.velocity else measured.q
        return Datagram(SAMPLE, self.k, self.k * self.dt, values, self.applied)

    def advance(self, answer: Datagram | None) -> Array:
        """Take a sample under the newest torque, or what the watchdog does, and return that torque.

        Args:
            answer: the newest torque that came in this sample, if one came.
        """
        if answer is not None and answer.number > self.answered and not self.latched:
            self.command, self.answered, self.silent = answer.values, answer.number, 0
        else:
            self.silent += 1
        self.latched |= self.silent * self.dt > max(self.watchdog.latch, self.watchdog.samples * self.dt)
        if self.silent == self.watchdog.samples:
            self.fired.append(self.k)
        tau = self._alone() if self.silent >= self.watchdog.samples else self.command
        if self.guide is not None:
            tau = self.follow(self.guide)
        else:
            self.state = self.plant.step(tau, self.state, self.dt)
        self.applied = np.asarray(tau)
        if self._weight is not None:
            self.applied = self.applied + self._weight.gravity(self.plant.true_state(self.state).q)
        self.k += 1
        return tau

    def follow(self, guide: Reference) -> Array:
        """Put the arm where a hand has it in a dry run, and return the torque that this takes.

        Whoever moves it holds its links: elastic joints do not swing then.
        """
        there = guide.at((self.k + 1) * self.dt)
        self.state = self.plant.init(there.q, there.v)
        return np.asarray(self.plant.robot.dynamics.inverse(*there))

    def _alone(self) -> Array:
        """Return the watchdog's torque."""
        reaction, dynamics = self.watchdog.reaction, self.model.dynamics
        if reaction == "hold":
            return self.command
        if reaction == "zero":
            return np.zeros_like(self.command)
        truth = self.plant.true_state(self.state)
        gravity = dynamics.gravity(truth.q)
        if reaction == "gravity":
            return gravity
        acting = (self.silent - self.watchdog.samples + 1) * self.dt
        share = 1.0 if acting >= self.watchdog.ramp else acting / self.watchdog.ramp
        # A rate above 1 / dt would reverse the motion within a sample.
        rate = min(self.watchdog.damping, 0.5 / self.dt)
        brake = dynamics.inertia_times(truth.q, rate * truth.v)
        # Torques cut one by one would drive joints by what the others lack: all brake less then.
        effort = self.model.limits.effort
        room = np.where(effort > 0.0, np.maximum(effort + np.sign(brake) * gravity, 0.0), np.inf)
        share_left = np.min(room / np.maximum(np.abs(brake), 1e-300), axis=-1, keepdims=True)
        damped = gravity - brake * np.minimum(1.0, share_left)
        return np.asarray(self.command + share * (damped - self.command))


class ControllerEnd:
    """The controller's end: it answers samples, and has those filled that it has missed.

    Attributes:
        controller: the law under its supervisor, in Python or as exported C.
        reference: where to.
        state: of the controller; None before the first sample.
        number: of the last sample.
        filled: how many samples it has missed.
        writer: the log of what it was given and what it answered.
        dry: whether nothing is sent: its reference is where the arm is moved to.
    """

    def __init__(
        self,
        controller: Supervised | ExportedController,
        reference: Reference,
        samples: int = 0,
        dry: bool = False,
    ) -> None:
        """Keep the two, with room for a log of so many samples."""
        self.controller, self.reference, self.dry = controller, reference, dry
        robot: Any = controller.robot
        inputs = tuple(x for x in INPUTS if x != "v_measured" or controller.measurement_type is FullState)
        self.writer = LogWriter(robot.joint_names, controller.dt, inputs, samples + 1, robot=robot.name)
        self.state: Any = None
        self.number = -1
        self.filled = 0
        self._answer: Datagram | None = None

    def receive(self, sample: Datagram) -> Datagram | None:
        """Return the answer to a sample; None when it is older than one that was answered."""
        if sample.number == self.number:  # the arm has not had the answer
            return self._answer
        if sample.number < self.number:
            return None
        whole = self.controller.measurement_type is FullState
        measured = FullState(*sample.values) if whole else Measurement(sample.values)
        q = measured.q
        # In a dry run the reference is where the arm is, so that nothing is integrated.
        here = Target(q, np.zeros_like(q), np.zeros_like(q))
        target = here if self.dry else self.reference.at(sample.number * self.controller.dt)
        if self.state is None:
            self.state = self.controller.init(measured, target)
            self.number = sample.number - 1
            rest = np.zeros(self.controller.robot.n)
            self.writer.take(sample.number, measured, target, rest, event=Event.INIT, elapsed=0)
        elapsed = sample.number - self.number
        self.filled += elapsed - 1
        taken = self.controller.advance(measured, target, self.state, elapsed)
        if sample.applied is not None:
            taken = self.controller.within_rate(sample.applied, taken)
        tau, self.state = taken
        self.number = sample.number
        said = self.controller.report(self.state)
        joint = 0 if said.joint is None else self.controller.robot.joint_names.index(said.joint)
        report = State[said.status.upper()], Reason[said.reason.upper()], joint
        self.writer.take(
            *(sample.number, measured, target, np.asarray(tau)),
            report=report,
            elapsed=elapsed,
            applied=sample.applied,
        )
        self._answer = Datagram(TORQUE, sample.number, sample.time, np.asarray(tau))
        return self._answer

    @property
    def fault(self) -> FaultReport | None:
        """What the supervisor says; None before the first sample."""
        return None if self.state is None else self.controller.report(self.state)


def supervise(
    controller: Controller, supervisor: Supervisor | None, exported: bool
) -> Supervised | ExportedController:
    """Return a controller under a supervisor, as exported C where that is wanted.

    Args:
        controller: the law; one that is supervised or exported stays as it is.
        supervisor: what is taken for a fault; when not given the defaults, but that samples of 40 ms may be
            missed, as the arm tolerates such a silence too.
        exported: whether it is to run as exported C.
    """
    if isinstance(controller, Supervised | ExportedController):
        return controller
    if supervisor is None:
        supervisor = Supervisor(
            missed=min(_MOST_MISSED, max(_FEWEST_MISSED, round(_SILENCE / controller.dt)))
        )
    if exported:
        return ExportedController.of(controller, supervisor=supervisor)
    return Supervised(controller, supervisor)
