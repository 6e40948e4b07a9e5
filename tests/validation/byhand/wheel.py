"""A cart with a pole and a reaction wheel in CasADi's MX: Lagrange by jtimes, acceleration solved for."""

import casadi as ca
import numpy as np


class CartPoleWheel:
    def __init__(self, M=1.9, mp=0.34, mw=0.27, l=0.46, lp=0.21, Jp=0.0079, Jw=0.00062, g=9.81):
        q = ca.MX.sym("q", 3)
        dq = ca.MX.sym("dq", 3)
        u = ca.MX.sym("u", 3)
        x, th = q[0], q[1]
        dth, dphi = dq[1], dq[2]

        pole = ca.vertcat(x + lp * ca.sin(th), lp * ca.cos(th))
        wheel = ca.vertcat(x + l * ca.sin(th), l * ca.cos(th))
        vpole = ca.jtimes(pole, q, dq)
        vwheel = ca.jtimes(wheel, q, dq)

        T = 0.5 * M * dq[0] ** 2
        T += 0.5 * mp * ca.sumsqr(vpole) + 0.5 * Jp * dth**2
        T += 0.5 * mw * ca.sumsqr(vwheel) + 0.5 * Jw * (dth + dphi) ** 2
        V = g * (mp * pole[1] + mw * wheel[1])

        momentum = ca.gradient(T, dq)
        H = ca.jacobian(momentum, dq)
        bias = ca.jtimes(momentum, q, dq) - ca.gradient(T - V, q)
        ddq = ca.solve(H, u - bias)
        self.fd = ca.Function("fd", [q, dq, u], [ddq])
        self.h = ca.Function("h", [q], [H])


model = CartPoleWheel()


def forward_dynamics(q, v, tau):
    return np.array(model.fd(q, v, tau)).flatten()


def mass_matrix(q):
    return np.array(model.h(q))
