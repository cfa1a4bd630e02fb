"""Weights w of the terms w_i |s_i| in one step: constants, or a law w(p, |s|) with the forces p of limits D d <= e.

A law may define its *slope* J = dw/dp, while dw/d|s| is computed by differences. A solution of a step, with forces p*
and slips s*, also solves the convex program with the constant weights w(p*, |s*|).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import EPS, SAME, Floats
from vemcvx.base.errors import SceneError
from vemcvx.program.system import Norms

RELATIVE_STEP = 1e-6
"""Step of the difference quotient dw/d|s|, relative to the largest slip."""


@dataclass(frozen=True, eq=False)
class Weights:
    """The weights of norm terms in one step."""

    w: Floats  # (m,) constant weights, as in Tresca's law
    norms: Norms | None = None  # terms with a law; None for constant weights
    t: float = 0.0
    past: Floats = field(default_factory=lambda: np.zeros(0))  # (m,) slips before the step
    k: float = 0.0  # the length of the step
    term_units: Floats = field(default_factory=lambda: np.ones(1))  # units of w; slips are in units of 1 / `term_units`
    limit_units: Floats = field(default_factory=lambda: np.ones(1))  # units of p

    @property
    def is_given(self) -> bool:
        return self.norms is None

    @property
    def is_monotone(self) -> bool:
        """True if the step is a convex program: weights neither depend on p nor fall with slip."""
        return self.norms is None or self.norms.is_monotone

    @property
    def reads_slip(self) -> bool:
        """True if weights may depend on the slip of the step."""
        return self.norms is not None and self.norms.rule.slips and self.norms.rule.slope is None

    def at(self, p: Floats, slip: Floats) -> Floats:
        """Return weights (m,) under limit forces p (r,) and slips (m,)."""
        w = self.w
        if self.norms is not None:
            p = self.limit_units * np.maximum(p, 0.0)
            own = self._measure(slip / self.term_units) if self.reads_slip else None
            w = self.norms.weights_under(self.t, p, self.past, own)
        return w / self.term_units

    def _measure(self, slip: Floats) -> Floats:
        """Return slips, or slip rates if the law depends on rates."""
        if self.norms is None or not self.norms.rule.rates:
            return slip
        return slip / self.k if self.k > 0.0 else np.zeros_like(slip)

    def slopes(self, p: Floats, slip: Floats) -> tuple[sp.csr_matrix | None, Floats | None]:
        """Return dw/dp (m, r) and dw/d|s| (m,), with None for zero derivatives."""
        if self.norms is None:
            return None, None
        J = self.norms.slope_by_forces(self.t, self.limit_units * np.maximum(p, 0.0), self.past)
        if J is not None:
            return sp.csr_matrix(sp.diags_array(1.0 / self.term_units) @ J @ sp.diags_array(self.limit_units)), None
        if not self.reads_slip:
            return None, None
        past = np.zeros(1) if self.norms.rule.rates else self.past * self.term_units
        more = RELATIVE_STEP * max(slip.max(initial=0.0), past.max(initial=0.0)) or RELATIVE_STEP
        return None, (self.at(p, slip + more) - self.at(p, slip)) / more

    def check_slip(self, p: Floats, slip: Floats) -> None:
        """Raise SceneError if weights contradict the `softening` or the slope of the law."""
        norms = self.norms
        if norms is None or not norms.rule.slips or (norms.softening is None and norms.rule.slope is None):
            return
        slip = self._measure(slip)
        rate = 0.0 if norms.softening is None else norms.softening
        slips = [fraction * slip for fraction in SLIP_FRACTIONS]
        weights = [norms.weights_under(self.t, np.maximum(p, 0.0), self.past, s) for s in slips]
        for (s, w), (more, own) in pairwise(zip(slips, (np.where(w == np.inf, 0.0, w) for w in weights), strict=True)):
            change = np.abs(own - w) if norms.rule.slope is not None else w - own - rate * (more - s)
            off = change - SAME * (np.maximum(own, w) + rate * (self.past + more))
            if (off > 0).any():
                i, what = int(np.argmax(off)), "slip rate" if norms.rule.rates else "slip"
                raise SceneError(
                    f"friction: at {norms.name(i)}, in the step to t = {self.t:.6g}, the {what} {more[i]:.6g} instead "
                    f"of {s[i]:.6g} changes the weight from {w[i]:.6g} to {own[i]:.6g}. A law with `slope=` must "
                    f"not depend on this slip. A softening must be the largest decrease per {what}, or None if it is "
                    "unknown."
                )


SLIP_FRACTIONS = 0.0, 0.25, 0.5, 0.75, 1.0, 2.0
"""A law is checked at these multiples of the slip of a step."""
MOST_EVALUATIONS = 200
"""Largest number of evaluations of a law in one call of `resolve_slips`."""


def resolve_slips(law: Weights, p: Floats, size: Floats, shift: float, tolerance: float = 16 * EPS) -> Floats:
    """Return slips r >= 0 with ``law.at(p, r) + shift * r = size``, or 0 where ``size <= law.at(p, 0)``."""
    low, high = np.zeros_like(size), np.maximum(size - law.at(p, np.zeros_like(size)), 0.0) / shift
    below, above = -shift * high, law.at(p, high) + shift * high - size
    if (above <= 0.0).all():
        return high
    last = np.full(len(size), 2)  # the end that moved last: 1 for `low`, 0 for `high`, 2 at first
    for _ in range(MOST_EVALUATIONS):
        part = np.divide(-below, above - below, where=above > below, out=np.ones_like(low))
        r = low + (high - low) * np.clip(part, 0.0, 1.0)
        error = law.at(p, r) + shift * r - size
        under = error <= 0.0
        # Illinois rule: halve the value at an end that stayed twice.
        share, last = np.where(under == last, 0.5, 1.0), under
        above, below = np.where(under, share * above, error), np.where(under, error, share * below)
        low, high = np.where(under, r, low), np.where(under, high, r)
        if ((np.abs(error) <= tolerance * size) | (high - low <= EPS * high)).all():
            break
    return r
