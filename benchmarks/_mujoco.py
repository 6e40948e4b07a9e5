"""MuJoCo doing the work of ``armgpi.simulate``: the same arm, law, integrator and zero-order hold."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from _peer import Array, Law, Trajectory, bare_urdf, refuse_cut
from mujoco import rollout

RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
_POSITION_STAGE = int(mujoco.mjtStage.mjSTAGE_POS)
_FULL_STATE = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
_APPLIED_FORCE = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
#: Samples in one call of a replay.
STRETCH = 200
#: Nothing but rigid bodies; and no automatic reset, which would hide that a run has diverged.
_DISABLED = (
    mujoco.mjtDisableBit.mjDSBL_CONTACT
    | mujoco.mjtDisableBit.mjDSBL_LIMIT
    | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    | mujoco.mjtDisableBit.mjDSBL_AUTORESET
)


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
    model = mujoco.MjModel.from_xml_string(bare_urdf(urdf, fixed))
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


#: What comes before D(q) v and what after: the parts of mj_step, so that D(q) is computed once. MuJoCo has
#: halves of a step, but not for Runge-Kutta.
_WAYS = {
    RK4: (mujoco.mj_fwdPosition, _rest_of_step),
    EULER: (mujoco.mj_step1, mujoco.mj_step2),
}


def run_single(model: mujoco.MjModel, law: Law, q0: Array, q_ref: Array, effort: Array) -> Trajectory:
    """Run one closed loop in Python.

    Args:
        model: from :func:`compile_urdf`.
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
    before, after = _WAYS[model.opt.integrator]
    multiply = mujoco.mj_mulM
    for k in range(len(q_ref)):
        q[k] = qpos
        v[k] = qvel
        before(model, data)
        multiply(model, data, asked, law.step(q[k] - q_ref[k]))
        tau = np.minimum(np.maximum(asked, floor), effort)
        refuse_cut(tau - asked)
        applied[:] = tau
        after(model, data)
        taus[k] = tau
    return Trajectory(q, v, taus, qpos.copy())


class Batch:
    """Many rollouts by mujoco.rollout, on its threads."""

    def __init__(self, model: mujoco.MjModel, threads: int, q0: Array) -> None:
        """Start all from rest at `q0`, shape (batch, n)."""
        self._pool = rollout.Rollout(nthread=threads)
        self._models = [model] * len(q0)
        self._datas = [mujoco.MjData(model) for _ in range(threads)]
        # Its default chunks of a batch of 64 are so small that handing them out takes longer.
        self._chunk = max(1, min(16, len(q0) // threads), len(q0) // (10 * threads))
        self._numbers = mujoco.mj_stateSize(model, _FULL_STATE)
        self._q0 = q0

    def closed(self, torque: Callable[[int, Array], Array], steps: int) -> Trajectory:
        """Run closed loops: each sample one call of mujoco.rollout for one step.

        Args:
            torque: the law: sample and positions -> torque, (batch, n).
            steps: how many samples.
        """
        batch, n = self._q0.shape
        state = np.zeros((batch, 1, self._numbers))
        start = state[:, 0]  # the same memory: a step starts where the one before ended
        positions, velocities = start[:, 1 : 1 + n], start[:, 1 + n : 1 + 2 * n]  # after the time
        positions[:] = self._q0
        q, v, taus = (np.empty((steps, batch, n)) for _ in range(3))
        for k in range(steps):
            q[k] = positions
            v[k] = velocities
            taus[k] = torque(k, q[k])
            self._roll(start, taus[k][:, None], state)
        return Trajectory(q, v, taus, positions.copy())

    def replayed(self, q: Array, v: Array, taus: Array) -> Trajectory:
        """Run under torques known beforehand, with no law at all: `STRETCH` samples in one call.

        Every stretch begins at the state given for it, as what an arm does without feedback soon depends on
        the last digit.

        Args:
            q: positions at every sample [rad], shape (steps, batch, n); those in a stretch are not looked at.
            v: velocities [rad/s].
            taus: torques [N m].
        """
        steps, batch, n = taus.shape
        state = np.empty((batch, steps, self._numbers))
        for k in range(0, steps, STRETCH):
            part = slice(k, k + STRETCH)
            start = np.zeros((batch, self._numbers))
            start[:, 1 : 1 + n], start[:, 1 + n : 1 + 2 * n] = q[k], v[k]
            taken = np.empty((batch, len(taus[part]), self._numbers))
            self._roll(start, np.ascontiguousarray(taus[part].swapaxes(0, 1)), taken)
            state[:, part] = taken
        after = state[:, :, 1 : 1 + 2 * n].swapaxes(0, 1)
        before = np.concatenate([np.concatenate([q[:1], v[:1]], axis=-1), after[:-1]])
        return Trajectory(before[..., :n], before[..., n:], taus, after[-1, :, :n])

    def _roll(self, start: Array, control: Array, state: Array) -> None:
        """Take as many steps as there are controls, shape (batch, steps, n)."""
        self._pool.rollout(
            self._models,
            self._datas,
            start,
            control,
            control_spec=_APPLIED_FORCE,
            skip_checks=True,
            nstep=control.shape[1],
            state=state,
            chunk_size=self._chunk,
        )


def forward(model: mujoco.MjModel, q: Array, v: Array, tau: Array) -> Array:
    """Return accelerations for rows of states, one call of mj_forward from Python for each."""
    data = mujoco.MjData(model)
    qpos, qvel, applied, qacc = data.qpos, data.qvel, data.qfrc_applied, data.qacc
    out = np.empty_like(q)
    evaluate = mujoco.mj_forward
    for k in range(len(q)):
        qpos[:] = q[k]
        qvel[:] = v[k]
        applied[:] = tau[k]
        evaluate(model, data)
        out[k] = qacc
    return out


def inverse(model: mujoco.MjModel, q: Array, v: Array, a: Array) -> Array:
    """Return torques for rows of states, one call of mj_inverse from Python for each."""
    data = mujoco.MjData(model)
    qpos, qvel, qacc, found = data.qpos, data.qvel, data.qacc, data.qfrc_inverse
    out = np.empty_like(q)
    evaluate = mujoco.mj_inverse
    for k in range(len(q)):
        qpos[:] = q[k]
        qvel[:] = v[k]
        qacc[:] = a[k]
        evaluate(model, data)
        out[k] = found
    return out


def inertia_times(model: mujoco.MjModel, q: Array, x: Array) -> Array:
    """Return D(q) x for rows of states, by mj_fwdPosition and mj_mulM from Python."""
    data = mujoco.MjData(model)
    qpos = data.qpos
    out = np.empty_like(q)
    position, multiply = mujoco.mj_fwdPosition, mujoco.mj_mulM
    for k in range(len(q)):
        qpos[:] = q[k]
        position(model, data)
        multiply(model, data, out[k], x[k])
    return out
