"""What laws come to on arms as they may really be: draws of a reality, counted by what went wrong.

A rollout has *failed* when it diverged, its error passed 0.5 rad, or 0.1 rad in the last 1.2 s; what gravity
lets gears sink by unseen is not counted. One that has not failed is *hunting* when a joint moves by more than
four encoder counts and 0.5 mrad in that time, and *returning* when it also comes back by as much, and does
not only creep where friction lets it: once in a slow return, or to and fro. It is *swinging* when it is
returning and that goes on: in the last second it departs from the best cubic in time by more than those
counts, and by at least 0.7 of what it did in the second before. It *chatters* when a joint's torque changes
by more than 1 % of its effort from sample to sample in that time, on average. (m instead of rad for prismatic
joints.) A draw is *feasible* when its motors can give what it takes to follow the reference exactly, and,
where gears twist, when a law searched with the truth holds the arm; no law can follow one that is not.
"""

from __future__ import annotations

import math
import warnings
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from armgpi import config
from armgpi.base.arrays import Array, check_whole
from armgpi.base.escape import markdown_table
from armgpi.base.intervals import Estimate, wilson
from armgpi.base.renamed import warn_renamed
from armgpi.config.schema import KINDS, PlantSection
from armgpi.control.controller import Controller
from armgpi.errors import ArmgpiWarning
from armgpi.gpi.family import Member
from armgpi.gpi.law import KNOWS
from armgpi.health.zoo import fingers
from armgpi.loop import metrics
from armgpi.loop.prepared import PreparedLoop, prepare
from armgpi.loop.rollout import Status, describe_measurement
from armgpi.plants.reality import Reality, Scenario, batches, stack_draws
from armgpi.references.reference import Target
from armgpi.robot import rotors
from armgpi.robot.batch import with_heavier_rotors
from armgpi.robot.equations import Friction
from armgpi.robot.robot import Robot
from armgpi.supervisor import Supervisor, complete_settings
from armgpi.tuning import geared, two_mass
from armgpi.tuning.rule import Structure, Untuned, assume, structures

#: Errors that lose an arm, at any time and at the end [rad or m]; what the end is [s].
FAILED_PEAK, FAILED_END, END = 0.5, 0.1, 1.2
#: The time at the end that tells whether a joint swings, nothing having happened since [s]; and the share of
#: the swinging in its first half that there is in the second at least: a mode of 5 Hz and 1 % damping, left
#: alone, keeps 0.73. Set by hand.
SWING, LASTING = 2.0, 0.7
#: Motion at the end that is hunting [rad or m], but no less than so many counts.
HUNTING, HUNTING_COUNTS = 5e-4, 4.0
#: Mean step of torque at the end that is chatter, as a share of the effort.
CHATTER = 0.01
#: Largest sensitivity of a loop that counts as held.
MOST_SENSITIVITY = 3.0
#: Laws that are tried: factor of the rotors and share of the inertia in the feedback, roll-off over the
#: bandwidth; and bandwidths [rad/s] of each.
SEARCHED = tuple(
    (factor, share, ratio)
    for ratio in (None, 8.0)
    for factor, share in ((1.0, 0.7), (3.0, 1.0), (1.0, 1.0), (1.0, 0.5), (1.0, 0.35), (10.0, 1.0))
)
BANDWIDTHS = (8.0, 5.0, 12.0, 3.5, 2.0)
#: Moments at which the torque that a move takes is looked at.
MOMENTS = 301
#: The first draws of two arms are so many draws apart, or a multiple.
_APART = 1 << 12


class Outcome(NamedTuple):
    """What came out of one draw.

    Attributes:
        arm: its name.
        index: of the draw.
        failed: whether the rollout diverged, or its error exceeded a limit.
        hunting: whether it moves at rest.
        swinging: whether it moves to and fro at rest, and goes on.
        chatter: whether its torque does.
        peak: largest error [rad or m]; infinite where it diverged.
        itae: sum of the joints' ITAE [rad s^2 or m s^2], likewise.
        variation: sum of the joints' torque variation [N m or N], likewise.
        demand: largest share of a motor's torque that following takes [-]; above 1 nothing can.
        held: whether a law searched with the truth holds it.
        returning: whether it turns at rest.
        sample_time: of the controller [s].
        delay: samples by which measurements are late.
        lag: delay of hold, transport and current loop [s].
        final_error: largest error at the end [rad or m]; infinite where it diverged.
    """

    arm: str
    index: int  # type: ignore[assignment]
    failed: bool
    hunting: bool
    swinging: bool
    chatter: bool
    peak: float
    itae: float
    variation: float
    demand: float
    held: bool = True
    returning: bool = False
    sample_time: float = math.nan
    delay: int = 0
    lag: float = math.nan
    final_error: float = math.nan

    @property
    def lost(self) -> bool:
        """Return `failed`; its old name."""
        warn_renamed("lost", "failed")
        return self.failed

    @property
    def feasible(self) -> bool:
        """Whether the motors can follow the reference, and a law hold the arm."""
        return self.demand <= 1.0 and self.held


