"""Static condensation, once for all steps, and refinement of a step against K where that has lost digits.

Unknowns that no norm term and no limit reads are eliminated once, and forces are reduced.

With interior unknowns i and retained ones c,  S = K_cc - K_ci K_ii^{-1} K_ic. If c comes last in K = L U, then S = L_cc
U_cc: the Schur complement costs no more than the factorisation (one solve a retained unknown would cost six of them).

A force phi is *reduced* to what it does while the retained unknowns are held, and the force that holds them:

    xi = (K_ii^{-1} phi_i, 0),     tau = phi_c - K_ci xi_i.

A state with the retained displacements y_c under the total force f, and the work of a force phi on it, are then

    y = xi_f + K^{-1} (0, S y_c),     K y = f + (0, S y_c - tau_f),
    y'Ky = f'xi_f + y_c'S y_c,        phi'y = phi'xi_f + tau_phi'y_c:

so that no energies are subtracted from each other. The two halves of a solve, forward and backward substitution
(:class:`vemcvx.linear.Halves`), give all of these; :class:`Held` makes them from a factor that solves for all unknowns
only.

Where K has a kernel (:mod:`vemcvx.program.kernel`), retained unknowns are anchored: K + E is factorised, E the diagonal
of the anchors' stiffness, and its Schur complement is S + E. S is that less E; K_ii, K_ci, xi and tau do not depend on
E.

The loads of a run are combinations of few shapes. Each shape is solved for once, and energies of combinations are sums
over products of shapes: a step works with as many numbers as there are shapes, and forms vectors of all unknowns only
when they are asked for. A load is orthogonalised against the shapes known so far, on the unknowns that any force has
loaded; a remainder at the rounding of the load is dropped, a larger one becomes a new shape.

Where the factors of K have lost too many digits, a step is refined iteratively against the original K. Near
incompressibility or at high contrast the Schur complement S carries the rounding of the factorisation, cond(K) times a
unit: 1e-7 in energy at nu = .49999999. The residual of the full system, taken in extended precision, then drives
corrections with the same factors: what sticks stays, what slips moves by S_FF^{-1} r_F, the multipliers of what sticks
and the unknowns inside follow. A soft limit acts where z = D y - e > 0, and with

    r = f - B'lam - D'p - K y,    q = z_+ / c - p of soft limits,    C^{-1} of those that act,

the correction solves K dy = r - D'dp, dp = q + C^{-1} D dy, so that on the retained unknowns that are free

    (S + D'C^{-1}D) dy_c = tau_r - D'q,

and c p = z to rounding afterwards (q does not pass through K^{-1}, which weak springs make large).

On x86 a long double has 64 bits of mantissa against 53; where it is no longer than a double, the rounding unit says so
and nothing else changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import EPS, Bools, Floats, Ints, columns, power_of_two, spread
from vemcvx.errors import NotAccepted
from vemcvx.linear import (
    Congruent,
    Elsewhere,
    Factor,
    Halves,
    LinearSolver,
    Matrix,
    minimum_degree,
    residual,
    sizes,
)
from vemcvx.program.certificate import Certificate
from vemcvx.program.kernel import anchors
from vemcvx.program.operators import Operators, restricted, transverse
from vemcvx.program.scaling import scaling, unit_diagonal
from vemcvx.program.system import System
from vemcvx.program.tolerances import UNSEEN

SAME_FIELD = 8 * EPS
"""What the known shapes leave of a load is rounding, and dropped, below this part of the load. A shape that was a small
part of an earlier load carries that load's rounding, which a combination with large shares amplifies: at most 8 times
the load's own rounding is dropped. A load that turns in space left 1.4 times."""
MOST_FIELDS = 6
"""Beyond this many, a load that keeps changing its shape is solved for afresh, step by step."""


@dataclass(frozen=True, eq=False)
class SolvedForce:
    """A force of size one with its response."""

    phi: Floats
    z: Floats
    """(n,) the first half of a solve (:class:`vemcvx.linear.Halves`), which stands for xi"""
    retained: Floats
    """(m,) tau, the force on the retained unknowns that stands for phi"""
    released: Floats
    """(m,) their displacements under it"""
    number: int | None
    """of the shape; None if the force is not remembered as one"""
    respond: Callable[[], Floats]
    """K^{-1} phi (n,)"""
    product: Callable[[Floats, Floats], float]
    """phi'xi of two forces from their first halves"""
    _products: dict[int, tuple[float, float]] = field(default_factory=dict, repr=False)

    @cached_property
    def x(self) -> Floats:
        """K^{-1} phi (n,)."""
        return self.respond()

    def products(self, other: SolvedForce) -> tuple[float, float]:
        """phi'x = phi'xi + tau'x_c and phi'xi, with the responses of another shape."""
        if self.number is not None and other.number in self._products:
            return self._products[other.number]
        inside = self.product(self.z, other.z)
        found = inside + float(self.retained @ other.released), inside
        if self.number is not None and other.number is not None:
            self._products[other.number] = found
        return found


