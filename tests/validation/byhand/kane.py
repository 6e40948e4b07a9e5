"""Kane's method in a vertical plane: partial velocities of two links, centres of mass beside the lines."""

from numpy import array, cos, dot, eye, sin, zeros

m_a, m_b = 2.0, 1.2
l_a = 0.35
x_a, y_a = 0.18, 0.02
x_b, y_b = 0.14, -0.03
J_a, J_b = 0.025, 0.009
g = 9.81


def partial(q):
    t, s = q[0], q[0] + q[1]
    A = array([-x_a * sin(t) - y_a * cos(t), x_a * cos(t) - y_a * sin(t)])
    E = array([-l_a * sin(t), l_a * cos(t)])
    B = array([-x_b * sin(s) - y_b * cos(s), x_b * cos(s) - y_b * sin(s)])
    zero = zeros(2)
    return [[A, zero], [E + B, B]]


def rest(q, u):
    t, s = q[0], q[0] + q[1]
    w = u[0] + u[1]
    A = -u[0] ** 2 * array([x_a * cos(t) - y_a * sin(t), x_a * sin(t) + y_a * cos(t)])
    E = -u[0] ** 2 * array([l_a * cos(t), l_a * sin(t)])
    B = -w**2 * array([x_b * cos(s) - y_b * sin(s), x_b * sin(s) + y_b * cos(s)])
    return [A, E + B]


def inverse_dynamics(q, u, du):
    V = partial(q)
    W = [[1.0, 0.0], [1.0, 1.0]]
    acc = rest(q, u)
    tau = zeros(2)
    for k, (m, J) in enumerate([(m_a, J_a), (m_b, J_b)]):
        a = acc[k] + V[k][0] * du[0] + V[k][1] * du[1]
        alpha = W[k][0] * du[0] + W[k][1] * du[1]
        for r in range(2):
            active = dot(V[k][r], array([0.0, -m * g]))
            inertial = -m * dot(V[k][r], a) - J * alpha * W[k][r]
            tau[r] -= active + inertial
    return tau


def mass_matrix(q):
    zero = zeros(2)
    return array([inverse_dynamics(q, zero, e) - inverse_dynamics(q, zero, zero) for e in eye(2)]).T
