"""What runs a prepared loop besides NumPy: a name -> what is loaded when it is asked for.

A backend lies above the loop that it runs, so it is named here, and not imported.
"""

from __future__ import annotations

from contextlib import suppress
from importlib import import_module
from typing import Any

from armgpi.errors import ArmgpiError
from armgpi.references.batch import ReferenceBatch
from armgpi.references.following import Setpoints
from armgpi.references.reference import Reference

#: Name of a backend -> its module and class, and what tells whether it is worth its while.
_LOADED = {"compiled": ("armgpi.codegen.run", "CompiledRun", "armgpi.codegen.build")}
#: Names that a run may ask for; "auto" is the faster one.
BACKENDS = ("numpy", *_LOADED, "auto")

#: What a sample of a stream of poses takes in Python, and from what time on generated code is worth it [s].
_STREAM_SAMPLE, _STREAM_WORTH = 25e-6, 0.5


def sample_streams(reference: Reference, seconds: float, backend: str) -> None:
    """Work out the samples of streams of poses in a reference by generated code, where that is worth it.

    Without what generates code they stay as they are: Python works them out as they are asked for.

    Args:
        reference: any; a batch is gone through.
        seconds: how far [s].
        backend: what was asked for, of :data:`BACKENDS`.
    """
    parts = reference.references if isinstance(reference, ReferenceBatch) else (reference,)
    streams = {id(part): part for part in parts if isinstance(part, Setpoints)}
    spent = sum(seconds / part.follower.dt * _STREAM_SAMPLE for part in streams.values())
    if streams and (backend == "compiled" or (backend == "auto" and spent > _STREAM_WORTH)):
        with suppress(ArmgpiError, ImportError):
            import_module("armgpi.codegen.following").sample_streams(reference, seconds)


def runner(name: str, joints: int, patience: float) -> Any:
    """Return the class that runs a loop by a backend.

    Args:
        name: of the backend.
        joints: of the arm.
        patience: how long it may take until there is code [s].

    Raises:
        BackendError: when there is none, or it takes longer.
        MissingPackage: when what it needs is not installed.
    """
    module, kind, build = _LOADED[name]
    found = import_module(build)
    if found.none_known():  # then nothing of what generates code has to be imported
        found.check_patience(joints, patience)
    return getattr(import_module(module), kind)
