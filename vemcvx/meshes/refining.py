"""Refinement of any mesh: polygons and tetrahedra locally, other polyhedra globally."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from vemcvx.meshes.bisection import ALL_DIRECTIONS, bisect_cells, check_tetrahedra, other_cells, split_about_vertices
from vemcvx.meshes.carrying import check_marks
from vemcvx.meshes.local_refinement import refine_polygons
from vemcvx.meshes.polygon_mesh import PolygonMesh


def refine_mesh(mesh: Any, cells: ArrayLike | None = None) -> Any:
    """Return the mesh with some cells split: see :meth:`vemcvx.PolygonMesh.refine`."""
    marked = check_marks(cells, mesh.n_cells)
    if not marked.any():
        return mesh
    if isinstance(mesh, PolygonMesh):
        return refine_polygons(mesh, marked)
    if marked.all() and len(other_cells(mesh)):
        return split_about_vertices(mesh)
    check_tetrahedra(mesh, "refine")
    return bisect_cells(mesh, marked, ALL_DIRECTIONS if cells is None else 1)
