"""Streams of poses as C: kinematics and follower traced from what Python runs, the inverse its twin.

The same text is in exported controllers (``armgpi_follow.c``) and, as a library, works out the samples of
streams before a compiled run: :func:`sample_streams`.
"""

from __future__ import annotations

import copy
import ctypes
import re
from string import Template
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from armgpi.base.arrays import SMALLEST, Array
from armgpi.base.version import VERSION
from armgpi.codegen import build
from armgpi.codegen.emit import Dialect, literal, straight_line
from armgpi.codegen.source import library_text
from armgpi.codegen.symbols import Symbols, flat
from armgpi.codegen.trace import tracing
from armgpi.references.batch import ReferenceBatch
from armgpi.references.following import Follower, FollowLimits, SetpointInverse, Setpoints, constants
from armgpi.references.reference import Reference, Target
from armgpi.robot.frame_motion import FrameMotion
from armgpi.robot.robot import Robot

#: Positions of poses beyond this are no positions of an arm's tool [m].
_FARTHEST = 1e6
#: How near to its goal, and how slow, the reference of a stream counts as at rest [rad or m, per s].
_RESTS = 1e-4
_DIALECT = Dialect("double", "uint32_t", literal)
#: What a step calls, by name.
_HELPERS = {
    "v_abs": "double v_abs(double x) { return fabs(x); }",
    "v_sqrt": "double v_sqrt(double x) { return sqrt(x); }",
    "v_exp": "double v_exp(double x) { return exp(x); }",
    "v_log": "double v_log(double x) { return log(x); }",
    "v_min": "double v_min(double a, double b) { return ((a < b) || !(a >= a)) ? a : b; }",
    "v_max": "double v_max(double a, double b) { return ((b < a) || !(a >= a)) ? a : b; }",
    "v_lower": "double v_lower(double a, double b) { return (b < a) ? b : a; }",
    "v_upper": "double v_upper(double a, double b) { return (a < b) ? b : a; }",
    "v_sign": "double v_sign(double x) { return (x > 0.0) ? 1.0 : ((x < 0.0) ? -1.0 : 0.0); }",
}
#: What precedes the C of a library: there is no controller's header.
_ALONE = """\
#include <stdint.h>
typedef double armgpi_real_t;
#define ARMGPI_N {n}U
"""
#: Works out the samples of a stream: what a library has besides.
_RUN = """
void run(const armgpi_follow_limits_t *limits, const double *start, uint32_t poses, const double *times,
    const double *places, const double *turns, uint32_t samples, double *out)
{
    armgpi_follow_t follow;
    uint32_t next = 0U;
    uint32_t k;
    uint32_t i;

    armgpi_follow_begin(&follow, limits, start);
    armgpi_follow_next(&follow, 0U, out, &out[N], &out[2U * N]);
    for (k = 1U; k < samples; ++k) {
        const double t = (double)follow.sample * limits->dt;
        const uint32_t first = next;
        while ((next < poses) && (times[next] <= (t + 1e-9))) {
            ++next;
        }
        if (next > first) {
            for (i = 0U; i < 12U; ++i) {
                const uint32_t last = next - 1U;
                follow.next[i] = (i < 3U) ? places[(3U * last) + i] : turns[((9U * last) + i) - 3U];
            }
            follow.next_arrived = times[next - 1U];
            follow.waiting = 1U;
        }
        out = &out[3U * N];
        armgpi_follow_next(&follow, 1U, out, &out[N], &out[2U * N]);
    }
}
"""


class FollowCode(NamedTuple):
    """A stream of poses as C.

    Attributes:
        header: text of armgpi_follow.h.
        source: text of armgpi_follow.c.
    """

    header: str
    source: str


def follow_code(
    robot: Robot, limits: FollowLimits, inverse: SetpointInverse, dt: float, feedforward: bool = False
) -> FollowCode:
    """Return the C that follows poses of a frame.

    Args:
        robot: the arm.
        limits: of speed, acceleration and jerk, arrays (n,).
        inverse: the inverse kinematics, with its frame and posture.
        dt: sample time [s].
        feedforward: whether the poses' own speed is anticipated.
    """
    numbers = {**constants(), "SMALLEST": SMALLEST, "FARTHEST": _FARTHEST, "RESTS": _RESTS}
    whole = {"ITERATIONS", "RETRIES"}
    defined = [
        f"#define {name} {int(value)}U" if name in whole else f"#define {name} {literal(float(value))}"
        for name, value in numbers.items()
    ]
    step = _step()
    helpers = [f"static inline {text}" for name, text in _HELPERS.items() if f"{name}(" in step]
    fill = {
        "version": VERSION,
        "helpers": "\n".join(helpers),
        "frame": re.sub(r"[^\w .-]", "?", inverse.frame, flags=re.ASCII),
        "constants": "\n".join(defined),
        "length": literal(inverse.length),
        "units": _row(inverse.units),
        "limits": _initial(limits, inverse, dt, feedforward),
        "kinematics": _kinematics(robot, inverse.frame),
        "step": step,
    }
    texts = (Template(library_text(name)).substitute(fill) for name in ("follow.h", "follow.c"))
    return FollowCode(*texts)


