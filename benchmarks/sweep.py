"""Sweeps: a million rollouts beside the bare loop, and two Dask workers beside one.

python benchmarks/sweep.py [--quick]
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import logging
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import count
from multiprocessing import get_context
from pathlib import Path

import _page
import numpy as np
from _timing import Spread, spread, table
from dask.distributed import Client, LocalCluster

import armgpi
from armgpi.config import parse
from armgpi.studies import workers
from armgpi.studies.sample import Sweep, run_chunk

#: The paper's arm with networks, all that is common varied.
STUDY = """
robot: {{name: anthropomorphic3}}
plant: {{encoder_bits: 16, delay: 1, loads: [{{type: step, amplitude: 0.1, onset: 0.1}}]}}
controllers: [{{type: network}}]
reference: {{points: [[0, 0.4, -0.4], [0.2, 0.6, -0.2]], durations: 0.5, holds: [0.1, {hold}]}}
t_final: {t_final}
vary:
  plant.payload.mass: {{uniform: [0.0, 0.2]}}
  plant.delay: {{choices: [0, 1, 2]}}
  plant.loads.0.onset: {{uniform: [0.0, 0.5]}}
  plant.loads.0.amplitude: {{normal: [0.0, 0.1], each: joint}}
  controller.leak: {{uniform: [1.0, 5.0]}}
  controller.inertia_scale: {{log_uniform: [0.8, 1.25]}}
  reference.durations.0: {{uniform: [0.3, 0.8]}}
