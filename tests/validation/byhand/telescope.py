"""Two turns and a slide in a vertical plane: Jacobians in SymPy, functions by lambdify."""

import numpy as np
import sympy as sp

q1, q2, d3 = q = sp.symbols("q1 q2 d3")
v1, v2, v3 = v = sp.symbols("v1 v2 v3")
m1, m2, m3, l1, r1, r2, e3, J1, J2, J3, g0 = sp.symbols("m1 m2 m3 l1 r1 r2 e3 J1 J2 J3 g0")
numbers = {"m1": 2.4, "m2": 1.3, "m3": 0.7, "l1": 0.36, "r1": 0.17, "r2": 0.11, "e3": 0.19, "g0": 9.81}
numbers |= {"J1": 0.03, "J2": 0.012, "J3": 0.003}

a = q1 + q2
elbow = sp.Matrix([l1 * sp.cos(q1), l1 * sp.sin(q1)])
c1 = sp.Matrix([r1 * sp.cos(q1), r1 * sp.sin(q1)])
c2 = elbow + sp.Matrix([r2 * sp.cos(a), r2 * sp.sin(a)])
c3 = elbow + sp.Matrix([(e3 + d3) * sp.cos(a), (e3 + d3) * sp.sin(a)])
w1 = sp.Matrix([[1, 0, 0]])
w2 = sp.Matrix([[1, 1, 0]])

D = J1 * w1.T * w1 + (J2 + J3) * w2.T * w2
for m, c in ((m1, c1), (m2, c2), (m3, c3)):
    J = c.jacobian(q)
    D += m * J.T * J
V = g0 * (m1 * c1[1] + m2 * c2[1] + m3 * c3[1])


def christoffel(i, j, k):
    return (sp.diff(D[k, j], q[i]) + sp.diff(D[k, i], q[j]) - sp.diff(D[i, j], q[k])) / 2


C = sp.Matrix(3, 3, lambda k, j: sum(christoffel(i, j, k) * v[i] for i in range(3)))
G = sp.Matrix([sp.diff(V, x) for x in q])

D_function = sp.lambdify(q, D.subs(numbers), "numpy")
C_function = sp.lambdify(q + v, C.subs(numbers), "numpy")
G_function = sp.lambdify(q, G.subs(numbers), "numpy")


def mass_matrix(x):
    return np.asarray(D_function(*x), dtype=float)


def coriolis_matrix(x, u):
    return np.asarray(C_function(*x, *u), dtype=float)


def gravity(x):
    return np.asarray(G_function(*x), dtype=float)[:, 0]
