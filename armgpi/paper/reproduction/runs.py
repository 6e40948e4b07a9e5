"""The rollouts behind the reproduction: controllers, plants and references, in as few batches as can be.

What the paper states and what is ours is in the scenario files; this module varies them.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from armgpi import config
from armgpi.base.arrays import Array, PerJointInput
from armgpi.control.pid import PIDInversion
from armgpi.errors import ArmgpiWarning
from armgpi.gpi.law import GPI
from armgpi.gpi.network import BSplineNetwork
from armgpi.loop import metrics
from armgpi.loop.simulation import simulate
from armgpi.paper import scenarios
from armgpi.paper.published import TABLES
from armgpi.plants.actuators import Saturated
from armgpi.plants.loads import Sine, paper_disturbances
from armgpi.plants.plant import Plant
from armgpi.plants.rigid_body import RigidBodyPlant
from armgpi.plants.sensors import Delayed, Differentiated, Encoder
from armgpi.references.batch import ReferenceBatch
from armgpi.references.reference import Reference
from armgpi.references.waypoints import Waypoints
from armgpi.robot.batch import RobotBatch
from armgpi.robot.robot import Robot

#: Factors on the D(q) of the nominal models, in the order of Tables 2 to 4.
SCALES = tuple(table.inertia_scale for table in TABLES)
#: Names of the contenders.
NETWORK = "GPI, networks"
SLOW_NETWORK = "GPI, networks, rate 0.12"
LITERAL = "GPI, networks as printed"
NEAR_PID = "PID + inversion, as published"
TUNED_PID = "PID + inversion, tuned"
#: Rollouts that only figures need.
SCENARIO_1 = "scenario 5.1"
SCENARIO_2 = "scenario 5.2"
UNDISTURBED = "undisturbed"

#: The real sensors: encoders of so many bits, and one sample of delay; velocities, for a law that needs them,
#: from filtered differences.
BITS = 16
#: Sample time with real sensors [s].
REAL_DT = 1e-3
#: Learning rate of eq. 23 in the row "as printed"; the sweep has more.
LITERAL_RATE = 0.01
SWEEP_RATES = (1e-3, 1e-2, 0.1, 1.0, 10.0)
#: Fixed bandwidths of the ablation [rad/s].
FIXED = (20.0, 30.0, 40.0, 60.0)
#: Its resolutions [bits].
ABLATION_BITS = (12, 14, 16, 18)
#: Damping ratio of the networks [-].
_ZETA = 0.75
#: Kp, Ki, Kd, arrays that broadcast against (batch, n).
_PIDGains = tuple[Array, Array, Array]


class Setting(NamedTuple):
    """How the paper's own setting, ideal sensors, is run.

    Attributes:
        dt: sample time [s].
        record_every: record every so many samples.
        slower: what the bandwidths of the scenario files are divided by, for a longer sample time.
        candidates: triple poles, and bandwidths of the velocity filter [rad/s], among which the tuned
            PID + inversion is chosen.
        brief: whether contenders that are not in the paper are left out.
    """

    dt: float = 1e-4
    record_every: int = 10
    slower: float = 1.0
    candidates: tuple[tuple[float, ...], tuple[float, ...]] = (
        (15.0, 20.0, 25.0, 30.0),
        (30.0, 50.0, 100.0),
    )
    brief: bool = False


class Poles(NamedTuple):
    """A tuning of PID + inversion.

    Attributes:
        pole: where the three poles of s^3 + Kd s^2 + Kp s + Ki are, negated [rad/s].
        bandwidth: of the filter that makes velocities from positions [rad/s].
    """

    pole: float
    bandwidth: float


FULL = Setting()
#: Its tuned PID is the one that the full run finds.
QUICK = Setting(dt=1e-3, record_every=1, slower=3.0, candidates=((25.0,), (30.0,)), brief=True)


#: That of rollouts with real sensors, recorded at every sample: torque may chatter.
REAL = Setting(REAL_DT, 1)


#: What computes; see :func:`armgpi.simulate`.
_backend = "auto"


def choose(backend: str) -> None:
    """Choose what computes all runs of this process from now on."""
    global _backend
    _backend = backend


def ideal_gpi(setting: Setting) -> xr.Dataset:
    """Run GPI with ideal sensors: networks and fixed gains for Tables 2 to 4, and what the figures show."""
    one, two, three = (_scenario(name) for name in scenarios.names())
    lower, upper = _box(setting)
    middle = 0.5 * (lower + upper)
    fixed = f"GPI, fixed {middle:g} rad/s"
    # Label, factor on D(q), reference, factor on the disturbances.
    rows = [(NETWORK, scale, three.reference, 1.0) for scale in SCALES]
    if not setting.brief:
        rows += [(fixed, scale, three.reference, 1.0) for scale in SCALES]
    rows += [
        (UNDISTURBED, 1.0, three.reference, 0.0),
        (SCENARIO_1, 1.0, one.reference, 0.0),
        (SCENARIO_2, 1.0, two.reference, 0.0),
    ]
    labels, scales, references, loaded = zip(*rows, strict=True)
    adapts = np.array([[label != fixed] for label in labels])
    omega = (np.where(adapts, lower, middle), np.where(adapts, upper, middle))
    zeta = (np.where(adapts, _ZETA, 1.0), np.ones(adapts.shape))
    gains = _network(omega_c=omega, p_c=omega, zeta_c=zeta)
    controller = GPI(_nominal(scales), setting.dt, gains, start="zero")
    plant = Saturated(RigidBodyPlant(_arm(), _paper_loads(loaded)))
    return _run(plant, controller, ReferenceBatch(references), setting, labels, scales, signals=True)


def ideal_literal(setting: Setting) -> xr.Dataset:
    """Run the paper's controller to the letter: eq. 17 as printed, eq. 23 with e_n = e, all three adapted."""
    gains = _literal(_box(setting), LITERAL_RATE)
    controller = GPI(_nominal(SCALES), setting.dt, gains, realisation="paper", start="zero")
    plant = Saturated(RigidBodyPlant(_arm(), paper_disturbances()))
    labels = [LITERAL] * len(SCALES)
    return _run(plant, controller, _reference(), setting, labels, SCALES)


