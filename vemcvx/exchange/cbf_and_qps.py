"""Programs as CBF and QPS, the text formats of conic and of quadratic programs: sparse rows of linear functions.

CBF, the Conic Benchmark Format (version 1), holds every program: one cone a norm term, one for the energy.

    minimise    q - g'd + w't                       over d (n), t (m), q, p (soft limits only), all free
    subject to  (q, 1, F d, c^{1/2} p) in QR        2 q >= |F d|^2 + sum c_j p_j^2, with F'F = K
                (t_i, B_i d - b_i)     in Q         |B_i d - b_i| <= t_i, one cone a term
                e - D d + c p          in L+        p is the force of a soft limit

F is a root of K: of a sparse one the roots of the cells' matrices, one below the other, where the program knows them
(SolvedProgram.energy_rows), since a Cholesky factor fills up: in space, of 26,040 unknowns, that would make 617 MB of
text, not 42. Elsewhere it is that factor; where K has a kernel, and is dense, it has as many rows less. A reader gets
K = F'F back, with the rounding of that product. The comment in the first line gives n, m, the size of a block, the
numbers of limits, of soft ones, of motions in the kernel of K. At a solution the dual of a cone Q is (w_i, -lam_i),
that of L+ is p.

QPS, the MPS format with a quadratic objective in free format, holds absolute values, bounds and soft limits.

    minimise    1/2 d'Kd - g'd + w't + 1/2 sum c_j p_j^2      over d free, t >= 0, p >= 0
    rows        U: B d - t <= b,   L: -B d - t <= -b,   Z: D d - c p <= e

QUADOBJ is the upper triangle of the Hessian. Duals of U less those of L (of solvers whose duals of such rows are >= 0)
are lam, those of Z are p; the columns p_j are the forces of soft limits. That t >= 0 is implied; without it HiGHS 1.15
may call d = 0 optimal (problems/highs_optimal_at_zero.py).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from vemcvx.base.arrays import Floats, Ints
from vemcvx.base.errors import ProgramError
from vemcvx.exchange.arrays import Parts, put_together, with_motions
from vemcvx.program.operators import SECOND_ORDER_CONES
from vemcvx.program.step_program import SolvedProgram, StepProgram

CBF_HEAD = "# vemcvx program:"
SIZES = "unknowns", "terms", "block", "limits", "soft", "motions"
QPS_HEAD = "* vemcvx program, motions in the kernel of K:"
WIDTHS = {"NAME": 0, "ROWS": 2, "COLUMNS": 3, "RHS": 3, "RANGES": 0, "BOUNDS": 3, "QUADOBJ": 3, "ENDATA": 0}
"""Sections of QPS, and how many words the lines have of those that are read."""


def triplets(rows: Any) -> Iterator[tuple[int, int, str]]:
    """Row, column and value, to the bit, of the entries that are not zero, in the order of the matrix."""
    rows.sort_indices()
    coo = rows.tocoo()
    for i, j, x in zip(coo.row.tolist(), coo.col.tolist(), coo.data.tolist(), strict=True):
        if x:
            yield i, j, repr(x)


def root(program: StepProgram) -> sp.csr_matrix:
    """F with F'F = K: rows of cells where they are known, else a factor."""
    operators, K = program.operators, program.operators.K
    if isinstance(program, SolvedProgram) and program.energy_rows is not None:
        return program.energy_rows()
    if operators.kernel is not None:
        if not isinstance(K, np.ndarray):
            raise ProgramError(
                "CBF: nothing but friction and contact holds the body, and a sparse K with a kernel has none here; "
                "take the condensed program, or write .npz or .mtx."
            )
        values, vectors = np.linalg.eigh(0.5 * (K + K.T))
        kept = slice(operators.kernel.shape[1], None)
        return sp.csr_matrix(np.sqrt(values[kept])[:, None] * vectors[:, kept].T)
    if isinstance(K, np.ndarray):
        return sp.csr_matrix(np.linalg.cholesky(K).T if len(K) else K)
    lu = splu(sp.csc_matrix(K), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    upper = sp.csr_matrix(sp.diags_array(np.sqrt(lu.U.diagonal())) @ lu.L.T)
    return sp.csr_matrix(upper[:, lu.perm_c])


def to_cbf(program: StepProgram) -> dict[str, bytes]:
    """The file, under its suffix."""
    operators = program.operators
    n, m, block, soft = len(program.g), operators.count, operators.block, np.flatnonzero(operators.compliance)
    motions = 0 if operators.kernel is None else operators.kernel.shape[1]
    A, b, cones = _cone_rows(program, soft)
    cost = np.concatenate([-program.g, program.w, [1.0], np.zeros(len(soft))])
    entries = {
        "OBJACOORD": [f"{j} {x}" for _, j, x in triplets(sp.csr_matrix(cost))],
        "ACOORD": [f"{i} {j} {x}" for i, j, x in triplets(A)],
        "BCOORD": [f"{i} {x}" for _, i, x in triplets(sp.csr_matrix(b))],
    }
    lines = [
        f"{CBF_HEAD} unknowns {n} terms {m} block {block} limits {len(program.e)} soft {len(soft)} motions {motions}",
        *("VER", "1", "", "OBJSENSE", "MIN", "", "VAR", f"{A.shape[1]} 1", f"F {A.shape[1]}", ""),
        *("CON", f"{A.shape[0]} {len(cones)}", *cones, ""),
        *(line for name, found in entries.items() for line in (name, str(len(found)), *found, "")),
    ]
    return {".cbf": "\n".join([*lines, ""]).encode()}


def _cone_rows(program: StepProgram, soft: Ints) -> tuple[sp.csr_matrix, Floats, list[str]]:
    """A and b of A x + b, x = (d, t, q, p), and the cones that its rows are in."""
    operators = program.operators
    m, block, c, F = operators.count, operators.block, operators.compliance, root(program)
    energy = 2 + F.shape[0] + len(soft)
    blocks: Any = [
        [None, None, np.array([[1.0], [0.0]]), None],
        [F, None, None, None],
        [None, None, None, sp.diags_array(np.sqrt(c[soft]))],
        [None, sp.eye_array(m), None, None],
        [operators.B, None, None, None],
        [-operators.D, None, None, sp.csr_matrix((c[soft], (soft, np.arange(len(soft)))), shape=(len(c), len(soft)))],
    ]
    A: sp.csr_matrix = sp.csr_matrix(sp.block_array(blocks))
    b = np.concatenate([[0.0, 1.0], np.zeros(energy - 2 + m), -program.b, program.e])
    # A cone's first row is that of t_i, the others are those of B_i.
    terms = np.concatenate([np.arange(m)[:, None], m + np.arange(m * block).reshape(m, block)], axis=1).ravel()
    order = np.concatenate([np.arange(energy), energy + terms, np.arange(len(b) - len(c), len(b))])
    return A[order], b[order], _cones(energy, m, block, len(c))


def _cones(energy: int, m: int, block: int, limits: int) -> list[str]:
    return [f"QR {energy}", *[f"Q {1 + block}"] * m, *([f"L+ {limits}"] if limits else [])]


def from_cbf(path: Path) -> StepProgram:
    """The program of a file of this form, K = F'F; ProgramError if it is of another form."""
    lines = path.read_text().splitlines()
    if not lines or not lines[0].startswith(CBF_HEAD):
        raise ProgramError(f"found no first line {CBF_HEAD!r}; only files that write_program() has made are read.")
    try:
        return put_together(_cbf_parts(_sizes(lines), lines))
    except (ValueError, IndexError, OverflowError) as error:
        raise ProgramError(f"is no CBF file of a step's program: {error}.") from error


def _sizes(lines: list[str]) -> tuple[int, ...]:
    """The sizes in the first line, where the file has room for them."""
    words, most = lines[0].removeprefix(CBF_HEAD).split(), sum(map(len, lines))
    sizes = tuple(int(word) if word.isdecimal() and len(word) < 19 else -1 for word in words[1::2])
    if tuple(words[::2]) != SIZES or len(sizes) != len(SIZES) or not 0 <= min(sizes) <= max(sizes) <= most:
        raise ValueError(
            f"the first line says {' '.join(words)[:100]!r}; wanted {', '.join(SIZES)}, each with a whole number "
            f"from 0 to {most}, which a file of this size has room for"
        )
    return sizes


def _cbf_parts(sizes: tuple[int, ...], lines: list[str]) -> Parts:
    n, m, block, r, s, motions = sizes
    if block < 1 or "CON" not in lines:
        raise ValueError(f"found {f'blocks of {block} components' if block < 1 else 'no section CON'}")
    at = lines.index("CON")
    rows = int(lines[at + 1].split()[0])
    energy = rows - r - m * (1 + block)
    cones = _cones(energy, m, block, r)
    if lines[at + 2 : at + 2 + len(cones)] != cones or energy - 2 - s < 0:
        raise ValueError(
            f"its cones are not those of {n} unknowns, {m} terms of block {block}, {r} limits and {s} soft ones, which "
            f"leave {energy} of {rows} rows to the energy"
        )
    cost, b = (_entries(lines, name, (k,)).toarray()[0] for name, k in (("OBJACOORD", n + m + 1 + s), ("BCOORD", rows)))
    A = _entries(lines, "ACOORD", (rows, len(cost)))
    cone = energy + np.arange(m * (1 + block)).reshape(m, 1 + block)[:, 1:].ravel()
    F, limits = A[2 : energy - s, :n], slice(rows - r, rows)
    parts: Parts = {"g": -cost[:n], "w": cost[n : n + m], "B": A[cone, :n], "b": -b[cone]}
    parts |= {"D": -A[limits, :n], "e": b[limits], "c": A[limits, n + m + 1 :] @ np.ones(s)}
    return parts | with_motions(0.5 * (F.T @ F + (F.T @ F).T), motions)


def _entries(lines: list[str], section: str, shape: tuple[int, ...]) -> sp.csr_matrix:
    """The entries of a section, of a matrix of that shape, or of a row of that length."""
    width, found = len(shape) + 1, []
    if section in lines:
        start = lines.index(section) + 2
        count = int(lines[start - 1])
        found = [line.split() for line in lines[start : start + count]] if count > 0 else []
        if len(found) != count or any(len(words) != width for words in found):
            raise ValueError(f"section {section} announces {count} lines of {width} numbers; found others, or fewer")
    places = np.array([[int(word) for word in words[:-1]] for words in found], dtype=np.int64).reshape(-1, width - 1)
    outside = ((places < 0) | (places >= shape)).any(axis=1)
    if outside.any():
        raise ValueError(f"section {section} has an entry at {places[outside][0].tolist()}; there are {list(shape)}")
    values = np.array([float(words[-1]) for words in found])
    first = places.T[0] if width == 3 else np.zeros(len(found), dtype=np.int64)
    return sp.csr_matrix((values, (first, places.T[-1])), shape=(shape[0] if width == 3 else 1, shape[-1]))


def to_qps(program: StepProgram, suffix: str = ".qps") -> dict[str, bytes]:
    """The file, under its suffix: readers that go by it may want .mps.

    ProgramError where the program has second-order cones.
    """
    if SECOND_ORDER_CONES in program.operators.features:
        raise ProgramError("QPS has no second-order cones, which this program has; write .cbf, .npz or .mtx.")
    return {suffix: "\n".join([*_qps_lines(program), ""]).encode()}


def _names(sizes: dict[str, int]) -> list[str]:
    return [f"{letter}{k + 1}" for letter, size in sizes.items() for k in range(size)]


def _qps_lines(program: StepProgram) -> Iterator[str]:
    operators, n, m, r = program.operators, len(program.g), len(program.w), len(program.e)
    B, D, c, one = operators.B, operators.D, sp.diags_array(operators.compliance), sp.eye_array(m)
    blocks: Any = [[B, -one, None], [-B, -one, None], [D, None, -c]]
    A, bounds = sp.block_array(blocks), np.concatenate([program.b, -program.b, program.e])
    K = sp.csr_matrix(sp.triu(sp.csr_matrix(operators.K), format="csr"))
    quadratic = sp.block_diag([K, sp.csr_matrix((m, m)), c], format="csr")
    rows, columns = _names({"U": m, "L": m, "Z": r}), _names({"d": n, "t": m, "p": r})
    entries = [[f" {columns[j]} cost {x!r}"] for j, x in enumerate(np.append(-program.g, program.w).tolist())]
    entries += [[] for _ in range(r)]
    for j, i, x in triplets(sp.csr_matrix(A.T)):
        entries[j].append(f" {columns[j]} {rows[i]} {x}")
    yield from (f"{QPS_HEAD} {0 if operators.kernel is None else operators.kernel.shape[1]}", "NAME vemcvx")
    yield from ("ROWS", " N cost", *(f" L {name}" for name in rows))
    yield from ("COLUMNS", *(line for column in entries for line in column))
    yield from ("RHS", *(f" rhs {rows[i]} {x}" for _, i, x in triplets(sp.csr_matrix(bounds))))
    yield from ("BOUNDS", *(f" FR bound {name}" for name in columns[:n]))
    yield from ("QUADOBJ", *(f" {columns[i]} {columns[j]} {x}" for i, j, x in triplets(quadratic)), "ENDATA")


def from_qps(path: Path) -> StepProgram:
    """The program of a file of this form; ProgramError if it is of another form."""
    entries: dict[str, list[list[str]]] = {name: [] for name in WIDTHS}
    section, lines = "NAME", path.read_text().splitlines()
    for line in lines:
        words = line.split()
        if not words or line[0] == "*":
            continue
        if line[0] == " ":
            entries[section].append(words)
        elif (section := words[0]) not in entries:
            raise ProgramError(f"found the section {section!r}; there are {', '.join(WIDTHS)}.")
    try:
        if not lines or not lines[0].startswith(QPS_HEAD):
            raise ValueError(f"found no first line {QPS_HEAD!r}; only files that write_program() has made are read")
        return put_together(_qps_parts(entries, int(lines[0].removeprefix(QPS_HEAD))))
    except (ValueError, OverflowError) as error:
        raise ProgramError(f"is no QPS file of a step's program: {error}.") from error


def _qps_parts(entries: dict[str, list[list[str]]], kernel: int) -> Parts:
    for section, width in WIDTHS.items():
        other = [words for words in entries[section] if width and len(words) != width]
        if other:
            raise ValueError(f"section {section} has the line {' '.join(other[0])[:60]!r}; wanted {width} words")
    names = [words[1] for words in entries["ROWS"]]
    n = sum(words[0] == "FR" for words in entries["BOUNDS"])
    m, r = (sum(name[0] == letter for name in names) for letter in "UZ")
    rows, columns = _Places({"U": m, "L": m, "Z": r}), _Places({"d": n, "t": m, "p": r})
    A, Q = sp.lil_matrix((2 * m + r, n + m + r)), sp.lil_matrix((n + m + r, n + m + r))
    cost, bounds = np.zeros(n + m + r), np.zeros(2 * m + r)
    for column, row, value in entries["COLUMNS"]:
        j = columns[column]
        if row == "cost":
            cost[j] = float(value)
        else:
            A[rows[row], j] = float(value)
    for _, row, value in entries["RHS"]:
        bounds[rows[row]] = float(value)
    for one, two, value in entries["QUADOBJ"]:
        i, j = columns[one], columns[two]
        if not (max(i, j) < n or (i == j >= n + m)):
            raise ValueError(f"section QUADOBJ couples {one!r} and {two!r}; wanted two of d, or one p twice")
        Q[i, j] = Q[j, i] = float(value)
    parts: Parts = {"g": -cost[:n], "w": cost[n : n + m], "c": Q.diagonal()[n + m :]}
    parts |= {"B": sp.csr_matrix(A[:m, :n]), "D": sp.csr_matrix(A[2 * m :, :n]), "b": bounds[:m], "e": bounds[2 * m :]}
    return parts | with_motions(sp.csr_matrix(Q[:n, :n]), kernel)


class _Places(dict[str, int]):
    """Names of rows or columns -> their numbers: so many of each letter, one kind after the other."""

    def __init__(self, sizes: dict[str, int]):
        super().__init__((name, number) for number, name in enumerate(_names(sizes)))
        self.there = ", ".join(f"{kind}1 to {kind}{size}" for kind, size in sizes.items() if size) or "none"

    def __missing__(self, name: str) -> int:
        raise ValueError(f"found {name[:30]!r}; there are {self.there}")
