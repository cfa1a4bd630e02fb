"""The unknowns that no norm term and no limit touches, eliminated once (Schur complement).

With interior unknowns i and touched ones c,  S = K_cc - K_ci K_ii^{-1} K_ic  and a force phi acts on c as
phi_c - K_ci K_ii^{-1} phi_i = S (K^{-1} phi)_c. If c comes last in K = L U, then S = L_cc U_cc: the Schur
complement costs no more than the factorisation (one solve a touched unknown would cost six of them).

Given the total force f and the touched displacements y_c, with x = K^{-1} f and rho = S (y_c - x_c),

    K y = f + [0; rho],    y'Ky = f'x - x_c'S x_c + y_c'S y_c,    phi'y = phi'x + (K^{-1} phi)_c . rho

Where K has a kernel (:mod:`vemcvx.program.kernel`), touched unknowns are anchored: all of this is done with K + E, E
the diagonal of the anchors' stiffness, of which S + E is the Schur complement, and E is taken away where S is wanted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from vemcvx.errors import NotAccepted
from vemcvx.linear import LinearSolver, SuperLU, choose_linear
from vemcvx.program.form import Form
from vemcvx.program.kernel import anchors
from vemcvx.program.ordering import minimum_degree
from vemcvx.program.scaling import power_of_two
from vemcvx.program.system import System

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# A load is taken for a combination of fields already solved for when what is left of it is rounding.
SAME_FIELD = 8 * float(np.finfo(float).eps)
MOST_FIELDS = 6
"""Beyond this many, a load that keeps changing its shape is solved for afresh, step by step."""


@dataclass(frozen=True)
class Reduced:
    """A force phi (n,), its response x = K^{-1} phi (n,), and what it does to the touched unknowns (m,)."""

    phi: Floats
    x: Floats
    touched: Floats

    def __add__(self, other: Reduced) -> Reduced:
        return Reduced(self.phi + other.phi, self.x + other.x, self.touched + other.touched)

    def __sub__(self, other: Reduced) -> Reduced:
        return Reduced(self.phi - other.phi, self.x - other.x, self.touched - other.touched)


class Condensation:
    """A system seen by its norm terms alone; with ``condense=False`` every unknown counts as touched.

    Attributes
    ----------
    form : Form
        S (dense, or K itself) and B on the touched unknowns.
    touched : (m,) array
        Their numbers.
    linear : LinearSolver
        Which linear solver serves; one that cannot eliminate leaves every unknown touched.
    whole : bool
        Whether nothing is eliminated: the form is K itself.
    regular : (n, n) sparse matrix
        K, with the anchors' stiffness where it has a kernel: what is factorised.
    """

    def __init__(self, system: System, condense: bool = True, linear: LinearSolver | None = None):
        self.system = system
        n, norms = system.n, system.norms
        B = sp.csr_matrix((0, n)) if norms is None else norms.B
        block = 1 if norms is None else norms.block
        self.linear = choose_linear(n, linear)
        limits = system.limits
        D, softness = (sp.csr_matrix((0, n)), np.zeros(0)) if limits is None else (limits.D, limits.softness)
        touched = np.unique(np.concatenate([A.indices[A.data != 0] for A in (B, D)])).astype(np.int64)
        anchor = _anchors(system, touched, self.linear)
        self.regular = system.K if anchor is None else sp.csr_matrix(system.K + sp.diags_array(anchor))
        self.whole = not (condense and isinstance(self.linear, SuperLU))
        if not self.whole:
            order = minimum_degree(self.regular) if system.order is None else system.order
            self.touched: Ints = touched
            self._factor, S = self.linear.eliminate(self.regular, order, touched)
            rows = {"D": sp.csr_matrix(D[:, touched]), "softness": softness}
            self.form = Form(S, sp.csr_matrix(B[:, touched]), block, **rows)
        else:
            self.touched = np.arange(n)
            self._factor = self.linear.factorise(self.regular, system.near_kernel)
            self.form = Form(self.regular, B, block, self._factor, D=D, softness=softness)
        self._S = self.form.K
        if anchor is not None:
            self.form = _unanchored(self.form, anchor[self.touched], system.kernel.modes[self.touched])
        self._fields = _Fields(n)

    def reduce(self, phi: Floats, remembered: bool = True) -> Reduced:
        """The response to a force; if they are remembered, a combination of forces seen before costs no solve.

        Where nothing is eliminated the force stands for itself, and does not depend on how well is solved.
        """
        # Squares of forces, of any unit, are numbers when the largest is of size one.
        unit = power_of_two(np.abs(phi).max(initial=0.0))
        x = self._respond(phi / unit) if remembered else self._factor.solve(phi / unit)
        with np.errstate(over="ignore", invalid="ignore"):
            return Reduced(phi, unit * x, phi if self.whole else unit * (self._S @ x[self.touched]))

    def solve(self, phi: Floats) -> Floats:
        """K^{-1} phi, (n,)."""
        return self._factor.solve(phi)

    def energy(self, phi: Floats) -> float:
        """phi'K^{-1}phi, or a bound on it from above."""
        return self._factor.energy(phi)

    def recover(self, y_c: Floats, f: Reduced) -> Floats:
        """All unknowns (n,) from the touched ones, K y = f + [0; rho]."""
        if self.whole:
            return y_c.copy()
        if len(self.touched) == 0:
            return f.x.copy()
        total = f.phi.copy()
        total[self.touched] += self._S @ (y_c - f.x[self.touched])
        y = self._factor.solve(total)
        # The touched unknowns are known; what the solve returns for them differs by its rounding. Of that the anchors,
        # soft as they are, leave most in rigid motions, which have to go everywhere lest they become strain.
        if self.system.kernel is not None:
            N = self.system.kernel.modes
            y += N @ np.linalg.lstsq(N[self.touched], y_c - y[self.touched], rcond=None)[0]
        y[self.touched] = y_c
        return y

    def mend(self, y: Floats, r: Floats) -> Floats:
        """y (n,) after one round of iterative refinement inside, for the residual r; touched unknowns stay."""
        inside = r.copy()
        inside[self.touched] -= self._S @ self._factor.solve(r)[self.touched]
        better = y + self._factor.solve(inside)
        better[self.touched] = y[self.touched]
        return better

    def square(self, y_c: Floats, f: Reduced) -> float:
        """y'Ky."""
        if self.whole:
            return float(y_c @ (self.form.K @ y_c))
        inside = float(f.phi @ f.x)
        rest = inside - float(f.x[self.touched] @ f.touched)
        # Where (almost) nothing is inside, the difference is rounding, and its root would be 1e-8.
        rest = 0.0 if abs(rest) <= SAME_FIELD * abs(inside) else rest
        return rest + float(y_c @ (self.form.K @ y_c))

    def work(self, phi: Reduced, y_c: Floats, f: Reduced) -> float:
        """phi'y, the work of the force phi on the state (y_c, f)."""
        if self.whole:
            return float(phi.phi @ y_c)
        rho = self._S @ y_c - f.touched
        return float(phi.phi @ f.x + phi.x[self.touched] @ rho)

    def _respond(self, phi: Floats) -> Floats:
        fields = self._fields
        rest = fields.compress(phi)
        size = float(rest @ rest)
        if size == 0.0:
            return np.zeros_like(phi)
        x = np.zeros_like(phi)
        for q, square, response in fields.basis:
            share = float(q @ rest) / square
            rest = rest - share * q
            x += share * response
        left = float(rest @ rest)
        if left <= SAME_FIELD * SAME_FIELD * size:
            return x
        if len(fields.basis) == MOST_FIELDS:
            return self._factor.solve(phi)
        fields.basis.append((rest, left, self._factor.solve(fields.expand(rest))))
        return x + fields.basis[-1][2]


