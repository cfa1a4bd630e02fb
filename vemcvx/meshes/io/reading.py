"""What files and objects hold, made a mesh of the plane or of space."""

from __future__ import annotations

from vemcvx.arrays import Floats
from vemcvx.meshes.io.blocks import SOLIDS, Blocks, plane_mesh_of
from vemcvx.meshes.io.solids import space_mesh_of
from vemcvx.meshes.space_tessellation import SpaceTessellation
from vemcvx.meshes.tessellation import Tessellation


def mesh_of(points: Floats, blocks: Blocks) -> tuple[Tessellation | SpaceTessellation, list[str]]:
    """Return the mesh of the solids that there are, or else of the polygons, and notes on what was left out."""
    if any(kind in SOLIDS for kind, _ in blocks.cells):
        return space_mesh_of(points, blocks)
    return plane_mesh_of(points, blocks)
