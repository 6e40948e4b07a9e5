"""A run of a closed loop by generated code: what :func:`armgpi.simulate` uses in place of NumPy."""

from __future__ import annotations

import ctypes
import math
import time
from collections import OrderedDict
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from armgpi.base.arrays import Array
from armgpi.codegen import build
from armgpi.codegen.source import HELD, Layout, layout_of, source, trace_used
from armgpi.codegen.state import flatten, map_leaves, unflatten
from armgpi.codegen.symbols import NotElementwise
from armgpi.codegen.trace import Inventory, check_repeatable, columns, tracing
from armgpi.errors import BackendError
from armgpi.loop.rollout import Recording
from armgpi.loop.running import Running, Sums
from armgpi.plants import noise
from armgpi.robot.dynamics import thread_count

#: What the code records itself; of a rollout that has diverged it records nothing any more.
_TARGETS = ("q_ref", "v_ref")
#: Samples of the first call, from which the time of a sample is known.
_FIRST_CHUNK = 16
#: How long one call of the generated code should take [s]: between two calls Ctrl-C is heard.
_CALL = 0.05
#: A user's law is compared with NumPy over so many samples.
_COMPARED = 3
#: How far the two may be apart, as a share of the largest entry.
_AGREEMENT = 1e-8
#: Where the comparison begins: the sample, and how far all numbers of the state are moved. Not only from the
#: start, as at rest all errors may be zero.
_TRIALS = ((0, 0.0), (0, 1e-3), (1000, 0.3))
#: Numbers in a table of targets, at most: 8 MB.
_TABLE = 1 << 20
#: Samples of a table with rows of its own for each rollout, at least: some 16 pay for a call of `at`.
_FEWEST = 16
#: Samples that code compiled quickly takes, at most: for more, fast code saves more than it takes to compile.
_FEW = 50_000
#: Lines of code that is compiled quickly, at most: each has a number on the stack. 20 joints take 30,000.
_LINES = 50_000
#: Structures of which the code is kept at hand.
_KEPT = 64
#: What an array of vectors is aligned to [bytes]: those of 8 lanes.
_ALIGNMENT = 64


@dataclass
class Generated:
    """The code of all loops of one structure.

    Attributes:
        layout: of its numbers.
        library: its C compiled.
        quick: whether it was compiled for short runs.
        samples: taken with it so far, of blocks of lanes.
    """

    layout: Layout
    library: ctypes.CDLL
    quick: bool
    samples: int = 0


#: The code of this process by the structure of the loop. A law of a user's is not among it: a key would have
#: to know of every change in the law.
_generated: OrderedDict[Any, Generated] = OrderedDict()


def _code_of(
    loop: Any,
    state: Any,
    signals: bool,
    lanes: int,
    running: Running | None,
    known: dict[Any, Generated],
    patience: float,
    samples: int,
) -> tuple[Generated, Inventory, bool]:
    """Return the code of a loop, the numbers to run it with, and whether it was there already.

    Args:
        loop: the loop.
        state: where it starts.
        signals: whether inner signals are recorded.
        lanes: how many rollouts the code works on at once.
        running: what adds up samples; None where they are recorded.
        known: code for laws of a user's, who vouches that they stay what they are.
        patience: how long it may take until the code is there [s].
        samples: how many the run takes.

    Raises:
        BackendError: when the loop cannot be generated or compiled, or takes longer.
    """
    fast = (*build.FLAGS, *(build.SCALAR if lanes == 1 else ()))
    short = (*fast, *build.QUICK)
    try:
        with tracing():
            found = Inventory(loop, state, running)
            key = (signals, lanes, build.compiler(), *found.structure)
            kept: Any = known if found.user_defined else _generated
            there: Generated | None = kept.get(key)
            before = 0 if there is None else there.samples
            # With several lanes the code of a short run would need much memory, on the stack of any thread.
            quick = lanes == 1 and before + samples <= _FEW
            if there is not None and (quick or not there.quick):
                there.samples += samples
                return there, found, True
            # What a process before made of a loop of this structure needs no trace.
            name = f"{signals} {lanes} {found.name}" if found.name else ""
            made = None
            for flags in (fast, short)[: 1 + quick] if name else ():
                made = made or build.find_library(name, flags)
            if made is None:
                try:
                    build.check_patience(loop.plant.robot.n, patience, quick)
                except BackendError:
                    if there is None:
                        raise
                    there.samples += samples  # the code of short runs is still faster than NumPy
                    return there, found, True
                text = source(trace_used(loop, state, signals, running), lanes)
                if found.user_defined:
                    check_repeatable(text, lambda: source(trace_used(loop, state, signals, running), lanes))
                quick = quick and text.count("\n") <= _LINES
                made = build.library(text, short if quick else fast, name)
    except NotElementwise as error:
        raise BackendError(f"this loop has no generated code: {error}") from None
    code = Generated(layout_of(made), made, quick, before + samples)
    kept[key] = code
    if len(_generated) > _KEPT:
        _generated.popitem(last=False)
    return code, found, False


