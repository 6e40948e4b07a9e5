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
    **dict.fromkeys(("buildReducedModel", "buildReducedRobot"), "armgpi.Robot.load(path, lock=[names])"),
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
    # Pinocchio
    "Data": "no data: methods of a robot, such as robot.mass_matrix(q), return arrays",
    **dict.fromkeys(("SE3", "Motion", "Force", "Inertia", "exp", "log", "skew"), "pinocchio's"),
    "neutral": "robot.middle()",
    "randomConfiguration": "robot.random_positions(...)",
    "difference": "q1 - q0: each joint has one coordinate",
    "updateFramePlacements": "robot.frame_pose(name, q)",
    "framesForwardKinematics": "robot.frame_pose(name, q)",
    "computeJointJacobians": "robot.frame_jacobian(name, q)",
    "computeJointJacobian": "robot.frame_jacobian(name, q)",
    "computeFrameJacobian": "robot.frame_jacobian(name, q)",
    "getFrameJacobian": "robot.frame_jacobian(name, q)",
    "LOCAL_WORLD_ALIGNED": "robot.frame_jacobian(name, q), which has these axes",
    "nonLinearEffects": "robot.nonlinear_effects(q, v)",
    "computeGeneralizedGravity": "robot.gravity(q)",
    "computeCoriolisMatrix": "robot.nonlinear_effects(q, v) - robot.gravity(q), which is C(q, v) v",
    "computeMinverse": "robot.inertia_solve(q, torque), which is D(q)^-1 times a torque",
    "buildModelsFromUrdf": "armgpi.Robot.load(path)",
    "loadModel": "armgpi.Robot.load(path)",
    "MeshcatVisualizer": "armgpi.view(robot) or armgpi.view(rollout)",
    "computeCollisions": "armgpi.robot.collisions.self_collisions(...)",
    # Pink
    **dict.fromkeys(
        ("PostureTask", "ComTask", "DampingTask", "RelativeFrameTask", "JointVelocityTask", "Task", "tasks"),
        "pink's tasks, and their trajectory by armgpi.Recorded (examples/12_pink_trajectory.py)",
    ),
    **dict.fromkeys(
        ("VelocityLimit", "ConfigurationLimit", "JointLimit", "limits"),
        "robot.limits of a robot",
    ),
    "FrameTracking": "armgpi.CartesianReference(...)",
    "start_meshcat_visualizer": "armgpi.view(robot)",
    "visualization": "armgpi.view(robot) or armgpi.view(rollout)",
    "custom_configuration_vector": "an array in the order of robot.joint_names",
    "NoSolutionFound": "inverse_kinematics(robot, ...).reached, which is False then",
    "PinkError": "armgpi.ArmgpiError",
    # roboticstoolbox
    **dict.fromkeys(("Robot2", "ET", "ETS"), "armgpi.Robot.load(path), of a URDF"),
    **dict.fromkeys(
        ("Link", "RevoluteDH", "PrismaticDH", "DHLink"),
        "armgpi.Robot.load(path), of a URDF; `armgpi new --dh TABLE` writes one",
    ),
    **dict.fromkeys(("mtraj", "quintic", "tpoly"), "armgpi.Bezier(start, goal, duration)"),
    **dict.fromkeys(("trapezoidal", "lspb"), "armgpi.Bezier(start, goal, velocity_limit=...)"),
    "mstraj": "armgpi.Waypoints(points, durations)",
    "models": "armgpi.Robot.load(name), with a name of armgpi.robots.names()",
    "Puma560": "armgpi.Robot.load(path), of its URDF",
    "Panda": 'armgpi.Robot.load("panda")',
    **{name: f'armgpi.Robot.load("{name.lower()}")' for name in ("UR3", "UR5", "UR10")},
    **dict.fromkeys(("Swift", "PyPlot", "backends"), "armgpi.view(robot) or armgpi.view(rollout)"),
    **dict.fromkeys(
        ("ik_LM", "ik_NR", "ik_GN", "ikine", "IKSolution"), "armgpi.inverse_kinematics(robot, ...)"
    ),
    "p_servo": "armgpi.Follower, which follows poses within limits",
    "rne": "robot.inverse_dynamics(q, v, a)",
    "gravload": "robot.gravity(q)",
    **dict.fromkeys(("jacob0", "jacobe"), "robot.frame_jacobian(name, q)"),
    "inertia": "robot.mass_matrix(q)",
    "coriolis": "robot.nonlinear_effects(q, v) - robot.gravity(q), which is C(q, v) v",
    "accel": "robot.forward_dynamics(q, v, tau)",
    "manipulability": "the singular values of robot.frame_jacobian(name, q)",
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
    **dict.fromkeys(("data", "createData"), "no data: methods such as mass_matrix(q) return arrays"),
    **dict.fromkeys(("lowerPositionLimit", "q_min", "qmin"), "limits.lower"),
    **dict.fromkeys(("upperPositionLimit", "q_max", "qmax"), "limits.upper"),
    **dict.fromkeys(("getFrameId", "getJointId", "existFrame"), "frame_names and joint_names"),
    "v0": "an array of zeros; a robot has no state",
    **dict.fromkeys(("com", "centerOfMass", "Jcom"), "pinocchio_model(), and pinocchio.centerOfMass"),
    **dict.fromkeys(("jointJacobian", "jacob0_dot", "hessian0"), "frame_jacobian(name, q)"),
    **dict.fromkeys(("placement", "fkine_all", "ets"), "frame_pose(name, q)"),
    **dict.fromkeys(("difference", "integrate"), "q1 - q0 and q + v dt: each joint has one coordinate"),
    **dict.fromkeys(("random", "random_q"), "random_positions(...)"),
    **dict.fromkeys(
        ("viewer", "visual_model", "display", "initViewer", "loadViewerModel", "teach"), "armgpi.view(robot)"
    ),
    **dict.fromkeys(("ikine_a", "ik_GN", "ik_NR"), "armgpi.inverse_kinematics(robot, ...)"),
    **dict.fromkeys(("rne_dyn", "itorque"), "inverse_dynamics(q, v, a)"),
    "pay": "with_payload(frame, mass), then gravity(q)",
    **dict.fromkeys(("friction_coulomb", "nofriction"), "friction and with_friction(viscous, coulomb)"),
    "manipulability": "the singular values of frame_jacobian(name, q)",
    **dict.fromkeys(("qr", "qz", "configs"), "middle()"),
    **dict.fromkeys(("link_lengths", "base"), "pinocchio_model(), whose base is fixed"),
    **dict.fromkeys(("tool", "ee_links", "gripper", "grippers"), "tip, the frame of the tool"),
    "islimit": "outside(q)",
    "control_mode": "armgpi.GPI(robot, dt) and other controllers: a robot has none",
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
    **dict.fromkeys(("stability", "poles", "zeros", "bode", "nyquist", "tf"), "margins()"),
    **dict.fromkeys(("act", "run", "u", "tau"), "step(measurement, target, state), which returns a torque"),
    "K": "gains",
    "sample_time": "dt",
    **dict.fromkeys(
        ("error", "setpoint", "target", "q_des"),
        "step(measurement, target, state)",
    ),
    "save": "export (armgpi.export_controller), or an experiment file (armgpi new)",
}


