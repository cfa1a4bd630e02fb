"""Laws of friction: weights w = W(t, p, past, slip), the largest possible friction forces at the nodes.

In Tresca's law the weights are given. In other laws they depend on the normal forces p (Coulomb: w = mu p), on slips
before the step, on the slip s of the step, or on the slip rate |s|/k, with the duration k of the step. The answer of a
step then solves a convex program whose weights are evaluated at the pressure and slip of this answer. The certificate
holds for this program; its kind is called "for the given friction".

If weights do not depend on p, and do not fall as the slip of the step grows (`softening` = 0), the step itself is a
convex program. Its terms are phi(|s|) in place of w |s|, with phi(r) = int_0^r w(q) dq and the weight w(q) at a slip of
length q. Then the certificate is a bound: docs/theory/coulomb.md has the proof.
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

    In an effect, a law has m rows, each with its normal force p (m,). A system has m norm terms w |s| of friction, and
    r limits (rows of one-sided contact). Its law has the forces p (r,) of all limits, and a slope (m, r).

    Parameters
    ----------
    weights : callable (t, p, past, slip) -> (m,)
        Weights >= 0 for forces p >= 0; `past` (m,) is the sum of |slip| over earlier steps, `slip` (m,) is |slip| of
        the step.
    softening : number or (m,) array, optional
        The largest decrease of weights per unit slip of the step (force per length), if the law does not depend on p. A
        step has one solution if this decrease is small (:mod:`vemcvx.stepping.refusals`). None: unknown, not checked.
    pressed : bool
        True if weights of an effect depend on normal forces. This requires one-sided contact on the same boundary. If
        False, p is an empty array.
    slope : callable (t, p, past) -> (m,) array, or (m, r) matrix, optional
        The derivative dw/dp (at kinks, towards larger p) of weights that do not depend on the slip of the step.
    slips : bool
        True if weights depend on slips, before the step or in it. If False, `past` and `slip` are empty arrays in an
        effect, and zeros in a system.
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
