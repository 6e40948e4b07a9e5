"""From a checked configuration to the objects it describes."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple, TypeVar

import numpy as np

from armgpi.base.arrays import Array, quantity
from armgpi.base.parameter import REQUIRED, Parameter, Parametrised, parameters
from armgpi.config import default_move, world
from armgpi.config.reading import Origin, check
from armgpi.config.schema import (
    ARM_KEYS,
    KINDS,
    PLANT_CHANGES,
    ExperimentConfig,
    PlantSection,
    ReferenceSection,
    RobotSection,
)
from armgpi.config.section import Path_, Section
from armgpi.control.controller import Controller
from armgpi.control.force_limited import ForceLimited, ForceSettings
from armgpi.errors import ArmgpiError, ArmgpiWarning, ArrayError, ConfigError, EffortError, NameNotFound
from armgpi.plants.arm import Arm
from armgpi.plants.environment import Contact
from armgpi.plants.loads import Load, Step
from armgpi.plants.plant import Plant, Wrapper
from armgpi.plants.reality import Reality, stack_draws
from armgpi.plants.sensors import Encoder
from armgpi.references.cartesian import CartesianReference, ClosedForm, Inverse
from armgpi.references.following import FollowLimits, Setpoints
from armgpi.references.paths import Eased, Path
from armgpi.references.poses import PosePath
from armgpi.references.recorded import Recorded
from armgpi.references.reference import Reference
from armgpi.references.waypoints import Waypoints
from armgpi.registry import Context, classes_of, subclasses
from armgpi.robot import chains, robots, rotors
from armgpi.robot.changes import CHANGES, change
from armgpi.robot.drives import Drives
from armgpi.robot.kinematics import TrackingInverse, inverse_kinematics, random_configurations
from armgpi.robot.repairs import made_in
from armgpi.robot.robot import Robot
from armgpi.supervisor import Supervised, Supervisor, complete_settings
from armgpi.tuning.rule import Untuned, assume
from armgpi.tuning.verdict import Verdict, verdict

#: What a sweep calls the arms that an identification leaves possible.
IDENTIFICATION = "identification"
#: Simulators, in the order in which both are run.
ENGINES = ("armgpi", "mujoco")
#: Most samples of a run: a day at 10 kHz.
_MAX_SAMPLES = 10**9
#: Keys of a reference that are of a stream alone.
_STREAM_KEYS = ("feedforward", "torque_rate", "start")
#: How long a run goes on after its reference has ended, when nothing is said [s].
_SETTLE = 2.0
#: Time for a path without an end, when nothing is said [s].
_PATH_TIME = 18.0
#: Size of a path that is chosen for an arm, as a share of how far from the base it is; and the number of
#: configurations among which the roomiest is looked for.
_PATH_SIZE, _CANDIDATES = 0.1, 256

_Part = TypeVar("_Part")


class _Place(NamedTuple):
    """One key of a configuration, while objects are made from it."""

    origin: Origin
    path: Path_ = ()

    def at(self, *steps: str | int) -> _Place:
        """Return a place below this one."""
        return _Place(self.origin, (*self.path, *steps))

    def error(self, message: str) -> ConfigError:
        """Return an error about this key."""
        return self.origin.error(self.path, message)

    @contextmanager
    def error_context(self) -> Iterator[None]:
        """Turn an error of ours that happens inside into one that names this key."""
        try:
            yield
        except ConfigError:
            raise
        except ArmgpiError as error:
            raise self.error(str(error)) from error


class Experiment(NamedTuple):
    """The objects that an experiment file describes.

    Attributes:
        robot: the arm as its URDF has it.
        plant: what moves.
        controllers: label -> controller.
        reference: where to.
        t_final: how long [s].
        config: what they were made from, with every default filled in.
        plants: simulator -> what moves in it; more than `plant` where there are two of them.
        supervisor: what all controllers are under; None for nothing.
    """

    robot: Robot
    plant: Plant
    controllers: dict[str, Controller]
    reference: Reference
    t_final: float
    config: ExperimentConfig
    plants: dict[str, Plant]
    supervisor: Supervisor | None = None

    @property
    def runs(self) -> dict[str, tuple[Plant, Controller]]:
        """Label -> what is run: every controller on every plant."""
        return {
            label if len(self.plants) == 1 else f"{label} ({engine})": (plant, controller)
            for label, controller in self.controllers.items()
            for engine, plant in self.plants.items()
        }


def build(config: ExperimentConfig, origin: Origin | None = None) -> Experiment:
    """Make the objects that a configuration describes.

    Raises:
        ConfigError: when something in it does not fit the robot; it names the key.
    """
    top = _Place(origin or Origin())
    config, robot = _with_assumptions(config, top)
    lasts = 0.0
    if config.reality is None:
        context = _context(config, robot, top)
        engine = config.plant.engine
        engines = ENGINES if engine == "both" else (engine,)
        plants = {each: _plant(config, context, top.at("plant"), each) for each in engines}
    else:
        config, context, drawn, lasts = _apply_draw(config, robot, top)
        plants = {ENGINES[0]: drawn}
    controllers: dict[str, Controller] = {}
    sections: list[Any] = []
    for index, section in enumerate(config.controllers):
        place = top.at("controllers", index)
        label = section.label or section.type
        if label in controllers:
            label = f"{label} {index + 1}"
        if label in controllers:
            raise place.at("label").error(f"another controller is labelled {label!r} as well")
        try:
            with place.error_context():
                section, controllers[label] = _controller(section, context, place)
        except ConfigError as error:
            if isinstance(error.__cause__, EffortError):
                raise top.at("robot", "effort").error(str(error.__cause__)) from error.__cause__
            raise
        sections.append(section.replace(label=label))
    reference, end, moves = _reference(config, robot, top.at("reference"))
    t_final = max(end + _SETTLE, lasts) if config.t_final is None else config.t_final
    if not 0.5 < t_final / config.sample_time <= _MAX_SAMPLES:
        # Say whose key it is: the run's length may be the reference's, and the samples the default ones.
        given = (key for key in ("t_final", "sample_time", "reference") if key in config.given)
        raise top.at(next(given, "t_final")).error(
            f"expected {config.sample_time:g} to {config.sample_time * _MAX_SAMPLES:g} s (1 to "
            f"{_MAX_SAMPLES:.0e} samples of {config.sample_time:g} s) in a run, got {t_final:g} s"
        )
    supervisor = _supervisor(config, controllers.values(), reference, top.at("supervisor"))
    config = config.replace(controllers=sections, reference=moves, t_final=t_final)
    plant = next(iter(plants.values()))
    return Experiment(robot, plant, controllers, reference, t_final, config, plants, supervisor)


def _supervisor(
    config: ExperimentConfig, controllers: Iterable[Controller], reference: Reference, place: _Place
) -> Any:
    """Return the supervisor, whose bounds suit the sensors; None where the file asks for none."""
    if config.supervisor is None:
        return None
    first, *_ = controllers
    robot: Any = first.robot
    with place.error_context():
        given = _given_values(config.supervisor, parameters(Supervisor), robot, place)
        supervisor = complete_settings(Supervisor(**given), config.plant, first)
        # The constructor checks that it fits the arm.
        Supervised(first, supervisor).check_start(reference.at(0.0).q)
        return supervisor


def robot(config: ExperimentConfig, origin: Origin | None = None) -> Robot:
    """Return the arm alone that a configuration describes.

    Raises:
        ConfigError: when something does not fit the robot; it names the key.
    """
    return resolve(config, origin)[1]


class Parts:
    """Makes the parts of experiments that differ in a few keys: what has the same sections is made once.

    In their controllers' sections every default has been filled in, so they do not depend on the plant's.
    """

    def __init__(self) -> None:
        """Begin without parts."""
        self._made: dict[tuple[str, ...], Any] = {}

    def of(self, config: ExperimentConfig) -> tuple[Plant, Controller, Reference]:
        """Return plant, first controller and reference of an experiment without a reality.

        Raises:
            ConfigError: when something in it does not fit the robot; it names the key.
        """
        top = _Place(Origin())
        text = cache(lambda key: repr(getattr(config, key)))
        robot = self._once(("robot",), text, ("robot",), lambda: _robot(config.robot, top.at("robot")))
        context = _context(config, robot, top)
        plant = self._once(
            ("plant",), text, ("robot", "plant", "sample_time", "seed"),
            lambda: _plant(config, context, top.at("plant"), config.plant.engine),
        )  # fmt: skip
        section = config.controllers[0]
        law = self._once(
            ("controller", repr(section)), text, ("robot", "sample_time"),
            lambda: controller(section.plain(), context),
        )  # fmt: skip
        reference = self._once(
            ("reference",), text, ("robot", "reference", "ideal"),
            lambda: _reference(config, robot, top.at("reference"))[0],
        )  # fmt: skip
        return plant, law, reference

    def _once(
        self,
        name: tuple[str, ...],
        text: Callable[[str], str],
        keys: tuple[str, ...],
        make: Callable[[], _Part],
    ) -> _Part:
        """Return a part that is made from some keys of an experiment, of which `text` is what they say."""
        key = (*name, *map(text, keys))
        if key not in self._made:
            self._made[key] = make()
        made: _Part = self._made[key]
        return made


def _with_assumptions(
    config: ExperimentConfig, top: _Place, loaded: Robot | None = None
) -> tuple[ExperimentConfig, Robot]:
    """Return the arm of an experiment, and the experiment with what is assumed of its drives filled in.

    They are assumed where the file asks for it, and where it does not and has an automatic controller. Then
    the plant has the same drives: it is elastic where joints are elastic, unless another one is asked for.
    An uncertainty model has drives of its own.
    """
    section = expand(config, top.at("robot"))
    config = config.replace(robot=section)
    robot = _robot(section, top.at("robot")) if loaded is None else loaded
    section, robot = _with_encoder_side(config, section, robot)
    config = world.in_world(config.replace(robot=section), robot)
    word = section.drives if isinstance(section.drives, str) else None
    realistic = config.ideal is False or (config.ideal is None and has_rule(config))
    if word is None and (config.reality is not None or not realistic):
        return config, robot
    robot = rotors.assume_drives(robot, word)
    if word != "none":
        given = section.drives if isinstance(section.drives, dict) else {}
        known = {joint: dict(own) for joint, own in given.items()}
        if word is not None and config.plant.encoder_side is not None:
            for joint, side in zip(robot.joint_names, robot.drives.value("encoder_side"), strict=True):
                known[joint] = {"encoder_side": str(side)}
        for quantity, data in robot.drives.data.items():
            for joint, datum in data.items():
                if datum.source in ("assumed", "published"):
                    known.setdefault(joint, {})[quantity] = datum.plain()
        # Where there was nothing to believe, the word still says that there is not.
        section = section.replace(drives=known or section.drives)
        config = config.replace(robot=section)
    twists = np.isfinite(robot.drives.value("stiffness")).all() and robot.armature.all()
    if twists and "engine" not in config.plant.given and config.reality is None:
        config = config.replace(plant=config.plant.replace(engine="elastic"))
    return config, robot


def _with_encoder_side(
    config: ExperimentConfig, section: RobotSection, robot: Robot
) -> tuple[RobotSection, Robot]:
    """Return the arm with the side of its encoders that the plant was given, where its drives have none.

    Where the encoders sit is a fact of the arm, so the controller knows it as well.
    """
    side = config.plant.encoder_side
    unknown = rotors.joints_without_side(robot)
    if side is None or not unknown or section.drives == "none":
        return section, robot
    known = rotors.with_encoder_side(robot, side)
    if isinstance(section.drives, str):  # a word, which is replaced by what is assumed
        return section, known
    drives = {joint: dict(own) for joint, own in (section.drives or {}).items()}
    for joint in unknown:
        drives[joint] = {**drives.get(joint, {}), "encoder_side": side}
    return section.replace(drives=drives), known


def summary(experiment: Experiment) -> str:
    """Return one line on the arm and the controller that an experiment has, the same for all commands."""
    return world.describe(experiment.config, experiment.robot)


def resolve(
    config: ExperimentConfig, origin: Origin | None = None, loaded: Robot | None = None
) -> tuple[ExperimentConfig, Robot]:
    """Return an experiment with all that its world assumes, and its arm; no plant or controller is made.

    Args:
        config: the experiment.
        origin: where it came from.
        loaded: its arm, where it was loaded before by the same section `robot`.

    Raises:
        ConfigError: when something does not fit the robot; it names the key.
    """
    return _with_assumptions(config, _Place(origin or Origin()), loaded)


def has_rule(config: ExperimentConfig) -> bool:
    """Tell whether a controller of an experiment is tuned automatically."""
    return any(each.type == Untuned.config_name for each in config.controllers)


def verdicts(experiment: Experiment) -> dict[str, Verdict]:
    """Return what each automatic controller tolerates, label -> verdict.

    Those of a reality, whose drives are drawn, have none.
    """
    config, found = experiment.config, {}
    if config.reality is None and isinstance(experiment.robot, Robot):
        context = _context(config, experiment.robot, _Place(Origin("experiment")))
        for section in config.controllers:
            if section.type == Untuned.config_name:
                law = experiment.controllers[section.label]
                found[section.label] = verdict(law, experiment.robot, assume(context.bits))
    return found


def expand(config: ExperimentConfig, place: _Place | None = None) -> RobotSection:
    """Return the section of the robot; the folder of an identified arm is its URDF, drives and locked joints.

    Where arms are drawn from what was identified, its file is named as well.

    Raises:
        ConfigError: when a file in the folder is damaged, or assumptions on drives are asked for as well.
    """
    place = place or _Place(Origin()).at("robot")
    section: RobotSection = config.robot
    with place.at("name").error_context():
        if (found := robots.find_identified(section.name)) is None:
            return section
        if isinstance(section.drives, str):
            said = f"{section.name} has its own; name the URDF in it to assume others"
            raise place.at("drives").error(said)
        drives = Drives.read(found.drives).plain()
    for joint, own in (section.drives or {}).items():
        drives[joint] = {**drives.get(joint, {}), **own} if isinstance(own, Mapping) else own
    more: dict[str, Any] = {"drives": drives}
    if IDENTIFICATION in config.vary and section.posterior is None:
        more["posterior"] = str(found.path)
    return section.replace(**found.section(section.lock, section.repair), **more)


def _load(section: RobotSection, place: _Place) -> Robot:
    """Return the arm as its file has it.

    Raises:
        ConfigError: when it cannot be loaded; it names the key.
    """
    # In a mapping, a joint without a value is locked where Robot.load would lock it by its name alone.
    lock: Any = section.lock
    try:
        return Robot.load(section.name, lock, section.keep, section.mimic, section.repair)
    except NameNotFound as error:
        # Robots and joints are looked up: say whose key it is.
        other = "repair" if "repair" in error.kind else "name"
        key = next((k for k in ("lock", "keep") if error.name in (getattr(section, k) or ())), other)
        raise place.at(key).error(str(error)) from None
    except ArmgpiError as error:
        raise place.at("name").error(str(error)) from error
    except OSError as error:  # a name too long for a file, for one
        raise place.at("name").error(f"cannot be read: {error.strerror or error}") from None


def _robot(section: RobotSection, place: _Place) -> Robot:
    """Return the arm."""
    robot = _load(section, place)
    if section.keep is None and (several := chains.of(robot.provenance)):
        arm = chains.first_arm(several).name
        text = f"{chains.describe(several)}; they run as one arm: keep one, such as {arm} (--keep {arm})"
        warnings.warn(str(place.at("keep").error(text)), ArmgpiWarning, stacklevel=2)
    robot = _with_changes(robot, section, place, ("effort",))
    if not isinstance(section.drives, str):
        robot = _with_drives(robot, section.drives, place.at("drives"))
    robot = _with_changes(robot, section, place, ("rotor_inertia",))
    if section.friction is not None:
        robot = _with_changes(robot, section.friction, place.at("friction"), ("viscous", "coulomb"))
    return robot.with_gravity((0.0, 0.0, 0.0)) if section.gravity == "robot" else robot


def _with_changes(
    robot: Robot, section: Section, place: _Place, names: Sequence[str], known: Robot | None = None
) -> Robot:
    """Return the arm with what a section says of some of its quantities.

    Args:
        robot: the arm.
        section: of the file.
        place: of the section.
        names: of the quantities.
        known: whose values joints keep that a mapping leaves out; the arm's own when not given.
    """
    known = robot if known is None else known
    now = {"effort": known.limits.effort, "rotor_inertia": known.armature, **known.friction._asdict()}
    given = {name: value for name in names if (value := getattr(section, name)) is not None}
    values = {
        name: _value(CHANGES[name], value, robot, place.at(name), now.get(name))
        for name, value in given.items()
    }
    with place.at(names[0]).error_context():
        return change(robot, values)


def _with_drives(robot: Robot, data: Mapping[str, Any] | None, place: _Place) -> Robot:
    """Return the arm with what a section says of its drives."""
    if data is None:
        return robot
    try:
        return robot.with_drives(data)
    except ConfigError as error:
        joint, *key = error.key.split(".", 1)
        message = str(error).removeprefix(f"{error.source}: {error.key}: ")
        raise place.at(joint, *key).error(message) from None


def _context(config: ExperimentConfig, robot: Robot, top: _Place) -> Context:
    """Return what controllers know."""
    delay = getattr(config.plant, "delay", None) or 0
    bits = getattr(config.plant, "encoder_bits", None)
    if bits is not None:
        bits = _per_joint(bits, robot, top.at("plant", "encoder_bits"), parameters(Encoder)["bits"].default)
    dt = config.sample_time
    rated = config.supervisor is not None and config.supervisor.torque_rate is not None
    return Context(robot, dt, config.seed, delay * dt, bits, robot, rated=rated)


def _apply_draw(
    config: ExperimentConfig, robot: Robot, top: _Place
) -> tuple[ExperimentConfig, Context, Plant, float]:
    """Return what a scenario of an uncertainty model contains, and the configuration completed by it.

    Its delay is in samples, as that of `plant`: another sample time makes it another time. A reference
    that has its defaults counts as left out.

    Returns:
        The configuration, what controllers know, the plant, and how long the scenario lasts [s]: as long
        its own move runs, and at least so long one of the file.
    """
    place, section = top.at("reality"), config.reality
    assert section is not None
    if config.plant != PlantSection():
        raise place.error("reality and plant are mutually exclusive: use one of the two")
    with place.error_context():
        reality = Reality(**{name: getattr(section, name) for name in parameters(Reality)})
        draw = reality.draw(robot, section.index)
        found = stack_draws([draw])
    update: dict[str, Any] = {}
    if "sample_time" not in config.given:
        update["sample_time"] = draw.dt
    if config.reference == ReferenceSection():
        move = draw.move
        points = [move.start.tolist(), move.goal.tolist()]
        update["reference"] = ReferenceSection(
            points=points, durations=[move.duration], holds=[move.begin, 0.0]
        )
        if config.t_final is None:
            update["t_final"] = draw.t_final
    config = config.replace(**update)
    dt = config.sample_time
    context = found.context._replace(dt=dt, seed=config.seed, delay=draw.delay * dt)
    return config, context, found.plant, float(draw.t_final)


def _plant(config: ExperimentConfig, context: Context, place: _Place, engine: str) -> Plant:
    """Return the plant in a simulator, with its loads, sensors and actuators."""
    section, robot = config.plant, context.robot
    real = real_arm(section, robot, place)
    torques: list[Load] = []
    for index, item in enumerate(section.loads):
        here = place.at("loads", index)
        with here.error_context():
            kind = classes_of(Load)[item.type]
            torques += kind.configured(_given_values(item, parameters(kind), robot, here, {}, 0.0), context)
    offset = real.drives.value("offset", 0.0)
    if section.friction == "urdf" and offset.any():
        torques.append(Step(offset))
    contacts: list[Contact] = []
    for index, item in enumerate(section.environment):
        here = place.at("environment", index)
        with here.error_context():
            touching = classes_of(Contact)[item.type]
            contacts.append(
                touching.configured(_given_values(item, parameters(touching), robot, here), context)
            )
    plant = _arm(config, real, torques, contacts, context, place, engine)
    for name, wrapper in sorted(classes_of(Wrapper).items(), key=lambda item: item[1].order):
        value = getattr(section, name, None)  # a class made since then is no key
        given = None
        own = {key: each for key, each in parameters(wrapper).items() if each.in_file}
        if value is not None and value != wrapper.off:
            if len(own) == 1:  # a bare value
                ((key, declared),) = own.items()
                default = declared.default if declared.default is not REQUIRED else None
                given = {key: _value(declared, value, robot, place.at(name), default)}
            else:
                given = _given_values(value, own, robot, place.at(name))
        with place.at(name).error_context():
            plant = wrapper.configured(plant, given, context)
    return plant


_PLANT = _Place(Origin(), ("plant",))


def real_arm(section: PlantSection, robot: Robot, place: _Place = _PLANT) -> Robot:
    """Return the arm that a plant has, from that of its file.

    Raises:
        ConfigError: when something does not fit the robot; it names the key.
    """
    real = robot
    if section.bodies is not None:
        model = robot.pinocchio_model()
        table = {name: model.inertias[i].toDynamicParameters() for i, name in enumerate(model.names) if i}
        with place.at("bodies").error_context():
            for joint, numbers in section.bodies.items():
                if joint not in table:
                    raise NameNotFound("joint", joint, table)
                table[joint] = np.array(numbers)
            real = robot.with_bodies([*table.values()])
    real = _with_changes(real, section, place, ("inertia_scale",))
    if section.payload is not None:
        with place.at("payload").error_context():
            load = section.payload
            real = change(real, {"payload": load.mass, "frame": load.frame, "com": load.com})
    real = _with_drives(real, section.drives, place.at("drives"))
    if has_friction(section) and section.friction == "none":  # what is not given is none
        real = change(real, dict.fromkeys(("viscous", "coulomb"), np.zeros(real.n)))
    return _with_changes(real, section, place, PLANT_CHANGES[1:], robot)


def has_friction(section: PlantSection) -> bool:
    """Tell whether a plant's joints rub."""
    return section.friction == "urdf" or (section.viscous, section.coulomb) != (None, None)


