"""What a certificate is asked for, and what is known of the arm for it: what the file seals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import Array, check_whole, not_negative, positive, quantity
from armgpi.certification.box import Box, box_of
from armgpi.certification.quantities import (
    MARGIN,
    Numbers,
    Points,
    Setting,
    corners,
    largest,
    resting,
    slopes,
)
from armgpi.control.gains import FixedGains
from armgpi.control.gpi import GPI
from armgpi.errors import ParameterError
from armgpi.robot.robot import Robot

#: Nothing disturbs.
NOTHING = {"torque": "0", "shift": "0", "count": "0", "reference": "0", "spread": "0"}
_Value = Callable[[Setting, Robot, Points, Array], Array]


class Asked(NamedTuple):
    """What a certificate is asked for.

    Attributes:
        robot: the arm without load.
        controller: the GPI controller.
        box: configurations of the reference.
        setting: what the numbers are taken over.
        radius: how far the arm may be from its reference [rad or m], shape (n,).
        delay: samples by which measurements are late.
        velocity: speed of the reference [rad/s or m/s], shape (n,); zero where it rests.
        acceleration: its acceleration [rad/s^2 or m/s^2], shape (n,).
        torque: disturbance torque of any course [N m or N], shape (n,).
        friction: whether the joints have the friction of the robot.
        bits: of the encoders; None for exact measurements.
    """

    robot: Robot
    controller: GPI
    box: Box
    setting: Setting
    radius: Array
    delay: int
    velocity: Array
    acceleration: Array
    torque: Array
    friction: bool
    bits: int | None

    @property
    def loads(self) -> tuple[float, float]:
        """Return the lightest and the heaviest load [kg]."""
        found = self.controller.payload
        return (0.0, 0.0) if found is None else (found.lightest, found.heaviest)

    @property
    def half_count(self) -> Array:
        """Return half an encoder count [rad or m], shape (n,)."""
        return np.zeros(self.robot.n) if self.bits is None else 0.5 * self.robot.encoder_count(self.bits)


def ask(
    robot: Robot,
    dt: float,
    *,
    speed: Any,
    payload: Any = None,
    box: Any = None,
    radius: Any = 0.05,
    acceleration: Any = None,
    torque: Any = 0.0,
    friction: bool = False,
    bits: int | None = None,
    delay: int = 0,
    **options: Any,
) -> Asked:
    """Return what :func:`armgpi.certify` is asked for, checked; it has the same arguments."""
    if not isinstance(robot, Robot):
        raise ParameterError("robot", robot, "a single Robot")
    check_whole(delay, "delay", 0, 20)
    if bits is not None:
        check_whole(bits, "bits", 1, 32)
    controller = GPI(robot, dt, delay=delay * dt, payload=payload, **options)
    _check_linear(controller)

    def each(value: Any, name: str, above: bool = False) -> Array:
        array = quantity(value, name, robot.joint_names)
        if not (positive if above else not_negative)(array).all():
            raise ParameterError(name, value, "positive" if above else "zero or positive")
        return array

    arms: tuple[Robot, ...] = (robot,)
    if controller.payload is not None:
        loads = controller.payload
        arms = (robot.with_payload(loads.frame, loads.lightest, loads.com), loads.nominal)
    where, fastest, away = box_of(robot, box), each(speed, "speed", True), each(radius, "radius", True)
    # A gradient is taken between configurations that are a few samples of motion apart as well.
    near = away + (delay + 1) * controller.dt * fastest
    nominal = arms[-1]  # the controller's
    setting = Setting(arms, nominal, *where, near, fastest, controller.feedforward)
    moves = 0.0 * fastest, 0.0 * fastest
    if acceleration is not None:
        moves = fastest, each(acceleration, "acceleration")
    return Asked(
        robot, controller, where, setting, away, delay, *moves, each(torque, "torque"), friction, bits
    )


def law_of(asked: Asked) -> dict[str, Any]:
    """Return the law, which has to be the same for all joints, with its numbers as texts.

    Raises:
        ParameterError: when tuning or poles differ between the joints, or move.
    """
    controller = asked.controller
    if not isinstance(controller.gains, FixedGains):
        raise ParameterError("gains", type(controller.gains).__name__, "FixedGains")
    tuning = controller.gains.nominal()
    omega, zeta, p = (_common(x, name) for x, name in zip(tuning, ("omega", "zeta", "p"), strict=True))
    second = 1.0 if controller.second_ratio is None else _common(controller.second_ratio, "second_ratio")
    damping = zeta if controller.second_zeta is None else _common(controller.second_zeta, "second_zeta")
    return {
        "integrators": controller.integrators,
        "rolloff": controller.rolloff,
        "delay": asked.delay,
        "sample_time": repr(float(controller.dt)),
        "omega": [repr(omega), repr(omega)],
        "bandwidths": [repr(omega)],
        "rate": "0",
        "zeta": repr(zeta),
        "pole_ratio": repr(p / omega),
        "rolloff_ratio": repr(_common(controller.rolloff_ratio, "rolloff_ratio")),
        "second_ratio": repr(second),
        "second_zeta": repr(damping),
    }


def numbers_of(asked: Asked, found: Numbers) -> dict[str, Any]:
    """Return the numbers of the arm, and of the torques that it needs, as texts; rounded to be larger.

    Args:
        asked: what is asked for.
        found: the numbers of the arm.
    """
    setting, joints = asked.setting, range(asked.robot.n)
    light, heavy = setting.arms[0], setting.arms[-1]

    def jump(_: Setting, arm: Robot, at: Points) -> Array:
        change = resting(setting, heavy, at.star) - resting(setting, light, at.star)
        return _length(setting, arm, at, change[:, None])[:, 0]

    return {
        "delta_low": _text(found.delta_low.value, up=False),
        **{
            name: _text(x.value)
            for name, x in found._asdict().items()
            if name not in ("delta_low", "inverse")
        },
        "inverse": [_text(each.value) for each in found.inverse],
        "count_time": _text(float(np.max(asked.half_count / setting.speed))),
        "jump": _text(0.0 if heavy is light else _more(largest(setting, jump))),
        "hold": [_text(_more(largest(setting, _held(j)))) for j in joints],
        "reach": [_text(_more(largest(setting, _reach(j)))) for j in joints],
    }


def shares_of(asked: Asked, numbers: Mapping[str, Any]) -> dict[str, float]:
    """Return the bounded torques that disturb, in the metric of D, by what they come from.

    Args:
        asked: what is asked for.
        numbers: of the arm, as texts.
    """
    setting = asked.setting
    viscous, coulomb = asked.robot.friction
    shares = {"disturbance": _largest_of(setting, asked.torque, _force)}
    if asked.friction:
        shares["friction"] = _largest_of(setting, viscous * setting.speed + coulomb, _force)
    moved = _largest_of(setting, asked.velocity, _length)
    ahead = setting.feedforward == "model"
    # With the model's feedforward its Coriolis torque is too much at worst, the arm's too little.
    known = 1.0 + float(numbers["delta_high"]) if ahead else 1.0
    shares["velocity of the reference"] = known * float(numbers["kappa_v"]) * moved
    accelerated = _mismatch if ahead else _length
    shares["acceleration of the reference"] = _largest_of(setting, asked.acceleration, accelerated)
    return shares


def inputs_of(asked: Asked, shares: Mapping[str, float]) -> dict[str, str]:
    """Return the sizes of all that disturbs, in the metric of D, as texts."""
    setting = asked.setting
    return {
        "torque": _text(sum(shares.values())),
        "shift": _text(_largest_of(setting, asked.velocity, _shift)),
        "reference": _text(_largest_of(setting, asked.velocity, _length)),
        "count": _text(_largest_of(setting, asked.half_count, _length)),
    }


def _check_linear(controller: GPI) -> None:
    """Refuse what is not a linear law of the error."""
    for name, value in {"realisation": "bumpless", "friction_feedforward": False}.items():
        if getattr(controller, name) != value:
            raise ParameterError(
                name, getattr(controller, name), f"{value} where there is to be a certificate"
            )
    for name in ("rest_dead_zone", "rest_leak"):
        if getattr(controller, name).any():
            raise ParameterError(name, getattr(controller, name), "0 where there is to be a certificate")


def _common(value: Any, name: str) -> float:
    """Return the one value that all joints have."""
    array = np.unique(np.asarray(value))
    if len(array) > 1:
        raise ParameterError(name, array.tolist(), "the same for all joints: one of them stands for the arm")
    return float(array[0])


def _held(joint: int) -> Callable[[Setting, Robot, Points], Array]:
    """Return the function that gives the torque with which a joint is held [N m or N]."""

    def torque(setting: Setting, arm: Robot, at: Points) -> Array:
        held = setting.nominal.inertia_times(at.q, resting(setting, arm, at.star))
        if setting.feedforward != "none":
            held = held + setting.nominal.gravity(at.star)
        return np.abs(held[:, joint])

    return torque


def _reach(joint: int) -> Callable[[Setting, Robot, Points], Array]:
    """Return the function that gives a joint's torque over the length of v in the metric of D."""

    def factor(setting: Setting, arm: Robot, at: Points) -> Array:
        row = setting.nominal.mass_matrix(at.q)[:, joint]
        return np.asarray(np.sqrt(np.einsum("ki,ki->k", row, arm.inertia_solve(at.q, row))))

    return factor


