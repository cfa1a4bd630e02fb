"""K with a kernel N: motions that cost no energy, held by norm terms and limits alone.

That is a body without supports, held by friction, or by its weight on an obstacle. A step min 1/2 d'Kd - g'd +
sum_i w_i |B_i d - b_i| subject to Dd <= e then has a solution if no motion Nc pays,

    c'N'g < sum_i w_i |B_i N c|   for all c with DNc <= 0,   so that   N'g = N'B'lam + N'D'p,  |lam_i| <= w_i,  p >= 0,

and K d* is unique while d* need not be: errors are measured in the seminorm |.|_K. Stiffness on k unknowns (*anchors*)
that the motions move makes K positive definite, so that it can be factorised. Newton's method has the motions
themselves as unknowns (:mod:`vemcvx.program.forces`); solvers that do not take a semidefinite K are refused.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.linalg import qr

from vemcvx.base.arrays import (
    EPS,
    Floats,
    as_real_array,
    brief,
    called,
    directions,
    finite,
    function,
    lengths,
    onto_discs,
)
from vemcvx.base.errors import SceneError

ROUNDS = 50
"""Corrections of multipliers that are out of balance; each but the last cuts some of them."""
GAIN = 1e-9
"""Gain of a motion, in parts of the load, that an interior-point method tells from zero."""


@dataclass(frozen=True)
class Kernel:
    """The motions that K does not feel.

    Parameters
    ----------
    modes : (n, k) array
        Independent motions with K modes = 0.
    names : (k,) sequence of str
        The motions in words, for messages.
    in_words : callable (k,) -> str, optional
        A combination of the motions in words, the way it goes; by default the names of those that take part.
    """

    modes: Floats
    names: tuple[str, ...]
    in_words: Callable[[Floats], str] | None = None

    def __post_init__(self) -> None:
        modes = as_real_array(self.modes, "Kernel: modes", "(n, k) motions, one a column")
        names = self.names if isinstance(self.names, (tuple, list)) else ()
        if modes.ndim != 2 or len(names) != modes.shape[1] or not all(isinstance(name, str) for name in names):
            raise SceneError(
                f"Kernel: found modes of shape {modes.shape} and names = {brief(self.names)}; wanted one column of "
                "numbers, and one name, a motion."
            )
        function(self.in_words, "Kernel: found in_words", "a function of (k,) shares of the motions")
        object.__setattr__(self, "modes", finite(modes, "Kernel: modes"))
        object.__setattr__(self, "names", tuple(names))

    @cached_property
    def basis(self) -> Floats:
        """(n, k) orthonormal motions that span those of `modes`."""
        return np.linalg.qr(self.modes)[0]

    def name(self, c: Floats) -> str:
        """Return the motion modes @ c in words, the way it goes."""
        if self.in_words is not None:
            return str(called(self.in_words, (c,), "Kernel: in_words failed", "say which motion they make"))
        large = np.flatnonzero(np.abs(c) > 1e-3 * np.abs(c).max())
        return " with ".join(self.names[i] if c[i] > 0 else f"the reverse of {self.names[i]}" for i in large)


def rank_on(rows: sp.csr_matrix, modes: Floats) -> int:
    """Return the number of motions `modes` (n, k) that rows feel by more than rounding."""
    read, size = np.asarray(abs(rows).sum(axis=1)).ravel(), np.abs(modes).max(axis=0, initial=0.0)
    seen = (rows @ modes)[read > 0] / read[read > 0, None] / np.where(size > 0, size, 1.0)
    return int(np.linalg.matrix_rank(seen, tol=8 * EPS * max(len(seen), 1)))


def anchors(modes: Floats, diagonal: Floats) -> Floats:
    """Return stiffness (m,) at as many unknowns as there are modes (m, k), those that tell them apart best; else zero.

    It is K's diagonal there: soft anchors would cost W = A K^{-1}A' digits.
    """
    picked = qr(modes.T, mode="economic", pivoting=True)[2][: modes.shape[1]]
    stiffness = np.zeros(len(modes))
    stiffness[picked] = diagonal[picked]
    return stiffness


@dataclass(frozen=True)
class KernelBalance:
    """The balance on a kernel: norm terms and limits feel its motions N, and hold a load N'g = `push` (k,) there."""

    friction_modes: Floats
    """(m, block, k) B_i N"""
    contact_modes: Floats
    """(r, k) D N"""

    @cached_property
    def modes(self) -> Floats:
        """(m * block + r, k) the motions of all rows."""
        return np.concatenate([self.friction_modes.reshape(-1, self.contact_modes.shape[1]), self.contact_modes])

    def imbalance(self, lam: Floats, p: Floats, push: Floats, pushed: Floats) -> tuple[Floats, Floats]:
        """Return what multipliers leave of the load (k,), and its rounding (k,); `pushed` is |N|'|g|."""
        x = np.append(lam, p)
        return push - x @ self.modes, 8 * EPS * (pushed + np.abs(x) @ np.abs(self.modes))

    def balanced(
        self, lam: Floats, p: Floats, w: Floats, push: Floats, weights: tuple[Floats, Floats]
    ) -> tuple[Floats, Floats]:
        """Return admissible multipliers near (lam, p) that hold the load, if there are such.

        Least squares with `weights` (m,) and (r,), the larger the more a multiplier is changed; those that are cut at
        their bounds go on along them only.
        """
        (m, block, _), G = self.friction_modes.shape, self.modes
        a, b = np.where(w > 0, weights[0], 0.0), weights[1]
        cut, open_limits = np.zeros(m, dtype=bool), np.zeros(len(p), dtype=bool)
        way, size = np.zeros_like(lam), np.abs(push)
        for _ in range(ROUNDS):
            left, blur = self.imbalance(lam, p, push, size)
            if (np.abs(left) <= blur).all():
                break
            across = way[:, :, None] * np.einsum("ij,ijk->ik", way, self.friction_modes)[:, None]
            moves = (a[:, None, None] * (self.friction_modes - across)).reshape(m * block, G.shape[1])
            moves = np.concatenate([moves, np.where(open_limits, 0.0, b)[:, None] * self.contact_modes])
            dx = moves @ np.linalg.lstsq(G.T @ moves, left, rcond=None)[0]
            lam, p = lam + dx[: m * block].reshape(lam.shape), p + dx[m * block :]
            cut, open_limits = cut | (lengths(lam) > w), open_limits | (p < 0)
            way = np.where(cut[:, None], directions(lam, lengths(lam)), 0.0)
            lam, p = onto_discs(lam, w), np.maximum(p, 0.0)
        return lam, p

    def unbalanced_motion(self, w: Floats, push: Floats) -> Floats | None:
        """Return the motion c (k,) of length one that gains most against friction and limits; None if none gains.

        The gain is push . c - sum w_i |B_i N c|, for motions that run into no limit; below GAIN of the load it is none.
        """
        import cvxpy as cp

        (m, block, k), largest = self.friction_modes.shape, np.abs(push).max(initial=0.0) or 1.0
        c, modes = cp.Variable(k), self.modes
        gain: cp.Expression = (push / largest) @ c
        if m:
            slips = cp.reshape(modes[: m * block] @ c, (block, m), order="F")
            gain -= (w / largest) @ cp.norm(slips, axis=0)
        limits = [modes[m * block :] @ c <= 0] if len(modes) > m * block else []
        problem = cp.Problem(cp.Maximize(gain), [cp.norm(c) <= 1, *limits])
        with warnings.catch_warnings(), suppress(cp.error.SolverError):
            warnings.simplefilter("ignore")  # of answers that are not accurate
            problem.solve(solver="CLARABEL", tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12)
        return None if c.value is None or not problem.value > GAIN else np.asarray(c.value)
