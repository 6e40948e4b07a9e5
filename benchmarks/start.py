"""Where the start of a command goes, held against importing Pinocchio.

python benchmarks/start.py [--quick]
"""

from __future__ import annotations

import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import _page
import numpy as np
from _timing import spread, table

BARE = """
import typer
app = typer.Typer(rich_markup_mode=None)
@app.command()
def one(x: int = 1): ...
@app.command()
def two(x: int = 1): ...
app()
"""
ARMGPI = ("-m", "armgpi.cli")
#: The first command of README.
README = ("run", "ur5", "--payload", "0.5", "--encoder-bits", "16", "--delay", "1")
COMMANDS = {
    "`import pinocchio`": ("-c", "import pinocchio"),
    "`import xarray`": ("-c", "import xarray"),
    "a bare Typer app, `--help`": ("-c", BARE, "--help"),
    "`armgpi --help`": (*ARMGPI, "--help"),
    "`armgpi robots`": (*ARMGPI, "robots"),
    "`armgpi inspect ur5`": (*ARMGPI, "inspect", "ur5"),
    "`armgpi new panda`": (*ARMGPI, "new", "panda", "--out", "panda.yaml", "--force"),
    "`armgpi run ur5`": (*ARMGPI, "run", "ur5"),
    "`armgpi run ur5 --out FOLDER`": (*ARMGPI, "run", "ur5", "--out", "out"),
    "`armgpi run ur5`, compiled before": (*ARMGPI, "run", "ur5", "--backend", "compiled"),
    "README's `armgpi run`": (*ARMGPI, *README),
    "README's `armgpi run`, nothing kept": (*ARMGPI, *README),
    "`armgpi export ur5`": (*ARMGPI, "export", "ur5", "--out", "ur5"),
    "`armgpi export ur5`, nothing kept": (*ARMGPI, "export", "ur5", "--out", "ur5"),
    "`armgpi export panda --target fci`": (*ARMGPI, "export", "panda", "--target", "fci", "--out", "panda"),
    "`armgpi export` of a file that `new` wrote": (*ARMGPI, "export", "panda.yaml", "--out", "panda"),
    "`armgpi run ur5 --backend compiled`, nothing kept": (*ARMGPI, "run", "ur5", "--backend", "compiled"),
    "`armgpi bound ur5`": (*ARMGPI, "bound", "ur5"),
    "`armgpi compare ur5 --report`": (*ARMGPI, "compare", "ur5", "--report", "page.html"),
    "`armgpi play ur5`, nothing kept": (*ARMGPI, "play", "ur5", "-o", "play.html"),
    "`armgpi identify`, 20 s of log": (
        *(*ARMGPI, "identify", "log/rollout.nc", "--robot", "ur5", "--out", "found"),
    ),
}
#: What is run once in the folder of a command, before it is timed.
BEFORE = {
    "`armgpi export` of a file that `new` wrote": ((*ARMGPI, "new", "panda", "--out", "panda.yaml"),),
    "`armgpi identify`, 20 s of log": (
        (*ARMGPI, "excite", "ur5", "--first", "--seconds", "20", "--out", "first"),
        (*ARMGPI, "run", "first/experiment.yaml", "--out", "log"),
    ),
}
#: Whose folder is emptied before every round: the others find what the round before them kept.
COLD = (
    "README's `armgpi run`, nothing kept",
    "`armgpi run ur5 --backend compiled`, nothing kept",
    "`armgpi play ur5`, nothing kept",
    "`armgpi export ur5`, nothing kept",
)
PINOCCHIO, BARE_HELP = "`import pinocchio`", "a bare Typer app, `--help`"
#: What is timed -> what it is held against, and how many times as long it may take.
GOALS = {
    "`armgpi --help`": (BARE_HELP, 1.5),
    "`armgpi inspect ur5`": (PINOCCHIO, 3.5),
    "`armgpi new panda`": (PINOCCHIO, 4.5),
    "`armgpi run ur5`": (PINOCCHIO, 4.0),
    "README's `armgpi run`": (PINOCCHIO, 4.5),
    "README's `armgpi run`, nothing kept": (PINOCCHIO, 7.0),
    "`armgpi export ur5`": (PINOCCHIO, 10.0),
    "`armgpi export ur5`, nothing kept": (PINOCCHIO, 10.0),
    "`armgpi export panda --target fci`": (PINOCCHIO, 12.0),
    "`armgpi export` of a file that `new` wrote": (PINOCCHIO, 6.3),
    "`armgpi run ur5 --backend compiled`, nothing kept": (PINOCCHIO, 7.0),
    "`armgpi bound ur5`": (PINOCCHIO, 15.0),
    "`armgpi compare ur5 --report`": (PINOCCHIO, 12.0),
    "`armgpi play ur5`, nothing kept": (PINOCCHIO, 40.0),
    "`armgpi identify`, 20 s of log": (PINOCCHIO, 15.0),
}
#: Packages that have a row of their own in the split of a start; the smaller ones are added up.
SHOWN = 8


