"""Mistakes listed by hand: ten styles of code, with the numbers of their files; what `validate` is scored on.

`byhand/` has a right model per style and, beside it, the mistakes: from errata, from questions of students,
from what each style invites. They were committed before anything was fitted to them. Every fourth line is
SEEN: what `validate` misses there may change it; the others only measure. THIRD styles were written later, to
change it as well; FOURTH ones last, by someone who had not read its code, and were scored once. SIXTH,
SEVENTH and EIGHTH styles too; half of their lines, drawn by a seed, are `aside`: what is missed there changes
nothing. NINTH ones were scored once as a whole, and changed it after that; TENTH and ELEVENTH ones are
aside as a whole.
`right/` has right models of robots in odd styles. One line is one mistake:

    what stands in the model ==> what a mistaken one has [&& a second] [## what a name has to match] [### why]

A backslash and n stand for the end of a line. A name is right when the repaired source equals the right one,
for other numbers too (but for printed coefficients), or when there is none and the text matches.

python tests/validation/byhand.py seen|unseen|all|third|fourth|fifth|open|aside|ninth|tenth|eleventh [STYLE]
"""

from __future__ import annotations

import ast
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import mutants
import numpy as np
import scoring
import textbooks

from armgpi import Robot, validate
from armgpi.validation.diagnose import UNNAMED

FOLDER = Path(__file__).parent / "byhand"
#: Styles of which every line may change the diagnosis.
THIRD = ("dh6", "homework", "rnea", "spong")
#: Styles committed before their first score, which is the evidence.
FOURTH = (
    "basenewton",
    "cartpoles",
    "column",
    "composite",
    "exponentials",
    "furuta",
    "kane",
    "nested",
    "printed",
    "scara4",
)
#: Styles committed before their first score, after the fourth had been fitted to.
FIFTH = ("boom", "crane", "frames", "swingers", "telescope", "twists")
#: Styles in none of the forms before; committed before their first score.
SIXTH = (
    "craig",
    "gantry",
    "leg",
    "mechanics",
    "pantilt",
    "params",
    "stacked",
    "stanford",
    "uicker",
    "unrolled",
    "wheel",
    "wrist",
)
#: Styles of reinforcement learning, of vectorised code, of equations of motion by SymPy and others; likewise.
SEVENTH = ("chain", "entries", "eom", "slabs", "swingup", "turned")
#: Styles written after these had been fitted to, before the search was changed again; likewise.
EIGHTH = (
    "articulated",
    "beamball",
    "catalogue",
    "defaults",
    "inherited",
    "lumped",
    "plain",
    "projected",
)
#: Styles written after these, scored once before the search was changed for them: evidence no more.
NINTH = ("duals", "flat", "formulas", "gibbs", "quaternions")
#: Styles by someone who had not read the search, committed before their first score.
TENTH = ("cached", "legnani", "particles", "reactions")
#: Likewise, after the search had been made faster on the tenth.
ELEVENTH = ("globals", "operators", "partials", "sequence")
#: Styles of which half of the lines are set aside.
HALVED = (*SIXTH, *SEVENTH, *EIGHTH)
LATER = (*THIRD, *FOURTH, *FIFTH, *HALVED, *NINTH, *TENTH, *ELEVENTH)
STYLES = tuple(sorted({path.stem for path in FOLDER.glob("*.txt")} - {*LATER}))
#: Every so many lines one line was looked at while the diagnosis was changed.
SEEN = 4


#: A base whose z is level and whose x points down.
WALL = (0.0, np.pi / 2, 0.0)
AHEAD, BACK = (np.pi / 2, 0.0, 0.0), (-np.pi / 2, 0.0, 0.0)
#: Parallel axes of the first link and the motor at its end.
ELBOW = 21.0 * 4.3 / 25.3 * (0.92 - 0.47) ** 2
#: Two points of a link as one body: its centre of mass, and its inertia about this.
LOADED = (1.3 * 0.14 + 0.45 * 0.36) / 1.75
LOADED_INERTIA = 0.0155 + 1.3 * 0.14**2 + 0.45 * 0.36**2 - 1.75 * LOADED**2
MOTORED = (3.1 * 0.171 + 0.85 * 0.325) / 3.95
MOTORED_INERTIA = 0.0412 + 0.0066 + 3.1 * 0.171**2 + 0.85 * 0.325**2 - 3.95 * MOTORED**2
#: UR5: alpha; mass; a, d; centre of mass and moments in the frames of Denavit and Hartenberg.
UR5 = [
    (np.pi / 2, 3.7, 0.0, 0.089159, (0.0, -0.02561, 0.00193), (0.0084, 0.0064, 0.0084)),
    (0.0, 8.393, -0.425, 0.0, (0.2125, 0.0, 0.11336), (0.0078, 0.21, 0.2)),
    (0.0, 2.275, -0.39225, 0.0, (0.15, 0.0, 0.0265), (0.0016, 0.0462, 0.0451)),
    (np.pi / 2, 1.219, 0.0, 0.10915, (0.0, -0.0018, 0.01634), (0.0016, 0.0009, 0.0017)),
    (-np.pi / 2, 1.219, 0.0, 0.09465, (0.0, 0.0018, 0.01634), (0.0018, 0.0009, 0.0016)),
    (0.0, 0.1879, 0.0, 0.0823, (0.0, 0.0, -0.001159), (0.0001, 0.00012, 0.00015)),
]


