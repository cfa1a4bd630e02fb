"""Immutable meshes of points, cells, named boundaries and cell data.

Neighbouring cells share whole edges or faces. At a hanging node, a cell has an angle of 180 degrees.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.base.arrays import SAME, Bools, Floats, Ints, brief, read_only
from vemcvx.base.errors import MeshError, MeshWarning
from vemcvx.meshes import polygons
from vemcvx.meshes.box import (
    SIDES,
    WHOLE,
    Box,
    check_cell_data,
    check_mapping,
    check_name,
    select_parts,
)
from vemcvx.meshes.checks.plane import CheckedMesh, lay_flat, list_of
from vemcvx.meshes.interfaces import Interface, faces_of, on_boundary


class Sides(NamedTuple):
    """Edges of a plane mesh, or faces of a mesh in space."""

    offsets: Ints
    vertices: Ints  # (m,) nodes, oriented as in the first cell
    cells: Ints  # (n_sides, 2) adjacent cells; the second is -1 on the boundary


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Mesh(ABC):
    """The base class of `PolygonMesh` and `PolyhedralMesh`.

    Attributes
    ----------
    points, cell_data, interfaces, node_map : as in `PolygonMesh`

    Examples
    --------
    >>> isinstance(vx.meshes.cubes(2), vx.meshes.Mesh)
    True
    """

    points: Floats
    cell_data: Mapping[str, NDArray[Any]]
    interfaces: Mapping[str, Interface]
    node_map: Ints | None
    _named: Mapping[str, Ints]

    ARRAYS: ClassVar[tuple[str, ...]]  # names of the arrays that define the mesh
    NUMBERED: ClassVar[Mapping[str, str]]  # name of an array -> upper limit of the entries, such as "n_nodes"
    PARTS: ClassVar[str]  # "edges" or "faces"
    A_PART: ClassVar[str]  # "an edge" or "a face"

    @classmethod
    def unchecked(cls, *arrays: Floats | Ints, box: Box | None = None) -> Self:
        """Return the mesh of valid arrays, with names for the sides of a box."""
        mesh = object.__new__(cls)
        mesh._fill(*arrays)
        return mesh if box is None else mesh._replace(_named=mesh._in_planes(box))

    def _fill(self, *arrays: Floats | Ints, **others: object) -> None:
        nothing: Mapping[str, Any] = MappingProxyType({})
        own = {name: read_only(array) for name, array in zip(self.ARRAYS, arrays, strict=True)}
        known = {"cell_data": nothing, "interfaces": nothing, "node_map": None, "_named": {}}
        self.__dict__.update(own, **(known | others))

    def _take(
        self, found: CheckedMesh, boundaries: Mapping[str, Any] | None, cell_data: Mapping[str, ArrayLike] | None
    ) -> None:
        """Fill the mesh with checked arrays, named boundaries and cell data."""
        self._fill(*found.arrays, node_map=found.node_map)
        for note in found.notes:
            warnings.warn(note, MeshWarning, stacklevel=3)
        named = self._check_parts(boundaries, found.node_map)
        data = check_cell_data(cell_data, self.n_cells)
        interfaces = on_boundary(found.interfaces, self._outlines, found.node_map)
        if boundaries is None and not interfaces:
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
        """Offsets (n_cells + 1,), and the nodes of each cell."""

    @property
    @abstractmethod
    def _sides(self) -> Sides:
        """The edges or faces of all cells."""

    @property
    @abstractmethod
    def _boundary(self) -> Ints:
        """Boundary edges (m, 2), or in space face numbers (m,)."""

    @property
    @abstractmethod
    def _middles(self) -> Floats:
        """Midpoints (m, 2) of boundary edges, or centroids (m, 3) of boundary faces."""

    @abstractmethod
    def _places(self, parts: Ints) -> Ints:
        """Return the positions of `parts` in `_boundary`."""

    @abstractmethod
    def _measure_cells(self) -> tuple[Floats, Floats]:
        """Return the areas or volumes of the cells, and the centroids."""

    @cached_property
    def _outer_sides(self) -> Ints:
        return np.flatnonzero(self._sides.cells[:, 1] < 0)

    @property
    def _outlines(self) -> tuple[Ints, Ints]:
        offsets, vertices, _ = self._sides
        return polygons.rows_in_order(offsets, vertices, self._outer_sides)

    @property
    def _owners(self) -> Ints:
        return self._sides.cells[self._outer_sides, 0]

    @cached_property
    def neighbours(self) -> Ints:
        """Pairs (m, 2) of adjacent cells, one pair per inner edge or face. The smaller number is first."""
        cells = self._sides.cells
        return read_only(cells[cells[:, 1] >= 0])

    @property
    def _inner_outlines(self) -> tuple[Ints, Ints]:
        """Offsets and vertices of inner sides, in the order of `neighbours`."""
        offsets, vertices, cells = self._sides
        return polygons.rows_in_order(offsets, vertices, np.flatnonzero(cells[:, 1] >= 0))

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @cached_property
    def _measures_and_centroids(self) -> tuple[Floats, Floats]:
        measures, centroids = self._measure_cells()
        return read_only(measures), read_only(centroids)

    @property
    def measures(self) -> Floats:
        """Areas (n_cells,) of the cells, or volumes in space."""
        return self._measures_and_centroids[0]

    @property
    def centroids(self) -> Floats:
        """Centroids (n_cells, dim) of the cells."""
        return self._measures_and_centroids[1]

    @cached_property
    def diameters(self) -> Floats:
        """Largest distances (n_cells,) between two vertices of a cell."""
        return read_only(polygons.diameters(self.points, *self.cell_nodes))

    @cached_property
    def h(self) -> float:
        """Mesh size: the largest cell diameter."""
        return float(self.diameters.max())

    @cached_property
    def boundaries(self) -> Mapping[str, Ints]:
        """Named parts of the boundary: edges (m, 2) or, in space, face numbers (m,).

        Edges run counter-clockwise around cells. An edge (a, b) has the outward normal (y_b - y_a, x_a - x_b) / length.
        "boundary" is the whole boundary. The name of an interface means the edges or faces of the first body.
        """
        own = {name: faces_of(interface.edges, self._outlines) for name, interface in self.interfaces.items()}
        joints = {name: read_only(self._boundary[parts]) for name, parts in own.items()}
        return MappingProxyType({**self._named, **joints, "boundary": self._boundary})

    def beyond(self, parts: Ints) -> Ints:
        """Return the edges or faces that touch `parts` across an interface."""
        places, found = self._places(parts), [np.zeros(0, dtype=np.int64)]
        for interface in self.interfaces.values():
            first, second = (faces_of(side, self._outlines) for side in (interface.edges, interface.partners))
            found.append(second[np.isin(first, places)])
        return self._boundary[np.unique(np.concatenate(found))]

    @cached_property
    def _outer(self) -> Bools:
        """A mask of the boundary edges or faces outside interfaces."""
        free = np.ones(len(self._boundary), dtype=bool)
        for interface in self.interfaces.values():
            for side in (interface.edges, interface.partners):
                free[faces_of(side, self._outlines)] = False
        return free

    def _in_planes(self, box: Box, tolerance: float = 0.0) -> dict[str, Ints]:
        """Return boundary edges or faces on the named sides of a box."""
        offsets, vertices = self._outlines
        low, high = (f.reduceat(self.points[vertices], offsets[:-1]) for f in (np.minimum, np.maximum))
        # Near a corner of the box, a very short edge belongs to the parallel side only.
        longest = np.argmax(high - low, axis=1)
        named = {}
        for axis, names in enumerate(SIDES[len(box.low)]):
            for name, place in zip(names, (box.low[axis], box.high[axis]), strict=True):
                off = np.maximum(np.abs(low[:, axis] - place), np.abs(high[:, axis] - place))
                named[name] = read_only(self._boundary[(off <= tolerance) & (longest != axis)])
        return named

    def _check_parts(self, boundaries: Mapping[str, Any] | None, node_map: Ints | None = None) -> dict[str, Ints]:
        """Return the named boundaries, or raise MeshError."""
        number = np.arange(self.n_nodes) if node_map is None else node_map
        named = {}
        for name, given in check_mapping(boundaries, "boundaries", self.PARTS).items():
            parts, called = self._parts(name, given, number)
            strange = np.flatnonzero(parts < 0)
            if len(strange):
                raise MeshError(
                    f"boundary {name!r}: {called[strange[0]]} is not {self.A_PART} of the boundary "
                    f"({len(strange)} of {len(parts)} are not). Name only {self.PARTS} that belong to "
                    "exactly one cell."
                )
            chosen = np.unique(parts)
            if name != WHOLE or len(chosen) < len(self._boundary):
                named[check_name(name)] = read_only(self._boundary[chosen])
        return named

    def _parts(self, name: str, given: Any, number: Ints) -> tuple[Ints, list[str]]:
        rows = list_of(given, f"boundary {name!r} must be a list of {self.PARTS}, each a list of node numbers")
        if not rows:
            raise MeshError(f"boundary {name!r} has no {self.PARTS}; name one at least, or leave it out.")
        offsets, vertices = lay_flat(rows, lambda k: f"boundary {name!r}: {self.A_PART} (number {k} in the list)")
        called = [f"({', '.join(map(str, row.tolist()))})" for row in np.split(vertices, offsets[1:-1])]
        return self._find_parts(offsets, vertices, number), called

    def _find_parts(self, offsets: Ints, vertices: Ints, number: Ints) -> Ints:
        known = (vertices >= 0) & (vertices < len(number))
        own = np.where(known, number[np.where(known, vertices, 0)], -1)
        return polygons.matching_rows(*self._outlines, offsets, own)

    def with_boundary(self, name: str, predicate: Callable[[Floats], Bools], of: str | None = None) -> Self:
        """Return this mesh with one more named boundary.

        Parameters
        ----------
        name : str
            Name of the part. A part with this name is replaced. Parts may overlap.
        predicate : callable
            A function of midpoints (m, 2) of edges, or in space of centroids (m, 3) of faces. It returns a mask (m,).
        of : str, optional
            Boundary or interface from which to choose; by default the whole boundary without interfaces.
        """
        if of is not None and not (isinstance(of, str) and of in self.boundaries):
            known = ", ".join(map(repr, self.boundaries))
            raise MeshError(f"with_boundary: found of = {brief(of)}; this mesh has the boundaries {known}.")
        some = np.flatnonzero(self._outer) if of is None else self._places(self.boundaries[of])
        parts, middles = self._boundary[some], self._middles[some]
        return self._with_named({name: read_only(parts[select_parts(name, predicate, middles, self.PARTS)])})

    def _with_named(self, added: Mapping[str, Ints]) -> Self:
        for name in map(check_name, added):
            if name in self.interfaces:
                raise MeshError(f"{name!r} is an interface of this mesh; choose another name.")
        return self._replace(_named={**self._named, **{name: read_only(parts) for name, parts in added.items()}})

    def with_cell_data(self, name: str, values: ArrayLike) -> Self:
        """Return this mesh with cell data `values` (n_cells, ...), which replace data of the same name.

        Raises MeshError if the name is empty, or `values` are not numbers with one row per cell.
        """
        added = check_cell_data({check_name(name, "cell datum"): values}, self.n_cells)
        return self._replace(cell_data=MappingProxyType({**self.cell_data, **added}))

    def refine(self, cells: ArrayLike | None = None) -> Self:
        """Return this mesh with some or all cells split.

        The parts of a cell replace the cell, and have the same data. New nodes come after old nodes.

        Parameters
        ----------
        cells : (m,) array_like of int or (n_cells,) array_like of bool, optional
            Cells to split, by default all cells. If `cells` is given, tetrahedra are split into two or more parts, else
            into eight or more. Further cells are split until each edge has at most one hanging node, or in space none.

        Raises
        ------
        MeshError
            `cells` is invalid, or the shape of a cell does not allow a split. In space, local refinement needs
            tetrahedra.
        """
        from vemcvx.meshes.bisection import refine_mesh

        refined: Self = refine_mesh(self, cells)
        return refined

    def cut(self, name: str, sides: Mapping[str, ArrayLike]) -> Self:
        """Return this mesh with a crack along the edges or faces between two sets of cells.

        The crack becomes an interface with double nodes. Crack tips inside the mesh keep single nodes. New nodes come
        last.

        Parameters
        ----------
        name : str
            Name of the new interface.
        sides : mapping of str to array_like
            Name -> cells on one side of the crack, as numbers or a mask.

        Raises
        ------
        MeshError
            The sides have no common edge or face, or all nodes of an edge or face would be crack tips.
        """
        from vemcvx.meshes.cracks import open_crack

        return open_crack(self, name, sides)

    def write(self: Any, path: str | Path) -> None:
        """Write the mesh with named boundaries and cell data to a .vtu file.

        :func:`vemcvx.meshes.read` restores the mesh exactly. ``to("meshio").write(path)`` writes other formats.
        """
        from vemcvx.meshes.io.files import write

        write(path, self)

    def to(self: Any, library: Literal["meshio", "skfem", "pyvista"]) -> Any:
        """Return the mesh as an object of another library.

        :func:`vemcvx.meshes.convert` is the inverse. Meshes of meshio and PyVista keep all names and data. Meshes of
        scikit-fem keep names of boundaries. Cell data of zeros and ones become subdomains.

        Returns
        -------
        meshio.Mesh, skfem.MeshTri, MeshQuad, MeshTet or MeshHex, or pyvista.UnstructuredGrid

        Raises
        ------
        MeshError
            The library is not supported, or cannot hold these cells (scikit-fem needs cells of a single kind).
        """
        from vemcvx.meshes.io.objects import to_object

        return to_object(self, library)

    def _replace(self, **fields: object) -> Self:
        mesh = object.__new__(type(self))
        anew = {"boundaries", "_outer"} if "interfaces" in fields else {"boundaries"}
        mesh.__dict__.update({key: value for key, value in self.__dict__.items() if key not in anew})
        mesh.__dict__.update(fields)
        return mesh

    def __getstate__(self) -> dict[str, object]:
        kept = {name: getattr(self, name) for name in (*self.ARRAYS, "node_map", "_named")}
        # mapping proxies cannot be pickled
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


def straight_sides(mesh: Mesh) -> dict[str, Ints]:
    """Return the straight sides of the mesh by name, such as "left"."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    # the sides of a moved or scaled mesh are straight up to rounding
    rounding = SAME * float((high - low).max())
    sides = mesh._in_planes(Box(tuple(low.tolist()), tuple(high.tolist())), rounding)
    return {name: parts for name, parts in sides.items() if len(parts)}
