"""Two pendulums on a cart in SymPy: D from the Jacobians of the positions, C in a loop of Christoffel's."""

import sympy as sp

q1, q2, q3, v1, v2, v3 = sp.symbols("q1 q2 q3 v1 v2 v3")
m1, m2, m3, l2, lc2, lc3, I2, I3, g = sp.symbols("m1 m2 m3 l2 lc2 lc3 I2 I3 g")
parameters = {
    "m1": 1.9,
    "m2": 0.7,
    "m3": 0.4,
    "l2": 0.45,
    "lc2": 0.21,
    "lc3": 0.16,
    "I2": 0.015,
    "I3": 0.012,
    "g": 9.81,
}

Q = [q1, q2, q3]
V = [v1, v2, v3]
x2 = q1 + lc2 * sp.sin(q2)
y2 = -lc2 * sp.cos(q2)
x3 = q1 + l2 * sp.sin(q2) + lc3 * sp.sin(q2 + q3)
y3 = -l2 * sp.cos(q2) - lc3 * sp.cos(q2 + q3)
J2 = sp.Matrix([x2, y2]).jacobian(Q)
J3 = sp.Matrix([x3, y3]).jacobian(Q)
cart = sp.Matrix([[m1, 0, 0], [0, 0, 0], [0, 0, 0]])
turns = sp.Matrix([[0, 0, 0], [0, I2 + I3, I3], [0, I3, I3]])
mass_matrix = cart + m2 * J2.T * J2 + m3 * J3.T * J3 + turns

coriolis_matrix = sp.zeros(3, 3)
for i in range(3):
    for j in range(3):
        for k in range(3):
            c = mass_matrix[i, j].diff(Q[k]) + mass_matrix[i, k].diff(Q[j]) - mass_matrix[j, k].diff(Q[i])
            coriolis_matrix[i, j] += c * V[k] / 2

potential_energy = m2 * g * y2 + m3 * g * y3
gravity = sp.Matrix([potential_energy]).jacobian(Q)
