"""Interrupts that are held back."""

from __future__ import annotations

import signal

import pytest

from armgpi.base import interrupts


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_within_the_block_comes_after_it(number: signal.Signals) -> None:
    steps = []

    def work() -> None:
        with interrupts.hold():
            signal.raise_signal(number)
            steps.append("whole")

    before = signal.signal(number, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            work()
    finally:
        signal.signal(number, before)
    assert steps == ["whole"]
