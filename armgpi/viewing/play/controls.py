"""What can be moved in a page: what classes declare with a slider, and what an experiment says of the arm."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.parameter import Parameter, parameters
from armgpi.config import keys
from armgpi.config.building import Experiment
from armgpi.config.schema import KINDS, ExperimentConfig
from armgpi.control.impedance import Impedance
from armgpi.errors import ArmgpiError
from armgpi.loop.closed_loop import ClosedLoop
from armgpi.loop.variables import variables, with_values
from armgpi.plants.plant import inside
from armgpi.plants.sensors import Delayed, DropOut, Encoder
from armgpi.robot.robot import Robot

#: A way to a key of an experiment file.
Path = tuple[str | int, ...]
#: Places of a slider that goes by factors, and of one that goes by steps.
_PLACES = 40
#: Factors of the nominal model's inertia [-].
_SCALES = (0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6)
#: Largest load, as a share of the arm's mass [-].
_HEAVIEST = 0.15
#: Loads that a slider has, besides none.
_LOADS = 5
#: Rotor inertia and friction of the plant, in percent of the inertia at the start and of the effort limits.
_ROTORS = (0.0, 10.0, 30.0, 100.0)
_COULOMB = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
_VISCOUS = (0.0, 0.5, 1.0, 2.0, 5.0)
#: Numbers of a controller that make another nominal model: it has no slider but that of the whole inertia.
_OF_THE_MODEL = ("link_factor", "rotor_factor")
#: Bandwidths, in percent of those of the experiment, where they differ by joint.
_BANDWIDTHS = (
    30.0,
    40.0,
    50.0,
    60.0,
    70.0,
    80.0,
    90.0,
    100.0,
    110.0,
    120.0,
    140.0,
    160.0,
    200.0,
    250.0,
    300.0,
)
#: Stiffness of springs, as factors of that of the experiment, and their damping ratios.
_STIFFNESS = (0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0)
_DAMPING = (0.4, 0.6, 0.8, 1.0, 1.5)
#: Force limits [N].
_FORCES = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 50.0, 70.0, 100.0, 150.0)
#: How far a goal can be moved [rad or m], and factors of a move's duration.
_FAR = 0.5 * math.pi
_DURATIONS = (0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.25, 1.5, 2.0)
#: Structure that a page has all forms of; more integrators and the like come from the experiment.
_FORMS: dict[str, tuple[Any, ...]] = {"rolloff": (0, 1), "feedforward": ("none", "model")}
#: Controllers that a page changes between.
_SIBLINGS = ("gpi", "network")
#: Pushes that a page has room for.
PUSHES = 3
#: How long one lasts [s].
PUSH = 0.2


def dotted_path(path: Path) -> str:
    """Return a path with dots."""
    return ".".join(map(str, path))


class Control(NamedTuple):
    """Something that can be moved.

    Attributes:
        path: of the key in the experiment.
        label: its name in the page.
        text: what it is.
        unit: its unit; empty for none.
        group: under which heading it stands.
        stops: what the slider shows at each of its places; empty where every joint has a slider.
        values: what the experiment file says there: a number, a list over the joints, or None.
        value: what it says at first.
        joints: lowest and highest value of every joint; empty for one slider.
        whole: the section that it is in, without it; where the value is None or zero there is none.
        arm: "plant" or "controller" where it changes the equations of motion of one.
        only: path -> value of the choice that it belongs to; None for all.
        excludes: id of a control that is as at first while this one is not.
        rebuilds: whether the controller is made anew at each of its places: more follows from its value than
            a number that it is.
    """

    path: Path
    label: str
    text: str
    unit: str
    group: str
    stops: tuple[float | None, ...]
    values: tuple[Any, ...]
    value: Any
    joints: tuple[tuple[float, float], ...] = ()
    whole: Mapping[str, Any] | None = None
    arm: str = ""
    only: tuple[Path, Any] | None = None
    excludes: str = ""
    rebuilds: bool = False

    @property
    def id(self) -> str:
        """Its path with dots."""
        return dotted_path(self.path)

    @property
    def part(self) -> str:
        """The part of the loop that it is of."""
        part = self.arm or str(self.path[0])
        return {"robot": "plant", "controllers": "controller"}.get(part, part)

    def put(self, config: dict[str, Any], value: Any) -> None:
        """Put a value into an experiment as plain data."""
        if self.whole is None:
            keys.put(config, self.path, value)
        else:
            section: Any = {**self.whole, str(self.path[-1]): value} if value else None
            keys.put(config, self.path[:-1], section)


class Choice(NamedTuple):
    """Something of which each value has a form of the loop of its own.

    Attributes:
        path: of the key in the experiment; of the controller's section for its type.
        label: its name in the page.
        text: what it is.
        values: what it may be.
        value: what it is at first.
        only: the controllers that have it; empty for all.
    """

    path: Path
    label: str
    text: str
    values: tuple[Any, ...]
    value: Any
    only: tuple[str, ...] = ()

    @property
    def id(self) -> str:
        """Its path with dots."""
        return dotted_path(self.path)


class Playable(NamedTuple):
    """An experiment with what can be moved in it.

    Attributes:
        config: it as plain data, with room for pushes.
        sections: type -> section of the controller.
        choices: what has forms of its own.
        controls: what can be moved.
        friction: joint friction of the experiment's robot: the nominal model's where the plant has none.
    """

    config: dict[str, Any]
    sections: dict[str, dict[str, Any]]
    choices: tuple[Choice, ...]
    controls: tuple[Control, ...]
    friction: Any = None


def playable(experiment: Experiment, label: str, siblings: Mapping[str, dict[str, Any]]) -> Playable:
    """Return what can be moved in an experiment.

    Args:
        experiment: from :func:`armgpi.config.build`.
        label: which of its controllers.
        siblings: type -> filled section of the other controllers that the page has.
    """
    config = plain(experiment.config)
    robot = experiment.robot
    section = next(section for section in config["controllers"] if section["label"] == label)
    _fill_springs(section, experiment.controllers[label])
    kind = section["type"]
    sections = {kind: section, **siblings}
    config["controllers"] = [section]
    if not (np.any(robot.friction.viscous) or np.any(robot.friction.coulomb)):
        config["plant"]["friction"] = "none"  # as the arm has none; what is switched on has some
    friction = config["plant"]["friction"]
    choices = [
        Choice(("controllers", 0), "controller", "the controller", tuple(sections), kind),
        *_choices_of_form(section, sections),
        Choice(("plant", "friction"), "friction", "joint friction of the plant", ("none", "urdf"), friction),
    ]
    of_model = config["robot"]["friction"]
    config["robot"]["friction"] = _frictions(robot)
    controls = [
        *_controllers(sections, robot),
        *_plant(config, robot),
        *_reference(config, robot),
    ]
    arm: Any = inside(experiment.plant)
    # An entry of the file may be several loads, whose numbers are none of the file's.
    has_joint_entries = len(experiment.config.plant.loads) != len(arm.loads)
    known = {control.id for control in controls}
    for control in _own_numbers(experiment, label):
        is_of_joint_entry = has_joint_entries and control.path[1] == "loads"
        if control.id not in known and not is_of_joint_entry:
            controls.append(control)
    controls += _loads(config, experiment.t_final, robot)
    return Playable(config, sections, tuple(choices), tuple(controls), of_model)


def _choices_of_form(
    section: Mapping[str, Any], sections: Mapping[str, Mapping[str, Any]]
) -> Iterator[Choice]:
    """Yield what of a controller's section has forms of the loop of its own."""
    for key, values in _FORMS.items():
        if key not in section:
            continue
        kinds = tuple(kind for kind, other in sections.items() if key in other)
        declared = _declared_parameters(kinds[0])[key]
        value = section[key]
        all_values = tuple(dict.fromkeys((*values, value)))
        text = declared.short or declared.text
        label = key.replace("_", " ")
        yield Choice(("controllers", 0, key), label, text, all_values, value, kinds)


