"""Files of ours in a folder that may hold those of others, for one process at a time.

Our mark is the file ``.vemcvx``: it names the files that we made there, line by line, each before it is made. No
other file is ever written to or taken away. While somebody is at work there the mark is locked; the system lets go of
the lock when that process dies.

A folder may be damaged, edited or received, so its mark proves nothing but what it could have been told: a line is the
plain name of a kind of file that is written there, or the mark is refused; and only a regular file is ours, no folder
and no link, wherever that leads.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import re
import stat
import sys
from pathlib import Path
from typing import Self

from vemcvx.base.arrays import brief
from vemcvx.base.errors import HistoryError

log = logging.getLogger("vemcvx")

MARK = ".vemcvx"
FIRST_LINE = "vemcvx files 1"
OWN_FOLDER = ", folder and all"  # Added to the first line where the folder itself was made by us.
ANY_KIND = r"[^/\\\x00-\x1f]+\.(npy|npz|json|jsonl|csv|png|pvd|vtu|mtx|cbf|qps|mps|hdf5|py)"
"""Names of the files that are written to folders, as a regular expression."""
DRAFTS = "new"  # The one folder that may be ours; what is in it is ours if it is a file of such a name.
BUSY = (errno.EACCES, errno.EAGAIN, errno.EDEADLK)


class Owned:
    """Our files in a folder, which is made if need be; to be closed, or used by ``with``.

    `kinds` are the names of the files that may be ours, a regular expression without separators of paths. HistoryError
    where the folder cannot be made or written to, somebody else is at work there, or its mark is none of ours.
    """

    def __init__(self, path: Path, kinds: str = ANY_KIND):
        self.path, self._kinds = path, re.compile(kinds)
        try:
            made = not os.path.isdir(path)
            if os.path.lexists(path / MARK) and not _is_file(path / MARK):
                raise self._foreign(MARK)
            self._mark = _locked(path / MARK)
        except BlockingIOError as error:
            raise HistoryError(
                f"{path}: another run is writing there. Wait until it has ended, or choose another folder."
            ) from error
        except OSError as error:
            raise HistoryError(f"{path}: cannot be made a folder to write to: {error}.") from error
        try:
            self._first, self.names = self._read(made)
            self._write()
        except BaseException:
            os.close(self._mark)  # Whoever tries again, once there is room on the disk, say, is not held off.
            raise

    def _read(self, made: bool) -> tuple[str, list[str]]:
        """The first line of the mark, and the names in it, all of which must be those of our kinds of files."""
        try:
            # 16 MB are a hundred times the mark of the largest collection of programs.
            text = os.read(self._mark, 2**24).decode(errors="replace")
        except OSError as error:
            raise HistoryError(f"{self.path / MARK}: cannot be read: {error}.") from error
        if not (text.startswith(FIRST_LINE) or FIRST_LINE.startswith(text)):
            raise self._foreign(MARK)
        # A process that dies while it writes leaves a last line that is cut short: it had not made that file yet.
        first, *names = text.split("\n")[:-1] or [FIRST_LINE + OWN_FOLDER * made]
        strange = next((name for name in names if not self._kinds.fullmatch(name)), None)
        if strange is not None:
            raise HistoryError(
                f"{self.path / MARK}: it lists {brief(strange)}, which no run writes there, so nothing there is "
                "touched. Choose another folder, or remove this one."
            )
        return first, names

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def take(self, name: str) -> Path:
        """The path of a file of that name, ours from now on; HistoryError where it is somebody else's."""
        path = self.path / name
        if os.path.lexists(path) and (name not in self.names or not _is_file(path)):
            raise self._foreign(name)
        if name not in self.names:
            self.names.append(name)
            self._write()
        return path

    def write(self, name: str, content: str | bytes) -> str:
        """Write a file of that name, ours from now on; return the name."""
        path = self.take(name)
        try:
            path.write_bytes(content.encode() if isinstance(content, str) else content)
        except OSError as error:
            raise HistoryError(f"{path}: cannot be written: {error}.") from error
        return name

    def clear(self) -> None:
        """Take away all of ours but the mark."""
        try:
            for path in (self.path / name for name in self.names):
                if path.name == DRAFTS and path.is_dir() and not path.is_symlink():
                    for draft in filter(_is_file, path.iterdir()):
                        if re.fullmatch(ANY_KIND, draft.name):
                            draft.unlink()
                    # Where others have files in it, it stays.
                    with contextlib.suppress(OSError):
                        path.rmdir()
                elif _is_file(path):
                    path.unlink()
        except OSError as error:
            raise HistoryError(f"{self.path}: cannot be cleared: {error}.") from error
        self.names = []
        self._write()

    def remove(self) -> None:
        """Take away all of ours, the folder, too, if we made it and nothing else is in it, and close."""
        self.clear()
        self.close()

    def close(self) -> None:
        """Let others work there; a mark that names nothing goes."""
        if self._mark < 0:
            return
        if not self.names:
            # Where others have files in the folder, it stays.
            with contextlib.suppress(OSError):
                (self.path / MARK).unlink()
                if self._first.endswith(OWN_FOLDER):
                    self.path.rmdir()
        os.close(self._mark)
        self._mark = -1

    def _write(self) -> None:
        """Say what is ours; lines that are there already are at no moment gone."""
        data = "".join(f"{line}\n" for line in (self._first, *self.names)).encode()
        try:
            os.lseek(self._mark, 0, os.SEEK_SET)
            rest = data
            while rest:  # A disk that is nearly full takes a part, and is an error the next time.
                rest = rest[os.write(self._mark, rest) :]
            os.ftruncate(self._mark, len(data))
        except OSError as error:
            raise HistoryError(f"{self.path / MARK}: cannot be written: {error}.") from error

    def _foreign(self, name: str) -> HistoryError:
        return HistoryError(
            f"{self.path / name}: not made by a run of this version, so it is not touched. Choose another folder, or "
            "move it away."
        )


def path_of(raw: object, subject: str) -> Path:
    """The path that `raw` names, or HistoryError."""
    try:
        text = os.fspath(raw) if isinstance(raw, (str, os.PathLike)) else None
        if isinstance(text, str) and text and b"\0" not in os.fsencode(text):
            return Path(text)
    except (TypeError, UnicodeEncodeError):
        pass
    raise HistoryError(f"{subject}: found {brief(raw)}; wanted a path, such as 'results/run'.")


def _is_file(path: Path) -> bool:
    """Return True if it is a regular file, and no link to one."""
    try:
        return stat.S_ISREG(os.lstat(path).st_mode)
    except OSError:
        return False


def _locked(path: Path) -> int:
    """A descriptor of the file, made with its folder if need be; BlockingIOError where somebody else has one."""
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        try:
            try:
                _lock(descriptor)
            except OSError as error:
                if error.errno in BUSY:
                    raise BlockingIOError(error.errno, "held by somebody else") from error
                log.warning("%s: cannot be locked (%s); see to it that no two runs share its folder", path, error)
            if os.path.exists(path) and os.path.samestat(os.fstat(descriptor), os.stat(path)):
                os.lseek(descriptor, 0, os.SEEK_SET)
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # Whoever held it has deleted it meanwhile.


def _lock(descriptor: int) -> None:
    if sys.platform == "win32":
        import msvcrt

        # Windows locks bytes, and nobody may read a locked one: this one the text never reaches.
        os.lseek(descriptor, 2**30, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
