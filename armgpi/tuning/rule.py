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
from armgpi.errors import Finding, ParameterError
from armgpi.gpi import advice as of_controllers
from armgpi.gpi.family import PARAMETERS, Member
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
    depends: dict[str, Any] = {"robot": robot, "dt": dt, "delay": delay, "bits": bits, "given": given}
    chosen: dict[str, Any]
    chosen, soft = kept.remember("rule", depends, lambda: _chosen(robot, dt, delay, bits, given))
    found = advice.untuned_arm(robot, chosen, rigid=not soft and "gains" not in given)
    return Choice(chosen, tuple(found))


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
        mark = id(one), _mark(own_bits), tuple((name, _mark(value)) for name, value in own.items())
        if mark not in seen:
            depends = {"robot": one, "dt": dt, "delay": delay, "bits": own_bits, "given": own}
            compute = partial(_chosen, one, dt, delay, own_bits, own)
            chosen, _ = kept.remember("rule", depends, compute, on_disk=False)
            seen[mark] = dict(chosen)
        rows.append(seen[mark])
    return rows


def _mark(value: Any) -> Any:
    """Return what tells a value of an arm of a batch from others; other objects are alike if they are one."""
    if isinstance(value, np.ndarray):
        return "array", value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, LoadRange):
        return "load", *(_mark(each) for each in (value.lightest, value.heaviest, value.frame, value.com))
    if isinstance(value, (tuple, list)):
        return "row", *(_mark(each) for each in value)
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
    stacked: dict[str, Any] = {}
    for name in dict.fromkeys(name for row in rows for name in row):
        each = [row[name] if name in row else _DEFAULTS[name] for row in rows]
        first = each[0]
        if name == "friction_feedforward":
            stacked[name] = all(each)
        elif name == "start":
            stacked[name] = START if START in each else first
        elif isinstance(first, LoadRange):
            heaviest: Any = np.array([[load.heaviest] for load in each])
            stacked[name] = LoadRange(heaviest=heaviest, com=first.com)
        elif any(isinstance(value, np.ndarray) for value in each):
            stacked[name] = np.stack(np.broadcast_arrays(*each))
        elif isinstance(first, float) and len(set(each)) > 1:
            stacked[name] = np.array(each)[:, None]
        else:
            stacked[name] = first
    return stacked


