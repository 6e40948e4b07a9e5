"""The stages of a bring-up: from a dry run to full speed, as experiment files that every command takes.

Each file has caps in its `supervisor`: on the torque beside what holds the model, on speed, and on the
distance from the reference. Whoever runs it, simulated, as two processes or as exported C, keeps to them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from armgpi.base import files
from armgpi.base.arrays import Array
from armgpi.base.version import other_format
from armgpi.config import Experiment, build, check
from armgpi.config.reading import Loaded, Origin, read_data
from armgpi.config.schema import FORMAT
from armgpi.errors import ConfigError
from armgpi.gpi.law import GPI
from armgpi.hardware.realtime.ends import UPRIGHT
from armgpi.identification.excitation import FIRST_SHARE, excite
from armgpi.references.bezier import minimum_duration
from armgpi.references.reference import Reference
from armgpi.references.waypoints import Waypoints
from armgpi.robot.robot import Robot
from armgpi.tuning.rule import usual_effort

#: The list of stages in a folder, of the format of their experiments.
INDEX = "stages.yaml"
#: How far a joint is moved by hand in the dry run [rad or m].
_BY_HAND = 0.15
#: How fast it is moved [rad/s or m/s].
_HAND_SPEED = 0.8
#: How long the arm stands between two moves by hand [s].
_HAND_STAND = 0.1
#: Sampling of references that are written as tables [s].
_SAMPLE = 0.01
#: Acceleration of moves between them [rad/s^2].
_ACCELERATION = 0.5
#: Shortest move from and to the start [s].
_SHORTEST = 0.1
#: Acceleration of a joint alone that its motor is for [rad/s^2 or m/s^2]. Set by hand.
_BRISK = 30.0
#: How long the arm stands before and after a move [s].
_STAND = 0.4
#: Share of its cap at which a reference is fastest: the law overshoots.
_OF_CAP = 0.6


class Caps(NamedTuple):
    """What a kind of stage allows. Torques are shares of :func:`moving_torque`, beside the file's friction.

    Attributes:
        torque: beside what holds the model, of a joint that moves.
        held: the same of the others.
        speed: [rad/s or m/s], at most the file's limit.
        following: distance from the reference [rad or m].
        bandwidth: of the law, at most [rad/s].
        way: of the reference [rad or m]; 0 for motions that are given.
    """

    torque: float
    held: float
    speed: float
    following: float
    bandwidth: float
    way: float = 0.0


#: Kind -> its caps. Set by hand, so that tools/bringup.py's wrong robots travel 0.055 rad at most, and few of
#: tools/sound.py's are stopped for friction that the file does not tell.
CAPS = {
    "pulse": Caps(torque=0.15, held=0.1, speed=0.1, following=0.035, bandwidth=8.0, way=0.03),
    "joint": Caps(torque=0.3, held=0.2, speed=0.25, following=0.04, bandwidth=15.0, way=0.1),
    "excite": Caps(torque=0.6, held=0.6, speed=1.0, following=0.075, bandwidth=math.inf),
    "slow": Caps(torque=0.6, held=0.6, speed=1.0, following=0.075, bandwidth=math.inf),
}
#: How much slower than the file the whole arm moves first, and beyond its limits at full speed, as a share.
_SLOWER, _OVERSPEED = 4.0, 0.2


class Stage(NamedTuple):
    """One step of a bring-up.

    Attributes:
        name: of its file and of its log.
        kind: "dry", "pulse", "joint", "excite", "slow" or "full".
        joints: that move.
        way: how far each moves first [rad or m]; empty for motions that are given.
    """

    name: str
    kind: str
    joints: tuple[str, ...]
    way: tuple[float, ...] = ()


class Folder(NamedTuple):
    """A bring-up that was written.

    Attributes:
        path: the folder.
        stages: in their order.
    """

    path: Path
    stages: tuple[Stage, ...]

    def stage(self, log: Path) -> Stage:
        """Return the stage that a log is of: it has its name.

        Raises:
            ConfigError: when there is none.
        """
        for stage in self.stages:
            if stage.name == log.stem:
                return stage
        names = ", ".join(stage.name for stage in self.stages)
        raise ConfigError(str(log), "", f"is a log of no stage; expected a name of {names}, .armlog behind")

    def experiment(self, stage: Stage) -> Experiment:
        """Return what the file of a stage describes."""
        from armgpi.config import read

        return build(*read(self.path / f"{stage.name}.yaml"))


def write(loaded: Loaded, experiment: Experiment, path: Path, floor: float | None = None) -> Folder:
    """Write the stages of an arm into a folder.

    Args:
        loaded: its experiment file.
        experiment: what that describes.
        path: the folder.
        floor: height that the links stay above while the arm is excited [m].

    Raises:
        ConfigError: when the experiment has no arm of its own, or a joint has no room to move.
        ParameterError: when there is no motion to excite it by.
    """
    import yaml

    if loaded.config.reality is not None:
        raise ConfigError(loaded.origin.source, "reality", "a bring-up needs an arm of its own: give `plant`")
    contents: dict[str, str] = {}
    stages = []
    for stage, data, table in _plan(loaded, experiment, floor):
        stages.append(stage)
        check(data, Origin(f"{stage.name}.yaml"))
        contents[f"{stage.name}.yaml"] = yaml.safe_dump(data, sort_keys=False, allow_unicode=True)
        if table:
            contents[f"{stage.name}.csv"] = table
    rows = []
    for stage in stages:
        lists = {"joints": list(stage.joints), "way": list(stage.way)}
        rows.append({**stage._asdict(), **lists})
    index = {"format": FORMAT, "robot": experiment.robot.name, "stages": rows}
    contents[INDEX] = yaml.safe_dump(index, sort_keys=False, allow_unicode=True)
    files.write_set(files.make_folder(path), contents)
    return Folder(path, tuple(stages))


def read(path: Path) -> Folder:
    """Return the bring-up in a folder.

    Raises:
        ConfigError: when there is none.
    """
    if not (path / INDEX).is_file():
        raise ConfigError(str(path), "", f"has no {INDEX}: `armgpi bringup FILE -o {path}` writes the stages")
    data, origin = read_data(path / INDEX)
    file_format = data.get("format")
    if file_format != FORMAT:
        raise ConfigError(origin.source, "format", other_format(file_format, FORMAT))
    try:
        stages = []
        for row in data["stages"]:
            way = tuple(map(float, row["way"]))
            stages.append(Stage(str(row["name"]), str(row["kind"]), tuple(row["joints"]), way))
    except (KeyError, TypeError, ValueError):
        raise ConfigError(origin.source, "stages", "is no list that `armgpi bringup` wrote") from None
    return Folder(path, tuple(stages))


def _plan(
    loaded: Loaded, experiment: Experiment, floor: float | None
) -> Iterator[tuple[Stage, dict[str, Any], str]]:
    """Yield each stage, its file as plain data, and its reference as a table where it needs one."""
    robot = experiment.robot
    names = robot.joint_names
    start = experiment.reference.at(0.0).q
    ways = np.array([_way(robot, start, j, _BY_HAND) for j in range(robot.n)])
    by_hand = _moves(start, np.diag(ways), _HAND_SPEED, _HAND_STAND)
    dry = Stage("10-dry", "dry", names, tuple(ways.tolist()))
    yield dry, _file(loaded, experiment, None, names, by_hand), ""
    number = 20
    for kind in ("pulse", "joint"):
        for j, name in enumerate(names):
            caps = CAPS[kind]
            way = _way(robot, start, j, caps.way)
            unit = np.eye(robot.n)[j] * way
            speed = _OF_CAP * min(caps.speed, _fastest(robot)[j])
            moves = _moves(start, [unit], speed)
            stage = Stage(f"{number + j}-{kind}-{name}", kind, (name,), (way,))
            yield stage, _file(loaded, experiment, caps, (name,), moves), ""
        number += 10 * (1 + robot.n // 10)
    height: float | Literal["usual"] = "usual" if floor is None else floor
    first = excite(robot, share=FIRST_SHARE, floor=height).reference
    slow = experiment.reference
    tables = {
        "excite": _table(robot, start, first, first.t_end, 1.0),
        "slow": _table(robot, start, slow, experiment.t_final, 1.0 / _SLOWER),
    }
    for kind, (table, seconds) in tables.items():
        name = f"{number}-{kind}"
        t_final = round(seconds + _STAND, 3)
        motion = {"reference": {"file": f"{name}.csv"}, "t_final": t_final}
        yield Stage(name, kind, names), _file(loaded, experiment, CAPS[kind], names, motion), table
        number += 10
    data = _file(loaded, experiment, None, names, None)
    supervisor = data.get("supervisor") or {}
    speed = supervisor.get("speed") or _OVERSPEED
    data["supervisor"] = {**supervisor, "speed": speed}
    yield Stage(f"{number}-full", "full", names), data, ""


def _file(
    loaded: Loaded,
    experiment: Experiment,
    caps: Caps | None,
    moving: tuple[str, ...],
    motion: Mapping[str, Any] | None,
) -> dict[str, Any]:
    """Return an experiment file: the arm's own with caps and a motion."""
    robot = experiment.robot
    data = {"format": FORMAT, **loaded.config.plain(given=True)}
    robot_file = Path(data["robot"]["name"])
    if robot_file.is_file():
        data["robot"]["name"] = str(robot_file.resolve())
    reference_file = data.get("reference", {}).get("file")
    if reference_file is not None:
        data["reference"]["file"] = str(Path(reference_file).resolve())
    filled = experiment.config.controllers[0].plain()
    controllers = data.get("controllers") or [{"type": filled["type"]}]
    section = dict(controllers[0])
    law = next(iter(experiment.controllers.values()))
    data["controllers"] = [section]
    data["supervisor"] = dict(data.get("supervisor") or {})
    data.pop("vary", None)
    if motion is None:
        return data
    data |= motion
    if data.get("plant"):  # the load that the model does not know comes with the full speed
        data["plant"].pop("payload", None)
    if caps is None:
        return data
    if isinstance(law, GPI) and not law.gains.adaptive:
        omega = np.broadcast_to(law.gains.nominal().omega_c, robot.n)
        section["omega"] = _by_joint(robot, np.minimum(omega, caps.bandwidth))
    is_moving = np.isin(robot.joint_names, moving)
    shares = np.where(is_moving, caps.torque, caps.held)
    at_start = moving_torque(robot, experiment.reference.at(0.0).q)
    speed = np.minimum(caps.speed, _fastest(robot))
    data["supervisor"] |= {
        "torque_cap": _by_joint(robot, shares * at_start + robot.friction.coulomb),
        "speed_cap": _by_joint(robot, speed),
        "following": caps.following,
    }
    return data


