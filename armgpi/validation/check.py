"""Validate a model: sample it, compare it, check its laws, and find what is wrong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np

from armgpi.base.arrays import Array, check_number, check_type, check_whole
from armgpi.base.hints import with_keyword_hints
from armgpi.errors import ModelError, ParameterError, Remedy
from armgpi.robot.equations import PerJoint
from armgpi.robot.robot import Robot
from armgpi.validation import containment, forms, laws, repair, samples
from armgpi.validation.conventions import declare_convention
from armgpi.validation.course import Course
from armgpi.validation.diagnose import NOT_NAMED, Cause
from armgpi.validation.models import ARGUMENTS, States
from armgpi.validation.problem import Element, Mask, Problem
from armgpi.validation.report import DynamicsReport, FunctionReport
from armgpi.validation.samples import Sampled
from armgpi.validation.tree import Tree, from_robot
from armgpi.validation.witnesses import Found, find_causes, with_other_numbers
from armgpi.validation.worker import Worker

#: Without a reference, a model may have so many joints: all numbers up to this are tried.
MOST_JOINTS = 8
#: Significant digits of numbers that may have been rounded, most first.
_ROUNDED = range(8, 3, -1)
#: Sliding joints without limits are compared up to here [m]: the reach of an arm, so that no term drowns.
_SLIDE = 1.0
#: Longest time limit of a call [s].
_PATIENCE = 1e6
#: Rounding errors beyond this, relative, deserve a note: double precision leaves 1e-13 or so.
_FEW_DIGITS = 1e-11


@with_keyword_hints
def validate(
    model: Any,
    robot: Robot | str | PathLike[str] | None = None,
    *,
    frame: str | None = None,
    rtol: float = 1e-9,
    joints: int | None = None,
    time_limit: float = 5.0,
    seed: int = 0,
    absolute: bool = False,
    from_vertical: str | None = None,
    rotor_inertia: PerJoint | None = None,
    viscous_friction: PerJoint | None = None,
    passive: str | Sequence[str] = (),
    names: Mapping[str, str] | None = None,
    isolate: bool = False,
) -> DynamicsReport:
    """Compare hand-derived dynamics with a robot's, and name what is wrong with them.

    Args:
        model: any of: the path of a Python file or of a notebook, or the name of a module, followed by
            ``:Name`` when it has several models; a file of SymPy expressions; ``"paper"``; a module, class,
            object or mapping with some of the functions ``mass_matrix(q)``, ``coriolis_matrix(q, v)``,
            ``coriolis_torque(q, v)``, ``gravity(q)``, ``inverse_dynamics(q, v, a)``,
            ``forward_dynamics(q, v, tau)``, ``kinetic_energy(q, v)``, ``potential_energy(q)``,
            ``forward_kinematics(q)``, ``jacobian(q)``. They may be expressions of SymPy or CasADi. It runs
            in a process of its own.
        robot: the reference, as a :class:`armgpi.Robot`, a name or a URDF. Without one, the laws that hold
            for every arm are checked.
        frame: the robot's frame that the kinematics mean; its tip when not given.
        rtol: relative error up to which two values agree.
        joints: number of joints of a model without a reference; found by trying when not given.
        time_limit: how long one call of the model may take [s]; reading it may take twelve times that, and
            10 s at least.
        seed: of the random states.
        absolute: the model counts the angles of parallel joints from the base, not from the link before.
        from_vertical: "up" or "down" when it counts its first level axis from there.
        rotor_inertia: what the robot's joints have in addition [kg m^2 or kg]: a number, one per joint, or
            name -> value.
        viscous_friction: what the model's inverse and forward dynamics have in addition, linear in the
            joint velocities [N m s/rad or N s/m]; likewise.
        passive: joints without a motor: their torque is zero, or no argument of the forward dynamics.
        names: what the model calls its functions -> what they are; M, D, C and G are known.
        isolate: the model has no network, sees no other process and writes no file; it needs Linux, with
            user namespaces or bubblewrap. The latter takes a model of a file or module alone.

    Returns:
        What agrees, what differs, where, and why.

    Raises:
        ModelError: when the model cannot be read, or one of its functions raises, takes too long, changes
            its arguments, returns another shape, no numbers, NaN, or other values at the second call.
        ParameterError: when another argument is not as it should be.
        NameNotFound: when there is no such robot or frame.
        UrdfError: when the robot's file is no usable URDF.
    """
    check_type(absolute, "absolute", bool, "True or False")
    rtol = check_number(rtol, "rtol", "positive, at most 0.1", 0.0, 0.1, open_=True)
    time_limit = check_time_limit(time_limit)
    seed = check_whole(seed, "seed", 0)
    robot = load_robot(robot)
    if robot is not None and rotor_inertia is not None:
        robot = robot.with_armature(rotor_inertia)
    tree = None if robot is None else from_robot(robot, frame)
    if robot is not None and tree is not None and viscous_friction is not None:
        tree = replace(tree, viscous=_friction_of(robot, viscous_friction))
    convention = declare_convention(tree, names or {}, absolute, from_vertical, tuple(ARGUMENTS), passive)
    check_type(isolate, "isolate", bool, "True or False")
    course = Course()  # its time counts from here
    with Worker(model, name_of(model), time_limit, None, convention, isolate) as worker:
        if robot is None or tree is None:
            n = count_joints(worker, joints)
            states = random_states(np.full(n, -np.pi), np.full(n, np.pi), np.zeros(n, dtype=bool), seed)
        else:
            lower, upper = robot.limits.lower, robot.limits.upper
            states = random_states(lower, upper, robot.prismatic, seed)
            _check_count(worker, robot)
        unread = samples.passive_joints(worker, states)
        states.tau[:, unread] = 0.0
        sampled = samples.sample(worker, states)
        notes = tuple(_notes(worker, sampled, unread, bool(passive)))
        if tree is not None:
            sampled, said = _in_plain_form(tree, states, sampled, rtol)
            notes = (*notes, *said)
        own = laws.derive(worker, states, sampled)
        found = laws.check(worker, states, sampled, own, None if tree is None else tree.viscous)
        if robot is None or tree is None:
            found += laws.gradient(worker, states, sampled)
            return _report_of_laws(worker, n, sampled, found, notes)
        compared = repair.Compared(worker, states, Problem(tree, states.q, sampled, rtol), course)
        report = _with_laws(_compare(compared, robot, sampled, own, found, notes))
        if len(unread) == robot.n:  # an arm with motors is not compared where no torque is read
            missing = "what torques do: forward_dynamics reads none of them"
            report = replace(report, left_out=(*report.left_out, missing))
        compares_frame = any(name in sampled for name in ("forward_kinematics", "jacobian"))
        return report if compares_frame else replace(report, frame=frame)


def _report_of_laws(
    worker: Worker, n: int, sampled: Mapping[str, Sampled], found: list[laws.Law], notes: tuple[str, ...]
) -> DynamicsReport:
    """Return the report of a model of n joints that is compared with no robot."""
    joint_names = tuple(f"q{i + 1}" for i in range(n))
    states = samples.rows_of(sampled)
    report = DynamicsReport(worker.name, None, joint_names, states, (), (), tuple(found), notes)
    left_out = (*_left_out(worker), *laws.unjudged(sampled))
    return _with_laws(replace(report, uncompared=worker.uncompared, left_out=left_out))


#: Structural properties that have to hold before an arm of other lengths is suggested.
_ENOUGH_PROPERTIES = 4


def _friction_of(robot: Robot, viscous: PerJoint) -> Array:
    """Return viscous friction per joint [N m s/rad or N s/m], refusing what is none."""
    return robot.with_friction(viscous=viscous).friction.viscous


def check_time_limit(time_limit: float) -> float:
    """Return how long a call of a model may take [s], refusing what no clock counts."""
    return check_number(
        time_limit, "time_limit", f"positive, at most {_PATIENCE:g} [s]", 0.0, _PATIENCE, True
    )


def load_robot(robot: Robot | str | PathLike[str] | None) -> Robot | None:
    """Return a robot that is given as such, by its name or by its URDF."""
    return robot if robot is None or isinstance(robot, Robot) else Robot.load(robot)


def _notes(
    worker: Worker, sampled: Mapping[str, Sampled], passive: tuple[int, ...], declared: bool
) -> Iterator[str]:
    """Yield what else was seen of a model: that it prints, computes with few digits, forms of its arrays."""
    yield from containment.gaps()
    if worker.means:
        yield f"the model ran without network, other processes and files to write, by {worker.means}"
    for name, form in worker.forms.items():
        yield from form.notes(name)
    if passive:
        torques = ", ".join(f"tau{joint + 1}" for joint in passive)
        text = f"forward_dynamics is compared with {torques} = 0"
        if not declared:  # what --passive names may be read all the same
            text = f"forward_dynamics does not read {torques}: it is compared with {torques} = 0"
        some = len(passive) < sampled["forward_dynamics"].values.shape[1]
        yield f"{text} ({'passive joints' if some else 'it has no torque at all'})"
    if declared and "forward_dynamics" not in sampled:
        yield "--passive changed nothing: the model has no forward_dynamics"
    if worker.printed:
        yield "the model prints while it computes; that is not shown"
    fewest = min(sampled.values(), key=lambda s: len(s.values))
    if len(fewest.values) < samples.FEW:
        text = f"{fewest.function} is compared at {len(fewest.values)} states only"
        yield f"{text}: a call takes {worker.uses[fewest.function]:.2g} s"
    worst = max(sampled.values(), key=lambda s: s.digits)
    if worst.digits >= _FEW_DIGITS:
        text = f"{worst.function} is only computed to {worst.digits:.1g} of its largest value"
        yield f"{text}: differences up to {samples.SAFETY:g} times that do not count"


def _left_out(worker: Worker) -> tuple[str, ...]:
    """Return what of a model's functions is not compared."""
    return tuple(filter(None, (form.left_out(name) for name, form in worker.forms.items())))


