"""A slow check of a certificate's numbers: drawn configurations may refute them, and prove nothing."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from armgpi.certification.asked import Asked, ask
from armgpi.certification.certificate import Certificate
from armgpi.certification.quantities import PER_JOINT, functions, points, ranges
from armgpi.control.payload import LoadRange
from armgpi.errors import ParameterError
from armgpi.robot.robot import Robot

#: Configurations that are looked at together, and the share that rounding may add to a value.
_TOGETHER, _ROUNDING = 500, 1e-9


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


def refute(certificate: Certificate, robot: Robot, count: int = 20_000, seed: int = 0) -> list[Refuted]:
    """Return the numbers of a certificate that drawn configurations exceed; none says nothing.

    Args:
        certificate: made or loaded.
        robot: the arm that it is for, without load, with the same rotor inertia, repairs and locks.
        count: of configurations, for both ends of the loads and their middle.
        seed: of the draws.

    Raises:
        ParameterError: when the robot is not the one of the certificate.
    """
    asked, rng = again(certificate, robot), np.random.default_rng(seed)
    setting, n = asked.setting, robot.n
    low, width = ranges(setting)
    arms, loads = setting.arms, asked.controller.payload
    if loads is not None:
        middle = 0.5 * (loads.lightest + loads.heaviest)
        arms = (*arms, robot.with_payload(loads.frame, middle, loads.com))
    worst: dict[str, tuple[float, list[float]]] = {}
    for _ in range(-(-count // _TOGETHER)):
        # An end of the box and of the distance to the reference is as likely as what is between.
        share = np.clip(rng.uniform(-0.3, 1.3, (_TOGETHER, 3 * n)), 0.0, 1.0)
        at = points(setting, low + width * share)
        for name, function in functions(setting).items():
            for arm in arms:
                values = function(setting, arm, at)
                i = int(np.argmax(values))
                if name not in worst or values[i] > worst[name][0]:
                    worst[name] = float(values[i]), at.q[i].tolist()
    found = []
    for name, (value, q) in worst.items():
        claimed, sign = _claimed(certificate, name), -1.0 if name.startswith("-") else 1.0
        if claimed is not None and value > sign * claimed + _ROUNDING * abs(claimed):
            found.append(Refuted(name.lstrip("-"), claimed, sign * value, q))
    return found


def again(certificate: Certificate, robot: Robot) -> Asked:
    """Return what a certificate was asked for, from its file.

    Raises:
        ParameterError: when the robot is not the one of the certificate.
    """
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
            raise ParameterError(f"robot.{name}", value, f"{known[name]} as in the certificate")

    def values(name: str) -> Any:
        return np.array([float(x) for x in limits[name]])

    light, heavy = (float(x) for x in known["loads"])
    loads = (
        None
        if known["frame"] is None
        else LoadRange(light, heaviest=heavy, frame=known["frame"], com=known["com"])
    )
    ratios: dict[str, Any] = {
        name: float(law[name]) for name in ("rolloff_ratio", "second_ratio", "second_zeta")
    }
    if known["rule"] is not None:  # the feedforward of an untuned law knows of no load
        ratios["bias_robot"] = robot
    return ask(
        robot,
        float(law["sample_time"]),
        payload=loads,
        box={"lower": values("lower"), "upper": values("upper")},
        speed=values("speed"),
        radius=values("radius"),
        acceleration=values("acceleration") if values("velocity").any() else None,
        torque=np.array([float(x) for x in known["torque"]]),
        friction=known["friction"],
        jump=known["jump"],
        bits=known["bits"],
        start=known["start"],
        rest_dead_zone=np.array([float(x) for x in known["dead_zone"]]),
        delay=law["delay"],
        gains=certificate.gains,
        feedforward=known["feedforward"],
        integrators=law["integrators"],
        rolloff=law["rolloff"],
        **ratios,
    )


def _claimed(certificate: Certificate, name: str) -> float | None:
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
        return float(certificate.data["shares"][shares[group]])
    sizes = {"velocity": "reference", "shift": "shift", "encoder": "count", "zone": "zone"}
    stated = certificate.data["inputs"].get("stated")
    return None if stated is None or group not in sizes else float(stated[sizes[group]])
