"""Timing of contenders against each other, on a machine that does other things as well.

The speed of a machine drifts, so contenders take turns: in every round each is called once, and what is
compared are the times within a round. A figure is the median over the rounds, with the least and the
greatest; a ratio is the median of the ratios of each round. Work on one thread is timed by the processor
time it takes, so that it does not matter who else had a turn meanwhile; work on several, by wall time.
"""

from __future__ import annotations

import gc
import os
import platform
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.codegen import build
from armgpi.errors import BackendError
from armgpi.robot.dynamics import cores

#: Share of a core that each of two threads has to get: 0.86 on an idle machine, 0.5 beside one busy process.
QUIET = 0.75


class Contender(NamedTuple):
    """Something to be timed.

    Attributes:
        run: does the work once and returns its result.
        units: how many units of work that is, such as control steps.
        check: raises when the result is not right; called after every run, outside of the timing.
        threads: on how many threads it works.
    """

    run: Callable[[], Any]
    units: int
    check: Callable[[Any], None] = lambda result: None
    threads: int = 1


class Samples(NamedTuple):
    """Times of one contender, one per round.

    Attributes:
        times: microseconds per unit.
        cores: processor time over wall time: 1 when a single thread had a core for itself.
    """

    times: npt.NDArray[np.float64]
    cores: npt.NDArray[np.float64]


class Spread(NamedTuple):
    """Median, least and greatest of some numbers."""

    median: float
    low: float
    high: float

    def __str__(self) -> str:
        """Return "median (low..high)"."""
        return f"{digits(self.median)} ({digits(self.low)}..{digits(self.high)})"


def digits(value: float) -> str:
    """Return a number with three digits that count."""
    if value >= 1000.0:
        return f"{float(f'{value:.3g}'):.0f}"
    return f"{value:#.3g}".rstrip(".")


def spread(values: npt.NDArray[np.float64]) -> Spread:
    """Return the spread of times or ratios."""
    return Spread(float(np.median(values)), float(np.min(values)), float(np.max(values)))


def ratio(contender: Samples, floor: Samples) -> Spread:
    """Return how many times longer a contender takes than another, round by round."""
    return spread(contender.times / floor.times)


def busy(samples: Samples, threads: int) -> bool:
    """Tell whether something else kept several threads from their cores, so that wall times do not count."""
    return float(np.median(samples.cores)) < QUIET * threads


def take_turns(contenders: Mapping[str, Contender], rounds: int) -> dict[str, Samples]:
    """Time contenders in turns, after a first call of each that is checked but not timed."""
    names = list(contenders)
    taken: dict[str, list[tuple[float, float]]] = {name: [] for name in names}
    for k in range(-1, rounds):
        # Nobody always comes after the same one, whose work may still be in the caches.
        for name in names if k % 2 else reversed(names):
            run, units, check, threads = contenders[name]
            gc.collect()
            cpu, wall = time.process_time(), time.perf_counter()
            result = run()
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            check(result)
            del result  # else its memory is freed within the next one's time
            if k >= 0:
                taken[name].append((1e6 * (cpu if threads == 1 else wall) / units, cpu / wall))
    return {name: Samples(*np.array(pairs).T) for name, pairs in taken.items()}


def plain(samples: Mapping[str, Samples]) -> dict[str, Any]:
    """Return samples as plain data for a JSON file, times in microseconds."""
    return {
        name: {**spread(one.times)._asdict(), "rounds": one.times.tolist(), "cores": one.cores.tolist()}
        for name, one in samples.items()
    }


def table(headers: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a Markdown table, its first column left-aligned and the others right-aligned."""
    cells = [list(headers), *([str(cell) for cell in row] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    rule = [":" + "-" * (widths[0] - 1), *("-" * (width - 1) + ":" for width in widths[1:])]
    lines = []
    for row in [cells[0], rule, *cells[1:]]:
        others = (cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))
        lines.append("| " + " | ".join([row[0].ljust(widths[0]), *others]) + " |")
    return "\n".join(lines)


def machine(packages: Sequence[str]) -> dict[str, Any]:
    """Return what the figures were taken on, as plain data."""
    return {
        "cpu": _cpu_model(),
        "cores": os.cpu_count(),
        "usable_cores": cores(),
        "lanes": build.widest(),
        "compiler": _compiler(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "packages": {package: _version(package) for package in packages},
        "OMP_WAIT_POLICY": os.environ.get("OMP_WAIT_POLICY", "not set"),
        "load_average": load_average(),
    }


def machine_table(facts: Mapping[str, Any]) -> str:
    """Return :func:`machine` as a table of one row, and the packages in a line below it."""
    packages = ", ".join(f"{name} {number}" for name, number in facts["packages"].items())
    load = facts["load_average"]
    cores = f"{facts['usable_cores']} of {facts['cores']} cores, {facts['lanes']} doubles wide"
    row = (
        f"{facts['cpu']}, {cores}, {facts['system']}",
        facts["compiler"],
        "unknown" if load is None else format(load, ".2f"),
    )
    head = table(("machine", "compiler", "load average before"), [row])
    return f"{head}\n\nPackages: Python {facts['python']}, {packages}."


def load_average() -> float | None:
    """Return how many processes wanted to run over the last minute, None where that is not known."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None


def _compiler() -> str:
    """Return what the C compiler says it is."""
    try:
        return build.compiler().version.splitlines()[0]
    except BackendError:
        return "no C compiler"


def _cpu_model() -> str:
    """Return the processor's name."""
    if sys.platform == "linux":
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            key, _, value = line.partition(":")
            if key.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()


def _version(package: str) -> str:
    """Return the version of an installed package."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
