"""Two links whose centres of mass lie beside their lines, as MATLAB's codegen writes it."""

import numpy as np

ma = 2.75
mb = 1.15
L = 0.33
ax = 0.16
ay = 0.035
bx = 0.12
by = -0.028
Ia = 0.027
Ib = 0.0074
g = 9.81


def inverse_dynamics(q, qd, qdd):
    t2 = np.cos(q[1])
    t3 = np.sin(q[1])
    t4 = q[0] + q[1]
    t5 = np.cos(t4)
    t6 = np.sin(t4)
    t7 = L * (bx * t2 - by * t3)
    t8 = L * (bx * t3 + by * t2)
    t9 = Ib + mb * (bx**2 + by**2)
    t10 = t9 + mb * t7
    t11 = Ia + ma * (ax**2 + ay**2) + mb * L**2 + t10 + mb * t7
    t12 = mb * g * (bx * t5 - by * t6)
    t13 = g * (ma * (ax * np.cos(q[0]) - ay * np.sin(q[0])) + mb * L * np.cos(q[0]))
    t14 = mb * t8
    tau1 = t11 * qdd[0] + t10 * qdd[1] - t14 * (2 * qd[0] * qd[1] + qd[1] ** 2) + t13 + t12
    tau2 = t10 * qdd[0] + t9 * qdd[1] + t14 * qd[0] ** 2 + t12
    return np.array([tau1, tau2])