def _without(given: Mapping[str, Any], chosen: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is chosen, without what is given."""
    return {name: value for name, value in chosen.items() if name not in given}


def _chosen(
    robot: Robot, dt: float, delay: float, bits: Any, given: Mapping[str, Any]
) -> tuple[dict[str, Any], bool]:
    """Return what is chosen without what is given, and whether it is for elastic joints."""
    chosen = _rigid(robot, dt, delay, bits, given)
    soft = _twists(robot, dt, delay, {**chosen, **given})
    if soft:
        chosen = _choose_geared(robot, dt, delay, bits, given)
    return _without(given, chosen), soft


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


def _rigid(robot: Robot, dt: float, delay: float, bits: Any, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is chosen for an arm whose gears are rigid."""
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
        omega = np.minimum(omega, loads.choose(robot, dt, delay, member=law).omega_c)
    elif "payload" not in given:
        most = most_delta(law, float(omega[0]) * late(dt, delay))
        chosen["payload"] = loads = _spare(robot, most)
    if bits is not None:
        nominal = robot if loads is None else loads.choose(robot, dt, delay, 1e-9, law).nominal
        omega = omega * np.minimum(1.0, quietness(nominal, dt, law, omega, bits))
    return {**chosen, "omega_c": omega}


def _twists(robot: Robot, dt: float, delay: float, law: Mapping[str, Any]) -> bool:
    """Tell whether gears are known, and too soft for the law of an arm whose gears are rigid."""
    if not geared.is_known(robot) or "omega_c" not in law:
        return geared.is_known(robot)
    own, loads, samples = Member.chosen_by(law), law.get("payload"), samples_late(dt, delay)
    nominal: Any = robot if loads is None else loads.choose(robot, dt, delay, 1e-9, own).nominal
    bias = robot if law["feedforward"] == "computed" else None
    omega = law["omega_c"] * np.ones(robot.n)

    def loops_of(cases: tuple[geared.Case, ...]) -> geared.Loops:
        return geared.Loops(cases, nominal, bias, own, dt)

    # A late loop is sensitive with rigid gears as well.
    rigid = geared.AS_RIGID * loops_of(geared.rigid_cases(robot, dt, samples)).sensitivity(omega)
    most = max(geared.RIGID_SENSITIVITY, rigid)
    return not loops_of(geared.cases(robot, dt, samples)).holds(omega, most)


def samples_late(dt: float, delay: float) -> int:
    """Return by how many samples measurements are late."""
    return math.ceil(round(delay / dt, 6))


def _choose_geared(
    robot: Robot, dt: float, delay: float, bits: Any, given: Mapping[str, Any]
) -> dict[str, Any]:
    """Return what is chosen for an arm with elastic joints."""
    if _collocated_delay(robot, dt, delay) >= collocated.COMPARED:
        return _choose_late(robot, dt, delay, bits, given)
    stiff = _choose_collocated(robot, dt, delay, bits, given)
    if stiff is not None and float(np.min(stiff["omega_c"])) >= FAST_ENOUGH:
        return stiff
    soft = _choose_soft(robot, dt, delay, bits, given)
    if stiff is None:
        return soft
    # Light rotors or encoder counts may leave the stiff one less than the soft one has anyway.
    return min((stiff, soft), key=lambda each: _yielding(robot, dt, delay, each))


def _choose_late(
    robot: Robot, dt: float, delay: float, bits: Any, given: Mapping[str, Any]
) -> dict[str, Any]:
    """Return what is chosen for an arm whose gears twist and whose loop is late.

    That for encoders at the motors is stable at some damping; the other one mostly is not, so it has to yield
    less by more than a little.
    """
    soft = _choose_soft(robot, dt, delay, bits, given)
    most = math.nan  # worked out only where there is something to compare
    for damping in collocated.LATE_DAMPINGS:
        stiff = _choose_collocated(robot, dt, delay, bits, given, damping)
        if stiff is None:
            continue
        if math.isnan(most):
            spare = 1.0 if _is_stable(robot, dt, delay, soft, given) else LATE_YIELDING
            most = spare * _yielding(robot, dt, delay, soft)
        if _yielding(robot, dt, delay, stiff) <= most:
            return stiff
    return soft


def _is_stable(
    robot: Robot, dt: float, delay: float, chosen: Mapping[str, Any], given: Mapping[str, Any]
) -> bool:
    """Tell whether loops of elastic joints are stable at the least usual damping, wherever encoders sit."""
    own, loads = Member.chosen_by(chosen), given.get("payload")
    loaded: Any = robot if loads is None else loads.choose(robot, dt, delay, 1e-9, own).nominal
    nominal: Any = with_heavier_rotors(loaded, chosen.get("rotor_factor", 1.0))
    loops = geared.Loops(geared.cases(robot, dt, samples_late(dt, delay)), nominal, robot, own, dt)
    return loops.holds(chosen["omega_c"])


def _choose_soft(
    robot: Robot, dt: float, delay: float, bits: Any, given: Mapping[str, Any]
) -> dict[str, Any]:
    """Return what is chosen for elastic joints, wherever the encoders sit and however late the loop is."""
    link, believed = geared.at_link(robot), geared.is_assumed(robot)
    chosen = _with_structure(
        ASSUMED_LINK if link and believed else GEARED[link], robot, dt, delay, bits, given
    )
    if link or believed:
        return chosen
    other = _with_structure(GEARED[True], robot, dt, delay, bits, given)
    return other if _allowed_bandwidth(other) > ROLLOFF_GAIN * _allowed_bandwidth(chosen) else chosen


def _collocated_delay(robot: Robot, dt: float, delay: float) -> float:
    """Return the delay of hold, transport and current loop [s]."""
    current = float(np.min(robot.drives.value("current_bandwidth", two_mass.CURRENT_LOOP)))
    return collocated.delay_of(dt, samples_late(dt, delay), current)


def _choose_collocated(
    robot: Robot,
    dt: float,
    delay: float,
    bits: Any,
    given: Mapping[str, Any],
    damping: float = collocated.LATE_DAMPINGS[0],
) -> dict[str, Any] | None:
    """Return what is chosen for elastic joints whose encoders are specified to sit at the motors.

    None where they are not, where the loop is too late, where no bandwidth is stable, or where some of the
    structure is given already.
    """
    at_motor = (robot.drives.value("encoder_side") == "motor").all()
    chosen_here = {*PARAMETERS, "gains", "omega_c", "zeta_c", "rotor_factor", "link_factor", "feedforward"}
    taken = chosen_here & set(given)
    if not at_motor or taken or _collocated_delay(robot, dt, delay) >= collocated.LATE:
        return None
    loads = given.get("payload")
    counts = None if bits is None else robot.encoder_count(checked_bits(bits))
    carried: Any = robot if loads is None else loads.choose(robot, dt, delay, 1e-9).nominal
    effort, late_by = usual_effort(robot), samples_late(dt, delay)
    numbers = collocated.choose(robot, carried, dt, late_by, counts, effort, damping)
    if numbers is None:
        return None
    return {
        "integrators": INTEGRATORS,
        "rolloff": 0,
        "feedforward": "computed",
        "link_factor": numbers.link_factor,
        "rotor_factor": numbers.rotor_factor,
        "friction_feedforward": _knows_friction(robot),
        "rest_dead_zone": numbers.rest_zone,
        "start": START,
        **numbers.poles._asdict(),
    }


def _yielding(robot: Robot, dt: float, delay: float, chosen: Mapping[str, Any]) -> float:
    """Return how far the usual efforts of a rigid arm push its joints aside at most; see :func:`yields`."""
    return float(yields(robot, dt, delay, chosen).max())


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
    own = Member.chosen_by(chosen)
    ones = np.ones(robot.n)
    tuning = Tuning(chosen["omega_c"] * ones, chosen.get("zeta_c", 1.0) * ones, chosen["omega_c"] * ones)
    realisation = Bumpless(own)
    law = two_mass.joint_laws(realisation, realisation.coefficients(tuning, dt), robot.n)
    q = robot.middle()
    model: Any = feedback_model(robot, chosen.get("link_factor", 1.0), chosen.get("rotor_factor", 1.0))
    law = two_mass.around(law, model.mass_matrix(q))
    frequencies = np.geomspace(0.3, 0.5 * math.pi / dt, 120)
    response = two_mass.law_response(law, np.exp(1j * frequencies * dt))
    late = np.exp(-1j * frequencies * _collocated_delay(robot, dt, delay))[:, None, None]
    stiffness = -(frequencies**2)[:, None, None] * robot.mass_matrix(q) - late * response
    alone = np.abs(np.linalg.inv(stiffness)).max(axis=0)
    return np.asarray(np.diag(alone) * usual_effort(robot))


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


def _with_structure(
    structure: Mapping[str, Any],
    robot: Robot,
    dt: float,
    delay: float,
    bits: Any,
    given: Mapping[str, Any],
) -> dict[str, Any]:
    """Return what is chosen for an arm with elastic joints, with some structure of the law."""
    chosen: dict[str, Any] = {
        "integrators": INTEGRATORS,
        **structure,
        "friction_feedforward": _knows_friction(robot),
        "rest_dead_zone": REST_ZONE,
    }
    every = {**chosen, **given}
    law, factor, loads = Member.chosen_by(every), every.get("rotor_factor", 1.0), given.get("payload")
    highest = min(_limits(law, dt, delay))

    loaded: Any = robot if loads is None else loads.choose(robot, dt, delay, 1e-9, law).nominal
    nominal: Any = with_heavier_rotors(loaded, factor)
    bias = robot if every["feedforward"] == "computed" else None
    believed, (usual, light) = geared.is_assumed(robot), geared.DAMPINGS

    def loops_at(damping: float) -> geared.Loops:
        arms = geared.cases(robot, dt, samples_late(dt, delay), damping)
        return geared.Loops(arms, nominal, bias, law, dt)

    loops = loops_at(light)
    alike = geared.bandwidth(loops, highest, believed)
    if believed and alike.omega < geared.LATE:
        loops = loops_at(usual)
        alike = geared.bandwidth(loops, highest, believed)
    least = min(geared.SLOWEST, highest)
    if believed and not geared.at_link(robot) and alike.omega < least:
        omega = least * np.ones(robot.n)  # which not all loops bear: then none is raised (fit arms)
    else:
        omega = geared.raise_joints(alike, loops, highest)
    if bits is not None:
        quiet = omega * np.minimum(1.0, quietness(nominal, dt, law, omega, bits, not law.rolloff))
        omega = np.maximum(quiet, np.minimum(geared.SLOWEST, omega))
    return {**chosen, "omega_c": omega}


def _spare(robot: Robot, most: float) -> LoadRange:
    """Return the nominal load that the loop has delay margin to spare for: empty, delta is `most` at most."""
    return LoadRange(heaviest=float(balanced_load(robot, most)), com=plausible_load(robot).com)


class _Limits(NamedTuple):
    """Bandwidths that are allowed [rad/s]: by the stiffness of the arm, and by the lateness of the loop."""

    stiffness: float
    lateness: float


def _limits(law: Member, dt: float, delay: float) -> _Limits:
    """Return the bandwidths that a member of the family is allowed."""
    dt = check_number(dt, "dt", "a positive sample time [s]", open_=True)
    delay = check_number(delay, "delay", "zero or positive [s]")
    one = np.ones(1)
    crossover = max(float(crossovers(loop).max()) for loop in loops(Tuning(one, one, one), law))
    return _Limits(CROSSOVER / crossover, DELAY_SHARE * tolerated_phase(law) / late(dt, delay))


def quietness(robot: Robot, dt: float, law: Member, omega: Array, bits: Any, direct: bool = False) -> Array:
    """Return by what factor joints must be slower than `omega` to be quiet, (n,).

    The step of the torque grows with the third power of the bandwidth, to within a tenth; where there is no
    roll-off, with the second.
    """
    bits = checked_bits(bits)
    slowest = float(np.min(omega))
    fast = [None if x is None else float(np.max(x)) for x in law.ratios]
    loudest = Member(law.integrators, law.rolloff, fast[0] or 1.0, fast[1], fast[2])
    one = Tuning(*map(np.array, (slowest, 1.0, slowest)))
    power, root = (2, np.sqrt) if direct else (3, np.cbrt)
    step = count_noise(one, dt, loudest).step / math.sqrt(12.0) * (omega / slowest) ** power
    noise = step * robot.encoder_count(bits)
    return np.asarray(root(TORQUE_SHARE * _least_acceleration(robot) / noise))


def usual_effort(robot: Robot) -> Array:
    """Return the effort that an arm is moved with [N m or N], (n,): its limit, or five times its gravity.

    Motors of some arms could lift it many times: it would shake under what is little to them.

    Raises:
        EffortError: when a limit leaves no torque.
    """
    limit = robot.limits.effort
    check_powered(robot, limit)
    gravity = np.abs(robot.gravity(_configurations(robot))).max(axis=0)
    floor = np.maximum(gravity, _LEAST_GRAVITY * gravity.max())
    most = np.where(floor > 0.0, _MOST_EFFORT * floor, math.inf)
    return np.where(np.isfinite(np.minimum(limit, most)), np.minimum(limit, most), 1.0)


def _least_acceleration(robot: Robot) -> Array:
    """Return the least acceleration of each joint that takes a joint's usual effort, (n,)."""
    return np.asarray(1.0 / (most_inertia(robot) / usual_effort(robot)[:, np.newaxis]).max(axis=0))


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
        chosen, findings = apply_rule(context.nominal, context.dt, context.delay, bits, context.given)
        of_controllers.warn(findings, 4)
        if context.rated and context.given.get("realisation") != "paper":
            chosen.setdefault("start", START)
        return {name: value for name, value in chosen.items() if name not in context.given}
