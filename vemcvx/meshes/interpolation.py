"""Values inside cells: the projection Pi of the virtual elements (see `vem.projection`) at points.

    Pi v(x) = sum_i v_i (w_i + G_i . (x - xbar)),   G_i = (y_{i+1} - y_{i-1}, x_{i-1} - x_{i+1}) / (2 |K|),

with w_i the weights of the mean over the boundary and xbar = sum_i w_i x_i. Linear functions are reproduced.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from vemcvx.arrays import Floats, Ints
from vemcvx.meshes.polygons import next_corner, offsets_of, previous_corner, right_of, spans
from vemcvx.meshes.tessellation import Tessellation


def projected_values(mesh: Tessellation, cells: Ints, points: Floats) -> csr_array:
    """The matrix (p, n_nodes) that takes nodal values to those of Pi at points (p, 2), each in its cell (p,)."""
    shape = (len(cells), mesh.n_nodes)
    if not len(cells):
        return csr_array(shape)
    counts = np.diff(mesh.offsets)[cells]
    offsets = offsets_of(counts)
    nodes = mesh.vertices[spans(mesh.offsets[cells], counts)]
    x = mesh.points[nodes] - np.repeat(points, counts, axis=0)
    after, before = x[next_corner(offsets)], x[previous_corner(offsets)]
    length = np.hypot(*(after - x).T)
    both = length + length[previous_corner(offsets)]
    w = both / np.repeat(np.add.reduceat(both, offsets[:-1]), counts)
    mean = np.add.reduceat(w[:, None] * x, offsets[:-1], axis=0)
    chord = after - before
    doubled = np.add.reduceat(x[:, 0] * chord[:, 1], offsets[:-1])  # the very sum that makes the gradient of x one
    slope = right_of(chord) / np.repeat(doubled, counts)[:, None]
    values = w - np.einsum("ij,ij->i", slope, np.repeat(mean, counts, axis=0))
    return csr_array((values, nodes, offsets), shape=shape)
