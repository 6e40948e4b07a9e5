"""Lagrange in SymPy as students write it: dynamicsymbols, one equation after the other."""

import sympy as sp
from sympy.physics.mechanics import dynamicsymbols

t = sp.symbols("t")
th1, th2 = dynamicsymbols("theta1 theta2")
M1, M2, L1, R1, R2, J1, J2, g = sp.symbols("M1 M2 L1 R1 R2 J1 J2 g", positive=True)

x1, y1 = R1 * sp.sin(th1), -R1 * sp.cos(th1)
x2 = L1 * sp.sin(th1) + R2 * sp.sin(th1 + th2)
y2 = -L1 * sp.cos(th1) - R2 * sp.cos(th1 + th2)

T1 = M1 * (x1.diff(t) ** 2 + y1.diff(t) ** 2) / 2 + J1 * th1.diff(t) ** 2 / 2
T2 = M2 * (x2.diff(t) ** 2 + y2.diff(t) ** 2) / 2 + J2 * (th1.diff(t) + th2.diff(t)) ** 2 / 2
V = M1 * g * y1 + M2 * g * y2
L = T1 + T2 - V

eq1 = L.diff(th1.diff(t)).diff(t) - L.diff(th1)
eq2 = L.diff(th2.diff(t)).diff(t) - L.diff(th2)

q1, q2, v1, v2, a1, a2 = sp.symbols("q1 q2 v1 v2 a1 a2")
values = [
    (th1.diff(t, 2), a1),
    (th2.diff(t, 2), a2),
    (th1.diff(t), v1),
    (th2.diff(t), v2),
    (th1, q1),
    (th2, q2),
]
inverse_dynamics = sp.Matrix([eq1, eq2]).subs(values)
parameters = {M1: 1.4, M2: 0.85, L1: 0.38, R1: 0.17, R2: 0.15, J1: 0.021, J2: 0.0093, g: 9.81}