def plain(config: ExperimentConfig) -> dict[str, Any]:
    """Return an experiment as plain data that may be changed."""
    return copy.deepcopy(config.plain())


def siblings(kind: str) -> tuple[str, ...]:
    """Return the other controllers of a page whose experiment has a controller of some kind."""
    if kind not in _SIBLINGS:
        return ()
    return tuple(name for name in _SIBLINGS if name != kind)


def _declared_parameters(kind: str) -> dict[str, Parameter]:
    """Return the parameters of a kind of controller by their keys in a file."""
    return {parameter.file_key: parameter for parameter in KINDS[kind].parameters.values()}


def stops_of(declared: Parameter, value: Any = None) -> tuple[float, ...]:
    """Return the places of the slider of a declared parameter, of few digits; none without a range."""
    ends = declared.slider or declared.range(value)
    if ends is None:
        return ()
    low, high = ends
    if declared.kind == "integer":
        return tuple(map(float, range(int(low), int(high) + 1)))
    by_factors = declared.log and low > 0.0
    places = np.geomspace(low, high, _PLACES) if by_factors else np.linspace(low, high, _PLACES + 1)
    return tuple(dict.fromkeys(map(_few, places)))


def _slider(path: Path, declared: Parameter, value: Any, label: str, group: str) -> Control:
    """Return the control of a declared parameter."""
    stops = stops_of(declared, value)
    if value is not None and not isinstance(value, list):
        stops = tuple(sorted({*stops, float(value)}))
    values: tuple[Any, ...] = stops
    if declared.kind == "integer":
        values = tuple(map(int, stops))
    return Control(path, label, declared.text, declared.unit, group, stops, values, value)


