"""Slips and gaps of a step as functions of the contact forces.

A step has the stiffness matrix K, the load g and the increment d. Norm terms have the rows B, the data b, the
forces lam and the slips s = B d - b. The limits have the rows D, the data e, the forces p, the compliances c and the
gaps z - c p, with z = D d - e. Let x = (lam, p), A = [B; D] and off = (s, z - c p). Then K d = g - A'x, and

    off(x + dx) = off(x) - (A K^{-1}A' + C) dx,     C = diag(0, c).

We divide x by units u, and multiply `off` by u. The scaled matrix W = u (A K^{-1}A' + C) u has the diagonal 1.

If K has a kernel, anchors (:mod:`.kernel`) make K definite. Let N be a basis of the kernel with R'R = I for R = u A N.
The increment then has a further part N alpha, which adds R alpha to `off`. In equilibrium, N'g = R'x.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator

from vemcvx.base.arrays import Floats
from vemcvx.linear import CHUNK_SIZE
from vemcvx.program.operators import Operators, product
from vemcvx.program.step_program import StepProgram


@dataclass(frozen=True, eq=False)
class Point:
    """Forces, slips and gaps of all rows, in the units of :class:`Delassus`."""

    x: Floats  # (n_rows,) forces lam, then p
    off: Floats  # (n_rows,) slips s, then gaps z - c p
    a: Floats  # (k,) kernel coordinates alpha
    rest: Floats  # (k,) N'g - R'x
    start: Point | None = None  # the point that `begin` returned


class Delassus:
    """The scaled Delassus operator `W` = u (A K^{-1}A' + C) u.

    Forces are divided by `u`. Slips and gaps are multiplied by `u`. `N` is a basis of the kernel of K. The columns of
    `R` = u A N are orthonormal.
    """

    def __init__(self, operators: Operators):
        self.operators, n, rows = operators, operators.K.shape[0], operators.B.shape[0]
        c = np.append(np.zeros(rows), operators.compliance)
        own = np.append(np.repeat(operators.norm_flexibility, operators.block), operators.limit_flexibility) + c
        self.u = 1.0 / np.sqrt(np.where(own > 0, own, 1.0))
        self.W = compute_delassus(operators, self.u, self.u**2 * c)
        N = np.zeros((n, 0)) if operators.kernel is None else operators.kernel
        self.R, T = np.linalg.qr(self.u[:, None] * operators.kernel_modes)
        self.N: Floats = np.linalg.solve(T.T, N.T).T

    @cached_property
    def norm(self) -> float:
        """The largest eigenvalue of `W`, estimated by power iterations."""
        x = np.random.default_rng(0).standard_normal(len(self.u))
        for _ in range(20):
            x = product(self.W, x / max(float(np.linalg.norm(x)), 1e-300))
        return 1.1 * float(np.linalg.norm(x))

    def split(self, x: Floats) -> tuple[Floats, Floats]:
        """Split a vector into norm terms (m, block) and limits (r,)."""
        rows = self.operators.B.shape[0]
        return x[:rows].reshape(-1, self.operators.block), x[rows:]

    def begin(self, program: StepProgram, lam: Floats, p: Floats, d: Floats | None = None) -> Point:
        """Return the point with the forces lam and p."""
        operators, x = self.operators, np.concatenate([lam.ravel(), p])
        push = program.g - operators.multiplier_force(lam, p)
        off = self.u * self.excess(program, operators.factor.solve(push), p)
        a = np.zeros(self.N.shape[1]) if d is None else self.R.T @ (self.u * self.excess(program, d, p) - off)
        return Point(x / self.u, off + self.R @ a, a, self.N.T @ push)

    def excess(self, program: StepProgram, d: Floats, p: Floats) -> Floats:
        """Return the slips and gaps of increments d."""
        given = np.concatenate([program.b, program.e + self.operators.compliance * p])
        off: Floats = self.operators.A @ d - given
        return off

    def move(self, point: Point, dx: Floats, da: Floats | float = 0.0) -> Point:
        """Return the point after changes dx of forces and da of kernel coordinates."""
        start, x, a = point.start or point, point.x + dx, point.a + da
        dx = x - start.x
        return Point(x, start.off - product(self.W, dx) + self.R @ (a - start.a), a, start.rest - self.R.T @ dx, start)

    def forces(self, point: Point) -> tuple[Floats, Floats]:
        """Return the unscaled forces lam (m, block) and p (r,)."""
        return self.split(self.u * point.x)

    def increments(self, program: StepProgram, point: Point) -> Floats:
        """Return the unscaled increments d (n,)."""
        push = program.g - self.operators.multiplier_force(*self.forces(point))
        d: Floats = self.operators.factor.solve(push) + self.N @ point.a
        return d


def compute_delassus(operators: Operators, u: Floats, yielding: Floats) -> Floats | LinearOperator:
    """Return u A K^{-1} A' u + diag(yielding)."""
    rows, read = sp.csr_matrix(sp.diags_array(u) @ operators.A), np.unique(operators.A.indices).astype(np.int64)
    dense = isinstance(operators.K, np.ndarray) or operators.kernel is not None
    if not dense and len(read) ** 2 > CHUNK_SIZE:
        return LinearOperator(
            2 * u.shape, lambda x: rows @ operators.factor.solve(rows.T @ x) + yielding * x, dtype=float
        )
    part = rows[:, read]
    W = np.asarray(part @ (part @ operators.factor.flexibility(read, operators.K.shape[0])).T)
    W[np.diag_indices(len(u))] += yielding
    return W


def build_reflections(direction: Floats) -> Floats:
    """Return orthogonal matrices (m, block, block) with the first column `direction` or -`direction`."""
    normal = direction + np.where(direction[:, :1] < 0, -1.0, 1.0) * np.eye(direction.shape[1])[0]
    mirrors: Floats = np.eye(direction.shape[1]) - 2.0 * (
        normal[:, :, None] * normal[:, None, :] / (normal**2).sum(axis=1)[:, None, None]
    )
    return mirrors
