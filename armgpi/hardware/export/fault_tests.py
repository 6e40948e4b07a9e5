"""Tests of the faults of an exported controller: for each reason a motion in which Python finds it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.cache import keep_result, read_result
from armgpi.codegen import build
from armgpi.codegen.state import map_leaves
from armgpi.control.controller import FullState, Measurement
from armgpi.hardware.export.code import Code
from armgpi.references.reference import Target
from armgpi.supervisor import FARTHEST, Reason, State, Supervised

#: Under what the rows of the tests are kept.
_KEY = "fault tests"
#: Samples of a test at most, and motions of long tests.
_LONGEST, _TRIED = 4000, 2
#: Samples in which a joint runs away in a test, as far as FOLLOWING.
_RUNNING_AWAY = (100, 200, 400)
#: What keeps a measurement below 1 from repeating itself [rad or m]; single precision has it.
_DITHER = 2e-6
_OFF = "switched off at export"
_NOT_REACHED = "this controller does not get there in the motions tried"


class _Motion(NamedTuple):
    """A motion of one joint that has a fault, or why there is none; see test_faults.c."""

    joint: int = 0
    q: float = 0.0
    dq: float = 0.0
    dddq: float = 0.0
    r: float = 0.0
    dr: float = 0.0
    dither: float = 0.0
    samples: int = 100
    elapsed: int = 1
    nan_q: int = 0
    nan_r: int = 0
    why: str = ""


@dataclass(eq=False)
class _Tried:
    """A motion that is tried.

    Attributes:
        reason: the one that it is to have.
        motion: of a joint.
        found: the reason that Python finds; None while that is not known.
    """

    reason: Reason
    motion: _Motion
    found: int | None = None


def kept_tests(code: Code) -> list[str]:
    """Return the rows of the tests of faults, found now or before for the same controller."""
    # Its C has all of its numbers in it.
    key = hashlib.sha256(f"{_KEY} {build.package()} {code.header} {code.source}".encode()).hexdigest()
    kept = read_result(key)
    if isinstance(kept, list) and all(isinstance(row, str) for row in kept):
        return kept
    # A law of a user's may know one arm at a time.
    rows = fault_tests(code.law.controller, at_once=not code.law.user_defined)
    keep_result(key, rows)
    return rows


def fault_tests(controller: Supervised, at_once: bool = True) -> list[str]:
    """Return the rows of the tests of faults: a motion in which Python finds each, or why there is none.

    Args:
        controller: what is tested.
        at_once: whether it takes several motions as the rollouts of a batch.
    """
    rows = []
    for reason, motion in _fitting(controller, _motions(controller), at_once).items():
        numbers = ", ".join(repr(float(x)) for x in motion[1:7])
        counts = ", ".join(f"{x}U" for x in (motion.joint, motion.samples, motion.elapsed))
        why = f'"{motion.why}"' if motion.why else "NULL"
        name = reason.name.lower()
        rows.append(
            f'    {{"{name}", {numbers}, {counts}, {motion.nan_q}, {motion.nan_r}, {reason}U, {why}}}'
        )
    return rows


def _fitting(
    controller: Supervised, candidates: dict[Reason, list[_Motion]], at_once: bool
) -> dict[Reason, _Motion]:
    """Return for each reason the first motion in which Python finds it, or why there is none."""
    fitting, tried = {}, []
    for reason, motions in candidates.items():
        fitting[reason] = motions[0] if motions[0].why else _Motion(why=_NOT_REACHED)
        tried += [_Tried(reason, motion) for motion in motions if not motion.why]
    if at_once:
        for elapsed in {each.motion.elapsed for each in tried}:
            _try(controller, [each for each in tried if each.motion.elapsed == elapsed])
    else:
        for each in tried:
            if each in _running(tried):
                _try(controller, [each])
    for each in reversed(tried):  # the first one counts
        if each.found == each.reason:
            fitting[each.reason] = each.motion
    return fitting


def _motions(controller: Supervised) -> dict[Reason, list[_Motion]]:
    """Return for each reason the motions to try, the likeliest first, or why there is none."""
    bounds, given, middle = controller.bounds, controller.supervisor, controller.robot.middle()
    each = (bounds.jump, bounds.step, bounds.following, bounds.travel, bounds.speed, bounds.upper)
    jump, step, following, travel, speed, upper, effort = (
        np.broadcast_to(x, middle.shape) for x in (*each, controller.effort)
    )
    # Changes in a sample that are neither JUMP nor REFERENCE. What repeats itself would be FROZEN.
    slip = np.minimum(0.4 * jump, 0.01)
    small = np.minimum(slip, 0.4 * step)
    dither = _DITHER * max(1.0, np.abs(middle).max())
    # Through all of what FOLLOWING allows; it shakes more, or it would be RESPONSE.
    shake, count = 0.25 * float(slip.min()), 1.2 * following / slip + 2.0
    away = []
    for k in np.argsort(count):
        samples = int(min(_LONGEST, count[k]))
        away.append(_Motion(k, dq=slip[k], dither=shake, samples=samples))
    f, p = int(np.argmin(travel / small)), int(np.argmin(upper - middle))
    room = upper[p] - middle[p] - 1.5 * small[p]
    joints = range(len(middle))
    driven = [_Motion(k, r=0.9 * following[k], dither=dither, samples=_LONGEST) for k in joints]
    driven = sorted(driven, key=lambda motion: -_share(controller, motion))[:_TRIED]
    runs = [
        _Motion(k, dddq=following[k] / samples**3, dither=dither, samples=samples)
        for samples in _RUNNING_AWAY
        for k in joints
    ]
    no_torque, no_position = _unlimited(effort, "torque"), _unlimited(upper, "position")
    no_jump, no_speed = _unlimited(jump, "velocity"), _unlimited(speed, "velocity")
    # As fast as JUMP lets it begin, at most: it is found before it is too far from the reference.
    too_fast = np.minimum(1.2 * speed, 0.9 * jump)
    found = {
        Reason.NOT_FINITE: [_Motion(nan_q=1)],
        Reason.REFERENCE: [_Motion(nan_r=1)],
        Reason.JUMP: [_Motion(int(np.argmin(jump)), dq=1.5 * jump.min(), why=no_jump)],
        Reason.FROZEN: [_Motion(f, dr=min(travel[f] / 8.0, small[f]), samples=_LONGEST)],
        Reason.POSITION: [_Motion(p, q=room, dq=small[p], r=room, dr=small[p])],
        Reason.FOLLOWING: away,
        Reason.SATURATED: driven,
        Reason.LATE: [_Motion(elapsed=given.missed + 2)],
        Reason.RESPONSE: runs,
        Reason.CAP: [*driven, *runs],
        Reason.SPEED: [_Motion(k, dq=too_fast[k], why=no_speed) for k in np.argsort(speed)],
    }
    found |= _tool_motions(small, jump, driven)
    never = {Reason.POSITION: no_position, Reason.SATURATED: no_torque, Reason.RESPONSE: no_torque}
    found |= {reason: [_Motion(why=why)] for reason, why in never.items() if why}
    off = {
        Reason.JUMP: given.jump,
        Reason.FROZEN: controller.frozen_samples,
        Reason.SATURATED: given.saturated,
        Reason.RESPONSE: given.response,
        Reason.SPEED: given.speed is not None or given.speed_cap is not None,
        Reason.CAP: given.torque_cap is not None,
        Reason.WORKSPACE: given.workspace is not None,
        Reason.TOOL_SPEED: given.tool_speed is not None,
        Reason.TOOL_FORCE: given.tool_force is not None,
    }
    return found | {reason: [_Motion(why=_OFF)] for reason, value in off.items() if not value}


def _unlimited(limits: Array, kind: str) -> str:
    """Return that no joint has a limit; empty where one has."""
    return "" if (limits < FARTHEST).any() else f"no joint has a {kind} limit"


def _tool_motions(small: Any, jump: Any, driven: list[_Motion]) -> dict[Reason, list[_Motion]]:
    """Return the motions to try for the tool.

    Args:
        small: what a joint may move in a sample [rad or m].
        jump: what it may jump in one [rad or m].
        driven: motions in which a joint's torque is as large as it gets.
    """
    joints = range(len(small))
    return {
        # The reference moves along; slowly as well, or the tool is too fast before it is outside.
        Reason.WORKSPACE: [
            _Motion(k, dq=share * small[k], dr=share * small[k], samples=_LONGEST)
            for share in (1.0, -1.0, 0.1, -0.1)
            for k in joints
        ],
        Reason.TOOL_SPEED: [
            _Motion(k, dq=min(share * jump[k], 0.05), samples=_LONGEST)
            for share in (0.3, 0.9)
            for k in joints
        ],
        # A joint that does not move though the controller pulls at it is held by something.
        Reason.TOOL_FORCE: driven,
    }


def _share(controller: Supervised, motion: _Motion) -> float:
    """Return the torque that a law begins a motion with, as a share of its limit."""
    with np.errstate(all="ignore"):
        law = controller.law.unlimited()
        seen = _samples(controller, [motion])(0)
        tau = law.step(*seen, law.init(*seen)).tau
    return float(np.abs(np.broadcast_to(tau, controller.robot.n) / controller.effort)[motion.joint])


def _samples(controller: Supervised, motions: list[_Motion]) -> Callable[[int], tuple[Any, Target]]:
    """Return what gives measurement and target of each sample of some motions; as test_faults.c does.

    Arrays are (n,) for one motion, (motions, n) for several.
    """
    robot: Any = controller.robot
    columns = np.array([motion[:-1] for motion in motions])[..., None]
    if len(motions) == 1:
        columns = columns[0]
    joint, q0, dq, dddq, r0, dr, dither, _, _, nan_q, nan_r = np.moveaxis(columns, -2, 0)
    unit = np.where(np.arange(robot.n) == joint, 1.0, 0.0)
    zero, middle = np.zeros_like(unit), robot.middle()
    bad_q, bad_r = (unit * bad > 0.0 for bad in (nan_q, nan_r))

    def sample(k: int) -> tuple[Any, Target]:
        q = q0 + k * dq + k**3 * dddq
        v = (dq + 3.0 * k**2 * dddq) / controller.dt
        at = middle + q * unit + dither * (k % 2)
        to = middle + (r0 + k * dr) * unit
        if k:
            at, to = np.where(bad_q, np.nan, at), np.where(bad_r, np.nan, to)
        seen = FullState(at, v * unit) if controller.measurement_type is FullState else Measurement(at)
        return seen, Target(to, zero, zero)

    return sample


def _try(controller: Supervised, tried: list[_Tried]) -> None:
    """Note the reason that the supervisor in Python gives in some motions with as many sample times a sample.

    Several are rollouts of a batch. It ends as soon as none can be the first in which its reason is found.
    """
    rows, elapsed, k = tried, tried[0].motion.elapsed, 0
    sample = _samples(controller, [each.motion for each in rows])
    with np.errstate(all="ignore"):
        state = controller.init(*sample(0))
        while running := _running(rows):
            if 1 < len(running) <= len(rows) // 2:
                state = _of_rows(state, [rows.index(each) for each in running], len(rows))
                sample = _samples(controller, [each.motion for each in running])
                rows = running
            k += 1
            state = controller.advance(*sample(k), state, elapsed).state
            statuses, reasons = state.supervisor.status.ravel(), state.supervisor.reason.ravel()
            for each, status, reason in zip(rows, statuses, reasons, strict=True):
                if each.found is None and (status > State.RUN or k == each.motion.samples):
                    each.found = int(reason)


def _running(tried: list[_Tried]) -> list[_Tried]:
    """Return the motions that have not ended and can still be the first in which their reason is found."""
    found: set[Reason] = set()
    running = []
    for each in tried:
        if each.reason in found:
            continue
        if each.found is None:
            running.append(each)
        elif each.found == each.reason:
            found.add(each.reason)
    return running


def _of_rows(state: Any, kept: list[int], rows: int) -> Any:
    """Return a state of fewer rollouts.

    Args:
        state: of all of them.
        kept: their places.
        rows: how many there are; arrays of one dimension are shared by all.
    """

    def part(leaf: Any) -> Any:
        return leaf[kept] if np.ndim(leaf) > 1 and len(leaf) == rows else leaf

    return map_leaves(part, state)
