"""Sweeps under random signals end with the bytes of an unbroken run: `tools/sweep_signals.py --runs 20`.

Each run starts `armgpi sweep` again and again, and sends SIGINT, SIGTERM or SIGKILL at a random moment of its
processor time, until one ends by itself. Prints how many runs ended with the same bytes, how many signals
were sent, and exit codes other than those of the signals. A SIGINT while Python itself starts, before it
comes to the program, ends in -2, or in 1 and a message of Python's.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

STUDY = """
robot: {name: anthropomorphic3}
plant: {encoder_bits: 14, delay: 1}
controllers: [{type: gpi, omega: 20}]
reference: {points: [[0, 0.3, 0], [0.1, 0.4, -0.1]], durations: 0.15, holds: [0.02, 0.1]}
t_final: 0.25
vary:
  plant.payload.mass: {uniform: [0.0, 0.3]}
  plant.delay: {choices: [0, 1, 2]}
  controller.inertia_scale: {log_uniform: [0.8, 1.3]}
failure: {peak_error: 0.05}
"""
#: What is sent, and the exit code that says so.
CODES = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -9}


def started(file: Path, out: Path, rollouts: int) -> subprocess.Popen[bytes]:
    """Start a sweep that takes signals, even where a shell started this in the background without SIGINT."""
    code = "from armgpi.cli import main; main()"
    command = [sys.executable, "-c", code, "sweep", str(file), "--out", str(out), "--rollouts", str(rollouts)]
    with (out.parent / "stderr").open("wb") as errors:
        return subprocess.Popen(
            command,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )


def spent(process: subprocess.Popen[bytes]) -> float:
    """Return the processor time of a process so far [s], of which a busy machine takes no more."""
    ticks = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")


def contents(folder: Path) -> dict[str, str]:
    """Return the hashes of the files but for what a killed process had not written whole."""
    found = [path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".")]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in found}


def main() -> None:
    """Run sweeps and print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--rollouts", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    chance, sent, others, same = random.Random(asked.seed), 0, Counter[str](), 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file = folder / "study.yaml"
        file.write_text(STUDY)
        started(file, folder / "whole", asked.rollouts).wait()
        before = sum(os.times()[2:4])
        started(file, folder / "timed", asked.rollouts).wait()
        long, whole = sum(os.times()[2:4]) - before, contents(folder / "whole")
        for run in range(asked.runs):
            while True:
                process = started(file, folder / str(run), asked.rollouts)
                number = chance.choice(list(CODES))
                moment = 1.2 * long * chance.random()
                while process.poll() is None and spent(process) < moment:
                    time.sleep(0.005)
                if process.returncode is None:
                    process.send_signal(number)
                    sent += 1
                if (code := process.wait()) == 0:
                    break
                # A signal before Python has its handlers ends it as any other program; before it has imported
                # what it starts with, SIGINT ends it in 1.
                said = (folder / "stderr").read_bytes()
                starting = code == 1 and said.startswith(b"Fatal Python error: init_")
                if code not in (CODES[number], -number) and not starting:
                    others[f"{number.name}: {code}: {said[-200:].decode(errors='replace')}"] += 1
            same += contents(folder / str(run)) == whole
    print(
        f"{same} of {asked.runs} ended with the same bytes, {sent} signals sent, "
        f"other exit codes: {dict(others)}"
    )


if __name__ == "__main__":
    main()