def _largest_of(setting: Setting, bound: Array, function: _Value) -> float:
    """Return the largest value of a function that is convex in a vector within bounds: it is at a corner."""
    if not bound.any():
        return 0.0
    ends = corners(bound)

    def values(_: Setting, arm: Robot, at: Points) -> Array:
        return np.asarray(function(setting, arm, at, ends).max(axis=1))

    return _more(largest(setting, values))


def _length(_: Setting, arm: Robot, at: Points, x: Array) -> Array:
    """Return the lengths (k, c) of velocities or accelerations (c, n) or (k, c, n) in the metric of D."""
    along = np.broadcast_to(x, (len(at.q), *x.shape[-2:])) @ arm.mass_matrix(at.q)
    return np.asarray(np.sqrt((along * x).sum(axis=-1)))


def _force(_: Setting, arm: Robot, at: Points, x: Array) -> Array:
    """Return the lengths (k, c) of torques in the metric of D^-1."""
    along = np.broadcast_to(x, (len(at.q), *x.shape[-2:])) @ np.linalg.inv(arm.mass_matrix(at.q))
    return np.asarray(np.sqrt((along * x).sum(axis=-1)))


def _mismatch(setting: Setting, arm: Robot, at: Points, a: Array) -> Array:
    """Return the lengths of what accelerations take beyond what the model says at the reference."""
    return _force(setting, arm, at, a @ (arm.mass_matrix(at.q) - setting.nominal.mass_matrix(at.star)))


def _shift(setting: Setting, arm: Robot, at: Points, v: Array) -> Array:
    """Return how fast v* changes along the reference, in the metric of D."""
    return _length(setting, arm, at, v @ slopes(lambda q: resting(setting, arm, q), at.star))


def _more(value: float) -> float:
    """Return what a search found and the share that it may have missed."""
    return (1.0 + MARGIN) * value


def _text(value: float, up: bool = True) -> str:
    """Return a number of ten digits that is larger, or smaller, by what rounding takes at most."""
    return f"{value * (1.0 + 1e-9 if up else 1.0 - 1e-9):.12g}"
