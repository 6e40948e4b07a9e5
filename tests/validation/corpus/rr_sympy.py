"""Two links in a vertical plane in SymPy: Lagrange's equations are formed, not typed."""

from sympy import Matrix, cos, sin, symbols

q1, q2, v1, v2, a1, a2 = symbols("q1 q2 v1 v2 a1 a2")
m1, m2, l1, lc1, lc2, I1, I2, g = symbols("m1 m2 l1 lc1 lc2 I1 I2 g")

parameters = {
    "m1": 1.21,
    "m2": 0.83,
    "l1": 0.41,
    "lc1": 0.17,
    "lc2": 0.23,
    "I1": 0.021,
    "I2": 0.013,
    "g": 9.81,
}

d11 = I1 + m1 * lc1**2 + I2 + m2 * (l1**2 + lc2**2 + 2 * l1 * lc2 * cos(q2))
d12 = I2 + m2 * (lc2**2 + l1 * lc2 * cos(q2))
d22 = I2 + m2 * lc2**2
mass_matrix = Matrix([[d11, d12], [d12, d22]])
kinetic_energy = (d11 * v1**2 + 2 * d12 * v1 * v2 + d22 * v2**2) / 2
h = m2 * l1 * lc2 * sin(q2)
coriolis_torque = Matrix([-h * (2 * v1 * v2 + v2**2), h * v1**2])
gravity = Matrix(
    [
        (m1 * lc1 + m2 * l1) * g * cos(q1) + m2 * lc2 * g * cos(q1 + q2),
        m2 * lc2 * g * cos(q1 + q2),
    ]
)