def _anchors(system: System, touched: Ints, linear: LinearSolver) -> Floats | None:
    """(n,) the anchors' stiffness, if K has a kernel."""
    if system.kernel is None:
        return None
    if not linear.eliminates:
        raise NotAccepted(
            f"linear solver {type(linear).__name__}: the stiffness has a kernel (only friction holds the body), which "
            "it does not take; SuperLU() does."
        )
    stiffness = np.zeros(system.n)
    stiffness[touched] = anchors(system.kernel.modes[touched], system.K.diagonal()[touched])
    return stiffness


def _unanchored(form: Form, anchor: Floats, modes: Floats) -> Form:
    """The form of K itself, from that of K with the anchors' stiffness."""
    added = sp.diags_array(anchor)
    K = sp.csr_matrix(form.K - added) if sp.issparse(form.K) else form.K - np.diag(anchor)
    kernel = np.linalg.qr(modes)[0]
    return Form(K, form.B, form.block, form.factor, kernel, anchor, form.D, form.softness)


class _Fields:
    """Forces seen so far, on the unknowns that any of them loads, with what they cause everywhere."""

    def __init__(self, n: int):
        self._n = n
        self._loaded = np.zeros(0, dtype=np.int64)
        self.basis: list[tuple[Floats, float, Floats]] = []

    def compress(self, phi: Floats) -> Floats:
        """The entries of `phi` that may differ from zero; loads on a boundary touch few of all."""
        if np.count_nonzero(phi) != np.count_nonzero(phi[self._loaded]):
            loaded = np.union1d(self._loaded, np.flatnonzero(phi))
            self.basis = [(self.expand(q)[loaded], square, x) for q, square, x in self.basis]
            self._loaded = loaded
        return phi[self._loaded]

    def expand(self, compressed: Floats) -> Floats:
        """The force (n,) with these entries."""
        phi = np.zeros(self._n)
        phi[self._loaded] = compressed
        return phi
