"""Whether an arm stays clear of itself, of a floor and of a box, by its collision shapes and a margin."""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.robot.collisions import read_shapes
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot

#: Margin over the arm's length, where none is specified: 2 cm for an arm of 1 m.
MARGIN = 0.02
#: Configurations by which pairs are judged whose shapes overlap by their design, and the share of them in
#: which a pair touches from which it is one of these: coarse shapes of neighbouring links.
_LOOKED, _OVERLAP = 60, 0.5
#: Cosine of the angle to the vertical up to which a first axis is vertical, and the least height of a first
#: joint above the lowest fixed shape that makes a robot one that stands [m].
_VERTICAL, _STANDS = 0.99, 0.3
#: Share of the configurations that are below a floor from which an arm does not stand on it.
_BELOW = 0.95
#: Size of the box that represents a floor, over the arm's length; its thickness [m].
_FLOOR_SIZE, _FLOOR_DEPTH = 4.0, 1.0
#: Points between the origins of two links that are looked at where an arm has no shapes.
_BETWEEN = 8
#: The first pass over a motion takes every so many rows: most motions that collide are found by it.
_COARSE = 16


class Hit(NamedTuple):
    """Two things that come closer than the margin.

    Attributes:
        first, second: names of links, "floor" or "box".
        row: the configuration in which they were found.
    """

    first: str
    second: str
    row: int


