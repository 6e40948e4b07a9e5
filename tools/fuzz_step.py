"""Hammers steps of exported C with samples of any bits, under the sanitizers: `python tools/fuzz_step.py`.

    python tools/fuzz_step.py --count 1000000 --robots ur5 panda

Of each robot and number type so many samples are taken, with damaged memory in between. Every torque has to
be finite, within its limit and its rate, and nothing may be undefined. It needs gcc.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from armgpi import GPI, Robot, Supervisor
from armgpi.hardware.export.code import generate

SOURCE = Path(__file__).parents[1] / "tests" / "hardware" / "fuzz.c"
#: Robot -> its locked joints.
ROBOTS = {"anthropomorphic3": (), "ur5": (), "panda": ("panda_finger_joint1", "panda_finger_joint2")}
SANITIZERS = ("-g", "-O1", "-std=gnu99", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
DT, RATE = 1e-3, 300.0


def main() -> int:
    """Fuzz all; return 1 when something was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1_000_000, help="samples of each")
    parser.add_argument("--robots", nargs="*", choices=ROBOTS, default=list(ROBOTS))
    chosen = parser.parse_args()
    good = True
    for name in chosen.robots:
        for real in ("double", "float"):
            code, said = fuzzed(name, real, chosen.count)
            good &= code == 0
            print(
                f"{name}, {real}, {chosen.count:,} samples: {'ok' if code == 0 else 'WRONG'}; {said}",
                flush=True,
            )
    return int(not good)


def fuzzed(name: str, real: str, count: int) -> tuple[int, str]:
    """Return the exit code of one fuzzer, and what it said."""
    law = GPI(Robot.load(name, lock=list(ROBOTS[name])), DT)
    made = generate(law, real, Supervisor(jump=50.0, torque_rate=RATE))
    arrays = ", ".join(f"in[{i}]" for i in range(len(made.law.inputs)))
    defines = (
        f"#define SAMPLES {count}\n#define ARGUMENTS {len(made.law.inputs)}\n"
        f"#define MOST {1.0001 * RATE * DT!r}\n"
        f"#define STEP(state, tau) armgpi_step(state, {arrays}, tau)\n"
        f"#define INIT(state) (void)armgpi_reset(state, {arrays})\n"
    )
    with tempfile.TemporaryDirectory(prefix="armgpi-fuzz-") as folder:
        texts = {"armgpi_controller.h": made.header, "armgpi_controller.c": made.source}
        for file, text in {**texts, "fuzz.c": defines + SOURCE.read_text()}.items():
            (Path(folder) / file).write_text(text)
        command = ["gcc", *SANITIZERS, "-o", "fuzz", "fuzz.c", "armgpi_controller.c", "-lm"]
        subprocess.run(command, cwd=folder, check=True)
        done = subprocess.run(["./fuzz"], cwd=folder, capture_output=True, text=True, check=False)
    return done.returncode, (done.stdout + done.stderr).strip()[-2000:]


if __name__ == "__main__":
    sys.exit(main())
