"""The program of a step in the increment d = y - y_prev, its answers, and how cvxpy sees it.

    minimise  1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i| + sum_j (z_j)_+^2 / (2 c_j)        z = D d - e    (2.34)
    dual      K d = g - B'lam - D'p,   |lam_i| <= w_i,  lam_i . s_i = w_i |s_i|,   s = B d - b
              p_j >= 0,   z_j <= c_j p_j,   p_j (c_j p_j - z_j) = 0

with g = load(t_n) - K y_prev, the force out of balance when the step begins. Working in increments keeps all digits
of d when steps are tiny beside y. Where the compliance c_j of a *limit* vanishes, the last sum stands for the bound
D_j d <= e_j; elsewhere it is a squared positive part. The program is data; each solver reads it its own way.

In cvxpy it is

    minimise  1/2 d'Kd - g'd + w't + v'C^{-1}v / 2    subject to  |B_i d - b_i| <= t_i,   D d - v <= e

with one second-order cone a term; v = 0 where a limit is a bound, v >= (z)_+ where it is soft. cvxpy's dual of the
cone |s_i| <= t_i is (w_i, -lam_i); p is that of D d - v <= e. Absolute values may be two inequalities instead, -t
<= B d - b <= t, whose duals (upper, lower) give lam = upper - lower.

A disc of multipliers may be a polygon with corners w e_k on its rim instead: e_k . s_i <= t_i with duals mu_k >= 0
that sum to w_i, lam_i = sum_k mu_k e_k. Such multipliers are admissible; with P corners |s| cos(pi / P) <= max_k
e_k . s, so that the gap of the program of the disc at the answer is at most 1 - cos(pi / P) times w |s|, and the
certificate says how much it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.arrays import EPS, Floats, Ints, brief, is_whole, lengths, of_shape, read_only, shape_in_words
from vemcvx.errors import SceneError, SolverFailed
from vemcvx.outline import ArrayRecord
from vemcvx.program.certificate import Certificate, limit_gaps, moved_gap, norm_gaps
from vemcvx.program.operators import Operators, Rows, product

if TYPE_CHECKING:
    import cvxpy as cp

Gaps = tuple[Floats, Floats]
"""The parts of norm terms (m,) and of limits (r,) in the gap: every one is >= 0 and belongs to one place."""


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

    (n, m, _, _), block = operators.sizes, operators.block
    parameters: tuple[cp.Parameter, ...] = ()
    if data is None:
        parameters = tuple(cp.Parameter(size, nonneg=k == 1) for k, size in enumerate(operators.sizes))
    g, w, b, e = parameters if data is None else data
    d = cp.Variable(n)
    # assume_psd: K is a stiffness matrix; testing its eigenvalues would take longer than the solve.
    energy: cp.Expression = 0.5 * cp.quad_form(d, operators.entries, assume_PSD=True) - g @ d
    constraints: list[cp.Constraint] = []
    lam, p = np.zeros((m, block)).copy, np.zeros(len(operators.compliance)).copy
    if m:
        t, s = cp.Variable(m), operators.B @ d - b
        energy += w @ t
        if corners is not None and block > 1:
            constraints = [sp.kron(sp.eye_array(m), corner[None], format="csr") @ s <= t for corner in corners]
            lam = partial(_of_corners, tuple(constraints), corners)
        elif cones:
            constraints = [cp.SOC(t, cp.reshape(s, (block, m), order="F"), axis=0)]
            lam = partial(_of_cone, constraints[0], m, block)
        else:
            constraints = [s <= t, -s <= t]
            lam = partial(_of_corners, tuple(constraints), np.array([[1.0], [-1.0]]))
    if len(operators.compliance):
        z, soft = operators.D @ d - e, np.flatnonzero(operators.compliance > 0)
        if len(soft):
            v, give = cp.Variable(len(soft)), sp.eye_array(len(operators.compliance), format="csr")[:, soft]
            z, energy = z - give @ v, energy + 0.5 * cp.sum_squares(cp.multiply(operators.compliance[soft] ** -0.5, v))
        constraints = [*constraints, z <= 0]
        p = partial(getattr, constraints[-1], "dual_value")
    # OSQP prints, verbose or not, where it finds no constraint active: this one, idle >= 0, always is. SCS breaks down
    # where there is none at all.
    idle = 0.0 if cones and constraints else cp.Variable(nonneg=True)
    return CvxpyStep(cp.Problem(cp.Minimize(energy + idle), constraints), d, lam, p, parameters)


def _of_corners(sides: Sequence[cp.Constraint], corners: Floats) -> Floats:
    """lam (m, block), corners times their duals."""
    found: Floats = np.einsum("km,kb->mb", [side.dual_value for side in sides], corners)
    return found


def _of_cone(cone: cp.Constraint, m: int, block: int) -> Floats:
    """lam (m, block), minus the dual of the cone's vectors."""
    return -np.reshape(cone.dual_value[1], (block, m), order="F").T


