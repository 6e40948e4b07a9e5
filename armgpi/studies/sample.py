"""Sweeps: an experiment, what varies in it and when it has failed; a chunk depends on it and its number."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from armgpi.arrays import Array
from armgpi.config import Experiment, ExperimentConfig, Origin, build, keys, read
from armgpi.config.building import IDENTIFICATION, real_arm
from armgpi.errors import ArmgpiWarning, BackendError, NameNotFound, ParameterError
from armgpi.health.reality import in_rows, prepare_draws
from armgpi.identification.posterior import Posterior, parts, read_posterior
from armgpi.identification.weak_form import COLUMNS
from armgpi.loop import metrics
from armgpi.loop.prepared import PreparedLoop, prepare
from armgpi.loop.rollout import FAULTS, Status
from armgpi.loop.variables import Variable, current
from armgpi.parameter import parameters
from armgpi.plants.arm import Arm
from armgpi.plants.plant import Wrapper, inside
from armgpi.plants.reality import Draw, Reality, batches
from armgpi.registry import classes_of
from armgpi.robot.batch import RobotBatch
from armgpi.studies.distributions import KINDS, SAMPLINGS, Distribution, distribution, shares
from armgpi.studies.study import Identity, Study, identify, read_identity

#: Rollout-steps of a chunk, about: some seconds of compiled code.
_WORK = 1 << 23
#: Rollouts of a chunk, at least and at most; a draw of a reality takes milliseconds.
_FEWEST, _MOST, _MOST_DRAWS = 16, 4096, 256
#: A rollout has failed that diverges or exceeds one of these, where the file does not say.
FAILURE: Mapping[str, float] = {"peak_error": 0.5, "final_error": 0.1}
#: What is kept of a rollout, and what runs it.
_KEPT: Mapping[str, Any] = {"record": "metrics", "backend": "compiled"}
#: What goes with a load that varies, and what an identification draws of a plant.
_LOAD = ("plant.payload.mass", "plant.payload.frame", "plant.payload.com")
_IDENTIFIED = ("plant.rotor_inertia", "plant.viscous", "plant.coulomb")
#: The files of a study in its folder.
EXPERIMENT, CHUNKS = "experiment.yaml", "chunks"
#: What is told of a draw of a reality.
_DRAWN = (
    "sample_time",
    "delay",
    "encoder_bits",
    "payload",
    "inertia_scale",
    "rotor_inertia",
    "coulomb",
    "step",
)


@dataclass(frozen=True)
class Sweep:
    """An experiment, what varies in it, and how it is drawn.

    Attributes:
        config: the experiment file, checked.
        experiment: what it describes.
        label: the controller that is run.
        varied: name -> distribution; empty where a reality is drawn.
        failure: metric -> largest value of any joint in a rollout that has not failed.
        sampling: "random" or "sobol".
        size: rollouts of a chunk.
        identity: all of this, with the bytes of every file that it names and the code that runs it.
    """

    config: ExperimentConfig
    experiment: Experiment
    label: str
    varied: Mapping[str, Distribution]
    failure: Mapping[str, float]
    sampling: str
    size: int
    identity: Identity

    @classmethod
    def of(cls, config: ExperimentConfig, origin: Origin | None = None, sampling: str = "random") -> Sweep:
        """Return the sweep that an experiment file describes.

        Raises:
            ConfigError: when something in it does not fit; it names the key.
        """
        if sampling not in SAMPLINGS:
            raise ParameterError("sampling", sampling, f"one of {', '.join(SAMPLINGS)}")
        renamed = {current(name): each for name, each in config.vary.items()}
        config = config.replace(vary=renamed)
        experiment = build(config, origin)
        label = next(iter(experiment.controllers))
        origin = origin or Origin("")
        if bool(config.vary) == (config.reality is not None):
            said = "a sweep varies something: give distributions below vary, or a reality to draw from"
            raise origin.error(("vary",), said)
        if not getattr(classes_of(Arm).get(config.plant.engine), "varies", False):
            said = f"a sweep runs generated code, which {config.plant.engine!r} has none of; take armgpi"
            raise origin.error(("plant", "engine"), said)
        failure = dict(config.failure or FAILURE)
        unknown = [name for name in failure if name not in metrics.declared()]
        if unknown:
            reason = str(NameNotFound("metric", unknown[0], metrics.declared()))
            raise origin.error(("failure", unknown[0]), reason)
        steps = experiment.t_final / config.sample_time
        drawn = config.reality is not None or IDENTIFICATION in config.vary
        most = _MOST_DRAWS if drawn else _MOST
        size = (
            min(most, max(_FEWEST, 1 << math.floor(math.log2(_WORK / steps)))) if steps < _WORK else _FEWEST
        )
        asked = {"method": "sweep", "sampling": sampling, "size": size, "failure": failure}
        found = cls(config, experiment, label, {}, failure, sampling, size, identify(config, asked))
        if config.reality is not None:
            return found
        loop, varied = found._loop(), {}
        for name, section in config.vary.items():
            try:
                if name == IDENTIFICATION:
                    varied[name] = found._arms_left(section)
                    continue
                if IDENTIFICATION in config.vary and name in _IDENTIFIED:
                    raise ParameterError(name, "varied", f"left to {IDENTIFICATION}, which draws it as well")
                variable = _find_variable(loop.parameters, name, config.plant.keys)
                known = (variable.declared, experiment.robot.n, variable.value)
                varied[name] = distribution(name, section, *known)
                # Its worst cases are written to a file, which needs a key for it.
                _put(experiment.config.plain(), name, 1.0, found)
            except (ParameterError, NameNotFound) as error:
                raise origin.error(("vary", name), str(error).removeprefix(f"{name}: ")) from None
        object.__setattr__(found, "varied", varied)
        return found

    def enter(self, folder: Path, accept_code: bool = False) -> Study:
        """Make a folder that of this sweep, or find that it is; see :meth:`Study.enter`."""
        return Study.enter(folder, self.identity, EXPERIMENT, accept_code)

    @property
    def robot(self) -> Any:
        """The arm as its URDF has it."""
        return self.experiment.robot

    @property
    def columns(self) -> list[str]:
        """Names of the numbers of a rollout: what was drawn, metrics of every joint, and how it ended."""
        joints = self.robot.joint_names
        drawn = [*_DRAWN] if self.config.reality is not None else []
        for name, each in self.varied.items():
            drawn += [name] if each.joints == 1 else self._names_of(name)
        return [*drawn, *(f"{name}[{joint}]" for name in self.metrics for joint in joints), *self.ends]

    @property
    def ends(self) -> list[str]:
        """Names of the numbers that say how a rollout ended."""
        return ["status", "t_end", *(() if self.experiment.supervisor is None else FAULTS)]

    @property
    def drawn_names(self) -> list[str]:
        """Names of the numbers that were drawn."""
        return self.columns[: -len(self.ends) - len(self.metrics) * self.robot.n]

    @property
    def metrics(self) -> list[str]:
        """Names of the metrics that are kept."""
        return [name for name, each in metrics.declared().items() if not each.of_rollout]

    def _names_of(self, name: str) -> list[str]:
        """Return the names of the numbers of what is drawn several times for a rollout."""
        of_joint = [f".{quantity}" for quantity in COLUMNS] if name == IDENTIFICATION else [""]
        return [f"{name}[{joint}{each}]" for joint in self.robot.joint_names for each in of_joint]

    def rows(self, chunk: int, rollouts: int) -> int:
        """Return how many rollouts a chunk has where there are so many in all."""
        return min(self.size, rollouts - chunk * self.size)

    @property
    def width(self) -> int:
        """How many numbers a rollout draws."""
        return sum(drawn.joints for drawn in self.varied.values())

    def numbers(self, chunk: int, rows: int) -> Array:
        """Return what is drawn for the first rollouts of a chunk, shape (rows, numbers)."""
        return self.drawn_at(shares(self.sampling, self.config.seed, chunk * self.size, rows, self.streams))

    @property
    def streams(self) -> list[str]:
        """Names that the draws of each number depend on: those of other arms have the same."""
        return [f"{name}[{j}]" for name, each in self.varied.items() for j in range(each.joints)]

    def drawn_at(self, u: Array) -> Array:
        """Return what is drawn at points of the unit cube, both (rows, width)."""
        parts, place = [np.empty((len(u), 0))], 0
        for drawn in self.varied.values():
            parts.append(drawn.of(u[:, place : place + drawn.joints]))
            place += drawn.joints
        return np.hstack(parts)

    def run(self, chunk: int, rows: int) -> Array:
        """Run a chunk and return its numbers (rows, columns): a function of the study and the chunk."""
        if self.config.reality is not None:
            return self._run_draws(chunk, rows)
        drawn = self.numbers(chunk, rows)
        seeds = (self.config.seed + chunk * self.size + np.arange(rows, dtype=np.uint64)).astype(np.uint64)
        return np.hstack([drawn, self._flat(self._run_rollouts(drawn, seeds))])

    def drew(self, table: Array, chunk: int) -> bool:
        """Tell whether numbers of a chunk are of what is drawn there, and of rollouts that ended."""
        status = table[:, self.columns.index("status")]
        if not np.isin(status, list(Status)).all():
            return False
        if self.config.reality is not None:  # whose draws take milliseconds
            return True
        # Another machine's exponentials differ in their last digits.
        return np.allclose(table[:, : self.width], self.numbers(chunk, len(table)), rtol=1e-9, atol=0.0)

    def table(self, drawn: Array, seeds: Any) -> dict[str, Array]:
        """Return metrics (rows, joints) and `status` of rollouts with these numbers and seeds."""
        found = self._run_rollouts(drawn, seeds)
        return {name: found[name].values for name in (*self.metrics, "status")}

    def values(self, drawn: Array) -> dict[str, Any]:
        """Return what was drawn, (rows, width), as a prepared loop takes it."""
        values, place = dict(self._fixed_values()), 0
        for name, each in self.varied.items():
            part = drawn[:, place : place + each.joints]
            values[name] = part if each.joints > 1 else part[:, 0]
            place += each.joints
        if IDENTIFICATION in values:  # whose arms have their load
            values = {name: value for name, value in values.items() if name not in (IDENTIFICATION, *_LOAD)}
        return values

    def _run_rollouts(self, drawn: Array, seeds: Any) -> Any:
        """Return rollouts with these numbers, (rows, width), and seeds."""
        loop = self._loop_of(drawn) if IDENTIFICATION in self.varied else self._loop()
        return _run_compiled(loop, self.values(drawn), seeds)

    def config_of(
        self, row: Mapping[str, float], index: int = 0, seed: int | None = None
    ) -> ExperimentConfig:
        """Return the experiment of one rollout.

        Args:
            row: what was drawn, by name.
            index: its place among all.
            seed: of its random numbers; that of its place when not given.
        """
        if self.config.reality is not None:
            return self.config.replace(reality=self.config.reality.replace(index=index), failure={})
        # With every default filled in, as that of what varies must not change those.
        data = self.experiment.config.replace(vary={}, failure={}).plain()
        if (supervisor := self.experiment.supervisor) is not None:  # as it suits the sensors of the file
            data["supervisor"]["resolution"] = np.asarray(supervisor.resolution).tolist()
            data["supervisor"]["frozen"] = supervisor.frozen_samples
        for name, each in self.varied.items():
            value: Any = [row[key] for key in self._names_of(name)] if each.joints > 1 else row[name]
            _put(data, name, value, self)
        data["seed"] = self.config.seed + index if seed is None else seed
        return ExperimentConfig.read(data)

    def fails(self, table: Mapping[str, Array]) -> Any:
        """Tell which rollouts have failed, from their metrics (rollouts, joints) and `status`."""
        failed = np.isin(table["status"], (Status.DIVERGED, Status.STOPPED))
        for name, most in self.failure.items():
            failed |= ~(np.asarray(table[name]).max(axis=1) <= most)
        return failed

    def _loop(self) -> PreparedLoop:
        """Return the loop, prepared once."""
        if (known := _loops.get(self.identity.digest)) is None:
            experiment = self.experiment
            if "plant.payload.mass" in self.config.vary and self.config.plant.payload is not None:
                experiment = build(self.config.replace(plant=self.config.plant.replace(payload=None)))
            law = experiment.controllers[self.label]
            parts = (experiment.plant, law, experiment.reference, experiment.t_final)
            known = prepare(*parts, **_KEPT, supervisor=experiment.supervisor)
            _loops.clear()
            _loops[self.identity.digest] = known
        return known

    def _loop_of(self, drawn: Array) -> PreparedLoop:
        """Return the loop with an arm for each rollout, (rows, width): those that their experiments have."""
        made = self.experiment
        rows = (dict(zip(self.drawn_names, row, strict=True)) for row in drawn.tolist())
        arms = RobotBatch([real_arm(self.config_of(row).plant, made.robot) for row in rows])
        parts = (_with_robot(made.plant, arms), made.controllers[self.label], made.reference, made.t_final)
        return prepare(*parts, **_KEPT, supervisor=made.supervisor)

    @cached_property
    def _posterior(self) -> Posterior:
        """What is left open of the arm.

        Raises:
            ParameterError: when the arm was not identified.
            UrdfError: when its file is damaged.
        """
        path = self.experiment.config.robot.posterior
        if path is None:
            wanted = "that of an arm that `armgpi identify` wrote: robot: {name: identified/}"
            raise ParameterError(IDENTIFICATION, self.experiment.config.robot.name, wanted)
        return read_posterior(Path(path), self.robot)

    def _arms_left(self, section: Any) -> Distribution:
        """Return from what the unknowns of the arm are drawn, in units of what is left open of each."""
        if given := [kind for kind in KINDS if getattr(section, kind) is not None]:
            raise ParameterError(
                IDENTIFICATION, given[0], "{}: what was identified says how it is distributed"
            )
        return Distribution("normal", (0.0, 1.0), len(self._posterior.mean))

    def _fixed_values(self) -> dict[str, Any]:
        """Return what goes with what varies: where the load is."""
        load = self.config.plant.payload
        if "plant.payload.mass" not in self.varied or load is None:
            return {}
        return {"plant.payload.frame": load.frame or self.robot.tip, "plant.payload.com": [load.com]}

    def _flat(self, found: Any) -> Array:
        """Return the metrics of rollouts and how they ended, shape (rollouts, k)."""
        ends = (found[name].values[:, None] for name in self.ends)
        return np.hstack([*(found[name].values for name in self.metrics), *ends])

    def _run_draws(self, chunk: int, rows: int) -> Array:
        """Run draws of a reality; those of one sample time and delay run together."""
        section: Any = self.config.reality
        reality = Reality(**{name: getattr(section, name) for name in parameters(Reality)})
        first = section.index + chunk * self.size
        draws = [reality.draw(self.robot, first + i) for i in range(rows)]
        law = self.config.controllers[0].plain(given=True)
        law.pop("label", None)
        table = np.empty((rows, len(self.columns)))
        for group in batches(draws):
            loop = prepare_draws(group, law, **_KEPT, supervisor=self.experiment.supervisor)
            for draw, row in zip(group, self._flat(in_rows(_run_compiled(loop))), strict=True):
                table[draw.index - first] = [*_draw_numbers(draw), *row]
        return table


def _run_compiled(loop: PreparedLoop, values: Mapping[str, Any] | None = None, seeds: Any = None) -> Any:
    """Run a loop by generated code alone, whose bits are the same wherever it runs.

    Raises:
        BackendError: when there is none for it.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "running by NumPy", ArmgpiWarning)
        try:
            return loop.run(values, seed=seeds)
        except ArmgpiWarning as warning:
            reason = str(warning).removeprefix("running by NumPy: ")
            raise BackendError(f"a sweep needs generated code: {reason}") from None


