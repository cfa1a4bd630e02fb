"""NPZ archives from outside, read whole: refused where they unpack to far more than their size lets expect.

What zip says of a member's size is checked, because no reader goes on beyond it. Our own archives are not compressed;
numbers compress up to some dozen times, zeros a thousand times.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]
UNPACKED, SMALL = 200, 2**20
"""How often a file's size it may unpack to, and the bytes that it may in any case."""
KINDS = "biufcU"
"""Numpy's letters for truth values, numbers and words."""


def most_unpacked(size: int) -> int:
    """Bytes that a compressed file of that size may hold."""
    return max(SMALL, UNPACKED * size)


def read_arrays(path: Path) -> Arrays:
    """Every array of an archive.

    Raises
    ------
    ValueError
        It unpacks to more than 200 times its size, or holds what is no array of numbers, truth values or words.
    Exception
        It is damaged: whatever numpy, zipfile or the parser of headers stumbles over.
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