def _controllers(sections: Mapping[str, dict[str, Any]], robot: Robot) -> Iterator[Control]:
    """Yield the controls of the controllers, those of one parameter one after the other."""
    keys: dict[str, None] = {}
    for kind in sections:
        keys |= dict.fromkeys(_declared_parameters(kind))
    for key, kind in itertools.product(keys, sections):
        declared = _declared_parameters(kind).get(key)
        if key in _OF_THE_MODEL or declared is None or not declared.varies:
            continue
        # Keys of a force limit that is not set are left out of files.
        if declared.kind in ("number", "integer", "box") and key in sections[kind]:
            yield from _declared_slider(kind, key, declared, sections[kind][key])
    for kind in sections:
        yield from _force_limit(kind, sections[kind])
    compliant = [kind for kind in sections if issubclass(KINDS[kind].law, Impedance)]
    if compliant:
        # Their damping is made for the inertia of the nominal model, which has no slider then.
        for kind in compliant:
            yield from _springs(kind, sections[kind])
    else:
        yield from _nominal(sections, robot)


def _force_limit(kind: str, section: Mapping[str, Any]) -> Iterator[Control]:
    """Yield the slider of a force limit that a file has: its moment follows it where none is given."""
    declared = _declared_parameters(kind).get("force_limit")
    limit = section.get("force_limit")
    if declared is not None and limit is not None and not declared.varies:
        path = ("controllers", 0, "force_limit")
        slider = _slider(path, declared, limit, "force limit", "controller")
        stops = tuple(sorted({*_FORCES, float(limit)}))
        of_kind = (("controllers", 0), kind)
        yield slider._replace(only=of_kind, stops=stops, values=stops, rebuilds=True)


def _fill_springs(section: dict[str, Any], law: Any) -> None:
    """Put into the section of springs what was chosen for them: it stays while others are moved."""
    law = getattr(law, "law", law)  # it may have a force limit around it
    if isinstance(law, Impedance):
        section["velocity_filter"] = law.velocity_filter
        if "joint_stiffness" in section:
            section["joint_stiffness"] = np.asarray(vars(law)["stiffness"]).tolist()


def _springs(kind: str, section: Mapping[str, Any]) -> Iterator[Control]:
    """Yield the controls of springs: one scales all of them by the same factor, the other one damps them."""
    key = "joint_stiffness" if "joint_stiffness" in section else "stiffness"
    given = [float(x) for x in section[key]]
    shown, unit = max(given), "N m/rad"
    if key == "stiffness" and max(given[:3]):  # of positions, where there is one
        shown, unit = max(given[:3]), "N/m"
    stiffness = Control(
        path=("controllers", 0, key),
        label="stiffness",
        text="the largest one; all others go with it, by the same factor",
        unit=unit,
        group="controller",
        stops=tuple(_few(factor * shown) for factor in _STIFFNESS),
        values=tuple(_scaled(given, factor) for factor in _STIFFNESS),
        value=given,
        only=(("controllers", 0), kind),
        rebuilds=True,
    )
    ratio = section["damping_ratio"]
    ratios = tuple(sorted({*_DAMPING, float(ratio)}))
    yield stiffness
    yield stiffness._replace(
        path=("controllers", 0, "damping_ratio"),
        label="damping ratio",
        text=_declared_parameters(kind)["damping_ratio"].text,
        unit="",
        stops=ratios,
        values=ratios,
        value=ratio,
    )