#: The prepared loop of this process's study.
_loops: dict[str, PreparedLoop] = {}


def load(folder: Path) -> tuple[Sweep, Study]:
    """Return the sweep of a folder, read once while the folder holds it.

    Raises:
        RolloutError: when there is none, or other code has to run it.
        ConfigError: when its experiment is damaged.
    """
    known = read_identity(folder)
    return _read_sweep(folder, known["digest"], known["what"].get("sampling"))


@lru_cache(maxsize=4)
def _read_sweep(folder: Path, digest: str, sampling: str) -> tuple[Sweep, Study]:
    """Return the sweep of a folder that says that it holds one of a digest."""
    sweep = Sweep.of(*read(folder / EXPERIMENT), sampling)
    return sweep, sweep.enter(folder)


def chunk_name(chunk: int, rows: int) -> str:
    """Return the name of a chunk with so many rollouts."""
    return f"{CHUNKS}/{chunk:06d}-{rows}"


def run_chunk(folder: Path, chunk: int, rows: int) -> None:
    """Run a chunk, where it is not there already, and write it whole before returning.

    Raises:
        ArmgpiError: when it cannot be run.
        NoRoom: when it cannot be written.
    """
    if not (folder / f"{chunk_name(chunk, rows)}.chunk").is_file():
        sweep, study = load(folder.resolve())
        study.write(chunk_name(chunk, rows), sweep.run(chunk, rows))


