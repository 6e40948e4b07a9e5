"""Bring up simulated robots that are wrong: at which stage of `armgpi bringup` each mistake is found.

Usage:
    python tools/bringup.py [--target NAME] [--only TEXT] [--last STAGE]

Each mistake is planted into a robot as libfranka's (Panda, which echoes torques), one as UR's (UR5), and one
behind ros2_control (Z1, 1 kHz, gravity by the controller, which is told no torque); see tools/targets.py. All
have friction of 2 % of the torque that their joints are moved with. Stages are run one after another until a
log is judged wrong. Travel is how far a joint was from where the stage wanted it, or, after a stop, from
where it was stopped if that is less; brakes grip 50 ms after a fault. ros2_control has no torque after FAULT,
as its package is deactivated then.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import targets

from armgpi import ExportedController, RigidBodyPlant, Saturated, Supervised, config
from armgpi.hardware.export.targets import compensates_gravity
from armgpi.hardware.realtime import judge, stages
from armgpi.hardware.realtime.datagram import Datagram
from armgpi.hardware.realtime.ends import UPRIGHT, ArmEnd, ControllerEnd, Watchdog
from armgpi.loop import log as logs

FRICTION, BRAKES, BITS = 0.02, 0.05, 18
TARGETS = ("fci", "ur", "ros2_control")
#: Targets whose robots echo the torque that they were given, and that report what their joints carry; and
#: those without a torque after FAULT.
ECHO, REPORTS, ENDS = ("fci",), ("fci", "ur"), ("ros2_control",)


class Mistake(NamedTuple):
    """Something that is wrong with a robot, or with what it was told.

    Attributes:
        name: in words.
        breaks: questions that must never be called tested, of the joint.
        joint: whose index they are of; None for the arm.
        q: true positions -> what is measured.
        tau: torque sent -> torque that acts.
        arm: the model -> the arm that is there.
        adds: share of its model's weight that the robot adds; None for what its target says.
        lag: seconds by which measurements are later than the file says.
        closed: whether the joint's brake is closed.
        rate: sample times that pass in a sample.
    """

    name: str
    breaks: tuple[str, ...] = ()
    joint: int | None = 1
    q: Callable[[Any], Any] = lambda q: q
    tau: Callable[[Any], Any] = lambda tau: tau
    arm: Callable[[Any], Any] = lambda robot: robot
    adds: float | None = None
    lag: float = 0.0
    closed: bool = False
    rate: int = 1


def at(joint: int, change: Callable[[float], float]) -> Callable[[Any], Any]:
    """Return a change of one joint's number."""

    def changed(x: Any) -> Any:
        y = np.array(x)
        y[joint] = change(y[joint])
        return y

    return changed


def swapped(x: Any) -> Any:
    """Return numbers of joints with the second and the third exchanged."""
    y = np.array(x)
    y[[1, 2]] = y[[2, 1]]
    return y


def coupled(q: Any) -> Any:
    """Return positions of motors, the last of which turns with the one before."""
    y = np.array(q)
    y[-1] += y[-2]
    return y


def tilted(robot: Any) -> Any:
    """Return an arm on a base that is tilted by 20 degrees."""
    return robot.with_gravity((9.81 * np.sin(np.radians(20)), 0.0, -9.81 * np.cos(np.radians(20))))


def loaded(robot: Any) -> Any:
    """Return an arm with a load of a fifth of its mass at the tip."""
    return robot.with_payload(robot.tip, 0.2 * robot.moving_mass)


