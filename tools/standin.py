"""Run the files of an export, unchanged, beside a simulated robot: before there is a real one.

    armgpi export panda --target fci -o franka
    python tools/standin.py franka 0.3,0.2,0.1,-1.2,0.2,2.1,0.3
    python tools/standin.py franka 0.3,0.2,0.1,-1.2,0.2,2.1,0.3 --cpp

The arm is the plant of the folder's experiment.yaml, at rest where its reference begins; the libraries of
the robot are stubs (tests/hardware/stubs), compared with public headers by tools/headers.py. Without `--cpp`
it runs fci.py or ur.py; with it the example program, built by the folder's own CMakeLists.txt. Of
ros2_control it builds the plugin and a manager that activates it, and ends when the arm rests. It proves
nothing about a library's ABI, nor about a robot.
"""

from __future__ import annotations

import argparse
import io
import runpy
import signal
import socket
import struct
import subprocess
import sys
import tempfile
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from armgpi import config

STUBS = Path(__file__).resolve().parent.parent / "tests" / "hardware" / "stubs"
#: Samples of a run at most, and those of an arm of ros2_control, whose program does not end by itself.
MOST, STEADY = 60_000, 500
#: At rest [rad/s].
RESTS = 1e-3
#: What a robot says of its software.
VERSION = "5.26.0"
FLAGS = ("-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror", "-O1")


class Arm:
    """A simulated arm that takes torques, and gives positions with the encoders and delays of its plant."""

    def __init__(
        self,
        plant: Any,
        dt: float,
        start: Any,
        broken: int = 0,
        once: bool = False,
        loss: float = 0.0,
        flight: int = 0,
        ctrl_c: int = 0,
    ) -> None:
        self.plant, self.dt, self.broken, self.once, self.loss = plant, dt, broken, once, loss
        self.ctrl_c, self.interrupt = ctrl_c, partial(signal.raise_signal, signal.SIGINT)
        self.flying: list[Any] = [None] * flight
        self.draw = np.random.default_rng(0).random
        self.state = plant.init(np.asarray(start, dtype=float), np.zeros(len(start)))
        self.last, self.rate, self.count = np.zeros(len(start)), 0.0, 0

    def measured(self) -> list[float]:
        """Return the positions; of a broken encoder NaN, once or from a sample on."""
        q: list[float] = self.plant.measure(self.state).q.tolist()
        if self.broken and (self.count == self.broken if self.once else self.count >= self.broken):
            q[1] = float("nan")
        return q

    def apply(self, tau: Any) -> None:
        """Hold a torque for a sample."""
        tau = np.asarray(tau, dtype=float)
        self.rate = max(self.rate, float(np.abs(tau - self.last).max()) / self.dt)
        self.last, self.state = tau, self.plant.step(tau, self.state, self.dt)
        self.count += 1
        if self.count == self.ctrl_c:
            self.interrupt()
        if self.count > MOST:
            raise SystemExit(f"no end after {MOST * self.dt:g} s")

    def wait(self) -> int:
        """Wait for a packet that is not lost; return how many sample times passed since the last one."""
        passed = int(self.count > 0)
        while passed and self.draw() < self.loss:
            self.send(None)
            passed += 1
        return passed

    def send(self, tau: Any) -> None:
        """Send a torque; what is lost leaves the last one, and others are late by those in flight."""
        self.flying.append(None if tau is None or self.draw() < self.loss else tau)
        arrived = self.flying.pop(0)
        self.apply(self.last if arrived is None else arrived)

    def report(self, goal: str) -> str:
        """Return how far from a goal it is, how fast, and the largest change of torque."""
        truth = self.plant.true_state(self.state)
        away = np.abs(truth.q - np.array([float(x) for x in goal.split(",")])).max() if goal != "-" else 0.0
        speed = np.abs(truth.v).max()
        return (
            f"away {away:.2g} rad from the goal, speed {speed:.2g} rad/s, rate {self.rate:.9g} N m/s at most"
        )


