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
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.linalg import lsqr

from vemcvx.base.arrays import (
    EPS,
    Bools,
    Floats,
    Ints,
    brief,
    directions,
    finite,
    is_whole,
    lengths,
    of_shape,
    onto_discs,
    power_of_two,
    read_only,
    shape_in_words,
)
from vemcvx.base.errors import SceneError, SolverFailed
from vemcvx.base.outline import ArrayRecord
from vemcvx.program.certificate import ROUNDED, Certificate, limit_gaps, norm_gaps
from vemcvx.program.kernel import balanced
from vemcvx.program.operators import Operators, product

if TYPE_CHECKING:
    import cvxpy as cp

STILL = 1e-9
"""Part of the largest motion of a row below which slips, and what limits lack, count as none."""
GAIN = 1e-9
"""Gain of a motion, in parts of the load, that an interior-point method tells from zero."""


def has_diverged(x: Floats) -> bool:
    """Return True for entries whose squares are hardly numbers: of motions, say, that nothing holds."""
    return bool(np.vdot(x, x) > 1e250)


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
    _multipliers: Callable[[], tuple[Floats, Floats]] = field(repr=False)
    parameters: tuple[cp.Parameter, ...] = field(default=(), repr=False)

    def at(self, data: Sequence[Floats]) -> CvxpyStep:
        """Return the program of the step with these g, w, b and e."""
        for parameter, value in zip(self.parameters, data, strict=True):
            parameter.value = value
        return self

    @property
    def lam(self) -> Floats | None:
        """Multipliers (m, block) of the norm terms; None where the solver gave none."""
        return self._multipliers()[0] if self._solved else None

    @property
    def p(self) -> Floats | None:
        """Multipliers (r,) of the limits; None where the solver gave none."""
        return self._multipliers()[1] if self._solved else None

    @property
    def _solved(self) -> bool:
        return all(dual.value is not None for one in self.problem.constraints for dual in one.dual_variables)


