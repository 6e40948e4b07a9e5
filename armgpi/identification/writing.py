"""What was identified as files: the URDF with its <inertial> edited in place, drives, all numbers, a page."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import tostring
from xml.parsers import expat

import numpy as np
import pinocchio as pin

from armgpi.base import files
from armgpi.base.arrays import check_path
from armgpi.base.escape import json_data
from armgpi.config import schema
from armgpi.errors import UrdfError
from armgpi.identification.arm import Identified, Load, Validation
from armgpi.identification.excitation import Excitation
from armgpi.identification.pictures import draw
from armgpi.identification.text import say_causes, say_notes, say_residuals, tabulate
from armgpi.robot import markup
from armgpi.robot.assembly import Assembly, inertia_of, join
from armgpi.robot.identified import FORMAT, NAME, original_of
from armgpi.robot.robot import Robot
from armgpi.robot.robots import find_identified
from armgpi.viewing import page

#: Error at which a first motion is stopped [rad or m]: what is logged until then is enough to begin with.
_FIRST_ERROR = 0.1
#: A pseudo-inertia whose least eigenvalue is below this share of its largest one is none.
_POSSIBLE = 1e-12


class Edited(NamedTuple):
    """A URDF with other bodies.

    Attributes:
        content: the file.
        emptied: links fixed to others whose own inertia the identified body leaves no room for.
    """

    content: bytes
    emptied: tuple[str, ...]


def write_identified(
    found: Identified,
    folder: str | PathLike[str],
    validation: Validation | None = None,
    load: Load | None = None,
) -> list[Path]:
    """Write what was identified: a folder that :meth:`armgpi.Robot.load` and every command take.

    It has the URDF, and as it was before, ``drives.yaml``, ``identification.json`` and ``report.html``.

    Args:
        found: what was identified.
        folder: where; made where there is none.
        validation: on a log that was not fitted.
        load: what the arm carried in another log.

    Returns:
        What was written.

    Raises:
        UrdfError: when the robot's file has changed since it was loaded.
        RolloutError: when a file cannot be written.
    """
    import yaml

    target = files.make_folder(check_path(folder, "folder"))
    edited = edit_urdf(found.robot)
    source = Path(str(found.robot.provenance["source"]))
    stem = (source if source.suffix.lower() == ".urdf" else Path(found.robot.name)).stem
    drives = yaml.safe_dump(found.drives.plain(), sort_keys=False, allow_unicode=True)
    arm = {
        "urdf": (f"{stem}.urdf", edited.content),
        "before": (f"{stem}.before.urdf", _source(found.robot)),
        "drives": ("drives.yaml", drives.encode()),
    }
    data = plain(found, edited.emptied, validation)
    if load is not None:
        numbers = load._asdict()
        data["load"] = {key: np.asarray(number).tolist() for key, number in numbers.items()}
    arm_data: dict[str, object] = {
        key: {"file": name, "sha256": hashlib.sha256(content).hexdigest()}
        for key, (name, content) in arm.items()
    }
    # What else it takes to load the URDF again.
    provenance = found.robot.provenance
    repairs = dict.fromkeys(repair["name"] for repair in provenance.get("repairs", ()))
    if (meshes := _beside_meshes(found.robot)) is not None:
        arm_data["meshes"] = meshes
    data["arm"] = arm_data | {"lock": provenance["locked"], "repair": list(repairs)}
    contents: Mapping[str, str | bytes] = {
        **dict(arm.values()),
        NAME: json.dumps(data, indent=1, allow_nan=False) + "\n",
        "report.html": write_page(found, edited.emptied, validation),
    }
    return files.write_set(target, contents)


def edit_urdf(robot: Robot) -> Edited:
    """Return a robot's URDF with the bodies that the robot has; all but <inertial> is byte for byte the same.

    A body is a link and what is fixed to it. What is fixed keeps its own inertia, and the link gets the rest;
    where that rest is impossible, what is fixed loses its own. A robot that came from something else than a
    URDF file is written as it was loaded, with its limits and without shapes.

    Raises:
        UrdfError: when the file has changed since it was loaded.
    """
    content = _source(robot)
    bodies, emptied = {}, []
    model = robot.pinocchio_model()
    for joint, link, others in _bodies(robot):
        body = model.inertias[joint]
        of_link = body
        for placement, inertia in others.values():
            of_link = of_link - placement.act(inertia)
        if others and not _possible(of_link):
            of_link = body
            emptied += list(others)
        bodies[link] = of_link
    return Edited(_with_inertials(content, bodies, emptied), tuple(emptied))


def _source(robot: Robot) -> bytes:
    """Return the text of a robot's URDF.

    Raises:
        UrdfError: when the file has changed since it was loaded.
    """
    provenance = robot.provenance
    path = Path(str(provenance["source"]))
    if path.suffix.lower() != ".urdf" or not path.is_file():
        return _written(robot)
    content = files.read_bytes(path, markup.MAX_BYTES)
    without_mark = content.decode("utf-8-sig").encode()
    if hashlib.sha256(without_mark).hexdigest() != provenance["sha256"]:
        raise UrdfError(path, "has changed since it was loaded: load it and identify again")
    return content


def _written(robot: Robot) -> bytes:
    """Return the URDF of a robot that came from something else than a URDF file, with its limits."""
    root = _assembly(robot).element()
    numbers = {name: number for number, name in enumerate(robot.joint_names)}
    for joint in root.iterfind("joint"):
        limit = joint.find("limit")
        number = numbers.get(joint.get("name", ""))
        if limit is None or number is None:
            continue
        for end in ("lower", "upper", "effort", "velocity"):
            value = float(getattr(robot.limits, end)[number])
            if np.isfinite(value):
                limit.set(end, repr(value))
    return bytes(tostring(root))


def _beside_meshes(robot: Robot) -> dict[str, str] | None:
    """Return the URDF file beside which the meshes of a robot are, as :func:`original_of` reads it."""
    source = Path(str(robot.provenance["source"]))
    if source.suffix.lower() != ".urdf" or not source.is_file():
        return None
    path = original_of(source) or source
    return {"beside": str(path.resolve()), "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}


def _bodies(robot: Robot) -> list[tuple[int, str, dict[str, tuple[pin.SE3, pin.Inertia]]]]:
    """Return, joint by joint, its number, its link, and place and inertia of what is fixed to that."""
    assembly, model = _assembly(robot), robot.pinocchio_model()
    child = {joint.name: joint.child for joint in assembly.joints}
    inertials = {link.name: link for link in assembly.links if link.inertial}
    found = []
    for joint in range(1, model.njoints):
        own = child[str(model.names[joint])]
        others = {
            str(frame.name): (frame.placement, inertia_of(inertials[frame.name]))
            for frame in model.frames
            if frame.type == pin.FrameType.BODY
            and frame.parentJoint == joint
            and frame.name != own
            and frame.name in inertials
        }
        found.append((joint, own, others))
    return found


def _assembly(robot: Robot) -> Assembly:
    """Return the links and joints of a robot that came from a file or a model.

    Raises:
        UrdfError: when it came from neither.
    """
    if robot._assembly is None:
        raise UrdfError(str(robot.provenance["source"]), "did not come from a file: use Robot.load")
    return robot._assembly


def _possible(body: pin.Inertia) -> bool:
    """Return whether a body can be."""
    if not body.mass > 0.0:
        return False
    values = np.linalg.eigvalsh(pin.PseudoInertia.FromInertia(body).toMatrix())
    return bool(values[0] > _POSSIBLE * values[-1])


def _with_inertials(content: bytes, bodies: Mapping[str, pin.Inertia], emptied: Sequence[str]) -> bytes:
    """Return a URDF in which some links have other inertials, and some have none."""
    spans = _spans(content)
    edits = []
    for name, (start, end, there) in spans.items():
        if name in bodies:
            written = _inertial_xml(bodies[name])
            edits.append((start, end, written if there else written + b"\n"))
        elif name in emptied and there:
            edits.append((start, end, b""))
    for start, end, written in sorted(edits, reverse=True):
        content = content[:start] + written + content[end:]
    return content


def _inertial_xml(body: pin.Inertia) -> bytes:
    """Return an <inertial>."""
    m = body.inertia
    tensor = {"xx": m[0, 0], "xy": m[0, 1], "xz": m[0, 2], "yy": m[1, 1], "yz": m[1, 2], "zz": m[2, 2]}
    entries = " ".join(f'i{axes}="{float(value)!r}"' for axes, value in tensor.items())
    return (
        f'<inertial><origin xyz="{join(body.lever)}" rpy="0 0 0"/>'
        f'<mass value="{float(body.mass)!r}"/><inertia {entries}/></inertial>'
    ).encode()


def _spans(content: bytes) -> dict[str, tuple[int, int, bool]]:
    """Return where the <inertial> of each link is, or has to go, and whether there is one."""
    parser, path, begin, link = expat.ParserCreate(), [""], 0, ""
    spans: dict[str, tuple[int, int, bool]] = {}

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal link, begin
        path.append(tag)
        if path[1:] == ["robot", "link"]:
            link = attributes.get("name", "")
            after = content.index(b">", parser.CurrentByteIndex) + 1
            spans[link] = (after, after, False)
        elif path[1:] == ["robot", "link", "inertial"]:
            begin = parser.CurrentByteIndex

    def end(tag: str) -> None:
        if path[1:] == ["robot", "link", "inertial"]:
            after = content.index(b">", parser.CurrentByteIndex) + 1
            spans[link] = (begin, after, True)
        path.pop()

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(content, True)
    return spans


def experiment_files(
    robot: Robot,
    name: str,
    motion: Excitation,
    how: Mapping[str, Any],
    *,
    first: bool = False,
) -> dict[str, str]:
    """Return a motion and the experiment that runs it in the world that `armgpi run` has of the arm.

    Args:
        robot: the arm.
        name: of the robot, or the path of its file.
        motion: from :func:`armgpi.identification.excitation.excite`.
        how: how the robot was loaded: keys of the section `robot` -> values.
        first: whether the arm is stopped where it is far from the motion: nobody knows yet how it answers.
    """
    import yaml

    reference = motion.reference
    head = ",".join(["time", *robot.joint_names])
    rows = [",".join(f"{x:.12g}" for x in (t, *q)) for t, q in zip(reference.times, reference.q, strict=True)]
    there = Path(name).is_file() or find_identified(name) is not None
    place = str(Path(name).resolve()) if there else name
    section: dict[str, Any] = {"name": place}
    section |= {key: value for key, value in how.items() if value}
    if not how.get("drives") and (rotors := _specified_rotors(robot)):
        section["rotor_inertia"] = rotors
    experiment = {
        "format": schema.FORMAT,
        "robot": section,
        "ideal": False,
        "controllers": [{"type": "gpi_auto"}],
        "reference": {"file": "reference.csv"},
        "t_final": float(reference.t_end),
    }
    if first:
        experiment["supervisor"] = {"following": _FIRST_ERROR}
    text = yaml.safe_dump(experiment, sort_keys=False, allow_unicode=True)
    return {"reference.csv": "\n".join([head, *rows]) + "\n", "experiment.yaml": text}


def _specified_rotors(robot: Robot) -> dict[str, float]:
    """Return rotor inertia that was specified beside the robot's file, joint -> value [kg m^2 or kg]."""
    known = robot.drives.data.get("rotor_inertia", {})
    specified: dict[str, float] = {}
    for joint, datum in known.items():
        if datum.source == "specified" and not datum.file:
            specified[joint] = datum.value
    return specified