def _with_laws(report: DynamicsReport) -> DynamicsReport:
    """Return a report with the laws that fail as causes, where nothing else says what is wrong."""
    if report.agrees or report.causes:
        return report
    failing = [law for law in report.laws if law.verdict == "fails"]
    causes = [Cause("law", f"{law.name} fails: {law.text}", "model", ()) for law in failing]
    return replace(report, causes=tuple(causes))


def _in_plain_form(
    tree: Tree, states: States, sampled: dict[str, Sampled], rtol: float
) -> tuple[dict[str, Sampled], tuple[str, ...]]:
    """Return the samples with a Jacobian that is right in another form in the plain one, and what is said."""
    name = "jacobian"
    if name not in sampled:
        return sampled, ()
    J = sampled[name].values
    if Problem(tree, states.q, {name: sampled[name]}, rtol).agreeing.all():
        return sampled, ()
    for text, values in forms.forms_of_jacobian(J):
        other = sampled[name]._replace(values=values, quantities={"J": values})
        if Problem(tree, states.q, {name: other}, rtol).agreeing.all():
            return {**sampled, name: other}, (f"{name}: {text}; it is compared in that form",)
    return sampled, ()


def _compare(
    compared: repair.Compared,
    robot: Robot,
    sampled: Mapping[str, Sampled],
    own: laws.Derived,
    found: list[laws.Law],
    notes: tuple[str, ...],
) -> DynamicsReport:
    """Return the report of a model beside a robot.

    Args:
        compared: the model beside the robot's tree.
        robot: the robot.
        sampled: samples of the model's functions.
        own: what the model says of its own quantities.
        found: the structural properties that were checked.
        notes: what else was seen.
    """
    worker, problem, course = compared.worker, compared.problem, compared.course
    seen = [_function_report(problem, compared.states, s) for s in sampled.values()]
    odd: tuple[str, ...] = ()
    told = Found([], None, (), ())
    if not all(one.agrees for one in seen):
        told = find_causes(compared, sampled, dict(_follows(problem, sampled, own)))
        told = told._replace(causes=[*told.causes, *_undiagnosed(seen, told.causes)])
        told = told._replace(causes=[_of_other_arm(cause, found) for cause in told.causes])
    elif (other := repair.odd_numbers(compared)) is not None:
        seen_with_others = with_other_numbers(compared, other)
        if seen_with_others is not None:
            odd, told = other.names, seen_with_others
    causes = told.causes
    functions = tuple(
        one._replace(diagnosis=tuple(c for c in causes if one.function in c.functions)) for one in seen
    )
    return DynamicsReport(
        worker.name,
        robot.name,
        robot.joint_names,
        len(problem.q),
        functions,
        tuple(causes),
        tuple(found),
        (*notes, *impossible_links(robot), *course.notes()),
        told.repaired,
        worker.uncompared,
        numbers_only=odd,
        differences=told.differences,
        symbols=told.symbols,
        left_out=(*_left_out(worker), *course.left_out()),
    )