class _Job(ctypes.Structure):
    """The arguments of the generated `run`; see loop.h."""

    _fields_ = [
        *(
            (name, ctypes.c_void_p)
            for name in ("state", "shared", "own", "table", "draws", "seeds", "out", "sums", "ended")
        ),
        *((name, ctypes.c_int64) for name in ("rows", "padded", "table_rows", "k0", "k1", "every", "final")),
        ("divergence", ctypes.c_double),
        ("late", ctypes.c_int64),
        ("narrow", ctypes.c_int64),
    ]


class CompiledRun:
    """A run by generated code: a :class:`armgpi.loop.runner.Runner`.

    Attributes:
        recording: where samples go.
        done: samples taken.
        chunk: samples to take next: as many as one call should.
        rows: number of rollouts.
        lanes: how many of them the code works on at once.
        threads: how many threads share them out.
    """

    backend = "compiled"

    def __init__(
        self,
        loop: Any,
        state: Any,
        recording: Recording,
        divergence: float,
        signals: bool = False,
        running: Running | None = None,
        known: dict[Any, Generated] | None = None,
        patience: float = math.inf,
    ) -> None:
        """Generate and compile the loop, or find it compiled.

        Args:
            loop: an :class:`armgpi.ClosedLoop`.
            state: its state at the start.
            recording: where samples go; with `running`, how rollouts end alone.
            divergence: largest error of a rollout that runs [rad or m].
            signals: whether the controller's inner signals are recorded.
            running: what adds up samples in place of recording them.
            known: code for laws of a user's; see :class:`armgpi.loop.prepared.PreparedLoop`.
            patience: how long it may take until the code is there [s].

        Raises:
            BackendError: when the loop cannot be generated or compiled, or takes longer; it says why.
        """
        self.rows = len(recording.status)
        self.lanes = build.lanes(self.rows)
        samples = round(recording.times[-1] / loop.dt) * -(-self.rows // self.lanes)
        code, found, again = _code_of(
            loop, state, signals, self.lanes, running, {} if known is None else known, patience, samples
        )
        self._values = found.values
        self._layout, self._library = code.layout, code.library
        self.loop, self.recording = loop, recording
        self._begun = tuple(state[1:])
        self.done = 0
        self.chunk = _FIRST_CHUNK
        self._blocks = -(-self.rows // self.lanes)
        self.threads = min(thread_count(), self._blocks)
        # The rollout of each lane; those without one repeat the last.
        self._places = np.minimum(np.arange(self._blocks * self.lanes), self.rows - 1)
        self._keep = self._memory(running)
        self._job = _Job(
            **{name: array.ctypes.data for name, array in self._keep.items()},
            rows=self.rows,
            padded=self._places.size,
            every=recording.every if running is None else 0,
            late=0 if running is None else int(running.late),
            divergence=divergence,
            narrow=recording.dtype == "float32",
        )
        names = self._layout.names
        # What comes with armgpi is compared by the tests; what a user brings, here.
        if self._layout.table:
            self._check_table()
        if found.user_defined and not again:
            self._check(state, len(names))
        # Not before: a run that NumPy takes over makes buffers of its own, blank ones.
        kept = [name if running is None and recording.keeps(name) else None for name in names]
        places = [0 if name is None else recording.buffer(name, blank=False).ctypes.data for name in kept]
        self._keep["out"] = np.array(places, dtype=np.uintp)
        self._job.out = self._keep["out"].ctypes.data
        self._pool = ThreadPoolExecutor(self.threads) if self.threads > 1 else None

    @property
    def sums(self) -> Sums:
        """What was added up, arrays (rollouts, n)."""
        return tuple(self._unpack(self._keep["sums"], self._layout.sums))

    @property
    def state(self) -> Any:
        """The state before the next sample, a tree as NumPy has it; of a single run only."""
        blocks = self._keep["state"].reshape(self._blocks, -1, self.lanes)
        rows = blocks[0, : self._layout.states, 0].copy()
        begin = 0
        leaves: list[Any] = []
        for _, value in flatten(self._begun):
            if isinstance(value, int):
                leaves.append(value + self.done)
                continue
            size = np.size(value)
            part = rows[begin : begin + size].reshape(np.shape(value))
            leaves.append(part if isinstance(value, np.ndarray) else float(part))
            begin += size
        return unflatten(self._begun, leaves)

    @property
    def last(self) -> dict[str, Array]:
        """What there was to record of the last sample, name -> (rollouts, n)."""
        first, names = self._layout.states, self._layout.names
        rows = self._unpack(self._keep["state"], first + len(names) * self._layout.n, first)
        return dict(zip(names, rows, strict=True))

    def _unpack(self, memory: Array, count: int, first: int = 0) -> Array:
        """Return numbers of all rollouts in blocks of `count` vectors, from `first` on: (k, rollouts, n)."""
        blocks = memory.reshape(self._blocks, count, self.lanes)[:, first:]
        columns = blocks.swapaxes(0, 1).reshape(count - first, -1)[:, : self.rows]
        variables = columns.reshape(-1, self._layout.n, self.rows)
        return np.ascontiguousarray(variables.swapaxes(1, 2))

    def _memory(self, running: Running | None) -> dict[str, Any]:
        """Return the arrays that the code reads and writes, by their names in `Job`."""
        layout, values = self._layout, self._values
        # Each rollout's own parameters lie lane by lane, so that one load fetches those of all lanes.
        own = np.empty((len(layout.own), self.rows))
        for row, place in zip(own, layout.own, strict=True):
            row[:] = values.own[place]
        drawn = [values.seeds[seed] if given else seed for given, seed, _, _ in layout.draws]
        sums = np.empty((0, self.rows))
        if running is not None:
            sums = np.concatenate(running.init((layout.n, self.rows)))
        return {
            "state": self._start(values.start),
            "shared": np.array([values.shared[i] for i in layout.shared]),
            "own": self._pack(own),
            "table": np.empty(0),
            "draws": np.array([draw[2:] for draw in layout.draws], dtype=np.uint64),
            "seeds": np.array(
                [noise.seeds(seed, self.rows)[self._places] for seed in drawn], dtype=np.uint64
            ),
            "sums": self._pack(sums),
            "ended": np.full(self.rows, -1, dtype=np.int64),
        }

    def _check_table(self) -> None:
        """Refuse a reference that remembers how often it was asked: the table asks in other stretches.

        Raises:
            BackendError: naming the reference.
        """
        begin = np.arange(_COMPARED) * np.float64(self.loop.dt)
        first, again = (np.concatenate(self.loop.targets(begin)) for _ in range(2))
        if not np.array_equal(first, again, equal_nan=True):
            name = type(self.loop.reference).__name__
            raise BackendError(
                f"this loop has no generated code: {name} gives something else each time that it is asked"
            )

    def _check(self, state: Any, variables: int) -> None:
        """Refuse code whose samples are not NumPy's: a user's law that mixes rollouts, say.

        Raises:
            BackendError: naming the sample and the difference.
        """
        random = np.random.default_rng(0)
        last = round(self.recording.times[-1] / self.loop.dt)
        for late, size in _TRIALS:
            first = max(0, min(late, last - _COMPARED))  # a reference may end
            try:
                theirs = self._by_numpy(begin := _shifted_copy(state[1:], random, first, size), first)
            except Exception as error:  # a user's law may raise anything
                raise BackendError(f"this loop has no generated code: NumPy's raises {error!r}") from None
            # The trials' states are copies: a law may write into its state.
            ours = self._by_code(begin, first, variables)
            for k, (a, b) in enumerate(zip(ours, theirs, strict=True), first):
                runs = np.isfinite(a).all(axis=(0, 2))
                should = np.isfinite(b).all(axis=(0, 2))
                both = runs & should
                apart = np.abs(a - b)[:, both]
                largest = np.abs(b[:, both]).max(axis=(1, 2), keepdims=True, initial=1.0)
                if (runs != should).any() or not (apart <= _AGREEMENT * largest).all():
                    raise BackendError(
                        f"this loop has no generated code: sample {k} of it differs from NumPy's by "
                        f"{np.max(apart, initial=0.0):.2g} (does its law mix joints of several rollouts?)"
                    )

    def _by_numpy(self, state: Any, first: int) -> Array:
        """Return q, v and the torque asked for of some samples from a state on: (samples, 3, rollouts, n)."""
        plant, controller = _shifted_copy(state, None)
        rows = []
        for k in range(first, first + _COMPARED):
            truth = self.loop.plant.true_state(plant)
            target = self.loop.reference.at(k * self.loop.dt)
            plant, controller, _, tau = self.loop._sample(plant, controller, target)
            q, v, tau = (np.array(x).reshape(self.rows, -1) for x in (truth.q, truth.v, tau))
            rows.append([q, v, tau])
        return np.array(rows)

    def _by_code(self, state: Any, first: int, variables: int) -> Array:
        """Return the same by generated code; NaN where a number is not finite."""
        if self._layout.table:
            self._fill_table(first, first + _COMPARED)
        found = np.full((variables, _COMPARED, self.rows, self._layout.n), np.nan)
        # The recording counts from sample 0.
        skipped = first * self.rows * self._layout.n * found.itemsize
        scratch = {
            "state": self._start(columns(state, self.recording.shape[:-1])),
            "out": np.array([part.ctypes.data - skipped for part in found], dtype=np.uintp),
            "sums": self._keep["sums"].copy(),
            "ended": np.full(self.rows, -1, dtype=np.int64),
        }
        job = _Job.from_buffer_copy(self._job)
        for name, array in scratch.items():
            setattr(job, name, array.ctypes.data)
        job.k0, job.k1 = first, first + _COMPARED
        job.every, job.narrow = 1, 0
        job.divergence = math.inf
        # On this thread alone: three samples are done before others have started.
        self._library.run(ctypes.byref(job), ctypes.c_int64(0), ctypes.c_int64(self._blocks))
        return np.swapaxes(found[[0, 1, HELD]], 0, 1)

    def _start(self, columns: Array) -> Array:
        """Return the memory of blocks whose rollouts begin with these numbers (s, rollouts)."""
        return self._pack(columns, len(self._layout.names) * self._layout.n)

    def take(self, count: int) -> int:
        """Take `count` samples and record them."""
        begun = time.perf_counter()
        self._run(self.done, self.done + count)
        self.done += count
        spent = max(time.perf_counter() - begun, 1e-6)
        # At most 16 times as many as this time: the clock may have measured too little.
        width = self._blocks * self.lanes if self._job.table_rows else 1
        most = _TABLE // max(1, self._layout.table * width)
        # References that are asked one by one cost a call each, for one sample or for many.
        least = max(1, min(_FEWEST, 8 * most)) if self._job.table_rows else 1
        self.chunk = max(least, min(int(count * min(_CALL / spent, 16.0)), most))
        return count

    def finish(self) -> None:
        """Record the state after the last sample, its torque still held."""
        self._job.final = 1
        self._run(self.done, self.done + 1)
        self._store(self.done + 1)
        self._close()

    def interrupt(self) -> None:
        """Keep the samples that were whole when the user stopped the run."""
        self._store(self.done)
        self.recording.interrupt(self.done)
        self._close()

    def _close(self) -> None:
        """Let the threads go."""
        if self._pool is not None:
            self._pool.shutdown()

    def _run(self, k0: int, k1: int) -> None:
        """Run samples k0 to k1 - 1 of all rollouts."""
        if self._layout.table:
            self._fill_table(k0, k1)
        self._job.k0, self._job.k1 = k0, k1
        if self._pool is None:
            self._run_blocks(0, self._blocks)
        else:
            # A few more parts than threads: a part whose rollouts have diverged is done at once.
            ends = np.linspace(0, self._blocks, min(self._blocks, 4 * self.threads) + 1).astype(int).tolist()
            # Each part holds this run: the code writes into its arrays, also after a second Ctrl-C.
            parts = [self._pool.submit(self._run_blocks, a, b) for a, b in pairwise(ends)]
            try:
                wait(parts)
            finally:  # what is kept must be whole
                wait(parts)
        recording, ended = self.recording, self._keep["ended"]
        rows = np.flatnonzero((ended >= 0) & recording.running)
        recording.diverge(rows, ended[rows])

    def _run_blocks(self, begin: int, end: int) -> None:
        """Run the samples of the job for some blocks."""
        self._library.run(ctypes.byref(self._job), ctypes.c_int64(begin), ctypes.c_int64(end))

    def _fill_table(self, k0: int, k1: int) -> None:
        """Have NumPy work out the targets of some samples."""
        target = self.loop.targets(np.arange(k0, k1) * np.float64(self.loop.dt))
        columns = np.concatenate(target, axis=-1)
        self._job.table_rows = columns.ndim == 3
        if columns.ndim == 3:
            # Lanes last, so that one load fetches an entry for all of them.
            columns = np.swapaxes(columns, 1, 2)[:, :, self._places]
        self._keep["table"] = np.ascontiguousarray(columns)
        self._job.table = self._keep["table"].ctypes.data

    def _store(self, samples: int) -> None:
        """Say how many samples there are; a rollout that diverged has its targets alone from then on."""
        recording, ended = self.recording, self._keep["ended"]
        recording.stored = -(-samples // recording.every)
        for name, values in recording.variables.items():
            rows = values.reshape(len(values), self.rows, -1)
            for row in np.flatnonzero(ended >= 0) if name not in _TARGETS else ():
                rows[-(-ended[row] // recording.every) : recording.stored, row] = np.nan
        self._store_targets()

    def _store_targets(self) -> None:
        """Record the targets of rollouts that have diverged, which the generated code no longer does."""
        recording, ended = self.recording, self._keep["ended"]
        diverged = np.flatnonzero(ended >= 0)
        if not len(diverged) or not recording.variables:
            return
        first = int(-(-ended[diverged].min() // recording.every))
        # In stretches: a large batch has more targets than memory.
        at_once = max(1, _TABLE // (self.rows * self._layout.n))
        for begin in range(first, recording.stored, at_once):
            times = slice(begin, min(begin + at_once, recording.stored))
            target = self.loop.targets(recording.times[times])
            for name, part in zip(_TARGETS, target, strict=False):
                if not recording.keeps(name):
                    continue
                rows = recording.variables[name][times].reshape(-1, self.rows, self._layout.n)
                values = np.broadcast_to(part if part.ndim == 3 else part[:, None], rows.shape)
                for row in diverged:
                    late = max(0, int(-(-ended[row] // recording.every)) - begin)
                    rows[late:, row] = values[late:, row]

    def _pack(self, columns: Array, zeros: int = 0) -> Array:
        """Return numbers (k, rollouts) and so many zeros as blocks of vectors of lanes, aligned for them."""
        # Block by block, as a block's state is all that a core works on: it stays in its cache.
        count, lanes, whole = len(columns), self.lanes, self.rows // self.lanes
        size = self._blocks * (count + zeros) * lanes
        buffer = np.empty(size + _ALIGNMENT // columns.itemsize)
        begin = (-buffer.ctypes.data % _ALIGNMENT) // columns.itemsize
        packed = buffer[begin : begin + size]
        blocks = packed.reshape(self._blocks, count + zeros, lanes)
        full = columns[:, : whole * lanes].reshape(count, whole, lanes)
        blocks[:whole, :count] = full.swapaxes(0, 1)
        if whole < self._blocks:
            blocks[whole, :count] = columns[:, self._places[whole * lanes :]]
        blocks[:, count:] = 0.0
        return packed


def _shifted_copy(state: Any, random: np.random.Generator | None, k: int = 0, size: float = 0.0) -> Any:
    """Return a copy of a state, `k` samples later and with its numbers moved by some `size` at random."""

    def shift(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return value.copy() if random is None else value + size * random.normal(size=value.shape)
        return value + k if isinstance(value, int) else value

    return map_leaves(shift, state)
