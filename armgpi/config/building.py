"""From a checked configuration to the objects it describes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any, NamedTuple, TypeVar

from armgpi.base.parameter import parameters
from armgpi.config import world
from armgpi.config.arms import build_robot, resolve, with_assumptions
from armgpi.config.controllers import build_controller, controller
from armgpi.config.place import Place
from armgpi.config.plants import ENGINES, apply_draw, build_plant, context_of
from armgpi.config.reading import Origin
from armgpi.config.references import build_reference
from armgpi.config.schema import ExperimentConfig
from armgpi.config.section import Section
from armgpi.config.values import given_values
from armgpi.control.controller import Controller
from armgpi.errors import ConfigError, EffortError, ParameterError
from armgpi.plants.arm import Arm
from armgpi.plants.plant import Plant, inside
from armgpi.references.reference import Reference
from armgpi.registry import Context
from armgpi.robot.robot import Robot
from armgpi.supervisor import Supervised, Supervisor, complete_settings
from armgpi.tuning.rule import Untuned, assume
from armgpi.tuning.verdict import Verdict, verdict

#: Most samples of a run: a day at 10 kHz.
_MAX_SAMPLES = 10**9
#: How long a run goes on after its reference has ended, when nothing is said [s].
_SETTLE = 2.0

_Part = TypeVar("_Part")


class Experiment(NamedTuple):
    """The objects that an experiment file describes.

    Attributes:
        robot: the arm as its URDF has it.
        plant: what moves.
        controllers: label -> controller.
        reference: where to.
        t_final: how long [s].
        config: what they were made from, with every default filled in.
        plants: simulator -> what moves in it; more than `plant` where there are two of them.
        supervisor: what all controllers are under; None for nothing.
    """

    robot: Robot
    plant: Plant
    controllers: dict[str, Controller]
    reference: Reference
    t_final: float
    config: ExperimentConfig
    plants: dict[str, Plant]
    supervisor: Supervisor | None = None

    @property
    def runs(self) -> dict[str, tuple[Plant, Controller]]:
        """Label -> what is run: every controller on every plant."""
        return {
            label if len(self.plants) == 1 else f"{label} ({engine})": (plant, controller)
            for label, controller in self.controllers.items()
            for engine, plant in self.plants.items()
        }


def build(config: ExperimentConfig, origin: Origin | None = None) -> Experiment:
    """Make the objects that a configuration describes.

    Raises:
        ConfigError: when something in it does not fit the robot; it names the key.
    """
    top = Place(origin or Origin())
    config, robot = with_assumptions(config, top)
    lasts = 0.0
    if config.reality is None:
        context = context_of(config, robot, top)
        engine = config.plant.engine
        engines = ENGINES if engine == "both" else (engine,)
        plants = {each: build_plant(config, context, top.at("plant"), each) for each in engines}
    else:
        config, context, drawn, lasts = apply_draw(config, robot, top)
        plants = {ENGINES[0]: drawn}
    controllers, sections = _build_controllers(config, context, top)
    reference, end, moves = build_reference(config, robot, top.at("reference"))
    t_final = max(end + _SETTLE, lasts) if config.t_final is None else config.t_final
    _check_samples(config, t_final, top)
    if not config.vary:  # which may move the walls, or where the arm starts
        _check_walls(plants, reference, top.at("plant"))
    supervisor = _supervisor(config, controllers.values(), reference, top.at("supervisor"))
    config = config.replace(controllers=sections, reference=moves, t_final=t_final)
    plant = next(iter(plants.values()))
    return Experiment(robot, plant, controllers, reference, t_final, config, plants, supervisor)


def _build_controllers(
    config: ExperimentConfig, context: Context, top: Place
) -> tuple[dict[str, Controller], list[Section]]:
    """Return the controllers by label, and their sections with labels and defaults filled in.

    A controller without a label is called by its type, a second one of it by its number as well.

    Raises:
        ConfigError: for two of one label, or a value that does not fit; torque limits that hold no
            controller are an error of `robot.effort`.
    """
    controllers: dict[str, Controller] = {}
    sections: list[Section] = []
    for index, section in enumerate(config.controllers):
        place = top.at("controllers", index)
        label = section.label or section.type
        if label in controllers:
            label = f"{label} {index + 1}"
        if label in controllers:
            raise place.at("label").error(f"another controller is labelled {label!r} as well")
        try:
            with place.error_context():
                section, controllers[label] = build_controller(section, context, place)
        except ConfigError as error:
            cause = error.__cause__
            if isinstance(cause, EffortError):
                raise top.at("robot", "effort").error(str(cause)) from cause
            raise
        sections.append(section.replace(label=label))
    return controllers, sections


def _check_samples(config: ExperimentConfig, t_final: float, top: Place) -> None:
    """Refuse a run of no sample, or of too many.

    The key that is named is one that the file has: the length may be the reference's, and the sample time
    the default one.
    """
    dt = config.sample_time
    if 0.5 < t_final / dt <= _MAX_SAMPLES:
        return
    key = "t_final"
    for candidate in ("t_final", "sample_time", "reference"):
        if candidate in config.given:
            key = candidate
            break
    raise top.at(key).error(
        f"expected {dt:g} to {dt * _MAX_SAMPLES:g} s (1 to {_MAX_SAMPLES:.0e} samples of {dt:g} s) in a run, "
        f"got {t_final:g} s"
    )


def _check_walls(plants: Mapping[str, Plant], reference: Reference, place: Place) -> None:
    """Refuse an arm that starts behind a wall.

    Raises:
        ConfigError: of the key of the wall's distance, with how deep the point is.
    """
    start = reference.at(0.0).q
    for plant in plants.values():
        arm = inside(plant)
        if not isinstance(arm, Arm):
            continue
        try:
            arm.check_start(start)
        except ParameterError as error:
            steps = [int(step) if step.isdigit() else step for step in error.name.split(".")]
            raise place.at(*steps).error(str(error).removeprefix(f"{error.name} ")) from error


def _supervisor(
    config: ExperimentConfig, controllers: Iterable[Controller], reference: Reference, place: Place
) -> Supervisor | None:
    """Return the supervisor, whose bounds suit the sensors; None where the file asks for none."""
    if config.supervisor is None:
        return None
    first, *_ = controllers
    robot: Any = first.robot
    with place.error_context():
        given = given_values(config.supervisor, parameters(Supervisor), robot, place)
        supervisor = complete_settings(Supervisor(**given), config.plant, first)
        # The constructor checks that it fits the arm.
        Supervised(first, supervisor).check_start(reference.at(0.0).q)
        return supervisor


def robot(config: ExperimentConfig, origin: Origin | None = None) -> Robot:
    """Return the arm alone that a configuration describes.

    Raises:
        ConfigError: when something does not fit the robot; it names the key.
    """
    return resolve(config, origin)[1]


class Parts:
    """Makes the parts of experiments that differ in a few keys: what has the same sections is made once.

    In their controllers' sections every default has been filled in, so they do not depend on the plant's.
    """

    def __init__(self) -> None:
        """Begin without parts."""
        self._made: dict[tuple[str, ...], Any] = {}

    def of(self, config: ExperimentConfig) -> tuple[Plant, Controller, Reference]:
        """Return plant, first controller and reference of an experiment without a reality.

        Raises:
            ConfigError: when something in it does not fit the robot; it names the key.
        """
        top = Place(Origin())
        text = cache(lambda key: repr(getattr(config, key)))
        robot = self._once(("robot",), text, ("robot",), lambda: build_robot(config.robot, top.at("robot")))
        context = context_of(config, robot, top)
        plant = self._once(
            ("plant",), text, ("robot", "plant", "sample_time", "seed"),
            lambda: build_plant(config, context, top.at("plant"), config.plant.engine),
        )  # fmt: skip
        section = config.controllers[0]
        law = self._once(
            ("controller", repr(section)), text, ("robot", "sample_time"),
            lambda: controller(section.plain(), context),
        )  # fmt: skip
        reference = self._once(
            ("reference",), text, ("robot", "reference", "ideal"),
            lambda: build_reference(config, robot, top.at("reference"))[0],
        )  # fmt: skip
        return plant, law, reference

    def _once(
        self,
        name: tuple[str, ...],
        text: Callable[[str], str],
        keys: tuple[str, ...],
        make: Callable[[], _Part],
    ) -> _Part:
        """Return a part that is made from some keys of an experiment, of which `text` is what they say."""
        key = (*name, *map(text, keys))
        if key not in self._made:
            self._made[key] = make()
        made: _Part = self._made[key]
        return made


def summary(experiment: Experiment) -> str:
    """Return one line on the arm and the controller that an experiment has, the same for all commands."""
    return world.describe(experiment.config, experiment.robot)


def verdicts(experiment: Experiment) -> dict[str, Verdict]:
    """Return what each automatic controller tolerates, label -> verdict.

    Those of a reality, whose drives are drawn, have none.
    """
    config, found = experiment.config, {}
    if config.reality is None and isinstance(experiment.robot, Robot):
        context = context_of(config, experiment.robot, Place(Origin("experiment")))
        for section in config.controllers:
            if section.type == Untuned.config_name:
                law = experiment.controllers[section.label]
                found[section.label] = verdict(law, experiment.robot, assume(context.bits))
    return found
