"""What an experiment file may contain: its sections and keys, from what classes declare.

Sections of controllers, loads, sensors, actuators and paths are made from the parameters that their classes
declare (:mod:`armgpi.base.parameter`); the others are below.

Every quantity is in SI units. A per-joint quantity is a number for all joints, a list, or a mapping from
joint names.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

from armgpi.base import renamed
from armgpi.base.parameter import REQUIRED, Parameter, parameters
from armgpi.base.version import other_format
from armgpi.config.section import (
    Key,
    Path_,
    Section,
    Wrong,
    anything,
    by_shape,
    flag,
    key_of,
    keys_of,
    listing,
    mapping,
    names,
    one_of,
    per_joint,
    plain_number,
    section,
    text,
    union,
    vector,
    word,
)
from armgpi.control.controller import Controller
from armgpi.control.force_limited import ForceSettings
from armgpi.plants.arm import Arm
from armgpi.plants.environment import Contact
from armgpi.plants.loads import Load
from armgpi.plants.plant import Wrapper
from armgpi.plants.reality import Reality
from armgpi.references.paths import Path
from armgpi.registry import classes_of, subclasses
from armgpi.robot.changes import CHANGES
from armgpi.supervisor import Supervisor

#: The format of experiment files.
FORMAT = 1


def _declare(said: str, unit: str = "", default: Any = REQUIRED, **facts: Any) -> Key:
    """Return the key of a number that no class declares."""
    return key_of(Parameter(said, unit, default=default, **facts))


def _choice(default: str, *choices: str) -> Key:
    """Return the key of one of some words."""
    return Key(word(*choices), default)


def _change(name: str) -> Key:
    """Return the key of something that an arm may have otherwise than its file says."""
    return key_of(CHANGES[name], None, optional=True)


def _text() -> Key:
    """Return the key of text that may be left out."""
    return Key(text, None, optional=True)


class FrictionSection(Section):
    """Joint friction in place of the URDF's: viscous [N m s/rad or N s/m] and coulomb [N m or N]."""

    keys: ClassVar[Mapping[str, Key]] = {name: _change(name) for name in ("viscous", "coulomb")}


class RobotSection(Section):
    """Which arm.

    Attributes:
        name: name of a robot (``armgpi.robots.names()``), or path of its URDF, relative to this file.
        lock: joints to hold fixed: names, or name -> value [rad or m].
        keep: joints that move; all others are locked.
        mimic: whether joints that mimic another one are locked, or follow it.
        repair: names of repairs that may be made in the URDF, or "all"; see :mod:`armgpi.robot.repairs`.
        effort: effort limits that replace the URDF's [N m or N].
        rotor_inertia: reflected rotor inertia (armature) of plant and nominal models [kg m^2 or kg].
        friction: joint friction that replaces the URDF's.
        drives: joint -> what is known of its drive (:mod:`armgpi.robot.drives`); the keys above come on top.
            Or what is assumed of drives of which the file contains nothing (:func:`armgpi.assume_drives`):
            "elastic", rotors and elastic joints, the default where a controller is tuned automatically; the
            plant is then elastic unless specified otherwise; "stiff", rotors and stiff joints; "none",
            no rotors.
        gravity: who compensates gravity: the controller ("arm"), or the robot by itself ("robot"); plant and
            nominal models then have no gravity.
        posterior: the ``identification.json`` from which a sweep takes randomised arms; by default that in
            the folder of an identified arm.
    """

    keys: ClassVar[Mapping[str, Key]] = {
        "name": Key(text),
        # A name without a value is locked where ``Robot.load`` chooses.
        "lock": Key(by_shape(names, names, mapping(plain_number, optional=True)), []),
        "keep": Key(names, None, optional=True),
        "mimic": _choice("lock", "lock", "follow"),
        "repair": Key(names, []),
        "effort": _change("effort"),
        "rotor_inertia": _change("rotor_inertia"),
        "friction": Key(FrictionSection.read, None, optional=True),
        "drives": Key(
            by_shape(word("elastic", "stiff", "none", old=renamed.DRIVES), None, mapping(anything)),
            None,
            optional=True,
        ),
        "gravity": _choice("arm", "arm", "robot"),
        "posterior": _text(),
    }


