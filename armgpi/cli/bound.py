"""The command that bounds the error along one path."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from armgpi.base.escape import json_data
from armgpi.base.verdict import Verdict, judge
from armgpi.cli import options as opt
from armgpi.cli.arms import (
    joint_numbers,
    load_ends,
    note_assumed,
    note_gears,
    note_world,
    possible_arms,
    refuse_pushes,
    resolved,
    unjudged_drives,
)
from armgpi.cli.parsing import is_experiment, refusal, stoppable
from armgpi.cli.pictures import check_file
from armgpi.cli.terminal import say
from armgpi.cli.written import write

if TYPE_CHECKING:
    from armgpi.certification.path import PathBound
    from armgpi.config import Experiment, ExperimentConfig, Origin
    from armgpi.robot.robot import Robot

#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "robot <ROBOT>": "Path of an experiment file (YAML) or a URDF, or name of a robot.",
    "torque NUMBERS": (
        "Disturbance torque on all joints at once, arbitrary in time, bounded by this [N m or N]."
    ),
    "force NUMBER": "Force at the tool in any direction, arbitrary in time, bounded by this [N].",
    "friction": "Include the robot's joint friction, as plant.friction does.",
    "friction_within SHARE": (
        "Include joint friction, which may be larger or smaller by up to this share, such as 0.2."
    ),
    "payload KG:KG": "Lightest and heaviest payload at the tip [kg], such as '0:1'.",
    "start NAME": "How the run starts. wrong-load: the first torque is that of the controller's model; "
    "held: the loop has held the arm.",
    "tool_speed NUMBER": "Also bound the stopping distance of the supervisor from this tool speed [m/s]; "
    "with a force limit, the speed of the impact.",
    "controller --controller --controllers NAME": "gpi or gpi_auto. Default: the file's, else gpi, or "
    "gpi_auto for a realistic arm.",
    "out --out -o FILE": "Write the bound (JSON).",
}

#: What a bound leaves out where the experiment has a supervisor.
_STOP = "a stop by the supervisor of the file (--tool-speed bounds it)"


#: What a bound of the force leaves out, and configurations of the reference that it looks at.
_PATH, _PLACES = "the error along the reference, as the force is bounded", 101


@stoppable
def bound(
    robot: str,
    torque: str = "0",
    force: float = 0.0,
    friction: bool = False,
    friction_within: float | None = None,
    payload: str | None = None,
    start: str = "wrong-load",
    tool_speed: float | None = None,
    identified: Path | None = None,
    controller: str | None = None,
    rotor_inertia: list[str] | None = None,
    drives: Path | None = None,
    out: Path | None = None,
    allow_part: bool = False,
    report: Path | None = None,
    as_json: bool = False,
) -> None:
    """Bound the error along the reference of an experiment, in millimetres at the tool.

    \b
    armgpi bound ur5.yaml --torque 0.5 --force 5
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.certification.path import bound_path
    from armgpi.certification.stopping import bound_stop
    from armgpi.config.plants import has_friction
    from armgpi.plants.plant import inside
    from armgpi.robot.batch import one_of

    _refuse_bad_options(report, friction_within)
    output = _Output(report, out, as_json, allow_part)
    experiment, known = _read(robot, rotor_inertia, drives, controller, as_json)
    settings = experiment.config.plant
    loads = load_ends(payload)
    if _has_force_limit(experiment):
        useless = _of_errors(torque, force, start, identified)
        sys.exit(_bound_force(experiment, loads, friction_within, tool_speed, useless, output))
    drawn = possible_arms(identified, experiment.robot)
    rubs = friction or friction_within is not None or has_friction(settings)
    law: Any = next(iter(experiment.controllers.values()))  # what is no GPI is refused there
    found = bound_path(
        law,
        experiment.reference,
        experiment.t_final,
        arms=_arms(drawn["arms"] or [one_of(inside(experiment.plant).robot)], loads, friction_within),
        others=_arms(drawn["others"], loads, friction_within),
        torque=joint_numbers(experiment.robot, torque, "--torque"),
        force=force,
        friction=rubs,
        bits=getattr(settings, "encoder_bits", None),
        delay=getattr(settings, "delay", None) or 0,
        start=start,
    )
    if found.tried:  # each with all its loads
        found = found._replace(tried=len(drawn["others"]))
    stop = None
    if found.holds and tool_speed is not None:
        stop = bound_stop(found, tool_speed, experiment.supervisor)
    supervised = experiment.supervisor is not None and stop is None
    left_out = [*[_STOP] * supervised, *unjudged_drives(known, rubs)]
    verdict = judge(found.holds, "the bound holds", left_out, accepted=allow_part)
    notes = [*filter(None, (str(stop or ""), *_gears(found), _dropped_limit(robot, controller)))]
    data = json_data({**found.plain(), "stop": stop and stop._asdict(), "verdict": verdict.plain()})
    _write_bound(found, data, notes, verdict, experiment, output)
    sys.exit(verdict.exit_code)


