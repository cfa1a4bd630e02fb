"""What the rows of all frictions say, added up for every term: weights, how they follow the answer, bias."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats
from vemcvx.effects import Friction


@dataclass(frozen=True)
class FrictionLaw:
    """How the weights of all terms follow the forces of the limits, and the slip."""

    weights: Callable[[float, Floats, Floats, Floats], Floats]
    """(t, forces (r,), slip (m,) before the step and in it) -> (m,)"""
    slope: Callable[[float, Floats, Floats], sp.csr_matrix] | None
    """(t, forces (r,), slip (m,) before the step) -> (m, r), the derivative of weights that are piecewise affine; None
    if they are not"""
    remembers: bool
    """whether some see the slip"""
    softening: Floats | None
    """as of terms"""


@dataclass(frozen=True)
class Sums:
    """What the rows of all frictions say, added up for every term."""

    frictions: Sequence[Friction]
    gather: sp.csr_matrix
    """(m, rows)"""
    sign: Floats
    """(rows,) 1 where the tangent of a row is that of its term, else -1"""

    def weights(self, t: float) -> Floats:
        """Weights (m,) where none depends on the pressure."""
        return self._added([f.weights(t) for f in self.frictions])

    def weights_under(self, t: float, forces: Sequence[Floats], past: Floats, slip: Floats) -> Floats:
        """Weights (m,) under the normal forces of every friction's rows, after slips (m,) before the step and in it."""
        each = [f.weights(t) if f.law is None else f.weights(t) + f.law(t, P) for f, P in self._with(forces)]
        if any(f.slip_law is not None for f in self.frictions):
            before, now = self._of_rows(past), self._of_rows(slip)
            for k, (f, P) in enumerate(self._with(forces)):
                if f.slip_law is not None:
                    each[k] = each[k] + f.slip_law.added(f.subject, f.nodes, t, P, (before[k], now[k]))
        return self._added(each)

    def _with(self, forces: Sequence[Floats]) -> list[tuple[Friction, Floats]]:
        return list(zip(self.frictions, forces, strict=True))

    def softening(self) -> Floats | None:
        """How fast weights (m,) fall with the slip of the step at most; None where that is not known."""
        laws = [f.slip_law for f in self.frictions]
        if any(f.law is not None for f in self.frictions) or any(law and law.softening is None for law in laws):
            return None
        pairs = list(zip(self.frictions, laws, strict=True))
        each = [np.zeros(len(f.nodes)) if law is None else law.rate(f.subject, f.nodes) for f, law in pairs]
        return self._added(each)

    def _of_rows(self, values: Floats) -> list[Floats]:
        """Values (m,) of terms for the rows of every friction; zero where a row has no term."""
        return np.split(self.gather.T @ values, np.cumsum([len(f.nodes) for f in self.frictions])[:-1])

    def slope(self, t: float, press: sp.csr_matrix, forces: Sequence[Floats], past: Floats) -> sp.csr_matrix:
        """Their derivative (m, r) by the forces of limits, which press on all rows as `press` (rows, r) says."""
        each = [np.zeros(len(P)) if f.slope is None else f.slope(t, P) for f, P in self._with(forces)]
        if any(f.slip_law is not None for f in self.frictions):
            for k, before in enumerate(self._of_rows(past)):
                law = self.frictions[k].slip_law
                if law is not None:
                    f = self.frictions[k]
                    each[k] = each[k] + law.slope_at(f.subject, f.nodes, t, forces[k], before)
        steep = np.concatenate(each)
        entries = np.repeat(steep, np.diff(press.indptr)) * press.data
        return sp.csr_matrix(self.gather @ sp.csr_matrix((entries, press.indices, press.indptr), shape=press.shape))

    def bias(self, t: float) -> Floats:
        """(m,) along the tangent of each term."""
        each = [np.zeros(len(f.nodes)) if f.bias is None else f.bias(t) for f in self.frictions]
        return self._added([self.sign * np.concatenate(each)])

    def _added(self, parts: Sequence[Floats]) -> Floats:
        total: Floats = self.gather @ np.concatenate(parts)
        return total


def weights_of(law: FrictionLaw, part: slice, count: int) -> Callable[[float, Floats, Floats, Floats], Floats]:
    """The weights of a part of all terms, which follow the slips of the same part."""

    def weights(t: float, p: Floats, past: Floats, slip: Floats) -> Floats:
        every = np.zeros((2, count))
        every[:, part] = past, slip
        return law.weights(t, p, every[0], every[1])[part]

    return weights
