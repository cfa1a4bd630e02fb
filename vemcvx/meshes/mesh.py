"""The meshes that users hold, in the plane and in space: they refine, write and draw themselves.

They come from points and cells, from families (:mod:`vemcvx.meshes.families`), from files, from objects of other
libraries, and meshes in space from those of the plane, carried along z to prisms.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import Ints, brief, plain
from vemcvx.base.canvas import draw_cells, draw_faces
from vemcvx.base.errors import MeshError, MeshWarning, SceneError
from vemcvx.meshes.box import LARGEST, SHORTEST, WHOLE, plotted_points, plotted_values
from vemcvx.meshes.cracks import cut
from vemcvx.meshes.interfaces import Interface, faces_of, on_boundary
from vemcvx.meshes.io.files import load, load_bodies, write
from vemcvx.meshes.io.objects import from_object, to_object
from vemcvx.meshes.polygons import backwards, cell_of_corner, next_vertex, offsets_of, rows_in_order
from vemcvx.meshes.polyhedra import joined_faces
from vemcvx.meshes.polyhedral_refinement import refined_mesh
from vemcvx.meshes.quality import Quality, quality_of
from vemcvx.meshes.several_bodies import bodies as joined
from vemcvx.meshes.tessellation import Mesh, SpaceTessellation, Tessellation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class UserMesh(Mesh):
    """Methods that meshes of the plane and of space share."""

    NAMED_BY_PLACE = True

    def refine(self, cells: ArrayLike | None = None, *, balance: bool = True) -> Self:
        """Return this mesh with cells split (numbers, or a bool each; None: all): :func:`vemcvx.meshes.refinement`."""
        return refined_mesh(self, cells, balance)

    def cut(self, name: str, sides: Mapping[str, ArrayLike]) -> Self:
        """Return this mesh with a crack: the edges, in space faces, between two sets of its cells become an interface.

        Nodes along the crack become double, the new ones last; a tip inside the mesh, in space the front, keeps its
        nodes. Cells that are on neither side are left alone, so that sets near the crack say how long it is.

        Parameters
        ----------
        name : str
            Name of the crack, as an interface and as a boundary (the edges or faces of the first side).
        sides : mapping of str to array_like
            Names of the two sides -> their cells: numbers, or a bool each.

        Raises
        ------
        MeshError
            The sides have a cell in common or nothing between them, an edge would have a tip at both ends, in space a
            face all its nodes at the front, or the name is taken.
        """
        return cut(self, name, sides)

    def quality(self: Any) -> Quality:
        """Shapes of the cells, (n_cells,): star-shapedness and shortest edges over diameters, of Assumption 3.3.

        Warns
        -----
        MeshWarning
            Cells are stretched, dented or have edges so short that the constants of the method grow; how much is
            measured in :mod:`vemcvx.meshes.quality`. What short edges cost in space is not, and nothing is said of
            them.
        """
        return quality_of(self)

    def write(self: Any, path: str | Path) -> None:
        """Write the mesh, its named boundaries and cell data; `read` gives them back to the bit from .vtu.

        Parameters
        ----------
        path : str or Path
            The suffix chooses the format. Every mesh goes into .vtu files (polyhedra as VTK has them, their boundaries
            as polygons). Files of Gmsh (.msh), Abaqus (.inp) and Nastran (.bdf, .nas, .fem) take triangles and quads;
            in space tetrahedra, hexahedra, wedges and, but for Abaqus, pyramids. Gmsh's keep names of the boundary, and
            sets of cells (data of zeros and ones) that do not overlap.

        Raises
        ------
        MeshError
            The format would lose cells or interfaces, or the file cannot be written.

        Warns
        -----
        MeshWarning
            The format does not keep some names, data or digits.
        """
        write(path, self)

    def to(self: Any, library: Literal["meshio", "skfem", "pyvista"]) -> Any:
        """Return the mesh as an object of another library; :func:`vemcvx.meshes.convert` is the way back.

        Parameters
        ----------
        library : {"meshio", "skfem", "pyvista"}
            Its name. Points keep their order in all of them.

        Returns
        -------
        meshio.Mesh
            As `write` puts it into a .vtu file: polygons in blocks of one vertex count; in space tetrahedra,
            hexahedra, wedges and pyramids in blocks of one kind. Blocks of lines (triangles or quadrilaterals) follow,
            of which the cell datum "boundary:<name>" marks those of a named boundary. If this permutes cells, the datum
            "vemcvx:cell" has their numbers.
        skfem.MeshTri, MeshQuad, MeshTet or MeshHex
            With named boundaries; cell data of zeros and ones are subdomains.
        pyvista.UnstructuredGrid
            Cells in their order, with their data. A named boundary is the field datum "boundary:<name>": its edges
            (m, 2); in space the vertices of its faces, a row each, filled up with -1.

        Raises
        ------
        MeshError
            The library is none of these, or has no such cells (scikit-fem: cells of one kind alone).
        VemcvxError
            The library is not installed.

        Warns
        -----
        MeshWarning
            scikit-fem keeps no other cell data.
        """
        return to_object(self, library)


@dataclass(frozen=True, eq=False, repr=False, init=False)
class PolygonMesh(Tessellation, UserMesh):
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


@dataclass(frozen=True, eq=False, repr=False, init=False)
class PolyhedralMesh(SpaceTessellation, UserMesh):
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
    after = next_vertex(mesh.offsets, below)
    sides = np.column_stack([below, after, after + mesh.n_nodes, below + mesh.n_nodes])
    counts = np.diff(mesh.offsets)
    vertices = np.concatenate([below[backwards(mesh.offsets)], below + mesh.n_nodes, sides.ravel()])
    sizes = np.concatenate([counts, counts, np.full(len(below), 4)])
    cells = np.arange(mesh.n_cells)
    owner = np.concatenate([cells, cells, cell_of_corner(mesh.offsets)])
    order = np.argsort(owner, kind="stable")
    return *rows_in_order(offsets_of(sizes), vertices, order), owner[order]


AnyMesh = PolygonMesh | PolyhedralMesh


def plane_mesh(mesh: AnyMesh, subject: str, instead: str = "") -> PolygonMesh:
    """The mesh, if it is of polygons.

    SceneError where it is of polyhedra; `subject` exists in the plane only, and `instead` says what to do.
    """
    if isinstance(mesh, PolyhedralMesh):
        raise SceneError(
            f"{subject}: exists in the plane only, and this mesh is of polyhedra{instead and f'; {instead}'}."
        )
    return mesh


# To checkers of types, what is read may be anything beside a PolygonMesh: scripts that know their files need no cast.
def read(path: str | Path, bodies: str | None = None, *, tolerance: float | None = None) -> PolygonMesh | Any:
    """Read a mesh from a file of VTK (.vtu), Gmsh (.msh), Abaqus (.inp) or Nastran (.bdf, .nas, .fem).

    Where there are tetrahedra, hexahedra, wedges, pyramids or polyhedra, it is a mesh in space of these. Hexahedra,
    wedges and pyramids must have plane faces: mesh bodies where they would be warped with tetrahedra, or hand in cells
    of your own whose warped faces are two triangles each, the same in both cells. Cells of higher order (triangle6,
    quad8, quad9, tetra10, hexahedron20, hexahedron27 ...) are read by their corners, with straight edges.

    Named boundaries are those that `write` of a mesh wrote, the physical groups of lines (in space, of surfaces) of a
    Gmsh file, or the node sets and surfaces of an Abaqus file. Cell data come along; a physical group or element set is
    a cell datum of its name, 1 in the group and 0 outside. A group without a name is called by its number. Node and
    cell order are the file's; of plane meshes, a constant third coordinate is dropped.

    If the file names no part of the boundary, what lies where x, y or z is least or greatest is called as families of
    meshes call it ("left", "right", "bottom" and "top" in the plane): a `MeshWarning` says which there are.

    Parameters
    ----------
    path : str or Path
        The file; its suffix tells the format. `meshio convert a.xyz a.vtu` converts files of other formats.
    bodies : "physical", optional
        Make a body of every physical group of cells of a Gmsh file, of every instance or part of an Abaqus file (if it
        has none, of every element set), as :func:`vemcvx.meshes.bodies` joins them: where bodies meet, in nodes that
        they share or that are double, there is an interface. Boundaries are called "plate.rim", and an interface
        "plate|pin", or by the one name that all of it has in the file, on both of its sides or on one.
    tolerance : float, optional
        With `bodies`: how far apart boundaries may be that coincide, as of :func:`vemcvx.meshes.bodies`.

    Returns
    -------
    PolygonMesh or PolyhedralMesh
        The mesh, checked.

    Raises
    ------
    MeshError
        There is no such file, it is damaged or foreign, it has what would be read wrongly, or it holds no valid mesh.

    Warns
    -----
    MeshWarning
        Cells were turned, unused nodes dropped, cells of higher order read by their corners, named lines or faces
        inside the mesh or on interfaces left out, sides named; or what is in the file was not read.
    """
    if bodies is None and tolerance is None:
        return _with_methods(load(path))
    if not isinstance(bodies, str) or bodies != "physical":
        raise MeshError(
            f"read: found bodies = {brief(bodies)}; there is 'physical', with which tolerance= goes, or None for one "
            "mesh."
        )
    found, sides = load_bodies(path)
    meshes: dict[str, Any] = {name: _with_methods(mesh) for name, mesh in found.items()}
    mesh = joined(meshes, tolerance=tolerance)
    called = {name: _names_of(interface, meshes, sides) for name, interface in mesh.interfaces.items()}
    times = Counter(side for names in called.values() for side in names)
    kept = {}
    for name, interface in mesh.interfaces.items():
        kept[called[name][0] if [times[side] for side in called[name]] == [1] else name] = interface
    named = {(body, side) for body, own in meshes.items() for side in own.boundaries}
    hidden = {side for body, side in named if f"{body}.{side}" not in mesh.boundaries}
    if left := ", ".join(map(repr, sorted((hidden & sides) - set(kept)))):
        warnings.warn(
            f"{path}: the sides named {left} are on interfaces, which are called {', '.join(map(repr, kept))}: a name "
            "is kept if it is the only one that is of all of one interface, and of no other.",
            MeshWarning,
            stacklevel=2,
        )
    return mesh._replace(interfaces=MappingProxyType(kept))


def _names_of(interface: Interface, meshes: Mapping[str, Any], sides: set[str]) -> list[str]:
    """Return the names of sides that are all of an interface, on each of its bodies that has them there."""
    start, covers = 0, dict[str, list[bool]]()
    for body, own in meshes.items():
        if body in interface.bodies:
            # Nodes of bodies stand one after the other, and behind them those that interfaces have added.
            nodes = (interface.edges, interface.partners)[interface.bodies.index(body)] - start
            offsets, vertices = own._outlines
            there = set(np.flatnonzero(np.logical_and.reduceat(np.isin(vertices, nodes), offsets[:-1])).tolist())
            for side in sorted(sides.intersection(own.boundaries)):
                places = set(own._places(own.boundaries[side]).tolist())
                if places & there:
                    covers.setdefault(side, []).append(places == there)
        start += own.n_nodes
    return [side for side, each in covers.items() if all(each)]


def convert(other: Any) -> PolygonMesh | Any:
    """Return the mesh that an object of another library holds; `to` of a mesh is the way back.

    Order, names and data are kept, sides without names are named, and the mesh is checked, all as in :func:`read`.

    Parameters
    ----------
    other : meshio.Mesh, skfem.MeshTri, MeshQuad, MeshTet or MeshHex, pyvista.UnstructuredGrid or PolyData
        Boundaries are named by cell sets of lines (in space, of polygons) or physical groups (meshio), named boundaries
        (scikit-fem), and by what `to` of a mesh makes of them. Subdomains and cell sets are cell data, 1 inside and 0
        outside.

    Returns
    -------
    PolygonMesh or PolyhedralMesh
        The mesh, checked; what is raised and warned of is as of :func:`read`.
    """
    return _with_methods(from_object(other))


def _with_methods(found: Tessellation | SpaceTessellation) -> PolygonMesh | PolyhedralMesh:
    kind: type[PolygonMesh | PolyhedralMesh] = PolygonMesh if isinstance(found, Tessellation) else PolyhedralMesh
    mesh = object.__new__(kind)
    mesh.__dict__.update(found.__dict__)
    return mesh
