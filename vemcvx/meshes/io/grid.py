"""A mesh as files and other libraries hold it: a grid, the list of its cells with data; and back.

The cells of a grid stand one after the other, each of a kind and with its nodes, as in VTK's unstructured grids. What
bounds cells of the mesh (lines; in space, polygons) is among them: a named part of the boundary is a set of such
cells. In files that keep data it is marked by a datum "boundary:<name>", 1 on its cells and 0 elsewhere, and its cells
have the data of those that they bound, so that colouring by a datum looks the same with and without them. Among data of
the whole file (field data), a part may instead be the datum "boundary:<name>", a row of nodes for each edge or face.

An interface of two bodies is two such parts: its own, edges or faces of the first body, and
"partners:<first>:<second>:<name>", for each of them the nodes of the second body in the same places.
"""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any
from urllib.parse import quote, unquote

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.base.arrays import SAME, Bools, Floats, Ints
from vemcvx.base.errors import MeshError, MeshWarning, quietly
from vemcvx.meshes.box import WHOLE
from vemcvx.meshes.interfaces import Interface, padded
from vemcvx.meshes.polygons import directed_edges, matching_rows, offsets_of, rows_in_order, turned
from vemcvx.meshes.polyhedra import FACES, Listed, face_shapes, listed_faces, volumes_and_centroids
from vemcvx.meshes.tessellation import SpaceTessellation, Tessellation, straight_sides

AnyTessellation = Tessellation | SpaceTessellation
Rows = tuple[Ints, Ints]  # Offsets and nodes of rows of different lengths.

CELL, MARK, PARTNERS, PHYSICAL = "vemcvx:cell", "boundary:", "partners:", "gmsh:physical"
NODES = {"line": 2, "triangle": 3, "quad": 4, "tetra": 4, "hexahedron": 8, "wedge": 6, "pyramid": 5}
POLYGONS = ("triangle", "quad", "polygon")
SOLIDS = ("tetra", "hexahedron", "wedge", "pyramid", "polyhedron")
PASSED_OVER = ("vertex", "empty")
CORNERS = {
    "line": ("line3",),
    "triangle": ("triangle6", "triangle7"),
    "quad": ("quad8", "quad9"),
    "tetra": ("tetra10",),
    "hexahedron": ("hexahedron20", "hexahedron24", "hexahedron27"),
    "wedge": ("wedge15", "wedge18"),
    "pyramid": ("pyramid13", "pyramid14"),
}
"""Kinds of first order -> those of second order; the corners come first in all of them, before nodes between these."""
SHAPES = {(4, 4, 4): ("tetra", 3), (8, 6, 0): ("hexahedron", 4), (6, 5, 2): ("wedge", 3), (5, 5, 4): ("pyramid", 4)}
"""Numbers of nodes, faces and triangles -> the kind of a solid, and the number of nodes of its bottom."""


@dataclass
class Grid:
    """Cells and data: the nodes of cell i are ``vertices[offsets[i]:offsets[i + 1]]``."""

    points: Floats  # (n, 2) or (n, 3)
    kinds: NDArray[np.str_]  # (k,) kinds of the cells, in meshio's words: "triangle", "quad", "polygon", "line" ...
    offsets: Ints  # (k + 1,)
    vertices: Ints  # (m,)
    data: dict[str, NDArray[Any]] = field(default_factory=dict)  # arrays (k, ...)
    sides: dict[str, Bools] = field(default_factory=dict)  # (k,) named sets of cells that bound others
    parts: dict[str, Rows] = field(default_factory=dict)  # named parts of the boundary that are no cells
    faces: Listed | None = None  # faces of the polyhedra, in their order
    notes: tuple[str, ...] = ()  # what was left out of it, in sentences

    @property
    def bounding(self) -> tuple[Bools, Bools]:
        """(k,) and (k,): the cells of the mesh, solids if there are some and else polygons; and what may bound them."""
        solids, polygons = np.isin(self.kinds, SOLIDS), np.isin(self.kinds, POLYGONS)
        return (solids, polygons) if self.solid else (polygons, self.kinds == "line")

    @property
    def solid(self) -> bool:
        """True if there are solids."""
        return bool(np.isin(self.kinds, SOLIDS).any())

    @property
    def marked(self) -> dict[str, NDArray[Any]]:
        """The data, and a datum for every named set of cells."""
        return self.data | {MARK + name: chosen.astype(np.uint8) for name, chosen in self.sides.items()}


