"""Laws of friction. The weight w of a node is the largest possible friction force.

Tresca's law prescribes the weights. Coulomb's law w = mu p computes weights from the normal forces p. Other laws use
earlier slips, the slip s of the step, or the slip rate |s| / k, where k is the duration of the step. If weights depend
on the answer of the step, the certificate holds for the convex program with the weights at the answer. The kind of this
certificate is called "for the given friction".

If weights do not depend on p and never fall with the slip (`softening` = 0), the step itself is a convex program: the
term phi(|s|) = int_0^|s| w(q) dq replaces w |s|. The certificate then bounds the error of the step (proof:
docs/theory/coulomb.md).
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

    In an effect, p has m entries, one per weight. In a :class:`vemcvx.System`, p has the forces (r,) of the `limits`,
    and each term of the `norms` has one weight.

    Parameters
    ----------
    weights : callable (t, p, past, slip) -> (m,)
        Weights >= 0 for normal forces p >= 0. `past` (m,) is the sum of |slip| over earlier steps; `slip` (m,) is
        |slip| of the step.
    softening : number or (m,) array, optional
        The largest decrease of a weight per unit slip (force per length), for laws that do not depend on p. If None,
        steps with several solutions cause no warning (:mod:`vemcvx.stepping.refusals`).
    pressed : bool
        True if weights depend on normal forces; an effect then needs one-sided contact on the same boundary. If False,
        an effect gets an empty array p.
    slope : callable (t, p, past) -> (m,) array, or (m, r) matrix, optional
        The derivative dw/dp; at kinks, the derivative towards larger p. Omit `slope` if weights depend on `slip`.
    slips : bool
        True if weights depend on `past` or `slip`. If False, an effect gets empty arrays `past` and `slip`.
    rates : bool
        True if `slip` is the slip rate, zero at the initial instant; `softening` is then per unit slip rate.

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
