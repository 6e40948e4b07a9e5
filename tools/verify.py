"""Proves by abstract interpretation what a step of exported C can do: `make verify`.

Frama-C's EVA runs one step from any state and with any arguments within bounds, all at once. Torques have to
be proved finite and within their limits, and there may be no alarm: no undefined behaviour, and no number
that is not finite. It needs frama-c; without it, it says so, and is done.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from armgpi import GPI, Robot
from armgpi.hardware.export.code import generate

HERE = Path(__file__).parent / "arm"
#: Others by name, as they take minutes.
ROBOTS = ("anthropomorphic3", "ur5")
RANGE = "1e6"
SECONDS = 900


def main() -> int:
    """Verify all; return 1 when something is not proved."""
    if shutil.which("frama-c") is None:
        print("skipped: frama-c not installed (apt install frama-c-base)")
        return 0
    results = [verified(name) for name in sys.argv[1:] or ROBOTS]
    return int(not all(results))


def verified(name: str) -> bool:
    """Analyse the controller of one robot; tell whether all is proved."""
    code = generate(GPI(Robot.load(name), 1e-3))
    numbers = sum(len(part.symbols) for part in code.law.state)
    with tempfile.TemporaryDirectory(prefix="armgpi-verify-") as made:
        folder = Path(made)
        (folder / "armgpi_controller.h").write_text(code.header)
        (folder / "armgpi_controller.c").write_text(code.source)
        (folder / "verify.c").write_text((HERE / "verify.c").read_text())
        options = ["-eva", "-eva-precision", "1", "-eva-no-show-progress"]
        options += ["-warn-special-float", "non-finite"]
        options.append(f"-cpp-extra-args=-DNUMBERS={numbers}U -DRANGE={RANGE}")
        done = subprocess.run(
            ["frama-c", *options, "verify.c"],
            cwd=folder,
            env={**os.environ, "PWD": made},  # by which it finds files
            capture_output=True,
            text=True,
            timeout=SECONDS,
            check=False,
        )
    said = done.stdout
    asserted = re.search(r"Assertions\s+(\d+) valid\s+(\d+) unknown\s+(\d+) invalid", said)
    if done.returncode or asserted is None:
        print(said[-2000:])
        raise SystemExit("frama-c failed")
    proved = asserted[2] == asserted[3] == "0" and int(asserted[1]) > 0
    lines = code.source.splitlines()
    places = sorted({int(line) for line in re.findall(r"\[eva:alarm\] armgpi_controller\.c:(\d+)", said)})
    alarms = said.count("[eva:alarm]")
    verdict = "proved" if proved else "NOT PROVED"
    print(f"{name}: torques {verdict} finite and within their limits; {alarms} alarms")
    for line in places:
        print(f"  armgpi_controller.c:{line}: {lines[line - 1].strip()}")
    return proved and not alarms


if __name__ == "__main__":
    sys.exit(main())
