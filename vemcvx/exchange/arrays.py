"""Programs as named arrays, in NPZ archives and in Matrix Market files.

A program minimises 1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i| over all d with D d <= e. If limit j, D_j d <= e_j,
has a compliance c_j > 0, the term (D_j d - e_j)_+^2 / (2 c_j) replaces it. An NPZ archive holds these arrays::

    B_data, B_indices, B_indptr, B_shape      compressed rows, as in scipy.sparse.csr_matrix((data, indices, indptr))
    D_data, ...     compressed rows of D
    K               (n, n), dense; or K_data, ... if K is sparse
    g, w, b, e, c   vectors
    N               (n, k), orthonormal basis of the kernel of K; k = 0 if K is positive definite
    d, lam, p       of a solved program: the answer d, and the multipliers
    step, t         of a solved program: number and instant of the step

A sequence is an archive of successive steps with the same K, B, D, c and N. All other arrays have one row per step.

Matrix Market has one file per array: K in NAME.mtx, B in NAME_B.mtx, and so on.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.io import mminfo, mmread, mmwrite

from vemcvx.base.archives import read_arrays
from vemcvx.base.arrays import Floats, as_array_of_shape, as_real_array, as_sparse_matrix, finite
from vemcvx.base.errors import ProgramError
from vemcvx.linear import Matrix
from vemcvx.program import Answer, Operators, SolvedProgram, StepProgram
from vemcvx.program.operators import SYMMETRY_TOLERANCE

NAMES = "K", "B", "D", "N", "g", "w", "b", "e", "c"  # The arrays of a program in every format
CSR = "data", "indices", "indptr", "shape"
CHANGING = "g", "w", "b", "e", "d", "lam", "p", "step", "t"


def arrays_of(program: StepProgram) -> dict[str, Matrix]:
    """Return the arrays of a program by name."""
    operators = program.operators
    N = np.zeros((len(program.g), 0)) if operators.kernel is None else operators.kernel
    matrices = {"K": operators.K, "B": operators.B, "D": operators.D, "N": N, "c": operators.compliance}
    return matrices | {name: getattr(program, name) for name in "gwbe"}


def program_from_arrays(parts: Mapping[str, Any]) -> StepProgram:
    """Return the program of named arrays."""
    if missing := {"K", "g"} - set(parts):
        raise ProgramError(f"found no {min(missing)}; a program has the arrays {', '.join(NAMES)}, at least K and g.")
    g, w, b, e, c = (_vector(parts.get(name, np.zeros(0)), name) for name in "gwbec")
    if (w < 0).any():
        raise ProgramError(f"found the weight {w.min():.6g} in w; wanted weights >= 0.")
    K, N = parts["K"], np.asarray(parts.get("N", np.zeros((len(g), 0))))
    if N.ndim != 2 or len(N) != len(g) or N.shape[1] > len(g) or K.shape != (len(g), len(g)):
        raise ProgramError(f"found K of shape {K.shape} and N of shape {N.shape}; g has {len(g)} unknowns.")
    if np.abs(K @ finite(N, "N")).max(initial=0.0) > SYMMETRY_TOLERANCE * abs(K).max():
        raise ProgramError("found N that is not in the kernel of K: K N is not zero.")
    block, kernel = len(b) // len(w) if len(w) else 1, N if N.shape[1] else None
    operators = Operators(K, parts.get("B"), block=block, kernel=kernel, D=parts.get("D"), compliance=c)
    return StepProgram(operators, g, w, b, e)


def _vector(raw: Any, name: str) -> Floats:
    return finite(as_real_array(raw, name, "an array of real numbers").ravel(), name)


def matrix_with_kernel(K: sp.csr_matrix, count: int) -> dict[str, Matrix]:
    """Return K, and a kernel basis N with `count` columns."""
    stiffness: Matrix = K.toarray() if K.nnz > 0.5 * K.shape[0] ** 2 else sp.csr_matrix(K)
    return {"K": stiffness, "N": np.linalg.eigh(K.toarray())[1][:, :count]} if count else {"K": stiffness}


def to_npz(program: StepProgram) -> dict[str, bytes]:
    """Return the contents of an archive, as {suffix: bytes}."""
    made = io.BytesIO()
    np.savez(made, **_arrays(program))
    return {".npz": made.getvalue()}


def sequence_to_npz(programs: Sequence[SolvedProgram]) -> dict[str, bytes]:
    """Return an archive of successive programs, as {suffix: bytes}."""
    each, made = [_arrays(program) for program in programs], io.BytesIO()
    np.savez(made, **{**each[0], **{name: np.stack([arrays[name] for arrays in each]) for name in CHANGING}})
    return {".npz": made.getvalue()}


def _arrays(program: StepProgram) -> dict[str, Any]:
    arrays: dict[str, Any] = {}
    for name, part in arrays_of(program).items():
        arrays |= {name: part} if isinstance(part, np.ndarray) else {f"{name}_{k}": getattr(part, k) for k in CSR}
    if isinstance(program, SolvedProgram):
        answer = program.answer
        arrays |= {"d": answer.d, "lam": answer.lam, "p": answer.p, "step": program.step, "t": program.t}
    return arrays


def from_npz(path: Path) -> StepProgram:
    """Return the first program of an archive."""
    return sequence_from_npz(path)[0]


def sequence_from_npz(path: Path) -> list[StepProgram]:
    """Return all programs of an archive."""
    kept = read_arrays(path)
    steps = [kept]
    if kept.get("g", np.zeros(0)).ndim == 2:
        steps = [{**kept, **{name: kept[name][k] for name in CHANGING}} for k in range(len(kept["g"]))]
    matrices = {name: _read_compressed(kept, name) for name in "KBD" if f"{name}_data" in kept}
    first = program_from_arrays({**steps[0], **matrices})
    vectors = [[_vector(arrays[name], name) for name in "gwbe"] for arrays in steps[1:]]
    every = [first, *(StepProgram(first.operators, *one) for one in vectors)]
    return [_attach_answer(program, arrays) for program, arrays in zip(every, steps, strict=True)]


def _read_compressed(kept: Mapping[str, Any], name: str) -> sp.csr_matrix:
    """Return a matrix from compressed rows, after checks of indices."""
    data, indices, indptr, shape = (kept[f"{name}_{k}"] for k in CSR)
    return as_sparse_matrix(sp.csr_matrix((data, indices, indptr), shape=tuple(shape.tolist())), name)


def _attach_answer(program: StepProgram, kept: Mapping[str, Any]) -> StepProgram:
    if "d" not in kept:
        return program
    shapes: dict[str, tuple[int, ...]] = {**program.shapes, "step": (), "t": ()}
    d, lam, p, step, t = (finite(as_array_of_shape(kept[name], name, shape), name) for name, shape in shapes.items())
    answer = Answer(d, lam, 0, "read from a file", p=p)
    return SolvedProgram(program.operators, *program.data, answer=answer, step=int(step), t=float(t))


def to_matrix_market(program: StepProgram) -> dict[str, bytes]:
    """Return the files as {suffix: bytes}, with the suffixes ".mtx" for K, "_B.mtx" for B, and so on."""
    made = {}
    for name, part in arrays_of(program).items():
        file = io.BytesIO()
        matrix = part[:, None] if isinstance(part, np.ndarray) and part.ndim == 1 else part
        mmwrite(file, matrix, precision=17, symmetry=None if name == "K" else "general")
        made[".mtx" if name == "K" else f"_{name}.mtx"] = file.getvalue()
    return made


def from_matrix_market(path: Path) -> StepProgram:
    """Read a program from the file of K, and from the files of the other arrays."""
    places = {name: path if name == "K" else path.with_name(f"{path.stem}_{name}.mtx") for name in NAMES}
    return program_from_arrays({name: read_matrix(place, name) for name, place in places.items() if place.exists()})


def read_matrix(path: Path, name: str) -> Matrix:
    """Return the matrix of a file, dense or sparse as stored."""
    data = path.read_bytes()
    # SciPy's reader (1.17) crashes on truncated numbers, zero bytes and empty arrays.
    if not data.endswith(b"\n") or b"\0" in data:
        raise ProgramError(f"{name}: the file is cut short or is no text; its last line must be complete.")
    try:
        rows, columns, entries, _, field, symmetry = mminfo(io.BytesIO(data))
        # A wrong size in the header must not exhaust memory.
        large = max(rows, columns, entries) > max(2**20, len(data))
        if field == "complex" or large or (symmetry != "general" and rows != columns):
            raise ValueError(f"found {rows} rows, {columns} columns and {entries} {field} entries, {symmetry}")
        found = mmread(io.BytesIO(data)) if rows and columns else np.zeros((rows, columns))
    except (ValueError, OverflowError) as error:
        raise ProgramError(f"{name}: this is no Matrix Market file of a real matrix: {error}.") from error
    return found.astype(float) if isinstance(found, np.ndarray) else sp.csr_matrix(found, dtype=float)