Parts = dict[SolvedForce, float]


class Reduced:
    """A force phi (n,), formed when it is first asked for, as a combination of solved ones.

    The shares of these, `parts`, sum to phi up to rounding; `retained` (m,) is tau, the force on the retained unknowns
    that stands for phi.
    """

    def __init__(self, phi: Callable[[], Floats], parts: Parts, retained: Floats):
        self._phi, self.parts, self.retained = phi, parts, retained

    @cached_property
    def phi(self) -> Floats:
        """The force (n,)."""
        return self._phi()

    @cached_property
    def x(self) -> Floats:
        """The response K^{-1} phi (n,)."""
        return combined([(share, one.x) for one, share in self.parts.items()], self.phi)

    @property
    def inner(self) -> Floats:
        """The first half of a solve (n,), which stands for xi."""
        return combined([(share, one.z) for one, share in self.parts.items()], self.phi)

    @cached_property
    def norm(self) -> float:
        """(phi'K^{-1}phi)^{1/2}, the energy norm of the response."""
        largest = max(map(abs, self.parts.values()), default=0.0)
        if not 0 < largest < np.inf:
            return largest
        if any(one.number is None for one in self.parts):
            # Of parts that are not orthogonal the products may cancel.
            return largest * float(np.sqrt(abs((self.phi / largest) @ (self.x / largest))))
        shares = [(one, share / largest) for one, share in self.parts.items()]
        square = sum(a * b * one.products(two)[0] for one, a in shares for two, b in shares)
        return largest * float(np.sqrt(abs(square)))

    def work_inside(self, other: Reduced) -> float:
        """phi'xi, the work on the displacement xi of another force."""
        pairs = ((one, a, two, b) for one, a in self.parts.items() for two, b in other.parts.items())
        # Each share carries the unit of its force: the product of two may be no number where that of all three is.
        return float(sum(a * (b * one.products(two)[1]) for one, a, two, b in pairs))

    def same(self, other: Reduced) -> bool:
        """Return True if the forces are equal; tau, at hand, tells most of them apart before phi is formed."""
        apart = np.abs(self.retained - other.retained).max(initial=0.0)
        near = apart <= 1e-6 * np.abs(self.retained).max(initial=0.0)
        return bool(near) and np.array_equal(self.phi, other.phi)

    def __add__(self, other: Reduced) -> Reduced:
        return self._and(other, 1.0)

    def __sub__(self, other: Reduced) -> Reduced:
        return self._and(other, -1.0)

    def _and(self, other: Reduced, sign: float) -> Reduced:
        one, two = self.parts, other.parts
        parts = {shape: one.get(shape, 0.0) + sign * two.get(shape, 0.0) for shape in {**one, **two}}
        return Reduced(lambda: self.phi + sign * other.phi, parts, self.retained + sign * other.retained)


def combined(shares: Sequence[tuple[float, Floats]], like: Floats) -> Floats:
    """The sum of shares of arrays; zeros like another if there are none."""
    total = np.zeros_like(like)
    with np.errstate(over="ignore", invalid="ignore"):
        for share, array in shares:
            total += share * array
    return total


