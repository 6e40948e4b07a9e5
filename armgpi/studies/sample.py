"""Sweeps: an experiment, what varies in it and when it has failed; a chunk depends on it and its number."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import parameters
from armgpi.config import Experiment, ExperimentConfig, Origin, build, check, keys, read
from armgpi.config.building import IDENTIFICATION, real_arm
from armgpi.errors import ArmgpiWarning, BackendError, ConfigError, NameNotFound, ParameterError
from armgpi.health.reality import alike, in_rows, prepare_draws
from armgpi.identification.posterior import Posterior, parts, read_posterior
from armgpi.identification.weak_form import COLUMNS
from armgpi.loop import metrics
from armgpi.loop.prepared import PreparedLoop, prepare
from armgpi.loop.rollout import FAULTS, Status
from armgpi.loop.variables import Variable, current
from armgpi.plants.arm import Arm
from armgpi.plants.plant import Wrapper, inside
from armgpi.plants.reality import Reality, Scenario, batches
from armgpi.registry import classes_of
from armgpi.robot.batch import RobotBatch
from armgpi.studies.distributions import KINDS, SAMPLINGS, Distribution, distribution, shares
from armgpi.studies.study import Identity, Study, identify, read_identity

#: Rollout-steps of a chunk, about: some seconds of compiled code.
_WORK = 1 << 23
#: Rollouts of a chunk, at least.
_FEWEST = 16
#: Rollouts of a chunk, at most.
_MOST = 4096
#: The same of randomised arms, each of which takes milliseconds to make.
_MOST_DRAWS = 256
#: Where the file does not state it, a rollout has failed that diverges, or that has a larger error of a joint
#: than these shares of the largest move of any joint.
FAILURE_SHARES: Mapping[str, float] = {"peak_error": 0.1, "final_error": 0.02}
#: Move that a reference which stands still is judged as [rad or m].
_LEAST_MOVE = 0.5
#: Times at which a reference is looked at, to find its largest move.
_LOOKS = 401
#: What is kept of a rollout, and what runs it.
_KEPT: Mapping[str, Any] = {"record": "metrics", "backend": "compiled"}
#: What goes with a load that varies.
_LOAD = ("plant.payload.mass", "plant.payload.frame", "plant.payload.com")
#: What an identification draws of a plant.
_IDENTIFIED = ("plant.rotor_inertia", "plant.viscous", "plant.coulomb")
#: What each rollout has of its own already.
_KEPT_AS_IT_IS = ("seed", "record_every")
#: Most prepared loops that are kept.
_MOST_LOOPS = 32
#: The experiment file of a study in its folder.
EXPERIMENT = "experiment.yaml"
#: The folder of the chunks of a study.
CHUNKS = "chunks"
#: Columns of what is drawn of a randomised arm.
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
        varied: name -> distribution; empty where an uncertainty model is drawn.
        failure: metric -> largest value of any joint in a rollout that has not failed.
        sampling: "random" or "sobol".
        size: rollouts of a chunk.
        apart: what of it a loop cannot be given anew: for each value there is one of its own.
        identity: all of this, with the bytes of every file that it names and the code that runs it.
    """

    config: ExperimentConfig
    experiment: Experiment
    label: str
    varied: Mapping[str, Distribution]
    failure: Mapping[str, float]
    sampling: str
    size: int = 0
    apart: tuple[str, ...] = ()
    identity: Identity = field(init=False)

    @classmethod
    def of(cls, config: ExperimentConfig, origin: Origin | None = None, sampling: str = "random") -> Sweep:
        """Return the sweep that an experiment file describes.

        Raises:
            ConfigError: when something in it does not fit; it names the key.
        """
        if sampling not in SAMPLINGS:
            raise ParameterError("sampling", sampling, f"one of {', '.join(SAMPLINGS)}")
        config = config.replace(vary={current(name): section for name, section in config.vary.items()})
        experiment = build(config, origin)
        origin = origin or Origin("")
        _check_that_it_varies(config, origin)
        failure = dict(config.failure or usual_failure(experiment))
        known = metrics.without_rollouts()
        for name in failure:
            if name not in known:
                raise origin.error(("failure", name), str(metrics.not_found(name, known)))
        label = next(iter(experiment.controllers))
        without_draws = cls(config, experiment, label, {}, failure, sampling)
        varied, apart = without_draws._distributions(origin)
        size = _chunk_size(config, experiment.t_final, [varied[name] for name in apart])
        sweep = replace(without_draws, varied=varied, apart=apart, size=size)
        asked = {"method": "sweep", "sampling": sampling, "failure": failure, "size": size}
        object.__setattr__(sweep, "identity", identify(config, asked))
        return sweep

    def _distributions(self, origin: Origin) -> tuple[dict[str, Distribution], tuple[str, ...]]:
        """Return what each number that varies is drawn from, and which of them need loops of their own.

        Raises:
            ConfigError: for one that cannot vary, or cannot be what is drawn; it names the key.
        """
        varied: dict[str, Distribution] = {}
        apart: list[str] = []
        for name, section in self.config.vary.items():
            try:
                if name == IDENTIFICATION:
                    if given := [kind for kind in KINDS if getattr(section, kind) is not None]:
                        said = "{}: what was identified says how it is distributed"
                        raise ParameterError(name, given[0], said)
                    # In units of what is left open of each unknown of the arm.
                    varied[name] = Distribution("normal", (0.0, 1.0), len(self._posterior.mean))
                    continue
                if IDENTIFICATION in self.config.vary and name in _IDENTIFIED:
                    raise ParameterError(name, "varied", f"left to {IDENTIFICATION}, which draws it as well")
                variable, quick = self._find_variable(name)
                varied[name] = distribution(name, section, variable.declared, self.robot.n, variable.value)
                if quick:
                    continue
                apart.append(name)
                middle = float(varied[name].of(np.array([0.5]))[0])
                row = dict.fromkeys(self._columns_of(name, varied[name]), middle)
                replace(self, varied=dict(varied))._loop(row)
            except ConfigError as error:
                said = f"{error.key}: {str(error).removeprefix(f'{error.source}: {error.key}: ')}"
                raise origin.error(("vary", name), f"at {middle:g}, {said}") from None
            except (ParameterError, NameNotFound) as error:
                raise origin.error(("vary", name), str(error).removeprefix(f"{name}: ")) from None
        return varied, tuple(apart)

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
            drawn += self._columns_of(name, each)
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
        return [*metrics.without_rollouts()]

    def _columns_of(self, name: str, drawn: Distribution) -> list[str]:
        """Return the names of the numbers of what is drawn, once for a rollout or several times."""
        if drawn.joints == 1:
            return [name]
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
        return np.hstack([drawn, self._flat(self.table(drawn, seeds))])

    def drew(self, table: Array, chunk: int) -> bool:
        """Tell whether numbers of a chunk are of what is drawn there, and of rollouts that ended."""
        status = table[:, self.columns.index("status")]
        if not np.isin(status, list(Status)).all():
            return False
        if self.config.reality is not None:  # whose draws take milliseconds
            return True
        # Another machine's exponentials differ in their last digits.
        return np.allclose(table[:, : self.width], self.numbers(chunk, len(table)), rtol=1e-9, atol=0.0)

    def values(self, drawn: Array) -> dict[str, Any]:
        """Return what was drawn, (rows, width), as a prepared loop takes it."""
        values, place = dict[str, Any](), 0
        load = self.config.plant.payload
        if "plant.payload.mass" in self.varied and load is not None:  # the place goes with the mass
            values |= {"plant.payload.frame": load.frame or self.robot.tip, "plant.payload.com": [load.com]}
        for name, each in self.varied.items():
            part = drawn[:, place : place + each.joints]
            if name not in self.apart:
                values[name] = part if each.joints > 1 else part[:, 0]
            place += each.joints
        if IDENTIFICATION in values:  # whose arms have their load
            values = {name: value for name, value in values.items() if name not in (IDENTIFICATION, *_LOAD)}
        return values

    def table(self, drawn: Array, seeds: Any) -> dict[str, Array]:
        """Return metrics (rows, joints) and ends of rollouts with these numbers, (rows, width), and seeds."""
        names = self.drawn_names
        apart = [column for column, name in enumerate(names) if name.split("[")[0] in self.apart]
        rows_of: dict[tuple[float, ...], list[int]] = {}
        for row, numbers in enumerate(drawn[:, apart].tolist()):
            rows_of.setdefault(tuple(numbers), []).append(row)
        table: dict[str, Array] = {}
        for numbers, rows in rows_of.items():
            part = drawn[rows]
            if IDENTIFICATION in self.varied:
                loop = self._loop_of(part)
            else:
                loop = self._loop(dict(zip([names[column] for column in apart], numbers, strict=True)))
            result = in_rows(_run_compiled(loop, self.values(part), seeds[rows]))
            for name in (*self.metrics, *self.ends):
                values = result[name].values
                if name not in table:
                    table[name] = np.empty((len(drawn), *values.shape[1:]), values.dtype)
                table[name][rows] = values  # one row for all, where nothing differs
        return table

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
        return self._config_with(row, self.config.seed + index if seed is None else seed)

    def _config_with(self, row: Mapping[str, float], seed: int) -> ExperimentConfig:
        """Return the experiment with numbers that were drawn, all of them or some."""
        # With every default filled in, as that of what varies must not change those.
        data = self.experiment.config.replace(vary={}, failure={}, seed=seed).plain()
        if (supervisor := self.experiment.supervisor) is not None:  # as it suits the sensors of the file
            data["supervisor"]["resolution"] = np.asarray(supervisor.resolution).tolist()
            data["supervisor"]["frozen"] = supervisor.frozen_samples
        for name, each in self.varied.items():
            values = [row[key] for key in self._columns_of(name, each) if key in row]
            if values:
                _put(data, name, values if each.joints > 1 else values[0], self)
        return check(data, Origin("a rollout"))

    def fails(self, table: Mapping[str, Array]) -> Any:
        """Tell which rollouts have failed, from their metrics (rollouts, joints) and `status`."""
        failed = np.isin(table["status"], (Status.DIVERGED, Status.STOPPED))
        for name, most in self.failure.items():
            failed |= ~(np.asarray(table[name]).max(axis=1) <= most)
        return failed

    def _find_variable(self, name: str) -> tuple[Variable, bool]:
        """Return a number that may vary, and whether a loop can be given it anew.

        Raises:
            NameNotFound: when neither the loop nor the file has it.
            ParameterError: when it cannot vary.
        """
        known = self._loop().parameters
        found, value = known.get(name), None
        quick = found is not None and not found.fixed
        try:
            declared, value = keys.find(self.experiment.config, name)
            if isinstance(value, Mapping):  # in the file's order, and maybe of some joints alone
                joints = self.robot.joint_names
                value = [value[joint] for joint in joints] if {*joints} <= {*value} else None
        except LookupError:
            if found is None:
                absent = map("plant.{}".format, type(self.experiment.config.plant).keys)
                raise NameNotFound(
                    "number of this experiment", name, dict.fromkeys([*known, *absent])
                ) from None
            if found.fixed:
                raise ParameterError(name, found.value, f"left as it is: {found.fixed}") from None
            declared = found.declared
        if name in _KEPT_AS_IT_IS or declared.kind not in ("number", "integer", "box", "times"):
            said = "a number that differs by rollout; of three vary one, as in plant.payload.com.0"
            raise ParameterError(name, value, said)
        if quick and found is not None:
            if name.startswith("plant.loads."):
                arm: Any = inside(self.experiment.plant)
                if len(self.config.plant.loads) != len(arm.loads):  # an entry of the file is several loads
                    said = "the number of a load that is one entry of the file"
                    raise ParameterError(name, value, said)
            declared, value = found.declared, found.value if value is None else value
        return Variable(name, declared, value), quick

    def _loop(self, apart: Mapping[str, float] | None = None) -> PreparedLoop:
        """Return the loop with some values of what a loop cannot be given anew; each is prepared once."""
        key = tuple((apart or {}).items())
        loops: dict[Any, PreparedLoop] = vars(self).setdefault("_loops", {})
        if key not in loops:
            experiment = self.experiment
            config = self._config_with(apart, self.config.seed) if apart else self.config
            if "plant.payload.mass" in self.config.vary and config.plant.payload is not None:
                config = config.replace(plant=config.plant.replace(payload=None))
            if config is not self.config:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", ArmgpiWarning)
                    experiment = build(config)
            law = experiment.controllers[self.label]
            parts = (experiment.plant, law, experiment.reference, experiment.t_final)
            if len(loops) >= _MOST_LOOPS:
                loops.clear()
            loops[key] = prepare(*parts, **_KEPT, supervisor=experiment.supervisor)
        return loops[key]

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

    def _flat(self, found: Any) -> Array:
        """Return the metrics of rollouts and how they ended, shape (rollouts, k)."""
        ends = (np.asarray(found[name])[:, None] for name in self.ends)
        return np.hstack([*(np.asarray(found[name]) for name in self.metrics), *ends])

    def _run_draws(self, chunk: int, rows: int) -> Array:
        """Run scenarios of an uncertainty model; those of one sample time and delay run together."""
        section: Any = self.config.reality
        reality = Reality(**{name: getattr(section, name) for name in parameters(Reality)})
        first = section.index + chunk * self.size
        draws = [reality.draw(self.robot, first + i) for i in range(rows)]
        law = self.config.controllers[0].plain(given=True)
        law.pop("label", None)
        table = np.empty((rows, len(self.columns)))
        for group in alike(batches(draws), law):
            loop = prepare_draws(group, law, **_KEPT, supervisor=self.experiment.supervisor)
            outcomes = self._flat(in_rows(_run_compiled(loop)))
            for draw, outcome in zip(group, outcomes, strict=True):
                table[draw.index - first] = [*_drawn_numbers(draw), *outcome]
        return table


