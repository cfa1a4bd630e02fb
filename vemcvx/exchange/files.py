"""Programs written and read by the suffix of the file; a JSON of the same name beside it says what it is.

=======  ============================================================  ======================================
.npz     NumPy's archive, the certified answer included                every program, to the bit
.mtx     Matrix Market, K in NAME.mtx, B in NAME_B.mtx, ...            every program, to the bit
.cbf     Conic Benchmark Format, the energy as one more cone           every program; K = F'F with its rounding
.hdf5    FCLIB's local problem (extra ``fclib``); of all unknowns its    steps with Coulomb's law; cannot be read back
         global one
.qps     MPS with a quadratic objective; .mps for HiGHS, which goes    absolute values, bounds, soft limits
         by the suffix
=======  ============================================================  ======================================

The JSON has where a program comes from, its size, how hard it is, and its certified optimum.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigsh

from vemcvx.base.arrays import Floats, brief
from vemcvx.base.errors import ProgramError, VemcvxError
from vemcvx.base.owned_files import path_of
from vemcvx.base.version import __version__
from vemcvx.exchange.arrays import from_matrix_market, from_npz, to_matrix_market, to_npz
from vemcvx.exchange.cbf_and_qps import from_cbf, from_qps, to_cbf, to_qps
from vemcvx.exchange.fclib import from_fclib, to_fclib
from vemcvx.program.certificate import BOUND_ROUNDING
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import SolvedProgram, StepProgram

FORMAT = "vemcvx program 1"
STATEMENT = (
    "minimise 1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i| subject to D d <= e; where a compliance c_j > 0, with "
    "(D_j d - e_j)_+^2 / (2 c_j) in place of the bound. K d = g - B'lam - D'p, |lam_i| <= w_i, p >= 0. "
    "For any such d, lam, p: 1/2 |d - d*|_K^2 <= gap."
)


def description(program: StepProgram) -> dict[str, Any]:
    """The words and numbers, as JSON takes them."""
    operators = program.operators
    matrices = {"K": sp.csr_matrix(operators.K), "B": operators.B, "D": operators.D}
    found: dict[str, Any] = {
        "format": FORMAT,
        "version": __version__,
        "program": STATEMENT,
        "unknowns": len(program.g),
        "norm_terms": operators.count,
        "block": operators.block,
        "limits": len(program.e),
        "soft_limits": int((operators.compliance > 0).sum()),
        "kernel": 0 if operators.kernel is None else operators.kernel.shape[1],
        "nonzeros": {name: int(np.count_nonzero(matrix.data)) for name, matrix in matrices.items()},
        "features": sorted(operators.features),
        "condition": condition(operators),
    }
    if isinstance(program, SolvedProgram):
        found |= {"origin": dict(program.origin), "step": program.step, "t": program.t}
        certificate, (low, high) = program.certificate, program.bounds
        optimum = {"value": program.objective(program.answer.d), "low": low, "high": high, "gap": certificate.gap}
        optimum |= {"rounding_floor": certificate.floor, "energy_error": certificate.error, "energy_norm": program.norm}
        found |= {"optimum": optimum, "degenerate": degenerate(program)}
    return found


def degenerate(program: SolvedProgram) -> dict[str, int]:
    """The numbers of norm terms at rest and at their bound at once, and of limits that touch without force.

    That is, |s_i| and w_i - |lam_i|, or |z_j| and p_j, are zero but for what the certificate leaves open:
    |s_i - s_i*| <= (B_i K^{-1} B_i')^{1/2} |d - d*|_K, and forces likewise, with B_i K B_i' / |B_i|^4.
    """
    operators, d = program.operators, program.answer.d
    error = program.certificate.error + program.certificate.error_floor
    slip, excess = np.linalg.norm(program.slip(d), axis=1), np.abs(program.excess(d))
    still = slip <= error * np.sqrt(operators.norm_flexibility)
    meets = excess <= error * np.sqrt(operators.limit_flexibility)
    blocks = operators.blocks(_push(operators, operators.B)).max(axis=1, initial=0.0)
    full = program.w - np.linalg.norm(program.answer.lam, axis=1) <= error * blocks + BOUND_ROUNDING * program.w
    idle = program.answer.p <= error * _push(operators, operators.D)
    return {"norm_terms": int((still & full).sum()), "limits": int((meets & idle).sum())}


def _push(operators: Operators, rows: sp.csr_matrix) -> Floats:
    """(k,) the most that a force along each row may change with d, per unit of |d|_K."""
    square = np.asarray(rows.multiply(rows).sum(axis=1)).ravel()
    work = np.asarray(rows.multiply((operators.K @ rows.T).T).sum(axis=1)).ravel()
    push: Floats = np.sqrt(np.maximum(work, 0.0)) / np.where(square > 0, square, 1.0)
    return push


def condition(operators: Operators) -> float | None:
    """The largest over the least eigenvalue of K, the kernel's left out; None where there is no unknown.

    All eigenvalues are computed up to 600 unknowns; beyond, the two to a thousandth.
    """
    K, n = operators.K, len(operators.K.diagonal())
    if n == 0:
        return None
    if n <= 600:
        values = np.linalg.eigvalsh(K if isinstance(K, np.ndarray) else K.toarray())
        k = 0 if operators.kernel is None else operators.kernel.shape[1]
        return float(values[-1] / values[k])
    if operators.kernel is not None:
        return None
    start, inverse = np.ones(n), LinearOperator((n, n), matvec=operators.factor.solve, dtype=float)
    largest, least = (eigsh(A, k=1, v0=start, return_eigenvectors=False, tol=1e-3)[0] for A in (K, inverse))
    return float(largest * least)


Files = Mapping[str, bytes | None]
"""Contents of files under the ends of their names; None of those that are to be removed."""
Format = tuple[Callable[[StepProgram], Files], Callable[[Path], StepProgram]]
FORMATS: dict[str, Format] = {
    "npz": (to_npz, from_npz),
    "mtx": (to_matrix_market, from_matrix_market),
    "cbf": (to_cbf, from_cbf),
    "qps": (to_qps, from_qps),
    "mps": (partial(to_qps, suffix=".mps"), from_qps),
    "hdf5": (to_fclib, from_fclib),
}


def write_program(program: StepProgram, path: str | Path) -> Path:
    """Write a program in the format that the suffix names, and a JSON beside it; folders are made, files replaced.

    Parameters
    ----------
    program : StepProgram
        One that is solved says its certified optimum in the JSON, and its answer in an NPZ.
    path : str or Path
        NAME.npz, NAME.mtx, NAME.cbf, NAME.qps, NAME.mps or NAME.hdf5: see :mod:`vemcvx.exchange.files`.

    Returns
    -------
    Path
        That of the file; all others begin with the same name.

    Raises
    ------
    ProgramError
        There is no such format, it cannot hold the program, or the files cannot be written.
    """
    place, name = _place(path)
    put(encoded(program, name), lambda end: place if end == f".{name}" else place.with_name(place.stem + end))
    return place


def put(files: Files, place: Callable[[str], Path]) -> None:
    """Write files, or remove those that are not to be there; `place` says where each is."""
    for end, data in files.items():
        path = place(end)
        try:
            if data is None:
                path.unlink(missing_ok=True)
            else:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(data)
        except OSError as error:
            raise ProgramError(f"{path}: cannot be written: {error}.") from error


def encoded(program: StepProgram, name: str) -> Files:
    """The files of a format, under what follows NAME in theirs."""
    if not isinstance(program, StepProgram):
        raise ProgramError(f"write_program: found {brief(program)}; wanted a StepProgram, as history.program(n) is.")
    if len(program.g) == 0:
        raise ProgramError("write_program: the program has no unknowns left; take condense=False, --no-condense.")
    return {**FORMATS[name][0](program), ".json": in_json(description(program))}


def in_json(words: Mapping[str, Any]) -> bytes:
    """Words and numbers as a JSON file."""
    text = json.dumps(words, indent=1, default=lambda x: x.item() if isinstance(x, np.generic) else str(x))
    return f"{text}\n".encode()


def read_program(path: str | Path) -> StepProgram:
    """Read a program that :func:`write_program` wrote; solved, with its answer, if the file is an NPZ that has one.

    Raises
    ------
    ProgramError
        There is no such file, or it holds no such program.
    """
    place, name = _place(path)
    if not place.is_file():
        raise ProgramError(f"{place}: there is no such file.")
    try:
        return FORMATS[name][1](place)
    except VemcvxError as error:
        raise ProgramError(f"{place}: {error}") from error
    except Exception as error:  # damage shows as whatever numpy, zipfile or scipy stumble over
        raise ProgramError(f"{place}: is damaged, or no .{name} file: {error}.") from error


def _place(path: str | Path) -> tuple[Path, str]:
    place = path_of(path, "program")
    name = place.suffix.removeprefix(".").lower()
    if name not in FORMATS:
        raise ProgramError(f"{place}: there is no format {place.suffix!r}; there are .{', .'.join(FORMATS)}.")
    return place, name
