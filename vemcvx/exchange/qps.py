"""QPS, the MPS format with a quadratic objective, for programs of absolute values, bounds and soft limits.

    minimise  1/2 d'Kd - g'd + w't + 1/2 sum c_j p_j^2
    rows      U_i: B_i d - t_i <= b_i,   L_i: -B_i d - t_i <= -b_i,   Z_j: D_j d - c_j p_j <= e_j      d free, t, p >= 0

in free format, the upper triangle of the Hessian in QUADOBJ. Duals of U less those of L (of solvers whose duals of such
rows are >= 0) are lam, those of Z are p; the columns p_j, of soft limits only, are the forces of these. That t >= 0 is
implied; without it HiGHS 1.15 may call d = 0 optimal (problems/highs_optimal_at_zero.py).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from vemcvx.errors import ProgramError
from vemcvx.exchange.parts import Parts, null_motions, number, put_together, triplets
from vemcvx.program.operators import SECOND_ORDER_CONES
from vemcvx.program.step_program import StepProgram

HEAD = "* vemcvx program, motions in the kernel of K:"
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
    return {suffix: "\n".join([*_lines(program), ""]).encode()}


def _lines(program: StepProgram) -> Iterator[str]:
    m, r = len(program.w), len(program.e)
    kernel = 0 if program.operators.kernel is None else program.operators.kernel.shape[1]
    yield from (f"{HEAD} {kernel}", "NAME vemcvx", "ROWS", " N cost")
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
        if not lines or not lines[0].startswith(HEAD):
            raise ValueError(f"found no first line {HEAD!r}; only files that write_program() has made are read")
        return _assembled(entries, int(lines[0].removeprefix(HEAD)))
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
