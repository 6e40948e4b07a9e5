"""NetCDF files of strangers: what a file declares is checked before anything of it is loaded.

NetCDF 4 is HDF5, and a variable of an HDF5 file need not be in that file: external storage, links and virtual
datasets name other files, which would be copied into whatever is made of the file. A variable that is stored
nowhere costs nothing, and fills memory when it is read. Both are refused here, by the file's structure alone.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from armgpi.base import files

if TYPE_CHECKING:  # functions that need it import it: with pandas it takes twice as long as Pinocchio
    import xarray as xr

#: Most groups and variables of a file.
_MOST_OBJECTS = 10_000
#: Most texts of variable length in a variable, and most numbers of an attribute.
_MOST_TEXTS = 10_000
#: Least memory that a number takes when it is loaded, as NumPy and xarray decode it [bytes].
_NUMBER = 8
#: HDF5's numbers of the filters that are read: deflate, shuffle, Fletcher's checksum.
_FILTERS = (1, 2, 3)
#: Attributes by which NetCDF ties variables to dimensions: they refer to objects of the same file.
_TIES = ("DIMENSION_LIST", "REFERENCE_LIST")


class Refused(ValueError):
    """A file that is not loaded for what it declares; the text says why."""


def load(path: Path) -> xr.Dataset:
    """Return all of a NetCDF file, which holds its own numbers and no more than memory takes.

    Raises:
        OSError: when it cannot be read, or is no regular file.
        Refused: when a variable is elsewhere, of another kind than numbers and texts, or larger than the file
            can hold.
        Exception: whatever h5py and xarray raise for a damaged file.
    """
    import xarray as xr

    check(path)
    with xr.open_dataset(path, engine="h5netcdf") as lazy:
        return lazy.load()


class Variable(NamedTuple):
    """A variable of a NetCDF file.

    Attributes:
        dimensions: their names.
        values: numbers, or texts as objects.
    """

    dimensions: tuple[str, ...]
    values: np.ndarray[Any, Any]


class Content(NamedTuple):
    """What was read of a NetCDF file without xarray.

    Attributes:
        attributes: of the file.
        names: of all its variables.
        variables: those that were asked for, and are there.
    """

    attributes: dict[str, Any]
    names: frozenset[str]
    variables: dict[str, Variable]


#: Attributes of a variable whose numbers are not those that are stored.
_PACKED = ("scale_factor", "add_offset")


def load_some(path: Path, names: Iterable[str]) -> Content:
    """Return some variables of a NetCDF file as they are stored, without importing xarray.

    Args:
        path: of the file.
        names: of the variables.

    Raises:
        OSError: when it cannot be read, or is no regular file.
        Refused: as :func:`load`, and for numbers that are stored scaled.
        Exception: whatever h5py raises for a damaged file.
    """
    import h5py

    check(path)
    variables = {}
    with h5py.File(path, "r") as file:
        there = frozenset(name for name, found in file.items() if isinstance(found, h5py.Dataset))
        for name in names:
            if name not in there:
                continue
            dataset = file[name]
            if any(key in dataset.attrs for key in _PACKED):
                raise Refused(f"its variable {name!r} is stored scaled ({' or '.join(_PACKED)})")
            is_text = h5py.check_string_dtype(dataset.dtype) is not None
            values = dataset.asstr()[...] if is_text else dataset[...]
            variables[name] = Variable(_dimensions(dataset), np.asarray(values))
        return Content(_attributes(file), there, variables)


def _attributes(file: Any) -> dict[str, Any]:
    """Return the attributes of a file, each of one number as that."""
    attributes = {}
    for name, value in file.attrs.items():
        is_one = isinstance(value, np.ndarray) and value.size == 1
        attributes[name] = value.item() if is_one else value
    return attributes


def _dimensions(dataset: Any) -> tuple[str, ...]:
    """Return the names of a variable's dimensions; its own where it is one."""
    if dataset.is_scale:
        return (dataset.name.rpartition("/")[2],)
    return tuple(scales[0].name.rpartition("/")[2] for scales in dataset.dims)


def check(path: Path) -> None:
    """Check what a NetCDF file declares; errors as :func:`load`."""
    import h5py

    with files.open_regular(path) as stream:  # a FIFO would make HDF5 wait
        stored = files.stored_bytes(os.fstat(stream.fileno()))
    most = min(files.allowance(stored), files.machine_bytes())
    with h5py.File(path, "r") as file:
        declared = 0
        for found in _objects(file):
            _check_attributes(found, stored, most)
            if isinstance(found.object, h5py.h5d.DatasetID):
                declared += _size(found, most)
            if declared > most:
                raise Refused(
                    f"its variables up to {found.name!r} take {declared / 2**20:.4g} MiB of memory, and the "
                    f"file is {stored} bytes long: at most {files.RATIO} times its size is read, or 64 MiB"
                )


