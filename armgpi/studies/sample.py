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
from armgpi.config.arms import IDENTIFICATION
from armgpi.config.plants import real_arm
from armgpi.config.section import Section
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
        request = {"method": "sweep", "sampling": sampling, "failure": failure, "size": size}
        object.__setattr__(sweep, "identity", identify(config, request))
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
                    varied[name] = self._identified(section)
                    continue
                if IDENTIFICATION in self.config.vary and name in _IDENTIFIED:
                    raise ParameterError(name, "varied", f"left to {IDENTIFICATION}, which draws it as well")
                variable, given_anew = self._find_variable(name)
                varied[name] = distribution(name, section, variable.declared, self.robot.n, variable.value)
            except (ParameterError, NameNotFound) as error:
                raise origin.error(("vary", name), str(error).removeprefix(f"{name}: ")) from None
            if not given_anew:
                apart.append(name)
                replace(self, varied=dict(varied))._check_middle(name, origin)
        return varied, tuple(apart)

    def _identified(self, section: Section) -> Distribution:
        """Return what an identified arm is drawn from, in units of what is left open of each unknown.

        Raises:
            ParameterError: when the file states a distribution, or the arm was not identified.
        """
        for kind in KINDS:
            if getattr(section, kind) is not None:
                expected = "{}: its distribution is that of the identification"
                raise ParameterError(IDENTIFICATION, kind, expected)
        return Distribution("normal", (0.0, 1.0), len(self._posterior.mean))

    def _check_middle(self, name: str, origin: Origin) -> None:
        """Make the loop of the middle of what a number is drawn from, to see whether it can be made.

        Raises:
            ConfigError: when it cannot; it names the key, and the value.
        """
        drawn = self.varied[name]
        middle = float(drawn.of(np.array([0.5]))[0])
        try:
            self._loop(dict.fromkeys(self._columns_of(name, drawn), middle))
        except ConfigError as error:
            reason = str(error).removeprefix(f"{error.source}: {error.key}: ")
            raise origin.error(("vary", name), f"at {middle:g}, {error.key}: {reason}") from None
        except (ParameterError, NameNotFound) as error:
            raise origin.error(("vary", name), str(error).removeprefix(f"{name}: ")) from None

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
        columns = [*_DRAWN] if self.config.reality is not None else []
        for name, distribution_of_name in self.varied.items():
            columns += self._columns_of(name, distribution_of_name)
        for name in self.metrics:
            columns += [f"{name}[{joint}]" for joint in self.robot.joint_names]
        return columns + self.ends

    @property
    def ends(self) -> list[str]:
        """Names of the numbers that say how a rollout ended."""
        ends = ["status", "t_end"]
        if self.experiment.supervisor is not None:
            ends += FAULTS
        return ends

    @property
    def drawn_names(self) -> list[str]:
        """Names of the numbers that were drawn."""
        others = len(self.ends) + len(self.metrics) * self.robot.n
        return self.columns[:-others]

    @property
    def metrics(self) -> list[str]:
        """Names of the metrics that are kept."""
        return [*metrics.without_rollouts()]

    def _columns_of(self, name: str, drawn: Distribution) -> list[str]:
        """Return the names of the numbers of what is drawn, once for a rollout or several times."""
        if drawn.joints == 1:
            return [name]
        columns = []
        for joint in self.robot.joint_names:
            if name == IDENTIFICATION:
                columns += [f"{name}[{joint}.{quantity}]" for quantity in COLUMNS]
            else:
                columns.append(f"{name}[{joint}]")
        return columns

    def rows(self, chunk: int, rollouts: int) -> int:
        """Return how many rollouts a chunk has where there are so many in all."""
        return min(self.size, rollouts - chunk * self.size)

    @property
    def width(self) -> int:
        """How many numbers a rollout draws."""
        return sum(drawn.joints for drawn in self.varied.values())

    def numbers(self, chunk: int, rows: int) -> Array:
        """Return what is drawn for the first rollouts of a chunk, shape (rows, numbers)."""
        first = chunk * self.size
        return self.drawn_at(shares(self.sampling, self.config.seed, first, rows, self.streams))

    @property
    def streams(self) -> list[str]:
        """Names that the draws of each number depend on: those of other arms have the same."""
        streams = []
        for name, drawn in self.varied.items():
            streams += [f"{name}[{j}]" for j in range(drawn.joints)]
        return streams

    def drawn_at(self, u: Array) -> Array:
        """Return what is drawn at points of the unit cube, both (rows, width)."""
        columns = [np.empty((len(u), 0))]
        begin = 0
        for drawn in self.varied.values():
            end = begin + drawn.joints
            columns.append(drawn.of(u[:, begin:end]))
            begin = end
        return np.hstack(columns)

    def run(self, chunk: int, rows: int) -> Array:
        """Run a chunk and return its numbers (rows, columns): a function of the study and the chunk."""
        if self.config.reality is not None:
            return self._run_draws(chunk, rows)
        drawn = self.numbers(chunk, rows)
        first_seed = self.config.seed + chunk * self.size
        seeds = (first_seed + np.arange(rows, dtype=np.uint64)).astype(np.uint64)
        return np.hstack([drawn, self._flat(self.table(drawn, seeds))])

    def drew(self, table: Array, chunk: int) -> bool:
        """Tell whether numbers of a chunk are of what is drawn there, and of rollouts that ended."""
        status = table[:, self.columns.index("status")]
        if not np.isin(status, list(Status)).all():
            return False
        if self.config.reality is not None:  # whose draws take milliseconds
            return True
        # Another machine's exponentials differ in their last digits.
        drawn_there, drawn_here = table[:, : self.width], self.numbers(chunk, len(table))
        return np.allclose(drawn_there, drawn_here, rtol=1e-9, atol=0.0)

    def values(self, drawn: Array) -> dict[str, Any]:
        """Return what was drawn, (rows, width), as a prepared loop takes it."""
        values: dict[str, Any] = {}
        load = self.config.plant.payload
        if "plant.payload.mass" in self.varied and load is not None:  # the place goes with the mass
            values["plant.payload.frame"] = load.frame or self.robot.tip
            values["plant.payload.com"] = [load.com]
        begin = 0
        for name, distribution_of_name in self.varied.items():
            end = begin + distribution_of_name.joints
            columns = drawn[:, begin:end]
            begin = end
            if name not in self.apart:
                values[name] = columns if distribution_of_name.joints > 1 else columns[:, 0]
        if IDENTIFICATION in values:  # whose arms have their load
            for name in (IDENTIFICATION, *_LOAD):
                values.pop(name, None)
        return values

    def table(self, drawn: Array, seeds: Any) -> dict[str, Array]:
        """Return metrics (rows, joints) and ends of rollouts with these numbers, (rows, width), and seeds."""
        columns_apart = []
        names_apart = []
        for column, name in enumerate(self.drawn_names):
            if name.split("[")[0] in self.apart:
                columns_apart.append(column)
                names_apart.append(name)
        rows_of: dict[tuple[float, ...], list[int]] = {}
        for row, numbers in enumerate(drawn[:, columns_apart].tolist()):
            rows_of.setdefault(tuple(numbers), []).append(row)
        table: dict[str, Array] = {}
        for numbers, rows in rows_of.items():
            drawn_there = drawn[rows]
            if IDENTIFICATION in self.varied:
                loop = self._loop_of(drawn_there)
            else:
                loop = self._loop(dict(zip(names_apart, numbers, strict=True)))
            result = in_rows(_run_compiled(loop, self.values(drawn_there), seeds[rows]))
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
        if seed is None:
            seed = self.config.seed + index
        return self._config_with(row, seed)

    def _config_with(self, row: Mapping[str, float], seed: int) -> ExperimentConfig:
        """Return the experiment with numbers that were drawn, all of them or some."""
        # With every default filled in, as that of what varies must not change those.
        data = self.experiment.config.replace(vary={}, failure={}, seed=seed).plain()
        supervisor = self.experiment.supervisor
        if supervisor is not None:  # as it suits the sensors of the file
            data["supervisor"]["resolution"] = np.asarray(supervisor.resolution).tolist()
            data["supervisor"]["frozen"] = supervisor.frozen_samples
        for name, drawn in self.varied.items():
            values = [row[column] for column in self._columns_of(name, drawn) if column in row]
            if values:
                _put(data, name, values if drawn.joints > 1 else values[0], self)
        return check(data, Origin("a rollout"))

    def fails(self, table: Mapping[str, Array]) -> Any:
        """Tell which rollouts have failed, from their metrics (rollouts, joints) and `status`."""
        failed = np.isin(table["status"], (Status.DIVERGED, Status.STOPPED))
        for name, most in self.failure.items():
            largest = np.asarray(table[name]).max(axis=1)
            failed |= ~(largest <= most)
        return failed

    def _find_variable(self, name: str) -> tuple[Variable, bool]:
        """Return a number that may vary, and whether a loop can be given it anew.

        Raises:
            NameNotFound: when neither the loop nor the file has it.
            ParameterError: when it cannot vary.
        """
        known = self._loop().parameters
        of_loop = known.get(name)
        value = None
        try:
            declared, value = keys.find(self.experiment.config, name)
            if isinstance(value, Mapping):  # in the file's order, and maybe of some joints alone
                joints = self.robot.joint_names
                value = [value[joint] for joint in joints] if {*joints} <= {*value} else None
        except LookupError:
            if of_loop is None:
                of_plant = [f"plant.{key}" for key in type(self.experiment.config.plant).keys]
                names = dict.fromkeys([*known, *of_plant])
                raise NameNotFound("number of this experiment", name, names) from None
            if of_loop.fixed:
                raise ParameterError(name, of_loop.value, f"left as it is: {of_loop.fixed}") from None
            declared = of_loop.declared
        if name in _KEPT_AS_IT_IS or declared.kind not in ("number", "integer", "box", "times"):
            expected = "a number that differs by rollout; of three vary one, as in plant.payload.com.0"
            raise ParameterError(name, value, expected)
        if of_loop is None or of_loop.fixed:
            return Variable(name, declared, value), False
        if name.startswith("plant.loads."):
            arm: Any = inside(self.experiment.plant)
            if len(self.config.plant.loads) != len(arm.loads):  # an entry of the file is several loads
                raise ParameterError(name, value, "the number of a load that is one entry of the file")
        if value is None:
            value = of_loop.value
        return Variable(name, of_loop.declared, value), True

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
        experiment = self.experiment
        arms = []
        for numbers in drawn.tolist():
            row = dict(zip(self.drawn_names, numbers, strict=True))
            arms.append(real_arm(self.config_of(row).plant, experiment.robot))
        plant = _with_robot(experiment.plant, RobotBatch(arms))
        law = experiment.controllers[self.label]
        parts = (plant, law, experiment.reference, experiment.t_final)
        return prepare(*parts, **_KEPT, supervisor=experiment.supervisor)

    @cached_property
    def _posterior(self) -> Posterior:
        """What is left open of the arm.

        Raises:
            ParameterError: when the arm was not identified.
            UrdfError: when its file is damaged.
        """
        path = self.experiment.config.robot.posterior
        if path is None:
            expected = "that of an arm that `armgpi identify` wrote: robot: {name: identified/}"
            raise ParameterError(IDENTIFICATION, self.experiment.config.robot.name, expected)
        return read_posterior(Path(path), self.robot)

    def _flat(self, table: Any) -> Array:
        """Return the metrics of rollouts and how they ended, shape (rollouts, k)."""
        columns = [np.asarray(table[name]) for name in self.metrics]
        columns += [np.asarray(table[name])[:, None] for name in self.ends]
        return np.hstack(columns)

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
        message = "a sweep takes distributions below vary or an uncertainty model (reality), not both"
        raise origin.error(("vary",), message)
    own = [key for key in ("sample_time", "reference", "t_final") if key in config.given]
    if config.reality is not None and own:
        message = "left out in a sweep of an uncertainty model (reality): each scenario has its own"
        raise origin.error((own[0],), message)
    if not config.vary and config.reality is None:
        raise origin.error(
            ("vary",),
            "a sweep needs something to vary: specify distributions below vary, or an "
            "uncertainty model (reality)",
        )
    if not getattr(classes_of(Arm).get(config.plant.engine), "varies", False):
        message = f"a sweep runs generated code, which {config.plant.engine!r} has none of; take armgpi"
        raise origin.error(("plant", "engine"), message)