def moving_torque(robot: Robot, q: Array) -> Array:
    """Return the torque that a joint is moved with [N m or N], (n,): five times gravity, or 30 rad/s^2 alone.

    Friction of gears is some percent of it; efforts of some files are far above it.
    """
    brisk = _BRISK * np.diagonal(robot.mass_matrix(q))
    usual = usual_effort(robot.with_gravity(UPRIGHT))
    return np.minimum(robot.limits.effort, np.maximum(usual, brisk))


def _by_joint(robot: Robot, values: Array) -> dict[str, float]:
    """Return numbers of an arm's joints by their names, to three digits."""
    pairs = zip(robot.joint_names, values, strict=True)
    return {name: float(f"{value:.3g}") for name, value in pairs}


def _fastest(robot: Robot) -> Array:
    """Return the speed limits, 1 where there is none [rad/s or m/s]."""
    limit = robot.limits.velocity
    is_limited = np.isfinite(limit) & (limit > 0.0)
    return np.where(is_limited, limit, 1.0)


def _way(robot: Robot, start: Array, joint: int, way: float) -> float:
    """Return how far a joint moves: up where there is room, else down.

    Raises:
        ConfigError: when there is no room.
    """
    if robot.limits.upper[joint] - start[joint] >= way:
        return way
    if start[joint] - robot.limits.lower[joint] >= way:
        return -way
    name = robot.joint_names[joint]
    raise ConfigError("reference", name, f"has less than {way:g} to move to either side of where it starts")


