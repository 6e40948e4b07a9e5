"""Runs exported controllers on an emulated Cortex-M7, and compares bits and instructions: `make arm`.

Single precision has to give the bits of this machine, double precision the same to rounding (the sines of two
libraries differ in their last digit). The instructions of a step, counted by QEMU, may be at worst 1.6 times
the typical ones, over inputs that include torque at its limits, a missing measurement, and starts from all
over the joints' ranges; feedforward of the model may take 1.35 times as many as none. It needs
qemu-system-arm and arm-none-eabi-gcc with newlib; without them it says so, and is done.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from armgpi import GPI, Robot
from armgpi.hardware.export.code import generate

HERE = Path(__file__).parent / "arm"
#: Robot -> its locked joints; and feedforwards of a law: that of the model has the model's torque at the
#: reference beside it.
ROBOTS = {"anthropomorphic3": (), "ur5": (), "panda": ("panda_finger_joint1", "panda_finger_joint2")}
FEEDFORWARDS = ("none", "model")
#: What `drive.c` calls the arguments of a step.
GIVEN = {"q_measured": "q", "q_ref": "r", "v_ref": "v", "a_ref": "a"}
TOOLS = ("qemu-system-arm", "arm-none-eabi-gcc", "cc")
CORE = ("-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-d16", "-mfloat-abi=hard")
#: QEMU's clock advances by 1 ns for each instruction, and SysTick counts at 25 MHz.
INSTRUCTIONS_PER_TICK = 40
#: Largest difference in double precision, as a share of the torque limits; and of instructions, at worst over
#: typical ones, and with feedforward over without.
ROUNDING, WORST, MODEL = 1e-12, 1.6, 1.35
SECONDS = 300


class Outcome(NamedTuple):
    """What the two machines gave."""

    same: bool
    apart: float
    typical: float
    worst: float


def main() -> int:
    """Compare all; return 1 when something is not as it should be."""
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    if missing:
        print(
            f"skipped: {', '.join(missing)} not installed (apt install qemu-system-arm gcc-arm-none-eabi "
            "libnewlib-arm-none-eabi)"
        )
        return 0
    failed = False
    for name in ROBOTS:
        for real in ("float", "double"):
            without = None
            for feedforward in FEEDFORWARDS:
                found = compared(name, real, feedforward)
                without = without or found.typical
                ratio, more = found.worst / found.typical, found.typical / without
                good = ratio <= WORST and (found.same if real == "float" else found.apart <= ROUNDING)
                good &= more <= MODEL
                failed |= not good
                bits = "same bits" if found.same else f"{found.apart:.1e} of the torque limits apart"
                counts = (
                    f"{found.typical:.0f} instructions ({more:.2f}), at worst {found.worst:.0f} ({ratio:.2f})"
                )
                said = "ok" if good else "NOT AS IT SHOULD BE"
                print(f"{name:16} {feedforward:5} {real:6}  {bits:42} {counts} {said}")
    return int(failed)


def compared(name: str, real: str, feedforward: str) -> Outcome:
    """Run one controller on both machines."""
    robot = Robot.load(name, lock=list(ROBOTS[name]))
    code = generate(GPI(robot, 1e-3, feedforward=feedforward), real)
    given = ", ".join(GIVEN[argument] for argument in code.law.inputs)
    with tempfile.TemporaryDirectory(prefix="armgpi-arm-") as made:
        folder = Path(made)
        (folder / "armgpi_controller.h").write_text(code.header)
        (folder / "armgpi_controller.c").write_text(code.source)
        middle = ",".join(map(repr, robot.middle().tolist()))
        common = (
            "-std=c99",
            "-O2",
            "-ffp-contract=off",
            "-I.",
            f"-DMIDDLES={middle}",
            "-DSPREAD=1.0",
            f"-DGIVEN={given}",
        )
        sources = (str(HERE / "drive.c"), "armgpi_controller.c")
        run(["cc", *common, *sources, "-o", "host", "-lm"], folder)
        start = run(["arm-none-eabi-gcc", *CORE, "-print-file-name=rdimon-crt0.o"], folder).strip()
        linked = ("-nostartfiles", "--specs=rdimon.specs", "-T", str(HERE / "mps2.ld"), start)
        run(
            [
                "arm-none-eabi-gcc",
                *CORE,
                "-DTARGET",
                *common,
                *sources,
                str(HERE / "vectors.c"),
                *linked,
                "-o",
                "arm.elf",
                "-lm",
            ],
            folder,
        )
        emulator = ("qemu-system-arm", "-M", "mps2-an500", "-nographic", "-semihosting", "-icount", "shift=0")
        host, arm = run(["./host"], folder), run([*emulator, "-kernel", "arm.elf"], folder)
    (status, _, ours), (other, ticks, theirs) = (parsed(text, real) for text in (host, arm))
    if not np.array_equal(status, other):
        raise SystemExit(f"{name}, {real}: the two machines are in different states")
    apart = float((np.abs(ours - theirs) / robot.limits.effort).max())
    counted = ticks * INSTRUCTIONS_PER_TICK
    return Outcome(np.array_equal(ours, theirs), apart, float(np.median(counted)), float(counted.max()))


def parsed(text: str, real: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return status, ticks and torques of every step."""
    rows = [line.split() for line in text.splitlines() if line]
    bits = np.array([[int(word, 16) for word in row[2:]] for row in rows], dtype=np.uint64)
    tau = (
        bits.astype(np.uint32).view(np.float32).astype(np.float64)
        if real == "float"
        else bits.view(np.float64)
    )
    return np.array([int(row[0]) for row in rows]), np.array([int(row[1]) for row in rows]), tau


def run(command: list[str], folder: Path) -> str:
    """Run a program and return what it printed."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=SECONDS, check=False)
    if done.returncode:
        raise SystemExit(f"{command[0]} failed:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
