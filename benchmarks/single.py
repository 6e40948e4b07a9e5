"""Speed of a single run: compiled and NumPy, against Pinocchio, MuJoCo and Drake doing the same work.

python benchmarks/single.py [--quick]
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import _arms
import _page
import _timing
import numpy as np
from _arms import DT, EULER, ORDER_3, REPLAYED, SAME, SETTLED, Arm, Check, check_rollout, require
from _peer import Array, Trajectory
from _timing import Contender, Samples, ratio, spread, table, take_turns

import armgpi
from armgpi import config
from armgpi.paper import scenarios

FLOOR, COMPILED, LOOP = "floor: generated kernels alone", "armgpi, compiled", "the same without its start"
START = "start"
FIRST = (FLOOR, COMPILED)
#: The paper's arm at 1 kHz.
DEMO = _page.ROOT / "examples" / "demo.yaml"
GOALS = {"panda": 2.5}  # [us] per control step, networks
PAPER_GOAL = 0.1  # [s] for a run of 40 s
#: Compiled against NumPy, which round differently [rad].
BACKENDS = 1e-9


def main() -> None:
    page = _page.begin(__file__, "Single run")
    rounds, steps, long = (2, 2500, 40_000) if page.quick else (7, 4000, 40_000)
    _page.say(
        f"Microseconds per control step at {1.0 / DT:g} Hz, {rounds} rounds; × is the multiple of armgpi, "
        f"compiled, whose runs have {long} steps, start included; the others have {steps}. Every step is "
        "recorded; every run ends within 1e-6 rad of its goal. Last column: largest distance of a position "
        "from armgpi's NumPy run [rad]."
    )
    found: list[list[object]] = []
    for networks, title in ((True, "GPI with networks"), (False, "GPI with fixed gains")):
        print(f"\n## {title}")
        for name in _arms.ROBOTS:
            samples = _robot(page, name, networks, rounds, steps, long)
            if networks and name in GOALS:
                for label, one in ((f"{long} steps, start included", COMPILED), ("without the start", LOOP)):
                    time = spread(samples[one].times)
                    kept = "yes" if time.median <= GOALS[name] else "no"
                    what = f"{name}, networks: per step, {label}"
                    found.append([what, f"{GOALS[name]} µs", f"{time} µs", kept])
    print("\n## The paper's arm for 40 s, with disturbances\n")
    found += _paper(page, 2 if page.quick else 5)
    print("\n## Goals\n")
    print(table(["", "at most", "found", "met"], found))
    page.write()


def _robot(
    page: _page.Page, name: str, networks: bool, rounds: int, steps: int, long: int
) -> Mapping[str, Samples]:
    """Time all who run one robot and print their table."""
    arm = Arm(name, networks)
    expected = arm.simulate("numpy", steps)
    check_rollout(expected, f"{name}, NumPy", SETTLED)
    floor = arm.floor(1)
    checks: dict[str, Check] = {}
    short = partial(arm.simulate, "compiled", steps)
    apart = float(np.abs(short()["q"].values - expected["q"].values).max())
    require(f"{name}: compiled against NumPy [rad]", apart, BACKENDS)
    finished = partial(check_rollout, what=name, settled=SETTLED)
    contenders = {
        FLOOR: Contender(partial(floor, steps), steps),
        COMPILED: Contender(partial(arm.simulate, "compiled", long), long, finished),
        START: Contender(partial(arm.simulate, "compiled", 1), 1),
        "armgpi, NumPy": Contender(partial(arm.simulate, "numpy", steps), steps, finished),
        "Pinocchio's kernels alone, from Python": Contender(partial(arm.pinocchio_floor(1), steps), steps),
    }

    def add(label: str, bound: float, run: Callable[[], Trajectory]) -> None:
        checks[label] = Check(f"{name}, {label}", arm, expected, bound, SETTLED)
        contenders[label] = Contender(run, steps, checks[label])

    recorded = [expected[name].values[:steps, None] for name in ("q", "v", "tau")]
    _add_peers(arm, networks, recorded, add)
    samples = take_turns(contenders, rounds)
    whole = samples[COMPILED]
    alone = Samples((whole.times * long - samples[START].times) / (long - 1), whole.cores)
    samples = {**{k: x for k, x in samples.items() if k in FIRST}, LOOP: alone, **samples}
    page.figures[f"{name}, {'networks' if networks else 'fixed'}"] = {
        "times": _timing.plain(samples),
        "apart": {"armgpi, compiled": apart, **{label: check.apart for label, check in checks.items()}},
    }
    rows: list[list[object]] = []
    for label, one in samples.items():
        if label == START:
            continue
        distance = apart if label == COMPILED else checks[label].apart if label in checks else None
        word = "" if distance is None else f"{distance:.1e}"
        rows.append([label, spread(one.times), ratio(one, samples[COMPILED]), word])
    print(f"\n### {arm.title}\n")
    rows.append(["start, its code in the cache [ms]", spread(1e-3 * samples[START].times), "", ""])
    print(table(["", "time", "×", "apart"], rows))
    return samples


def _add_peers(
    arm: Arm,
    networks: bool,
    recorded: list[Array],
    add: Callable[[str, float, Callable[[], Trajectory]], None],
) -> None:
    """Add the peers that can run the arm; `recorded` has what armgpi's run did: q, v and tau."""
    steps = len(recorded[0])
    arguments = (arm.q0, arm.targets(steps), arm.effort)
    if not networks:
        add(
            "Pinocchio, plain loop",
            SAME,
            lambda: _arms._pinocchio.run_single(arm.model, arm.law(arm.q0), *arguments, DT),
        )
    if arm.name not in _arms.PEER_ROBOTS:
        return
    fixed, names = _arms.ROBOTS[arm.name], arm.robot.joint_names
    if mujoco := _arms.mujoco:
        rk4 = mujoco.compile_urdf(arm.urdf, fixed, names, mujoco.RK4, DT)
        euler = mujoco.compile_urdf(arm.urdf, fixed, names, mujoco.EULER, DT)
        if not networks:
            add("MuJoCo in parts, RK4", SAME, lambda: mujoco.run_single(rk4, arm.law(arm.q0), *arguments))
            add(
                "MuJoCo in halves, Euler (other integrator)",
                EULER,
                lambda: mujoco.run_single(euler, arm.law(arm.q0), *arguments),
            )
        replay = mujoco.Batch(rk4, 1, arm.q0[None])

        def replayed() -> Trajectory:
            run = replay.replayed(*recorded)
            return Trajectory(*(x[:, 0] for x in run[:3]), run.q_end[0])

        add("MuJoCo, torques replayed, RK4 (no controller)", REPLAYED, replayed)
    if (drake := _arms.drake) and not networks:
        plant = drake.load(arm.urdf, fixed, names)
        add("Drake, stages, RK4", SAME, lambda: drake.run_stages(plant, arm.law(arm.q0), *arguments, DT))
        add(
            "Drake, Simulator, RK3 (other integrator)",
            ORDER_3,
            lambda: drake.run_simulator(plant, arm.law(arm.q0), *arguments, DT),
        )


