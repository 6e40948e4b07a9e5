"""Speed of the closed loop: against its own kernels, and against MuJoCo doing the same work.

    python benchmarks/closed_loop.py [--quick] [--json FILE]

Prints Markdown tables; README.md beside this file says how to read them. A figure is printed only after
its runs have been checked: finite, never saturated, on the reference, and equal to MuJoCo's.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

import _timing
import numpy as np
import numpy.typing as npt
import xarray as xr
from _timing import Contender, Samples, Spread, digits, ratio, spread, table, take_turns

import armgpi  # before Pinocchio: it sets OMP_WAIT_POLICY, which OpenMP reads when it is loaded

# isort: split
import pinocchio as pin

try:
    import _mujoco as peer
except ModuleNotFoundError as error:
    if error.name != "mujoco":
        raise
    peer = None

Array = npt.NDArray[np.float64]

DT = 1e-3  # [s]
OMEGA = 20.0  # [rad/s]
MOVE = 0.5  # [rad], every joint
T_MOVE = 1.0  # [s]
#: Robot -> joints held at zero. MuJoCo refuses the first: its link 2 breaks the triangle inequality.
ROBOTS: dict[str, tuple[str, ...]] = {
    "anthropomorphic3": (),
    "ur5": (),
    "panda": ("panda_finger_joint1", "panda_finger_joint2"),
}
PEER_ROBOTS = ("ur5", "panda")
BATCH_ROBOT = "panda"
THREADS = (1, 2)

#: What is required of armgpi, as multiples of its kernels.
SINGLE_BOUND = 2.7
BATCH_BOUND, BATCH_FROM = 1.15, 256

#: Error of a run that ends a second or more after its move [rad].
SETTLED = 1e-6
#: Error of a timed batch, which may end in the middle of the move [rad].
ON_TRACK = 0.01
#: Same equations, integrator and hold: only rounding differs, and the loop forgets it [rad].
SAME = 1e-10
#: The Euler method is about half a step off, and the arm moves at up to 1.3 rad/s [rad].
OTHER_INTEGRATOR = 1e-3
#: Share of the effort limit that is no saturation.
UNSATURATED = 0.99
#: Share of a core that each of two threads has to get: 0.86 on an idle machine, 0.5 beside one busy process.
QUIET = 0.75


class Amount(NamedTuple):
    """How much is measured.

    Attributes:
        kernel_rounds: rounds of section 1.
        single_rounds: rounds of sections 2 and 3.
        single_steps: control steps of a single run.
        batch_rounds: rounds of sections 4 and 5.
        batches: sizes of the batches.
        batch_units: rollout-steps of a timed batch, about.
        policies: whether to compare the waiting policies of OpenMP.
    """

    kernel_rounds: int
    single_rounds: int
    single_steps: int
    batch_rounds: int
    batches: tuple[int, ...]
    batch_units: int
    policies: bool


FULL = Amount(21, 9, 4000, 7, (64, 256, 1024, 4096), 40_000, True)
QUICK = Amount(5, 3, 2500, 3, (64, 256, 1024), 12_000, False)


class Arm:
    """A robot in the closed loop that is measured, its kernels, and its twin in MuJoCo."""

    def __init__(self, name: str, threads: int = 1) -> None:
        """Load the robot for kernels on so many threads."""
        self.name = name
        self.threads = threads
        os.environ["OMP_NUM_THREADS"] = str(threads)  # read when a robot is made
        self.robot = armgpi.Robot.load(name, lock=ROBOTS[name])
        if self.robot.dynamics._threads != threads:
            raise RuntimeError(f"asked for {threads} threads, got {self.robot.dynamics._threads}")
        self.n = self.robot.n
        self.title = f"{name} (n = {self.n})"
        self.plant = armgpi.RigidBodyPlant(self.robot)
        self.controller = armgpi.GPI(self.robot, DT, armgpi.FixedGains(omega_c=OMEGA))
        self.q0 = self.robot.middle()
        self.reference = armgpi.Bezier(self.q0, self.q0 + MOVE, duration=T_MOVE)
        self.model = self.robot.pinocchio_model()
        self.free = self.model.copy()
        self.free.gravity = pin.Motion.Zero()

    def starts(self, batch: int) -> Array:
        """Return starting positions within 2 mrad of the reference's, shape (batch, n)."""
        return self.q0 + np.random.default_rng(1).uniform(-2e-3, 2e-3, (batch, self.n))

    def simulate(self, steps: int, q0: Array | None = None) -> xr.Dataset:
        """Run armgpi's loop, from the reference's start or a batch of others."""
        return armgpi.simulate(self.plant, self.controller, self.reference, steps * DT, q0=q0, progress=False)

    def single_kernels(self, steps: int) -> None:
        """Run the kernels of `steps` control steps: D(q) v once, forward dynamics four times."""
        model, data, free, free_data = self.model, self.model.createData(), self.free, self.free.createData()
        q, v, x, rest = self.q0 + 0.1, np.full(self.n, 0.1), np.ones(self.n), np.zeros(self.n)
        rnea, aba, world = pin.rnea, pin.aba, pin.Convention.WORLD
        for _ in range(steps):
            rnea(free, free_data, q, rest, x)
            aba(model, data, q, v, x, world)
            aba(model, data, q, v, x, world)
            aba(model, data, q, v, x, world)
            aba(model, data, q, v, x, world)

    def batch_kernels(self, steps: int, q: Array) -> None:
        """Run the same kernels in parallel, for states of shape (batch, n)."""
        threads, (model_pool, free_pool) = self.threads, self._pools
        v, x, rest, out = np.full_like(q, 0.1), np.ones_like(q), np.zeros_like(q), np.empty_like(q)
        rnea, aba = pin.rneaInParallel, pin.abaInParallel
        for _ in range(steps):
            rnea(threads, free_pool, q.T, rest.T, x.T, out.T)
            for _ in range(4):
                aba(threads, model_pool, q.T, v.T, x.T, out.T)

    @cached_property
    def _pools(self) -> tuple[Any, Any]:
        """The two models with scratch space for every thread."""
        return pin.ModelPool(self.model, self.threads), pin.ModelPool(self.free, self.threads)


