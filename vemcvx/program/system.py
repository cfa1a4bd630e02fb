"""A system K y + B'lam + D'p = f(t) in plain arrays, with supports that move: what `march` takes.

It is a quasistatic variational inequality in coordinates: problem 2.1 of the paper with a(u, v) = v'Ku, <l(t), v> =
v'load(t) and the seminorm j(v) = sum_i w_i |B_i v|. Nothing here knows of meshes or of contact. `Limits` are bounds
D_j y <= e_j and their soft kin; `Motion` is what supports that move add to the energy, to the norm terms and to the
limits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.base.arrays import (
    EPS,
    Floats,
    Ints,
    MatrixLike,
    as_real_array,
    at_instant,
    brief,
    called,
    checked_matrix,
    fading,
    finite,
    function,
    instance,
    shape_in_words,
    shaped,
    spread,
)
from vemcvx.base.errors import SceneError
from vemcvx.base.outline import ArrayRecord
from vemcvx.linear import LinearSolver, choose_linear, direct_solver, singular
from vemcvx.program.kernel import Kernel, rank_on
from vemcvx.program.operators import SAY, SYMMETRIC, Norms, check_symmetric

DRAG_ROUNDING = 16 * EPS
"""Slips below this part of the positions that they are differences of are zero but for rounding: they drag nothing."""


@dataclass(frozen=True, repr=False)
class Limits(ArrayRecord):
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

    D: sp.csr_matrix
    e: ArrayLike | Callable[[float], ArrayLike]
    compliance: ArrayLike = 0.0
    places: Callable[[int], str] | None = None

    if TYPE_CHECKING:  # D is given as any matrix

        def __init__(
            self,
            D: MatrixLike,
            e: ArrayLike | Callable[[float], ArrayLike],
            compliance: ArrayLike = 0.0,
            places: Callable[[int], str] | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "D", checked_matrix(self.D, "Limits: D"))
        compliance = self.compliances
        if (compliance < 0).any():
            j = int(np.argmin(compliance))
            raise SceneError(f"Limits: found the compliance {compliance[j]:.6g} of {self.name(j)}; it must be >= 0.")
        object.__setattr__(self, "compliance", compliance)
        function(self.places, "Limits: found places", "a function of j that says where limit j acts")
        if not callable(self.e):
            wanted = f"a number, or ({self.count},) of them, one a limit"
            e = shaped(self.e, "Limits: e", wanted, (), (self.count,))
            if (none := np.broadcast_to(e == np.inf, self.count)).any():
                object.__setattr__(self, "D", sp.csr_matrix(sp.diags_array(np.where(none, 0.0, 1.0)) @ self.D))
            object.__setattr__(self, "e", self._shaped(np.where(e == np.inf, 1.0, e), "Limits: e"))

    @property
    def compliances(self) -> Floats:
        """c (r,)."""
        return self._shaped(self.compliance, "Limits: compliance")

    @property
    def count(self) -> int:
        """The number of limits r."""
        return self.D.shape[0]

    def name(self, j: int) -> str:
        """The place of limit `j`, in words."""
        return f"limit {j}" if self.places is None else str(called(self.places, (j,), "Limits: places failed", SAY))

    def remaining_gap(self, t: float) -> Floats:
        """e (r,) at the instant `t`."""
        e = self.e
        # An array was checked when it was given.
        return e if isinstance(e, np.ndarray) else self._shaped(at_instant(e, t, "Limits: e"), "Limits: e")

    def _shaped(self, raw: ArrayLike, subject: str) -> Floats:
        wanted = f"a number, or ({self.count},) of them, one a limit"
        values = finite(shaped(raw, subject, wanted, (), (self.count,)), subject)
        return np.array(np.broadcast_to(values, (self.count,)))


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
        """All forces (n,)."""
        return spread(self.entries(t), self.rows, self.n)


def on_part(force: Callable[[float], Floats], t: float) -> tuple[Floats, Ints | None]:
    """A force at the instant `t`, and the unknowns that it acts on; None for all of them."""
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

    def sized(self, n: int, rows: int, limits: int) -> Motion:
        """The same motion with functions that check, and copy, every value that they return."""
        shapes: dict[str, tuple[int, ...]] = {
            "dirichlet_force": (n,), "prescribed_slip": (rows,), "stored": (), "pair": (), "remaining_gap": (limits,)
        }  # fmt: skip

        def checked(name: str, function: Callable[..., ArrayLike], *given: Any) -> Any:
            subject, wanted = f"Motion: {name}", f"numbers of shape {shapes.get(name, '(n_u,)')}"
            x = as_real_array(called(function, given, f"{subject} failed", f"return {wanted}"), subject, wanted)
            if shapes.get(name) == () and x.size == 1:
                x = x.reshape(())
            if x.shape != shapes.get(name, x.shape[:1]):
                raise SceneError(f"{subject}: found {shape_in_words(x)}; wanted {wanted}.")
            finite(x, subject)
            return x if x.ndim else float(x)

        functions: dict[str, Any] = {
            name: f if f is None or isinstance(f, ForceOnPart) else partial(checked, name, f)
            for name, f in vars(self).items()
        }
        return Motion(**functions)


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

    C: sp.csr_matrix
    motion: Motion | None = None

    if TYPE_CHECKING:  # C is given as any matrix

        def __init__(self, C: MatrixLike, motion: Motion | None = None) -> None: ...

    def __post_init__(self) -> None:
        C = checked_matrix(self.C, "Damping: C")
        if C.nnz:
            check_semidefinite(C, "Damping: C")
        instance(self.motion, Motion, "Damping: found motion", "a Motion")
        object.__setattr__(self, "C", C)


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

    K: sp.csr_matrix
    load: Callable[[float], ArrayLike]
    norms: Norms | None = None
    motion: Motion | None = None
    order: Ints | Callable[[], Ints] | None = None
    near_kernel: Floats | None = None
    kernel: Kernel | None = None
    limits: Limits | None = None
    damping: Damping | None = None
    dragged: DraggedTerms | None = None

    if TYPE_CHECKING:  # K and the order are given as any matrix and sequence

        def __init__(
            self,
            K: MatrixLike,
            load: Callable[[float], ArrayLike],
            norms: Norms | None = None,
            motion: Motion | None = None,
            order: ArrayLike | Callable[[], ArrayLike] | None = None,
            near_kernel: ArrayLike | None = None,
            kernel: Kernel | None = None,
            limits: Limits | None = None,
            damping: Damping | None = None,
            dragged: DraggedTerms | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "K", checked_matrix(self.K, "System: K"))
        check_symmetric(self.K, "System: K")
        diagonal = self.K.diagonal()
        if (diagonal <= 0).any():
            i = int(np.argmin(diagonal))
            raise SceneError(f"System: found K[{i}, {i}] = {diagonal[i]:.6g}; K must be positive definite.")
        if not callable(self.load):
            raise SceneError(
                f"System: found load = {brief(self.load)}; wanted a function of t that gives ({self.n},) forces."
            )
        for name, kind, wanted in (
            ("norms", Norms, "Norms(B, w)"),
            ("limits", Limits, "Limits(D, e)"),
            ("motion", Motion, "a Motion"),
            ("damping", Damping, "Damping(C)"),
            ("dragged", DraggedTerms, "DraggedTerms"),
            ("kernel", Kernel, "a Kernel(modes, names)"),
        ):
            instance(getattr(self, name), kind, f"System: found {name}", wanted)
        for what, name, rows in (("norms", "B", self.B), ("limits", "D", self.D)):
            if rows.shape[1] != self.n:
                raise SceneError(
                    f"System: found {what} over {rows.shape[1]} unknowns, but K has {self.n}; "
                    f"{name} must have one column an unknown."
                )
        if self.damping is not None and self.damping.C.shape != self.K.shape:
            raise SceneError(f"System: found damping of shape {self.damping.C.shape}, but K has {self.K.shape}.")
        if self.motion is not None:
            object.__setattr__(self, "motion", self.motion.sized(self.n, self.B.shape[0], self.D.shape[0]))
        if self.order is not None and not callable(self.order):
            object.__setattr__(self, "order", permutation(self.order, self.n))
        if self.near_kernel is not None:
            object.__setattr__(self, "near_kernel", motions(self.near_kernel, self.n))
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

    def remaining_gap(self, t: float) -> Floats:
        """The gaps e (r,) of the limits at the instant `t`, moving supports accounted for."""
        if self.limits is None:
            return np.zeros(0)
        e = self.limits.remaining_gap(t)
        return e if self.motion is None or self.motion.remaining_gap is None else e - self.motion.remaining_gap(t)

    def prescribed_slip(self, t: float) -> Floats:
        """The part of the norm terms' arguments (m * block,) that supports bring, less that of the ground."""
        given = np.zeros(self.B.shape[0]) if self.motion is None else self.motion.prescribed_slip(t)
        return given if (ground := self.ground(t)) is None else given - ground

    def ground(self, t: float) -> Floats | None:
        """The motion (m * block,) up to the instant `t` of the ground that norm terms rub on; None if still."""
        return None if self.norms is None or self.norms.ground is None else self.norms.moved(t)

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

    def linear(self, asked: LinearSolver | None = None) -> LinearSolver:
        """The linear solver for K: the one asked for, else by size."""
        modes = 0 if self.near_kernel is None else self.near_kernel.shape[1]
        return choose_linear(self.n, asked, modes=modes, retained=len(self.retained))

    def elimination_order(self) -> Ints | None:
        """(n,) the order of elimination, if there is one."""
        if not callable(self.order):
            return self.order
        return permutation(called(self.order, (), "System: order failed", "give an order of unknowns"), self.n)

    @property
    def n(self) -> int:
        """The number of unknowns."""
        return self.K.shape[0]

    def faded(self, instants: Sequence[float]) -> System:
        """The system whose load is zero where it vanishes beside its largest one in a run."""
        load = self.load
        if isinstance(load, ForceOnPart):
            load = replace(load, entries=fading(load.entries, instants))
        else:
            load = fading(self.force, instants)
        other = copy(self)
        object.__setattr__(other, "load", load)  # All else has been checked.
        return other

    def multiplier_force(self, lam: Floats, p: Floats) -> Floats:
        """B'lam + D'p, the forces (n,) of norm terms and limits."""
        force: Floats = self.B.T @ lam.ravel() + self.D.T @ p
        return force

    def load_on_part(self, t: float) -> tuple[Floats, Ints | None]:
        """The load at the instant `t`, checked: forces and the unknowns that they act on, None for all of them."""
        if not isinstance(self.load, ForceOnPart):
            return self.force(t), None
        return finite(self.load.entries(t), f"System: load({t:.6g})"), self.load.rows

    def force(self, t: float) -> Floats:
        """The load vector (n,) at the instant `t`, checked."""
        subject, wanted = f"System: load({t:.6g})", f"({self.n},) forces, one an unknown"
        return finite(shaped(at_instant(self.load, t, "System: load"), subject, wanted, (self.n,)), subject)


