"""HDF5 files of the Frictional Contact Library (FCLIB): one solved step with Coulomb's law per file.

FCLIB (Acary and others, INRIA RT-444, 2014, and fclib.h) states the law for the contact forces r and the relative
displacements u. At each contact, r and u have a normal component (N) first, then one or two tangential components (T):

    u = W r + q
    r_N >= 0,  u_N >= 0,  r_N u_N = 0,   |r_T| <= mu r_N,   r_T = -mu r_N u_T / |u_T| where u_T != 0

In our program (:mod:`.arrays`), a contact has a limit j and a norm term i. The matrix h has the rows h_N = -D_j and
h_T = B_i of each contact. The balance K d = g - B'lam - D'p gives

    r_N = p,  r_T = -lam,  u_N = e - D d,  u_T = B d - b,    W = h K^{-1} h',   q = h K^{-1} g + (e; -b).

W is stored by rows (nz = -2). The JSON text `description` in `info` has `energy_error`, a bound on |d - d*|_K. The
exact answer d* solves the convex program with the weights mu r_N. Writing needs h5py (extra ``fclib``).
"""

from __future__ import annotations

import io
import json
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import EPS, Floats, Ints
from vemcvx.base.errors import ProgramError
from vemcvx.program import SolvedProgram, StepProgram

MODEL = "u = W r + q; r_N >= 0, u_N >= 0, r_N u_N = 0; |r_T| <= mu r_N, r_T = -mu r_N u_T / |u_T| where u_T != 0"


def to_fclib(program: StepProgram) -> dict[str, bytes]:
    """Return the contents of an FCLIB file, as {suffix: bytes}."""
    if find_spec("h5py") is None:
        raise ProgramError("FCLIB's files need h5py, which is not installed; pip install 'vemcvx[fclib]'.")
    if not isinstance(program, SolvedProgram):
        raise ProgramError("FCLIB's model needs coefficients of friction, which only a solved step has.")
    pairs, mu = _contacts(program)
    operators, m, dim = program.operators, len(mu), 1 + program.operators.block
    slips = (pairs[:, None] * operators.block + np.arange(operators.block)).ravel()
    order = np.column_stack([np.arange(m), m + np.arange(m * (dim - 1)).reshape(m, dim - 1)]).ravel()
    rows = sp.csr_matrix(sp.vstack([-operators.D, operators.B[slips]]))[order]
    w = np.concatenate([program.e, -program.b[slips]])[order]
    r = np.concatenate([program.answer.p, -program.answer.lam[pairs].ravel()])[order]
    spread: Floats = operators.factor.solve(np.ascontiguousarray(rows.T.toarray()))
    W, q = rows @ spread, rows @ operators.factor.solve(program.g) + w
    stored = sp.csr_matrix(0.5 * (W + W.T))
    made = io.BytesIO()
    with import_module("h5py").File(made, "w") as file:
        problem = file.create_group("fclib_local")
        problem["spacedim"] = np.array([dim], dtype=np.int32)
        sizes = {"nzmax": stored.nnz, "m": stored.shape[0], "n": stored.shape[1], "nz": -2}
        whole = {name: np.array([size], dtype=np.int32) for name, size in sizes.items()}
        entries = {"p": stored.indptr.astype(np.int32), "i": stored.indices.astype(np.int32), "x": stored.data}
        problem.create_group("W").update(whole | entries)
        problem.create_group("vectors").update({"q": q, "mu": mu})
        words = {"title": f"vemcvx: step {program.step} at t = {program.t:.17g}", "math_info": MODEL}
        about = {**program.origin, "energy_error": program.certificate.error, "energy_norm": program.norm}
        problem.create_group("info").update({**words, "description": json.dumps(about, default=str)})
        file.create_group("solution").update({"r": r, "u": W @ r + q})
    return {".hdf5": made.getvalue()}


def from_fclib(_: Path) -> StepProgram:
    """Raise ProgramError, because FCLIB files are no convex programs."""
    raise ProgramError("an FCLIB file states Coulomb's law, no convex program; read an .npz, .mtx, .cbf or .mps.")


def _contacts(program: SolvedProgram) -> tuple[Ints, Floats]:
    """Return the norm term and the coefficient of friction of each limit."""
    operators, slope = program.operators, program.slope
    words = "FCLIB's model is Coulomb's friction on rigid obstacles: "
    soft = (operators.compliance > 0).any()
    if slope is None or operators.block > 2 or operators.kernel is not None or soft:
        raise ProgramError(
            f"{words}in this program, weights do not follow the pressure, limits are soft, or only friction and limits "
            "hold the body; write .npz, .mtx, .cbf or .mps."
        )
    pairs = sp.csc_matrix(slope)
    pairs.eliminate_zeros()
    single = (np.diff(pairs.indptr) == 1).all() and (np.bincount(pairs.indices, minlength=operators.count) == 1).all()
    mu, w = pairs.data, program.w[pairs.indices]
    # Coulomb's law is w = mu p, up to rounding errors.
    if not single or (np.abs(w - mu * program.answer.p) > 64 * EPS * w.max(initial=0.0)).any():
        raise ProgramError(f"{words}here some weights are not mu times one pressure of the answer.")
    return pairs.indices.astype(np.int64), mu
