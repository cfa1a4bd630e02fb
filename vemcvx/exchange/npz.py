"""NPZ, NumPy's archive: every array of the program to the bit, and the certified answer, where it is known.

K               (n, n), dense; or, sparse, as B and D
B_data, B_indices, B_indptr, B_shape      compressed rows, as in scipy.sparse.csr_matrix((data, indices, indptr))
g, w, b, e, c   vectors; N, anchor where K has a kernel; d, lam, p, step, t of a certified answer
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from vemcvx.exchange.parts import Parts, parts_of, put_together
from vemcvx.program.answer import Answer
from vemcvx.program.solved_program import SolvedProgram
from vemcvx.program.step_program import StepProgram

CSR = "data", "indices", "indptr", "shape"


def to_npz(program: StepProgram) -> dict[str, bytes]:
    """The archive, under its suffix."""
    arrays: dict[str, object] = {}
    for name, part in parts_of(program).items():
        arrays |= {name: part} if isinstance(part, np.ndarray) else {f"{name}_{k}": getattr(part, k) for k in CSR}
    if isinstance(program, SolvedProgram):
        answer = program.answer
        arrays |= {"d": answer.d, "lam": answer.lam, "p": answer.p, "step": program.step, "t": program.t}
    made = io.BytesIO()
    np.savez(made, **arrays)  # type: ignore[arg-type]  # names of arrays are none of its options
    return {".npz": made.getvalue()}


def from_npz(path: Path) -> StepProgram:
    """The program, solved if the file has the answer."""
    with np.load(path, allow_pickle=False) as file:
        kept = {name: file[name] for name in file.files}
    sparse = sorted({name.rpartition("_")[0] for name in kept if "_" in name})
    parts: Parts = {name: kept[name] for name in ("K", "g", "w", "b", "e", "c", "N", "anchor") if name in kept}
    for name in sparse:
        data, indices, indptr, shape = (kept[f"{name}_{k}"] for k in CSR)
        parts[name] = sp.csr_matrix((data, indices, indptr), shape=tuple(shape.tolist()))
    program = put_together(parts, str(path))
    if "d" not in kept:
        return program
    answer = Answer(kept["d"], kept["lam"], 0, "read from a file", p=kept["p"])
    return SolvedProgram.of(program, answer, int(kept["step"]), float(kept["t"]))
