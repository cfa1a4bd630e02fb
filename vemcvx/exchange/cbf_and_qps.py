"""Programs as CBF and QPS, the text formats of conic and of quadratic programs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import ProgramError
from vemcvx.exchange.arrays import Parts, null_motions, number, put_together, triplets
from vemcvx.program.operators import SECOND_ORDER_CONES, Operators
from vemcvx.program.step_program import StepProgram

# CBF, the Conic Benchmark Format (version 1), for every program: one cone a norm term, one for the energy.
#
#     minimise    q - g'd + w't                       over d (n), t (m), q, p (soft limits only), all free
#     subject to  (q, 1, F d, c^{1/2} p) in QR        2 q >= |F d|^2 + sum c_j p_j^2, with F'F = K
#                 (t_i, B_i d - b_i)     in Q         |B_i d - b_i| <= t_i, one cone a term
#                 e - D d + c p          in L+        p is the force of a soft limit
#
# F is a Cholesky factor of K; where K has a kernel, and is dense, it has as many rows less. K = F'F is what a reader
# gets back, with the rounding of that product. The comment in the first line gives n, m, the size of a block, the
# number of limits and that of soft ones. At a solution the dual of a cone Q is (w_i, -lam_i), that of L+ is p.


CBF_HEAD = "# vemcvx program:"
SIZES = "unknowns", "terms", "block", "limits", "soft"


def root(operators: Operators) -> sp.csr_matrix:
    """F with F'F = K, as many rows as K has rank."""
    K = operators.K
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
    return {".cbf": "\n".join([*_cbf_lines(program), ""]).encode()}


def _cbf_lines(program: StepProgram) -> Iterator[str]:
    operators = program.operators
    n, m, block, soft = len(program.g), operators.count, operators.block, np.flatnonzero(operators.compliance)
    A, b, cones = _constraints(program, soft)
    yield f"{CBF_HEAD} unknowns {n} terms {m} block {block} limits {len(program.e)} soft {len(soft)}"
    yield from ("VER", "1", "", "OBJSENSE", "MIN", "", "VAR", f"{A.shape[1]} 1", f"F {A.shape[1]}", "")
    yield from ("CON", f"{A.shape[0]} {len(cones)}", *cones, "")
    cost = np.concatenate([-program.g, program.w, [1.0], np.zeros(len(soft))])
    yield from _section("OBJACOORD", [f"{j} {number(x)}" for j, x in enumerate(cost) if x])
    yield from _section("ACOORD", [f"{i} {j} {number(x)}" for i, j, x in triplets(A)])
    yield from _section("BCOORD", [f"{i} {number(x)}" for i, x in enumerate(b) if x])


def _section(name: str, lines: list[str]) -> list[str]:
    return [name, str(len(lines)), *lines, ""]


def _constraints(program: StepProgram, soft: Ints) -> tuple[sp.csr_matrix, Floats, list[str]]:
    """A and b of A x + b, x = (d, t, q, p), and the cones that its rows are in."""
    operators = program.operators
    m, block, c, F = operators.count, operators.block, operators.compliance, root(operators)
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
    """The program of a file of this form, K = F'F.

    Raises
    ------
    ProgramError
        It is of another form.
    """
    lines = path.read_text().splitlines()
    if not lines or not lines[0].startswith(CBF_HEAD):
        raise ProgramError(f"found no first line {CBF_HEAD!r}; only files that write_program() has made are read.")
    try:
        return _program(_sizes(lines), lines)
    except (ValueError, IndexError, OverflowError) as error:
        raise ProgramError(f"is no CBF file of a step's program: {error}.") from error


def _sizes(lines: list[str]) -> tuple[int, ...]:
    """The sizes on the first line of a section."""
    words, most = lines[0].removeprefix(CBF_HEAD).split(), sum(map(len, lines))
    sizes = tuple(int(word) if word.isdecimal() and len(word) < 19 else -1 for word in words[1::2])
    if tuple(words[::2]) != SIZES or len(sizes) != len(SIZES) or not 0 <= min(sizes) <= max(sizes) <= most:
        raise ValueError(
            f"the first line says {' '.join(words)[:100]!r}; wanted {', '.join(SIZES)}, each with a whole number "
            f"from 0 to {most}, which a file of this size has room for"
        )
    return sizes