class PayloadSection(Section):
    """A load that the controller does not know: mass [kg] at com [m] in a frame (the tip when not given)."""

    keys: ClassVar[Mapping[str, Key]] = {
        "mass": key_of(CHANGES["payload"])._replace(default=REQUIRED),
        "frame": key_of(CHANGES["frame"]),
        "com": key_of(CHANGES["com"]),
    }


def _by_name(base: type, more: Any = lambda cls: {}) -> dict[str, type[Section]]:
    """Return the sections of the classes that come from a base, by what their `type` says."""
    return {
        name: section(cls, more={"type": Key(word(name)), **more(cls)})
        for name, cls in classes_of(base).items()
    }


LOADS = _by_name(Load)
CONTACTS = _by_name(Contact)


#: Sensors and actuators, of which one with a single parameter has a bare value, not a section.
SENSORS = {name: section(cls) for name, cls in classes_of(Wrapper).items()}


def _wrapper(name: str, cls: type[Wrapper]) -> Key:
    """Return a wrapper's key: a bare value where it has one parameter, else a mapping."""
    (first, *more) = SENSORS[name].keys.values()
    return first._replace(form=SENSORS[name].read if more else first.form, default=cls.off, optional=True)


class ArmKey(NamedTuple):
    """A key of ``plant:`` that some engines declare.

    Attributes:
        engines: which.
        key: what may stand there.
    """

    engines: tuple[str, ...]
    key: Key


def _arm_keys() -> dict[str, ArmKey]:
    """Return the keys that engines declare; one whose defaults differ is null where nothing is said."""
    found: dict[str, ArmKey] = {}
    for engine, cls in classes_of(Arm).items():
        for name, key in keys_of(parameters(cls)).items():
            engines, known = found.get(name, ((), key))
            if REQUIRED in (known.default, key.default) or known.default != key.default:
                key = key._replace(default=None, optional=True)
            found[name] = ArmKey((*engines, engine), key)
    return found


ARM_KEYS = _arm_keys()


#: What a plant may have otherwise than the arm of the file, besides a load.
PLANT_CHANGES = ("inertia_scale", "rotor_inertia", "viscous", "coulomb", "gravity")


class PlantSection(Section):
    """What differs from the nominal model; sensors and actuators come to it from their declarations.

    Attributes:
        payload: a payload that is unknown to the controllers.
        inertia_scale: factor on the true masses and inertias.
        rotor_inertia: true reflected rotor inertia, unknown to the controllers [kg m^2 or kg].
        viscous: true viscous friction, unknown to the controllers [N m s/rad or N s/m].
        coulomb: true Coulomb friction, unknown to the controllers [N m or N].
        gravity: true acceleration of gravity, unknown to the controllers [m/s^2].
        drives: true drives, where the controllers assume others.
        bodies: joint -> true inertial parameters of the links up to the next joint: mass, first moments, and
            second moments about the joint's frame (xx, xy, yy, xz, yz, zz).
        friction: "urdf" for the friction of the robot, or "none".
        loads: disturbance torques.
        environment: what the tool touches: forces, walls and springs.
        substeps: integration steps per sample.
        engine: which simulator: "armgpi" (by Pinocchio), "mujoco", or "both", one after the other; or another
            that is declared. Its parameters are keys as well.
    """

    keys: ClassVar[Mapping[str, Key]] = union(
        "plant",
        {
            "payload": Key(PayloadSection.read, None, optional=True),
            **{name: _change(name) for name in PLANT_CHANGES},
            "drives": Key(mapping(anything), None, optional=True),
            "bodies": Key(mapping(listing(plain_number, 10, 10)), None, optional=True),
            "friction": _choice("none", "urdf", "none"),
            "loads": Key(listing(one_of(LOADS)), []),
            "environment": Key(listing(one_of(CONTACTS)), []),
            "engine": _choice("armgpi", *classes_of(Arm), "both"),
        },
        {name: each.key for name, each in ARM_KEYS.items()},
        {name: _wrapper(name, cls) for name, cls in classes_of(Wrapper).items()},
    )


