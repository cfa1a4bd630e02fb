"""Meshes of the plane or of space, and the sentence that refuses the latter where only the former will do."""

from __future__ import annotations

from vemcvx.errors import SceneError
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh

AnyMesh = PolygonMesh | PolyhedralMesh


def plane_mesh(mesh: AnyMesh, subject: str, instead: str = "") -> PolygonMesh:
    """The mesh, if it is of polygons.

    Raises
    ------
    SceneError
        It is of polyhedra; `subject` exists in the plane only, and `instead` says what to do.
    """
    if isinstance(mesh, PolyhedralMesh):
        raise SceneError(
            f"{subject}: exists in the plane only, and this mesh is of polyhedra{instead and f'; {instead}'}."
        )
    return mesh