@dataclass(frozen=True, repr=False, eq=False)
class StepProgram(ArrayRecord):
    """One step's program: its own data, beside the operators that all steps share.

    Minimise 1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i| subject to D d <= e; where a limit has a compliance c_j > 0, with
    (D_j d - e_j)_+^2 / (2 c_j) in place of its bound. At the solution K d = g - B'lam - D'p: friction acts on the body
    with the forces -B'lam, limits with -D'p, |lam_i| <= w_i and p >= 0.

    :meth:`StepProgram.to_cvxpy` poses it to any solver, :meth:`StepProgram.certify` bounds the error of any answer.

    Parameters
    ----------
    operators : Operators
        K, B, D, and the compliances c.
    g : (n,) array
        Forces that are out of balance when the step begins.
    w : (m,) array
        Weights >= 0: bounds of friction, as forces.
    b : (m * block,) array
        The slip is B d - b: minus what the motion of the supports adds to it.
    e : (r,) array
        Gaps that are left when the step begins; negative where the body overlaps what limits it.
    """

    operators: Operators
    g: Floats
    w: Floats
    b: Floats
    e: Floats = field(default_factory=lambda: np.zeros(0))
    _seen: dict[tuple[bytes, ...], tuple[float, Floats, Floats, float]] = field(
        default_factory=dict, init=False, repr=False
    )

    def __post_init__(self) -> None:
        """Hand out no array that may be written to: an answer is certified by them after a solver had them."""
        for name, count in zip("gwbe", self.operators.sizes, strict=True):
            array = np.asarray(getattr(self, name))
            if array.shape != (count,):
                raise SceneError(f"StepProgram: {name}: found {shape_in_words(array)}; wanted ({count},).")
            object.__setattr__(self, name, read_only(array.view()))

    @property
    def data(self) -> tuple[Floats, Floats, Floats, Floats]:
        """g, w, b and e: all that is the step's own."""
        return self.g, self.w, self.b, self.e

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The shapes of the increments d and of the multipliers lam and p."""
        return {"d": self.g.shape, "lam": (len(self.w), self.operators.block), "p": self.e.shape}

    def slip(self, d: Floats) -> Floats:
        """s = B d - b, as (m, block)."""
        return self.operators.blocks(self.operators.rows.read(d) - self.b)

    def excess(self, d: Floats) -> Floats:
        """z = D d - e, (r,)."""
        return self.operators.limits.read(d) - self.e

    def excess_blur(self, d: Floats) -> Floats:
        """(r,) the rounding of z; a bound d_i = e_i is exact."""
        limits = self.operators.limits
        if len(self.e) == 0:
            return self.e
        return np.where(limits.exact, 0.0, EPS * (limits.absolute.read(np.abs(d)) + np.abs(self.e)))

    def multiplier_force(self, lam: Floats, p: Floats) -> Floats:
        """B'lam + D'p, the forces (n,) of norm terms and limits."""
        return self.operators.multiplier_force(lam, p)

    def residual(self, d: Floats, lam: Floats, p: Floats) -> Floats:
        """r = g - B'lam - D'p - K d, the forces that do not balance, (n,)."""
        return self.g - self.operators.multiplier_force(lam, p) - product(self.operators.K, d)

    def objective(self, d: Floats) -> float:
        """The energy that the step minimises; infinite beyond a bound."""
        norms = np.linalg.norm(self.slip(d), axis=1)
        over = np.maximum(self.excess(d), 0.0)
        over[over <= self.excess_blur(d)] = 0.0
        soft = self.operators.compliance > 0
        pressed = 0.5 * float(over[soft] @ (over[soft] / self.operators.compliance[soft]))
        if (over[~soft] > 0).any():
            return np.inf
        return float(0.5 * d @ product(self.operators.K, d) - self.g @ d + self.w @ norms) + pressed

    def project(self, lam: Floats) -> Floats:
        """The multipliers (m, block) nearest to `lam` with |lam_i| <= w_i."""
        if self.operators.block == 1:
            # The projection onto an interval is exact; scaling would leave one rounding error.
            return np.minimum(np.maximum(lam, -self.w[:, None]), self.w[:, None])
        size = np.linalg.norm(lam, axis=1)
        scale = np.divide(self.w, size, out=np.ones_like(size), where=size > self.w)
        return np.asarray(lam * scale[:, None])

    def admissible(self, lam: Floats, p: Floats, d: Floats) -> tuple[Floats, Floats]:
        """The multipliers nearest to (lam, p): |lam_i| <= w_i, p >= 0, in balance on K's kernel.

        Balance changes multipliers where it costs little gap at the increments `d`: where d sticks or touches.
        """
        if self.operators.kernel is not None:
            push = self.operators.kernel.T @ self.g
            lam, p, _ = self.operators.kernel_balance.nearest(lam, p, self.w, push, self._inverse_metric(d, p))
        return self.project(lam), np.maximum(p, 0.0)

    def _inverse_metric(self, d: Floats, p: Floats) -> tuple[Floats, Floats]:
        """(m,) and (r,) in (0, 1], the larger the less gap it costs to change a multiplier at the increments `d`."""
        s, z = np.linalg.norm(self.slip(d), axis=1), np.abs(self.excess(d) - self.operators.compliance * p)
        level = 1e-6 * max(s.max(initial=0.0), z.max(initial=0.0)) or 1.0
        return level / (level + s), level / (level + z)

    def multipliers(self, d: Floats, lam: Floats | None = None, p: Floats | None = None) -> tuple[Floats, Floats]:
        """Admissible multipliers (m, block) and (r,) of the increments `d`; those not given are read off d.

        They solve K d = g - B'lam - D'p. Where each row of B and D reads one unknown of its own they are entries of
        g - K d. Else least squares finds them; of several that do, those that cost the least gap: where d sticks or
        touches; and where these are too large, least squares within bounds (in the plane).
        """
        if lam is None or p is None:
            lam, p = self._read_off(d, lam, p)
        return self.admissible(lam, p, d)

    def admissible_point(
        self, d: Floats, lam: Floats | None = None, p: Floats | None = None
    ) -> tuple[Floats, Floats, Floats]:
        """The point (d, lam, p) that certificates hold for: d within its bounds, and admissible multipliers for it."""
        d = self.feasible(d)
        return d, *self.multipliers(d, lam, p)

    def _read_off(self, d: Floats, lam: Floats | None, p: Floats | None) -> tuple[Floats, Floats]:
        """The multipliers nearest to balance at the increments `d`, those given as they are."""
        operators = self.operators
        known = np.zeros(self.shapes["lam"]) if lam is None else lam, np.zeros(len(self.e)) if p is None else p
        free = np.repeat([lam is None, p is None], [len(self.b), len(self.e)])
        rows = Rows(sp.csr_matrix(sp.vstack([operators.B, operators.D], format="csr")[free]))
        force, (slips, touches) = self.residual(d, *known), self._inverse_metric(d, known[1])
        found = rows.nearest(force, np.concatenate([np.repeat(slips, operators.block), touches])[free])
        if rows.columns is None and operators.block == 1:
            high = np.concatenate([self.w, np.full(len(self.e), np.inf)])[free]
            low = np.concatenate([-self.w, np.zeros(len(self.e))])[free]
            if ((found < low) | (found > high)).any():
                found = rows.nearest_within(force, low, high)
        x = np.concatenate([known[0].ravel(), known[1]])
        x[free] = found
        return operators.blocks(x[: len(self.b)]), x[len(self.b) :]

    def certify(self, d: ArrayLike, lam: ArrayLike | None = None, p: ArrayLike | None = None) -> Certificate:
        """Bound the error of an answer, whoever made it: 1/2 |d - d*|_K^2 <= gap, |d - d*|_K <= error.

        The theorem stands in :mod:`vemcvx.program.certificate`.

        Parameters
        ----------
        d : (n,) array
            Increments. The gap is infinite beyond a bound; :meth:`StepProgram.feasible` moves them back.
        lam : (m, block) or (m * block,) array, optional
            Multipliers of the norm terms, K d = g - B'lam - D'p; they are made admissible
            (:meth:`StepProgram.admissible`). Those not given are read off d (:meth:`StepProgram.multipliers`).
        p : (r,) array, optional
            Multipliers of the limits, likewise.

        Raises
        ------
        SceneError
            These are no arrays of such shapes, or a weight of the program is negative, or no number.
        """
        if not (self.w >= 0).all():
            i = int(np.argmin(self.w >= 0))
            raise SceneError(f"certify: found the weight {self.w[i]:.6g} of term {i}; weights are >= 0.")
        given = {"d": d} | {key: x for key, x in (("lam", lam), ("p", p)) if x is not None}
        read = {key: of_shape(x, f"certify: {key}", self.shapes[key]) for key, x in given.items()}
        return self.certificate_at(read["d"], *self.multipliers(**read))

    def certificate_at(self, d: Floats, lam: Floats, p: Floats) -> Certificate:
        """The certificate of increments with admissible multipliers."""
        equilibrium, friction, limits, moved = self._gaps(d, lam, p)
        return Certificate(equilibrium, friction, self.rounding_floor(d, lam, p), limits, moved=moved)

    def duality_gap(self, d: Floats, lam: Floats, p: Floats) -> float:
        """The gap alone, for admissible multipliers: what solvers measure their progress by."""
        equilibrium, friction, limits, moved = self._gaps(d, lam, p)
        return moved_gap(moved, equilibrium + float(friction.sum()) + float(limits.sum()))

    def _gaps(self, d: Floats, lam: Floats, p: Floats) -> tuple[float, Floats, Floats, float]:
        """The parts of the gap; of the last point they are remembered, which a solver has looked at as a rule."""
        if (point := (d.tobytes(), lam.tobytes(), p.tobytes())) not in self._seen:
            operators, (equilibrium, parts) = self.operators, self._between(d, lam, p)
            moved = 0.0
            if operators.own_columns is None and operators.factor.exact:
                rest = float(parts[0].sum() + parts[1].sum())
                move, placed = self._put_in_place(parts, d, lam, p) if equilibrium < rest < np.inf else (0.0, parts)
                if moved_gap(move, equilibrium + float(placed[0].sum() + placed[1].sum())) < equilibrium + rest:
                    moved, parts = move, placed
            self._seen.clear()
            # Certificates hand the arrays out, and the next one of this point is made of them.
            self._seen[point] = equilibrium, read_only(parts[0]), read_only(parts[1]), moved
        return self._seen[point]

    def _between(self, d: Floats, lam: Floats, p: Floats) -> tuple[float, Gaps]:
        """The parts of primal minus dual objective (theorem 1)."""
        operators, excess = self.operators, (self.excess(d), self.excess_blur(d))
        equilibrium = 0.5 * operators.factor.energy(self.residual(d, lam, p))
        if (N := operators.kernel) is not None and np.greater(*np.abs(self._imbalance(N, lam, p))).any():
            equilibrium = np.inf
        # Where K^{-1} has lost all digits its sign is rounding; its size says so, and zero would not.
        parts = norm_gaps(self.w, lam, self.slip(d)), limit_gaps(operators.compliance, p, *excess)
        return abs(equilibrium), parts

    def _put_in_place(self, gaps: Gaps, d: Floats, lam: Floats, p: Floats) -> tuple[float, Gaps]:
        """2 |v|_K of a move v that puts in place what sticks and acts, and the parts of the gap at d - v; `gaps` at d.

        That is theorem 2 of :mod:`vemcvx.program.certificate`. A row is taken to stick or act if x_i is rounding and
        its part of the gap is at least x_i^2 / f_i, f_i = (A K^{-1}A')_ii, the energy of a move that puts this row
        alone in place. Larger slips are errors of the solver, and stay in the gap.
        """
        operators, slip, z = self.operators, self.slip(d), self.excess(d)
        over = z - operators.compliance * p
        x = np.concatenate([slip.ravel(), over])
        pairs = (operators.rows, self.b), (operators.limits, self.e)
        size = np.concatenate([rows.absolute.read(np.abs(d)) + np.abs(offset) for rows, offset in pairs])
        sticks = lengths(slip) ** 2 <= gaps[0] * operators.norm_flexibility
        # Within its rounding the excess over a bound has no part in the gap: p|z| on either side.
        cost = np.where(operators.compliance > 0, gaps[1], p * np.abs(z))
        acts = over**2 <= cost * operators.limit_flexibility
        # Rounding: of sums of a few hundred products, and what a solve leaves of its equations.
        held = (np.abs(x) <= 1e-13 * size) & np.concatenate([np.repeat(sticks, operators.block), acts])
        if not held.any():
            return 0.0, gaps
        A, x = sp.vstack([operators.B, operators.D], format="csr")[held], x[held]
        spread = operators.factor.solve(A.T.toarray())
        W, v = A @ spread, np.zeros(len(d))
        for _ in range(2):  # The second time for what the first one's rounding has left.
            v = v + spread @ np.linalg.lstsq(W, x - A @ v, rcond=1e-12)[0]
        blur = self.excess_blur(d) + EPS * len(v) * (abs(operators.D) @ np.abs(v))
        friction = norm_gaps(self.w, lam, slip - operators.blocks(operators.B @ v))
        limits = limit_gaps(operators.compliance, p, z - operators.D @ v, blur)
        return 2.0 * operators.energy_norm(v), (friction, limits)

    def _imbalance(self, N: Floats, lam: Floats, p: Floats) -> tuple[Floats, Floats]:
        """N'(g - B'lam - D'p), (k,), which is N'r because N'K = 0; and what rounding may leave of it."""
        size = np.abs(self.g)
        # Entries are sums of larger forces that cancel: none is known better than to EPS times the largest.
        blur = np.abs(N).T @ (size + size.max(initial=0.0) / 8)
        return self.operators.kernel_balance.imbalance(lam, p, N.T @ self.g, blur)

    def rounding_floor(self, d: Floats, lam: Floats, p: Floats) -> float:
        """The floor: the part of the gap at (d, lam, p) that round-off alone may hide or add.

        r is known to eps (|g| + |B'||lam| + |D'|p + |K||d|), measured in the norm of K^{-1}; s_i to eps (|B_i||d| +
        |b_i|), except where a row of B has one entry and b_i = 0: there a sticking s_i = 0 is exact; z_j to eps
        (|D_j||d| + |e_j|).
        """
        operators = self.operators
        rows, size, slip = operators.rows.absolute, np.abs(d), np.abs(self.b)
        held = rows.force_of(np.abs(lam.ravel()))
        if len(p):
            held += operators.limits.absolute.force_of(p)
        if rows.columns is None:
            slip += np.where(rows.single, 0.0, rows.read(size))
        blur = EPS * (np.abs(self.g) + held + product(operators.absolute, size))
        floor = 0.5 * float(blur @ np.abs(operators.factor.rough(blur))) + float(p @ self.excess_blur(d))
        if slip.any():
            floor += EPS * float(self.w @ operators.blocks(slip).sum(axis=1))
        if operators.kernel is not None:
            # A load off balance by so much moves the answer along N, and does work on that motion.
            floor += float(self._imbalance(operators.kernel, lam, p)[1] @ np.abs(operators.kernel.T @ d))
        return floor

    def to_cvxpy(self, cones: bool | None = None) -> CvxpyStep:
        """The program in cvxpy, for any solver that cvxpy can call; `lam` and `p` read off its duals with our signs.

        ::

            posed = program.to_cvxpy()
            posed.problem.solve(solver="SCS")
            program.certify(program.feasible(posed.d.value), posed.lam, posed.p).error

        Parameters
        ----------
        cones : bool, optional
            One second-order cone a norm term; or, where these are absolute values, two inequalities, which solvers of
            quadratic programs take, too: the default there.

        Raises
        ------
        SceneError
            The program has no unknowns.
        """
        if len(self.g) == 0:
            raise SceneError("to_cvxpy: the program has no unknowns left to solve for; take condense=False.")
        cones = self.operators.block > 1 if cones is None else cones
        return to_cvxpy(self.operators, self.data, cones)

    def proximal(self, centre: Floats) -> StepProgram:
        """The program of the proximal point of `centre` (n,) on the anchors; itself where K has no kernel."""
        anchor = self.operators.anchor
        return self if anchor is None else replace(self, operators=self.operators.regular, g=self.g + anchor * centre)

    def at_rest(self) -> Floats | None:
        """Multipliers (m, block) with which d = 0 is the answer to the last bit, if they can be read off; else None."""
        rows = self.operators.rows
        if rows.columns is None or self.b.any() or (self.e < 0).any():
            return None
        lam = self.g[rows.columns] / self.operators.B.data
        if (np.linalg.norm(self.operators.blocks(lam), axis=1) > self.w).any() or (self.g != rows.force_of(lam)).any():
            return None
        return self.operators.blocks(lam)

    def feasible(self, d: Floats) -> Floats:
        """The increments d, moved as little as need be to obey the bounds."""
        operators = self.operators
        rigid = np.flatnonzero(operators.compliance == 0).astype(np.int64)
        if len(rigid) == 0 or not (self.excess(d)[rigid] > 0).any():
            return d
        if operators.limits.single[rigid].all():
            # Rows that give way may read the same unknowns, and several bounds as well.
            entry = operators.D.indptr[rigid]
            column, coefficient, moved = operators.D.indices[entry], operators.D.data[entry], d.copy()
            edge, upper = self.e[rigid] / coefficient, coefficient > 0
            np.minimum.at(moved, column[upper], edge[upper])
            np.maximum.at(moved, column[~upper], edge[~upper])
            return moved
        return self._projected(d, rigid)

    def _projected(self, d: Floats, rigid: Ints) -> Floats:
        """Return increments within the `rigid` limits, by projections in the energy norm.

        A round replaces d by d - K^{-1}D'q, the nearest point within the rows overstepped so far: q minimises
        q'Wq / 2 - z'q over q >= 0, with W = D K^{-1}D' and z = D d - e. Rows only join. Every round aims inside by
        twice the rounding of D d - e. After several rounds d is near the first point, not the nearest.
        """
        from scipy.optimize import nnls

        operators, rows = self.operators, np.zeros(0, dtype=np.int64)
        for _ in range(len(rigid) + 4):
            z, blur = self.excess(d)[rigid], self.excess_blur(d)[rigid]
            if (z <= blur).all():
                break
            rows = np.union1d(rows, np.flatnonzero(z > blur))
            D = operators.D[rigid[rows]].toarray()
            spread = operators.factor.solve(np.ascontiguousarray(D.T))
            size, V = np.linalg.eigh(D @ spread)
            # Rows that follow from others have no flexibility of their own.
            root, V = np.sqrt(size[size > 1e-12 * size[-1]]), V[:, size > 1e-12 * size[-1]]
            push = nnls(root[:, None] * V.T, V.T @ (z + 2 * blur)[rows] / root, maxiter=100 * len(rows))[0]
            d = d - spread @ push
        return d


PROMISED = "return vx.Answer(d, lam, iterations), (d, lam, p), (d, lam), or d; a tuple may end in its iterations"


@dataclass(frozen=True, repr=False, eq=False)
class Answer(ArrayRecord):
    """A solver's answer to one step; nothing is claimed about it before it is certified.

    Parameters
    ----------
    d : (n,) array
        Increments. Those beyond their bounds are moved back onto them.
    lam : (m, block) array
        Multipliers of the norm terms, K d = g - B'lam - D'p. Where they are too large they are projected.
    iterations : int
        As the solver counts them.
    status : str
        In the solver's own words, for messages.
    safeguards : int
        How many of the iterations were steps of a globally convergent method that stood in for a faster one.
    p : (r,) array
        Multipliers of the limits; negative ones are taken for zero.
    """

    d: Floats
    lam: Floats
    iterations: int
    status: str = ""
    safeguards: int = 0
    p: Floats = field(default_factory=lambda: np.zeros(0))


def fitting(answer: Answer, program: StepProgram, solver: str) -> Answer:
    """The answer of a solver; SolverFailed where it is no Answer, has arrays of other shapes, or has diverged."""
    if not isinstance(answer, Answer) or not is_whole(answer.iterations):
        raise SolverFailed(f"solver {solver}: found the answer {brief(answer)}; wanted Answer(d, lam, iterations).")
    for name, shape in program.shapes.items():
        found = getattr(answer, name)
        if not isinstance(found, np.ndarray) or found.shape != shape or found.dtype != float:
            raise SolverFailed(f"solver {solver}: found {name} = {brief(found)}; wanted an array of floats {shape}.")
        # Scaled programs have data of size one: entries whose squares are no numbers are no answer. NaN is left to the
        # certificate, which is infinite.
        if np.vdot(found, found) > 1e200:
            size = float(np.abs(found).max(initial=0.0))
            raise SolverFailed(
                f"solver {solver}: {name} reaches {size:.1e}, and the program is scaled: the solver has diverged."
            )
    return answer


def read_answer(raw: Any, program: StepProgram, solver: str) -> Answer:
    """The returned value of a user's `solve` as an Answer; missing multipliers are recovered.

    A whole number at the end of a tuple is the iterations. SolverFailed where it is none, or does not fit the program.
    """
    said = raw if isinstance(raw, Answer) else None
    parts = (said.d, said.lam, said.p) if said is not None else raw if isinstance(raw, tuple) else (raw,)
    counted = len(parts) > 1 and is_whole(parts[-1])
    parts, iterations = (parts[:-1], int(parts[-1])) if counted else (parts, 0)
    shapes = program.shapes
    given = {key: np.zeros(shape) for key, shape in shapes.items() if 0 in shape}
    # Multipliers that an Answer was not given are empty arrays.
    empty = [part is None or (isinstance(part, np.ndarray) and part.size == 0) for part in parts]
    given |= {key: part for key, part, none in zip(shapes, parts, empty, strict=False) if not none}
    if len(parts) > len(shapes) or "d" not in given:
        raise SolverFailed(f"solver {solver}: found the answer {brief(raw)}; it must {PROMISED}.")
    try:
        read = {key: of_shape(part, f"solver {solver}: {key}", shapes[key]) for key, part in given.items()}
    except SceneError as error:
        raise SolverFailed(str(error)) from None
    d, lam, p = read["d"], read.get("lam"), read.get("p")
    if lam is None or p is None:
        with np.errstate(over="ignore", invalid="ignore"):  # What has diverged is refused for its size.
            d, lam, p = program.admissible_point(d, lam, p)
    if said is None:
        return Answer(d, lam, iterations, p=p)
    return Answer(d, lam, said.iterations, said.status, said.safeguards, p=p)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class SolvedProgram(StepProgram):
    """The program of one step of a run, with its answer.

    In the units of the scene; where weights depend on pressures (Coulomb) they are those of the solved step. Signs and
    methods are those of :class:`vemcvx.program.step_program.StepProgram`.

    Parameters
    ----------
    answer : Answer
        Increments d, and multipliers lam and p.
    step : int
        1 is the first after the initial instant.
    t : float
        The instant at which the step ends.
    slope : (m, r) sparse matrix, optional
        Where weights follow the forces of the limits: their derivative at the answer; coefficients of friction.
    origin : mapping
        Where the program comes from, in words and numbers: "scene", "mesh", "solver".
    energy_rows : callable () -> (k, n) sparse matrix, optional
        F with F'F = K, which has no fill: of a body the roots of its cells' matrices. Conic formats want one.
    """

    answer: Answer
    step: int
    t: float
    slope: sp.csr_matrix | None = None
    origin: Mapping[str, Any] = field(default_factory=dict)
    energy_rows: Callable[[], sp.csr_matrix] | None = None

    @classmethod
    def of(cls, program: StepProgram, answer: Answer, step: int, t: float) -> SolvedProgram:
        """A program with its answer."""
        return cls(program.operators, *program.data, answer=answer, step=step, t=t)

    @cached_property
    def certificate(self) -> Certificate:
        """The certificate of the answer to this program."""
        return self.certify(self.answer.d, self.answer.lam, self.answer.p)

    @cached_property
    def norm(self) -> float:
        """|d|_K, the energy norm of the increments, which errors may be compared with."""
        return self.operators.energy_norm(self.answer.d)

    @cached_property
    def bounds(self) -> tuple[float, float]:
        """Below and above the least value of the objective: that of the answer less the gap, and that of the answer.

        Rounding included: the certificate's floor, and that of sums of n terms, at most n eps of their sizes.
        """
        value, d = self.objective(self.answer.d), np.abs(self.answer.d)
        terms = 0.5 * d @ product(self.operators.absolute, d) + np.abs(self.g) @ d
        blur = self.certificate.floor + (len(d) + 2) * EPS * float(terms + np.abs(value))
        # Where that is smaller, the certificate's gap bounds the error alone (theorem 2).
        d, lam, p = self.answer.d, self.answer.lam, self.answer.p
        equilibrium, parts = self._between(d, *self.multipliers(d, lam, p))
        return value - equilibrium - float(sum(part.sum() for part in parts)) - blur, value + blur
