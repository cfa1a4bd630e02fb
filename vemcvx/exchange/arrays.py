"""Programs as named arrays: taken apart and put together, as NPZ archives and as Matrix Market files.

An NPZ archive holds every array to the bit, and the certified answer where it is known:

    K               (n, n), dense; or, sparse, as B and D
    B_data, B_indices, B_indptr, B_shape      compressed rows, as in scipy.sparse.csr_matrix((data, indices, indptr))
    g, w, b, e, c   vectors, c the compliances; N, anchor where K has a kernel; d, lam, p, step, t of an answer

Of a sequence, the programs of successive steps with the same matrices, these are there once, and all that changes, g,
w, b, e and answers, has one axis more, the first: its row k is that of the k-th step.

Matrix Market has one file an array, named as in the SuiteSparse collection: K in NAME.mtx, B in NAME_B.mtx, ... Arrays
without entries have no file, and one that another program of that name left is removed.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.io import mminfo, mmread, mmwrite

from vemcvx.base.archives import read_arrays
from vemcvx.base.arrays import Floats, as_real_array, check_compressed, checked_matrix, finite, of_shape
from vemcvx.base.errors import ProgramError, VemcvxError
from vemcvx.linear import Matrix
from vemcvx.program.kernel import anchors
from vemcvx.program.operators import Operators, check_symmetric
from vemcvx.program.step_program import Answer, SolvedProgram, StepProgram

Parts = dict[str, Matrix]
SIZES = {
    **{"K": ("n", "n"), "B": ("rows", "n"), "D": ("limits", "n"), "g": ("n",), "w": ("terms",), "b": ("rows",)},
    **{"e": ("limits",), "c": ("limits",), "N": ("n", "motions"), "anchor": ("n",)},
}
"""The arrays of a program in every format, and names of their sizes; b has a block of rows a term."""


def parts_of(program: StepProgram) -> Parts:
    """Return the arrays of a program; N and the stiffness of anchors there are where K has a kernel."""
    of = program.operators
    parts = {"K": of.K, "B": of.B, "D": of.D, "c": of.compliance, "N": of.kernel, "anchor": of.anchor}
    parts |= {name: getattr(program, name) for name in "gwbe"}
    return {name: part for name in SIZES if (part := parts[name]) is not None}


def put_together(parts: Mapping[str, Matrix]) -> StepProgram:
    """The program of these parts; norm terms, limits or a kernel that are not there are none.

    ProgramError where something is missing, of another shape than the rest, not finite, or makes no convex program.
    """
    for name in ("K", "g"):
        if name not in parts:
            raise ProgramError(
                f"found no {name}; a program has {', '.join(name for name in SIZES if len(name) == 1 and name != 'N')}."
            )
    try:
        g, w, b, e, c = (_array(parts, name).ravel() for name in "gwbec")
        n, terms = len(g), len(w)
        sizes = {"n": n, "rows": len(b), "limits": len(e)}
        wanted = {name: (sizes[SIZES[name][0]], n) for name in "KBD"}
        shapes = {name: parts[name].shape for name in "KBD" if name in parts}
        fits = all(shape == wanted[name] for name, shape in shapes.items()) and len(c) == len(e)
        if not fits or (terms and len(b) % terms) or (len(b) and not terms):
            found = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
            raise ProgramError(f"{found}, g {n}, w {terms}, b {len(b)}, e {len(e)} and c {len(c)} fit no program.")
        K = _array(parts, "K") if isinstance(parts["K"], np.ndarray) else checked_matrix(parts["K"], "K")
        B, D = (checked_matrix(parts.get(name, sp.csr_matrix(wanted[name])), name) for name in "BD")
        if n:
            check_symmetric(sp.csr_matrix(K), "K")
        if (w < 0).any() or (c < 0).any():
            raise ProgramError("found negative weights w or compliances c.")
        kernel, anchor = (_array(parts, name) if name in parts else None for name in ("N", "anchor"))
        if kernel is not None and anchor is not None:
            anchor = anchor.ravel()
            if kernel.ndim != 2 or not len(kernel) == len(anchor) == n or kernel.shape[1] > n:
                raise ProgramError(f"N {kernel.shape} and anchor {anchor.shape} are no motions of {n} unknowns.")
        block = len(b) // terms if terms else 1
        operators = Operators(K=K, B=B, block=block, kernel=kernel, anchor=anchor, D=D, compliance=c)
    except (VemcvxError, np.linalg.LinAlgError) as error:
        raise ProgramError(f"is no convex program of a step: {error}") from error
    return StepProgram(operators, g, w, b, e)


def compressed_rows(name: str, data: Any, indices: Any, indptr: Any, shape: Any) -> sp.csr_matrix:
    """A matrix of compressed rows that a file claims to hold: SciPy's own code reads and writes where they lead.

    ProgramError where arrays are of other kinds or lengths, or lead out of the matrix.
    """
    whole = all(np.ndim(x) == 1 and np.asarray(x).dtype.kind in "iu" for x in (indices, indptr, shape))
    if not whole or np.ndim(data) != 1 or len(shape) != 2 or min(shape) < 0:
        raise ProgramError(f"{name}: found no numbers, columns, ends of rows and shape, as lists of them.")
    try:
        rows: sp.csr_matrix = sp.csr_matrix((data, indices, indptr), shape=tuple(np.asarray(shape).tolist()))
        check_compressed(rows)
    except (ValueError, OverflowError) as error:
        raise ProgramError(f"{name}: found rows that lead out of the matrix: {error}.") from error
    return rows


def with_motions(K: sp.csr_matrix, k: int) -> Parts:
    """K, dense if most of it is, with the `k` motions in its kernel and the stiffness of as many anchors."""
    n = K.shape[0]
    stiffness = K.toarray() if K.nnz > 0.5 * n * n else sp.csr_matrix(K)
    if k == 0:
        return {"K": stiffness}
    if not 0 < k <= n:
        raise ProgramError(f"found {k} motions in the kernel of K, which has {n} unknowns.")
    motions = np.linalg.eigh(K.toarray())[1][:, :k]
    return {"K": stiffness, "N": motions, "anchor": anchors(motions, K.diagonal())}


def _array(parts: Mapping[str, Matrix], name: str) -> Floats:
    """A part that is no sparse matrix, of finite numbers."""
    part, wanted = parts.get(name, np.zeros(0)), "an array of real numbers"
    if sp.issparse(part):
        raise ProgramError(f"{name}: found a sparse matrix; wanted {wanted}.")
    return finite(np.atleast_1d(as_real_array(part, name, wanted)), name)


CSR = "data", "indices", "indptr", "shape"
CHANGING = "g", "w", "b", "e", "d", "lam", "p", "step", "t"
"""What is different from step to step of a sequence."""


def to_npz(program: StepProgram) -> dict[str, bytes]:
    """The archive, under its suffix."""
    made = io.BytesIO()
    np.savez(made, **_arrays(program))
    return {".npz": made.getvalue()}


def sequence_to_npz(programs: Sequence[SolvedProgram]) -> dict[str, bytes]:
    """The archive of the programs of successive steps, which have the same operators, under its suffix."""
    each, made = [_arrays(program) for program in programs], io.BytesIO()
    np.savez(made, **{**each[0], **{name: np.stack([arrays[name] for arrays in each]) for name in CHANGING}})
    return {".npz": made.getvalue()}


def _arrays(program: StepProgram) -> dict[str, Any]:
    arrays: dict[str, Any] = {}
    for name, part in parts_of(program).items():
        arrays |= {name: part} if isinstance(part, np.ndarray) else {f"{name}_{k}": getattr(part, k) for k in CSR}
    if isinstance(program, SolvedProgram):
        answer = program.answer
        arrays |= {"d": answer.d, "lam": answer.lam, "p": answer.p, "step": program.step, "t": program.t}
    return arrays


def sequence_from_npz(path: Path) -> list[StepProgram]:
    """The programs of a sequence; one alone of any other archive."""
    kept = read_arrays(path)
    if "g" not in kept or kept["g"].ndim != 2:
        return [_program(kept)]
    every = [{**kept, **{name: kept[name][k] for name in CHANGING}} for k in range(len(kept["g"]))]
    first = _program(every[0])
    return [first, *(_program(arrays, first.operators) for arrays in every[1:])]


def from_npz(path: Path) -> StepProgram:
    """The program, solved if the file has the answer."""
    return _program(read_arrays(path))


def _program(kept: Mapping[str, Any], operators: Operators | None = None) -> StepProgram:
    """The program of these arrays; with operators that are known, its vectors are those of another one."""
    if operators is not None:
        program = StepProgram(operators, *(finite(as_real_array(kept[x], x, "numbers"), x) for x in "gwbe"))
    else:
        parts: Parts = {name: kept[name] for name in SIZES if name in kept}
        for name in "KBD":
            members = [f"{name}_{k}" for k in CSR]
            missing = [member for member in members if member not in kept]
            if 0 < len(missing) < len(CSR):
                raise ProgramError(f"found no {missing[0]}; a sparse {name} has {', '.join(members)}.")
            if not missing:
                parts[name] = compressed_rows(name, *(kept[member] for member in members))
        program = put_together(parts)
    if "d" not in kept:
        return program
    shapes: dict[str, tuple[int, ...]] = {**program.shapes, "step": (), "t": ()}
    missing = [name for name in shapes if name not in kept]
    if missing:
        raise ProgramError(f"found no {missing[0]}; an answer has {', '.join(shapes)}.")
    d, lam, p, step, t = (finite(of_shape(kept[name], name, shape), name) for name, shape in shapes.items())
    return SolvedProgram.of(program, Answer(d, lam, 0, "read from a file", p=p), int(step), float(t))


def to_matrix_market(program: StepProgram) -> dict[str, bytes | None]:
    """The files, under the ends of their names; None of those that are not to be there."""
    made: dict[str, bytes | None] = {f"_{name}.mtx": None for name in SIZES if name != "K"}
    for name, part in parts_of(program).items():
        rows = part.shape[0]
        if rows:
            file = io.BytesIO()
            matrix = part.reshape(rows, -1) if isinstance(part, np.ndarray) else part
            mmwrite(file, matrix, precision=17, symmetry=None if name == "K" else "general")
            made[".mtx" if name == "K" else f"_{name}.mtx"] = file.getvalue()
    return made


def from_matrix_market(path: Path) -> StepProgram:
    """The program of the file of K and those beside it."""
    parts: Parts = {"K": read_matrix(path, "K")}
    for name in SIZES:
        beside = path.with_name(f"{path.stem}_{name}.mtx")
        if name != "K" and beside.exists():
            parts[name] = read_matrix(beside, name)
    return put_together(parts)


def read_matrix(path: Path, name: str) -> Matrix:
    """The matrix of a file, dense where it is an array, sparse where it is a list of entries.

    ProgramError where it is cut short or damaged, claims more than it has room for, or is of no real matrix.
    """
    data = path.read_bytes()
    # SciPy's reader (1.17) ends the process where a file ends, or has a zero byte, in the middle of a number.
    if not data.endswith(b"\n") or b"\0" in data:
        raise ProgramError(f"{name}: is cut short, or no text; its last line must be whole.")
    try:
        rows, columns, entries, form, field, symmetry = mminfo(io.BytesIO(data))
        if form == "array":
            half = {"symmetric": rows * (rows + 1) // 2, "skew-symmetric": rows * (rows - 1) // 2}
            count = 2 + half.get(symmetry, entries)
        else:
            count = 3 + entries * (2 if field == "pattern" else 3)
        # It ignores what follows a number on its line.
        words = b" ".join(line for line in data.splitlines()[1:] if not line.startswith(b"%")).split()
        if field == "complex" or len(words) != count or re.search(rb"[^\d.eE+-]", b"".join(words)):
            raise ValueError(f"found {len(words)} words; a {field} {form} of {rows} x {columns} has {count} numbers")
        # A number in the header shall not take memory that the file does not: a million rows may all be empty.
        if max(rows, columns) > max(2**20, len(data)):
            raise ValueError(f"found {rows} rows, {columns} columns and {entries} entries")
        found = mmread(io.BytesIO(data))
    except (ValueError, OverflowError) as error:
        raise ProgramError(f"{name}: is no Matrix Market file of a real matrix: {error}.") from error
    return found.astype(float) if isinstance(found, np.ndarray) else sp.csr_matrix(found, dtype=float)