def ideal_pid(setting: Setting) -> xr.Dataset:
    """Run PID + inversion with ideal sensors: near the published figures, tuned, and undisturbed.

    Without sensor steps more gain only tracks better: the tuned one may be as fast as the networks.
    """
    labels = [NEAR_PID] * len(SCALES) + [TUNED_PID] * len(SCALES) + [UNDISTURBED]
    scales = [*SCALES, *SCALES, 1.0]
    _, fastest = _box(setting)
    gains = _rows(labels, _near_pid(), _pole_gains([fastest]))
    controller = PIDInversion(_nominal(scales), setting.dt, *gains, bias_robot=_arm())
    loaded = [0.0 if label == UNDISTURBED else 1.0 for label in labels]
    plant = Saturated(RigidBodyPlant(_arm(), _paper_loads(loaded)))
    return _run(plant, controller, _reference(), setting, labels, scales)


def real_gpi(setting: Setting) -> xr.Dataset:
    """Run GPI behind encoders and a delay: networks, free and within the certified rate, and fixed gains."""
    names = [NETWORK, "GPI, fixed 30 rad/s"]
    if not setting.brief:
        names += [SLOW_NETWORK, "GPI, fixed 25 rad/s"]
    rows = [(name, scale) for name in names for scale in SCALES]
    labels, scales = zip(*rows, strict=True)
    bandwidths = {"GPI, fixed 25 rad/s": 25.0, "GPI, fixed 30 rad/s": 30.0}
    fixed = [bandwidths.get(label) for label in labels]
    rate = [0.12 if label == SLOW_NETWORK else 1e9 for label in labels]
    gains = _networks_or_fixed(fixed, rate=rate)
    controller = GPI(_nominal(scales), REAL_DT, gains, start="zero")
    return _run(_real(), controller, _reference(), REAL, labels, scales)


def real_literal() -> xr.Dataset:
    """Run the paper's controller to the letter behind encoders and a delay."""
    gains = _literal((22.0, 60.0), LITERAL_RATE)
    controller = GPI(_nominal(SCALES), REAL_DT, gains, realisation="paper", start="zero")
    labels = [LITERAL] * len(SCALES)
    return _run(_real(), controller, _reference(), REAL, labels, SCALES)


