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

from vemcvx.errors import SceneError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


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
        B = sp.csr_matrix(self.B, dtype=float)
        if self.block < 1 or B.shape[0] % self.block:
            raise SceneError(
                f"Norms: found B with {B.shape[0]} rows and block = {self.block}; "
                "B must have a whole number of blocks of rows."
            )
        _finite(B.data, "Norms: B")
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
        return self._checked(self.w(t)) if callable(self.w) else self.w  # type: ignore[return-value]

    def _checked(self, raw: ArrayLike) -> Floats:
        w = np.asarray(raw, dtype=float)
        if w.shape not in ((), (self.count,)):
            raise SceneError(f"Norms: found weights of shape {w.shape}; there are {self.count} terms.")
        _finite(w, "Norms: w")
        if (w < 0).any():
            raise SceneError(f"Norms: found a weight of {w.min():.6g}; weights must be >= 0.")
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
        Symmetric, positive definite.
    load : callable t -> (n,)
    norms : Norms, optional
    motion : Motion, optional
        Bookkeeping of supports that move; a plain system has none.
    order : (n,) permutation, optional
        An order of elimination with little fill; by default one is computed from K.
    near_kernel : (n, k) array, optional
        Motions of little energy (rigid ones), for iterative linear solvers.
    """

    K: sp.csr_matrix
    load: Callable[[float], ArrayLike]
    norms: Norms | None = None
    motion: Motion | None = None
    order: Ints | None = None
    near_kernel: Floats | None = None

    def __post_init__(self) -> None:
        K = sp.csr_matrix(self.K, dtype=float)
        if K.shape[0] != K.shape[1]:
            raise SceneError(f"System: found K of shape {K.shape}; it must be square.")
        _finite(K.data, "System: K")
        object.__setattr__(self, "K", K)
        if self.norms is not None and self.norms.B.shape[1] != K.shape[0]:
            raise SceneError(f"System: found norms over {self.norms.B.shape[1]} unknowns; K has {K.shape[0]}.")

    @property
    def n(self) -> int:
        """The number of unknowns."""
        return self.K.shape[0]

    def force(self, t: float) -> Floats:
        """The load vector (n,) at the instant `t`, checked."""
        f = np.asarray(self.load(t), dtype=float)
        if f.shape != (self.n,):
            raise SceneError(f"System: load({t:.6g}) has shape {f.shape}; there are {self.n} unknowns.")
        _finite(f, f"System: load({t:.6g})")
        return f


def _finite(values: Floats, subject: str) -> None:
    if not np.isfinite(values).all():
        raise SceneError(f"{subject}: found NaN or infinite values; all must be finite.")
