"""The commands that simulate: run and compare."""

from __future__ import annotations

import json
import shlex
import sys
from importlib import util
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from armgpi.cli import options as opt
from armgpi.cli.arms import note_differences, note_drives
from armgpi.cli.declared import values_of
from armgpi.cli.parsing import FAILED, INTERRUPTED, OK, is_experiment, known_backend, refusal, stoppable
from armgpi.cli.terminal import hold, print_held, say
from armgpi.cli.written import check_out, import_xarray

#: Engines of plants of which `armgpi play` makes a page.
PLAYED = ("armgpi", "elastic")
#: Words of a command that has a robot and no options: armgpi run ROBOT.
_PLAIN = 3
#: How often along the reference gravity is compared with effort.
_LOOKS = 401

# What takes long to import is imported by the commands, so that --help answers at once.
if TYPE_CHECKING:
    from armgpi.config import Experiment


@stoppable
@opt.add_options
def run(
    context: typer.Context,
    robot: str | None = None,
    controller: str | None = None,
    *,
    options: opt.Run,
) -> None:
    """Simulate one controller on a robot and print how well it tracked.

    \b
    armgpi run ur5 --payload 0.5 --encoder-bits 16
    armgpi run anthropomorphic3 --to q1=0.8,q2=0.4 --t-final 8 --out results
    """  # noqa: D301 (\b keeps the lines apart)
    asked = opt.Asked(robot=robot, controllers=controller, declared=values_of(context), options=options)
    sys.exit(_run(asked, options, compare=False))


@stoppable
@opt.add_options
def compare(
    context: typer.Context,
    robot: str | None = None,
    controllers: str | None = None,
    *,
    options: opt.Run,
) -> None:
    """Simulate several controllers on the same robot and print one table.

    \b
    armgpi compare ur5 --controllers gpi_auto,pid_positions --inertia-scale 0.8
    armgpi compare --config experiment.yaml --out results
    """  # noqa: D301 (\b keeps the lines apart)
    asked = opt.Asked(robot=robot, controllers=controllers, declared=values_of(context), options=options)
    sys.exit(_run(asked, options, compare=True))


def _run(asked: opt.Asked, options: opt.Run, compare: bool) -> int:
    """Run what the options describe, print it, save it, and return the exit code."""
    import numpy as np

    from armgpi import config as configuration
    from armgpi.cli import pictures
    from armgpi.cli.settings import settings
    from armgpi.cli.tables import check_table, write_table
    from armgpi.config import experiment as experiments
    from armgpi.loop.rollout import Status

    backend = known_backend(options.backend)
    pictures.check(
        plot=options.plot,
        view=options.view,
        html=options.html,
        report=options.report,
        interactive=options.interactive,
    )
    check_table(options.table)
    experiment = configuration.build(*settings(asked, compare))
    if len(experiment.runs) > 1 and not compare:
        raise refusal("--plant", "armgpi run takes one plant; armgpi compare takes both")
    experiment.robot.check_holding(experiment.reference.at(np.zeros(1)).q, "the start")
    check_out(options.out, options.config, options.force, experiment)
    if options.interactive:
        pictures.check_playable(experiment)
    note_drives(experiment, options.explain, options)
    _note_end_and_load(experiment)
    _warn_of_weak_motors(experiment)
    note_differences(experiment)
    print_held()
    runs = experiments.record_all(experiment, backend=backend)
    result: Any = None
    # A table on the terminal needs no dataset; what has all digits is to the last bit what is written.
    files = (options.out, options.plot, options.html, options.report, options.table)
    if options.view or options.as_json or any(file is not None for file in files):
        import_xarray()
        result = experiments.join({label: each.dataset() for label, each in runs.items()})
    records = experiments.records_of(runs) if result is None else experiments.records(result)
    paths: list[Path] = []
    try:  # first the files, then the table: whoever reads it may go away, as in `armgpi run ... | head`
        if options.out is not None:
            paths = experiments.save(result, experiment, options.out)
        if options.table is not None:
            paths.append(write_table(experiment, records, options.table))
        paths += pictures.make(options, result, experiment)
    finally:
        _print_results(asked, options, compare, experiment, records)
    for path in paths:
        say(f"wrote {path}", err=True)
    if options.view and result.sizes["time"]:
        pictures.serve_rollout(result, experiment.plant.robot)
    held = all(experiments.describe_saturation(each, experiment.t_final) for each in records)
    if held or experiments.overall_status(records) == Status.DIVERGED:
        name = experiment.config.robot.name
        say(f"note: `armgpi inspect {name}` finds what makes an arm hard to control", err=True)
    code = {Status.FINISHED: OK, Status.INTERRUPTED: INTERRUPTED}
    return code.get(experiments.overall_status(records), FAILED)


def _print_results(
    asked: opt.Asked, options: opt.Run, compare: bool, experiment: Experiment, records: list[dict[str, Any]]
) -> None:
    """Print the results as JSON; or the table, how each rollout ended, and what to do next."""
    from armgpi.cli.tables import print_tables
    from armgpi.config import experiment as experiments
    from armgpi.loop.rollout import Status

    if options.as_json:
        say(json.dumps(records))
        return
    if compare and (said := _verdict(experiment, records)):
        say(said)
    print_tables(experiment, records)
    finished = experiments.overall_status(records) == Status.FINISHED
    if finished and (commands := _next_commands(asked, options, compare, experiment)):
        say(commands, lines=True)