def main() -> None:
    page = _page.begin(__file__, "Where a start goes", "that of each command")
    rounds = 2 if page.quick else 7
    _page.say(
        f"Processor time of fresh processes and of the compilers that they call [s], {rounds} rounds in "
        "turns. Ratios are of the least times: what else the machine does only adds. What the round before "
        "kept on the disk is found, but where a row says that nothing is."
    )
    folders = {name: Path(tempfile.mkdtemp()) for name in COMMANDS}
    times = _times(rounds, folders)
    page.figures["seconds"] = {name: column.tolist() for name, column in times.items()}
    rows = []
    for name, column in times.items():
        rows.append([name, spread(column), _ratio(times, name, PINOCCHIO)])
    print()
    print(table(["", "s", "times `import pinocchio`"], rows))
    print("\n## Goals\n")
    rows = []
    for name, (against, bound) in GOALS.items():
        found = _ratio(times, name, against)
        rows.append([name, against, f"{bound:g}", f"{found:.2f}", "yes" if found <= bound else "no"])
    print(table(["", "against", "at most", "found", "met"], rows))
    print("\n## Where `armgpi run ur5` goes\n")
    print(_split("`armgpi run ur5`", times, folders))
    for folder in folders.values():
        shutil.rmtree(folder)
    page.write()


def _ratio(times: dict[str, np.ndarray], name: str, against: str) -> float:
    """Return how many times as long one takes as another."""
    return round(float(times[name].min() / times[against].min()), 2)


def _times(rounds: int, folders: dict[str, Path]) -> dict[str, np.ndarray]:
    """Return the processor times of all commands, in turns, after a first round that fills the caches."""
    taken: dict[str, list[float]] = {name: [] for name in COMMANDS}
    for name, every in BEFORE.items():
        for words in every:
            _run(words, folder=folders[name])
    for k in range(-1, rounds):
        for name, words in COMMANDS.items():
            if name in COLD:
                shutil.rmtree(folders[name])
                folders[name].mkdir()
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            _run(words, folder=folders[name])
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            if k >= 0:
                spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
                taken[name].append(spent)
    return {name: np.array(column) for name, column in taken.items()}


def _run(words: tuple[str, ...], *flags: str, folder: Path) -> str:
    """Run Python with some words in a folder, which has its generated code, and return its standard error.

    Raises:
        RuntimeError: when the command refuses them or fails: that would be timed for nothing.
    """
    # With its bytecode kept, as everywhere; some containers forbid that.
    env = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "", "ARMGPI_CACHE": str(folder)}
    command = [sys.executable, *flags, *words]
    done = subprocess.run(command, env=env, cwd=folder, capture_output=True, text=True)
    if done.returncode == 2 or "Traceback" in done.stderr:
        raise RuntimeError(f"{' '.join(words)}: {done.stderr}")
    return done.stderr


def _split(command: str, times: dict[str, np.ndarray], folders: dict[str, Path]) -> str:
    """Return a table of the time that each package's modules take to import, and of the rest."""
    modules: dict[str, float] = {}
    for _ in times[command]:
        said = _run(COMMANDS[command], "-X", "importtime", folder=folders[command])
        for self_time, name in re.findall(r"import time:\s+(\d+) \|\s+\d+ \|\s+(\S+)", said):
            modules[name] = min(float(self_time) * 1e-6, modules.get(name, np.inf))
    found: Counter[str] = Counter()
    for name, self_time in modules.items():
        package = name.partition(".")[0]
        found["Python's own" if package in sys.stdlib_module_names else package] += self_time
    first = float(times[PINOCCHIO].min())
    rows = [[name, f"{t:.3f}", f"{t / first:.2f}"] for name, t in found.most_common(SHOWN)]
    others = sum(found.values()) - sum(t for _, t in found.most_common(SHOWN))
    rest = max(0.0, float(times[command].min()) - sum(found.values()))
    for name, t in (("other imports", others), ("the run itself: robot, loop, metrics, table", rest)):
        rows.append([name, f"{t:.3f}", f"{t / first:.2f}"])
    return table(["", "s", "times `import pinocchio`"], rows)


if __name__ == "__main__":
    main()
