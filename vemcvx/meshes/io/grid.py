"""Grids: lists of cells with data and named sets, as in files and other libraries.

Boundary edges or faces are cells of a grid, too. A named set of boundary cells becomes a boundary of
the mesh. Files store the boundary as a cell datum "boundary:<name>". A named set of other cells becomes a cell datum.
Both kinds of data are 1 in the set and 0 outside.

An interface of two bodies is stored as two boundaries. The boundary "<name>" has edges or faces of the first body. The
boundary "partners:<first>:<second>:<name>" has the coinciding nodes of the second body.
"""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any
from urllib.parse import quote, unquote

import numpy as np
from numpy.typing import NDArray

from vemcvx.base.arrays import SAME, Bools, Floats, Ints
from vemcvx.base.errors import MeshError, MeshWarning, quietly
from vemcvx.meshes.box import WHOLE
from vemcvx.meshes.interfaces import Interface, pad_rows
from vemcvx.meshes.mesh import straight_sides
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons import matching_rows, offsets_of, reverse_rows, rows_in_order
from vemcvx.meshes.polyhedra import FACES, FaceLists, list_faces
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh

AnyTessellation = PolygonMesh | PolyhedralMesh
Rows = tuple[Ints, Ints]  # offsets and nodes of rows of different lengths

CELL, MARK, PARTNERS, PHYSICAL = "vemcvx:cell", "boundary:", "partners:", "gmsh:physical"
DIGITS = "0123456789"  # kinds of cells of higher order end with digits, such as "triangle6"
NODES = {"line": 2, "triangle": 3, "quad": 4, "tetra": 4, "hexahedron": 8, "wedge": 6, "pyramid": 5}
POLYGONS = ("triangle", "quad", "polygon")
SOLIDS = ("tetra", "hexahedron", "wedge", "pyramid", "polyhedron")
EDGES = {"tetra": (1, 2, 3), "wedge": (1, 2, 3), "pyramid": (1, 3, 4), "hexahedron": (1, 3, 4)}
"""Neighbours of vertex 0 along edges, in right-handed order."""
SHAPES = {(4, 4, 4): ("tetra", 3), (8, 6, 0): ("hexahedron", 4), (6, 5, 2): ("wedge", 3), (5, 5, 4): ("pyramid", 4)}
"""Numbers of nodes, faces and triangles -> kind of solid, and number of nodes at the bottom."""


@dataclass
class Grid:
    """Cells and data. Cell i has the nodes ``vertices[offsets[i]:offsets[i + 1]]``."""

    points: Floats  # (n, 2) or (n, 3)
    kinds: NDArray[np.str_]  # (k,) kinds of the cells as in meshio: "triangle", "quad", "polygon", "line" ...
    offsets: Ints  # (k + 1,)
    vertices: Ints  # (m,)
    data: dict[str, NDArray[Any]] = field(default_factory=dict)  # arrays (k, ...)
    sets: dict[str, Bools] = field(default_factory=dict)  # masks (k,) of named sets of cells
    parts: dict[str, Rows] = field(default_factory=dict)  # parts of the boundary that are not cells of the grid
    nodes: dict[str, Bools] = field(default_factory=dict)  # masks (n,) of named sets of nodes
    bodies: tuple[str, ...] = ()  # names of sets that are bodies
    faces: FaceLists | None = None  # faces of polyhedra, cell by cell
    notes: tuple[str, ...] = ()  # sentences about unread parts of the file

    @property
    def bounding(self) -> tuple[Bools, Bools]:
        """Masks (k,) of mesh cells and of possible boundary cells."""
        solids, polygons = np.isin(self.kinds, SOLIDS), np.isin(self.kinds, POLYGONS)
        return (solids, polygons) if self.solid else (polygons, self.kinds == "line")

    @property
    def solid(self) -> bool:
        """True if the grid has solids."""
        return bool(np.isin(self.kinds, SOLIDS).any())

    def select(self, cells: Ints) -> Grid:
        """Return the grid of the given cells, in this order."""
        offsets, vertices = rows_in_order(self.offsets, self.vertices, cells)
        data, sets = ({name: x[cells] for name, x in of.items()} for of in (self.data, self.sets))
        return replace(self, kinds=self.kinds[cells], offsets=offsets, vertices=vertices, data=data, sets=sets)


