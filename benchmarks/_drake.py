"""Drake doing the work of ``armgpi.simulate``, as far as it allows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from _peer import Array, Law, Trajectory, bare_urdf, refuse_cut
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator


def load(urdf: str, fixed: Sequence[str], joint_names: Sequence[str]) -> Any:
    """Return a continuous-time plant of a URDF: bodies and joints only, on a base that does not move."""
    plant = MultibodyPlant(time_step=0.0)
    (instance,) = Parser(plant).AddModelsFromString(bare_urdf(urdf, fixed), "urdf")
    bodies = [plant.get_body(i) for i in plant.GetBodyIndices(instance)]
    held = {plant.get_joint(i).child_body().index() for i in plant.GetJointIndices(instance)}
    for body in bodies:
        if body.index() not in held:
            plant.WeldFrames(plant.world_frame(), body.body_frame())
    plant.Finalize()
    moving = [plant.get_joint(i) for i in plant.GetJointIndices(instance)]
    found = [joint.name() for joint in moving if joint.num_positions() == 1]
    if found != list(joint_names):
        raise RuntimeError(f"Drake's joints are {found}, expected {list(joint_names)}")
    return plant


def run_stages(plant: Any, law: Law, q0: Array, q_ref: Array, effort: Array, dt: float) -> Trajectory:
    """Run one closed loop with the four stages of Runge-Kutta written in Python: the same integrator."""
    n = len(q0)
    context = plant.CreateDefaultContext()
    derivatives = plant.AllocateTimeDerivatives()
    port = plant.get_applied_generalized_force_input_port()
    torque = port.FixValue(context, np.zeros(n))
    state = np.concatenate([q0, np.zeros(n)])
    q, v, taus = (np.empty(q_ref.shape) for _ in range(3))
    floor, half, sixth = -effort, np.array(0.5 * dt), np.array(dt / 6.0)
    two, step = np.array(2.0), np.array(dt)
    place = plant.SetPositionsAndVelocities

    def slope(x: Array) -> Array:
        place(context, x)
        plant.CalcTimeDerivatives(context, derivatives)
        return derivatives.CopyToVector()

    for k in range(len(q_ref)):
        q[k] = state[:n]
        v[k] = state[n:]
        place(context, state)
        tau = _torque(plant, context, law, q[k] - q_ref[k], floor, effort)
        torque.GetMutableData().get_mutable_value().SetFromVector(tau)
        k1 = slope(state)
        k2 = slope(state + half * k1)
        k3 = slope(state + half * k2)
        k4 = slope(state + step * k3)
        state = state + sixth * (k1 + two * (k2 + k3) + k4)
        taus[k] = tau
    return Trajectory(q, v, taus, state[:n])


def run_simulator(plant: Any, law: Law, q0: Array, q_ref: Array, effort: Array, dt: float) -> Trajectory:
    """Run one closed loop by Drake's Simulator, with fixed steps of its Runge-Kutta method of order 3.

    Drake has no method of order 4 with fixed steps: this is one evaluation less a step.
    """
    n = len(q0)
    simulator = Simulator(plant)
    ResetIntegratorFromFlags(simulator, "runge_kutta3", dt).set_fixed_step_mode(True)
    context = simulator.get_mutable_context()
    torque = plant.get_applied_generalized_force_input_port().FixValue(context, np.zeros(n))
    plant.SetPositionsAndVelocities(context, np.concatenate([q0, np.zeros(n)]))
    simulator.Initialize()
    q, v, taus = (np.empty(q_ref.shape) for _ in range(3))
    floor, read, advance = -effort, plant.GetPositionsAndVelocities, simulator.AdvanceTo
    for k in range(len(q_ref)):
        state = read(context)
        q[k] = state[:n]
        v[k] = state[n:]
        tau = _torque(plant, context, law, q[k] - q_ref[k], floor, effort)
        torque.GetMutableData().get_mutable_value().SetFromVector(tau)
        advance((k + 1) * dt)
        taus[k] = tau
    return Trajectory(q, v, taus, read(context)[:n])


def _torque(plant: Any, context: Any, law: Law, e: Array, floor: Array, effort: Array) -> Array:
    """Return D(q) v for the error, which must be within the limits."""
    asked = plant.CalcMassMatrix(context) @ law.step(e)
    tau = np.minimum(np.maximum(asked, floor), effort)
    refuse_cut(tau - asked)
    return tau


def forward(plant: Any, q: Array, v: Array, tau: Array) -> Array:
    """Return accelerations for rows of states, one evaluation of the derivatives from Python for each."""
    n = q.shape[1]
    context, derivatives = plant.CreateDefaultContext(), plant.AllocateTimeDerivatives()
    torque = plant.get_applied_generalized_force_input_port().FixValue(context, np.zeros(n))
    out = np.empty_like(q)
    for k in range(len(q)):
        plant.SetPositionsAndVelocities(context, np.concatenate([q[k], v[k]]))
        torque.GetMutableData().get_mutable_value().SetFromVector(tau[k])
        plant.CalcTimeDerivatives(context, derivatives)
        out[k] = derivatives.CopyToVector()[n:]
    return out
