"""Where the rows of a run are kept: in memory, or in a folder that outlives the process.

A folder holds one ``.npy`` file an array, mapped into memory, so that the size of a history is bounded by the
disk and not by memory; and ``checkpoint.npz``, replaced in one move, from which a run that was interrupted goes on. The
disk's space is claimed before the first step. All of it outlives the process; should the machine die, too, the check
sums of the checkpoint tell whether the disk has it all.

Our mark is the file ``.vemcvx``: it names the files that runs made there, line by line, each before it is made. No
other file is ever written to or taken away. While a run is on, the mark is locked, so that there is but one.
"""

from __future__ import annotations

import os
import zipfile
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vemcvx.errors import HistoryError
from vemcvx.real import brief
from vemcvx.stepping.lock import Locked, locked

Arrays = dict[str, NDArray[Any]]
CHECKPOINT = "checkpoint.npz"
MARK = ".vemcvx"
FIRST_LINE = "vemcvx rows 1"
OWN_FOLDER = ", folder and all"
"""Added to the first line where the folder itself was made for the run."""


class Storage(Protocol):
    """Somewhere for arrays."""

    lasting: bool
    """whether they outlive the process, so that checkpoints are worth their making"""

    def array(self, name: str, shape: tuple[int, ...], dtype: Any = float) -> NDArray[Any]:
        """A new writable array of zeros."""

    def kept(self, name: str, shape: tuple[int, ...], dtype: Any = float) -> NDArray[Any]:
        """The array that an earlier run has left."""

    def clear(self) -> None:
        """Forget an earlier run."""

    def save(self, arrays: Arrays) -> None:
        """Keep a checkpoint: everything needed to go on from here."""

    def load(self) -> Arrays | None:
        """The checkpoint to go on from, if there is one."""


class Memory:
    """Rows in memory; nothing outlives the run."""

    lasting = False

    def array(self, name: str, shape: tuple[int, ...], dtype: Any = float) -> NDArray[Any]:
        """Zeros."""
        try:
            return np.zeros(shape, dtype)
        except (MemoryError, ValueError) as error:
            raise HistoryError(
                f"{name}: no memory for an array of shape {shape}: {error}. Store fewer steps (store='last' or an "
                "integer), or keep rows in files (stream=FOLDER)."
            ) from error

    kept = array

    def clear(self) -> None:
        """Nothing: there was no earlier run."""

    def save(self, arrays: Arrays) -> None:
        """Nothing: memory needs no checkpoint."""

    def load(self) -> Arrays | None:
        """None."""
        return None