class Twin:
    """An arm's loop in MuJoCo, held against armgpi's.

    Attributes:
        label: what runs.
        apart: largest distance of its positions from armgpi's [rad], over all checked runs.
    """

    def __init__(self, label: str, arm: Arm, rk4: bool, way: str = "") -> None:
        """Compile the arm for an integrator, the Runge-Kutta or the Euler method."""
        self.label = label
        self.apart = 0.0
        self._arm = arm
        self._way = way
        self._bound = SAME if rk4 else OTHER_INTEGRATOR
        path, _ = armgpi.robots.locate(arm.name)
        self._model = peer.compile_urdf(
            path.read_text(),
            ROBOTS[arm.name],
            arm.robot.joint_names,
            peer.RK4 if rk4 else peer.EULER,
            DT,
        )

    def single(self, steps: int, settled: float, expected: xr.Dataset) -> Contender:
        """Return a single run as a contender."""
        law = self._law(self._arm.q0)
        arguments = (self._arm.q0, self._targets(steps), self._arm.robot.limits.effort)
        return Contender(
            lambda: peer.run_single(self._model, self._way, law(), *arguments),
            steps,
            partial(self.check, settled=settled, expected=expected),
        )

    def batch(self, pool: Any, q0: Array, steps: int, settled: float, expected: xr.Dataset) -> Contender:
        """Return a batch as a contender; `pool` holds MuJoCo's threads."""
        law = self._law(q0)
        arguments = (q0, self._targets(steps), self._arm.robot.limits.effort)
        kernel = self._arm.robot.dynamics.inertia_times
        return Contender(
            lambda: peer.run_batch(self._model, pool, kernel, law(), *arguments),
            steps * len(q0),
            partial(self.check, settled=settled, expected=expected),
            pool.nthread,
        )

    def check(self, run: Any, settled: float, expected: xr.Dataset) -> None:
        """Check a run against armgpi's, sample by sample, and against the reference at its end."""
        what = f"{self._arm.name}, {self.label}"
        mine = np.concatenate([run.q, run.q_end[None]])
        apart = float(np.max(np.abs(mine - expected["q"].transpose("time", ..., "joint").values)))
        require(f"{what}: distance from armgpi [rad]", apart, self._bound)
        error = float(np.max(np.abs(run.q_end - expected["q_ref"].isel(time=-1).values)))
        require(f"{what}: error at the end [rad]", error, settled)
        use = float(np.max(np.abs(run.tau) / self._arm.robot.limits.effort))
        require(f"{what}: share of the effort limit", use, UNSATURATED)
        self.apart = max(self.apart, apart)

    def _law(self, q0: Array) -> Callable[[], Any]:
        """Return a maker of controllers that begin with the torque that holds the arm at `q0`."""
        return partial(peer.Law, OMEGA, DT, peer.holding_acceleration(self._model, q0))

    def _targets(self, steps: int) -> Array:
        """Return the reference at every sample, shape (steps, n)."""
        return self._arm.reference.at(DT * np.arange(steps)).q