class SolvedForces:
    """Shapes of forces seen so far, on the unknowns that any of them loads, each solved for once by `solve`.

    `ease` (n,) is the root of each unknown's flexibility. A remainder of a load is rounding if it is so both as a force
    and in the energy of its response: 1e-15 of a load on a stiff part, acting on a part softer by 1e16, is not.
    """

    def __init__(self, n: int, solve: Callable[[Floats, int | None], SolvedForce], ease: Floats):
        self._n, self._solve, self._ease = n, solve, ease
        self._loaded = np.zeros(0, dtype=np.int64)
        self._place = np.full(n, -1)  # in `_loaded`
        self._basis: list[tuple[Floats, float, tuple[float, float], SolvedForce]] = []

    def parts(self, phi: Floats, rows: Ints | None = None) -> Parts:
        """The shares of solved forces in a force (n,), or in one on some rows.

        A new shape is solved for, and remembered while there is room.
        """
        entries = self._on_loaded(phi, rows)
        # Squares of forces, of any unit, are numbers when the largest is of size one.
        unit = float(power_of_two(float(np.abs(entries).max(initial=0.0))))
        rest = entries / unit
        size, found = self._sizes(rest), Parts()
        known = size
        for q, square, whole, one in self._basis if any(size) else ():
            share = float(q @ rest) / square
            rest = rest - share * q
            known = known[0] + abs(share) * whole[0], known[1] + abs(share) * whole[1]
            found[one] = unit * share
        left = self._sizes(rest)
        if all(left[k] <= SAME_FIELD * min(known[k], 8.0 * size[k]) for k in (0, 1)):
            return found
        if len(self._basis) == MOST_FIELDS:
            return self.afresh(spread(entries, self._loaded, self._n))
        new = self._solve(spread(rest, self._loaded, self._n), len(self._basis))
        self._basis.append((rest, float(rest @ rest), size, new))
        return {**found, new: unit}

    def afresh(self, phi: Floats) -> Parts:
        """The only part of a force (n,) that is solved for by itself, whatever shapes are known, and not remembered."""
        unit = float(power_of_two(np.abs(phi).max(initial=0.0)))
        return {self._solve(phi / unit, None): unit}

    def _sizes(self, entries: Floats) -> tuple[float, float]:
        """The norms of a force with these entries, and of the motions of single unknowns under it."""
        done = self._ease[self._loaded] * entries
        return math.sqrt(entries @ entries), math.sqrt(done @ done)

    def _on_loaded(self, phi: Floats, rows: Ints | None) -> Floats:
        """A force on the unknowns that any force may load; those that it is the first to load join them."""
        if rows is None:
            rows = np.flatnonzero(phi)
            phi = phi[rows]
        place = self._place[rows]
        if (place < 0).any():
            before, self._loaded = self._loaded, np.union1d(self._loaded, rows)
            self._place[self._loaded] = np.arange(len(self._loaded))
            moved, count, place = self._place[before], len(self._loaded), self._place[rows]
            self._basis = [(spread(q, moved, count), a, b, one) for q, a, b, one in self._basis]
        return spread(phi, place, len(self._loaded))


class Held:
    """The halves of a solve, from a factor that solves for all unknowns only; z is xi itself.

    Forces tau pull the retained unknowns back to zero: K^{-1} (phi - (0, tau)) vanishes there for tau = S (K^{-1}
    phi)_c, up to the error of the solves, which further rounds remove. Two rounds are usual; slender bodies, whose
    unheld response is large, take one more. Where K is definite the tau handed out is that of the first round, rounded
    as S is, so that S^{-1} tau is the response of unknowns that no term holds, whatever digits S has lost.

    The factor, S and K have the anchors' stiffness. `motions` (n, k) is the kernel of K, orthonormal on the retained
    unknowns. Anchors are soft, so that rounding there shows mostly as these motions; they are added to all unknowns,
    lest they become strain.
    """

    def __init__(self, factor: Factor, retained: Ints, S: Matrix, K: sp.csr_matrix, motions: Floats):
        self._factor, self._retained, self._S, self._K, self._motions = factor, retained, S, K, motions

    def halved(self, b: Floats) -> tuple[Floats, Floats]:
        """xi and tau of a force (n,)."""
        c, still, size = self._retained, np.zeros(len(self._retained)), np.inf
        inner = b.copy()
        inner[c] = 0.0
        if not inner.any():
            return inner, b[c]
        x = self._factor.solve(inner)
        held, tau = still, b[c] + self._S @ x[c]
        for _ in range(5 if len(c) else 0):
            left = self._S @ x[c]
            size, before = float(abs(left @ x[c])), size
            # On K's kernel tau is read off K xi, and its error is K times the motion that is left.
            if size <= 1e-30 * float(abs(inner @ x)) or size > 0.25 * before:
                break
            held = held - left
            inner[c] = held
            x = self._factor.solve(inner)
        xi = self._with_retained(x, still)
        return xi, b[c] - self._K[c] @ xi if self._motions.shape[1] else tau

    def completed(self, z: Floats, x_c: Floats) -> Floats:
        """xi + K^{-1} (0, S x_c), whose retained unknowns are x_c."""
        pushed = np.zeros_like(z)
        pushed[self._retained] = self._S @ x_c
        moves = x_c.any() and len(x_c) < len(z)
        return self._with_retained(z + self._factor.solve(pushed) if moves else z.copy(), x_c)

    def product(self, z: Floats, other: Floats) -> float:
        """phi'xi from both xi."""
        return float(z @ (self._K @ other)) if z.any() else 0.0

    def _with_retained(self, y: Floats, y_c: Floats) -> Floats:
        """y (n,) with the retained unknowns y_c, which it has but for rounding."""
        y = y + self._motions @ (self._motions[self._retained].T @ (y_c - y[self._retained]))
        y[self._retained] = y_c
        return y


