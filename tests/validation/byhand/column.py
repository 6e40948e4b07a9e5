"""A turning column with a lift and a tilting beam: Lagrange in SymPy, functions made by lambdify."""

import numpy as np
import sympy as sp
from sympy.physics.mechanics import dynamicsymbols

t = sp.Symbol("t")
th, z, ph = dynamicsymbols("th z ph")
m2, m3, b, a, c, I1, I2, I3, g = sp.symbols("m2 m3 b a c I1 I2 I3 g")
values = {m2: 3.0, m3: 2.0, b: 0.05, a: 0.15, c: 0.3, I1: 0.2, I2: 0.04, I3: 0.06, g: 9.81}

x = sp.Matrix([th, z, ph])
dx = x.diff(t)
p2 = sp.Matrix([b * sp.cos(th), b * sp.sin(th), z])
p3 = sp.Matrix([
    (a + c * sp.cos(ph)) * sp.cos(th),
    (a + c * sp.cos(ph)) * sp.sin(th),
    z + c * sp.sin(ph),
])
v2 = p2.diff(t)
v3 = p3.diff(t)
T = m2 * v2.dot(v2) / 2 + m3 * v3.dot(v3) / 2
T += (I1 + I2) * th.diff(t) ** 2 / 2 + I3 * (th.diff(t) ** 2 + ph.diff(t) ** 2) / 2
U = g * (m2 * p2[2] + m3 * p3[2])

M = sp.hessian(T, list(dx))
C = sp.zeros(3, 3)
for i in range(3):
    for j in range(3):
        for k in range(3):
            C[i, j] += (M[i, j].diff(x[k]) + M[i, k].diff(x[j]) - M[j, k].diff(x[i])) / 2 * dx[k]
G = sp.Matrix([U.diff(s) for s in x])

plain = list(sp.symbols("q1:4"))
speeds = list(sp.symbols("v1:4"))
M, C, G = (e.subs(values).subs(dict(zip(dx, speeds))).subs(dict(zip(x, plain))) for e in (M, C, G))
M_of = sp.lambdify([plain], M)
C_of = sp.lambdify([plain, speeds], C)
G_of = sp.lambdify([plain], G)


def mass_matrix(q):
    return np.array(M_of(q), dtype=float)


def coriolis_matrix(q, v):
    return np.array(C_of(q, v), dtype=float)


def gravity(q):
    return np.array(G_of(q), dtype=float).ravel()
