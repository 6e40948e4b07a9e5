"""Speed of batches: compiled and NumPy on one and two threads, against MuJoCo doing the same work.

python benchmarks/batch.py [--quick]
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import _arms
import _page
import _timing
import numpy as np
import xarray as xr
from _arms import (
    DT,
    EULER,
    EULER_REPLAYED,
    ON_TRACK,
    REPLAYED,
    SAME,
    SETTLED,
    Arm,
    Check,
    check_rollout,
    require,
)
from _peer import Array, refuse_cut
from _timing import Contender, Samples, Spread, ratio, spread, table, take_turns

from armgpi.control.controller import Measurement
from armgpi.references.reference import Target

#: Recorded by a compiled run that is not recorded whole.
EVERY = 10
#: Steps of those who record all, at most.
MOST_SHORT = 400
#: Compiled against NumPy, which round differently [rad].
BACKENDS = 1e-9
FLOOR, COMPILED, WHOLE = (
    "floor: generated kernels alone",
    "armgpi, compiled",
    "armgpi, compiled, all recorded",
)
START, LOOP = "start", "armgpi, compiled, without its start"
NUMPY, KERNELS = "armgpi, NumPy", "Pinocchio's parallel kernels alone"
RK4, EULER_WORD = (
    "mujoco.rollout, RK4, controller in NumPy",
    "mujoco.rollout, Euler, controller in NumPy (other integrator)",
)
RK4_REPLAY = "mujoco.rollout, RK4, torques replayed (no controller)"
EULER_REPLAY = "mujoco.rollout, Euler, torques replayed (no controller, other integrator)"


def main() -> None:
    page = _page.begin(__file__, "Batches")
    rounds, batches = (2, (16, 256)) if page.quick else (5, (16, 256, 4096))
    units, few = (100_000, 8_000) if page.quick else (2_000_000, 40_000)
    _page.say(
        f"Microseconds per rollout-step at {1.0 / DT:g} Hz, {rounds} rounds; × is the multiple of armgpi, "
        f"compiled, on as many threads: about {units} rollout-steps, start included, every {EVERY}th or all "
        f"recorded; the others about {few}, or {MOST_SHORT} steps, all recorded. A batch of 32 ends within "
        f"{SETTLED:g} rad of its goal. Last column: largest distance of a position from armgpi's NumPy run "
        "[rad]."
    )
    rows: list[list[object]] = []
    for name, networks in (("panda", True), ("panda", False), ("anthropomorphic3", True)):
        arm = Arm(name, networks)
        word = "networks" if networks else "fixed gains"
        print(f"\n## {arm.title}, {word}")
        _settled(arm)
        for batch in batches:
            samples = _batch(page, arm, word, batch, rounds, units, few)
        rows += _goals(name, networks, batches[-1], samples)
    print("\n## Goals\n")
    print(table(["", "goal", "found", "met"], rows))
    for missing, label in ((_arms.mujoco, "MuJoCo"),):
        if missing is None:
            print(f"\n{label} is not installed and so not in the tables: pip install '.[mujoco]'.")
    page.write()


def _settled(arm: Arm, batch: int = 32, steps: int = 2000) -> None:
    """Run a batch until it has settled, by both backends, and hold them against each other."""
    q0 = arm.starts(batch)
    runs = [arm.simulate(backend, steps, q0) for backend in ("numpy", "compiled")]
    for run in runs:
        check_rollout(run, f"{arm.name}, batch of {batch}", SETTLED)
    apart = float(np.abs(runs[0]["q"].values - runs[1]["q"].values).max())
    require(f"{arm.name}: compiled against NumPy [rad]", apart, BACKENDS)


def _batch(
    page: _page.Page, arm: Arm, word: str, batch: int, rounds: int, units: int, few: int
) -> dict[str, Samples]:
    """Time all who run a batch and print their table."""
    q0 = arm.starts(batch)
    short = max(10, min(MOST_SHORT, few // batch))
    expected = arm.simulate("numpy", short, q0)
    apart: dict[str, float | Check] = {}
    contenders = _ours(arm, q0, expected, short, units, apart)
    for threads in (1, 2):
        for label, run, bound in _mujoco(arm, q0, expected, short, word == "networks", threads):
            check = apart.setdefault(label, Check(f"{arm.name}, {label}", arm, expected, bound, ON_TRACK))
            contenders[f"{label}, {threads}"] = Contender(run, short * batch, check, threads)
    taken = take_turns(contenders, rounds)
    samples = _without_start(taken, contenders)
    distances = {k: x.apart if isinstance(x, Check) else x for k, x in apart.items()}
    cores = float(np.median(samples[f"{COMPILED}, 2"].cores))
    page.figures[f"{arm.name}, {word}, {batch}"] = {
        "times": _timing.plain(samples),
        "apart": distances,
        "cores": cores,
    }
    start = spread(1e-3 * taken[f"{START}, 1"].times)
    print(f"\n### Batch of {batch}\n")
    rows = [*_rows(samples, distances), ["start, its code in the cache [ms]", start, "", "", "", ""]]
    print(table(["", "1 thread", "×", "2 threads", "×", "apart"], rows))
    if _timing.busy(samples[f"{COMPILED}, 2"], 2):
        print(f"\nThe machine was busy: two threads had {cores:.2g} cores, so their times do not count.")
    return samples


def _ours(
    arm: Arm, q0: Array, expected: xr.Dataset, short: int, units: int, apart: dict[str, float | Check]
) -> dict[str, Contender]:
    """Return what armgpi and its kernels run; `apart` gets the distance of the compiled loop from NumPy's."""
    batch = len(q0)
    long, steps = max(100, units // batch), max(1, units // 4 // batch)
    whole = max(100, min(long, 1_000_000 // batch))
    track = partial(check_rollout, what=f"{arm.name}, batch of {batch}", settled=ON_TRACK)
    contenders: dict[str, Contender] = {}

    def near(run: xr.Dataset) -> None:
        track(run)
        count = short // EVERY + 1
        both = [x.transpose("time", ..., "joint").values for x in (run["q"], expected["q"])]
        distance = float(np.abs(both[0][:count] - both[1][::EVERY][:count]).max())
        require(f"{arm.name}: compiled against NumPy [rad]", distance, BACKENDS)
        apart[COMPILED] = max(distance, apart.get(COMPILED, 0.0))  # type: ignore[type-var]

    for threads in (1, 2):
        floor, kernels = arm.floor(batch, threads), arm.pinocchio_floor(batch, threads)
        for label, run, units_of, check in (
            (FLOOR, partial(floor, steps), steps * batch, _unchecked),
            (COMPILED, partial(arm.simulate, "compiled", long, q0, threads, EVERY), long * batch, near),
            (START, partial(arm.simulate, "compiled", 1, q0, threads), 1, _unchecked),
            (WHOLE, partial(arm.simulate, "compiled", whole, q0, threads), whole * batch, track),
            (NUMPY, partial(arm.simulate, "numpy", short, q0, threads), short * batch, track),
            (KERNELS, partial(kernels, short), short * batch, _unchecked),
        ):
            contenders[f"{label}, {threads}"] = Contender(run, units_of, check, threads)
    return contenders


def _unchecked(_: Any) -> None:
    """Accept any result: the floors have no trajectory."""


def _without_start(taken: dict[str, Samples], contenders: dict[str, Contender]) -> dict[str, Samples]:
    """Return the samples with the compiled loop less its start in place of the start."""
    samples: dict[str, Samples] = {}
    for key, one in taken.items():
        label, _, threads = key.rpartition(", ")
        if label == START:
            compiled = f"{COMPILED}, {threads}"
            times = taken[compiled].times - one.times / contenders[compiled].units
            samples[f"{LOOP}, {threads}"] = Samples(times, taken[compiled].cores)
        else:
            samples[key] = one
    return samples


def _rows(samples: dict[str, Samples], distances: dict[str, float]) -> list[list[object]]:
    """Return the rows of a batch's table."""
    rows = []
    for label in dict.fromkeys(key.rpartition(", ")[0] for key in samples):
        row: list[object] = [label]
        for threads in (1, 2):
            one = samples.get(f"{label}, {threads}")
            row += [spread(one.times), ratio(one, samples[f"{COMPILED}, {threads}"])] if one else ["", ""]
        distance = distances.get(label)
        rows.append([*row, "" if distance is None else f"{distance:.1e}"])
    return rows


def _mujoco(
    arm: Arm, q0: Array, expected: xr.Dataset, steps: int, networks: bool, threads: int
) -> list[tuple[str, Callable[[], Any], float]]:
    """Return what MuJoCo runs: label, function, and how near it has to stay."""
    if _arms.mujoco is None or arm.name not in _arms.PEER_ROBOTS:
        return []
    models = [
        _arms.mujoco.compile_urdf(arm.urdf, _arms.ROBOTS[arm.name], arm.robot.joint_names, integrator, DT)
        for integrator in (_arms.mujoco.RK4, _arms.mujoco.EULER)
    ]
    rk4, euler = (_arms.mujoco.Batch(model, threads, q0) for model in models)
    recorded = [
        np.ascontiguousarray(expected[name].transpose("time", ..., "joint").values[:steps])
        for name in ("q", "v", "tau")
    ]
    law = partial(_networks if networks else _fixed, arm, q0, steps, threads)
    return [
        (RK4, lambda: rk4.closed(law(), steps), SAME),
        (EULER_WORD, lambda: euler.closed(law(), steps), EULER),
        (RK4_REPLAY, lambda: rk4.replayed(*recorded), REPLAYED),
        (EULER_REPLAY, lambda: euler.replayed(*recorded), EULER_REPLAYED),
    ]


def _fixed(arm: Arm, q0: Array, steps: int, threads: int) -> Callable[[int, Array], Array]:
    """Return the law with fixed gains, written apart from armgpi's."""
    arm.use(threads)
    law, targets, effort, times = (
        arm.law(q0),
        arm.targets(steps),
        arm.effort,
        arm.robot.dynamics.inertia_times,
    )
    floor = -effort

    def torque(k: int, q: Array) -> Array:
        asked = times(q, law.step(q - targets[k]))
        tau = np.minimum(np.maximum(asked, floor), effort)
        refuse_cut(tau - asked)
        return tau

    return torque


def _networks(arm: Arm, q0: Array, steps: int, threads: int) -> Callable[[int, Array], Array]:
    """Return armgpi's own controller, by NumPy."""
    arm.use(threads)
    controller = arm.controller
    targets = [Target(*parts) for parts in zip(*arm.reference.at(DT * np.arange(steps)), strict=True)]
    state = controller.init(Measurement(q0), targets[0])

    def torque(k: int, q: Array) -> Array:
        nonlocal state
        tau, state = controller.step(Measurement(q), targets[k], state)
        return tau

    return torque


def _goals(name: str, networks: bool, batch: int, samples: dict[str, Samples]) -> list[list[object]]:
    """Return what was asked for, beside what was found."""
    if not networks:
        return []
    title = f"{name}, networks, batch of {batch}, 2 threads"
    bound = {"panda": 0.20, "anthropomorphic3": 0.04}[name]
    own = samples[f"{COMPILED}, 2"]
    time = spread(own.times)
    loop = spread(samples[f"{LOOP}, 2"].times)
    rows: list[list[object]] = [
        [f"{title}: µs per rollout-step", f"at most {bound:.2f}", time, _kept(time.median <= bound, own)],
        [
            f"{title}: the same without the start",
            f"at most {bound:.2f}",
            loop,
            _kept(loop.median <= bound, own),
        ],
    ]
    for label, least in ((RK4, 15.0), (RK4_REPLAY, 15.0), (EULER_WORD, 1.0), (EULER_REPLAY, 1.0)):
        if f"{label}, 2" in samples:
            times: Spread = ratio(samples[f"{label}, 2"], own)
            rows.append(
                [f"{title}: × {label}", f"at least {least:g}", times, _kept(times.median >= least, own)]
            )
    return rows


def _kept(kept: bool, own: Samples) -> str:
    """Return whether a goal is kept, if the machine let itself be measured."""
    if _timing.busy(own, 2):
        return "machine busy"
    return "yes" if kept else "no"


if __name__ == "__main__":
    main()