#: The same of a plant, and of what is put around one.
PLANT: Mapping[str, str] = {
    "model": "robot, the true one",
    "reset": "init(q, v), which returns a state",
    **dict.fromkeys(("q", "v", "x"), "measure(state) or true_state(state): a plant has no state of its own"),
    **dict.fromkeys(("set_state", "get_state"), "init(q, v): a plant has no state of its own"),
    **dict.fromkeys(("tau", "apply", "integrate"), "step(tau, state, dt)"),
    **dict.fromkeys(("dt", "timestep"), "substeps; the sample time is the controller's"),
    **dict.fromkeys(("simulate", "run"), "armgpi.simulate(plant, controller, reference)"),
    **dict.fromkeys(("observe", "obs", "observation"), "measure(state)"),
    **dict.fromkeys(("viewer", "render", "view"), "armgpi.view(rollout)"),
    "gravity": "robot.gravity(q)",
    "engine": "its class: armgpi.RigidBodyPlant, ElasticPlant or MuJoCoPlant",
    "payload": "robot.with_payload(frame, mass) of the robot that the plant is made with",
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
    "report": 'armgpi.report(rollout, "report.html")',
    **dict.fromkeys(("chatter", "smoothness", "jerk"), "armgpi.metrics.total_variation(rollout)"),
    "energy": "armgpi.metrics.isci(rollout), the integral of the squared torque",
    "overshoot": "armgpi.metrics.peak_error(rollout); references have no steps",
    "settling_time": "armgpi.metrics.final_error(rollout); references have no steps",
    "peak": "armgpi.metrics.peak_error(rollout) or armgpi.metrics.peak_torque(rollout)",
    "tracking_error": "armgpi.metrics.error(rollout)",
}


