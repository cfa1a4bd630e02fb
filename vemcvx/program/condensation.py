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

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import EPS, Floats, Ints, columns, power_of_two, spread
from vemcvx.base.errors import NotAccepted
from vemcvx.linear import LinearSolver, minimum_degree
from vemcvx.program.kernel import anchors
from vemcvx.program.operators import Operators
from vemcvx.program.system import System

SAME_SHAPE = 8 * EPS
"""Part of a load that the known shapes may leave of it: rounding, which is dropped."""
MOST_SHAPES = 6
"""Beyond this many, a load that keeps changing its shape is solved for afresh, step by step."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A force of size one with its response: xi (n,), tau (m,), and K^{-1} tau on the retained unknowns (m,)."""

    phi: Floats
    xi: Floats
    tau: Floats
    released: Floats
    remembered: bool
    _products: dict[Shape, float] = field(default_factory=dict, repr=False)

    def inside(self, other: Shape) -> float:
        """phi'xi, the work on the displacement xi of another shape."""
        if other in self._products:
            return self._products[other]
        found = float(self.phi @ other.xi)
        if self.remembered and other.remembered:
            self._products[other] = found
        return found


@dataclass(frozen=True, eq=False)
class Reduced:
    """A force as a combination of shapes, with the shares of these; tau (m,) stands for it on the retained unknowns."""

    condensation: Condensation
    shares: dict[Shape, float]

    @cached_property
    def retained(self) -> Floats:
        """Tau (m,); where nothing is eliminated the force itself."""
        condensation = self.condensation
        return self.phi if condensation.whole else self._sum("tau", len(condensation.retained))

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
        released = self._sum("released", len(self.condensation.retained))
        return self.condensation.completed(self.xi, released)

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
        """phi'xi, the work on the displacement xi of another force."""
        pairs = ((one, a, two, b) for one, a in self.shares.items() for two, b in other.shares.items())
        # Each share carries the unit of its force: the product of two may be no number where that of all three is.
        return float(sum(a * (b * one.inside(two)) for one, a, two, b in pairs))

    def same(self, other: Reduced) -> bool:
        """Return True if the forces are equal; tau, at hand, tells most of them apart before phi is formed."""
        return np.array_equal(self.retained, other.retained) and np.array_equal(self.phi, other.phi)

    def __add__(self, other: Reduced) -> Reduced:
        return self._and(other, 1.0)

    def __sub__(self, other: Reduced) -> Reduced:
        return self._and(other, -1.0)

    def _and(self, other: Reduced, sign: float) -> Reduced:
        one, two = self.shares, other.shares
        shares = {shape: one.get(shape, 0.0) + sign * two.get(shape, 0.0) for shape in {**one, **two}}
        return Reduced(self.condensation, shares)

    def _sum(self, name: str, count: int) -> Floats:
        """The sum of shares of arrays (count,)."""
        total = np.zeros(count)
        with np.errstate(over="ignore", invalid="ignore"):
            for shape, share in self.shares.items():
                total += share * getattr(shape, name)
        return total


