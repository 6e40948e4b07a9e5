"""Whatever is given to a public name: a finite value, what is promised instead, or an error of ours.

A case is a public callable with arguments that are good, and what is then done with its result. Every
argument is replaced in turn by what nobody should give. A warning that is not ours is a failure as well.
"""

from __future__ import annotations

import inspect
import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

import armgpi
from armgpi import ArmgpiError, ArmgpiWarning, FullState, Measurement, Robot, Target, health, metrics, robots
from armgpi.base.arrays import LARGEST
from armgpi.base.parameter import Parameter, parameters
from armgpi.gpi.family import Member
from armgpi.gpi.payload import LoadRange
from armgpi.hardware.export.files import record
from armgpi.plants.loads import multi_sine
from armgpi.references import paths
from armgpi.references.bezier import minimum_duration

ARM = Robot.load("anthropomorphic3")
Q = [0.1, 0.4, -0.4]
GOAL = [0.2, 0.5, -0.3]
V = [0.1, 0.0, -0.1]
DT = 1e-3
TIP = ARM.tip
#: Some point that the arm reaches [m].
POINT = ARM.frame_pose(TIP, Q).translation.tolist()
READ_ONLY = np.array(Q)
READ_ONLY.setflags(write=False)


#: Keys of descriptions whose value may be infinite.
UNLIMITED = {"robot", "effort", "t_end", "rate", "end"}


class Nameless:
    """An object that does not even say what it is."""

    def __repr__(self) -> str:
        raise RuntimeError("no name")


def nested(depth: int) -> list[Any]:
    """Return a list in a list in a list ..."""
    inner: list[Any] = []
    for _ in range(depth):
        inner = [inner]
    return inner


HOSTILE: dict[str, Any] = {
    "None": None,
    "True": True,
    "numpy bool": np.True_,
    "empty text": "",
    "text": "nonsense",
    "text with NUL": "a\0b",
    "surrogate": "\udcff",
    "number as text": "1.0",
    "bytes": b"1.0",
    "nan": math.nan,
    "numpy nan": np.float64(math.nan),
    "inf": math.inf,
    "-inf": -math.inf,
    "-0.0": -0.0,
    "0": 0,
    "-1": -1,
    "0.5": 0.5,
    "smallest": 5e-324,
    "1e-300": 1e-300,
    "1e-100": 1e-100,
    "1e-20": 1e-20,
    "1e20": 1e20,
    "1e100": 1e100,
    "-1e100": -1e100,
    "1e304": 1e304,
    "largest": -1.7976931348623157e308,
    "float32": np.float32(1e30),
    "2**31": 2**31,
    "2**62": 2**62,
    "2**64": 2**64,
    "10**400": 10**400,
    "10**5000": 10**5000,
    "complex": 1j,
    "object": object(),
    "nameless": Nameless(),
    "class": float,
    "function": len,
    "date": np.datetime64("2022-01-01"),
    "set": {1.0, 2.0},
    "mapping": {"q2": 1.0},
    "mapping of None": {None: None},
    "generator": (x for x in Q),
    "empty": [],
    "empty array": np.empty(0),
    "empty batch": np.empty((0, 3)),
    "one": [0.5],
    "two": [1.0, 2.0],
    "pair": (0.5, 1.0),
    "huge pair": (-1e304, 1e304),
    "two with None": [None, 1.0],
    "ragged": [[1.0, 2.0], [3.0]],
    "nested": nested(40),
    "deep": nested(5000),
    "bools": [True, False, True],
    "texts": ["1", "2", "3"],
    "joints": list(ARM.joint_names),
    "big-endian": np.array(Q, dtype=">f8"),
    "float32s": np.array(Q, dtype=np.float32),
    "ints": np.array([0, 1, 2]),
    "objects": np.array([0.1, None, object()], dtype=object),
    "0-d": np.array(0.3),
    "one nan": np.array([0.1, math.nan, 0.1]),
    "one inf": np.array([0.1, math.inf, 0.1]),
    "one huge": np.array([0.1, 1e304, -1e304]),
    "one tiny": np.array([0.1, 1e-320, 0.1]),
    "read-only": READ_ONLY,
    "every other": np.arange(6.0)[::2] * 0.1,
    "batch": np.array([Q, GOAL]),
    "columns": np.array(Q)[:, None],
    "three axes": np.zeros((2, 2, 3)),
    "four joints": np.zeros(4),
    "masked": np.ma.masked_invalid([0.1, math.nan, 0.1]),
}


class Case(NamedTuple):
    """A public callable.

    Attributes:
        call: it.
        good: arguments by their names, which do.
        use: what is done with the result; what that returns has to be finite.
        promised: whether the docstring promises NaN or infinity for some of what is good.
        slow: whether it takes more than some milliseconds.
    """

    call: Callable[..., Any]
    good: Mapping[str, Any]
    use: Callable[[Any], Any] = lambda result: result
    promised: bool = False
    slow: bool = False


# --- What is done with a result ------------------------------------------------------------------


def followed(reference: Any) -> Any:
    """Follow a reference."""
    repr(reference)
    return reference.at(0.2), reference.at(np.array([0.0, 0.1, 1e3])), reference.describe()


def controlled(controller: Any) -> Any:
    """Take two samples of a controller."""
    repr(controller)
    q, v = np.array(Q), np.array(V)
    measured = FullState(q, v) if controller.measurement_type is FullState else Measurement(q)
    target = Target(np.array(GOAL), v, v)
    first = controller.step(measured, target, controller.init(measured, target))
    second = controller.step(measured, target, first.state)
    return first, second, controller.signals(second.state), plain(controller.describe())


def moved(plant: Any) -> Any:
    """Take a sample of a plant."""
    repr(plant)
    first = plant.init(np.array(Q), np.array(V))
    second = plant.step(np.zeros(3), first, DT)
    disturbance = plant.disturbance(np.array([0.0, 0.5]))
    return plant.measure(first), plant.measure(second), disturbance, plain(plant.describe())


def prepared(gains: Any) -> Any:
    """Take two samples of gains."""
    repr(gains)
    ready = gains.prepare(ARM.joint_names, DT)
    e = np.array([1e-3, 0.0, -1e-5])
    first = ready.step(e, np.ones(3), ready.init(e))
    return ready.nominal(), first, ready.step(e, np.ones(3), first.state).tuning, plain(ready.describe())


def touched(contact: Any) -> None:
    """Touch an arm for some samples."""
    moved(armgpi.RigidBodyPlant(ARM, environment=[contact]))


