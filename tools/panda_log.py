"""Identify a real Panda from a public log of its joint torque sensors, and run the controller made from it.

The log is that of github.com/marcocognetti/FrankaEmikaPandaDynModel (Gaz, Cognetti, Oliva, Robuffo Giordano,
De Luca, RA-L 2019; GPL-3.0): 20 s at some 1 kHz. Nothing of it is here: clone it yourself, and name the
folder.

    git clone https://github.com/marcocognetti/FrankaEmikaPandaDynModel
    python tools/panda_log.py FrankaEmikaPandaDynModel

The sensors are behind the gears, so there are no rotors in the log. `--control MOVES` runs random moves under
the controller made from the identified folder, on the identified bodies with rotors drawn within the interval
of those that are assumed; see tools/identified_control.py.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
from identified_control import control
from scipy import signal

import armgpi
from armgpi.base.arrays import Array
from armgpi.identification.arm import identify
from armgpi.identification.logs import Log

#: Where the log is in the clone, its joints, and the joints of the file that are no arm's.
PLACE, JOINTS = "matlab/data/Exciting_Traj/Trajectory_1/rbt_log/exciting_traj_{}.txt", 7
FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]
#: Of plain least squares: cutoff of the filter [Hz], samples left out at both ends, every which one is taken,
#: and width of the sign of velocity [rad/s].
CUTOFF, EDGE, THIN, SIGN_WIDTH = 5.0, 200, 20, 0.01


def read(folder: Path) -> Log:
    """Return the log."""
    t, q, tau = (np.loadtxt(folder / PLACE.format(name)) for name in ("time", "positions", "torques"))
    keep = np.append(True, np.diff(t) > 0.0)
    return Log(t[keep] - t[0], q.reshape(-1, JOINTS)[keep], tau.reshape(-1, JOINTS)[keep], "panda")


def part(log: Log, begin: float, end: float) -> Log:
    """Return the samples between two times."""
    own = (log.t >= begin) & (log.t < end)
    return Log(log.t[own] - begin, log.q[own], log.tau[own], log.source)


def least_squares(robot: armgpi.Robot, fitted: Log, judged: Log) -> tuple[Array, int]:
    """Return residuals over torques by weighted least squares, (n,), and how many bodies cannot be.

    Positions and torques behind a filter of 5 Hz, derivatives by differences; inertial parameters, friction
    and an offset of each joint by least squares, each joint weighted by its residual.
    """
    model = robot.pinocchio_model()
    data = model.createData()

    def regression(log: Log) -> tuple[Array, Array]:
        dt = float(np.median(np.diff(log.t)))
        t = np.arange(log.t[0], log.t[-1], dt)
        both = [np.stack([np.interp(t, log.t, x) for x in each.T], axis=-1) for each in (log.q, log.tau)]
        b, a = signal.butter(4, 2.0 * dt * CUTOFF)
        q, tau = (signal.filtfilt(b, a, each, axis=0) for each in both)
        v = np.gradient(q, dt, axis=0)
        moved = np.stack([q, v, np.gradient(v, dt, axis=0)], axis=1)[EDGE:-EDGE:THIN]
        rows = [
            np.hstack(
                [
                    pin.computeJointTorqueRegressor(model, data, *each),
                    np.diag(each[1]),
                    np.diag(np.tanh(each[1] / SIGN_WIDTH)),
                    np.eye(robot.n),
                ]
            )
            for each in moved
        ]
        return np.array(rows), tau[EDGE:-EDGE:THIN]

    rows, tau = regression(fitted)
    weights = np.ones(robot.n)
    for _ in range(3):
        weighted = (rows * weights[:, None]).reshape(-1, rows.shape[-1])
        unknowns = np.linalg.lstsq(weighted, (tau * weights).ravel(), rcond=1e-8)[0]
        weights = 1.0 / np.sqrt(((tau - rows @ unknowns) ** 2).mean(axis=0))
    rows, tau = regression(judged)
    shares = np.sqrt(((tau - rows @ unknowns) ** 2).sum(axis=0) / (tau**2).sum(axis=0))
    bodies = unknowns[: 10 * robot.n].reshape(robot.n, 10)
    least = [np.linalg.eigvalsh(pin.PseudoInertia.FromDynamicParameters(x).toMatrix())[0] for x in bodies]
    return shares, int((np.array(least) < 0.0).sum())


def main() -> None:
    """Print residuals over torques on the part that was set aside."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="the clone")
    parser.add_argument("--fitted", type=float, default=12.0, help="seconds that are fitted; the rest judges")
    parser.add_argument("--torque", choices=("motor", "joint", "commanded"), help="by default recognised")
    parser.add_argument("--control", type=int, default=0, metavar="MOVES", help="moves that are run")
    parser.add_argument("--elastic", action="store_true", help="these arms have elastic joints")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    robot, log = armgpi.Robot.load("panda", lock=FINGERS), read(given.folder)
    found = identify(part(log, 0.0, given.fitted), robot, torque=given.torque)
    judged = found.validate(part(log, given.fitted, float(log.t[-1])))
    for each in found.findings:
        print(each)
    print(f"torques: {found.torque}; rotors: {', '.join(found.drives.sources('rotor_inertia'))}")
    plain, impossible = least_squares(
        robot, part(log, 0.0, given.fitted), part(log, given.fitted, float(log.t[-1]))
    )
    print(f"plain weighted least squares: {impossible} of {robot.n} bodies are impossible")
    rows = {"the file": judged.file, "identified": judged.identified, "least squares": plain}
    for label, shares in rows.items():
        cells = " | ".join(f"{100.0 * x:.2g}" for x in shares)
        print(f"| {label} | {cells} | median {100.0 * float(np.median(shares)):.2g} |")
    if given.control:
        control(found, given.control, elastic=given.elastic)


if __name__ == "__main__":
    main()