class Mistake(NamedTuple):
    """A model with mistakes: its style, line, how many, source, and what the name has to match."""

    style: str
    line: int
    many: int
    source: str
    name: str


def mistakes(style: str) -> Iterator[Mistake]:
    """Yield the mistakes of a style."""
    right = source(style)
    lines = (FOLDER / f"{style}.txt").read_text(encoding="utf-8").splitlines()
    for k, line in enumerate(lines, start=1):
        wrong, (text, _, name) = right, line.partition(" ### ")[0].partition(" ## ")
        changes = text.split(" && ")
        for change in changes:
            old, new = (x.replace("\\n", "\n") for x in change.split(" ==>", 1))
            if old not in wrong:
                raise ValueError(f"{style}.txt, line {k}: {style}.py has no {old!r}")
            wrong = wrong.replace(old, new.removeprefix(" "), 1)
        yield Mistake(style, k, len(changes), wrong, name)


def aside() -> set[tuple[str, int]]:
    """Return the half of the lines of HALVED styles that changes nothing: style and line."""
    found: set[tuple[str, int]] = set()
    for seed, styles in ((3401, SIXTH), (3407, SEVENTH), (3413, EIGHTH)):
        lines = [(style, mistake.line) for style in styles for mistake in mistakes(style)]
        drawn = np.random.default_rng(seed).permutation(len(lines))[: len(lines) // 2]
        found |= {lines[k] for k in drawn}
    return found


def source(style: str) -> str:
    """Return the right model of a style."""
    return (FOLDER / f"{style}.py").read_text(encoding="utf-8")


def robot(style: str) -> Robot:
    """Return the robot of a style."""
    turn, slide, ball = textbooks._turn, textbooks._slide, textbooks._round
    up, lift, dip = "0 0 1", "0 -1 0", "0 1 0"
    none = (0.0, 0.0, 0.0)

    def links(axis: str, rows: list[tuple[float, float, float, float]]) -> list[textbooks.Joint]:
        starts = [0.0, *(row[3] for row in rows)]
        return [
            turn(axis, (starts[k], 0, 0), m, (c, 0, 0), ball(inertia))
            for k, (m, c, inertia, _) in enumerate(rows)
        ]

    joints = {
        "closed": [
            turn(up, none, 1.0, none, ball(0.02)),
            turn(dip, (0.1, 0, 0), 2.0, (0.25, 0, 0), ball(0.015)),
            turn(dip, (0.5, 0, 0), 1.0, (0.2, 0, 0), ball(0.01)),
        ],
        "attributes": links(lift, [(3.0, 0.2, 0.04, 0.4), (2.0, 0.15, 0.02, 0.3), (1.0, 0.1, 0.005, 0.0)]),
        "matlab": [
            turn(up, none, 1.0, none, ball(0.05)),
            turn(lift, (0, 0, 0.3), 4.0, (0.2, 0, 0), ball(0.03)),
            slide("1 0 0", none, 2.0, (-0.3, 0, 0), ball(0.02)),
        ],
        "loops": links(lift, [(2.0, 0.2, 0.03, 0.4), (1.5, 0.15, 0.02, 0.3), (1.0, 0.1, 0.01, 0.2)]),
        "newton": [
            turn(up, none, 3.0, (0.05, 0, 0), (0.01, 0.02, 0.025)),
            turn(dip, (0, 0, 0.3), 2.0, (0.2, 0, 0), (0.005, 0.03, 0.028)),
            turn(dip, (0.4, 0, 0), 1.0, (0.15, 0, 0), (0.002, 0.012, 0.011)),
        ],
        "spatial": [
            turn(up, none, 2.5, (0, 0, 0.1), (0.02, 0.02, 0.01)),
            turn(lift, (0, 0, 0.25), 2.0, (0.2, 0, 0), (0.004, 0.03, 0.03)),
            turn(lift, (0.4, 0, 0), 1.0, (0.15, 0, 0), (0.002, 0.01, 0.012)),
        ],
        "graph": [
            turn(dip, none, 1.5, (0, 0, -0.25), ball(0.03)),
            turn(dip, (0, 0, -0.5), 1.0, (0, 0, -0.2), ball(0.015)),
        ],
        "lagrange": [
            turn(lift, none, 3.0, (0.1, 0, 0), ball(0.05)),
            slide("1 0 0", none, 2.0, (-0.25, 0, 0), ball(0.03)),
            turn(lift, none, 1.0, (0.2, 0, 0), ball(0.01)),
        ],
        "gears": links(lift, [(2.0, 0.2, 0.03, 0.4), (1.0, 0.15, 0.01, 0.0)]),
        "homework": links(lift, [(1.2, 0.16, 0.014, 0.35), (0.8, 0.13, 0.007, 0.0)]),
        "spong": links(lift, [(2.3, 0.21, 0.051, 0.45), (1.4, 0.17, 0.018, 0.0)]),
        "dh6": _by_denavit_hartenberg(UR5),
        "scara4": [
            turn(up, none, 5.0, (0.2, 0, 0), ball(0.1)),
            turn(up, (0.4, 0, 0), 4.0, (0.15, 0, 0), ball(0.06)),
            slide(up, (0.3, 0, 0), 1.5, none, ball(0.01)),
            turn(up, none, 0.5, none, ball(0.004)),
        ],
        "cartpoles": [
            slide("1 0 0", none, 1.5, none, ball(0.01)),
            turn(dip, none, 0.6, (0, 0, 0.25), ball(0.0125)),
            turn(dip, (0, 0, 0.5), 0.4, (0, 0, 0.2), ball(0.006)),
        ],
        "nested": [
            turn(up, none, 3.0, none, ball(0.08)),
            turn(lift, none, 4.0, (0.25, 0, 0), (0.01, 0.09, 0.09)),
            turn(lift, (0.5, 0, 0), 2.5, (0.2, 0, 0), (0.005, 0.04, 0.04)),
        ],
        "furuta": [
            turn(up, none, 0.4, (0.12, 0, 0), ball(0.003)),
            turn("1 0 0", (0.25, 0, 0), 0.15, (0, 0, -0.15), (0.0012, 0.0011, 0.0002)),
        ],
        "composite": [
            slide("1 0 0", none, 6.0, (0, 0, 0.1), (0.05, 0.06, 0.04)),
            turn(dip, (0, 0, 0.3), 2.0, (0.2, 0, 0), (0.003, 0.03, 0.028)),
            turn(up, (0.5, 0, 0), 1.0, (0.1, 0, 0.02), (0.002, 0.008, 0.009)),
        ],
        "basenewton": [
            turn(up, none, 3.0, (0.02, 0, 0.1), (0.03, 0.02, 0.01)),
            turn(dip, (0.1, 0, 0.2), 1.5, (0.15, 0, 0.01), (0.004, 0.01, 0.009)),
            turn("1 0 0", (0.3, 0, 0), 0.8, (0.1, 0.03, 0), (0.001, 0.003, 0.002)),
        ],
        "printed": [
            turn(up, none, 2.0, none, ball(0.06)),
            turn(lift, none, 3.0, (0.2, 0, 0), ball(0.05)),
            turn(lift, (0.4, 0, 0), 2.0, (0.1, 0, 0), ball(0.01)),
        ],
        "kane": [
            turn(lift, none, 2.0, (0.18, 0, 0.02), ball(0.025)),
            turn(lift, (0.35, 0, 0), 1.2, (0.14, 0, -0.03), ball(0.009)),
        ],
        "column": [
            turn(up, none, 4.0, none, ball(0.2)),
            slide(up, none, 3.0, (0.05, 0, 0), ball(0.04)),
            turn(lift, (0.15, 0, 0), 2.0, (0.3, 0, 0), ball(0.06)),
        ],
        "boom": [
            turn(up, none, 2.2, (0.03, 0, 0.12), (0.02, 0.018, 0.012)),
            turn(dip, (0.05, 0, 0.3), 1.7, (0.09, 0, 0.02), (0.004, 0.012, 0.011)),
            slide("1 0 0", (0.12, 0, 0), 0.9, (0.07, 0.01, 0), (0.001, 0.004, 0.0045)),
        ],
        "crane": [
            slide("1 0 0", none, 3.2, none, ball(0.01)),
            slide(up, none, 1.4, none, ball(0.01)),
            turn(dip, none, 0.55, (0.04, 0, -0.23), ball(0.0065)),
        ],
        "frames": [
            turn(up, none, 3.1, (0.02, 0, 0.36), (0.022, 0.02, 0.014)),
            turn(lift, (0.07, 0, 0.34), 2.1, (0.18, -0.01, 0), (0.004, 0.03, 0.031)),
            turn(lift, (0.38, 0, 0), 1.2, (0.15, 0, 0), (0.0015, 0.011, 0.01)),
        ],
        "swingers": [
            turn(lift, none, 2.75, (0.16, 0, 0.035), ball(0.027)),
            turn(lift, (0.33, 0, 0), 1.15, (0.12, 0, -0.028), ball(0.0074)),
        ],
        "telescope": [
            turn(lift, none, 2.4, (0.17, 0, 0), ball(0.03)),
            turn(lift, (0.36, 0, 0), 1.3, (0.11, 0, 0), ball(0.012)),
            slide("1 0 0", (0.15, 0, 0), 0.7, (0.04, 0, 0), ball(0.003)),
        ],
        "twists": [
            turn(up, none, 2.6, (0.02, 0, 0.15), (0.021, 0.017, 0.011)),
            turn(dip, (0.06, 0, 0.32), 1.9, (0.12, 0, 0), (0.003, 0.013, 0.012)),
            turn("1 0 0", (0.25, 0, 0), 0.6, (0.05, 0.02, 0), (0.0008, 0.0019, 0.0017)),
        ],
        "exponentials": [
            turn(up, none, 4.0, (0, 0, 0.1), (0.03, 0.03, 0.02)),
            turn(dip, (0, 0, 0.25), 3.0, (0.2, 0, 0), (0.006, 0.04, 0.04)),
            turn(dip, (0.4, 0, 0), 1.5, (0.15, 0, 0), (0.002, 0.015, 0.015)),
        ],
        "params": [
            # The second motor is at the end of the first link.
            turn(lift, none, 25.3, ((21.0 * 0.47 + 4.3 * 0.92) / 25.3, 0, 0), ball(1.9 + ELBOW)),
            turn(lift, (0.92, 0, 0), 14.0, (0.36, 0, 0), ball(0.83)),
        ],
        "pantilt": [
            turn(up, none, 1.1, none, ball(0.0123), rpy=WALL),
            turn(dip, none, 1.37, (0.064, 0, 0.041), (0.0046, 0.0067, 0.0052)),
        ],
        "stanford": [
            turn(up, none, 5.0, none, ball(0.21)),
            turn(lift, (0, 0.154, 0), 6.3, (0.087, 0, 0), ball(0.108)),
            slide("1 0 0", none, 4.1, (0.26, 0, 0), ball(0.067)),
        ],
        "craig": [
            turn(up, none, 4.2, (0, 0.01, -0.05), (0.11, 0.09, 0.07)),
            turn(up, (0, 0.243, 0), 9.1, (0.068, 0.006, -0.016), (0.13, 0.524, 0.539), rpy=BACK),
            turn(up, (0.432, 0, -0.093), 5.3, (0, -0.07, 0.014), (0.066, 0.0125, 0.086)),
            turn(up, (-0.02, 0.433, 0), 1.2, (0, 0, -0.019), (0.0018, 0.0018, 0.0013), rpy=BACK),
        ],
        "unrolled": [
            turn(up, none, 5.1, (0.04, 0, 0.11), (0.041, 0.043, 0.019), rpy=WALL),
            turn(up, (0.12, 0, 0.23), 3.4, (0.03, 0.09, -0.02), (0.022, 0.008, 0.021), rpy=AHEAD),
            slide(up, none, 1.6, (0, 0.01, 0.21), (0.0151, 0.0142, 0.0012))._replace(rpy=BACK),
        ],
        "stacked": [
            turn(up, (0, 0, 0.28), 3.3, (0.03, 0, 0.05), (0.02, 0.017, 0.012)),
            turn("1 0 0", (0.11, 0, 0.07), 2.1, (0.1, 0.02, 0), (0.003, 0.011, 0.0105)),
            turn(dip, (0.24, -0.05, 0), 0.9, (0.08, 0, 0.03), (0.0009, 0.0024, 0.002)),
        ],
        "wheel": [
            slide("1 0 0", none, 1.9, none, ball(0.01)),
            turn(dip, none, 0.34, (0, 0, 0.21), ball(0.0079)),
            turn(dip, (0, 0, 0.46), 0.27, none, ball(0.00062)),
        ],
        "mechanics": [
            turn(up, none, 4.4, (0.06, 0, 0), ball(0.052)),
            turn(dip, (0.13, 0, 0.37), 2.3, (0.27, 0, 0), (0.0064, 0.047, 0.0433)),
        ],
        "gantry": [
            slide("1 0 0", none, 11.3, none, ball(0.01)),
            slide("0 1 0", none, 4.7, none, ball(0.01)),
            turn("1 0 0", none, 0.6, none, ball(0.0035)),
            turn(dip, none, 2.9, (0, 0, -0.83), ball(0.0181)),
        ],
        "wrist": [
            turn("1 0 0", none, 0.9, none, ball(0.0031)),
            turn(dip, none, 0.74, (0.035, 0, 0), (0.00047, 0.00081, 0.00066)),
            turn("1 0 0", none, 0.42, (0.094, 0, 0), (0.00021, 0.00093, 0.00064)),
        ],
        "leg": [
            turn(lift, none, 7.4, (0, 0, -0.178), ball(0.13)),
            turn(lift, (0, 0, -0.41), 3.2, (0, 0, -0.186), ball(0.061)),
            turn(lift, (0, 0, -0.43), 1.1, (0, 0, -0.074), ball(0.0041)),
        ],
        "swingup": [
            turn(dip, none, 1.0, (0, 0, -0.5), ball(1.0)),
            turn(dip, (0, 0, -1.0), 1.0, (0, 0, -0.5), ball(1.0)),
        ],
        "duals": [
            turn(lift, none, 2.1, (0.19, 0, 0), ball(0.037)),
            turn(lift, (0.43, 0, 0), 1.75, (LOADED, 0, 0), ball(LOADED_INERTIA)),
        ],
        "flat": [
            slide(up, none, 4.6, none, ball(0.01)),
            turn(up, none, 3.95, (MOTORED, 0, 0), ball(MOTORED_INERTIA)),
            turn(up, (0.325, 0, 0), 1.7, (0.128, 0, 0), ball(0.0137)),
        ],
        "formulas": [
            turn(up, none, 1.0, none, ball(0.046)),
            turn(lift, none, 2.8, (0.19, 0, 0), (0.0052, 0.0437, 0.0437)),
            turn(lift, (0.41, 0, 0), 1.6, (0.15, 0, 0), (0.0021, 0.0139, 0.0139)),
        ],
        "gibbs": [
            slide("1 0 0", none, 5.2, none, ball(0.01)),
            turn(lift, none, 1.8, (0.18, 0, 0), ball(0.0274)),
            turn(lift, (0.39, 0, 0), 1.05, (0.16, 0, 0), ball(0.0097)),
        ],
        "quaternions": [
            turn(up, (0, 0, 0.15), 3.4, (0.02, 0, 0.12), (0.021, 0.0195, 0.012)),
            turn(lift, (0.07, 0, 0.21), 2.2, (0.17, -0.01, 0), (0.0045, 0.0228, 0.0213)),
            turn("1 0 0", (0.33, 0.02, 0), 0.95, (0.11, 0, 0.015), (0.0007, 0.0038, 0.0041)),
        ],
        "particles": [
            turn(up, none, 2.93, (0.031, -0.017, 0.142), (0.0236, 0.0191, 0.0127)),
            slide("1 0 0", (0.063, 0, 0.274), 1.87, (0.113, 0.024, -0.019), (0.0061, 0.0153, 0.0139)),
            turn(dip, (0.218, 0.037, -0.041), 0.76, (0.137, -0.011, 0.028), (0.0013, 0.0047, 0.0042)),
        ],
        "reactions": [
            turn(lift, none, 2.71, (0.203, 0, 0.019), ball(0.0386)),
            turn(lift, (0.437, 0, 0), 1.68, (0.148, 0, -0.027), ball(0.0173)),
            slide("1 0 0", (0.126, 0, 0.034), 0.83, (0.094, 0, 0.013), ball(0.0052)),
        ],
        "cached": [
            turn(dip, (0, 0, 0.153), 3.94, (0.044, -0.026, 0.117), (0.0287, 0.0314, 0.0169)),
            turn("1 0 0", (0.071, 0.052, 0.194), 1.47, (0.086, 0.033, 0.048), (0.0074, 0.0118, 0.0097)),
            turn(up, (0.126, -0.038, 0.067), 0.69, (0.059, 0.021, 0.036), (0.0018, 0.0029, 0.0024)),
        ],
        "sequence": [
            slide(up, (0, 0, 0.214), 6.37, (0.026, -0.013, 0.074), (0.0493, 0.0457, 0.0281)),
            turn(up, (0.081, 0, 0.057), 3.18, (0.138, 0.021, 0.018), (0.0067, 0.0294, 0.0283)),
            turn(dip, (0.263, 0.042, 0), 1.29, (0.117, -0.009, 0.023), (0.0019, 0.0087, 0.0079)),
        ],
        "partials": [
            slide("1 0 0", none, 7.43, none, ball(0.01)),
            turn(up, none, 3.26, (0.143, 0, 0), ball(0.0418)),
            turn(lift, (0.317, 0, 0), 1.84, (0.226, 0, 0), (0.0153, 0.0347, 0.0483)),
        ],
        "globals": _by_denavit_hartenberg(
            [
                (np.pi / 2, 5.27, 0.057, 0.286, (-0.041, -0.067, 0.019), (0.0387, 0.0264, 0.0351)),
                (0.0, 3.84, 0.334, 0.031, (-0.173, 0.012, 0.028), (0.0106, 0.0587, 0.0543)),
                (-np.pi / 2, 1.93, 0.048, 0.022, (-0.029, 0.016, 0.034), (0.0049, 0.0063, 0.0057)),
                (0.0, 0.68, 0.112, 0.193, (-0.061, 0.007, 0.013), (0.0009, 0.0017, 0.0015)),
            ]
        ),
        "operators": [
            turn("1 0 0", (0, 0, 0.172), 3.71, (0.083, -0.024, 0.037), (0.0187, 0.0263, 0.0241)),
            turn(up, (0.193, 0.028, 0.046), 2.16, (0.121, 0.017, -0.032), (0.0054, 0.0171, 0.0182)),
            slide("1 0 0", (0.157, -0.033, 0.029), 0.94, (0.068, 0.014, 0.022), (0.0011, 0.0036, 0.0039)),
        ],
        "chain": [
            turn(dip, none, 1.9, (0, 0, -0.45), none),
            turn(dip, (0, 0, -0.45), 1.3, (0, 0, -0.35), none),
            turn(dip, (0, 0, -0.35), 0.8, (0, 0, -0.3), none),
        ],
        "eom": [
            slide("1 0 0", none, 2.3, none, ball(0.01)),
            turn(lift, none, 0.62, (0, 0, -0.34), ball(0.019)),
        ],
        "slabs": _slabs(),
        "defaults": links(lift, [(2.0, 0.25, 0.04, 0.5), (1.0, 0.2, 0.02, 0.0)]),
        "catalogue": [
            turn(up, none, 8.0, none, ball(0.15)),
            slide(up, none, 5.5, (0.06, 0, 0), ball(0.08)),
            slide("1 0 0", none, 2.6, (0.21, 0, 0), ball(0.05)),
        ],
        "plain": [
            turn(lift, none, 1.4, (0, 0, -0.17), ball(0.021)),
            turn(lift, (0, 0, -0.38), 0.85, (0, 0, -0.15), ball(0.0093)),
        ],
        "beamball": [
            turn(lift, none, 1.1, (0.04, 0, 0), ball(0.085)),
            slide("1 0 0", none, 0.11, none, none),
        ],
        "lumped": [
            turn(lift, none, 1.1, (0.52, 0, 0), ball(0.13)),
            turn(
                lift,
                (0.95, 0, 0),
                2.2,
                (0.57 * np.cos(np.pi / 6), 0, -0.57 * np.sin(np.pi / 6)),
                ball(0.24),
            ),
        ],
        "inherited": links(
            lift, [(2.4, 0.22, 0.045, 0.45), (1.5, 0.16, 0.018, 0.35), (0.7, 0.11, 0.0035, 0.2)]
        ),
        "projected": links(lift, [(1.7, 0.19, 0.028, 0.42), (0.95, 0.17, 0.0102, 0.0)]),
        "articulated": [
            slide("1 0 0", none, 2.8, none, ball(0.01)),
            turn(lift, none, 1.2, (0.21, 0, 0), ball(0.024)),
            turn(lift, (0.44, 0, 0), 0.6, (0.16, 0, 0), ball(0.0071)),
        ],
        "entries": [
            turn(up, none, 1.0, none, ball(0.021)),
            turn(lift, none, 2.6, (0.17, 0, 0), (0.0, 0.031, 0.031)),
            turn(lift, (0.37, 0, 0), 1.4, (0.15, 0, 0), (0.0, 0.0105, 0.0105)),
        ],
        "turned": [
            turn(up, (0, 0, 0.1), 2.1, (0.03, 0, 0.14), (0.014, 0.013, 0.009)),
            turn(dip, (0.05, 0, 0.26), 1.6, (0.16, 0, 0.02), (0.003, 0.017, 0.016)),
            turn("1 0 0", (0.34, 0, 0), 0.7, (0.09, 0.01, 0), (0.001, 0.005, 0.0055)),
        ],
        "uicker": _by_denavit_hartenberg(
            [
                (np.pi / 2, 3.6, 0.07, 0.29, (-0.06, -0.05, 0.01), (0.025, 0.013, 0.022)),
                (0.0, 2.7, 0.31, 0.0, (-0.14, 0.0, 0.02), (0.006, 0.034, 0.031)),
                (0.0, 1.4, 0.26, 0.04, (-0.12, 0.01, 0.0), (0.0014, 0.011, 0.0105)),
            ]
        ),
        "coefficients": links(lift, [(3.0, 0.2, 0.04, 0.4), (2.0, 0.15, 0.02, 0.3), (1.0, 0.1, 0.005, 0.0)]),
    }.get(style, [])
    own = FOLDER / f"{style}.urdf"
    arm = Robot.from_xml(own.read_text("utf-8") if own.exists() else textbooks.written(style, joints))
    rotors = {
        "gears": [0.2, 0.025],
        "spong": [0.096, 0.0288],
        "params": [95.0**2 * 0.0112, 70.0**2 * 0.0087],
    }.get(style)
    return arm if rotors is None else arm.with_armature(np.array(rotors))


def _slabs() -> list[textbooks.Joint]:
    """Return two boxes of aluminium, each with its length along x: length, width, thickness."""
    found, at = [], 0.0
    for length, width, thickness in ((0.42, 0.06, 0.04), (0.36, 0.05, 0.03)):
        mass = 2700.0 * length * width * thickness
        moments = textbooks._round(mass * (length**2 + width**2) / 12)
        found.append(textbooks._turn("0 -1 0", (at, 0.0, 0.0), mass, (length / 2, 0.0, 0.0), moments))
        at = length
    return found


def _by_denavit_hartenberg(rows: list[tuple[Any, ...]]) -> list[textbooks.Joint]:
    """Return the joints of classic frames: after a link's frame stands the next joint's, turned by alpha."""
    found, at, tilt = [], (0.0, 0.0, 0.0), 0.0
    for turn, mass, a, d, (x, y, z), moments in rows:
        c, s = np.cos(turn), np.sin(turn)
        com, turned = (a + x, c * y - s * z, d + s * y + c * z), (turn, 0.0, 0.0)
        found.append(
            textbooks.Joint("revolute", "0 0 1", at, mass, com, moments, rpy=(tilt, 0.0, 0.0), turned=turned)
        )
        at, tilt = (a, 0.0, d), turn
    return found


def renumbered(text: str, seed: int) -> str:
    """Return a source with other numbers for all that have a name; equal names have equal ones."""
    rows = text.splitlines(keepends=True)
    found: list[tuple[str, ast.expr]] = []
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=names)], value=ast.Tuple(elts=values)):
                found += [(ast.unparse(a), b) for a, b in zip(names, values, strict=False)]
            case ast.Assign(targets=[ast.Name() | ast.Attribute() as target], value=ast.List(elts=values)):
                found += [(f"{ast.unparse(target)} {k}", value) for k, value in enumerate(values)]
            case ast.Assign(targets=[ast.Name() | ast.Attribute() as target], value=value):
                found.append((ast.unparse(target), value))
            case ast.AnnAssign(target=target, value=ast.expr() as value):  # a field of a dataclass
                found.append((ast.unparse(target), value))
            case ast.Dict(keys=keys, values=values):
                found += [(ast.unparse(a), b) for a, b in zip(keys, values, strict=True) if a]
            case ast.keyword(arg=str() as name, value=value):
                found.append((name, value))
    numbers = [
        (name, x) for name, x in found if isinstance(x, ast.Constant) and type(x.value) in (int, float)
    ]
    for name, x in sorted(numbers, key=lambda one: (-one[1].lineno, -one[1].col_offset)):
        if name in ("n", "N", "g") or abs(x.value) < 1e-8:  # the step of a derivative
            continue
        draw = np.random.default_rng([seed, *name.encode()]).uniform(0.7, 1.4)
        row = rows[x.lineno - 1].encode()
        # The draw belongs to the name: a wrong number must not come out as the right one.
        new = repr(round(float(x.value) * draw, 8)).encode()
        rows[x.lineno - 1] = (row[: x.col_offset] + new + row[x.end_col_offset :]).decode()
    return "".join(rows)


