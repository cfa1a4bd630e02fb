"""Meshes of polygons in the plane, and the prisms over them in space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.base.arrays import Floats, Ints, plain, read_only
from vemcvx.base.canvas import draw_cells
from vemcvx.base.errors import MeshError, SceneError
from vemcvx.meshes import polygons
from vemcvx.meshes.box import LARGEST, SHORTEST, WHOLE, plotted_points, plotted_values
from vemcvx.meshes.checks.plane import checked
from vemcvx.meshes.interfaces import Interface, faces_of, on_boundary
from vemcvx.meshes.mesh import Mesh, Sides
from vemcvx.meshes.polygons import backwards, cell_of_corner, next_vertex, offsets_of, rows_in_order
from vemcvx.meshes.polyhedra import joined_faces
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False, init=False)
class PolygonMesh(Mesh):
    """A polygonal mesh of a plane domain.

    Parameters
    ----------
    points : (n_nodes, 2) array_like of float
        Node coordinates, in consistent units.
    cells : sequence of index sequences, or (n_cells, k) array of int
        Vertices of each cell, in order around it. Clockwise cells are turned, with a `MeshWarning`.
    boundaries : mapping of str to (m, 2) array_like of int, optional
        Named sets of boundary edges, in either direction. The name "boundary" (all of it) is always
        there, and means nothing else. If none are given, edges where x or y is least or greatest are "left",
        "right", "bottom" and "top", as families and readers of files name them; an empty mapping names nothing.
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

    offsets: Ints
    vertices: Ints

    ARRAYS = ("points", "offsets", "vertices")
    NUMBERED = MappingProxyType({"vertices": "n_nodes"})
    PARTS, A_PART = "edges", "an edge"

    def __init__(
        self,
        points: ArrayLike,
        cells: Sequence[ArrayLike] | NDArray[np.integer],
        *,
        boundaries: Mapping[str, ArrayLike] | None = None,
        cell_data: Mapping[str, ArrayLike] | None = None,
        interfaces: Mapping[str, Interface] | None = None,
    ):
        self._take(checked(points, cells, interfaces), boundaries, cell_data)

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.offsets) - 1

    @cached_property
    def cells(self) -> tuple[Ints, ...]:
        """Vertex numbers of each cell, counter-clockwise: one view an array of ``vertices`` a cell."""
        return tuple(self.vertices[start:end] for start, end in pairwise(self.offsets.tolist()))

    def _measured(self) -> tuple[Floats, Floats]:
        return polygons.areas_and_centroids(self.points, self.offsets, self.vertices)

    @property
    def areas(self) -> Floats:
        """Area of each cell, (n_cells,)."""
        return self.measures

    @property
    def cell_nodes(self) -> tuple[Ints, Ints]:
        """Offsets (n_cells + 1,), and the vertices of each cell between them, counter-clockwise."""
        return self.offsets, self.vertices

    @cached_property
    def shared_edges(self) -> polygons.SharedEdges:
        """Corners by the edge that they start."""
        return polygons.shared_edges(self.offsets, self.vertices, self.n_nodes)

    @cached_property
    def _sides(self) -> Sides:
        shared = self.shared_edges
        cell, corner = polygons.cell_of_corner(self.offsets), shared.corners
        first, last = shared.first, shared.first + shared.counts - 1
        cells = np.column_stack([cell[corner[first]], np.where(shared.counts == 2, cell[corner[last]], -1)])
        edges = polygons.directed_edges(self.offsets, self.vertices)[corner[first]]
        return Sides(2 * np.arange(len(edges) + 1), edges.ravel(), cells)

    @cached_property
    def _outer_sides(self) -> Ints:
        return self.shared_edges.number[self.shared_edges.alone]

    @cached_property
    def _boundary(self) -> Ints:
        return read_only(self._outlines[1].reshape(-1, 2))

    @property
    def _middles(self) -> Floats:
        return 0.5 * (self.points[self._boundary[:, 0]] + self.points[self._boundary[:, 1]])

    def _places(self, parts: Ints) -> Ints:
        return polygons.positions(parts, self._boundary, self.n_nodes)

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
            Named parts of the boundary and interfaces keep their names and become the sides above them; but "bottom"
            and "top" are the lowest and the highest polygons, and what had these names in the plane is "front" and
            "back".

        Raises
        ------
        MeshError
            The heights do not increase, or the mesh has both names of a side in the plane and in space ("bottom" and
            "front", "top" and "back").
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


