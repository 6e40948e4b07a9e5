"""A force limit: walls, hands, the circle, and a limit that never acts."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import _page
import numpy as np
from _compliant import (
    ARMS,
    AWAY,
    BITS,
    DT,
    FRICTION,
    KNOWN,
    ROTORS,
    SEEDS,
    Hand,
    Place,
    Surface,
    beside,
    depth,
    directions,
    drawn,
    friction_at_tool,
    friction_of,
    loop,
    place,
    spread,
    tool_of,
)
from _timing import table

import armgpi
from armgpi.base.arrays import Array
from armgpi.control.force_limit import FREE_FALL

#: Walls [N/m], angles from the tool's axis [deg], damping over the root of stiffness, draws of each.
WALLS, ANGLES, DAMPED, DRAWS = (1e3, 1e4, 1e5), (0.0, 30.0, 60.0), 0.2, 4
#: The wall begins so far along the tool's axis, and the target lies so deep behind it [m].
GAP, BEHIND = 0.02, 0.03
#: Limits [N], of the tool's speed [m/s], times of the approach and of the run [s].
LIMITS, SPEED, APPROACH, LENGTH = (10.0, 30.0), 0.25, 1.5, 3.0
#: Whether joints are elastic, and the limit [N].
CASES = ((False, LIMITS[0]), (False, LIMITS[1]), (True, LIMITS[1]))
#: What orientation and bounces depend on: arm, which delay and friction, limit [N] and moment limit [N m].
CAUSES: tuple[tuple[str, int, float, float | None], ...] = (
    ("ur3", 0, 10.0, None),
    ("ur3", 0, 10.0, 10.0),
    ("xarm7", 0, 10.0, None),
    ("xarm7", 0, 10.0, 10.0),
    ("tiago_pro_left_arm", 0, 10.0, None),
    ("tiago_pro_left_arm", 1, 30.0, None),
    ("tiago_pro_left_arm", 0, 30.0, None),
    ("tiago_pro_left_arm", 2, 30.0, None),
)
#: Hands on each arm; how long each pushes, and how long the arm has to come back [s].
HANDS, PUSHED, BACK = 24, 0.4, 2.5
#: After this time behind a wall the tool is not to leave it [s].
SETTLED = 0.3


class Known(NamedTuple):
    """An arm as its controller knows it.

    Attributes:
        place: where it is.
        robot: with friction.
        level: that friction [N m or N].
        late: delay [samples].
    """

    place: Place
    robot: armgpi.Robot
    level: armgpi.Friction
    late: int


class Pressed(NamedTuple):
    """What a limit came to on an arm, one number a wall."""

    over: Array
    bounced: Array
    turned: Array
    straight: Array
    gap: Array  # how far the tool left the wall again at most [m]


class Setting(NamedTuple):
    """A force limit on an arm: as its controller knows it, the controller, and how its loop is made."""

    known: Known
    law: Any
    how: dict[str, Any]
    random: np.random.Generator


def walls(quick: bool) -> None:
    """Print the tables of the force limit."""
    names = ARMS[:1] if quick else ARMS
    _page.say(
        f"Force limit. GPI.auto under limits of {LIMITS[0]:g} and {LIMITS[1]:g} N, target "
        f"{1e3 * BEHIND:g} mm behind walls of 1, 10 and 100 kN/m at 0, 30 and 60 degrees from the tool's "
        f"axis, {DRAWS} draws of each on each arm: rotors within {100 * ROTORS:g} %, Coulomb friction of "
        f"{100 * FRICTION[0]:g} to {100 * FRICTION[1]:g} % of the effort, known within a factor of "
        f"{KNOWN:g}, {BITS[0]} to {BITS[1]} bits, delay of 1 to 3 samples, and a payload that the model does "
        "not have, as heavy as the controller allows for. Over its bound: end force over limit, friction at "
        "the tool and weight of that payload; goal at most 1.1. Bounced: left the wall later than "
        f"{SETTLED:g} s after it touched it; goal 0. Turned: goal 2 degrees; all walls, and those up to 30 "
        "degrees from the axis. Median and worst."
    )
    heads = [
        "arm",
        "joints",
        "limit [N]",
        "walls",
        "over its bound",
        "above 1.1",
        "bounced",
        "turned [deg]",
        "up to 30 degrees",
    ]
    rows = []
    for name in names:
        for i, (elastic, limit) in enumerate(CASES):
            found = _pressed(_setting(name, i, limit, elastic), limit)
            joints = "elastic" if elastic else "stiff"
            count = len(found.over)
            above = int((found.over > 1.1).sum())
            bounced = int(found.bounced.sum())
            rows.append(
                [
                    name,
                    joints,
                    f"{limit:g}",
                    count,
                    spread(found.over),
                    above,
                    bounced,
                    spread(found.turned),
                    spread(found.turned[found.straight]),
                ]
            )
    print(table(heads, rows))


def hands(quick: bool) -> None:
    """Print the table of hands."""
    _page.say(
        f"Hands on the arms of the walls under the same limits, {HANDS} each, of up to what `force_bound` "
        f"says for the configuration (`push`), in all directions for {PUSHED:g} s. Speed of the tool: goal "
        f"{SPEED:g} m/s. Distance {BACK:g} s after: goal 1 mm. Median and worst."
    )
    names = ARMS[:1] if quick else ARMS
    rows = [_hand_row(name, i, elastic, limit) for name in names for i, (elastic, limit) in enumerate(CASES)]
    print(table(["arm", "joints", "limit [N]", "push [N]", "fastest [m/s]", "distance after [mm]"], rows))


def _hand_row(name: str, i: int, elastic: bool, limit: float) -> list[Any]:
    """Return the row of an arm under a limit."""
    setting = _setting(name, i, limit, elastic)
    where, most = (
        setting.known.place,
        setting.law.force_bound(configurations=setting.known.place.q[None]).push,
    )
    given = _hands(setting, limit, most)
    still = armgpi.Hold(np.tile(where.q, (HANDS, 1)))
    made = loop(where.robot, setting.law, still, LENGTH, [Surface(), Hand()], 1, **setting.how)
    path = tool_of(where.robot, made.run(given)).position
    speed = np.linalg.norm(np.diff(path, axis=1), axis=-1).max(axis=1) / DT
    away = 1e3 * np.linalg.norm(path[:, -1] - path[:, 90], axis=-1)
    joints = "elastic" if elastic else "stiff"
    return [name, joints, f"{limit:g}", f"{most:.3g}", spread(speed), spread(away)]


def circles(quick: bool) -> None:
    """Print the circle under limits, and whether a limit that never acts changes a bit."""
    _page.say(
        "Circle of 240 mm in 3 s on stiff joints under a force limit, Coulomb friction of 3 % of the effort "
        "known within 20 %: largest error over that without a limit; goal 1.3. A limit of 1 kN never acts: "
        "torques with the bits of those without a limit."
    )
    rows = []
    for name in ARMS[:1] if quick else ARMS:
        where = place(name)
        level = friction_of(where.robot, 0.03)
        known = where.robot.with_friction(level.viscous, 0.8 * level.coulomb)
        found = {}
        for limit in (None, *LIMITS, 1e3):
            law = armgpi.GPI.auto(known, DT, delay=DT, bits=17, drives="stiff", force_limit=limit)
            arm = armgpi.RigidBodyPlant(where.robot, (), level)
            plant = armgpi.Delayed(armgpi.Encoder(arm, 17), 1)
            q0 = where.circle.at(0.0).q
            found[limit] = armgpi.simulate(plant, law, where.circle, 3.3, q0=q0, backend="compiled")
        errors = {limit: float(armgpi.metrics.tool_error(run)[0]) for limit, run in found.items()}
        same = np.array_equal(found[None]["tau"].values, found[1e3]["tau"].values)
        ratios = [f"{errors[limit] / errors[None]:.3f}" for limit in LIMITS]
        rows.append([name, f"{errors[None]:.3g}", *ratios, "the same" if same else "others"])
    heads = ["arm", "without a limit [mm]", "10 N", "30 N", "bits at 1 kN"]
    print(table(heads, rows))


def _known(name: str, late: int) -> Known:
    """Return an arm as a controller knows it, its friction drawn."""
    where = place(name)
    random = np.random.default_rng([SEEDS[name], late])
    level = friction_of(where.robot, random.uniform(*FRICTION))
    return Known(where, where.robot.with_friction(*level), level, late)


def causes(quick: bool) -> None:
    """Print what orientation and bounces depend on."""
    _page.say(
        "The walls above on arms that missed a goal, stiff joints, with another moment limit and other "
        "delays. Turned: worst at walls of 0, 30 and 60 degrees from the tool's axis. Left by: farthest from "
        f"the wall again, later than {SETTLED:g} s after it was touched."
    )
    rows = []
    for name, i, limit, moment in CAUSES[:1] if quick else CAUSES:
        setting = _setting(name, i, limit, False, moment)
        found = _pressed(setting, limit)
        angles = np.repeat(np.tile(ANGLES, len(WALLS)), DRAWS)
        turned = [f"{found.turned[angles == angle].max():.3g}" for angle in ANGLES]
        gap = f"{1e3 * found.gap.max():.2g}" if found.bounced.any() else "-"
        moment = 0.2 * limit if moment is None else moment
        row = [name, setting.known.late, f"{limit:g}", f"{moment:g}", f"{found.over.max():.3g}"]
        rows.append([*row, ", ".join(turned), int(found.bounced.sum()), gap])
    heads = ["arm", "delay [samples]", "limit [N]", "moment limit [N m]", "over its bound, worst"]
    print(table([*heads, "turned [deg]", "bounced of 36", "left by [mm]"], rows))


def _setting(name: str, i: int, limit: float, elastic: bool, moment: float | None = None) -> Setting:
    """Return a force limit [N], with a moment limit [N m], on an arm, the i-th one."""
    known = _known(name, 1 + (SEEDS[name] + i) % 3)
    model = known.robot
    how: dict[str, Any] = {"late": known.late}
    if elastic:
        model = armgpi.assume_drives(model)
        how["elastic"] = {"gear_stiffness": model.drives.value("stiffness"), "encoder_side": "motor"}
        model = model.with_drives(model.drives.with_value("encoder_side", "motor"))
    law = armgpi.GPI.auto(
        model,
        DT,
        delay=known.late * DT,
        bits=17,
        drives="elastic" if elastic else "stiff",
        force_limit=limit,
        moment_limit=moment,
        speed_limit=SPEED,
    )
    return Setting(known, law, how, np.random.default_rng([int(limit), known.late]))


def _pressed(setting: Setting, limit: float) -> Pressed:
    """Return what a limit came to behind walls."""
    robot = setting.known.place.robot
    (starts, goals), given, allowed, straight = _walls(setting.known, setting.law, limit, setting.random)
    made = loop(
        robot,
        setting.law,
        armgpi.Bezier(starts, goals, APPROACH),
        LENGTH,
        [Surface(), Hand()],
        1,
        **setting.how,
    )
    tool = tool_of(robot, made.run(given))
    deep = depth(tool, given, "plant.environment.0")
    force = given["plant.environment.0.stiffness"][:, None] * np.maximum(deep, 0.0)
    end = force[:, tool.times > LENGTH - 0.3].mean(axis=1)
    touched = np.array([float(tool.times[np.argmax(row)]) for row in deep > 0.0])
    left = (deep <= 0.0) & (tool.times > touched[:, None] + SETTLED)
    gap = np.where(left, -deep, 0.0).max(axis=1)
    return Pressed(end / allowed, left.any(axis=1), tool.turned.max(axis=1), straight, gap)


def _walls(
    known: Known, law: Any, limit: float, random: np.random.Generator
) -> tuple[tuple[Array, Array], dict[str, Array], Array, Array]:
    """Return start and goal of the moves, what is given of the loop, and what forces may be [N].

    These are the bound of the end force, and whether the wall is at most 30 degrees from the tool's axis.
    """
    where, robot = known.place, known.place.robot
    axis = -where.rotation[:, 2]
    cases = [(wall, angle) for wall in WALLS for angle in ANGLES for _ in range(DRAWS)]
    given = drawn(robot, known.level, _unsure(law), len(cases), random)
    normals, goals, allowed = [], [], []
    for i, (_, angle) in enumerate(cases):
        normal = beside(axis, math.radians(angle), random.uniform(0.0, 2.0 * math.pi))
        ahead = GAP + BEHIND / math.cos(math.radians(angle))
        goal = armgpi.inverse_kinematics(
            robot, robot.tip, where.position - ahead * axis, where.rotation, near=where.q
        )
        normals.append(normal)
        goals.append(goal.q)
        level = given["plant.coulomb"][i]
        rubbed = friction_at_tool(robot, goal.q, level, normal)
        weight = FREE_FALL * float(given["plant.payload.mass"][i])
        allowed.append(limit + rubbed + weight)
    normal = np.array(normals)
    surface = "plant.environment.0"
    at = where.position - GAP * axis
    given |= {f"{surface}.{name}": normal[:, i] for i, name in enumerate("xyz")}
    given[f"{surface}.distance"] = normal @ at
    given[f"{surface}.stiffness"] = np.array([wall for wall, _ in cases])
    given[f"{surface}.damping"] = DAMPED * np.sqrt(given[f"{surface}.stiffness"])
    starts = np.tile(where.q, (len(cases), 1))
    straight = np.array([angle <= 30.0 for _, angle in cases])
    given |= {f"plant.environment.1.{name}": np.zeros(len(cases)) for name in ("x", "y", "z")}
    return (starts, np.array(goals)), given, np.array(allowed), straight


def _unsure(law: Any) -> float:
    """Return by how much the payload of a controller's model is uncertain [kg]."""
    return 0.0 if law.payload is None else float(law.payload.heaviest - law.payload.lightest)


def _hands(setting: Setting, limit: float, most: float) -> dict[str, Array]:
    """Return what is given of the loop for hands of up to a force [N], without a wall."""
    known, law, random = setting.known, setting.law, setting.random
    force = directions(HANDS, 5) * random.uniform(min(1.5 * limit, 0.5 * most), most, (HANDS, 1))
    given = drawn(known.place.robot, known.level, _unsure(law), HANDS, random)
    given["plant.payload.mass"] = np.zeros(HANDS)
    given |= {f"plant.environment.1.{name}": force[:, i] for i, name in enumerate("xyz")}
    surface = "plant.environment.0"
    given |= {f"{surface}.{name}": np.full(HANDS, float(name == "z")) for name in "xyz"}
    given[f"{surface}.distance"] = np.full(HANDS, -AWAY)
    given[f"{surface}.stiffness"], given[f"{surface}.damping"] = np.full(HANDS, 1.0), np.zeros(HANDS)
    return given
