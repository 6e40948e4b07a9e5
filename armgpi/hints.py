"""What to write in place of a name or keyword that does not exist, or is that of another library."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
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
    "PID": "armgpi.PIDPositions (positions only) or armgpi.PIDInversion (positions and velocities)",
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
    "neutral": "middle()",
    "q0": "middle()",
    "qlim": "limits",
    "effortLimit": "limits.effort",
    "velocityLimit": "limits.velocity",
    "rotorInertia": "armature",
}


def missing(owner: str, name: str, known: Mapping[str, str], names: list[str]) -> str:
    """Return the message of an attribute that does not exist.

    Args:
        owner: what has no such attribute, as Python says it.
        name: of the attribute.
        known: names of other libraries -> what to write.
        names: attributes that exist.
    """
    text = f"{owner} has no attribute {name!r}"
    if name in known:
        return f"{text}; use {known[name]}"
    near = get_close_matches(name, names, n=1)
    return f"{text}; did you mean {near[0]!r}?" if near else text


def with_keyword_hints(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Let a function name the nearest keyword when it is called with one that it does not have."""
    parameters = inspect.signature(function).parameters
    if any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters.values()):
        return function
    keywords = [name for name in parameters if name != "self"]

    @functools.wraps(function)
    def checked(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Result:
        for name in kwargs:
            if name not in parameters:
                near = get_close_matches(name, keywords, n=1)
                end = f"did you mean {near[0]!r}?" if near else f"it has {', '.join(keywords)}"
                what = function.__qualname__.removesuffix(".__init__")
                raise TypeError(f"{what}() got an unexpected keyword argument {name!r}; {end}")
        return function(*args, **kwargs)

    return checked
