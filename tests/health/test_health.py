"""The health report: one thing wrong in a good file gives that finding, at that place, and no other."""

from __future__ import annotations

import json
import math
import re
import runpy
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sampling import for_search

from armgpi import (
    GPI,
    Bezier,
    FixedGains,
    RigidBodyPlant,
    Robot,
    default_omega,
    health,
    robots,
    simulate,
)
from armgpi.cli.parsing import as_option
from armgpi.errors import ArmgpiError, NameNotFound, ParameterError, Remedy, UrdfError
from armgpi.health import findings
from armgpi.health.findings import Finding
from armgpi.robot import rotors, urdf
from armgpi.robot.meshes import MeshFinder

BODY = (
    '<inertial><origin xyz="0.1 0 0" rpy="0 0 0"/><mass value="1.0"/>'
    '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>'
)
ELBOW = (
    '<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/>'
    '<origin xyz="0.2 0 0" rpy="0 0 0"/><axis xyz="0 1 0"/>'
    '<limit lower="-1.5" upper="2.5" effort="20" velocity="3"/></joint>'
)
GOOD = f"""<robot name="arm">
<link name="base"/><link name="upper">{BODY}</link><link name="fore">{BODY}</link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
<limit effort="30" velocity="3"/></joint>
{ELBOW}
</robot>
"""
TOOL = (
    '<link name="tool">{}</link>'
    '<joint name="weld" type="fixed"><parent link="fore"/><child link="tool"/></joint>'
)
SHAPE = "<visual><geometry>{}</geometry></visual>"


def changed(old: str, new: str) -> str:
    """Return the good URDF with the last place where the old text stands changed."""
    head, found, tail = GOOD.rpartition(old)
    assert found, old
    return head + new + tail


@pytest.fixture
def report(tmp_path: Path) -> Any:
    def inspect(text: str, **options: Any) -> health.HealthReport:
        path = tmp_path / "arm.urdf"
        path.write_text(text, encoding="utf-8")
        return health.inspect(path, **options)

    return inspect


def serious(found: health.HealthReport) -> list[Finding]:
    return [finding for finding in found.findings if finding.level != "info"]


def test_a_good_arm_has_nothing_serious_and_states_what_it_is(report: Any) -> None:
    found = report(GOOD)
    assert not serious(found)
    assert not found.has_errors
    facts = found.facts
    assert (facts["n"], facts["base"], facts["tip"]) == (2, "base", "fore")
    assert facts["moving_mass"] == facts["total_mass"] == 2.0
    # The shoulder is upright; the elbow holds 1 kg at 0.1 m.
    holding = [joint["holding"] for joint in facts["joints"]]
    np.testing.assert_allclose(holding, [0.0, 9.81 * 0.1], atol=1e-3)
    # D_22 = I + m r^2, wherever the arm is.
    elbow = facts["joints"][1]
    assert elbow["inertia_least"] == pytest.approx(0.01 + 0.1**2, rel=1e-12)
    assert elbow["inertia_most"] == pytest.approx(0.01 + 0.1**2, rel=1e-12)
    assert facts["reach"] == pytest.approx(0.2, rel=1e-12)  # the tip is the elbow's own frame


def options(finding: Finding) -> str:
    """Return the options that the command line would print."""
    return " or ".join(map(as_option, finding.remedies))