def sample_streams(reference: Reference, seconds: float) -> None:
    """Work out the samples of the streams in a reference by generated code, to 1e-9 those of Python.

    Streams with an inverse of the user's own stay Python's.

    Args:
        reference: any; a batch is gone through.
        seconds: how far [s].

    Raises:
        BackendError: when there is no compiler, or it fails.
        NotElementwise: when the arm's kinematics have no expression.
    """
    parts = reference.references if isinstance(reference, ReferenceBatch) else (reference,)
    for part in parts:
        if type(part) is Setpoints and type(part.inverse) is SetpointInverse:
            count = round(seconds / part.follower.dt) + 3
            if part.sampled < count:
                part.take_samples(_samples(part, part.inverse, count))


#: Arm -> frame -> its library, as tracing takes longer than a stream.
_LIBRARIES: WeakKeyDictionary[Robot, dict[str, ctypes.CDLL]] = WeakKeyDictionary()


def _samples(stream: Setpoints, inverse: SetpointInverse, count: int) -> Target:
    """Return the first samples of a stream, arrays (count, n)."""
    n = stream.robot.n
    follower = stream.follower
    limits = [np.broadcast_to(x, (n,)) for x in follower.limits]
    library = _library(stream.robot, inverse)
    given = np.concatenate(
        [[follower.dt, float(stream.feedforward)], *limits, *inverse.margins, np.asarray(inverse.home)]
    )
    out = np.empty((count, 3, n))
    arrays = [
        np.ascontiguousarray(x, dtype=np.float64)
        for x in (given, stream.start, stream.times, stream.poses.positions, stream.poses.rotations)
    ]
    places = [ctypes.c_void_p(x.ctypes.data) for x in arrays]
    library.run(
        *places[:2],
        ctypes.c_uint32(len(stream.times)),
        *places[2:],
        ctypes.c_uint32(count),
        ctypes.c_void_p(out.ctypes.data),
    )
    return Target(*(np.ascontiguousarray(out[:, i]) for i in range(3)))


def _library(robot: Robot, inverse: SetpointInverse) -> ctypes.CDLL:
    """Return the library of an arm and a frame; limits, posture and sample time are given to it each time."""
    known = _LIBRARIES.setdefault(robot, {})
    if inverse.frame not in known:
        # With numbers that are the same for all streams, so that another stream compiles nothing.
        alike = FollowLimits(*(np.ones(robot.n) for _ in FollowLimits._fields))
        code = follow_code(robot, alike, inverse.with_home(robot.middle()), 1.0)
        header = code.header.replace('#include "armgpi_controller.h"', _ALONE.format(n=robot.n))
        source = header + code.source.replace('#include "armgpi_follow.h"', "") + _RUN
        known[inverse.frame] = build.library(source, (*build.FLAGS, *build.SCALAR))
    return known[inverse.frame]


def _kinematics(robot: Robot, frame: str) -> str:
    """Return the body that works out position, rotation and Jacobian of a frame."""
    n = robot.n
    with tracing():
        q: Any = Symbols.new("q", (n,))
        v: Any = Symbols.new("v", (n,))
        motion = FrameMotion(robot, frame).at(q, v)
        outputs = [*flat(np.broadcast_to(motion.position, (3,)))]
        outputs += flat(np.broadcast_to(motion.rotation, (3, 3)).reshape(9))
        for part in range(2):
            for row in range(3):
                for lever in motion.levers:
                    outputs += flat(np.zeros(1) if lever is None else lever[part][..., row : row + 1])
    targets = [f"y[{i}]" for i in range(len(outputs))]
    inputs = [(x, f"q[{j}]") for j, x in enumerate(flat(q))]
    lines = straight_line(inputs, outputs, targets, _DIALECT).lines
    text = "\n".join(f"    {line}" for line in lines)
    unused = "" if re.search(r"\bq\[", text) else "    (void)q;\n"
    return "{\n" + unused + re.sub(r"\bv_(sin|cos)\(", r"\1(", text) + "\n}\n"


def _step() -> str:
    """Return the body that takes a step of one joint: :meth:`armgpi.Follower.step`, traced."""
    with tracing():
        follower = copy.copy(Follower(FollowLimits(1.0, 1.0, 1.0), 1e-3))
        c: Any = Symbols.new("c", (8,))
        x: Any = Symbols.new("x", (3,))
        goal: Any = Symbols.new("goal", (1,))
        speed: Any = Symbols.new("speed", (1,))
        follower.plan = type(follower.plan)(*(c[i : i + 1] for i in range(8)))
        after = follower.step(goal, Target(*(x[i : i + 1] for i in range(3))), speed)
    names = [*zip(flat(goal), ["goal"], strict=True), *zip(flat(speed), ["speed"], strict=True)]
    names += [(symbol, f"c[{i}]") for i, symbol in enumerate(flat(c))]
    names += [(symbol, f"x[{i}]") for i, symbol in enumerate(flat(x))]
    outputs = [y for part in after for y in flat(part)]
    lines = straight_line(names, outputs, [f"y[{i}]" for i in range(3)], _DIALECT).lines
    return "{\n" + "\n".join(f"    {line}" for line in lines) + "\n}\n"


def _initial(limits: FollowLimits, inverse: SetpointInverse, dt: float, feedforward: bool) -> str:
    """Return the initial values of armgpi_follow_limits."""
    n = inverse.robot.n
    rows: list[Array] = [np.broadcast_to(x, (n,)) for x in (*limits, *inverse.margins, inverse.home)]
    first = [f"    {literal(dt)}", f"    {literal(float(feedforward))}"]
    return ",\n".join([*first, *(f"    {{{_row(row)}}}" for row in rows)])


def _row(values: Any) -> str:
    """Return numbers of C."""
    return ", ".join(literal(float(x)) for x in values)
