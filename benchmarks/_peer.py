"""What every peer shares: the law in plain NumPy, the URDF as all of them read it, what a run records.

Written without armgpi's controller, plant or loop, so that equal trajectories say something about both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Trajectory(NamedTuple):
    """What a run recorded at every sample, and where it ended; arrays of shape (steps, ..., n).

    Attributes:
        q: positions [rad].
        v: velocities [rad/s].
        tau: torques held from this sample to the next [N m].
        q_end: positions after the last step [rad], shape (..., n).
    """

    q: Array
    v: Array
    tau: Array
    q_end: Array


class Law:
    """The bumpless GPI law by the trapezoidal rule, in plain NumPy and as few operations as armgpi's.

    v = -(beta3 e + lam + eta), lam' = b e + chi, chi' = c e, eta' = -beta4 eta + d e. What the present
    error adds to lam, chi and eta is in the factor `direct`, so each state is updated once a sample. With
    zeta_c = 1 and p_c = omega_c all poles are at -omega_c, and the betas are binomial.
    """

    def __init__(self, omega: float, dt: float, hold: Array) -> None:
        """Start so that v = `hold` while the error is zero."""
        beta0, beta1, beta2, beta3, beta4 = (math.comb(5, k) * omega ** (5 - k) for k in range(5))
        b = (beta1 - beta0 / beta4) / beta4
        c = beta0 / beta4
        d = (-beta3 * beta4**3 + beta2 * beta4**2 - beta1 * beta4 + beta0) / beta4**2
        half = 0.5 * dt
        decay = (1.0 - half * beta4) / (1.0 + half * beta4)
        filtered = half * d / (1.0 + half * beta4)
        # 0-d arrays, which NumPy multiplies faster than Python numbers.
        self._direct = np.array(-(beta3 + half * b + half * half * c + filtered))
        self._to_lam = np.array(dt * (b + dt * c))
        self._to_chi = np.array(dt * c)
        self._to_eta = np.array((1.0 + decay) * filtered)
        self._decay = np.array(decay)
        self._dt = np.array(dt)
        self._lam = -hold
        self._chi = np.zeros_like(hold)
        self._eta = np.zeros_like(hold)

    def step(self, e: Array) -> Array:
        """Return the virtual acceleration for the error `e`."""
        v = self._direct * e - self._lam - self._eta
        self._lam = self._lam + self._dt * self._chi + self._to_lam * e
        self._chi = self._chi + self._to_chi * e
        self._eta = self._decay * self._eta + self._to_eta * e
        return v


def bare_urdf(urdf: str, fixed: Sequence[str]) -> str:
    """Return a URDF of bodies and joints only, without friction, and the joints of `fixed` held at zero."""
    root = ElementTree.fromstring(urdf)
    for link in root.findall("link"):
        for child in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(child)
    for joint in root.findall("joint"):
        for child in [*joint.findall("dynamics"), *joint.findall("safety_controller")]:
            joint.remove(child)
        if joint.get("name") in fixed:
            joint.set("type", "fixed")
            for child in joint.findall("mimic"):
                joint.remove(child)
    for other in [*root.findall("transmission"), *root.findall("gazebo")]:
        root.remove(other)
    return ElementTree.tostring(root, encoding="unicode")


def refuse_cut(cut: Array) -> None:
    """Refuse a torque that had to be cut, or is NaN: the anti-windup for it is not written here."""
    if np.count_nonzero(cut):
        raise RuntimeError("a peer's run asks for more torque than the arm has, or for NaN")