def arm_of(folder: Path) -> Arm:
    """Return the arm of the experiment that a folder was exported from."""
    experiment = config.build(config.read(folder / "experiment.yaml").config)
    controller = next(iter(experiment.controllers.values()))
    return Arm(experiment.plant, controller.dt, experiment.reference.at(np.zeros(1)).q[0])


class _Robot:
    """The robots of pylibfranka 0.21.3 and ur_rtde 1.6.5; both have one arm."""

    arm: Arm

    def __init__(self, *given: Any) -> None:
        """Take an address."""

    def set_collision_behavior(self, *given: list[float]) -> None:
        print("contact", given[0][0], "force", given[2][0], file=sys.stderr)

    def set_load(self, mass: float, centre: list[float], inertia: list[float]) -> None:
        print("load", mass, centre, len(inertia), file=sys.stderr)

    def automatic_error_recovery(self) -> None:
        print("recover", file=sys.stderr)

    def start_torque_control(self) -> _Robot:
        return self

    def readOnce(self) -> tuple[Any, Any]:
        passed = 0.001 * self.arm.wait()
        positions = self.arm.measured()  # of the side that the simulated encoders sit at
        seen = SimpleNamespace(q=positions, theta=positions, tau_J_d=self.arm.last.tolist())
        return seen, SimpleNamespace(to_sec=lambda: passed)

    def writeOnce(self, command: Any) -> None:
        self.arm.send(command.tau)

    def stop(self) -> None:
        print("stopped", file=sys.stderr)

    def getActualQ(self) -> list[float]:
        return self.arm.measured()

    def getTimestamp(self) -> float:
        return self.arm.dt * (self.arm.count - (self.arm.count % 50 == 40))  # some packets come twice

    def initPeriod(self) -> None:
        """Begin a period."""

    def directTorque(self, tau: Any, viscous_scale: Any, coulomb_scale: Any) -> bool:
        self.arm.apply(tau)
        return len(viscous_scale) == len(coulomb_scale) == 6

    def waitPeriod(self, begun: None) -> None:
        """End a period."""

    def stopScript(self) -> None:
        print("stopped", file=sys.stderr)


class _Wire(io.BytesIO):
    """A connection whose answer is there already."""

    def sendall(self, data: bytes) -> None:
        assert struct.unpack(">HB", data) == (3, 118)

    def makefile(self, mode: str) -> _Wire:
        return self


def run_python(folder: Path, arm: Arm, words: list[str], version: str = VERSION) -> int:
    """Run fci.py or ur.py beside stand-ins of pylibfranka 0.21.3 and ur_rtde 1.6.5; its exit code.

    What stands in is taken away after it, and so are the modules of the folder.
    """
    _Robot.arm = arm
    said = struct.pack(">HB4I", 19, 118, *map(int, version.split(".")), 0)
    made: Any = SimpleNamespace
    modules: dict[str, Any] = {
        "pylibfranka": made(Robot=_Robot, Torques=lambda tau: made(tau=tau, motion_finished=False)),
        "rtde_control": made(RTDEControlInterface=_Robot),
        "rtde_receive": made(RTDEReceiveInterface=_Robot),
    }
    script = "fci.py" if (folder / "fci.py").exists() else "ur.py"
    usual = socket.create_connection, sys.argv, sys.path
    sys.modules.update(modules)
    socket.create_connection = lambda address, timeout: _Wire(said)  # type: ignore[assignment, misc]
    sys.argv = [script, "127.0.0.1", *words]
    sys.path = [str(folder), *sys.path]
    try:
        runpy.run_path(str(folder / script), run_name="__main__")
    except SystemExit as ended:
        if not isinstance(ended.code, int):
            raise
        return ended.code
    finally:
        socket.create_connection, sys.argv, sys.path = usual
        for name in (*modules, "armgpi_controller", "goals"):
            sys.modules.pop(name, None)
    return 0