def _declared_slider(kind: str, key: str, declared: Parameter, value: Any) -> Iterator[Control]:
    """Yield the slider of a controller's parameter, or those of the ends of its box.

    One that follows another one, or differs by joint, has none; but for the bandwidth.
    """
    place: Path = ("controllers", 0, key)
    label = key.replace("_", " ")
    if key == "omega" and isinstance(value, list):
        yield _bandwidth(place, declared, value)._replace(only=(("controllers", 0), kind))
        return
    ends = value if isinstance(value, dict) else {"": value}
    for end, number in ends.items():
        if isinstance(number, float | int) and stops_of(declared, number):
            way = (*place, end) if end else place
            name = f"{label}, {end} end" if end else label
            control = _slider(way, declared, number, name, "controller")
            yield control._replace(only=(("controllers", 0), kind))


def _bandwidth(place: Path, declared: Parameter, value: list[float]) -> Control:
    """Return the slider of bandwidths that differ by joint: it scales all of them by the same factor."""
    values = [value if percent == 100.0 else _scaled(value, 0.01 * percent) for percent in _BANDWIDTHS]
    return Control(
        path=place,
        label="bandwidth",
        text=f"{declared.text} of all joints, in percent of what is chosen for the arm",
        unit="%",
        group="controller",
        stops=_BANDWIDTHS,
        values=tuple(values),
        value=value,
    )


def _nominal(sections: Mapping[str, dict[str, Any]], robot: Robot) -> Iterator[Control]:
    """Yield the controls of the nominal model: its inertia, and the load that it carries."""
    section = next(iter(sections.values()))
    scale: Path = ("controllers", 0, "inertia_scale")
    loaded: Path = ("controllers", 0, "payload_range", "heaviest")
    scales = tuple(sorted({*_SCALES, section["inertia_scale"]}))
    scaled = Control(
        path=scale,
        label="inertia of the nominal model",
        text="factor of D(q) that the controller works with",
        unit="",
        group="controller",
        stops=scales,
        values=scales,
        value=section["inertia_scale"],
        excludes=dotted_path(loaded),
    )
    if not section.get("payload_range"):  # which is chosen for the arm as it is scaled
        yield scaled
    if all("payload_range" in other for other in sections.values()):
        none: dict[str, Any] = {"lightest": 0.0, "heaviest": 0.0, "frame": None, "com": [0.0] * 3}
        given = section["payload_range"] or none
        masses = _masses(robot, given["heaviest"])
        yield Control(
            path=loaded,
            label="load of the nominal model",
            text="heaviest load that the controller works with",
            unit="kg",
            group="controller",
            stops=masses,
            values=masses,
            value=given["heaviest"],
            whole={key: value for key, value in given.items() if key != "heaviest"},
            arm="controller",
            excludes=dotted_path(scale),
        )


def _masses(robot: Robot, given: float) -> tuple[float, ...]:
    """Return loads that an arm may carry [kg]: none, and some of 1, 2, 5 times powers of ten."""
    inertias = robot.pinocchio_model().inertias
    most = _HEAVIEST * float(sum(inertia.mass for inertia in inertias))
    power = math.floor(math.log10(most)) if most > 0.0 else 0
    series = []
    for exponent in range(power - 2, power + 1):
        series += [float(f"{digit}e{exponent}") for digit in (1, 2, 5)]
    allowed = [mass for mass in series if mass <= most]
    return tuple(sorted({0.0, given, *allowed[-_LOADS:]}))


