"""A cart with a double inverted pendulum, as matlabFunction writes it: numbered temporaries."""

from math import cos, sin

mc, m1, m2 = 1.5, 0.6, 0.4
L1, a1, a2 = 0.5, 0.25, 0.2
J1, J2 = 0.0125, 0.006
g = 9.81


def mass_matrix(in1):
    q2 = in1[1]
    q3 = in1[2]
    t2 = cos(q2)
    t3 = cos(q3)
    t4 = q2 + q3
    t5 = a2**2
    t6 = L1**2
    t7 = cos(t4)
    t8 = m2 * t5
    t9 = a2 * m2 * t7
    t10 = L1 * a2 * m2 * t3
    t11 = (a1 * m1 + L1 * m2) * t2 + t9
    t12 = J2 + t8 + t10
    t13 = J1 + J2 + a1**2 * m1 + m2 * t6 + t8 + 2.0 * t10
    return [[mc + m1 + m2, t11, t9], [t11, t13, t12], [t9, t12, J2 + t8]]


def coriolis_torque(in1, in2):
    q2 = in1[1]
    q3 = in1[2]
    dq2 = in2[1]
    dq3 = in2[2]
    t2 = sin(q2)
    t3 = sin(q3)
    t4 = q2 + q3
    t5 = dq2 + dq3
    t6 = sin(t4)
    t7 = dq2**2
    t8 = L1 * a2 * m2 * t3
    t9 = a2 * m2 * t5**2 * t6
    return [-t2 * t7 * (a1 * m1 + L1 * m2) - t9, -dq3 * t8 * (2.0 * dq2 + dq3), t7 * t8]


def gravity(in1):
    q2 = in1[1]
    q3 = in1[2]
    t2 = a2 * g * m2 * sin(q2 + q3)
    return [0.0, -g * sin(q2) * (a1 * m1 + L1 * m2) - t2, -t2]