class Clearance:
    """An arm with its collision shapes, a floor and a box.

    Attributes:
        margin: distance below which two things count as touching [m].
        length: of the arm, stretched out [m].
        floor: height of the floor [m]; None for none.
        box: two opposite corners [m], (2, 3), the lower one first; None for none.
        checked: whether the arm has shapes, so that its own links were compared.
        missing: links of which a collision shape is invalid, or its mesh was not found or cannot be read.
        overlapping: pairs of links whose shapes overlap by design, which were not compared.
    """

    def __init__(
        self,
        robot: Robot,
        margin: float | None = None,
        floor: float | None = None,
        box: Array | None = None,
        package_dirs: Iterable[str | PathLike[str]] = (),
        own: bool = True,
    ) -> None:
        """Read the shapes.

        Args:
            robot: the arm.
            margin: [m]; a share of 0.02 of the arm's length if None.
            floor: its height in the base's frame [m]; None for none.
            box: two opposite corners [m], (2, 3); None for none.
            package_dirs: folders in which meshes are looked for as well.
            own: whether the arm's own links are compared with each other.
        """
        import pinocchio as pin  # here: it is slow to import

        self._pin, self._robot, self._own_wanted = pin, robot, own
        self._model = robot.pinocchio_model()
        self._data = self._model.createData()
        shapes = read_shapes(robot, package_dirs)
        self.missing = shapes.missing
        self._exact = pin.GeometryModel() if shapes.model is None else shapes.model
        if not own:
            self._exact.removeAllCollisionPairs()
        self.checked = bool(len(self._exact.collisionPairs))
        self._reach = _reaches(self._model, self._exact)
        self.length = float(self._reach[0])
        self.margin = MARGIN * self.length if margin is None else margin
        self.floor = floor
        self.box = None if box is None else np.sort(np.asarray(box, dtype=np.float64), axis=0)
        self._own = int(self._exact.ngeoms)
        self._hulls = _hulls(pin, self._exact)
        self.overlapping = self._drop_overlapping() if self.checked else ()
        self._add_obstacles()
        self._results = [each.createData() for each in (self._hulls, self._exact)]
        for results in self._results:
            for index, request in enumerate(results.collisionRequests):
                request.security_margin = self._margins[index]

    def describe(self) -> str:
        """Return in lines what a motion was compared with, and what was not."""
        lines = []
        if self.checked:
            margin = f"{1e3 * self.margin:.3g} mm"
            lines.append(f"No collision of the arm with itself, with a margin of {margin}; collision shapes.")
        elif self._own_wanted:
            lines.append(
                "NOT CHECKED: collision of the arm with itself. It has no collision shapes that were found; "
                "--package-dir names a folder of meshes."
            )
        else:
            lines.append("NOT CHECKED: collision of the arm with itself, as was specified.")
        if self.missing:
            why = "their collision shape is invalid or its mesh was not found"
            lines.append(f"NOT CHECKED, {why}: {', '.join(self.missing)}.")
        if self.overlapping:
            pairs = ", ".join(f"{first} and {second}" for first, second in self.overlapping)
            lines.append(f"Not compared, their shapes overlap in most configurations: {pairs}.")
        parts = "collision shapes" if self._own else "origins of the frames"
        if self.floor is not None:
            lines.append(
                f"The {parts} of all links but the first stay above a floor at {self.floor:.3g} m in the "
                "base frame."
            )
        else:
            lines.append("No floor was assumed: --floor specifies one.")
        if self.box is not None:
            lines.append("The motion stays outside the box.")
        lines.append("Other obstacles, cables and tools are not known: watch the motion before it runs.")
        return "\n".join(lines)

    def first_hit(self, positions: Array) -> Hit | None:
        """Return where an arm comes closer to something than the margin.

        Args:
            positions: configurations in their order [rad or m], shape (k, n).

        Returns:
            The first one that was found; not the first one in time. None where there is none.
        """
        rows = np.atleast_2d(np.asarray(positions, dtype=np.float64))
        if self._robot.coupling is not None:
            rows = rows @ self._robot.coupling.ratio.T + self._robot.coupling.offset
        order = [*range(0, len(rows), _COARSE), *(i for i in range(len(rows)) if i % _COARSE)]
        for row in order:
            hit = self._lines_hit(rows[row]) or self._touches(rows[row])
            if hit is not None:
                return Hit(*hit, row)
        return None

    def dense(self, positions: Array) -> Array:
        """Return the rows of a motion that are to be looked at, (k,).

        Between two of them no point of the arm moves farther than the margin, so nothing is passed over.
        """
        q = np.atleast_2d(np.asarray(positions, dtype=np.float64))
        ratio = np.eye(q.shape[1]) if self._robot.coupling is None else self._robot.coupling.ratio
        way = np.append(0.0, np.cumsum(np.abs(np.diff(q @ ratio.T, axis=0)) @ self._reach))
        steps = np.floor(way / max(self.margin, 1e-6))
        kept = np.flatnonzero(np.append(True, np.diff(steps) > 0.0))
        return np.unique(np.append(kept, len(q) - 1))

    def _touches(self, q: Array) -> tuple[str, str] | None:
        """Return two things whose shapes are closer than the margin in one configuration of the model."""
        if not len(self._hulls.collisionPairs):
            return None
        pin, (hulls, exact) = self._pin, self._results
        if not pin.computeCollisions(self._model, self._data, self._hulls, hulls, q, False):
            return None
        pin.updateGeometryPlacements(self._model, self._data, self._exact, exact)
        for index, result in enumerate(hulls.collisionResults):
            # A hull contains its shape: what the hulls do not touch, the shapes do not.
            if result.isCollision() and pin.computeCollision(self._exact, exact, index):
                pair = self._exact.collisionPairs[index]
                return self._name(pair.first), self._name(pair.second)
        return None

    def _name(self, index: int) -> str:
        """Return the name of the link of a shape, or of the obstacle."""
        if index >= self._own:
            return str(self._exact.geometryObjects[index].name)
        return str(self._model.frames[self._exact.geometryObjects[index].parentFrame].name)

    def _drop_overlapping(self) -> tuple[tuple[str, str], ...]:
        """Leave out pairs of shapes that overlap in most configurations; keep others close without a margin.

        Returns:
            The names of the links of those left out.
        """
        pin, results = self._pin, self._exact.createData()
        rows = random_configurations(self._robot, _LOOKED, seed=0)
        if self._robot.coupling is not None:
            rows = rows @ self._robot.coupling.ratio.T + self._robot.coupling.offset
        counts = []
        for margin in (0.0, self.margin):
            quick = self._hulls.createData()
            for request in (*quick.collisionRequests, *results.collisionRequests):
                request.security_margin = margin
            counts.append(np.zeros(len(self._exact.collisionPairs)))
            for q in rows:
                pin.computeCollisions(self._model, self._data, self._hulls, quick, q, False)
                pin.updateGeometryPlacements(self._model, self._data, self._exact, results)
                for index, result in enumerate(quick.collisionResults):
                    known = len(counts) == 2 and counts[0][index] > _OVERLAP * _LOOKED
                    if not known and result.isCollision():
                        counts[-1][index] += pin.computeCollision(self._exact, results, index)
        apart = counts[0] <= _OVERLAP * _LOOKED
        # Two links whose clearance is always small, as those of a wrist, are compared without a margin.
        close = counts[1] > _OVERLAP * _LOOKED
        self._margins = np.where(close, 0.0, self.margin)[apart].tolist()
        pairs = [(int(pair.first), int(pair.second)) for pair in self._exact.collisionPairs]
        for model in (self._exact, self._hulls):
            model.removeAllCollisionPairs()
            for pair, own in zip(pairs, apart, strict=True):
                if own:
                    model.addCollisionPair(pin.CollisionPair(*pair))
        left_out = (pair for pair, own in zip(pairs, apart, strict=True) if not own)
        return tuple(sorted({(self._name(first), self._name(second)) for first, second in left_out}))

    def _add_obstacles(self) -> None:
        """Add floor and box to the shapes, with the links that may touch them."""
        if not self.checked:
            self._margins = []
        import coal

        pin, obstacles = self._pin, []
        if self.floor is not None:
            size = _FLOOR_SIZE * self.length
            place = np.array([0.0, 0.0, self.floor - 0.5 * _FLOOR_DEPTH])
            obstacles.append(("floor", coal.Box(size, size, _FLOOR_DEPTH), place, 1))
        if self.box is not None:
            obstacles.append(("box", coal.Box(*(self.box[1] - self.box[0])), self.box.mean(axis=0), 0))
        for name, shape, place, fixed in obstacles:
            for model in (self._exact, self._hulls):
                pose = pin.SE3(np.eye(3), place)
                index = model.addGeometryObject(pin.GeometryObject(name, 0, 0, pose, shape))
                for other in range(self._own):
                    # The first link turns on the floor that carries it.
                    if model.geometryObjects[other].parentJoint > fixed:
                        model.addCollisionPair(pin.CollisionPair(other, index))
            self._margins += [self.margin] * (len(self._exact.collisionPairs) - len(self._margins))

    def _lines_hit(self, q: Array) -> tuple[str, str] | None:
        """Return a link's origin below the floor, or a line from origin to origin in the box.

        That is all there is to look at for a link without shapes.
        """
        if self.floor is None and self.box is None:
            return None
        pin, model, data = self._pin, self._model, self._data
        pin.framesForwardKinematics(model, data, q)
        if self.box is not None:
            tip = self._robot._frame(self._robot.tip)
            parents = [*[*model.parents][1:], int(model.frames[tip].parentJoint)]
            ends = [*(data.oMi[i].translation for i in range(1, model.njoints)), data.oMf[tip].translation]
            begins = np.array([data.oMi[i].translation for i in parents])
            shares = np.linspace(0.0, 1.0, _BETWEEN + 2)[:, None, None]
            lines = begins + shares * (np.array(ends) - begins)
            inside = ((lines > self.box[0] - self.margin) & (lines < self.box[1] + self.margin)).all(axis=-1)
            if inside.any():
                return str(model.names[int(np.argwhere(inside)[0][1]) % model.njoints]), "box"
        if self.floor is not None:
            for i, frame in enumerate(model.frames):
                if int(frame.parentJoint) > 1 and data.oMf[i].translation[2] < self.floor + self.margin:
                    return str(frame.name), "floor"
        return None


