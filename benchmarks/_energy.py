"""Energy at the tool of springs: whether the arm has more than hands and walls gave it."""

from __future__ import annotations

from typing import Any, NamedTuple

import _page
import numpy as np
from _compliant import ARMS, BITS, DT, ROTORS, SEEDS, Hand, Surface, directions, loop, place
from _springs import stiffness_of
from _timing import table

import armgpi
from armgpi.base.arrays import Array
from armgpi.control.impedance import rotation_between
from armgpi.robot.frame_motion import FrameMotion

#: Runs of all arms together, of one batch, and how long each is [s].
DRAWS, BATCH, LENGTH = 10_008, 556, 2.0
#: Delay of each arm [samples].
LATE = {"ur10": 1, "xarm7": 2, "z1": 3, "tiago_pro_left_arm": 1, "baxter_left_arm": 2, "ur3": 3}
#: The spring [N/m], the push of a hand [N], which motors can hold, and how far the wall is at first [m].
STIFFNESS, PUSH, AWAY = 500.0, (2.0, 15.0), (1e-3, 2e-2)
#: Softest wall [N/m]; the stiffest is the one that the controller states.
SOFTEST = 100.0
#: A recorded sample is so many of the loop; forces change at recorded samples.
EVERY = 4
#: Encoders that count as exact [bits].
EXACT = 50
#: How much stiffer than stated the walls of the control are.
BEYOND = 100.0
#: How often the balance of a run is looked at.
LOOKS = 25
#: Energy that counts as none [J].
NOTHING = 1e-6


class Gained(NamedTuple):
    """What a batch gained at most [J], and what quantisation accounts for, (rollouts,)."""

    counted: Array
    exact: Array
    accounted: Array


