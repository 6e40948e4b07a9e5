"""The command `armgpi export`."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import Answer

import armgpi
from armgpi import config
from armgpi.codegen import build
from armgpi.errors import BackendError
from armgpi.loop import log as logs
from armgpi.robot.kinematics import random_configurations
from armgpi.tuning.two_mass import ArmLoop, Gears
from armgpi.tuning.two_mass import law as linear

pytest.importorskip("casadi", reason="casadi writes the C")
from armgpi.hardware.export import files

try:
    build.compiler()
    COMPILER = True
except BackendError:
    COMPILER = False

ARM = "anthropomorphic3"
#: Rotors [kg m^2] and stiffness [N m/rad] of typical size.
GEARS = {
    "panda": ([0.6, 0.6, 0.46, 0.46, 0.2, 0.2, 0.2], [14e3, 14e3, 14e3, 14e3, 8e3, 8e3, 8e3]),
    "ur5": ([1.2, 1.2, 0.8, 0.2, 0.2, 0.2], [20e3, 20e3, 15e3, 5e3, 5e3, 5e3]),
}
FILES = ("armgpi_controller.h", "armgpi_controller.c", "main.c", "log.armlog", "Makefile", "README.md")


@pytest.fixture
def export(cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Answer]:
    """Call `armgpi export` in this process; replays are timed for a moment."""
    monkeypatch.setattr(files, "_TIMING", 0.01)
    return partial(cli, "export")


@pytest.fixture
def without_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where there is no C compiler: for laws of what is written, not of the replay."""
    monkeypatch.setenv("CC", "no-such-compiler")


def test_a_folder_is_written_and_its_figures_are_told(export: Callable[..., Answer], tmp_path: Path) -> None:
    code, out, err = export(ARM, "--t-final", "0.2", "--encoder-bits", "16", "--delay", "2", "-o", tmp_path)
    assert code == 0, out + err
    (wrote,) = (line for line in err.splitlines() if line.startswith("wrote "))
    there = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert wrote == f"wrote {len(there)} files to {tmp_path}; {tmp_path / 'README.md'} explains them"
    assert set(FILES) <= {path.name for path in there}
    assert "584 bytes" in out  # as docs/export.md prints for the same arm and law
    readme = (tmp_path / "README.md").read_text()
    assert "`q3` | revolute" in readme
    assert "for 52 samples" in readme  # 50 ms, and the delay
    assert "$" not in readme
    log = logs.read(tmp_path / "log.armlog")
    assert log.header["joints"] == ["q1", "q2", "q3"]
    assert len(log.samples) == 200
    if COMPILER:
        assert "from Python" in out


def test_figures_come_as_json(export: Callable[..., Answer], tmp_path: Path) -> None:
    options = ("--controller", "pid", "--real", "float", "--on-fault", "zero", "--frozen", "0", "--jump", "0")
    code, out, _ = export(ARM, "--t-final", "0.1", *options, "--json", "-o", tmp_path)
    assert code == 0
    figures = json.loads(out)
    assert figures["controller"] == "pid"
    assert figures["real"] == "float"
    assert figures["samples"] == 100
    assert figures["agrees"] is (True if COMPILER else None)
    header = (tmp_path / "armgpi_controller.h").read_text()
    assert "typedef float armgpi_real_t;" in header
    never = [
        line.split("`")[1]
        for line in (tmp_path / "README.md").read_text().splitlines()
        if line.endswith(" is not checked here.")
    ]
    assert sorted(never) == ["CAP", "FROZEN", "JUMP", "SPEED", "TOOL_FORCE", "TOOL_SPEED", "WORKSPACE"]
    assert "v_measured" in header


