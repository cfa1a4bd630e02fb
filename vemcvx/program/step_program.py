"""One step as a convex program, in the increment d = y - y_prev.

    minimise  1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i| + sum_j (z_j)_+^2 / (2 c_j)        z = D d - e    (2.34)
    dual      K d = g - B'lam - D'p,   |lam_i| <= w_i,  lam_i . s_i = w_i |s_i|,   s = B d - b
              p_j >= 0,   z_j <= c_j p_j,   p_j (c_j p_j - z_j) = 0

with g = load(t_n) - K y_prev, the force out of balance when the step begins. Working in increments keeps all digits
of d when steps are tiny beside y. Where the compliance c_j of a *limit* vanishes, the last sum stands for the bound D_j
d <= e_j; elsewhere it is a squared positive part. The program is data; each solver reads it its own way.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.program.operators import Operators

EPS = float(np.finfo(float).eps)


def _none() -> Floats:
    return np.zeros(0)


@dataclass(frozen=True)
class StepProgram:
    """One step's data, beside what all steps share.

    Minimise 1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i| subject to D d <= e; where a limit has a compliance c_j > 0, with
    (D_j d - e_j)_+^2 / (2 c_j) in place of its bound. At the solution K d = g - B'lam - D'p: friction acts on the body
    with the forces -B'lam, limits with -D'p, |lam_i| <= w_i and p >= 0.

    Parameters
    ----------
    operators : Operators
        K, B, D, and the compliances c.
    g : (n,) array
        Forces that are out of balance when the step begins.
    w : (m,) array
        Weights >= 0: bounds of friction, as forces.
    b : (m * block,) array
        What of B d is no slip: the motion of the supports.
    e : (r,) array
        What the limits leave free when the step begins; negative where they have moved in.
    """

    operators: Operators
    g: Floats
    w: Floats
    b: Floats
    e: Floats = field(default_factory=_none)

    def slip(self, d: Floats) -> Floats:
        """s = B d - b, as (m, block)."""
        return self.operators.blocks(self.operators.rows.read(d) - self.b)

    def excess(self, d: Floats) -> Floats:
        """z = D d - e, (r,)."""
        return self.operators.limits.read(d) - self.e

    def excess_blur(self, d: Floats) -> Floats:
        """(r,) the rounding of z; a bound d_i = e_i is exact."""
        limits = self.operators.limits
        return np.where(limits.exact, 0.0, EPS * (limits.absolute.read(np.abs(d)) + np.abs(self.e)))

    def held(self, lam: Floats, p: Floats) -> Floats:
        """B'lam + D'p, the forces (n,) of norm terms and limits."""
        return self.operators.rows.pull(lam.ravel()) + self.operators.limits.pull(p)

    def residual(self, d: Floats, lam: Floats, p: Floats) -> Floats:
        """r = g - B'lam - D'p - K d, the forces that do not balance, (n,)."""
        r: Floats = self.g - self.held(lam, p) - self.operators.K @ d
        return r

    def objective(self, d: Floats) -> float:
        """The energy that the step minimises; infinite beyond a bound."""
        norms = np.linalg.norm(self.slip(d), axis=1)
        over = np.maximum(self.excess(d), 0.0)
        over[over <= self.excess_blur(d)] = 0.0
        soft = self.operators.compliance > 0
        pressed = 0.5 * float(over[soft] @ (over[soft] / self.operators.compliance[soft]))
        if (over[~soft] > 0).any():
            return np.inf
        return float(0.5 * d @ (self.operators.K @ d) - self.g @ d + self.w @ norms) + pressed

    def project(self, lam: Floats) -> Floats:
        """The multipliers (m, block) nearest to `lam` with |lam_i| <= w_i."""
        if self.operators.block == 1:
            # The projection onto an interval is exact; scaling would leave one rounding error.
            return np.clip(lam, -self.w[:, None], self.w[:, None])
        size = np.linalg.norm(lam, axis=1)
        over = size > self.w
        scale = np.ones_like(size)
        scale[over] = self.w[over] / size[over]
        nearest: Floats = lam * scale[:, None]
        return nearest

    def admissible(self, lam: Floats, p: Floats, d: Floats) -> tuple[Floats, Floats]:
        """The multipliers nearest to (lam, p): |lam_i| <= w_i, p >= 0, in balance on K's kernel.

        For the balance those are changed that cost little gap at the increments `d`: where d sticks or touches.
        """
        if self.operators.kernel is not None:
            s, z = np.linalg.norm(self.slip(d), axis=1), np.abs(self.excess(d) - self.operators.compliance * p)
            level = 1e-6 * max(s.max(initial=0.0), z.max(initial=0.0)) or 1.0
            ease = level / (level + s), level / (level + z)
            lam, p, _ = self.operators.hold.nearest(lam, p, self.w, self.operators.kernel.T @ self.g, ease)
        return self.project(lam), np.maximum(p, 0.0)

    def proximal(self, centre: Floats) -> StepProgram:
        """The program of the proximal point of `centre` (n,) on the anchors; itself where K has no kernel."""
        operators = self.operators
        return (
            self
            if operators.anchor is None
            else replace(self, operators=operators.regular, g=self.g + operators.anchor * centre)
        )

    def at_rest(self) -> Floats | None:
        """Multipliers (m, block) with which d = 0 is the answer to the last bit, if they can be read off; else None."""
        rows = self.operators.rows
        if rows.columns is None or self.b.any() or (self.e < 0).any():
            return None
        lam = self.g[rows.columns] / self.operators.B.data
        if (np.linalg.norm(self.operators.blocks(lam), axis=1) > self.w).any() or (self.g != rows.pull(lam)).any():
            return None
        return self.operators.blocks(lam)

    def feasible(self, d: Floats) -> Floats:
        """The increments d, moved as little as need be to obey the bounds."""
        operators = self.operators
        rigid = np.flatnonzero(operators.compliance == 0)
        if len(rigid) == 0 or not (self.excess(d)[rigid] > 0).any():
            return d
        if operators.limits.single[rigid].all():
            # Rows that give way may read the same unknowns, and several bounds as well.
            entry = operators.D.indptr[rigid]
            column, coefficient, moved = operators.D.indices[entry], operators.D.data[entry], d.copy()
            edge, upper = self.e[rigid] / coefficient, coefficient > 0
            np.minimum.at(moved, column[upper], edge[upper])
            np.maximum.at(moved, column[~upper], edge[~upper])
            return moved
        for _ in range(8):
            over = rigid[self.excess(d)[rigid] > 0]
            if len(over) == 0:
                break
            rows = operators.D[over].toarray()
            spread = operators.factor.solve(np.ascontiguousarray(rows.T))
            d = d - spread @ np.linalg.lstsq(rows @ spread, self.excess(d)[over], rcond=None)[0]
        return d


@dataclass(frozen=True)
class Answer:
    """A solver's answer to one step; nothing is claimed about it before it is certified.

    Parameters
    ----------
    d : (n,) array
        Increments. Those beyond their bounds are moved back onto them.
    lam : (m, block) array
        Multipliers of the norm terms, K d = g - B'lam - D'p. Where they are too large they are projected.
    iterations : int
        As the solver counts them.
    status : str
        In the solver's own words, for messages.
    safeguards : int
        How many of the iterations were steps of a globally convergent method that stood in for a faster one.
    p : (r,) array
        Multipliers of the limits; negative ones are taken for zero.
    """

    d: Floats
    lam: Floats
    iterations: int
    status: str = ""
    safeguards: int = 0
    p: Floats = field(default_factory=_none)
