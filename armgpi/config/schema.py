"""What an experiment file may contain: its sections and keys, as pydantic models.

Sections of controllers, loads, sensors, actuators and paths are made from the parameters that their classes
declare (:mod:`armgpi.parameter`); the others are below.

Every quantity is in SI units. A per-joint quantity is a number for all joints, a list, or a mapping from
joint names.
"""

from __future__ import annotations

import inspect
import math
import signal
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple, TypeAlias

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    PlainValidator,
    StrictBool,
    Tag,
    create_model,
    model_serializer,
)
from pydantic_core import PydanticKnownError, PydanticSerializationError

from armgpi.control.controller import Controller
from armgpi.parameter import REQUIRED, Parameter, parameters
from armgpi.plants.arm import Arm
from armgpi.plants.loads import Load
from armgpi.plants.plant import Wrapper
from armgpi.plants.reality import Reality
from armgpi.references.paths import Path
from armgpi.registry import classes_of, subclasses
from armgpi.supervisor import Supervisor


def _number(value: Any) -> Any:
    """Accept numbers, and the forms of them that YAML 1.1 reads as text (1e-3); no bools."""
    if isinstance(value, bool | bytes):
        raise ValueError("expected a number")
    if isinstance(value, str | int):
        try:
            value = float(value)
        except (ValueError, OverflowError):
            raise ValueError("expected a number") from None
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("expected a finite number")
    return value


def _whole(value: Any) -> Any:
    """Accept whole numbers; no bools, no text."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError("expected a whole number")
    return value


def _names(value: Any) -> Any:
    """Accept one name in place of a list."""
    return [value] if isinstance(value, str) else value


def _shape(value: Any) -> str:
    """Tell how a quantity is given, so that an error speaks of that form alone."""
    if isinstance(value, list | tuple):
        return "list"
    return "mapping" if isinstance(value, dict) else "number"


Number = Annotated[float, BeforeValidator(_number)]
Positive = Annotated[Number, Field(gt=0.0)]
NotNegative = Annotated[Number, Field(ge=0.0)]
Whole = Annotated[int, BeforeValidator(_whole)]


def per_joint(element: Any) -> Any:
    """Return the type of a per-joint quantity of such elements."""
    return Annotated[
        Annotated[element, Tag("number")]
        | Annotated[list[element], Tag("list")]
        | Annotated[dict[str, element], Tag("mapping")],
        Discriminator(_shape),
    ]


def one_or_several(element: Any) -> Any:
    """Return the type of a number or a list of them."""
    return Annotated[
        Annotated[element, Tag("number")] | Annotated[list[element], Tag("list")],
        Discriminator(lambda value: "list" if isinstance(value, list) else "number"),
    ]


if TYPE_CHECKING:  # what type checkers take these types for
    PerJoint: TypeAlias = float | list[float] | dict[str, float]
    PerJointNotNegative: TypeAlias = PerJoint
    Times: TypeAlias = float | list[float]
    Stands: TypeAlias = Times
else:
    PerJoint = per_joint(Number)
    PerJointNotNegative = per_joint(NotNegative)
    Times, Stands = one_or_several(Positive), one_or_several(NotNegative)
Names = Annotated[list[str], BeforeValidator(_names)]
#: Names, or name -> value; a name without a value is locked where ``Robot.load`` chooses.
Locks = Annotated[
    Annotated[Names, Tag("list")] | Annotated[dict[str, Number | None], Tag("mapping")],
    Discriminator(lambda value: "mapping" if isinstance(value, dict) else "list"),
]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Body = Annotated[list[Number], Field(min_length=10, max_length=10)]


class _Sections(MutableMapping[str, Any]):
    """Models of sections by their names; what is put in as a function is called when a file has the section.

    Most files have few of them, and making one takes longer than reading it.
    """

    def __init__(self) -> None:
        self._made: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if not isinstance(made := self._made[name], type):
            made = self._made[name] = made()
        return made

    def __setitem__(self, name: str, model: Any) -> None:
        self._made[name] = model

    def __delitem__(self, name: str) -> None:
        del self._made[name]

    def __iter__(self) -> Iterator[str]:
        for name in list(self._made):  # one may have others in it
            self[name]
        return iter(list(self._made))

    def __len__(self) -> int:
        return len(list(iter(self)))


#: Sections by the steps of pydantic's locations: keys, and what `type` says.
SECTIONS = _Sections()


#: Timers, whose handlers may raise as well.
_ALARM = {signal.SIGALRM} if hasattr(signal, "SIGALRM") else set()


class Section(BaseModel):
    """A part of the file; unknown keys are errors."""

    # Built when the first file is read: sections within others would be built again with each of those.
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)
    #: Keys that are not written where they are null.
    quiet: ClassVar[frozenset[str]] = frozenset({"drives", "nominal", "bodies", "posterior"})

    def model_dump(self, **options: Any) -> dict[str, Any]:
        """Return it as plain data; Ctrl-C waits meanwhile, as pydantic makes an error or a warning of it."""
        # Windows has no masks.
        mask = getattr(signal, "pthread_sigmask", lambda *_: ())
        before = mask(getattr(signal, "SIG_BLOCK", 0), {signal.SIGINT, signal.SIGTERM, *_ALARM})
        try:
            return super().model_dump(**options)
        except PydanticSerializationError as error:  # another thread took the signal
            if isinstance(error.__cause__, KeyboardInterrupt):
                raise error.__cause__ from None
            raise
        finally:
            mask(getattr(signal, "SIG_SETMASK", 0), before)

    @model_serializer(mode="wrap")
    def _to_plain(self, handler: Any) -> dict[str, Any]:
        """Return it as plain data."""
        return {key: x for key, x in handler(self).items() if x is not None or key not in self.quiet}


def table(element: Any) -> Any:
    """Return the type of a list of such elements for all joints, or one per joint."""
    return Annotated[
        Annotated[list[element], Tag("list")]
        | Annotated[list[list[element]], Tag("table")]
        | Annotated[dict[str, list[element]], Tag("mapping")],
        Discriminator(_table_shape),
    ]


def _table_shape(value: Any) -> str:
    """Tell how a table is given: one list, one per joint, or by the joints' names."""
    nested = isinstance(value, list | tuple) and bool(value) and isinstance(value[0], list | tuple)
    return "mapping" if isinstance(value, dict) else "table" if nested else "list"