def _check_engine_keys(section: PlantSection, own: Set[str], place: _Place) -> None:
    """Refuse keys of a plant that its engine does not have."""
    for key, others in ARM_KEYS.items():
        if key not in own and getattr(section, key) != others.key.default:
            both = ", or both" if set(others.engines) & {*ENGINES} else ""
            raise place.at(key).error(f"requires engine: {' or '.join(others.engines)}{both}")


def _arm(
    config: ExperimentConfig,
    real: Robot,
    torques: list[Load],
    contacts: list[Contact],
    context: Context,
    place: _Place,
    engine: str,
) -> Plant:
    """Return the arm in a simulator."""
    section = config.plant
    kind = classes_of(Arm)[engine]
    own = {name: each for name, each in parameters(kind).items() if each.in_file}
    if section.engine == engine:
        _check_engine_keys(section, {each.file_key for each in own.values()}, place)
    friction = "urdf" if has_friction(section) else None
    values = _given_values(section, own, context.robot, place)
    for name, each in own.items():
        if each.default is REQUIRED and name not in values:
            raise place.at(each.file_key).error(f"is missing: engine {engine} needs it")
    with place.at("engine").error_context() if engine != ENGINES[0] else place.error_context():
        # Engines of plugins may have been written before there were environments.
        more = {"environment": contacts} if contacts else {}
        arm: Plant = kind.configured(real, torques, friction, values, context, **more)
    return arm