WARNED = [  # kind, level, place, what stands there, what to write instead
    ("triangle", "warning", "link 'fore'", 'ixx="0.01"', 'ixx="0.1"'),
    ("axis", "warning", "joint 'elbow'", 'xyz="0 1 0"', 'xyz="0 3 4"'),
    ("axis", "warning", "joint 'elbow'", 'xyz="0 1 0"', 'xyz="0 1e-9 0"'),
    ("degrees", "warning", "joint 'elbow'", 'lower="-1.5" upper="2.5"', 'lower="-90" upper="90"'),
    ("degrees", "warning", "joint 'elbow'", 'rpy="0 0 0"/><axis', 'rpy="90 0 0"/><axis'),
    ("degrees", "warning", "link 'fore'", 'rpy="0 0 0"/><mass', 'rpy="0 0 180"/><mass'),
    ("limits", "warning", "joint 'elbow'", 'lower="-1.5" upper="2.5"', 'lower="-1e5" upper="1e5"'),
    ("limits", "warning", "joint 'elbow'", 'lower="-1.5" upper="2.5"', ""),
    ("limits", "warning", "joint 'elbow'", 'lower="-1.5" upper="2.5"', 'lower="0.5" upper="0.5"'),
    ("velocity", "warning", "joint 'elbow'", 'velocity="3"', 'velocity="180"'),
    ("velocity", "warning", "joint 'elbow'", 'velocity="3"', 'velocity="0"'),
    ("effort", "error", "joint 'elbow'", 'effort="20"', 'effort="0"'),
    ("effort", "warning", "joint 'elbow'", 'effort="20"', 'effort="1e30"'),
    ("gravity", "warning", "joint 'elbow'", 'effort="20"', 'effort="0.95"'),
    ("gravity", "error", "joint 'elbow'", 'effort="20"', 'effort="0.5"'),
    ("length", "warning", "joint 'elbow'", 'xyz="0.2 0 0"', 'xyz="200 0 0"'),
    ("length", "warning", "link 'fore'", 'xyz="0.1 0 0"', 'xyz="100 0 0"'),
    ("mass", "warning", "link 'fore'", 'value="1.0"', 'value="1e9"'),
    ("mass", "warning", "joint 'elbow'", 'value="1.0"', 'value="1e-5"'),
    ("inertia", "warning", "link 'fore'", 'ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"',
     'ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"'),
    ("inertia", "warning", "link 'fore'", 'ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"',
     'ixx="100" ixy="0" ixz="0" iyy="100" iyz="0" izz="100"'),
    ("twice", "warning", "link 'fore'", BODY, BODY + BODY),
    ("unknown", "warning", "joint 'elbow'", "<axis", '<limits lower="0"/><axis'),
    ("mesh", "warning", "link 'fore'", BODY, BODY + SHAPE.format('<mesh filename="x.stl"/>')),
    ("shape", "warning", "link 'fore'", BODY, BODY + SHAPE.format('<box size="big"/>')),
    ("shape", "warning", "link 'fore'", BODY, BODY + SHAPE.format('<sphere radius="-1"/>')),
    ("shape", "warning", "link 'fore'", BODY, BODY + SHAPE.format('<cone radius="1"/>')),
    ("shape", "warning", "link 'fore'", BODY, BODY + SHAPE.format("")),
    ("shape", "warning", "link 'fore'", BODY, BODY + SHAPE.format('<cylinder radius="1"/>')),
    ("shape", "warning", "link 'fore'", BODY, BODY + "<collision/>"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "level", "where", "old", "new"), WARNED, ids=[f"{row[0]}: {row[4][:40]}" for row in WARNED]
)
def test_a_thing_that_will_bite_is_found_where_it_is(
    report: Any, kind: str, level: str, where: str, old: str, new: str
) -> None:
    found = report(changed(old, new))
    hits = [f for f in serious(found) if f.kind == kind]
    assert [(f.level, f.where) for f in hits] == [(level, where)]
    assert found.has_errors == any(f.level == "error" for f in serious(found))
    (hit,) = hits
    assert hit.repair or hit.remedies
    assert where in str(hit)


def test_our_own_arms_second_link_is_one_that_no_body_has() -> None:
    # FINDINGS: diag(0.0013, 0.0054, 0.0013), as the paper has it.
    (hit,) = serious(health.inspect("anthropomorphic3"))
    assert (hit.kind, hit.where) == ("triangle", "link 'link2'")
    assert hit.value == pytest.approx(0.0054)
    assert hit.bound == pytest.approx(0.0026)


