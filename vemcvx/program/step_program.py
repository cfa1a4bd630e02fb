"""The convex program of a step, (2.34) of the paper, for the increment d = y - y_prev of the unknowns y.

    minimise  1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i| + sum_j (z_j)_+^2 / (2 c_j)        z = D d - e
    solution  K d = g - B'lam - D'p,   |lam_i| <= w_i,  lam_i . s_i = w_i |s_i|,   s = B d - b
              p_j >= 0,   z_j <= c_j p_j,   p_j (c_j p_j - z_j) = 0

K is the stiffness matrix, and g = load(t_n) - K y_prev is the unbalanced force of y_prev under the new load. Norm term
i resists the slip s_i by the force lam_i, up to the weight w_i. The supports and the ground prescribe b_i. A term of
infinite weight always sticks: s_i = 0, and lam_i is free. *Limit* j has the force p_j, the gap e_j and the compliance
c_j. If c_j = 0, the limit is the bound D_j d <= e_j.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.base.arrays import (
    EPS,
    Bools,
    Floats,
    Ints,
    as_array_of_shape,
    brief,
    directions,
    finite,
    is_whole,
    lengths,
    onto_discs,
    power_of_two,
    read_only,
    shape_in_words,
)
from vemcvx.base.errors import SceneError, SolverFailed
from vemcvx.base.outline import ArrayRecord
from vemcvx.program.certificate import ROUNDED, Certificate, limit_gaps, norm_gaps
from vemcvx.program.cvxpy_step import CvxpyStep, to_cvxpy
from vemcvx.program.kernel import balance_multipliers
from vemcvx.program.operators import Operators, product

if TYPE_CHECKING:
    import cvxpy as cp

STILL_TOLERANCE = 1e-9
"""Slips B d - b and excesses D d - e count as zero below this fraction of the largest motion."""
GAIN_TOLERANCE = 1e-9
"""Largest gain in `find_unbalanced_motion` that counts as zero, relative to the load."""


def has_diverged(x: Floats) -> bool:
    """Return True if squares of entries are close to overflow."""
    return bool(np.vdot(x, x) > 1e250)


@dataclass(frozen=True, repr=False, eq=False)
class StepProgram(ArrayRecord):
    """The program of one step: its data, and the operators that all steps share.

    Minimise 1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i| subject to D d <= e. If limit j has a compliance c_j > 0, the
    energy (D_j d - e_j)_+^2 / (2 c_j) replaces the bound. At the solution, K d = g - B'lam - D'p with |lam_i| <= w_i
    and p >= 0.

    Parameters
    ----------
    operators : Operators
        The matrices K, B, D, and the compliances c.
    g : (n,) array
        Unbalanced forces of the state before the step, under the load at the end of the step.
    w : (m,) array
        Weights >= 0: friction bounds, as forces; infinite for terms that always stick.
    b : (m * block,) array
        Minus the slip that moving supports and ground cause; the total slip is B d - b.
    e : (r,) array
        Gaps between the state before the step and obstacles at the end of the step; negative for overlaps.

    Examples
    --------
    >>> program = vx.StepProgram(vx.Operators(K=np.eye(1), B=np.eye(1)), g=[3.0], w=[1.0], b=[0.0])
    >>> program.certify(d=[2.0], lam=[1.0]).gap
    0.0
    """

    operators: Operators
    g: Floats
    w: Floats
    b: Floats
    e: Floats = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        for name, count in zip("gwbe", self.operators.sizes, strict=True):
            array = np.asarray(getattr(self, name))
            if array.shape != (count,):
                raise SceneError(f"StepProgram: {name}: found {shape_in_words(array)}; wanted ({count},).")
            object.__setattr__(self, name, read_only(array.view()))

    @property
    def data(self) -> tuple[Floats, Floats, Floats, Floats]:
        """The data g, w, b and e of the step."""
        return self.g, self.w, self.b, self.e

    @property
    def stuck(self) -> Bools:
        """A mask (m,) of terms that always stick."""
        return np.asarray(self.w == np.inf)

    @property
    def finite_weights(self) -> Floats:
        """The weights w (m,), with zeros for terms that always stick."""
        return np.where(self.stuck, 0.0, self.w)

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The shapes of the increments d and of the multipliers lam and p."""
        return {"d": self.g.shape, "lam": (len(self.w), self.operators.block), "p": self.e.shape}

    @cached_property
    def size(self) -> float:
        """A scale for the energy norm |d|_K."""
        operators, top = self.operators, float(np.abs(self.g).max(initial=0.0))
        unit = float(power_of_two(top))
        size = unit * float(np.sqrt(operators.factor.energy(self.g / unit))) if top > 0 else 0.0
        soft = operators.limit_flexibility + operators.compliance
        pushed = np.maximum(-self.e, 0.0) / np.sqrt(np.where(soft > 0, soft, 1.0))
        way, flexible = lengths(operators.blocks(self.b)), operators.norm_flexibility
        drawn = np.where(self.stuck, way, 0.0) / np.sqrt(np.where(flexible > 0, flexible, 1.0))
        size = max(size, float(pushed.max(initial=0.0)), float(drawn.max(initial=0.0)))
        return size or float(np.sqrt(self.finite_weights @ way))

    def slip(self, d: Floats) -> Floats:
        """Return s = B d - b, as (m, block)."""
        return self.operators.blocks(self.operators.B @ d - self.b)

    def excess(self, d: Floats) -> Floats:
        """Return z = D d - e, (r,)."""
        return np.asarray(self.operators.D @ d - self.e)

    def zero_levels(self, d: Floats) -> tuple[Floats, Floats]:
        """Return the levels below which slips (m,) and excesses (r,) count as zero."""
        operators, rows = self.operators, len(self.b)
        way, reach = operators.absolute[1] @ np.abs(d), self.size
        slips = max((way[:rows] + np.abs(self.b)).max(initial=0.0), 0.0)
        of_terms = np.maximum(reach * np.sqrt(operators.norm_flexibility), slips)
        of_limits = np.maximum(reach * np.sqrt(operators.limit_flexibility), way[rows:].max(initial=0.0))
        return STILL_TOLERANCE * of_terms, STILL_TOLERANCE * of_limits

    def residual(self, d: Floats, lam: Floats, p: Floats) -> Floats:
        """Return the residual r = g - B'lam - D'p - K d, the unbalanced forces (n,)."""
        return self.g - self.operators.multiplier_force(lam, p) - product(self.operators.K, d)

    def objective(self, d: Floats) -> float:
        """Return the energy that the step minimises, or infinity if d violates a constraint."""
        z, c = self.excess(d), self.operators.compliance
        over = np.where(z <= self.zero_levels(d)[1], 0.0, z)
        s = lengths(self.slip(d))
        if (over[c == 0] > 0).any() or (s > self.zero_levels(d)[0])[self.stuck].any():
            return np.inf
        pressed = 0.5 * float(over[c > 0] @ (over[c > 0] / c[c > 0]))
        return float(0.5 * d @ product(self.operators.K, d) - self.g @ d + self.finite_weights @ s) + pressed

    def project(self, lam: Floats) -> Floats:
        """Return the multipliers (m, block) nearest to `lam` with |lam_i| <= w_i."""
        return onto_discs(lam, self.w)

    def admissible(self, lam: Floats, p: Floats, d: Floats) -> tuple[Floats, Floats]:
        """Return admissible multipliers near (lam, p)."""
        lam, p, N = self.project(lam), np.maximum(p, 0.0), self.operators.kernel
        if N is None or has_diverged(d):
            return lam, p
        s, z = lengths(self.slip(d)), np.abs(self.excess(d) - self.operators.compliance * p)
        level = 1e-6 * max(s.max(initial=0.0), z.max(initial=0.0)) or 1.0
        weights = level / (level + s), level / (level + z)
        return balance_multipliers((lam, p), self.w, self.operators.kernel_modes, N.T @ self.g, weights)

    def find_unbalanced_motion(self) -> Floats | None:
        """Return v with K v = 0, |v| <= 1 and the largest gain g'v - sum w_i |B_i v|, or None."""
        import cvxpy as cp

        if (N := self.operators.kernel) is None:
            return None
        push, modes, rows = N.T @ self.g, self.operators.kernel_modes, len(self.b)
        c, largest = cp.Variable(len(push)), np.abs(push).max(initial=0.0) or 1.0
        gain: cp.Expression = (push / largest) @ c
        if rows:
            slips = cp.reshape(modes[:rows] @ c, (self.operators.block, len(self.w)), order="F")
            gain -= (self.finite_weights / largest) @ cp.norm(slips, axis=0)
        limits = [modes[rows:] @ c <= 0] if len(self.e) else []
        held = np.flatnonzero(np.repeat(self.stuck, self.operators.block))
        limits += [modes[held] @ c == 0] if len(held) else []
        problem = cp.Problem(cp.Maximize(gain), [cp.norm(c) <= 1, *limits])
        with warnings.catch_warnings(), suppress(cp.error.SolverError):
            warnings.simplefilter("ignore")  # cvxpy warns of inaccurate answers
            problem.solve(solver="CLARABEL", tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12)
        return None if c.value is None or not problem.value > GAIN_TOLERANCE else np.asarray(N @ c.value)

    def multipliers(self, d: Floats, lam: Floats | None = None, p: Floats | None = None) -> tuple[Floats, Floats]:
        """Return admissible multipliers for `d`; missing multipliers are computed from d."""
        if lam is not None and p is not None:
            return self.admissible(lam, p, d)
        read = (self.admissible(*self._read_off(d, lam, p, lawful), d) for lawful in (False, True))
        return min(read, key=lambda pair: self.duality_gap(d, *pair))

    def admissible_point(
        self, d: Floats, lam: Floats | None = None, p: Floats | None = None
    ) -> tuple[Floats, Floats, Floats]:
        """Return increments near d that obey the bounds, and admissible multipliers."""
        d = self.feasible(d)
        return d, *self.multipliers(d, lam, p)

    def _read_off(self, d: Floats, lam: Floats | None, p: Floats | None, lawful: bool) -> tuple[Floats, Floats]:
        operators, rows, c = self.operators, len(self.b), self.operators.compliance
        x = np.append(np.zeros(rows) if lam is None else lam, np.zeros(len(c)) if p is None else p)
        free = np.repeat([lam is None, p is None], [rows, len(c)])
        if lawful:
            s, z, (slips, lacks) = self.slip(d), self.excess(d), self.zero_levels(d)
            size = np.where((lengths(s) <= slips) | self.stuck, 0.0, lengths(s))
            of_terms = self.finite_weights[:, None] * directions(s, size)
            law = of_terms, np.where(z > lacks, z, 0.0) / np.where(c > 0, c, np.inf)
            known = np.append(np.repeat(size > 0, operators.block), (c > 0) | (z < -lacks))
            x, free = np.where(free & known, np.append(*law), x), free & ~known
        if operators.own_columns is None:
            near, free_terms = (operators.blocks(x[:rows]), x[rows:]), operators.blocks(free[:rows] * 1.0).max(axis=1)
            push = self.g - product(operators.K, d)
            return balance_multipliers(near, self.w, operators.A.toarray(), push, (free_terms, free[rows:] * 1.0))
        A, force = operators.A, self.residual(d, x[:rows], x[rows:])
        x = np.where(free, x + force[A.indices] / A.data, x)
        return operators.blocks(x[:rows]), x[rows:]

    def certify(self, d: ArrayLike, lam: ArrayLike | None = None, p: ArrayLike | None = None) -> Certificate:
        """Bound the distance of d from the solution d*: |d - d*|_K <= error (:mod:`.certificate`).

        Parameters
        ----------
        d : (n,) array
            Increments. The gap is infinite if d violates a bound (see :meth:`StepProgram.feasible`).
        lam : (m, block) or (m * block,) array, optional
            Multipliers of the norm terms, K d = g - B'lam - D'p. They are made admissible, or computed from d.
        p : (r,) array, optional
            Multipliers of the limits, made admissible or computed from d.

        Returns
        -------
        Certificate

        Raises
        ------
        SceneError
            An array has a wrong shape or is not finite, or a weight of the program is negative or not a number.
        """
        if not (self.w >= 0).all():
            i = int(np.argmin(self.w >= 0))
            raise SceneError(f"certify: found the weight {self.w[i]:.6g} of term {i}; weights are >= 0.")
        given = {"d": d} | {key: x for key, x in (("lam", lam), ("p", p)) if x is not None}
        names = {key: f"certify: {key}" for key in given}
        read = {key: finite(as_array_of_shape(x, names[key], self.shapes[key]), names[key]) for key, x in given.items()}
        return self.certificate_at(read["d"], *self.multipliers(**read))

    def certificate_at(self, d: Floats, lam: Floats, p: Floats, before: Floats | float = 0.0) -> Certificate:
        """Return the certificate of `d`, by the theorem with the smaller bound."""
        operators, s, z = self.operators, self.slip(d), self.excess(d)
        if has_diverged(d):
            return Certificate(np.inf, np.zeros(len(s)), 0.0, np.zeros(len(z)))
        # Errors of K^{-1} may make the energy negative.
        equilibrium = abs(0.5 * operators.factor.energy(self.residual(d, lam, p)))
        if operators.kernel is not None and np.greater(*np.abs(self._imbalance(operators.kernel, lam, p))).any():
            equilibrium = np.inf
        friction, limits = norm_gaps(self.w, lam, s), limit_gaps(operators.compliance, p, z)
        plain = Certificate(equilibrium, friction, self.rounding_floor(d, lam, p, before), limits)
        if plain.terms <= equilibrium:
            return plain
        return min(plain, self._certify_after_move(d, lam, p, plain), key=lambda found: found.gap)

    def duality_gap(self, d: Floats, lam: Floats, p: Floats) -> float:
        """Return the gap of the certificate for admissible multipliers."""
        return self.certificate_at(d, lam, p).gap

    def _certify_after_move(self, d: Floats, lam: Floats, p: Floats, plain: Certificate) -> Certificate:
        """Return the certificate by theorem 2 (:mod:`vemcvx.program.certificate`)."""
        operators, s, z, (slips, lacks) = self.operators, self.slip(d), self.excess(d), self.zero_levels(d)
        met, size = operators.compliance * p, lengths(s)
        near = ((p > 0) | (z > 0)) & (np.abs(z - met) <= lacks)
        still = self.stuck | ((size <= slips) & (size**2 <= plain.friction * operators.norm_flexibility))
        held = np.append(np.repeat(still, operators.block), near)
        v = operators.move(held, np.append(s, z - met)[held])
        s = np.where(still[:, None], 0.0, s - operators.blocks(operators.B @ v))
        z = np.where(near, met, z - operators.D @ v)
        z = np.where((operators.compliance == 0) & (z <= lacks), np.minimum(z, 0.0), z)
        friction, limits = norm_gaps(self.w, lam, s), limit_gaps(operators.compliance, p, z)
        return replace(plain, friction=friction, limits=limits, moved=2.0 * operators.energy_norm(v))

    def _imbalance(self, N: Floats, lam: Floats, p: Floats) -> tuple[Floats, Floats]:
        """Return N'(g - B'lam - D'p) with a basis N of the kernel of K, and a bound on the rounding error."""
        size, x, modes = np.abs(self.g), np.append(lam, p), self.operators.kernel_modes
        # g is a difference of forces that may be larger than g.
        terms = np.abs(N).T @ (size + size.max(initial=0.0) / 8) + np.abs(x) @ np.abs(modes)
        return N.T @ self.g - x @ modes, ROUNDED * terms

    def rounding_floor(self, d: Floats, lam: Floats, p: Floats, before: Floats | float = 0.0) -> float:
        """Return the energy of the rounding errors of the residual r."""
        if has_diverged(d):
            return 0.0
        forces = np.abs(self.g) + self.operators.absolute[1].T @ np.abs(np.append(lam, p))
        rounding = self.operators.rounding(forces, np.abs(d) + np.abs(before))
        return float(self.operators.energies_of_rounding(rounding))

    def to_cvxpy(self) -> CvxpyStep:
        """Return the program in cvxpy, for any solver that cvxpy can call.

        Returns
        -------
        CvxpyStep
            The `problem`, the variable `d`, and the multipliers `lam` and `p` with the signs of this class.

        Raises
        ------
        SceneError
            The program has no unknowns.

        Examples
        --------
        >>> program = vx.StepProgram(vx.Operators(K=np.eye(1), B=np.eye(1)), g=[3.0], w=[1.0], b=[0.0])
        >>> posed = program.to_cvxpy()
        >>> posed.problem.solve(solver="CLARABEL").round(6)
        np.float64(-2.0)
        >>> bool(program.certify(program.feasible(posed.d.value), posed.lam, posed.p).error < 1e-4)
        True
        """
        if len(self.g) == 0:
            raise SceneError("to_cvxpy: the program has no unknowns left to solve for; take condense=False.")
        data = self.g, self.finite_weights, self.b, self.e
        return to_cvxpy(self.operators, data, self.stuck)

    def feasible(self, d: Floats) -> Floats:
        """Return increments (n,) close to d that satisfy the bounds."""
        D, rigid = self.operators.D, np.flatnonzero(self.operators.compliance == 0)
        if not (self.excess(d)[rigid] > 0).any():
            return d
        if not (np.diff(D.indptr)[rigid] == 1).all():
            return self._project_onto_limits(d, rigid.astype(np.int64))
        column, coefficient, moved = D.indices[D.indptr[rigid]], D.data[D.indptr[rigid]], d.copy()
        edge, upper = self.e[rigid] / coefficient, coefficient > 0
        np.minimum.at(moved, column[upper], edge[upper])
        np.maximum.at(moved, column[~upper], edge[~upper])
        return moved

    def _project_onto_limits(self, d: Floats, rigid: Ints) -> Floats:
        from scipy.optimize import nnls

        rows = np.zeros(0, dtype=np.int64)
        for _ in range(len(rigid) + 4):
            z = self.excess(d)[rigid]
            over = np.flatnonzero(z > self.zero_levels(d)[1][rigid])
            if len(over) == 0:
                break
            rows = np.union1d(rows, over)
            D = self.operators.D[rigid[rows]].toarray()
            spread = self.operators.factor.solve(np.ascontiguousarray(D.T))
            W = D @ spread
            lift = 1e-12 * W.max() or 1.0  # Linearly dependent rows make W singular.
            R = np.linalg.cholesky(W + lift * np.eye(len(W))).T
            push = nnls(R, np.linalg.solve(R.T, z[rows]), maxiter=100 * len(rows))[0]
            d = d - spread @ push
        return d


