"""The plant of an experiment: its arm, loads, contacts, sensors, actuators; and what controllers know."""

from __future__ import annotations

from collections.abc import Iterator, Set
from itertools import chain
from typing import Any

import numpy as np

from armgpi.base.parameter import REQUIRED, parameters
from armgpi.config.arms import with_changes, with_drives
from armgpi.config.place import Place
from armgpi.config.reading import Origin
from armgpi.config.schema import ARM_KEYS, PLANT_CHANGES, ExperimentConfig, PlantSection, ReferenceSection
from armgpi.config.values import given_values, per_joint, value_of
from armgpi.errors import NameNotFound
from armgpi.plants.arm import Arm
from armgpi.plants.environment import Contact
from armgpi.plants.loads import Load, Step
from armgpi.plants.plant import Plant, Wrapper
from armgpi.plants.reality import Reality, stack_draws
from armgpi.plants.sensors import Encoder
from armgpi.registry import Context, classes_of
from armgpi.robot.changes import change
from armgpi.robot.robot import Robot

#: Simulators, in the order in which both are run.
ENGINES = ("armgpi", "mujoco")


def context_of(config: ExperimentConfig, robot: Robot, top: Place) -> Context:
    """Return what controllers know."""
    delay = getattr(config.plant, "delay", None) or 0
    bits = getattr(config.plant, "encoder_bits", None)
    if bits is not None:
        bits = per_joint(bits, robot, top.at("plant", "encoder_bits"), parameters(Encoder)["bits"].default)
    dt = config.sample_time
    rated = config.supervisor is not None and config.supervisor.torque_rate is not None
    return Context(robot, dt, config.seed, delay * dt, bits, robot, rated=rated)


def apply_draw(
    config: ExperimentConfig, robot: Robot, top: Place
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


def build_plant(config: ExperimentConfig, context: Context, place: Place, engine: str) -> Plant:
    """Return the plant in a simulator, with its loads, sensors and actuators.

    Args:
        config: the experiment.
        context: what its controllers know.
        place: of the section `plant`.
        engine: the simulator; one of two where the file asks for both.

    Raises:
        ConfigError: when something does not fit the robot; it names the key.
    """
    section = config.plant
    real = real_arm(section, context.robot, place)
    loads = _loads(section, context, place)
    offset = real.drives.value("offset", 0.0)
    if section.friction == "urdf" and offset.any():
        loads.append(Step(offset))
    contacts = _contacts(section, context, place)
    plant = _arm(config, real, loads, contacts, context, place, engine)
    # The nearest to the arm first.
    for name, wrapper in sorted(classes_of(Wrapper).items(), key=lambda item: item[1].order):
        values = _wrapper_values(section, name, wrapper, context.robot, place)
        with place.at(name).error_context():
            plant = wrapper.configured(plant, values, context)
    return plant


def _loads(section: PlantSection, context: Context, place: Place) -> list[Load]:
    """Return the disturbance torques of a plant; joints that a mapping leaves out have none."""
    return list(chain.from_iterable(_entries(section, "loads", Load, context, place, others=0.0)))


def _contacts(section: PlantSection, context: Context, place: Place) -> list[Contact]:
    """Return what the tool of a plant touches."""
    return list(_entries(section, "environment", Contact, context, place))


def _entries(
    section: PlantSection, key: str, base: type, context: Context, place: Place, others: float | None = None
) -> Iterator[Any]:
    """Yield what each entry of a list of a plant makes.

    Args:
        section: of the plant.
        key: of the list.
        base: class of what an entry names by its type.
        context: what else the experiment is.
        place: of the section.
        others: what joints get that a mapping leaves out and that have no default.
    """
    for index, item in enumerate(getattr(section, key)):
        item_place = place.at(key, index)
        kind = classes_of(base)[item.type]
        with item_place.error_context():
            values = given_values(item, parameters(kind), context.robot, item_place, others=others)
            made = kind.configured(values, context)
        yield made


def _wrapper_values(
    section: PlantSection, name: str, wrapper: type[Wrapper], robot: Robot, place: Place
) -> dict[str, Any] | None:
    """Return what a plant sets of a sensor or actuator; None where it is off.

    One with a single parameter has a bare value in the file, others a mapping.
    """
    value = getattr(section, name, None)  # a class made since then is no key
    if value is None or value == wrapper.off:
        return None
    declared = {key: each for key, each in parameters(wrapper).items() if each.in_file}
    if len(declared) != 1:
        return given_values(value, declared, robot, place.at(name))
    ((key, parameter),) = declared.items()
    default = None if parameter.default is REQUIRED else parameter.default
    return {key: value_of(parameter, value, robot, place.at(name), default)}


_PLANT = Place(Origin(), ("plant",))


def real_arm(section: PlantSection, robot: Robot, place: Place = _PLANT) -> Robot:
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
    real = with_changes(real, section, place, ("inertia_scale",))
    if section.payload is not None:
        with place.at("payload").error_context():
            load = section.payload
            real = change(real, {"payload": load.mass, "frame": load.frame, "com": load.com})
    real = with_drives(real, section.drives, place.at("drives"))
    if has_friction(section) and section.friction == "none":  # what is not given is none
        real = change(real, dict.fromkeys(("viscous", "coulomb"), np.zeros(real.n)))
    return with_changes(real, section, place, PLANT_CHANGES[1:], robot)


def has_friction(section: PlantSection) -> bool:
    """Tell whether a plant's joints rub."""
    return section.friction == "urdf" or (section.viscous, section.coulomb) != (None, None)


def _check_engine_keys(section: PlantSection, own: Set[str], place: Place) -> None:
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
    place: Place,
    engine: str,
) -> Plant:
    """Return the arm in a simulator."""
    section = config.plant
    kind = classes_of(Arm)[engine]
    own = {name: each for name, each in parameters(kind).items() if each.in_file}
    if section.engine == engine:
        _check_engine_keys(section, {each.file_key for each in own.values()}, place)
    friction = "urdf" if has_friction(section) else None
    values = given_values(section, own, context.robot, place)
    for name, each in own.items():
        if each.default is REQUIRED and name not in values:
            raise place.at(each.file_key).error(f"is missing: engine {engine} needs it")
    with place.at("engine").error_context() if engine != ENGINES[0] else place.error_context():
        # Engines of plugins may have been written before there were environments.
        more = {"environment": contacts} if contacts else {}
        arm: Plant = kind.configured(real, torques, friction, values, context, **more)
    return arm
