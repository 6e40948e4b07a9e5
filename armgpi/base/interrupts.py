"""Ctrl-C and SIGTERM where they would tear something: held back to the end of a block."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def hold() -> Iterator[None]:
    """Let a Ctrl-C or SIGTERM count when the block has ended; outside the main thread there are none."""
    usual = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    if threading.current_thread() is not threading.main_thread() or None in usual.values():
        yield
        return
    received: list[int] = []
    for each in usual:
        signal.signal(each, lambda number, _: received.append(number))
    try:
        yield
    finally:
        for each, handler in usual.items():
            signal.signal(each, handler)
    for number in received:
        signal.raise_signal(number)