def controller(section: Any, context: Context) -> Controller:
    """Return the controller that a section of an experiment file describes, for one rollout or a batch.

    Args:
        section: plain data, such as ``{"type": "gpi", "omega": 20.0}``.
        context: what it knows; its robots may be batches.

    Raises:
        ConfigError: when the section is wrong or does not fit; it names the key.
    """
    checked, place = _checked_controller(section, context)
    return _controller(checked, context, place)[1]


def told_context(section: Any, context: Context) -> Context:
    """Return the context of a controller with what its section sets; arguments as :func:`controller`.

    Raises:
        ConfigError: when the section is wrong or does not fit; it names the key.
    """
    checked, place = _checked_controller(section, context)
    return _told(checked, context, place).context


def _checked_controller(section: Any, context: Context) -> tuple[Any, _Place]:
    """Return a checked section of a controller, and where errors are."""
    origin = Origin("controller")
    wanted = {"robot": {"name": context.robot.name}, "controllers": [section]}
    (checked,) = check(wanted, origin).controllers
    return checked, _Place(origin, ("controllers", 0))


class _Told(NamedTuple):
    """What the section of a controller sets.

    Attributes:
        context: of the controller, with its nominal model and what is set.
        law: name -> value of each parameter of the controller, besides the variant's.
        keys: name -> key in a file, of the controller and its variant.
        told: keys that are set.
    """

    context: Context
    law: dict[str, Any]
    keys: dict[str, str]
    told: set[str]


