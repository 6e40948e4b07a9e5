"""What the parts of the page of compliance share: arms, draws, what touches them, and running batches."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import numpy as np
from tool import Place, _place

import armgpi
from armgpi.base.arrays import Array
from armgpi.base.parameter import parameter, with_parameters
from armgpi.plants.environment import Contact, Wrench
from armgpi.robot.frame_motion import FrameMotion, Motion

DT = 1e-3
#: Arms on which what is measured here was not made or tuned; UR5 and Panda are those that it was made on.
ARMS = ("ur10", "xarm7", "z1", "tiago_pro_left_arm", "baxter_left_arm", "ur3")
#: Seeds of their draws.
SEEDS = {"ur10": 1, "xarm7": 0, "z1": 0, "tiago_pro_left_arm": 1, "baxter_left_arm": 0, "ur3": 1, "panda": 2}
#: Where those have the room of a circle of 240 mm: found once, in every process.
_PLACES: dict[str, Place] = {}
#: Distance of a wall that nothing touches [m].
AWAY = 10.0
#: Encoders [bits] and Coulomb friction as a share of the effort that are drawn; of viscous friction [s].
BITS, FRICTION, VISCOUS = (16, 20), (0.01, 0.05), 0.02
#: Rotors and friction are known within these factors.
ROTORS, KNOWN = 0.3, 1.2


@with_parameters
class Surface(Contact):
    """A wall whose direction may differ by rollout: its normal in three numbers, of length 1.

    Attributes:
        x: of the normal.
        y: likewise.
        z: likewise.
        distance: of the plane from the base's origin, along the normal [m].
        stiffness: [N/m].
        damping: [N s/m].
    """

    config_name: ClassVar[str | None] = None

    x: float = parameter("normal along x", default=0.0)
    y: float = parameter("normal along y", default=0.0)
    z: float = parameter("normal along z", default=1.0)
    distance: float = parameter("distance of the plane from the base", unit="m", default=-AWAY)
    stiffness: float = parameter("stiffness", unit="N/m", default=1e4, least=0.0)
    damping: float = parameter("damping", unit="N s/m", default=0.0, least=0.0)

    def wrench(self, motion: Motion, t: Array) -> Wrench:
        """Return the force of the wall."""
        normal = self._normal(motion.position)
        depth = self.distance - _sum(motion.position * normal)
        pressed = np.maximum(self.stiffness * depth - self.damping * _sum(motion.velocity * normal), 0.0)
        pressed = np.where(depth > 0.0, pressed, 0.0)
        return Wrench(pressed * normal, 0.0 * motion.position)

    def _normal(self, position: Array) -> Array:
        """Return the normal in the shape of a position."""
        zero = 0.0 * position[..., 0:1]
        return np.concatenate([zero + self.x, zero + self.y, zero + self.z], axis=-1)


@with_parameters
class Hand(Contact):
    """A force and a moment that may differ by rollout, from an onset until an end.

    Attributes:
        x: of the force [N].
        y: likewise.
        z: likewise.
        moment: about the axis of the force [N m].
        onset: when it begins [s].
        end: when it is over [s].
    """

    config_name: ClassVar[str | None] = None

    x: float = parameter("force along x", unit="N", default=0.0)
    y: float = parameter("force along y", unit="N", default=0.0)
    z: float = parameter("force along z", unit="N", default=0.0)
    onset: float = parameter("begin", unit="s", default=0.1)
    end: float = parameter("end", unit="s", default=0.5)

    def wrench(self, motion: Motion, t: Array) -> Wrench:
        """Return the force."""
        now = t + 0.0 * motion.position[..., 0:1]
        acts = np.where((now >= self.onset) & (now < self.end), 1.0, 0.0)
        force = np.concatenate([acts * self.x, acts * self.y, acts * self.z], axis=-1)
        return Wrench(force, 0.0 * force)


def _sum(vector: Array) -> Array:
    """Return the sums over the last axis of (..., 3), (..., 1)."""
    return vector[..., 0:1] + vector[..., 1:2] + vector[..., 2:3]


class Tool(NamedTuple):
    """The tool over a batch of runs.

    Attributes:
        times: of the samples [s], (samples,).
        position: [m], (rollouts, samples, 3).
        turned: angle between the tool and where the reference has it [deg], (rollouts, samples).
    """

    times: Array
    position: Array
    turned: Array


def place(name: str) -> Place:
    """Return an arm with assumed rotors, where it has room."""
    if name not in _PLACES:
        _PLACES[name] = _place(name)
    return _PLACES[name]


def tool_of(robot: armgpi.Robot, rollout: Any) -> Tool:
    """Return what the tool does in a batch whose q and q_ref were recorded."""
    motion = FrameMotion(robot, robot.tip)
    q, q_ref = rollout["q"].values, rollout["q_ref"].values
    actual, wished = motion.pose(q), motion.pose(np.broadcast_to(q_ref, q.shape))
    half = np.sqrt(((actual.rotation - wished.rotation) ** 2).sum(axis=(-1, -2)) / 8.0)
    angle = np.degrees(2.0 * np.arcsin(np.minimum(half, 1.0)))
    return Tool(rollout["time"].values, actual.position, angle)


def depth(tool: Tool, given: dict[str, Array], prefix: str) -> Array:
    """Return how deep the tool is behind its surface [m], (rollouts, samples)."""
    normal = np.stack([given[f"{prefix}.{axis}"] for axis in "xyz"], axis=-1)
    along = np.einsum("rsi,ri->rs", tool.position, normal)
    return np.asarray(given[f"{prefix}.distance"][:, None] - along)


def friction_of(robot: armgpi.Robot, share: float) -> armgpi.Friction:
    """Return the friction of an arm whose Coulomb friction is a share of the effort."""
    effort = robot.limits.effort
    return armgpi.Friction(VISCOUS * effort, share * effort)


def drawn(
    robot: armgpi.Robot, level: armgpi.Friction, heaviest: float, count: int, random: np.random.Generator
) -> dict[str, Array]:
    """Return drawn rotors, friction, encoders and payloads of a loop.

    Args:
        robot: with its assumed rotors.
        level: friction as it is known.
        heaviest: of the payloads [kg], which begin at 0.
        count: how many of each.
        random: draws them.
    """
    shape = (count, robot.n)
    return {
        "plant.rotor_inertia": robot.armature * random.uniform(1.0 - ROTORS, 1.0 + ROTORS, shape),
        "plant.viscous": np.tile(level.viscous, (count, 1)),
        "plant.coulomb": level.coulomb * random.uniform(1.0 / KNOWN, KNOWN, shape),
        "plant.encoder_bits": np.tile(random.integers(BITS[0], BITS[1] + 1, (count, 1)), (1, robot.n)),
        "plant.payload.mass": random.uniform(0.0, heaviest, count),
    }


def friction_at_tool(robot: armgpi.Robot, q: Array, level: Array, direction: Array) -> float:
    """Return the most that Coulomb friction [N m], (n,), holds at the tool along a direction [N]."""
    jacobian = robot.frame_jacobian(robot.tip, q)
    push = np.linalg.pinv(jacobian.T)[:3]
    return float(np.abs(direction @ push) @ level)


def loop(
    robot: armgpi.Robot, law: Any, reference: Any, seconds: float, contacts: Any, every: int = 2, **how: Any
) -> Any:
    """Return a prepared loop of an arm with friction, encoders, delay and contacts, which may all be given.

    Args:
        robot: the arm, with a payload of its own where one is to be drawn.
        law: the controller.
        reference: where to.
        seconds: how long [s].
        contacts: what touches it.
        every: record every so many samples.
        **how: `elastic` for the arguments of elastic joints, `velocity` for "true" or "differenced",
            `record` for other names, `bits` for None, `supervisor`.
    """
    level = armgpi.Friction(np.zeros(robot.n), np.zeros(robot.n))
    arm: Any
    if how.get("elastic"):
        arm = armgpi.ElasticPlant(robot, (), level, environment=contacts, **how["elastic"])
    else:
        arm = armgpi.RigidBodyPlant(robot, (), level, environment=contacts)
    velocity = how.get("velocity")
    plant: Any = arm if velocity == "true" or how.get("bits", 17) is None else armgpi.Encoder(arm, 17)
    if velocity == "differenced":
        plant = armgpi.Differentiated(plant, bandwidth=250.0)
    late = int(how.get("late", 1))
    if late:
        plant = armgpi.Delayed(plant, late)
    record = how.get("record", ("q", "q_ref"))
    return armgpi.prepare(
        plant,
        law,
        reference,
        seconds,
        record=record,
        record_every=every,
        backend="compiled",
        supervisor=how.get("supervisor"),
    )


def spread(values: Any, digits: str = ".3g") -> str:
    """Return median and largest of some numbers as text."""
    found = np.asarray(values, dtype=np.float64)
    return f"{np.median(found):{digits}}, {np.max(found):{digits}}"


def directions(count: int, seed: int) -> Array:
    """Return so many directions, (count, 3)."""
    drawn = np.random.default_rng(seed).normal(size=(count, 3))
    return np.asarray(drawn / np.linalg.norm(drawn, axis=1, keepdims=True))


def beside(axis: Array, angle: float, turn: float) -> Array:
    """Return a direction at an angle [rad] from an axis, turned about it by another."""
    other = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    other = other / np.linalg.norm(other)
    third = np.cross(axis, other)
    aside = math.cos(turn) * other + math.sin(turn) * third
    return np.asarray(math.cos(angle) * axis + math.sin(angle) * aside)


#: A part of the page: prints its tables, quick or not.
Part = Callable[[bool], None]
