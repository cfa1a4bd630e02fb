"""When friction that weakens with slip leaves a step convex.

With Phi_i the integral of the weights w_i over the slip of the step, a step minimises

    1/2 d'Kd - g'd + sum_i Phi_i(|s_i|),     s = B d - b.

Weights that fall no faster than k_i per slip make Phi_i + k_i |s_i|^2 / 2 convex, and the sum is strongly convex where
what they take is less than what the body gives back: with

    rho = the largest eigenvalue of  k^{1/2} B K^{-1} B' k^{1/2},      sum_i k_i |(B d)_i|^2 <= rho d'Kd,

as long as rho < 1. In a block of height H and shear modulus mu that is k < mu / H per area: the stability of a
spring and a slider. The margin 1 - rho does not depend on the length of steps. Without one a step may have several
answers, or jump: what is found is then an estimate, which a warning says.

Theorem. Let rho < 1, and let (d_k, lam, p) be certified under the weights w' of its own slip by gap =
1/2 |r|^2_{K^{-1}} + C. Then the step has one solution d, and  |d_k - d|_K <= sqrt(2 gap) / (1 - rho).
Proof. With e = d_k - d:  |e|^2_K = -r.e - (lam - lam*).Be - (p - p*).De. What C misses excepted, the last term is <= 0,
and the one before it at most (w'_i - w*_i)(|s*_i| - |s_i|) summed, which is at most sum k_i (|s_i| - |s*_i|)^2 <=
sum k_i |(Be)_i|^2 <= rho |e|^2. So (1 - rho) |e|^2 <= |r| |e| + C, with |r| |e| <= |r|^2 / 2(1 - rho) +
(1 - rho) |e|^2 / 2.  QED  (One solution: between two of them r and C are nothing.)

The iteration w_{k+1} = law(s(T(w_k))) of :mod:`vemcvx.stepping.fixed_point` shrinks increments by rho if weights do not
rise faster than k, either. A law that reads the slip before the step alone has k = 0: the certificate of its one
program is the step's.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from vemcvx.arrays import Floats
from vemcvx.errors import SceneWarning
from vemcvx.program.norms import Norms
from vemcvx.program.operators import Operators

STABLE = 0.999
"""rho beyond which the rounding of answers counts for more than a thousand times itself."""


@dataclass(frozen=True)
class Stability:
    """rho, and the term that has most of its eigenvector."""

    rho: float
    worst: int

    @property
    def margin(self) -> float:
        """1 - rho where steps are convex with rho < STABLE, else 0."""
        return 1.0 - self.rho if self.rho < STABLE else 0.0


def stability_of(operators: Operators, norms: Norms) -> Stability | None:
    """The stability of norm terms; a warning where they are not stable."""
    found = stability(operators, norms.softest)
    if found is not None and found.margin == 0.0:
        warnings.warn(
            f"friction: weights may fall faster with slip than the body gives way, most at {norms.name(found.worst)} "
            f"(softening over stiffness is {found.rho:.3g}; less than {STABLE:g} makes steps convex). A step may have "
            "several answers, or jump, and certificates are estimates. Take a law that falls over a longer slip, a "
            "stiffer body, or a law that reads the slip before the step alone.",
            SceneWarning,
            stacklevel=2,
        )
    return found


def stability(operators: Operators, softening: Floats | None) -> Stability | None:
    """The stability of weights that fall with the slip of a step by `softening` (m,) at most; None if that is unknown.

    Bodies that nothing but friction holds have none to give back: rho is infinite. Iteratively, how each place answers
    to each other one would take as many solves: it is unknown.
    """
    if softening is None or (softening.any() and not operators.factor.exact):
        return None
    falls = np.flatnonzero(softening)
    if len(falls) == 0:
        return Stability(0.0, 0)
    if operators.kernel is not None:
        return Stability(np.inf, int(np.argmax(softening)))
    block = operators.block
    rows = (falls[:, None] * block + np.arange(block)).ravel()
    root = np.repeat(np.sqrt(softening[falls]), block)
    B = operators.B[rows].toarray()
    M = root[:, None] * (B @ operators.factor.solve(np.ascontiguousarray(B.T))) * root
    value, vector = eigh(0.5 * (M + M.T), subset_by_index=[len(M) - 1, len(M) - 1])
    return Stability(float(value[0]), int(falls[np.argmax(np.abs(vector[:, 0])) // block]))
