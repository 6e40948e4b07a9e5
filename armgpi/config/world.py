"""The two worlds of an experiment: what is simulated, and known to controllers, where nothing specifies it.

*Realistic*: drives specified or assumed, friction that the URDF contains, absolute encoders, a delay, and the
automatic controller. *Ideal*: rigid joints, no rotors, no friction, exact positions, and the controller as
printed in the paper. The key ``ideal`` chooses; keys of the file win over both.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from armgpi.config.schema import ExperimentConfig
from armgpi.config.section import Section
from armgpi.robot.equations import ASSUMED_GEAR_RATIO
from armgpi.robot.known_arms import known_bits
from armgpi.robot.repairs import SUPPOSE, made_in
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import joints_with_assumed_ratio, with_published
from armgpi.tuning.rule import BITS, Untuned

#: Samples by which measurements are delayed where nothing specifies it: one, as of a bus.
DELAY = 1
#: Type of the automatic controller.
AUTOMATIC = Untuned.config_name


def in_world(config: ExperimentConfig, robot: Robot) -> ExperimentConfig:
    """Return an experiment with what its world assumes of plant and controllers.

    Keys that the file has stay as they are, and what is assumed is not among the given keys. An experiment
    without the key ``ideal``, or with an uncertainty model (``reality``), stays as it is.

    Args:
        config: the experiment.
        robot: its arm, with what is known of it.
    """
    if config.ideal is not False or config.reality is not None:
        return config
    plant = config.plant
    if config.robot.drives != "none":
        robot = with_published(robot)
    # Robots that add the torque of gravity by themselves, as Franka's and UR's, add that of friction as well.
    friction = "none" if config.robot.gravity == "robot" else "urdf"
    assumed = {"encoder_bits": known_bits(robot.drives, BITS), "delay": DELAY, "friction": friction}
    if plant.viscous is not None or plant.coulomb is not None:
        del assumed["friction"]  # the file states the friction of the plant, which replaces the URDF's
    plant = _assumed(plant, {key: value for key, value in assumed.items() if key not in plant.given})
    controllers = list(config.controllers)
    # Measured with the friction of their URDFs and 16 bits, peak errors without and with feedforward:
    # z1 0.074 and 0.0039 rad, xarm7 0.090 and 0.0062 rad.
    if plant.friction == "urdf" and _has_friction(robot):
        for index, section in enumerate(controllers):
            if section.type == AUTOMATIC and "friction_feedforward" not in section.given:
                controllers[index] = section.replace(friction_feedforward=True)
    return config.replace(plant=plant, controllers=controllers)


#: Engine of a plant -> what its joints are.
_JOINTS = {"elastic": "elastic joints", "both": "stiff joints"}


def describe(config: ExperimentConfig, robot: Robot, every: bool = False) -> str:
    """Return one line on the arm and the controller that an experiment has.

    Args:
        config: the experiment, with what its world assumes.
        robot: its arm.
        every: whether all controllers are counted, as `compare` runs them; else the first is named.
    """
    return f"world: {_name(config)}: {describe_arm(config, robot, every)}"


def _name(config: ExperimentConfig) -> str:
    """Return the name of a world."""
    if config.reality is not None:
        return "an arm of the uncertainty model"
    if config.ideal is None:
        return "as the file states (it has no key `ideal`)"
    return "ideal" if config.ideal else "realistic"


def describe_arm(config: ExperimentConfig, robot: Robot, every: bool = False) -> str:
    """Return what :func:`describe` says without the name of the world."""
    sections = config.controllers if every else config.controllers[:1]
    labels = [each.label or each.type for each in sections]
    # A table of several names them.
    controllers = f"controller {labels[0]}" if len(labels) == 1 else f"{len(labels)} controllers"
    if config.reality is not None:
        return controllers
    plant = config.plant
    bits, delay = getattr(plant, "encoder_bits", None), getattr(plant, "delay", None) or 0

    def marked(key: str, text: str, source: str = "assumed") -> str:
        return f"{text} ({source})" if config.ideal is False and key not in plant.given else text

    if bits is None:
        positions = "exact positions"
    else:
        count = f"{bits:g}-bit" if isinstance(bits, int | float) else "specified"
        sources = set(robot.drives.sources("encoder_count"))
        source = sources.pop() if len(sources) == 1 else ""
        positions = marked("encoder_bits", f"{count} encoders", source or "assumed")
    parts = [
        *(["MASSES ASSUMED"] if _assumes_bodies(robot) else []),
        _JOINTS.get(plant.engine, "stiff joints"),
        _rotors(robot),
        _friction(config, robot),
        positions,
        marked("delay", f"delay {delay:g} sample{'s' * (delay != 1)}"),
    ]
    return f"{', '.join(parts)}; {controllers}"


def _assumed(section: Any, changes: dict[str, Any]) -> Any:
    """Return a section with values that its file does not have, which are not given."""
    made: Section = copy.copy(section)
    vars(made).update(changes)
    return made


def _assumes_bodies(robot: Robot) -> bool:
    """Tell whether the bodies of an arm are assumed, since its file has no masses."""
    return any(name.startswith(SUPPOSE) for name in made_in(robot.provenance))


def _has_friction(robot: Robot) -> bool:
    """Tell whether any joint of an arm has friction."""
    return bool(np.any(robot.friction.viscous) or np.any(robot.friction.coulomb))


def _rotors(robot: Robot) -> str:
    """Return what is known of the rotors of an arm."""
    if not np.any(robot.armature):
        return "no rotors"
    sources = sorted({source or "contained" for source in robot.drives.sources("rotor_inertia")})
    ratio = f", gear ratio {ASSUMED_GEAR_RATIO:g} assumed" if joints_with_assumed_ratio(robot) else ""
    return f"rotors {' and '.join(sources)}{ratio}"


def _friction(config: ExperimentConfig, robot: Robot) -> str:
    """Return what is known of the friction of an arm."""
    plant = config.plant
    if plant.viscous is not None or plant.coulomb is not None:
        return "friction specified for the plant"
    if not _has_friction(robot):
        return "friction not specified (0)"
    if plant.friction == "none" and config.robot.gravity == "robot":
        return "friction left to the robot"
    if plant.friction == "none":
        return "friction of the URDF dropped"
    viscous, coulomb = robot.friction.viscous, robot.friction.coulomb
    return f"friction of the arm (viscous up to {np.max(viscous):.3g}, Coulomb up to {np.max(coulomb):.3g})"
