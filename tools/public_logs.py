"""Identify real arms from further public logs, and run the controllers made from them.

Nothing of the logs is here: clone a repository yourself, and name the log and the folder.

    git clone https://github.com/thanhndv212/figaroh-examples        # Apache-2.0, by the files' headers
    python tools/public_logs.py tx40 figaroh-examples
    python tools/public_logs.py tiago figaroh-examples
    git clone https://github.com/YanjunLIU-ac/Dynamic_Parameter_Identification_for_Rokae_xMate  # no licence
    python tools/public_logs.py xmate Dynamic_Parameter_Identification_for_Rokae_xMate
    git clone https://github.com/unisa-acg/inverse-dynamics-solver   # BSD-3-Clause
    python tools/public_logs.py ur10 inverse-dynamics-solver
    python tools/public_logs.py panda30 inverse-dynamics-solver

tx40
    Staubli TX40, 9 s at 5 kHz: currents of the motors times gear ratios. Motor 6 turns with joint 5 as well.
    The masses of its URDF are invented; rotors and friction that the makers of the log found are printed.
tiago
    PAL's TIAGo, 59 s at 100 Hz: currents times the constants that the repository names.
xmate
    Rokae xMate3 Pro, 20 s at 1 kHz: sensors of joint torque. There is no URDF: the lengths are those of the
    table in the repository's scripts, and bodies are assumed. This log was set aside: nothing was chosen on
    it.
ur10
    Universal Robots UR10, 28 s at 125 Hz: torques by the currents of the motors (Petrone, Ferrentino and
    Chiacchio 2025). It was set aside as well: nothing was chosen on it.
panda30
    Panda, 24 s at 30 Hz: sensors of joint torque, without a load.

The first part of a log is fitted, the rest judges. `--control MOVES` is described in
tools/identified_control.py.
"""

from __future__ import annotations

import argparse
import re
import sqlite3
import struct
import warnings
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np
from identified_control import control
from panda_log import FINGERS, least_squares, part

import armgpi
from armgpi.base.arrays import Array
from armgpi.errors import UnfitLog
from armgpi.identification.arm import Identified, identify
from armgpi.identification.logs import Log
from armgpi.robot.repairs import SUPPOSE
from armgpi.robot.rotors import SCATTER, typical_inertia
from armgpi.validation import denavit

#: Gear ratios of the TX40 and its sample time [s], as its configuration there says, and the inertia of its
#: last link, which the file has as zero [kg m^2].
TX40_RATIOS, TX40_DT, TX40_LAST = (32.0, 32.0, 45.0, -48.0, 45.0, 32.0), 2e-4, 1e-4
#: What the makers of that log found: rotors [kg m^2], viscous [N m s/rad] and Coulomb friction [N m].
TX40_FOUND = {
    "rotor": (0.362, 0.362, 0.0988, 0.0313, 0.0468, 0.0105),
    "viscous": (8.05, 5.53, 1.97, 1.11, 1.86, 0.65),
    "coulomb": (7.14, 8.26, 6.34, 2.48, 3.03, 0.282),
}
#: Torque at the joint for a current of TIAGo's arm [N m/A], and rows in which it moves.
TIAGO_CONSTANTS, TIAGO_ROWS = (13.6, 13.6, -8.7, -8.7, -20.6, -20.6, -20.6), slice(921, 6791)
#: Distances along the axes of the xMate [m], its twists [quarter turns], and the rate of its log [Hz].
XMATE_D, XMATE_ALPHA = (0.3415, 0.0, 0.394, 0.0, 0.366, 0.0, 0.2503), (0, -1, 1, -1, 1, -1, 1)
XMATE_RATE = 1000.0


class PublicLog(NamedTuple):
    """A log, its arm and what its torques are.

    Attributes:
        robot: the arm by its file.
        log: of all that is there.
        torque: what the torques are; None leaves that to be recognised.
        fitted: share of the log that is fitted.
    """

    robot: armgpi.Robot
    log: Log
    torque: str | None
    fitted: float = 0.6


def table(path: Path, skip: int = 1) -> Array:
    """Return the numbers of a file.

    Raises:
        SystemExit: when it is not there.
    """
    if not path.is_file():
        raise SystemExit(f"{path}: is not there; the first lines of this tool say what to clone")
    lines = path.read_text(encoding="ascii").splitlines()[skip:]
    return np.loadtxt(lines, delimiter="," if "," in lines[0] else None)


