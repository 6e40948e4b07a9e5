"""Elementary transforms in a row as in Corke's toolboxes, Jacobian and Hessian: lift, swing, pitch."""

import numpy as np

g = 9.81


def tx(eta=None):
    return "tx", eta


def ty(eta=None):
    return "ty", eta


def tz(eta=None):
    return "tz", eta


def ry(eta=None):
    return "ry", eta


def rz(eta=None):
    return "rz", eta


# Without a number it is the next joint.
ARM = [tz(0.214), tz(), tx(0.081), tz(0.057), rz(), tx(0.263), ty(0.042), ry()]
ENDS = (2, 5, 8)
COM = [
    [tx(0.026), ty(-0.013), tz(0.074)],
    [tx(0.138), ty(0.021), tz(0.018)],
    [tx(0.117), ty(-0.009), tz(0.023)],
]
MASS = [6.37, 3.18, 1.29]
INERTIA = [
    np.diag([0.0493, 0.0457, 0.0281]),
    np.diag([0.0067, 0.0294, 0.0283]),
    np.diag([0.0019, 0.0087, 0.0079]),
]


def matrix(kind, x):
    A = np.eye(4)
    if kind == "ry":
        A[0, 0] = A[2, 2] = np.cos(x)
        A[0, 2] = np.sin(x)
        A[2, 0] = -np.sin(x)
    elif kind == "rz":
        A[0, 0] = A[1, 1] = np.cos(x)
        A[0, 1] = -np.sin(x)
        A[1, 0] = np.sin(x)
    else:
        A["xyz".index(kind[1]), 3] = x
    return A


def slope(kind):
    """G of dA/dx = A G."""
    G = np.zeros((4, 4))
    if kind == "ry":
        G[0, 2], G[2, 0] = 1.0, -1.0
    elif kind == "rz":
        G[0, 1], G[1, 0] = -1.0, 1.0
    else:
        G["xyz".index(kind[1]), 3] = 1.0
    return G


def fkine(body, q, *wrt):
    """Pose of the body's centre of mass, or its derivative with respect to some joints."""
    T, joint = np.eye(4), 0
    for kind, eta in ARM[: ENDS[body]] + COM[body]:
        if eta is not None:
            T = T @ matrix(kind, eta)
            continue
        T = T @ matrix(kind, q[joint])
        for _ in range(wrt.count(joint)):
            T = T @ slope(kind)
        joint += 1
    return T


def vex(S):
    return np.array([S[2, 1] - S[1, 2], S[0, 2] - S[2, 0], S[1, 0] - S[0, 1]]) / 2


def jacob0(body, q):
    R = fkine(body, q)[:3, :3]
    J = np.zeros((6, 3))
    for j in range(body + 1):
        dT = fkine(body, q, j)
        J[:3, j] = dT[:3, 3]
        J[3:, j] = vex(dT[:3, :3] @ R.T)
    return J


def hessian0(body, q):
    R = fkine(body, q)[:3, :3]
    H = np.zeros((6, 3, 3))
    for j in range(body + 1):
        for k in range(body + 1):
            ddT = fkine(body, q, j, k)
            dRj, dRk = fkine(body, q, j)[:3, :3], fkine(body, q, k)[:3, :3]
            H[:3, j, k] = ddT[:3, 3]
            H[3:, j, k] = vex(ddT[:3, :3] @ R.T + dRj @ dRk.T)
    return H


def inertia(body, q):
    R = fkine(body, q)[:3, :3]
    return R @ INERTIA[body] @ R.T


def mass_matrix(q):
    M = np.zeros((3, 3))
    for b in range(3):
        J = jacob0(b, q)
        M += MASS[b] * J[:3].T @ J[:3] + J[3:].T @ inertia(b, q) @ J[3:]
    return M


def coriolis_torque(q, qd):
    h = np.zeros(3)
    for b in range(3):
        J, I = jacob0(b, q), inertia(b, q)
        Jd = hessian0(b, q) @ qd
        w = J[3:] @ qd
        h += MASS[b] * J[:3].T @ Jd[:3] @ qd
        h += J[3:].T @ (I @ Jd[3:] @ qd + np.cross(w, I @ w))
    return h


def gravity(q):
    G = np.zeros(3)
    for b in range(3):
        G += MASS[b] * g * jacob0(b, q)[2]
    return G
