"""What to write in place of a name or keyword that does not exist, or is that of another library."""

from __future__ import annotations

import functools
import inspect
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from typing import ParamSpec, TypeVar

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")

#: Names of Pinocchio, Pink and roboticstoolbox -> what a module `armgpi` has in their place.
MODULE: Mapping[str, str] = {
    "buildModelFromUrdf": "armgpi.Robot.load(path)",
    "RobotWrapper": "armgpi.Robot.from_pinocchio(wrapper)",
    "Model": "armgpi.Robot.from_pinocchio(model)",
    "rnea": "robot.inverse_dynamics(q, v, a)",
    "crba": "robot.mass_matrix(q)",
    "aba": "robot.forward_dynamics(q, v, tau)",
    "Configuration": "armgpi.Robot and armgpi.inverse_kinematics(robot, ...)",
    "FrameTask": "armgpi.CartesianReference(...)",
    "solve_ik": "armgpi.inverse_kinematics(robot, ...)",
    "load_robot_description": "armgpi.Robot.load(name)",
    "ERobot": "armgpi.Robot.load(path)",
    "DHRobot": "armgpi.Robot.load(path)",
    "URDF": "armgpi.Robot.load(path)",
    "jtraj": "armgpi.Bezier(start, goal, duration)",
    "ctraj": "armgpi.CartesianReference(...)",
    "forward_kinematics": "robot.frame_pose(name, q)",
    "forwardKinematics": "robot.frame_pose(name, q)",
    "computeAllTerms": "robot.mass_matrix(q), robot.nonlinear_effects(q, v)",
    "integrate": "armgpi.simulate(plant, controller, reference)",
    "build_ik": "armgpi.inverse_kinematics(robot, ...)",
    "run": "armgpi.simulate(plant, controller, reference)",
    "plot": "armgpi.plots.overview(rollout)",
    "PID": "armgpi.PIDPositions (positions only) or armgpi.PIDInversion (positions and velocities)",
    "PD": "armgpi.PIDPositions(robot, dt, ki=0.0), or a Controller of your own (docs/contributing.md)",
    "ComputedTorque": "armgpi.PIDInversion, or armgpi.ComputedTorqueDOB (positions only)",
    "InverseDynamicsController": "armgpi.PIDInversion, or armgpi.ComputedTorqueDOB (positions only)",
    "ImpedanceController": "armgpi.CartesianImpedance or armgpi.JointImpedance",
    "OperationalSpaceController": "armgpi.CartesianImpedance(robot, dt, stiffness=...)",
    "Trajectory": "armgpi.Bezier, armgpi.Waypoints, armgpi.Recorded or armgpi.CartesianReference",
    "Simulator": "armgpi.simulate(plant, controller, reference)",
    "Simulation": "armgpi.simulate(plant, controller, reference)",
    "load_urdf": "armgpi.Robot.load(path)",
    "load_robot": "armgpi.Robot.load(path_or_name)",
    "from_urdf": "armgpi.Robot.load(path)",
    "fkine": "robot.frame_pose(name, q)",
    "ikine_LM": "armgpi.inverse_kinematics(robot, ...)",
    "step": "armgpi.ClosedLoop(plant, controller, reference).step(state)",
}
#: The same of a robot.
ROBOT: Mapping[str, str] = {
    "rnea": "inverse_dynamics(q, v, a)",
    "rne": "inverse_dynamics(q, v, a)",
    "crba": "mass_matrix(q)",
    "inertia": "mass_matrix(q)",
    "aba": "forward_dynamics(q, v, tau)",
    "accel": "forward_dynamics(q, v, tau)",
    "nle": "nonlinear_effects(q, v)",
    "coriolis": "nonlinear_effects(q, v) - gravity(q)",
    "gravload": "gravity(q)",
    "nq": "n",
    "nv": "n",
    "model": "pinocchio_model()",
    "fkine": "frame_pose(name, q)",
    "framePlacement": "frame_pose(name, q)",
    "jacob0": "frame_jacobian(name, q)",
    "computeFrameJacobian": "frame_jacobian(name, q)",
    "ikine_LM": "armgpi.inverse_kinematics(robot, ...)",
    "ikine": "armgpi.inverse_kinematics(robot, ...)",
    "ik": "armgpi.inverse_kinematics(robot, ...)",
    "ik_LM": "armgpi.inverse_kinematics(robot, ...)",
    "plot": "armgpi.view(robot)",
    "njoints": "n",
    "forward_kinematics": "frame_pose(name, q)",
    "forwardKinematics": "frame_pose(name, q)",
    "jacobe": "frame_jacobian(name, q)",
    "jacobian": "frame_jacobian(name, q)",
    "computeJointJacobian": "frame_jacobian(name, q)",
    "computeGeneralizedGravity": "gravity(q)",
    "neutral": "middle()",
    "q0": "middle()",
    "qlim": "limits",
    "effortLimit": "limits.effort",
    "velocityLimit": "limits.velocity",
    "rotorInertia": "armature",
    "dof": "n",
    "ndof": "n",
    "joints": "joint_names",
    "links": "frame_names, or pinocchio_model() for the bodies",
    "fk": "frame_pose(name, q)",
    "fdyn": "forward_dynamics(q, v, tau)",
    "idyn": "inverse_dynamics(q, v, a)",
    "mass": "total_mass",
    "M": "mass_matrix(q)",
    "D": "mass_matrix(q)",
    "inertia_matrix": "mass_matrix(q)",
    "C": "nonlinear_effects(q, v) - gravity(q), which is C(q, v) v",
    "G": "gravity(q)",
    "q": "middle(); a robot has no state, a rollout has q",
    "qd": "no state of a robot; a rollout has v",
    "ee": "tip",
    "end_effector": "tip",
    "tcp": "tip",
    "frames": "frame_names",
    "effort": "limits.effort",
    "effort_limits": "limits.effort",
    "lower": "limits.lower",
    "upper": "limits.upper",
    "payload": "with_payload(frame, mass)",
}


