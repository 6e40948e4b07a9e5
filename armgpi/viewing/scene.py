"""What is in the scene and how it moves, as plain data that the page draws.

A :class:`Scene` has an arm: a tree of bodies, one for every joint and one for the base, with its triangles in
the body's frame, so the page moves it by the joints' positions alone. A :class:`Clip` has what moves it: one
rollout or several, thinned to frames.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from armgpi.base.arrays import Array
from armgpi.errors import (
    ArmgpiError,
    ArmgpiWarning,
    ParameterError,
    Remedy,
    RolloutError,
    require_extra,
)
from armgpi.loop.provenance import Provenance
from armgpi.loop.rollout import Status, describe_end
from armgpi.robot import urdf
from armgpi.robot.mesh_files import MeshError
from armgpi.robot.repairs import made_in
from armgpi.robot.robot import Robot
from armgpi.viewing import meshes, tracks
from armgpi.viewing.meshes import Triangles

if TYPE_CHECKING:
    import xarray as xr

#: Triangles of an arm that is drawn; larger meshes are simplified.
TRIANGLES = 150_000
#: Triangles of its coarse version.
COARSE = 20_000
#: Frames a second that playing in real time can show [1/s].
FRAME_RATE = 100.0
#: Memory that all frames may take [B].
FRAME_BYTES = 6_000_000
#: Memory of a joint in a frame of an actor [B]: position, target, torque and disturbance, and a flag.
_BYTES = 17
#: More rollouts than this at once is a crowd.
MOST_ROBOTS = 6
#: Colour of what the URDF gives none.
_PLAIN = np.array([0.72, 0.74, 0.76])
#: A visual farther out than this many reaches is a mistake in the file.
_FAR_OUT = 20.0


_T = TypeVar("_T", Triangles, Triangles | None)


class Body(NamedTuple):
    """A part of the arm that moves as one: what hangs on a joint, or the base.

    Attributes:
        parent: index of the body that it hangs on; -1 for the base.
        joint: name of its joint; empty for the base.
        kind: "revolute" (continuous joints too), "prismatic", or "" for the base.
        coordinate: index of the robot's joint that moves it: its own, or the one that it follows.
        ratio: how far it moves for one unit of that.
        offset: where it is when that is at zero [rad or m].
        placement: of the joint in the parent's frame, homogeneous, shape (4, 4).
        axis: of the joint in its own frame, shape (3,).
        links: names of the links.
        triangles: what is drawn, in the body's frame.
        coarse: the same with few triangles, for the ghost and for slow machines.
        ring: radius around the joint at which its torque is shown [m].
    """

    parent: int
    joint: str
    kind: str
    coordinate: int
    ratio: float
    offset: float
    placement: Array
    axis: Array
    links: tuple[str, ...]
    triangles: Triangles
    coarse: Triangles
    ring: float


class Scene(NamedTuple):
    """An arm to draw.

    Attributes:
        robot: the arm.
        bodies: the base, then one body for every joint of the model; those that follow others too.
        tip_body: index of the body that carries the tool.
        tip: the tool's frame in that body, homogeneous, shape (4, 4).
        size: how far the arm reaches [m].
        drawn_as: "meshes" (or the URDF's primitives), or "sticks" when there was nothing else to draw.
        findings: what could not be drawn, and why.
    """

    robot: Robot
    bodies: tuple[Body, ...]
    tip_body: int
    tip: Array
    size: float
    drawn_as: str
    findings: tuple[str, ...]


class Actor(NamedTuple):
    """One rollout in the scene; arrays have shape (frames, n).

    Attributes:
        label: its name.
        color: of the plots' legend.
        q: positions [rad or m], held after its end.
        q_ref: reference [rad or m].
        tau: torque [N m or N].
        saturated: whether the torque was at its limit from this frame to the next.
        end: how it ended, in words.
        t_end: when it ended [s].
        forces: of contacts on the arm in the base frame [N], shape (frames, contacts, 3).
        points: where they act [m], likewise.
    """

    label: str
    color: str
    q: npt.NDArray[np.float32]
    q_ref: npt.NDArray[np.float32]
    tau: npt.NDArray[np.float32]
    saturated: npt.NDArray[np.uint8]
    end: str
    t_end: float
    forces: npt.NDArray[np.float32]
    points: npt.NDArray[np.float32]


class Wall(NamedTuple):
    """A wall of the plant's environment.

    Attributes:
        normal: direction to its free side, of length 1.
        distance: of its plane from the base, along the normal [m].
        contact: which contact it is.
    """

    normal: tuple[float, ...]
    distance: float
    contact: int


class Clip(NamedTuple):
    """Rollouts as frames.

    Attributes:
        times: of the frames [s], shape (frames,).
        actors: the rollouts.
        disturbance: torque of the loads at the frames [N m or N], shape (frames, n); zero without loads.
        onsets: joint -> when its disturbance sets in [s].
        left_out: how many rollouts are not shown.
        walls: of the first rollout's environment.
    """

    times: Array
    actors: tuple[Actor, ...]
    disturbance: npt.NDArray[np.float32]
    onsets: dict[str, float]
    left_out: int
    walls: tuple[Wall, ...] = ()


def build(robot: Robot, frame: str | None = None) -> Scene:
    """Return the scene of an arm: its own meshes and primitives, and sticks where it has none.

    Args:
        robot: the arm.
        frame: the tool, whose path is drawn; the tip when not given.

    Raises:
        ParameterError: when `robot` is a batch of them.
        NameNotFound: when there is no such frame.
        MissingPackage: when trimesh is not installed.
    """
    if not isinstance(robot, Robot):
        raise ParameterError("robot", robot, "a single Robot; of a RobotBatch, one of its robots")
    require_extra("trimesh", "viz")  # better now than in the middle
    name = robot.tip if frame is None else frame
    robot.frame_pose(name, robot.middle())  # refuses a name that is not there
    model = robot.pinocchio_model()
    tool = _link_frames(model).get(name)
    if tool is None:  # a joint's frame
        tool = model.frames[model.getFrameId(name)]
    findings: list[str] = []
    drawn, links = _visuals(robot, model, findings)
    merged = [None if part is None else _merge_equal_corners(part) for part in drawn]
    size = _size(model, merged)
    fine: list[Triangles] = []
    for index, part in enumerate(_simplify(merged, TRIANGLES)):
        fine.append(_stick(model, index, tool, size) if part is None else part)
    coarse = _simplify(fine, COARSE)
    joints = range(model.njoints)
    bodies = [_body(robot, model, index, links[index], fine, coarse, size) for index in joints]
    return Scene(
        robot=robot,
        bodies=tuple(bodies),
        tip_body=int(tool.parentJoint),
        tip=np.array(tool.placement.homogeneous),
        size=size,
        drawn_as="meshes" if any(drawn) else "sticks",
        findings=tuple(findings),
    )


def _body(
    robot: Robot,
    model: pin.Model,
    index: int,
    links: Sequence[str],
    fine: Sequence[Triangles],
    coarse: Sequence[Triangles],
    size: float,
) -> Body:
    """Return a body of an arm of some size [m], its triangles from those of all bodies."""
    kind, axis = "", np.array([0.0, 0.0, 1.0])
    if index:
        data = model.joints[index].createData()
        model.joints[index].calc(data, np.zeros(1))
        linear, angular = np.split(np.array(data.S).reshape(6), 2)
        kind, axis = ("prismatic", linear) if linear.any() else ("revolute", angular)
    # Which joint of the robot moves it, by which ratio, from which offset.
    coordinate = index - 1
    ratio = 1.0
    offset = 0.0
    if index and robot.coupling is not None:
        ratios = robot.coupling.ratio[index - 1]
        coordinate = int(np.argmax(np.abs(ratios)))
        ratio = float(ratios[coordinate])
        offset = float(robot.coupling.offset[index - 1])
    parent = int(model.parents[index]) if index else -1
    placement = np.array(model.jointPlacements[index].homogeneous)
    return Body(
        parent=parent,
        joint=str(model.names[index]) if index else "",
        kind=kind,
        coordinate=coordinate,
        ratio=ratio,
        offset=offset,
        placement=placement,
        axis=axis,
        links=tuple(links),
        triangles=fine[index],
        coarse=coarse[index],
        ring=_ring(model, index, coarse, axis, size),
    )


def clip(rollout: xr.Dataset, robot: Robot) -> Clip:
    """Return rollouts of a robot as frames, no more of them than can be seen or fit the budget.

    Raises:
        RolloutError: when it has no samples, or its joints are not the robot's.
    """
    names = tuple(str(name) for name in rollout["joint"].values)
    if names != robot.joint_names:
        raise RolloutError(
            f"the rollout's joints are {', '.join(names)}; those of robot {robot.name!r} are "
            f"{', '.join(robot.joint_names)}"
        )
    traces = tracks.traces(rollout, most=None)
    shown = traces[:MOST_ROBOTS]
    time = np.asarray(rollout["time"].values, dtype=float)
    # As many as the budget has room for and the eye can tell apart, evenly spread over the samples.
    most = int(FRAME_BYTES / (_BYTES * len(names) * len(shown)))
    of_the_eye = math.ceil((time[-1] - time[0]) * FRAME_RATE) + 1
    count = max(2, min(len(time), most, of_the_eye))
    frames = np.unique(np.linspace(0, len(time) - 1, count).round().astype(np.int64))
    ends = describe_end(rollout)
    actors = tuple(_actor(trace, frames, ends[i]) for i, trace in enumerate(shown))
    pushed = np.zeros((len(frames), len(names)), dtype=np.float32)
    if "disturbance" in rollout:
        first = shown[0].data["disturbance"].transpose("time", "joint").values
        pushed = _single(np.nan_to_num(first[frames]))
    onsets = {}
    for name in names:
        onset = tracks.disturbance_onset(rollout, name)
        if onset is not None:
            onsets[name] = onset
    return Clip(
        times=time[frames],
        actors=actors,
        disturbance=pushed,
        onsets=onsets,
        left_out=len(traces) - len(shown),
        walls=_recorded_walls(rollout) if actors[0].forces.size else (),
    )


def _recorded_walls(rollout: xr.Dataset) -> tuple[Wall, ...]:
    """Return the walls that a rollout's provenance contains."""
    plant = Provenance.from_rollout(rollout).first.data.get("plant", {})
    return walls(plant.get("environment", ()))


def walls(environment: Sequence[Mapping[str, Any]]) -> tuple[Wall, ...]:
    """Return the walls among contacts, those of one number for all rollouts.

    Args:
        environment: descriptions of the contacts, see ``describe()`` of each contact.
    """
    listed = []
    for i, contact in enumerate(environment):
        distance = contact.get("distance")
        if contact.get("type") == "Wall" and isinstance(distance, float):
            normal = contact["normal"]
            length = float(np.linalg.norm(normal))
            unit_normal = tuple(float(x) / length for x in normal)
            listed.append(Wall(unit_normal, distance, i))
    return tuple(listed)


def robot_of(rollout: xr.Dataset, folder: Path | None = None) -> Robot:
    """Load the plant's robot that a rollout was made with: the same URDF with the same joints locked.

    Args:
        rollout: the rollout.
        folder: where its file lies; a URDF that was copied there is found too.

    Raises:
        RolloutError: when that URDF is not found any more or has changed, or the rollout does not say.
    """
    try:
        made_from = Provenance.from_rollout(rollout).first.robot
        source = str(made_from["source"])
        digest = str(made_from["sha256"])
        locked = {str(name): float(value) for name, value in made_from["locked"].items()}
        mimic: Literal["lock", "follow"] = "follow" if made_from.get("mimic") == "follow" else "lock"
        repair = made_in(made_from)
    except (RolloutError, KeyError, TypeError, ValueError, AttributeError):
        raise RolloutError("the rollout does not record its robot; specify it") from None
    from armgpi.robot import robots

    name = str(rollout.attrs.get("robot", ""))
    candidates: list[Any] = [name] if name in robots.names() else []
    candidates += [Path(source)]
    if folder is not None:
        copies = sorted(folder.glob(f"*{digest[:8]}*.urdf"))
        candidates += [folder / Path(source).name, *copies]
    for candidate in candidates:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ArmgpiWarning)  # it was said when the rollout was made
                robot = Robot.load(candidate, lock=locked, mimic=mimic, repair=repair)
        except ArmgpiError:
            continue
        if robot.provenance["sha256"] == digest:
            return robot
    raise RolloutError(
        f"the robot {name!r} that the rollout was made with ({source}) was not found, or has changed; "
        "specify a robot with the same joints"
    ).suggesting(Remedy("robot"))


