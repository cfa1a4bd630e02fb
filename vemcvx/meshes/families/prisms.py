"""Layers of prisms over polygons."""

from __future__ import annotations

from vemcvx.meshes.box import UNIT_CUBE, SpaceCorners, SpaceCount, check_space_box, space_counts, ticks
from vemcvx.meshes.families.voronoi import voronoi
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh


def prisms(
    n: SpaceCount | None = None, box: SpaceCorners = UNIT_CUBE, seed: int = 0, *, size: float | None = None
) -> PolyhedralMesh:
    """Mesh a box with upright prisms over the rounded irregular polygons of `voronoi`, in equal layers.

    Prisms over any other polygons are made by :meth:`vemcvx.PolygonMesh.extruded`.

    Parameters
    ----------
    n, box, seed, size : as of `cubes`
        Which has as many cells.

    Returns
    -------
    PolyhedralMesh
        Nodes and cells layer by layer.
    """
    whole = check_space_box(box)
    nx, ny, nz = space_counts(n, whole, size)
    x, y, (low, high) = box
    return voronoi((nx, ny), (x, y), seed).extruded(ticks(low, high, nz))
