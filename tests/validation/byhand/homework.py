"""Two links of a vertical plane by Lagrange, CasADi functions called with numbers: a student's homework."""

import casadi as ca
import numpy as np

m1, m2 = 1.2, 0.8
l1, l2 = 0.35, 0.3
r1, r2 = 0.16, 0.13
I1, I2 = 0.014, 0.007
g = 9.81

q = ca.SX.sym("q", 2)
dq = ca.SX.sym("dq", 2)

p1 = ca.vertcat(r1 * ca.cos(q[0]), r1 * ca.sin(q[0]))
p2 = ca.vertcat(
    l1 * ca.cos(q[0]) + r2 * ca.cos(q[0] + q[1]),
    l1 * ca.sin(q[0]) + r2 * ca.sin(q[0] + q[1]),
)
v1 = ca.jacobian(p1, q) @ dq
v2 = ca.jacobian(p2, q) @ dq
w1 = dq[0]
w2 = dq[0] + dq[1]

T = 0.5 * m1 * ca.dot(v1, v1) + 0.5 * m2 * ca.dot(v2, v2) + 0.5 * I1 * w1**2 + 0.5 * I2 * w2**2
V = m1 * g * p1[1] + m2 * g * p2[1]

D = ca.jacobian(ca.gradient(T, dq), dq)
h = ca.jacobian(ca.gradient(T, dq), q) @ dq - ca.gradient(T, q)
G = ca.gradient(V, q)

D_fun = ca.Function("D", [q], [D])
h_fun = ca.Function("h", [q, dq], [h])
G_fun = ca.Function("G", [q], [G])


def mass_matrix(x):
    return np.array(D_fun(x))


def coriolis_torque(x, dx):
    return np.array(h_fun(x, dx)).ravel()


def gravity(x):
    return np.array(G_fun(x)).ravel()