def _box_shape(value: Any) -> str:
    """Tell how a box is given: by its two ends, or as one value that does not adapt."""
    ends = isinstance(value, dict) and {"lower", "upper"} & set(value)
    return "box" if ends or isinstance(value, BaseModel) else _shape(value)


def box(element: Any) -> Any:
    """Return the type of a box of such elements."""
    ends: dict[str, Any] = dict.fromkeys(("lower", "upper"), (per_joint(element), ...))
    model = create_model("BoxSection", __base__=Section, **ends)
    SECTIONS["box"] = model
    return Annotated[
        Annotated[model, Tag("box")]
        | Annotated[element, Tag("number")]
        | Annotated[list[element], Tag("list")]
        | Annotated[dict[str, element], Tag("mapping")],
        Discriminator(_box_shape),
    ]


def annotation(declared: Parameter) -> Any:
    """Return the type that a declared parameter has in an experiment file."""
    kind: Any = declared.kind
    if kind == "choice":
        return Literal[declared.choices]
    if kind == "flag":
        return StrictBool
    if kind == "text":
        return str
    if kind == "group":
        assert declared.group is not None
        return section(declared.key or declared.name, declared.group)
    limits = {
        ("gt" if declared.above else "ge"): declared.least,
        ("lt" if declared.below else "le"): declared.most,
    }
    finite: dict[str, Any] = {key: limit for key, limit in limits.items() if math.isfinite(limit)}
    number: Any = Whole if kind == "integer" else Number
    element: Any = Annotated[number, Field(**finite)]
    kinds: dict[str, Callable[[Any], Any]] = {
        "box": box,
        "table": table,
        "range": lambda item: Annotated[list[item], Field(min_length=2, max_length=2)],  # type: ignore[valid-type]
        "vector": lambda _: Vector,
        "numbers": lambda _: list[Number],
        "times": one_or_several,
        "points": lambda _: Annotated[list[Vector], Field(min_length=2)],
    }
    form = kinds.get(kind, per_joint if declared.per_joint else lambda item: item)
    return form(element)


def field_of(declared: Parameter) -> tuple[Any, Any]:
    """Return type and default of the key of a declared parameter."""
    kind, default = annotation(declared), declared.file_default
    if default is REQUIRED:
        return kind, ...
    return (kind | None if declared.optional else kind), default


