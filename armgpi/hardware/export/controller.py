"""Exported code as a controller, so that it runs in a simulation as it will on the hardware."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from armgpi.base import files
from armgpi.base.arrays import LARGEST, check_path, check_type, check_whole
from armgpi.codegen import build
from armgpi.control.controller import Controller, ControlStep, FullState, Measurement
from armgpi.errors import BackendError, ParameterError
from armgpi.hardware.export.names import check_name, plain, rename
from armgpi.references.reference import Target
from armgpi.robot.robot import Robot
from armgpi.supervisor import FaultReport

#: As the Makefile compiles. No fused multiply-add, so that every machine gives the same bits.
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared")
HEADER, SOURCE = "armgpi_controller.h", "armgpi_controller.c"
#: What a step is given, with the bit that says so; see `armgpi_info.inputs`.
_ARGUMENTS = (("q_measured", 0), ("v_measured", 1), ("q_ref", 0), ("v_ref", 2), ("a_ref", 4))

#: Largest size of an exported source [bytes].
_MOST_BYTES = 64 * 1024 * 1024


class _Info(ctypes.Structure):
    """What the code was made for: `armgpi_info`."""

    _fields_: ClassVar = [
        ("abi", ctypes.c_uint32),
        ("layout", ctypes.c_uint32),
        ("n", ctypes.c_uint32),
        ("real_bytes", ctypes.c_uint32),
        ("state_bytes", ctypes.c_uint32),
        ("inputs", ctypes.c_uint32),
        ("dt", ctypes.c_double),
        ("joints", ctypes.POINTER(ctypes.c_char_p)),
        ("effort", ctypes.c_void_p),
    ]


class ExportedController(Controller):
    """A controller that was exported as C, compiled here, for one rollout.

    Its state is the C struct, as bytes. It handles faults as the exported code does: check :meth:`report`.

    Attributes:
        state_bytes: size of its state.
        real: "double" or "float".
    """

    def __init__(self, robot: Robot, folder: str | Path, name: str | None = None) -> None:
        """Compile what ``armgpi export`` wrote to a folder.

        Args:
            robot: the robot that it was exported for.
            folder: where armgpi_controller.h and .c are.
            name: the one that it was exported by, when it was by another (`--name`).

        Raises:
            BackendError: when there is no compiler, or the folder holds no exported controller.
            ParameterError: when it is for other joints, or the name is not one of C.
        """
        check_name(name)
        check_type(robot, "robot", Robot, "a single Robot")
        place = check_path(folder, "folder")
        texts = []
        for path in (place / rename(file, name) for file in (HEADER, SOURCE)):
            try:
                texts.append(files.read_text(path, _MOST_BYTES))
            except (OSError, ValueError) as error:
                reason = files.reason(error) if isinstance(error, OSError) else "no text"
                raise BackendError(f"{path}: cannot be read: {reason}") from None
        header, source = texts
        self._start(robot, header, source, name)

    @classmethod
    def of(cls, controller: Controller, real: str = "double", supervisor: Any = None) -> ExportedController:
        """Return a controller as it would be exported, without a folder.

        Args:
            controller: for a single rollout.
            real: number type in C, "double" or "float".
            supervisor: what is taken for a fault, an :class:`armgpi.Supervisor`.

        Raises:
            ParameterError: when an argument is not as it should be.
            BackendError: when the controller has no C, or there is no compiler.
        """
        from armgpi.hardware.export.code import generate

        code = generate(controller, real, supervisor)
        made = cls.__new__(cls)
        robot: Any = controller.robot
        made._start(robot, code.header, code.source)
        return made

    def _start(self, robot: Robot, header: str, source: str, name: str | None = None) -> None:
        """Compile it and check what it is for."""
        # One text, as the cache of libraries is keyed by one.
        whole = source.replace(rename(f'#include "{HEADER}"', name), header)
        self._library = build.library(whole, FLAGS)
        try:
            info = _Info.in_dll(self._library, rename("armgpi_info", name))
            wanted = ("armgpi_init", "armgpi_reset", "armgpi_step", "armgpi_step_late", "armgpi_within_rate")
            functions = [getattr(self._library, rename(function, name)) for function in wanted]
            self._init, self._reset, self._step, self._late, self._within = functions
        except (ValueError, AttributeError) as error:
            raise BackendError(f"this is no exported controller: {error}") from None
        for function in functions[:-1]:
            function.restype = ctypes.c_uint32
        self._within.restype = None
        # By name and order: another arm with as many joints would run, and break.
        names = [info.joints[j].decode() for j in range(info.n)]
        if names != [plain(name) for name in robot.joint_names]:
            joints = ", ".join(names)
            raise ParameterError("robot", ", ".join(robot.joint_names), f"one with the joints {joints}")
        self._dtype: Any
        self.real, self._dtype = ("float", np.float32) if info.real_bytes == 4 else ("double", np.float64)
        self.state_bytes = int(info.state_bytes)
        effort = (ctypes.c_byte * (info.n * info.real_bytes)).from_address(info.effort)
        limits = np.frombuffer(effort, self._dtype).astype(np.float64)
        largest = float(np.finfo(self._dtype).max)
        super().__init__(robot, float(info.dt), np.minimum(limits, LARGEST))
        self.keep("effort", np.where(limits < largest, limits, np.inf))
        self._given = [name for name, bit in _ARGUMENTS if bit & info.inputs == bit]
        # An attribute of the object, not of the class, as it is the library that says what it needs.
        self.measurement_type = FullState if info.inputs & 1 else Measurement  # type: ignore[misc]

    def init(self, measurement: Measurement | FullState, target: Target) -> npt.NDArray[np.uint64]:
        """Return the state before the first sample; see :meth:`Controller.init`."""
        # As 64-bit words, which aligns it for doubles.
        state = np.zeros(-(-self.state_bytes // 8), dtype=np.uint64)
        _, pointers = self._arguments(measurement, target)
        self._init(ctypes.c_void_p(state.ctypes.data), *pointers)
        return state

    def reset(
        self, measurement: Measurement | FullState, target: Target, state: npt.NDArray[np.uint64]
    ) -> npt.NDArray[np.uint64]:
        """Return the state of a start from where the arm is now; see :meth:`Supervised.reset`.

        Args:
            measurement: of this sample.
            target: of this sample.
            state: of the exported controller.

        Returns:
            The next state, an array of 64-bit words.
        """
        after = state.copy()
        _keep, pointers = self._arguments(measurement, target)
        self._reset(ctypes.c_void_p(after.ctypes.data), *pointers)
        return after

    def advance(
        self,
        measurement: Measurement | FullState,
        target: Target,
        state: npt.NDArray[np.uint64],
        elapsed: int = 1,
    ) -> ControlStep:
        """Return torque and next state for a sample that comes late; see :meth:`Supervised.advance`."""
        elapsed = check_whole(elapsed, "elapsed", 1, 2**32 - 1)
        return self._call_step(self._late, measurement, target, state, ctypes.c_uint32(elapsed))

    def within_rate(self, applied: npt.ArrayLike, taken: ControlStep) -> ControlStep:
        """Return a step whose torque is within its rate of that of the robot; see :class:`Supervised`.

        Args:
            applied: torque that the robot applied in the sample before [N m or N], shape (n,).
            taken: the step, with its torque [N m or N] and state.
        """
        after = taken.state.copy()
        tau, given = (np.array(x, dtype=self._dtype) for x in (taken.tau, applied))
        self._within(*(ctypes.c_void_p(x.ctypes.data) for x in (after, given, tau)))
        return ControlStep(tau.astype(np.float64, copy=False), after)

    def step(
        self, measurement: Measurement | FullState, target: Target, state: npt.NDArray[np.uint64]
    ) -> ControlStep:
        """Return torque and next state; see :meth:`Controller.step`."""
        return self._call_step(self._step, measurement, target, state)

    def _call_step(
        self, function: Any, measurement: Any, target: Target, state: npt.NDArray[np.uint64], *first: Any
    ) -> ControlStep:
        """Return torque and next state by one of the functions of a step."""
        after = state.copy()  # C writes into it, and states here never change
        tau = np.empty(self.robot.n, dtype=self._dtype)
        _keep, pointers = self._arguments(measurement, target)
        function(ctypes.c_void_p(after.ctypes.data), *first, *pointers, ctypes.c_void_p(tau.ctypes.data))
        return ControlStep(tau.astype(np.float64, copy=False), after)

    def report(self, state: npt.NDArray[np.uint64]) -> FaultReport:
        """Return status, reason and joint of a state.

        Args:
            state: of the exported controller, as :meth:`step` returned it.
        """
        _, status, reason, joint = (int(x) for x in state.view(np.uint32)[:4])
        return FaultReport.of(status, reason, joint, self.robot.joint_names)

    def _arguments(
        self, measurement: Measurement | FullState, target: Target
    ) -> tuple[list[Any], list[ctypes.c_void_p]]:
        """Return the arguments that the code takes: arrays that have to be kept, and where they are."""
        values = {f"{x}_measured": y for x, y in measurement._asdict().items()}
        values.update({f"{x}_ref": y for x, y in target._asdict().items()})
        arrays = [np.ascontiguousarray(np.asarray(values[name]), dtype=self._dtype) for name in self._given]
        for name, array in zip(self._given, arrays, strict=True):
            if array.shape != (self.robot.n,):
                expected = f"of shape ({self.robot.n},): exported code controls one rollout"
                raise ParameterError(name, array.shape, expected)
        return arrays, [ctypes.c_void_p(array.ctypes.data) for array in arrays]

    def describe(self) -> dict[str, Any]:
        """Return the parameters as plain data."""
        return {
            **super().describe(),
            "real": self.real,
            "state_bytes": self.state_bytes,
            "robot": self.robot.provenance,
        }

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"ExportedController({self.robot.name!r}, dt={self.dt:g}, real={self.real!r})"
