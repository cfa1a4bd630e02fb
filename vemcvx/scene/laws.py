"""Friction whose weights follow the answer: the forces of the limits, and the slip."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats
from vemcvx.effects import Friction


@dataclass(frozen=True)
class FrictionLaw:
    """How the weights of all terms follow the forces p (r,) of the limits, and slips (m,)."""

    frictions: Sequence[Friction]
    gather: sp.csr_matrix
    """(m, rows) which rows of all frictions add up to a term"""
    press: sp.csr_matrix
    """(rows, r) which limits press on which rows"""

    def weights(self, t: float, p: Floats, past: Floats, slip: Floats) -> Floats:
        """Weights (m,) under the forces of the limits, after slips before the step and in it."""
        of_rows = zip(self._of_rows(self.press @ p), self._slips(past), self._slips(slip), strict=True)
        return self._added([_weights_under(f, t, *under) for f, under in zip(self.frictions, of_rows, strict=True)])

    def part(self, terms: slice) -> Callable[[float, Floats, Floats, Floats], Floats]:
        """The weights of some of the terms, which follow the slips of the same."""

        def weights(t: float, p: Floats, past: Floats, slip: Floats) -> Floats:
            every = np.zeros((2, self.gather.shape[0]))
            every[:, terms] = past, slip
            return self.weights(t, p, every[0], every[1])[terms]

        return weights

    @property
    def has_slope(self) -> bool:
        """Whether weights are piecewise affine in the forces, with a derivative that is known."""
        return all(f.has_slope for f in self.frictions if f.dependent)

    def slope(self, t: float, p: Floats, past: Floats) -> sp.csr_matrix:
        """That derivative (m, r)."""
        press, of_rows = self.press, zip(self._of_rows(self.press @ p), self._slips(past), strict=True)
        steep = np.concatenate([_slope_under(f, t, *under) for f, under in zip(self.frictions, of_rows, strict=True)])
        entries = np.repeat(steep, np.diff(press.indptr)) * press.data
        return sp.csr_matrix(self.gather @ sp.csr_matrix((entries, press.indices, press.indptr), shape=press.shape))

    @property
    def remembers(self) -> bool:
        """Whether some depend on slip."""
        return any(f.slip_law is not None for f in self.frictions)

    @property
    def softening(self) -> Floats | None:
        """How fast weights (m,) fall with the slip of the step at most; None where forces count, or nobody knows."""
        laws = [f.slip_law for f in self.frictions]
        if any(f.law is not None for f in self.frictions) or any(law and law.softening is None for law in laws):
            return None
        pairs = zip(self.frictions, laws, strict=True)
        each = [np.zeros(len(f.nodes)) if law is None else law.rate(f.subject, f.nodes) for f, law in pairs]
        return self._added(each)

    def _slips(self, values: Floats) -> list[Floats]:
        """Slips (m,) of terms for the rows of every friction, zero where there is no term; none if no law sees them."""
        if not self.remembers:
            return [np.zeros(0)] * len(self.frictions)
        return self._of_rows(self.gather.T @ values)

    def _of_rows(self, values: Floats) -> list[Floats]:
        """Values (rows,) friction by friction."""
        return np.split(values, np.cumsum([len(f.nodes) for f in self.frictions])[:-1])

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
