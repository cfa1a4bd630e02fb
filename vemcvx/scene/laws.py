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
        of_rows = zip(forces, self._slips(past), self._slips(slip), strict=True)
        return self._added([_weights_under(f, t, *under) for f, under in zip(self.frictions, of_rows, strict=True)])

    def softening(self) -> Floats | None:
        """How fast weights (m,) fall with the slip of the step at most; None where that is not known."""
        laws = [f.slip_law for f in self.frictions]
        if any(f.law is not None for f in self.frictions) or any(law and law.softening is None for law in laws):
            return None
        pairs = list(zip(self.frictions, laws, strict=True))
        each = [np.zeros(len(f.nodes)) if law is None else law.rate(f.subject, f.nodes) for f, law in pairs]
        return self._added(each)

    def _slips(self, values: Floats) -> list[Floats]:
        """Slips (m,) of terms for the rows of every friction, zero where there is no term; none if no law sees them."""
        if not any(f.slip_law for f in self.frictions):
            return [np.zeros(0)] * len(self.frictions)
        return np.split(self.gather.T @ values, np.cumsum([len(f.nodes) for f in self.frictions])[:-1])

    def slope(self, t: float, press: sp.csr_matrix, forces: Sequence[Floats], past: Floats) -> sp.csr_matrix:
        """Their derivative (m, r) by the forces of limits, which press on all rows as `press` (rows, r) says."""
        of_rows = zip(forces, self._slips(past), strict=True)
        steep = np.concatenate([_slope_under(f, t, *under) for f, under in zip(self.frictions, of_rows, strict=True)])
        entries = np.repeat(steep, np.diff(press.indptr)) * press.data
        return sp.csr_matrix(self.gather @ sp.csr_matrix((entries, press.indices, press.indptr), shape=press.shape))

    def bias(self, t: float) -> Floats:
        """(m,) along the tangent of each term."""
        each = [np.zeros(len(f.nodes)) if f.bias is None else f.bias(t) for f in self.frictions]
        return self._added([self.sign * np.concatenate(each)])

    def _added(self, parts: Sequence[Floats]) -> Floats:
        total: Floats = self.gather @ np.concatenate(parts)
        return total


def _weights_under(friction: Friction, t: float, forces: Floats, before: Floats, slip: Floats) -> Floats:
    """Weights (rows,) under their normal forces, after slips, which laws may see, before the step and in it."""
    w = friction.weights(t)
    if friction.law is not None:
        w = w + friction.law(t, forces)
    if friction.slip_law is not None:
        w = w + friction.slip_law.added(friction.subject, friction.nodes, t, forces, (before, slip))
    return w


def _slope_under(friction: Friction, t: float, forces: Floats, before: Floats) -> Floats:
    """Their derivatives (rows,) by these forces; zero if they are not known."""
    slope = np.zeros(len(forces)) if friction.slope is None else friction.slope(t, forces)
    if friction.slip_law is not None:
        slope = slope + friction.slip_law.slope_at(friction.subject, friction.nodes, t, forces, before)
    return slope


def weights_of(law: FrictionLaw, part: slice, count: int) -> Callable[[float, Floats, Floats, Floats], Floats]:
    """The weights of a part of all terms, which follow the slips of the same part."""

    def weights(t: float, p: Floats, past: Floats, slip: Floats) -> Floats:
        every = np.zeros((2, count))
        every[:, part] = past, slip
        return law.weights(t, p, every[0], every[1])[part]

    return weights
