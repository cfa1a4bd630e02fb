"""Refinement of any mesh: polygons and tetrahedra locally, other polyhedra globally."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import brief, read_only
from vemcvx.base.errors import MeshError
from vemcvx.meshes.bisection import ALL_DIRECTIONS, bisect_cells, check_tetrahedra, other_cells, split_about_vertices
from vemcvx.meshes.carrying import Refinement, check_marks
from vemcvx.meshes.local_refinement import refine_polygons
from vemcvx.meshes.mesh import Mesh
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh

Kind = TypeVar("Kind", bound=Mesh)


def refinement(mesh: Kind, cells: ArrayLike | None = None) -> Refinement[Kind]:
    """Split some cells of a mesh, in the plane or in space.

    Parameters
    ----------
    mesh : PolygonMesh or PolyhedralMesh
        Any plane mesh, or a mesh of tetrahedra. In other meshes in space, all cells are split or none.
    cells : (m,) array_like of int or (n_cells,) array_like of bool, optional
        Cells to split; each tetrahedron gets at least two parts. By default all cells are split, and each tetrahedron
        gets at least eight parts. In the plane, further cells are split until no side gets a second hanging node. In
        space, neighbours of split tetrahedra are split as well, and there are no hanging nodes.

    Returns
    -------
    Refinement
        The new mesh, and the parent of each cell.

    Raises
    ------
    MeshError
        ``cells`` are neither numbers of cells nor one bool per cell; the midpoint of an edge is lost in rounding; a
        polygon to split is not star-shaped or has no two long sides; only some cells of a mesh in space are to be
        split, and not all cells are tetrahedra; or a part of a polyhedron would have a face that is not plane.

    Examples
    --------
    >>> import vemcvx as vx
    >>> vx.meshes.refinement(vx.meshes.tetrahedra(1)).mesh.n_cells
    48
    """
    if not isinstance(mesh, (PolygonMesh, PolyhedralMesh)):
        raise MeshError(f"refinement: mesh must be a PolygonMesh or PolyhedralMesh; got {brief(mesh)}.")
    marked = check_marks(cells, mesh.n_cells)
    if not marked.any():
        return Refinement(mesh, read_only(np.arange(mesh.n_cells)))
    found: Any
    if isinstance(mesh, PolygonMesh):
        found = refine_polygons(mesh, marked)
    elif marked.all() and len(other_cells(mesh)):
        found = split_about_vertices(mesh)
    else:
        check_tetrahedra(mesh, "refine")
        found = bisect_cells(mesh, marked, ALL_DIRECTIONS if cells is None else 1)
    return found
