"""Static condensation of a system to the unknowns of norm terms and limits.

Norm terms (friction) and limits (contact) act on the retained unknowns c. All other unknowns i are interior. The
stiffness matrix K has the Schur complement S = K_cc - K_ci K_ii^{-1} K_ic.

A force phi is *reduced* to two vectors. xi is the response of the interior if the retained unknowns are zero, and tau
is a force on the retained unknowns:

    xi = (K_ii^{-1} phi_i, 0),     tau = phi_c - K_ci xi_i.

Let f be a force, reduced to xi_f and tau_f. A state y under f, with the retained unknowns y_c, obeys

    y = xi_f + K^{-1} (0, S y_c),     K y = f + (0, S y_c - tau_f),
    y'Ky = f'xi_f + y_c'S y_c,        phi'y = phi'xi_f + tau'y_c.

If K has a kernel, we add the diagonal stiffness E of anchors (:mod:`.kernel`) to K. The Schur complement is then S + E.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Floats, Ints, power_of_two, read_only, scatter
from vemcvx.base.errors import NotAccepted
from vemcvx.linear import Factor, LinearSolver, Matrix, order_by_minimum_degree
from vemcvx.program.certificate import ROUNDED
from vemcvx.program.kernel import add_anchors, choose_anchors
from vemcvx.program.operators import DenseInverse, Operators
from vemcvx.program.system import System

MOST_SHAPES = 6
"""Largest number of forces that `reduce` stores per `kind`."""


@dataclass(frozen=True, eq=False)
class Reduced:
    """A force phi, reduced to xi and tau."""

    phi: Floats  # (n,)
    xi: Floats  # (n,)
    retained: Floats  # (m,) tau
    released: Floats  # (m,) the retained part of K^{-1} phi

    @cached_property
    def norm(self) -> float:
        """The energy norm (phi'K^{-1}phi)^{1/2}."""
        with np.errstate(over="ignore", invalid="ignore"):
            return float(np.sqrt(abs(self.work_inside(self) + float(self.retained @ self.released))))

    def work_inside(self, other: Reduced) -> float:
        """Return phi'xi with the xi of another force."""
        return float(self.phi @ other.xi)

    def plus(self, other: Reduced, share: float = 1.0) -> Reduced:
        """Return this force plus `share` times another force."""
        with np.errstate(over="ignore", invalid="ignore"):
            return Reduced(
                self.phi + share * other.phi,
                self.xi + share * other.xi,
                self.retained + share * other.retained,
                self.released + share * other.released,
            )

    def __add__(self, other: Reduced) -> Reduced:
        return self.plus(other)

    def __sub__(self, other: Reduced) -> Reduced:
        return self.plus(other, -1.0)


class Condensation:
    """A system reduced to its `retained` unknowns (m,).

    `operators` act on retained unknowns, and `full` on all unknowns. If `whole` is True, all unknowns are retained.
    `factor` is the factor of K + E. `anchor` is the diagonal of E, or None.
    """

    def __init__(self, system: System, condense: bool = True, linear: LinearSolver | None = None):
        self.system, self.linear = system, system.linear(linear)
        self.whole = not (condense and self.linear.eliminates)
        n, c = system.n, system.retained
        self.anchor: Floats | None = None
        if system.kernel is not None:
            if not self.linear.eliminates:
                raise NotAccepted(
                    f"linear solver {type(self.linear).__name__}: the stiffness has a kernel (only friction holds the "
                    "body), which this linear solver does not accept; SuperLU() does."
                )
            self.anchor = scatter(choose_anchors(system.kernel.modes[c], system.K.diagonal()[c]), c, n)
        self._K = system.K if self.anchor is None else sp.csr_matrix(add_anchors(system.K, self.anchor))
        self._bases: dict[str, list[Reduced]] = {}
        if self.whole:
            self.factor: Factor = self.linear.factorise(self._K, system.near_kernel)
            self.retained, self._S = np.arange(n), self._K
            self.operators = self.full = self._on(self.retained, system.K, self.factor)
            return
        order = np.arange(n) if self.linear.orders else system.elimination_order()
        order = order_by_minimum_degree(self._K) if order is None else order
        self.factor, S = self.linear.eliminate(self._K, order, c)
        self.retained, self._S = c, read_only(S)
        self.full = self._on(np.arange(n), system.K, self.factor)
        K = S
        if self.anchor is not None:
            self.anchor = self.anchor[c]
            K = read_only(S - np.diag(self.anchor))
        self.operators = self._on(c, K, DenseInverse(S))

    def _on(self, c: Ints, K: Matrix, factor: Factor) -> Operators:
        system, kernel, limits = self.system, self.system.kernel, self.system.limits
        return Operators(
            K,
            system.B[:, c],
            system.block,
            given_factor=factor,
            kernel=None if kernel is None else np.linalg.qr(kernel.modes[c])[0],
            D=system.D[:, c],
            compliance=None if limits is None else limits.compliance,
        )

    def reduce(self, phi: Floats, kind: str = "") -> Reduced:
        """Return the reduced force phi."""
        unit = float(power_of_two(float(np.abs(phi).max(initial=0.0))))
        rest = load = phi / unit
        n, m = len(phi), len(self.retained)
        none = total = Reduced(np.zeros(n), np.zeros(n), np.zeros(m), np.zeros(m))
        basis = self._bases.setdefault(kind, [])
        for shape in basis:
            share = float(shape.phi @ rest) / float(shape.phi @ shape.phi)
            rest, total = rest - share * shape.phi, total.plus(shape, unit * share)
        if np.linalg.norm(rest) <= ROUNDED * np.linalg.norm(load):
            return total
        if len(basis) == MOST_SHAPES:
            return none.plus(self._solve_shape(load), unit)
        basis.append(self._solve_shape(rest))
        return total.plus(basis[-1], unit)

    def _solve_shape(self, phi: Floats) -> Reduced:
        xi = self.solve_interior(phi)
        tau = self.balance(phi[self.retained] - self._K[self.retained] @ xi, phi)
        return Reduced(phi, xi, tau, self.operators.factor.solve(tau))

    def balance(self, tau: Floats, phi: Floats) -> Floats:
        """Correct tau (m,) so that tau and phi do equal work in motions of the kernel."""
        kernel, N = self.system.kernel, self.operators.kernel
        if kernel is None or N is None:
            return tau
        work, size = kernel.modes.T @ phi, np.abs(kernel.modes).T @ np.abs(phi)
        work = np.where(np.abs(work) <= ROUNDED * size, 0.0, work)
        return tau + N @ (np.linalg.solve(kernel.modes[self.retained].T @ N, work) - N.T @ tau)

    def solve_interior(self, phi: Floats) -> Floats:
        """Return xi for a force phi (n,), or for k forces (n, k)."""
        c, inner = self.retained, phi.copy()
        inner[c] = 0.0
        if not inner.any():
            return inner
        xi = self.factor.solve(inner)
        for _ in range(2):  # The forces -S xi_c move the retained unknowns to zero.
            if np.abs(xi[c]).max(initial=0.0) <= ROUNDED * np.abs(xi).max():
                break
            inner[c] -= self._S @ xi[c]
            xi = self.factor.solve(inner)
        xi[c] = 0.0
        return xi

    def response(self, force: Reduced) -> Floats:
        """Return the response K^{-1} phi (n,) to a force."""
        return self.complete(force.xi, force.released)

    def complete(self, xi: Floats, y_c: Floats) -> Floats:
        """Return the state xi + K^{-1} (0, S y_c) (n,)."""
        pushed, y = np.zeros_like(xi), xi.copy()
        if y_c.any() and len(y_c) < len(xi):
            pushed[self.retained] = self._S @ y_c
            y += self.factor.solve(pushed)
        y[self.retained] = y_c
        return y
