"""The program of a step in cvxpy, with the arrays of :class:`vemcvx.program.StepProgram`.

    minimise  1/2 d'Kd - g'd + w't + v'C^{-1}v / 2    subject to  |s_i| <= t_i,   D d - v <= e

The slips are s_i = B_i d - b_i, and the limits are D_j d <= e_j. The unknowns are the increment d, bounds t_i on |s_i|,
and excesses v_j of limits with compliances c_j > 0. For these limits, C = diag(c_j). Other limits have v_j = 0. The
multiplier p of the limits is the dual of D d - v <= e. The slips have the multiplier lam:

- If slips are vectors, |s_i| <= t_i is a second-order cone with the dual (w_i, -lam_i).
- If slips are numbers, |s| <= t means s <= t and -s <= t. Then lam is the dual of s <= t minus the dual of -s <= t.
- A term that always sticks has the further constraint s_i = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Bools, Floats
from vemcvx.program.operators import Operators

if TYPE_CHECKING:
    import cvxpy as cp


@dataclass(frozen=True)
class CvxpyStep:
    """The program of a step in cvxpy, with the signs of `vemcvx.program.StepProgram`.

    Attributes
    ----------
    problem : cvxpy.Problem
    d : cvxpy.Variable
        The increments (n,).
    parameters : tuple of cvxpy.Parameter
        Parameters g, w, b and e, if the program was posed without data.
    """

    problem: cp.Problem
    d: cp.Variable
    _multipliers: Callable[[], tuple[Floats, Floats]] = field(repr=False)
    parameters: tuple[cp.Parameter, ...] = field(default=(), repr=False)

    def at(self, data: Sequence[Floats]) -> CvxpyStep:
        """Set the parameters g, w, b and e, and return the program."""
        for parameter, value in zip(self.parameters, data, strict=True):
            parameter.value = value
        return self

    @property
    def lam(self) -> Floats | None:
        """Multipliers (m, block) of the norm terms; None if the solver returned none."""
        return self._multipliers()[0] if self._solved else None

    @property
    def p(self) -> Floats | None:
        """Multipliers (r,) of the limits; None if the solver returned none."""
        return self._multipliers()[1] if self._solved else None

    @property
    def _solved(self) -> bool:
        return all(dual.value is not None for one in self.problem.constraints for dual in one.dual_variables)


def to_cvxpy(operators: Operators, data: Sequence[Floats] | None, stuck: Bools) -> CvxpyStep:
    """Return a step in cvxpy, with parameters if `data` (g, w, b, e) is None."""
    import cvxpy as cp

    (n, m, _, r), block, c = operators.sizes, operators.block, operators.compliance
    parameters = tuple(cp.Parameter(size, nonneg=k == 1) for k, size in enumerate(operators.sizes) if data is None)
    g, w, b, e = parameters if data is None else data
    d = cp.Variable(n)
    # Testing the eigenvalues of K would take longer than the solve.
    energy: cp.Expression = 0.5 * cp.quad_form(d, operators.K, assume_PSD=True) - g @ d
    sides: list[cp.Constraint] = []
    still: list[cp.Constraint] = []
    limits: list[cp.Constraint] = []
    if m:
        t, s = cp.Variable(m), operators.B @ d - b
        energy += w @ t
        cone = cp.SOC(t, cp.reshape(s, (block, m), order="F"), axis=0)
        sides = [cone] if block > 1 else [s <= t, -s <= t]
        if stuck.any():
            held = np.repeat(stuck, block)
            still = [sp.csr_matrix(sp.eye_array(len(held)))[held] @ s == 0]
    if r:
        z, soft = operators.D @ d - e, np.flatnonzero(c > 0)
        if len(soft):
            v = cp.Variable(len(soft))
            z = z - sp.eye_array(r, format="csr")[:, soft] @ v
            energy += 0.5 * cp.sum_squares(cp.multiply(c[soft] ** -0.5, v))
        limits = [z <= 0]

    def multipliers() -> tuple[Floats, Floats]:
        lam, p = np.zeros((m, block)), np.asarray(limits[0].dual_value) if r else np.zeros(0)
        if m and block > 1:
            lam = -np.reshape(sides[0].dual_value[1], (block, m), order="F").T
        elif m:
            lam = (sides[0].dual_value - sides[1].dual_value)[:, None]
        if still:
            lam[stuck] = np.reshape(still[0].dual_value, (-1, block))
        return lam, p

    # SCS fails without constraints, and OSQP prints text if no constraint is active.
    idle = 0.0 if block > 1 and (sides or limits) else cp.Variable(nonneg=True)
    return CvxpyStep(cp.Problem(cp.Minimize(energy + idle), [*sides, *still, *limits]), d, multipliers, parameters)