# The arm -------------------------------------------------------------------------------------------------


def _visuals(
    robot: Robot, model: pin.Model, findings: list[str]
) -> tuple[list[Triangles | None], list[list[str]]]:
    """Return what the URDF draws on every body, and the bodies' links."""
    frames = _link_frames(model)
    links: list[list[str]] = [[] for _ in range(model.njoints)]
    for name, frame in frames.items():
        links[int(frame.parentJoint)].append(name)
    root = _document(robot, findings)
    if root is None:
        return [None] * model.njoints, links
    named = {material.get("name", ""): _rgb(material) for material in root.iterfind("material")}
    parts: list[list[Triangles]] = [[] for _ in range(model.njoints)]
    for link in root.iterfind("link"):
        frame = frames.get(link.get("name", ""))
        if frame is None:
            continue
        place = np.array(frame.placement.homogeneous)
        for visual in link.iterfind("visual"):
            try:
                shape = _shape(robot, visual)
                shape = meshes.move(shape, place @ _origin(visual))
            except MeshError as error:
                findings.append(f"link {link.get('name', '')!r}: {error}")
                continue
            except (ArmgpiError, ValueError, OverflowError) as error:
                findings.append(f"link {link.get('name', '')!r}: its visual cannot be drawn ({error})")
                continue
            parts[int(frame.parentJoint)].append(_paint(shape, visual, named))
    return [meshes.concatenate(part) if part else None for part in parts], links


