"""What commands share of an arm: how it is loaded, what of it is assumed, and what is printed of it."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armgpi.base.verdict import Verdict
from armgpi.cli import options as opt
from armgpi.cli.parsing import is_experiment, locks, per_joint, refusal, split
from armgpi.cli.terminal import hold, say
from armgpi.errors import NameNotFound

# What takes long to import is imported by the functions, so that --help answers at once.
if TYPE_CHECKING:
    from armgpi.config import Experiment, ExperimentConfig, Origin
    from armgpi.robot.robot import Robot

#: Arms drawn in whose hull the true one is taken to be.
_DRAWN = 12
#: So many times as far from the estimate as drawn.
_FARTHER = 2.5
#: More arms, of which none may exceed what follows: 59 drawn ones are 95 % of all with 95 % confidence.
_TRIED = 59
#: Keys of the section `robot` that have an option of the same name.
_ARM_KEYS = tuple(each.name for each in fields(opt.Arm))
#: Sources of a number that the user supplied: with "" it is the URDF's.
_SUPPLIED = ("", "specified", "identified")


def load_robot(robot: str, lock: list[str] | None, keep: list[str] | None) -> Robot:
    """Load a robot with the joints that options lock or keep."""
    from armgpi.robot.robot import Robot

    # A joint without a value is locked where Robot.load would lock it by its name alone.
    locked: Any = locks(lock or [])
    kept = None if keep is None else split(keep)
    with names_of_options(lock=locked, keep=kept):
        return Robot.load(robot, lock=locked, keep=kept)


@contextmanager
def names_of_options(**typed: Collection[str] | None) -> Iterator[None]:
    """Name the option, where a name that was typed does not exist.

    Args:
        typed: option, without its dashes -> the names that were typed.

    Raises:
        ConfigError: for a name of one of the options.
    """
    try:
        yield
    except NameNotFound as error:
        for option, names in typed.items():
            if error.name in (names or ()):
                raise refusal(f"--{option}", str(error)) from None
        raise


def load_arm(name: str, how: opt.Loading) -> Robot:
    """Return the robot with what its joints have; that of an experiment file where the name is one's."""
    from armgpi import config

    section: dict[str, Any] = {"name": name}
    if is_experiment(name):
        section = config.read(Path(name)).config.robot.plain(given=True)
    section |= opt.robot_given(how)
    options = {"robot": "ROBOT", "robot.name": "ROBOT"}
    options |= {f"robot.{key}": f"--{key.replace('_', '-')}" for key in _ARM_KEYS}
    origin = config.Origin("command line", options=options)
    return config.robot(config.check({"robot": section}, origin), origin)


def resolved(
    robot: str, how: opt.Loading, loaded: Robot | None = None, encoder_side: str | None = None
) -> tuple[ExperimentConfig, Robot]:
    """Return what `armgpi run` resolves for a robot or an experiment file, and its arm.

    Args:
        robot: name of a robot, path of a URDF or of an experiment file.
        how: options of how the arm is loaded, and of its drives.
        loaded: the arm that a command has loaded for these already; None for none.
        encoder_side: of all joints, "motor" or "link"; None where it was not typed.
    """
    from armgpi import config as configuration
    from armgpi.config import arms
    from armgpi.robot import robots

    if is_experiment(robot):
        given, origin = configuration.read(Path(robot))
        data = given.plain(given=True)
        if ("controllers",) not in origin.lines:
            data.pop("controllers", None)
    else:
        data, origin = {"robot": {"name": robot}}, configuration.Origin("command line")
        data["ideal"] = robots.is_textbook(robot)
    data["robot"] = {**data["robot"], **opt.robot_given(how)}
    if encoder_side is not None:
        data["plant"] = {**data.get("plant", {}), "encoder_side": encoder_side}
    return arms.resolve(configuration.check(data, origin), origin, loaded)


def possible_arms(file: Path | None, arm: Robot) -> dict[str, list[Robot]]:
    """Return `arms` and `others` that an identification leaves possible; none of either without one."""
    if file is None:
        return {"arms": [], "others": []}
    import numpy as np

    from armgpi.identification.posterior import read_posterior, with_parameters
    from armgpi.robot.identified import NAME

    posterior = read_posterior(file / NAME if file.is_dir() else file, arm)
    normal = np.random.default_rng(0).normal(size=(_DRAWN + _TRIED, len(posterior.mean)))
    normal[:_DRAWN] *= _FARTHER
    drawn = [with_parameters(arm, theta) for theta in posterior.unknowns(normal)]
    return {"arms": drawn[:_DRAWN], "others": drawn[_DRAWN:]}


def refuse_pushes(config: ExperimentConfig, origin: Origin, options: str) -> None:
    """Refuse loads and contacts of the simulated arm: no bound and no certificate contains them.

    Args:
        config: the experiment.
        origin: where it came from.
        options: those of the command that bound what disturbs.

    Raises:
        ConfigError: of the first such key.
    """
    for key in ("loads", "environment"):
        if getattr(config.plant, key):
            said = f"disturbances of a bound are given by {options}; remove this key"
            raise origin.error(("plant", key), said)