def pushed(load: Any) -> Any:
    """Ask a load for its torque."""
    repr(load)
    return (
        load.torque(np.zeros(())),
        load.torque(np.array([0.2, 1e3]).reshape(2, 1, 1)),
        plain(load.describe()),
    )


def dynamics(robot: Any) -> Any:
    """Ask a robot for its equations of motion."""
    repr(robot)
    q, v = np.array(Q), np.array(V)
    if robot.batch is not None:
        q = np.tile(q, (robot.batch, 1))
    equations = robot.mass_matrix(q), robot.gravity(q), robot.forward_dynamics(q, v, v)
    return equations, robot.nonlinear_effects(q, v), robot.middle()


def on_path(path: Any) -> Any:
    """Go along a path."""
    repr(path)
    return path.at(0.2), path.at(np.array([0.0, 0.1, 3.0])), plain(path.describe())


def plain(described: Any) -> Any:
    """Return a description without what may be infinite: limits that are none."""
    if isinstance(described, list):
        return [plain(each) for each in described]
    if not isinstance(described, Mapping):
        return described
    return {key: plain(value) for key, value in described.items() if key not in UNLIMITED}


def looped(loop: Any) -> Any:
    """Take a sample of a loop."""
    return loop.step(loop.init())


def numbers(result: Any) -> Iterator[float | np.ndarray]:
    """Yield all the numbers in a result."""
    if isinstance(result, xr.Dataset):
        result = {name: variable.values for name, variable in result.variables.items()}
    if isinstance(result, xr.DataArray):
        result = result.values
    if (isinstance(result, np.ndarray) and result.dtype.kind in "fc") or isinstance(result, float):
        yield result
    elif isinstance(result, Mapping):
        for value in result.values():
            yield from numbers(value)
    elif isinstance(result, tuple | list):
        for value in result:
            yield from numbers(value)


# --- The public surface --------------------------------------------------------------------------


def gpi(**a: Any) -> Any:
    return armgpi.GPI(**{"robot": ARM, "dt": DT, **a})


@cache
def rollout() -> xr.Dataset:
    return armgpi.simulate(armgpi.RigidBodyPlant(ARM), gpi(), armgpi.Bezier(Q, GOAL, 0.5), 0.02)


PLANT = armgpi.RigidBodyPlant(ARM)
MOVE = {"start": Q, "goal": GOAL, "duration": 0.5, "t_start": 0.0}
LIMITS = {"velocity_limit": 2.0, "acceleration_limit": [5.0, 6.0, 7.0]}
INVERSE = armgpi.TrackingInverse(ARM, TIP)
LINE = paths.line(POINT, [POINT[0], POINT[1], POINT[2] + 0.01], 0.5)
BOUND = {"lower": -1.0, "upper": 1.0, "velocity": 2.0, "effort": 3.0}
TENSOR = np.diag([0.01, 0.01, 0.01])
BODIES = np.array([body.toDynamicParameters() for body in ARM.pinocchio_model().inertias[1:]])
TASK = {
    "rotation": None,
    "direction": None,
    "tool_axis": (0.0, 0.0, 1.0),
    "near": Q,
    "restarts": 4,
    "seed": 0,
}
LOADED = {"robot": ARM, "frame": TIP, "com": (0.0, 0.0, 0.0), "dt": DT, "delay": 0.0}
IMPEDANCE: dict[str, Any] = {
    "effort": 3.0,
    "damping_ratio": 0.8,
    "friction_feedforward": True,
    "friction_smoothing": 0.05,
    "velocity_filter": 200.0,
    "delay": 0.0,
}
NOWHERE = "/nonexistent/folder/rollout.nc"

#: Numbers of an observer's damping and schedule.
SCHEDULED: dict[str, Any] = {
    **{"zeta_c": 1.0, "rise": 2.0, "attack": 0.2, "leak": 5.0},
    **{"error_range": 1e-4, "dead_zone": 2e-4},
}

