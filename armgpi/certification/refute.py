"""A slow check of a certificate's numbers: drawn configurations may refute them, and prove nothing."""

from __future__ import annotations

import math
import warnings
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from armgpi.certification.certificate import Certificate, limits_of, seal
from armgpi.certification.quantities import PER_JOINT, TINY, Progress, functions, points, ranges
from armgpi.certification.request import Asked, ask, law_of
from armgpi.certification.solve import checker
from armgpi.errors import ArmgpiError, ArmgpiWarning, ParameterError
from armgpi.gpi.payload import LoadRange
from armgpi.robot.robot import Robot

#: Configurations that are looked at together, and the share that rounding may add to a value.
_TOGETHER, _ROUNDING = 500, 1e-9
_SHARES = "disturbance", "friction", "velocity of the reference", "acceleration of the reference"
#: Name of a number -> the largest value that is known so far, and the configuration [rad or m].
_Worst = dict[str, tuple[float, list[float]]]


class Refuted(NamedTuple):
    """A number of a certificate that a configuration exceeds.

    Attributes:
        name: of the number; of a joint's own with its place, such as "inverse.2".
        claimed: what the certificate says.
        found: what it is at that configuration at least.
        q: the arm's configuration [rad or m].
    """

    name: str
    claimed: float
    found: float
    q: list[float]


