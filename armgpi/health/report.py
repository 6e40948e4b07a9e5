"""The health report of a robot: its model, the problems of it, and how a controller will work with it.

Whatever makes a model unusable is refused when it is loaded (``urdf.py``, ``urdf_model.py``). Here is what
loads and still goes wrong later: limits in degrees, a gripper that moves, gravity beyond a motor, an inertia
that no body has. Each such finding comes from a check (:mod:`armgpi.health.findings`).
"""

from __future__ import annotations

import warnings
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import check_number, check_path, check_type, check_whole
from armgpi.base.escape import counted, html_table, json_data
from armgpi.errors import ArmgpiWarning, ParameterError, Remedy, UrdfError
from armgpi.gpi.advice import light_model
from armgpi.gpi.law import GPI
from armgpi.gpi.payload import largest_payload
from armgpi.health import checks_control, compliance, findings
from armgpi.health import checks_shapes as checks_shapes
from armgpi.health import checks_urdf as checks_urdf  # registers its checks
from armgpi.health.findings import LEVELS, Finding, Level, Subject, fold
from armgpi.health.trials import with_what_helps
from armgpi.plants.elastic import sag
from armgpi.robot import known_arms, repairs, robots, rotors, tensors, urdf_model
from armgpi.robot.drives import Drives
from armgpi.robot.equations import PerJoint
from armgpi.robot.meshes import MeshFinder
from armgpi.robot.robot import Robot, load_with_document
from armgpi.robot.urdf import Urdf
from armgpi.tuning.verdict import accuracy, verdict

#: Of a robot with more joints than this, as a humanoid's whole body, no controller is worked out only to be
#: described: the time grows with the cube of their number (8 joints: 0.5 s, 18 joints: up to a minute).
MOST_TUNED = 14