def _write_bound(
    found: PathBound, data: Any, notes: list[str], verdict: Verdict, experiment: Experiment, output: _Output
) -> None:
    """Write and print the bound of an error.

    Args:
        found: the bound.
        data: it as plain data.
        notes: a line each, below it.
        verdict: what it is worth.
        experiment: of which it is.
        output: where it goes.
    """
    if output.out is not None:
        write(output.out, json.dumps(data, indent=1) + "\n", "--out")
    if output.report is not None:
        write(output.report, _page(found, experiment, notes, verdict), "--report")
    if output.as_json:
        say(json.dumps(data), lines=True)
        return
    heading = f"{verdict.line}\n" if verdict.outcome == "holds for part" else ""
    say(heading + "\n  ".join([str(found), *notes]), lines=True)


def _dropped_limit(name: str, controller: str | None) -> str:
    """Return that a controller of the command line has no force limit, though the file's has one."""
    from armgpi import config

    if controller is None or not is_experiment(name):
        return ""
    said, _ = config.read(Path(name))
    for section in said.plain(given=True).get("controllers") or []:
        limit = section.get("force_limit")
        if limit is not None:
            return (
                f"--controller {controller} replaces the file's {section['type']} and leaves out its "
                f"force_limit of {limit:g} N; without --controller the force is bounded"
            )
    return ""


def _of_errors(torque: str, force: float, start: str, identified: Path | None) -> list[str]:
    """Return the options that are typed and change nothing but a bound of the error."""
    typed = {
        "--torque": torque != "0",
        "--force": force != 0.0,
        "--start": start != "wrong-load",
        "--identified": identified is not None,
    }
    return [option for option, there in typed.items() if there]


class _Output(NamedTuple):
    """Where a bound goes, and what is accepted.

    Attributes:
        report: file of a page; None for none.
        out: file of JSON; None for none.
        as_json: whether JSON is printed in place of text.
        allow_part: whether a bound is accepted that leaves something out.
    """

    report: Path | None
    out: Path | None
    as_json: bool
    allow_part: bool


class _Judged(NamedTuple):
    """What is said of a controller with a force limit: plain data, text and exit code."""

    data: dict[str, Any]
    text: str
    exit_code: int


def _instead(law: Any) -> str:
    """Return what can be bounded of a controller in place of its error; nothing for most."""
    from armgpi.control.impedance import CartesianImpedance, Impedance

    if not isinstance(law, Impedance):
        return ""
    limited = ""
    if isinstance(law, CartesianImpedance):
        limited = "; with force_limit, or a wall without friction in plant.environment, its force at rest is"
    reason = (
        "no proof bounds the error of a spring, whose damping from filtered positions ends at some frequency"
    )
    return f": {reason}{limited}"


def _has_force_limit(experiment: Experiment) -> bool:
    """Tell whether the force has a bound, and the error has none: by a force limit, or a spring at a wall."""
    law: Any = next(iter(experiment.controllers.values()))
    return getattr(law, "force_limit", None) is not None or _depth(experiment, law) is not None


def _depth(experiment: Experiment, law: Any) -> float | None:
    """Return how deep the reference brings a spring at the tool behind walls [m]; None for others."""
    import numpy as np

    from armgpi.control.impedance import CartesianImpedance
    from armgpi.plants.environment import Wall
    from armgpi.plants.plant import inside

    contacts = getattr(inside(experiment.plant), "environment", ())
    walls = [each for each in contacts if isinstance(each, Wall) and not each.friction]
    limited = getattr(law, "force_limit", None) is not None
    if limited or not walls or not isinstance(law, CartesianImpedance):
        return None
    robot, places = experiment.robot, _places(experiment)
    tool = np.array([robot.frame_pose(law.frame or robot.tip, q).translation for q in places])
    return max(0.0, *(float(wall.depth(tool).max()) for wall in walls))


def _places(experiment: Experiment) -> Any:
    """Return configurations of the reference that a bound of the force looks at, (k, n)."""
    import numpy as np

    return experiment.reference.at(np.linspace(0.0, experiment.t_final, _PLACES)).q


