"""Tolerances of all properties, derived from rounding.

Let K be a sum of positive semidefinite matrices. By Cauchy and Schwarz, the absolute values of entries (i, j) of all
summands add up to at most M_ij = sqrt(K_ii K_jj). So the rounding errors of entries, of products K y and of their sums
are at most a small multiple of eps M|y|, even if entries cancel.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from strategies import Case

from vemcvx.program import Operators, StepProgram

EPS = float(np.finfo(float).eps)


def majorant(A):
    """Return M_ij = sqrt(A_ii A_jj), which bounds the sum of absolute values of the summands of A_ij."""
    root = np.sqrt(np.diagonal(A))
    return np.outer(root, root)


@dataclass(frozen=True)
class Energy:
    """The norms |u|_K of states and |f|_{K^{-1}} of forces, and the effect of rounding errors on both norms."""

    K: np.ndarray

    @cached_property
    def factor(self):
        """The factor R with K = R'R."""
        return np.linalg.cholesky(self.K).T

    @cached_property
    def flexibility(self):
        """The matrix |K^{-1}| of absolute values. If |f_i| <= b_i, then |f|_{K^{-1}}^2 <= b'|K^{-1}|b."""
        return np.abs(np.linalg.inv(self.K))

    def norm(self, u):
        return float(np.linalg.norm(self.factor @ u))

    def force_norm(self, f):
        """Return |f|_{K^{-1}}, the energy norm of K^{-1} f."""
        return float(np.linalg.norm(np.linalg.solve(self.factor.T, f)))

    def of_blurred_force(self, blur):
        """Return a bound of |f|_{K^{-1}} for forces with |f_i| <= blur_i."""
        return float(np.sqrt(blur @ self.flexibility @ blur))

    def of_blurred_state(self, blur):
        """Return a bound of |u|_K for states with |u_i| <= blur_i."""
        return float(np.sqrt(blur @ np.abs(self.K) @ blur))

    def rounding_of_forces(self, f, *states):
        """Return a bound of |e|_{K^{-1}}. Here y is the sum of `states`, and e is the rounding error of f - K y."""
        size = np.abs(f) + majorant(self.K) @ sum(map(np.abs, states))
        return self.of_blurred_force((len(f) + 2) * EPS * size)


@dataclass(frozen=True)
class Marched:
    """A case, its trajectory, and the certified error of each step.

    A solver returns the increment d of step n, with a certified gap and its rounding floor. In the energy norm,
    y_{n-1} + d differs from the exact step T(y_{n-1}) by at most sqrt(2 gap) + sqrt(2 floor). The stored y_n is this
    sum after rounding, which changes the state and the residual by at most `of_blurred_state(EPS |y_n|)` each.
    """

    case: Case
    trajectory: object

    @cached_property
    def energy(self):
        return Energy(self.case.K)

    @cached_property
    def errors(self):
        """Bounds (instants,) of |y_n - T(y_{n-1})|_K; the initial state has no error."""
        t = self.trajectory
        stored = [self.energy.of_blurred_state(EPS * np.abs(y)) for y in t.state]
        errors = np.sqrt(2 * t.gap) + np.sqrt(2 * t.floor) + 2 * np.array(stored)
        errors[0] = 0.0
        return errors

    @cached_property
    def size(self):
        """The largest energy norm of the states and of the responses to the loads without friction."""
        loaded = max(self.energy.force_norm(f) for f in self.case.loads)
        return max(loaded, float(self.trajectory.norm.max()))

    @cached_property
    def operators(self):
        """The operators of all steps, not condensed."""
        return Operators(self.case.K, self.case.B, self.case.block)

    def program(self, n):
        """Return the program of step n for the increment d = y_n - y_{n-1}, not condensed and not scaled."""
        g = self.case.loads[n] - self.case.K @ self.trajectory.state[n - 1]
        return StepProgram(self.operators, g, self.case.weights[n], np.zeros(self.case.B.shape[0]))

    def increment(self, n):
        """Return y_n - y_{n-1} of the stored states."""
        return self.trajectory.state[n] - self.trajectory.state[n - 1]

    def blur_of_objective(self, n, *points):
        """Bound the rounding errors of the objective of step n, summed over the increments `points`.

        With N unknowns, each summand of the objective has N + 3 roundings. The load g = f - K y_{n-1} of the step has
        the error (N + 2) eps (|f| + M|y_{n-1}|).
        """
        case, program = self.case, self.program(n)
        known = np.abs(case.loads[n]) + majorant(case.K) @ np.abs(self.trajectory.state[n - 1])
        weights = np.repeat(program.w, case.block)
        total = 0.0
        for d in map(np.abs, points):
            total += d @ majorant(case.K) @ d + 2 * known @ d + weights @ (abs(case.B) @ d)
        return (len(known) + 3) * EPS * total

    def capped_weights(self, n):
        """Return weights (m,), reduced to the largest possible |lam_i| of step n; the answer stays the same.

        Let lam be the multipliers of step n, q = K^{-1} g, C = B K^{-1} B' and r = K^{-1} B'lam. In the inner product
        of K, r is the projection of q on a convex set (see `steps_are_stable`). This set contains zero, and is in the
        range of K^{-1} B'. So |r|_K^2 = lam'C lam is at most the squared norm of the part of q in this range, which is
        (B q)'C^{-1} B q. Therefore, |lam_i|^2 is at most (B q)'C^{-1} B q times the norm of block (i, i) of C^{-1}.
        """
        case, B, terms = self.case, self.case.B.toarray(), len(self.case.weights[n])
        inverse = np.linalg.inv(B @ np.linalg.solve(case.K, B.T))
        push = B @ np.linalg.solve(case.K, self.program(n).g)
        blocks = inverse.reshape(terms, case.block, terms, case.block)
        largest = np.array([np.linalg.norm(blocks[i, :, i], 2) for i in range(terms)])
        return np.minimum(case.weights[n], np.sqrt(push @ inverse @ push * largest))

    def friction_gap(self, n):
        """Return the sum of w_i |s_i| - lam_i . s_i in the stored step, and its rounding error; w are `capped_weights`.

        The slip s = B (y_n - y_{n-1}) of N unknowns has errors up to e = (N + 1) eps |B| (|y_n| + |y_{n-1}|), which
        change w|s| - lam.s by at most 2 w e. Rounding of lam adds 2 eps w |s|, because |lam| = w holds up to 2 eps w.
        """
        case, y, w = self.case, self.trajectory.state, self.capped_weights(n)
        lam, s = self.trajectory.multipliers[n], self.program(n).slip(self.increment(n))
        moved = abs(case.B) @ (np.abs(y[n]) + np.abs(y[n - 1]))
        size = np.maximum(w, np.linalg.norm(lam, axis=1))
        blur = 2 * (case.B.shape[1] + 3) * EPS * np.repeat(size, case.block) @ moved
        return float((w * np.linalg.norm(s, axis=1) - np.einsum("ij,ij->i", lam, s)).sum()), float(blur)


def marched(case, solver):
    """March a case, even if the solver misses the accuracy."""
    return Marched(case, case.march(solver, check=False))
