"""Bring up simulated robots with which nothing is wrong: what stops them is a false alarm.

Usage:
    python tools/sound.py                          three robots from their files to full speed
    python tools/sound.py --target fci             one of them
    python tools/sound.py --draws 32 --seed 1      drawn robots, in a batch for each stage

The first types the commands of docs/bringup.md in a fresh folder: `new`, `bringup`, and for each stage `loop`
and `bringup check`. The second draws robots that differ from their files as sound ones do: friction of up to
3 % of the torque that joints are moved with (which the file does not tell), masses 10 % off either way, a
load of up to 2 % of the arm's mass at the tip, and encoders of 16 bits. It counts stages that the supervisor
stops, and logs that `check` calls wrong, of those that were not stopped. Robots that carry their own weight
know their own masses; their load they do not know.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import targets

from armgpi import (
    Delayed,
    Encoder,
    RigidBodyPlant,
    Saturated,
    Supervised,
    config,
    simulate,
)
from armgpi.base.intervals import clopper_pearson
from armgpi.base.parameter import with_parameters
from armgpi.hardware.export.targets import compensates_gravity
from armgpi.hardware.realtime import judge, stages
from armgpi.hardware.realtime.ends import UPRIGHT
from armgpi.loop import log as logs
from armgpi.plants.plant import Wrapper
from armgpi.supervisor import Reason

#: Target -> arm, as somebody would take it from the catalogue.
ROBOTS = {"fci": "panda", "ur": "ur5", "ros2_control": "z1"}
BITS, FRICTION, MASS, LOAD = 16, 0.03, 0.1, 0.02


def call(folder: Path, *words: str) -> tuple[int, str]:
    """Run `armgpi` in a folder; return its code and what it printed."""
    done = subprocess.run(
        [sys.executable, "-m", "armgpi", *words], cwd=folder, capture_output=True, text=True, check=False
    )
    return done.returncode, done.stdout


def bring_up(target: str, path: Path) -> None:
    """Bring a robot up by commands, and print what each kind of stage came to."""
    arm = ROBOTS[target]
    for words in (("new", arm, "--target", target), ("bringup", f"{arm}.yaml")):
        code, said = call(path, *words)
        assert code == 0, said
    folder = stages.read(path / "bringup")
    reached: dict[str, Any] = {}
    for stage in folder.stages:
        dry = ["--dry-run"] if stage.kind == "dry" else []
        file = f"bringup/{stage.name}"
        call(path, "loop", f"{file}.yaml", *dry, "--clock", "simulated", "--log", f"{file}.armlog")
        ran = sorted(str(each.relative_to(path)) for each in folder.path.glob("*.armlog"))
        code, said = call(path, "bringup", "check", *ran)
        used = shares(folder.experiment(stage), logs.read(path / f"{file}.armlog"))
        reached[stage.kind] = np.maximum(reached.get(stage.kind, 0.0), used)
        if code:
            print(f"{target} {arm}: {stage.name}: {said}", flush=True)
            return
    for kind, used in reached.items():
        print(f"| {arm} | {kind} | " + " | ".join("" if np.isnan(x) else f"{x:.0%}" for x in used) + " |")
    print(said, flush=True)


def shares(experiment: Any, log: Any) -> Any:
    """Return how much of its caps a stage took: torque, speed, and distance from the reference, (3,)."""
    law = next(iter(experiment.controllers.values()))
    supervised, rows = Supervised(law, experiment.supervisor), log.samples
    own, q = supervised.bounds, rows["q_measured"]
    lag = round(0.005 / law.dt) or 1  # as the supervisor smooths velocities
    dev = np.abs(rows["tau"] - experiment.robot.gravity(q)) / own.cap
    speed = np.abs(q[lag:] - q[:-lag]) / lag / own.speed
    found = np.array([x.max() for x in (dev, speed, np.abs(q - rows["q_ref"]) / own.following)])
    capped = experiment.supervisor.torque_cap is not None
    return found if capped else np.full(3, np.nan)


@with_parameters
class Carried(Wrapper):
    """An arm whose robot adds the weight that it knows, its own or, where the law carries it, none."""

    knows: Any = None

    def step(self, tau: Any, state: Any, dt: float) -> Any:
        """Return the next state, under the robot's torque too."""
        added = 0.0 if self.knows is None else self.knows.dynamics.gravity(self.plant.true_state(state).q)
        return self.plant.step(tau + added, state, dt)