@dataclass(frozen=True, repr=False, eq=False)
class Answer(ArrayRecord):
    """A solver's answer to one step, without a certificate.

    Parameters
    ----------
    d : (n,) array
        Increments.
    lam : (m, block) array
        Multipliers of the norm terms, K d = g - B'lam - D'p.
    iterations : int
        Number of iterations.
    status : str
        The solver's status, for messages.
    p : (r,) array
        Multipliers of the limits.

    Examples
    --------
    >>> vx.Answer(d=np.array([2.0]), lam=np.array([[1.0]]), iterations=3).iterations
    3
    """

    d: Floats
    lam: Floats
    iterations: int
    status: str = ""
    p: Floats = field(default_factory=lambda: np.zeros(0))


def read_answer(raw: Any, program: StepProgram, solver: str) -> Answer:
    """Return a solver's return value as an Answer, or raise SolverFailed."""
    own, shapes = isinstance(raw, Answer), program.shapes
    parts = (raw.d, raw.lam, raw.p, raw.iterations) if own else raw if isinstance(raw, tuple) else (raw,)
    counted = len(parts) > 1 and is_whole(parts[-1])
    parts, iterations = (parts[:-1], int(parts[-1])) if counted else (parts, 0)
    read = {key: np.zeros(shape) for key, shape in shapes.items() if 0 in shape}
    for key, part in zip(shapes, parts if len(parts) <= len(shapes) else (), strict=False):
        # In an Answer, missing multipliers are empty arrays.
        if not (part is None or (isinstance(part, np.ndarray) and part.size == 0)):
            try:
                read[key] = as_array_of_shape(part, f"solver {solver}: {key}", shapes[key])
            except SceneError as error:
                raise SolverFailed(str(error)) from None
            if has_diverged(read[key]):
                size = float(np.abs(read[key]).max())
                raise SolverFailed(f"solver {solver}: {key} reaches {size:.1e}: the solver has diverged.")
    if "d" not in read:
        raise SolverFailed(
            f"solver {solver}: found the answer {brief(raw)}; it must return vx.Answer(d, lam, iterations), "
            "(d, lam, p), (d, lam), or d; a tuple may end with the number of iterations."
        )
    d, lam, p = read["d"], read.get("lam"), read.get("p")
    if lam is None or p is None:
        d, lam, p = program.admissible_point(d, lam, p)
    return replace(raw, d=d, lam=lam, p=p) if own else Answer(d, lam, iterations, p=p)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class SolvedProgram(StepProgram):
    """The :class:`StepProgram` of one step, with the answer. The weights `w` are the weights at the answer.

    Parameters
    ----------
    answer : Answer
        Increments d, and multipliers lam and p.
    step : int
        Number of the step; step 1 begins at the initial instant.
    t : float
        The instant at the end of the step.
    slope : (m, r) sparse matrix, optional
        Derivatives dw/dp of the weights by the forces of limits. Under Coulomb's law, they are friction coefficients.
    origin : mapping
        The origin of the program in words and numbers: "scene", "mesh", "solver".

    Examples
    --------
    >>> system = vx.System(K=np.eye(1), load=lambda t: [3.0 * t], norms=vx.Norms(B=np.eye(1), w=1.0))
    >>> [float(program.answer.d[0]) for program in vx.programs_of_march(system, [0.0, 0.5, 1.0])]
    [0.5, 1.5]
    """

    answer: Answer
    step: int
    t: float
    slope: sp.csr_matrix | None = None
    origin: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def certificate(self) -> Certificate:
        """The certificate of the answer."""
        return self.certify(self.answer.d, self.answer.lam, self.answer.p)

    @cached_property
    def norm(self) -> float:
        """The energy norm |d|_K of the increments."""
        return self.operators.energy_norm(self.answer.d)

    @cached_property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper bound on the minimal objective, including rounding."""
        d, lam, p = self.answer.d, *self.multipliers(self.answer.d, self.answer.lam, self.answer.p)
        value, size, c = self.objective(d), np.abs(d), self.operators.compliance
        terms = 0.5 * size @ product(self.operators.absolute[0], size) + np.abs(self.g) @ size
        rounding = self.certificate.floor + (len(d) + 2) * EPS * float(terms + np.abs(value))
        z = np.where(c > 0, self.excess(d), np.minimum(self.excess(d), 0.0))
        s = np.where(self.stuck[:, None], 0.0, self.slip(d))
        parts = norm_gaps(self.w, lam, s).sum() + limit_gaps(c, p, z).sum()
        return value - self.certificate.equilibrium - float(parts) - rounding, value + rounding
