"""The generated loop with numbers of 32 bits in place of 64: a text that is changed, for measurements alone.

Arithmetic, states, parameters and targets are float32; counts of samples stay whole numbers. No random number
is drawn, so loops with noise or drop-outs are refused.
"""

from __future__ import annotations

import ctypes
import hashlib
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from armgpi.codegen import build, run

#: What of the library is written for 64 bits -> the same for 32.
BITS = {
    "8 * LANES": "4 * LANES",
    "uint64_t U": "uint32_t U",
    "int64_t M": "int32_t M",
    "INT64_MAX": "INT32_MAX",
    "<< 62": "<< 30",
    "0x1p52": "0x1p23",
    "0x1.8p52": "0x1.8p23",
    # pi/2 in three parts of few bits (Cephes, sinf.c): products with a whole number are exact.
    "1.57079632673412561417e+00": "1.5703125",
    "6.07710050630396597660e-11": "4.837512969970703125e-4",
    "2.02226624879595063154e-21": "7.54978995489188216e-8",
}
#: As many numbers as in a register of 256 bits.
LANES = 8
#: Instructions for floats where the library has those for doubles.
SELECT = """
#include <immintrin.h>
static inline V v_select(M m, V x, V y) { return (V)_mm256_blendv_ps((__m256)y, (__m256)x, (__m256)m); }
static inline V v_lower(V a, V b) { return (V)_mm256_min_ps((__m256)b, (__m256)a); }
static inline V v_upper(V a, V b) { return (V)_mm256_max_ps((__m256)b, (__m256)a); }
#elif LANES == 1
"""


def text_of(source: str) -> str:
    """Return the C of a loop with numbers of 32 bits."""
    if "#define ND 0\n" not in source:
        raise ValueError("a loop that draws random numbers")
    source = re.sub(r"static U v_mix.*?\n}\n", "", source, flags=re.S)
    source = re.sub(r"(static void draw\([^)]*\)\n){.*?\n}\n", r"\1{ }\n", source, flags=re.S)
    for old, new in BITS.items():
        assert source.count(old), old
        source = source.replace(old, new)
    source = re.sub(r"^EACH\((\w+), (\w+)\)", r"EACH(\1, \2f)", source, flags=re.M)
    source = source.replace("= fmod(", "= fmodf(").replace("return fabs(x)", "return fabsf(x)")
    # Neither branch of the library is of floats.
    source = source.replace("LANES == 8 && defined __AVX512F__", "0 && defined __AVX512F__")
    source = source.replace("#elif LANES == 1\n", f"#elif LANES == {LANES}{SELECT}", 1)
    source = source.replace("defined __AVX512F__", "0").replace("defined __AVX__", "0")
    return re.sub(r"\bdouble\b", "float", source)


class _Job(ctypes.Structure):
    """The arguments of the loop, of which one number is a float."""

    _fields_ = [
        (name, ctypes.c_float if kind is ctypes.c_double else kind) for name, kind in run._Job._fields_
    ]


def _narrow(array: Any) -> Any:
    """Return an aligned copy of floats."""
    buffer = np.empty(array.size + 16, dtype=np.float32)
    begin = (-buffer.ctypes.data % 64) // 4
    packed = buffer[begin : begin + array.size].reshape(array.shape)
    packed[...] = array
    return packed


@contextmanager
def in_floats() -> Iterator[None]:
    """Have compiled runs work in float32 meanwhile; what is recorded of them has to be float32 as well."""
    made = run.CompiledRun
    memory, fill, source, job, flags = made._memory, made._fill_table, run.source, run._Job, build.FLAGS

    def narrow_memory(self: Any, running: Any) -> dict[str, Any]:
        arrays = memory(self, running)
        for name in ("state", "shared", "own", "table", "sums"):
            arrays[name] = _narrow(arrays[name])
        return arrays

    def narrow_table(self: Any, k0: int, k1: int) -> None:
        fill(self, k0, k1)
        self._keep["table"] = _narrow(self._keep["table"])
        self._job.table = self._keep["table"].ctypes.data

    kept = dict(run._generated)
    run._generated.clear()
    made._memory, made._fill_table = narrow_memory, narrow_table  # type: ignore[method-assign]
    run.source = lambda traced, lanes: text_of(source(traced, lanes))
    # What is kept on the disk is of this text.
    digest = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:16]
    run._Job = _Job  # type: ignore[misc]
    build.FLAGS = (*flags, "-fsingle-precision-constant", f"-DCHANGED_BY=0x{digest}")  # type: ignore[assignment]
    try:
        yield
    finally:
        made._memory, made._fill_table = memory, fill  # type: ignore[method-assign]
        run.source, run._Job, build.FLAGS = source, job, flags  # type: ignore[misc]
        run._generated.clear()
        run._generated.update(kept)
