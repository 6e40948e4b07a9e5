"""From a checked URDF to a Pinocchio model of a fixed-base arm, with joints locked by name.

What Pinocchio gets is what was read (:mod:`armgpi.robot.assembly`): a tree of fixed, revolute and prismatic
joints, one coordinate each, without geometry. Locking happens there (the joint becomes fixed at its value),
which also works where a link and a joint share a name.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
import pinocchio as pin

from armgpi.base.arrays import Array, as_number, check_choice, frozen
from armgpi.errors import ArmgpiWarning, NameNotFound, ParameterError, Remedy, UrdfError
from armgpi.robot import tensors, tree
from armgpi.robot.assembly import Assembly, join
from armgpi.robot.repairs import ABOUT_CENTRE, ACCEPT, SUPPOSE, UNITS, Repair, Repairs
from armgpi.robot.tree import MULTI_DOF_TYPES, Joint, Link
from armgpi.robot.urdf import Coupled, Urdf

#: Pinocchio's data of a chain needs about 64 B x n^3: 64 joints are 17 MB, 500 would be 8 GB.
MAX_MOVING_JOINTS = 64
#: Most names in a message, and most other things.
_NAMED = 8
_LISTED = 3
Mimic = Literal["lock", "follow"]


class Coupling(NamedTuple):
    """How all coordinates of a model follow from the n that are free: ``ratio @ q + offset``.

    Attributes:
        ratio: shape (m, n).
        offset: shape (m,) [rad or m].
    """

    ratio: Array
    offset: Array


class Built(NamedTuple):
    """A Pinocchio model made from a :class:`Urdf`, and what was decided on the way.

    Attributes:
        model: the model; nq = nv.
        joints: the URDF joint of every coordinate, in the model's order.
        locked: value of every locked joint [rad or m].
        coupling: how the coordinates follow from fewer free ones; None when all of them are free.
        repairs: the repairs that were made, in the file and in the tree with these joints locked.
        assembly: what the model was made of.
    """

    model: pin.Model
    joints: tuple[Joint, ...]
    locked: Mapping[str, float]
    coupling: Coupling | None
    repairs: tuple[Repair, ...]
    assembly: Assembly


#: An arm's mass over its reach squared where its file tells none [kg/m^2]: UR3e, UR5e, UR10e, Panda, iiwa 7,
#: xArm 7 have 20 to 45 by data sheets (as cited, not looked up again). A link has a share by its length, and
#: this one of the reach on top; radius of a rod, as a share of the reach; shortest reach [m].
_MASS_OVER_REACH, _STUB, _RADIUS, _SHORTEST = 28.0, 0.05, 0.05, 0.01
#: Its largest weight times reach over the largest effort: the strongest joint could hold it three times, with
#: its centre at 0.4 of the reach.
_WEIGHT = 1.0 / (3.0 * 0.4)


def build(
    urdf: Urdf,
    lock: Sequence[str] | Mapping[str, float] = (),
    keep: Sequence[str] | None = None,
    mimic: Mimic = "lock",
) -> Built:
    """Build the Pinocchio model of `urdf` with some joints locked.

    Args:
        urdf: the checked URDF.
        lock: names of joints to lock at zero (or at the limit nearest to zero), or name -> value.
        keep: when given, every moving joint that is not named here is locked.
        mimic: whether joints that mimic another are locked or follow it.

    Raises:
        NameNotFound: when a name is not that of a moving joint.
        ArrayError: when a value to lock at is no finite number.
        ParameterError: when a joint shall be both locked and kept.
        UrdfError: when a joint type is not supported, no moving joint is left, a moving link has no
            possible inertia, or Pinocchio refuses.
    """
    check_choice(mimic, "mimic", ("lock", "follow"))
    locked = _locked_values(urdf, lock, keep, mimic)
    moving = [j for j in urdf.joints.values() if j.moves and j.name not in locked]
    _check_obstacles(urdf, {joint.name for joint in moving}, locked, keep, mimic)
    _check_joints(urdf, moving, locked)
    moved = urdf.moved_links(locked)
    repairs = Repairs(urdf.source, urdf.wanted, urdf.repairs)
    links = [
        _check_link(convert(link, repairs), repairs) if link.name in moved else link
        for link in urdf.links.values()
    ]
    if not any(urdf.links[name].mass > 0.0 for name in moved):
        if not any(name.partition(":")[0] == SUPPOSE for name in urdf.wanted):
            _refuse_shapes_alone(urdf, moved)
        links = _suppose_bodies(urdf, links, locked, repairs)
    assembly = _assembly(urdf, links, locked)
    model = _pinocchio_model(assembly, urdf.source)
    joints = tuple(map(urdf.joints.__getitem__, list(model.names)[1:]))
    if not model.nq == model.nv == len(joints) == len(moving):
        raise UrdfError(
            urdf.source,
            f"Pinocchio made {len(joints)} joints with {model.nq} coordinates of {len(moving)} moving joints",
        )
    coupling = _coupling(urdf, joints) if mimic == "follow" else None
    return Built(model, joints, locked, coupling, tuple(repairs.made), assembly)


def _check_joints(urdf: Urdf, moving: Collection[Joint], locked: Mapping[str, float]) -> None:
    """Refuse no moving joint at all, and too many of them."""
    if not moving:
        if locked:
            left = "left (revolute, continuous or prismatic); lock fewer, or keep some"
        else:
            left = "(revolute, continuous or prismatic), so there is nothing to control"
        raise UrdfError(urdf.source, f"has no moving joint {left}")
    if len(moving) > MAX_MOVING_JOINTS:
        raise UrdfError(
            urdf.source,
            f"has {len(moving)} moving joints, more than the {MAX_MOVING_JOINTS} allowed; lock some of them "
            "or keep only those of an arm (keep=[...])",
        ).suggesting(Remedy("keep"))


def _check_obstacles(
    urdf: Urdf,
    moving: Collection[str],
    locked: Mapping[str, float],
    keep: Sequence[str] | None,
    mimic: Mimic,
) -> None:
    """Refuse what a tree of rigid bodies on a fixed base does not have, while a joint moves on which it acts.

    All of it at once, or joints would have to be locked one refusal after the other. What is proposed to be
    locked was tried.
    """
    obstacles = _obstacles(urdf, moving, locked)
    if not obstacles:
        return
    names = tuple(dict.fromkeys(name for each in obstacles for name in each.joints))
    others_move = bool(set(moving) - set(names))
    said = _in_words(urdf, obstacles, names, others_move)
    if not others_move:
        raise UrdfError(urdf.source, said, names[0])
    remedy = Remedy("lock", names)
    if keep is not None:  # what is kept cannot be locked as well
        remedy = Remedy("keep", tuple(name for name in _name_list(keep, "keep") if name not in names))
    refused = UrdfError(urdf.source, said, names[0]).suggesting(remedy)
    places = {name: urdf.joints[name].nearest_to_zero() for name in names}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ArmgpiWarning)  # of what is not loaded
            build(urdf, {**locked, **places}, mimic=mimic)
    except UrdfError as error:
        after = str(error).removeprefix(f"{urdf.source}: ")
        raise UrdfError(urdf.source, f"{said}. What is refused then: {after}", names[0]) from error
    raise refused


def _obstacles(urdf: Urdf, moving: Collection[str], locked: Mapping[str, float]) -> list[Coupled]:
    """Return what an arm cannot have: joints of several coordinates, springs, tendons, loops."""
    found = [
        Coupled(f"joint {joint.name!r} that is {joint.type}", (joint.name,))
        for joint in urdf.joints.values()
        if joint.type in MULTI_DOF_TYPES and joint.name not in locked
    ]
    acting: dict[str, list[str]] = {}
    for what, joints in urdf.coupled:
        acting.setdefault(what, []).extend(name for name in joints if name in moving)
    for what, names in acting.items():
        if names:
            found.append(Coupled(what, tuple(dict.fromkeys(names))))
    return found


def _in_words(urdf: Urdf, obstacles: Sequence[Coupled], names: Sequence[str], others_move: bool) -> str:
    """Return what stands against an arm, and what to do about it."""
    first, several = obstacles[0], len(obstacles) > 1
    nothing_left = "" if others_move else "; no other joint moves, so locking leaves no arm"
    if not several and (joint := urdf.joints[first.joints[0]]).type in MULTI_DOF_TYPES:
        return (
            f"joint {joint.name!r} is {joint.type}; armgpi needs a fixed base and revolute, continuous "
            f"or prismatic joints: lock it (lock=[{joint.name!r}]) or make it fixed{nothing_left}"
        )
    what = _listed([each.what for each in obstacles], "; ", str, _LISTED)
    acts, out = ("acts", "take it out") if not several else ("act", "take out what acts on them")
    way = f"lock {'these joints' if several else 'what it acts on'}, or {out}" if others_move else out
    return (
        f"has {what}, which {acts} on {_listed(names)}; armgpi simulates a tree of rigid bodies on a fixed "
        f"base alone: {way} of the file{nothing_left}"
    )


def _listed(
    words: Sequence[str], between: str = ", ", write: Callable[[str], str] = repr, most: int = _NAMED
) -> str:
    """Return words for a message, the first ones of many."""
    more = len(words) - most
    return between.join(map(write, words[:most])) + (f" and {more} more" if more > 0 else "")


def convert(link: Link, repairs: Repairs) -> Link:
    """Return a link whose mass properties were asked to be taken for ones in other units, in SI."""
    for kind, unit in UNITS.items():
        if link.mass <= 0.0 or not repairs.wants(kind, link.name):
            continue
        before = f"mass {link.mass:g}, centre {join(link.xyz)}, inertia {join(link.inertia)}"
        inertia = tuple(unit.inertia * moment for moment in link.inertia)
        if unit.products != 1.0:
            xx, xy, xz, yy, yz, zz = inertia
            inertia = (xx, *(unit.products * xy, unit.products * xz), yy, unit.products * yz, zz)
        if kind == ABOUT_CENTRE:
            rotation = pin.rpy.rpyToMatrix(np.array(link.rpy))
            added = tensors.carried(link.mass, link.xyz, rotation)
            inertia = tensors.as_values(tensors.as_matrix(link.inertia) - added)
        xyz = tuple(unit.centre * x for x in link.xyz)
        link = replace(link, mass=unit.mass * link.mass, xyz=xyz, inertia=inertia)
        after = f"mass {link.mass:g}, centre {join(link.xyz)}, inertia {join(link.inertia)}"
        repairs.make(kind, link.name, unit.meaning, before, after)
    return link


def _check_link(link: Link, repairs: Repairs) -> Link:
    """Return a link that moves, refusing an inertia that no body has: not positive, or without mass."""
    where, smallest, largest = f"link {link.name!r}", float(link.moments()[0]), max(map(abs, link.inertia))
    if link.missing:
        raise UrdfError(repairs.source, f"{where} has an <inertial> without <{link.missing}>", link.name)
    if smallest < -1e-9 * max(1e-6, largest):
        return _check_tensor(link, smallest, repairs)
    if link.mass > 0.0 or largest == 0.0:
        return link
    before = f"mass 0, inertia {join(link.inertia)}"
    repairs.make(
        "drop-inertia", link.name, f"{where} has an inertia but no mass", before, "a frame, without inertia"
    )
    return replace(link, inertia=(0.0,) * 6)


def _check_tensor(link: Link, smallest: float, repairs: Repairs) -> Link:
    """Return a link whose inertia is not positive with one that was asked for."""
    before = f"inertia {join(link.inertia)}"
    problem = f"link {link.name!r} has an inertia that is not positive (smallest eigenvalue {smallest:g})"
    reading = tensors.only_reading(link.inertia)
    if reading is not None and f"{ACCEPT}:{link.name}" not in repairs.wanted:
        after = f"{join(reading.values)}, read {reading.order}"
        problem += f"; it is when it is read {reading.order}"
        repairs.make("reorder-inertia", link.name, problem, before, after)
        return replace(link, inertia=reading.values)
    after = "it is; not guaranteed: D(q) is positive at all q (17 are checked), other simulators load it"
    problem += "; take it from CAD again, in kg m^2, or accept it if an identification gave it"
    repairs.make(ACCEPT, link.name, problem, before, after)
    return link


def _refuse_shapes_alone(urdf: Urdf, moved: Collection[str]) -> None:
    """Refuse a robot without any mass: many a URDF was made for drawing and planning alone."""
    names = [name for name in urdf.links if name in moved]
    raise UrdfError(
        urdf.source,
        f"has no mass in any moving link ({_listed(names)}), so it describes the kinematics only; add an "
        "<inertial> with mass and inertia to each link, or take a URDF that has them, from the robot's "
        f"maker or from CAD; or identify it from a log by armgpi identify, with --repair {SUPPOSE}",
        names[0],
    ).suggesting(Remedy("repair", (), SUPPOSE))


def _suppose_bodies(
    urdf: Urdf, links: Sequence[Link], locked: Mapping[str, float], repairs: Repairs
) -> list[Link]:
    """Return links of which each that a joint moves is a rod to the next joint or to the tip."""
    model = _pinocchio_model(_assembly(urdf, links, locked), urdf.source)
    rods = np.zeros((model.njoints, 3))
    ends = [(int(model.parents[i]), model.jointPlacements[i]) for i in range(2, model.njoints)]
    for joint, placement in [*ends, *((int(x.parentJoint), x.placement) for x in model.frames)]:
        rods[joint] = max(rods[joint], np.array(placement.translation), key=np.linalg.norm)
    sizes = np.linalg.norm(rods[1:], axis=1)
    reach = max(float(sizes.sum()), _SHORTEST)
    efforts = [urdf.joints[name].effort for name in list(model.names)[1:]]
    heaviest = _WEIGHT * max(x if x > 0.0 else math.inf for x in efforts) / (9.81 * reach)
    total = min(_MASS_OVER_REACH * reach**2, heaviest)
    shares = (sizes + _STUB * reach) / (sizes + _STUB * reach).sum()
    found = {link.name: link for link in links}
    columns = (rods[1:].tolist(), sizes.tolist(), shares.tolist())
    for name, rod, size, share in zip(list(model.names)[1:], *columns, strict=True):
        mass = total * share
        moment = mass * (size**2 / 12.0 + (_RADIUS * reach) ** 2)
        link = urdf.joints[name].child
        inertia = (moment, 0.0, 0.0, moment, 0.0, moment)
        found[link] = replace(
            found[link], mass=mass, xyz=tuple(0.5 * x for x in rod), inertia=inertia, inertial=True
        )
        repairs.make(SUPPOSE, link, "has no mass", "no mass", f"{mass:.3g} kg, a rod of {size:.3g} m")
    return list(found.values())


def _locked_values(
    urdf: Urdf, lock: Sequence[str] | Mapping[str, float], keep: Sequence[str] | None, mimic: Mimic
) -> dict[str, float]:
    """Return the value of every joint to lock: those asked for, those not kept, and mimic joints."""
    asked = _joints_to_lock(urdf, lock, keep, mimic)
    values: dict[str, float] = {}
    for name, value in asked.items():
        joint = urdf.joints[name]
        values[name] = joint.nearest_to_zero() if value is None else as_number(value, f"lock[{name!r}]")
        if joint.type in MULTI_DOF_TYPES and values[name] != 0.0:
            raise ParameterError(
                f"lock[{name!r}]", value, f"0, as a {joint.type} joint is locked at its origin"
            )
    left: dict[str, dict[str, float]] = {}  # of a joint that moves: those that mimic it and are locked
    for joint in urdf.joints.values():
        if joint.mimic is not None and _lock_follower(urdf, joint, values, mimic):
            left.setdefault(joint.mimic, {})[joint.name] = values[joint.name]
    for leader, followers in left.items():
        _warn_of_locked(leader, followers, urdf.source)
    return values


def _warn_of_locked(leader: str, values: Mapping[str, float], source: str) -> None:
    """Say that joints are locked that mimic one that moves, and at which values."""
    who, they = f"joints {', '.join(values)} mimic", "they are"
    if len(values) == 1:
        who, they = f"joint {next(iter(values))!r} mimics", "it is"
    places = ", ".join(dict.fromkeys(f"{value:g}" for value in values.values()))
    warnings.warn(
        f"{source}: {who} {leader!r}; {they} locked at {places}, "
        f"so lock {leader!r} as well if they move one gripper, or let it follow (mimic='follow')",
        ArmgpiWarning,
        stacklevel=6,  # where the user calls Robot.load
    )


def _joints_to_lock(
    urdf: Urdf, lock: Sequence[str] | Mapping[str, float], keep: Sequence[str] | None, mimic: Mimic
) -> dict[str, float | None]:
    """Return the joints to lock by name, or by not being kept, with the value that was given for them."""
    moving = [name for name, joint in urdf.joints.items() if joint.type != "fixed"]
    asked: dict[str, float | None] = (
        dict(lock) if isinstance(lock, Mapping) else dict.fromkeys(_name_list(lock, "lock"))
    )
    kept = [] if keep is None else _name_list(keep, "keep")
    for name in (*asked, *kept):
        if name not in moving:
            raise NameNotFound("moving joint", name, moving)
        if name in kept and name in asked:
            raise ParameterError("lock", name, "a joint that is not listed in keep")
    if keep is not None:
        for name in moving:
            followed = mimic == "follow" and tree.mimic_leader(urdf.joints, name).joint.name in kept
            if name not in kept and not followed:
                asked.setdefault(name, None)
    return asked


def _lock_follower(urdf: Urdf, joint: Joint, values: dict[str, float], mimic: Mimic) -> bool:
    """Lock a joint that mimics another where it would have followed to, or let it follow.

    Returns:
        Whether it is locked while the other one moves.
    """
    if not joint.moves or joint.name in values:
        return False
    leader, ratio, offset = tree.mimic_leader(urdf.joints, joint.name, values)
    held = leader.name in values
    if leader.mimic is not None and not held:
        raise UrdfError(
            urdf.source,
            f"joint {leader.name!r} mimics {leader.mimic!r}, which does not exist; correct the name, "
            "or lock it",
            leader.name,
        ).suggesting(Remedy("lock", (leader.name,)))
    leader_moves = leader.moves and not held
    if leader_moves and mimic == "follow":
        return False
    values[joint.name] = offset + ratio * values.get(leader.name, 0.0)
    return leader_moves


def _coupling(urdf: Urdf, joints: Sequence[Joint]) -> Coupling | None:
    """Return how all of `joints` follow from the free ones among them; None when all are free."""
    free = [joint.name for joint in joints if joint.mimic is None]
    if len(free) == len(joints):
        return None
    ratio, offset = np.zeros((len(joints), len(free))), np.zeros(len(joints))
    for row, joint in enumerate(joints):
        leader, factor, shift = tree.mimic_leader(urdf.joints, joint.name)
        ratio[row, free.index(leader.name)], offset[row] = factor, shift
    return Coupling(frozen(ratio), frozen(offset))


def _name_list(value: Any, name: str) -> list[Any]:
    """Return joint names given as one name or several."""
    if isinstance(value, str):
        return [value]
    names: list[Any] = [None]
    with suppress(TypeError):
        names = list(value)
    if not all(isinstance(joint, str) for joint in names):
        raise ParameterError(name, value, "names of joints")
    return names


def _assembly(urdf: Urdf, links: Iterable[Link], locked: Mapping[str, float]) -> Assembly:
    """Return what the model is made of."""
    return Assembly(urdf.name, urdf.base, tuple(links), tuple(urdf.joints.values()), dict(locked))


def _pinocchio_model(assembly: Assembly, source: str) -> Any:
    """Return the model, turning Pinocchio's refusal into one of the file."""
    try:
        return assembly.model()
    except (ValueError, RuntimeError, UnicodeError) as error:
        raise UrdfError(source, f"is refused by Pinocchio: {' '.join(str(error).split())}") from None