def _of_other_arm(cause: Cause, properties: list[laws.Law]) -> Cause:
    """Return a cause without a name with what may be: equations of motion of an arm with other lengths."""
    judged = {law.verdict for law in properties}
    if cause.text != NOT_NAMED or judged != {"holds"} or len(properties) < _ENOUGH_PROPERTIES:
        return cause
    text = (
        "another arm: all structural properties hold, so the formulas may be right for other lengths; "
        "--suggest-urdf FILE without --robot looks for it"
    )
    return cause._replace(alternatives=(text, *cause.alternatives))


def name_of(model: Any) -> str:
    """Return what to call a model: its text, or its name, or that of its type."""
    if isinstance(model, str | PathLike):
        return str(model)
    return str(getattr(model, "__name__", None) or type(model).__name__)


def random_states(lower: Array, upper: Array, prismatic: Any, seed: int) -> States:
    """Return random states inside of the joint limits."""
    rng = np.random.default_rng(seed)
    widest = np.where(prismatic, _SLIDE, np.pi)
    # Also limits that leave hardly any room: formulas hold beyond them.
    low, high = np.maximum(lower, -widest), np.minimum(upper, widest)
    narrow = ~(high - low > 0.2)
    low, high = np.where(narrow, -widest, low), np.where(narrow, widest, high)
    q = rng.uniform(low, high, size=(samples.CONFIGURATIONS, len(lower)))
    v, a, tau = (rng.normal(size=q.shape) for _ in range(3))
    return States(q, v, a, tau)


