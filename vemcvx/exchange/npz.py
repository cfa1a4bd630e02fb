"""NPZ, NumPy's archive: every array of the program to the bit, and the certified answer, where it is known.

K               (n, n), dense; or, sparse, as B and D
B_data, B_indices, B_indptr, B_shape      compressed rows, as in scipy.sparse.csr_matrix((data, indices, indptr))
g, w, b, e, c   vectors; N, anchor where K has a kernel; d, lam, p, step, t of a certified answer
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from vemcvx.archives import read_arrays
from vemcvx.errors import ProgramError
from vemcvx.exchange.parts import Parts, compressed_rows, parts_of, put_together
from vemcvx.program.answer import Answer
from vemcvx.program.checks import finite, of_shape
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
    kept = read_arrays(path)
    parts: Parts = {name: kept[name] for name in ("K", "g", "w", "b", "e", "c", "N", "anchor") if name in kept}
    for name in "KBD":
        members = [f"{name}_{k}" for k in CSR]
        if any(member in kept for member in members):
            missing = [member for member in members if member not in kept]
            if missing:
                raise ProgramError(f"found no {missing[0]}; a sparse {name} has {', '.join(members)}.")
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