def keys_of(declared: Mapping[str, Parameter]) -> dict[str, Any]:
    """Return the keys of declared parameters with their types and defaults."""
    return {each.key or name: field_of(each) for name, each in declared.items() if each.in_file}


def section(name: str, cls: type, declared: Mapping[str, Parameter] | None = None, **keys: Any) -> Any:
    """Return the section of the experiment file for a class, from its declarations.

    Args:
        name: how the section is called.
        cls: the class.
        declared: its parameters, when they are not all.
        **keys: further keys, name -> (type, default).
    """
    own = keys_of(parameters(cls) if declared is None else declared)
    made = create_model(f"{cls.__name__}Section", __base__=Section, **{**keys, **own})
    made.__doc__ = cls.__doc__
    SECTIONS[name] = made
    return made


def later(name: str, make: Callable[[], Any]) -> Any:
    """Return the type of a section that is made when a file has it."""
    SECTIONS[name] = make
    return Annotated[Any, PlainValidator(lambda value: SECTIONS[name].model_validate(value))]


def one_of(makers: Mapping[str, Callable[[], Any]]) -> Any:
    """Return the type of a section that is one of several, by its `type`; each is made when a file has it."""
    SECTIONS.update(makers)

    def check(value: Any) -> Any:
        if isinstance(value, Section):
            return value
        if isinstance(value, str) and value in makers:
            raise ValueError(f"expected a mapping, as in 'type: {value}'")
        if not isinstance(value, dict):
            raise PydanticKnownError("model_type", {"class_name": "Section"})
        if "type" not in value:
            raise PydanticKnownError("union_tag_not_found", {"discriminator": "'type'"})
        if (tag := value["type"]) not in tuple(makers):
            known = ", ".join(map(repr, makers))
            context = {"discriminator": "'type'", "tag": str(tag), "expected_tags": known}
            raise PydanticKnownError("union_tag_invalid", context)
        return SECTIONS[tag].model_validate(value)

    return Annotated[Any, PlainValidator(check)]


class FrictionSection(Section):
    """Joint friction in place of the URDF's: viscous [N m s/rad or N s/m] and coulomb [N m or N]."""

    viscous: PerJointNotNegative | None = None
    coulomb: PerJointNotNegative | None = None


class RobotSection(Section):
    """Which arm.

    Attributes:
        name: a name from ``armgpi.robots.names()`` or the path of a URDF, relative to the file.
        lock: joints to hold fixed: names, or name -> value [rad or m].
        keep: when given, every other joint is locked.
        mimic: whether joints that mimic another are locked or follow it.
        repair: names of repairs that may be made in the URDF, or "all"; see :mod:`armgpi.robot.repairs`.
        effort: effort limits that replace the URDF's [N m or N].
        rotor_inertia: seen at the joints, of the plant and of the nominal models [kg m^2 or kg].
        friction: joint friction that replaces the URDF's.
        drives: joint -> what is known of its drive (:mod:`armgpi.robot.drives`); the keys above come on top.
            Or what is believed of drives of which the file says nothing (:func:`armgpi.believe_drives`):
            "soft", rotors and gears that twist, as where a controller has the rule for untuned arms, and the
            plant is elastic where nothing says otherwise; "believed", rotors of stiff gears; "rigid", none.
        gravity: who carries the arm's weight: the controller ("arm"), or a robot that compensates it by
            itself; then plant and nominal models have no gravity.
        posterior: a copy of the ``identification.json`` from which a sweep draws arms; that of the folder of
            an identified arm when not given.
    """

    name: str
    lock: Locks = []
    keep: Names | None = None
    mimic: Literal["lock", "follow"] = "lock"
    repair: Names = []
    effort: PerJointNotNegative | None = None
    rotor_inertia: PerJointNotNegative | None = None
    friction: FrictionSection | None = None
    drives: dict[str, Any] | Literal["believed", "soft", "rigid"] | None = None
    gravity: Literal["arm", "robot"] = "arm"
    posterior: str | None = None


class PayloadSection(Section):
    """A load that the controller does not know: mass [kg] at com [m] in a frame (the tip when not given)."""

    mass: NotNegative
    frame: str | None = None
    com: list[Number] = Field(default=[0.0, 0.0, 0.0], min_length=3, max_length=3)


