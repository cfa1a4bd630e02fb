"""Static condensation, once for all steps: a system reduced to the unknowns of its norm terms and limits.

Norm terms and limits act on the retained unknowns c; the others are the interior unknowns i. The Schur complement is
S = K_cc - K_ci K_ii^{-1} K_ic. If K = L U is ordered with c last, then S = L_cc U_cc, at no extra cost.

A force phi is *reduced* to the interior response xi with fixed retained unknowns, and to the force tau on them:

    xi = (K_ii^{-1} phi_i, 0),     tau = phi_c - K_ci xi_i.

Let y be a state under the force f, with retained displacements y_c; xi_f and tau_f are the xi and tau of f. Then

    y = xi_f + K^{-1} (0, S y_c),     K y = f + (0, S y_c - tau_f),
    y'Ky = f'xi_f + y_c'S y_c,        phi'y = phi'xi_f + tau_phi'y_c,

where phi'y is the work of a force phi. No energies are subtracted from each other. If K has a kernel
(:mod:`.kernel`), the diagonal matrix E of the anchors' stiffness is added to K; the Schur complement is then S + E.

The loads of a run combine few forces, called shapes. Each costs one solve; the energy of a combination is a sum over
pairs of shapes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from weakref import WeakKeyDictionary

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
"""Largest number of stored shapes; further loads of new shape cost one solve per step."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A force phi (n,) with its xi (n,) and tau (m,), and `released` (m,), the retained part of K^{-1} phi."""

    phi: Floats
    xi: Floats
    tau: Floats
    released: Floats
    _works: WeakKeyDictionary[Shape, float] = field(default_factory=WeakKeyDictionary, repr=False)

    def work_inside(self, other: Shape) -> float:
        """Return phi'xi, the work of this shape's phi on the xi of another shape."""
        work = self._works.get(other)
        if work is None:
            self._works[other] = work = float(self.phi @ other.xi)
        return work


@dataclass(frozen=True, eq=False)
class Reduced:
    """A force as a combination of shapes with coefficients `shares`."""

    condensation: Condensation
    shares: dict[Shape, float]

    @cached_property
    def retained(self) -> Floats:
        """The force tau (m,) on the retained unknowns."""
        return self._sum("tau", len(self.condensation.retained))

    @cached_property
    def phi(self) -> Floats:
        """The force (n,)."""
        return self._sum("phi", self.condensation.system.n)

    @property
    def xi(self) -> Floats:
        """The response xi (n,) with fixed retained unknowns."""
        return self._sum("xi", self.condensation.system.n)

    @cached_property
    def x(self) -> Floats:
        """The response K^{-1} phi (n,)."""
        return self.condensation.complete(self.xi, self._sum("released", len(self.condensation.retained)))

    @cached_property
    def norm(self) -> float:
        """The energy norm (phi'K^{-1}phi)^{1/2} of `x`."""
        released = self._sum("released", len(self.condensation.retained))
        with np.errstate(over="ignore", invalid="ignore"):
            return float(np.sqrt(abs(self.work_inside(self) + float(self.retained @ released))))

    def work_inside(self, other: Reduced) -> float:
        """Return phi'xi, the work of this force on the xi of another force."""
        pairs = ((one, a, two, b) for one, a in self.shares.items() for two, b in other.shares.items())
        # Multiply in this order: a * b can overflow where a * b * work does not.
        return float(sum(a * (b * one.work_inside(two)) for one, a, two, b in pairs))

    def __add__(self, other: Reduced) -> Reduced:
        total = dict(self.shares)
        for shape, share in other.shares.items():
            total[shape] = total.get(shape, 0.0) + share
        return Reduced(self.condensation, total)

    def __sub__(self, other: Reduced) -> Reduced:
        return self + Reduced(self.condensation, {shape: -share for shape, share in other.shares.items()})

    def _sum(self, name: str, count: int) -> Floats:
        """Return the combination (count,) of one array per shape."""
        total = np.zeros(count)
        with np.errstate(over="ignore", invalid="ignore"):
            for shape, share in self.shares.items():
                total += share * getattr(shape, name)
        return total


class Condensation:
    """A system reduced to its retained unknowns.

    `operators` are the dense S and the rows of norm terms and limits, on the `retained` (m,) unknowns. `full` are the
    operators on all unknowns. If `whole` is True, the system is not condensed, and `operators` equals `full`.
    `factor` solves with K; if K has a kernel, with K plus the stiffness `anchor`.
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
        self._bases: dict[str, list[tuple[Floats, Shape]]] = {}
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
        """Return the operators on the unknowns `c` (m,)."""
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
        """Return the reduced form of a force (n,); if it combines earlier forces of this kind, no solve is needed."""
        unit = float(power_of_two(float(np.abs(phi).max(initial=0.0))))
        rest = load = phi / unit
        basis, shares = self._bases.setdefault(kind, []), dict[Shape, float]()
        for q, shape in basis:
            share = float(q @ rest) / float(q @ q)  # Exactly 1 if the load is the shape itself.
            rest, shares[shape] = rest - share * q, unit * share
        if np.linalg.norm(rest) <= ROUNDED * np.linalg.norm(load):
            return Reduced(self, shares)
        full = len(basis) == MOST_SHAPES
        rest, shares = (load, {}) if full else (rest, shares)
        new = self._solve_shape(rest)
        if not full:
            basis.append((rest, new))
        return Reduced(self, {**shares, new: unit})

    def _solve_shape(self, phi: Floats) -> Shape:
        """Compute the shape of a force (n,)."""
        xi = self.solve_interior(phi)
        tau = self.balance(phi[self.retained] - self._K[self.retained] @ xi, phi)
        return Shape(phi, xi, tau, self.operators.factor.solve(tau))

    def balance(self, tau: Floats, phi: Floats) -> Floats:
        """Return tau (m,), corrected to do the work of phi (n,) in K's kernel; rounding counts as zero work."""
        kernel, N = self.system.kernel, self.operators.kernel
        if kernel is None or N is None:
            return tau
        work, size = kernel.modes.T @ phi, np.abs(kernel.modes).T @ np.abs(phi)
        work = np.where(np.abs(work) <= ROUNDED * size, 0.0, work)
        return tau + N @ (np.linalg.solve(kernel.modes[self.retained].T @ N, work) - N.T @ tau)

    def solve_interior(self, phi: Floats) -> Floats:
        """Return the response xi to interior forces (n,) or (n, k) with fixed retained unknowns.

        A full solve moves the retained unknowns by x_c; the forces -S x_c move them back to zero.
        """
        c, inner = self.retained, phi.copy()
        inner[c] = 0.0
        if not inner.any():
            return inner
        xi = self.factor.solve(inner)
        for _ in range(2):
            if np.abs(xi[c]).max(initial=0.0) <= ROUNDED * np.abs(xi).max():
                break
            inner[c] -= self._S @ xi[c]
            xi = self.factor.solve(inner)
        xi[c] = 0.0
        return xi

    def complete(self, xi: Floats, y_c: Floats) -> Floats:
        """Return xi + K^{-1} (0, S y_c), the state (n,) with retained unknowns y_c, or k states (n, k)."""
        pushed, y = np.zeros_like(xi), xi.copy()
        if y_c.any() and len(y_c) < len(xi):
            pushed[self.retained] = self._S @ y_c
            y += self.factor.solve(pushed)
        y[self.retained] = y_c
        return y