def _next_commands(asked: opt.Asked, options: opt.Run, compare: bool, experiment: Experiment) -> str:
    """Return the commands that a reader of the table may want next."""
    from armgpi.robot import robots

    is_file = asked.robot is not None and is_experiment(asked.robot)
    file = options.config or (asked.robot if is_file else None)
    name = shlex.quote(str(file or asked.robot))
    in_its_place = file is None or is_experiment(str(file))  # a scenario is no ROBOT, it needs --config
    given = name if in_its_place else f"--config {name}"
    command = f"armgpi {'compare' if compare else 'run'} {given}"
    same = "" if len(sys.argv) <= _PLAIN else "; add your options"
    proposals = []
    if options.report is None and util.find_spec("trimesh") is not None:
        proposals.append((f"{command} --report report.html", f"plots and animation{same}"))
    if not compare:
        proposals.append((f"armgpi compare {given}", f"other controllers on the same arm{same}"))
    config = experiment.config
    if file is not None:
        plain = config.reality is None and config.supervisor is None and config.plant.engine in PLAYED
        if plain and util.find_spec("casadi") is not None:
            proposals.append((f"armgpi play --config {name}", "a page with sliders"))
        elif in_its_place:
            proposals.append((f"armgpi inspect {name}", "what the model contains, and its problems"))
    elif robots.find_identified(asked.robot) is not None:
        proposals.append((f"armgpi export {name} -o exported", "C code of the controller"))
    else:
        proposals.append((f"armgpi new {name}", "a file of this experiment to edit"))
    if not proposals:
        return ""
    width = max(len(typed) for typed, _ in proposals)
    return "\n".join(["Next:", *(f"  {typed:<{width}}   {purpose}" for typed, purpose in proposals)])


def _verdict(experiment: Experiment, records: list[dict[str, Any]]) -> str:
    """Return what another nominal model costs, where it is all in which two controllers differ."""
    import numpy as np

    sections = experiment.config.controllers
    of_file = [each.nominal is not None for each in sections]
    if of_file != [True, False] or sections[0].type != sections[1].type or len(records) != 2:
        return ""
    ends = [f"{each['label']} {each['end']}" for each in records if each["status"] != "finished"]
    if ends:
        return "; ".join(ends)
    before, after = (np.mean(each["metrics"]["itae"]) for each in records)
    names = [each["label"] for each in records]
    return f"{names[1]} has {after / before:.2g} of the error of {names[0]} (ITAE)"


def _note_end_and_load(experiment: Experiment) -> None:
    """Say when a run is over before the last move is, and where the load is when a gripper moves as well."""
    moves = getattr(experiment.reference, "moves", ())
    end = moves[-1].t_start + moves[-1].duration if moves else 0.0
    if experiment.t_final < end - experiment.config.sample_time:
        hold(f"note: the run ends at {experiment.t_final:g} s, the last move at {end:g} s")
    load, robot = experiment.config.plant.payload, experiment.robot
    if load is not None and load.frame is None and (fingers := robot.provenance.get("grippers")):
        lock = " ".join(f"--lock {name}" for name in fingers)
        hold(f"note: the load is at {robot.tip!r}, before the gripper, which moves: {lock} locks it")


def _warn_of_weak_motors(experiment: Experiment) -> None:
    """Say where the reference asks a joint for more torque than it has, to hold the arm or to move it."""
    import numpy as np

    from armgpi.robot.equations import enough_efforts

    robot = experiment.plant.robot
    times = np.linspace(0.0, experiment.t_final, _LOOKS)
    target = experiment.reference.at(times)
    weak = robot.overloaded(target.q)
    if weak is not None:
        needed = abs(weak.torque)
        enough = enough_efforts(robot, target.q, weak.joint)
        proposed = ",".join(f"{joint}={effort:g}" for joint, effort in enough.items())
        say(
            f"warning: at {times[weak.place[0]]:.3g} s joint {weak.joint!r} needs {needed:.4g} to hold "
            f"the arm at the reference, and its effort limit is {weak.effort:g}, so it cannot hold the "
            f"arm there. Choose another goal, or specify the effort of its motor: --effort {proposed}",
            err=True,
            fg="yellow",
        )
        return
    share = np.abs(robot.inverse_dynamics(*target)) / robot.limits.effort
    at, j = np.unravel_index(int(np.argmax(share)), share.shape)
    if share[at, j] > 1.0:
        joint, limit = robot.joint_names[j], robot.limits.effort[j]
        say(
            f"warning: at {times[at]:.3g} s joint {joint!r} needs {share[at, j] * limit:.4g} to follow "
            f"the reference, and its effort limit is {limit:g}, so it cannot follow. Choose a slower "
            "motion: --duration",
            err=True,
            fg="yellow",
        )
