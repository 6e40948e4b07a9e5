"""What an arm under its default controller does when its tool is pushed: a simulation, by directions."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array, check_number
from armgpi.control.controller import Controller
from armgpi.errors import ArmgpiWarning, ParameterError
from armgpi.gpi.law import GPI
from armgpi.loop.rollout import Status
from armgpi.loop.simulation import simulate
from armgpi.plants.elastic import ElasticPlant
from armgpi.plants.environment import ToolForce
from armgpi.plants.plant import Plant
from armgpi.plants.rigid_body import RigidBodyPlant
from armgpi.plants.sensors import Encoder
from armgpi.references.waypoints import Hold
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import assume_drives

#: When the push begins and how long it is watched [s].
_ONSET, _WATCHED = 0.2, 2.0
#: Configurations of which the one with most clearance is taken.
_CONFIGURATIONS = 200
#: Share of the largest displacement within which the tool is back.
_BACK = 0.1
#: Directions of the base's axes.
_AXES = "xyz"


class Pushed(NamedTuple):
    """What a push along an axis of the base does.

    Attributes:
        axis: "x", "y" or "z".
        displacement: largest distance of the tool from where it was, beyond a rest before [m].
        stiffness: force over that distance [N/m]: at worst, as the controller then brings it back.
        damping: force over the tool's largest speed [N s/m].
        back: time from the onset until it stays within a tenth of that distance, though the force goes on
            [s]; NaN where it does not in 2 s.
    """

    axis: str
    displacement: float
    stiffness: float
    damping: float
    back: float


def pushed(
    robot: Robot,
    force: float = 20.0,
    controller: Controller | None = None,
    *,
    dt: float = 1e-3,
    bits: int | None = 16,
    q: Array | None = None,
) -> list[Pushed]:
    """Simulate a constant push on the tip along each axis of the base.

    The controller holds a configuration; the arm has elastic joints where its drives are known or assumed.

    Args:
        robot: the arm.
        force: of the push [N].
        controller: what holds it; the default controller when not given.
        dt: sample time [s] of the default controller.
        bits: of the encoders; None for exact positions.
        q: configuration [rad or m], (n,); far from limits and singular configurations when not given.

    Raises:
        ParameterError: for a force that is not positive, or an arm that the push throws off.
        LimitError: when `q` is outside the joint limits.
    """
    force = check_number(force, "force", "positive [N]", open_=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)
        known = assume_drives(robot)
        if controller is None:
            controller = GPI.auto(known, dt, bits=bits)
    home = roomy(robot) if q is None else robot.check_position(q, "q")
    is_elastic = not np.isnan(known.drives.value("stiffness")).any()
    engine = ElasticPlant if is_elastic else RigidBodyPlant
    t_final = _ONSET + _WATCHED
    pushes = []
    for axis, direction in zip(_AXES, np.eye(3), strict=True):
        push = ToolForce(force=force * direction, onset=_ONSET, frame=robot.tip)
        plant: Plant = engine(known, environment=[push])
        if bits is not None:
            plant = Encoder(plant, bits)
        rollout = simulate(plant, controller, Hold(home), t_final, progress=False, backend="auto")
        if int(rollout["status"]) != Status.FINISHED:
            raise ParameterError("force", force, f"a push that {robot.name!r} withstands along {axis}")
        pushes.append(_judge(axis, force, rollout["tool"].values, rollout["time"].values))
    return pushes


def _judge(axis: str, force: float, tool: Array, times: Array) -> Pushed:
    """Return what the tool's positions (samples, 3) [m] say of a push."""
    dt = times[1] - times[0]
    begin = int(np.searchsorted(times, _ONSET))
    moved = np.linalg.norm(tool[begin:] - tool[begin], axis=-1)
    speed = np.linalg.norm(np.gradient(tool[begin:], dt, axis=0), axis=-1)
    most = float(moved.max())
    last_away = int(np.flatnonzero(moved > _BACK * most)[-1])
    back = np.nan
    if last_away + 1 < len(moved):
        back = (last_away + 1) * float(dt)
    return Pushed(axis, most, force / most, force / float(speed.max()), back)


def roomy(robot: Robot) -> Array:
    """Return a configuration far from joint limits and singular ones [rad or m], (n,)."""
    configurations = random_configurations(robot, _CONFIGURATIONS, seed=0)
    lower, upper = robot.limits.lower, robot.limits.upper
    half = np.minimum(0.5 * (upper - lower), np.pi)
    margin = 1.0 - np.abs((configurations - robot.middle()) / half).max(axis=1)
    jacobians = robot.frame_jacobian(robot.tip, configurations)[:, :3]
    least_singular_value = np.linalg.svd(jacobians, compute_uv=False)[:, -1]
    return np.asarray(configurations[np.argmax(least_singular_value * margin)])


def describe(found: list[Pushed], force: float) -> str:
    """Return in words what pushes do, from the softest direction to the stiffest."""
    softest = max(found, key=lambda push: push.displacement)
    stiffest = min(found, key=lambda push: push.displacement)
    slowest = max(push.back for push in found)
    dampings = [push.damping for push in found]
    back = "not back within 2 s" if np.isnan(slowest) else f"back after {slowest:.2g} s at most"
    return (
        f"pushed by {force:g} N, the default controller lets the tool give way by "
        f"{1e3 * stiffest.displacement:.2g} to {1e3 * softest.displacement:.2g} mm "
        f"({softest.stiffness:.3g} to {stiffest.stiffness:.3g} N/m, "
        f"{min(dampings):.2g} to {max(dampings):.2g} N s/m), {back} "
        "(within a tenth of that, though the push goes on)"
    )
