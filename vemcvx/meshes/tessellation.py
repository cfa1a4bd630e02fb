"""A mesh: points, cells, named parts of the boundary, data on cells; immutable.

In the plane cells are simple polygons listed counter-clockwise; two cells meet in whole edges and vertices of both. A
vertex may lie on a straight line between its neighbours (a hanging node of the cell next door) and cells need not be
convex.
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

from vemcvx.arrays import Bools, Floats, Ints, read_only
from vemcvx.errors import MeshError, MeshWarning
from vemcvx.meshes.box import SIDES, Box, check_boundaries, check_cell_data, check_datum_name, chosen_parts
from vemcvx.meshes.checks.plane import checked
from vemcvx.meshes.interfaces import Interface, on_boundary, outside
from vemcvx.meshes.polygons import geometry, topology
from vemcvx.outline import Outline, in_a_line


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Mesh(ABC):
    """Points, and cells that kinds of meshes describe by further arrays; immutable."""

    points: Floats
    cell_data: Mapping[str, NDArray[Any]]
    interfaces: Mapping[str, Interface]
    node_map: Ints | None
    _named: Mapping[str, Ints]
    _box: Box | None

    ARRAYS: ClassVar[tuple[str, ...]]
    """Names of the arrays that make it."""
    PARTS: ClassVar[str]
    """Name of the parts that make its boundary."""

    @property
    @abstractmethod
    def n_cells(self) -> int:
        """Number of cells."""

    @property
    @abstractmethod
    def diameters(self) -> Floats:
        """Largest distance of two vertices of each cell, (n_cells,)."""

    @property
    @abstractmethod
    def _boundary(self) -> Ints:
        """The parts of the boundary: edges (m, 2), or numbers of faces (m,)."""

    @property
    @abstractmethod
    def _outlines(self) -> tuple[Ints, Ints]:
        """Offsets and vertices of the parts of the boundary."""

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.points)

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
        joints = {name: interface.edges for name, interface in self.interfaces.items()}
        return MappingProxyType({**sides, **self._named, **joints, "boundary": self._boundary})

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

    @property
    @abstractmethod
    def _choice(self) -> tuple[Ints, Floats]:
        """The parts of the boundary that no interface has, and their middles (m, dim)."""

    @abstractmethod
    def _checked_parts(self, boundaries: Mapping[str, Any] | None, node_map: Ints | None = None) -> dict[str, Ints]:
        """Named parts of the boundary, or MeshError; `node_map` if their nodes have been numbered anew since."""

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
        parts, middles = self._choice
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

    def _fill(self, *arrays: Floats | Ints, **others: object) -> None:
        fields = {
            **{name: read_only(array) for name, array in zip(self.ARRAYS, arrays, strict=True)},
            "cell_data": MappingProxyType({}),
            "interfaces": MappingProxyType({}),
            "node_map": None,
            "_named": {},
            "_box": None,
            **others,
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    def _replace(self, **fields: object) -> Self:
        """Return a mesh that shares everything, also what is already computed, but the given fields."""
        mesh = object.__new__(type(self))
        mesh.__dict__.update({key: value for key, value in self.__dict__.items() if key != "boundaries"})
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
    rounding = 1e-9 * float((high - low).max())
    sides = mesh._sides(Box(tuple(low.tolist()), tuple(high.tolist())), rounding)
    return {name: parts for name, parts in sides.items() if len(parts)}


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Tessellation(Mesh):
    """Points and polygonal cells, checked: the data of a :class:`vemcvx.PolygonMesh`, whose docstring says the rest."""

    offsets: Ints
    vertices: Ints
    _box: Box | None

    ARRAYS = ("points", "offsets", "vertices")
    PARTS = "edges"

    def __init__(
        self,
        points: ArrayLike,
        cells: Sequence[ArrayLike] | NDArray[np.integer],
        *,
        boundaries: Mapping[str, ArrayLike] | None = None,
        cell_data: Mapping[str, ArrayLike] | None = None,
        interfaces: Mapping[str, Interface] | None = None,
    ):
        points, offsets, vertices, given, node_map, notes = checked(points, cells, interfaces)
        for note in notes:
            warnings.warn(note, MeshWarning, stacklevel=2)
        self._fill(points, offsets, vertices, node_map=node_map)
        object.__setattr__(self, "_named", self._checked_parts(boundaries, node_map))
        matched = on_boundary(given, self._boundary, self.n_nodes, node_map)
        object.__setattr__(self, "interfaces", MappingProxyType(matched))
        object.__setattr__(self, "cell_data", MappingProxyType(check_cell_data(cell_data, self.n_cells)))

    @classmethod
    def unchecked(cls, points: Floats, offsets: Ints, vertices: Ints, box: Box | None = None) -> Self:
        """Return a mesh of arrays known to be valid, without copy or check; its sides are named if ``box`` is given."""
        mesh = object.__new__(cls)
        mesh._fill(points, offsets, vertices, _box=box)
        return mesh

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
        return read_only(areas), read_only(centroids)

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
        return read_only(geometry.diameters(self.points, self.offsets, self.vertices))

    @cached_property
    def shared_edges(self) -> topology.SharedEdges:
        """Corners by the edge that they start."""
        return topology.shared_edges(self.offsets, self.vertices, self.n_nodes)

    @cached_property
    def _boundary(self) -> Ints:
        edges = topology.directed_edges(self.offsets, self.vertices)
        return read_only(edges[self.shared_edges.alone])

    @property
    def _outlines(self) -> tuple[Ints, Ints]:
        return 2 * np.arange(len(self._boundary) + 1), self._boundary.ravel()

    @cached_property
    def neighbours(self) -> Ints:
        """Pairs of cells that share an edge, (m, 2)."""
        return read_only(topology.neighbours(self.offsets, self.shared_edges))

    @property
    def _choice(self) -> tuple[Ints, Floats]:
        edges = self._boundary[outside(self.interfaces, self._boundary, self.n_nodes)]
        return edges, 0.5 * (self.points[edges[:, 0]] + self.points[edges[:, 1]])

    def _checked_parts(self, boundaries: Mapping[str, Any] | None, node_map: Ints | None = None) -> dict[str, Ints]:
        return check_boundaries(boundaries, self._boundary, self.n_nodes, node_map)