def _program(sizes: tuple[int, ...], lines: list[str]) -> StepProgram:
    n, m, block, r, s = sizes
    if block < 1 or "CON" not in lines:
        raise ValueError(f"found {f'blocks of {block} components' if block < 1 else 'no section CON'}")
    at = lines.index("CON")
    rows = int(lines[at + 1].split()[0])
    energy = rows - r - m * (1 + block)
    cones = _cones(energy, m, block, r)
    found = lines[at + 2 : at + 2 + len(cones)]
    if found != cones or not 0 <= energy - 2 - s <= n:
        raise ValueError(
            f"its cones are not those of {n} unknowns, {m} terms of block {block}, {r} limits and {s} soft ones, which "
            f"leave {energy} of {rows} rows to the energy"
        )
    cost, b = np.zeros(n + m + 1 + s), np.zeros(rows)
    for x, section in ((cost, "OBJACOORD"), (b, "BCOORD")):
        places, values = _entries(lines, section, x.shape)
        x[places[:, 0]] = values
    places, values = _entries(lines, "ACOORD", (rows, len(cost)))
    A: sp.csr_matrix = sp.csr_matrix((values, places.T), shape=(rows, len(cost)))
    cone = energy + np.arange(m * (1 + block)).reshape(m, 1 + block)[:, 1:].ravel()
    F, limits = A[2 : energy - s, :n], slice(rows - r, rows)
    K = F.T @ F
    K = sp.csr_matrix(0.5 * (K + K.T))
    parts: Parts = {"g": -cost[:n], "w": cost[n : n + m], "B": A[cone, :n], "b": -b[cone]}
    parts |= {"D": -A[limits, :n], "e": b[limits], "c": A[limits, n + m + 1 :] @ np.ones(s)}
    stiffness = K.toarray() if K.nnz > 0.5 * n * n else K
    return put_together(parts | {"K": stiffness} | null_motions(stiffness, n - F.shape[0]))


def _entries(lines: list[str], section: str, shape: tuple[int, ...]) -> tuple[Ints, Floats]:
    """Places and values of the entries of a section, of an array of that shape."""
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
    return places, np.array([float(words[-1]) for words in found])


# QPS, the MPS format with a quadratic objective, for programs of absolute values, bounds and soft limits.
#
#     minimise  1/2 d'Kd - g'd + w't + 1/2 sum c_j p_j^2
#     rows      U_i: B_i d - t_i <= b_i,   L_i: -B_i d - t_i <= -b_i,   Z_j: D_j d - c_j p_j <= e_j
#     bounds    d free, t, p >= 0
#
# in free format, the upper triangle of the Hessian in QUADOBJ. Duals of U less those of L (of solvers whose duals of
# such rows are >= 0) are lam, those of Z are p; the columns p_j, of soft limits only, are the forces of these. That t
# >= 0 is implied; without it HiGHS 1.15 may call d = 0 optimal (problems/highs_optimal_at_zero.py).


QPS_HEAD = "* vemcvx program, motions in the kernel of K:"
SECTIONS = "NAME", "ROWS", "COLUMNS", "RHS", "RANGES", "BOUNDS", "QUADOBJ", "ENDATA"


def to_qps(program: StepProgram, suffix: str = ".qps") -> dict[str, bytes]:
    """The file, under its suffix: readers that go by it may want .mps.

    Raises
    ------
    ProgramError
        The program has second-order cones.
    """
    if SECOND_ORDER_CONES in program.operators.features:
        raise ProgramError("QPS has no second-order cones, which this program has; write .cbf, .npz or .mtx.")
    return {suffix: "\n".join([*_qps_lines(program), ""]).encode()}


def _qps_lines(program: StepProgram) -> Iterator[str]:
    m, r = len(program.w), len(program.e)
    kernel = 0 if program.operators.kernel is None else program.operators.kernel.shape[1]
    yield from (f"{QPS_HEAD} {kernel}", "NAME vemcvx", "ROWS", " N cost")
    yield from (f" L U{i + 1}" for i in range(m))
    yield from (f" L L{i + 1}" for i in range(m))
    yield from (f" L Z{j + 1}" for j in range(r))
    yield "COLUMNS"
    yield from _columns(program)
    yield "RHS"
    for name, values in (("U", program.b), ("L", -program.b), ("Z", program.e)):
        yield from (f" rhs {name}{i + 1} {number(x)}" for i, x in enumerate(values) if x)
    yield "BOUNDS"
    yield from (f" FR bound d{i + 1}" for i in range(len(program.g)))
    yield "QUADOBJ"
    for i, j, x in triplets(sp.csr_matrix(sp.triu(sp.csr_matrix(program.operators.K), format="csr"))):
        yield f" d{i + 1} d{j + 1} {number(x)}"
    for k, c in enumerate(program.operators.compliance, start=1):
        if c:
            yield f" p{k} p{k} {number(c)}"
    yield "ENDATA"


