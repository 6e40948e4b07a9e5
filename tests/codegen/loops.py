"""Closed loops by NumPy and by generated code, and how far apart they are.

The two take the same steps with other roundings, 1e-16 of the numbers. Where every sample closes the loop,
what they differ by stays of that size. An encoder opens the loop below one count: there rounding grows as the
arm under constant torque makes it grow, e-fold in as little as 50 ms, until a position crosses an edge
between two counts one sample earlier in one run than in the other. From then on the runs are two rollouts of
the same loop that agree to some counts. So positions are compared up to the first sample at which a
measured number differs. There one run is on each side of the same edge, so both are as near to it as they are
to each other: nothing but rounding has moved the crossing. NumPy does the
same when it is started one unit in the last place away: it is 1.6e-6 rad apart before an edge after 2 s of
icub_left_arm, where generated code is 1.4e-6.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import pytest
import xarray as xr

from armgpi import ArmgpiWarning, simulate
from armgpi.codegen import build

#: Numbers that one sample of a rollout leaves behind.
SAMPLED = ("q", "v", "q_ref", "v_ref", "q_measured", "tau_command", "tau")


class Agreement(NamedTuple):
    """How far two rollouts of a loop are apart.

    Attributes:
        before: largest difference of positions [rad or m] while all measured positions are the same; over
            all samples where there are no counts.
        crossings: number of rollouts in which an edge was crossed at different samples.
        counts: by how many counts measured positions differ at that sample, at most: 1 for an edge.
        after: largest difference of positions [rad or m] from then on, zero without a crossing.
    """

    before: float
    crossings: int
    counts: float
    after: float


@contextmanager
def machine(lanes: int | None = None, threads: int = 1) -> Iterator[None]:
    """Pretend that this machine works on so many numbers at once, with so many cores."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OMP_NUM_THREADS", str(threads))
        if lanes is not None:
            patch.setattr(build, "widest", lambda: lanes)
        yield


def compiled(*arguments: Any, lanes: int | None = None, threads: int = 1, **options: Any) -> xr.Dataset:
    """Run a loop by generated code; a warning that NumPy ran it instead is an error."""
    with machine(lanes, threads), warnings.catch_warnings():
        warnings.filterwarnings("error", message="running by NumPy", category=ArmgpiWarning)
        return simulate(*arguments, progress=False, backend="compiled", **options)


def agreement(one: xr.Dataset, other: xr.Dataset, step_size: Any = None) -> Agreement:
    """Compare two rollouts of one loop; `step_size` is an encoder's count [rad or m], None without one."""
    q, q2, seen, seen2 = (
        np.atleast_3d(run[name].transpose("time", "joint", ...).values)
        for name in ("q", "q_measured")
        for run in (one, other)
    )
    # What has diverged is NaN, in both.
    apart = np.where(np.isnan(q) & np.isnan(q2), 0.0, np.abs(q - q2))
    apart[np.isnan(apart)] = np.inf
    if step_size is None:
        return Agreement(float(apart.max()), 0, 0.0, 0.0)
    size = np.broadcast_to(step_size, (*one["status"].shape, q.shape[1])).T.reshape(q.shape[1], -1)
    counts = np.nan_to_num(np.rint(np.abs(seen - seen2) / size))
    differs = (counts > 0.0).any(axis=1)  # (time, rollout)
    crossed = differs.any(axis=0)
    first = np.where(crossed, differs.argmax(axis=0), len(q) - 1)
    # A measurement has no effect before the sample after it.
    before = np.arange(len(q))[:, None] <= first
    at_first = counts[first, :, np.arange(len(first))]
    return Agreement(
        float(np.where(before[:, None], apart, 0.0).max()),
        int(crossed.sum()),
        float(at_first.max()),
        float(np.where(before[:, None], 0.0, apart).max()),
    )


def _provenance(run: xr.Dataset) -> dict[str, Any]:
    """Return what a rollout was made from, apart from what ran it."""
    return {**json.loads(run.attrs["provenance"]), "backend": None}


def assert_close(one: xr.Dataset, other: xr.Dataset, tolerance: float = 1e-11) -> None:
    """Check all of two rollouts: what is sampled to a tolerance relative to its size, the rest exactly."""
    assert list(one.data_vars) == list(other.data_vars)
    assert one.attrs | {"provenance": _provenance(one)} == other.attrs | {"provenance": _provenance(other)}
    for name in one.coords:
        xr.testing.assert_identical(one[name].variable, other[name].variable)
    for name in one.data_vars:
        a, b = one[name], other[name]
        if "time" in a.dims:
            assert (a.dims, a.attrs, a.dtype) == (b.dims, b.attrs, b.dtype), name
            np.testing.assert_array_equal(np.isnan(a.values), np.isnan(b.values), err_msg=str(name))
            size = max(1.0, float(np.nanmax(np.abs(a.values), initial=0.0)))
            if name in ("omega_c", "zeta_c", "p_c") or "_weight_" in str(name) or "activation_" in str(name):
                size *= 1e2  # a network's whole range is within 1e-4 rad of error: rounding grows 1e4-fold
            np.testing.assert_allclose(b.values, a.values, rtol=0, atol=tolerance * size, err_msg=str(name))
        else:
            xr.testing.assert_identical(a, b)
