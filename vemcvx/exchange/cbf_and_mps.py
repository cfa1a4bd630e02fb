"""Programs in the text formats CBF (conic programs) and MPS (quadratic programs).

A program minimises 1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i| over all d with D d <= e. A soft limit j has
a compliance c_j > 0, and (D_j d - e_j)_+^2 / (2 c_j) replaces the limit. CBF, the Conic Benchmark Format (version 1),
has one cone Q per norm term, and one cone QR for the energy::

    minimise    q - g'd + w't                       over d (n), t (m), q, p (soft limits only), all free
    subject to  (q, 1, F d, c^{1/2} p) in QR        2 q >= |F d|^2 + sum c_j p_j^2, with F'F = K
                (t_i, B_i d - b_i)     in Q         |B_i d - b_i| <= t_i, one cone per term
                e - D d + c p          in L+        p is the force of a soft limit

F is the Cholesky factor of K. If a dense K (n, n) has a kernel of k motions, F has n - k rows. Reading gives K = F'F.
At a solution with the multipliers lam and p, a cone Q has the dual (w_i, -lam_i), and L+ has the dual p.

MPS (free format, quadratic objective; also called QPS) holds programs whose norm terms are absolute values::

    minimise    1/2 d'Kd - g'd + w't + 1/2 sum c_j p_j^2      over d free, t >= 0, p >= 0
    rows        U: B d - t <= b,   L: -B d - t <= -b,   Z: D d - c p <= e

QUADOBJ is the upper triangle of the Hessian. With duals >= 0, lam = (dual of U) - (dual of L), and p is
the dual of Z. HiGHS returns duals <= 0; reverse their signs. The columns p_j are the forces of soft limits. The
bound t >= 0 is redundant, but without it HiGHS 1.15 may call d = 0 optimal (problems/highs_optimal_at_zero.py).

In both formats, the first n variables are d. The first line is a comment with the sizes of the program.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from vemcvx.base.arrays import Floats, Ints
from vemcvx.base.errors import ProgramError
from vemcvx.exchange.arrays import matrix_with_kernel, program_from_arrays
from vemcvx.program import SECOND_ORDER_CONES, StepProgram

HEAD = "vemcvx program: unknowns {} terms {} block {} limits {} soft {} motions {}"


def _head(program: StepProgram) -> str:
    operators, kernel = program.operators, program.operators.kernel
    soft, motions = np.count_nonzero(operators.compliance), 0 if kernel is None else kernel.shape[1]
    sizes = len(program.g), operators.count, operators.block, len(program.e), soft, motions
    return HEAD.format(*sizes)


def _read(path: Path) -> tuple[list[int], dict[str, str]]:
    """Return the numbers in the first line of a file, and the sections by name."""
    text = path.read_text(encoding="utf-8")
    found = re.match("[#*] " + HEAD.replace("{}", r"(\d+)") + "\n", text)
    if found is None:
        raise ProgramError(f"found no first line {HEAD!r}; only files written by write_program() can be read.")
    numbers = [int(word) for word in found.groups()]
    if max(numbers) > len(text):
        raise ProgramError(f"found {max(numbers)} in the first line; a file of this size cannot hold so many.")
    return numbers, dict(re.findall(r"^([A-Z]+)\b.*\n((?:[^A-Z\n].*\n|(?:F|QR?|L\+) \d+\n)*)", text, re.MULTILINE))


def triplets(rows: Any) -> Iterator[tuple[int, int, str]]:
    """Yield the row, column and decimal value of each nonzero entry."""
    rows.sort_indices()
    coo = rows.tocoo()
    for i, j, x in zip(coo.row.tolist(), coo.col.tolist(), coo.data.tolist(), strict=True):
        if x:
            yield i, j, repr(x)


def root(program: StepProgram) -> sp.csr_matrix:
    """Return F with F'F = K."""
    operators, K = program.operators, program.operators.K
    if operators.kernel is not None:
        if not isinstance(K, np.ndarray):
            raise ProgramError(
                "CBF: found a sparse K with a kernel; take the condensed program, or write .npz or .mtx."
            )
        values, vectors = np.linalg.eigh(0.5 * (K + K.T))
        kept = slice(operators.kernel.shape[1], None)
        return sp.csr_matrix(np.sqrt(values[kept])[:, None] * vectors[:, kept].T)
    if isinstance(K, np.ndarray):
        return sp.csr_matrix(np.linalg.cholesky(K).T)
    lu = splu(sp.csc_matrix(K), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    upper = sp.csr_matrix(sp.diags_array(np.sqrt(lu.U.diagonal())) @ lu.L.T)
    return sp.csr_matrix(upper[:, lu.perm_c])


def to_cbf(program: StepProgram) -> dict[str, bytes]:
    """Return the contents of a CBF file, as {suffix: bytes}."""
    soft = np.flatnonzero(program.operators.compliance)
    A, b, cones = _cone_rows(program, soft)
    cost = np.concatenate([-program.g, program.w, [1.0], np.zeros(len(soft))])
    entries = {
        "OBJACOORD": [f"{j} {x}" for _, j, x in triplets(sp.csr_matrix(cost))],
        "ACOORD": [f"{i} {j} {x}" for i, j, x in triplets(A)],
        "BCOORD": [f"{i} {x}" for _, i, x in triplets(sp.csr_matrix(b))],
    }
    lines = [f"# {_head(program)}", "VER", "1", "", "OBJSENSE", "MIN", "", "VAR", f"{len(cost)} 1", f"F {len(cost)}"]
    lines += ["", "CON", f"{len(b)} {len(cones)}", *cones]
    lines += [line for name, found in entries.items() for line in ("", name, str(len(found)), *found)]
    return {".cbf": "\n".join([*lines, ""]).encode()}


def _cone_rows(program: StepProgram, soft: Ints) -> tuple[sp.csr_matrix, Floats, list[str]]:
    """Return A, b and the cones of the rows A x + b, with x = (d, t, q, p)."""
    operators = program.operators
    m, block, c, F = operators.count, operators.block, operators.compliance, root(program)
    energy = 2 + F.shape[0] + len(soft)
    blocks: Any = [
        [None, None, np.array([[1.0], [0.0]]), None],
        [F, None, None, None],
        [None, None, None, sp.diags_array(np.sqrt(c[soft]))],
        [None, sp.eye_array(m), None, None],
        [operators.B, None, None, None],
        [-operators.D, None, None, sp.diags_array(c, format="csc")[:, soft]],
    ]
    A: sp.csr_matrix = sp.csr_matrix(sp.block_array(blocks))
    b = np.concatenate([[0.0, 1.0], np.zeros(energy - 2 + m), -program.b, program.e])
    # Each cone has the row of t_i, then the rows of B_i d.
    terms = np.concatenate([np.arange(m)[:, None], m + np.arange(m * block).reshape(m, block)], axis=1).ravel()
    order = np.concatenate([np.arange(energy), energy + terms, np.arange(len(b) - len(c), len(b))])
    return A[order], b[order], _cones(energy, m, block, len(c))


def _cones(energy: int, m: int, block: int, limits: int) -> list[str]:
    return [f"QR {energy}", *[f"Q {1 + block}"] * m, *([f"L+ {limits}"] if limits else [])]


def from_cbf(path: Path) -> StepProgram:
    """Return the program of a CBF file, with K = F'F."""
    (n, m, block, r, s, motions), sections = _read(path)
    rows, cones = int(sections["CON"].split()[0]), sections["CON"].splitlines()[1:]
    energy = rows - r - m * (1 + block)
    if cones != _cones(energy, m, block, r):
        raise ProgramError("its cones do not fit the sizes in the first line.")

    def entries(name: str, rows: int, columns: int) -> sp.csr_matrix:
        # OBJACOORD and BCOORD have no row numbers.
        width = 2 if name != "ACOORD" else 3
        numbers = np.array(sections[name].split()[1:], dtype=float).reshape(-1, width).T
        places = numbers[:-1].astype(np.int64)
        return sp.csr_matrix((numbers[-1], (places[0] * (width == 3), places[-1])), shape=(rows, columns))

    cost, b = (entries(name, 1, k).toarray()[0] for name, k in (("OBJACOORD", n + m + 1 + s), ("BCOORD", rows)))
    A = entries("ACOORD", rows, len(cost))
    cone = energy + np.arange(m * (1 + block)).reshape(m, 1 + block)[:, 1:].ravel()
    F, limits = A[2 : energy - s, :n], slice(rows - r, rows)
    parts = {"g": -cost[:n], "w": cost[n : n + m], "B": A[cone, :n], "b": -b[cone]}
    parts |= {"D": -A[limits, :n], "e": b[limits], "c": A[limits, n + m + 1 :] @ np.ones(s)}
    return program_from_arrays(parts | matrix_with_kernel(0.5 * (F.T @ F + (F.T @ F).T), motions))


def _names(n: int, m: int, r: int) -> Iterator[list[str]]:
    """Yield the names of rows, then the names of columns."""
    for sizes, last in (({"U": m, "L": m, "Z": r}, "cost"), ({"d": n, "t": m, "p": r}, "rhs")):
        yield [*(f"{letter}{k + 1}" for letter, size in sizes.items() for k in range(size)), last]


def to_mps(program: StepProgram, suffix: str = ".mps") -> dict[str, bytes]:
    """Return the contents of an MPS file, as {suffix: bytes}."""
    operators, n, m, r = program.operators, len(program.g), len(program.w), len(program.e)
    if SECOND_ORDER_CONES in operators.features:
        raise ProgramError("MPS has no second-order cones, which this program has; write .cbf, .npz or .mtx.")
    B, D, c, one = operators.B, operators.D, sp.diags_array(operators.compliance), sp.eye_array(m)
    blocks: Any = [[B, -one, None], [-B, -one, None], [D, None, -c]]
    A, bounds = sp.block_array(blocks), np.concatenate([program.b, -program.b, program.e])
    quadratic = sp.block_diag([sp.triu(sp.csr_matrix(operators.K)), sp.csr_matrix((m, m)), c], format="csr")
    rows, columns = _names(n, m, r)
    entries = [(j, -1, repr(x)) for j, x in enumerate(np.append(-program.g, program.w).tolist())]  # including zeros
    lines = [f"* {_head(program)}", "NAME vemcvx", "ROWS", " N cost", *(f" L {name}" for name in rows[:-1])]
    lines += ["COLUMNS"]
    lines += [f" {columns[j]} {rows[i]} {x}" for j, i, x in sorted([*entries, *triplets(sp.csr_matrix(A.T))])]
    lines += ["RHS", *(f" rhs {rows[i]} {x}" for _, i, x in triplets(sp.csr_matrix(bounds)))]
    lines += ["BOUNDS", *(f" FR bound {name}" for name in columns[:n])]
    lines += ["QUADOBJ", *(f" {columns[i]} {columns[j]} {x}" for i, j, x in triplets(quadratic)), "ENDATA", ""]
    return {suffix: "\n".join(lines).encode()}


def from_mps(path: Path) -> StepProgram:
    """Return the program of an MPS file."""
    (n, m, _, r, _, motions), sections = _read(path)
    rows, columns = ({name: k for k, name in enumerate(names)} for names in _names(n, m, r))

    def matrix(text: str, second: dict[str, int]) -> sp.csr_matrix:
        words = [(columns[one], second[two], float(x)) for one, two, x in map(str.split, text.splitlines())]
        i, j, x = zip(*words, strict=True) if words else ((), (), ())
        return sp.csr_matrix((x, (i, j)), shape=(len(columns), len(second)), dtype=float)

    A, Q = matrix(sections["COLUMNS"] + sections["RHS"], rows).T.tocsr(), matrix(sections["QUADOBJ"], columns)
    cost, bounds = A[-1].toarray()[0], A[:, -1].toarray().ravel()
    parts = {"g": -cost[:n], "w": cost[n : n + m], "c": Q.diagonal()[n + m : -1], "B": A[:m, :n], "b": bounds[:m]}
    parts |= {"D": A[2 * m : -1, :n], "e": bounds[2 * m : -1]}
    return program_from_arrays(parts | matrix_with_kernel(sp.csr_matrix(Q + sp.triu(Q, 1).T)[:n, :n], motions))
