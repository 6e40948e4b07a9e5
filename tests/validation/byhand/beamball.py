"""A ball on a beam as x' = f(t, x, u), written for solve_ivp; only the beam has a motor."""

import numpy as np

p = dict(J=0.085, M=1.1, d=0.04, m=0.11, R=0.015, g=9.81)


def f(t, x, u):
    theta, r, omega, rdot = x
    J, M, d, m, g = p["J"], p["M"], p["d"], p["m"], p["g"]
    total = J + M * d**2 + m * r**2
    wdot = (u - 2 * m * r * rdot * omega - (M * d + m * r) * g * np.cos(theta)) / total
    return [omega, rdot, wdot, r * omega**2 - g * np.sin(theta)]


def forward_dynamics(q, v, tau):
    return np.array(f(0.0, np.r_[q, v], tau[0])[2:])
