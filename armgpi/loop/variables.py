"""What may be given anew in a closed loop that is prepared: every declared number by its name.

Names are those of an experiment file: ``controller.omega``, ``plant.delay``, ``plant.loads.0.onset``,
``supervisor.following``, ``reference.durations.0``, ``plant.payload.mass``.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armgpi.base.arrays import as_sized_array, is_listing
from armgpi.base.parameter import Parameter, Parametrised, parameters
from armgpi.control.controller import Controller
from armgpi.errors import ArmgpiWarning, ArrayError, NameNotFound, ParameterError
from armgpi.gpi.weights import Weights
from armgpi.loop.closed_loop import ClosedLoop
from armgpi.plants.arm import Arm
from armgpi.plants.plant import Plant, Wrapper
from armgpi.robot.batch import AnyRobot, VariedRobots
from armgpi.robot.changes import CHANGES
from armgpi.robot.equations import Friction
from armgpi.robot.robot import Robot
from armgpi.supervisor import Supervised, Supervisor


@dataclass(frozen=True)
class Variable:
    """A number of a loop that may be given anew.

    Attributes:
        name: as in an experiment file.
        declared: what is known of it: sentence, unit, bounds, whether it is per joint.
        value: what it is now.
        fixed: why it may not be given anew; empty where it may.
    """

    name: str
    declared: Parameter
    value: Any
    fixed: str = ""


_FRICTION = {name: CHANGES[name] for name in ("viscous", "coulomb")}
_LOAD = {"payload": "payload.mass", "com": "payload.com", "frame": "payload.frame"}
#: What may vary of a robot, of the plant and of the nominal model.
_ROBOT = {_LOAD.get(name, name): each for name, each in CHANGES.items() if name not in (*_FRICTION, "effort")}
_NOMINAL = ("inertia_scale",)
#: Names as they were -> as they are.
RENAMED = {f"plant.{old}": f"plant.{new}" for old, new in _LOAD.items()}
#: Why what is not per joint of a supervisor stays.
_CHECK = "a check is switched on or off by it; prepare another loop for another value"


def current(name: str) -> str:
    """Return the name of a variable as it is now; an old one is said to be one."""
    if name in RENAMED:
        warnings.warn(f"{name} is called {RENAMED[name]} now", ArmgpiWarning, stacklevel=3)
    return RENAMED.get(name, name)


def variables(loop: ClosedLoop) -> dict[str, Variable]:
    """Return all declared parameters of a loop by name, with the reason where one cannot be given anew."""
    found = [*_of_plant(loop.plant), *of_controller(loop.controller)]
    for name, value in loop.reference.variables().items():
        times = name.partition(".")[0] not in ("q", "start", "goal", "points")
        declared = Parameter(name, unit="s" if times else "rad or m", per_joint=not times)
        found.append(Variable(f"reference.{name}", declared, value))
    return {each.name: each for each in found}


def with_values(loop: ClosedLoop, values: Mapping[str, Any], rows: int) -> ClosedLoop:
    """Return a loop with other numbers.

    Args:
        loop: the loop.
        values: name -> value in the form that :func:`check_values` gives.
        rows: number of rollouts, for what comes for all of them alone.

    Raises:
        ParameterError: when a value is not as declared.
        ArrayError: likewise, or when it does not fit the joints.
    """
    parts: dict[str, dict[str, Any]] = {"plant": {}, "controller": {}, "supervisor": {}, "reference": {}}
    for name, value in values.items():
        part, _, rest = name.partition(".")
        parts[part][rest] = value
    plant, controller, reference = loop.plant, loop.controller, loop.reference
    if parts["plant"]:
        plant = _plant_with(plant, parts["plant"], rows)
    if isinstance(controller, Supervised):
        law, supervisor = controller.law, controller.supervisor
        given = _own_changes(Supervisor, parts["supervisor"])
        law = _controller_with(law, parts["controller"], rows) if parts["controller"] else law
        controller = Supervised(law, supervisor.with_values(**given))
    elif parts["controller"]:
        controller = _controller_with(controller, parts["controller"], rows)
    if parts["reference"]:
        reference = reference.with_values(**parts["reference"])
    return ClosedLoop(plant, controller, reference)


def check_values(known: Mapping[str, Variable], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values as constructors take them: numbers, and arrays with a row for each rollout.

    Args:
        known: from :func:`variables`.
        values: name -> a number for all rollouts, or an array whose first axis is the rollouts.

    Raises:
        NameNotFound: for a name that the loop has not.
        ParameterError: for a parameter that cannot be given anew; it says why.
        ArrayError: when an array has another shape.
    """
    found = {}
    for given, value in values.items():
        name = current(given)
        if name not in known:
            raise NameNotFound("parameter of this loop", name, tuple(known))
        if reason := known[name].fixed:
            raise ParameterError(name, value, f"left as it is: {reason}")
        found[name] = _check_value(known[name], value)
    return found