@dataclass(frozen=True)
class HealthReport:
    """What a robot is, and what was found.

    Attributes:
        robot: the robot that was inspected.
        facts: what the model is and what a controller will do with it, as plain data (JSON).
        findings: what was found, the worst first.
    """

    robot: Robot
    facts: Mapping[str, Any]
    findings: tuple[Finding, ...] = field(default=())

    @property
    def has_errors(self) -> bool:
        """Whether something was found that stops a run."""
        return any(finding.level == "error" for finding in self.findings)

    def with_findings(self, more: Iterable[Finding], **facts: Any) -> HealthReport:
        """Return the report with more findings and facts."""
        worst_first = sorted((*self.findings, *more), key=lambda finding: LEVELS.index(finding.level))
        return HealthReport(self.robot, {**self.facts, **facts}, tuple(worst_first))

    def _repr_html_(self) -> str:
        """Return the findings as a table, for notebooks: those of several joints or links once."""
        head = ("level", "where", "finding", "what to do")
        folded = fold(self.findings)
        rows = [(finding.level, finding.where, finding.message, finding.repair) for finding in folded]
        return html_table(f"{self.robot.name}: {counted(len(rows), 'finding')}", head, rows)

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain data, None in place of infinity."""
        rows = []
        for finding in self.findings:
            remedies = [remedy._asdict() for remedy in finding.remedies]
            rows.append({**finding._asdict(), "remedies": remedies})
        data: dict[str, Any] = json_data({**self.facts, "findings": rows})
        return data


def inspect(
    path_or_name: str | PathLike[str],
    lock: Sequence[str] | Mapping[str, float] = (),
    keep: Sequence[str] | None = None,
    mimic: urdf_model.Mimic = "lock",
    effort: PerJoint | None = None,
    package_dirs: Iterable[str | PathLike[str]] = (),
    dt: float = 1e-3,
    delay: int = 0,
    encoder_bits: int = 16,
    repair: str | Iterable[str] = (),
    rotor_inertia: PerJoint | None = None,
    drives: Drives | Mapping[str, Any] | str | None = None,
    encoder_side: str | None = None,
) -> HealthReport:
    """Load a robot and report what its model contains, its problems, and how a controller will work with it.

    Args:
        path_or_name: as :meth:`armgpi.Robot.load`, as are `lock`, `keep`, `mimic` and `repair`.
        lock: joints to hold fixed.
        keep: joints to keep, all others are locked.
        mimic: whether joints that mimic another are locked or follow it.
        effort: effort limits that replace the URDF's [N m or N].
        package_dirs: folders in which meshes are looked for, besides the URDF's own.
        dt: sample time of the controller [s].
        delay: samples by which measurements are late.
        encoder_bits: resolution of the position sensors.
        repair: names of repairs that may be made in the file.
        rotor_inertia: seen at the joints [kg m^2 or kg].
        drives: what is known of them; see :meth:`armgpi.Robot.with_drives`. Or a word for what is assumed
            where nothing is; see :func:`armgpi.assume_drives`.
        encoder_side: where the encoders sit, "motor" or "link", of joints whose drives do not specify it.

    Raises:
        ArmgpiError: as :meth:`armgpi.Robot.load`, for what is no usable URDF. Where repairs would make it
            load, the remedies of the error name all of them.
        ParameterError: for a side that is neither, or that the drives of every joint contradict.
    """
    request = _Request(
        path_or_name,
        lock,
        keep,
        mimic,
        effort,
        package_dirs,
        dt,
        delay,
        encoder_bits,
        repair,
        rotor_inertia,
        drives,
        encoder_side,
    )
    subject, findings_of_checks = _examine(request)
    word = drives if isinstance(drives, str) else None
    return HealthReport(subject.robot, _facts(subject, word)).with_findings(findings_of_checks)


def find_problems(path_or_name: str | PathLike[str], **how: Any) -> tuple[Finding, ...]:
    """Return the findings of :func:`inspect` alone; what a controller will do with the arm takes longer.

    Args:
        path_or_name: as for :func:`inspect`.
        **how: likewise.

    Raises:
        ArmgpiError: likewise.
    """
    subject, findings_of_checks = _examine(_Request(path_or_name, **how))
    return HealthReport(subject.robot, {}).with_findings(findings_of_checks).findings


class _Request(NamedTuple):
    """What is asked of :func:`inspect`: how an arm is loaded, what is specified of it, and its loop."""

    path_or_name: str | PathLike[str]
    lock: Sequence[str] | Mapping[str, float] = ()
    keep: Sequence[str] | None = None
    mimic: urdf_model.Mimic = "lock"
    effort: PerJoint | None = None
    package_dirs: Iterable[str | PathLike[str]] = ()
    dt: float = 1e-3
    delay: int = 0
    encoder_bits: int = 16
    repair: str | Iterable[str] = ()
    rotor_inertia: PerJoint | None = None
    drives: Drives | Mapping[str, Any] | str | None = None
    encoder_side: str | None = None

    def checked(self) -> _Request:
        """Return the same with its folders as paths.

        Raises:
            ArmgpiError: as :func:`inspect`, for what is no usable argument.
        """
        check_number(self.dt, "dt", "positive [s]", open_=True)
        check_whole(self.delay, "delay", 0)
        check_whole(self.encoder_bits, "encoder_bits", 1, 52)
        folders = self.package_dirs
        if isinstance(folders, str | bytes | np.ndarray) or not isinstance(folders, Iterable):
            raise ParameterError("package_dirs", folders, "folders")
        return self._replace(package_dirs=[check_path(folder, "package_dirs") for folder in folders])

    def load(self) -> tuple[Robot, Urdf]:
        """Return the arm, and what its file contains."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ArmgpiWarning)  # the checks find what they say
            robot, document = load_with_document(
                self.path_or_name, self.lock, self.keep, self.mimic, self.repair
            )
        if self.effort is not None:
            robot = robot.with_limits(effort=self.effort)
        if self.drives is not None and not isinstance(self.drives, str):
            robot = robot.with_drives(self.drives)
        if self.rotor_inertia is not None:
            robot = robot.with_armature(self.rotor_inertia)
        if self.encoder_side is not None:
            robot = rotors.with_encoder_side(robot, self.encoder_side)
        if isinstance(self.drives, str):
            robot = rotors.assume_drives(robot, self.drives)
        return robot, document

    def needed_repairs(self) -> list[str]:
        """Return the repairs with which the file loads, those that are asked for among them.

        Raises:
            UrdfError: for what is wrong besides what can be repaired: no set of repairs would suffice.
        """
        asked_for = repairs.repair_names(self.repair)
        broadest = asked_for | {repairs.ALL, repairs.ACCEPT, repairs.NO_FRICTION}
        try:
            robot, _ = self._replace(repair=broadest).load()
        except UrdfError as error:
            # Masses are assumed only where they are asked for by name.
            proposed = [str(remedy.value) for remedy in error.remedies if remedy.kind == "repair"]
            if not proposed or asked_for.issuperset(proposed):
                raise
            robot, _ = self._replace(repair=broadest.union(proposed)).load()
        return list(dict.fromkeys(repairs.made_in(robot.provenance)))

    def with_remedies(self, remedies: Sequence[Remedy]) -> _Request:
        """Return the same with some remedies applied."""
        lock: dict[str, Any] = dict(self.lock) if isinstance(self.lock, Mapping) else dict.fromkeys(self.lock)
        effort: dict[str, float] = {}
        repair = repairs.repair_names(self.repair)
        mimic = self.mimic
        for remedy in remedies:
            match remedy.kind:
                case "lock":
                    lock |= dict.fromkeys(remedy.joints, remedy.value)
                case "effort" if isinstance(remedy.value, float):
                    effort |= dict.fromkeys(remedy.joints, remedy.value)
                case "mimic":
                    mimic = "follow"
                case "repair":
                    repair |= repairs.repair_names(str(remedy.value))
        changed = self._replace(lock=lock, mimic=mimic, repair=repair)
        if effort:
            specified = self.effort if isinstance(self.effort, Mapping) else {}
            changed = changed._replace(effort={**specified, **effort})
        return changed