def finished(subject: str, made: Callable[[], tuple[AnyTessellation, list[str]]]) -> AnyTessellation:
    """The mesh of a file or an object, its sides named if nothing is, and notes on it as warnings."""
    with quietly() as caught:
        mesh, notes = made()
    sides = straight_sides(mesh)
    if sides and set(mesh.boundaries) == {WHOLE}:
        mesh = mesh.with_boundaries(sides)
        notes = [*notes, f"no part of the boundary has a name; by their place, sides are called {', '.join(sides)}."]
    for note in [*(str(warning.message) for warning in caught if warning.category is MeshWarning), *notes]:
        warnings.warn(f"{subject}: {note}", MeshWarning, stacklevel=4)
    return mesh


@contextlib.contextmanager
def translated(subject: str, failure: str) -> Iterator[None]:
    """Turn whatever other libraries do on failure, sys.exit included, into a MeshError, and keep the terminal clean."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), quietly():
            yield
    except MeshError as error:
        raise MeshError(f"{subject} {failure}: {error}") from None
    except (SystemExit, Exception) as error:
        cause = said.getvalue() if isinstance(error, SystemExit) else f"{type(error).__name__}: {error}"
        raise MeshError(f"{subject} {failure} ({' '.join(cause.split())[:200]}).") from error


@contextlib.contextmanager
def named(subject: str) -> Iterator[None]:
    """Put the subject before the message of a MeshError."""
    try:
        yield
    except MeshError as error:
        raise MeshError(f"{subject}: {error}") from None


def grid_of(
    mesh: AnyTessellation, data: Mapping[str, ArrayLike], *, polyhedra: bool = False, sides: bool = True
) -> Grid:
    """Return the cells of a mesh with data, and the named parts of its boundary if `sides`.

    In space cells are given by their vertices as other programs do, which MeshError refuses for any but tetrahedra,
    hexahedra, wedges and pyramids; or all as `polyhedra`.
    """
    faces = None
    if isinstance(mesh, Tessellation):
        kinds, offsets, vertices = polygon_kinds(mesh.offsets), mesh.offsets, mesh.vertices
    elif polyhedra:
        kinds, faces = np.full(mesh.n_cells, "polyhedron"), listed_faces(mesh.faces)
        offsets, vertices = mesh.cell_nodes
    else:
        kinds, offsets, vertices = by_vertices(mesh)
    parts = named_parts(mesh) if sides else {}
    rows = {name: rows_of(mesh, part) for name, part in parts.items()}
    cells = np.concatenate(
        [np.arange(mesh.n_cells), *(mesh._owners[matching_rows(*mesh._outlines, *row)] for row in rows.values())]
    )
    part = np.repeat(np.arange(len(parts) + 1), [mesh.n_cells, *map(len, parts.values())])
    values = {name: np.asarray(given) for name, given in data.items()}
    return Grid(
        mesh.points,
        np.concatenate([kinds, *(polygon_kinds(row[0]) for row in rows.values())]),
        offsets_of(np.concatenate([np.diff(offsets), *(np.diff(row[0]) for row in rows.values())])),
        np.concatenate([vertices, *(row[1] for row in rows.values())]),
        data={name: (x.astype(np.uint8) if x.dtype == bool else x)[cells] for name, x in values.items()},
        sides={name: part == number for number, name in enumerate(parts, start=1)},
        faces=faces,
    )


def polygon_kinds(offsets: Ints) -> NDArray[np.str_]:
    """The kinds of lines and polygons with so many nodes."""
    counts = np.diff(offsets)
    return np.select([counts == 2, counts == 3, counts == 4], ["line", "triangle", "quad"], "polygon")


def named_parts(mesh: AnyTessellation) -> dict[str, Ints]:
    """Edges or numbers of faces of all that a file names: boundaries but the whole; and rows of nodes, of partners."""
    parts = {name: part for name, part in mesh.boundaries.items() if name != WHOLE}
    for name, found in mesh.interfaces.items():
        first, second = (quote(body, safe="") for body in found.bodies)
        parts[f"{PARTNERS}{first}:{second}:{name}"] = found.partners
    return parts


def rows_of(mesh: AnyTessellation, part: Ints) -> Rows:
    """The nodes of each edge or face of a part that is named."""
    if isinstance(mesh, SpaceTessellation) and part.ndim == 1:
        return rows_in_order(mesh.face_offsets, mesh.face_vertices, part)
    there = part >= 0
    return offsets_of(there.sum(axis=1)), part[there]


def by_vertices(mesh: SpaceTessellation) -> tuple[NDArray[np.str_], Ints, Ints]:
    """Kinds of solids, and offsets and vertices in VTK's order: around the bottom, then above; or MeshError."""
    listed = listed_faces(mesh.faces)
    sizes, ends = np.diff(listed.offsets), directed_edges(listed.offsets, listed.vertices)
    triangles = np.add.reduceat(sizes == 3, listed.cell_offsets[:-1], dtype=np.int64)
    shape = np.column_stack([np.diff(mesh.cell_nodes[0]), np.diff(mesh.cell_offsets), triangles])
    kinds, rows = np.full(mesh.n_cells, "polyhedron"), np.zeros((mesh.n_cells, 8), dtype=np.int64)
    for wanted, (kind, n) in SHAPES.items():
        cells = np.flatnonzero((shape == wanted).all(axis=1))
        if not len(cells):
            continue
        faces = listed.cell_offsets[cells, None] + np.arange(wanted[1])
        bottom = faces[np.arange(len(cells)), np.argmax(sizes[faces] == n, axis=1)]
        around = listed.vertices[listed.offsets[bottom, None] + np.arange(n)[::-1]]
        first = listed.offsets[listed.cell_offsets[cells]]
        edges = ends[first[:, None] + np.arange(listed.offsets[listed.cell_offsets[cells[0] + 1]] - first[0])]
        # Away from the bottom, one edge leads up from each of its nodes.
        stays = (edges[:, :, 1, None] == around[:, None]).any(axis=2)
        up = (edges[:, None, :, 0] == around[:, :, None]) & ~stays[:, None]
        above = np.take_along_axis(edges[:, :, 1], np.argmax(up, axis=2), axis=1)
        sound = (up.sum(axis=2) == 1).all(axis=1)
        kinds[cells[sound]] = kind
        rows[cells, :n], rows[cells, n : wanted[0]] = around, above[:, : wanted[0] - n]
    strange = np.flatnonzero(kinds == "polyhedron")
    if len(strange):
        raise MeshError(
            f"tetrahedra, hexahedra, wedges and pyramids alone are given by their vertices, and cell {strange[0]} is "
            f"none of them. Polyhedra go into .vtu files and to PyVista."
        )
    offsets = offsets_of(shape[:, 0])
    return kinds, offsets, rows[np.arange(8) < shape[:, :1]]