CASES: dict[str, Case] = {
    # References
    "Bezier": Case(armgpi.Bezier, MOVE, followed),
    "Bezier within limits": Case(armgpi.Bezier, {"start": Q, "goal": GOAL, **LIMITS}, followed),
    "Bezier.at": Case(armgpi.Bezier(**MOVE).at, {"t": 0.1}),
    "Hold": Case(armgpi.Hold, {"q": Q}, followed),
    "Recorded": Case(
        armgpi.Recorded,
        {"times": [0.0, 0.5], "q": np.stack([Q, GOAL]), "t_start": 0.1, "source": "x"},
        lambda made: made.at(0.2),
    ),
    "Recorded.at": Case(armgpi.Recorded([0.0, 1.0], np.stack([Q, GOAL])).at, {"t": 0.1}),
    "Recorded.check": Case(armgpi.Recorded([0.0, 9.0], np.stack([Q, GOAL])).check, {"robot": ARM}),
    "Recorded.load": Case(
        armgpi.Recorded.load,
        {"path": "no such file.csv", "robot": ARM, "t_start": 0.0, "variable": "q", "rollout": 0},
        lambda made: None,
    ),
    "Hold.at": Case(armgpi.Hold(Q).at, {"t": 0.1}),
    "Waypoints": Case(
        armgpi.Waypoints,
        {"points": [Q, GOAL, Q], "durations": [0.5, 0.6], "holds": [0.1, 0.0, 0.2]},
        followed,
    ),
    "Waypoints within limits": Case(
        armgpi.Waypoints, {"points": [Q, GOAL], "holds": 0.1, **LIMITS}, followed
    ),
    "Waypoints.at": Case(armgpi.Waypoints([Q, GOAL], 0.5).at, {"t": 0.1}),
    "ReferenceBatch": Case(
        armgpi.ReferenceBatch, {"references": [armgpi.Hold(Q), armgpi.Bezier(**MOVE)]}, followed
    ),
    "ReferenceBatch.at": Case(armgpi.ReferenceBatch([armgpi.Hold(Q)]).at, {"t": 0.1}),
    "CartesianReference": Case(
        armgpi.CartesianReference,
        {"robot": ARM, "frame": TIP, "path": LINE, "inverse": INVERSE},
        lambda made: made.at(0.02),
        slow=True,
    ),
    "CartesianReference.at": Case(
        armgpi.CartesianReference(ARM, TIP, LINE, INVERSE).at, {"t": 0.02}, slow=True
    ),
    "FollowLimits": Case(
        armgpi.FollowLimits,
        {"velocity": 1.0, "acceleration": [1.0, 2.0, 3.0], "jerk": 9.0},
        lambda made: armgpi.Follower(made, 1e-3),
    ),
    "FollowLimits.of": Case(armgpi.FollowLimits.of, {"robot": ARM, "torque_rate": 100.0}),
    "Follower": Case(armgpi.Follower, {"limits": armgpi.FollowLimits(1.0, 2.0, 9.0), "dt": 1e-3}),
    "Follower.init": Case(
        armgpi.Follower(armgpi.FollowLimits(1.0, 2.0, 9.0), 1e-3).init, {"q": [0.0, 1.0, 2.0]}
    ),
    "Setpoints": Case(
        armgpi.Setpoints,
        {
            "robot": ARM,
            "frame": TIP,
            "times": [0.0, 1.0],
            "poses": np.tile(np.eye(4), (2, 1, 1)),
            "limits": armgpi.FollowLimits(1.0, 2.0, 9.0),
            "start": [0.0, 0.4, -0.4],
            "feedforward": False,
            "dt": 1e-3,
            "inverse": lambda q, position, rotation: q,
        },
        lambda made: made.at(0.005),
        slow=True,
    ),
    "PosePath": Case(
        armgpi.PosePath,
        {"times": [0.0, 1.0], "poses": np.tile(np.eye(4), (2, 1, 1))},
        lambda made: made.turning(0.5),
    ),
    "load_poses": Case(armgpi.load_poses, {"path": "no such file.csv", "topic": "/target_pose"}),
    "minimum_duration": Case(minimum_duration, {"distance": [0.1, 0.2, 0.3], **LIMITS}),
    "LaserPath": Case(paths.LaserPath, {"rate": 0.1}, on_path),
    "Lissajous": Case(
        paths.Lissajous,
        {"centre": POINT, "amplitude": [0.0, 0.1, 0.1], "omega": [1.0, 1.0, 2.0], "phase": [0.0, 0.0, 0.0]},
        on_path,
    ),
    "Circle": Case(
        paths.Circle, {"centre": POINT, "radius": 0.1, "period": 6.0, "normal": [0.0, 0.0, 1.0]}, on_path
    ),
    "Polyline": Case(
        paths.Polyline, {"corners": [POINT, [0.1, 0.1, 0.1]], "durations": 2.0, "holds": 0.1}, on_path
    ),
    "Eased": Case(paths.Eased, {"path": paths.Circle(POINT, 0.1), "duration": 1.0}, on_path),
    "line": Case(paths.line, {"start": POINT, "end": [0.1, 0.1, 0.1], "duration": 1.0}, on_path),
    "rectangle": Case(
        paths.rectangle,
        {"corner": POINT, "side": [0.1, 0.0, 0.0], "other": [0.0, 0.1, 0.0], "duration": 1.0},
        on_path,
    ),
    "LaserPath.at": Case(paths.LaserPath().at, {"t": 0.1}),
    "Lissajous.at": Case(paths.Lissajous(POINT, [0.0, 0.1, 0.1]).at, {"t": 0.1}),
    "Circle.at": Case(paths.Circle(POINT, 0.1).at, {"t": 0.1}),
    "Polyline.at": Case(LINE.at, {"t": 0.1}),
    "Eased.at": Case(paths.Eased(paths.Circle(POINT, 0.1)).at, {"t": 0.1}),
    # Controllers
    "FixedGains": Case(armgpi.FixedGains, {"omega_c": 20.0, "zeta_c": 1.0, "p_c": 20.0}, prepared),
    "FixedGains in GPI": Case(
        lambda **a: gpi(gains=armgpi.FixedGains(**a)),
        {"omega_c": 20.0, "zeta_c": 1.0, "p_c": 20.0},
        controlled,
    ),
    "FixedGains in the printed law": Case(
        lambda **a: gpi(gains=armgpi.FixedGains(**a), realisation="paper"),
        {"omega_c": 20.0, "zeta_c": 1.0, "p_c": 20.0},
        controlled,
    ),
    "BSplineNetwork": Case(
        armgpi.BSplineNetwork,
        {
            "omega_c": (22.0, 60.0),
            "zeta_c": 0.75,
            "p_c": (20.0, 30.0),
            "learning": "magnitude",
            "learning_rate": 0.2,
            "error_range": 1e-4,
            "derivative_range": 1.0,
            "dead_zone": 2e-4,
            "leak": 5.0,
            "rate": 2.0,
            "bandwidth": 60.0,
            "knots": [-1, -1, -1, 0, 1, 1, 1],
            "order": 3,
            "weights": {"omega_c": [1.0, 2.0, 3.0, 4.0]},
            "common": False,
        },
        prepared,
    ),
    "BSplineNetwork in GPI": Case(
        lambda **a: gpi(gains=armgpi.BSplineNetwork(**a)),
        {
            "omega_c": (22.0, 60.0),
            "zeta_c": 0.75,
            "p_c": (20.0, 30.0),
            "error_range": 1e-4,
            "dead_zone": 2e-4,
        },
        controlled,
    ),
    "signed network": Case(
        lambda **a: armgpi.BSplineNetwork(learning="signed", **a),
        {"omega_c": 22.0, "learning_rate": 0.2, "error_range": 1e-4},
        prepared,
    ),
    "GPI": Case(
        armgpi.GPI,
        {
            "robot": ARM,
            "dt": DT,
            "gains": armgpi.FixedGains(20.0),
            "realisation": "bumpless",
            "feedforward": "model",
            "friction_feedforward": True,
            "rest_dead_zone": 1e-3,
            "rest_leak": 50.0,
            "start": "hold",
            "delay": 0.0,
            "integrators": 3,
            "rolloff": 2,
            "rolloff_ratio": 4.0,
            "second_ratio": 1.0,
            "second_zeta": 1.0,
            "link_factor": 0.4,
            "rotor_factor": 2.0,
            "force_limit": 20.0,
            "moment_limit": 4.0,
            "force_frame": TIP,
            "speed_limit": 0.3,
            "limit_friction": 0.2,
            "effort": 3.0,
            "bias_robot": ARM,
        },
        controlled,
    ),
    "WrenchEstimator": Case(
        armgpi.WrenchEstimator,
        {
            "robot": ARM,
            "dt": DT,
            "frame": TIP,
            "bandwidth": 30.0,
            "friction_within": 1.2,
            "uncertain_mass": 0.1,
        },
        lambda made: made.step(np.array(Q), np.array(V), made.init(np.array(Q))),
    ),
    "ForceLimited": Case(
        armgpi.ForceLimited,
        {
            "law": armgpi.PIDPositions(ARM, DT),
            "force_limit": 20.0,
            "moment_limit": 4.0,
            "force_frame": TIP,
            "speed_limit": 0.3,
            "limit_friction": 0.2,
            "uncertain_mass": 0.1,
            "delay": DT,
        },
        controlled,
    ),
    "CartesianImpedance": Case(
        armgpi.CartesianImpedance,
        {
            "robot": ARM,
            "dt": DT,
            "frame": TIP,
            "stiffness": [500.0, 500.0, 500.0, 30.0, 30.0, 30.0],
            "nullspace_stiffness": 10.0,
            "force_limit": 20.0,
            **IMPEDANCE,
        },
        controlled,
    ),
    "JointImpedance": Case(
        armgpi.JointImpedance,
        {"robot": ARM, "dt": DT, "stiffness": 100.0, "torque_limit": 5.0, **IMPEDANCE},
        controlled,
    ),
    "GPI with a payload": Case(
        armgpi.GPI,
        {"robot": ARM, "dt": DT, "payload": (0.0, 0.1), "frame": TIP, "com": [0.0, 0.0, 0.0]},
        controlled,
        slow=True,
    ),
    "PIDInversion": Case(
        armgpi.PIDInversion,
        {"robot": ARM, "dt": DT, "kp": 400.0, "ki": 500.0, "kd": 40.0, "effort": 3.0, "bias_robot": ARM},
        controlled,
    ),
    **{
        name: Case(
            getattr(armgpi, name),
            {"robot": ARM, "dt": DT, "effort": 3.0, "bias_robot": ARM, **own},
            controlled,
        )
        for name, own in {
            "PIDPositions": {"kp": 400.0, "ki": 500.0, "kd": 40.0, "velocity_bandwidth": 200.0},
            "ADRC": {"omega_c": 20.0, "omega_o": 100.0, "delay": 0.0, "order": 3, **SCHEDULED},
            "ComputedTorqueDOB": {"omega_c": 20.0, "omega_o": 100.0, "delay": 0.0, **SCHEDULED},
            "SuperTwisting": {
                **{"omega_c": 20.0, "omega_o": 100.0, "delay": 0.0},
                **{"slope": 100.0, "layer": 0.05},
            },
            "SlotineLi": {
                **{"omega_c": 20.0, "omega_o": 100.0, "delay": 0.0},
                **{"adaptation": 0.25, "leak": 1.0, "layer": 0.05},
            },
        }.items()
    },
    "GainSchedule": Case(
        lambda **a: gpi(gains=armgpi.GainSchedule(**a)),
        {
            "omega_c": (22.0, 60.0),
            "zeta_c": 0.75,
            "attack": 0.2,
            "leak": 5.0,
            "error_range": 1e-4,
            "dead_zone": 2e-4,
        },
        controlled,
    ),
    "default_move": Case(armgpi.default_move, {"robot": ARM}),
    "default_omega": Case(armgpi.default_omega, {"dt": DT, "delay": 0.0, "highest": 30.0}),
    "Member": Case(
        Member,
        {"integrators": 3, "rolloff": 1, "rolloff_ratio": 4.0, "second_ratio": 1.0, "second_zeta": 1.0},
    ),
    "LoadRange": Case(
        LoadRange,
        {"lightest": 0.0, "heaviest": 0.1, "frame": TIP, "com": (0.0, 0.0, 0.0)},
        lambda made: made.choose(ARM, DT, 0.0),
        slow=True,
    ),
    "payload_range": Case(
        armgpi.payload_range, {**LOADED, "lightest": 0.0, "heaviest": 0.1, "slowest": 15.0}, slow=True
    ),
    # Infinite where no load bounds it.
    "largest_payload": Case(armgpi.largest_payload, LOADED, promised=True, slow=True),
    # Plants
    "Reality": Case(
        armgpi.Reality,
        {name: each.default for name, each in parameters(armgpi.Reality).items()},
        lambda made: {name: value for name, value in made.values().items() if name != "name"},
    ),
    "RigidBodyPlant": Case(
        armgpi.RigidBodyPlant,
        {
            "robot": ARM,
            "loads": [armgpi.Step(0.1)],
            "friction": "urdf",
            "environment": [armgpi.ToolForce([0.1, 0.0, 0.0])],
            "substeps": 1,
            "stick_velocity": 1e-3,
            "metrics_frame": TIP,
        },
        moved,
    ),
    "ElasticPlant": Case(
        armgpi.ElasticPlant,
        {
            "robot": ARM.with_armature(0.1),
            "loads": [armgpi.Step(0.1)],
            "friction": "urdf",
            "environment": [armgpi.ToolForce([0.1, 0.0, 0.0])],
            "substeps": 1,
            "metrics_frame": TIP,
            "gear_stiffness": 1e3,
            "gear_damping": 1.0,
            "current_bandwidth": 500.0,
            "encoder_side": "motor",
            "link_viscous": 0.1,
            "link_coulomb": [0.1, 0.0, 0.2],
            "torque_ripple": 0.01,
            "cogging": 0.1,
            "stick_velocity": 1e-3,
            "ripple_period": 0.03,
        },
        moved,
    ),
    "MuJoCoPlant": Case(
        armgpi.MuJoCoPlant,
        {
            "robot": ARM,
            "loads": [armgpi.Step(0.1)],
            "friction": "urdf",
            "environment": [armgpi.ToolForce([0.1, 0.0, 0.0])],
            "metrics_frame": TIP,
            "substeps": 1,
            "integrator": "rk4",
            "stops": False,
            "contacts": False,
            "package_dirs": (),
        },
        moved,
    ),
    "Friction": Case(
        lambda **a: armgpi.RigidBodyPlant(ARM, friction=armgpi.Friction(**a)),
        {"viscous": 0.1, "coulomb": [0.1, 0.0, 0.2]},
        moved,
    ),
    "Saturated": Case(armgpi.Saturated, {"plant": PLANT, "effort": 3.0}, moved),
    "RateLimited": Case(armgpi.RateLimited, {"plant": PLANT, "rate": 30.0}, moved),
    "Delayed": Case(armgpi.Delayed, {"plant": PLANT, "samples": 2, "longest": 3}, moved),
    "Differentiated": Case(armgpi.Differentiated, {"plant": PLANT, "bandwidth": 200.0}, moved),
    "SensorFault": Case(
        armgpi.SensorFault,
        {"plant": PLANT, "onset": 0.1, "end": 0.2, "gain": 0.0, "offset": [0.1, 0.0, 0.0], "lost": 0.0},
        moved,
    ),
    "MotorFault": Case(armgpi.MotorFault, {"plant": PLANT, "onset": 0.1, "end": 0.2, "gain": -1.0}, moved),
    "DropOut": Case(armgpi.DropOut, {"plant": PLANT, "probability": 0.1, "seed": 0}, moved),
    "Encoder": Case(armgpi.Encoder, {"plant": PLANT, "bits": 16}, moved),
    "Noisy": Case(armgpi.Noisy, {"plant": PLANT, "std_q": 1e-3, "std_v": [0.1, 0.0, 0.1], "seed": 0}, moved),
    "SingleTurn": Case(armgpi.SingleTurn, {"plant": PLANT}, moved),
    "Unwrapped": Case(armgpi.Unwrapped, {"plant": PLANT}, moved),
    "Step": Case(armgpi.Step, {"amplitude": 0.1, "onset": 0.0, "end": 1.0}, pushed),
    "Ramp": Case(armgpi.Ramp, {"slope": 0.1, "onset": 0.0, "end": 1.0}, pushed),
    "Sine": Case(
        armgpi.Sine, {"amplitude": 0.1, "omega": 1.0, "phase": 0.1, "onset": 0.0, "end": 1.0}, pushed
    ),
    "Pulse": Case(armgpi.Pulse, {"amplitude": 0.1, "onset": 0.0, "duration": 1.0}, pushed),
    "ToolForce": Case(
        armgpi.ToolForce,
        {
            "force": [1.0, 0.0, 0.0],
            "moment": [0.0, 0.1, 0.0],
            "onset": 0.0,
            "end": 1.0,
            "frame": TIP,
            "point": [0.0, 0.0, 0.1],
        },
        touched,
    ),
    "Wall": Case(
        armgpi.Wall,
        {
            "normal": [0.0, 0.0, 1.0],
            "distance": -9.0,
            "stiffness": 1e3,
            "damping": 1.0,
            "friction": 0.1,
            "frame": TIP,
            "point": [0.0, 0.0, 0.1],
        },
        touched,
    ),
    "Spring": Case(
        armgpi.Spring,
        {
            "anchor": [0.1, 0.0, 0.0],
            "stiffness": 1e2,
            "damping": 1.0,
            "frame": TIP,
            "point": [0.0, 0.0, 0.1],
        },
        touched,
    ),
    "Step.torque": Case(armgpi.Step(0.1).torque, {"t": 0.1}),
    "Ramp.torque": Case(armgpi.Ramp(0.1).torque, {"t": 0.1}),
    "Sine.torque": Case(armgpi.Sine(0.1, 1.0).torque, {"t": 0.1}),
    "Pulse.torque": Case(armgpi.Pulse(0.1, 0.0, 1.0).torque, {"t": 0.1}),
    "multi_sine": Case(
        multi_sine,
        {"amplitudes": [0.1], "omegas": [1.0], "phases": [0.0], "onset": 0.0},
        lambda made: [pushed(load) for load in made],
    ),
    # Robots
    "Robot.load": Case(
        Robot.load,
        {"path_or_name": "anthropomorphic3", "lock": (), "keep": None, "mimic": "lock", "repair": ()},
        dynamics,
        slow=True,
    ),
    "Robot.from_xml": Case(
        Robot.from_xml,
        {"text": Path(robots.locate("anthropomorphic3")[0]).read_text(), "lock": {"q1": 0.0}, "keep": ["q2"]},
        lambda made: made.middle(),
        slow=True,
    ),
    "Robot.from_mjcf": Case(
        Robot.from_mjcf,
        {"path": "no such file.xml", "lock": {"q1": 0.0}, "keep": None},
        lambda made: made.middle(),
    ),
    "Robot.from_pinocchio": Case(
        Robot.from_pinocchio,
        {"model": ARM.pinocchio_model(), "lock": {"q1": 0.0}, "keep": None},
        lambda made: made.middle(),
        slow=True,
    ),
    "Robot.with_payload": Case(
        ARM.with_payload, {"frame": TIP, "mass": 0.1, "com": [0.0, 0.0, 0.0], "inertia": TENSOR}, dynamics
    ),
    "Robot.with_bodies": Case(ARM.with_bodies, {"parameters": BODIES}, dynamics),
    "Robot.varied": Case(
        ARM.varied,
        {
            "payload": [0.1, 0.2],
            "com": [0.0, 0.0, 0.1],
            "frame": TIP,
            "inertia_scale": [0.9, 1.1],
            "rotor_inertia": 0.1,
            "viscous": 0.1,
            "coulomb": [0.1, 0.2],
            "effort": 3.0,
            "gravity": [0.0, 0.0, -9.81],
        },
        lambda made: made.mass_matrix(np.array([Q, GOAL])),
    ),
    "Robot.with_friction": Case(ARM.with_friction, {"viscous": 0.1, "coulomb": 0.2}),
    "Robot.with_drives": Case(ARM.with_drives, {"drives": {ARM.joint_names[0]: {"stiffness": 1e4}}}),
    "Robot.with_armature": Case(ARM.with_armature, {"armature": 0.1}, dynamics),
    "Robot.scaled_inertia": Case(ARM.scaled_inertia, {"factor": 0.8}, dynamics),
    "Robot.with_gravity": Case(ARM.with_gravity, {"gravity": [0.0, 0.0, -9.81]}, dynamics),
    "Robot.with_limits": Case(ARM.with_limits, BOUND, dynamics),
    "Robot.mass_matrix": Case(ARM.mass_matrix, {"q": Q}),
    "Robot.gravity": Case(ARM.gravity, {"q": Q}),
    "Robot.nonlinear_effects": Case(ARM.nonlinear_effects, {"q": Q, "v": V}),
    "Robot.forward_dynamics": Case(ARM.forward_dynamics, {"q": Q, "v": V, "tau": V}),
    "Robot.inverse_dynamics": Case(ARM.inverse_dynamics, {"q": Q, "v": V, "a": V}),
    "Robot.inertia_times": Case(ARM.inertia_times, {"q": Q, "a": V}),
    "Robot.inertia_solve": Case(ARM.inertia_solve, {"q": Q, "tau": V}),
    "Robot.check_position": Case(ARM.check_position, {"q": Q, "what": "the start"}),
    "Robot.check_holding": Case(ARM.check_holding, {"q": Q, "what": "the start"}),
    "Robot.holding_share": Case(ARM.holding_share, {"q": Q}),
    "Robot.overloaded": Case(ARM.overloaded, {"q": Q}),
    "Robot.wrap": Case(ARM.wrap, {"q": Q, "near": Q}),
    "Robot.frame_pose": Case(ARM.frame_pose, {"name": TIP, "q": Q}),
    "Robot.frame_jacobian": Case(ARM.frame_jacobian, {"name": TIP, "q": Q}),
    "Robot.frame_drift": Case(ARM.frame_drift, {"name": TIP, "q": Q, "v": V}),
    "Robot.links_moved_by": Case(ARM.links_moved_by, {"joint": "q1"}),
    "Robot.random_positions": Case(ARM.random_positions, {"count": 2, "seed": 0}),
    "RobotBatch": Case(armgpi.RobotBatch, {"robots": [ARM, ARM.scaled_inertia(0.8)]}, dynamics),
    "RobotBatch.mass_matrix": Case(armgpi.RobotBatch([ARM, ARM]).mass_matrix, {"q": [Q, GOAL]}),
    "robots.locate": Case(robots.locate, {"path_or_name": "anthropomorphic3"}),
    # Infinite: a quantity that does not bound.
    "health.inspect": Case(
        health.inspect,
        {
            "path_or_name": "anthropomorphic3",
            "lock": (),
            "keep": None,
            "mimic": "lock",
            "effort": 3.0,
            "package_dirs": (),
            "dt": DT,
            "delay": 0,
            "encoder_bits": 16,
            "repair": (),
            "encoder_side": "motor",
        },
        lambda report: report.as_dict(),
        slow=True,
    ),
    "health.with_payload": Case(
        health.with_payload,
        {"report": health.inspect("anthropomorphic3"), "mass": 0.1},
        lambda report: report.as_dict(),
        slow=True,
    ),
    # Kinematics
    "inverse_kinematics": Case(
        armgpi.inverse_kinematics,
        {"robot": ARM, "frame": TIP, "position": POINT, **TASK, "tolerance": 1e-9, "iterations": 60},
        slow=True,
    ),
    "TrackingInverse": Case(
        armgpi.TrackingInverse,
        {"robot": ARM, "frame": TIP, **TASK, "rate": 1.0},
        lambda made: made([POINT]),
        slow=True,
    ),
    "TrackingInverse()": Case(INVERSE, {"points": [POINT]}, slow=True),
    # Runs; a rollout that diverges is NaN from then on.
    "ClosedLoop": Case(
        armgpi.ClosedLoop,
        {"plant": PLANT, "controller": gpi(), "reference": armgpi.Bezier(**MOVE)},
        looped,
    ),
    "ClosedLoop.init": Case(armgpi.ClosedLoop(PLANT, gpi(), armgpi.Bezier(**MOVE)).init, {"q0": Q, "v0": V}),
    "simulate": Case(
        armgpi.simulate,
        {
            "plant": PLANT,
            "controller": gpi(),
            "reference": armgpi.Bezier(**MOVE),
            "t_final": 0.003,
            "q0": Q,
            "v0": V,
            "record_every": 1,
            "signals": False,
            "divergence": 10.0,
            "progress": False,
            "backend": "numpy",
        },
        lambda made: metrics.summary(made),
        promised=True,
        slow=True,
    ),
    "prepare": Case(
        armgpi.prepare,
        {
            "plant": PLANT,
            "controller": gpi(),
            "reference": armgpi.Bezier(**MOVE),
            "t_final": 0.003,
            "record": "all",
            "record_every": 1,
            "signals": False,
            "divergence": 10.0,
            "backend": "numpy",
        },
        lambda made: metrics.summary(made.run()),
        slow=True,
    ),
    "PreparedLoop": Case(
        armgpi.prepare(PLANT, gpi(), armgpi.Bezier(**MOVE), 0.003, backend="numpy").run,
        {
            "values": {"plant.payload.mass": [0.1, 0.2]},
            "seed": 3,
            "q0": Q,
            "v0": V,
            "final": False,
            "progress": False,
        },
        lambda made: metrics.summary(made),
        promised=True,
        slow=True,
    ),
    "compare": Case(
        armgpi.compare,
        {
            "plant": PLANT,
            "controllers": {"one": gpi()},
            "reference": armgpi.Bezier(**MOVE),
            "t_final": 0.003,
            "backend": "numpy",
        },
        lambda made: metrics.summary(made.rollouts["one"]),
        promised=True,
        slow=True,
    ),
    "report": Case(
        armgpi.report,
        {"rollouts": rollout(), "path": NOWHERE, "title": "an arm", "robot": ARM},
        slow=True,
    ),
    "view": Case(armgpi.view, {"shown": ARM, "path": NOWHERE, "frame": None}, slow=True),
    "save": Case(armgpi.save, {"rollout": rollout(), "path": NOWHERE}),
    "load": Case(armgpi.load, {"path": NOWHERE}),
    "Weights": Case(
        lambda **a: gpi(
            gains=armgpi.BSplineNetwork(zeta_c=(0.6, 1.0), p_c=(20.0, 30.0), weights=armgpi.Weights(**a))
        ),
        {"omega_c": [[1.0, 2.0, 3.0, 4.0]] * 3, "zeta_c": [0.0, 0.1, 0.2, 0.3], "p_c": [1.0, 2.0, 3.0, 4.0]},
        controlled,
    ),
    "save_weights": Case(
        armgpi.save_weights,
        {"weights": armgpi.Weights(omega_c=[1.0, 2.0]), "path": NOWHERE, "robot": ARM},
    ),
    "load_weights": Case(armgpi.load_weights, {"path": NOWHERE, "robot": ARM}),
    "tool_wrench": Case(
        armgpi.tool_wrench,
        {
            "rollout": rollout(),
            "robot": ARM,
            "frame": TIP,
            "bandwidth": 30.0,
            "friction_within": 1.2,
            "uncertain_mass": 0.1,
        },
    ),
    "learned_weights": Case(armgpi.learned_weights, {"rollout": rollout()}),
    "metrics.summary": Case(metrics.summary, {"rollout": rollout()}, slow=True),
    **{f"metrics.{name}": Case(getattr(metrics, name), {"rollout": rollout()}) for name in metrics.ALL},
    # Models of the user's, and export
    "derive": Case(armgpi.derive, {"robot": ARM.name, "numbers": False, "frame": TIP}, slow=True),
    "validate": Case(
        armgpi.validate,
        {
            "model": "paper",
            "robot": ARM,
            "frame": TIP,
            "rtol": 1e-9,
            "joints": None,
            "time_limit": 5.0,
            "seed": 0,
            "passive": (),
        },
        slow=True,
    ),
    "suggest_urdf": Case(
        armgpi.suggest_urdf, {"model": "paper", "robot": ARM, "joints": None, "time_limit": 2.0}, slow=True
    ),
    "identify": Case(
        armgpi.identify,
        {"logs": "/nonexistent/log.csv", "robot": ARM, "gravity": True, "check_first": True},
        slow=True,
    ),
    "certify": Case(
        armgpi.certify,
        {"robot": ARM, "dt": DT, "speed": 0.2, "prove": False, "budget": 1.0},
        lambda found: found.error[np.isfinite(found.error)],
        slow=True,
    ),
    "assume_drives": Case(
        armgpi.assume_drives, {"robot": ARM, "drives": "elastic"}, lambda found: found.armature
    ),
    "bound_path": Case(
        armgpi.bound_path,
        {
            **{
                "controller": gpi(),
                "reference": armgpi.Bezier(Q, GOAL, duration=1.0, t_start=0.1),
                "t_final": 1.2,
            },
            **{"arms": None, "torque": 0.1, "force": 0.0, "friction": False, "bits": 16, "delay": 0},
            **{"start": "held", "seed": 0},
        },
        lambda found: found.error[np.isfinite(found.error)],
        slow=True,
    ),
    "export_controller": Case(
        armgpi.export_controller,
        {
            "controller": gpi(),
            "folder": "/nonexistent/folder",
            "log": None,
            "real": "double",
            "supervisor": None,
            "name": None,
            "measure": False,
        },
        slow=True,
    ),
    "Supervisor": Case(
        lambda **a: armgpi.Supervised(gpi(), armgpi.Supervisor(**a)),
        {
            "on_fault": "hold",
            "deceleration": 10.0,
            "stop_velocity": 1.0,
            "torque_rate": 1000.0,
            "jump": 2.0,
            "reference_jump": 2.0,
            "reference_step": 0.01,
            "response": 0.012,
            "frozen_samples": 50,
            "resolution": 1e-4,
            "position_margin": 0.1,
            "following": 0.5,
            "saturated": 0.5,
            "workspace": ([-9.0, -9.0, -9.0], [9.0, 9.0, 9.0]),
            "tool_speed": 1.0,
            "tool_force": 20.0,
            "friction_within": 1.2,
            "uncertain_mass": 0.5,
            "tool_frame": "tool",
            "missed": 20,
        },
    ),
    "Supervised": Case(armgpi.Supervised, {"law": gpi(), "supervisor": None}),
    "record": Case(
        record,
        {
            "plant": PLANT,
            "controller": gpi(),
            "reference": armgpi.Bezier(**MOVE),
            "t_final": 0.003,
            "backend": "numpy",
        },
        slow=True,
    ),
    "ExportedController": Case(
        armgpi.ExportedController, {"robot": ARM, "folder": "/nonexistent/folder", "name": None}
    ),
}

