"""What the logs of a bring-up say: what was tested, what failed, and what nothing has tested yet."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.errors import ArmgpiError, MissingPackage, ParameterError, RolloutError, UnfitLog
from armgpi.hardware.export.targets import compensates_gravity
from armgpi.hardware.realtime.ends import UPRIGHT
from armgpi.hardware.realtime.stages import CAPS, Folder, Stage, moving_torque
from armgpi.loop.log import ArmLog
from armgpi.loop.log import read as read_log
from armgpi.supervisor import OF_TOOL, Reason

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
#: A joint that was moved by hand moved at least so much, and not more than so much [rad or m]; another one
#: less than this share of it; the arm began as near to its start; and its way is known within this factor.
_MOVED, _TOO_FAR, _ALONG, _START, _RATIO = 0.05, 1.0, 0.4, 0.1, 1.6
#: Torque beside the model's weight that friction explains: a share of what a joint is moved with, and
#: of the arm's largest weight.
_FRICTION, _WEIGHT = 0.06, 0.12
#: A base tilted by this has to show, or its mounting was not tested [rad].
_TILT = math.radians(20.0)
#: The torque that a robot reports over that weight: this far from 1 is another unit or scale.
_SCALE = 0.3
#: What a joint of a pulse goes at least, as a share of its way; others at most.
_ANSWERED, _QUIET = 0.5, 0.3
#: Lag beyond the file's [s], and torque over what the file expects either way, rotors being known to 2.5.
_LAG, _MODEL = 0.004, 3.0
#: Time over which an arm is at rest at the end of a stage, and in which a fault shows [s].
_REST, _AROUND = 0.2, 0.1


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
            "findings": [each._asdict() for each in self.findings],
            "passed": {key: list(joints) for key, joints in self.passed.items()},
            "not_tested": {key: list(joints) for key, joints in self.untested.items()},
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
    for path in sorted(logs, key=lambda x: folder.stages.index(folder.stage(x))):
        stage = folder.stage(path)
        wrong, tested = _judge_stage(folder, stage, read_log(path))
        findings += wrong
        done |= set() if wrong else {stage.name}
        for question, joints in tested.items():
            passed.setdefault(question, []).extend(joints)
    failed = {(each.question, each.joint) for each in findings}
    fine: dict[str, tuple[str, ...]] = {}
    untested: dict[str, tuple[str, ...]] = {}
    for question in QUESTIONS:
        joints = ("",) if question in _OF_ARM else folder.stages[0].joints
        sound = [x for x in joints if not {(question, x), (question, "")} & failed]
        fine[question] = tuple(x for x in sound if x in passed.get(question, ()))
        untested[question] = tuple(x for x in sound if x not in fine[question])
    later = (stage for stage in folder.stages if stage.name not in done)
    return Verdict(tuple(findings), fine, untested, None if findings else next(later, None))


def _judge_stage(
    folder: Folder, stage: Stage, log: ArmLog
) -> tuple[list[Finding], dict[str, tuple[str, ...]]]:
    """Return what is wrong in the log of a stage, and what it has tested: question -> joints."""
    experiment = folder.experiment(stage)
    robot: Any = experiment.robot
    upright = robot.with_gravity(UPRIGHT) if compensates_gravity(robot) else robot
    seen = _arrays(log, robot)
    tested: dict[str, tuple[str, ...]] = {}
    findings: list[Finding] = []
    missed = 1.0 - len(log.samples) / max(float(log.samples["elapsed"].sum()), 1.0)
    if missed > _MISSED:
        remedy = "give the robot's sample time (sample_time), or a machine that keeps up"
        findings.append(Finding("rate", "", f"{missed:.0%} of the samples were missed", remedy))
    else:
        tested["rate"] = ("",)
    if stage.kind == "dry":
        findings += _of_hand(seen, stage, experiment.reference.at(0.0).q, tested)
        if not findings:
            findings += _of_weight(seen, upright, tested)
        if seen.reason and not findings:
            findings.append(_stop_finding(seen))
    elif stage.kind in CAPS:
        findings += _of_echo(seen, robot)
        findings += _of_stage(seen, stage, robot, upright, tested) if not findings else []
        if stage.kind == "excite" and not findings:
            findings += _of_identification(log, robot, experiment, tested)
    elif seen.reason:
        findings += [_stop_finding(seen)]
    if stage.kind in ("slow", "full") and not findings:
        tested["whole arm"] = ("",)
    return findings, tested


def _arrays(log: ArmLog, robot: Any) -> _Seen:
    """Return the samples of a log."""
    rows, names = log.samples, tuple(robot.joint_names)
    if tuple(log.header["joints"]) != names:
        raise ParameterError("log", ", ".join(log.header["joints"]), f"the joints {', '.join(names)}")
    if len(rows) < 10:
        raise RolloutError(f"{log.source}: has {len(rows)} samples; expected a whole stage")
    faulty = np.flatnonzero(rows["reason"] > Reason.NONE)
    first = int(faulty[0]) if faulty.size else len(rows)
    reason, joint = (int(rows[name][first]) if faulty.size else 0 for name in ("reason", "joint"))
    q, tau = rows["q_measured"], rows["tau"]
    dev = tau - robot.gravity(np.where(np.isfinite(q), q, 0.0))
    return _Seen(names, log.t, q, rows["q_ref"], tau, dev, rows["applied"], reason, joint, first)


def _stop_finding(seen: _Seen) -> Finding:
    """Return that the supervisor stopped a stage for a reason of its own."""
    why = Reason(seen.reason)
    reason, joint = why.name, "" if why in OF_TOOL else seen.names[seen.joint]
    said = f"stopped at {seen.t[seen.faulty]:.3g} s: {reason}"
    return Finding("whole arm", joint, said, "docs/reasons.md has its causes")


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
    for j in map(int, np.flatnonzero(np.abs(seen.q[0] - start) > _START)):
        said = f"began {seen.q[0][j] - start[j]:+.2g} from where the stage begins"
        yield Finding("zero", names[j], said, "begin there by the marks of the arm, or mend its zero")
    for question in ("order", "sign", "unit", "zero"):
        tested[question] = names


def _of_ways(names: tuple[str, ...], way: Array, peaks: Array, largest: Array) -> Iterator[Finding]:
    """Find what each joint did where it was moved; `peaks` (n, n) has the whole arm then, joint by joint."""
    for j, name in enumerate(names):
        others = np.where(np.arange(len(names)) == j, 0.0, peaks[j])
        i = int(np.abs(others).argmax())
        if abs(others[i]) > _ALONG * largest[j]:
            said = f"{names[i]} changed with it by {others[i]:.2g}"
            yield Finding("order", name, said, "its motors are coupled: take that out of the positions")
        elif peaks[j, j] * way[j] < 0.0:
            said = f"its position changed by {peaks[j, j]:+.2g} where it was moved {way[j]:+.2g}"
            yield Finding("sign", name, said, "turn the sign of its position round, and that of its torque")
        elif not 1.0 / _RATIO < largest[j] / abs(way[j]) < _RATIO:
            said = f"moved {largest[j]:.3g} where it was moved {abs(way[j]):.2g}"
            yield Finding("unit", name, said, "look at the ratio of its gear in the position")


def _of_weight(seen: _Seen, robot: Any, tested: dict[str, tuple[str, ...]]) -> Iterator[Finding]:
    """Find whether the torque that a robot reports while it holds itself is the model's weight."""
    if not np.isfinite(seen.applied).all():
        return
    weight = robot.gravity(seen.q)
    allowed = _borne(robot, seen.q[0], weight)
    apart = np.median(seen.applied - weight, axis=0)
    scale = float((seen.applied * weight).sum() / max((weight**2).sum(), 1e-12))
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


