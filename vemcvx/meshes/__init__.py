"""Polygonal meshes: the mesh itself, seven families of meshes of a box, files."""

from .distorted import distorted
from .files import read
from .hanging import hanging
from .hexagons import hexagons
from .nonconvex import nonconvex
from .polygon_mesh import PolygonMesh
from .squares import squares
from .triangles import triangles
from .voronoi import voronoi

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
    "distorted",
    "hanging",
    "hexagons",
    "nonconvex",
    "read",
    "squares",
    "triangles",
    "voronoi",
]