def usual_floor(robot: Robot, package_dirs: Iterable[str | PathLike[str]] = ()) -> float | None:
    """Return the height of the floor of an arm that stands [m]: that of its lowest fixed shape.

    An arm stands where gravity points down and its first axis is vertical, or its first joint is well above
    what is fixed. None for others, as those of pendulums, and where the arm would be below that floor in most
    configurations.
    """
    import pinocchio as pin

    model = robot.pinocchio_model()
    gravity = np.array(model.gravity.linear)
    if -gravity[2] < _VERTICAL * float(np.linalg.norm(gravity)) or not gravity.any():
        return None
    shapes = read_shapes(robot, package_dirs).model
    floor = 0.0 if shapes is None else _lowest(shapes)
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    height = float(data.oMi[1].translation[2])
    upright = abs(float((np.asarray(data.oMi[1].rotation) @ _axis(model))[2])) > _VERTICAL
    if height < floor or not (upright or height - floor > _STANDS):
        return None
    clear = Clearance(robot, floor=floor, package_dirs=package_dirs, own=False)
    hits = [clear.first_hit(q) for q in random_configurations(robot, _LOOKED, seed=0)]
    below = sum(hit is not None for hit in hits)
    return floor if below < _BELOW * _LOOKED else None


def _axis(model: Any) -> Array:
    """Return the axis of the first joint in its own frame, (3,); zeros for a joint that slides."""
    import pinocchio as pin

    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    J = np.asarray(pin.getJointJacobian(model, data, 1, pin.LOCAL), dtype=np.float64)
    return J.reshape(6, -1)[3:, 0]  # for a single joint Pinocchio drops an axis


