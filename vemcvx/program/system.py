"""Quasistatic variational inequalities in arrays, without a mesh.

Problem 2.1 of the paper, for unknowns y(t), has the forms

    a(u, v) = v'Ku,     <l(t), v> = v'load(t),     j(v) = sum_i w_i |B_i v|.

`Norms` are the terms w_i |B_i v|, and `Limits` are hard or soft bounds D_j y <= e_j. Let lam be the forces of norm
terms, and p >= 0 the forces of limits. The forces balance the load: K y + B'lam + D'p = load.
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
    Bools,
    Floats,
    Ints,
    as_real_array,
    as_shaped_array,
    as_sparse_matrix,
    at_instant,
    brief,
    call_function,
    finite,
    function,
    instance,
)
from vemcvx.base.errors import SceneError
from vemcvx.base.outline import ArrayRecord
from vemcvx.base.weight_law import Law
from vemcvx.linear import LinearSolver, choose_linear, direct_solver
from vemcvx.program.kernel import Kernel, rank_on
from vemcvx.program.operators import SYMMETRY_TOLERANCE, as_read_only_rows, check_symmetric, whole_blocks

DRAG_ROUNDING = 16 * EPS
"""Largest slip that counts as zero, relative to positions."""
CONSTANT = Law(lambda t, p, past, slip: 0.0, softening=np.zeros(1), slips=False)


class Rows(ArrayRecord):
    """The base class of norm terms and of limits."""

    kind: ClassVar[str]
    places: Callable[[int], str] | None

    @property
    def count(self) -> int:
        """The number of norm terms or limits."""
        raise NotImplementedError

    def name(self, i: int) -> str:
        """Return the place of term or limit `i` in words."""
        if self.places is None:
            return f"{self.kind} {i}"
        asked = "take the number of a term and return its place in words"
        return str(call_function(self.places, (i,), f"{type(self).__name__}: places failed", asked))

    def read_numbers(self, raw: Any, name: str, what: str = "number", signed: bool = False) -> Floats:
        """Return one checked number per term or limit."""
        wanted, owner = f"a {what}, or {self.count} of them, one per {self.kind.split()[-1]}", type(self).__name__
        found = np.full(self.count, as_shaped_array(raw, f"{owner}: {name}", wanted, (), (self.count,)))
        finite(np.where((found == np.inf) & (what == "weight"), 0.0, found), f"{owner}: {name}")
        if not signed and (found < 0).any():
            i = int(np.argmin(found))
            raise SceneError(f"{owner}: found the {what} {found[i]:.6g} of {self.name(i)}; it must be >= 0.")
        return found


@dataclass(frozen=True, repr=False)
class Norms(Rows):
    """The norm terms w_i |B_i v|. The matrix B_i has `block` rows of B, from row i * block on.

    Parameters
    ----------
    B : (m * block, n) array or sparse matrix
    w : (m,) array, or callable t -> (m,)
        Weights >= 0. An infinite weight is the constraint B_i v = 0.
    block : int
        Number of rows of B_i: 1 in the plane, 2 in space.
    places : callable i -> str, optional
        The place of term i in words, for messages.
    law : Law, optional
        Weights that depend on the answer of a step, in place of `w` (:mod:`vemcvx.base.weight_law`).
    ground : callable t -> (m * block,), optional
        The displacement g of the ground. The slip of term i in a step is B_i (y - y_prev) - (g_i - g_i,prev).

    Examples
    --------
    >>> vx.Norms(B=[[1.0, 0.0], [0.0, 1.0]], w=[0.5, 0.25]).count
    2
    """

    B: Any
    w: ArrayLike | Callable[[float], ArrayLike]
    block: int = 1
    places: Callable[[int], str] | None = None
    law: Law | None = None
    ground: Callable[[float], Any] | None = None

    kind: ClassVar[str] = "norm term"

    def __post_init__(self) -> None:
        object.__setattr__(self, "B", as_read_only_rows(self.B, "Norms: B"))
        object.__setattr__(self, "block", whole_blocks(self.block, self.B.shape[0], "Norms"))
        function(self.places, "Norms: found places", "a function of i that returns the place of term i in words")
        function(self.ground, "Norms: found ground", "a function of t that returns the displacement of the ground")
        instance(self.law, Law, "Norms: found law", "a Law(weights)")
        if self.law is not None and self.law.softening is not None:
            softening = self.read_numbers(self.law.softening, "softening", "softening")
            object.__setattr__(self, "law", replace(self.law, softening=softening))
        if not callable(self.w):
            object.__setattr__(self, "w", self.read_numbers(self.w, "w", "weight"))

    @property
    def count(self) -> int:
        """The number of norm terms m."""
        return int(self.B.shape[0]) // self.block

    @property
    def rule(self) -> Law:
        """The law, by default with constant weights."""
        return self.law or CONSTANT

    @property
    def is_monotone(self) -> bool:
        """True if weights do not depend on forces of limits, and do not fall with slip."""
        return not (self.rule.pressed or self.softening is None or self.softening.any())

    @property
    def softening(self) -> Floats | None:
        """The largest decrease (m,) of weights per slip or slip rate; None if unknown."""
        known: Any = self.rule.softening
        return known

    def weights(self, t: float) -> Floats:
        """Return weights (m,) at the instant `t`."""
        w = self.w
        return w if isinstance(w, np.ndarray) else self.read_numbers(at_instant(w, t, "Norms: w"), "w", "weight")

    def weights_under(self, t: float, p: Floats, past: Floats | None = None, slip: Floats | None = None) -> Floats:
        """Return the weights (m,) for the arguments of `Law.weights`."""
        if self.law is None:
            return self.weights(t)
        slips = (np.zeros(self.count) if x is None else x for x in (past, slip))
        failed = f"Norms: law: its function failed when called as f(t, p, past, slip) with t = {t:.6g}"
        return self.read_numbers(
            call_function(self.law.weights, (t, p, *slips), failed, "return weights"), "w", "weight"
        )

    def slope_by_forces(self, t: float, p: Floats, past: Floats) -> sp.csr_matrix | None:
        """Return the derivative dw/dp (m, r) of the law, or None."""
        if self.law is None or self.law.slope is None:
            return None
        failed = f"Norms: slope: its function failed when called as f(t, p, past) with t = {t:.6g}"
        J = call_function(self.law.slope, (t, p, past), failed, "return the law's derivative")
        return as_sparse_matrix(J, "Norms: slope", (self.count, len(p)))


@dataclass(frozen=True, repr=False)
class Limits(Rows):
    """The limits D_j y <= e_j, with compliances c_j.

    Let z_j = D_j y - e_j. If c_j = 0, limit j is the bound z_j <= 0. If c_j > 0, limit j adds the energy
    (z_j)_+^2 / (2 c_j). The limit has the force p_j >= 0, and z_j <= c_j p_j. If p_j > 0, then z_j = c_j p_j.

    Parameters
    ----------
    D : (r, n) array or sparse matrix
    e : (r,) array, or callable t -> (r,)
        Upper limits of D y.
    compliance : number or (r,) array
        Displacement per force, >= 0; velocity per force where `rates` is True.
    places : callable j -> str, optional
        The place of limit j in words, for messages.
    rates : (r,) array of bool, optional
        True for limits on velocities. Then z_j is the change of D_j y - e_j in a step, divided by the step size.

    Examples
    --------
    >>> limits = vx.Limits(D=np.eye(2), e=[0.1, 0.2])
    >>> limits.remaining_gap(0.0)
    array([0.1, 0.2])
    """

    D: Any
    e: ArrayLike | Callable[[float], ArrayLike]
    compliance: Any = 0.0
    places: Callable[[int], str] | None = None
    rates: Any = False

    kind: ClassVar[str] = "limit"

    def __post_init__(self) -> None:
        object.__setattr__(self, "D", as_read_only_rows(self.D, "Limits: D"))
        function(self.places, "Limits: found places", "a function of j that returns the place of limit j in words")
        object.__setattr__(self, "compliance", self.read_numbers(self.compliance, "compliance", "compliance"))
        object.__setattr__(self, "rates", self.read_numbers(self.rates, "rates") > 0)
        if not callable(self.e):
            object.__setattr__(self, "e", self.read_numbers(self.e, "e", signed=True))

    @property
    def count(self) -> int:
        """The number of limits r."""
        return int(self.D.shape[0])

    @property
    def rigid(self) -> Bools:
        """A mask (r,) of hard bounds on positions."""
        return (self.compliance == 0.0) & ~self.rates

    def remaining_gap(self, t: float) -> Floats:
        """Return e (r,) at the instant `t`."""
        e = self.e
        return e if isinstance(e, np.ndarray) else self.read_numbers(at_instant(e, t, "Limits: e"), "e", signed=True)


@dataclass(frozen=True)
class DraggedTerms:
    """The q terms w_i |c_i(t_n) - c_i(t_{n-1})| with prescribed positions c_i."""

    position: Callable[[float], Floats]  # t -> (q * block,) positions c, relative to the ground
    weights: Callable[[float, Floats, Floats, Floats], Floats]  # (t, p, past, slip) -> (q,), as in a Law
    count: int
    block: int = 1
    rates: bool = False  # True if weights depend on slip rates


@dataclass(frozen=True)
class Motion:
    """The contributions of moving supports to energy, slips and gaps.

    The displacements are u = P y + u_D(t), where the supports prescribe u_D. The elastic form is a(u, v) = u'A v.
    """

    dirichlet_force: Callable[[float], Floats]  # t -> (n,): P'A u_D
    prescribed_slip: Callable[[float], Floats]  # t -> (m * block,): slip due to u_D
    stored: Callable[[float, float], float]  # (s, t) -> u_D(s)'A u_D(t)
    frame: Callable[[float, Floats], Floats]  # (t, y) -> (n_u,): u minus a motion without strain
    pair: Callable[[Floats, Floats], float]  # (u, v) -> a(u, v) for results u, v of `frame`
    remaining_gap: Callable[[float], Floats] | None = None  # t -> (r,): decrease of gaps due to u_D


@dataclass(frozen=True, repr=False)
class Damping(ArrayRecord):
    """The damping form b(du/dt, v), which is added to a(u, v).

    Parameters
    ----------
    C : (n, n) array or sparse matrix
        The matrix of b, symmetric, positive semidefinite.
    motion : Motion, optional
        The contributions of moving supports to b; slips and gaps are ignored.

    Examples
    --------
    >>> system = vx.System(np.eye(1), lambda t: [1.0], damping=vx.Damping(np.eye(1)))
    >>> vx.march(system, [0.0, 1.0]).state[-1]
    array([0.5])
    """

    C: Any
    motion: Motion | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "C", as_read_only_rows(self.C, "Damping: C"))
        check_symmetric(self.C, "Damping: C")
        shift = SYMMETRY_TOLERANCE * np.abs(self.C.data).max(initial=0.0) or 1.0
        try:
            direct_solver(self.C.shape[0]).factorise(sp.csr_matrix(self.C + shift * sp.eye_array(self.C.shape[0])))
        except SceneError as error:
            raise SceneError(
                "Damping: C: found a matrix that is not positive semidefinite: some motion would gain energy from it."
            ) from error
        instance(self.motion, Motion, "Damping: found motion", "a Motion")


@dataclass(frozen=True, repr=False)
class System(ArrayRecord):
    """A stiffness matrix K with a load, norm terms and limits.

    Parameters
    ----------
    K : (n, n) array or sparse matrix
        Symmetric, positive definite; semidefinite if `kernel` is given.
    load : callable t -> (n,)
        Forces minus the Dirichlet force of moving supports.
    norms : Norms, optional
        Norm terms: friction.
    motion : Motion, optional
        The contributions of moving supports.
    order : (n,) permutation, or callable () -> (n,) permutation, optional
        An order of elimination with little fill, for linear solvers that compute no order.
    near_kernel : (n, k) array, optional
        Motions of little energy, such as rigid motions, for iterative linear solvers.
    kernel : Kernel, optional
        The motions without energy. Norm terms or limits must resist each motion. Certificates then bound errors
        only in the seminorm of K.
    limits : Limits, optional
        Bounds on y, hard or soft: contact.
    damping : Damping, optional
        A force C y' that depends on the rate.
    dragged : DraggedTerms, optional
        Norm terms with slips that the supports prescribe.

    Examples
    --------
    >>> system = vx.System(K=np.eye(1), load=lambda t: [3.0 * t], norms=vx.Norms(B=np.eye(1), w=1.0))
    >>> vx.march(system, [0.0, 0.5, 1.0]).state.ravel()
    array([0. , 0.5, 2. ])
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
        object.__setattr__(self, "K", as_read_only_rows(self.K, "System: K"))
        check_symmetric(self.K, "System: K")
        diagonal, largest = self.K.diagonal(), self.K.diagonal().max(initial=0.0)
        # Some unknowns of a rigid body have no stiffness.
        if (diagonal <= (0.0 if self.kernel is None else -SYMMETRY_TOLERANCE * largest)).any():
            i = int(np.argmin(diagonal))
            raise SceneError(f"System: found K[{i}, {i}] = {diagonal[i]:.6g}; K must be positive definite.")
        if not callable(self.load):
            raise SceneError(
                f"System: found load = {brief(self.load)}; wanted a function of t that gives {self.n} forces."
            )
        parts = {"norms": Norms, "limits": Limits, "motion": Motion, "damping": Damping, "kernel": Kernel}
        for name, kind in (parts | {"dragged": DraggedTerms}).items():
            instance(getattr(self, name), kind, f"System: found {name}", f"{kind.__name__}(...)")
        columns = {"norms": self.B, "limits": self.D, "damping": getattr(self.damping, "C", self.K)}
        for name, matrix in columns.items():
            if matrix.shape[1] != self.n:
                raise SceneError(f"System: found {name} over {matrix.shape[1]} unknowns, but K has {self.n}.")
        if self.order is not None and not callable(self.order):
            object.__setattr__(self, "order", self.elimination_order())
        if self.near_kernel is not None:
            wanted = f"({self.n}, k) motions of little energy, one per column"
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
                f"System: found a kernel over {len(N)} unknowns; wanted one column of {self.n} numbers per motion."
            )
        work = (
            np.abs(self.K @ N).max(axis=0, initial=0.0)
            > SYMMETRY_TOLERANCE * np.abs(self.K.data).max() * np.abs(N).max()
        )
        if work.any():
            name = kernel.names[int(np.argmax(work))]
            raise SceneError(f"System: the motion {name!r} is not in the kernel of K: K times it is not zero.")
        if rank_on(sp.csr_matrix(sp.vstack([self.B, self.D])), N) < N.shape[1]:
            raise SceneError(
                f"System: a motion of K's kernel ({', '.join(kernel.names)}) changes no norm term and no limit: "
                "nothing holds it. Add stiffness, norm terms or limits that resist it."
            )

    @property
    def n(self) -> int:
        """The number of unknowns."""
        return int(self.K.shape[0])

    @cached_property
    def B(self) -> sp.csr_matrix:
        """The rows (m * block, n) of the norm terms."""
        return sp.csr_matrix((0, self.n)) if self.norms is None else self.norms.B

    @cached_property
    def D(self) -> sp.csr_matrix:
        """The rows (r, n) of the limits."""
        return sp.csr_matrix((0, self.n)) if self.limits is None else self.limits.D

    @property
    def block(self) -> int:
        """The number of components of a slip."""
        terms = self.norms or self.dragged
        return 1 if terms is None else terms.block

    @property
    def follows_answer(self) -> bool:
        """True if weights of norm terms depend on the answer of the step."""
        return self.norms is not None and self.norms.law is not None

    @property
    def reads_rates(self) -> bool:
        """True if weights of norm terms or dragged terms depend on slip rates."""
        dragged = self.dragged is not None and self.dragged.rates
        return dragged or (self.norms is not None and self.norms.rule.rates)

    @property
    def dashpots(self) -> Floats:
        """The compliances (r,) of limits on velocities; zero for limits on positions."""
        limits = self.limits
        return np.zeros(0) if limits is None else np.where(limits.rates, limits.compliance, 0.0)

    @property
    def is_viscous(self) -> bool:
        """True if forces depend on velocities, so that every initial state is admissible."""
        return self.damping is not None or bool(self.dashpots.any())

    @property
    def retained(self) -> Ints:
        """The unknowns on which norm terms or limits act."""
        return np.unique(np.concatenate([A.indices[A.data != 0].astype(np.int64) for A in (self.B, self.D)]))

    def remaining_gap(self, t: float) -> Floats:
        """Return the gaps (r,) for y = 0 at the instant `t`."""
        if self.limits is None:
            return np.zeros(0)
        e = self.limits.remaining_gap(t)
        return e if self.motion is None or self.motion.remaining_gap is None else e - self.motion.remaining_gap(t)

    def slip_of_supports(self, t: float) -> Floats:
        """Return the slip (m * block,) due to supports and ground at the instant `t`."""
        given = np.zeros(self.B.shape[0]) if self.motion is None else self.motion.prescribed_slip(t)
        return given if (ground := self.ground(t)) is None else given - ground

    def ground(self, t: float) -> Floats | None:
        """Return the displacement (m * block,) of the ground at the instant `t`, or None."""
        if self.norms is None or self.norms.ground is None:
            return None
        rows, subject = self.B.shape[0], "Norms: ground"
        raw = at_instant(self.norms.ground, t, subject)
        return finite(as_shaped_array(raw, subject, f"{rows} displacements, one per row of B", (rows,)), subject)

    def linear(self, asked: LinearSolver | None = None) -> LinearSolver:
        """Return the given linear solver, or the default."""
        if asked is not None:
            try:
                signature(asked.factorise).bind(self.K, None)
            except TypeError as error:
                words = f"linear solver {type(asked).__name__}: wanted factorise(self, K, near_kernel=None); {error}."
                raise SceneError(words) from error
        modes = 0 if self.near_kernel is None else self.near_kernel.shape[1]
        return choose_linear(self.n, asked, modes=modes)

    def elimination_order(self) -> Ints | None:
        """Return the order of elimination (n,), or None."""
        raw = self.order
        if callable(raw):
            raw = call_function(raw, (), "System: order: its function failed", "return a permutation")
        if raw is None:
            return None
        wanted = f"a permutation of the {self.n} unknowns, or None"
        order = as_real_array(raw, "System: order", wanted)
        if order.ndim != 1 or not np.array_equal(np.sort(order), np.arange(self.n)):
            raise SceneError(f"System: found order = {brief(raw)}; wanted {wanted}.")
        return order.astype(np.int64)

    def force(self, t: float) -> Floats:
        """Return the load vector (n,) at the instant `t`, checked."""
        subject, wanted = f"System: load({t:.6g})", f"one force per unknown, shape ({self.n},)"
        return finite(as_shaped_array(at_instant(self.load, t, "System: load"), subject, wanted, (self.n,)), subject)
