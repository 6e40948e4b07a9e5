"""The controllers of an experiment, with what was left out chosen for the arm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from armgpi.base.parameter import REQUIRED, Parameter, parameters
from armgpi.config.place import Place
from armgpi.config.reading import Origin, check
from armgpi.config.schema import KINDS, Kind
from armgpi.config.section import Section
from armgpi.config.values import as_section, given_values
from armgpi.control.controller import Controller
from armgpi.control.force_limited import ForceLimited, ForceSettings
from armgpi.registry import Context
from armgpi.robot import robots, rotors
from armgpi.robot.changes import change
from armgpi.robot.repairs import made_in
from armgpi.robot.robot import Robot
from armgpi.tuning.rule import Untuned


def controller(section: Any, context: Context) -> Controller:
    """Return the controller that a section of an experiment file describes, for one rollout or a batch.

    Args:
        section: plain data, such as ``{"type": "gpi", "omega": 20.0}``.
        context: what it knows; its robots may be batches.

    Raises:
        ConfigError: when the section is wrong or does not fit; it names the key.
    """
    checked, place = _checked_controller(section, context)
    return build_controller(checked, context, place)[1]


def told_context(section: Any, context: Context) -> Context:
    """Return the context of a controller with what its section sets; arguments as :func:`controller`.

    Raises:
        ConfigError: when the section is wrong or does not fit; it names the key.
    """
    checked, place = _checked_controller(section, context)
    return _read_section(checked, context, place).context


def _checked_controller(section: Any, context: Context) -> tuple[Any, Place]:
    """Return a checked section of a controller, and where errors are."""
    origin = Origin("controller")
    wanted = {"robot": {"name": context.robot.name}, "controllers": [section]}
    (checked,) = check(wanted, origin).controllers
    return checked, Place(origin, ("controllers", 0))


class _Specified(NamedTuple):
    """What the section of a controller sets.

    Attributes:
        context: of the controller, with its nominal model and what is set.
        law: name -> value of each parameter of the controller, besides the variant's.
        keys: name -> key in a file, of the controller and its variant.
        specified: keys that are set.
    """

    context: Context
    law: dict[str, Any]
    keys: dict[str, str]
    specified: set[str]


def _read_section(section: Section, context: Context, place: Place) -> _Specified:
    """Return what the section of a controller sets.

    The nominal model is that of the key `nominal`, scaled by `inertia_scale`. Errors of the controller's
    constructor name the key of the parameter, by `context.error_context`.
    """
    if section.nominal is not None:
        nominal = _nominal(section, context.robot, place.at("nominal"))
        context = context._replace(robot=nominal, nominal=nominal)
    if section.inertia_scale != 1.0:
        context = context._replace(nominal=context.nominal.scaled_inertia(section.inertia_scale))
    kind = KINDS[section.type]
    declared = parameters(kind.law)
    context = context._replace(
        error_context=lambda name: place.at(declared[name].file_key).error_context(),
    )
    without_variant = {name: each for name, each in declared.items() if each.kind != "variant"}
    law = given_values(section, without_variant, context.robot, place)
    keys = {name: each.file_key for name, each in {**declared, **parameters(_chooser(kind))}.items()}
    specified = {key for key in section.given if getattr(section, key) is not None}
    # A default that the section does not name is no wish: the controller may choose another.
    set_here = {name: value for name, value in law.items() if keys[name] in specified}
    context = kind.law.context_for(law, context._replace(given=set_here))
    return _Specified(context, law, keys, specified)


def _chooser(kind: Kind) -> Any:
    """Return the class that chooses what a section leaves out: that of the variant if there is one."""
    return kind.law if kind.variant is None else kind.variant


def build_controller(section: Section, context: Context, place: Place) -> tuple[Any, Controller]:
    """Return one controller, and its section with the defaults filled in.

    Args:
        section: of the controller, checked.
        context: what it knows of arm, sensors and loop.
        place: of the section.

    Raises:
        ConfigError: when a value does not fit the arm; it names the key.
    """
    read = _read_section(section, context, place)
    kind = KINDS[section.type]
    chosen = _choose(section, read)
    if read.context.robot.batch is None:  # what differs by rollout has no form in a file
        missing = {}
        for name, value in chosen.items():
            if read.keys[name] not in read.specified:
                missing[read.keys[name]] = as_section(value)
        section = type(section).read({**section.plain(), **missing})
    values = _constructor_values(section, read, chosen, place)
    law = kind.law.configured(values, read.context)
    return section, _force_limited(law, section, read.context, place)


def _choose(section: Section, read: _Specified) -> dict[str, Any]:
    """Return the parameters that are chosen for the arm, where the section does not set them.

    A section that sets everything chooses nothing: automatic tuning takes half a second, and its result
    would be dropped.
    """
    source = _chooser(KINDS[section.type])
    if _says_all(section, parameters(source), read.keys, read.specified, read.context.robot):
        return {}
    chosen = source.chosen(read.context)
    return {name: value for name, value in chosen.items() if name not in read.context.given}


def _constructor_values(
    section: Section, read: _Specified, chosen: Mapping[str, Any], place: Place
) -> dict[str, Any]:
    """Return the arguments of a controller by name, its variant among them: of the section, else chosen."""
    kind, robot = KINDS[section.type], read.context.robot
    declared = parameters(kind.law)
    if kind.variant is None:
        return {**chosen, **given_values(section, declared, robot, place, chosen)}
    law, of_variant = dict(read.law), {}
    for name, value in chosen.items():
        if name in declared:
            law[name] = value
        else:
            of_variant[name] = value
    of_variant |= given_values(section, parameters(kind.variant), robot, place, chosen)
    law[kind.part] = kind.variant(**of_variant)
    return law


def _says_all(
    section: Section,
    declared: Mapping[str, Parameter],
    keys: Mapping[str, str],
    specified: set[str],
    robot: Robot,
) -> bool:
    """Tell whether a controller's section leaves nothing to choose for the arm.

    Args:
        section: of the controller.
        declared: parameters of what chooses.
        keys: name of a parameter -> its key in the section.
        specified: keys that have a value.
        robot: of which every joint needs one.
    """
    if not section.given >= {*section.keys} - section.quiet:
        return False
    for name, each in declared.items():
        if each.default is REQUIRED and keys[name] not in specified:
            return False
    for key in specified:
        value = getattr(section, key)
        if isinstance(value, dict) and {*robot.joint_names} - {*value}:
            return False  # a mapping of some joints leaves the others to the choice
    return True


def _force_limited(law: Controller, section: Section, context: Context, place: Place) -> Controller:
    """Return a controller under the force limit of its section, where it has none of its own."""
    if KINDS[section.type].limits_force:
        return law
    settings = given_values(section, parameters(ForceSettings), context.robot, place)
    if not settings:
        return law
    if "force_limit" not in settings:
        raise place.at(next(iter(settings))).error("left out where there is no force_limit")
    return ForceLimited(law, **settings, delay=context.delay)


def _nominal(section: Section, robot: Robot, place: Place) -> Robot:
    """Return the arm that a controller takes for the one there is: loaded and held by the same motors."""
    if not isinstance(robot, Robot):
        raise place.error(
            "an uncertainty model (reality) determines the nominal model itself: leave this key out"
        )
    if robots.find_identified(section.nominal) is not None:
        raise place.error("expected a URDF, got the folder of an identified arm; name the URDF in it")
    loaded = robot.provenance
    mimic = loaded.get("mimic", "lock")
    with place.error_context():
        nominal = Robot.load(section.nominal, loaded["locked"], None, mimic, made_in(loaded))
        if nominal.joint_names != robot.joint_names:
            expected, got = ", ".join(robot.joint_names), ", ".join(nominal.joint_names)
            raise place.error(f"expected joints {expected}; got {got}")
        gravity = robot.pinocchio_model().gravity.linear
        nominal = change(nominal, {"effort": robot.limits.effort, "gravity": gravity})
    if section.type == Untuned.config_name:
        return rotors.assume_drives(nominal)
    return nominal
