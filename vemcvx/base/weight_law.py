"""The law of friction: weights that follow the answer of a step, w = W(t, p, past, slip).

Tresca's bound of friction is given. Other bounds follow the forces p of the limits (Coulomb: w = mu p), the slips
before the step, or the slips of the step. The answer of a step then solves the convex program whose weights are those
of its own pressure and slip, and the certificate is that of this program, "for the given friction".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from vemcvx.base.arrays import Floats, brief, flag, function
from vemcvx.base.errors import SceneError


@dataclass(frozen=True)
class Law:
    """A law of friction.

    An effect gives it for its rows, each with its normal force; a system for its m norm terms, with the forces p (r,)
    of all limits and a slope (m, r).

    Parameters
    ----------
    weights : callable (t, p, past, slip) -> (m,)
        Weights >= 0 under forces p >= 0, after the sum of |slip| over the steps before, (m,), and |slip| of the step.
    softening : number or (m,) array, optional
        The largest decrease of weights per slip of the step, force per length, of a law that does not read p: where it
        is small, a step has one solution (:mod:`vemcvx.stepping.refusals`).
    pressed : bool
        True if weights of an effect read normal forces, which one-sided contact on the same boundary gives; otherwise
        that argument is an empty array.
    slope : callable (t, p, past) -> (m,) array, or (m, r) matrix, optional
        The derivative by p, of the piece towards larger forces where two meet, of a law that does not read the slip of
        the step.
    slips : bool
        True if weights read slip, before the step or in it; otherwise those arguments are empty arrays of an effect's
        law, and zero of a system's.
    """

    weights: Callable[[float, Floats, Floats, Floats], ArrayLike]
    softening: ArrayLike | None = None
    pressed: bool = False
    slope: Callable[[float, Floats, Floats], Any] | None = None
    slips: bool = True

    def __post_init__(self) -> None:
        if not callable(self.weights):
            raise SceneError(f"Law: found weights = {brief(self.weights)}; wanted a function of (t, p, past, slip).")
        function(self.slope, "Law: found slope", "a function of (t, p, past)")
        for name in ("pressed", "slips"):
            object.__setattr__(self, name, flag(getattr(self, name), f"Law: {name}"))
