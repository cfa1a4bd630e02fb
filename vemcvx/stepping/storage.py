"""Where the rows of a run are kept: in memory, or in a folder that outlives the process.

A folder holds one ``.npy`` file an array, mapped into memory, so that the size of a history is bounded by the
disk and not by memory; and ``checkpoint.npz``, replaced in one move, from which a run that was interrupted goes on. The
disk's space is claimed before the first step. All of it outlives the process; should the machine die, too, the check
sums of the checkpoint tell whether the disk has it all. Which files are a run's says :mod:`vemcvx.owned_files`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from vemcvx.archives import Arrays, read_arrays
from vemcvx.errors import HistoryError
from vemcvx.owned_files import Owned, path_of

CHECKPOINT = "checkpoint.npz"
ROWS = r"[a-z_]+\.npy|\.?checkpoint\.npz"
"""Names of the files of a run, as a regular expression."""
SAVE: Callable[..., None] = np.savez
"""Names of arrays are none of its options."""


@runtime_checkable
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


class Folder(Owned):
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
        super().__init__(path_of(path, "stream"), ROWS)
        self._resumes = resumes

    def array(self, name: str, shape: tuple[int, ...], dtype: Any = float) -> NDArray[Any]:
        """A new file of zeros; histories that still look at one of that name keep what they see."""
        if 0 in shape:
            return np.zeros(shape, dtype)
        file = self.take(f"{name}.npy")
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
            # To be written to, a file that was cut short would be filled up with zeros.
            old = np.lib.format.open_memmap(file, mode="r")
            if old.shape != shape or old.dtype != np.dtype(dtype):
                raise ValueError(f"found {old.dtype} of shape {old.shape}, wanted {np.dtype(dtype)} of shape {shape}")
            return np.lib.format.open_memmap(file, mode="r+")
        except Exception as error:  # damage shows as whatever numpy or the parser of headers stumbles over
            raise HistoryError(f"{file}: missing, cut short or damaged: {error}. Run without resume.") from error

    def save(self, arrays: Arrays) -> None:
        """Write beside the old checkpoint, then move over it: at no moment is there none."""
        kept, made = self.take(CHECKPOINT), self.take(f".{CHECKPOINT}")
        try:
            with open(made, "wb") as file:
                SAVE(file, **arrays)
            os.replace(made, kept)
        except OSError as error:
            raise HistoryError(f"{self.path}: cannot write a checkpoint: {error}.") from error

    def load(self) -> Arrays | None:
        """The last complete checkpoint, if it is to be gone on with."""
        file = self.path / CHECKPOINT
        if not (self._resumes and file.exists()):
            return None
        self.take(CHECKPOINT)
        try:
            return read_arrays(file)
        except Exception as error:  # damage shows as whatever numpy, zipfile or the parser of headers stumbles over
            raise HistoryError(f"{file}: damaged: {error}. Remove the folder and run again.") from error


def _claim(file: Path) -> None:
    """Take the space now: a full disk is an error here, and a crash once the file is mapped."""
    with open(file, "r+b") as opened:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(opened.fileno(), 0, file.stat().st_size)