def _load(name: str, cls: type) -> Any:
    return section(name, cls, type=(Literal[name], ...))


LoadSection: Any = one_of({name: partial(_load, name, cls) for name, cls in classes_of(Load).items()})


class PlantSection(Section):
    """What differs from the nominal model; sensors and actuators come to it from their declarations.

    Attributes:
        payload: a load that the controller does not know.
        rotor_inertia: the one that it really has, which the controller does not know [kg m^2 or kg].
        drives: what its drives really are, where the controller believes others.
        bodies: joint -> what it really moves, up to the next joint: mass, first moments, and second moments
            about the joint's frame (xx, xy, yy, xz, yz, zz).
        friction: "urdf" for the robot's friction coefficients, "none".
        loads: disturbance torques.
        substeps: integration steps per sample.
        engine: which simulator: "armgpi" (by Pinocchio), "mujoco", or "both", one after the other; or another
            that is declared. Its parameters are keys as well.
    """

    payload: PayloadSection | None = None
    rotor_inertia: PerJointNotNegative | None = None
    drives: dict[str, Any] | None = None
    bodies: dict[str, Body] | None = None
    friction: Literal["urdf", "none"] = "none"
    loads: list[LoadSection] = []
    substeps: int = 1
    engine: str = "armgpi"


def _wrapper(name: str, cls: type[Wrapper]) -> tuple[Any, Any]:
    """Return type and default of a wrapper's key: a bare value where it has one parameter, else a mapping."""
    own = [each for each in parameters(cls).values() if each.in_file]
    kind = annotation(own[0]) if len(own) == 1 else later(name, partial(section, name, cls))
    return kind | None, cls.off


class ArmKey(NamedTuple):
    """A key of ``plant:`` that some engines declare.

    Attributes:
        engines: which.
        kind: its type in a file.
        default: its value where a file says nothing.
    """

    engines: tuple[str, ...]
    kind: Any
    default: Any


def _arm_keys() -> dict[str, ArmKey]:
    """Return the keys that engines declare."""
    found: dict[str, ArmKey] = {}
    for engine, cls in classes_of(Arm).items():
        for name, each in parameters(cls).items():
            if each.in_file:
                key = each.key or name
                kind, default = field_of(each)
                engines = (*(found[key].engines if key in found else ()), engine)
                missing = default is ...
                found[key] = ArmKey(engines, kind | None if missing else kind, None if missing else default)
    return found


