"""Polygonal meshes: the mesh itself, seven families of meshes of a box, an L, refinement, files."""

from vemcvx.meshes.distorted import distorted
from vemcvx.meshes.files import read
from vemcvx.meshes.hanging import hanging
from vemcvx.meshes.hexagons import hexagons
from vemcvx.meshes.l_shape import l_shape
from vemcvx.meshes.nonconvex import nonconvex
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.refine import Refinement, refinement
from vemcvx.meshes.squares import squares
from vemcvx.meshes.triangles import triangles
from vemcvx.meshes.voronoi import voronoi

FAMILIES = {
    "squares": squares,
    "triangles": triangles,
    "hexagons": hexagons,
    "voronoi": voronoi,
    "distorted": distorted,
    "nonconvex": nonconvex,
    "hanging": hanging,
}

__all__ = [
    "FAMILIES",
    "PolygonMesh",
    "Refinement",
    "distorted",
    "hanging",
    "hexagons",
    "l_shape",
    "nonconvex",
    "read",
    "refinement",
    "squares",
    "triangles",
    "voronoi",
]
