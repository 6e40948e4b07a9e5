"""What is beside the exported C: package, wrappers, tests of faults, and glue for interfaces."""

from __future__ import annotations

import importlib
import json
import math
import re
import runpy
import shutil
import subprocess
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from commands import Answer, fork_script
from sampling import for_search
from scipy.spatial.transform import Rotation
from test_grippers import J, text

from armgpi import (
    GPI,
    CartesianImpedance,
    FixedGains,
    ForceLimited,
    Hold,
    JointImpedance,
    Measurement,
    PIDInversion,
    PIDPositions,
    RigidBodyPlant,
    Robot,
    Supervised,
    Supervisor,
    ToolForce,
    Waypoints,
    export_controller,
)
from armgpi.errors import ParameterError
from armgpi.loop import log as logs
from armgpi.references.following import SetpointInverse, Setpoints
from armgpi.robot.frames import Pose
from armgpi.robot.rotors import assume_rotors
from armgpi.supervisor import State

pytest.importorskip("casadi", reason="casadi writes the C")
from armgpi.hardware.export.fault_tests import fault_tests
from armgpi.hardware.export.files import _running, record
from armgpi.hardware.export.interfaces import table
from armgpi.hardware.export.names import rename
from armgpi.hardware.export.targets import follow_limits

compiled = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
ARM = Robot.load("anthropomorphic3")
ZERO = (0.0, 0.0, 0.0)
#: Writes a target's law to a folder; returns its robot and sample time.
Export = Callable[[str, Path], tuple[Robot, float]]
#: Of a move of that arm, and a program that prints it.
ENDS = [[0.1, 0.2, -0.3], [0.6, 0.7, -0.6]]
MOVE = """#include <math.h>
#include <stdio.h>
#include "armgpi_move.h"
int main(void)
{
    armgpi_move_t move;
    const armgpi_real_t from[3] = BEGIN;
    const armgpi_real_t to[3] = END;
    const armgpi_real_t bad[3] = {(armgpi_real_t)0, (armgpi_real_t)NAN, (armgpi_real_t)0};
    armgpi_real_t x[3][3];
    uint32_t moving = 1U;
    armgpi_move_hold(&move, from);
    if (armgpi_move_to(&move, bad, 1.0) + armgpi_move_to(&move, to, 0.0) != 0U) { return 1; }
    if (armgpi_move_to(&move, to, 1.0) == 0U || armgpi_move_to(&move, from, 1.0) != 0U) { return 2; }
    while (moving != 0U) {
        moving = armgpi_move_next(&move, 1U, x[0], x[1], x[2]);
        for (int k = 0; k < 9; ++k) { (void)printf("%.17g ", (double)x[k / 3][k % 3]); }
        (void)printf("\\n");
    }
    return 0;
}
"""
#: Declarations of public headers; tools/headers.py compares them with those.
STUBS = Path(__file__).parent / "stubs"
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
#: A motion of an arm whose reference is NaN after 0.1 s, and which creeps on for 0.2 s. libfranka keeps a
#: copy of the callback.
MOTION = """
#include <cmath>
#include <cstdio>
#include "fci.hpp"
int main() {
  franka::RobotState robot;
  robot.q = {%s};
  armgpi_controller::Vector start{};
  for (std::size_t i = 0; i < start.size(); ++i) start[i] = robot.q[i];
  const armgpi_controller::Fci mine([&](double t) {
    armgpi_controller::Reference r;
    r.q = start;
    if (t > 0.1) r.q[3] = NAN;
    return r;
  });
  armgpi_controller::Fci looker;
  for (unsigned k = 0; k < 20; ++k) {
    robot.time = franka::Duration{k};
    looker.look(robot);
  }
  if (looker->controller().status() != ARMGPI_STATUS_RUN) return 4;
  std::function<franka::Torques(const franka::RobotState&, franka::Duration)> callback = mine;
  for (std::uint64_t k = 0; k < 900; ++k) {
    if (k < 200) robot.q[0] += 2e-5;
    const franka::Torques torques = callback(robot, franka::Duration{k == 0 ? 0U : 1U});
    for (double tau : torques.tau_J) if (!(std::fabs(tau) <= 87.0)) return 1;
    const bool expected = mine->controller().reason() == ARMGPI_REASON_REFERENCE && k > 240;
    if (torques.motion_finished) return expected ? 0 : 2;
  }
  return 3;
}
"""


def panda() -> Robot:
    import armgpi

    if "panda" not in armgpi.robots.names():
        pytest.skip("the robots extra is not installed")
    robot = Robot.load("panda", lock=["panda_finger_joint1", "panda_finger_joint2"])
    return robot.with_gravity(ZERO)


def ur5() -> Robot:
    import armgpi

    if "ur5" not in armgpi.robots.names():
        pytest.skip("the robots extra is not installed")
    return Robot.load("ur5").with_gravity(ZERO)


def interface(target: str) -> tuple[Robot, float, Supervisor]:
    """Arm, sample time and supervisor of a target."""
    if target == "fci":
        return panda(), 1e-3, Supervisor(torque_rate=1000.0)
    return ur5(), 2e-3, Supervisor()


@pytest.fixture(scope="module")
def fixed_gains(tmp_path_factory: pytest.TempPathFactory) -> Export:
    """Write the law with fixed gains of a target to a folder; it is generated once."""
    folders: dict[str, Path] = {}

    def write(target: str, folder: Path) -> tuple[Robot, float]:
        robot, dt, supervisor = interface(target)
        if target not in folders:
            folders[target] = tmp_path_factory.mktemp(target)
            law = Supervised(GPI(robot, dt), supervisor)
            export_controller(law, folders[target], measure=False, target=target)
        shutil.copytree(folders[target], folder, dirs_exist_ok=True)
        return robot, dt

    return write


def with_jaw(joints: int) -> Robot:
    """An arm of so many joints whose gripper moves, without gravity."""
    return Robot.from_xml(text(J("jaw", "tip", "prismatic", travel=0.05), arm=joints)).with_gravity(ZERO)


def named(joint: str) -> Robot:
    """An arm of one joint."""
    return Robot.from_xml(text(J(joint, "base"), arm=0))


def need(program: str) -> str:
    """The path of a program, or a skipped test."""
    found = shutil.which(program)
    if found is None:
        pytest.skip(f"{program} is not installed")
    return found


