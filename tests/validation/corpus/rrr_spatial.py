"""A turret with an upper arm and a forearm by energies: the joints' own velocities, body by body."""

import numpy as np

I1 = 0.041
m2 = 1.05
m3 = 0.62
l2 = 0.36
lc2 = 0.17
lc3 = 0.14
Ix2 = 0.011
Iy2 = 0.019
Ix3 = 0.012
Iy3 = 0.016
g = 9.81


def kinetic_energy(q, v):
    c2, s2 = np.cos(q[1]), np.sin(q[1])
    c23, s23 = np.cos(q[1] + q[2]), np.sin(q[1] + q[2])
    w1, w2, w23 = v[0], v[1], v[1] + v[2]
    # Upper arm: the turret's speed is split into its roll and its yaw.
    roll2, yaw2 = w1 * s2, w1 * c2
    T2 = m2 * ((lc2 * c2 * w1) ** 2 + (lc2 * w2) ** 2)
    T2 += Ix2 * roll2**2 + Iy2 * (w2**2 + yaw2**2)
    # Forearm: how fast its centre of mass goes out, up and around.
    out = -l2 * s2 * w2 - lc3 * s23 * w23
    up = l2 * c2 * w2 + lc3 * c23 * w23
    around = (l2 * c2 + lc3 * c23) * w1
    roll3, yaw3 = w1 * s23, w1 * c23
    T3 = m3 * (out**2 + up**2 + around**2)
    T3 += Ix3 * roll3**2 + Iy3 * (w23**2 + yaw3**2)
    return (I1 * w1**2 + T2 + T3) / 2


def potential_energy(q):
    height2 = lc2 * np.sin(q[1])
    height3 = l2 * np.sin(q[1]) + lc3 * np.sin(q[1] + q[2])
    return g * (m2 * height2 + m3 * height3)