# Products such as A'CA round (i, j) and (j, i) differently, by eps times the number of summands.


def check_semidefinite(C: sp.csr_matrix, subject: str) -> None:
    """Raise SceneError unless C is square, symmetric and positive semidefinite to rounding.

    With a diagonal of ones, and SYMMETRIC added to it, its pivots must be positive; rows without a diagonal are empty.
    """
    check_symmetric(C, subject)
    diagonal = C.diagonal()
    felt = np.flatnonzero(diagonal > 0)
    unit = sp.diags_array(diagonal[felt] ** -0.5)
    scaled = sp.csr_matrix(unit @ C[felt][:, felt] @ unit + SYMMETRIC * sp.eye_array(len(felt)))
    try:
        if (diagonal < 0).any() or abs(C).sum() > abs(C[felt][:, felt]).sum():
            raise singular()
        if len(felt):
            direct_solver(len(felt)).factorise(scaled)
    except SceneError as error:
        raise SceneError(
            f"{subject}: found a matrix that is not positive semidefinite: some motion would gain energy from it."
        ) from error


def permutation(raw: ArrayLike, n: int) -> Ints:
    """An order of n unknowns."""
    wanted = f"a permutation of the {n} unknowns, or None"
    order = as_real_array(raw, "System: order", wanted)
    if order.ndim != 1 or not np.array_equal(np.sort(order), np.arange(n)):
        raise SceneError(f"System: found order = {brief(raw)}; wanted {wanted}.")
    return order.astype(np.int64)


def motions(raw: ArrayLike, n: int) -> Floats:
    """Motions (n, k) of little energy."""
    wanted = f"({n}, k) motions of little energy, one a column, or None"
    found = as_real_array(raw, "System: near_kernel", wanted)
    if found.ndim != 2 or len(found) != n or not found.shape[1] or not np.isfinite(found).all():
        raise SceneError(f"System: found near_kernel = {brief(raw)}; wanted {wanted}.")
    return found