MISTAKES = (
    Mistake("none"),
    Mistake("encoder counts backwards", ("sign",), q=at(1, lambda x: -x)),
    Mistake("command reversed", ("command sign",), tau=at(1, lambda x: -x)),
    Mistake(
        "encoder and command reversed",
        ("sign", "command sign"),
        q=at(1, lambda x: -x),
        tau=at(1, lambda x: -x),
    ),
    Mistake("encoders of two joints swapped", ("order",), q=swapped),
    Mistake("commands of two joints swapped", ("command order",), tau=swapped),
    Mistake("positions in degrees", ("unit",), q=np.degrees),
    Mistake("encoder counts double (gear ratio)", ("unit",), q=at(1, lambda x: 2.0 * x)),
    Mistake("zero off by 0.3 rad", ("zero",), q=at(1, lambda x: x + 0.3)),
    Mistake("encoder dead", ("order",), q=at(1, lambda x: 0.0)),
    Mistake("robot takes torques for mN m", ("command unit",), tau=lambda x: 1e-3 * x),
    Mistake("torques at the motor, gear of 100", ("command unit",), tau=lambda x: 100.0 * x),
    Mistake("torque constant half", ("command unit",), tau=lambda x: 0.5 * x),
    Mistake("motor dead", ("command order",), tau=at(1, lambda x: 0.0)),
    Mistake("brake closed", ("command order",), closed=True),
    Mistake("gravity twice, or by nobody", ("carried",), adds=np.nan),
    Mistake(
        "mounted upside down",
        ("weight", "mounting", "carried"),
        arm=lambda r: r.with_gravity((0.0, 0.0, 9.81)),
    ),
    Mistake("base tilted by 20 degrees", ("mounting",), arm=tilted),
    Mistake("load not told, a fifth of the arm", ("weight", "carried"), arm=loaded),
    Mistake(
        "file of a lighter arm (masses 0.6)", ("weight", "carried"), arm=lambda r: r.scaled_inertia(1 / 0.6)
    ),
    Mistake("measurements 20 ms later than told", ("lag",), lag=0.02),
    Mistake("wrists coupled", ("order",), joint=-2, q=coupled),
    Mistake("robot at half the rate", ("rate",), joint=None, rate=2),
)


class WrongArm(ArmEnd):
    """The end of an arm that has a mistake, with friction, encoders and brakes."""

    def __init__(self, experiment: Any, mistake: Mistake, target: str, dry: bool) -> None:
        """Put the arm where the stage begins."""
        model = experiment.robot
        own = model.with_gravity(UPRIGHT) if compensates_gravity(model) else model
        self.adding = float(compensates_gravity(model))
        if mistake.adds is not None:
            self.adding = 1.0 - self.adding
        true = mistake.arm(own).with_friction(
            coulomb=FRICTION * stages.moving_torque(own, experiment.reference.at(0.0).q), viscous=0.0
        )
        plant = Saturated(RigidBodyPlant(true, friction="urdf"))
        start = experiment.reference.at(0.0).q
        dt = experiment.config.sample_time
        guide = experiment.reference if dry else None
        super().__init__(plant, own, dt, Watchdog(), start, np.zeros(true.n), False, guide)
        self.own, self.mistake, self.target, self.start = own, mistake, target, start
        late = experiment.config.plant.delay + round(mistake.lag / dt)
        self.last = [start] * (late + 1)
        self.braked = False

    @property
    def q(self) -> Any:
        """Where it is."""
        return self.plant.true_state(self.state).q

    def sample(self) -> Datagram:
        """Return what is sent: late, in counts, and wrong."""
        count = 2.0 * np.pi / 2**BITS
        q = np.rint(self.mistake.q(self.last[0]) / count) * count
        told = None
        if self.guide is not None and self.target in REPORTS:
            told = self.applied
        elif self.guide is None and self.target in ECHO:
            told = self.mistake.tau(self.command)
        return Datagram(1, self.k, self.k * self.dt, q, told)

    def advance(self, answer: Datagram | None) -> Any:
        """Move on, by the torque that acts."""
        self.command = self.command if answer is None else answer.values
        before = self.plant.true_state(self.state)
        for _ in range(self.mistake.rate):
            if self.guide is not None:
                rubs = np.sign(self.guide.at(self.k * self.dt).v) * self.plant.robot.friction.coulomb
                tau = self.follow(self.guide) + rubs
            else:
                effort = self.own.limits.effort
                tau = self.mistake.tau(self.command) + self.adding * self.own.gravity(before.q)
                tau = np.clip(tau, -effort, effort)
                self.state = self.plant.step(tau, self.state, self.dt)
            self.k += 1
            self.applied = tau
            self.last = [*self.last[1:], self.q]
        now, j = self.plant.true_state(self.state), self.mistake.joint
        if self.braked:
            self.state = self.plant.init(before.q, 0.0 * before.v)
        elif self.mistake.closed and self.guide is None:
            q, v = now.q.copy(), now.v.copy()
            q[j], v[j] = before.q[j], 0.0
            self.state = self.plant.init(q, v)
        return tau


class Came(NamedTuple):
    """What became of a mistake: the stage that found it, its verdict, and the travel until then [rad]."""

    stage: str
    verdict: Any
    travel: float


