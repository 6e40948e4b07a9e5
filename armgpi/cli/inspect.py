"""The command that inspects a robot's model."""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from armgpi.base.escape import counted, printable
from armgpi.base.verdict import Verdict, judge
from armgpi.cli import options as opt
from armgpi.cli.arms import names_of_options, note_world, resolved
from armgpi.cli.parsing import OFFERED, as_option, is_experiment
from armgpi.cli.terminal import console as console_of
from armgpi.cli.terminal import natural_width, say, widen
from armgpi.errors import require_extra

if TYPE_CHECKING:
    from armgpi.config import ExperimentConfig
    from armgpi.health.findings import Finding
    from armgpi.health.report import HealthReport
    from armgpi.robot.robot import Robot

#: Suffixes of MuJoCo's models, which MuJoCo itself reads a second time.
_MJCF = (".xml", ".mjcf")
#: Length to which names of joints may be folded in the table.
_FOLDED = 10

#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "payload KG": "Payload at the tip whose effect on the loop is shown [kg]; 0.5 by default.",
    "encoder_side NAME": "Where the encoders are: 'motor' or 'link'; for joints whose drives lack it.",
    "push N": "Simulate a push on the tool against the default controller [N]: how far it gives way.",
    "cross_check": "Read the URDF with yourdfpy as well, and compare.",
}


