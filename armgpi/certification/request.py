"""What a certificate is asked for, and what is known of the arm for it: what the file seals."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from armgpi.base import renamed
from armgpi.base.arrays import Array, check_choice, check_whole, not_negative, positive, quantity
from armgpi.base.renamed import current_name
from armgpi.certification.box import Box, box_of
from armgpi.certification.quantities import PER_JOINT, Numbers, Setting, friction_of
from armgpi.errors import ParameterError
from armgpi.gpi.family import Member
from armgpi.gpi.gains import FixedGains
from armgpi.gpi.law import GPI
from armgpi.gpi.network import BSplineNetwork
from armgpi.robot.robot import Robot

#: Nothing disturbs.
NOTHING = dict.fromkeys(("torque", "shift", "count", "reference", "zone", "spread"), "0")
#: How a run may start: "held" as the loop has held the arm so far; "exact" at rest with the torque that holds
#: its true load; "wrong-load" with the torque that holds another load of the range, as the controller does.
STARTS = ("wrong-load", "held", "exact")


class Asked(NamedTuple):
    """What a certificate is asked for.

    Attributes:
        robot: the arm without load.
        controller: the GPI controller.
        box: configurations of the reference.
        setting: what the numbers are taken over.
        radius: how far the arm may be from its reference [rad or m], shape (n,).
        delay: delay of the measurements, in samples.
        friction: whether the joints have the friction of the robot.
        jump: whether the load may jump from one end of its range to the other.
        bits: of the encoders; None for exact measurements.
        start: one of :data:`STARTS`.
        others: more arms that are possible, each with the lightest and the heaviest load: each is searched,
            and none may exceed the numbers.
        rule: bandwidths that automatic tuning gives the joints [rad/s], shape (n,); None where it is not
            asked.
    """

    robot: Robot
    controller: GPI
    box: Box
    setting: Setting
    radius: Array
    delay: int
    friction: bool
    jump: bool
    bits: int | None
    start: str
    rule: Array | None = None
    others: tuple[tuple[Robot, ...], ...] = ()

    @property
    def loads(self) -> tuple[float, float]:
        """Return the lightest and the heaviest load [kg]."""
        found = self.controller.payload
        return (0.0, 0.0) if found is None else (found.lightest, found.heaviest)


def ask(
    robot: Robot,
    dt: float,
    *,
    speed: Any,
    payload: Any = None,
    box: Any = None,
    radius: Any = 0.02,
    acceleration: Any = None,
    torque: Any = 0.0,
    friction: bool = False,
    jump: bool = False,
    bits: int | None = None,
    delay: int = 0,
    start: str = STARTS[0],
    controller: str = "gpi",
    arms: Sequence[Robot] = (),
    others: Sequence[Robot] = (),
    **options: Any,
) -> Asked:
    """Return what :func:`armgpi.certify` is asked for, checked; it has the same arguments."""
    if not isinstance(robot, Robot):
        raise ParameterError("robot", robot, "a single Robot")
    check_whole(delay, "delay", 0, 20)
    check_choice(start, "start", STARTS)
    if bits is not None:
        check_whole(bits, "bits", 1, 32)
    controller = _current_type(controller)
    if controller == "gpi":
        law, rule = GPI(robot, dt, delay=delay * dt, payload=payload, **options), None
    else:
        law, rule = _untuned_law(robot, dt, delay * dt, bits, payload, options)
    _check_chosen(law, controller)

    def each(value: Any, name: str, above: bool = False) -> Array:
        array = quantity(value, name, robot.joint_names)
        if not (positive if above else not_negative)(array).all():
            raise ParameterError(name, value, "positive" if above else "zero or positive")
        return array

    if jump and arms:
        raise ParameterError("jump", jump, "False where the arm is not exact")
    loads = law.payload
    own = (robot,) if loads is None else (*_with_loads((robot,), loads)[:1], loads.nominal)
    ends = (*_with_loads(arms, loads), *own)  # the controller's is the last
    where = box_of(robot, box)
    fastest = each(speed, "speed", True)
    away = each(radius, "radius", True)
    # A gradient is taken between configurations that are a few samples of motion apart as well.
    count = 0.0 * fastest if bits is None else 0.5 * robot.encoder_count(bits)
    near = away + (delay + 1) * law.dt * fastest + count
    moves = 0.0 * fastest, 0.0 * fastest
    if acceleration is not None:
        moves = fastest, each(acceleration, "acceleration")
    viscous, rubbing = friction_of(arms or (robot,), friction, moves[0])
    known: Any = law.bias_robot
    inputs = each(torque, "torque"), rubbing, *moves, count, viscous, law.rest_dead_zone
    setting = Setting(ends, ends[-1], known, *where, near, fastest, law.feedforward, *inputs)
    more = tuple(_with_loads((arm,), loads) for arm in others)
    return Asked(robot, law, where, setting, away, delay, friction, jump, bits, start, rule, more)


def _with_loads(arms: Sequence[Robot], loads: Any) -> tuple[Robot, ...]:
    """Return arms with the lightest load of a range, and with the heaviest; as they are without one."""
    if loads is None:
        return tuple(arms)
    loaded = []
    for load in (loads.lightest, loads.heaviest):
        loaded += [arm.with_payload(loads.frame, load, loads.com) for arm in arms]
    return tuple(loaded)


def _current_type(controller: str) -> str:
    """Return the type of a controller that can be certified, by its current name."""
    controller = current_name(controller, renamed.CONTROLLERS, 4)
    check_choice(controller, "controller", ("gpi", "gpi_auto"))
    return controller


def _untuned_law(
    robot: Robot, dt: float, delay: float, bits: int | None, payload: Any, options: dict[str, Any]
) -> tuple[GPI, Array]:
    """Return the controller that the rule makes, its least bandwidth for all joints, and its bandwidths."""
    given = {key: x for key, x in {**options, "payload": payload}.items() if x is not None}
    with warnings.catch_warnings():  # the certificate is of the arm as given, without rotors that are assumed
        warnings.filterwarnings("ignore", message=".*specified to have no rotor")
        law = GPI.auto(robot, dt, delay=delay, bits=bits, drives="none", **given)
    if law.payload is not None and law.payload.lightest > 0.0:
        expected = "a lightest payload of 0: the feedforward of gpi_auto does not contain a payload"
        raise ParameterError("payload", payload, expected)
    rule = law.gains.nominal().omega_c * np.ones(robot.n)
    return law.with_values(gains=FixedGains(float(rule.min()))), rule


def law_of(asked: Asked) -> dict[str, Any]:
    """Return the law, which has to be the same for all joints, with its numbers as texts.

    Raises:
        ParameterError: when tuning or poles differ between the joints, or move.
    """
    controller = asked.controller
    gains: Any = controller.gains
    moves = isinstance(gains, BSplineNetwork) and gains.common
    if not moves and not isinstance(gains, FixedGains):
        expected = "FixedGains, or a BSplineNetwork with one common omega"
        raise ParameterError("gains", type(gains).__name__, expected)
    tuning = gains.nominal()
    omega = _common(tuning.omega_c, "omega")
    zeta = _common(tuning.zeta_c, "zeta")
    p = _common(tuning.p_c, "p")
    second, damping = 1.0, zeta
    if controller.second_ratio is not None:
        second = _common(controller.second_ratio, "second_ratio")
    if controller.second_zeta is not None:
        damping = _common(controller.second_zeta, "second_zeta")
    return {
        "integrators": controller.integrators,
        "rolloff": controller.rolloff,
        "delay": asked.delay,
        "sample_time": repr(float(controller.dt)),
        "omega": [repr(float(x)) for x in gains.bandwidths()] if moves else [repr(omega)],
        "rate": repr(float(gains.rate[0])) if moves else "0",
        "zeta": repr(zeta),
        "pole_ratio": repr(p / omega),
        "rolloff_ratio": repr(_common(controller.rolloff_ratio, "rolloff_ratio")),
        "second_ratio": repr(second),
        "second_zeta": repr(damping),
    }


def member_of(law: Mapping[str, Any]) -> Member:
    """Return which member of the family a law is."""
    ratios = (float(law[name]) for name in ("rolloff_ratio", "second_ratio", "second_zeta"))
    return Member(law["integrators"], law["rolloff"], *ratios)


def numbers_of(asked: Asked, found: Numbers) -> dict[str, Any]:
    """Return the numbers of the arm, and of the torques that it needs, as texts; rounded to be larger."""
    numbers: dict[str, Any] = {"delta_low": _text(found.delta_low.value, up=False)}
    for name in Numbers._fields[1 : Numbers._fields.index("torque")]:
        value = getattr(found, name)
        joints = name in PER_JOINT
        numbers[name] = [_text(each.value) for each in value] if joints else _text(value.value)
    numbers["count_time"] = _text(float(np.max(asked.setting.encoder / asked.setting.speed)))
    if asked.setting.feedforward == "model":  # what it gives to move is torque as well
        push = found.kappa_v.value * found.velocity.value + found.acceleration.value
        both = zip(found.hold, found.reach, strict=True)
        numbers["hold"] = [_text(x.value + y.value * push) for x, y in both]
    return numbers


def shares_of(asked: Asked, found: Numbers) -> dict[str, float]:
    """Return the bounded torques that disturb, in the metric of D, by what they come from."""
    # At worst the model's torque is too much and the arm's too little: it is that of the reference, where D
    # may be another one, and of up to a sample ago, since when the reference may accelerate otherwise.
    grown = found.sigma.value * float(np.max(asked.setting.radius / asked.setting.speed))
    known = math.sqrt(found.delta_high.value * math.exp(grown))
    known = 1.0 + known if asked.setting.feedforward == "model" else 1.0
    return {
        "disturbance": found.torque.value,
        "friction": found.friction.value,
        "velocity of the reference": known * found.kappa_v.value * found.velocity.value,
        "acceleration of the reference": known * found.acceleration.value,
    }


def inputs_of(asked: Asked, found: Numbers) -> dict[str, str]:
    """Return the sizes of all that disturbs, in the metric of D, as texts."""
    torque = sum(shares_of(asked, found).values())
    return {
        "torque": _text(torque),
        "shift": _text(found.shift.value),
        "reference": _text(found.velocity.value),
        "count": _text(found.encoder.value),
        "zone": _text(found.zone.value),
    }


def _check_chosen(law: GPI, controller: str) -> None:
    """Refuse what is not a linear law of the error; of the rule's choice nobody gave the parameters."""
    try:
        _check_linear(law)
    except ParameterError as error:
        if controller == "gpi":
            raise
        own = f"as its {error.name} is {error.value!r}"
        expected = (
            f"gpi: what gpi_auto chooses for this arm has no certificate, {own}; `armgpi bound` bounds it"
        )
        raise ParameterError("controller", controller, expected) from None