def first_index(name: str) -> int:
    """Return the index of an arm's first draw: arms that are not the same have other draws."""
    return zlib.crc32(name.encode()) % _APART * _APART


def draws(reality: Reality, name: str, count: int, drives: str | None = None) -> list[Scenario]:
    """Return the first draws of an arm by its name, its grippers locked.

    Args:
        reality: what is drawn from.
        name: of the arm.
        count: number of draws.
        drives: what a law believes; see :func:`armgpi.assume_drives`. Where it is not given, the reality
            says. Draws of rotors with the scatter of published drives are the same for "stiff" and "elastic".

    Raises:
        ParameterError: when the count is no whole number from 1 to 4096.
        ArmgpiError: when the arm cannot be loaded.
    """
    count = check_whole(count, "count", 1, _APART)
    robot = Robot.load(name, fingers(name))
    robot = robot if drives is None else rotors.assume_drives(robot, drives)
    first = first_index(name)
    return [reality.draw(robot, first + i) for i in range(count)]


def prepare_draws(draws: Sequence[Scenario], law: Mapping[str, Any], **options: Any) -> PreparedLoop:
    """Return the loop of a law on draws that may run together; see :func:`armgpi.prepare` for the options.

    Raises:
        ArmgpiError: when the law cannot be made for the arm.
    """
    every = stack_draws(draws)
    made: Controller = config.controller(law, every.context)
    return prepare(every.plant, made, every.reference, every.t_final, **options)


def in_rows(rollout: xr.Dataset) -> xr.Dataset:
    """Return rollouts with the dimension that a single one lacks."""
    return rollout if "rollout" in rollout.dims else rollout.expand_dims("rollout")


def rollouts(
    found: Sequence[Scenario],
    law: Mapping[str, Any],
    backend: str = "compiled",
    supervisors: Sequence[Supervisor | None] = (None,),
) -> Iterator[tuple[list[Scenario], list[xr.Dataset]]]:
    """Yield draws of one arm that run together, and their rollouts under each supervisor.

    Args:
        found: the draws.
        law: a controller's section of an experiment file, such as ``{"type": "gpi"}``.
        backend: as for :func:`armgpi.simulate`.
        supervisors: what they run under, as it suits encoder and delay; None for nothing.

    Raises:
        ArmgpiError: when the law cannot be made for the arm.
    """
    for group in alike(batches(found), law):
        every, under = stack_draws(group), []
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ArmgpiWarning)
            made = config.controller(law, every.context)
            for supervisor in supervisors:
                suits = supervisor
                if supervisor is not None:
                    own = supervisor.with_values(resolution=group[0].robot.encoder_count(every.context.bits))
                    suits = complete_settings(own, PlantSection(delay=group[0].delay), made)
                options: Any = {"backend": backend, "supervisor": suits}
                loop = prepare(every.plant, made, every.reference, every.t_final, **options)
                under.append(in_rows(loop.run(progress=False)))
        yield group, under


def alike(groups: Iterable[list[Scenario]], law: Mapping[str, Any]) -> Iterator[list[Scenario]]:
    """Yield groups of draws parted by the structure of the automatic controller that each has alone.

    Args:
        groups: of draws that may run together, as :func:`armgpi.plants.reality.batches` returns them.
        law: a controller's section of an experiment file; of other types groups are left alone.
    """
    for group in groups:
        if law.get("type") != Untuned.config_name or len(group) == 1:
            yield group
            continue
        parts: dict[Structure, list[Scenario]] = {}
        for draw, structure in zip(group, _structures(group, law), strict=True):
            parts.setdefault(structure, []).append(draw)
        yield from parts.values()


def _structures(group: Sequence[Scenario], law: Mapping[str, Any]) -> tuple[Structure, ...]:
    """Return the structure of the automatic controller of each draw of a batch."""
    context = config.told_context(law, stack_draws(group).context)
    bits = assume(context.bits)
    return structures(context.nominal, context.dt, context.delay, bits, context.given)


