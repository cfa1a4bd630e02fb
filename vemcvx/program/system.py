"""A system K y + B'lam + D'p = f(t) in plain arrays, with supports that move: what `march` takes.

It is a quasistatic variational inequality in coordinates: problem 2.1 of the paper with a(u, v) = v'Ku, <l(t), v> =
v'load(t) and the seminorm j(v) = sum_i w_i |B_i v|. Nothing here knows of meshes or of contact. `Norms` are terms
w_i |B_i y|, with the laws of their weights; `Limits` are bounds D_j y <= e_j and their soft kin; `Motion` is what
supports that move add to the energy, to the norm terms and to the limits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from inspect import signature
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.base.arrays import (
    EPS,
    Floats,
    Ints,
    as_real_array,
    at_instant,
    brief,
    called,
    checked_matrix,
    finite,
    function,
    instance,
    shaped,
    spread,
)
from vemcvx.base.errors import SceneError
from vemcvx.base.outline import ArrayRecord
from vemcvx.base.weight_law import Law
from vemcvx.linear import LinearSolver, choose_linear, direct_solver
from vemcvx.program.kernel import Kernel, rank_on
from vemcvx.program.operators import SYMMETRIC, check_symmetric, fixed_rows, whole_blocks

DRAG_ROUNDING = 16 * EPS
"""Slips below this part of the positions that they are differences of are zero but for rounding: they drag nothing."""


class Rows(ArrayRecord):
    """The base of norm terms and limits: several of one `kind`, with places and numbers."""

    kind: ClassVar[str]
    places: Callable[[int], str] | None

    @property
    def count(self) -> int:
        """How many there are."""
        raise NotImplementedError

    def name(self, i: int) -> str:
        """Return the place of number `i`, in words."""
        if self.places is None:
            return f"{self.kind} {i}"
        asked = "take the number of a term and say where it acts"
        return str(called(self.places, (i,), f"{type(self).__name__}: places failed", asked))

    def numbers(self, raw: Any, name: str, what: str = "number", signed: bool = False) -> Floats:
        """Return a finite number each (count,), not negative unless they are `signed`."""
        wanted, owner = f"a {what}, or ({self.count},) of them, one a {self.kind.split()[-1]}", type(self).__name__
        found = finite(shaped(raw, f"{owner}: {name}", wanted, (), (self.count,)), f"{owner}: {name}")
        found = np.full(self.count, found)
        if not signed and (found < 0).any():
            i = int(np.argmin(found))
            raise SceneError(f"{owner}: found the {what} {found[i]:.6g} of {self.name(i)}; it must be >= 0.")
        return found


@dataclass(frozen=True, repr=False)
class Norms(Rows):
    """The terms w_i |B_i v|: rows i * block ... (i + 1) * block of B make the vector B_i v.

    Parameters
    ----------
    B : (m * block, n) array or sparse matrix
    w : (m,) array, or callable t -> (m,)
        Weights >= 0.
    block : int
        Components of one vector: 1 on a curve in the plane, 2 on a surface in space.
    places : callable i -> str, optional
        Where term i acts, in words, for messages.
    law : Law, optional
        Weights that follow the answer of a step (:mod:`vemcvx.base.weight_law`); `w` are then the weights where no
        limit acts.
    ground : callable t -> (m * block,), optional
        The displacement g of the ground: slips are relative to it, w_i |B_i (y - y_prev) - (g_i - g_i,prev)|, and its
        motion does work.
    """

    B: Any
    w: ArrayLike | Callable[[float], ArrayLike]
    block: int = 1
    places: Callable[[int], str] | None = None
    law: Law | None = None
    ground: Callable[[float], Any] | None = None

    kind: ClassVar[str] = "norm term"

    def __post_init__(self) -> None:
        object.__setattr__(self, "B", fixed_rows(self.B, "Norms: B"))
        object.__setattr__(self, "block", whole_blocks(self.block, self.B.shape[0], "Norms"))
        function(self.places, "Norms: found places", "a function of i that says where term i acts")
        function(self.ground, "Norms: found ground", "a function of t that says how far the ground has moved")
        instance(self.law, Law, "Norms: found law", "a Law(weights)")
        if self.law is not None and self.law.softening is not None:
            softening = self.numbers(self.law.softening, "softening", "softening")
            object.__setattr__(self, "law", replace(self.law, softening=softening))
        if not callable(self.w):
            object.__setattr__(self, "w", self.numbers(self.w, "w", "weight"))

    @property
    def count(self) -> int:
        """The number of norm terms m."""
        return int(self.B.shape[0]) // self.block

    @property
    def sloped(self) -> bool:
        """True if the derivative of the law by the forces of the limits is known."""
        return self.law is not None and self.law.slope is not None

    @property
    def remembers(self) -> bool:
        """True if weights depend on slips."""
        return self.law is not None and self.law.slips

    @property
    def softening(self) -> Floats | None:
        """The rate (m,) at which weights fall with slip at most, if it is known."""
        known: Any = None if self.law is None else self.law.softening
        return known

    def weights(self, t: float) -> Floats:
        """Return weights (m,) at the instant `t`."""
        w = self.w  # An array was checked when it was given.
        return w if isinstance(w, np.ndarray) else self.numbers(at_instant(w, t, "Norms: w"), "w", "weight")

    def weights_under(self, t: float, p: Floats, past: Floats | None = None, slip: Floats | None = None) -> Floats:
        """Return weights (m,) at `t` under forces `p` (r,) of limits, after slips (m,) before the step and in it."""
        if self.law is None:
            return self.weights(t)
        slips = (np.zeros(self.count) if x is None else x for x in (past, slip))
        failed = f"Norms: law: its function failed when called as f(t, p, past, slip) with t = {t:.6g}"
        return self.numbers(called(self.law.weights, (t, p, *slips), failed, "return weights"), "w", "weight")

    def slope_by_forces(self, t: float, p: Floats, past: Floats) -> sp.csr_matrix | None:
        """Return the derivative (m, r) of the law by the forces p (r,) of limits, at `t` after slips (m,), if known."""
        if self.law is None or self.law.slope is None:
            return None
        failed = f"Norms: slope: its function failed when called as f(t, p, past) with t = {t:.6g}"
        J = called(self.law.slope, (t, p, past), failed, "return the law's derivative")
        return checked_matrix(J, "Norms: slope", (self.count, len(p)))


@dataclass(frozen=True, repr=False)
class Limits(Rows):
    """Row j of D, the limit e_j and the compliance c_j.

    With z_j = D_j y - e_j: a bound z_j <= 0 where c_j = 0; the energy (z_j)_+^2 / (2 c_j) where c_j > 0. The multiplier
    p_j >= 0 is the force with which the limit answers, z_j <= c_j p_j with equality where p_j > 0.

    Parameters
    ----------
    D : (r, n) array or sparse matrix
    e : (r,) array, or callable t -> (r,)
        +inf in an array is no limit: its row reads nothing.
    compliance : number or (r,) array
        Displacement per force, >= 0.
    places : callable j -> str, optional
        Where limit j acts, in words, for messages.
    """

    D: Any
    e: ArrayLike | Callable[[float], ArrayLike]
    compliance: Any = 0.0
    places: Callable[[int], str] | None = None

    kind: ClassVar[str] = "limit"

    def __post_init__(self) -> None:
        object.__setattr__(self, "D", fixed_rows(self.D, "Limits: D"))
        function(self.places, "Limits: found places", "a function of j that says where limit j acts")
        object.__setattr__(self, "compliance", self.numbers(self.compliance, "compliance", "compliance"))
        if callable(self.e):
            return
        e = as_real_array(self.e, "Limits: e", "numbers")
        none = (e == np.inf) & (e.ndim == 1)
        object.__setattr__(self, "e", self.numbers(np.where(none, 1.0, e), "e", signed=True))
        if none.any():
            object.__setattr__(self, "D", fixed_rows(sp.diags_array(np.where(none, 0.0, 1.0)) @ self.D, "Limits: D"))

    @property
    def count(self) -> int:
        """The number of limits r."""
        return int(self.D.shape[0])

    def remaining_gap(self, t: float) -> Floats:
        """Return e (r,) at the instant `t`."""
        e = self.e  # An array was checked when it was given.
        return e if isinstance(e, np.ndarray) else self.numbers(at_instant(e, t, "Limits: e"), "e", signed=True)


@dataclass(frozen=True)
class DraggedTerms:
    """Norm terms that no unknown moves, w_i |c_i(t_n) - c_i(t_{n-1})|: constants of a step's program, and losses."""

    position: Callable[[float], Floats]
    """t -> (q * block,), c: of the supports, less that of the ground"""
    weights: Callable[[float, Floats, Floats, Floats], Floats]
    """(t, p, past, slip) -> (q,), as of norm terms that follow the answer"""
    count: int
    block: int = 1
    remembers: bool = False
    """whether weights depend on slips"""


