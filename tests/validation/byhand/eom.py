"""Arm on a slide, by Lagrange in SymPy with functions of time; coefficients taken out of the equations."""

import sympy as sp
from sympy.physics.mechanics import dynamicsymbols

t = sp.Symbol("t")
x, th = dynamicsymbols("x theta")
xd, thd = x.diff(t), th.diff(t)
mc, mp, lp, Jp, grav = sp.symbols("m_c m_p l_p J_p g", positive=True)

# position of the bob, the slide along x, theta from hanging down
px = x + lp * sp.sin(th)
pz = -lp * sp.cos(th)
KE = mc * xd**2 / 2 + mp * (px.diff(t) ** 2 + pz.diff(t) ** 2) / 2 + Jp * thd**2 / 2
PE = mp * grav * pz
L = KE - PE

q1, q2, v1, v2, a1, a2 = sp.symbols("q1 q2 v1 v2 a1 a2")
tau = []
for c, cd in ((x, xd), (th, thd)):
    eq = L.diff(cd).diff(t) - L.diff(c)
    eq = eq.subs({xd.diff(t): a1, thd.diff(t): a2}).subs({xd: v1, thd: v2}).subs({x: q1, th: q2})
    tau.append(sp.expand(eq))

values = {mc: 2.3, mp: 0.62, lp: 0.34, Jp: 0.019, grav: 9.81}
M = sp.Matrix(2, 2, lambda i, j: tau[i].coeff((a1, a2)[j])).subs(values)
rest = [e.subs({a1: 0, a2: 0}) for e in tau]
G = sp.Matrix([r.subs({v1: 0, v2: 0}) for r in rest]).subs(values)
h = sp.Matrix(rest).subs(values) - G

_M = sp.lambdify((q1, q2), M)
_G = sp.lambdify((q1, q2), G)
_h = sp.lambdify((q1, q2, v1, v2), h)


def mass_matrix(q):
    return _M(*q)


def gravity(q):
    return _G(*q).ravel()


def coriolis_torque(q, v):
    return _h(*q, *v).ravel()