class Condensation:
    """A system seen by its norm terms alone.

    The operators are S, dense, and B on the `retained` (m,) unknowns, or those of the `whole` system, where all are
    retained: with ``condense=False``, and where the linear solver cannot eliminate. What is factorised is `regular`
    (n, n): K, with the anchors' stiffness where it has a kernel.
    """

    def __init__(self, system: System, condense: bool = True, linear: LinearSolver | None = None):
        self.system = system
        n, B, D, block = system.n, system.B, system.D, system.block
        self.linear = system.linear(linear)
        compliance = np.zeros(0) if system.limits is None else system.limits.compliances
        retained = system.retained
        anchor = _anchors(system, retained, self.linear)
        self.regular = system.K if anchor is None else sp.csr_matrix(system.K + sp.diags_array(anchor))
        self.whole = not (condense and self.linear.eliminates)
        if not self.whole:
            order = np.arange(n) if self.linear.orders else system.elimination_order()
            if order is None:
                order = minimum_degree(self.regular)
            self.retained: Ints = retained
            self.factor, S = self.linear.eliminate(self.regular, order, retained)
            B, D = sp.csr_matrix(B[:, retained]), sp.csr_matrix(D[:, retained])
            self.operators = Operators(S, B, block, D=D, compliance=compliance)
        else:
            self.retained = np.arange(n)
            self.factor = self.linear.factorise(self.regular, system.near_kernel)
            K = Congruent.of(self.regular) if isinstance(self.regular, Elsewhere) else self.regular
            self.operators = Operators(K, B, block, self.factor, D=D, compliance=compliance)
        self._S = self.operators.K
        if anchor is not None and system.kernel is not None:
            # K with the anchors' stiffness is factorised; the operators are those of K itself.
            own, kernel = anchor[self.retained], np.linalg.qr(system.kernel.modes[self.retained])[0]
            floating, factor = self.operators.plus(sp.diags_array(-own)), self.operators.factor
            self.operators = replace(self.operators, K=floating, given_factor=factor, kernel=kernel, anchor=own)
        self.scaling = scaling(self.operators)
        if self.operators.given_factor is None:
            self.operators = replace(self.operators, given_factor=self.scaling.factor)
        modes = np.zeros((n, 0)) if system.kernel is None else system.kernel.modes
        self._motions = modes @ np.linalg.inv(np.linalg.qr(modes[self.retained])[1])
        self._halves: Halves = self.factor.halves or Held(
            self.factor, self.retained, self._S, self.regular, self._motions
        )
        self._fields = SolvedForces(n, self._done, unit_diagonal(self.regular.diagonal())[1])

    @property
    def refinable(self) -> bool:
        """True if steps can be refined against K: rows read unknowns of their own, and no soft limit holds a kernel.

        Forces on a kernel are taken by what sticks or is stopped; soft limits would share them with the anchors.
        """
        operators = self.operators
        yields = operators.kernel is not None and bool(operators.compliance.any())
        return operators.own_columns is not None and not yields

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
        return Reduced(everywhere, parts, retained)

    def recover(self, y_c: Floats, f: Reduced) -> Floats:
        """All unknowns (n,) from the retained ones, K y = f + [0; rho]."""
        return self._halves.completed(f.inner, y_c)

    def recover_together(self, y_c: Sequence[Floats], f: Sequence[Reduced], count: int) -> Floats:
        """All unknowns (n, count) of several states, as `recover` has them but for rounding, and zeros after them."""
        return self._halves.completed(columns([one.inner for one in f], count), columns(y_c, count))

    def response(self, y_c: Floats) -> Floats:
        """K^{-1} (0, S y_c) (n,), whose retained unknowns are y_c but for what S and the solver lose."""
        return self._halves.completed(np.zeros(self.system.n), y_c)

    def refine_interior(self, y: Floats, r: Floats) -> Floats:
        """y (n,) after one round of iterative refinement inside, for the residual r; retained unknowns stay."""
        inner = r.copy()
        inner[self.retained] = 0.0
        better = y + self._halves.completed(self._halves.halved(inner)[0], np.zeros(len(self.retained)))
        better[self.retained] = y[self.retained]
        return better

    def _done(self, phi: Floats, number: int | None) -> SolvedForce:
        """The response to a force phi (n,)."""
        z, tau = self._halves.halved(phi)
        x_c = self.operators.factor.solve(tau)
        if (N := self.operators.kernel) is not None:  # It does the work there that phi does, whatever digits were lost.
            tau = tau + N @ (self._motions.T @ phi - N.T @ tau)
        respond = partial(self._halves.completed, z, x_c)
        product = self._halves.product
        return SolvedForce(phi, z, tau, x_c, number=number, respond=respond, product=product)


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