class Folder:
    """Rows in files; to be closed, or used by ``with``.

    Parameters
    ----------
    path : str or Path
        The folder, made if need be.
    resumes : bool
        Whether a run that it holds is to be gone on with; else it is begun anew.

    Raises
    ------
    HistoryError
        The folder cannot be made or written to, or another run is on in it.
    """

    lasting = True

    def __init__(self, path: str | Path, resumes: bool = True):
        self.path, self._resumes = path_of(path, "stream"), resumes
        try:
            made = not os.path.isdir(self.path)
            self._mark: Locked = locked(self.path / MARK)
        except BlockingIOError as error:
            raise HistoryError(
                f"{self.path}: another run is writing there. Wait until it has ended, or choose another folder."
            ) from error
        except OSError as error:
            raise HistoryError(f"{self.path}: cannot be made a folder to write to: {error}.") from error
        text = self._mark.text()
        if not (text.startswith(FIRST_LINE) or FIRST_LINE.startswith(text)):
            self.close()
            raise self._foreign(MARK)
        # A process that dies while it writes leaves a last line that is cut short: it had not made that file yet.
        self._first, *self._own = text.split("\n")[:-1] or [FIRST_LINE + OWN_FOLDER * made]
        self._mark.write([self._first, *self._own])

    def __enter__(self) -> Folder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let others use the folder."""
        self._mark.close()

    def array(self, name: str, shape: tuple[int, ...], dtype: Any = float) -> NDArray[Any]:
        """A new file of zeros; histories that still look at one of that name keep what they see."""
        file = self.path / f"{name}.npy"
        if 0 in shape:
            return np.zeros(shape, dtype)
        self._take(file.name)
        try:
            file.unlink(missing_ok=True)
            made = np.lib.format.open_memmap(file, mode="w+", dtype=dtype, shape=shape)
            _claim(file)
            return made
        except (OSError, ValueError, OverflowError) as error:
            raise HistoryError(f"{file}: no room for an array of shape {shape}: {error}.") from error

    def kept(self, name: str, shape: tuple[int, ...], dtype: Any = float) -> NDArray[Any]:
        """The array of that name, from an earlier run."""
        file = self.path / f"{name}.npy"
        if 0 in shape:
            return np.zeros(shape, dtype)
        try:
            old = np.lib.format.open_memmap(file, mode="r+")
        except (OSError, ValueError, EOFError) as error:
            raise HistoryError(f"{file}: missing or damaged: {error}. Run without resume.") from error
        if old.shape != shape or old.dtype != np.dtype(dtype):
            raise HistoryError(f"{file}: found an array {old.dtype} {old.shape}, wanted {shape}. Run without resume.")
        return old

    def clear(self) -> None:
        """Forget an earlier run."""
        try:
            for name in self._own:
                (self.path / name).unlink(missing_ok=True)
        except OSError as error:
            raise HistoryError(f"{self.path}: cannot be cleared: {error}.") from error
        self._own = []
        self._mark.write([self._first])

    def remove(self) -> None:
        """Take away what runs made, and close; arrays that are still mapped stay as they are."""
        self.clear()
        self._mark.remove()
        if self._first.endswith(OWN_FOLDER) and not any(self.path.iterdir()):
            self.path.rmdir()

    def save(self, arrays: Arrays) -> None:
        """Write beside the old checkpoint, then move over it: at no moment is there none."""
        made = self.path / f".{CHECKPOINT}"
        for name in (CHECKPOINT, made.name):
            self._take(name)
        try:
            with open(made, "wb") as file:
                np.savez(file, **arrays)
            os.replace(made, self.path / CHECKPOINT)
        except OSError as error:
            raise HistoryError(f"{self.path}: cannot write a checkpoint: {error}.") from error

    def load(self) -> Arrays | None:
        """The last complete checkpoint, if it is to be gone on with."""
        file = self.path / CHECKPOINT
        if not (self._resumes and file.exists()):
            return None
        self._take(CHECKPOINT)
        try:
            with open(file, "rb") as opened, np.load(opened, allow_pickle=False) as kept:
                return {name: kept[name] for name in kept.files}
        except (OSError, ValueError, EOFError, KeyError, AttributeError, zipfile.BadZipFile, zipfile.error) as error:
            raise HistoryError(f"{file}: damaged: {error}. Remove the folder and run again.") from error

    def _take(self, name: str) -> None:
        """See to it that a file of that name is marked as ours."""
        if name in self._own:
            return
        if os.path.lexists(self.path / name):
            raise self._foreign(name)
        self._own.append(name)
        self._mark.write([self._first, *self._own])

    def _foreign(self, name: str) -> HistoryError:
        return HistoryError(
            f"{self.path / name}: not made by a run of this version, so it is not touched. Choose another folder, or "
            "move it away."
        )


def path_of(raw: object, subject: str) -> Path:
    """The path that `raw` names.

    Raises
    ------
    HistoryError
        It names none.
    """
    try:
        text = os.fspath(raw)  # type: ignore[call-overload]
        if isinstance(text, str) and text and b"\0" not in os.fsencode(text):
            return Path(text)
    except (TypeError, UnicodeEncodeError):
        pass
    raise HistoryError(f"{subject}: found {brief(raw)}; wanted a path, such as 'results/run'.")


def _claim(file: Path) -> None:
    """Take the space now: a full disk is an error here, and a crash once the file is mapped."""
    with open(file, "r+b") as opened:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(opened.fileno(), 0, file.stat().st_size)