def rows_of(values: Mapping[str, Any]) -> int | None:
    """Return for how many rollouts some checked values are, None where they fit any.

    Raises:
        ArrayError: when two differ; it names them.
    """
    rows = {
        name: len(part)
        for name, value in values.items()
        for part in (value if isinstance(value, tuple) else (value,))
        if isinstance(part, np.ndarray)
    }
    if not rows:
        return None
    most = max(rows, key=lambda name: rows[name])
    for name, count in rows.items():
        if count not in (1, rows[most]):
            raise ArrayError(name, f"expected values for {rows[most]} rollouts, as {most} has; got {count}")
    return rows[most]


def spread_rows(values: Mapping[str, Any], rows: int | None) -> dict[str, Any]:
    """Return values with as many rows each as there are rollouts."""

    def whole(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(whole(part) for part in value)
        if not isinstance(value, np.ndarray):
            return value
        return np.ascontiguousarray(np.broadcast_to(value, (rows or 1, *value.shape[1:])))

    return {name: whole(value) for name, value in values.items()}


def _check_value(variable: Variable, value: Any) -> Any:
    """Return one value as constructors take it."""
    declared = variable.declared
    match declared.kind:
        case "seed":
            return value
        case "table":
            return _table(variable, value)
        case "text":
            return declared.check_value(value)
        case "box" if isinstance(value, tuple):
            return tuple(_check_value(variable, end) for end in value)
        case _ if not is_listing(value):
            return value
    array = as_sized_array(np.asarray(value).astype(np.float64) if _whole(value) else value, variable.name)
    if array.ndim == 1:
        return array[None] if declared.kind == "vector" else array[:, None]
    several = declared.per_joint or declared.kind == "vector"
    if array.ndim != 2 or (array.shape[1] != 1 and not several):
        expected = "(rollouts, joints)" if declared.per_joint else "(rollouts,)"
        raise ArrayError(variable.name, f"expected a number or shape {expected}, got {array.shape}")
    return array


def _table(variable: Variable, value: Any) -> Any:
    """Return initial weights, (rollouts, joints, functions) or (functions,) for all."""
    array = as_sized_array(value, variable.name)
    if array.ndim not in (1, 3):
        expected = "(functions,) or (rollouts, joints, functions)"
        raise ArrayError(variable.name, f"expected shape {expected}, got {array.shape}")
    return array.tolist() if array.ndim == 1 else array


def _whole(value: Any) -> bool:
    """Tell whether an array is one of whole numbers."""
    return isinstance(value, np.ndarray) and value.dtype.kind in "iu"


def _of_plant(plant: Plant) -> Iterator[Variable]:
    """Yield what may be given anew of a plant, and of what it is wrapped in."""
    match plant:
        case Wrapper():
            yield from _of_plant(plant.plant)
            for name, declared in _keys(plant).items():
                yield _variable(name, declared, plant)
        case Arm() if plant.varies:
            robot, reason = vars(plant)["_as_given"]["robot"], ""
            if not isinstance(robot, Robot | VariedRobots):
                reason = "the plant has another robot for each rollout; use one robot"
            for name, declared in _ROBOT.items():
                yield Variable(f"plant.{name}", declared, _now(robot, name), reason)
            friction = plant.friction or Friction(0.0, 0.0)  # type: ignore[arg-type]
            for name, declared in _FRICTION.items():
                yield Variable(f"plant.{name}", declared, getattr(friction, name))
            yield from _declared_variables("plant", plant)
            for i, load in enumerate(plant.loads):
                yield from _declared_variables(f"plant.loads.{i}", load)
            for i, contact in enumerate(plant.environment):
                yield from _declared_variables(f"plant.environment.{i}", contact)
        case _:
            reason = f"{type(plant).__name__} is made for the robot that it has; RigidBodyPlant varies"
            for name, declared in {**_ROBOT, **_FRICTION}.items():
                yield Variable(f"plant.{name}", declared, None, reason)


def _declared_variables(place: str, part: Parametrised) -> Iterator[Variable]:
    """Yield the declared parameters of a part."""
    for declared in parameters(type(part)).values():
        yield _variable(f"{place}.{declared.file_key}", declared, part)


def of_controller(controller: Controller) -> Iterator[Variable]:
    """Yield what may be given anew of a controller, and of its part that may be one of several."""
    if isinstance(controller, Supervised):
        yield from of_controller(controller.law)
        yield from _of_supervisor(controller.supervisor)
        return
    reason = "" if isinstance(controller.robot, Robot | VariedRobots) else "it has a robot for each rollout"
    for name in _NOMINAL:
        yield Variable(f"controller.{name}", _ROBOT[name], _now(controller.robot, name), reason)
    for name, declared in parameters(type(controller)).items():
        part = getattr(controller, name)
        if declared.kind != "variant":
            yield _variable(f"controller.{declared.file_key}", declared, controller)
        elif isinstance(part, Parametrised):
            for key, each in _flat(part).items():
                yield _variable(f"controller.{key}", each, part)


def _of_supervisor(supervisor: Supervisor) -> Iterator[Variable]:
    """Yield the bounds of a supervisor; those that are not of joints are checked and fixed."""
    for bound in parameters(Supervisor).values():
        known = _variable(f"supervisor.{bound.file_key}", bound, supervisor)
        yield known if bound.per_joint or known.fixed else replace(known, fixed=_CHECK)


def _variable(name: str, declared: Parameter, owner: Any) -> Variable:
    """Return a declared parameter of a part."""
    reason = ""
    if not declared.varies:
        reason = "it is no number" if not declared.structural else "it decides the form of the generated code"
        reason += "; prepare another loop for another value"
    elif "_as_given" not in vars(owner):
        reason = f"{type(owner).__name__} has a constructor of its own"
    if declared.kind == "table":
        owner = owner.weights
    return Variable(name, declared, getattr(owner, declared.name, None), reason)


def _keys(wrapper: Wrapper) -> dict[str, Parameter]:
    """Return a wrapper's parameters by their names here: the wrapper's alone where it has one in files."""
    declared = parameters(type(wrapper))
    top = f"plant.{wrapper.config_name or type(wrapper).__name__}"
    single = sum(each.in_file for each in declared.values()) == 1
    return {top if single and each.in_file else f"{top}.{each.file_key}": each for each in declared.values()}


def _plant_with(plant: Plant, changes: dict[str, Any], rows: int) -> Plant:
    """Return a plant with other numbers; see :func:`with_values`."""
    if isinstance(plant, Arm):
        return _arm_with(plant, changes, rows)
    assert isinstance(plant, Wrapper)
    own = {f"plant.{key}": value for key, value in changes.items()}
    mine = {declared.name: own[name] for name, declared in _keys(plant).items() if name in own}
    rest = {key: value for key, value in changes.items() if f"plant.{key}" not in _keys(plant)}
    inner = _plant_with(plant.plant, rest, rows) if rest else plant.plant
    if "samples" in mine and isinstance(mine["samples"], np.ndarray):
        longest = int(max(np.max(mine["samples"]), plant._length))  # type: ignore[attr-defined]
        mine["longest"] = longest
    return plant.with_values(plant=inner, **mine)


def _arm_with(plant: Arm, changes: dict[str, Any], rows: int) -> Arm:
    """Return an arm with other numbers."""
    given = _own_changes(type(plant), changes)
    if robot := {_ROBOT[key].name: value for key, value in changes.items() if key in _ROBOT}:
        given["robot"] = robot_with(vars(plant)["_as_given"]["robot"], robot, rows)
    if friction := {name: value for name, value in changes.items() if name in _FRICTION}:
        now = plant.friction or Friction(*(np.zeros(plant.robot.n),) * 2)
        given["friction"] = now._replace(**friction)
    loads = list(plant.loads)
    for i, load in enumerate(loads):
        if mine := _own_changes(type(load), changes, f"loads.{i}."):
            loads[i] = load.with_values(**mine)
            given["loads"] = loads
    contacts = list(plant.environment)
    for i, contact in enumerate(contacts):
        if mine := _own_changes(type(contact), changes, f"environment.{i}."):
            contacts[i] = contact.with_values(**mine)
            given["environment"] = contacts
    return plant.with_values(**given)


def _own_changes(kind: type, changes: Mapping[str, Any], place: str = "") -> dict[str, Any]:
    """Return what changes of the declared parameters of a class, whose keys begin with a place, by field."""
    keys = {name: f"{place}{each.file_key}" for name, each in parameters(kind).items()}
    return {name: changes[key] for name, key in keys.items() if key in changes}


def _controller_with(controller: Controller, changes: dict[str, Any], rows: int) -> Controller:
    """Return a controller with other numbers; see :func:`with_values`."""
    given: dict[str, Any] = {}
    if robot := {name: value for name, value in changes.items() if name in _NOMINAL}:
        given["robot"] = robot_with(vars(controller)["_as_given"]["robot"], robot, rows)
    for name, declared in parameters(type(controller)).items():
        part = getattr(controller, name)
        if declared.kind == "variant" and isinstance(part, Parametrised):
            if own := {key: changes[key] for key in _flat(part) if key in changes}:
                given[name] = _part_with(part, own)
        elif declared.file_key in changes:
            given[name] = changes[declared.file_key]
    return controller.with_values(**given)


def _flat(part: Parametrised) -> dict[str, Parameter]:
    """Return the parameters of a part by their names here, those of its weights one by one."""
    found: dict[str, Parameter] = {}
    for each in parameters(type(part)).values():
        if each.group is Weights:
            found |= {f"{each.file_key}.{x.file_key}": x for x in parameters(Weights).values()}
        else:
            found[each.file_key] = each
    return found


def _part_with(part: Parametrised, changes: Mapping[str, Any]) -> Parametrised:
    """Return a part with other values, and initial weights by their names."""
    given: dict[str, Any] = {}
    weights: dict[str, Any] = {}
    for key, each in _flat(part).items():
        if key in changes:
            (weights if "." in key else given)[each.name] = changes[key]
    if weights:
        own = getattr(part, "weights", None) or Weights()
        given["weights"] = own.with_values(**weights)
    return part.with_values(**given)


def robot_with(robot: AnyRobot, changes: Mapping[str, Any], rows: int) -> VariedRobots:
    """Return a robot with other numbers in each of so many rollouts, on top of those that vary already."""
    base, now = (robot.base, robot.variation) if isinstance(robot, VariedRobots) else (robot, {})
    given = dict(now)
    for name, value in changes.items():
        if name in ("payload", "inertia_scale"):
            value = np.broadcast_to(np.ravel(value), (rows,))
        elif name != "frame" and np.ndim(value) < 2:
            value = np.full((rows, 1), value) if np.ndim(value) == 0 else np.tile(value, (rows, 1))
        given[name] = value
    return base.varied(**given)  # type: ignore[union-attr]


def _now(robot: AnyRobot, name: str) -> Any:
    """Return what a quantity of a robot is now."""
    key = _ROBOT[name].name
    if isinstance(robot, VariedRobots) and key in robot.variation:
        return robot.variation[key]
    if name == "rotor_inertia":
        return getattr(robot, "armature", None)
    return _ROBOT[name].default
