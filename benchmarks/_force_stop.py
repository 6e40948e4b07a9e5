"""A stop by the estimated force: hands that stop the arm, and free motions that do not."""

from __future__ import annotations

from typing import Any, ClassVar

import _page
import numpy as np
from _compliant import (
    ARMS,
    BITS,
    DT,
    FRICTION,
    KNOWN,
    ROTORS,
    SEEDS,
    directions,
    drawn,
    friction_at_tool,
    friction_of,
    loop,
    place,
    spread,
)
from _timing import table

import armgpi
from armgpi.base.arrays import Array
from armgpi.base.parameter import parameter, with_parameters
from armgpi.control.force_limit import FREE_FALL
from armgpi.plants.environment import Contact, Wrench
from armgpi.robot.frame_motion import Motion
from armgpi.robot.kinematics import random_configurations
from armgpi.supervisor import Reason

#: Limits of the estimated force [N], the payload that the supervisor reckons with [kg].
LIMITS, MASS = (10.0, 30.0, 60.0), 0.3
#: Hands on each arm: when they begin [s], how fast they grow [N/s], and how large [N].
HANDS, ONSET, GROWTH, MOST = 24, 0.2, 50.0, 400.0
#: Free moves of each arm, their times [s], and the share of the velocity limits that they reach.
MOVES, FAST = 48, (0.3, 0.9)


@with_parameters
class Growing(Contact):
    """A force that grows, in a direction that may differ by rollout.

    Attributes:
        x: of the direction.
        y: likewise.
        z: likewise.
        growth: [N/s].
    """

    config_name: ClassVar[str | None] = None

    x: float = parameter("direction along x", default=0.0)
    y: float = parameter("direction along y", default=0.0)
    z: float = parameter("direction along z", default=0.0)
    growth: float = parameter("growth of the force", unit="N/s", default=0.0)

    def wrench(self, motion: Motion, t: Array) -> Wrench:
        """Return the force."""
        now = t + 0.0 * motion.position[..., 0:1]
        size = np.minimum(self.growth * np.maximum(now - ONSET, 0.0), MOST)
        force = np.concatenate([size * self.x, size * self.y, size * self.z], axis=-1)
        return Wrench(force, 0.0 * force)


def stops(quick: bool) -> None:
    """Print at which force a hand stops an arm, and how often free motion does."""
    limits = ", ".join(f"{limit:g}" for limit in LIMITS)
    _page.say(
        f"Supervisor(tool_force={limits} N, uncertain_mass={MASS:g}) over GPI.auto on stiff joints: rotors "
        f"within {100 * ROTORS:g} %, Coulomb friction of {100 * FRICTION[0]:g} to {100 * FRICTION[1]:g} % of "
        f"the effort, known within a factor of {KNOWN:g}, {BITS[0]} to {BITS[1]} bits, delay of 1 to 3 "
        f"samples, a payload of up to {MASS:g} kg that the model does not have. Hands: {HANDS} on each arm "
        f"at rest, in all directions, growing by {GROWTH:g} N/s. Stopped at: force of the hand [N]; too "
        "early: below the limit. Over the bound: that force over limit, twice friction at the tool and twice "
        "the weight that is not known. Motors weaker: stopped by another check, or not at all. False alarms: "
        f"free moves of all joints at {FAST[0]:g} to {FAST[1]:g} of their velocity limits that TOOL_FORCE "
        "stopped. Median and worst."
    )
    rows = []
    for name in ARMS[:1] if quick else ARMS:
        rows += [_row(name, limit) for limit in LIMITS]
    heads = ["arm", "limit [N]", "stopped", "too early", "stopped at [N]", "over the bound"]
    print(table([*heads, "motors weaker", "false alarms"], rows))


def _row(name: str, limit: float) -> list[Any]:
    """Return the row of an arm under a limit."""
    where = place(name)
    random = np.random.default_rng([SEEDS[name], int(limit)])
    late = 1 + (SEEDS[name] + int(limit)) % 3
    level = friction_of(where.robot, random.uniform(*FRICTION))
    model = where.robot.with_friction(*level)
    law = armgpi.GPI.auto(model, DT, delay=late * DT, bits=17, drives="stiff")
    watched = armgpi.Supervisor(
        tool_force=limit, uncertain_mass=MASS, friction_within=KNOWN, frozen_samples=60, jump=10.0
    )
    how: dict[str, Any] = {"late": late, "supervisor": watched}
    given = drawn(where.robot, level, MASS, HANDS, random)
    along = directions(HANDS, 5)
    hand = "plant.environment.0"
    given |= {f"{hand}.{axis}": along[:, i] for i, axis in enumerate("xyz")}
    given[f"{hand}.growth"] = np.full(HANDS, GROWTH)
    still = armgpi.Hold(np.tile(where.q, (HANDS, 1)))
    length = ONSET + MOST / GROWTH
    pushed = loop(where.robot, law, still, length, [Growing()], 20, **how).run(given)
    stopped = pushed["fault"].values == Reason.TOOL_FORCE
    force = np.minimum(GROWTH * np.maximum(pushed["t_fault"].values - ONSET, 0.0), MOST)
    bounds = []
    for direction in along:
        rubbed = friction_at_tool(where.robot, where.q, KNOWN * level.coulomb, direction)
        bounds.append(limit + 2.0 * (rubbed + FREE_FALL * MASS))
    over = force / np.array(bounds)
    free = _free(name, law, level, how, random)
    return [
        name,
        f"{limit:g}",
        f"{int(stopped.sum())} of {HANDS}",
        int((force[stopped] < limit).sum()),
        spread(force[stopped]) if stopped.any() else "-",
        spread(over[stopped]) if stopped.any() else "-",
        int((~stopped).sum()),
        f"{free} of {MOVES}",
    ]


def _free(name: str, law: Any, level: armgpi.Friction, how: Any, random: np.random.Generator) -> int:
    """Return how many free moves the estimated force stopped."""
    robot = place(name).robot
    known = random_configurations(robot, 2 * MOVES, seed=SEEDS[name] + 10)
    starts, goals = known[:MOVES], known[MOVES:]
    # A Bezier move of the fifth degree peaks at 15/8 of its mean velocity.
    fastest = (np.abs(goals - starts) / robot.limits.velocity).max(axis=1)
    duration = 15.0 / 8.0 * fastest / random.uniform(*FAST, MOVES)
    found = 0
    for some in np.array_split(np.argsort(duration), 6):
        length = float(duration[some].max())
        given = drawn(robot, level, MASS, len(some), random)
        move = armgpi.Bezier(starts[some], goals[some], length)
        made = loop(robot, law, move, length + 0.3, [], 20, **how).run(given)
        found += int((made["fault"].values == Reason.TOOL_FORCE).sum())
    return found
