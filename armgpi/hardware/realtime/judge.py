"""What the logs of a bring-up say: what was tested, what failed, and what nothing has tested yet."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array
from armgpi.config import Experiment
from armgpi.errors import ArmgpiError, MissingPackage, ParameterError, RolloutError, UnfitLog
from armgpi.hardware.export.targets import compensates_gravity
from armgpi.hardware.realtime.ends import UPRIGHT
from armgpi.hardware.realtime.stages import CAPS, Folder, Stage, moving_torque
from armgpi.loop.log import ArmLog
from armgpi.loop.log import read as read_log
from armgpi.robot.robot import Robot
from armgpi.supervisor import OF_TOOL, Reason

if TYPE_CHECKING:
    from armgpi.identification.arm import Identified

#: Whether each of some joints is chosen, (n,).
Mask = npt.NDArray[np.bool_]

#: What a bring-up has to answer, in the order in which it can: key -> question.
QUESTIONS = {
    "rate": "samples come at the sample time",
    "order": "each position is that of its joint",
    "sign": "the positions have the signs of the URDF",
    "unit": "positions are in rad or m",
    "zero": "positions are zero where the file's are",
    "weight": "the gravity torque of the model agrees with the torque that the robot reports",
    "mounting": "the base is mounted as in the file: a tilt of 20 degrees would show in that torque",
    "command order": "each torque reaches its joint",
    "command sign": "a torque moves its joint the way it points",
    "command unit": "torques are in N m or N, at the joint",
    "carried": "the arm stays at rest under the gravity torque of the model, within friction",
    "lag": "the delay of the measurements is that of the experiment file",
    "model": "the motion takes the torque that the file expects",
    "whole arm": "the whole arm follows",
}
#: Those of the arm as a whole.
_OF_ARM = ("rate", "whole arm")
#: Share of samples that may be missed.
_MISSED = 0.1
#: A joint that was moved by hand moved at least so much [rad or m].
_MOVED = 0.05
#: It did not move more than this [rad or m].
_TOO_FAR = 1.0
#: Another joint moved less than this share of it.
_ALONG = 0.4
#: The arm began as near to its start [rad or m].
_START = 0.1
#: How far a joint was moved is known within this factor.
_RATIO = 1.6
#: Torque beside the model's weight that friction explains, as a share of what a joint is moved with.
_FRICTION = 0.06
#: The same as a share of the arm's largest weight.
_WEIGHT = 0.12
#: Samples that a log has, at least, and those of which a torque can be compared.
_FEWEST = 10
_FEWEST_ECHOED = 20
#: Difference of a torque that a robot reports, as a share of the largest one sent and of the limit.
_ECHO_OF_SENT = 0.05
_ECHO_OF_LIMIT = 1e-3
#: Share of the way of a stage before which its reference has not moved, and within which a joint rested.
_BEFORE = 0.02
_NOTHING = 0.2
#: Samples of a log at which gravity torques are compared.
_COMPARED = 50
#: A base tilted by this has to show, or its mounting was not tested [rad].
_TILT = math.radians(20.0)
#: The torque that a robot reports over that weight: this far from 1 is another unit or scale.
_SCALE = 0.3
#: What a joint of a pulse goes at least, as a share of its way.
_ANSWERED = 0.5
#: Lag beyond the file's [s].
_LAG = 0.004
#: Torque over what the file expects either way, rotors being known to 2.5.
_MODEL = 3.0
#: Time over which an arm is at rest at the end of a stage [s].
_REST = 0.2
#: Time in which a fault shows [s].
_AROUND = 0.1


class Finding(NamedTuple):
    """Something that is wrong.

    Attributes:
        question: a key of :data:`QUESTIONS`.
        joint: of which joint, "" for the arm.
        seen: what the log shows.
        remedy: what to do.
    """

    question: str
    joint: str
    seen: str
    remedy: str

    def __str__(self) -> str:
        """Return it in one line."""
        return f"{self.joint}: {self.seen}; {self.remedy}" if self.joint else f"{self.seen}; {self.remedy}"


class Verdict(NamedTuple):
    """What logs of a bring-up say.

    Attributes:
        findings: what is wrong, the likeliest cause first.
        passed: question -> joints for which it was tested and holds; ("",) for the arm.
        untested: question -> joints for which nothing has tested it.
        following: the stage to run next; None when all have passed or something is wrong.
    """

    findings: tuple[Finding, ...]
    passed: dict[str, tuple[str, ...]]
    untested: dict[str, tuple[str, ...]]
    following: Stage | None

    def plain(self) -> dict[str, object]:
        """Return it as plain data."""
        return {
            "findings": [finding._asdict() for finding in self.findings],
            "passed": {question: list(joints) for question, joints in self.passed.items()},
            "not_tested": {question: list(joints) for question, joints in self.untested.items()},
            "next": None if self.following is None else self.following.name,
        }


class _Seen(NamedTuple):
    """A log as arrays: joints are named, `dev` is the torque beside what holds the model."""

    names: tuple[str, ...]
    t: Array
    q: Array
    q_ref: Array
    tau: Array
    dev: Array
    applied: Array
    reason: int
    joint: int
    faulty: int


def judge(folder: Folder, logs: Iterable[Path]) -> Verdict:
    """Return what logs of stages say together.

    Raises:
        ConfigError: when a log is of none of the stages.
        RolloutError: when a log cannot be read.
        NameNotFound, ParameterError: when its joints are others.
    """
    findings: list[Finding] = []
    passed: dict[str, list[str]] = {}
    done = set()
    for path in sorted(logs, key=lambda log: folder.stages.index(folder.stage(log))):
        stage = folder.stage(path)
        wrong, tested = _judge_stage(folder, stage, read_log(path))
        findings += wrong
        if not wrong:
            done.add(stage.name)
        for question, joints in tested.items():
            passed.setdefault(question, []).extend(joints)
    failed = {(finding.question, finding.joint) for finding in findings}
    fine: dict[str, tuple[str, ...]] = {}
    untested: dict[str, tuple[str, ...]] = {}
    for question in QUESTIONS:
        joints = ("",) if question in _OF_ARM else folder.stages[0].joints
        tested_joints = passed.get(question, ())
        sound = [] if (question, "") in failed else [x for x in joints if (question, x) not in failed]
        fine[question] = tuple(joint for joint in sound if joint in tested_joints)
        untested[question] = tuple(joint for joint in sound if joint not in tested_joints)
    following = next((stage for stage in folder.stages if stage.name not in done), None)
    return Verdict(tuple(findings), fine, untested, None if findings else following)


def _judge_stage(
    folder: Folder, stage: Stage, log: ArmLog
) -> tuple[list[Finding], dict[str, tuple[str, ...]]]:
    """Return what is wrong in the log of a stage, and what it has tested: question -> joints."""
    experiment = folder.experiment(stage)
    robot: Robot = experiment.robot
    upright = robot.with_gravity(UPRIGHT) if compensates_gravity(robot) else robot
    seen = _arrays(log, robot)
    tested: dict[str, tuple[str, ...]] = {}
    findings: list[Finding] = []
    expected_samples = max(float(log.samples["elapsed"].sum()), 1.0)
    missed = 1.0 - len(log.samples) / expected_samples
    if missed > _MISSED:
        remedy = "give the robot's sample time (sample_time), or a machine that keeps up"
        findings.append(Finding("rate", "", f"{missed:.0%} of the samples were missed", remedy))
    else:
        tested["rate"] = ("",)
    if stage.kind == "dry":
        start = experiment.reference.at(0.0).q
        findings += _of_hand(seen, stage, start, tested)
        if not findings:
            findings += _of_weight(seen, upright, tested)
        if seen.reason and not findings:
            findings.append(_stop_finding(seen))
    elif stage.kind in CAPS:
        findings += _of_echo(seen, robot)
        if not findings:
            findings += _of_stage(seen, stage, robot, upright, tested)
        if stage.kind == "excite" and not findings:
            findings += _of_identification(log, robot, experiment, tested)
    elif seen.reason:
        findings += [_stop_finding(seen)]
    if stage.kind in ("slow", "full") and not findings:
        tested["whole arm"] = ("",)
    return findings, tested


def _arrays(log: ArmLog, robot: Robot) -> _Seen:
    """Return the samples of a log."""
    rows = log.samples
    names = tuple(robot.joint_names)
    if tuple(log.header["joints"]) != names:
        raise ParameterError("log", ", ".join(log.header["joints"]), f"the joints {', '.join(names)}")
    if len(rows) < _FEWEST:
        raise RolloutError(f"{log.source}: has {len(rows)} samples; expected a whole stage")
    faulty = np.flatnonzero(rows["reason"] > Reason.NONE)
    first = int(faulty[0]) if faulty.size else len(rows)
    q, tau = rows["q_measured"], rows["tau"]
    finite_q = np.where(np.isfinite(q), q, 0.0)
    return _Seen(
        names=names,
        t=log.t,
        q=q,
        q_ref=rows["q_ref"],
        tau=tau,
        dev=tau - robot.gravity(finite_q),
        applied=rows["applied"],
        reason=int(rows["reason"][first]) if faulty.size else 0,
        joint=int(rows["joint"][first]) if faulty.size else 0,
        faulty=first,
    )


def _stop_finding(seen: _Seen) -> Finding:
    """Return that the supervisor stopped a stage for a reason of its own."""
    reason = Reason(seen.reason)
    joint = "" if reason in OF_TOOL else seen.names[seen.joint]
    text = f"stopped at {seen.t[seen.faulty]:.3g} s: {reason.name}"
    return Finding("whole arm", joint, text, "docs/reasons.md has its causes")


def _of_hand(
    seen: _Seen, stage: Stage, start: Array, tested: dict[str, tuple[str, ...]]
) -> Iterator[Finding]:
    """Find what positions tell that were moved by hand, one joint after another, as far as the stage says."""
    names, way = seen.names, np.array(stage.way)
    moved = seen.q - seen.q[0]
    largest = np.abs(moved).max(axis=0)
    if (largest > _TOO_FAR).any():
        j = int(largest.argmax())
        said = f"moved {largest[j]:.3g} where it was moved {abs(way[j]):.2g}"
        yield Finding(
            "unit", names[j], said, "send rad and m, not degrees, encoder counts or turns of the motor"
        )
        return
    if (largest < _MOVED).any():
        for j in map(int, np.flatnonzero(largest < _MOVED)):
            said = f"its position changed by {largest[j]:.2g} where it was moved {abs(way[j]):.2g}"
            yield Finding("order", names[j], said, "move it, or look for its encoder in another place")
        return
    times = np.abs(moved).argmax(axis=0)  # at which each joint is farthest
    for place, j in enumerate(np.argsort(times)):
        if place != j:
            said = f"changed when {names[place]} was moved"
            yield Finding("order", names[j], said, "send the positions in the order of the joints")
            return
    yield from _of_ways(names, way, moved[times], largest)
    from_start = seen.q[0] - start
    for j in map(int, np.flatnonzero(np.abs(from_start) > _START)):
        said = f"began {from_start[j]:+.2g} from where the stage begins"
        yield Finding("zero", names[j], said, "begin there by the marks of the arm, or mend its zero")
    for question in ("order", "sign", "unit", "zero"):
        tested[question] = names


def _of_ways(names: tuple[str, ...], way: Array, peaks: Array, largest: Array) -> Iterator[Finding]:
    """Find what each joint did where it was moved; `peaks` (n, n) has the whole arm then, joint by joint."""
    for j, name in enumerate(names):
        others = peaks[j].copy()
        others[j] = 0.0
        i = int(np.abs(others).argmax())
        ratio = largest[j] / abs(way[j])
        if abs(others[i]) > _ALONG * largest[j]:
            said = f"{names[i]} changed with it by {others[i]:.2g}"
            yield Finding("order", name, said, "its motors are coupled: take that out of the positions")
        elif peaks[j, j] * way[j] < 0.0:
            said = f"its position changed by {peaks[j, j]:+.2g} where it was moved {way[j]:+.2g}"
            yield Finding("sign", name, said, "turn the sign of its position round, and that of its torque")
        elif not 1.0 / _RATIO < ratio < _RATIO:
            said = f"moved {largest[j]:.3g} where it was moved {abs(way[j]):.2g}"
            yield Finding("unit", name, said, "look at the ratio of its gear in the position")


def _of_weight(seen: _Seen, robot: Robot, tested: dict[str, tuple[str, ...]]) -> Iterator[Finding]:
    """Find whether the torque that a robot reports while it holds itself is the model's weight."""
    if not np.isfinite(seen.applied).all():
        return
    weight = robot.gravity(seen.q)
    allowed = _borne(robot, seen.q[0], weight)
    apart = np.median(seen.applied - weight, axis=0)
    scale = _scale(seen.applied, weight)
    beyond = np.abs(apart) > allowed
    for j in map(int, np.flatnonzero(beyond)):
        model = f"the model's {np.median(weight[:, j]):.3g}"
        said = f"the torque that the robot reports differs by {apart[j]:+.3g} N m or N from {model}"
        if abs(scale - 1.0) > _SCALE:
            said += f"; over all joints {scale:.2g} times the gravity torque"
        yield Finding(
            "weight",
            seen.names[j],
            said,
            "look at the load, the mounting, the file's masses, the unit and the sign",
        )
    tested["weight"] = seen.names
    if not beyond.any() and _tells_mounting(robot, seen.q[0], allowed):
        tested["mounting"] = seen.names