def draw_arms(own: Any, start: Any, count: int, rng: Any) -> tuple[Any, Any]:
    """Return arms as they may be, and the same without their loads, as batches."""
    given = {
        "inertia_scale": 1.0 + MASS * rng.uniform(-1.0, 1.0, count),
        "coulomb": FRICTION * rng.uniform(size=(count, own.n)) * stages.moving_torque(own, start),
    }
    load = LOAD * own.moving_mass * rng.uniform(size=count)
    return own.varied(payload=load, frame=own.tip, **given), own.varied(**given)


def draw(target: str, count: int, seed: int) -> None:
    """Bring drawn robots of a target up, and print what stopped them."""
    arm = next(iter(targets.ARMS[target]))
    data = targets.described(target, arm, BITS)
    loaded = config.Loaded(config.check(data, config.Origin(target)), config.Origin(target))
    experiment = config.build(*loaded)
    model, start = experiment.robot, experiment.reference.at(0.0).q
    carries = compensates_gravity(model)
    own = model.with_gravity(UPRIGHT) if carries else model
    arms, empty = draw_arms(own, start, count, np.random.default_rng(seed))
    with tempfile.TemporaryDirectory() as path:
        folder = stages.write(loaded, experiment, Path(path))
        for stage in folder.stages:
            if stage.kind != "dry":
                run_stage(folder, stage, count, arms, empty if carries else None)


def run_stage(folder: Any, stage: Any, count: int, arms: Any, knows: Any) -> None:
    """Run a stage of all robots, judge what was not stopped, and print what came of them."""
    begun, experiment = time.process_time(), folder.experiment(stage)
    law = next(iter(experiment.controllers.values()))
    arm = Saturated(RigidBodyPlant(arms, friction="urdf"))
    plant = Delayed(Encoder(Carried(arm, knows=knows), bits=BITS), experiment.config.plant.delay)
    rollout = simulate(
        plant, law, experiment.reference, experiment.t_final, supervisor=experiment.supervisor, progress=False
    )
    stopped, wrong = Counter(), Counter()
    for i in range(count):
        one = rollout.isel(rollout=i)
        if int(one["fault"]):
            joint = str(one.joint.values[int(one["fault_joint"])])
            stopped[f"{Reason(int(one['fault'])).name} {joint}"] += 1
            continue
        t = one["time"].values[:-1]
        target = experiment.reference.at(t)
        given = {"q_measured": one["q_measured"].values[:-1], "q_ref": target.q}
        given |= {"v_ref": target.v, "a_ref": target.a}
        tau = one["tau_command"].values[:-1]
        log = logs.of_samples(tuple(experiment.robot.joint_names), law.dt, given, tau)
        path = logs.write(log, folder.path / f"{stage.name}.armlog")
        for each in judge.judge(folder, [path]).findings[:1]:
            wrong[f"{each.question} {each.joint}"] += 1
    said = f"{stage.name}: stopped {share(stopped, count)}; called wrong {share(wrong, count)}"
    print(f"{said} ({time.process_time() - begun:.0f} s)", flush=True)


def share(found: Counter[str], count: int) -> str:
    """Return how many, with their interval in % and their causes."""
    _, low, high = clopper_pearson(found.total(), count)
    causes = ", ".join(f"{what} {n}" for what, n in found.most_common(4))
    return f"{found.total()} of {count} ({100 * low:.2g} to {100 * high:.2g} %) {causes}".strip()


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--target", choices=tuple(ROBOTS))
    parser.add_argument("--draws", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    for target in [given.target] if given.target else ROBOTS:
        if given.draws:
            draw(target, given.draws, given.seed)
        else:
            with tempfile.TemporaryDirectory() as path:
                bring_up(target, Path(path))


if __name__ == "__main__":
    main()
