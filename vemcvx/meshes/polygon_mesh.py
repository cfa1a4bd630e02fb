"""The mesh that users hold: a tessellation that refines, writes and draws itself."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self

from numpy.typing import ArrayLike

from vemcvx.canvas import draw_cells
from vemcvx.meshes.checks.names import plotted_points, plotted_values
from vemcvx.meshes.io.files import load, write
from vemcvx.meshes.local_refinement.refine import refinement
from vemcvx.meshes.tessellation import Tessellation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False, init=False)
class PolygonMesh(Tessellation):
    """A polygonal mesh of a plane domain.

    Parameters
    ----------
    points : (n_nodes, 2) array_like of float
        Node coordinates, in consistent units.
    cells : sequence of index sequences, or (n_cells, k) array of int
        Vertices of each cell, in order around it. Clockwise cells are turned, with a `MeshWarning`.
    boundaries : mapping of str to (m, 2) array_like of int, optional
        Named sets of boundary edges, in either direction. The name "boundary" (all of it) is always there.
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

    def write(self, path: str | Path) -> None:
        """Write the mesh, its named boundaries and cell data; `read` gives them back to the bit.

        Parameters
        ----------
        path : str or Path
            The suffix chooses the format: .vtu and .vtk take every mesh, other formats of meshio triangles and quads.
            (.vtk gives rows of two cell data back as rows of three, the last zero.)

        Raises
        ------
        MeshError
            The format would lose cells, or the file cannot be written.
        """
        write(path, self)

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


def read(path: str | Path) -> PolygonMesh:
    """Read a mesh from a file in any format of meshio.

    Named boundaries are those that `PolygonMesh.write` wrote, or the physical groups of lines of a Gmsh file (their
    number if they have no name). Cell data come along; a physical group of surfaces is a cell datum of its name, 1 in
    the group and 0 outside. Node and cell order are the file's; a constant third coordinate is dropped.

    Parameters
    ----------
    path : str or Path
        The file; its suffix tells the format.

    Returns
    -------
    PolygonMesh
        The mesh, checked.

    Raises
    ------
    MeshError
        There is no such file, it is damaged or foreign, or what it holds is no plane mesh of polygons.

    Warns
    -----
    MeshWarning
        Cells were turned, unused nodes dropped, or named lines inside the mesh left out.
    """
    found = load(path)
    mesh = object.__new__(PolygonMesh)
    mesh.__dict__.update(found.__dict__)
    return mesh
