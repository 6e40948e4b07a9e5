"""Which terms the logs of an arm ask for: widths of friction, elastic joints, more friction, motors, lags."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.identification import estimate
from armgpi.identification.elastic import MOST_SOFT, SOFT, Twist, knows_stiffness
from armgpi.identification.estimate import Fit, Prior
from armgpi.identification.moments import FRICTIONS, Coupled, Moments
from armgpi.identification.posterior import with_parameters
from armgpi.identification.weak_form import COLUMNS
from armgpi.robot.robot import Robot

#: Widths over which the sign of velocity may be smoothed [rad/s or m/s].
WIDTHS = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2)
#: Rounds in which the lag settles: it enters almost linearly.
_LAG_ROUNDS = 3
#: A lag or a friction of each joint has to explain so much of the residual's power that is left without.
_WORTH = 0.1
#: Residual over torque from which there is anything for another friction to explain.
_SEEN = 5e-3
#: A motor that turns with its neighbour's joint is taken where it explains so much of what is left of either.
_COUPLED = 0.3
#: Elastic joints are taken where they explain so much of what is left, all joints together (geometric mean of
#: powers), or where their stiffness is known. The first share is for a known side of the encoders, the second
#: for an unknown one, as then more is free to fit. Soft arms had 52 % and more, stiff ones with sharp
#: friction 35 % and less; the first share was chosen on two logs of soft Pandas.
_ELASTIC = 0.45
_ELASTIC_BLIND = 0.8
#: Rounds in which the twist of the gears settles, and the change of a compliance that ends them, as a share.
_TWIST_ROUNDS = 8
_TWIST_SETTLED = 2e-2


def fit_with_terms(data: Moments) -> tuple[Fit, Prior]:
    """Return the fit of some logs, with the terms of friction, motors and lags that they ask for."""
    data.forget_terms()
    lag = _settle(data, np.zeros(data.robot.n))
    data.width = _choose_widths(data, lag)
    lag = _choose_elasticity(data, lag)
    _choose_frictions(data, lag)
    _choose_couplings(data, lag)
    lag = _settle(data, lag)
    if data.twist is not None:
        lag, _ = _settle_twist(data, data.twist, lag)
    fitted, prior = _with_lags(data, lag)
    if data.twist is not None:
        theta = prior.mean + prior.std * fitted.physical
        compliance = theta[: -data.lags][-data.robot.n :]
        data.set_twist(_twist_of(data, fitted, lag, data.twist.side, compliance))
    return fitted, prior


def shares(residuals: Sequence[Array], torques: Sequence[Array]) -> Array:
    """Return residual over torque of each joint, root mean squares, (n,); NaN of one that stood still."""
    residual = np.concatenate(list(residuals))
    torque = np.where(np.isfinite(residual), np.concatenate(list(torques)), np.nan)
    power_of_residual = np.nansum(residual**2, axis=0)
    power = np.nansum(torque**2, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sqrt(power_of_residual / np.where(power > 0.0, power, np.nan)))


def _free_fit(data: Moments, lag: Array, width: Array | None = None) -> Fit:
    """Return the fit around a lag [s], (n,), whose unknowns need not be physical."""
    return estimate.fit(data.blocks(lag, width), data.prior, physical=False)


def _settle(data: Moments, lag: Array) -> Array:
    """Return the lag around which the regression is linear [s], (n,)."""
    for _ in range(_LAG_ROUNDS):
        prior = data.prior
        theta = prior.mean + prior.std * _free_fit(data, lag).free
        lag = np.broadcast_to(theta[-data.lags :], data.robot.n).copy()
    return lag


def _choose_widths(data: Moments, lag: Array) -> Array:
    """Return the width of the sign of each joint that leaves the least residual."""
    powers = []
    for width in WIDTHS:
        fitted = _free_fit(data, lag, np.full(data.robot.n, width))
        powers.append(_power(fitted))
    best = np.argmin(powers, axis=0)
    return np.asarray(np.array(WIDTHS)[best], dtype=np.float64)


class _ElasticFit(NamedTuple):
    """A fit with elastic joints.

    Attributes:
        explained: share of what stiff joints leave of the torques that it explains (geometric mean).
        twist: what the twist of the gears is computed from.
        lag: of positions behind torques [s], (n,).
    """

    explained: float
    twist: Twist
    lag: Array


def _choose_elasticity(data: Moments, lag: Array) -> Array:
    """Take the joints for elastic ones where they are soft; return the lag then [s], (n,).

    Soft is a first mode below :data:`SOFT` by a stiffness that is known, or one below :data:`MOST_SOFT` by
    elastic joints that explain much of what stiff ones leave.
    """
    expected, std = data.compliance
    if not std.any():  # direct drives
        return lag
    fitted = estimate.fit(data.blocks(lag), data.prior)
    stiff = _twist_of(data, fitted, lag, "motor", np.zeros(data.robot.n))
    middle = data.robot.middle()
    is_known = bool(knows_stiffness(data.robot).all())
    if is_known and not stiff._replace(compliance=expected).mode(middle) < SOFT:
        return lag
    sides = _sides(data.robot)
    best: _ElasticFit | None = None
    for side in sides:
        fit = _fit_elastic(data, stiff._replace(side=side), lag, _power(fitted), is_known)
        if fit is not None and (best is None or fit.explained > best.explained):
            best = fit
    data.set_twist(None)
    if best is None or best.twist.mode(middle) >= MOST_SOFT:
        return lag
    least = _ELASTIC if len(sides) == 1 else _ELASTIC_BLIND
    if best.explained < least and not is_known:
        return lag
    data.set_twist(best.twist)
    data.explained = best.explained
    return best.lag


def _sides(robot: Robot) -> tuple[str, ...]:
    """Return where the encoders may be: both sides, unless one is known of all joints."""
    sides = set(robot.drives.value("encoder_side").tolist())
    if len(sides) == 1 and "" not in sides:
        return tuple(sides)
    return ("motor", "link")


def _fit_elastic(data: Moments, stiff: Twist, lag: Array, power: Array, is_known: bool) -> _ElasticFit | None:
    """Return the fit with elastic joints and encoders at one side; None where they explain nothing at once.

    Args:
        data: of the logs; it keeps the twist.
        stiff: what the twist is computed from, without compliance.
        lag: to begin with [s], (n,).
        power: of what stiff joints leave of the torque of each joint, (n,).
        is_known: whether the stiffness is known: then the fit is wanted whatever it explains.
    """
    data.set_twist(stiff)
    at_once = _power(_free_fit(data, lag))
    if not is_known and _explained(at_once, power) < _WORTH:
        return None
    settled_lag, settled = _settle_twist(data, stiff, lag)
    assert data.twist is not None
    return _ElasticFit(_explained(settled, power), data.twist, settled_lag)


def _explained(power: Array, before: Array) -> float:
    """Return the share of powers before that is gone, all joints together (geometric mean)."""
    ratio = float(np.mean(np.log(power / before)))
    return 1.0 - math.exp(ratio)


def _twist_of(data: Moments, fitted: Fit, lag: Array, side: str, compliance: Array) -> Twist:
    """Return what the twist of gears is computed from by a fit."""
    n = data.robot.n
    theta = data.prior.mean + data.prior.std * fitted.physical
    of_joints = theta[: len(COLUMNS) * n]
    links = with_parameters(data.robot, of_joints).with_armature(np.zeros(n))
    model = links.pinocchio_model()
    model.gravity = data.model.gravity
    return Twist(side, compliance, of_joints.reshape(n, -1), model, data.width, lag, data.hidden)


def _settle_twist(data: Moments, twist: Twist, lag: Array) -> tuple[Array, Array]:
    """Find the compliance around which the regression is linear.

    Returns:
        The lag then [s] and the power of what is left, each (n,).
    """
    n = data.robot.n
    for _ in range(_TWIST_ROUNDS):
        data.set_twist(twist)
        prior = data.prior
        fitted = estimate.fit(data.blocks(lag), prior)
        theta = prior.mean + prior.std * fitted.physical
        lags = theta[-data.lags :]
        compliance = theta[: -data.lags][-n:]
        lag = np.broadcast_to(lags, n).copy()
        larger = np.maximum(compliance, twist.compliance)  # 0 of a joint without a gear, or of a stiff one
        change = np.abs(compliance - twist.compliance)
        relative = change / np.maximum(larger, np.finfo(float).tiny)
        twist = _twist_of(data, fitted, lag, twist.side, compliance)
        if relative.max() < _TWIST_SETTLED:
            break
    data.set_twist(twist)
    return lag, _power(_free_fit(data, lag))


def _choose_frictions(data: Moments, lag: Array) -> None:
    """Give joints the frictions that explain more of what is left."""
    fitted = estimate.fit(data.blocks(lag), data.prior)
    theta = data.prior.mean + data.prior.std * fitted.physical
    power = _power(fitted)
    data.heavy = with_parameters(data.robot, theta[: len(COLUMNS) * data.robot.n])
    is_seen = shares(fitted.residuals, data.torques(lag)) > _SEEN
    for name in FRICTIONS:
        data.frictions[name] = np.ones(data.robot.n, dtype=bool)
        less = _power(_free_fit(data, lag))
        data.frictions[name] = (less < (1.0 - _WORTH) * power) & is_seen
        if data.frictions[name].any():
            power = _power(_free_fit(data, lag))
        else:
            del data.frictions[name]


def _choose_couplings(data: Moments, lag: Array) -> None:
    """Find a motor that turns with the joint before its own as well: the one that explains most."""
    fitted = _free_fit(data, lag)
    power = _power(fitted)
    is_seen = shares(fitted.residuals, data.torques(lag)) > _SEEN
    least, best = math.inf, None
    for joint in range(data.robot.n - 1):
        both = slice(joint, joint + 2)
        if not is_seen[both].any():
            continue
        for sign in (1.0, -1.0):
            candidate = Coupled(joint, joint + 1, sign)
            data.coupled = [candidate]
            less = _power(_free_fit(data, lag))
            remaining = float((less / power)[both].min())
            if remaining < least:
                least, best = remaining, candidate
    data.coupled = []
    if best is not None and least < 1.0 - _COUPLED:
        data.coupled = [best]


def _with_lags(data: Moments, lag: Array) -> tuple[Fit, Prior]:
    """Return the fit with one lag, or with one for each joint where the data ask for it."""
    power_of_common = _power(_free_fit(data, lag))
    if data.robot.n > 1:
        data.lags = data.robot.n
        lags = _settle(data, lag)
        ratio = _power(_free_fit(data, lags)) / power_of_common
        if np.mean(np.log(ratio)) < np.log(1.0 - _WORTH):
            return estimate.fit(data.blocks(lags), data.prior), data.prior
        data.lags = 1
    return estimate.fit(data.blocks(lag), data.prior), data.prior


def _power(fitted: Fit) -> Array:
    """Return the residual's power of each joint, (n,)."""
    powers = [np.nansum(residual**2, axis=0) for residual in fitted.residuals]
    return np.asarray(np.nansum(powers, axis=0) + 1e-300)