def _told(section: Section, context: Context, place: _Place) -> _Told:
    """Return what the section of a controller sets."""
    if section.nominal is not None:
        nominal = _nominal(section, context.robot, place.at("nominal"))
        context = context._replace(robot=nominal, nominal=nominal)
    robot, kind = context.robot, KINDS[section.type]
    scale = section.inertia_scale
    declared = parameters(kind.law)
    context = context._replace(
        nominal=context.nominal if scale == 1.0 else context.nominal.scaled_inertia(scale),
        error_context=lambda name: place.at(declared[name].file_key).error_context(),
    )
    law = _given_values(section, {k: v for k, v in declared.items() if v.kind != "variant"}, robot, place)
    source: Any = kind.variant or kind.law
    keys = {name: each.file_key for name, each in {**declared, **parameters(source)}.items()}
    told = {key for key in section.given if getattr(section, key) is not None}
    set_here = {name: value for name, value in law.items() if keys[name] in told}
    context = kind.law.context_for(law, context._replace(given=set_here))
    return _Told(context, law, keys, told)


def _controller(section: Section, context: Context, place: _Place) -> tuple[Any, Controller]:
    """Return one controller, and its section with the defaults filled in."""
    context, law, keys, told = _told(section, context, place)
    robot, kind, set_here = context.robot, KINDS[section.type], context.given
    declared = parameters(kind.law)
    source: Any = kind.variant or kind.law
    # Of a section that says all there is to choose, the choice (half a second of a rule) would be dropped.
    chosen: dict[str, Any] = {}
    if not _says_all(section, parameters(source), keys, told, robot):
        everything = source.chosen(context)
        chosen = {name: value for name, value in everything.items() if name not in set_here}
    missing = {keys[name]: _as_section(value) for name, value in chosen.items() if keys[name] not in told}
    if robot.batch is None:  # what differs by rollout has no form in a file
        section = type(section).read({**section.plain(), **missing})
    if kind.variant is not None:
        given = _given_values(section, parameters(kind.variant), robot, place, chosen)
        part: dict[str, Any] = {}
        for name, value in chosen.items():
            (law if name in declared else part)[name] = value
        law[kind.part] = kind.variant(**{**part, **given})
    else:
        law = {**chosen, **_given_values(section, declared, robot, place, chosen)}
    return section, _force_limited(kind.law.configured(law, context), section, context, place)


