"""Output files in a folder that may also contain foreign files.

The file ``.vemcvx`` lists the files that the package created in the folder, one name per line. Files that are not
listed are never changed. A process that uses the folder locks the list.
"""

from __future__ import annotations

import contextlib
import logging
import os
import sys
from pathlib import Path
from typing import IO, Self

from vemcvx.base.arrays import brief
from vemcvx.base.errors import HistoryError

log = logging.getLogger("vemcvx")

LIST = ".vemcvx"
FIRST_LINE = "vemcvx files 1"


class Owned:
    """The files of this package in a folder; `close` releases the folder."""

    def __init__(self, path: Path):
        self.path = path
        if os.path.islink(path / LIST):
            raise self._foreign(LIST)
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._list = (path / LIST).open("a+", encoding="utf-8", errors="replace")
        except OSError as error:
            raise HistoryError(f"{path}: cannot be used as a folder for output: {error}.") from error
        try:
            _lock(self._list)
            first, *self.names = self._list.read().splitlines() or [FIRST_LINE]
            if first != FIRST_LINE or any(name != Path(name).name for name in self.names):
                raise self._foreign(LIST)
        except BaseException:
            self._list.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def take(self, name: str) -> Path:
        """Add a file to the list and return its path, or raise HistoryError."""
        path = self.path / name
        if os.path.lexists(path) and not (name in self.names and _is_file(path)):
            raise self._foreign(name)
        if name not in self.names:
            try:
                self._list.write(f"{name}\n" if self.names else f"{FIRST_LINE}\n{name}\n")
                self._list.flush()
            except OSError as error:
                raise HistoryError(f"{self.path / LIST}: cannot be written: {error}.") from error
            self.names.append(name)
        return path

    def write(self, name: str, content: str | bytes) -> str:
        """Write a file and return its name."""
        path = self.take(name)
        try:
            path.write_bytes(content.encode() if isinstance(content, str) else content)
        except OSError as error:
            raise HistoryError(f"{path}: cannot be written: {error}.") from error
        return name

    def clear(self) -> None:
        """Delete all listed files."""
        try:
            for path in filter(_is_file, (self.path / name for name in self.names)):
                path.unlink()
            self._list.truncate(0)
        except OSError as error:
            raise HistoryError(f"{self.path}: cannot be cleared: {error}.") from error
        self.names = []

    def close(self) -> None:
        """Close the list and release the lock."""
        if not (self.names or self._list.closed):
            with contextlib.suppress(OSError):  # Windows cannot delete an open file.
                (self.path / LIST).unlink()
                self.path.rmdir()
        with contextlib.suppress(OSError):  # Closing fails if the list could not be written.
            self._list.close()

    def _foreign(self, name: str) -> HistoryError:
        return HistoryError(
            f"{self.path / name}: not made by a run of this version, so it is not touched. Choose another folder, or "
            "move it away."
        )


def path_of(raw: object, subject: str) -> Path:
    """Return `raw` as a Path, or raise HistoryError."""
    try:
        text = os.fspath(raw) if isinstance(raw, (str, os.PathLike)) else None
        if isinstance(text, str) and text and b"\0" not in os.fsencode(text):
            return Path(text)
    except (TypeError, UnicodeEncodeError):
        pass
    raise HistoryError(f"{subject}: found {brief(raw)}; wanted a path, such as 'results/run'.")


def _is_file(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _lock(file: IO[str]) -> None:
    """Lock an open file; raise HistoryError if another process uses the file."""
    try:
        if sys.platform == "win32":
            import msvcrt

            file.seek(2**30)  # Windows forbids reading a locked byte: lock a byte beyond the text.
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        busy = not (os.path.exists(file.name) and os.path.samestat(os.fstat(file.fileno()), os.stat(file.name)))
    except (BlockingIOError, PermissionError):
        busy = True
    except OSError as error:
        busy = False
        log.warning("%s: cannot be locked (%s); make sure that no two runs share its folder", file.name, error)
    file.seek(0)
    if busy:
        there = f"{Path(file.name).parent}: another run is writing there"
        raise HistoryError(f"{there}. Wait until it has ended, or choose another folder.")
