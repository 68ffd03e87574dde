"""Types of NumPy arrays, by the kind of their numbers, and arrays that nobody writes to."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[Any]  # of any numbers, where several kinds are taken
Bools: TypeAlias = NDArray[np.bool_]
Bytes: TypeAlias = NDArray[np.uint8]
Floats: TypeAlias = NDArray[np.float32]
Doubles: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int32]
Longs: TypeAlias = NDArray[np.int64]
Words: TypeAlias = NDArray[np.uint32]

Kept = TypeVar("Kept")


def fixed(value: Kept) -> Kept:
    """The value, no array in which can be written to any more: it is an array of any shape and numbers, a dataclass, a
    list or a tuple of them, or something else."""
    if isinstance(value, np.ndarray):
        value.flags.writeable = False
    elif is_dataclass(value):
        for one in fields(value):
            fixed(getattr(value, one.name))
    elif isinstance(value, (list, tuple)):
        for part in value:
            fixed(part)
    return value