def test_an_inertia_that_nothing_feels_is_a_note(report: Any) -> None:
    base = BODY.replace('ixy="0"', 'ixy="0.5"')
    found = report(GOOD.replace('<link name="base"/>', f'<link name="base">{base}</link>'))
    assert not serious(found)
    assert [f.where for f in found.findings if f.kind == "inertia"] == ["link 'base'"]
    # Behind a locked joint it is felt by the others still.
    tool = TOOL.format(base)
    with pytest.raises(UrdfError, match="link 'tool' has an inertia that is not positive"):
        report(GOOD.replace("</robot>", f"{tool}</robot>"), lock=["elbow"])


def test_frames_and_a_joint_named_like_a_link_are_notes(report: Any) -> None:
    found = report(GOOD.replace("</robot>", f"{TOOL.format('')}</robot>").replace('"weld"', '"tool"'))
    assert not serious(found)
    notes = {f.kind: f for f in found.findings}
    assert notes["frames"].value == 2
    assert notes["names"].where == "joint 'tool'"


def test_effort_given_takes_the_place_of_the_files(report: Any) -> None:
    text = changed('effort="20"', 'effort="0"')
    assert report(text).has_errors
    assert not serious(report(text, effort={"elbow": 20.0}))
    with pytest.raises(NameNotFound, match="did you mean 'elbow'"):
        report(text, effort={"elbw": 20.0})


def test_a_mimic_and_the_way_out_are_found(report: Any) -> None:
    text = changed("<limit lower", '<mimic joint="shoulder" multiplier="-2" offset="0.1"/><limit lower')
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the finding says what the warning would
        (hit,) = serious(report(text))
        assert (hit.kind, hit.value, options(hit)) == ("mimic", 0.1, "--mimic follow")
        with pytest.raises(UrdfError, match="no moving joint left"):  # so that is not proposed
            report(text, lock=["shoulder"])
        assert not serious(report(text, mimic="follow"))


def test_a_floating_base_that_is_locked_is_a_note(report: Any) -> None:
    text = GOOD.replace(
        "</robot>",
        '<link name="world"/><joint name="root" type="floating"><parent link="world"/><child link="base"/>'
        "</joint></robot>",
    )
    with pytest.raises(UrdfError, match="joint 'root' is floating") as caught:
        report(text)
    assert caught.value.remedies == (Remedy("lock", ("root",)),)
    found = report(text, lock=["root"])
    assert not serious(found)
    assert [f.where for f in found.findings if f.kind == "type"] == ["joint 'root'"]


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        # Wrists of 0.19 kg with 0.22 kg m^2, their centres of mass beside their meshes.
        ("ur5", {"shape-mass"}),
        # One inertial for fingers and their tips.
        ("kinova", {"shape-mass"}),
        # Identified inertias, of which the base alone is determined: link 1 has 0.38 m of gyration.
        ("panda", {"mimic", "gripper", "shape-mass"}),
        ("so100", {"gripper"}),
        ("xarm7", set()),  # its damping is too strong without rotors alone: see below
        ("double_pendulum", {"effort", "limits", "velocity"}),
        # One inertial for the two parts of the force sensor.
        ("talos_left_arm", {"gripper", "gravity", "friction", "shape-mass"}),
        # Finger tips of 1 kg m^2, a gripper's base of 1e-7 kg m^2.
        ("baxter_left_arm", {"gravity", "shape-mass"}),
    ],
)
def test_what_is_known_of_the_arms_of_example_robot_data_is_found(name: str, kinds: set[str]) -> None:
    found = health.inspect(name)
    assert {f.kind for f in serious(found)} == kinds
    assert found.has_errors == ("effort" in kinds)


def test_strong_damping_is_found_of_the_arm_that_is_run() -> None:
    """xArm7's damping over D(q): 14628 1/s without rotors (docs/theory.md), 26 1/s with the assumed ones."""
    known = {each.kind for each in serious(health.inspect("xarm7"))}
    bare = {each.kind for each in serious(health.inspect("xarm7", drives="none"))}
    assert "friction" not in known
    assert "friction" in bare


