"""The C of all forms of a loop in one module, and WebAssembly from it.

A form calls the equations of motion by a pointer for each of its calls, so another load is another pointer.
Every load has the very C that a run with it compiles; those that differ in constants alone share a function.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.util import find_spec

from armgpi.codegen import build, source
from armgpi.codegen.emit import Dialect
from armgpi.codegen.kernels import Kernel
from armgpi.codegen.source import Layout
from armgpi.codegen.trace import Trace
from armgpi.errors import BackendError
from armgpi.viewing.play.variant import Sample

#: As native code is compiled, but for what other compilers and machines know.
_FLAGS = (
    *("-std=gnu11", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-w", "-s"),
    *(f"-Wl,--export={name}" for name in ("__heap_base", "choose", "layout")),
)
#: Without a C library, of which Zig makes one that takes five times as long as all else.
_BARE = ("-target", "wasm32-freestanding", "-DBARE", "-mbulk-memory", "-Wl,--no-entry")
#: And without what Zig's compiler has itself, where nothing is of libm.
_ALONE = ("-nostdlib",)
#: With one, for what is of libm, and of no compiler.
_HOSTED = ("-target", "wasm32-wasi", "-mexec-model=reactor")
_LIBM = re.compile(r"\bv_(?:exp|log|tan|tanh|atan|fmod)\((?!V )")
#: What Zig's compiler has not; of the others it has the very functions that its C library has.
_LIBRARY = re.compile(r"\bv_(?:tanh|atan)\((?!V )")
#: How what is known of its layout begins in a module, and how it ends.
_BEGIN, _END = "armgpi: ", " :armgpi"
#: What every form has of its own.
_OWN = ("Job", "NR", "v_mix", "draw", "record", "prepare", "sample", "add_up", "add_early", "run")
#: A call of a kernel in a sample.
_CALL = re.compile(r"\b\w+\(x_(\d+), o \+ \d+, y\1\)")
#: The same call by the pointer for it.
_BY_POINTER = r"chosen[\1].function(x_\1, chosen[\1].constants, y\1)"
#: A constant in it.
_CONSTANT = re.compile(r"v_set\((\([^()]+\)|[^()]+)\)")


def text(traces: Sequence[Trace], samples: Sequence[Sample], kernels: Mapping[str, Kernel]) -> str:
    """Return the C of all forms: ``run_0``, ``run_1`` and so on, and ``choose(call, kernel)``."""
    dialect = Dialect()
    calls = max(len(sample.calls) for sample in samples)
    said = _BEGIN + json.dumps([list(kernels), samples]) + _END
    parts = [f"const char layout[] = {json.dumps(said)};"]
    parts += ["#define LANES 1", source.library_text("lanes.h")]
    functions, entries = _share_functions(kernels, dialect)
    parts += [
        *functions,
        "typedef void Function(const V *restrict, const V *, V *restrict);",
        "typedef struct { Function *function; const V *constants; } Kernel;",
        f"static const Kernel kernels[] = {{{', '.join(entries)}}};",
        f"static Kernel chosen[{calls}];",
        "void choose(int call, int kernel) { chosen[call] = kernels[kernel]; }",
    ]
    for i, traced in enumerate(traces):
        parts += [f"#define {name} {name}_{i}" for name in _OWN if name != "NR"]
        sizes = source.sizes(traced, 1)
        parts += [f"#define {name} {value}" for name, value in sizes.items() if name != "LANES"]
        parts += [_CALL.sub(_BY_POINTER, line) for line in source.sample(traced, dialect)]
        parts.append(source.library_text("loop.h"))
        parts += [f"#undef {name}" for name in (*_OWN, "NC", *sizes) if name != "LANES"]
    return "\n".join(parts)


def layouts(code: bytes) -> tuple[list[str], list[Sample]]:
    """Return what is written in a module: the names of its kernels, and what is known of its forms."""
    begin = code.index(_BEGIN.encode()) + len(_BEGIN)
    names, samples = json.loads(code[begin : code.index(_END.encode(), begin)])
    return names, [Sample(Layout(*layout), calls) for layout, calls in samples]


def _share_functions(kernels: Mapping[str, Kernel], dialect: Dialect) -> tuple[list[str], list[str]]:
    """Return functions of which each serves all kernels that differ in constants alone, and what each has."""
    alike: dict[tuple[str, ...], dict[str, list[str]]] = {}
    for name, kernel in kernels.items():
        words = _CONSTANT.split("\n".join(source.function(replace(kernel, name="kernel"), dialect)))
        alike.setdefault(tuple(words[::2]), {})[name] = words[1::2]
    functions, entries = [], {}
    for i, ((first, *words), rows) in enumerate(alike.items()):
        functions.append(first.replace("kernel(", f"kernel_{i}("))
        differ: list[tuple[str, ...]] = []
        for word, values in zip(words, zip(*rows.values(), strict=True), strict=True):
            same = len(set(values)) == 1
            functions[-1] += (f"v_set({values[0]})" if same else f"m[{len(differ)}]") + word
            differ += [] if same else [values]
        for j, name in enumerate(rows):
            constants = ", ".join(values[j] for values in differ) or "0.0"
            entries[name] = f"{{kernel_{i}, (const V[]){{{constants}}}}}"
    return functions, [entries[name] for name in kernels]


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
        "ziglang; or install Clang with lld"
    )


def find(name: str) -> bytes | None:
    """Return the module that this version of the package once compiled under a name; None without one."""
    return build.find_wasm(name, _compiler()) if name else None


def compile_wasm(code: str, name: str = "") -> bytes:
    """Return WebAssembly for C; what was compiled once is kept.

    Args:
        code: the C.
        name: under which :func:`find` finds it without its source.

    Raises:
        BackendError: when there is no compiler, or it fails.
    """
    found = _compiler()
    system: tuple[str, ...] = (*_BARE, *_ALONE)
    if _LIBM.search(code):
        system = _BARE if found.command == build.ZIG and not _LIBRARY.search(code) else _HOSTED
    exports = (f"-Wl,--export={run}" for run in re.findall(r"#define run (run_\d+)", code))
    return build.wasm(code, found, (*system, *_FLAGS, *exports), name)


def _compiler() -> build.Compiler:
    """Return the compiler for WebAssembly."""
    called = compiler()
    if (found := build.probe(called, os.environ.get("PATH"))) is None:
        raise BackendError(f"{' '.join(called)} does not run")
    return found