#: The same of a controller.
CONTROLLER: Mapping[str, str] = {
    "omega": "gains",
    "omega_c": "gains.omega_c",
    "bandwidth": "gains",
    **dict.fromkeys(("kp", "ki", "kd"), "gains; PIDPositions and PIDInversion have kp, ki and kd"),
    "gain": "gains",
    "beta": "armgpi.gpi.gains.betas(controller.gains.nominal()), of the error polynomial (eqs. 20, 21, 25)",
    "compute": "init(measurement, target), then step(measurement, target, state)",
    "update": "init(measurement, target), then step(measurement, target, state)",
    "control": "init(measurement, target), then step(measurement, target, state)",
    "compute_torque": "init(measurement, target), then step(measurement, target, state)",
    "CalcOutput": "init(measurement, target), then step(measurement, target, state)",
    "reset": "init(measurement, target), which returns a new state",
    "Ts": "dt",
    "period": "dt",
    "model": "robot, the nominal model",
    "effortLimit": "effort",
    "stability_margins": "margins()",
}


#: Names of metrics elsewhere -> those here.
METRICS: Mapping[str, str] = {
    "rmse": "armgpi.metrics.rms(rollout)",
    "mae": "armgpi.metrics.iae(rollout), divided by the time",
    "max_error": "armgpi.metrics.peak_error(rollout)",
    "steady_state_error": "armgpi.metrics.final_error(rollout)",
    "variation": "armgpi.metrics.total_variation(rollout)",
    "effort": "armgpi.metrics.isci(rollout) or armgpi.metrics.peak_torque(rollout)",
    "saturation": "armgpi.metrics.saturated_time(rollout)",
    "all": "armgpi.metrics.summary(rollout)",
}


#: Names of figures elsewhere -> those here.
PLOTS: Mapping[str, str] = {
    "plot": "armgpi.plots.overview(rollout)",
    "show": "armgpi.plots.overview(rollout), and matplotlib.pyplot.show()",
    "joints": "armgpi.plots.positions(rollout)",
    "joint_positions": "armgpi.plots.positions(rollout)",
    "joint_torques": "armgpi.plots.torques(rollout)",
    "animate": "armgpi.view(rollout)",
}


#: Names of other libraries, and of what is no variable -> what a rollout has in their place.
ROLLOUT: Mapping[str, str] = {
    "t": 'rollout["time"]',
    "times": 'rollout["time"]',
    "joints": 'rollout["joint"]',
    "joint_names": 'rollout["joint"].values',
    "n": 'rollout.sizes["joint"]',
    "positions": "q, the true positions, or q_measured",
    "configurations": "q",
    "qs": "q",
    "qpos": "q",
    "qvel": "v",
    "ctrl": "tau_command",
    "q_meas": "q_measured",
    "dq": "v",
    "qd": "v",
    "qdot": "v",
    "vs": "v",
    "velocities": "v",
    "qdd": 'v.differentiate("time")',
    "ddq": 'v.differentiate("time")',
    "a": 'v.differentiate("time")',
    "u": "tau",
    "torque": "tau, or tau_command before the effort limits",
    "torques": "tau, or tau_command before the effort limits",
    "tau_cmd": "tau_command",
    "e": "q - rollout.q_ref",
    "error": "q - rollout.q_ref",
    "errors": "q - rollout.q_ref",
    "reference": "q_ref and v_ref",
    "q_des": "q_ref",
    "qd_des": "v_ref",
    "q_star": "q_ref",
    "ee": "tool, and tool_ref",
    "ee_pos": "tool, and tool_ref",
    "tcp": "tool, and tool_ref",
    "itae": "armgpi.metrics.itae(rollout)",
    "iae": "armgpi.metrics.iae(rollout)",
    "ise": "armgpi.metrics.ise(rollout)",
    "rms": "armgpi.metrics.rms(rollout)",
    "rmse": "armgpi.metrics.rms(rollout)",
    "peak_error": "armgpi.metrics.peak_error(rollout)",
    "final_error": "armgpi.metrics.final_error(rollout)",
    "isci": "armgpi.metrics.isci(rollout)",
    "total_variation": "armgpi.metrics.total_variation(rollout)",
    "peak_torque": "armgpi.metrics.peak_torque(rollout)",
    "metrics": "armgpi.metrics.summary(rollout)",
    "summary": "armgpi.metrics.summary(rollout)",
    "success": "status, which is 0 (armgpi.Status.FINISHED) where it finished",
    "finished": "status, which is 0 (armgpi.Status.FINISHED) where it finished",
    "animate": "armgpi.view(rollout)",
    "display": "armgpi.view(rollout)",
    "report": 'armgpi.report(rollout, "report.html")',
    "save": 'armgpi.save(rollout, "rollout.nc")',
    "effortLimit": "effort",
    "velocityLimit": "velocity",
}