def _paper(page: _page.Page, rounds: int) -> list[list[object]]:
    """Time the paper's runs; return the rows of their goals."""
    _arms.os.environ["OMP_NUM_THREADS"] = "1"
    rows: list[list[object]] = []
    goals: list[list[object]] = []
    for path in (DEMO, scenarios.locate("scenario-5.3")):
        experiment = config.build(*config.read(path))
        run = partial(_run, experiment)
        (controller, *_) = experiment.controllers.values()
        short = 2.0
        both = [run(backend, short)["q"].values for backend in ("numpy", "compiled")]
        apart = float(np.abs(both[0] - both[1]).max())
        require(f"{path.name}: compiled against NumPy [rad]", apart, BACKENDS)
        steps = round(experiment.t_final / controller.dt)
        samples = take_turns(
            {
                "compiled": Contender(partial(run, "compiled", experiment.t_final), steps),
                "numpy": Contender(partial(run, "numpy", short), round(short / controller.dt)),
            },
            rounds,
        )
        page.figures[path.name] = {"times": _timing.plain(samples), "apart": apart}
        seconds = spread(1e-6 * steps * samples["compiled"].times)
        kept = "yes" if seconds.median <= PAPER_GOAL else "no"
        faster = ratio(samples["numpy"], samples["compiled"])
        title = f"{path.name}, {1.0 / controller.dt:g} Hz"
        rows.append([f"{title}, {steps} steps", seconds, faster, f"{apart:.1e}"])
        goals.append([f"{title}: 40 s of the paper's arm", f"{PAPER_GOAL} s", f"{seconds} s", kept])
    print(table(["", "compiled, seconds", "NumPy, ×", "apart"], rows))
    _page.say("NumPy's time is that of the first 2 s, for as many steps.")
    return goals


def _run(experiment: config.Experiment, backend: str, t_final: float) -> Any:
    """Run an experiment's first controller."""
    (controller, *_) = experiment.controllers.values()
    rollout = armgpi.simulate(
        experiment.plant,
        controller,
        experiment.reference,
        t_final,
        record_every=experiment.config.record_every,
        progress=False,
        backend=backend,
    )
    if (rollout["status"] != armgpi.Status.FINISHED).any():
        raise RuntimeError("a run of the paper's arm did not finish")
    return rollout


if __name__ == "__main__":
    main()
