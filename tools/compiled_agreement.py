"""Compare generated code with NumPy on every arm that can be loaded: 16 rollouts of 2 s with all sensors.

Each arm is under GPI with networks, measured 1 ms late, through a 16-bit encoder with noise, with friction,
saturation and a load of its own for each rollout. The table says how far the positions of the two backends
are apart at most while every measured count is the same, in how many rollouts an edge between two counts is
crossed at different samples, by how many counts they differ there, and how far apart they are from then on
(in counts); then, without the encoder, over all samples. See tests/codegen/loops.py for why.

Usage: python tools/compiled_agreement.py [--lanes 1 4 8] [--time 2] [ROBOT ...]

Below a count the loop is open, and some arms under constant torque double any rounding every 30 ms. So NumPy
is also compared with itself, started 2.2e-16 away. Exit code 1 when an arm's positions are
more than 1e-9 rad or m apart before an edge and ten times as far as NumPy's are from its own.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "codegen"))

import numpy as np
from arms import arm, experiment
from loops import Agreement, agreement, compiled

from armgpi import ArmgpiWarning, robots, simulate

ALLOWED = 1e-9


def cells(name: str, lanes: list[int], seconds: float, **io: bool) -> tuple[list[str], bool]:
    """Return an arm's part of the table with some sensors, and whether it is as it should be."""
    case = experiment(name, **io)
    arguments = (case.plant, case.controller, case.reference, seconds)
    by_numpy = simulate(*arguments, progress=False)
    runs = [compiled(*arguments, lanes=width) for width in lanes]
    same_end = all(np.array_equal(run["status"], by_numpy["status"]) for run in runs)
    found = [agreement(by_numpy, run, case.step_size) for run in runs]
    worst = Agreement(*(max(values) for values in zip(*found, strict=True)))
    alike = all(np.array_equal(run["q"], runs[0]["q"], equal_nan=True) for run in runs)
    out = [f"{worst.before:.1e}"]
    allowed = ALLOWED
    if case.step_size is not None:
        # What rounding alone makes of it: NumPy against itself, started 2.2e-16 away.
        q0 = np.tile(case.reference.at(0.0).q, (by_numpy.sizes["rollout"], 1))
        twin = simulate(*arguments, progress=False, q0=q0 + np.finfo(float).eps)
        own = agreement(by_numpy, twin, case.step_size)
        out.append(f"{own.before:.1e}, {own.crossings}")
        allowed = max(ALLOWED, 10.0 * own.before)
    if case.step_size is not None:
        out += [str(worst.crossings), f"{worst.counts:g}", f"{worst.after / np.min(case.step_size):.2g}"]
    error = float(np.abs(by_numpy["q"] - by_numpy["q_ref"]).max())
    out += [f"{error:.1e}", f"{int((by_numpy['status'] != 0).sum())}"]
    if len(lanes) > 1:
        out.append("alike" if alike else "DIFFER")
    return out, alike and same_end and worst.before < allowed and worst.counts <= 1.0


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("robots", nargs="*", default=robots.names())
    parser.add_argument("--lanes", nargs="+", type=int, default=[1, 4, 8])
    parser.add_argument("--time", type=float, default=2.0)
    chosen = parser.parse_args()
    warnings.simplefilter("ignore", ArmgpiWarning)
    encoder = (
        "apart before an edge",
        "NumPy from 2e-16 away: apart, crossings",
        "crossings",
        "counts there",
        "counts after",
        "error",
        "diverged",
    )
    header = (
        *("robot", "n"),
        *(f"{title}, noise" for title in (*encoder, f"lanes {chosen.lanes}")),
        *(f"{title}, no noise" for title in encoder),
        *(f"{title}, no encoder" for title in ("apart", "error", "diverged")),
    )
    print("| " + " | ".join(header) + " |\n|" + " --- |" * len(header), flush=True)
    good = True
    for name in chosen.robots:
        line = [name, str(arm(name)[0].n)]
        for io in ({}, {"noise": False}, {"encoder": False}):
            # All widths with all sensors; what differs between sensors does not differ between widths.
            part, fine = cells(name, chosen.lanes[-1:] if io else chosen.lanes, chosen.time, **io)
            line += part
            good &= fine
        print("| " + " | ".join(line) + " |", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
