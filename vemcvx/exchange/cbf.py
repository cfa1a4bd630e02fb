"""CBF, the Conic Benchmark Format (version 1), for every program: one cone a norm term, one for the energy.

    minimise    q - g'd + w't                       over d (n), t (m), q, p (soft limits only), all free
    subject to  (q, 1, F d, c^{1/2} p) in QR        2 q >= |F d|^2 + sum c_j p_j^2, with F'F = K
                (t_i, B_i d - b_i)     in Q         |B_i d - b_i| <= t_i, one cone a term
                e - D d + c p          in L+        p is the force of a soft limit

F is a Cholesky factor of K; where K has a kernel, and is dense, it has as many rows less. K = F'F is what a reader gets
back, with the rounding of that product. The comment in the first line gives n, m, the size of a block, the number of
limits and that of soft ones. At a solution the dual of a cone Q is (w_i, -lam_i), that of L+ is p.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import ProgramError
from vemcvx.exchange.parts import Parts, null_motions, number, put_together, triplets
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import StepProgram

HEAD = "# vemcvx program:"
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
    return {".cbf": "\n".join([*_lines(program), ""]).encode()}


def _lines(program: StepProgram) -> Iterator[str]:
    operators = program.operators
    n, m, block, soft = len(program.g), operators.count, operators.block, np.flatnonzero(operators.compliance)
    A, b, cones = _constraints(program, soft)
    yield f"{HEAD} unknowns {n} terms {m} block {block} limits {len(program.e)} soft {len(soft)}"
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
    if not lines or not lines[0].startswith(HEAD):
        raise ProgramError(f"found no first line {HEAD!r}; only files that write_program() has made are read.")
    try:
        return _program(_sizes(lines), lines)
    except (ValueError, IndexError, OverflowError) as error:
        raise ProgramError(f"is no CBF file of a step's program: {error}.") from error


def _sizes(lines: list[str]) -> tuple[int, ...]:
    """What the first line says, where there is room for it."""
    words, most = lines[0].removeprefix(HEAD).split(), sum(map(len, lines))
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