def _examine(request: _Request) -> tuple[Subject, list[Finding]]:
    """Return an arm with its file, and what the checks find; errors are those of :func:`inspect`."""
    request = request.checked()
    path, name = robots.locate(request.path_or_name)
    request = request._replace(path_or_name=path if name is None else name)
    request = request._replace(repair=repairs.repair_names(request.repair))
    try:
        robot, document = request.load()
    except UrdfError as error:
        if not any(remedy.kind == "repair" for remedy in error.remedies):
            raise
        repairs_needed = ",".join(request.needed_repairs())
        raise error.suggesting(Remedy("repair", (), repairs_needed)) from None
    finder = MeshFinder(path, request.package_dirs)

    def subject_of(robot: Robot, document: Urdf) -> Subject:
        built = _as_built(document, robot)
        return Subject(built, robot, finder, request.dt, request.delay, request.encoder_bits)

    def find_again(remedies: Sequence[Remedy], kinds: Container[str]) -> list[Finding]:
        return findings.find(subject_of(*request.with_remedies(remedies).load()), kinds)

    subject = subject_of(robot, document)
    return subject, list(with_what_helps(findings.find(subject), find_again))


def _as_built(document: Urdf, robot: Robot) -> Urdf:
    """Return what a file contains with the mass properties that repairs gave the robot."""
    made = frozenset(repairs.made_in(robot.provenance))
    again = repairs.Repairs(document.source, made)
    links = {}
    for name, link in document.links.items():
        links[name] = urdf_model.convert(link, again)
        reading = tensors.only_reading(link.inertia)
        if reading is not None and f"reorder-inertia:{name}" in made:
            links[name] = replace(links[name], inertia=reading.values)
    return replace(document, links=links)


def with_payload(report: HealthReport, mass: float) -> HealthReport:
    """Return the report with what a load at the tip does to the loop, and the largest one that it tolerates.

    Args:
        report: of a robot.
        mass: of the load [kg].

    Raises:
        ParameterError: when the mass is negative, or the tip does not move.
    """
    check_type(report, "report", HealthReport, "a HealthReport, as inspect returns it")
    mass = check_number(mass, "payload", "zero or positive [kg]")
    control = report.facts["control"]
    most = largest_payload(report.robot, dt=control["dt"], delay=control["delay"] * control["dt"])
    spread = 1.0 + mass * most.mobility
    found = []
    if mass > most.effort:
        message = f"the motors do not hold {mass:g} kg at {report.robot.tip!r} at every configuration"
        repair = "a smaller load, or more effort"
        found.append(Finding("warning", "robot", message, mass, most.effort, repair, (), "payload"))
    robot = rotors.assume_rotors(report.robot)
    law = report.facts["gpi_auto"]
    carried = law["nominal_load"] if law is not None else 0.0
    # What the rule still cannot take is a warning, what the printed law cannot is worth knowing.
    levels: tuple[tuple[Level, float], ...] = (("warning", carried), ("info", 0.0))
    for level, nominal in levels:
        if said := list(light_model(robot, nominal)):
            found += [finding._replace(level=level, kind="payload") for finding in said]
            break
    facts = {
        "mass": mass,
        "frame": report.robot.tip,
        "delta_unknown": [1.0 / spread, 1.0],  # eigenvalues of D^-1 D-hat, the nominal model without it
        "delta_nominal": [1.0, spread],  # and with it, while it comes and goes
        "largest_unknown": most.unknown,
        "largest_nominal": most.nominal,
        "largest_held": most.effort,
        "mobility": most.mobility,
        "largest_certifiable": most.certifiable,
    }
    return report.with_findings(found, payload=facts)


