"""MuJoCo doing the work of ``armgpi.simulate``: the same arm, law, integrator and zero-order hold.

Written against MuJoCo's own functions and without armgpi's controller, plant or loop, so that equal
trajectories say something about both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np
import numpy.typing as npt
from mujoco import rollout

Array = npt.NDArray[np.float64]

RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
_POSITION_STAGE = int(mujoco.mjtStage.mjSTAGE_POS)
_FULL_STATE = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
_APPLIED_FORCE = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
#: Nothing but rigid bodies; and no automatic reset, which would hide that a run has diverged.
_DISABLED = (
    mujoco.mjtDisableBit.mjDSBL_CONTACT
    | mujoco.mjtDisableBit.mjDSBL_LIMIT
    | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    | mujoco.mjtDisableBit.mjDSBL_AUTORESET
)


class Trajectory(NamedTuple):
    """What a run recorded at every sample, and where it ended; arrays of shape (steps, ..., n).

    Attributes:
        q: positions [rad].
        v: velocities [rad/s].
        tau: torques held from this sample to the next [N m].
        q_end: positions after the last step [rad], shape (..., n).
    """

    q: Array
    v: Array
    tau: Array
    q_end: Array


class Law:
    """The bumpless GPI law by the trapezoidal rule, in plain NumPy and as few operations as armgpi's.

    v = -(beta3 e + lam + eta), lam' = b e + chi, chi' = c e, eta' = -beta4 eta + d e. What the present
    error adds to lam, chi and eta is in the factor `direct`, so each state is updated once a sample. With
    zeta_c = 1 and p_c = omega_c all poles are at -omega_c, and the betas are binomial.
    """

    def __init__(self, omega: float, dt: float, hold: Array) -> None:
        """Start so that v = `hold` while the error is zero."""
        beta0, beta1, beta2, beta3, beta4 = (math.comb(5, k) * omega ** (5 - k) for k in range(5))
        b = (beta1 - beta0 / beta4) / beta4
        c = beta0 / beta4
        d = (-beta3 * beta4**3 + beta2 * beta4**2 - beta1 * beta4 + beta0) / beta4**2
        half = 0.5 * dt
        decay = (1.0 - half * beta4) / (1.0 + half * beta4)
        filtered = half * d / (1.0 + half * beta4)
        # 0-d arrays, which NumPy multiplies faster than Python numbers.
        self._direct = np.array(-(beta3 + half * b + half * half * c + filtered))
        self._to_lam = np.array(dt * (b + dt * c))
        self._to_chi = np.array(dt * c)
        self._to_eta = np.array((1.0 + decay) * filtered)
        self._decay = np.array(decay)
        self._dt = np.array(dt)
        self._lam = -hold
        self._chi = np.zeros_like(hold)
        self._eta = np.zeros_like(hold)

    def step(self, e: Array) -> Array:
        """Return the virtual acceleration for the error `e`."""
        v = self._direct * e - self._lam - self._eta
        self._lam = self._lam + self._dt * self._chi + self._to_lam * e
        self._chi = self._chi + self._to_chi * e
        self._eta = self._decay * self._eta + self._to_eta * e
        return v


def compile_urdf(
    urdf: str, fixed: Sequence[str], joint_names: Sequence[str], integrator: int, dt: float
) -> mujoco.MjModel:
    """Return MuJoCo's model of a URDF: bodies and joints only, no friction, contacts or limits.

    Args:
        urdf: the XML.
        fixed: names of joints to hold at zero.
        joint_names: the joints that remain, in the order expected.
        integrator: ``RK4`` or ``EULER``.
        dt: step [s].
    """
    root = ElementTree.fromstring(urdf)
    for link in root.findall("link"):
        for child in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(child)
    for joint in root.findall("joint"):
        if joint.get("name") in fixed:
            joint.set("type", "fixed")
            for child in joint.findall("mimic"):
                joint.remove(child)
    model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
    found = [model.joint(j).name for j in range(model.njnt)]
    if found != list(joint_names):
        raise RuntimeError(f"MuJoCo's joints are {found}, expected {list(joint_names)}")
    # armgpi's plant has no friction unless asked, and a URDF says nothing of rotors.
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    model.dof_armature[:] = 0.0
    model.opt.integrator = integrator
    model.opt.timestep = dt
    model.opt.disableflags = int(_DISABLED)
    return model


def holding_acceleration(model: mujoco.MjModel, q: Array) -> Array:
    """Return D(q)^-1 G(q), for q of shape (n,) or (batch, n)."""
    data = mujoco.MjData(model)
    rows = []
    for row in np.atleast_2d(q):
        data.qpos[:] = row
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)
        hold = np.empty((1, model.nv))
        mujoco.mj_solveM(model, data, hold, data.qfrc_bias[None])
        rows.append(hold[0])
    return np.array(rows).reshape(q.shape)


def _rest_of_step(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Compute what mj_step does after the position stage, for the Runge-Kutta method of order 4."""
    mujoco.mj_forwardSkip(model, data, _POSITION_STAGE, 1)
    mujoco.mj_RungeKutta(model, data, 4)