def build(folder: Path, made: Path) -> Path:
    """Build the program of a folder beside the stubs, and return it."""
    if (folder / "package.xml").exists():
        sources = [str(folder / f"armgpi_{x}.c") for x in ("controller", "move", "follow", "log")]
        run(["cc", "-std=c99", "-O2", "-ffp-contract=off", "-c", *sources], made)
        objects = [f"armgpi_{x}.o" for x in ("controller", "move", "follow", "log")]
        where = [f"-I{folder / x}" for x in ("", "include")] + [f"-I{STUBS}"]
        source = str(STUBS / "ros2_manager.cpp")
        run(["g++", *FLAGS, "-DARMGPI_ROS2_STUBS", *where, source, *objects, "-o", "program"], made)
        return made / "program"
    run(["cmake", "-S", str(folder), "-B", ".", f"-DCMAKE_PREFIX_PATH={STUBS}"], made)
    name = "armgpi_fci" if (folder / "fci.cpp").exists() else "armgpi_ur"
    run(["cmake", "--build", ".", "--target", name], made)
    return made / name


def run(command: list[str], folder: Path) -> None:
    """Run a program that has to succeed."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)} failed:\n{done.stdout[-3000:]}{done.stderr[-3000:]}")


def run_cpp(folder: Path, arm: Arm, words: list[str], version: str = VERSION) -> int:
    """Build the program of a folder and run it at the other end of a pipe; its exit code."""
    with tempfile.TemporaryDirectory(prefix="armgpi-standin-") as made:
        program = build(folder, Path(made))
        plugin = (folder / "package.xml").exists()
        command = [str(program), *([] if plugin else [version]), *words]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdin is not None
            assert process.stdout is not None
            arm.interrupt = partial(process.send_signal, signal.SIGINT)
            still, answer = 0, "begin"
            while answer and still <= STEADY:
                if answer.startswith("tau"):
                    arm.send(answer.split()[1:])
                    resting = plugin and np.abs(arm.plant.true_state(arm.state).v).max() < RESTS
                    still = still + 1 if resting else 0
                if answer.startswith(("begin", "tau")):
                    packet = " ".join(repr(float(x)) for x in packet_of(arm, program.name))
                    with suppress(BrokenPipeError):  # it has ended
                        print(packet, file=process.stdin, flush=True)
                else:
                    print(answer.strip())
                answer = process.stdout.readline()
            with suppress(BrokenPipeError):
                process.stdin.close()
        return process.returncode


def packet_of(arm: Arm, program: str) -> list[float]:
    """Return what a program's stub reads of the arm."""
    passed = arm.wait()
    if program == "armgpi_ur":  # the robot's time
        return [arm.dt * arm.count, *arm.measured()]
    if program == "armgpi_fci":  # milliseconds since the last packet, and the torque that is applied
        return [float(passed), *arm.measured(), *arm.last]
    return [arm.dt * max(passed, 1), *arm.measured()]


def main() -> int:
    """Run, and say where the arm ended."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("folder", type=Path)
    options.add_argument("--cpp", action="store_true", help="the example program in place of the script")
    options.add_argument("--loss", type=float, default=0.0, help="share lost, each way (not of ur.py)")
    options.add_argument("--flight", type=int, default=0, help="commands in flight (not of ur.py)")
    options.add_argument("--ctrl-c", type=int, default=0, help="Ctrl-C after so many samples; ~/stop in ROS")
    options.add_argument("--version", default=VERSION, help="software of the robot (ur)")
    known, words = options.parse_known_args()
    folder = known.folder.resolve()
    arm = arm_of(folder)
    arm.loss, arm.flying, arm.ctrl_c = known.loss, [None] * known.flight, known.ctrl_c
    if known.cpp or (folder / "package.xml").exists():
        code = run_cpp(folder, arm, words, known.version)
    else:
        code = run_python(folder, arm, words, known.version)
    goals = [word for word in words if word.count(",") == len(arm.last) - 1]
    print(arm.report(goals[-1] if goals else "-"))
    return code


if __name__ == "__main__":
    sys.exit(main())
