"""From a law to the text of its C: header and source, with its counts."""

from __future__ import annotations

import re
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from enum import IntEnum
from importlib.resources import files
from string import Template, ascii_uppercase, digits
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import check_choice, check_type
from armgpi.base.parameter import meaning
from armgpi.base.version import VERSION
from armgpi.codegen.algebra import ca
from armgpi.codegen.emit import Dialect, straight_line
from armgpi.codegen.kernels import Call, Kernel, place_calls
from armgpi.codegen.symbols import NotElementwise
from armgpi.codegen.trace import check_repeatable
from armgpi.control.controller import Controller
from armgpi.errors import BackendError, ParameterError
from armgpi.hardware.export.law import Law, Routine, Table, trace_controller
from armgpi.hardware.export.layout import block, comma_lines, elementary, members, rows
from armgpi.hardware.export.names import identifiers, plain, source_of
from armgpi.hardware.export.springs import compliance_code
from armgpi.loop.log import INPUTS
from armgpi.supervisor import COUNTED, Reason, State, Supervised, Supervisor
from armgpi.supervisor.reasons import REASONS

#: Number types: C's name, ending of literals and functions, largest number.
_REALS = {"double": ("double", "", "DBL_MAX"), "float": ("float", "F", "FLT_MAX")}
#: Bits that say in `armgpi_info.inputs` which arguments there are besides q_measured and q_ref.
INPUT_BITS = {"v_measured": 1, "v_ref": 2, "a_ref": 4}
#: A name in C.
_WORD = re.compile(r"\w+")
#: What the arguments are.
MEANING = {
    "q_measured": "measured positions [rad or m]; continuous joints unwrapped",
    "v_measured": "measured velocities [rad/s or m/s]",
    "q_ref": "reference positions [rad or m]",
    "v_ref": "reference velocities [rad/s or m/s]",
    "a_ref": "reference accelerations [rad/s^2 or m/s^2]",
}
#: Version of the interface of exported code: of functions and of what the state and the info begin with.
ABI = 3
_STATES = {
    State.INIT: "the torque ramps to the controller's first one",
    State.RUN: "the controller follows the reference",
    State.STOPPING: "the controller follows a reference that decelerates",
    State.HOLD: "that reference has stopped and the arm is at rest; the controller holds it there",
    State.FAULT: "open loop: engage the brakes",
}
_ACTIONS = {
    "brake": "the model's along the reference that decelerates, then its gravity torque",
    "hold": "the gravity torque at the last good position",
    "zero": "zero",
}
_KERNEL_NOTES = {
    "inertia_times": (
        "Work out {result} = D(q) x, with the inertia matrix D, by the recursion of Newton and Euler."
    ),
    "inertia_solve": "Work out {result} = D(q)^-1 x, by the factors L D L' of the inertia matrix.",
    "gravity": "Work out the gravity torque {result} at q.",
    "nonlinear_effects": "Work out {result} = C(q, x) x + G(q), for velocities x.",
    "inverse": "Work out the torque {result} for velocities x and accelerations y.",
    "inverse_where": "Work out w[0] times the torque {result} for velocities x and accelerations y.",
}


class Counts(NamedTuple):
    """Operations on numbers.

    Attributes:
        simple: additions, multiplications, comparisons and the like.
        divisions: divisions and square roots.
        transcendental: sines, cosines, exponentials, logarithms.
    """

    simple: int
    divisions: int
    transcendental: int

    def plus(self, *others: Counts) -> Counts:
        """Return the sum."""
        return Counts(*(sum(column) for column in zip(self, *others, strict=True)))


