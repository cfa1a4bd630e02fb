"""The mesh of space that users hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from numpy.typing import ArrayLike

from vemcvx.arrays import brief
from vemcvx.canvas import draw_faces
from vemcvx.errors import MeshError
from vemcvx.meshes.box import plotted_points, plotted_values
from vemcvx.meshes.cracks import cut_in_space
from vemcvx.meshes.exported import Exported
from vemcvx.meshes.polygons import rows_in_order
from vemcvx.meshes.polyhedral_refinement import refined_mesh
from vemcvx.meshes.quality import Quality, quality_of
from vemcvx.meshes.tessellation import SpaceTessellation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False, init=False)
class PolyhedralMesh(SpaceTessellation, Exported):
    """A polyhedral mesh of a domain in space.

    Cells are polyhedra with plane faces; two cells meet in whole faces of both, so that where a large cell meets four
    small ones it has four coplanar faces. Neither cells nor faces need be convex.

    Parameters
    ----------
    points : (n_nodes, 3) array_like of float
        Node coordinates, in consistent units.
    cells : sequence of sequences of index sequences, or (n_cells, faces, vertices) array of int
        Faces of each cell, each the vertices in order around it. Those that do not run counter-clockwise seen from
        outside are turned, with a `MeshWarning`.
    boundaries : mapping of str to array_like, optional
        Named sets of boundary faces: their numbers, or rows of their vertices. The name "boundary" (all of it) is
        always there, and means nothing else. If none are given, faces where x, y or z is least or greatest are "left",
        "right", "front", "back", "bottom" and "top"; an empty mapping names nothing.
    cell_data : mapping of str to (n_cells, ...) array_like, optional
        Data on cells, such as moduli or material numbers.
    interfaces : mapping of str to Interface, optional
        Faces of one body that are also those of another, with nodes of their own.

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
    interfaces : mapping of str to Interface
        Where several bodies meet: see :func:`vemcvx.meshes.bodies`.
    node_map : (n,) int or None
        If nodes that no cell uses were dropped: new number of each given node, -1 if dropped. Else None.

    Raises
    ------
    MeshError
        The points and cells are no valid mesh; the message names the cell or node and what to do. A face is plane if
        its vertices are no farther from its plane than 1e-6 of its diameter.

    Warns
    -----
    MeshWarning
        Faces were turned, or unused nodes dropped.

    Notes
    -----
    All arrays are read-only. Node and cell order are those given; faces are numbered as cells first name them.
    """

    NAMED_BY_PLACE = True

    def refine(self, cells: ArrayLike | None = None, *, balance: bool = True) -> Self:
        """Return this mesh with cells split (numbers, or a bool each; None: all): :func:`vemcvx.meshes.refinement`."""
        return refined_mesh(self, cells, balance)

    def quality(self) -> Quality:
        """Shapes of the cells, as of `PolygonMesh.quality`: which says what is warned of."""
        return quality_of(self)

    def cut(self, name: str, sides: Mapping[str, ArrayLike]) -> Self:
        """Return this mesh with a crack: the faces between two sets of its cells become an interface.

        As `PolygonMesh.cut`, of faces in place of edges: nodes along the front of the crack inside the mesh stay
        single, and a face all of whose nodes would be there cannot open.
        """
        return cut_in_space(self, name, sides)

    def plot(
        self,
        values: str | ArrayLike | None = None,
        ax: Axes | None = None,
        *,
        displacement: ArrayLike | None = None,
        on: str = "boundary",
        **style: object,
    ) -> Axes:
        """Draw the faces of the boundary, coloured by ``values`` of their cells if given.

        Parameters
        ----------
        values, ax, displacement : as of `PolygonMesh.plot`
            The axes are three-dimensional; what is returned and raised is the same, too.
        on : str
            The part of the boundary to draw.
        **style
            Passed to matplotlib's Poly3DCollection (``cmap``, ``edgecolor``, ``linewidth``, ``alpha`` ...).
        """
        if not isinstance(on, str) or on not in self.boundaries:
            raise MeshError(f"there is no boundary {on!r}; this mesh has {', '.join(self.boundaries)}.")
        if ax is not None and getattr(ax, "name", "") != "3d":
            raise MeshError(f"ax must be axes in space, figure.add_subplot(projection='3d'); got {brief(ax)}.")
        faces = self.boundaries[on]
        offsets, vertices = rows_in_order(self.face_offsets, self.face_vertices, faces)
        on_cells = None if values is None else plotted_values(values, self.cell_data, self.n_cells)
        return draw_faces(
            plotted_points(self.points, displacement),
            offsets,
            vertices,
            values=None if on_cells is None else on_cells[self.face_cells[faces, 0]],
            ax=ax,
            style=style,
        )
