"""The weights w(p, |s|) of one step: given numbers or a law of friction, in any units.

A law has two derivatives: J = dw/dp if the law defines it, and dw/d|s|, by differences, if the law depends on the slip
of the step. A step under a law is one set-valued equation. Each of its solutions also solves the program with weights
fixed at the values that the law has for the pressure and slip of this solution.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import SAME, Floats
from vemcvx.base.errors import SceneError
from vemcvx.program.system import Norms

RELATIVE_STEP = 1e-6
"""Step of the difference quotient dw/d|s|, relative to the largest slip."""


class Weights(Protocol):
    """The weights of norm terms as functions of limit forces p and of slips of the step."""

    @property
    def is_given(self) -> bool:
        """True if the weights are constants."""

    def at(self, p: Floats, slip: Floats) -> Floats:
        """Return weights (m,) under limit forces p (r,) and slips (m,)."""

    def slopes(self, p: Floats, slip: Floats) -> tuple[sp.csr_matrix | None, Floats | None]:
        """Return dw/dp (m, r) and dw/d|s| (m,), with None for zero derivatives."""


@dataclass(frozen=True, eq=False)
class GivenWeights:
    """Constant weights (m,), as in Tresca's law."""

    w: Floats
    is_given = True

    def at(self, p: Floats, slip: Floats) -> Floats:
        return self.w

    def slopes(self, p: Floats, slip: Floats) -> tuple[None, None]:
        return None, None


@dataclass(frozen=True, eq=False)
class WeightsInUnits:
    """Weights in other units: forces in `term_units` (m,) and `limit_units` (r,), slips in 1 / `term_units`."""

    weights: Weights
    term_units: Floats
    limit_units: Floats

    @property
    def is_given(self) -> bool:
        """True if the weights are constants."""
        return self.weights.is_given

    def at(self, p: Floats, slip: Floats) -> Floats:
        return self.weights.at(self.limit_units * p, slip / self.term_units) / self.term_units

    def slopes(self, p: Floats, slip: Floats) -> tuple[sp.csr_matrix | None, Floats | None]:
        J, slope = self.weights.slopes(self.limit_units * p, slip / self.term_units)
        if J is not None:
            entries = J.data * self.limit_units[J.indices] / np.repeat(self.term_units, np.diff(J.indptr))
            J = sp.csr_matrix((entries, J.indices, J.indptr), shape=J.shape)
        return J, None if slope is None else slope / self.term_units**2


@dataclass(frozen=True, eq=False)
class StepLaw:
    """Weights by the law of `norms` at the instant t; `past` (m,) are the slips before the step."""

    norms: Norms
    t: float
    past: Floats
    is_given = False

    @property
    def reads_slip(self) -> bool:
        """True if weights may depend on the slip of the step; laws with a derivative by p do not."""
        return self.norms.remembers and not self.norms.sloped

    def at(self, p: Floats, slip: Floats) -> Floats:
        return self.norms.weights_under(self.t, np.maximum(p, 0.0), self.past, slip if self.reads_slip else None)

    def slopes(self, p: Floats, slip: Floats) -> tuple[sp.csr_matrix | None, Floats | None]:
        if self.norms.sloped:
            return self.norms.slope_by_forces(self.t, np.maximum(p, 0.0), self.past), None
        if not self.reads_slip:
            return None, None
        more = RELATIVE_STEP * max(slip.max(initial=0.0), self.past.max(initial=0.0)) or RELATIVE_STEP
        return None, (self.at(p, slip + more) - self.at(p, slip)) / more

    def check_slip(self, p: Floats, slip: Floats) -> None:
        """Raise SceneError if the slip of the step changes weights more than slope or softening of the law allow."""
        norms, softening = self.norms, self.norms.softening
        if not norms.remembers or (softening is None and not norms.sloped):
            return
        w, own = (norms.weights_under(self.t, np.maximum(p, 0.0), self.past, s) for s in (None, slip))
        w, own = (np.where(weights == np.inf, 0.0, weights) for weights in (w, own))
        rate = 0.0 if softening is None else softening
        change = np.abs(own - w) if norms.sloped else w - own - rate * slip
        off = change - SAME * (np.maximum(own, w) + rate * (self.past + slip))
        if (off > 0).any():
            i = int(np.argmax(off))
            raise SceneError(
                f"friction: at {norms.name(i)} the slip {slip[i]:.6g} of the step to t = {self.t:.6g} changes the "
                f"weight from {w[i]:.6g} to {own[i]:.6g}. With a slope, a law may not depend on this slip. "
                "A softening must be the largest decrease per slip, or None if it is unknown."
            )