def _borne(robot: Robot, q: Array, weight: Array) -> Array:
    """Return the torque beside the arm's weight that friction tolerates [N m or N], (n,)."""
    of_motion = _FRICTION * moving_torque(robot, q)
    of_weight = _WEIGHT * np.abs(weight).max()
    return np.asarray(np.maximum(of_motion, of_weight) + robot.friction.coulomb)


def _scale(torque: Array, expected: Array) -> float:
    """Return the factor of another torque that comes nearest to one, by least squares."""
    return float((torque * expected).sum() / max(float((expected**2).sum()), 1e-12))


def _tells_mounting(robot: Robot, q: Array, allowed: Array) -> bool:
    """Tell whether a base that is tilted either way would show where the arm stands."""
    down = 9.81 * math.cos(_TILT)
    aside = 9.81 * math.sin(_TILT)
    for gravity in ((aside, 0.0, -down), (0.0, aside, -down)):
        difference = robot.with_gravity(gravity).gravity(q) - robot.gravity(q)
        if not (np.abs(difference) > allowed).any():
            return False
    return True


def _of_echo(seen: _Seen, robot: Robot) -> Iterator[Finding]:
    """Find whether the torque that a robot says it was given is the one that was sent."""
    reported = seen.applied[1 : seen.faulty]  # that of a sample is said in the next one
    sent = seen.tau[: len(reported)]
    if len(reported) < _FEWEST_ECHOED or not np.isfinite(reported).all():
        return
    largest = np.maximum(np.abs(sent).max(axis=0), 1e-9)
    allowed = _ECHO_OF_SENT * largest + _ECHO_OF_LIMIT * robot.limits.effort
    for j, name in enumerate(seen.names):
        if np.abs(reported[:, j] - sent[:, j]).max() <= allowed[j]:
            continue
        from_sent = np.abs(reported - sent[:, j : j + 1]).max(axis=0)
        i = int(from_sent.argmin())
        if i != j and from_sent[i] < 0.1 * largest[j]:
            text = f"its torque is the one that {seen.names[i]} reports"
            question = "command order"
        else:
            scale = _scale(reported[:, j], sent[:, j])
            text = f"the robot reports {scale:.3g} times the torque that was sent"
            question = "command sign" if scale < 0.0 else "command unit"
        remedy = "send N m and N in the order and with the sign of the file's joints"
        yield Finding(question, name, text, remedy)


