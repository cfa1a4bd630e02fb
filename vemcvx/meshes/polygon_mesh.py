"""The mesh that users hold: a tessellation that refines, writes and draws itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from numpy.typing import ArrayLike

from vemcvx.canvas import draw_cells
from vemcvx.meshes.box import plotted_points, plotted_values
from vemcvx.meshes.exported import Exported
from vemcvx.meshes.extrusion import extruded
from vemcvx.meshes.local_refinement import refinement
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh
from vemcvx.meshes.several_bodies import cut
from vemcvx.meshes.tessellation import Tessellation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False, init=False)
class PolygonMesh(Tessellation, Exported):
    """A polygonal mesh of a plane domain.

    Parameters
    ----------
    points : (n_nodes, 2) array_like of float
        Node coordinates, in consistent units.
    cells : sequence of index sequences, or (n_cells, k) array of int
        Vertices of each cell, in order around it. Clockwise cells are turned, with a `MeshWarning`.
    boundaries : mapping of str to (m, 2) array_like of int, optional
        Named sets of boundary edges, in either direction. The name "boundary" (all of it) is always
        there, and means nothing else.
    cell_data : mapping of str to (n_cells, ...) array_like, optional
        Data on cells, such as moduli or material numbers.

    Attributes
    ----------
    points : (n_nodes, 2) float
        Node coordinates.
    offsets, vertices : (n_cells + 1,) int, (n_corners,) int
        Cell c has the vertices ``vertices[offsets[c]:offsets[c + 1]]``, counter-clockwise.
    cell_data : mapping of str to (n_cells, ...) array
        Data on cells.
    node_map : (n,) int or None
        If nodes that no cell uses were dropped: new number of each given node, -1 if dropped. Else None.

    Raises
    ------
    MeshError
        The points and cells are no valid mesh; the message names the cell or node and what to do.

    Warns
    -----
    MeshWarning
        Clockwise cells were turned, or unused nodes dropped.

    Notes
    -----
    All arrays are read-only. Node and cell order are those given.
    """

    def refine(self, cells: ArrayLike | None = None, *, balance: bool = True) -> Self:
        """Return this mesh with cells split (numbers, or a bool each; None: all): :func:`vemcvx.meshes.refinement`."""
        return refinement(self, cells, balance=balance).mesh

    def cut(self, name: str, sides: Mapping[str, ArrayLike]) -> Self:
        """Return this mesh with a crack: the edges between two sets of its cells become an interface.

        Nodes along the crack become double, the new ones last; a tip inside the mesh keeps its one node. Cells that are
        on neither side are left alone, so that sets near the crack say how long it is.

        Parameters
        ----------
        name : str
            Name of the crack, as an interface and as a boundary (the edges of the first side).
        sides : mapping of str to array_like
            Names of the two sides -> their cells: numbers, or a bool each.

        Raises
        ------
        MeshError
            The sides have a cell in common or no edge between them, an edge would have a tip at both ends, or the name
            is taken.
        """
        return cut(self, name, sides)

    def extruded(self, heights: ArrayLike) -> PolyhedralMesh:
        """Return the mesh in space of the prisms over these cells, a layer between any two heights.

        Parameters
        ----------
        heights : (layers + 1,) array_like
            The z of the bottom of the first layer, then of the top of each, increasing.

        Returns
        -------
        PolyhedralMesh
            Nodes and cells layer by layer, in the order they have here; cell data are those of the polygons below.
            Named parts of the boundary keep their names and become the sides above them; but "bottom" and "top" are
            the lowest and the highest polygons, and what had these names in the plane is "front" and "back".

        Raises
        ------
        MeshError
            The heights do not increase, the mesh has interfaces, or it has both names of a side in the plane and in
            space ("bottom" and "front", "top" and "back").
        """
        return extruded(self, heights)

    def plot(
        self,
        values: str | ArrayLike | None = None,
        ax: Axes | None = None,
        *,
        displacement: ArrayLike | None = None,
        **style: object,
    ) -> Axes:
        """Draw the cells, coloured by ``values`` if given.

        Parameters
        ----------
        values : (n_cells,) array_like or str, optional
            One number a cell, or the name of a cell datum.
        ax : matplotlib Axes, optional
            Where to draw; by default on a new figure (``ax.figure.savefig(...)`` saves it).
        displacement : (n_nodes, 2) array_like, optional
            Added to the points.
        **style
            Passed to matplotlib's PolyCollection (``cmap``, ``edgecolor``, ``linewidth``, ``clim`` ...).

        Returns
        -------
        Axes
            The axes drawn on.

        Raises
        ------
        VemcvxError
            matplotlib is not installed.
        MeshError
            ``values`` or ``displacement`` do not fit the mesh.
        """
        values = None if values is None else plotted_values(values, self.cell_data, self.n_cells)
        return draw_cells(
            plotted_points(self.points, displacement),
            self.offsets,
            vertices=self.vertices,
            values=values,
            ax=ax,
            style=style,
        )
