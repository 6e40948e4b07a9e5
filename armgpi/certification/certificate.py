"""A bound on the whole arm's error: from a robot, loads, a box, speeds and a controller to a certificate.

The mathematics is in docs/certify.md. The numbers of the arm are searched, the matrix inequality that they
lead to is solved, and what is said is what the checker finds in exact arithmetic
(:mod:`armgpi.certification.check_certificate`).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from fractions import Fraction
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np

from armgpi.base import files
from armgpi.base.arrays import Array, check_choice, check_number, check_path, check_type
from armgpi.base.escape import html_text
from armgpi.base.hints import check_keywords
from armgpi.base.parameter import parameters
from armgpi.base.version import other_format
from armgpi.certification import check_certificate
from armgpi.certification.diagnosis import beyond, explain_unsolved
from armgpi.certification.proofs import prove_numbers
from armgpi.certification.quantities import PER_JOINT, Numbers, Progress, count_outside, search_numbers
from armgpi.certification.request import NOTHING, Asked, ask, inputs_of, law_of, numbers_of, shares_of
from armgpi.certification.solve import Solution, merge_facts, solvable, solve
from armgpi.certification.text import table
from armgpi.errors import ConfigError, ParameterError
from armgpi.gpi.gains import FixedGains
from armgpi.gpi.law import GPI
from armgpi.gpi.network import BSplineNetwork
from armgpi.robot.robot import Robot

checker: Any = check_certificate  # generic over number types, so without annotations

FORMAT = check_certificate.FORMAT
#: By how much claims are rounded up, so that they are short.
_ROUNDED = 1e-6
#: Speed of the error for which a torque's claim is made where it moves nothing, as in a gantry, whose D(q) is
#: constant; and the share of it that other claims try first.
_FREE, _FIRST = 1e3, 0.02
#: Rates [1/s per unit of the error's speed] that are rounding.
_NO_MOTION = 1e-6
#: Rates at which a common omega may move that are tried.
_RATES = tuple(0.12 * 0.8**k for k in range(12))
#: How often a larger speed of the error is tried, and by how much larger than the bound before.
_TRIES, _LARGER = 6, 1.2


class Certificate:
    """A certificate, or why there is none.

    Attributes:
        data: the certificate file as plain data.
        reasons: what limits the certificate and what to change, a sentence each; empty for a certificate.
    """

    def __init__(self, data: Mapping[str, Any], reasons: tuple[str, ...] = ()) -> None:
        """Take a certificate's data, and why it claims less than was asked for."""
        self.data = dict(data)
        self.reasons = reasons

    def _repr_html_(self) -> str:
        return f"<pre>{html_text(str(self))}</pre>"

    @property
    def certified(self) -> bool:
        """Whether everything that was asked for is certified."""
        return not self.reasons

    @property
    def numbers_proved(self) -> bool:
        """Whether it claims all that was asked for, and depends on proved numbers alone."""
        return self.certified and set(self.data["status"].values()) == {"proved"}

    @property
    def joint_names(self) -> list[str]:
        """Names of the joints."""
        return list(self.data["robot"]["joints"])

    @property
    def per_torque(self) -> Array:
        """Error over the size of a torque on the same joint, for the reference at rest [rad/(N m)], (n,)."""
        inverse = [float(text) for text in self.data["numbers"]["inverse"]]
        gain = self.data["inputs"].get("gain", {})
        size = float(gain.get("torque", "nan"))
        return self._claims("gain", "errors") * np.sqrt(inverse) / size

    @property
    def error(self) -> Array:
        """Error under everything that was stated [rad or m], shape (n,)."""
        return self._claims("stated", "errors")

    @property
    def from_start(self) -> Array:
        """Error from a start with the torque that holds another load of the range [rad or m], shape (n,)."""
        return self._claims("start", "errors")

    @property
    def after_jump(self) -> Array:
        """Error after the load has jumped between its ends [rad or m], shape (n,)."""
        return self._claims("jump", "errors")

    @property
    def torque(self) -> Array:
        """Largest torque that the controller requests [N m or N], shape (n,)."""
        return self._claims("stated", "torques")

    @property
    def gains(self) -> FixedGains | BSplineNetwork:
        """The gains it is for: what a controller is made with."""
        law = self.data["law"]
        omega = [float(Fraction(text)) for text in law["omega"]]
        zeta = float(Fraction(law["zeta"]))
        if len(omega) == 1:
            pole = omega[0] * float(Fraction(law["pole_ratio"]))
            return FixedGains(omega[0], zeta, pole)
        ends = (omega[0], omega[-1])
        rate = float(Fraction(law["rate"]))
        return BSplineNetwork(omega_c=ends, zeta_c=zeta, common=True, rate=rate)

    @property
    def decay(self) -> float:
        """Rate at which the effect of a past disturbance decays [1/s]."""
        omega = float(Fraction(self.data["law"]["omega"][0]))
        return 0.5 * float(self.data["solutions"]["gain"]["alpha"]) * omega

    def _claims(self, solution: str, what: str) -> Array:
        """Return claims of a solution; NaN where there is none."""
        claims = self.data["solutions"].get(solution, {}).get("claims")
        if claims is None:
            return np.full(len(self.joint_names), np.nan)
        return np.array([float(text) for text in claims[what]])

    @property
    def text(self) -> str:
        """The certificate file, which is all that the checker needs."""
        return json.dumps(self.data, indent=1) + "\n"

    def __str__(self) -> str:
        """Return what is certified as a table, and what is not."""
        return "\n".join(table(self))

    def check(self) -> list[str]:
        """Return what the exact checker finds wrong; nothing for a certificate that holds."""
        return list(checker.check(self.data))

    def save(self, path: Any) -> Path:
        """Write the certificate file to a path, as JSON.

        Args:
            path: file to write.

        Returns:
            The path of the file.

        Raises:
            RolloutError: when it cannot be written.
        """
        where: Path = check_path(path, "path")
        files.write(where, self.text)
        return where

    @staticmethod
    def load(path: Any) -> Certificate:
        """Return the certificate of the file at a path.

        Args:
            path: a file that :meth:`save` wrote.

        Raises:
            ConfigError: when it is not one.
        """
        path = check_path(path, "path")
        try:
            data = checker.read(path)
            known = data.get("format")
        except checker.ERRORS as error:
            said = checker.text(files.reason(error))[1:-1]
            raise ConfigError(path, "", f"is not a certificate: {said}") from None
        if known != FORMAT:
            raise ConfigError(path, "", other_format(known, FORMAT))
        return Certificate(data)


