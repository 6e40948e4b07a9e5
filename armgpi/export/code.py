"""From a law to the text of its C: header and source, with its counts."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from importlib.resources import files
from string import Template
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from armgpi import __version__
from armgpi.arrays import check_choice
from armgpi.codegen.emit import Dialect, straight_line
from armgpi.codegen.kernels import Call, Kernel, placed
from armgpi.codegen.symbols import NotElementwise
from armgpi.codegen.trace import check_repeatable
from armgpi.control.controller import Controller
from armgpi.errors import BackendError, ParameterError
from armgpi.export.faults import Bounds, Faults, bounds
from armgpi.export.law import INPUTS, Law, Routine, Table, trace_controller
from armgpi.export.layout import block, elementary, listed, members, rows
from armgpi.export.names import identifiers, plain, source_of
from armgpi.export.supervision import supervision
from armgpi.parameter import meaning

#: Number types: C's name, ending of literals and functions, largest number.
_REALS = {"double": ("double", "", "DBL_MAX"), "float": ("float", "F", "FLT_MAX")}
#: Bits that say in `armgpi_info.inputs` which arguments there are besides q_measured and q_ref.
INPUT_BITS = {"v_measured": 1, "v_ref": 2, "a_ref": 4}
#: What the arguments are.
MEANING = {
    "q_measured": "measured positions [rad or m]; continuous joints unwrapped",
    "v_measured": "measured velocities [rad/s or m/s]",
    "q_ref": "reference positions [rad or m]",
    "v_ref": "reference velocities [rad/s or m/s]",
    "a_ref": "reference accelerations [rad/s^2 or m/s^2]",
}
_KERNEL_NOTES = {
    "inertia_times": "Work out y = D(q) x, with the inertia matrix D, by the recursion of Newton and Euler.",
    "inertia_solve": "Work out y = D(q)^-1 x, by the factors L D L' of the inertia matrix.",
    "gravity": "Work out the torque y that gravity asks for at q.",
    "nonlinear_effects": "Work out y = C(q, x) x + G(q), for velocities x.",
    "inverse": "Work out the torque z for velocities x and accelerations y.",
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
        bounds: what it takes for a fault.
        typical: operations of a step whose torque is within its limits.
        worst_case: operations of any step, the one that meets a fault as well.
    """

    header: str
    source: str
    law: Law
    real: str
    bounds: Bounds
    typical: Counts
    worst_case: Counts


def generate(controller: Controller, real: str = "double", faults: Faults | None = None) -> Code:
    """Return a controller as C.

    Args:
        controller: for a single rollout.
        real: number type, "double" or "float".
        faults: how faults are handled; as :class:`Faults` has it when not given.

    Raises:
        ParameterError: when an argument is not as it should be.
        BackendError: when the controller does what has no C.
    """
    check_choice(real, "real", _REALS)
    if not isinstance(controller, Controller):
        raise ParameterError("controller", controller, "a Controller")
    limits = bounds(Faults() if faults is None else faults, controller)

    def written() -> Code:
        return _Writer(trace_controller(controller), real, limits).code()

    try:
        code = written()
        if code.law.user_defined:
            check_repeatable(code.source, lambda: written().source)
    except NotElementwise as error:
        raise BackendError(f"{type(controller).__name__} cannot be written as C: {error}") from None
    if real == "float" and code.law.whole:
        raise BackendError(
            f"{type(controller).__name__} cannot be written as C in single precision: its state has an int, "
            f"{code.law.whole[0]!r}, and a float counts no further than 16,777,216; choose double"
        )
    return code