def _columns(program: StepProgram) -> Iterator[str]:
    B, D = sp.csc_matrix(program.operators.B), sp.csc_matrix(program.operators.D)
    for i, force in enumerate(program.g):
        yield f" d{i + 1} cost {number(-force)}"
        for k in range(B.indptr[i], B.indptr[i + 1]):
            yield f" d{i + 1} U{B.indices[k] + 1} {number(B.data[k])}"
            yield f" d{i + 1} L{B.indices[k] + 1} {number(-B.data[k])}"
        for k in range(D.indptr[i], D.indptr[i + 1]):
            yield f" d{i + 1} Z{D.indices[k] + 1} {number(D.data[k])}"
    for i, weight in enumerate(program.w):
        yield from (f" t{i + 1} cost {number(weight)}", f" t{i + 1} U{i + 1} -1", f" t{i + 1} L{i + 1} -1")
    for k, c in enumerate(program.operators.compliance, start=1):
        if c:
            yield f" p{k} Z{k} {number(-c)}"


def from_qps(path: Path) -> StepProgram:
    """The program of a file of this form.

    Raises
    ------
    ProgramError
        It is of another form.
    """
    entries: dict[str, list[list[str]]] = {name: [] for name in SECTIONS}
    section, lines = "NAME", path.read_text().splitlines()
    for line in lines:
        words = line.split()
        if not words or line[0] == "*":
            continue
        if line[0] != " ":
            section = words[0]
            if section not in entries:
                raise ProgramError(f"found the section {section!r}; there are {', '.join(SECTIONS)}.")
            continue
        entries[section].append(words)
    try:
        if not lines or not lines[0].startswith(QPS_HEAD):
            raise ValueError(f"found no first line {QPS_HEAD!r}; only files that write_program() has made are read")
        return _assembled(entries, int(lines[0].removeprefix(QPS_HEAD)))
    except (ValueError, OverflowError) as error:
        raise ProgramError(f"is no QPS file of a step's program: {error}.") from error


def _assembled(entries: dict[str, list[list[str]]], kernel: int) -> StepProgram:
    lengths = {"ROWS": 2, "COLUMNS": 3, "RHS": 3, "QUADOBJ": 3, "BOUNDS": 3}
    for section, length in lengths.items():
        other = [words for words in entries[section] if len(words) != length]
        if other:
            raise ValueError(f"section {section} has the line {' '.join(other[0])[:60]!r}; wanted {length} words")
    rows = [words[1] for words in entries["ROWS"]]
    n = sum(words[0] == "FR" for words in entries["BOUNDS"])
    m, r = (sum(name[0] == letter for name in rows) for letter in "UZ")
    sizes = {"d": n, "t": m, "p": r, "U": m, "L": m, "Z": r}
    vectors = {"g": np.zeros(n), "w": np.zeros(m), "b": np.zeros(m), "e": np.zeros(r), "c": np.zeros(r)}
    B, D, K = sp.lil_matrix((m, n)), sp.lil_matrix((r, n)), sp.lil_matrix((n, n))
    for column, row, value in entries["COLUMNS"]:
        (kind, i), x = _place(column, "dtp", sizes), float(value)
        if row == "cost":
            vectors["g" if kind == "d" else "w"][i] = -x if kind == "d" else x
            continue
        side, j = _place(row, "ULZ", sizes)
        if kind == "d" and side in "UZ":
            (B if side == "U" else D)[j, i] = x
    for _, row, value in entries["RHS"]:
        side, j = _place(row, "ULZ", sizes)
        if side in "UZ":
            vectors["b" if side == "U" else "e"][j] = float(value)
    for one, two, value in entries["QUADOBJ"]:
        (kind, i), (other_kind, j), x = _place(one, "dp", sizes), _place(two, "dp", sizes), float(value)
        if kind != other_kind or (kind == "p" and i != j):
            raise ValueError(f"section QUADOBJ couples {one!r} and {two!r}; wanted two of d, or one p twice")
        if kind == "p":
            vectors["c"][i] = x
        else:
            K[i, j] = K[j, i] = x
    stiffness = sp.csr_matrix(K)
    dense = stiffness.toarray() if stiffness.nnz > 0.5 * n * n else stiffness
    parts: Parts = {"K": dense, "B": sp.csr_matrix(B), "D": sp.csr_matrix(D), **vectors}
    return put_together(parts | null_motions(dense, kernel))


def _place(name: str, kinds: str, sizes: dict[str, int]) -> tuple[str, int]:
    """The kind of a row or column and its number from 0."""
    kind, number = name[0], name[1:]
    if kind not in kinds or not number.isdecimal() or len(number) > 18 or not 1 <= int(number) <= sizes[kind]:
        there = ", ".join(f"{letter}1 to {letter}{sizes[letter]}" for letter in kinds if sizes[letter])
        raise ValueError(f"found {name[:30]!r}; there are {there or 'none'}")
    return kind, int(number) - 1
