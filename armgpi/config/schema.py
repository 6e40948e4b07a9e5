"""What may stand in an experiment file: its sections and keys, as pydantic models.

Every quantity is in SI units. A per-joint quantity is a number for all joints, a list, or a mapping from
joint names.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Tag


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
    """Accept one name where a list of them may stand."""
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

PerJoint = Annotated[
    Annotated[Number, Tag("number")]
    | Annotated[list[Number], Tag("list")]
    | Annotated[dict[str, Number], Tag("mapping")],
    Discriminator(_shape),
]
PerJointPositive = Annotated[
    Annotated[Positive, Tag("number")]
    | Annotated[list[Positive], Tag("list")]
    | Annotated[dict[str, Positive], Tag("mapping")],
    Discriminator(_shape),
]
PerJointNotNegative = Annotated[
    Annotated[NotNegative, Tag("number")]
    | Annotated[list[NotNegative], Tag("list")]
    | Annotated[dict[str, NotNegative], Tag("mapping")],
    Discriminator(_shape),
]
Names = Annotated[list[str], BeforeValidator(_names)]
#: Names, or name -> value; a name without a value is locked where ``Robot.load`` chooses.
Locks = Annotated[
    Annotated[Names, Tag("list")] | Annotated[dict[str, Number | None], Tag("mapping")],
    Discriminator(lambda value: "mapping" if isinstance(value, dict) else "list"),
]
Times = Annotated[
    Annotated[Positive, Tag("number")] | Annotated[list[Positive], Tag("list")],
    Discriminator(lambda value: "list" if isinstance(value, list) else "number"),
]
Stands = Annotated[
    Annotated[NotNegative, Tag("number")] | Annotated[list[NotNegative], Tag("list")],
    Discriminator(lambda value: "list" if isinstance(value, list) else "number"),
]


class _Section(BaseModel):
    """A part of the file; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class BoxSection(_Section):
    """Lowest and highest value of a tuning parameter."""

    lower: PerJointPositive
    upper: PerJointPositive


def _box_shape(value: Any) -> str:
    """Tell how a box is given: by its two ends, or as one value that does not adapt."""
    ends = isinstance(value, dict) and {"lower", "upper"} & set(value)
    return "box" if ends or isinstance(value, BoxSection) else _shape(value)


Box = Annotated[
    Annotated[BoxSection, Tag("box")]
    | Annotated[Positive, Tag("number")]
    | Annotated[list[Positive], Tag("list")]
    | Annotated[dict[str, Positive], Tag("mapping")],
    Discriminator(_box_shape),
]


class RobotSection(_Section):
    """Which arm.

    Attributes:
        name: a name from ``armgpi.robots.names()`` or the path of a URDF, relative to the file.
        lock: joints to hold fixed: names, or name -> value [rad or m].
        keep: when given, every other joint is locked.
        mimic: whether joints that mimic another are locked or follow it.
        effort: effort limits that replace the URDF's [N m or N].
    """

    name: str
    lock: Locks = []
    keep: Names | None = None
    mimic: Literal["lock", "follow"] = "lock"
    effort: PerJointNotNegative | None = None


class PayloadSection(_Section):
    """A load that the controller does not know: mass [kg] at com [m] in a frame (the tip when not given)."""

    mass: NotNegative
    frame: str | None = None
    com: list[Number] = Field(default=[0.0, 0.0, 0.0], min_length=3, max_length=3)


class StepLoad(_Section):
    """A constant disturbance torque; see :class:`armgpi.Step`."""

    type: Literal["step"]
    amplitude: PerJoint
    onset: Number = 0.0
    end: Number | None = None


class RampLoad(_Section):
    """A disturbance torque that grows; see :class:`armgpi.Ramp`."""

    type: Literal["ramp"]
    slope: PerJoint
    onset: Number = 0.0
    end: Number | None = None


class SineLoad(_Section):
    """A vibrating disturbance torque; see :class:`armgpi.Sine`."""

    type: Literal["sine"]
    amplitude: PerJoint
    omega: PerJoint
    phase: PerJoint = 0.0
    onset: Number = 0.0
    end: Number | None = None


class PulseLoad(_Section):
    """A push; see :class:`armgpi.Pulse`."""

    type: Literal["pulse"]
    amplitude: PerJoint
    onset: Number
    duration: Positive


class PaperLoad(_Section):
    """The disturbance torques of eqs. 29-31, for the paper's arm."""

    type: Literal["paper"]


LoadSection = Annotated[StepLoad | RampLoad | SineLoad | PulseLoad | PaperLoad, Field(discriminator="type")]


