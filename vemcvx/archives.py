"""Records as named arrays, and NPZ archives of these, read whole: what histories, checkpoints and programs are kept in.

An archive from outside is refused where it unpacks to far more than its size lets expect. What zip says of a member's
size is checked, because no reader goes on beyond it. Our own archives are not compressed; numbers compress up to some
dozen times, zeros a thousand times.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_type_hints

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]
UNPACKED, IN_ANY_CASE = 200, 2**20  # How often a file's size it may unpack to, and the bytes that it may in any case.
KINDS = "biufcU"  # Numpy's letters for truth values, numbers and words.


def most_unpacked(size: int) -> int:
    """Bytes that a compressed file of that size may hold."""
    return max(IN_ANY_CASE, UNPACKED * size)


def read_arrays(path: Path) -> Arrays:
    """Every array of an archive; ValueError, or whatever numpy and zipfile stumble over, where it is damaged.

    One that unpacks to more than 200 times its size, or holds what is no array of numbers or words, is refused.
    """
    # Opened here, because numpy leaves a damaged file open.
    with path.open("rb") as stream, NpzFile(stream, allow_pickle=False) as file:
        listed = file.zip
        claimed = sum(member.file_size for member in listed.infolist()) if listed is not None else 0
        if claimed > most_unpacked(path.stat().st_size):
            raise ValueError(f"it unpacks to {claimed} bytes, more than {UNPACKED} times its size")
        arrays = {name: file[name] for name in file.files}
    for name, array in arrays.items():
        # A member that is no array comes back as bytes.
        if isinstance(array, bytes) or array.dtype.kind not in KINDS:
            raise ValueError(f"its member {name!r} is no array of numbers, truth values or words")
    return arrays


def arrays_of(record: Any, without: str, prefix: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    """The fields of a record but one, and of the records in it, each under its path; what is None is left out."""
    for field in fields(record):
        name, value = prefix + field.name, getattr(record, field.name)
        if name == without or value is None:
            continue
        if is_dataclass(value):
            yield from arrays_of(value, without, f"{name}.")
        else:
            yield name, np.asarray(value)


def record_of(kind: type, arrays: Arrays, known: Mapping[str, Any], prefix: str = "") -> Any:
    """The record of arrays under the paths of its fields; fields that are `known`, by their paths, go in as they are.

    KeyError where a field is missing that may not be None.
    """
    hints, values = get_type_hints(kind), {}
    for field in fields(kind):
        name, parts = prefix + field.name, (hints[field.name], *get_args(hints[field.name]))
        inner = [part for part in parts if isinstance(part, type) and is_dataclass(part)]
        there = name in arrays or any(path.startswith(f"{name}.") for path in arrays)
        if name in known:
            values[field.name] = known[name]
        elif not there and NoneType in parts:
            values[field.name] = None
        elif inner:
            values[field.name] = record_of(inner[0], arrays, known, f"{name}.")
        else:
            values[field.name] = arrays[name] if arrays[name].ndim else arrays[name].item()
    return kind(**values)