@pytest.mark.usefixtures("without_compiler")
def test_an_experiment_file_defines_the_controller(export: Callable[..., Answer], tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(
        f"robot: {{name: {ARM}}}\n"
        "controllers:\n  - {type: network, label: mine, omega: {lower: 20, upper: 40}, rate: 2.0}\n"
        "sample_time: 0.002\nt_final: 0.2\n"
    )
    code, out, err = export("--config", tmp_path / "mine.yaml", "-o", tmp_path / "c")
    assert code == 0, out + err
    assert "#define ARMGPI_DT (0.002)" in (tmp_path / "c" / "armgpi_controller.h").read_text()
    assert "GAINS_OMEGA_C_1" in (tmp_path / "c" / "armgpi_controller.c").read_text()


@pytest.mark.usefixtures("without_compiler")
def test_without_a_compiler_the_folder_is_written_all_the_same(
    export: Callable[..., Answer], tmp_path: Path
) -> None:
    code, out, _ = export(ARM, "--t-final", "0.1", "-o", tmp_path)
    assert code == 0
    assert "there is no C compiler" in out
    assert "the log has a fault" not in out
    assert "not measured" in (tmp_path / "README.md").read_text()
    with pytest.raises(BackendError, match="no C compiler"):
        armgpi.ExportedController(armgpi.Robot.load(ARM), tmp_path)


@pytest.mark.skipif(not COMPILER, reason="there is no C compiler")
def test_a_controller_that_loses_the_arm_is_told(export: Callable[..., Answer], tmp_path: Path) -> None:
    upright = ("--from", "0,0.45,0", "--to", "0.5,0.95,0.5")  # from which it falls at once
    code, out, err = export(ARM, "--omega", "3000", "--t-final", "0.3", *upright, "-o", tmp_path)
    assert code == 1
    assert "too fast" in err
    assert "fault" in out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("-o", "new"), "name a robot"),
        (("pandas", "-o", "new"), "no robot named 'pandas'; did you mean 'panda'"),
        ((ARM, "-o", "file"), "file: cannot be written to"),
        ((ARM, "-o", "file/below"), "cannot be written to"),
        ((ARM, "-o", "new", "--real", "half"), "--real: must be one of double, float, got 'half'"),
        ((ARM, "-o", "new", "--on-fault", "stop"), "--on-fault: expected 'brake', 'hold' or 'zero'"),
        ((ARM, "-o", "new", "--frozen", "-1"), "--frozen: expected"),
        ((ARM, "-o", "new", "--jump", "nan"), "--jump: expected"),
        ((ARM, "-o", "new", "--effort", "0"), "effort limit 0"),
        ((ARM, "-o", "new", "--effort", "0.01"), "the torque that holds the arm"),
    ],
)
def test_bad_input_ends_in_one_line(
    arguments: tuple[str, ...],
    said: str,
    export: Callable[..., Answer],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    code, out, err = export(*arguments)
    assert code == 2
    assert out == ""
    assert err.startswith("error: ")
    assert said in err
    assert err.count("\n") == 1
    assert not (tmp_path / "new").exists()


@pytest.mark.usefixtures("without_compiler")
def test_a_name_of_its_own(export: Callable[..., Answer], tmp_path: Path) -> None:
    code, out, err = export(ARM, "--t-final", "0.05", "--name", "left_arm", "-o", tmp_path)
    assert code == 0, out + err
    assert (tmp_path / "left_arm.h").is_file()
    assert "left_arm_step(&state, q_measured, q_ref, tau)" in (tmp_path / "README.md").read_text()
    for name, said in (("left arm", "a C identifier"), ("law", "law_init is used in the C")):
        code, out, err = export(ARM, "--name", name, "-o", tmp_path / "other")
        assert (code, out) == (2, "")
        assert "--name" in err
        assert said in err
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize(("robot", "target"), [("panda", "fci"), ("ur5", "ur")])
@pytest.mark.usefixtures("without_compiler")
def test_the_default_for_a_geared_robot_holds_it(
    export: Callable[..., Answer], robot: str, target: str, tmp_path: Path
) -> None:
    """Gears of typical stiffness, encoders at the motors: stable; the law for stiff gears is not."""
    if robot not in armgpi.robots.names():
        pytest.skip("the robots extra is not installed")
    rotor, stiffness = GEARS[robot]
    grows = {}
    for name, options in (("default", ()), ("stiff", ("--drives", "stiff"))):
        code, out, err = export(
            robot, "--target", target, "--t-final", "0.1", "--explain", *options, "-o", tmp_path / name
        )
        assert code == 0, out + err
        assert ("the URDF contains no joint stiffness; assumed" in err) == (name == "default")
        # Fingers are not the arm's.
        assert ("of the gripper locked" in err) == (robot == "panda")
        assert f"ARMGPI_N ({len(rotor)}U)" in (tmp_path / name / "armgpi_controller.h").read_text()
        loaded = config.read(tmp_path / name / "experiment.yaml")
        law: Any = next(iter(config.build(loaded.config, loaded.origin).controllers.values()))
        gears = Gears(np.array(rotor), np.array(stiffness), 0.02, 500.0, "motor")
        arm = law.robot.with_armature(rotor)
        loops = (
            (ArmLoop(arm, q, gears, law.dt, 1), linear(law, q)) for q in random_configurations(arm, 3, seed=1)
        )
        grows[name] = max(loop.growth(own) for loop, own in loops)
    assert grows["default"] < 1.0 < grows["stiff"]


def test_a_geared_robot_without_rotors_is_refused_by_what_it_lacks(
    export: Callable[..., Answer], tmp_path: Path
) -> None:
    if "ur5" not in armgpi.robots.names():
        pytest.skip("the robots extra is not installed")
    for none in (("--rotor-inertia", "0"), ("--drives", "none"), ("--direct-drive",)):
        code, out, err = export("ur5", "--target", "ur", *none, "-o", tmp_path)
        assert code == 2, out
        assert "for a model with rotor inertia" in err
        assert "gear_stiffness" not in err
        assert all(way in " ".join(err.split()) for way in ("assumed", "--drives FILE", "armgpi identify"))


@pytest.mark.usefixtures("without_compiler")
def test_direct_drives_have_neither_rotors_nor_gears(export: Callable[..., Answer], tmp_path: Path) -> None:
    short = ("--t-final", "0.1", "-o", tmp_path)
    code, out, err = export("anthropomorphic3", "--controller", "gpi_auto", "--direct-drive", *short)
    assert code == 0, out + err
    assert "assumed [" not in err
    assert "drives: none" in (tmp_path / "experiment.yaml").read_text()
    code, out, err = export("anthropomorphic3", "--direct-drive", "--drives", "elastic", *short)
    assert code == 2
    assert "mutually exclusive" in err


@pytest.mark.usefixtures("without_compiler")
def test_another_law_for_a_geared_robot_is_told(export: Callable[..., Answer], tmp_path: Path) -> None:
    """What is asked for is what is written."""
    if "ur5" not in armgpi.robots.names():
        pytest.skip("the robots extra is not installed")
    code, out, err = export(
        "ur5", "--target", "ur", "--controller", "gpi", "--t-final", "0.1", "-o", tmp_path
    )
    assert code == 0, out + err
    assert "gears" not in err
    assert "type: gpi" in (tmp_path / "experiment.yaml").read_text()


def test_an_export_that_is_interrupted_leaves_no_empty_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Callable[..., Answer]
) -> None:
    def interrupted(*_: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr("armgpi.hardware.export.files.record", interrupted)
    for there in (False, True):
        out = tmp_path / f"export{there}"
        if there:
            out.mkdir()
        said = cli("export", "ur5", "--out", out)
        assert said.code == 130, said
        assert out.exists() == there
