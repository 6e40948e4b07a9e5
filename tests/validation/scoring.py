"""How well mistakes are named: mutants of the corpus, validated, and their repairs."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import mutants
import numpy as np
import textbooks
from scipy.stats import beta

from armgpi import validate
from armgpi.validation.diagnose import UNNAMED


class Outcome(NamedTuple):
    """What became of one mutant."""

    mutant: mutants.Mutant
    found: bool
    named: bool
    right: bool
    proved: bool
    confirmed: bool
    seconds: float
    text: str


def outcome(mutant: mutants.Mutant, folder: Path) -> Outcome:
    """Validate a mutant; right is a repair that equals the right model, for other numbers too."""
    path = folder / f"{mutant.arm}.py"
    path.write_text(mutant.source, encoding="utf-8")
    robot, start = textbooks.robot(mutant.arm, mutant.right), time.perf_counter()
    report = validate(path, robot)
    seconds = time.perf_counter() - start
    named = any(cause.kind not in UNNAMED for cause in report.causes)
    right = proved = False
    if report.repaired is not None:
        right = mutants.same(report.repaired, mutant.right, 99)
        path.write_text(report.repaired, encoding="utf-8")
        proved = validate(path, robot).agrees
    text = " | ".join(cause.text for cause in report.causes)
    confirmed = any(cause.confirmed for cause in report.causes)
    proved = proved or report.repaired is None
    return Outcome(mutant, not report.agrees, named, right, proved, confirmed, seconds, text)


def outcomes(arms: Iterable[str], count: int, seed: int, mistakes: int = 1) -> list[Outcome]:
    """Return what becomes of random mutants of some arms."""
    with tempfile.TemporaryDirectory() as folder:
        drawn = [m for arm in arms for m in mutants.draw(arm, count, seed, mistakes)]
        return [outcome(mutant, Path(folder)) for mutant in drawn]


def interval(k: int, n: int) -> tuple[float, float]:
    """Return the interval of Clopper and Pearson at 95 % of a share k of n."""
    low = float(beta.ppf(0.025, k, n - k + 1)) if k else 0.0
    return low, float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0


def share(k: int, n: int) -> str:
    """Return "k of n" with its interval."""
    low, high = interval(k, n)
    return f"{k} of {n}, {100 * k / max(n, 1):.1f} % ({100 * low:.1f} to {100 * high:.1f} %)"


def summary(found: list[Outcome]) -> str:
    """Return the shares as text."""
    named, right = sum(o.named for o in found), sum(o.right for o in found)
    seconds = sorted(o.seconds for o in found)
    by_kind = [
        f"  {kind:11s} {share(sum(o.right for o in rows), len(rows))}"
        for kind in sorted({kind for o in found for kind in o.mutant.kinds})
        for rows in [[o for o in found if kind in o.mutant.kinds]]
    ]
    return "\n".join(
        [
            "right by kind:",
            *by_kind,
            f"found:     {share(sum(o.found for o in found), len(found))}",
            f"precision: {share(right, named)}",
            f"recall:    {share(right, len(found))}",
            f"proved:    {share(sum(o.proved for o in found), len(found))}",
            f"confirmed and wrong: {sum(o.confirmed and not o.right for o in found)}",
            f"seconds:   median {seconds[len(seconds) // 2]:.1f}, longest {seconds[-1]:.1f}",
        ]
    )


def alarms(arm: str, count: int, seed: int) -> list[int]:
    """Return the seeds of random numbers for which a right model does not agree with the robot of these."""
    with tempfile.TemporaryDirectory() as folder:
        path, found = Path(folder) / f"{arm}.py", []
        for k in np.random.default_rng([seed, *arm.encode()]).integers(2**31, size=count).tolist():
            source = textbooks.text(arm, k)
            path.write_text(source, encoding="utf-8")
            if not validate(path, textbooks.robot(arm, source)).agrees:
                found.append(k)
    return found


def main(which: str, count: int, seed: int, mistakes: int) -> None:
    """Score random mistakes, or right models when there are none, and print what went wrong."""
    groups = {"seen": textbooks.SEEN, "unseen": textbooks.UNSEEN, "all": tuple(textbooks.ARMS)}
    done, wrong, arms = [], [], groups.get(which, tuple(which.split(",")))
    for arm in arms:
        if not mistakes:
            wrong += alarms(arm, count, seed)
            print(arm, "false alarms:", share(len(wrong), count * (arms.index(arm) + 1)), flush=True)
            continue
        for one in outcomes([arm], count, seed, mistakes):
            done.append(one)
            if not one.right:
                told = "named" if one.named else "not named"
                told += ", CONFIRMED" if one.confirmed else ""
                print(arm, one.mutant.kinds, told, one.text[:300], flush=True)
        print(arm, sum(o.right for o in done), "of", len(done), flush=True)
    if done:
        print(summary(done))


if __name__ == "__main__":
    # Arms or a group of them, mistakes (or sets of numbers) of each, seed, mistakes at once (0: none).
    main(sys.argv[1], *map(int, sys.argv[2:5]))
