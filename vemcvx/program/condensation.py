"""The unknowns that no norm term and no limit reads, eliminated once (Schur complement).

With interior unknowns i and retained ones c,  S = K_cc - K_ci K_ii^{-1} K_ic. If c comes last in K = L U, then S = L_cc
U_cc: the Schur complement costs no more than the factorisation (one solve a retained unknown would cost six of them).

A force phi is *reduced* to what it does while the retained unknowns are held, and the force that holds them:

    xi = (K_ii^{-1} phi_i, 0),     tau = phi_c - K_ci xi_i = phi_c - (K xi)_c.

A state with the retained displacements y_c under the total force f, and the work of a force phi on it, are then

    y = xi_f + K^{-1} (0, S y_c),     K y = f + (0, S y_c - tau_f),
    y'Ky = f'xi_f + y_c'S y_c,        phi'y = phi'xi_f + tau_phi'y_c:

no energies are subtracted from each other. Any v with (K v)_i = phi_i gives xi = v - K^{-1} (0, S v_c), phi'xi = phi'v
- tau'v_c. With v = x = K^{-1} phi this saves a solve: y'Ky = f'x - x_c'S x_c + y_c'S y_c. But where forces pull at
retained unknowns, or the body bends far when it is let go, all digits can be lost; there, and where solves lose digits,
v is xi. Factors that solve by halves (:class:`vemcvx.linear.Halves`) need no v: phi'xi is the product of first halves.

Where K is definite tau is taken as S x_c, rounded as S is: what no term holds back then moves by x_c, whatever
digits S has lost.

Where K has a kernel (:mod:`vemcvx.program.kernel`), retained unknowns are anchored: K + E is factorised, E the diagonal
of the anchors' stiffness, of which S + E is the Schur complement. E is taken away where S is wanted; K_ii, K_ci, xi and
tau do not know it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, partial

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import NotAccepted
from vemcvx.linear import LinearSolver
from vemcvx.linear.factor import minimum_degree
from vemcvx.program.forces import Reduced, SolvedForce, SolvedForces, combined, spread
from vemcvx.program.kernel import anchors
from vemcvx.program.operators import Operators, shifted
from vemcvx.program.scaling import unit_diagonal
from vemcvx.program.system import System

HELD = 1e-24
"""Retained unknowns are held well enough when the energy of what they still move is this part of the whole."""
HELD_ANCHORED = 1e-30
"""Likewise where K has a kernel: tau is then the force that xi makes there, whose error is K times that motion."""
RELEASED, SHARP = 0.75, 1e-20
"""v is x where x_c'S x_c is at most this part of phi'x, so that taking it off costs two bits, and `lost` no more."""
MOST_ROUNDS = 5
"""Of finding tau: two are usual; slender bodies, which bend far when they are let go, take one more."""


class Condensation:
    """A system seen by its norm terms alone; with ``condense=False`` every unknown counts as retained.

    Attributes
    ----------
    operators : Operators
        S (dense, or K itself) and B on the retained unknowns.
    retained : (m,) array
        Their numbers.
    linear : LinearSolver
        Which linear solver serves; one that cannot eliminate leaves every unknown retained.
    whole : bool
        Whether nothing is eliminated: the operators are K itself.
    regular : (n, n) sparse matrix
        K, with the anchors' stiffness where it has a kernel: what is factorised.
    factor : Factor
        Its factor.
    """

    def __init__(self, system: System, condense: bool = True, linear: LinearSolver | None = None):
        self.system = system
        n, norms = system.n, system.norms
        B, D, block = system.B, system.D, 1 if norms is None else norms.block
        self.linear = system.linear(linear)
        compliance = np.zeros(0) if system.limits is None else system.limits.compliances
        retained = system.retained
        anchor = _anchors(system, retained, self.linear)
        self.regular = system.K if anchor is None else sp.csr_matrix(system.K + sp.diags_array(anchor))
        self.whole = not (condense and self.linear.eliminates)
        if not self.whole:
            order = np.arange(n) if self.linear.orders else self._order()
            self.retained: Ints = retained
            self.factor, S = self.linear.eliminate(self.regular, order, retained)
            B, D = sp.csr_matrix(B[:, retained]), sp.csr_matrix(D[:, retained])
            self.operators = Operators(S, B, block, D=D, compliance=compliance)
        else:
            self.retained = np.arange(n)
            self.factor = self.linear.factorise(self.regular, system.near_kernel)
            self.operators = Operators(self.regular, B, block, self.factor, D=D, compliance=compliance)
        self._S = self.operators.K
        if anchor is not None and system.kernel is not None:
            self.operators = _unanchored(self.operators, anchor[self.retained], system.kernel.modes[self.retained])
        self._inner = np.ones(n, dtype=bool)
        self._inner[self.retained] = False
        self._fields = SolvedForces(n, self._done, unit_diagonal(self.regular.diagonal())[1])

    @cached_property
    def lost(self) -> float:
        """The square of the part of an energy norm that one solve with the factor loses at most, estimated."""
        return self.factor.lost

    @property
    def refinable(self) -> bool:
        """True if steps can be refined against K: rows read unknowns of their own, and no soft limit holds a kernel.

        Forces on a kernel are taken by what sticks or is stopped; soft limits would share them with the anchors.
        """
        operators = self.operators
        yields = operators.kernel is not None and bool(operators.compliance.any())
        return operators.own_columns is not None and not yields

    def _order(self) -> Ints:
        """The order of elimination of the system; if it has none, one computed from K."""
        order = self.system.elimination_order()
        return minimum_degree(self.regular) if order is None else order

    def reduce(self, phi: Floats, remembered: bool = True, rows: Ints | None = None) -> Reduced:
        """The reduced form of a force (n,), or of one on the unknowns `rows` alone.

        If they are remembered, a combination of forces seen before costs no solve.
        """

        def everywhere() -> Floats:
            return phi if rows is None else spread(phi, rows, self.system.n)

        parts = self._fields.parts(phi, rows) if remembered else self._fields.afresh(everywhere())
        # Where nothing is eliminated the force stands for itself, and does not depend on how well is solved.
        tau = [(share, one.retained) for one, share in parts.items()]
        retained = everywhere() if self.whole else combined(tau, np.zeros(len(self.retained)))
        return Reduced(everywhere, parts, parts, retained)

    def less(self, f: Reduced, c: Floats, remembered: bool = True) -> Reduced:
        """The force without B'c, which pulls at retained unknowns alone: exact however large c (k,) is."""
        if not c.any():
            return f
        pulled = np.zeros(len(self._inner))
        pulled[self.retained] = self.operators.rows.force_of(c)
        left = f - self.reduce(pulled, remembered)
        return Reduced(lambda: f.phi - pulled, left.parts, f.within, f.retained - pulled[self.retained])

    def recover(self, y_c: Floats, f: Reduced) -> Floats:
        """All unknowns (n,) from the retained ones, K y = f + [0; rho]."""
        y, v_c = f.inner
        if (halves := self.factor.halves) is not None:
            return halves.completed(y, y_c)
        rest = y_c - v_c
        if self._inner.any() and rest.any():
            y += self._with_retained(self.response(rest), rest)
        y[self.retained] = y_c
        return y

    def response(self, y_c: Floats) -> Floats:
        """K^{-1} (0, S y_c) (n,), whose retained unknowns are y_c but for what S and the solver lose."""
        pushed = np.zeros(len(self._inner))
        if (halves := self.factor.halves) is not None:
            return halves.completed(pushed, y_c)
        pushed[self.retained] = self._S @ y_c
        return self.factor.solve(pushed)

    def refine_interior(self, y: Floats, r: Floats) -> Floats:
        """y (n,) after one round of iterative refinement inside, for the residual r; retained unknowns stay."""
        better = y + self.inside(np.where(self._inner, r, 0.0))
        better[self.retained] = y[self.retained]
        return better

    def square(self, y_c: Floats, f: Reduced) -> float:
        """y'Ky."""
        return f.work_inside(f) + float(y_c @ (self.operators.K @ y_c))

    def work(self, phi: Reduced, y_c: Floats, f: Reduced) -> float:
        """phi'y, the work of the force phi on the state (y_c, f)."""
        return phi.work_inside(f) + float(phi.retained @ y_c)

    def _done(self, phi: Floats, number: int | None) -> SolvedForce:
        """The response to a force phi (n,); RELEASED and SHARP tell when one solve is enough without halves.

        Forces that are not remembered are others in a run that is gone on with, and digits must be the same there: only
        those that are may be solved for beside the samples.
        """
        c, N, still = self.retained, self.operators.kernel, np.zeros(len(self.retained))
        if (halves := self.factor.halves) is not None:
            z, tau = halves.halved(phi) if number is None else halves.halved_beside_samples(phi)
            x_c = self.operators.factor.solve(tau)
            tau = self._S @ x_c if N is None else self._with_kernel(tau, phi, N)
            solved = partial(SolvedForce, phi, released=x_c, number=number, respond=partial(halves.completed, z, x_c))
            return solved(z, still, retained=tau, product=halves.product)
        x = self.factor.solve(phi) if number is None else self.factor.solve_beside_samples(phi)
        x_c, tau = x[c], self._S @ x[c]
        solved = partial(SolvedForce, phi, released=x_c, number=number, respond=lambda: x)
        if N is None and float(tau @ x_c) <= RELEASED * float(phi @ x) and self.lost <= SHARP:
            return solved(x, x_c, retained=tau)
        xi = self.inside(phi, x)
        if N is not None:
            tau = self._with_kernel(phi[c] - self.system.K[c] @ xi, phi, N)
        return solved(xi, still, retained=tau)

    def _with_kernel(self, tau: Floats, phi: Floats, N: Floats) -> Floats:
        """tau (m,) with the force on K's kernel N (m, k) that phi (n,) has, whatever digits were lost."""
        corrected: Floats = tau + N @ (self._motions.T @ phi - N.T @ tau)
        return corrected

    @cached_property
    def _motions(self) -> Floats:
        """(n, k) the kernel of K; on the retained unknowns it is that of the condensed stiffness."""
        modes = np.zeros((self.system.n, 0)) if self.system.kernel is None else self.system.kernel.modes
        return modes @ np.linalg.inv(np.linalg.qr(modes[self.retained])[1])

    def inside(self, phi: Floats, x: Floats | None = None) -> Floats:
        """xi (n,) of a force phi (n,), whose response is x."""
        c = self.retained
        if len(c) > 0 and not phi[self._inner].any():
            return np.zeros_like(phi)
        if (halves := self.factor.halves) is not None:
            return halves.completed(halves.halved(phi)[0], np.zeros(len(c)))
        x = self.factor.solve(phi) if x is None else x
        if len(c) == 0:
            return x
        tau, size = self._S @ x[c], np.inf
        enough = HELD if self.operators.kernel is None else HELD_ANCHORED
        for _ in range(MOST_ROUNDS):
            held = phi.copy()
            held[c] -= tau
            xi = self.factor.solve(held)
            # By so much tau was not exact yet.
            pushed = self._S @ xi[c]
            size, before = float(abs(pushed @ xi[c])), size
            if size <= enough * float(abs(phi @ xi)) or size > 0.25 * before:
                break
            tau = tau + pushed
        return self._with_retained(xi, np.zeros(len(c)))

    def _with_retained(self, y: Floats, y_c: Floats) -> Floats:
        """y (n,) with the retained unknowns y_c, which it has but for rounding.

        Of that the anchors, soft as they are, leave most in rigid motions; these go everywhere lest they become strain.
        """
        if self.operators.kernel is not None:
            y = y + self._motions @ (self.operators.kernel.T @ (y_c - y[self.retained]))
        y[self.retained] = y_c
        return y


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


def _unanchored(operators: Operators, anchor: Floats, modes: Floats) -> Operators:
    """The operators of K itself, from those of K with the anchors' stiffness."""
    kernel = np.linalg.qr(modes)[0]
    K = shifted(operators.K, -anchor)
    return replace(operators, K=K, given_factor=operators.factor, kernel=kernel, anchor=anchor)
