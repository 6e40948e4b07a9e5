"""What there is to say of a law before it runs: findings, which health prints and constructors warn of."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from armgpi.errors import ArmgpiWarning, Finding, ParameterError
from armgpi.gpi.family import PRINTED, Member
from armgpi.gpi.margins import SLOWEST_DEFAULT, default_omega, delay_margins
from armgpi.gpi.payload import PLAUSIBLE_DELTA, plausible_load, served_omega
from armgpi.robot.robot import Robot

#: Share of a joint's effort by which one count may move its torque at once, before it is warned of.
COUNT_SHARE = 0.01


def warn(findings: Iterable[Finding], level: int = 1) -> None:
    """Warn of findings.

    Args:
        findings: what was found.
        level: how many calls above whoever calls this the line is that is warned of.
    """
    for finding in findings:
        text = f"{finding.message}; {finding.repair}"
        warnings.warn(text, ArmgpiWarning, stacklevel=level + 2)


def slow_default(dt: float, delay: float, member: Member = PRINTED) -> Iterator[Finding]:
    """Find a default bandwidth at which no arm follows well."""
    omega = default_omega(dt, delay, member=member)
    if omega < SLOWEST_DEFAULT:
        message = (
            f"the default bandwidth is {omega:.3g} rad/s at a sample time of {dt:g} s and delay of "
            f"{delay:g} s, which is slow: below {SLOWEST_DEFAULT:g} rad/s an arm tracks badly"
        )
        yield Finding(
            "warning", "loop", message, omega, SLOWEST_DEFAULT, "use a shorter sample time, or specify gains"
        )


def late_loop(law: Any) -> Iterator[Finding]:
    """Find a loop that hold and transport, or a load that is not there, make unstable.

    Args:
        law: a GPI.

    Raises:
        ParameterError: when its poles are so far apart that floats do not tell.
    """
    tuning, spent = law.gains.nominal(), 0.5 * law.dt + law.delay
    delta = 1.0 if law.payload is None else law.payload.delta[1]
    margin = float(np.min(delay_margins(tuning, law.member, delta)))
    if not math.isfinite(margin):
        raise ParameterError("gains", law.gains, "a tuning with poles that are not so far apart")
    if margin == 0.0:
        message = (
            f"when the payload is not attached, the nominal inertia is {delta:.3g} times the true "
            "one, and the loop is unstable"
        )
        repair = "use a smaller range of payloads, a larger rolloff_ratio or no roll-off"
        yield Finding("warning", "loop", message, delta, 1.0, repair)
    elif spent > margin:
        fastest = float(np.max(tuning.omega_c))
        enough = float(np.min(served_omega(law.payload, law.dt, law.delay, law.member)))
        message = (
            f"omega_c = {fastest:g} rad/s is too fast for dt = {law.dt:g} s and a delay of {law.delay:g} "
            f"s: the loop tolerates a delay of {margin:.3g} s, but sampling and transport use {spent:.3g} "
            "s, so it will be unstable"
        )
        yield Finding("warning", "loop", message, spent, margin, f"use at most {enough:.3g} rad/s")


def coarse_counts(law: Any, bits: Any) -> Iterator[Finding]:
    """Find the joint whose torque one count of an encoder moves by too much of its effort.

    Args:
        law: a GPI; of a batch, or one with gains for rollouts, nothing is said.
        bits: resolution [bits], a number or an array that broadcasts against (n,); None for exact positions.
    """
    if bits is None or law.batch is not None or not isinstance(law.robot, Robot):
        return
    torque = law.count_torque(bits)
    j = int(np.argmax(torque / law.effort))
    share = float(torque[j] / law.effort[j])
    if share > COUNT_SHARE:
        name = law.robot.joint_names[j]
        unit = "N" if law.robot.prismatic[j] else "N m"
        message = (
            f"one encoder count changes the torque of joint {name!r} by {torque[j]:.2g} {unit}, "
            f"{100.0 * share:.2g} % of its effort, which causes torque chatter (usual: at most "
            f"{100.0 * COUNT_SHARE:g} %)"
        )
        own = float(np.broadcast_to(np.asarray(bits, dtype=float), torque.shape)[j])
        enough = math.ceil(own + math.log2(share / COUNT_SHARE) - 1e-9)
        repair = f"use an encoder of {enough} bits, less bandwidth or a roll-off"
        yield Finding("warning", f"joint {name!r}", message, share, COUNT_SHARE, repair)


def light_model(robot: Robot, nominal: float = 0.0) -> Iterator[Finding]:
    """Find a nominal model that is too light for the load that an arm is likely to carry.

    Args:
        robot: the arm without load.
        nominal: mass at the tip of the nominal model [kg].
    """
    load = plausible_load(robot)
    delta = load.with_nominal(nominal)
    if delta < PLAUSIBLE_DELTA:
        carries = f"with {nominal:.2g} kg there" if nominal else "without it"
        message = (
            f"a payload of {load.mass:.2g} kg (5 % of the moving mass) 5 cm from {robot.tip!r} gives an "
            f"inertia ratio delta of {delta:.2g} for a nominal D(q) {carries}; below {PLAUSIBLE_DELTA:g} "
            "arms become unstable under GPI"
        )
        repair = (
            "specify the payload in the nominal model (payload), or the rotor inertia that the URDF does "
            "not contain (with_armature)"
        )
        yield Finding("warning", "robot", message, delta, PLAUSIBLE_DELTA, repair)
