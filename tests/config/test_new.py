"""`armgpi new` writes one file that every command takes; whole robots are told, kept by a chain's name."""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
from commands import Answer

import armgpi
from armgpi import ArmgpiWarning, Robot, config, robots
from armgpi.cli import pictures
from armgpi.health import checks_urdf
from armgpi.identification import arm as identification
from armgpi.robot import chains, urdf
from armgpi.studies import study
from armgpi.tuning.rule import Untuned

#: Command -> how it is called with the file.
TAKERS = {
    "run": ("run", "{}"),
    "compare": ("compare", "{}"),
    "sweep": ("sweep", "{}", "--rollouts", 4, "--out", "swept"),
    "tune": ("tune", "{}", "--out", "tuned", "--evaluations", 2),
    "play": ("play", "{}", "-o", "page.html"),
    # What of the file a certificate leaves out is accepted.
    "certify": ("certify", "{}", "--box", "box.yaml", "--allow-part"),
    "excite": ("excite", "{}", "--seconds", 4, "--first", "-o", "excited"),
    "identify": ("identify", "log.csv", "--robot", "{}"),
    "export": ("export", "{}", "-o", "exported"),
    "inspect": ("inspect", "{}"),
    "bringup": ("bringup", "{}"),
    "bound": ("bound", "{}"),
}


def humanoid(name: str = "talos_reduced") -> Path:
    folder = robots.example_folder()
    if folder is None:
        pytest.skip("example-robot-data is not installed")
    return next(folder.rglob(f"{name}.urdf"))


