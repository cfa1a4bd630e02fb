"""Sticking terms and acting bounds whose rows depend on others': at edges and corners, and beside supports.

With all of their equations a system is singular: what each of them carries is not determined. Bounds that follow from
others carry nothing. The forces of discs that share a node are those nearest to what they carried before, in the metric
sum_i |dlam_i|^2 / w_i^2: with a dependence nu among their rows, sum_i nu_i . dlam_i / w_i^2 = 0.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.program.operators import Operators
from vemcvx.solvers.sets import Sets

FOLLOWS = 1e-6
"""Part of a row's length that others leave of it, below which it follows from them."""


def without_redundant_rows(operators: Operators, sets: Sets, lam: Floats, w: Floats) -> Sets:
    """The sets with equations for linearly independent rows alone: those of bounds first, then of sticking terms.

    An absolute value whose row depends on those before it is taken to slip: it carries the share lam_i / w_i of its
    weight. Such a bound carries nothing.
    """
    block = operators.block
    stops, sticks = np.flatnonzero(sets.act & (operators.compliance == 0)), np.flatnonzero(sets.stick)
    own = np.flatnonzero(np.repeat(sets.stick, block))
    rows = sp.csr_matrix(sp.vstack([operators.D[stops], operators.B[own]]))
    # Only rows that share unknowns, or read none, can depend on others.
    shared = np.bincount(rows.indices, minlength=rows.shape[1]) > 1
    some = np.flatnonzero((abs(rows) @ shared > 0) | (abs(rows) @ np.ones(rows.shape[1]) == 0))
    free = np.ones(rows.shape[0], dtype=bool)
    free[some] = independent(rows[some].toarray())
    act = sets.act.copy()
    act[stops] = free[: len(stops)]
    if block > 1:
        idle = own[~free[len(stops) :]]
        shares = np.zeros((len(idle), len(lam) * block))
        shares[:, own] = _shares(rows, free, some, own, w[own // block])
        return replace(sets, act=act, idle=idle, shares=shares)
    stick = sets.stick.copy()
    stick[sticks] = free[len(stops) :]
    most = np.maximum(w, np.linalg.norm(lam, axis=1))[:, None]
    share = np.divide(lam, most, out=np.zeros_like(lam), where=most > 0)
    direction = np.where((sets.stick & ~stick)[:, None], share, sets.direction)
    return replace(sets, act=act, stick=stick, direction=direction)


def _shares(rows: sp.csr_matrix, free: Bools, some: Ints, own: Ints, w: Floats) -> Floats:
    """(k, len(own)) how k sticking rows depend on others, over w (len(own),) squared; bounds come first in `rows`."""
    stops = rows.shape[0] - len(own)
    basis, rest = some[free[some]], some[~free[some] & (some >= stops)]
    dependence = np.zeros((len(rest), rows.shape[0]))
    dependence[:, basis] = -np.linalg.lstsq(rows[basis].toarray().T, rows[rest].toarray().T, rcond=None)[0].T
    dependence[np.arange(len(rest)), rest] = 1.0
    own_part = dependence[:, stops:]
    involved = np.abs(own_part) > FOLLOWS * np.abs(own_part).max(axis=1, initial=0.0, keepdims=True)
    least = np.where(involved, w, np.inf).min(axis=1, initial=np.inf, keepdims=True)
    # Discs of no radius carry nothing, whatever the others do.
    nearness = np.divide(least, w, out=np.ones_like(own_part), where=involved & (w > 0))
    weighted = np.where(involved, own_part * nearness**2, 0.0)
    return np.asarray(weighted / np.abs(weighted).max(axis=1, initial=0.0, keepdims=True))


def independent(rows: Floats) -> Bools:
    """Which rows (k, n) do not follow from those before them, (k,)."""
    basis, found = np.zeros_like(rows), np.zeros(len(rows), dtype=bool)
    for i, row in enumerate(rows):
        rest = row - basis.T @ (basis @ row)
        rest = rest - basis.T @ (basis @ rest)
        size = np.linalg.norm(rest)
        found[i] = size > FOLLOWS * np.linalg.norm(row)
        basis[i] = rest / size if found[i] else 0.0
    return found