def take_parts(grid: Grid, fields: Mapping[str, Any]) -> Grid:
    """The same grid with the parts of the boundary among data of the whole file: edges, or in space rows of nodes."""
    for name, values in ((name, np.asarray(x)) for name, x in fields.items() if name.startswith(MARK)):
        if values.dtype.kind not in "iu" or (values.ndim != 2 if grid.solid else values.size % 2):
            wanted = "faces, rows of node numbers" if grid.solid else "edges, pairs of node numbers"
            raise MeshError(f"its datum {name!r} is no list of {wanted}.")
        rows = values.astype(np.int64) if grid.solid else values.astype(np.int64).reshape(-1, 2)
        grid.parts[name.removeprefix(MARK)] = offsets_of((rows >= 0).sum(axis=1)), rows[rows >= 0]
    return grid


def by_corners(grid: Grid) -> Grid:
    """The grid with cells of second order as those of first order that have their corners, and straight edges.

    Nodes that no cell has at a corner any more are dropped, with a note.
    """
    first = {kind: corner for corner, kinds in CORNERS.items() for kind in kinds}
    curved = np.isin(grid.kinds, list(first))
    if not curved.any():
        return grid
    names = np.unique(grid.kinds[curved]).tolist()
    kinds, counts = grid.kinds.astype("<U16"), np.diff(grid.offsets)
    for name in names:
        few = counts[grid.kinds == name] != int(name.lstrip("abcdefghijklmnopqrstuvwxyz"))
        if few.any():
            raise MeshError(f"its cells of the kind {name!r} do not all have so many nodes.")
        kinds[grid.kinds == name] = first[name]
        counts[grid.kinds == name] = NODES[first[name]]
    starts = np.repeat(grid.offsets[:-1] - offsets_of(counts)[:-1], counts)
    vertices = grid.vertices[np.arange(counts.sum()) + starts]
    n = len(grid.points)
    known = (grid.vertices >= 0) & (grid.vertices < n)
    corner = np.zeros(n, dtype=bool)
    corner[vertices[(vertices >= 0) & (vertices < n)]] = True
    if grid.faces is not None:
        corner[grid.faces.vertices] = True
    between = np.zeros(n, dtype=bool)
    between[grid.vertices[np.repeat(curved, np.diff(grid.offsets)) & known]] = True
    dropped = between & ~corner
    # A number that is none stays so: the checks of the mesh name it.
    number = np.append(np.where(dropped, -1, np.cumsum(~dropped) - 1), -1)

    def new(nodes: Ints) -> Ints:
        inside = (nodes >= 0) & (nodes < n)
        return np.where(inside, number[np.where(inside, nodes, n)], nodes)

    faces = None if grid.faces is None else grid.faces._replace(vertices=new(grid.faces.vertices))
    note = (
        f"{dropped.sum()} nodes between the corners of second-order cells ({', '.join(names)}) are dropped: cells are "
        "read by their corners, with straight edges."
    )
    return replace(
        grid,
        points=np.asarray(grid.points)[~dropped],
        kinds=kinds,
        offsets=offsets_of(counts),
        vertices=new(vertices),
        parts={name: (offsets, new(nodes)) for name, (offsets, nodes) in grid.parts.items()},
        faces=faces,
        notes=(*grid.notes, note),
    )


