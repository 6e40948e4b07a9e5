"""A spherical arm (turret, shoulder, slide) in SymPy, from its energies by Lagrange."""

import sympy as sp

q1, q2, q3, v1, v2, v3 = sp.symbols("q1 q2 q3 v1 v2 v3")
m2, m3, lc2, lc3, I1, I2, I3, h1, g = sp.symbols("m2 m3 lc2 lc3 I1 I2 I3 h1 g")

parameters = {
    "m2": 1.31,
    "m3": 0.72,
    "lc2": 0.13,
    "lc3": 0.21,
    "I1": 0.041,
    "I2": 0.023,
    "I3": 0.017,
    "h1": 0.35,
    "g": 9.81,
}

d11 = I1 + (I2 + I3) + (m2 * lc2**2 + m3 * (q3 - lc3) ** 2) * sp.cos(q2) ** 2
d22 = I2 + I3 + m2 * lc2**2 + m3 * (q3 - lc3) ** 2
mass_matrix = sp.Matrix([[d11, 0, 0], [0, d22, 0], [0, 0, m3]])

k = m2 * lc2**2 + m3 * (q3 - lc3) ** 2
coriolis_torque = sp.Matrix(
    [
        -2 * k * sp.sin(q2) * sp.cos(q2) * v1 * v2 + 2 * m3 * (q3 - lc3) * sp.cos(q2) ** 2 * v1 * v3,
        k * sp.sin(q2) * sp.cos(q2) * v1**2 + 2 * m3 * (q3 - lc3) * v2 * v3,
        -m3 * (q3 - lc3) * sp.cos(q2) ** 2 * v1**2 - m3 * (q3 - lc3) * v2**2,
    ]
)

potential_energy = m2 * g * (h1 + lc2 * sp.sin(q2)) + m3 * g * (h1 + (q3 - lc3) * sp.sin(q2))
gravity = sp.Matrix([potential_energy.diff(x) for x in (q1, q2, q3)])