#: Keywords that a certificate passes on: to :func:`ask`, and to the controller. What of it has no certificate
#: is refused by its name.
_OPTIONS = (
    *[each.name for each in signature(ask).parameters.values() if each.kind == each.KEYWORD_ONLY],
    *parameters(GPI),
)


def certify(
    robot: Robot,
    dt: float = 1e-3,
    *,
    prove: bool = False,
    budget: float = 30.0,
    rate: str | None = None,
    progress: Progress = lambda _: None,
    **options: Any,
) -> Certificate:
    """Return a certificate for a GPI controller on an arm, or why there is none.

    Args:
        robot: the arm without load, with the rotor inertia that it has.
        dt: sample time [s].
        prove: whether to prove the numbers of the arm, as tight as `budget` allows.
        budget: processor time for each number [s].
        rate: "auto" for the largest rate found at which a common omega may move, for `gains` that are a
            ``BSplineNetwork(common=True, rate=...)``; None for the one they have.
        progress: called with what is being done, in words.
        **options: of `armgpi.certification.request.ask`: `speed` (of each joint at most [rad/s or m/s]),
            `payload` (lightest and heaviest load [kg]), `box` (see `armgpi.certification.box.box_of`),
            `radius` (how far the arm may be from its reference [rad or m]), `acceleration` (of a reference
            that moves), `torque` (of disturbances [N m or N]), `friction` (whether that of the robot acts),
            `jump` (whether the load may jump between its ends), `bits` of the encoders, `delay` [samples],
            `arms` (such that the true one is in their hull; the controller's `robot` is in it) and `others`
            (more that are possible: each is searched, and none may exceed the numbers),
            and what :class:`armgpi.GPI` takes: `gains`, `integrators`, `rolloff`, `rolloff_ratio`,
            `second_ratio`, `second_zeta`, `feedforward`.

    Raises:
        ParameterError: for what no certificate is known for, or a value that is out of its range.
        PayloadError: when no bandwidth serves the loads.
        MissingPackage: when Clarabel is not installed.
    """
    check_keywords("certify", options, _OPTIONS)
    if "speed" not in options:
        raise TypeError("certify() requires speed=, the largest speed of the reference [rad/s or m/s]")
    check_type(robot, "robot", Robot, "a Robot")
    check_type(prove, "prove", bool, "True or False")
    dt = check_number(dt, "dt", "a positive time [s]", open_=True)
    budget = check_number(budget, "budget", "a positive time [s]", open_=True)
    if rate is not None:
        check_choice(rate, "rate", ("auto",))
    asked = ask(robot, dt, **options)
    law_of(asked)  # before what takes long
    if prove:
        if len(asked.others):
            raise ParameterError("prove", prove, "False where the arm is not exact: arms are drawn")
        numbers = prove_numbers(asked.setting, budget=budget, progress=progress)
    else:
        numbers = search_numbers(asked.setting, progress=progress)
    progress("solving")
    if rate is None:
        return certificate(asked, numbers, progress)
    network = asked.controller.gains
    if not (isinstance(network, BSplineNetwork) and network.common):
        raise ParameterError("rate", rate, "None for gains other than a BSplineNetwork with a common omega")
    for tried in _RATES:
        asked = ask(robot, dt, **{**options, "gains": network.with_values(rate=tried)})
        known = _Known(asked, numbers)
        if not solvable(known.law, known.numbers, known.one):
            continue
        made = certificate(asked._replace(others=()), numbers)
        if made.certified:
            return certificate(asked, numbers, progress) if asked.others else made
    return certificate(asked, numbers, progress)


