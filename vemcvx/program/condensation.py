"""Static condensation, once for all steps: a system seen by its norm terms and limits alone.

With interior unknowns i and retained ones c, those that rows read,  S = K_cc - K_ci K_ii^{-1} K_ic. If c comes last in
K = L U, then S = L_cc U_cc: the Schur complement costs no more than the factorisation.

A force phi is *reduced* to what it does while the retained unknowns are held, and the force that holds them:

    xi = (K_ii^{-1} phi_i, 0),     tau = phi_c - K_ci xi_i.

A state with the retained displacements y_c under the total force f, and the work of a force phi on it, are then

    y = xi_f + K^{-1} (0, S y_c),     K y = f + (0, S y_c - tau_f),
    y'Ky = f'xi_f + y_c'S y_c,        phi'y = phi'xi_f + tau_phi'y_c:

so that no energies are subtracted from each other.

Where K has a kernel (:mod:`vemcvx.program.kernel`), retained unknowns are anchored: K + E is factorised, E the diagonal
of the anchors' stiffness, and its Schur complement is S + E. K_ii, K_ci, xi and tau do not depend on E.

The loads of a run are combinations of few shapes. Each shape is solved for once, and energies of combinations are sums
over products of shapes: a step works with as many numbers as there are shapes, and forms vectors of all unknowns only
when they are asked for.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Floats, Ints, power_of_two, read_only, spread
from vemcvx.base.errors import NotAccepted
from vemcvx.linear import Factor, LinearSolver, Matrix, order_by_minimum_degree
from vemcvx.program.certificate import ROUNDED
from vemcvx.program.kernel import anchors
from vemcvx.program.operators import DenseInverse, Operators
from vemcvx.program.system import System

MOST_SHAPES = 6
"""Beyond this many, a load that keeps changing its shape is solved for afresh, step by step."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A force of size one with its response: xi (n,), tau (m,), and K^{-1} tau on the retained unknowns (m,)."""

    phi: Floats
    xi: Floats
    tau: Floats
    released: Floats
    _works: WeakKeyDictionary[Shape, float] = field(default_factory=WeakKeyDictionary, repr=False)

    def work_inside(self, other: Shape) -> float:
        """Return phi'xi, the work on the displacement xi of another shape."""
        work = self._works.get(other)
        if work is None:
            self._works[other] = work = float(self.phi @ other.xi)
        return work


@dataclass(frozen=True, eq=False)
class Reduced:
    """A force as a combination of shapes, with the shares of these; tau (m,) stands for it on the retained unknowns."""

    condensation: Condensation
    shares: dict[Shape, float]

    @cached_property
    def retained(self) -> Floats:
        """Tau (m,)."""
        return self._sum("tau", len(self.condensation.retained))

    @cached_property
    def phi(self) -> Floats:
        """The force (n,)."""
        return self._sum("phi", self.condensation.system.n)

    @property
    def xi(self) -> Floats:
        """The response (n,) while the retained unknowns are held."""
        return self._sum("xi", self.condensation.system.n)

    @cached_property
    def x(self) -> Floats:
        """The response K^{-1} phi (n,)."""
        return self.condensation.completed(self.xi, self._sum("released", len(self.condensation.retained)))

    @cached_property
    def norm(self) -> float:
        """(phi'K^{-1}phi)^{1/2}, the energy norm of the response."""
        largest = max(map(abs, self.shares.values()), default=0.0)
        if not 0 < largest < np.inf:
            return largest
        unit = Reduced(self.condensation, {shape: share / largest for shape, share in self.shares.items()})
        released = unit._sum("released", len(self.condensation.retained))
        return largest * float(np.sqrt(abs(unit.work_inside(unit) + float(unit.retained @ released))))

    def work_inside(self, other: Reduced) -> float:
        """Return phi'xi, the work on the displacement xi of another force."""
        pairs = ((one, a, two, b) for one, a in self.shares.items() for two, b in other.shares.items())
        # Each share carries the unit of its force: the product of two may be no number where that of all three is.
        return float(sum(a * (b * one.work_inside(two)) for one, a, two, b in pairs))

    def __add__(self, other: Reduced) -> Reduced:
        total = dict(self.shares)
        for shape, share in other.shares.items():
            total[shape] = total.get(shape, 0.0) + share
        return Reduced(self.condensation, total)

    def __sub__(self, other: Reduced) -> Reduced:
        return self + Reduced(self.condensation, {shape: -share for shape, share in other.shares.items()})

    def _sum(self, name: str, count: int) -> Floats:
        """Return the sum of shares of arrays (count,)."""
        total = np.zeros(count)
        with np.errstate(over="ignore", invalid="ignore"):
            for shape, share in self.shares.items():
                total += share * getattr(shape, name)
        return total