def real_pid(tuned: Poles) -> xr.Dataset:
    """Run PID + inversion behind encoders and a delay: near the published figures, and tuned."""
    near = _near_pid()
    labels = [NEAR_PID] * len(SCALES) + [TUNED_PID] * len(SCALES)
    gains = _rows(labels, near, _pole_gains([tuned.pole]))
    filters = np.array([[tuned.bandwidth]] * len(labels))
    scales = SCALES * 2
    controller = PIDInversion(_nominal(scales), REAL_DT, *gains, bias_robot=_arm())
    plant = _real(filters)
    return _run(plant, controller, _reference(), REAL, labels, scales)


def candidates(setting: Setting) -> xr.Dataset:
    """Run the candidates for the tuned PID + inversion behind encoders and a delay, at D(q) x 1.0."""
    poles, filters = map(np.ravel, np.meshgrid(*setting.candidates))
    kp, ki, kd = _pole_gains(poles)
    scales = [1.0] * len(poles)
    controller = PIDInversion(_nominal(scales), REAL_DT, kp, ki, kd, bias_robot=_arm())
    plant = _real(filters[:, np.newaxis])
    labels = [TUNED_PID] * len(poles)
    result = _run(plant, controller, _reference(), REAL, labels, scales)
    return result.assign_coords(pole=("rollout", poles), bandwidth=("rollout", filters))


def best_candidate(found: xr.Dataset, gpi: xr.Dataset) -> Poles:
    """Return the candidate with the least ITAE among those that chatter no more than the networks do."""
    budget = float(variation(select(gpi, NETWORK, 1.0)))
    costs = metrics.itae(found).sum("joint")
    costs = costs.where(variation(found) <= budget, np.inf)
    best = found.isel(rollout=int(np.argmin(costs.values)))
    return Poles(float(best["pole"]), float(best["bandwidth"]))


class _Unpublished(NamedTuple):
    """What the paper does not give, in terms of what is taken for it.

    Attributes:
        goal: factor on the way of the moves.
        duration: factor on their durations.
        raised: how much higher q2 is [rad].
        omega: factor on the range of omega_c.
        rate: factor on the learning rate.
    """

    goal: float = 1.0
    duration: float = 1.0
    raised: float = 0.0
    omega: float = 1.0
    rate: float = 1.0


def sensitivity() -> xr.Dataset:
    """Run the networks with ideal sensors, at 1 kHz for 80 s, each unpublished value halved and doubled."""
    rows = {
        "as it is": _Unpublished(),
        "references (way) x 0.5": _Unpublished(goal=0.5),
        "references (way) x 2": _Unpublished(goal=2.0),
        "references (duration) x 0.5": _Unpublished(duration=0.5),
        "references (duration) x 2": _Unpublished(duration=2.0),
        "configuration, q2 0.4 rad lower": _Unpublished(raised=-0.4),
        "configuration, q2 0.4 rad higher": _Unpublished(raised=0.4),
        "omega range x 0.5": _Unpublished(omega=0.5),
        "omega range x 2": _Unpublished(omega=2.0),
        "learning rate x 0.5": _Unpublished(rate=0.5),
        "learning rate x 2": _Unpublished(rate=2.0),
    }
    references = [_reference(row.goal, row.duration, row.raised) for row in rows.values()]
    factor = np.array([[row.omega] for row in rows.values()])
    lower, upper = _box(QUICK)
    gains = _network(
        omega_c=(lower * factor, upper * factor),
        zeta_c=_ZETA,
        p_c=None,
        learning_rate=[[0.2 * row.rate] for row in rows.values()],
    )
    scales = [1.0] * len(rows)
    controller = GPI(_nominal(scales), QUICK.dt, gains, start="zero")
    plant = Saturated(RigidBodyPlant(_arm(), paper_disturbances()))
    reference = ReferenceBatch(references)
    return _run(plant, controller, reference, QUICK, list(rows), scales, t_final=80.0)


