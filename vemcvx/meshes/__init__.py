"""Polygonal meshes: the mesh itself, families of meshes of a box, an L, refinement, files, other libraries.

In space: polyhedral meshes, and families of meshes of a box.
"""

from vemcvx.meshes.any_mesh import AnyMesh, plane_mesh
from vemcvx.meshes.families.cubes import cubes
from vemcvx.meshes.families.distorted import distorted
from vemcvx.meshes.families.hanging import hanging
from vemcvx.meshes.families.hexagons import hexagons
from vemcvx.meshes.families.kelvin import kelvin
from vemcvx.meshes.families.l_shape import l_shape
from vemcvx.meshes.families.nonconvex import nonconvex
from vemcvx.meshes.families.prisms import prisms
from vemcvx.meshes.families.squares import squares
from vemcvx.meshes.families.tetrahedra import tetrahedra
from vemcvx.meshes.families.triangles import triangles
from vemcvx.meshes.families.voronoi import voronoi
from vemcvx.meshes.families.voronoi3 import voronoi3
from vemcvx.meshes.foreign import convert, read
from vemcvx.meshes.interfaces import Interface
from vemcvx.meshes.local_refinement.refine import Refinement, refinement
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh
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
SPACE_FAMILIES = {
    "cubes": cubes,
    "tetrahedra": tetrahedra,
    "prisms": prisms,
    "voronoi3": voronoi3,
    "kelvin": kelvin,
}

__all__ = [
    "FAMILIES",
    "SPACE_FAMILIES",
    "AnyMesh",
    "Interface",
    "PolygonMesh",
    "PolyhedralMesh",
    "Refinement",
    "bodies",
    "convert",
    "cubes",
    "distorted",
    "hanging",
    "hexagons",
    "kelvin",
    "l_shape",
    "nonconvex",
    "plane_mesh",
    "prisms",
    "read",
    "refinement",
    "squares",
    "tetrahedra",
    "triangles",
    "voronoi",
    "voronoi3",
]
