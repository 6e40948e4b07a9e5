"""Checks of a robot's dynamics, and of what a controller with default gains makes of them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np

from armgpi.base.arrays import Array
from armgpi.errors import Remedy
from armgpi.gpi.advice import COUNT_SHARE, slow_default
from armgpi.gpi.gains import Tuning, betas
from armgpi.health.findings import Finding, Level, Subject, check
from armgpi.robot import rotors

_LEAST_MASS = 1e-4
_CONDITION, _LEAST_EIGENVALUE = 1e6, 1e-6
#: GPI with zeta_c = 1 is unstable where friction moves a joint's pole beyond this times omega_c (Theory).
_FRICTION_RATE = 6.67
#: Share of the effort limit above which Coulomb friction looks like a placeholder: real gears lose less.
_COULOMB_SHARE = 0.2
#: It is unstable, too, where gravity drives the arm away faster than the root of this times omega_c (Theory).
_UNSTABLE = 16.0 / 15.0
#: Configurations at which that is computed, step of the differences [rad or m], most of the delay margin
#: (0.356) that a higher bandwidth may be proposed to use.
_CONFIGURATIONS, _STEP, _MOST_PHASE = 50, 1e-4, 0.2

#: Share of the torque that one count may cost before it is more than worth knowing.
_MUCH = 0.2


@check("mass", "the links of a joint have less than 0.1 g", "warning")
def light(subject: Subject) -> Iterator[Finding]:
    """Find joints without mass of their own."""
    model = subject.robot.pinocchio_model()
    for index in range(1, model.njoints):
        mass, name = float(model.inertias[index].mass), model.names[index]
        # Followers are among the model's joints, and no joints of the robot.
        if mass < _LEAST_MASS and name in subject.robot.joint_names:
            links = ", ".join(map(repr, subject.robot.links_moved_by(name)))
            what = "no mass of its own" if mass == 0.0 else f"only {mass:.3g} kg"
            message = f"carries {what} (links {links}), not counting what the next joints carry"
            repair = "specify mass and inertia of these links, if they are more than frames"
            yield Finding("warning", f"joint {name!r}", message, mass, _LEAST_MASS, repair)


@check("condition", "D(q) has a condition above 1e6 or an eigenvalue below 1e-6", "warning")
def condition(subject: Subject) -> Iterator[Finding]:
    """Find a joint that hardly any inertia resists."""
    eigenvalues = subject.eigenvalues
    row = int(np.argmin(eigenvalues[:, 0]))
    least, worst = float(eigenvalues[row, 0]), float((eigenvalues[:, -1] / eigenvalues[:, 0]).max())
    vector = np.linalg.eigh(subject.inertia[row])[1][:, 0]
    weak = f"joint {subject.robot.joint_names[int(np.argmax(np.abs(vector)))]!r}"
    repair = (
        "specify its reflected rotor inertia (rotor inertia times the gear ratio squared) by "
        "with_armature, or `rotor_inertia`"
    )
    if worst > _CONDITION:
        message = f"D(q) has condition {worst:.3g}, as this joint moves very little inertia"
        yield Finding("warning", weak, message, worst, _CONDITION, repair)
    elif least < _LEAST_EIGENVALUE:
        message = f"moves an inertia of only {least:.3g} at some configuration"
        yield Finding("warning", weak, message, least, _LEAST_EIGENVALUE, repair)


@check(
    "gravity",
    "where runs start (error; `run` refuses it) or elsewhere (warning, with the share of "
    "configurations), holding the arm takes more torque than the effort limit",
    "error",
    "warning",
)
def gravity(subject: Subject) -> Iterator[Finding]:
    """Find joints that cannot hold the arm."""
    robot, holding, shares = subject.robot, np.abs(subject.gravity), subject.robot.holding_share(subject.q)
    for j, name in enumerate(robot.joint_names):
        most, start, limit = float(holding[:, j].max()), float(holding[0, j]), float(robot.limits.effort[j])
        if limit == 0.0 or shares[:, j].max() <= 1.0:
            continue
        where, remedies = f"joint {name!r}", (Remedy("effort", (name,), float(f"{1.5 * most:.3g}")),)
        if shares[0, j] > 1.0:
            message = f"needs {start:.4g} to hold the arm where runs start, but its effort limit is {limit:g}"
            repair = "start at another configuration, or specify the effort of its motor"
            yield Finding("error", where, message, start, limit, repair, remedies)
        else:
            share = float((shares[:, j] > 1.0).mean())
            message = (
                f"needs up to {most:.4g} to hold the arm, but its effort limit is {limit:g}, which is too "
                f"little at {100.0 * share:.2g} % of {len(holding)} configurations"
            )
            repair = "avoid these configurations, or specify the effort of its motor"
            yield Finding("warning", where, message, most, limit, repair, remedies)


@check("friction", "the URDF contains some, which acts in the plant of realistic arms", "info")
def friction(subject: Subject) -> Iterator[Finding]:
    """Find joint friction."""
    viscous, coulomb = subject.robot.friction
    if viscous.any() or coulomb.any():
        message = "the URDF contains joint friction, which acts in the plant of realistic arms"
        yield Finding("info", "joints", message, float(viscous.max()), remedies=(Remedy("friction"),))


@check(
    "friction", "equal numbers on all joints, or too large for the motors: placeholders?", "info", "warning"
)
def placeholder_friction(subject: Subject) -> Iterator[Finding]:
    """Find friction that looks like an exporter's or a simulation's placeholder."""
    viscous, coulomb = subject.robot.friction
    effort = subject.robot.limits.effort
    message = ""
    level: Literal["info", "warning"] = "info"
    large = coulomb > _COULOMB_SHARE * effort
    same = [bool(column[0]) and bool((column == column[0]).all()) for column in (viscous, coulomb)]
    where = "joints"
    if large.any():
        share = np.divide(coulomb, effort, out=np.full(len(effort), np.inf), where=effort > 0.0)
        j = int(np.argmax(np.where(large, share, 0.0)))  # the worst
        where = f"joint {subject.robot.joint_names[j]!r}"
        level = "warning"
        message = (
            f"Coulomb friction {coulomb[j]:.4g} is above {_COULOMB_SHARE:.0%} of the effort "
            f"limit {effort[j]:g}: it may be a placeholder"
        )
    elif len(viscous) > 1 and any(same):
        message = (
            f"all joints have the same friction (viscous {viscous[0]:g}, Coulomb {coulomb[0]:g}): "
            "it may be a placeholder"
        )
    if message:
        yield Finding(level, where, message, float(coulomb.max()), remedies=(Remedy("friction"),))


@check(
    "friction",
    "the URDF's damping makes GPI unstable with the rotor inertia that is specified or assumed "
    "([Theory](theory.md#friction-and-the-limits-of-gpi))",
    "warning",
)
def strong_friction(subject: Subject) -> Iterator[Finding]:
    """Find damping that makes GPI unstable, on the arm that is run: with its rotors."""
    viscous = subject.robot.friction.viscous
    rates = np.linalg.eigvals(np.linalg.solve(subject.run_inertia[0], np.diag(viscous)))
    fastest, bound = float(rates.real.max()), _FRICTION_RATE * subject.omega
    if fastest > bound:
        message = (
            f"the URDF's damping acts at up to {fastest:.3g} 1/s; GPI is unstable beyond "
            f"{_FRICTION_RATE} omega_c = {bound:.3g} 1/s"
        )
        where = f"joint {subject.robot.joint_names[int(np.argmax(viscous))]!r}"
        repair = "check the unit of the damping: N m s/rad; specify the rotor inertia"
        remedies = (Remedy("friction"),)
        yield Finding("warning", where, message, fastest, bound, repair, remedies)


@check(
    "armature",
    "the URDF contains no rotor inertia (info), or it was specified as zero (warning)",
    "info",
    "warning",
)
def armature(subject: Subject) -> Iterator[Finding]:
    """Find rotors that are assumed or specified as zero, and what that does to the loop."""
    robot = subject.robot
    none = rotors.told_none(robot)
    names = none or rotors.silent(robot)
    if not names:
        return
    every = zip(robot.joint_names, rotors.typical_inertia(robot), strict=True)
    values = [float(x) if name in names else 0.0 for name, x in every]
    whole, added = subject.inertia, np.diag(values)
    less = np.linalg.eigvals(np.linalg.solve(whole + added, whole)).real.min()
    wrong = np.linalg.eigvals(np.linalg.solve(whole + rotors.SCATTER * added, whole + added)).real.min()
    message = (
        "rotor inertia was specified as zero. With usual rotors the inertia ratio delta would be "
        f"{less:.2g}; GPI needs 0.36"
    )
    if not none:
        message = (
            "the URDF contains no rotor inertia, so usual values are assumed. If the true ones are "
            f"{rotors.SCATTER:g} times as large, the inertia ratio delta is {wrong:.2g}; GPI needs 0.36"
        )
    told = zip(robot.joint_names, values, strict=True)
    proposed = ",".join(f"{name}={value:.2g}" for name, value in told if name in names)
    unstable = (less if none else wrong) < 0.36
    yield Finding(
        "warning" if none or unstable else "info",
        "joints",
        message,
        float(less if none else wrong),
        0.36,
        "specify values of the data sheet (inertia times gear ratio squared), or the assumed ones",
        (Remedy("rotor_inertia", (), proposed),),
    )


@check(
    "gravity-unstable",
    "the upright arm falls faster than GPI at its default bandwidth can stabilise it "
    "([Theory](theory.md#gravity-that-tips-the-arm-over)): where runs start (warning), or elsewhere "
    "(info)",
    "warning",
    "info",
)
def gravity_unstable(subject: Subject) -> Iterator[Finding]:
    """Find configurations that gravity makes unstable faster than the default bandwidth catches."""
    robot, q = subject.robot, subject.q[: _CONFIGURATIONS + 1]
    stiffness = _stiffness(subject, q)
    values, vectors = np.linalg.eig(np.linalg.solve(subject.inertia[: len(q)], stiffness))
    growth, fastest = -values.real.min(axis=1), values.real.argmin(axis=1)
    bound = _UNSTABLE * subject.omega**2
    if not (growth > bound).any():
        return
    start = bool(growth[0] > bound)
    row = 0 if start else int(growth.argmax())
    joint = robot.joint_names[int(np.abs(vectors[row][:, fastest[row]]).argmax())]
    enough = 1.05 * math.sqrt(float(growth[row]) / _UNSTABLE)
    where = "where runs start" if start else f"at one of {len(q)} configurations"
    message = (
        f"gravity makes the upright arm unstable with a rate of {math.sqrt(growth[row]):.3g} 1/s {where}; "
        f"at the default bandwidth GPI stabilises up to {math.sqrt(bound):.3g} 1/s"
    )
    if enough <= _MOST_PHASE / ((1.5 + subject.delay) * subject.dt):
        repair, remedy = "a higher bandwidth", Remedy("omega", (), float(math.ceil(enough)))
    else:
        repair = "a shorter sample time, the inertia that its links really have, or lock it"
        remedy = Remedy("lock", (joint,))
    level: Level = "warning" if start else "info"
    yield Finding(level, f"joint {joint!r}", message, float(growth[row]), bound, repair, (remedy,))


def _stiffness(subject: Subject, q: Array) -> Array:
    """Return dG/dq by central differences, shape (batch, n, n)."""
    columns = []
    for step in _STEP * np.eye(subject.robot.n):
        ahead, behind = subject.robot.dynamics.gravity(q + step), subject.robot.dynamics.gravity(q - step)
        columns.append((ahead - behind) / (2.0 * _STEP))
    return np.stack(columns, axis=-1)


@check("bandwidth", "sample time and delay leave a default bandwidth below 15 rad/s", "warning")
def bandwidth(subject: Subject) -> Iterator[Finding]:
    """Find a default bandwidth at which no arm follows well."""
    return slow_default(subject.dt, subject.delay * subject.dt)


@check(
    "encoder", "the default bandwidth of `gpi` costs more than 1 % of the torque per count", "warning", "info"
)
def encoder(subject: Subject) -> Iterator[Finding]:
    """Find joints whose encoder is too coarse for the default bandwidth of GPI without automatic tuning."""
    omega, allowed = subject.omega, omega_of_encoder(subject)
    coarse = allowed < omega
    # No bandwidth is proposed: with elastic joints a lower one of gpi may be as unstable.
    repair = "use automatic tuning (gpi_auto), which takes the encoders into account"
    for j, name in enumerate(subject.robot.joint_names):
        if coarse[j]:
            message = (
                f"one count of a {subject.encoder_bits}-bit encoder costs more than {100 * COUNT_SHARE:g} % "
                f"of its torque above omega_c = {allowed[j]:.3g} rad/s, and the default of gpi is {omega:.3g}"
            )
            # The cost of a count grows with the square of omega, which would overflow for next to no effort.
            is_dear = omega / allowed[j] > math.sqrt(_MUCH / COUNT_SHARE)
            level: Level = "warning" if is_dear else "info"
            yield Finding(level, f"joint {name!r}", message, float(allowed[j]), omega, repair)


def omega_of_encoder(subject: Subject) -> Array:
    """Return the bandwidth at which a count of an encoder costs a set share of the torque, (n,) [rad/s].

    A step of the measured position by one count is a step of v by beta3 counts, at once.
    """
    one, robot = np.ones(1), subject.robot
    beta3 = float(betas(Tuning(one, one, one)).beta3[0])  # at omega_c = 1; it grows with omega_c^2
    most = np.diagonal(subject.run_inertia, axis1=1, axis2=2).max(axis=0)
    count = robot.encoder_count(subject.encoder_bits)
    # Roots apart: a limit of 1e308 would overflow.
    result: Array = np.sqrt(COUNT_SHARE * robot.limits.effort) / np.sqrt(beta3 * most * count)
    result[robot.limits.effort == 0.0] = math.inf  # the check of the effort reports it
    return result