def outcomes(
    found: Sequence[Scenario],
    name: str,
    law: Mapping[str, Any],
    backend: str = "compiled",
    holds: Mapping[int, bool] | None = None,
) -> list[Outcome]:
    """Return what a law makes of draws of one arm.

    Args:
        found: the draws.
        name: of the arm.
        law: a controller's section of an experiment file.
        backend: as for :func:`armgpi.simulate`.
        holds: index -> :func:`ideal_law_holds` of the draw, where that is known.

    Raises:
        ArmgpiError: when the law cannot be made for the arm.
    """
    by_index = {}
    holds = {draw.index: ideal_law_holds(draw) for draw in found} if holds is None else holds
    for group, (rollout,) in rollouts(found, law, backend):
        costs = zip(*_costs(rollout), strict=True)
        for row, (draw, own) in enumerate(zip(group, costs, strict=True)):
            one = outcome(rollout.isel(rollout=row), draw, name, own)
            one = one._replace(held=holds[draw.index], lag=loop_lag(draw))
            by_index[draw.index] = one._replace(sample_time=draw.dt, delay=draw.delay)
    return [by_index[draw.index] for draw in found]


def _costs(rollout: xr.Dataset) -> list[Array]:
    """Return what counts of rollouts besides errors: ITAE and torque variation, sums over the joints."""
    return [cost(rollout).sum("joint").values for cost in (metrics.itae, metrics.total_variation)]


def outcome(
    rollout: xr.Dataset, draw: Scenario, name: str = "", costs: Sequence[Any] | None = None
) -> Outcome:
    """Return what came out of one rollout of a draw; its ITAE and torque variation where they are known."""
    needed = demand(draw)
    if int(rollout["status"]) == Status.DIVERGED:
        lost = Outcome(name, draw.index, True, False, False, False, *(math.inf,) * 3, needed)
        return lost._replace(final_error=math.inf)
    error = np.abs((rollout["q"] - rollout["q_ref"]).values + sunk(draw, rollout["q_ref"].values))
    time = rollout["time"].values
    end, peak, failed = time > time[-1] - END, float(error.max()), has_failed(error, time)
    itae, variation = map(float, _costs(rollout) if costs is None else costs)
    rest, still = rollout["q"].values[end], rest_band(draw)
    moved = np.ptp(rest, axis=0)
    back = moved - np.abs(rest[-1] - rest[0])
    returning = not failed and bool((back > still).any())
    steps = np.abs(np.diff(rollout["tau"].values[end], axis=0)).mean(axis=0)
    return Outcome(
        name,
        draw.index,
        failed,
        hunting=not failed and bool((moved > still).any()),
        swinging=returning and swings(rollout["q"].values[time > time[-1] - SWING], still),
        chatter=bool((steps > CHATTER * draw.scale).any()),
        peak=peak,
        itae=itae,
        variation=variation,
        demand=needed,
        returning=returning,
        final_error=float(error[-1].max()),
    )


def loop_lag(draw: Scenario) -> float:
    """Return the delay of hold, transport and current loop of a draw [s]."""
    current = 0.0 if draw.gears is None else 1.0 / (2.0 * math.pi * draw.numbers.current)
    return draw.dt * (0.5 + draw.delay) + current


def itae_ratios(found: Sequence[Outcome], reference: Sequence[Outcome]) -> dict[str, float]:
    """Return arm -> geometric mean of ITAE over that of a reference, draw by draw.

    Draws count where the motors can follow (`demand` of at most 1) and neither failed.
    """
    by_draw = {(each.arm, each.index): each for each in reference}
    logs: dict[str, list[float]] = {}
    for each in found:
        other = by_draw.get((each.arm, each.index))
        if other is None or each.demand > 1.0 or each.failed or other.failed:
            continue
        logs.setdefault(each.arm, []).append(math.log(each.itae / other.itae))
    return {arm: math.exp(float(np.mean(values))) for arm, values in logs.items()}


def has_failed(error: Array, time: Array) -> bool:
    """Tell whether errors, (samples, n), exceed the limit of a failed run: at any time, or at the end."""
    return bool(error.max() > FAILED_PEAK or error[time > time[-1] - END].max() > FAILED_END)


def swings(q: Array, band: Array) -> bool:
    """Tell whether joints move to and fro by more than a band about a smooth path, and go on.

    Args:
        q: positions [rad or m], (samples, n): the second half says what is left of the first.
        band: that does not count [rad or m], (n,).
    """
    rest = []
    for half in np.array_split(q, 2):
        # The cubics in time that fit best.
        basis, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, len(half)), 4))
        rest.append(np.ptp(half - basis @ (basis.T @ half), axis=0))
    before, after = rest
    return bool(((after > band) & (after >= LASTING * before)).any())