def _drawn_numbers(draw: Scenario) -> list[float]:
    """Return the numbers of :data:`_DRAWN` of a randomised arm: of joints the mean."""
    numbers = draw.numbers
    return [
        numbers.sample_time,
        numbers.delay,
        numbers.encoder_bits,
        numbers.payload,
        numbers.inertia_scale,
        float(np.mean(numbers.rotor_inertia)),
        float(np.mean(numbers.coulomb)),
        float(np.mean(np.abs(numbers.torque_step))),
    ]


def _check_that_it_varies(config: ExperimentConfig, origin: Origin) -> None:
    """Refuse an experiment in which nothing varies, or whose plant has no generated code.

    Raises:
        ConfigError: naming the key.
    """
    if config.vary and config.reality is not None:
        said = "a sweep takes distributions below vary or an uncertainty model (reality), not both"
        raise origin.error(("vary",), said)
    if not config.vary and config.reality is None:
        raise origin.error(
            ("vary",),
            "a sweep needs something to vary: specify distributions below vary, or an "
            "uncertainty model (reality)",
        )
    if not getattr(classes_of(Arm).get(config.plant.engine), "varies", False):
        said = f"a sweep runs generated code, which {config.plant.engine!r} has none of; take armgpi"
        raise origin.error(("plant", "engine"), said)


