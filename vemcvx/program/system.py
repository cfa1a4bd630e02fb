"""A quasistatic variational inequality in coordinates: what is fixed in time.

Problem 2.1 of the paper with a(u, v) = v'Ku, <l(t), v> = v'load(t) and the seminorm
j(v) = sum_i w_i |B_i v| + c_i . B_i v, |c_i| <= w_i. Nothing here knows of meshes or of contact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.arguments import called, function, instance, is_whole
from vemcvx.arrays import Floats, Ints, as_real_array, brief, shape_in_words
from vemcvx.errors import SceneError
from vemcvx.outline import ArrayRecord
from vemcvx.program.checks import (
    SAY,
    SYMMETRIC,
    at_instant,
    check_semidefinite,
    check_stiffness,
    checked_matrix,
    finite,
    motions,
    permutation,
)
from vemcvx.program.kernel import Kernel, felt
from vemcvx.program.limits import Limits
from vemcvx.program.motion import Motion

# Half a sum and half a difference of two bounds, one of them zero, are the same but for rounding.
ROUNDED = 8 * float(np.finfo(float).eps)


@dataclass(frozen=True, repr=False)
class Norms(ArrayRecord):
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
    law : callable (t, p) -> (m,), optional
        Weights that depend on the forces p (r,) of the limits, found by a fixed point in every step (Coulomb); `w` are
        then the weights without limits acting.
    bias : (m * block,) array, or callable t -> (m * block,), optional
        c, by which one direction costs more than the other: w + c forwards and w - c backwards, |c_i| <= w_i. It acts
        as a force -B'c, whose work is friction's.
    slope : callable (t, p) -> (m, r), optional
        The derivative of a `law` that is piecewise affine (of the piece towards larger forces, where two meet): steps
        are then solved whole, and their certificates are bounds instead of estimates.
    """

    B: sp.csr_matrix
    w: ArrayLike | Callable[[float], ArrayLike]
    block: int = 1
    places: Callable[[int], str] | None = None
    law: Callable[[float, Floats], Floats] | None = None
    bias: ArrayLike | Callable[[float], ArrayLike] | None = None
    slope: Callable[[float, Floats], ArrayLike | sp.csr_matrix] | None = None

    def __post_init__(self) -> None:
        B = checked_matrix(self.B, "Norms: B")
        if not is_whole(self.block) or self.block < 1 or B.shape[0] % self.block:
            raise SceneError(
                f"Norms: found B with {B.shape[0]} rows and block = {brief(self.block)}; "
                "B must have a whole number of blocks of rows."
            )
        object.__setattr__(self, "B", B)
        object.__setattr__(self, "block", int(self.block))
        function(self.places, "Norms: found places", "a function of i that says where term i acts")
        function(self.law, "Norms: found law", "a function of (t, p) that gives weights")
        function(self.slope, "Norms: found slope", "a function of (t, p) that gives the law's derivative")
        if not callable(self.w):
            object.__setattr__(self, "w", self._checked(self.w))

    @property
    def count(self) -> int:
        """The number of terms m."""
        return self.B.shape[0] // self.block

    def name(self, i: int) -> str:
        """Where term `i` acts, in words."""
        return f"norm term {i}" if self.places is None else str(called(self.places, (i,), "Norms: places failed", SAY))

    def weights(self, t: float) -> Floats:
        """Weights (m,) at the instant `t`."""
        w = self.w
        # An array was checked when it was given.
        return w if isinstance(w, np.ndarray) else self._checked(at_instant(w, t, "Norms: w"))

    def weights_under(self, t: float, p: Floats) -> Floats:
        """Weights (m,) at the instant `t` while the limits answer with the forces `p` (r,)."""
        return self.weights(t) if self.law is None else self._checked(self._ask("law", t, p))

    def slope_under(self, t: float, p: Floats) -> sp.csr_matrix:
        """The derivative (m, r) of the weights there; `slope` must be given."""
        return checked_matrix(self._ask("slope", t, p), "Norms: slope", (self.count, len(p)))

    def _ask(self, name: str, t: float, p: Floats) -> ArrayLike:
        failed = f"Norms: {name}: its function failed when called as f(t, p) with t = {t:.6g}"
        value: ArrayLike = called(getattr(self, name), (t, p), failed, "return weights, or their derivative")
        return value

    def tilt(self, t: float) -> Floats:
        """The bias (m * block,) at the instant `t`; zero if there is none.

        Raises
        ------
        SceneError
            It is ill-shaped, not finite, or larger than the weights: one direction would be paid for.
        """
        rows = self.B.shape[0]
        if self.bias is None:
            return np.zeros(rows)
        wanted = f"({rows},) forces, one a row of B"
        c = as_real_array(at_instant(self.bias, t, "Norms: bias"), "Norms: bias", wanted)
        if c.shape != (rows,):
            raise SceneError(f"Norms: bias: found {shape_in_words(c)}; wanted {wanted}.")
        finite(c, "Norms: bias")
        over = np.linalg.norm(c.reshape(self.count, self.block), axis=1) - self.weights(t) * (1 + ROUNDED)
        if (over > 0).any():
            worst = int(np.argmax(over))
            raise SceneError(
                f"Norms: found a bias larger than the weight of {self.name(worst)} at t = {t:.6g}; friction would be "
                "paid for slip. Both directions need bounds >= 0."
            )
        return c

    def _checked(self, raw: ArrayLike) -> Floats:
        wanted = f"a weight, or ({self.count},) of them, one a term"
        w = as_real_array(raw, "Norms: w", wanted)
        if w.shape not in ((), (self.count,)):
            raise SceneError(f"Norms: w: found {shape_in_words(w)}; wanted {wanted}.")
        finite(w, "Norms: w")
        if (w < 0).any():
            worst = self.name(int(np.argmin(w)))
            raise SceneError(f"Norms: found the weight {w.min():.6g} of {worst}; weights must be >= 0.")
        return np.array(np.broadcast_to(w, (self.count,)))