class _Writer:
    """Puts a law into C."""

    def __init__(self, law: Law, real: str, limits: Bounds) -> None:
        self.law, self.real, self.bounds = law, real, limits
        self.ending = _REALS[real][1]
        self.dialect = Dialect("armgpi_real_t", "uint32_t", self.literal, ())
        robot = law.controller.robot
        self.names = robot.joint_names
        tables = law.tables
        # The supervision compares with it, whether the law does or not.
        if not any(table.path == "effort" for table in tables):
            effort = np.broadcast_to(law.controller.effort, (law.n,))
            tables = [Table("EFFORT", "effort", (law.n,), [], effort.tolist()), *tables]
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
        law, limits = self.law, self.bounds
        robot = law.controller.robot
        functions = [
            # In this order, as kernels are numbered by their first use.
            self.routine("law_init", law.init, writes_torque=False),
            self.routine("law_step", law.step, writes_torque=True),
            self.hold(),
        ]
        kernels = [self.kernel(kernel) for kernel in self.kernels.values()]
        frozen, hold = limits.frozen_samples > 0, limits.action == "hold"
        weighed = frozen or hold
        if not weighed:  # without a caller it would be a warning
            functions.pop()
            used = {call.kernel.name for call in (*law.init.calls, *law.step.calls)}
            kernels = [text for name, text in zip(self.kernels, kernels, strict=True) if name in used]
        body = "\n".join([*kernels, *functions])
        fill = {
            **self._shared(),
            "tables": "\n".join(map(self.table, self.tables)),
            "names": listed(f'    "{plain(name)}"' for name in self.names),
            "inputs": str(sum(INPUT_BITS.get(name, 0) for name in law.inputs)),
            "dt_double": repr(float(law.controller.dt)),
            "real_max": _REALS[self.real][2],
            "law": f"{type(law.controller).__name__}.init and {type(law.controller).__name__}.step",
            "helpers": elementary(body, self.ending),
            "kernels": "\n".join(kernels),
            "law_functions": "\n".join(functions),
            "zero": self.literal(0.0),
            **supervision(limits, law.inputs, self.names, self.ending, self.literal),
        }
        # The frozen check works out the arm's weight in every sample, and the torque to hold is it once more.
        law_step, law_hold = self._cost("law_step", law.step), self._cost("law_hold", law.hold)
        # D(q)^-1 of the saturation residual, which is zero in a typical step.
        skipped = [call.kernel.name for call in law.step.calls if call.kernel.skip is not None]
        typical = self.counts["law_step"].plus(
            *(self.counts[call.kernel.name] for call in law.step.calls if call.kernel.name not in skipped)
        )
        checking = law_hold if frozen else Counts(0, 0, 0)
        return Code(
            Template(template("armgpi_controller.h")).substitute(self._header(robot)),
            Template(template("armgpi_controller.c")).substitute(fill),
            law,
            self.real,
            limits,
            typical.plus(checking),
            law_step.plus(checking, law_hold if hold else Counts(0, 0, 0)),
        )

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
        text = "\n".join(lines)
        reads = [
            f"const armgpi_real_t {local} = {place};"
            for local, place in zip(locals_, places, strict=True)
            if re.search(rf"\b{local}\b", text)
        ]
        writes = [
            f"{place} = {new};"
            for place, new, local in zip(places, after, locals_, strict=True)
            if f"const armgpi_real_t {new} = {local};" not in same
        ]
        if writes_torque:
            # A torque beyond its limit is a fault, and after a fault the state must be the last good one.
            tail = ["joint = first_beyond(tau, EFFORT);"]
            if writes:
                tail += ["if (joint == ARMGPI_N) {", *(f"    {line}" for line in writes), "}"]
            lines = ["uint32_t joint;", *reads, *lines, *tail, "return joint;"]
            note = (
                "/* Work out the torque, and the next state, which is written when no torque is beyond its\n"
                "   limit. Return the first joint whose torque is, ARMGPI_N when none is. */"
            )
            kind, last = "uint32_t", ", armgpi_real_t tau[ARMGPI_N]"
        else:
            lines = [*reads, *lines, *writes]
            note = "/* Work out the state before the first sample. */"
            kind, last = "void", ""
        parameters = ",\n    ".join(f"const armgpi_real_t {x}[ARMGPI_N]" for x in self.law.inputs)
        head = f"static {kind} {name}(armgpi_state_t *state,\n    {parameters}{last})"
        return f"{note}\n{head}\n{block(lines, ['state', *self.law.inputs])}"

    def hold(self) -> str:
        """Return the function of the torque that carries the arm's weight."""
        targets = [f"tau[{j}]" for j in range(self.law.n)]
        lines = self._lines("law_hold", self.law.hold, [], targets, range(self.law.n))
        note = "/* Work out the torque that carries the arm's weight, within the limits. */"
        head = "static void law_hold(const armgpi_real_t q_measured[ARMGPI_N], armgpi_real_t tau[ARMGPI_N])"
        return f"{note}\n{head}\n{block(lines, ['q_measured'])}"

    def kernel(self, kernel: Kernel) -> str:
        """Return a function of the arm."""
        letters = "qxyz"[: len(kernel.sizes)]
        result = "qxyz"[len(kernel.sizes)] if len(kernel.sizes) < 4 else "r"
        inputs, begin = [], 0
        for letter, size in zip(letters, kernel.sizes, strict=True):
            inputs += [(kernel.inputs[begin + i], f"{letter}[{i}]") for i in range(size)]
            begin += size
        outputs = ca.cse(ca.vertcat(*kernel.outputs))  # a sine is worked out once
        targets = [f"{result}[{i}]" for i in range(kernel.size)]
        lines = straight_line(inputs, [outputs[i] for i in range(kernel.size)], targets, self.dialect).lines
        self.counts[kernel.name] = _counted(lines)
        kind = _kind(kernel)
        note = _KERNEL_NOTES.get(kind, f"Work out {kind}.").replace(" y", f" {result}", 1)
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
        calls = placed(
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
        self.counts[name] = _counted(lines)
        return _with_buffers(lines, buffers)

    def _cost(self, name: str, routine: Routine) -> Counts:
        """Return the operations of a routine with all that it calls."""
        return self.counts[name].plus(*(self.counts[call.kernel.name] for call in routine.calls))

    def _shared(self) -> dict[str, str]:
        """Return what both templates need."""
        robot: Any = self.law.controller.robot
        parameters = ",\n".join(f"    const armgpi_real_t {x}[ARMGPI_N]" for x in self.law.inputs)
        return {
            "title": f"{type(self.law.controller).__name__} controller of {plain(robot.name)}, "
            f"{self.law.n} joint{'s' if self.law.n > 1 else ''}, {self.law.controller.dt:g} s",
            "version": __version__,
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
        fields = [
            (
                f"armgpi_real_t {part.name}{'[ARMGPI_N]' if part.shape == (law.n,) else _size(part)};",
                _remark(law.first, part.path),
            )
            for part in law.state
        ]
        fields_of_status = [
            ("armgpi_status_t status;", "what it is in"),
            ("armgpi_reason_t reason;", "of a fault"),
            ("uint32_t fault_joint;", "joint concerned, see armgpi_joint_t"),
            ("armgpi_real_t q_last[ARMGPI_N];", "last good measurement [rad or m]"),
            ("armgpi_real_t tau_fault[ARMGPI_N];", "torque while in FAULT [N m or N]"),
        ]
        if self.bounds.frozen_samples:
            fields_of_status += [
                ("armgpi_real_t q_ref_mark[ARMGPI_N];", "reference when the measurement last changed"),
                ("armgpi_real_t excess_mark[ARMGPI_N];", "torque less weight, likewise [N m or N]"),
                ("uint32_t frozen_count[ARMGPI_N];", "samples that it should have changed in since"),
                ("uint32_t first;", "1 before the first sample"),
            ]
        what = {
            "hold": "the torque that carries the arm's weight\n * at the last good configuration",
            "zero": "zero",
        }
        return {
            **self._shared(),
            "joints": "\n".join(joints),
            "n": str(law.n),
            "dt": self.literal(law.controller.dt),
            "real": _REALS[self.real][0],
            "enum": listed(enum),
            "supervision": members(fields_of_status).rstrip("\n"),
            "fields": members(fields),
            "argument_notes": "\n".join(f" *   {name:11} {MEANING[name]}" for name in law.inputs),
            "action": what[self.bounds.action],
        }


def template(name: str) -> str:
    """Return the text of a template."""
    return (files("armgpi.export") / "templates" / name).read_text(encoding="utf-8")


def inputs_of(bits: int) -> list[str]:
    """Return the names of a step's arguments, from the bits of `armgpi_info.inputs`."""
    return [name for name in INPUTS if not INPUT_BITS.get(name, 0) & ~bits]


def _size(part: Table) -> str:
    """Return the brackets behind a name."""
    return f"[{len(part.symbols)}]" if part.shape else ""


def _remark(root: Any, path: str) -> str:
    """Return the path of a part in Python, and what it means."""
    said = plain(meaning(root, path))
    return f"{path}{': ' if said else ''}{said}"


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
        copies = {
            line: line[len(f"{name}[{j}] = ") :]
            for line in lines
            for j in range(size)
            if line.startswith(f"{name}[{j}] = ")
        }
        source = next(iter(copies.values()), "").partition("[")[0]
        if list(copies.values()) == [f"{source}[{j}];" for j in range(size)]:
            lines = [re.sub(rf"\b{name}\b", source, line) for line in lines if line not in copies]
        else:
            declared.append(f"armgpi_real_t {name}[{size}];")
    return [*declared, *lines]


def _counted(lines: Iterable[str]) -> Counts:
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