def _facts(subject: Subject, drives: str | None) -> dict[str, Any]:
    """Return what the model is and what a controller will do with it, some drives assumed."""
    document, robot = subject.document, subject.robot
    known = rotors.assume_drives(robot, drives)
    return {
        "name": robot.name,
        "source": document.source,
        "sha256": document.sha256,
        "n": robot.n,
        "base": document.base,
        "tip": robot.tip,
        "links": len(document.links),
        "total_mass": robot.total_mass,
        "moving_mass": float(sum(inertia.mass for inertia in robot.pinocchio_model().inertias[1:])),
        "reach": subject.reach,
        "locked": dict(subject.locked),
        "mimic": robot.provenance.get("mimic", "lock"),
        "repairs": list(robot.provenance.get("repairs", ())),
        "product": known_arms.describe_arm(known),
        "published": known_arms.describe_published(known.drives, values=True),
        "rotors": rotors.describe(known),
        "gears": rotors.describe_gears(known),
        "sag": sag(known),
        "joints": _joints(subject),
        "least_eigenvalue": float(subject.eigenvalues[:, 0].min()),
        "condition": float((subject.eigenvalues[:, -1] / subject.eigenvalues[:, 0]).max()),
        "configurations": len(subject.q),
        "control": {
            "dt": subject.dt,
            "delay": subject.delay,
            "encoder_bits": subject.encoder_bits,
            "omega_c": subject.omega,
        },
        "gpi_auto": None if robot.n > MOST_TUNED else _untuned_facts(subject, known, drives),
        "compliance": compliance.plain(_compliance(subject, known)),
    }


def _compliance(subject: Subject, known: Robot) -> compliance.Compliance | None:
    """Return what an impedance controller may be asked for; None for an arm that cannot have one."""
    if not (subject.robot.limits.effort > 0.0).all():
        return None  # the check of the effort reports it
    return compliance.compliance_of(known, subject.dt, subject.delay * subject.dt)


def _untuned_facts(subject: Subject, known: Robot, drives: str | None) -> dict[str, Any] | None:
    """Return what GPI takes for the arm as it is known when nobody tunes it, and what its loops tolerate."""
    dt, bits = subject.dt, subject.encoder_bits
    if not (subject.robot.limits.effort > 0.0).all():
        return None  # the check of the effort reports it
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)  # the checks find what they say
        law = GPI.auto(known, dt, delay=subject.delay * dt, bits=bits, drives=drives)
    margins, torque = law.margins(), law.count_torque(bits)
    said = verdict(law, known, bits)
    off = accuracy(law, known)
    return {
        "integrators": law.integrators,
        "rolloff": law.rolloff,
        "nominal_load": 0.0 if law.payload is None else law.payload.heaviest,
        "omega_c": law.gains.nominal().omega_c.tolist(),
        "delay_margin": said.spare,  # of the loop that is run: that of stiff joints is none of an elastic arm
        "delta": list(margins.delta),
        "count_torque": torque.tolist(),
        "count_share": (torque / law.effort).tolist(),
        "limits": list(said.limits),
        "sensitivity": said.sensitivity,
        "verdict": said.describe(),
        "limited": said.explain(known.joint_names),
        "yielding": off.yielding.tolist(),
        "deflection": off.deflection.tolist(),
        "accuracy": off.explain(known.joint_names, known.prismatic.tolist()),
    }


def _joints(subject: Subject) -> list[dict[str, Any]]:
    """Return what every joint is."""
    robot = subject.robot
    holding = np.abs(subject.gravity).max(axis=0)
    diagonal = np.diagonal(subject.inertia, axis1=1, axis2=2)
    omega = checks_control.omega_of_encoder(subject)
    return [
        {
            "name": joint.name,
            "type": joint.type,
            "parent": joint.parent,
            "child": joint.child,
            **{key: float(limit[j]) for key, limit in robot.limits._asdict().items()},
            "damping": float(robot.friction.viscous[j]),
            "friction": float(robot.friction.coulomb[j]),
            "armature": float(robot.armature[j]),
            "holding": float(holding[j]),
            "inertia_least": float(diagonal[:, j].min()),
            "inertia_most": float(diagonal[:, j].max()),
            "omega_encoder": float(omega[j]),
        }
        for j, joint in enumerate(subject.free)
    ]
