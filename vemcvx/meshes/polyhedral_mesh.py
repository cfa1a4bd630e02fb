"""The mesh of space that users hold."""

from __future__ import annotations

from dataclasses import dataclass

from vemcvx.meshes.space_tessellation import SpaceTessellation


@dataclass(frozen=True, eq=False, repr=False, init=False)
class PolyhedralMesh(SpaceTessellation):
    """A polyhedral mesh of a domain in space.

    Cells are polyhedra with plane faces; two cells meet in whole faces of both, so that where a large cell meets four
    small ones it has four coplanar faces. Neither cells nor faces need be convex.

    Attributes
    ----------
    points : (n_nodes, 3) float
        Node coordinates.
    face_offsets, face_vertices : (n_faces + 1,) int, (n_corners,) int
        Face f has the vertices ``face_vertices[face_offsets[f]:face_offsets[f + 1]]``; by the right-hand rule their
        order gives the normal out of its first cell.
    face_cells : (n_faces, 2) int
        First and second cell of each face; the second is -1 on the boundary.
    cell_offsets, cell_faces : (n_cells + 1,) int, (m,) int
        Cell c has the faces ``cell_faces[cell_offsets[c]:cell_offsets[c + 1]]``.
    cell_data : mapping of str to (n_cells, ...) array
        Data on cells.
    interfaces : mapping
        Empty: bodies are put together in the plane only.
    node_map : (n,) int or None
        If nodes that no cell uses were dropped: new number of each given node, -1 if dropped. Else None.

    Notes
    -----
    All arrays are read-only. Node and cell order are those given; faces are numbered as cells first name them.
    """
