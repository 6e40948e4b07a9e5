"""Who runs the chunks of a study: this process, or workers of Dask on this machine or a cluster."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from armgpi.errors import ArmgpiError, BackendError, import_extra
from armgpi.studies.sample import run_chunk
from armgpi.studies.study import NoRoom

#: How long to wait for a cluster [s].
_PATIENCE = 10.0
#: How often a chunk is tried anew whose worker was lost.
_RETRIES = 3


def run(
    folder: Path,
    chunks: Sequence[tuple[int, int]],
    done: Callable[[int], None],
    workers: int = 1,
    cluster: str | None = None,
) -> dict[int, str]:
    """Run chunks and return those that are broken, with the reason.

    Args:
        folder: of the study.
        chunks: number and rollouts of each.
        done: is given the rollouts of each chunk that is there.
        workers: processes on this machine; 1 for this process alone.
        cluster: address of a Dask scheduler, whose workers see the folder under the same path.

    Raises:
        MissingPackage: when Dask is not installed.
        BackendError: when the cluster does not answer.
        NoRoom: when a chunk cannot be written; those before it are there.
    """
    if workers == 1 and cluster is None:
        here = (_Ended(chunk, rows, *_attempt(folder, chunk, rows)) for chunk, rows in chunks)
        return _gather(here, done)
    distributed = import_extra("dask.distributed", "cluster", "distributed")
    place = str(folder.resolve())  # workers stand elsewhere
    with _client(distributed, workers, cluster) as client:
        submitted = {}
        for chunk, rows in chunks:
            future = client.submit(_task, place, chunk, rows, pure=False, retries=_RETRIES)
            submitted[future] = chunk, rows
        futures = list(submitted)
        # A chunk is on the disk before its future is done: a lost worker loses nothing that was finished.
        completed = distributed.as_completed(futures)
        ended = (_Ended(*submitted[future], *_task_result(future)) for future in completed)
        try:
            return _gather(ended, done)
        except NoRoom:
            client.cancel(futures)
            raise


class _Ended(NamedTuple):
    """A chunk that came to its end.

    Attributes:
        chunk: its number.
        rows: its rollouts.
        reason: why it could not be run; empty when it was.
        had_room: whether it could be written.
    """

    chunk: int
    rows: int
    reason: str
    had_room: bool


def _gather(results: Iterable[_Ended], done: Callable[[int], None]) -> dict[int, str]:
    """Return the chunks that are broken, with the reason, of results as they come.

    Raises:
        NoRoom: when one could not be written.
    """
    broken: dict[int, str] = {}
    for ended in results:
        if not ended.had_room:
            raise NoRoom(ended.reason)
        if ended.reason:
            broken[ended.chunk] = ended.reason
        else:
            done(ended.rows)
    return broken


def _task_result(future: Any) -> tuple[str, bool]:
    """Return what :func:`_task` did, or why it came to no end.

    Raises:
        BackendError: when the scheduler was lost.
    """
    if future.status == "error":
        return _error_line(future.exception()), True
    try:
        done: tuple[str, bool] = future.result()
    except (OSError, TimeoutError, CancelledError) as error:
        said = "the connection to the Dask scheduler ended; start the sweep again, and it continues"
        raise BackendError(f"{said} ({_error_line(error)})") from None
    return done


def _task(folder: str, chunk: int, rows: int) -> tuple[str, bool]:
    """Do :func:`_attempt` in a worker, which has one core."""
    os.environ["OMP_NUM_THREADS"] = "1"
    return _attempt(Path(folder), chunk, rows)


def _attempt(folder: Path, chunk: int, rows: int) -> tuple[str, bool]:
    """Run a chunk; return why it could not be run, empty when it was, and whether it could be written."""
    try:
        run_chunk(folder, chunk, rows)
    except ArmgpiError as error:  # the same wherever it runs: no use in trying again
        return str(error), not isinstance(error, NoRoom)
    return "", True


def _error_line(error: BaseException | None) -> str:
    """Return an exception in one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())


@contextmanager
def _client(distributed: Any, workers: int, cluster: str | None) -> Iterator[Any]:
    """Give a client of a cluster, or of workers made here.

    Raises:
        BackendError: when there is none at the address.
    """
    if cluster is not None:
        try:
            client = distributed.Client(cluster, timeout=_PATIENCE)
        except (OSError, ValueError, TimeoutError) as error:
            raise BackendError(f"no Dask scheduler answers at {cluster}: {_error_line(error)}") from None
        with client:
            yield client
        return
    cluster_here = distributed.LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        dashboard_address=None,
        silence_logs=logging.CRITICAL,
        scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # without one it asks for port 8787
    )
    with cluster_here, distributed.Client(cluster_here) as client:
        yield client
