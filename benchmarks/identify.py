"""armgpi, FIGAROH and mujoco.sysid identify the same arms from the same logs.

    pip install figaroh "mujoco[sysid]"
    python benchmarks/identify.py --arms ur5 --count 4

Logs are those of tools/identification.py, `base`: 20 s at 70 % of the velocity limits, 16 bits, one sample
late, 0.5 % torque noise. Each is used as its documentation says, and both peers are told the lag. FIGAROH
gets a subclass and a YAML file, and takes its own filters, derivatives and weighted least squares.
mujoco.sysid rolls out every second half second, for which positions and velocities are filtered here, and
fits rotor, damping and friction loss of each joint, mass and centre of each body: pseudo-inertias ended in
an error of MuJoCo 4.0's compiler. A peer that is not installed is left out.
"""

from __future__ import annotations

import argparse
import contextlib
import inspect
import io
import logging
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import signal

import armgpi
from armgpi.base.arrays import Array
from armgpi.health.zoo import fingers
from armgpi.identification.estimate import expect
from armgpi.identification.excitation import excite
from armgpi.identification.logs import Log
from armgpi.identification.weak_form import COLUMNS, COULOMB, ROTOR, VISCOUS, inverse_rows

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from identification import DT, FREE, record, truth, unknowns

#: What FIGAROH is told of an arm, and up to which frequency derivatives are taken [Hz].
CUTOFF = 10.0
YAML = """
robot: {{name: arm}}
tasks:
  identification:
    enabled: true
    type: parameter_identification
    joints: {{active_joints: [{joints}]}}
    problem:
      model_components: {{friction: true, actuator_inertia: true, joint_offset: true}}
    signal_processing:
      sampling_frequency: {rate}
      cutoff_frequency: {cutoff}
      filter_params: {{nbutter: 4, f_butter: {cutoff}, med_fil: 5, f_sample: {rate}}}
"""
#: Windows that mujoco.sysid rolls out [s], its time step [s], and iterations.
WINDOW, STEP, ROUNDS = 0.5, 2e-3, 5


class Fit(NamedTuple):
    """What one of them says: torques on another trajectory, (k, n), and friction and rotor of each joint."""

    torque: Array
    coulomb: Array
    viscous: Array
    rotor: Array


def by_armgpi(robot: armgpi.Robot, log: Log, held: Any) -> Fit:
    """Fit by armgpi."""
    found = armgpi.identify(log, robot)
    rows = inverse_rows(robot.pinocchio_model(), held.q, held.v, held.a, np.full(robot.n, 1e-3))
    torque = rows.reshape(len(held.q), robot.n, -1) @ found.theta[: robot.n * len(COLUMNS)]
    return Fit(torque, found.robot.friction.coulomb, found.robot.friction.viscous, found.robot.armature)


def by_figaroh(robot: armgpi.Robot, log: Log, held: Any) -> Fit:
    """Fit by FIGAROH's base parameters."""
    import pinocchio as pin
    from figaroh.identification.base_identification import BaseIdentification
    from figaroh.tools.regressor import build_regressor_basic, build_regressor_reduced

    class Arm(BaseIdentification):
        def load_trajectory_data(self, data_source: Any = None) -> Any:
            known = {"timestamps": log.t[:-1], "positions": log.q[1:], "torques": log.tau[:-1]}
            return {**known, "velocities": None, "accelerations": None}

        def process_torque_data(self, **kwargs: Any) -> Any:
            filters = self.filter_config["filter_params"]
            self.processed_data["torques"] = self._apply_filters(self.raw_data["torques"], **filters)
            return self.processed_data["torques"]

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.yaml"
        text = YAML.format(joints=", ".join(robot.joint_names), rate=1.0 / DT, cutoff=CUTOFF)
        path.write_text(text, encoding="utf-8")
        wrapper = pin.RobotWrapper(robot.pinocchio_model(), pin.GeometryModel(), pin.GeometryModel())
        arm, every = Arm(wrapper, str(path)), list(range(robot.n))
        arm.identif_config |= {"act_idxq": every, "act_idxv": every}
        arm.initialize()
        arm.solve(plotting=False, wls=True)
    whole = build_regressor_basic(wrapper, held.q, held.v, held.a, arm.identif_config)
    base = build_regressor_reduced(whole, arm._idx_eliminated)[:, arm._base_indices]
    alone = dict(zip(arm.params_base, arm.phi_base, strict=True))
    drives = [
        [alone.get(f"{key}_{name}", np.nan) for name in robot.joint_names] for key in ("fs", "fv", "Ia")
    ]
    return Fit((base @ arm.phi_base).reshape(robot.n, -1).T, *np.array(drives))


