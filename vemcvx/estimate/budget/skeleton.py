"""The edges of a mesh as an error estimator sees them: who is next door, how stiff, what may move at the boundary."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, Ints
from vemcvx.estimate.budget.joints import Joints, joints
from vemcvx.meshes import plane_mesh
from vemcvx.meshes.polygons.segments import right_of
from vemcvx.meshes.polygons.topology import cell_of_corner, directed_edges
from vemcvx.scene.pose import PosedScene
from vemcvx.vem import elastic_matrix, mean_shear

FREE = 1e-9
"""A direction in which both ends of an edge move by less than this part of their freedom is held."""


@dataclass(frozen=True, kw_only=True)
class Skeleton:
    """Edges inside and on the boundary."""

    sizes: Floats
    """(n_cells,) |K|^{1/2}"""
    shear: Floats
    """(n_cells,) mu; half the harmonic mean of the two moduli of shear, at most twice the softer, where they differ"""
    inside: Ints
    """(e, 2) the two cells of each inner edge"""
    inside_normals: Floats
    """(e, 2) from the first cell to the second, as long as the edge"""
    outer: Ints
    """(b,) the cell of each boundary edge"""
    outer_edges: Ints
    """(b, 2) its nodes, counter-clockwise"""
    outer_normals: Floats
    """(b, 2) outward, as long as the edge"""
    free: Floats
    """(b, 2, 2) projector on the directions that supports leave free at one end at least"""
    joints: Joints
    """where two bodies meet"""

    @cached_property
    def lengths(self) -> Floats:
        """(b,) of boundary edges."""
        lengths: Floats = np.linalg.norm(self.outer_normals, axis=1)
        return lengths

    @cached_property
    def units(self) -> Floats:
        """(b, 2) outward unit normals of boundary edges."""
        return self.outer_normals / self.lengths[:, None]

    @cached_property
    def weights(self) -> Floats:
        """(b,) h_e / (2 mu) of boundary edges, by which squares of what they miss count."""
        return self.sizes[self.outer] / (2.0 * self.shear[self.outer])


def skeleton(posed: PosedScene) -> Skeleton:
    """The edges of a posed scene's mesh."""
    mesh = plane_mesh(posed.space.mesh, "error_budget")
    shared = mesh.shared_edges
    edges = directed_edges(mesh.offsets, mesh.vertices)
    normals = right_of(np.diff(mesh.points[edges], axis=1)[:, 0])
    first, two = shared.corners[shared.first], shared.counts == 2
    inner, outer = first[two], first[~two]
    return Skeleton(
        sizes=np.sqrt(mesh.areas),
        shear=0.5 * mean_shear(elastic_matrix(posed.material.moduli)),
        inside=mesh.neighbours,
        inside_normals=normals[inner],
        outer=cell_of_corner(mesh.offsets)[outer],
        outer_edges=edges[outer],
        outer_normals=normals[outer],
        free=_free(posed.supports.P, edges[outer]),
        joints=joints(posed, edges[outer], normals[outer]),
    )


def _free(P: sp.csr_matrix, edges: Ints) -> Floats:
    """(b, 2, 2) projectors on the span of what is free at the two ends of each edge."""
    nodes, place = np.unique(edges, return_inverse=True)
    rows = P[(2 * nodes[:, None] + np.arange(2)).ravel()]
    gram = sp.bsr_matrix(rows @ rows.T, blocksize=(2, 2)).tocoo()
    own = np.zeros((len(nodes), 2, 2))
    near = gram.row // 2 == gram.col // 2
    own[gram.row[near] // 2, gram.row[near] % 2, gram.col[near] % 2] = gram.data[near]
    values, vectors = np.linalg.eigh(own[place.reshape(-1, 2)].sum(axis=1))
    kept = np.where(values > FREE, 1.0, 0.0)
    projectors: Floats = np.einsum("bik,bk,bjk->bij", vectors, kept, vectors)
    return projectors