@pytest.mark.parametrize("name", ["panda", "kinova"])
def test_zero_outside_the_limits_is_found(name: str) -> None:
    found = health.inspect(name)
    robot = Robot.load(name, lock=list(found.robot.provenance["locked"]))
    outside = [
        f"joint {j!r}" for j, a, b in zip(robot.joint_names, *robot.limits[:2], strict=True) if a * b > 0
    ]
    assert outside
    assert [f.where for f in found.findings if f.kind == "neutral"] == outside


def test_many_findings_of_a_kind_are_counted(report: Any) -> None:
    meshes = "".join(f'<visual><geometry><mesh filename="{i}.stl"/></geometry></visual>' for i in range(20))
    found = report(changed(BODY, BODY + meshes))
    assert len([f for f in found.findings if f.kind == "mesh"]) == 20
    hits = [f for f in findings.fold(found.findings) if f.kind == "mesh"]
    assert len(hits) == 6
    assert hits[-1].message == "15 more of this kind"


def test_the_report_is_plain_data_the_worst_first() -> None:
    found = health.inspect("double_pendulum")
    levels = [health.LEVELS.index(f.level) for f in found.findings]
    assert levels == sorted(levels)
    data = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert data["n"] == 2
    assert set(data["findings"][0]) == set(Finding._fields)


def test_the_bandwidth_of_an_encoder_is_where_a_count_costs_a_share_of_the_torque(report: Any) -> None:
    found = report(GOOD, encoder_bits=12, drives="none")
    elbow = found.facts["joints"][1]
    omega = elbow["omega_encoder"]
    # A controller whose measurement jumps by one count there: its torque jumps by 1 % of the limit.
    robot = Robot.from_xml(GOOD)
    gpi = GPI(robot, dt=1e-6, gains=FixedGains(omega))
    beta3 = 10.0 * omega**2  # (s + w)^5 = s^5 + 5 w s^4 + 10 w^2 s^3 + ...
    assert gpi.gains.nominal().omega_c[1] == omega
    jump = elbow["inertia_most"] * beta3 * 2.0 * math.pi / 2**12
    assert jump == pytest.approx(0.01 * 20.0, rel=1e-12)


@pytest.mark.parametrize(
    "bad",
    [
        {"dt": 0.0},
        {"delay": -1},
        {"encoder_bits": 0},
        {"mimic": "free"},
        {"lock": 5},
        {"encoder_side": "gear"},
    ],
)
def test_bad_arguments_are_refused(bad: dict[str, Any]) -> None:
    with pytest.raises(ArmgpiError):
        health.inspect("ur5", **bad)


def test_the_side_of_the_encoders_gives_the_controller_that_the_arms_drives_would() -> None:
    joints = Robot.load("ur5").joint_names
    for side in ("motor", "link"):
        found = health.inspect("ur5", delay=1, encoder_side=side)
        specified = health.inspect("ur5", delay=1, drives={each: {"encoder_side": side} for each in joints})
        assert found.facts["gpi_auto"] == specified.facts["gpi_auto"]
    open_ = health.inspect("ur5", delay=1, drives={each: {"encoder_side": "motor"} for each in joints[1:]})
    assert open_.facts["gpi_auto"]["omega_c"] != found.facts["gpi_auto"]["omega_c"]
    # What the drives specify of a joint stays; where that leaves nothing to say it is refused.
    filled = health.inspect(
        "ur5", delay=1, encoder_side="motor", drives={each: {"encoder_side": "motor"} for each in joints[1:]}
    )
    assert filled.facts["gpi_auto"] == health.inspect("ur5", delay=1, encoder_side="motor").facts["gpi_auto"]
    with pytest.raises(ParameterError, match="'link', as the drives of joint 'shoulder_pan_joint' specify"):
        health.inspect(
            "ur5", encoder_side="motor", drives={each: {"encoder_side": "link"} for each in joints}
        )


PENDULUM = """<robot name="pendulum"><link name="base"/><link name="rod"><inertial>
<origin xyz="0 0 LENGTH"/><mass value="1"/>
<inertia ixx="1e-9" ixy="0" ixz="0" iyy="1e-9" iyz="0" izz="1e-9"/></inertial></link>
<joint name="j" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint>
</robot>"""