def _plant(config: dict[str, Any], robot: Robot) -> Iterator[Control]:
    """Yield the controls of the plant."""
    plant = config["plant"]
    payload = plant["payload"] or {"mass": 0.0, "frame": None, "com": [0.0, 0.0, 0.0]}
    masses = _masses(robot, payload["mass"])
    yield Control(
        path=("plant", "payload", "mass"),
        label="load",
        text="mass at the tip that the controller does not know",
        unit="kg",
        group="plant",
        stops=masses,
        values=masses,
        value=payload["mass"],
        whole={key: value for key, value in payload.items() if key != "mass"},
        arm="plant",
    )
    inertia = np.diag(robot.mass_matrix(robot.middle()))
    added = [_round_values(robot.armature + 0.01 * share * inertia) for share in _ROTORS[1:]]
    lists: list[Any] = [None, *added]
    stops: tuple[float | None, ...] = _ROTORS
    rotors = plant["rotor_inertia"]
    if rotors is not None:
        stops = (*stops, None)
        lists.append(rotors)
    yield Control(
        path=("plant", "rotor_inertia"),
        label="rotor inertia",
        text="of the plant alone, in percent of the arm's own inertia",
        unit="%",
        group="plant",
        stops=stops,
        values=tuple(lists),
        value=rotors,
        arm="plant",
    )
    yield from _friction(config, robot)
    for wrapper in (Delayed, DropOut, Encoder):  # which a page has, whether the file has or not
        name = str(wrapper.config_name)
        if isinstance(plant[name], list):
            continue
        declared = next(parameter for parameter in parameters(wrapper).values() if parameter.in_file)
        control = _slider(("plant", name), declared, plant[name], name.replace("_", " "), "plant")
        if wrapper is Encoder:  # the last place is that of exact positions
            control = control._replace(stops=(*control.stops, None), values=(*control.values, None))
        yield control


def _own_numbers(experiment: Experiment, label: str) -> Iterator[Control]:
    """Yield the controls of what the file gives of plant, sensors and loads as one number."""
    loop = ClosedLoop(*experiment.runs[label], experiment.reference)
    config = plain(experiment.config)
    for name, variable in variables(loop).items():
        path = keys.path_of(name)
        try:
            _, value = keys.find(experiment.config, name)
        except LookupError:  # of an entry of the file that is several loads
            continue
        if path[0] != "plant" or variable.fixed or not isinstance(value, float):
            continue
        if not stops_of(variable.declared, value):
            continue
        words = " ".join(map(str, path[1:])).replace("_", " ").replace("loads", "load")
        if path[1] == "environment":
            contacts = config["plant"]["environment"]
            number = f" {path[2]}" if len(contacts) > 1 else ""
            words = f"{contacts[int(path[2])]['type']}{number} {path[-1]}"
        control = _slider(path, variable.declared, value, words, "plant")
        stops = []
        for x in control.stops:
            with suppress(ArmgpiError):  # a disturbance ends after it begins, for one
                with_values(loop, {name: x}, 1)
                stops.append(x)
        yield control._replace(stops=tuple(stops), values=tuple(stops))


def _friction(config: dict[str, Any], robot: Robot) -> Iterator[Control]:
    """Yield the controls of the plant's friction, where it has some."""
    efforts = _efforts(robot)
    for key, shares, unit in (("coulomb", _COULOMB, "%"), ("viscous", _VISCOUS, "% s/rad")):
        of_file = config["robot"]["friction"][key]
        values = [_round_values(0.01 * share * efforts) for share in shares]
        stops: tuple[float | None, ...] = shares
        if of_file not in values:
            stops = (*stops, None)
            values.append(of_file)
        yield Control(
            path=("robot", "friction", key),
            label=f"{key} friction",
            text="in percent of the effort limits",
            unit=unit,
            group="plant",
            stops=stops,
            values=tuple(values),
            value=of_file,
            only=(("plant", "friction"), "urdf"),
        )


