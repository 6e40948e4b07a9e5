"""Lagrange with SymPy: shoulder, slide and wrist in a vertical plane."""

import sympy as sp

q1, q2, q3, v1, v2, v3 = sp.symbols("q1 q2 q3 v1 v2 v3")
m1, m2, m3, c1, c2, c3, I1, I2, I3, g = sp.symbols("m1 m2 m3 c1 c2 c3 I1 I2 I3 g")
parameters = {
    "m1": 3.0, "m2": 2.0, "m3": 1.0, "c1": 0.1, "c2": 0.25, "c3": 0.2,
    "I1": 0.05, "I2": 0.03, "I3": 0.01, "g": 9.81,
}
q = [q1, q2, q3]
v = [v1, v2, v3]

x1 = c1 * sp.cos(q1)
z1 = c1 * sp.sin(q1)
x2 = (q2 - c2) * sp.cos(q1)
z2 = (q2 - c2) * sp.sin(q1)
x3 = q2 * sp.cos(q1) + c3 * sp.cos(q1 + q3)
z3 = q2 * sp.sin(q1) + c3 * sp.sin(q1 + q3)

dx1 = sum(sp.diff(x1, a) * b for a, b in zip(q, v))
dz1 = sum(sp.diff(z1, a) * b for a, b in zip(q, v))
dx2 = sum(sp.diff(x2, a) * b for a, b in zip(q, v))
dz2 = sum(sp.diff(z2, a) * b for a, b in zip(q, v))
dx3 = sum(sp.diff(x3, a) * b for a, b in zip(q, v))
dz3 = sum(sp.diff(z3, a) * b for a, b in zip(q, v))

T = (
    m1 * (dx1**2 + dz1**2) / 2
    + m2 * (dx2**2 + dz2**2) / 2
    + m3 * (dx3**2 + dz3**2) / 2
    + I1 * v1**2 / 2
    + I2 * v1**2 / 2
    + I3 * (v1 + v3) ** 2 / 2
)
V = g * (m1 * z1 + m2 * z2 + m3 * z3)

mass_matrix = sp.Matrix(3, 3, lambda i, j: sp.diff(T, v[i], v[j]))
gravity = sp.Matrix([sp.diff(V, a) for a in q])
coriolis_torque = sp.Matrix([
    sum(sp.diff(T, v[i], q[j]) * v[j] for j in range(3)) - sp.diff(T, q[i]) for i in range(3)
])
