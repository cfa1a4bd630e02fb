"""Laws of friction. The weight w of a node is its largest possible friction force.

In Tresca's law the weights are given. Other laws compute them from the normal forces p (Coulomb: w = mu p), from slips
before the step, from the slip s of the step, or from the slip rate |s| / k of a step of duration k. Weights may then
depend on the answer of the step. With these weights held fixed, the answer solves a convex program. The certificate
holds for this program; its kind is called "for the given friction".

If weights do not depend on p, and do not fall as the slip grows (`softening` = 0), the step is a convex program with
terms phi(|s|) in place of w |s|. Here phi(r) = int_0^r w(q) dq, and w(q) is the weight at a slip of length q. Then the
certificate bounds the error of the step (proof: docs/theory/coulomb.md).
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

    The law of an effect computes m weights, one per row, from the normal forces p (m,) of the same rows. The law of a
    system computes the weights of all m norm terms from the forces p (r,) of all r limits; its slope is (m, r).

    Parameters
    ----------
    weights : callable (t, p, past, slip) -> (m,)
        Weights >= 0 for forces p >= 0; `past` (m,) is the sum of |slip| over earlier steps, `slip` (m,) is |slip| of
        the step.
    softening : number or (m,) array, optional
        The largest decrease of a weight per unit slip (force per length), for laws that do not depend on p. A step has
        one solution if the decrease is small (:mod:`vemcvx.stepping.refusals`). None means unknown: no check is made.
    pressed : bool
        True if weights depend on normal forces; an effect then needs one-sided contact on the same boundary. If False,
        p is an empty array in an effect.
    slope : callable (t, p, past) -> (m,) array, or (m, r) matrix, optional
        The derivative dw/dp; at kinks, the derivative towards larger p. Omit it if weights depend on `slip`.
    slips : bool
        True if weights depend on `past` or `slip`. If False, both are empty arrays in an effect, and zeros in a system.
    rates : bool
        True if `slip` is the slip rate, |slip| over the duration of the step; it is zero at the initial instant. Then
        `softening` is the largest decrease of weights per unit of this rate.

    Raises
    ------
    SceneError
        An argument is invalid, or `rates` is True with a slope or without `slips`.

    Examples
    --------
    >>> coulomb = vx.Law(lambda t, p, past, slip: 0.3 * p, pressed=True, slope=lambda t, p, past: np.full(len(p), 0.3))
    >>> coulomb.weights(0.0, np.array([10.0]), np.zeros(1), np.zeros(1))
    array([3.])
    """

    weights: Callable[[float, Floats, Floats, Floats], ArrayLike]
    softening: ArrayLike | None = None
    pressed: bool = False
    slope: Callable[[float, Floats, Floats], Any] | None = None
    slips: bool = True
    rates: bool = False

    def __post_init__(self) -> None:
        if not callable(self.weights):
            raise SceneError(f"Law: found weights = {brief(self.weights)}; wanted a function of (t, p, past, slip).")
        function(self.slope, "Law: found slope", "a function of (t, p, past)")
        for name in ("pressed", "slips", "rates"):
            object.__setattr__(self, name, flag(getattr(self, name), f"Law: {name}"))
        if self.rates and (not self.slips or self.slope is not None):
            raise SceneError("Law: found rates=True with slips=False or a slope; a law of slip rates has neither.")
