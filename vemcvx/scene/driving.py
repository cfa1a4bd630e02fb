"""What drives a posed scene, over its free unknowns: the load, and the motion of its supports."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, Ints
from vemcvx.effects import Load
from vemcvx.program.forces import ForceOnPart
from vemcvx.program.motion import Motion
from vemcvx.scene.composition import InitialStresses
from vemcvx.scene.supports import Supports


def load_of(
    loads: tuple[Load | InitialStresses, ...], A: sp.csr_matrix, supports: Supports
) -> Callable[[float], Floats]:
    """The load of a System; loads on a part of the body touch its unknowns alone."""
    n = supports.P.shape[1]
    touched = [(load.values, *_rows_of(supports.gather(load.matrix))) for load in loads if isinstance(load, Load)]
    others = [load for load in loads if not isinstance(load, Load)]
    if not supports.still:
        touched.append((supports.moves, *_rows_of(-_moving(A, supports))))
    rows = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(own for _, own, _ in touched)]))
    places = [np.searchsorted(rows, own) for _, own, _ in touched]

    def entries(t: float) -> Floats:
        f = np.zeros(len(rows))
        for (values, _, matrix), place in zip(touched, places, strict=True):
            f[place] += matrix @ values(t)
        return f

    part = ForceOnPart(n, rows, entries)

    def load(t: float) -> Floats:
        f = part(t)
        for other in others:
            f += supports.gather(other.vector(t))
        return f

    return load if others else part


def _moving(A: sp.csr_matrix, supports: Supports) -> sp.csr_matrix:
    """P'A on the nodal values that supports move."""
    return sp.csr_matrix(supports.gather(A[:, supports.moved]))


def _rows_of(matrix: sp.csr_matrix) -> tuple[Ints, sp.csr_matrix]:
    """Which rows of a matrix have entries, and these rows."""
    by_rows = sp.csr_matrix(matrix)
    rows = np.flatnonzero(np.diff(by_rows.indptr)).astype(np.int64)
    return rows, by_rows[rows]


def motion_of(
    A: sp.csr_matrix,
    supports: Supports,
    tangential: sp.csr_matrix,
    normal: sp.csr_matrix,
    seen: Callable[[Floats], Floats],
) -> Motion:
    """What supports that move add to a System with the stiffness A, whose norm terms and limits have these rows."""
    rows, matrix = _rows_of(_moving(A, supports))
    return Motion(
        dirichlet_force=ForceOnPart(supports.P.shape[1], rows, lambda t: matrix @ supports.moves(t)),
        prescribed_slip=lambda t: tangential @ supports.motion(t),
        stored=lambda s, t: float(supports.motion(s) @ (A @ supports.motion(t))),
        frame=lambda t, y: seen(supports.P @ y + supports.motion(t)),
        pair=lambda v, w: float(v @ (A @ w)),
        remaining_gap=lambda t: normal @ supports.motion(t),
    )
