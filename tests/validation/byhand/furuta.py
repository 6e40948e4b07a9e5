"""A Furuta pendulum from its Lagrangian in CasADi: arm turns about z, pendulum about the arm."""

import casadi as ca

m1, m2 = 0.4, 0.15
L1, r1, r2 = 0.25, 0.12, 0.15
Jz1 = 0.003
Jx2, Jy2, Jz2 = 0.0012, 0.0011, 0.0002
g = 9.81

q = ca.SX.sym("q", 2)
v = ca.SX.sym("v", 2)


def Rz(t):
    return ca.vertcat(
        ca.horzcat(ca.cos(t), -ca.sin(t), 0),
        ca.horzcat(ca.sin(t), ca.cos(t), 0),
        ca.horzcat(0, 0, 1),
    )


def Rx(t):
    return ca.vertcat(
        ca.horzcat(1, 0, 0),
        ca.horzcat(0, ca.cos(t), -ca.sin(t)),
        ca.horzcat(0, ca.sin(t), ca.cos(t)),
    )


R1 = Rz(q[0])
R2 = R1 @ Rx(q[1])
pc1 = R1 @ ca.vertcat(r1, 0, 0)
pc2 = R1 @ ca.vertcat(L1, 0, 0) + R2 @ ca.vertcat(0, 0, -r2)
vc1 = ca.jtimes(pc1, q, v)
vc2 = ca.jtimes(pc2, q, v)
z1 = ca.vertcat(0, 0, v[0])
w2 = Rx(q[1]).T @ z1 + ca.vertcat(v[1], 0, 0)
J2 = ca.diag(ca.vertcat(Jx2, Jy2, Jz2))

K = 0.5 * m1 * ca.sumsqr(vc1) + 0.5 * Jz1 * v[0] ** 2
K += 0.5 * m2 * ca.sumsqr(vc2) + 0.5 * w2.T @ J2 @ w2
P = m1 * g * pc1[2] + m2 * g * pc2[2]
L = K - P

mass_matrix = ca.hessian(K, v)[0]
p = ca.gradient(L, v)
coriolis_torque = ca.jtimes(p, q, v) - ca.gradient(K, q)
gravity = -ca.gradient(L, q) + ca.gradient(K, q)