def _reference(config: dict[str, Any], robot: Robot) -> Iterator[Control]:
    """Yield the goals of the moves, and how long they take."""
    points: list[Any] = config["reference"]["points"] or []
    for index, point in enumerate(points[1:], start=1):
        if point == points[0]:
            continue
        low = np.maximum(robot.limits.lower, np.array(point) - _FAR)
        high = np.minimum(robot.limits.upper, np.array(point) + _FAR)
        ends = [(_inward(a, 1.0), _inward(b, -1.0)) for a, b in zip(low, high, strict=True)]
        yield Control(
            path=("reference", "points", index),
            label="goal" if len(points) <= 3 else f"point {index + 1}",
            text="where the move goes",
            unit="rad or m",
            group="move",
            stops=(),
            values=(),
            value=point,
            joints=tuple(ends),
        )
    times = config["reference"]["durations"]
    if isinstance(times, list) and times:
        lists = [[_few(factor * time) for time in times] for factor in _DURATIONS]
        lists[_DURATIONS.index(1.0)] = times
        yield Control(
            path=("reference", "durations"),
            label="duration",
            text="how long the move takes",
            unit="s",
            group="move",
            stops=tuple(durations[0] for durations in lists),
            values=tuple(lists),
            value=times,
        )


def _loads(config: dict[str, Any], t_final: float, robot: Robot) -> Iterator[Control]:
    """Yield the controls of what disturbs the arm, and make room for it in the experiment."""
    none = [0.0] * robot.n
    onset = _few(0.3 * t_final)
    loads = config["plant"]["loads"]
    step = len(loads)
    loads.append({"type": "step", "amplitude": none, "onset": onset, "end": None})
    for _ in range(PUSHES):
        loads.append({"type": "pulse", "amplitude": none, "onset": 0.0, "duration": PUSH})
    torque = Control(
        path=("plant", "loads", step, "amplitude"),
        label="constant torque",
        text="a disturbance that begins at its onset",
        unit="N m or N",
        group="disturbances",
        stops=(),
        values=(),
        value=none,
        joints=tuple((-_few(x), _few(x)) for x in 0.3 * _efforts(robot)),
    )
    times = np.linspace(0.0, t_final, _PLACES + 1)[:-1]
    onsets = tuple(sorted({onset, *map(_few, times)}))
    begins = torque._replace(
        path=("plant", "loads", step, "onset"),
        label="its onset",
        text="when the constant torque begins",
        unit="s",
        stops=onsets,
        values=onsets,
        value=onset,
        joints=(),
    )
    yield from (torque, begins)
    anything = ((-math.inf, math.inf),) * robot.n
    ends = (0.0, t_final)
    for k in range(step + 1, step + 1 + PUSHES):
        push: Path = ("plant", "loads", k)
        yield torque._replace(path=(*push, "amplitude"), label="push", group="pushes", joints=anything)
        time = begins._replace(path=(*push, "onset"), label="time", group="pushes")
        yield time._replace(stops=ends, values=ends, value=0.0)


def _efforts(robot: Robot) -> Any:
    """Return what torques are measured by: effort limits, or what gravity asks for."""
    gravity = np.abs(robot.gravity(robot.middle())) + 1e-3
    limits = robot.limits.effort
    return np.where(np.isfinite(limits) & (limits < 1e6) & (limits > 0.0), limits, 2.0 * gravity)


def _frictions(robot: Robot) -> dict[str, Any]:
    """Return the friction that a page has where it is switched on: the arm's, or a little if it has none."""
    viscous, coulomb = robot.friction
    if viscous.any() or coulomb.any():
        return {"viscous": viscous.tolist(), "coulomb": coulomb.tolist()}
    efforts = _efforts(robot)
    return {
        "viscous": _round_values(0.01 * _VISCOUS[1] * efforts),
        "coulomb": _round_values(0.01 * _COULOMB[3] * efforts),
    }


def _few(x: float) -> float:
    """Return a number of three digits."""
    return float(f"{x:.3g}")


def _round_values(values: Sequence[float] | Any) -> list[float]:
    """Return numbers of three digits."""
    return [_few(float(x)) for x in values]


def _scaled(values: list[float], factor: float) -> list[float]:
    """Return numbers times a factor, of three digits; as they are where it is 1."""
    return values if factor == 1.0 else _round_values(factor * np.array(values))


def _inward(x: float, toward: float) -> float:
    """Return the nearest multiple of a thousandth on one side."""
    return (math.ceil(1e3 * x) if toward > 0.0 else math.floor(1e3 * x)) / 1e3