def certificate(asked: Asked, found: Numbers, progress: Progress = lambda _: None) -> Certificate:
    """Return the certificate that the numbers of an arm lead to, or why there is none.

    Args:
        asked: what is asked for.
        found: the numbers.
        progress: called with what is being done, in words.
    """
    known = _Known(asked, found)
    stated = inputs_of(asked, found)
    known.gain()
    if known.solutions:
        loads_differ = bool(float(known.numbers["jump"]))
        if any(float(size) for size in stated.values()):
            known.close("stated", "the stated disturbances", stated)
        if loads_differ and asked.start == "wrong-load":
            known.close("start", "a start with the torque for another payload", stated)
        if loads_differ and asked.jump:
            known.close("jump", "a jump of the payload", stated)
        known.hold_against_others(found, progress)
    held = asked if known.solutions else asked._replace(others=())
    data: dict[str, Any] = {
        "format": FORMAT,
        "robot": _robot(held),
        "assumptions": _assumptions(held),
        "limits": known.limits,
        "law": known.law,
        "numbers": known.numbers,
        "status": status_of(found),
        "inputs": known.inputs,
        "shares": shares_of(asked, found),
        "solutions": known.solutions,
    }
    data["seal"] = seal(data)
    return Certificate(data, tuple(known.said))


def status_of(found: Numbers) -> dict[str, str]:
    """Return of each number whether it is proved; of those for each joint, whether all are."""
    statuses = {}
    for name, value in found._asdict().items():
        numbers = value if name in PER_JOINT else (value,)
        all_proved = all(number.status == "proved" for number in numbers)
        statuses[name] = "proved" if all_proved else "searched"
    return statuses


