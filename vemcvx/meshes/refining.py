"""Refinement of any mesh: polygons and tetrahedra locally, other polyhedra as a whole."""

from __future__ import annotations

from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array, eye_array

from vemcvx.base.arrays import brief, flag, read_only
from vemcvx.base.errors import MeshError
from vemcvx.meshes.bisection import ALL_DIRECTIONS, bisected, check_tetrahedra, other_cells, split_about_vertices
from vemcvx.meshes.carrying import Refinement, check_marks
from vemcvx.meshes.local_refinement import refined_in_plane
from vemcvx.meshes.mesh import Mesh
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh

Kind = TypeVar("Kind", bound=Mesh)


def refinement(mesh: Kind, cells: ArrayLike | None = None, *, balance: bool = True) -> Refinement[Kind]:
    """Split the given cells of a mesh, in the plane or in space.

    Parameters
    ----------
    mesh : PolygonMesh or PolyhedralMesh
        Any mesh in the plane. In space a mesh of tetrahedra; others only as a whole.
    cells : (m,) array_like of int or (n_cells,) array_like of bool, optional
        Cells to split; by default all. A tetrahedron is cut in two; if all are split, into eight at least.
    balance : bool
        In the plane, also split every cell of which a side would get a new hanging node beside another one, until no
        side has two of them (if none had before). In space no node hangs: tetrahedra beside split ones are cut, too.

    Returns
    -------
    Refinement
        The new mesh, the parent of each cell, and the prolongation of nodal values.

    Raises
    ------
    MeshError
        ``cells`` are not numbers of cells or one bool a cell, or edges to split are as short as rounding; in space,
        some cells are no tetrahedra, and are not all to be split, or their parts would have no plane faces.

    Examples
    --------
    >>> import vemcvx as vx
    >>> vx.meshes.refinement(vx.meshes.tetrahedra(1)).mesh.n_cells
    48
    """
    if not isinstance(mesh, (PolygonMesh, PolyhedralMesh)):
        raise MeshError(f"refinement: found {brief(mesh)} where a PolygonMesh or PolyhedralMesh is wanted.")
    balance, marked = flag(balance, "refinement: balance"), check_marks(cells, mesh.n_cells)
    if not marked.any():
        identity = csr_array(eye_array(mesh.n_nodes, format="csr"))
        return Refinement(mesh, read_only(np.arange(mesh.n_cells)), identity)
    found: Refinement[Any]
    if isinstance(mesh, PolygonMesh):
        found = refined_in_plane(mesh, marked, balance)
    elif marked.all() and len(other_cells(mesh)):
        found = split_about_vertices(mesh)
    else:
        check_tetrahedra(mesh, "refine")
        found = bisected(mesh, marked, ALL_DIRECTIONS if cells is None else 1)
    return cast("Refinement[Kind]", found)
