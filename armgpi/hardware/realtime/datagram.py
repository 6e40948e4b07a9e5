"""What goes over the wire, one UDP datagram each: samples to the controller, torques back.

A datagram has a header of 24 bytes (little endian) and 64-bit floats. The arm counts its samples, and echoes
the torque that it has applied. A torque carries the number of the sample that it answers. So either end knows
what it has missed.

====== ====== =========================================================
offset type   meaning
====== ====== =========================================================
0      4 x u8 ``AGPI``
4      u8     version of this layout, 2
5      u8     kind: 1 sample, 2 torque, 3 end
6      u16    n, number of joints
8      u64    number of the sample
16     f64    its time [s]
24     f64    sample: n positions, n velocities where they are measured, n applied torques (NaN: not known);
              torque: n torques
====== ====== =========================================================
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array

_HEADER = struct.Struct("<4sBBHQd")
_MAGIC, _VERSION = b"AGPI", 2
SAMPLE, TORQUE, END = 1, 2, 3
#: Longest datagram: 64 joints with velocities.
LONGEST = _HEADER.size + 8 * 3 * 64


class Datagram(NamedTuple):
    """One message.

    Attributes:
        kind: SAMPLE, TORQUE or END.
        number: of the sample that it is, or answers.
        time: of that sample [s].
        values: positions (and velocities) [rad or m], or torques [N m or N]; shape (n,) or (2, n).
        applied: of a sample, the torque that the arm has applied before it [N m or N], (n,); None: not known.
    """

    kind: int
    number: int
    time: float
    values: Array
    applied: Array | None = None

    def pack(self) -> bytes:
        """Return it as bytes."""
        n = self.values.shape[-1]
        header = _HEADER.pack(_MAGIC, _VERSION, self.kind, n, self.number, self.time)
        echo = np.full(n, np.nan) if self.applied is None else self.applied
        rows = (self.values, echo) if self.kind == SAMPLE else (self.values,)
        return header + b"".join(row.astype("<f8").tobytes() for row in rows)


def unpack(data: bytes, n: int) -> Datagram | None:
    """Return a datagram for an arm of `n` joints; None when it is none, or has a number that is not finite.

    What comes over a wire is no reason to stop: it counts as not received.
    """
    if len(data) < _HEADER.size:
        return None
    magic, version, kind, joints, number, time = _HEADER.unpack_from(data)
    if (magic, version, joints) != (_MAGIC, _VERSION, n) or kind not in (SAMPLE, TORQUE, END):
        return None
    rows, rest = divmod(len(data) - _HEADER.size, 8 * n)
    if rest or rows not in ((2, 3) if kind == SAMPLE else (1,)):
        return None
    values = np.frombuffer(data, "<f8", offset=_HEADER.size).astype(np.float64).reshape(rows, n)
    applied = None
    if kind == SAMPLE:
        values, echo = values[:-1], values[-1]
        applied = None if np.isnan(echo).all() else echo
    if not np.isfinite(values).all() or (applied is not None and not np.isfinite(applied).all()):
        return None
    return Datagram(kind, number, time, values if len(values) > 1 else values[0], applied)