def require(what: str, value: float, bound: float) -> None:
    """Refuse a value that is NaN or above its bound."""
    if not value <= bound:
        raise RuntimeError(f"{what} is {value:.3g}, expected at most {bound:.3g}: the figures do not count")


def check_rollout(rollout: xr.Dataset, what: str, settled: float) -> None:
    """Check that a run of armgpi finished, never saturated and ended on its reference."""
    if (rollout["status"] != armgpi.Status.FINISHED).any():
        raise RuntimeError(f"{what}: a rollout did not finish")
    error = np.abs(rollout["q"] - rollout["q_ref"]).isel(time=-1)
    require(f"{what}: error at the end [rad]", float(error.max(skipna=False)), settled)
    use = np.abs(rollout["tau_command"]) / rollout["effort"]
    require(f"{what}: share of the effort limit", float(use.max(skipna=False)), UNSATURATED)


def kernels(amount: Amount) -> dict[str, Any]:
    """Time Pinocchio's kernels: section 1."""
    batch = 256
    data, rows = {}, []
    for name in ROBOTS:
        arm = Arm(name)
        samples = take_turns(_kernel_contenders(arm, batch), amount.kernel_rounds)
        data[name] = _timing.plain(samples)
        rows.append([arm.title, *(digits(spread(one.times).median) for one in samples.values())])
    print(f"\n## 1. Kernels: microseconds per state, called from Python (parallel ones: batch of {batch})\n")
    print(table(["robot", *samples], rows))
    print("\n∥ 1, ∥ 2: Pinocchio's parallel kernel on 1 and 2 threads; there is none for crba.")
    return data


def _kernel_contenders(arm: Arm, batch: int) -> dict[str, Contender]:
    """Return every kernel as a contender; a parallel one has to agree with the single one bit by bit."""
    calls, parallel_calls = 1000, 10
    model, data, world = arm.model, arm.model.createData(), pin.Convention.WORLD
    q, v, x = arm.q0 + 0.1, np.full(arm.n, 0.1), np.ones(arm.n)
    rows = [np.tile(one, (batch, 1)).T for one in (q, v, x)]

    def single(kernel: Callable[..., Any], *arguments: Any) -> Contender:
        def run() -> None:
            for _ in range(calls):
                kernel(model, data, *arguments)

        return Contender(run, calls)

    def parallel(kernel: Callable[..., Any], threads: int, one: Array) -> Contender:
        pool, out, expected = pin.ModelPool(model, threads), np.empty((batch, arm.n)), one.copy()

        def run() -> None:
            for _ in range(parallel_calls):
                kernel(threads, pool, *rows, out.T)

        def check(_: None) -> None:
            require(f"{arm.name}: parallel against single kernel", float(np.max(np.abs(out - expected))), 0.0)

        return Contender(run, batch * parallel_calls, check, threads)

    contenders = {
        "rnea": single(pin.rnea, q, v, x),
        "aba": single(pin.aba, q, v, x, world),
        "crba": single(pin.crba, q),
    }
    for threads in THREADS:
        contenders[f"rnea ∥ {threads}"] = parallel(
            pin.rneaInParallel, threads, pin.rnea(model, data, q, v, x)
        )
        contenders[f"aba ∥ {threads}"] = parallel(
            pin.abaInParallel, threads, pin.aba(model, data, q, v, x, world)
        )
    return contenders


def single_runs(amount: Amount) -> dict[str, Any]:
    """Time single runs of armgpi, of its kernels alone and of MuJoCo: sections 2 and 3."""
    steps = amount.single_steps
    data, own_rows, peer_rows = {}, [], []
    for name in ROBOTS:
        arm = Arm(name)
        expected = arm.simulate(steps)
        contenders = {
            "kernels": Contender(partial(arm.single_kernels, steps), steps),
            "armgpi": Contender(
                partial(arm.simulate, steps),
                steps,
                partial(check_rollout, what=f"{name}, single run", settled=SETTLED),
            ),
        }
        twins = []
        if peer and name in PEER_ROBOTS:
            twins = [
                Twin("mj_step in parts, RK4", arm, True, "parts"),
                Twin("mj_step, RK4", arm, True, "mj_step"),
                Twin("mj_step1/2, Euler (other integrator)", arm, False, "halves"),
            ]
            contenders.update({twin.label: twin.single(steps, SETTLED, expected) for twin in twins})
        samples = take_turns(contenders, amount.single_rounds)
        own = ratio(samples["armgpi"], samples["kernels"])
        data[name] = _result(samples, {"ratio": own}, twins)
        times = (spread(samples[key].times) for key in ("kernels", "armgpi"))
        own_rows.append([arm.title, *times, own, verdict(own, SINGLE_BOUND, samples["kernels"])])
        peer_rows += _peer_rows(name, samples, "armgpi", twins)
    print(f"\n## 2. Single run of {steps} steps: microseconds per control step\n")
    print(table(["robot", "kernels alone", "armgpi.simulate", "ratio", f"at most {SINGLE_BOUND}"], own_rows))
    print(
        "\nKernels alone: one rnea without gravity (D(q) v) and four aba (Runge-Kutta), called from Python."
        "\narmgpi.simulate: GPI with fixed gains, the call's own checks and the recording included."
    )
    if peer_rows:
        print("\n## 3. MuJoCo doing the same work: single run, microseconds per control step\n")
        print(table(_PEER_HEADERS, peer_rows))
        print(
            "\nA Python loop with the same law in NumPy and D(q) v by mj_mulM. In parts: mj_fwdPosition,"
            "\nmj_mulM, mj_forwardSkip, mj_RungeKutta, so that D(q) is computed once. Plain: mj_fwdPosition,"
            "\nmj_mulM, mj_step. Apart: largest distance of its positions from armgpi's, at any sample."
        )
    return data