def drive(end: ControllerEnd, arm: WrongArm, experiment: Any) -> float:
    """Run a stage to its end, or until brakes hold the arm; return the travel [rad]."""
    travel, stopped, since = 0.0, None, 0
    while arm.k * arm.dt < experiment.t_final:
        answer = end.receive(arm.sample())
        if (
            answer is not None
            and end.fault is not None
            and end.fault.status == "fault"
            and arm.target in ENDS
        ):
            answer = answer._replace(values=0.0 * answer.values)
        arm.advance(answer)
        wanted = experiment.reference.at(arm.k * arm.dt).q
        if arm.guide is None and stopped is None and end.fault is not None and end.fault.reason != "none":
            stopped, since = arm.q, arm.k
        away = np.abs(arm.q - wanted).max()
        travel = max(travel, float(away if stopped is None else min(away, np.abs(arm.q - stopped).max())))
        arm.braked = stopped is not None and (arm.k - since) * arm.dt > BRAKES
        if stopped is not None and (arm.k - since) * arm.dt > 0.2:
            break
    return travel


class Bench:
    """A target's stages, with their experiments and exported controllers made once."""

    def __init__(self, target: str, folder: Path) -> None:
        """Write the stages."""
        data = targets.described(target, next(iter(targets.ARMS[target])), BITS)
        loaded = config.Loaded(config.check(data, config.Origin(target)), config.Origin(target))
        self.target = target
        self.folder = stages.write(loaded, config.build(*loaded), folder)
        self._made: dict[str, Any] = {}

    def parts(self, stage: Any) -> tuple[Any, Any]:
        """Return experiment and controller of a stage."""
        if stage.name not in self._made:
            experiment = self.folder.experiment(stage)
            law = next(iter(experiment.controllers.values()))
            self._made[stage.name] = [experiment, Supervised(law, experiment.supervisor), 0]
        made = self._made[stage.name]
        made[2] += 1
        if made[2] == 3:  # compiling takes as long as some runs of it
            made[1] = ExportedController.of(made[1])
        return made[0], made[1]

    def bring_up(self, mistake: Mistake, last: str = "slow") -> Came:
        """Go from stage to stage until one is judged wrong."""
        travel, written = 0.0, []
        for stage in self.folder.stages:
            experiment, controller = self.parts(stage)
            dry = stage.kind == "dry"
            arm = WrongArm(experiment, mistake, self.target, dry)
            steps = round(experiment.t_final / arm.dt) + 2
            end = ControllerEnd(controller, experiment.reference, steps, dry)
            travelled = drive(end, arm, experiment)
            travel = max(travel, 0.0 if dry else travelled)
            path = self.folder.path / f"{stage.name}.armlog"
            logs.write(end.writer.log(), path)
            written.append(path)
            verdict = judge.judge(self.folder, [path])
            self.check_green(mistake, verdict)
            if verdict.findings or stage.kind == last:
                return Came(stage.name if verdict.findings else "", verdict, travel)
        return Came("", verdict, travel)

    def check_green(self, mistake: Mistake, verdict: Any) -> None:
        """Refuse a verdict that calls tested what is wrong."""
        joint = "" if mistake.joint is None else self.folder.stages[0].joints[mistake.joint]
        for question in mistake.breaks:
            assert joint not in verdict.passed[question], (mistake.name, question)


def cell(came: Came) -> str:
    """Return stage, question and travel."""
    if not came.stage:
        return f"not found, {came.travel:.3f}"
    kind = came.stage.split("-")[1]
    return f"{kind}, {came.verdict.findings[0].question}, {came.travel:.3f}"


def main() -> None:
    """Run all that is asked for."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--target", choices=TARGETS)
    parser.add_argument("--only", default="")
    parser.add_argument("--last", default="slow")
    given = parser.parse_args()
    for target in [given.target] if given.target else TARGETS:
        with tempfile.TemporaryDirectory() as folder:
            bench = Bench(target, Path(folder))
            for mistake in MISTAKES:
                if given.only not in mistake.name:
                    continue
                came = bench.bring_up(mistake, given.last)
                first = came.verdict.findings[0] if came.verdict.findings else ""
                print(f"{target}: {mistake.name}: {cell(came)}: {first}", flush=True)


if __name__ == "__main__":
    main()