# Sides of the plane below and above are those in front and at the back of a box in space.
RENAMED = {"bottom": "front", "top": "back"}


def extruded(mesh: PolygonMesh, heights: ArrayLike) -> PolyhedralMesh:
    """Return the prisms over the cells of a plane mesh: see :meth:`vemcvx.PolygonMesh.extruded`."""
    wanted = "heights must be at least two increasing numbers, the z of the layers' faces"
    given = plain(heights)
    if given is None or given.ndim != 1 or given.dtype.kind not in "iuf" or len(given) < 2:
        raise MeshError(f"{wanted}; got {heights!r}.")
    levels = given.astype(float)
    if not np.isfinite(levels).all() or np.abs(levels).max() > LARGEST or np.diff(levels).min() < SHORTEST:
        raise MeshError(f"{wanted}, at most {LARGEST:g} and {SHORTEST:g} apart; got {levels}.")
    named = _names_in_space(mesh)
    layers, nodes, cells = len(levels) - 1, mesh.n_nodes, mesh.n_cells
    offsets, vertices, owner = _layer(mesh)
    sizes = np.diff(offsets)
    shift = np.repeat(np.arange(layers), len(vertices)) * nodes
    joined = joined_faces(
        offsets_of(np.tile(sizes, layers)),
        np.tile(vertices, layers) + shift,
        offsets_of(np.tile(np.bincount(owner), layers)),
    )
    points = np.column_stack([np.tile(mesh.points, (layers + 1, 1)), np.repeat(levels, nodes)])
    solid = PolyhedralMesh.unchecked(points, *joined)
    level = nodes * np.arange(layers)[:, None, None]

    def above(ends: Ints) -> Ints:
        return (np.hstack([ends, ends[:, ::-1] + nodes]) + level).reshape(-1, 4)

    sides = {RENAMED.get(name, name): faces_of(above(edges), solid._outlines) for name, edges in named.items()}
    parts = {name: solid._boundary[places] for name, places in sides.items()}
    # In every layer, the first two faces of a cell are its bottom and its top.
    first = joined.cell_offsets[:-1].reshape(layers, cells)
    parts |= {"bottom": joined.cell_faces[first[0]], "top": joined.cell_faces[first[-1] + 1]}
    solid = solid.with_boundaries(parts)
    for name, values in mesh.cell_data.items():
        solid = solid.with_cell_data(name, np.concatenate([values] * layers))
    joints = {name: Interface(of.bodies, above(of.edges), above(of.partners)) for name, of in mesh.interfaces.items()}
    return solid._replace(interfaces=MappingProxyType(on_boundary(joints, solid._outlines)))


def _names_in_space(mesh: PolygonMesh) -> dict[str, Ints]:
    named = {name: edges for name, edges in mesh.boundaries.items() if name not in (*mesh.interfaces, WHOLE)}
    for old, new in RENAMED.items():
        if old in named and new in named:
            raise MeshError(
                f'the part {old!r} of the boundary is called {new!r} in space, where "bottom" and "top" are those in '
                f"z, but this mesh has a part {new!r} as well. Give one of them another name."
            )
    return named


def _layer(mesh: PolygonMesh) -> tuple[Ints, Ints, Ints]:
    """Faces of one layer, cell by cell and outwards: offsets, vertices (of the level above from n_nodes on), owners."""
    below = mesh.vertices
    after = next_vertex(mesh.offsets, below)
    sides = np.column_stack([below, after, after + mesh.n_nodes, below + mesh.n_nodes])
    counts = np.diff(mesh.offsets)
    vertices = np.concatenate([below[backwards(mesh.offsets)], below + mesh.n_nodes, sides.ravel()])
    sizes = np.concatenate([counts, counts, np.full(len(below), 4)])
    cells = np.arange(mesh.n_cells)
    owner = np.concatenate([cells, cells, cell_of_corner(mesh.offsets)])
    order = np.argsort(owner, kind="stable")
    return *rows_in_order(offsets_of(sizes), vertices, order), owner[order]


def plane_mesh(mesh: Mesh, subject: str, instead: str = "") -> PolygonMesh:
    """Return the mesh if it is of polygons.

    Raise SceneError where it is of polyhedra; `subject` exists in the plane only, and `instead` says what to do.
    """
    if not isinstance(mesh, PolygonMesh):
        raise SceneError(
            f"{subject}: exists in the plane only, and this mesh is of polyhedra{instead and f'; {instead}'}."
        )
    return mesh