#: Names of figures elsewhere -> those here.
PLOTS: Mapping[str, str] = {
    "plot": "armgpi.plots.overview(rollout)",
    "show": "armgpi.plots.overview(rollout), and matplotlib.pyplot.show()",
    "joints": "armgpi.plots.positions(rollout)",
    "joint_positions": "armgpi.plots.positions(rollout)",
    "joint_torques": "armgpi.plots.torques(rollout)",
    "animate": "armgpi.view(rollout)",
    "animation": "armgpi.view(rollout)",
    "joint": "armgpi.plots.positions(rollout)",
    "trajectory": "armgpi.plots.overview(rollout)",
    "step_response": "armgpi.plots.overview(rollout)",
    **dict.fromkeys(("bode", "nyquist"), "controller.margins(), which has the margins as numbers"),
    "spectrum": "armgpi.plots.torque_rates(rollout), or SciPy of rollout.tau",
    "phase": "armgpi.plots.velocities(rollout)",
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
    "position": "q, the true positions, or q_measured",
    "acceleration": 'v.differentiate("time")',
    "names": 'rollout["joint"].values',
    **dict.fromkeys(("to_csv", "to_numpy"), "rollout.to_dataframe(), or rollout.q.values"),
    "converged": "status, which is 0 (armgpi.Status.FINISHED) where it finished",
    "show": "armgpi.plots.overview(rollout) or armgpi.view(rollout)",
    "control": "tau",
    "desired": "q_ref and v_ref",
    "setpoint": "q_ref and v_ref",
    "ee_pose": "tool, and tool_ref",
    **dict.fromkeys(("force", "contact"), "contact_force, where plant.environment has contacts"),
}


#: Keywords that users of other libraries type -> the keywords here that may mean the same.
KEYWORDS: Mapping[str, tuple[str, ...]] = {
    "bandwidth": ("gains", "omega_c"),
    "omega": ("omega_c", "gains"),
    "omega_c": ("gains",),
    "zeta": ("zeta_c", "gains"),
    "frequency": ("omega_c", "gains"),
    **dict.fromkeys(("kp", "ki", "kd", "poles"), ("gains",)),
    "delay": ("samples",),
    "target": ("position", "goal"),
    "limit": ("effort",),
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


#: Keywords that take an object -> how one is written.
WRITTEN: Mapping[str, str] = {"gains": "gains=armgpi.FixedGains(20.0)"}


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
    folded = {each.casefold(): each for each in known if len(each) > 1}  # D and d may differ
    if (entry := name if name in known else folded.get(name.casefold())) is not None:
        return f"{text}; use {known[entry]}"
    own = {each.casefold(): each for each in names}
    near = [own[each] for each in get_close_matches(name.casefold(), own, n=1)]
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
    for foreign in get_close_matches(name, KEYWORDS, n=1) if not near else ():  # bandwith
        near += [each for each in KEYWORDS[foreign] if each in keywords]
    end = f"it has {', '.join(keywords)}"
    if near:
        written = WRITTEN.get(near[0])
        end = f"did you mean {near[0]!r}{f', as in {written}' if written else ''}?"
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