def _of_stage(
    seen: _Seen, stage: Stage, robot: Robot, upright: Robot, tested: dict[str, tuple[str, ...]]
) -> Iterator[Finding]:
    """Find what a stage with caps tells: whether joints answer their torques, and rest on the model's."""
    if seen.reason:
        yield _answer(seen, stage)
        return
    moved = _farthest(seen.q)
    asked = _farthest(seen.q_ref)
    for name in stage.joints:
        j = seen.names.index(name)
        if moved[j] < _ANSWERED * asked[j]:
            said = f"moved {moved[j]:.2g} where its reference moved {asked[j]:.2g}"
            yield Finding("command order", name, said, "look at its brake, its drive and its load")
    end = seen.t > seen.t[-1] - _REST
    rests = np.median(seen.dev[end], axis=0)
    weight = upright.gravity(seen.q[-1])
    allowed = _borne(upright, seen.q[0], weight)
    beyond = np.abs(rests) > allowed
    for j in map(int, np.flatnonzero(beyond)):
        said = (
            f"the torque at rest differs by {rests[j]:+.3g} N m or N from the model's; "
            f"friction accounts for {allowed[j]:.2g}"
        )
        yield Finding(
            "carried",
            seen.names[j],
            said,
            "check the load, what compensates gravity, the mounting, the masses, and the unit",
        )
    tested["carried"] = seen.names
    if not beyond.any() and _tells_mounting(upright, seen.q[-1], allowed):
        tested["mounting"] = seen.names
    tested |= dict.fromkeys(("command order", "command sign"), stage.joints)
    if not compensates_gravity(robot):  # its torque carries the arm
        carried = np.abs(np.median(seen.tau[end], axis=0))
        tested["command unit"] = _named(seen.names, carried > 2.0 * allowed)
    elif np.isfinite(seen.applied).all():
        tested["command unit"] = stage.joints