def _lowest(shapes: Any) -> float:
    """Return the height of the lowest point of what is fixed [m], at most that of the base's origin."""
    lowest = 0.0
    for shape in shapes.geometryObjects:
        if shape.parentJoint == 0:
            shape.geometry.computeLocalAABB()
            box = shape.geometry.aabb_local
            half = 0.5 * np.array([box.width(), box.height(), box.depth()])
            depth = float(np.abs(np.asarray(shape.placement.rotation)[2]) @ half)
            lowest = min(lowest, float(shape.placement.act(np.asarray(box.center()))[2]) - depth)
    return lowest


def _reaches(model: Any, shapes: Any) -> Array:
    """Return how far a point of the arm moves at most for a turn of each joint of the model, (nv,).

    The unit is m/rad, or one for a slide.
    """
    radius = np.zeros(model.njoints)  # of what a joint carries, about its origin [m]
    for shape in shapes.geometryObjects:
        shape.geometry.computeLocalAABB()
        centre = shape.placement.act(np.asarray(shape.geometry.aabb_center))
        size = float(np.linalg.norm(centre)) + float(shape.geometry.aabb_radius)
        radius[shape.parentJoint] = max(radius[shape.parentJoint], size)
    for frame in model.frames:
        size = float(np.linalg.norm(frame.placement.translation))
        radius[frame.parentJoint] = max(radius[frame.parentJoint], size)
    slides = [joint.shortname().startswith("JointModelP") for joint in model.joints]
    for joint in range(model.njoints - 1, 0, -1):
        length = float(np.linalg.norm(model.jointPlacements[joint].translation))
        if slides[joint]:
            at = model.joints[joint].idx_q
            ends = np.abs([model.lowerPositionLimit[at], model.upperPositionLimit[at]])
            length += float(ends[np.isfinite(ends)].max(initial=0.0))
        parent = model.parents[joint]
        radius[parent] = max(radius[parent], length + radius[joint])
    found = np.ones(model.nv)
    for joint in range(1, model.njoints):
        if not slides[joint]:
            found[model.joints[joint].idx_v] = radius[joint]
    return found


def _hulls(pin: Any, shapes: Any) -> Any:
    """Return shapes with every mesh replaced by its convex hull, in which it is: quick to compare."""
    hulls = pin.GeometryModel(shapes) if shapes.ngeoms else pin.GeometryModel()
    for shape in hulls.geometryObjects:
        if hasattr(shape.geometry, "buildConvexHull"):
            try:
                shape.geometry.buildConvexHull(True, "Qt")
            except RuntimeError:  # a flat mesh has no hull: it is compared as it is
                continue
            shape.geometry = shape.geometry.convex
    return hulls