def mesh_of(grid: Grid) -> tuple[AnyTessellation, list[str]]:
    """The mesh of the solids that there are, or else of the polygons, and notes on what was left out; or MeshError."""
    grid = by_corners(grid)
    _check(grid)
    inner, outer = grid.bounding
    cells = np.flatnonzero(inner)
    if CELL in grid.data:
        cells = cells[np.argsort(grid.data[CELL][cells], kind="stable")]
    kept = {name: x[cells] for name, x in grid.data.items() if name != CELL and not name.startswith(MARK)}
    data = {name: x.astype(x.dtype.newbyteorder("=")) for name, x in kept.items() if x.dtype.kind in "biuf"}
    marks = {name.removeprefix(MARK): x != 0 for name, x in grid.data.items() if name.startswith(MARK)} | grid.sides
    marked = {name: np.flatnonzero(mark & outer) for name, mark in marks.items()}
    parts = {name: rows_in_order(grid.offsets, grid.vertices, rows) for name, rows in marked.items()} | grid.parts
    interfaces = _interfaces(parts)
    if grid.solid:
        solids = _solids(grid, cells)
        space = SpaceTessellation(grid.points, solids, cell_data=data, interfaces=interfaces)
        mesh, left_out = _with_parts(space, parts)
    else:
        offsets, vertices = rows_in_order(grid.offsets, grid.vertices, cells)
        counts = np.unique(np.diff(offsets))
        polygons = vertices.reshape(-1, counts[0]) if len(counts) == 1 else np.split(vertices, offsets[1:-1])
        plane = Tessellation(_plane(grid.points), polygons, cell_data=data, interfaces=interfaces)
        mesh, left_out = _with_parts(plane, parts)
    return mesh, [*grid.notes, *left_out]


def _check(grid: Grid) -> None:
    kinds: set[str] = set(grid.kinds.tolist())
    inner, _ = grid.bounding
    strange = sorted(kinds - {*POLYGONS, *SOLIDS, *PASSED_OVER, "line"})
    if strange:
        wanted = (
            f"{', '.join(SOLIDS)} with straight edges and plane faces. Export elements of first or second order."
            if grid.solid
            else "plane polygons with straight edges (triangles, quads, polygons) and lines. Export the plane surface "
            "alone, with elements of first or second order."
        )
        raise MeshError(f"it holds cells of the kind {strange[0]!r}; wanted are {wanted}")
    if not inner.any():
        raise MeshError(f"it holds no polygons, only {', '.join(sorted(kinds)) or 'nothing'}.")
    for kind, count in NODES.items():
        if (np.diff(grid.offsets)[grid.kinds == kind] != count).any():
            raise MeshError(f"its cells of the kind {kind!r} do not all have {count} nodes.")
    for name, values in grid.data.items():
        single = name in (CELL, PHYSICAL) or name.startswith(MARK)
        if len(values) != len(grid.kinds) or (single and values.ndim > 1):
            raise MeshError(f"its cell datum {name!r} has the shape {values.shape} on {len(grid.kinds)} cells.")