@dataclass(frozen=True)
class ForceOnPart:
    """A force that acts on some of n unknowns alone: their numbers `rows`, ascending, and t -> the forces there."""

    n: int
    rows: Ints
    entries: Callable[[float], Floats]

    def __call__(self, t: float) -> Floats:
        """Return all forces (n,)."""
        return spread(self.entries(t), self.rows, self.n)


def on_part(force: Callable[[float], Floats], t: float) -> tuple[Floats, Ints | None]:
    """Return a force at the instant `t`, and the unknowns that it acts on; None for all of them."""
    return (force.entries(t), force.rows) if isinstance(force, ForceOnPart) else (force(t), None)


@dataclass(frozen=True)
class Motion:
    """The terms of moving supports: u = P y + u_D(t), with A the matrix of a over all of u.

    a(u, u) = y'Ky + 2 y'dirichlet_force + stored, and the norm terms measure B (y - y_prev) plus the prescribed slip,
    less that of the step before. Where the supports move far, and strain little, these sums cancel; `frame` and `pair`
    give the same without.
    """

    dirichlet_force: Callable[[float], Floats]
    """t -> (n,), P'A u_D"""
    prescribed_slip: Callable[[float], Floats]
    """t -> (m * block,), what u_D adds to the argument of the norms"""
    stored: Callable[[float, float], float]
    """(s, t) -> u_D(s)'A u_D(t)"""
    frame: Callable[[float, Floats], Floats]
    """(t, y) -> (n_u,), u seen from the body: less a motion that strains nothing"""
    pair: Callable[[Floats, Floats], float]
    """a of two such fields"""
    remaining_gap: Callable[[float], Floats] | None = None
    """t -> (r,), what u_D takes from the limits"""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not callable(value) and not (name == "remaining_gap" and value is None):
                raise SceneError(f"Motion: found {name} = {brief(value)}; wanted a function.")