def _says_all(
    section: Section, declared: Mapping[str, Parameter], keys: Mapping[str, str], told: set[str], robot: Robot
) -> bool:
    """Tell whether a controller's section leaves nothing to choose for the arm.

    Args:
        section: of the controller.
        declared: parameters of what chooses.
        keys: name of a parameter -> its key in the section.
        told: keys that have a value.
        robot: of which every joint needs one.
    """
    if not section.given >= {*section.keys} - section.quiet:
        return False
    for name, each in declared.items():
        if each.default is REQUIRED and keys[name] not in told:
            return False
    for key in told:
        value = getattr(section, key)
        if isinstance(value, dict) and {*robot.joint_names} - {*value}:
            return False  # a mapping of some joints leaves the others to the choice
    return True


def _force_limited(law: Controller, section: Section, context: Context, place: _Place) -> Controller:
    """Return a controller under the force limit of its section, where it has none of its own."""
    if KINDS[section.type].limits_force:
        return law
    given = _given_values(section, parameters(ForceSettings), context.robot, place)
    if given and "force_limit" not in given:
        raise place.at(next(iter(given))).error("left out where there is no force_limit")
    return ForceLimited(law, **given, delay=context.delay) if given else law


def _nominal(section: Section, robot: Robot, place: _Place) -> Robot:
    """Return the arm that a controller takes for the one there is: loaded and held by the same motors."""
    if not isinstance(robot, Robot):
        raise place.error(
            "an uncertainty model (reality) determines the nominal model itself: leave this key out"
        )
    if robots.find_identified(section.nominal) is not None:
        raise place.error("expected a URDF, got the folder of an identified arm; name the URDF in it")
    there = robot.provenance
    repairs = made_in(there)
    with place.error_context():
        found = Robot.load(section.nominal, there["locked"], None, there.get("mimic", "lock"), repairs)
        if found.joint_names != robot.joint_names:
            raise place.error(
                f"expected joints {', '.join(robot.joint_names)}; got {', '.join(found.joint_names)}"
            )
        gravity = robot.pinocchio_model().gravity.linear
        found = change(found, {"effort": robot.limits.effort, "gravity": gravity})
    return rotors.assume_drives(found) if section.type == Untuned.config_name else found