def _bound_force(
    experiment: Experiment,
    loads: tuple[float, float] | None,
    within: float | None,
    speed: float | None,
    useless: Sequence[str],
    output: _Output,
) -> int:
    """Print the bound of the force of a controller with a force limit, and return the exit code.

    Args:
        experiment: of the arm.
        loads: lightest and heaviest payload [kg].
        within: share that friction is known within; None where it is known.
        speed: of the impact [m/s]; None for no impact.
        useless: options that were typed and change nothing but a bound of the error.
        output: where it goes.
    """
    if output.report is not None:
        raise refusal("--report", "is not written for a controller with a force limit")
    for option in useless:
        said = "is for a bound of the error; of a controller with a force limit it is the force"
        raise refusal(option, said)
    judged = _judge_force(experiment, loads, within, speed, output.allow_part)
    if output.out is not None:
        write(output.out, json.dumps(judged.data, indent=1) + "\n", "--out")
    say(json.dumps(judged.data) if output.as_json else judged.text, lines=True)
    return judged.exit_code


def _judge_force(
    experiment: Experiment,
    loads: tuple[float, float] | None,
    within: float | None,
    speed: float | None,
    accepted: bool,
) -> _Judged:
    """Return what a tool presses with at rest at most along the reference; its error is not bounded.

    That is the limit, friction at the tool in the worst configuration and direction of the reference, and the
    weight of a payload that the model may lack, or have too much, or what the plant's gravity differs by.
    """
    import numpy as np

    from armgpi.control.force_limit import FREE_FALL
    from armgpi.plants.plant import inside
    from armgpi.robot.batch import one_of

    if speed is not None and not 0.0 < speed < np.inf:
        raise refusal("--tool-speed", f"expected a positive speed [m/s], got {speed:g}")
    law: Any = next(iter(experiment.controllers.values()))  # with a force limit
    configurations = _places(experiment)
    arm = one_of(inside(experiment.plant).robot)  # its payload is one that the controller may not know
    given: dict[str, Any] = {"configurations": configurations, "speed": speed, "arm": arm}
    depth = _depth(experiment, law)
    if depth is not None:
        given["depth"] = depth
    known = law.robot.friction.coulomb
    if within is not None:
        if not known.any():
            expected = "the controller's model has no Coulomb friction: specify it (robot.friction, --drives)"
            raise refusal("--friction-within", expected)
        given["friction"] = (1.0 + within) * known
    bound = law.force_bound(**given)
    weight = 0.0
    if loads is not None:
        range_ = getattr(law, "payload", None)  # what the model carries; without it, nothing
        low, high = (0.0, 0.0) if range_ is None else (float(range_.lightest), float(range_.heaviest))
        weight = FREE_FALL * max(loads[1] - low, high - loads[0])
    more = max(weight - bound.gravity, 0.0)
    bound = bound._replace(gravity=bound.gravity + more, total=bound.total + more)
    verdict = judge(
        True, f"at rest the tool presses with at most {bound.total:.3g} N", [_PATH], accepted=accepted
    )
    data = json_data({"force": bound._asdict(), "verdict": verdict.plain()})
    return _Judged(data, f"{verdict.line}\n{bound}", verdict.exit_code)


def _refuse_bad_options(report: Path | None, friction_within: float | None) -> None:
    """Refuse a page that cannot be written, and a share that is none."""
    if report is not None:
        check_file(report, "--report")
    if friction_within is not None and not 0.0 <= friction_within <= 1.0:
        raise refusal("--friction-within", f"expected a share from 0 to 1, got {friction_within:g}")


def _read(
    robot: str, rotor_inertia: list[str] | None, drives: Path | None, controller: str | None, as_json: bool
) -> tuple[Experiment, tuple[ExperimentConfig, Robot]]:
    """Return the experiment that a bound is of, and what is run; say which arms these are."""
    from armgpi.config import world

    known = resolved(robot, opt.Arm(rotor_inertia=rotor_inertia, drives=drives))
    experiment = _experiment(robot, opt.drives_given(rotor_inertia, drives), controller, known[1])
    note_world(*known, world.describe_arm(experiment.config, experiment.robot))
    if not _has_force_limit(experiment):  # the bound of a force does not use the inertia
        note_assumed(experiment.robot, as_json)
    return experiment, known