def to_cvxpy(
    operators: Operators, data: Sequence[Floats] | None, cones: bool = True, corners: Floats | None = None
) -> CvxpyStep:
    """Write a step in cvxpy; without data g, w, b, e with parameters in their place.

    Without `cones` absolute values are two inequalities each; with `corners` (P, block), unit vectors, discs are such
    polygons.
    """
    import cvxpy as cp

    (n, m, _, r), block, c = operators.sizes, operators.block, operators.compliance
    parameters = tuple(cp.Parameter(size, nonneg=k == 1) for k, size in enumerate(operators.sizes) if data is None)
    g, w, b, e = parameters if data is None else data
    d = cp.Variable(n)
    # assume_psd: K is a stiffness matrix; testing its eigenvalues would take longer than the solve.
    energy: cp.Expression = 0.5 * cp.quad_form(d, operators.K, assume_PSD=True) - g @ d
    sides: list[cp.Constraint] = []
    limits: list[cp.Constraint] = []
    corners = np.array([[1.0], [-1.0]]) if block == 1 else corners
    if m:
        t, s = cp.Variable(m), operators.B @ d - b
        energy += w @ t
        if corners is None or (cones and block == 1):
            sides = [cp.SOC(t, cp.reshape(s, (block, m), order="F"), axis=0)]
        else:
            sides = [sp.kron(sp.eye_array(m), corner[None], format="csr") @ s <= t for corner in corners]
    if r:
        z, soft = operators.D @ d - e, np.flatnonzero(c > 0)
        if len(soft):
            v = cp.Variable(len(soft))
            z = z - sp.eye_array(r, format="csr")[:, soft] @ v
            energy += 0.5 * cp.sum_squares(cp.multiply(c[soft] ** -0.5, v))
        limits = [z <= 0]

    def multipliers() -> tuple[Floats, Floats]:
        lam, p = np.zeros((m, block)), np.asarray(limits[0].dual_value) if r else np.zeros(0)
        if m and isinstance(sides[0], cp.SOC):
            lam = -np.reshape(sides[0].dual_value[1], (block, m), order="F").T
        elif corners is not None:
            lam = sum((np.outer(side.dual_value, corner) for side, corner in zip(sides, corners, strict=False)), lam)
        return lam, p

    # OSQP prints, verbose or not, where it finds no constraint active: this one, idle >= 0, always is. SCS breaks down
    # where there is none at all.
    idle = 0.0 if cones and (sides or limits) else cp.Variable(nonneg=True)
    return CvxpyStep(cp.Problem(cp.Minimize(energy + idle), [*sides, *limits]), d, multipliers, parameters)


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

    @cached_property
    def size(self) -> float:
        """The energy norm of what moves the step: its frictionless answer, limits that move in, or friction."""
        operators, top = self.operators, float(np.abs(self.g).max(initial=0.0))
        unit = float(power_of_two(top))
        size = unit * float(np.sqrt(operators.factor.energy(self.g / unit))) if top > 0 else 0.0
        soft = operators.limit_flexibility + operators.compliance
        pushed = np.maximum(-self.e, 0.0) / np.sqrt(np.where(soft > 0, soft, 1.0))
        size = max(size, float(pushed.max(initial=0.0)))
        return size or float(np.sqrt(self.w @ lengths(operators.blocks(self.b))))

    def slip(self, d: Floats) -> Floats:
        """Return s = B d - b, as (m, block)."""
        return self.operators.blocks(self.operators.B @ d - self.b)

    def excess(self, d: Floats) -> Floats:
        """Return z = D d - e, (r,)."""
        return np.asarray(self.operators.D @ d - self.e)

    def blur(self, d: Floats) -> tuple[Floats, Floats]:
        """Return the slips (m,) and excesses (r,) that count as none.

        These are STILL of the largest motion of a slip or of a limit, or of how far what moves the step takes the row.
        """
        operators, rows = self.operators, len(self.b)
        way, reach = operators.absolute[1] @ np.abs(d), self.size
        slips = max((way[:rows] + np.abs(self.b)).max(initial=0.0), 0.0)
        of_terms = np.maximum(reach * np.sqrt(operators.norm_flexibility), slips)
        of_limits = np.maximum(reach * np.sqrt(operators.limit_flexibility), way[rows:].max(initial=0.0))
        return STILL * of_terms, STILL * of_limits

    def still(self, d: Floats) -> Bools:
        """Return the terms (m,) whose slips count as none."""
        return np.asarray(lengths(self.slip(d)) <= self.blur(d)[0])

    def multiplier_force(self, lam: Floats, p: Floats) -> Floats:
        """Return B'lam + D'p, the forces (n,) of norm terms and limits."""
        return self.operators.multiplier_force(lam, p)

    def residual(self, d: Floats, lam: Floats, p: Floats) -> Floats:
        """Return r = g - B'lam - D'p - K d, the forces that do not balance, (n,)."""
        return self.g - self.multiplier_force(lam, p) - product(self.operators.K, d)

    def objective(self, d: Floats) -> float:
        """Return the energy that the step minimises; infinite beyond a bound."""
        z, c = self.excess(d), self.operators.compliance
        over = np.where(z <= self.blur(d)[1], 0.0, z)
        if (over[c == 0] > 0).any():
            return np.inf
        pressed = 0.5 * float(over[c > 0] @ (over[c > 0] / c[c > 0]))
        return float(0.5 * d @ product(self.operators.K, d) - self.g @ d + self.w @ lengths(self.slip(d))) + pressed

    def project(self, lam: Floats) -> Floats:
        """Return the multipliers (m, block) nearest to `lam` with |lam_i| <= w_i."""
        return onto_discs(lam, self.w)

    def admissible(self, lam: Floats, p: Floats, d: Floats) -> tuple[Floats, Floats]:
        """Return multipliers near (lam, p) with |lam_i| <= w_i, p >= 0, in balance on K's kernel if such are found.

        Balance changes multipliers where it costs little gap at the increments `d`: where d sticks or touches.
        """
        lam, p, N = self.project(lam), np.maximum(p, 0.0), self.operators.kernel
        if N is None or has_diverged(d):
            return lam, p
        s, z = lengths(self.slip(d)), np.abs(self.excess(d) - self.operators.compliance * p)
        level = 1e-6 * max(s.max(initial=0.0), z.max(initial=0.0)) or 1.0
        weights = level / (level + s), level / (level + z)
        return balanced((lam, p), self.w, self.operators.kernel_modes, N.T @ self.g, weights)

    def unbalanced_motion(self) -> Floats | None:
        """Return increments N c without energy that gain most, against friction, beside limits; None if none gains.

        The gain is g'N c - sum w_i |B_i N c| with |c| = 1; below GAIN of the load it is none.
        """
        import cvxpy as cp

        if (N := self.operators.kernel) is None:
            return None
        push, modes, rows = N.T @ self.g, self.operators.kernel_modes, len(self.b)
        c, largest = cp.Variable(len(push)), np.abs(push).max(initial=0.0) or 1.0
        gain: cp.Expression = (push / largest) @ c
        if rows:
            slips = cp.reshape(modes[:rows] @ c, (self.operators.block, len(self.w)), order="F")
            gain -= (self.w / largest) @ cp.norm(slips, axis=0)
        limits = [modes[rows:] @ c <= 0] if len(self.e) else []
        problem = cp.Problem(cp.Maximize(gain), [cp.norm(c) <= 1, *limits])
        with warnings.catch_warnings(), suppress(cp.error.SolverError):
            warnings.simplefilter("ignore")  # of answers that are not accurate
            problem.solve(solver="CLARABEL", tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12)
        return None if c.value is None or not problem.value > GAIN else np.asarray(N @ c.value)

    def multipliers(self, d: Floats, lam: Floats | None = None, p: Floats | None = None) -> tuple[Floats, Floats]:
        """Return admissible multipliers (m, block) and (r,) of the increments `d`; those not given are read off d.

        They solve K d = g - B'lam - D'p, by least squares: all of them, or all but those that the law gives, w s/|s| of
        what slips, (z)_+/c of what is soft, and nothing of open bounds. The smaller gap decides.
        """
        if lam is not None and p is not None:
            return self.admissible(lam, p, d)
        read = (self.admissible(*self._read_off(d, lam, p, lawful), d) for lawful in (False, True))
        return min(read, key=lambda pair: self.duality_gap(d, *pair))

    def admissible_point(
        self, d: Floats, lam: Floats | None = None, p: Floats | None = None
    ) -> tuple[Floats, Floats, Floats]:
        """Return the point (d, lam, p) that certificates hold for: d within its bounds, multipliers admissible."""
        d = self.feasible(d)
        return d, *self.multipliers(d, lam, p)

    def _read_off(self, d: Floats, lam: Floats | None, p: Floats | None, lawful: bool) -> tuple[Floats, Floats]:
        """Return the multipliers nearest to balance at the increments `d`; given ones, and lawful ones, as they are."""
        operators, rows, c = self.operators, len(self.b), self.operators.compliance
        x = np.append(np.zeros(rows) if lam is None else lam, np.zeros(len(c)) if p is None else p)
        free = np.repeat([lam is None, p is None], [rows, len(c)])
        if lawful:
            s, z, (slips, lacks) = self.slip(d), self.excess(d), self.blur(d)
            size = np.where(lengths(s) <= slips, 0.0, lengths(s))
            law = self.w[:, None] * directions(s, size), np.where(z > lacks, z, 0.0) / np.where(c > 0, c, np.inf)
            known = np.append(np.repeat(size > 0, operators.block), (c > 0) | (z < -lacks))
            x, free = np.where(free & known, np.append(*law), x), free & ~known
        if operators.own_columns is None:  # Rows that share unknowns share the forces there, within their bounds.
            near, free_terms = (operators.blocks(x[:rows]), x[rows:]), operators.blocks(free[:rows] * 1.0).max(axis=1)
            push = self.g - product(operators.K, d)
            return balanced(near, self.w, operators.A.toarray(), push, (free_terms, free[rows:] * 1.0))
        force = self.residual(d, x[:rows], x[rows:])
        x[free] += lsqr(operators.A[free].T, force, atol=1e-15, btol=1e-15, iter_lim=100 + 4 * int(free.sum()))[0]
        return operators.blocks(x[:rows]), x[rows:]

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
            These are no arrays of such shapes, or not finite, or a weight of the program is negative, or no number.
        """
        if not (self.w >= 0).all():
            i = int(np.argmin(self.w >= 0))
            raise SceneError(f"certify: found the weight {self.w[i]:.6g} of term {i}; weights are >= 0.")
        given = {"d": d} | {key: x for key, x in (("lam", lam), ("p", p)) if x is not None}
        names = {key: f"certify: {key}" for key in given}
        read = {key: finite(of_shape(x, names[key], self.shapes[key]), names[key]) for key, x in given.items()}
        return self.certificate_at(read["d"], *self.multipliers(**read))

    def certificate_at(self, d: Floats, lam: Floats, p: Floats, before: Floats | float = 0.0) -> Certificate:
        """Return the certificate of increments with admissible multipliers, by the better of theorems 1 and 2.

        Where d is added to displacements `before` (n,), these round as it does.
        """
        operators, s, z = self.operators, self.slip(d), self.excess(d)
        if has_diverged(d):
            return Certificate(np.inf, np.zeros(len(s)), 0.0, np.zeros(len(z)))
        # Where K^{-1} has lost all digits its sign is rounding; its size says so, and zero would not.
        equilibrium = abs(0.5 * operators.factor.energy(self.residual(d, lam, p)))
        if operators.kernel is not None and np.greater(*np.abs(self._imbalance(operators.kernel, lam, p))).any():
            equilibrium = np.inf
        friction, limits = norm_gaps(self.w, lam, s), limit_gaps(operators.compliance, p, z)
        plain = Certificate(equilibrium, friction, self.rounding_floor(d, lam, p, before), limits)
        if plain.terms <= equilibrium:
            return plain
        return min(plain, self._put_in_place(d, lam, p, plain), key=lambda found: found.gap)

    def duality_gap(self, d: Floats, lam: Floats, p: Floats) -> float:
        """Return the gap alone, for admissible multipliers: what solvers measure their progress by."""
        return self.certificate_at(d, lam, p).gap

    def _put_in_place(self, d: Floats, lam: Floats, p: Floats, plain: Certificate) -> Certificate:
        """Return the certificate by theorem 2, of a move v that puts in place what seems to hold still.

        These are rows whose part of the gap is at least the energy x_i^2 / f_i of a move that puts them alone in place,
        f_i = (A K^{-1}A')_ii, and bounds overstepped by rounding.
        """
        operators, s, z, (slips, lacks) = self.operators, self.slip(d), self.excess(d), self.blur(d)
        rigid, met, size = operators.compliance == 0, operators.compliance * p, lengths(s)
        lack, over = np.where((p > 0) | (z > 0), z - met, 0.0), rigid & (z > 0)
        gains = lack**2 <= np.where(over, 0.0, plain.limits) * operators.limit_flexibility
        near = ((p > 0) | (z > 0)) & (np.abs(lack) <= lacks) & (gains | over)
        still = (size <= slips) & (size**2 <= plain.friction * operators.norm_flexibility)
        held = np.append(np.repeat(still, operators.block), near)
        v = operators.move(held, np.append(s, lack)[held])
        s = np.where(still[:, None], 0.0, s - operators.blocks(operators.B @ v))
        z = np.where(near, met, z - operators.D @ v)
        z = np.where(rigid & (z <= lacks), np.minimum(z, 0.0), z)
        friction, limits = norm_gaps(self.w, lam, s), limit_gaps(operators.compliance, p, z)
        return replace(plain, friction=friction, limits=limits, moved=2.0 * operators.energy_norm(v))

    def _imbalance(self, N: Floats, lam: Floats, p: Floats) -> tuple[Floats, Floats]:
        """Return N'(g - B'lam - D'p), (k,), which is N'r because N'K = 0; and what rounding may leave of it."""
        size, x, modes = np.abs(self.g), np.append(lam, p), self.operators.kernel_modes
        # Entries are sums of larger forces that cancel: none is known better than to EPS times the largest.
        terms = np.abs(N).T @ (size + size.max(initial=0.0) / 8) + np.abs(x) @ np.abs(modes)
        return N.T @ self.g - x @ modes, ROUNDED * terms

    def rounding_floor(self, d: Floats, lam: Floats, p: Floats, before: Floats | float = 0.0) -> float:
        """Return the energy that the rounding of the residual r can hide, 1/2 sum_i (ROUNDED a_i)^2 f_i.

        a = |g| + |B|'|lam| + |D|'p + |K||d| is the size of the terms of r, f the diagonal of K^{-1}. The error of K's
        own entries is not in it.
        """
        if has_diverged(d):
            return 0.0
        forces = np.abs(self.g) + self.operators.absolute[1].T @ np.abs(np.append(lam, p))
        rounding = self.operators.rounding(forces, np.abs(d) + np.abs(before))
        return float(self.operators.energies_of_rounding(rounding))

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

    def at_rest(self) -> Floats | None:
        """Return multipliers (m, block) with which d = 0 is the answer to the last bit, if they can be read off."""
        operators, own = self.operators, self.operators.own_columns
        if own is None or self.b.any() or (self.e < 0).any():
            return None
        lam = operators.blocks(self.g[own[0]] / operators.B.data)
        exact = np.array_equal(self.g, self.multiplier_force(lam, np.zeros_like(self.e)))
        return lam if exact and (lengths(lam) <= self.w).all() else None

    def feasible(self, d: Floats) -> Floats:
        """Return the increments d, moved as little as need be to obey the bounds."""
        D, rigid = self.operators.D, np.flatnonzero(self.operators.compliance == 0)
        if not (self.excess(d)[rigid] > 0).any():
            return d
        if not (np.diff(D.indptr)[rigid] == 1).all():
            return self._projected(d, rigid.astype(np.int64))
        # Rows that give way may read the same unknowns, and several bounds as well.
        column, coefficient, moved = D.indices[D.indptr[rigid]], D.data[D.indptr[rigid]], d.copy()
        edge, upper = self.e[rigid] / coefficient, coefficient > 0
        np.minimum.at(moved, column[upper], edge[upper])
        np.maximum.at(moved, column[~upper], edge[~upper])
        return moved

    def _projected(self, d: Floats, rigid: Ints) -> Floats:
        """Return increments within the `rigid` limits, by projections in the energy norm.

        A round replaces d by d - K^{-1}D'q, the nearest point within the rows overstepped so far: q minimises
        q'Wq / 2 - z'q over q >= 0, with W = D K^{-1}D' and z = D d - e. Rows only join. After several rounds d is near
        the first point, not the nearest.
        """
        from scipy.optimize import nnls

        rows = np.zeros(0, dtype=np.int64)
        for _ in range(len(rigid) + 4):
            z = self.excess(d)[rigid]
            over = np.flatnonzero(z > self.blur(d)[1][rigid])
            if len(over) == 0:
                break
            rows = np.union1d(rows, over)
            D = self.operators.D[rigid[rows]].toarray()
            spread = self.operators.factor.solve(np.ascontiguousarray(D.T))
            W = D @ spread
            lift = 1e-12 * W.max() or 1.0  # Rows that follow from others have no flexibility of their own.
            R = np.linalg.cholesky(W + lift * np.eye(len(W))).T
            push = nnls(R, np.linalg.solve(R.T, z[rows]), maxiter=100 * len(rows))[0]
            d = d - spread @ push
        return d


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


def read_answer(raw: Any, program: StepProgram, solver: str) -> Answer:
    """Return what a solver returned as an Answer; missing multipliers are recovered.

    A whole number at the end of a tuple is the iterations. SolverFailed where it does not fit the program, or diverged.
    """
    own, shapes = isinstance(raw, Answer), program.shapes
    parts = (raw.d, raw.lam, raw.p, raw.iterations) if own else raw if isinstance(raw, tuple) else (raw,)
    counted = len(parts) > 1 and is_whole(parts[-1])
    parts, iterations = (parts[:-1], int(parts[-1])) if counted else (parts, 0)
    read = {key: np.zeros(shape) for key, shape in shapes.items() if 0 in shape}
    for key, part in zip(shapes, parts if len(parts) <= len(shapes) else (), strict=False):
        # Multipliers that an Answer was not given are empty arrays.
        if not (part is None or (isinstance(part, np.ndarray) and part.size == 0)):
            try:
                read[key] = of_shape(part, f"solver {solver}: {key}", shapes[key])
            except SceneError as error:
                raise SolverFailed(str(error)) from None
            if has_diverged(read[key]):
                size = float(np.abs(read[key]).max())
                raise SolverFailed(f"solver {solver}: {key} reaches {size:.1e}: the solver has diverged.")
    if "d" not in read:
        raise SolverFailed(
            f"solver {solver}: found the answer {brief(raw)}; it must return vx.Answer(d, lam, iterations), "
            "(d, lam, p), (d, lam), or d; a tuple may end in its iterations."
        )
    d, lam, p = read["d"], read.get("lam"), read.get("p")
    if lam is None or p is None:
        d, lam, p = program.admissible_point(d, lam, p)
    return replace(raw, d=d, lam=lam, p=p) if own else Answer(d, lam, iterations, p=p)


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
        d, lam, p = self.answer.d, *self.multipliers(self.answer.d, self.answer.lam, self.answer.p)
        value, size, c = self.objective(d), np.abs(d), self.operators.compliance
        terms = 0.5 * size @ product(self.operators.absolute[0], size) + np.abs(self.g) @ size
        blur = self.certificate.floor + (len(d) + 2) * EPS * float(terms + np.abs(value))
        # The least value is known as it is: slips and gaps of rounding, which certificates leave out, count.
        z = np.where(c > 0, self.excess(d), np.minimum(self.excess(d), 0.0))
        parts = norm_gaps(self.w, lam, self.slip(d)).sum() + limit_gaps(c, p, z).sum()
        return value - self.certificate.equilibrium - float(parts) - blur, value + blur