#: Keywords that users of other libraries type -> the keywords here that may mean the same.
KEYWORDS: Mapping[str, tuple[str, ...]] = {
    "bandwidth": ("gains", "omega_c"),
    "omega": ("omega_c", "gains"),
    "omega_c": ("gains",),
    "Ts": ("dt",),
    "period": ("dt",),
    "sample_time": ("dt",),
    "T": ("t_final", "duration"),
    "tf": ("t_final",),
    "tmax": ("t_final",),
    "t_end": ("t_final",),
    "duration": ("t_final",),
    "q0": ("start", "q"),
    "qf": ("goal",),
    "q1": ("goal",),
    "model": ("robot",),
    "urdf": ("path_or_name", "robot"),
    "kg": ("mass",),
    "resolution": ("bits",),
    "torque_limit": ("effort",),
}


class MissingAttribute(AttributeError):
    """An attribute that does not exist; its hint is looked for where the error is shown."""

    def __init__(self, owner: object, name: str, known: Mapping[str, str]) -> None:
        """Take what has no such attribute, the name, and names of other libraries -> what to write."""
        # With an object of its own, Python would add a second hint to this one.
        super().__init__(f"{type(owner).__name__!r} object has no attribute {name!r}", name=name, obj=None)
        self._missing, self._kind, self._known = name, type(owner), known

    def __reduce__(self) -> tuple[type[AttributeError], tuple[str]]:
        """Copy and pickle it as its message, such as from another process; its owner stays there."""
        return AttributeError, (str(self),)

    def __str__(self) -> str:
        """Return the message with its hint."""
        every = {*dir(self._kind), *getattr(self._kind, "__dataclass_fields__", ())}
        names = sorted(name for name in every if not name.startswith("_"))
        return missing(f"{self._kind.__name__!r} object", self._missing, self._known, names)


def missing(
    owner: str, name: str, known: Mapping[str, str], names: list[str], what: str = "attribute"
) -> str:
    """Return the message of an attribute, or of something else with a name, that does not exist.

    Args:
        owner: what has no such attribute, as Python says it.
        name: of the attribute.
        known: names of other libraries -> what to write.
        names: attributes that exist.
        what: the word for it.
    """
    text = f"{owner} has no {what} {name!r}"
    if name in known:
        return f"{text}; use {known[name]}"
    near = get_close_matches(name, names, n=1)
    return f"{text}; did you mean {near[0]!r}?" if near else text


def unexpected(function: str, name: str, keywords: Sequence[str]) -> str:
    """Return the message of a keyword that a function does not have, with the nearest one.

    Args:
        function: its name.
        name: of the keyword.
        keywords: those that it has.
    """
    near = [each for each in KEYWORDS.get(name, ()) if each in keywords]
    near += get_close_matches(name, keywords, n=1)
    end = f"did you mean {near[0]!r}?" if near else f"it has {', '.join(keywords)}"
    return f"{function}() got an unexpected keyword argument {name!r}; {end}"


def check_keywords(function: str, given: Iterable[str], keywords: Sequence[str]) -> None:
    """Check keywords that a function passes on.

    Args:
        function: its name.
        given: keywords of the call.
        keywords: those that it has.

    Raises:
        TypeError: for one that it does not have, with the nearest one.
    """
    for name in given:
        if name not in keywords:
            raise TypeError(unexpected(function, name, keywords))


def loaded_by_name(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Let a constructor that gets the name or path of a robot alone say what loads one."""

    @functools.wraps(function)
    def checked(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Result:
        if len(args) == 2 and isinstance(args[1], str | os.PathLike):
            raise TypeError(f"a robot is loaded by armgpi.Robot.load({str(args[1])!r})")
        return function(*args, **kwargs)

    return checked


def with_keyword_hints(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Let a function name the nearest keyword when it is called with one that it does not have."""
    parameters = inspect.signature(function).parameters
    if any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters.values()):
        return function
    keywords = [name for name in parameters if name not in ("self", "cls")]

    @functools.wraps(function)
    def checked(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Result:
        if kwargs.keys() - parameters.keys():
            check_keywords(function.__qualname__.removesuffix(".__init__"), kwargs, keywords)
        return function(*args, **kwargs)

    return checked
