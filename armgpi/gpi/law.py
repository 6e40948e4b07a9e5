"""The output-feedback GPI controller (eqs. 12-25): torque from measured positions alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from importlib import import_module
from inspect import signature
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, ArrayLike, as_float_array, new
from armgpi.base.hints import check_keywords
from armgpi.base.parameter import PerJoint, Vector, parameter, plain, same, with_parameters
from armgpi.base.renamed import warn_renamed
from armgpi.control.controller import Controller, ControlStep, Measurement
from armgpi.control.force_limit import FREE_FALL, SPEED, ForceBound, ForceLimit, Gentle, check_weight
from armgpi.control.force_limited import ForceSettings
from armgpi.errors import ParameterError
from armgpi.gpi import advice
from armgpi.gpi.family import Member
from armgpi.gpi.gains import FixedGains, Gains
from armgpi.gpi.margins import Margins, default_omega, worst_margins
from armgpi.gpi.payload import LoadRange, load_range, most_inertia, served_omega
from armgpi.gpi.realisation import REALISATIONS, Bumpless, Resting
from armgpi.references.reference import Target
from armgpi.registry import Context
from armgpi.robot.batch import AnyRobot, check_robot, check_same_joints, feedback_model, one_of
from armgpi.robot.equations import ASSUMED_BITS, add_smooth_friction
from armgpi.robot.robot import Robot

#: Speed below which the sign of the reference velocity is smoothed [rad/s or m/s].
_SMOOTH = 1e-2
#: Feedforward -> what it needs of the nominal model.
KNOWS = {"none": "inertia", "gravity": "gravity", "model": "model", "computed": "model"}


class GPIState(NamedTuple):
    """State of a GPI controller.

    Attributes:
        law: state of the realisation.
        gains: state of the gains.
        learn: 1 where the last torque was applied as asked, 0 where it was cut; shape as the errors.
        limit: state of the force limit; None without one.
    """

    law: Any
    gains: Any
    learn: Array
    limit: Any = None


@with_parameters
class GPI(Controller):
    """Generalised proportional-integral control, tau = D(q) v with v = -C(s) (q - q*).

    It needs positions, the inertia matrix D(q) and nothing else: gravity, Coriolis torque, friction and
    loads are the disturbance that its two integrators reject (constant and ramp without error). Other
    members of the family (:mod:`armgpi.gpi.family`) have more or fewer integrators, and a roll-off.
    Feedforward of the nominal model along the reference can be added:
    ``tau = D(q) v + feedforward(q*, v*, a*)``. ``GPI(robot, dt)`` is the controller as printed;
    for automatic tuning there is :meth:`auto`.

    Attributes:
        robot: nominal model; only D(q) is used, G(q) once to start, and what `feedforward` takes. With
            `payload`, the one with the heaviest load.
        gains: the tuning per joint; ``FixedGains(default_omega(dt, delay))`` when not given.
        realisation: "bumpless" (three bounded states) or "paper" (as printed).
        start: "hold" starts with the torque that holds the arm (brakes released under torque), "rest" also
            takes an arm that starts away from its reference to be at rest there, so that its torque begins
            with no kick of the first error, neither of its derivative nor in proportion to it; "zero" starts
            with the integrators at zero.
        feedforward: torque of the nominal model that is added: "none" (the paper); at the reference "gravity"
            G(q*), or "model" D(q*) a* + C(q*, v*) v* + G(q*); or "computed", at the measured position
            D(q) a* + C(q, v*) v* + G(q).
        delay: transport delay in the loop [s], besides the sample and hold.
        payload: lightest and heaviest payload [kg] of `robot`, or a :class:`LoadRange`: the nominal
            model then has the heaviest, and the default gains suit the lightest
            (:func:`armgpi.payload_range`). Of a controller, the :class:`armgpi.PayloadRange` found; None for
            none.
        frame: frame of the payload; the robot's tip when not given.
        com: centre of mass of the load in that frame [m], shape (3,).
        friction_feedforward: whether the nominal model's joint friction at the reference velocity is added.
        integrators: 1 to 3; the paper has 2.
        rolloff: poles beyond those that C(s) needs, 0 to 2; the paper has 0.
        rolloff_ratio: those poles over omega_c [-].
        second_ratio: natural frequency of the second quadratic factor over omega_c [-]; 1 when not given.
        second_zeta: its damping ratio [-]; zeta_c when not given.
        rest_dead_zone: error below which nothing is integrated while the reference is at rest [rad or m];
            with `rest_leak` it keeps friction and encoder counts from making the arm hunt.
        rest_leak: rate at which every integrator except the first decays while the reference is at rest
            [1/s]; some 50 end hunting, 0 is the paper.
        rotor_factor: factor of the rotors' inertia in the nominal model of the feedback, the feedforward's
            has the robot's own; 1 is the paper, more serves elastic joints.
        force_limit: largest force [N] at `force_frame` that the torque beyond the model's presses with at
            rest; none when not given. Coulomb friction of the model comes on top, and the impact at the speed
            of the approach: it is no safety function. Beyond it nothing holds the arm.
        moment_limit: likewise its moment [N m]; 0.2 m times the force limit when not given.
        force_frame: the frame that they are of; the tip when not given.
        speed_limit: of the tool beside its reference under a force limit [m/s], as nothing else holds the arm
            beyond it; 0.25 when not given. It holds for pushes up to `push` of :meth:`force_bound`.
        limit_friction: Coulomb friction that comes on top of the force limit [N m or N]; the nominal model's
            when not given.
        bias_robot: the robot that the feedforward is of; `robot` when not given.
    """

    measurement_type: ClassVar[type[Measurement]] = Measurement
    knows: ClassVar[str] = "inertia"
    derived: ClassVar[Mapping[str, str]] = {
        "_viscous": "viscous friction of the nominal model [N m s/rad or N s/m]",
        "_coulomb": "Coulomb friction of the nominal model [N m or N]",
        "_emptied": "share of an integrator that leaks out in a sample at rest [-]",
        **ForceLimit.derived,
    }

    gains: Gains = parameter("tuning", kind="variant", group=Gains, default=None, none="FixedGains")
    realisation: str = parameter(
        "discrete form of the control law",
        kind="choice",
        default="bumpless",
        choices=("bumpless", "paper"),
        structural=True,
    )
    start: str = parameter(
        "first torque: hold is the one that holds the arm, rest is that without a step where the arm "
        "starts away from its reference, zero has all integrators at zero",
        kind="choice",
        default="hold",
        choices=("hold", "rest", "zero"),
        structural=True,
    )
    delay: float = parameter("transport delay in the loop", unit="s", default=0.0, least=0.0, in_file=False)
    payload: Any = parameter(
        "payloads that the controller must tolerate; the nominal model has the heaviest",
        kind="group",
        group=LoadRange,
        default=None,
        none="none",
        key="payload_range",
    )
    frame: str | None = parameter(
        "frame that carries the load", kind="text", default=None, none="the tip", in_file=False
    )
    com: Vector = parameter(
        "centre of mass of the load in that frame",
        unit="m",
        kind="vector",
        default=(0.0, 0.0, 0.0),
        in_file=False,
    )
    integrators: int = parameter(
        "number of integrators", kind="integer", default=2, least=1, most=3, structural=True
    )
    rolloff: int = parameter(
        "roll-off poles, which filter noise", kind="integer", default=0, least=0, most=2, structural=True
    )
    rolloff_ratio: PerJoint = parameter(
        "roll-off poles divided by omega",
        default=4.0,
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
        search=(1.0, 20.0),
        slider=(1.0, 20.0),
    )
    second_ratio: PerJoint = parameter(
        "natural frequency of the second quadratic factor divided by omega",
        default=None,
        none="1",
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
        search=(0.2, 20.0),
        slider=(0.2, 20.0),
    )
    second_zeta: PerJoint = parameter(
        "damping ratio of the second quadratic factor",
        default=None,
        none="zeta",
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
        search=(0.3, 30.0),
        slider=(0.3, 30.0),
    )

    feedforward: str = parameter(
        "torque of the nominal model at the reference that is added; the paper has none",
        kind="choice",
        default="none",
        choices=("none", "gravity", "model", "computed"),
        structural=True,
        short="torque of the nominal model at the reference that is added",
    )
    friction_feedforward: bool = parameter(
        "add the nominal model's joint friction at the reference velocity",
        kind="flag",
        default=False,
        structural=True,
    )
    rest_dead_zone: PerJoint = parameter(
        "error below which nothing is integrated while the reference is at rest",
        unit="rad or m",
        default=0.0,
        least=0.0,
        per_joint=True,
        slider=(0.0, 0.01),
    )
    rest_leak: PerJoint = parameter(
        "rate at which every integrator except the first decays while the reference is at rest",
        unit="1/s",
        default=0.0,
        least=0.0,
        per_joint=True,
        slider=(0.0, 100.0),
    )
    link_factor: float = parameter(
        "factor of the links' inertia in the nominal model of the feedback",
        default=1.0,
        least=0.0,
        above=True,
        log=True,
        search=(0.1, 2.0),
    )
    rotor_factor: float = parameter(
        "factor of the rotors' inertia in the nominal model of the feedback",
        default=1.0,
        least=0.0,
        above=True,
        log=True,
        search=(0.3, 10.0),
    )
    force_limit: float = same(ForceSettings, "force_limit", default=None, kw_only=True)
    moment_limit: float = same(ForceSettings, "moment_limit", default=None, kw_only=True)
    force_frame: str | None = same(ForceSettings, "force_frame", default=None, kw_only=True)
    speed_limit: float = same(ForceSettings, "speed_limit", default=None, kw_only=True, structural=True)
    limit_friction: PerJoint = same(ForceSettings, "limit_friction", default=None, kw_only=True)
    bias_robot: AnyRobot = field(default=None, kw_only=True)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        """Check the parameters and work out what `step` needs of them.

        Raises:
            PayloadError: when no bandwidth serves the loads.
            ParameterError: for a bad sample time, realisation, start or delay.
            ArrayError: for gains that are not positive or do not fit the joints.
            EffortError: when a joint has no torque.
        """
        check_robot(self.robot)
        self.check_parameters(self.robot.joint_names)
        member = self.member
        gains: Any = self.gains
        self._choose_models(gains, member)
        if gains is None:
            gains = FixedGains(served_omega(self.payload, self.dt, self.delay, member))
            if self.payload is None and not self.remade:
                advice.warn(advice.slow_default(self.dt, self.delay, member), 3)
        if not isinstance(gains, Gains):
            raise ParameterError("gains", gains, "Gains, such as FixedGains(omega_c=20.0)")
        self.keep("gains", gains.prepare(self.robot.joint_names, self.dt))
        super().__post_init__()
        rubs = " and friction" if self.friction_feedforward else ""
        self.knows = KNOWS[self.feedforward] + rubs  # type: ignore[misc]  # of this one, not of the class
        # What differs by rollout was declared to vary, whatever it is.
        resting = (self.rest_dead_zone, self.rest_leak)
        self._rests = any(x.ndim == 2 or x.any() for x in resting)
        self._law = REALISATIONS[self.realisation]
        if self.realisation == "bumpless":
            self._law = Bumpless(member)
        elif not member.printed:
            expected = "bumpless for every controller other than that of the paper"
            raise ParameterError("realisation", self.realisation, expected)
        elif self._rests:
            raise ParameterError("realisation", self.realisation, "bumpless with a dead zone or a leak")
        elif self.start == "rest":
            raise ParameterError("realisation", self.realisation, "bumpless with start: rest")
        self._emptied = -np.expm1(-self.rest_leak * self.dt)
        self._viscous, self._coulomb = self.bias_robot.friction
        self._dynamics, self._bias = self.robot.dynamics, self.bias_robot.dynamics
        self._force = self._force_limit()
        with np.errstate(all="ignore"):
            self._nominal = self._law.coefficients(self.gains.nominal(), self.dt)
        if not all(np.isfinite(x).all() for x in self._nominal):
            raise ParameterError("gains", self.gains, "a tuning whose derived gains are finite")
        if not self.remade:
            advice.warn(advice.late_loop(self), 3)

    def _choose_models(self, gains: Gains | None, member: Member) -> None:
        """Put the heaviest load and heavier rotors into the nominal model of the feedback."""
        if self.payload is not None:
            loads = load_range(self.payload, self.frame, self.com)
            if gains is None:
                payload = loads.choose(self.robot, self.dt, self.delay, member=member)
            else:  # who brings gains chooses how slow they are
                payload = loads.choose(self.robot, self.dt, self.delay, 1e-9)
            self.keep("payload", payload)
            self.keep("robot", payload.nominal)
        elif self.frame is not None:
            raise ParameterError("frame", self.frame, "left out where there is no payload")
        self.fill("bias_robot", self.robot)
        check_same_joints(self.bias_robot, "bias_robot", self.robot)
        self.keep("robot", feedback_model(self.robot, self.link_factor, self.rotor_factor))

    @classmethod
    def auto(
        cls,
        robot: AnyRobot,
        dt: float,
        *,
        delay: float = 0.0,
        bits: Any = ASSUMED_BITS,
        drives: str | None = None,
        **given: Any,
    ) -> GPI:
        """Return a controller by automatic, model-based tuning (`armgpi.tuning.rule`).

        Args:
            robot: nominal model.
            dt: sample time [s].
            delay: transport delay in the loop [s].
            bits: resolution of the encoders [bits], a number or an array that broadcasts against (n,); 16 is
                assumed where it is not given, None is for exact positions.
            drives: what is assumed of drives without data: "elastic", rotors and elastic joints;
                "stiff", rotors and stiff joints; "none", no rotors; see :func:`armgpi.assume_drives`. Of
                the arms of a batch nothing is assumed: leave it out, and take `assume_drives` of each arm.
            **given: parameters of the controller that are not to be chosen.

        Raises:
            ArmgpiError: as the constructor, and for encoders that cannot be.
        """
        # The rule stands above the controllers, which it makes: it is asked for where it is needed.
        rule: Any = import_module("armgpi.tuning.rule")
        own = ("robot", "dt", "delay", "bits", "drives")
        check_keywords("GPI.auto", given, [*own, *(set(signature(cls).parameters) - set(own))])
        chosen = rule.arguments(robot, dt, delay, bits, drives, given)
        made = cls(**chosen.values)
        advice.warn([*chosen.findings, *advice.coarse_counts(made, bits)], 1)
        return made

    @classmethod
    def untuned(cls, robot: AnyRobot, dt: float, **given: Any) -> GPI:
        """Return what :meth:`auto` does; the old name of that method."""
        warn_renamed("GPI.untuned", "GPI.auto")
        return cls.auto(robot, dt, **given)

    @classmethod
    def context_for(cls, given: Mapping[str, Any], context: Context) -> Context:
        """Return the context with the bandwidth [rad/s] that sample time, delay and loads allow.

        Args:
            given: parameters by their names; `payload` and those of the order count.
            context: what else the experiment is.
        """
        payload, member = given.get("payload"), Member.chosen_by(given)
        omega_c = default_omega(context.dt, context.delay, member=member)
        if payload is not None:
            with context.error_context("payload"):
                omega_c = payload.choose(context.robot, context.dt, context.delay, member=member).omega_c
        return context._replace(omega_c=omega_c)

    @classmethod
    def configured(cls, given: Mapping[str, Any], context: Context) -> GPI:
        """Return the controller; see :meth:`Controller.configured`."""
        # A scaled inertia varies D alone, as in the paper: the feedforward is of the robot as it is known.
        known: Any = None if given.get("feedforward", "none") == "none" else context.robot
        made = cls(context.nominal, context.dt, delay=context.delay, bias_robot=known, **given)
        advice.warn(advice.coarse_counts(made, context.bits), 1)
        return made

    def init(self, measurement: Measurement, target: Target) -> GPIState:
        """Return the state before the first sample; see :meth:`Controller.init`."""
        q = measurement.q
        e = q - target.q
        hold = np.zeros_like(e)
        if self.start != "zero":
            weight = self._bias.gravity(q)
            held = self.limited(weight)
            if self.feedforward != "none":
                # All that it gives at rest: what it gives to accelerate is no part of holding.
                at = self._where(q, target.q + np.zeros_like(q))
                held = held - (weight if at is q else self._bias.gravity(at))
            hold = self._dynamics.inertia_solve(q, held)
        learn = np.ones_like(e)
        first = self._law.init(hold, self._nominal)
        if self.start == "rest":
            first = self._law.at_rest(e, first, self._nominal)
        limit = None if self._force is None else self._force.init(e)
        return GPIState(first, self.gains.init(e), learn, limit)

    def waiting(self, measurement: Measurement, target: Target, state: GPIState) -> GPIState:
        """Return the state at the start, from where the arm is now; see :meth:`Controller.waiting`."""
        if self.start != "rest":
            return state
        e = measurement.q - target.q
        # The integrators stay: what the arm moved since the start is answered.
        return state._replace(law=self._law.settled(e, state.law, self._nominal))

    def step(self, measurement: Measurement, target: Target, state: GPIState) -> ControlStep:
        """Return torque and next state; what is NaN goes through: nothing is checked here.

        A check would cost 4 % of a step (1.3 of 30 us, UR5); :class:`armgpi.Supervised` has it, and
        :func:`armgpi.simulate` ends a run. See :meth:`Controller.step`.
        """
        q = measurement.q
        e = q - target.q
        coefficients, learn, gains_state = self._nominal, state.learn, None
        if self.gains.adaptive:
            tuning, gains_state = self.gains.step(e, learn, state.gains)
            coefficients = self._law.coefficients(tuning, self.dt)
        v = self._law.output(e, state.law, coefficients)
        asked = self._dynamics.inertia_times(q, v)  # eq. 19
        if self.feedforward != "none" or self.friction_feedforward:
            asked = asked + self.ahead(q, target)
        gentle = self._gentle(q, target, asked, state.limit)
        tau = self.limited(gentle.tau)
        cut = (tau - gentle.tau) + (gentle.told - asked)
        missing = self._dynamics.inertia_solve(q, cut)
        # The solver hands a zero torque back as it is: then nothing was cut.
        applied = None if missing is cut else missing
        law = self._law.update(e, v, applied, state.law, coefficients, *self._resting(e, target))
        if self.gains.adaptive:
            learn = np.where(cut == 0.0, 1.0, 0.0)
        return new(ControlStep, (tau, new(GPIState, (law, gains_state, learn, gentle.state))))

    def _gentle(self, q: Array, target: Target, asked: Array, state: Any) -> Gentle:
        """Return a torque that presses no more than the force limit allows."""
        if self._force is None:
            return new(Gentle, (asked, asked, None))
        _, v, a = (part + np.zeros_like(q) for part in target)
        known = self._bias.inverse(q, v, a)
        if self.friction_feedforward:
            known = self.add_friction(known, v)
        return self._force.gentle(q, target, (asked, known), state, self._bias)

    def changed(self, state: GPIState, limit: float) -> GPIState:
        """Return a state from which on it has another force limit, without a step of torque.

        The limit goes there with a time constant of 0.1 s; one that is more than twice as large grows e times
        in 0.1 s. The limit of the moment changes in proportion. `force_bound` is of the limit that was given
        to the constructor.

        Args:
            state: of the running controller.
            limit: largest force [N], a number or one a rollout, (batch, 1).

        Raises:
            ParameterError: for a controller without a force limit, and for a limit that is not positive or
                below the weight that the payload is uncertain by.
            ArrayError: when its shape does not fit.
        """
        if self._force is None:
            raise ParameterError("limit", limit, "left out of a controller without a force limit")
        return state._replace(limit=self._force.changed(state.limit, limit, self.least_limit))

    def force_bound(self, **given: Any) -> ForceBound:
        """Return what the tool presses with under the force limit, and the impact beside it.

        Args:
            **given: friction, speed, wall, configurations, and `arm`, the true arm, whose gravity may differ
                from that of the model; see :meth:`armgpi.control.force_limit.ForceLimit.bound`.

        Raises:
            ParameterError: when there is no force limit.
        """
        if self._force is None:
            raise ParameterError("force_limit", None, "given where the force is to be bounded")
        return self._force.bound(one_of(self.bias_robot), weight=self.least_limit, **given)

    @property
    def least_limit(self) -> float:
        """The weight that the payload is uncertain by [N]: no force limit may be below it."""
        if self.payload is None:
            return 0.0
        return float(FREE_FALL * (self.payload.heaviest - self.payload.lightest))

    def _force_limit(self) -> ForceLimit | None:
        """Return what limits the force; None for nothing.

        Raises:
            ParameterError: for a limit below the weight that the payload is uncertain by, or a moment or a
                frame without a force limit.
        """
        limit: Any = self.force_limit
        if limit is None:
            for name in ("moment_limit", "force_frame", "speed_limit", "limit_friction"):
                if vars(self)[name] is not None:
                    raise ParameterError(name, vars(self)[name], "left out where there is no force_limit")
            return None
        check_weight(limit, self.least_limit)
        friction: Any = self.limit_friction
        fastest: Any = self.speed_limit
        found = ForceLimit(
            one_of(self.bias_robot),
            self.force_frame,
            limit,
            self.moment_limit,
            self._coulomb if friction is None else friction,
            SPEED if fastest is None else fastest,
            (self.dt, self.delay),
        )
        if not self.remade:
            advice.warn(found.doubts(one_of(self.bias_robot)), 4)
        return found

    def _where(self, measured: Array, wanted: Array) -> Array:
        """Return the position that the feedforward is taken at."""
        return measured if self.feedforward == "computed" else wanted

    def ahead(self, measured: Array, target: Target) -> Array:
        """Return the torque that is fed forward, in the shape of the measured position.

        Args:
            measured: positions [rad or m], shape (n,) or (batch, n).
            target: of this sample.

        Returns:
            Torque [N m or N], likewise; zero with `feedforward="none"`.
        """
        ahead = np.zeros_like(measured)
        if self.feedforward == "gravity" and not self.friction_feedforward:  # the usual one: nothing more
            return self._bias.gravity(self._where(measured, target.q + ahead))
        wanted, v, a = (part + ahead for part in target)  # one reference may be for a whole batch
        if self.feedforward != "none":
            known, q = self._bias, self._where(measured, wanted)
            ahead = known.gravity(q) if self.feedforward == "gravity" else known.inverse(q, v, a)
        return self.add_friction(ahead, v) if self.friction_feedforward else ahead

    def add_friction(self, torque: Array, v: Array) -> Array:
        """Return a torque with the nominal model's friction at a reference velocity [N m or N].

        Args:
            torque: to which friction is added [N m or N], shape (n,) or (batch, n).
            v: velocity of the reference [rad/s or m/s], likewise.
        """
        return add_smooth_friction(torque, v, self._viscous, self._coulomb, _SMOOTH)

    def _resting(self, e: Array, target: Target) -> tuple[Resting, ...]:
        """Return what the integrators are given where the reference rests; nothing for the error."""
        if not self._rests:
            return ()
        rests = np.where((target.v == 0.0) & (target.a == 0.0), 1.0, 0.0)
        zone = rests * self.rest_dead_zone
        beyond = e - np.minimum(np.maximum(e, -zone), zone)
        return (new(Resting, (beyond, 1.0 - rests * self._emptied)),)

    @property
    def member(self) -> Member:
        """Which member of the family it is."""
        return Member.chosen_by(vars(self))

    def margins(self) -> Margins:
        """Return what the loops of all joints tolerate, in continuous time and with the gains at rest."""
        return worst_margins(self.gains.nominal(), self.member)

    def count_torque(self, bits: ArrayLike) -> Array:
        """Return by how much one count of an encoder moves a joint's torque at once [N m or N], (n,).

        Args:
            bits: resolution [bits], a number or an array that broadcasts against (n,).

        Raises:
            ParameterError: when the nominal model is a batch.
        """
        if not isinstance(self.robot, Robot):
            raise ParameterError("robot", self.robot, "a single Robot")
        law = Bumpless(self.member)
        c, zero = law.coefficients(self.gains.nominal(), self.dt), np.zeros(self.robot.n)
        at_once = np.abs(law.output(zero + 1.0, law.init(zero, c), c))
        counts = self.robot.encoder_count(as_float_array(bits, "bits"))
        return np.asarray((most_inertia(self.robot) * (at_once * counts)).max(axis=1))

    def signals(self, state: GPIState) -> Mapping[str, Array]:
        """Return the controller's states under their names; see :meth:`Controller.signals`."""
        return {**state.law._asdict(), **self.gains.signals(state.gains)}

    def describe(self) -> dict[str, Any]:
        """Return the parameters as plain data."""
        told = super().describe()
        for name in ("payload", "frame", "com"):
            del told[name]
        told["gains"] = {"type": type(self.gains).__name__, **self.gains.describe()}
        if self.payload is not None:  # its nominal model is the robot
            told["payload"] = {
                key: plain(value)
                for key, value in self.payload._asdict().items()
                if key not in ("nominal", "member")
            }
        return told