def _farthest(q: Array) -> Array:
    """Return how far each joint went from where it began [rad or m], (n,)."""
    return np.asarray(np.abs(q - q[0]).max(axis=0))


def _named(names: tuple[str, ...], chosen: Mask) -> tuple[str, ...]:
    """Return the names of the chosen joints."""
    return tuple(names[j] for j in np.flatnonzero(chosen))


def _answer(seen: _Seen, stage: Stage) -> Finding:
    """Return why a stage was stopped, by what moved and which torque was beside the model's."""
    last = len(seen.t) - 1
    k = min(seen.faulty, last)
    after = min(last, int(np.searchsorted(seen.t, seen.t[k] + _AROUND)))
    moved = seen.q[max(0, k - 1) : after + 1] - seen.q_ref[0]
    far = moved[np.abs(moved).sum(axis=1).argmax()]
    j = seen.joint
    name = seen.names[j]
    dev = seen.dev[max(k - 1, 0)]  # in FAULT it is no longer the law's
    way = max(map(abs, stage.way), default=0.1)
    way = max(way, 1e-9)
    most = int(np.abs(far).argmax())
    reference_moved = np.abs(seen.q_ref[k] - seen.q_ref[0]).max()
    before = reference_moved < _BEFORE * way
    reason = Reason(seen.reason).name
    said = (
        f"{reason} at {seen.t[k]:.3g} s: the torque differs by {dev[j]:+.3g} N m or N from the model's, "
        f"the position by {far[j]:+.2g} from its start"
    )
    if before:
        remedy = "it was at rest: check what compensates gravity, the load, the mounting, and all signs"
        return Finding("carried", name, said, remedy)
    if np.abs(far).max() < _NOTHING * way:
        remedy = "nothing moved: check its brake, its drive, and the unit of the torque"
        return Finding("command order", name, said, remedy)
    if most != j and abs(far[most]) > 2.0 * abs(far[j]):
        said += f", while {seen.names[most]} went {far[most]:+.2g}"
        return Finding("command order", name, said, "look at the order of torques and positions")
    if dev[j] * far[j] < 0.0:
        said += ", against its torque"
        remedy = "look at the sign of its torque and of its position, and at late measurements"
        return Finding("command sign", name, said, remedy)
    return Finding("command unit", name, said, f"docs/reasons.md lists the causes of {reason}")