@opt.add_options
def inspect(
    robot: str,
    encoder_bits: int | None = None,
    delay: int | None = None,
    dt: float | None = None,
    encoder_side: str | None = None,
    payload: float | None = None,
    push: float | None = None,
    cross_check: bool = False,
    explain: bool = False,
    allow_part: bool = False,
    report: Path | None = None,
    as_json: bool = False,
    *,
    how: opt.Arm,
) -> None:
    """Report what a robot's model contains, its problems, and how a controller will work with it.

    \b
    armgpi inspect ur5
    armgpi inspect my_arm.urdf --lock gripper --cross-check
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.certification.quantities import motion
    from armgpi.cli.pictures import check_file
    from armgpi.health import report as health

    if report is not None:
        check_file(report, "--report")
    if cross_check and Path(robot).suffix.lower() not in _MJCF:
        require_extra("yourdfpy", "check")
    loop = {"dt": dt, "delay": delay, "encoder_bits": encoder_bits, "payload": payload}
    typed: dict[str, Any] = {**loop, "encoder_side": encoder_side}
    known = resolved(robot, how, None, encoder_side) if is_experiment(robot) else None
    settings = _settings(robot, how, typed, known)
    payload = settings.pop("payload", 0.5)
    with names_of_options(
        lock=settings.get("lock"), keep=settings.get("keep"), repair=settings.get("repair")
    ):
        found = health.inspect(settings.pop("name"), package_dirs=how.package_dir or [], **settings)
    found = health.with_payload(found, payload)
    found = found.with_findings([], motion=motion(found.robot))
    if cross_check:
        from armgpi.health.crosscheck import with_cross_check

        found = with_cross_check(found)
    note_world(*(known or resolved(robot, how, found.robot)))
    if push is not None:
        found = _with_push(found, push)
    verdict = _verdict(found, allow_part)
    if as_json:
        data = {**found.as_dict(), "verdict": verdict.plain()}
        for row, finding in zip(data["findings"], found.findings, strict=True):
            row["option"] = _option(finding)
        say(json.dumps(data))
    else:
        _show(found, verdict, explain)
    if report is not None:
        from armgpi.viewing import meshcat

        say(f"wrote {meshcat.write(_page(found, verdict), report)}", err=True)
    sys.exit(verdict.exit_code)


def _verdict(report: HealthReport, allow_part: bool = False) -> Verdict:
    """Return the verdict: a second reading that was asked for and could not be had is left out."""
    from armgpi.health.findings import fold

    left_out = [
        f"{finding.kind}: {finding.message}"
        for finding in report.findings
        if finding.kind == "cross-check" and finding.level == "warning"
    ]
    stops = "something stops a run: " if report.has_errors else ""
    text = stops + _count_findings(fold(report.findings))
    return judge(not report.has_errors, text, left_out, accepted=allow_part)


def _with_push(report: HealthReport, force: float) -> HealthReport:
    """Return the report with what a force [N] on the tool does."""
    from armgpi.health import pushed

    control = report.facts["control"]
    found = pushed.pushed(report.robot, force, dt=control["dt"], bits=control["encoder_bits"])
    facts = {
        "force": force,
        "said": pushed.describe(found, force),
        "directions": [each._asdict() for each in found],
    }
    return report.with_findings([], push=facts)


def _settings(
    robot: str, how: opt.Arm, typed: dict[str, Any], known: tuple[ExperimentConfig, Robot] | None
) -> dict[str, Any]:
    """Return what is known of the arm and its loop: options win over an experiment file.

    Args:
        robot: name of a robot, path of a URDF or of an experiment file.
        how: options of how the arm is loaded, and of its drives.
        typed: options of the loop.
        known: what an experiment file resolves to, and its arm; None for a robot.
    """
    from armgpi import config
    from armgpi.config.world import DELAY
    from armgpi.robot import robots
    from armgpi.tuning.rule import BITS

    arm: dict[str, Any] = {"name": robot}
    loop: dict[str, Any] = {} if robots.is_textbook(robot) else {"encoder_bits": BITS, "delay": DELAY}
    if known is not None:
        said = config.read(Path(robot)).config
        arm = said.robot.plain(given=True)
        plant = known[0].plant.plain()
        for key in {"gravity", "friction"} & set(arm):
            del arm[key]
        if plant["encoder_side"] not in known[1].drives.value("encoder_side"):
            plant["encoder_side"] = None  # an arm that is not what its controller assumes: its drives count
        loop = {"dt": said.sample_time, **plant, "payload": (plant["payload"] or {}).get("mass")}
    loop = {key: loop.get(key) if value is None else value for key, value in typed.items()}
    return arm | opt.robot_given(how) | {key: value for key, value in loop.items() if value is not None}


def _show(report: HealthReport, verdict: Verdict, explain: bool) -> None:
    """Print the report: facts, joints, findings, verdict."""
    from armgpi.health.findings import fold

    console = console_of(soft_wrap=True)
    for sentence in _what_it_is(report.facts, explain):
        console.print(sentence)
    joints = report.facts["joints"]
    parts: list[Sequence[_Column]] = [_COLUMNS]
    if natural_width(console, _joint_table(joints, _COLUMNS)) > console.width:
        parts = [_COLUMNS[:_LIMITS], _COLUMNS[_LIMITS:]]
    for columns in parts:
        # Long names are folded; a terminal too narrow even so gets whole numbers all the same.
        widen(console, _joint_table(joints, columns, longest=_FOLDED))
        console.print(_joint_table(joints, columns), soft_wrap=False)
    for part in _what_follows(report.facts):
        console.print(part.heading)
        for sentence in part.sentences:
            console.print(f"  {sentence}")
    styles = {"error": "red", "warning": "yellow", "info": ""}
    findings = fold(report.findings)
    for finding in findings:
        option = _option(finding)
        with_run = "" if option.split(" ")[0] in OFFERED else "run with "
        remedy = f"{'; ' if finding.repair else ' -> '}{with_run}{option}" if option else ""
        console.print(f"{finding.level}: {printable(f'{finding}{remedy}')}", style=styles[finding.level])
    console.print(verdict.line)


def _what_it_is(facts: Mapping[str, Any], explain: bool = True) -> list[str]:
    """Return in sentences what the model contains, and what is assumed of its drives.

    Args:
        facts: of the report.
        explain: whether assumed values and their reasons are printed; else what is assumed.
    """
    said = [
        f"{printable(facts['name'])}: {counted(facts['n'], 'joint')}, "
        f"{facts['moving_mass']:.4g} kg moving of {facts['total_mass']:.4g} kg, "
        f"reach {facts['reach']:.3g} m, from {facts['base']!r} to {facts['tip']!r}",
        f"file: {printable(facts['source'])}",
    ]
    drives = _assumptions(facts) if explain else _assumed_shortly(facts)
    said[1:1] = drives
    if facts["sag"]:
        said.append(facts["sag"])
    if facts["locked"]:
        said.append(
            "locked: " + ", ".join(f"{printable(name)} at {x:g}" for name, x in facts["locked"].items())
        )
    return said


def _assumed_shortly(facts: Mapping[str, Any]) -> list[str]:
    """Return which product the arm is, and what is assumed of its drives, in a line each."""
    said = [printable(facts["product"].partition("; ")[0])] if facts["product"] else []
    words = {"rotor inertia": facts["rotors"], "joint stiffness": facts["gears"]}
    assumed = [name for name, text in words.items() if "assumed" in text]
    if facts["published"]:
        said.append("drives: values published for this arm are used (--explain prints them)")
    if assumed:
        names = " and ".join(assumed)
        said.append(
            f"assumed, as the URDF does not contain it: {names} (--explain prints values and reasons)"
        )
    return said


class _Part(NamedTuple):
    """A part of the report: its heading, and sentences."""

    heading: str
    sentences: list[str]


def _what_follows(facts: Mapping[str, Any]) -> list[_Part]:
    """Return how a controller will work with the arm."""
    control, load, motion = facts["control"], facts["payload"], facts["motion"]
    less, more = load["delta_unknown"][0], load["delta_nominal"][1]
    parts = [
        _Part(
            f"Inertia matrix D(q), over {facts['configurations']} configurations",
            [
                f"smallest eigenvalue {facts['least_eigenvalue']:.3g}, largest condition number "
                f"{facts['condition']:.3g}",
                f"numbers for armgpi certify at 1 rad/s or m/s: sigma = {motion['sigma']:.3g} 1/s (rate of "
                f"D), kappa_v = {motion['kappa_v']:.3g} 1/s (Coriolis), kappa_e = {motion['kappa_e']:.3g} "
                "1/s^2 (gravity)",
            ],
        ),
        *_automatic_part(facts),
        _Part(
            "Controller gpi (fixed gains, stiff joints)",
            [
                f"default bandwidth omega_c = {control['omega_c']:.4g} rad/s at {1e3 * control['dt']:g} ms "
                f"with a delay of {control['delay']} sample{'s' * (control['delay'] != 1)}; "
                f"the last column of the table is the largest "
                f"bandwidth for {control['encoder_bits']}-bit encoders"
            ],
        ),
        *_compliance_part(facts),
        _Part(
            f"Payload {load['mass']:g} kg at {load['frame']!r}",
            [
                "inertia ratio delta (eigenvalues of D^-1 D-hat, 1: exact model): "
                f"{less:.2g} to 1 if it is attached but not in the model, 1 to {more:.3g} if it is in the "
                "model but not attached",
                f"a payload attached and removed can be certified up to "
                f"{_mass(load['largest_certifiable'])} (mobility mu = {load['mobility']:.3g} 1/kg)",
            ],
        ),
        _Part(
            "Largest payload",
            [
                f"{_mass(load['largest_unknown'])} if the controller does not know it (limit of stability)",
                f"{_mass(load['largest_nominal'])} with --payload-range at the default bandwidth",
                f"{_mass(load['largest_held'])} by the effort limits",
            ],
        ),
    ]
    if "push" in facts:
        parts.append(_Part(f"Push of {facts['push']['force']:g} N on the tool", [facts["push"]["said"]]))
    if "cross_check" in facts and not facts["cross_check"]["differences"]:
        check = facts["cross_check"]
        same = "axes, limits and poses" if check["reader"] == "yourdfpy" else "poses"
        parts.append(
            _Part(
                "Second reader",
                [
                    f"cross-check: {check['reader']} reads the same {same} of {check['links']} links at "
                    f"{check['configurations']} configurations, to "
                    f"{max(check['position'], check['rotation']):.1g}"
                ],
            )
        )
    return parts


def _mass(kg: float) -> str:
    """Return a mass as text; a joint whose axis the load lies on carries any."""
    return f"{kg:.3g} kg" if math.isfinite(kg) else "any mass"


def _compliance_part(facts: Mapping[str, Any]) -> list[_Part]:
    """Return what an impedance controller may be asked for; none where the arm cannot have one."""
    found = facts["compliance"]
    return [] if found is None else [_Part("Controller cartesian_impedance", found["said"])]


def _automatic_part(facts: Mapping[str, Any]) -> list[_Part]:
    """Return the GPI controller that automatic tuning chooses for the arm; none where it cannot."""
    from armgpi.health.report import MOST_TUNED

    heading = "Controller gpi_auto (automatic, model-based tuning)"
    if facts["n"] > MOST_TUNED:
        return [
            _Part(
                heading,
                [
                    f"not worked out for {facts['n']} joints, as that takes long (at most {MOST_TUNED}): "
                    "choose an arm of the robot with --keep"
                ],
            )
        ]
    from armgpi.cli.tables import describe_ratios

    if (law := facts["gpi_auto"]) is None:
        return []
    name = [joint["name"] for joint in facts["joints"]]
    slowest, fastest = min(law["omega_c"]), max(law["omega_c"])
    shares = law["count_share"]
    j = shares.index(max(shares))
    low, high = law["delta"]
    order = "integrator" if law["integrators"] == 1 else "integrators"
    return [
        _Part(
            heading,
            [
                f"bandwidth omega_c = {slowest:.3g} to {fastest:.3g} rad/s, {law['integrators']} {order}, "
                f"roll-off {law['rolloff']}, nominal load {law['nominal_load']:.2g} kg",
                law["verdict"],
                law["limited"],
                law["accuracy"],
                f"stable for inertia ratios delta {describe_ratios(low, high)} if joints are stiff",
                f"one encoder count changes the torque of {printable(name[j])} by "
                f"{law['count_torque'][j]:.2g} {_torque_unit(facts['joints'][j])}, "
                f"{100 * shares[j]:.2g} % of its effort",
            ],
        )
    ]


def _torque_unit(joint: Mapping[str, Any]) -> str:
    """Return the unit of the torque of a joint, or of its force."""
    return "N" if joint["type"] == "prismatic" else "N m"


def _page(report: HealthReport, judged: Verdict) -> str:
    """Return the report as a page: the verdict, what was found, the joints, what a controller will do."""
    from armgpi.health.findings import fold
    from armgpi.viewing import page

    facts = report.facts
    joints = [[joint["name"], *(column.text(joint) for column in _COLUMNS)] for joint in facts["joints"]]
    findings = fold(report.findings)
    found = [
        [each.level, each.where, each.message, "; ".join(filter(None, [each.repair, _option(each)]))]
        for each in findings
    ]
    kind = {"error": "bad", "warning": "fair"}.get(findings[0].level if findings else "", "good")
    sections = {
        "Findings": page.table(
            ["level", "where", "finding", "what to do"], found, label="findings", words=(1, 2, 3)
        )
        if found
        else "<p>None.</p>",
        "Joints": page.table(["joint", *(column.heading for column in _COLUMNS)], joints, label="joints"),
        "What this means for a controller": "".join(
            f"<h3>{page.text(part.heading)}</h3>{page.bullets(part.sentences)}"
            for part in _what_follows(facts)
        ),
    }
    kind = kind if judged.outcome == "holds" else judged.page_class
    verdict = f"<p class={kind}>{page.text(judged.line)}</p>"
    # Of the file its name alone: a page is passed on.
    shown = {**facts, "source": Path(facts["source"]).name}
    first = [
        re.sub(r" \(--explain prints [^)]*\)", " (listed below)", text)
        for text in _what_it_is(shown, explain=False)
    ]
    if values := _assumptions(facts):
        sections["Values that the URDF does not contain"] = page.bullets(values)
    return page.document(facts["name"], verdict + page.bullets(first), sections)


def _assumptions(facts: Mapping[str, Any]) -> list[str]:
    """Return which product the arm is, and which values of its drives are published or assumed."""
    return [printable(facts[key]) for key in ("product", "published", "rotors", "gears") if facts[key]]


def _joint_table(joints: list[dict[str, Any]], columns: Sequence[_Column], longest: int | None = None) -> Any:
    """Return a table of joints with some columns, their names folded to a length."""
    from rich.table import Table

    table = Table()
    least = min(_FOLDED, max(len(printable(joint["name"])) for joint in joints))
    table.add_column("joint", overflow="fold", min_width=least, max_width=longest)
    for column in columns:
        table.add_column(column.heading, justify="right", no_wrap=True)
    for joint in joints:
        table.add_row(printable(joint["name"]), *(column.text(joint) for column in columns))
    return table


def _count_findings(findings: Sequence[Finding]) -> str:
    """Return how many findings there are."""
    levels = [finding.level for finding in findings]
    counts = [(levels.count(level), level) for level in ("error", "warning", "info")]
    return ", ".join(f"{count} {level}{'s' * (count != 1)}" for count, level in counts)


def _option(finding: Finding) -> str:
    """Return the options that apply what a finding proposes; empty when none does."""
    return " or ".join(map(as_option, finding.remedies))


def _number(value: float) -> str:
    """Return a number in three digits; a dash where there is none."""
    return f"{value:.3g}" if math.isfinite(value) else "-"


class _Column(NamedTuple):
    """A column of the table of joints: its heading, and what it says of one."""

    heading: str
    text: Callable[[dict[str, Any]], str]


def _value(key: str) -> Callable[[dict[str, Any]], str]:
    """Return what shows one number of a joint."""
    return lambda joint: _number(joint[key])


def _range(low: str, high: str) -> Callable[[dict[str, Any]], str]:
    """Return what shows a range of a joint."""
    return lambda joint: f"{_number(joint[low])}..{_number(joint[high])}"


def _position(joint: dict[str, Any]) -> str:
    """Return the range of a joint's positions."""
    return "-" if joint["type"] == "continuous" else _range("lower", "upper")(joint)


_COLUMNS = (
    _Column("type", lambda joint: str(joint["type"])),
    _Column("position\nrad, m", _position),
    _Column("speed\nrad/s, m/s", _value("velocity")),
    _Column("effort\nN m, N", _value("effort")),
    _Column("to hold\nN m, N", lambda joint: _number(round(joint["holding"], 9))),
    _Column("inertia\nkg m², kg", _range("inertia_least", "inertia_most")),
    _Column("damping\nN m s, N s/m", _value("damping")),
    _Column("ω_c by\nencoder", _value("omega_encoder")),
)
#: How many of them are limits: the first part of a table that is too wide.
_LIMITS = 5