_WAYS = {
    "mj_step": (mujoco.mj_fwdPosition, mujoco.mj_step),
    "parts": (mujoco.mj_fwdPosition, _rest_of_step),
    "halves": (mujoco.mj_step1, mujoco.mj_step2),
}


def run_single(
    model: mujoco.MjModel, way: str, law: Law, q0: Array, q_ref: Array, effort: Array
) -> Trajectory:
    """Run one closed loop in Python.

    Args:
        model: from :func:`compile_urdf`.
        way: "mj_step" computes the position stage for D(q) v before each mj_step, which then computes it
            again; "parts" calls the parts of mj_step, with D(q) v between them; "halves" is mj_step1,
            D(q) v, mj_step2 (Euler only: MuJoCo has no such halves for Runge-Kutta).
        law: the controller.
        q0: starting position [rad], shape (n,).
        q_ref: reference at every sample [rad], shape (steps, n).
        effort: torque limits [N m], shape (n,).
    """
    data = mujoco.MjData(model)
    qpos, qvel, applied = data.qpos, data.qvel, data.qfrc_applied
    qpos[:] = q0
    q, v, taus = (np.empty(q_ref.shape) for _ in range(3))
    asked, floor = np.empty(len(q0)), -effort
    before, after = _WAYS[way]
    multiply = mujoco.mj_mulM
    for k in range(len(q_ref)):
        q[k] = qpos
        v[k] = qvel
        before(model, data)
        multiply(model, data, asked, law.step(q[k] - q_ref[k]))
        tau = np.minimum(np.maximum(asked, floor), effort)
        _refuse_cut(tau - asked)
        applied[:] = tau
        after(model, data)
        taus[k] = tau
    return Trajectory(q, v, taus, qpos.copy())


def run_batch(
    model: mujoco.MjModel,
    pool: rollout.Rollout,
    inertia_times: Callable[[Array, Array], Array],
    law: Law,
    q0: Array,
    q_ref: Array,
    effort: Array,
) -> Trajectory:
    """Run a batch of closed loops, each sample one call of mujoco.rollout for a single step.

    MuJoCo offers no D(q) v for a batch, and a Python loop over mj_fwdPosition and mj_mulM takes several
    times as long as Pinocchio's parallel kernel; so that kernel is used, as by armgpi itself.

    Args:
        model: from :func:`compile_urdf`.
        pool: MuJoCo's threads.
        inertia_times: function that returns D(q) v.
        law: the controller.
        q0: starting positions [rad], shape (batch, n).
        q_ref: reference at every sample [rad], shape (steps, n).
        effort: torque limits [N m], shape (n,).
    """
    steps, (batch, n) = len(q_ref), q0.shape
    models = [model] * batch
    datas = [mujoco.MjData(model) for _ in range(max(1, pool.nthread))]
    # Its default chunks of a batch of 64 are so small that handing them out takes longer.
    chunk = max(16, batch // (10 * len(datas)))
    state = np.zeros((batch, 1, mujoco.mj_stateSize(model, _FULL_STATE)))
    start = state[:, 0]  # the same memory: a step starts where the one before ended
    positions, velocities = start[:, 1 : 1 + n], start[:, 1 + n : 1 + 2 * n]  # after the time
    positions[:] = q0
    q, v, taus = (np.empty((steps, batch, n)) for _ in range(3))
    floor = -effort
    for k in range(steps):
        q[k] = positions
        v[k] = velocities
        asked = inertia_times(q[k], law.step(q[k] - q_ref[k]))
        tau = np.minimum(np.maximum(asked, floor), effort)
        _refuse_cut(tau - asked)
        pool.rollout(
            models,
            datas,
            start,
            tau[:, None],
            control_spec=_APPLIED_FORCE,
            skip_checks=True,
            nstep=1,
            state=state,
            chunk_size=chunk,
        )
        taus[k] = tau
    return Trajectory(q, v, taus, positions.copy())


def _refuse_cut(cut: Array) -> None:
    """Refuse a torque that had to be cut, or is NaN: the anti-windup for it is not written here."""
    if np.count_nonzero(cut):
        raise RuntimeError("MuJoCo's run asks for more torque than the arm has, or for NaN")
