"""The mesh: points, polygonal cells, named parts of the boundary, data on cells; immutable.

Cells are simple polygons listed counter-clockwise; two cells meet in whole edges and vertices of both. A vertex may
lie on a straight line between its neighbours (a hanging node of the cell next door) and cells need not be convex.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.errors import MeshWarning
from vemcvx.meshes import geometry, topology
from vemcvx.meshes.geometry import Floats
from vemcvx.meshes.grid import Box
from vemcvx.meshes.named import check_boundaries, check_cell_data, check_datum_name, choose_edges, side_edges
from vemcvx.meshes.topology import Ints
from vemcvx.meshes.validity import checked

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False, init=False)
class PolygonMesh:
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

    points: Floats
    offsets: Ints
    vertices: Ints
    cell_data: Mapping[str, NDArray[Any]]
    node_map: Ints | None
    _named: Mapping[str, Ints]
    _box: Box | None

    def __init__(
        self,
        points: ArrayLike,
        cells: Sequence[ArrayLike] | NDArray[np.integer],
        *,
        boundaries: Mapping[str, ArrayLike] | None = None,
        cell_data: Mapping[str, ArrayLike] | None = None,
    ):
        mesh = checked(points, cells)
        for note in mesh.notes:
            warnings.warn(note, MeshWarning, stacklevel=2)
        self._fill(mesh.points, mesh.offsets, mesh.vertices, node_map=mesh.node_map)
        named = check_boundaries(boundaries, self._boundary, self.n_nodes, mesh.node_map)
        object.__setattr__(self, "_named", named)
        object.__setattr__(self, "cell_data", MappingProxyType(check_cell_data(cell_data, self.n_cells)))

    @classmethod
    def unchecked(cls, points: Floats, offsets: Ints, vertices: Ints, box: Box | None = None) -> PolygonMesh:
        """Return a mesh of arrays known to be valid, without copy or check; its sides are named if ``box`` is given."""
        mesh = object.__new__(cls)
        mesh._fill(points, offsets, vertices, _box=box)
        return mesh

    def _fill(self, points: Floats, offsets: Ints, vertices: Ints, **others: object) -> None:
        fields = {
            "points": _frozen(points),
            "offsets": _frozen(offsets),
            "vertices": _frozen(vertices),
            "cell_data": MappingProxyType({}),
            "node_map": None,
            "_named": {},
            "_box": None,
            **others,
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    def _replace(self, **fields: object) -> PolygonMesh:
        """Return a mesh that shares everything, also what is already computed, but the given fields."""
        mesh = object.__new__(type(self))
        mesh.__dict__.update({key: value for key, value in self.__dict__.items() if key != "boundaries"})
        mesh.__dict__.update(fields)
        return mesh

    def __getstate__(self) -> dict[str, object]:
        kept = {name: getattr(self, name) for name in ("points", "offsets", "vertices", "node_map", "_named", "_box")}
        return {**kept, "cell_data": dict(self.cell_data)}  # a mapping proxy cannot be pickled

    def __setstate__(self, state: dict[str, Any]) -> None:
        data = {name: _frozen(values) for name, values in state.pop("cell_data").items()}
        named = {name: _frozen(edges) for name, edges in state.pop("_named").items()}
        self._fill(**state, cell_data=MappingProxyType(data), _named=named)

    def __repr__(self) -> str:
        names = ", ".join(self.boundaries)
        return f"PolygonMesh({self.n_cells} cells, {self.n_nodes} nodes, h = {self.h:.4g}, boundaries: {names})"

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.offsets) - 1

    @cached_property
    def cells(self) -> tuple[Ints, ...]:
        """Vertex numbers of each cell, counter-clockwise: one view an array of ``vertices`` a cell."""
        return tuple(self.vertices[start:end] for start, end in pairwise(self.offsets.tolist()))

    @cached_property
    def _areas_and_centroids(self) -> tuple[Floats, Floats]:
        areas, centroids = geometry.areas_and_centroids(self.points, self.offsets, self.vertices)
        return _frozen(areas), _frozen(centroids)

    @property
    def areas(self) -> Floats:
        """Area of each cell, (n_cells,)."""
        return self._areas_and_centroids[0]

    @property
    def centroids(self) -> Floats:
        """Centroid of each cell, (n_cells, 2)."""
        return self._areas_and_centroids[1]

    @cached_property
    def diameters(self) -> Floats:
        """Largest distance of two vertices of each cell, (n_cells,)."""
        return _frozen(geometry.diameters(self.points, self.offsets, self.vertices))

    @cached_property
    def h(self) -> float:
        """Mesh size: the largest cell diameter."""
        return float(self.diameters.max())

    @cached_property
    def _boundary(self) -> Ints:
        corners = topology.boundary_corners(self.offsets, self.vertices, self.n_nodes)
        ends = topology.next_vertex(self.offsets, self.vertices)
        return _frozen(np.column_stack([self.vertices[corners], ends[corners]]))

    @cached_property
    def boundaries(self) -> Mapping[str, Ints]:
        """Named parts of the boundary: name -> edges (m, 2); "boundary" is all of it.

        An edge (a, b) runs as in its counter-clockwise cell: the outward normal is (y_b - y_a, x_a - x_b) / length.
        """
        sides = {} if self._box is None else side_edges(self.points, self._boundary, self._box)
        return MappingProxyType({**sides, **self._named, "boundary": self._boundary})

    @cached_property
    def neighbours(self) -> Ints:
        """Pairs of cells that share an edge, (m, 2)."""
        return _frozen(topology.neighbours(self.offsets, self.vertices, self.n_nodes))

    def with_boundary(self, name: str, predicate: Callable[[Floats], NDArray[np.bool_]]) -> PolygonMesh:
        """Return this mesh with one more named part of its boundary.

        Parameters
        ----------
        name : str
            Its name; a part of that name is replaced, and parts may overlap.
        predicate : callable
            Takes the midpoints (m, 2) of all boundary edges, returns which belong: bool (m,).

        Raises
        ------
        MeshError
            The name is reserved or no string, the answer is not (m,) bool, or it selects nothing.
        """
        edges = choose_edges(name, predicate, self.points, self._boundary)
        return self._replace(_named={**self._named, name: _frozen(edges)})

    def with_boundaries(self, boundaries: Mapping[str, ArrayLike]) -> PolygonMesh:
        """Return this mesh with more named parts of its boundary: name -> edges (m, 2), in either direction.

        Raises
        ------
        MeshError
            A name is reserved, or an edge is not on the boundary.
        """
        added = check_boundaries(boundaries, self._boundary, self.n_nodes, None)
        return self._replace(_named={**self._named, **added})

    def with_cell_data(self, name: str, values: ArrayLike) -> PolygonMesh:
        """Return this mesh with one more (or another) array (n_cells, ...) of data on cells."""
        added = check_cell_data({check_datum_name(name): values}, self.n_cells)
        return self._replace(cell_data=MappingProxyType({**self.cell_data, **added}))

    def refine(self, cells: ArrayLike | None = None, *, balance: bool = True) -> PolygonMesh:
        """Return this mesh with cells split (numbers, or a bool each; None: all): :func:`vemcvx.meshes.refinement`."""
        from vemcvx.meshes.refine import refinement  # imports this module

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
        from vemcvx.meshes.files import write  # imports this module

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
        from vemcvx.canvas import draw_cells
        from vemcvx.meshes.named import plotted_points, plotted_values

        values = None if values is None else plotted_values(values, self.cell_data, self.n_cells)
        return draw_cells(plotted_points(self.points, displacement), self.offsets, self.vertices, values, ax, style)


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array
