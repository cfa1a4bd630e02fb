"""The folder of a history.

    history.pvd      the stored steps in time, for ParaView and PyVista, pointing to
    step_0000.vtu    one file a stored step
    summary.json     what was run, how certain the answer is, the energies, the cost
    steps.csv        energies and certificates of every step, stored or not
    contact.csv      slip, traction, pressure ... at every contact node in every stored step
    probes.csv       displacements at points, where some were asked for
    history.npz      the arrays of the history, lossless; :func:`vemcvx.read_history` needs no other file

All files are made in a folder of their own inside the target and moved from there when they are complete, so
that a run that dies leaves an older history as it was. Files of those names that are of no history stay as they are.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Set
from pathlib import Path

from numpy.typing import ArrayLike

from vemcvx.arrays import brief
from vemcvx.errors import HistoryError, MeshError
from vemcvx.owned_files import Owned, path_of
from vemcvx.results.io.archive import is_archive, read_archive, write_archive
from vemcvx.results.io.csv_tables import FILES, write_tables
from vemcvx.results.io.series import listed_steps, write_series
from vemcvx.results.io.summary import Origin, is_summary, listed_tables, write_summary
from vemcvx.results.results import Results

ARCHIVE, SERIES, SUMMARY = "history.npz", "history.pvd", "summary.json"
WRITING = ".vemcvx-writing"


def write_results(
    history: Results, folder: str | Path, origin: Origin | None = None, probes: ArrayLike | None = None
) -> Path:
    """Write a history to a folder, which is made if need be; an older history in it is replaced.

    Parameters
    ----------
    history : Results
    folder : str or Path
    origin : Origin, optional
        What the summary says of the problem and the family of meshes.
    probes : (p, dim) points, optional
        Of the body; the displacements there are written, too.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    HistoryError
        The folder cannot be made or written to, somebody else is writing to it, or holds files of other things there.
    SceneError
        A probe is no point of the body.
    """
    if not isinstance(history, Results):
        raise HistoryError(f"write: found {brief(history)}; wanted a History, such as simulate(...) returns.")
    folder, start = writable_folder(folder), time.perf_counter()
    older = listed_steps(folder / SERIES) | listed_tables(folder / SUMMARY)
    try:
        with Owned(folder / WRITING) as scratch:
            try:
                # What a process that died has left.
                scratch.clear()
                new = scratch.take("new")
                new.mkdir()
                write_series(history, new / SERIES)
                write_archive(history, new / ARCHIVE)
                tables = write_tables(history, new, probes)
                write_summary(
                    history, origin or Origin(), tables, writing=time.perf_counter() - start, path=new / SUMMARY
                )
                written = {path.name for path in new.iterdir()}
                check_replaceable(folder, written)
                for name in sorted(written):
                    os.replace(new / name, folder / name)
            finally:
                scratch.remove()
        for name in older - written:
            (folder / name).unlink(missing_ok=True)
    except (OSError, MeshError) as error:
        raise HistoryError(f"{folder}: cannot write a history there: {error}") from error
    return folder


def check_replaceable(folder: Path, names: Set[str] = frozenset({ARCHIVE, SERIES, SUMMARY, *FILES.values()})) -> None:
    """Raise HistoryError where a file of one of these names is there that is not of a history."""
    told, kept = is_summary(folder / SUMMARY), is_archive(folder / ARCHIVE)
    ours = {SUMMARY} | listed_tables(folder / SUMMARY) if told else set()
    if told or kept:
        ours |= {ARCHIVE, SERIES} | listed_steps(folder / SERIES)
    for name in sorted(names - ours):
        if os.path.lexists(folder / name):
            raise HistoryError(
                f"{folder / name}: not of a history, so it is not replaced. Choose another folder, or move it away."
            )


def writable_folder(folder: str | Path) -> Path:
    """The folder, made if need be.

    Raises
    ------
    HistoryError
        It is a file, or may not be written to.
    """
    folder = path_of(folder, "write")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise HistoryError(f"{folder}: cannot be made a folder to write to: {error}") from error
    return folder


def read_results(folder: str | Path) -> Results:
    """The results in a folder: see :func:`vemcvx.read_history`."""
    where = path_of(folder, "read_history")
    if not os.path.isfile(where / ARCHIVE):
        raise HistoryError(f"{where}: {_what_is(where)}; a history is a folder with {ARCHIVE} in it.")
    return read_archive(where / ARCHIVE)


def _what_is(folder: Path) -> str:
    if os.path.isdir(folder):
        try:
            return f"found {', '.join(sorted(os.listdir(folder))[:5]) or 'nothing'}"
        except OSError as error:
            return f"found a folder that cannot be read ({error})"
    return "found a file, not a folder" if os.path.exists(folder) else "there is no such folder"