@contextlib.contextmanager
def translate_errors(subject: str, failure: str) -> Iterator[None]:
    """Raise MeshError for any error in the block, and hide printed output."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), quietly():
            yield
    except MeshError as error:
        raise MeshError(f"{subject}: {error}") from None
    except (SystemExit, Exception) as error:
        cause = said.getvalue() if isinstance(error, SystemExit) else f"{type(error).__name__}: {error}"
        raise MeshError(f"{subject} {failure} ({' '.join(cause.split())[:200]}).") from error


def finish_mesh(subject: str, grid: Grid, *, by_place: bool = True) -> AnyTessellation:
    """Return the mesh of a grid. If no side has a name, straight sides get names."""
    with translate_errors(subject, "holds no valid mesh"), quietly() as caught:
        mesh, notes = mesh_of(grid)
    sides = straight_sides(mesh) if by_place and set(mesh.boundaries) == {WHOLE} else {}
    if sides:
        mesh = mesh._with_named(sides)
        notes = [*notes, f"no part of the boundary has a name; by position, sides are named {', '.join(sides)}."]
    for note in [*(str(warning.message) for warning in caught if warning.category is MeshWarning), *notes]:
        warnings.warn(f"{subject}: {note}", MeshWarning, stacklevel=4)
    return mesh


def grid_of(mesh: AnyTessellation, *, polyhedra: bool = False, sides: bool = True, data: bool = True) -> Grid:
    """Return the grid of a mesh. If `polyhedra` is true, all solids become polyhedra."""
    faces = None
    if isinstance(mesh, PolygonMesh):
        kinds, offsets, vertices = polygon_kinds(mesh.offsets), mesh.offsets, mesh.vertices
    elif polyhedra:
        kinds, faces = np.full(mesh.n_cells, "polyhedron"), list_faces(mesh.faces)
        offsets, vertices = mesh.cell_nodes
    else:
        kinds, offsets, vertices = _list_by_vertices(mesh)
    rows = list_named_parts(mesh) if sides else {}
    cells = [np.arange(mesh.n_cells), *(mesh._owners[matching_rows(*mesh._outlines, *row)] for row in rows.values())]
    part = np.repeat(np.arange(len(cells)), list(map(len, cells)))
    values = {name: np.asarray(given) for name, given in mesh.cell_data.items()} if data else {}
    return Grid(
        mesh.points,
        np.concatenate([kinds, *(polygon_kinds(row[0]) for row in rows.values())]),
        offsets_of(np.concatenate([np.diff(offsets), *(np.diff(row[0]) for row in rows.values())])),
        np.concatenate([vertices, *(row[1] for row in rows.values())]),
        data={n: (x.astype(np.uint8) if x.dtype == bool else x)[np.concatenate(cells)] for n, x in values.items()},
        sets={name: part == number for number, name in enumerate(rows, start=1)},
        faces=faces,
    )


def polygon_kinds(offsets: Ints) -> NDArray[np.str_]:
    """Return the kind of each line or polygon."""
    counts = np.diff(offsets)
    return np.select([counts == 2, counts == 3, counts == 4], ["line", "triangle", "quad"], "polygon")


def list_named_parts(mesh: AnyTessellation) -> dict[str, Rows]:
    """Return the sides of named boundaries, and the partners at interfaces."""
    named = {name: mesh._places(part) for name, part in mesh.boundaries.items() if name != WHOLE}
    rows = {name: rows_in_order(*mesh._outlines, places) for name, places in named.items()}
    for name, found in mesh.interfaces.items():
        (first, second), nodes = (quote(body, safe="") for body in found.bodies), found.partners
        rows[f"{PARTNERS}{first}:{second}:{name}"] = offsets_of((nodes >= 0).sum(axis=1)), nodes[nodes >= 0]
    return rows


def _list_by_vertices(mesh: PolyhedralMesh) -> tuple[NDArray[np.str_], Ints, Ints]:
    """Return the kind, the offsets and the vertices of each cell."""
    kinds, rows = list[str](), list[list[int]]()
    for number, cell in enumerate(mesh.cells):
        faces = [face.tolist() for face in cell]
        shape = len(set().union(*faces)), len(faces), sum(len(face) == 3 for face in faces)
        kind, n = SHAPES.get(shape, ("", 0))
        bottom = next((face[::-1] for face in faces if len(face) == n), list[int]())
        # Each bottom node has a single edge to the top.
        edges = [edge for face in faces for edge in zip(face, face[1:] + face[:1], strict=True)]
        up = [[b for a, b in edges if a == node and b not in bottom] for node in bottom]
        if not kind or any(len(ends) != 1 for ends in up):
            raise MeshError(
                f"cell {number} is no tetrahedron, hexahedron, wedge or pyramid. Meshes of other polyhedra can be "
                "written to .vtu files, or converted to PyVista."
            )
        kinds.append(kind)
        rows.append([*bottom, *dict.fromkeys(ends[0] for ends in up)])
    return np.array(kinds), offsets_of(np.array(list(map(len, rows)))), np.concatenate(rows)


def mesh_of(grid: Grid) -> tuple[AnyTessellation, list[str]]:
    """Return the mesh of a grid, and notes on omitted parts."""
    grid = keep_corners(grid)
    _check_kinds(grid)
    inner, outer = grid.bounding
    cells = np.flatnonzero(inner)
    if CELL in grid.data:
        cells = cells[np.argsort(grid.data[CELL][cells], kind="stable")]
    marks = {name.removeprefix(MARK): (x != 0) & outer for name, x in grid.data.items() if name.startswith(MARK)}
    kept = {name: x[cells] for name, x in grid.data.items() if name != CELL and not name.startswith(MARK)}
    data = {name: x.astype(x.dtype.newbyteorder("=")) for name, x in kept.items() if x.dtype.kind in "biuf"}
    data |= {name: x[cells].astype(np.uint8) for name, x in grid.sets.items() if x[cells].any()}
    sides = {name: np.flatnonzero(x & outer) for name, x in (grid.sets | marks).items()}
    parts = {name: rows_in_order(grid.offsets, grid.vertices, rows) for name, rows in sides.items() if len(rows)}
    parts |= grid.parts
    interfaces = _interfaces(parts)
    mesh: AnyTessellation
    if grid.solid:
        mesh = PolyhedralMesh(grid.points, _solids(grid, cells), boundaries={}, cell_data=data, interfaces=interfaces)
    else:
        offsets, vertices = rows_in_order(grid.offsets, grid.vertices, cells)
        counts = np.unique(np.diff(offsets))
        polygons = vertices.reshape(-1, counts[0]) if len(counts) == 1 else np.split(vertices, offsets[1:-1])
        mesh = PolygonMesh(
            _plane(grid.points, vertices), polygons, boundaries={}, cell_data=data, interfaces=interfaces
        )
    return _with_parts(mesh, parts, grid)


def keep_corners(grid: Grid) -> Grid:
    """Replace cells of higher order by cells with straight edges."""
    kinds = np.array([k.rstrip(DIGITS) if k.rstrip(DIGITS) in NODES else k for k in grid.kinds.tolist()], dtype=str)
    counts = np.diff(grid.offsets)
    corners = np.array([NODES.get(kind, 0) for kind in kinds.tolist()], dtype=np.int64)
    curved = kinds != grid.kinds
    wrong = np.flatnonzero(np.where(curved, counts < corners, (corners > 0) & (counts != corners)))
    if len(wrong):
        raise MeshError(f"some of its cells of the kind {str(grid.kinds[wrong[0]])!r} have a wrong number of nodes.")
    if not curved.any():
        return grid
    counts = np.where(curved, corners, counts)
    offsets = offsets_of(counts)
    vertices = grid.vertices[np.arange(offsets[-1]) + np.repeat(grid.offsets[:-1] - offsets[:-1], counts)]
    names = ", ".join(np.unique(grid.kinds[curved]).tolist())
    note = f"cells of higher order ({names}) are read as their corners, with straight edges."
    return replace(grid, kinds=kinds, offsets=offsets, vertices=vertices, notes=(*grid.notes, note))


def bodies_of(grid: Grid, source: str) -> dict[str, Grid]:
    """Return the grids of bodies by name."""
    inner, outer = grid.bounding
    bodies = {name: grid.sets[name] & inner for name in grid.bodies if (grid.sets[name] & inner).any()}
    times = np.sum([*bodies.values(), np.zeros(len(inner), dtype=np.int64)], axis=0)[inner]
    if len(bodies) < 2 or (times != 1).any():
        sizes = {name: np.count_nonzero(grid.sets[name] & inner) for name in grid.bodies}
        found = ", ".join(f"{name!r} with {size} cells" for name, size in sizes.items()) or "there is none"
        counts = f"{(times == 0).sum()} cells are in no body, {(times > 1).sum()} in several"
        raise MeshError(
            f"bodies='physical' makes a body of every {source}. There must be at least two, and each cell must be in "
            f"one; here {'; '.join([found, counts, *(n.rstrip('.') for n in grid.notes)])}."
        )
    found_grids: dict[str, Grid] = {}
    cell = np.repeat(np.arange(len(inner)), np.diff(grid.offsets))
    for name, mine in bodies.items():
        own = np.zeros(len(grid.points), dtype=bool)
        own[grid.vertices[mine[cell]]] = True
        part = grid.select(np.flatnonzero(mine | (outer & (np.bincount(cell, ~own[grid.vertices], len(mine)) == 0))))
        number = np.cumsum(own) - 1
        parts = {}
        for side, (offsets, nodes) in grid.parts.items():
            rows = np.flatnonzero(np.logical_and.reduceat(own[nodes], offsets[:-1]))
            if len(rows):
                kept, corners = rows_in_order(offsets, nodes, rows)
                parts[side] = kept, number[corners]
        part.data.pop(PHYSICAL, None)
        part.points, part.vertices, part.parts = grid.points[own], number[part.vertices], parts
        part.nodes = {side: chosen[own] for side, chosen in grid.nodes.items() if chosen[own].any()}
        part.sets = {key: x & ~part.bounding[0] if key in grid.bodies else x for key, x in part.sets.items()}
        part.notes = ()
        found_grids[name] = part
    return found_grids


def _check_kinds(grid: Grid) -> None:
    kinds: set[str] = set(grid.kinds.tolist())
    strange = sorted(kinds - {*POLYGONS, *SOLIDS, "vertex", "empty", "line"})
    if strange:
        raise MeshError(
            f"it has cells of the kind {strange[0]!r}. Kinds that are read: line, {', '.join((*POLYGONS, *SOLIDS))}, "
            "all with straight edges and plane faces. Export elements of first order."
        )
    if not grid.bounding[0].any():
        raise MeshError(" ".join([f"it has no polygons, only {', '.join(sorted(kinds)) or 'nothing'}.", *grid.notes]))
    for name, values in grid.data.items():
        single = name == CELL or name.startswith(MARK)
        if len(values) != len(grid.kinds) or (single and values.ndim > 1):
            raise MeshError(f"its cell datum {name!r} has the shape {values.shape} on {len(grid.kinds)} cells.")


def _plane(points: Floats, used: Ints) -> Floats:
    """Return the points without z. Raise MeshError if z is not constant."""
    points = np.asarray(points, dtype=float)
    if points.ndim == 2 and points.shape[1] == 3 and len(points):
        # Rotated meshes are plane up to rounding. Later checks report invalid node numbers.
        x = points.take(used, axis=0, mode="clip")
        if np.ptp(x[:, 2]) > SAME * np.nanmax(np.abs(x - x[0]), initial=0.0):
            raise MeshError(
                f"its points do not lie in a plane z = constant: z runs from {x[:, 2].min():.6g} to "
                f"{x[:, 2].max():.6g}. Rotate the mesh into the x-y plane first."
            )
        return points[:, :2]
    return points


def _interfaces(parts: dict[str, Rows]) -> dict[str, Interface]:
    """Remove interfaces from `parts`, and return the interfaces."""
    found = {}
    for key in [name for name in parts if name.startswith(PARTNERS) and name.count(":") > 2]:
        first, second, name = key.removeprefix(PARTNERS).split(":", 2)
        if name not in parts:
            raise MeshError(f"it has partner nodes of an interface {name!r}, but no boundary of this name.")
        edges, partners = (pad_rows(*parts.pop(one)) for one in (name, key))
        found[name] = Interface((unquote(first), unquote(second)), edges, partners)
    return found


def _solids(grid: Grid, cells: Ints) -> FaceLists:
    """Return the faces of the given solids."""
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
        faces = FACES[kind]
        offsets = offsets_of(np.tile([len(face) for face in faces], len(corners)))
        vertices = corners[:, np.concatenate(faces)].ravel()
        # Files list the nodes of solids in either orientation.
        x = np.asarray(grid.points, dtype=float).take(corners[:, (0, *EDGES[kind])], axis=0, mode="clip")
        backwards = np.linalg.det(x[:, 1:] - x[:, :1]) < 0.0
        vertices = reverse_rows(offsets, vertices, np.repeat(backwards, len(faces)))
        lists.append(FaceLists(offsets, vertices, np.arange(len(corners) + 1) * len(faces)))
    joined = FaceLists(
        offsets_of(np.concatenate([np.diff(one.offsets) for one in lists])),
        np.concatenate([one.vertices for one in lists]),
        offsets_of(np.concatenate([np.diff(one.cell_offsets) for one in lists])),
    )
    place = np.zeros(len(grid.kinds), dtype=np.int64)
    place[np.concatenate(numbers)] = np.arange(len(cells))
    return joined.in_order(place[cells])


def _with_parts(mesh: AnyTessellation, parts: Mapping[str, Rows], grid: Grid) -> tuple[AnyTessellation, list[str]]:
    """Return the mesh with named boundaries, and notes on omitted parts."""
    notes, boundaries = list(grid.notes), {}
    whole, dimension = mesh.boundaries[WHOLE], mesh.points.shape[1]
    number = np.arange(mesh.n_nodes) if mesh.node_map is None else mesh.node_map
    for name, rows in parts.items():
        found = mesh._find_parts(*rows_in_order(*rows, np.flatnonzero(np.diff(rows[0]) >= dimension)), number)
        chosen, strange = np.unique(found[found >= 0]), np.count_nonzero(found < 0)
        if strange:
            kind = "lines" if dimension == 2 else "polygons"
            notes.append(f"{strange} of {len(found)} {kind} named {name!r} are not on the boundary and are left out.")
        if len(chosen) and not (name == WHOLE and len(chosen) == len(whole)):
            boundaries[name] = whole[chosen]
    (offsets, vertices), alone = mesh._outlines, []
    for name, nodes in grid.nodes.items():
        inside = np.isin(vertices, number[nodes])
        chosen = np.flatnonzero(np.logical_and.reduceat(inside, offsets[:-1]))
        if len(chosen):
            boundaries.setdefault(name, whole[chosen])
        else:
            alone.append(repr(name))
    if alone:
        notes.append(f"no boundary is made of {', '.join(alone)}: these nodes are not all nodes of {mesh.A_PART}.")
    return mesh._with_named(boundaries), notes
