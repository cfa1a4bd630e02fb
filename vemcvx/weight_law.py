"""The law of friction, of weights that follow the answer of a step, w = W(t, p, past, slip).

A norm term w_i |s_i| costs friction's bound times the slip. Tresca's bound is given. Where it follows the forces p of
the limits (Coulomb: w = mu p), the slips before the step, or those of the step, the step is a fixed point of convex
programs with given weights (:mod:`vemcvx.stepping.fixed_point`). Two derivatives say more of it:

slope      J = dW/dp, of a law that does not read the slip of the step: steps are solved whole, and certificates bound
           the distance to a solution (:mod:`vemcvx.solvers.coulomb`); on discs, where W is affine near the solution
softening  k >= -dW/dslip, of a law that does not read p: where it is slow enough a step stays convex, and
           certificates are bounds (:mod:`vemcvx.stepping.state`); 0 if the law reads the slip before the step alone

Without either certificates are estimates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.arrays import Floats, brief, flag, function
from vemcvx.errors import SceneError


@dataclass(frozen=True)
class Law:
    """A law of friction.

    One record serves the rows of an effect, each with the normal force on it, and the m norm terms of a system, where
    rows add up and p (r,) are the forces of all limits: the slope is then a matrix (m, r).

    Parameters
    ----------
    weights : callable (t, p, past, slip) -> (m,)
        Weights >= 0 under forces p >= 0, after the sum of |slip| over the steps before, (m,), and |slip| of the step.
    softening : number or (m,) array, optional
        How fast weights fall at most as the slip of the step grows, force per length.
    pressed : bool
        True if weights of an effect read normal forces, which one-sided contact on the same boundary tells; without,
        that argument is an empty array.
    slope : callable (t, p, past) -> (m,) array, or (m, r) matrix, optional
        The derivative by p, of the piece towards larger forces where two meet.
    slips : bool
        True if weights read slip, before the step or in it; without, those arguments are zero.
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


@dataclass(frozen=True)
class PressureLaw:
    """A law at an instant, after given slips: weights (m,) piecewise affine in the forces p (r,), with slope (m, r)."""

    weights: Callable[[Floats], Floats]
    slope: Callable[[Floats], sp.csr_matrix]

    @staticmethod
    def given(w: Floats, r: int) -> PressureLaw:
        """The law of given weights (m,), whatever the forces (r,)."""
        slope = sp.csr_matrix((len(w), r))
        return PressureLaw(lambda p: w, lambda p: slope)

    def scaled(self, up: Floats, down: Floats) -> PressureLaw:
        """The law in units in which weights are `up` (m,) times as many, and forces are `down` (r,) of these."""

        def scale(J: sp.csr_matrix) -> sp.csr_matrix:
            entries = np.repeat(up, np.diff(J.indptr)) * J.data * down[J.indices]
            return sp.csr_matrix((entries, J.indices, J.indptr), shape=J.shape)

        scaled = once_for_each(scale)
        return PressureLaw(lambda p: up * self.weights(down * p), lambda p: scaled(self.slope(down * p)))

    def piece(self, p: Floats) -> Piece:
        """The affine piece of the law at the forces p (r,)."""
        return Piece(self.weights(p), self.slope(p), p)


@dataclass(frozen=True)
class Piece:
    """An affine piece of a law at the forces p_0 (r,): weights (m,) there, and their derivative (m, r)."""

    weights: Floats
    slope: sp.csr_matrix
    forces: Floats


def once_for_each(change: Callable[..., sp.csr_matrix]) -> Callable[..., sp.csr_matrix]:
    """The change of a matrix, made once where the same matrix comes again, to which nobody writes.

    Slopes of a law are one matrix on each of its pieces. A step asks for it some five times, and made anew thrice at
    each they took a tenth of a step of 169 contacts.
    """
    last: list[tuple[Any, sp.csr_matrix]] = []

    def changed(J: Any, *others: Any) -> sp.csr_matrix:
        if not last or last[0][0] is not J:
            made = change(J, *others)
            if not isinstance(J, sp.csr_matrix) or J.data.flags.writeable:
                return made
            made.data.flags.writeable = False
            last[:] = [(J, made)]
        return last[0][1]

    return changed


def same_matrix(one: sp.csr_matrix, other: sp.csr_matrix) -> bool:
    """Return True if two matrices of a shape have the same entries, in the same order."""
    if one is other:
        return True
    parts = (one.data, other.data), (one.indices, other.indices), (one.indptr, other.indptr)
    return all(np.array_equal(*pair) for pair in parts)