def ablation() -> xr.Dataset:
    """Run networks and fixed gains behind encoders of several resolutions, one sample of delay."""
    bandwidths = {f"GPI, fixed {omega:g} rad/s": omega for omega in FIXED}
    rows = [(name, bits) for bits in ABLATION_BITS for name in (NETWORK, *bandwidths)]
    labels, bits = zip(*rows, strict=True)
    fixed = [bandwidths.get(label) for label in labels]
    resolutions = np.array(bits, dtype=np.float64)[:, np.newaxis]
    counts = 2.0 * np.pi / 2.0**resolutions
    scales = [1.0] * len(rows)
    gains = _networks_or_fixed(fixed, error_range=counts, dead_zone=2.0 * counts)
    controller = GPI(_nominal(scales), REAL_DT, gains, start="zero")
    plant = _real(bits=resolutions)
    result = _run(plant, controller, _reference(), REAL, labels, scales)
    return result.assign_coords(bits=("rollout", list(bits)))


def sweep(realisation: str) -> xr.Dataset:
    """Run eq. 23 to the letter over the learning rate and the factor on D(q), ideal sensors at 1 kHz."""
    rows = [(rate, scale) for rate in SWEEP_RATES for scale in SCALES]
    rates, scales = zip(*rows, strict=True)
    gains = _literal((30.0, 60.0), [[rate] for rate in rates])
    controller = GPI(_nominal(scales), REAL_DT, gains, realisation=realisation, start="zero")
    plant = Saturated(RigidBodyPlant(_arm(), paper_disturbances()))
    labels = [LITERAL] * len(rows)
    result = _run(plant, controller, _reference(), REAL, labels, scales)
    return result.assign_coords(learning_rate=("rollout", list(rates)))


def holding_cost() -> Array:
    """Return what holding against gravity and load alone costs on the reference: ISCI [(N m)^2 s], (3,)."""
    dt = 1e-3
    t = np.arange(0.0, _horizon(), dt)
    torque = _arm().gravity(_reference().at(t).q)
    for load in paper_disturbances():
        torque = torque + load.torque(t[:, np.newaxis])
    return np.asarray(np.sum(torque**2, axis=0) * dt)


def select(result: xr.Dataset, label: str, scale: float) -> xr.Dataset:
    """Return the one rollout of a contender at a factor on D(q)."""
    is_it = (result["label"].values == label) & (result["scale"].values == scale)
    first = int(np.flatnonzero(is_it)[0])
    return result.isel(rollout=first)


def variation(result: xr.Dataset) -> xr.DataArray:
    """Return the total variation of torque, all joints together [N m]."""
    return metrics.total_variation(result).sum("joint")


def _run(
    plant: Plant,
    controller: GPI | PIDInversion,
    reference: Reference,
    setting: Setting,
    labels: Sequence[str],
    scales: Sequence[float],
    t_final: float | None = None,
    signals: bool = False,
) -> xr.Dataset:
    """Simulate a batch and label its rollouts."""
    with warnings.catch_warnings():
        # Bandwidths beyond the delay margin are part of what is shown.
        warnings.simplefilter("ignore", ArmgpiWarning)
        result = simulate(
            plant,
            controller,
            reference,
            _horizon() if t_final is None else t_final,
            record_every=setting.record_every,
            signals=signals,
            progress=False,
            backend=_backend,
        )
    return result.assign_coords(
        label=("rollout", list(labels)),
        scale=("rollout", list(scales)),
        measurement=("rollout", [controller.measurement_type.__name__] * len(labels)),
        knows=("rollout", [controller.knows] * len(labels)),
    )


def _scenario(name: str) -> config.Experiment:
    """Return a scenario as objects."""
    return config.build(*config.read(scenarios.locate(name)))


def _arm() -> Robot:
    """Return the paper's arm."""
    return Robot.load("anthropomorphic3")


def _horizon() -> float:
    """Return how long the rollouts of the tables are [s]."""
    return _scenario("scenario-5.3").t_final


def _reference(goal: float = 1.0, duration: float = 1.0, raised: float = 0.0) -> Waypoints:
    """Return the moves of scenario 5.3: way and duration times a factor, q2 raised everywhere."""
    moves: Any = _scenario("scenario-5.3").config.reference
    points = goal * np.array(moves.points, dtype=np.float64) + [0.0, raised, 0.0]
    stated = np.asarray(moves.durations, dtype=np.float64)
    durations = np.broadcast_to(stated, len(points) - 1)
    return Waypoints(list(points), (duration * durations).tolist(), moves.holds)


