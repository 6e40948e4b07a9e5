"""The whole path on arms that somebody owns: bare file, first log, identify, second log, identify, run.

Draws of `Reality.owned`: believed drives, gears that twist, encoders at the motors, friction, a load. Each is
moved by `excite --first` under the law for its file, then by `excite` under the law for what was identified
from that; a log ends where a joint is off by 0.1 rad. The move of the draw is then run by the law for the
file, for the first log, for both logs, and for the truth (links, load, rotors, gears, friction).

    python tools/owned_path.py --arms ur5 panda z1 --count 6 --seed 9003 9004

``--stiff`` draws rigid gears (`Reality.undriven`), and every law is told their stiffness.
"""

from __future__ import annotations

import argparse
import warnings
from itertools import islice, product
from typing import Any, NamedTuple

import numpy as np

import armgpi
from armgpi import config
from armgpi.base.arrays import Array
from armgpi.base.intervals import wilson
from armgpi.errors import ParameterError
from armgpi.health import reality as health
from armgpi.identification.arm import identify, mean_inertia
from armgpi.identification.excitation import FIRST_SHARE, excite
from armgpi.identification.logs import Log
from armgpi.plants.reality import Scenario, stack_draws

#: A log ends where a joint is so far from where it should be [rad or m].
CUT = 0.1
#: How long a motion is [s], and the most draws that are looked at for each that is feasible.
SECONDS, _MOST = 20.0, 8
#: Shortest log that is identified from [s].
SHORTEST = 2.0
#: Arms that the law is made for, and what each is called in the table.
STAGES = ("file", "first log", "both logs", "truth")


class Path(NamedTuple):
    """What one draw came to.

    Attributes:
        outcomes: stage -> what the law for it makes of the move.
        lengths: of both logs [s].
        rotors: largest rotor that an arm has over the identified one, or the other way, by stage.
    """

    outcomes: dict[str, health.Outcome]
    lengths: tuple[float, float]
    rotors: tuple[float, float]


def run(draw: Scenario, nominal: armgpi.Robot, reference: Any, t_final: float) -> Any:
    """Return a rollout of a draw under the law for untuned arms with a nominal model."""
    every = stack_draws([draw])
    nominal = armgpi.assume_drives(nominal)
    law = config.controller({"type": "gpi_auto"}, every.context._replace(robot=nominal, nominal=nominal))
    return armgpi.simulate(every.plant, law, reference, t_final, progress=False, backend="compiled")


def record(draw: Scenario, nominal: armgpi.Robot, share: float, seed: int) -> Log:
    """Return the log of a motion until a joint is off by :data:`CUT`; without the draw's disturbance.

    It is empty where motors are too weak for `excite`.
    """
    still = draw._replace(torque_step=0.0 * draw.torque_step)
    try:
        motion = excite(nominal, SECONDS, share, seed, floor=None, collisions=False).reference
    except ParameterError:
        return Log(*[np.zeros(1)] * 3)
    rollout = run(still, nominal, motion, SECONDS)
    q, tau = rollout["q_measured"].values, rollout["tau_command"].values
    off = ~(np.abs(q - rollout["q_ref"].values) < CUT).all(axis=1)
    end = int(np.argmax(off)) if off.any() else len(q)
    limit = draw.effort
    return Log(rollout["time"].values[:end], q[:end], np.clip(tau[:end], -limit, limit), f"draw {draw.index}")


def apart(found: armgpi.Robot, draw: Scenario) -> float:
    """Return how far the worst joint's mean inertia is off, as a factor."""
    ratio: Array = mean_inertia(found) / mean_inertia(draw.arm)
    return float(np.maximum(ratio, 1.0 / ratio).max())


def follow(draw: Scenario, name: str, stiff: bool) -> Path:
    """Return what the whole path makes of a draw."""
    assert draw.gears is not None
    assert draw.friction is not None
    stiffness = dict(zip(draw.arm.joint_names, draw.gears.stiffness.tolist(), strict=True))

    def tell(arm: armgpi.Robot) -> armgpi.Robot:
        return arm.with_drives(arm.drives.with_value("stiffness", stiffness))

    file = tell(draw.model) if stiff else draw.model
    first = record(draw, file, FIRST_SHARE, 1)
    arms = {"file": file, "first log": file, "both logs": file}
    logs = [first] if first.t[-1] > SHORTEST else []
    if logs:
        arms["first log"] = identify(logs, file, check_first=False).robot
    second = record(draw, arms["first log"], 0.7, 2)
    logs += [second] if second.t[-1] > SHORTEST else []
    if logs:
        arms["both logs"] = identify(logs, file, check_first=False).robot
    arms["truth"] = tell(draw.arm.with_friction(*draw.friction))
    outcomes = {}
    for stage, nominal in arms.items():
        rollout = run(draw, nominal, draw.reference, draw.t_final)
        outcomes[stage] = health.outcome(rollout, draw, name)
    lengths = (float(first.t[-1]), float(second.t[-1]))
    return Path(outcomes, lengths, (apart(arms["first log"], draw), apart(arms["both logs"], draw)))


def feasible(draw: Scenario) -> bool:
    """Tell whether the motors can follow the move, and a law that knows the truth holds the arm."""
    return health.demand(draw) <= 1.0 and health.ideal_law_holds(draw)


def show(there: list[Path]) -> None:
    """Print the table of some draws."""
    lengths = np.array([path.lengths for path in there])
    worst = np.array([path.rotors for path in there])
    whole = (lengths > 0.995 * SECONDS).sum(axis=0)
    print(f"{len(there)} draws; logs that reached {SECONDS:g} s: first {whole[0]}, second {whole[1]}")
    print(f"worst joint's inertia off by a factor of (median): {np.round(np.median(worst, axis=0), 3)}")
    print("| law for | failed [%] (95 %) | swinging [%] | chatter [%] | ITAE over truth's, median, 90 % |")
    print("|---|---|---|---|---|")
    for stage in STAGES:
        own = [path.outcomes[stage] for path in there]
        pairs = [(x, path.outcomes["truth"]) for x, path in zip(own, there, strict=True)]
        ratio = [x.itae / truth.itae for x, truth in pairs if not truth.failed]
        lost = wilson(sum(x.failed for x in own), len(own))
        shares = [100.0 * np.mean([getattr(x, key) for x in own]) for key in ("swinging", "chatter")]
        print(
            f"| {stage} | {100 * lost.value:.0f} ({100 * lost.lower:.0f} to {100 * lost.upper:.0f}) "
            f"| {shares[0]:.0f} | {shares[1]:.0f} | {np.median(ratio):.2f}, {np.quantile(ratio, 0.9):.2f} |"
        )


def main() -> None:
    """Follow the path for some arms, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", nargs="+", default=["ur5", "panda", "z1"])
    parser.add_argument("--count", type=int, default=8, help="feasible draws of each arm")
    parser.add_argument("--seed", type=int, nargs="+", default=[9003])
    parser.add_argument("--stiff", action="store_true", help="rigid gears, and laws that know it")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    paths = []
    for seed, name in product(given.seed, given.arms):
        reality = armgpi.Reality("undriven" if given.stiff else "owned", seed=seed)
        every = (draw for draw in health.draws(reality, name, _MOST * given.count) if feasible(draw))
        for draw in islice(every, given.count):
            paths.append(follow(draw, name, given.stiff))
            said = {stage: "lost" if x.failed else f"{x.itae:.3g}" for stage, x in paths[-1].outcomes.items()}
            print(name, draw.index, paths[-1].lengths, said, flush=True)
    show(paths)


if __name__ == "__main__":
    main()
