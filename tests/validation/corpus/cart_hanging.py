"""A load that swings under a crab (SymPy, Lagrange with its second derivatives written out)."""

from sympy import Matrix, cos, diff, sin, symbols

q1, q2, v1, v2 = symbols("q1 q2 v1 v2")
M, m, r, J, g = symbols("M m r J g")

parameters = {"M": 2.2, "m": 0.64, "r": 0.42, "J": 0.012, "g": 9.81}

x = q1 - r * sin(q2)
z = r * cos(q2)
dx = v1 * diff(x, q1) + v2 * diff(x, q2)
dz = v2 * diff(z, q2)
kinetic_energy = M * v1**2 / 2 + m * (dx**2 + dz**2) / 2 + J * v2**2 / 2
potential_energy = m * g * z
mass_matrix = Matrix([[M + m, -m * r * cos(q2)], [-m * r * cos(q2), J + m * r**2]])
coriolis_torque = Matrix([m * r * sin(q2) * v2**2, 0])
gravity = Matrix([0, -m * g * r * sin(q2)])
