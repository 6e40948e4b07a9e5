"""What each law reaches on the paper's arm, 40 s with eqs. 29-31, tuned alike; and on other moves and loads.

Usage:
    python tools/ablation.py --out ablation               # resumes where it was stopped
    python tools/ablation.py --evaluations 961 --seeds 2  # which are the default

Encoders have 16 bits and measurements are one sample late. Each law is searched for the least sum of the
joints' ITAE at several budgets of torque variation on the run of docs/theory.md, and judged on three others.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from armgpi import Delayed, Encoder, RigidBodyPlant, Robot, Saturated, Sine, Waypoints, config, prepare
from armgpi.registry import Context
from armgpi.studies.contend import CONTENDERS, Contender
from armgpi.studies.evaluation import Evaluated, by_rollout, with_keys
from armgpi.studies.objective import Objective
from armgpi.studies.optimise import KEPT, Problem, Search
from armgpi.studies.space import Range, Space
from armgpi.studies.study import Identity, Study

ARM = Robot.load("anthropomorphic3")
DT, BITS, T_FINAL = 1e-3, 16, 40.0
BUDGETS = (200.0, 400.0, 800.0)
CONTEXT = Context(ARM, DT, 0, DT, np.full(3, float(BITS)), ARM)
#: Goal [rad], amplitude of the loads and their frequency over the paper's; the first is that of the paper.
RUNS = (
    ((0.8, 0.4, -0.4), 1.0, 1.0),
    ((-0.6, 0.7, 0.3), 1.3, 2.0),
    ((1.0, -0.3, 0.6), 0.7, 5.0),
    ((0.3, 0.6, -0.8), 1.0, 10.0),
)
#: Weights that are searched, and that learn from there.
LEARNING = Contender(
    {**CONTENDERS["GPI, network, roll-off"].section, "weights": {"omega": [0.0] * 4}},
    {**CONTENDERS["GPI, network, roll-off"].free, "weights.omega": Range()},
    True,
)
_TRAINED = CONTENDERS["GPI, trained network, roll-off"]
#: Weights that are searched, in the law without roll-off.
TRAINED = Contender(
    {key: value for key, value in _TRAINED.section.items() if key != "rolloff"},
    {key: value for key, value in _TRAINED.free.items() if key != "rolloff_ratio"},
    True,
)
LAWS = {
    **{
        name: each
        for name, each in CONTENDERS.items()
        if name
        in (
            *("GPI, printed controller", "GPI, schedule", "GPI, network"),
            *("GPI, roll-off", "GPI, schedule, roll-off", "GPI, network, roll-off"),
            *("GPI, trained network, roll-off", "PID + inversion, positions"),
        )
    },
    "GPI, trained network": TRAINED,
    "GPI, trained network that learns, roll-off": LEARNING,
}


class Runs:
    """Candidates on some of the runs."""

    def __init__(self, runs: Sequence[Any]) -> None:
        self.draws, self._loops = list(runs), {}

    def __call__(self, section: Mapping[str, Any], candidates: Sequence[Mapping[str, Any]]) -> Evaluated:
        """Run them; as :class:`armgpi.studies.evaluation.Evaluator`."""
        shape = (len(candidates), len(self.draws))
        values = {name: np.empty(shape) for name in KEPT}
        failed = np.empty(shape, dtype=bool)
        for column, run in enumerate(self.draws):
            key = (column, len(candidates), repr(section))
            if key not in self._loops:
                self._loops[key] = prepared(*run, with_keys(section, candidates[0]))
            rollout = self._loops[key].run(by_rollout(candidates, 1, self._loops[key]))
            failed[:, column] = np.atleast_1d(rollout["status"].values) != 0
            for name in KEPT:
                each = np.atleast_2d(rollout[name].values)
                values[name][:, column] = each.max(axis=1) if name == "peak_error" else each.sum(axis=1)
        return Evaluated(values, failed)


def prepared(goal: Any, amplitude: float, speed: float, section: Mapping[str, Any]) -> Any:
    """Return the loop of a run: there, 8 s, and back, under loads as those of eqs. 29-31."""
    quarter = math.pi / 2.0
    parts = [((0.7, 0, 0), 0.1, quarter, 10), ((0, 0.3, 0), 0.1, quarter, 15), ((0, 0.2, 0), 0.5, 0, 15)]
    parts += [((0, 0, 0.2), 0.1, 0, 20), ((0, 0, 0.1), 0.5, 0, 20)]
    loads = [Sine(amplitude * np.array(a, dtype=float), speed * w, p, onset=float(t)) for a, w, p, t in parts]
    plant = Delayed(Encoder(Saturated(RigidBodyPlant(ARM, loads)), BITS), 1)
    there = np.array(goal)
    reference = Waypoints([0 * there, there, 0 * there], durations=3.0, holds=[1.0, 8.0, 25.0])
    law = config.controller(section, CONTEXT)
    return prepare(plant, law, reference, T_FINAL, record="metrics", backend="compiled")


def main(arguments: list[str] | None = None) -> int:
    """Search every law and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--evaluations", type=int, default=961)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("ablation"), help="folder of the searches")
    given = parser.parse_args(arguments)
    asked = {"script": Path(__file__).read_text(encoding="utf-8"), "evaluations": given.evaluations}
    study = Study.enter(given.out, Identity(asked))
    names = [f"up to {budget:g} N m" for budget in BUDGETS]
    print("| law | numbers | " + " | ".join(names) + " |\n" + "|---" * (len(names) + 2) + "|")
    for place, (name, contender) in enumerate(LAWS.items()):
        space = Space(contender.section, config.controller(contender.section, CONTEXT), contender.free)
        found: dict[float, list[Any]] = {budget: [] for budget in BUDGETS}
        for seed in range(given.seeds):
            search = Search(
                Problem(
                    *(space, Objective("itae"), Runs(RUNS[:1]), Runs(RUNS[1:])),
                    budgets=BUDGETS,
                    evaluations=given.evaluations,
                    population=8,
                    seed=seed,
                )
            )
            own = f"{place:02d}/{seed}"
            search.run(part=lambda part, *rest, own=own: study.part(f"{own}/{part}", *rest))
            for each in search.validate():
                found[each.budget].append((each.row.objective, each.held_out.objective))
        cells = [
            " / ".join(f"{x:.3g}" for x in np.median(each, axis=0)) if each else "-"
            for each in found.values()
        ]
        print(f"| {name} | {len(space.names)} | " + " | ".join(cells) + " |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
