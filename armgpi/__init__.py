"""armgpi controls a robot arm by joint torques and measures joint positions only.

The public names by what they are for; `help(armgpi.GPI)` explains one, docs/python.md is a tour. Write
`import armgpi`: names are loaded on their first use, so `from armgpi import *` imports none.

Robots
    Robot, RobotBatch, robots, assume_drives, Friction, health
Motions (references)
    Bezier, Waypoints, Hold, default_move, CartesianReference, Recorded, PosePath, load_poses, Setpoints,
    Follower, FollowLimits, Reference, ReferenceBatch, Target
Controllers
    GPI, CartesianImpedance, JointImpedance, ImpedanceLimits, ForceLimited, ForceBound, PIDPositions,
    PIDInversion, ADRC, ComputedTorqueDOB, SuperTwisting, SlotineLi, Controller, ControlStep, Measurement,
    FullState
Gains of a GPI
    FixedGains, GainSchedule, BSplineNetwork, Gains, Tuning, Weights, learned_weights, load_weights,
    save_weights, default_omega, LargestPayload, PayloadRange, largest_payload, payload_range
Simulated arms (plants), sensors, actuators, loads, faults, contact
    RigidBodyPlant, ElasticPlant, MuJoCoPlant, Plant, Wrapper, Encoder, Noisy, Delayed, DropOut,
    Differentiated, SingleTurn, Unwrapped, Saturated, RateLimited, MotorFault, SensorFault, Load, Step,
    Pulse, Ramp, Sine, Contact, ToolForce, Wall, Spring, Reality, Scenario
Runs
    simulate, compare, Comparison, prepare, PreparedLoop, ClosedLoop, Status, load, save, metrics,
    tool_wrench, WrenchEstimator, ToolWrench
Pictures
    plots, view, report
Supervisor and export
    Supervisor, Supervised, export_controller, ExportedController
Models: check, derive, identify
    validate, DynamicsReport, derive, Derivation, suggest_urdf, identify
Bounds
    certify, Certificate, bound_path, PathBound
Inverse kinematics
    inverse_kinematics, InverseSolution, TrackingInverse
Errors
    errors, ArmgpiError, ArmgpiWarning
"""

import os
import sys
from importlib import import_module
from typing import TYPE_CHECKING

from armgpi.base.renamed import MEMBERS, warn_renamed
from armgpi.base.version import VERSION

if sys.platform == "win32":  # forks, signals and the cache's permissions are POSIX's; Pinocchio has no wheels
    raise ImportError("armgpi runs on Linux and macOS; on Windows use it inside WSL 2 (wsl --install)")

# Pinocchio's batch kernels use OpenMP, whose threads spin while they wait: on a machine that is busy with
# something else a batch then takes ten times as long. To have an effect this must come before Pinocchio.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

