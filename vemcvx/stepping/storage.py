"""Where the rows of a run are kept: in memory, or in a folder that outlives the process.

A folder holds one ``.npy`` file an array, mapped into memory, so that the size of a history is bounded by the
disk and not by memory; and ``checkpoint.npz``, replaced in one move whenever a stored step is complete, from
which a run that was interrupted goes on. The disk's space is claimed before the first step.
"""

from __future__ import annotations

import os
import shutil
import zipfile
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vemcvx.errors import HistoryError

Arrays = dict[str, NDArray[Any]]
CHECKPOINT = "checkpoint.npz"


class Storage(Protocol):
    """Somewhere for arrays."""

    def array(self, name: str, shape: tuple[int, ...], dtype: Any = float) -> NDArray[Any]:
        """A writable array, zero where nothing was written yet."""

    def save(self, arrays: Arrays) -> None:
        """Keep a checkpoint: everything needed to go on from here."""

    def load(self) -> Arrays | None:
        """The last checkpoint, if there is one."""


class Memory:
    """Rows in memory; nothing outlives the run."""

    def array(self, name: str, shape: tuple[int, ...], dtype: Any = float) -> NDArray[Any]:
        """Zeros."""
        return np.zeros(shape, dtype)

    def save(self, arrays: Arrays) -> None:
        """Nothing: memory needs no checkpoint."""

    def load(self) -> Arrays | None:
        """None."""
        return None


class Folder:
    """Rows in files.

    Raises
    ------
    HistoryError
        The folder cannot be made or written to, or the disk is too small for the arrays.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise HistoryError(f"{path}: cannot be made a folder to write to: {error}.") from error

    def array(self, name: str, shape: tuple[int, ...], dtype: Any = float) -> NDArray[Any]:
        """The array of that name, from an earlier run if one of that shape is there."""
        file = self.path / f"{name}.npy"
        if 0 in shape:
            return np.zeros(shape, dtype)
        try:
            if file.exists():
                old = np.lib.format.open_memmap(file, mode="r+")
                if old.shape == shape and old.dtype == np.dtype(dtype):
                    return old
            made = np.lib.format.open_memmap(file, mode="w+", dtype=dtype, shape=shape)
            _claim(file)
            return made
        except (OSError, ValueError) as error:
            raise HistoryError(f"{file}: no room for an array of shape {shape}: {error}.") from error

    def clear(self) -> None:
        """Forget an earlier run."""
        (self.path / CHECKPOINT).unlink(missing_ok=True)

    def remove(self) -> None:
        """Take the folder away; arrays that are still mapped stay as they are."""
        shutil.rmtree(self.path, ignore_errors=True)

    def save(self, arrays: Arrays) -> None:
        """Write beside the old checkpoint, then move over it: at no moment is there none."""
        made = self.path / f".{CHECKPOINT}"
        try:
            with open(made, "wb") as file:
                np.savez(file, **arrays)
                file.flush()
                os.fsync(file.fileno())
            os.replace(made, self.path / CHECKPOINT)
        except OSError as error:
            raise HistoryError(f"{self.path}: cannot write a checkpoint: {error}.") from error

    def load(self) -> Arrays | None:
        """The last complete checkpoint."""
        file = self.path / CHECKPOINT
        if not file.exists():
            return None
        try:
            with open(file, "rb") as opened, np.load(opened, allow_pickle=False) as kept:
                return {name: kept[name] for name in kept.files}
        except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise HistoryError(f"{file}: damaged: {error}. Remove the folder and run again.") from error


def _claim(file: Path) -> None:
    """Take the space now: a full disk is an error here, and a crash once the file is mapped."""
    with open(file, "r+b") as opened:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(opened.fileno(), 0, file.stat().st_size)