def _document(robot: Robot, findings: list[str]) -> ElementTree.Element | None:
    """Return the XML that the robot was loaded from, None when it is not there any more."""
    source = Path(str(robot.provenance["source"]))
    if not source.is_file():
        findings.append("the robot's URDF file was not found, so the links are drawn as lines")
        return None
    try:
        document = urdf.parse(urdf.read_file(source), str(source), made_in(robot.provenance))
    except ArmgpiError as error:
        findings.append(f"{error}; the links are drawn as lines")
        return None
    if document.sha256 != robot.provenance["sha256"]:
        findings.append(f"{source} has changed since the robot was loaded")
    return document.root


def _shape(robot: Robot, visual: ElementTree.Element) -> Triangles:
    """Return the triangles of a visual in its own frame."""
    geometry = visual.find("geometry")
    shape = None if geometry is None else next(iter(geometry), None)
    if shape is None:
        raise ValueError("it has no geometry")
    if shape.tag == "mesh":
        part = meshes.load(robot, shape.get("filename", ""))
        return meshes.move(part, np.eye(4), _numbers(shape.get("scale", "1 1 1"), 3))
    if shape.tag == "box":
        return meshes.box(*_lengths(shape.get("size", ""), 3))
    if shape.tag == "sphere":
        return meshes.sphere(*_lengths(shape.get("radius", ""), 1))
    if shape.tag in ("cylinder", "capsule"):
        radius, length = _lengths(f"{shape.get('radius', '')} {shape.get('length', '')}", 2)
        return meshes.cylinder(radius, length)
    raise ValueError(f"a <{shape.tag}> is none of mesh, box, sphere, cylinder")


