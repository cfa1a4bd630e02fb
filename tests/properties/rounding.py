"""What rounding allows: the tolerances of all properties, derived and never guessed.

Entry (i, j) of a sum of positive semidefinite matrices is at most M_ij = sqrt(K_ii K_jj) in every summand's absolute
values together (Cauchy and Schwarz, once a summand and once over the sum), so that what rounding of single entries,
of products K y and of their sums does is at most a small multiple of eps M|y|, however the entries cancel.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from strategies import Case

from vemcvx.program import Operators, StepProgram

EPS = float(np.finfo(float).eps)


def majorant(A):
    """M_ij = sqrt(A_ii A_jj), which no entry of a summand of A exceeds."""
    root = np.sqrt(np.diagonal(A))
    return np.outer(root, root)


@dataclass(frozen=True)
class Energy:
    """The norms of a(u, u) = u'Ku and of forces, with what rounding does to them."""

    K: np.ndarray

    @cached_property
    def factor(self):
        """R with K = R'R."""
        return np.linalg.cholesky(self.K).T

    @cached_property
    def flexibility(self):
        """|K^{-1}|, entry by entry: forces of absolute values at most b have |f|_{K^{-1}}^2 <= b'|K^{-1}|b."""
        return np.abs(np.linalg.inv(self.K))

    def norm(self, u):
        """|u|_K."""
        return float(np.linalg.norm(self.factor @ u))

    def force_norm(self, f):
        """|f|_{K^{-1}}, the norm of the answer to f."""
        return float(np.linalg.norm(np.linalg.solve(self.factor.T, f)))

    def of_blurred_force(self, blur):
        """The largest |f|_{K^{-1}} of forces with |f_i| <= blur_i."""
        return float(np.sqrt(blur @ self.flexibility @ blur))

    def of_blurred_state(self, blur):
        """The largest |u|_K of states with |u_i| <= blur_i."""
        return float(np.sqrt(blur @ np.abs(self.K) @ blur))

    def rounding_of_forces(self, f, *states):
        """What f - K y is blurred by, in the norm of forces: n + 2 roundings a row, with M for |K|."""
        size = np.abs(f) + majorant(self.K) @ sum(map(np.abs, states))
        return self.of_blurred_force((len(f) + 2) * EPS * size)


@dataclass(frozen=True)
class Marched:
    """A case, its trajectory, and how far each step is from the exact one.

    The certificate: y~ = y_{n-1} + d differs from the exact step T(y_{n-1}) by at most sqrt(2 gap) + sqrt(2 floor) in
    the energy norm. The state that is stored is y_n = y~ (1 + eps): this moves it, and the residual that the gap
    was measured with, by |eps |y_n||_K each.
    """

    case: Case
    trajectory: object

    @cached_property
    def energy(self):
        """Norms of the case."""
        return Energy(self.case.K)

    @cached_property
    def errors(self):
        """(N + 1,) bounds of |y_n - T(y_{n-1})|_K; nothing is solved for at the start."""
        t = self.trajectory
        stored = [self.energy.of_blurred_state(EPS * np.abs(y)) for y in t.state]
        errors = np.sqrt(2 * t.gap) + np.sqrt(2 * t.floor) + 2 * np.array(stored)
        errors[0] = 0.0
        return errors

    @cached_property
    def size(self):
        """The largest energy norm of the states, and of what the loads alone would do."""
        loaded = max(self.energy.force_norm(f) for f in self.case.loads)
        return max(loaded, float(self.trajectory.norm.max()))

    @cached_property
    def operators(self):
        """The form of all steps, nothing condensed."""
        return Operators(self.case.K, self.case.B, self.case.block)

    def program(self, n):
        """Step n in the increment d = y_n - y_{n-1}, nothing condensed, nothing scaled."""
        g = self.case.loads[n] - self.case.K @ self.trajectory.state[n - 1]
        return StepProgram(self.operators, g, self.case.weights[n], np.zeros(self.case.B.shape[0]))

    def increment(self, n):
        """y_n - y_{n-1} as stored."""
        return self.trajectory.state[n] - self.trajectory.state[n - 1]

    def blur_of_objective(self, n, *points):
        """What the objective of step n may be wrong by at each of the points: a sum of n + 3 products a summand.

        g = f - K y_{n-1} is known to (n + 2) eps (|f| + M|y_{n-1}|), and so is its work on a point.
        """
        case, program = self.case, self.program(n)
        known = np.abs(case.loads[n]) + majorant(case.K) @ np.abs(self.trajectory.state[n - 1])
        weights = np.repeat(program.w, case.block)
        total = 0.0
        for d in map(np.abs, points):
            total += d @ majorant(case.K) @ d + 2 * known @ d + weights @ (abs(case.B) @ d)
        return (len(known) + 3) * EPS * total

    def capped_weights(self, n):
        """Weights (m,) that ask no more than step n can: larger ones have the same answer.

        B'lam = K r with r the projection of a on a set of such r, about zero (see `steps_are_stable`). So |r|_K is at
        most the norm of the part of a = K^{-1} g that is one: lam'C lam <= (B a)'C^{-1} B a, C = B K^{-1} B'; and
        |lam_i|^2 is at most that times the norm of block (i, i) of C^{-1}.
        """
        case, B, terms = self.case, self.case.B.toarray(), len(self.case.weights[n])
        inverse = np.linalg.inv(B @ np.linalg.solve(case.K, B.T))
        push = B @ np.linalg.solve(case.K, self.program(n).g)
        blocks = inverse.reshape(terms, case.block, terms, case.block)
        largest = np.array([np.linalg.norm(blocks[i, :, i], 2) for i in range(terms)])
        return np.minimum(case.weights[n], np.sqrt(push @ inverse @ push * largest))

    def friction_gap(self, n):
        """sum w_i |s_i| - lam_i . s_i of the stored step, and what rounding of the stored states adds to it.

        The weights are those that matter (`capped_weights`). s is wrong by (n + 1) eps |B| (|y_n| + |y_{n-1}|), and
        w|s| - lam.s is 2w-Lipschitz in s. |lam| = w holds to 2 eps w only.
        """
        case, y, w = self.case, self.trajectory.state, self.capped_weights(n)
        lam, s = self.trajectory.multipliers[n], self.program(n).slip(self.increment(n))
        moved = abs(case.B) @ (np.abs(y[n]) + np.abs(y[n - 1]))
        size = np.maximum(w, np.linalg.norm(lam, axis=1))
        blur = 2 * (case.B.shape[1] + 3) * EPS * np.repeat(size, case.block) @ moved
        return float((w * np.linalg.norm(s, axis=1) - np.einsum("ij,ij->i", lam, s)).sum()), float(blur)


def marched(case, solver):
    """March a case without insisting on the accuracy: what is claimed is what is tested."""
    return Marched(case, case.march(solver, check=False))
