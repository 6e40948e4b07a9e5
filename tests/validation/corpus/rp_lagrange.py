"""A polar arm in SymPy from its kinetic energy: D by second derivatives, C by Christoffel in lists."""

from sympy import Matrix, cos, diff, sin, symbols

q = q1, q2 = symbols("q1 q2")
v = v1, v2 = symbols("v1 v2")
m1, m2, lc1, lc2, I1, I2, g = symbols("m1 m2 lc1 lc2 I1 I2 g")
parameters = {"m1": 1.6, "m2": 0.8, "lc1": 0.22, "lc2": 0.14, "I1": 0.019, "I2": 0.012, "g": 9.81}

reach = q2 - lc2
x1, y1 = lc1 * cos(q1), lc1 * sin(q1)
x2, y2 = reach * cos(q1), reach * sin(q1)
speeds = [diff(p, q1) * v1 + diff(p, q2) * v2 for p in (x1, y1, x2, y2)]
kinetic_energy = (
    m1 * (speeds[0] ** 2 + speeds[1] ** 2) / 2
    + m2 * (speeds[2] ** 2 + speeds[3] ** 2) / 2
    + (I1 + I2) * v1**2 / 2
)
potential_energy = m1 * g * y1 + m2 * g * y2
D = Matrix([[diff(kinetic_energy, a, b) for a in v] for b in v])
mass_matrix = D
rows = []
for k in range(2):
    row = 0
    for i in range(2):
        for j in range(2):
            symbol = (diff(D[k, j], q[i]) + diff(D[k, i], q[j]) - diff(D[i, j], q[k])) / 2
            row += symbol * v[i] * v[j]
    rows.append(row)
coriolis_torque = Matrix(rows)
gravity = Matrix([diff(potential_energy, a) for a in q])