def _paint(part: Triangles, visual: ElementTree.Element, named: dict[str, Array | None]) -> Triangles:
    """Return triangles with the URDF's colour where their file has none."""
    material = visual.find("material")
    color = None
    if material is not None:
        color = _rgb(material)
        if color is None:
            color = named.get(material.get("name", ""))
    plain = _PLAIN if color is None else color
    return part._replace(colors=np.where(np.isnan(part.colors), plain, part.colors))


def _rgb(material: ElementTree.Element) -> Array | None:
    """Return the colour of a <material>, None when it has none."""
    element = material.find("color")
    if element is None:
        return None
    try:
        return np.clip(_numbers(element.get("rgba", ""), 4)[:3], 0.0, 1.0)
    except ValueError:
        return None


def _origin(visual: ElementTree.Element) -> Array:
    """Return the <origin> of a visual as a homogeneous matrix (4, 4)."""
    matrix = np.eye(4)
    origin = visual.find("origin")
    if origin is not None:
        matrix[:3, 3] = _numbers(origin.get("xyz", "0 0 0"), 3)
        matrix[:3, :3] = pin.rpy.rpyToMatrix(*_numbers(origin.get("rpy", "0 0 0"), 3))
    return matrix


def _numbers(text: str, count: int) -> Array:
    """Return the numbers of an attribute."""
    numbers = np.array([float(part) for part in text.split()])
    if numbers.shape != (count,) or not (np.abs(numbers) < 1e6).all():
        raise ValueError(f"expected {count} numbers, got {text[:80]!r}")
    return numbers