#: Public names that take nothing, or that do nothing with what they are given.
PLAIN = {
    *("ArmgpiError", "ArmgpiWarning", "Status", "__version__", "DynamicsReport", "Derivation"),
    *("Certificate", "ControlStep", "FullState", "Measurement", "Target", "Tuning"),
    *(
        "Scenario",
        "ImpedanceLimits",
        "ForceBound",
        "ToolWrench",
        "InverseSolution",
        "LargestPayload",
        "PathBound",
        "PayloadRange",
        "Comparison",
    ),
    *("Contact", "Controller", "Gains", "Load", "Plant", "Reference", "Wrapper"),
}
#: What starts a process for every call.
PROCESS = {"validate", "suggest_urdf"}
#: Cases that make an object of a class on the way.
DECLARED: dict[str, Any] = {
    "FixedGains in GPI": armgpi.FixedGains,
    "FixedGains in the printed law": armgpi.FixedGains,
    "BSplineNetwork in GPI": armgpi.BSplineNetwork,
    "signed network": armgpi.BSplineNetwork,
    "GainSchedule": armgpi.GainSchedule,
}
#: Arguments that are left as they are: any value is a model, which is read in a process of its own, and any
#: time makes as long a log.
SPARED = {("validate", "model"), ("suggest_urdf", "model"), ("record", "t_final")}