@pytest.fixture
def file(cli: Callable[..., Answer], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of an arm in a folder of its own, in which the commands are called."""
    path, _ = robots.locate("anthropomorphic3")
    (tmp_path / "my_arm.urdf").write_bytes(path.read_bytes())
    monkeypatch.chdir(tmp_path)
    answer = cli("new", "my_arm.urdf", "--payload", 0.1)
    assert answer.code == 0, answer.err
    return tmp_path / "my_arm.yaml"


@pytest.mark.parametrize("command", TAKERS)
def test_every_command_takes_the_file_as_it_is(
    command: str, file: Path, cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = file.read_bytes()
    (file.parent / "box.yaml").write_text("by: 0.1", encoding="utf-8")
    if command == "identify":  # what it does with logs is tested elsewhere
        monkeypatch.setattr(identification, "identify", lambda logs, arm, **_: sys.exit(arm.n != 3))
    if command == "play":  # what it compiles is tested elsewhere
        monkeypatch.setattr(pictures, "page_to_play_with", lambda experiment, frame: experiment.robot.name)
    if command == "tune":
        file.write_text(
            file.read_text(encoding="utf-8") + "tune: {scenarios: 2, held_out: 2}\n", encoding="utf-8"
        )
    monkeypatch.chdir(file.parent)
    answer = cli(*(str(word).format(file.name) for word in TAKERS[command]))
    assert answer.code == 0 or (command == "bound" and "No bound" in answer.out), answer.err
    assert command == "tune" or file.read_bytes() == before


def test_a_study_has_the_law_and_the_plant_of_its_file(file: Path, tmp_path: Path) -> None:
    given, origin = config.read(file)
    identity = study.identify(given, {})
    (tmp_path / "copy.yaml").write_text(identity.text, encoding="utf-8")
    for name, content in identity.copies.items():
        (tmp_path / name).write_bytes(content)
    copied, here = (
        config.build(*config.read(tmp_path / "copy.yaml")).config,
        config.build(given, origin).config,
    )
    assert copied.controllers == here.controllers
    assert copied.plant == here.plant


def test_what_a_file_says_in_full_is_not_chosen_again(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full = config.build(*config.read(file))
    again, _ = config.parse(config.dump(full.config), str(file))
    monkeypatch.setattr(Untuned, "chosen", lambda _: pytest.fail("chosen again"))
    assert config.build(again).config.controllers == full.config.controllers


def test_what_is_not_specified_is_assumed_and_marked_so(file: Path, cli: Callable[..., Answer]) -> None:
    lines = {line.split(":")[0].strip(): line for line in file.read_text(encoding="utf-8").splitlines()}
    assert "assumed" in lines["encoder_bits"]
    assert "assumed" not in lines["payload"]
    again = cli("new", "my_arm.urdf")
    assert again.code == 2
    assert "my_arm.yaml exists; choose another file, or add --force" in again.err


@pytest.mark.parametrize(("target", "late"), [("bare", 1), ("fci", 1), ("ur", 2)])
def test_measurements_are_believed_as_late_as_the_target_has_them(
    target: str, late: int, cli: Callable[..., Answer], tmp_path: Path
) -> None:
    path = tmp_path / "arm.yaml"
    assert cli("new", "ur5", "--target", target, "-o", str(path)).code == 0
    assert f"  delay: {late}  #" in path.read_text(encoding="utf-8")


def test_a_whole_robot_is_told_by_inspect_and_run_and_kept_by_the_name_of_a_chain() -> None:
    path = humanoid()
    found = chains.find(urdf.parse(urdf.read_file(path), str(path)))
    names = [chain.name for chain in found]
    assert names == ["head", "left_arm", "right_arm", "left_leg", "right_leg"]
    joints = [joint for chain in found for joint in chain.joints]
    assert len(set(joints)) == len(joints)  # of no joint are there two
    (finding,) = checks_urdf.whole(SimpleNamespace(robot=Robot.load(path)))
    assert "5 chains: head (2), left_arm (7)" in finding.message
    with pytest.warns(ArmgpiWarning, match=r"5 chains.*--keep left_arm"):
        config.robot(config.ExperimentConfig(robot={"name": str(path)}))
    with warnings.catch_warnings():
        warnings.simplefilter("error", ArmgpiWarning)
        arm = config.robot(config.ExperimentConfig(robot={"name": str(path), "keep": ["left_arm"]}))
    assert arm.joint_names == found[1].joints
    assert arm.joint_names == Robot.load(path, keep=found[1].joints).joint_names
    assert not chains.of(arm.provenance)


#: Whole robots; the last two no command loads.
WHOLE = ("talos_reduced", "icub", "tiago_dual")


@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=() if x == "icub" else pytest.mark.search) for x in WHOLE]
)
def test_the_file_of_a_whole_robot_keeps_one_arm(
    name: str, cli: Callable[..., Answer], tmp_path: Path
) -> None:
    answer = cli("new", humanoid(name), "-o", tmp_path / "arm.yaml")
    assert answer.code == 0, answer.err
    assert "the file keeps left_arm" in answer.err
    assert "keep: [left_arm]" in (tmp_path / "arm.yaml").read_text(encoding="utf-8")


@pytest.mark.usefixtures("file")
def test_no_payload_is_invented(cli: Callable[..., Answer], tmp_path: Path) -> None:
    assert cli("new", "my_arm.urdf", "-o", "bare.yaml").code == 0
    assert config.read(tmp_path / "bare.yaml").config.plant.payload is None


def test_assumed_drives_are_keys_with_their_intervals_and_a_sweep_draws_them(
    cli: Callable[..., Answer], tmp_path: Path
) -> None:
    path = tmp_path / "arm.yaml"
    assert cli("new", "ur5", "-o", path).code == 0
    found = config.read(path).config
    assumed = armgpi.assume_drives(Robot.load("ur5"))
    for joint, rotor in zip(assumed.joint_names, assumed.armature, strict=True):
        datum = found.robot.drives[joint]["rotor_inertia"]
        assert datum["source"] == "assumed"
        assert datum["value"] == pytest.approx(rotor, rel=5e-3)
        assert datum["high"] / datum["value"] == pytest.approx(2.5, rel=1e-2)
    assert [*found.vary] == ["plant.rotor_inertia", "plant.gear_stiffness"]
    assert found.vary["plant.rotor_inertia"].factor == 2.5


def test_an_arm_without_effort_limits_gets_blanks_and_runs_when_they_are_filled(
    cli: Callable[..., Answer], tmp_path: Path
) -> None:
    urdf = robots.locate("anthropomorphic3")[0].read_text(encoding="utf-8")
    (tmp_path / "weak.urdf").write_text(re.sub('effort="[^"]*"', 'effort="0"', urdf), encoding="utf-8")
    answer = cli("new", tmp_path / "weak.urdf")
    assert answer.code == 3
    assert "fill in robot.effort of q1, q2, q3" in answer.out
    path = tmp_path / "weak.yaml"
    refused = cli("run", path)
    assert refused.code == 2
    assert "robot.effort.q1" in refused.err
    lines = path.read_text(encoding="utf-8").splitlines()
    filled = [line.partition("#")[0] + "30" if "gravity alone" in line else line for line in lines]
    path.write_text("\n".join(filled), encoding="utf-8")
    assert cli("run", path, "--t-final", 0.1).code == 0


def test_an_arm_without_masses_gets_blanks_and_runs_with_assumed_bodies_only_when_that_is_chosen(
    cli: Callable[..., Answer], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = robots.locate("anthropomorphic3")[0].read_text(encoding="utf-8")
    Path("bare.urdf").write_text(re.sub(r"<inertial>.*?</inertial>", "", text, flags=re.DOTALL))
    answer = cli("new", "bare.urdf")
    assert answer.code == 3
    assert answer.out.startswith("INCOMPLETE: fill in the mass of link1, link2, link3")
    written = Path("bare.yaml").read_text(encoding="utf-8")
    assert "drives:" not in written  # they would be of the assumed bodies
    assert cli("run", "bare.yaml").code == 2
    Path("bare.yaml").write_text(written.replace("  # repair:", "  repair:"), encoding="utf-8")
    done = cli("run", "bare.yaml", "--t-final", 0.1)
    assert done.code == 0
    assert "MASSES ASSUMED" in done.err
    assert cli("new", "bare.urdf", "--repair", "assume-bodies", "-o", "asked.yaml").code == 0


def test_a_sweep_of_stiff_joints_draws_no_stiffness(cli: Callable[..., Answer], tmp_path: Path) -> None:
    path = tmp_path / "stiff.yaml"
    assert cli("new", "ur5", "--drives", "stiff", "-o", path).code == 0
    assert [*config.read(path).config.vary] == ["plant.rotor_inertia"]
    config.build(*config.read(path))


def test_resolutions_that_differ_by_joint_are_written_for_each(
    cli: Callable[..., Answer], tmp_path: Path
) -> None:
    drives = tmp_path / "drives.yaml"
    drives.write_text("shoulder_pan_joint: {encoder_count: 4096}\n", encoding="utf-8")
    path = tmp_path / "arm.yaml"
    assert cli("new", "ur5", "--drives", drives, "-o", path).code == 0
    found = config.read(path).config
    bits = found.plant.encoder_bits
    assert bits["shoulder_pan_joint"] == 12  # 2^12 = 4096
    assert {bits[name] for name in Robot.load("ur5").joint_names[1:]} == {16}
    assert cli("run", path, "--t-final", 0.01).code == 0
