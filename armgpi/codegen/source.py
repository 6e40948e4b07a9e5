"""One sample of a loop, with all around it, as C: `lanes.h`, the dynamics, the sample, `loop.h`."""

from __future__ import annotations

import ctypes
import json
import re
from collections.abc import Iterator, Sequence
from importlib.resources import files
from typing import Any, NamedTuple

from armgpi.codegen.algebra import ca
from armgpi.codegen.emit import CallSite, Code, Dialect, straight_line
from armgpi.codegen.kernels import Call, Kernel, Placed, place_calls
from armgpi.codegen.trace import Seed, Trace, trace
from armgpi.loop.running import Running

#: What every run records, in this order; the first five belong to the sample, the others to the torque.
_ORDER = ("q", "v", "q_ref", "v_ref", "q_measured", "tau_command", "tau")
#: Place of the torque asked for, with which begins what stays held after the last sample.
HELD = _ORDER.index("tau_command")
#: Place of the torque applied, which must be finite.
TAU = _ORDER.index("tau")


class Layout(NamedTuple):
    """How the generated code has its numbers in memory; it is in the library, as JSON.

    Attributes:
        n: number of joints.
        states: numbers of the state.
        names: of what is recorded, in order.
        table: numbers that a table gives for every sample.
        sums: numbers that are added up.
        shared: places of the parameters, among those that all rollouts share.
        own: likewise, among those that each rollout has its own of.
        draws: of random numbers: whether the seed is one of the run's, its place there or the seed, stream
            and samples ahead.
    """

    n: int
    states: int
    names: list[str]
    table: int
    sums: int
    shared: list[int]
    own: list[int]
    draws: list[tuple[bool, int, int, int]]


def layout(traced: Trace) -> Layout:
    """Return the layout of the code of a trace."""
    draws = []
    for seed, stream, offset, _ in traced.draws:
        own = (True, seed.place) if isinstance(seed, Seed) else (False, seed)
        draws.append((*own, stream, offset))
    counts = len(traced.state), recorded_names(traced), len(traced.table), len(traced.sums)
    return Layout(traced.n, *counts, *traced.places, draws)


def layout_of(library: ctypes.CDLL) -> Layout:
    """Return the layout that is written in a library."""
    text = ctypes.c_char_p.in_dll(library, "layout").value
    assert text is not None
    return Layout(*json.loads(text))


def recorded_names(traced: Trace) -> list[str]:
    """Return the names of what is recorded, in the order of the generated code."""
    return [*_ORDER, *(name for name in traced.recorded if name not in _ORDER)]


def trace_used(
    loop: Any, state: Any, signals: bool, running: Running | None = None, contacts: bool = False
) -> Trace:
    """Return one sample of a loop, with the parameters that it uses alone; see :func:`trace`."""
    traced = trace(loop, state, signals, running, contacts)
    forms = [traced] if traced.usual is None else [traced, traced.usual]
    expressions: list[Any] = []
    used: set[str] = set()
    for form in forms:
        expressions += [*form.after, *form.summed]
        for group in (*form.recorded.values(), *form.holds):
            expressions += group
        for call in (*form.calls, *form.summed_calls, *form.early_calls):
            expressions += call.arguments
            used.update(map(str, call.parameters))
    used |= _names(expressions)
    shared = [i for i, symbol in enumerate(traced.shared) if str(symbol) in used]
    own = [i for i, symbol in enumerate(traced.own) if str(symbol) in used]
    for form in forms:  # both have the same parameters, in the same order
        form.places = shared, own
        form.shared = [form.shared[i] for i in shared]
        form.own = [form.own[i] for i in own]
    return traced


def _names(expressions: Sequence[Any]) -> set[str]:
    """Return the names of the symbols in some expressions."""
    symbols = ca.symvar(ca.SX(ca.vertcat(*expressions)))
    return {str(symbol) for symbol in symbols}


def source(traced: Trace, lanes: int) -> str:
    """Return the C of a closed loop, whole; no number of :class:`armgpi.codegen.trace.Values` is in it."""
    dialect = Dialect()
    calls = [*traced.calls, *(traced.usual.calls if traced.usual else ())]
    calls += [*traced.summed_calls, *traced.early_calls]
    kernels = {call.kernel.name: call.kernel for call in calls}
    parts = [f"const char *const layout = {json.dumps(json.dumps(layout(traced)))};"]
    parts += [f"#define {name} {value}" for name, value in sizes(traced, lanes).items()]
    parts.append(library_text("lanes.h"))
    for kernel in kernels.values():
        parts += function(kernel, dialect)
    return "\n".join([*parts, *sample(traced, dialect), library_text("loop.h")])