def _put(data: dict[str, Any], name: str, value: Any, sweep: Sweep) -> None:
    """Write a number of a rollout into an experiment file."""
    part, *steps = name.split(".")
    if name == IDENTIFICATION:
        (theta,) = sweep._posterior.unknowns(np.array([value]))
        bodies, rotors, friction = parts(theta)
        joints, columns = sweep.robot.joint_names, np.stack([rotors, *friction], axis=-1).tolist()
        named = ("rotor_inertia", "viscous", "coulomb")
        data["robot"]["posterior"] = None
        data["plant"]["bodies"] = dict(zip(joints, bodies.tolist(), strict=True))
        data["plant"]["drives"] = {
            joint: {
                **(data["plant"].get("drives") or {}).get(joint, {}),
                **dict(zip(named, row, strict=True)),
            }
            for joint, row in zip(joints, columns, strict=True)
        }
    elif name == "plant.payload.mass":
        data["plant"]["payload"] = {**(data["plant"]["payload"] or {}), "mass": value}
    elif name in ("plant.viscous", "plant.coulomb"):
        now = sweep.experiment.plant.robot.friction if sweep.config.plant.friction == "urdf" else None
        shown = {key: getattr(now, key).tolist() if now else 0.0 for key in ("viscous", "coulomb")}
        if data["plant"]["friction"] != "urdf" or data["robot"]["friction"] is None:
            data["robot"]["friction"] = shown
        data["robot"]["friction"][steps[0]] = value
        data["plant"]["friction"] = "urdf"
    else:
        if part == "reference":
            _list_times(data["reference"])
        elif steps[0] == "loads":
            _check_entries(name, value, sweep)
        way = keys.path_of(name)
        try:
            keys.put(data, ("controllers", 0, *way[1:]) if part == "controller" else way, value, known=True)
        except (LookupError, TypeError):
            expected = "a key of an experiment file, as the worst rollouts are written to one"
            raise ParameterError(name, value, expected) from None