def by_mujoco(robot: armgpi.Robot, log: Log, held: Any) -> Fit:
    """Fit a model by mujoco.sysid."""
    import mujoco
    from mujoco import sysid

    spec, kinds = mujoco.MjSpec.from_string(robot._assembly.urdf()), mujoco.mjtObj
    spec.option.timestep, spec.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    params = sysid.ParameterDict()
    rotors = expect(robot).mean.reshape(robot.n, len(COLUMNS))[:, ROTOR]

    def put(spec: Any, parameter: Any, name: str, key: str) -> None:
        value = parameter.value[0]
        setattr(spec.joint(name), key, np.array([value, 0.0, 0.0]) if key == "damping" else value)

    for name, rotor, effort in zip(robot.joint_names, rotors, robot.limits.effort, strict=True):
        spec.joint(name).limited, spec.joint(name).armature = mujoco.mjtLimited.mjLIMITED_FALSE, rotor
        spec.add_actuator(name=f"m_{name}", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT).set_to_motor()
        sensor = {"type": mujoco.mjtSensor.mjSENS_JOINTPOS, "objtype": kinds.mjOBJ_JOINT}
        spec.add_sensor(name=f"q_{name}", objname=name, **sensor)
        for key, start, most in (
            ("armature", rotor, 10.0 * rotor),
            ("damping", 0.01 * effort, effort),
            ("frictionloss", 0.01 * effort, effort),
        ):

            def change(spec: Any, parameter: Any, name: str = name, key: str = key) -> None:
                put(spec, parameter, name, key)

            params.add(sysid.Parameter(f"{name} {key}", start, 0.0, most, modifier=change))
    model = spec.compile()
    for body in (model.body(i).name for i in range(1, model.nbody) if model.body_mass[i] > 0.0):
        params.add(sysid.body_inertia_param(spec, model, body, scale_rot_inertia=True))
    q = signal.sosfiltfilt(signal.butter(4, CUTOFF, fs=1.0 / DT, output="sos"), log.q[1:], axis=0)
    v = np.gradient(q, DT, axis=0)
    window, tau, positions = round(WINDOW / DT), log.tau[:-1], log.q[1:]
    starts = range(window, len(q) - window, 2 * window)
    parts = [slice(k, k + window, round(STEP / DT)) for k in starts]
    clock = log.t[parts[0]] - log.t[parts[0]][0]
    sequences = sysid.ModelSequences(
        "arm",
        spec,
        [str(k) for k in starts],
        [sysid.create_initial_state(model, q[k], v[k], np.zeros(0)) for k in starts],
        [sysid.TimeSeries(clock, tau[part]) for part in parts],
        [sysid.TimeSeries.from_names(clock, positions[part], model) for part in parts],
    )
    residual = sysid.build_residual_fn(models_sequences=[sequences], n_threads=1)
    best, _ = sysid.optimize(params, residual, verbose=False, max_iters=ROUNDS)
    fit = sysid.apply_param_modifiers(best, spec)
    data, torque, full = mujoco.MjData(fit), np.empty_like(held.q), np.zeros((fit.nv, fit.nv))
    for k in range(len(held.q)):
        data.qpos[:], data.qvel[:] = held.q[k], held.v[k]
        mujoco.mj_forward(fit, data)
        mujoco.mj_fullM(fit, data, full)
        loss = fit.dof_frictionloss * np.sign(held.v[k])
        torque[k] = full @ held.a[k] + data.qfrc_bias - data.qfrc_passive + loss
    return Fit(torque, fit.dof_frictionloss, fit.dof_damping, fit.dof_armature)


WAYS: dict[str, Callable[[armgpi.Robot, Log, Any], Fit]] = {
    "armgpi": by_armgpi,
    "FIGAROH": by_figaroh,
    "mujoco.sysid": by_mujoco,
}


def main() -> None:
    """Print a table of errors, processor time and lines that a user has to write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", nargs="+", default=["ur5"])
    parser.add_argument("--count", type=int, default=6)
    parser.add_argument("--seed", type=int, default=700)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--only", nargs="+", default=list(WAYS), choices=list(WAYS))
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    print("| arm | by | torque: median, worst joint [%] | rotor [%] | Coulomb, viscous [%] | time | lines |")
    print("|---|---|---|---|---|---|---|")
    for name in given.arms:
        robot = armgpi.Robot.load(name, lock=fingers(name))
        arms = [truth(robot, given.seed + i) for i in range(given.count)]
        logs = record(robot, arms, excite(robot, given.seconds, 0.7, 7, **FREE).reference, given.seconds)
        held = excite(robot, 10.0, 0.7, 1234, **FREE).reference.at(np.linspace(0.5, 9.5, 300))
        rows = inverse_rows(robot.pinocchio_model(), held.q, held.v, held.a, np.full(robot.n, 1e-3))
        rows = rows.reshape(len(held.q), robot.n, -1)
        for way in given.only:
            with contextlib.suppress(ImportError):
                print(row(name, way, robot, list(zip(arms, logs, strict=True)), (held, rows)), flush=True)


def row(name: str, way: str, robot: armgpi.Robot, cases: list[Any], another: tuple[Any, Array]) -> str:
    """Return what one of them makes of the logs of an arm, as a row of the table."""
    torques, drives, times = [], [], []
    for arm, log in cases:
        true = unknowns(arm)
        torque = another[1] @ true.ravel()
        begin = time.process_time()
        with contextlib.redirect_stdout(io.StringIO()):
            fit = WAYS[way](robot, log, another[0])
        times.append((time.process_time() - begin) / log.t[-1])
        torques.append(np.sqrt(((fit.torque - torque) ** 2).mean(axis=0) / (torque**2).mean(axis=0)))
        pairs = zip((fit.rotor, fit.coulomb, fit.viscous), (ROTOR, COULOMB, VISCOUS), strict=True)
        drives.append([np.abs(x / true[:, column] - 1.0) for x, column in pairs])
    error = np.array(torques)
    rotor, coulomb, viscous = 100.0 * np.nanmedian(np.array(drives), axis=(0, 2))
    lines = len(inspect.getsource(WAYS[way]).splitlines()) + (YAML.count("\n") if way == "FIGAROH" else 0)
    return (
        f"| {name} | {way} | {100 * np.median(error):.2g}, {100 * np.median(error.max(axis=1)):.2g} "
        f"| {rotor:.2g} | {coulomb:.2g}, {viscous:.2g} | {np.median(times):.2g} | {lines} |"
    )


if __name__ == "__main__":
    main()
