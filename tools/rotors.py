"""Print how well the rule for rotors that no file tells (armgpi.robot.rotors) meets the published drives.

Usage:
    python tools/rotors.py
"""

from __future__ import annotations

import numpy as np

from armgpi.robot.rotors import PUBLISHED, SCATTER, SPIN_UP, Rotor, mean_spin_up, spin_up


def row(name: str, rotors: list[Rotor]) -> str:
    """Return a row of the table: how far published inertias are from what is believed of them."""
    ratio = np.array([spin_up(each) for each in rotors]) / SPIN_UP
    within = [float(np.mean(np.maximum(ratio, 1.0 / ratio) <= factor)) for factor in (2.0, SCATTER, 4.0)]
    shares = " | ".join(f"{100.0 * share:.0f} %" for share in within)
    return f"| {name} | {len(ratio)} | {ratio.min():.2f} to {ratio.max():.2f} | {shares} |"


def main() -> None:
    """Print the fitted time and the table."""
    print(f"spin-up: {1e3 * mean_spin_up():.1f} ms fitted, {1e3 * SPIN_UP:.1f} ms used\n")
    print(f"| drives | joints | true / believed | within 2 | within {SCATTER:g} | within 4 |")
    print("|---|---|---|---|---|---|")
    for part in ("fit", "held-out", "set by hand"):
        own = [each for each in PUBLISHED if each.part == part]
        print(row(f"**{part}**", own))
        for name in dict.fromkeys(each.robot for each in own):
            print(row(name, [each for each in own if each.robot == name]))
        if wrists := [each for each in own if each.wrist]:
            print(row(f"wrists, {part}", wrists))


if __name__ == "__main__":
    main()