def batch_runs(amount: Amount) -> dict[str, Any]:
    """Time batches of armgpi, of its parallel kernels alone and of MuJoCo: sections 4 and 5."""
    arms = [Arm(BATCH_ROBOT, threads) for threads in THREADS]
    widest = arms[-1]
    twins, pool = [], None
    if peer:
        twins = [
            Twin("mujoco.rollout, RK4", widest, True),
            Twin("mujoco.rollout, Euler (other integrator)", widest, False),
        ]
        pool = peer.rollout.Rollout(nthread=widest.threads)
    settled = _settled_batch(widest, twins, pool)
    data, own_rows, peer_rows, cores = {}, [], [], []
    for batch in amount.batches:
        steps = max(10, amount.batch_units // batch)
        q0 = widest.starts(batch)
        expected = widest.simulate(steps, q0)
        contenders = {}
        for arm in arms:
            contenders[f"kernels, {arm.threads}"] = Contender(
                partial(arm.batch_kernels, steps, q0), steps * batch, threads=arm.threads
            )
            contenders[f"armgpi, {arm.threads}"] = Contender(
                partial(arm.simulate, steps, q0),
                steps * batch,
                partial(check_rollout, what=f"batch of {batch}", settled=ON_TRACK),
                arm.threads,
            )
        for twin in twins:
            twin.apart = 0.0
            contenders[twin.label] = twin.batch(pool, q0, steps, ON_TRACK, expected)
        samples = take_turns(contenders, amount.batch_rounds)
        ratios = {}
        for arm in arms:
            floor, own = samples[f"kernels, {arm.threads}"], samples[f"armgpi, {arm.threads}"]
            both = ratios[f"ratio, {arm.threads}"] = ratio(own, floor)
            word = verdict(both, BATCH_BOUND, floor, arm.threads) if batch >= BATCH_FROM else ""
            label = f"{batch}, {arm.threads} thread{'s' * (arm.threads > 1)}"
            own_rows.append([label, spread(floor.times), spread(own.times), both, word])
        if batch >= BATCH_FROM:
            cores.append(float(np.median(samples[f"kernels, {widest.threads}"].cores)))
        data[str(batch)] = _result(samples, ratios, twins)
        peer_rows += _peer_rows(str(batch), samples, f"armgpi, {widest.threads}", twins)
    print(f"\n## 4. Batch of {widest.title}: microseconds per rollout-step\n")
    bound = f"at most {BATCH_BOUND} from {BATCH_FROM} on"
    print(table(["batch", "parallel kernels alone", "armgpi.simulate", "ratio", bound], own_rows))
    if peer_rows:
        print(
            f"\n## 5. MuJoCo doing the same work: batch on {widest.threads} threads, microseconds per "
            "rollout-step\n"
        )
        print(table(_PEER_HEADERS, peer_rows))
        print(
            "\nOne call of mujoco.rollout a step, with the same law in NumPy. MuJoCo offers no D(q) v here:"
            "\nit is Pinocchio's parallel kernel, as in armgpi. The timed runs are short; checked beforehand:"
        )
    print("\n" + "\n".join(f"- {line}" for line in settled))
    return {"settled": settled, "batches": data, "cores": min(cores)}


def _settled_batch(arm: Arm, twins: list[Twin], pool: Any, batch: int = 32, steps: int = 2000) -> list[str]:
    """Run a batch until it has settled, in armgpi and MuJoCo; return in words what was found."""
    q0 = arm.starts(batch)
    expected = arm.simulate(steps, q0)
    check_rollout(expected, f"batch of {batch}", SETTLED)
    words = [f"armgpi, batch of {batch} over {steps * DT:g} s: within {SETTLED:g} rad of the goal at the end"]
    for twin in twins:
        once = twin.batch(pool, q0, steps, SETTLED, expected)
        once.check(once.run())
        words.append(f"{twin.label}: the same, and within {twin.apart:.1e} rad of armgpi at every sample")
    return words


def _result(
    samples: Mapping[str, Samples], ratios: Mapping[str, Spread], twins: list[Twin]
) -> dict[str, Any]:
    """Return what is known of some contenders as plain data."""
    return {
        "times": _timing.plain(samples),
        "ratios": {name: one._asdict() for name, one in ratios.items()},
        "apart": {twin.label: twin.apart for twin in twins},
    }


_PEER_HEADERS = ["", "time", "of armgpi's", "apart [rad]"]


def _peer_rows(title: str, samples: Mapping[str, Samples], own: str, twins: list[Twin]) -> list[list[object]]:
    """Return the rows of a table against MuJoCo; none where it did not run."""
    rows: list[list[object]] = [[f"{title}: armgpi", spread(samples[own].times), "1", ""]]
    for twin in twins:
        times = samples[twin.label]
        rows.append(
            [f"{title}: {twin.label}", spread(times.times), ratio(times, samples[own]), f"{twin.apart:.1e}"]
        )
    return rows if twins else []


def waiting_policies() -> dict[str, float]:
    """Time a batch under each policy, in processes of their own: OpenMP reads it when it is loaded."""
    times = {}
    for policy in ("PASSIVE", "ACTIVE"):
        answer = subprocess.run(
            [sys.executable, __file__, "--probe"],
            env={**os.environ, "OMP_WAIT_POLICY": policy},
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
        times[policy] = float(answer.stdout)
    figures = ", ".join(f"{policy} {digits(value)}" for policy, value in times.items())
    print(
        f"\nOMP_WAIT_POLICY (armgpi.simulate, batch of 256 on {THREADS[-1]} threads): {figures} microseconds"
        "\nper rollout-step. Active threads spin while they wait: nobody has to be woken, but as soon as"
        "\nanything else wants a core it all takes several times as long. armgpi sets PASSIVE unless you"
        "\nhave set something."
    )
    return times


def probe() -> float:
    """Return microseconds per rollout-step of a batch under this process's OMP_WAIT_POLICY."""
    batch, steps = 256, 100
    arm = Arm(BATCH_ROBOT, THREADS[-1])
    contender = Contender(
        partial(arm.simulate, steps, arm.starts(batch)),
        batch * steps,
        partial(check_rollout, what="probe", settled=ON_TRACK),
        arm.threads,
    )
    return spread(take_turns({"armgpi": contender}, 7)["armgpi"].times).median


def verdict(own: Spread, bound: float, floor: Samples, threads: int = 1) -> str:
    """Return whether a ratio keeps its bound; processor time on one thread counts on a busy machine too."""
    if threads > 1 and np.median(floor.cores) < QUIET * threads:
        return "machine busy"
    return "met" if own.median <= bound else "not met"


def main() -> None:
    """Run everything."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a look in half a minute, not to judge by")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures of every round")
    parser.add_argument("--probe", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.probe:
        print(probe())
        return
    amount = QUICK if options.quick else FULL
    facts = _timing.machine(["armgpi", "pin", "numpy", "mujoco"])
    print("# Closed loop: GPI with fixed gains, 1 kHz, Runge-Kutta of order 4\n")
    print(_timing.machine_line(facts) + ".")
    print(
        "Median (least..greatest) over rounds in which the contenders take turns; one thread: processor"
        "\ntime, several: wall time. Read the ratios."
    )
    if options.quick:
        print("Quick: too few rounds to judge a bound by.")
    results: dict[str, Any] = {"machine": facts, "quick": options.quick}
    results["kernels"] = kernels(amount)
    results["single"] = single_runs(amount)
    results["batch"] = batch_runs(amount)
    if amount.policies:
        results["waiting_policies"] = waiting_policies()
    if peer is None:
        print("\nMuJoCo is not installed, so nothing was held against it: pip install 'armgpi[bench]'")
    cores = results["batch"]["cores"]
    print(
        f"\nThe parallel kernels on {THREADS[-1]} threads had at least {cores:.2g} cores"
        + (
            ": fine."
            if cores > QUIET * THREADS[-1]
            else ": the machine was busy, so not all of their times count."
        )
    )
    if options.json:
        options.json.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
