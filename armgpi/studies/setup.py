"""From an experiment file with a section `tune` to what is searched."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armgpi import config
from armgpi.base.parameter import parameters
from armgpi.config import Experiment, ExperimentConfig, Origin
from armgpi.config.arms import expand
from armgpi.config.reading import beside, check_section, read_data
from armgpi.errors import ArmgpiError, ArmgpiWarning, ConfigError, NameNotFound, ParameterError, require_extra
from armgpi.loop import metrics
from armgpi.plants.reality import Reality
from armgpi.robot import rotors
from armgpi.robot.robots import find_identified
from armgpi.studies.evaluation import Evaluator
from armgpi.studies.objective import Objective, known_names
from armgpi.studies.optimise import KEPT, Problem
from armgpi.studies.optimisers import LIBRARIES
from armgpi.studies.space import Range, Space
from armgpi.studies.spec import TuneSection
from armgpi.studies.study import Identity, identify

#: Held-out draws begin so many draws after those that are searched on.
_APART = 1 << 20
#: Keys of an experiment that say what `armgpi run` simulates, and that a search does not use: its scenarios
#: have moves and a duration of their own.
_UNUSED = ("reference", "t_final", "vary")
#: What is searched for an identified arm, where nobody says it: errors that are not bought by torque chatter.
_OBJECTIVE = "itae + 0.001*variation"


class Wanted(NamedTuple):
    """A search as a file asks for it.

    Attributes:
        experiment: what the file describes besides.
        label: of the controller that is searched.
        tune: the section `tune`.
        section: of the controller, plain data.
        problem: what is searched.
        data: the file as plain data, without `tune`.
        identity: all of this, with the bytes of every file that it names and the code that runs it.
    """

    experiment: Experiment
    label: str
    tune: TuneSection
    section: dict[str, Any]
    problem: Problem
    data: dict[str, Any]
    identity: Identity


def read(path: Path, changes: Mapping[str, Any] | None = None, backend: str = "compiled") -> Wanted:
    """Read an experiment file with a section `tune`, or the folder of an identified arm.

    Args:
        path: of the file, or of the folder.
        changes: keys of `tune` that are changed.
        backend: as for :func:`armgpi.simulate`.

    Raises:
        ConfigError: when something in it is not as it should be; it names the key.
    """
    data, origin = _read(path)
    found = data.pop("tune", None)
    if not isinstance(found, dict | None):
        raise origin.error(("tune",), "expected a mapping")
    tune = check_section(TuneSection, {**(found or {}), **(changes or {})}, origin, "tune")
    if tune.method in LIBRARIES:  # before any work or warning
        require_extra(*LIBRARIES[tune.method])
    given = beside(config.check(data, origin), path)
    given = given.replace(robot=expand(given))
    data = given.plain(given=True)
    data.setdefault("controllers", [{"type": "gpi"}])
    silent = given.robot.drives is None and given.reality is None and given.ideal is None
    if silent:  # what is found is for an arm that has rotors
        given = given.replace(robot=given.robot.replace(drives="stiff"))
    experiment = config.build(given, origin)
    data["robot"] = experiment.config.robot.plain(given=True)
    _warn(given, experiment, silent, origin)
    index = _find_controller(tune, experiment, origin)
    label = list(experiment.controllers)[index]
    section = {**data["controllers"][index]}
    section.pop("label", None)
    problem = _problem(experiment, label, section, tune, origin, backend)
    asked = {"method": "tune", "tune": tune.plain(), "backend": backend}
    return Wanted(experiment, label, tune, section, problem, data, identify(given, asked))


def _read(path: Path) -> tuple[dict[str, Any], Origin]:
    """Return an experiment file as plain data, or the study of the arm in a folder of `armgpi identify`."""
    if find_identified(path) is None:
        if path.is_dir():
            said = "is a folder, but not one of armgpi identify (it has no identification.json)"
            inside = path / "experiment.yaml"
            remedy = (
                f"give the experiment file in it: {inside}" if inside.is_file() else "give an experiment file"
            )
            raise ConfigError(path, "", f"{said}; {remedy}")
        return read_data(path)
    # The arm and controller that `armgpi run` has of the same folder.
    arm = {"robot": {"name": str(path.resolve())}, "ideal": False, "tune": {"objective": _OBJECTIVE}}
    return arm, Origin(str(path))


def _warn(given: ExperimentConfig, experiment: Experiment, silent: bool, origin: Origin) -> None:
    """Warn of what candidates are searched without; `silent`: nothing says how the arm is driven."""
    if silent and "stiffness" in rotors.assume_gears(experiment.robot).drives.data:
        said = "Tuning simulates stiff joints. On elastic joints the result may excite a resonance; try it "
        warnings.warn(
            str(origin.error(("robot",), f"{said}with drives: elastic")), ArmgpiWarning, stacklevel=3
        )
    if experiment.supervisor is not None:
        said = "tuning simulates without the supervisor of the file; run the result under it"
        warnings.warn(str(origin.error(("supervisor",), said)), ArmgpiWarning, stacklevel=3)
    unused = [key for key in _UNUSED if key in given.given]
    if unused:
        verb = "is" if len(unused) == 1 else "are"
        said = f"tuning simulates random moves of its own; the file's {' and '.join(unused)} {verb} not used"
        warnings.warn(str(origin.error((unused[0],), said)), ArmgpiWarning, stacklevel=3)
    left = {*given.plant.given} - {"delay", "encoder_bits"}
    friction = experiment.robot.friction
    if not (np.any(friction.viscous) or np.any(friction.coulomb)):
        left.discard("friction")  # there is none to leave out
    if given.reality is None and left:
        said = (
            "tuning simulates randomised arms with the delay and the encoder of the file, but not its "
            f"{', '.join(sorted(left))}; an uncertainty model (key `reality`) states which arms"
        )
        warnings.warn(str(origin.error(("plant",), said)), ArmgpiWarning, stacklevel=3)


def _find_controller(tune: TuneSection, experiment: Experiment, origin: Origin) -> int:
    """Return which controller is searched."""
    if tune.controller is None:
        return 0
    names = [*experiment.controllers]
    types = [section.type for section in experiment.config.controllers]
    for known in (names, types):
        if tune.controller in known:
            return known.index(tune.controller)
    raise origin.error(("tune", "controller"), str(NameNotFound("controller", tune.controller, names)))


def _problem(
    experiment: Experiment,
    label: str,
    section: Mapping[str, Any],
    tune: TuneSection,
    origin: Origin,
    backend: str,
) -> Problem:
    """Return what is searched; errors name the key of `tune`."""
    try:
        free: dict[str, Range] | None = None
        if tune.free is not None:
            free = {}
            for key, searched in tune.free.items():
                free[key] = Range() if searched is None else Range(**searched.plain())
        space = Space(section, experiment.controllers[label], free)
        objective = Objective(tune.objective, tune.over, tune.share, tune.constraints)
        if tune.against not in known_names():
            raise metrics.not_found(tune.against, known_names())
    except (ParameterError, NameNotFound) as error:
        raise origin.error(_path(error, tune), str(error)) from error
    against = known_names()[tune.against]
    names = sorted({*objective.names, against, *KEPT})
    reality, first = reality_of(experiment)

    def evaluator(begin: int, count: int) -> Evaluator:
        scenarios = [reality.draw(experiment.robot, begin + i) for i in range(count)]
        return Evaluator(scenarios, names, backend)

    try:
        search = evaluator(first, tune.scenarios)
        held_out = evaluator(first + _APART, tune.held_out)
    except ArmgpiError as error:
        raise origin.error(("reality",), str(error)) from error
    return Problem(
        space,
        objective,
        search,
        held_out,
        against,
        tuple(tune.budgets or (math.inf,)),
        tune.method,
        tune.evaluations,
        tune.population,
        tune.seed,
        bool(experiment.robot.prismatic.all()),
    )


def _path(error: ParameterError | NameNotFound, tune: TuneSection) -> tuple[str, ...]:
    """Return the key that an error is about."""
    if isinstance(error, NameNotFound):
        if error.kind != "metric":
            return ("tune", "free")
        if error.name == tune.against:
            return ("tune", "against")
        inside = str(error.name) in tune.objective
        return ("tune", "objective" if inside else "constraints")
    name, *keys = error.name.split(".")
    if name == "free":
        return ("tune", "free", *keys)
    return ("tune", name)


def reality_of(experiment: Experiment) -> tuple[Reality, int]:
    """Return what scenarios are drawn from, and the index of the first draw.

    It is the file's `reality`; or else one of geared drives with the sample time, delay and encoder of the
    plant.
    """
    given = experiment.config.reality
    if given is not None:
        return Reality(**{name: getattr(given, name) for name in parameters(Reality)}), given.index
    plant: Any = experiment.config.plant
    delay = float(plant.delay or 0)
    changes: dict[str, Any] = {
        "sample_time": [experiment.config.sample_time],
        "delay": (delay, delay),
    }
    bits = plant.encoder_bits
    if isinstance(bits, int | float):
        changes["encoder_bits"] = (float(bits), float(bits))
    return Reality.geared(experiment.config.seed, **changes), 0


def best_file(wanted: Wanted, x: Any) -> config.Loaded:
    """Return the experiment with the searched controller as found, first, and as it was given after it."""
    tuned = {**wanted.problem.space.with_values(np.asarray(x)), "label": "tuned"}
    default = {**wanted.section, "label": "default"}
    data = {**wanted.data, "controllers": [tuned, default]}
    origin = Origin("best.yaml")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)
        built = config.build(config.check(data, origin), origin)
    return config.Loaded(built.config, origin)
