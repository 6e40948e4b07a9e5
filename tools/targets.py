"""The arms that each target of `armgpi export` is tried with, by the numbers of its table of interfaces."""

from __future__ import annotations

from typing import Any

from armgpi.hardware.export.interfaces import TARGETS

#: Target -> arm -> joints that are locked.
ARMS: dict[str, dict[str, list[str]]] = {
    "fci": {"panda": ["panda_finger_joint1", "panda_finger_joint2"]},
    "ur": {"ur5": []},
    "ros2_control": {"z1": ["jointGripper"]},
    "bare": {"anthropomorphic3": [], "ur5": [], "panda": ["panda_finger_joint1", "panda_finger_joint2"]},
}


def described(
    target: str, arm: str, bits: int, gravity: str | None = None, dt: float = 1e-3, side: str = ""
) -> dict[str, Any]:
    """Return an experiment file, as data, of what `armgpi export --target` writes of an arm.

    Args:
        target: of the controller.
        arm: one of :data:`ARMS`.
        bits: resolution of the encoders.
        gravity: who carries the weight where the target leaves it open; the controller when not given.
        dt: sample time where the target leaves it open [s].
        side: where the encoders are specified to sit; "" for nothing that is known.
    """
    expected = TARGETS[target]
    carried = "robot" if "gravity" in expected.adds else gravity or "arm"
    plant: dict[str, Any] = {"engine": "armgpi", "encoder_bits": bits, "delay": expected.delays[0]}
    robot: dict[str, Any] = {"name": arm, "lock": ARMS[target][arm], "gravity": carried}
    if side:  # elastic joints are assumed where nothing is said
        plant |= {"engine": "elastic", "encoder_side": side}
    else:
        robot["drives"] = "elastic"
    return {
        "robot": robot,
        "controllers": [{"type": "gpi_auto"}],
        "plant": plant,
        "sample_time": expected.dt or dt,
        "supervisor": {} if expected.rate is None else {"torque_rate": expected.rate},
    }