class NoiseSection(_Section):
    """White noise on the measurements: standard deviations [rad or m, rad/s or m/s]."""

    position: NotNegative = 0.0
    velocity: NotNegative = 0.0


class PlantSection(_Section):
    """What differs from the model that the controller has, and what is on the wires.

    Attributes:
        payload: a load that the controller does not know.
        armature: rotor inertia that it does not know [kg m^2 or kg].
        friction: "urdf" for the URDF's friction coefficients, "none".
        loads: disturbance torques.
        substeps: integration steps per sample.
        encoder_bits: encoder resolution; exact positions when not given.
        delay: samples by which measurements are late.
        drop_out: share of measurements lost.
        noise: measurement noise.
        torque_rate: highest rate of change of torque [N m/s or N/s].
        velocity_bandwidth: when given, velocities come from differences of the measured positions, filtered
            with it [rad/s]; exact velocities when not. GPI sees none.
    """

    payload: PayloadSection | None = None
    armature: PerJointNotNegative | None = None
    friction: Literal["urdf", "none"] = "none"
    loads: list[LoadSection] = []
    substeps: Whole = Field(default=1, ge=1, le=1000)
    encoder_bits: Annotated[Whole, Field(ge=1, le=52)] | None = None
    delay: Whole = Field(default=0, ge=0, le=10_000)
    drop_out: NotNegative = Field(default=0.0, lt=1.0)
    noise: NoiseSection | None = None
    torque_rate: PerJointPositive | None = None
    velocity_bandwidth: Positive | None = None


class RangeSection(_Section):
    """Loads that a controller shall stand: masses [kg] at com [m] in a frame (the tip when not given)."""

    lightest: NotNegative = 0.0
    heaviest: NotNegative
    frame: str | None = None
    com: Annotated[list[Number], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]


class GPISection(_Section):
    """A GPI controller; see :class:`armgpi.GPI`. `inertia_scale` multiplies the D(q) that it believes in.

    `payload_range` are loads that it shall stand: it believes in the heaviest.
    """

    type: Literal["gpi"]
    label: str | None = None
    omega: PerJointPositive | None = None
    zeta: PerJointPositive = 1.0
    p: PerJointPositive | None = None
    realisation: Literal["bumpless", "paper"] = "bumpless"
    start: Literal["hold", "zero"] = "hold"
    inertia_scale: Positive = 1.0
    payload_range: RangeSection | None = None


class NetworkSection(_Section):
    """GPI with gains that B-spline networks adapt; see :class:`armgpi.BSplineNetwork`.

    Attributes:
        label: name in tables.
        omega: box of the natural frequency [rad/s]; from 22/30 of the default bandwidth to twice it when not
            given, as the sample time and the delay allow.
        zeta: box of the damping ratio, or one value.
        p: box of the real pole [rad/s], or one value; follows omega when not given.
        learning: "magnitude" or "signed" (eq. 23 to the letter).
        learning_rate: l of eq. 23.
        error_range: error at which a gain's aim is the upper end [rad or m]; an encoder count when not given.
        derivative_range: end of the range of the filtered derivative [rad/s or m/s].
        dead_zone: error that raises no gain [rad or m]; two encoder counts when not given.
        leak: how fast what was learned is forgotten [1/s].
        rate: rho of abs(d omega/dt) <= rho omega^2; no limit when not given.
        bandwidth: of the derivative's filter [rad/s].
        knots: of the basis functions over inputs scaled to [-1, 1], symmetric; two functions per input when
            not given.
        order: of the basis functions.
        realisation: "bumpless" or "paper".
        start: "hold" or "zero".
        inertia_scale: multiplies the D(q) that it believes in.
        payload_range: loads that it shall stand: it believes in the heaviest.
    """

    type: Literal["network"]
    label: str | None = None
    omega: Box | None = None
    zeta: Box = 0.75
    p: Box | None = None
    learning: Literal["magnitude", "signed"] = "magnitude"
    learning_rate: PerJointNotNegative = 0.2
    error_range: PerJointPositive | None = None
    derivative_range: PerJointPositive = 1.0
    dead_zone: PerJointNotNegative | None = None
    leak: NotNegative = 5.0
    rate: PerJointPositive | None = None
    bandwidth: Positive = 60.0
    knots: list[Number] | None = None
    order: Whole = 3
    realisation: Literal["bumpless", "paper"] = "bumpless"
    start: Literal["hold", "zero"] = "hold"
    inertia_scale: Positive = 1.0
    payload_range: RangeSection | None = None


class PIDSection(_Section):
    """PID with dynamic inversion; see :class:`armgpi.PIDInversion`. `inertia_scale` scales its D(q) alone."""

    type: Literal["pid"]
    label: str | None = None
    kp: PerJointNotNegative = 400.0
    ki: PerJointNotNegative = 500.0
    kd: PerJointNotNegative = 40.0
    inertia_scale: Positive = 1.0