if TYPE_CHECKING:
    from armgpi import errors as errors
    from armgpi import health as health
    from armgpi.certification.certificate import Certificate as Certificate
    from armgpi.certification.certificate import certify as certify
    from armgpi.certification.path import PathBound as PathBound
    from armgpi.certification.path import bound_path as bound_path
    from armgpi.config.default_move import default_move as default_move
    from armgpi.control.adrc import ADRC as ADRC
    from armgpi.control.controller import Controller as Controller
    from armgpi.control.controller import ControlStep as ControlStep
    from armgpi.control.controller import FullState as FullState
    from armgpi.control.controller import Measurement as Measurement
    from armgpi.control.ctdob import ComputedTorqueDOB as ComputedTorqueDOB
    from armgpi.control.force_limit import ForceBound as ForceBound
    from armgpi.control.force_limited import ForceLimited as ForceLimited
    from armgpi.control.impedance import CartesianImpedance as CartesianImpedance
    from armgpi.control.impedance import JointImpedance as JointImpedance
    from armgpi.control.impedance_limits import ImpedanceLimits as ImpedanceLimits
    from armgpi.control.pid import PIDInversion as PIDInversion
    from armgpi.control.pid_positions import PIDPositions as PIDPositions
    from armgpi.control.slotineli import SlotineLi as SlotineLi
    from armgpi.control.supertwisting import SuperTwisting as SuperTwisting
    from armgpi.control.wrench import ToolWrench as ToolWrench
    from armgpi.control.wrench import WrenchEstimator as WrenchEstimator
    from armgpi.errors import ArmgpiError as ArmgpiError
    from armgpi.errors import ArmgpiWarning as ArmgpiWarning
    from armgpi.gpi.gains import FixedGains as FixedGains
    from armgpi.gpi.gains import Gains as Gains
    from armgpi.gpi.gains import Tuning as Tuning
    from armgpi.gpi.law import GPI as GPI
    from armgpi.gpi.margins import default_omega as default_omega
    from armgpi.gpi.network import BSplineNetwork as BSplineNetwork
    from armgpi.gpi.payload import LargestPayload as LargestPayload
    from armgpi.gpi.payload import PayloadRange as PayloadRange
    from armgpi.gpi.payload import largest_payload as largest_payload
    from armgpi.gpi.payload import payload_range as payload_range
    from armgpi.gpi.schedule import GainSchedule as GainSchedule
    from armgpi.gpi.weights import Weights as Weights
    from armgpi.hardware.export.controller import ExportedController as ExportedController
    from armgpi.hardware.export.files import export_controller as export_controller
    from armgpi.identification.arm import identify as identify
    from armgpi.loop import metrics as metrics
    from armgpi.loop.closed_loop import ClosedLoop as ClosedLoop
    from armgpi.loop.prepared import PreparedLoop as PreparedLoop
    from armgpi.loop.prepared import prepare as prepare
    from armgpi.loop.rollout import Status as Status
    from armgpi.loop.rollout import load as load
    from armgpi.loop.rollout import save as save
    from armgpi.loop.simulation import simulate as simulate
    from armgpi.loop.weights import learned_weights as learned_weights
    from armgpi.loop.weights import load_weights as load_weights
    from armgpi.loop.weights import save_weights as save_weights
    from armgpi.loop.wrench import tool_wrench as tool_wrench
    from armgpi.plants.actuators import RateLimited as RateLimited
    from armgpi.plants.actuators import Saturated as Saturated
    from armgpi.plants.elastic import ElasticPlant as ElasticPlant
    from armgpi.plants.environment import Contact as Contact
    from armgpi.plants.environment import Spring as Spring
    from armgpi.plants.environment import ToolForce as ToolForce
    from armgpi.plants.environment import Wall as Wall
    from armgpi.plants.faults import MotorFault as MotorFault
    from armgpi.plants.faults import SensorFault as SensorFault
    from armgpi.plants.loads import Load as Load
    from armgpi.plants.loads import Pulse as Pulse
    from armgpi.plants.loads import Ramp as Ramp
    from armgpi.plants.loads import Sine as Sine
    from armgpi.plants.loads import Step as Step
    from armgpi.plants.mujoco import MuJoCoPlant as MuJoCoPlant
    from armgpi.plants.plant import Plant as Plant
    from armgpi.plants.plant import Wrapper as Wrapper
    from armgpi.plants.reality import Reality as Reality
    from armgpi.plants.reality import Scenario as Scenario
    from armgpi.plants.rigid_body import RigidBodyPlant as RigidBodyPlant
    from armgpi.plants.sensors import Delayed as Delayed
    from armgpi.plants.sensors import Differentiated as Differentiated
    from armgpi.plants.sensors import DropOut as DropOut
    from armgpi.plants.sensors import Encoder as Encoder
    from armgpi.plants.sensors import Noisy as Noisy
    from armgpi.plants.turns import SingleTurn as SingleTurn
    from armgpi.plants.turns import Unwrapped as Unwrapped
    from armgpi.references.batch import ReferenceBatch as ReferenceBatch
    from armgpi.references.bezier import Bezier as Bezier
    from armgpi.references.cartesian import CartesianReference as CartesianReference
    from armgpi.references.following import Follower as Follower
    from armgpi.references.following import FollowLimits as FollowLimits
    from armgpi.references.following import Setpoints as Setpoints
    from armgpi.references.poses import PosePath as PosePath
    from armgpi.references.poses import load_poses as load_poses
    from armgpi.references.recorded import Recorded as Recorded
    from armgpi.references.reference import Reference as Reference
    from armgpi.references.reference import Target as Target
    from armgpi.references.waypoints import Hold as Hold
    from armgpi.references.waypoints import Waypoints as Waypoints
    from armgpi.robot import robots as robots
    from armgpi.robot.batch import RobotBatch as RobotBatch
    from armgpi.robot.equations import Friction as Friction
    from armgpi.robot.kinematics import InverseSolution as InverseSolution
    from armgpi.robot.kinematics import TrackingInverse as TrackingInverse
    from armgpi.robot.kinematics import inverse_kinematics as inverse_kinematics
    from armgpi.robot.robot import Robot as Robot
    from armgpi.robot.rotors import assume_drives as assume_drives
    from armgpi.supervisor import Supervised as Supervised
    from armgpi.supervisor import Supervisor as Supervisor
    from armgpi.validation.check import validate as validate
    from armgpi.validation.derivation import Derivation as Derivation
    from armgpi.validation.derivation import derive as derive
    from armgpi.validation.report import DynamicsReport as DynamicsReport
    from armgpi.validation.skeleton import suggest_urdf as suggest_urdf
    from armgpi.viewing import plots as plots
    from armgpi.viewing.results import Comparison as Comparison
    from armgpi.viewing.results import compare as compare
    from armgpi.viewing.results import report as report
    from armgpi.viewing.results import view as view

