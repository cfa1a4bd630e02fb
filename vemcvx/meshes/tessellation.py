"""A mesh: points, cells, named parts of the boundary, data on cells; immutable.

A mesh is a cell complex: cells have sides (edges in the plane, faces in space), sides have vertices, and a side belongs
to one cell, on the boundary, or to two. In the plane cells are simple polygons listed counter-clockwise, in space
polyhedra with plane faces; two cells meet in whole sides of both. A vertex may lie on a straight line between its
neighbours (a hanging node of the cell next door), a cell may have several coplanar faces, and need not be convex.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

from vemcvx.base.arrays import SAME, Bools, Floats, Ints, brief, plain, read_only
from vemcvx.base.errors import MeshError, MeshWarning
from vemcvx.base.outline import Outline, in_a_line
from vemcvx.meshes import polygons, polyhedra
from vemcvx.meshes.box import (
    SIDES,
    WHOLE,
    Box,
    check_cell_data,
    check_datum_name,
    check_edges,
    check_mapping,
    check_name,
    chosen_parts,
)
from vemcvx.meshes.checks.plane import Checked, checked
from vemcvx.meshes.checks.space import checked_in_space
from vemcvx.meshes.interfaces import Interface, faces_of, on_boundary


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Mesh(ABC):
    """Points, and cells that kinds of meshes describe by further arrays; immutable."""

    points: Floats
    cell_data: Mapping[str, NDArray[Any]]
    interfaces: Mapping[str, Interface]
    node_map: Ints | None
    _named: Mapping[str, Ints]
    _box: Box | None

    ARRAYS: ClassVar[tuple[str, ...]]  # Names of the arrays that make it.
    NUMBERED: ClassVar[Mapping[str, str]]  # Names of arrays of numbers, and of how many there are of what they number.
    PARTS: ClassVar[str]  # Name of the parts that make its boundary, and of one of them.
    A_PART: ClassVar[str]
    NAMED_BY_PLACE: ClassVar[bool] = False  # whether sides get names by place where nothing is named

    @classmethod
    def unchecked(cls, *arrays: Floats | Ints, box: Box | None = None) -> Self:
        """Return a mesh of arrays known to be valid, without copy or check; its sides are named if ``box`` is given."""
        mesh = object.__new__(cls)
        mesh._fill(*arrays, _box=box)
        return mesh

    def _fill(self, *arrays: Floats | Ints, **others: object) -> None:
        nothing: Mapping[str, Any] = MappingProxyType({})
        own = {name: read_only(array) for name, array in zip(self.ARRAYS, arrays, strict=True)}
        known = {"cell_data": nothing, "interfaces": nothing, "node_map": None, "_named": {}, "_box": None}
        self.__dict__.update(own, **(known | others))

    def _take(
        self, found: Checked, boundaries: Mapping[str, Any] | None, cell_data: Mapping[str, ArrayLike] | None
    ) -> None:
        """Take what was checked; sides of a box get names if the user names nothing: not even by an empty mapping."""
        self._fill(*found.arrays, node_map=found.node_map)
        for note in found.notes:
            warnings.warn(note, MeshWarning, stacklevel=3)
        named = self._checked_parts(boundaries, found.node_map)
        data = check_cell_data(cell_data, self.n_cells)
        interfaces = on_boundary(found.interfaces, self._outlines, found.node_map)
        if self.NAMED_BY_PLACE and boundaries is None and not interfaces:
            named = straight_sides(self)
        fields = {"_named": named, "cell_data": MappingProxyType(data), "interfaces": MappingProxyType(interfaces)}
        self.__dict__.update(fields)

    @property
    @abstractmethod
    def n_cells(self) -> int:
        """Number of cells."""

    @property
    @abstractmethod
    def cell_nodes(self) -> tuple[Ints, Ints]:
        """Offsets (n_cells + 1,), and the nodes of each cell between them, once each."""

    @property
    @abstractmethod
    def _boundary(self) -> Ints:
        """The parts of the boundary: edges (m, 2), or numbers of faces (m,)."""

    @property
    @abstractmethod
    def _outlines(self) -> tuple[Ints, Ints]:
        """Offsets and vertices of the parts of the boundary."""

    @property
    @abstractmethod
    def neighbours(self) -> Ints:
        """Pairs of cells that share an edge, in space a face, (m, 2); a pair appears once a side."""

    @property
    @abstractmethod
    def _inner_outlines(self) -> tuple[Ints, Ints]:
        """Offsets and vertices of the sides between `neighbours`, as they run in the first of these."""

    @property
    @abstractmethod
    def _owners(self) -> Ints:
        """The cell of each part of the boundary."""

    @property
    @abstractmethod
    def _middles(self) -> Floats:
        """The middles (m, dim) of the parts of the boundary."""

    @abstractmethod
    def _places(self, parts: Ints) -> Ints:
        """The places of parts in the boundary; all must be there."""

    @abstractmethod
    def _rows(self, name: str, given: Any, n_nodes: int) -> tuple[Ints, Ints]:
        """Offsets and vertices of parts that a user names; MeshError if these are none."""

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @abstractmethod
    def _measured(self) -> tuple[Floats, Floats]:
        """Areas or volumes, and centroids."""

    @cached_property
    def _measures_and_centroids(self) -> tuple[Floats, Floats]:
        measures, centroids = self._measured()
        return read_only(measures), read_only(centroids)

    @property
    def measures(self) -> Floats:
        """Area of each cell, in space its volume, (n_cells,)."""
        return self._measures_and_centroids[0]

    @property
    def centroids(self) -> Floats:
        """Centroid of each cell, (n_cells, 2), in space (n_cells, 3)."""
        return self._measures_and_centroids[1]

    @cached_property
    def diameters(self) -> Floats:
        """Largest distance of two vertices of each cell, (n_cells,)."""
        return read_only(polygons.diameters(self.points, *self.cell_nodes))

    @cached_property
    def h(self) -> float:
        """Mesh size: the largest cell diameter."""
        return float(self.diameters.max())

    @cached_property
    def boundaries(self) -> Mapping[str, Ints]:
        """Named parts of the boundary: name -> edges (m, 2), in space face numbers (m,); "boundary" is all of it.

        An edge (a, b) runs as in its counter-clockwise cell: the outward normal is (y_b - y_a, x_a - x_b) / length.
        The name of an interface means its edges of the first body; "boundary" has those of both.
        """
        sides = {} if self._box is None else self._sides(self._box)
        own = {name: faces_of(interface.edges, self._outlines) for name, interface in self.interfaces.items()}
        joints = {name: read_only(self._boundary[parts]) for name, parts in own.items()}
        return MappingProxyType({**sides, **self._named, **joints, "boundary": self._boundary})

    @cached_property
    def _outer(self) -> Bools:
        """A mask of the parts of the boundary that no interface has on either side."""
        free = np.ones(len(self._boundary), dtype=bool)
        for interface in self.interfaces.values():
            for side in (interface.edges, interface.partners):
                free[faces_of(side, self._outlines)] = False
        return free

    def _sides(self, box: Box, tolerance: float = 0.0) -> dict[str, Ints]:
        """Parts of the boundary on each side of a box; families put points on its sides to the bit."""
        offsets, vertices = self._outlines
        low, high = (f.reduceat(self.points[vertices], offsets[:-1]) for f in (np.minimum, np.maximum))
        longest = np.argmax(high - low, axis=1)  # shorter than the tolerance, parts are on sides that they run along
        named = {}
        for axis, names in enumerate(SIDES[len(box.low)]):
            for name, place in zip(names, (box.low[axis], box.high[axis]), strict=True):
                off = np.maximum(np.abs(low[:, axis] - place), np.abs(high[:, axis] - place))
                named[name] = read_only(self._boundary[(off <= tolerance) & (longest != axis)])
        return named

    def _checked_parts(self, boundaries: Mapping[str, Any] | None, node_map: Ints | None = None) -> dict[str, Ints]:
        """Named parts in the order of the boundary, or MeshError; `node_map` if nodes have been numbered anew since."""
        number = np.arange(self.n_nodes) if node_map is None else node_map
        named = {}
        for name, given in check_mapping(boundaries, "boundaries", self.PARTS).items():
            name = name if name == WHOLE else check_name(name)
            parts, called = self._parts(name, given, number)
            strange = np.flatnonzero(parts < 0)
            if len(strange):
                raise MeshError(
                    f"boundary {name!r}: {called[strange[0]]} is not {self.A_PART} of the boundary "
                    f"({len(strange)} of {len(parts)} are not). Name only {self.PARTS} that belong to "
                    "exactly one cell."
                )
            chosen = np.unique(parts)
            if name != WHOLE:
                named[name] = read_only(self._boundary[chosen])
            elif len(chosen) < len(self._boundary):
                raise MeshError(
                    f"the name {WHOLE!r} is taken: it always means the whole boundary, and here it is given to "
                    f"{len(chosen)} of its {len(self._boundary)} parts. Choose another name, or leave it out."
                )
        return named

    def _parts(self, name: str, given: Any, number: Ints) -> tuple[Ints, list[str]]:
        """The parts of the boundary that a user names by vertices, -1 for none, and words for each."""
        offsets, vertices = self._rows(name, given, len(number))
        called = [f"({', '.join(map(str, row.tolist()))})" for row in np.split(vertices, offsets[1:-1])]
        return self._found(offsets, vertices, number), called

    def _found(self, offsets: Ints, vertices: Ints, number: Ints) -> Ints:
        """The places in the boundary of the parts with these vertices, by their new numbers; -1 for none."""
        known = (vertices >= 0) & (vertices < len(number))
        own = np.where(known, number[np.where(known, vertices, 0)], -1)
        return polygons.matching_rows(*self._outlines, offsets, own)

    def with_boundary(self, name: str, predicate: Callable[[Floats], Bools]) -> Self:
        """Return this mesh with one more named part of its boundary.

        Parameters
        ----------
        name : str
            Its name; a part of that name is replaced, and parts may overlap.
        predicate : callable
            Takes the midpoints (m, 2) of all boundary edges, interfaces left out, in space the centroids (m, 3) of all
            boundary faces; returns which belong: bool (m,).

        Raises
        ------
        MeshError
            The name is reserved, that of an interface or no string, the answer is not (m,) bool, or it selects nothing.
        """
        parts, middles = self._boundary[self._outer], self._middles[self._outer]
        return self._with_named({name: read_only(parts[chosen_parts(name, predicate, middles, self.PARTS)])})

    def with_boundaries(self, boundaries: Mapping[str, ArrayLike | Sequence[ArrayLike]]) -> Self:
        """Return this mesh with more named parts of its boundary.

        Parameters
        ----------
        boundaries : mapping of str to array_like
            Name -> edges (m, 2), in either direction; in space faces: their numbers (m,), or their vertices, a row a
            face, in any order.

        Raises
        ------
        MeshError
            A name is reserved or that of an interface, or an edge or face is not on the boundary.
        """
        return self._with_named(self._checked_parts(boundaries))

    def _with_named(self, added: Mapping[str, Ints]) -> Self:
        taken = [name for name in added if name in self.interfaces]
        if taken:
            raise MeshError(f"{taken[0]!r} is an interface of this mesh; choose another name.")
        return self._replace(_named={**self._named, **added})

    def with_cell_data(self, name: str, values: ArrayLike) -> Self:
        """Return this mesh with one more (or another) array (n_cells, ...) of data on cells."""
        added = check_cell_data({check_datum_name(name): values}, self.n_cells)
        return self._replace(cell_data=MappingProxyType({**self.cell_data, **added}))

    def _replace(self, **fields: object) -> Self:
        """Return a mesh that shares everything, also what is already computed, but the given fields."""
        mesh = object.__new__(type(self))
        anew = {"boundaries", "_outer"} if "interfaces" in fields else {"boundaries"}
        mesh.__dict__.update({key: value for key, value in self.__dict__.items() if key not in anew})
        mesh.__dict__.update(fields)
        return mesh

    def __getstate__(self) -> dict[str, object]:
        kept = {name: getattr(self, name) for name in (*self.ARRAYS, "node_map", "_named", "_box")}
        # A mapping proxy cannot be pickled.
        return {**kept, "cell_data": dict(self.cell_data), "interfaces": dict(self.interfaces)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        data = {name: read_only(values) for name, values in state.pop("cell_data").items()}
        named = {name: read_only(parts) for name, parts in state.pop("_named").items()}
        interfaces = MappingProxyType(state.pop("interfaces"))
        arrays = [state.pop(name) for name in self.ARRAYS]
        self._fill(*arrays, **state, cell_data=MappingProxyType(data), _named=named, interfaces=interfaces)

    def __repr__(self) -> str:
        known = list(self.boundaries)
        names = ", ".join(known if len(known) < 10 else [*known[:4], f"{len(known) - 5} more", known[-1]])
        return (
            f"{type(self).__name__}({self.n_cells} cells, {self.n_nodes} nodes, h = {self.h:.4g}, boundaries: {names})"
        )

    def _repr_html_(self) -> str:
        names = [(f'"{name}"', f"{len(parts)} {self.PARTS}") for name, parts in self.boundaries.items()]
        data = [(name, in_a_line(values)) for name, values in self.cell_data.items()]
        return Outline(f"{type(self).__name__}: {self.n_cells} cells, h = {self.h:.4g}", [*names, *data]).html()


def straight_sides(mesh: Mesh) -> dict[str, Ints]:
    """Parts of the boundary that lie where a coordinate is extreme, by the names that families give them, if any."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    # A mesh that was moved or scaled into place has straight sides to its digits.
    rounding = SAME * float((high - low).max())
    sides = mesh._sides(Box(tuple(low.tolist()), tuple(high.tolist())), rounding)
    return {name: parts for name, parts in sides.items() if len(parts)}


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Tessellation(Mesh):
    """Points and polygonal cells, checked: the data of a :class:`vemcvx.PolygonMesh`, whose docstring says the rest."""

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
    def _boundary(self) -> Ints:
        edges = polygons.directed_edges(self.offsets, self.vertices)
        return read_only(edges[self.shared_edges.alone])

    @property
    def _outlines(self) -> tuple[Ints, Ints]:
        return 2 * np.arange(len(self._boundary) + 1), self._boundary.ravel()

    @cached_property
    def neighbours(self) -> Ints:
        """Pairs of cells that share an edge, (m, 2), the smaller number first; a pair appears once an edge."""
        return read_only(polygons.cell_of_corner(self.offsets)[np.column_stack(self.shared_edges.twice)])

    @property
    def _inner_outlines(self) -> tuple[Ints, Ints]:
        edges = polygons.directed_edges(self.offsets, self.vertices)[self.shared_edges.twice[0]]
        return 2 * np.arange(len(edges) + 1), edges.ravel()

    @property
    def _owners(self) -> Ints:
        return polygons.cell_of_corner(self.offsets)[self.shared_edges.alone]

    @property
    def _middles(self) -> Floats:
        return 0.5 * (self.points[self._boundary[:, 0]] + self.points[self._boundary[:, 1]])

    def _places(self, parts: Ints) -> Ints:
        return polygons.positions(parts, self._boundary, self.n_nodes)

    def _rows(self, name: str, given: Any, n_nodes: int) -> tuple[Ints, Ints]:
        edges = check_edges(name, given, n_nodes)
        return 2 * np.arange(len(edges) + 1), edges.ravel()