def _plane(points: Floats) -> Floats:
    """The points without a third coordinate that is the same everywhere."""
    points = np.asarray(points, dtype=float)
    if points.ndim == 2 and points.shape[1] == 3 and len(points):
        # A plane that was turned into place by the program that wrote the file is plane to its digits. Points that
        # are no numbers are left to the checks of the mesh, which name them.
        if np.ptp(points[:, 2]) > SAME * np.nanmax(np.abs(points - points[0]), initial=0.0):
            raise MeshError(
                f"its points do not lie in a plane z = constant: z runs from {points[:, 2].min():.6g} to "
                f"{points[:, 2].max():.6g}. Turn the mesh into the x-y plane first."
            )
        return points[:, :2]
    return points


def _interfaces(parts: dict[str, Rows]) -> dict[str, Interface]:
    """Interfaces among the named parts of a file, which then are no boundaries any more."""
    found = {}
    for key in [name for name in parts if name.startswith(PARTNERS) and name.count(":") > 2]:
        first, second, name = key.removeprefix(PARTNERS).split(":", 2)
        if name not in parts:
            raise MeshError(f"it holds partners of an interface {name!r}, but no such boundary.")
        edges, partners = (padded(*parts.pop(one)) for one in (name, key))
        found[name] = Interface((unquote(first), unquote(second)), edges, partners)
    return found


def _solids(grid: Grid, cells: Ints) -> Listed:
    """The faces of the solids with the given numbers, in this order."""
    lists, numbers = [], []
    for kind in np.unique(grid.kinds[cells]).tolist():
        members = np.flatnonzero(grid.kinds == kind)
        numbers.append(members)
        if kind == "polyhedron":
            if grid.faces is None:
                raise MeshError("it has no lists of faces for its polyhedra.")
            lists.append(grid.faces)
            continue
        corners = grid.vertices[grid.offsets[members, None] + np.arange(NODES[kind])]
        sizes = np.tile([len(face) for face in FACES[kind]], len(corners))
        offsets, each = offsets_of(sizes), np.arange(len(corners) + 1) * len(FACES[kind])
        lists.append(_outwards(Listed(offsets, corners[:, np.concatenate(FACES[kind])].ravel(), each), grid.points))
    joined = Listed(
        offsets_of(np.concatenate([np.diff(one.offsets) for one in lists])),
        np.concatenate([one.vertices for one in lists]),
        offsets_of(np.concatenate([np.diff(one.cell_offsets) for one in lists])),
    )
    place = np.zeros(len(grid.kinds), dtype=np.int64)
    place[np.concatenate(numbers)] = np.arange(len(cells))
    return joined.in_order(place[cells])


def _outwards(listed: Listed, points: ArrayLike) -> Listed:
    """The same with all faces of a cell turned where it is inside out: programs number both ways around."""
    points = np.asarray(points, dtype=float)
    inside = (listed.vertices >= 0) & (listed.vertices < len(points))
    if not inside.all() or points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        return listed  # the checks of the mesh say what is wrong
    shapes = face_shapes(points, listed.offsets, listed.vertices)
    faces = np.arange(len(listed.offsets) - 1)
    volumes = volumes_and_centroids(shapes, listed.cell_offsets, faces, np.ones(len(faces)))[0]
    backwards = np.repeat(volumes < 0.0, np.diff(listed.cell_offsets))
    return listed._replace(vertices=turned(listed.offsets, listed.vertices, backwards))


def _with_parts(mesh: AnyTessellation, parts: Mapping[str, Rows]) -> tuple[AnyTessellation, list[str]]:
    """The mesh with named parts of its boundary; what is not on it is left out, with a note."""
    notes, boundaries = [], {}
    whole, dimension = mesh.boundaries[WHOLE], mesh.points.shape[1]
    number = np.arange(mesh.n_nodes) if mesh.node_map is None else mesh.node_map
    for name, rows in parts.items():
        found = mesh._found(*rows_in_order(*rows, np.flatnonzero(np.diff(rows[0]) >= dimension)), number)
        chosen, strange = np.unique(found[found >= 0]), np.count_nonzero(found < 0)
        if strange:
            kind = "lines" if dimension == 2 else "polygons"
            notes.append(f"{strange} of {len(found)} {kind} named {name!r} are not on the boundary and are left out.")
        if len(chosen) and not (name == WHOLE and len(chosen) == len(whole)):
            boundaries[name] = whole[chosen]
    return mesh.with_boundaries(boundaries), notes
