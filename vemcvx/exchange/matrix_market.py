"""Matrix Market, one file an array, named as in the SuiteSparse collection: K in NAME.mtx, B in NAME_B.mtx, ...

Arrays without entries have no file: a program without NAME_B.mtx has no norm terms, without NAME_D.mtx no limits. (What
another program of that name left is removed.)
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from scipy.io import mmread, mmwrite

from vemcvx.exchange.parts import Parts, parts_of, put_together
from vemcvx.linear import Matrix
from vemcvx.program.step_program import StepProgram

OTHERS = "B", "D", "g", "w", "b", "e", "c", "N", "anchor"
DIGITS = 17


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
    parts: Parts = {"K": _read(path)}
    for name in OTHERS:
        beside = path.with_name(f"{path.stem}_{name}.mtx")
        if beside.exists():
            parts[name] = _read(beside)
    return put_together(parts, str(path))


def _read(path: Path) -> Matrix:
    found = mmread(path)
    return np.asarray(found, dtype=float) if isinstance(found, np.ndarray) else sp.csr_matrix(found)
