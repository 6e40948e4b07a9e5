"""A spherical arm (turret, shoulder, an arm that slides), term by term as papers print them."""

from numpy import array, cos, sin, zeros

m2 = 1.6
m3 = 0.8
lc2 = 0.15
lc3 = 0.21
I1 = 0.05
I2 = 0.03
I3 = 0.02
h1 = 0.35
g = 9.81


def swung(q):
    return m2 * lc2**2 + m3 * (q[2] - lc3) ** 2


def D(q):
    A, I23 = swung(q), I2 + I3
    M = zeros((3, 3))
    M[0, 0] = I1 + I23 + A * cos(q[1]) ** 2
    M[1, 1] = I23 + A
    M[2, 2] = m3
    return M


def C(q, dq):
    rho = q[2] - lc3
    half = swung(q) * sin(q[1]) * cos(q[1])
    c112 = -half
    c113 = m3 * rho * cos(q[1]) ** 2
    c223 = m3 * rho
    return array(
        [
            [c112 * dq[1] + c113 * dq[2], c112 * dq[0], c113 * dq[0]],
            [-c112 * dq[0], c223 * dq[2], c223 * dq[1]],
            [-c113 * dq[0], -c223 * dq[1], 0],
        ]
    )


def G(q):
    rho = q[2] - lc3
    return array([0, g * cos(q[1]) * (m2 * lc2 + m3 * rho), m3 * g * sin(q[1])])


def forward_kinematics(q):
    reach, z = q[2] * cos(q[1]), h1 + q[2] * sin(q[1])
    return array([reach * cos(q[0]), reach * sin(q[0]), z])
