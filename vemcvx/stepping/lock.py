"""A small text file that one process at a time may hold; the system lets go of it when that process dies."""

from __future__ import annotations

import errno
import logging
import os
from collections.abc import Sequence
from pathlib import Path

log = logging.getLogger("vemcvx")

BUSY = (errno.EACCES, errno.EAGAIN, errno.EDEADLK)
BEYOND = 2**30
"""Windows locks bytes, and nobody may read a locked one: this one the text never reaches."""


class Locked:
    """A text file that is held until it is closed."""

    def __init__(self, path: Path, descriptor: int):
        self._path, self._descriptor = path, descriptor

    def text(self) -> str:
        """What it says."""
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        return os.read(self._descriptor, os.fstat(self._descriptor).st_size).decode(errors="replace")

    def write(self, lines: Sequence[str]) -> None:
        """Let it say something else; lines that it begins with already are at no moment gone."""
        data = "".join(line + "\n" for line in lines).encode()
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        os.write(self._descriptor, data)
        os.ftruncate(self._descriptor, len(data))

    def remove(self) -> None:
        """Delete it, and close."""
        self._path.unlink(missing_ok=True)
        self.close()

    def close(self) -> None:
        """Let go of it."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
        self._descriptor = -1


def locked(path: Path) -> Locked:
    """Hold the file, which is made if need be, and its folder.

    Raises
    ------
    BlockingIOError
        Somebody holds it.
    OSError
        It cannot be made.
    """
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            _hold(descriptor, path)
            if os.path.exists(path) and os.path.samestat(os.fstat(descriptor), os.stat(path)):
                return Locked(path, descriptor)
        except BaseException:
            os.close(descriptor)
            raise
        # Whoever held it has deleted it meanwhile.
        os.close(descriptor)


def _hold(descriptor: int, path: Path) -> None:
    try:
        _lock(descriptor)
    except OSError as error:
        if error.errno in BUSY:
            raise BlockingIOError(error.errno, "held by another run") from error
        log.warning("%s: cannot be locked (%s); see to it that no two runs share its folder", path, error)


def _lock(descriptor: int) -> None:
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        os.lseek(descriptor, BEYOND, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        return
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