"""
DT = 1e-3
#: Chunks that workers share out: whole ones for each.
CHUNKS = 4


def main() -> None:
    page = _page.begin(__file__, "Sweeps")
    rollouts, lasting, rounds = (1 << 14, 0.5, 1) if page.quick else (10**6, 10.0, 2)
    with tempfile.TemporaryDirectory() as folder:
        wall, processor = _million(Path(folder, "million"), rollouts)
        bare = {varied: _bare(Path(folder, "million"), varied) for varied in (True, False)}
        dask, processes = _workers(Path(folder), lasting, rounds)
    _page.say(
        f"{rollouts} rollouts of 2000 steps of the paper's arm with networks by two workers of Dask, every "
        f"metric kept: {wall:.0f} s on the wall, {processor:.0f} s of processor time. The bare loop keeps "
        f"the first and last sample: {1e6 * bare[True]:.4f} µs a rollout-step with the same numbers varied, "
        f"{1e6 * bare[False]:.4f} µs with constants. Two workers and one, and bare processes, have {CHUNKS} "
        f"chunks of {lasting:g} s, in {rounds} rounds, by the wall."
    )
    taken = np.array([processor / (rollouts * 2000)])
    varied, constant = (spread(taken / bare[numbers]) for numbers in (True, False))
    rows = [
        [
            "processor time over the bare loop's, same numbers varied",
            "at most 1.3",
            varied,
            _said(varied.median <= 1.3),
        ],
        ["over the bare loop's with nothing varied: constants folded", "-", constant, "-"],
        ["one Dask worker's time over that of two", "at least 1.9", dask, _said(dask.median >= 1.9)],
        ["one bare process's time over that of two", "-", processes, "-"],
    ]
    print()
    print(table(["", "goal", "found", "met"], rows))
    page.figures.update({"wall": wall, "bare": list(bare.values()), "workers": dask._asdict()})
    page.write()


def _said(kept: bool) -> str:
    """Return whether a goal is kept."""
    return "yes" if kept else "no"


def _study(folder: Path, t_final: float) -> Sweep:
    """Return a study in its folder."""
    found = Sweep.of(*parse(STUDY.format(hold=t_final - 0.6, t_final=t_final), "study.yaml"))
    found.enter(folder)
    return found


def _million(folder: Path, rollouts: int) -> tuple[float, float]:
    """Run a sweep by two workers; return its time on the wall, and the processor time of both [s]."""
    study = _study(folder, 2.0)
    chunks = [(i, study.rows(i, rollouts)) for i in range(-(-rollouts // study.size))]
    with _cluster(2) as cluster, Client(cluster) as client:
        for part in ([(len(chunks), 8), (len(chunks) + 1, 8)], chunks):  # the first one has them started
            begun, before = time.perf_counter(), sum(client.run(time.process_time).values())
            if broken := workers.run(folder, part, lambda rows: None, cluster=cluster.scheduler_address):
                sys.exit(f"a chunk is broken: {broken}")
        spent = sum(client.run(time.process_time).values()) - before
        return time.perf_counter() - begun, spent


def _bare(folder: Path, varied: bool) -> float:
    """Return what the loop takes for a step of a rollout, on one thread [s]."""
    study, steps = _study(folder, 2.0), 2000
    drawn, values, q0 = study.numbers(0, study.size), {}, None
    if varied:
        values = study.values(drawn)
    else:
        q0 = np.tile(study.experiment.reference.at(0.0).q, (study.size, 1))
    parts = (
        study.experiment.plant,
        next(iter(study.experiment.controllers.values())),
        study.experiment.reference,
    )
    times = {}
    for each in (1, steps):
        loop = armgpi.prepare(*parts, each * DT, record_every=each, backend="compiled")
        loop.run(values, q0=q0)
        taken = []
        for _ in range(5):
            begun = time.process_time()
            loop.run(values, q0=q0)
            taken.append(time.process_time() - begun)
        times[each] = float(np.median(taken))
    return (times[steps] - times[1]) / (study.size * (steps - 1))


def _workers(folder: Path, lasting: float, rounds: int) -> tuple[Spread, Spread]:
    """Return how many times as fast two are as one with such chunks: workers, and bare processes."""
    alone = []
    for chunk in range(3):  # the first one finds or makes its code
        study, begun = _study(folder / "short", 4.0), time.perf_counter()
        run_chunk(folder / "short", chunk, study.size)
        alone.append(time.perf_counter() - begun)
    rows = _study(folder / "long", 4.0 * lasting / min(alone[1:])).size
    numbers, ratios = count(), []
    with _cluster(2) as two, _cluster(1) as one, _pool(2) as both, _pool(1) as single:
        ways = [partial(_by_dask, cluster.scheduler_address) for cluster in (two, one)]
        ways += [partial(_by_processes, pool) for pool in (both, single)]
        for way in ways:
            way(folder / "short", [(next(numbers) + 2, rows) for _ in range(4)])
        for _ in range(rounds):
            taken = []
            for way in ways:
                part = [(next(numbers), rows) for _ in range(CHUNKS)]
                begun = time.perf_counter()
                way(folder / "long", part)
                taken.append(time.perf_counter() - begun)
            ratios.append((taken[1] / taken[0], taken[3] / taken[2]))
    dask, bare = np.array(ratios).T
    return spread(dask), spread(bare)


def _by_dask(address: str, folder: Path, part: list[tuple[int, int]]) -> None:
    """Run chunks by the workers of a cluster."""
    if broken := workers.run(folder, part, lambda rows: None, cluster=address):
        sys.exit(f"a chunk is broken: {broken}")


def _by_processes(pool: ProcessPoolExecutor, folder: Path, part: list[tuple[int, int]]) -> None:
    """Run chunks by processes that know nothing of each other."""
    list(pool.map(partial(run_chunk, folder), *zip(*part, strict=True)))


def _pool(size: int) -> ProcessPoolExecutor:
    """Return processes with a thread each."""
    return ProcessPoolExecutor(size, mp_context=get_context("spawn"))


def _cluster(count: int) -> LocalCluster:
    """Return workers with a thread each."""
    options = {"threads_per_worker": 1, "dashboard_address": None, "silence_logs": logging.CRITICAL}
    return LocalCluster(n_workers=count, **options)


if __name__ == "__main__":
    main()