def refute(
    certificate: Certificate,
    robot: Robot,
    count: int = 20_000,
    seed: int = 0,
    progress: Progress = lambda _: None,
) -> list[Refuted]:
    """Return the numbers of a certificate that drawn configurations exceed; none says nothing.

    Args:
        certificate: made or loaded.
        robot: the arm that it is for, without load, with the same rotor inertia, repairs and locks.
        count: of configurations, in portions: each for both ends of the loads and for another one between.
        seed: of the draws.
        progress: called with how far it is.

    Raises:
        ParameterError: when the robot is not the one of the certificate, or no certificate says what it does.

    Warns:
        ArmgpiWarning: when its seal is missing or broken.
    """
    found_seal = certificate.data.get("seal")
    if found_seal != seal(certificate.data):
        seal_is = "a seal that is not that of its content" if found_seal else "no seal"
        text = f"the certificate has {seal_is}: its numbers may not be those that were made"
        warnings.warn(text, ArmgpiWarning, stacklevel=2)
    asked, rng = again(certificate, robot), np.random.default_rng(seed)
    low, width = ranges(asked.setting)
    loads = asked.controller.payload
    worst: _Worst = {}
    portions = -(-count // _TOGETHER)
    for portion in range(portions):
        progress(f"{portion * _TOGETHER} of {count} configurations")
        arms = asked.setting.arms
        if loads is not None:
            range_of_loads = loads.heaviest - loads.lightest
            between = loads.lightest + rng.random() * range_of_loads
            arms = (*arms, robot.with_payload(loads.frame, between, loads.com))
        # An end of the box and of the distance to the reference is as likely as what is between.
        drawn = rng.uniform(-0.3, 1.3, (min(count, _TOGETHER), 3 * robot.n))
        share = np.clip(drawn, 0.0, 1.0)
        _look(asked, arms, low + width * share, worst)
    exceeded = []
    for name, (value, q) in worst.items():
        claimed = _claimed_value(certificate, name)
        if claimed is None:
            continue
        sign = -1.0 if name.startswith("-") else 1.0
        slack = _ROUNDING * abs(claimed) + TINY
        if value > sign * claimed + slack:
            exceeded.append(Refuted(name.lstrip("-"), claimed, sign * value, q))
    return exceeded


def _look(asked: Asked, arms: tuple[Robot, ...], z: Any, worst: _Worst) -> None:
    """Note where the numbers are larger than known so far, at coordinates z of points.

    Raises:
        ParameterError: when one is not finite.
    """
    at = points(asked.setting, z)
    for name, function in functions(asked.setting).items():
        for arm in arms:
            try:
                with np.errstate(all="ignore"):
                    values = function(asked.setting, arm, at)
                i = int(np.argmax(values))
                finite = bool(np.isfinite(values).all())
            except np.linalg.LinAlgError:
                finite = False
            if not finite:
                raise ParameterError("certificate", name, "numbers for which the arm's are finite")
            if name not in worst or values[i] > worst[name][0]:
                where = at.q[i].tolist()
                worst[name] = float(values[i]), where


def again(certificate: Certificate, robot: Robot) -> Asked:
    """Return what a certificate was asked for, from its file, whatever that says.

    Raises:
        ParameterError: when the robot is not the one of the certificate, or no certificate says what it does.
    """
    data = certificate.data
    try:
        checker.facts(data)
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore", ArmgpiWarning)
            asked = _request_of(certificate, robot)
            same_law = law_of(asked) == data["law"]
            same = same_law and limits_of(asked) == data["limits"]
        shares, least = _torques(data)
    except ParameterError as error:
        if error.name.startswith("robot."):
            raise
        raise _unknown(error) from None
    except (*checker.ERRORS, ArmgpiError, MemoryError) as error:
        raise _unknown(error) from None
    if not same:
        raise ParameterError("certificate", "another law, or other limits", "of the ones that this arm gives")
    if shares > least * (1 + Fraction(_ROUNDING)):
        raise ParameterError("inputs.torque", float(least), f"{float(shares):g} at least, all shares")
    return asked


def _torques(data: Any) -> tuple[Fraction, Fraction]:
    """Return all shares of what disturbs together, and the least torque that claims are made for."""
    section = checker.section(data["shares"], "shares", _SHARES)
    shares = Fraction(sum(_share(section, name) for name in _SHARES))
    torques = []
    for inputs in _stated_inputs(data):
        sizes = {key: checker.numbers(inputs[key], f"inputs.{key}") for key in checker.INPUTS}
        torques.append(sizes["torque"])
    return shares, min(torques, default=shares)


def _stated_inputs(data: Any) -> list[Any]:
    """Return what disturbs in each claim but that of a torque alone."""
    return [inputs for claim, inputs in data["inputs"].items() if claim != "gain"]


def _unknown(error: BaseException) -> ParameterError:
    """Return the error for a file that says what no certificate does."""
    said = checker.text(str(error) or type(error).__name__)
    return ParameterError("certificate", said, "what a certificate of this version says")


def _request_of(certificate: Certificate, robot: Robot) -> Asked:
    """Return what a certificate was asked for; any error for what no certificate says."""
    data = certificate.data
    known, law, limits = data["robot"], data["law"], data["limits"]
    same = {
        "joints": list(robot.joint_names),
        "sha256": robot.provenance["sha256"],
        "locked": robot.provenance["locked"],
        "armature": [repr(float(x)) for x in robot.armature],
    }
    for name, value in same.items():
        if known[name] != value:
            raise ParameterError(f"robot.{name}", value, f"{checker.text(known[name])} as in the certificate")
    if float(law["rate"]) > 0.0:  # as many bandwidths as the file has, before they are all made
        first, last = (Fraction(law["omega"][end]) for end in (0, -1))
        step = Fraction(law["rate"]) * Fraction(law["sample_time"])
        if 1 / first - 1 / last > len(law["omega"]) * step:
            raise checker.Refused("omega does not have all that the rate leads to")

    def values(texts: Any) -> Any:
        return np.array([float(x) for x in texts])

    light, heavy = map(float, known["loads"])
    loads = None
    if known["frame"] is not None:
        loads = LoadRange(light, heaviest=heavy, frame=known["frame"], com=known["com"])
    moves = values(limits["velocity"]).any()
    # The feedforward of an automatically tuned law knows of no load.
    bias: dict[str, Any] = {} if known["rule"] is None else {"bias_robot": robot}
    return ask(
        robot,
        float(law["sample_time"]),
        payload=loads,
        box={"lower": values(limits["lower"]), "upper": values(limits["upper"])},
        speed=values(limits["speed"]),
        radius=values(limits["radius"]),
        acceleration=values(limits["acceleration"]) if moves else None,
        torque=values(known["torque"]),
        friction=known["friction"],
        jump=known["jump"],
        bits=known["bits"],
        start=known["start"],
        rest_dead_zone=values(known["dead_zone"]),
        delay=law["delay"],
        gains=certificate.gains,
        feedforward=known["feedforward"],
        integrators=law["integrators"],
        rolloff=law["rolloff"],
        rolloff_ratio=float(law["rolloff_ratio"]),
        second_ratio=float(law["second_ratio"]),
        second_zeta=float(law["second_zeta"]),
        **bias,
    )


def _claimed_value(certificate: Certificate, name: str) -> float | None:
    """Return what a certificate says of a number; None where it says it in another way."""
    name, numbers = name.lstrip("-"), certificate.data["numbers"]
    group, _, joint = name.partition(".")
    if group in PER_JOINT:
        return float(numbers[group][int(joint)])
    if group in numbers:
        return float(numbers[group])
    shares = {
        "torque": "disturbance",
        "friction": "friction",
        "acceleration": "acceleration of the reference",
    }
    if certificate.data["robot"]["feedforward"] == "model":  # its share has the model's as well
        del shares["acceleration"]
    if group in shares:
        return float(_share(certificate.data["shares"], shares[group]))
    sizes = {"velocity": "reference", "shift": "shift", "encoder": "count", "zone": "zone"}
    if group not in sizes:
        return None
    stated = [float(inputs[sizes[group]]) for inputs in _stated_inputs(certificate.data)]
    return min(stated, default=None)


def _share(shares: Any, name: str) -> Fraction:
    """Return a bounded torque of a file, which is a number there."""
    value = shares[name]
    is_number = isinstance(value, float | int) and math.isfinite(value)
    if not is_number or value < 0.0:
        raise checker.Refused(f"shares.{name} has to be a number, zero or positive")
    return Fraction(value)