def sunk(draw: Scenario, q: Array) -> Array:
    """Return by how much gravity lets links sink at q that encoders at motors see at q [rad or m], as q."""
    if draw.gears is None or draw.gears.side == "link":
        return np.zeros_like(q)
    return np.asarray(draw.arm.gravity(q) / draw.gears.stiffness)


def demand(draw: Scenario) -> float:
    """Return the largest share of a motor's torque that following the reference exactly takes."""
    time = np.linspace(0.0, draw.t_final, MOMENTS)
    tau = torques_of(draw.arm, draw.reference.at(time), draw.friction)
    begin, end = draw.step_time
    pushed = tau + np.outer((time >= begin) & (time <= end), draw.torque_step)
    return float((np.maximum(np.abs(tau), np.abs(pushed)) / draw.effort).max())


def torques_of(arm: Robot, target: Target, friction: Friction | None) -> Array:
    """Return the torques that a motion takes, with friction, (samples, n)."""
    tau = arm.inverse_dynamics(*target)
    if friction is not None:
        tau = tau + friction.viscous * target.v + friction.coulomb * np.sign(target.v)
    return np.asarray(tau)


def ideal_law_holds(draw: Scenario) -> bool:
    """Return whether a controller with the exact model holds an elastic arm where it starts and goes.

    The law is GPI with one integrator, the whole model fed forward, and a share of it or heavier rotors in
    the feedback; it is searched (:data:`SEARCHED`). It holds where the sensitivity of the linear sampled
    loop at the plant, with delay, peaks at no more than :data:`MOST_SENSITIVITY`; the law knows the load.
    True for rigid gears.
    """
    if draw.gears is None:
        return True
    arm, dt = draw.arm, draw.dt
    cases = [
        geared.Case(q, two_mass.ArmLoop(arm, q, _linear(draw, q), dt, draw.delay), True)
        for q in (draw.move.start, draw.move.goal)
    ]
    for factor, share, ratio in SEARCHED:
        own = Member(1, 0) if ratio is None else Member(1, 1, ratio)
        nominal: Any = with_heavier_rotors(arm.scaled_inertia(share), factor)
        loops = geared.Loops(cases, nominal, arm, own, dt)
        if any(loops.holds(omega, MOST_SENSITIVITY) for omega in BANDWIDTHS):
            return True
    return False


def _linear(draw: Scenario, q: Array) -> two_mass.Gears:
    """Return the drives of a draw as the linear loop takes them, with damping as ratios at q."""
    assert draw.gears is not None
    rotor, stiffness = draw.arm.armature, draw.gears.stiffness
    gears = two_mass.Gears(rotor, stiffness, current=draw.numbers.current, side=draw.gears.side)
    links = draw.arm.mass_matrix(q) - np.diag(rotor)
    return gears._replace(damping=draw.gears.damping / two_mass.damping_at_one(links, gears))


def rest_band(draw: Scenario) -> Array:
    """Return how far a joint may move at rest [rad or m]."""
    return np.maximum(HUNTING_COUNTS * draw.arm.encoder_count(draw.encoder_bits), HUNTING)


def describe_knowledge(law: Mapping[str, Any]) -> str:
    """Return in words what a law measures and knows, by its section of an experiment file."""
    kind = KINDS[law["type"]].law
    fed = "model" if law["type"] == "gpi_auto" else law.get("feedforward", "none")
    knows = kind.knows if fed == "none" else KNOWS[fed]
    return describe_measurement(kind.measurement_type.__name__, knows)


def markdown(groups: Mapping[str, Sequence[Outcome]], heading: str = "law") -> str:
    """Return outcomes, in groups, as a Markdown table with 95 % intervals of the shares."""
    shares = ("failed", "hunting", "returning", "swinging", "chatter")
    names = (*shares[:1], "failed where feasible", *shares[1:])
    header = (heading, "draws", *(f"{name} [%]" for name in names), "median peak", "median ITAE")
    lines = []
    for label, found in groups.items():
        columns = {name: share([getattr(each, name) for each in found]) for name in shares}
        columns["failed where feasible"] = share([each.failed for each in found if each.feasible])
        medians = (
            metrics.short(float(np.median([getattr(each, name) for each in found])) if found else None, 3)
            for name in ("peak", "itae")
        )
        lines.append((label, str(len(found)), *(columns[name] for name in names), *medians))
    return markdown_table(header, lines)


def share(happened: Sequence[bool], interval: Callable[[int, int], Estimate] = wilson) -> str:
    """Return a share with its interval of 95 %, in per cent (Wilson)."""
    value, low, high = interval(sum(happened), len(happened))
    return f"{100.0 * (value if happened else 0.0):.1f} ({100.0 * low:.1f} to {100.0 * high:.1f})"
