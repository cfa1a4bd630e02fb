"""Reading of records from NPZ archives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_type_hints

from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]
KINDS = "biufcU"  # NumPy's letters for booleans, numbers and strings


def read_arrays(path: Path) -> Arrays:
    """Return the arrays of an archive by name."""
    # NumPy would leave a damaged file open.
    with path.open("rb") as stream, NpzFile(stream, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    for name, array in arrays.items():
        # NumPy returns bytes for members that are not arrays.
        if isinstance(array, bytes) or array.dtype.kind not in KINDS:
            raise ValueError(f"its member {name!r} is no array of numbers, truth values or words")
    return arrays


def record_of(kind: type, arrays: Arrays, known: Mapping[str, Any], prefix: str = "") -> Any:
    """Return a record of class `kind`, with each field from `known` or `arrays`."""
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
