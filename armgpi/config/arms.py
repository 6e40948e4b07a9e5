"""The arm of an experiment: how it is loaded, its drives, and what its world assumes of them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from armgpi.config import world
from armgpi.config.place import Place
from armgpi.config.reading import Origin
from armgpi.config.schema import ExperimentConfig, RobotSection
from armgpi.config.section import Section
from armgpi.config.values import value_of
from armgpi.errors import ArmgpiError, ArmgpiWarning, ConfigError, NameNotFound
from armgpi.robot import chains, robots, rotors
from armgpi.robot.changes import CHANGES, change
from armgpi.robot.drives import Drives
from armgpi.robot.robot import Robot
from armgpi.tuning.rule import Untuned

#: What a sweep calls the arms that an identification leaves possible.
IDENTIFICATION = "identification"


def with_assumptions(
    config: ExperimentConfig, top: Place, loaded: Robot | None = None
) -> tuple[ExperimentConfig, Robot]:
    """Return the arm of an experiment, and the experiment with what is assumed of its drives filled in.

    They are assumed where the file asks for it, and where it does not and has an automatic controller. Then
    the plant has the same drives: it is elastic where joints are elastic, unless another one is asked for.
    An uncertainty model has drives of its own.
    """
    section = expand(config, top.at("robot"))
    config = config.replace(robot=section)
    robot = build_robot(section, top.at("robot")) if loaded is None else loaded
    section, robot = _with_encoder_side(config, section, robot)
    config = world.in_world(config.replace(robot=section), robot)
    word = section.drives if isinstance(section.drives, str) else None
    realistic = config.ideal is False or (config.ideal is None and has_rule(config))
    if word is None and (config.reality is not None or not realistic):
        return config, robot
    robot = rotors.assume_drives(robot, word)
    if word != "none":
        config = config.replace(robot=_with_assumed_drives(config, section, robot))
    all_elastic = np.isfinite(robot.drives.value("stiffness")).all() and robot.armature.all()
    if all_elastic and "engine" not in config.plant.given and config.reality is None:
        config = config.replace(plant=config.plant.replace(engine="elastic"))
    return config, robot


def _with_assumed_drives(config: ExperimentConfig, section: RobotSection, robot: Robot) -> RobotSection:
    """Return the section of the robot in which a word for its drives is replaced by what it assumes.

    So a file that is written of the experiment has the numbers, whatever a later version assumes.

    Args:
        config: the experiment.
        section: of its robot.
        robot: with the drives that are assumed.
    """
    drives: dict[str, dict[str, Any]] = {}
    if isinstance(section.drives, dict):
        drives = {joint: dict(quantities) for joint, quantities in section.drives.items()}
    elif section.drives is not None and config.plant.encoder_side is not None:
        sides = robot.drives.value("encoder_side")
        for joint, side in zip(robot.joint_names, sides, strict=True):
            drives[joint] = {"encoder_side": str(side)}
    for quantity, data in robot.drives.data.items():
        for joint, datum in data.items():
            if datum.source in ("assumed", "published"):
                drives.setdefault(joint, {})[quantity] = datum.plain()
    # Where there was nothing to assume, the word still says that there is not.
    return section.replace(drives=drives or section.drives)


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
    drives = {joint: dict(quantities) for joint, quantities in (section.drives or {}).items()}
    for joint in unknown:
        drives[joint] = {**drives.get(joint, {}), "encoder_side": side}
    return section.replace(drives=drives), known


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
    return with_assumptions(config, Place(origin or Origin()), loaded)


def has_rule(config: ExperimentConfig) -> bool:
    """Tell whether a controller of an experiment is tuned automatically."""
    return any(each.type == Untuned.config_name for each in config.controllers)


def expand(config: ExperimentConfig, place: Place | None = None) -> RobotSection:
    """Return the section of the robot; the folder of an identified arm is its URDF, drives and locked joints.

    Where arms are drawn from what was identified, its file is named as well.

    Raises:
        ConfigError: when a file in the folder is damaged, or assumptions on drives are asked for as well.
    """
    place = place or Place(Origin()).at("robot")
    section: RobotSection = config.robot
    with place.at("name").error_context():
        found = robots.find_identified(section.name)
        if found is None:
            return section
        if isinstance(section.drives, str):
            message = f"{section.name} has its own; name the URDF in it to assume others"
            raise place.at("drives").error(message)
        drives = Drives.read(found.drives).plain()
    for joint, quantities in (section.drives or {}).items():
        if isinstance(quantities, Mapping):
            quantities = {**drives.get(joint, {}), **quantities}
        drives[joint] = quantities  # what is no mapping is refused with the drives
    more: dict[str, Any] = {"drives": drives}
    if IDENTIFICATION in config.vary and section.posterior is None:
        more["posterior"] = str(found.path)
    return section.replace(**found.section(section.lock, section.repair), **more)


def _load(section: RobotSection, place: Place) -> Robot:
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
        key = "repair" if "repair" in error.kind else "name"
        for candidate in ("lock", "keep"):
            if error.name in (getattr(section, candidate) or ()):
                key = candidate
                break
        raise place.at(key).error(str(error)) from None
    except ArmgpiError as error:
        raise place.at("name").error(str(error)) from error
    except OSError as error:  # a name too long for a file, for one
        raise place.at("name").error(f"cannot be read: {error.strerror or error}") from None


def build_robot(section: RobotSection, place: Place) -> Robot:
    """Return the arm of a section: loaded, with torque limits, drives, rotors, friction and gravity.

    Warns where several arms of a robot run as one.

    Raises:
        ConfigError: when it cannot be loaded or a value does not fit it; it names the key.
    """
    robot = _load(section, place)
    if section.keep is None and (several := chains.of(robot.provenance)):
        arm = chains.first_arm(several).name
        text = f"{chains.describe(several)}; they run as one arm: keep one, such as {arm} (--keep {arm})"
        warnings.warn(str(place.at("keep").error(text)), ArmgpiWarning, stacklevel=2)
    robot = with_changes(robot, section, place, ("effort",))
    if not isinstance(section.drives, str):
        robot = with_drives(robot, section.drives, place.at("drives"))
    robot = with_changes(robot, section, place, ("rotor_inertia",))
    if section.friction is not None:
        robot = with_changes(robot, section.friction, place.at("friction"), ("viscous", "coulomb"))
    if section.gravity == "robot":  # the robot compensates it itself
        return robot.with_gravity((0.0, 0.0, 0.0))
    return robot


def with_changes(
    robot: Robot, section: Section, place: Place, names: Sequence[str], known: Robot | None = None
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
    values = {}
    for name in names:
        value = getattr(section, name)
        if value is not None:
            values[name] = value_of(CHANGES[name], value, robot, place.at(name), now.get(name))
    with place.at(names[0]).error_context():
        return change(robot, values)


def with_drives(robot: Robot, data: Mapping[str, Any] | None, place: Place) -> Robot:
    """Return the arm with what a section says of its drives."""
    if data is None:
        return robot
    try:
        return robot.with_drives(data)
    except ConfigError as error:
        joint, *key = error.key.split(".", 1)
        message = str(error).removeprefix(f"{error.source}: {error.key}: ")
        raise place.at(joint, *key).error(message) from None