_MODULES = {
    "errors": "errors",
    "health": "health",
    "metrics": "loop.metrics",
    "plots": "viewing.plots",
    "robots": "robot.robots",
}
_NAMES = {
    "certification.certificate": ("Certificate", "certify"),
    "certification.path": ("PathBound", "bound_path"),
    "config.default_move": ("default_move",),
    "control.adrc": ("ADRC",),
    "control.ctdob": ("ComputedTorqueDOB",),
    "control.force_limit": ("ForceBound",),
    "control.force_limited": ("ForceLimited",),
    "control.wrench": ("ToolWrench", "WrenchEstimator"),
    "loop.wrench": ("tool_wrench",),
    "control.impedance": ("CartesianImpedance", "JointImpedance"),
    "control.impedance_limits": ("ImpedanceLimits",),
    "control.pid_positions": ("PIDPositions",),
    "gpi.schedule": ("GainSchedule",),
    "control.slotineli": ("SlotineLi",),
    "control.supertwisting": ("SuperTwisting",),
    "supervisor": ("Supervised", "Supervisor"),
    "control.controller": ("Controller", "ControlStep", "FullState", "Measurement"),
    "gpi.gains": ("FixedGains", "Gains", "Tuning"),
    "gpi.margins": ("default_omega",),
    "gpi.law": ("GPI",),
    "gpi.network": ("BSplineNetwork",),
    "gpi.payload": ("LargestPayload", "PayloadRange", "largest_payload", "payload_range"),
    "control.pid": ("PIDInversion",),
    "gpi.weights": ("Weights",),
    "errors": ("ArmgpiError", "ArmgpiWarning"),
    "hardware.export.controller": ("ExportedController",),
    "hardware.export.files": ("export_controller",),
    "identification.arm": ("identify",),
    "robot.kinematics": ("InverseSolution", "TrackingInverse", "inverse_kinematics"),
    "plants.actuators": ("RateLimited", "Saturated"),
    "plants.faults": ("MotorFault", "SensorFault"),
    "plants.environment": ("Contact", "Spring", "ToolForce", "Wall"),
    "plants.loads": ("Load", "Pulse", "Ramp", "Sine", "Step"),
    "plants.mujoco": ("MuJoCoPlant",),
    "plants.plant": ("Plant", "Wrapper"),
    "plants.reality": ("Scenario", "Reality"),
    "plants.elastic": ("ElasticPlant",),
    "plants.rigid_body": ("RigidBodyPlant",),
    "plants.sensors": ("Delayed", "Differentiated", "DropOut", "Encoder", "Noisy"),
    "plants.turns": ("SingleTurn", "Unwrapped"),
    "references.batch": ("ReferenceBatch",),
    "references.bezier": ("Bezier",),
    "references.cartesian": ("CartesianReference",),
    "references.following": ("FollowLimits", "Follower", "Setpoints"),
    "references.poses": ("PosePath", "load_poses"),
    "references.recorded": ("Recorded",),
    "references.reference": ("Reference", "Target"),
    "references.waypoints": ("Hold", "Waypoints"),
    "robot.batch": ("RobotBatch",),
    "robot.equations": ("Friction",),
    "robot.robot": ("Robot",),
    "robot.rotors": ("assume_drives",),
    "loop.rollout": ("Status", "load", "save"),
    "loop.closed_loop": ("ClosedLoop",),
    "loop.prepared": ("PreparedLoop", "prepare"),
    "loop.simulation": ("simulate",),
    "loop.weights": ("learned_weights", "load_weights", "save_weights"),
    "validation.check": ("validate",),
    "validation.derivation": ("Derivation", "derive"),
    "validation.report": ("DynamicsReport",),
    "validation.skeleton": ("suggest_urdf",),
    "viewing.results": ("Comparison", "compare", "report", "view"),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names}

__version__ = VERSION
_RENAMED = MEMBERS
_PUBLIC = sorted([*_MODULES, *_HOME, "__version__"])


def __getattr__(name: str) -> object:
    """Load a public name on its first use (PEP 562)."""
    if name in _RENAMED:
        warn_renamed(f"armgpi.{name}", f"armgpi.{_RENAMED[name]}")
        return __getattr__(_RENAMED[name])
    if name in _MODULES:
        value: object = import_module(f"armgpi.{_MODULES[name]}")
    elif name in _HOME:
        value = getattr(import_module(f"armgpi.{_HOME[name]}"), name)
    else:
        from armgpi.base.hints import MODULE, missing

        raise AttributeError(missing("module 'armgpi'", name, MODULE, __dir__()))
    globals()[name] = value  # the next use finds it without coming here
    return value


def __dir__() -> list[str]:
    """Return the public names.

    There is no `__all__`: with it, `help(armgpi)` would print the help of every name, ten thousand lines.
    """
    return _PUBLIC