class _Found(NamedTuple):
    """A group or variable, by h5py's low-level interface, and its name."""

    name: str
    object: Any


def _objects(file: Any) -> Iterator[_Found]:
    """Give every group and variable of a file once, none that is elsewhere."""
    import h5py

    waiting = [_Found("/", h5py.h5o.open(file.id, b"/"))]
    seen = {h5py.h5o.get_info(waiting[0].object).addr}
    while waiting:
        found = waiting.pop()
        yield found
        if not isinstance(found.object, h5py.h5g.GroupID):
            continue
        for key in found.object:
            name = key.decode(errors="replace")
            if found.object.links.get_info(key).type != h5py.h5l.TYPE_HARD:
                raise Refused(f"its variable {name!r} is a link, which may lead to another file")
            address = h5py.h5o.get_info(found.object, key).addr
            if address in seen:
                continue
            seen.add(address)
            if len(seen) > _MOST_OBJECTS:
                raise Refused(f"it has more than {_MOST_OBJECTS} groups and variables")
            waiting.append(_Found(name, h5py.h5o.open(found.object, key)))


def _size(found: _Found, most: float) -> int:
    """Return the memory that a variable takes when it is loaded [bytes].

    Raises:
        Refused: when it is not in the file, or of a kind that is not read.
    """
    import h5py

    name, dataset = found
    how = dataset.get_create_plist()
    # Before its shape is asked for: that of a virtual one may be asked of another file.
    if how.get_layout() == h5py.h5d.VIRTUAL:
        raise Refused(f"its variable {name!r} is virtual: its numbers are in another file")
    if how.get_external_count():
        raise Refused(f"its variable {name!r} is stored outside the file (HDF5 external storage)")
    for i in range(how.get_nfilters()):
        code, _, _, title = how.get_filter(i)
        if code not in _FILTERS:
            said = title.decode(errors="replace") or "unknown"
            raise Refused(f"its variable {name!r} has the filter {code} ({said:.40}); save it with deflate")
    kind, count = dataset.get_type(), math.prod(dataset.shape)
    if how.get_layout() == h5py.h5d.CHUNKED and math.prod(how.get_chunk()) * kind.get_size() > most:
        raise Refused(f"its variable {name!r} has chunks that do not fit into memory")
    return _memory(kind, count, f"variable {name!r}") + _length(dataset, kind, count, name, most)


def _memory(kind: Any, count: int, what: str) -> int:
    """Return the memory of so many values of a type [bytes].

    Raises:
        Refused: when they are neither numbers nor texts.
    """
    import h5py

    if isinstance(kind, h5py.h5t.TypeStringID):
        if kind.is_variable_str() and count > _MOST_TEXTS:
            raise Refused(f"its {what} has more than {_MOST_TEXTS} texts")
        # As NumPy keeps them: four bytes for a character, and some for the object.
        return count * (64 + 4 * int(kind.get_size()))
    if not isinstance(kind, h5py.h5t.TypeIntegerID | h5py.h5t.TypeFloatID | h5py.h5t.TypeEnumID):
        raise Refused(f"its {what} holds neither numbers nor texts (a reference, perhaps)")
    return count * max(_NUMBER, int(kind.get_size()))


def _length(dataset: Any, kind: Any, count: int, name: str, most: float) -> int:
    """Return the memory of a variable's texts of variable length [bytes], 0 for other variables.

    Several of them may be the same place of the file, so that they are read one by one.
    """
    import h5py

    if not (count and isinstance(kind, h5py.h5t.TypeStringID) and kind.is_variable_str()):
        return 0
    texts, length = h5py.Dataset(dataset), 0
    for place in np.ndindex(texts.shape):
        length += 4 * len(texts[place])
        if length > most:
            raise Refused(f"its variable {name!r} has texts that do not fit into memory")
    return length


def _check_attributes(found: _Found, stored: int, most: float) -> None:
    """Refuse attributes that are no numbers or texts, or take much memory."""
    import h5py

    for i in range(h5py.h5a.get_num_attrs(found.object)):
        attribute = h5py.h5a.open(found.object, index=i)
        name = attribute.name.decode(errors="replace")
        kind, count = attribute.get_type(), math.prod(attribute.shape)
        if name not in _TIES:
            _memory(kind, count, f"attribute {name!r} of {found.name!r}")
        # Each text of variable length may be the same long one.
        large = isinstance(kind, h5py.h5t.TypeStringID) and kind.is_variable_str() and count * stored > most
        if count > _MOST_TEXTS or (large and count > 1):
            raise Refused(f"its attribute {name!r} of {found.name!r} has {count} values")