class Kind(NamedTuple):
    """What `type` of a controller's section may name.

    Attributes:
        law: the controller.
        variant: the class of its part that may be one of several, if it has one; see `GPI.gains`.
        part: name of that part.
    """

    law: type[Controller]
    variant: type | None = None
    part: str = ""

    @property
    def limits_force(self) -> bool:
        """Whether the controller has a force limit of its own; the others get one around them."""
        return "force_limit" in parameters(self.law)

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Declared parameters that are keys of the section."""
        limits = {} if self.limits_force else parameters(ForceSettings)
        both = {**(parameters(self.variant) if self.variant else {}), **parameters(self.law), **limits}
        return {name: each for name, each in both.items() if each.in_file and each.kind != "variant"}

    def section(self, name: str) -> type[Section]:
        """Return the section of what is called so."""
        more = {"type": Key(word(name)), "label": _text(), "inertia_scale": _SCALE, "nominal": _text()}
        return section(self.variant or self.law, self.parameters, more)


def _kinds() -> dict[str, Kind]:
    """Return what controllers may be, by their names."""
    found = [{name: Kind(cls) for name, cls in classes_of(Controller).items()}]
    for law in subclasses(Controller):
        own = inspect.get_annotations(law)  # a class that comes from it does not take over its names
        for part in parameters(law).values():
            if part.name in own and part.kind == "variant" and part.group is not None:
                variants = classes_of(part.group).items()
                found.append({name: Kind(law, variant, part.name) for name, variant in variants})
    return dict(sorted(union("controllers", *found).items()))


_SCALE = key_of(CHANGES["inertia_scale"], 1.0)
#: Controllers by the names that a file may call them, and their sections.
KINDS = _kinds()
CONTROLLERS = {name: kind.section(name) for name, kind in KINDS.items()}
_EASE = _declare("time in which a path begins", "s", 1.0, least=0.0)
PATHS = _by_name(Path, lambda cls: {"ease": _EASE} if cls.starts_moving else {})
_INDEX = _declare("number of the scenario of the uncertainty model (reality)", "", 0, kind="integer", least=0)


RealitySection = section(Reality, more={"index": _INDEX})
SupervisorSection = section(Supervisor)


#: Keys of a reference that name a file, which is found beside the experiment's and copied with it.
REFERENCE_FILES = ("file", "poses", "stream")


class ReferenceSection(Section):
    """Smooth moves from configuration to configuration with holds, or a path of the tool in space.

    Attributes:
        points: configurations [rad or m]; a mapping keeps the joints that it does not name where they were,
            and begins where the default move does. When not given, that is the default move
            (:func:`armgpi.default_move`): every joint moves by up to 0.5 and back, away from singular
            configurations. In a file without the key ``ideal`` it starts in the middle of the joint ranges.
        durations: durations of the moves [s]; by default long enough for the motors.
        holds: time at rest at each configuration [s]; 0 by default, 1 when there are no points either.
        file: instead of all these, a recorded trajectory: CSV (time and joints by name) or NetCDF.
        path: instead of all these, a path of a frame in space.
        poses: instead of all these, a file of poses that a frame goes through smoothly: CSV, NetCDF or MCAP.
        stream: instead of all these, a file of poses that arrive at their times, followed within limits.
        frame: frame that follows the path or the poses; by default the tip.
        feedforward: whether a stream's own speed is anticipated: less lag, more noise.
        torque_rate: largest rate of change of the motors' torques [N m/s or N/s], from which a stream's jerk
            limits follow; by default the effort in 87 ms.
        start: configuration in which a stream begins [rad or m]; by default that of its first pose.
        direction: direction in which the frame's `tool_axis` points along the whole path; free by default.
        tool_axis: an axis of the frame, in its own coordinates.
    """

    keys: ClassVar[Mapping[str, Key]] = {
        "points": Key(listing(per_joint(plain_number), 1), None, optional=True),
        "durations": _declare(
            "durations of the moves", "s", None, kind="times", least=0.0, above=True, none="gentle"
        ),
        "holds": _declare("holds at the configurations", "s", None, kind="times", least=0.0, none="0"),
        "file": _text(),
        "path": Key(one_of(PATHS), None, optional=True),
        "poses": _text(),
        "stream": _text(),
        "frame": _text(),
        "feedforward": Key(flag, None, optional=True),
        "torque_rate": _declare(
            "rate of the motors' torques", "N m/s", None, least=0.0, above=True, none="the effort in 87 ms"
        ),
        "start": Key(per_joint(plain_number), None, optional=True),
        "direction": Key(vector, None, optional=True),
        "tool_axis": Key(vector, None, optional=True),
    }


class VarySection(Section):
    """What a parameter of a sweep is drawn from: one of five distributions.

    Attributes:
        uniform: lowest and highest value.
        log_uniform: lowest and highest value; the logarithm is distributed evenly.
        normal: mean and standard deviation, cut at 4 standard deviations.
        choices: values that are all equally likely.
        factor: the parameter's value is divided and multiplied by up to this, with an even logarithm.
        each: whether a per-joint parameter has one random value for each rollout, or one for each joint.
    """

    keys: ClassVar[Mapping[str, Key]] = {
        **{
            name: Key(listing(plain_number), None, optional=True)
            for name in ("uniform", "log_uniform", "normal")
        },
        "choices": Key(listing(plain_number, 1), None, optional=True),
        "factor": Key(plain_number, None, optional=True),
        "each": _choice("rollout", "rollout", "joint"),
    }


def _format(value: Any, path: Path_) -> int:
    """Read the format of a file; of another one nothing else is said."""
    if value != FORMAT or isinstance(value, bool):
        raise Wrong(path, other_format(value, FORMAT), misspelt=True)
    return FORMAT


class ExperimentConfig(Section):
    """A whole experiment file.

    Attributes:
        format: version of the file's format, 1; armgpi writes it.
        robot: the arm: a name, or a mapping with `name` and what is specified of it.
        ideal: which assumptions replace what the file does not state (``armgpi.config.world``): false for
            assumed drives, friction that the URDF contains, encoders and delay, and the automatic controller;
            true for an arm without all these. A file without the key has what it states alone.
        plant: the simulated arm: its payload, disturbances, sensors and actuators.
        reality: instead of `plant`, scenario `index` of an uncertainty model with a name and a seed. It also
            determines sample time, reference and length of the run, where the file does not.
        controllers: list of controllers; `armgpi run` takes the first one, `armgpi compare` all.
        reference: the desired motion.
        supervisor: supervisor of all controllers, which stops the arm after a fault; none by default, and
            `{}` has every default.
        sample_time: sample time of the controllers [s].
        t_final: length of the run [s]; by default the reference and 2 s more.
        record_every: record only every so many samples.
        seed: seed of all random numbers.
        vary: what `armgpi sweep` varies: name of a parameter -> distribution. Other commands ignore it.
        failure: bounds beyond which a rollout of a sweep has failed: metric -> largest value of any joint.
            One that diverges has failed in any case.
    """

    keys: ClassVar[Mapping[str, Key]] = {
        "format": Key(_format, FORMAT),
        "robot": Key(RobotSection.read),
        "ideal": Key(flag, None, optional=True),
        "plant": Key(PlantSection.read, PlantSection()),
        "reality": Key(RealitySection.read, None, optional=True),
        "controllers": Key(
            listing(one_of(CONTROLLERS, renamed.CONTROLLERS), 1), [CONTROLLERS["gpi"](type="gpi")]
        ),
        "reference": Key(ReferenceSection.read, ReferenceSection()),
        "supervisor": Key(SupervisorSection.read, None, optional=True),
        "sample_time": _declare("sample time", "s", 1e-3, least=1e-9),
        "t_final": _declare("length of the run", "s", None, least=0.0, above=True, none="the reference's"),
        "record_every": _declare("store one sample of so many", "", 1, kind="integer", least=1),
        "seed": _declare("seed", "", 0, kind="integer", least=0, most=2**63 - 1),
        "vary": Key(mapping(VarySection.read), {}),
        "failure": Key(mapping(_declare("bound of a metric", least=0.0).form), {}),
    }


#: All sections by what they are called, or what their `type` says.
SECTIONS: dict[str, type[Section]] = {
    "robot": RobotSection,
    "friction": FrictionSection,
    "plant": PlantSection,
    "payload": PayloadSection,
    "reference": ReferenceSection,
    "reality": RealitySection,
    "supervisor": SupervisorSection,
    "vary": VarySection,
    **{name: each for name, each in SENSORS.items() if len(each.keys) > 1},
    **LOADS,
    **PATHS,
    **CONTROLLERS,
}