@dataclass(frozen=True, repr=False)
class Damping(ArrayRecord):
    """The form b of the rate, b(u', v), beside a(u, v).

    Parameters
    ----------
    C : (n, n) array or sparse matrix
        Symmetric, positive semidefinite.
    motion : Motion, optional
        What moving supports add, with the matrix of b in place of that of a; its slips and gaps are not read.
    """

    C: Any
    motion: Motion | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "C", fixed_rows(self.C, "Damping: C"))
        check_symmetric(self.C, "Damping: C")
        shift = SYMMETRIC * np.abs(self.C.data).max(initial=0.0) or 1.0
        try:
            direct_solver(self.C.shape[0]).factorise(sp.csr_matrix(self.C + shift * sp.eye_array(self.C.shape[0])))
        except SceneError as error:
            raise SceneError(
                "Damping: C: found a matrix that is not positive semidefinite: some motion would gain energy from it."
            ) from error
        instance(self.motion, Motion, "Damping: found motion", "a Motion")


@dataclass(frozen=True, repr=False)
class System(ArrayRecord):
    """K, the load, and the norm terms; the load already includes minus the Dirichlet force of moving supports.

    Parameters
    ----------
    K : (n, n) array or sparse matrix
        Symmetric, positive definite; semidefinite if `kernel` says where.
    load : callable t -> (n,)
    norms : Norms, optional
    motion : Motion, optional
        Bookkeeping of supports that move; a plain system has none.
    order : (n,) permutation, or callable () -> (n,) permutation, optional
        An order of elimination with little fill, for linear solvers that do not find one; by default one is computed
        from K.
    near_kernel : (n, k) array, optional
        Motions of little energy (rigid ones), for iterative linear solvers.
    kernel : Kernel, optional
        The motions of no energy, all of which the norm terms must feel. Answers are then unique, and certified, in the
        seminorm of K only.
    limits : Limits, optional
        Bounds on y, hard or soft.
    damping : Damping, optional
        A force C y' of the rate; the lengths of steps then matter.
    dragged : DraggedTerms, optional
        Norm terms whose slip is given by the supports; they change no state, and their losses are in the ledger.
    """

    K: Any
    load: Callable[[float], ArrayLike]
    norms: Norms | None = None
    motion: Motion | None = None
    order: Any = None
    near_kernel: Any = None
    kernel: Kernel | None = None
    limits: Limits | None = None
    damping: Damping | None = None
    dragged: DraggedTerms | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "K", fixed_rows(self.K, "System: K"))
        check_symmetric(self.K, "System: K")
        diagonal, largest = self.K.diagonal(), self.K.diagonal().max(initial=0.0)
        # The kernel of a body that is rigid altogether has unknowns without stiffness, but for rounding.
        if (diagonal <= (0.0 if self.kernel is None else -SYMMETRIC * largest)).any():
            i = int(np.argmin(diagonal))
            raise SceneError(f"System: found K[{i}, {i}] = {diagonal[i]:.6g}; K must be positive definite.")
        if not callable(self.load):
            raise SceneError(
                f"System: found load = {brief(self.load)}; wanted a function of t that gives ({self.n},) forces."
            )
        parts = {"norms": Norms, "limits": Limits, "motion": Motion, "damping": Damping, "kernel": Kernel}
        for name, kind in (parts | {"dragged": DraggedTerms}).items():
            instance(getattr(self, name), kind, f"System: found {name}", f"{kind.__name__}(...)")
        columns = {"norms": self.B, "limits": self.D, "damping": getattr(self.damping, "C", self.K)}
        for name, matrix in columns.items():
            if matrix.shape[1] != self.n:
                raise SceneError(f"System: found {name} over {matrix.shape[1]} unknowns, but K has {self.n}.")
        if self.order is not None and not callable(self.order):
            object.__setattr__(self, "order", self._permutation(self.order))
        if self.near_kernel is not None:
            wanted = f"({self.n}, k) motions of little energy, one a column"
            found = as_real_array(self.near_kernel, "System: near_kernel", wanted)
            if found.ndim != 2 or len(found) != self.n or not found.shape[1] or not np.isfinite(found).all():
                raise SceneError(f"System: found near_kernel = {brief(self.near_kernel)}; wanted {wanted}, or None.")
            object.__setattr__(self, "near_kernel", found)
        if self.kernel is not None:
            self._check_kernel(self.kernel)

    def _check_kernel(self, kernel: Kernel) -> None:
        N = kernel.modes
        if len(N) != self.n:
            raise SceneError(
                f"System: found a kernel over {len(N)} unknowns; wanted one column of {self.n} and one name a motion."
            )
        work = np.abs(self.K @ N).max(axis=0, initial=0.0) > SYMMETRIC * np.abs(self.K.data).max() * np.abs(N).max()
        if work.any():
            raise SceneError(f"System: K feels {kernel.names[int(np.argmax(work))]}, which is no motion of its kernel.")
        if rank_on(sp.csr_matrix(sp.vstack([self.B, self.D])), N) < N.shape[1]:
            raise SceneError(
                f"System: a motion of K's kernel ({', '.join(kernel.names)}) is felt by no norm term and no limit: "
                "nothing holds it. Add stiffness, norm terms or limits that do."
            )

    def _permutation(self, raw: ArrayLike) -> Ints:
        wanted = f"a permutation of the {self.n} unknowns, or None"
        order = as_real_array(raw, "System: order", wanted)
        if order.ndim != 1 or not np.array_equal(np.sort(order), np.arange(self.n)):
            raise SceneError(f"System: found order = {brief(raw)}; wanted {wanted}.")
        return order.astype(np.int64)

    @property
    def n(self) -> int:
        """The number of unknowns."""
        return int(self.K.shape[0])

    @cached_property
    def B(self) -> sp.csr_matrix:
        """(m * block, n) the rows of the norm terms."""
        return sp.csr_matrix((0, self.n)) if self.norms is None else self.norms.B

    @cached_property
    def D(self) -> sp.csr_matrix:
        """(r, n) the rows of the limits."""
        return sp.csr_matrix((0, self.n)) if self.limits is None else self.limits.D

    @property
    def block(self) -> int:
        """Components of a slip: those of norm terms, or where there are none of dragged ones; else 1."""
        terms = self.norms or self.dragged
        return 1 if terms is None else terms.block

    @property
    def follows_answer(self) -> bool:
        """True if weights of norm terms depend on the answer of the step."""
        return self.norms is not None and self.norms.law is not None

    @property
    def retained(self) -> Ints:
        """(m,) the unknowns that norm terms or limits read: all others are eliminated."""
        return np.unique(np.concatenate([A.indices[A.data != 0].astype(np.int64) for A in (self.B, self.D)]))

    def remaining_gap(self, t: float) -> Floats:
        """Return the gaps e (r,) of the limits at the instant `t`, moving supports accounted for."""
        if self.limits is None:
            return np.zeros(0)
        e = self.limits.remaining_gap(t)
        return e if self.motion is None or self.motion.remaining_gap is None else e - self.motion.remaining_gap(t)

    def prescribed_slip(self, t: float) -> Floats:
        """Return the part of the norm terms' arguments (m * block,) that supports bring, less that of the ground."""
        given = np.zeros(self.B.shape[0]) if self.motion is None else self.motion.prescribed_slip(t)
        return given if (ground := self.ground(t)) is None else given - ground

    def ground(self, t: float) -> Floats | None:
        """Return the motion (m * block,) up to the instant `t` of the ground of norm terms; None if it stands still."""
        if self.norms is None or self.norms.ground is None:
            return None
        rows, subject = self.B.shape[0], "Norms: ground"
        raw = at_instant(self.norms.ground, t, subject)
        return finite(shaped(raw, subject, f"({rows},) ways, one a row of B", (rows,)), subject)

    def linear(self, asked: LinearSolver | None = None) -> LinearSolver:
        """Return the linear solver for K: the one asked for, else by size; SceneError where it cannot be called."""
        if asked is not None:
            try:
                signature(asked.factorise).bind(self.K, None)
            except TypeError as error:
                words = f"linear solver {type(asked).__name__}: wanted factorise(self, K, near_kernel=None); {error}."
                raise SceneError(words) from error
        modes = 0 if self.near_kernel is None else self.near_kernel.shape[1]
        return choose_linear(self.n, asked, modes=modes)

    def elimination_order(self) -> Ints | None:
        """Return the order of elimination (n,), if there is one."""
        if not callable(self.order):
            return self.order
        return self._permutation(called(self.order, (), "System: order: its function failed", "return a permutation"))

    def load_on_part(self, t: float) -> tuple[Floats, Ints | None]:
        """Return the load at the instant `t`, checked, and the unknowns that it acts on; None for all of them."""
        if not isinstance(self.load, ForceOnPart):
            return self.force(t), None
        return finite(self.load.entries(t), f"System: load({t:.6g})"), self.load.rows

    def force(self, t: float) -> Floats:
        """Return the load vector (n,) at the instant `t`, checked."""
        subject, wanted = f"System: load({t:.6g})", f"({self.n},) forces, one an unknown"
        return finite(shaped(at_instant(self.load, t, "System: load"), subject, wanted, (self.n,)), subject)
