"""One verb, `simulate`: a closed loop run to its end, one rollout or a batch of them."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np

from armgpi.base.arrays import ArrayLike
from armgpi.base.hints import with_keyword_hints
from armgpi.control.controller import Controller
from armgpi.errors import ParameterError
from armgpi.loop.prepared import prepare
from armgpi.loop.runner import DIVERGENCE
from armgpi.plants.plant import Plant
from armgpi.references.reference import Reference
from armgpi.supervisor import Supervisor

if TYPE_CHECKING:
    import xarray as xr


#: Time after the end of a reference that is simulated by default [s], as `armgpi run` does.
_SETTLE = 2.0


def _default_end(reference: Reference) -> float:
    """Return when a run ends that has no `t_final`: some time after its motion [s]."""
    if not hasattr(reference, "at"):
        expected = "a Reference, such as armgpi.Bezier(start, goal, duration) or armgpi.Hold(q)"
        raise ParameterError("reference", reference, expected)
    end = getattr(reference, "t_end", None)
    if end is None and hasattr(reference, "duration"):
        end = np.max(np.asarray(reference.duration) + np.asarray(getattr(reference, "t_start", 0.0)))
    if end is None or not np.isfinite(end):
        raise ParameterError("t_final", None, "a time [s], as this reference has no end")
    return float(end) + _SETTLE


@with_keyword_hints
def simulate(
    plant: Plant,
    controller: Controller,
    reference: Reference,
    t_final: float | None = None,
    *,
    q0: ArrayLike | None = None,
    v0: ArrayLike | None = None,
    record: str | Sequence[str] = "all",
    record_every: int = 1,
    dtype: str = "float64",
    file: str | PathLike[str] | None = None,
    signals: bool = False,
    divergence: float = DIVERGENCE,
    progress: bool | None = None,
    backend: str = "numpy",
    supervisor: Supervisor | None = None,
    partial: bool = False,
) -> xr.Dataset:
    """Run a closed loop and return its rollout.

    Args:
        plant: what moves.
        controller: what moves it; its sample time is the loop's.
        reference: where to.
        t_final: how long [s], rounded to whole samples; by default to 2 s after the end of the reference.
        q0: starting positions [rad or m], (n,) or (batch, n); the reference's start when not given.
        v0: starting velocities [rad/s or m/s], zero when not given.
        record: "all" trajectories, or names of those to keep, such as ("q", "tau").
        record_every: record every so many samples.
        dtype: of recorded numbers: "float64", or "float32" for half the memory and seven digits.
        file: NetCDF file that trajectories are written to as they come, for more than fit into memory;
            the dataset, dimensions (time, [rollout], joint), then reads from it what it is asked for.
        signals: record the controller's inner signals as well.
        divergence: a rollout has diverged when a joint is farther than this from its reference
            [rad or m], or when a velocity or torque is not finite.
        progress: show a progress bar; when not given, on a terminal and for long runs.
        backend: "numpy"; "compiled" for generated code (see :mod:`armgpi.codegen`), with a warning and NumPy
            where there can be none; "auto" for generated code where it saves more time than it takes to be
            there: little where it was compiled before, some tenths of a second otherwise.
        supervisor: puts the controller under a supervisor, see :mod:`armgpi.supervisor`. A rollout
            with a fault has the status "stopped", the time of its fault, and what the arm did afterwards.
        partial: on Ctrl-C return what is there, with the status "interrupted", in place of the exception.

    Returns:
        A dataset with the dimensions time, joint and, for a batch, rollout: see :mod:`armgpi.loop.rollout`. A
        rollout that diverges is NaN from then on and says when; the others go on.

    Raises:
        ParameterError: when an argument is not as it should be, or the parts do not match.
        ArrayError: when an array is not as it should be.
        LimitError: when the start or the reference is outside the plant's joint limits.
        RolloutError: when the recording does not fit into memory, or onto the disk of its file.
        KeyboardInterrupt: on Ctrl-C, unless `partial`.
    """
    loop = prepare(
        plant,
        controller,
        reference,
        _default_end(reference) if t_final is None else t_final,
        record=record,
        record_every=record_every,
        dtype=dtype,
        signals=signals,
        divergence=divergence,
        backend=backend,
        supervisor=supervisor,
    )
    return loop.run(q0=q0, v0=v0, progress=progress, partial=partial, file=file)