def run(*command: object, folder: Path) -> str:
    done = subprocess.run([*map(str, command)], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def run_python(text: str, *arguments: object, folder: Path) -> str:
    done = fork_script(text, *arguments, folder=folder)
    assert done.code == 0, done.out + done.err
    return done.out


@compiled
def test_the_cap_of_a_stage_has_a_test_in_the_folder(tmp_path: Path) -> None:
    export_controller(Supervised(GPI(ARM, 1e-3), Supervisor(torque_cap=1.0)), tmp_path, measure=False)
    run("cc", "-std=c99", "test_faults.c", "armgpi_controller.c", "-o", "faults", "-lm", folder=tmp_path)
    (said,) = (line for line in run("./faults", folder=tmp_path).splitlines() if line.startswith("cap"))
    assert said.split()[2] == "12"


@compiled
@pytest.mark.parametrize("real", ["double", "float"])
def test_the_tool_has_tests_in_the_folder_which_pass(real: str, tmp_path: Path) -> None:
    middle = ARM.frame_pose(ARM.tip, ARM.middle()).translation
    given = Supervisor(workspace=(middle - 0.1, middle + 0.1), tool_speed=0.5, tool_force=20.0)
    export_controller(Supervised(GPI(ARM, 1e-3), given), tmp_path, measure=False, real=real)
    run("cc", "-std=c99", "test_faults.c", "armgpi_controller.c", "-o", "faults", "-lm", folder=tmp_path)
    lines = [line.split() for line in run("./faults", folder=tmp_path).splitlines()]
    found = {line[0]: line[1:] for line in lines}
    assert found["workspace"] == ["reason", "13", "ok"]
    assert found["tool_speed"] == ["reason", "14", "ok"]
    assert found["tool_force"] == ["reason", "15", "ok"]


@compiled
@pytest.mark.parametrize(
    ("real", "law"), [("float", GPI), for_search("double", GPI), ("double", PIDInversion)]
)
def test_every_fault_has_a_test_in_the_folder_which_passes(real: str, law: type, tmp_path: Path) -> None:
    controller = Supervised(law(ARM, 1e-3), Supervisor(missed=5, speed=0.5))
    export_controller(controller, tmp_path, real=real, measure=False)
    sources = ("test_faults.c", "armgpi_controller.c")
    flags = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-fsanitize=address,undefined"]
    run("cc", *flags, *sources, "-o", "faults", "-lm", folder=tmp_path)
    said = run("./faults", folder=tmp_path)
    reasons = [int(line.split()[2]) for line in said.splitlines()[:-1] if "switched off" not in line]
    assert sorted(reasons) == list(range(2, 12))  # a cap would come before SATURATED: below
    # From Python and from C++ the same code.
    used = (
        "import armgpi_controller as c\nx, code = c.Controller(), c.Controller.init.__code__\n"
        "v = ([0.1] * 3,) * (code.co_argcount - 1)\nprint(x.init(*v), x.step(*v)[0], x.fault[0])\n"
    )
    answer = run_python(used, folder=tmp_path)
    assert answer.split() == ["init", "run", "none"]
    (tmp_path / "use.cpp").write_text(
        '#include "armgpi_controller.hpp"\narmgpi_controller::Controller used;\n'
    )
    run(
        need("g++"),
        "-std=c++17",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-fsyntax-only",
        "use.cpp",
        folder=tmp_path,
    )


@compiled
def test_another_project_finds_the_package(tmp_path: Path) -> None:
    cmake = need("cmake")
    source, build, prefix, other = (tmp_path / name for name in ("c", "build", "prefix", "other"))
    export_controller(GPI(ARM, 1e-3), source, measure=False, name="left_arm")
    run(cmake, "-S", source, "-B", build, f"-DCMAKE_INSTALL_PREFIX={prefix}", folder=tmp_path)
    run(cmake, "--build", build, "--target", "install", folder=tmp_path)
    run("ctest", "--output-on-failure", folder=build)
    other.mkdir()
    (other / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(other C)\nfind_package(left_arm_controller REQUIRED)\n"
        "add_executable(other main.c)\n"
        "target_link_libraries(other left_arm_controller::left_arm_controller)\n"
    )
    (other / "main.c").write_text(
        '#include "left_arm.h"\nint main(void) { return (int)left_arm_info.n - 3; }\n'
    )
    run(cmake, "-S", other, "-B", other / "b", f"-DCMAKE_PREFIX_PATH={prefix}", folder=tmp_path)
    run(cmake, "--build", other / "b", folder=tmp_path)
    run(other / "b" / "other", folder=tmp_path)


#: Runs a loop in Python beside the stand-ins of tools/standin.py. Arguments: which, the goal, the sample from
#: which an encoder is broken (at once for good for ur, one sample for fci) or, negative, at which Ctrl-C
#: comes, and the version of the robot.
LOOP = """
import runpy, sys
from pathlib import Path

import armgpi

kind, goal, event, version = sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4:] or ["5.26.0"]
lock = ["panda_finger_joint1", "panda_finger_joint2"] if kind == "fci" else []
robot = armgpi.Robot.load({"fci": "panda", "ur": "ur5"}[kind], lock=lock).with_gravity((0, 0, 0))
tool = runpy.run_path(TOOL)
dt = {"fci": 0.001, "ur": 0.002}[kind]
broken, ctrl_c = max(event, 0), max(-event, 0)
arm = tool["Arm"](armgpi.RigidBodyPlant(robot), dt, robot.middle(), broken, kind == "fci", ctrl_c=ctrl_c)
code = tool["run_python"](Path(".").resolve(), arm, goal.split() if goal != "-" else [], *version)
print(arm.report("-" if goal[:2] in ("-", "--") else goal), "code", code)
""".replace("TOOL", repr(str(Path(__file__).parents[2] / "tools" / "standin.py")))


def figures(said: str) -> dict[str, float]:
    """The figures in the last line of a loop."""
    found = re.findall(r"(away|speed|rate|code) (\S+)", said.splitlines()[-1])
    return {name: float(value) for name, value in found}


PARTS = ("controller", "move", "follow", "log")

#: A dry run beside stubs whose arm is moved by hand: there is nothing that a torque could be sent by.
LOOK = """
import runpy, signal, sys
from types import SimpleNamespace as Made

count, start = 0, [float(x) for x in sys.argv[2].split(",")]


def moved(gain):
    global count
    count += 1
    if count > 300:
        signal.raise_signal(signal.SIGINT)  # Ctrl-C
    return [q + gain * count for q in start]


class Arm:
    def __init__(self, *given): pass
    def read_once(self):
        return Made(q=moved(1e-4), tau_J=[1.0] * 7, time=Made(to_sec=lambda: 0.001 * count))
    def getActualQ(self): return moved(2e-4)
    def getTimestamp(self): return 0.002 * count
    def getTargetMoment(self): return [1.0] * 6


sys.modules["pylibfranka"], sys.modules["rtde_receive"] = Made(Robot=Arm), Made(RTDEReceiveInterface=Arm)
kind = sys.argv[1]
sys.argv = [kind, "127.0.0.1", "--dry-run"]
runpy.run_path(kind + ".py", run_name="__main__")
"""


@compiled
@pytest.mark.usefixtures("compile_quickly")
@pytest.mark.parametrize("target", ["fci", "ur"])
def test_a_dry_run_sends_nothing_and_logs_what_the_joints_carry(
    target: str, fixed_gains: Export, tmp_path: Path
) -> None:
    robot, _ = fixed_gains(target, tmp_path)
    run_python(LOOK, target, ",".join(map(repr, robot.middle().tolist())), folder=tmp_path)
    log = logs.read(tmp_path / "motion.armlog")
    assert len(log.samples) == 301
    assert (log.samples["applied"] == 1.0).all()
    assert log.fault is None


@compiled
@pytest.mark.usefixtures("compile_quickly")
def test_a_franka_callback_ends_its_motion_when_the_arm_has_stopped(
    fixed_gains: Export, tmp_path: Path
) -> None:
    robot, _ = fixed_gains("fci", tmp_path)
    assert "without gravity" in (tmp_path / "README.md").read_text().splitlines()[2]
    (tmp_path / "motion.cpp").write_text(MOTION % ", ".join(map(repr, robot.middle().tolist())))
    run("cc", "-std=c99", "-c", *(f"armgpi_{x}.c" for x in PARTS), folder=tmp_path)
    flags = ["-std=c++17", *WARNINGS, "-I.", f"-I{STUBS}"]
    objects = [f"armgpi_{x}.o" for x in PARTS]
    run(need("g++"), *flags, "motion.cpp", *objects, "-o", "motion", folder=tmp_path)
    run("./motion", folder=tmp_path)
    said = run_python(LOOP, "fci", "-", 50, folder=tmp_path)
    assert said.startswith("hold not_finite panda_joint2")
    assert figures(said)["speed"] < 0.01


@compiled
@pytest.mark.usefixtures("compile_quickly")
@pytest.mark.parametrize("target", ["fci", "ur"])
def test_the_recommended_law_moves_a_simulated_arm_to_its_goal(target: str, tmp_path: Path) -> None:
    robot, dt, rate = interface(target)
    law = GPI.auto(robot, dt, bits=18)
    assert law.feedforward != "none"
    export_controller(Supervised(law, rate), tmp_path, measure=False, target=target)
    # The arm has the rotors that the law believes.
    load, rotors = ".with_gravity((0, 0, 0))\n", "robot = armgpi.robot.rotors.assume_rotors(robot)\n"
    script = LOOP.replace(load, load + rotors).replace("import armgpi\n", "import armgpi.robot.rotors\n")
    goal = ",".join(f"{x:.3f}" for x in robot.middle() + 0.2)
    said = run_python(script, target, goal, 0, folder=tmp_path)
    assert said.startswith("run none")
    found = figures(said)
    assert found["away"] < 1e-3
    assert found["speed"] < 0.01
    if target == "fci":
        assert found["rate"] <= 1000.0 * (1.0 + 1e-9)


#: Prints the reference of a motion at times, with the C++ of an export.
FOLLOWED = """
#include "armgpi_controller.hpp"
#include <cstdio>
int main() {
  const armgpi_controller::Motion motion("motion.csv");
  for (const double t : {-1.0, 0.0, 0.333, 0.5, motion.length(), 9.0}) {
    const armgpi_controller::Reference to = motion(t);
    std::printf("%.17g %.17g %.17g %.17g\\n", t, to.q[1], to.v[1], to.a[1]);
  }
}
"""


@compiled
@pytest.mark.usefixtures("compile_quickly")
@pytest.mark.parametrize("target", ["fci", "ur"])
def test_a_package_follows_the_motion_of_its_log(target: str, tmp_path: Path) -> None:
    robot, dt, rate = interface(target)
    controller = Supervised(GPI.auto(assume_rotors(robot), dt, bits=18), rate)
    q = robot.middle()
    motion = Waypoints([q, q + 0.1, q], [0.5, 0.5])
    export_controller(
        *(controller, tmp_path, record(RigidBodyPlant(robot), controller, motion, 1.1)),
        measure=False,
        target=target,
    )
    load, rotors = ".with_gravity((0, 0, 0))\n", "robot = armgpi.robot.rotors.assume_rotors(robot)\n"
    script = LOOP.replace(load, load + rotors).replace("import armgpi\n", "import armgpi.robot.rotors\n")
    said = run_python(script, target, "--motion motion.csv --log 20-pulse.armlog", 0, folder=tmp_path)
    assert said.startswith("run none")
    log = logs.read(tmp_path / "20-pulse.armlog")
    rows = log.samples
    assert np.ptp(rows["q_ref"][:, 1]) == pytest.approx(0.1, abs=1e-6)
    begun = log.t[np.argmax(rows["q_ref"][:, 1] > motion.at(0.25).q[1] - 1e-9)] - 0.25
    at = motion.at(log.t - begun)
    during = (log.t >= begun) & (log.t <= begun + 1.0)
    for name, wanted, near in zip(("q_ref", "v_ref", "a_ref"), at, (1e-7, 1e-6, 1e-4), strict=True):
        np.testing.assert_allclose(rows[name][during], wanted[during], atol=near)
    if target == "ur":
        (tmp_path / "followed.cpp").write_text(FOLLOWED)
        run(need("g++"), "-std=c++17", *WARNINGS, "-I.", "-c", "followed.cpp", folder=tmp_path)
        run(
            "cc",
            "-std=c99",
            "-c",
            "armgpi_log.c",
            "armgpi_controller.c",
            "armgpi_move.c",
            "armgpi_follow.c",
            folder=tmp_path,
        )
        run(
            "g++",
            *(f"{x}.o" for x in ("followed", *(f"armgpi_{y}" for y in PARTS))),
            "-o",
            "f",
            folder=tmp_path,
        )
        lines = np.array(
            [[float(x) for x in line.split()] for line in run("./f", folder=tmp_path).splitlines()]
        )
        script = "import armgpi_controller as a\nm = a.Motion('motion.csv')\n"
        script += f"for t in {lines[:, 0].tolist()}: print(*(x[1] for x in m.at(t)))\n"
        said = run_python(script, folder=tmp_path)
        same = np.array([[float(x) for x in line.split()] for line in said.splitlines()])
        np.testing.assert_allclose(lines[:, 1:], same, atol=1e-12)


#: A recording begins with the first pose that is taken, after the moves before it; a folder is refused.
POSES_READ = """
import time
import goals
poses = goals.Poses("poses.csv")
time.sleep(0.4)
start, count = time.monotonic(), 0
while count == 0:
    count += poses.take() is not None
while poses.take() is not None:
    count += 1
print(count <= 2 + 30 * (time.monotonic() - start))
folder = goals.Poses(".")
while not folder.ended:
    folder.take()
print(folder.refused, folder.ended)
"""


@compiled
@pytest.mark.usefixtures("compile_quickly")
@pytest.mark.parametrize("target", ["fci", "ur"])
def test_a_package_follows_poses_as_they_arrive(target: str, tmp_path: Path) -> None:
    robot, dt, rate = interface(target)
    law = Supervised(GPI.auto(assume_rotors(robot), dt, bits=18), rate)
    export_controller(law, tmp_path, measure=False, target=target)
    wished = poses_of(robot, tmp_path / "poses.csv", timed=True)
    load, rotors = ".with_gravity((0, 0, 0))\n", "robot = armgpi.robot.rotors.assume_rotors(robot)\n"
    script = LOOP.replace(load, load + rotors).replace("import armgpi\n", "import armgpi.robot.rotors\n")
    goal = ",".join(map(str, ROOM[robot.n]))
    said = run_python(script, target, f"--poses poses.csv {goal}", 0, folder=tmp_path)
    assert said.startswith("run none")
    assert ends_at(robot, wished, logs.read(tmp_path / "motion.armlog"))
    assert robot.tip in (tmp_path / "README.md").read_text()
    assert run_python(POSES_READ, folder=tmp_path).split() == ["True", "True", "True"]


#: A stream through the Python of an export: poses with a gap, a jump, one without norm; joints out.
STREAM = """
import json
import armgpi_controller as c

poses = json.load(open("poses.json"))
moves = c.Moves(poses["start"])
refused = moves.follow([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0])
rows, k = [], 0
for sample in range(poses["samples"]):
    t = sample * c.DT
    while k < len(poses["times"]) and poses["times"][k] <= t + 1e-9:
        assert moves.follow(*poses["poses"][k], age=t - poses["times"][k])
        k += 1
    rows.append(moves.next())
    assert not moves.move_to(poses["start"]) or not moves.moving
print(json.dumps([refused, rows]))
"""


@compiled
@pytest.mark.parametrize(("real", "near"), [("double", 1e-9), ("float", 1e-5)])
def test_an_exported_stream_is_that_of_python(real: str, near: float, tmp_path: Path) -> None:
    robot = ur5().with_armature(0.5)
    controller = Supervised(GPI(robot, 1e-3))
    export_controller(controller, tmp_path, measure=False, real=real)
    random, start = np.random.default_rng(0), robot.middle() + 0.2
    here = robot.frame_pose(robot.tip, start)
    times, poses = [], []
    for i in range(40):
        if 12 <= i < 18:
            continue  # a gap of 200 ms
        shift = 0.1 * np.sin([0.05 * i, 0.03 * i, 0.07 * i]) + 1e-3 * random.normal(size=3)
        turn = Rotation.from_rotvec(0.02 * i * np.array([1.0, -0.5, 0.3]))
        at = here.translation + shift + (i > 30) * np.array([0.0, 0.2, 0.0])
        times.append(i / 30.0 + random.uniform(0.0, 8e-3))
        poses.append([at, (Rotation.from_matrix(here.rotation) * turn).as_quat()])
    if real == "float":
        start = start.astype(np.float32).astype(float)
    data = {
        "start": start.tolist(),
        "samples": 1800,
        "times": times,
        "poses": [[list(map(float, at)), list(map(float, turn))] for at, turn in poses],
    }
    (tmp_path / "poses.json").write_text(json.dumps(data))
    refused, rows = json.loads(run_python(STREAM, folder=tmp_path))
    assert refused is False
    stream = Setpoints(
        robot,
        robot.tip,
        times,
        np.array([[*at, *turn] for at, turn in poses]),
        follow_limits(controller),
        start=start,
        inverse=SetpointInverse(robot, robot.tip),
    )
    wished = stream.at(np.arange(1, 1801) * 1e-3)
    scales: tuple[Any, ...] = (1.0, *map(np.asarray, follow_limits(controller)[:2]))
    for i, scale in enumerate(scales):
        found = np.array([row[i] for row in rows])
        np.testing.assert_allclose(found / scale, np.asarray(wished[i]) / scale, rtol=0.0, atol=near)
    for compiler in ("gcc", "clang"):
        if shutil.which(compiler):
            flags = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror")
            run(compiler, *flags, "-Wdouble-promotion", "-c", "armgpi_follow.c", folder=tmp_path)


#: A program where a share of all packets is lost, each way, and a command is in flight, with 14 to 18 bits.
LOSSY = """
import runpy, sys
from pathlib import Path

import armgpi

robot = armgpi.Robot.load("panda", lock=["panda_finger_joint1", "panda_finger_joint2"])
robot = robot.with_gravity((0, 0, 0))
tool, here, built = runpy.run_path(TOOL), Path(".").resolve(), Path("built").resolve()
which = sys.argv[1]
if which == "run_cpp":
    built.mkdir()
    program = tool["build"](here, built)
    tool["run_cpp"].__globals__["build"] = lambda *given: program
goal = ",".join(f"{x:.3f}" for x in robot.middle() + 0.1)
tool["run_cpp"].__globals__["MOST"] = 500  # samples
for bits in range(14, 19):
    plant = armgpi.Encoder(armgpi.RigidBodyPlant(robot), bits)
    arm = tool["Arm"](plant, 0.001, robot.middle(), loss=0.05, flight=1)
    try:
        tool[which](here, arm, [goal])
    except SystemExit:
        print(arm.report(goal))
""".replace("TOOL", repr(str(Path(__file__).parents[2] / "tools" / "standin.py")))


@compiled
@pytest.mark.usefixtures("compile_quickly")
@pytest.mark.parametrize("program", ["run_python", "run_cpp"])
def test_a_franka_sees_no_faster_torque_with_packets_lost(program: str, tmp_path: Path) -> None:
    """The law as printed, whose torque of single counts is above the rate with 14 bits."""
    if program == "run_cpp":
        need("cmake")
    law = Supervised(GPI(panda(), 1e-3, FixedGains(20.0)), Supervisor(torque_rate=999.999))
    export_controller(law, tmp_path, measure=False, target="fci")
    said = run_python(LOSSY, program, folder=tmp_path)
    found = [figures(line) for line in said.splitlines() if line.startswith("away")]
    assert len(found) == 5
    assert all(each["rate"] <= 1000.0 for each in found)
    assert found[0]["rate"] > 990.0
    assert all(each["away"] < 0.09 for each in found)


def looks_on(program: Path, robot: Robot) -> None:
    """A dry run sends nothing; of a packet that comes twice one is stepped on, and a missed one counts."""
    packets = [k for k in range(300) for _ in range(1 + (k == 7)) if k != 9]
    numbers = ([2e-3 * k, *(robot.middle() + 1e-4 * k).tolist(), *[1.0] * 6] for k in packets)
    done = subprocess.run(
        [str(program), "127.0.0.1", "--dry-run", "--log", "look.armlog"],
        input="\n".join(" ".join(map(repr, row)) for row in numbers),
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    log = logs.read(Path("look.armlog"))
    assert len(log.samples) == 299
    assert (log.samples["applied"] == 1.0).all()
    np.testing.assert_allclose(np.diff(log.t[7:10]), [0.002, 0.004])
    np.testing.assert_allclose(log.samples["q_measured"][9], robot.middle() + 1e-3)
    assert log.fault is None


@compiled
@pytest.mark.usefixtures("compile_quickly")
@pytest.mark.parametrize("target", ["fci", for_search("ur")])
def test_the_cpp_program_moves_a_simulated_arm_too(
    target: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Built by the folder's own CMakeLists.txt, and without a warning by both compilers."""
    monkeypatch.chdir(tmp_path)  # where it writes its log
    robot, dt, rate = interface(target)
    robot = assume_rotors(robot)
    export_controller(Supervised(GPI.auto(robot, dt, bits=18), rate), tmp_path, measure=False, target=target)
    for compiler in ("g++", "clang++"):
        flags = ["-std=c++17", *WARNINGS, "-isystem", STUBS, "-fsyntax-only", '-DARMGPI_URSCRIPT="x"']
        run(need(compiler), *flags, f"{target}.cpp", folder=tmp_path)
    need("cmake")
    tool = runpy.run_path(str(Path(__file__).parents[2] / "tools" / "standin.py"))
    (tmp_path / "built").mkdir()
    program = tool["build"](tmp_path, tmp_path / "built")
    monkeypatch.setitem(tool["run_cpp"].__globals__, "build", lambda *given: program)
    arm = tool["Arm"](RigidBodyPlant(robot), dt, robot.middle())
    goal = ",".join(f"{x:.3f}" for x in robot.middle() + 0.2)
    options = ["--load", "0.5,0,0,0.1", "--contact", "30", "--recover"] if target == "fci" else []
    assert tool["run_cpp"](tmp_path, arm, [*options, goal]) == 0
    found = figures(arm.report(goal))
    assert found["away"] < 1e-3
    assert found["speed"] < 0.01
    said = capsys.readouterr().out
    if target == "fci":
        assert found["rate"] <= 1000.0 * (1.0 + 1e-9)
        assert said.startswith("recover\ncontact 30 30 30 30 30 30 30\n")
        assert "force 20 20 20 20 20 20" in said  # as libfranka's examples have it
        assert "load 0.5 0 0.0005" in said
    else:
        assert said.startswith("viscous 0 0 0 0 0 0\ncoulomb 0 0 0 0 0 0\n")
        # Without direct torque it ends before a torque was sent.
        arm = tool["Arm"](RigidBodyPlant(robot), dt, robot.middle())
        assert tool["run_cpp"](tmp_path, arm, [goal], "5.25.0") == 1
        assert arm.count == 0
    arm = tool["Arm"](RigidBodyPlant(robot), dt, robot.middle(), ctrl_c=round(0.3 / dt))
    assert tool["run_cpp"](tmp_path, arm, [goal]) == 1
    is_stopped(arm.report(goal), tmp_path)
    if target == "ur":
        looks_on(program, robot)
    wished = poses_of(robot, tmp_path / "poses.csv", timed=False)
    arm = tool["Arm"](RigidBodyPlant(robot), dt, robot.middle())
    goal = ",".join(map(str, ROOM[robot.n]))
    assert tool["run_cpp"](tmp_path, arm, [goal, "--poses", "poses.csv"]) == 0
    assert ends_at(robot, wished, logs.read(tmp_path / "motion.armlog"))
    # A motion begins with a move to where it begins.
    arm = tool["Arm"](RigidBodyPlant(robot), dt, robot.middle() + 0.05)
    assert tool["run_cpp"](tmp_path, arm, ["--motion", "motion.csv", "--log", "stage.armlog"]) == 0
    assert figures(arm.report(",".join(map(str, robot.middle()))))["away"] < 1e-3
    rows = logs.read(tmp_path / "stage.armlog").samples["q_ref"]
    np.testing.assert_allclose(rows[-1], robot.middle(), atol=1e-12)


@compiled
@pytest.mark.usefixtures("compile_quickly")
@pytest.mark.parametrize("target", ["fci", "ur"])
@pytest.mark.parametrize("program", ["run_python", "run_cpp"])
def test_a_spring_on_a_robot_gives_way_to_a_hand(
    target: str, program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exported, compiled as the folder says and beside a stand-in: force over stiffness at the tool."""
    monkeypatch.chdir(tmp_path)
    robot, dt, rate = interface(target)
    robot = assume_rotors(robot)
    law = CartesianImpedance(robot, dt, stiffness=[800.0] * 3 + [40.0] * 3)
    export_controller(Supervised(law, rate), tmp_path, measure=False, target=target)
    tool = runpy.run_path(str(Path(__file__).parents[2] / "tools" / "standin.py"))
    if program == "run_cpp":
        need("cmake")
        (tmp_path / "built").mkdir()
        built = tool["build"](tmp_path, tmp_path / "built")
        monkeypatch.setitem(tool["run_cpp"].__globals__, "build", lambda *given: built)
    for module in ("armgpi_controller", "goals"):  # those of another folder
        monkeypatch.delitem(sys.modules, module, raising=False)
    start, goal = np.array(ROOM[robot.n]), np.array(ROOM[robot.n]) + 0.1
    hand = ToolForce([4.0, -3.0, 6.0])
    arm = tool["Arm"](RigidBodyPlant(robot, environment=[hand]), dt, start)
    assert tool[program](tmp_path, arm, [",".join(map(str, goal))]) == 0
    there = arm.plant.true_state(arm.state)
    moved = robot.frame_pose(robot.tip, there.q).translation - robot.frame_pose(robot.tip, goal).translation
    np.testing.assert_allclose(moved, np.array(hand.force) / 800.0, atol=4e-4)
    log = logs.read(tmp_path / "motion.armlog")
    assert log.fault is None


#: Changes the force limit by the headers of a target.
CHANGED_LIMIT = {
    "fci": "bool change(armgpi_controller::Fci& arm) { return arm->force.limit(20.0); }\n",
    "ur": "bool change(armgpi_controller::Ur& arm) { return arm.force.limit(20.0); }\n",
}


@compiled
@pytest.mark.usefixtures("compile_quickly")
@pytest.mark.filterwarnings("ignore::armgpi.ArmgpiWarning")
@pytest.mark.parametrize("target", ["fci", "ur"])
@pytest.mark.parametrize("kind", ["gpi", "wrapped"])
def test_a_force_limit_compiles_against_the_headers_of_a_robot(
    target: str, kind: str, tmp_path: Path
) -> None:
    """Without a warning, with its change from another thread; and it moves a simulated arm."""
    robot, dt, rate = interface(target)
    robot = assume_rotors(robot).with_friction(coulomb=1.0)
    law: Any = GPI(robot, dt, feedforward="model", force_limit=30.0)
    if kind == "wrapped":
        law = ForceLimited(PIDPositions(robot, dt), 30.0)
    export_controller(Supervised(law, rate), tmp_path, measure=False, target=target)
    (tmp_path / "change.cpp").write_text(f'#include "{target}.hpp"\n{CHANGED_LIMIT[target]}')
    flags = ["-std=c++17", *WARNINGS, "-isystem", STUBS, "-fsyntax-only", '-DARMGPI_URSCRIPT="x"']
    for file in (f"{target}.cpp", "change.cpp"):
        run(need("g++"), *flags, file, folder=tmp_path)
    start = f"import numpy as np\nimport armgpi.robot.rotors\n{LOOP}".replace(
        "tool = runpy", "robot = armgpi.robot.rotors.assume_rotors(robot)\ntool = runpy"
    )
    program = start.replace("robot.middle()", f"np.array({ROOM[robot.n]})")
    goal = ",".join(f"{x + 0.05:.3f}" for x in ROOM[robot.n])
    said = run_python(program, target, goal, 0, folder=tmp_path)
    assert said.startswith("run none")
    assert figures(said)["away"] < 0.01


#: A configuration of each target's robot that is far from singular ones.
ROOM = {6: [0.0, -1.2, 1.5, -1.87, -1.57, 0.3], 7: [0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8]}


def poses_of(robot: Robot, file: Path, timed: bool) -> Pose:
    """Write poses of the tip, in the end 50 mm and 0.1 rad from where it has room; return the last."""
    start = robot.frame_pose(robot.tip, ROOM[robot.n])
    rows = []
    for i in range(20):
        shift = 0.05 * (i + 1) / 20 * np.array([0.6, 0.0, -0.8])
        turned = Rotation.from_matrix(start.rotation) * Rotation.from_rotvec([0.1 * (i + 1) / 20, 0.0, 0.0])
        rows.append([*[i / 30.0] * timed, *(start.translation + shift), *turned.as_quat()])
    head = ["time"] * timed + ["x", "y", "z", "qx", "qy", "qz", "qw"]
    lines = [",".join(head), *(",".join(f"{x:.17g}" for x in row) for row in rows)]
    file.write_text("\n".join(lines) + "\n")
    return Pose(translation=start.translation + shift, rotation=turned.as_matrix())


def ends_at(robot: Robot, wished: Pose, log: Any) -> bool:
    """Whether the reference of a log ends at a pose, and the arm with it, without a fault."""
    samples = log.samples
    at = robot.frame_pose(robot.tip, np.asarray(samples["q_ref"][-1], dtype=float))
    turn = Rotation.from_matrix(at.rotation.T @ wished.rotation).magnitude()
    away = float(np.linalg.norm(at.translation - wished.translation))
    near = np.abs(samples["q_measured"][-1] - samples["q_ref"][-1]).max()
    return log.fault is None and away < 2e-4 and turn < 2e-3 and near < 2e-3


def is_stopped(said: str, folder: Path) -> None:
    """Assert that an arm rests, on its way, after a stop under control."""
    found = figures(said)
    assert found["away"] > 0.05
    assert found["speed"] < 0.01
    log = logs.read(folder / "motion.armlog")
    assert log.fault is not None
    assert "REFERENCE" in log.fault
    assert log.samples["status"][-1] == State.HOLD


@compiled
def test_a_topic_moves_the_ros2_controller_and_a_service_stops_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    need("g++")
    monkeypatch.chdir(tmp_path)
    export_controller(GPI(ARM, 1e-3), tmp_path, measure=False, target="ros2_control")
    tool = runpy.run_path(str(Path(__file__).parents[2] / "tools" / "standin.py"))
    (tmp_path / "built").mkdir()
    program = tool["build"](tmp_path, tmp_path / "built")
    monkeypatch.setitem(tool["run_cpp"].__globals__, "build", lambda *given: program)
    goal = ",".join(f"{x:.3f}" for x in ARM.middle() + 0.2)
    here = ARM.frame_pose(ARM.tip, ARM.middle() + 0.15)
    pose = [*here.translation, *Rotation.from_matrix(here.rotation).as_quat()]
    arm = tool["Arm"](RigidBodyPlant(ARM), 1e-3, ARM.middle())
    assert tool["run_cpp"](tmp_path, arm, [f"pose:{','.join(map(repr, map(float, pose)))}"]) == 0
    assert ends_at(ARM, here, logs.read(tmp_path / "motion.armlog"))
    for ctrl_c in (0, 150):
        arm = tool["Arm"](RigidBodyPlant(ARM), 1e-3, ARM.middle(), ctrl_c=ctrl_c)
        assert tool["run_cpp"](tmp_path, arm, [goal]) == 0
        found = figures(arm.report(goal))
        assert found["speed"] < 0.01
        assert (found["away"] < 1e-3) != (ctrl_c > 0)
    is_stopped(arm.report(goal), tmp_path)


@compiled
def test_springs_of_a_ros2_controller_change_without_a_step_of_torque(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Stiffness, limit and guiding come by topics; what is refused changes nothing, and is said."""
    need("g++")
    monkeypatch.chdir(tmp_path)
    law = JointImpedance(ARM, 1e-3, stiffness=3.0, torque_limit=1.0)
    export_controller(law, tmp_path, measure=False, target="ros2_control")
    tool = runpy.run_path(str(Path(__file__).parents[2] / "tools" / "standin.py"))
    (tmp_path / "built").mkdir()
    program = tool["build"](tmp_path, tmp_path / "built")
    monkeypatch.setitem(tool["run_cpp"].__globals__, "build", lambda *given: program)
    arm = tool["Arm"](RigidBodyPlant(ARM.with_payload(ARM.tip, 0.05)), 1e-3, ARM.middle())
    changes = {
        "stiffness@50": "1,1",  # two numbers
        "stiffness@60": "1e5,1,1",  # beyond the largest
        "stiffness@900": "12,12,12",
        "force_limit@1300": "0.02,0.02,0.02",
        "force_limit@1310": "0,1,1",
        "force_limit@1900": "1,1,1",
        "guide@1950": "1",
        "guide@2000": "0",
    }
    assert tool["run_cpp"](tmp_path, arm, [f"{at}:{values}" for at, values in changes.items()]) == 0
    said = capfd.readouterr().err
    assert said.count("stiffness refused") == 2
    assert said.count("force limit refused") == 1
    log = logs.read(tmp_path / "motion.armlog")
    assert log.fault is None
    tau, q = log.samples["tau"], log.inputs["q_measured"]
    steps = np.abs(np.diff(tau, axis=0)).max(axis=1)
    # The spring's torque of 0.6 N m goes over in 0.1 s, and to the hand's position in 0.05 s.
    assert steps[10:].max() < 0.03
    sag = np.abs(q - ARM.middle())[:, 1]
    assert sag[1250] < 0.6 * sag[850]  # stiffer, it is pulled back
    assert sag[1895] > 1.2 * sag[1250]  # with a limit below the weight it gives way
    assert sag[-1] == pytest.approx(sag[2000], abs=0.005)  # a guided arm stays where it was left


def stepped(changes: str) -> str:
    """Return a program beside exported C that prints the torques of the rows in `given.json`.

    Args:
        changes: what it does before step k, as lines of the loop's body.
    """
    return f"""
import json, math
import armgpi_controller as c
given = json.load(open("given.json"))
arm = c.Controller()
zero = [0.0] * c.N
arm.init(given["rows"][0], given["r"], zero, zero)
for k, q in enumerate(given["rows"]):
{changes}
    status, tau = arm.step(q, given["r"], zero, zero)
    print("[" if k == 0 else ",", json.dumps(tau))
print("]")
"""


@compiled
@pytest.mark.parametrize("kind", ["tool", "tool without a limit", "joints"])
def test_exported_springs_are_those_of_python(kind: str, tmp_path: Path) -> None:
    """Stiffness, limit and guiding by the functions in C are what `changed` is in Python."""
    target = Hold(ARM.middle())
    law: Any = JointImpedance(ARM, 1e-3, stiffness=3.0, torque_limit=1.0)
    limit: list[float] = [0.1, 0.2, 0.3]
    stiffness = [9.0, 5.0, 0.0]
    if kind != "joints":
        law = CartesianImpedance(ARM, 1e-3, stiffness=[50.0, 50.0, 50.0, 0.0, 0.0, 0.0])
        stiffness, limit = [80.0, 0.0, 40.0, 0.0, 0.0, 0.0], []
    if kind == "tool":
        law = CartesianImpedance(ARM, 1e-3, stiffness=[50.0, 50.0, 50.0, 0.0, 0.0, 0.0], force_limit=3.0)
        limit = [1.0]
    controller = Supervised(law)
    export_controller(controller, tmp_path, measure=False)
    rows = ARM.middle() + 0.02 * np.sin(0.01 * np.arange(400.0))[:, None]
    (tmp_path / "try.py").write_text(stepped(CHANGES))
    given = {"rows": rows.tolist(), "r": target.at(0.0).q.tolist(), "stiffness": stiffness, "limit": limit}
    (tmp_path / "given.json").write_text(json.dumps(given))
    shown = np.array(json.loads(run(sys.executable, "try.py", folder=tmp_path)))
    at = target.at(0.0)
    state = controller.init(Measurement(rows[0]), at)
    expected = []
    for k, q in enumerate(rows):
        if k == 50:
            state = state._replace(law=law.changed(state.law, stiffness=stiffness, limit=limit or None))
        if k in (150, 250):
            state = state._replace(law=law.changed(state.law, guided=k == 150))
        if k == 300:
            state = state._replace(law=law.changed(state.law, moved=np.zeros(3)))
        taken = controller.step(Measurement(q), at, state)
        state = taken.state
        expected.append(taken.tau)
    np.testing.assert_allclose(shown, expected, rtol=1e-9, atol=1e-9)


#: What such a program does with springs.
CHANGES = """
    if k == 40:
        for wrong in (-1.0, math.nan, 1e9):
            assert not arm.stiffness([wrong] * len(given["stiffness"]))
        if given["limit"]:
            assert not arm.spring_limit([0.0] * len(given["limit"]))
            assert not arm.spring_limit([math.inf] * len(given["limit"]))
        try:
            arm.stiffness([1.0])
        except ValueError as error:
            assert "expected" in str(error)
        else:
            raise AssertionError
    if k == 50:
        assert arm.stiffness(given["stiffness"])
        assert not given["limit"] or arm.spring_limit(given["limit"])
    if k in (150, 250, 300):
        arm.guide({150: "guided", 250: "left", 300: "back"}[k])
"""


@compiled
@pytest.mark.filterwarnings("ignore::armgpi.ArmgpiWarning")
@pytest.mark.parametrize("kind", ["gpi", "wrapped"])
def test_an_exported_force_limit_changes_as_in_python(kind: str, tmp_path: Path) -> None:
    """The function in C is what `changed` is in Python; what is refused changes nothing."""
    target = Hold(ARM.middle())
    law: Any = GPI(ARM, 1e-3, feedforward="model", force_limit=3.0, limit_friction=0.0)
    if kind == "wrapped":
        law = ForceLimited(PIDPositions(ARM, 1e-3), 3.0, uncertain_mass=0.1, limit_friction=0.0)
    controller = Supervised(law)
    export_controller(controller, tmp_path, measure=False)
    rows = ARM.middle() + 0.1 + 0.02 * np.sin(0.01 * np.arange(400.0))[:, None]
    (tmp_path / "try.py").write_text(stepped(OTHER_LIMITS))
    wrong = [0.0, -1.0, math.nan, math.inf] + [0.9] * (kind == "wrapped")
    given = {"rows": rows.tolist(), "r": target.at(0.0).q.tolist(), "wrong": wrong}
    (tmp_path / "given.json").write_text(json.dumps(given))
    shown = np.array(json.loads(run(sys.executable, "try.py", folder=tmp_path)))
    at = target.at(0.0)
    state = controller.init(Measurement(rows[0]), at)
    expected = []
    for k, q in enumerate(rows):
        if k in (50, 250):
            state = state._replace(law=law.changed(state.law, 1.0 if k == 50 else 9.0))
        taken = controller.step(Measurement(q), at, state)
        state = taken.state
        expected.append(taken.tau)
    np.testing.assert_allclose(shown, expected, rtol=1e-9, atol=1e-9)
    unchanged = Supervised(law)
    state = unchanged.init(Measurement(rows[0]), at)
    for q in rows:
        taken = unchanged.step(Measurement(q), at, state)
        state = taken.state
    assert np.abs(taken.tau - shown[-1]).max() > 0.05  # it acts


#: What such a program does with a force limit.
OTHER_LIMITS = """
    if k in (40, 260):
        assert not any(arm.force_limit(value) for value in given["wrong"])
    if k in (50, 250):
        assert arm.force_limit(1.0 if k == 50 else 9.0)
"""


@compiled
@pytest.mark.filterwarnings("ignore::armgpi.ArmgpiWarning")
def test_the_force_limit_of_a_ros2_controller_changes_by_its_topic(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A weight that the model does not know is held up to the limit, and no longer below its force."""
    need("g++")
    monkeypatch.chdir(tmp_path)
    law = GPI(ARM, 1e-3, feedforward="model", force_limit=20.0, limit_friction=0.0)
    export_controller(law, tmp_path, measure=False, target="ros2_control")
    tool = runpy.run_path(str(Path(__file__).parents[2] / "tools" / "standin.py"))
    (tmp_path / "built").mkdir()
    program = tool["build"](tmp_path, tmp_path / "built")
    monkeypatch.setitem(tool["run_cpp"].__globals__, "build", lambda *given: program)
    arm = tool["Arm"](RigidBodyPlant(ARM.with_payload(ARM.tip, 0.3)), 1e-3, ARM.middle())
    changes = {
        "force_limit@50": "1,1",  # two numbers
        "force_limit@60": "0",
        "force_limit@900": "0.5",
        "force_limit@1600": "20",
    }
    assert tool["run_cpp"](tmp_path, arm, [f"{at}:{values}" for at, values in changes.items()]) == 0
    assert capfd.readouterr().err.count("force limit refused") == 2
    log = logs.read(tmp_path / "motion.armlog")
    tau, q = log.samples["tau"], log.inputs["q_measured"]
    away = np.abs(q - ARM.middle()).max(axis=1)
    assert away[850] < 0.02
    assert away[1600] > 2.0 * away[850]  # 2.9 N hang on 0.5 N
    steps = np.abs(np.diff(tau, axis=0)).max(axis=1)
    assert steps[895:960].max() < 0.05
    assert steps[1595:1610].max() < 0.05


@compiled
@pytest.mark.usefixtures("compile_quickly")
@pytest.mark.parametrize("target", ["fci", "ur"])
def test_ctrl_c_stops_the_arm_under_control(target: str, fixed_gains: Export, tmp_path: Path) -> None:
    robot, dt = fixed_gains(target, tmp_path)
    goal = ",".join(f"{x:.3f}" for x in robot.middle() + 0.2)
    said = run_python(LOOP, target, goal, -round(0.3 / dt), folder=tmp_path)
    assert said.startswith("hold reference")
    assert "stopped by Ctrl-C" in said
    assert figures(said)["code"] == 1
    is_stopped(said, tmp_path)


@compiled
@pytest.mark.usefixtures("compile_quickly")
def test_a_ur_controller_without_direct_torque_is_refused(fixed_gains: Export, tmp_path: Path) -> None:
    fixed_gains("ur", tmp_path)
    for old in ("5.25.1", "3.15.8", "10.12.0"):
        done = fork_script(LOOP, "ur", "-", 0, old, folder=tmp_path)
        assert done.code == 1
        assert "has no direct torque" in done.err


@compiled
@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_a_move_is_a_smooth_curve_within_its_limits(real: str, compiler: str, tmp_path: Path) -> None:
    robot = ARM
    export_controller(GPI(robot, 1e-3), tmp_path, real=real, measure=False)
    begin, end = ("{" + ", ".join(f"(armgpi_real_t){x!r}" for x in row) + "}" for row in ENDS)
    (tmp_path / "print.c").write_text(MOVE.replace("BEGIN", begin).replace("END", end))
    flags = ["-std=c99", *WARNINGS, "-Wdouble-promotion", "print.c", "armgpi_move.c", "-lm", "-o", "print"]
    run(need(compiler), *flags, folder=tmp_path)
    rows = np.array([line.split() for line in run("./print", folder=tmp_path).splitlines()], dtype=float)
    dt, (begin, end) = 1e-3, np.array(ENDS)
    # Of degree 5, at rest at both ends: by the six conditions.
    total, t = len(rows) * dt, dt * np.arange(1, len(rows) + 1)
    powers = np.arange(6.0)

    def derivatives(at: np.ndarray) -> list[np.ndarray]:
        x = np.asarray(at, dtype=float)[..., None]
        with np.errstate(all="ignore"):
            first = np.nan_to_num(powers * x ** (powers - 1.0))
            second = np.nan_to_num(powers * (powers - 1.0) * x ** (powers - 2.0))
        return [x**powers, first, second]

    ends = np.concatenate([derivatives(np.array([0.0, total]))[k] for k in range(3)])
    factors = np.linalg.solve(ends, np.concatenate([[begin, end], np.zeros((4, 3))]))
    curve = [matrix @ factors for matrix in derivatives(t)]
    scale = 1e-9 if real == "double" else 3e-7
    for found, wanted in zip(np.split(rows, 3, axis=1), curve, strict=True):
        np.testing.assert_allclose(found, wanted, atol=scale * (1.0 + np.abs(wanted).max()))
    text = (tmp_path / "armgpi_move.c").read_text().partition("[3][ARMGPI_N] = {")[2].partition("};")[0]
    limits = np.array([float(x) for x in re.findall(r"[\d.e+-]+", text.replace("F", ""))]).reshape(3, 3)
    jerk = np.diff(rows[:, 6:], axis=0) / dt
    for found, limit in zip((rows[:, 3:6], rows[:, 6:], jerk), limits, strict=True):
        assert (np.abs(found) <= limit * (1.0 + 1e-5)).all()
    assert max((np.abs(rows[:, 3:6]) / limits[0]).max(), (np.abs(rows[:, 6:]) / limits[1]).max()) > 0.9


@compiled
@pytest.mark.parametrize("name", [None, "left_arm"])
def test_a_ros2_controller_compiles_against_its_stubs(name: str | None, tmp_path: Path) -> None:
    export_controller(GPI(ARM, 1e-3), tmp_path, measure=False, target="ros2_control", name=name)
    prefix = name or "armgpi"
    plugin = (tmp_path / "ros2_plugin.xml").read_text()
    assert f'"{prefix}_controller/Ros2Controller" type="{prefix}_controller::Ros2Controller"' in plugin
    assert f"add_library({prefix}_controller_ros2 " in (tmp_path / "CMakeLists.txt").read_text()
    assert f'path="{prefix}_controller_ros2"' in plugin
    (tmp_path / "ros2_stubs.hpp").write_text(rename((STUBS / "ros2_stubs.hpp").read_text(), name))
    stubs = f"-D{prefix.upper()}_ROS2_STUBS"
    for compiler in ("g++", "clang++"):
        if compiler == "g++" or shutil.which(compiler):
            flags = ["-std=c++17", *WARNINGS, stubs, "-fsyntax-only", *WHERE]
            run(need(compiler), *flags, "src/ros2_control.cpp", folder=tmp_path)
    text = (tmp_path / "include" / f"{prefix}_controller" / "ros2_control.hpp").read_text()
    for function in (
        "return_type update_and_write",
        "return_type update_reference",
        "void follow",
        "t step(",
    ):
        body = text.partition(function)[2].partition("\n  }\n")[0]
        assert body
        assert not [word for word in ("new ", "push_back", "std::string", "make_") if word in body]


#: Folders of a package's headers, and of stubs.
WHERE = ("-I.", "-Iinclude", f"-I{STUBS}")


def test_parameters_of_the_plugin_are_those_of_its_stub(tmp_path: Path) -> None:
    """What generate_parameter_library makes of the file has these names, types and defaults."""
    export_controller(GPI(ARM, 1e-3), tmp_path, measure=False, target="ros2_control", name="left_arm")
    file = tmp_path / "src" / "left_arm_controller_parameters.yaml"
    ((name, parameters),) = yaml.safe_load(file.read_text()).items()
    assert name == "left_arm_controller"
    types = {"string": "std::string", "double": "double", "bool": "bool"}
    stub = (STUBS / "ros2_stubs.hpp").read_text().partition("struct Params {")[2].partition("};")[0]
    told = [
        f"  {types[each['type']]} {key} = {json.dumps(each['default_value'])};"
        for key, each in parameters.items()
    ]
    assert stub.strip("\n").splitlines() == told
    assert all(each["description"] for each in parameters.values())


#: A trajectory controller before the plugin: none of its references for 20 samples, then a move, then NaN.
CHAINED = """
#include "armgpi_controller/ros2_control.hpp"

struct Arm : armgpi_controller::Ros2Controller {
  void wire() {
    command_interfaces_.resize(ARMGPI_N);
    state_interfaces_.resize(ARMGPI_N);
  }
  void stand(std::size_t i, double q) { stubs::values[&state_interfaces_[i]] = q; }
  double torque(std::size_t i) { return stubs::values[&command_interfaces_[i]]; }
  auto references() { return on_export_reference_interfaces(); }
  auto step() { return update_and_write_commands(rclcpp::Time{}, rclcpp::Duration{0.001}); }
};

int main() {
  const double middle[ARMGPI_N] = {%s};
  auto& given = stubs::parameters<armgpi_controller::Params>;
  given.log = "motion.armlog";
  given.log_seconds = 1.0;
  given.last_torque = "hold";
  stubs::update_rate = 0;  // the controller manager's, which may be any
  Arm arm;
  const rclcpp_lifecycle::State none{};
  using Return = controller_interface::CallbackReturn;
  if (arm.on_init() != Return::SUCCESS || arm.on_configure(none) != Return::ERROR) return 6;
  stubs::update_rate = 1000;
  if (arm.on_configure(none) != Return::SUCCESS) return 1;
  arm.wire();
  const auto references = arm.references();
  arm.set_chained_mode(true);
  for (std::size_t i = 0; i < ARMGPI_N; ++i) arm.stand(i, middle[i]);
  if (arm.on_activate(none) != Return::SUCCESS || references.size() != 3U * ARMGPI_N) return 2;
  for (int k = 0; k < 300; ++k) {
    for (std::size_t i = 0; i < ARMGPI_N && k >= 20; ++i) {
      const double q = middle[i] + 4e-6 * (k - 20) * (k - 20);
      if (k < 100 || k >= 106) arm.stand(i, q);  // six packets come once more
      *references[i].value = k < 250 ? q : NAN;
      *references[ARMGPI_N + i].value = 8e-3 * (k - 20);  // acceleration is not written, and zero
    }
    if (arm.step() != controller_interface::return_type::OK) return 3;
    stubs::timers.front()();
  }
  const double last = arm.torque(1);
  if (arm.on_deactivate(none) != Return::SUCCESS) return 4;
  if (!(arm.torque(1) >= last && arm.torque(1) <= last)) return 5;
  for (const std::string& text : stubs::published) std::printf("%%s\\n", text.c_str());
  std::printf("%%s\\n", references[4].name.c_str());
  return 0;
}
"""


@compiled
def test_a_trajectory_controller_drives_the_ros2_controller(tmp_path: Path) -> None:
    """Chained: it stands until references come, follows them, stops on NaN; the log says so, and replays."""
    controller = Supervised(GPI(ARM, 1e-3, feedforward="computed"))
    export_controller(controller, tmp_path, measure=False, target="ros2_control")
    middle = ARM.middle()
    (tmp_path / "chained.cpp").write_text(CHAINED % ", ".join(map(repr, middle.tolist())))
    run("cc", "-std=c99", "-c", *(f"armgpi_{x}.c" for x in PARTS), folder=tmp_path)
    objects = [f"armgpi_{x}.o" for x in PARTS]
    flags = ["-std=c++17", *WARNINGS, "-DARMGPI_ROS2_STUBS", *WHERE, "-o", "chained"]
    run(need("g++"), *flags, "chained.cpp", *objects, folder=tmp_path)
    said = run("./chained", folder=tmp_path).splitlines()
    assert "stopping reference q1" in said
    assert said[-1] == "q2/velocity"
    log = logs.read(tmp_path / "motion.armlog")
    q_ref, v_ref, a_ref = (log.inputs[name] for name in ("q_ref", "v_ref", "a_ref"))
    np.testing.assert_array_equal(q_ref[:20], np.tile(middle, (20, 1)))
    k = log.samples["number"].astype(int) - 1
    moved = middle + (4e-6 * (k - 20) * (k - 20))[:, None]
    np.testing.assert_array_equal(q_ref[20:244], moved[20:244])
    np.testing.assert_array_equal(v_ref[20:244], np.tile(8e-3 * (k[20:244, None] - 20), 3))
    assert (a_ref == 0.0).all()
    np.testing.assert_array_equal(k[99:102], [99, 106, 107])
    assert log.samples["elapsed"].max() == 7
    assert log.fault is not None
    assert log.fault.startswith("0.251 s: REFERENCE")
    played = logs.replay(log, controller)
    assert played.status is None
    assert (played.difference <= 1e-12 * np.asarray(controller.effort)).all()


def test_the_docs_have_the_table_of_interfaces() -> None:
    docs = Path(__file__).parents[2] / "docs"
    assert "\n{{ interfaces_table }}\n" in (docs / "export.md").read_text()
    assert runpy.run_path(str(docs / "conf.py"))["myst_substitutions"]["interfaces_table"] == table()


def test_the_goal_of_the_readme_is_a_tenth_of_a_radian_or_a_quarter_of_the_range_from_the_middle() -> None:
    robot = ARM.with_limits(lower=[-2.0, -0.1, -1.0], upper=[1.0, 0.1, -0.6])
    controller: Any = types.SimpleNamespace(robot=robot, dt=1e-3)
    for target in ("fci", "ur", "ros2_control"):
        assert "-0.40,0.05,-0.70" in _running(controller, target)
    assert _running(controller, "bare") == ""


def test_the_readme_has_the_deceleration_of_the_supervisor(tmp_path: Path) -> None:
    export_controller(Supervised(GPI(ARM, 1e-3), Supervisor(deceleration=7.0)), tmp_path, measure=False)
    assert "a reference that decelerates at 7 rad/s^2" in (tmp_path / "README.md").read_text()


def test_stubs_are_compared_word_by_word(tmp_path: Path) -> None:
    tool = runpy.run_path(str(Path(__file__).parents[2] / "tools" / "headers.py"))
    for header, part in (each for stub in tool["STUBS"] for each in tool["sections"](stub)):
        (tmp_path / header).parent.mkdir(parents=True, exist_ok=True)
        with (tmp_path / header).open("a") as file:
            file.write(part)
    assert tool["compare"](tmp_path)[1] == []
    name = "hardware_interface/loaned_state_interface.hpp"
    (tmp_path / name).write_text("class LoanedStateInterface { double get_value() const; };")
    _, apart = tool["compare"](tmp_path)
    assert any("get_optional" in line for line in apart)
    assert all(line.startswith(name) for line in apart)


@compiled
def test_a_loop_for_ur_ends_in_a_fault(tmp_path: Path) -> None:
    export_controller(GPI(ur5(), 2e-3), tmp_path, measure=False, target="ur")
    said = run_python(LOOP, "ur", "-", 50, folder=tmp_path)
    assert said.startswith("fault not_finite shoulder_lift_joint")


@pytest.mark.parametrize(
    ("make", "target", "said"),
    [
        (lambda: GPI(ARM, 1e-3), "fci", "without gravity"),
        (lambda: GPI(ARM, 1e-3), "ur", "without gravity"),
        (
            lambda: GPI(ARM.with_gravity(ZERO).with_armature(0.1), 1e-3),
            "ur",
            "for 6 joints; this arm has 3",
        ),
        (
            lambda: PIDInversion(ARM.with_gravity(ZERO), 1e-3),
            "ros2_control",
            "bare for a controller that needs measured velocities",
        ),
        (lambda: GPI(panda(), 1e-3), "fci", "a torque_rate of at most 1000 N m/s"),
        (
            lambda: GPI(panda(), 2e-3),
            "fci",
            "for a sample time of 0.001 s, its robot's",
        ),
        (lambda: GPI(ur5().with_armature(0.0), 2e-3), "ur", "for a model with rotor inertia"),
        (
            lambda: GPI(panda().with_drives({"panda_joint3": {"encoder_side": "motor"}}), 1e-3),
            "fci",
            r"encoders at different sides .*panda_joint3: motor.*reads q \(link\) or theta \(motor\)",
        ),
        (lambda: GPI(with_jaw(6), 1e-3), "fci", r"this arm has 7, with 'jaw' of its gripper"),
        (lambda: GPI(with_jaw(5), 2e-3), "ur", "for 6 joints; this arm has 6, with 'jaw' of its gripper"),
        (lambda: GPI(named("übergelenk"), 1e-3), "ros2_control", "ROS would not find joint 'übergelenk'"),
        (lambda: GPI(ARM, 1e-3), "plc", "target must be one of bare, fci, ur, ros2_control"),
    ],
)
def test_a_target_that_would_hurt_is_refused(make: object, target: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=said):
        export_controller(make(), tmp_path / "new", target=target, measure=False)  # type: ignore[operator]
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("side", "position"),
    [(None, "q"), ("link", "q"), ("motor", "theta")],
    ids=["unspecified", "link", "motor"],
)
def test_a_franka_program_reads_the_positions_of_the_side_of_its_controller(
    side: str | None, position: str, tmp_path: Path
) -> None:
    robot = panda()
    if side is not None:
        robot = robot.with_drives({name: {"encoder_side": side} for name in robot.joint_names})
    rate = Supervisor(torque_rate=1000.0)
    export_controller(Supervised(GPI(robot, 1e-3), rate), tmp_path, measure=False, target="fci")
    other = {"q": "theta", "theta": "q"}[position]
    readme = (tmp_path / "README.md").read_text()
    assert f"**Positions** are `{position}` of the robot's state" in readme
    # libfranka's documents do not say where the motors' positions begin.
    assert ("is not documented" in readme) == (position == "theta")
    for name, words in (("fci.hpp", ("vector(robot.{})", 2)), ("fci.py", ("list(state.{})", 2))):
        text = (tmp_path / name).read_text()
        assert text.count(words[0].format(position)) == words[1]
        assert words[0].format(other) not in text


@pytest.mark.slow
def test_joints_without_a_side_have_the_usual_one_of_the_target(
    tmp_path: Path, cli: Callable[..., Answer]
) -> None:
    drives = tmp_path / "drives.yaml"
    for side in ("link", "motor"):
        drives.write_text(f"panda_joint3: {{encoder_side: {side}}}\n", encoding="utf-8")
        out = tmp_path / side
        answer = cli("export", "panda", "--target", "fci", "--drives", drives, "-o", out)
        assert answer.code == (0 if side == "link" else 2), answer.err
        if side == "link":
            assert "the program reads q, the positions of the links; --encoder-side motor for" in answer.err
            assert "list(state.q)" in (out / "fci.py").read_text(encoding="utf-8")
        else:
            assert "the program reads" not in answer.err
            assert "panda_joint3: motor" in answer.err


def test_gravity_by_the_robot_is_said_in_the_first_lines(tmp_path: Path) -> None:
    for gravity, said in ((None, "contains gravity"), (ZERO, "without gravity")):
        robot = ARM if gravity is None else ARM.with_gravity(gravity)
        export_controller(GPI(robot, 1e-3, feedforward="gravity"), tmp_path, measure=False)
        assert said in (tmp_path / "README.md").read_text().splitlines()[2]
        if gravity is not None:
            np.testing.assert_array_equal(robot.gravity(robot.middle()), np.zeros(3))


def test_a_gripper_that_is_controlled_with_the_arm_is_said_in_the_first_lines(tmp_path: Path) -> None:
    export_controller(GPI(with_jaw(5), 1e-3), tmp_path, measure=False, target="ros2_control")
    assert "`--lock jaw` at export" in (tmp_path / "README.md").read_text().splitlines()[4]


LIMIT = '<limit lower="0" upper="2.0" effort="1" velocity="9"/>'
OFF = "switched off at export"


@pytest.mark.parametrize("law", [GPI, PIDInversion])
@pytest.mark.parametrize(
    ("limit", "given", "without"),
    [
        (LIMIT, {}, {}),
        (LIMIT, {"torque_rate": 300.0}, {}),
        (LIMIT, {"speed": None}, {"speed": OFF}),
        (LIMIT, {"jump": 0.0, "saturated": 0.0}, {"jump": OFF, "saturated": OFF}),
        (
            "",
            {},
            {
                "jump": "no joint has a velocity limit",
                "position": "no joint has a position limit",
                "saturated": "no joint has a torque limit",
                "response": "no joint has a torque limit",
                "speed": "no joint has a velocity limit",
            },
        ),
    ],
)
def test_a_test_of_a_fault_has_it_or_says_why_there_is_none(
    law: type, limit: str, given: dict[str, float | None], without: dict[str, str]
) -> None:
    # The first joint turns without end: it has no position to be beyond.
    second = J("b", "L_a", "revolute" if limit else "continuous")
    joints = text(J("a", "base", "continuous"), second, arm=0)
    robot = Robot.from_xml(re.sub("<limit[^>]*/>", limit, joints))
    rows = fault_tests(Supervised(law(robot, 1e-3), Supervisor(**{"speed": 0.5, **given})))
    said = {row.split('"')[1]: row.split('"')[3] for row in rows if not row.endswith("NULL}")}
    assert said == without | {"cap": OFF, "workspace": OFF, "tool_speed": OFF, "tool_force": OFF}
    assert len(rows) == 14


def test_motions_tried_at_once_have_the_faults_that_they_have_one_by_one() -> None:
    robot = Robot.from_xml(text(J("a", "base", "continuous"), J("b", "L_a", "revolute"), arm=0))
    controller = Supervised(PIDInversion(robot, 1e-3), Supervisor(speed=0.5))
    assert fault_tests(controller) == fault_tests(controller, at_once=False)


@compiled
def test_a_stream_of_setpoints_is_interpolated_and_ends_in_a_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    export_controller(GPI(ARM, 1e-3), tmp_path, measure=False)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "armgpi_controller", raising=False)
    armgpi_controller: Any = importlib.import_module("armgpi_controller")
    middle, lower, upper = ARM.middle(), *ARM.limits[:2]

    def curve(t: float) -> list[list[float]]:
        at, w = 0.1 * (1.0 - np.cos(2.0 * t)), 2.0
        rows = (middle + at, 0.1 * w * np.sin(w * t), 0.1 * w * w * np.cos(w * t))
        return [np.broadcast_to(row, 3).tolist() for row in rows]

    moves, period, found = armgpi_controller.Moves(middle.tolist()), 40, []
    for k in range(800):
        if k % period == 0:  # the last of them is at 0.8 s, in motion
            setpoint, *rates = curve(1e-3 * (k + period))
            assert moves.via(setpoint, period, *rates)
        found.append(moves.next())
    asked = np.array([curve(1e-3 * (k + 1)) for k in range(800)])
    # A curve of degree 5 between setpoints: 1/720 of the sixth derivative times (T/2)^6, but for the start,
    # where the arm has no acceleration yet.
    later = slice(period, None)
    seen = np.array(found)[later]
    np.testing.assert_allclose(seen[:, 0], asked[later, 0], atol=0.1 * 2.0**6 * 0.02**6 / 720.0 + 1e-12)
    np.testing.assert_allclose(seen[:, 2], asked[later, 2], atol=1e-3)
    # It stops by itself, without a jump of velocity or acceleration, inside of the limits.
    while moves.moving:
        found.append(moves.next())
    q, v, a = (np.array([x[k] for x in found]) for k in range(3))
    np.testing.assert_allclose(np.diff(q, axis=0), 1e-3 * v[1:], atol=1e-3 * 1e-3 * np.abs(a).max())
    assert (np.abs(np.diff(a[period:], axis=0)) < 0.1).all()
    assert not v[-1].any()
    assert not a[-1].any()
    assert len(found) < 3000
    at = q[-1]
    assert ((at > lower) & (at < upper)).all()
    # What would leave the joint limits, in itself or by the stop after it, and what is too fast.
    rest = [0.0] * 3
    fast = (upper - at) / 0.04
    assert not moves.via((upper + 0.01).tolist(), 5000)
    assert not moves.via((upper - 1e-4).tolist(), 5000, [0.2] * 3)
    assert not moves.via((upper - 1e-4).tolist(), 40, fast.tolist())
    assert not moves.via([float("nan"), 0.0, 0.0], 40, rest)
    assert not moves.via(at.tolist(), 0, rest)
    assert not moves.moving
    # Two samples at once are twice one.
    other = armgpi_controller.Moves(middle.tolist())
    one = armgpi_controller.Moves(middle.tolist())
    for each in (other, one):
        assert each.via(*[curve(0.04)[0], 40, *curve(0.04)[1:]])
    for _ in range(300):
        one.next()
        np.testing.assert_allclose(np.array(other.next(2)), np.array(one.next()), atol=1e-12)
