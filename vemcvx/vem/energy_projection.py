"""The energy projection P^h u_0 of a displacement, (2.11): a^h(P^h u_0, v) = a(u_0, v) for all v of V^h.

The right side is the virtual work of the stresses C eps(u_0), of which cells know their mean alone, for v is virtual:

    a(u_0, v)  ~  sum_K |K| C eps_K : eps(Pi v),     |K| eps_K = int_K eps(u_0) = sym int_dK u_0 (x) n ds,

the last by Gauss' theorem, so that u_0 need not be differentiated: the mean strain comes from u_0 on the boundary of
the cell. What is left out, (C (eps(u_0) - eps_K), eps(v) - eps(Pi v))_K, is at most c h |u_0|_{H^2} |v|, of the order
of (3.18), and zero where u_0 is linear: P^h u_0 then is u_0, for Pi is consistent, (2.8).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vemcvx.arrays import Floats, Ints, totals
from vemcvx.meshes import PolygonMesh, PolyhedralMesh
from vemcvx.meshes.polygons import cell_of_corner, next_corner
from vemcvx.vem.elasticity import COMPONENTS
from vemcvx.vem.projection import face_groups
from vemcvx.vem.space import Space


def mean_strains(space: Space, displacement: Callable[[Floats], Floats]) -> Floats:
    """(n_cells, components) means over cells of the strains of a displacement, a function of points (q, dim).

    Components are those of :mod:`vemcvx.vem.elasticity`; across, they are 2 e_xy and so on.
    """
    mesh = space.mesh
    flux = _over_edges(mesh, displacement) if isinstance(mesh, PolygonMesh) else _over_faces(mesh, displacement)
    slope = flux / mesh.measures[:, None, None]
    columns = [slope[:, a, a] if a == b else slope[:, a, b] + slope[:, b, a] for a, b in COMPONENTS[space.dim]]
    return np.column_stack(columns)


def _over_edges(mesh: PolygonMesh, displacement: Callable[[Floats], Floats]) -> Floats:
    """int_dK u (x) n ds, (n_cells, 2, 2)."""
    place, weight = np.polynomial.legendre.leggauss(4)  # exact for degree 7, as faces are for degree 5
    start = mesh.points[mesh.vertices]
    along = mesh.points[mesh.vertices[next_corner(mesh.offsets)]] - start
    points = start[:, None] + (0.5 + 0.5 * place)[:, None] * along[:, None]
    mean = np.einsum("q,eqa->ea", 0.5 * weight, displacement(points.reshape(-1, 2)).reshape(points.shape))
    normal = np.column_stack([along[:, 1], -along[:, 0]])
    return _summed(cell_of_corner(mesh.offsets), mean[:, :, None] * normal[:, None, :], mesh.n_cells)


def _over_faces(mesh: PolyhedralMesh, displacement: Callable[[Floats], Floats]) -> Floats:
    """int_dK u (x) n ds, (n_cells, 3, 3)."""
    every, total = np.arange(mesh.n_faces), np.zeros((mesh.n_faces, 3))
    for group in face_groups(mesh.points, mesh.face_offsets, mesh.face_vertices, every):
        points, shares = group.quadrature()
        values = displacement(points.reshape(-1, 3)).reshape(points.shape)
        total[group.faces] = np.einsum("fq,fqa->fa", shares.sum(axis=1), values)
    flux = total[:, :, None] * mesh.face_normals[:, None, :]
    outward = mesh.face_signs[:, None, None] * flux[mesh.cell_faces]
    return _summed(cell_of_corner(mesh.cell_offsets), outward, mesh.n_cells)


def _summed(cell: Ints, parts: Floats, cells: int) -> Floats:
    dim = parts.shape[1]
    sums = [totals(cell, parts[:, a, b], cells) for a in range(dim) for b in range(dim)]
    return np.stack(sums, axis=1).reshape(cells, dim, dim)
