"""What GPI takes for an arm that nobody tuned: a member of the family and its numbers, by a rule.

The rule looks at what is known before the first run: the nominal model with its efforts, the sample time, the
delay and the encoders. A joint is as fast as the first of three things allows: the crossover frequency beyond
which arms are not stiff, a share of the loop's delay margin, and what encoder counts make of the torque. Its
numbers were chosen on half of the arms of example-robot-data and judged on the others (docs, zoo).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, as_float_array, check_number
from armgpi.base.parameter import with_parameters
from armgpi.control.linear_arm import Law
from armgpi.errors import Finding, ParameterError
from armgpi.gpi import advice as of_controllers
from armgpi.gpi.family import PARAMETERS, PRINTED, Member
from armgpi.gpi.gains import FixedGains, Tuning
from armgpi.gpi.margins import (
    count_noise,
    crossovers,
    loops,
    tolerated_phase,
)
from armgpi.gpi.payload import (
    DELAY_SHARE,
    LoadRange,
    balanced_load,
    late,
    load_range,
    most_delta,
    most_inertia,
    plausible_load,
)
from armgpi.gpi.realisation import Bumpless
from armgpi.registry import Context
from armgpi.robot.batch import (
    AnyRobot,
    RobotBatch,
    check_powered,
    check_robot,
    feedback_model,
    with_heavier_rotors,
)
from armgpi.robot.equations import ASSUMED_BITS
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import assume_drives
from armgpi.tuning import advice, collocated, geared, kept, two_mass

#: The member: one integrator, and one pole of roll-off so many times as fast as the others; faster where
#: lateness limits the loop, which then has no count noise to spare it.
INTEGRATORS, ROLLOFF, RATIO, LATE_RATIO = 1, 1, 4.0, 8.0
#: Where gears twist, all integral action starts from the measured position, and the side of the encoders says
#: what bears the resonance: at the motor rotors three times as heavy as they are and no roll-off, which would
#: make it late; at the link a roll-off. Chosen on Panda and UR5, judged on others (tools/gears.py). As the
#: feedback's inertia is above the arm's, the slow poles of the loop come near the zeros of C(s): two poles of
#: the usual damping of 0.7 bring those forward, and the arm recovers sooner (tools/reality.py, fit arms).
_COMMON: Mapping[str, Any] = {"second_zeta": 0.7, "feedforward": "computed"}
GEARED: Mapping[bool, Mapping[str, Any]] = {
    False: {**_COMMON, "rolloff": 0, "rotor_factor": 3.0},
    True: {**_COMMON, "rolloff": 1, "rolloff_ratio": RATIO},
}
#: The same at the link where the stiffness is believed, so may be low.
ASSUMED_LINK = {**_COMMON, "rolloff": 1, "rolloff_ratio": LATE_RATIO, "rotor_factor": 3.0}
#: How much faster than without a roll-off the law for a link has to be where stiffness is told, to reject as
#: much: by peak errors after a step of torque, at 1 to 4 ms and 1 to 3 samples late.
ROLLOFF_GAIN = 1.6
#: Highest crossover frequency [rad/s]; that of the printed law at 30 rad/s is 56. Arms are not stiff beyond.
CROSSOVER = 70.0
#: Standard deviation of the torque's step between samples at rest, as a share of the effort: Panda with
#: believed rotors and 16 bits stays below the 1 N m per ms that libfranka takes, with a tenth to spare.
TORQUE_SHARE = 0.005
#: Error that is not integrated while the reference rests [rad or m].
REST_ZONE = 3e-4
#: Bandwidth of the slowest joint from which on the controller for encoders at the motors is taken unseen
#: [rad/s]: a slower one yields more than the other may, as on arms whose rotors are light beside the links.
FAST_ENOUGH = 2.0 * geared.SLOWEST
#: How much more than the controller for an unknown side that for encoders at the motors may yield where the
#: loop is late and only the latter is stable at little damping [-]: beyond it arms fall under their loads
#: (tools/first_rule.py, seeds 502 to 504).
LATE_YIELDING = 1.5
#: How a controller for encoders at the motors starts beside its reference, and any where a supervisor limits
#: the rate of the torque: with no kick. Under the 1 N m per ms that libfranka takes, a Panda that starts 30
#: mrad beside it is driven away otherwise (tools/motor_side.py --torque-step).
START = "rest"
#: Resolution of encoders of which nothing is said [bits].
BITS = ASSUMED_BITS
#: Effort in gravity torques beyond which a motor is taken to be stronger than the arm is quiet.
_MOST_EFFORT, _LEAST_GRAVITY = 5.0, 0.03
#: Bandwidth at which the nominal load is asked for alone [rad/s]: so slow that no load is in its way.
_NOMINAL_ALONE = 1e-9
#: Configurations over which inertia and gravity are taken.
_CONFIGURATIONS = 50


def assume(bits: Any) -> Any:
    """Return the resolution of encoders [bits], :data:`BITS` where nothing is said of them."""
    return BITS if bits is None else bits


class Choice(NamedTuple):
    """What the rule chose.

    Attributes:
        values: parameters of :class:`armgpi.GPI` and `omega_c` [rad/s], name -> value.
        findings: what there is to say of them, for the caller to show.
    """

    values: dict[str, Any]
    findings: tuple[Finding, ...] = ()


def apply_rule(
    robot: AnyRobot,
    dt: float,
    delay: float = 0.0,
    bits: Any = None,
    given: Mapping[str, Any] | None = None,
) -> Choice:
    """Return parameters of :class:`armgpi.GPI` and `omega_c` [rad/s] for an arm that nobody tuned.

    Args:
        robot: nominal model; friction that it was given, besides the URDF's, is fed forward.
        dt: sample time [s].
        delay: transport delay in the loop [s].
        bits: resolution of the encoders [bits], a number or an array that broadcasts against (n,); None for
            exact positions.
        given: parameters that are chosen already; the others suit them.

    Returns:
        Them without those given, `omega_c` of shape (n,) or (batch, n), and what is found of them.

    Raises:
        EffortError: when an effort limit leaves a joint no torque, and there are encoders.
        ParameterError: when a number is out of its range, or arms of a batch would have controllers of
            different structures.
        PayloadError: when no bandwidth serves the loads given.
    """
    given = given or {}
    if isinstance(robot, RobotBatch):
        return _of_batch(robot, dt, delay, bits, given)
    asked = _Asked(robot, dt, delay, bits, given)
    chosen: dict[str, Any]
    chosen, soft = kept.remember("rule", asked._asdict(), partial(_chosen, asked))
    is_rigid = not soft and "gains" not in given
    findings = advice.untuned_arm(robot, chosen, rigid=is_rigid)
    return Choice(chosen, tuple(findings))


class _Asked(NamedTuple):
    """One arm that a controller is chosen for, and what is known of its loop; see :func:`apply_rule`.

    Attributes:
        robot: nominal model.
        dt: sample time [s].
        delay: transport delay [s].
        bits: resolution of the encoders [bits]; None for exact positions.
        given: parameters that are chosen already.
    """

    robot: Robot
    dt: float
    delay: float
    bits: Any
    given: Mapping[str, Any]

    @property
    def late(self) -> int:
        """Samples by which measurements are late."""
        return samples_late(self.dt, self.delay)

    @property
    def counts(self) -> Array | None:
        """One count of each encoder, at the joint [rad or m], (n,); None for exact positions."""
        return None if self.bits is None else self.robot.encoder_count(checked_bits(self.bits))

    def carrying(self, loads: Any, member: Member = PRINTED) -> Robot:
        """Return the arm with the load in the nominal model of the feedback; as it is for None."""
        if loads is None:
            return self.robot
        nominal: Robot = loads.choose(self.robot, self.dt, self.delay, _NOMINAL_ALONE, member).nominal
        return nominal


class Structure(NamedTuple):
    """What of a controller the arms of a batch have in common.

    Attributes:
        integrators: number of integrators.
        rolloff: number of roll-off poles.
        rolloff_ratio: those poles over the bandwidth [-].
        feedforward: what is fed forward.
        link_factor: factor of the links' inertia in the feedback [-].
        rotor_factor: factor of the rotors' inertia in the feedback [-].
        start: how it starts.
        loaded: whether the feedback's nominal model carries a load.
    """

    integrators: int = 2
    rolloff: int = 0
    rolloff_ratio: float = RATIO
    feedforward: str = "none"
    link_factor: float = 1.0
    rotor_factor: float = 1.0
    start: str = "hold"
    loaded: bool = False

    @property
    def equations(self) -> Structure:
        """What arms of a batch must have in common: all but the numbers that each may have of its own."""
        ratio = self.rolloff_ratio if self.rolloff else RATIO
        return self._replace(link_factor=1.0, rotor_factor=1.0, start="hold", rolloff_ratio=ratio)

    def describe(self) -> str:
        """Return in words what kind of controller it is."""
        if self.link_factor != 1.0:
            return "for encoders at the motors"
        if self.feedforward == "computed":
            return "for encoders at the links" if self.rolloff else "for elastic joints"
        return "for stiff joints and a nominal load" if self.loaded else "for stiff joints"


def structures(
    robot: AnyRobot,
    dt: float,
    delay: float = 0.0,
    bits: Any = None,
    given: Mapping[str, Any] | None = None,
) -> tuple[Structure, ...]:
    """Return the structure of the controller that each arm has alone; arguments as :func:`apply_rule`.

    A batch has one structure, but for the inertia in the feedback, of which each arm has its own: arms whose
    :attr:`Structure.equations` differ belong into batches of their own, and :func:`apply_rule` refuses them.
    """
    robots = robot.robots if isinstance(robot, RobotBatch) else (robot,)
    return tuple(_structure(each) for each in _each_alone(robots, dt, delay, bits, given or {}))


def _structure(chosen: Mapping[str, Any]) -> Structure:
    """Return the structure among the numbers that were chosen."""
    named = {name: chosen[name] for name in Structure._fields if name in chosen}
    return Structure(**named, loaded="payload" in chosen)


def _of_batch(robot: RobotBatch, dt: float, delay: float, bits: Any, given: Mapping[str, Any]) -> Choice:
    """Return what is chosen for a batch: of each arm what it has alone.

    Raises:
        ParameterError: when the arms would have controllers of different structures.
    """
    rows = _each_alone(robot.robots, dt, delay, bits, given)
    found = [_structure(row) for row in rows]
    if len({each.equations for each in found}) > 1:
        raise ParameterError("robot", robot, advice.unlike_arms([each.describe() for each in found]))
    return Choice(_stacked(rows))


def _each_alone(
    robots: Sequence[Robot], dt: float, delay: float, bits: Any, given: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """Return what is chosen for each arm of a batch alone, once for the same arm with the same encoders.

    What is kept of arms by their digest does not suffice: gains have none.
    """
    seen: dict[Any, dict[str, Any]] = {}
    rows = []
    for one, own_bits, own in _rows(robots, bits, given):
        asked = _Asked(one, dt, delay, own_bits, own)
        given_marks = [(name, _mark(value)) for name, value in own.items()]
        mark = id(one), _mark(own_bits), tuple(given_marks)
        if mark not in seen:
            chosen, _ = kept.remember("rule", asked._asdict(), partial(_chosen, asked), on_disk=False)
            seen[mark] = dict(chosen)
        rows.append(seen[mark])
    return rows


def _mark(value: Any) -> Any:
    """Return a hashable key: arms of a batch whose values have equal keys get the same choice.

    Arrays, load ranges, sequences and plain values are compared by what they hold. Any other object is equal
    to itself alone: its key is its identity, so it has to exist as long as the key is compared.
    """
    if isinstance(value, np.ndarray):
        return "array", value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, LoadRange):
        parts = (value.lightest, value.heaviest, value.frame, value.com)
        return "load", *map(_mark, parts)
    if isinstance(value, (tuple, list)):
        return "row", *map(_mark, value)
    if value is None or isinstance(value, (bool, int, float, str)):
        return type(value).__name__, repr(value)
    return "object", id(value)


def _rows(
    robots: Sequence[Robot], bits: Any, given: Mapping[str, Any]
) -> Iterator[tuple[Robot, Any, dict[str, Any]]]:
    """Yield each arm of a batch with its encoders and what is given of it."""
    count = len(robots)
    fine = None if bits is None else np.broadcast_to(checked_bits(bits), (count, robots[0].n))
    for k, one in enumerate(robots):
        own = {name: _row(value, k, count) for name, value in given.items()}
        yield one, None if fine is None else fine[k], own


def _row(value: Any, k: int, count: int) -> Any:
    """Return what one arm of a batch has of a value."""
    if isinstance(value, LoadRange):
        heaviest = float(np.broadcast_to(np.ravel(value.heaviest), count)[k])
        return LoadRange(lightest=value.lightest, heaviest=heaviest, frame=value.frame, com=value.com)
    if isinstance(value, np.ndarray) and value.ndim == 2 and len(value) == count:
        return value[k]
    return value


#: What a controller has where a rule chose nothing; of an arm in a batch with others it has to be said.
_DEFAULTS: Mapping[str, Any] = {
    "second_ratio": 1.0,
    "zeta_c": 1.0,
    "link_factor": 1.0,
    "rotor_factor": 1.0,
    "start": "hold",
}


def _stacked(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return what was chosen for arms of one structure, as a batch has it."""
    names: dict[str, None] = {}  # in the order in which arms have them
    for row in rows:
        names.update(dict.fromkeys(row))
    stacked: dict[str, Any] = {}
    for name in names:
        values = [row[name] if name in row else _DEFAULTS[name] for row in rows]
        stacked[name] = _stacked_value(name, values)
    return stacked


