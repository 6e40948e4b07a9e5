"""What runs a prepared loop besides NumPy: a name -> what is loaded when it is asked for.

A backend lies above the loop that it runs, so it is named here, and not imported.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

#: Name of a backend -> its module and class, and what tells whether it is worth its while.
_LOADED = {"compiled": ("armgpi.codegen.run", "CompiledRun", "armgpi.codegen.build")}
#: Names that a run may ask for; "auto" is the faster one.
BACKENDS = ("numpy", *_LOADED, "auto")


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
