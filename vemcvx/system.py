"""A quasistatic variational inequality in coordinates: what is fixed in time.

Problem 2.1 of the paper with a(u, v) = v'Ku, <l(t), v> = v'load(t) and the seminorm
j(v) = sum_i w_i |B_i v|. Nothing here knows of meshes or of contact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from vemcvx.errors import SceneError, VemcvxError
from vemcvx.kernel import Kernel
from vemcvx.real import brief, real, shape_in_words

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Products such as A'CA round (i, j) and (j, i) differently, by eps times the number of summands.
SYMMETRIC = 1e-10


@dataclass(frozen=True)
class Norms:
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
    """

    B: sp.csr_matrix
    w: ArrayLike | Callable[[float], ArrayLike]
    block: int = 1
    places: Callable[[int], str] | None = None

    def __post_init__(self) -> None:
        B = _matrix(self.B, "Norms: B")
        if not isinstance(self.block, (int, np.integer)) or self.block < 1 or B.shape[0] % self.block:
            raise SceneError(
                f"Norms: found B with {B.shape[0]} rows and block = {self.block!r}; "
                "B must have a whole number of blocks of rows."
            )
        object.__setattr__(self, "B", B)
        if not callable(self.w):
            object.__setattr__(self, "w", self._checked(self.w))

    @property
    def count(self) -> int:
        """The number of terms m."""
        return self.B.shape[0] // self.block

    def name(self, i: int) -> str:
        """Where term `i` acts, in words."""
        return f"norm term {i}" if self.places is None else self.places(i)

    def weights(self, t: float) -> Floats:
        """Weights (m,) at the instant `t`."""
        return self._checked(_at(self.w, t, "Norms: w")) if callable(self.w) else self.w  # type: ignore[return-value]

    def _checked(self, raw: ArrayLike) -> Floats:
        wanted = f"a weight, or ({self.count},) of them, one a term"
        w = real(raw, "Norms: w", wanted)
        if w.shape not in ((), (self.count,)):
            raise SceneError(f"Norms: w: found {shape_in_words(w)}; wanted {wanted}.")
        _finite(w, "Norms: w")
        if (w < 0).any():
            raise SceneError(
                f"Norms: found the weight {w.min():.6g} of {self.name(int(np.argmin(w)))}; weights must be >= 0."
            )
        return np.array(np.broadcast_to(w, (self.count,)))


@dataclass(frozen=True)
class Motion:
    """What moving supports add when u = P y + u_D(t), with A the matrix of a over all of u.

    a(u, u) = y'Ky + 2 y'stretch + stored, and the norm terms measure B (y - y_prev) + (drag - drag_prev).
    """

    stretch: Callable[[float], Floats]
    """t -> (n,), P'A u_D"""
    drag: Callable[[float], Floats]
    """t -> (m * block,), what u_D adds to the argument of the norms"""
    stored: Callable[[float, float], float]
    """(s, t) -> u_D(s)'A u_D(t)"""


