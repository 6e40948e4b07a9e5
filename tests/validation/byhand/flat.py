"""A column with two level links, as a translation from C: flat arrays by rows, results written into them."""

from math import cos, sin

import numpy as np

N = 3
M_CARRIAGE = 4.6
M_INNER = 3.1
M_OUTER = 1.7
L_INNER = 0.325
S_INNER = 0.171
S_OUTER = 0.128
J_INNER = 0.0412
J_OUTER = 0.0137
J_MOTOR = 0.0066  # of the outer link's motor, on the inner link's end
M_MOTOR = 0.85
GRAV = 9.81


def fill_inertia(q, out):
    c = cos(q[2])
    h = M_OUTER * L_INNER * S_OUTER
    k = J_OUTER + M_OUTER * S_OUTER * S_OUTER
    out[0 * N + 0] = M_CARRIAGE + M_INNER + M_MOTOR + M_OUTER
    out[0 * N + 1] = 0.0
    out[0 * N + 2] = 0.0
    out[1 * N + 0] = 0.0
    out[1 * N + 1] = J_INNER + M_INNER * S_INNER * S_INNER
    out[1 * N + 1] += J_MOTOR + M_MOTOR * L_INNER * L_INNER
    out[1 * N + 1] += k + M_OUTER * L_INNER * L_INNER + 2.0 * h * c
    out[1 * N + 2] = k + h * c
    out[2 * N + 0] = 0.0
    out[2 * N + 1] = out[1 * N + 2]
    out[2 * N + 2] = k


def fill_velocity(q, qd, out):
    h = M_OUTER * L_INNER * S_OUTER
    s = sin(q[2])
    out[0] = 0.0
    out[1] = -h * s * qd[2] * (2.0 * qd[1] + qd[2])
    out[2] = h * s * qd[1] * qd[1]


def fill_weight(q, out):
    out[0] = GRAV * (M_CARRIAGE + M_INNER + M_MOTOR + M_OUTER)
    out[1] = 0.0
    out[2] = 0.0


def tip(q, out):
    out[0] = L_INNER * cos(q[1])
    out[1] = L_INNER * sin(q[1])
    out[2] = q[0]


def mass_matrix(q):
    work = np.zeros(N * N)
    fill_inertia(q, work)
    return work.reshape(N, N)


def coriolis_torque(q, qd):
    work = np.zeros(N)
    fill_velocity(q, qd, work)
    return work


def gravity(q):
    work = np.zeros(N)
    fill_weight(q, work)
    return work


def inverse_dynamics(q, qd, qdd):
    work = np.zeros(N * N)
    fill_inertia(q, work)
    tau = coriolis_torque(q, qd) + gravity(q)
    for i in range(N):
        for j in range(N):
            tau[i] += work[i * N + j] * qdd[j]
    return tau
