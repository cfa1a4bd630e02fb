"""Programs written and read, by the suffix of the file; beside each file a JSON of the same name says what it is.

=======  ============================================================  ======================================
.npz     NumPy's archive, the certified answer included                every program, to the bit
.mtx     Matrix Market, K in NAME.mtx, B in NAME_B.mtx, ...            every program, to the bit
.cbf     Conic Benchmark Format, the energy as one more cone           every program; K = F'F with its rounding
.hdf5    FCLIB's local problem (extra ``fclib``)                     steps with Coulomb's law; cannot be read back
.qps     MPS with a quadratic objective; .mps for HiGHS, which goes    absolute values, bounds, soft limits
         by the suffix
=======  ============================================================  ======================================
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from vemcvx.arrays import brief
from vemcvx.errors import ProgramError, VemcvxError
from vemcvx.exchange.cbf import from_cbf, to_cbf
from vemcvx.exchange.description import description
from vemcvx.exchange.fclib import from_fclib, to_fclib
from vemcvx.exchange.matrix_market import from_matrix_market, to_matrix_market
from vemcvx.exchange.npz import from_npz, to_npz
from vemcvx.exchange.qps import from_qps, to_qps
from vemcvx.owned_files import path_of
from vemcvx.program.step_program import StepProgram

Files = Mapping[str, bytes | None]
"""What is in the files, under the ends of their names; None of those that are to be removed."""
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
    put(encoded(program, name), lambda end: place.with_name(place.stem + end))
    return place


def put(files: Files, place: Callable[[str], Path]) -> None:
    """Write files, or remove those that are not to be there; `place` says where each is.

    Raises
    ------
    ProgramError
        One cannot be written.
    """
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
    words = json.dumps(description(program), indent=1, default=_plain) + "\n"
    return {**FORMATS[name][0](program), ".json": words.encode()}


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


def _plain(value: object) -> object:
    return value.item() if isinstance(value, np.generic) else str(value)
