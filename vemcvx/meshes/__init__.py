"""Polygonal meshes: the mesh itself, seven families of meshes of a box, an L, refinement, files, other libraries."""

from vemcvx.meshes.families.distorted import distorted
from vemcvx.meshes.families.hanging import hanging
from vemcvx.meshes.families.hexagons import hexagons
from vemcvx.meshes.families.l_shape import l_shape
from vemcvx.meshes.families.nonconvex import nonconvex
from vemcvx.meshes.families.squares import squares
from vemcvx.meshes.families.triangles import triangles
from vemcvx.meshes.families.voronoi import voronoi
from vemcvx.meshes.interfaces import Interface
from vemcvx.meshes.local_refinement.refine import Refinement, refinement
from vemcvx.meshes.polygon_mesh import PolygonMesh, convert, read
from vemcvx.meshes.several_bodies.bodies import bodies

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
    "Interface",
    "PolygonMesh",
    "Refinement",
    "bodies",
    "convert",
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