def count_joints(worker: Worker, joints: int | None) -> int:
    """Return the number of joints of a model: as given, as it states, or the one that its functions take."""
    if joints is not None:
        return check_whole(joints, "joints", 1, 64)
    if worker.n is not None:
        return int(worker.n)
    fitting = [n for n in range(1, MOST_JOINTS + 1) if _refusal(worker, n) is None]
    # A function that takes q[0] to q[2] takes longer arrays too; one that takes any length says nothing.
    if fitting and (len(fitting) == 1 or 1 < fitting[0] == MOST_JOINTS + 1 - len(fitting)):
        return fitting[0]
    found = "no number of joints up to 8 does" if not fitting else f"{fitting} would all do"
    error = ParameterError("joints", None, f"given, as it cannot be found by trying: {found}")
    raise error.suggesting(Remedy("joints"))


def _refusal(worker: Worker, n: int) -> ModelError | None:
    """Return why a model's functions do not work with n joints, None when they do."""
    for name in worker.functions:
        try:
            # Any state that is not singular; zero is, for many arms.
            samples.call(worker, name, *(np.full((1, n), 0.3),) * len(ARGUMENTS[name]))
        except ModelError as error:
            if "took longer" in str(error) or "ended" in str(error):
                raise  # too slow or dead with any number of joints
            return error
    return None


def _check_count(worker: Worker, robot: Robot) -> None:
    """Refuse a model that has another number of joints than the robot."""
    if worker.n is not None and worker.n != robot.n:
        raise _other_count(worker, worker.n, robot)
    refusal = _refusal(worker, robot.n)
    if refusal is None:
        return
    for n in range(1, MOST_JOINTS + 1):
        if n != robot.n and _refusal(worker, n) is None:
            if "returns shape" in str(refusal):
                text = str(refusal).split(f"{refusal.function}: ", 1)[1]
                asked = ModelError(worker.name, refusal.function, f"{text}; is it a model of {n} joints?")
                raise asked.suggesting(Remedy("lock"), Remedy("keep"))
            raise _other_count(worker, n, robot)


def _other_count(worker: Worker, n: int, robot: Robot) -> ModelError:
    joints = ", ".join(robot.joint_names)
    return ModelError(
        worker.name,
        "",
        f"has {n} joint{'s' if n > 1 else ''}, but the robot {robot.name} has {robot.n} ({joints}); "
        "give the robot that the model is of, or lock joints of it",
    ).suggesting(Remedy("lock"), Remedy("keep"))


def _propose_rtol(problem: Problem, states: States, sampled: Sampled) -> str:
    """Return which `rtol` accepts an error that rounded numbers may cause; nothing for a larger error."""
    for digits in _ROUNDED:
        rtol = float(f"1e-{digits}")
        if Problem(problem.tree, states.q, {sampled.function: sampled}, rtol).agreeing.all():
            return f"rounded numbers of URDF or model may cause so small an error: --rtol {rtol:g} accepts it"
    return ""