def _chunk_size(config: ExperimentConfig, t_final: float, apart: Sequence[Distribution]) -> int:
    """Return how many rollouts a chunk has, for as much work as others; fewer where loops are many."""
    numbers = (len(x.numbers) if x.kind == "choices" and x.joints == 1 else math.inf for x in apart)
    most = _MOST_DRAWS if config.reality is not None or IDENTIFICATION in config.vary else _MOST
    most = _FEWEST if math.prod(numbers) > _MOST_LOOPS else most
    steps = t_final / config.sample_time
    return min(most, max(_FEWEST, 1 << math.floor(math.log2(max(1.0, _WORK / steps)))))


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


def usual_failure(experiment: Experiment) -> dict[str, float]:
    """Return the errors [rad or m] beyond which a rollout has failed where its file states none.

    They are shares of the move: a tenth at the peak, a fiftieth at the end (:data:`FAILURE_SHARES`).
    """
    move = _LEAST_MOVE
    if experiment.reference is not None:
        q = experiment.reference.at(np.linspace(0.0, experiment.t_final, _LOOKS)).q
        travel = float(np.ptp(q, axis=0).max())
        move = travel if travel > 0.0 else _LEAST_MOVE
    return {name: float(f"{share * move:.3g}") for name, share in FAILURE_SHARES.items()}


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
    part = name.partition(".")[0]
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
        return
    way = keys.path_of(name)
    if part == "reference" and len(way) > 2 and way[1] in ("durations", "holds"):
        _list_times(data["reference"])
    keys.put(data, ("controllers", 0, *way[1:]) if part == "controller" else way, value)


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
