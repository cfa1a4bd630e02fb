"""Meshes of polygons in the plane, and extrusion to prisms."""

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
from vemcvx.meshes.box import LARGEST, SHORTEST, WHOLE, check_cell_data
from vemcvx.meshes.checks.plane import check_polygon_mesh
from vemcvx.meshes.interfaces import Interface, faces_of, on_boundary
from vemcvx.meshes.mesh import Mesh, Sides
from vemcvx.meshes.polygons import backwards, cell_of_corner, next_vertex, offsets_of, rows_in_order
from vemcvx.meshes.polyhedra import join_faces
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False, init=False)
class PolygonMesh(Mesh):
    """A polygonal mesh of a plane domain.

    All arrays are read-only. Nodes and cells keep the given order. Clockwise cells are reversed, and unused nodes are
    dropped. A `MeshWarning` reports both.

    Parameters
    ----------
    points : (n_nodes, 2) array_like of float
        Node coordinates, in consistent units.
    cells : sequence of index sequences, or (n_cells, k) array of int
        Vertices of each cell, in order around the cell.
    boundaries : mapping of str to (m, 2) array_like of int, optional
        Name -> boundary edges, in either direction. By default, "left", "right", "bottom" and "top" are the edges
        with the least or greatest x or y. The name "boundary" is reserved for the whole boundary.
    cell_data : mapping of str to (n_cells, ...) array_like, optional
        Data on cells, such as moduli or material numbers.
    interfaces : mapping of str to Interface, optional
        Common edges of two bodies: see :func:`vemcvx.meshes.bodies`.

    Attributes
    ----------
    points, cell_data, interfaces : as the parameters
    offsets, vertices : (n_cells + 1,) int, (n_corners,) int
        Cell c has the vertices ``vertices[offsets[c]:offsets[c + 1]]``, counter-clockwise.
    node_map : (n,) int or None
        New numbers of the given nodes, -1 for dropped nodes. None if no node was dropped.

    Raises
    ------
    MeshError
        The points and cells do not form a valid mesh.

    Examples
    --------
    >>> vx.PolygonMesh([(0, 0), (2, 0), (2, 1), (1, 2), (0, 1)], [[0, 1, 2, 4], [4, 2, 3]])
    PolygonMesh(2 cells, 5 nodes, h = 2.236, boundaries: left, right, bottom, boundary)
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
        self._take(check_polygon_mesh(points, cells, interfaces), boundaries, cell_data)

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.offsets) - 1

    @cached_property
    def cells(self) -> tuple[Ints, ...]:
        """Vertex numbers of each cell, counter-clockwise."""
        return tuple(self.vertices[start:end] for start, end in pairwise(self.offsets.tolist()))

    def _measure_cells(self) -> tuple[Floats, Floats]:
        return polygons.areas_and_centroids(self.points, self.offsets, self.vertices)

    @property
    def areas(self) -> Floats:
        """Areas (n_cells,) of the cells."""
        return self.measures

    @property
    def cell_nodes(self) -> tuple[Ints, Ints]:
        """The pair (``offsets``, ``vertices``)."""
        return self.offsets, self.vertices

    @cached_property
    def shared_edges(self) -> polygons.SharedEdges:
        """The corners of cells, sorted by edge."""
        return polygons.sort_edges(self.offsets, self.vertices, self.n_nodes)

    @cached_property
    def _sides(self) -> Sides:
        shared = self.shared_edges
        cell, corner = polygons.cell_of_corner(self.offsets), shared.corners
        first, last = shared.first, shared.first + shared.counts - 1
        cells = np.column_stack([cell[corner[first]], np.where(shared.counts == 2, cell[corner[last]], -1)])
        edges = polygons.corner_edges(self.offsets, self.vertices)[corner[first]]
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
        """Return a mesh of prisms over the cells, in layers between consecutive heights.

        Parameters
        ----------
        heights : (layers + 1,) array_like
            Increasing values of z at the bottoms and tops of layers.

        Returns
        -------
        PolyhedralMesh
            Nodes and cells are ordered by layer. Boundaries and interfaces keep their names, except "bottom" and
            "top", which become "front" and "back". In space, "bottom" and "top" are the lowest and highest faces.

        Raises
        ------
        MeshError
            The heights do not increase, or this mesh has boundaries "bottom" and "front", or "top" and "back".

        Examples
        --------
        >>> vx.meshes.squares(2).extruded([0.0, 0.5, 1.0]).n_cells
        8
        """
        return extrude(self, heights)

    def plot(self, values: ArrayLike | None = None, ax: Axes | None = None, **style: object) -> Axes:
        """Draw the cells, coloured by ``values``.

        Parameters
        ----------
        values : (n_cells,) array_like, optional
            One number per cell. Without ``values`` and ``ax``, boundaries are labelled.
        ax : matplotlib Axes, optional
            Axes to draw on; by default a new figure. ``ax.figure.savefig(...)`` saves the figure.
        **style
            Options of matplotlib's PolyCollection (``cmap``, ``edgecolor``, ``linewidth``, ``clim`` ...).

        Returns
        -------
        Axes
            The axes with the picture.

        Raises
        ------
        MeshError
            ``values`` do not fit the mesh.
        """
        shown = None if values is None else check_cell_data({"values": values}, self.n_cells)["values"].astype(float)
        if shown is not None and shown.ndim != 1:
            raise MeshError(f"plot: values must be one number per cell, shape ({self.n_cells},); got {shown.shape}.")
        labels = [name for name in self.boundaries if ax is None and values is None and name != WHOLE]
        ax = draw_cells(self.points, self.offsets, vertices=self.vertices, values=shown, ax=ax, style=style)
        for name in labels:
            middles = self.points[self.boundaries[name]].mean(axis=1)
            at = middles[np.linalg.norm(middles - middles.mean(axis=0), axis=1).argmin()]
            ax.annotate(name, at, ha="center", va="center", bbox={"facecolor": "white", "linewidth": 0, "pad": 1})
        return ax


NAMES_IN_SPACE = {"bottom": "front", "top": "back"}  # name in the plane -> name in space


def extrude(mesh: PolygonMesh, heights: ArrayLike) -> PolyhedralMesh:
    """Return the mesh of :meth:`vemcvx.PolygonMesh.extruded`."""
    wanted = "heights must be at least two increasing numbers, the values of z that bound the layers"
    given = plain(heights)
    if given is None or given.ndim != 1 or given.dtype.kind not in "iuf" or len(given) < 2:
        raise MeshError(f"{wanted}; got {heights!r}.")
    levels = given.astype(float)
    if not np.isfinite(levels).all() or np.abs(levels).max() > LARGEST or np.diff(levels).min() < SHORTEST:
        raise MeshError(f"{wanted}, at most {LARGEST:g} in size and at least {SHORTEST:g} apart; got {levels}.")
    named = {name: edges for name, edges in mesh.boundaries.items() if name not in (*mesh.interfaces, WHOLE)}
    for old, new in NAMES_IN_SPACE.items():
        if old in named and new in named:
            raise MeshError(
                f'the boundary {old!r} would become {new!r}, because in space "bottom" and "top" are the sides in z. '
                f"But this mesh already has a boundary {new!r}. Rename one of them."
            )
    layers, nodes, cells = len(levels) - 1, mesh.n_nodes, mesh.n_cells
    offsets, vertices, owner = _layer(mesh)
    sizes = np.diff(offsets)
    shift = np.repeat(np.arange(layers), len(vertices)) * nodes
    joined = join_faces(
        offsets_of(np.tile(sizes, layers)),
        np.tile(vertices, layers) + shift,
        offsets_of(np.tile(np.bincount(owner), layers)),
    )
    points = np.column_stack([np.tile(mesh.points, (layers + 1, 1)), np.repeat(levels, nodes)])
    solid = PolyhedralMesh.unchecked(points, *joined)
    level = nodes * np.arange(layers)[:, None, None]

    def above(ends: Ints) -> Ints:
        return (np.hstack([ends, ends[:, ::-1] + nodes]) + level).reshape(-1, 4)

    sides = {NAMES_IN_SPACE.get(name, name): faces_of(above(edges), solid._outlines) for name, edges in named.items()}
    parts = {name: solid._boundary[places] for name, places in sides.items()}
    # The bottom and the top are the first two faces of a prism.
    first = joined.cell_offsets[:-1].reshape(layers, cells)
    parts |= {"bottom": joined.cell_faces[first[0]], "top": joined.cell_faces[first[-1] + 1]}
    solid = solid._with_named(parts)
    for name, values in mesh.cell_data.items():
        solid = solid.with_cell_data(name, np.concatenate([values] * layers))
    joints = {name: Interface(of.bodies, above(of.edges), above(of.partners)) for name, of in mesh.interfaces.items()}
    return solid._replace(interfaces=MappingProxyType(on_boundary(joints, solid._outlines)))


def _layer(mesh: PolygonMesh) -> tuple[Ints, Ints, Ints]:
    """Return the faces of the first layer: offsets, vertices and cells."""
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
    """Return the mesh if it is a `PolygonMesh`, or raise SceneError."""
    if not isinstance(mesh, PolygonMesh):
        raise SceneError(
            f"{subject}: exists in the plane only, and this mesh consists of polyhedra{instead and f'; {instead}'}."
        )
    return mesh
