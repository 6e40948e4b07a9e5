"""What exported code takes for a fault, and what it does then."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import (
    Array,
    PerJointInput,
    check_choice,
    check_number,
    check_type,
    check_whole,
    per_joint,
    positive,
    quantity,
)
from armgpi.control.controller import Controller
from armgpi.errors import ParameterError

#: A measurement that does not change for so long [s], while it should, is frozen.
_FROZEN_TIME = 0.05
#: Counts by which a reference has to move before a measurement has to.
_FROZEN_COUNTS = 16.0
#: Resolution of positions where none is given: a turn, or the travel of a prismatic joint, in 2^16 counts.
_BITS = 16
#: Standard deviations of noise that count as resolution.
_SIGMAS = 6.0


class Faults(NamedTuple):
    """How exported code handles faults.

    A frozen sensor and an arm at rest both repeat one number. They differ in what was asked of the arm since
    the number last changed: its reference has moved on by `frozen_counts` counts,
    or its torque has changed by `frozen_effort` of the effort limit more than its weight has. A measurement
    that stays as it is for `frozen_samples` samples after that is a fault.

    Attributes:
        action: "hold" for the torque that carries the arm's weight at the last good configuration, or "zero".
        frozen_samples: samples that make a measurement frozen; 0 for no such check; those of 0.05 s, three
            at least, when not given.
        frozen_counts: travel of the reference that asks for a motion [counts].
        frozen_effort: change of torque that asks for one, as a share of the effort limit.
        jump: samples of travel at the velocity limit that a measurement may take at once: one more than may
            get lost in a row; 0 for no such check. Joints without a velocity limit are not checked.
        resolution: a count [rad or m], a number or (n,): what positions may differ by without a motion; a
            turn / 2^16 when not given, for a prismatic joint its travel / 2^16.
    """

    action: str = "hold"
    frozen_samples: int | None = None
    frozen_counts: float = _FROZEN_COUNTS
    frozen_effort: float = 0.5
    jump: float = 2.0
    resolution: PerJointInput | None = None


class Bounds(NamedTuple):
    """The numbers that exported code compares with.

    Attributes:
        action: "hold" or "zero".
        frozen_samples: 0 for no check.
        travel: of a reference [rad or m], shape (n,).
        torque: change of torque [N m or N], likewise.
        jump: largest change of a position from sample to sample [rad or m], likewise; None for no check.
    """

    action: str
    frozen_samples: int
    travel: Array
    torque: Array
    jump: Array | None


def bounds(faults: Faults, controller: Controller) -> Bounds:
    """Return the numbers for a controller's arm and sample time.

    Raises:
        ParameterError: when one of the settings is not as it should be.
        ArrayError: when the resolution is not positive or does not fit the joints.
    """
    check_type(faults, "faults", Faults, "Faults")
    check_choice(faults.action, "action", ("hold", "zero"))
    robot, dt = controller.robot, controller.dt
    samples = faults.frozen_samples
    if samples is None:
        samples = _samples(dt)
    samples = check_whole(samples, "frozen_samples", 0)
    if samples >= 2**31:  # counted in a uint32_t
        raise ParameterError("frozen_samples", samples, "below 2^31")
    counts = check_number(faults.frozen_counts, "frozen_counts", "zero or positive")
    share = check_number(faults.frozen_effort, "frozen_effort", "positive", open_=True)
    jump = check_number(faults.jump, "jump", "zero or positive")
    if faults.resolution is None:
        count = default_resolution(controller)
    else:
        count = per_joint(faults.resolution, "resolution", robot.joint_names, "positive", positive)
    # A joint whose URDF gives no velocity limit may move at any speed.
    speed = np.where(robot.limits.velocity > 0.0, robot.limits.velocity, math.inf)
    return Bounds(
        faults.action,
        samples,
        np.broadcast_to(counts * count, (robot.n,)),
        np.broadcast_to(share * controller.effort, (robot.n,)),
        np.broadcast_to(jump * dt * speed + 2.0 * count, (robot.n,)) if jump else None,
    )


def suited(faults: Faults, plant: Any, controller: Controller) -> Faults:
    """Return settings in which what is not given suits an experiment's encoder, noise and delay."""
    if faults.resolution is None:
        names = controller.robot.joint_names
        bits = _BITS if plant.encoder_bits is None else plant.encoder_bits
        count = default_resolution(controller, quantity(bits, "encoder_bits", names, _BITS))
        noise = 0.0 if plant.noise is None else quantity(plant.noise.position, "position", names, 0.0)
        faults = faults._replace(resolution=count + _SIGMAS * noise)
    if faults.frozen_samples is None:  # what comes late repeats itself for longer
        faults = faults._replace(frozen_samples=_samples(controller.dt) + plant.delay)
    return faults


def _samples(dt: float) -> int:
    """Return how many samples make a measurement frozen."""
    return max(3, math.ceil(_FROZEN_TIME / dt - 1e-9))


def default_resolution(controller: Controller, bits: Array | int = _BITS) -> Array:
    """Return a count of an encoder of so many bits [rad or m], shape (n,)."""
    return controller.robot.encoder_count(bits)
