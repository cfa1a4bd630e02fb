"""SciPy's sparse direct solver, the default, and orders of elimination with little fill."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spilu, splu

from vemcvx.arrays import EPS, Bools, Floats, Ints, power_of_two
from vemcvx.linear.factor import SAMPLES, Factor, LinearSolver, Matrix, singular, weighted

# Orders of elimination with little fill.
#
# Nested dissection (George, SIAM J. Numer. Anal. 10, 1973): halve the unknowns by a straight line, put the unknowns
# that the two halves share last, and go on within each half; all parts of a level at once. On the coordinates it
# takes 0.08 s at 131k unknowns and gives a third less fill than the minimum degree order of the sparse solver.


LEAF = 8
"""Sets this small are ordered as they come; with 48 there is 9 % more fill at 131k unknowns, with 4 none less."""


def nested_dissection(graph: sp.csr_matrix, points: Floats) -> Ints:
    """Order the n vertices of `graph` (n, n), symmetric, placed at `points` (n, dim), separators last."""
    n = len(points)
    order, part, ends = np.empty(n, dtype=np.int64), np.zeros(n, dtype=np.int64), np.array([n])
    tail = np.repeat(np.arange(n, dtype=graph.indices.dtype), np.diff(graph.indptr))
    once = tail < graph.indices
    tail, head = tail[once], graph.indices[once]
    # The vertices without a place yet, part by part, sorted along every axis.
    members = np.argsort(points, axis=0, kind="stable").T
    while members.size:
        sizes = np.bincount(part[members[0]], minlength=len(ends))
        upper = _upper_halves(points, members, part, sizes)
        # What goes last in its part: separators, and all of a small one.
        last = np.zeros(n, dtype=bool)
        last[members[0]] = (sizes <= LEAF)[part[members[0]]]
        crossing = upper[tail] != upper[head]
        last[np.where(upper[tail[crossing]], tail[crossing], head[crossing])] = True
        placed = members[0][last[members[0]]]
        counts = np.bincount(part[placed], minlength=len(ends))
        ends = ends - counts
        order[(ends + counts - np.cumsum(counts))[part[placed]] + np.arange(len(placed))] = placed
        within = ~(last[tail] | last[head])
        tail, head = tail[within], head[within]
        members = members[~last[members]].reshape(len(members), -1)
        half = 2 * part + upper
        # Halves become parts, sorted as they were: stable sorts of short integers take linear time.
        short = half[members].astype(np.min_scalar_type(2 * len(ends)))
        members = np.take_along_axis(members, np.argsort(short, axis=1, kind="stable"), axis=1)
        left = np.bincount(half[members[0]], minlength=2 * len(ends))
        ends = np.column_stack([ends - left[1::2], ends]).ravel()[left > 0]
        part = (np.cumsum(left > 0) - 1)[half]
    return order


def _upper_halves(points: Floats, members: Ints, part: Ints, sizes: Ints) -> Bools:
    """(n,) which vertices are beyond the middle of their part along its longest direction."""
    stop = np.cumsum(sizes)
    start, middle = stop - sizes, stop - (sizes + 1) // 2
    reach = [points[along[stop - 1], axis] - points[along[start], axis] for axis, along in enumerate(members)]
    longest = np.argmax(reach, axis=0)
    cut, least = (points[members[longest, at], longest] for at in (middle, start))
    upper, all_of = np.zeros(len(points), dtype=bool), members[0]
    upper[all_of] = points[all_of, longest[part[all_of]]] >= cut[part[all_of]]
    for level in np.flatnonzero(cut == least):
        upper[members[longest[level], start[level] : middle[level]]] = False
    return upper


def minimum_degree(K: sp.csr_matrix) -> Ints:
    """The sparse solver's own order of K, for matrices without coordinates.

    An incomplete factorisation that drops everything costs little more than its order. It is taken of the pattern of
    K with a dominant diagonal, so that no pivot can fail.
    """
    pattern = sp.csc_matrix(K, copy=True)
    pattern.data[:] = 1.0
    dominant = pattern + K.shape[0] * sp.eye_array(K.shape[0], format="csc")
    return np.argsort(spilu(dominant, drop_tol=1e6, fill_factor=1, permc_spec="MMD_AT_PLUS_A").perm_c)


# SciPy's sparse direct solver, the default.
#
# If the unknowns c come last in K = L U, the Schur complement onto them is S = L_cc U_cc, the trailing block of
# the factors: it costs no more than the factorisation, where one solve an unknown of c would cost six of them
# on the paper's reference (h = 1/256).


# Symmetric mode: pivots stay on the diagonal, which a positive definite matrix allows, and halves the
# time of the default (1.3 s against 3.1 s at 100k unknowns). Equilibration is off because powers of two
# in the data must stay powers of two in the factors.
PIVOTS = 0.0
SYMMETRIC = {"SymmetricMode": True, "Equil": False}


@dataclass(frozen=True)
class SuperLU(LinearSolver):
    """Sparse LU with diagonal pivots: the default up to two million unknowns."""

    eliminates: ClassVar[bool] = True

    def memory_in_space(self, unknowns: int) -> float:
        # Measured on cubes, on nested dissection, at the peak: .25, .66 GB of 13,600 and 26,040 unknowns.
        return float(236.0 * unknowns**1.46)

    def factorise(self, K: sp.csr_matrix, near_kernel: Floats | None = None) -> PositiveFactor:
        return PositiveFactor(K)

    def eliminate(self, K: sp.csr_matrix, order: Ints, last: Ints) -> tuple[PositiveFactor, Floats]:
        at_end = np.zeros(K.shape[0], dtype=bool)
        at_end[last] = True
        factor = PositiveFactor(K, np.concatenate([order[~at_end[order]], last]), len(last))
        return factor, factor.schur


class SparseFactor(Factor):
    """K = L U, in a given order of the unknowns, or in that of minimum degree; to solve with."""

    def __init__(self, K: sp.csr_matrix, order: Ints | None = None):
        self._order = np.arange(K.shape[0]) if order is None else order
        columns: Literal["MMD_AT_PLUS_A", "NATURAL"] = "MMD_AT_PLUS_A" if order is None else "NATURAL"
        ordered = sp.csc_matrix(K if order is None else K[order][:, order])
        try:
            self._lu = splu(ordered, permc_spec=columns, diag_pivot_thresh=PIVOTS, options=SYMMETRIC)
        except RuntimeError as error:
            raise singular() from error

    def solve(self, b: Floats) -> Floats:
        if not b.any():
            return np.zeros_like(b)
        x = np.empty_like(b)
        x[self._order] = self._lu.solve(b[self._order])
        return x

    def within(self, K_FF: Matrix, F: Ints) -> SparseFactor:
        return SparseFactor(sp.csr_matrix(K_FF))


class PositiveFactor(SparseFactor):
    """K = L U of a K that is positive definite by its pivots, and what can be read off the factors.

    Attributes
    ----------
    schur : (m, m) array
        The Schur complement L_cc U_cc onto the last m unknowns in the order.

    Raises
    ------
    SceneError
        K is not positive definite: pivots left the diagonal, or one is no larger than the rounding of what it is
        the rest of. With the diagonal's pivots K = L D L', and by Sylvester's law of inertia they have the signs
        of the eigenvalues. Of a K with a kernel and as many anchors this says that K is semidefinite: the Schur
        complements of [[K + E, P], [P', E_aa^{-1}]] onto either block have the same inertia (Haynsworth 1968),
        and that onto the second, of as many unknowns as there are modes, vanishes.
    """

    def __init__(self, K: sp.csr_matrix, order: Ints | None = None, m: int = 0):
        super().__init__(K, order)
        self._K = K
        L, U, pivoted = self._lu.L, self._lu.U, self._order[np.argsort(self._lu.perm_c)]
        pivots = U.diagonal()
        if not np.array_equal(self._lu.perm_r, self._lu.perm_c) or not (pivots > EPS * K.diagonal()[pivoted]).all():
            raise singular()
        # The solver may renumber within its elimination tree; that permutes L and U but changes no entry.
        place = self._lu.perm_c[len(self._order) - m :]
        S: Floats = (L[:, place][place] @ U[:, place][place]).toarray()
        self.schur = 0.5 * (S + S.T)
        self._unit, self._forces = self._random(L, pivots)
        for copied in (L, U):
            _release(copied)

    def random_energy(self, size: Floats) -> float:
        return weighted(size, self.compliance)

    def solve_beside_samples(self, b: Floats) -> Floats:
        # Nine right sides take a seventh more time than eight, one alone a third of that.
        if "_samples" in vars(self):
            return self.solve(b)
        x = self.solve(np.column_stack([b, self._forces]))
        self._samples = self._sampled(x[:, 1:])
        return x[:, 0].copy()

    @cached_property
    def lost(self) -> float:
        b, x, _ = self._samples
        return self._unit * self.energy(b - self._K @ x)

    @property
    def compliance(self) -> Floats:
        """(n,) the diagonal of K^{-1}, estimated once: the mean squares of x = K^{-1} b for the forces b of _random."""
        return self._samples[2]

    @cached_property
    def _samples(self) -> tuple[Floats, Floats, Floats]:
        """One of the forces of _random, its response x, and unit times the mean squares of all x; (n,) each."""
        return self._sampled(self.solve(self._forces))

    def _sampled(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        b = self._forces[:, 0].copy()
        del self._forces
        return b, x[:, 0].copy(), self._unit / SAMPLES * np.einsum("ij,ij->i", x, x)

    def _random(self, L: sp.csc_array, D: Floats) -> tuple[float, Floats]:
        """A unit u, and forces (n, SAMPLES) L (D / u)^{1/2} z of the covariance K / u; z is normal.

        Their responses are of the covariance K^{-1} / u. With u a power of two roots are taken of the same numbers in
        all units.
        """
        unit = float(power_of_two(D.max(initial=0.0)))
        z = np.random.default_rng(0).standard_normal((len(D), SAMPLES))
        z *= np.sqrt(D / unit)[:, None]
        place = np.empty_like(self._order)
        place[self._order] = self._lu.perm_c
        return unit, (L @ z)[place]


def _release(factor: sp.csc_array) -> None:
    """Give back the memory of a copy of a factor.

    SciPy makes these copies beside the factors it solves with and keeps them for the next time they are asked for:
    22 million entries, 265 MB, on the paper's reference (h = 1/256). Nobody asks again.
    """
    for name, kept in (("data", 0), ("indices", 0), ("indptr", 1)):
        setattr(factor, name, getattr(factor, name)[:kept].copy())
