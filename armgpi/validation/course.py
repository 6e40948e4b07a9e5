"""How long looking for a mistake may take in all, and what of it was not done."""

from __future__ import annotations

import time

from armgpi.validation.worker import Worker

#: Time of the processor that comparing a model and looking for its mistake may take [s].
TOTAL = 20.0


def seconds_used() -> float:
    """Return the processor time of this process and of its processes of models that have ended [s].

    Not of all that it has waited for: a program may have others, which end at any time.
    """
    return time.process_time() + Worker.seconds_of_ended


class Course:
    """The course of one comparison.

    Attributes:
        unsearched: what the time did not suffice for, a phrase each.
        failures: what failed in the search itself, a phrase each: defects of armgpi.
    """

    def __init__(self) -> None:
        """Begin: the time counts from now."""
        self._start = seconds_used()
        self.unsearched: list[str] = []
        self.failures: list[str] = []

    def seconds_left(self, worker: Worker) -> float:
        """Return how much of the time is left [s], none below zero.

        Args:
            worker: the model's process, which has not ended.
        """
        taken = seconds_used() - self._start + worker.seconds
        return max(TOTAL - taken, 0.0)

    def notes(self) -> list[str]:
        """Return what a report has to say of it, a line each."""
        found = [f"the search of the source failed: {text}; please report it" for text in self.failures]
        if self.unsearched:
            what = ", ".join(dict.fromkeys(self.unsearched))
            found.append(f"not searched within {TOTAL:g} s of processor time: {what}")
        return found

    def left_out(self) -> tuple[str, ...]:
        """Return what a verdict lacks: a search that failed."""
        return tuple(f"the search of the source, which failed: {text}" for text in self.failures)