def _moves(start: Array, steps: Iterable[Array], speed: float, stand: float = _STAND) -> dict[str, Any]:
    """Return moves out and back, one after another, and how long they take."""
    points = [start]
    durations: list[float] = []
    for step in steps:
        points += [start + step, start]
        duration = round(minimum_duration(step, speed), 3)
        durations += [duration, duration]
    t_final = round(sum(durations) + stand * len(points), 3)
    moves = {"points": [point.tolist() for point in points], "durations": durations, "holds": stand}
    return {"reference": moves, "t_final": t_final}


def _table(robot: Robot, start: Array, reference: Reference, end: float, rate: float) -> tuple[str, float]:
    """Return a reference at a rate of time, with moves from and to the start, as CSV; and its length [s]."""
    first = reference.at(0.0).q
    last = reference.at(end).q
    speed = FIRST_SHARE * _fastest(robot)
    seconds_there = max(minimum_duration(first - start, speed, _ACCELERATION), _SHORTEST)
    seconds_back = max(minimum_duration(last - start, speed, _ACCELERATION), _SHORTEST)
    approach = Waypoints([start, first], [seconds_there])
    home = Waypoints([last, start], [seconds_back])
    begin = seconds_there
    after = seconds_there + end / rate
    t = np.arange(0.0, seconds_there + end / rate + seconds_back, _SAMPLE)
    q = reference.at((t - begin).clip(0.0) * rate).q
    q = np.where((t < begin)[:, None], approach.at(t).q, q)
    q = np.where((t > after)[:, None], home.at((t - after).clip(0.0)).q, q)
    lines = [",".join(["time", *robot.joint_names])]
    for time, position in zip(t, q, strict=True):
        lines.append(",".join(f"{x:.12g}" for x in (time, *position)))
    return "\n".join(lines) + "\n", float(t[-1])
