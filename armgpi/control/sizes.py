"""For how many rollouts the parts of a loop are: batch sizes of arrays, and the one that they agree on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armgpi.base.arrays import Array
from armgpi.errors import ParameterError


def batches(made: object) -> Iterator[int | Array | None]:
    """Yield what may say for how many rollouts an object is; :func:`common_batch` takes it.

    Yields:
        Of each attribute: an array itself, the arrays of a tuple, or the `batch` of another object, None
        without one. What is in lists, mappings and tuples of tuples is passed over.
    """
    for value in vars(made).values():
        if isinstance(value, np.ndarray):
            yield value
        elif isinstance(value, tuple):
            yield from (part for part in value if isinstance(part, np.ndarray))
        elif not isinstance(value, type):
            yield getattr(value, "batch", None)


def common_batch(*sources: int | Array | None) -> int | None:
    """Return the one batch size of several numbers or arrays (batch, n), None when none has one.

    Raises:
        ParameterError: when two of them differ.
    """
    sizes = set()
    for source in sources:
        if isinstance(source, int):
            sizes.add(source)
        elif source is not None and source.ndim == 2:
            sizes.add(len(source))
    if len(sizes) > 1:
        raise ParameterError("batch", sorted(sizes), "the same size everywhere")
    return sizes.pop() if sizes else None
