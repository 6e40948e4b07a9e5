"""The C of all forms of a loop in one module, and WebAssembly from it.

The equations of motion stand in it once each, and a form calls them by a pointer for each of its calls. So
another load is another pointer, and every load has the very C that a run with it compiles.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Sequence
from importlib.util import find_spec

from armgpi.codegen import build, source
from armgpi.codegen.emit import Dialect
from armgpi.errors import BackendError
from armgpi.view.play.variant import Pool, Variant

#: As native code is compiled, but for what other compilers and machines know.
_FLAGS = (
    *("-target", "wasm32-wasi", "-mexec-model=reactor", "-std=gnu11", "-O2", "-ffp-contract=off"),
    *("-fno-math-errno", "-fno-trapping-math", "-w", "-s", "-Wl,--export=__heap_base", "-Wl,--export=choose"),
)
#: What every form has of its own.
_OWN = ("Job", "NR", "v_mix", "draw", "record", "sample", "add_up", "add_early", "run")
#: A call of a kernel in a sample.
_CALL = re.compile(r"\b\w+\(x_(\d+), o \+ \d+, y\1\)")


def text(variants: Sequence[Variant], pool: Pool) -> str:
    """Return the C of all forms: ``run_0``, ``run_1`` and so on, and ``choose(call, kernel)``."""
    dialect = Dialect()
    calls = max(len(variant.trace.calls) for variant in variants)
    parts = ["#define LANES 1", source.library_text("lanes.h")]
    for kernel in pool.kernels:
        parts += source.function(kernel, dialect)
    names = ", ".join(kernel.name for kernel in pool.kernels)
    parts += [
        "typedef void (*Kernel)(const V *restrict, const V *, V *restrict);",
        f"static const Kernel kernels[] = {{{names}}};",
        f"static Kernel chosen[{calls}];",
        "void choose(int call, int kernel) { chosen[call] = kernels[kernel]; }",
    ]
    for i, variant in enumerate(variants):
        parts += [f"#define {name} {name}_{i}" for name in _OWN if name != "NR"]
        sizes = source.sizes(variant.trace, 1)
        parts += [f"#define {name} {value}" for name, value in sizes.items() if name != "LANES"]
        parts += [_CALL.sub(_by_pointer, line) for line in source.sample(variant.trace, dialect)]
        parts.append(source.library_text("loop.h"))
        parts += [f"#undef {name}" for name in (*_OWN, *sizes) if name != "LANES"]
    return "\n".join(parts)


def _by_pointer(call: re.Match[str]) -> str:
    """Return a call by the pointer for it."""
    return f"chosen[{call[1]}](x_{call[1]}, o, y{call[1]})"


def compiler() -> tuple[str, ...]:
    """Return how the compiler for WebAssembly is called: Zig's, or a Clang that can link it.

    Raises:
        BackendError: when there is neither.
    """
    if find_spec("ziglang") is not None:
        return build.ZIG
    clang = shutil.which("clang")
    if clang is not None and shutil.which("wasm-ld") is not None:
        return (clang,)
    raise BackendError(
        "WebAssembly needs the compiler of the package 'ziglang', which is not installed: pip install "
        "'armgpi[play]'; or Clang with lld, wasi-libc and compiler-rt for wasm32"
    )


def compile_wasm(code: str, exports: Sequence[str]) -> bytes:
    """Return WebAssembly for C; what was compiled once is kept.

    Args:
        code: the C.
        exports: functions that the page calls.

    Raises:
        BackendError: when there is no compiler, or it fails.
    """
    called = compiler()
    if (found := build.probe(called, os.environ.get("PATH"))) is None:
        raise BackendError(f"{' '.join(called)} does not run")
    return build.wasm(code, found, (*_FLAGS, *(f"-Wl,--export={name}" for name in exports)))
