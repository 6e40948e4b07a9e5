"""States and reasons of a supervised controller, and what it keeps from sample to sample."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Any, NamedTuple

from armgpi.base.arrays import Array
from armgpi.supervisor.joints import Mask

#: What a rollout records of the supervisor: status, reason and joint of a fault, samples since then.
SIGNALS = ("supervisor", "supervisor_reason", "supervisor_joint", "supervisor_since")
#: Samples since a fault are counted up to here: single precision counts to 2^24 = 1.7e7.
COUNTED = 1e7


class State(IntEnum):
    """What a supervised controller is in."""

    INIT = 0
    RUN = 1
    STOPPING = 2
    HOLD = 3
    FAULT = 4


class Reason(IntEnum):
    """Why it stops; of several in one sample the one with the highest number."""

    NONE = 0
    BEFORE_INIT = 1
    LATE = 2
    SATURATED = 3
    FOLLOWING = 4
    REFERENCE = 5
    POSITION = 6
    FROZEN = 7
    JUMP = 8
    NOT_FINITE = 9
    RESPONSE = 10
    SPEED = 11
    CAP = 12
    WORKSPACE = 13
    TOOL_SPEED = 14
    TOOL_FORCE = 15


#: Reasons that concern the tool, and no joint.
OF_TOOL = frozenset({Reason.WORKSPACE, Reason.TOOL_SPEED, Reason.TOOL_FORCE})


class FrozenState(NamedTuple):
    """What FROZEN keeps, each of shape (n,) or (batch, n).

    Attributes:
        unchanged_samples: samples for which the measurement should have changed; :data:`COUNTED` of a joint
            that FAULT does not trust.
        reference_at_change: reference when the measurement last changed [rad or m].
        torque_at_change: torque when the measurement last changed [N m or N].
        pull_when_asked: torque beside that of gravity when it was first asked to change, 0 where it is not
            [N m or N].
    """

    unchanged_samples: Array
    reference_at_change: Array
    torque_at_change: Array
    pull_when_asked: Array


class ResponseState(NamedTuple):
    """What RESPONSE keeps, each of shape (n,) or (batch, n); torques where `adverse_samples` is not 0.

    Attributes:
        adverse_samples: 1, and the samples for which the joint has answered its torque the wrong way, from
            where an error was worth a look; 0 elsewhere.
        torque: torque, smoothed [N m or N]. In FAULT, of a joint that answers the wrong way, the velocity
            from which on it gets none [rad or m per sample].
        torque_lowpass: the same, smoothed again [N m or N].
        model_torque_lowpass: torque that the nominal model needs for the motion, likewise [N m or N].
    """

    adverse_samples: Array
    torque: Array
    torque_lowpass: Array
    model_torque_lowpass: Array


class Watch(NamedTuple):
    """What the supervisor keeps.

    From `status` to `travel`, and `nominal`, they are of shape (1,) or (batch, 1), the others of (n,) or
    (batch, n).

    Attributes:
        status: number of its state.
        reason: number of the reason of a fault, 0 for none.
        joint: index of the joint that it concerns.
        since: samples since the fault.
        late: 1 when the measurement that comes is too late.
        ready: 1 when there was a good measurement.
        restless: samples for which the arm has yet to rest before it is HOLD.
        travel: past the reference since a stop began, of the fastest joint, over what FOLLOWING allows [-].
        bad: samples in a row without a good measurement of the joint.
        q: last good measurement [rad or m].
        change: of it, in its sample, the last that was not zero and over no gap [rad or m].
        miss: by how much it last missed where that change led, over no gap [rad or m].
        v: its velocity, smoothed [rad or m per sample].
        r: reference that is followed [rad or m].
        rv: its way in the last sample [rad or m].
        tau: last torque [N m or N].
        frozen: what FROZEN keeps.
        saturated_samples: samples for which the torque was at its limit, before the last one.
        response: what RESPONSE keeps.
        nominal: 1 when it is RUN and nothing is counted: the next sample may take the short way.
        wrench: what the estimate of the tool's force keeps, a
            :class:`armgpi.control.wrench.WrenchState`; None where it is not checked.
    """

    status: Array
    reason: Array
    joint: Array
    since: Array
    late: Array
    ready: Array
    restless: Array
    travel: Array
    bad: Array
    q: Array
    change: Array
    miss: Array
    v: Array
    r: Array
    rv: Array
    tau: Array
    frozen: FrozenState
    saturated_samples: Array
    response: ResponseState
    nominal: Array
    wrench: Any = None


class Sample(NamedTuple):
    """What a sample looks like, per joint but where (1,) is said.

    Attributes:
        q: measured positions where they are good, the last good ones elsewhere.
        bad: see :class:`Watch`.
        lost: whether a measurement is not good, (1,).
        dead: whether one is frozen, or has not been good for too long, (1,).
        failing: whether a joint does not follow, or was at its torque limit for too long, (1,).
        worst: reason with the highest number, 0 for none, (1,).
        joint: first joint that it concerns, (1,).
        unchanged_samples: see :class:`FrozenState`.
        e: distance from the reference [rad or m].
        gravity: torque of gravity at q, 0 where FROZEN counts no joint [N m or N].
        distrusted: which joints do not measure well.
    """

    q: Array
    bad: Array
    lost: Mask
    dead: Mask
    failing: Mask
    worst: Array
    joint: Array
    unchanged_samples: Array
    e: Array
    gravity: Array
    distrusted: Mask


class SupervisedState(NamedTuple):
    """State of a supervised controller.

    Attributes:
        supervisor: what the supervisor keeps.
        law: state of the controller in it.
    """

    supervisor: Watch
    law: Any


class FaultReport(NamedTuple):
    """What a supervised controller of one rollout says of itself.

    Attributes:
        status: "init", "run", "stopping", "hold" or "fault".
        reason: name of a :class:`Reason` in lower case; "none" without a fault.
        joint: name of the joint concerned, None without a fault and where it is the tool.
    """

    status: str
    reason: str
    joint: str | None

    @classmethod
    def of(cls, status: int, reason: int, joint: int, joint_names: Sequence[str]) -> FaultReport:
        """Return a report in words.

        Args:
            status: number of a :class:`State`.
            reason: number of a :class:`Reason`.
            joint: index of the joint concerned.
            joint_names: names of the joints.
        """
        why = Reason(reason)
        name = None if why is Reason.NONE or why in OF_TOOL else joint_names[joint]
        return cls(State(status).name.lower(), why.name.lower(), name)
