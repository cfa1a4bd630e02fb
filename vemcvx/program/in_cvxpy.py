"""A step as a convex program in cvxpy.

    minimise  1/2 d'Kd - g'd + w't + v'C^{-1}v / 2    subject to  |B_i d - b_i| <= t_i,   D d - v <= e

with one second-order cone a term; v = 0 where a limit is a bound, v >= (z)_+ where it is soft. cvxpy's dual of the
cone |s_i| <= t_i is (w_i, -lam_i); p is that of D d - v <= e. Absolute values may be two inequalities instead, -t <=
B d - b <= t, whose duals (upper, lower) give lam = upper - lower.

A disc of multipliers may be a polygon with corners w e_k on its rim instead: e_k . s_i <= t_i with duals mu_k >= 0 that
sum to w_i, lam_i = sum_k mu_k e_k. Such multipliers are admissible; with P corners |s| cos(pi / P) <= max_k e_k . s, so
that the gap of the program of the disc at the answer is at most 1 - cos(pi / P) times w |s|, and the certificate says
how much it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats
from vemcvx.program.operators import Operators

if TYPE_CHECKING:
    import cvxpy as cp

    Data = Floats | cp.Parameter
    Cost = cp.Expression | float


@dataclass(frozen=True)
class CvxpyStep:
    """The program as cvxpy sees it, and its multipliers with our signs once it is solved.

    Attributes
    ----------
    problem : cvxpy.Problem
    d : cvxpy.Variable
        The increments (n,).
    parameters : tuple of cvxpy.Parameter
        g, w, b and e, if the program was posed for any data.
    """

    problem: cp.Problem
    d: cp.Variable
    _lam: Callable[[], Floats] = field(repr=False)
    _p: Callable[[], Floats] = field(repr=False)
    parameters: tuple[cp.Parameter, ...] = field(default=(), repr=False)

    def at(self, data: Sequence[Floats]) -> CvxpyStep:
        """The program of the step with these g, w, b and e."""
        for parameter, value in zip(self.parameters, data, strict=True):
            parameter.value = value
        return self

    @property
    def lam(self) -> Floats | None:
        """Multipliers (m, block) of the norm terms; None where the solver gave none."""
        return self._read(self._lam)

    @property
    def p(self) -> Floats | None:
        """Multipliers (r,) of the limits; None where the solver gave none."""
        return self._read(self._p)

    def _read(self, multipliers: Callable[[], Floats]) -> Floats | None:
        duals = [dual.value for constraint in self.problem.constraints for dual in constraint.dual_variables]
        return None if any(value is None for value in duals) else multipliers()


def to_cvxpy(
    operators: Operators, data: Sequence[Floats] | None, cones: bool = True, corners: Floats | None = None
) -> CvxpyStep:
    """Write a step in cvxpy; of no data g, w, b, e with parameters in their place.

    With `corners` (P, block), unit vectors, discs are such polygons.
    """
    import cvxpy as cp

    parameters: tuple[cp.Parameter, ...] = ()
    if data is None:
        sizes = len(operators.K.diagonal()), operators.count, operators.B.shape[0], operators.D.shape[0]
        parameters = tuple(cp.Parameter(size, nonneg=k == 1) for k, size in enumerate(sizes))
    g, w, b, e = parameters if data is None else data
    d = cp.Variable(len(operators.K.diagonal()))
    # assume_psd: K is a stiffness matrix; testing its eigenvalues would take longer than the solve.
    energy = 0.5 * cp.quad_form(d, operators.K, assume_PSD=True) - g @ d
    cones_or_rows, lengths, lam = _norms(operators, d, w, b=b, cones=cones, corners=corners)
    bounds, yielding, p = _limits(operators, d, e)
    # OSQP prints, verbose or not, where it finds no constraint active: this one, idle >= 0, always is. SCS breaks down
    # where there is none at all.
    idle = 0.0 if cones and cones_or_rows + bounds else cp.Variable(nonneg=True)
    problem = cp.Problem(cp.Minimize(energy + lengths + yielding + idle), cones_or_rows + bounds)
    return CvxpyStep(problem, d, lam, p, parameters)


def _norms(
    operators: Operators, d: cp.Variable, w: Data, *, b: Data, cones: bool, corners: Floats | None
) -> tuple[list[cp.Constraint], Cost, Callable[[], Floats]]:
    import cvxpy as cp

    if operators.count == 0:
        return [], 0.0, lambda: np.zeros((0, operators.block))
    t, s = cp.Variable(operators.count), operators.B @ d - b
    if corners is not None and operators.block > 1:
        sides = [sp.kron(sp.eye_array(operators.count), corner[None], format="csr") @ s <= t for corner in corners]
        return sides, w @ t, lambda: np.einsum("km,kb->mb", [side.dual_value for side in sides], corners)
    if cones:
        cone = cp.SOC(t, cp.reshape(s, (operators.block, operators.count), order="F"), axis=0)
        return [cone], w @ t, lambda: -np.reshape(cone.dual_value[1], (operators.block, operators.count), order="F").T
    upper, lower = s <= t, -s <= t
    return [upper, lower], w @ t, lambda: (upper.dual_value - lower.dual_value)[:, None]


def _limits(operators: Operators, d: cp.Variable, e: Data) -> tuple[list[cp.Constraint], Cost, Callable[[], Floats]]:
    import cvxpy as cp

    soft = np.flatnonzero(operators.compliance > 0)
    if len(operators.compliance) == 0:
        return [], 0.0, lambda: np.zeros(0)
    z = operators.D @ d - e
    if len(soft) == 0:
        bound = z <= 0
        return [bound], 0.0, lambda: bound.dual_value
    v = cp.Variable(len(soft))
    give = sp.csr_matrix(
        (np.ones(len(soft)), (soft, np.arange(len(soft)))), shape=(len(operators.compliance), len(soft))
    )
    bound = z - give @ v <= 0
    return [bound], 0.5 * cp.sum_squares(cp.multiply(operators.compliance[soft] ** -0.5, v)), lambda: bound.dual_value