def _check_linear(controller: GPI) -> None:
    """Refuse what is not a linear law of the error."""
    one = {"realisation": "bumpless", "friction_feedforward": False, "rotor_factor": 1.0}
    for name, value in one.items():
        if np.any(getattr(controller, name) != value):
            raise ParameterError(
                name, getattr(controller, name), f"{value} where there is to be a certificate"
            )
    if controller.feedforward == "computed":
        expected = "none, gravity or model where there is to be a certificate: it is taken at the reference"
        raise ParameterError("feedforward", controller.feedforward, expected)
    limit: Any = controller.force_limit
    if limit is not None:
        raise ParameterError("force_limit", limit, "none where there is to be a certificate")
    if controller.rest_leak.any():
        raise ParameterError("rest_leak", controller.rest_leak, "0 where there is to be a certificate")


def _common(value: Any, name: str) -> float:
    """Return the one value that all joints have."""
    array = np.unique(np.asarray(value))
    if len(array) > 1:
        raise ParameterError(name, array.tolist(), "the same for all joints: one joint represents the arm")
    return float(array[0])


def _text(value: float, up: bool = True) -> str:
    """Return a number of ten digits that is larger, or smaller, by what rounding takes at most."""
    return f"{value * (1.0 + 1e-9 if up else 1.0 - 1e-9):.12g}"