def _as_section(value: Any) -> Any:
    """Return a chosen value as an experiment file has it: one number where all are the same."""
    if isinstance(value, tuple):
        return {"lower": _as_section(value[0]), "upper": _as_section(value[1])}
    if isinstance(value, str | int):
        return value
    if isinstance(value, Parametrised):
        return value.values()
    array = np.asarray(value, dtype=np.float64)
    return float(array.flat[0]) if (array == array.flat[0]).all() else array.tolist()


def _given_values(
    section: Section,
    declared: Mapping[str, Parameter],
    robot: Robot,
    place: _Place,
    chosen: Mapping[str, Any] | None = None,
    others: float | None = None,
) -> dict[str, Any]:
    """Return what a section gives of declared parameters, by their names, as constructors take it.

    Args:
        section: of the file.
        declared: the parameters.
        robot: the arm.
        place: of the section.
        chosen: defaults that were worked out for this experiment.
        others: what joints get that a mapping leaves out and that have no default.
    """
    found: dict[str, Any] = {}
    for name, each in declared.items():
        value = getattr(section, each.file_key, None) if each.in_file else None
        if value is None:
            continue
        default = (chosen or {}).get(name, found.get(each.follows, each.default))
        if default is REQUIRED or default is None or isinstance(default, tuple):
            default = others
        found[name] = _value(each, value, robot, place.at(each.file_key), default)
    return found