def _borne(robot: Any, q: Array, weight: Array) -> Array:
    """Return the torque beside the arm's weight that friction tolerates [N m or N], (n,)."""
    unknown = np.maximum(_FRICTION * moving_torque(robot, q), _WEIGHT * np.abs(weight).max())
    return np.asarray(unknown + robot.friction.coulomb)


def _tells_mounting(robot: Any, q: Array, allowed: Array) -> bool:
    """Tell whether a base that is tilted either way would show where the arm stands."""
    down = 9.81 * math.cos(_TILT)
    tilts = [(9.81 * math.sin(_TILT), 0.0, -down), (0.0, 9.81 * math.sin(_TILT), -down)]
    apart = (robot.with_gravity(tilt).gravity(q) - robot.gravity(q) for tilt in tilts)
    return all((np.abs(each) > allowed).any() for each in apart)


def _of_echo(seen: _Seen, robot: Any) -> Iterator[Finding]:
    """Find whether the torque that a robot says it was given is the one that was sent."""
    said, sent = seen.applied[1 : seen.faulty], seen.tau[: seen.faulty][: len(seen.applied[1 : seen.faulty])]
    if len(said) < 20 or not np.isfinite(said).all():
        return
    size = np.maximum(np.abs(sent).max(axis=0), 1e-9)
    for j, name in enumerate(seen.names):
        if np.abs(said[:, j] - sent[:, j]).max() <= 0.05 * size[j] + 1e-3 * robot.limits.effort[j]:
            continue
        others = np.abs(said - sent[:, j : j + 1]).max(axis=0)
        i = int(others.argmin())
        scale = float(said[:, j] @ sent[:, j] / max(float(sent[:, j] @ sent[:, j]), 1e-12))
        if i != j and others[i] < 0.1 * size[j]:
            saw, question = f"its torque is the one that {seen.names[i]} reports", "command order"
        else:
            saw = f"the robot reports {scale:.3g} times the torque that was sent"
            question = "command sign" if scale < 0.0 else "command unit"
        yield Finding(
            question, name, saw, "send N m and N in the order and with the sign of the file's joints"
        )