def _of_inertias(found: Identified, robot: Robot, known: list[str]) -> Iterator[Finding]:
    """Find joints whose inertia or rotor is not the file's; append those that agree to `known`."""
    from armgpi.identification.arm import mean_inertia

    remedy = "take what `armgpi identify` writes, or look at the torque's unit"
    sources = robot.drives.sources("rotor_inertia")
    is_specified = np.array([source not in ("", "assumed") for source in sources])
    missing_rotors = _named(robot.joint_names, found.hidden & is_specified)
    for row, least in zip(found.sums(), mean_inertia(robot), strict=True):
        if row.joint in missing_rotors:  # it is left out of the fit, and the sum is that of the file
            text = "its rotor is far lighter than the one that the file specifies"
            yield Finding("model", row.joint, text, remedy)
            continue
        # Where the file names no rotor there may be none, or the one that is assumed.
        low = least / _MODEL
        high = _MODEL * row.expected
        if row.upper < low or row.lower > high:
            ratio = row.value / (least if row.upper < low else row.expected)
            text = f"its inertia is {ratio:.2g} times what the file lets expect"
            yield Finding("model", row.joint, text, remedy)
        elif low <= row.lower and row.upper <= high:
            known.append(row.joint)


def _of_identification(
    log: ArmLog, robot: Robot, experiment: Experiment, tested: dict[str, tuple[str, ...]]
) -> Iterator[Finding]:
    """Find what the identified arm tells: lag, and torque over what the file expects."""
    from armgpi.identification.arm import identify

    weighs = not compensates_gravity(robot)
    try:
        # What the loop commands acts on the rotors, too: it is no joint torque.
        found = identify([log], robot, gravity=weighs, torque="motor")
    except UnfitLog as error:
        yield Finding("model", "", str(error), "mend that, and run the stage again")
        return
    except MissingPackage:  # then it is not tested
        return
    except ArmgpiError as error:
        yield Finding("model", "", str(error), "run the stage again")
        return
    expected = (0.5 + experiment.config.plant.delay) * log.header["dt"]
    late = found.lag - expected > _LAG + 2.0 * found.lag_std
    if late.any():
        j = int(np.argmax(late))
        said = f"measurements are {1e3 * found.lag[j]:.3g} ms late; the file specifies {1e3 * expected:.3g}"
        remedy = "specify it (plant: delay), or find the cause of the delay"
        yield Finding("lag", robot.joint_names[j], said, remedy)
    tested["lag"] = _named(robot.joint_names, ~late)
    known: list[str] = []
    yield from _of_inertias(found, robot, known)
    every = max(1, len(log.samples) // _COMPARED)
    q = log.samples["q_measured"][::every]
    if weighs:
        weight = robot.gravity(q)
        most = np.abs(found.robot.gravity(q) - weight).max(axis=0)
        allowed = _borne(robot, q[0], weight)
        for j in map(int, np.flatnonzero(most > allowed)):
            said = f"its gravity torque differs by up to {most[j]:.3g} N m or N from the file's"
            yield Finding(
                "model", robot.joint_names[j], said, "take what `armgpi identify` writes, or name the load"
            )
    tested["model"] = tuple(known)