def _function_report(problem: Problem, states: States, sampled: Sampled) -> FunctionReport:
    """Return the report of one function."""
    name = sampled.function
    rows = min(len(sampled.values), len(problem.q))
    v = states.v[:rows]
    values = sampled.values[:rows]
    if name == "coriolis_matrix":
        values = np.einsum("Nij,Nj->Ni", values, v)  # C is not unique, C v is
    if name == "potential_energy":
        values = values - values[0]  # known up to a constant
    reference = problem.values(name, states.first(rows))
    away = np.abs(values - reference).reshape(rows, -1).max(axis=1)
    worst, size = int(np.argmax(away)), float(np.abs(reference).max())
    mask = problem.of_function(name)
    differing = tuple(problem.elements[k].label for k in np.flatnonzero(mask & ~problem.agreeing))
    relative = float(away[worst]) / size if size > 0.0 else (0.0 if away[worst] == 0.0 else float("inf"))
    # Beside what the arm has elsewhere a rounding error is not curved, however small the torque.
    scale = max(float(np.abs(reference).max()), float(np.abs(problem.reference).max(initial=0.0)) * 1e-6)
    squares = float(np.square(np.abs(v).sum(axis=1)).max())
    # Below rounding nothing is curved; products of velocities enlarge what rounding there is.
    curved = sampled.quadratic > 1e-7 * max(scale, 1e-300) + samples.SAFETY * sampled.noise * squares
    note = ""
    if curved:
        note = f"not a polynomial of degree two in v: a residual of up to {sampled.quadratic:.3g}"
    elif differing and relative < 10.0 ** -min(_ROUNDED):
        note = _propose_rtol(problem, states, sampled)
    where = {letter: getattr(states, letter)[worst].tolist() for letter in ARGUMENTS[name]}
    agrees = not differing and not curved
    return FunctionReport(name, agrees, float(away[worst]), relative, where, differing, (), note)


def _undiagnosed(seen: list[FunctionReport], causes: list[Cause]) -> Iterator[Cause]:
    """Yield a cause without a name for every function that differs and has none."""
    told = {name for cause in causes for name in cause.functions}
    for one in seen:
        if one.agrees or one.function in told:
            continue
        text = f"{NOT_NAMED} ({one.function})"
        worst = f"{one.function}: largest error {one.max_abs:.3g} at {one.worst_at(', ', 4)}"
        element = Element(one.function, "whole", ())
        yield Cause("unknown", text, "model", (element,), evidence=tuple(filter(None, (worst, one.note))))


def _follows(
    problem: Problem, sampled: Mapping[str, Sampled], own: laws.Derived
) -> Iterator[tuple[str, tuple[str, Mask]]]:
    """Yield functions whose elements are what other functions of the model say.

    A wrong D gives a wrong C by the right formula; then C is a consequence, not a second mistake.
    """
    said: dict[str, tuple[str, Array]] = {}
    if own.H is not None:
        said["D"] = ("mass_matrix", sampled["mass_matrix"].quantities["D"])
        said["H"] = ("mass_matrix", own.H)
    if own.G is not None and "gravity" not in sampled:
        said["G"] = ("potential_energy", own.G)
    for name, one in sampled.items():
        wrong = problem.of_function(name) & ~problem.agreeing
        fits = [
            (source, problem.agrees_with({quantity: array}, wrong & problem.quantity(quantity)))
            for quantity, (source, array) in said.items()
            if quantity in one.quantities and name != source
        ]
        if found := [(source, mask) for source, mask in fits if mask.any()]:
            sources, masks = zip(*found, strict=True)
            yield name, (" and ".join(dict.fromkeys(sources)), np.logical_or.reduce(masks))
        if quantity := {"coriolis_torque": "H", "coriolis_matrix": "H", "gravity": "G"}.get(name):
            said.setdefault(quantity, (name, one.quantities[quantity]))


def impossible_links(robot: Robot) -> list[str]:
    """Return a line for every link whose mass and inertia no rigid body has.

    A rigid body has a positive mass, and principal moments of inertia of which none is negative and none
    exceeds the sum of the other two (the triangle inequality).
    """
    tree = from_robot(robot)
    lines = []
    for link, body in zip(tree.link_names, tree.bodies, strict=True):
        low, mid, high = np.linalg.eigvalsh(body.inertia)
        size = max(abs(high), 1e-300)
        # Moments of a flat body, where equality holds, are written with some ten digits.
        if body.mass < 0.0 or low < -1e-9 * size:
            lines.append(f"{link} of the robot has a negative mass or inertia: no rigid body has that")
        elif high > (low + mid) * (1.0 + 1e-9):
            lines.append(
                f"{link} of the robot is no rigid body: principal inertias {low:.4g}, {mid:.4g}, {high:.4g} "
                f"violate the triangle inequality ({high:.4g} > {low:.4g} + {mid:.4g} kg m²)"
            )
    return lines
