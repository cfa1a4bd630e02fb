"""The mesh that users hold: a tessellation that refines, writes and draws itself, and is carried along z to prisms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Ints, plain
from vemcvx.canvas import draw_cells
from vemcvx.errors import MeshError
from vemcvx.meshes.box import LARGEST, SHORTEST, WHOLE, plotted_points, plotted_values
from vemcvx.meshes.cracks import cut
from vemcvx.meshes.exported import Exported
from vemcvx.meshes.interfaces import Interface, on_faces
from vemcvx.meshes.local_refinement import refinement
from vemcvx.meshes.polygons import cell_of_corner, next_vertex, offsets_of, positions, rows_in_order
from vemcvx.meshes.polyhedra import joined_faces
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh
from vemcvx.meshes.quality import Quality, quality_of
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

    NAMED_BY_PLACE = True

    def refine(self, cells: ArrayLike | None = None, *, balance: bool = True) -> Self:
        """Return this mesh with cells split (numbers, or a bool each; None: all): :func:`vemcvx.meshes.refinement`."""
        return refinement(self, cells, balance=balance).mesh

    def quality(self) -> Quality:
        """Shapes of the cells, (n_cells,): star-shapedness and shortest edges over diameters, of Assumption 3.3.

        Warns
        -----
        MeshWarning
            Cells are stretched, dented or have edges so short that the constants of the method grow; how much is
            measured in :mod:`vemcvx.meshes.quality`.
        """
        return quality_of(self)

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


def extruded(mesh: Tessellation, heights: ArrayLike) -> PolyhedralMesh:
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
    # In every layer, the faces of a cell are its bottom, its top and its sides in the order of its corners.
    first = joined.cell_offsets[:-1].reshape(layers, cells)
    corner_face = cell_of_corner(mesh.offsets) * 2 + 2 + np.arange(len(mesh.vertices))
    sides = joined.cell_faces[corner_face + (np.arange(layers) * len(owner))[:, None]]
    boundary = mesh.shared_edges.alone
    parts = {}
    for name, edges in named.items():
        corners = boundary[positions(edges, mesh.boundaries[WHOLE], nodes)]
        parts[RENAMED.get(name, name)] = sides[:, corners].ravel()
    parts |= {"bottom": joined.cell_faces[first[0]], "top": joined.cell_faces[first[-1] + 1]}
    solid = solid.with_boundaries(parts)
    for name, values in mesh.cell_data.items():
        solid = solid.with_cell_data(name, np.concatenate([values] * layers))
    level = nodes * np.arange(layers)[:, None, None]

    def above(ends: Ints) -> Ints:
        return (np.hstack([ends, ends[:, ::-1] + nodes]) + level).reshape(-1, 4)

    joints = {name: Interface(of.bodies, above(of.edges), above(of.partners)) for name, of in mesh.interfaces.items()}
    return solid._replace(interfaces=MappingProxyType(on_faces(joints, solid._outlines)))


def _names_in_space(mesh: Tessellation) -> dict[str, Ints]:
    named = {name: edges for name, edges in mesh.boundaries.items() if name not in (*mesh.interfaces, WHOLE)}
    for old, new in RENAMED.items():
        if old in named and new in named:
            raise MeshError(
                f'the part {old!r} of the boundary is called {new!r} in space, where "bottom" and "top" are those in '
                f"z, but this mesh has a part {new!r} as well. Give one of them another name."
            )
    return named


def _layer(mesh: Tessellation) -> tuple[Ints, Ints, Ints]:
    """Faces of one layer, cell by cell and outwards: offsets, vertices (of the level above from n_nodes on), owners."""
    below = mesh.vertices
    corner = np.arange(len(below))
    # Backwards: corner k of a row becomes the last but k.
    mirrored = np.repeat(mesh.offsets[:-1] + mesh.offsets[1:] - 1, np.diff(mesh.offsets)) - corner
    after = next_vertex(mesh.offsets, below)
    sides = np.column_stack([below, after, after + mesh.n_nodes, below + mesh.n_nodes])
    counts = np.diff(mesh.offsets)
    vertices = np.concatenate([below[mirrored], below + mesh.n_nodes, sides.ravel()])
    sizes = np.concatenate([counts, counts, np.full(len(below), 4)])
    cells = np.arange(mesh.n_cells)
    owner = np.concatenate([cells, cells, cell_of_corner(mesh.offsets)])
    order = np.argsort(owner, kind="stable")
    return *rows_in_order(offsets_of(sizes), vertices, order), owner[order]
