"""The arrays that a step's program consists of, taken apart and put together again, and numbers in text, to the bit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats
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


def put_together(parts: Mapping[str, Matrix], subject: str) -> StepProgram:
    """The program of these parts; norm terms, limits or a kernel that are not there are none.

    Raises
    ------
    ProgramError
        Something is missing, of another shape than the rest, not finite, or makes no convex program.
    """
    for name in ("K", "g"):
        if name not in parts:
            raise ProgramError(f"{subject}: found no {name}; a program has {', '.join(('K', 'B', 'D', *VECTORS))}.")
    g, w, b, e, c = (np.atleast_1d(_dense(parts.get(name, np.zeros(0)))).ravel() for name in VECTORS)
    n, terms = len(g), len(w)
    try:
        K = parts["K"] if isinstance(parts["K"], np.ndarray) else checked_matrix(parts["K"], "K", (n, n))
        B = checked_matrix(parts.get("B", sp.csr_matrix((0, n))), "B", (len(b), n))
        D = checked_matrix(parts.get("D", sp.csr_matrix((0, n))), "D", (len(e), n))
        for name, x in {"K": _values(K), "g": g, "w": w, "b": b, "e": e, "c": c}.items():
            finite(x, name)
        if K.shape != (n, n) or len(c) != len(e) or (terms and len(b) % terms) or (len(b) and not terms):
            raise ProgramError(f"K {K.shape}, g {n}, w {terms}, b {len(b)}, e {len(e)} and c {len(c)} fit no program.")
        if n:
            check_symmetric(sp.csr_matrix(K), "K")
        if (w < 0).any() or (c < 0).any():
            raise ProgramError("found negative weights w or compliances c.")
        kernel, anchor = (None if name not in parts else _dense(parts[name]) for name in ("N", "anchor"))
        if kernel is not None and anchor is not None:
            kernel, anchor = kernel.reshape(n, -1), anchor.ravel()
        block = len(b) // terms if terms else 1
        operators = Operators(K=K, B=B, block=block, kernel=kernel, anchor=anchor, D=D, compliance=c)
    except (VemcvxError, np.linalg.LinAlgError) as error:
        raise ProgramError(f"{subject}: is no convex program of a step: {error}") from error
    return StepProgram(operators, g, w, b, e)


def null_motions(K: Matrix, k: int) -> Parts:
    """Of a K with so many motions in its kernel: these, and the stiffness of as many anchors."""
    if k == 0:
        return {}
    motions = np.linalg.eigh(_dense(K))[1][:, :k]
    return {"N": motions, "anchor": anchors(motions, K.diagonal())}


def _dense(x: Matrix) -> Floats:
    return x if isinstance(x, np.ndarray) else x.toarray()


def _values(K: Matrix) -> Floats:
    return K if isinstance(K, np.ndarray) else K.data


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