def _lengths(text: str, count: int) -> Array:
    """Return the positive numbers of an attribute."""
    numbers = _numbers(text, count)
    if not ((numbers > 0.0) & (numbers < 1e3)).all():
        raise ValueError(f"expected positive lengths, got {text[:80]!r}")
    return numbers


def _simplify(parts: list[_T], most: int) -> list[_T]:
    """Return bodies simplified, each by the same share, where together they are too many triangles."""
    total = sum(len(part.faces) for part in parts if part is not None)
    if total <= most:
        return parts
    share = most / total
    simplified = []
    for part in parts:
        if part is not None:
            part = meshes.simplify(part, max(100, int(share * len(part.faces))))
        simplified.append(part)
    return simplified


def _ring(model: pin.Model, index: int, parts: Sequence[Triangles], axis: Array, size: float) -> float:
    """Return how far out a ring around a joint must be to be seen, short of the next joint [m]."""
    # How far the nearest joint is that is not in the same place.
    spacing = size
    for child in range(1, model.njoints):
        parent = int(model.parents[child])
        length = float(np.linalg.norm(model.jointPlacements[child].translation))
        if parent and index in (child, parent) and length > 0.02 * size:
            spacing = min(spacing, length)
    # The body and the one that it hangs on, in the joint's frame.
    to_joint = np.linalg.inv(np.array(model.jointPlacements[index].homogeneous))
    carrier = parts[int(model.parents[index])].points @ to_joint[:3, :3].T + to_joint[:3, 3]
    points = np.concatenate([parts[index].points, carrier])
    along = points @ axis
    out = np.linalg.norm(points - along[:, None] * axis, axis=1)
    is_near = (np.abs(along) < 0.015 * size) & (out < min(0.085 * size, 0.75 * spacing))
    widest = float(out[is_near].max()) if is_near.any() else 0.0
    return float(np.clip(1.15 * widest, 0.035 * size, 0.1 * size))


def _merge_equal_corners(part: Triangles) -> Triangles:
    """Return painted triangles with corners that look the same made one."""
    size = max(float(np.ptp(part.points, axis=0).max()), 1e-9)
    # About as fine as what the page gets: positions to a part in 10^5, normals to half of what a byte has.
    points = np.rint((part.points - part.points.min(axis=0)) * (1e5 / size))
    normals = np.rint(part.normals * 60.0)
    colors = np.rint(part.colors * 255.0)
    rounded = np.hstack([points, normals, colors]).astype(np.int32)
    one_row = np.dtype((np.void, rounded.dtype.itemsize * rounded.shape[1]))
    rows = np.ascontiguousarray(rounded).view(one_row)
    _, first, group = np.unique(rows.ravel(), return_index=True, return_inverse=True)
    faces = group.ravel()[part.faces]
    a, b, c = faces.T
    stays_a_triangle = (a != b) & (b != c) & (c != a)
    return Triangles(part.points[first], part.normals[first], part.colors[first], faces[stays_a_triangle])


def _size(model: pin.Model, drawn: Sequence[Triangles | None]) -> float:
    """Return how far the arm can reach from its base [m]."""
    reach = np.zeros(model.njoints)
    for index in range(1, model.njoints):
        parent = int(model.parents[index])
        length = float(np.linalg.norm(model.jointPlacements[index].translation))
        reach[index] = reach[parent] + length
    for frame in model.frames:
        joint = int(frame.parentJoint)
        distance = float(np.linalg.norm(frame.placement.translation))
        reach[joint] = max(reach[joint], distance)
    largest = float(reach.max())
    clouds = [part.points for part in drawn if part is not None]
    extents = [float(np.linalg.norm(points, axis=1).max()) for points in clouds]
    if extents and (largest <= 0.0 or max(extents) < _FAR_OUT * largest):
        largest = max(largest, *extents)
    if largest <= 1e-6:  # a single joint without a tool: out to where its mass is
        largest = max(float(np.linalg.norm(inertia.lever)) for inertia in model.inertias)
    return largest if largest > 1e-6 else 1.0


