"""The interfaces of robots that a controller is exported for: what each expects, adds itself and echoes.

One table, from which the targets take their numbers and the documentation its rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from armgpi.base.escape import markdown_table


class Interface(NamedTuple):
    """One interface of one kind of robot.

    Attributes:
        target: what `--target` calls it.
        robot: the robots, with the first release of their software.
        library: what talks to them, with its versions.
        joints: number of joints; None for any.
        dt: sample time [s]; None for any.
        rate: highest rate of torque that it takes [N m/s]; None where none is stated.
        delays: samples from a measurement to its torque, beyond the sample itself: usual, and at most.
        adds: what the robot adds to the torque by itself, "gravity" or "friction".
        echo: where it says which torque it applies; "" where it does not.
        late: by what a packet that comes once more is recognised.
        tried: what was compiled or simulated here, and against what. None was tried on hardware.
        summary: what `--help` says of the target.
        files: templates of its own -> where they go in the export.
        positions: side of the joints -> what the interface calls their positions there; the first one is read
            where nothing else is specified. None where nothing tells the side.
    """

    target: str
    robot: str
    library: str
    joints: int | None
    dt: float | None
    rate: float | None
    delays: tuple[int, int]
    adds: tuple[str, ...]
    echo: str
    late: str
    tried: str
    summary: str
    files: Mapping[str, str] = {}
    positions: Mapping[str, str] = {}

    def sides(self, specified: Sequence[str]) -> list[str]:
        """Return the different sides at which the encoders of joints sit, for an interface with `positions`.

        Args:
            specified: the side of each joint; "" where none was specified, which is the interface's usual.
        """
        usual = next(iter(self.positions))
        return list(dict.fromkeys(side or usual for side in specified))


#: Versions by libfranka's changelog and by the scripts that the two clients of UR send to the robot: ur_rtde
#: 1.6.5 has direct_torque from 5.26 on, with friction scales, which PolyScope X has from 10.12.1 on;
#: external_control.urscript of the client library has it from 5.23.0 and 10.11.0 on, with friction scales
#: from 5.25.1 and 10.12.1 on. The rate is libfranka's kMaxTorqueRate, "without gravity and friction" its
#: franka::Torques. Delays are set by hand, for robots that nobody has measured: automatic tuning,
#: tools/faults.py and tools/bringup.py take them. The sides are those of robot_state.h: `q` is the "measured
#: joint position", and `theta` the "motor position". Nothing that UR or ros2_control publish was found to say
#: the side of their positions.
_FR3 = Interface(
    target="fci",
    robot="Franka Research 3, system 5.7.2",
    library="libfranka 0.15 and later (C++17), pylibfranka 0.16",
    joints=7,
    dt=1e-3,
    rate=1000.0,
    delays=(0, 1),
    adds=("gravity", "friction"),
    echo="tau_J_d",
    late="the period",
    tried="compiled with libfranka 0.15.0 and 0.21.2; simulated with stubs",
    summary="callbacks for libfranka",
    files={name: name for name in ("fci.hpp", "fci.cpp", "fci.py", "goals.hpp", "goals.py")},
    positions={"link": "q", "motor": "theta"},
)
_UR = Interface(
    target="ur",
    robot="UR e-Series, UR20, UR30: PolyScope 5.26 or 10.12.1; not CB3",
    library="ur_rtde 1.6.5 (Python)",
    joints=6,
    dt=2e-3,
    rate=None,
    delays=(2, 3),
    adds=("gravity",),
    echo="",
    late="the timestamp",
    tried="simulated with stubs",
    summary="a loop for RTDE",
    files={name: name for name in ("ur.hpp", "ur.cpp", "ur.py", "goals.hpp", "goals.py")},
)
#: Of each target the newest robot first. A new target is a row here, and its templates.
INTERFACES = (
    Interface(
        target="bare",
        robot="any",
        library="none (C99)",
        joints=None,
        dt=None,
        rate=None,
        delays=(0, 0),
        adds=(),
        echo="",
        late="the caller",
        tried="compiled, simulated",
        summary="nothing",
    ),
    _FR3,
    _FR3._replace(
        robot="Panda (FER), system 4.2.1",
        library="libfranka 0.9 alone (C++17), no pylibfranka",
        tried="compiled with libfranka 0.9.2; simulated with stubs",
    ),
    _UR,
    _UR._replace(
        robot="UR e-Series, UR20, UR30: PolyScope 5.25.1 or 10.12.1; not CB3",
        library="UR client library 2.8 and later (C++17)",
        tried="compiled with 2.8.0 and 2.14.0; simulated with stubs",
    ),
    Interface(
        target="ros2_control",
        robot="any with effort commands",
        library="ros2_control 4.27 to 6.8 (C++17): Jazzy, Kilted, Rolling; not Humble",
        joints=None,
        dt=None,
        rate=None,
        delays=(0, 1),
        adds=(),
        echo="",
        late="positions that are equal to the bit in all joints",
        tried="compiled with stubs, compared with 4.27.0, 4.46.0, 5.16.0, 6.0.0, 6.8.0",
        summary="a plugin",
        files={  # as ros2_controllers have them
            "ros2_control.hpp": "include/armgpi_controller/ros2_control.hpp",
            "ros2_control.cpp": "src/ros2_control.cpp",
            "ros2_parameters.yaml": "src/armgpi_controller_parameters.yaml",
            "ros2_test_load.cpp": "test/test_load.cpp",
            "ros2_colcon.yml": ".github/workflows/colcon.yml",
            "ros2_plugin.xml": "ros2_plugin.xml",
            "package.xml": "package.xml",
        },
    ),
)
#: Target -> its newest interface; what `--target` may be, in the order in which messages list it.
TARGETS: dict[str, Interface] = {}
for _interface in INTERFACES:
    TARGETS.setdefault(_interface.target, _interface)
#: Target -> the interface whose robot adds gravity itself.
COMPENSATING = {name: each for name, each in TARGETS.items() if "gravity" in each.adds}


def choices() -> str:
    """Return what `--help` says of the targets: "nothing (bare, the default), callbacks ... (fci) or ..."."""
    texts = []
    for name, interface in TARGETS.items():
        default = ", the default" if name == "bare" else ""
        texts.append(f"{interface.summary} ({name}{default})")
    return f"{', '.join(texts[:-1])} or {texts[-1]}"


def table() -> str:
    """Return the table as Markdown: numbers in columns, and what needs words in a list below."""
    head = (
        *("target", "robot", "joints", "sample time [s]", "torque rate [N m/s]", "delay [samples]"),
        *("compensates", "echo of the torque"),
    )
    rows = [
        (
            *(f"`{each.target}`", _models(each), str(each.joints or "any")),
            "any" if each.dt is None else f"{each.dt:g}",
            "not stated" if each.rate is None else f"{each.rate:g}",
            "yours" if each.target == "bare" else "{} to {}".format(*each.delays),
            *(" and ".join(each.adds) or "nothing", f"`{each.echo}`" if each.echo else "none"),
        )
        for each in INTERFACES
    ]
    lines = [
        f"- **`{each.target}`** for {each.robot}. Library: {each.library}. Repeated packets are recognised "
        f"by {each.late}. Tried: {each.tried}."
        for each in INTERFACES
    ]
    return "\n".join([markdown_table(head, rows), *lines, ""])


def _models(interface: Interface) -> str:
    """Return the robots of an interface without the releases of their software."""
    return interface.robot.partition(":")[0].partition(", system")[0]
