"""Matrix Market, one file an array, named as in the SuiteSparse collection: K in NAME.mtx, B in NAME_B.mtx, ...

Arrays without entries have no file: a program without NAME_B.mtx has no norm terms, without NAME_D.mtx no limits. (What
another program of that name left is removed.) Files are read here and not by SciPy, whose reader ends the process
(1.17: SIGSEGV) where a file ends in the middle of a number.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from scipy.io import mmwrite

from vemcvx.arrays import Floats
from vemcvx.errors import ProgramError
from vemcvx.exchange.parts import Parts, parts_of, put_together
from vemcvx.linear import Matrix
from vemcvx.program.step_program import StepProgram

OTHERS = "B", "D", "g", "w", "b", "e", "c", "N", "anchor"
DIGITS = 17
EMPTY = 2**20
"""Rows that may all be empty: a number in the header shall not take memory that the file does not."""
HEAD = re.compile(
    r"%%MatrixMarket\s+matrix\s+(coordinate|array)\s+(real|double|integer|unsigned-integer|pattern)\s+"
    r"(general|symmetric|skew-symmetric)\s*",
    re.IGNORECASE,
)


def to_matrix_market(program: StepProgram) -> dict[str, bytes | None]:
    """The files, under the ends of their names; None of those that are not to be there."""
    made: dict[str, bytes | None] = {f"_{name}.mtx": None for name in OTHERS}
    for name, part in parts_of(program).items():
        rows = part.shape[0]
        if rows:
            file = io.BytesIO()
            matrix = part.reshape(rows, -1) if isinstance(part, np.ndarray) else part
            mmwrite(file, matrix, precision=DIGITS, symmetry=None if name == "K" else "general")
            made[".mtx" if name == "K" else f"_{name}.mtx"] = file.getvalue()
    return made


def from_matrix_market(path: Path) -> StepProgram:
    """The program of the file of K and those beside it."""
    parts: Parts = {"K": read_matrix(path, "K")}
    for name in OTHERS:
        beside = path.with_name(f"{path.stem}_{name}.mtx")
        if beside.exists():
            parts[name] = read_matrix(beside, name)
    return put_together(parts)


def read_matrix(path: Path, name: str) -> Matrix:
    """The matrix of a file, dense where it is an array, sparse where it is a list of entries.

    Raises
    ------
    ProgramError
        The header or the sizes are of no real matrix, lines are missing or too many, or some hold no numbers.
    """
    lines = path.read_bytes().decode("latin-1").splitlines(keepends=True)
    head = HEAD.fullmatch(lines[0]) if lines else None
    if head is None:
        raise ProgramError(
            f"{name}: found the first line {lines[0].strip()[:60] if lines else ''!r}; wanted '%%MatrixMarket matrix', "
            "coordinate or array, real, integer or pattern, and general, symmetric or skew-symmetric."
        )
    form, field, symmetry = (word.lower() for word in head.groups())
    said = [line for line in lines[1:] if line.strip() and not line.startswith("%")]
    sizes = said[0].split() if said else []
    if len(sizes) != (2 if form == "array" else 3) or not all(size.isdecimal() and len(size) < 19 for size in sizes):
        raise ProgramError(f"{name}: found the sizes {' '.join(sizes)[:60]!r}; wanted those of {form}s, whole numbers.")
    rows, columns, *entries = map(int, sizes)
    if symmetry != "general" and rows != columns:
        raise ProgramError(f"{name}: found a {symmetry} matrix of {rows} rows and {columns} columns; wanted as many.")
    if form == "array":
        above = rows * (rows - 1) // 2
        count = {"general": rows * columns, "symmetric": above + rows, "skew-symmetric": above}[symmetry]
        return _dense(_numbers(name, said[1:], count, 1)[:, 0], rows, columns, symmetry)
    return _sparse(name, _numbers(name, said[1:], entries[0], 2 if field == "pattern" else 3), rows, columns, symmetry)


def _numbers(name: str, lines: list[str], count: int, width: int) -> Floats:
    """As many lines of numbers as the header announces."""
    if len(lines) != count or (lines and not lines[-1].endswith("\n")):
        cut = "" if not lines or lines[-1].endswith("\n") else ", the last one cut short"
        raise ProgramError(f"{name}: found {len(lines)} lines of numbers{cut}; announced are {count} whole ones.")
    if count == 0:
        return np.zeros((0, width))
    try:
        numbers: Floats = np.loadtxt(lines, ndmin=2, comments=None)
    except ValueError as error:
        raise ProgramError(f"{name}: some line is not of {width} numbers: {error}.") from error
    if numbers.shape[1] != width:
        raise ProgramError(f"{name}: found lines of {numbers.shape[1]} numbers; wanted {width}.")
    return numbers


def _dense(values: Floats, rows: int, columns: int, symmetry: str) -> Floats:
    """Column by column; of a symmetric matrix from the diagonal down, of a skew one from below it."""
    if symmetry == "general":
        return values.reshape(columns, rows).T.copy()
    full = np.zeros((rows, rows))
    j, i = np.triu_indices(rows, 1 if symmetry == "skew-symmetric" else 0)
    full[j, i] = -values if symmetry == "skew-symmetric" else values
    full[i, j] = values
    return full


def _sparse(name: str, entries: Floats, rows: int, columns: int, symmetry: str) -> sp.csr_matrix:
    """By rows, columns and, but of patterns, values; of symmetric matrices one of each pair is listed."""
    places, values = entries[:, :2], np.append(entries, np.ones((len(entries), 1)), axis=1)[:, 2]
    outside = ((places != np.floor(places)) | (places < 1) | (places > (rows, columns))).any(axis=1)
    if outside.any():
        i, j = places[outside][0]
        raise ProgramError(f"{name}: found an entry at ({i:g}, {j:g}) of {rows} rows and {columns} columns.")
    if rows > max(EMPTY, len(entries)):
        raise ProgramError(f"{name}: found {rows} rows and {len(entries)} entries; wanted no row without an entry.")
    at = places.astype(np.int64) - 1
    if symmetry != "general":
        apart, sign = at[:, 0] != at[:, 1], -1.0 if symmetry == "skew-symmetric" else 1.0
        at, values = np.concatenate([at, at[apart, ::-1]]), np.append(values, sign * values[apart])
    return sp.csr_matrix((values, at.T), shape=(rows, columns))