def _stick(model: pin.Model, index: int, tool: pin.Frame, size: float) -> Triangles:
    """Return lines from a body's origin to the joints that hang on it, and to the tool, as thin bars.

    Where nothing hangs on it, to its centre of mass: else the last link of an arm would be a dot.
    """
    children = [child for child in range(1, model.njoints) if int(model.parents[child]) == index]
    ends = [np.array(model.jointPlacements[child].translation) for child in children]
    if int(tool.parentJoint) == index:
        ends.append(np.array(tool.placement.translation))
    if index and all(np.linalg.norm(end) <= 1e-3 * size for end in ends):
        ends.append(np.array(model.inertias[index].lever))
    base = 0.08 * size
    parts = [meshes.sphere(0.018 * size) if index else meshes.box(base, base, 0.02 * size)]
    for end in ends:
        length = float(np.linalg.norm(end))
        if length > 1e-3 * size:
            bar = meshes.cylinder(0.01 * size, length)
            parts.append(meshes.move(bar, _along(end)))
    whole = meshes.concatenate(parts)
    return whole._replace(colors=np.broadcast_to(_PLAIN, whole.points.shape))


def _along(end: Array) -> Array:
    """Return the placement (4, 4) of a bar along z that reaches from the origin to a point [m], (3,)."""
    x_axis, y_axis, _ = np.eye(3)
    z = end / float(np.linalg.norm(end))
    x = np.cross(x_axis if abs(z[0]) < 0.9 else y_axis, z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    matrix[:3, 3] = 0.5 * end
    return matrix


def _link_frames(model: pin.Model) -> dict[str, pin.Frame]:
    """Return the frames of links by their names."""
    return {frame.name: frame for frame in model.frames if frame.type == pin.FrameType.BODY}


# The rollouts --------------------------------------------------------------------------------------------


def _actor(trace: tracks.Trace, frames: npt.NDArray[np.int64], end: str) -> Actor:
    """Return one rollout as frames; a pose is held where it has none."""
    q, q_ref, tau = (trace.data[name].transpose("time", "joint").values for name in ("q", "q_ref", "tau"))
    effort = np.atleast_1d(trace.data["effort"].values)
    at_limit = np.abs(tau) >= effort * (1.0 - 1e-9)
    # Between two frames: a torque that touches its limit for a millisecond is seen too.
    saturated = np.maximum.reduceat(at_limit.astype(np.uint8), frames, axis=0)
    return Actor(
        label=trace.label or "actual",
        color=trace.look.color,
        q=_single(_hold_last(q)[frames]),
        q_ref=_single(_hold_last(q_ref)[frames]),
        tau=_single(np.nan_to_num(tau[frames])),
        saturated=saturated,
        end=end if int(trace.data["status"]) != Status.FINISHED else "finished",
        t_end=float(np.nan_to_num(trace.data["t_end"].values)),
        forces=_contacts(trace, "contact_force", frames),
        points=_contacts(trace, "contact_point", frames),
    )


def _contacts(trace: tracks.Trace, name: str, frames: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
    """Return vectors of contacts (frames, contacts, 3); none where they were not recorded."""
    if name not in trace.data:
        return np.zeros((len(frames), 0, 3), dtype=np.float32)
    values = trace.data[name].transpose("time", "contact", "axis").values[frames]
    return _single(np.nan_to_num(values))


def _single(values: Array) -> npt.NDArray[np.float32]:
    """Return values in single precision; what is out of all bounds stays finite."""
    return np.clip(values, -1e30, 1e30).astype(np.float32)


def _hold_last(values: Array) -> Array:
    """Return values (time, n) with the last finite row in place of those that are not; zero before it."""
    is_finite = np.isfinite(values).all(axis=1)
    rows = np.where(is_finite, np.arange(len(values)), -1)
    last = np.maximum.accumulate(rows)
    return np.where(last[:, None] >= 0, values[np.maximum(last, 0)], 0.0)