class _Known:
    """What claims are made of, and those that were made.

    Attributes:
        inputs: what disturbs, for each claim.
        solutions: of the inequality, with what each bounds.
        said: what keeps other claims from being made.
        one: a torque of length 1, as what disturbs.
    """

    def __init__(self, asked: Asked, found: Numbers) -> None:
        self.asked = asked
        self.law = law_of(asked)
        self.numbers = numbers = numbers_of(asked, found)
        self.limits = limits_of(asked)
        self.inputs: dict[str, Any] = {}
        self.solutions: dict[str, Any] = {}
        self.said: list[str] = []
        # So slow that D and Coriolis torques are moved no more than by joints at the speed that was stated.
        self.spread = _FREE
        for moves, per_speed in (("sigma", "sigma_error"), ("kappa_v", "kappa_error")):
            if float(numbers[per_speed]) > _NO_MOTION:
                share = float(numbers[moves]) / float(numbers[per_speed])
                self.spread = min(self.spread, share)
        self.one = {**NOTHING, "torque": "1", "spread": f"{self.spread:.9g}"}

    def gain(self) -> None:
        """Claim what a torque arbitrary in time does, up to the largest at which the claim is closed."""
        inputs = self.one
        # Where omega moves the exact check takes long.
        hopeless = len(self.law["omega"]) > 1 and not solvable(self.law, self.numbers, inputs)
        solution = None if hopeless else solve(self.law, self.numbers, inputs)
        if solution is None:
            self.said += explain_unsolved(self.asked, self.law, self.numbers, inputs)
            return
        rest = self.bounds(solution, {**inputs, "torque": "0"})
        unit = self.bounds(solution, {**inputs, "torque": "1"})
        spare = []  # sizes of a torque at which a bound is all that is allowed
        for what, allowed in self.allowed_ranges(inputs).items():
            for without, with_one, most in zip(rest[what], unit[what], allowed, strict=True):
                spare.append((most - without) / (with_one - without))
        largest = float(min(spare)) * (1.0 - _ROUNDED)
        if largest <= 0.0:
            self.said += beyond(self.asked, None, self.spread, rest)
            return
        self._claim("gain", solution, {**inputs, "torque": f"{largest:.9g}"})

    def close(self, name: str, what: str, stated: Mapping[str, str]) -> None:
        """Make a claim that implies what it depends on: the error is no faster than was taken for granted."""
        spread = _FIRST * self.spread
        bounds = None
        disturbed = any(float(size) for key, size in stated.items() if key != "spread")
        for _ in range(_TRIES):
            inputs = {**stated, "spread": f"{spread:.9g}"}
            solved_for = inputs if disturbed else {**inputs, "torque": "1"}
            solution = solve(self.law, self.numbers, solved_for)
            if solution is None:
                break
            bounds = self.bounds(solution, inputs, name)
            fastest = float(bounds["speed"][0])
            if fastest <= spread:
                break
            spread = _LARGER * fastest
        if bounds is None or solution is None or self.leaves(inputs, bounds):
            self.said += beyond(self.asked, what, None if solution is None else spread, bounds)
        else:
            self._claim(name, solution, inputs)

    def hold_against_others(self, found: Numbers, progress: Progress) -> None:
        """Take every claim back where another possible arm exceeds the numbers.

        Args:
            found: the numbers.
            progress: called with what is being done.
        """
        others = self.asked.others
        setting, friction = self.asked.setting, self.asked.friction
        outside = count_outside(setting, found, others, friction, progress=progress)
        if not outside:
            return
        self.solutions.clear()
        self.inputs.clear()
        self.said.append(
            f"{outside} of {len(others)} other possible arms exceed its numbers: identify the arm with a "
            "longer log."
        )

    def bounds(self, solution: Solution, inputs: Any, claim: str = "") -> Any:
        """Return what a solution bounds."""
        facts = merge_facts(self.limits, self.law, self.numbers, inputs)
        return checker.bounds(facts, checker.exact(solution._asdict()), claim)

    def allowed_ranges(self, inputs: Any) -> dict[str, Any]:
        """Return what bounds must stay within: what the numbers were taken over, and what the motors give."""
        limits = checker.exact(self.limits)
        return {
            "errors": limits["radius"],
            "speed": [Fraction(inputs["spread"])],
            "torques": limits["effort"],
        }

    def leaves(self, inputs: Any, found: Any) -> bool:
        """Tell whether any bound is not within what is allowed."""
        for what, allowed in self.allowed_ranges(inputs).items():
            if any(bound > most for bound, most in zip(found[what], allowed, strict=True)):
                return True
        return False

    def _claim(self, name: str, solution: Solution, inputs: Any) -> None:
        """Add a claim."""
        claims = {}
        for what, bounds in self.bounds(solution, inputs, name).items():
            claims[what] = [f"{float(bound) * (1.0 + _ROUNDED):.9g}" for bound in bounds]
        self.inputs[name] = inputs
        self.solutions[name] = {**solution._asdict(), "claims": claims}


