"""Exported C: bytes, operations, time of a step and distance from Python over a log of 40 s, as one table.

The replay is timed by the exported `main.c` itself: the mean over passes through the first 2 s of the log, on
one core, compiled by the flags of the exported Makefile (-O2, no -march).
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator

import numpy as np

from armgpi import (
    GPI,
    BSplineNetwork,
    Controller,
    Encoder,
    ExportedController,
    PIDInversion,
    RigidBodyPlant,
    Robot,
    Saturated,
    Waypoints,
    export_controller,
    simulate,
)
from armgpi.hardware.export.files import record

DT, SECONDS, BITS, PAYLOAD = 1e-3, 40.0, 18, 0.3
FINGERS = ("panda_finger_joint1", "panda_finger_joint2")


def arms() -> Iterator[tuple[str, Robot, float]]:
    """Names, arms and the loads that their controllers do not know of [kg]."""
    yield "anthropomorphic3", Robot.load("anthropomorphic3"), 0.1
    yield "ur5", Robot.load("ur5"), PAYLOAD
    yield "panda", Robot.load("panda", lock=FINGERS), PAYLOAD


def wandering(robot: Robot) -> Waypoints:
    """Seven moves of up to 0.5 rad around the middle of the joint ranges, with stops."""
    middle = robot.middle()
    points = [middle, *(middle + np.random.default_rng(0).uniform(-0.5, 0.5, (7, robot.n)))]
    return Waypoints(points, durations=[4.0] * 7, holds=[1.0] * 8)


def main() -> None:
    print(
        "| arm | controller | number | state [bytes] | operations, worst case | step [ns] | saturated [ns] "
        "| from Python | closed loop [rad] |\n|---|---|---|---|---|---|---|---|---|"
    )
    for name, robot, load in arms():
        contenders: dict[str, Controller] = {
            "GPI": GPI(robot, DT),
            "GPI, networks": GPI(robot, DT, BSplineNetwork((22.0, 60.0))),
            "PID": PIDInversion(robot, DT),
        }
        plant = Encoder(Saturated(RigidBodyPlant(robot.with_payload(robot.tip, load))), BITS)
        reference = wandering(robot)
        for label, controller in contenders.items():
            log = record(plant, controller, reference, SECONDS)
            ours = simulate(plant, controller, reference, 8.0, progress=False)
            for real in ("double", "float"):
                with tempfile.TemporaryDirectory() as folder:
                    done = export_controller(controller, folder, log, real=real)
                    exported = ExportedController(robot, folder)
                measured = done.measured
                assert measured is not None, "there is no C compiler"
                assert measured.agrees, measured.said
                assert measured.step is not None
                theirs = simulate(plant, exported, reference, 8.0, progress=False)
                apart = float(np.abs(theirs["q"] - ours["q"]).max())
                saturated = "" if measured.saturated is None else f"{measured.saturated:.0f}"
                print(
                    f"| {name} (n = {robot.n}) | {label} | {real} | {done.state_bytes} "
                    f"| {sum(done.code.typical):,}, {sum(done.code.worst_case):,} | {measured.step:.0f} "
                    f"| {saturated} | {measured.difference:.1e} | {apart:.1e} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
