"""A loop between two processes: an arm that moves in wall-clock time, and a controller at the end of a wire.

``ends.py`` has the two ends without clock and wire, ``datagram.py`` what goes over the wire, ``injected.py``
what goes wrong on it, ``processes.py`` the processes, ``outcome.py`` what came out of it.
"""

from armgpi.hardware.realtime.ends import Watchdog
from armgpi.hardware.realtime.injected import Injected
from armgpi.hardware.realtime.outcome import Outcome
from armgpi.hardware.realtime.running import run

__all__ = ["Injected", "Outcome", "Watchdog", "run"]