class Condensation:
    """A system seen by its rows alone.

    The operators are S, dense, and rows on the `retained` (m,) unknowns, or the `full` ones, of all unknowns, if the
    system is kept `whole`: with ``condense=False``, and where the linear solver cannot eliminate. `factor` is of K with
    the anchors' stiffness.
    """

    def __init__(self, system: System, condense: bool = True, linear: LinearSolver | None = None):
        self.system, self.linear = system, system.linear(linear)
        self.whole = not (condense and self.linear.eliminates)
        n, c, anchor = system.n, system.retained, None
        if system.kernel is not None:
            if not self.linear.eliminates:
                raise NotAccepted(
                    f"linear solver {type(self.linear).__name__}: the stiffness has a kernel (only friction holds the "
                    "body), which it does not take; SuperLU() does."
                )
            anchor = spread(anchors(system.kernel.modes[c], system.K.diagonal()[c]), c, n)
        self._K = system.K if anchor is None else sp.csr_matrix(system.K + sp.diags_array(anchor))
        self._bases: dict[int, list[tuple[Floats, Shape]]] = {}
        if self.whole:
            self.factor: Factor = self.linear.factorise(self._K, system.near_kernel)
            self.retained, self._S = np.arange(n), self._K
            self.operators = self.full = self._on(self.retained, system.K, self.factor, anchor)
            return
        order = np.arange(n) if self.linear.orders else system.elimination_order()
        order = order_by_minimum_degree(self._K) if order is None else order
        self.factor, S = self.linear.eliminate(self._K, order, c)
        self.retained, self._S = c, read_only(S)
        self.full = self._on(np.arange(n), system.K, self.factor, anchor)
        self.operators = self._on(
            c, S if anchor is None else read_only(S - np.diag(anchor[c])), DenseInverse(S), anchor
        )

    def _on(self, c: Ints, K: Matrix, factor: Factor, anchor: Floats | None) -> Operators:
        """Return the operators on the unknowns `c`."""
        system, kernel, limits = self.system, self.system.kernel, self.system.limits
        return Operators(
            K,
            system.B[:, c],
            system.block,
            given_factor=factor,
            kernel=None if kernel is None else np.linalg.qr(kernel.modes[c])[0],
            anchor=None if anchor is None else anchor[c],
            D=system.D[:, c],
            compliance=None if limits is None else limits.compliance,
        )

    def reduce(self, phi: Floats, rows: Ints | None = None) -> Reduced:
        """Return the reduced form of a force (n,), or of one on the unknowns `rows` alone.

        A combination of forces on the same rows seen before costs no solve.
        """
        unit = float(power_of_two(float(np.abs(phi).max(initial=0.0))))
        rest = load = phi / unit
        basis, shares = self._bases.setdefault(id(rows), []), dict[Shape, float]()
        for q, shape in basis:
            share = float(q @ rest) / float(q @ q)  # One, exactly, of a load that is the shape itself.
            rest, shares[shape] = rest - share * q, unit * share
        if np.linalg.norm(rest) <= ROUNDED * np.linalg.norm(load):
            return Reduced(self, shares)
        full = len(basis) == MOST_SHAPES
        rest, shares = (load, {}) if full else (rest, shares)
        new = self._solved(rest if rows is None else spread(rest, rows, self.system.n))
        if not full:
            basis.append((rest, new))
        return Reduced(self, {**shares, new: unit})

    def _solved(self, phi: Floats) -> Shape:
        """Return the response to a force (n,)."""
        c, xi, kernel, N = self.retained, self.held(phi), self.system.kernel, self.operators.kernel
        tau = phi[c] - self._K[c] @ xi
        if kernel is not None and N is not None:  # It does the work there that phi does.
            tau = tau + N @ (np.linalg.solve(kernel.modes[c].T @ N, kernel.modes.T @ phi) - N.T @ tau)
        return Shape(phi, xi, tau, self.operators.factor.solve(tau))

    def held(self, phi: Floats) -> Floats:
        """Return the response xi to forces (n,), or (n, k), inside, while the retained unknowns are held.

        Forces on these pull them back to zero: S x_c where they are x_c, and once more for what the solves have lost.
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

    def completed(self, xi: Floats, y_c: Floats) -> Floats:
        """Return xi + K^{-1} (0, S y_c), whose retained unknowns are y_c; (n,), or (n, k) of k states."""
        pushed, y = np.zeros_like(xi), xi.copy()
        if y_c.any() and len(y_c) < len(xi):
            pushed[self.retained] = self._S @ y_c
            y += self.factor.solve(pushed)
        y[self.retained] = y_c
        return y