def unjudged_drives(known: tuple[ExperimentConfig, Robot], friction_is_judged: bool) -> list[str]:
    """Return what the user supplied of the drives and that a certificate or bound of a stiff arm leaves out.

    What is assumed, or published, of an arm is no such thing: nobody asked for it.

    Args:
        known: what `armgpi run` resolves, as :func:`armgpi.cli.arms.resolved` returns it.
        friction_is_judged: whether friction is among what disturbs.
    """
    from armgpi.config.plants import has_friction

    config, arm = known

    def supplied(quantity: str, present: Any) -> list[str]:
        """Return the joints of which the user supplied a quantity."""
        rows = zip(arm.joint_names, arm.drives.sources(quantity), present, strict=True)
        return [name for name, source, there in rows if there and source in _SUPPLIED]

    found = []
    rubbing = {*supplied("viscous", arm.friction.viscous), *supplied("coulomb", arm.friction.coulomb)}
    if rubbing and has_friction(config.plant) and not friction_is_judged:
        found.append("joint friction (--friction includes it)")
    elastic = supplied("stiffness", [source != "" for source in arm.drives.sources("stiffness")])
    if elastic and config.plant.engine == "elastic":
        found.append("joint elasticity (stiff joints are judged)")
    return found


def note_world(config: ExperimentConfig, arm: Robot, judged: str = "") -> None:
    """Say what a command judges in the place of the arm and controller of `armgpi run`, and which these are.

    Args:
        config: as :func:`resolved` returns it.
        arm: likewise.
        judged: what the command judges, as :func:`armgpi.config.world.describe_arm` says it; empty where it
            judges what is run.
    """
    from armgpi.config import world

    hold(world.describe(config, arm))
    if judged and judged != world.describe_arm(config, arm):
        hold(f"evaluated instead: {judged}")


def _for_all_joints(robot: Robot, motion: opt.Experiment) -> str:
    """Return which options have one position for all joints of an arm; nothing where none has."""
    typed = [("--from", motion.start), ("--to", motion.to)]
    positions = [(option, per_joint(text, option)) for option, text in typed if text is not None]
    said = [f"{option} {position:g}" for option, position in positions if isinstance(position, float)]
    return f"; {' and '.join(said)} for all {robot.n} joints" if said and robot.n > 1 else ""


def note_drives(experiment: Experiment, explain: bool = True, motion: opt.Experiment | None = None) -> None:
    """Say which arm and controllers an experiment has, and what of the arm's drives is assumed.

    Args:
        experiment: of the arm.
        explain: whether the assumed values, their reasons and the limits of automatic tuning are printed;
            else one line names what is assumed.
        motion: the options about the motion: one position is that of all joints, and this is said.
    """
    from armgpi.config import world
    from armgpi.plants.elastic import ElasticPlant
    from armgpi.plants.plant import inside
    from armgpi.robot.known_arms import describe_published
    from armgpi.robot.rotors import assumed_something
    from armgpi.tuning.geared import is_known
    from armgpi.tuning.rule import BITS

    robot = experiment.robot
    line = world.describe(experiment.config, experiment.robot, every=True)
    if motion is not None:
        line += _for_all_joints(robot, motion)
    hold(line if explain or not assumed_something(robot) else f"{line}. Values: --explain")
    if published := describe_published(robot.drives, values=explain):
        hold(published)
    if explain:
        _explain_drives(experiment)
    stiff = [name for name, plant in experiment.plants.items() if not isinstance(inside(plant), ElasticPlant)]
    if stiff and is_known(experiment.robot):
        hold(
            f"note: the plant {' and '.join(stiff)} simulates stiff joints, but this arm is assumed to "
            "have elastic joints, so its errors will differ. Use --plant elastic to simulate them"
        )
    automatic = any(section.type == world.AUTOMATIC for section in experiment.config.controllers)
    if automatic and getattr(experiment.config.plant, "encoder_bits", None) is None:
        hold(f"note: the encoder resolution is not specified; {BITS} bits assumed: --encoder-bits")
    _note_force(experiment)
    _note_walls(experiment)


def _note_walls(experiment: Experiment) -> None:
    """Say which walls without damping are stiffer than a spring at the tool damps in its worst direction."""
    from armgpi.control.impedance import CartesianImpedance
    from armgpi.plants.environment import Wall
    from armgpi.plants.plant import inside

    contacts = getattr(inside(experiment.plant), "environment", ())
    undamped = [each.stiffness for each in contacts if isinstance(each, Wall) and not each.damping]
    stiffest = max(undamped, default=0.0)
    for label, law in experiment.controllers.items():
        if isinstance(law, CartesianImpedance) and stiffest > law.limits.wall:
            hold(
                f"note: {label}: a wall of {stiffest / 1e3:.3g} kN/m without damping; the stiffest that it "
                f"damps is {law.limits.wall / 1e3:.3g} kN/m in the worst direction and configuration, so the "
                "tool may hammer it. Lower the stiffness or the delay, or give the wall a damping"
            )


