"""A planar crane: boom, telescope and hook arm in a vertical plane, as one inverse dynamics."""

import numpy as np

m1 = 3.2
m2 = 1.9
m3 = 0.8
lc1 = 0.33
lc2 = 0.21
lc3 = 0.18
I1 = 0.11
I2 = 0.062
I3 = 0.014
g = 9.81


def inverse_dynamics(q, v, a):
    r = q[1]
    c3, s3 = np.cos(q[2]), np.sin(q[2])
    x = r - lc2
    d33 = I3 + m3 * lc3**2
    d13 = d33 + m3 * r * lc3 * c3
    d11 = I1 + I2 + m1 * lc1**2 + m2 * x**2 + m3 * r**2 + 2 * m3 * r * lc3 * c3 + d33
    d12 = -m3 * lc3 * s3
    d22 = m2 + m3
    d23 = -m3 * lc3 * s3
    w3 = v[0] + v[2]
    h1 = 2 * (m2 * x + m3 * r + m3 * lc3 * c3) * v[0] * v[1] - m3 * r * lc3 * s3 * (
        2 * v[0] * v[2] + v[2] ** 2
    )
    h2 = -(m2 * x + m3 * r) * v[0] ** 2 - m3 * lc3 * c3 * w3**2
    h3 = m3 * r * lc3 * s3 * v[0] ** 2 + 2 * m3 * lc3 * c3 * v[0] * v[1]
    c1, c13 = np.cos(q[0]), np.cos(q[0] + q[2])
    g1 = (m1 * lc1 + m2 * x + m3 * r) * g * c1 + m3 * lc3 * g * c13
    g2 = (m2 + m3) * g * np.sin(q[0])
    g3 = m3 * g * lc3 * c13
    t1 = d11 * a[0] + d12 * a[1] + d13 * a[2] + h1 + g1
    t2 = d12 * a[0] + d22 * a[1] + d23 * a[2] + h2 + g2
    t3 = d13 * a[0] + d23 * a[1] + d33 * a[2] + h3 + g3
    return np.array([t1, t2, t3])
