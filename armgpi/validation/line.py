"""Messages between two processes, of which one may be hostile: no wait is endless, no length is trusted.

Beside them, a number that both see.
"""

from __future__ import annotations

import fcntl
import os
import socket
import struct
import tempfile
import time
from contextlib import suppress

#: Length of what follows [bytes], before each message.
_HEADER = struct.Struct("!Q")
#: What is read at once [bytes].
_BLOCK = 2**20


class Line:
    """One end of a line of messages."""

    def __init__(self, end: socket.socket) -> None:
        """Take an end of a pair of sockets."""
        self._end = end

    def send(self, message: bytes, limit: float | None = None) -> None:
        """Send a message.

        Raises:
            OSError: when the other end is gone, or does not take it within the limit [s].
        """
        self._end.settimeout(limit)
        self._end.sendall(_HEADER.pack(len(message)) + message)

    def receive(self, longest: int, first: float | None = None, rest: float | None = None) -> bytes:
        """Return the next message.

        Args:
            longest: its largest length [bytes].
            first: how long to wait until it begins [s]; None: for ever.
            rest: how long it may take from there [s]; None: for ever.

        Raises:
            TimeoutError: when it does not begin in time.
            EOFError: when the other end is gone.
            OSError: when this one is.
            ValueError: when it is longer, or does not end in time.
        """
        self._end.settimeout(first)
        begun = self._end.recv(1)
        if not begun:
            raise EOFError
        until = None if rest is None else time.monotonic() + rest
        (length,) = _HEADER.unpack(begun + self._read(_HEADER.size - 1, until))
        if length > longest:
            raise ValueError(f"a message of {length} bytes")
        return self._read(length, until)

    def _read(self, length: int, until: float | None) -> bytes:
        """Return so many bytes, before some time."""
        blocks, left = [], length
        while left:
            if until is not None:
                self._end.settimeout(max(until - time.monotonic(), 1e-3))
            try:
                block = self._end.recv(min(left, _BLOCK))
            except TimeoutError:
                raise ValueError("a message that does not end") from None
            if not block:
                raise EOFError
            blocks.append(block)
            left -= len(block)
        return b"".join(blocks)

    @property
    def descriptor(self) -> int:
        """Return its file descriptor in this process."""
        return self._end.fileno()

    def close(self) -> None:
        """Close it in this process."""
        self._end.close()


class Counter:
    """A number that two processes share, also when one of them answers no more.

    It is in a file without a name, which on Linux is in memory and keeps its length. It is read, not mapped:
    a process may shorten a file, and who then looks at the rest of its map is ended.

    Attributes:
        descriptor: of that file.
    """

    def __init__(self, descriptor: int | None = None) -> None:
        """Start at 0, or take the one of another process by a file descriptor."""
        self.descriptor = _numbered_file() if descriptor is None else descriptor

    @property
    def value(self) -> int:
        """Return what it is at; the other process may have written anything."""
        with suppress(OSError, struct.error):
            return int(_HEADER.unpack(os.pread(self.descriptor, _HEADER.size, 0))[0])
        return 0

    @value.setter
    def value(self, number: int) -> None:
        """Set it, if the file is still there."""
        with suppress(OSError):
            os.pwrite(self.descriptor, _HEADER.pack(number), 0)

    def close(self) -> None:
        """Close it in this process; a second time changes nothing."""
        descriptor, self.descriptor = self.descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)


def _numbered_file() -> int:
    """Return the descriptor of a file that holds one number."""
    if hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("counter", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        os.pwrite(descriptor, bytes(_HEADER.size), 0)
        fcntl.fcntl(
            descriptor, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL
        )
        return descriptor
    with tempfile.TemporaryFile() as file:
        file.write(bytes(_HEADER.size))
        file.flush()
        return os.dup(file.fileno())


def pair() -> tuple[Line, Line]:
    """Return both ends of a new line."""
    ours, theirs = socket.socketpair()
    return Line(ours), Line(theirs)
