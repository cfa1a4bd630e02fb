"""The folder of a history.

    history.pvd      the stored steps in time, for ParaView and PyVista, pointing to
    step_0000.vtu    one file a stored step
    summary.json     what was run, how certain the answer is, the energies, the cost
    history.npz      the arrays of the history, lossless; :func:`read_history` needs no other file

All files are made in a folder of their own inside the target and moved from there when they are complete, so
that a run that dies leaves an older history as it was.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

from vemcvx.errors import HistoryError, MeshError
from vemcvx.files.archive import read_archive, write_archive
from vemcvx.files.series import listed_steps, write_series
from vemcvx.files.summary import Origin, write_summary
from vemcvx.history import History

ARCHIVE, SERIES, SUMMARY = "history.npz", "history.pvd", "summary.json"


def write_history(history: History, folder: str | Path, origin: Origin | None = None) -> Path:
    """Write a history to a folder, which is made if need be; an older history in it is replaced.

    Parameters
    ----------
    history : History
    folder : str or Path
    origin : Origin, optional
        What the summary says of the problem and the family of meshes.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    HistoryError
        The folder cannot be made or written to.
    """
    folder, start = writable_folder(folder), time.perf_counter()
    older = listed_steps(folder / SERIES)
    try:
        with tempfile.TemporaryDirectory(prefix=".writing-", dir=folder) as made:
            new = Path(made)
            write_series(history, new / SERIES)
            write_archive(history, new / ARCHIVE)
            write_summary(history, origin or Origin(), time.perf_counter() - start, new / SUMMARY)
            written = {path.name for path in new.iterdir()}
            for name in sorted(written):
                os.replace(new / name, folder / name)
        for name in older - written:
            (folder / name).unlink(missing_ok=True)
    except (OSError, MeshError) as error:
        raise HistoryError(f"{folder}: cannot write a history there: {error}") from error
    return folder


def writable_folder(folder: str | Path) -> Path:
    """The folder, made if need be.

    Raises
    ------
    HistoryError
        It is a file, or may not be written to.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise HistoryError(f"{folder}: cannot be made a folder to write to: {error}") from error
    return folder


def read_history(folder: str | Path) -> History:
    """Read a history back, every number to the bit.

    The scene is not kept (its data may be functions): `scene` is None, `effects` says it in words.

    Parameters
    ----------
    folder : str or Path
        What :func:`write_history` was given.

    Raises
    ------
    HistoryError
        There is no such folder, no history in it, or one that is damaged or of another format.
    """
    path = Path(folder) / ARCHIVE
    if not path.is_file():
        raise HistoryError(f"{folder}: {_what_is(Path(folder))}; a history is a folder with {ARCHIVE} in it.")
    return read_archive(path)


def _what_is(folder: Path) -> str:
    if folder.is_dir():
        return f"found {', '.join(sorted(path.name for path in folder.iterdir())[:5]) or 'nothing'}"
    return "found a file, not a folder" if folder.exists() else "there is no such folder"
