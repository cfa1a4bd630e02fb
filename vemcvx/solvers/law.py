"""The weights of one step, w(p, |s|), in the units of whoever asks: given, or after a law of friction.

A law has two slopes: J = dw/dp where it says so, and dw/d|s|, by differences where it reads the slip of the step. A
step of the law w(p, |s|) is one set-valued equation with a program of given weights at every solution: that of the
answer's own pressure and slip.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import SAME, Floats
from vemcvx.base.errors import SceneError
from vemcvx.program.operators import Norms

DIFFERENCE = 1e-6
"""Part of the largest slip by which one is changed to see how its weight does."""


class Weights(Protocol):
    """Weights of norm terms under the forces of limits, after slips of the step."""

    @property
    def given(self) -> bool:
        """True if they depend on neither."""

    def at(self, p: Floats, slip: Floats) -> Floats:
        """Weights (m,) under forces (r,) and slips (m,)."""

    def slopes(self, p: Floats, slip: Floats) -> tuple[sp.csr_matrix | None, Floats | None]:
        """dw/dp (m, r) and dw/d|s| (m,); None where they are zero."""

    def in_units(self, of_terms: Floats, of_limits: Floats) -> Weights:
        """The same weights where forces are in units (m,) and (r,), and slips in one over these."""


@dataclass(frozen=True, eq=False)
class GivenWeights:
    """Weights (m,) that depend on nothing: Tresca's."""

    w: Floats
    given = True

    def at(self, p: Floats, slip: Floats) -> Floats:
        return self.w

    def slopes(self, p: Floats, slip: Floats) -> tuple[None, None]:
        return None, None

    def in_units(self, of_terms: Floats, of_limits: Floats) -> GivenWeights:
        return GivenWeights(self.w / of_terms)


@dataclass(frozen=True, eq=False)
class StepLaw:
    """Weights after a law at the instant t.

    Parameters
    ----------
    norms : Norms
        They have a law.
    t : float
    past : (m,) array
        Slips before the step.
    weight, force, length : (m,), (r,) and (m,) arrays
        What one stands for: of weights, of forces of limits, and of slips.
    """

    norms: Norms
    t: float
    past: Floats
    weight: Floats
    force: Floats
    length: Floats
    given = False

    @classmethod
    def of(cls, norms: Norms, t: float, past: Floats, limits: int) -> StepLaw:
        """The law in the units of the system, with so many limits."""
        one = np.ones(norms.count)
        return cls(norms, t, past, weight=one, force=np.ones(limits), length=one)

    @property
    def sees_slip(self) -> bool:
        """True if weights may read the slip of the step: laws that give a slope by p do not."""
        return self.norms.remembers and not self.norms.sloped

    def at(self, p: Floats, slip: Floats) -> Floats:
        own = self.length * slip if self.sees_slip else None
        return self.norms.weights_under(self.t, self.force * np.maximum(p, 0.0), self.past, own) / self.weight

    def slopes(self, p: Floats, slip: Floats) -> tuple[sp.csr_matrix | None, Floats | None]:
        if self.norms.sloped:
            J = self.norms.slope_by_forces(self.t, self.force * np.maximum(p, 0.0), self.past)
            entries = J.data * self.force[J.indices] / np.repeat(self.weight, np.diff(J.indptr))
            return sp.csr_matrix((entries, J.indices, J.indptr), shape=J.shape), None
        if not self.sees_slip:
            return None, None
        more = DIFFERENCE * max(slip.max(initial=0.0), (self.past / self.length).max(initial=0.0)) or DIFFERENCE
        return None, (self.at(p, slip + more) - self.at(p, slip)) / more

    def check_slope(self, p: Floats, slip: Floats) -> None:
        """Raise SceneError where weights of a law with a slope by p depend on the slip of the step."""
        if not (self.norms.sloped and self.norms.remembers):
            return
        w, force = self.weight * self.at(p, slip), self.force * np.maximum(p, 0.0)
        own = self.norms.weights_under(self.t, force, self.past, self.length * slip)
        off = np.abs(own - w) - SAME * np.maximum(own, w)
        if (off > 0).any():
            i = int(np.argmax(off))
            raise SceneError(
                f"friction: at {self.norms.name(i)} the slip of the step to t = {self.t:.6g} changes the weight from "
                f"{w[i]:.6g} to {own[i]:.6g}, but its law has a slope, which is for laws that read the slip before "
                "the step alone; leave the slope out."
            )

    def in_units(self, of_terms: Floats, of_limits: Floats) -> StepLaw:
        return replace(
            self,
            weight=self.weight * of_terms,
            force=self.force * of_limits,
            length=self.length / of_terms,
        )