ControllerSection = Annotated[GPISection | NetworkSection | PIDSection, Field(discriminator="type")]


Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]


class LaserSection(_Section):
    """The laser path of eq. 28; see :class:`armgpi.references.paths.LaserPath`."""

    type: Literal["laser"]
    rate: Positive = 1.0 / 9.0


class LissajousSection(_Section):
    """A Lissajous curve; see :class:`armgpi.references.paths.Lissajous`.

    What is not given is chosen for the arm: an eight around a point where it has room.
    """

    type: Literal["lissajous"]
    centre: Vector | None = None
    amplitude: Vector | None = None
    omega: Vector = [1.0, 1.0, 2.0]
    phase: Vector = [0.0, 0.0, 0.0]
    ease: NotNegative = 1.0


class CircleSection(_Section):
    """A circle; see :class:`armgpi.references.paths.Circle`; chosen for the arm where nothing is given."""

    type: Literal["circle"]
    centre: Vector | None = None
    radius: Positive | None = None
    period: Positive = 6.0
    normal: Vector = [0.0, 0.0, 1.0]
    ease: NotNegative = 1.0


class PolylineSection(_Section):
    """Straight lines; see :class:`armgpi.references.paths.Polyline`; a square for the arm by default."""

    type: Literal["polyline"]
    corners: Annotated[list[Vector], Field(min_length=2)] | None = None
    durations: Times = 2.0
    holds: NotNegative = 0.0


PathSection = Annotated[
    LaserSection | LissajousSection | CircleSection | PolylineSection, Field(discriminator="type")
]


class ReferenceSection(_Section):
    """Smooth moves from configuration to configuration with holds, or a path of the tool in space.

    Attributes:
        points: configurations [rad or m]; a mapping keeps the joints that it does not name where they were,
            and starts from the middle of the joint ranges. When not given, every joint moves by up to 0.5
            from there and back, and less where the motors would not hold the arm.
        durations: of the moves [s]; gentle ones when not given, which the motors can.
        holds: at each configuration [s]; 0 when not given, 1 when there are no points either.
        path: instead of all these, where a frame shall go in space.
        frame: which frame follows the path; the tip when not given.
        direction: where the frame's `tool_axis` points to all along; anywhere when not given.
        tool_axis: an axis in the frame.
    """

    points: list[PerJoint] | None = Field(default=None, min_length=1)
    durations: Times | None = None
    holds: Stands | None = None
    path: PathSection | None = None
    frame: str | None = None
    direction: Vector | None = None
    tool_axis: Vector | None = None


class ExperimentConfig(_Section):
    """A whole experiment file.

    Attributes:
        robot: which arm.
        plant: what it really is like.
        controllers: who controls it; `run` takes the first one, `compare` all.
        reference: where to.
        sample_time: of the controllers [s].
        t_final: how long [s]; when not given, until the reference has ended and 2 s more.
        record_every: record every so many samples.
        seed: of all random numbers.
    """

    robot: RobotSection
    plant: PlantSection = PlantSection()
    controllers: list[ControllerSection] = Field(default=[GPISection(type="gpi")], min_length=1)
    reference: ReferenceSection = ReferenceSection()
    sample_time: Number = Field(default=1e-3, ge=1e-9)
    t_final: Positive | None = None
    record_every: Whole = Field(default=1, ge=1)
    seed: Whole = Field(default=0, ge=0, le=2**63 - 1)


#: Sections by the steps of pydantic's locations: keys, and the tags of unions.
SECTIONS: dict[str, type[BaseModel]] = {
    "robot": RobotSection,
    "plant": PlantSection,
    "payload": PayloadSection,
    "step": StepLoad,
    "ramp": RampLoad,
    "sine": SineLoad,
    "pulse": PulseLoad,
    "paper": PaperLoad,
    "noise": NoiseSection,
    "gpi": GPISection,
    "network": NetworkSection,
    "box": BoxSection,
    "pid": PIDSection,
    "reference": ReferenceSection,
    "payload_range": RangeSection,
    "laser": LaserSection,
    "lissajous": LissajousSection,
    "circle": CircleSection,
    "polyline": PolylineSection,
}
#: Of these, the ones that are keys.
_KEYS = {"robot", "plant", "payload", "payload_range", "noise", "reference"}
#: Steps of pydantic's locations that are tags and no keys.
TAGS = {"number", "list", "mapping", "[key]", "box", *(tag for tag in SECTIONS if tag not in _KEYS)}