def tx40(folder: Path) -> PublicLog:
    """Return the log of the TX40."""
    place = folder / "examples" / "staubli_TX40"
    motors, currents = (table(place / "data" / f"{name}.csv") for name in ("pos_read_data", "curr_data"))
    ratios = np.diag(TX40_RATIOS)
    ratios[5, 4] = TX40_RATIOS[5]  # motor 6 turns with joint 5
    q = motors @ np.linalg.inv(ratios).T + np.array([0.0, -0.5, 0.5, 0.0, 0.0, 0.0]) * np.pi
    text = (place / "urdf" / "tx40_mdh_modified.urdf").read_text(encoding="utf-8")
    last = " ".join(f'{name}="{TX40_LAST if name[1] == name[2] else 0.0}"' for name in MOMENTS)
    text = re.sub(r'<inertia ixx="0.000"[^>]*izz="0.000"/>', f"<inertia {last}/>", text)
    log = Log(TX40_DT * np.arange(len(q)), q, currents @ ratios, "tx40")
    return PublicLog(without_published(armgpi.Robot.from_xml(text)), log, "motor")


def without_published(robot: armgpi.Robot) -> armgpi.Robot:
    """Return an arm of whose published drives the fit knows nothing: they were found in this very log."""
    names, none = robot.joint_names, dict.fromkeys(robot.joint_names, 0.0)
    rotors = dict(zip(names, typical_inertia(robot).tolist(), strict=True))
    low, high = ({name: factor * x for name, x in rotors.items()} for factor in (1.0 / SCATTER, SCATTER))
    drives = robot.drives.with_value("rotor_inertia", rotors, low, high, source="assumed")
    for quantity in ("viscous", "coulomb"):
        drives = drives.with_value(quantity, none, source="assumed")
    return robot.with_drives(drives)


def tiago(folder: Path) -> PublicLog:
    """Return the log of TIAGo's arm."""
    place = folder / "examples" / "tiago"
    position, effort = (
        table(place / "data" / "identification" / "dynamic" / f"tiago_{name}.csv")[TIAGO_ROWS]
        for name in ("position", "effort")
    )
    joints = [f"arm_{k}_joint" for k in range(1, 8)]
    robot = armgpi.Robot.load(place / "urdf" / "tiago_48_schunk.urdf", keep=joints)
    t, tau = position[:, 0] - position[0, 0], effort[:, 2:] * np.array(TIAGO_CONSTANTS)
    return PublicLog(robot, Log(t, position[:, 2:], tau, "tiago"), "motor")


def xmate(folder: Path) -> PublicLog:
    """Return the log of the xMate, by its sensors of joint torque."""
    place = folder / "filtering" / "data" / "excit"
    q, tau = (table(place / f"excit_{name}_record.txt", skip=0) for name in ("ang", "torque"))
    rows = [
        denavit.Row(0.0, 0.5 * np.pi * twist, d, 0.0, 1.0, np.zeros(3), 0.01 * np.eye(3), False, f"joint{k}")
        for k, (d, twist) in enumerate(zip(XMATE_D, XMATE_ALPHA, strict=True), start=1)
    ]
    text = re.sub(r"<inertial>.*?</inertial>", "", denavit.from_table(rows, "modified").urdf, flags=re.DOTALL)
    robot = armgpi.Robot.from_xml(text, repair=SUPPOSE)
    return PublicLog(robot, Log(np.arange(len(q)) / XMATE_RATE, q, tau, "xmate"), "joint")


def bag(path: Path, robot: armgpi.Robot) -> Log:
    """Return the joint states of a ROS 2 bag (SQLite), in the order of an arm's joints.

    Raises:
        SystemExit: when it is not there.
    """
    if not path.is_file():
        raise SystemExit(f"{path}: is not there; the first lines of this tool say what to clone")
    with closing(sqlite3.connect(path)) as base:
        messages = base.execute("select timestamp, data from messages order by timestamp").fetchall()
    states = [joint_state(content) for _, content in messages]
    names = states[0].names
    order = [next(k for k, name in enumerate(names) if alike(name, joint)) for joint in robot.joint_names]
    t = 1e-9 * np.array([stamp - messages[0][0] for stamp, _ in messages], dtype=np.float64)
    q, tau = (np.array([getattr(state, key) for state in states])[:, order] for key in ("q", "tau"))
    new = np.append(True, np.diff(t) > 0.0)
    return Log(t[new], q[new], tau[new], path.stem)


def alike(name: str, joint: str) -> bool:
    """Tell whether a name is that of a joint, or has the same number at its end behind another prefix."""
    return name == joint or (name[-1].isdigit() and joint[-1].isdigit() and name[-1] == joint[-1])


class JointState(NamedTuple):
    """A message of ROS 2's sensor_msgs/msg/JointState.

    Attributes:
        names: of the joints.
        q: positions [rad], (n,).
        tau: efforts, (n,).
    """

    names: tuple[str, ...]
    q: Array
    tau: Array