def projected_values(mesh: Tessellation, cells: Ints, points: Floats) -> csr_array:
    """The matrix (p, n_nodes) from nodal values to those of Pi (see `vem.projection`) at points (p, 2) of cells (p,).

        Pi v(x) = sum_i v_i (w_i + G_i . (x - xbar)),   G_i = (y_{i+1} - y_{i-1}, x_{i-1} - x_{i+1}) / (2 |K|),

    with w_i the weights of the mean over the boundary and xbar = sum_i w_i x_i. Linear functions are reproduced.
    """
    shape = (len(cells), mesh.n_nodes)
    if not len(cells):
        return csr_array(shape)
    counts = np.diff(mesh.offsets)[cells]
    offsets = polygons.offsets_of(counts)
    nodes = mesh.vertices[polygons.spans(mesh.offsets[cells], counts)]
    x = mesh.points[nodes] - np.repeat(points, counts, axis=0)
    after, before = x[polygons.next_corner(offsets)], x[polygons.previous_corner(offsets)]
    length = np.hypot(*(after - x).T)
    both = length + length[polygons.previous_corner(offsets)]
    w = both / np.repeat(np.add.reduceat(both, offsets[:-1]), counts)
    mean = np.add.reduceat(w[:, None] * x, offsets[:-1], axis=0)
    chord = after - before
    doubled = np.add.reduceat(x[:, 0] * chord[:, 1], offsets[:-1])  # the very sum that makes the gradient of x one
    slope = polygons.right_of(chord) / np.repeat(doubled, counts)[:, None]
    values = w - np.einsum("ij,ij->i", slope, np.repeat(mean, counts, axis=0))
    return csr_array((values, nodes, offsets), shape=shape)


