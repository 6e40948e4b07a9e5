"""Where the minutes of the test suite go: `pytest --minutes` prints processor time by room, file and test.

Processor time of a test is that of its process and of those that it started and waited for, so a busy machine
changes it little. What a fixture makes for several tests counts where it is first asked for.
"""

from __future__ import annotations

import resource
from collections import Counter, defaultdict
from collections.abc import Iterator
from typing import Any

import pytest

#: Tests that are named one by one, and files of each room.
LONGEST, FILES = 30, 4
#: Where a report carries the processor time of its phase.
KEY = "processor seconds"


def spent() -> float:
    """Return the processor time of this process and of those that it waited for [s]."""
    both = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in both)


class Minutes:
    """Adds up the processor time of tests, from all processes of a run."""

    def __init__(self) -> None:
        self.begun = spent()
        self.by_test: Counter[str] = Counter()

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_makereport(self) -> Iterator[None]:
        """Note the processor time since the last report."""
        outcome: Any = yield
        now = spent()
        outcome.get_result().user_properties.append((KEY, now - self.begun))
        self.begun = now

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Add up what a report carries."""
        self.by_test[report.nodeid] += sum(value for name, value in report.user_properties if name == KEY)

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Print minutes by room and file, and the longest tests."""
        rooms: Counter[str] = Counter()
        files: dict[str, Counter[str]] = defaultdict(Counter)
        for test, seconds in self.by_test.items():
            room, _, file = test.partition("::")[0].rpartition("/")
            rooms[room] += seconds
            files[room][file] += seconds
        say = terminalreporter.write_line
        say(f"\n{sum(rooms.values()) / 60.0:.1f} minutes of processor time")
        for room, seconds in rooms.most_common():
            most = ", ".join(f"{file} {x:.0f}" for file, x in files[room].most_common(FILES))
            say(f"{seconds / 60.0:6.2f} min  {room}  (s: {most})")
        for test, seconds in self.by_test.most_common(LONGEST):
            say(f"{seconds:6.1f} s  {test}")