def _note_force(experiment: Experiment) -> None:
    """Say what controllers with a force limit press with at rest, and the impact beside it."""
    from armgpi.plants.plant import inside
    from armgpi.robot.batch import one_of

    controller: Any  # one that has a force limit has its bound as well
    for label, controller in experiment.controllers.items():
        if getattr(controller, "force_limit", None) is not None:
            arm = one_of(inside(experiment.plant).robot)
            bound = controller.force_bound(arm=arm)
            hold(f"{label}: {bound}".replace("\n", " "))


def _explain_drives(experiment: Experiment) -> None:
    """Print the assumed values of the drives, the deflection that they cause, and what limits the tuning."""
    from armgpi.config.building import verdicts
    from armgpi.plants.plant import inside
    from armgpi.robot.rotors import describe, describe_gears, describe_ratio
    from armgpi.tuning.verdict import why_sensitive

    robot = experiment.robot
    for said in filter(None, (describe(robot), describe_gears(robot), describe_ratio(robot))):
        hold(said)
    for plant in experiment.plants.values():
        if sag := getattr(inside(plant), "sag", ""):
            hold(sag)
            break
    for label, each in verdicts(experiment).items():
        hold(f"{label}: {each.describe()}")
        if why := why_sensitive(robot, each):
            hold(f"{label}: {why}")
        hold(f"{label}: {each.explain(robot.joint_names)}")


def note_differences(experiment: Experiment) -> None:
    """Say what MuJoCo does otherwise than armgpi's own plant."""
    from armgpi.plants.plant import inside

    for plant in experiment.plants.values():
        inner = inside(plant)
        if (differences := getattr(inner, "differences", None)) is not None:
            for said in differences or ("what it does differs by rounding alone",):
                hold(f"note: MuJoCo: {said}")
            return


def note_assumed(arm: Robot, as_json: bool, certified: str = "") -> None:
    """Refuse an arm with assumed rotors, and say of a file without them what a certificate is worth.

    Args:
        arm: the arm.
        as_json: whether the verdict is printed as JSON.
        certified: type of the controller that is to be certified; empty for a bound, which takes each.
    """
    from armgpi.gpi.payload import certified_sector
    from armgpi.robot import rotors

    ratio = math.sqrt(certified_sector().upper)
    if rotors.assumed_joints(arm):
        text = (
            f"the rotor inertias are assumed, within a factor of {rotors.SCATTER:g}, but a certificate needs "
            "the exact inertia matrix D(q)"
        )
        advice = [
            "Identify the rotor inertias (armgpi identify), or specify them by --rotor-inertia or --drives.",
            f"Without payload, a factor of up to {ratio:.2g} could be certified.",
        ]
        if certified == "gpi_auto":
            advice.insert(
                1, "Add --controller gpi: what gpi_auto chooses for elastic joints has no certificate."
            )
        if as_json:
            say(json.dumps({"verdict": Verdict("not judged", f"{text}. {' '.join(advice)}").plain()}))
        else:
            say(Verdict("not judged", text).line)
            say("\n".join(f"  {line}" for line in advice), lines=True)
        sys.exit(Verdict("not judged", text).exit_code)
    if names := rotors.silent(arm):
        hold(
            f"note: the URDF contains no rotor inertia of {', '.join(names)}, so this certificate is of "
            "an arm without rotors; geared motors have them"
        )


def note_gears(law: Any, delay: int) -> str:
    """Return below which resonance of its gears a claim of a rigid arm is void; empty without rotors."""
    from armgpi.gpi.gains import FixedGains
    from armgpi.tuning import geared

    if not (law.bias_robot.armature.any() and isinstance(law.gains, FixedGains)):
        return ""
    lowest, usual = geared.borne(law, law.bias_robot, delay)
    return (
        f"Stiff joints are assumed. If the lowest resonance of the joints is below {lowest:.3g} Hz "
        "(estimated numerically), the controller may become unstable and this is not valid; such motors "
        f"usually have about {usual:.2g} Hz"
    )


def joint_numbers(arm: Robot, text: str, option: str) -> Any:
    """Return one number or one for each joint."""
    value = per_joint(text, option)
    if isinstance(value, dict):
        missing = [name for name in arm.joint_names if name not in value]
        if missing:
            raise refusal(option, f"needs a value for {', '.join(missing)} as well")
    return value


def load_ends(text: str | None) -> tuple[float, float] | None:
    """Return the two loads of a range."""
    if text is None:
        return None
    try:
        light, heavy = (float(part) for part in text.split(":"))
    except ValueError:
        light, heavy = math.inf, 0.0
    if not 0.0 <= light <= heavy < math.inf:
        raise refusal(
            "--payload", f"expected two payloads [kg], the lighter first, such as '0:3', got {text!r}"
        )
    return light, heavy


def note_published(arm: Robot) -> None:
    """Say which published numbers of an arm's drives are used where its file contains none, with the source.

    Args:
        arm: as its file has it.
    """
    from armgpi.robot.known_arms import describe_published
    from armgpi.robot.rotors import with_published

    if published := describe_published(with_published(arm).drives, values=True):
        hold(published)
