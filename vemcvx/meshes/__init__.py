"""Meshes of polygons in the plane, and of polyhedra in space."""

from vemcvx.meshes.cracks import cut
from vemcvx.meshes.families.plane import distorted, hanging, hexagons, l_shape, nonconvex, ring, squares, triangles
from vemcvx.meshes.families.space import cubes, prisms, tetrahedra
from vemcvx.meshes.families.voronoi import kelvin, voronoi, voronoi3
from vemcvx.meshes.interfaces import Interface
from vemcvx.meshes.io.objects import convert
from vemcvx.meshes.mesh import Mesh
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygon_mesh import plane_mesh as plane_mesh
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh
from vemcvx.meshes.reading import read
from vemcvx.meshes.several_bodies import bodies

FAMILIES = {
    "squares": squares,
    "triangles": triangles,
    "hexagons": hexagons,
    "voronoi": voronoi,
    "distorted": distorted,
    "nonconvex": nonconvex,
    "hanging": hanging,
}
SPACE_FAMILIES = {"cubes": cubes, "tetrahedra": tetrahedra, "prisms": prisms, "voronoi3": voronoi3, "kelvin": kelvin}

__all__ = [
    "FAMILIES",
    "SPACE_FAMILIES",
    "Interface",
    "Mesh",
    "PolygonMesh",
    "PolyhedralMesh",
    "bodies",
    "convert",
    "cubes",
    "cut",
    "distorted",
    "hanging",
    "hexagons",
    "kelvin",
    "l_shape",
    "nonconvex",
    "prisms",
    "read",
    "ring",
    "squares",
    "tetrahedra",
    "triangles",
    "voronoi",
    "voronoi3",
]