TAIL = 175.75163111741583
"""The quotient of F's distribution with 1 and SAMPLES degrees of freedom that is exceeded once in a million, which
scipy.special.fdtri(1, SAMPLES, 1 - 1e-6) gives: importing that takes a tenth of the time of importing this package."""


def needs_refinement(condensation: Condensation, accuracy: float) -> bool:
    """Return True if one solve with the factors, or with S, errs by more than UNSEEN of `accuracy`.

    Residuals in double precision are good enough to tell. Tried on the response x to a force of one on every unknown,
    which the softest motions answer, and on the response w to S x_c: what K w is on the retained unknowns, S w_c is.
    (On x itself this would tell how well the solver holds x_c, which is known to 1e-11 only at 131k unknowns.) Where
    a sample of what solves lose leaves no doubt neither is tried.
    """
    enough = (UNSEEN * accuracy) ** 2
    operators, c, K = condensation.operators, condensation.retained, condensation.system.K
    # A solve may lose more, in squares, than a sample: on 72 systems, among them slender ones, up to 29 times.
    if 100.0 * condensation.factor.lost <= enough:
        return False
    force = _off_kernel(condensation.system, np.ones(K.shape[0]))
    x = condensation.factor.solve(force)
    left = _off_kernel(condensation.system, force - condensation.regular @ x)
    off, size = condensation.factor.energy(left), float(abs(force @ x))
    if 0 < len(c) < len(x):
        w = condensation.response(x[c])
        off = max(off, operators.factor.energy((K @ w)[c] - operators.K @ w[c]))
    return off > enough * size


def refined(
    condensation: Condensation,
    operators: Operators,
    force: Floats,
    y: Floats,
    *,
    gap: Floats,
    lam: Floats,
    p: Floats,
    stick: Bools,
    slip: Floats,
) -> tuple[Floats, Floats, Floats]:
    """All unknowns y (n,) and multipliers, corrected until K y = force - B'lam - D'p to rounding.

    Rows read one unknown each. Bounds with p > 0 act, and soft limits where z = D y - e > 0, of the `gap` e (r,). Terms
    that `stick` (m,) keep their increments; multipliers of the others turn with the directions of their `slip`
    (m, block).
    """
    held = np.zeros(len(condensation.retained), dtype=bool)
    # Rows of B, then rows of D: each reads one unknown of its own.
    columns = np.concatenate([operators.rows.columns, operators.limits.columns])
    coefficient = np.concatenate([operators.B.data, operators.D.data])
    act = np.concatenate([np.repeat(stick, operators.block), (p > 0) & (operators.compliance == 0)])
    held[columns[act]] = True
    F = np.flatnonzero(~held)
    turns = _turning(operators, lam, slip, stick)
    best, springs, soft, S_FF = np.inf, np.zeros_like(p), operators.compliance > 0, None
    for _ in range(4):  # Each round gains as many digits as the factors have; two are usual.
        r = residual(force, condensation.system.K, y, condensation.system.multiplier_force(lam, p))
        left = condensation.reduce(r, remembered=False)
        # 1 / c of the soft limits that act, z > 0, and what the multipliers p of all soft ones lack of z_+ / c.
        z = operators.limits.read(y[condensation.retained]) - gap
        stiffness = np.divide(1.0, operators.compliance, out=np.zeros_like(p), where=soft & (z > 0))
        lacking = np.where(soft, stiffness * z - p, 0.0)
        if S_FF is None or not np.array_equal(stiffness, springs):
            springs, K = stiffness, operators.regular.plus(operators.stiffening(turns, stiffness))
            S_FF = operators.factor.within(restricted(K, F), F)
        load, step = left.retained - operators.limits.force_of(lacking), np.zeros(len(held))
        step[F] = S_FF.solve(load[F])
        pressed = lacking + stiffness * operators.limits.read(step)
        # The energy of the correction to y and soft limits; what the held unknowns are pushed with is for multipliers.
        size = left.work_inside(left) + float(load @ step) + float(pressed @ (operators.compliance * pressed))
        if size >= 0.25 * best:
            break
        best = size
        push = left.retained - operators.K @ step
        y = y + condensation.recover(step, left)
        change = np.where(act, push[columns] / coefficient, 0.0)
        lam, p = lam + operators.blocks(change[: lam.size]), p + change[lam.size :] + pressed
        lam = lam + np.einsum("ijk,ik->ij", turns, operators.blocks(operators.rows.read(step)))
    return y, lam, p