class Condensation:
    """A system seen by its rows alone.

    The operators are S, dense, and rows on the `retained` (m,) unknowns, or those of the `whole` system, where all are
    retained: with ``condense=False``, and where the linear solver cannot eliminate. What is factorised is `regular`
    (n, n): K, with the anchors' stiffness where it has a kernel.
    """

    def __init__(self, system: System, condense: bool = True, linear: LinearSolver | None = None):
        self.system = system
        self.linear = system.linear(linear)
        n, retained, B, D = system.n, system.retained, system.B, system.D
        compliance = np.zeros(0) if system.limits is None else system.limits.compliances
        anchor = _anchors(system, retained, self.linear)
        self.regular = system.K if anchor is None else sp.csr_matrix(system.K + sp.diags_array(anchor))
        self.whole = not (condense and self.linear.eliminates)
        if self.whole:
            retained = np.arange(n)
            self.factor = self.linear.factorise(self.regular, system.near_kernel)
            operators = Operators(self.regular, B, system.block, self.factor, D=D, compliance=compliance)
        else:
            order = np.arange(n) if self.linear.orders else system.elimination_order()
            self.factor, S = self.linear.eliminate(
                self.regular, minimum_degree(self.regular) if order is None else order, retained
            )
            rows = (sp.csr_matrix(A[:, retained]) for A in (B, D))
            operators = Operators(S, next(rows), system.block, D=next(rows), compliance=compliance)
        self.retained: Ints = retained
        self._S = operators.K
        self._motions = np.zeros((n, 0))
        if anchor is not None and system.kernel is not None:
            # K with the anchors' stiffness is factorised; the operators are those of K itself.
            own, (kernel, T) = anchor[retained], np.linalg.qr(system.kernel.modes[retained])
            floating = operators.plus(sp.diags_array(-own))
            operators = replace(operators, K=floating, given_factor=operators.factor, kernel=kernel, anchor=own)
            self._motions = system.kernel.modes @ np.linalg.inv(T)
        self.operators = operators
        self._loaded: Ints = np.zeros(0, dtype=np.int64)
        self._basis = list[tuple[Floats, Shape]]()

    def reduce(self, phi: Floats, remembered: bool = True, rows: Ints | None = None) -> Reduced:
        """The reduced form of a force (n,), or of one on the unknowns `rows` alone.

        If they are remembered, a combination of forces seen before costs no solve.
        """
        if not remembered:
            return self._alone(phi if rows is None else spread(phi, rows, self.system.n))
        entries = self._on_loaded(phi, rows)
        unit = float(power_of_two(float(np.abs(entries).max(initial=0.0))))
        rest, shares = entries / unit, dict[Shape, float]()
        size = np.linalg.norm(rest)
        if size == 0.0:
            return Reduced(self, shares)
        for q, shape in self._basis:
            share = float(q @ rest) / float(q @ q)  # One, exactly, of a load that is the shape itself.
            rest = rest - share * q
            shares[shape] = unit * share
        left = float(np.linalg.norm(rest))
        if left <= SAME_SHAPE * size:
            return Reduced(self, shares)
        if len(self._basis) == MOST_SHAPES:
            return self._alone(spread(entries, self._loaded, self.system.n))
        new = self._solved(spread(rest, self._loaded, self.system.n), True)
        self._basis.append((rest, new))
        return Reduced(self, {**shares, new: unit})

    def completed(self, xi: Floats, y_c: Floats) -> Floats:
        """xi + K^{-1} (0, S y_c), whose retained unknowns are y_c; (n,), or (n, k) of k states."""
        if not y_c.any() or len(y_c) == len(xi):
            y = xi.copy()
        else:
            pushed = np.zeros_like(xi)
            pushed[self.retained] = self._S @ y_c
            y = xi + self.factor.solve(pushed)
        y[self.retained] = y_c
        return y

    def held(self, phi: Floats) -> Floats:
        """The response xi to forces (n,), or (n, k), inside, while the retained unknowns are held.

        Forces on these pull them back to zero: S x_c where they are x_c, and once more for what the solves have lost.
        """
        c, inner = self.retained, phi.copy()
        inner[c] = 0.0
        if not inner.any():
            return inner
        xi = self.factor.solve(inner)
        for _ in range(2):
            if np.abs(xi[c]).max(initial=0.0) <= SAME_SHAPE * np.abs(xi).max():
                break
            inner[c] -= self._S @ xi[c]
            xi = self.factor.solve(inner)
        xi[c] = 0.0
        return xi

    def recover(self, y_c: Sequence[Floats], forces: Sequence[Reduced]) -> Floats:
        """All unknowns (n, k) of states from the retained ones, K y = f + (0, rho)."""
        xi = columns([force.xi for force in forces], len(forces))
        return self.completed(xi, columns(y_c, len(forces)))

    def _alone(self, phi: Floats) -> Reduced:
        """The force solved for by itself, whatever shapes are known, and not remembered."""
        unit = float(power_of_two(np.abs(phi).max(initial=0.0)))
        return Reduced(self, {self._solved(phi / unit, False): unit})

    def _solved(self, phi: Floats, remembered: bool) -> Shape:
        """The response to a force (n,)."""
        c, xi = self.retained, self.held(phi)
        tau = phi[c] - self.regular[c] @ xi
        if (N := self.operators.kernel) is not None:  # It does the work there that phi does.
            tau = tau + N @ (self._motions.T @ phi - N.T @ tau)
        return Shape(phi, xi, tau, self.operators.factor.solve(tau), remembered)

    def _on_loaded(self, phi: Floats, rows: Ints | None) -> Floats:
        """A force on the unknowns that any force has loaded; those that it is the first to load join them."""
        if rows is None:
            rows = np.flatnonzero(phi)
            phi = phi[rows]
        if len(new := np.setdiff1d(rows, self._loaded, assume_unique=True)):
            before, self._loaded = self._loaded, np.union1d(self._loaded, new)
            at = np.searchsorted(self._loaded, before)
            self._basis = [(spread(q, at, len(self._loaded)), shape) for q, shape in self._basis]
        return spread(phi, np.searchsorted(self._loaded, rows), len(self._loaded))


def _anchors(system: System, retained: Ints, linear: LinearSolver) -> Floats | None:
    """(n,) the anchors' stiffness, if K has a kernel."""
    if system.kernel is None:
        return None
    if not linear.eliminates:
        raise NotAccepted(
            f"linear solver {type(linear).__name__}: the stiffness has a kernel (only friction holds the body), which "
            "it does not take; SuperLU() does."
        )
    stiffness = np.zeros(system.n)
    stiffness[retained] = anchors(system.kernel.modes[retained], system.K.diagonal()[retained])
    return stiffness
