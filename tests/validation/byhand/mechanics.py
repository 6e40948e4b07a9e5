"""Kane's method with sympy.physics.mechanics: a column that turns and a beam that tilts, inertia dyadics."""

import numpy as np
import sympy as sm
from sympy.physics import mechanics as me

q1, q2, u1, u2 = me.dynamicsymbols("q1 q2 u1 u2")
ma, mb, a, h, b, c = sm.symbols("ma mb a h b c")
Ja, Ix, Iy, Iz, g = sm.symbols("Ja Ix Iy Iz g")
values = {ma: 4.4, mb: 2.3, a: 0.06, h: 0.37, b: 0.13, c: 0.27}
values |= {Ja: 0.052, Ix: 0.0064, Iy: 0.047, Iz: 0.0433, g: 9.81}

N = me.ReferenceFrame("N")
A = N.orientnew("A", "Axis", (q1, N.z))
B = A.orientnew("B", "Axis", (q2, A.y))
A.set_ang_vel(N, u1 * N.z)
B.set_ang_vel(A, u2 * A.y)

O = me.Point("O")
O.set_vel(N, 0)
Ao = O.locatenew("Ao", a * A.x)
P = O.locatenew("P", b * A.x + h * A.z)
Bo = P.locatenew("Bo", c * B.x)
Ao.v2pt_theory(O, N, A)
P.v2pt_theory(O, N, A)
Bo.v2pt_theory(P, N, B)

column = me.RigidBody("column", Ao, A, ma, (me.inertia(A, Ja, Ja, Ja), Ao))
beam = me.RigidBody("beam", Bo, B, mb, (me.inertia(B, Ix, Iy, Iz), Bo))
loads = [(Ao, -ma * g * N.z), (Bo, -mb * g * N.z)]
kinematic = [u1 - q1.diff(), u2 - q2.diff()]

kane = me.KanesMethod(N, q_ind=[q1, q2], u_ind=[u1, u2], kd_eqs=kinematic)
kane.kanes_equations([column, beam], loads)
state = (q1, q2, u1, u2)
M_of = sm.lambdify(state, kane.mass_matrix.subs(values))
f_of = sm.lambdify(state, kane.forcing.subs(values))


def inverse_dynamics(q, v, acc):
    return np.array(M_of(*q, *v)) @ acc - np.array(f_of(*q, *v))[:, 0]
