"""What compliance costs: a supervised sample in exported C, and that C does what Python does."""

from __future__ import annotations

import ctypes
import re
import tempfile
from pathlib import Path
from typing import Any

import _page
import numpy as np
from _compliant import ARMS, DT, Hand, Surface, friction_of, place
from _springs import stiffness_of
from _timing import Contender, ratio, spread, table, take_turns

import armgpi
from armgpi.base.arrays import Array
from armgpi.codegen import build
from armgpi.hardware.export.controller import ExportedController

#: What a supervised sample may take of the joint controller's.
GOAL = 1.6
#: Samples of a replay, and of those that are compared with Python.
SAMPLES, CHECKED = 3_200, 300
#: As the Makefile of an export compiles.
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared")


def cost(quick: bool) -> None:
    """Print the cost of a sample, and how far C is from Python."""
    rounds = 3 if quick else 9
    _page.say(
        f"A supervised step of exported C, {rounds} rounds over a log of {SAMPLES} samples, one thread; × "
        f"is how many times the step of GPI.auto's joint controller takes, goal at most {GOAL:g}. Apart: "
        f"largest difference of {CHECKED} torques of exported C from Python's, over the largest; goal 1e-9."
    )
    rows = []
    for name in ARMS[:1]:
        where = place(name)
        robot = where.robot
        known = robot.with_friction(*friction_of(robot, 0.03))
        laws = {
            "GPI.auto": armgpi.GPI.auto(known, DT, delay=DT, bits=17, drives="stiff"),
            "GPI.auto, force_limit": armgpi.GPI.auto(
                known, DT, delay=DT, bits=17, drives="stiff", force_limit=20.0
            ),
            "CartesianImpedance": armgpi.CartesianImpedance(
                known,
                DT,
                stiffness=stiffness_of(500.0),
                delay=DT,
                friction_feedforward=True,
                force_limit=30.0,
            ),
            "JointImpedance": armgpi.JointImpedance(known, DT, delay=DT),
        }
        # A force that no motion reaches: what is measured is the estimate of every sample.
        watched = armgpi.Supervisor(tool_force=500.0)
        laws |= {
            f"{title}, tool_force": armgpi.Supervised(laws[title], watched)
            for title in ("GPI.auto", "CartesianImpedance")
        }
        taken = take_turns({title: _replay(where, law) for title, law in laws.items()}, rounds)
        for title, law in laws.items():
            times = spread(1e3 * taken[title].times)
            apart = f"{_apart(where, law):.1g}"
            rows.append([name, title, times, ratio(taken[title], taken["GPI.auto"]), apart])
    print(table(["arm", "controller", "a step [ns]", "×", "apart"], rows))


def _replay(where: Any, law: Any) -> Contender:
    """Return a replay of a motion in exported C."""
    robot = where.robot
    with tempfile.TemporaryDirectory() as folder:
        armgpi.export_controller(law, folder, measure=False)
        header, source = ((Path(folder) / f"armgpi_controller.{end}").read_text() for end in "hc")
    names = _arguments(header, "armgpi_step")
    first = _arguments(header, "armgpi_init")
    pointers = ", ".join(f"const double *{name}" for name in names)
    rows = ", ".join(f"{name} + k * ARMGPI_N" for name in names)
    whole = (
        re.sub(r'#include "armgpi_controller.h"', lambda _: header, source)
        + f"\nint bench_replay({pointers}, double *tau, long samples)\n{{\n    static armgpi_state_t state;\n"
        + "    int faults = 0;\n"
        + f"    (void)armgpi_init(&state, {', '.join(first)});\n    for (long k = 0; k < samples; ++k)\n"
        + f"        faults += armgpi_step(&state, {rows}, tau + k * ARMGPI_N) == ARMGPI_STATUS_FAULT;\n"
        + "    return faults;\n}\n"
    )
    library = build.library(whole, FLAGS)
    arm = armgpi.RigidBodyPlant(robot, (), law.robot.friction)
    plant = armgpi.Delayed(armgpi.Encoder(arm, 17), 1)
    log = armgpi.simulate(
        plant, law, where.circle, SAMPLES * DT, q0=where.circle.at(0.0).q, backend="compiled"
    )
    target = where.circle.at(DT * np.arange(SAMPLES))
    known = {"q_measured": log["q_measured"].values[:SAMPLES], "q_ref": target.q}
    known |= {"v_ref": target.v, "a_ref": target.a}
    arrays = [np.ascontiguousarray(known[name]) for name in names]
    tau = np.empty((SAMPLES, robot.n))

    def run() -> None:
        given = [ctypes.c_void_p(x.ctypes.data) for x in (*arrays, tau)]
        if library.bench_replay(*given, ctypes.c_long(SAMPLES)):
            raise RuntimeError("the supervisor found a fault: the figures do not count")

    return Contender(run, SAMPLES)


def _arguments(header: str, function: str) -> list[str]:
    """Return the names of a function's input arrays."""
    found = re.search(rf"{function}\(([^)]*)\)", header)
    assert found is not None
    return re.findall(r"const armgpi_real_t \*?(\w+)", found[1])


def _apart(where: Any, law: Any) -> float:
    """Return the largest difference of torques from exported C and Python on the way into a wall."""
    robot = where.robot
    normal = np.array([0.0, 0.0, 1.0])
    goal = armgpi.inverse_kinematics(
        robot, robot.tip, where.position - 0.03 * normal, where.rotation, near=where.q
    ).q
    surface = Surface(distance=float(where.position[2]) - 0.002, damping=20.0)
    torques: list[Array] = []
    supervised = law if isinstance(law, armgpi.Supervised) else armgpi.Supervised(law)
    for one in (supervised, ExportedController.of(law)):
        arm = armgpi.RigidBodyPlant(
            robot, (), law.robot.friction, environment=[surface, Hand(y=60.0, onset=0.15)]
        )
        plant = armgpi.Delayed(armgpi.Encoder(arm, 17), 1)
        move = armgpi.Bezier(where.q, goal, 0.4)
        rollout = armgpi.simulate(plant, one, move, CHECKED * DT, backend="numpy")
        torques.append(rollout["tau_command"].values)
    return float(np.abs(torques[0] - torques[1]).max() / np.abs(torques[0]).max())
