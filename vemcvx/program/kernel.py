r"""The kernel of a matrix K: motions without energy, which only norm terms and limits resist.

An example is a body without supports on a rough obstacle. Let the k columns of N span the kernel. In the notation of
:mod:`vemcvx.program.step_program`, a step has a solution d* if the inequality on the left holds. The equation on the
right then has a solution (lam, p):

$$ c' N' g < \sum_i w_i |B_i N c| \quad \text{for all } c \ne 0 \text{ with } D N c \le 0, \qquad
N' g = N' B' \lambda + N' D' p, \quad |\lambda_i| \le w_i, \quad p \ge 0. $$

The force K d* is unique, but d* need not be unique. Errors are measured in the seminorm |.|_K. To factorise K, we add
stiffness to k unknowns, the *anchors*. Every motion of the kernel moves an anchor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.linalg import qr

from vemcvx.base.arrays import (
    SAME,
    Floats,
    as_real_array,
    brief,
    directions,
    finite,
    lengths,
    onto_discs,
)
from vemcvx.base.errors import SceneError
from vemcvx.linear import Matrix
from vemcvx.program.certificate import ROUNDED

MAX_CORRECTIONS = 50  # least-squares corrections of multipliers


@dataclass(frozen=True)
class Kernel:
    """The motions without energy: the kernel of K.

    Parameters
    ----------
    modes : (n, k) array
        Independent motions with K modes = 0.
    names : (k,) sequence of str
        The motions in words, for messages.
    in_words : callable (k,) -> str, optional
        The motion ``modes @ c`` in words, by default made of `names`.
    moved : (n_u, k) or (nodes, components, k) array, optional
        Displacements of all nodes in each motion, by default `modes`.

    Examples
    --------
    >>> kernel = vx.Kernel(modes=[[1.0], [1.0]], names=("translation",))
    >>> kernel.name(np.array([-1.0]))
    'the reverse of translation'
    """

    modes: Floats
    names: tuple[str, ...]
    in_words: Callable[[Floats], str] | None = None
    moved: Floats | None = None

    def __post_init__(self) -> None:
        modes = as_real_array(self.modes, "Kernel: modes", "(n, k) motions, one per column")
        names = self.names if isinstance(self.names, (tuple, list)) else ()
        if modes.ndim != 2 or len(names) != modes.shape[1] or not all(isinstance(name, str) for name in names):
            raise SceneError(
                f"Kernel: found modes of shape {modes.shape} and names = {brief(self.names)}; wanted one column of "
                "numbers and one name per motion."
            )
        object.__setattr__(self, "modes", finite(modes, "Kernel: modes"))
        object.__setattr__(self, "names", tuple(names))
        if self.moved is not None:
            moved = as_real_array(self.moved, "Kernel: moved", "displacements, one column per motion")
            if moved.ndim < 2 or moved.shape[-1] != modes.shape[1]:
                raise SceneError(f"Kernel: found moved of shape {moved.shape} for {modes.shape[1]} motions.")
            object.__setattr__(self, "moved", finite(moved, "Kernel: moved"))

    def reach(self, c: Floats) -> float:
        """Return the largest displacement of a node in the motion ``modes @ c``."""
        field = (self.modes if self.moved is None else self.moved) @ c
        return float(lengths(field.reshape(len(field), -1)).max())

    def name(self, c: Floats) -> str:
        """Return the motion ``modes @ c`` in words."""
        if self.in_words is not None:
            return self.in_words(c)
        large = np.flatnonzero(np.abs(c) > 1e-3 * np.abs(c).max())
        return " with ".join(self.names[i] if c[i] > 0 else f"the reverse of {self.names[i]}" for i in large)


def rank_on(rows: sp.csr_matrix, modes: Floats) -> int:
    """Return the number of independent motions in `modes` (n, k) that `rows` resist."""
    read, size = np.asarray(abs(rows).sum(axis=1)).ravel(), np.abs(modes).max(axis=0, initial=0.0)
    seen = (rows @ modes)[read > 0] / read[read > 0, None] / np.where(size > 0, size, 1.0)
    return int(np.linalg.matrix_rank(seen, tol=ROUNDED * max(len(seen), 1)))


def choose_anchors(modes: Floats, diagonal: Floats) -> Floats:
    """Return stiffnesses (m,), positive at k anchors and zero elsewhere."""
    picked = qr(modes.T, mode="economic", pivoting=True)[2][: modes.shape[1]]
    stiffness, largest = np.zeros(len(modes)), diagonal.max(initial=0.0) or 1.0
    stiffness[picked] = np.where(diagonal[picked] > SAME * largest, diagonal[picked], largest)
    return stiffness


def add_anchors(K: Matrix, anchor: Floats) -> Matrix:
    """Return K plus the diagonal `anchor` (n,)."""
    return K + np.diag(anchor) if isinstance(K, np.ndarray) else sp.csr_matrix(K + sp.diags_array(anchor))


def balance_multipliers(
    near: tuple[Floats, Floats], w: Floats, modes: Floats, push: Floats, weights: tuple[Floats, Floats]
) -> tuple[Floats, Floats]:
    """Return multipliers close to `near` with (lam, p)'modes = push, |lam_i| <= w_i and p >= 0.

    The columns of `modes` are slips and gaps in k motions. Larger `weights` allow larger changes.
    """
    (lam, p), (a, b), rows, way = near, weights, near[0].size, np.zeros_like(near[0])
    of_terms, of_limits = modes[:rows].reshape(*lam.shape, len(push)), b[:, None] * modes[rows:]
    cut, closed = w == 0, np.ones(len(p), dtype=bool)
    for _ in range(MAX_CORRECTIONS):
        x = np.append(lam, p)
        left = push - x @ modes
        if (np.abs(left) <= ROUNDED * (np.abs(push) + np.abs(x) @ np.abs(modes))).all():
            break
        across = of_terms - way[:, :, None] * np.einsum("ij,ijk->ik", way, of_terms)[:, None]
        across = (np.where(w > 0, a, 0.0)[:, None, None] * across).reshape(rows, len(push))
        moves = np.concatenate([across, np.where(closed[:, None], of_limits, 0.0)])
        dx = moves @ np.linalg.lstsq(modes.T @ moves, left, rcond=None)[0]
        lam, p = lam + dx[:rows].reshape(lam.shape), p + dx[rows:]
        cut, closed = cut | (lengths(lam) > w), closed & (p >= 0)
        way = np.where(cut[:, None], directions(lam, lengths(lam)), 0.0)
        lam, p = onto_discs(lam, w), np.maximum(p, 0.0)
    return lam, p