@pytest.mark.parametrize(("share", "falls"), [(0.95, False), (1.15, True)])
def test_an_upright_arm_is_said_to_fall_as_it_does(share: float, falls: bool, report: Any) -> None:
    length = 9.81 / (share * 16.0 / 15.0 * 30.0**2)  # the limit of the Routh criterion, where share is 1
    found = report(PENDULUM.replace("LENGTH", str(length)))
    kinds = [(f.level, f.where, options(f)) for f in found.findings if f.kind == "gravity-unstable"]
    omega = math.ceil(1.05 * 30.0 * math.sqrt(share))
    assert kinds == ([("warning", "joint 'j'", f"--controller gpi --omega {omega}")] if falls else [])
    for omega_c, stays in ((30.0, not falls), (float(omega), True)):
        controller = GPI(found.robot, 1e-3, FixedGains(omega_c))
        plant = RigidBodyPlant(found.robot)
        rollout = simulate(plant, controller, Bezier([0.0], [0.02], 1.0), t_final=8.0, progress=False)
        late = rollout.sel(time=slice(6.0, None))
        error = float(np.abs(late["q"] - late["q_ref"]).max())
        assert error < 1e-3 if stays else error > 0.1


def test_a_joint_locked_outside_its_limits_is_found(report: Any) -> None:
    (finding,) = (f for f in report(GOOD, lock={"elbow": 99.0}).findings if f.kind == "limits")
    assert (finding.level, finding.value, finding.bound, options(finding)) == (
        "warning",
        99.0,
        2.5,
        "--lock elbow=0",
    )


def test_a_follower_locked_at_the_end_of_its_limits_is_within_them(report: Any) -> None:
    text = changed("<limit lower", '<mimic joint="shoulder" multiplier="-2" offset="0.1"/><limit lower')

    def outside(value: float) -> list[Any]:
        found = report(text, lock={"elbow": value}).findings
        return [f for f in found if f.kind == "mimic" and "outside its limits" in f.message]

    assert not outside(2.5)
    assert not outside(-1.5)
    assert outside(2.5 + 1e-6)
    assert outside(-1.5 - 1e-6)


# --- The registry of checks ----------------------------------------------------------------------


def test_the_docs_list_the_checks_there_are() -> None:
    docs = Path(__file__).parents[2] / "docs"
    table = runpy.run_path(str(docs / "conf.py"))["myst_substitutions"]["findings_table"]
    assert "\n{{ findings_table }}\n" in (docs / "robots.md").read_text(encoding="utf-8")
    assert table == findings.table()
    assert {f"| `{each.kind}` |" for each in findings.CHECKS} <= set(
        re.findall(r"(?m)^\| `[\w-]+` \|", table)
    )


def test_every_mesh_of_example_robot_data_is_there() -> None:
    for name in robots.names():
        path, _ = robots.locate(name)
        document, finder = urdf.parse(urdf.read_file(path), str(path)), MeshFinder(path)
        for link in document.links.values():
            assert all(finder.find(mesh).path for mesh in link.meshes), name


@pytest.mark.parametrize("every", [9, for_search(1)])
def test_every_check_of_every_row_gives_its_levels_alone(every: int) -> None:
    levels = {kind: {level for row in findings.CHECKS if row.kind == kind for level in row.levels}
              for kind in {row.kind for row in findings.CHECKS}}  # fmt: skip
    for name in robots.names()[::every]:
        found = health.with_payload(health.inspect(name), 50.0).findings
        assert all(finding.level in levels[finding.kind] for finding in found), name
        # A Python user has no options; the command line makes them of the remedies.
        assert not any("--" in str(finding) for finding in found), name
    for kind, level, _, _, _ in WARNED:
        assert level in levels[kind]


