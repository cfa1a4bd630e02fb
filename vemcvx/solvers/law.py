"""The weights of one step, w(p, |s|): given, or after a law of friction; and these in other units.

A law has two slopes: J = dw/dp where it says so, and dw/d|s|, by differences where it reads the slip of the step. A
step of the law w(p, |s|) is one set-valued equation with a program of given weights at every solution: that of the
answer's own pressure and slip.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import SAME, Floats
from vemcvx.base.errors import SceneError
from vemcvx.program.system import Norms

DIFFERENCE = 1e-6
"""Part of the largest slip by which one is changed to see how its weight does."""


class Weights(Protocol):
    """Weights of norm terms under the forces of limits, after slips of the step."""

    @property
    def given(self) -> bool:
        """True if they depend on neither."""

    def at(self, p: Floats, slip: Floats) -> Floats:
        """Return weights (m,) under forces (r,) and slips (m,)."""

    def slopes(self, p: Floats, slip: Floats) -> tuple[sp.csr_matrix | None, Floats | None]:
        """Return dw/dp (m, r) and dw/d|s| (m,); None where they are zero."""


@dataclass(frozen=True, eq=False)
class GivenWeights:
    """Weights (m,) that depend on nothing: Tresca's."""

    w: Floats
    given = True

    def at(self, p: Floats, slip: Floats) -> Floats:
        return self.w

    def slopes(self, p: Floats, slip: Floats) -> tuple[None, None]:
        return None, None


@dataclass(frozen=True, eq=False)
class WeightsInUnits:
    """Weights where forces of terms and limits are in units (m,) and (r,), and slips in one over those of terms."""

    weights: Weights
    of_terms: Floats
    of_limits: Floats

    @property
    def given(self) -> bool:
        """True if the weights depend on neither."""
        return self.weights.given

    def at(self, p: Floats, slip: Floats) -> Floats:
        return self.weights.at(self.of_limits * p, slip / self.of_terms) / self.of_terms

    def slopes(self, p: Floats, slip: Floats) -> tuple[sp.csr_matrix | None, Floats | None]:
        J, slope = self.weights.slopes(self.of_limits * p, slip / self.of_terms)
        if J is not None:
            entries = J.data * self.of_limits[J.indices] / np.repeat(self.of_terms, np.diff(J.indptr))
            J = sp.csr_matrix((entries, J.indices, J.indptr), shape=J.shape)
        return J, None if slope is None else slope / self.of_terms**2


@dataclass(frozen=True, eq=False)
class StepLaw:
    """Weights after the law of `norms` at the instant t, with slips (m,) before the step."""

    norms: Norms
    t: float
    past: Floats
    given = False

    @property
    def sees_slip(self) -> bool:
        """True if weights may read the slip of the step: laws that give a slope by p do not."""
        return self.norms.remembers and not self.norms.sloped

    def at(self, p: Floats, slip: Floats) -> Floats:
        return self.norms.weights_under(self.t, np.maximum(p, 0.0), self.past, slip if self.sees_slip else None)

    def slopes(self, p: Floats, slip: Floats) -> tuple[sp.csr_matrix | None, Floats | None]:
        if self.norms.sloped:
            return self.norms.slope_by_forces(self.t, np.maximum(p, 0.0), self.past), None
        if not self.sees_slip:
            return None, None
        more = DIFFERENCE * max(slip.max(initial=0.0), self.past.max(initial=0.0)) or DIFFERENCE
        return None, (self.at(p, slip + more) - self.at(p, slip)) / more

    def check_slope(self, p: Floats, slip: Floats) -> None:
        """Raise SceneError where weights of a law with a slope by p depend on the slip of the step."""
        if not (self.norms.sloped and self.norms.remembers):
            return
        w, own = self.at(p, slip), self.norms.weights_under(self.t, np.maximum(p, 0.0), self.past, slip)
        off = np.abs(own - w) - SAME * np.maximum(own, w)
        if (off > 0).any():
            i = int(np.argmax(off))
            raise SceneError(
                f"friction: at {self.norms.name(i)} the slip of the step to t = {self.t:.6g} changes the weight from "
                f"{w[i]:.6g} to {own[i]:.6g}, but its law has a slope, which is for laws that read the slip before "
                "the step alone; leave the slope out."
            )
