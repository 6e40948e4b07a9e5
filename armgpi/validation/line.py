"""Messages between two processes, of which one may be hostile: no wait is endless, no length is trusted."""

from __future__ import annotations

import socket
import struct
import time

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

    def close(self) -> None:
        """Close it in this process."""
        self._end.close()


def pair() -> tuple[Line, Line]:
    """Return both ends of a new line."""
    ours, theirs = socket.socketpair()
    return Line(ours), Line(theirs)
