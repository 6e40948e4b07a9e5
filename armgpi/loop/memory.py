"""Where a recording's samples go: memory that runs of one loop use again, or a NetCDF file as they come."""

from __future__ import annotations

import errno
import math
import os
import shutil
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array

if TYPE_CHECKING:
    import xarray as xr

#: Arrays kept for the next run, at most: some more than a rollout has variables.
_KEPT = 16
#: A line of the cache [B]: generated code writes whole lines past it.
_LINE = 64


class Memory:
    """Arrays for one recording after the other.

    Memory that is fresh from the system costs a loop up to twice its time (``benchmarks/recording.py``), so
    what an earlier recording had is used again once no array is on it.

    Attributes:
        on_disk: whether there may be more of it than the machine has.
    """

    on_disk = False

    def __init__(self) -> None:
        """Begin without any."""
        self._free: deque[npt.NDArray[np.uint8]] = deque(maxlen=_KEPT)

    def array(self, name: str, shape: tuple[int, ...], dtype: npt.DTypeLike) -> Array:
        """Return an array of any numbers for a variable; it begins with a line of the cache.

        Raises:
            MemoryError: when there is not so much.
        """
        kind = np.dtype(dtype)
        size = math.prod(shape) * kind.itemsize
        return np.asarray(_Lease(size, self._free))[:size].view(kind).reshape(shape)


class NetCDF(Memory):
    """A NetCDF file, whose variables are mapped into memory: the system writes them out as they fill."""

    on_disk = True

    def __init__(self, path: Path) -> None:
        """Begin an empty file."""
        import h5netcdf

        self._path = path
        self._names: list[str] = []
        h5netcdf.File(path, "w").close()

    def array(self, name: str, shape: tuple[int, ...], dtype: npt.DTypeLike) -> Array:
        """Return the array of a variable in the file, dimensions (time, [rollout], joint).

        Raises:
            OSError: when the disk has no room for it.
        """
        import h5netcdf
        import h5py

        size = math.prod(shape) * np.dtype(dtype).itemsize
        if size > shutil.disk_usage(self._path.parent).free:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        whole = h5py.h5p.create(h5py.h5p.DATASET_CREATE)  # all of it has its place at once
        whole.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        whole.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
        dims = ("time", *(("rollout",) if len(shape) == 3 else ()), "joint")
        with h5netcdf.File(self._path, "a") as file:
            for dim, length in zip(dims, shape, strict=True):
                if dim not in file.dimensions:
                    file.dimensions[dim] = length
            begin = file.create_variable(name, dims, dtype, dcpl=whole)._h5ds.id.get_offset()
        if hasattr(os, "posix_fallocate"):  # or a full disk would end the process at a write
            with self._path.open("r+b") as opened:
                os.posix_fallocate(opened.fileno(), begin, size)
        self._names.append(name)
        return np.memmap(self._path, dtype, "r+", begin, shape)

    def finish(self, rollout: xr.Dataset) -> None:
        """Write all that is not in the file yet: what is no trajectory, and attributes."""
        import h5netcdf

        rollout.drop_vars(self._names).to_netcdf(self._path, mode="a", engine="h5netcdf")
        with h5netcdf.File(self._path, "a") as file:
            for name in self._names:
                file.variables[name].attrs.update(rollout[name].attrs)


class _Lease:
    """Bytes that are free again when the last array on them is gone."""

    def __init__(self, size: int, free: deque[npt.NDArray[np.uint8]]) -> None:
        """Take some that are free, or fresh ones."""
        self._free = free
        try:
            self._bytes = free.pop()
        except IndexError:
            self._bytes = _fresh(size)
        if len(self._bytes) != size:  # another batch, or another length
            free.clear()
            self._bytes = _fresh(size)
        self.__array_interface__ = self._bytes.__array_interface__

    def __del__(self) -> None:
        if hasattr(self, "_bytes"):
            self._free.append(self._bytes)


def _fresh(size: int) -> npt.NDArray[np.uint8]:
    room = np.empty(size + _LINE, dtype=np.uint8)
    begin = -room.ctypes.data % _LINE
    return room[begin : begin + size]