def energy(quick: bool) -> None:
    """Print how much energy the arm gained."""
    draws = BATCH * 6 if quick else DRAWS
    _page.say(
        f"Energy at the tool of CartesianImpedance at {STIFFNESS:g} N/m on stiff joints, {draws} draws: two "
        f"hands of {PUSH[0]:g} to {PUSH[1]:g} N, which motors can hold, in any directions, and a wall "
        "without damping in any direction whose stiffness is "
        f"{SOFTEST:g} N/m to that which the controller states for the worst configuration; rotors within "
        f"{100 * ROTORS:g} %, half of them with Coulomb friction of up to 5 % of the effort, "
        f"{BITS[0]} to {BITS[1]} bits, delay of 1 to 3 samples. Gained: most energy in the arm's "
        f"motion and springs beyond what hands and wall gave it, looked at {LOOKS} times in {LENGTH:g} s. "
        "Quantisation accounts for the way of each joint times the torque that half a count of every joint "
        f"makes. Exact: the same draws with encoders of {EXACT} bits."
    )
    rows = []
    for name in ARMS:
        found = _arm(name, LATE[name], draws // 6)
        above = int((found.counted > found.accounted + NOTHING).sum())
        rows.append(
            [
                name,
                len(found.counted),
                int((found.counted > NOTHING).sum()),
                f"{1e3 * found.counted.max():.2g}",
                f"{float((found.counted / found.accounted).max()):.2g}",
                above,
                f"{int((found.exact > NOTHING).sum())}, {1e3 * found.exact.max():.2g}",
            ]
        )
    heads = [
        "arm",
        "draws",
        "gained",
        "most [mJ]",
        "over quantisation",
        "more than it",
        "exact: gained, most [mJ]",
    ]
    print(table(heads, rows))
    control()


def control() -> None:
    """Print what walls beyond the stated one get: whether the measure sees a controller that drives them."""
    found = _arm(ARMS[0], LATE[ARMS[0]], BATCH, BEYOND)
    _page.say(
        f"Control: {ARMS[0]} with walls up to {BEYOND:g} times as stiff as stated gained energy in "
        f"{int((found.counted > NOTHING).sum())} of {BATCH} draws, at most "
        f"{1e3 * found.counted.max():.2g} mJ."
    )


def _arm(name: str, late: int, draws: int, beyond: float = 1.0) -> Gained:
    """Return what an arm gained."""
    where = place(name)
    robot = where.robot
    law = armgpi.CartesianImpedance(robot, DT, stiffness=stiffness_of(STIFFNESS), delay=late * DT)
    start = np.tile(where.q, (BATCH, 1))
    contacts = [Surface(), Hand(), Hand()]
    made = loop(robot, law, armgpi.Hold(start), LENGTH, contacts, EVERY, late=late, record=("q", "v"))
    parts = []
    for batch in range(draws // BATCH):
        random = np.random.default_rng([SEEDS[name], batch])
        given = _drawn(where, beyond * law.limits.wall, random)
        whole = made.run(given)
        exact = made.run({**given, "plant.encoder_bits": np.full((BATCH, robot.n), EXACT)})
        counts = _counts(robot, law, where.q, given["plant.encoder_bits"])
        way = np.abs(np.diff(whole["q"].values, axis=1)).sum(axis=1)
        parts.append(
            Gained(
                _gained(robot, law, where, whole, given),
                _gained(robot, law, where, exact, given),
                (way * counts).sum(axis=1),
            )
        )
    return Gained(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _drawn(where: Any, stiffest: float, random: np.random.Generator) -> dict[str, Array]:
    """Return the numbers of a batch."""
    robot = where.robot
    bits = random.integers(BITS[0], BITS[1] + 1, (BATCH, 1))
    shares = random.uniform(0.0, 0.05, BATCH) * (random.uniform(size=BATCH) < 0.5)
    given = {
        "plant.rotor_inertia": robot.armature * random.uniform(1.0 - ROTORS, 1.0 + ROTORS, (BATCH, robot.n)),
        "plant.coulomb": shares[:, None] * robot.limits.effort,
        "plant.encoder_bits": np.tile(bits, (1, robot.n)),
    }
    wall = "plant.environment.0"
    normal = directions(BATCH, int(random.integers(1 << 30)))
    given |= {f"{wall}.{axis}": normal[:, i] for i, axis in enumerate("xyz")}
    given[f"{wall}.distance"] = normal @ where.position - random.uniform(*AWAY, BATCH)
    given[f"{wall}.stiffness"] = np.exp(random.uniform(np.log(SOFTEST), np.log(stiffest), BATCH))
    for hand in (1, 2):
        force = directions(BATCH, int(random.integers(1 << 30))) * random.uniform(*PUSH, (BATCH, 1))
        own = f"plant.environment.{hand}"
        given |= {f"{own}.{axis}": force[:, i] for i, axis in enumerate("xyz")}
        step = EVERY * DT
        onset = random.integers(10, 200, BATCH)
        given[f"{own}.onset"] = (onset - 0.5 / EVERY) * step  # between two samples: no rounding decides
        given[f"{own}.end"] = (onset + random.integers(5, 150, BATCH) - 0.5 / EVERY) * step
    return given


def _gained(robot: armgpi.Robot, law: Any, where: Any, rollout: Any, given: dict[str, Array]) -> Array:
    """Return the most energy [J] that is in motion and springs beyond what the tool got, (rollouts,)."""
    motion = FrameMotion(robot, robot.tip)
    position = motion.pose(rollout["q"].values).position
    times = rollout["time"].values
    wall = "plant.environment.0"
    normal = np.stack([given[f"{wall}.{axis}"] for axis in "xyz"], axis=-1)
    depth = given[f"{wall}.distance"][:, None] - np.einsum("rsi,ri->rs", position, normal)
    got = -0.5 * given[f"{wall}.stiffness"][:, None] * np.maximum(depth, 0.0) ** 2
    rows = np.arange(len(position))
    for hand in (1, 2):
        own = f"plant.environment.{hand}"
        force = np.stack([given[f"{own}.{axis}"] for axis in "xyz"], axis=-1)
        along = np.einsum("rsi,ri->rs", position, force)
        begin = np.searchsorted(times, given[f"{own}.onset"])
        end = np.searchsorted(times, given[f"{own}.end"])
        low, high = along[rows, begin][:, None], along[rows, end][:, None]
        sample = np.arange(len(times))[None]
        got = got + np.where(sample < begin[:, None], 0.0, np.where(sample < end[:, None], along, high) - low)
    looked = np.linspace(0, len(times) - 1, LOOKS + 1).astype(int)[1:]
    stored = np.stack([_stored(robot, law, where, rollout, given, i) for i in looked], axis=-1)
    return np.asarray(np.maximum((stored - got[:, looked]).max(axis=1), 0.0))


def _stored(
    robot: armgpi.Robot, law: Any, where: Any, rollout: Any, given: dict[str, Array], sample: int
) -> Array:
    """Return the energy [J] of the motion and of the springs at a sample, (rollouts,)."""
    q, v = rollout["q"].values[:, sample], rollout["v"].values[:, sample]
    rotors = given["plant.rotor_inertia"] - robot.armature
    motion = 0.5 * np.einsum("ri,rij,rj->r", v, robot.mass_matrix(q), v) + 0.5 * (rotors * v * v).sum(axis=1)
    tool = FrameMotion(robot, robot.tip).pose(q)
    turned = rotation_between(tool.rotation, np.broadcast_to(where.rotation, tool.rotation.shape))
    offset = np.concatenate([tool.position - where.position, turned], axis=-1)
    springs = 0.5 * (np.asarray(law.stiffness) * offset * offset).sum(axis=1)
    if law._redundant:  # what the tool does not see of the joints' error is held by the posture's spring
        jacobian = robot.frame_jacobian(robot.tip, where.q)
        beside = np.eye(robot.n) - np.linalg.pinv(jacobian) @ jacobian
        springs = springs + 0.5 * law.nullspace_stiffness * (((q - where.q) @ beside) ** 2).sum(axis=1)
    return np.asarray(motion + springs)


def _counts(robot: armgpi.Robot, law: Any, q: Array, bits: Array) -> Array:
    """Return the torque of each joint that half a count of all joints makes at most, (rollouts, n)."""
    jacobian = robot.frame_jacobian(robot.tip, q)
    stiffness = jacobian.T @ (np.asarray(law.stiffness)[:, None] * jacobian)
    damping = law._alpha * robot.mass_matrix(q) + law._beta * stiffness
    if robot.n > 6:
        stiffness = stiffness + law.nullspace_stiffness * np.eye(robot.n)
    # The filtered difference answers a step of one count by _drive, and holds its sum.
    torque = np.abs(stiffness) + law._drive * np.abs(damping)
    return np.asarray((np.pi * 0.5 ** bits.astype(float)) @ torque.T)