def _of_stage(
    seen: _Seen, stage: Stage, robot: Any, upright: Any, tested: dict[str, tuple[str, ...]]
) -> Iterator[Finding]:
    """Find what a stage with caps tells: whether joints answer their torques, and rest on the model's."""
    if seen.reason:
        yield _answer(seen, stage)
        return
    moved = np.abs(seen.q - seen.q[0]).max(axis=0)
    asked = np.abs(seen.q_ref - seen.q_ref[0]).max(axis=0)
    for name in stage.joints:
        j = seen.names.index(name)
        if moved[j] < _ANSWERED * asked[j]:
            said = f"moved {moved[j]:.2g} where its reference moved {asked[j]:.2g}"
            yield Finding("command order", name, said, "look at its brake, its drive and its load")
    end = seen.t > seen.t[-1] - _REST
    rests = np.median(seen.dev[end], axis=0)
    allowed = _borne(upright, seen.q[0], upright.gravity(seen.q[-1]))
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
        heavy = np.abs(np.median(seen.tau[end], axis=0)) > 2.0 * allowed
        tested["command unit"] = tuple(name for name, known in zip(seen.names, heavy, strict=True) if known)
    elif np.isfinite(seen.applied).all():
        tested["command unit"] = stage.joints


def _answer(seen: _Seen, stage: Stage) -> Finding:
    """Return why a stage was stopped, by what moved and which torque was beside the model's."""
    k = min(seen.faulty, len(seen.t) - 1)
    after = min(len(seen.t) - 1, int(np.searchsorted(seen.t, seen.t[k] + _AROUND)))
    around = slice(max(0, k - 1), after + 1)
    moved = seen.q[around] - seen.q_ref[0]
    far = moved[np.abs(moved).sum(axis=1).argmax()]
    j = seen.joint
    name, dev = seen.names[j], seen.dev[max(k - 1, 0)]  # in FAULT it is no longer the law's
    way = max(max(map(abs, stage.way), default=0.1), 1e-9)
    most = int(np.abs(far).argmax())
    before = np.abs(seen.q_ref[k] - seen.q_ref[0]).max() < 0.02 * way
    reason = Reason(seen.reason).name
    said = f"{reason} at {seen.t[k]:.3g} s: the torque differs by {dev[j]:+.3g} N m or N from the model's, "
    said += f"the position by {far[j]:+.2g} from its start"
    if before:
        remedy = "it was at rest: check what compensates gravity, the load, the mounting, and all signs"
        return Finding("carried", name, said, remedy)
    if np.abs(far).max() < 0.2 * way:
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


def _of_inertias(found: Any, robot: Any, known: list[str]) -> Iterator[Finding]:
    """Find joints whose inertia or rotor is not the file's; append those that agree to `known`."""
    from armgpi.identification.arm import mean_inertia

    specified = [source not in ("", "assumed") for source in robot.drives.sources("rotor_inertia")]
    missing = dict(zip(robot.joint_names, found.hidden & np.array(specified), strict=True))
    for row, least in zip(found.sums(), mean_inertia(robot), strict=True):
        if missing[row.joint]:  # then its rotor is left out of the fit, and the sum is that of the file
            said = "its rotor is far lighter than the one that the file specifies"
            remedy = "take what `armgpi identify` writes, or look at the torque's unit"
            yield Finding("model", row.joint, said, remedy)
            continue
        # Where the file names no rotor there may be none, or the one that is assumed.
        low, high = least / _MODEL, _MODEL * row.expected
        if row.upper < low or row.lower > high:
            ratio = row.value / (least if row.upper < low else row.expected)
            said = f"its inertia is {ratio:.2g} times what the file lets expect"
            yield Finding(
                "model", row.joint, said, "take what `armgpi identify` writes, or look at the torque's unit"
            )
        elif low <= row.lower and row.upper <= high:
            known.append(row.joint)


def _of_identification(
    log: ArmLog, robot: Any, experiment: Any, tested: dict[str, tuple[str, ...]]
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
    tested["lag"] = tuple(name for name, is_late in zip(robot.joint_names, late, strict=True) if not is_late)
    known: list[str] = []
    yield from _of_inertias(found, robot, known)
    q = log.samples["q_measured"][:: max(1, len(log.samples) // 50)]
    if weighs:
        own, file = found.robot.gravity(q), robot.gravity(q)
        most = np.abs(own - file).max(axis=0)
        allowed = _borne(robot, q[0], file)
        for j in map(int, np.flatnonzero(most > allowed)):
            said = f"its gravity torque differs by up to {most[j]:.3g} N m or N from the file's"
            yield Finding(
                "model", robot.joint_names[j], said, "take what `armgpi identify` writes, or name the load"
            )
    tested["model"] = tuple(known)
