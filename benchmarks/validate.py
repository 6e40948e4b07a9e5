"""How long `armgpi validate` takes: a right model of three joints, and one of four with a mistake.

python benchmarks/validate.py [--quick]
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import _page
import numpy as np
from _timing import spread, table

CORPUS = Path(__file__).parents[1] / "tests" / "validation"
sys.path.insert(0, str(CORPUS))

import textbooks  # noqa: E402

IMPORT = "`import pinocchio`"
PYTHON = "a right model of three joints, `armgpi.validate`"
COMMAND = "the same by `armgpi validate`"
MISTAKE = "four joints by Newton and Euler, a mistake"
#: A mistake in the last of these: what is there, and what has to be.
FORGOTTEN = ("dw + a[i] * AXIS +", "dw +")
#: What is timed, what in, and how much it may take.
GOALS = ((PYTHON, "times the import", 2.5), (COMMAND, "times the import", 2.5), (MISTAKE, "s", 20.0))


def main() -> None:
    page = _page.begin(__file__, "How long validate takes", "none, as nothing is simulated")
    rounds = 2 if page.quick else 7
    _page.say(
        f"Processor time of fresh processes and of those that they start [s], {rounds} rounds. Ratios are of "
        "the least times of this run; a load above 1 is other work on the machine."
    )
    with tempfile.TemporaryDirectory() as folder:
        commands = _commands(Path(folder))
        columns: dict[str, list[float]] = {name: [] for name in commands}
        for k in range(-1, rounds):  # a first round fills the caches
            for name, command in commands.items():
                seconds = _seconds(command, Path(folder))
                if k >= 0:
                    columns[name].append(seconds)
    times = {name: np.array(column) for name, column in columns.items()}
    page.figures["seconds"] = columns
    least = float(times[IMPORT].min())
    print()
    rows = [[name, spread(x), f"{x.min() / least:.2f}"] for name, x in times.items()]
    print(table(["", "s", "times the import"], rows))
    print("\n## Goals\n")
    rows = []
    for name, unit, most in GOALS:
        found = float(times[name].min()) / (1.0 if unit == "s" else least)
        rows.append([name, unit, f"{most:g}", f"{found:.2f}", "yes" if found <= most else "no"])
    print(table(["", "in", "at most", "found", "met"], rows))
    page.write()


def _commands(folder: Path) -> dict[str, tuple[str, ...]]:
    """Return what is timed, with its models and robots written into a folder."""
    model, robot = _written(folder, "rrr_christoffel", ("", ""))
    wrong, arm = _written(folder, "ne4", FORGOTTEN)
    program = f"import armgpi; assert armgpi.validate({model!r}, {robot!r}).agrees"
    return {
        IMPORT: ("-c", "import pinocchio"),
        PYTHON: ("-c", program),
        COMMAND: ("-m", "armgpi.cli", "validate", model, "--robot", robot),
        MISTAKE: ("-m", "armgpi.cli", "validate", wrong, "--robot", arm),
    }


def _written(folder: Path, arm: str, mistake: tuple[str, str]) -> tuple[str, str]:
    """Return the paths of a textbook's model, with a mistake, and of its robot."""
    right = textbooks.text(arm)
    old, new = mistake
    if old not in right:
        raise ValueError(f"{arm} has no {old!r}")
    model, robot = folder / f"{arm}.py", folder / f"{arm}.urdf"
    model.write_text(right.replace(old, new, 1) if old else right, encoding="utf-8")
    robot.write_text(textbooks.urdf(arm, right), encoding="utf-8")
    return str(model), str(robot)


def _seconds(command: tuple[str, ...], folder: Path) -> float:
    """Return the processor time of a fresh process [s], with that of the processes that it waited for."""
    env = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": ""}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen([sys.executable, *command], env=env, cwd=folder, **quiet)
    _, status, used = os.wait4(process.pid, 0)
    if os.waitstatus_to_exitcode(status) > 1:  # 1: the model differs
        raise RuntimeError(f"{command} failed")
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
