"""Bodies that float: rigid motions that no support resists."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from vemcvx.errors import SceneError
from vemcvx.supports import Supports
from vemcvx.vem import Space, rigid_modes

Floats = NDArray[np.float64]

# A rigid motion counts as free when less than this part of it (squared) meets a support: one clamped node of
# a million leaves 1e-6 of the translations and of the rotation, far above it.
FREE = 1e-12


def refuse_floating(space: Space, supports: Supports) -> None:
    """Raise SceneError, naming the motion, if a connected part of the body can move without strain."""
    parts, label = _parts(space)
    points = space.mesh.points
    for part in range(parts):
        inside = np.repeat(label == part, points.shape[1])
        modes = rigid_modes(_centred(points, label == part))
        modes[~inside] = 0.0
        modes /= np.linalg.norm(modes, axis=0)
        free = supports.P.T @ modes
        held = np.eye(modes.shape[1]) - free.T @ free
        value, vector = np.linalg.eigh(0.5 * (held + held.T))
        if value[0] < FREE * modes.shape[1]:
            count = int((value < FREE * modes.shape[1]).sum())
            which = f"part {part + 1} of {parts} of the body" if parts > 1 else "the body"
            raise SceneError(
                f"supports: {which} floats: {count} rigid motion(s) meet no support, the first {_words(vector[:, 0])}. "
                "Add Clamp, PrescribedDisplacement or BilateralContact on boundaries that exclude it."
            )


def _parts(space: Space) -> tuple[int, NDArray[np.int32]]:
    mesh = space.mesh
    cell = np.repeat(np.arange(mesh.n_cells), np.diff(mesh.offsets))
    incidence = sp.csr_matrix((np.ones(len(cell)), (cell, mesh.vertices)), shape=(mesh.n_cells, mesh.n_nodes))
    n = mesh.n_cells + mesh.n_nodes
    graph = sp.block_array([[None, incidence], [incidence.T, None]], format="csr")
    if graph.shape != (n, n):
        raise SceneError("supports: the mesh has no cells.")
    parts, label = connected_components(graph, directed=False)
    return parts, label[mesh.n_cells :]


def _centred(points: Floats, inside: NDArray[np.bool_]) -> Floats:
    """Coordinates about the part's middle, in units of its size: rotations then weigh like translations."""
    shifted = points - points[inside].mean(axis=0)
    return shifted / np.abs(shifted[inside]).max()


def _words(mode: Floats) -> str:
    x, y, turn = mode
    if abs(turn) > 0.9:
        return "a rotation"
    moves = f"the translation ({x:.2g}, {y:.2g})"
    return moves if abs(turn) < 1e-3 else f"{moves} with a rotation"