def _value(declared: Parameter, value: Any, robot: Robot, place: _Place, default: Any) -> Any:
    """Return one value as constructors take it."""
    if declared.kind == "group":
        assert declared.group is not None
        with place.error_context():
            return declared.group(**_given_values(value, parameters(declared.group), robot, place))
    if isinstance(value, Section):  # a box
        lower, upper = (
            _per_joint(getattr(value, end), robot, place.at(end), None) for end in ("lower", "upper")
        )
        if np.any(lower > upper):
            raise place.error(f"expected lower <= upper, got {lower.tolist()} above {upper.tolist()}")
        return lower, upper
    if declared.kind == "table":
        with place.error_context():
            return declared.check_value(value, robot.joint_names)
    return _per_joint(value, robot, place, default) if declared.per_joint else value


def _reference(
    config: ExperimentConfig, robot: Robot, place: _Place
) -> tuple[Reference, float, ReferenceSection]:
    """Return the reference, when it has ended [s], and its section with the defaults filled in."""
    section = config.reference
    for other in ("file", "path", "poses", "stream"):
        for key in ("points", "durations", "holds", "file", "path", "poses"):
            if key != other and getattr(section, other) is not None and getattr(section, key) is not None:
                message = f"{other} and this key are mutually exclusive: use one of the two"
                raise place.at(key).error(message)
    for key in _STREAM_KEYS:
        if section.stream is None and getattr(section, key) is not None:
            raise place.at(key).error("requires stream")
    if section.poses is not None or section.stream is not None:
        return _follow_poses(section, robot, place)
    if section.path is not None:
        return _follow_path(section, robot, place)
    if section.frame is not None:
        raise place.at("frame").error("requires path, poses or stream")
    if section.file is None:
        return _moves(config, robot, place)
    with place.at("file").error_context():
        recorded = Recorded.load(section.file, robot)
    return recorded, recorded.t_end, section


def _follow_path(
    section: ReferenceSection, robot: Robot, place: _Place
) -> tuple[Reference, float, ReferenceSection]:
    """Return a path of the tool as a reference; see `_reference`."""
    frame = section.frame or robot.tip
    with place.at("frame").error_context():
        robot.frame_pose(frame, robot.middle())
    axis = section.tool_axis or [0.0, 0.0, 1.0]
    inverse = _inverse(section, robot, frame, axis, place)
    with place.at("path").error_context():
        drawn, path = _path(section.path, robot, frame, section.direction, axis)
        reference = CartesianReference(robot, frame, path, inverse)
    end = path.t_end if math.isfinite(path.t_end) else _PATH_TIME
    return reference, end, section.replace(frame=frame, path=drawn)


