"""Cells given as rows of equal length with holes in them: a regular numbering from which some nodes are left out."""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.box import Box
from vemcvx.meshes.polygon_mesh import PolygonMesh


def padded_mesh(points: Floats, present: Bools, rows: Ints, box: Box) -> PolygonMesh:
    """Return the mesh of the nodes ``present`` whose cells are ``rows`` less the absent nodes and the entries -1.

    Parameters
    ----------
    points : (n, 2) float
        All candidates for nodes.
    present : (n,) bool
        Which of them are nodes.
    rows : (n_cells, k) int
        Candidates for vertices of each cell, counter-clockwise; -1 for none.
    box : Box
        Whose sides are named.
    """
    number = np.where(present, np.cumsum(present) - 1, -1)
    vertices = np.where(rows >= 0, number[rows], -1)
    offsets = np.concatenate([[0], np.cumsum((vertices >= 0).sum(axis=1))])
    return PolygonMesh.unchecked(points[present], offsets, vertices[vertices >= 0], box)
