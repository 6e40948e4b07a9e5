"""Three links in a vertical plane: a base class differentiates, the arm has M and V alone."""

import numpy as np


class Manipulator:
    """C from M and G from V by complex steps."""

    h = 1e-30

    def dM(self, q):
        steps = q + 1j * self.h * np.eye(self.n)
        return np.array([self.M(step).imag / self.h for step in steps])

    def C(self, q, v):
        d = self.dM(q)
        return 0.5 * (
            np.einsum("kij,k->ij", d, v) + np.einsum("jik,k->ij", d, v) - np.einsum("ijk,k->ij", d, v)
        )

    def G(self, q):
        return np.array([self.V(q + 1j * self.h * e).imag / self.h for e in np.eye(self.n)])


class Planar(Manipulator):
    n = 3
    lengths = (0.45, 0.35, 0.2)
    masses = (2.4, 1.5, 0.7)
    centres = (0.22, 0.16, 0.11)
    moments = (0.045, 0.018, 0.0035)
    field = 9.81

    def points(self, q):
        at, out = 0.0, []
        for length, centre, angle in zip(self.lengths, self.centres, np.cumsum(q)):
            ray = np.array([np.cos(angle), np.sin(angle)])
            out.append(at + centre * ray)
            at = at + length * ray
        return out

    def jacobians(self, q):
        phi = np.cumsum(q)
        for k in range(self.n):
            J = np.zeros((2, self.n), dtype=complex)
            for j in range(k + 1):
                for i in range(j, k + 1):
                    reach = self.centres[i] if i == k else self.lengths[i]
                    J[:, j] += reach * np.array([-np.sin(phi[i]), np.cos(phi[i])])
            yield J

    def M(self, q):
        total = np.zeros((self.n, self.n), dtype=complex)
        for k, J in enumerate(self.jacobians(q)):
            spin = (np.arange(self.n) <= k).astype(float)
            total = total + self.masses[k] * J.T @ J + self.moments[k] * np.outer(spin, spin)
        return total

    def V(self, q):
        return sum(m * self.field * p[1] for m, p in zip(self.masses, self.points(q)))


arm = Planar()


def mass_matrix(q):
    return arm.M(q).real


def coriolis_matrix(q, v):
    return arm.C(q, v)


def gravity(q):
    return arm.G(q)
