"""What a controller tolerates on an arm, and what limits its bandwidth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.gpi.family import PARAMETERS
from armgpi.gpi.margins import delay_margins
from armgpi.gpi.payload import DELAY_SHARE, late
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import assume_gears
from armgpi.tuning import collocated, geared, kept, two_mass
from armgpi.tuning.rule import (
    CROSSOVER,
    checked_bits,
    highest_crossover,
    quietness,
    samples_late,
    usual_effort,
    yields,
)

#: Share of a limit from which on it is reached: numbers are found to within some percent.
_REACHED = 0.95
#: Damping ratios of the joints that are tried where loops are not stable at the least usual one [-].
_TRIED_DAMPINGS = (0.015, 0.02, 0.03, 0.05, 0.1)
#: What may limit the bandwidth of a joint, in words.
LIMITS: Mapping[str, str] = {
    "gears": "joint elasticity",
    "noise": "encoder counts",
    "delay": "delay",
    "rotors": "rotors that are light compared with the links",
    "load": "the range of payloads",
    "crossover": "the highest bandwidth of automatic tuning",
}
#: Share of the usual effort that the controller does not know: friction of geared joints, 5 to 15 %.
UNKNOWN_SHARE = 0.1
#: What :class:`Accuracy` is limited by, in the order of its attributes.
_CAUSES = (
    "disturbance of a tenth of the usual effort, such as friction that the model lacks",
    "deflection under gravity that motor encoders do not measure",
    "errors that are not integrated at rest",
)
_GRAVITY_CONFIGURATIONS = 50
#: Values of the peak sensitivity that controllers usually have (Astrom and Murray, Feedback Systems, 2008).
USUAL_SENSITIVITY = "usual: 1.2 to 2"


class Verdict(NamedTuple):
    """What an automatic controller tolerates, and why it is no faster.

    Attributes:
        limits: joint by joint what limits the bandwidth, a key of :data:`LIMITS`.
        sensitivity: largest peak Ms over configurations and what is known of the gears; infinite where a loop
            is unstable.
        spare: delay margin, beyond the delay that there is [s].
        resonance: lowest one of joints as known or assumed, in the middle [Hz]; NaN for rigid ones.
        borne: of rigid ones, the lowest that the law would tolerate with Ms of at most 3 [Hz]; else NaN.
        usual: of rigid ones, the lowest that gears of such motors have [Hz]; else NaN.
        loops: how many of the loops that are looked at are unstable, and how many there are.
        damping: where some are, the least damping ratio of the joints with which none is [-], of
            :data:`_TRIED_DAMPINGS`; infinite where there is none, NaN where the damping is known.
    """

    limits: tuple[str, ...]
    sensitivity: float
    spare: float
    resonance: float
    borne: float
    usual: float
    loops: tuple[int, int] = (0, 0)
    damping: float = math.nan

    def describe(self) -> str:
        """Return it in a line."""
        names = dict.fromkeys(sorted(self.limits, key=self.limits.count)[::-1])
        said = "limited by " + " and ".join(LIMITS[name] for name in names)
        if math.isfinite(self.sensitivity):
            said += (
                f"; Ms {self.sensitivity:.2f} ({USUAL_SENSITIVITY}), delay margin {1e3 * self.spare:.3g} ms"
            )
        else:
            said += self._unstable()
        if math.isfinite(self.resonance):
            said += f", lowest resonance {self.resonance:.3g} Hz"
        if math.isfinite(self.borne) and self.borne > self.usual:
            said += (
                f"; stiff joints are assumed: a resonance below {self.borne:.3g} Hz may be unstable, "
                f"and such motors have some {self.usual:.2g} Hz: --drives elastic, or specify stiffness by "
                "--drives FILE"
            )
        return said

    def _unstable(self) -> str:
        """Return in words which loops are unstable, and with which damping of elastic joints none is."""
        unstable, count = self.loops
        loops = f"{unstable} of {count} loops are unstable"
        if not math.isfinite(self.resonance):
            return f"; not stable even with stiff joints ({loops}: lower the bandwidth, or sample faster)"
        said = "; not stable over the whole range of the joint stiffness"
        if not unstable:
            return said
        if math.isnan(self.damping):
            return f"{said} with the damping that is known ({loops}: lower the bandwidth, or sample faster)"
        said += f" ({loops}"
        if math.isfinite(self.damping):
            said += f"; none with a damping ratio of the joints of {100.0 * self.damping:.2g} % or more"
        else:
            said += f", some also with a damping ratio of the joints of {100.0 * _TRIED_DAMPINGS[-1]:.2g} %"
        return f"{said}; usual are 1 to 5 %: sample faster, or specify stiffness and damping)"

    def explain(self, joint_names: Sequence[str]) -> str:
        """Return in a line what limits each joint.

        Args:
            joint_names: of the arm.
        """
        rows: dict[str, list[str]] = {}
        for joint, limit in zip(joint_names, self.limits, strict=True):
            rows.setdefault(limit, []).append(joint)
        said = (f"{LIMITS[limit]} ({', '.join(joints)})" for limit, joints in rows.items())
        return "limits by joint: " + ", ".join(said)


class Accuracy(NamedTuple):
    """By how much joints are off, by cause, each (n,) [rad or m]: the largest one limits ITAE and error.

    Attributes:
        yielding: to a tenth of the usual effort that the controller does not know, at the frequency at which
            the joint yields most; friction, unknown loads and wrong models are such.
        deflection: of elastic joints under gravity, the largest one over configurations, which encoders at
            the motors do not measure; zero where encoders sit at the links, or joints are stiff.
        resting: error that is not integrated while the reference rests.
    """

    yielding: Array
    deflection: Array
    resting: Array

    def explain(self, joint_names: Sequence[str], prismatic: Sequence[bool]) -> str:
        """Return in a line what limits the accuracy of each joint, and to how much.

        Args:
            joint_names: of the arm.
            prismatic: which of the joints are.
        """
        largest = np.argmax(self, axis=0)
        causes = []
        for k, cause in enumerate(_CAUSES):
            errors = []
            for j, name in enumerate(joint_names):
                if largest[j] == k:
                    unit = "mm" if prismatic[j] else "mrad"
                    errors.append(f"{name} {_two_digits(1e3 * float(self[k][j]))} {unit}")
            if errors:
                causes.append(f"{', '.join(errors)} ({cause})")
        return "largest error by joint: " + "; ".join(causes)


def _two_digits(number: float) -> str:
    """Return a number with two digits, 120 and not 1.2e+02."""
    return f"{float(f'{number:.2g}'):.15g}"


def accuracy(law: Any, robot: Robot) -> Accuracy:
    """Return by how much joints are off under a controller made by the rule, by cause.

    Args:
        law: a GPI with fixed gains, for one arm.
        robot: the arm as it is known.
    """
    tuning = law.gains.nominal()
    chosen = {"omega_c": tuning.omega_c, "zeta_c": tuning.zeta_c}
    for name in (*PARAMETERS, "link_factor", "rotor_factor"):
        value = getattr(law, name)
        if value is not None:
            chosen[name] = value
    yielding = UNKNOWN_SHARE * yields(robot, law.dt, law.delay, chosen)
    deflection = np.zeros(robot.n)
    if geared.is_known(robot):
        stiffness = assume_gears(robot).drives.value("stiffness")
        places = random_configurations(robot, _GRAVITY_CONFIGURATIONS, seed=0)
        gravity = np.abs(robot.gravity(places)).max(axis=0)
        at_link = robot.drives.value("encoder_side") == "link"
        is_measured = at_link | np.isnan(stiffness)
        deflection = np.where(is_measured, 0.0, gravity / stiffness)
    resting = np.ravel(law.rest_dead_zone) * np.ones(robot.n)
    return Accuracy(yielding, np.asarray(deflection), resting)


def describe_bandwidths(law: Any) -> str:
    """Return the least and the largest bandwidth of a law [rad/s], or one number where they are equal.

    Args:
        law: a GPI with fixed gains, for one arm.
    """
    omega = np.ravel(law.gains.nominal().omega_c).tolist()
    least, most = f"{min(omega):.3g}", f"{max(omega):.3g}"
    return f"{least} rad/s" if least == most else f"{least} to {most} rad/s"


def verdict(law: Any, robot: Robot, bits: Any = None) -> Verdict:
    """Return what a controller tolerates on an arm.

    Args:
        law: a GPI with fixed gains, for one arm.
        robot: the arm as it is known.
        bits: resolution of the encoders [bits], a number or (n,); None for exact positions.
    """
    depends = {
        "robot": robot,
        "bits": bits,
        "models": [law.robot, law.bias_robot],
        "loop": [law.dt, law.delay, law.feedforward, law.link_factor, law.rotor_factor],
        "tuning": law.gains.nominal(),
        "member": [law.member.integrators, law.member.rolloff, *law.member.ratios],
        "payload": None if law.payload is None else [law.payload.nominal, law.payload.delta],
    }
    plain = kept.remember("verdict", depends, lambda: list(_verdict(law, robot, bits)))
    remembered = Verdict(*plain)
    unstable, count = remembered.loops
    # What is kept has lists for tuples.
    return remembered._replace(limits=tuple(remembered.limits), loops=(unstable, count))


def why_sensitive(robot: Robot, judged: Verdict) -> str:
    """Return in a line over what a large Ms is the largest one, where stiffness is assumed; else nothing.

    Args:
        robot: the arm as the controller knows it, with its stiffness.
        judged: what the controller tolerates on it.
    """
    is_large = math.isfinite(judged.sensitivity) and judged.sensitivity > geared.SENSITIVITIES[0]
    if not geared.is_assumed(robot) or not is_large:
        return ""
    over = "the assumed range of the joint stiffness"
    if geared.at_link(robot) and judged.resonance > geared.SOFTEST:
        over += f", which for encoders at the links goes down to a first mode of {geared.SOFTEST:g} Hz"
    return (
        f"Ms and delay margin are the worst ones over {over}; automatic tuning keeps these loops stable, "
        "but does not bound their Ms. Where the stiffness is measured (armgpi excite --resonance, or "
        f"--drives FILE), it keeps Ms below {geared.SENSITIVITIES[0]:g} if it can"
    )


def _verdict(law: Any, robot: Robot, bits: Any) -> Verdict:
    """Work out what :func:`verdict` returns."""
    soft = geared.is_known(robot)
    late = samples_late(law.dt, law.delay)
    find = geared.cases if soft else geared.rigid_cases
    cases = find(robot, law.dt, late)
    laws = [two_mass.law(law, case.q) for case in cases]
    unstable = 0
    for case, at_place in zip(cases, laws, strict=True):
        if not case.arm.growth(at_place) < 1.0:  # nor is NaN stable
            unstable += 1
    sensitivity, spare, damping = math.inf, 0.0, math.nan
    if not unstable:
        judged = [(case.arm, at_place) for case, at_place in zip(cases, laws, strict=True) if case.judged]
        sensitivity = max(arm.sensitivity(at_place) for arm, at_place in judged)
        spare = min(arm.delay_margin(at_place) for arm, at_place in judged)
    elif soft and not math.isnan(cases[0].damping):
        damping = _least_damping(law, robot, late)
    resonance, borne, usual = (math.nan,) * 3
    if soft:
        resonance = geared.resonance(robot)
    elif robot.armature.any():
        borne, usual = geared.borne(law, robot, late)
    limits = _limits_of(law, robot, soft, bits)
    return Verdict(limits, sensitivity, spare, resonance, borne, usual, (unstable, len(cases)), damping)


def _least_damping(law: Any, robot: Robot, late: int) -> float:
    """Return the least damping ratio of the joints at which all loops are stable [-]; infinite for none."""
    for ratio in _TRIED_DAMPINGS:
        cases = [case for case in geared.cases(robot, law.dt, late, ratio) if case.damping == ratio]
        growths = (case.arm.growth(two_mass.law(law, case.q)) for case in cases)
        if all(growth < 1.0 for growth in growths):
            return ratio
    return math.inf


def _limits_of(law: Any, robot: Robot, soft: bool, bits: Any) -> tuple[str, ...]:
    """Return joint by joint what limits the bandwidth of a law, as the rule that made it says."""
    # Other factors a user has set by hand, and the limits of the rule do not explain them.
    is_by_rule = collocated.has_feedback(law.link_factor, law.rotor_factor)
    if is_by_rule and isinstance(law.robot, Robot):
        limits = _limits_at_motor(law, robot, bits)
        if limits:
            return limits
    return _what_limits(law, soft, bits)


def _limits_at_motor(law: Any, robot: Robot, bits: Any) -> tuple[str, ...]:
    """Return joint by joint what limits a law for encoders at the motors; nothing where the rule has none.

    A late loop may have to be stable at one damping or another: it is that with which the rule has the law.
    """
    counts = None if bits is None else robot.encoder_count(checked_bits(bits))
    late_by = samples_late(law.dt, law.delay)
    carried = robot if law.payload is None else law.payload.nominal
    effort = usual_effort(robot)
    omega = law.gains.nominal().omega_c
    last = collocated.LATE_DAMPINGS[-1]
    for damping in collocated.LATE_DAMPINGS:
        numbers = collocated.choose(robot, carried, law.dt, late_by, counts, effort, damping)
        if numbers is None:
            continue
        if damping == last or np.allclose(numbers.poles.omega_c, omega):
            return numbers.limits
    return ()


def _what_limits(law: Any, soft: bool, bits: Any) -> tuple[str, ...]:
    """Return joint by joint what limits the bandwidth of a law: of what it takes the largest share."""
    tuning = law.gains.nominal()
    member = law.member
    ones = np.ones(law.robot.n)
    omega = tuning.omega_c * ones
    heaviest = 1.0 if law.payload is None else law.payload.delta[1]
    allowed_delay = DELAY_SHARE * (delay_margins(tuning, member) * ones)
    allowed_delay_loaded = DELAY_SHARE * delay_margins(tuning, member, heaviest) * ones
    lateness = late(law.dt, law.delay)
    noise = 0.0 * omega
    if bits is not None:
        with np.errstate(
            divide="ignore"
        ):  # where one count costs all of the torque, noise limits without end
            noise = 1.0 / quietness(law.robot, law.dt, member, omega, bits, direct=not member.rolloff)
    shares = {
        "crossover": omega * highest_crossover(member) / CROSSOVER,
        "delay": lateness / allowed_delay,
        "load": lateness / allowed_delay_loaded,
        "noise": noise,
    }
    names = list(shares)
    rows = np.stack(list(shares.values()))
    largest = rows.argmax(axis=0)
    limits = []
    for cause, share in zip(largest, rows.max(axis=0), strict=True):
        is_reached = share >= _REACHED
        limits.append(names[cause] if is_reached or not soft else "gears")
    return tuple(limits)
