"""Files that end too early, for readers that would wait for the rest for ever.

Some of meshio's readers look for a closing line in a loop that the end of the file does not leave. They take open
files too, and such a file may object to being read on and on at its end.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

# Readers ask once or twice at the end of a sound file.
PATIENCE = 100
TEXT, BINARY = ("nastran", "off", "tecplot"), ("ply", "mdpa", "ansys")


class _Impatient(io.FileIO):
    misses = 0

    def readinto(self, buffer: WriteableBuffer, /) -> int:
        count = super().readinto(buffer)
        self.misses = 0 if count else self.misses + 1
        if self.misses > PATIENCE:
            raise EOFError("the file ends too early")
        return count


def impatient(path: Path, file_format: str) -> Path | io.IOBase:
    """What to hand to meshio: an open file that raises EOFError at its end for the formats that need it, else the path.

    The caller closes it.
    """
    if file_format not in TEXT + BINARY:
        return path
    file = io.BufferedReader(_Impatient(path))
    return io.TextIOWrapper(file, encoding="utf-8") if file_format in TEXT else file
