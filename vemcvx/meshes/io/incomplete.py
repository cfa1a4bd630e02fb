"""Files that end too early, for readers that would wait for the rest for ever.

Some of meshio's readers look for a closing line in a loop that the end of the file does not leave. They take open
files too, and such a file may object to being read on and on at its end.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

# Readers ask once or twice at the end of a sound file.
PATIENCE = 100
TEXT, BINARY = ("nastran", "off", "tecplot"), ("ply", "mdpa", "ansys")


class _ImpatientText(io.TextIOWrapper):
    misses = 0

    def readline(self, *size: Any) -> Any:
        return _counted(self, super().readline(*size))


class _ImpatientBytes(io.BufferedReader):
    misses = 0

    def read(self, *size: Any) -> bytes:
        return _counted(self, super().read(*size))

    def readline(self, *size: Any) -> Any:
        return _counted(self, super().readline(*size))


def _counted(file: Any, line: Any) -> Any:
    file.misses = 0 if line else file.misses + 1
    if file.misses > PATIENCE:
        raise EOFError("the file ends too early")
    return line


def impatient(path: Path, file_format: str) -> Path | io.IOBase:
    """What to hand to meshio: an open file that raises EOFError at its end for the formats that need it, else the path.

    The caller closes it.
    """
    if file_format in TEXT:
        return _ImpatientText(path.open("rb"), encoding="utf-8")
    if file_format in BINARY:
        return _ImpatientBytes(io.FileIO(path))
    return path
