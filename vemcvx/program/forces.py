"""A step in the forces of contact: how rows move where their forces change.

With A = [B; D] the rows of norm terms and limits, and x = (lam, p) their forces, a step is

    K d + A'x = g,    s = B d - b,    z = D d - e,
    |lam_i| <= w_i,  lam_i . s_i = w_i |s_i|;      p >= 0,  z <= c p,  p (c p - z) = 0.

Where forces change by dx the increments change by -K^{-1}A'dx, and the rows by -W dx, with W = A K^{-1}A', the Delassus
operator. So what rows are `off`, (s, z - c p), is known under any forces as soon as it is under some:

    off(x + dx) = off(x) - (W + C) dx,     C = diag(0, c),

and all that a step needs of the body is W + C. Units u of the rows give that a diagonal of ones, in every system of
units, so that tolerances are plain numbers.

Where K has a kernel N, K stands for K with the anchors' stiffness, increments have a part N a, rows move by R a with
R = A N, and forces balance on the kernel: N'g - R'x = 0 is the `rest`. N is chosen such that R is orthonormal.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vemcvx.base.arrays import Floats
from vemcvx.program.operators import Operators, product
from vemcvx.program.step_program import StepProgram


@dataclass(frozen=True, eq=False)
class Point:
    """Forces, and what rows are off under them; in the units of a :class:`Delassus`.

    Parameters
    ----------
    x : (N,) array
        Forces (lam, p) of all rows.
    off : (N,) array
        Slips s, and z - c p of limits.
    a : (k,) array
        The part of the increments in K's kernel.
    rest : (k,) array
        What the forces lack of balance there.
    start : Point, optional
        The point that changes are counted from, so that the rounding of large forces on the way leaves nothing.
    """

    x: Floats
    off: Floats
    a: Floats
    rest: Floats
    start: Point | None = None


class Delassus:
    """W + C of the rows of norm terms and limits, in units u (N,) of their forces, alike in a block.

    Rows move in units 1 / u. W (N, N), an array or a LinearOperator, is u (W + C) u, whose diagonal is near one.
    N (n, k) is a basis of K's kernel such that R = u A N (N, k) is orthonormal.
    """

    def __init__(self, operators: Operators):
        self.operators, (self.u, self.W) = operators, operators.softness
        N = np.zeros((operators.K.shape[0], 0)) if operators.kernel is None else operators.kernel
        self.R, T = np.linalg.qr(self.u[:, None] * operators.kernel_modes)
        self.N: Floats = np.linalg.solve(T.T, N.T).T

    @cached_property
    def norm(self) -> float:
        """The largest eigenvalue of W + C, from above but for a tenth: twenty powers of it."""
        x = np.ones(len(self.u))
        for _ in range(20):
            x = product(self.W, x / max(float(np.linalg.norm(x)), 1e-300))
        return 1.1 * float(np.linalg.norm(x))

    def parts(self, x: Floats) -> tuple[Floats, Floats]:
        """The views (m, block) of norm terms and (r,) of limits."""
        rows = self.operators.B.shape[0]
        return x[:rows].reshape(-1, self.operators.block), x[rows:]

    def begin(self, program: StepProgram, lam: Floats, p: Floats, d: Floats | None = None) -> Point:
        """The point of a program under forces (m, block) and (r,); its part in the kernel is that of d, else none."""
        operators, x = self.operators, np.concatenate([lam.ravel(), p])
        push = program.g - operators.multiplier_force(lam, p)
        off = self.u * self.excess(program, operators.factor.solve(push), p)
        a = np.zeros(self.N.shape[1]) if d is None else self.R.T @ (self.u * self.excess(program, d, p) - off)
        return Point(x / self.u, off + self.R @ a, a, self.N.T @ push)

    def excess(self, program: StepProgram, d: Floats, p: Floats) -> Floats:
        """(N,) slips s, and z - c p, of increments d under the forces p of limits."""
        given = np.concatenate([program.b, program.e + self.operators.compliance * p])
        off: Floats = self.operators.A @ d - given
        return off

    def moved(self, point: Point, dx: Floats, da: Floats | float = 0.0) -> Point:
        """The point whose forces are dx and whose part in the kernel is da further."""
        start, x, a = point.start or point, point.x + dx, point.a + da
        dx = x - start.x
        return Point(x, start.off - product(self.W, dx) + self.R @ (a - start.a), a, start.rest - self.R.T @ dx, start)

    def forces(self, point: Point) -> tuple[Floats, Floats]:
        """The forces lam (m, block) and p (r,) of a point."""
        return self.parts(self.u * point.x)

    def increments(self, program: StepProgram, point: Point) -> Floats:
        """The increments d (n,) under the forces of a point."""
        push = program.g - self.operators.multiplier_force(*self.forces(point))
        d: Floats = self.operators.factor.solve(push) + self.N @ point.a
        return d


def reflected(way: Floats) -> Floats:
    """(m, block, block) reflections that take the first unit vector to unit vectors `way` (m, block), or against them.

    Their other columns are an orthonormal basis across these.
    """
    normal = way + np.where(way[:, :1] < 0, -1.0, 1.0) * np.eye(way.shape[1])[0]
    mirrors: Floats = np.eye(way.shape[1]) - 2.0 * (
        normal[:, :, None] * normal[:, None, :] / (normal**2).sum(axis=1)[:, None, None]
    )
    return mirrors
