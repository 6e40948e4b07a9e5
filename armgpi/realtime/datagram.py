"""What goes over the wire, one UDP datagram each: samples to the controller, torques back.

A datagram has a header of 24 bytes (little endian) and 64-bit floats. The arm counts its samples. A torque
carries the number of the sample that it answers. So either end knows what it has missed.

====== ====== =========================================================
offset type   meaning
====== ====== =========================================================
0      4 x u8 ``AGPI``
4      u8     version of this layout, 1
5      u8     kind: 1 sample, 2 torque, 3 end
6      u16    n, number of joints
8      u64    number of the sample
16     f64    its time [s]
24     f64    sample: n positions, and n velocities where they are measured; torque: n torques
====== ====== =========================================================
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from armgpi.arrays import Array

_HEADER = struct.Struct("<4sBBHQd")
_MAGIC, _VERSION = b"AGPI", 1
SAMPLE, TORQUE, END = 1, 2, 3
#: Longest datagram: 64 joints with velocities.
LONGEST = _HEADER.size + 8 * 2 * 64


class Datagram(NamedTuple):
    """One message.

    Attributes:
        kind: SAMPLE, TORQUE or END.
        number: of the sample that it is, or answers.
        time: of that sample [s].
        values: positions (and velocities) [rad or m], or torques [N m or N]; shape (n,) or (2, n).
    """

    kind: int
    number: int
    time: float
    values: Array

    def pack(self) -> bytes:
        """Return it as bytes."""
        n = self.values.shape[-1]
        header = _HEADER.pack(_MAGIC, _VERSION, self.kind, n, self.number, self.time)
        return header + self.values.astype("<f8").tobytes()


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
    if rest or rows not in ((1, 2) if kind == SAMPLE else (1,)):
        return None
    values = np.frombuffer(data, "<f8", offset=_HEADER.size).astype(np.float64)
    if not np.isfinite(values).all():
        return None
    return Datagram(kind, number, time, values.reshape(rows, n) if rows > 1 else values)