def plain(found: Identified, emptied: Sequence[str], validation: Validation | None) -> dict[str, object]:
    """Return what was identified as plain data."""
    names = found.robot.joint_names

    def of_joints(values: Sequence[float]) -> dict[str, float | None]:
        return dict(zip(names, json_data(values), strict=True))

    data: dict[str, object] = {
        "format": FORMAT,
        "robot": found.robot.name,
        "logs": list(found.sources),
        "torque": found.torque,
        "rotor_not_in_torque": [name for name, own in zip(names, found.hidden, strict=True) if own],
        "residual_over_torque": of_joints(found.residuals.tolist()),
        "lag": of_joints(found.lag.tolist()),
        "sign_width": of_joints(found.width.tolist()),
        "estimates": json_data([row._asdict() for row in (*found.table(bodies=True), *found.sums())]),
        "posterior": {"joints": list(names), **found.posterior.plain()},
        "emptied_links": list(emptied),
        "findings": [str(each) for each in found.findings],
    }
    if found.gears is not None:
        value, low, high = found.gears.mode.tolist()
        data["first_mode"] = {"value": value, "low": low, "high": high, "encoder_side": found.gears.side}
    if found.side is not None:
        data["encoder_side"] = found.side.side
    if found.simulated is not None:
        data["simulated_residual_over_torque"] = of_joints(found.simulated.tolist())
    if validation is not None:
        data["validation"] = {
            "log": validation.source,
            "identified": of_joints(validation.identified.tolist()),
            "file": of_joints(validation.file.tolist()),
        }
    return data


def write_page(found: Identified, emptied: Sequence[str], validation: Validation | None) -> str:
    """Return the report as a page, verdict first."""
    residuals = found.residuals if validation is None else validation.identified
    judged = validation or found.replayed
    causes = say_causes(found.robot, judged)
    verdict = say_residuals(found.robot, residuals, validation is not None, causes)
    sections = {}
    head, rows = tabulate(found, validation)
    sections["Joint by joint"] = page.table(head, rows, label="joint by joint")
    notes = say_notes(found, validation)
    if emptied:
        notes.append(
            f"the identified bodies leave no room for what the file contains of {', '.join(emptied)}, which "
            "are fixed to others: their mass is in the link that carries them"
        )
    sections["What to know"] = page.bullets(notes)
    seen = "the log that was not fitted" if validation else "the first fitted log"
    sections["Torques"] = f"<p>On {seen}.</p>{draw(found.robot, judged)}"
    summary = "".join(f"<p>{page.text(line)}</p>" for line in verdict)
    return str(page.document(f"Identified: {found.robot.name}", summary, sections))