@dataclass(frozen=True)
class DraggedTerms:
    """Norm terms that no unknown moves, w_i |c_i(t_n) - c_i(t_{n-1})|: constants of a step's program, and losses."""

    position: Callable[[float], Floats]
    """t -> (q * block,), c"""
    weights: Callable[[float, Floats], Floats]
    """(t, p) -> (q,), under the forces p (r,) of the limits"""
    count: int
    block: int = 1
    bias: Callable[[float], Floats] | None = None
    """t -> (q * block,), as of norm terms"""


@dataclass(frozen=True, repr=False)
class Damping(ArrayRecord):
    """The form b of the rate, b(u', v), beside a(u, v).

    Parameters
    ----------
    C : (n, n) array or sparse matrix
        Symmetric, positive semidefinite.
    motion : Motion, optional
        What moving supports add, with the matrix of b in place of that of a; drag and reach are those of a.
    """

    C: sp.csr_matrix
    motion: Motion | None = None

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
        Norm terms whose argument is given; they change no state, and what they lose counts.
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

    def __post_init__(self) -> None:
        K = checked_matrix(self.K, "System: K")
        check_stiffness(K)
        object.__setattr__(self, "K", K)
        if not callable(self.load):
            raise SceneError(
                f"System: found load = {brief(self.load)}; wanted a function of t that gives ({self.n},) forces."
            )
        instance(self.norms, Norms, "System: found norms", "Norms(B, w)")
        instance(self.limits, Limits, "System: found limits", "Limits(D, e)")
        instance(self.motion, Motion, "System: found motion", "a Motion")
        instance(self.damping, Damping, "System: found damping", "Damping(C)")
        instance(self.dragged, DraggedTerms, "System: found dragged", "DraggedTerms")
        instance(self.kernel, Kernel, "System: found kernel", "a Kernel(modes, names)")
        if self.norms is not None:
            self._check_columns(self.norms.B, "norms", "B")
        if self.limits is not None:
            self._check_columns(self.limits.D, "limits", "D")
        if self.damping is not None and self.damping.C.shape != self.K.shape:
            raise SceneError(f"System: found damping of shape {self.damping.C.shape}, but K has {self.K.shape}.")
        if self.motion is not None:
            rows = 0 if self.norms is None else self.norms.B.shape[0]
            limits = 0 if self.limits is None else self.limits.count
            object.__setattr__(self, "motion", self.motion.sized(self.n, rows, limits))
        if self.order is not None and not callable(self.order):
            object.__setattr__(self, "order", permutation(self.order, self.n))
        if self.near_kernel is not None:
            object.__setattr__(self, "near_kernel", motions(self.near_kernel, self.n))
        if self.kernel is not None:
            self._check_kernel(self.kernel)

    def _check_columns(self, matrix: sp.csr_matrix, what: str, name: str) -> None:
        if matrix.shape[1] != self.n:
            raise SceneError(
                f"System: found {what} over {matrix.shape[1]} unknowns, but K has {self.n}; "
                f"{name} must have one column an unknown."
            )

    def _check_kernel(self, kernel: Kernel) -> None:
        N = kernel.modes
        if len(N) != self.n:
            raise SceneError(
                f"System: found a kernel over {len(N)} unknowns; wanted one column of {self.n} and one name a motion."
            )
        work = np.abs(self.K @ N).max(axis=0, initial=0.0) > SYMMETRIC * np.abs(self.K.data).max() * np.abs(N).max()
        if work.any():
            raise SceneError(f"System: K feels {kernel.names[int(np.argmax(work))]}, which is no motion of its kernel.")
        B = sp.csr_matrix((0, self.n)) if self.norms is None else self.norms.B
        D = sp.csr_matrix((0, self.n)) if self.limits is None else self.limits.D
        if felt(sp.csr_matrix(sp.vstack([B, D])), N) < N.shape[1]:
            raise SceneError(
                f"System: a motion of K's kernel ({', '.join(kernel.names)}) is felt by no norm term and no limit: "
                "nothing holds it. Add stiffness, norm terms or limits that do."
            )

    def remaining_gap(self, t: float) -> Floats:
        """What the limits (r,) leave free at the instant `t`, moving supports accounted for."""
        if self.limits is None:
            return np.zeros(0)
        e = self.limits.remaining_gap(t)
        return e if self.motion is None or self.motion.remaining_gap is None else e - self.motion.remaining_gap(t)

    @property
    def retained(self) -> Ints:
        """(m,) the unknowns that norm terms or limits read: all others are eliminated."""
        matrices = [] if self.norms is None else [self.norms.B]
        matrices += [] if self.limits is None else [self.limits.D]
        read: list[Ints] = [A.indices[A.data != 0].astype(np.int64) for A in matrices]
        return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *read]))

    def elimination_order(self) -> Ints | None:
        """(n,) the order of elimination, if there is one."""
        if not callable(self.order):
            return self.order
        return permutation(called(self.order, (), "System: order failed", "give an order of unknowns"), self.n)

    @property
    def n(self) -> int:
        """The number of unknowns."""
        return self.K.shape[0]

    def force(self, t: float) -> Floats:
        """The load vector (n,) at the instant `t`, the bias of norm terms taken off."""
        f = self.push(t)
        return f if self.norms is None or self.norms.bias is None else f - self.norms.B.T @ self.norms.tilt(t)

    def push(self, t: float) -> Floats:
        """The load vector (n,) at the instant `t`, checked."""
        wanted = f"({self.n},) forces, one an unknown"
        f = as_real_array(at_instant(self.load, t, "System: load"), f"System: load({t:.6g})", wanted)
        if f.shape != (self.n,):
            raise SceneError(f"System: load({t:.6g}): found {shape_in_words(f)}; wanted {wanted}.")
        finite(f, f"System: load({t:.6g})")
        return f
