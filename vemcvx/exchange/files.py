"""Write and read programs. The suffix of a file selects the format.

=======  ============================================================  ==============================================
Suffix   Format                                                        Programs in this format
=======  ============================================================  ==============================================
.npz     NumPy's archive, with the certified answer                    all, exactly
.mtx     Matrix Market, in NAME.mtx, NAME_B.mtx and further files      all, exactly
.cbf     Conic Benchmark Format, the energy as a cone                  most, with rounding errors
.mps     MPS with a quadratic objective (.qps: same format)            all without second-order cones
.hdf5    FCLIB's local problem                                         steps with Coulomb's law; cannot be read back
=======  ============================================================  ==============================================

A JSON file of the same name states the origin of the program, its size, and its certified optimum.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import brief
from vemcvx.base.errors import ProgramError, VemcvxError
from vemcvx.base.owned_files import path_of
from vemcvx.base.version import __version__
from vemcvx.exchange.arrays import from_matrix_market, from_npz, to_matrix_market, to_npz
from vemcvx.exchange.cbf_and_mps import from_cbf, from_mps, to_cbf, to_mps
from vemcvx.exchange.fclib import from_fclib, to_fclib
from vemcvx.program import SolvedProgram, StepProgram

STATEMENT = (
    "minimise 1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i| subject to D d <= e. If c_j > 0, the term "
    "(D_j d - e_j)_+^2 / (2 c_j) replaces the limit D_j d <= e_j. K d = g - B'lam - D'p, |lam_i| <= w_i, p >= 0. "
    "For any such d, lam, p: 1/2 |d - d*|_K^2 <= gap."
)


def description(program: StepProgram) -> dict[str, Any]:
    """Return the description of a program, as values that JSON can represent."""
    operators = program.operators
    matrices = {"K": sp.csr_matrix(operators.K), "B": operators.B, "D": operators.D}
    found: dict[str, Any] = {
        "format": "vemcvx program 1",
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
    }
    if isinstance(program, SolvedProgram):
        found |= {"origin": dict(program.origin), "step": program.step, "t": program.t}
        certificate, (low, high) = program.certificate, program.bounds
        optimum = {"value": program.objective(program.answer.d), "low": low, "high": high, "gap": certificate.gap}
        optimum |= {"rounding_floor": certificate.floor, "energy_error": certificate.error, "energy_norm": program.norm}
        found |= {"optimum": optimum}
    return found


Files = dict[str, bytes]  # ending of a file name, such as "_B.mtx" -> contents
FORMATS: dict[str, tuple[Callable[[StepProgram], Files], Callable[[Path], StepProgram]]] = {
    "npz": (to_npz, from_npz),
    "mtx": (to_matrix_market, from_matrix_market),
    "cbf": (to_cbf, from_cbf),
    "mps": (to_mps, from_mps),
    "qps": (partial(to_mps, suffix=".qps"), from_mps),
    "hdf5": (to_fclib, from_fclib),
}


def encode_program(program: StepProgram, name: str) -> Files:
    """Return the files of a program, as {ending: contents}."""
    if not isinstance(program, StepProgram):
        raise ProgramError(f"write_program: found {brief(program)}; wanted a StepProgram, as history.program(n) is.")
    if len(program.g) == 0:
        raise ProgramError("write_program: the program has no unknowns left; use condense=False (--no-condense).")
    if program.stuck.any():
        raise ProgramError(
            f"write_program: {program.stuck.sum()} norm terms have infinite weights, so that they always stick; no "
            "format can express this. Write an earlier step, in which all weights are finite."
        )
    return {**FORMATS[name][0](program), ".json": in_json(description(program))}


def in_json(words: Mapping[str, Any]) -> bytes:
    """Return a mapping as the contents of a JSON file."""
    text = json.dumps(words, indent=1, default=lambda x: x.item() if isinstance(x, np.generic) else str(x))
    return f"{text}\n".encode()


def write_program(program: StepProgram, path: str | Path) -> Path:
    """Write a program to a file, and a description to a JSON file. Existing files are replaced.

    Parameters
    ----------
    program : StepProgram
        A convex program, solved or not.
    path : str or Path
        NAME.npz, NAME.mtx, NAME.cbf, NAME.mps, NAME.qps or NAME.hdf5: see :mod:`vemcvx.exchange.files`.

    Returns
    -------
    Path
        The path of the file.

    Raises
    ------
    ProgramError
        There is no such format, the format cannot hold the program, or a file cannot be written.

    Examples
    --------
    >>> program = vx.StepProgram(vx.Operators(np.eye(2), np.eye(2)), g=np.ones(2), w=np.ones(2), b=np.zeros(2))
    >>> vx.write_program(program, "step.npz").name
    'step.npz'
    """
    place, name = _place(path)
    contents = encode_program(program, name)
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        for end, data in contents.items():
            (place if end == f".{name}" else place.with_name(place.stem + end)).write_bytes(data)
    except OSError as error:
        raise ProgramError(f"{place}: cannot be written: {error}.") from error
    return place


def read_program(path: str | Path) -> StepProgram:
    """Read a program that :func:`write_program` wrote.

    Parameters
    ----------
    path : str or Path
        An NPZ, Matrix Market, CBF, MPS or QPS file. An FCLIB file cannot be read.

    Returns
    -------
    StepProgram
        A SolvedProgram if the file is an NPZ archive with an answer.

    Raises
    ------
    ProgramError
        There is no such file, or the file does not contain a program.

    Examples
    --------
    >>> program = vx.StepProgram(vx.Operators(np.eye(2), np.eye(2)), g=np.ones(2), w=np.ones(2), b=np.zeros(2))
    >>> path = vx.write_program(program, "step.npz")
    >>> print(vx.read_program(path).g)
    [1. 1.]
    """
    place, name = _place(path)
    if not place.is_file():
        raise ProgramError(f"{place}: there is no such file.")
    try:
        return FORMATS[name][1](place)
    except VemcvxError as error:
        raise ProgramError(f"{place}: {error}") from error
    except Exception as error:  # numpy, zipfile and scipy raise many kinds of errors on damaged files
        raise ProgramError(f"{place}: the file is damaged, or no .{name} file of a program: {error}.") from error


def _place(path: str | Path) -> tuple[Path, str]:
    place = path_of(path, "program")
    name = place.suffix.removeprefix(".").lower()
    if name not in FORMATS:
        raise ProgramError(f"{place}: there is no format {place.suffix!r}; there are .{', .'.join(FORMATS)}.")
    return place, name