def test_a_new_check_is_one_function(report: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(findings, "CHECKS", list(findings.CHECKS))

    @health.check("reach", "an arm longer than 10 cm", "warning")
    def too_long(subject: findings.Subject) -> Iterator[Finding]:
        if subject.reach > 0.1:
            yield Finding("warning", "robot", f"reaches {subject.reach:g} m", subject.reach, 0.1)

    found = report(GOOD)
    (hit,) = serious(found)
    assert hit.kind == "reach"
    assert hit.value == pytest.approx(0.2)
    assert "reach" in {each["kind"] for each in found.as_dict()["findings"]}
    assert "| `reach` | warning | an arm longer than 10 cm |" in findings.table()


@pytest.mark.parametrize("drives", ["stiff", "none"])
def test_a_likely_load_that_endangers_the_loop_is_said(drives: str) -> None:
    told = False
    for name, lock in (("panda", ["panda_finger_joint1"]), ("panda", ()), ("ur5", ())):
        report = health.with_payload(health.inspect(name, lock=lock, drives=drives), 0.0)
        robot = rotors.assume_rotors(report.robot)
        load = 0.05 * sum(body.mass for body in robot.pinocchio_model().inertias[1:])  # of what moves
        sides = 0.05 * np.eye(3)  # beside the tip, where the last joint feels it most
        middle = robot.middle()
        side = max(sides, key=lambda com: robot.with_payload(robot.tip, 1.0, com).mass_matrix(middle)[-1, -1])
        # The least eigenvalue of D^-1 D-hat at random configurations, which the search undercuts.
        empty, loaded = (
            arm.mass_matrix(robot.random_positions(200))
            for arm in (robot, robot.with_payload(robot.tip, load, side))
        )
        sampled = float(np.linalg.eigvals(np.linalg.solve(loaded, empty)).real.min())
        said = [f for f in report.findings if f.kind == "payload" and "5 %" in f.message]
        delta = float(said[0].value) if said else 0.5
        assert bool(said) >= (sampled < 0.5)
        assert delta <= max(sampled, 0.5) + 1e-9
        assert all(f.level == ("warning" if delta < 0.36 else "info") for f in said)
        told |= bool(said)
    assert told == (drives == "none")  # typical rotors carry such a load


def test_a_slow_default_bandwidth_and_missing_rotors_are_said() -> None:
    slow = {f.kind: f for f in health.inspect("ur5", dt=4e-3, delay=2).findings}
    assert (slow["bandwidth"].level, slow["bandwidth"].value) == ("warning", default_omega(4e-3, 8e-3))
    assert "bandwidth" not in {f.kind for f in health.inspect("ur5").findings}
    ((kind, _, proposed),) = slow["armature"].remedies
    assert kind == "rotor_inertia"
    values = dict(part.split("=") for part in str(proposed).split(","))
    told = health.inspect("ur5", rotor_inertia={name: float(value) for name, value in values.items()})
    assert "armature" not in {f.kind for f in told.findings}


def test_no_controller_is_worked_out_only_to_describe_a_whole_body(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("armgpi.health.report.MOST_TUNED", 5)
    monkeypatch.setattr(GPI, "auto", lambda *_, **__: pytest.fail("a controller is worked out"))
    found = health.inspect("ur5")
    assert found.facts["gpi_auto"] is None
    assert health.with_payload(found, 0.5).facts["payload"]["mass"] == 0.5


def test_the_repairs_of_a_file_without_masses_are_proposed_at_once(tmp_path: Path) -> None:
    """Inertias without mass are dropped, then masses assumed: the one proposal has both, and loads."""
    text = robots.locate("anthropomorphic3")[0].read_text(encoding="utf-8")
    path = tmp_path / "arm.urdf"
    path.write_text(re.sub(r'<mass value="[^"]*"', '<mass value="0"', text), encoding="utf-8")
    for repair in ("", "assume-bodies"):
        with pytest.raises(UrdfError) as refused:
            health.inspect(path, repair=repair)
        [proposed] = [str(each.value) for each in refused.value.remedies if each.kind == "repair"][-1:]
        assert "drop-inertia:link1" in proposed
        assert "assume-bodies" in proposed
        report = health.inspect(path, repair=proposed)
        assert np.isfinite(report.robot.mass_matrix(report.robot.middle())).all()