def same(one: str, other: str, n: int) -> bool:
    """Tell whether two sources are equal as expressions: with their numbers and with others."""
    for a, b in ((one, other), (renumbered(one, 7), renumbered(other, 7))):
        x, y = mutants._sampled(a, n), mutants._sampled(b, n)
        if x is None or y is None or x.keys() != y.keys():
            return False
        if any(np.abs(x[k] - y[k]).max() > 1e-8 * max(1e-3, np.abs(y[k]).max()) for k in x):
            return False
    return True


class Outcome(NamedTuple):
    """What became of one mistake."""

    mistake: Mistake
    found: bool
    named: bool
    confirmed: bool
    right: bool
    processor: float  # time of this process and of those it starts [s]
    text: str


def _processor_time() -> float:
    """Return the processor time of this process and of its children that have ended [s]."""
    return sum(os.times()[:4])


def outcome(mistake: Mistake, folder: Path) -> Outcome:
    """Validate a model with a mistake."""
    path, arm = folder / f"{mistake.style}.py", robot(mistake.style)
    path.write_text(mistake.source, encoding="utf-8")
    start = _processor_time()
    report = validate(path, arm)
    processor = _processor_time() - start
    first = report.causes[0] if report.causes else None
    named = first is not None and first.kind not in UNNAMED
    right = False
    if report.repaired is not None and first is not None and first.line is not None:
        right = same(report.repaired, source(mistake.style), arm.n)
    if named and first is not None and mistake.name and not right:
        right = re.search(mistake.name, first.text) is not None
    confirmed = first is not None and first.confirmed
    text = " | ".join(cause.text for cause in report.causes)
    return Outcome(mistake, not report.agrees, named, confirmed, right, processor, text)


