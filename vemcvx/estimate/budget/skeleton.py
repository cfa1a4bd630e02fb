"""The edges of a mesh as an error estimator sees them: who is next door, how stiff, what may move at the boundary."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, Ints
from vemcvx.estimate.budget.joints import Joints, joints
from vemcvx.meshes import PolygonMesh, plane_mesh
from vemcvx.meshes.polygons.segments import cross, right_of
from vemcvx.meshes.polygons.topology import cell_of_corner, directed_edges
from vemcvx.scene.pose import PosedScene
from vemcvx.vem import elastic_matrix, mean_shear

FREE = 1e-9
"""A direction in which both ends of an edge move by less than this part of their freedom is held."""


@dataclass(frozen=True, kw_only=True)
class Skeleton:
    """Edges inside and on the boundary."""

    extents: Floats
    """(n_cells, 2, 2) squared sides of the rectangle with the cell's second moments: n'Mn along a unit vector n"""
    areas: Floats
    """(n_cells,)"""
    sides: Ints
    """(c, 2) the edges of every cell, counter-clockwise"""
    owner: Ints
    """(c,) the cell of each"""
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
        """(b,) d_e / (2 mu) of boundary edges, by which squares of what they miss count."""
        return self.depths(self.outer, self.outer_normals) / (2.0 * self.shear[self.outer])

    def depths(self, cells: Ints, normals: Floats) -> Floats:
        """(e,) d_e: how far cells (e,) extend along these normals (e, 2), of any length."""
        squares = np.einsum("ei,eij,ej->e", normals, self.extents[cells], normals)
        depths: Floats = np.sqrt(squares / np.einsum("ei,ei->e", normals, normals))
        return depths

    @cached_property
    def sizes(self) -> Floats:
        """(n_cells,) h_K: the longer side of that rectangle."""
        sizes: Floats = np.sqrt(np.linalg.eigvalsh(self.extents)[:, 1])
        return sizes


def skeleton(posed: PosedScene) -> Skeleton:
    """The edges of a posed scene's mesh."""
    mesh = plane_mesh(posed.space.mesh, "error_budget")
    shared = mesh.shared_edges
    edges = directed_edges(mesh.offsets, mesh.vertices)
    normals = right_of(np.diff(mesh.points[edges], axis=1)[:, 0])
    first, two = shared.corners[shared.first], shared.counts == 2
    owner = cell_of_corner(mesh.offsets)
    inner, outer = first[two], first[~two]
    return Skeleton(
        extents=_extents(mesh, edges, owner),
        areas=mesh.areas,
        sides=edges,
        owner=owner,
        shear=0.5 * mean_shear(elastic_matrix(posed.material.moduli)),
        inside=mesh.neighbours,
        inside_normals=normals[inner],
        outer=owner[outer],
        outer_edges=edges[outer],
        outer_normals=normals[outer],
        free=_free(posed.supports.P, edges[outer]),
        joints=joints(posed, edges[outer], normals[outer]),
    )


def _extents(mesh: PolygonMesh, edges: Ints, owner: Ints) -> Floats:
    """M = 12 / |K| int_K (x - c)(x - c)' dx: diag(a^2, b^2) for a rectangle with the sides a, b.

    Over the triangle of c = 0, a and b, int x x' = |T| (a a' + b b' + (a + b)(a + b)') / 12.
    """
    ends = mesh.points[edges] - mesh.centroids[owner, None]
    corners = np.concatenate([ends, ends.sum(axis=1, keepdims=True)], axis=1)
    share = 0.5 * cross(ends[:, 0], ends[:, 1]) / mesh.areas[owner]
    extents = np.zeros((mesh.n_cells, 2, 2))
    np.add.at(extents, owner, share[:, None, None] * np.einsum("eki,ekj->eij", corners, corners))
    return extents


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