def seal(data: Mapping[str, Any]) -> str:
    """Return the hash of what the solution does not say: see the checker."""
    sealed = {key: part for key, part in data.items() if key not in ("solutions", "seal")}
    text = json.dumps(sealed, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _robot(asked: Asked) -> dict[str, Any]:
    """Return which arm it is."""
    robot = asked.robot
    return {
        "name": robot.name,
        "joints": list(robot.joint_names),
        "prismatic": robot.prismatic.tolist(),
        **{key: robot.provenance[key] for key in ("source", "sha256", "locked", "changes")},
        "armature": [repr(float(x)) for x in robot.armature],
        "loads": [repr(x) for x in asked.loads],
        "frame": None if asked.controller.payload is None else asked.controller.payload.frame,
        "com": None if asked.controller.payload is None else list(asked.controller.payload.com),
        "feedforward": asked.setting.feedforward,
        "torque": [repr(float(x)) for x in asked.setting.torque],
        "friction": asked.friction,
        "jump": asked.jump,
        "bits": asked.bits,
        "start": asked.start,
        "rule": None if asked.rule is None else [repr(float(x)) for x in asked.rule],
        "dead_zone": [repr(float(x)) for x in asked.setting.zone],
        "searched": len(asked.others),
    }


def limits_of(asked: Asked) -> dict[str, list[str]]:
    """Return what the claims have to stay within, and how fast the reference is."""
    values = {
        "effort": np.minimum(asked.robot.limits.effort, 1e300),
        "lower": asked.box.lower,
        "upper": asked.box.upper,
        "radius": asked.radius,
        "speed": asked.setting.speed,
        "velocity": asked.setting.velocity,
        "acceleration": asked.setting.acceleration,
    }
    return {name: [repr(float(x)) for x in each] for name, each in values.items()}


def _assumptions(asked: Asked) -> list[str]:
    """Return what the claims rest on, in words."""
    ahead = {
        "none": "no feedforward",
        "gravity": "gravity as feedforward",
        "model": "its model as feedforward",
    }
    moves = "its gains do not change"
    if not isinstance(asked.controller.gains, FixedGains):
        moves = "all joints have one omega of the list given here, which goes one step in a sample at most"
    arm = "The arm is the rigid body model of the URDF with the rotor inertia given here, and a point mass "
    if asked.others:
        arm = (
            f"The arm is in the hull of arms that are possible: a search of each of {len(asked.others)} more "
            "found none that exceeds the numbers. It has a point mass "
        )
    return [
        f"{arm}between the loads given; its joints follow the torque at once and exactly.",
        f"The controller is GPI with the law given here and {ahead[asked.setting.feedforward]}; its model "
        f"has the heaviest load, {moves}, and its arithmetic is exact.",
        "The reference stays in the box, within its speed and acceleration. That the arm stays within radius "
        "of it, that the error is no faster than spread and that no torque is cut follows from the claims.",
        "The claim gain is for a reference at rest. It and the claim stated hold from a start at rest with "
        "the torque that holds the arm, or as soon as V is at most what the inputs keep it at, the last "
        "samples within the claim, and for ever after; the claim start holds from a start with the torque of "
        "another load of the range. Starts are at rest, where the reference rests.",
        "The claim for a jump holds at any time after one jump between the two loads that happens while V is "
        "at most what the inputs keep it at; a load that is picked up has the velocity of the frame that "
        "picks it up.",
        "Numbers that are estimated numerically are the largest that a search found, and 3 % more: no proof.",
    ]