def _nominal(scales: Sequence[float]) -> RobotBatch:
    """Return the nominal models: the arm, with D(q) times a factor for each rollout."""
    arm = _arm()
    return RobotBatch([arm.scaled_inertia(scale) for scale in scales])


def _paper_loads(loaded: Sequence[float]) -> list[Sine]:
    """Return the torques of eqs. 29-31, times a factor for each rollout."""
    factor = np.array(loaded)[:, np.newaxis]
    return [
        dataclasses.replace(load, amplitude=factor * np.asarray(load.amplitude))
        for load in paper_disturbances()
    ]


def _stated_networks() -> BSplineNetwork:
    """Return the networks of scenario 5.3."""
    law: Any = _scenario("scenario-5.3").controllers["GPI with networks"]
    gains: BSplineNetwork = law.gains
    return gains


def _box(setting: Setting) -> tuple[float, float]:
    """Return the range of omega_c in the scenario files, slower where the sample time is longer."""
    lower, upper = _stated_networks().boxes["omega_c"]
    return float(np.max(lower)) / setting.slower, float(np.max(upper)) / setting.slower


def _network(**changes: Any) -> BSplineNetwork:
    """Return the networks of scenario 5.3, changed."""
    stated = _stated_networks()
    settings: dict[str, Any] = {
        "learning_rate": stated.learning_rate,
        "error_range": stated.error_range,
        "dead_zone": stated.dead_zone,
        "bandwidth": stated.bandwidth,
    }
    return BSplineNetwork(**{**settings, **changes})


def _networks_or_fixed(fixed: Sequence[float | None], **changes: Any) -> BSplineNetwork:
    """Return the default networks where `fixed` is None, else that constant bandwidth [rad/s] at zeta 1.

    Networks that do not learn are fixed gains, bit by bit, so all fit into one batch.
    """
    adapts = np.array([[omega is None] for omega in fixed])
    constant = np.array([[omega or 1.0] for omega in fixed])
    per_row: dict[str, Any] = {name: np.reshape(value, (-1, 1)) for name, value in changes.items()}
    return BSplineNetwork(
        (np.where(adapts, 22.0, constant), np.where(adapts, 60.0, constant)),
        np.where(adapts, _ZETA, 1.0),
        learning_rate=np.where(adapts, 0.2, 0.0),
        **per_row,
    )


def _literal(box: tuple[float, float], rate: PerJointInput) -> BSplineNetwork:
    """Return networks that learn by eq. 23 to the letter; the upper ends only say that all three adapt."""
    return BSplineNetwork(box, (1.0, 2.0), box, learning="signed", learning_rate=rate)


def _real(filters: Array | None = None, bits: PerJointInput = BITS) -> Plant:
    """Return the arm behind torque limits, encoders and a sample of delay; `filters` make velocities."""
    arm = RigidBodyPlant(_arm(), paper_disturbances())
    plant: Plant = Encoder(Saturated(arm), bits)
    if filters is not None:
        plant = Differentiated(plant, filters)
    return Delayed(plant, 1)


def _near_pid() -> _PIDGains:
    """Return the gains of scenario 5.3: near the published figures."""
    law: Any = _scenario("scenario-5.3").controllers["PID + inversion"]
    return law.kp, law.ki, law.kd


def _rows(labels: Sequence[str], near: _PIDGains, tuned: _PIDGains) -> _PIDGains:
    """Return a row of gains for each label: tuned where it says so."""
    chosen = np.array([[label == TUNED_PID] for label in labels])
    kp, ki, kd = (np.where(chosen, *gains) for gains in zip(tuned, near, strict=True))
    return kp, ki, kd


def _pole_gains(poles: Sequence[float] | Array) -> _PIDGains:
    """Return Kp, Ki, Kd that put three poles of s^3 + Kd s^2 + Kp s + Ki at -pole, each (k, 1)."""
    pole = np.asarray(poles, dtype=np.float64)[:, np.newaxis]
    return 3.0 * pole**2, pole**3, 3.0 * pole