class Code(NamedTuple):
    """A controller as C.

    Attributes:
        header: text of armgpi_controller.h, or of the header by another name.
        source: text of armgpi_controller.c, or of the source by another name.
        law: what it was written from.
        real: "double" or "float".
        layout: a hash of what the state is made of.
        typical: operations of a step whose torque is within its limits.
        worst_case: operations of any step, the one that meets a fault as well.
        compliance: methods of the class in Python that change springs or a force limit; empty without any.
    """

    header: str
    source: str
    law: Law
    real: str
    layout: int
    typical: Counts
    worst_case: Counts
    compliance: str = ""

    @property
    def state_bytes(self) -> int:
        """Size of the state: four integers of 32 bits, then numbers, aligned to their size."""
        real = 4 if self.real == "float" else 8
        numbers = sum(len(part.symbols) for part in self.law.state)
        return -(-(16 + real * numbers) // real) * real


def generate(controller: Controller, real: str = "double", supervisor: Supervisor | None = None) -> Code:
    """Return a controller as C.

    Args:
        controller: for a single rollout.
        real: number type, "double" or "float".
        supervisor: what is taken for a fault; as :class:`armgpi.Supervisor` has it when not given.

    Raises:
        ParameterError: when an argument is not as it should be.
        BackendError: when the controller does what has no C.
    """
    check_choice(real, "real", _REALS)
    supervised = supervise(controller, supervisor)

    def write() -> Code:
        return _Writer(trace_controller(supervised), real).code()

    try:
        code = write()
        if code.law.user_defined:
            check_repeatable(code.source, lambda: write().source)
    except NotElementwise as error:
        raise BackendError(f"{type(supervised.law).__name__} cannot be written as C: {error}") from None
    if real == "float" and code.law.whole:
        name, whole = type(supervised.law).__name__, code.law.whole[0].removeprefix("law.")
        raise BackendError(
            f"{name} cannot be written as C in single precision: its state has an int, {whole!r}, and "
            "a float counts no further than 16,777,216; choose double"
        )
    return code


def supervise(controller: Controller, supervisor: Supervisor | None = None) -> Supervised:
    """Return a controller under its supervisor, or under this one.

    Raises:
        ParameterError: when it has one, and another is given.
    """
    check_type(controller, "controller", Controller, "a Controller")
    if not isinstance(controller, Supervised):
        return Supervised(controller, supervisor)
    if supervisor is not None:
        raise ParameterError("supervisor", supervisor, "left out, as the controller has one")
    return controller


class _Writer:
    """Puts a law into C."""

    def __init__(self, law: Law, real: str) -> None:
        self.law, self.real = law, real
        self.ending = _REALS[real][1]
        # Tables and literals are never NaN.
        sound = tuple(f"{ascii_uppercase}{digits}(")
        self.dialect = Dialect("armgpi_real_t", "uint32_t", self.literal, sound)
        robot = law.controller.robot
        self.names = robot.joint_names
        tables = law.tables
        # What the torque is checked against at last, whether the law uses it or not.
        last = {"bounds.rate": law.controller.bounds.rate, "effort": law.controller.effort}
        for path, values in last.items():
            if not any(table.path == path for table in tables):
                entries = np.broadcast_to(values, (law.n,)).tolist()
                tables = [Table(path.replace(".", "_").upper(), path, (law.n,), [], entries), *tables]
        self.tables = tables
        self.kernels: dict[str, Kernel] = {}
        self.counts: dict[str, Counts] = {}

    def literal(self, x: float) -> str:
        """Return a number as C, to its last digit; beyond the largest one there is no limit."""
        if np.isnan(x):
            raise ParameterError("controller", x, "made of numbers; it has a constant that is NaN")
        # The shortest text that reads back as the same number of its type.
        number = str(np.float32(x)) if self.real == "float" else repr(float(x))
        if "inf" in number:
            return "(-REAL_MAX)" if x < 0.0 else "REAL_MAX"
        text = number + self.ending
        return f"({text})" if number.startswith("-") else text

    def code(self) -> Code:
        """Return header and source."""
        law = self.law
        supervised = law.controller
        functions = [
            # In this order, as kernels are numbered by their first use.
            self.routine("law_init", law.init, writes_torque=False),
            self.routine("law_step", law.step, writes_torque=True),
        ]
        kernels = [self.kernel(kernel) for kernel in self.kernels.values()]
        body = "\n".join([*kernels, *functions])
        inner = type(supervised.law).__name__
        fill = {
            **self._shared_values(),
            "tables": "\n".join(map(self.table, self.tables)),
            "names": comma_lines(f'    "{plain(name)}"' for name in self.names),
            "inputs": str(sum(INPUT_BITS.get(name, 0) for name in law.inputs)),
            "dt_double": repr(float(supervised.dt)),
            "real_max": _REALS[self.real][2],
            "law": f"{inner}.init and {inner}.step, under Supervised.init and Supervised.step,",
            "helpers": elementary(body, self.ending),
            "kernels": "\n".join(kernels),
            "law_functions": "\n".join(functions),
            "zero": self.literal(0.0),
            "one": self.literal(1.0),
            "missed": str(supervised.supervisor.missed),
            "counted": self.literal(COUNTED),
            "filled": ", ".join({"q_measured": "q", "q_ref": "r"}.get(name, name) for name in law.inputs),
        }
        compliance = compliance_code(law, self.literal, template)
        called = (self.counts[call.kernel.name] for call in law.step.calls)
        law_step = self.counts["law_step"].plus(*called)
        # D(q)^-1 of the saturation residual, and the torque of the open loop: neither in a typical step.
        used = [call.kernel.name for call in law.step.calls if call.kernel.skip is None]
        typical = self.counts["law_step"].plus(*(self.counts[name] for name in used))
        return Code(
            Template(template("armgpi_controller.h")).substitute(
                self._header(supervised.robot), compliance=compliance.header
            ),
            Template(template("armgpi_controller.c")).substitute(fill, compliance=compliance.source),
            law,
            self.real,
            self.layout,
            typical,
            law_step,
            compliance.methods,
        )

    @property
    def layout(self) -> int:
        """A hash of what the state is made of: version, number type, and each part with its size."""
        parts = [f"{part.name}[{len(part.symbols)}]" for part in self.law.state]
        text = " ".join([str(ABI), self.real, *map(plain, self.names), *parts])
        return zlib.crc32(text.encode()) or 1

    def routine(self, name: str, routine: Routine, writes_torque: bool) -> str:
        """Return a function of the law that writes the state."""
        n = self.law.n
        entries = [(part, i) for part in self.law.state for i in range(len(part.symbols))]
        places = [f"state->{part.name}[{i}]" if part.shape else f"state->{part.name}" for part, i in entries]
        locals_ = [f"old_{part.name}_{i}" if part.shape else f"old_{part.name}" for part, i in entries]
        # All of the old state is read before any of the new is written.
        old = [(part.symbols[i], local) for (part, i), local in zip(entries, locals_, strict=True)]
        after = [f"new_{local[4:]}" for local in locals_]
        targets = [f"tau[{j}]" for j in range(n * writes_torque)]
        targets += [f"const armgpi_real_t {x}" for x in after]
        joints = [*range(n * writes_torque), *(i for _, i in entries)]
        lines = self._lines(name, routine, old, targets, joints)
        # What stays as it is needs no reading and no writing.
        same = {
            f"const armgpi_real_t {new} = {local};" for new, local in zip(after, locals_, strict=True)
        } & set(lines)
        lines = [line for line in lines if line not in same]
        used = set(_WORD.findall("\n".join(lines)))
        reads = [
            f"const armgpi_real_t {local} = {place};"
            for local, place in zip(locals_, places, strict=True)
            if local in used
        ]
        writes = [
            f"{place} = {new};"
            for place, new, local in zip(places, after, locals_, strict=True)
            if f"const armgpi_real_t {new} = {local};" not in same
        ]
        lines = [*reads, *lines, *writes]
        note, last = "/* Work out the state before the first sample. */", ""
        if writes_torque:
            note, last = "/* Work out the torque and the next state. */", ", armgpi_real_t tau[ARMGPI_N]"
        parameters = ",\n    ".join(f"const armgpi_real_t {x}[ARMGPI_N]" for x in self.law.inputs)
        head = f"static void {name}(armgpi_state_t *state,\n    {parameters}{last})"
        return f"{note}\n{head}\n{block(lines, ['state', *self.law.inputs])}"

    def kernel(self, kernel: Kernel) -> str:
        """Return a function of the arm."""
        # A first argument that switches it is no vector of the arm's.
        switched = kernel.skip == 0
        letters = ("w" if switched else "") + "qxyz"[: len(kernel.sizes) - switched]
        result = "qxyz"[len(kernel.sizes) - switched]
        inputs, begin = [], 0
        for letter, size in zip(letters, kernel.sizes, strict=True):
            inputs += [(kernel.inputs[begin + i], f"{letter}[{i}]") for i in range(size)]
            begin += size
        outputs = ca.cse(ca.vertcat(*kernel.outputs))  # a sine is worked out once
        targets = [f"{result}[{i}]" for i in range(kernel.size)]
        lines = straight_line(inputs, [outputs[i] for i in range(kernel.size)], targets, self.dialect).lines
        self.counts[kernel.name] = _count_operations(lines)
        kind = _kind(kernel)
        note = _KERNEL_NOTES.get(kind, f"Work out {kind}.").format(result=result)
        parameters = [f"const armgpi_real_t {x}[{n}]" for x, n in zip(letters, kernel.sizes, strict=True)]
        head = ", ".join([*parameters, f"armgpi_real_t {result}[{kernel.size}]"])
        return f"/* {note} */\nstatic void {self._kernel_name(kernel)}({head})\n{block(lines, letters)}"

    def _kernel_name(self, kernel: Kernel) -> str:
        """Return the name of a kernel in C: arm_inertia_times, and arm2_... of a second arm."""
        # Without the digest of the model, which would be another for every payload: exports stay comparable.
        alike = [name for name, other in self.kernels.items() if _kind(other) == _kind(kernel)]
        number = alike.index(kernel.name) + 1
        return f"arm{number if number > 1 else ''}_{_kind(kernel)}"

    def table(self, table: Table) -> str:
        """Return a table of constants."""
        numbers = [self.literal(x) for x in table.values]
        head = f"/* {_remark(self.law.controller, table.path)} */\nstatic const armgpi_real_t {table.name}"
        if not table.shape:
            return f"{head} = {numbers[0]};\n"
        return f"{head}[{len(numbers)}] = {{\n{rows(numbers, self.names)}\n}};\n"

    def _lines(
        self,
        name: str,
        routine: Routine,
        old: Sequence[tuple[Any, str]],
        targets: Sequence[str],
        joints: Sequence[int],
    ) -> list[str]:
        """Return the lines of a function of the law: outputs go to targets, and belong to joints."""
        inputs = list(old)
        for argument, symbols in self.law.inputs.items():
            inputs += [(x, f"{argument}[{j}]") for j, x in enumerate(symbols)]
        for table in self.tables:
            inputs += [
                (x, f"{table.name}[{i}]" if table.shape else table.name) for i, x in enumerate(table.symbols)
            ]
        for call in routine.calls:
            self.kernels.setdefault(call.kernel.name, call.kernel)
        calls = place_calls(
            routine.calls,
            lambda i, k, j: f"given{i}_{k}[{j}]",
            lambda i, j: f"result{i}[{j}]",
            lambda i, call: _call(i, call, self._kernel_name(call.kernel), self.literal(0.0)),
        )
        lines = straight_line(
            [*inputs, *calls.inputs],
            [*calls.outputs, *routine.outputs],
            [*calls.targets, *targets],
            self.dialect,
            calls.sites,
            [*calls.order, *joints],
        ).lines
        buffers = []
        for i, call in enumerate(routine.calls):
            buffers += [(f"given{i}_{k}", size) for k, size in enumerate(call.kernel.sizes)]
            buffers.append((f"result{i}", call.kernel.size))
        self.counts[name] = _count_operations(lines)
        return _with_buffers(lines, buffers)

    def _shared_values(self) -> dict[str, str]:
        """Return what both templates need."""
        robot: Any = self.law.controller.robot
        parameters = ",\n".join(f"    const armgpi_real_t {x}[ARMGPI_N]" for x in self.law.inputs)
        return {
            "title": f"{type(self.law.controller.law).__name__} controller of {plain(robot.name)}, "
            f"{self.law.n} joint{'s' if self.law.n > 1 else ''}, {self.law.controller.dt:g} s",
            "version": VERSION,
            "source": source_of(robot),
            "parameters": parameters,
            "arguments": ", ".join(self.law.inputs),
        }

    def _header(self, robot: Any) -> dict[str, str]:
        """Return what the header's template needs."""
        law = self.law
        width = max(map(len, self.names))
        lower, upper, velocity, _ = robot.limits
        joints = [
            f" *   {j:2}  {plain(name):{width}}  {kind:10} [{lower[j]:.6g}, {upper[j]:.6g}], "
            f"{velocity[j]:.6g} per s, at most {np.broadcast_to(law.controller.effort, law.n)[j]:.6g}"
            for j, (name, kind) in enumerate(zip(self.names, robot.joint_types, strict=True))
        ]
        parts = identifiers(self.names)
        enum = [f"    ARMGPI_JOINT_{name} = {j}" for j, name in enumerate(parts)]
        sizes: dict[tuple[int, ...], str] = {(): "", (law.n,): "[ARMGPI_N]"}
        fields = [
            (
                f"armgpi_real_t {part.name}{sizes.get(part.shape, f'[{len(part.symbols)}]')};",
                _remark(law.first, part.path),
            )
            for part in law.state
        ]
        return {
            **self._shared_values(),
            "joints": "\n".join(joints),
            "n": str(law.n),
            "dt": self.literal(law.controller.dt),
            "real": _REALS[self.real][0],
            "enum": comma_lines(enum),
            "abi": str(ABI),
            "layout": f"0x{self.layout:08X}U",
            "statuses": _enum_macros("STATUS", State, _STATES),
            "reasons": _enum_macros("REASON", Reason, {each: cause.when for each, cause in REASONS.items()}),
            "missed": str(law.controller.supervisor.missed),
            "fields": members(fields),
            "argument_notes": "\n".join(f" *   {name:11} {MEANING[name]}" for name in law.inputs),
            "action": _ACTIONS[law.controller.supervisor.on_fault],
        }


def _enum_macros(kind: str, names: type[IntEnum], notes: Mapping[Any, str]) -> str:
    """Return macros for the numbers of an enumeration, with their notes in a column."""
    width = max(len(each.name) for each in names)
    return "\n".join(
        f"#define ARMGPI_{kind}_{each.name:{width}} {int(each)}U /* {notes[each]} */" for each in names
    )


def template(name: str) -> str:
    """Return the text of a template."""
    # Python with holes in it is no Python: no tool shall read it as such.
    file = f"{name}.txt" if name.endswith(".py") else name
    return (files("armgpi.hardware.export") / "templates" / file).read_text(encoding="utf-8")


def inputs_of(bits: int) -> list[str]:
    """Return the names of a step's arguments, from the bits of `armgpi_info.inputs`."""
    return [name for name in INPUTS if not INPUT_BITS.get(name, 0) & ~bits]


def _remark(root: Any, path: str) -> str:
    """Return the path of a part in Python, and what it means."""
    said = plain(meaning(root, path))
    return f"{path.removeprefix('law.')}{': ' if said else ''}{said}"


def _kind(kernel: Kernel) -> str:
    """Return the name of a kernel without the digest of its model."""
    return kernel.name.rpartition("_")[0]


def _call(i: int, call: Call, name: str, zero: str) -> list[str]:
    """Return the lines of the use of a kernel."""
    kernel = call.kernel
    given = [f"given{i}_{k}" for k in range(len(kernel.sizes))]
    used = f"{name}({', '.join([*given, f'result{i}'])});"
    if kernel.skip is None:
        return [used]
    # Where the argument is zero so is the result, at no cost: the one branch on data that a step has.
    return [
        f"if (any_nonzero({given[kernel.skip]}, {kernel.sizes[kernel.skip]}U) != 0U) {{",
        f"    {used}",
        "} else {",
        *(f"    result{i}[{j}] = {zero};" for j in range(kernel.size)),
        "}",
    ]


def _with_buffers(lines: list[str], buffers: Sequence[tuple[str, int]]) -> list[str]:
    """Return lines behind the arrays that they use; a copy of an array as it is, is left out."""
    # Often an argument is the measurement itself, or what another call has given.
    declared = []
    for name, size in buffers:
        begin = f"{name}["
        filling = [line for line in lines if line.startswith(begin)]
        copies = {
            line: line[len(f"{name}[{j}] = ") :]
            for line in filling
            for j in range(size)
            if line.startswith(f"{name}[{j}] = ")
        }
        source = next(iter(copies.values()), "").partition("[")[0]
        if list(copies.values()) == [f"{source}[{j}];" for j in range(size)]:
            lines = [re.sub(rf"\b{name}\b", source, line) for line in lines if line not in copies]
        else:
            declared.append(f"armgpi_real_t {name}[{size}];")
    return [*declared, *lines]


def _count_operations(lines: Iterable[str]) -> Counts:
    """Count the operations in lines."""
    # From the C itself, so that what is counted is what is run.
    kinds: Counter[str] = Counter()
    for line in lines:
        found = re.match(r"const \w+ i?x\d+ = (.*);$", line)
        if found is None:
            continue
        if re.match(r"v_(sin|cos|exp|log|tan|tanh|atan|fmod)\(", found[1]):
            kinds["transcendental"] += 1
        elif " / " in found[1] or found[1].startswith("v_sqrt("):
            kinds["divisions"] += 1
        else:
            kinds["simple"] += 1
    return Counts(kinds["simple"], kinds["divisions"], kinds["transcendental"])