def joint_state(content: bytes) -> JointState:
    """Return a joint state of its little-endian CDR: header, names, positions, velocities, efforts."""
    body = content[4:]  # what is aligned begins behind the four bytes that name the encoding
    place = 8  # seconds and nanoseconds

    def number() -> int:
        nonlocal place
        place = -(-place // 4) * 4 + 4
        return int(struct.unpack_from("<I", body, place - 4)[0])

    def text() -> str:
        nonlocal place
        size = number()
        place += size
        return body[place - size : place - 1].decode()

    def column() -> Array:
        nonlocal place
        size = number()
        place = -(-place // 8) * 8 + 8 * size
        return np.frombuffer(body[place - 8 * size : place], "<f8").astype(np.float64)

    text()  # the frame
    names = tuple(text() for _ in range(number()))
    q, _, tau = column(), column(), column()
    return JointState(names, q, tau)


def ur10(folder: Path) -> PublicLog:
    """Return the log of the UR10."""
    robot = armgpi.Robot.load("ur10")
    place = folder / "ur10_inverse_dynamics_solver" / "bagfiles" / "ur10_exciting_trajectory.db3"
    return PublicLog(robot, bag(place, robot), "motor")


def panda30(folder: Path) -> PublicLog:
    """Return the log of the Panda at 30 Hz."""
    robot = armgpi.Robot.load("panda", lock=FINGERS)
    place = folder / "franka_inria_inverse_dynamics_solver" / "bagfiles" / "panda_exciting_trajectory.db3"
    return PublicLog(robot, bag(place, robot), "joint")


#: Names of moments of inertia in a URDF.
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
#: The logs by name.
LOGS: dict[str, Callable[[Path], PublicLog]] = {
    "tx40": tx40,
    "tiago": tiago,
    "xmate": xmate,
    "ur10": ur10,
    "panda30": panda30,
}


def show_found(found: Identified) -> None:
    """Print rotors and friction beside those that the makers of the TX40's log found."""
    print("| joint | rotor [kg m²] | theirs | viscous [N m s/rad] | theirs | Coulomb [N m] | theirs |")
    print("|---|---|---|---|---|---|---|")
    rows = {(row.joint, row.quantity): row for row in found.table()}
    for k, joint in enumerate(found.robot.joint_names):
        cells = []
        for quantity, theirs in TX40_FOUND.items():
            row = rows[joint, quantity]
            cells.append(f"{row.value:.3g} [{row.lower:.3g}, {row.upper:.3g}] | {theirs[k]:.3g}")
        print(f"| {joint} | {' | '.join(cells)} |")


def residual_table(name: str, shares: Mapping[str, Array]) -> list[str]:
    """Return the lines of a Markdown table of residuals over torque [%].

    Args:
        name: of the log.
        shares: what predicts the torques -> residual over torque of each joint, (n,).
    """
    joints = len(next(iter(shares.values())))
    numbers = " | ".join(str(joint + 1) for joint in range(joints))
    lines = [f"| residual over torque [%], {name} | {numbers} | median |", "|---" * (joints + 2) + "|"]
    for label, residuals in shares.items():
        cells = " | ".join(f"{100.0 * x:.2g}" for x in residuals)
        lines.append(f"| {label} | {cells} | {100.0 * float(np.median(residuals)):.2g} |")
    return lines


def fit(given: PublicLog, name: str) -> Identified:
    """Return the fit of the first part of a log, and print residuals over torque on the rest.

    A log that is refused is fitted nevertheless, after the refusal.
    """
    end = given.fitted * float(given.log.t[-1])
    fitted, judged = part(given.log, 0.0, end), part(given.log, end, float(given.log.t[-1]))
    try:
        found = identify(fitted, given.robot, torque=given.torque)
    except UnfitLog as error:
        print(f"refused: {error}")
        if "expected at least" in str(error):  # too slow for anything
            raise SystemExit(1) from None
        found = identify(fitted, given.robot, torque=given.torque, check_first=False)
    for each in found.findings:
        print(each)
    plain, impossible = least_squares(given.robot, fitted, judged)
    print(f"{end:.3g} s are fitted; plain least squares: {impossible} of {given.robot.n} bodies impossible")
    both = found.validate(judged)
    shares = {"file": both.file, "identified": both.identified, "least squares": plain}
    print("\n".join(residual_table(name, shares)))
    print(f"rotors: {', '.join(found.drives.sources('rotor_inertia'))}")
    return found


def main() -> None:
    """Print residuals over torque on the part that was set aside."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name", choices=LOGS, help="the log")
    parser.add_argument("folder", type=Path, help="the clone")
    parser.add_argument("--control", type=int, default=0, metavar="MOVES", help="moves that are run")
    parser.add_argument("--elastic", action="store_true", help="these arms have elastic joints")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    public = LOGS[given.name](given.folder)
    found = fit(public, given.name)
    if given.name == "tx40":
        show_found(found)
    if given.control:
        control(found, given.control, elastic=given.elastic)


if __name__ == "__main__":
    main()
