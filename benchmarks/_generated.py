"""The generated kernels by themselves, in a loop in C over a batch: the floor of the compiled backend."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from importlib.resources import files

import numpy as np
import numpy.typing as npt

from armgpi import Robot
from armgpi.codegen import build
from armgpi.codegen.emit import Dialect
from armgpi.codegen.kernels import Arm

Array = npt.NDArray[np.float64]

#: One control step by Runge-Kutta of order 4: D(q) v once, forward dynamics four times.
_STEP = """
void step(const double *at, double *to, int64_t blocks, int64_t repeats)
{{
    V y[{n}], x[3 * {n}];
    for (int64_t r = 0; r < repeats; ++r)
        for (int64_t b = 0; b < blocks; ++b) {{
            memcpy(x, at + b * 3 * {n} * LANES, sizeof x);
            {times}(x, 0, y);
            for (int j = 0; j < {n}; ++j) x[2 * {n} + j] = y[j];
            for (int stage = 0; stage < 4; ++stage) {{
                {forward}(x, 0, y);
                for (int j = 0; j < {n}; ++j) x[j] = x[j] + 1e-3 * y[j];
            }}
            memcpy(to + b * {n} * LANES, y, sizeof y);
        }}
}}
"""
_LOOP = """
void loop_{name}(const double *at, double *to, int64_t blocks, int64_t repeats)
{{
    V x[{inputs}], y[{outputs}];
    for (int64_t r = 0; r < repeats; ++r)
        for (int64_t b = 0; b < blocks; ++b) {{
            memcpy(x, at + b * {inputs} * LANES, sizeof x);
            {name}(x, 0, y);
            memcpy(to + b * {outputs} * LANES, y, sizeof y);
        }}
}}
"""


class Kernels:
    """The generated kernels of one robot for a number of lanes, compiled.

    Attributes:
        operations: kernel -> arithmetic operations of one evaluation.
        lanes: how many states one evaluation takes.
    """

    def __init__(self, robot: Robot, lanes: int, names: Sequence[str]) -> None:
        """Generate and compile the kernels that are methods of the robot's dynamics by these names."""
        arm = Arm(robot.dynamics)
        self.lanes = lanes
        self._kernels = {name: arm.kernel(name) for name in names}
        codes = {name: kernel.code(Dialect()) for name, kernel in self._kernels.items()}
        self.operations = {name: code.operations for name, code in codes.items()}
        parts = [f"#define LANES {lanes}", (files("armgpi.codegen") / "lanes.h").read_text()]
        for name, kernel in self._kernels.items():
            parts.append(
                f"static __attribute__((noinline)) void {kernel.name}(\n"
                "    const V *restrict x, const V *m, V *restrict y)\n{\n"
                + "\n".join(codes[name].lines)
                + "\n}\n"
                + _LOOP.format(name=kernel.name, inputs=len(kernel.inputs), outputs=kernel.size)
            )
        self._sizes = {f"loop_{kernel.name}": kernel.size for kernel in self._kernels.values()}
        if {"forward", "inertia_times"} <= set(names):
            self._sizes["step"] = robot.n
            forward, times = (self._kernels[name].name for name in ("forward", "inertia_times"))
            parts.append(_STEP.format(n=robot.n, forward=forward, times=times))
        self._library = build.library("\n".join(parts), (*build.FLAGS, *(build.SCALAR if lanes == 1 else ())))

    def call(self, name: str, at: Array, to: Array, repeats: int) -> None:
        """Evaluate a kernel for packed arguments, again and again; `to` is packed as well.

        The name "step" stands for the kernels of one control step, for q, v and a.
        """
        self._run("step" if name == "step" else f"loop_{self._kernels[name].name}", at, to, repeats)

    def packed(self, columns: Array) -> Array:
        """Return states (batch, k) as blocks of k vectors of lanes, aligned for them."""
        batch, k = columns.shape
        if batch % self.lanes:
            raise ValueError(f"a batch of {batch} does not fill {self.lanes} lanes")
        buffer = aligned(batch * k)
        buffer.reshape(-1, k, self.lanes)[:] = columns.reshape(-1, self.lanes, k).swapaxes(1, 2)
        return buffer

    def unpacked(self, buffer: Array, k: int) -> Array:
        """Return what `packed` makes of states, as states (batch, k)."""
        return buffer.reshape(-1, k, self.lanes).swapaxes(1, 2).reshape(-1, k)

    def _run(self, name: str, at: Array, to: Array, repeats: int) -> None:
        """Call a loop of the library, which does not hold Python's lock."""
        blocks = to.size // (self._sizes[name] * self.lanes)
        getattr(self._library, name)(
            ctypes.c_void_p(at.ctypes.data),
            ctypes.c_void_p(to.ctypes.data),
            ctypes.c_int64(blocks),
            ctypes.c_int64(repeats),
        )


def aligned(size: int) -> Array:
    """Return buffer for numbers that begins where a vector may."""
    buffer = np.empty(size + 8)
    begin = (-buffer.ctypes.data % 64) // 8
    return buffer[begin : begin + size]
