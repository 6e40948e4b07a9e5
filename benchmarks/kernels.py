"""Speed of the equations of motion: generated code, Pinocchio, dynibo, MuJoCo, Drake, on the same states.

python benchmarks/kernels.py [--quick]
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import _arms
import _page
import _timing
import numpy as np
import pinocchio as pin
from _arms import KERNEL, Arm, require
from _generated import Kernels, aligned
from _peer import Array
from _pinocchio import WORLD, without_gravity
from _timing import Contender, digits, ratio, spread, table, take_turns

import armgpi

#: What is evaluated, in Pinocchio's words and in MuJoCo's.
KERNELS = {
    "forward": "forward dynamics",
    "inertia_times": "D(q) v",
    "inverse": "inverse dynamics",
}
LANES = (1, 4, 8)
FLOOR = f"generated, {LANES[-1]} lanes"
#: About what generated code takes for an operation [us].
OPERATION = 5e-5
#: Microseconds of work for each time that is taken, about.
LONG, SHORT = 30_000, 10_000


def main() -> None:
    page = _page.begin(__file__, "Kernels")
    batch, rounds = (1024, 3) if page.quick else (4096, 9)
    work = SHORT if page.quick else LONG
    _page.say(
        f"Nanoseconds per state, {rounds} rounds; × is how many times longer than {FLOOR}. {batch} random "
        f"states; results agree with Pinocchio's to {KERNEL:g} of the largest entry."
    )
    for kernel, title in KERNELS.items():
        found: dict[str, dict[str, Any]] = {}
        operations = {}
        for name in _arms.ROBOTS:
            contenders, operations[name] = _contenders(Arm(name), kernel, batch, work)
            found[name] = take_turns(contenders, rounds)
        page.figures[kernel] = {name: _timing.plain(samples) for name, samples in found.items()}
        print(f"\n## {title[0].upper()}{title[1:]}\n")
        labels = list(dict.fromkeys(label for samples in found.values() for label in samples))
        rows = []
        for label in labels:
            row: list[object] = [label]
            for samples in found.values():
                if label not in samples:
                    row += ["", ""]
                    continue
                if label.endswith("2 threads") and _timing.busy(samples[label], 2):
                    row += ["machine busy", ""]
                    continue
                times = spread(1e3 * samples[label].times)
                row += [times, f"{digits(ratio(samples[label], samples[FLOOR]).median)}"]
            rows.append(row)
        print(table(["", *(x for name in found for x in (f"{name}, n = {Arm(name).n}", "×"))], rows))
        counts = ", ".join(f"{count} for {name}" for name, count in operations.items())
        print(f"\nOperations in the generated code: {counts}.")
    _page.say("In parallel: abaInParallel and rneaInParallel, whose threads run C++ alone.")
    for missing, word in ((_arms.dynibo, "dynibo"), (_arms.mujoco, "MuJoCo"), (_arms.drake, "Drake")):
        if missing is None:
            print(f"\n{word} is not installed and so not in the tables: pip install '.[bench,peers]'.")
    page.write()


def _contenders(arm: Arm, kernel: str, batch: int, work: float) -> tuple[dict[str, Contender], int]:
    """Return everyone who evaluates a kernel, and how many operations the generated code has."""
    rng = np.random.default_rng(0)
    count = 2 if kernel == "inertia_times" else 3
    states = [rng.uniform(-1.0, 1.0, (batch, arm.n)) for _ in range(count)]
    arm.use(1)

    def checked(robot: armgpi.Robot) -> Callable[[Array], None]:
        expected = getattr(robot.dynamics, kernel)(*states)

        def check(result: Array) -> None:
            wrong = float(np.abs(result - expected[: len(result)]).max() / np.abs(expected).max())
            require(f"{arm.name}: {kernel}", wrong, KERNEL)

        return check

    check = checked(arm.robot)

    def slow(
        evaluate: Callable[..., Array], microseconds: float, check: Callable[[Array], None] = check
    ) -> Contender:
        few = max(16, min(batch, int(work / microseconds)))
        rows = [np.ascontiguousarray(x[:few]) for x in states]
        return Contender(lambda: evaluate(*rows), few, check)

    contenders: dict[str, Contender] = {}
    operations = 0
    for lanes in LANES:
        code = Kernels(arm.robot, lanes, [kernel])
        operations = code.operations[kernel]
        contenders[f"generated, {lanes} lane{'s' * (lanes > 1)}"] = _generated(
            code, kernel, states, max(1, int(work / (batch * operations * OPERATION))), check
        )
    contenders["Pinocchio, from Python"] = slow(_pinocchio(arm, kernel), 2.0)
    for threads in (1, 2):
        label = f"Pinocchio, parallel, {threads} thread{'s' * (threads > 1)}"
        contenders[label] = _parallel(arm, kernel, states, threads, check)
    if _arms.dynibo:
        made = _arms.dynibo.load(arm.urdf, _arms.ROBOTS[arm.name], arm.n)
        rust, same = getattr(_arms.dynibo, kernel), checked(arm.robot.with_gravity(_arms.dynibo.GRAVITY))
        contenders["dynibo, from Python"] = slow(lambda *rows: rust(made, *rows), 2.0, same)
    if arm.name in _arms.PEER_ROBOTS and _arms.mujoco:
        model = _arms.mujoco.compile_urdf(
            arm.urdf, _arms.ROBOTS[arm.name], arm.robot.joint_names, _arms.mujoco.RK4, _arms.DT
        )
        evaluate = getattr(_arms.mujoco, kernel)
        contenders["MuJoCo, from Python"] = slow(lambda *rows: evaluate(model, *rows), 4.0)
    if arm.name in _arms.PEER_ROBOTS and _arms.drake and kernel == "forward":
        plant = _arms.drake.load(arm.urdf, _arms.ROBOTS[arm.name], arm.robot.joint_names)
        contenders["Drake, from Python"] = slow(lambda *rows: _arms.drake.forward(plant, *rows), 10.0)
    return contenders, operations


def _generated(
    made: Kernels, kernel: str, states: list[Array], repeats: int, check: Callable[[Array], None]
) -> Contender:
    """Return a loop in C over all states."""
    batch, n = states[0].shape
    at, to = made.packed(np.hstack(states)), aligned(batch * n)

    def run() -> Array:
        made.call(kernel, at, to, repeats)
        return to

    return Contender(run, batch * repeats, lambda buffer: check(made.unpacked(buffer, n)))


def _pinocchio(arm: Arm, kernel: str) -> Callable[..., Array]:
    """Return a Python loop over states."""
    model = without_gravity(arm.model) if kernel == "inertia_times" else arm.model
    data, rest = model.createData(), np.zeros(arm.n)
    aba, rnea = pin.aba, pin.rnea

    def forward(q: Array, v: Array, tau: Array) -> Array:
        return np.array([aba(model, data, *row, WORLD) for row in zip(q, v, tau, strict=True)])

    def inverse(q: Array, v: Array, a: Array) -> Array:
        return np.array([rnea(model, data, *row) for row in zip(q, v, a, strict=True)])

    def inertia_times(q: Array, x: Array) -> Array:
        return np.array([rnea(model, data, at, rest, of) for at, of in zip(q, x, strict=True)])

    return {"forward": forward, "inverse": inverse, "inertia_times": inertia_times}[kernel]


def _parallel(
    arm: Arm, kernel: str, states: list[Array], threads: int, check: Callable[[Array], None]
) -> Contender:
    """Return Pinocchio's kernel for batches."""
    out = np.empty_like(states[0])
    columns = [x.T for x in states]
    if kernel == "forward":
        pool, evaluate = pin.ModelPool(arm.model, threads), pin.abaInParallel
    elif kernel == "inverse":
        pool, evaluate = pin.ModelPool(arm.model, threads), pin.rneaInParallel
    else:
        pool, evaluate = pin.ModelPool(without_gravity(arm.model), threads), pin.rneaInParallel
        columns.insert(1, np.zeros_like(states[0]).T)

    def run() -> Array:
        evaluate(threads, pool, *columns, out.T)
        return out

    return Contender(run, len(out), check, threads)


if __name__ == "__main__":
    main()