def sizes(traced: Trace, lanes: int) -> dict[str, int]:
    """Return the sizes that `loop.h` needs, by the names of their macros."""
    return {
        "LANES": lanes,
        "N": traced.n,
        "NS": len(traced.state),
        "NO": len(traced.own),
        "NT": len(traced.table),
        "ND": len(traced.draws),
        "VARIABLES": len(recorded_names(traced)),
        "HELD": HELD,
        "TAU": TAU,
        "NA": len(traced.sums),
    }


def sample(traced: Trace, dialect: Dialect) -> list[str]:
    """Return the lines of the functions that take one sample, tell whether it was usual, and add it up.

    What parameters alone decide is worked out by `prepare`, once for many samples.
    """
    names = recorded_names(traced)
    head = "static __attribute__((noinline)) int"
    if traced.usual is None:
        whole = _sample_code(traced, names, dialect, 0)
        before, constants = whole.before, whole.constants
        lines = [f"{head} sample({_ARGUMENTS})", "{", *whole.lines, "return 0;", "}"]
    else:
        usual = _sample_code(traced.usual, names, dialect, 0)
        whole = _sample_code(traced, names, dialect, usual.constants)
        before, constants = ["{", *usual.before, "}", *whole.before], usual.constants + whole.constants
        # Bits do not change: what is left out decides nothing where all that is asked holds, in every lane.
        lines = [
            f"{head} usual({_ARGUMENTS})",
            "{",
            *(line for line in usual.lines if not _CONSTANT.fullmatch(line)),
            # Constants are stored after two usual samples: two states take turns.
            "if (!kept) {",
            *filter(_CONSTANT.fullmatch, usual.lines),
            "}",
            "return 1;",
            "}",
            f"{head} whole({_ARGUMENTS})",
            "{",
            *whole.lines,
            "return 0;",
            "}",
            f"static inline int sample({_ARGUMENTS})",
            "{",
            f"return usual({_GIVEN}) || whole({_GIVEN});",
            "}",
        ]
    prepare = [
        f"#define NC {constants}",
        "static __attribute__((noinline)) void prepare(const double *p, const V *o, V *restrict c)",
        "{",
        *before,
        "}",
    ]
    return [*prepare, *lines, *_sums(traced, names, dialect)]


def function(kernel: Kernel, dialect: Dialect) -> list[str]:
    """Return the lines of a kernel."""
    # Not inlined: a sample calls forward dynamics four times, and compilers take long over one huge function.
    return [
        f"static __attribute__((noinline)) void {kernel.name}(",
        "    const V *restrict x, const V *m, V *restrict y)",
        "{",
        *kernel.lines(dialect),
        "}",
    ]


#: The arguments of a sample, and their names.
_ARGUMENTS = """const V *restrict s, V *restrict z, const double *p,
    const V *o, const V *c, const V *t, const V *u, V k, V *restrict r, int kept"""
_GIVEN = "s, z, p, o, c, t, u, k, r, kept"
#: A line that writes what is always the same.
_CONSTANT = re.compile(r"[zr]\[\d+\] = v_set\([^a-z]*\);")