def main(which: str, styles: tuple[str, ...]) -> None:
    """Score the seen, unseen or third mistakes of some styles, or all, and print what went wrong."""
    rows: list[Outcome] = []
    half = aside()
    with tempfile.TemporaryDirectory() as folder:
        for style in styles:
            mine = []
            for mistake in mistakes(style):
                if which in ("seen", "unseen") and (which == "seen") != (mistake.line % SEEN == 0):
                    continue
                if which in ("open", "aside") and (which == "aside") != ((style, mistake.line) in half):
                    continue
                one = outcome(mistake, Path(folder))
                mine.append(one)
                if not one.right:
                    told = "named" if one.named else "not named"
                    sure = ", confirmed" if one.confirmed else ""
                    print(f"{style} {mistake.line}: {told}{sure}: {one.text[:200]}", flush=True)
            rows += mine
            print(f"= {style}: {_line(mine)}", flush=True)
    print(f"= all single: {_line([o for o in rows if o.mistake.many == 1])}")
    print(f"= all pairs: {_line([o for o in rows if o.mistake.many > 1])}")


def _line(rows: list[Outcome]) -> str:
    named, right = [o for o in rows if o.named], sum(o.right for o in rows)
    wrong = sum(o.confirmed and not o.right for o in rows)
    seconds = sorted(o.processor for o in rows) or [0.0]
    return (
        f"found {sum(o.found for o in rows)}, right {scoring.share(right, len(rows))}; of named "
        f"{scoring.share(right, len(named))}; confirmed and wrong {wrong}; "
        f"processor time: median {seconds[len(seconds) // 2]:.1f} s, longest {seconds[-1]:.1f} s"
    )


if __name__ == "__main__":
    main(
        sys.argv[1],
        tuple(sys.argv[2:])
        or {
            "third": THIRD,
            "fourth": FOURTH,
            "fifth": FIFTH,
            "open": HALVED,
            "aside": HALVED,
            "ninth": NINTH,
            "tenth": TENTH,
            "eleventh": ELEVENTH,
        }.get(sys.argv[1], STYLES),
    )