@dataclass(frozen=True)
class System:
    """K, the load, and the norm terms; the load already includes minus the stretch of moving supports.

    Parameters
    ----------
    K : (n, n) array or sparse matrix
        Symmetric, positive definite; semidefinite if `kernel` says where.
    load : callable t -> (n,)
    norms : Norms, optional
    motion : Motion, optional
        Bookkeeping of supports that move; a plain system has none.
    order : (n,) permutation, optional
        An order of elimination with little fill; by default one is computed from K.
    near_kernel : (n, k) array, optional
        Motions of little energy (rigid ones), for iterative linear solvers.
    kernel : Kernel, optional
        The motions of no energy, all of which the norm terms must feel. Answers are then unique, and certified, in the
        seminorm of K only.
    """

    K: sp.csr_matrix
    load: Callable[[float], ArrayLike]
    norms: Norms | None = None
    motion: Motion | None = None
    order: Ints | None = None
    near_kernel: Floats | None = None
    kernel: Kernel | None = None

    def __post_init__(self) -> None:
        K = _matrix(self.K, "System: K")
        _check_stiffness(K)
        object.__setattr__(self, "K", K)
        if not callable(self.load):
            raise SceneError(
                f"System: found load = {brief(self.load)}; wanted a function of t that gives ({self.n},) forces."
            )
        if self.norms is not None and not isinstance(self.norms, Norms):
            raise SceneError(f"System: found norms = {brief(self.norms)}; wanted Norms(B, w), or None.")
        if self.norms is not None and self.norms.B.shape[1] != self.n:
            raise SceneError(
                f"System: found norms over {self.norms.B.shape[1]} unknowns, but K has {self.n}; "
                "B must have one column an unknown."
            )
        if self.order is not None and not np.array_equal(np.sort(self.order), np.arange(self.n)):
            raise SceneError(
                f"System: found order = {brief(self.order)}; wanted a permutation of the {self.n} unknowns, or None."
            )
        if self.kernel is not None:
            self._check_kernel(self.kernel)

    def _check_kernel(self, kernel: Kernel) -> None:
        N = kernel.modes
        if N.ndim != 2 or len(N) != self.n or len(kernel.names) != N.shape[1]:
            raise SceneError(
                f"System: found a kernel of {brief(N)} with {len(kernel.names)} names; wanted one column of {self.n} "
                "and one name a motion."
            )
        felt = np.abs(self.K @ N).max(axis=0, initial=0.0) > SYMMETRIC * np.abs(self.K.data).max() * np.abs(N).max()
        if felt.any():
            raise SceneError(f"System: K feels {kernel.names[int(np.argmax(felt))]}, which is no motion of its kernel.")
        B = sp.csr_matrix((0, self.n)) if self.norms is None else self.norms.B
        if np.linalg.matrix_rank(B @ N) < N.shape[1]:
            raise SceneError(
                f"System: a motion of K's kernel ({', '.join(kernel.names)}) is felt by no norm term: nothing holds "
                "it. Add stiffness or norm terms that do."
            )

    @property
    def n(self) -> int:
        """The number of unknowns."""
        return self.K.shape[0]

    def force(self, t: float) -> Floats:
        """The load vector (n,) at the instant `t`, checked."""
        wanted = f"({self.n},) forces, one an unknown"
        f = real(_at(self.load, t, "System: load"), f"System: load({t:.6g})", wanted, copy=False)
        if f.shape != (self.n,):
            raise SceneError(f"System: load({t:.6g}): found {shape_in_words(f)}; wanted {wanted}.")
        _finite(f, f"System: load({t:.6g})")
        return f


def _at(function: Callable[[float], ArrayLike], t: float, subject: str) -> ArrayLike:
    try:
        return function(t)
    except VemcvxError:
        raise
    except Exception as error:
        words = " ".join(str(error).split()).rstrip(".")
        raise SceneError(
            f"{subject}: its function failed when called as f(t) with t = {t:.6g}: {type(error).__name__}: {words}. "
            "It must take an instant and return an array."
        ) from error


def _matrix(raw: object, subject: str) -> sp.csr_matrix:
    if not sp.issparse(raw) or raw.dtype.kind not in "biuf":  # type: ignore[attr-defined]
        raw = real(raw, subject, "a matrix of real numbers")
        if raw.ndim != 2:
            raise SceneError(f"{subject}: found {shape_in_words(raw)}; wanted a matrix, dense or sparse.")
    matrix = sp.csr_matrix(raw, dtype=float)
    _finite(matrix.data, subject)
    return matrix


def _check_stiffness(K: sp.csr_matrix) -> None:
    if K.shape[0] != K.shape[1]:
        raise SceneError(f"System: found K of shape {K.shape}; it must be square.")
    if K.nnz == 0:
        return
    # Kx = K'x for one x without structure: a tenth of the cost of K - K', which is formed only to name the place.
    x = np.cos(np.arange(1.0, K.shape[0] + 1.0) ** 2)
    doubtful = np.abs(K @ x - x @ K).max() > 0.01 * SYMMETRIC * np.abs(K.data).max()
    apart = abs(K - K.T).tocoo() if doubtful else sp.coo_matrix(K.shape)
    if apart.nnz and apart.data.max() > SYMMETRIC * np.abs(K.data).max():
        worst = int(np.argmax(apart.data))
        i, j = int(apart.row[worst]), int(apart.col[worst])
        raise SceneError(
            f"System: found K[{i}, {j}] = {K[i, j]:.6g} but K[{j}, {i}] = {K[j, i]:.6g}; K must be symmetric. "
            "For the energy 1/2 y'Ky, give (K + K.T) / 2."
        )
    diagonal = K.diagonal()
    if diagonal.min() <= 0:
        i = int(np.argmin(diagonal))
        raise SceneError(f"System: found K[{i}, {i}] = {diagonal[i]:.6g}; K must be positive definite.")


def _finite(values: Floats, subject: str) -> None:
    if not np.isfinite(values).all():
        raise SceneError(f"{subject}: found NaN or infinite values; all must be finite.")