def _with_robot(plant: Any, robot: RobotBatch) -> Any:
    """Return a plant with other arms."""
    if isinstance(plant, Wrapper):
        return plant.with_values(plant=_with_robot(plant.plant, robot))
    return plant.with_values(robot=robot)


def _list_times(moves: dict[str, Any]) -> None:
    """Write durations and holds of moves one by one."""
    points = len(moves["points"] or ())
    for key, count in (("durations", points - 1), ("holds", points)):
        if not isinstance(moves[key], list):
            moves[key] = [moves[key]] * count


def _check_entries(name: str, value: Any, sweep: Sweep) -> None:
    """Refuse the number of a load where an entry of the file is several loads."""
    arm: Any = inside(sweep.experiment.plant)
    if len(sweep.config.plant.loads) != len(arm.loads):
        raise ParameterError(name, value, "the number of a load that is one entry of the file")


def _find_variable(known: Mapping[str, Variable], name: str, keys: Iterable[str]) -> Variable:
    """Return a parameter that may vary, from those of the loop and what else `plant` may have in a file."""
    if name not in known:
        key = name.removeprefix("plant.")
        remedy = f"give `plant` a value of {key!r} first, such as {{{key}: 1}}" if key in keys else ""
        raise NameNotFound("parameter of this loop", name, () if remedy else tuple(known), remedy)
    if reason := known[name].fixed:
        raise ParameterError(name, known[name].value, f"left as it is: {reason}")
    return known[name]


def _draw_numbers(draw: Draw) -> list[float]:
    """Return what is told of a draw; of what every joint has, the mean over the joints."""
    x = draw.numbers
    means = (float(np.mean(part)) for part in (x.rotor_inertia, x.coulomb, np.abs(x.torque_step)))
    return [x.sample_time, x.delay, x.encoder_bits, x.payload, x.inertia_scale, *means]