def _sample_code(traced: Trace, names: list[str], dialect: Dialect, constants: int) -> Code:
    """Return what takes one sample; `constants` as in :func:`armgpi.codegen.emit.straight_line`."""
    calls = _placed(traced, traced.calls)
    recorded = [x for name in names for x in traced.recorded[name]]
    targets = [*calls.targets, *_entry_names("z", traced.after), *_entry_names("r", recorded)]
    outputs = [*calls.outputs, *traced.after, *recorded]
    recorded_joints = [i % traced.n for i in range(len(recorded))]
    order = [*calls.order, *traced.joints, *recorded_joints]
    sites = list(calls.sites)
    for conditions in reversed(traced.holds):
        # As soon as it is known: what comes behind is not worked out for nothing.
        mentioned = _names(conditions)
        calls_before = 0
        for number, call in enumerate(traced.calls, 1):
            if mentioned.intersection(map(str, call.results)):
                calls_before = number
        count = len(conditions)
        arguments = len(outputs), len(outputs) + count
        sites.insert(calls_before, CallSite(arguments, (), ["if (!v_all(held)) return 0;"]))
        outputs += conditions
        targets += ["v_require("] * count
        order += [i * traced.n // count for i in range(count)]  # joint after joint
    inputs = [*_inputs(traced), *calls.inputs]
    code = straight_line(inputs, outputs, targets, dialect, sites, order, constants)
    held = ["M held = v_not((M){0});"] if traced.holds else []
    code.lines = [*_buffers(traced.calls), *held, *code.lines]
    return code


def _placed(traced: Trace, calls: Sequence[Call]) -> Placed:
    """Return calls of a trace as a straight line takes them."""
    own = {str(symbol): i for i, symbol in enumerate(traced.own)}

    def used(i: int, call: Call) -> list[str]:
        first_parameter = own[str(call.parameters[0])] if call.parameters else 0
        return _call(i, call.kernel, first_parameter)

    return place_calls(
        calls,
        # The arguments of a kernel are one array here, one after the other.
        lambda i, k, j: f"x_{i}[{sum(calls[i].kernel.sizes[:k]) + j}]",
        lambda i, j: f"y{i}[{j}]",
        used,
    )


def _buffers(calls: Sequence[Call]) -> list[str]:
    """Return the lines that declare arguments and results of calls."""
    return [f"V x_{i}[{len(call.arguments)}], y{i}[{call.kernel.size}];" for i, call in enumerate(calls)]


def _sums(traced: Trace, names: list[str], dialect: Dialect) -> list[str]:
    """Return the lines of the functions that add a sample to the sums; they do nothing without any."""
    inputs = [
        (traced.k, "k"),
        *_parameters(traced),
        *zip(traced.sums, _entry_names("a", traced.sums), strict=True),
    ]
    for name, symbols in traced.seen.items():
        first = names.index(name) * traced.n
        inputs += [(symbol, f"r[{first + j}]") for j, symbol in enumerate(symbols)]
    made = []
    for name, expressions, calls in (
        ("add_up", traced.summed, traced.summed_calls),
        ("add_early", traced.early, traced.early_calls),
    ):
        placed = _placed(traced, calls)
        # A sum that stays is not written.
        changed = [i for i, x in enumerate(expressions) if str(x) != str(traced.sums[i])]
        lines = straight_line(
            [*inputs, *placed.inputs],
            [*placed.outputs, *(expressions[i] for i in changed)],
            [*placed.targets, *(f"z[{i}]" for i in changed)],
            dialect,
            placed.sites,
            [*placed.order, *(i % traced.n for i in changed)],
        ).lines
        made += [
            f"static __attribute__((noinline)) void {name}(",
            "    const V *restrict r, const double *p, const V *o, V k, const V *restrict a, V *restrict z)",
            "{",
            *((*_buffers(calls), *lines) if changed else ()),
            "}",
        ]
    return made


def _inputs(traced: Trace) -> Iterator[tuple[Any, str]]:
    """Yield the symbols of a trace, each with what it is in C."""
    yield traced.k, "k"
    yield from zip(traced.state, _entry_names("s", traced.state), strict=True)
    yield from _parameters(traced)
    yield from zip(traced.table, _entry_names("t", traced.table), strict=True)
    draws = [x for draw in traced.draws for x in draw.symbols]
    yield from zip(draws, _entry_names("u", draws), strict=True)


def _parameters(traced: Trace) -> Iterator[tuple[Any, str]]:
    """Yield the symbols of parameters, each with what it is in C."""
    # Shared parameters are plain numbers in memory: a lane's worth of each would be read for nothing.
    yield from ((x, f"v_set(p[{i}])") for i, x in enumerate(traced.shared))
    yield from zip(traced.own, _entry_names("o", traced.own), strict=True)


def _entry_names(array: str, entries: list[Any]) -> list[str]:
    """Return the entries of a C array."""
    return [f"{array}[{i}]" for i in range(len(entries))]


def _call(i: int, kernel: Kernel, first: int) -> list[str]:
    """Return the lines of a call; where an argument makes the result zero, it costs nothing when it is."""
    call = f"{kernel.name}(x_{i}, o + {first}, y{i});"
    if kernel.skip is None:
        return [call]
    # D(q)^-1 of the saturation residual: most samples have none, in any lane.
    start = sum(kernel.sizes[: kernel.skip])
    places = range(start, start + kernel.sizes[kernel.skip])
    tests = " | ".join(f"v_ne(x_{i}[{j}], v_set(0.0))" for j in places)
    zeros = " ".join(f"y{i}[{j}] = v_set(0.0);" for j in range(kernel.size))
    return [f"if (v_any({tests})) {call} else {{ {zeros} }}"]


def library_text(name: str) -> str:
    """Return a file of C that comes with the package."""
    return (files("armgpi.codegen") / name).read_text(encoding="utf-8")
