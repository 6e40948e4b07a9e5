"""What parameters alone decide is worked out once, before the samples, and changes no bit."""

from __future__ import annotations

import ctypes
import re

import numpy as np
import pytest

import armgpi
from armgpi.codegen import build
from armgpi.codegen.algebra import ca
from armgpi.codegen.emit import Dialect, straight_line
from armgpi.codegen.source import library_text, source, trace_used
from armgpi.loop.closed_loop import ClosedLoop


def body(text: str, name: str) -> str:
    """Return what stands in a function of generated C."""
    found = re.search(rf"\b{name}\([^{{;]*\{{\n(.*?)\n\}}\n", text, re.DOTALL)
    assert found is not None
    return found[1]


@pytest.mark.parametrize("first", [None, 0])
def test_numbers_are_the_same_to_the_last_bit(first: int | None) -> None:
    # NumPy is the witness: each operation once, in the order of the text; products by a shared reciprocal.
    s, a, b = ca.SX.sym("s"), ca.SX.sym("a"), ca.SX.sym("b")
    root, bound = ca.sqrt(a + b), -a
    outputs = [s * root + b / root, ca.fmin(s / root, bound), ca.if_else(s < a * b, root, s), a * b]
    inputs = [(s, "s[0]"), (a, "o[0]"), (b, "o[1]")]
    code = straight_line(inputs, outputs, [f"z[{i}]" for i in range(4)], Dialect(), constants=first)
    assert bool(code.before) == (first is not None)
    assert any("v_sqrt" in line for line in code.lines) == (first is None)
    text = [
        "#define LANES 1",
        library_text("lanes.h"),
        "void f(const V *s, const V *o, V *z) {",
        f"V c[{code.constants + 1}]; {{",
        *code.before,
        "}",
        *code.lines,
        "}",
    ]
    function = build.library("\n".join(text)).f
    x, y, z = np.array([0.3]), np.array([0.7, 1.9]), np.empty(4)
    function(*(ctypes.c_void_p(part.ctypes.data) for part in (x, y, z)))
    size = np.sqrt(y[0] + y[1])
    inverse = 1.0 / size
    first_two = [x[0] * size + y[1] * inverse, min(x[0] * inverse, -y[0])]
    np.testing.assert_array_equal(z, [*first_two, size, y[0] * y[1]])


def test_a_sample_of_elastic_joints_takes_no_exponential() -> None:
    # What is left of a current loop after a sample: the same in each, and libm's takes a fifth of it.
    robot = armgpi.Robot.load("anthropomorphic3").with_armature(0.1)
    plant = armgpi.ElasticPlant(robot, gear_stiffness=2e3)
    q = robot.middle()
    loop = ClosedLoop(plant, armgpi.GPI(robot, 1e-3), armgpi.Hold(q))
    text = source(trace_used(loop, loop.init(), False), 4)
    assert "v_exp(" in body(text, "prepare")
    assert "v_exp(" not in body(text, "sample")