def _stacked_value(name: str, values: Sequence[Any]) -> Any:
    """Return what a batch has of a parameter, from what its arms have."""
    first = values[0]
    if name == "friction_feedforward":
        return all(values)
    if name == "start":
        return START if START in values else first
    if isinstance(first, LoadRange):
        heaviest: Any = np.array([[load.heaviest] for load in values])
        return LoadRange(heaviest=heaviest, com=first.com)
    if any(isinstance(value, np.ndarray) for value in values):
        return np.stack(np.broadcast_arrays(*values))
    if isinstance(first, float) and len(set(values)) > 1:
        return np.array(values)[:, None]
    return first


def _without(given: Mapping[str, Any], chosen: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is chosen, without what is given."""
    return {name: value for name, value in chosen.items() if name not in given}


def _chosen(asked: _Asked) -> tuple[dict[str, Any], bool]:
    """Return what is chosen for one arm, without what is given, and whether it is for elastic joints."""
    chosen = _rigid(asked)
    soft = _twists(asked, {**chosen, **asked.given})
    if soft:  # a choice of its own: nothing of the rigid one is kept
        chosen = _choose_geared(asked)
    return _without(asked.given, chosen), soft


def arguments(
    robot: AnyRobot, dt: float, delay: float, bits: Any, drives: str | None, given: Mapping[str, Any]
) -> Choice:
    """Return what the constructor of :class:`armgpi.GPI` takes for an arm that nobody tuned.

    Args:
        robot: nominal model.
        dt: sample time [s].
        delay: transport delay in the loop [s].
        bits: resolution of the encoders; see :func:`apply_rule`.
        drives: what is assumed of drives without data; see :func:`armgpi.assume_drives`. Of the arms of a
            batch nothing is assumed, so it must be None there.
        given: arguments that are not to be chosen.

    Raises:
        ParameterError: as :func:`apply_rule`, and for `drives` of a batch.
    """
    check_robot(robot)
    if isinstance(robot, Robot):
        robot = assume_drives(robot, drives)
    elif drives is not None:
        expected = "None for a batch: give each arm its drives by armgpi.assume_drives, then make the batch"
        raise ParameterError("drives", drives, expected)
    given = {name: value for name, value in given.items() if name != "gains" or value is not None}
    loads = given.get("payload")
    if loads is not None and not isinstance(loads, LoadRange):
        given["payload"] = load_range(loads, given.pop("frame", None), given.pop("com", (0.0, 0.0, 0.0)))
    chosen, findings = apply_rule(robot, dt, delay, bits, given)
    if "payload" in chosen:  # which the feedforward knows nothing of
        chosen["bias_robot"] = robot
    gains = FixedGains(chosen.pop("omega_c"), chosen.pop("zeta_c", 1.0))
    own = {"robot": robot, "dt": dt, "delay": delay, "gains": gains}
    return Choice({**own, **chosen, **given}, findings)


def _rigid(asked: _Asked) -> dict[str, Any]:
    """Return what is chosen for an arm whose gears are rigid."""
    robot, dt, delay, bits, given = asked
    chosen: dict[str, Any] = {
        "integrators": INTEGRATORS,
        "rolloff": ROLLOFF,
        "rolloff_ratio": RATIO,
        "feedforward": "model",
        "friction_feedforward": _knows_friction(robot),
        "rest_dead_zone": REST_ZONE,
    }
    law = Member.chosen_by({**chosen, **given})
    limits = _limits(law, dt, delay)
    if limits.lateness < limits.stiffness:
        chosen["rolloff_ratio"] = LATE_RATIO
        law = Member.chosen_by({**chosen, **given})
        limits = _limits(law, dt, delay)
    omega: Array = min(limits) * np.ones(robot.n)
    loads = given.get("payload")
    if isinstance(loads, LoadRange):
        allowed = loads.choose(robot, dt, delay, member=law).omega_c
        omega = np.minimum(omega, allowed)
    elif "payload" not in given:
        most = most_delta(law, float(omega[0]) * late(dt, delay))
        chosen["payload"] = loads = _spare(robot, most)
    if bits is not None:
        quiet = quietness(asked.carrying(loads, law), dt, law, omega, bits)
        omega = omega * np.minimum(1.0, quiet)
    return {**chosen, "omega_c": omega}


def _twists(asked: _Asked, law: Mapping[str, Any]) -> bool:
    """Tell whether gears are known, and too soft for the law of an arm whose gears are rigid."""
    robot, dt = asked.robot, asked.dt
    is_known = geared.is_known(robot)
    if not is_known or "omega_c" not in law:
        return is_known
    member = Member.chosen_by(law)
    nominal: Any = asked.carrying(law.get("payload"), member)
    bias = robot if law["feedforward"] == "computed" else None
    omega = law["omega_c"] * np.ones(robot.n)

    def loops_of(cases: tuple[geared.Case, ...]) -> geared.Loops:
        return geared.Loops(cases, nominal, bias, member, dt)

    # A late loop is sensitive with rigid gears as well.
    rigid = loops_of(geared.rigid_cases(robot, dt, asked.late))
    most = max(geared.RIGID_SENSITIVITY, geared.AS_RIGID * rigid.sensitivity(omega))
    elastic = loops_of(geared.cases(robot, dt, asked.late))
    return not elastic.holds(omega, most)


def samples_late(dt: float, delay: float) -> int:
    """Return by how many samples measurements are late."""
    return math.ceil(round(delay / dt, 6))


def _choose_geared(asked: _Asked) -> dict[str, Any]:
    """Return what is chosen for an arm with elastic joints."""
    if _collocated_delay(asked.robot, asked.dt, asked.delay) >= collocated.COMPARED:
        return _choose_late(asked)
    stiff = _choose_collocated(asked)
    if stiff is not None and _allowed_bandwidth(stiff) >= FAST_ENOUGH:
        return stiff
    soft = _choose_soft(asked)
    if stiff is None:
        return soft
    # Light rotors or encoder counts may leave the stiff one less than the soft one has anyway.
    return min((stiff, soft), key=lambda chosen: _yielding(asked, chosen))


def _choose_late(asked: _Asked) -> dict[str, Any]:
    """Return what is chosen for an arm whose gears twist and whose loop is late.

    That for encoders at the motors is stable at some damping; the other one mostly is not, so it has to yield
    less by more than a little.
    """
    soft = _choose_soft(asked)
    most = math.nan  # worked out only where there is something to compare
    for damping in collocated.LATE_DAMPINGS:
        stiff = _choose_collocated(asked, damping)
        if stiff is None:
            continue
        if math.isnan(most):
            spare = 1.0 if _is_stable(asked, soft) else LATE_YIELDING
            most = spare * _yielding(asked, soft)
        if _yielding(asked, stiff) <= most:
            return stiff
    return soft


def _is_stable(asked: _Asked, chosen: Mapping[str, Any]) -> bool:
    """Tell whether loops of elastic joints are stable at the least usual damping, wherever encoders sit."""
    robot, dt = asked.robot, asked.dt
    member = Member.chosen_by(chosen)
    loaded = asked.carrying(asked.given.get("payload"), member)
    nominal: Any = with_heavier_rotors(loaded, chosen.get("rotor_factor", 1.0))
    cases = geared.cases(robot, dt, asked.late)
    return geared.Loops(cases, nominal, robot, member, dt).holds(chosen["omega_c"])


def _choose_soft(asked: _Asked) -> dict[str, Any]:
    """Return what is chosen for elastic joints, wherever the encoders sit and however late the loop is."""
    at_link = geared.at_link(asked.robot)
    is_assumed = geared.is_assumed(asked.robot)
    structure = ASSUMED_LINK if at_link and is_assumed else GEARED[at_link]
    chosen = _with_structure(structure, asked)
    if at_link or is_assumed:
        return chosen
    other = _with_structure(GEARED[True], asked)
    is_much_faster = _allowed_bandwidth(other) > ROLLOFF_GAIN * _allowed_bandwidth(chosen)
    return other if is_much_faster else chosen


def _collocated_delay(robot: Robot, dt: float, delay: float) -> float:
    """Return the delay of hold, transport and current loop [s]."""
    bandwidths = robot.drives.value("current_bandwidth", two_mass.CURRENT_LOOP)
    slowest = float(np.min(bandwidths))
    return collocated.delay_of(dt, samples_late(dt, delay), slowest)


def _choose_collocated(asked: _Asked, damping: float = collocated.LATE_DAMPINGS[0]) -> dict[str, Any] | None:
    """Return what is chosen for elastic joints whose encoders are specified to sit at the motors.

    None where they are not, where the loop is too late, where no bandwidth is stable, or where some of the
    structure is given already.
    """
    robot, dt, delay, _, given = asked
    at_motor = (robot.drives.value("encoder_side") == "motor").all()
    chosen_here = {*PARAMETERS, "gains", "omega_c", "zeta_c", "rotor_factor", "link_factor", "feedforward"}
    is_free = chosen_here.isdisjoint(given)
    if not at_motor or not is_free or _collocated_delay(robot, dt, delay) >= collocated.LATE:
        return None
    counts = asked.counts
    carried = asked.carrying(given.get("payload"))
    numbers = collocated.choose(robot, carried, dt, asked.late, counts, usual_effort(robot), damping)
    if numbers is None:
        return None
    return _at_motor(numbers, _knows_friction(robot))


def _at_motor(numbers: collocated.Collocated, friction_feedforward: bool) -> dict[str, Any]:
    """Return the parameters of a controller for encoders at the motors."""
    return {
        "integrators": INTEGRATORS,
        "rolloff": 0,
        "feedforward": "computed",
        "link_factor": numbers.link_factor,
        "rotor_factor": numbers.rotor_factor,
        "friction_feedforward": friction_feedforward,
        "rest_dead_zone": numbers.rest_zone,
        "start": START,
        **numbers.poles._asdict(),
    }


def _yielding(asked: _Asked, chosen: Mapping[str, Any]) -> float:
    """Return how far the usual efforts of a rigid arm push its joints aside at most; see :func:`yields`."""
    return float(yields(asked.robot, asked.dt, asked.delay, chosen).max())


def yields(robot: Robot, dt: float, delay: float, chosen: Mapping[str, Any]) -> Array:
    """Return how far its usual effort pushes each joint of a rigid arm aside [rad or m], (n,).

    Each joint is pushed alone, about the middle, and at the frequency at which it yields most; with it two
    controllers are compared.

    Args:
        robot: the arm as it is known.
        dt: sample time [s].
        delay: transport delay [s].
        chosen: parameters of a controller as :func:`apply_rule` returns them.
    """
    law = _rigid_law(robot, dt, chosen)
    frequencies = np.geomspace(0.3, 0.5 * math.pi / dt, 120)
    response = two_mass.law_response(law, np.exp(1j * frequencies * dt))
    lag = np.exp(-1j * frequencies * _collocated_delay(robot, dt, delay))
    inertia = robot.mass_matrix(robot.middle())
    acceleration = -(frequencies**2)[:, None, None] * inertia
    stiffness = acceleration - lag[:, None, None] * response
    largest = np.abs(np.linalg.inv(stiffness)).max(axis=0)
    return np.asarray(np.diag(largest) * usual_effort(robot))


def _rigid_law(robot: Robot, dt: float, chosen: Mapping[str, Any]) -> Law:
    """Return a controller that was chosen, linear about the middle, without its feedforward."""
    ones = np.ones(robot.n)
    omega = chosen["omega_c"] * ones
    zeta = chosen.get("zeta_c", 1.0) * ones
    realisation = Bumpless(Member.chosen_by(chosen))
    coefficients = realisation.coefficients(Tuning(omega, zeta, omega), dt)
    law = two_mass.joint_laws(realisation, coefficients, robot.n)
    factors = chosen.get("link_factor", 1.0), chosen.get("rotor_factor", 1.0)
    model: Any = feedback_model(robot, *factors)
    return two_mass.around(law, model.mass_matrix(robot.middle()))


def checked_bits(bits: Any) -> Array:
    """Return the resolution of encoders [bits].

    Raises:
        ParameterError: for what no encoder has.
    """
    checked = as_float_array(bits, "bits")
    if not ((checked >= 1.0) & (checked <= 52.0)).all():
        raise ParameterError("bits", bits, "1 to 52 bits")
    return checked


def _allowed_bandwidth(chosen: Mapping[str, Any]) -> float:
    """Return the bandwidth of the slowest joint [rad/s]."""
    return float(np.min(chosen["omega_c"]))


def _with_structure(structure: Mapping[str, Any], asked: _Asked) -> dict[str, Any]:
    """Return what is chosen for an arm with elastic joints, with some structure of the law.

    All joints are first as fast as each other as the loops tolerate, then each is raised on its own, and last
    slowed to where its encoder's counts are quiet.
    """
    robot, dt, delay, bits, given = asked
    chosen: dict[str, Any] = {
        "integrators": INTEGRATORS,
        **structure,
        "friction_feedforward": _knows_friction(robot),
        "rest_dead_zone": REST_ZONE,
    }
    every = {**chosen, **given}
    law = Member.chosen_by(every)
    highest = min(_limits(law, dt, delay))
    loaded = asked.carrying(given.get("payload"), law)
    nominal: Any = with_heavier_rotors(loaded, every.get("rotor_factor", 1.0))
    bias = robot if every["feedforward"] == "computed" else None
    is_assumed = geared.is_assumed(robot)

    def loops_at(damping: float) -> geared.Loops:
        arms = geared.cases(robot, dt, asked.late, damping)
        return geared.Loops(arms, nominal, bias, law, dt)

    usual_damping, least_damping = geared.DAMPINGS
    loops = loops_at(least_damping)
    alike = geared.bandwidth(loops, highest, is_assumed)
    if is_assumed and alike.omega < geared.LATE:
        loops = loops_at(usual_damping)
        alike = geared.bandwidth(loops, highest, is_assumed)
    slowest = min(geared.SLOWEST, highest)
    if is_assumed and not geared.at_link(robot) and alike.omega < slowest:
        omega = slowest * np.ones(robot.n)  # which not all loops bear: then none is raised (fit arms)
    else:
        omega = geared.raise_joints(alike, loops, highest)
    if bits is not None:
        noise = quietness(nominal, dt, law, omega, bits, direct=not law.rolloff)
        quiet = omega * np.minimum(1.0, noise)
        omega = np.maximum(quiet, np.minimum(geared.SLOWEST, omega))
    return {**chosen, "omega_c": omega}


def _spare(robot: Robot, most: float) -> LoadRange:
    """Return the nominal load that the loop has delay margin to spare for: empty, delta is `most` at most."""
    heaviest = float(balanced_load(robot, most))
    return LoadRange(heaviest=heaviest, com=plausible_load(robot).com)


class _Limits(NamedTuple):
    """Bandwidths that are allowed [rad/s]: by the stiffness of the arm, and by the lateness of the loop."""

    stiffness: float
    lateness: float


def _limits(law: Member, dt: float, delay: float) -> _Limits:
    """Return the bandwidths that a member of the family is allowed."""
    dt = check_number(dt, "dt", "a positive sample time [s]", open_=True)
    delay = check_number(delay, "delay", "zero or positive [s]")
    crossover = highest_crossover(law)
    tolerated = DELAY_SHARE * tolerated_phase(law)
    return _Limits(stiffness=CROSSOVER / crossover, lateness=tolerated / late(dt, delay))


def highest_crossover(law: Member) -> float:
    """Return the highest crossover frequency of a member of the family over its bandwidth [-]."""
    unit = np.ones(1)
    of_loops = [crossovers(loop).max() for loop in loops(Tuning(unit, unit, unit), law)]
    return float(max(of_loops))


def quietness(robot: Robot, dt: float, law: Member, omega: Array, bits: Any, direct: bool = False) -> Array:
    """Return by what factor joints must be slower than `omega` to be quiet, (n,).

    The step of the torque grows with the third power of the bandwidth, to within a tenth; where there is no
    roll-off, with the second.
    """
    bits = checked_bits(bits)
    slowest = float(np.min(omega))
    # The fastest poles of any joint are the loudest.
    fastest = [None if ratio is None else float(np.max(ratio)) for ratio in law.ratios]
    rolloff_ratio = fastest[0] or 1.0
    loudest = Member(law.integrators, law.rolloff, rolloff_ratio, fastest[1], fastest[2])
    one = Tuning(np.array(slowest), np.array(1.0), np.array(slowest))
    power, root = (2, np.sqrt) if direct else (3, np.cbrt)
    step = count_noise(one, dt, loudest).step / math.sqrt(12.0)
    faster = (omega / slowest) ** power
    noise = step * faster * robot.encoder_count(bits)
    return np.asarray(root(TORQUE_SHARE * _least_acceleration(robot) / noise))


def usual_effort(robot: Robot) -> Array:
    """Return the effort that an arm is moved with [N m or N], (n,): its limit, or five times its gravity.

    Motors of some arms could lift it many times: it would shake under what is little to them.

    Raises:
        EffortError: when a limit leaves no torque.
    """
    limit = robot.limits.effort
    check_powered(robot, limit)
    gravity = np.abs(robot.gravity(_configurations(robot)))
    gravity = gravity.max(axis=0)
    floor = np.maximum(gravity, _LEAST_GRAVITY * gravity.max())
    most = np.where(floor > 0.0, _MOST_EFFORT * floor, math.inf)
    usual = np.minimum(limit, most)
    return np.where(np.isfinite(usual), usual, 1.0)


def _least_acceleration(robot: Robot) -> Array:
    """Return the least acceleration of each joint that takes a joint's usual effort, (n,)."""
    torques = most_inertia(robot) / usual_effort(robot)[:, np.newaxis]
    return np.asarray(1.0 / torques.max(axis=0))


def _configurations(robot: Robot) -> Array:
    return random_configurations(robot, _CONFIGURATIONS, seed=0)


def _knows_friction(robot: Robot) -> bool:
    """Tell whether friction was given: what URDFs state is not measured."""
    return any("friction" in change for change in robot.provenance["changes"])


@with_parameters
class Untuned(FixedGains):
    """Fixed gains that an experiment takes from the rule, as it does the member and the feedforward.

    Where an experiment says nothing of the encoders they are assumed to have :data:`BITS` bits: no arm has
    exact ones, and what is simulated is what is exported.
    """

    config_name: ClassVar[str | None] = "gpi_auto"

    @classmethod
    def chosen(cls, context: Context) -> dict[str, Any]:
        """Return what the rule says for an experiment; see :meth:`Gains.chosen`."""
        bits = assume(context.bits)
        loop = (context.nominal, context.dt, context.delay)
        chosen, findings = apply_rule(*loop, bits, context.given)
        of_controllers.warn(findings, 4)
        if context.rated and context.given.get("realisation") != "paper":
            chosen.setdefault("start", START)
        return _without(context.given, chosen)