def _follow_poses(
    section: ReferenceSection, robot: Robot, place: _Place
) -> tuple[Reference, float, ReferenceSection]:
    """Return poses of a file as a reference, known in advance or as they arrive; see `_reference`."""
    for key in ("direction", "tool_axis"):
        if getattr(section, key) is not None:
            raise place.at(key).error("requires path")
    frame = section.frame or robot.tip
    with place.at("frame").error_context():
        robot.frame_pose(frame, robot.middle())
    section = section.replace(frame=frame)
    if section.poses is not None:
        with place.at("poses").error_context():
            path = PosePath.load(section.poses)
            return CartesianReference(robot, frame, path), path.t_end, section
    limits = None
    if section.torque_rate is not None:
        limits = FollowLimits.of(robot, section.torque_rate)
    start = section.start
    if start is not None:
        start = _per_joint(start, robot, place.at("start"), robot.middle())
        with place.at("start").error_context():
            robot.check_position(start, "start")
    with place.at("stream").error_context():
        stream = Setpoints.load(
            section.stream, robot, frame, limits=limits, start=start, feedforward=bool(section.feedforward)
        )
    return stream, float(stream.times[-1]), section


def _inverse(
    section: ReferenceSection, robot: Robot, frame: str, axis: list[float], place: _Place
) -> Inverse:
    """Return the inverse kinematics of a frame: in closed form where the arm has one, else by tracking."""
    closed = next((each for each in subclasses(ClosedForm) if each.fits(robot, frame)), None)
    if section.direction is not None or closed is None:
        with place.error_context():
            return TrackingInverse(robot, frame, direction=section.direction, tool_axis=axis)
    if section.tool_axis is not None:
        raise place.at("tool_axis").error("requires direction")
    inverse: Inverse = closed()
    return inverse


def _path(
    section: Section, robot: Robot, frame: str, direction: list[float] | None, axis: list[float]
) -> tuple[Any, Path]:
    """Return a path, and its section with what was left out chosen for the arm."""
    kind = classes_of(Path)[section.type]
    own = parameters(kind)
    missing = [name for name, each in own.items() if each.chosen and getattr(section, each.file_key) is None]
    if missing:
        point = _roomiest(robot, frame, direction, axis)
        chosen = kind.fitted(point, _PATH_SIZE * float(np.linalg.norm(point)))
        update = {own[name].file_key: np.asarray(chosen[name]).tolist() for name in missing}
        section = section.replace(**update)
    path = kind(**{name: getattr(section, each.file_key) for name, each in own.items() if each.in_file})
    return section, Eased(path, section.ease) if kind.starts_moving and section.ease else path


def _roomiest(robot: Robot, frame: str, direction: list[float] | None, axis: list[float]) -> Array:
    """Return the point at which the arm has the most clearance, of some."""
    clearance = TrackingInverse(robot, frame, direction=direction, tool_axis=axis).clearance
    q = random_configurations(robot, _CANDIDATES, seed=0)
    points = robot.frame_pose(frame, q).translation
    if direction is not None:
        found = inverse_kinematics(robot, frame, points, direction=direction, tool_axis=axis, restarts=4)
        if found.reached.any():
            q, points = found.q[found.reached], points[found.reached]
    point: Array = points[np.argmax(clearance(q))]
    return point


def _moves(
    config: ExperimentConfig, robot: Robot, place: _Place
) -> tuple[Waypoints, float, ReferenceSection]:
    """Return moves from configuration to configuration; see `_reference`."""
    section, points, usual = config.reference, [], 0.0
    here = goal = robot.middle()
    # Points that name every joint need no start: searching one takes a while for a new arm.
    if section.points is None or isinstance(section.points[0], Mapping):
        here, goal = default_move.ends(robot, old=config.ideal is None)
    if section.points is None:
        points, usual = [here, goal, here], default_move.HOLD
    for index, point in enumerate(section.points or ()):
        here = _per_joint(point, robot, place.at("points", index), here)
        with place.at("points", index).error_context():
            robot.check_position(here, f"point {index + 1} of the reference")
        points.append(here)
    durations, holds = section.durations, usual if section.holds is None else section.holds
    if durations is None:
        durations = [default_move.gentle_duration(robot, a, b) for a, b in pairwise(points)]
    with place.error_context():
        reference = Waypoints(points, durations, holds)
    filled = ReferenceSection(points=[x.tolist() for x in points], durations=durations, holds=holds)
    return reference, reference.t_end, filled


def _per_joint(
    value: float | list[float] | Mapping[str, float],
    robot: Robot,
    place: _Place,
    default: Array | float | None,
) -> Array:
    """Return a per-joint quantity as an array (n,); see :func:`armgpi.base.arrays.quantity`."""
    name = str(place.path[-1])
    try:
        return quantity(value, name, robot.joint_names, default)
    except NameNotFound as error:
        raise place.at(str(error.name)).error(str(error)) from None
    except ArrayError as error:
        raise place.error(str(error).removeprefix(f"{name}: ")) from None