def _experiment(name: str, drives: dict[str, Any], controller: str | None, known: Robot) -> Experiment:
    """Return an experiment that a bound can be of.

    Args:
        name: of a robot, or path of a URDF or of an experiment file.
        drives: what options say of the drives.
        controller: its type; None for the file's, or gpi.
        known: the arm that `armgpi run` has.

    Raises:
        ConfigError: when something in it is not as it should be.
    """
    import numpy as np

    from armgpi import config
    from armgpi.gpi.law import GPI
    from armgpi.plants.actuators import Saturated
    from armgpi.plants.rigid_body import RigidBodyPlant
    from armgpi.plants.sensors import Delayed, Encoder

    # Of an arm by name: stiff joints and exact positions, along the default move of the other commands; the
    # automatic controller is the one that is run, which is for elastic joints.
    data: dict[str, Any] = {"robot": {"name": name}, "reference": _default_reference(known)}
    origin = config.Origin("command line")
    if is_experiment(name):
        said, origin = config.read(Path(name))
        data = said.plain(given=True)
    data["robot"] = {**data["robot"], **drives}
    if controller is not None:
        data["controllers"] = [{"type": controller}]
    # The law may be one for elastic joints; the arm is rigid unless the file says otherwise.
    data["plant"] = {"engine": "armgpi", **(data.get("plant") or {})}
    experiment = config.build(config.check(data, origin), origin)
    law, plant = next(iter(experiment.controllers.values())), experiment.plant
    if _has_force_limit(experiment):
        return experiment  # its force is bounded, which no plant decides
    if not isinstance(law, GPI):
        raise origin.error(
            ("controllers", 0, "type"),
            f"a bound can be computed for gpi and gpi_auto, got {type(law).__name__}{_instead(law)}",
        )
    _refuse_what_no_bound_knows(experiment, origin)
    effort = law.effort
    while isinstance(plant, Encoder | Delayed | Saturated):
        effort = np.minimum(effort, plant.effort) if isinstance(plant, Saturated) else effort
        plant = plant.plant
    if type(plant) is not RigidBodyPlant:
        kind = getattr(type(plant), "config_name", None) or type(plant).__name__
        raise origin.error(
            ("plant",), f"a bound can be computed for stiff joints with encoders and delay, got {kind!r}"
        )
    # A motor may give less than its law assumes.
    return experiment._replace(controllers={name: law.with_values(effort=effort)})


def _refuse_what_no_bound_knows(experiment: Experiment, origin: Origin) -> None:
    """Refuse limits of torque beside those of effort, and what pushes the simulated arm."""
    for key in ("torque_rate", "torque_cap"):
        if getattr(experiment.supervisor, key, None) is not None:
            raise origin.error(
                ("supervisor", key), "a bound assumes that only the effort limits bound the torques"
            )
    refuse_pushes(experiment.config, origin, "--torque and --force")


def _default_reference(robot: Robot) -> dict[str, Any]:
    """Return the default move of an arm as a section of an experiment file."""
    from armgpi.config.default_move import HOLD, ends, gentle_duration

    start, goal = ends(robot)
    duration = gentle_duration(robot, start, goal)
    points = [start.tolist(), goal.tolist(), start.tolist()]
    return {"points": points, "durations": [duration, duration], "holds": HOLD}


def _arms(arms: list[Robot], loads: tuple[float, float] | None, within: float | None) -> list[Robot]:
    """Return what the true arm may be: each of some arms, with loads and friction of their ranges."""
    from armgpi.certification.path import with_loads

    if loads is not None:
        arms = [loaded for arm in arms for loaded in with_loads(arm, *loads, arm.tip)]
    if within is not None:
        shares = (1.0 - within, 1.0 + within)
        arms = [arm.with_friction(*(x * y for y in arm.friction)) for arm in arms for x in shares]
    return arms


def _page(found: PathBound, experiment: Experiment, notes: list[str], verdict: Verdict) -> str:
    """Return the page of a bound and of what is said beside it, with a run of its experiment."""
    from armgpi.certification.path_page import write_page
    from armgpi.loop.simulation import simulate

    law, reference = found.wish.controller, found.wish.reference
    run = simulate(experiment.plant, law, reference, experiment.t_final) if found.holds else None
    return write_page(found, run, notes, verdict)


def _gears(found: PathBound) -> list[str]:
    """Return what gears do beside a bound: their resonance, and how far the tool sinks by their stiffness."""
    from armgpi.plants.elastic import sag
    from armgpi.robot import rotors
    from armgpi.robot.batch import one_of
    from armgpi.tuning import geared

    law = found.wish.controller
    if not found.holds:
        slow = (
            "This controller is slow, because elastic joints are assumed. If the joints are "
            "stiff, use --drives stiff."
        )
        return [slow] if geared.is_assumed(one_of(law.bias_robot)) else []
    arm = rotors.assume_drives(found.wish.arms[0], "elastic")
    line, source = sag(arm), "assumed" if geared.is_assumed(arm) else "specified"
    return [note_gears(law, found.wish.delay), line and f"{line} (stiffness {source})"]