ARM_KEYS = _arm_keys()
_WRAPPERS: dict[str, Any] = {name: _wrapper(name, cls) for name, cls in classes_of(Wrapper).items()}
if not TYPE_CHECKING:
    _ENGINES = (Literal[(*classes_of(Arm), "both")], "armgpi")
    _KEYS = {key: (each.kind, each.default) for key, each in ARM_KEYS.items()}
    PlantSection = create_model(
        "PlantSection", __base__=PlantSection, **{**_KEYS, "engine": _ENGINES, **_WRAPPERS}
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
    def parameters(self) -> dict[str, Parameter]:
        """Declared parameters that are keys of the section."""
        both = {**(parameters(self.variant) if self.variant else {}), **parameters(self.law)}
        return {name: each for name, each in both.items() if each.in_file and each.kind != "variant"}


def _kinds() -> dict[str, Kind]:
    """Return what controllers may be, by their names."""
    found = {name: Kind(cls) for name, cls in classes_of(Controller).items()}
    for law in subclasses(Controller):
        own = inspect.get_annotations(law)  # a class that comes from it does not take over its names
        for part in parameters(law).values():
            if part.name in own and part.kind == "variant" and part.group is not None:
                variants = classes_of(part.group).items()
                found |= {name: Kind(law, variant, part.name) for name, variant in variants}
    return dict(sorted(found.items()))


def _controller(name: str, kind: Kind) -> Any:
    more: dict[str, Any] = {
        "type": (Literal[name], ...),
        "label": (str | None, None),
        "inertia_scale": (Positive, 1.0),
        "nominal": (str | None, None),
    }
    return section(name, kind.variant or kind.law, kind.parameters, **more)


#: Controllers by the names that a file may call them.
KINDS = _kinds()
ControllerSection: Any = one_of({name: partial(_controller, name, kind) for name, kind in KINDS.items()})


def _path(name: str, cls: type[Path]) -> Any:
    eased: dict[str, Any] = {"ease": (NotNegative, 1.0)} if cls.starts_moving else {}
    return section(name, cls, type=(Literal[name], ...), **eased)


PathSection: Any = one_of({name: partial(_path, name, cls) for name, cls in classes_of(Path).items()})


def _reality() -> Any:
    return section("reality", Reality, index=(Annotated[Whole, Field(ge=0)], 0))


RealitySection: Any = later("reality", _reality)


class ReferenceSection(Section):
    """Smooth moves from configuration to configuration with holds, or a path of the tool in space.

    Attributes:
        points: configurations [rad or m]; a mapping keeps the joints that it does not name where they were,
            and starts from the middle of the joint ranges. When not given, every joint moves by up to 0.5
            from there and back, and less where the motors would not hold the arm.
        durations: of the moves [s]; gentle ones when not given, which the motors can.
        holds: at each configuration [s]; 0 when not given, 1 when there are no points either.
        file: instead of all these, a recorded trajectory: CSV (time and joints by name) or NetCDF.
        path: instead of all these, where a frame shall go in space.
        frame: which frame follows the path; the tip when not given.
        direction: where the frame's `tool_axis` points to all along; anywhere when not given.
        tool_axis: an axis in the frame.
    """

    points: list[PerJoint] | None = Field(default=None, min_length=1)
    durations: Times | None = None
    holds: Stands | None = None
    file: str | None = None
    path: PathSection | None = None
    frame: str | None = None
    direction: Vector | None = None
    tool_axis: Vector | None = None


SupervisorSection: Any = later("supervisor", partial(section, "supervisor", Supervisor))


class VarySection(Section):
    """What a parameter of a sweep is drawn from: one of four distributions.

    Attributes:
        uniform: lowest and highest value.
        log_uniform: the same, its logarithm evenly drawn.
        normal: mean and standard deviation; the tails beyond 4 of these are cut.
        choices: some values, all as likely.
        each: whether a per-joint parameter is drawn once for each rollout, or for each of its joints.
    """

    uniform: list[Number] | None = None
    log_uniform: list[Number] | None = None
    normal: list[Number] | None = None
    choices: list[Number] | None = Field(default=None, min_length=1)
    each: Literal["rollout", "joint"] = "rollout"


class ExperimentConfig(Section):
    """A whole experiment file.

    Attributes:
        robot: which arm.
        plant: what it really is like.
        reality: instead of `plant`, a draw (`index`) of a reality by its name and seed. It also says sample
            time, reference and length of the run, where the file does not.
        controllers: who controls it; `run` takes the first one, `compare` all.
        reference: where to.
        supervisor: what all controllers are under; none when not given. `{}` has every default.
        sample_time: of the controllers [s].
        t_final: how long [s]; when not given, until the reference has ended and 2 s more.
        record_every: record every so many samples.
        seed: of all random numbers.
        vary: what `armgpi sweep` draws: name of a parameter -> distribution. Other commands leave it out.
        failure: when a rollout of a sweep has failed: metric -> largest value of any joint. One that diverges
            has failed anyway.
    """

    robot: RobotSection
    plant: PlantSection = Field(default_factory=PlantSection)
    reality: RealitySection | None = None
    controllers: list[ControllerSection] = Field(
        default_factory=lambda: [SECTIONS["gpi"](type="gpi")], min_length=1
    )
    reference: ReferenceSection = Field(default_factory=ReferenceSection)
    supervisor: SupervisorSection | None = None
    sample_time: Number = Field(default=1e-3, ge=1e-9)
    t_final: Positive | None = None
    record_every: Whole = Field(default=1, ge=1)
    seed: Whole = Field(default=0, ge=0, le=2**63 - 1)
    vary: dict[str, VarySection] = {}
    failure: dict[str, NotNegative] = {}


SECTIONS.update(
    {
        "robot": RobotSection,
        "friction": FrictionSection,
        "plant": PlantSection,
        "payload": PayloadSection,
        "reference": ReferenceSection,
        "vary": VarySection,
    }
)
#: Steps of pydantic's locations that are tags and no keys.
TAGS = {"number", "list", "table", "mapping", "[key]", "box", *KINDS, *classes_of(Load), *classes_of(Path)}
