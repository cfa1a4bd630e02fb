"""The undirected edges of a mesh, numbered."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Ints
from vemcvx.meshes.polygons.topology import directed_edges, positions, shared_edges
from vemcvx.meshes.tessellation import Tessellation


@dataclass(frozen=True, eq=False)
class Edges:
    """One number for each undirected edge.

    Attributes
    ----------
    of_corner : (n_corners,) int
        Number of the edge that starts at each corner of the mesh.
    ends : (n_edges, 2) int
        Its nodes, the smaller first; edges are in the order of these pairs.
    twins : (q, 2) int
        Numbers of the edges of both bodies in one place at interfaces.
    """

    of_corner: Ints
    ends: Ints
    twins: Ints

    def find(self, pairs: Ints, n_nodes: int) -> Ints:
        """Numbers of the edges given by their nodes (m, 2) in any order; all must exist."""
        return positions(pairs, self.ends, n_nodes)


def edges_of(mesh: Tessellation) -> Edges:
    """Number the edges of a mesh."""
    shared = shared_edges(mesh.offsets, mesh.vertices, mesh.n_nodes)
    of_corner = np.empty_like(shared.corners)
    of_corner[shared.corners] = np.repeat(np.arange(len(shared.first)), shared.counts)
    ends = np.sort(directed_edges(mesh.offsets, mesh.vertices)[shared.corners[shared.first]], axis=1)
    sides = [np.empty((0, 4), dtype=np.int64), *(np.hstack([i.edges, i.partners]) for i in mesh.interfaces.values())]
    twins = positions(np.concatenate(sides).reshape(-1, 2), ends, mesh.n_nodes).reshape(-1, 2)
    return Edges(of_corner, ends, twins)
