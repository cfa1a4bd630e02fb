"""Matrices that evaluate virtual functions and cell data at points of polyhedra.

A point is in a cell if the solid angles of the faces, seen from the point, add up to 4 pi, or if the point is on a
face. On faces, a virtual function u is linear on triangles. Inside cells, the projection Pi u (:mod:`.projection`)
replaces the virtual function.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import CHUNK_SIZE, ROUNDING, Floats, Ints
from vemcvx.meshes import PolyhedralMesh
from vemcvx.meshes.interfaces import faces_of
from vemcvx.meshes.polygons import TOLERANCE, least_of_each, offsets_of, overlapping_boxes, spans
from vemcvx.meshes.polyhedra import angles_seen
from vemcvx.vem.projection import face_groups
from vemcvx.vem.space import Space


def solid_places(space: Space, mesh: PolyhedralMesh, x: Floats) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Return matrices from nodal and cell values to point values."""
    parts = [_places(space, mesh, x[k : k + CHUNK_SIZE]) for k in range(0, len(x), CHUNK_SIZE)]
    nodes, cells = ([part[k] for part in parts] for k in range(2))
    return sp.vstack(nodes, format="csr"), sp.vstack(cells, format="csr")


def _places(space: Space, mesh: PolyhedralMesh, x: Floats) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    offsets, vertices = mesh.cell_nodes
    low, high = (f.reduceat(mesh.points[vertices], offsets[:-1]) for f in (np.minimum, np.maximum))
    reach = ROUNDING * mesh.h + TOLERANCE * float(np.abs(mesh.points).max())
    point, cell = overlapping_boxes(x - reach, x + reach, low, high)
    if len(point) == 0:
        return sp.csr_matrix((len(x), mesh.n_nodes)), sp.csr_matrix((len(x), mesh.n_cells))
    order = np.lexsort([cell, point])
    point, cell = point[order], cell[order]
    # List the triangles of faces for pairs of points and nearby cells.
    counts = np.diff(mesh.cell_offsets)[cell]
    side = spans(mesh.cell_offsets[cell], counts)
    face = mesh.cell_faces[side]
    some, place = np.unique(face, return_inverse=True)
    rows, corners, values = _triangles(mesh, some)
    several = np.diff(rows)[place]
    triangle, pair = spans(rows[place], several), np.repeat(np.repeat(np.arange(len(point)), counts), several)
    arms = corners[triangle] - x[point[pair], None]
    angles = angles_seen(arms) * np.repeat(mesh.face_signs[side], several)
    weights, distance = _nearest(arms)
    on = distance <= reach
    holds = (np.bincount(pair, angles, len(point)) > 2.0 * np.pi) | (np.bincount(pair, on, len(point)) > 0)
    if mesh.interfaces:
        # On an interface, cells of the first body take precedence.
        seconds = np.zeros(mesh.n_faces, dtype=bool)
        for joint in mesh.interfaces.values():
            seconds[mesh.boundaries["boundary"][faces_of(joint.partners, mesh._outlines)]] = True
        second = holds & (np.bincount(pair, on & np.repeat(seconds[face], several), len(point)) > 0)
        holds &= ~(second & np.isin(point, point[holds & ~second]))
    # Points on faces get values on triangles. Other points get values of Pi u.
    near = np.flatnonzero(on & holds[pair])
    best = near[least_of_each(point[pair[near]], distance[near])]
    traced, columns = point[pair[best]], 3 * triangle[best][:, None] + np.arange(3)
    entries = weights[best].ravel(), (np.repeat(traced, 3), columns.ravel())
    traces = sp.csr_matrix(entries, shape=(len(x), values.shape[0])) @ values
    point, cell = point[holds], cell[holds]
    first = np.unique(point, return_index=True)[1]
    first = first[~np.isin(point[first], traced)]
    share = 1.0 / np.bincount(point, minlength=len(x))[point]
    cells = sp.csr_matrix((share, (point, cell)), shape=(len(x), mesh.n_cells))
    return sp.csr_matrix(traces + space.project_values(x, point[first], cell[first])), cells


def _triangles(mesh: PolyhedralMesh, faces: Ints) -> tuple[Ints, Floats, sp.csr_matrix]:
    """Return offsets and corners of triangles, and the matrix of corner values."""
    owner, corners, values = [], [], []
    for group in face_groups(mesh.points, mesh.face_offsets, mesh.face_vertices, faces):
        f, n = group.nodes.shape
        at = group.corners + group.origin[:, None]
        at[:, :n] = mesh.points[group.nodes]
        row = np.arange(f)[:, None, None]
        owner.append(np.repeat(group.faces, group.triangles.shape[1]))
        corners.append(at[row, group.triangles].reshape(-1, 3, 3))
        # A face has values at the vertices, then at the centre.
        entries = np.concatenate([np.broadcast_to(np.eye(n), (f, n, n)), group.weights[:, None]], axis=1)
        columns = np.repeat(group.nodes[:, None], n + 1, axis=1)
        starts = np.arange(0, f * (n + 1) * n + 1, n)
        at_points = sp.csr_matrix((entries.ravel(), columns.ravel(), starts), shape=(f * (n + 1), mesh.n_nodes))
        values.append(at_points[(row * (n + 1) + group.triangles).ravel()])
    number = np.concatenate(owner)
    order = np.argsort(number, kind="stable")
    rows = (order[:, None] * 3 + np.arange(3)).ravel()
    counts = np.unique(number, return_counts=True)[1]
    return offsets_of(counts), np.concatenate(corners)[order], sp.csr_matrix(sp.vstack(values, format="csr")[rows])


def _nearest(arms: Floats) -> tuple[Floats, Floats]:
    """Return the barycentric coordinates and the distance of a point near the origin."""
    a, b, c = (arms[:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    part = np.stack([np.einsum("ki,ki->k", normal, np.cross(p, q)) for p, q in ((b, c), (c, a), (a, b))], axis=1)
    part = np.maximum(part, 0.0)
    here = np.all(arms == 0.0, axis=2)  # If a corner is at the origin, only this corner counts.
    corner = np.any(here, axis=1)
    part[corner] = here[corner]
    weights = part / np.maximum(part.sum(axis=1), np.finfo(float).tiny)[:, None]
    return weights, np.linalg.norm(np.einsum("kc,kci->ki", weights, arms), axis=1)