def _chunk_size(config: ExperimentConfig, t_final: float, apart: Sequence[Distribution]) -> int:
    """Return how many rollouts a chunk has, for as much work as others; fewer where loops are many."""
    loops = 1.0
    for drawn in apart:
        loops *= len(drawn.numbers) if drawn.kind == "choices" and drawn.joints == 1 else math.inf
    most = _MOST
    if config.reality is not None or IDENTIFICATION in config.vary:
        most = _MOST_DRAWS
    if loops > _MOST_LOOPS:
        most = _FEWEST
    steps = t_final / config.sample_time
    of_this_work = max(1.0, _WORK / steps)
    power_of_two = 1 << math.floor(math.log2(of_this_work))
    return min(most, max(_FEWEST, power_of_two))


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
        times = np.linspace(0.0, experiment.t_final, _LOOKS)
        q = experiment.reference.at(times).q
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
        joints = sweep.robot.joint_names
        columns = np.stack([rotors, *friction], axis=-1).tolist()
        plant = data["plant"]
        specified = plant.get("drives") or {}
        drives = {}
        for joint, (rotor_inertia, viscous, coulomb) in zip(joints, columns, strict=True):
            drawn = {"rotor_inertia": rotor_inertia, "viscous": viscous, "coulomb": coulomb}
            drives[joint] = {**specified.get(joint, {}), **drawn}
        data["robot"]["posterior"] = None
        plant["bodies"] = dict(zip(joints, bodies.tolist(), strict=True))
        plant["drives"] = drives
        return
    path = keys.path_of(name)
    if part == "reference" and len(path) > 2 and path[1] in ("durations", "holds"):
        _list_times(data["reference"])
    if part == "controller":
        path = ("controllers", 0, *path[1:])
    keys.put(data, path, value)


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
