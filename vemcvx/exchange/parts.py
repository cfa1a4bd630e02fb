"""The arrays that a step's program consists of, taken apart and put together again, and numbers in text, to the bit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, as_real_array
from vemcvx.errors import ProgramError, VemcvxError
from vemcvx.linear import Matrix
from vemcvx.program.checks import check_symmetric, checked_matrix, finite
from vemcvx.program.kernel import anchors
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import StepProgram

Parts = dict[str, Matrix]
VECTORS = "g", "w", "b", "e", "c"


def parts_of(program: StepProgram) -> Parts:
    """K, B, D, g, w, b, e, and c the compliances; with a kernel also N, its motions, and the anchors' stiffness."""
    operators = program.operators
    parts: Parts = {"K": operators.K, "B": operators.B, "D": operators.D}
    parts |= {"g": program.g, "w": program.w, "b": program.b, "e": program.e, "c": operators.compliance}
    if operators.kernel is not None and operators.anchor is not None:
        parts |= {"N": operators.kernel, "anchor": operators.anchor}
    return parts


def put_together(parts: Mapping[str, Matrix]) -> StepProgram:
    """The program of these parts; norm terms, limits or a kernel that are not there are none.

    Raises
    ------
    ProgramError
        Something is missing, of another shape than the rest, not finite, or makes no convex program.
    """
    for name in ("K", "g"):
        if name not in parts:
            raise ProgramError(f"found no {name}; a program has {', '.join(('K', 'B', 'D', *VECTORS))}.")
    try:
        g, w, b, e, c = (_array(parts, name).ravel() for name in VECTORS)
        n, terms = len(g), len(w)
        rows = {"K": n, "B": len(b), "D": len(e)}
        shapes = {name: parts[name].shape for name in rows if name in parts}
        fits = all(shape == (rows[name], n) for name, shape in shapes.items())
        if not fits or len(c) != len(e) or (terms and len(b) % terms) or (len(b) and not terms):
            found = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
            raise ProgramError(f"{found}, g {n}, w {terms}, b {len(b)}, e {len(e)} and c {len(c)} fit no program.")
        K = _array(parts, "K") if isinstance(parts["K"], np.ndarray) else checked_matrix(parts["K"], "K")
        B, D = (checked_matrix(parts.get(name, sp.csr_matrix((rows[name], n))), name) for name in "BD")
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

    Raises
    ------
    ProgramError
        The arrays are of other kinds or lengths, or lead out of the matrix.
    """
    whole = all(np.ndim(x) == 1 and np.asarray(x).dtype.kind in "iu" for x in (indices, indptr, shape))
    if not whole or np.ndim(data) != 1 or len(shape) != 2 or min(shape) < 0:
        raise ProgramError(f"{name}: found no numbers, columns, ends of rows and shape, as lists of them.")
    try:
        rows: sp.csr_matrix = sp.csr_matrix((data, indices, indptr), shape=tuple(np.asarray(shape).tolist()))
        rows.check_format(full_check=True)
    except (ValueError, OverflowError) as error:
        raise ProgramError(f"{name}: found rows that lead out of the matrix: {error}.") from error
    return rows


def null_motions(K: Matrix, k: int) -> Parts:
    """Of a K with so many motions in its kernel: these, and the stiffness of as many anchors."""
    if k == 0:
        return {}
    if not 0 < k <= len(K.diagonal()):
        raise ProgramError(f"found {k} motions in the kernel of K, which has {len(K.diagonal())} unknowns.")
    motions = np.linalg.eigh(K if isinstance(K, np.ndarray) else K.toarray())[1][:, :k]
    return {"N": motions, "anchor": anchors(motions, K.diagonal())}


def _array(parts: Mapping[str, Matrix], name: str) -> Floats:
    """A part that is no sparse matrix, of finite numbers."""
    part, wanted = parts.get(name, np.zeros(0)), "an array of real numbers"
    if sp.issparse(part):
        raise ProgramError(f"{name}: found a sparse matrix; wanted {wanted}.")
    return finite(np.atleast_1d(as_real_array(part, name, wanted)), name)


def number(x: float) -> str:
    """The shortest words that read as this number."""
    return repr(float(x))


def triplets(rows: sp.csr_matrix) -> Iterator[tuple[int, int, float]]:
    """Row, column and value of the entries that are not zero, row by row."""
    rows.sort_indices()
    coo = rows.tocoo()
    for i, j, x in zip(coo.row.tolist(), coo.col.tolist(), coo.data.tolist(), strict=True):
        if x:
            yield i, j, x
