"""Friction that remembers: weights that see how far their terms have slipped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arguments import called
from vemcvx.arrays import Floats, Ints, shaped
from vemcvx.errors import SceneError


@dataclass(frozen=True)
class SlipLaw:
    """Weights of friction that depend on slip: that of the step, and all that was before it.

    Within a step weights follow its own slip, which follows them: a fixed point, of convex programs with given weights
    (:mod:`vemcvx.stepping.fixed_point`). Where they fall slowly enough it is the only one, and certificates are bounds.
    A law that reads the slip before the step alone has `softening` zero.
    """

    weights: Callable[[float, Floats, Floats, Floats], ArrayLike]
    """(t, normal forces, sum of |slip| over the steps before, |slip| of the step), each (m,) -> (m,) weights >= 0"""
    softening: ArrayLike | None = None
    """one for all, or (m,), by which weights fall at most, per length that slip of the step grows: for laws that read
    no normal forces. None: unknown, and certificates are estimates"""
    pressed: bool = False
    """whether weights depend on normal forces, which one-sided contact on the same boundary tells; without, that
    argument is an empty array"""
    slope: Callable[[float, Floats, Floats], ArrayLike] | None = None
    """(t, normal forces, slip before the step) -> (m,), the derivative by the forces of a `pressed` law that is
    piecewise affine in them, and does not read the slip of the step: steps are certified as those of Coulomb's law"""

    def added(self, subject: str, nodes: Ints, t: float, forces: Floats, slips: tuple[Floats, Floats]) -> Floats:
        """The weights (m,) of rows at these nodes, under normal forces (m,), after slips before the step and in it.

        Raises
        ------
        SceneError
            The law fails, or gives something else than a weight >= 0 for every row.
        """
        failed = f"{subject}: its slip law failed when called as f(t, forces, before, slip) with t = {t:.6g}"
        arguments = (t, forces if self.pressed else np.zeros(0), *slips)
        wanted = "take the values of all rows at once and return a weight for each"
        if not self.pressed:
            wanted += "; normal forces are told where pressed=True says that it reads them"
        w = _of_rows(called(self.weights, arguments, failed, wanted), f"{subject}: slip law", nodes, "weights")
        lawful = (w >= 0) & (w < np.inf)
        if not lawful.all():
            i = int(np.argmin(lawful))
            raise SceneError(
                f"{subject}: found the weight {w[i]:.6g} at node {nodes[i]} and t = {t:.6g}, where the slip is "
                f"{slips[0][i]:.6g} before the step and {slips[1][i]:.6g} in it; slip laws give finite weights >= 0."
            )
        return w

    def slope_at(self, subject: str, nodes: Ints, t: float, forces: Floats, before: Floats) -> Floats:
        """The derivative (m,) of the weights of rows by the normal forces; zero if it is not known."""
        if self.slope is None:
            return np.zeros(len(nodes))
        failed = f"{subject}: slope failed when called as f(t, forces, before) with t = {t:.6g}"
        raw = called(self.slope, (t, forces, before), failed, "take the values of all rows at once")
        return _of_rows(raw, f"{subject}: slope", nodes, "derivatives of weights")

    def rate(self, subject: str, nodes: Ints) -> Floats:
        """How fast weights (m,) fall at most.

        Raises
        ------
        SceneError
            That is no number >= 0, or forces of contact change them, too.
        """
        rate = _of_rows(self.softening, f"{subject}: softening", nodes, "weights lost per length of slip")
        lawful = (rate >= 0) & (rate < np.inf)
        if self.pressed or not lawful.all():
            found = "beside pressed=True" if self.pressed else f"{rate[np.argmin(lawful)]:.6g}"
            raise SceneError(
                f"{subject}: found softening {found}; it is a finite number >= 0 of a law that reads no normal forces, "
                "or None, which makes certificates estimates."
            )
        return rate


def _of_rows(raw: object, subject: str, nodes: Ints, what: str) -> Floats:
    m = len(nodes)
    return np.array(np.broadcast_to(shaped(raw, subject, f"one number, or ({m},) {what}, one a row", (), (m,)), (m,)))