@dataclass(frozen=True, eq=False, repr=False, init=False)
class SpaceTessellation(Mesh):
    """Points, faces and polyhedral cells, checked: the data of a :class:`vemcvx.PolyhedralMesh`."""

    face_offsets: Ints
    face_vertices: Ints
    cell_offsets: Ints
    cell_faces: Ints
    face_cells: Ints

    ARRAYS = ("points", "face_offsets", "face_vertices", "cell_offsets", "cell_faces", "face_cells")
    NUMBERED = MappingProxyType({"face_vertices": "n_nodes", "cell_faces": "n_faces", "face_cells": "n_cells"})
    PARTS, A_PART = "faces", "a face"

    def __init__(
        self,
        points: ArrayLike,
        cells: Sequence[Sequence[ArrayLike]] | NDArray[np.integer] | polyhedra.Listed,
        *,
        boundaries: Mapping[str, ArrayLike | Sequence[ArrayLike]] | None = None,
        cell_data: Mapping[str, ArrayLike] | None = None,
        interfaces: Mapping[str, Interface] | None = None,
    ):
        self._take(checked_in_space(points, cells, interfaces), boundaries, cell_data)

    @cached_property
    def cells(self) -> tuple[tuple[Ints, ...], ...]:
        """Faces of each cell, outwards: the vertex numbers of each, as `PolyhedralMesh` takes them."""
        forwards = [self.face_vertices[start:end] for start, end in pairwise(self.face_offsets.tolist())]
        listed = [
            forwards[face] if sign > 0.0 else read_only(forwards[face][::-1])
            for face, sign in zip(self.cell_faces.tolist(), self.face_signs.tolist(), strict=True)
        ]
        return tuple(tuple(listed[start:end]) for start, end in pairwise(self.cell_offsets.tolist()))

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.cell_offsets) - 1

    @property
    def n_faces(self) -> int:
        """Number of faces, inner ones counted once."""
        return len(self.face_offsets) - 1

    @property
    def faces(self) -> polyhedra.Faces:
        """The topology: the faces of cells, and the vertices of faces."""
        return polyhedra.Faces(
            self.face_offsets, self.face_vertices, self.cell_offsets, self.cell_faces, self.face_cells
        )

    @cached_property
    def _face_shapes(self) -> polyhedra.FaceShapes:
        found = polyhedra.face_shapes(self.points, self.face_offsets, self.face_vertices)
        return polyhedra.FaceShapes(*map(read_only, found))

    @property
    def face_areas(self) -> Floats:
        """Area of each face, (n_faces,)."""
        return self._face_shapes.areas

    @property
    def face_normals(self) -> Floats:
        """Unit normal of each face, out of its first cell, (n_faces, 3)."""
        return self._face_shapes.normals

    @property
    def face_centroids(self) -> Floats:
        """Centroid of each face, (n_faces, 3)."""
        return self._face_shapes.centroids

    @cached_property
    def face_signs(self) -> Floats:
        """1 where the normal of a cell's face points out of the cell, -1 where into it; as ``cell_faces``."""
        return read_only(polyhedra.signs_of(self.faces))

    def _measured(self) -> tuple[Floats, Floats]:
        return polyhedra.volumes_and_centroids(self._face_shapes, self.cell_offsets, self.cell_faces, self.face_signs)

    @property
    def volumes(self) -> Floats:
        """Volume of each cell, (n_cells,)."""
        return self.measures

    @cached_property
    def cell_nodes(self) -> tuple[Ints, Ints]:
        """Offsets (n_cells + 1,), and the nodes of each cell between them, once each and ascending."""
        offsets, nodes = polyhedra.nodes_of_cells(self.faces, self.n_nodes)
        return read_only(offsets), read_only(nodes)

    @property
    def neighbours(self) -> Ints:
        """Pairs of cells that share a face, (m, 2), the smaller number first; a pair appears once a face."""
        return self.face_cells[self.face_cells[:, 1] >= 0]

    @property
    def _inner_outlines(self) -> tuple[Ints, Ints]:
        inner = np.flatnonzero(self.face_cells[:, 1] >= 0)
        return polygons.rows_in_order(self.face_offsets, self.face_vertices, inner)

    @cached_property
    def _boundary(self) -> Ints:
        return read_only(np.flatnonzero(self.face_cells[:, 1] < 0))

    @property
    def _outlines(self) -> tuple[Ints, Ints]:
        return polygons.rows_in_order(self.face_offsets, self.face_vertices, self._boundary)

    @property
    def _owners(self) -> Ints:
        return self.face_cells[self._boundary, 0]

    @property
    def _middles(self) -> Floats:
        return self.face_centroids[self._boundary]

    def _places(self, parts: Ints) -> Ints:
        return np.searchsorted(self._boundary, parts)

    def _parts(self, name: str, given: Any, number: Ints) -> tuple[Ints, list[str]]:
        faces = plain(given)
        if faces is None or faces.ndim != 1 or faces.dtype.kind not in "iu" or not len(faces):
            return super()._parts(name, given, number)
        place = np.minimum(np.searchsorted(self._boundary, faces), len(self._boundary) - 1)
        return np.where(self._boundary[place] == faces, place, -1), [f"face {face}" for face in faces.tolist()]

    def _rows(self, name: str, given: Any, n_nodes: int) -> tuple[Ints, Ints]:
        wanted = f"boundary {name!r}: faces must be numbers (m,) or rows of the numbers of their vertices, at least one"
        try:
            rows = [plain(row) for row in given]
        except Exception:  # of whatever a user hands in
            raise MeshError(f"{wanted}; got {brief(given)}.") from None
        if not rows or any(row is None or row.ndim != 1 or row.dtype.kind not in "iu" or not len(row) for row in rows):
            raise MeshError(f"{wanted}; got {brief(given)}.")
        flat = [row.astype(np.int64) for row in rows if row is not None]
        return polygons.offsets_of(np.array([len(row) for row in flat])), np.concatenate(flat)
