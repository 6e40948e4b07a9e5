"""A double pendulum, hanging, as CasADi expressions from its energies."""

import casadi as ca

q = ca.SX.sym("q", 2)
v = ca.SX.sym("v", 2)

m1 = 1.5
m2 = 1.0
l1 = 0.5
lc1 = 0.25
lc2 = 0.2
I1 = 0.03
I2 = 0.015
g = 9.81

s1 = ca.sin(q[0])
c1 = ca.cos(q[0])
s12 = ca.sin(q[0] + q[1])
c12 = ca.cos(q[0] + q[1])

p1 = ca.vertcat(lc1 * s1, -lc1 * c1)
p2 = ca.vertcat(l1 * s1 + lc2 * s12, -l1 * c1 - lc2 * c12)
J1 = ca.jacobian(p1, q)
J2 = ca.jacobian(p2, q)
w1 = ca.horzcat(1, 0)
w2 = ca.horzcat(1, 1)

mass_matrix = m1 * J1.T @ J1 + m2 * J2.T @ J2 + I1 * w1.T @ w1 + I2 * w2.T @ w2
h = m2 * l1 * lc2 * ca.sin(q[1])
coriolis_torque = ca.vertcat(-h * (2 * v[0] * v[1] + v[1] ** 2), h * v[0] ** 2)
gravity = ca.vertcat((m1 * lc1 + m2 * l1) * g * s1 + m2 * lc2 * g * s12, m2 * lc2 * g * s12)