def _turning(operators: Operators, lam: Floats, slip: Floats, stick: Bools) -> Floats:
    """(m, block, block) how multipliers turn with their slips, |lam| / |s| (I - ss'/|s|^2); zero where none does.

    Slips of rounding turn as those whose curvature is K's own entry over sqrt(EPS): a larger one, 1e18 has been seen,
    leaves no digit of the stiffness along s.
    """
    size = np.linalg.norm(slip, axis=1)
    turns = ~stick & (size > 0)
    size = np.where(turns, size, 1.0)
    entries = operators.K.diagonal()[operators.rows.columns] / operators.B.data**2
    own = operators.blocks(entries).max(axis=1, initial=0.0)
    curvature = np.where(turns, np.minimum(np.linalg.norm(lam, axis=1) / size, own / np.sqrt(EPS)), 0.0)
    turning: Floats = curvature[:, None, None] * transverse(slip / size[:, None])
    return turning


def full_certificate(
    condensation: Condensation, force: Floats, y: Floats, held: Floats, own: Certificate
) -> Certificate:
    """The certificate of the full system: r = force - held - K y over all unknowns, in extended precision.

    `held` (n,) is B'lam + D'p; or, where the condensed program's certificate knows the error of the retained unknowns
    without the multipliers, what holds those in place: r is then what condensing has lost.

    The floor is what the rounding of K's and the force's own entries brings about (:func:`rounding`).
    Norm terms and limits see retained unknowns only; their parts are of the condensed program's `own` certificate.
    """
    r, size = out_of_balance(condensation.system, force, y, held)
    return replace(own, equilibrium=0.5 * condensation.factor.energy(r), floor=rounding(condensation, size))


def out_of_balance(system: System, force: Floats, y: Floats, held: Floats) -> tuple[Floats, Floats]:
    """The force r = force - held - K y, less what motions of no energy feel, and the size of its terms' sum.

    All (n,), or (n, k) for as many states.
    """
    r, size = residual(force, system.K, y, held), np.abs(force) + np.abs(held)
    if y.any():
        size += sizes(system.K, y)
    return _off_kernel(system, r), size


def _off_kernel(system: System, force: Floats) -> Floats:
    """A force (n,) without what pushes along motions of no energy: multipliers hold that, not the anchors."""
    return force if (kernel := system.kernel) is None else force - kernel.basis @ (kernel.basis.T @ force)


def rounding(condensation: Condensation, size: Floats) -> float:
    """Energy that rounding adds at most to what forces bring about whose sums of terms are `size` (n,) in size.

    Every term, a force or a product K_ij y_j, is known to a relative rounding error of its own, even within +-EPS / 2,
    of variance EPS^2 / 12. That of K_ij acts on i and on j, so that with |e_i + e_j|^2 <= 2 |e_i|^2 + 2 |e_j|^2 the
    mean of the energy is at most 1/2 EPS^2 / 6 sum size_i^2 (K^{-1})_ii. Errors and samples alike have energies
    sum_k l_k x_k^2, x_k normal; their quotient spreads most where one l_k counts alone: Fisher's F.
    """
    return 0.5 * TAIL * EPS * EPS / 6 * condensation.factor.random_energy(size)
