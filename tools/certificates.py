"""Certify every arm of the zoo, print a table, and hold each certificate against many rollouts.

Usage:
    python tools/certificates.py
    python tools/certificates.py --arms ur5 panda --inertia 0.1 --rollouts 100000
    python tools/certificates.py --rollouts 2000 --generations 4 --out certificates.md

For each arm the first of the loads and bandwidths that is certified is taken: `--loads` in their order, each
at the default bandwidth and then at others. The numbers are searched; the time is that of one certificate.
`ratio` is certified over worst found in the frozen arm, joint by joint. The columns after it are the worst of
adversarial rollouts of the whole arm over what is certified, where above 1 would refute: under the largest
torque certified, under a share of it that was stated for each joint while the reference moves, from a start
with the torque of another load, and after a jump of the load by the largest of some that is certified.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armgpi import ArmgpiWarning, FixedGains, Robot
from armgpi.certification.adversary import worst
from armgpi.certification.certificate import Certificate, certificate
from armgpi.certification.quantities import search_numbers
from armgpi.certification.request import Asked, ask
from armgpi.errors import ArmgpiError
from armgpi.health.zoo import fingers
from armgpi.robot import robots

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests" / "certification"))
from soundness import observe

#: Bandwidths that are tried after the default one [rad/s].
OMEGAS = (None, 20.0, 45.0, 15.0)
HEAD = ("arm", "rotor inertia added", "load", "speed", "omega", "largest delta", "certified", "ratio", "time")
OBSERVED = ("gain", "stated", "start", "jump")
#: Other loads that may jump [kg], how far the arm may be off then [rad or m], and the share of the torque.
JUMPS, RADIUS, SHARE = (0.02, 0.005), 0.05, 0.1


class Attempt(NamedTuple):
    """What was asked for, what came of it, and how long it took [s]."""

    asked: Asked
    made: Certificate
    seconds: float


def attempt(robot: Robot, loads: list[float], speed: float) -> Attempt | str:
    """Return the first certificate of some loads and bandwidths, or what is in the way of the last load."""
    said = ""
    for load in loads:
        options: dict[str, Any] = {"payload": (0.0, load), "speed": speed, "start": "held"}
        found, spent = None, 0.0
        for omega in OMEGAS:
            begin = time.perf_counter()
            try:
                gains = {} if omega is None else {"gains": FixedGains(omega)}
                asked = ask(robot, 1e-3, **options, **gains)
            except ArmgpiError as error:
                said = str(error)
                continue
            found = search_numbers(asked.setting) if found is None else found
            made = certificate(asked, found)
            spent += time.perf_counter() - begin
            if made.certified:
                return Attempt(asked, made, spent)
            said = next((x for x in made.reasons if x.startswith("in the way")), made.reasons[0])
    return said


def row(name: str, inertia: float, given: argparse.Namespace) -> tuple[list[str], int]:
    """Return a row of the table, and how many rollouts were made for it."""
    robot = Robot.load(name, lock=fingers(name))
    robot = robot.with_armature(robot.armature + inertia)
    found = attempt(robot, given.loads, given.speed)
    cells = [name, f"{inertia:g}"]
    if isinstance(found, str):
        return [
            *cells,
            f"0 to {given.loads[-1]:g}",
            f"{given.speed:g}",
            "-",
            "-",
            f"no: {found}",
            "-",
            "-",
        ], 0
    asked, made, seconds = found
    cells += [f"0 to {asked.loads[1]:g}", f"{given.speed:g}", f"{float(made.data['law']['omega'][0]):.3g}"]
    ratios = made.per_torque / [case.error for case in worst(asked, count=given.worst)]
    cells += [f"{float(made.data['numbers']['delta_high']):.3g}", "yes"]
    cells += [f"{ratios.min():.2f} to {ratios.max():.2f}", f"{seconds:.0f} s"]
    if not given.rollouts:
        return cells, 0
    seen = observe(asked, made, given.rollouts, claims=OBSERVED[:1], generations=given.generations)
    if given.gain_alone:
        return [*cells, f"{seen.gain.max():.3f}", "-", "-", "-"], seen.rollouts
    stated, found = disturbed(asked, made)
    more = observe(stated, found, given.rollouts, claims=OBSERVED[1:], generations=given.generations)
    for ratio in (seen.gain.max(), more.stated.max(), more.start.max(), more.jump.max()):
        cells.append("-" if np.isnan(ratio) else f"{ratio:.3f}")
    if "jump" in found.data["solutions"]:
        cells[-1] += f" ({stated.loads[1]:g} kg)"
    return cells, seen.rollouts + more.rollouts


def disturbed(asked: Asked, made: Certificate) -> tuple[Asked, Certificate]:
    """Return a certificate for stated torques and a jump of the load: of a smaller one where that may not."""
    size = SHARE * float(made.data["inputs"]["gain"]["torque"])
    torque = size / asked.robot.n / np.sqrt([float(x) for x in made.data["numbers"]["inverse"]])
    options: dict[str, Any] = {"speed": asked.setting.speed, "gains": made.gains, "radius": RADIUS}
    options["acceleration"] = asked.setting.speed
    for load in (asked.loads[1], *(x for x in JUMPS if x < asked.loads[1])):
        stated = ask(asked.robot, 1e-3, payload=(0.0, load), torque=torque, jump=True, **options)
        found = certificate(stated, search_numbers(stated.setting))
        if {"jump", "start"} <= set(found.data["solutions"]):
            break
    return stated, found


def main(arguments: list[str] | None = None) -> int:
    """Print the table; 1 when a rollout exceeded a certificate."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", nargs="+", help="names of arms; all that can be loaded by default")
    parser.add_argument("--inertia", nargs="+", type=float, default=[0.0, 0.1], help="rotor inertia added")
    parser.add_argument("--loads", nargs="+", type=float, default=[0.5, 0.1], help="heaviest loads [kg]")
    parser.add_argument("--speed", type=float, default=0.2, help="of every joint [rad/s or m/s]")
    parser.add_argument("--worst", type=int, default=20, help="configurations of the frozen adversary")
    parser.add_argument("--rollouts", type=int, default=0, help="for each claim")
    parser.add_argument("--generations", type=int, default=1, help="of the rollouts, bred from the worst")
    parser.add_argument("--gain-alone", action="store_true", help="roll out the first claim alone")
    parser.add_argument("--out", type=Path, help="write the table as Markdown")
    given = parser.parse_args(arguments)
    head = [*HEAD, *(OBSERVED if given.rollouts else [])]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    print("\n".join(lines))
    total, largest = 0, 0.0
    for name in given.arms or robots.names():
        for inertia in given.inertia:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ArmgpiWarning)
                try:
                    cells, rollouts = row(name, inertia, given)
                except ArmgpiError as error:
                    print(f"not run: {name}: {error}", file=sys.stderr)
                    break
            lines.append("| " + " | ".join(cells) + " |")
            print(lines[-1], flush=True)
            total += rollouts
            ratios = [float(x.split()[0]) for x in cells[len(HEAD) :] if x != "-"]
            largest = max([largest, *ratios])
            if given.out:
                given.out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    if given.rollouts:
        print(f"{total} rollouts; largest observed over certified {largest:.3f}")
    return int(largest > 1.0)


if __name__ == "__main__":
    sys.exit(main())