def outcome(case: Case, arguments: Mapping[str, Any]) -> str:
    """Return what is wrong with the end of a call; nothing when all is well."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", ArmgpiWarning)
            result = case.use(case.call(**arguments))
    except ArmgpiError:
        return ""
    except Exception as error:
        place = error.__traceback__
        while place is not None and place.tb_next is not None:
            place = place.tb_next
        where = f"{Path(place.tb_frame.f_code.co_filename).name}:{place.tb_lineno}" if place else ""
        return f"{type(error).__name__}: {str(error)[:120]} ({where})"
    if case.promised or all(np.isfinite(x).all() for x in numbers(result)):
        return ""
    return "not finite"


def replaced(name: str, share: int = 1) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield a case's arguments with each replaced in turn, by one in so many of what is hostile."""
    case = CASES[name]
    for place, key in enumerate(case.good):
        for i, (what, value) in enumerate(HOSTILE.items()):
            if i % share == place % share and (name, key) not in SPARED:
                yield f"{key} = {what}", {**case.good, key: value}


def wrong_ends(name: str, share: int = 1) -> list[str]:
    """Return how the calls of a case go wrong."""
    ends = ((what, outcome(CASES[name], arguments)) for what, arguments in replaced(name, share))
    return [f"{what}: {end}" for what, end in ends if end]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let files be written where it does not matter."""
    monkeypatch.chdir(tmp_path)


# --- The law -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CASES)
def test_what_is_good_ends_well(name: str) -> None:
    assert outcome(CASES[name], CASES[name].good) == ""


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if not case.slow])
def test_a_bad_argument_ends_in_an_error_of_ours(name: str) -> None:
    assert not wrong_ends(name)


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.slow and name not in PROCESS])
def test_some_bad_arguments_of_what_takes_longer_end_in_an_error_of_ours(name: str) -> None:
    assert not wrong_ends(name, share=18)


@pytest.mark.search
@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.slow])
def test_every_bad_argument_of_what_takes_longer_ends_in_an_error_of_ours(name: str) -> None:
    assert not wrong_ends(name, share=4 if name in PROCESS else 1)


#: Numbers of every size, the largest and smallest ones as often as others.
SIZES = st.builds(lambda sign, power: sign * 10.0**power, st.sampled_from((1.0, -1.0)), st.floats(-323, 308))
NUMBERS = st.one_of(SIZES, st.floats(), st.integers(), st.sampled_from([0.0, -0.0, 5e-324, 1.7e308]))
ANYTHING = st.one_of(
    NUMBERS,
    st.sampled_from(list(HOSTILE.values())),
    st.lists(NUMBERS, max_size=4),
    st.lists(SIZES, min_size=3, max_size=3).map(np.array),
    st.tuples(SIZES, SIZES),
    npst.arrays(
        st.sampled_from([np.float64, np.float32, ">f8", np.int64, np.bool_, np.complex128]),
        npst.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=3),
    ),
    st.text(max_size=5),
    st.binary(max_size=5),
)


def inside(declared: Parameter) -> st.SearchStrategy[Any]:
    """Values as a parameter is declared."""
    if declared.kind == "choice":
        return st.sampled_from(declared.choices)
    if declared.kind == "integer":
        return st.integers(int(declared.least), int(min(declared.most, 20)))
    if declared.kind == "vector":
        return st.lists(SIZES.filter(lambda x: abs(x) <= LARGEST), min_size=3, max_size=3)
    if declared.kind not in ("number", "box"):
        return st.nothing()
    number = SIZES.filter(lambda x: abs(x) <= LARGEST and bool(declared.inside(np.array(x))))
    if declared.kind == "box":
        return st.one_of(number, st.tuples(number, number).map(lambda ends: (min(ends), max(ends))))
    return st.one_of(number, st.lists(number, min_size=3, max_size=3)) if declared.per_joint else number


@st.composite
def calls(draw: st.DrawFn) -> tuple[str, dict[str, Any]]:
    """A case with up to three of its arguments replaced, as declared or by anything."""
    name = draw(st.sampled_from([name for name, case in CASES.items() if not case.slow]))
    case = CASES[name]
    declared = (
        parameters(DECLARED.get(name, case.call)) if isinstance(case.call, type) or name in DECLARED else {}
    )
    keys = draw(st.lists(st.sampled_from(list(case.good)), min_size=1, max_size=3, unique=True))
    replaced: dict[str, Any] = {}
    for key in keys:
        good = inside(declared[key]) if key in declared else st.nothing()
        replaced[key] = draw(st.one_of(good, ANYTHING))
    return name, replaced


def law(call: tuple[str, dict[str, Any]]) -> None:
    """Assert how a call with some arguments replaced ends."""
    name, arguments = call
    assert outcome(CASES[name], {**CASES[name].good, **arguments}) == ""


@given(calls())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_arguments_end_in_an_error_of_ours_or_well(call: tuple[str, dict[str, Any]]) -> None:
    law(call)


@pytest.mark.search
@given(calls())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=20_000)
def test_many_arguments_end_in_an_error_of_ours_or_well(call: tuple[str, dict[str, Any]]) -> None:
    law(call)


# --- The whole surface ---------------------------------------------------------------------------


def test_every_public_name_has_a_case() -> None:
    public: Any = dir(armgpi)
    modules = {name for name in public if inspect.ismodule(getattr(armgpi, name))}
    assert set(public) - modules - PLAIN <= {name.partition(".")[0] for name in CASES}
    assert set(public) >= PLAIN


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if isinstance(case.call, type)])
def test_every_parameter_of_a_class_is_replaced(name: str) -> None:
    kind: Any = CASES[name].call
    given = set().union(*(case.good for case in CASES.values() if case.call is kind))
    assert set(inspect.signature(kind).parameters) <= given


def test_every_method_of_a_robot_has_a_case() -> None:
    methods = {name for name, _ in inspect.getmembers(Robot, callable) if not name.startswith("_")}
    assert methods - {"outside", "encoder_count", "middle", "pinocchio_model"} <= {
        name.removeprefix("Robot.") for name in CASES
    }


# --- What was found ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "named"),
    {
        "gains that vanish": (lambda: gpi(gains=armgpi.FixedGains(omega_c=1e-100)), "omega_c"),
        "no list of points": (lambda: armgpi.Waypoints(0.0), "points"),
        "a limit beyond floats": (lambda: armgpi.Bezier(Q, GOAL, velocity_limit=10**400), "velocity_limit"),
        "no time": (lambda: armgpi.Bezier(**MOVE).at(None), "t"),
        "a move in no time": (lambda: armgpi.Bezier(Q, GOAL, duration=1e-300).at(0.1), "duration"),
        "an error that is none": (
            lambda: controlled(gpi(gains=armgpi.BSplineNetwork(error_range=1e-320))),
            "error_range",
        ),
        "positions beyond products": (
            lambda: armgpi.Bezier([0.0, 0.0, 1e304], [0.0, 0.0, -1e304], 1e-3).at(5e-4),
            "start",
        ),
        "no cap": (lambda: armgpi.default_omega(DT, highest="30"), "highest"),
        "no end of substeps": (lambda: armgpi.RigidBodyPlant(ARM, substeps=2**62), "substeps"),
        "poles too far apart": (lambda: gpi(rolloff=2, rolloff_ratio=1e20), "gains"),
        "a robot by its name": (lambda: armgpi.RigidBodyPlant("ur5"), "robot"),
        "no rollout": (lambda: armgpi.save(None, "rollout.nc"), "rollout"),
        "no path": (lambda: armgpi.load(3), "path"),
    }.values(),
)
def test_what_once_was_another_error_or_nan_is_named(call: Callable[[], Any], named: str) -> None:
    with pytest.raises(ArmgpiError) as caught:
        call()
    assert caught.value.name == named  # type: ignore[attr-defined]


def test_what_cannot_say_what_it_is_is_refused_by_its_type() -> None:
    with pytest.raises(ArmgpiError, match="got a Nameless"):
        armgpi.Hold(Nameless())
    with pytest.raises(ArmgpiError, match="got a int"):
        armgpi.default_omega(10**5000)


def test_a_number_of_no_sensible_size_is_told_which_sizes_are() -> None:
    with pytest.raises(
        ArmgpiError, match=r"omega_c: expected positive .* from 1e-30 to 1e\+30 in size, got 1e-31"
    ):
        gpi(gains=armgpi.FixedGains(1e-31))
    with pytest.raises(ArmgpiError, match=r"duration must be .* from 1e-30 to 1e\+30 in size, got 1e\+31"):
        armgpi.Bezier(Q, GOAL, duration=1e31)
