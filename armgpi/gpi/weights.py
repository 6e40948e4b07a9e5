"""Initial weights of the networks: what a search found off line, as in section 4 of the paper."""

from __future__ import annotations

from typing import Any

from armgpi.base.parameter import Parametrised, parameter, with_parameters


@with_parameters
class Weights(Parametrised):
    """Initial weights of the basis functions of :class:`armgpi.BSplineNetwork`, for each tuning parameter.

    Each is a list with a number per basis function, a list of those with one per joint, (n, size), or one
    per rollout and joint, (batch, n, size). The functions of the error come first, then those of its
    derivative.

    Attributes:
        omega_c: of the natural frequency; zero when not given.
        zeta_c: of the damping ratio; likewise.
        p_c: of the real pole; likewise.
    """

    omega_c: Any = parameter(
        "initial weights of the natural frequency, per joint and basis function",
        unit="rad/s",
        kind="table",
        default=None,
        none="zero",
        per_joint=True,
        key="omega",
        search=(-40.0, 40.0),
    )
    zeta_c: Any = parameter(
        "initial weights of the damping ratio",
        kind="table",
        default=None,
        none="zero",
        per_joint=True,
        key="zeta",
        search=(-0.5, 0.5),
    )
    p_c: Any = parameter(
        "initial weights of the real pole",
        unit="rad/s",
        kind="table",
        default=None,
        none="zero",
        per_joint=True,
        key="p",
        search=(-40.0, 40.0),
    )
