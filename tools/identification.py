"""How accurate `armgpi identify` is, and whether its intervals hold, on arms whose truth is known.

Random arms are drawn about each (bodies, rotors within 0.5-1.5 of the nominal ones, frictions, a load),
excited with the nominal controller, logged (16 bits, one sample late, 0.5 % torque noise) and identified.

    python tools/identification.py base --arms panda ur5 --count 20 --seed 100
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import re
import tempfile
import time
import warnings
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pinocchio as pin

import armgpi
from armgpi.base.arrays import Array
from armgpi.base.parameter import PerJoint, parameter, with_parameters
from armgpi.errors import ArmgpiError, ParameterError, UnfitLog
from armgpi.health.zoo import fingers
from armgpi.identification.arm import Identified, identify, mean_inertia
from armgpi.identification.estimate import expect
from armgpi.identification.excitation import FIRST_SHARE, excite
from armgpi.identification.logs import Log
from armgpi.identification.resonance import shake
from armgpi.identification.weak_form import BODY, COLUMNS, COULOMB, ROTOR, VISCOUS, inverse_rows
from armgpi.identification.writing import write_identified
from armgpi.plants import noise
from armgpi.plants.friction import STICK_VELOCITY
from armgpi.plants.plant import Wrapper
from armgpi.plants.reality import scales
from armgpi.robot.equations import Friction
from armgpi.robot.repairs import SUPPOSE
from armgpi.robot.robots import locate
from armgpi.robot.rotors import lowest_mode

#: What is known of the cases: how the log is made.
CASES: dict[str, dict[str, Any]] = {
    "base": {},
    "10s": {"seconds": 10.0},
    "60s": {"seconds": 60.0},
    "noise": {"noise": 0.03},
    "unmodelled": {"unmodelled": True},
    "unmodelled10": {"unmodelled": True, "seconds": 10.0},
    "unmodelled60": {"unmodelled": True, "seconds": 60.0},
    "late0": {"delay": 0},
    "late3": {"delay": 3},
    "late5": {"delay": 5},
    "slow": {"share": 0.12},
    "bare": {"bare": True},
}
DT = 1e-3
#: Simulated arms collide with nothing: motions as they were before excite kept them clear.
FREE: dict[str, Any] = {"floor": None, "collisions": False}
#: Where encoders are, in turn; and bandwidths at which an arm is tried again that swings [rad/s].
SIDES, SLOWER = ("link", "motor"), (5.0, 3.0)
#: Stiffness of joints that are fitted as stiff ones [N m/rad], and shortest log of a soft arm [s].
RIGID, SHORTEST = 1e9, 3.0
#: Largest first mode of arms that are fitted by elastic joints or not [Hz], ends of the bands that are told
#: apart [Hz], and speeds over which Coulomb friction changes its sign [rad/s or m/s].
SOFT_MODES, BANDS, FRICTION_WIDTHS = 40.0, (10.0, 15.0), (1e-3, 2e-2)
#: A fit is worse than that by stiff joints where its error is larger by this factor.
WORSE = 1.2


@with_parameters
class TorqueNoise(Wrapper):
    """White torque noise that the log knows nothing of."""

    config_name: ClassVar[str | None] = "bench_torque_noise"
    order: ClassVar[float] = 5.0
    std: PerJoint = parameter("standard deviation", unit="N m", per_joint=True)
    seed: int = parameter("seed", kind="integer", default=0, least=0)

    def step(self, tau: Array, state: Any, dt: float) -> Any:
        """Add the noise."""
        k = self.plant.true_state(state).k
        return self.plant.step(tau + self.std * noise.normal(self.seed, k, tau.shape, 3), state, dt)


@with_parameters
class Unmodelled(Wrapper):
    """Torque ripple over position and Stribeck friction, for which the fit has no column."""

    config_name: ClassVar[str | None] = "bench_unmodelled"
    order: ClassVar[float] = 4.0
    ripple: PerJoint = parameter("amplitude", unit="N m", per_joint=True)
    stribeck: PerJoint = parameter("stiction above Coulomb", unit="N m", per_joint=True)

    def step(self, tau: Array, state: Any, dt: float) -> Any:
        """Add both."""
        q, v = self.plant.true_state(state).q, self.plant.true_state(state).v
        stuck = v / np.sqrt(v * v + 1e-4) / (1.0 + (v / 0.05) * (v / 0.05))
        return self.plant.step(tau + self.ripple * np.sin(37.0 * q) - self.stribeck * stuck, state, dt)


def truth(robot: armgpi.Robot, seed: int) -> armgpi.Robot:
    """Return a random arm: bodies transformed congruently, so always physical; rotors, friction, a load."""
    rng, n, size = np.random.default_rng(seed), robot.n, scales(robot)
    bodies = []
    light = pin.Inertia.FromSphere(1e-3 * size.mass, 0.03)
    for body in moving(robot):
        body = body if body.mass > 0.0 else light  # a link without mass has some
        pseudo = body.toPseudoInertia().toMatrix()
        change = np.eye(4)
        change[:3, :3] *= math.sqrt(rng.uniform(0.7, 1.3)) * np.diag(rng.uniform(0.93, 1.07, 3))
        change[:3, 3] = rng.uniform(-0.1, 0.1, 3) * np.linalg.norm(body.lever)
        changed = change @ pseudo @ change.T * rng.uniform(0.7, 1.3)
        bodies.append(pin.PseudoInertia.FromMatrix(changed).toInertia().toDynamicParameters())
    rotors = expect(robot).mean.reshape(n, len(COLUMNS))[:, ROTOR] * rng.uniform(0.5, 1.5, n)
    coulomb = rng.uniform(0.02, 0.1, n) * size.gravity
    viscous = rng.uniform(0.1, 0.6, n) * coulomb
    arm = robot.with_bodies(bodies).with_armature(rotors)
    mass, com = rng.uniform(0.0, 0.05) * size.mass, rng.uniform(-0.05, 0.05, 3)
    loaded = arm.with_payload(robot.tip, mass, com, np.eye(3) * mass * 0.03**2)
    return loaded.with_friction(viscous=viscous, coulomb=coulomb)


def unknowns(arm: armgpi.Robot) -> Array:
    """Return the true unknowns of an arm, (n, 14)."""
    table = np.zeros((arm.n, len(COLUMNS)))
    table[:, : len(BODY)] = [body.toDynamicParameters() for body in moving(arm)]
    table[:, ROTOR], (table[:, VISCOUS], table[:, COULOMB]) = arm.armature, arm.friction
    return table


def record(
    robot: armgpi.Robot,
    arms: list[armgpi.Robot],
    reference: armgpi.Reference,
    seconds: float,
    *,
    noise: float = 0.005,
    unmodelled: bool = False,
    delay: int = 1,
    seed: int = 11,
    most: float = math.inf,
    stick: float = STICK_VELOCITY,
) -> list[Log]:
    """Return the logs of arms under the law that the expected rotors give, until an error is `most`."""
    rotors = expect(robot).mean.reshape(robot.n, len(COLUMNS))[:, ROTOR]
    size = scales(robot)
    friction = Friction(*(np.stack(rows) for rows in zip(*(arm.friction for arm in arms), strict=True)))
    plant: Any = armgpi.RigidBodyPlant(armgpi.RobotBatch(arms), (), friction, stick_velocity=stick)
    if unmodelled:
        plant = Unmodelled(plant, ripple=0.02 * size.gravity, stribeck=0.5 * friction.coulomb)
    plant = TorqueNoise(plant, std=noise * size.effort, seed=seed)
    plant = armgpi.Delayed(armgpi.Encoder(armgpi.Saturated(plant, robot.limits.effort), 16), delay)
    nominal = robot.with_armature(rotors)
    controller = armgpi.GPI.auto(nominal, DT, delay=delay * DT, bits=16, drives="stiff")
    run = armgpi.simulate(plant, controller, reference, seconds, progress=False, backend="auto")
    q, tau = run["q_measured"].values, run["tau_command"].values
    logs, target = [], reference.at(run["time"].values).q
    for k in range(len(arms)):
        there = np.isfinite(q[k]).all(axis=1) & np.isfinite(tau[k]).all(axis=1)
        there &= (np.abs(q[k] - target) < most).all(axis=1)
        end = len(there) if there.all() else int(np.argmin(there))
        logs.append(Log(run["time"].values[:end], q[k, :end], tau[k, :end], f"truth {k}"))
    return logs


def separable(model: Any, motion: Any, noise: Array, rotor: Array) -> Array:
    """Return which rotors the Fisher information of the true arm tells to 3 % (one standard deviation), (n,).

    The rows of the motion every 0.1 s, each with independent noise of the torque's size, and no prior.
    """
    n = len(rotor)
    rows = inverse_rows(model, motion.q, motion.v, motion.a, np.full(n, 2e-3)).reshape(len(motion.q), n, -1)
    weighted = (rows / noise[:, None]).reshape(-1, rows.shape[-1])
    scale = np.maximum(np.linalg.norm(weighted, axis=0), 1e-300)
    values, vectors = np.linalg.eigh((weighted / scale).T @ (weighted / scale))
    inverse = (vectors / np.maximum(values, 1e-10 * values[-1])) @ vectors.T
    std = np.sqrt(np.diag(inverse)) / scale
    return np.asarray(std[ROTOR :: len(COLUMNS)] < 0.03 * rotor)


def judge(found: Identified, true: Array, held: Array, apart: Array) -> dict[str, Any]:
    """Return the errors of one arm."""
    count = true.size
    theta = found.theta[:count]
    torque = held @ true.ravel()
    error = held @ theta - torque
    share = np.sqrt((error**2).mean(axis=0) / (torque**2).mean(axis=0))
    rows = [row for row in found.table(bodies=True) if row.quantity in COLUMNS]
    learned = np.array([row.data_share for row in rows]).reshape(true.shape)
    inside = np.array(
        [row.lower <= x <= row.upper for row, x in zip(rows, true.ravel(), strict=True)]
    ).reshape(true.shape)
    known = learned > 0.5
    relative = theta.reshape(true.shape) / np.where(true == 0.0, np.nan, true) - 1.0
    return {
        "torque": share.tolist(),
        "rotor": np.abs(relative[apart, ROTOR]).tolist(),
        "coulomb": np.abs(relative[:, COULOMB]).tolist(),
        "viscous": np.abs(relative[:, VISCOUS]).tolist(),
        "inside": int((inside & known).sum()),
        "known": int(known.sum()),
        "inside_drives": int((inside & known)[:, ROTOR:].sum()),
        "known_drives": int(known[:, ROTOR:].sum()),
        "lag": float(found.lag.mean() / DT),
    }


def without_masses(name: str, robot: armgpi.Robot) -> armgpi.Robot:
    """Return an arm as it is loaded from its file without any mass."""
    text = re.sub(
        r"<inertial\b.*?</inertial>", "", locate(name)[0].read_text(encoding="utf-8"), flags=re.DOTALL
    )
    return armgpi.Robot.from_xml(text, robot.provenance["locked"], repair=SUPPOSE)


def measure(name: str, case: str, count: int, seed: int) -> dict[str, Any]:
    """Return what identification makes of random arms about one."""
    options = dict(CASES[case])
    seconds, share = options.pop("seconds", 20.0), options.pop("share", 0.7)
    robot = armgpi.Robot.load(name, lock=fingers(name))
    file = without_masses(name, robot) if options.pop("bare", False) else robot
    reference = excite(robot, seconds, share, 7, **FREE).reference
    arms = [truth(robot, seed + i) for i in range(count)]
    logs = record(robot, arms, reference, seconds, **options)
    z = excite(robot, 10.0, 0.7, 1234, **FREE).reference.at(np.linspace(0.5, 9.5, 300))
    rows = []
    for arm, log in zip(arms, logs, strict=True):
        begin = time.process_time()
        found = identify(log, file, check_first=False)
        took = (time.process_time() - begin) / seconds
        model, true = arm.pinocchio_model(), unknowns(arm)
        held = inverse_rows(model, z.q, z.v, z.a, np.full(arm.n, 1e-3)).reshape(len(z.q), arm.n, -1)
        motion = reference.at(np.arange(0.5, seconds - 0.5, 0.1))
        apart = separable(model, motion, 0.001 * scales(robot).effort, arm.armature)
        findings = [x for x in found.findings if x.severity == "error"]
        rows.append({**judge(found, true, held, apart), "took": took, "refused": len(findings)})
        rows[-1]["length"] = log.t[-1]
    return summary(name, case, rows)


def record_loads(robot: armgpi.Robot, count: int, seed: int) -> Iterator[tuple[float, Array, Log, Log]]:
    """Give of each arm a load of 1 to 6 % of its mass, its centre, and logs of 10 s without and with it."""
    motions = [excite(robot, 10.0, 0.7, each, **FREE).reference for each in (7, 8)]
    arms = [truth(robot, seed + i) for i in range(count)]
    loads = [np.random.default_rng((seed + i, 1)) for i in range(count)]
    given = [(rng.uniform(0.01, 0.06) * scales(robot).mass, rng.uniform(-0.08, 0.08, 3)) for rng in loads]
    carrying = [
        arm.with_payload(robot.tip, mass, com, np.eye(3) * mass * 0.03**2)
        for arm, (mass, com) in zip(arms, given, strict=True)
    ]
    logs = [record(robot, *each, 10.0) for each in zip((arms, carrying), motions, strict=True)]
    for (mass, com), without, carried in zip(given, *logs, strict=True):
        yield mass, com, without, carried


def measure_load(name: str, count: int, seed: int) -> dict[str, Any]:
    """Return how well a load of 1 to 6 % of an arm is found from logs of 10 s without and with it."""
    robot, rows = armgpi.Robot.load(name, lock=fingers(name)), []
    for mass, com, without, carried in record_loads(robot, count, seed):
        load = identify(without, robot, check_first=False).load(carried, check_first=False)
        off = np.array([load.mass - mass, *(load.com - com)])
        inside = np.abs(off) <= 1.96 * np.array([load.mass_std, *load.com_std])
        rows.append(
            [abs(off[0]) / mass, np.linalg.norm(off[1:]), inside.mean(), without.t[-1], carried.t[-1]]
        )
    table = np.array(rows)
    quantiles = np.quantile(table[:, :2], [0.5, 0.95], axis=0)
    return {
        "arm": name,
        "case": "load",
        "arms": count,
        "mass_median": quantiles[0, 0],
        "mass_95": quantiles[1, 0],
        "centre_median": quantiles[0, 1],
        "centre_95": quantiles[1, 1],
        "coverage": table[:, 2].mean(),
        "shortest": table[:, 3:].min(),
    }


def measure_current(name: str, count: int, seed: int) -> dict[str, Any]:
    """Return what shows that torque constants are wrong: of all joints by 0.5 to 2, or of one by 10 %.

    The first changes no residual, and a known load tells it: the load's mass comes out by that factor. The
    second is in the residuals where other joints carry the same bodies.
    """
    robot, common, alone, factors = armgpi.Robot.load(name, lock=fingers(name)), [], [], []
    for i, (mass, _, without, carried) in enumerate(record_loads(robot, count, seed)):
        factor = 4.0 ** np.random.default_rng((seed + i, 3)).uniform(-0.5, 0.5)
        right, wrong = (identify(without, robot, check_first=False, current=x) for x in (1.0, factor))
        common.append(wrong.residuals / right.residuals)
        factors.append(abs(wrong.load(carried, check_first=False).mass / mass / factor - 1.0))
        for constants in 1.0 + 0.1 * np.eye(robot.n):
            one = identify(without, robot, check_first=False, current=constants)
            alone.append((one.residuals / right.residuals).max())
    return {
        "arm": name,
        "case": "current",
        "arms": count,
        "residual_common": float(np.median(common)),
        "residual_common_largest": float(np.max(common)),
        "residual_one": float(np.median(alone)),
        "residual_one_least": float(np.min(alone)),
        "factor_median": float(np.median(factors)),
        "factor_largest": max(factors),
    }


def measure_first(name: str, count: int, seed: int) -> dict[str, Any]:
    """Return whether the second log holds of arms with rotors anywhere within four times the believed."""
    robot, cut = armgpi.Robot.load(name, lock=fingers(name)), 0.1
    arms = [truth(robot, seed + i) for i in range(count)]
    rotors = expect(robot).mean.reshape(robot.n, len(COLUMNS))[:, ROTOR]
    factors = [4.0 ** np.random.default_rng((seed + i, 2)).uniform(-1.0, 1.0, robot.n) for i in range(count)]
    arms = [arm.with_armature(rotors * each) for arm, each in zip(arms, factors, strict=True)]
    first = excite(robot, 20.0, FIRST_SHARE, 7, **FREE).reference
    rows = []
    for arm, log in zip(arms, record(robot, arms, first, 20.0, most=cut), strict=True):
        found, second = identify(log, robot, check_first=False).robot, Log(*[np.zeros(1)] * 3)
        with suppress(ParameterError):  # of motors that do not hold what was found
            motion = excite(found, 20.0, 0.7, 8, **FREE).reference
            (second,) = record(found, [arm], motion, 20.0, most=cut)
        off = found.armature / arm.armature
        rows.append([log.t[-1], second.t[-1], float(np.median(np.maximum(off, 1.0 / off)))])
    table = np.array(rows)
    return {
        "arm": name,
        "case": "first",
        "arms": count,
        "first_shortest": table[:, 0].min(),
        "first_held": int((table[:, 0] > 19.9).sum()),
        "second_held": int((table[:, 1] > 19.9).sum()),
        "rotor_factor": float(np.median(table[:, 2])),
    }


def measure_resonance(name: str, count: int, seed: int) -> dict[str, Any]:
    """Return how well the first mode is found, of 3 to 30 Hz, encoders at links and motors in turn.

    The arm is moved by ``excite --first`` and identified, and shaken under the law for what was found; both
    logs end where a joint is off by 0.2, then it is tried at the bandwidths of :data:`SLOWER`; an arm counts
    as lost where none gets to the turn of the last joint. The law is told where the encoders are, as by a
    data sheet; the fit is not. Each prints a row.
    """
    robot, off, inside, lost, sides = armgpi.Robot.load(name, lock=fingers(name)), [], 0, [], 0
    for i in range(count):
        arm, side = truth(robot, seed + i), SIDES[i % 2]
        bin_of = (i // 2, math.ceil(count / 2))
        plant, mode = elastic_plant(robot, arm, side, seed + i, name, bin_of, 30.0)
        row = f"| {name} | {side} | {mode:.3g} |"
        try:
            first = follow(robot, plant, excite(robot, 20.0, FIRST_SHARE, 1, **FREE).reference, side)
            found = identify(first, robot, check_first=False)
            motion = shake(found.robot).reference
            gears = found.with_resonance(follow(found.robot, plant, motion, side)).gears
        except (UnfitLog, ParameterError):  # too short, or an arm that cannot hold itself came out of it
            gears = None
        if gears is None or np.isnan(gears.misfit).any():
            print(f"{row} lost | | |", flush=True)
            lost.append(f"{side} {mode:.3g} Hz")
            continue
        value, low, high = gears.mode
        off.append(abs(value / mode - 1.0))
        inside += int(low <= mode <= high)
        sides += gears.side == side
        print(
            f"{row} {value:.3g} [{low:.3g}, {high:.3g}] | {100.0 * off[-1]:.2g} | {gears.side} |", flush=True
        )
    return {
        "arm": name,
        "case": "resonance",
        "arms": count,
        "not_held": ", ".join(lost) or "none",
        "mode_median": float(np.median(off)),
        "mode_largest": max(off, default=math.nan),
        "within_10": int((np.array(off) < 0.1).sum()),
        "intervals_hold": inside,
        "sides_found": sides,
    }


class SoftRow(NamedTuple):
    """What the fits of one log make of an arm whose joints are elastic, or stiff.

    Attributes:
        mode: the first mode [Hz]; infinite for stiff joints.
        off: error of the mean inertia of the worst joint, fitted by stiff joints, with the side of the
            encoders known, and unknown, (3,).
        elastic: whether the last two fits took the joints for elastic ones.
    """

    mode: float
    off: tuple[float, ...]
    elastic: tuple[bool, ...]


def measure_soft(name: str, count: int, seed: int) -> dict[str, Any]:
    """Return how well D is found by a first log of an arm whose first mode is 3 to 40 Hz.

    Stiffness is drawn; encoders are at links and motors in turn, and Coulomb friction changes its sign over
    1 and 20 mrad/s. The same log is fitted three times: by stiff joints (stiffness specified as large), with
    the side of the encoders known, as by a data sheet, and unknown. Each arm prints a row.
    """
    robot, rows = armgpi.Robot.load(name, lock=fingers(name)), []
    for i in range(count):
        arm, side, width = truth(robot, seed + i), SIDES[i % 2], FRICTION_WIDTHS[i // 2 % 2]
        bin_of = (i // 4, math.ceil(count / 4))
        plant, mode = elastic_plant(robot, arm, side, seed + i, name, bin_of, SOFT_MODES, width)
        log = follow(robot, plant, excite(robot, 20.0, FIRST_SHARE, 1, **FREE).reference, side)
        label = f"| {name} | {side} | {1e3 * width:g} | {mode:.3g} |"
        if log.t[-1] < SHORTEST:
            print(f"{label} a log of {log.t[-1]:.2g} s alone | | | |", flush=True)
            continue
        rows.append(fit_soft(robot, arm, log, side, mode, label))
    return {"arm": name, "case": "soft", "arms": len(rows), **count_soft(rows)}


def measure_stiff(name: str, count: int, seed: int) -> dict[str, Any]:
    """Return how often an arm with stiff joints is taken for one with elastic joints, which costs what.

    Coulomb friction changes its sign over 1 and 20 mrad/s, in turn, and every other pair of arms has torque
    ripple and Stribeck friction that the fit has no column for.
    """
    robot, rows = armgpi.Robot.load(name, lock=fingers(name)), []
    reference = excite(robot, 20.0, FIRST_SHARE, 1, **FREE).reference
    for i in range(count):
        arm, width, ripple = truth(robot, seed + i), FRICTION_WIDTHS[i % 2], bool(i // 2 % 2)
        (log,) = record(robot, [arm], reference, 20.0, unmodelled=ripple, stick=width)
        label = f"| {name} | {'ripple, Stribeck' if ripple else ''} | {1e3 * width:g} | stiff |"
        rows.append(fit_soft(robot, arm, log, SIDES[i // 4 % 2], math.inf, label))
    return {"arm": name, "case": "stiff", "arms": len(rows), **count_soft(rows)}


def fit_soft(robot: armgpi.Robot, arm: armgpi.Robot, log: Log, side: str, mode: float, label: str) -> SoftRow:
    """Fit a log by stiff joints, with the side of the encoders known and unknown; print a row."""
    told = robot.with_drives(robot.drives.with_value("encoder_side", side))
    rigid = told.with_drives(told.drives.with_value("stiffness", RIGID))
    all_three = [identify(log, each, check_first=False) for each in (rigid, told, robot)]
    true = mean_inertia(arm)
    off = tuple(float(np.abs(mean_inertia(each.robot) / true - 1.0).max()) for each in all_three)
    modes = [
        each.twist
        and f"{each.twist.mode(robot.middle()):.3g} {each.twist.side}, {100.0 * each._data.explained:.2g} %"
        for each in all_three[1:]
    ]
    shown = " | ".join(f"{100.0 * each:.2g}" for each in off)
    print(f"{label} {' | '.join(each or '' for each in modes)} | {shown} |", flush=True)
    return SoftRow(mode, off, tuple(each.twist is not None for each in all_three[1:]))


def count_soft(rows: list[SoftRow]) -> dict[str, Any]:
    """Return, for the bands of first modes, how many logs were fitted by elastic joints, and the errors."""
    found: dict[str, Any] = {}
    for low, high in itertools.pairwise((0.0, *BANDS, math.inf)):
        own = [row for row in rows if low <= row.mode < high or row.mode == high == math.inf]
        if not own:
            continue
        band = f"{low:g}_to_{high:g}_Hz"
        off = np.array([row.off for row in own])
        counts = np.array([row.elastic for row in own]).sum(axis=0)
        found[f"{band}_elastic"] = f"{counts[0]}+{counts[1]}/{len(own)}"
        found[f"{band}_median"] = ",".join(f"{100.0 * each:.3g}" for each in np.median(off, axis=0))
        found[f"{band}_largest"] = ",".join(f"{100.0 * each:.3g}" for each in off.max(axis=0))
        worse = (off[:, 1:] > WORSE * off[:, :1]).sum(axis=0)
        found[f"{band}_worse_than_stiff"] = f"{worse[0]}+{worse[1]}"
    return found


def elastic_plant(
    robot: armgpi.Robot,
    arm: armgpi.Robot,
    side: str,
    seed: int,
    name: str,
    bin_of: tuple[int, int],
    most: float,
    stick: float = STICK_VELOCITY,
) -> tuple[Any, float]:
    """Return an elastic arm and its first mode of 3 Hz to `most`, drawn from one bin of several.

    Args:
        robot: as its file has it.
        arm: as it is.
        side: where the encoders are.
        seed: of the draw.
        name: of the arm, for the draw.
        bin_of: which bin of how many, in equal ratios.
        most: largest first mode [Hz].
        stick: speed below which Coulomb friction is smoothed [rad/s or m/s].
    """
    rng = np.random.default_rng([seed, *name.encode()])
    mode = float(3.0 * (most / 3.0) ** ((bin_of[0] + rng.uniform()) / bin_of[1]))
    links = arm.mass_matrix(arm.middle()) - np.diag(arm.armature)
    stiffness = arm.armature * np.exp(rng.uniform(-0.5, 0.5, arm.n))
    stiffness *= (mode / lowest_mode(links, arm.armature, stiffness)) ** 2
    plant: Any = armgpi.ElasticPlant(
        arm, gear_stiffness=stiffness, friction=arm.friction, encoder_side=side, stick_velocity=stick
    )
    plant = TorqueNoise(plant, std=0.005 * scales(robot).effort, seed=seed)
    plant = armgpi.Delayed(armgpi.Encoder(armgpi.Saturated(plant, robot.limits.effort), 16), 1)
    return plant, mode


def follow(known: armgpi.Robot, plant: Any, reference: Any, side: str) -> Log:
    """Return the log of an elastic arm under the law for what is known, until a joint is off by 0.2.

    Where that is before the end, slower laws are tried.
    """
    told = armgpi.assume_drives(known)
    told = told.with_drives(told.drives.with_value("encoder_side", side))
    for omega in (None, *SLOWER):
        gains = omega and armgpi.FixedGains(omega)
        law = armgpi.GPI.auto(told, DT, delay=DT, bits=16, gains=gains)
        run = armgpi.simulate(plant, law, reference, reference.t_end, progress=False, backend="compiled")
        q, tau = run["q_measured"].values, run["tau_command"].values
        there = (np.abs(q - run["q_ref"].values) < 0.2).all(axis=1)
        if there.all():
            break
    end = len(q) if there.all() else int(np.argmin(there))
    limit = known.limits.effort
    return Log(run["time"].values[:end], q[:end], np.clip(tau[:end], -limit, limit), "truth")


def measure_written(name: str, _count: int, seed: int) -> dict[str, Any]:
    """Return whether an arm, by name or file, goes all the way: motion, log, fit, folder, loaded again.

    `same` is the largest difference of D over its largest element; an arm refused in one line is told by it.
    """
    row: dict[str, Any] = {"arm": Path(name).stem, "case": "written"}
    try:
        robot = armgpi.Robot.load(name, lock=fingers(name))
        reference = excite(robot, 10.0, FIRST_SHARE, 7, **FREE).reference
        (log,) = record(robot, [truth(robot, seed)], reference, 10.0, most=0.1)
        found = identify(log, robot, check_first=False)
        with tempfile.TemporaryDirectory() as folder:
            write_identified(found, Path(folder))
            again = armgpi.Robot.load(folder)
    except ArmgpiError as error:
        return {**row, "refused": f'"{error}"'}
    q = robot.random_positions(20)
    masses = found.robot.mass_matrix(q)
    least = min(np.linalg.eigvalsh(x.toPseudoInertia().toMatrix())[0] for x in moving(found.robot))
    same = float(np.abs(again.mass_matrix(q) - masses).max() / np.abs(masses).max())
    return {**row, "n": robot.n, "length": float(log.t[-1]), "same": same, "physical": bool(least > 0.0)}


def moving(arm: armgpi.Robot) -> list[Any]:
    """Return the inertias of the bodies that move."""
    return list(arm.pinocchio_model().inertias)[1:]


def summary(name: str, case: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return medians, tails and coverage over arms."""

    def all_of(key: str) -> Array:
        return np.concatenate([row[key] for row in rows])

    torque = np.array([row["torque"] for row in rows])
    return {
        "arm": name,
        "case": case,
        "arms": len(rows),
        "torque_median": float(np.median(torque)),
        "torque_worst": float(np.median(torque.max(axis=1))),
        "torque_largest": float(torque.max()),
        "rotor_median": float(np.median(all_of("rotor"))) if len(all_of("rotor")) else None,
        "rotor_95": float(np.quantile(all_of("rotor"), 0.95)) if len(all_of("rotor")) else None,
        "rotors_separable": len(all_of("rotor")) / len(rows),
        "coulomb": float(np.median(all_of("coulomb"))),
        "viscous": float(np.median(all_of("viscous"))),
        "coverage": sum(r["inside"] for r in rows) / sum(r["known"] for r in rows),
        "coverage_drives": sum(r["inside_drives"] for r in rows)
        / max(sum(r["known_drives"] for r in rows), 1),
        "learned": sum(r["known"] for r in rows) / len(rows),
        "lag": float(np.median([r["lag"] for r in rows])),
        "lag_spread": float(np.max(np.abs(np.array([r["lag"] for r in rows]) - CASES[case].get("delay", 1)))),
        "took": float(np.median([r["took"] for r in rows])),
        "refused": sum(r["refused"] > 0 for r in rows),
    }


#: Cases that are measured in a way of their own.
OWN = {
    "load": measure_load,
    "current": measure_current,
    "first": measure_first,
    "resonance": measure_resonance,
    "soft": measure_soft,
    "stiff": measure_stiff,
    "written": measure_written,
}


def main() -> None:
    """Measure and print, one line for each arm and case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="+", choices=[*sorted(CASES), *OWN])
    parser.add_argument(
        "--arms",
        nargs="+",
        default=["panda", "ur5", "anthropomorphic3"],
        help="names or files; zoo for all names",
    )
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    found = []
    for name in armgpi.robots.names() if given.arms == ["zoo"] else given.arms:
        for case in given.cases:
            row = (
                OWN[case](name, given.count, given.seed)
                if case in OWN
                else measure(name, case, given.count, given.seed)
            )
            found.append(row)
            shown = {key: f"{value:.4g}" if isinstance(value, float) else value for key, value in row.items()}
            print(" ".join(f"{key}={value}" for key, value in shown.items()), flush=True)
            if given.out:
                given.out.write_text(json.dumps(found, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
